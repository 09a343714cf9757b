"""Residuals of the readings against a prediction, and how well it fits (Eq. 34-35)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ldbb_bayes.campaign.campaign import CircularTest
from ldbb_bayes.inference.coefficients import (
    shared_coefficients,
)
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = [
    "FitQuality",
    "RANK_TOLERANCE",
    "fit_quality",
    "harmonics_of",
    "quality_of",
    "reduced_residuals",
    "residuals_mm",
    "tests_in_order",
]


RANK_TOLERANCE = 1e-6


def residuals_mm(bound: BoundModel, predicted: Array) -> list[Array]:
    """Reading minus prediction of every test, each of shape (n,) [mm]; predicted (tests, 25)."""
    return [
        test.readings_mm() - basis(test.angles_rad()) @ own
        for test, own in zip(tests_in_order(bound), predicted, strict=True)
    ]


def reduced_residuals(bound: BoundModel, predicted: Array) -> list[Array]:
    """Reduced readings minus prediction, each of shape (m,) [mm]."""
    return [
        np.asarray(test.projection) - test.factor @ own
        for test, own in zip(bound.reduced, predicted, strict=True)
    ]


def harmonics_of(bound: BoundModel, r: int) -> Array:
    """Least-squares harmonics from the reduced readings of test r, shape (25, m); minimum norm
    where readings are too few."""
    return np.asarray(np.linalg.pinv(bound.reduced[r].factor, rcond=RANK_TOLERANCE))


def tests_in_order(bound: BoundModel) -> list[CircularTest]:
    """The tests of a bound model, in its order."""
    by_name = {test.name: test for test in bound.campaign.tests}
    return [by_name[name] for name in bound.test_names]


@dataclass(frozen=True)
class FitQuality:
    """Root mean square error over all readings and by test [µm], and fitness by test [%] (Eq.
    34-35)."""

    rmse_um: float
    rmse_by_test_um: dict[str, float]
    fitness_percent: dict[str, float]


def fit_quality(bound: BoundModel, phi: Array, beta: Array) -> FitQuality:
    """RMSE and fitness of the posterior mean prediction, machine plus shared nuisances, from φ
    (draws, h) [mm], β (draws, p)."""
    return quality_of(bound, shared_coefficients(bound, phi, beta).mean(axis=0))


def quality_of(bound: BoundModel, predicted: Array) -> FitQuality:
    """The same of a prediction, basis coefficients (tests, 25) [mm]."""
    misfits = reduced_residuals(bound, predicted)
    squares = np.array(
        [m @ m + test.residual_ss for m, test in zip(misfits, bound.reduced, strict=True)]
    )
    n = np.array([test.readings for test in bound.reduced])
    rmse = np.sqrt(squares / n) * 1e3
    spans = [float(np.ptp(test.readings_mm())) for test in tests_in_order(bound)]
    fitness = [
        100.0 * (1.0 - e * 1e-3 / span) if span > 0 else np.nan
        for e, span in zip(rmse, spans, strict=True)
    ]
    by_test, fit = (
        dict(zip(bound.test_names, map(float, values), strict=True)) for values in (rmse, fitness)
    )
    return FitQuality(float(np.sqrt(squares.sum() / n.sum()) * 1e3), by_test, fit)
