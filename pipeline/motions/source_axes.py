"""Axes of a source of paths, as a person names them, in the robot's world."""

import numpy as np

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from recorders.errors import ConfigError

_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def source_axes(plane: tuple[str, str]) -> Floats:
    """Return the source's axes that are the robot's left, up, and their normal, by row, shape (3, 3).

    Raises
    ------
    ConfigError
        The two are not different axes, each x, y or z with or without a minus sign.
    """
    names = [axis.removeprefix("-") for axis in plane]
    if len(set(names)) != 2 or not set(names) <= set(_AXES):
        raise ConfigError(f"plane: expected two different axes, such as -x and y, found {','.join(plane):.40}")
    left, up = (np.array(_AXES[name]) * (1 - 2 * (axis != name)) for axis, name in zip(plane, names, strict=True))
    return np.stack([left, up, np.cross(left, up)])


def robot_plane(robot: RobotConfig) -> Floats:
    """Return the robot's left, up, and their normal, by row, shape (3, 3)."""
    return np.stack([robot.lateral, robot.up, np.cross(robot.lateral, robot.up)])


def world_axes(robot: RobotConfig, plane: tuple[str, str] | None) -> Floats:
    """Return the axes of a source, by column, in the robot's world, shape (3, 3); without a plane they are the same."""
    return np.eye(3) if plane is None else robot_plane(robot).T @ source_axes(plane)
