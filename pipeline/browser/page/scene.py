"""The scene: robot, handles and halos of its hands, and the paths that were asked for and reached."""

from collections.abc import Callable

import numpy as np
from viser import CameraHandle, TransformControlsEvent, TransformControlsHandle, ViserServer

from pipeline.arrays import Floats
from pipeline.browser.page.colours import ASKED, hand_colour
from pipeline.browser.page.robot_shape import RobotShape
from pipeline.browser.page.segments import NOTHING, segments
from pipeline.browser.page.sent import vector
from pipeline.browser.session.drive import Mode, Snapshot
from pipeline.robot.config import RobotConfig
from pipeline.robot.coordinates import POSITION_SIZE, row_size

HALO = 10.0
"""So many times the deviation that a controller expects is the radius of a hand's halo: fractions of a millimetre are
none that one sees."""

_HANDLE_M = 0.16
_LEAST_HALO_M, _MOST_HALO_M = 0.02, 0.3
_MOVED_M = 1e-4
_FLOOR_M, _CELL_M = 2.0, 0.25  # half of a side
_METRE, _CELL = np.array([150, 150, 150]), np.array([205, 205, 205])
_EVERY = 2  # of the points of a path is shown

Moved = Callable[[int, Floats, int], bool]
"""Takes a hand's place, the row that is wanted and the visitor; False if that visitor may not."""


class Scene:
    """The robot and what is shown about its hands.

    Parameters
    ----------
    server : ViserServer
        The page.
    robot : RobotConfig
        The robot.
    on_move : callable
        Takes what a visitor wants of a hand.
    """

    def __init__(self, server: ViserServer, robot: RobotConfig, *, on_move: Moved) -> None:
        self._server, self._robot, self._on_move = server, robot, on_move
        self._place_camera()
        _light(server)
        _floor(server)
        self.shape = RobotShape(server, robot)
        self._dragged: set[int] = set()
        self._rows: list[Floats] = [np.full(row_size(robot), np.nan)] * len(robot.hands)
        self._handles = [self._handle(place) for place in range(len(robot.hands))]
        self._halos = [
            server.scene.add_icosphere(
                f"/hands/{name}/halo", radius=1.0, color=hand_colour(place), opacity=0.25, cast_shadow=False, scale=0.02
            )
            for place, name in enumerate(robot.hand_names)
        ]
        self._asked, self._reached = (
            [
                server.scene.add_line_segments(
                    f"/hands/{name}/{kind}",
                    NOTHING,
                    colour or hand_colour(place),
                    thickness=width,
                    thickness_units="screen",
                )
                for place, name in enumerate(robot.hand_names)
            ]
            for kind, colour, width in (("asked", ASKED, 2.0), ("reached", None, 3.0))
        )

    def show(self, snapshot: Snapshot, deviations_m: Floats | None) -> None:
        """Show the robot and its hands as they are."""
        with self._server.atomic():
            self.shape.show(snapshot.q)
            rows = snapshot.wanted if snapshot.mode is Mode.HANDLES else snapshot.targets
            for place, row in enumerate(rows):
                self._place(place, row)
            for place, halo in enumerate(self._halos):
                halo.position = snapshot.hands[place, :POSITION_SIZE]
                halo.scale = _radius_m(None if deviations_m is None else float(deviations_m[place]))
        self._server.flush()  # now: it would wait for more, for a sixtieth of a second

    def show_paths(self, asked: Floats, reached: Floats) -> None:
        """Show the last positions of all hands [m], shapes (T, hands, 3)."""
        for handles, path in ((self._asked, asked), (self._reached, reached)):
            for place, handle in enumerate(handles):
                handle.points = segments(path[::_EVERY, place])

    def show_handles(self, visible: bool) -> None:
        """Show or hide the handles."""
        for handle in self._handles:
            handle.visible = visible

    def fit(self, camera: CameraHandle) -> None:
        """Move the camera of a visitor whose screen is higher than wide, so that the hands are above the panel."""
        if camera.aspect < 1.0:
            away = self._eye - self._middle
            camera.position = self._middle + away / camera.aspect**0.5
            camera.look_at = self._middle - 0.55 * float(np.linalg.norm(away)) * self._robot.up

    def handle_position(self, place: int) -> Floats:
        """Return where a handle is [m], shape (3,)."""
        return np.asarray(self._handles[place].position)

    def _place_camera(self) -> None:
        """Look at the hands from before the robot and a little above, from as far as they are spread."""
        robot = self._robot
        middle = robot.centres.mean(axis=0)
        ahead = np.cross(robot.lateral, robot.up)
        if float(ahead @ middle) < 0.0:
            ahead = -ahead
        spread = float(np.abs(robot.centres - middle).max() + robot.boxes.max())
        self._eye = middle + max(1.0, 3.2 * spread) * (ahead + 0.25 * robot.lateral + 0.25 * robot.up)
        self._middle = middle + 0.25 * spread * robot.up
        camera = self._server.initial_camera
        camera.position, camera.look_at = tuple(self._eye), tuple(self._middle)

    def _handle(self, place: int) -> TransformControlsHandle:
        hand = self._robot.hands[place]
        handle = self._server.scene.add_transform_controls(
            f"/handles/{hand.name}",
            scale=_HANDLE_M,
            disable_rotations=hand.orientation is None,
            depth_test=False,
            position=hand.centre,
        )
        self._server.scene.add_label(f"/handles/{hand.name}/name", hand.name)

        async def on_drag(event: TransformControlsEvent) -> None:
            """Pass on what a visitor does to the handle; awaited, as threads of viser's may change the order."""
            if event.phase == "end":
                self._dragged.discard(place)
            else:
                self._dragged.add(place)
            row = self._row(place)
            if row is not None and event.client_id is not None and self._on_move(place, row, event.client_id):
                self._rows[place] = row
            else:
                self._dragged.discard(place)
                self._rows[place] = np.full(row_size(self._robot), np.nan)  # so that it is put back where it belongs

        handle.on_update(on_drag)
        return handle

    def _row(self, place: int) -> Floats | None:
        """Return where a handle is, by row; None where what a visitor sent is no pose."""
        handle = self._handles[place]
        position, turn = vector(handle.position, POSITION_SIZE), vector(handle.wxyz, 4)
        if position is None or turn is None:
            return None
        return np.array([*position, *turn[1:], turn[0]])[: row_size(self._robot)]

    def _place(self, place: int, row: Floats) -> None:
        """Put a handle where its hand is wanted, unless somebody holds it."""
        if place in self._dragged or np.abs(self._rows[place] - row).max() <= _MOVED_M:
            return
        self._rows[place] = row
        handle = self._handles[place]
        handle.position = row[:POSITION_SIZE]
        if self._robot.hands[place].orientation is not None:
            x, y, z, w = row[POSITION_SIZE:]
            handle.wxyz = (w, x, y, z)


