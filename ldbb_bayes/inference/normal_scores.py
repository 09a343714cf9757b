"""Normal scores: coordinates in which integrals over the hyper-parameters are computed.

The hyper-parameters φ are quantities such as the standard deviation of the noise. The normal score
z of a value of a hyper-parameter is defined by Φ(z) = P. P is the prior probability of smaller
values, and Φ is the standard normal distribution function. If the readings hardly determine a
scale, the density of its logarithm has an exponential tail, which extends far towards minus
infinity. The density of its normal score has a Gaussian tail instead. In normal scores, the
posterior of φ therefore resembles a Gaussian more closely, and an integral over φ needs fewer nodes
(weighted values of φ). For the factors that multiply the noise of single circles, the logarithms
are used instead, because they are nearly normal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_expit, log_ndtr, ndtri_exp

from ldbb_bayes.inference.integrals import Integral, ProposalDensity
from ldbb_bayes.inference.mixture_proposals import Random
from ldbb_bayes.model.hyper_prior import HyperPrior
from ldbb_bayes.results import Array

__all__ = ["NormalScores"]

# Smallest distance of a hyper-parameter from its bounds. A smaller distance is replaced by this
# value, so that the logarithm of the distance is finite.
_LEAST_DISTANCE = 1e-300
# A value of a hyper-parameter counts as near a bound if the log prior probability of the interval
# between the value and the bound is below this limit. Subtracting the bound from the value would
# then be inaccurate. The distance between them is computed instead as the prior probability of the
# interval divided by the prior density at the bound.
_NEAR_BOUND = -20.0
# Normal score of a value whose log prior probability of smaller values is ``_NEAR_BOUND``.
_SCORE_NEAR_BOUND = float(ndtri_exp(_NEAR_BOUND))
# The logarithm of a probability is taken to be at most this value, so that the normal quantile at
# this probability is finite.
_LARGEST_LOG_PROBABILITY = -1e-300


@dataclass(frozen=True)
class NormalScores:
    """Transformation between two kinds of coordinates of the h hyper-parameters.

    The first kind are normal scores: coordinates in which the prior of a hyper-parameter is
    standard normal. The second kind are the unbounded coordinates of `HyperPrior`, here called
    free. For a hyper-parameter φ without an upper bound, the unbounded coordinate is ln(φ − lower
    bound).

    Normal scores are computed for the k hyper-parameters whose priors are normal and truncated to
    an interval from a to b. These are scales that are lengths, for which b is infinite, and decays,
    which are the powers by which form error falls with its Fourier order. Each of the other
    hyper-parameters multiplies the noise of a single circle; its logarithm serves as its score.
    Arrays of points have the shape (..., h).
    """

    prior: HyperPrior

    @cached_property
    def _has_normal_prior(self) -> NDArray[np.bool_]:
        """Whether each of h hyper-parameters has a truncated normal prior, shape (h,)."""
        return np.array([law != "circle" for law in self.prior.laws])

    @cached_property
    def _bounds(self) -> Array:
        """Bounds of the k hyper-parameters with truncated normal priors, shape (2, k).

        The first row holds the lower bounds, the second row the upper bounds.
        """
        return np.asarray(self.prior.bounds[self._has_normal_prior].T)

    @cached_property
    def _mean(self) -> Array:
        """Means of the normal priors of k hyper-parameters before truncation, shape (k,).

        The k hyper-parameters are those with truncated normal priors: lengths, such as the standard
        deviation of the noise, and decays, the powers by which form error falls with its Fourier
        order.
        """
        # Hyper-parameters that are lengths have half-normal priors, that is, normal priors of mean
        # zero that are truncated at a lower bound. For a decay (power by which form error falls
        # with its Fourier order), the prior's field ``scale`` holds the mean.
        mean = np.where(self.prior.in_mm, 0.0, self.prior.scale)
        return np.asarray(mean[self._has_normal_prior])

    @cached_property
    def _sd(self) -> Array:
        """Standard deviations of the normal priors of k hyper-parameters, shape (k,).

        The k hyper-parameters are those with truncated normal priors. The standard deviations are
        those before truncation.
        """
        sd = np.where(self.prior.in_mm, self.prior.scale, self.prior.decay_sd)
        return np.asarray(sd[self._has_normal_prior])

    @cached_property
    def _log_above(self) -> Array:
        """Log probability that a hyper-parameter would exceed its upper bound, shape (k,).

        There is one such probability for each of the k hyper-parameters with truncated normal
        priors. It is the probability under the normal distribution before truncation.
        """
        return np.asarray(log_ndtr(-(self._bounds[1] - self._mean) / self._sd))

    @cached_property
    def _log_mass(self) -> Array:
        """Log probability that a hyper-parameter would be between its bounds, shape (k,).

        There is one such probability for each of the k hyper-parameters with truncated normal
        priors. It is the probability under the normal distribution before truncation.
        """
        return self._log_probability_above(self._bounds[0])

    def _log_probability_above(self, values: Array) -> Array:
        """Return the log probability that a hyper-parameter is between a value and its upper bound.

        There is one such probability for each of the k hyper-parameters with truncated normal
        priors. It is the probability under the normal distribution before truncation. ``values``,
        shape (..., k), holds a value for each hyper-parameter. The result has the same shape.
        """
        log_tail = log_ndtr(-(values - self._mean) / self._sd)
        log_share = np.minimum(self._log_above - log_tail, _LARGEST_LOG_PROBABILITY)
        return np.asarray(log_tail + np.log(-np.expm1(log_share)))

    def _values(self, scores: Array) -> Array:
        """Return the values of k hyper-parameters with truncated normal priors, shape (..., k).

        The values are computed from ``scores``, shape (..., h), which has one number for each of h
        hyper-parameters. For the k hyper-parameters with truncated normal priors, this number is
        the normal score, whose prior is standard normal. All others are noise factors of circles;
        their numbers are not used.
        """
        log_probability = log_ndtr(-scores[..., self._has_normal_prior]) + self._log_mass
        log_tail = np.logaddexp(log_probability, self._log_above)
        return np.asarray(self._mean - self._sd * ndtri_exp(log_tail))

    @cached_property
    def _log_density_at_bounds(self) -> Array:
        """Log prior densities of k hyper-parameters at their lower and upper bounds, shape (2, k).

        The hyper-parameters are those with truncated normal priors. At an infinite bound, the log
        density is −inf.
        """
        white = (self._bounds - self._mean) / self._sd
        log_normal = -0.5 * white**2 - 0.5 * np.log(2.0 * np.pi)
        return np.asarray(log_normal - np.log(self._sd) - self._log_mass)

    def _log_distances(self, scores: Array, values: Array) -> tuple[Array, Array]:
        """Return ln(φ − a) and ln(b − φ), each of shape (..., k).

        φ are the k hyper-parameters with truncated normal priors, and a and b their lower and upper
        bounds. If b is infinite, ln(b − φ) is replaced by zero. ``scores``, shape (..., h), has one
        number for each of h hyper-parameters. For the k hyper-parameters with truncated normal
        priors, this number is the normal score, whose prior is standard normal. All others are
        noise factors of circles; their numbers are not used. ``values``, shape (..., k), holds φ.
        """
        lower, upper = self._bounds
        restricted = scores[..., self._has_normal_prior]
        log_density_at_lower, log_density_at_upper = self._log_density_at_bounds
        above = np.log(np.maximum(values - lower, _LEAST_DISTANCE))
        below = np.log(np.maximum(upper - values, _LEAST_DISTANCE))
        near_lower = restricted < _SCORE_NEAR_BOUND
        of_lower = np.broadcast_to(log_density_at_lower, near_lower.shape)[near_lower]
        above[near_lower] = log_ndtr(restricted[near_lower]) - of_lower
        near_upper = restricted > -_SCORE_NEAR_BOUND
        of_upper = np.broadcast_to(log_density_at_upper, near_upper.shape)[near_upper]
        below[near_upper] = log_ndtr(-restricted[near_upper]) - of_upper
        return above, np.where(np.isfinite(upper), below, 0.0)

    def free(self, scores: Array) -> Array:
        """Return the unbounded coordinates of h hyper-parameters from their normal scores.

        ``scores``, shape (..., h), holds the normal scores. The prior of a normal score is standard
        normal; for the noise factor of a circle, the logarithm takes the place of the normal score.
        The unbounded coordinates have the same shape. Each is a function of one hyper-parameter, in
        most cases ln(value − lower bound).
        """
        return self.free_with_jacobian(scores)[0]

    def free_with_jacobian(self, scores: Array) -> tuple[Array, Array]:
        """Return unbounded coordinates of h hyper-parameters, and the log Jacobian, for scores.

        The results are those of `free`, shape (..., h), and of `log_jacobian`, shape (...).
        ``scores``, shape (..., h), holds the normal scores. Most of the work is the same for both.
        """
        values = self._values(scores)
        above, below = self._log_distances(scores, values)
        free = np.array(scores, dtype=float)
        free[..., self._has_normal_prior] = above - below
        width = np.diff(self._bounds, axis=0)[0]
        log_slope = above + below - np.log(np.where(np.isfinite(width), width, 1.0))
        # The prior density of a hyper-parameter and the standard normal density of its normal score
        # both contain the factor 1 / √(2π). This factor cancels, and is therefore left out of both.
        white = (values - self._mean) / self._sd
        log_prior = -0.5 * white**2 - np.log(self._sd) - self._log_mass
        log_normal = -0.5 * scores[..., self._has_normal_prior] ** 2
        log_jacobian: Array = (log_normal - log_prior - log_slope).sum(axis=-1)
        return free, log_jacobian

    def scores(self, free: Array) -> Array:
        """Return the normal scores of h hyper-parameters from their unbounded coordinates.

        ``free``, shape (..., h), holds the unbounded coordinates. Each is a function of one
        hyper-parameter, in most cases ln(value − lower bound). The normal scores have the same
        shape. The prior of a normal score is standard normal; for the noise factor of a circle, the
        logarithm takes the place of the normal score.
        """
        scores = np.array(free, dtype=float)
        values = self.prior.phi(free)[..., self._has_normal_prior]
        log_probability = self._log_probability_above(values) - self._log_mass
        bounded = np.minimum(log_probability, _LARGEST_LOG_PROBABILITY)
        of_restricted = -ndtri_exp(bounded)
        nearer_to_lower, nearer_to_upper = self._log_probabilities_near_bounds(free)
        near_lower = nearer_to_lower < _NEAR_BOUND
        of_restricted[near_lower] = ndtri_exp(nearer_to_lower[near_lower])
        near_upper = nearer_to_upper < _NEAR_BOUND
        of_restricted[near_upper] = -ndtri_exp(nearer_to_upper[near_upper])
        scores[..., self._has_normal_prior] = of_restricted
        return scores

    def _log_probabilities_near_bounds(self, free: Array) -> tuple[Array, Array]:
        """Return the log prior probabilities of short intervals between values and their bounds.

        Of the h hyper-parameters, k have truncated normal priors, with lower bounds a and upper
        bounds b. ``free``, shape (..., h), holds unbounded coordinates of all hyper-parameters,
        which are in most cases ln(value − lower bound). The result is a tuple of two arrays, each
        of shape (..., k). The first holds log probabilities of the intervals from a to the values,
        the second those of the intervals from the values to b. The probabilities are computed as if
        the prior density in the whole interval were as large as at the bound. They are therefore
        accurate only for short intervals. If b is infinite, the log probability of the interval up
        to b is replaced by infinity.
        """
        lower, upper = self._bounds
        restricted = free[..., self._has_normal_prior]
        bounded = np.isfinite(upper)
        log_width = np.log(np.where(bounded, upper - lower, 1.0))
        log_density_at_lower, log_density_at_upper = self._log_density_at_bounds
        above = np.where(bounded, log_width + log_expit(restricted), restricted)
        below = log_width + log_expit(-restricted)
        to_upper = np.where(bounded, log_density_at_upper, np.inf)
        return log_density_at_lower + above, to_upper + below

    def log_prior(self, scores: Array) -> Array:
        """Return the log prior density of normal scores, shape (...).

        ``scores``, shape (..., h), holds the normal scores of the h hyper-parameters. Their prior
        is standard normal. For the noise factor λ of a circle, ln λ takes the place of the normal
        score, and the density is that of ln λ. The result is −inf where λ is so small that λ⁻²
        overflows.
        """
        restricted = scores[..., self._has_normal_prior]
        log_normal = -0.5 * restricted**2 - 0.5 * np.log(2.0 * np.pi)
        of_noise = self.prior.log_density_of_log_noise(scores[..., ~self._has_normal_prior])
        total: Array = log_normal.sum(axis=-1) + of_noise.sum(axis=-1)
        return total

    def log_jacobian(self, scores: Array) -> Array:
        """Return the log Jacobian of the unbounded coordinates with respect to scores, shape (...).

        The coordinates and the normal scores are those of hyper-parameters. The Jacobian is the
        volume in unbounded coordinates per unit of volume in normal scores, the product of du/dz
        over the hyper-parameters. Here u is the unbounded coordinate of a hyper-parameter φ with
        the bounds a and b, and z is its score. The derivative du/dz follows from two equations. The
        first is n(z) dz = p(φ) dφ, where p is the prior density of φ and n the standard normal
        density. The second is dφ = (φ − a) du if b is infinite, and dφ = (φ − a) (b − φ) / (b − a)
        du if b is finite. ``scores``, shape (..., h), holds the normal scores of the h
        hyper-parameters.
        """
        return self.free_with_jacobian(scores)[1]

    def to_free(self, integral: Integral) -> Integral:
        """Convert the nodes of an integral from normal scores to unbounded coordinates.

        Nodes are weighted values of the hyper-parameters. The prior of a normal score is standard
        normal; for the noise factor of a circle, the logarithm takes the place of the normal score.
        An unbounded coordinate is in most cases ln(value − lower bound) of a hyper-parameter.
        """
        free, log_jacobian = self.free_with_jacobian(integral.free)
        proposal: ProposalDensity | None = None
        if integral.proposal is not None:
            proposal = _FreeProposal(self, integral.proposal)
        return replace(
            integral,
            free=free,
            log_density=integral.log_density - log_jacobian,
            log_volume=integral.log_volume + log_jacobian,
            proposal=proposal,
        )

    def from_free(self, integral: Integral) -> Integral:
        """Convert the nodes of an integral from unbounded coordinates to normal scores.

        This is the inverse of `to_free`. Nodes are weighted values of the hyper-parameters.
        """
        scores = self.scores(integral.free)
        log_jacobian = self.log_jacobian(scores)
        proposal = integral.proposal
        if isinstance(proposal, _FreeProposal):
            proposal = proposal.of_scores
        return replace(
            integral,
            free=scores,
            log_density=integral.log_density + log_jacobian,
            log_volume=integral.log_volume - log_jacobian,
            proposal=proposal,
        )


@dataclass(frozen=True)
class _FreeProposal:
    """Density of unbounded coordinates of the hyper-parameters.

    An unbounded coordinate is a function of one hyper-parameter, in most cases ln(value − lower
    bound). The density is computed from ``of_scores``, the `ProposalDensity` of the normal scores.
    The prior of a normal score is standard normal; for the noise factor of a circle, the logarithm
    takes the place of the normal score.
    """

    coordinates: NormalScores
    of_scores: ProposalDensity

    def log_density(self, points: Array) -> Array:
        """Return the log density of the unbounded coordinates at n points, shape (n,).

        ``points``, shape (n, h), holds the unbounded coordinates of h hyper-parameters, which are
        in most cases ln(value − lower bound).
        """
        scores = self.coordinates.scores(points)
        return self.of_scores.log_density(scores) - self.coordinates.log_jacobian(scores)

    def draw(self, size: int, rng: Random, *, temperature: float = 1.0) -> Array:
        """Return ``size`` independent random draws of h unbounded coordinates, shape (size, h).

        Each coordinate is a function of one of h hyper-parameters, in most cases ln(value − lower
        bound). Normal scores (transformed hyper-parameters) are drawn from the density
        ``of_scores``, widened by the factor sqrt(``temperature``). The draws are then transformed
        to unbounded coordinates. ``rng`` generates the random numbers.
        """
        return self.coordinates.free(self.of_scores.draw(size, rng, temperature=temperature))

    def draw_with_log_density(self, size: int, rng: Random) -> tuple[Array, Array]:
        """Return ``size`` random draws of h unbounded coordinates, and their log densities.

        The draws have the shape (size, h), and the log densities the shape (size,). The normal
        scores (transformed hyper-parameters) from which the draws are computed give both. ``rng``
        generates the random numbers.
        """
        scores, log_density = self.of_scores.draw_with_log_density(size, rng)
        free, log_jacobian = self.coordinates.free_with_jacobian(scores)
        return free, log_density - log_jacobian
