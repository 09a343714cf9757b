"""Readings minus predicted readings, and the quality of a fit.

The quality of a fit is defined by Eq. 34-35 of the article on the model. A prediction of the
readings of a test consists of 25 Fourier coefficients, of the orders 0 to 12. The readings
themselves are reduced to m numbers that contain all information about these coefficients.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ldbb_bayes.campaign.campaign import CircularTest
from ldbb_bayes.inference.coefficients import mean_shared_coefficients
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = [
    "QUALITY_DRAWS",
    "FitQuality",
    "fit_quality",
    "matrix_to_harmonics",
    "quality_of",
    "reduced_residuals",
    "residuals_mm",
    "tests_in_order",
]

# Number of posterior draws over which predicted readings are averaged, to compute how well a model
# fits each test (`FitQuality`).
QUALITY_DRAWS = 1000
# A matrix holds the values of the Fourier functions at the angles of a test. A singular value of
# this matrix counts as zero if it is below this fraction of the largest singular value. On a full
# circle all singular values are alike. On an arc of 230° the smallest is a millionth of the
# largest: a fit of all coefficients would show nothing but noise, a million times as large.
_RANK_TOLERANCE = 0.1


@dataclass(frozen=True)
class FitQuality:
    """Root-mean-square residual and fitness of predicted readings.

    Both are defined by Eq. 34-35 of the article on the model. The fitness of a test is 100 % minus
    the root-mean-square residual in per cent of the range of its readings.
    """

    rmse_um: float  #: root-mean-square residual over the readings of all tests [µm]
    #: root-mean-square residual over the readings of each test [µm]; the keys are the names of the
    #: tests
    rmse_by_test_um: dict[str, float]
    #: fitness of each test [%]: 100 % minus the root-mean-square residual in per cent of the range
    #: of the readings, or NaN if all readings are equal. The keys are the names of the tests.
    fitness_percent: dict[str, float]


def fit_quality(bound: BoundModel, phi: Array, beta: Array) -> FitQuality:
    """Return how well the readings predicted by a posterior agree with the measured readings.

    The result holds the root-mean-square residual of all tests and of each test, and the fitness of
    each test: 100 % minus its root-mean-square residual in per cent of the range of its readings.
    The prediction contains the effects of the machine and of nuisances (effects that are modelled
    but not of interest, such as ball form), but no scatter. The prediction is averaged over
    posterior draws. ``phi``, shape (draws, h), holds draws of the h hyper-parameters (such as the
    standard deviation of the noise); ``beta``, shape (draws, p), holds draws of the p parameters.
    ``bound`` is the model of the campaign.
    """
    return quality_of(bound, mean_shared_coefficients(bound, phi, beta))


def quality_of(bound: BoundModel, predicted: Array) -> FitQuality:
    """Return the root-mean-square residual and the fitness of predicted readings.

    The fitness of a test is 100 % minus the root-mean-square residual in per cent of the range of
    its readings (Eq. 35 of the article on the model). ``predicted``, shape (tests, 25), holds the
    Fourier coefficients of the orders 0 to 12 that are predicted for each test [mm]. ``bound`` is
    the model of the campaign.
    """
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
    """Return the fitness of a test [%], or NaN if all readings of the test are equal.

    The fitness (Eq. 35 of the article on the model) is 100 % minus ``rmse_um`` in per cent of
    ``span_mm``. ``rmse_um`` is the root-mean-square residual [µm], and ``span_mm`` is the largest
    reading minus the smallest reading [mm].
    """
    if span_mm <= 0:
        return float("nan")
    return 100.0 * (1.0 - rmse_um * 1e-3 / span_mm)


def residuals_mm(bound: BoundModel, predicted: Array) -> list[Array]:
    """Return the readings minus the predicted readings [mm], one array (n,) for every test.

    A test has n readings. ``predicted``, shape (tests, 25), holds the Fourier coefficients of the
    orders 0 to 12 that are predicted for each test [mm]. ``bound`` is the model of the campaign.
    """
    return [
        test.readings_mm() - basis(test.angles_rad()) @ coefficients
        for test, coefficients in zip(tests_in_order(bound), predicted, strict=True)
    ]


def reduced_residuals(bound: BoundModel, predicted: Array) -> list[Array]:
    """Return the reduced readings minus their predictions [mm], one array (m,) for every test.

    The readings of a test are reduced to m ≤ 25 numbers that contain all information about its
    Fourier coefficients of the orders 0 to 12. ``predicted``, shape (tests, 25), holds the
    coefficients that are predicted for each test [mm]. ``bound`` is the model of the campaign.
    """
    return [
        np.asarray(reduced.reading_mm) - reduced.factor @ coefficients
        for reduced, coefficients in zip(bound.reduced, predicted, strict=True)
    ]


def matrix_to_harmonics(bound: BoundModel, r: int) -> Array:
    """Return the matrix that converts the reduced readings of test r to Fourier coefficients.

    r is the index of the test. The matrix has the shape (25, m): the readings of a test are reduced
    to m ≤ 25 numbers, and there are 25 coefficients of the orders 0 to 12. The coefficients are
    fitted by least squares. If the readings do not determine all coefficients well, as on an arc,
    the solution of smallest norm is taken. ``bound`` is the model of the campaign.
    """
    return np.asarray(np.linalg.pinv(bound.reduced[r].factor, rcond=_RANK_TOLERANCE))


def tests_in_order(bound: BoundModel) -> list[CircularTest]:
    """Return the tests to which a model is applied, in the order of ``bound.test_names``.

    Tests of the campaign that the model leaves out are not returned.
    """
    by_name = {test.name: test for test in bound.campaign.tests}
    return [by_name[name] for name in bound.test_names]
