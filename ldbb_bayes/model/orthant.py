"""Probabilities P(u ≥ 0) of Gaussian vectors u, and exact random draws of u given u ≥ 0.

Each element u_j (a row) is one constraint, such as a compliance that must not be negative; u ≥ 0 is
called the orthant. Small probabilities and random draws are computed by minimax tilting, that is by
sampling from a shifted density (`tilting`). Most probabilities P do not need it, because they lie
between close bounds: with P₁₂ = P(u₁ ≥ 0, u₂ ≥ 0) of the two constraints most likely to fail,

    P₁₂ − Σ_{j>2} P(u_j < 0 ≤ u₁) ≤ P ≤ P₁₂.

Below, a member is one problem of a batch; the distance of a row is the mean of u_j divided by its
sd; the tightest row has the smallest distance.
"""

from __future__ import annotations

from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr, owens_t

from ldbb_bayes.model.tilting import (
    ROUNDING,
    Tilted,
    find_saddle_point,
    least_distance_forces,
)
from ldbb_bayes.model.triangular import solve_lower
from ldbb_bayes.results import Array

__all__ = ["Orthant", "OrthantMoments"]

# A row is a linear combination of others if its remainder is smaller than this share of it.
_DEPENDENT = 1e-7
# A constraint whose mean is this many sd above zero counts as certain, unless the mean of another
# constraint is more than three sd below zero.
_CERTAIN_SD = 12.0
_PUSHED_SD = -3.0
# Constraints whose mean is at least this many sd above zero are left out at first.
_NEAR_SD = 6.0
# Largest error from the constraints left out, as a share of the tolerance.
_LEFT_OUT_SHARE = 0.1
# Most proposals of the rejection sampler for one random draw, and most at once.
_MOST_PROPOSALS = 12_800
_MOST_TRIES = 64
# Points of the Gauss-Legendre rule in one dimension.
_RULE_POINTS = 24
# Numbers of quasi-random points of each scramble, and number of independent scrambles.
_SIZES = (32, 128, 512, 2048, 8192)
_SCRAMBLES = 8
# Student's factor that multiplies the standard error from the scatter of eight scrambles.
_STUDENT = 1.5
# Least error, as a share of that of plain random numbers: a few scrambles may agree by chance.
_LEAST_ERROR_SHARE = 0.1
# Most numbers (points times problems of the batch) that are computed at once.
_CHUNK = 1 << 20
# Factor on the bounds of a problem; the fraction of the product shifts its quasi-random points.
_DIGITS = 1e5
# Owen's T is exact to 1e-15.
_OWEN_ERROR = 1e-15
# The bound by pairs is numerically unreliable for a pair with a smaller probability, or if the
# correlation of two rows is closer to ±1.
_LEAST_PAIR = 1e-9
_LEAST_DIFFERENCE = 1e-6
# If the bound by the tightest row alone has a smaller error, no second row is considered.
_NEGLIGIBLE_ERROR = 1e-9
# Replacement for a distance of zero in Owen's formula, which divides by it.
_NEARLY_ZERO = 1e-300
# Generators of a lattice of up to 2²⁰ points, extensible (F. Y. Kuo,
# lattice-32001-1024-1048576); further ones are any odd numbers.
_LATTICE = (1, 182667, 469891, 498753, 110745, 446979, 250185, 118627, 245333, 283199)
# Random shifts of the lattice are generated for at least this many dimensions.
_SHIFT_DIMENSIONS = 32


class OrthantMoments(NamedTuple):
    """Mean and covariance of e ~ N(0, I) given u = mean + spread e ≥ 0.

    They are given along the d directions of e that the constraints depend on, for w problems.
    """

    #: Shape (w, d).
    mean: Array
    #: Shape (w, d, d).
    covariance: Array
    #: Orthonormal directions of e, shape (w, d, q).
    axes: Array


