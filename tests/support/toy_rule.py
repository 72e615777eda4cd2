"""A learning rule from outside the package: a linear map, taught by the delta rule, in plain Python."""

from dataclasses import dataclass

import numpy as np

from pipeline.learner.rows import finite_rows, pairs_of
from pipeline.learner.rule import Rule, Settings
from pipeline.learner.state import check_state, state_digest


@dataclass(frozen=True, kw_only=True)
class ToyConfig(Settings):
    rule = "toy"
    inputs: int = 6
    outputs: int = 21
    epochs: int = 150
    seed: int = 0
    rate: float = 0.5

    def state_shapes(self):
        return {"w": (self.outputs, self.inputs), "epoch": (1,)}


class ToyLearner:
    def __init__(self, config, *, input_centre, output_centre):
        self.config, self.input_centre, self.output_centre = config, np.array(input_centre), np.array(output_centre)
        self._state = {name: np.zeros(shape) for name, shape in config.state_shapes().items()}

    def begin_epoch(self, epoch):
        self._state["epoch"][0] = epoch

    def step(self, u, d, *, learning):
        u, d = finite_rows("u", u, self.config.inputs), finite_rows("d", d, self.config.outputs)
        pairs_of(u, d)
        outputs = np.empty(d.shape)
        for x, target, y in zip(u - self.input_centre, d - self.output_centre, outputs, strict=True):
            for i, weights in enumerate(self._state["w"]):
                y[i] = sum(w * x_j for w, x_j in zip(weights.tolist(), x.tolist(), strict=True))
                if learning:
                    weights += self.config.rate * (target[i] - y[i]) * x
        return outputs + self.output_centre

    def predict(self, u):
        return self.step(u, np.zeros((len(u), self.config.outputs)), learning=False)

    def washout(self, u0, *, steps):
        finite_rows("u0", [u0], self.config.inputs)

    def state(self):
        return {name: values.copy() for name, values in self._state.items()}

    def load_state(self, state):
        check_state(self.config.state_shapes(), state)
        self._state = {name: np.array(state[name]) for name in self._state}

    def connections_digest(self):
        return state_digest({})


RULE = Rule(ToyConfig, ToyLearner)
