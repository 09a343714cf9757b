"""Split from its neighbours; see there."""

from __future__ import annotations

import numpy as np

from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.triangular import eliminate
from ldbb_bayes.results import Array

__all__ = ["alone", "deviating", "whitened"]


def whitened(likelihood: Gaussian, spread: Array, *, inverse: bool = False) -> Array:
    """(Lᵀ | L⁻¹ s (Λ_c, η_c)), shape (c, c + q + 1, k, n), with L Lᵀ = K = I + s Λ_cc s, for k
    values of s (k, c); L⁻¹ behind with ``inverse``. K is the precision of z = w / s, w ~ N(0, diag
    s²) being what one campaign or machine differs by: g(c + w, b). Λ may be singular."""
    c = spread.shape[1]
    q = likelihood.shift.shape[1]
    s = spread.T[:, :, None]
    rows = likelihood.precision[:, :c].transpose(1, 2, 0)[:, :, None]
    whole = np.zeros((c, c + q + 1 + c * inverse, len(spread), len(likelihood.shift)))
    np.multiply(s[:, None], rows, out=whole[:, c : c + q])
    np.multiply(s, likelihood.shift.T[:c, None], out=whole[:, c + q])
    np.multiply(s, whole[:, c : 2 * c], out=whole[:, :c])
    whole[range(c), range(c)] += 1.0
    if inverse:
        whole[range(c), range(c + q + 1, 2 * c + q + 1)] = 1.0
    eliminate(whole.reshape(1, *whole.shape[:2], -1))
    return whole


def deviating(likelihood: Gaussian, spread: Array) -> Gaussian:
    """∫ g(c + w, b) N(w; 0, diag s²) dw, shape (k, n, q); arguments as for `whitened`."""
    c = spread.shape[1]
    q = likelihood.shift.shape[-1]
    whole = whitened(likelihood, spread)
    square = np.einsum("iakn,ibkn->knab", whole[:, c:], whole[:, c:])
    constant = 0.5 * square[..., q, q] - np.log(whole[range(c), range(c)]).sum(axis=0)
    return Gaussian(
        likelihood.precision - square[..., :q, :q], likelihood.shift - square[..., :q, q], constant
    )


def alone(likelihood: Gaussian, parameters: int) -> tuple[Array, Array, Array]:
    """S = (I + Λ_cc)⁻¹, H = S Λ_c and t = S η_c, shapes (n, c, c), (n, c, q) and (n, c), of
    campaigns each by itself. Its estimate is t − H_b b; t ~ N(H (c, b), S Λ_cc S)."""
    c = parameters
    own = np.linalg.inv(np.eye(c) + likelihood.precision[:, :c, :c])
    return own, own @ likelihood.precision[:, :c], (own @ likelihood.shift[:, :c, None])[..., 0]
