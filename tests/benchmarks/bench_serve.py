"""`serve` beside a bare Zenoh echo of the same bytes, target to command: python tests/benchmarks/bench_serve.py.

Processes on loopback: a driver, `reenact serve`, the same with `--ros`, three echoes. All connect to the driver, as
they would to a robot; with `--listen`, the driver connects to them. It puts the two targets of a tick at 1 kHz and
takes the time until the command of that stamp is back. An echo subscribes to the same keys and answers the second
target with a command of the same size, with the same attachment and quality of service, that it does not compute. The
first has plain callbacks, as Zenoh's own ping-pong example does; the second has them called on the thread that reads
from the network; the third has its callbacks and threads as `serve` has them, to show what there is to gain at all.
Rounds take turns, so that a slow moment of the machine hits all. Nothing is asserted. Where other machines share the
processor, p5 says more of the program than p50 does, and late ticks come in bursts: of these, only sums over several
runs say something.

After that, or with `--page` alone, `reenact play` has a simulated robot and a served controller at 50 Hz go through a
motion, and a process of its own notes when states, targets and commands arrive. Nobody looks on, a client that takes
every picture of the page and draws none, or Chromium that draws them in software on the same processors, if there is
one: in turns, in one run, each as a ratio to the same round without a visitor.
"""

import random
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, nullcontext
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import zenoh

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
from chromium import drawn_page, find_chromium
from command_watch import watched_commands
from page_client import PageClient
from small_inverse import taught
from visit import shown_page
from waiting import wait_until

from pipeline.browser.session.play import FIRST_MOTION, PlayConfig
from pipeline.learner.controller import Controller
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.learner.rules.reservoir.learner import Learner
from pipeline.motions.patterns.circles import circles
from pipeline.robot.config import load_robot
from recorders.cdr.codec import encode, stamp_ns
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.topics import JOINT_COMMANDS, JOINT_STATES, LEFT_TARGET, RIGHT_TARGET
from recorders.protocol.frames import live_attachment
from recorders.rmw_zenoh.attachment import Attachment
from recorders.rmw_zenoh.names import NodeName
from recorders.wire.callbacks import on_network_thread
from recorders.wire.keys.namespace import message_key
from recorders.wire.keys.ros_keys import RosKeys
from recorders.wire.keys.topic_keys import NamespaceKeys, TopicKeys
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session, single_network_thread

Handler = Callable[[zenoh.Sample], None]
Declare = Callable[[Any], AbstractContextManager[Any]]

NAMESPACE = "reenact"
TARGETS, PERIOD_NS = 200, 1_000_000
ROUNDS = 60
ECHOES: dict[str, Callable[[Declare, Handler], AbstractContextManager[Any]]] = {
    "echo": lambda declare, handler: declare(handler),
    "direct echo": lambda declare, handler: declare(zenoh.handlers.Callback(handler, indirect=False)),
    "best echo": on_network_thread,
}
DOMAIN = 7
SERVED: dict[str, tuple[TopicKeys, list[str]]] = {
    "serve": (NamespaceKeys(NAMESPACE), []),
    "serve --ros": (RosKeys(DOMAIN, NodeName("driver")), ["--ros", str(DOMAIN)]),
}
LISTEN = "--listen"
PAGE = "--page"
PAGE_ROUNDS, PAGE_ROUND_S = 10, 4.0
PATIENCE_S = 2.0  # what is not back by then is lost
LATE_US = 1000.0
LOST_US = float("inf")
QUALITY = {"congestion_control": zenoh.CongestionControl.DROP, "priority": zenoh.Priority.REAL_TIME}


def trained() -> Controller:
    """Return a controller that has learned to stand still, so that its commands are within the limits as usual."""
    robot = load_robot("asimo")
    centre = np.concatenate([robot.input_centre, robot.comfort])
    learner = Learner(LearnerConfig(), input_centre=robot.input_centre, output_centre=centre)
    u = circles(robot).targets.reshape(-1, 6)
    for _ in range(20):
        learner.step(u, np.column_stack([u, np.tile(robot.comfort, (len(u), 1))]), learning=True)
    texts = {"robot_toml": robot.toml_text, "robot_urdf": robot.urdf_text}
    return Controller.from_learner(learner, joints=robot.joints, **texts)


