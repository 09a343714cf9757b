"""Lower and upper bounds of probabilities P(u ≥ 0) of Gaussian vectors u, in closed form.

Let u₁ ≥ 0 and u₂ ≥ 0 be the two constraints that are most likely to fail, and
P₁₂ = P(u₁ ≥ 0, u₂ ≥ 0). Then

    P₁₂ − Σ_{j>2} P(u_j < 0 ≤ u₁) ≤ P ≤ P₁₂.

The constraint u_j ≥ 0 that is most likely to fail is called the tightest constraint. It has the
smallest ratio of the mean of u_j to the sd of u_j.
"""

from __future__ import annotations

import numpy as np
from scipy.special import log_ndtr, ndtr, owens_t

from ldbb_bayes.results import Array

__all__ = ["bound_in_closed_form"]

# Absolute error of SciPy's implementation of Owen's T function, which is used to compute the
# probability that two correlated Gaussian variables are both not negative.
_OWEN_ERROR = 1e-15
# P(u ≥ 0) is bounded by P(u₁ ≥ 0, u₂ ≥ 0) for the two constraints that are most likely to fail. The
# bound is used only if it is at least this number, because smaller bounds are too inaccurate.
_LEAST_PAIR = 1e-9
# If the correlation of u_i and u_j differs from 1 or −1 by less than this number, the computed
# value of P(u_i ≥ 0, u_j ≥ 0) is too inaccurate and is not used.
_LEAST_DIFFERENCE = 1e-6
# P(u ≥ 0) is first bounded by the probability that the tightest constraint (the constraint that is
# most likely to fail) holds. If the relative error of this bound is at most this number, bounds
# from pairs of constraints are not computed.
_NEGLIGIBLE_ERROR = 1e-9
# Number that replaces h or k in Owen's formula for P(x < h, y < k) if it is zero, because the
# formula divides by both.
_NEARLY_ZERO = 1e-300


def bound_in_closed_form(distance: Array, spread: Array) -> tuple[Array, Array]:
    """Return ln P(u ≥ 0) from analytical bounds, and its largest error, each of shape (w,).

    There is one probability P for each of w Gaussian vectors u with m constraints u_j ≥ 0. The
    tightest constraint is that with the smallest ratio of the mean of u_j to the sd of u_j. P is at
    most the probability that this constraint holds. It is at least this probability minus the
    probabilities that the other elements of u are negative. If the two bounds differ, closer bounds
    are computed from pairs of constraints. The error is the largest error of ln P that the closest
    bounds permit; it may be infinite.

    Parameters
    ----------
    distance
        Mean of each u_j divided by its sd, shape (w, m).
    spread
        Matrix in u = mean + spread @ e for each vector u, shape (w, m, q); e is standard normal
        with q elements.
    """
    w, m = distance.shape
    if m == 0:
        return np.zeros(w), np.zeros(w)
    if m == 1:
        return log_ndtr(distance[:, 0]), np.zeros(w)
    order = np.argsort(distance, axis=1, kind="stable")
    unit = spread / np.linalg.norm(spread, axis=2, keepdims=True)
    unit = np.take_along_axis(unit, order[:, :, None], axis=1)
    sorted_distance = np.take_along_axis(distance, order, axis=1).T
    tail = ndtr(-sorted_distance)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        value = log_ndtr(sorted_distance[0])
        other_tails = tail[1:].sum(axis=0)
        error = np.where(other_tails == 0.0, 0.0, other_tails * np.exp(-value))
        members = np.flatnonzero(error > _NEGLIGIBLE_ERROR)
        pair_value, pair_error = _bound_by_pairs(
            sorted_distance[:, members], tail[:, members], unit[members]
        )
        better = pair_error < error[members]
    value[members[better]] = pair_value[better]
    error[members[better]] = pair_error[better]
    return value, error


def _bound_by_pairs(distance: Array, tail: Array, unit: Array) -> tuple[Array, Array]:
    """Return ln P(u ≥ 0), computed from bounds of P, and the error of ln P, each of shape (w,).

    There is one probability P for each of w Gaussian vectors u with m constraints u_j ≥ 0; u
    depends on q standard normal variables. The upper bound of P is P₁₂ = P(u₁ ≥ 0, u₂ ≥ 0) of the
    first two constraints. The lower bound is P₁₂ − Σ_{j>2} p_j, where p_j is the smallest of
    P(u_j < 0), P(u_j < 0 ≤ u₁) and P(u_j < 0 ≤ u₂). The value of P is the mean of the two bounds.
    The error is infinite if rounding errors make the bounds unreliable.

    Parameters
    ----------
    distance
        Mean of each of the m elements of u divided by its sd, sorted so that the smallest ratio is
        first, shape (m, w).
    tail
        Probability that each constraint alone fails, shape (m, w).
    unit
        Rows of coefficients of the constraints, scaled to length one, shape (w, m, q).
    """
    m = len(distance)
    correlation = np.einsum("wmq,wnq->mnw", unit, unit[:, :2])
    pair = _pair_probability(distance[0], distance[1], correlation[1, 0])
    usable = np.abs(correlation[1, 0]) < 1.0 - _LEAST_DIFFERENCE
    loss = np.zeros(len(unit))
    for j in range(2, m):
        first_loss = _probability_j_fails_i_holds(distance[j], distance[0], correlation[j, 0])
        second_loss = _probability_j_fails_i_holds(distance[j], distance[1], correlation[j, 1])
        row_loss = np.minimum(tail[j], np.minimum(first_loss, second_loss))
        loss += np.maximum(row_loss, 0.0)
    middle = pair - 0.5 * loss
    error = (0.5 * loss + _OWEN_ERROR * m) / middle
    reliable = usable & (pair > _LEAST_PAIR) & (middle > 0.0)
    return np.log(middle), np.where(reliable, error, np.inf)


def _probability_j_fails_i_holds(
    distance: Array, tight_distance: Array, correlation: Array
) -> Array:
    """Return the probability P(u_j < 0 ≤ u_i) of two Gaussian variables u_i and u_j.

    ``distance`` is the mean of u_j divided by its sd, ``tight_distance`` is the mean of u_i divided
    by its sd, and ``correlation`` is the correlation of u_i and u_j. All three are arrays of shape
    (w,), with one element for each of w pairs of variables. The result is 1 if the correlation is
    too close to ±1 to compute the probability.
    """
    probability = _pair_probability(-distance, tight_distance, -correlation)
    return np.where(np.abs(correlation) < 1.0 - _LEAST_DIFFERENCE, probability, 1.0)


def _pair_probability(h: Array, k: Array, rho: Array) -> Array:
    """Return P(x < h, y < k) for standard normal x and y with correlation ρ.

    ``h``, ``k`` and the correlation ``rho`` are arrays, and there is one probability for each of
    their elements. The probabilities are computed with Owen's T function (Ann. Math. Stat. 27,
    1075-1090, 1956).
    """
    h = np.where(h == 0.0, _NEARLY_ZERO, h)
    k = np.where(k == 0.0, _NEARLY_ZERO, k)
    root = np.sqrt((1.0 - rho) * (1.0 + rho))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        t_h = owens_t(h, (k / h - rho) / root)
        t_k = owens_t(k, (h / k - rho) / root)
    opposite_signs = (h < 0.0) != (k < 0.0)
    return np.asarray(0.5 * (ndtr(h) + ndtr(k)) - (t_h + t_k) - 0.5 * opposite_signs)
