"""The robot node and live exploration, each in a process of its own; to be run as a script."""

import json
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    from recorders.wire.keys.topic_keys import TopicKeys


def spawn(verb: str, **options: Any) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, __file__, verb, json.dumps(options)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@contextmanager
def robot(endpoint: str, **options: Any) -> Iterator[subprocess.Popen[str]]:
    """Run a robot that listens at an endpoint, from the moment when it is ready."""
    with spawn("robot", listen=[endpoint], **options) as process:
        try:
            assert process.stderr is not None
            ready = process.stderr.readline()
            assert "waits for commands" in ready, ready
            yield process
        finally:
            process.kill()


def stop(process: subprocess.Popen[str], signum: signal.Signals = signal.SIGTERM) -> list[str]:
    """End a process by a signal, and return what it said on standard error since it was ready."""
    process.send_signal(signum)
    _, complaints = process.communicate(timeout=120)
    return complaints.splitlines()


def keys_of(name: str, domain: int | None) -> "TopicKeys":
    """Keys of the default namespace, or of a ROS domain."""
    from recorders.rmw_zenoh.names import NodeName
    from recorders.wire.keys.ros_keys import RosKeys
    from recorders.wire.keys.topic_keys import NamespaceKeys

    return NamespaceKeys() if domain is None else RosKeys(domain, NodeName(name))


def run_robot_node(*, listen: list[str], **config: Any) -> NoReturn:
    from pipeline.robot.config import load_robot
    from pipeline.robot_node.follower import FollowerConfig
    from pipeline.robot_node.node import run_robot
    from pipeline.terminal.log_lines import logging_to_terminal
    from recorders.wire.session import SessionConfig

    with logging_to_terminal():
        run_robot(load_robot("asimo"), session=SessionConfig(listen=tuple(listen)), config=FollowerConfig(**config))


def run_exploration(
    *,
    connect: str,
    motion: str,
    seed: int,
    phases: list[list[Any]],
    settle_ns: int,
    consumers: list[str],
    wait_s: float = 120.0,
    domain: int | None = None,
) -> None:
    from dataclasses import asdict, replace

    from pipeline.exploration.live import explore_live
    from pipeline.exploration.source import source
    from recorders.wire.session import SessionConfig
    from replay.sources.schedule import Schedule
    from replay.transports.sender_config import SenderConfig

    schedule = Schedule.from_dict({"epochs": 1, "phases": phases})
    sender = SenderConfig(consumers=tuple(consumers), keys=keys_of("explorer", domain), wait_s=wait_s)
    session = SessionConfig(connect=(connect,))
    followed = source(motion)
    followed = replace(followed, config=replace(followed.config, settle_ns=settle_ns))
    result = explore_live(followed, seed=seed, schedule=schedule, session=session, sender=sender)
    print(json.dumps(asdict(result)))


def main() -> None:
    from recorders.errors import ReenactError

    signal.signal(signal.SIGTERM, lambda signum, frame: sys.exit(128 + signum))
    verb, options = sys.argv[1], json.loads(sys.argv[2])
    try:
        run: dict[str, Callable[..., None]] = {"robot": run_robot_node, "explore": run_exploration}
        run[verb](**options)
    except ReenactError as error:
        print(f"reenact: {error}", file=sys.stderr)
        sys.exit(error.exit_status)
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[2]))
    main()
