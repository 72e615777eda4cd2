"""The two compiled calls of a served controller: answer the usual pair of targets, and then settle."""

import ctypes
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from pipeline.learner.rules.reservoir import kernels
from pipeline.learner.rules.reservoir.learner import Learner
from pipeline.serving.codec import CommandEncoder, pose_layout

Floats = NDArray[np.float64]

_TABLE = ctypes.c_void_p, ctypes.c_void_p
_ANSWER = ctypes.PYFUNCTYPE(ctypes.c_int64, *_TABLE, ctypes.c_char_p, ctypes.c_char_p, ctypes.c_int64)
_SETTLE = ctypes.PYFUNCTYPE(ctypes.c_int64, *_TABLE, ctypes.c_int64)


class ServingCalls:
    """Calls that a command waits for, and that the next one may wait for: each does in one go all that there is to do.

    Parameters
    ----------
    learner : Learner
        Says what its next outputs would be, and takes the step that follows.
    encoder : CommandEncoder
        Its positions and stamp are written.
    limits : ndarray, shape (2, n)
        Lower, then upper limits of the joints [rad, m].
    centres : ndarray, shape (6,)
        Of both hands' patterns, left then right [m].
    near_m : float
        Positions are usual this far from them, along each axis [m].

    Attributes
    ----------
    u : ndarray, shape (6,)
        Targets of the last command [m], as long as nothing else has been asked for.
    outputs : ndarray, shape (outputs,)
        The outputs behind it, beyond the limits where they are [m, rad].
    clipped : ndarray of int64, shape (n,)
        In how many commands a joint was at its limit because the output was beyond.

    Raises
    ------
    ValueError
        If the network, the encoder, the limits and the centres are not of one size.
    """

    def __init__(
        self, learner: Learner, encoder: CommandEncoder, *, limits: Floats, centres: Floats, near_m: float
    ) -> None:
        inputs, outputs, n = learner.config.inputs, learner.config.outputs, encoder.positions.size
        if (inputs, np.shape(centres), np.shape(limits)) != (6, (6,), (2, n)) or outputs < n:
            raise ValueError(
                f"expected 6 inputs and centres, limits (2, {n}) and at least {n} outputs, "
                f"found {inputs}, {np.shape(centres)}, {np.shape(limits)} and {outputs}"
            )
        self.check, self._learner = learner.check, learner
        self._limits, self._limited = np.array(limits, dtype=np.float64), encoder.positions
        self.u, self.outputs = np.empty(inputs), np.empty(outputs)
        self.clipped = np.zeros(n, dtype=np.int64)
        usual, position_at = pose_layout()
        self._pose_size = len(usual)
        left, left_position = _aligned(usual, position_at)
        right, right_position = _aligned(usual, position_at)
        sizes, sources, memory, centre, activations = learner.arrays
        self._served = kernels.Served(
            sizes=sizes,
            sources=sources,
            memory=memory,
            centre=centre,
            activations=activations,
            limits=self._limits.reshape(-1),
            u=self.u,
            outputs=self.outputs,
            limited=encoder.positions,
            stamp=encoder.stamp,
            clipped=self.clipped,
            left=left,
            right=right,
            left_position=left_position,
            right_position=right_position,
            head=np.frombuffer(usual, np.uint8, position_at),
            near=np.array([*centres, near_m], dtype=np.float64),
        )
        self._addresses = kernels.addresses(self._served)
        table = [ctypes.c_void_p(row.ctypes.data) for row in self._addresses]
        answer, settle = kernels.served_calls()
        self._answer: Callable[[bytes, bytes, int], int] = partial(_ANSWER(answer.address), *table)
        self._settle: Callable[[bool], int] = partial(_SETTLE(settle.address), *table)

    def answer(self, left: bytes, right: bytes, after_ns: int) -> int:
        """Return the stamp [ns] of two usual poses (CDR), later than `after_ns`, or -1 if they are none.

        The encoder then has their command, and `u` and `outputs` what led to it; after -1 they mean nothing.
        """
        if len(left) != self._pose_size or len(right) != self._pose_size:
            return kernels.UNUSUAL
        return self._answer(left, right, after_ns)

    def look_ahead(self) -> None:
        """Write the outputs of a step with `u`, within the joints' limits, to the encoder; the state stays as it is.

        Raises
        ------
        ConfigError
            If the outputs are not finite.
        """
        self._learner.look_ahead(self.u, limits=self._limits, outputs=self.outputs, limited=self._limited)

    def settle(self, *, advance: bool) -> int:
        """Count the joints that were clipped in the encoder's command, and take its step, without targets, if told to.

        The learner must have done nothing since; this is not looked at. Returns a status as `Learner.check` takes it.
        """
        return self._settle(advance)


def _aligned(usual: bytes, position_at: int) -> tuple[kernels.ByteArray, Floats]:
    """Return memory for a pose, and the position in it, which begins at a multiple of eight bytes."""
    padding = -position_at % 8
    memory = bytearray(padding) + usual
    position = np.frombuffer(memory, np.float64, 3, padding + position_at)
    return np.frombuffer(memory, np.uint8, len(usual), padding), position
