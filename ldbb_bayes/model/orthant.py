"""Probabilities P(u ≥ 0) of Gaussian vectors u, and exact random draws of u given u ≥ 0.

Each element u_j is one constraint, such as a compliance that must not be negative. The region u ≥ 0
is called the orthant. Small probabilities and random draws are computed by minimax tilting, that is
by sampling from a shifted density (`tilting`). Most probabilities P do not need it, because they
lie between close bounds: with P₁₂ = P(u₁ ≥ 0, u₂ ≥ 0) of the two constraints most likely to fail,

    P₁₂ − Σ_{j>2} P(u_j < 0 ≤ u₁) ≤ P ≤ P₁₂.

The tightest constraint is the one whose mean, divided by its sd, is smallest.
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

# A constraint counts as a linear combination of others if the part of its row of coefficients that
# the other rows cannot explain is shorter than this share of the row.
_DEPENDENT = 1e-7
# A constraint u_j ≥ 0 counts as certain if the mean of u_j is this many sd above zero.
_CERTAIN_SD = 12.0
# No constraint counts as certain if the mean of another one, divided by its sd, is below this.
_PUSHED_SD = -3.0
# A probability is first computed without the constraints u_j ≥ 0 whose mean is at least this many
# sd above zero.
_NEAR_SD = 6.0
# Largest error from leaving out unlikely constraints, as a share of the error tolerance.
_LEFT_OUT_SHARE = 0.1
# Most proposals of the rejection sampler for one random draw.
_MOST_PROPOSALS = 12_800
# Most proposals for one random draw that are computed in one call.
_MOST_TRIES = 64
# Number of points of the Gauss-Legendre quadrature rule in one dimension.
_RULE_POINTS = 24
# Numbers of quasi-random points that are tried in turn until the error is small enough.
_SIZES = (32, 128, 512, 2048, 8192)
# Number of scrambles: independent random shifts of the quasi-random points. The scatter of their
# results gives the error.
_SCRAMBLES = 8
# Factor on the standard error from the scatter of only eight scrambles (Student's t).
_STUDENT = 1.5
# The stated error is at least this share of the error of plain random numbers, because the results
# of a few scrambles may agree by chance.
_LEAST_ERROR_SHARE = 0.1
# Largest number of weights (points times problems) that are computed at once, to limit memory.
_CHUNK = 1 << 20
# The bounds of a problem times this factor, modulo 1, are the shift of its quasi-random points.
# Different problems thereby use different points.
_DIGITS = 1e5
# Absolute error of Owen's T function as SciPy computes it.
_OWEN_ERROR = 1e-15
# The bound by pairs of constraints is too inaccurate if the probability of the pair is smaller.
_LEAST_PAIR = 1e-9
# The bound by pairs of constraints is too inaccurate if their correlation is this close to ±1.
_LEAST_DIFFERENCE = 1e-6
# If the bound by the tightest constraint alone has an error below this, no pair is considered.
_NEGLIGIBLE_ERROR = 1e-9
# Replacement for arguments of zero in Owen's formula, which divides by them.
_NEARLY_ZERO = 1e-300
# Generating vector of a lattice of quasi-random points, one number for each dimension (F. Y. Kuo,
# lattice-32001-1024-1048576). Random odd numbers serve for further dimensions.
_LATTICE = (1, 182667, 469891, 498753, 110745, 446979, 250185, 118627, 245333, 283199)
# Random shifts of the lattice are generated for at least this many dimensions. The shifts of the
# first dimensions then do not depend on how many dimensions there are.
_SHIFT_DIMENSIONS = 32


class OrthantMoments(NamedTuple):
    """Mean and covariance of e ~ N(0, I) given u = mean + spread e ≥ 0, for w problems.

    e has q elements. The moments are given along the d directions that the constraints depend on.
    """

    #: Mean of the coordinates of e along ``axes``, shape (w, d) for w problems.
    mean: Array
    #: Covariance of the coordinates of e along ``axes``, shape (w, d, d) for w problems.
    covariance: Array
    #: The d orthonormal directions of the vector e that the constraints depend on, shape (w, d, q).
    axes: Array


class _Solved(NamedTuple):
    """Problems in triangular form, for sampling from a shifted (tilted) density.

    ``axes`` (w, d, q) holds d orthonormal directions of the standard normal vector e (q,) for each
    of the w problems. The constraints depend on e along these directions only.
    """

    tilted: Tilted
    axes: Array


class Orthant:
    """Batch of w problems P(u ≥ 0), where u = mean + spread e with e ~ N(0, I).

    Methods raise `InputError` if double precision does not suffice to find the density from which
    they sample.

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
        """Return ln P(u ≥ 0) and its numerical error [nat], each of shape (w,) for w problems.

        ln P is computed analytically if its bounds differ by no more than the tolerance, else from
        up to 65 536 quasi-random points. The error then follows from the scatter between eight
        random shifts of the points, times Student's factor, so that ±3 errors hold 99 %. The result
        of a problem does not depend on the others in the batch. All problems use the same points,
        so their errors are correlated. If no point satisfies all constraints, ln P is its upper
        bound and the error is infinite.

        Parameters
        ----------
        tolerance
            Error to reach [nat].
        seed
            Seed of the random shifts.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = self._mean / np.linalg.norm(self._spread, axis=2)
        distance = np.where(np.isnan(distance), np.inf, distance)
        value, error = _bound_in_closed_form(distance, self._spread)
        open_members = np.flatnonzero(error > tolerance)
        for near in (_NEAR_SD, np.inf):
            # The first pass leaves out constraints that are far from failing. Where their effect
            # exceeds the tolerance, the second pass uses all constraints.
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
        """Upper bound of ln P(u ≥ 0) for each of w problems, shape (w,).

        The bound is a smooth function of the mean, close where P is small, and exact for a single
        constraint.
        """
        return self._tilted.log_bound

    def moments(self, size: int = 512, *, seed: int = 0) -> OrthantMoments:
        """Return mean and covariance of the standard normal e, given u = mean + spread e ≥ 0.

        The moments are given along the directions `axes`. Perpendicular to them e stays standard
        normal. The quasi-random points of each problem are shifted by an amount computed from its
        own bounds. Errors then average out over many problems, and a result does not depend on the
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

        e is the standard normal vector (q,) of each of the w problems. Its d coordinates along
        these directions are x = axes e.
        """
        return self._solved.axes

    def draw_along_axes(
        self,
        rng: np.random.Generator,
        *,
        max_proposals: int = _MOST_PROPOSALS,
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return an exact random draw of x = axes e given u ≥ 0 for each of w problems.

        e is the standard normal vector of a problem and x its d coordinates along `axes`. A
        rejection sampler proposes x from the shifted (tilted) density.

        Returns
        -------
        x
            Random draws, shape (w, d); a rejected proposal if none was accepted.
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
        """Return an exact random draw of e ~ N(0, I) given u = mean + spread e ≥ 0.

        Each of the w problems gets one draw.

        Returns
        -------
        e
            Random draws of the q elements, shape (w, q).
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
        """Return a random draw of e from the shifted density, and its log importance weight.

        e is the standard normal vector in u = mean + spread e. The weight is
        ln (exact density / shifted density), without the constant ln P(u ≥ 0).

        Parameters
        ----------
        uniform
            Uniform numbers, shape (w, m); only the first ones are used, one for each of `axes`.
        normal
            Standard normal numbers, shape (w, q).
        """
        d = len(self._tilted.bound)
        log_weight, x = self._tilted.propose(uniform.T[:d, None])
        return self._complete(x[:, 0].T, normal), log_weight[0]

    def log_proposal_weight(self, e: Array) -> Array:
        """Return the log importance weight of one point e for each of w problems, shape (w,).

        The weight is that of `propose_standard`.

        Parameters
        ----------
        e
            Points with u = mean + spread e ≥ 0, shape (w, q).
        """
        x = np.einsum("wiq,wq->iw", self.axes, e)
        return self._tilted.log_weight(x[:, None])[0]

    def _complete(self, x: Array, normal: Array) -> Array:
        """Return vectors e (w, q) from their coordinates x along `axes`.

        Perpendicular to these directions, e is equal to ``normal``, shape (w, q).
        """
        normal_along_axes = np.einsum("wiq,wq->wi", self.axes, normal)
        return normal + np.einsum("wiq,wi->wq", self.axes, x - normal_along_axes)

    def _sum_points(
        self,
        tolerance: float,
        seed: int,
    ) -> tuple[Array, Array]:
        """Return ln P(u ≥ 0) and its error from quasi-random points, each of shape (w,).

        The number of points is multiplied by four until the error is within the tolerance.
        """
        tilted = self._tilted
        value = tilted.log_bound.copy()
        error = np.zeros(len(self._mean))
        if len(tilted.bound) + len(tilted.dependent) > 1:
            error[:] = np.inf
        # Importance weights do not depend on the last coordinate, so it needs no points.
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
        """Problems in triangular form, without constraints that are certain in the whole batch."""
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
        # The following constraints are linear combinations of others. Each is expressed as a unit
        # vector in the coordinates x along the directions ``axes``.
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
    """Return the standard error of the mean weight of each of w problems, shape (w,).

    ``weight`` has shape (scrambles, points, w); scrambles are independent random shifts of the
    quasi-random points.
    """
    scatter = weight.mean(axis=1).std(axis=0, ddof=1) / np.sqrt(_SCRAMBLES)
    points = weight.shape[0] * weight.shape[1]
    random_error = weight.std(axis=(0, 1)) / np.sqrt(points)
    return np.maximum(_STUDENT * scatter, _LEAST_ERROR_SHARE * random_error)


