"""The rule's arithmetic, compiled: every floating-point operation in a fixed order, none of it from libm or BLAS.

A sum runs over its terms one by one; what is vectorised runs across the elements of a row. Without fastmath the
compiler may neither reorder nor fuse, so that every CPU gives the same bits; a square root is exact by IEEE 754.

A model is linear in features of its scaled variables: `weights' f`. Its covariance P, in units of the noise's variance,
is kept whole rather than as a triangle, for rows of one length are what a CPU adds up fastest; it is symmetric to the
bit, since the update (k_i k_j) c does not depend on which of i and j comes first.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats

IndexArray = NDArray[np.int64]
_Function = TypeVar("_Function", bound=Callable[..., Any])

OK, BAD_INPUT, BAD_TARGET, DIVERGED = 0, 1, 2, 4
_HELD = 2.0
"""Where old samples are forgotten, one counts as held if it brings less than this many times what is forgotten."""


def _compiled(function: _Function) -> _Function:
    """Compile, and keep the result for the next process where a folder can be written to."""
    try:
        return cast(_Function, numba.njit(cache=True, error_model="numpy")(function))
    except RuntimeError:
        return cast(_Function, numba.njit(error_model="numpy")(function))


class Model(NamedTuple):
    """Views of one model into the tables and the memory of a learner; v variables, n features, m outputs.

    Feature 0 is 1; every other is an earlier one times a power of one variable. The first `lower` features are those
    below the highest degree.
    """

    degree: int
    variables: IndexArray  # (v,), which of the scaled inputs or joints
    parents: IndexArray  # (n,), the feature that is multiplied
    places: IndexArray  # (n,), by which of `powers`
    raised: IndexArray  # (v, lower), each lower feature times each variable; empty for the inverse estimate
    weights: Floats  # (n, m)
    covariance: Floats  # (n, n)
    errors: Floats  # (m + 1,), squared errors from before each update, weighted, and the sum of their weights
    leverage: Floats  # (2 m + 4,), sums of the line of squared errors over leverage, as `learn_errors` has them
    powers: Floats  # (v, degree + 1), scratch
    features: Floats  # (n,), scratch
    gain: Floats  # (n,), scratch: P f
    spare: Floats  # (n,), scratch: how much each feature forgets
    found: Floats  # (m,), scratch: outputs, then the steps that correct them


class Common(NamedTuple):
    """Views of constants and scratch that all models share; i inputs, j joints."""

    centre: Floats  # (i,), of the inputs [m]
    reach: Floats  # (i,), one unit of the scaled inputs [m]
    comfort: Floats  # (j,), centre of the joints [rad or m]
    half: Floats  # (j,), one unit of the scaled joints [rad or m]
    lower: Floats  # (j,), limits [rad or m]
    upper: Floats  # (j,)
    target: Floats  # (i,), scratch: scaled inputs
    aim: Floats  # (i,), scratch: the target, less what the residual expects there
    posture: Floats  # (j,), scratch: scaled joints
    estimate: Floats  # (j,), scratch: the posture before the Newton step
    hands: Floats  # (i,), scratch: scaled hands as the forward models have them
    jacobian: Floats  # (i, j), scratch
    square: Floats  # (i, i), scratch: J J' + mu I, then its Cholesky factor
    solution: Floats  # (i,), scratch


class Constants(NamedTuple):
    """The settings that kernels take: priors and forgetting of the models, and mu of the Newton step."""

    prior: float
    inverse_prior: float
    residual_prior: float
    forgetting: float
    residual_forgetting: float
    damping: float


def model_size(variables: int, degree: int, features: int, outputs: int) -> int:
    """Float64 numbers that one model takes of the memory."""
    return features * outputs + features * features + 4 * outputs + 5 + variables * (degree + 1) + 3 * features


def common_size(inputs: int, joints: int) -> int:
    """Float64 numbers that the constants and the scratch of all models take of the memory."""
    return 6 * inputs + 6 * joints + inputs * joints + inputs * inputs


@_compiled
def model_views(sizes: IndexArray, tables: IndexArray, memory: Floats, place: int) -> Model:
    """Return the views of a model: 0 is the inverse estimate; then the forward models, hand by hand; the residual.

    `sizes` has inputs, joints, hands and how many residuals there are, 0 or 1; then for each model seven numbers:
    variables, degree, features, lower, outputs, where its tables and its memory begin.
    """
    first = 4 + place * 7
    v, degree, n, lower, m, t, at = sizes[first : first + 7]
    raised = v * lower
    weights = at + n * m
    covariance = weights + n * n
    errors = covariance + m + 1
    leverage = errors + 2 * m + 4
    powers = leverage + v * (degree + 1)
    return Model(
        degree,
        tables[t : t + v],
        tables[t + v : t + v + n],
        tables[t + v + n : t + v + 2 * n],
        tables[t + v + 2 * n : t + v + 2 * n + raised].reshape(v, lower),
        memory[at:weights].reshape(n, m),
        memory[weights:covariance].reshape(n, n),
        memory[covariance:errors],
        memory[errors:leverage],
        memory[leverage:powers].reshape(v, degree + 1),
        memory[powers : powers + n],
        memory[powers + n : powers + 2 * n],
        memory[powers + 2 * n : powers + 3 * n],
        memory[powers + 3 * n : powers + 3 * n + m],
    )


@_compiled
def common_views(sizes: IndexArray, memory: Floats) -> Common:
    """Return the views that all models share, at the beginning of the memory."""
    i, j = sizes[0], sizes[1]
    joints = 2 * i
    target = joints + 4 * j
    aim = target + i
    hands = aim + i + 2 * j
    jacobian = hands + i
    square = jacobian + i * j
    solution = square + i * i
    return Common(
        memory[:i],
        memory[i:joints],
        memory[joints : joints + j],
        memory[joints + j : joints + 2 * j],
        memory[joints + 2 * j : joints + 3 * j],
        memory[joints + 3 * j : target],
        memory[target:aim],
        memory[aim : aim + i],
        memory[aim + i : aim + i + j],
        memory[aim + i + j : hands],
        memory[hands:jacobian],
        memory[jacobian:square].reshape(i, j),
        memory[square:solution].reshape(i, i),
        memory[solution : solution + i],
    )


@_compiled
def all_finite(values: Floats) -> bool:
    """Return whether there is neither NaN nor infinity."""
    wrong = 0
    flat = values.reshape(-1)
    for i in range(flat.size):
        wrong |= 0 if flat[i] - flat[i] == 0.0 else 1
    return wrong == 0


@_compiled
def fill_targets_features(part: Model, scaled: Floats) -> None:
    """Fill the features of a scaled target: products of P_k(x) / k!, P_k the Legendre polynomials.

    Bonnet's recursion (k + 1) P_{k+1}(x) = (2 k + 1) x P_k(x) - k P_{k-1}(x), divided by (k + 1) (k + 1)!.
    """
    powers = part.powers
    for v in range(part.variables.size):
        x = scaled[part.variables[v]]
        powers[v, 0], powers[v, 1] = 1.0, x
        for k in range(1, part.degree):
            powers[v, k + 1] = ((2.0 * k + 1.0) * (x * powers[v, k]) - powers[v, k - 1]) / ((k + 1.0) * (k + 1.0))
    fill_products(part)


@_compiled
def fill_joints_features(part: Model, scaled: Floats, half: Floats) -> None:
    """Fill the features of scaled joints: products of x^k / k!, x the joint's distance from its centre [rad or m].

    A hand's position is a sum of products of sines and cosines of the joints: as functions of these features, its
    weights are all of one size, that of its derivatives, and one prior is right for them.
    """
    powers = part.powers
    for v in range(part.variables.size):
        x = scaled[part.variables[v]] * half[part.variables[v]]
        powers[v, 0] = 1.0
        for k in range(part.degree):
            powers[v, k + 1] = x * powers[v, k] / (k + 1.0)
    fill_products(part)


@_compiled
def fill_products(part: Model) -> None:
    """Fill the features, products of the polynomials of each variable."""
    features, flat = part.features, part.powers.reshape(-1)
    features[0] = 1.0
    for f in range(1, features.size):
        features[f] = features[part.parents[f]] * flat[part.places[f]]


@_compiled
def fill_outputs(part: Model, outputs: Floats) -> None:
    """Fill the outputs of a model whose features are filled, all of them feature by feature."""
    for m in range(outputs.size):
        outputs[m] = 0.0
    for f in range(part.features.size):
        value = part.features[f]
        for m in range(outputs.size):
            outputs[m] += part.weights[f, m] * value


@_compiled
def fill_hand(part: Model, hand: Floats) -> None:
    """Fill the outputs of a forward model as `fill_outputs` does, to the bit; three at a time stay in registers."""
    features, weights = part.features, part.weights
    for m in range(0, hand.size, 3):
        x = y = z = 0.0
        for f in range(features.size):
            value = features[f]
            x += weights[f, m] * value
            y += weights[f, m + 1] * value
            z += weights[f, m + 2] * value
        hand[m], hand[m + 1], hand[m + 2] = x, y, z


@_compiled
def fill_jacobian(part: Model, half: Floats, jacobian: Floats) -> None:
    """Fill the rows of a hand in J = dF/dq, in scaled units, where the features are filled."""
    features, weights, raised = part.features, part.weights, part.raised
    for row in range(jacobian.shape[0]):
        for column in range(jacobian.shape[1]):
            jacobian[row, column] = 0.0
    for v in range(part.variables.size):
        column = part.variables[v]
        unit = half[column]
        for row in range(0, jacobian.shape[0], 3):
            x = y = z = 0.0
            for f in range(raised.shape[1]):
                x += weights[raised[v, f], row] * features[f]
                y += weights[raised[v, f], row + 1] * features[f]
                z += weights[raised[v, f], row + 2] * features[f]
            jacobian[row, column], jacobian[row + 1, column], jacobian[row + 2, column] = x * unit, y * unit, z * unit


@_compiled
def fill_gain(part: Model) -> float:
    """Fill the gain with P f, four rows at a time, and return f' P f, the variance that the weights bring."""
    covariance, features, gain = part.covariance, part.features, part.gain
    n = features.size
    whole = n - n % 4
    for j in range(n):
        gain[j] = 0.0
    for i in range(0, whole, 4):
        a, b, c, d = features[i], features[i + 1], features[i + 2], features[i + 3]
        for j in range(n):
            low = (gain[j] + covariance[i, j] * a) + covariance[i + 1, j] * b
            gain[j] = (low + covariance[i + 2, j] * c) + covariance[i + 3, j] * d
    for i in range(whole, n):
        for j in range(n):
            gain[j] += covariance[i, j] * features[i]
    variance = 0.0
    for i in range(n):
        variance += gain[i] * features[i]
    return variance