def session_at(endpoint: str, *, listens: bool) -> SessionConfig:
    return SessionConfig(listen=(endpoint,)) if listens else SessionConfig(connect=(endpoint,))


def echo(name: str, session_config: SessionConfig) -> None:
    """Answer the right target with the bytes of a command, stamped as the target is."""
    answer = encode(JointState(0, load_robot("asimo").joints, np.zeros(15)))
    reply = live_attachment(0, 0)

    def on_left(sample: zenoh.Sample) -> None:
        sample.payload.to_bytes()

    def on_right(sample: zenoh.Sample) -> None:
        publisher.put(answer[:4] + sample.payload.to_bytes()[4:12] + answer[12:], attachment=reply)

    with ExitStack() as stack:
        if name == "best echo" and not session_config.listen:
            stack.enter_context(single_network_thread())
        session = stack.enter_context(open_session(session_config))
        publisher = session.declare_publisher(message_key(NAMESPACE, JOINT_COMMANDS), **QUALITY)
        for topic, handler in ((LEFT_TARGET, on_left), (RIGHT_TARGET, on_right)):
            subscribe = partial(session.declare_subscriber, message_key(NAMESPACE, topic))
            stack.enter_context(ECHOES[name](subscribe, handler))
        sys.stdin.read()


class Driver:
    """Puts targets at 1 kHz and notes when their commands are back."""

    def __init__(self, session: zenoh.Session, keys: TopicKeys, stack: ExitStack) -> None:
        self._back: dict[int, int] = {}
        self._in_ros = isinstance(keys, RosKeys)
        subscribe = partial(session.declare_subscriber, keys.key(JOINT_COMMANDS, JointState.TYPE))
        stack.enter_context(on_network_thread(subscribe, self._on_command))
        targets = [keys.key(topic, PoseStamped.TYPE) for topic in (LEFT_TARGET, RIGHT_TARGET)]
        self._targets = [session.declare_publisher(key, **QUALITY) for key in targets]
        deadline = time.monotonic() + 60.0
        while not all(publisher.matching_status.matching for publisher in self._targets):  # type: ignore[attr-defined]
            if time.monotonic() > deadline:
                raise SystemExit("nobody subscribes to the targets")
            time.sleep(0.01)
        self._sent = 0
        self._motion = circles(load_robot("asimo")).targets

    def _on_command(self, sample: zenoh.Sample) -> None:
        now = time.perf_counter_ns()
        self._back[stamp_ns(JointState.TYPE, sample.payload.to_bytes()) or 0] = now

    def round(self) -> list[float]:
        """Return the time from target to command of each tick [us]; infinite if it never came."""
        prepared = [self._prepare() for _ in range(TARGETS)]  # now: later it would hold up the taking of the time
        put: dict[int, int] = {}
        due = time.perf_counter_ns()
        for stamp, samples in prepared:
            due += PERIOD_NS
            time.sleep(max(0, due - time.perf_counter_ns()) / 1e9)
            put[stamp] = time.perf_counter_ns()
            for publisher, (message, label) in zip(self._targets, samples, strict=True):
                publisher.put(message, attachment=label)
        patience = time.monotonic() + PATIENCE_S
        while not put.keys() <= self._back.keys() and time.monotonic() < patience:
            time.sleep(0.02)
        return [(self._back[stamp] - at) / 1e3 if stamp in self._back else LOST_US for stamp, at in put.items()]

    def _prepare(self) -> tuple[int, list[tuple[bytes, bytes]]]:
        self._sent += 1
        stamp = self._sent * PERIOD_NS
        hands = self._motion[self._sent % len(self._motion)]
        label = live_attachment(self._sent, 0)
        if self._in_ros:
            label = Attachment(self._sent, time.time_ns(), bytes(16)).pack() + label
        return stamp, [(encode(PoseStamped(stamp, hand)), label) for hand in hands]


