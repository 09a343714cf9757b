"""∫ f of a log density on ℝ^h as a sum over weighted nodes, with an error."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.inference.diagnostics import pareto_k
from ldbb_bayes.inference.mixture_proposals import Mixture, Random
from ldbb_bayes.results import Array

__all__ = ["CHUNK", "LARGEST_PARETO_K", "Index", "Integral", "LogDensity", "in_chunks"]

Index = NDArray[np.intp]
LogDensity = Callable[[Array], Array]
# Points at which a density is evaluated at once: arrays stay in the processor's cache.
CHUNK = 256
# Largest Pareto k̂ of weights that can be trusted. Vehtari et al. (2024) allow 0.7.
LARGEST_PARETO_K = 0.6
# The error of a sample is so many standard errors of its scrambles,
_STANDARD_ERRORS = 2.0
# but no less than this share of what plain random numbers would leave.
_OF_PLAIN_ERROR = 0.5
# Above this Pareto k̂ the error of a sample grows, ...
_HEAVY_TAIL_K = 0.4
# ... by its own size for every such step of k̂.
_HEAVY_TAIL_STEP = 0.1
# The integral beyond a lattice's edge is at most so many times what its edge holds.
_BEYOND_EDGE = 3.0
# The error of the mean of two grids is at most this share of their difference, ...
_MEAN_OF_TWO = 0.25
# ... and of differences up to this one [nat]; larger ones cancel in the first order.
_LARGEST_LINEAR = 0.02
# A difference counts as no less than this share of that at the step before.
_DECLINE = 0.35
# Least share of a grid that its logarithm is taken of.
_TINY = 1e-300


@dataclass(frozen=True, eq=False)
class Integral:
    """∫ f of a density f on ℝ^h as a sum over n weighted nodes."""

    free: Array  #: the nodes (n, h)
    log_density: Array  #: ln f there (n,)
    log_volume: Array  #: ln of the volume that each stands for (n,)
    #: to which of several estimates of the integral a node belongs: two grids, or independent
    #: scrambles (n,)
    estimate: Index
    #: nodes of a lattice beyond which no density was evaluated (n,)
    edge: NDArray[np.bool_]
    #: what a sample was drawn from, a density much like f; none of a lattice
    proposal: Mixture | None
    #: at most this share of the integral is in nodes whose density was not evaluated
    left_out: float = 0.0
    #: difference of a lattice's two grids with the step before this [nat]; zero of the first
    coarser_difference: float = 0.0

    @cached_property
    def _log_weight(self) -> Array:
        return self.log_density + self.log_volume

    @cached_property
    def weight(self) -> Array:
        """Normalised weights of the nodes, shape (n,)."""
        weight = np.exp(self._log_weight - self._log_weight.max())
        return weight / weight.sum()

    @property
    def log_integral(self) -> float:
        """The integral, ln ∫ f."""
        return float(np.logaddexp.reduce(self._log_weight))

    @property
    def ess(self) -> float:
        """Effective sample size of the weights."""
        return float(1.0 / (self.weight**2).sum())

    @cached_property
    def grid_difference(self) -> float:
        """Difference of ln ∫ f between the two grids of a lattice [nat]."""
        share = np.maximum(np.bincount(self.estimate, self.weight), _TINY)
        return abs(float(np.diff(np.log(share))[0]))

    @property
    def edge_error(self) -> float:
        """Largest share of the integral beyond a lattice's edge."""
        return _BEYOND_EDGE * float(self.weight[self.edge].sum())

    @cached_property
    def error(self) -> float:
        """Error of ln ∫ f [nat], infinite where the weights cannot be trusted."""
        if not self.trusted:
            return np.inf
        if self.proposal is None:
            return self._lattice_error() + self.left_out
        return self._sample_error() + self.left_out

    def _lattice_error(self) -> float:
        """Return a share of the two grids' difference, and what lies beyond the edge.

        The first order of the difference cancels in the mean of the grids. As steps shorten the
        difference may change sign: it counts as no less than a share of the one before.
        """
        difference = max(self.grid_difference, _DECLINE * self.coarser_difference)
        of_mean = max(difference**2, _MEAN_OF_TWO * min(difference, _LARGEST_LINEAR))
        return of_mean + self.edge_error

    def _sample_error(self) -> float:
        """Return twice the standard error from the scatter between independent scrambles.

        No less than half of what plain random numbers would leave, as few scrambles may agree by
        luck; more where the tail of the weights is heavy.
        """
        share = np.bincount(self.estimate, self.weight)
        plain_error = np.sqrt(max(1.0 / self.ess - 1.0 / len(self.weight), 0.0))
        scatter = _STANDARD_ERRORS * share.std(ddof=1) * np.sqrt(len(share))
        heavy_tail = 1.0 + max(self.pareto_k - _HEAVY_TAIL_K, 0.0) / _HEAVY_TAIL_STEP
        return float(max(scatter, _OF_PLAIN_ERROR * plain_error) * heavy_tail)

    @cached_property
    def pareto_k(self) -> float:
        """Shape k̂ of the tail of weights (Vehtari et al. 2024), −inf of a lattice.

        Above 0.6 neither the integral nor its error can be trusted.
        """
        if self.proposal is None:
            return -np.inf
        return pareto_k(self._log_weight)

    @property
    def trusted(self) -> bool:
        """Whether the weights can be trusted."""
        return self.pareto_k <= LARGEST_PARETO_K

    def heaviest(self, spare: float) -> tuple[Array, Array]:
        """Return nodes and normalised weights but for a share ``spare`` of the integral."""
        heavy = self._heavy_nodes(spare)
        return self.free[heavy], self.weight[heavy] / self.weight[heavy].sum()

    def _heavy_nodes(self, spare: float) -> Index:
        """Return the indices of the heaviest nodes, all but a share ``spare``."""
        order = np.argsort(self.weight)
        return np.sort(order[np.cumsum(self.weight[order]) >= spare])

    def pick(self, size: int, rng: np.random.Generator) -> Array:
        """Return nodes resampled by their weights, in random order, shape (size, h).

        Resampling is systematic.
        """
        order = np.lexsort(self.free.T)
        levels = (rng.random() + np.arange(size)) / size
        reached = np.searchsorted(np.cumsum(self.weight[order]), levels)
        return rng.permutation(self.free[order][np.minimum(reached, len(order) - 1)])

    def draw(self, size: int, rng: Random, *, temperature: float = 1.0) -> Array:
        """Return independent draws from a sample's proposal, shape (size, h).

        A temperature above one makes them wider.
        """
        return self._sample_proposal().draw(size, rng, temperature=temperature)

    def log_proposal(self, free: Array) -> Array:
        """Return the log density with which `draw` gives points (n, h), shape (n,)."""
        return self._sample_proposal().log_density(free)

    def _sample_proposal(self) -> Mixture:
        if self.proposal is None:
            raise TypeError("a lattice has no proposal to draw from. Use importance_sample.")
        return self.proposal

    def times(self, log_factor: Callable[[Index], Array], spare: float) -> Integral:
        """Return ∫ f g, with ln g evaluated only at the nodes that count.

        Parameters
        ----------
        log_factor : callable
            ln g (k,) at the nodes of an index (k,).
        spare : float
            Share of ∫ f in the nodes that are left out. What they hold of ∫ f g, were g as large
            there as anywhere, goes into the error.
        """
        heavy = self._heavy_nodes(spare)
        values = np.full(len(self.free), -np.inf)
        factor = log_factor(heavy)
        values[heavy] = self.log_density[heavy] + factor
        product = replace(self, log_density=values)
        share = max(1.0 - float(self.weight[heavy].sum()), 0.0)
        log_ratio = factor.max() + self.log_integral - product.log_integral
        return replace(product, left_out=share * float(np.exp(log_ratio)))


def in_chunks(log_density: Callable[..., Array], points: Array, size: int = CHUNK) -> Array:
    """Return a log density at any number of points, evaluated a few hundred at a time."""
    chunks = np.array_split(points, max(1, -(-len(points) // size)))
    return np.concatenate([log_density(chunk) for chunk in chunks])
