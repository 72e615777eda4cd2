"""The learner's arithmetic, compiled: every floating-point operation in a fixed order, none of it from libm.

Equation numbers are those of the paper (see `learner`, beside this). A sum runs over its slots one by one; what is
vectorised runs across neurons or weights. Without fastmath the compiler may neither reorder nor fuse, so that
every CPU gives the same bits. `error_model="numpy"` only drops the zero test from divisions, which would stop
vectorisation. What Python calls takes plain arrays, because a call with tuples costs more than a step.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats

IndexArray = NDArray[np.uint32]
SizeArray = NDArray[np.int64]
_Function = TypeVar("_Function", bound=Callable[..., Any])

_LOG2_E = 1.4426950408889634
_LN2_HIGH = 6.93147180369123816490e-01  # ln 2 rounded to 33 bits: its product with |k| < 2**11 is exact
_LN2_LOW = 1.90821492927058770002e-10  # the rest of ln 2
_ROUND = 1.5 * 2.0**52  # adding it leaves the nearest integer in the low bits of the sum
_EXP_MIN, _EXP_MAX = -708.0, 709.0  # beyond these exp leaves the normal float64 numbers
_LOG_STEPS = 400  # Halley moves by at most 2 a step: enough for every positive float64

OK, BAD_INPUT, BAD_TARGET, BAD_SHAPE, DIVERGED = 0, 1, 2, 3, 4


def _compiled(function: _Function) -> _Function:
    """Compile, and keep the result for the next process. It is found by this file alone: all kernels live here."""
    try:
        return cast(_Function, numba.njit(cache=True, error_model="numpy")(function))
    except RuntimeError:  # no folder can be written to that would keep the result: compile in every process
        return cast(_Function, numba.njit(error_model="numpy")(function))


class Sizes(NamedTuple):
    """Sizes of a network; a slot is the place of one connection at the neuron that it leads to."""

    inputs: int
    outputs: int
    reservoir: int
    reservoir_slots: int  # of each reservoir neuron
    output_slots: int  # of each output
    feedback_slot: int  # the slots of an output from here on come from outputs: the sum in eq. (7)
    sources: int  # length of z


class Views(NamedTuple):
    """Views into one block of memory: all that a step reads and changes, and its scratch space.

    All sources of neurons stand in one vector z = (u, y of the outputs, y of the reservoir, zeros); a slot without
    a connection has the last zero as its source.
    """

    reservoir_weights: Floats  # (reservoir, reservoir_slots), fixed
    output_weights: Floats  # (outputs, output_slots), adapted
    a: Floats  # (reservoir,)
    b: Floats  # (reservoir,)
    x: Floats  # (outputs + reservoir,), in the order of eq. (4)
    z: Floats  # (sources,)
    error: Floats  # (outputs,), e(k-1) of eq. (7)
    gathered: Floats  # (outputs, output_slots), scratch: sources of the outputs in this step
    gamma: Floats  # (outputs,), scratch
    slope_error: Floats  # (sources,), scratch: f'(x_s) e_s at the outputs s, zero elsewhere


class Rates(NamedTuple):
    """Learning rates of one epoch and the constants of the rules, in the order in which the kernel takes them."""

    eta: float
    epsilon: float
    zeta: float
    mu: float


def memory_size(sizes: Sizes) -> int:
    """Float64 numbers in the block that `views` divides."""
    weights = sizes.reservoir * sizes.reservoir_slots + 2 * sizes.outputs * sizes.output_slots
    return weights + 3 * sizes.reservoir + 3 * sizes.outputs + 2 * sizes.sources


@_compiled
def exp(x: float) -> float:
    """Exponential within 2 units in the last place for -708 <= x <= 709, held at the ends beyond.

    exp(x) = 2**k exp(r), |r| <= ln(2) / 2, with the Taylor polynomial of degree 13 for exp(r), whose remainder is
    4e-18; it is evaluated in Estrin's scheme, which waits less than Horner's.
    """
    x = _EXP_MIN if x < _EXP_MIN else x
    x = _EXP_MAX if x > _EXP_MAX else x
    shifted = x * _LOG2_E + _ROUND
    k = shifted - _ROUND
    r = (x - k * _LN2_HIGH) - k * _LN2_LOW
    r2 = r * r
    r4 = r2 * r2
    low = (1.0 / 2.0 + r * (1.0 / 6.0)) + r2 * (1.0 / 24.0 + r * (1.0 / 120.0))
    middle = (1.0 / 720.0 + r * (1.0 / 5040.0)) + r2 * (1.0 / 40320.0 + r * (1.0 / 362880.0))
    high = (1.0 / 3628800.0 + r * (1.0 / 39916800.0)) + r2 * (1.0 / 479001600.0 + r * (1.0 / 6227020800.0))
    power = 1.0 + (r + r2 * (low + r4 * (middle + r4 * high)))
    exponent = np.float64(shifted).view(np.int64) << 52
    return np.int64(np.float64(power).view(np.int64) + exponent).view(np.float64)


@_compiled
def log(x: float) -> float:
    """Natural logarithm of a positive number, by Halley's iteration on `exp`."""
    y = 0.0
    for _ in range(_LOG_STEPS):
        power = exp(y)
        y += 2.0 * (x - power) / (x + power)
    return y


