"""Probabilities P(u ≥ 0) of Gaussian vectors u, and exact random draws of u given u ≥ 0.

Each element u_j, such as a compliance, has the constraint u_j ≥ 0. The region u ≥ 0 is called the
orthant. Small probabilities and random draws are computed by minimax tilting, that is, by sampling
from a shifted density (`tilting`). Most probabilities P are computed without sampling, from lower
and upper bounds that are close to each other. Let u₁ ≥ 0 and u₂ ≥ 0 be the two constraints that are
most likely to fail, and P₁₂ = P(u₁ ≥ 0, u₂ ≥ 0). Then

    P₁₂ − Σ_{j>2} P(u_j < 0 ≤ u₁) ≤ P ≤ P₁₂.

The constraint u_j ≥ 0 that is most likely to fail is called the tightest constraint. It has the
smallest ratio of the mean of u_j to the sd of u_j.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr, owens_t

from ldbb_bayes.model.tilting import (
    ROUNDING,
    Tilted,
    find_saddle_point,
    least_distance_multipliers,
)
from ldbb_bayes.model.triangular import solve_lower
from ldbb_bayes.results import Array

__all__ = ["NoisyLogProbability", "Orthant", "OrthantMoments"]

# A constraint on a standard normal vector has a row of coefficients. Consider the component of this
# row that is perpendicular to the rows of other constraints. If its length is below this fraction
# of the row's length, the constraint counts as a linear combination of the other constraints.
_DEPENDENT = 1e-7
# A constraint u_j ≥ 0 on a Gaussian variable u_j is treated as certain, and left out of the
# calculation, if the mean of u_j divided by the sd of u_j is larger than this number. `_PUSHED_SD`
# states an exception.
_CERTAIN_SD = 12.0
# A constraint u_j ≥ 0 on a Gaussian variable u_j counts as improbable if the mean of u_j divided by
# the sd of u_j is below this number. Constraints that are almost certain to hold (`_CERTAIN_SD`)
# are left out of the calculation, but not if there is an improbable constraint: if an improbable
# constraint holds, a constraint that seems certain may fail.
_PUSHED_SD = -3.0
# The probability P(u ≥ 0) is first computed without the constraints u_j ≥ 0 for which the mean of
# u_j divided by the sd of u_j is at least this number.
_NEAR_SD = 6.0
# Constraints that hardly ever fail are left out if ln P(u ≥ 0) then changes by at most this
# fraction of the error tolerance. Otherwise all constraints are used.
_LEFT_OUT_SHARE = 0.1
# Largest number of proposals that rejection sampling tries for one random draw from a truncated
# Gaussian density.
_MOST_PROPOSALS = 12_800
# Largest number of proposals that rejection sampling computes at once for one random draw from a
# truncated Gaussian density.
_MOST_TRIES = 64
# Number of points, in each dimension, of the Gauss-Legendre quadrature rule with which moments of
# Gaussian vectors u given u ≥ 0 are computed.
_RULE_POINTS = 24
# Number of independent estimates of a probability P(u ≥ 0). Each estimate uses a scramble, which is
# a copy of one set of quasi-random points, shifted by a random vector. The scatter between the
# estimates gives the stated error.
_SCRAMBLES = 8
# Numbers of quasi-random points in a scramble (a randomly shifted copy of the set of points). These
# numbers are tried one after the other until the error of ln P(u ≥ 0) is small enough.
_SIZES = (32, 128, 512, 2048, 8192)
# Factor by which the standard error of a probability is multiplied, because this standard error is
# computed from only eight estimates. It follows from Student's t distribution.
_STUDENT = 1.5
# The stated error of a probability is at least this fraction of the error that the same number of
# independent random points would give. This limit is needed because the error is computed from the
# scatter of eight estimates, which may agree by chance.
_LEAST_ERROR_SHARE = 0.1
# Largest number of importance weights that are computed at once, to limit the memory used. There is
# one weight for every quasi-random point and every probability P(u ≥ 0) of a batch.
_CHUNK = 1 << 20
# Factor from which shifts of quasi-random points are computed. In each dimension, all points for a
# set of constraints are shifted by the same amount: the lower bound of one constraint times this
# factor, modulo 1. The factor is so large that even slightly different bounds give different
# shifts.
_DIGITS = 1e5
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
# Number that replaces h or k in Owen's formula for P(x < h, y < k) if h or k is zero, because the
# formula divides by both numbers.
_NEARLY_ZERO = 1e-300
# Generating vector of a lattice of quasi-random points, one number for each of ten dimensions
# (F. Y. Kuo, lattice-32001-1024-1048576). For further dimensions random odd numbers are used.
_LATTICE = (1, 182667, 469891, 498753, 110745, 446979, 250185, 118627, 245333, 283199)
# Random shifts of the lattice of quasi-random points are generated for at least this number of
# dimensions. The shifts of the first dimensions then do not depend on the number of dimensions that
# are used.
_SHIFT_DIMENSIONS = 32


class OrthantMoments(NamedTuple):
    """Means and covariances of w truncated normal vectors e.

    Each vector e has q elements. It is standard normal, under the condition that all m elements of
    the vector u = mean + spread @ e are at least zero. u depends only on the d coordinates of e
    along the orthonormal directions ``axes``. The means and covariances are those of these
    coordinates.
    """

    #: Conditional means of the d coordinates of w standard normal vectors e, shape (w, d). The
    #: condition is that all constraints on e hold. The coordinates are components of e along the d
    #: directions ``axes``.
    mean: Array
    #: Conditional covariances of the d coordinates of w standard normal vectors e, shape (w, d, d).
    #: The condition is that all constraints on e hold. The coordinates are components of e along
    #: the d directions ``axes``.
    covariance: Array
    #: Orthonormal directions for each of w standard normal vectors e with q elements, shape
    #: (w, d, q). The constraints depend only on the d coordinates of e along these directions.
    axes: Array
    #: Log probabilities ln P(u ≥ 0) that all constraints on e hold, shape (w,)
    log_probability: Array


class NoisyLogProbability(NamedTuple):
    """Log probabilities ln P(u ≥ 0) of w Gaussian vectors u, and their numerical errors [nat].

    ``common_error`` is the error of analytical approximations, and ``noise`` the random error from
    sampling.
    """

    #: log probability that no element of u is negative, for each of w Gaussian vectors u, shape
    #: (w,)
    log_value: Array
    #: largest error that each log probability ln P(u ≥ 0) can have because analytical bounds are
    #: used or because some constraints u_j ≥ 0 are left out [nat], shape (w,); infinite if no
    #: quasi-random point satisfies all constraints
    common_error: Array
    #: error of each log probability ln P(u ≥ 0) that is due to the limited number of quasi-random
    #: points [nat], shape (w,). It is stated as the standard error times a factor from Student's t
    noise: Array


class _Solved(NamedTuple):
    """Constraints on w random vectors, and shifted densities from which the vectors are drawn.

    Each of the w vectors e is standard normal and has q elements. ``axes``, shape (w, d, q), holds
    d orthonormal directions; the constraints depend only on the components of e along them.
    ``tilted`` holds the constraints as inequalities for these components, with a triangular matrix
    of coefficients. It also holds the shifts (tilts) of the density from which the components are
    drawn.
    """

    tilted: Tilted
    axes: Array


@dataclass(frozen=True)
class _Points:
    """Quasi-random points: eight copies of one lattice, each with a random shift (scramble)."""

    seed: int
    #: whether the probabilities of all Gaussian vectors are computed from the same quasi-random
    #: points
    shared: bool

    def for_constraints(self, tilted: Tilted, size: int) -> Array:
        """Return quasi-random points in the unit cube for w sets of constraints.

        ``tilted`` holds the sets of constraints, each on a standard normal vector x. There are
        eight scrambles (randomly shifted copies of a lattice) of ``size`` points. If all sets of
        constraints use the same points, the result has the shape (dimensions, scrambles · size, 1).
        Otherwise it has the shape (dimensions, scrambles · size, w). For each set, the points are
        then shifted once more, by amounts that are computed from the bounds of its constraints
        alone. The points have one dimension less than x, because the importance weights do not
        depend on the last element of x.
        """
        dimensions = max(len(tilted.bound) - 1, 1)
        points = _scrambled_lattice(dimensions, size, self.seed).reshape(dimensions, -1, 1)
        if not self.shared:
            points = points + _shift_of_points(tilted)[:dimensions]
        return _fold(points % 1.0)


class Orthant:
    """Batch of w Gaussian vectors u, each with the condition u ≥ 0.

    Methods compute the probability of u ≥ 0, and draw random vectors given u ≥ 0. Each vector u =
    mean + spread @ e has m elements, where e ~ N(0, I) has q elements. Each u_j ≥ 0 is a
    constraint. Random vectors are drawn from a normal density that is shifted towards u ≥ 0 (module
    `tilting`). Methods raise an `InputError` if double precision does not suffice to compute this
    shifted density.

    Parameters
    ----------
    mean
        Means of the m elements of each of the w vectors u, shape (w, m).
    spread
        Square root of the covariance of each vector u, shape (w, m, q).
    """

    def __init__(self, mean: Array, spread: Array) -> None:
        """Store means and square roots of the covariances of w Gaussian vectors u.

        Each vector is u = mean + spread @ e, where e is standard normal with q elements. ``mean``
        has the shape (w, m) and ``spread`` the shape (w, m, q) for vectors of m elements.
        """
        self._mean = mean
        self._spread = spread

    def log_probability(
        self,
        tolerance: float = 1e-3,
        *,
        seed: int = 0,
    ) -> tuple[Array, Array]:
        """Return ln P(u ≥ 0) and its numerical error [nat] for w vectors u, each of shape (w,).

        ln P is computed from analytical bounds if they are close enough to each other for the
        tolerance. Otherwise it is computed from up to 65 536 quasi-random points. Eight copies of
        these points, each with a random shift, then give eight estimates; the error is the standard
        error from the scatter of the estimates, times a factor from Student's t. With a probability
        of 99 %, the true value of ln P differs from the result by at most three times this error.
        The result for a vector does not depend on the other vectors. All vectors use the same
        points, so that their errors are correlated. If no point satisfies all constraints, ln P is
        replaced by its upper bound, and the error is infinite.

        Parameters
        ----------
        tolerance
            Largest error of ln P that is accepted [nat]. The number of points is increased until
            the error is small enough or all 65 536 points are used.
        seed
            Seed of the random shifts of the quasi-random points.
        """
        estimate = self._estimate(tolerance, tolerance, _Points(seed, shared=True))
        return estimate.log_value, estimate.common_error + estimate.noise

    def log_probability_with_noise(
        self,
        tolerance: float,
        largest_noise: float,
        *,
        seed: int = 0,
    ) -> NoisyLogProbability:
        """Return ln P(u ≥ 0) for w Gaussian vectors u, each from different quasi-random points.

        The errors due to the quasi-random points, called noise, are independent between the vectors
        u. In a mean over many vectors they largely cancel, so that few points suffice for each
        vector. The noise is stated as a standard error, times a factor from Student's t. In all
        other respects, the method works like `log_probability`.

        Parameters
        ----------
        tolerance
            Analytical bounds are used for a vector if they determine ln P(u ≥ 0) with an error of
            at most ``tolerance`` [nat]. Otherwise quasi-random points are used.
        largest_noise
            Largest noise that is accepted [nat]. The number of points is increased until the noise
            is small enough or all 65 536 points are used.
        seed
            Seed of the quasi-random points.
        """
        return self._estimate(tolerance, largest_noise, _Points(seed, shared=False))

    def _estimate(
        self, tolerance: float, largest_noise: float, points: _Points
    ) -> NoisyLogProbability:
        """Return ln P(u ≥ 0) for w Gaussian vectors u, from analytical bounds or sampled points.

        The bounds are used for a vector if the largest error that they permit is at most
        ``tolerance`` [nat]. For other vectors, ``points`` generates quasi-random points. The error
        due to these points is called noise. The number of points is increased until the noise is at
        most ``largest_noise`` [nat].
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = self._mean / np.linalg.norm(self._spread, axis=2)
        distance = np.where(np.isnan(distance), np.inf, distance)
        value, error = _bound_in_closed_form(distance, self._spread)
        noise = np.zeros(len(value))
        open_members = np.flatnonzero(error > tolerance)
        for near in (_NEAR_SD, np.inf):
            # ln P(u ≥ 0) is first computed without the constraints u_j ≥ 0 for which the mean of
            # u_j is at least six sds above zero. If leaving them out changes ln P(u ≥ 0) by more
            # than a tenth of the tolerance, it is computed again with all constraints.
            is_used = distance[open_members] < near
            unfinished = np.zeros(len(open_members), dtype=bool)
            for pattern in np.unique(is_used, axis=0):
                # All random vectors for which the same constraints are used are processed together.
                same_pattern = np.flatnonzero((is_used == pattern).all(axis=1))
                index = open_members[same_pattern]
                mean = self._mean[index][:, pattern]
                spread = self._spread[index][:, pattern]
                reduced = Orthant(mean, spread)
                value[index], noise[index] = reduced._sum_points(largest_noise, points)
                failure = ndtr(-distance[index][:, ~pattern]).sum(axis=1)
                with np.errstate(divide="ignore", over="ignore"):
                    left_out = np.exp(np.log(failure) - value[index])
                error[index] = np.where(np.isinf(noise[index]), np.inf, left_out)
                unfinished[same_pattern] = left_out > _LEFT_OUT_SHARE * tolerance
            open_members = open_members[unfinished]
        return NoisyLogProbability(value, error, noise)

    @property
    def log_bound(self) -> Array:
        """Upper bounds of ln P(u ≥ 0) for w Gaussian vectors u: an array of shape (w,).

        Each bound is a smooth function of the mean of u. It is close to ln P(u ≥ 0) if this
        probability is small, and equal to it if u has a single element.
        """
        return self._tilted.log_bound

    def moments(self, size: int = 512, *, seed: int = 0) -> OrthantMoments:
        """Return mean and covariance of standard normal vectors e, given u = mean + spread @ e ≥ 0.

        The result also holds the log probability of the condition u ≥ 0.

        There are w vectors e of q elements. The moments describe the coordinates of e along the
        directions `axes`; perpendicular to these directions, e stays standard normal. The moments
        are weighted means over quasi-random points. The points for a vector are shifted by an
        amount that is computed from the constraints on this vector alone. Different vectors
        therefore use different points, so that errors average out over many vectors, and the result
        for a vector does not depend on the other vectors of the batch.

        Parameters
        ----------
        size
            Number of quasi-random points. It has no effect if there are only one or two directions
            `axes`; a quadrature rule is then used instead.
        seed
            Seed of the quasi-random points. It has an effect only if there are more than ten
            directions `axes`.
        """
        d = len(self._tilted.bound)
        if d <= 2:
            rule = _quadrature_rule(d)
            points = rule.points[..., None]
            log_rule_weight = rule.log_weight
        else:
            shift = _shift_of_points(self._tilted)
            points = _fold((_lattice_points(d, size, seed)[:, :, None] + shift) % 1.0)
            log_rule_weight = np.full(1, -np.log(size))
        log_weight, x = self._tilted.propose(points)
        largest = log_weight.max(axis=0)
        weight = np.exp(log_rule_weight[:, None] + log_weight - largest)
        total = weight.sum(axis=0)
        weight /= total
        mean = np.einsum("sw,dsw->wd", weight, x)
        centred = x.transpose(2, 1, 0) - mean[:, None, :]
        covariance = np.einsum("sw,wsd,wse->wde", weight, centred, centred)
        return OrthantMoments(mean, covariance, self.axes, largest + np.log(total))

    @property
    def axes(self) -> Array:
        """Orthonormal directions along which the constraints depend on e, shape (w, d, q).

        Each of w standard normal vectors e of q elements has the constraints u = mean + spread @ e
        ≥ 0. Constraints that are certain to hold for all w vectors are left out. The d coordinates
        of e along the directions are ``x = axes @ e``.
        """
        return self._solved.axes

    def draw_along_axes(
        self,
        rng: np.random.Generator,
        *,
        max_proposals: int = _MOST_PROPOSALS,
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return an exact random draw of ``x = axes @ e`` given u ≥ 0 for each of w vectors e.

        Each standard normal vector e has the constraints u = mean + spread @ e ≥ 0. x holds the d
        coordinates of e along the directions `axes`. A rejection sampler proposes x from a shifted
        (tilted) normal density.

        Parameters
        ----------
        rng
            Random number generator.
        max_proposals
            The search for an accepted proposal ends after about this number of proposals for each
            draw.

        Returns
        -------
        x
            Random draws, shape (w, d). If no proposal was accepted, a draw is zero or a rejected
            proposal.
        accepted
            Whether one of the proposals was accepted, shape (w,).
        """
        d, w = self._tilted.bound.shape
        x = np.zeros((d, w))
        # indices of the random vectors for which the rejection sampler has accepted no proposal yet
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
        """Draw e ~ N(0, I) under the constraints u = mean + spread @ e ≥ 0 by rejection sampling.

        The vector e has q elements. The method draws w such vectors, one for each vector u of this
        object. A draw is exact if the rejection sampler accepted one of its proposals.

        Returns
        -------
        e
            Random draws of e, shape (w, q).
        accepted
            Whether each draw is exact, shape (w,).
        """
        x, accepted = self.draw_along_axes(rng)
        normal = rng.standard_normal((len(x), self._spread.shape[2]))
        return self._complete(x, normal), accepted

    def propose_standard(
        self,
        uniform: Array,
        normal: Array,
    ) -> tuple[Array, Array]:
        """Return random draws of w vectors e from shifted densities, and their log weights.

        Each vector e has q elements. It is standard normal, but must satisfy the m constraints u =
        mean + spread @ e ≥ 0. They depend on e only along d directions (`axes`). Along these
        directions, e is drawn from a normal density that is shifted and truncated so that the
        constraints hold or are likely to hold (module `tilting`). The draws have the shape (w, q).
        The log importance weight of a draw is ln (density of e given u ≥ 0 / shifted density),
        without the constant ln P(u ≥ 0). It is −inf for a draw that violates a constraint. The log
        weights have the shape (w,).

        Parameters
        ----------
        uniform
            Uniform random numbers between 0 and 1, shape (w, m). The coordinates of e along `axes`
            are computed from the first d ≤ m numbers; the remaining numbers are not used.
        normal
            Standard normal random numbers, shape (w, q), from which the component of e
            perpendicular to `axes` is computed.
        """
        d = len(self._tilted.bound)
        log_weight, x = self._tilted.propose(uniform.T[:d, None])
        return self._complete(x[:, 0].T, normal), log_weight[0]

    def log_proposal_weight(self, e: Array) -> Array:
        """Return the log importance weights of w points e, shape (w,), one for each random vector.

        The point must satisfy the constraints u = mean + spread @ e ≥ 0. The log weight is the
        logarithm of a ratio of two densities at e. The first is the density of the standard normal
        vector e given u ≥ 0, without its constant factor 1 / P(u ≥ 0). The second is the shifted
        density from which `propose_standard` draws.

        Parameters
        ----------
        e
            One point e of q elements for each random vector, shape (w, q).
        """
        x = np.einsum("wiq,wq->iw", self.axes, e)
        return self._tilted.log_weight(x[:, None])[0]

    def _complete(self, x: Array, normal: Array) -> Array:
        """Return w vectors e of q elements that have the coordinates x along the directions `axes`.

        ``x``, shape (w, d), holds the coordinates along the d directions. Perpendicular to these
        directions, each vector e has the same component as the vector ``normal``, shape (w, q).
        """
        normal_along_axes = np.einsum("wiq,wq->wi", self.axes, normal)
        return normal + np.einsum("wiq,wi->wq", self.axes, x - normal_along_axes)

    def _sum_points(self, tolerance: float, points: _Points) -> tuple[Array, Array]:
        """Return ln P(u ≥ 0) and its error [nat], each of shape (w,), from quasi-random points.

        There is one probability for each of w Gaussian vectors u. The number of points is
        multiplied by four until the error is within ``tolerance`` [nat] or 65 536 points are used.
        """
        tilted = self._tilted
        value = tilted.log_bound.copy()
        error = np.zeros(len(self._mean))
        if len(tilted.bound) + len(tilted.dependent) > 1:
            error[:] = np.inf
        for size in _SIZES:
            open_members = np.flatnonzero(error > tolerance)
            chunks = -(-open_members.size * _SCRAMBLES * size // _CHUNK) or 1
            for index in np.array_split(open_members, chunks):
                selected = tilted.select(index)
                uniform = points.for_constraints(selected, size)
                proposal = selected.propose(uniform, draw_last=False)
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
        """Constraints that may fail, and shifted densities from which random vectors are drawn.

        The constraints are u = mean + spread @ e ≥ 0 on w standard normal vectors e.
        """
        return self._solved.tilted

    @cached_property
    def _solved(self) -> _Solved:
        """Constraints on w random vectors, and shifted densities from which the vectors are drawn.

        Constraints that are certain to hold for all w vectors are left out.
        """
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
        # ``core`` holds the indices of linearly independent constraints; all other constraints are
        # linear combinations of them. Let x be the coordinates of the standard normal vector along
        # the directions ``axes``. The other constraints are converted to constraints on x. The
        # coefficients of x in a constraint are scaled so that their squares sum to one.
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
    """Return the error of the mean importance weight of each of w probabilities, shape (w,).

    ``weight`` holds the weights of all quasi-random points, shape (scrambles, points, w). Each
    scramble (a randomly shifted copy of the points) gives one estimate: the mean of its weights.
    The error is the standard error of the mean of the eight independent estimates, multiplied by a
    factor from Student's t, because there are only eight of them. The error is at least a tenth of
    the standard error that the same number of independent random points would give.
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


def _bound_by_pairs(
    distance: Array,
    tail: Array,
    unit: Array,
) -> tuple[Array, Array]:
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
    distance: Array,
    tight_distance: Array,
    correlation: Array,
) -> Array:
    """Return the probability P(u_j < 0 ≤ u_i) of two Gaussian variables u_i and u_j.

    ``distance`` is the mean of u_j divided by its sd, ``tight_distance`` is the mean of u_i divided
    by its sd, and ``correlation`` is the correlation of u_i and u_j. All three are arrays of shape
    (w,), with one element for each of w pairs of variables. The result is 1 if the correlation is
    too close to ±1 to compute the probability.
    """
    probability = _pair_probability(-distance, tight_distance, -correlation)
    return np.where(np.abs(correlation) < 1.0 - _LEAST_DIFFERENCE, probability, 1.0)


