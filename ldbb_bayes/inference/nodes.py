"""Weighted nodes that represent the posterior p(φ | y) of the hyper-parameters, and averages.

y are the readings, and φ the hyper-parameters, such as the standard deviation of the noise. A node
is one value of φ; many nodes with weights represent p(φ | y). The means, quantiles and draws of the
parameters (compliances, their changes with force, geometric errors) are averages over the nodes of
those for given φ.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ldbb_bayes.inference.conditional_sampling import draw_parameters_given
from ldbb_bayes.inference.density_ratio import RatioIntegral
from ldbb_bayes.inference.evidence_value import Evidence
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.integrals import CHUNK, Integral
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.mixtures import mixture_quantiles
from ldbb_bayes.model.orthant import Orthant
from ldbb_bayes.results import Array

__all__ = ["Nodes", "compute_nodes"]

# The nodes of smallest weight are left out of averages, such as the means and variances of the
# parameters. Together, these nodes hold at most this share of the weight.
_SPARE = 1e-7
# Number of Gaussians in the mixture from which quantiles of parameters are computed. Each Gaussian
# belongs to one value of the hyper-parameters.
_COMPONENTS = 8192
# Quantiles of parameters are computed from a mixture of Gaussians. Gaussians that are too narrow
# are widened: their standard deviation is raised to this fraction of the scatter (standard
# deviation) between the means of all Gaussians.
_LEAST_SD_SHARE = 1e-6


class _ConditionalMoments(NamedTuple):
    """Means and variances of the parameters, given each of w values of the hyper-parameters.

    The parameters are compliances, their changes with force, and geometric errors. Means and
    variances are also conditional on the readings.
    """

    #: posterior means of the p parameters given each of w values of the hyper-parameters, shape
    #: (w, p)
    mean: Array
    #: posterior variances of the p parameters given each of w values of the hyper-parameters, shape
    #: (w, p)
    variance: Array


@dataclass(frozen=True, eq=False)
class Nodes:
    """Weighted nodes that represent the posterior of the hyper-parameters, and averages over them.

    Parameters
    ----------
    posterior : HyperPosterior
        The posterior density of the hyper-parameters that the nodes represent.
    integral : Integral
        The nodes, which are values of the hyper-parameters in free coordinates, and their weights.
    truncation_error : float
        Part of the error of the log evidence [nat]. It comes from errors of the probabilities that
        no compliance is negative.
    """

    posterior: HyperPosterior
    integral: Integral
    truncation_error: float = 0.0

    @property
    def bound(self) -> BoundModel:
        """The model of one campaign whose posterior the nodes represent."""
        return self.posterior.bound

    @property
    def error(self) -> float:
        """Error of the log evidence [nat].

        The error includes the error of the integral over the nodes. If compliances must not be
        negative, the error also includes the errors of the log probability that no compliance is
        negative, under the posterior and under the prior.
        """
        error = self.integral.error + self.truncation_error
        if not self.posterior.truncated:
            return error
        return error + self.bound.parameter_prior.normalisation.error

    def meets(self, tolerance: float) -> bool:
        """Return whether the error of the log evidence is small enough for the tolerance [nat].

        The error of the prior probability that no compliance is negative does not count; see
        `RatioIntegral.meets`.
        """
        return RatioIntegral(self.integral, self.truncation_error).meets(tolerance)

    @cached_property
    def evidence(self) -> Evidence:
        """Log evidence ln Z = ln ∫ p(y | φ) p(φ) dφ, for readings y and hyper-parameters φ.

        If compliances must not be negative (truncation), ln P(T | y) − ln P(T) is added. P(T | y)
        and P(T) are the posterior and the prior probability that no compliance is negative.
        """
        log_value = self.integral.log_integral
        if self.posterior.truncated:
            log_value = log_value - self.bound.parameter_prior.normalisation.log_value
        return Evidence(log_value, self.error, len(self.integral.weight), self._digest())

    def _digest(self) -> str:
        """Return the digest (SHA-256) of the readings to which the posterior belongs.

        The digest also covers the conditions under which the readings were taken and, if tests of
        the campaign are left out, the names of the tests that remain.
        """
        campaign = self.bound.campaign
        names = self.bound.test_names
        if len(names) == len(campaign.tests):
            return campaign.sha256
        return hashlib.sha256("\n".join([campaign.sha256, *names]).encode()).hexdigest()

    def draw(self, size: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """Return ``size`` posterior draws of parameters and hyper-parameters.

        Hyper-parameters (such as the standard deviation of the noise) are picked from the nodes in
        proportion to the weights. Parameters (compliances, their changes with force, geometric
        errors) are drawn at random given the picked hyper-parameters and the readings. All draws
        are in units made of mm, N and rad. For p parameters and h hyper-parameters, the results
        have the shapes (size, p) and (size, h). If the posterior of the nodes is ``truncated``, no
        compliance is negative in any draw. ``rng`` generates the random numbers. Raise an
        `InputError` if, for one of the picked hyper-parameters, many attempts all give a negative
        compliance.
        """
        free = self.integral.resample(size, rng)
        beta = draw_parameters_given(self.bound, free, rng, truncated=self.posterior.truncated)
        return beta, self.bound.hyper_prior.phi(free)

    def moments(
        self, *, spare: float = _SPARE, points: int = 512, components: int | None = None
    ) -> tuple[Array, Array]:
        """Return the posterior mean and standard deviation of the p parameters, each of shape (p,).

        Means and variances given the hyper-parameters are averaged over the nodes. The nodes of
        smallest weight, which together hold at most the share ``spare`` of the weight, are left
        out. If there are more nodes than ``components``, the averages are over ``components`` nodes
        that are picked in proportion to their weights. If compliances must not be negative, means
        and variances given the hyper-parameters are computed from ``points`` quasi-random points.
        """
        free, weight = self.integral.heaviest(spare)
        if components is not None and len(free) > components:
            free = self.integral.resample(components, np.random.default_rng(0))
            weight = np.full(components, 1.0 / components)

        def moments_along_axes(orthant: Orthant) -> tuple[Array, Array]:
            moments = orthant.moments(points)
            return moments.mean, moments.covariance

        conditional = self._moments_given(free, moments_along_axes)
        mean = weight @ conditional.mean
        return mean, np.sqrt(weight @ (conditional.variance + (conditional.mean - mean) ** 2))

    def quantiles(self, levels: Array, *, seed: int, components: int = _COMPONENTS) -> Array:
        """Return posterior quantiles of the p parameters at n probabilities, shape (n, p).

        ``levels``, shape (n,), holds the probabilities. The quantiles are computed from a mixture
        of Gaussians. Each Gaussian is the density of a parameter given one value of the
        hyper-parameters. ``components`` such values are picked from the nodes in proportion to the
        weights. The condition that no compliance is negative restricts only a few linear
        combinations of the parameters. If the model has this condition, values of these
        combinations are drawn at random, and each Gaussian is the density of a parameter given both
        the hyper-parameters and these values. ``seed`` is the seed of all random numbers.
        """
        rng = np.random.default_rng(seed)

        def draw_along_axes(orthant: Orthant) -> tuple[Array, Array]:
            x, _ = orthant.draw_along_axes(rng)
            return x, np.zeros((*x.shape, x.shape[1]))

        conditional = self._moments_given(self.integral.resample(components, rng), draw_along_axes)
        mean = conditional.mean
        sd = np.sqrt(np.maximum(conditional.variance, 0.0))
        sd = np.maximum(sd, _LEAST_SD_SHARE * mean.std(axis=0))
        return mixture_quantiles(np.full(len(mean), 1.0 / len(mean)), mean, sd, levels)

    def _moments_given(
        self, free: Array, along_axes: Callable[[Orthant], tuple[Array, Array]]
    ) -> _ConditionalMoments:
        """Return the moments of the parameters for each of w values of the hyper-parameters.

        ``free``, shape (w, h), holds the h hyper-parameters in free coordinates. For given
        hyper-parameters, the parameters have a Gaussian density. If negative compliances are
        allowed, its moments are returned, and ``along_axes`` is not used. If they are not allowed,
        the density is restricted by the condition that no compliance is negative. In coordinates in
        which the Gaussian is N(0, I), the condition affects only d directions. ``along_axes`` is a
        function that returns the mean, shape (w, d), and the covariance, shape (w, d, d), of the
        coordinates along these directions under the condition.
        """
        means = []
        variances = []
        for start in range(0, len(free), CHUNK):
            conditional = self.posterior.given(free[start : start + CHUNK]).parameters
            spread = conditional.spread()
            mean = conditional.mean
            variance = (spread**2).sum(axis=2)
            if self.posterior.truncated:
                shift, covariance = along_axes(conditional.orthant)
                axes = spread @ np.swapaxes(conditional.orthant.axes, 1, 2)
                change = covariance - np.eye(shift.shape[1])
                mean = mean + np.einsum("wpd,wd->wp", axes, shift)
                variance = variance + np.einsum("wpd,wde,wpe->wp", axes, change, axes)
            means.append(mean)
            variances.append(variance)
        return _ConditionalMoments(np.concatenate(means), np.concatenate(variances))


def compute_nodes(posterior: HyperPosterior, tolerance: float = 1e-3) -> Nodes:
    """Return weighted values of the hyper-parameters (nodes) that represent their posterior.

    ``tolerance`` is the error allowed in the log evidence [nat]. If the nodes do not reach this
    tolerance, their ``error`` is larger.
    """
    computed = posterior.integral(tolerance)
    return Nodes(posterior, computed.integral, computed.value_error)
