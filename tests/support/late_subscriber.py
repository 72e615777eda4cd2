"""A subscriber with a history, as the bridge to ROS 2 has for a topic that is transient local; run as a script."""

import hashlib
import json
import subprocess
import sys
import time

import zenoh
from zenoh.ext import HistoryConfig, declare_advanced_subscriber

from recorders.wire.session import SessionConfig, open_session

_WAIT_S = 120.0
_LINGER_S = 0.5  # in which a second copy would come


def subscribe(endpoint: str, key: str) -> subprocess.Popen[str]:
    """Start one in a process of its own; it says that it is ready, then a line of JSON about what it got."""
    return subprocess.Popen([sys.executable, __file__, endpoint, key], stdout=subprocess.PIPE, text=True)


def main() -> None:
    endpoint, key = sys.argv[1:]
    got: list[zenoh.Sample] = []
    history = HistoryConfig(detect_late_publishers=True, max_samples=1)
    with (
        open_session(SessionConfig(connect=(endpoint,), wait_s=_WAIT_S)) as session,
        declare_advanced_subscriber(session, key, got.append, history=history, allowed_origin=zenoh.Locality.REMOTE),
    ):
        print("ready", flush=True)
        deadline_s = time.monotonic() + _WAIT_S
        while not got and time.monotonic() < deadline_s:
            time.sleep(0.01)
        time.sleep(_LINGER_S)
        print(
            json.dumps(
                {
                    "sha256": [hashlib.sha256(sample.payload.to_bytes()).hexdigest() for sample in got],
                    "encoding": [str(sample.encoding) for sample in got],
                }
            )
        )


if __name__ == "__main__":
    main()
