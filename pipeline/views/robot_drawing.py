"""Pictures of a robot's postures: the shapes of its URDF, shaded, from back to front, by matplotlib alone."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from pipeline.robot.pinocchio_model import build_model, build_shapes, joint_index
from pipeline.urdf.description import canonical

_ROUND = 18  # corners of a circle
_RINGS = 8  # of a sphere
_CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
_LIGHT = np.array([0.3, 0.35, 0.89])  # to the right of and above the spectator, in their axes: right, up, towards them
_SHADE = 0.55  # brightness of a face that the light does not reach


@dataclass(frozen=True, eq=False)
class View:
    """Direction from which a robot is looked at, from far away.

    Attributes
    ----------
    azimuth_deg, elevation_deg : float
        Direction of the spectator as the robot sees it, to its left and up; 0, 0 is ahead.
    """

    azimuth_deg: float = 30.0
    elevation_deg: float = 12.0

    def axes(self, robot: RobotConfig) -> Floats:
        """Right, up and towards the spectator as unit vectors of the world, the rows of a (3, 3)."""
        azimuth, elevation = np.radians([self.azimuth_deg, self.elevation_deg])
        left, up = robot.lateral, robot.up
        ahead = np.cross(left, up)
        level = np.cos(azimuth) * ahead + np.sin(azimuth) * left
        towards = np.cos(elevation) * level + np.sin(elevation) * up
        right = np.cross(up, level)
        return np.stack([right, np.cross(towards, right), towards])


class RobotDrawing:
    """Draws a robot of boxes, cylinders and spheres at given postures.

    Parameters
    ----------
    robot : RobotConfig
        The robot; its meshes, if it has any, are not drawn.
    """

    def __init__(self, robot: RobotConfig) -> None:
        self._robot = robot
        urdf = canonical(robot.urdf_text)
        self._model = build_model(urdf)
        self._data = self._model.createData()
        self._geometry = build_shapes(self._model, urdf)
        self._placements = self._geometry.createData()
        self._faces = [_faces(shape.geometry) for shape in self._geometry.geometryObjects]
        self._idx_q = [self._model.joints[joint_index(self._model, name)].idx_q for name in robot.joints]

    def draw(self, axes: Axes, q: ArrayLike, *, view: View = View(), offset_cm: tuple[float, float] = (0, 0)) -> None:
        """Draw the robot at posture `q` (n,), in cm right of and above where the axes' origin is seen.

        Parameters
        ----------
        axes : Axes
            What to draw on.
        q : array, shape (n,)
            The posture [rad or m].
        view : View
            From where to look.
        offset_cm : tuple of float
            How far to the right and up the picture is moved [cm].
        """
        X_VW = view.axes(self._robot)
        drawn: list[tuple[float, Floats, Floats]] = []  # depth, outline (k, 2), colour (3,)
        for faces, colour in self._placed(q):
            for corners in faces:
                seen = corners @ X_VW.T
                normal = np.cross(seen[1] - seen[0], seen[2] - seen[0])
                if normal[2] > 0.0:  # it faces the spectator
                    light = max(0.0, float(normal @ _LIGHT) / float(np.linalg.norm(normal)))
                    drawn.append((float(seen[:, 2].mean()), seen[:, :2], (_SHADE + (1.0 - _SHADE) * light) * colour))
        drawn.sort(key=lambda face: face[0])
        outlines = [100.0 * outline + offset_cm for _, outline, _ in drawn]
        colours = np.array([colour for *_, colour in drawn])
        axes.add_collection(PolyCollection(outlines, facecolors=colours, edgecolors=colours, linewidths=0.3))

    def _placed(self, q: ArrayLike) -> list[tuple[list[Floats], Floats]]:
        """Faces of each shape where the posture puts them [m, world frame], and its colour."""
        posture: Floats = pinocchio.neutral(self._model)
        posture[self._idx_q] = q
        pinocchio.forwardKinematics(self._model, self._data, posture)
        pinocchio.updateGeometryPlacements(self._model, self._data, self._geometry, self._placements)
        return [
            ([corners @ X_WS.rotation.T + X_WS.translation for corners in faces], np.array(shape.meshColor[:3]))
            for faces, shape, X_WS in zip(
                self._faces, self._geometry.geometryObjects, self._placements.oMg, strict=True
            )
        ]


def _faces(shape: Any) -> list[Floats]:
    """Faces of a shape in its own frame [m], each (k, 3), corners anticlockwise from outside; none of a mesh."""
    kind = type(shape).__name__
    if kind == "Box":
        return _box(np.asarray(shape.halfSide))
    if kind == "Cylinder":
        radius, half = shape.radius, shape.halfLength
        return _turned([(0.0, -half), (radius, -half), (radius, half), (0.0, half)])
    if kind == "Sphere":
        angles = np.linspace(-np.pi / 2.0, np.pi / 2.0, _RINGS + 1)
        return _turned([(shape.radius * np.cos(angle), shape.radius * np.sin(angle)) for angle in angles])
    return []


def _box(half: Floats) -> list[Floats]:
    faces = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            face = np.empty((4, 3))
            face[:, axis] = sign
            face[:, [(axis + 1) % 3, (axis + 2) % 3]] = _CORNERS if sign > 0.0 else _CORNERS[::-1]
            faces.append(face * half)
    return faces


def _turned(profile: list[tuple[float, float]]) -> list[Floats]:
    """Faces of the body that a profile of (radius, height) makes when it turns about z, from the bottom up."""
    angles = np.linspace(0.0, 2.0 * np.pi, _ROUND + 1)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    faces = []
    for (radius, height), (next_radius, next_height) in pairwise(profile):
        below = np.column_stack([radius * circle, np.full(_ROUND + 1, height)])
        above = np.column_stack([next_radius * circle, np.full(_ROUND + 1, next_height)])
        if radius < 1e-9:
            faces.append(above[:0:-1])
        elif next_radius < 1e-9:
            faces.append(below[:-1])
        else:
            faces += [np.stack([below[i], below[i + 1], above[i + 1], above[i]]) for i in range(_ROUND)]
    return faces