def show(times: dict[str, list[list[float]]]) -> None:
    everything = {name: sorted(chain.from_iterable(rounds)) for name, rounds in times.items()}
    print(f"two targets to one command, 1 kHz, {ROUNDS} rounds of {TARGETS}")
    for name, values in everything.items():
        p5, p50, p99 = (values[len(values) * percent // 100] for percent in (5, 50, 99))
        late, lost = sum(v > LATE_US for v in values), sum(v == LOST_US for v in values)
        print(
            f"{name:11s} p5 {p5:7.1f} us   p50 {p50:7.1f} us   p99 {p99:8.1f} us   "
            f"later than 1 ms: {late} of {len(values)} (lost {lost})"
        )
    for name, to in (*(("serve", echo) for echo in ECHOES), ("serve --ros", "serve")):
        pairs = zip(times[name], times[to], strict=True)
        differences = [statistics.median(served) - statistics.median(other) for served, other in pairs]
        low, middle, high = statistics.quantiles(differences, n=4)
        print(f"{name} adds {middle:.1f} us to {to} (p50, median over rounds; half of them {low:.1f} to {high:.1f})")


def beside_visitors() -> None:
    """Measure what a visitor of the page of `play` costs a command of a controller that is served to its robot."""
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        controller = Path(name) / "learned.npz"
        taught().save(controller)
        page = stack.enter_context(shown_page(PlayConfig(robot="asimo", controllers=(controller,), folder=Path(name))))
        wait_until(lambda: page.play.link.controller == controller.stem)
        page.play.go_through(FIRST_MOTION)
        place = page.play.recordings.place
        watch = stack.enter_context(watched_commands(place.endpoints[0], place.namespace))
        visitors: dict[str, Callable[[], AbstractContextManager[object]]] = {
            "no visitor": nullcontext,
            "a client": partial(PageClient, page.address),
        }
        if find_chromium() is not None:
            visitors["a browser"] = partial(drawn_page, page.address)
        times: dict[str, list[dict[str, list[float]]]] = {visitor: [] for visitor in visitors}
        turns = random.Random(0)
        for _ in range(PAGE_ROUNDS):
            for visitor in turns.sample(list(visitors), len(visitors)):
                with visitors[visitor]():
                    watch.take()
                    time.sleep(PAGE_ROUND_S)
                    times[visitor].append(watch.take())
    show_visitors(times)


def show_visitors(times: dict[str, list[dict[str, list[float]]]]) -> None:
    print(f"the page's robot at 50 Hz, {PAGE_ROUNDS} rounds of {PAGE_ROUND_S:g} s")
    for begin in (RIGHT_TARGET, JOINT_STATES):
        for visitor, rounds in times.items():
            values = sorted(chain.from_iterable(found[begin] for found in rounds))
            p50, p99 = (values[len(values) * percent // 100] for percent in (50, 99))
            medians = [
                statistics.median(found[begin]) / statistics.median(alone[begin])
                for found, alone in zip(rounds, times["no visitor"], strict=True)
            ]
            low, middle, high = statistics.quantiles(medians, n=4)
            print(
                f"{begin} to command, {visitor:10s} p50 {p50:7.1f} us   p99 {p99:8.1f} us   {len(values)} commands   "
                f"p50 {middle:.2f} times as without a visitor (half of the rounds {low:.2f} to {high:.2f})"
            )


def main(*, listens: bool) -> None:
    times: dict[str, list[list[float]]] = {name: [] for name in (*ECHOES, *SERVED)}
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        trained().save(folder / "controller.npz")
        drivers: dict[str, Driver] = {}
        for name in times:
            endpoint = free_endpoint()
            role = LISTEN if listens else "--connect"
            keys, options = SERVED.get(name, (NamespaceKeys(NAMESPACE), []))
            verb = ["-m", "pipeline", "serve", str(folder / "controller.npz"), *options]
            command = [sys.executable, *(verb if name in SERVED else [__file__, name]), role, endpoint]
            process = stack.enter_context(subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.DEVNULL))
            stack.callback(process.kill)
            session = stack.enter_context(open_session(session_at(endpoint, listens=not listens)))
            drivers[name] = Driver(session, keys, stack)
        for driver in drivers.values():
            driver.round()
        turns = random.Random(0)
        for _ in range(ROUNDS):
            for name in turns.sample(list(drivers), len(drivers)):
                times[name].append(drivers[name].round())
    show(times)


if __name__ == "__main__":
    if sys.argv[1:] in ([], [LISTEN]):
        main(listens=sys.argv[1:] == [LISTEN])
        if not sys.argv[1:]:
            beside_visitors()
    elif sys.argv[1:] == [PAGE]:
        beside_visitors()
    else:
        _, name, role, endpoint = sys.argv
        echo(name, session_at(endpoint, listens=role == LISTEN))