@_compiled
def views(sizes: SizeArray, memory: Floats) -> Views:
    """Divide a block of memory; `sizes` holds the values of a `Sizes`."""
    _, outputs, reservoir, reservoir_slots, output_slots, _, sources = sizes
    gathered = outputs * output_slots
    weights_end = reservoir * reservoir_slots + gathered
    b_end = weights_end + 2 * reservoir
    z_end = b_end + outputs + reservoir + sources
    gathered_end = z_end + outputs + gathered
    return Views(
        memory[: weights_end - gathered].reshape(reservoir, reservoir_slots),
        memory[weights_end - gathered : weights_end].reshape(outputs, output_slots),
        memory[weights_end : weights_end + reservoir],
        memory[weights_end + reservoir : b_end],
        memory[b_end : z_end - sources],
        memory[z_end - sources : z_end],
        memory[z_end : z_end + outputs],
        memory[z_end + outputs : gathered_end].reshape(outputs, output_slots),
        memory[gathered_end : gathered_end + outputs],
        memory[gathered_end + outputs :],
    )


@_compiled
def sum_sources(weights: Floats, sources: IndexArray, z: Floats, x: Floats) -> None:
    """Activations of the reservoir, eq. (1)."""
    for i in range(x.size):
        total = 0.0
        for slot in range(weights.shape[1]):
            total += weights[i, slot] * z[sources[i, slot]]
        x[i] = total


@_compiled
def sum_and_gather(weights: Floats, sources: IndexArray, z: Floats, gathered: Floats, x: Floats) -> None:
    """Activations of the outputs, eq. (1), with the source of each slot gathered for the update."""
    for i in range(x.size):
        total = 0.0
        for slot in range(weights.shape[1]):
            value = z[sources[i, slot]]
            gathered[i, slot] = value
            total += weights[i, slot] * value
        x[i] = total


@_compiled
def sum_of_squares(z: Floats) -> float:
    """Squared norm of z, whose length is a multiple of four, as four interleaved sums."""
    s0 = s1 = s2 = s3 = 0.0
    for j in range(0, z.size, 4):
        s0 += z[j] * z[j]
        s1 += z[j + 1] * z[j + 1]
        s2 += z[j + 2] * z[j + 2]
        s3 += z[j + 3] * z[j + 3]
    return (s0 + s1) + (s2 + s3)


@_compiled
def fermi(x: Floats, a: Floats, b: Floats, y: Floats) -> None:
    """Activities of the reservoir, eq. (3)."""
    for i in range(x.size):
        y[i] = 1.0 / (1.0 + exp(-a[i] * x[i] - b[i]))


@_compiled
def fermi_outputs(x: Floats, y: Floats) -> None:
    """Activities of the outputs, which are only fed back: eq. (3) with a = 1, b = 0."""
    for i in range(x.size):
        y[i] = 1.0 / (1.0 + exp(-x[i]))


@_compiled
def add_feedback_error(sources: IndexArray, first_slot: int, first_output: int, views: Views) -> None:
    """Add to gamma the sum in eq. (7): the outputs' last errors, through the connections between outputs."""
    for s in range(first_output, first_output + views.gamma.size):
        y = views.z[s]
        views.slope_error[s] = y * (1.0 - y) * views.error[s - first_output]
    for i in range(views.gamma.size):
        for slot in range(first_slot, sources.shape[1]):
            views.gamma[i] += views.output_weights[i, slot] * views.slope_error[sources[i, slot]]


