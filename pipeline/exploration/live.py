"""Live exploration: the teacher drives a robot node, and the session streams to learner and recorder as it happens."""

import hashlib
import json
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from itertools import count, islice
from typing import Any

from pipeline.exploration.episode import ExplorationConfig, Guidance, GuidedRun, plan, start_posture
from pipeline.exploration.self_explorer import learned
from pipeline.exploration.source import Source
from pipeline.motions.motion import Motion
from pipeline.robot.backend import RobotBackend
from pipeline.robot.kinematics import Kinematics
from pipeline.robot.telemetry import TopicMessage
from pipeline.robot_node.client import RemoteRobot
from pipeline.teacher.teacher import Teacher, TeacherConfig, check_reach
from recorders.cdr.codec import encode
from recorders.errors import WireError
from recorders.messages.phase import Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SAMPLE_JOINTS, SESSION_PHASE, commanded_tick
from recorders.nodes.keys import node_name
from recorders.nodes.node import running_node
from recorders.nodes.status import NodeSource
from recorders.protocol.stream import Offer
from recorders.wire.session import SessionConfig, open_session
from replay.sources.schedule import Schedule
from replay.transports.sender_config import SenderConfig
from replay.transports.zenoh import ZenohTransport

_TEACHER, _EXPLORATION = TeacherConfig(), ExplorationConfig()
_GUIDANCE = Guidance()


class LiveSession:
    """A motion presented again and again to a robot, as one stream of messages that exists only once.

    Each presentation is a phase marker, T + 1 ticks (targets and joints under one stamp) and every command of the
    teacher. A closed motion goes round without a pause, so that the last tick of a presentation and the first of the
    next share their instant; an open one settles before each. Asking for the next message drives the robot on; in
    lockstep the stream is a function of robot, motion, seed and parameters alone.

    Parameters
    ----------
    backend : RobotBackend
        The robot.
    motion : Motion
        What it is to follow.
    seed : int
        Seed of the start posture.
    schedule : Schedule
        Epochs and phases.
    guidance : Guidance
        Who leads the robot, and what goes with that; whether there is clearance is not looked at.
    config : ExplorationConfig
        Parameters.
    progress : callable
        Called with the fraction done, 0 to 1.

    Raises
    ------
    MotionError
        The motion leaves the robot's reach, or is sampled faster than the teacher works.
    """

    def __init__(
        self,
        backend: RobotBackend,
        motion: Motion,
        *,
        seed: int,
        schedule: Schedule,
        guidance: Guidance = _GUIDANCE,
        config: ExplorationConfig = _EXPLORATION,
        progress: Callable[[float], None] = lambda fraction: None,
    ) -> None:
        self._backend = backend
        self._motion = motion
        self._schedule = replace(schedule, topics=commanded_tick(backend.robot.hand_names))
        settings = {"teacher": asdict(_TEACHER)} if guidance.guide is None else guidance.settings
        self._parameters = {"seed": seed, **settings, "exploration": asdict(config)}
        teacher = Teacher(Kinematics(backend.robot), _TEACHER)
        guide = guidance.guide or teacher
        self._plan = plan(motion, period_ns=guide.period_ns, settle_ns=config.settle_ns)
        if guidance.must_reach:
            check_reach(teacher, motion)
        self._start = start_posture(backend.robot, seed=seed, spread=config.start_spread)
        total_ns = self._duration_ns()
        self._episode = GuidedRun(
            backend,
            guide,
            start=self._start,
            noise=config.noise(backend.robot, seed=seed, period_ns=guide.period_ns),
            on_hold=lambda time_ns: progress(min(1.0, time_ns / total_ns)),
            is_done=guidance.is_done,
        )
        self._settling_periods = self._plan.settling_ns // guide.period_ns
        self._arrival: Iterator[TopicMessage] = iter(())  # the end of the settling
        self._numbered: Counter[str] = Counter()

    @property
    def ticks(self) -> int:
        """Ticks of the whole session, if no presentation ends before the motion does."""
        return self._presentations * (len(self._motion) + 1)

    @property
    def streamed_ticks(self) -> int:
        """Ticks streamed so far."""
        return self._numbered[SAMPLE_JOINTS]

    @property
    def messages(self) -> int:
        """Messages streamed so far."""
        return self._numbered.total()

    @property
    def teacher_error_cm(self) -> float:
        """Distance of the hands from u(k) at the end of its hold [cm], mean over what has been streamed."""
        return self._episode.error_cm

    @property
    def source(self) -> NodeSource:
        """Status of the session as a node."""
        return NodeSource(
            "explorer",
            node_name(self._motion.name),
            state=lambda: "exploring" if self.messages else "waiting",
            counts=lambda: {"messages": self.messages},
        )

    def settle(self) -> None:
        """Bring the robot to the start of the motion; nothing of it is streamed."""
        self._backend.reset(self._start)
        self._arrival = self._episode.settle(self._plan)
        for _ in islice(self._arrival, self._settling_periods - 1):
            pass

    def offer(self) -> Offer:
        """Return the offer that the consumers get before the first message."""
        robot = {"toml": self._backend.robot.toml_text, "urdf": self._backend.robot.urdf_text}
        schedule = self._schedule.to_dict()
        identity = ["live", self._motion.sha256, robot, schedule, self._parameters]
        run = hashlib.sha256(json.dumps(identity).encode()).hexdigest()[:32]
        return Offer(run=run, schedule=schedule, logs=[], robot=robot)

    def stream_from(self, start: int) -> Iterator[RecordedMessage]:
        """Return the stream, to be pulled once; raises WireError unless it is asked for from its first message."""
        if start or self._numbered:
            raise WireError(
                f"a live session cannot go back: expected consumers that begin with message 0, found one that wants "
                f"{start}; replay the session's recording to it"
            )
        return self._stream()

    def _stream(self) -> Iterator[RecordedMessage]:
        for topic, message in self._session():
            number = self._numbered[topic]
            self._numbered[topic] += 1
            yield RecordedMessage(topic, message.TYPE, encode(message), number, self._backend.time_ns)

    def _session(self) -> Iterator[TopicMessage]:
        """Yield marker, ticks and commands of every presentation.

        A marker comes before the robot has arrived at the first tick: robots publish their hands as they get there.
        """
        run = self.offer().run
        presented = count()
        for epoch in range(self._schedule.epochs):
            for cycle, phase in self._schedule.cycles_of_epoch():
                first = next(presented) == 0
                if not first and not self._motion.closed:
                    self._arrival = self._episode.settle(self._plan)
                    yield from islice(self._arrival, self._settling_periods - 1)
                yield SESSION_PHASE, Phase(run, epoch, cycle, phase, log="").to_message()
                for command in self._arrival:
                    if not first:
                        yield command
                yield from self._episode.cycle(self._plan)

    @property
    def _presentations(self) -> int:
        return self._schedule.epochs * self._schedule.cycles

    def _duration_ns(self) -> int:
        settlings = 1 if self._motion.closed else self._presentations
        return settlings * self._plan.settling_ns + self._presentations * self._plan.cycle_ns


