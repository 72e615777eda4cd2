"""Size of a robot, types of its joints, and which of them move which hand, from its URDF alone."""

import math
from xml.etree import ElementTree

from pipeline.robot.config import RobotConfig
from pipeline.urdf.description import end_link, named, parse_urdf

SLIDING = "prismatic"


def joint_types(robot: RobotConfig) -> dict[str, str]:
    """Return the URDF's type of every joint of the robot, such as `revolute` or `prismatic`, by name."""
    joints = named(parse_urdf(robot.urdf_text), "joint")
    return {name: joints[name].get("type", "") for name in robot.joints if name in joints}


def joint_units(robot: RobotConfig) -> dict[str, str]:
    """Return the unit of each joint's position, by name: m where it slides, rad where it turns."""
    return {name: "m" if kind == SLIDING else "rad" for name, kind in joint_types(robot).items()}


def chain_length_m(robot: RobotConfig) -> float:
    """Return the length of the longest chain of links from the root to a hand, with all that slides drawn out [m]."""
    return max(_length_m(chain) for chain in hand_chains(robot))


def hand_joints(robot: RobotConfig) -> dict[str, tuple[int, ...]]:
    """Return the places in `robot.joints` of the joints between the ground and each hand, which move it, by hand."""
    chains = (frozenset(joint.get("name", "") for joint in chain) for chain in hand_chains(robot))
    return {
        hand: tuple(place for place, name in enumerate(robot.joints) if name in chain)
        for hand, chain in zip(robot.hand_names, chains, strict=True)
    }


def hand_chains(robot: RobotConfig) -> list[list[ElementTree.Element]]:
    """Return the joints from each hand to the root, fixed ones included, in the order of `robot.hands`."""
    joints = named(parse_urdf(robot.urdf_text), "joint").values()
    held_by = {end_link(joint, "child"): joint for joint in joints}
    chains = []
    for hand in robot.hands:
        chain, link = [], hand.link
        while (joint := held_by.get(link)) is not None:
            chain.append(joint)
            link = end_link(joint, "parent")
        chains.append(chain)
    return chains


def _length_m(chain: list[ElementTree.Element]) -> float:
    length = 0.0
    for joint in chain:
        origin, limit = joint.find("origin"), joint.find("limit")
        length += math.hypot(*map(float, ("0" if origin is None else origin.get("xyz", "0")).split()))
        if joint.get("type") == SLIDING and limit is not None:
            length += max(abs(float(limit.get(end, "0"))) for end in ("lower", "upper"))
    return length
