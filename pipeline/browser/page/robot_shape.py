"""The robot on the page: the shapes of its URDF, moved by its joints."""

import numpy as np
import pinocchio
from viser import BatchedMeshHandle, ViserServer

from pipeline.arrays import Floats
from pipeline.browser.page.solids import SOLIDS
from pipeline.robot.config import RobotConfig
from pipeline.robot.pinocchio_model import build_model, build_shapes, joint_index
from pipeline.rotations import quaternions_of_matrices, unit
from pipeline.urdf.description import canonical

_W_FIRST = [3, 0, 1, 2]


class RobotShape:
    """Shapes of a robot in a scene, all boxes as one element of it, all cylinders and all spheres.

    Each takes one call to draw and two messages to move, however many shapes the robot has.

    Parameters
    ----------
    server : ViserServer
        The page.
    robot : RobotConfig
        The robot; its meshes, if it has any, are not shown.
    """

    def __init__(self, server: ViserServer, robot: RobotConfig) -> None:
        urdf = canonical(robot.urdf_text)
        self._model = build_model(urdf)
        self._data = self._model.createData()
        self._shapes = build_shapes(self._model, urdf)
        self._placements = self._shapes.createData()
        self._q: Floats = pinocchio.neutral(self._model)
        self._idx_q = [self._model.joints[joint_index(self._model, name)].idx_q for name in robot.joints]
        self._batches: list[tuple[list[int], BatchedMeshHandle]] = []
        shapes = list(self._shapes.geometryObjects)
        positions, turns = self._poses(robot.comfort)
        for kind, solid in SOLIDS.items():
            places = [place for place, shape in enumerate(shapes) if type(shape.geometry).__name__ == kind]
            if places:
                colours = np.array([shapes[place].meshColor[:3] for place in places])
                batch = server.scene.add_batched_meshes_simple(
                    f"/robot/{kind.lower()}",
                    solid.vertices,
                    solid.faces,
                    turns[places],
                    positions[places],
                    batched_scales=np.array([solid.size(shapes[place].geometry) for place in places]),
                    batched_colors=(255.0 * colours).round().astype(np.uint8),
                    lod="off",
                    cast_shadow=False,
                    receive_shadow=False,
                )
                self._batches.append((places, batch))

    def show(self, q: Floats) -> None:
        """Show a posture (n,) [rad or m]; joints that are none of the robot's config stay as they are."""
        positions, turns = self._poses(q)
        for places, batch in self._batches:
            batch.batched_positions = positions[places].astype(np.float32)
            batch.batched_wxyzs = turns[places].astype(np.float32)

    def _poses(self, q: Floats) -> tuple[Floats, Floats]:
        """Return the positions of all shapes [m], shape (shapes, 3), and their turns w, x, y, z, shape (shapes, 4)."""
        self._q[self._idx_q] = q
        pinocchio.updateGeometryPlacements(self._model, self._data, self._shapes, self._placements, self._q)
        poses = np.array([pose.homogeneous for pose in self._placements.oMg]).reshape(-1, 4, 4)
        return poses[:, :3, 3], unit(quaternions_of_matrices(poses[:, :3, :3]))[:, _W_FIRST]