@dataclass(frozen=True)
class LiveExploration:
    """Result of a live exploration.

    Attributes
    ----------
    run : str
        Names the session.
    robot, motion : str
        Their names.
    real_time : bool
        Whether the robot's time ran with the clock on the wall; such a session cannot be repeated to the bit.
    ticks, messages : int
        How many were streamed.
    teacher_error_cm : float
        Distance of the hands from u(k) at the end of its hold [cm], mean over samples and hands.
    consumers : dict of str to dict of str to object
        Result of each awaited consumer, by name.
    learned : dict of str to str or float
        Digest of a guide that learns, and the error that it expects [cm].
    """

    run: str
    robot: str
    motion: str
    real_time: bool
    ticks: int
    messages: int
    teacher_error_cm: float
    consumers: dict[str, dict[str, Any]]
    learned: dict[str, str | float]


def explore_live(
    source: Source,
    *,
    seed: int,
    schedule: Schedule,
    session: SessionConfig,
    sender: SenderConfig,
    progress: Callable[[float], None] = lambda fraction: None,
) -> LiveExploration:
    """Let the teacher drive a robot node through a motion, and stream the session to the consumers that are awaited.

    The robot settles first. Then the consumers are awaited, while the robot's time, in lockstep, stands still.

    Parameters
    ----------
    source : Source
        Motion and settings.
    seed : int
        Seed of the start posture, and of what the source draws.
    schedule : Schedule
        Epochs and phases.
    session, sender : SessionConfig, SenderConfig
        Where, and to whom; each message travels on the key of its own topic, whatever `sender.batch_size` is.
    progress : callable
        Called with the fraction done, 0 to 1.

    Raises
    ------
    WireError
        If no robot answers, or a consumer is not there, refuses, or stops answering.
    MotionError, RobotError, ConfigError
        If motion, robot and parameters do not fit together.
    """
    with open_session(session) as opened, sender.keys.joined(opened):
        robot = RemoteRobot(opened, namespace=sender.namespace, wait_s=sender.wait_s)
        presented, guidance = source.motion(robot.robot, seed=seed), source.guidance(robot.robot, seed=seed)
        live = LiveSession(
            robot, presented, seed=seed, schedule=schedule, guidance=guidance, config=source.config, progress=progress
        )
        live.settle()
        robot.wait()
        with running_node(opened, live.source, config=session, namespace=sender.namespace):
            transport = ZenohTransport(opened, config=replace(sender, batch_size=1))
            consumers = transport.deliver(live.offer(), live.stream_from)
    return LiveExploration(
        run=live.offer().run,
        robot=robot.robot.name,
        motion=presented.name,
        real_time=robot.status.real_time,
        ticks=live.streamed_ticks,
        messages=live.messages,
        teacher_error_cm=live.teacher_error_cm,
        consumers=consumers,
        learned=learned(guidance.guide),
    )