@_compiled
def shrink(part: Model, factor: float) -> None:
    """P -= (P f) (P f)' factor, symmetric to the bit."""
    covariance, gain = part.covariance, part.gain
    for i in range(gain.size):
        value = gain[i]
        for j in range(gain.size):
            covariance[i, j] -= (value * gain[j]) * factor


@_compiled
def forget(part: Model, prior: float, forgetting: float) -> None:
    """Let P grow by 1 / forgetting, each feature no further than to its prior: what is not seen winds nothing up."""
    covariance, spare = part.covariance, part.spare
    most, limit = np.sqrt(1.0 / forgetting), 1.0 / prior
    for i in range(spare.size):
        spare[i] = most
        if covariance[i, i] * (most * most) > limit:
            spare[i] = np.sqrt(limit / covariance[i, i])
    for i in range(spare.size):
        value = spare[i]
        for j in range(spare.size):
            covariance[i, j] *= value * spare[j]


@_compiled
def learn_errors(part: Model, variance: float, forgetting: float) -> None:
    """Learn how far the model errs from the errors of one sample, which `found` holds, from before its update.

    Squared errors are a line a + b x of the leverage x = f' P f (1 + N / n), n features after N samples: f' P f (b)
    for weights that are uncertain, and for what no weights explain, which grows from the middle of the samples to
    their edge as leverage does; on average over them, N f' P f is n. Of the line these are the sums of w e^2 of every
    output, of w x e^2, of w, w x and w x^2, and N.

    Parameters
    ----------
    part : Model
        The model.
    variance : float
        f' P f.
    forgetting : float
        Weight of the past.

    Notes
    -----
    w falls with the square of 1 + x, as a line's weighted least squares want; and by the cube of 1 + f' P f, since a
    model that knew little then says little about what it errs by now.
    """
    errors, sums, last = part.errors, part.leverage, part.found.size
    share = 1.0 / (1.0 + variance)
    weight = share * (share * share)
    x = variance * (1.0 + sums[2 * last + 3] / part.features.size)
    w = weight / ((1.0 + x) * (1.0 + x))
    for m in range(last):
        square = part.found[m] * part.found[m]
        errors[m] = errors[m] * forgetting + square * (share * weight)
        sums[m] = sums[m] * forgetting + square * w
        sums[last + m] = sums[last + m] * forgetting + square * (w * x)
    errors[last] = errors[last] * forgetting + weight
    sums[2 * last] = sums[2 * last] * forgetting + w
    sums[2 * last + 1] = sums[2 * last + 1] * forgetting + w * x
    sums[2 * last + 2] = sums[2 * last + 2] * forgetting + w * (x * x)
    sums[2 * last + 3] = sums[2 * last + 3] * forgetting + 1.0


