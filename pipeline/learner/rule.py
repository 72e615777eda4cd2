"""The seam for learning rules: what a rule's configuration and learner offer to everything else.

A rule is a module with `RULE`, a `Rule`: here in `pipeline.learner.rules`, named as the rule is, or in a
distribution of others, under an entry point of the group `reenact.rules`. `pipeline.learner.contract` has tests for it.
"""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol, Self

from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from pipeline.learner.body import Body
from pipeline.learner.state import MAX_NUMBERS, state_numbers
from recorders.errors import ConfigError
from recorders.text.wording import names_text, value_text
from replay.sources.schedule import Schedule

_OF_THE_TASK = ("inputs", "outputs", "epochs")  # settings that robot and schedule decide, not the user

DEFAULT = "reservoir"
"""The rule of a configuration that names none."""

DEFAULT_PAIRS = "commanded"
"""The pairs of a rule or controller that names none."""

BODY = "body"
"""Setting in which a configuration keeps the robot, if its rule needs to know it."""


@dataclass(frozen=True)
class Shown:
    """Arrays of a learner's state that a viewer shows.

    Parameters
    ----------
    drift : mapping of str to str
        Arrays that learn, by the name of their curve: how far they have moved since the start.
    spread : mapping of str to str
        Titles of small panels, by the array that one shows: its mean and deviation.
    activity : str
        Array whose values are shown tick by tick while a motion is followed; none if empty.
    first : int
        Its first element that is shown.
    """

    drift: Mapping[str, str] = field(default_factory=dict)
    spread: Mapping[str, str] = field(default_factory=dict)
    activity: str = ""
    first: int = 0


