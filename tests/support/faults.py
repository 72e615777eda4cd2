"""Faults to plant in the program or in a golden case, for one test each."""

import inspect
import json
import textwrap
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba.core.registry import CPUDispatcher

from pipeline.evaluation import errors as evaluation
from pipeline.exploration import reproduce
from pipeline.exploration.episode import GuidedRun, start_posture
from pipeline.learner.rules.reservoir import kernels, learner, network
from pipeline.robot.config import RobotConfig, load_robot
from pipeline.samples.rules import commanded
from pipeline.simulation.simulation import Simulation
from pipeline.training import run as learning_run
from recorders.messages.message_types import JointState
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS, SESSION_PHASE
from recorders.reading.reader import LogReader
from recorders.ticks.joiner import JointMap
from recorders.writing.writer import RESERVED, LogWriter
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay

Patch = pytest.MonkeyPatch


@dataclass(frozen=True)
class Fault:
    """What is planted, and what a golden check must say of it: tier and field exactly, the rest as far as it is given.

    `end` is a regular expression for the element that differs at the end of the epoch; without it there is none.
    `expected` and `found` are given where they are the same on every machine; the last bits of a simulation are not.
    """

    name: str
    plant: Callable[[Patch, Path], None]
    tier: str
    field: str
    place: dict[str, Any]
    end: str = ""
    expected: str = ""
    found: str = ""
    note: str = ""


def use_plain_kernels(patch: Patch) -> None:
    """Run the kernels as the Python that they are written in, so that each of them can be replaced."""
    for name, kernel in vars(kernels).copy().items():
        if isinstance(kernel, CPUDispatcher):
            patch.setattr(kernels, name, kernel.py_func)


def rewritten(function: Callable[..., Any], old: str, new: str) -> Callable[..., Any]:
    """Return a function made anew from its source, with one expression replaced."""
    source = textwrap.dedent(inspect.getsource(function))
    assert source.count(old) == 1, f"{function.__qualname__}: expected {old!r} once"
    source = source[source.index("def ") :]  # less its decorator
    scope: dict[str, Any] = {}
    exec(compile(source.replace(old, new), f"<{function.__qualname__}>", "exec"), function.__globals__, scope)
    made: Callable[..., Any] = scope[function.__name__]
    return made


def rewrite(patch: Patch, owner: Any, name: str, old: str, new: str) -> None:
    patch.setattr(owner, name, rewritten(getattr(owner, name), old, new))


def log_of(folder: Path) -> Path:
    return next(folder.glob("*.mcap"))


def rewrite_log(folder: Path, change: Callable[[int, RecordedMessage], Sequence[RecordedMessage]]) -> None:
    """Write the log of a case again, with each record, by its place, as what `change` makes of it."""
    path = log_of(folder)
    reader = LogReader(path)
    records = list(reader)
    attachments = {name: reader.attachment(name) for name in reader.attachments}
    manifest = {key: value for key, value in reader.manifest.items() if key not in RESERVED}
    with LogWriter(path, manifest=manifest, attachments=attachments, overwrite=True) as writer:
        for place, record in enumerate(records):
            for changed in change(place, record):
                writer.copy(changed)


# In the kernels.


def exp_off_by_a_bit(patch: Patch, folder: Path) -> None:
    right = kernels.exp
    patch.setattr(kernels, "exp", lambda x: np.nextafter(right(x), np.inf))


def sum_reordered(patch: Patch, folder: Path) -> None:
    rewrite(patch, kernels, "sum_sources", "range(weights.shape[1])", "range(weights.shape[1] - 1, -1, -1)")


def plasticity_on_outputs(patch: Patch, folder: Path) -> None:
    a, b = np.ones(21), np.zeros(21)
    patch.setattr(kernels, "fermi_outputs", lambda x, y: kernels.fermi(x, a, b, y))
    right = kernels.intrinsic_plasticity

    def both(x: Any, y: Any, *rest: Any) -> None:
        right(x, y, *rest)
        outputs = inspect.currentframe().f_back.f_locals  # type: ignore[union-attr]  # those of `run`
        right(outputs["x_output"], outputs["y_output"], a, b, *rest[2:])

    patch.setattr(kernels, "intrinsic_plasticity", both)


