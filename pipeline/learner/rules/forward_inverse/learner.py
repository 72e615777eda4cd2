"""The learner: an inverse estimate of the joints, and one Newton step on learned forward models of the hands.

Both are polynomials that learn by recursive least squares, one sample at a time, from hands and joints that were
measured at one instant.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from pipeline.learner.body import AXES
from pipeline.learner.rows import centre_of, finite_rows, not_finite, pairs_of, rows_of
from pipeline.learner.rules.forward_inverse import kernels
from pipeline.learner.rules.forward_inverse.config import RESIDUAL, ForwardInverseConfig
from pipeline.learner.rules.forward_inverse.features import Features, make_features
from pipeline.learner.rules.forward_inverse.kernels import Constants, IndexArray, Model
from pipeline.learner.state import check_state, state_digest
from recorders.errors import ConfigError, ControllerError, ReenactError
from recorders.text.wording import hand_label


class Explained(NamedTuple):
    """How a command came about.

    Attributes
    ----------
    estimate, joints : ndarray, shape (n, joints)
        Joints [rad or m] as the inverse estimate has them, and after the Newton step.
    hands : ndarray, shape (n, inputs)
        Where the forward models expect the hands at these joints [m].
    deviations : ndarray, shape (n, hands)
        Standard deviation of where each hand will be [m]; infinite before anything was learned.
    """

    estimate: Floats
    joints: Floats
    hands: Floats
    deviations: Floats


class ForwardInverseLearner:
    """Commands joints to hand targets: q0 = g(u), then q = q0 + J' (J J' + mu I)^-1 (u - F(q0)), J = dF/dq at q0.

    Inputs and joints are scaled: the ones by the reach about their centre, the others by half their range about the
    comfort posture, so that the shortest step is the one that is small beside the ranges. g are products of Legendre
    polynomials of the target, F of each hand are monomials of the joints that move it. Limits are kept.

    A command depends on its target and on what was learned, on no target before it: there is no washout. What is
    learned of a sample are its hands u and the joints in d; the first numbers of d, the next target, count for nothing.
    Outputs are the hands that are expected at the command, to first order about q0, then the joints.

    Parameters
    ----------
    config : ForwardInverseConfig
        Settings, and the robot's body.
    input_centre : array_like, shape (inputs,)
        Middle of the targets [m].
    output_centre : array_like, shape (outputs,)
        The same, then the comfort posture [rad or m].

    Raises
    ------
    ConfigError
        If a centre has the wrong shape, is not finite, or the comfort posture is beyond the limits.

    Examples
    --------
    >>> config = ForwardInverseConfig(inputs=3, outputs=5, degree=1)
    >>> learner = ForwardInverseLearner(config, input_centre=[0.0] * 3, output_centre=[0.0] * 5)
    >>> learner.step([[0.1] * 3], [[0.1, 0.1, 0.1, 0.2, 0.3]], learning=True).shape
    (1, 5)
    """

    def __init__(self, config: ForwardInverseConfig, *, input_centre: ArrayLike, output_centre: ArrayLike) -> None:
        self.config = config
        self.input_centre = centre_of("input_centre", input_centre, config.inputs)
        self.output_centre = centre_of("output_centre", output_centre, config.outputs)
        self._sizes, self._tables, self._memory = _lay_out(config)
        self._settings = np.array([getattr(config, name) for name in Constants._fields])
        self._common = kernels.common_views(self._sizes, self._memory)
        self._models = {
            model.name: kernels.model_views(self._sizes, self._tables, self._memory, place)
            for place, model in enumerate(config.models)
        }
        self._joints = config.outputs - config.inputs
        self._triangles = {
            name: np.flatnonzero(np.triu(np.ones(model.covariance.shape))) for name, model in self._models.items()
        }
        self._no_sample = np.empty((0, config.outputs))
        self._set_constants()
        priors = {"inverse": config.inverse_prior, RESIDUAL: config.residual_prior}
        for name, model in self._models.items():
            np.fill_diagonal(model.covariance, 1.0 / priors.get(name, config.prior))

    def begin_epoch(self, epoch: int) -> None:
        """Go on as before: nothing depends on the epoch.

        Raises
        ------
        ConfigError
            If the epoch is negative.
        """
        if epoch < 0:
            raise ConfigError(f"expected an epoch of at least 0, found {epoch}")

    def step(self, u: ArrayLike, d: ArrayLike, *, learning: bool) -> Floats:
        """Take steps, with or without learning, and return the outputs from before each update.

        Parameters
        ----------
        u : array_like, shape (n, inputs)
            Hands [m].
        d : array_like, shape (n, outputs)
            What belongs to them: inputs that count for nothing [m], then joints [rad or m].
        learning : bool
            Whether to learn.

        Returns
        -------
        ndarray, shape (n, outputs)

        Raises
        ------
        MessageError
            If u or d has the wrong shape, NaN or infinity; the state is then as it was.
        ConfigError
            If the state is no longer finite: the numbers are too large.
        """
        u, d = rows_of("u", u, self.config.inputs), rows_of("d", d, self.config.outputs)
        pairs_of(u, d)
        return self._run(u, d, bool(learning))

    def predict(self, u: ArrayLike) -> Floats:
        """Return the outputs (n, outputs) to targets u (n, inputs) [m]; the state stays as it is.

        Raises
        ------
        MessageError
            If u has the wrong shape, NaN or infinity.
        ConfigError
            If the outputs are not finite.
        """
        return self._run(rows_of("u", u, self.config.inputs), self._no_sample, False)

    def bind_look_ahead(self, u: Floats, *, limits: Floats, outputs: Floats, limited: Floats) -> Callable[[], int]:
        """Return `predict` of one u as one compiled call, as `pipeline.learner.look_ahead` has it."""
        arrays = self._sizes, self._tables, self._memory, self._settings
        run = partial(kernels.run, u[np.newaxis], self._no_sample, False, *arrays, outputs[np.newaxis])
        joints, (lower, upper) = outputs[-limited.size :], limits

        def look_ahead() -> int:
            status: int = run()
            np.minimum(np.maximum(joints, lower, out=limited), upper, out=limited)
            return status

        return look_ahead

    def advance(self) -> None:
        """Pass: a command changes nothing."""

    def check(self, status: int) -> None:
        """Raise MessageError or ConfigError for the status of a kernel, unless it is `kernels.OK`."""
        if status != kernels.OK:
            raise _failure(status)

    def deviations(self, u: ArrayLike) -> Floats:
        """Return the standard deviation [m] of where each hand will be after the command to a target.

        It follows from the errors of the forward model before each update, and from the leverage of the command among
        its samples, as `kernels.learn_errors` has it; it is infinite before anything was learned.

        Parameters
        ----------
        u : array_like, shape (n, inputs)
            Targets [m].

        Returns
        -------
        ndarray, shape (n, hands)

        Raises
        ------
        MessageError
            If u has the wrong shape, NaN or infinity.
        """
        return self._expect(self.predict(u)[:, self.config.inputs :])[1]

    def usual_deviations(self) -> Floats:
        """Return the deviation [m] of each hand, shape (hands,), at the mean leverage of what it has learned from."""
        models, deviations = self.config.forward_models, []
        units = np.split(self._common.reach, np.cumsum([model.outputs for model in models])[:-1])
        for size, unit in zip(models, units, strict=True):
            model = self._models[size.name]
            a, b = kernels.fit_errors(model, unit)
            deviations.append(math.sqrt(a + b * (1.0 + size.features / max(model.leverage[-1], 1.0))))
        return np.array(deviations)

    def explain(self, u: ArrayLike) -> Explained:
        """Return how the commands to targets u (n, inputs) [m] come about.

        Raises
        ------
        MessageError
            If u has the wrong shape, NaN or infinity.
        """
        rows, common, centre = (
            rows_of("u", u, self.config.inputs),
            self._common,
            self.output_centre[self.config.inputs :],
        )
        joints = self.predict(rows)[:, self.config.inputs :]
        estimate, residual = np.empty(joints.shape), np.empty(rows.shape)
        for row, target in enumerate(rows):
            self.predict(target[np.newaxis])
            estimate[row] = centre + common.half * common.estimate
            residual[row] = common.reach * (common.target - common.aim)
        hands, deviations = self._expect(joints)
        return Explained(estimate, joints, hands + residual, deviations)

    def linearise(self, joints: ArrayLike) -> tuple[Floats, Floats]:
        """Return the hands that are expected at a posture, and how they move with it.

        Parameters
        ----------
        joints : array_like, shape (joints,)
            The posture [rad or m].

        Returns
        -------
        (ndarray, ndarray)
            Hands [m], shape (inputs,), and their derivatives [m/rad or 1], shape (inputs, joints).
        """
        posture = finite_rows("joints", np.asarray(joints, dtype=np.float64)[np.newaxis], self._joints)[0]
        hands, jacobian = np.empty(self.config.inputs), np.empty((self.config.inputs, self._joints))
        kernels.linearise(posture, self._sizes, self._tables, self._memory, hands, jacobian)
        return hands, jacobian

    def model_errors(self) -> dict[str, Floats]:
        """Return the deviation of the models' outputs from what was measured, from before each update.

        By the model's name: joints [rad or m] of the inverse estimate, x, y and z [m] and turns [rad] of the forward
        models; infinite before anything was learned.
        """
        ends = np.cumsum([model.outputs for model in self.config.forward_models])
        scales = [self._common.half, *np.split(self._common.reach, ends[:-1])]
        return {
            name: _root_mean(model.errors) * scale
            for (name, model), scale in zip(self._models.items(), scales, strict=False)
        }

    def curves(self, u: ArrayLike) -> dict[str, Floats]:
        """Return how the commands to targets u (n, inputs) [m] come about, curve by curve, each of shape (n,).

        These are the size of the Newton step, the root mean square over the joints in parts of half their ranges, and
        for each hand the deviation and the distance from the target that are expected.
        """
        explained, hands = self.explain(u), self.config.known_body.hands
        steps = (explained.joints - explained.estimate) / self._common.half
        ends = np.cumsum([model.outputs for model in self.config.forward_models])
        left = np.split(explained.hands - np.asarray(u, dtype=np.float64), ends[:-1], axis=1)
        curves = {"Newton step [% of half the range]": 100.0 * np.sqrt((steps * steps).mean(axis=1))}
        for place, hand in enumerate(hands):
            label = hand_label(hand)
            curves[f"{label}: expected deviation [cm]"] = 100.0 * explained.deviations[:, place]
            curves[f"{label}: expected distance [cm]"] = 100.0 * np.linalg.norm(left[place][:, : len(AXES)], axis=1)
        return curves

    def lines(self) -> tuple[str, ...]:
        """Return a line on each model: its degree, its features, and its root mean square error before updates."""
        errors = self.model_errors()
        return tuple(
            f"{size.name.replace('_', ' ')}: degree {size.degree}, {size.features} features, "
            f"errs by {_root_mean_text(errors[size.name], forward=place > 0)}"
            for place, size in enumerate(self.config.models[: len(errors)])
        )

    def washout(self, u0: ArrayLike, *, steps: int) -> None:
        """Check u0 [m], shape (inputs,); there is nothing to forget.

        Raises
        ------
        MessageError
            If u0 has the wrong shape, NaN or infinity.
        """
        finite_rows("u0", np.asarray(u0, dtype=np.float64)[np.newaxis], self.config.inputs)

    def state(self) -> dict[str, Floats]:
        """Copy the state; names and shapes are those of `ForwardInverseConfig.state_shapes`."""
        state: dict[str, Floats] = {}
        for name, model in self._models.items():
            state[f"{name}_weights"] = model.weights.copy()
            state[f"{name}_covariance"] = model.covariance.reshape(-1)[self._triangles[name]]
            state[f"{name}_errors"] = model.errors.copy()
            state[f"{name}_leverage"] = model.leverage.copy()
        return state

    def load_state(self, state: Mapping[str, Floats]) -> None:
        """Go on from a state of a learner with the same configuration.

        Raises
        ------
        ControllerError
            If names, shapes or values are not those of such a state; the learner is then as it was.
        """
        check_state(self.config.state_shapes(), state)
        for name, model in self._models.items():
            _check_signs(name, model, state)
        for name, model in self._models.items():
            model.weights[:] = state[f"{name}_weights"]
            rows, columns = np.divmod(self._triangles[name], len(model.covariance))
            model.covariance[rows, columns] = state[f"{name}_covariance"]
            model.covariance[columns, rows] = state[f"{name}_covariance"]
            model.errors[:] = state[f"{name}_errors"]
            model.leverage[:] = state[f"{name}_leverage"]

    def connections_digest(self) -> str:
        """SHA-256 of nothing: no part of this learner is drawn."""
        return state_digest({})

    def _run(self, u: Floats, d: Floats, learning: bool) -> Floats:
        outputs = np.empty((len(u), self.config.outputs))
        arrays = self._sizes, self._tables, self._memory, self._settings
        self.check(kernels.run(u, d, learning, *arrays, outputs))
        return outputs

    def _expect(self, joints: Floats) -> tuple[Floats, Floats]:
        """Return the hands [m] that are expected at joints (n, joints), and their deviations [m]."""
        hands, deviations = (
            np.empty((len(joints), self.config.inputs)),
            np.empty((len(joints), len(self.config.forward_models))),
        )
        kernels.expect(np.ascontiguousarray(joints), self._sizes, self._tables, self._memory, hands, deviations)
        return hands, deviations

    def _set_constants(self) -> None:
        body, common, inputs = self.config.known_body, self._common, self.config.inputs
        common.centre[:], common.reach[:] = self.input_centre, body.reach
        common.lower[:], common.upper[:] = body.lower, body.upper
        common.comfort[:] = self.output_centre[inputs:]
        common.half[:] = (common.upper - common.lower) / 2.0
        if not (np.all(common.lower <= common.comfort) and np.all(common.comfort <= common.upper)):
            raise ConfigError(f"expected joints of output_centre within their limits, found {self.output_centre!r}")


def _lay_out(config: ForwardInverseConfig) -> tuple[IndexArray, IndexArray, Floats]:
    """Return sizes, tables and memory of a learner, as kernels take them."""
    joints = config.outputs - config.inputs
    hands = len(config.forward_models)
    sizes, tables = [config.inputs, joints, hands, len(config.models) - 1 - hands], list[IndexArray]()
    at, filled = kernels.common_size(config.inputs, joints), 0
    for model in config.models:
        features = make_features(len(model.variables), model.degree)
        parts = _tables_of(model.variables, features, forward=model.name not in ("inverse", RESIDUAL))
        lower = parts[3].size // len(model.variables)
        sizes += [len(model.variables), model.degree, model.features, lower, model.outputs, filled, at]
        at += kernels.model_size(len(model.variables), model.degree, model.features, model.outputs)
        filled += sum(part.size for part in parts)
        tables += parts
    return np.array(sizes, dtype=np.int64), np.concatenate(tables), np.zeros(at)


def _tables_of(variables: Iterable[int], features: Features, *, forward: bool) -> list[IndexArray]:
    raised = features.raised if forward else np.empty(0, dtype=np.int64)
    first = np.array(list(variables), dtype=np.int64)
    return [first, features.parents, features.places, raised.reshape(-1)]


def _check_signs(name: str, model: Model, state: Mapping[str, Floats]) -> None:
    """Check that what is a variance or a sum of squares is not below zero."""
    size = len(model.covariance)
    firsts = np.concatenate([[0], np.cumsum(np.arange(size, 1, -1))])
    sums = {array: state[f"{name}_{array}"] for array in ("errors", "leverage")}
    for array, values in {"covariance": state[f"{name}_covariance"][firsts], **sums}.items():
        if (values < 0.0).any():
            raise ControllerError(f"expected variances of at least 0 in state {name}_{array}, found {values.min():g}")


def _root_mean(errors: Floats) -> Floats:
    """Root of the weighted mean of squares, whose sums these are, with the sum of the weights at their end."""
    if errors[-1] == 0.0:
        return np.full(len(errors) - 1, np.inf)
    roots: Floats = np.sqrt(errors[:-1] / errors[-1])
    return roots


def _root_mean_text(errors: Floats, *, forward: bool) -> str:
    """Return the root mean square of errors as a text: of joints, or of positions and of turns, if there are any."""
    parts = [(errors, "rad")] if not forward else [(errors[: len(AXES)], "m"), (errors[len(AXES) :], "rad")]
    return " and ".join(f"{float(np.sqrt((part**2).mean())):.2g} {unit}" for part, unit in parts if part.size)


def _failure(status: int) -> ReenactError:
    if status == kernels.DIVERGED:
        return ConfigError("learning diverged: the state is no longer finite; the numbers are too large")
    return not_finite("u" if status == kernels.BAD_INPUT else "d")
