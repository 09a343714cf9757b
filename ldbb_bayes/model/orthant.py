"""Probabilities P(u ≥ 0) of Gaussian vectors u, and exact random draws of u given u ≥ 0.

Each element u_j, such as a compliance, has the constraint u_j ≥ 0. The region u ≥ 0 is called the
orthant. Small probabilities and random draws are computed by minimax tilting, that is, by sampling
from a shifted density (`tilting`). Most probabilities are computed without sampling, from lower and
upper bounds that are close to each other (`orthant_bounds`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from ldbb_bayes.model.constraint_rows import DEPENDENT, core_rows, uncertain_rows
from ldbb_bayes.model.orthant_bounds import bound_in_closed_form
from ldbb_bayes.model.quasi_random_points import (
    SCRAMBLES,
    folded,
    lattice_points,
    quadrature_rule,
    scrambled_lattice,
)
from ldbb_bayes.model.tilting import ROUNDING, Tilted, find_saddle_point
from ldbb_bayes.model.triangular import solve_lower
from ldbb_bayes.results import Array

__all__ = ["NoisyLogProbability", "Orthant", "OrthantMoments"]

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
# Seed of the quasi-random points for moments. It has an effect only in more than ten dimensions.
_MOMENTS_SEED = 0


class OrthantMoments(NamedTuple):
    """Means and covariances of w truncated normal vectors e.

    Each vector e has q elements. It is standard normal, under the condition that all m elements of
    the vector u = mean + spread @ e are at least zero. u depends only on the d coordinates of e
    along the orthonormal directions ``axes``. The means and covariances are those of these
    coordinates.
    """

    #: Means of the coordinates, shape (w, d).
    mean: Array
    #: Covariances of the coordinates, shape (w, d, d).
    covariance: Array
    #: Orthonormal directions, shape (w, d, q).
    axes: Array
    #: Log probabilities ln P(u ≥ 0), shape (w,).
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
        points = scrambled_lattice(dimensions, size, self.seed).reshape(dimensions, -1, 1)
        if not self.shared:
            points = points + _shift_of_points(tilted)[:dimensions]
        return folded(points % 1.0)


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
        """Store means and square roots of the covariances."""
        self._mean = mean
        self._spread = spread

    def log_probability(self, tolerance: float = 1e-3, *, seed: int = 0) -> tuple[Array, Array]:
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
        self, tolerance: float, largest_noise: float, *, seed: int = 0
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
        value, error = bound_in_closed_form(distance, self._spread)
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

    def moments(self, size: int = 512) -> OrthantMoments:
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
        """
        d = len(self._tilted.bound)
        if d <= 2:
            rule = quadrature_rule(d)
            points = rule.points[..., None]
            log_rule_weight = rule.log_weight
        else:
            shift = _shift_of_points(self._tilted)
            points = folded((lattice_points(d, size, _MOMENTS_SEED)[:, :, None] + shift) % 1.0)
            log_rule_weight = np.full(1, -np.log(size))
        log_weight, x = self._tilted.propose(points)
        largest = log_weight.max(axis=0)
        weight = np.exp(log_rule_weight[:, None] + log_weight - largest)
        total = weight.sum(axis=0)
        weight /= total
        mean = np.einsum("sw,dsw->wd", weight, x)
        centred = x.transpose(2, 1, 0) - mean[:, None, :]
        weighted = weight.T[:, :, None] * centred
        covariance = np.swapaxes(weighted, 1, 2) @ centred
        return OrthantMoments(mean, covariance, self.axes, largest + np.log(total))

    @property
    def axes(self) -> Array:
        """Orthonormal directions along which the constraints depend on e, shape (w, d, q).

        Each of w standard normal vectors e of q elements has the constraints u = mean + spread @ e
        ≥ 0. Constraints that are certain to hold for all w vectors are left out. The d coordinates
        of e along the directions are ``x = axes @ e``.
        """
        return self._solved.axes

    def draw_along_axes(self, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
        """Return an exact random draw of ``x = axes @ e`` given u ≥ 0 for each of w vectors e.

        Each standard normal vector e has the constraints u = mean + spread @ e ≥ 0. x holds the d
        coordinates of e along the directions `axes`. A rejection sampler proposes x from a shifted
        (tilted) normal density.

        Parameters
        ----------
        rng
            Random number generator.

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
        while proposals < _MOST_PROPOSALS and open_members.size:
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

    def draw_standard(self, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
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

    def propose_standard(self, uniform: Array, normal: Array) -> tuple[Array, Array]:
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
            chunks = -(-open_members.size * SCRAMBLES * size // _CHUNK) or 1
            for index in np.array_split(open_members, chunks):
                selected = tilted.select(index)
                uniform = points.for_constraints(selected, size)
                proposal = selected.propose(uniform, draw_last=False)
                log_weight = proposal.log_weight.reshape(SCRAMBLES, size, -1)
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
        """Constraints that may fail, and shifted densities from which random vectors are drawn."""
        return self._solved.tilted

    @cached_property
    def _solved(self) -> _Solved:
        """Constraints on w random vectors, and shifted densities from which the vectors are drawn.

        Constraints that are certain to hold for all w vectors are left out.
        """
        rows = uncertain_rows(self._mean, self._spread)
        mean = self._mean[:, rows]
        spread = self._spread[:, rows]
        core = core_rows(mean, spread)
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
        depends = np.abs(dependent) > DEPENDENT
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
    scatter = weight.mean(axis=1).std(axis=0, ddof=1) / np.sqrt(SCRAMBLES)
    points = weight.shape[0] * weight.shape[1]
    random_error = weight.std(axis=(0, 1)) / np.sqrt(points)
    return np.maximum(_STUDENT * scatter, _LEAST_ERROR_SHARE * random_error)


def _shift_of_points(tilted: Tilted) -> Array:
    """Return the shifts of the quasi-random points for w sets of constraints, shape (d, 1, w).

    The points are shifted so that different sets of constraints use different points. ``tilted``
    holds the constraints. Each set has d constraints on a standard normal vector. The shift for a
    set is computed from the lower bounds of its constraints alone.
    """
    return np.asarray(tilted.bound[:, None] * _DIGITS)
