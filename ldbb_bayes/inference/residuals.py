"""Residuals of the readings against a prediction, and how well it fits (Eq. 34-35)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ldbb_bayes.campaign.campaign import CircularTest
from ldbb_bayes.inference.coefficients import shared_coefficients
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = [
    "RANK_TOLERANCE",
    "FitQuality",
    "fit_quality",
    "harmonics_of",
    "quality_of",
    "reduced_residuals",
    "residuals_mm",
    "tests_in_order",
]

# Singular values of a basis at a test's angles below this share of the largest count as zero.
RANK_TOLERANCE = 1e-6


@dataclass(frozen=True)
class FitQuality:
    """RMSE over all readings and by test [µm], and fitness by test [%] (Eq. 34-35)."""

    rmse_um: float
    rmse_by_test_um: dict[str, float]
    fitness_percent: dict[str, float]


def fit_quality(bound: BoundModel, phi: Array, beta: Array) -> FitQuality:
    """Return RMSE and fitness of the posterior mean of machine plus shared nuisances.

    From draws of φ (draws, h) [mm] and β (draws, p).
    """
    return quality_of(bound, shared_coefficients(bound, phi, beta).mean(axis=0))


def quality_of(bound: BoundModel, predicted: Array) -> FitQuality:
    """Return RMSE and fitness of a prediction, basis coefficients (tests, 25) [mm]."""
    residuals = reduced_residuals(bound, predicted)
    squares = np.array(
        [
            residual @ residual + reduced.residual_ss
            for residual, reduced in zip(residuals, bound.reduced, strict=True)
        ]
    )
    readings = np.array([reduced.readings for reduced in bound.reduced])
    rmse_um = np.sqrt(squares / readings) * 1e3
    rmse_by_test = {}
    fitness = {}
    for test, test_rmse_um in zip(tests_in_order(bound), rmse_um, strict=True):
        name = str(test.name)
        rmse_by_test[name] = float(test_rmse_um)
        fitness[name] = _fitness_percent(float(test_rmse_um), float(np.ptp(test.readings_mm())))
    total_rmse_um = float(np.sqrt(squares.sum() / readings.sum()) * 1e3)
    return FitQuality(total_rmse_um, rmse_by_test, fitness)


def _fitness_percent(rmse_um: float, span_mm: float) -> float:
    """Return Eq. 35; not a number where the readings are all the same."""
    if span_mm <= 0:
        return float("nan")
    return 100.0 * (1.0 - rmse_um * 1e-3 / span_mm)


def residuals_mm(bound: BoundModel, predicted: Array) -> list[Array]:
    """Return reading minus prediction of every test, each of shape (n,) [mm].

    ``predicted`` holds basis coefficients (tests, 25) [mm].
    """
    return [
        test.readings_mm() - basis(test.angles_rad()) @ coefficients
        for test, coefficients in zip(tests_in_order(bound), predicted, strict=True)
    ]


def reduced_residuals(bound: BoundModel, predicted: Array) -> list[Array]:
    """Return reduced readings minus prediction, each of shape (m,) [mm]."""
    return [
        np.asarray(reduced.projection) - reduced.factor @ coefficients
        for reduced, coefficients in zip(bound.reduced, predicted, strict=True)
    ]


def harmonics_of(bound: BoundModel, r: int) -> Array:
    """Return what makes least-squares harmonics of the reduced readings of test r, (25, m).

    The harmonics have minimum norm where readings are too few.
    """
    return np.asarray(np.linalg.pinv(bound.reduced[r].factor, rcond=RANK_TOLERANCE))


def tests_in_order(bound: BoundModel) -> list[CircularTest]:
    """Return the tests of a bound model, in its order."""
    by_name = {test.name: test for test in bound.campaign.tests}
    return [by_name[name] for name in bound.test_names]
