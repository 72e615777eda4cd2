"""Episode: a guide drives a robot, in this process or across a network, through a motion, tick by tick."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np

from pipeline.arrays import Floats
from pipeline.exploration.joint_noise import joint_noise
from pipeline.motions.motion import Motion
from pipeline.robot.backend import ResettableRobot, RobotBackend
from pipeline.robot.config import RobotConfig
from pipeline.robot.coordinates import POSITION_SIZE
from pipeline.robot.resolution import on_grid
from pipeline.robot.telemetry import TopicMessage, command_message, tick_messages
from pipeline.seeding import uniforms
from recorders.errors import ConfigError, MotionError


@dataclass(frozen=True)
class ExplorationConfig:
    """Settings of an exploration.

    Attributes
    ----------
    state_period_ns : int
        Period of the robot's own messages [ns]; the default is 50 Hz.
    settle_ns : int
        How long the first target of an open motion is held before the recording [ns]; a closed motion settles during
        one unrecorded cycle, for the last part of which, this long, a robot that can be placed takes part.
    start_spread : float
        The start posture is drawn this far about the comfort posture, in parts of each joint's range.
    joint_noise : float
        Standard deviation of the noise that is added to commands, in parts of each joint's range.
    """

    state_period_ns: int = 20_000_000
    settle_ns: int = 2_000_000_000
    start_spread: float = 0.05
    joint_noise: float = 0.0

    def __post_init__(self) -> None:
        if self.state_period_ns <= 0 or self.settle_ns < 0:
            raise ConfigError("exploration: expected state_period_ns above 0 and settle_ns at least 0")
        if not 0.0 <= self.start_spread <= 0.5:
            raise ConfigError(f"exploration start_spread: expected 0 to 0.5, found {self.start_spread}")
        if not 0.0 <= self.joint_noise <= 0.1:
            raise ConfigError(f"exploration joint_noise: expected 0 to 0.1, found {self.joint_noise}")

    def noise(self, robot: RobotConfig, *, seed: int, period_ns: int) -> Iterator[Floats] | None:
        """Return the noise of the commands of an exploration, if there is any."""
        return joint_noise(robot, seed=seed, period_ns=period_ns, share=self.joint_noise) if self.joint_noise else None


class TargetHold(NamedTuple):
    """Targets of all hands, by row, that are held for a while."""

    target: Floats
    duration_ns: int


@dataclass(frozen=True, eq=False)
class MotionPlan:
    """Motion as it is driven: targets held to settle, targets held for the record, and the last tick's target.

    Attributes
    ----------
    settling, holds : sequence of TargetHold
    closing : ndarray
        Targets of the last tick, by row: the first ones of a closed motion, the last ones of an open one.
    """

    settling: Sequence[TargetHold]
    holds: Sequence[TargetHold]
    closing: Floats

    @property
    def settling_ns(self) -> int:
        """Duration of the settling [ns]."""
        return sum(hold.duration_ns for hold in self.settling)

    @property
    def cycle_ns(self) -> int:
        """Duration of one presentation [ns]."""
        return sum(hold.duration_ns for hold in self.holds)


def plan(motion: Motion, *, period_ns: int, settle_ns: int) -> MotionPlan:
    """Hold each sample of a motion until the next, in whole periods of the teacher.

    The last sample is held as long as the one before. A closed motion settles during one cycle, an open one while its
    first target is held for `settle_ns`.

    Raises
    ------
    MotionError
        The motion is sampled faster than the teacher works.
    """
    steps = np.rint((motion.times_s - motion.times_s[0]) * 1e9 / period_ns).astype(np.int64)
    durations = np.diff(steps) * period_ns
    if durations.min() <= 0:
        sample = int(np.argmin(durations)) + 1
        raise MotionError(
            f"motion '{motion.name}': samples {sample - 1} and {sample} are closer than the teacher's period of "
            f"{period_ns / 1e6:g} ms"
        )
    holds = [TargetHold(target, int(d)) for target, d in zip(motion.targets, [*durations, durations[-1]], strict=True)]
    settling = holds if motion.closed else [TargetHold(motion.targets[0], settle_ns)]
    return MotionPlan(settling, holds, motion.targets[0 if motion.closed else -1])


def start_posture(robot: RobotConfig, *, seed: int, spread: float) -> Floats:
    """Draw the posture (n,) that `seed` names, near the comfort posture and within the limits."""
    span = robot.upper - robot.lower
    drawn = uniforms(seed, "start posture", count=len(robot.joints))
    posture = robot.comfort + spread * span * (2.0 * drawn - 1.0)
    return np.clip(posture, robot.lower + 0.01 * span, robot.upper - 0.01 * span)


class Guide(Protocol):
    """Leads a robot through a motion: the teacher, or a learner that explores by itself."""

    @property
    def period_ns(self) -> int:
        """Control period [ns]."""
        ...

    def observe(self, robot: RobotBackend) -> None:
        """Take in what the robot measures at a tick."""
        ...

    def step(self, q: Floats, targets: Floats) -> Floats:
        """Return the posture to command next, one period after commanding `q` (n,), for `targets` by row."""
        ...


@dataclass(frozen=True)
class Guidance:
    """Guide of an exploration, and what goes with it.

    Attributes
    ----------
    guide : Guide or None
        Leads the robot; the teacher if None.
    settings : mapping of str to object
        Settings of the guide, for the manifest; the teacher's are known.
    is_done : callable
        Asked after every sample whether to end there.
    must_reach : bool
        Whether a motion that leaves the robot's reach is refused.
    keep_clear : bool
        Whether a log in which hands or forearms come nearer to the robot than `CLEARANCE_M` is refused.
    """

    guide: Guide | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    is_done: Callable[[], bool] = lambda: False
    must_reach: bool = True
    keep_clear: bool = False


class GuidedRun:
    """One run of a robot under its guide. Its messages come as they are asked for, and drive the robot on.

    Parameters
    ----------
    backend : RobotBackend
        The robot; it stands at `start`.
    guide : Guide
        Leads it.
    start : array, shape (n,)
        The posture from which the guide begins [rad or m].
    noise : iterator of array, optional
        Offsets of the commands of a cycle (n,), see `joint_noise`; commands stay within the joints' limits.
    on_hold : callable
        Called with the robot's time [ns] after every hold.
    is_done : callable
        Asked after every hold of a cycle whether to end it there.
    """

    def __init__(
        self,
        backend: RobotBackend,
        guide: Guide,
        *,
        start: Floats,
        noise: Iterator[Floats] | None = None,
        on_hold: Callable[[int], None] = lambda time_ns: None,
        is_done: Callable[[], bool] = lambda: False,
    ) -> None:
        self._backend = backend
        self._guide = guide
        self._command = start
        self._noise = noise
        self._on_hold = on_hold
        self._is_done = is_done
        self._errors_m: list[float] = []

    @property
    def error_cm(self) -> float:
        """Distance of the hands from u(k) at the end of its hold [cm], mean over all samples so far and hands."""
        return 100.0 * sum(self._errors_m) / len(self._errors_m)

    @property
    def samples(self) -> int:
        """Samples so far."""
        return len(self._errors_m) // len(self._backend.robot.hands)

    def settle(self, plan: MotionPlan) -> Iterator[TopicMessage]:
        """Yield the commands of the settling, each before it takes effect."""
        for hold in plan.settling:
            yield from self._drive(hold)

    def settle_placed(self, plan: MotionPlan, robot: ResettableRobot, *, driven_ns: int) -> None:
        """Settle as `settle` does, in less time: the guide goes ahead alone, and the robot joins it for the end.

        What the guide commands then does not depend on the robot, and the robot forgets where it was put: of the
        10 mrad that the servos lag behind at first, less than 1e-11 rad are left after 2 s.

        Parameters
        ----------
        plan : MotionPlan
            What is settled for.
        robot : ResettableRobot
            The robot of this episode.
        driven_ns : int
            How long it is driven [ns]; at most, all of the settling.
        """
        period_ns = self._guide.period_ns
        targets = [hold.target for hold in plan.settling for _ in range(hold.duration_ns // period_ns)]
        alone = max(0, len(targets) - driven_ns // period_ns)
        for target in targets[:alone]:
            self._command = self._guide.step(self._command, target)
        robot.reset(self._command, time_ns=alone * period_ns)
        for target in targets[alone:]:
            self._command = self._guide.step(self._command, target)
            robot.advance(self._command, period_ns)
        self._on_hold(robot.time_ns)

    def cycle(self, plan: MotionPlan) -> Iterator[TopicMessage]:
        """Yield one presentation: a tick at the start of every hold and one at the end, T + 1 in all, and commands."""
        last = plan.closing
        for hold in plan.holds:
            yield from self._tick(hold.target)
            yield from self._drive(hold, self._noise)
            missed = (self._backend.hands() - hold.target)[:, :POSITION_SIZE]
            self._errors_m.extend(np.linalg.norm(missed, axis=1).tolist())
            if self._is_done():
                last = hold.target
                break
        yield from self._tick(last)

    def _tick(self, targets: Floats) -> Iterator[TopicMessage]:
        self._guide.observe(self._backend)
        yield from tick_messages(self._backend, targets)

    def _drive(self, hold: TargetHold, noise: Iterator[Floats] | None = None) -> Iterator[TopicMessage]:
        """Drive the robot towards a target while it is held, and yield each command before it takes effect."""
        robot = self._backend.robot
        period_ns = self._guide.period_ns
        for _ in range(hold.duration_ns // period_ns):
            self._command = self._guide.step(self._command, hold.target)
            sent = self._command if noise is None else np.clip(self._command + next(noise), robot.lower, robot.upper)
            sent = on_grid(sent, robot.resolution.commands)  # as the motors will take it
            yield command_message(self._backend, sent)
            self._backend.advance(sent, period_ns)
        self._on_hold(self._backend.time_ns)
