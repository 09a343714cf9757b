"""What a design is good for: functions of S, the information about the parameters of interest with all others projected out.

S, shape (..., s, s), is the posterior precision of the s parameters of interest, in units in which they are comparable: the Schur
complement of the whole precision matrix. It comes as its lower triangular root, S = L Lᵀ. A criterion is to be made large; the
directions Q in which it grows, ∂Φ/∂S = Q Qᵀ, drive the search.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["Criterion", "Determinant", "Evidence", "SmallestEigenvalue", "Variance"]

Array = NDArray[Any]
_NEGLIGIBLE = 1e-14


class Criterion(Protocol):
    """A criterion Φ(S) that never falls when information is added."""

    @property
    def concave(self) -> bool:
        """Whether a local optimum over weights is the optimum."""
        ...

    def value(self, root: Array) -> Array:
        """Φ(S), shape (...)."""
        ...

    def directions(self, root: Array) -> Array:
        """Q with ∂Φ/∂S = Q Qᵀ, shape (..., s, q)."""
        ...

    def efficiency(self, value: float, best: float) -> float:
        """How good a design of this value is beside the best of the same number of tests, 0 … 1."""
        ...


@dataclass(frozen=True)
class Determinant:
    """Φ = ln det S: D and D_s; with proper priors Φ/2 is the expected information gain but for a constant [nat]."""

    size: int
    concave: bool = True

    def value(self, root: Array) -> Array:
        """Φ(S), shape (...)."""
        return np.asarray(2.0 * np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1))

    def directions(self, root: Array) -> Array:
        """L⁻ᵀ."""
        return _inverse_transposed(root)

    def efficiency(self, value: float, best: float) -> float:
        """(det S / det S*)^(1/s), s the number of parameters."""
        return float(np.exp((value - best) / self.size))


@dataclass(frozen=True, eq=False)
class Variance:
    """Φ = −tr(W S⁻¹): A (W = 1), c (W = c cᵀ), I (W the mean of x xᵀ over what is to be predicted).

    Attributes
    ----------
    weight : ndarray, shape (s, s)
        W, positive semi-definite.
    """

    weight: Array
    concave: bool = True

    def value(self, root: Array) -> Array:
        """Φ(S), shape (...)."""
        inverse = _inverse_transposed(root)
        return np.asarray(-np.einsum("ij,...jk,...ik->...", self.weight, inverse, inverse))

    def directions(self, root: Array) -> Array:
        """S⁻¹ W^½."""
        inverse = _inverse_transposed(root)
        return np.asarray(inverse @ np.swapaxes(inverse, -1, -2) @ self._weight_root)

    @cached_property
    def _weight_root(self) -> Array:
        values, vectors = np.linalg.eigh(self.weight)
        kept = values > _NEGLIGIBLE * values.max()
        return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))

    def efficiency(self, value: float, best: float) -> float:
        """Ratio of the mean variances."""
        return float(best / value)


@dataclass(frozen=True)
class SmallestEigenvalue:
    """Φ = the smallest eigenvalue of S: E, the worst-known combination."""

    concave: bool = True

    def value(self, root: Array) -> Array:
        """Φ(S), shape (...)."""
        return np.asarray(np.linalg.eigvalsh(_square(root))[..., 0])

    def directions(self, root: Array) -> Array:
        """The eigenvector (one of them, where several share the eigenvalue)."""
        return np.asarray(np.linalg.eigh(_square(root))[1][..., :, :1])

    def efficiency(self, value: float, best: float) -> float:
        """Ratio of the eigenvalues."""
        return float(value / best)


@dataclass(frozen=True)
class Evidence:
    """Φ = the expected ln B in favour of the truth, with the parameters or without them, both equally probable.

    With S in units of the prior, eigenvalues 1 + λ, and parameters that are `size` prior sd in the mean square, E[ln B] is
    ½ Σ [(1 + size² λ) λ/(1 + λ) − ln(1 + λ)] if they are there and ½ Σ [λ/(1 + λ) − ln(1 + λ)] if not; half the difference is
    Φ = ¼ size² Σ λ²/(1 + λ), which never falls. For one parameter it leads to the design of T-optimality. Not concave: an optimum
    is a local one.
    """

    size: float = 1.0
    concave: bool = False

    def value(self, root: Array) -> Array:
        """Φ(S), shape (...) [nat]."""
        s = np.linalg.eigvalsh(_square(root))
        gain = np.maximum(s - 1.0, 0.0)
        return np.asarray(0.25 * self.size**2 * (gain**2 / (1.0 + gain)).sum(axis=-1))

    def directions(self, root: Array) -> Array:
        """The eigenvectors times the root of dΦ/d(1 + λ)."""
        s, vectors = np.linalg.eigh(_square(root))
        rate = 0.25 * self.size**2 * (1.0 - 1.0 / np.maximum(s, 1.0) ** 2)
        return np.asarray(vectors * np.sqrt(rate)[..., None, :])

    def efficiency(self, value: float, best: float) -> float:
        """Ratio of the expected log Bayes factors."""
        return float(value / best)


def _square(root: Array) -> Array:
    return np.asarray(root @ np.swapaxes(root, -1, -2))


def _inverse_transposed(root: Array) -> Array:
    """L⁻ᵀ, whose square is S⁻¹."""
    return np.linalg.solve(np.swapaxes(root, -1, -2), np.broadcast_to(np.eye(root.shape[-1]), root.shape))