def _bound_in_closed_form(
    distance: Array,
    spread: Array,
) -> tuple[Array, Array]:
    """Return ln P(u ≥ 0) from analytical bounds, and its largest error, each of shape (w,).

    A row is one element u_j of u; the tightest has the smallest mean divided by sd. P is at most
    the probability of u_j ≥ 0 for the tightest row alone. P is at least this probability minus the
    probabilities that other rows are negative. Where the two bounds differ, closer ones are
    computed from pairs of rows. The error is infinite if all bounds are too far apart.

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
    """Return ln P(u ≥ 0) midway between bounds from pairs of constraints, and its error.

    The results have shape (w,). The error is infinite if rounding makes the bounds unreliable.

    Parameters
    ----------
    distance
        Mean of each of m constraints divided by its sd, the smallest first, shape (m, w).
    tail
        Probability that each constraint alone fails, shape (m, w).
    unit
        Rows of coefficients of the constraints, of length one, shape (w, m, q).
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
    """Return the probability P(u_j < 0 ≤ u_i) of two Gaussian variables u_i and u_j.

    ``tight_distance`` and ``distance`` are the means of u_i and u_j divided by their sds. The
    result is 1 if the correlation is too close to ±1 to compute the probability.
    """
    probability = _pair_probability(-distance, tight_distance, -correlation)
    return np.where(np.abs(correlation) < 1.0 - _LEAST_DIFFERENCE, probability, 1.0)


