"""A log as the learner takes it in, joined once for all the cycles that present it again."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.samples import HANDS, CommandedPairs
from recorders.records import Stamped
from recorders.ticks import join_ticks
from replay.digests import link

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Presentation:
    """What the messages of one presentation come to; T steps take T + 1 ticks.

    Attributes
    ----------
    stamps_ns : list of int, length T + 1
        Stamps of the ticks [ns].
    u : ndarray, shape (T, 6)
        Hand targets [m].
    d : ndarray, shape (T, 6 + joints)
        What they teach: next targets [m], joints [rad or m].
    pending : ndarray, shape (6,)
        The target of the last tick [m], which waits for a teaching signal.
    links : list of bytes, length T + 1
        What each tick adds to the stream digest.
    """

    stamps_ns: list[int]
    u: Floats
    d: Floats
    pending: Floats
    links: list[bytes]

    @classmethod
    def of(cls, messages: Iterable[Stamped], joints: tuple[str, ...]) -> "Presentation":
        """Join the messages of one presentation to ticks, and these to steps, as `LearningRun.feed` does.

        Raises
        ------
        MessageError, JointError
            If a message is not what it should be, or lacks one of the `joints`.
        """
        ticks = list(join_ticks(messages))
        pairs = CommandedPairs(joints)
        u, d = np.empty((len(ticks), HANDS)), np.empty((len(ticks), HANDS + len(joints)))
        for row, tick in enumerate(ticks):
            pairs.fill(tick, u[row], d[row])
        return cls(
            stamps_ns=[tick.stamp_ns for tick in ticks],
            u=u[1:],  # the first tick completes no step
            d=d[1:],
            pending=pairs.pending,
            links=[link(tick.records) for tick in ticks],
        )
