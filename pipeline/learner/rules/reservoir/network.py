"""The network as arrays: which connections exist, how they lie in the kernel's tables, and the state by name.

The kernel's layout (padding, slots) is made for speed. The state that is saved, compared and digested does
not know it: weights are kept per type of connection, ordered by target, then source.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats
from pipeline.learner.rules.reservoir import kernels
from pipeline.learner.rules.reservoir.config import ConnectionConfig, LearnerConfig
from pipeline.learner.rules.reservoir.kernels import Sizes
from pipeline.seeding import distinct, raw_words, uniforms

_LANES = 4  # the kernel squares z four at a time
_Places = NDArray[np.int64]


class Connections(NamedTuple):
    """The connections of one type that exist, ordered by target, then source."""

    targets: NDArray[np.int64]  # (count,)
    sources: NDArray[np.int64]  # (count,)


def draw_connections(config: ConnectionConfig, *, seed: int) -> Connections:
    """Draw which connections exist: the same number for every target, or one more.

    They are drawn by index, target by target, so that the cost is that of the connections that exist.

    Returns
    -------
    Connections
        With ``round(density * sources * targets)`` entries.
    """
    least, extra = divmod(config.count, config.targets)
    degrees = np.full(config.targets, least)
    degrees[distinct(raw_words(seed, "connections", config.name, "degrees", count=extra), config.targets)] += 1
    words = raw_words(seed, "connections", config.name, "sources", count=config.count)
    parts = [distinct(part, config.sources) for part in np.split(words, np.cumsum(degrees)[:-1])]
    return Connections(np.repeat(np.arange(config.targets), degrees), np.concatenate(parts))


def symmetric_uniforms(seed: int, *path: int | str, count: int, limit: float) -> Floats:
    """Uniform numbers in [-limit, limit), named as in `pipeline.seeding`, shape (count,)."""
    return (2.0 * uniforms(seed, *path, count=count) - 1.0) * limit


class _Layout:
    """Places of connections in a table of the kernel: a row for each target, a slot for each of its sources."""

    def __init__(self, targets: int, *, no_source: int) -> None:
        self._parts: list[NDArray[np.uint32]] = []
        self._targets, self._no_source = targets, no_source
        self.slots = 0

    def add(self, connections: Connections, *, first_source: int) -> tuple[_Places, _Places]:
        """Append the slots of one type; returns row and slot of each connection."""
        degrees = np.bincount(connections.targets, minlength=self._targets)
        first_of_target = np.cumsum(degrees) - degrees
        slots = np.arange(len(connections.targets)) - first_of_target[connections.targets]
        part = np.full((self._targets, int(degrees.max())), self._no_source, dtype=np.uint32)
        part[connections.targets, slots] = first_source + connections.sources
        self._parts.append(part)
        self.slots += part.shape[1]
        return connections.targets, self.slots - part.shape[1] + slots

    def flat(self) -> NDArray[np.uint32]:
        """Return the source of each slot, as an index into z, row after row."""
        return np.concatenate(self._parts, axis=1).reshape(-1)


class Network:
    """Connections and memory of one network, with its state read and written by name.

    A new network has its initial weights, a = 1, b = 0, and no activity.

    Parameters
    ----------
    config : LearnerConfig
        Sizes, connections, initial ranges and seed.

    Attributes
    ----------
    connections : dict of str to Connections
        The connections that exist, by type.
    sizes, sources, memory : ndarray
        What the kernel works on, see `pipeline.learner.rules.reservoir.kernels.run`.
    """

    def __init__(self, config: LearnerConfig) -> None:
        self.connections = {c.name: draw_connections(c, seed=config.seed) for c in config.connections()}
        self._outputs = config.outputs
        self._activities = slice(config.inputs, config.inputs + config.outputs + config.reservoir)
        self._lay_out(config)
        self._views = kernels.views(self.sizes, self.memory)
        self._views.a[:] = 1.0
        for part in config.connections():
            self._weights_of(part.name)[self._places[part.name]] = symmetric_uniforms(
                config.seed, "weights", part.name, count=part.count, limit=part.initial_range
            )

    def set_activations(self, x: Floats) -> None:
        """Set x of outputs and reservoir, shape (outputs + reservoir,), and y = f(x); forget the last error."""
        self._views.x[:] = x
        self._views.error[:] = 0.0
        kernels.activate(self.sizes, self.memory)

    def state(self) -> dict[str, Floats]:
        """Copy the state, named and shaped as in `LearnerConfig.state_shapes`, less the epoch."""
        weights = {f"{name}_weights": self._weights_of(name)[places] for name, places in self._places.items()}
        return {**weights, **{name: values.copy() for name, values in self._vectors().items()}}

    def load_state(self, state: Mapping[str, Floats]) -> None:
        """Take over a state as `state` returns it; it must have passed `pipeline.learner.state.check_state`."""
        for name, places in self._places.items():
            self._weights_of(name)[places] = state[f"{name}_weights"]
        for name, values in self._vectors().items():
            values[:] = state[name]

    def _lay_out(self, config: LearnerConfig) -> None:
        first_source = {"input": 0, "output": config.inputs, "reservoir": config.inputs + config.outputs}
        sources = -(-(self._activities.stop + 1) // _LANES) * _LANES  # at least one constant zero
        layouts = {
            "reservoir": _Layout(config.reservoir, no_source=sources - 1),
            "output": _Layout(config.outputs, no_source=sources - 1),
        }
        self._places: dict[str, tuple[_Places, _Places]] = {}
        for part in config.connections():
            feedback_slot = layouts[part.target].slots  # of the last type: output to output
            self._places[part.name] = layouts[part.target].add(
                self.connections[part.name], first_source=first_source[part.source]
            )
        slots = layouts["reservoir"].slots, layouts["output"].slots
        sizes = Sizes(config.inputs, config.outputs, config.reservoir, *slots, feedback_slot, sources)
        self.sizes = np.array(sizes, dtype=np.int64)
        self.sources = np.concatenate([layouts["reservoir"].flat(), layouts["output"].flat()])
        self.memory = np.zeros(kernels.memory_size(sizes))

    def _weights_of(self, name: str) -> Floats:
        return self._views.reservoir_weights if name.endswith("_reservoir") else self._views.output_weights

    def _vectors(self) -> dict[str, Floats]:
        v = self._views
        return {"a": v.a, "b": v.b, "x": v.x, "y": v.z[self._activities], "e": v.error}