class Settings:
    """Base of a rule's configuration, a frozen dataclass of whole numbers and floats.

    A configuration has the fields `inputs`, `outputs`, `epochs` and `seed`, which are set for the robot and the stream,
    and defaults for all.

    Attributes
    ----------
    rule : str
        Name of the rule.
    remembers : bool
        Whether a command depends on targets before its own: then no other step may come between commands.
    phases : tuple of (str, int)
        Phases of an epoch with their numbers of cycles, in order, where logs are learned without more being said.

    Raises
    ------
    ConfigError
        If a value is of the wrong type or out of its range.
    """

    rule: ClassVar[str] = DEFAULT
    remembers: ClassVar[bool] = True
    phases: ClassVar[tuple[tuple[str, int], ...]] = Schedule.phases
    inputs: int
    outputs: int
    epochs: int
    seed: int

    def __post_init__(self) -> None:
        """Check types and ranges; a rule may know better."""
        for name, value in self.to_dict().items():
            if name == BODY:
                continue
            least = 1 if name in _OF_THE_TASK else 0
            whole = type(value) is int and least <= value < 2**63
            if not whole and not (name not in (*_OF_THE_TASK, "seed") and _is_finite(value)):
                raise ConfigError(f"expected learner setting {name} to be a number, found {value_text(value)}")

    def state_shapes(self) -> dict[str, tuple[int, ...]]:
        """Names and shapes of the state, in the order in which it is digested."""
        raise NotImplementedError

    def shown(self) -> Shown:
        """Return what a viewer shows of the state: by default, how far every array has moved."""
        return Shown(drift={name: name for name in self.state_shapes() if name != "epoch"})

    def schedule(self, epochs: int | None = None, topics: tuple[str, ...] = Schedule.topics) -> Schedule:
        """Return the schedule by which a learner of this rule learns logs, unless another is asked for."""
        return Schedule(self.epochs if epochs is None else epochs, self.phases, topics)

    def notes(self) -> tuple[str, ...]:
        """Return a line on everything that is other than was asked for; by default none."""
        return ()

    def element_name(self, array: str, index: tuple[int, ...]) -> str:
        """Name an element of an array of the state; by default by its place."""
        return place_name(array, index)

    def with_body(self, body: Body) -> Self:
        """Return the same for a robot; by default it knows how many inputs and outputs there are."""
        return self.fitted(inputs=body.inputs, outputs=body.inputs + len(body.joints))

    def adaptive(self) -> Self:
        """Return the configuration with which a taught learner goes on learning as it serves; by default the same."""
        return self

    def check_size(self) -> None:
        """Check that a state is small enough for a file, which may come from anyone.

        Raises
        ------
        ConfigError
            If it has more than `MAX_NUMBERS` numbers.
        """
        if (found := state_numbers(self.state_shapes())) > MAX_NUMBERS:
            raise ConfigError(
                f"expected at most {MAX_NUMBERS} numbers in a state, to be stored in a file, found {found}"
            )

    def to_dict(self) -> dict[str, int | float]:
        """Return the fields as plain numbers, ready for JSON or TOML."""
        return dataclasses.asdict(self)  # type: ignore[call-overload,no-any-return]  # a rule's is a dataclass

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Make a configuration from plain numbers; absent keys take their default.

        Raises
        ------
        ConfigError
            If a key is unknown, or a value is of the wrong type or out of its range.
        """
        known = list(cls.__dataclass_fields__)  # type: ignore[attr-defined]
        unknown = sorted(str(key) for key in values if key not in known)
        if unknown:
            own = [name for name in known if name not in _OF_THE_TASK]
            raise ConfigError(f"unknown learner setting {names_text(unknown)}; there are {names_text(own)}")
        return cls(**values)

    def fitted(self, **changes: int) -> Self:
        """Return the same with other inputs, outputs, epochs or seed."""
        return dataclasses.replace(self, **changes)  # type: ignore[type-var]


class OnlineLearner(Protocol):
    """A learner as nodes and verbs use it; positions in metres, joints in radians, nothing centred.

    It is made as `Rule.learner(config, input_centre=..., output_centre=...)` and then stands at the beginning of epoch
    0. Steps are complete: step k forms the outputs from u(k), then compares them with d(k), then learns. How a
    sequence is cut into calls changes no bit.
    """

    @property
    def config(self) -> Settings:
        """The configuration."""

    @property
    def input_centre(self) -> Floats:
        """Constant taken from u [m], shape (inputs,)."""

    @property
    def output_centre(self) -> Floats:
        """Constant taken from d and added to the outputs, shape (outputs,)."""

    def begin_epoch(self, epoch: int) -> None:
        """Start an epoch: seeded state of its own, rates of its own, the same weights."""

    def step(self, u: ArrayLike, d: ArrayLike, *, learning: bool) -> Floats:
        """Take steps with targets d (n, outputs); returns the outputs (n, outputs), each from before its update."""

    def predict(self, u: ArrayLike) -> Floats:
        """Take steps forward only: u (n, inputs) to outputs (n, outputs)."""

    def washout(self, u0: ArrayLike, *, steps: int) -> None:
        """Forget what came before: from a seeded state, hold the target u0 (inputs,) for some steps."""

    def state(self) -> dict[str, Floats]:
        """Copy everything that later steps depend on, named and shaped as `Settings.state_shapes` has it."""

    def load_state(self, state: Mapping[str, Floats]) -> None:
        """Go on from a state, to the bit; ControllerError if it is none, and nothing has changed then."""

    def connections_digest(self) -> str:
        """SHA-256 of what is drawn from the seed and never changes; together with the state it is the learner."""


@dataclass(frozen=True)
class Rule:
    """A learning rule.

    Parameters
    ----------
    config : type of Settings
        Its configuration, whose `rule` is the name of the rule.
    learner : callable
        Makes an `OnlineLearner` of a configuration, `input_centre` and `output_centre`.
    pairs : str
        Pairs that it learns from unless others are asked for, by the name of their pairing rule.
    load : callable
        Imports what `learner` puts off until the first one is made: whoever is awaited calls it before.
    """

    config: type[Settings]
    learner: Callable[..., OnlineLearner]
    pairs: str = DEFAULT_PAIRS
    load: Callable[[], object] = lambda: None

    @property
    def name(self) -> str:
        """Name of the rule."""
        return self.config.rule


def _is_finite(value: object) -> bool:
    return type(value) in (int, float) and abs(value) < float("inf")  # type: ignore[arg-type]  # nor is NaN


def place_name(array: str, index: tuple[int, ...]) -> str:
    """Return the name of an element of an array by its place, such as `a[17]` or `w[2, 0]`."""
    return f"{array}[{', '.join(map(str, index))}]"
