"""One seed: its world is made, meets its faults, and comes to its end, or to a broken promise."""

from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

from recorders.messages.record import RecordedMessage
from recorders.messages.topics import type_of
from simulation.consumers import Source
from simulation.limits import lowered_limits
from simulation.network import Network
from simulation.node import Node
from simulation.peer import Peer
from simulation.promises import Promises
from simulation.receiver_node import ReceiverNode
from simulation.scenario import OUTAGES, SENDER, Fault, Scenario, draw_faults, draw_scenario, is_timed
from simulation.sender_node import SenderNode
from simulation.world import SECOND, BrokenPromiseError, World, draws

_MOST_EVENTS = 100_000  # a hundred times those of a common seed
_MOST_NS = 1_000 * SECOND  # after the last fault that has its time
_TOPICS = ("/hand/left/target", "/hand/right/target", "/sample/joints", "/of/others")
_OTHER_TYPE = "others/msg/Other"  # of a topic of which the type is not known


class Outcome(NamedTuple):
    """What came of a seed.

    `broken` is the promise that did not hold and `found` how; both are empty if all did. `occurred` counts the
    faults by kind, `errors` are those that sender and consumers stated, `ended_ns` is when it was over.
    """

    seed: int
    broken: str
    found: str
    occurred: Counter[str]
    errors: tuple[str, ...]
    events: int
    ended_ns: int


def run_seed(seed: int) -> Outcome:
    """Simulate a seed."""
    scenario = draw_scenario(seed)
    return simulate(scenario, draw_faults(scenario))


def simulate(scenario: Scenario, faults: Sequence[Fault], *, trace: Callable[[str], None] | None = None) -> Outcome:
    """Let a scenario meet its faults; `trace` takes a line for everything that happens."""
    simulation = Simulation(scenario, faults)
    simulation.world.trace = trace
    broken = found = ""
    try:
        with lowered_limits(window_bytes=scenario.window_bytes):
            simulation.run()
    except BrokenPromiseError as error:
        broken, found = error.promise, str(error)
    except Exception as error:  # a machine failed, whatever with
        broken, found = f"no {type(error).__name__}", repr(error)
    world = simulation.world
    return Outcome(scenario.seed, broken, found, simulation.occurred, simulation.errors(), world.events, world.now_ns)


class Simulation:
    """A scenario and its faults, and the world in which they meet.

    Parameters
    ----------
    faults : sequence of Fault
        All of a seed's, or some of them.
    """

    def __init__(self, scenario: Scenario, faults: Sequence[Fault]) -> None:
        timed = [fault for fault in faults if is_timed(fault)]
        last_ns = max((fault.at + abs(fault.amount) for fault in timed if fault.kind in OUTAGES), default=0)
        self.occurred: Counter[str] = Counter()
        self.world = World(most_events=_MOST_EVENTS, until_ns=last_ns + _MOST_NS)
        source = draw_source(scenario)
        network = Network(self.world, latency_ns=scenario.latency_ns, faults=faults, occurred=self.occurred)
        parts: dict[str, Any] = {"network": network, "faults": faults, "occurred": self.occurred}
        self._network = network
        self._receivers = {
            plan.name: ReceiverNode(self.world, plan, source, seed=scenario.seed, **parts)
            for plan in scenario.consumers
        }
        receivers = tuple(self._receivers.values())
        self._sender = SenderNode(self.world, scenario, source, receivers=receivers, **parts)
        self._promises = Promises(scenario, source, sender=self._sender, receivers=receivers, faults=faults)
        self._peer = Peer(network=network, sender=self._sender, receivers=receivers)
        self._sender.check = self._promises.check_sender
        self._sender.check_error = self._promises.check_error
        for receiver in receivers:
            receiver.acknowledged, receiver.aborts = self._sender.acknowledged, self._sender.aborts
            receiver.check = partial(self._promises.check_receiver, receiver)
        self._nodes: dict[str, Node] = {SENDER: self._sender, **self._receivers}
        for fault in timed:
            self.world.at(fault.at, self._meet, fault)

    def run(self) -> None:
        """Let it happen, and check every promise.

        Raises
        ------
        BrokenPromiseError
            If one does not hold.
        """
        for node in self._nodes.values():
            node.begin()
        self.world.run(over=self._over)
        self._promises.check_end(self._sender.ended_ns, self.world.now_ns)

    def errors(self) -> tuple[str, ...]:
        """Return what sender and consumers stated as their reasons to give up."""
        return (*self._sender.errors, *(error for each in self._receivers.values() for error in each.errors))

    def _over(self) -> bool:
        return self._sender.results is not None and all(
            receiver.is_up and receiver.machine.released for receiver in self._receivers.values()
        )

    def _meet(self, fault: Fault) -> None:
        """Let a fault occur whose time has come."""
        kind, node = fault.kind, self._nodes[fault.where]
        if kind == "cut":
            self._network.cut(fault.where, fault.amount)
        elif kind == "stall":
            node.stall(fault.amount)
        elif kind == "clock jump":
            node.jump(fault.amount)
        elif kind == "disk full":
            self._fill_disk(fault)
        elif kind == "impostor":
            self._sender.meet_impostor(fault)
        elif not self._peer.meddle(fault):
            return
        self.world.note(f"{fault.where}: {kind}, {fault.amount}")
        self.occurred[kind] += 1

    def _fill_disk(self, fault: Fault) -> None:
        consumer = self._receivers[fault.where].consumer
        consumer.disk_full = True
        self.world.after(fault.amount, setattr, consumer, "disk_full", False)


def draw_source(scenario: Scenario) -> Source:
    """Return the stream of a scenario."""
    draw = draws(scenario.seed, "source")
    messages = []
    for index in range(scenario.messages):
        topic, data = draw.choice(_TOPICS), draw.randbytes(draw.randint(0, scenario.most_bytes))
        messages.append(
            RecordedMessage(topic, type_of(topic) or _OTHER_TYPE, data, index, 10 * index + draw.randrange(10))
        )
    return Source(draw.randbytes(16).hex(), messages)
