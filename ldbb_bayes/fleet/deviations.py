"""Gaussian likelihoods of campaigns or machines that deviate from their common level.

Each campaign or machine has a likelihood g(c + w, b), w ~ N(0, diag s²). Here c is the common level
of the parameters, b are the errors of the instrument, w is the deviation of this campaign or
machine, and s are the standard deviations of w. All values are in units of the prior sd.

As a function of x = (c + w, b), ln g = −½ xᵀ Λ x + ηᵀ x + const. Λ is the precision matrix (inverse
covariance matrix) and may be singular; η, the shift, is Λ times the estimate. Λ_c are the rows of Λ
for the parameters, Λ_cc is its block for the parameters alone. In the shapes of arrays, k is the
number of values of s, n that of campaigns or machines, c that of parameters, and q that of
parameters and instrument errors.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.triangular import eliminate
from ldbb_bayes.results import Array

__all__ = ["Estimates", "deviating", "estimate_separately", "whitened"]


def whitened(likelihood: Gaussian, spread: Array, *, inverse: bool = False) -> Array:
    """Return the matrix (Lᵀ | L⁻¹ s (Λ_c, η_c)), from which deviations w are integrated out.

    L is the Cholesky factor of I + s Λ_cc s = L Lᵀ, the precision matrix of w / s. Here s stands
    for diag s, with the standard deviations s of w; the vertical bar puts matrices side by side.
    Λ_c, Λ_cc and η_c are the parts of a likelihood's precision matrix Λ and shift η for the c
    parameters.

    Parameters
    ----------
    likelihood : likelihoods g, shape (n, q).
    spread : standard deviations s, shape (k, c).
    inverse : whether to append L⁻¹ as further columns.

    Returns
    -------
    Array of shape (c, c + q + 1, k, n); with the inverse (c, 2 c + q + 1, k, n).
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
    """Return likelihoods with the deviations integrated out: ∫ g(c + w, b) N(w; 0, diag s²) dw.

    The result has the shape (k, n, q): n campaigns or machines, each for k values of s.

    Parameters
    ----------
    likelihood : likelihoods g of parameters c and instrument errors b, shape (n, q).
    spread : standard deviations s of the parameters' deviations w, shape (k, c).
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
    """Estimates t of the parameters c from each campaign or machine alone.

    t = S η_c with the posterior covariance S = (I + Λ_cc)⁻¹. Given c and the errors b of the
    instrument, t ~ N(H (c, b), S Λ_cc S) with the sensitivity H = S Λ_c. Λ_c, Λ_cc and η_c are the
    parts for the parameters of the likelihood's precision matrix Λ and shift η.
    """

    #: posterior covariance of the c parameters given the instrument's errors, shape (n, c, c)
    covariance: Array
    #: sensitivity of the estimates to the true parameters and instrument errors, shape (n, c, q)
    response: Array
    #: estimates of the c parameters if the instrument's errors are zero, shape (n, c)
    value: Array


def estimate_separately(likelihood: Gaussian, parameters: int) -> Estimates:
    """Return estimates of the parameters from each campaign or machine alone.

    Each estimate is the posterior mean from its own likelihood and the prior c ~ N(0, I), as a
    function of the errors b of the instrument.

    Parameters
    ----------
    likelihood
        Likelihoods g of n campaigns or machines, for q quantities each.
    parameters
        Number c of parameters, which come first among the quantities.
    """
    c = parameters
    covariance = np.linalg.inv(np.eye(c) + likelihood.precision[:, :c, :c])
    response = covariance @ likelihood.precision[:, :c]
    value = covariance @ likelihood.shift[:, :c, None]
    return Estimates(covariance, response, value[..., 0])
