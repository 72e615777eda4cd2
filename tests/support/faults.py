"""Faults to plant in the program or in a golden case, for one test each."""

import inspect
import json
import textwrap
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba.core.registry import CPUDispatcher

from pipeline import evaluation, golden_simulation, kernels, learner, learning_run, network, samples, trials
from pipeline.robot import RobotConfig
from recorders.reader import LogReader
from recorders.records import Stamped
from recorders.ticks import JointMap
from recorders.writer import RESERVED, LogWriter
from replay.engine import Replay
from replay.schedule import Schedule

Patch = pytest.MonkeyPatch


@dataclass(frozen=True)
class Fault:
    """What is planted, and what a golden check must say of it; of place and note, as much as is given."""

    name: str
    plant: Callable[[Patch, Path], None]
    tier: str
    field: str  # a regular expression
    place: dict[str, Any]
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


def rewrite_log(folder: Path, change: Callable[[int, Stamped], Sequence[Stamped]]) -> None:
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
    rewrite(patch, kernels, "listen", "range(weights.shape[1])", "range(weights.shape[1] - 1, -1, -1)")


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
    rewrite(patch, kernels, "run", old, f"{old}; listen(state.output_weights, output_sources, state.z, predicted[k])")


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
    rewrite(patch, samples.CommandedPairs, "fill", "tick.left", "tick.right.copy()")


def permuted_joints(patch: Patch, folder: Path) -> None:
    right = JointMap.positions
    patch.setattr(JointMap, "positions", lambda self, joints: np.roll(right(self, joints), 1))


def learning_during_washout(patch: Patch, folder: Path) -> None:
    rewrite(patch, learning_run.LearningRun, "_flush", "self._phase.phase == LEARN", "self._phase.phase != EVALUATE")


def washout_cycle_skipped(patch: Patch, folder: Path) -> None:
    right = Schedule.epoch
    patch.setattr(Schedule, "epoch", lambda self: iter(list(right(self))[1:]))


def washout_before_trials_skipped(patch: Patch, folder: Path) -> None:
    patch.setattr(evaluation, "WASHOUT_STEPS", 0)


def pending_forgotten_by_checkpoints(patch: Patch, folder: Path) -> None:
    patch.setattr(samples.CommandedPairs, "resume", lambda self, pending: None)


def maximum_for_mean(patch: Patch, folder: Path) -> None:
    rewrite(patch, learning_run.LearningRun, "_end_presentation", ".mean(axis=0)", ".max(axis=0)")


def trial_of_the_wrong_hand(patch: Patch, folder: Path) -> None:
    right = evaluation.hand_errors
    patch.setattr(trials, "hand_errors", lambda k, joints, targets: right(k, joints, np.roll(targets, 3, axis=1)))


# In the replay.


def _presenting(patch: Patch, change: Callable[[int, Stamped], Sequence[Stamped]]) -> None:
    """Change messages of the fourth presentation, by their place in it; the phase marker is at 0."""
    right = Replay._presentation

    def presentation(number: int, *arguments: Any, **options: Any) -> Iterator[Stamped]:
        for place, message in enumerate(right(number, *arguments, **options)):
            yield from change(place, message) if number == 3 else [message]

    patch.setattr(Replay, "_presentation", staticmethod(presentation))


def message_dropped(patch: Patch, folder: Path) -> None:
    _presenting(patch, lambda place, message: [] if place == 6 else [message])


def message_repeated(patch: Patch, folder: Path) -> None:
    _presenting(patch, lambda place, message: [message] * (2 if place == 6 else 1))


def message_changed(patch: Patch, folder: Path) -> None:
    def changed(message: Stamped) -> Stamped:
        data = bytearray(message.data)
        data[-8 * 7] ^= 1  # the last bit of x: a pose ends with seven numbers
        return message._replace(data=bytes(data))

    _presenting(patch, lambda place, message: [changed(message) if place == 4 else message])


# In teacher and simulation.


def changed_link(patch: Patch, folder: Path) -> None:
    right = golden_simulation.load_robot

    def longer(name: str) -> RobotConfig:
        robot = right(name)
        lines = robot.urdf_text.split("\n")
        place = next(n for n, line in enumerate(lines) if '<origin xyz="0 0 -0.21"' in line)
        lines[place] = lines[place].replace("-0.21", "-0.2101")
        return replace(robot, urdf_text="\n".join(lines))

    patch.setattr(golden_simulation, "load_robot", longer)


def no_gravity_feed_forward(patch: Patch, folder: Path) -> None:
    old = "-self._plant.CalcGravityGeneralizedForces(self._context)[self._velocities]"
    rewrite(patch, golden_simulation.Simulation, "_drive", old, "0.0")


