"""p(φ | y), everything linear integrated out: its modes, weighted nodes, and averages over them."""

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

# Step of the central differences, in free coordinates.
_DIFFERENCE_STEP = 0.05
# Smallest curvature that a direction counts as having.
_LEAST_CURVATURE = 0.3
# Starting points of the search for modes; the best quarter of them is looked through
_STARTS = 256
_BEST_STARTS = _STARTS // 4
# for so many basins, ...
_BASINS = 3
# ... whose starts, or modes, are at least this far apart.
_SEPARATION = 1.5
# A mode or corner this far below the highest mode does not count [nat].
_NEGLIGIBLE_DEPTH = 12.0
# Corners are looked for in up to so many dimensions,
_LARGEST_CORNER_DIMENSION = 5
# this far below the mode along an axis.
_BELOW_MODE = 3.0
# Tolerance [nat] and step [sd] of the coarse nodes.
_COARSE_TOLERANCE = 0.2
_COARSE_STEP = 1.25
# The nodes left out before P(T | y, φ) is computed hold the tolerance over this ...
_PARTS_OF_TOLERANCE = 20.0
# ... and at most this share of the integral.
_LARGEST_LEFT_OUT = 5e-4
# P(T | y, φ) is computed to a quarter of the tolerance, but never better than this [nat].
_FINEST_TOLERANCE = 1e-3
# Share of the tolerance for the nodes where P(T | y, φ) takes up the other.
_NODES_SHARE = 0.7
# Moments of β leave out nodes with this share of the weight.
_SPARE = 1e-7
# Components of the mixture whose quantiles are those of β.
_COMPONENTS = 8192
# Each component has at least this share of the parameter's sd.
_LEAST_SD_SHARE = 1e-6


