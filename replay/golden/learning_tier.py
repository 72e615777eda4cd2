"""The learning tier of a golden case: every tick of the run compared to the bit, then what came of the whole."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from replay.golden.case import STATES_FILE, STEP_BYTES, STEPS_FILE, Case
from replay.golden.finding import LEARNING, ElementDifference, Finding, error_text
from replay.golden.recipe import LATER_RESULTS, EpochEnd, Runner, TickDigests
from replay.golden.reference_stream import altered_stream

_PART = STEP_BYTES // 3
_PARTS = ("stream", "outputs", "state")


def truncated_digests(moment: TickDigests) -> bytes:
    """Return what a case keeps of a tick."""
    return moment.stream[:_PART] + moment.outputs[:_PART] + moment.state[:_PART]


def check_learning(case: Case, runner: Runner) -> Finding | None:
    """Return the first thing that is not learned as it was: a message, a step with its element, or a result."""
    try:
        return altered_stream(case) or _Walk(case, runner).first() or _altered_result(case, runner)
    except Exception as error:
        return Finding(LEARNING, "run", "one that comes to its end", error_text(error))


class _Walk:
    """One run beside the steps of a case, up to the end of the epoch in which they part."""

    def __init__(self, case: Case, runner: Runner) -> None:
        self._case = case
        self._runner = runner
        self._steps = case.read(STEPS_FILE)
        self._states = case.read(STATES_FILE)
        self._taken = 0
        self._last: TickDigests | None = None
        self._finding: Finding | None = None

    def first(self) -> Finding | None:
        """Return the first step that differs, with the first element that does at the end of its epoch."""
        try:
            return self._walk()
        except Exception as error:
            place = {} if self._last is None else _place(self._last)
            after = Finding(LEARNING, "run", "a step after this", error_text(error), place)
            return self._finding or after

    def _walk(self) -> Finding | None:
        for event in self._runner.learn(self._case.recipe):
            if isinstance(event, TickDigests):
                self._compare(event)
            elif (named := self._element(event)) is not None:
                return named
        missing = len(self._steps) // STEP_BYTES - self._taken
        if self._finding is None and missing:
            place = {} if self._last is None else _place(self._last)
            return Finding(LEARNING, "ticks", f"{missing} more after this", "the end", place)
        return self._finding

    def _compare(self, moment: TickDigests) -> None:
        expected = self._steps[self._taken * STEP_BYTES : (self._taken + 1) * STEP_BYTES]
        self._taken += 1
        self._last = moment
        if self._finding is None and truncated_digests(moment) != expected:
            self._finding = _parted(moment, expected)

    def _element(self, end: EpochEnd) -> Finding | None:
        """Name the element, once the epoch in which the run parted is over."""
        difference = self._runner.difference(self._states, end)
        if difference is None:
            return self._finding
        if self._finding is None:
            return Finding(LEARNING, *difference, {"epoch": end.epoch}, "at the end of the epoch")
        return replace(self._finding, epoch_end=ElementDifference(end.epoch, *difference))


def _parted(moment: TickDigests, expected: bytes) -> Finding:
    found = truncated_digests(moment)
    for place, part in enumerate(_PARTS):
        old, new = (data[place * _PART : (place + 1) * _PART] for data in (expected, found))
        if old != new:
            wanted = f"digest {old.hex()}" if old else "no more ticks"
            return Finding(LEARNING, part, wanted, f"digest {new.hex()}", _place(moment))
    raise ValueError("expected two ticks that differ")


def _place(moment: TickDigests) -> dict[str, str | int]:
    names = ("epoch", "cycle", "phase", "log", "tick", "stamp_ns")
    return {name: getattr(moment, name) for name in names}


def _altered_result(case: Case, runner: Runner) -> Finding | None:
    """Compare the result of a whole run, run as programs run it."""
    found: Mapping[str, Any] = {"run": case.recipe.source().run, **runner.train(case.recipe)}
    for name in {**case.expected, **found}:
        if name in LATER_RESULTS and name not in case.expected:
            continue  # the case is older than this result
        old, new = case.expected.get(name, "absent"), found.get(name, "absent")
        if not _agree(old, new, case.tolerances.errors_cm):
            return Finding(LEARNING, name, str(old), str(new), note="of the whole run")
    return None


def _agree(old: Any, new: Any, tolerance: float) -> bool:
    """Whether two results agree: floats and lists of them within the tolerance, anything else exactly."""
    if isinstance(old, list) and isinstance(new, list):
        return len(old) == len(new) and all(_agree(a, b, tolerance) for a, b in zip(old, new, strict=True))
    if isinstance(old, float) and isinstance(new, float):
        return math.isfinite(new) and abs(old - new) <= tolerance
    return bool(old == new)
