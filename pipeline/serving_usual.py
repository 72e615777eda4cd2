"""The usual pair of targets, answered in one compiled call: a command then waits for nothing that others must do."""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from pipeline import kernels
from pipeline.learner import Learner
from pipeline.serving_codec import CommandEncoder, pose_layout

Floats = NDArray[np.float64]


class UsualPair:
    """Answers two poses that ask for no more than a command: alike but for their positions, and those near the pattern.

    Parameters
    ----------
    learner : Learner
        Says what its next outputs would be.
    encoder : CommandEncoder
        Its positions and stamp are written.
    limits : ndarray, shape (2, n)
        Lower, then upper limits of the joints [rad, m].
    centres : ndarray, shape (6,)
        Of both hands' patterns, left then right [m].
    near_m : float
        Positions are usual this far from them, along each axis [m].
    u, outputs : ndarray, shape (6,) and (outputs,)
        Filled with the targets and the next outputs [m, rad].
    """

    def __init__(
        self,
        learner: Learner,
        encoder: CommandEncoder,
        *,
        limits: Floats,
        centres: Floats,
        near_m: float,
        u: Floats,
        outputs: Floats,
    ) -> None:
        usual, position_at = pose_layout()
        self._size = len(usual)
        self._left, left, left_position = _aligned(usual, position_at)
        self._right, right, right_position = _aligned(usual, position_at)
        head = np.frombuffer(usual, np.uint8, position_at)
        poses = left, right, left_position, right_position, head
        places = limits, u, outputs, encoder.positions
        self._answer = partial(kernels.answer_pair, *poses, centres, near_m, *learner.foresight, *places, encoder.stamp)

    def answer(self, left: bytes, right: bytes, after_ns: int) -> int:
        """Return the stamp [ns] of two usual poses, later than `after_ns`, or -1 if they are none.

        The encoder then has their command, and `u` and `outputs` what led to it; after -1 they mean nothing.
        """
        if len(left) != self._size or len(right) != self._size:
            return kernels.UNUSUAL
        self._left[:] = left
        self._right[:] = right
        return self._answer(after_ns)


def _aligned(usual: bytes, position_at: int) -> tuple[memoryview, kernels.ByteArray, Floats]:
    """Return memory for a pose: to be filled, as bytes, and as the position in it, at a multiple of eight bytes."""
    padding = -position_at % 8
    memory = bytearray(padding) + usual
    pose = np.frombuffer(memory, np.uint8, len(usual), padding)
    return memoryview(memory)[padding:], pose, np.frombuffer(memory, np.float64, 3, padding + position_at)
