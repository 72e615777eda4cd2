"""Smallest distance between a robot's own parts, on the primitive shapes of its URDF."""

import math
from itertools import combinations
from typing import Any, NamedTuple

import coal
import numpy as np
import pinocchio
from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from pipeline.robot.pinocchio_model import build_model, build_shapes, joint_index, link_frame
from pipeline.urdf.description import canonical

CLEARANCE_M = 0.03
"""Distance that an exploration keeps between a robot's parts."""

NEIGHBOURS_M = 0.05
"""Parts nearer than this in the comfort posture are built so."""

_CAPSULE_RADIUS_M = 0.03  # of a link without shapes
_SHORTEST_M = 0.01  # bones below this have no capsule


class Nearest(NamedTuple):
    """The two parts of a robot that are nearest to one another.

    Attributes
    ----------
    distance_m : float
        Their distance [m]; below 0 they are in each other.
    first, second : str
        The links that they belong to.
    """

    distance_m: float
    first: str
    second: str


NOTHING_NEAR = Nearest(math.inf, "", "")
"""Nothing at any distance."""


class SelfDistance:
    """Distances of a robot's hands and forearms from everything else of it, as functions of the posture.

    Those are the parts that the outer half of an arm's joints move; an arm's joints move one hand and no other. They
    are not compared with their own arm, which its joints' limits see to, unless the robot is a single arm. Parts that
    are nearer than `NEIGHBOURS_M` in the comfort posture are neighbours, and left out as well. A joint without a shape
    is taken as a capsule to the next.

    Parameters
    ----------
    robot : RobotConfig
        The robot; postures have the order of its joints.
    """

    def __init__(self, robot: RobotConfig) -> None:
        urdf = canonical(robot.urdf_text)
        self._model = build_model(urdf)
        self._data = self._model.createData()
        shapes = build_shapes(self._model, urdf)
        _add_capsules(self._model, shapes)
        self._shapes = [_Shape.of(self._model, shape) for shape in shapes.geometryObjects]
        self._idx_q = np.array([self._model.joints[joint_index(self._model, name)].idx_q for name in robot.joints])
        self._q: Floats = pinocchio.neutral(self._model)
        self._offsets = np.array([shape.centre for shape in self._shapes]).reshape(-1, 3)
        self._radii = np.array([shape.radius for shape in self._shapes])
        self._joints = np.array([shape.joint for shape in self._shapes], dtype=np.intp)
        self._first, self._second = self._pairs(robot)

    @property
    def pairs(self) -> int:
        """Number of pairs of shapes that are checked; without any, nothing is."""
        return len(self._first)

    @property
    def link_pairs(self) -> set[frozenset[str]]:
        """Pairs of links whose shapes are checked."""
        links = [shape.link for shape in self._shapes]
        return {frozenset((links[one], links[other])) for one, other in zip(self._first, self._second, strict=True)}

    def nearest(self, q: ArrayLike, *, below: Nearest = NOTHING_NEAR) -> Nearest:
        """Return the nearest pair at posture `q` (n,) [rad or m] that is nearer than `below`; else `below` itself."""
        best = below
        placements = self._placements(q)
        gaps = self._gaps(placements, self._first, self._second)
        candidates = np.flatnonzero(gaps < best.distance_m)
        for pair in candidates[np.argsort(gaps[candidates], kind="stable")].tolist():
            if gaps[pair] >= best.distance_m:
                break
            first, second = int(self._first[pair]), int(self._second[pair])
            distance = self._distance(placements, first, second)
            if distance < best.distance_m:
                best = Nearest(distance, self._shapes[first].link, self._shapes[second].link)
        return best

    def _pairs(self, robot: RobotConfig) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
        """Return the indices of the shapes of each checked pair, shape (pairs,) both."""
        arms = _arms(self._model, [hand.link for hand in robot.hands])
        outer = {joint for arm in arms for joint in arm[(len(arm) + 1) // 2 :]}
        own = [set(arm) if len(arms) > 1 else outer for arm in arms]
        placements = self._placements(robot.comfort)
        pairs = [
            (first, second)
            for first, second in combinations(range(len(self._shapes)), 2)
            if (joints := {int(self._joints[first]), int(self._joints[second])}) & outer
            and not any(joints <= arm for arm in own)
            and not self._adjacent(first, second)
            and self._distance(placements, first, second) >= NEIGHBOURS_M
        ]
        found = np.array(pairs, dtype=np.intp).reshape(-1, 2)
        return found[:, 0], found[:, 1]

    def _adjacent(self, first: int, second: int) -> bool:
        """Return whether two shapes are on one joint, or on a joint and the next."""
        one, other = int(self._joints[first]), int(self._joints[second])
        return one == other or self._model.parents[one] == other or self._model.parents[other] == one

    def _placements(self, q: ArrayLike) -> list[Any]:
        self._q[self._idx_q] = np.asarray(q, dtype=np.float64)
        pinocchio.forwardKinematics(self._model, self._data, self._q)
        return list(self._data.oMi)

    def _gaps(self, placements: list[Any], first: Any, second: Any) -> Floats:
        """Lower bounds of the distances [m] of pairs, by the balls about the shapes."""
        rotations = np.array([placement.rotation for placement in placements])[self._joints]
        origins = np.array([placement.translation for placement in placements])[self._joints]
        centres = origins + np.einsum("sij,sj->si", rotations, self._offsets)
        apart = np.linalg.norm(centres[first] - centres[second], axis=1)
        gaps: Floats = apart - self._radii[first] - self._radii[second]
        return gaps

    def _distance(self, placements: list[Any], first: int, second: int) -> float:
        one, other = self._shapes[first], self._shapes[second]
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        return float(
            coal.distance(
                one.geometry,
                coal.Transform3s(*_pose(placements[one.joint] * one.placement)),
                other.geometry,
                coal.Transform3s(*_pose(placements[other.joint] * other.placement)),
                request,
                result,
            )
        )


class _Shape(NamedTuple):
    """A shape on a joint: its pose there, and the ball about it, centre [m] in the joint's frame and radius [m]."""

    geometry: Any
    joint: int
    link: str
    placement: Any
    centre: Floats
    radius: float

    @classmethod
    def of(cls, model: Any, shape: Any) -> "_Shape":
        geometry = shape.geometry
        geometry.computeLocalAABB()
        centre = shape.placement.act(np.asarray(geometry.aabb_center))
        link = str(model.frames[shape.parentFrame].name).removeprefix("link ")
        return cls(geometry, int(shape.parentJoint), link, shape.placement, centre, float(geometry.aabb_radius))


def _pose(placement: Any) -> tuple[Any, Any]:
    return placement.rotation, placement.translation


def _arms(model: Any, hands: list[str]) -> list[list[int]]:
    """Return the joints that move each hand and no other, from the body outwards; with a single hand, all of them."""
    chains = [[j for j in model.supports[model.frames[link_frame(model, hand)].parentJoint] if j] for hand in hands]
    return [[joint for joint in chain if sum(joint in other for other in chains) == 1] for chain in chains]


def _add_capsules(model: Any, shapes: Any) -> None:
    """Add a capsule from every joint that has no shape to each joint that it carries."""
    shaped = {int(shape.parentJoint) for shape in shapes.geometryObjects}
    for joint in range(1, model.njoints):
        parent = int(model.parents[joint])
        end = np.asarray(model.jointPlacements[joint].translation)
        if parent == 0 or parent in shaped or np.linalg.norm(end) < _SHORTEST_M:
            continue
        length = float(np.linalg.norm(end))
        along = pinocchio.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end).toRotationMatrix()
        pose = pinocchio.SE3(along, end / 2.0)
        name = f"{model.names[parent]} to {model.names[joint]}"
        frame = int(model.getFrameId(model.names[parent]))
        capsule = coal.Capsule(_CAPSULE_RADIUS_M, length)
        shapes.addGeometryObject(pinocchio.GeometryObject(name, parent, frame, pose, capsule))
