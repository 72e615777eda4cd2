"""Every operation of the live recorder fails, in every way: no message is lost that was synced, in whatever part."""

from collections import Counter, deque
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from disk_faults import DiskTask, Promised, in_every_way, sweep
from log_content import TOPIC, TYPE, data_of
from stepped_threads import SteppedThreads, stepped_threads

from recorders.cdr.codec import encode
from recorders.messages.message_types import String
from recorders.messages.record import RecordedMessage
from recorders.reading.parts import parts_in
from recorders.recording.config import RecordConfig
from recorders.recording.live_recorder import LiveRecorder
from recorders.wire.subscription import LiveMessage

MESSAGES, STEP = 90, 30
TEXT = "text " * 20


def message(run: str, number: int) -> bytes:
    return encode(String(f"{run} {number} {TEXT}"))


class Arrived:
    """In the place of a receiver: messages that have arrived, and the threads stepped between them."""

    def __init__(self, run: str, recorder: LiveRecorder, threads: SteppedThreads, promised: Promised) -> None:
        self.refused: Counter[str] = Counter()
        self._waiting = deque(message(run, number) for number in range(MESSAGES))
        self._recorder, self._threads, self._promised = recorder, threads, promised

    @contextmanager
    def reporting_failure(self) -> Iterator[None]:
        yield

    def next_event(self, timeout_s: float) -> LiveMessage | None:
        taken = MESSAGES - len(self._waiting)
        if taken and taken % STEP == 0:
            for name in ("log flush", "log flush", "log sync"):
                self._threads.step(name)
            self._recorder._writer.check()
            self._promised.handed = self._promised.synced = taken
        if not self._waiting:
            return None
        record = RecordedMessage(TOPIC, TYPE, self._waiting.popleft(), taken, 0)
        return LiveMessage(record, numbered=True)

    def is_empty(self) -> bool:
        return not self._waiting

    def unsubscribe(self) -> None:
        """Nobody sends."""

    def is_released(self, timeout_s: float = 0.0) -> bool:
        return True


class LiveRecording(DiskTask):
    """A recording in parts, beside what a crash left of another."""

    def prepare(self, folder: Path) -> None:
        """There is nothing."""

    def run(self, folder: Path, promised: Promised) -> None:
        self._record(folder, "new", promised)

    def check(self, folder: Path, promised: Promised, outcome: str) -> None:
        parts = parts_in(folder, "session")
        found = [data for part in parts for data in data_of(part)]
        assert found == [message("new", number) for number in range(len(found))]
        assert len(found) >= promised.least(outcome)
        assert not promised.done or all(part.suffix == ".mcap" for part in parts)

    def run_again(self, folder: Path) -> None:
        before = {path: data_of(path) for path in folder.iterdir()}
        self._record(folder, "again", Promised(), now_ns=10**18)
        left = [data for path in folder.iterdir() if path not in before for data in data_of(path)]
        assert sorted(left) == sorted(message("again", number) for number in range(MESSAGES))
        assert all(data_of(path) == data for path, data in before.items() if data)

    def _record(self, folder: Path, run: str, promised: Promised, *, now_ns: int = 0) -> None:
        config, overwrite = RecordConfig(split_bytes=4000), False
        out = folder / ("again.mcap" if now_ns else "session.mcap")
        with stepped_threads() as threads:
            recorder = LiveRecorder(out, config=config, overwrite=overwrite, clock=lambda: now_ns)
            with recorder:
                arrived: Any = Arrived(run, recorder, threads, promised)
                recorder.run(arrived, stopped=arrived.is_empty)
        promised.handed = promised.synced = MESSAGES
        promised.done = True


@in_every_way(17)
def test_what_the_recorder_was_promised_is_there(tmp_path: Path, step: int) -> None:
    sweep(LiveRecording(), tmp_path, step)
