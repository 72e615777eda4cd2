"""Knowledge of a robot that a learning rule has before the first message, as plain numbers: limits, chains, reach."""

import dataclasses
import math
import re
from collections.abc import Mapping
from typing import Any, Self

from pipeline.robot.config import RobotConfig
from pipeline.robot.hands import POSE
from pipeline.urdf.description import parse_urdf
from pipeline.urdf.joints import moving_joints
from recorders.errors import ConfigError
from recorders.text.wording import value_text

AXES = ("x", "y", "z")
TURNS = ("turn_x", "turn_y", "turn_z")
MAX_JOINTS = 1000
MAX_HANDS = 32
_HAND = re.compile(r"[A-Za-z]\w{0,39}", re.ASCII)
_MAX_NAME = 200


@dataclasses.dataclass(frozen=True, kw_only=True)
class Body:
    """Hands and joints of a robot, as a rule's configuration keeps them.

    Parameters
    ----------
    hands : tuple of str
        Names of the hands; each has three inputs, and three more if its pose is controlled.
    joints : tuple of str
        Names of the joints, in the order of the outputs.
    lower, upper : tuple of float
        Limits of the joints [rad or m].
    moves : tuple of tuple of int
        For each hand the joints that move it, by their places, rising.
    reach : tuple of float
        How far each input goes from its centre [m or rad], hand by hand.
    poses : tuple of str
        Names of the hands whose pose is controlled.

    Raises
    ------
    ConfigError
        If the parts do not fit one another.
    """

    hands: tuple[str, ...]
    joints: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    moves: tuple[tuple[int, ...], ...]
    reach: tuple[float, ...]
    poses: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _check_names("hands", self.hands, MAX_HANDS, lambda name: bool(_HAND.fullmatch(name)))
        _check_names("joints", self.joints, MAX_JOINTS, lambda name: name.isprintable() and len(name) <= _MAX_NAME)
        if list(self.poses) != [hand for hand in self.hands if hand in self.poses]:
            raise _unfit("poses", "names of hands, in their order", self.poses)
        for name, count in (("lower", len(self.joints)), ("upper", len(self.joints)), ("reach", self.inputs)):
            values = getattr(self, name)
            if len(values) != count or not all(type(value) is float and math.isfinite(value) for value in values):
                raise _unfit(name, f"{count} finite numbers", values)
        if not all(low < high for low, high in zip(self.lower, self.upper, strict=True)):
            raise _unfit("lower", "limits below the upper ones", self.lower)
        if not all(value > 0.0 for value in self.reach):
            raise _unfit("reach", "numbers above 0", self.reach)
        if len(self.moves) != len(self.hands) or not all(map(self._is_chain, self.moves)):
            raise _unfit("moves", f"places of joints, rising, for each of {len(self.hands)} hands", self.moves)

    @property
    def inputs(self) -> int:
        """Numbers of a target: a position for each hand, and a turn where the pose is controlled."""
        return sum(map(len, self.hand_axes))

    @property
    def hand_axes(self) -> tuple[tuple[str, ...], ...]:
        """Names of the inputs of each hand, without its own."""
        return tuple(AXES + TURNS if hand in self.poses else AXES for hand in self.hands)

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs, such as `left_x`."""
        return tuple(f"{hand}_{axis}" for hand, axes in zip(self.hands, self.hand_axes, strict=True) for axis in axes)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as lists, ready for JSON; without `poses` if there are none."""
        fields = {field.name: list(getattr(self, field.name)) for field in dataclasses.fields(self)}
        if not self.poses:
            del fields["poses"]
        return fields | {"moves": [list(places) for places in self.moves]}

    @classmethod
    def from_dict(cls, values: object) -> Self:
        """Make a body from the lists of `to_dict`.

        Raises
        ------
        ConfigError
            If they are not such lists.
        """
        names = [field.name for field in dataclasses.fields(cls) if field.name != "poses"]
        if not isinstance(values, Mapping) or set(values) - {"poses"} != set(names):
            raise ConfigError(f"body: expected a table with {', '.join(names)}, found {value_text(values)}")
        values = {"poses": (), **values}
        names.append("poses")
        if not all(isinstance(values[name], list | tuple) for name in names):
            raise ConfigError(f"body: expected lists, found {value_text(dict(values))}")
        if not all(isinstance(places, list | tuple) for places in values["moves"]):
            raise _unfit("moves", "a list for each hand", values["moves"])
        moves = tuple(tuple(places) for places in values["moves"])
        numbers = {name: tuple(map(_as_float, values[name])) for name in ("lower", "upper", "reach")}
        texts = {name: tuple(values[name]) for name in ("hands", "joints", "poses")}
        return cls(moves=moves, **texts, **numbers)

    def _is_chain(self, places: tuple[int, ...]) -> bool:
        whole = all(type(place) is int and 0 <= place < len(self.joints) for place in places)
        return whole and list(places) == sorted(set(places))


def body_of(robot: RobotConfig) -> Body:
    """Return the body of a robot: its hands, its joints, and which of these move which of those."""
    urdf = parse_urdf(robot.urdf_text)
    chains = [moving_joints(urdf, hand.link) for hand in robot.hands]
    return Body(
        hands=robot.hand_names,
        joints=robot.joints,
        lower=tuple(robot.lower.tolist()),
        upper=tuple(robot.upper.tolist()),
        moves=tuple(tuple(place for place, name in enumerate(robot.joints) if name in chain) for chain in chains),
        reach=tuple(robot.input_reach.tolist()),
        poses=tuple(hand.name for hand in robot.hands if hand.controls == POSE),
    )


def any_body(inputs: int, outputs: int) -> Body:
    """Return a body of which nothing is known: every joint may move every hand, by a turn at most.

    Raises
    ------
    ConfigError
        If so many inputs and outputs are not those of hands and joints.
    """
    hands, joints = inputs // len(AXES), outputs - inputs
    if inputs % len(AXES) or not 1 <= joints <= MAX_JOINTS or hands > MAX_HANDS:
        expected = f"expected three inputs for each hand, and outputs for them and for 1 to {MAX_JOINTS} joints"
        raise ConfigError(f"{expected}, found {inputs} inputs and {outputs} outputs")
    return Body(
        hands=("left", "right") if hands == 2 else tuple(f"hand_{place}" for place in range(1, hands + 1)),
        joints=tuple(f"joint_{place}" for place in range(joints)),
        lower=(-3.0,) * joints,
        upper=(3.0,) * joints,
        moves=(tuple(range(joints)),) * hands,
        reach=(0.25,) * inputs,
    )


def _as_float(value: object) -> Any:
    return float(value) if type(value) is int and abs(value) < 2**53 else value


def _check_names(what: str, names: tuple[str, ...], most: int, fits: Any) -> None:
    if not 1 <= len(names) <= most or not all(isinstance(name, str) and name and fits(name) for name in names):
        raise _unfit(what, f"from 1 to {most} names", names)
    if len(set(names)) != len(names):
        raise _unfit(what, "different names", names)


def _unfit(name: str, expected: str, found: object) -> ConfigError:
    return ConfigError(f"body: expected {name} to be {expected}, found {value_text(found)}")