def score_after_update(patch: Patch, folder: Path) -> None:
    old = "teach(d[k], inputs, feedback_slot, output_sources, constants, state)"
    rewrite(
        patch, kernels, "run", old, f"{old}; sum_sources(state.output_weights, output_sources, state.z, predicted[k])"
    )


# In the learner and what feeds it.


def rates_of_the_next_epoch(patch: Patch, folder: Path) -> None:
    old = "config, self._epoch = self.config, epoch"
    rewrite(patch, learner.Learner, "_set_rates", old, f"{old}; epoch += 1")


def float32_rates(patch: Patch, folder: Path) -> None:
    rewrite(patch, learner.Learner, "_set_rates", "dtype=np.float64", "dtype=np.float32")


def float32_inputs(patch: Patch, folder: Path) -> None:
    rewrite(patch, learner.Learner, "_run", "u - self.input_centre", "(u - self.input_centre).astype(np.float32)")


def float32_weights(patch: Patch, folder: Path) -> None:
    right = network.symmetric_uniforms
    patch.setattr(network, "symmetric_uniforms", lambda *path, **of: right(*path, **of).astype(np.float32))


def wrong_seed(patch: Patch, folder: Path) -> None:
    right = network.symmetric_uniforms
    patch.setattr(network, "symmetric_uniforms", lambda seed, *path, **of: right(seed + 1, *path, **of))


def wrong_centring(patch: Patch, folder: Path) -> None:
    patch.setattr(RobotConfig, "input_centre", property(lambda robot: np.zeros(6)))


def swapped_hands(patch: Patch, folder: Path) -> None:
    right = commanded.CommandedPairs.fill

    def fill(self: Any, tick: Any, u: Any, d: Any) -> bool:
        return right(self, tick._replace(hands=tick.hands[::-1]), u, d)

    patch.setattr(commanded.CommandedPairs, "fill", fill)


def permuted_joints(patch: Patch, folder: Path) -> None:
    right = JointMap.positions
    patch.setattr(JointMap, "positions", lambda self, joints: np.roll(right(self, joints), 1))


def learning_during_washout(patch: Patch, folder: Path) -> None:
    rewrite(patch, learning_run.LearningRun, "_step", "phase == LEARN", "phase != EVALUATE")


def washout_cycle_skipped(patch: Patch, folder: Path) -> None:
    right = Schedule.cycles_of_epoch
    patch.setattr(Schedule, "cycles_of_epoch", lambda self: iter(list(right(self))[1:]))


def washout_before_trials_skipped(patch: Patch, folder: Path) -> None:
    patch.setattr(evaluation, "WASHOUT_STEPS", 0)


def pending_forgotten_by_checkpoints(patch: Patch, folder: Path) -> None:
    patch.setattr(commanded.CommandedPairs, "resume", lambda self, pending: None)


def maximum_for_mean(patch: Patch, folder: Path) -> None:
    rewrite(patch, learning_run.LearningRun, "_end_presentation", ".mean(axis=0)", ".max(axis=0)")


def trial_of_the_wrong_hand(patch: Patch, folder: Path) -> None:
    right = evaluation.hand_errors
    patch.setattr(evaluation, "hand_errors", lambda k, joints, targets: right(k, joints, np.roll(targets, 3, axis=1)))


# In the replay.


def _presenting(patch: Patch, change: Callable[[int, RecordedMessage], Sequence[RecordedMessage]]) -> None:
    """Change messages of the fourth presentation, by their place in it; the phase marker is at 0."""
    right = Replay.stream

    def changed(replay: Replay) -> Iterator[RecordedMessage]:
        presentation, place = -1, 0
        for message in right(replay):
            begins = message.topic == SESSION_PHASE
            presentation, place = presentation + begins, 0 if begins else place + 1
            yield from change(place, message) if presentation == 3 else [message]

    patch.setattr(Replay, "stream", lambda replay, start=0: islice(changed(replay), start, None))


def message_dropped(patch: Patch, folder: Path) -> None:
    _presenting(patch, lambda place, message: [] if place == 6 else [message])


def message_repeated(patch: Patch, folder: Path) -> None:
    _presenting(patch, lambda place, message: [message] * (2 if place == 6 else 1))


def message_changed(patch: Patch, folder: Path) -> None:
    def changed(message: RecordedMessage) -> RecordedMessage:
        data = bytearray(message.data)
        data[-8 * 7] ^= 1  # the last bit of x: a pose ends with seven numbers
        return message._replace(data=bytes(data))

    _presenting(patch, lambda place, message: [changed(message) if place == 4 else message])


