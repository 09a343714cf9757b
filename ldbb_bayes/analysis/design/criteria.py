"""Criteria of optimum design: figures of merit that are maximised by a good set of tests.

Let S, shape (..., s, s), be the precision (inverse covariance) of the s parameters of interest when
all other parameters are unknown (the Schur complement). The parameters are in units in which they
are comparable. The leading dimensions (...) run over designs, or over values of the
hyper-parameters. Every criterion takes the Cholesky factor L of S = L Lᵀ, and has the following
methods and attributes:

- `value`: the figure of merit Φ(S), shape (...), which never decreases when information is added;
- `directions`: Q, shape (..., s, q), with the derivative ∂Φ/∂S = Q Qᵀ, which the search uses;
- `concave`: whether every local optimum over the shares of the tests is the global optimum;
- `efficiency`: the figure of merit of a design relative to that of the best design, 0 … 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np

from ldbb_bayes.results import Array

__all__ = ["Criterion", "Determinant", "LogBayesFactor", "Variance"]

# The design criteria A, c and I are sums of variances, weighted by a matrix W. An eigenvalue of W
# is treated as zero if it is below this share of the largest eigenvalue.
_NEGLIGIBLE_EIGENVALUE = 1e-14


@dataclass(frozen=True)
class Determinant:
    """Criteria D and D_s: Φ = ln det S, where S is the precision of the parameters of interest.

    With proper priors, Φ/2 is the expected information gain [nat] up to a constant.
    """

    concave: ClassVar[bool] = True
    size: int  #: number s of parameters of interest of a design

    def value(self, root: Array) -> Array:
        """Return the criterion Φ = ln det S, shape (...).

        S is the precision (inverse covariance) of the s parameters of interest. ``root`` is the
        Cholesky factor of S, shape (..., s, s). The leading dimensions (...) run over designs or
        values of the hyper-parameters.
        """
        diagonal = np.diagonal(root, axis1=-2, axis2=-1)
        return np.asarray(2.0 * np.log(diagonal).sum(axis=-1))

    def directions(self, root: Array) -> Array:
        """Return Q, shape (..., s, s), with Q Qᵀ = ∂Φ/∂S for the criterion Φ = ln det S.

        S is the precision of the s parameters of interest, and ``root`` its Cholesky factor L,
        shape (..., s, s). Q is L⁻ᵀ. The leading dimensions (...) run over designs or values of the
        hyper-parameters.
        """
        return _inverse_transposed(root)

    def efficiency(self, value: float, best: float) -> float:
        """Return the efficiency (det S / det S*)^(1/s) of a design.

        S is the precision of the s parameters of interest in this design, and S* their precision in
        the best design. ``value`` and ``best`` are ln det S and ln det S*.
        """
        return float(np.exp((value - best) / self.size))


@dataclass(frozen=True, eq=False)
class Variance:
    """Criteria A, c and I: Φ = −tr(W S⁻¹), the negative of a weighted sum of variances.

    S is the precision of the s parameters of interest and W, shape (s, s), their weights. For
    criterion A, W is a multiple of the identity. For criterion c, W is c cᵀ, where cᵀ β is the
    combination of the parameters β that is of interest. For criterion I, several predictions xᵀ β
    are of interest, and W is the mean of x xᵀ over these predictions.
    """

    concave: ClassVar[bool] = True
    #: weights W of the s parameters of interest in the criterion Φ = −tr(W S⁻¹), shape (s, s)
    weight: Array

    def value(self, root: Array) -> Array:
        """Return the criterion Φ = −tr(W S⁻¹), shape (...), a negative weighted sum of variances.

        S is the precision of the s parameters of interest and W, shape (s, s), their weights.
        ``root`` is the Cholesky factor of S, shape (..., s, s). The leading dimensions (...) run
        over designs or values of the hyper-parameters.
        """
        inverse = _inverse_transposed(root)
        return np.asarray(-np.einsum("ij,...jk,...ik->...", self.weight, inverse, inverse))

    def directions(self, root: Array) -> Array:
        """Return Q, shape (..., s, rank of W), with Q Qᵀ = ∂Φ/∂S for Φ = −tr(W S⁻¹).

        S is the precision (inverse covariance) of the s parameters of interest, and W, shape (s,
        s), the matrix of their weights, whose rank is the number of its eigenvalues above zero.
        ``root`` is the Cholesky factor of S, shape (..., s, s). Q is S⁻¹ W^½. The leading
        dimensions (...) run over designs or values of the hyper-parameters.
        """
        inverse = _inverse_transposed(root)
        eigenvalues, vectors = np.linalg.eigh(self.weight)
        positive = eigenvalues > _NEGLIGIBLE_EIGENVALUE * eigenvalues.max()
        weight_root = vectors[:, positive] * np.sqrt(eigenvalues[positive])
        return np.asarray(inverse @ np.swapaxes(inverse, -1, -2) @ weight_root)

    def efficiency(self, value: float, best: float) -> float:
        """Return the weighted sum of variances in the best design, divided by that in this design.

        ``value`` and ``best`` are the criteria (negative weighted sums) of this design and of the
        best design.
        """
        return float(best / value)


@dataclass(frozen=True)
class LogBayesFactor:
    """Criterion Φ: expected log Bayes factor of two models in favour of the true one.

    In one model, the s parameters of interest are free; in the other, they are zero. Both models
    are equally probable before the tests. B is the Bayes factor of the model with free parameters
    over the model in which they are zero.

    S is the precision matrix of the parameters after the tests, in units of their prior precision.
    The eigenvalues of S are 1 + λ, where λ is the contribution of the readings; Σ below is the sum
    over all eigenvalues. An `Objective` with this criterion must have ``rows`` and ``prior`` that
    are scaled so that S is the identity before any tests.

    If the model with free parameters is true, and if the root mean square of the parameters is
    ``size`` prior standard deviations, the mean of ln B is ½ Σ [(1 + size² λ) λ/(1 + λ) − ln(1 +
    λ)]. If the parameters are zero, the mean of ln B is ½ Σ [λ/(1 + λ) − ln(1 + λ)]. Φ is half the
    difference of these two means: Φ = ¼ size² Σ λ²/(1 + λ). Φ never decreases when tests are added.
    For one parameter, the design with the largest Φ is T-optimal. As Φ is not concave, a search may
    end at a local maximum.
    """

    concave: ClassVar[bool] = False
    #: root mean square of the parameters of interest, in units of their prior standard deviations,
    #: in the model in which these parameters are free
    size: float = 1.0

    def value(self, root: Array) -> Array:
        """Return the expected log Bayes factor in favour of the true model, shape (...).

        Two models are compared. In one, the s parameters of interest are free; in the other, they
        are zero. ``root`` is the Cholesky factor of the precision of these parameters, shape (...,
        s, s). The leading dimensions (...) run over designs or values of the hyper-parameters.
        """
        gain = np.maximum(np.linalg.eigvalsh(_square(root)) - 1.0, 0.0)
        return np.asarray(0.25 * self.size**2 * (gain**2 / (1.0 + gain)).sum(axis=-1))

    def directions(self, root: Array) -> Array:
        """Return Q, shape (..., s, s), with Q Qᵀ = ∂Φ/∂S for the expected log Bayes factor Φ.

        Φ is the expected log Bayes factor of two models in favour of the true one: in one model,
        the s parameters of interest are free; in the other, they are zero. S is the precision of
        these parameters, in units of their prior precision; without readings, S is the identity.
        ``root`` is the Cholesky factor of S, shape (..., s, s). The columns of Q are the
        eigenvectors of S, each multiplied by √(dΦ/dμ), where μ is the eigenvalue of S that belongs
        to the eigenvector. The leading dimensions (...) run over designs or values of the
        hyper-parameters.
        """
        eigenvalues, vectors = np.linalg.eigh(_square(root))
        rate = 0.25 * self.size**2 * (1.0 - 1.0 / np.maximum(eigenvalues, 1.0) ** 2)
        return np.asarray(vectors * np.sqrt(rate)[..., None, :])

    def efficiency(self, value: float, best: float) -> float:
        """Return the ratio of the expected log Bayes factors of a design and of the best design.

        ``value`` is the expected log Bayes factor of the design, and ``best`` that of the best
        design.
        """
        return float(value / best)


Criterion: TypeAlias = Determinant | Variance | LogBayesFactor


def _square(root: Array) -> Array:
    """Return the matrix S = L Lᵀ from its Cholesky factor L, here ``root``."""
    return np.asarray(root @ np.swapaxes(root, -1, -2))


def _inverse_transposed(root: Array) -> Array:
    """Return L⁻ᵀ from the Cholesky factor L of S = L Lᵀ, so that L⁻ᵀ L⁻¹ is S⁻¹."""
    identity = np.broadcast_to(np.eye(root.shape[-1]), root.shape)
    return np.linalg.solve(np.swapaxes(root, -1, -2), identity)
