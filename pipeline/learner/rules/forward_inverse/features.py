"""Features of a model: products of polynomials of its variables up to a total degree, how one follows from others."""

import math
from collections.abc import Sequence
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

MAX_FEATURES = 500
"""A model with more falls to a lower degree; a step takes time by their square."""

_Indices = NDArray[np.int64]


class Features(NamedTuple):
    """Tables of the features of v variables, by rising total degree; a kernel reads them.

    Attributes
    ----------
    products : tuple of tuple of int
        For each feature its variables, each as often as its power says.
    parents, places : ndarray, shape (n,)
        The earlier feature that each is a multiple of, and of which power: variable * (degree + 1) + power.
    raised : ndarray, shape (v, lower)
        The feature that each of lower degree makes with each variable.
    """

    products: tuple[tuple[int, ...], ...]
    parents: _Indices
    places: _Indices
    raised: _Indices


def count_features(variables: int, degree: int) -> int:
    """Return how many features there are."""
    return math.comb(variables + degree, degree)


def largest_degree(variables: int, wanted: int) -> int:
    """Return the highest degree up to the wanted one with at most `MAX_FEATURES` features; 1 at the least."""
    degree = wanted
    while degree > 1 and count_features(variables, degree) > MAX_FEATURES:
        degree -= 1
    return degree


def make_features(variables: int, degree: int) -> Features:
    """Make the tables of all features of so many variables up to a total degree of at least 1."""
    products = [
        product for total in range(degree + 1) for product in combinations_with_replacement(range(variables), total)
    ]
    index = {product: place for place, product in enumerate(products)}
    parents, places = [0], [0]
    for product in products[1:]:
        last = product[-1]
        power = product.count(last)
        parents.append(index[product[:-power]])
        places.append(last * (degree + 1) + power)
    lower = [product for product in products if len(product) < degree]
    raised = [[index[tuple(sorted((*product, v)))] for product in lower] for v in range(variables)]
    return Features(
        tuple(products),
        np.array(parents, dtype=np.int64),
        np.array(places, dtype=np.int64),
        np.array(raised, dtype=np.int64).reshape(variables, len(lower)),
    )


def product_name(product: Sequence[int], names: Sequence[str]) -> str:
    """Return a feature as text, such as `r_elbow^2*r_wrist`; 1 for the constant."""
    parts = []
    for variable in dict.fromkeys(product):
        power = list(product).count(variable)
        parts.append(names[variable] if power == 1 else f"{names[variable]}^{power}")
    return "*".join(parts) or "1"
