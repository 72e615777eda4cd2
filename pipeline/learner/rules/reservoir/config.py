"""The learner's configuration: Table I of the paper, checked."""

import dataclasses
import math

from pipeline.learner.rule import Settings, Shown
from pipeline.learner.state import MAX_NUMBERS, state_numbers
from recorders.errors import ConfigError
from recorders.text.wording import value_text

MAX_NEURONS = 1_000_000  # keeps a configuration read from a file from asking for all of the memory
MAX_CONNECTIONS = 20_000_000
MAX_FILE_NEURONS = 50_000


@dataclasses.dataclass(frozen=True)
class ConnectionConfig:
    """One type of connection: sources, targets, density and initial range."""

    source: str  # "input", "reservoir" or "output"
    target: str  # "reservoir" or "output"
    sources: int
    targets: int
    density: float
    initial_range: float

    @property
    def name(self) -> str:
        """Name of the type, for instance ``input_reservoir``."""
        return f"{self.source}_{self.target}"

    @property
    def count(self) -> int:
        """Number of connections that exist, rounded half up."""
        return math.floor(self.density * (self.sources * self.targets) + 0.5)


@dataclasses.dataclass(frozen=True, kw_only=True)
class LearnerConfig(Settings):
    """Sizes, connections, rates and seed of the network; the defaults are Table I of the paper.

    A density is the share of the possible connections that exist; a range r means initial weights uniform
    in [-r, r). Rates fall exponentially with the epoch, from start (epoch 0) to end (the last of `epochs`);
    start = end = 0 switches the rule off.

    Raises
    ------
    ConfigError
        If a value is of the wrong type or out of its range.
    """

    reservoir: int = 300
    inputs: int = 6
    outputs: int = 21
    input_reservoir_density: float = 0.2
    input_reservoir_range: float = 0.1
    input_output_density: float = 1.0
    input_output_range: float = 0.1
    reservoir_reservoir_density: float = 0.02
    reservoir_reservoir_range: float = 0.02
    reservoir_output_density: float = 0.2
    reservoir_output_range: float = 0.1
    output_reservoir_density: float = 0.2
    output_reservoir_range: float = 0.1
    output_output_density: float = 0.0
    output_output_range: float = 0.1
    bpdc_rate_start: float = 0.15
    bpdc_rate_end: float = 0.025
    bpdc_epsilon: float = 0.002
    ip_rate_start: float = 0.015
    ip_rate_end: float = 0.0025
    ip_mu: float = 0.1
    initial_state_range: float = 0.1
    epochs: int = 150
    seed: int = 0

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            _check_value(field.name, field.type, getattr(self, field.name))
        for rule in ("bpdc", "ip"):
            start, end = getattr(self, f"{rule}_rate_start"), getattr(self, f"{rule}_rate_end")
            if (start == 0.0) != (end == 0.0):
                raise ConfigError(f"expected {rule} rates both zero or both above it, found {start} and {end}")
        found = sum(connection.count for connection in self.connections())
        if found > MAX_CONNECTIONS:
            raise ConfigError(
                f"expected at most {MAX_CONNECTIONS} connections, found {found}: lower a density or a size"
            )

    def connections(self) -> tuple[ConnectionConfig, ...]:
        """All types of connection, in the fixed order of weights in state and digest."""
        sizes = {"input": self.inputs, "reservoir": self.reservoir, "output": self.outputs}
        return tuple(
            ConnectionConfig(
                source,
                target,
                sizes[source],
                sizes[target],
                getattr(self, f"{source}_{target}_density"),
                getattr(self, f"{source}_{target}_range"),
            )
            for target in ("reservoir", "output")
            for source in ("input", "reservoir", "output")
        )

    def state_shapes(self) -> dict[str, tuple[int, ...]]:
        """Names and shapes of the state, in the order in which it is digested.

        Weights by type of connection; a, b of the reservoir; x, y of the outputs, then the reservoir, eq. (4); the
        outputs' last errors e; the epoch, -1 before the first.
        """
        neurons = self.outputs + self.reservoir
        return {
            **{f"{connection.name}_weights": (connection.count,) for connection in self.connections()},
            "a": (self.reservoir,),
            "b": (self.reservoir,),
            "x": (neurons,),
            "y": (neurons,),
            "e": (self.outputs,),
            "epoch": (1,),
        }

    def shown(self) -> Shown:
        """Show the weights that learn, by type of connection; a, b; y of the reservoir."""
        learning = [part.name for part in self.connections() if part.target == "output" and part.count > 0]
        return Shown(
            drift={name: f"{name}_weights" for name in learning},
            spread={"a": "Gains a", "b": "Biases b"},
            activity="y",
            first=self.outputs,
        )

    def check_size(self) -> None:
        """Check that a network is small enough for a file, which may come from anyone.

        Raises
        ------
        ConfigError
            If it has more than `MAX_FILE_NEURONS` neurons, or `MAX_NUMBERS` numbers in its state.
        """
        neurons, numbers = self.inputs + self.outputs + self.reservoir, state_numbers(self.state_shapes())
        if neurons > MAX_FILE_NEURONS or numbers > MAX_NUMBERS:
            raise ConfigError(
                f"expected at most {MAX_FILE_NEURONS} neurons and {MAX_NUMBERS} weights and activities, to be stored "
                f"in a file, found {neurons} and {numbers}"
            )


_POSITIVE_INTEGERS = {"reservoir": MAX_NEURONS, "inputs": MAX_NEURONS, "outputs": MAX_NEURONS, "epochs": 10**9}
_POSITIVE = ("bpdc_epsilon", "ip_mu")


def _check_value(name: str, kind: object, value: object) -> None:
    if kind is int:
        _check_integer(name, value)
    else:
        _check_float(name, value)


def _check_integer(name: str, value: object) -> None:
    low, high = (1, _POSITIVE_INTEGERS[name]) if name in _POSITIVE_INTEGERS else (0, 2**63 - 1)
    if type(value) is not int or not low <= value <= high:
        raise ConfigError(
            f"expected learner setting {name} to be a whole number from {low} to {high}, found {value_text(value)}"
        )


def _check_float(name: str, value: object) -> None:
    number = float(value) if type(value) in (int, float) else math.nan  # type: ignore[arg-type]
    if name.endswith("_density"):
        allowed, text = 0.0 <= number <= 1.0, "from 0 to 1"
    elif name in _POSITIVE:
        allowed, text = 0.0 < number < math.inf, "above 0"
    else:
        allowed, text = 0.0 <= number < math.inf, "at least 0"
    if not allowed:
        raise ConfigError(f"expected learner setting {name} to be a number {text}, found {value_text(value)}")