@_compiled
def decorrelate(weights: Floats, gathered: Floats, gamma: Floats, rate: float) -> None:
    """BPDC, eqs. (5) and (6): u and f(x) are both sources of slots; an empty slot has zero and stays zero."""
    for i in range(gamma.size):
        step = rate * gamma[i]
        for slot in range(weights.shape[1]):
            weights[i, slot] += step * gathered[i, slot]


@_compiled
def intrinsic_plasticity(x: Floats, y: Floats, a: Floats, b: Floats, zeta: float, mu: float) -> None:
    """IP, eqs. (8) and (9), the latter read as delta a = zeta / a + x delta b."""
    inverse = 1.0 / mu
    for i in range(x.size):
        delta_b = zeta * (1.0 - (2.0 + inverse) * y[i] + inverse * (y[i] * y[i]))
        a[i] += zeta / a[i] + x[i] * delta_b
        b[i] += delta_b


@_compiled
def all_finite(values: Floats) -> bool:
    """Return whether there is neither NaN nor infinity."""
    wrong = 0
    flat = values.reshape(-1)
    for i in range(flat.size):
        wrong |= 0 if flat[i] - flat[i] == 0.0 else 1
    return wrong == 0


@_compiled
def is_finite(views: Views) -> bool:
    """Return whether all that a step changes is free of NaN and infinity."""
    adapted = all_finite(views.output_weights) and all_finite(views.a) and all_finite(views.b)
    return adapted and all_finite(views.x)


@_compiled
def teach(d: Floats, first_output: int, feedback_slot: int, sources: IndexArray, rates: Rates, views: Views) -> None:
    """BPDC update of everything that leads to an output, eqs. (5) to (7); z still holds u(k) and y(k)."""
    for i in range(d.size):
        views.gamma[i] = -(views.x[i] - d[i])
    add_feedback_error(sources, feedback_slot, first_output, views)
    rate = rates.eta / (sum_of_squares(views.z) + rates.epsilon)
    decorrelate(views.output_weights, views.gathered, views.gamma, rate)


@_compiled
def activate(sizes: SizeArray, memory: Floats) -> None:
    """Activities of outputs and reservoir from their activations, eqs. (2) and (3)."""
    inputs, outputs, reservoir = sizes[0], sizes[1], sizes[2]
    state = views(sizes, memory)
    fermi_outputs(state.x[:outputs], state.z[inputs : inputs + outputs])
    fermi(state.x[outputs:], state.a, state.b, state.z[inputs + outputs : inputs + outputs + reservoir])


@_compiled
def run(
    u: Floats,
    d: Floats,
    learning: bool,
    sizes: SizeArray,
    sources: IndexArray,
    memory: Floats,
    rates: Floats,
    predicted: Floats,
) -> int:
    """Take complete steps: predict, compare with d, learn; a sequence may be cut into calls anywhere.

    Parameters
    ----------
    u : ndarray, shape (steps, inputs)
        Centred inputs.
    d : ndarray, shape (steps, outputs) or (0, outputs)
        Centred targets; none to run forward only, which leaves no error for the next step.
    learning : bool
        Whether to apply BPDC and IP; needs targets.
    sizes, rates : ndarray of int64 and of float64
        The values of a `Sizes` and of a `Rates`.
    sources : ndarray of uint32
        For each slot of each reservoir neuron, then of each output, the index of its source in z.
    memory : ndarray
        The block that `views` divides.
    predicted : ndarray, shape (steps, outputs)
        Filled with the outputs of each step, before its update.

    Returns
    -------
    int
        `OK`, `BAD_INPUT` or `BAD_TARGET` (not finite: nothing was done), or `DIVERGED` (the state is not finite).
    """
    if not (all_finite(u) and all_finite(d)):
        return BAD_TARGET if all_finite(u) else BAD_INPUT
    inputs, outputs, feedback_slot = sizes[0], sizes[1], sizes[5]
    state = views(sizes, memory)
    constants = Rates(rates[0], rates[1], rates[2], rates[3])
    split = state.reservoir_weights.size
    reservoir_sources = sources[:split].reshape(state.reservoir_weights.shape)
    output_sources = sources[split:].reshape(state.output_weights.shape)
    x_output, x_reservoir = state.x[:outputs], state.x[outputs:]
    y_output = state.z[inputs : inputs + outputs]
    y_reservoir = state.z[inputs + outputs : inputs + outputs + state.a.size]
    for k in range(u.shape[0]):
        state.z[:inputs] = u[k]
        sum_sources(state.reservoir_weights, reservoir_sources, state.z, x_reservoir)
        sum_and_gather(state.output_weights, output_sources, state.z, state.gathered, x_output)
        predicted[k] = x_output
        if learning:
            teach(d[k], inputs, feedback_slot, output_sources, constants, state)
        for i in range(outputs):
            state.error[i] = x_output[i] - d[k, i] if d.shape[0] else 0.0
        fermi_outputs(x_output, y_output)
        fermi(x_reservoir, state.a, state.b, y_reservoir)
        if learning:
            intrinsic_plasticity(x_reservoir, y_reservoir, state.a, state.b, constants.zeta, constants.mu)
    return OK if is_finite(state) else DIVERGED


