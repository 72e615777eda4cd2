"""A learner that answers one target at a time, and can say what it would answer."""

import struct
from collections.abc import Sequence
from operator import sub

import numpy as np
from numpy.typing import NDArray

from pipeline import kernels
from pipeline.controller import Controller
from pipeline.learner import Learner
from recorders.errors import ConfigError

Floats = NDArray[np.float64]


class ForesightLearner(Learner):
    """The learner of a controller, at the controller's state, with a short way for single targets.

    Parameters
    ----------
    controller : Controller
        Configuration, constants and state.
    """

    def __init__(self, controller: Controller) -> None:
        config = controller.config
        super().__init__(config, input_centre=controller.input_centre, output_centre=controller.output_centre)
        self.load_state(controller.state)
        self._u = np.empty((1, config.inputs))
        self._centred = struct.Struct(f"={config.inputs}d")  # fills `u` several times as fast as an assignment
        self._centre: tuple[float, ...] = tuple(self.input_centre.tolist())
        self._outputs = np.empty((1, config.outputs))

    def answer(self, u: Sequence[float]) -> Floats:
        """Return what `predict` does: u [m], length (inputs,), to outputs [m, rad], shape (outputs,).

        Raises
        ------
        ConfigError
            If the state is no longer finite.
        """
        net = self._network
        self._centred.pack_into(self._u.data, 0, *map(sub, u, self._centre))
        status = kernels.run(
            self._u, self._no_target, False, net.sizes, net.sources, net.memory, self._rates, self._outputs
        )
        if status != kernels.OK:
            raise ConfigError("the controller's state is no longer finite; serve it again, from its file")
        outputs: Floats = np.add(self._outputs[0], self.output_centre)
        return outputs

    def foresee(self, u: Sequence[float]) -> Floats:
        """Return what `answer` would, and leave the state as it is."""
        memory = self._network.memory
        before = memory.copy()
        try:
            return self.answer(u)
        finally:
            memory[:] = before