# In teacher and simulation.


def changed_link(patch: Patch, folder: Path) -> None:

    def longer(name: str) -> RobotConfig:
        robot = load_robot(name)
        lines = robot.urdf_text.split("\n")
        place = next(n for n, line in enumerate(lines) if '<origin xyz="0 0 -0.21"' in line)
        lines[place] = lines[place].replace("-0.21", "-0.2101")
        return replace(robot, urdf_text="\n".join(lines))

    patch.setattr(reproduce, "load_robot", longer)


def no_gravity_feed_forward(patch: Patch, folder: Path) -> None:
    rewrite(patch, Simulation, "_demand", "self._joints.gravity(self._context)", "0.0")


def another_start_posture(patch: Patch, folder: Path) -> None:
    patch.setattr(
        reproduce, "start_posture", lambda robot, *, seed, spread: start_posture(robot, seed=9, spread=spread)
    )


def _simulating(patch: Patch, count: int) -> None:
    right = GuidedRun.cycle
    patch.setattr(GuidedRun, "cycle", lambda self, plan: islice(right(self, plan), count))


def simulation_makes_nothing(patch: Patch, folder: Path) -> None:
    _simulating(patch, 0)


def simulation_stops_early(patch: Patch, folder: Path) -> None:
    _simulating(patch, 12)


def simulation_without_positions(patch: Patch, folder: Path) -> None:
    right = reproduce.simulate

    def simulate(log: Path, *, ticks: int) -> Iterator[Any]:
        for topic, message in right(log, ticks=ticks):
            yield topic, replace(message, position=np.empty(0)) if isinstance(message, JointState) else message

    patch.setattr(reproduce, "simulate", simulate)


def simulation_crashes(patch: Patch, folder: Path) -> None:
    rewrite(patch, Simulation, "_demand", "self._joints", "None")


# In the case.


def log_cut_off(patch: Patch, folder: Path) -> None:
    path = log_of(folder)
    path.write_bytes(path.read_bytes()[:-700])


def log_lacks_a_message(patch: Patch, folder: Path) -> None:
    rewrite_log(folder, lambda place, record: [] if place == 11 else [record])


def log_repeats_a_message(patch: Patch, folder: Path) -> None:
    rewrite_log(folder, lambda place, record: [record] * (2 if place == 11 else 1))


def log_with_another_message(patch: Patch, folder: Path) -> None:
    def changed(place: int, record: RecordedMessage) -> list[RecordedMessage]:
        return [record._replace(data=record.data[:-1] + b"\x01") if place == 11 else record]

    rewrite_log(folder, changed)


def log_made_by_another_version(patch: Patch, folder: Path) -> None:
    rewrite_log(folder, lambda place, record: [record])


def other_settings(patch: Patch, folder: Path) -> None:
    path = folder / "case.json"
    values = json.loads(path.read_text())
    values["learner"]["seed"] += 1
    path.write_text(json.dumps(values))


def states_damaged(patch: Patch, folder: Path) -> None:
    path = folder / "states.npz"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(bytes(data))


def _learning(name: str, plant: Any, field: str, end: str = "", **place: Any) -> Fault:
    """Return a fault that shows at a tick of the first epoch."""
    return Fault(name, plant, "learning", field, {"epoch": 0, "log": "small.mcap", **place}, end)


def _stream(name: str, plant: Any, topic: str, field: str, expected: str, found: str, note: str) -> Fault:
    """Return a fault of a message of the fourth presentation."""
    place = {"epoch": 0, "cycle": 3, "phase": "learn", "log": "small.mcap", "topic": topic, "sequence": 1}
    return Fault(name, plant, "learning", field, place, expected=expected, found=found, note=note)


def _physics(name: str, plant: Any, field: str, **more: Any) -> Fault:
    """Return a fault of the first joints that are simulated."""
    place = {"log": "small.mcap", "topic": SAMPLE_JOINTS, "sequence": 0, "stamp_ns": 200_000_000}
    return Fault(name, plant, "physics", field, place, **more)


def _absent(name: str, plant: Any, sequence: int) -> Fault:
    """Return a fault by which the simulation does not make a message."""
    place = {"log": "small.mcap", "topic": LEFT_TARGET, "sequence": sequence}
    return Fault(name, plant, "physics", "message", place, expected="present", found="absent")


