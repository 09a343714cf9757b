"""Criteria of optimum design: what a good set of tests makes large.

Let S, shape (..., s, s), be the precision of the s parameters of interest, in units in which they
are comparable, with all other parameters projected out (the Schur complement). Every criterion
takes its lower triangular root L, S = L Lᵀ, and has

- `value`, Φ(S) of shape (...), which never falls when information is added;
- `directions`, Q of shape (..., s, q) with ∂Φ/∂S = Q Qᵀ, which drive the search;
- `concave`: whether a local optimum over shares is the optimum;
- `efficiency`, 0 … 1, of a design relative to the best.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np

from ldbb_bayes.results import Array

__all__ = ["Criterion", "Determinant", "LogBayesFactor", "Variance"]

# Eigenvalues of W below this share of the largest are rounding errors.
_NEGLIGIBLE_EIGENVALUE = 1e-14


@dataclass(frozen=True)
class Determinant:
    """Φ = ln det S, the criteria D and D_s.

    With proper priors Φ/2 is the expected information gain [nat] up to a constant.
    """

    concave: ClassVar[bool] = True
    size: int  #: number of parameters of interest, s

    def value(self, root: Array) -> Array:
        """Return Φ, shape (...), from L, shape (..., s, s)."""
        diagonal = np.diagonal(root, axis1=-2, axis2=-1)
        return np.asarray(2.0 * np.log(diagonal).sum(axis=-1))

    def directions(self, root: Array) -> Array:
        """Return Q = L⁻ᵀ, shape (..., s, s)."""
        return _inverse_transposed(root)

    def efficiency(self, value: float, best: float) -> float:
        """Return (det S / det S*)^(1/s)."""
        return float(np.exp((value - best) / self.size))


@dataclass(frozen=True, eq=False)
class Variance:
    """Φ = −tr(W S⁻¹) with weights W, shape (s, s).

    Criterion A has W = 1, criterion c has W = c cᵀ, criterion I the mean of x xᵀ over what is to be
    predicted.
    """

    concave: ClassVar[bool] = True
    weight: Array  #: W, shape (s, s)

    def value(self, root: Array) -> Array:
        """Return Φ, shape (...), from L, shape (..., s, s)."""
        inverse = _inverse_transposed(root)
        return np.asarray(-np.einsum("ij,...jk,...ik->...", self.weight, inverse, inverse))

    def directions(self, root: Array) -> Array:
        """Return Q = S⁻¹ W^½, shape (..., s, rank of W)."""
        inverse = _inverse_transposed(root)
        eigenvalues, vectors = np.linalg.eigh(self.weight)
        positive = eigenvalues > _NEGLIGIBLE_EIGENVALUE * eigenvalues.max()
        weight_root = vectors[:, positive] * np.sqrt(eigenvalues[positive])
        return np.asarray(inverse @ np.swapaxes(inverse, -1, -2) @ weight_root)

    def efficiency(self, value: float, best: float) -> float:
        """Return the ratio of the weighted mean variances."""
        return float(best / value)


@dataclass(frozen=True)
class LogBayesFactor:
    """Φ = ¼ size² Σ λ²/(1 + λ), the expected ln B in favour of the truth.

    The parameters are there or not, both equally probable. S must be in units of the prior, with
    eigenvalues 1 + λ: scale ``rows`` and ``prior`` so that the prior alone is the identity. Where
    the parameters are ``size`` prior sd in the mean square, E[ln B] is
    ½ Σ [(1 + size² λ) λ/(1 + λ) − ln(1 + λ)]; where they are absent it is
    ½ Σ [λ/(1 + λ) − ln(1 + λ)]. Half the difference is Φ, which never falls. For one parameter it
    leads to the design of T-optimality. It is not concave: an optimum is a local one.
    """

    concave: ClassVar[bool] = False
    size: float = 1.0  #: of the parameters [prior sd]

    def value(self, root: Array) -> Array:
        """Return Φ, shape (...), from L, shape (..., s, s)."""
        gain = np.maximum(np.linalg.eigvalsh(_square(root)) - 1.0, 0.0)
        return np.asarray(0.25 * self.size**2 * (gain**2 / (1.0 + gain)).sum(axis=-1))

    def directions(self, root: Array) -> Array:
        """Return Q, the eigenvectors of S times the root of dΦ/d(1 + λ), shape (..., s, s)."""
        eigenvalues, vectors = np.linalg.eigh(_square(root))
        rate = 0.25 * self.size**2 * (1.0 - 1.0 / np.maximum(eigenvalues, 1.0) ** 2)
        return np.asarray(vectors * np.sqrt(rate)[..., None, :])

    def efficiency(self, value: float, best: float) -> float:
        """Return the ratio of the expected ln B."""
        return float(value / best)


Criterion: TypeAlias = Determinant | Variance | LogBayesFactor


def _square(root: Array) -> Array:
    """Return S = L Lᵀ."""
    return np.asarray(root @ np.swapaxes(root, -1, -2))


def _inverse_transposed(root: Array) -> Array:
    """Return L⁻ᵀ, whose square is S⁻¹."""
    identity = np.broadcast_to(np.eye(root.shape[-1]), root.shape)
    return np.linalg.solve(np.swapaxes(root, -1, -2), identity)
