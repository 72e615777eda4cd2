"""Everything behind a page: robot, link, drive and controllers, started and ended together."""

import logging
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.browser.session.activity import Activity
from pipeline.browser.session.controllers import TEACHER, Controllers, Place
from pipeline.browser.session.drive import Drive
from pipeline.browser.session.own_robot import OwnRobot
from pipeline.browser.session.recorded_motion import motion_of_log, recorded_errors
from pipeline.browser.session.recordings import Recordings, evaluated
from pipeline.browser.session.robot_link import RobotLink
from pipeline.deployment.session_folder import session_folder
from pipeline.motions.motion import load_motion
from pipeline.motions.names import motion_names
from pipeline.robot.config import RobotConfig, load_robot, parse_robot
from pipeline.robot_node.client import RemoteRobot
from recorders.errors import MotionError, RobotError, WireError
from recorders.wire.keys.topic_keys import NamespaceKeys, TopicKeys
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import Session, SessionConfig, open_session

logger = logging.getLogger(__name__)

FIRST_MOTION = "circles"
"""What a simulated robot of our own does until somebody leads it."""

_WAIT_S = 60.0


@dataclass(frozen=True)
class PlayConfig:
    """What is played with.

    Attributes
    ----------
    robot : str, Path or None
        Robot to simulate; of one that runs already, None for what it describes itself as.
    texts : (str, str) or None
        TOML and URDF of the robot to simulate, in place of its name: of a controller, which carries them.
    controllers : tuple of Path
        Learned controllers.
    session : SessionConfig or None
        Where a robot and a controller run already; None for a simulated robot and controllers of our own.
    keys : TopicKeys
        Keys of the topics, and the namespace.
    wait_s : float
        How long a robot that runs already may take to answer [s].
    folder : Path
        For the recordings that are made on the page.
    """

    robot: str | Path | None = None
    texts: tuple[str, str] | None = None
    controllers: tuple[Path, ...] = ()
    session: SessionConfig | None = None
    keys: TopicKeys = field(default_factory=NamespaceKeys)
    wait_s: float = 10.0
    folder: Path = Path("play")


@dataclass(frozen=True, eq=False)
class Play:
    """What runs behind a page.

    Attributes
    ----------
    drive : Drive
        Targets, and the robot as it reports itself.
    link : RobotLink
        Link to the robot and the controllers.
    activity : Activity
        Work under way.
    controllers : Controllers or None
        Controllers of our own; None where others run already.
    recordings : Recordings
        Recordings, and the logs of their folder.
    own_robot : OwnRobot or None
        Simulated robot of our own.
    motions : tuple of str
        Names of the motions that the robot can go through.
    """

    drive: Drive
    link: RobotLink
    activity: Activity
    controllers: Controllers | None
    recordings: Recordings
    own_robot: OwnRobot | None
    motions: tuple[str, ...]

    @property
    def robot(self) -> RobotConfig:
        """The robot."""
        return self.drive.robot

    def go_through(self, name: str) -> None:
        """Go through a motion known by name; raises MotionError."""
        self.drive.go_through(load_motion(name, self.robot))

    def go_through_log(self, name: str) -> None:
        """Go through a log of the folder; raises LogError, MessageError or MotionError."""
        self.drive.go_through(motion_of_log(self.recordings.path(name), self.robot))

    def end_recording(self) -> str:
        """End the recording under way, and return a line on what it is and how far off the hands were in it."""
        log = self.recordings.end()
        leading = None if self.controllers is None else self.controllers.file(self.link.controller)
        found = recorded_errors(log, self.robot)
        hands = ", ".join(f"{hand} {error_cm:.2f}" for hand, error_cm in found.hands_cm.items())
        line = f"{log}: {found.samples} targets, hands off by {found.mean_cm:.2f} cm on average ({hands})"
        if leading is None:
            return line
        answers = evaluated(leading, log)
        return f"{line}; {self.link.controller} evaluated on it {answers['mean_cm']:.2f} cm"

    def choose(self, name: str) -> "Future[None]":
        """Have a controller of our own lead, once it stands ready."""
        return self.activity.do(f"starting {name}", lambda: self.lead(name))

    def begin(self, name: str) -> None:
        """Have a controller of our own lead, and once it does the robot move, unless a visitor has it do something."""
        self.lead(name)
        if FIRST_MOTION in self.motions:
            self.drive.begin(load_motion(FIRST_MOTION, self.robot))

    def lead(self, name: str) -> None:
        """Start a controller of our own, unless it runs, and give it the targets; raises as `Controllers.start`."""
        if self.controllers is not None:
            self.controllers.start(name)
            self.link.choose(name)
            self.drive.change_controller(name)

    def look_after(self) -> None:
        """Start the controller that leads again if its process has ended."""
        leading = self.link.controller
        if self.controllers is None or not leading or self.activity.doing:
            return
        if complaint := self.controllers.complaint(leading):
            logger.warning(f"{leading} ended: {complaint}")
            self.choose(leading)


