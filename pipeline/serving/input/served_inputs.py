"""Messages of a served controller's namespace as the ticks that it takes: renamed, and aligned if that is asked for."""

from collections.abc import Iterator

from pipeline.alignment.live import LiveInputs
from pipeline.evaluation.trials import robot_of
from pipeline.learner.controller import Controller
from pipeline.samples.pairing import COMMANDED, find_pairing
from pipeline.serving.node_config import ServeConfig
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import JOINT_STATES, SESSION_PHASE, hand_target


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

    Raises
    ------
    ConfigError
        If the topic of the ticks is none of the controller's.
    """

    def __init__(self, controller: Controller, config: ServeConfig, wanted: tuple[str, ...]) -> None:
        self.plain = config.alignment is None and not config.renames
        self.topics = wanted
        self._inputs: list[LiveInputs] = []
        self._start = JOINT_STATES in wanted
        if self.plain:
            return
        robot = robot_of(controller)
        ticks = [tuple(map(hand_target, robot.hand_names))]
        if config.serving.learn:
            learned = find_pairing(controller.pairs).topics(robot.hand_names)
            ticks = [learned] if controller.pairs == COMMANDED else [*ticks, learned]
        self._inputs = [LiveInputs(robot, config.alignment, renames=config.renames, tick=tick) for tick in ticks]
        named = dict.fromkeys(topic for inputs in self._inputs for topic in sorted(inputs.topics))
        start = (JOINT_STATES,) if self._start else ()
        self.topics = tuple(dict.fromkeys((*(topic for topic in named if topic != SESSION_PHASE), *start)))

    @property
    def counts(self) -> dict[str, int]:
        """Ticks made and missed by all alignments so far, and messages that they dropped; empty without one."""
        counts = [inputs.counts for inputs in self._inputs if inputs.counts]
        return {name: sum(each[name] for each in counts) for name in counts[0]} if counts else {}

    def taken(self, record: RecordedMessage) -> Iterator[RecordedMessage]:
        """Yield what a controller takes of a message."""
        if self.plain or record.topic == SESSION_PHASE or (self._start and record.topic == JOINT_STATES):
            yield record
        for inputs in self._inputs:
            if record.topic in inputs.topics:
                yield from (made for made, _ in inputs.feed(record, numbered=True) if made.topic != SESSION_PHASE)
