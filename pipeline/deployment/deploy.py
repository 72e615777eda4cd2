"""Deployment: a learned controller drives the simulated robot over Zenoh at 10 Hz, beside the teacher (figure 6)."""

import queue
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats
from pipeline.deployment.processes import served_robot
from pipeline.evaluation.errors import HandErrors, posture_errors
from pipeline.exploration.episode import GuidedRun, MotionPlan, TargetHold
from pipeline.learner.controller import Controller
from pipeline.motions.motion import Motion
from pipeline.robot.coordinates import to_inputs
from pipeline.robot.kinematics import Kinematics
from pipeline.robot.telemetry import hand_message
from pipeline.robot_node.client import RemoteRobot
from pipeline.teacher.teacher import Teacher
from recorders.cdr.codec import decode_as
from recorders.errors import ConfigError, WireError
from recorders.messages.message_types import JointState
from recorders.messages.topics import JOINT_COMMANDS, SAMPLE_JOINTS, hand_target
from recorders.ticks.joiner import JointMap
from recorders.wire.keys.namespace import DEFAULT_NAMESPACE, message_key
from recorders.wire.keys.topic_keys import NamespaceKeys
from recorders.wire.publisher import TopicPublisher
from recorders.wire.session import Sample, Session

_ANSWER_S = 10.0  # a served controller answers within a millisecond; a machine may be very busy


@dataclass(frozen=True)
class DeploymentConfig:
    """How a controller is deployed.

    Parameters
    ----------
    period_ns : int
        How long each target and the command that answers it are held, in the robot's time [ns]: the paper's 10 Hz.
    settle_steps : int
        So many periods the first target is held before anything is measured.
    wait_s : float
        How long robot and controller may take to start [s]; a cold start compiles the kernels.

    Raises
    ------
    ConfigError
        If a number is out of range.
    """

    period_ns: int = 100_000_000
    settle_steps: int = 20
    wait_s: float = 60.0

    def __post_init__(self) -> None:
        if self.period_ns <= 0 or self.settle_steps < 0 or self.wait_s < 0:
            raise ConfigError(
                "deployment: expected period_ns above 0, settle_steps and wait_s from 0, "
                f"found {self.period_ns}, {self.settle_steps} and {self.wait_s:g}"
            )


@dataclass(frozen=True, eq=False)
class DriveResult:
    """Joints and hands of the robot at every target, and their errors.

    Attributes
    ----------
    joints : ndarray
        Joints measured at the end of the hold of each target [rad or m], shape (T, n).
    reached : ndarray
        Where the hands physically were then [m], shape (T, hands, 3).
    errors : HandErrors
        Their distances from that target.
    """

    joints: Floats
    reached: Floats
    errors: HandErrors


@dataclass(frozen=True, eq=False)
class Deployment:
    """A motion done by the robot under the learned controller, and under the teacher.

    Attributes
    ----------
    motion : str
        Name of the motion.
    period_s : float
        How long each target was held [s].
    targets : ndarray
        What was asked for, shape (T, inputs).
    learned, teacher : DriveResult
        Path of the robot behind each of them.
    """

    motion: str
    period_s: float
    targets: Floats
    learned: DriveResult
    teacher: DriveResult

    @property
    def learned_cm(self) -> float:
        """Mean distance of the physical hands from their targets under the learned controller [cm]."""
        return self.learned.errors.mean_cm

    @property
    def teacher_cm(self) -> float:
        """The same under the teacher [cm]."""
        return self.teacher.errors.mean_cm

    def summary(self) -> dict[str, float]:
        """Return both errors as plain JSON, and where the pose is controlled the angles by hand."""
        result = {"learned_cm": self.learned_cm, "teacher_cm": self.teacher_cm}
        for name, run in (("learned", self.learned), ("teacher", self.teacher)):
            result |= {f"{name}_{hand}_deg": angle for hand, angle in run.errors.hands_deg.items()}
        return result


