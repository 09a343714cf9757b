"""Posterior p(φ | y) of the hyper-parameters: modes, weighted nodes, and averages over nodes.

y are the readings; φ are the h hyper-parameters, the scales of the noise and of other effects;
β are the p parameters: compliances, their slopes and geometric errors. β and the effects that are
modelled but not of interest are integrated out exactly, as readings depend linearly on them.
Truncation T restricts β to compliances that are not negative; P(T | y, φ) is the probability that
β meets it. Free coordinates are φ transformed to be unbounded, mostly ln(φ − lower bound).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.stats import qmc

from ldbb_bayes.inference.conditional_sampling import draw_parameters_given
from ldbb_bayes.inference.importance_sampling import importance_sample
from ldbb_bayes.inference.integrals import CHUNK, Index, Integral, in_chunks
from ldbb_bayes.inference.quadrature import integrate
from ldbb_bayes.model.conditional import ParameterConditional
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.mixtures import mixture_quantiles
from ldbb_bayes.model.newton import central_differences, newton
from ldbb_bayes.model.orthant import Orthant
from ldbb_bayes.results import Array
from ldbb_bayes.units import value_and_uncertainty

__all__ = ["Evidence", "HyperPosterior", "Nodes"]

# Step of the central differences by the hyper-parameters, in unbounded coordinates such as their
# logarithms.
_DIFFERENCE_STEP = 0.05
# Least curvature of the log density, in unbounded coordinates of the hyper-parameters, that is used
# in any direction.
_LEAST_CURVATURE = 0.3
# Number of starting points of the search for modes of the posterior, and number of the best of them
# that are considered.
_STARTS = 256
_BEST_STARTS = _STARTS // 4
# Largest number of starting points from which the search for modes climbs uphill.
_BASINS = 3
# Starting points, and modes, count as separate if their distance in unbounded coordinates of the
# hyper-parameters exceeds this.
_SEPARATION = 1.5
# A maximum of the log density is negligible if it is lower than the highest one by more than this
# [nat].
_NEGLIGIBLE_DEPTH = 12.0
# Largest number of hyper-parameters for which maxima with one of them held near zero are sought
# (see `HyperPosterior._corners`).
_LARGEST_CORNER_DIMENSION = 5
# Distance below the mode, in its unbounded coordinate, at which one hyper-parameter is held when
# maxima of the density near zero are sought.
_BELOW_MODE = 3.0
# Tolerance of the log evidence [nat], and step in standard deviations, of coarse nodes.
_COARSE_TOLERANCE = 0.2
_COARSE_STEP = 1.25
# The lightest nodes are left out where the probability that no compliance is negative is computed.
# Their share of the integral is at most the tolerance divided by this.
_PARTS_OF_TOLERANCE = 20.0
# Largest share of the integral in nodes that are left out, whatever the tolerance.
_LARGEST_LEFT_OUT = 5e-4
# The log probability that no compliance is negative is computed to a quarter of the tolerance, but
# never better than this [nat].
_FINEST_TOLERANCE = 1e-3
# Share of the tolerance allowed to the error of the nodes, where the probability that no compliance
# is negative also has an error.
_NODES_SHARE = 0.7
# Means and variances of parameters are computed without the lightest nodes, which hold this share
# of the weight.
_SPARE = 1e-7
# Number of Gaussians in the mixture from which quantiles of parameters are computed.
_COMPONENTS = 8192
# Least standard deviation of a Gaussian in the mixture from which quantiles are computed, as a
# share of the standard deviation of the means of all Gaussians.
_LEAST_SD_SHARE = 1e-6


class HyperPosterior:
    """Posterior density of the hyper-parameters φ given the readings y, in unbounded coordinates.

    Unbounded coordinates, here called free, are mostly ln(φ − lower bound).

    Parameters
    ----------
    bound : BoundModel
        The model bound to its campaign.
    truncated : bool
        Whether to include P(T | y, φ), the probability that no compliance is negative (whether or
        not the model requires it).
    seed : int
        Seed of the starting points of the search and of the quasi-random points of P(T | y, φ).
    near : ndarray, shape (h,), optional
        Free coordinates of the mode of a density much like this one; saves the search for the mode.
    """

    def __init__(
        self, bound: BoundModel, *, truncated: bool, seed: int = 0, near: Array | None = None
    ) -> None:
        self.bound = bound
        self.truncated = truncated
        self._seed = seed
        self._near = near
        self._integrals: dict[float, Integral] = {}

    @cached_property
    def modes(self) -> list[tuple[Array, Array]]:
        """All maxima of the density that are not negligible, the highest first.

        Each is a pair: the mode, shape (h,), and a square root, shape (h, h), of the inverse of
        minus the Hessian of the log density at the mode.
        """
        summits = []
        for start in self._starts():
            summits.append(
                newton(self._smooth, self._derivatives, start, least_curvature=_LEAST_CURVATURE)
            )
        height = self._smooth(np.array(summits))
        modes: list[Array] = []
        for k in np.argsort(-height):
            counts = height[k] > height.max() - _NEGLIGIBLE_DEPTH
            if counts and _is_separate(summits[k], modes):
                modes.append(summits[k])
        return [(mode, _inverse_root(self._derivatives(mode)[1])) for mode in modes]

    @property
    def mode(self) -> Array:
        """The highest maximum of the density, shape (h,), in unbounded coordinates."""
        return self.modes[0][0]

    def given(self, free: Array) -> tuple[Array, ParameterConditional]:
        """Return ln p(y | φ), shape (w,), and the Gaussians p(β | y, φ) at w points.

        y are the readings, β the parameters and φ the hyper-parameters. ``free`` holds φ in
        unbounded coordinates, shape (w, h).
        """
        return self.bound.given(self.bound.hyper_prior.phi(free))

    def log_density(self, free: Array, *, smooth: bool = False) -> Array:
        """Return the joint log density of readings and hyper-parameters at w points, shape (w,).

        ``free`` holds the hyper-parameters φ in unbounded coordinates, shape (w, h). With
        truncation, the log probability ln P(T | y, φ) that no compliance is negative, given φ and
        the readings y, is added. If ``smooth``, the upper bound of this probability is used
        instead, which is cheaper to compute and a smooth function of φ.
        """
        log_density = self.bound.hyper_prior.log_density_of_free(free)
        finite = np.isfinite(log_density)
        if not finite.any():
            return np.asarray(log_density)
        if not self.truncated:
            phi = self.bound.hyper_prior.phi(free[finite])
            log_density[finite] += self.bound.log_evidence(phi)
            return np.asarray(log_density)
        log_evidence, conditional = self.given(free[finite])
        if smooth:
            log_probability = conditional.orthant.log_bound
        else:
            log_probability = conditional.orthant.log_probability(seed=self._seed)[0]
        log_density[finite] += log_evidence + log_probability
        return np.asarray(log_density)

    def nodes(self, tolerance: float = 1e-3) -> Nodes:
        """Return weighted nodes that integrate the density to this tolerance [nat].

        The nodes are values of the hyper-parameters. With truncation, the nodes of the density
        without truncation are used first. Their weights are multiplied by the probability that no
        compliance is negative. If that misses the tolerance, nodes of the truncated density are
        computed.
        """
        if not self.truncated:
            return Nodes(self, self._integral(tolerance))
        nodes = self.truncate(self._plain_integral(tolerance), tolerance)
        if nodes.integral.error <= tolerance and not nodes.meet(tolerance):
            nodes = self.truncate(self._plain_integral(_NODES_SHARE * tolerance), tolerance)
        if nodes.integral.error <= tolerance:
            return nodes
        smooth = integrate(self._smooth, self.modes, tolerance=tolerance, seed=self._seed)
        smooth_nodes = self.truncate(smooth, tolerance, bounded=True)
        if smooth_nodes.error < nodes.error:
            return smooth_nodes
        return nodes

    def _integral(self, tolerance: float) -> Integral:
        """Return the integral of the smooth posterior density, computed once for each tolerance."""
        if tolerance not in self._integrals:
            self._integrals[tolerance] = integrate(
                self._smooth, self.modes, tolerance=tolerance, seed=self._seed
            )
        return self._integrals[tolerance]

    def _plain_integral(self, tolerance: float) -> Integral:
        return self.plain.nodes(tolerance).integral

    def truncate(
        self,
        integral: Integral,
        tolerance: float,
        orthant: Callable[[Index], Orthant] | None = None,
        *,
        bounded: bool = False,
    ) -> Nodes:
        """Return nodes of a density multiplied by the probability that no compliance is negative.

        The probability is P(T | y, φ), given the readings y and the hyper-parameters φ.

        Parameters
        ----------
        integral : Integral
            Integral of the density without truncation.
        tolerance : float
            Error asked for [nat].
        orthant : callable, optional
            Function that takes indices of nodes and returns the problems from which P(T | y, φ) is
            computed there. By default these are computed from the nodes.
        bounded : bool
            Whether ``integral`` already contains the upper bound of P(T | y, φ), which is then
            replaced by P(T | y, φ) itself.
        """
        size = CHUNK
        if orthant is not None:
            size = 4 * CHUNK
        errors = np.zeros(len(integral.free))

        def log_factor(index: Index) -> Array:
            if orthant is None:
                problems = self.given(integral.free[index])[1].orthant
            else:
                problems = orthant(index)
            value, errors[index] = problems.log_probability(
                max(tolerance / 4.0, _FINEST_TOLERANCE), seed=self._seed
            )
            if bounded:
                return value - problems.log_bound
            return value

        def log_factor_in_chunks(index: Index) -> Array:
            return in_chunks(log_factor, index, size)

        spare = min(tolerance / _PARTS_OF_TOLERANCE, _LARGEST_LEFT_OUT)
        truncated = integral.times(log_factor_in_chunks, spare)
        # Errors of the probabilities at the nodes add up, as all nodes use the same quasi-random
        # points.
        error = float(truncated.weight @ np.where(truncated.weight > 0.0, errors, 0.0))
        return Nodes(self, truncated, error)

    @cached_property
    def plain(self) -> HyperPosterior:
        """The same density without truncation: compliances may be negative."""
        if not self.truncated:
            return self
        return HyperPosterior(self.bound, truncated=False, seed=self._seed, near=self._near)

    @cached_property
    def proposal(self) -> Integral:
        """Importance sample with a fitted mixture, from which further points can be drawn.

        The points are values of the hyper-parameters. With truncation, the probability that no
        compliance is negative is replaced by its upper bound.
        """
        modes = [*self.modes, *self._corners()]
        return importance_sample(
            self._smooth, modes, tolerance=_COARSE_TOLERANCE / 4.0, seed=self._seed
        )

    @cached_property
    def coarse(self) -> Integral:
        """Coarse nodes of the posterior density of the hyper-parameters.

        With truncation, the probability that no compliance is negative is replaced by its upper
        bound.
        """
        return integrate(
            self._smooth,
            self.modes,
            tolerance=_COARSE_TOLERANCE,
            step=_COARSE_STEP,
            seed=self._seed,
        )

    @cached_property
    def coarse_truncated(self) -> Integral:
        """Coarse nodes, weighted by the exact probability that no compliance is negative.

        The nodes are values of the hyper-parameters.
        """
        return self._replace_bound(self.coarse)

    @cached_property
    def sample_nodes(self) -> Integral:
        """Points of ``proposal``, weighted by the exact probability that no compliance is negative.

        Without truncation, the weights are those of ``proposal``.
        """
        return self._replace_bound(self.proposal)

    def _replace_bound(self, integral: Integral) -> Integral:
        """Return an integral with the exact probability that no compliance is negative.

        It replaces the upper bound of this probability, which ``integral`` contains. Without
        truncation, the integral is returned unchanged.
        """
        if not self.truncated:
            return integral
        return self.truncate(integral, _COARSE_TOLERANCE, bounded=True).integral

    def _starts(self) -> list[Array]:
        """Return the points from which the search for modes climbs.

        They are the best of many starting points, at most three, at a distance from each other.
        """
        if self._near is not None:
            return [self._near]
        prior = self.bound.hyper_prior
        points = qmc.Sobol(len(prior.names), rng=np.random.default_rng(self._seed)).random(_STARTS)
        starts = prior.starts(points)
        starts = starts[np.argsort(-self._smooth(starts))]
        basins: list[Array] = []
        for start in starts[:_BEST_STARTS]:
            if len(basins) < _BASINS and _is_separate(start, basins):
                basins.append(start)
        return basins

    def _corners(self) -> list[tuple[Array, Array]]:
        """Return maxima of the density with one hyper-parameter held near zero.

        Other hyper-parameters compensate for the one held. The form is that of `modes`. Where a
        hyper-parameter no longer matters, the log density falls by one per unit of its free
        coordinate.
        """
        corners: list[tuple[Array, Array]] = []
        dimensions = len(self.mode)
        if dimensions > _LARGEST_CORNER_DIMENSION:
            return corners
        for axis in range(dimensions):
            free_axes = np.arange(dimensions) != axis
            start = self.mode - np.where(free_axes, 0.0, _BELOW_MODE)
            derivatives = self._derivatives_along(free_axes)
            corner = newton(self._smooth, derivatives, start, least_curvature=_LEAST_CURVATURE)
            heights = self._smooth(np.array([self.mode, corner]))
            if heights[1] - heights[0] > -_NEGLIGIBLE_DEPTH:
                corners.append((corner, _inverse_root(derivatives(corner)[1])))
        return corners

    def _derivatives_along(self, free_axes: Array) -> Callable[[Array], tuple[Array, Array]]:
        """Return a function for gradient and Hessian, zero except in the given coordinates.

        ``free_axes``, shape (h,), states which coordinates those are.
        """

        def derivatives(point: Array) -> tuple[Array, Array]:
            gradient, hessian = self._derivatives(point)
            both_free = np.outer(free_axes, free_axes)
            return np.where(free_axes, gradient, 0.0), np.where(both_free, hessian, 0.0)

        return derivatives

    def _smooth(self, free: Array) -> Array:
        return self.log_density(free, smooth=True)

    def _derivatives(self, point: Array) -> tuple[Array, Array]:
        return central_differences(self._smooth, point, _DIFFERENCE_STEP)


def _is_separate(point: Array, points: list[Array]) -> bool:
    """Return whether a point is far enough from all other points to count as a separate one."""
    return all(np.linalg.norm(point - other) > _SEPARATION for other in points)


def _inverse_root(hessian: Array) -> Array:
    """Return a square root, shape (h, h), of the inverse of minus the Hessian.

    Eigenvalues of minus the Hessian below the least curvature are raised to that value.
    """
    curvature, vectors = np.linalg.eigh(-hessian)
    return np.asarray(vectors / np.sqrt(np.maximum(curvature, _LEAST_CURVATURE)))


@dataclass(frozen=True)
class Evidence:
    """Log evidence ln Z of a model: the log density of a campaign's readings under the model."""

    #: log evidence ln Z: the log density of the readings in mm under the model; only differences
    #: between models of the same readings have a meaning
    log_value: float
    #: error of the log evidence [nat]; infinite where the nodes' weights cannot be trusted
    error: float
    nodes: int  #: number of nodes of the quadrature over the hyper-parameters
    sha256: str  #: digest (SHA-256) of the readings

    @property
    def trusted(self) -> bool:
        """Whether the weights of the nodes, and so the log evidence, can be trusted."""
        return bool(np.isfinite(self.error))

    def __repr__(self) -> str:
        value = " ± ".join(value_and_uncertainty(self.log_value, self.error))
        return f"<Evidence: ln Z = {value} nat, {self.nodes} nodes; readings {self.sha256[:8]}>"


