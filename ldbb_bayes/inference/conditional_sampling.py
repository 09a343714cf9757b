"""Exact random draws of the parameters β given the hyper-parameters φ and the readings y.

β are the p parameters: compliances, their changes with force, and geometric errors. φ are the h
hyper-parameters, such as the standard deviation of the noise. If the model forbids negative
compliances, the draws are restricted to β without negative compliances; this restriction is called
truncation. The functions take φ in unbounded coordinates, which are called free and are mostly
ln(φ − lower bound).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.integrals import CHUNK
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = ["conditional_draws", "draw_parameters_given", "no_physical_draw"]

# Largest number of times that a random draw of the parameters is repeated. A draw is repeated if
# the rejection sampler gave up, or if rounding made a compliance negative.
_REPEATS = 20


def conditional_draws(
    bound: BoundModel,
    free: Array,
    rng: np.random.Generator,
    *,
    truncated: bool | None = None,
) -> tuple[Array, NDArray[np.bool_]]:
    """Return one random draw of the p parameters for each of w values of the hyper-parameters.

    The parameters are compliances, their changes with force, and geometric errors. They are drawn
    from their density given the readings and the hyper-parameters, such as the standard deviation
    of the noise. A second array, ``exact``, is False for a draw that does not come from this
    density.

    Parameters
    ----------
    bound : BoundModel
        Model of the campaign.
    free : ndarray, shape (w, h)
        The w values of the h hyper-parameters in unbounded coordinates, mostly ln(value − lower
        bound).
    rng : Generator
        Generator of random numbers.
    truncated : bool, optional
        Whether the density is restricted to compliances that are not negative. Default: True if the
        model forbids negative compliances.

    Returns
    -------
    beta : ndarray, shape (w, p)
        Random draws of the parameters.
    exact : ndarray of bool, shape (w,)
        True for a draw from the exact density. False if the rejection sampler gave up for this
        draw, or if rounding made a compliance of this draw negative.
    """
    if truncated is None:
        truncated = bound.truncation.active
    beta = np.zeros((len(free), len(bound.names)))
    exact = np.ones(len(free), dtype=bool)
    nodes, node_of_row = np.unique(free, axis=0, return_inverse=True)
    node_of_row = node_of_row.ravel()
    # Rows of ``free`` (values of the hyper-parameters) may be equal. If at most half of the rows
    # are distinct, the density of the parameters is computed only once for each distinct row.
    conditional_of_nodes = None
    if 2 * len(nodes) <= len(free):
        conditional_of_nodes = bound.given(bound.hyper_prior.phi(nodes)).parameters
    for start in range(0, len(free), CHUNK):
        rows = slice(start, start + CHUNK)
        if conditional_of_nodes is not None:
            conditional = conditional_of_nodes.select(node_of_row[rows])
        else:
            conditional = bound.given(bound.hyper_prior.phi(free[rows])).parameters
        if truncated:
            beta[rows], exact[rows] = conditional.draw_truncated(rng)
        else:
            beta[rows] = conditional.draw(rng)
    return beta, exact


def draw_parameters_given(
    bound: BoundModel,
    free: Array,
    rng: np.random.Generator,
    *,
    truncated: bool | None = None,
) -> Array:
    """Return one random draw of the p parameters per value of the hyper-parameters, shape (w, p).

    The parameters are compliances, their changes with force, and geometric errors. ``free`` holds w
    values of the hyper-parameters (such as the standard deviation of the noise). For each value,
    the parameters are drawn conditional on this value and on the readings. The arguments are the
    same as in `conditional_draws`. A draw is rejected and made again if `conditional_draws` states
    that it is not exact: that it does not come from the density, or has a negative compliance
    because of rounding.

    Raises
    ------
    InputError
        If every draw for some value of the hyper-parameters has a negative compliance, even after
        many attempts. The readings then contradict the condition that no compliance is negative.
    """
    beta = np.zeros((len(free), len(bound.names)))
    missing = np.arange(len(free))
    for _ in range(1 + _REPEATS):
        beta[missing], exact = conditional_draws(bound, free[missing], rng, truncated=truncated)
        missing = missing[~exact]
        if not missing.size:
            return beta
    raise no_physical_draw()


def no_physical_draw() -> InputError:
    """Return the exception to be raised if every posterior draw has a negative compliance."""
    return InputError(
        "the posterior must leave room where no compliance is negative, got no draw that falls"
        " there. The readings contradict non-negative compliance: check signs, mount compensation"
        " and forces, or fit --without truncation."
    )
