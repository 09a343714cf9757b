"""Integrals ∫ f of a density f in h dimensions, computed as sums over n weighted nodes (points).

The nodes are either a lattice or a random sample. A lattice consists of two regular grids, the
second moved by half a step in every direction. A sample is drawn from a proposal, which is a
density similar to f, by means of several randomised quasi-random sequences.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.inference.diagnostics import pareto_k
from ldbb_bayes.inference.mixture_proposals import Random
from ldbb_bayes.results import Array

__all__ = [
    "CHUNK",
    "LARGEST_PARETO_K",
    "Index",
    "Integral",
    "LogFunction",
    "ProposalDensity",
    "in_chunks",
]

# Type of an array of indices.
Index = NDArray[np.intp]
# Type of a function that takes n points, shape (n, h), and returns the logarithm of a density at
# each of them, shape (n,).
LogFunction = Callable[[Array], Array]
# Number of points at which a density is evaluated in one call. It is small, so that the arrays fit
# into the processor's cache.
CHUNK = 256
# Largest Pareto shape k̂ with which importance weights can be trusted. k̂ is the shape of the
# Pareto distribution fitted to the largest weights. Vehtari et al. (2024) allow 0.7.
LARGEST_PARETO_K = 0.6
# Factor by which the standard error of an integral from a random sample is multiplied to obtain its
# reported error. The standard error is computed from the scatter between independently randomised
# quasi-random sequences.
_STANDARD_ERRORS = 2.0
# The error of an integral from quasi-random points is taken to be at least this fraction of the
# standard error that ordinary random points would give.
_OF_PLAIN_ERROR = 0.5
# If the Pareto shape k̂ of the weights of a random sample is above this value, the error of an
# integral from the sample is enlarged.
_HEAVY_TAIL_K = 0.4
# If the Pareto shape k̂ of the weights of a random sample exceeds ``_HEAVY_TAIL_K``, the error of
# the integral is multiplied by 1 + (k̂ − ``_HEAVY_TAIL_K``) / ``_HEAVY_TAIL_STEP``.
_HEAVY_TAIL_STEP = 0.1
# An integral is computed as a sum over the nodes (points) of a lattice. The region beyond the
# outermost nodes also contributes to the integral. Its contribution is assumed to be at most this
# number times the contribution of the outermost nodes.
_BEYOND_EDGE = 3.0
# A lattice consists of two grids, and its integral is the mean of the integrals from the two grids.
# The error of the log integral is this fraction of the difference between the log integrals from
# the two grids.
_MEAN_OF_TWO = 0.25
# A lattice consists of two grids, each of which gives a log integral. Let d be the difference
# between the two [nat]. If d is at most ``_LARGEST_LINEAR``, the error of the log integral is
# ``_MEAN_OF_TWO`` times d. For a larger d, the error is d², but at least ``_MEAN_OF_TWO`` times
# ``_LARGEST_LINEAR``.
_LARGEST_LINEAR = 0.02
# The error of a log integral from a lattice is computed from the difference between the results of
# its two grids. This difference may be small by chance. It is therefore taken to be at least this
# fraction of the difference that was found with the previous, wider spacing of the points.
_DECLINE = 0.35
# The integral over a lattice is the sum over its two grids. If the share of one grid in the sum is
# below this number, the share is replaced by this number, so that its logarithm is finite.
_TINY = 1e-300


class ProposalDensity(Protocol):
    """Proposal: density from which points are drawn for an integral by importance sampling.

    The points are the nodes of the integral. They have h dimensions, one for each variable of
    integration.
    """

    def log_density(self, points: Array) -> Array:
        """Return the log of the normalised proposal density at n points, shape (n,).

        ``points``, shape (n, h), holds the points, which have h dimensions.
        """

    def draw(self, size: int, rng: Random, *, temperature: float = 1.0) -> Array:
        """Return ``size`` points drawn at random from the proposal density, shape (size, h).

        The points have h dimensions, one for each variable of the integral. With a ``temperature``
        above one, they are drawn from a wider density: the proposal density with its widths in all
        directions multiplied by the square root of ``temperature``. ``rng`` generates the random
        numbers.
        """

    def draw_with_log_density(self, size: int, rng: Random) -> tuple[Array, Array]:
        """Return ``size`` points drawn at random, and the log proposal density at each of them.

        The points have the shape (size, h), with one dimension for each variable of the integral.
        The log densities have the shape (size,). ``rng`` generates the random numbers.
        """


@dataclass(frozen=True, eq=False)
class Integral:
    """Integral ∫ f of a density f in h dimensions as a sum over n weighted nodes (points)."""

    #: coordinates of the n nodes (points) of an integral in h dimensions, shape (n, h)
    free: Array
    #: logarithm of the density f to be integrated, at each of the n nodes (points), shape (n,)
    log_density: Array
    #: logarithm of the volume that each of the n nodes (points) represents, so that the integral is
    #: the sum of density times volume, shape (n,)
    log_volume: Array
    #: index of the set to which each of the n nodes (points) belongs, shape (n,). The nodes are
    #: divided into sets, each of which alone gives an estimate of the integral. Each of the two
    #: grids of a lattice is a set, and so is each of the randomised quasi-random sequences of a
    #: sample.
    estimate: Index
    #: whether each of the n nodes (points) is one of the outermost nodes of a lattice, beyond which
    #: the density was not evaluated, shape (n,)
    edge: NDArray[np.bool_]
    #: density from which the nodes (points) of a random sample were drawn; None for the nodes of a
    #: lattice
    proposal: ProposalDensity | None
    #: upper limit of the share of the integral that belongs to the nodes (points) at which the
    #: density was not evaluated because of their small weight
    left_out: float = 0.0
    #: absolute difference between two values of ln ∫ f [nat], one from each of the two grids of the
    #: lattice that had been computed before the spacing of the nodes was last reduced. Zero if the
    #: spacing was not reduced, or if the nodes are a random sample.
    coarser_difference: float = 0.0
    #: error of ln ∫ f [nat] that arises because the density f was evaluated only at some of the
    #: nodes (points) and inferred at all others, see `density_ratio`. Zero if it was evaluated at
    #: all nodes.
    ratio_error: float = 0.0

    @cached_property
    def _log_weight(self) -> Array:
        """Logarithms of the contributions of n nodes to the integral of a density, shape (n,).

        The contribution of a node (point) is the density at the node times the volume that the node
        represents.
        """
        return self.log_density + self.log_volume

    @cached_property
    def weight(self) -> Array:
        """Shares of n nodes (points) in the integral of a density, shape (n,). They sum to one."""
        weight = np.exp(self._log_weight - self._log_weight.max())
        return weight / weight.sum()

    @property
    def log_integral(self) -> float:
        """Logarithm of the integral of the density f over all h dimensions, ln ∫ f."""
        return float(np.logaddexp.reduce(self._log_weight))

    @property
    def ess(self) -> float:
        """Effective sample size 1 / Σ w² of the nodes (points) with weights w, which sum to one."""
        return float(1.0 / (self.weight**2).sum())

    @cached_property
    def grid_difference(self) -> float:
        """Absolute difference between the values of ln ∫ f from a lattice's two grids [nat]."""
        share = np.maximum(np.bincount(self.estimate, self.weight), _TINY)
        return abs(float(np.diff(np.log(share))[0]))

    @property
    def edge_error(self) -> float:
        """Upper estimate of the share of the integral beyond the outermost points of a lattice.

        The estimate is three times the share of the integral that these points (nodes) contribute.
        """
        return _BEYOND_EDGE * float(self.weight[self.edge].sum())

    @cached_property
    def error(self) -> float:
        """Error of ln ∫ f for a density f [nat].

        The error is infinite if the weights of the nodes (points) cannot be trusted.
        """
        if not self.trusted:
            return np.inf
        of_nodes = self._sample_error() if self.proposal is not None else self._lattice_error()
        # The log integral has two independent errors: one because the nodes (points) are few, and
        # one because the density may be evaluated at some of them only. The squares of the two
        # errors are added.
        return float(np.hypot(of_nodes, self.ratio_error)) + self.left_out

    def _lattice_error(self) -> float:
        """Return the error of the log integral ln ∫ f from the two grids of a lattice [nat].

        The error is the sum of two parts. One is the error of the mean of the two grids (see
        `_LARGEST_LINEAR`). The other is the share of the integral that may lie beyond the outermost
        nodes (points). The first part follows from the difference between the log integrals from
        the two grids. A small difference may be due to chance. The difference is therefore taken to
        be at least 0.35 times its value before the spacing of the nodes was last reduced.
        """
        difference = max(self.grid_difference, _DECLINE * self.coarser_difference)
        of_mean = max(difference**2, _MEAN_OF_TWO * min(difference, _LARGEST_LINEAR))
        return of_mean + self.edge_error

    def _sample_error(self) -> float:
        """Return the error of the log integral ln ∫ f from a sample [nat].

        The error is twice the standard error, which is computed from the scatter between
        independently randomised quasi-random sequences. The error is at least half the standard
        error that ordinary random points would give, because a few sequences may agree by chance.
        The error is enlarged if the Pareto shape k̂ of the weights is above 0.4.
        """
        share = np.bincount(self.estimate, self.weight)
        plain_error = np.sqrt(max(1.0 / self.ess - 1.0 / len(self.weight), 0.0))
        scatter = _STANDARD_ERRORS * share.std(ddof=1) * np.sqrt(len(share))
        heavy_tail = 1.0 + max(self.pareto_k - _HEAVY_TAIL_K, 0.0) / _HEAVY_TAIL_STEP
        return float(max(scatter, _OF_PLAIN_ERROR * plain_error) * heavy_tail)

    @cached_property
    def pareto_k(self) -> float:
        """Shape k̂ of the Pareto distribution fitted to the largest weights (Vehtari et al. 2024).

        If k̂ exceeds 0.6, neither the integral nor its error can be trusted. If the points are a
        lattice and not random, nothing is fitted, and k̂ is −inf.
        """
        if self.proposal is None:
            return -np.inf
        return pareto_k(self._log_weight)

    @property
    def trusted(self) -> bool:
        """Whether the weights of an integral's nodes can be trusted: their Pareto k̂ is at most 0.6.

        The nodes are the points at which the density is known, and k̂ states how heavy the tail of
        the distribution of their weights is. If the nodes form a lattice, their weights can always
        be trusted.
        """
        return self.pareto_k <= LARGEST_PARETO_K

    def heaviest(self, spare: float) -> tuple[Array, Array]:
        """Return the nodes with the largest weights, and these weights.

        Nodes are weighted points in h dimensions. The nodes with the smallest weights are left out
        as long as their weights sum to less than ``spare``. If k nodes remain, the results have the
        shapes (k, h) and (k,). The weights returned are scaled to sum to one.
        """
        heavy = self._heavy_nodes(spare)
        return self.free[heavy], self.weight[heavy] / self.weight[heavy].sum()

    def _heavy_nodes(self, spare: float) -> Index:
        """Return the indices of the nodes (points) with the largest weights, in ascending order.

        The nodes with the smallest weights are left out as long as their weights sum to less than
        ``spare``. The weights of all nodes sum to one.
        """
        order = np.argsort(self.weight)
        return np.sort(order[np.cumsum(self.weight[order]) >= spare])

    def resample(self, size: int, rng: np.random.Generator) -> Array:
        """Return ``size`` nodes resampled in proportion to their weights, shape (size, h).

        Nodes are points in h dimensions. Resampling is systematic: the nodes are picked at ``size``
        equally spaced values of the cumulative weight, the first of which is random (``rng``). A
        node may be picked several times. The nodes returned are in random order.
        """
        order = _sorted_by_coordinates(self.free)
        levels = (rng.random() + np.arange(size)) / size
        reached = np.searchsorted(np.cumsum(self.weight[order]), levels)
        return rng.permutation(self.free[order][np.minimum(reached, len(order) - 1)])

    def draw(self, size: int, rng: Random, *, temperature: float = 1.0) -> Array:
        """Return ``size`` new random points from the proposal of an integral, shape (size, h).

        The proposal is the density from which the random nodes (points in h dimensions) of the
        integral were drawn. Its scales (widths) are first multiplied by the square root of
        ``temperature``. Raise a `TypeError` for a lattice, which has no proposal.
        """
        return self._sample_proposal().draw(size, rng, temperature=temperature)

    def draw_with_log_density(self, size: int, rng: Random) -> tuple[Array, Array]:
        """Return ``size`` new random points from the proposal, and its log density at each of them.

        The points, shape (size, h), are those of `draw`, and the log densities, shape (size,),
        those of `log_proposal`. Together they take less time than one after the other. Raise a
        `TypeError` for a lattice, which has no proposal.
        """
        return self._sample_proposal().draw_with_log_density(size, rng)

    def log_proposal(self, free: Array) -> Array:
        """Return the log density of a sample's proposal at n points, shape (n,).

        The proposal is the density from which the nodes of the sample were drawn. ``free``, shape
        (n, h), holds the points, in the same h coordinates as the nodes. Raise a `TypeError` for a
        lattice, which has no proposal.
        """
        return self._sample_proposal().log_density(free)

    def _sample_proposal(self) -> ProposalDensity:
        """Return the density from which the nodes (points) of this integral were drawn.

        Raise a `TypeError` if the nodes form a lattice, because they were then not drawn at random.
        """
        if self.proposal is None:
            raise TypeError("a lattice has no proposal to draw from. Use importance_sample.")
        return self.proposal

    def times(self, log_factor: Callable[[Index], Array], spare: float) -> Integral:
        """Return the integral ∫ f g, with ln g evaluated only at the nodes of largest weight.

        f is the density of this integral, and g is a further factor. The result has the same nodes
        (points) with other weights.

        Parameters
        ----------
        log_factor : callable
            Function that takes the indices of k nodes, shape (k,), and returns ln g at these nodes,
            shape (k,).
        spare : float
            Largest share of ∫ f that the nodes at which g is not evaluated may contribute. The
            contribution of these nodes to ∫ f g is estimated with the largest computed value of g,
            and is added to the error.
        """
        heavy = self._heavy_nodes(spare)
        values = np.full(len(self.free), -np.inf)
        factor = log_factor(heavy)
        values[heavy] = self.log_density[heavy] + factor
        product = replace(self, log_density=values)
        share = max(1.0 - float(self.weight[heavy].sum()), 0.0)
        log_ratio = factor.max() + self.log_integral - product.log_integral
        return replace(product, left_out=share * float(np.exp(log_ratio)))


def _sorted_by_coordinates(points: Array) -> Index:
    """Return the indices of points in the order of their last coordinate, shape (n,).

    ``points``, shape (n, h), holds n points in h dimensions. If several points have the same last
    coordinate, they are in the order of the last coordinate but one, and so on. Random points have
    different last coordinates, so that the other coordinates need not be sorted.
    """
    last = points[:, -1]
    order = np.argsort(last)
    if (np.diff(last[order]) > 0.0).all():
        return order
    return np.lexsort(points.T)


def in_chunks(log_density: Callable[..., Array], points: Array) -> Array:
    """Return a log density at n points, shape (n,), evaluated for at most 256 points at once.

    ``points`` is an array of length n. ``log_density`` is a function that takes some of the points
    and returns one number for each of them.
    """
    chunks = np.array_split(points, max(1, -(-len(points) // CHUNK)))
    return np.concatenate([log_density(chunk) for chunk in chunks])
