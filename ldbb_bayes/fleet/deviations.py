"""Gaussian likelihoods of campaigns or machines whose parameters deviate from a common level.

Each campaign or machine has a likelihood g(c + w, b), with w ~ N(0, diag s²). c is the common level
of the parameters, and b are the errors of the instrument. w is the deviation of this campaign or
machine from the level; its elements have the standard deviations s. All values are in units of the
prior sds.

As a function of x = (c + w, b), ln g = −½ xᵀ Λ x + ηᵀ x + const. Λ is the precision matrix (inverse
covariance matrix) and may be singular. η, the shift, is Λ times the estimate of x. Λ_c are the rows
of Λ that belong to the parameters, and Λ_cc is the submatrix of Λ whose rows and columns belong to
the parameters. In the shapes of arrays, the letter c has another meaning: the number of parameters.
k is the number of values of s, n the number of campaigns or machines, and q the number of
parameters and instrument errors.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.triangular import eliminate
from ldbb_bayes.results import Array

__all__ = [
    "DeviationFactors",
    "Estimates",
    "deviating",
    "estimate_separately",
    "factorize_deviations",
]


class DeviationFactors(NamedTuple):
    """Cholesky factors L of the precision matrices of w / s, and products with their inverses L⁻¹.

    w are the deviations of the c parameters of each of n campaigns or machines from their common
    level, with the standard deviations s; in the formulae s stands for diag s. The likelihood of a
    campaign or machine has the precision matrix Λ (inverse covariance) and the shift η, which is Λ
    times the estimate. Λ_c are the rows of Λ that belong to the parameters. Λ_cc are the columns of
    Λ_c that belong to the parameters. η_c are the elements of η that belong to the parameters. The
    precision matrix of w / s is I + s Λ_cc s = L Lᵀ, where L is lower triangular.
    """

    #: diagonal elements of the Cholesky factors L, shape (c, k, n). L Lᵀ is the precision matrix of
    #: w / s, where w are the deviations of the c parameters from a common level. There is one L for
    #: each of k values of the standard deviations s and each of n campaigns or machines.
    diagonal: Array
    #: products L⁻¹ s (Λ_c, η_c), shape (c, q + 1, k, n). The first q columns are L⁻¹ s Λ_c, and the
    #: last column is L⁻¹ s η_c. L is the Cholesky factor of the precision matrix of w / s, where w
    #: are the deviations of the parameters from a common level. Λ_c are those rows of the
    #: likelihood's precision matrix that belong to the parameters. η is the precision matrix times
    #: the estimate, and η_c are those elements of η that belong to the parameters. The first axis
    #: is for the parameters, k is the number of values of the standard deviations s, and n is the
    #: number of campaigns or machines.
    solved: Array
    #: inverses of the Cholesky factors L, shape (c, c, k, n); shape (c, 0, k, n) if the inverses
    #: were not requested. L Lᵀ is the precision matrix of w / s, where w are the deviations of the
    #: c parameters from a common level. There is one L for each of k values of the standard
    #: deviations s and each of n campaigns or machines.
    inverse: Array


def factorize_deviations(
    likelihood: Gaussian, spread: Array, *, inverse: bool = False
) -> DeviationFactors:
    """Return the Cholesky factors from which integrals over the deviations w are computed.

    w are the deviations of the c parameters of each campaign or machine from their common level,
    with the standard deviations s.

    Parameters
    ----------
    likelihood : likelihoods of q parameters and instrument errors from n campaigns or machines,
        shape (n, q).
    spread : k values of the standard deviations s of the c parameters, shape (k, c).
    inverse : whether to return the inverses of the Cholesky factors too.
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
    return DeviationFactors(
        diagonal=system[range(c), range(c)],
        solved=system[:, c : c + q + 1],
        inverse=system[:, c + q + 1 :],
    )


def deviating(likelihood: Gaussian, spread: Array) -> Gaussian:
    """Return likelihoods with the deviations integrated out: ∫ g(c + w, b) N(w; 0, diag s²) dw.

    g is the likelihood of a campaign or machine. c is the common level of the parameters, b are the
    errors of the instrument, and w are the deviations of this campaign or machine from the level,
    with the standard deviations s. The result has the shape (k, n, q): one likelihood of q
    quantities for each of k values of s and each of n campaigns or machines.

    Parameters
    ----------
    likelihood : likelihoods g of q parameters and instrument errors from n campaigns or machines,
        shape (n, q).
    spread : k values of the standard deviations s, one for each parameter, shape (k, number of
        parameters).
    """
    q = likelihood.shift.shape[-1]
    factors = factorize_deviations(likelihood, spread)
    gram = np.einsum("iakn,ibkn->knab", factors.solved, factors.solved)
    log_determinant = np.log(factors.diagonal).sum(axis=0)
    return Gaussian(
        likelihood.precision - gram[..., :q, :q],
        likelihood.shift - gram[..., :q, q],
        0.5 * gram[..., q, q] - log_determinant,
    )


class Estimates(NamedTuple):
    """Estimates t of the parameters c, each computed from only one of n campaigns or machines.

    b are the errors of the instrument. Λ is the precision matrix (inverse covariance) of the
    likelihood, and η is the shift of the likelihood, Λ times the estimate of (c, b). Λ_c are the
    rows of Λ that belong to the parameters, Λ_cc is the submatrix of Λ whose rows and columns
    belong to the parameters, and η_c are the elements of η that belong to the parameters. The
    estimates t are S η_c, where S = (I + Λ_cc)⁻¹ is the posterior covariance for the prior c ~ N(0,
    I). For given c and b, the estimates have the distribution t ~ N(H (c, b), S Λ_cc S), where the
    matrix H = S Λ_c is the sensitivity.
    """

    #: n posterior covariance matrices of the c parameters, each given the readings of one campaign
    #: or machine only, shape (n, c, c). The errors of the instrument are taken as known.
    covariance: Array
    #: derivatives of the estimates of the c parameters with respect to the true values of q
    #: quantities (the parameters and the instrument errors), shape (n, c, q). Each of the n
    #: matrices belongs to the estimates that are computed from one campaign or machine only.
    response: Array
    #: estimates of the c parameters, shape (n, c). Each of the n rows is computed from one campaign
    #: or machine only, as if the instrument had no errors.
    value: Array


def estimate_separately(likelihood: Gaussian, parameters: int) -> Estimates:
    """Return estimates of the parameters, computed from each campaign or machine separately.

    An estimate is the posterior mean of the parameters c, given the likelihood of one campaign or
    machine and the prior c ~ N(0, I). It is computed as if the instrument had no errors.
    `Estimates` also holds the sensitivity of the estimate to the true parameters and to the true
    errors of the instrument. All values are in units of the prior sds.

    Parameters
    ----------
    likelihood
        Likelihoods from n campaigns or machines, shape (n, q). The q quantities are the parameters,
        then the errors of the instrument.
    parameters
        Number of parameters.
    """
    c = parameters
    covariance = np.linalg.inv(np.eye(c) + likelihood.precision[:, :c, :c])
    response = covariance @ likelihood.precision[:, :c]
    value = covariance @ likelihood.shift[:, :c, None]
    return Estimates(covariance, response, value[..., 0])
