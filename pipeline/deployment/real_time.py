"""A controller beside teachers on a motion in its own time: what the robot's hands physically do in Drake, and why."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from importlib.util import find_spec

import numpy as np

from pipeline.arrays import Floats
from pipeline.deployment.pink_guide import STEP_SHARE, PinkGuide
from pipeline.evaluation.errors import WASHOUT_STEPS
from pipeline.evaluation.trials import robot_of
from pipeline.exploration.episode import Guide
from pipeline.learner.controller import Controller
from pipeline.motions.motion import Motion
from pipeline.robot.backend import RobotBackend
from pipeline.robot.config import RobotConfig
from pipeline.robot.coordinates import POSITION_SIZE, to_inputs, turns_of
from pipeline.robot.kinematics import Kinematics
from pipeline.rotations import turns_between
from pipeline.simulation.simulation import Simulation
from pipeline.teacher.qp_config import QpTeacherConfig
from pipeline.teacher.qp_teacher import QpTeacher
from pipeline.teacher.teacher import Teacher

TICK_RATES_HZ = (10, 50)
"""Rates at which targets are given."""

HOLD_S = 1.0
"""How long a target is held until the robot counts as settled."""

_SETTLE_S = 2.0  # of the first target, before anything is measured
_HELD = 12  # targets of a motion that are held, spread evenly over it
_DOMINATES = 2.0  # times the settled error: more than that while moving is mostly lag
_CM_PER_M, _NS_PER_S = 100.0, 1_000_000_000


@dataclass(frozen=True)
class RealTimeError:
    """Errors of the physical hands under one leader, mean over targets: distances, over all hands, and angles.

    Attributes
    ----------
    leader : str
        Who led.
    tick_rate_hz : int
        Targets in a second.
    moving_cm : float
        At the end of each target's time, the motion going on.
    settled_cm : float
        After `HOLD_S` on a target.
    moving_deg, settled_deg : dict of str to float
        Angles between orientation and target alike, by hand whose pose is controlled [degrees].
    """

    leader: str
    tick_rate_hz: int
    moving_cm: float
    settled_cm: float
    moving_deg: dict[str, float] = field(default_factory=dict)
    settled_deg: dict[str, float] = field(default_factory=dict)

    @property
    def is_lag(self) -> bool:
        """Whether most of the error while moving is gone once a target is held."""
        return self.moving_cm > _DOMINATES * self.settled_cm


def deploy_in_real_time(
    controller: Controller, motion: Motion, *, progress: Callable[[float], None] = lambda fraction: None
) -> list[RealTimeError]:
    """Let a controller, both teachers and, where it is installed, pink lead the simulated robot through a motion.

    The motion takes its own time; its targets are interpolated at each of `TICK_RATES_HZ`. What is measured is as with
    `deploy`, but in this process.

    Raises
    ------
    ControllerError, RobotError
        If the controller is not for the joints of its own robot, or this cannot be simulated.
    """
    robot = robot_of(controller)
    results: list[RealTimeError] = []
    teachers = {name: partial(_itself, teacher) for name, teacher in _teachers(robot).items()}
    for rate in TICK_RATES_HZ:
        targets = resampled(motion, rate)
        learned = partial(LearnedGuide, controller, period_ns=_NS_PER_S // rate)
        leaders: dict[str, Callable[[], Guide]] = {"learned": learned, **teachers}
        for name, guide in leaders.items():
            results.append(_errors(robot, name, guide, targets, rate))
            progress(len(results) / (len(TICK_RATES_HZ) * len(leaders)))
    return results


def lag_sentences(errors: list[RealTimeError]) -> Iterator[str]:
    """Yield a plain sentence for each rate at which the robot's lag is most of the controller's error."""
    for error in errors:
        if error.leader == "learned" and error.is_lag:
            yield (
                f"At {error.tick_rate_hz} Hz the lag of the robot's servos dominates: the hands are "
                f"{error.moving_cm:.2f} cm from their targets while these move on, and {error.settled_cm:.2f} cm once "
                f"one is held for {HOLD_S:g} s."
            )


def resampled(motion: Motion, rate_hz: int) -> Floats:
    """Return the targets of a motion in its own time, by row, interpolated linearly, quaternions of the nearer sign."""
    times_s = motion.times_s - motion.times_s[0]
    ticks_s = np.arange(int(times_s[-1] * rate_hz + 1e-6) + 1) / rate_hz
    targets = motion.targets.copy()
    orientations = targets[..., POSITION_SIZE:]
    turns_away = (orientations[1:] * orientations[:-1]).sum(axis=-1, keepdims=True) < 0.0
    orientations[1:] *= np.cumprod(np.where(turns_away, -1.0, 1.0), axis=0)
    flat = targets.reshape(len(motion), -1)
    columns = [np.interp(ticks_s, times_s, column) for column in flat.T]
    return np.stack(columns, axis=1).reshape(len(ticks_s), *motion.targets.shape[1:])


def follow(robot: RobotConfig, guide: Guide, targets: Floats, *, period_ns: int) -> Floats:
    """Let a guide lead the simulated robot from the comfort posture along targets by row, each for a period.

    Returns
    -------
    ndarray, shape (T, hands, 3 or 7)
        The hands at the end of each period, by row.
    """
    simulation = Simulation(robot)
    simulation.reset(robot.comfort)
    command, reached = robot.comfort, []
    for target in targets:
        for _ in range(period_ns // guide.period_ns):
            command = guide.step(command, target)
            simulation.advance(command, guide.period_ns)
        reached.append(simulation.hands())
    return np.array(reached)


class LearnedGuide:
    """A controller as a guide: a step of it every period, within the joints' limits, after a washout on the first."""

    def __init__(self, controller: Controller, *, period_ns: int) -> None:
        self._robot, self._period_ns, self._begun = robot_of(controller), period_ns, False
        self._learner = controller.learner()

    @property
    def period_ns(self) -> int:
        """From step to step [ns]."""
        return self._period_ns

    def observe(self, robot: RobotBackend) -> None:
        """Take no notice: nothing is learned."""

    def step(self, q: Floats, targets: Floats) -> Floats:
        """Return the controller's posture for `targets` by row."""
        if not self._begun:
            self._learner.washout(to_inputs(self._robot, targets), steps=WASHOUT_STEPS)
            self._begun = True
        outputs = self._learner.predict(to_inputs(self._robot, targets)[np.newaxis])[0]
        within: Floats = np.clip(outputs[-len(q) :], self._robot.lower, self._robot.upper)
        return within


