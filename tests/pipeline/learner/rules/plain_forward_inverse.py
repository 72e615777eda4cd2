"""The rule `forward-inverse` in plain numpy: matrices, `numpy.linalg`, written to be read beside its description.

An independent reading for the tests: it takes from the rule its settings and the order of its features alone.
"""

import math
from itertools import combinations_with_replacement

import numpy as np
from numpy.polynomial.legendre import legval


class PlainModel:
    """Weights that are linear in products of polynomials, learned by recursive least squares."""

    def __init__(self, variables, degree, outputs, *, prior, forgetting, legendre=True):
        self.variables, self.prior, self.forgetting, self.legendre = list(variables), prior, forgetting, legendre
        self.degree = degree
        places = range(len(self.variables))
        self.products = [p for total in range(degree + 1) for p in combinations_with_replacement(places, total)]
        self.weights = np.zeros((len(self.products), outputs))
        self.covariance = np.eye(len(self.products)) / prior
        self.errors, self.leverage = np.zeros(outputs + 1), np.zeros(2 * outputs + 4)

    def features(self, x):
        """Products of P_k(x) / k!, or of x^k / k!."""
        return np.array([self._product(p, x[self.variables]) for p in self.products])

    def outputs(self, x):
        return self.features(x) @ self.weights

    def derivatives(self, x):
        """By each variable: x^k / k! becomes x^(k-1) / (k-1)!; shape (outputs, variables)."""
        variables = range(len(self.variables))
        return np.stack([self._slopes(v, x[self.variables]) @ self.weights for v in variables], axis=1)

    def learn(self, x, desired):
        f = self.features(x)
        gain = self.covariance @ f
        variance, kept = f @ gain, self.forgetting
        if variance < 2.0 * (1.0 - kept):
            return
        error = desired - self.weights.T @ f
        self._learn_errors(error, variance)
        self.weights += np.outer(gain, error) / (kept + variance)
        self.covariance -= np.outer(gain, gain) / (kept + variance)
        if kept < 1.0:
            grown = np.minimum(np.sqrt(1.0 / kept), np.sqrt(1.0 / self.prior / np.diag(self.covariance)))
            self.covariance *= np.outer(grown, grown)

    def deviation(self, x, units):
        """Root of the line a + b x of squared errors over leverage, a and b not below 0; [m]."""
        m, samples = self.weights.shape[1], self.leverage[-1]
        if samples == 0:
            return math.inf
        constant, slope = self.leverage[:3] @ units[:3] ** 2, self.leverage[m : m + 3] @ units[:3] ** 2
        w, wx, wxx = self.leverage[2 * m : 2 * m + 3]
        a, b = constant / w, 0.0
        if w * wxx - wx * wx > 1e-9 * w * wxx:
            line = np.linalg.solve([[w, wx], [wx, wxx]], [constant, slope])
            a, b = line if min(line) >= 0.0 else (0.0, slope / wxx) if line[0] < 0.0 else (a, b)
        f = self.features(x)
        return math.sqrt(a + b * (f @ self.covariance @ f) * (1.0 + samples / len(f)))

    def _learn_errors(self, error, variance):
        x = variance * (1.0 + self.leverage[-1] / len(self.products))
        weight = (1.0 + variance) ** -3.0
        w = weight / (1.0 + x) ** 2
        squares = error**2
        self.errors = self.errors * self.forgetting + [*(squares * weight / (1.0 + variance)), weight]
        added = [*(squares * w), *(squares * w * x), w, w * x, w * x * x, 1.0]
        self.leverage = self.leverage * self.forgetting + added

    def _slopes(self, v, x):
        lower = [p[: p.index(v)] + p[p.index(v) + 1 :] if v in p else None for p in self.products]
        return np.array([0.0 if p is None else self._product(p, x) for p in lower])

    def _product(self, product, x):
        return math.prod(self._power(x[v], product.count(v)) for v in set(product))

    def _power(self, x, k):
        return (legval(x, np.eye(self.degree + 1)[k]) if self.legendre else x**k) / math.factorial(k)


class PlainForwardInverse:
    """The estimate of an inverse model, corrected by one Newton step on forward models; a residual corrects the aim."""

    def __init__(self, config, *, input_centre, output_centre):
        self.config, body, inputs = config, config.known_body, config.inputs
        self.centre, self.reach = np.asarray(input_centre), np.array(body.reach)
        self.comfort = np.asarray(output_centre)[inputs:]
        self.lower, self.upper = np.array(body.lower), np.array(body.upper)
        self.half = (self.upper - self.lower) / 2.0
        every = range(inputs)
        own = {"forgetting": config.forgetting}
        self.inverse = PlainModel(every, config.degree, len(body.joints), prior=config.inverse_prior, **own)
        self.forward = [
            PlainModel(moves, config.degree, len(axes), prior=config.prior, **own, legendre=False)
            for moves, axes in zip(body.moves, body.hand_axes, strict=True)
        ]
        residual = {"prior": config.residual_prior, "forgetting": config.residual_forgetting}
        self.residual = (
            PlainModel(every, config.residual_degree, inputs, **residual) if config.residual_degree else None
        )
        self.ends = np.cumsum([len(axes) for axes in body.hand_axes])

    def step(self, u, d, *, learning):
        """One command, then what is learned; returns the outputs from before it."""
        target = (u - self.centre) / self.reach
        aim = self.aim(target)
        estimate = self.limited(self.inverse.outputs(aim))
        hands, jacobian = self.hands(estimate), self.jacobian(estimate)
        square = jacobian @ jacobian.T
        posture = estimate
        if square.any():
            mu = self.config.damping * np.trace(square) / len(square)
            newton = np.linalg.solve(square + mu * np.eye(len(square)), aim - hands)
            posture = self.limited(estimate + jacobian.T @ newton)
            hands = hands + jacobian @ (posture - estimate)
        if learning:
            self.learn(target, (d[len(u) :] - self.comfort) / self.half)
        return np.concatenate([self.centre + self.reach * (hands + target - aim), self.comfort + self.half * posture])

    def learn(self, target, posture):
        if self.residual:
            self.residual.learn(target, target - self.hands(posture))
        aim = self.aim(target)
        self.inverse.learn(aim, posture)
        for model, part in zip(self.forward, np.split(aim, self.ends[:-1]), strict=True):
            model.learn(posture * self.half, part)

    def aim(self, target):
        return target - self.residual.outputs(target) if self.residual else target

    def limited(self, posture):
        joints = np.clip(self.comfort + self.half * posture, self.lower, self.upper)
        return (joints - self.comfort) / self.half

    def hands(self, posture):
        """Scaled hands at a scaled posture."""
        return np.concatenate([model.outputs(posture * self.half) for model in self.forward])

    def jacobian(self, posture):
        """Derivatives of the scaled hands by the scaled posture, shape (inputs, joints)."""
        rows = np.zeros((self.config.inputs, len(self.half)))
        for model, last in zip(self.forward, self.ends, strict=True):
            first = last - model.weights.shape[1]
            rows[first:last, model.variables] = model.derivatives(posture * self.half) * self.half[model.variables]
        return rows

    def models(self):
        """Every model by its name in the state."""
        names = [f"forward_{hand}" for hand in self.config.known_body.hands]
        found = {"inverse": self.inverse, **dict(zip(names, self.forward, strict=True))}
        return found | ({"residual": self.residual} if self.residual else {})