@contextmanager
def playing(config: PlayConfig, *, meanwhile: Callable[[], object] = lambda: None) -> Iterator[Play]:
    """Run everything while the block runs.

    Parameters
    ----------
    config : PlayConfig
        What is played with.
    meanwhile : callable
        Called while a simulated robot of our own starts, in a process of its own.

    Raises
    ------
    RobotError
        If there is no such robot, or it is not usable.
    WireError
        If a robot does not start, or none answers; or one that is there moves in lockstep.
    """
    with session_folder() as folder, ExitStack() as stack:
        if config.session is None:
            yield _own(config, folder, stack, meanwhile)
        else:
            meanwhile()
            session = stack.enter_context(open_session(config.session))
            stack.enter_context(config.keys.joined(session))
            drive = Drive(_robot_there(session, config))
            link = stack.enter_context(RobotLink(session, drive, keys=config.keys))
            ends = config.session.connect or config.session.listen
            where = Place(session, ends[:1], config.keys, folder, drive.robot.hand_names)
            recordings = _recordings(stack, where, drive, config)
            activity = _activity(stack)
            yield Play(drive, link, activity, None, recordings, None, _reachable(drive.robot))


def _own(config: PlayConfig, folder: Path, stack: ExitStack, meanwhile: Callable[[], object]) -> Play:
    """Return a simulated robot of our own, and controllers beside it."""
    robot = load_robot(config.robot or "asimo") if config.texts is None else parse_robot(*config.texts)
    endpoint, keys = free_endpoint(), config.keys
    own = stack.enter_context(OwnRobot(robot, folder, endpoint=endpoint, namespace=keys.namespace).running())
    meanwhile()
    drive = Drive(robot)
    try:
        session = stack.enter_context(open_session(SessionConfig(connect=(endpoint,), wait_s=_WAIT_S)))
        link = stack.enter_context(RobotLink(session, drive, keys=keys))
    except WireError as error:
        raise WireError(own.report or str(error)) from error
    where = Place(session, (endpoint,), keys, folder, robot.hand_names)
    controllers = Controllers(where)
    recordings = _recordings(stack, where, drive, config)
    activity = _activity(stack)
    stack.callback(controllers.close)  # which ends what the activity may be waiting for
    stack.callback(activity.cancel)
    play = Play(drive, link, activity, controllers, recordings, own, _reachable(robot))
    added = [controllers.add(path) for path in config.controllers]
    first = added[0] if added else TEACHER
    activity.do(f"starting {first}", lambda: play.begin(first))
    return play


def _recordings(stack: ExitStack, place: Place, drive: Drive, config: PlayConfig) -> Recordings:
    """Return the recordings; one that is under way at the end is kept."""
    recordings = Recordings(place, drive, config.folder)
    stack.callback(recordings.close)
    return recordings


def _activity(stack: ExitStack) -> Activity:
    """Return the activity; it comes after the recordings, as one that it is just beginning is ended by them."""
    activity = Activity()
    stack.callback(activity.close)
    return activity


def _robot_there(session: Session, config: PlayConfig) -> RobotConfig:
    """Return the robot that runs already; raises WireError where it cannot be led."""
    if config.robot is not None:
        return load_robot(config.robot)
    try:
        there = RemoteRobot(session, namespace=config.keys.namespace, wait_s=config.wait_s)
    except RobotError as error:
        raise RobotError(f"{error}; give the robot with --robot") from error
    if not there.status.real_time:
        raise WireError(
            f"robot '{there.robot.name}' moves in lockstep, and waits for whoever drives it; start it with "
            "`reenact robot --real-time`"
        )
    return there.robot


def _reachable(robot: RobotConfig) -> tuple[str, ...]:
    """Return the names of the motions that this robot can be asked for."""
    found: list[str] = []
    for name in motion_names():
        try:
            load_motion(name, robot)
        except MotionError:
            continue
        found.append(name)
    return tuple(found)
