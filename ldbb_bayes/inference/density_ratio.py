"""Integral of a density g, computed from its ratio to a similar density f at a few points.

The integral ∫ f is known from an earlier calculation, as a sum over n weighted nodes φ_i (points)
in h dimensions. If E_f is the mean under the density f, then

    ∫ g = ∫ f · E_f[g / f].

The ratio g / f is smooth and varies little. It is therefore evaluated only at a small random sample
of the n nodes. The sample has at most 192 nodes; if the error is too large, it is enlarged to at
most 576, 1152 and then 4608 nodes. The nodes are drawn by systematic sampling with unequal
probabilities. A polynomial q(φ) is fitted to the values of ln(g / f); its degree is two, or one if
there are many dimensions. The density f e^q is known at all nodes, and

    ∫ g = ∫ f e^q · E[g / (f e^q)],

where the last factor is the weighted mean over the sample of ρ = g / (f e^q). The scatter of ρ,
which is small, gives the error of the mean. This method is the regression estimator of survey
sampling (Cochran, Sampling Techniques, 1977, chapter 7; Särndal, Swensson and Wretman, Model
Assisted Survey Sampling, 1992). The estimator does not assume that q fits well: a poor fit only
makes the error larger. Averages under g are computed with the weights that the nodes have under the
density f e^q.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import logsumexp

from ldbb_bayes.inference.diagnostics import pareto_k
from ldbb_bayes.inference.integrals import LARGEST_PARETO_K, Index, Integral
from ldbb_bayes.results import Array

__all__ = ["LogValues", "RatioIntegral", "RatioSampler"]

# Size of the largest sample of nodes. Nodes are the points at which the density with the known
# integral was evaluated. They are picked at random, and the same node can be picked repeatedly.
_LARGEST_SAMPLE = 4608
# There are four samples of nodes (points). The largest has ``_LARGEST_SAMPLE`` nodes; the others
# consist of every 4th, 8th and 24th of these nodes. If the error with a sample is too large,
# the next larger sample is used.
_STEPS = (24, 8, 4, 1)
# A sample of nodes (points) is used only if the integral has at least this many nodes for each node
# of the sample.
_NODES_PER_SAMPLE = 2
# Largest number of coefficients of the fitted polynomial, as a fraction of the number of nodes
# (points) to which the polynomial is fitted.
_LARGEST_SHARE_OF_COEFFICIENTS = 0.5
# A node (weighted point) is picked with a probability that is the mean of two probabilities. One of
# them is proportional to the weight of the node, the other to this power of the weight. The power
# makes it more probable that nodes with small weights, in the tails of the density, are picked.
_TAIL_POWER = 0.5
# A polynomial may be fitted by a singular value decomposition of a matrix, whose columns hold the
# terms of the polynomial at the sampled points. Singular values below this fraction of the largest
# one count as zero. Such small values mean that the terms are linearly dependent at these points,
# apart from rounding errors.
_DEPENDENT = 1e-10
# A polynomial is fitted by a Cholesky factorisation, which is quicker, if its smallest pivot is
# above this fraction of the largest one. The squares of pivots are then far above rounding errors.
_NEARLY_DEPENDENT = 1e-5
# The mean of the ratios of two densities is trusted if the standard deviation of the ratios is at
# most this fraction of the mean. If the ratios scatter more, a sample of a few hundred nodes
# (points) may miss the largest ratios.
_LARGEST_SCATTER = 0.4
# The mean of the ratios of two densities is not trusted if ln(ratio / mean) exceeds this value for
# any ratio. The square of such a large ratio might overflow.
_LARGEST_LOG_RATIO = 50.0
# The tail of the ratios of two densities is examined only if the largest value of (ratio − mean) /
# mean is at least this value.
_LARGEST_PLAIN_RESIDUAL = 1.0
# The error that is reported for the mean of the ratios of two densities is the standard error of
# the mean, times this factor.
_STANDARD_ERRORS = 3.5


class LogValues(NamedTuple):
    """Logarithm of a density at k nodes (points) and its numerical error [nat], each of shape (k,).

    The values of the density may also have noise: random errors of mean zero that are independent
    between nodes. ``error`` does not include this noise. The noise makes the ratios of two
    densities scatter from node to node. The error of the mean ratio is computed from this scatter,
    and thus already takes the noise into account.
    """

    log_density: Array  #: logarithm of a density at k nodes (points), shape (k,)
    #: numerical error of the logarithm of a density at each of k nodes (points) [nat], shape (k,);
    #: numerical errors may be common to all nodes, and need not cancel in a mean over nodes
    error: Array


class RatioIntegral(NamedTuple):
    """Integral of a density, computed with the nodes (weighted points) of a similar density.

    The similar density may be the density itself. The values at its nodes then have no error.
    """

    integral: Integral  #: integral of a density, with its nodes (weighted points)
    #: numerical error of the log density to be integrated, averaged over the weighted nodes
    #: (points) [nat]
    value_error: float

    @property
    def error(self) -> float:
        """Error of the log integral of a density, including errors of the density itself [nat]."""
        return self.integral.error + self.value_error

    def meets(self, tolerance: float) -> bool:
        """Return whether the error of the log integral is small enough for the tolerance [nat].

        The error has two parts: the error of the integral over the nodes, and that of the density
        at the nodes. In general, the sum of the two parts must not exceed the tolerance. If the
        second part alone is half the tolerance or more, more nodes would hardly reduce the sum. In
        this case, only the error of the integral is compared with the tolerance.
        """
        if self.value_error >= tolerance / 2.0:
            return self.integral.error <= tolerance
        return self.integral.error <= tolerance - self.value_error

    @property
    def least_error(self) -> float:
        """Error that the log integral would have if the density were evaluated at all nodes [nat].

        Nodes are weighted points. The density is evaluated only at a sample of them, which makes
        the error of the log integral larger.
        """
        return replace(self.integral, ratio_error=0.0).error + self.value_error


@dataclass(frozen=True, eq=False)
class _Sample:
    """Random sample of m nodes (points) of an integral ∫ f, at which polynomials can be fitted.

    A node that was picked several times occurs once in the sample, with a larger ``weight``.
    """

    #: indices of the m nodes (points) of the sample among all n nodes of an integral, shape (m,)
    nodes: Index
    #: weight of each of m sampled nodes (points) in the fit of a polynomial, shape (m,). It is the
    #: node's weight in the integral, divided by the probability of picking the node, times the
    #: number of times that it was picked.
    weight: Array
    #: result of integrating a density over n nodes (points), from which the m nodes of the sample
    #: were picked
    integral: Integral
    #: degree, 1 or 2, of a polynomial that is fitted to values at the nodes (points) of the sample
    degree: int

    @cached_property
    def polynomial_terms(self) -> Array:
        """Terms of a polynomial, such as x and x y, at all n nodes (points), shape (n, terms)."""
        return _polynomial_terms(self.integral, self.degree)

    @cached_property
    def _decomposition(self) -> _Decomposition:
        """Decomposition of the matrix with which a polynomial is fitted.

        The matrix has a row for each of the m nodes (points) to which the polynomial is fitted, and
        a column for each term of the polynomial.
        """
        return _decompose(self.polynomial_terms[self.nodes] * np.sqrt(self.weight)[:, None])

    @cached_property
    def leverage(self) -> Array:
        """Leverages of the m nodes (points) in the fit of a polynomial, shape (m,).

        The polynomial is fitted to one value at each node. The leverage of a node is the change of
        the polynomial at the node if the value at this node increases by one.
        """
        leverage = (self._decomposition.orthonormal**2).sum(axis=1)
        return np.asarray(np.minimum(leverage, 1.0 - np.finfo(float).eps))

    def fit(self, values: Array) -> Array:
        """Fit a polynomial at the m sampled nodes and return its values at all n nodes, shape (n,).

        Nodes are weighted points. The polynomial is fitted to ``values``, one value at each sampled
        node, shape (m,). The result is limited to an interval three times as wide as the range of
        ``values``, so that the polynomial is not extrapolated too far.
        """
        projected = self._decomposition.orthonormal.T @ (values * np.sqrt(self.weight))
        fitted = self.polynomial_terms @ (self._decomposition.coefficients @ projected)
        margin = np.ptp(values)
        return np.asarray(np.clip(fitted, values.min() - margin, values.max() + margin))


class _Decomposition(NamedTuple):
    """Matrix X with which a polynomial is fitted, written as orthonormal columns U = X C.

    The polynomial is fitted at m nodes (points). Row i of the matrix X belongs to node i. It holds
    the terms of the polynomial (such as x, y and x y) times the square root of the node's weight.
    """

    #: matrix U with orthonormal columns, which span the columns of X, shape (m, rank)
    orthonormal: Array
    #: matrix C, shape (terms, rank): the polynomial's coefficients that belong to each column of U
    coefficients: Array


def _decompose(matrix: Array) -> _Decomposition:
    """Decompose a matrix with which a polynomial is fitted, shape (m, terms).

    If the columns are linearly independent, the decomposition follows from the Cholesky factor L of
    XᵀX, as X L⁻ᵀ has orthonormal columns. Otherwise, a singular value decomposition is computed,
    which takes several times longer. Singular values that are zero except for rounding errors are
    left out.
    """
    with suppress(np.linalg.LinAlgError):
        root = np.linalg.cholesky(matrix.T @ matrix)
        pivots = np.diagonal(root)
        if pivots.min() > _NEARLY_DEPENDENT * pivots.max():
            orthonormal = solve_triangular(root, matrix.T, lower=True).T
            coefficients = solve_triangular(root, np.eye(len(root)), lower=True).T
            return _Decomposition(orthonormal, coefficients)
    u, singular, v_transposed = np.linalg.svd(matrix, full_matrices=False)
    is_nonzero = singular > _DEPENDENT * singular[0]
    coefficients = v_transposed[is_nonzero].T / singular[is_nonzero]
    return _Decomposition(u[:, is_nonzero], coefficients)


class _MeanRatio(NamedTuple):
    """Mean of the ratio ρ = g / (f e^q) of two densities, computed at a sample of m points (nodes).

    f is a density that is similar to g, and q is a polynomial fitted to ln(g / f). The mean is
    taken under the density f e^q.
    """

    #: logarithm of the mean of the ratio ρ = g / (f e^q). Here f and g are two similar densities,
    #: and q is a polynomial fitted to ln(g / f).
    log_mean: float
    #: error of ``log_mean``, the logarithm of the mean ratio of two densities [nat]; infinite if
    #: the distribution of the ratios has a heavy tail
    error: float
    #: weights of the m nodes (points) over which the ratio of two densities is averaged, shape
    #: (m,). The weights sum to one.
    share: Array


def _mean_ratio(sample: _Sample, log_ratio: Array, fitted: Array) -> _MeanRatio:
    """Return the mean of the ratio ρ = g / (f e^q) of densities, and its error.

    f and g are similar densities, and q is a polynomial that is fitted to ln(g / f) at the m nodes
    (points) of ``sample``. ``log_ratio`` and ``fitted``, shape (m,), are ln(g / f) and q at these
    nodes. The mean is taken under the density f e^q.

    The error of the mean is computed from the residuals, the deviations of ρ from the mean.
    Residuals at the nodes to which q is fitted are smaller than residuals at other nodes. Each
    residual is therefore divided by one minus the leverage of its node. The error is then too large
    rather than too small (MacKinnon and White, Journal of Econometrics 29 (1985) 305).
    """
    share = sample.weight * np.exp(fitted - fitted.max())
    share = share / share.sum()
    log_residual = log_ratio - fitted
    log_mean = float(logsumexp(log_residual, b=share))
    if log_residual.max() - log_mean > _LARGEST_LOG_RATIO:
        return _MeanRatio(log_mean, np.inf, share)
    residual = np.expm1(log_residual - log_mean)
    error = np.inf
    if _is_trusted(share, residual, log_residual):
        enlarged_residual = residual / (1.0 - sample.leverage)
        error = _STANDARD_ERRORS * float(np.linalg.norm(share * enlarged_residual))
    return _MeanRatio(log_mean, error, share)


def _is_trusted(share: Array, residual: Array, log_residual: Array) -> bool:
    """Return whether the mean of the ratios ρ of two densities can be trusted.

    The ratios are known at m nodes (points). Their mean can be trusted if the ratios scatter little
    and have no heavy tail. ``share`` holds the weights of the nodes, ``residual`` holds the
    relative deviations of ρ from its mean, and ``log_residual`` holds ln ρ. All have the shape
    (m,).
    """
    if share @ residual**2 > _LARGEST_SCATTER**2:
        return False
    return residual.max() < _LARGEST_PLAIN_RESIDUAL or pareto_k(log_residual) <= LARGEST_PARETO_K


class RatioSampler:
    """Method that computes the integral of a density g from the known integral of a density f.

    The two densities are similar, so that the ratio g / f at a few points suffices. The same f can
    serve for several densities g.

    Parameters
    ----------
    integral : Integral
        Integral of the density f, with its n nodes (weighted points).
    seed : int
        Seed of the random selection of nodes at which g is evaluated.
    """

    def __init__(self, integral: Integral, *, seed: int = 0) -> None:
        """Store the known integral ∫ f of a density f, and a seed of random numbers.

        ``integral`` also holds the nodes, the weighted points from which ∫ f was computed. ``seed``
        is the seed of the random selection of some of these nodes.
        """
        #: known integral of the density f, with its n nodes (weighted points)
        self.integral = integral
        self._seed = seed

    @cached_property
    def _samples(self) -> list[_Sample]:
        """Samples of the nodes (weighted points) of the integral ∫ f, the smallest sample first.

        Each sample contains all smaller samples.
        """
        weight = self.integral.weight
        probability = _pick_probabilities(weight)
        drawn = _systematic_sample(probability, np.random.default_rng(self._seed))
        samples = []
        for step in _STEPS:
            nodes, count = np.unique(drawn[::step], return_counts=True)
            degree = _largest_degree(self.integral.free.shape[1], len(nodes))
            if len(weight) >= _NODES_PER_SAMPLE * len(nodes) and degree > 0:
                sample_weight = count * weight[nodes] / probability[nodes]
                samples.append(_Sample(nodes, sample_weight, self.integral, degree))
        return samples

    def integrate(
        self, evaluate: Callable[[Index], LogValues], tolerance: float
    ) -> RatioIntegral | None:
        """Return the integral of a density g, computed from g / f at a sample of the nodes.

        f is a density that is similar to g, and its integral is known as a sum over weighted nodes
        (points).

        Parameters
        ----------
        evaluate : callable
            Function that takes indices of nodes, and returns ln g and its error at these nodes.
        tolerance : float
            Error allowed in ln ∫ g [nat].

        Returns
        -------
        RatioIntegral or None
            The integral, or None if no sample of the nodes reaches the tolerance. If the result is
            None, g should be evaluated at all nodes, or the integral of g should be computed from
            new nodes.
        """
        for attempt in self.attempts(evaluate):
            if attempt.error <= tolerance:
                return attempt
            if attempt.least_error > tolerance:
                return None
        return None

    def attempts(self, evaluate: Callable[[Index], LogValues]) -> Iterator[RatioIntegral]:
        """Yield the integral of a density g, computed from larger and larger samples of the nodes.

        f is a density that is similar to g, and its integral is known as a sum over weighted nodes
        (points). ``evaluate`` takes indices of nodes, and returns ln g and its error at these
        nodes. There are no further attempts if g is zero at a node of a sample.
        """
        log_density = np.full(len(self.integral.free), np.nan)
        error = np.full(len(log_density), np.nan)
        for sample in self._samples:
            new = sample.nodes[np.isnan(log_density[sample.nodes])]
            values = evaluate(new)
            log_density[new] = values.log_density
            error[new] = values.error
            log_ratio = log_density[sample.nodes] - self.integral.log_density[sample.nodes]
            if not np.isfinite(log_ratio).all():
                return
            fitted = sample.fit(log_ratio)
            mean = _mean_ratio(sample, log_ratio, fitted[sample.nodes])
            integral = replace(
                self.integral,
                log_density=self.integral.log_density + fitted + mean.log_mean,
                ratio_error=mean.error,
            )
            yield RatioIntegral(integral, float(mean.share @ error[sample.nodes]))


def _pick_probabilities(weight: Array) -> Array:
    """Return the probability with which each of n nodes (weighted points) is picked, shape (n,).

    ``weight``, shape (n,), holds the weights of the nodes, which sum to one. The result is the mean
    of two probabilities: one is proportional to the weight of the node, the other to the square
    root of the weight.
    """
    tempered = weight**_TAIL_POWER
    return 0.5 * weight + 0.5 * tempered / tempered.sum()


def _systematic_sample(probability: Array, rng: np.random.Generator) -> Index:
    """Return the indices of the nodes that are picked at random; an index may occur repeatedly.

    ``probability`` holds the probabilities with which the nodes are picked; they sum to one. The
    nodes are put in random order (``rng``) and picked at equally spaced values of the cumulative
    probability. If only every 4th, 8th or 24th of the picked nodes is used, these nodes also form
    a systematic sample.
    """
    order = rng.permutation(len(probability))
    levels = (rng.random() + np.arange(_LARGEST_SAMPLE)) / _LARGEST_SAMPLE
    reached = np.searchsorted(np.cumsum(probability[order]), levels)
    return order[np.minimum(reached, len(order) - 1)]


def _largest_degree(dimensions: int, size: int) -> int:
    """Return the degree (0, 1 or 2) of a polynomial that is to be fitted to ``size`` values.

    The degree is the largest one for which the polynomial has at most half as many coefficients as
    there are values. ``dimensions`` is the number of variables of the polynomial.
    """
    coefficients_by_degree = {
        1: 1 + dimensions,
        2: 1 + dimensions + dimensions * (dimensions + 1) // 2,
    }
    largest = _LARGEST_SHARE_OF_COEFFICIENTS * size
    return max((d for d, count in coefficients_by_degree.items() if count <= largest), default=0)


def _polynomial_terms(integral: Integral, degree: int) -> Array:
    """Return the terms of a polynomial at the n nodes of ``integral``, shape (n, coefficients).

    Nodes are points. The terms are all products of at most ``degree`` (1 or 2) coordinates of a
    node. The coordinates are first scaled to the mean zero and the standard deviation one.
    """
    deviation = integral.free - integral.weight @ integral.free
    scale = np.sqrt(integral.weight @ deviation**2)
    z = deviation / np.where(scale > 0.0, scale, 1.0)
    columns = [np.ones((len(z), 1)), z]
    if degree > 1:
        columns += [z[:, [k]] * z[:, k:] for k in range(z.shape[1])]
    return np.concatenate(columns, axis=1)
