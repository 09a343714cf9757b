"""TODO: say what this module is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np

from ldbb_bayes.results import Array

__all__ = ["Criterion", "Determinant", "LogBayesFactor", "Variance"]


_NEGLIGIBLE = 1e-14


@dataclass(frozen=True)
class Determinant:
    """Φ = ln det S: D and D_s; with proper priors Φ/2 is the expected information gain but for a
    constant [nat]."""

    concave: ClassVar[bool] = True
    size: int

    def value(self, root: Array) -> Array:
        return np.asarray(2.0 * np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1))

    def directions(self, root: Array) -> Array:
        return _inverse_transposed(root)

    def efficiency(self, value: float, best: float) -> float:
        """(det S / det S*)^(1/s), s the number of parameters."""
        return float(np.exp((value - best) / self.size))


@dataclass(frozen=True, eq=False)
class Variance:
    """Φ = −tr(W S⁻¹), W (s, s): A (W = 1), c (W = c cᵀ), I (W the mean of x xᵀ over what is to be
    predicted)."""

    concave: ClassVar[bool] = True
    weight: Array

    def value(self, root: Array) -> Array:
        inverse = _inverse_transposed(root)
        return np.asarray(-np.einsum("ij,...jk,...ik->...", self.weight, inverse, inverse))

    def directions(self, root: Array) -> Array:
        """S⁻¹ W^½."""
        inverse = _inverse_transposed(root)
        values, vectors = np.linalg.eigh(self.weight)
        kept = values > _NEGLIGIBLE * values.max()
        return np.asarray(
            inverse @ np.swapaxes(inverse, -1, -2) @ (vectors[:, kept] * np.sqrt(values[kept]))
        )

    def efficiency(self, value: float, best: float) -> float:
        """Ratio of the mean variances."""
        return float(best / value)


@dataclass(frozen=True)
class LogBayesFactor:
    """Φ = the expected ln B in favour of the truth, with the parameters or without them, both
    equally probable.

    S must be in units of the prior, eigenvalues 1 + λ: scale ``rows`` and ``prior`` so that the
    prior alone is the identity. If parameters are ``size`` prior sd in the mean square, E[ln B] is
    ½ Σ [(1 + size² λ) λ/(1 + λ) − ln(1 + λ)], and ½ Σ [λ/(1 + λ) − ln(1 + λ)] if they are not
    there; half the difference is Φ = ¼ size² Σ λ²/(1 + λ), which never falls. For one parameter it
    leads to the design of T-optimality. Not concave: an optimum is a local one.
    """

    concave: ClassVar[bool] = False
    size: float = 1.0

    def value(self, root: Array) -> Array:
        gain = np.maximum(np.linalg.eigvalsh(_square(root)) - 1.0, 0.0)
        return np.asarray(0.25 * self.size**2 * (gain**2 / (1.0 + gain)).sum(axis=-1))

    def directions(self, root: Array) -> Array:
        """The eigenvectors times the root of dΦ/d(1 + λ)."""
        s, vectors = np.linalg.eigh(_square(root))
        rate = 0.25 * self.size**2 * (1.0 - 1.0 / np.maximum(s, 1.0) ** 2)
        return np.asarray(vectors * np.sqrt(rate)[..., None, :])

    def efficiency(self, value: float, best: float) -> float:
        return float(value / best)


Criterion: TypeAlias = Determinant | Variance | LogBayesFactor


def _square(root: Array) -> Array:
    return np.asarray(root @ np.swapaxes(root, -1, -2))


def _inverse_transposed(root: Array) -> Array:
    """L⁻ᵀ, whose square is S⁻¹."""
    return np.linalg.solve(
        np.swapaxes(root, -1, -2), np.broadcast_to(np.eye(root.shape[-1]), root.shape)
    )
