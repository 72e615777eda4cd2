"""Size of a robot and types of its joints, from its URDF alone."""

import math
from xml.etree import ElementTree

from pipeline.robot.config import RobotConfig
from pipeline.urdf.description import end_link, named, parse_urdf

SLIDING = "prismatic"


def joint_types(robot: RobotConfig) -> dict[str, str]:
    """Return the URDF's type of every joint of the robot, such as `revolute` or `prismatic`, by name."""
    joints = named(parse_urdf(robot.urdf_text), "joint")
    return {name: joints[name].get("type", "") for name in robot.joints if name in joints}


def chain_length_m(robot: RobotConfig) -> float:
    """Return the length of the longer chain of links from the root to a hand, with all that slides drawn out [m]."""
    joints = named(parse_urdf(robot.urdf_text), "joint").values()
    held_by = {end_link(joint, "child"): joint for joint in joints}
    return max(_length_m(held_by, hand) for hand in (robot.left_hand, robot.right_hand))


def _length_m(held_by: dict[str, ElementTree.Element], link: str) -> float:
    length = 0.0
    while (joint := held_by.get(link)) is not None:
        origin, limit = joint.find("origin"), joint.find("limit")
        length += math.hypot(*map(float, ("0" if origin is None else origin.get("xyz", "0")).split()))
        if joint.get("type") == SLIDING and limit is not None:
            length += max(abs(float(limit.get(end, "0"))) for end in ("lower", "upper"))
        link = end_link(joint, "parent")
    return length
