"""Pattern 1 of the paper: circles of both hands."""

from pipeline.motions.motion import Motion, NamedMotion
from pipeline.motions.plane_pattern import plane_pattern, turning_angles
from pipeline.robot.config import RobotConfig
from pipeline.trigonometry import cosine, sine


def circles(robot: RobotConfig) -> Motion:
    """Pattern 1 (T = 256): circles of both hands that combine all their positions evenly.

    In the first half the left hand turns 6 times one way and the right hand 7 times the other; in the second half
    they exchange speeds and directions. The sum of both angles thus drifts through one slow turn in each half, and each
    of the 16 combinations of quadrants (left hand top/down and left/right, right hand the same) gets 16 samples.
    A third hand goes as the first and a fourth as the second, and so on, each from an angle of its own.
    """
    turns = ((6, -7), (-7, 6))
    angles = [turning_angles(turns[hand % 2], samples=256, start=0.3 + 0.8 * hand) for hand in range(len(robot.hands))]
    return plane_pattern("circles", robot, [(cosine(angle), sine(angle)) for angle in angles])


MOTION = NamedMotion("circles", circles)
