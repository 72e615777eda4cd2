"""A robot whose joints are wrongly zeroed: sensors and motors of each are off by the same fixed angle."""

import numpy as np
from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from pipeline.robot.backend import LinkPose, ResettableLinkPoseSource
from pipeline.robot.config import RobotConfig
from pipeline.seeding import uniforms
from recorders.errors import ConfigError

_LEAST_SHARE = 0.6  # no joint is off by less than this part of the largest offset
_STEPS_PER_UNIT = 2.0**20  # offsets are whole numbers of these steps, which float64 adds exactly


def joint_offsets(seed: int, joints: int, *, largest: float) -> Floats:
    """Draw how far each joint is off, either way, by 60 to 100 % of the largest offset.

    Parameters
    ----------
    seed : int
        Names the draw.
    joints : int
        How many.
    largest : float
        Largest offset [rad or m].

    Returns
    -------
    ndarray, shape (joints,)
        Offsets [rad or m], multiples of 2^-20.

    Raises
    ------
    ConfigError
        If the largest offset is not between 0 and 1.
    """
    if not 0.0 <= largest <= 1.0:
        raise ConfigError(f"expected an offset of 0 to 1 rad, found {largest:g}")
    sizes = _LEAST_SHARE + (1.0 - _LEAST_SHARE) * uniforms(seed, "joint offset", count=joints)
    signs = np.where(uniforms(seed, "joint offset", "sign", count=joints) < 0.5, -1.0, 1.0)
    offsets: Floats = np.rint(largest * sizes * signs * _STEPS_PER_UNIT) / _STEPS_PER_UNIT
    return offsets


class OffsetRobot:
    """A robot behind joint sensors and motors that are off: at 0, as it measures, a joint is at minus its offset.

    Commands and measured joints are as its encoders have them; hands and link poses are where they truly are.
    Implements `pipeline.robot.backend.LinkPoseSource`.

    Parameters
    ----------
    inner : LinkPoseSource
        The robot as it truly is.
    offsets : array_like, shape (n,)
        Measured minus true position of each joint [rad or m].
    """

    def __init__(self, inner: ResettableLinkPoseSource, offsets: ArrayLike) -> None:
        self._inner, self._offsets = inner, np.array(offsets, dtype=np.float64)
        self.reset(inner.robot.comfort)

    @property
    def robot(self) -> RobotConfig:
        """The robot as it is taken to be."""
        return self._inner.robot

    @property
    def time_ns(self) -> int:
        """The robot's time [ns]."""
        return self._inner.time_ns

    @property
    def positions(self) -> Floats:
        """Joint positions as measured [rad or m], shape (n,)."""
        return self._inner.positions + self._offsets

    @property
    def velocities(self) -> Floats:
        """Joint velocities [rad/s or m/s], shape (n,)."""
        return self._inner.velocities

    def reset(self, q: ArrayLike, *, time_ns: int = 0) -> None:
        """Stand still at posture `q` (n,), as measured, at a time [ns]."""
        self._inner.reset(np.asarray(q, dtype=np.float64) - self._offsets, time_ns=time_ns)

    def advance(self, q_command: ArrayLike, duration_ns: int) -> None:
        """Command posture `q_command` (n,), as measured, and simulate `duration_ns`."""
        self._inner.advance(np.asarray(q_command, dtype=np.float64) - self._offsets, duration_ns)

    def hands(self) -> Floats:
        """Positions of the hands, where they truly are [m], world frame, shape (hands, 3)."""
        return self._inner.hands()

    def link_poses(self) -> list[LinkPose]:
        """Pose of every link in its parent link, as it truly is."""
        return self._inner.link_poses()
