"""Targets on their way to where they are wanted, no faster than a hand should go."""

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from pipeline.robot.coordinates import POSITION_SIZE
from pipeline.rotations import inverse, product, quaternions_of, vectors_of
from recorders.errors import ConfigError

_THERE_M = 1e-4  # nearer than this, a target is where it is wanted


@dataclass(frozen=True)
class PaceConfig:
    """Speed of the targets.

    Attributes
    ----------
    speed_m_s : float
        Largest speed of a hand's target [m/s].
    turn_rad_s : float
        Largest speed of its turn [rad/s].
    gain : float
        Part of the way that is left which a target goes in a second, once that is slower [1/s].
    """

    speed_m_s: float = 0.5
    turn_rad_s: float = 1.5
    gain: float = 10.0

    def __post_init__(self) -> None:
        if not (self.speed_m_s > 0.0 and self.turn_rad_s > 0.0 and self.gain > 0.0):
            raise ConfigError(
                f"pace of the targets: expected numbers above 0, found {self.speed_m_s:g}, {self.turn_rad_s:g} "
                f"and {self.gain:g}"
            )


class MovingTargets:
    """Targets of all hands by row, which follow what is wanted at a bounded speed and slow down before they arrive.

    Parameters
    ----------
    robot : RobotConfig
        Whose hands they are.
    rows : ndarray, shape (hands, 3 or 7)
        Where the targets begin.
    config : PaceConfig
        Speeds.

    Attributes
    ----------
    rows, wanted : ndarray, shape (hands, 3 or 7)
        The targets, and where they go.
    """

    def __init__(self, robot: RobotConfig, rows: Floats, config: PaceConfig = PaceConfig()) -> None:
        self._posed = [hand.orientation is not None for hand in robot.hands]
        self._config = config
        self.rows = rows.copy()
        self.wanted = rows.copy()

    @property
    def arrived(self) -> bool:
        """Whether every position is where it is wanted."""
        left = (self.wanted - self.rows)[:, :POSITION_SIZE]
        return bool(np.linalg.norm(left, axis=1).max() <= _THERE_M)

    def advance(self, time_s: float) -> Floats:
        """Return the targets after some more time [s], shape (hands, 3 or 7)."""
        share = min(1.0, self._config.gain * time_s)
        rows = self.rows.copy()
        for place, posed in enumerate(self._posed):
            left = self.wanted[place, :POSITION_SIZE] - rows[place, :POSITION_SIZE]
            rows[place, :POSITION_SIZE] += _bounded(left, share, self._config.speed_m_s * time_s)
            if posed:
                rows[place, POSITION_SIZE:] = self._turned(place, share, self._config.turn_rad_s * time_s)
        self.rows = rows
        return rows

    def _turned(self, place: int, share: float, longest: float) -> Floats:
        """Return the orientation of a hand after a part of the turn that is left."""
        found, wanted = self.rows[place, POSITION_SIZE:], self.wanted[place, POSITION_SIZE:]
        left = vectors_of(product(wanted, inverse(found)))
        return np.asarray(product(quaternions_of(_bounded(left, share, longest)), found))


def _bounded(left: Floats, share: float, longest: float) -> Floats:
    """Return a share of a way, at most so long; all of it where next to nothing is left."""
    length = float(np.linalg.norm(left))
    if length <= _THERE_M:
        return left
    return left * min(share, longest / length)