@_compiled
def look_ahead(
    u: Floats,
    centre: Floats,
    limits: Floats,
    sizes: SizeArray,
    sources: IndexArray,
    memory: Floats,
    activations: Floats,
    predicted: Floats,
    limited: Floats,
) -> int:
    """Compute the next step's outputs, to the bit, without changing the state.

    The outputs need y(k) and u(k) alone, eq. (1): the reservoir's own step, most of the work, can follow when whoever
    waits for them has been answered, by `advance`. One call does it all: a call costs as much as the sums.

    Parameters
    ----------
    u : ndarray, shape (inputs,)
        The inputs, not centred.
    centre : ndarray, shape (inputs + outputs,)
        What is taken from u, then what is added to the outputs.
    limits : ndarray, shape (2, n)
        Lower, then upper limits of the last n outputs.
    sizes, sources, memory : ndarray
        As `run` takes them; only the place for u is written to, which every step overwrites.
    activations, predicted : ndarray, shape (outputs,)
        Filled with the outputs: centred, and not.
    limited : ndarray, shape (n,)
        Filled with the last n outputs, within their limits.

    Returns
    -------
    int
        `OK`, `BAD_SHAPE` or `BAD_INPUT` (not finite: nothing was done), or `DIVERGED` (the outputs are not finite).
    """
    inputs, outputs, first = sizes[0], sizes[1], sizes[1] - limited.size
    sized = u.size == inputs and activations.size == predicted.size == outputs
    if not sized or first < 0 or limits.shape != (2, limited.size):
        return BAD_SHAPE
    if not all_finite(u):
        return BAD_INPUT
    state = views(sizes, memory)
    for r in range(inputs):
        state.z[r] = u[r] - centre[r]
    output_sources = sources[state.reservoir_weights.size :].reshape(state.output_weights.shape)
    sum_sources(state.output_weights, output_sources, state.z, activations)
    for i in range(outputs):
        predicted[i] = activations[i] + centre[inputs + i]
    for j in range(limited.size):
        limited[j] = min(max(predicted[first + j], limits[0, j]), limits[1, j])
    return OK if all_finite(predicted) else DIVERGED


@_compiled
def advance(sizes: SizeArray, sources: IndexArray, memory: Floats, activations: Floats) -> int:
    """Take the step whose outputs `look_ahead` computed, to the bit as `run` takes one without targets.

    Nothing may have come between; this is not looked at.

    Parameters
    ----------
    sizes, sources, memory : ndarray
        As `look_ahead` left them.
    activations : ndarray, shape (outputs,)
        As `look_ahead` filled it.

    Returns
    -------
    int
        `OK`, or `DIVERGED` (x is not finite; weights, a and b have not changed).
    """
    outputs = sizes[1]
    state = views(sizes, memory)
    reservoir_sources = sources[: state.reservoir_weights.size].reshape(state.reservoir_weights.shape)
    sum_sources(state.reservoir_weights, reservoir_sources, state.z, state.x[outputs:])
    for i in range(outputs):
        state.x[i] = activations[i]
        state.error[i] = 0.0
    activate(sizes, memory)
    return OK if all_finite(state.x) else DIVERGED
