"""Random numbers named by (seed, path): drawn from raw PCG64 words, so that no library version changes them.

numpy promises the words of a bit generator for ever, and not what `Generator` makes of them. Every draw
has a name of its own and is never taken in sequence from a shared generator: leaving one out, resuming
or slicing changes no other.
"""

import hashlib
import json

import numpy as np
from numpy.random import PCG64
from numpy.typing import NDArray

from recorders.errors import ConfigError

_WORD_BITS = 64
_MANTISSA_BITS = 53  # a float64 in [0, 1) takes the upper 53 bits of a word


def raw_words(seed: int, *path: int | str, count: int) -> NDArray[np.uint64]:
    """Draw 64-bit words for one name.

    Parameters
    ----------
    seed : int
        Seed of the run.
    *path : int or str
        Name of the draw, for instance ``("state", epoch)``; ``1`` and ``"1"`` are different names.
    count : int
        How many words. A longer draw of the same name begins with the shorter one.

    Returns
    -------
    ndarray of uint64, shape (count,)
    """
    name = json.dumps([seed, *path]).encode("ascii")
    generator = PCG64(np.random.SeedSequence(int.from_bytes(hashlib.sha256(name).digest(), "big")))
    return generator.random_raw(count)


def uniforms(seed: int, *path: int | str, count: int) -> NDArray[np.float64]:
    """Draw uniform numbers in [0, 1), multiples of 2**-53, for one name.

    Parameters and name are those of `raw_words`.

    Returns
    -------
    ndarray of float64, shape (count,)

    Examples
    --------
    >>> bool((uniforms(0, "posture", count=2) == uniforms(0, "posture", count=3)[:2]).all())
    True
    """
    mantissas = raw_words(seed, *path, count=count) >> np.uint64(_WORD_BITS - _MANTISSA_BITS)
    return mantissas.astype(np.float64) * 2.0**-_MANTISSA_BITS


def distinct(words: NDArray[np.uint64], population: int) -> NDArray[np.int64]:
    """Choose as many different numbers below `population` as there are words, in ascending order.

    Floyd's algorithm in integer arithmetic: one word a number, and no table of the population.
    Scaling a word by its upper half leaves a bias of at most population / 2**64.

    Parameters
    ----------
    words : ndarray of uint64, shape (count,)
        Raw words, see `raw_words`.
    population : int
        Numbers are chosen from ``range(population)``; at least `count`.

    Returns
    -------
    ndarray of int64, shape (count,)

    Raises
    ------
    ConfigError
        If there are more words than numbers to choose from.
    """
    if len(words) > population:
        raise ConfigError(f"expected at most {population} words for a population of {population}, found {len(words)}")
    chosen: set[int] = set()
    for last, word in enumerate(words.tolist(), start=population - len(words)):
        candidate = (word * (last + 1)) >> _WORD_BITS
        chosen.add(last if candidate in chosen else candidate)
    return np.array(sorted(chosen), dtype=np.int64)