def deploy(
    controller: Controller,
    motion: Motion,
    *,
    config: DeploymentConfig | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Deployment:
    """Let a controller, and then the teacher, lead the robot through a motion.

    `reenact robot` and `reenact serve` run in processes of their own, connected over loopback; this process publishes
    the targets, one sample of the motion each period whatever the motion's own times, as the paper does. The robot is
    in lockstep: `serve` commands it directly, this process holds each command for the rest of the period, and the
    robot's time stands still until the next. So the result is the same to the last bit however busy the machine is.
    What makes steps at 10 Hz into a motion is the lag of the robot's own servos.

    Parameters
    ----------
    controller : Controller
        What was learned; the robot is the one that it carries.
    motion : Motion
        What is asked for.
    config : DeploymentConfig
        Rate, settling, patience.
    progress : callable
        Called with the fraction done, 0 to 1.

    Raises
    ------
    WireError
        If robot or controller do not start, or stop answering.
    ControllerError, RobotError
        If the controller cannot be served.
    """
    config = config or DeploymentConfig()
    targets = motion.targets
    done = _Progress(progress, total=2 * (len(targets) + config.settle_steps))
    with served_robot(controller, wait_s=config.wait_s) as (session, robot):
        learned = drive_learned(session, robot, targets, config=config, on_hold=done.step)
        taught = drive_with_teacher(robot, targets, config=config, on_hold=done.step)
        kinematics = Kinematics(robot.robot)
    flat = to_inputs(kinematics.robot, targets)
    runs = [
        DriveResult(
            joints,
            kinematics.hands_along(joints),
            posture_errors(kinematics, joints, flat),
        )
        for joints in (learned, taught)
    ]
    return Deployment(motion.name, config.period_ns / 1e9, flat, *runs)


def drive_learned(
    session: Session,
    robot: RemoteRobot,
    targets: Floats,
    *,
    config: DeploymentConfig,
    namespace: str = DEFAULT_NAMESPACE,
    on_hold: Callable[[], None] = lambda: None,
) -> Floats:
    """Publish targets to the served controller and let the robot follow its commands, from the comfort posture.

    Parameters
    ----------
    session : Session
        Reaches controller and robot.
    robot : RemoteRobot
        The robot, in lockstep.
    targets : array, shape (T, hands, 3 or 7)
        Hand targets by row.
    config : DeploymentConfig
        Rate and settling.
    namespace : str
        First part of every key.
    on_hold : callable
        Called after each hold.

    Returns
    -------
    ndarray, shape (T, n)
        Joints measured at the end of the hold of each target [rad or m].

    Raises
    ------
    WireError
        If a target is not answered, or the robot stops answering.
    """
    robot.reset(robot.robot.comfort)
    joints, topics = [], [hand_target(name) for name in robot.robot.hand_names]
    with (
        TopicPublisher(session, keys=NamespaceKeys(namespace)) as producer,
        _Commands(session, robot, namespace) as commands,
    ):
        for target in _settled(targets, config):
            stamp_ns = robot.time_ns
            for topic, hand in zip(topics, target, strict=True):
                producer.publish(topic, hand_message(stamp_ns, hand), log_time_ns=stamp_ns)
            robot.advance(commands.answer(stamp_ns), config.period_ns)
            joints.append(robot.positions)
            on_hold()
    return np.array(joints[config.settle_steps :])


def drive_with_teacher(
    robot: RemoteRobot, targets: Floats, *, config: DeploymentConfig, on_hold: Callable[[], None] = lambda: None
) -> Floats:
    """Let the teacher lead the robot along the same targets at the same pace; as `drive_learned`."""
    start = robot.robot.comfort
    robot.reset(start)
    teacher = Teacher(Kinematics(robot.robot))
    episode = GuidedRun(robot, teacher, start=start, on_hold=lambda time_ns: on_hold())
    holds = [TargetHold(target, config.period_ns) for target in _settled(targets, config)]
    motion_plan = MotionPlan(holds[: config.settle_steps], holds[config.settle_steps :], targets[-1])
    for _ in episode.settle(motion_plan):
        pass
    ticks = [message for topic, message in episode.cycle(motion_plan) if topic == SAMPLE_JOINTS]
    return np.array([message.position for message in ticks[1:] if isinstance(message, JointState)])


class _Commands:
    """The commands that controllers send, in the order of the robot's joints."""

    def __init__(self, session: Session, robot: RemoteRobot, namespace: str) -> None:
        self._session = session
        self._key = message_key(namespace, JOINT_COMMANDS)
        self._joints = JointMap(robot.robot.joints)
        self._received: queue.Queue[bytes] = queue.Queue()
        self._stack = ExitStack()

    def __enter__(self) -> "_Commands":
        self._stack.enter_context(self._session.declare_subscriber(self._key, self._on_sample))
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def answer(self, stamp_ns: int) -> Floats:
        """Return the posture (n,) commanded under a stamp [ns]."""
        deadline_s = time.monotonic() + _ANSWER_S
        while (left_s := deadline_s - time.monotonic()) > 0.0:
            try:
                command = decode_as(JointState, self._received.get(timeout=left_s))
            except queue.Empty:
                break
            if command.stamp_ns == stamp_ns:
                return self._joints.positions(command)
        raise WireError(
            f"the targets at {stamp_ns} ns were not answered within {_ANSWER_S:g} s; did the controller refuse them, "
            "or was it stopped?"
        )

    def _on_sample(self, sample: Sample) -> None:
        self._received.put(sample.payload.to_bytes())


class _Progress:
    """Counts holds."""

    def __init__(self, progress: Callable[[float], None], *, total: int) -> None:
        self._progress, self._total, self._done = progress, total, 0

    def step(self) -> None:
        """Count one hold."""
        self._done += 1
        self._progress(self._done / self._total)


def _settled(targets: Floats, config: DeploymentConfig) -> Sequence[Floats]:
    return [*[targets[0]] * config.settle_steps, *targets]
