"""What the posterior predicts for the circles, in three layers that are never mixed up.

machine: H β. shared: plus ball form, bar length, mount and force error. The third layer, the band for a new circle, adds set-up
shift, discrepancy and white noise. RMSE and fitness (Eq. 34-35) are of the second.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.terms import Columns

__all__ = ["FitQuality", "fit_quality", "machine_coefficients", "shared_coefficients"]

Array = NDArray[Any]


@dataclass(frozen=True)
class FitQuality:
    """Root mean square error over all readings [µm] and fitness per test [%] (Eq. 34-35)."""

    rmse_um: float
    rmse_by_test_um: dict[str, float]
    fitness_percent: dict[str, float]


def machine_coefficients(bound: BoundModel, beta: Array) -> Array:
    """Basis coefficients of H β plus the nominal mount deflection, shape (draws, tests, 25) [mm]."""
    return np.einsum("tkp,wp->wtk", bound.interest, beta) + bound.known_offset


def shared_coefficients(bound: BoundModel, phi: Array, beta: Array) -> Array:
    """Machine plus the expected ball form, bar length, mount and force error given β, φ and y; (draws, tests, 25) [mm]."""
    structured = bound.given_interest
    shifted = beta - bound.centre
    _, conditional = structured.conditional(phi, shifted)
    shared = [term for term in bound.nuisance_columns if isinstance(term, Columns) and not term.private]
    private = [term for term in bound.nuisance_columns if isinstance(term, Columns) and term.private]
    total = machine_coefficients(bound, beta)
    if shared:
        values = np.concatenate([term.values for term in shared], axis=2)
        total = total + np.einsum("tkq,wq->wtk", values, conditional.mean)
    if private:
        values = np.concatenate([term.values for term in private], axis=2)
        own = structured.private_mean(phi, shifted, conditional.mean)[:, :, : values.shape[2]]
        total = total + np.einsum("tkv,wtv->wtk", values, own)
    return total


def fit_quality(bound: BoundModel, phi: Array, beta: Array) -> FitQuality:
    """RMSE and fitness of the posterior mean prediction (machine plus shared nuisances).

    Parameters
    ----------
    phi : ndarray, shape (draws, h) [mm]
    beta : ndarray, shape (draws, p)
    """
    predicted = shared_coefficients(bound, phi, beta).mean(axis=0)
    squares, spans = [], []
    for r, (name, test) in enumerate(zip(bound.test_names, bound.reduced, strict=True)):
        misfit = np.asarray(test.projection) - test.factor @ predicted[r]
        squares.append(float(misfit @ misfit) + test.residual_ss)
        readings = next(t for t in bound.campaign.tests if t.name == name).readings_mm()
        spans.append(float(np.ptp(readings)))
    n = np.array([test.readings for test in bound.reduced])
    rmse = np.sqrt(np.array(squares) / n) * 1e3
    fitness = {
        name: float(100.0 * (1.0 - error * 1e-3 / span)) if span > 0 else float("nan")
        for name, error, span in zip(bound.test_names, rmse, spans, strict=True)
    }
    by_test = dict(zip(bound.test_names, map(float, rmse), strict=True))
    return FitQuality(float(np.sqrt(np.sum(squares) / n.sum()) * 1e3), by_test, fitness)
