"""Proposal density whose mean and width along a coordinate depend on other coordinates.

A proposal is the density from which points are drawn. The points are values of the
hyper-parameters, such as the standard deviation of the noise. If a scale that is common to all
circles is near zero, the readings determine the other scales less well, and the densities of the
other scales are wider. A correlation cannot express such a change of width. In the proposal, mean
and width of a coordinate therefore depend on other coordinates. Let u be the h coordinates of a
point, chosen so that they are not correlated with each other. The mean m and the log width ln s of
coordinate u_i are sums of polynomials of degree two, one for each earlier coordinate u_j (j < i)
that is among the first k coordinates; k is at most seven. Then

    z = (u − m) / s − offset

are coordinates that are nearly independent, with a constant ``offset`` for each coordinate. The
matrix of the derivatives ∂z/∂u is triangular. Its determinant is the product of all 1 / s.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ldbb_bayes.results import Array

__all__ = ["Dependence", "IndependentPoints", "fit_dependence"]

# The mean and the width of a fitted density along a coordinate may depend on the first k
# coordinates only; this number is the largest k. The first coordinates are those of the
# hyper-parameters that are common to all circles, of which there are at most seven.
_LEADING = 7
# Largest absolute value of a coordinate at which the polynomials are evaluated. Coordinates beyond
# this limit are replaced by the limit, so that the polynomials are not extrapolated. The
# coordinates have the standard deviation one.
_FARTHEST = 5.0
# Largest absolute value of the logarithm of a density's width along a coordinate. The logarithm is
# fitted as a function of other coordinates. Fitted values beyond ± this limit are set to the limit,
# because a fit with such large values cannot be trusted.
_LARGEST_LOG_WIDTH = 1.0
# A coefficient of a polynomial is set to zero unless its absolute value exceeds this number of
# standard errors. The polynomials describe how the mean and the logarithm of the width of a
# coordinate depend on other coordinates.
_SIGNIFICANT = 3.0
# The widths of a density along its coordinates are fitted by this number of steps of Fisher's
# method of scoring.
_STEPS = 4


class IndependentPoints(NamedTuple):
    """Points (values of the hyper-parameters) in coordinates z that are nearly independent."""

    #: coordinates z of n points, shape (n, h). The h coordinates of a point are nearly independent
    #: of each other.
    points: Array
    #: sum of the logarithms of a density's widths along its h coordinates, at each of n points,
    #: shape (n,)
    log_width: Array


@dataclass(frozen=True, eq=False)
class Dependence:
    """Polynomials for the mean and the width of a density along each of its h coordinates u.

    The mean and the width along a coordinate are functions of the coordinates before it; only the
    first k coordinates can enter these functions. The rows of ``mean`` and of ``log_width`` hold
    the coefficients of the constant 1, of the first k coordinates, and of the squares of these
    coordinates.
    """

    #: coefficients of polynomials, shape (1 + 2 k, h). They describe how the mean of a density
    #: along each of its h coordinates depends on the first k coordinates.
    mean: Array
    #: coefficients of polynomials, shape (1 + 2 k, h). They describe how the log width of a density
    #: along each of its h coordinates depends on the first k coordinates.
    log_width: Array
    #: constants, shape (h,), that are subtracted when the h coordinates u of a point are converted
    #: to nearly independent coordinates z = (u − mean) / width − offset
    offset: Array

    @property
    def leading(self) -> int:
        """Number k of leading coordinates, on which the means and widths of later ones may depend.

        The leading coordinates are the first k of the h coordinates.
        """
        return len(self.mean) // 2

    def remove(self, u: Array) -> IndependentPoints:
        """Convert the coordinates u of n points to nearly independent coordinates z.

        z and ``u`` have the shape (n, h), with h coordinates of each point. The mean and the width
        of a coordinate are functions of the coordinates before it; only the first ``leading``
        coordinates can enter these functions. The conversion z = (u − mean) / width − offset
        removes this dependence; the offset is a constant for each coordinate. The result also holds
        the sum of the logarithms of all widths at each point.
        """
        terms = _polynomial_terms(u[:, : self.leading])
        log_width = _limited(terms @ self.log_width)
        z = (u - terms @ self.mean) * np.exp(-log_width) - self.offset
        return IndependentPoints(z, log_width.sum(axis=1))

    def restore(self, z: Array) -> Array:
        """Return the coordinates u of n points from their nearly independent coordinates z.

        u and ``z`` have the shape (n, h), with h coordinates of each point. The method solves
        z = (u − mean) / width − offset for u and is thus the inverse of `remove`. The mean and the
        width of a coordinate are functions of the coordinates before it; only the first ``leading``
        coordinates can enter these functions. The first ``leading`` coordinates are therefore
        computed one after the other, and then all remaining coordinates at once. The offset is a
        constant for each coordinate.
        """
        standard = z + self.offset
        u = standard.copy()
        for first in range(1, self.leading + 1):
            columns = slice(first, first + 1)
            if first == self.leading:
                columns = slice(first, None)
            terms = _polynomial_terms(u[:, : self.leading])
            width = np.exp(_limited(terms @ self.log_width[:, columns]))
            u[:, columns] = terms @ self.mean[:, columns] + width * standard[:, columns]
        return u


def _polynomial_terms(leading: Array) -> Array:
    """Return the terms of the polynomials: 1, the first k coordinates, and their squares.

    ``leading``, shape (n, k), holds the k coordinates of n points. Coordinates beyond ±5 are first
    replaced by ±5. The result has the shape (n, 1 + 2 k).
    """
    near = np.clip(leading, -_FARTHEST, _FARTHEST)
    return np.concatenate([np.ones((len(near), 1)), near, near**2], axis=1)


def _limited(log_width: Array) -> Array:
    """Return the log widths of a density, limited to ±``_LARGEST_LOG_WIDTH``."""
    return np.asarray(np.clip(log_width, -_LARGEST_LOG_WIDTH, _LARGEST_LOG_WIDTH))


@dataclass(frozen=True, eq=False)
class _Polynomials:
    """Orthonormal polynomials of degree one and two in each of the k coordinates of n points.

    The points are values of the hyper-parameters, and each point has a weight. Under these weights,
    the two polynomials in a coordinate have the mean zero, the variance one and no correlation with
    each other.
    """

    # weighted means of the first k coordinates of n points (values of the hyper-parameters), shape
    # (k,)
    mean: Array
    # weighted standard deviations of the first k coordinates of n points (values of the
    # hyper-parameters), shape (k,)
    sd: Array
    # weighted skewness of each of the first k coordinates of n points (values of the
    # hyper-parameters), shape (k,)
    skewness: Array
    # weighted standard deviations of k polynomials of degree two, shape (k,), before the
    # polynomials are scaled to a standard deviation of one. They are taken over n points (values of
    # the hyper-parameters).
    square_sd: Array
    # values of k orthonormal polynomials of degree one at n points, shape (n, k). There is one
    # polynomial for each of the k coordinates.
    linear: Array
    # values of k orthonormal polynomials of degree two at n points, shape (n, k). There is one
    # polynomial for each of the k coordinates.
    square: Array

    def coefficients(self, of_linear: Array, of_square: Array) -> Array:
        """Convert coefficients of the polynomials to coefficients of powers of the coordinates.

        ``of_linear`` and ``of_square``, shape (k, h), are the coefficients with which the
        polynomials of degree one and of degree two enter the mean or the log width of h
        coordinates. The rows of the result, shape (1 + 2 k, h), are the coefficients of 1, of the k
        coordinates u, and of their squares. The polynomial of degree one is t = (u − mean) / sd;
        the polynomial of degree two is (t² − 1 − skewness t) / square_sd. The numbers mean, sd,
        skewness and square_sd are attributes of this object.
        """
        mean = self.mean[:, None]
        sd = self.sd[:, None]
        of_t_squared = of_square / self.square_sd[:, None]
        of_t = of_linear - of_t_squared * self.skewness[:, None]
        of_square_of_u = of_t_squared / sd**2
        of_u = of_t / sd - 2.0 * mean * of_square_of_u
        constant = mean**2 * of_square_of_u - of_t * mean / sd - of_t_squared
        return np.concatenate([constant.sum(axis=0)[None], of_u, of_square_of_u])


def _polynomials(leading: Array, weight: Array) -> _Polynomials:
    """Return orthonormal polynomials of degree one and two in each coordinate of weighted points.

    ``leading``, shape (n, k), holds k coordinates of n points; ``weight``, shape (n,), holds the
    weights of the points.
    """
    near = np.clip(leading, -_FARTHEST, _FARTHEST)
    mean = weight @ near
    sd = np.sqrt(weight @ (near - mean) ** 2)
    linear = (near - mean) / sd
    skewness = weight @ linear**3
    square = linear**2 - 1.0 - skewness * linear
    square_sd = np.sqrt(weight @ square**2)
    return _Polynomials(mean, sd, skewness, square_sd, linear, square / square_sd)


def fit_dependence(u: Array, weight: Array) -> Dependence:
    """Fit the mean and the width of each of h coordinates as functions of earlier coordinates.

    Only the first k coordinates can influence later coordinates. The number k is at most 7, and at
    most h − 1. The mean and the log width are sums of polynomials, whose coefficients are fitted to
    n weighted points. A coefficient is set to zero if its absolute value is at most three standard
    errors. For these standard errors, the effective sample size of the weights is used as the
    number of points.

    Parameters
    ----------
    u : ndarray, shape (n, h)
        Coordinates of the points. The coordinates have weighted means of zero and variances of one,
        and are not correlated with each other.
    weight : ndarray, shape (n,)
        Weights of the points, which sum to one.
    """
    h = u.shape[1]
    k = min(h - 1, _LEADING)
    is_before = np.arange(k)[:, None] < np.arange(h)
    ess = 1.0 / (weight**2).sum()
    polynomials = _polynomials(u[:, :k], weight)
    moment = (polynomials.square.T * weight) @ u
    is_significant = np.abs(moment) > _SIGNIFICANT / np.sqrt(ess)
    of_square = np.where(is_before & is_significant, moment, 0.0)
    deviation = u - polynomials.square @ of_square
    of_width = _fit_widths(deviation, polynomials, is_before, weight)
    return Dependence(
        polynomials.coefficients(np.zeros((k, h)), of_square),
        polynomials.coefficients(of_width[:k], of_width[k:]),
        np.zeros(h),
    )


def _fit_widths(
    deviation: Array, polynomials: _Polynomials, is_before: Array, weight: Array
) -> Array:
    """Fit the widths of h coordinates as functions of the first k coordinates.

    The width of a coordinate is its standard deviation about its mean. The logarithm of a width is
    a sum of polynomials in the first k coordinates. The result, shape (2 k, h), holds the
    coefficients of the ``polynomials``. The first k rows belong to the polynomials of degree one,
    the other k rows to those of degree two. ``deviation``, shape (n, h), holds the deviations of h
    coordinates from their means at n points. ``weight``, shape (n,), holds the weights of the
    points. ``is_before``, shape (k, h), is True where the coordinate of the row comes before the
    coordinate of the column. Only where it is True can a coefficient differ from zero. Coefficients
    that are not significant are zero, too. The coefficients maximise the likelihood of the
    deviations under normal distributions. They are computed with Fisher's method of scoring
    (Harvey, Econometrica 44 (1976) 461).
    """
    values = np.concatenate([polynomials.linear, polynomials.square], axis=1)
    is_fitted = np.concatenate([is_before, is_before])
    coefficients = np.zeros(is_fitted.shape)
    ess = 1.0 / (weight**2).sum()
    for step in range(_STEPS):
        standard = deviation * np.exp(-_limited(values @ coefficients))
        excess = standard**2 / (weight @ standard**2) - 1.0
        moment = 0.5 * (values.T * weight) @ excess
        if step == 0:
            standard_error = 0.5 * np.sqrt(weight @ excess**2 / ess)
            is_fitted = is_fitted & (np.abs(moment) > _SIGNIFICANT * standard_error)
        coefficients = coefficients + np.where(is_fitted, moment, 0.0)
    return coefficients
