"""The parts of a learner's state that a viewer shows: how far what learns has moved, how active its neurons are."""

from typing import NamedTuple

import numpy as np

from pipeline.arrays import Floats
from pipeline.evaluation.errors import WASHOUT_STEPS
from pipeline.learner.controller import Controller
from pipeline.learner.insight import ShowsParts
from pipeline.learner.registry import make_learner

MAX_TICKS = 128
"""Ticks of a motion over which the activity is shown."""


class Parts(NamedTuple):
    """Parts of a learner's commands: curves over the commands, by name and unit, and a line on each part."""

    curves: dict[str, Floats]
    lines: tuple[str, ...]


class NetworkView:
    """Looks into learners of one configuration without touching them: it has a copy of its own.

    Parameters
    ----------
    controller : Controller
        One of them.

    Attributes
    ----------
    shown : Shown
        What its rule shows.
    """

    def __init__(self, controller: Controller) -> None:
        self.shown = controller.config.shown()
        self._copy = make_learner(
            controller.config, input_centre=controller.input_centre, output_centre=controller.output_centre
        )
        self._initial = self._copy.state()

    def moved(self, controller: Controller) -> dict[str, Floats]:
        """Return how far everything that learns has moved since the start, by curve."""
        state = controller.state
        return {curve: (state[name] - self._initial[name]).ravel() for curve, name in self.shown.drift.items()}

    def spread(self, controller: Controller) -> dict[str, Floats]:
        """Return the arrays whose mean and deviation are shown."""
        return {name: controller.state[name].ravel() for name in self.shown.spread}

    def parts(self, controller: Controller, targets: Floats) -> Parts | None:
        """Return the parts of the commands to targets (T, inputs) [m]; None if the rule shows none."""
        learner = self._copy
        if not isinstance(learner, ShowsParts):
            return None
        learner.load_state(controller.state)
        return Parts(learner.curves(targets), learner.lines())

    def activity(self, controller: Controller, targets: Floats) -> Floats | None:
        """Return the activity while it follows targets (T, 3 hands) [m], after a washout; None if the rule shows none.

        Returns
        -------
        ndarray, shape (at most MAX_TICKS, neurons), or None
        """
        if not self.shown.activity:
            return None
        learner = self._copy
        learner.load_state(controller.state)
        learner.washout(targets[0], steps=WASHOUT_STEPS)
        rows = []
        for u in targets[:MAX_TICKS]:
            learner.predict(u[np.newaxis])
            rows.append(learner.state()[self.shown.activity][self.shown.first :])
        return np.array(rows)
