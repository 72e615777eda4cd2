"""Settings of a served controller."""

from dataclasses import dataclass, field

from pipeline.evaluation.errors import WASHOUT_STEPS
from pipeline.learner.insight import KnowsDeviation
from pipeline.learner.rule import OnlineLearner
from pipeline.robot.range_check import MAX_DISTANCE_M
from pipeline.samples.pairing import COMMANDED
from pipeline.serving.output.command_types import CommandFormat
from pipeline.serving.output.speed_limiter import check_speed
from recorders.errors import ConfigError


@dataclass(frozen=True)
class ServingConfig:
    """Learning, washout, and which targets are counted as outside.

    Parameters
    ----------
    learn : bool
        Whether to go on learning. From pairs as commanded, a command then waits for `/sample/joint_states` of its tick;
        from others, ticks that were measured are learned apart from the targets.
    washout_steps : int
        The first target of a cycle is held this long beforehand, as an evaluation does; 0 goes on from the
        controller's own state.
    outside_m : float
        Targets farther than this from the centre of their pattern are counted, and served [m].
    refuse_beyond : bool
        Whether targets are refused for which the controller expects more than `pipeline.serving.deviations.BEYOND`
        times the deviation that it has where it was taught. A command then waits for that to be computed.
    max_speed : float, optional
        Largest speed at which commands move a joint [rad/s, m/s]; the first is then the posture measured. None: a
        command is where the joints are to be, however far off.
    commands : CommandFormat
        Message type and topic of the commands.

    Raises
    ------
    ConfigError
        If a number is out of range.
    """

    learn: bool = False
    washout_steps: int = WASHOUT_STEPS
    outside_m: float = 0.25  # the robot reaches all of the square of this half width
    refuse_beyond: bool = False
    max_speed: float | None = None
    commands: CommandFormat = field(default_factory=CommandFormat)

    def __post_init__(self) -> None:
        if self.washout_steps < 0 or not 0.0 < self.outside_m <= MAX_DISTANCE_M:
            raise ConfigError(
                f"expected washout_steps of at least 0 and outside_m up to {MAX_DISTANCE_M:g} m, "
                f"found {self.washout_steps} and {self.outside_m:g}"
            )

        if self.max_speed is not None:
            check_speed(self.max_speed)

    def check_offers(self, learner: OnlineLearner, *, pairs: str) -> None:
        """Raise ConfigError if a learner of some pairs cannot do what is asked for beside answering."""
        rule = learner.config.rule
        if self.learn and pairs != COMMANDED and learner.config.remembers:
            raise ConfigError(
                f"--learn: expected a controller of pairs {COMMANDED}, or of a rule whose commands depend on nothing "
                f"before their targets, found one of {pairs} and rule {rule}; serve it without"
            )
        if self.learn and pairs == COMMANDED and self.max_speed is not None:
            raise ConfigError(
                f"--max-speed: with --learn, expected a controller of other pairs than {COMMANDED}: joints that are on "
                "their way are none that a target commands; serve it without --learn"
            )
        if self.refuse_beyond and not isinstance(learner, KnowsDeviation):
            raise ConfigError(
                "--refuse-beyond: expected a controller that knows how far off its commands may be, found one of rule "
                f"{rule}; serve it without"
            )
