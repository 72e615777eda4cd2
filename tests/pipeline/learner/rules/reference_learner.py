"""The paper's equations in plain numpy: dense matrices, np.exp, written to be read beside the paper.

An independent reading for the tests: it takes from the learner under test only which connections exist and
where they start.
"""

import numpy as np


def fermi(x, a=1.0, b=0.0):
    return 1.0 / (1.0 + np.exp(-a * x - b))  # eq. (3)


class ReferenceLearner:
    """One network as a dense W_net (N, N) and W_in (N, R), N = outputs + reservoir, outputs first, eq. (4)."""

    def __init__(self, learner):
        config, state = learner.config, learner.state()
        self.config = config
        self.outputs, neurons = config.outputs, config.outputs + config.reservoir
        self.w_net, self.w_in = np.zeros((neurons, neurons)), np.zeros((neurons, config.inputs))
        first = {"input": 0, "output": 0, "reservoir": config.outputs}
        self.exists_net, self.exists_in = self.w_net.astype(bool), self.w_in.astype(bool)
        for part in config.connections():
            targets, sources = learner.connections(part.name)
            rows, columns = first[part.target] + targets, first[part.source] + sources
            weights, exists = (self.w_in, self.exists_in) if part.source == "input" else (self.w_net, self.exists_net)
            weights[rows, columns] = state[f"{part.name}_weights"]
            exists[rows, columns] = True
        self.a, self.b = np.ones(config.reservoir), np.zeros(config.reservoir)
        self.restart(state["x"])

    def restart(self, x):
        self.x = x.copy()
        self.y = np.concatenate((fermi(x[: self.outputs]), fermi(x[self.outputs :], self.a, self.b)))
        self.e = np.zeros(self.outputs)

    def step(self, u, d, *, eta, zeta, learning):
        """One step of algorithm 1; returns the outputs from before the update."""
        out, config = slice(0, self.outputs), self.config
        x = self.w_net @ self.y + self.w_in @ u  # eq. (1)
        e = x[out] - d
        if learning:
            slope = self.y[out] * (1.0 - self.y[out])
            gamma = -e + self.w_net[out, out] @ (slope * self.e)  # eq. (7)
            rate = eta / (self.y @ self.y + u @ u + config.bpdc_epsilon)
            self.w_net[out] += self.exists_net[out] * (rate * np.outer(gamma, self.y))  # eq. (5)
            self.w_in[out] += self.exists_in[out] * (rate * np.outer(gamma, u))  # eq. (6)
        self.x, self.e = x, e
        self.y = np.concatenate((fermi(x[out]), fermi(x[self.outputs :], self.a, self.b)))  # eq. (2)
        if learning:
            self.adapt_intrinsically(zeta, config.ip_mu)
        return x[out]

    def adapt_intrinsically(self, zeta, mu):
        x, y = self.x[self.outputs :], self.y[self.outputs :]
        delta_b = zeta * (1.0 - (2.0 + 1.0 / mu) * y + y**2 / mu)  # eq. (8)
        self.a += zeta / self.a + x * delta_b  # eq. (9)
        self.b += delta_b
