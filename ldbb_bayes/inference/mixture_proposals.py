"""Mixtures of split Student-t distributions, fitted to weighted points for importance sampling.

A proposal is the density from which points are drawn. A split t is a Student-t distribution with
different scales and degrees of freedom on its two sides (Geweke, Econometrica 57, 1317-1339, 1989).
A component of a mixture in h dimensions is a product of h split t distributions, each along its own
direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.special import gammaln, ndtr, ndtri, stdtrit

from ldbb_bayes.inference.coordinate_dependence import Dependence, IndependentPoints, fit_dependence
from ldbb_bayes.results import Array

__all__ = ["Mixture", "Random", "SplitT", "fit_split_t", "refit_mixture"]

# Types of random number generators of NumPy that are accepted: the present Generator, and the older
# RandomState, which the sampler emcee uses.
Random = np.random.Generator | np.random.RandomState

# Degrees of freedom that are tried when a Student-t distribution is fitted to points. The values
# that give the heaviest tails come first.
_FREEDOMS = np.array([3.0, 5.0, 9.0, 20.0])
# Up to this number of dimensions, Student-t distributions with light tails (many degrees of
# freedom) are not fitted. They would improve the fit little, and too few points would be drawn in
# the tails of the density to be integrated.
_FEW_DIMENSIONS = 5
# When a Student-t distribution is fitted, several degrees of freedom from the list ``_FREEDOMS``
# are tried. In at most ``_FEW_DIMENSIONS`` dimensions, only the first ``_HEAVY_TAILS`` of them are
# tried, which give the heaviest tails. In more dimensions, all are tried.
_HEAVY_TAILS = 2
# Degrees of freedom from which the fit of a Student-t distribution starts.
_FIRST_FREEDOM = 9.0
# Values of the coordinate z (see `SplitT`) at which the two sides of a split Student-t distribution
# may meet. All these values are tried when the distribution is fitted.
_OFFSETS = np.linspace(-0.4, 0.4, 9)
# When a split Student-t distribution is fitted, its scales and its degrees of freedom are fitted in
# turn, ``_ALTERNATIONS`` times. Each time, the scales are fitted by ``_EM_STEPS``
# expectation-maximisation steps.
_ALTERNATIONS = 2
_EM_STEPS = 3
# Smallest and largest scale (width) of a split Student-t distribution that is fitted, in units of
# the coordinate z of `SplitT`.
_SMALLEST_SCALE = 0.05
_LARGEST_SCALE = 20.0
# Smallest probability for which a quantile of a Student-t distribution is computed.
_LEAST_LEVEL = 1e-15
# Quantiles of a Student-t distribution are interpolated between their values at normal quantiles
# from ``_LOWEST_NORMAL`` to zero. ``_QUANTILE_KNOTS`` is the number of these values. The relative
# error of an interpolated quantile is below 1e-10.
_LOWEST_NORMAL = -8.1
_QUANTILE_KNOTS = 2049
# A proposal (the density from which points are drawn) is widened by this factor after it has been
# fitted to points. For importance sampling, a proposal that is too narrow is worse than one that is
# too wide.
_WIDER = 1.05
# Largest number of weighted points to which the tails of a proposal (the density from which points
# are drawn) are fitted. If there are more points, this number of points is picked in proportion to
# the weights.
_FITTED_POINTS = 1024
# Smallest share of a component in a mixture. The weights of the points are divided among the
# components. A component that receives less than this value in total is not fitted to the points
# again, and its share is set to this value.
_SMALLEST_SHARE = 0.02


@dataclass(frozen=True, eq=False)
class SplitT:
    """Distribution of ``x = centre + root @ z``, where the h elements of z are split Student-t.

    A split Student-t distribution has different scales and degrees of freedom on its two sides. Its
    density is continuous, because the two sides have the same height at z = 0. The elements of z
    are independent if ``dependence`` is None. Otherwise the mean and the width of an element depend
    on elements with a smaller index (`coordinate_dependence`). The columns of the matrix ``root``
    are the directions of the elements of z in the space of x.
    """

    #: point x at which the two sides of a split Student-t distribution meet in each of h
    #: directions, shape (h,)
    centre: Array
    #: matrix, shape (h, h), that converts coordinates z along h directions to a point
    #: ``x = centre + root @ z``; its columns are the directions of h split Student-t distributions
    root: Array
    #: scales (widths) of h split Student-t distributions, one for each coordinate, shape (2, h).
    #: The first row is for negative values of the coordinate, the second row for positive values.
    scale: Array
    #: degrees of freedom of h split Student-t distributions, one for each coordinate, shape (2, h).
    #: The first row is for negative values of the coordinate, the second row for positive values.
    freedom: Array
    #: how the mean and the width of an element of the random vector z depend on elements with a
    #: smaller index; None if the elements are independent
    dependence: Dependence | None = None

    def log_density(self, points: Array) -> Array:
        """Return the log density of the split Student-t distributions at n points, shape (n,).

        ``points``, shape (n, h), holds the points x in h dimensions.
        """
        return self.log_density_at(self.coordinates(points))

    def coordinates(self, points: Array) -> IndependentPoints:
        """Return the nearly independent coordinates of n points x along the h directions.

        ``points``, shape (n, h), holds the points. Along each coordinate, their distribution is a
        split Student-t.
        """
        z = np.linalg.solve(self.root, (points - self.centre).T).T
        if self.dependence is None:
            return IndependentPoints(z, np.zeros(len(z)))
        return self.dependence.remove(z)

    def has_coordinates_of(self, other: SplitT) -> bool:
        """Return whether this distribution differs from another in scales and freedoms only.

        The coordinates of a point (`coordinates`) are then the same for both distributions.
        """
        return (
            self.centre is other.centre
            and self.root is other.root
            and self.dependence is other.dependence
        )

    def log_density_at(self, coordinates: IndependentPoints) -> Array:
        """Return the log density of the distribution at n points, shape (n,).

        ``coordinates`` are those of the points, as the method `coordinates` returns them.
        """
        z = coordinates.points
        above = z > 0.0
        scale = np.where(above, self.scale[1], self.scale[0])
        freedom = np.where(above, self.freedom[1], self.freedom[0])
        tails = _log_tail(z**2, scale, freedom).sum(axis=1)
        log_mass = np.log(_side_masses(self.scale, self.freedom).sum(axis=0)).sum()
        log_volume = np.linalg.slogdet(self.root)[1] + coordinates.log_width
        return np.asarray(-log_mass - tails - log_volume)

    def transform(self, uniform: Array) -> Array:
        """Return n random points x of the distribution, shape (n, h), from uniform random numbers.

        ``uniform``, shape (n, h), holds independent random numbers between 0 and 1: one for each of
        the h directions of each point.
        """
        masses = _side_masses(self.scale, self.freedom)
        side_probability = masses / masses.sum(axis=0)
        below = uniform < side_probability[0]
        # Each side of a split Student-t distribution is one half of an ordinary Student-t
        # distribution.
        probability_within_side = np.where(
            below, uniform / side_probability[0], (1.0 - uniform) / side_probability[1]
        )
        signed_scale = np.where(below, self.scale[0], -self.scale[1])
        freedom = np.where(below, self.freedom[0], self.freedom[1])
        z = signed_scale * _lower_quantiles(freedom, probability_within_side / 2.0)
        if self.dependence is not None:
            z = self.dependence.restore(z)
        return np.asarray(self.centre + z @ self.root.T)


def _lower_quantiles(freedom: Array, level: Array) -> Array:
    """Return quantiles of Student-t distributions for probabilities from 0 to 0.5.

    ``freedom`` holds the degrees of freedom, and ``level`` the probabilities; both have the shape
    of the result. Quantiles of probabilities below 1e-15 are replaced by the quantile of 1e-15.
    """
    normal = ndtri(np.clip(level, _LEAST_LEVEL, 0.5))
    quantiles = np.empty(normal.shape)
    for value in np.unique(freedom):
        chosen = freedom == value
        quantiles[chosen] = _lower_quantile_of_normal(float(value))(normal[chosen])
    return quantiles


@cache
def _lower_quantile_of_normal(freedom: float) -> CubicHermiteSpline:
    """Return a spline that converts normal quantiles to quantiles of a Student-t distribution.

    Both quantiles belong to the same probability, from 1e-15 to 0.5. The spline has the exact
    values and derivatives at its knots and takes a quarter of the time of SciPy's function
    ``stdtrit``. ``freedom`` is the number of degrees of freedom.
    """
    normal = np.linspace(_LOWEST_NORMAL, 0.0, _QUANTILE_KNOTS)
    quantile = stdtrit(freedom, ndtr(normal))
    log_normal = -0.5 * normal**2 - 0.5 * np.log(2.0 * np.pi)
    log_mass = np.log(2.0 * _side_masses(np.ones(1), np.array([freedom])))
    log_student = -_log_tail(quantile**2, np.ones(1), freedom) - log_mass
    return CubicHermiteSpline(normal, quantile, np.exp(log_normal - log_student))


def _side_masses(scale: Array, freedom: Array) -> Array:
    """Return the integral of each side of a split Student-t density that is one at z = 0.

    The density is not normalised. The integral is ∫ (1 + z²/(freedom scale²))^(−(freedom + 1)/2) dz
    over the values of the coordinate z on one side of 0. ``freedom`` holds the degrees of freedom.
    ``scale``, ``freedom`` and the result have the same shape, usually (2, h) for the two sides
    along each of h directions.
    """
    log_height = gammaln(freedom / 2.0) - gammaln((freedom + 1.0) / 2.0)
    return np.asarray(0.5 * scale * np.sqrt(freedom * np.pi) * np.exp(log_height))


def _log_tail(square: Array, scale: Array, freedom: Array | float) -> Array:
    """Return −ln of an unnormalised Student-t density, which is 1 at z = 0, shape (n, h).

    ``square``, shape (n, h), holds z² for n points along h directions. ``scale`` holds the scales
    of the density, and ``freedom`` its degrees of freedom: one for each direction, shape (h,), or
    one for each point and direction, shape (n, h). ``freedom`` may also be one number.
    """
    return np.asarray(0.5 * (freedom + 1.0) * np.log1p(square / (freedom * scale**2)))


@dataclass(frozen=True, eq=False)
class Mixture:
    """Mixture of k components, each a product of split Student-t distributions (`SplitT`)."""

    components: tuple[SplitT, ...]  #: the k component distributions of a mixture
    share: Array  #: probabilities of the k components of a mixture, shape (k,); they sum to one

    def log_density(self, points: Array) -> Array:
        """Return the log density of the mixture at n points in h dimensions, shape (n,).

        ``points``, shape (n, h), holds the points.
        """
        return np.asarray(np.logaddexp.reduce(self.by_component(points), axis=0))

    def by_component(self, points: Array) -> Array:
        """Return ln (share · density) of the k components of a mixture at n points, shape (k, n).

        ``points``, shape (n, h), holds the points in h dimensions. The share of a component is the
        probability that a point drawn from the mixture comes from this component.
        """
        rows = []
        coordinates: list[IndependentPoints] = []
        for k, component in enumerate(self.components):
            earlier = _first_alike(component, self.components[:k])
            if earlier is None:
                coordinates.append(component.coordinates(points))
            else:
                coordinates.append(coordinates[earlier])
            rows.append(np.log(self.share[k]) + component.log_density_at(coordinates[k]))
        return np.stack(rows)

    def transform(self, uniform: Array) -> Array:
        """Return n random points of the mixture in h dimensions, shape (n, h).

        The points are made from ``uniform``, shape (n, h + 1), which holds independent random
        numbers between 0 and 1. The first number of each row picks the component from which the
        point comes.
        """
        limits = np.cumsum(self.share)[:-1]
        picked = np.searchsorted(limits, uniform[:, 0], side="right")
        points = np.empty((len(uniform), uniform.shape[1] - 1))
        for k, component in enumerate(self.components):
            points[picked == k] = component.transform(uniform[picked == k, 1:])
        return points

    def draw(self, size: int, rng: Random, *, temperature: float = 1.0) -> Array:
        """Return ``size`` random draws from the mixture in h dimensions, shape (size, h).

        The scales (widths) of the components are first multiplied by the square root of
        ``temperature``. ``rng`` generates the random numbers.
        """
        h = len(self.components[0].centre)
        return self.widen(np.sqrt(temperature)).transform(rng.uniform(size=(size, h + 1)))

    def draw_with_log_density(self, size: int, rng: Random) -> tuple[Array, Array]:
        """Return ``size`` random draws of the mixture, and its log density at each of them.

        The draws have the shape (size, h), and the log densities the shape (size,). ``rng``
        generates the random numbers.
        """
        points = self.draw(size, rng)
        return points, self.log_density(points)

    def widen(self, factor: float) -> Mixture:
        """Return the mixture with the widths of all its components multiplied by a factor."""
        wider = [replace(one, scale=factor * one.scale) for one in self.components]
        return Mixture(tuple(wider), self.share)


def _first_alike(component: SplitT, others: Sequence[SplitT]) -> int | None:
    """Return the index of the first of several distributions that has the same coordinates.

    The index is None if the coordinates of ``component`` differ from those of all ``others``.
    """
    for k, other in enumerate(others):
        if component.has_coordinates_of(other):
            return k
    return None


def refit_mixture(proposal: Mixture, points: Array, weight: Array) -> Mixture:
    """Return a mixture with each component of ``proposal`` refitted to weighted points.

    ``proposal`` is the mixture before the fit. ``points``, shape (n, h), holds n points in h
    dimensions; ``weight``, shape (n,), holds their weights, which sum to one. The weight of each
    point is divided among the components. The part that a component receives is proportional to its
    share in the mixture times its density at the point. The new share of a component is the total
    weight that it receives, but at least 2 %. The shares are then scaled to sum to one. A component
    that receives at most 2 % is not refitted.
    """
    by_component = proposal.by_component(points)
    weights = weight * np.exp(by_component - np.logaddexp.reduce(by_component, axis=0))
    mass = weights.sum(axis=1)
    components = []
    for k, component in enumerate(proposal.components):
        if mass[k] > _SMALLEST_SHARE:
            component = _refit_component(component, points, weights[k] / mass[k])
        components.append(component)
    share = np.maximum(mass, _SMALLEST_SHARE)
    return Mixture(tuple(components), share / share.sum())


def _refit_component(component: SplitT, points: Array, weight: Array) -> SplitT:
    """Return a component of a mixture after a new fit to weighted points.

    ``component`` is the component before the fit. Its mean, its covariance and its tails are fitted
    anew. The fit is made in the coordinates z of this component (see `SplitT`). ``points``, shape
    (n, h), holds n points in h dimensions; ``weight``, shape (n,), holds their weights, which sum
    to one.
    """
    z = np.linalg.solve(component.root, (points - component.centre).T).T
    ess = 1.0 / (weight**2).sum()
    mean = weight @ z
    centred = z - mean
    covariance = (centred.T * weight) @ centred
    sd = np.sqrt(np.diag(covariance))
    correlation = _shrink_correlation(covariance / np.outer(sd, sd), ess)
    values, vectors = np.linalg.eigh(correlation)
    standard = centred / sd @ (vectors / np.sqrt(values)) @ vectors.T
    spread = np.sqrt(weight @ standard**2)
    standard = standard / spread
    root = (component.root * sd) @ (vectors * np.sqrt(values)) @ vectors.T * spread
    centre = component.centre + component.root @ mean
    dependence = fit_dependence(standard, weight)
    standard = dependence.remove(standard).points
    if len(points) > _FITTED_POINTS:
        levels = np.linspace(0.0, 1.0, _FITTED_POINTS, endpoint=False) + 0.5 / _FITTED_POINTS
        picked = np.minimum(np.searchsorted(np.cumsum(weight), levels), len(weight) - 1)
        standard = standard[picked]
        weight = np.full(_FITTED_POINTS, 1.0 / _FITTED_POINTS)
    h = len(centre)
    fitted = fit_split_t(
        np.zeros(h), np.eye(h), standard, np.broadcast_to(weight[:, None], standard.shape)
    )
    dependence = replace(dependence, offset=fitted.centre)
    return SplitT(centre, root, fitted.scale, fitted.freedom, dependence)


def _shrink_correlation(correlation: Array, ess: float) -> Array:
    """Return a correlation matrix of h variables, shrunk towards zero, shape (h, h).

    The coefficients of ``correlation``, shape (h, h), were computed from about ``ess`` independent
    points, and therefore scatter by 1 / √ess. All of them are multiplied by one minus s, where s is
    the share of their sum of squares that is due to this scatter. On average, this factor brings
    the coefficients closest to their true values (Schäfer and Strimmer, Statistical Applications in
    Genetics and Molecular Biology 4 (2005) 32). With few effective points in many dimensions, the
    coefficients become almost zero, which is much better than keeping correlations that arose by
    chance.
    """
    h = len(correlation)
    sum_of_squares = (correlation**2).sum() - h
    by_chance = h * (h - 1.0) / ess
    if sum_of_squares <= by_chance:
        return np.eye(h)
    share = by_chance / sum_of_squares
    return (1.0 - share) * correlation + share * np.eye(h)


class _AxisFit(NamedTuple):
    """Split Student-t distributions fitted to points along each of h directions."""

    #: coordinate along each of h directions at which the two sides of a split Student-t
    #: distribution meet, shape (h,)
    offset: Array
    #: scales (widths) of a split Student-t distribution along each of h directions, shape (2, h);
    #: the first row is for coordinates below ``offset``, the second row for coordinates above
    #: ``offset``
    scale: Array
    #: degrees of freedom of a split Student-t distribution along each of h directions, shape (2,
    #: h); the first row is for coordinates below ``offset``, the second row for coordinates above
    #: ``offset``
    freedom: Array
    #: log of the split Student-t density along each of h directions, averaged over the weighted
    #: points to which the density was fitted, shape (h,)
    log_likelihood: Array


def fit_split_t(centre: Array, root: Array, z: Array, weight: Array) -> SplitT:
    """Fit a split Student-t distribution along each of h directions, then widen it slightly.

    A split Student-t has different scales and degrees of freedom on its two sides. The distribution
    is fitted by maximum likelihood. Scales are found by expectation-maximisation (EM) steps.
    Degrees of freedom, and the coordinate at which the two sides meet, are picked from a few
    values. The fitted scales are then multiplied by a factor, and the distribution is returned.

    Parameters
    ----------
    centre, root : ndarray, shapes (h,) and (h, h)
        The transformation ``x = centre + root @ z`` from the coordinates z along h directions to
        the coordinates x in which the density is given.
    z, weight : ndarray, shape (n, h)
        Coordinates of n points along each of the h directions, and weights of these coordinates.
        The n weights of each direction sum to one.
    """
    h = z.shape[1]
    freedoms = _FREEDOMS
    if h <= _FEW_DIMENSIONS:
        freedoms = _FREEDOMS[:_HEAVY_TAILS]
    best = _AxisFit(
        offset=np.zeros(h),
        scale=np.ones((2, h)),
        freedom=np.ones((2, h)),
        log_likelihood=np.full(h, -np.inf),
    )
    for offset in _OFFSETS:
        candidate = _fit_about(float(offset), z, weight, freedoms)
        is_better = candidate.log_likelihood > best.log_likelihood
        best = _AxisFit(
            offset=np.where(is_better, candidate.offset, best.offset),
            scale=np.where(is_better, candidate.scale, best.scale),
            freedom=np.where(is_better, candidate.freedom, best.freedom),
            log_likelihood=np.where(is_better, candidate.log_likelihood, best.log_likelihood),
        )
    return SplitT(centre + root @ best.offset, root, _WIDER * best.scale, best.freedom)


def _fit_about(offset: float, z: Array, weight: Array, freedoms: Array) -> _AxisFit:
    """Fit a split Student-t distribution along each of h directions.

    A split Student-t has different scales and degrees of freedom below and above the coordinate
    ``offset``. The distribution is fitted to n points. ``z``, shape (n, h), holds their coordinates
    along each direction. ``weight``, shape (n, h), holds their weights, which sum to one for each
    direction. ``freedoms`` holds the degrees of freedom that are tried for each side. The fit
    alternates between the scales and the degrees of freedom.
    """
    h = z.shape[1]
    square = (z - offset) ** 2
    above = z > offset
    side_weights = np.stack([np.where(above, 0.0, weight), np.where(above, weight, 0.0)])
    scale = np.ones((2, h))
    freedom = np.full((2, h), _FIRST_FREEDOM)
    for _ in range(_ALTERNATIONS):
        scale = _fit_scale(square, side_weights, scale, freedom)
        for side in (0, 1):
            freedom[side] = _best_freedom(side, square, side_weights, scale, freedom, freedoms)
    tails = np.zeros(h)
    for side in (0, 1):
        log_tail = _log_tail(square, scale[side], freedom[side])
        tails = tails + (side_weights[side] * log_tail).sum(axis=0)
    # The fitted density is f / ∫ f. The function f is one at ``offset``, and has different scales
    # below and above ``offset``; ∫ f is the sum of the integrals below and above. The mean log
    # likelihood is −``tails`` − ln ∫ f, where ``tails`` is the weighted mean of −ln f over the
    # points.
    log_likelihood = -np.log(_side_masses(scale, freedom).sum(axis=0)) - tails
    return _AxisFit(np.full(h, offset), scale, freedom, log_likelihood)


def _fit_scale(square: Array, side_weights: Array, scale: Array, freedom: Array) -> Array:
    """Return scales of split Student-t distributions, shape (2, h), after a few fitting steps.

    The expectation-maximisation steps start from ``scale``, shape (2, h): the scales of the lower
    and of the upper side along each of h directions. The degrees of freedom stay at ``freedom``,
    shape (2, h). ``square``, shape (n, h), holds the squared distances of n points from the
    coordinate at which the two sides meet. ``side_weights``, shape (2, n, h), holds the weights of
    the points on the lower and on the upper side, zero for points on the other side.
    """
    for _ in range(_EM_STEPS):
        pull = (freedom[:, None] + 1.0) / (freedom[:, None] + square / scale[:, None] ** 2)
        moment = (side_weights * pull * square).sum(axis=1)
        masses = _side_masses(scale, freedom)
        cube = masses.sum(axis=0) * scale / masses * moment
        scale = np.clip(np.cbrt(cube), _SMALLEST_SCALE, _LARGEST_SCALE)
    return scale


def _best_freedom(
    side: int, square: Array, side_weights: Array, scale: Array, freedom: Array, freedoms: Array
) -> Array:
    """Return the most likely degrees of freedom for one side of split Student-t distributions.

    The result has the shape (h,), for one distribution along each of h directions. ``side`` is 0
    for the lower and 1 for the upper side. ``freedoms`` holds the degrees of freedom that are
    tried. ``scale`` and ``freedom`` are the present scales and degrees of freedom of both sides,
    shape (2, h). The distributions are fitted to n points. ``square``, shape (n, h), holds the
    squared distances of the points from the coordinate at which the two sides meet.
    ``side_weights``, shape (2, n, h), holds the weights of the points on the lower and on the upper
    side, zero for points on the other side.
    """
    other_mass = _side_masses(scale, freedom)[1 - side]
    costs = []
    for candidate in freedoms:
        log_tail = _log_tail(square, scale[side], candidate)
        tail = (side_weights[side] * log_tail).sum(axis=0)
        costs.append(np.log(_side_masses(scale[side], candidate) + other_mass) + tail)
    return np.asarray(freedoms[np.argmin(costs, axis=0)])
