"""A replay that awaits a controller fails if that is lost before its end, whether it comes back or not."""

import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from episodes import write_episode
from processes import start, wait_for_line

from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.training.trainer import train
from recorders.errors import WireError
from recorders.messages.record import RecordedMessage
from recorders.reading.reader import LogReader
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session
from replay.sources.live import live_offer
from replay.sources.schedule import Schedule
from replay.transports.sender_config import SenderConfig
from replay.transports.zenoh import ZenohTransport


@pytest.mark.parametrize("comes_back", [False, True])
def test_a_controller_that_is_killed_in_the_middle_of_a_replay_fails_it(tmp_path: Path, comes_back: bool) -> None:
    log = write_episode(tmp_path / "log.mcap", samples=4)
    train([log], schedule=Schedule(epochs=1), config=LearnerConfig(reservoir=20)).controller().save(tmp_path / "c.npz")
    records, endpoint = list(LogReader(log)), free_endpoint()

    def serve() -> subprocess.Popen[str]:
        process = stack.enter_context(start("serve", "c.npz", "--connect", endpoint, cwd=tmp_path))
        stack.callback(process.kill)
        return process

    def played(first: subprocess.Popen[str]) -> Callable[[int], Iterator[RecordedMessage]]:
        def stream(begin: int) -> Iterator[RecordedMessage]:
            yield from records[:6]
            first.kill()
            first.wait()
            if comes_back:
                wait_for_line(serve(), "serves")
            yield from records[6:]

        return stream

    with ExitStack() as stack, open_session(SessionConfig(listen=(endpoint,))) as session:
        first = serve()
        transport = ZenohTransport(session, config=SenderConfig(consumers=("controller",), batch_size=1, wait_s=120.0))
        with pytest.raises(WireError, match="controller 'controller' was lost before the end of the replay"):
            transport.deliver(live_offer("0" * 32, epochs=1, robot={}), played(first))
