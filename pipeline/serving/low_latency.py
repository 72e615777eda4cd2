"""Shortens the pauses of the interpreter itself, where an answer is due within a millisecond."""

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_SWITCH_S = 1e-4  # Python's own 5 ms are five ticks at 1 kHz


@contextmanager
def low_latency() -> Iterator[None]:
    """Keep the two pauses that Python makes short while the block runs.

    The collector of cyclic garbage looks through everything that is alive, which takes it some 0.1 s once numpy and
    numba are loaded. What is alive now is kept from it; garbage that is made from now on it collects as ever. And
    a thread that computes, such as one that writes a log, makes way for another after 0.1 ms.
    """
    interval = sys.getswitchinterval()
    gc.collect()
    gc.freeze()
    sys.setswitchinterval(_SWITCH_S)
    try:
        yield
    finally:
        sys.setswitchinterval(interval)
        gc.unfreeze()