class _ConditionalMoments(NamedTuple):
    """Means and variances of the parameters, given hyper-parameters at w points."""

    mean: Array  #: means of the p parameters, shape (w, p)
    variance: Array  #: variances of the p parameters, shape (w, p)


@dataclass(frozen=True, eq=False)
class Nodes:
    """Weighted nodes that represent the posterior of the hyper-parameters, and averages over them.

    Parameters
    ----------
    posterior : HyperPosterior
        The density that the nodes represent.
    integral : Integral
        The nodes and their weights.
    truncation_error : float
        Error of the log evidence that is due to the computed probabilities that no compliance is
        negative [nat].
    """

    posterior: HyperPosterior
    integral: Integral
    truncation_error: float = 0.0

    @property
    def bound(self) -> BoundModel:
        """The model bound to its campaign."""
        return self.posterior.bound

    @property
    def error(self) -> float:
        """Error of the log evidence [nat].

        It includes the error of the nodes. With truncation, it also includes the errors of the
        probability that no compliance is negative, under the posterior and under the prior.
        """
        error = self.integral.error + self.truncation_error
        if not self.posterior.truncated:
            return error
        return error + self.bound.truncation_prior[1]

    def meet(self, tolerance: float) -> bool:
        """Return whether the nodes are fine enough for this tolerance of the log evidence [nat].

        With truncation, the probability that no compliance is negative also has an error. The error
        of the nodes must not exceed the tolerance minus that error. If that error is half the
        tolerance or more, the error of the nodes alone must not exceed the tolerance.
        """
        if self.truncation_error >= tolerance / 2.0:
            return self.integral.error <= tolerance
        return self.integral.error <= tolerance - self.truncation_error

    @cached_property
    def evidence(self) -> Evidence:
        """Log evidence ln Z = ln ∫ p(y | φ) p(φ) dφ, for readings y and hyper-parameters φ.

        With truncation (no compliance is negative), ln P(T | y) − ln P(T) is added, where P(T | y)
        and P(T) are the posterior and the prior probability that no compliance is negative.
        """
        log_value = self.integral.log_integral
        if self.posterior.truncated:
            log_value = log_value - self.bound.log_prob_truncation_prior
        return Evidence(log_value, self.error, len(self.integral.weight), self._digest())

    def _digest(self) -> str:
        """Return the digest (SHA-256) of the readings.

        Where tests are left out, the digest also covers the names of the tests that remain.
        """
        campaign = self.bound.campaign
        names = self.bound.test_names
        if len(names) == len(campaign.tests):
            return campaign.sha256
        return hashlib.sha256("\n".join([campaign.sha256, *names]).encode()).hexdigest()

    def draw(self, size: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """Return random draws of parameters, shape (size, p), and of hyper-parameters, (size, h).

        Hyper-parameters [mm] are picked from the nodes by their weights, and parameters are drawn
        given these.
        """
        free = self.integral.pick(size, rng)
        beta = draw_parameters_given(self.bound, free, rng)
        return beta, self.bound.hyper_prior.phi(free)

    def moments(self, *, spare: float = _SPARE, points: int = 512) -> tuple[Array, Array]:
        """Return mean and standard deviation of the p parameters, each of shape (p,).

        Moments given the hyper-parameters are averaged over the nodes, without the lightest nodes,
        which hold the share ``spare`` of the weight. If compliances must not be negative, the
        moments given the hyper-parameters are computed from ``points`` quasi-random points.
        """
        free, weight = self.integral.heaviest(spare)

        def moments_along_axes(orthant: Orthant) -> tuple[Array, Array]:
            moments = orthant.moments(points)
            return moments.mean, moments.covariance

        conditional = self._moments_given(free, moments_along_axes)
        mean = weight @ conditional.mean
        return mean, np.sqrt(weight @ (conditional.variance + (conditional.mean - mean) ** 2))

    def quantiles(self, levels: Array, *, seed: int, components: int = _COMPONENTS) -> Array:
        """Return quantiles of the p parameters, shape (levels, p).

        They are the quantiles of a mixture of Gaussians: the densities of the parameters given
        hyper-parameters that are picked from the nodes. If compliances must not be negative, each
        Gaussian is also conditional on random draws of the components that this restricts.
        """
        rng = np.random.default_rng(seed)

        def draw_along_axes(orthant: Orthant) -> tuple[Array, Array]:
            x, _ = orthant.draw_along_axes(rng)
            return x, np.zeros((*x.shape, x.shape[1]))

        conditional = self._moments_given(self.integral.pick(components, rng), draw_along_axes)
        mean = conditional.mean
        sd = np.sqrt(np.maximum(conditional.variance, 0.0))
        sd = np.maximum(sd, _LEAST_SD_SHARE * mean.std(axis=0))
        return mixture_quantiles(np.full(len(mean), 1.0 / len(mean)), mean, sd, levels)

    def _moments_given(
        self, free: Array, along_axes: Callable[[Orthant], tuple[Array, Array]]
    ) -> _ConditionalMoments:
        """Return means and variances of the parameters, given hyper-parameters at w points.

        ``free`` holds the hyper-parameters in unbounded coordinates, shape (w, h). If compliances
        must not be negative, ``along_axes`` returns mean and covariance of the parameters' standard
        coordinates along the directions that this restricts.
        """
        means = []
        variances = []
        for start in range(0, len(free), CHUNK):
            _, conditional = self.posterior.given(free[start : start + CHUNK])
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