def another_start_posture(patch: Patch, folder: Path) -> None:
    right = golden_simulation.start_posture
    patch.setattr(
        golden_simulation, "start_posture", lambda robot, *, seed, spread: right(robot, seed=9, spread=spread)
    )


# In the case.


def log_cut_off(patch: Patch, folder: Path) -> None:
    path = log_of(folder)
    path.write_bytes(path.read_bytes()[:-700])


def log_lacks_a_message(patch: Patch, folder: Path) -> None:
    rewrite_log(folder, lambda place, record: [] if place == 11 else [record])


def log_repeats_a_message(patch: Patch, folder: Path) -> None:
    rewrite_log(folder, lambda place, record: [record] * (2 if place == 11 else 1))


def log_with_another_message(patch: Patch, folder: Path) -> None:
    def changed(place: int, record: Stamped) -> list[Stamped]:
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


FAULTS = (
    Fault("last bit of exp", exp_off_by_a_bit, "learning", r".+", {"epoch": 0, "cycle": 0, "tick": 0}),
    Fault("sum reordered", sum_reordered, "learning", r".+", {"epoch": 0, "cycle": 0}),
    Fault("swapped hands", swapped_hands, "learning", r".+", {"epoch": 0, "cycle": 0, "tick": 0}),
    Fault("permuted joints", permuted_joints, "learning", r".+", {"epoch": 0, "cycle": 0, "tick": 1}),
    Fault("rates off by one epoch", rates_of_the_next_epoch, "learning", r".+", {"epoch": 0, "cycle": 1, "tick": 1}),
    Fault("IP on outputs", plasticity_on_outputs, "learning", r".+", {"epoch": 0, "cycle": 1, "tick": 2}),
    Fault("score after update", score_after_update, "learning", r"outputs", {"epoch": 0, "cycle": 1, "tick": 1}),
    Fault("float32 rates", float32_rates, "learning", r".+", {"epoch": 0, "cycle": 1, "tick": 1}),
    Fault("float32 inputs", float32_inputs, "learning", r".+", {"epoch": 0, "cycle": 0, "tick": 1}),
    Fault("float32 weights", float32_weights, "learning", r"input_reservoir_weights\[0\]", {"cycle": 0, "tick": 0}),
    Fault("wrong seed", wrong_seed, "learning", r"input_reservoir_weights\[0\]", {"epoch": 0, "cycle": 0, "tick": 0}),
    Fault("other settings", other_settings, "learning", r".+", {"epoch": 0, "cycle": 0, "tick": 0}),
    Fault("wrong centring", wrong_centring, "learning", r".+", {"epoch": 0, "cycle": 0, "tick": 1}),
    Fault("washout learned", learning_during_washout, "learning", r".+", {"epoch": 0, "cycle": 0, "tick": 1}),
    Fault("washout skipped", washout_cycle_skipped, "learning", r"data", {"topic": "/session/phase", "sequence": 0}),
    Fault("trial without washout", washout_before_trials_skipped, "learning", r"trials_cm", {}),
    Fault("checkpoint", pending_forgotten_by_checkpoints, "learning", r".+", {"epoch": 0, "cycle": 3, "tick": 4}),
    Fault("errors: maximum", maximum_for_mean, "learning", r"train_cm|errors_cm", {}),
    Fault("errors: wrong hand", trial_of_the_wrong_hand, "learning", r"trials_cm", {}),
    Fault(
        "dropped", message_dropped, "learning", r"message", {"cycle": 3, "topic": "/sample/joint_states", "sequence": 1}
    ),
    Fault(
        "repeated",
        message_repeated,
        "learning",
        r"message",
        {"cycle": 3, "topic": "/sample/joint_states", "sequence": 1},
    ),
    Fault("changed", message_changed, "learning", r"pose\.position\.x", {"topic": "/hand/left/target", "sequence": 1}),
    Fault("changed URDF link", changed_link, "physics", r"position\[\d+\] \(.+\)", {"sequence": 0}, "robot.urdf line"),
    Fault("no feed-forward", no_gravity_feed_forward, "physics", r"position\[\d+\] \(.+\)", {"sequence": 0}),
    Fault("start posture", another_start_posture, "physics", r"position\[\d+\] \(.+\)", {"sequence": 0}),
    Fault("truncated log", log_cut_off, "log", r"file", {"log": "small.mcap"}),
    Fault("log lacks one", log_lacks_a_message, "log", r"message", {"topic": "/hand/right/target", "sequence": 2}),
    Fault("log repeats one", log_repeats_a_message, "log", r"message", {"topic": "/hand/right/target", "sequence": 2}),
    Fault("log changed", log_with_another_message, "log", r"message", {"topic": "/hand/right/target", "sequence": 2}),
    Fault("states damaged", states_damaged, "case", r"file", {}),
)