class _Solved(NamedTuple):
    """Tilted problems, and the orthonormal directions of e that they depend on, (w, d, q)."""

    tilted: Tilted
    axes: Array


class Orthant:
    """Batch of w problems P(u ≥ 0), where u = mean + spread e with e ~ N(0, I).

    Methods raise `InputError` if the saddle point of the tilting cannot be found in double
    precision.

    Parameters
    ----------
    mean
        Means of the m constraints u, shape (w, m).
    spread
        Square root of the covariance of u, shape (w, m, q).
    """

    def __init__(self, mean: Array, spread: Array) -> None:
        self._mean = mean
        self._spread = spread

    def log_probability(
        self,
        tolerance: float = 1e-3,
        *,
        seed: int = 0,
    ) -> tuple[Array, Array]:
        """Return ln P and its error [nat], each of shape (w,).

        ln P is computed analytically if its bounds differ by no more than the tolerance, else from
        up to 65 536 quasi-random points. The error is then the scatter of independent scrambles
        times Student's factor, so that ±3 errors hold 99 %. The result of a problem does not depend
        on the others in the batch. The problems use the same points, so their errors are
        correlated. If no point satisfies the constraints that are linear combinations of others,
        ln P is its upper bound and the error is infinite.

        Parameters
        ----------
        tolerance
            Error to reach [nat].
        seed
            Seed of the scrambles.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = self._mean / np.linalg.norm(self._spread, axis=2)
        distance = np.where(np.isnan(distance), np.inf, distance)
        value, error = _bound_in_closed_form(distance, self._spread)
        open_members = np.flatnonzero(error > tolerance)
        for near in (_NEAR_SD, np.inf):
            # Constraints that are far from failing are left out at first. If their effect is too
            # large, the second pass takes all constraints.
            near_rows = distance[open_members] < near
            unfinished = np.zeros(len(open_members), dtype=bool)
            for pattern in np.unique(near_rows, axis=0):
                same_pattern = np.flatnonzero((near_rows == pattern).all(axis=1))
                index = open_members[same_pattern]
                mean = self._mean[index][:, pattern]
                spread = self._spread[index][:, pattern]
                reduced = Orthant(mean, spread)
                value[index], error[index] = reduced._sum_points(tolerance, seed)
                failure = ndtr(-distance[index][:, ~pattern]).sum(axis=1)
                with np.errstate(divide="ignore", over="ignore"):
                    left_out = np.exp(np.log(failure) - value[index])
                error[index] += left_out
                unfinished[same_pattern] = left_out > _LEFT_OUT_SHARE * tolerance
            open_members = open_members[unfinished]
        return value, error

    @property
    def log_bound(self) -> Array:
        """Upper bound of ln P, shape (w,): smooth, close in the tails, exact for one constraint."""
        return self._tilted.log_bound

    def moments(self, size: int = 512, *, seed: int = 0) -> OrthantMoments:
        """Return mean and covariance of the standard normal e given u ≥ 0.

        They are given along the directions `axes`; perpendicular to these e stays standard normal.
        The quasi-random points of each problem are shifted by an amount computed from its own
        bounds. Errors then average out over many problems, and a result does not depend on the
        others in the batch.

        Parameters
        ----------
        size
            Number of quasi-random points; not used in one or two dimensions, where a quadrature
            rule is used.
        seed
            Seed of the lattice beyond ten dimensions.
        """
        d = len(self._tilted.bound)
        if d <= 2:
            rule = _quadrature_rule(d)
            points = rule.points[..., None]
            log_rule_weight = rule.log_weight
        else:
            shift = self._tilted.bound[:, None] * _DIGITS
            points = _fold((_lattice(d, size, seed)[:, :, None] + shift) % 1.0)
            log_rule_weight = np.zeros(1)
        log_weight, x = self._tilted.propose(points)
        weight = np.exp(log_rule_weight[:, None] + log_weight - log_weight.max(axis=0))
        weight /= weight.sum(axis=0)
        mean = np.einsum("sw,dsw->wd", weight, x)
        centred = x.transpose(2, 1, 0) - mean[:, None, :]
        covariance = np.einsum("sw,wsd,wse->wde", weight, centred, centred)
        return OrthantMoments(mean, covariance, self.axes)

    @property
    def axes(self) -> Array:
        """Orthonormal directions of e that the uncertain constraints depend on, shape (w, d, q).

        The coordinates of e along them are x = axes e.
        """
        return self._solved.axes

    def draw_along_axes(
        self,
        rng: np.random.Generator,
        *,
        max_proposals: int = _MOST_PROPOSALS,
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return an exact random draw of x = axes e given u ≥ 0 for every problem.

        The draws come from a rejection sampler that proposes from the tilted density.

        Returns
        -------
        x
            Shape (w, d); a rejected proposal if none was accepted.
        accepted
            Whether one of about ``max_proposals`` proposals was accepted, shape (w,).
        """
        d, w = self._tilted.bound.shape
        x = np.zeros((d, w))
        open_members = np.arange(w)
        tries = 2
        proposals = 0
        while proposals < max_proposals and open_members.size:
            members = self._tilted.select(open_members)
            uniform = rng.random((open_members.size, tries, d)).transpose(2, 1, 0)
            log_weight, proposal = members.propose(uniform)
            log_uniform = np.log(rng.random(log_weight.shape[::-1])).T
            accept = log_weight - members.log_bound >= log_uniform
            first_accepted = np.argmax(accept, axis=0)
            x[:, open_members] = proposal[:, first_accepted, np.arange(open_members.size)]
            open_members = open_members[~accept.any(axis=0)]
            proposals += tries
            tries = min(2 * tries, _MOST_TRIES)
        return x.T, ~np.isin(np.arange(w), open_members)

    def draw_standard(
        self,
        rng: np.random.Generator,
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return an exact random draw of e ~ N(0, I) given u ≥ 0 for every problem.

        Returns
        -------
        e
            Shape (w, q).
        accepted
            Whether the rejection sampler accepted a proposal, shape (w,).
        """
        x, accepted = self.draw_along_axes(rng)
        normal = rng.standard_normal((len(x), self._spread.shape[2]))
        return self._complete(x, normal), accepted

    def propose_standard(
        self,
        uniform: Array,
        normal: Array,
    ) -> tuple[Array, Array]:
        """Return a random draw of e from the tilted density, and its log importance weight.

        The weight is ln (exact density / tilted density), without the constant ln P.

        Parameters
        ----------
        uniform
            Uniform numbers, shape (w, m); those beyond the number of axes are not used.
        normal
            Standard normal numbers, shape (w, q).
        """
        d = len(self._tilted.bound)
        log_weight, x = self._tilted.propose(uniform.T[:d, None])
        return self._complete(x[:, 0].T, normal), log_weight[0]

    def log_proposal_weight(self, e: Array) -> Array:
        """Return the log importance weight of points e, shape (w,); see `propose_standard`.

        Parameters
        ----------
        e
            Points inside the orthant, shape (w, q).
        """
        x = np.einsum("wiq,wq->iw", self.axes, e)
        return self._tilted.log_weight(x[:, None])[0]

    def _complete(self, x: Array, normal: Array) -> Array:
        """Return e (w, q): x along the directions `axes`, ``normal`` perpendicular to them."""
        normal_along_axes = np.einsum("wiq,wq->wi", self.axes, normal)
        return normal + np.einsum("wiq,wi->wq", self.axes, x - normal_along_axes)

    def _sum_points(
        self,
        tolerance: float,
        seed: int,
    ) -> tuple[Array, Array]:
        """Return ln P and its error from quasi-random points.

        The number of points is multiplied by four until the error is within the tolerance.
        """
        tilted = self._tilted
        value = tilted.log_bound.copy()
        error = np.zeros(len(self._mean))
        if len(tilted.bound) + len(tilted.dependent) > 1:
            error[:] = np.inf
        # Weights do not depend on the last x.
        dimensions = max(len(tilted.bound) - 1, 1)
        for size in _SIZES:
            points = _scrambled_points(dimensions, size, seed).reshape(-1, _SCRAMBLES * size, 1)
            open_members = np.flatnonzero(error > tolerance)
            chunks = -(-open_members.size * points.shape[1] // _CHUNK) or 1
            for index in np.array_split(open_members, chunks):
                proposal = tilted.select(index).propose(points, draw_last=False)
                log_weight = proposal.log_weight.reshape(_SCRAMBLES, size, -1)
                top = log_weight.max(axis=(0, 1))
                finite_top = np.where(np.isfinite(top), top, 0.0)
                weight = np.exp(log_weight - finite_top)
                mean = weight.mean(axis=(0, 1))
                reached = mean > 0.0
                members = index[reached]
                value[members] = top[reached] + np.log(mean[reached])
                relative_error = _scramble_error(weight)[reached] / mean[reached]
                error[members] = relative_error + ROUNDING
        return value, error

    @property
    def _tilted(self) -> Tilted:
        return self._solved.tilted

    @cached_property
    def _solved(self) -> _Solved:
        """Tilted problems, without the constraints that are certain in the whole batch."""
        rows = _uncertain_rows(self._mean, self._spread)
        mean = self._mean[:, rows]
        spread = self._spread[:, rows]
        core = _core_rows(mean, spread)
        core_mean = np.take_along_axis(mean, core, axis=1)
        core_spread = np.take_along_axis(spread, core[:, :, None], axis=1)
        upper = np.linalg.qr(np.swapaxes(core_spread, 1, 2), mode="r")
        lower = np.swapaxes(upper, 1, 2)
        diagonal = np.diagonal(lower, axis1=1, axis2=2)
        lower = lower * np.where(diagonal < 0, -1.0, 1.0)[:, None, :]
        unit = lower / np.abs(diagonal)[:, :, None]
        bound = -core_mean / np.abs(diagonal)
        saddle = find_saddle_point(unit, bound)
        axes = solve_lower(lower, core_spread)
        # Constraints that are linear combinations of others, as unit vectors in terms of x.
        outside_core = np.ones(mean.shape, dtype=bool)
        np.put_along_axis(outside_core, core, values=False, axis=1)
        other_rows = np.nonzero(outside_core)[1].reshape(len(core), -1)
        other_spread = np.take_along_axis(spread, other_rows[:, :, None], axis=1)
        dependent = other_spread @ np.swapaxes(axes, 1, 2)
        size = np.linalg.norm(dependent, axis=2)
        dependent = dependent / size[:, :, None]
        dependent_mean = np.take_along_axis(mean, other_rows, axis=1) / size
        coordinate = np.arange(core.shape[1])
        depends = np.abs(dependent) > _DEPENDENT
        last = np.where(depends, coordinate, -1).max(axis=2, initial=-1)
        tilted = Tilted(
            unit=np.ascontiguousarray(unit.transpose(1, 2, 0)),
            bound=np.ascontiguousarray(bound.T),
            x=np.ascontiguousarray(saddle.x.T),
            tilt=np.ascontiguousarray(saddle.tilt.T),
            dependent=np.ascontiguousarray(dependent.transpose(1, 2, 0)),
            dependent_mean=np.ascontiguousarray(dependent_mean.T),
            last=np.ascontiguousarray(last.T),
        )
        return _Solved(tilted, axes)


def _scramble_error(weight: Array) -> Array:
    """Return the standard error of the mean of weights (scrambles, points, w), shape (w,)."""
    scatter = weight.mean(axis=1).std(axis=0, ddof=1) / np.sqrt(_SCRAMBLES)
    points = weight.shape[0] * weight.shape[1]
    random_error = weight.std(axis=(0, 1)) / np.sqrt(points)
    return np.maximum(_STUDENT * scatter, _LEAST_ERROR_SHARE * random_error)


def _bound_in_closed_form(
    distance: Array,
    spread: Array,
) -> tuple[Array, Array]:
    """Return ln P(u ≥ 0) from analytical bounds, and its largest error, each of shape (w,).

    P is at most the probability of the tightest row alone, and at least that probability minus the
    probabilities that the other rows are negative. Where the two differ, closer bounds are computed
    from pairs of rows. The error is infinite if no bounds are of use.

    Parameters
    ----------
    distance
        Mean of each row divided by its sd, shape (w, m).
    spread
        Matrix of each problem, u = mean + spread e, shape (w, m, q).
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


def _bound_by_pairs(
    distance: Array,
    tail: Array,
    unit: Array,
) -> tuple[Array, Array]:
    """Return ln P midway between the bounds by pairs of rows, and its error, each of shape (w,).

    Distances and tail probabilities have shape (m, w), unit rows (w, m, q), the tightest row first.
    The error is infinite if rounding makes the bounds unreliable.
    """
    m = len(distance)
    correlation = np.einsum("wmq,wnq->mnw", unit, unit[:, :2])
    pair = _pair_probability(distance[0], distance[1], correlation[1, 0])
    usable = np.abs(correlation[1, 0]) < 1.0 - _LEAST_DIFFERENCE
    loss = np.zeros(len(unit))
    for j in range(2, m):
        first_loss = _loss_to_row(distance[j], distance[0], correlation[j, 0])
        second_loss = _loss_to_row(distance[j], distance[1], correlation[j, 1])
        row_loss = np.minimum(tail[j], np.minimum(first_loss, second_loss))
        loss += np.maximum(row_loss, 0.0)
    middle = pair - 0.5 * loss
    error = (0.5 * loss + _OWEN_ERROR * m) / middle
    reliable = usable & (pair > _LEAST_PAIR) & (middle > 0.0)
    return np.log(middle), np.where(reliable, error, np.inf)


def _loss_to_row(
    distance: Array,
    tight_distance: Array,
    correlation: Array,
) -> Array:
    """Return P(u_j < 0 ≤ u_i) for a tight row i, or 1 if the rows are nearly parallel."""
    probability = _pair_probability(-distance, tight_distance, -correlation)
    return np.where(np.abs(correlation) < 1.0 - _LEAST_DIFFERENCE, probability, 1.0)


def _pair_probability(
    h: Array,
    k: Array,
    rho: Array,
) -> Array:
    """Return P(x < h, y < k) of standard normals with correlation ρ.

    By Owen's T function (Ann. Math. Stat. 27, 1075-1090, 1956).
    """
    h = np.where(h == 0.0, _NEARLY_ZERO, h)
    k = np.where(k == 0.0, _NEARLY_ZERO, k)
    root = np.sqrt((1.0 - rho) * (1.0 + rho))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        t_h = owens_t(h, (k / h - rho) / root)
        t_k = owens_t(k, (h / k - rho) / root)
    opposite_signs = (h < 0.0) != (k < 0.0)
    return np.asarray(0.5 * (ndtr(h) + ndtr(k)) - (t_h + t_k) - 0.5 * opposite_signs)


@cache
def _scrambled_points(
    dimensions: int,
    size: int,
    seed: int,
) -> Array:
    """Return independent scrambles of a lattice, shape (dimensions, scrambles, size).

    Each scramble shifts all points by one random vector and then folds them (`_fold`).
    """
    rng = np.random.default_rng([seed, size])
    shifts = rng.random((_SCRAMBLES, max(dimensions, _SHIFT_DIMENSIONS)))
    shift = shifts[:, :dimensions].T
    return _fold((_lattice(dimensions, size, seed)[:, None] + shift[:, :, None]) % 1.0)


def _fold(points: Array) -> Array:
    """Return points folded by the baker's transformation, which makes integrands periodic."""
    return 1.0 - np.abs(2.0 * points - 1.0)


def _lattice(
    dimensions: int,
    size: int,
    seed: int,
) -> Array:
    """Return the points of a lattice, shape (dimensions, size), not yet modulo 1."""
    rng = np.random.default_rng([seed, 1])
    generators = list(_LATTICE)
    while len(generators) < dimensions:
        generators.append(2 * int(rng.integers(1 << 18)) + 1)
    generator = np.array(generators[:dimensions], dtype=float)
    return np.arange(size) * generator[:, None] / size


class _Rule(NamedTuple):
    """Points of the unit cube (dimensions, n) and their log weights (n,)."""

    points: Array
    log_weight: Array


@cache
def _quadrature_rule(dimensions: int) -> _Rule:
    """Return a product rule: Gauss-Legendre in s, u = s³ (10 − 15 s + 6 s²).

    The integrand changes towards both ends, where the substitution puts its points.
    """
    nodes, legendre_weight = np.polynomial.legendre.leggauss(_RULE_POINTS)
    s = (nodes + 1.0) / 2.0
    u = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    weight = 30.0 * (legendre_weight / 2.0) * s**2 * (1.0 - s) ** 2
    shape = (dimensions, _RULE_POINTS**dimensions)
    points = np.meshgrid(*[u] * dimensions, indexing="ij")
    log_weights = np.meshgrid(*[np.log(weight)] * dimensions, indexing="ij")
    log_weight = np.array(log_weights).reshape(shape).sum(axis=0)
    return _Rule(np.array(points).reshape(shape), log_weight)


def _uncertain_rows(
    mean: Array,
    spread: Array,
) -> NDArray[np.intp]:
    """Return the rows that may fail anywhere in the batch.

    Return all rows if the mean of an uncertain row is more than three sd below zero, because
    conditioning on it can then make the other rows fail.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = mean / np.linalg.norm(spread, axis=2)
    certain = np.all(distance > _CERTAIN_SD, axis=0)
    if distance[:, ~certain].min(initial=0.0) < _PUSHED_SD:
        return np.arange(len(certain))
    return np.flatnonzero(~certain)


def _core_rows(
    mean: Array,
    spread: Array,
) -> NDArray[np.intp]:
    """Return linearly independent rows of every problem, the tightest first, (w, rank)."""
    if not mean.shape[1]:
        return np.zeros(mean.shape, dtype=np.intp)
    norms = np.linalg.norm(spread, axis=2)
    rank = np.linalg.matrix_rank(spread[0] / norms[0][:, None], tol=_DEPENDENT)
    distance = mean / norms
    if rank == mean.shape[1]:
        return np.argsort(distance, axis=1, kind="stable")
    unit = spread / norms[:, :, None]
    rows = []
    for k in range(len(mean)):
        rows.append(_binding_rows(distance[k], unit[k], rank))
    return np.array(rows)


def _binding_rows(
    distance: Array,
    unit: Array,
    rank: int,
) -> list[int]:
    """Return linearly independent rows of one problem, the tightest first.

    Rows are chosen first if they are active at the most probable point of the orthant, then by the
    size of their part that is independent of the rows chosen before.
    """
    force = np.zeros(len(unit))
    if (distance < 0.0).any():
        force = least_distance_forces(unit, -distance)
    chosen: list[int] = []
    remainder = unit.copy()
    while len(chosen) < rank:
        size = np.linalg.norm(remainder, axis=1)
        priority = np.where(force > 0.0, 2.0 + force, size)
        row = int(np.argmax(np.where(size > _DEPENDENT, priority, -1.0)))
        chosen.append(row)
        force[row] = 0.0
        along = remainder @ remainder[row]
        remainder = remainder - np.outer(along, remainder[row]) / size[row] ** 2
        remainder[row] = 0.0
    return sorted(chosen, key=lambda row: float(distance[row]))