@_compiled
def fit_errors(part: Model, units: Floats) -> tuple[float, float]:
    """Return a and b, not below 0, of the line of squared errors over leverage, as `learn_errors` has it.

    Parameters
    ----------
    part : Model
        The model.
    units : ndarray, shape (m,)
        Unit of each output [m], of which x, y and z count.

    Returns
    -------
    (float, float)
        Of the sum over x, y and z [m^2]; a is infinite before anything was learned.
    """
    sums, last = part.leverage, units.size
    if not sums[2 * last + 3] > 0.0:
        return np.inf, 0.0
    constant = slope = 0.0
    for m in range(3):
        constant += sums[m] * (units[m] * units[m])
        slope += sums[last + m] * (units[m] * units[m])
    w, x, square = sums[2 * last], sums[2 * last + 1], sums[2 * last + 2]
    spread = w * square - x * x
    if spread > 1e-9 * (w * square):
        a, b = (square * constant - x * slope) / spread, (w * slope - x * constant) / spread
        if a >= 0.0 and b >= 0.0:
            return a, b
        if a < 0.0:
            return 0.0, slope / square
    return constant / w, 0.0


@_compiled
def learn(part: Model, desired: Floats, prior: float, forgetting: float) -> None:
    """Recursive least squares on one sample whose features are filled.

    Where forgetting is below 1, a sample that brings nothing new is passed over.

    Parameters
    ----------
    part : Model
        The model.
    desired : ndarray, shape (m,)
        What its outputs should have been, scaled.
    prior, forgetting : float
        Settings of the model.

    Notes
    -----
    L. Ljung and T. Söderström, "Theory and Practice of Recursive Identification", MIT Press 1983, section 2.2. A target
    that is held brings f' P f towards 1 - forgetting, one that varies to as many times this as there are features.
    """
    weights, last = part.weights, desired.size
    variance = fill_gain(part)
    if not variance > 0.0 or variance < _HELD * (1.0 - forgetting):
        return
    fill_outputs(part, part.found)
    for m in range(last):
        part.found[m] = desired[m] - part.found[m]
    learn_errors(part, variance, forgetting)
    for m in range(last):
        part.found[m] = part.found[m] / (forgetting + variance)
    for f in range(part.gain.size):
        gain = part.gain[f]
        for m in range(last):
            weights[f, m] += gain * part.found[m]
    shrink(part, 1.0 / (forgetting + variance))
    if forgetting < 1.0:
        forget(part, prior, forgetting)


