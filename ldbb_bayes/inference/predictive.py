"""What the posterior predicts for the circles, in three layers that are never mixed up.

machine: H β. shared: plus ball form, bar length, mount and force error. The third layer, the band for a new circle, adds set-up
shift, discrepancy and white noise. RMSE and fitness (Eq. 34-35) are of the second.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.model.basis import SIZE, basis
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.columns import BasisNoise, Columns

__all__ = [
    "FitQuality",
    "band_um",
    "fit_quality",
    "machine_coefficients",
    "new_circle_coefficients",
    "own_covariance",
    "own_nuisances",
    "prior_circle_coefficients",
    "residual_coefficients",
    "residuals_mm",
    "shared_coefficients",
    "shared_draws",
]

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


def new_circle_coefficients(bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator) -> Array:
    """A new circle at the place of every test, white noise aside: shared nuisances drawn from their posterior, force error,
    set-up shift and discrepancy drawn anew; (draws, tests, 25) [mm]."""
    return shared_draws(bound, phi, beta, rng) + _own_nuisances(bound, phi, rng)


def shared_draws(bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator) -> Array:
    """Machine plus one posterior draw of the nuisances that tests share, shape (draws, tests, 25) [mm]."""
    total = machine_coefficients(bound, beta)
    shared = [term for term in bound.nuisance_columns if isinstance(term, Columns) and not term.private]
    if not shared:
        return total
    _, conditional = bound.given_interest.conditional(phi, beta - bound.centre)
    values = np.concatenate([term.values for term in shared], axis=2)
    return np.asarray(total + np.einsum("tkq,wq->wtk", values, conditional.draw(rng)))


def _own_nuisances(bound: BoundModel, phi: Array, rng: np.random.Generator) -> Array:
    """Fresh draws of what every circle has for itself, shape (draws, tests, 25) [mm]."""
    return np.stack([own_nuisances(bound, phi, r, rng) for r in range(len(bound.test_names))], axis=1)


def own_nuisances(bound: BoundModel, phi: Array, r: int, rng: np.random.Generator) -> Array:
    """Fresh draws of what circle r has for itself: random force error, set-up shift, discrepancy; (draws, 25) [mm]."""
    total = np.zeros((len(phi), SIZE))
    for term in bound.nuisance_columns:
        scale = _hyper(bound, phi, term.hyper)
        if isinstance(term, BasisNoise):
            total = total + scale * term.sd * rng.standard_normal((len(phi), SIZE))
        elif term.private:
            total = total + (scale * term.sd * rng.standard_normal((len(phi), len(term.sd)))) @ term.values[r].T
    return total


def prior_circle_coefficients(bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator) -> Array:
    """The same from prior draws of β and φ: every nuisance drawn from its prior; (draws, tests, 25) [mm]."""
    total = machine_coefficients(bound, beta) + _own_nuisances(bound, phi, rng)
    for term in bound.nuisance_columns:
        if isinstance(term, Columns) and not term.private:
            sd = term.sd * _hyper(bound, phi, term.hyper)
            total = total + np.einsum("tkq,wq->wtk", term.values, sd * rng.standard_normal((len(phi), len(term.sd))))
    return total


def band_um(coefficients: Array, sigma_mm: Array, angle_rad: Array, rng: np.random.Generator, *, prob: float = 0.95) -> Array:
    """Equal-tailed pointwise band of readings, white noise included: (2, angles) [µm] from (draws, 25) and (draws,)."""
    readings = coefficients @ basis(angle_rad).T
    readings = readings + sigma_mm[:, None] * rng.standard_normal(readings.shape)
    return np.quantile(readings, [(1.0 - prob) / 2.0, (1.0 + prob) / 2.0], axis=0) * 1e3


def residuals_mm(bound: BoundModel, predicted: Array) -> list[Array]:
    """Reading minus prediction of every test, each of shape (n,) [mm]; predicted (tests, 25)."""
    by_name = {test.name: test for test in bound.campaign.tests}
    tests = [by_name[name] for name in bound.test_names]
    return [test.readings_mm() - basis(test.angles_rad()) @ own for test, own in zip(tests, predicted, strict=True)]


def residual_coefficients(bound: BoundModel, predicted: Array) -> Array:
    """Least-squares harmonics of the residuals, shape (tests, 25) [mm]; minimum norm where a test has too few readings."""
    rows = []
    for test, own in zip(bound.reduced, predicted, strict=True):
        misfit = np.asarray(test.projection) - test.factor @ own
        rows.append(np.linalg.lstsq(test.factor, misfit, rcond=1e-6)[0])
    return np.array(rows)


def own_covariance(bound: BoundModel, phi: Array, r: int) -> Array:
    """Covariance of what test r has for itself, shape (draws, 25, 25) [mm²]."""
    total = np.zeros((len(phi), SIZE, SIZE))
    for term in bound.nuisance_columns:
        square = _hyper(bound, phi, term.hyper)[:, :, None] ** 2
        if isinstance(term, BasisNoise):
            total = total + square * np.diag(term.sd**2)
        elif term.private:
            scaled = term.values[r] * term.sd
            total = total + square * (scaled @ scaled.T)
    return total


def _hyper(bound: BoundModel, phi: Array, name: str | None) -> Array:
    """Values of one hyper-parameter, shape (draws, 1); ones for none."""
    return np.ones((len(phi), 1)) if name is None else phi[:, [bound.hyper_prior.names.index(name)]]


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