def _pair_probability(
    h: Array,
    k: Array,
    rho: Array,
) -> Array:
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


@cache
def _scrambled_lattice(dimensions: int, size: int, seed: int) -> Array:
    """Return shifted lattices of quasi-random points, shape (dimensions, scrambles, size).

    Each of the eight scrambles is a copy of the same lattice of ``size`` points, shifted by a
    random vector. The coordinates are not yet reduced modulo 1. ``seed`` is the seed of the random
    vectors.
    """
    rng = np.random.default_rng([seed, size])
    shifts = rng.random((_SCRAMBLES, max(dimensions, _SHIFT_DIMENSIONS)))
    shift = shifts[:, :dimensions].T
    return np.asarray(_lattice_points(dimensions, size, seed)[:, None] + shift[:, :, None])


def _shift_of_points(tilted: Tilted) -> Array:
    """Return the shifts of the quasi-random points for w sets of constraints, shape (d, 1, w).

    The points are shifted so that different sets of constraints use different points. ``tilted``
    holds the constraints. Each set has d constraints on a standard normal vector. The shift for a
    set is computed from the lower bounds of its constraints alone.
    """
    return np.asarray(tilted.bound[:, None] * _DIGITS)


def _fold(points: Array) -> Array:
    """Return the baker's transformation 1 − |2x − 1| of numbers x between 0 and 1.

    ``points`` holds the numbers x, which are the coordinates of points of a lattice. The
    transformation makes the integrand periodic in x, so that its mean over the lattice is more
    accurate.
    """
    return 1.0 - np.abs(2.0 * points - 1.0)


