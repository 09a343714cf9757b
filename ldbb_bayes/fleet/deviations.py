"""g(c + w, b) with w ~ N(0, diag s²): Gaussian likelihoods of campaigns or machines that deviate.

g is what a campaign or machine says of its parameters c and the errors b of the instrument; w is
what it differs by from the others. Everything is in units of the prior sd. Λ and η are precision
and shift of g, in blocks of c and b; Λ may be singular. Sizes: k values of s, n campaigns or
machines, c parameters, q parameters and instrument errors.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.triangular import eliminate
from ldbb_bayes.results import Array

__all__ = ["Estimates", "deviating", "estimate_separately", "whitened"]


def whitened(likelihood: Gaussian, spread: Array, *, inverse: bool = False) -> Array:
    """Return (Lᵀ | L⁻¹ s (Λ_c, η_c)) with L Lᵀ = K = I + s Λ_cc s, the precision of w / s.

    Parameters
    ----------
    likelihood : g, shape (n, q).
    spread : s, shape (k, c).
    inverse : whether L⁻¹ follows behind.

    Returns
    -------
    Shape (c, c + q + 1, k, n); with the inverse (c, 2 c + q + 1, k, n).
    """
    c = spread.shape[1]
    q = likelihood.shift.shape[1]
    s = spread.T[:, :, None]
    precision_rows = likelihood.precision[:, :c].transpose(1, 2, 0)[:, :, None]
    columns = c + q + 1
    if inverse:
        columns += c
    system = np.zeros((c, columns, len(spread), len(likelihood.shift)))
    np.multiply(s[:, None], precision_rows, out=system[:, c : c + q])
    np.multiply(s, likelihood.shift.T[:c, None], out=system[:, c + q])
    np.multiply(s, system[:, c : 2 * c], out=system[:, :c])
    system[range(c), range(c)] += 1.0
    if inverse:
        system[range(c), range(c + q + 1, 2 * c + q + 1)] = 1.0
    eliminate(system.reshape(1, *system.shape[:2], -1))
    return system


def deviating(likelihood: Gaussian, spread: Array) -> Gaussian:
    """Return ∫ g(c + w, b) N(w; 0, diag s²) dw, shape (k, n, q).

    Parameters
    ----------
    likelihood : g, shape (n, q).
    spread : s, shape (k, c).
    """
    c = spread.shape[1]
    q = likelihood.shift.shape[-1]
    system = whitened(likelihood, spread)
    gram = np.einsum("iakn,ibkn->knab", system[:, c:], system[:, c:])
    log_determinant = np.log(system[range(c), range(c)]).sum(axis=0)
    return Gaussian(
        likelihood.precision - gram[..., :q, :q],
        likelihood.shift - gram[..., :q, q],
        0.5 * gram[..., q, q] - log_determinant,
    )


class Estimates(NamedTuple):
    """What each campaign or machine says by itself: t ~ N(H (c, b), S Λ_cc S)."""

    covariance: Array  #: S = (I + Λ_cc)⁻¹, shape (n, c, c)
    response: Array  #: H = S Λ_c, shape (n, c, q)
    value: Array  #: t = S η_c, shape (n, c); given b the estimate of c is t − H_b b


def estimate_separately(likelihood: Gaussian, parameters: int) -> Estimates:
    """Return the estimates of campaigns or machines, each by itself.

    Parameters
    ----------
    likelihood : g, shape (n, q).
    parameters : c.
    """
    c = parameters
    covariance = np.linalg.inv(np.eye(c) + likelihood.precision[:, :c, :c])
    response = covariance @ likelihood.precision[:, :c]
    value = covariance @ likelihood.shift[:, :c, None]
    return Estimates(covariance, response, value[..., 0])
