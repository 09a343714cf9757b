"""How often a campaign will settle constant against linear compliance: the distribution of ln B before any further reading.

At given hyper-parameters ln B = ½ ln |C| + ½ mᵀ C⁻¹ m (Savage-Dickey), m and C the posterior mean and covariance of the slopes in
units of their prior. Before the tests C is known, and m given slopes s is N(m₁ + W (s − m₁), G − W G), with m₁ and C₁ what is
known of the slopes, G = C₁ − C and W = G C₁⁻¹. Truncation is set aside.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.model.gaussian import singular_root

__all__ = ["DECISIVE", "Discrimination", "discrimination_of"]

Array = NDArray[Any]
DECISIVE = 5.0
_DRAWS = 2048


@dataclass(frozen=True)
class Discrimination:
    """What ln B(with the slopes / without) will be.

    Attributes
    ----------
    size : float
        Of the slopes, in prior sd.
    augmented : bool
        Whether tests already run are part of it: "with" then means slopes as those leave them, else drawn from their prior times
        ``size``.
    threshold : float
        |ln B| from which evidence is called decisive [nat].
    expected_with, expected_without : float
        Mean of ln B if there are slopes, and if there are none [nat].
    decisive_with, decisive_without : float
        Probabilities of decisive evidence for what is true.
    misleading_with, misleading_without : float
        Probabilities of decisive evidence for what is false.
    power : mapping of slope to float
        Probability of decisive evidence for slopes if this one alone is there, of plus or minus ``size`` prior sd.
    """

    size: float
    augmented: bool
    threshold: float
    expected_with: float
    expected_without: float
    decisive_with: float
    decisive_without: float
    misleading_with: float
    misleading_without: float
    power: Mapping[str, float]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**vars(self), "power": dict(self.power)}


def discrimination_of(
    covariance: Array,
    names: tuple[str, ...],
    *,
    size: float,
    before: tuple[Array, Array] | None = None,
    threshold: float = DECISIVE,
    seed: int = 1,
) -> Discrimination:
    """From the posterior covariances of the slopes.

    Parameters
    ----------
    covariance : ndarray, shape (K, s, s)
        In units of the slopes' prior sd, one for every value of the hyper-parameters.
    before : tuple of ndarray, shape (K, s) and (K, s, s), optional
        Posterior mean and covariance of the slopes after tests already run; default: none were.
    """
    count, s = covariance.shape[:2]
    mean, known = (np.zeros((count, s)), np.broadcast_to(np.eye(s), covariance.shape)) if before is None else before
    gained = known - covariance
    weight = np.swapaxes(np.linalg.solve(known, gained), 1, 2)
    root = singular_root(gained - weight @ gained)
    log_volume = np.linalg.slogdet(covariance)[1]
    rng = np.random.default_rng(seed)
    noise = np.einsum("kij,kdj->kdi", root, rng.standard_normal((count, _DRAWS, s)))

    def log_bayes_factor(slopes: Array) -> Array:
        centre = mean[:, None] + np.einsum("kij,kdj->kdi", weight, slopes - mean[:, None])
        found = np.swapaxes(centre + noise, 1, 2)
        square = (found * np.linalg.solve(covariance, found)).sum(axis=1)
        return 0.5 * (log_volume[:, None] + square)

    drawn = rng.standard_normal((count, _DRAWS, s))
    there = size * drawn if before is None else mean[:, None] + np.einsum("kij,kdj->kdi", singular_root(known), drawn)
    with_, without = log_bayes_factor(there), log_bayes_factor(np.zeros((count, 1, s)))
    sign = np.where(np.arange(_DRAWS) % 2, 1.0, -1.0)[None, :, None]
    alone = {name: log_bayes_factor(size * sign * np.eye(s)[j]) for j, name in enumerate(names)}
    return Discrimination(
        size,
        before is not None,
        threshold,
        float(with_.mean()),
        float(without.mean()),
        float((with_ > threshold).mean()),
        float((without < -threshold).mean()),
        float((with_ < -threshold).mean()),
        float((without > threshold).mean()),
        {name: float((values > threshold).mean()) for name, values in alone.items()},
    )
