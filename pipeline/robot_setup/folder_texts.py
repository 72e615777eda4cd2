"""Texts of a robot's folder, with comments: `robot.toml`, and `import.toml` for a model of others."""

import json
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from pipeline.arrays import Floats
from pipeline.robot.hands import POSE, POSITION
from pipeline.robot.importing.import_spec import JointLimits, RobotSource
from pipeline.robot.resolution import Resolution

STEPS = Resolution(positions=2.0**-20, velocities=2.0**-16, hands=2.0**-20, commands=2.0**-20, tf=2.0**-20)
"""Resolution of the robots that come with the program."""

TURN_RAD = 0.3
"""Half extent of the turns in which a hand whose pose is controlled is explored [rad]."""

AHEAD = "x"
"""Axis of the world along which a robot looks whose config does not say otherwise."""

LATERAL = {"x": (0.0, 1.0, 0.0), "y": (-1.0, 0.0, 0.0), "-x": (0.0, -1.0, 0.0), "-y": (1.0, 0.0, 0.0)}
"""What is to the left of a robot, as a unit vector of the world, by the axis along which it looks."""

_SHARED_WEIGHT = 0.4  # of joints that move several hands: so that the trunk takes part

_ROBOT = """\
# {joints} joints of {model}, and {hands}, as `reenact robot new` found them with seed {seed}.
# m, rad, world frame; the ground is at z = 0.
name = {name}

# The joints in the order of every posture. `comfort`: the posture to which the robot tends, found where the hands move
# freely in every direction, far from limits. `weight`: what leaving it costs, relative to the joint's range; below 0.5
# for joints that move several hands, else they hardly move.
joints = [
{rows}
]
{hand_tables}
# What the simulated robot's sensors measure and its motors take is a multiple of these, powers of two: the same numbers
# on every machine.
[resolution]
{steps}
{pattern}"""
_JOINT = "    {{ name = {name}, weight = {weight}, comfort = {comfort} }},"
_HAND = """
[[hands]]
name = {name}  # part of the topics /hand/NAME/target and /hand/NAME/measured
link = {link}  # its origin is the hand's position
controls = "{controls}"
centre = {centre}  # {middle}
box = {box}  # {extents}
"""
_PATTERN = """
# The plane in which the hands draw: to the left, as seen by a robot that looks along {ahead}, and up.
[pattern]
lateral = {lateral}
up = [0.0, 0.0, 1.0]
"""
_MIDDLE = "middle of its box and of what it draws: near where it is in the comfort posture"
_EXTENTS = "half extents in which targets are explored: within reach in every corner"
_TURNED = "; then its orientation there, a quaternion x, y, z, w"
_TURNS = "; then of its turn [rad]"
_IMPORT = """\
# How the robot's URDF is made from {model}: joints that robot.toml does not name are rigid, at 0 unless [frozen]
# names another posture; every joint gets a motor; meshes are dropped.
{drop}
[source]
{source}
{base}{frozen}{limits}"""


def robot_toml(
    *,
    name: str,
    model: str,
    joints: Sequence[tuple[str, int]],
    comfort: Floats,
    hands: Mapping[str, str],
    centres: Floats,
    box: Floats,
    seed: int,
    ahead: str = AHEAD,
    orientations: Floats | None = None,
) -> str:
    """Return the text of a `robot.toml`.

    Parameters
    ----------
    name, model : str
        Names of the robot, and of the model that it is made from.
    joints : sequence of (str, int)
        Its joints, and how many hands each moves.
    comfort : array, shape (n,)
        Comfort posture [rad or m].
    hands : mapping of str to str
        Links of the hands, by name.
    centres : array, shape (hands, 3)
        Centres of their boxes [m].
    box : array, shape (3,)
        Half extents of the boxes [m].
    seed : int
        Seed with which posture and box were found.
    ahead : str
        Axis of the world along which the robot looks, one of `LATERAL`.
    orientations : array, shape (hands, 4), optional
        Orientations of the hands in the middle, x, y, z, w, where their pose is to be controlled.
    """
    rows = [
        _JOINT.format(name=_text(joint), weight=_SHARED_WEIGHT if moved > 1 else 1.0, comfort=_number(position))
        for (joint, moved), position in zip(joints, comfort.tolist(), strict=True)
    ]
    turned = [None] * len(hands) if orientations is None else list(orientations)
    tables = [
        _hand_table(hand, link, centre, box, orientation)
        for (hand, link), centre, orientation in zip(hands.items(), centres, turned, strict=True)
    ]
    return _ROBOT.format(
        joints=len(joints),
        model=model,
        hands="1 hand" if len(hands) == 1 else f"{len(hands)} hands",
        seed=seed,
        name=_text(name),
        rows="\n".join(rows),
        hand_tables="".join(tables),
        steps="\n".join(f"{key} = {value!r}" for key, value in vars(STEPS).items()),
        pattern="" if ahead == AHEAD else _PATTERN.format(ahead=ahead, lateral=_vector(LATERAL[ahead])),
    )


def _hand_table(hand: str, link: str, centre: Floats, box: Floats, orientation: Floats | None) -> str:
    """Return the table of a hand; its pose is controlled if it has an orientation in the middle."""
    posed = orientation is not None
    return _HAND.format(
        name=_text(hand),
        link=_text(link),
        controls=POSE if posed else POSITION,
        centre=_vector([*centre, *(() if orientation is None else orientation)]),
        box=_vector([*box, *((TURN_RAD,) * 3 if posed else ())]),
        middle=_MIDDLE + _TURNED * posed,
        extents=_EXTENTS + _TURNS * posed,
    )


def import_toml(source: RobotSource, *, model: str, notes: Mapping[str, str]) -> str:
    """Return the text of an `import.toml`; `notes` are words on limits, by joint."""
    package = [] if source.package is None else [f"package = {_text(source.package)}"]
    drop = f"drop = [{', '.join(map(_text, source.drop))}]\n" if source.drop else ""
    base, frozen = "", ""
    if any(source.base.xyz):
        xyz = _vector(source.base.xyz)
        base = f"\n# Where the model's root stands in the world.\n[base]\nxyz = {xyz}\n"
    if source.frozen:
        rows = "\n".join(f"{_text(name)} = {_number(value)}" for name, value in source.frozen)
        frozen = f"\n# Postures of rigid joints [rad or m].\n[frozen]\n{rows}\n"
    text = _IMPORT.format(
        model=model,
        drop=drop,
        source="\n".join([*package, f"urdf = {_text(source.urdf)}"]),
        base=base,
        frozen=frozen,
        limits=_limits(source.limits, notes),
    )
    return text.rstrip("\n") + "\n"


def _limits(limits: Iterable[tuple[str, JointLimits]], notes: Mapping[str, str]) -> str:
    rows = [_limit_row(name, given, notes.get(name, "")) for name, given in limits]
    if not rows:
        return ""
    return "\n".join(["", "# Limits in place of the model's [rad or m, 1/s, N m or N].", "[limits]", *rows, ""])


def _limit_row(name: str, limits: JointLimits, note: str) -> str:
    numbers = ", ".join(f"{key} = {_number(value)}" for key, value in limits.given().items())
    return f"{_text(name)} = {{ {numbers} }}" + (f"  # {note}" if note else "")


def _text(value: str) -> str:
    return json.dumps(value, ensure_ascii=False)


def _number(value: float) -> str:
    return repr(round(float(value), 6) + 0.0)


def _vector(values: Iterable[float]) -> str:
    return f"[{', '.join(map(_number, np.asarray(list(values)).tolist()))}]"
