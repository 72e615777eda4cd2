"""Messages of a served controller's namespace as the ticks that it takes: renamed, and aligned if that is asked for."""

from collections.abc import Iterator

from pipeline.alignment.live import LiveInputs
from pipeline.evaluation.trials import robot_of
from pipeline.learner.controller import Controller
from pipeline.robot.config import RobotConfig
from pipeline.samples.pairing import COMMANDED, find_pairing
from pipeline.serving.node_config import ServeConfig
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import JOINT_STATES, SESSION_PHASE, hand_target, type_of


class ServedInputs:
    """Messages on their way to a controller.

    Targets that are answered are aligned apart from the hands and joints that are learned from, where these are others:
    no command waits for what was measured.

    Parameters
    ----------
    controller : Controller
        What is served.
    config : ServeConfig
        Whether it learns, new names of topics, and how they are aligned.
    wanted : tuple of str
        Our names of all topics that the controller takes.

    Attributes
    ----------
    plain : bool
        Whether messages go on as they are.
    topics : tuple of str
        Topics to subscribe to.
    types : dict of str to str
        Their types.

    Raises
    ------
    ConfigError
        If the topic of the ticks is none of the controller's.
    """

    def __init__(self, controller: Controller, config: ServeConfig, wanted: tuple[str, ...]) -> None:
        self.plain = config.alignment is None and not config.renames
        self.topics = wanted
        self.types = {topic: type_of(topic) for topic in wanted}
        self._inputs: list[LiveInputs] = []
        if self.plain:
            return
        robot = robot_of(controller)
        ticks = [wanted] if config.alignment is None else _ticks(controller, robot, learn=config.serving.learn)
        aligned = [(tick, config.alignment) for tick in ticks]
        if config.alignment is not None and JOINT_STATES in wanted:
            aligned.append(((JOINT_STATES,), None))  # the posture to start from is taken as it is published
        for tick, alignment in aligned:
            renames = {name: ours for name, ours in config.renames.items() if ours in tick}
            self._inputs.append(LiveInputs(robot, alignment, renames=renames, tick=tick))
        named = {topic: inputs.types[topic] for inputs in self._inputs for topic in sorted(inputs.topics)}
        self.types = {topic: kind for topic, kind in named.items() if topic != SESSION_PHASE}
        self.topics = tuple(self.types)

    @property
    def counts(self) -> dict[str, int]:
        """Ticks made and missed by all alignments so far, and messages that they dropped; empty without one."""
        counts = [inputs.counts for inputs in self._inputs if inputs.counts]
        return {name: sum(each[name] for each in counts) for name in counts[0]} if counts else {}

    def taken(self, record: RecordedMessage) -> Iterator[RecordedMessage]:
        """Yield what a controller takes of a message."""
        if self.plain or record.topic == SESSION_PHASE:
            yield record
        for inputs in self._inputs:
            if record.topic in inputs.topics:
                yield from (made for made, _ in inputs.feed(record, numbered=True) if made.topic != SESSION_PHASE)


def _ticks(controller: Controller, robot: RobotConfig, *, learn: bool) -> list[tuple[str, ...]]:
    """Return the topics of each tick that is aligned: of targets, and of what is learned from, where it is apart."""
    targets = tuple(map(hand_target, robot.hand_names))
    if not learn:
        return [targets]
    learned = find_pairing(controller.pairs).topics(robot.hand_names)
    return [learned] if controller.pairs == COMMANDED else [targets, learned]
