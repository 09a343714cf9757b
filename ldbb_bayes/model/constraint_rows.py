"""Constraints u_j ≥ 0 on Gaussian vectors that matter: those that may fail and are independent."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.model.tilting import least_distance_multipliers
from ldbb_bayes.results import Array

__all__ = ["DEPENDENT", "core_rows", "uncertain_rows"]

# A constraint on a standard normal vector has a row of coefficients. Consider the component of this
# row that is perpendicular to the rows of other constraints. If its length is below this fraction
# of the row's length, the constraint counts as a linear combination of the other constraints.
DEPENDENT = 1e-7
# A constraint u_j ≥ 0 on a Gaussian variable u_j is treated as certain, and left out of the
# calculation, if the mean of u_j divided by the sd of u_j is larger than this number. `_PUSHED_SD`
# states an exception.
_CERTAIN_SD = 12.0
# A constraint u_j ≥ 0 on a Gaussian variable u_j counts as improbable if the mean of u_j divided by
# the sd of u_j is below this number. Constraints that are almost certain to hold (`_CERTAIN_SD`)
# are left out of the calculation, but not if there is an improbable constraint: if an improbable
# constraint holds, a constraint that seems certain may fail.
_PUSHED_SD = -3.0


def uncertain_rows(mean: Array, spread: Array) -> NDArray[np.intp]:
    """Return the indices (from 0) of the constraints that may fail for at least one vector.

    Each of w Gaussian vectors u = mean + spread @ e has m constraints u_j ≥ 0; e is standard normal
    with q elements, ``mean`` has the shape (w, m), and ``spread`` has the shape (w, m, q). A
    constraint u_j ≥ 0 counts as certain, and is left out, if the mean of u_j is more than 12 sds
    above zero for every vector. All indices are returned if the mean of at least one u_j is more
    than three sds below zero: under the condition that this u_j is not negative, constraints that
    seem certain to hold may fail.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = mean / np.linalg.norm(spread, axis=2)
    certain = np.all(distance > _CERTAIN_SD, axis=0)
    if distance[:, ~certain].min(initial=0.0) < _PUSHED_SD:
        return np.arange(len(certain))
    return np.flatnonzero(~certain)


def core_rows(mean: Array, spread: Array) -> NDArray[np.intp]:
    """Return a largest set of linearly independent constraints on each of w Gaussian vectors.

    Each vector u = mean + spread @ e has m constraints u_j ≥ 0; e is standard normal with q
    elements, ``mean`` has the shape (w, m), and ``spread`` has the shape (w, m, q). The result
    holds the indices j of the chosen constraints, shape (w, rank). The rank is their number, which
    is the same for all vectors. If not all constraints are linearly independent, `_binding_rows`
    chooses some of them. The chosen indices of each vector are sorted by the mean of u_j divided by
    the sd of u_j, the smallest ratio first.
    """
    if not mean.shape[1]:
        return np.zeros(mean.shape, dtype=np.intp)
    norms = np.linalg.norm(spread, axis=2)
    rank = np.linalg.matrix_rank(spread[0] / norms[0][:, None], tol=DEPENDENT)
    distance = mean / norms
    if rank == mean.shape[1]:
        return np.argsort(distance, axis=1, kind="stable")
    return _binding_rows(distance, spread / norms[:, :, None], int(rank))


def _binding_rows(distance: Array, unit: Array, rank: int) -> NDArray[np.intp]:
    """Return the indices of linearly independent constraints on w vectors, shape (w, rank).

    There are m constraints on each of w standard normal vectors e of q elements. At the most
    probable e that satisfies all constraints, some constraints hold with equality; these are chosen
    first. Further constraints are then added one by one until there are ``rank`` constraints. The
    next constraint is always the one whose row has the longest component perpendicular to the rows
    of all constraints chosen before. The indices of each vector are sorted by increasing
    ``distance``.

    Parameters
    ----------
    distance
        Mean of each constrained variable divided by its sd, shape (w, m). The ratio is smallest for
        the tightest constraint.
    unit
        Rows of coefficients of the constraints, scaled to length one, shape (w, m, q).
    rank
        Number of linearly independent constraints.
    """
    multipliers = np.zeros(distance.shape)
    for k in np.flatnonzero((distance < 0.0).any(axis=1)):
        multipliers[k] = least_distance_multipliers(unit[k], -distance[k])
    vectors = np.arange(len(distance))
    chosen = np.zeros((len(distance), rank), dtype=np.intp)
    remainder = unit.copy()
    for number in range(rank):
        size = np.linalg.norm(remainder, axis=2)
        priority = np.where(multipliers > 0.0, 2.0 + multipliers, size)
        row = np.argmax(np.where(size > DEPENDENT, priority, -1.0), axis=1)
        chosen[:, number] = row
        multipliers[vectors, row] = 0.0
        direction = remainder[vectors, row] / size[vectors, row, None]
        along = np.einsum("wmq,wq->wm", remainder, direction)
        remainder -= along[:, :, None] * direction[:, None, :]
        remainder[vectors, row] = 0.0
    order = np.argsort(np.take_along_axis(distance, chosen, axis=1), axis=1, kind="stable")
    return np.take_along_axis(chosen, order, axis=1)
