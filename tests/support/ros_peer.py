"""A ROS 2 node of others, by ROBOTIS' client of rmw_zenoh, in a process of its own; run as a script.

It reads one command a line and answers each with a line of JSON.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from waiting import wait_until

from recorders.cdr.codec import encode
from recorders.messages.message_types import TypedMessage

READY = "ready"


class RosPeer:
    """The other end of such a process."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process

    def ask(self, verb: str, **arguments: Any) -> Any:
        """Have it do something, and return what it answers."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps({"verb": verb, **arguments}) + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def settle(self) -> None:
        """Wait until both ends know of what either has declared: a question goes the same way, behind that."""
        self.ask("topics")

    def publish(self, topic: str, message: TypedMessage) -> None:
        """Have it publish a message."""
        self.ask("publish_cdr", topic=topic, payload=encode(message).hex())

    def received(self, topic: str, count: int) -> list[bytes]:
        """Wait until it has received so many messages of a topic, and return all that it has."""
        found: list[bytes] = []

        def are_there() -> bool:
            found[:] = [bytes.fromhex(data) for name, data in self.ask("received") if name == topic]
            return len(found) >= count

        wait_until(are_there)
        return found


@contextmanager
def ros_peer(endpoint: str, *, domain: int = 0) -> Iterator[RosPeer]:
    """Start one that connects to an endpoint on loopback; it is killed at the end."""
    port = endpoint.rpartition(":")[2]
    command = [sys.executable, __file__, port, str(domain)]
    environment = os.environ | {"PYTHONWARNINGS": "ignore"}
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline().strip() == READY
            yield RosPeer(process)
        finally:
            process.kill()


class _Node:
    """What the script does: publishers, subscribers and discovery of the client, by name of the command."""

    def __init__(self, port: int, domain: int) -> None:
        from rosbags.typesys import Stores, get_typestore

        self._at: dict[str, Any] = {"router_port": port, "domain_id": domain}
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self._publishers: dict[str, Any] = {}
        self._subscribers: list[Any] = []
        self._received: list[Any] = []

    def publisher(self, topic: str, type_name: str, *, name: str, latched: bool = False, humble: bool = False) -> None:
        from zenoh_ros2_sdk import ROS2Publisher

        options = self._described(type_name, latched=latched, humble=humble)
        self._publishers[topic] = ROS2Publisher(topic, type_name, node_name=name, **options)

    def publish(self, topic: str, fields: dict[str, Any]) -> None:
        self._publishers[topic].publish(**fields)

    def subscribe(self, topic: str, type_name: str, *, name: str, latched: bool = False, humble: bool = False) -> None:
        from zenoh_ros2_sdk import ROS2Subscriber

        options = self._described(type_name, latched=latched, humble=humble)

        def note(message: Any) -> None:
            payload = bytes(self._store.serialize_cdr(message, type_name))
            self._received.append((topic, payload.hex()))

        self._subscribers.append(ROS2Subscriber(topic, type_name, note, node_name=name, **options))

    def publish_cdr(self, topic: str, payload: str) -> None:
        """Publish a message that comes as CDR, in hexadecimal digits."""
        publisher = self._publishers[topic]
        message: Any = self._store.deserialize_cdr(bytes.fromhex(payload), publisher.msg_type)
        publisher.publish(**{name: getattr(message, name) for name in message.__dataclass_fields__ if name[0] != "_"})

    def received(self) -> list[tuple[str, str]]:
        """Return topic and CDR of what its subscribers received so far."""
        return list(self._received)

    def topics(self) -> list[Any]:
        from zenoh_ros2_sdk.discovery import get_topic_names_and_types

        return list(get_topic_names_and_types(timeout=5.0, **self._at))

    def info(self, topic: str) -> dict[str, Any] | None:
        from dataclasses import asdict

        from zenoh_ros2_sdk.discovery import get_topic_info

        found = get_topic_info(topic, timeout=5.0, verbose=True, **self._at)
        return None if found is None else asdict(found)

    def _described(self, type_name: str, *, latched: bool, humble: bool) -> dict[str, Any]:
        from zenoh_ros2_sdk.qos import QosDurability, QosProfile

        durability = QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE
        return {
            "msg_definition": self._store.generate_msgdef(type_name, ros_version=2)[0],
            "type_hash": "TypeHashNotSupported" if humble else self._store.hash_rihs01(type_name),
            "qos": QosProfile(durability=durability),
            **self._at,
        }


def main() -> None:
    port, domain = map(int, sys.argv[1:])
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # the client prints as well
    node = _Node(port, domain)
    node.topics()  # opens its session
    print(READY, file=answers, flush=True)
    for line in sys.stdin:
        command = json.loads(line)
        answer = getattr(node, command.pop("verb"))(**command)
        print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    main()
