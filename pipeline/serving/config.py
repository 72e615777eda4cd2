"""Settings of a served controller."""

from dataclasses import dataclass

from pipeline.evaluation.errors import WASHOUT_STEPS
from pipeline.robot.range_check import MAX_DISTANCE_M
from recorders.errors import ConfigError


@dataclass(frozen=True)
class ServingConfig:
    """Learning, washout, and which targets are counted as outside.

    Parameters
    ----------
    learn : bool
        Whether to go on learning. A command then waits for `/sample/joint_states` of its tick.
    washout_steps : int
        The first target of a cycle is held this long beforehand, as an evaluation does; 0 goes on from the
        controller's own state.
    outside_m : float
        Targets farther than this from the centre of their pattern are counted, and served [m].

    Raises
    ------
    ConfigError
        If a number is out of range.
    """

    learn: bool = False
    washout_steps: int = WASHOUT_STEPS
    outside_m: float = 0.25  # the robot reaches all of the square of this half width

    def __post_init__(self) -> None:
        if self.washout_steps < 0 or not 0.0 < self.outside_m <= MAX_DISTANCE_M:
            raise ConfigError(
                f"expected washout_steps of at least 0 and outside_m up to {MAX_DISTANCE_M:g} m, "
                f"found {self.washout_steps} and {self.outside_m:g}"
            )
