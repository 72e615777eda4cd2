"""Pattern 2 of the paper: an eight, and a circle."""

from pipeline.motions.motion import Motion, NamedMotion
from pipeline.motions.plane_pattern import plane_pattern, turning_angles
from pipeline.robot.config import RobotConfig
from pipeline.trigonometry import cosine, sine


def eight(robot: RobotConfig) -> Motion:
    """Pattern 2 (T = 64): twice a lying eight with the left hand, twice a circle with the right.

    The left/right coordinate of both hands is exactly the same: they never both point to the middle or both outwards.
    A third hand goes as the first, a fourth as the second, and so on.
    """
    angle = turning_angles((2,), samples=64, start=0.0)
    paths = ((sine(angle), sine(2.0 * angle)), (sine(angle), cosine(angle)))
    return plane_pattern("eight", robot, [paths[hand % 2] for hand in range(len(robot.hands))])


MOTION = NamedMotion("eight", eight)
