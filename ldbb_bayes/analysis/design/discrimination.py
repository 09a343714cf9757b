"""TODO: say what this module is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri
from scipy.stats import qmc

from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.results import Array, Result

__all__ = ["DECISIVE", "Discrimination"]


DECISIVE = 5.0


_EACH = 256


_LEAST = 1e-12


@dataclass(frozen=True)
class Discrimination(Result):
    """What ln B(with the slopes / without) will be: its mean [nat] and the probabilities of
    decisive evidence for what is true, and for what is false, if there are slopes, and if there are
    none."""

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
    """What ln B will be, from the slopes' posterior covariances C (K, s, s) in units of their prior
    sd, one for every value of φ.

    ``before`` is their posterior after tests already run, in the same units; default: none were.
    With the mean m that the analysis will find, ln B = ½ (ln det C + mᵀ C⁻¹ m). With P₁ the
    precision before, C = L Lᵀ and Lᵀ P₁ L = U e Uᵀ, what z = Uᵀ L⁻¹ m consists of is independent:
    given slopes β with means e Uᵀ L⁻¹ m₁ + (1 − e) Uᵀ L⁻¹ β and variances 1 − e.
    """
    count, s = covariance.shape[:2]
    start = Gaussian.of(np.zeros((count, s)), np.ones((count, s))) if before is None else before
    root = np.linalg.cholesky(covariance)
    left, axes = np.linalg.eigh(np.swapaxes(root, 1, 2) @ start.precision @ root)
    left = np.clip(left, _LEAST, 1.0)
    learnt = 1.0 - left
    turn = np.linalg.solve(root @ axes, np.broadcast_to(np.eye(s), covariance.shape))
    log_volume = np.linalg.slogdet(covariance)[1]
    mean = np.einsum("kij,kj->ki", turn, start.mean)
    points = _points(count, s - 1, seed)

    def probability(centre: Array, variance: Array, level: float) -> float:
        """P(ln B > level), z of these means (K, 1 or 2, s), which the points take in turn, and
        variances (K, s)."""
        first = np.argsort(-variance, axis=1)[:, None]
        sd = np.sqrt(np.maximum(np.take_along_axis(variance[:, None], first, axis=2), _LEAST))
        own = np.take_along_axis(centre, first, axis=2)[
            :, np.arange(points.shape[1]) % centre.shape[1]
        ]
        rest = (
            2.0 * level
            - log_volume[:, None]
            - ((own[..., 1:] + sd[..., 1:] * points) ** 2).sum(axis=2)
        )
        # The component of the largest variance is integrated out.
        edge = np.sqrt(np.maximum(rest, 0.0)) / sd[..., 0]
        middle = own[..., 0] / sd[..., 0]
        return float(np.where(rest > 0.0, ndtr(-edge - middle) + ndtr(middle - edge), 1.0).mean())

    there = mean[:, None], learnt * (1.0 + learnt * (size**2 if before is None else 1.0) / left)
    nothing = (left * mean)[:, None], learnt
    expected = [
        0.5 * (log_volume + (own[:, 0] ** 2 + variance).sum(axis=1)).mean()
        for own, variance in (there, nothing)
    ]
    moved = (
        size
        * np.array([1.0, -1.0])[:, None]
        * (learnt[:, None] * np.swapaxes(turn, 1, 2))[:, :, None]
    )
    return Discrimination(
        size,
        before is not None,
        threshold,
        float(expected[0]),
        float(expected[1]),
        probability(*there, threshold),
        1.0 - probability(*nothing, -threshold),
        1.0 - probability(*there, -threshold),
        probability(*nothing, threshold),
        {
            name: probability(nothing[0] + moved[:, j], learnt, threshold)
            for j, name in enumerate(names)
        },
    )


def _points(count: int, dimensions: int, seed: int) -> Array:
    """Standard normal points, shape (count, _EACH, dimensions): quasi-random ones, moved at random
    for each."""
    rng = np.random.default_rng(seed)
    points = qmc.Sobol(dimensions, rng=rng).random(_EACH) if dimensions else np.zeros((_EACH, 0))
    return np.asarray(ndtri((points + rng.random((count, 1, dimensions))) % 1.0))
