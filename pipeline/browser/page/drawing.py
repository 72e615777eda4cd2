"""Drawing in the plane of the patterns: a stroke of the pointer becomes a motion of one hand."""

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from viser import SceneNodeDragEvent, ViserServer

from pipeline.arrays import Floats
from pipeline.browser.page.colours import hand_colour
from pipeline.browser.page.segments import NOTHING, segments
from pipeline.browser.page.sent import vector
from pipeline.motions.motion import Motion
from pipeline.robot.config import RobotConfig
from pipeline.robot.kinematics import Kinematics
from pipeline.rotations import quaternions_of_matrices
from pipeline.teacher.reach import bring_within_reach
from pipeline.teacher.teacher import Teacher
from recorders.errors import MotionError

_SHEET_M = 0.5
_THICK_M = 0.001
_HZ = 50.0
_LEAST_POINTS = 5
_LEAST_M = 0.02


def drawn_motion(robot: RobotConfig, hand: str, times_s: Floats, points: Floats) -> Motion:
    """Return the motion of a stroke of one hand: smoothed, as fast as the robot can follow, and within its reach.

    Parameters
    ----------
    robot : RobotConfig
        The robot.
    hand : str
        The hand that draws; the others stay in the middle of theirs.
    times_s : ndarray
        Strictly increasing times [s], shape (T,).
    points : ndarray
        Positions [m], shape (T, 3).

    Raises
    ------
    MotionError
        If it is too short to be a stroke.
    """
    # These bring most of SciPy, which takes as long to import as all the rest of the page.
    from pipeline.exploration.demonstration import DemonstrationConfig, to_motion  # noqa: PLC0415
    from pipeline.exploration.hand_paths import DemonstratedPaths  # noqa: PLC0415
    from pipeline.exploration.pose_track import HandPath  # noqa: PLC0415

    size_m = float((points.max(axis=0) - points.min(axis=0)).max()) if len(points) else 0.0
    if len(points) < _LEAST_POINTS or size_m < _LEAST_M:
        raise MotionError(f"drawing: expected a stroke of at least {100 * _LEAST_M:g} cm, found {100 * size_m:.1f} cm")
    source: Mapping[str, Any] = {"kind": "drawn", "name": "drawing", "hands": [hand]}
    shown = DemonstratedPaths("drawing", {hand: HandPath(times_s, points)}, source)
    motion = to_motion(robot, shown, config=DemonstrationConfig(hz=_HZ, align="as-is", project_to_plane=True))
    return bring_within_reach(Teacher(Kinematics(robot)), motion, choice="clip")[0]


class Sheet:
    """Sheet in the plane of a hand's pattern on which a visitor draws with mouse, pen or finger.

    Parameters
    ----------
    server : ViserServer
        The page.
    robot : RobotConfig
        The robot.
    place : int
        The hand's place among those of the robot.
    on_stroke : callable
        Takes times [s], positions [m] and the visitor of a stroke.
    """

    def __init__(
        self,
        server: ViserServer,
        robot: RobotConfig,
        place: int,
        *,
        on_stroke: Callable[[Floats, Floats, int], None],
    ) -> None:
        self._centre = np.array(robot.hands[place].centre)
        self._normal = np.cross(robot.lateral, robot.up)
        self._on_stroke = on_stroke
        self._stroke: list[tuple[float, Floats]] = []
        name, turn = robot.hand_names[place], np.stack([robot.lateral, robot.up, self._normal], axis=1)
        x, y, z, w = quaternions_of_matrices(turn[np.newaxis])[0]
        self._sheet = server.scene.add_box(
            f"/sheets/{name}",
            color=hand_colour(place),
            dimensions=(_SHEET_M, _SHEET_M, _THICK_M),
            opacity=0.25,
            position=self._centre,
            wxyz=(w, x, y, z),
            visible=False,
            cast_shadow=False,
        )
        self._line = server.scene.add_line_segments(
            f"/strokes/{name}", NOTHING, hand_colour(place), thickness=3.0, thickness_units="screen"
        )
        self._sheet.on_drag(self._drag)

    def show(self, visible: bool) -> None:
        """Show or hide the sheet, without the last stroke."""
        self._sheet.visible = visible
        self._line.points = NOTHING

    async def _drag(self, event: SceneNodeDragEvent[Any]) -> None:
        """Take a step of a stroke; awaited one after the other, as threads of viser's may change their order."""
        eye, pointer = vector(event.client.camera.position, 3), vector(event.end_position, 3)
        point = None if eye is None or pointer is None else self._under(eye, pointer)
        if event.phase == "start":
            self._stroke = []
        now_s = time.monotonic()
        if point is not None and (not self._stroke or now_s > self._stroke[-1][0]):
            self._stroke.append((now_s, point))
        points = np.array([point for _, point in self._stroke]).reshape(-1, 3)
        self._line.points = segments(points)
        if event.phase == "end":
            times_s = np.array([time_s for time_s, _ in self._stroke])
            self._on_stroke(times_s, points, event.client_id)

    def _under(self, eye: Floats, pointer: Floats) -> Floats | None:
        """Return the point of the sheet [m] on the ray from an eye through the pointer, None if it goes past."""
        ray = pointer - eye
        along = float(ray @ self._normal)
        if abs(along) < 1e-9:
            return None
        point: Floats = eye + ray * (float((self._centre - eye) @ self._normal) / along)
        aside = np.abs(point - self._centre)
        return point if aside.max() <= _SHEET_M else None