def _log(name: str, plant: Any, expected: str, found: str, note: str) -> Fault:
    """Return a fault of the twelfth message of the log."""
    place = {"log": "small.mcap", "topic": RIGHT_TARGET, "sequence": 2}
    return Fault(name, plant, "log", "message", place, expected=expected, found=found, note=note)


def _whole(name: str, plant: Any, field: str) -> Fault:
    """Return a fault of what comes of the whole run."""
    return Fault(name, plant, "learning", field, {}, note="of the whole run")


_ANY, _FIRST, _SECOND = r"\w+_weights\[\d+\]", r"input_output_weights\[0\]", r"input_output_weights\[1\]"
_DRAWN = r"input_reservoir_weights\[0\]: expected 0\.06260888483071246, found "
_OTHERWISE = _DRAWN + r"-0\.034361481345521284"
_INSTEAD = "(/hand/left/target #2 in its place)"
_HIP = "position[0] (hip_height)"

FAULTS = (
    _learning("last bit of exp", exp_off_by_a_bit, "state", _ANY, cycle=0, tick=0),
    _learning("sum reordered", sum_reordered, "state", _ANY, cycle=0, tick=1),
    _learning("swapped hands", swapped_hands, "state", _SECOND, cycle=0, tick=0),
    _learning("permuted joints", permuted_joints, "state", _SECOND, cycle=0, tick=1),
    _learning("rates off by one epoch", rates_of_the_next_epoch, "state", _SECOND, cycle=1, tick=1),
    _learning("IP on outputs", plasticity_on_outputs, "state", _SECOND, cycle=1, tick=2),
    _learning("score after update", score_after_update, "outputs", cycle=1, tick=1),
    _learning("float32 rates", float32_rates, "state", _SECOND, cycle=1, tick=1),
    _learning("float32 inputs", float32_inputs, "outputs", _SECOND, cycle=0, tick=1),
    _learning("float32 weights", float32_weights, "state", _DRAWN + r"0\.06260888278484344", cycle=0, tick=0),
    _learning("wrong seed", wrong_seed, "state", _OTHERWISE, cycle=0, tick=0),
    _learning("other settings", other_settings, "state", _OTHERWISE, cycle=0, tick=0),
    _learning("wrong centring", wrong_centring, "outputs", _FIRST, cycle=0, tick=1),
    _learning("washout learned", learning_during_washout, "state", _SECOND, cycle=0, phase="washout", tick=1),
    _learning("washout skipped", washout_cycle_skipped, "data", cycle=0, topic="/session/phase", sequence=0),
    _learning("checkpoint", pending_forgotten_by_checkpoints, "outputs", _SECOND, cycle=3, tick=4),
    _whole("trial without washout", washout_before_trials_skipped, "trials_cm"),
    _whole("errors: maximum", maximum_for_mean, "train_cm"),
    _whole("errors: wrong hand", trial_of_the_wrong_hand, "trials_cm"),
    _stream("dropped", message_dropped, SAMPLE_JOINTS, "message", "present", f"absent {_INSTEAD}", "missing"),
    _stream("repeated", message_repeated, SAMPLE_JOINTS, "message", f"absent {_INSTEAD}", "present", "extra"),
    _stream("changed", message_changed, LEFT_TARGET, "pose.position.x", "0.32", "0.31999999999999995", "changed"),
    _physics("changed URDF link", changed_link, _HIP, note="robot.urdf line"),
    _physics("no feed-forward", no_gravity_feed_forward, _HIP),
    _physics("start posture", another_start_posture, _HIP),
    _physics("no positions", simulation_without_positions, "len(position)", expected="15", found="0"),
    _absent("nothing simulated", simulation_makes_nothing, 0),
    _absent("simulation stops early", simulation_stops_early, 1),
    Fault("simulation crashes", simulation_crashes, "physics", "simulation", {"log": "small.mcap"}),
    Fault("truncated log", log_cut_off, "log", "file", {"log": "small.mcap"}),
    _log("log lacks one", log_lacks_a_message, "present", "absent", "missing, or moved"),
    _log("log repeats one", log_repeats_a_message, "once", "again", "repeated"),
    _log("log changed", log_with_another_message, "", "", "changed"),
    Fault("states damaged", states_damaged, "case", "file", {}),
)