def _teachers(robot: RobotConfig) -> dict[str, Guide]:
    """Return those that know the robot, by name."""
    period_s = QpTeacherConfig().period_ns / _NS_PER_S
    drake = QpTeacherConfig(gain=STEP_SHARE / period_s, speed_share=1.0, clearance_m=0.0)
    teachers: dict[str, Guide] = {"teacher": Teacher(Kinematics(robot)), "drake_ik": QpTeacher(robot, drake)}
    if find_spec("pink") is not None:
        teachers["pink"] = PinkGuide(robot)
    return teachers


def _itself(guide: Guide) -> Guide:
    """Return a teacher, which keeps nothing between steps."""
    return guide


def _errors(robot: RobotConfig, name: str, guide: Callable[[], Guide], targets: Floats, rate: int) -> RealTimeError:
    period_ns = _NS_PER_S // rate
    moving_m, moving_deg = _along(robot, guide(), targets, period_ns)
    each = round(HOLD_S * rate)
    held = np.repeat(targets[:: -(-len(targets) // _HELD)], each, axis=0)
    settled_m, settled_deg = _along(robot, guide(), held, period_ns)
    return RealTimeError(
        name,
        rate,
        _CM_PER_M * float(moving_m.mean()),
        _CM_PER_M * float(settled_m[each - 1 :: each].mean()),
        {hand: float(angles.mean()) for hand, angles in moving_deg.items()},
        {hand: float(angles[each - 1 :: each].mean()) for hand, angles in settled_deg.items()},
    )


def _along(robot: RobotConfig, guide: Guide, targets: Floats, period_ns: int) -> tuple[Floats, dict[str, Floats]]:
    """Return the errors of the hands [m] (T, hands) along targets, and angles [degrees] (T,) of hands with poses.

    The first target is held before.
    """
    before = round(_SETTLE_S * _NS_PER_S) // period_ns
    asked = np.concatenate([np.repeat(targets[:1], before, axis=0), targets])
    reached = follow(robot, guide, asked, period_ns=period_ns)
    errors: Floats = np.linalg.norm((reached - asked)[..., :POSITION_SIZE], axis=2)[before:]
    found, wanted = (turns_of(robot, to_inputs(robot, rows[before:])) for rows in (reached, asked))
    return errors, {hand: np.degrees(turns_between(turns, wanted[hand])) for hand, turns in found.items()}
