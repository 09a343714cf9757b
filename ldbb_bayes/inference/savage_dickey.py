"""A nested Bayes factor from the larger model alone: p(ψ = 0 | y) / p(ψ = 0), ψ what the smaller one fixes at zero.

With truncation T both densities are those inside it. Given the hyper-parameters φ, p(ψ | y, φ) is Gaussian times an orthant
probability; the product with p(y, φ) of the larger model is integrated on nodes of its own (Dickey, Ann. Math. Stat. 42, 204-223,
1971).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.errors import check_known
from ldbb_bayes.inference.evidence import Evidence
from ldbb_bayes.inference.lattice import grow_lattice
from ldbb_bayes.inference.quadrature import HyperPosterior
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.conditional import ParameterConditional
from ldbb_bayes.model.orthant import Orthant

__all__ = ["savage_dickey"]

Array = NDArray[Any]
_LOG_2PI = float(np.log(2 * np.pi))
_STEP = 1.75


def savage_dickey(
    posterior: HyperPosterior, evidence: Evidence, names: Sequence[str], *, tolerance: float = 1e-2
) -> tuple[float, float]:
    """ln of the Bayes factor of the model with ``names`` fixed at zero over the model itself, and its error [nat].

    Parameters
    ----------
    posterior : HyperPosterior
        Of the larger model.
    evidence : Evidence
        Of the larger model.
    """
    bound = posterior.bound
    check_known("parameter", names, bound.names)
    index = [bound.names.index(name) for name in names]
    lattice = grow_lattice(
        lambda free: _log_density(posterior, free, index), posterior.mode, posterior.spread, tolerance=tolerance, step=_STEP
    )
    prior = bound.log_prob_truncation_prior if posterior.truncated else 0.0
    value = lattice.log_integral - (evidence.log_value + prior) - _log_prior_at_zero(posterior, index)
    return value, lattice.error + evidence.error


def _log_density(posterior: HyperPosterior, free: Array, index: Sequence[int]) -> Array:
    """ln p(y, φ) p(ψ = 0, T | y, φ) of the larger model, in free coordinates, shape (w,)."""
    bound = posterior.bound
    total = bound.hyper_prior.log_density_of_free(free)
    inside = np.isfinite(total)
    if inside.any():
        log_evidence, given = bound.given(bound.hyper_prior.phi(free[inside]))
        total[inside] += log_evidence + _log_at_zero(posterior, given, index)
    return np.asarray(total)


def _log_at_zero(posterior: HyperPosterior, given: ParameterConditional, index: Sequence[int]) -> Array:
    """ln p(ψ = 0 | y, φ), times the probability of physical compliances given ψ = 0 where there is truncation, shape (w,)."""
    spread = given.spread()
    basis, triangle = np.linalg.qr(np.swapaxes(spread[:, index], 1, 2))
    white = np.linalg.solve(np.swapaxes(triangle, 1, 2), given.mean[:, index, None])[..., 0]
    log_root = np.log(np.abs(np.diagonal(triangle, axis1=1, axis2=2))).sum(axis=1)
    density = -0.5 * ((white**2).sum(axis=1) + len(index) * _LOG_2PI) - log_root
    if not posterior.truncated:
        return np.asarray(density)
    return np.asarray(density + _log_inside(posterior.bound, given, spread, basis, white, index))


def _log_inside(
    bound: BoundModel, given: ParameterConditional, spread: Array, basis: Array, white: Array, index: Sequence[int]
) -> Array:
    """ln P(T | ψ = 0, y, φ): the other parameters given ψ = 0."""
    rows = bound.physical.rows.copy()
    rows[:, index] = 0.0
    rows = np.array([row for row in dict.fromkeys(map(tuple, rows)) if any(row)]).reshape(-1, rows.shape[1])
    along = rows @ spread
    shared = along @ basis
    mean = given.mean @ rows.T - np.einsum("wmk,wk->wm", shared, white)
    return Orthant(mean, along - shared @ np.swapaxes(basis, 1, 2)).log_value()


def _log_prior_at_zero(posterior: HyperPosterior, index: Sequence[int]) -> float:
    bound = posterior.bound
    mean, sd = bound.prior_mean[index], bound.prior_sd[index]
    density = float(-0.5 * ((mean / sd) ** 2).sum() - np.log(sd).sum() - 0.5 * len(index) * _LOG_2PI)
    if not posterior.truncated:
        return density
    smaller = bound.model.fixing(*(bound.names[i] for i in index)).bind(bound.campaign)
    return density + smaller.log_prob_truncation_prior - bound.log_prob_truncation_prior