def _lattice_points(
    dimensions: int,
    size: int,
    seed: int,
) -> Array:
    """Return a lattice of quasi-random points, shape (dimensions, size).

    The coordinates are not yet reduced modulo 1. Point k has the coordinates k g / size, with an
    integer g for each dimension. The integers of the first ten dimensions are fixed; those of
    further dimensions are random numbers from ``seed``.
    """
    rng = np.random.default_rng([seed, 1])
    generators = list(_LATTICE)
    while len(generators) < dimensions:
        generators.append(2 * int(rng.integers(1 << 18)) + 1)
    generator = np.array(generators[:dimensions], dtype=float)
    return np.arange(size) * generator[:, None] / size


class _Rule(NamedTuple):
    """Quadrature rule of n points in the unit cube.

    ``points`` holds the coordinates of the points, shape (dimensions, n), and ``log_weight`` the
    logarithms of their weights, shape (n,).
    """

    points: Array
    log_weight: Array


@cache
def _quadrature_rule(dimensions: int) -> _Rule:
    """Return a quadrature rule for the unit cube in one or two dimensions.

    In each dimension, the rule is the Gauss-Legendre rule for a variable s in [0, 1], with the
    substitution u = s³ (10 − 15 s + 6 s²). The points u are dense near 0 and 1, where the integrand
    changes most.
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


def _core_rows(
    mean: Array,
    spread: Array,
) -> NDArray[np.intp]:
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
    """Return the indices of linearly independent constraints on one vector, the tightest first.

    There are m constraints on a standard normal vector e of q elements. At the most probable e that
    satisfies all constraints, some constraints hold with equality; these are chosen first. Further
    constraints are then added one by one until there are ``rank`` constraints. The next constraint
    is always the one whose row has the longest component perpendicular to the rows of all
    constraints chosen before. The result is sorted by increasing ``distance``.

    Parameters
    ----------
    distance
        Mean of each constrained variable divided by its sd, shape (m,). The ratio is smallest for
        the tightest constraint.
    unit
        Rows of coefficients of the constraints, scaled to length one, shape (m, q).
    rank
        Number of linearly independent constraints.
    """
    multipliers = np.zeros(len(unit))
    if (distance < 0.0).any():
        multipliers = least_distance_multipliers(unit, -distance)
    chosen: list[int] = []
    remainder = unit.copy()
    while len(chosen) < rank:
        size = np.linalg.norm(remainder, axis=1)
        priority = np.where(multipliers > 0.0, 2.0 + multipliers, size)
        row = int(np.argmax(np.where(size > _DEPENDENT, priority, -1.0)))
        chosen.append(row)
        multipliers[row] = 0.0
        along = remainder @ remainder[row]
        remainder = remainder - np.outer(along, remainder[row]) / size[row] ** 2
        remainder[row] = 0.0
    return sorted(chosen, key=lambda row: float(distance[row]))
