"""Distances between a robot's own parts, and how they change with the joints, by Drake's collision checker."""

from copy import deepcopy
from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
from pydrake.multibody.tree import BodyIndex
from pydrake.planning import RobotDiagramBuilder, SceneGraphCollisionChecker

from pipeline.arrays import Floats
from pipeline.collision.self_distance import NEIGHBOURS_M, SelfDistance
from pipeline.robot.config import RobotConfig
from pipeline.urdf.description import WORLD, canonical, root_link
from pipeline.urdf.model_names import for_libraries, joint_name, link_name

_EDGE_STEP = 0.1  # of motions that are checked at once; none are


class PartDistances:
    """Distances of the pairs of links that `SelfDistance` compares, between what is seen of them in the URDF.

    Links of which any shapes are nearer than `NEIGHBOURS_M` in the comfort posture are built so, and left out.

    Parameters
    ----------
    robot : RobotConfig
        The robot; postures have the order of its joints. Links without shapes have no distances.
    """

    def __init__(self, robot: RobotConfig) -> None:
        urdf = canonical(robot.urdf_text)
        builder = RobotDiagramBuilder(time_step=0.0)
        text = tostring(_with_collision_shapes(for_libraries(urdf)), encoding="unicode")
        (model,) = builder.parser().AddModelsFromString(text, "urdf")
        plant = builder.plant()
        if (root := root_link(urdf)) != WORLD:
            plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(link_name(root)))
        plant.Finalize()
        checker: Any = SceneGraphCollisionChecker  # Any: its stub does not know its arguments
        self._checker = checker(model=builder.Build(), robot_model_instances=[model], edge_step_size=_EDGE_STEP)
        joints = [plant.GetJointByName(joint_name(name)) for name in robot.joints]
        self._idx_q = np.array([joint.position_start() for joint in joints])
        self._q = np.zeros(plant.num_positions())
        self._leave_out_all_but(SelfDistance(robot).link_pairs)
        self._leave_out_neighbours(robot.comfort)

    def near(self, q: Floats, *, within_m: float) -> tuple[Floats, Floats]:
        """Return the distances [m] (pairs,) of the shapes that are within a distance, and their slopes (pairs, n)."""
        found = self._clearance(q, within_m)
        slopes: Floats = found.jacobians()[:, self._idx_q]
        return found.distances(), slopes

    def least(self, q: Floats, *, within_m: float) -> float:
        """Return the smallest of the distances [m], or `within_m`, which is 0 at least, if none is below it."""
        return float(min(self.near(q, within_m=within_m)[0], default=within_m))

    def _clearance(self, q: Floats, within_m: float) -> Any:
        self._q[self._idx_q] = q
        return self._checker.CalcRobotClearance(self._q, within_m)

    def _leave_out_neighbours(self, comfort: Floats) -> None:
        found = self._clearance(comfort, NEIGHBOURS_M)
        matrix = self._checker.GetFilteredCollisionMatrix().copy()
        for distance_m, one, other in zip(found.distances(), found.robot_indices(), found.other_indices(), strict=True):
            if distance_m < NEIGHBOURS_M:
                matrix[int(one), int(other)] = matrix[int(other), int(one)] = 1
        self._checker.SetCollisionFilterMatrix(matrix)

    def _leave_out_all_but(self, pairs: set[frozenset[str]]) -> None:
        plant = self._checker.plant()
        wanted = {frozenset(map(link_name, pair)) for pair in pairs}
        names = [plant.get_body(BodyIndex(index)).name() for index in range(plant.num_bodies())]
        matrix = self._checker.GetFilteredCollisionMatrix().copy()
        for one in range(len(names)):
            for other in range(len(names)):
                if matrix[one, other] == 0 and frozenset((names[one], names[other])) not in wanted:
                    matrix[one, other] = 1
        self._checker.SetCollisionFilterMatrix(matrix)


def _with_collision_shapes(urdf: Element) -> Element:
    """Turn what is seen of the links into what collides, in place, and return it."""
    for link in urdf.iterfind("link"):
        for old in link.findall("collision"):
            link.remove(old)
        for seen in link.findall("visual"):
            shape = SubElement(link, "collision")
            shape.extend(deepcopy([part for part in seen if part.tag in ("origin", "geometry")]))
            link.remove(seen)
    return urdf