def _pair_probability(
    h: Array,
    k: Array,
    rho: Array,
) -> Array:
    """Return P(x < h, y < k) for standard normal x and y with correlation ρ.

    It is computed by Owen's T function (Ann. Math. Stat. 27, 1075-1090, 1956).
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
    """Return quasi-random points, shape (dimensions, scrambles, size).

    Each scramble is a copy of the same lattice, shifted by one random vector and then folded by
    the baker's transformation (`_fold`).
    """
    rng = np.random.default_rng([seed, size])
    shifts = rng.random((_SCRAMBLES, max(dimensions, _SHIFT_DIMENSIONS)))
    shift = shifts[:, :dimensions].T
    return _fold((_lattice(dimensions, size, seed)[:, None] + shift[:, :, None]) % 1.0)


def _fold(points: Array) -> Array:
    """Return numbers between 0 and 1 after the baker's transformation 1 − |2x − 1|.

    It makes an integrand periodic, so that a lattice of points integrates it more exactly.
    """
    return 1.0 - np.abs(2.0 * points - 1.0)


def _lattice(
    dimensions: int,
    size: int,
    seed: int,
) -> Array:
    """Return the points of a lattice before they are taken modulo 1, shape (dimensions, size)."""
    rng = np.random.default_rng([seed, 1])
    generators = list(_LATTICE)
    while len(generators) < dimensions:
        generators.append(2 * int(rng.integers(1 << 18)) + 1)
    generator = np.array(generators[:dimensions], dtype=float)
    return np.arange(size) * generator[:, None] / size


class _Rule(NamedTuple):
    """Quadrature rule of n points: points in the unit cube (dimensions, n), log weights (n,)."""

    points: Array
    log_weight: Array


@cache
def _quadrature_rule(dimensions: int) -> _Rule:
    """Return a quadrature rule for the unit cube in one or two dimensions.

    In each dimension, it is the Gauss-Legendre rule in s with the substitution
    u = s³ (10 − 15 s + 6 s²). The points u are dense at both ends, where the integrand changes.
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
    """Return the indices of the constraints that are not certain in every problem of the batch.

    Return all indices if an uncertain constraint has its mean more than three sd below zero.
    Imposing it can then make constraints fail that look certain.
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
    """Return the indices of linearly independent constraints of w problems, shape (w, rank).

    The tightest constraint, with the smallest mean divided by sd, is first.
    """
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
    """Return the indices of linearly independent constraints of one problem, the tightest first.

    Constraints that hold with equality at the most probable permitted point are chosen first. Then
    follow those with the largest part that is independent of the constraints chosen before. The
    tightest constraint has the smallest ``distance``, its mean divided by its sd.
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
