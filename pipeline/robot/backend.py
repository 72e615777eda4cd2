"""Protocol of a robot that can be driven: the same few methods for a simulation and for a robot across a network."""

from dataclasses import dataclass
from typing import Protocol

from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig


@dataclass(frozen=True, slots=True, eq=False)
class LinkPose:
    """Pose of a link in its parent link.

    Attributes
    ----------
    parent, child : str
        Link names.
    translation : ndarray
        Origin of the child in the parent [m], shape (3,).
    rotation : ndarray
        Quaternion x, y, z, w of the child in the parent, shape (4,).
    """

    parent: str
    child: str
    translation: Floats
    rotation: Floats


class RobotBackend(Protocol):
    """Robot that takes joint commands and measures its joints. Postures are in the order of ``robot.joints``."""

    @property
    def robot(self) -> RobotConfig:
        """The robot being driven."""
        ...

    @property
    def time_ns(self) -> int:
        """The robot's time [ns]: that of the reset and all durations advanced since."""
        ...

    @property
    def positions(self) -> Floats:
        """Measured joint positions [rad or m], shape (n,)."""
        ...

    @property
    def velocities(self) -> Floats:
        """Measured joint velocities [rad/s or m/s], shape (n,)."""
        ...

    def reset(self, q: ArrayLike) -> None:
        """Stand still at posture `q` (n,), at time 0."""
        ...

    def advance(self, q_command: ArrayLike, duration_ns: int) -> None:
        """Command posture `q_command` (n,) and let `duration_ns` pass."""
        ...

    def hands(self) -> Floats:
        """Hands by row, world frame, shape (hands, row size): positions [m], and orientations where one counts.

        See `pipeline.robot.coordinates`.
        """
        ...


class ResettableRobot(RobotBackend, Protocol):
    """A robot that can be put anywhere at any time, as a simulated one can."""

    def reset(self, q: ArrayLike, *, time_ns: int = 0) -> None:
        """Stand still at posture `q` (n,), at a time [ns]."""
        ...


class LinkPoseSource(RobotBackend, Protocol):
    """Robot that also measures the poses of its links, for viewers."""

    def link_poses(self) -> list[LinkPose]:
        """Pose of every link in its parent link."""
        ...


class ResettableLinkPoseSource(ResettableRobot, LinkPoseSource, Protocol):
    """A simulated robot that measures the poses of its links."""

    def reset(self, q: ArrayLike, *, time_ns: int = 0) -> None:
        """Stand still at posture `q` (n,), at a time [ns]."""
        ...
