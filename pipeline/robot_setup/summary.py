"""What was found of a new robot, as a table or JSON shows it."""

from typing import Any

from pipeline.robot_setup.moved_hands import moved_hands
from pipeline.robot_setup.new_robot import NewRobot


def summary(made: NewRobot) -> dict[str, Any]:
    """Return joints, hands, rigid joints and all else that was found, in plain values."""
    config, freedom = made.config, made.freedom
    moved = moved_hands(config)
    joints = [
        {
            "joint": joint.name,
            "type": joint.type,
            "lower": joint.limits.lower,
            "upper": joint.limits.upper,
            "velocity": joint.limits.velocity,
            "effort": joint.limits.effort,
            "limits": _origin(joint.given is not None, joint.assumed),
            "comfort": float(comfort),
            "hands": [hand for hand, moves in zip(config.hand_names, moving, strict=True) if moves],
        }
        for joint, comfort, moving in zip(made.joints, config.comfort, moved, strict=True)
    ]
    hands = [
        {
            "hand": hand.name,
            "link": hand.link,
            "controls": hand.controls,
            "centre": list(hand.centre),
            "box": list(hand.box),
            "reach": float(radius),
            "freedom": float(free),
        }
        for hand, radius, free in zip(config.hands, made.reach.radii, freedom, strict=True)
    ]
    rigid = {name: f"rigid at {value:g}" for name, value in made.source.frozen}
    return {"robot": config.name, "joints": joints, "hands": hands, "rigid": rigid, "samples": len(made.reach.hands)}


def _origin(given: bool, assumed: tuple[str, ...]) -> str:
    """Return where a joint's limits come from."""
    if assumed:
        return f"{' and '.join(assumed)} assumed"
    return "option" if given else "URDF"
