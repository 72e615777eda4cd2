"""The robot on the page: its visual shapes, moved by its joints."""

import io
import logging
import warnings
from xml.etree import ElementTree

import numpy as np
import yourdfpy
from viser import ViserServer
from viser.extras import ViserUrdf

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from pipeline.urdf.description import canonical

_NOWHERE = "/nonexistent/mesh"  # meshes are files, and a robot's description may come from anyone


class RobotShape:
    """Shapes of a robot in a scene; meshes, which are files of somewhere else, are left out.

    Parameters
    ----------
    server : ViserServer
        The page.
    robot : RobotConfig
        The robot.

    Attributes
    ----------
    meshes : int
        How many meshes are left out.
    """

    def __init__(self, server: ViserServer, robot: RobotConfig) -> None:
        self._robot = robot
        self.meshes = 0
        logging.getLogger("yourdfpy.urdf").setLevel(logging.CRITICAL)  # a line for every mesh
        text = ElementTree.tostring(canonical(robot.urdf_text))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            urdf = yourdfpy.URDF.load(
                io.BytesIO(text),
                build_collision_scene_graph=False,
                load_collision_meshes=False,
                filename_handler=self._leave_out,
            )
            self._shape = ViserUrdf(server, urdf, root_node_name="/robot")
        places = {name: place for place, name in enumerate(robot.joints)}
        self._places = [places.get(name, -1) for name in urdf.actuated_joint_names]

    def show(self, q: Floats) -> None:
        """Show a posture (n,) [rad or m]; joints that are none of the robot's config stay at 0."""
        self._shape.update_cfg(np.append(q, 0.0)[self._places])

    def _leave_out(self, fname: str, **_options: object) -> str:
        self.meshes += 1
        return _NOWHERE
