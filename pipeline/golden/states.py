"""States of a learner at the ends of epochs in one .npz: an array that did not change is stored once."""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.arrays import Floats
from pipeline.learner import npz
from pipeline.learner.controller_diff import first_difference_of_arrays
from pipeline.learner.rule import place_name
from recorders.errors import ConfigError, ControllerError
from replay.golden.recipe import EpochEnd, State

_MEMBER = re.compile(r"(\d{1,3})/(\w+)")  # epoch, name of the array


def pack(states: Sequence[State]) -> bytes:
    """Return states, one for each epoch, as the bytes of an .npz with members `EPOCH/NAME`."""
    members: dict[str, npz.Member] = {}
    before: State = {}
    for epoch, state in enumerate(states):
        members |= {f"{epoch}/{name}": values for name, values in state.items() if not _same(before.get(name), values)}
        before = state
    return npz.pack(members)


def unpack(data: bytes, epoch: int) -> dict[str, Floats]:
    """Return the state at the end of an epoch.

    Raises
    ------
    ConfigError
        If the bytes are no such file.
    """
    state: dict[str, Floats] = {}
    for member, values in _members(data).items():
        match = _MEMBER.fullmatch(member)
        if match is None or isinstance(values, str):
            raise ConfigError(f"expected members EPOCH/NAME of float64, found {member!r:.60}")
        if int(match[1]) <= epoch:  # they come in the order of the epochs
            state[match[2]] = values
    return state


def difference(packed: bytes, end: EpochEnd) -> tuple[str, str, str] | None:
    """Name the first element that differs from the packed state of that epoch: name, expected, found."""
    found = {name: np.asarray(values, dtype=np.float64) for name, values in end.state.items()}
    names = end.element_name or place_name
    first = first_difference_of_arrays(unpack(packed, end.epoch), found, element_name=names)
    return None if first is None else (first.name, first.a, first.b)


def _members(data: bytes) -> Mapping[str, npz.Member]:
    try:
        return npz.unpack(data)
    except ControllerError as error:
        raise ConfigError(f"the states of the case: {error}") from error


def _same(a: Floats | None, b: Floats) -> bool:
    return a is not None and a.shape == b.shape and a.tobytes() == b.tobytes()
