"""Constant or linear: the evidence that tests will give for or against the slopes.

The evidence is of the linear Gaussian model without truncation, averaged over the
hyper-parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri
from scipy.stats import qmc

from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.results import Array, Result

__all__ = ["DECISIVE", "Discrimination", "discrimination_of"]

# |ln B| from which evidence is called decisive [nat] (Kass and Raftery 1995: "very strong").
DECISIVE = 5.0
# Quasi-random points for every value of the hyper-parameters.
_POINTS = 256
# Least variance of a component: it is divided by.
_LEAST_VARIANCE = 1e-12


@dataclass(frozen=True)
class Discrimination(Result):
    """What ln B(with the slopes / without) will be.

    Its mean [nat], and the probabilities of decisive evidence for what is true and for what is
    false, if there are slopes and if there are none.
    """

    size: float  #: of the slopes, in prior sd
    #: tests already run are part of it: slopes are as those leave them, else drawn from their prior
    #: × ``size``
    augmented: bool
    threshold: float  #: |ln B| from which evidence is called decisive [nat]
    expected_with: float
    expected_without: float
    decisive_with: float
    decisive_without: float
    misleading_with: float
    misleading_without: float
    #: probability of decisive evidence if this slope alone is there, of plus or minus ``size``
    #: prior sd
    power: dict[str, float]


def discrimination_of(
    covariance: Array,
    names: tuple[str, ...],
    *,
    size: float,
    before: Gaussian | None = None,
    threshold: float = DECISIVE,
    seed: int = 1,
) -> Discrimination:
    """Return what ln B will be, from the posterior covariances of the slopes.

    With the mean m that the analysis will find, ln B = ½ (ln det C + mᵀ C⁻¹ m). With P₁ the
    precision before, C = L Lᵀ and Lᵀ P₁ L = U e Uᵀ, the components of z = Uᵀ L⁻¹ m are independent:
    given slopes β their means are e Uᵀ L⁻¹ m₁ + (1 − e) Uᵀ L⁻¹ β and their variances 1 − e.

    Parameters
    ----------
    covariance
        C, shape (K, s, s), in units of the slopes' prior sd, one for every value of φ.
    names
        Of the slopes, (s,).
    size
        Of the slopes, in prior sd.
    before
        Posterior of the slopes after tests already run, in the same units; default: none were.
    threshold
        |ln B| of decisive evidence [nat].
    seed
        Of the quasi-random points.

    Returns
    -------
    Discrimination
        Expected evidence and probabilities.
    """
    nodes, s = covariance.shape[:2]
    start = before
    slope_variance = 1.0
    if start is None:
        start = Gaussian.of(np.zeros((nodes, s)), np.ones((nodes, s)))
        slope_variance = size**2
    root = np.linalg.cholesky(covariance)
    remaining, axes = np.linalg.eigh(np.swapaxes(root, 1, 2) @ start.precision @ root)
    remaining = np.clip(remaining, _LEAST_VARIANCE, 1.0)  # e: share of the variance that remains
    learnt = 1.0 - remaining
    to_components = np.linalg.solve(root @ axes, np.broadcast_to(np.eye(s), covariance.shape))
    mean = np.einsum("kij,kj->ki", to_components, start.mean)
    log_volume = np.linalg.slogdet(covariance)[1]
    evidence = _LogBayesFactorDistribution(log_volume, _normal_points(nodes, s - 1, seed))

    mean_with = mean[:, None]
    variance_with = learnt * (1.0 + learnt * slope_variance / remaining)
    mean_without = (remaining * mean)[:, None]
    variance_without = learnt
    both_signs = size * np.array([1.0, -1.0])[:, None]
    shift = both_signs * (learnt[:, None] * np.swapaxes(to_components, 1, 2))[:, :, None]
    power = {}
    for j, name in enumerate(names):
        mean_with_slope = mean_without + shift[:, j]
        power[name] = evidence.probability_above(threshold, mean_with_slope, learnt)
    return Discrimination(
        size=size,
        augmented=before is not None,
        threshold=threshold,
        expected_with=evidence.expected(mean_with, variance_with),
        expected_without=evidence.expected(mean_without, variance_without),
        decisive_with=evidence.probability_above(threshold, mean_with, variance_with),
        decisive_without=1.0
        - evidence.probability_above(-threshold, mean_without, variance_without),
        misleading_with=1.0 - evidence.probability_above(-threshold, mean_with, variance_with),
        misleading_without=evidence.probability_above(threshold, mean_without, variance_without),
        power=power,
    )


@dataclass(frozen=True, eq=False)
class _LogBayesFactorDistribution:
    """Distribution of ln B = ½ (ln det C + Σ z²), the components z normal and independent."""

    log_volume: Array  # ln det C, (K,)
    points: Array  # standard normal, (K, points, s − 1)

    def expected(self, mean: Array, variance: Array) -> float:
        """Return E[ln B] for z of these means (K, 1, s) and variances (K, s)."""
        squares = (mean[:, 0] ** 2 + variance).sum(axis=1)
        return float(0.5 * (self.log_volume + squares).mean())

    def probability_above(self, level: float, mean: Array, variance: Array) -> float:
        """Return P(ln B > level) for z of these means (K, 1 or 2, s) and variances (K, s).

        The points take the one or two means in turn.
        """
        order = np.argsort(-variance, axis=1)[:, None]
        sorted_variance = np.take_along_axis(variance[:, None], order, axis=2)
        sd = np.sqrt(np.maximum(sorted_variance, _LEAST_VARIANCE))
        mean_of_point = np.arange(self.points.shape[1]) % mean.shape[1]
        centre = np.take_along_axis(mean, order, axis=2)[:, mean_of_point]
        squares = ((centre[..., 1:] + sd[..., 1:] * self.points) ** 2).sum(axis=2)
        # The component of the largest variance is integrated out.
        needed_square = 2.0 * level - self.log_volume[:, None] - squares
        edge = np.sqrt(np.maximum(needed_square, 0.0)) / sd[..., 0]
        middle = centre[..., 0] / sd[..., 0]
        both_tails = ndtr(-edge - middle) + ndtr(middle - edge)
        return float(np.where(needed_square > 0.0, both_tails, 1.0).mean())


def _normal_points(nodes: int, dimensions: int, seed: int) -> Array:
    """Return standard normal points, shape (nodes, points, dimensions).

    They are quasi-random, with a random shift at every node.
    """
    rng = np.random.default_rng(seed)
    points = np.zeros((_POINTS, 0))
    if dimensions:
        points = qmc.Sobol(dimensions, rng=rng).random(_POINTS)
    return np.asarray(ndtri((points + rng.random((nodes, 1, dimensions))) % 1.0))
