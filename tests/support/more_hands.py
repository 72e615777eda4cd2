"""Made-up robots with another number of hands than two, some of them asked for poses, as folders for `--robot`."""

from collections.abc import Collection
from pathlib import Path

import numpy as np

from pipeline.motions.motion import csv_columns, orientation_columns
from pipeline.robot.config import RobotConfig, load_robot
from pipeline.rotations import product, quaternions_of

THREE = ("left", "right", "third_arm")
ONE = ("tip",)

_ARM = ("yaw", "shoulder", "elbow")
_WRIST = ("roll", "pitch", "twist")  # of an arm whose hand is asked for poses
_COMFORT = {"turn": 0.0, "yaw": 0.0, "shoulder": 0.7, "elbow": -1.2, "roll": 0.0, "pitch": 0.4, "twist": 0.2}
_INERTIA = '<inertia ixx="0.004" ixy="0" ixz="0" iyy="0.004" iyz="0" izz="0.004"/>'
_SPREAD_M = 0.35  # from one shoulder to the next
_MIDDLE = (0.0, 0.0, 0.0998334166468282, 0.9950041652780258)  # turned to the left by 0.2 rad


def write_robot(folder: Path, hands: tuple[str, ...], *, poses: Collection[str] = ()) -> Path:
    """Write a robot that turns about its column, with an arm for each hand and nothing to look with.

    An arm has three joints, and three more in the wrist if its hand is one of those that are asked for `poses`.
    """
    folder.mkdir()
    sides = _SPREAD_M * ((len(hands) - 1) / 2 - np.arange(len(hands)))
    names = {hand: (*_ARM, *(_WRIST if hand in poses else ())) for hand in hands}
    joints = ["turn", *(f"{hand}_{name}" for hand in hands for name in names[hand])]
    links = [_link("world", 0.0), _link("column", 8.0), _joint("turn", "world", "column", "0 0 0.5", "0 0 1")]
    arms = (part for hand, side in zip(hands, sides, strict=True) for part in _arm(hand, side, names[hand]))
    urdf = "".join([*links, *arms, *map(_motor, joints)])
    (folder / "robot.urdf").write_text(f'<robot name="more">{urdf}</robot>')
    rows = ",\n".join(
        f'{{ name = "{name}", weight = {0.3 if name == "turn" else 1.0}, comfort = {_COMFORT[name.split("_")[-1]]} }}'
        for name in joints
    )
    table = "".join(
        f'[[hands]]\nname = "{hand}"\nlink = "{hand}_palm"\ncontrols = "{"pose" if hand in poses else "position"}"\n'
        f"centre = {[0.49, float(side), 0.75, *(_MIDDLE if hand in poses else ())]}\n"
        f"box = {[0.05, 0.1, 0.1, *((0.2, 0.2, 0.2) if hand in poses else ())]}\n"
        for hand, side in zip(hands, sides, strict=True)
    )
    (folder / "robot.toml").write_text(f'name = "more"\njoints = [\n{rows}\n]\n{table}')
    return folder


def write_motion(path: Path, folder: Path, *, samples: int = 8) -> Path:
    """Write small circles of all hands at 10 Hz, each from another angle; those asked for poses turn as they go."""
    robot: RobotConfig = load_robot(folder)
    middles = {hand.name: hand.orientation for hand in robot.hands if hand.orientation is not None}
    turned = [column for hand in middles for column in orientation_columns(hand)]
    rows = [",".join([*csv_columns(robot.hand_names), *turned])]
    for k in range(samples):
        angles = 2.0 * np.pi * k / samples + np.arange(len(robot.hands))
        offsets = 0.03 * np.stack([0.0 * angles, np.cos(angles), np.sin(angles)], axis=1)
        turn = quaternions_of(0.15 * np.sin([angles[0], 2.0 * angles[0], angles[0] + 1.0]))
        orientations = [part for middle in middles.values() for part in product(turn, middle).tolist()]
        positions = np.round(robot.centres + offsets, 6).ravel().tolist()
        rows.append(",".join(map(repr, [0.1 * k, *positions, *orientations])))
    path.write_text("\n".join(rows) + "\n")
    return path


def _arm(hand: str, side: float, names: tuple[str, ...]) -> list[str]:
    parents = ["column", *(f"{hand}_{name}_link" for name in names), f"{hand}_palm"]
    origins = (f"0 {side} 0.3", "0 0 0", "0.3 0 0", "0.2 0 0", "0.05 0 0", "0.05 0 0")
    axes = ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "0 0 1")
    links = [_link(link, 0.6) for link in parents[1:-1]] + [_link(parents[-1], 0.0)]
    joints = [_joint(f"{hand}_{name}", parents[k], parents[k + 1], origins[k], axes[k]) for k, name in enumerate(names)]
    reach = 0.3 if len(names) == len(_ARM) else 0.05
    palm = f'<joint name="{hand}_wrist" type="fixed"><origin xyz="{reach} 0 0"/><parent link="{parents[-2]}"/>'
    return [*links, *joints, f'{palm}<child link="{parents[-1]}"/></joint>']


def _link(name: str, mass: float) -> str:
    if not mass:
        return f'<link name="{name}"/>'
    return f'<link name="{name}"><inertial><origin xyz="0.1 0 0"/><mass value="{mass}"/>{_INERTIA}</inertial></link>'


def _joint(name: str, parent: str, child: str, xyz: str, axis: str) -> str:
    return (
        f'<joint name="{name}" type="revolute"><origin xyz="{xyz}"/><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="{axis}"/><limit lower="-1.9" upper="1.9" effort="80" velocity="6"/></joint>'
    )


def _motor(joint: str) -> str:
    return (
        f'<transmission name="{joint}_t"><type>transmission_interface/SimpleTransmission</type><joint name="{joint}">'
        "<hardwareInterface>hardware_interface/EffortJointInterface</hardwareInterface></joint>"
        f'<actuator name="{joint}_m"><mechanicalReduction>1</mechanicalReduction></actuator></transmission>'
    )
