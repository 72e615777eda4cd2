"""Base of systems that compute at every tick of a period, from their inputs of that instant, and hold the result."""

from abc import abstractmethod
from typing import Any, Generic, NamedTuple, TypeVar

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, LeafSystem, State, ValueProducer

from pipeline.arrays import Floats
from recorders.errors import ConfigError

Held = TypeVar("Held")
_NS_PER_S = 1_000_000_000
_NO_TICK = -1


class _Sample(NamedTuple):
    """What was computed at a tick, counted from time 0; None before the first."""

    tick: int
    value: Any


def read(port: Any, context: Context) -> Floats:
    """Return the vector at an input port (Any: Drake's types for arrays are not numpy's)."""
    values: Floats = port.Eval(context)
    return values


class SampledSystem(LeafSystem, Generic[Held]):
    """A system with direct feedthrough at its ticks.

    What it computes at a tick is its output from this tick on. Drake's own sampled systems put it out a period later,
    and a chain of them is late by a period each. All state is in the context: it can be copied and set back.

    Parameters
    ----------
    period_ns : int
        From tick to tick [ns]; ticks are its multiples.

    Raises
    ------
    ConfigError
        The period is not above 0.
    """

    def __init__(self, period_ns: int) -> None:
        super().__init__()
        if period_ns <= 0:
            raise ConfigError(f"period of a sampled system: expected above 0 ns, found {period_ns} ns")
        self.period_ns = period_ns
        self._state: Any = self.DeclareAbstractState(AbstractValue.Make(_Sample(_NO_TICK, None)))
        calc: Any = self._sample
        producer: Any = ValueProducer(allocate=lambda: AbstractValue.Make(_Sample(_NO_TICK, None)), calc=calc)
        self._cache = self.DeclareCacheEntry("sample", producer).cache_index()
        self.DeclarePeriodicUnrestrictedUpdateEvent(period_ns / _NS_PER_S, 0.0, self._hold)

    @abstractmethod
    def compute(self, context: Context, held: Held | None) -> Held:
        """Return what is held from this tick on, from what was held before it, None at the first, and the inputs."""

    def held(self, context: Context) -> Held:
        """Return what is held at the time of a context, be its tick taken in yet or not."""
        value: Held = self._present(context).value
        return value

    def last(self, context: Context) -> Held | None:
        """Return what was held last, whatever the time; None before the first tick."""
        value: Held | None = self._last(context).value
        return value

    def _last(self, context: Context) -> _Sample:
        state: Any = context.get_abstract_state(self._state)
        return _Sample(*state.get_value())

    def _present(self, context: Context) -> _Sample:
        sample: Any = self.get_cache_entry(self._cache).Eval(context)
        return _Sample(*sample)

    def _sample(self, context: Context, out: AbstractValue) -> None:
        last = self._last(context)
        tick = round(context.get_time() * _NS_PER_S) // self.period_ns
        out.set_value(last if tick == last.tick else _Sample(tick, self.compute(context, last.value)))

    def _hold(self, context: Context, state: State) -> None:
        state.get_mutable_abstract_state(self._state).set_value(self._present(context))