@_compiled
def factorise(square: Floats) -> bool:
    """Replace a symmetric matrix by its Cholesky factor, below the diagonal; False if it is not positive definite."""
    for j in range(square.shape[0]):
        for i in range(j, square.shape[0]):
            total = square[i, j]
            for k in range(j):
                total -= square[i, k] * square[j, k]
            if i > j:
                square[i, j] = total / square[j, j]
            elif total > 0.0:
                square[j, j] = np.sqrt(total)
            else:
                return False
    return True


@_compiled
def solve(factor: Floats, values: Floats) -> None:
    """Replace `values` by the solution of L L' x = values."""
    n = values.size
    for i in range(n):
        for k in range(i):
            values[i] -= factor[i, k] * values[k]
        values[i] /= factor[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            values[i] -= factor[k, i] * values[k]
        values[i] /= factor[i, i]


@_compiled
def keep_within(common: Common, posture: Floats) -> None:
    """Keep a scaled posture within the limits of the joints."""
    for j in range(posture.size):
        value = common.comfort[j] + common.half[j] * posture[j]
        limit = min(max(value, common.lower[j]), common.upper[j])
        if limit != value:
            posture[j] = (limit - common.comfort[j]) / common.half[j]


@_compiled
def move_towards_target(common: Common, damping: float) -> None:
    """One Newton step on the forward models, posture = estimate + J' (J J' + mu I)^-1 (aim - hands); all scaled.

    mu is `damping` times the mean of the diagonal of J J'. Where J says nothing, the estimate stays.
    """
    jacobian, square, solution = common.jacobian, common.square, common.solution
    inputs, joints = jacobian.shape
    trace = 0.0
    for a in range(inputs):
        for b in range(a + 1):
            total = 0.0
            for j in range(joints):
                total += jacobian[a, j] * jacobian[b, j]
            square[a, b] = total
        trace += square[a, a]
        solution[a] = common.aim[a] - common.hands[a]
    for a in range(inputs):
        square[a, a] += damping * (trace / inputs)
    for j in range(joints):
        common.posture[j] = common.estimate[j]
    if not factorise(square):
        return
    solve(square, solution)
    for j in range(joints):
        for a in range(inputs):
            common.posture[j] += jacobian[a, j] * solution[a]
    keep_within(common, common.posture)
    for a in range(inputs):
        for j in range(joints):
            common.hands[a] += jacobian[a, j] * (common.posture[j] - common.estimate[j])


@_compiled
def take_aim(common: Common, sizes: IndexArray, tables: IndexArray, memory: Floats) -> None:
    """Fill the aim, the target less what the residual expects the hands to be off there, if there is a residual."""
    for i in range(common.aim.size):
        common.aim[i] = common.target[i]
    if sizes[3] > 0:
        residual = model_views(sizes, tables, memory, 1 + sizes[2])
        fill_targets_features(residual, common.target)
        fill_outputs(residual, residual.found)
        for i in range(common.aim.size):
            common.aim[i] -= residual.found[i]


@_compiled
def expect_hands(common: Common, posture: Floats, sizes: IndexArray, tables: IndexArray, memory: Floats) -> None:
    """Fill the hands where the forward models expect them at a posture; all scaled."""
    first = 0
    for hand in range(sizes[2]):
        forward = model_views(sizes, tables, memory, 1 + hand)
        last = first + forward.weights.shape[1]
        fill_joints_features(forward, posture, common.half)
        fill_hand(forward, common.hands[first:last])
        first = last


@_compiled
def command_posture(u: Floats, sizes: IndexArray, tables: IndexArray, memory: Floats, damping: float) -> None:
    """Fill estimate and posture for one target [m], and the hands that are expected there, to first order."""
    common = common_views(sizes, memory)
    for i in range(u.size):
        common.target[i] = (u[i] - common.centre[i]) / common.reach[i]
    take_aim(common, sizes, tables, memory)
    inverse = model_views(sizes, tables, memory, 0)
    fill_targets_features(inverse, common.aim)
    fill_outputs(inverse, common.estimate)
    keep_within(common, common.estimate)
    expect_hands(common, common.estimate, sizes, tables, memory)
    first = 0
    for hand in range(sizes[2]):
        forward = model_views(sizes, tables, memory, 1 + hand)
        last = first + forward.weights.shape[1]
        fill_jacobian(forward, common.half, common.jacobian[first:last])
        first = last
    move_towards_target(common, damping)


@_compiled
def write_outputs(common: Common, outputs: Floats) -> None:
    """Write the hands that are expected [m], then joints [rad or m] within their limits."""
    inputs = common.hands.size
    for i in range(inputs):
        outputs[i] = common.centre[i] + common.reach[i] * (common.hands[i] + (common.target[i] - common.aim[i]))
    for j in range(common.posture.size):
        value = common.comfort[j] + common.half[j] * common.posture[j]
        outputs[inputs + j] = min(max(value, common.lower[j]), common.upper[j])


@_compiled
def learn_sample(d: Floats, sizes: IndexArray, tables: IndexArray, memory: Floats, constants: Constants) -> None:
    """Learn from the target that `command_posture` had, and from the joints in d, all of them measured.

    The residual first: the other models learn from the hands less what it explains by then, the aim.
    """
    common = common_views(sizes, memory)
    for j in range(common.posture.size):
        common.posture[j] = (d[common.hands.size + j] - common.comfort[j]) / common.half[j]
    if sizes[3] > 0:
        expect_hands(common, common.posture, sizes, tables, memory)
        for i in range(common.hands.size):
            common.hands[i] = common.target[i] - common.hands[i]
        residual = model_views(sizes, tables, memory, 1 + sizes[2])
        learn(residual, common.hands, constants.residual_prior, constants.residual_forgetting)
        take_aim(common, sizes, tables, memory)
    inverse = model_views(sizes, tables, memory, 0)
    fill_targets_features(inverse, common.aim)
    learn(inverse, common.posture, constants.inverse_prior, constants.forgetting)
    first = 0
    for hand in range(sizes[2]):
        forward = model_views(sizes, tables, memory, 1 + hand)
        last = first + forward.weights.shape[1]
        fill_joints_features(forward, common.posture, common.half)
        learn(forward, common.aim[first:last], constants.prior, constants.forgetting)
        first = last


@_compiled
def is_finite(sizes: IndexArray, tables: IndexArray, memory: Floats) -> bool:
    """Return whether weights and variances are free of NaN and infinity; no covariance is larger than two variances."""
    finite = True
    for place in range(1 + sizes[2] + sizes[3]):
        part = model_views(sizes, tables, memory, place)
        finite = finite and all_finite(part.weights) and all_finite(part.errors)
        finite = finite and all_finite(part.leverage)
        for i in range(part.gain.size):
            finite = finite and part.covariance[i, i] - part.covariance[i, i] == 0.0
    return finite


@_compiled
def run(
    u: Floats,
    d: Floats,
    learning: bool,
    sizes: IndexArray,
    tables: IndexArray,
    memory: Floats,
    settings: Floats,
    predicted: Floats,
) -> int:
    """Take complete steps: command, then learn; a sequence may be cut into calls anywhere.

    Parameters
    ----------
    u : ndarray, shape (steps, inputs)
        Hand targets, or hands as reached [m].
    d : ndarray, shape (steps, inputs + joints) or (0, inputs + joints)
        What was measured with them; the joints count [rad or m].
    learning : bool
        Whether to learn; needs d.
    sizes, tables : ndarray of int64
        Sizes and indices, as `model_views` reads them.
    memory : ndarray
        Constants, models and scratch.
    settings : ndarray, shape (6,)
        The values of `Constants`.
    predicted : ndarray, shape (steps, inputs + joints)
        Filled with the outputs of each step, before its update.

    Returns
    -------
    int
        `OK`, `BAD_INPUT` or `BAD_TARGET` (not finite: nothing was done), or `DIVERGED` (the state is not finite).
    """
    if not all_finite(u):
        return BAD_INPUT
    if not all_finite(d):
        return BAD_TARGET
    constants = Constants(settings[0], settings[1], settings[2], settings[3], settings[4], settings[5])
    common = common_views(sizes, memory)
    for k in range(u.shape[0]):
        command_posture(u[k], sizes, tables, memory, constants.damping)
        write_outputs(common, predicted[k])
        if learning:
            learn_sample(d[k], sizes, tables, memory, constants)
    if learning and not is_finite(sizes, tables, memory):
        return DIVERGED
    return OK if all_finite(predicted) else DIVERGED


@_compiled
def expect(
    joints: Floats,
    sizes: IndexArray,
    tables: IndexArray,
    memory: Floats,
    hands: Floats,
    deviations: Floats,
) -> None:
    """Fill where the forward models expect the hands, and how far from there they may be.

    A deviation is the root of the squared error that goes with the leverage there, as `learn_errors` has it. It is
    infinite before anything was learned.

    Parameters
    ----------
    joints : ndarray, shape (n, joints)
        Joints [rad or m].
    sizes, tables, memory : ndarray
        As `run` takes them; only scratch is written to.
    hands : ndarray, shape (n, inputs)
        Filled with the hands [m].
    deviations : ndarray, shape (n, hands)
        Filled with the standard deviation of each hand's distance [m].
    """
    common = common_views(sizes, memory)
    first = last = 0
    for hand in range(sizes[2]):
        forward = model_views(sizes, tables, memory, 1 + hand)
        size = forward.weights.shape[1]
        first, last = last, last + size
        samples = forward.leverage[2 * size + 3]
        a, b = fit_errors(forward, common.reach[first:last])
        for k in range(joints.shape[0]):
            for j in range(joints.shape[1]):
                common.posture[j] = (joints[k, j] - common.comfort[j]) / common.half[j]
            fill_joints_features(forward, common.posture, common.half)
            fill_hand(forward, common.hands[first:last])
            for m in range(first, last):
                hands[k, m] = common.centre[m] + common.reach[m] * common.hands[m]
            x = max(fill_gain(forward), 0.0) * (1.0 + samples / forward.features.size)
            deviations[k, hand] = np.sqrt(a + b * x)


@_compiled
def linearise(
    joints: Floats, sizes: IndexArray, tables: IndexArray, memory: Floats, hands: Floats, jacobian: Floats
) -> None:
    """Fill where the forward models expect the hands at a posture, and how they move with it.

    Parameters
    ----------
    joints : ndarray, shape (joints,)
        Joints [rad or m].
    sizes, tables, memory : ndarray
        As `run` takes them; only scratch is written to.
    hands : ndarray, shape (inputs,)
        Filled with the hands [m].
    jacobian : ndarray, shape (inputs, joints)
        Filled with their derivatives [m/rad or 1].
    """
    common = common_views(sizes, memory)
    for j in range(joints.size):
        common.posture[j] = (joints[j] - common.comfort[j]) / common.half[j]
    expect_hands(common, common.posture, sizes, tables, memory)
    first = last = 0
    for hand in range(sizes[2]):
        forward = model_views(sizes, tables, memory, 1 + hand)
        first, last = last, last + forward.weights.shape[1]
        fill_jacobian(forward, common.half, common.jacobian[first:last])
    for i in range(hands.size):
        hands[i] = common.centre[i] + common.reach[i] * common.hands[i]
        for j in range(joints.size):
            jacobian[i, j] = common.jacobian[i, j] * common.reach[i] / common.half[j]
