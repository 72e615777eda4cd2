"""Times and sizes as people write them, read exactly, and times and decimals as text."""

import re
from decimal import Decimal

from recorders.errors import ConfigError

MAX_TIME_NS = 2**64 - 1
"""The latest log time [ns]: a log has 64 bits for it."""

_NS_PER_S = 10**9
_TIMES = {"s": 1, "min": 60, "h": 3600}
_SIZES = {"b": 1, **{f"{prefix}b": 1000**n for n, prefix in enumerate("kmg", 1)}}
_SIZES |= {f"{prefix}ib": 1024**n for n, prefix in enumerate("kmg", 1)}
_QUANTITY = re.compile(r"(\d+(?:\.\d+)?)\s*([a-z]+)", re.ASCII | re.IGNORECASE)
_LONGEST = 40  # characters of what was written that are shown


def parse_seconds(text: str, what: str) -> int:
    """Return a time that is written in seconds, to the nearest nanosecond [ns].

    Raises
    ------
    ConfigError
        If it is no number, or not within 0 and the latest log time.
    """
    try:
        nanoseconds = Decimal(text).scaleb(9)
    except ArithmeticError:
        nanoseconds = Decimal("nan")
    if not (nanoseconds.is_finite() and 0 <= nanoseconds <= MAX_TIME_NS):
        latest = seconds_text(MAX_TIME_NS)
        raise ConfigError(f"{what}: expected seconds from 0 to {latest}, such as 2.5, found {text[:_LONGEST]!r}")
    return int(nanoseconds.to_integral_value())


def parse_size_or_time(text: str, what: str) -> tuple[int | None, int | None]:
    """Return a size [bytes] or a time [ns], whichever is written, and None for the other.

    Raises
    ------
    ConfigError
        If it is neither, is 0, or is beyond what a log can hold; the line names the units.

    Examples
    --------
    >>> parse_size_or_time("100MB", "--split")
    (100000000, None)
    >>> parse_size_or_time("2 min", "--split")
    (None, 120000000000)
    """
    found = _QUANTITY.fullmatch(text.strip())
    for units, scale in ((_SIZES, 1), (_TIMES, _NS_PER_S)):
        if found is not None and (unit := units.get(found[2].lower())) is not None:
            amount = int(Decimal(found[1]) * unit * scale)
            if 1 <= amount <= MAX_TIME_NS:
                return (amount, None) if units is _SIZES else (None, amount)
    raise ConfigError(
        f"{what}: expected a size in B, kB, MB, GB, KiB, MiB or GiB, or a time in s, min or h, such as 100MB or 10min, "
        f"found {text[:_LONGEST]!r}"
    )


def seconds_text(time_ns: int) -> str:
    """Return a time in seconds, in full, without zeros at its end."""
    seconds, rest = divmod(abs(time_ns), _NS_PER_S)
    decimals = f".{rest:09d}".rstrip("0") if rest else ""
    return f"{'-' if time_ns < 0 else ''}{seconds}{decimals}"


def decimal_text(value: float) -> str:
    """Return a number to two decimals, or to three digits that count where that shows more.

    Examples
    --------
    >>> decimal_text(1.2236), decimal_text(0.0203), decimal_text(0.0)
    ('1.22', '0.0203', '0.00')
    """
    return f"{value:#.3g}" if 0.0 < abs(value) <= 0.1 else f"{value:.2f}"
