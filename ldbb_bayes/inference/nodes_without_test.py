"""Nodes for a campaign without one test, computed from the nodes for the whole campaign.

φ are the hyper-parameters, such as the standard deviation of the noise. Nodes are weighted points
that represent p(φ | y), where y are the readings. If a campaign has many tests, its posterior of φ
hardly changes when one test is left out. With other weights, the nodes for the whole campaign then
also represent the posterior without the test. The ratio of the two posterior densities, with and
without the test, needs to be known only at a few hundred of these nodes (`density_ratio`).

An exception is the noise factor λ of the test left out, a hyper-parameter of this test alone.
Without the test's readings, λ has its prior, which is much wider than its posterior. The ratio of
the two posterior densities would therefore vary strongly with λ. To avoid this, the prior of λ in
the density without the test is replaced by a Gaussian that is about as wide as the posterior of λ.
This Gaussian is a density of ln λ given the other coordinates of a node, and is fitted to the nodes
for the whole campaign. Both the Gaussian and the prior integrate to one over λ, so that the
integral over φ does not change. Afterwards, the values of λ at the nodes are replaced by random
draws from the prior.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ldbb_bayes.inference.density_ratio import LogValues, RatioSampler
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.integrals import Index, Integral
from ldbb_bayes.inference.nodes import Nodes
from ldbb_bayes.inference.related_models import log_density_with_error
from ldbb_bayes.results import Array

__all__ = ["NodesWithoutTest"]

# If a test is left out, the values of its noise factor (the factor on the noise of its circle) are
# replaced by random draws from the prior. This is the seed of these draws.
_SEED = 0
# Smallest standard deviation of the Gaussian that is fitted to the logarithm of the factor on the
# noise of a circle. A smaller standard deviation is replaced by this value.
_LEAST_SD = 1e-6


@dataclass(frozen=True)
class GaussianFactor:
    """Gaussian density of one of h coordinates given the other coordinates.

    The density is fitted to weighted points. The mean of the coordinate is a linear function of the
    other h − 1 coordinates.
    """

    #: index of the coordinate that the Gaussian density describes, one of the h coordinates of a
    #: point
    axis: int
    #: The conditional mean of one coordinate of a point, given the other h − 1 coordinates, is a
    #: linear function of these. The array holds the slopes of this function, shape (h − 1,).
    slopes: Array
    #: conditional mean of one coordinate of a point if all other coordinates are zero
    intercept: float
    #: conditional standard deviation of one coordinate of a point, given the other coordinates
    sd: float

    def log_density(self, free: Array) -> Array:
        """Return the log density of one coordinate of w points given their other coordinates.

        The result has the shape (w,). ``free``, shape (w, h), holds all h coordinates of the
        points. The density describes the coordinate with the index ``axis``.
        """
        mean = self.intercept + np.delete(free, self.axis, axis=1) @ self.slopes
        z = (free[:, self.axis] - mean) / self.sd
        return np.asarray(-0.5 * z**2 - np.log(self.sd * np.sqrt(2.0 * np.pi)))


def fit_factor(integral: Integral, axis: int) -> GaussianFactor:
    """Return the Gaussian density of one coordinate given all other coordinates.

    The density is fitted by weighted regression to the nodes (weighted points) of ``integral``.
    ``axis`` is the index of the coordinate among all coordinates of a node.
    """
    others = np.delete(integral.free, axis, axis=1)
    coordinate = integral.free[:, axis]
    centre = integral.weight @ others
    mean = integral.weight @ coordinate
    root_weight = np.sqrt(integral.weight)
    slopes = np.linalg.lstsq(
        (others - centre) * root_weight[:, None], (coordinate - mean) * root_weight, rcond=None
    )[0]
    residual = coordinate - mean - (others - centre) @ slopes
    sd = max(float(np.sqrt(integral.weight @ residual**2)), _LEAST_SD)
    return GaussianFactor(axis, slopes, float(mean - centre @ slopes), sd)


class NodesWithoutTest:
    """Nodes of one model for a campaign without one of its tests.

    Parameters
    ----------
    nodes : Nodes
        Nodes of the model for the campaign with all its tests.
    tolerance : float
        Largest error allowed in the log evidence of a campaign without one test [nat].
    """

    def __init__(self, nodes: Nodes, tolerance: float) -> None:
        """Store the nodes for the campaign with all its tests, and the error tolerance [nat].

        ``tolerance`` is the largest error that is allowed in the log evidence of a campaign without
        one test.
        """
        self._integral = nodes.integral
        self._ratios = RatioSampler(nodes.integral)
        self._prior = nodes.bound.hyper_prior
        self._tolerance = tolerance

    def nodes(self, posterior: HyperPosterior, test: str) -> Nodes | None:
        """Return the nodes for the campaign without one test, or None if their error is too large.

        ``test`` is the name of the test left out. ``posterior`` is the posterior density of the
        hyper-parameters, given the readings of the other tests.
        """
        noise_factor = f"lambda_{test}"
        if noise_factor in self._prior.names:
            return self._nodes_with_noise_factor(posterior, self._prior.names.index(noise_factor))

        def evaluate(index: Index) -> LogValues:
            return log_density_with_error(posterior, self._integral.free[index], self._tolerance)

        sampled = self._ratios.integrate(evaluate, self._tolerance)
        if sampled is None:
            return None
        return Nodes(posterior, sampled.integral, sampled.value_error)

    def _nodes_with_noise_factor(self, posterior: HyperPosterior, axis: int) -> Nodes | None:
        """Return the nodes without one test, for a model with a factor on the noise of this test.

        One of the hyper-parameters, with the index ``axis``, is the factor on the noise of the test
        that is left out. ``posterior`` is the posterior density of the hyper-parameters without the
        readings of the test. The result is None if the error of the log evidence from the nodes
        exceeds the tolerance.
        """
        factor = fit_factor(self._integral, axis)

        def evaluate(index: Index) -> LogValues:
            # Return the log density at the nodes with the indices ``index``. One test is left out;
            # its noise factor is a hyper-parameter that multiplies the noise of its circle. The
            # density is the posterior density without the test, in which the prior of this noise
            # factor is replaced by the Gaussian density ``factor``.
            free = self._integral.free[index]
            values = log_density_with_error(posterior, free, self._tolerance)
            change = factor.log_density(free) - self._prior.log_density_of_log_noise(free[:, axis])
            return LogValues(values.log_density + change, values.error)

        sampled = self._ratios.integrate(evaluate, self._tolerance)
        if sampled is None:
            return None
        integral = self._with_prior_of_noise_factor(sampled.integral, factor)
        return Nodes(posterior, integral, sampled.value_error)

    def _with_prior_of_noise_factor(self, integral: Integral, factor: GaussianFactor) -> Integral:
        """Return an integral in which the noise factor of the test left out has its prior again.

        A noise factor is a hyper-parameter that multiplies the noise of one test's circle. In
        ``integral``, the Gaussian density ``factor`` was used instead of the prior of this noise
        factor. In the result, the density contains the prior, and the values of the noise factor at
        the nodes are drawn at random from the prior. The weights of the nodes and the value of the
        integral therefore stay the same.
        """
        rng = np.random.default_rng(_SEED)
        log_noise = np.log(self._prior.draw_noise_factor(len(integral.free), rng))
        change = self._prior.log_density_of_log_noise(log_noise) - factor.log_density(integral.free)
        free = integral.free.copy()
        free[:, factor.axis] = log_noise
        return replace(
            integral,
            free=free,
            log_density=integral.log_density + change,
            log_volume=integral.log_volume - change,
        )
