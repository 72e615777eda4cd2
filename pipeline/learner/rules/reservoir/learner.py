"""The online learner: a recurrent reservoir trained by Backpropagation-Decorrelation and Intrinsic Plasticity.

After M. Rolf, J. J. Steil and M. Gienger, "Efficient Exploration and Learning of Whole Body Kinematics"; equation
numbers here and in `pipeline.learner.rules.reservoir.kernels` are the paper's.
"""

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from pipeline.learner.rows import centre_of, not_finite, pairs_of, rows_of
from pipeline.learner.rules.reservoir import kernels
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.learner.rules.reservoir.kernels import Rates
from pipeline.learner.rules.reservoir.network import Connections, Network, symmetric_uniforms
from pipeline.learner.state import check_state, state_digest
from recorders.errors import ConfigError, ControllerError, MessageError, ReenactError


class Learner:
    """The paper's network with its rules; a new one stands at the beginning of epoch 0.

    Step k: x(k+1) = W y(k) + W_in u(k), eq. (1); the outputs are compared with d(k); BPDC, eqs. (5) to (7), changes the
    connections to the outputs with the u(k) and y(k) that made them; y(k+1) = f(x(k+1)), eqs. (2) and (3); IP,
    eqs. (8) and (9), changes a and b of the reservoir. Without a target there is no error for the next step.

    Parameters
    ----------
    config : LearnerConfig
        Sizes, rates and seed.
    input_centre : array_like, shape (inputs,)
        Constant taken from u [m], known before the first message.
    output_centre : array_like, shape (outputs,)
        Constant taken from d and added to the outputs [m, rad].

    Raises
    ------
    ConfigError
        If a centre has the wrong shape or is not finite.

    Examples
    --------
    >>> learner = Learner(LearnerConfig(reservoir=50, outputs=2), input_centre=[0.0] * 6, output_centre=[0.0] * 2)
    >>> learner.step([[0.1] * 6], [[0.2, 0.3]], learning=True).shape
    (1, 2)
    """

    def __init__(self, config: LearnerConfig, *, input_centre: ArrayLike, output_centre: ArrayLike) -> None:
        self.config = config
        self.input_centre = centre_of("input_centre", input_centre, config.inputs)
        self.output_centre = centre_of("output_centre", output_centre, config.outputs)
        self._network = Network(config)
        self._centre = np.concatenate([self.input_centre, self.output_centre])
        self._next_activations = np.empty(config.outputs)
        self._no_target = np.empty((0, config.outputs))
        self.begin_epoch(0)

    @property
    def epoch(self) -> int:
        """The epoch that `begin_epoch` began last."""
        return self._epoch

    @property
    def bpdc_rate(self) -> float:
        """BPDC rate eta of the epoch."""
        return float(self._rates[Rates._fields.index("eta")])

    @property
    def ip_rate(self) -> float:
        """IP rate zeta of the epoch."""
        return float(self._rates[Rates._fields.index("zeta")])

    def begin_epoch(self, epoch: int) -> None:
        """Draw x uniform in the initial range from (seed, epoch), set y = f(x) and the rates of the epoch.

        Raises
        ------
        ConfigError
            If the epoch is negative.
        """
        self._set_rates(epoch)
        self._seed_activations(epoch)

    def step(self, u: ArrayLike, d: ArrayLike, *, learning: bool) -> Floats:
        """Take steps, with or without learning, and return the outputs from before each update.

        Parameters
        ----------
        u : array_like, shape (n, inputs)
            Hand targets [m].
        d : array_like, shape (n, outputs)
            What the outputs should have been: next hand targets [m], then joints [rad].
        learning : bool
            Whether to apply BPDC and IP.

        Returns
        -------
        ndarray, shape (n, outputs)

        Raises
        ------
        MessageError
            If u or d has the wrong shape, NaN or infinity; the state is then as it was.
        ConfigError
            If the state is no longer finite: the rates are too high for these data.
        """
        u, d = rows_of("u", u, self.config.inputs), rows_of("d", d, self.config.outputs)
        pairs_of(u, d)
        return self._run(u, d - self.output_centre, bool(learning))

    def predict(self, u: ArrayLike) -> Floats:
        """Take steps without targets: u [m] of shape (n, inputs) to outputs [m, rad] of shape (n, outputs).

        Raises
        ------
        MessageError
            If u has the wrong shape, NaN or infinity; the state is then as it was.
        ConfigError
            If the state is no longer finite.
        """
        return self._run(rows_of("u", u, self.config.inputs), self._no_target, False)

    def look_ahead(self, u: Floats, *, limits: Floats, outputs: Floats, limited: Floats) -> None:
        """Write what `predict` would return of one u, to the bit, in a fraction of the time; the state stays as it is.

        Parameters
        ----------
        u : ndarray of float64, shape (inputs,)
            Hand targets [m].
        limits : ndarray of float64, shape (2, n)
            Lower, then upper limits of the last n outputs [m, rad].
        outputs : ndarray of float64, shape (outputs,)
            Filled with the outputs: next hand targets [m], then joints [rad].
        limited : ndarray of float64, shape (n,)
            Filled with the last n outputs, kept within their limits [m, rad].

        Raises
        ------
        MessageError
            If an array is of the wrong size, or u has NaN or infinity.
        ConfigError
            If the outputs are not finite.
        """
        self.check(self.bind_look_ahead(u, limits=limits, outputs=outputs, limited=limited)())

    def bind_look_ahead(self, u: Floats, *, limits: Floats, outputs: Floats, limited: Floats) -> Callable[[], int]:
        """Return `look_ahead` on these arrays as one compiled call, whose status `check` takes."""
        net = self._network
        network = net.sizes, net.sources, net.memory
        return partial(kernels.look_ahead, u, self._centre, limits, *network, self._next_activations, outputs, limited)

    def advance(self) -> None:
        """Take the step of the last look ahead, to the bit as `predict` does; nothing may have come between.

        Raises
        ------
        ConfigError
            If the state is no longer finite.
        """
        net = self._network
        self.check(kernels.advance(net.sizes, net.sources, net.memory, self._next_activations))

    def check(self, status: int) -> None:
        """Raise the error that a kernel's status stands for, of a step taken or looked ahead to; `kernels.OK` is none.

        Raises
        ------
        MessageError
            If an array was of the wrong size, or an input had NaN or infinity.
        ConfigError
            If state or outputs are not finite.
        """
        if status != kernels.OK:
            raise _failure(status, self._epoch)

    def washout(self, u0: ArrayLike, *, steps: int) -> None:
        """Hold the target u0 [m], shape (inputs,), for some steps, from a state seeded for this alone.

        Raises
        ------
        MessageError
            If u0 has the wrong shape, NaN or infinity; the state is then as it was.
        """
        held = rows_of("u0", np.asarray(u0, dtype=np.float64)[np.newaxis], self.config.inputs)
        if not np.isfinite(held).all():
            raise _failure(kernels.BAD_INPUT, self._epoch)
        self._seed_activations("washout")
        self.predict(np.repeat(held, steps, axis=0))

    def state(self) -> dict[str, Floats]:
        """Copy the state: weights by type of connection, a, b, x, y, e, epoch, in this order.

        Names and shapes are those of `LearnerConfig.state_shapes`.
        """
        return {**self._network.state(), "epoch": np.array([float(self._epoch)])}

    def load_state(self, state: Mapping[str, Floats]) -> None:
        """Go on from a state of a learner with the same configuration.

        Raises
        ------
        ControllerError
            If names, shapes or values are not those of such a state; the learner is then as it was.
        """
        check_state(self.config.state_shapes(), state)
        epoch = float(state["epoch"][0])
        if not (epoch.is_integer() and epoch >= 0.0):
            raise ControllerError(f"expected a whole epoch of at least 0 in the state, found {epoch}")
        self._set_rates(int(epoch))
        self._network.load_state(state)

    def connections(self, name: str) -> Connections:
        """Which connections of a type exist; the type is, for instance, ``"reservoir_output"``."""
        return self._network.connections[name]

    def connections_digest(self) -> str:
        """SHA-256 of which connections exist; together with the state it is the whole network."""
        return state_digest(
            {
                f"{name}_{end}": indices.astype(np.float64)
                for name, connections in self._network.connections.items()
                for end, indices in zip(connections._fields, connections, strict=True)
            }
        )

    def _run(self, u: Floats, d: Floats, learning: bool) -> Floats:
        net, outputs = self._network, np.empty((len(u), self.config.outputs))
        centred = u - self.input_centre
        self.check(kernels.run(centred, d, learning, net.sizes, net.sources, net.memory, self._rates, outputs))
        return outputs + self.output_centre

    def _set_rates(self, epoch: int) -> None:
        if epoch < 0:
            raise ConfigError(f"expected an epoch of at least 0, found {epoch}")
        config, self._epoch = self.config, epoch
        rates = Rates(
            eta=_rate(config.bpdc_rate_start, config.bpdc_rate_end, epoch, config.epochs),
            epsilon=config.bpdc_epsilon,
            zeta=_rate(config.ip_rate_start, config.ip_rate_end, epoch, config.epochs),
            mu=config.ip_mu,
        )
        self._rates = np.array(rates, dtype=np.float64)

    def _seed_activations(self, name: int | str) -> None:
        config = self.config
        neurons = config.outputs + config.reservoir
        self._network.set_activations(
            symmetric_uniforms(config.seed, "state", name, count=neurons, limit=config.initial_state_range)
        )


def _rate(start: float, end: float, epoch: int, epochs: int) -> float:
    """Rate of an epoch: exponential from start in epoch 0 to end in the last, and held from then on."""
    if start == end or epochs == 1:
        return float(start)
    progress = min(epoch, epochs - 1) / (epochs - 1)
    return start * kernels.exp(kernels.log(end / start) * progress)


def _failure(status: int, epoch: int) -> ReenactError:
    if status == kernels.DIVERGED:
        return ConfigError(f"learning diverged in epoch {epoch}: the state is no longer finite; lower the rates")
    if status == kernels.BAD_SHAPE:
        return MessageError("expected u, limits and outputs of the sizes of the network, found others")
    return not_finite("u" if status == kernels.BAD_INPUT else "d")
