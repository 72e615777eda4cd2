"""What a viewer shows of a network: how far its weights have moved, and how active its reservoir is."""

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluation.errors import WASHOUT_STEPS
from pipeline.learner.controller import Controller
from pipeline.learner.learner import Learner

Floats = NDArray[np.float64]

MAX_TICKS = 128
"""Ticks of a motion over which the activity is shown."""


class NetworkView:
    """Looks into networks of one configuration without touching them: it has a copy of its own.

    Parameters
    ----------
    controller : Controller
        One of them.
    """

    def __init__(self, controller: Controller) -> None:
        self._copy = Learner(
            controller.config, input_centre=controller.input_centre, output_centre=controller.output_centre
        )
        self._initial = self._copy.state()
        parts = controller.config.connections()
        self.weights = [part.name for part in parts if part.target == "output" and part.count > 0]

    def moved(self, controller: Controller) -> dict[str, Floats]:
        """Return how far each weight that learns has moved since the start, by kind of connection."""
        names = {name: f"{name}_weights" for name in self.weights}
        return {name: controller.state[key] - self._initial[key] for name, key in names.items()}

    def activity(self, controller: Controller, targets: Floats) -> Floats:
        """Return y of the reservoir while it follows targets (T, 6) [m], after a washout.

        Returns
        -------
        ndarray, shape (at most MAX_TICKS, neurons)
        """
        learner = self._copy
        learner.load_state(controller.state)
        learner.washout(targets[0], steps=WASHOUT_STEPS)
        rows = []
        for u in targets[:MAX_TICKS]:
            learner.predict(u[np.newaxis])
            rows.append(learner.state()["y"][controller.config.outputs :])
        return np.array(rows)
