"""Hand targets of a motion as a source of Drake: each held until the next."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import Context, LeafSystem

from pipeline.arrays import Floats
from pipeline.drake_systems.commanding import HAND_TARGETS
from recorders.errors import ConfigError

_NS_PER_S = 1_000_000_000


class TargetSource(LeafSystem):
    """Output port `hand_targets`: targets that are held one after the other, the last for ever.

    Parameters
    ----------
    targets : array, shape (T, hands, 3)
        Hand targets [m].
    durations_ns : sequence of int, length T
        How long each is held [ns], from time 0 on.

    Raises
    ------
    ConfigError
        There are no targets, or not as many as durations, or one is held for no time.
    """

    def __init__(self, targets: ArrayLike, durations_ns: Sequence[int]) -> None:
        super().__init__()
        self._targets: Floats = np.asarray(targets, dtype=np.float64)
        if not 0 < len(self._targets) == len(durations_ns) or min(durations_ns) <= 0:
            raise ConfigError(
                f"expected targets and as many durations above 0 ns, found {len(self._targets)} and {len(durations_ns)}"
            )
        self._begins_ns = np.cumsum([0, *durations_ns[:-1]])
        self.DeclareVectorOutputPort(HAND_TARGETS, self._targets[0].size, self._target, {self.time_ticket()})

    def _target(self, context: Context, out: Any) -> None:
        time_ns = round(context.get_time() * _NS_PER_S)
        place = int(np.searchsorted(self._begins_ns, time_ns, side="right")) - 1
        out.SetFromVector(self._targets[max(place, 0)].ravel())