class HyperPosterior:
    """p(φ | y), with or without the truncation, in free coordinates.

    Parameters
    ----------
    bound : BoundModel
    truncated : bool
        Whether to include P(T | y, φ), the probability of physical compliances (whether or not the
        model imposes them).
    seed : int
        Seed of the starting points of the search and of the quasi-random points of P(T | y, φ).
    near : ndarray, shape (h,), optional
        Free coordinates of the mode of a density much like this one; saves the search for it.
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
        """Every mode (h,) that counts, the highest first.

        Each with a root (h, h) of the inverse curvature there.
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
        """The highest mode, shape (h,)."""
        return self.modes[0][0]

    def given(self, free: Array) -> tuple[Array, ParameterConditional]:
        """Return ln p(y | φ), shape (w,), and p(β | y, φ) at free coordinates (w, h)."""
        return self.bound.given(self.bound.hyper_prior.phi(free))

    def log_density(self, free: Array, *, smooth: bool = False) -> Array:
        """Return ln p(y, free coordinates), shape (w,).

        Where truncated ln P(T | y, φ) is included or, ``smooth``, its upper bound, which is cheaper
        and smooth.
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
        """Return weighted nodes of p(y, free coordinates) to this tolerance [nat].

        Nodes without truncation serve the truncated density too, unless truncation moves it far.
        """
        if not self.truncated:
            return Nodes(self, self._integral(tolerance))
        nodes = self.truncate(self._plain_integral(tolerance), tolerance)
        if nodes.integral.error <= tolerance and not nodes.suit(tolerance):
            nodes = self.truncate(self._plain_integral(_NODES_SHARE * tolerance), tolerance)
        if nodes.integral.error <= tolerance:
            return nodes
        smooth = integrate(self._smooth, self.modes, tolerance=tolerance, seed=self._seed)
        smooth_nodes = self.truncate(smooth, tolerance, bounded=True)
        if smooth_nodes.error < nodes.error:
            return smooth_nodes
        return nodes

    def _integral(self, tolerance: float) -> Integral:
        """Return the integral without truncation, computed once for each tolerance."""
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
        """Return nodes of a density without truncation times P(T | y, φ).

        Parameters
        ----------
        integral : Integral
            Of the density without truncation, or, ``bounded``, of that times the upper bound of
            P(T | y, φ).
        tolerance : float
            Error asked for [nat].
        orthant : callable, optional
            The problems of P(T | y, φ) at the nodes of an index, where they are known.
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
        # Nodes share points: their errors add up.
        error = float(truncated.weight @ np.where(truncated.weight > 0.0, errors, 0.0))
        return Nodes(self, truncated, error)

    @cached_property
    def plain(self) -> HyperPosterior:
        """The same density without truncation."""
        if not self.truncated:
            return self
        return HyperPosterior(self.bound, truncated=False, seed=self._seed, near=self._near)

    @cached_property
    def proposal(self) -> Integral:
        """A sample whose proposal can be drawn from, with P(T | y, φ) by its bound."""
        modes = [*self.modes, *self._corners()]
        return importance_sample(
            self._smooth, modes, tolerance=_COARSE_TOLERANCE / 4.0, seed=self._seed
        )

    @cached_property
    def coarse(self) -> Integral:
        """Coarse nodes, with P(T | y, φ) by its bound."""
        return integrate(
            self._smooth,
            self.modes,
            tolerance=_COARSE_TOLERANCE,
            step=_COARSE_STEP,
            seed=self._seed,
        )

    @cached_property
    def coarse_truncated(self) -> Integral:
        """The coarse nodes with P(T | y, φ) itself."""
        return self._replace_bound(self.coarse)

    @cached_property
    def sample_nodes(self) -> Integral:
        """The nodes of the proposal's sample with P(T | y, φ) itself."""
        return self._replace_bound(self.proposal)

    def _replace_bound(self, integral: Integral) -> Integral:
        """Replace the bound of P(T | y, φ) by the probability itself."""
        if not self.truncated:
            return integral
        return self.truncate(integral, _COARSE_TOLERANCE, bounded=True).integral

    def _starts(self) -> list[Array]:
        """Return where to climb from: the best of many starting points, several basins tried."""
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
        """Return where one noise vanishes and others make up for it, in the form of `modes`.

        From there ln p falls by one for each unit.
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
        """Return a function for gradient and Hessian along these axes, zero along the others."""

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
    """Say whether a point is far enough from all others to be another mode or basin."""
    return all(np.linalg.norm(point - other) > _SEPARATION for other in points)


def _inverse_root(hessian: Array) -> Array:
    """Return a root (h, h) of the inverse curvature, no direction flatter than the least."""
    curvature, vectors = np.linalg.eigh(-hessian)
    return np.asarray(vectors / np.sqrt(np.maximum(curvature, _LEAST_CURVATURE)))


@dataclass(frozen=True)
class Evidence:
    """ln Z of a model and a campaign."""

    #: ln of the density of the readings in mm; only differences between models of the same readings
    #: count
    log_value: float
    error: float  #: [nat]; infinite where the weights of the nodes cannot be trusted
    nodes: int  #: of the quadrature
    sha256: str  #: digest of the readings it is of

    @property
    def trusted(self) -> bool:
        """Whether the weights of the nodes can be trusted, and with them the value."""
        return bool(np.isfinite(self.error))

    def __repr__(self) -> str:
        value = " ± ".join(value_and_uncertainty(self.log_value, self.error))
        return f"<Evidence: ln Z = {value} nat, {self.nodes} nodes; readings {self.sha256[:8]}>"


class _ConditionalMoments(NamedTuple):
    """Means and variances of β given φ at w points."""

    mean: Array  #: (w, p)
    variance: Array  #: (w, p)


@dataclass(frozen=True, eq=False)
class Nodes:
    """p(φ | y) as weighted nodes, and averages over them.

    Parameters
    ----------
    posterior : HyperPosterior
    integral : Integral
        The nodes.
    truncation_error : float
        Error of the mean of P(T | y, φ) [nat].
    """

    posterior: HyperPosterior
    integral: Integral
    truncation_error: float = 0.0

    @property
    def bound(self) -> BoundModel:
        """The model and its campaign."""
        return self.posterior.bound

    @property
    def error(self) -> float:
        """Error of the log evidence [nat].

        That of the nodes and, truncated, those of P(T | y, φ) and P(T | prior).
        """
        error = self.integral.error + self.truncation_error
        if not self.posterior.truncated:
            return error
        return error + self.bound.truncation_prior[1]

    def suit(self, tolerance: float) -> bool:
        """Return whether no more nodes are needed.

        P(T | y, φ) may leave them less than the tolerance, though not below its half.
        """
        if self.truncation_error >= tolerance / 2.0:
            return self.integral.error <= tolerance
        return self.integral.error <= tolerance - self.truncation_error

    @cached_property
    def evidence(self) -> Evidence:
        """The evidence, ln Z = ln ∫ p(y | φ) p(φ) dφ.

        Truncated: ln Z + ln P(T | y) − ln P(T | prior).
        """
        log_value = self.integral.log_integral
        if self.posterior.truncated:
            log_value = log_value - self.bound.log_prob_truncation_prior
        return Evidence(log_value, self.error, len(self.integral.weight), self._digest())

    def _digest(self) -> str:
        """Return the SHA-256 of the readings; of fewer tests also of their names."""
        campaign = self.bound.campaign
        names = self.bound.test_names
        if len(names) == len(campaign.tests):
            return campaign.sha256
        return hashlib.sha256("\n".join([campaign.sha256, *names]).encode()).hexdigest()

    def draw(self, size: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """Draw β (size, p) at nodes picked by their weights, and return φ (size, h) [mm] too."""
        free = self.integral.pick(size, rng)
        beta = draw_parameters_given(self.bound, free, rng)
        return beta, self.bound.hyper_prior.phi(free)

    def moments(self, *, spare: float = _SPARE, points: int = 512) -> tuple[Array, Array]:
        """Return mean and sd of β, each (p,).

        Moments given φ, truncated from so many points, are averaged over the nodes but for a share
        ``spare`` of the weight.
        """
        free, weight = self.integral.heaviest(spare)

        def moments_along_axes(orthant: Orthant) -> tuple[Array, Array]:
            moments = orthant.moments(points)
            return moments.mean, moments.covariance

        conditional = self._moments_given(free, moments_along_axes)
        mean = weight @ conditional.mean
        return mean, np.sqrt(weight @ (conditional.variance + (conditional.mean - mean) ** 2))

    def quantiles(self, levels: Array, *, seed: int, components: int = _COMPONENTS) -> Array:
        """Return quantiles of β, shape (levels, p).

        They are those of a mixture of Gaussians given φ and, truncated, given draws along the
        directions that truncation acts on.
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
        """Return means and variances of β given φ.

        ``along_axes`` returns mean and covariance along the axes that truncation acts on.
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