def _light(server: ViserServer) -> None:
    """Light the scene without shadows and reflections, which take a machine without a GPU a second for each picture."""
    server.scene.configure_environment_map(None)
    server.scene.configure_default_lights(cast_shadow=False)
    server.scene.add_light_hemisphere("/light", intensity=2.5)


def _floor(server: ViserServer) -> None:
    """Draw a grid on the floor, of lines: viser's own is a surface, each point of which is computed."""
    places = np.arange(-_FLOOR_M, _FLOOR_M + 0.5 * _CELL_M, _CELL_M)
    ends = np.array([-_FLOOR_M, _FLOOR_M])
    lines = np.zeros((2, len(places), 2, 3))
    lines[0, :, :, 0] = lines[1, :, :, 1] = places[:, np.newaxis]
    lines[0, :, :, 1] = lines[1, :, :, 0] = ends
    whole = places % 1.0 == 0.0
    colours = np.where(whole[:, np.newaxis, np.newaxis], _METRE, _CELL).astype(np.uint8)
    server.scene.add_line_segments(
        "/floor",
        lines.reshape(-1, 2, 3).astype(np.float32),
        np.broadcast_to(colours, (2, len(places), 2, 3)).reshape(-1, 2, 3),
        thickness=1.0,
        thickness_units="screen",
    )


def _radius_m(deviation_m: float | None) -> float:
    """Return the radius of a halo [m]."""
    if deviation_m is None:
        return _LEAST_HALO_M
    return float(min(max(_LEAST_HALO_M, HALO * deviation_m), _MOST_HALO_M))
