"""The paper's own estimate (Eq. 31): least squares of the readings on the hybrid Jacobian.

Its uncertainty accounts for white noise alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from ldbb_bayes.campaign.campaign import Campaign, check_campaign
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.coefficients import machine_coefficients
from ldbb_bayes.inference.residuals import FitQuality, fit_quality
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, ByRow, Numbers, Result, readable

__all__ = ["LeastSquares", "least_squares"]

# A Jacobian whose smallest singular value is below this share of its largest is singular.
_SINGULAR = 1e-10


@dataclass(frozen=True, eq=False)
class LeastSquares(Result):
    """A least-squares estimate and how well it fits."""

    #: One row per parameter: unit, estimate, u (standard uncertainty from the scatter of the
    #: residuals, as if they were white noise; not a number where the readings do not determine the
    #: parameters), in inside units.
    table: ByRow
    #: RMSE over all readings and of every test [µm], fitness of every test [%] (Eq. 34-35)
    quality: FitQuality
    predicted_um: dict[str, Numbers]  #: by test, in the order of its readings

    @property
    def estimate(self) -> dict[str, float]:
        """Return the estimate of every parameter, in inside units."""
        return {str(name): float(value) for name, value in self.table["estimate"].items()}


@one_blas_thread
def least_squares(
    campaign: Campaign,
    degree: int = 0,
    *,
    reference_force_N: float | None = None,
    fixed: tuple[str, ...] = (),
) -> LeastSquares:
    """Estimate compliances, slopes and geometric errors by the pseudoinverse (Eq. 31).

    Parameters
    ----------
    campaign : Campaign
        With readings.
    degree : {0, 1, 2}
        Compliance constant, linear (Eq. 33) or quadratic in force.
    reference_force_N : float, optional
        F0; default: mid-range of the campaign's forces. 0 gives Eq. 33 literally.
    fixed : tuple of str
        Parameters held at zero.

    Returns
    -------
    LeastSquares
        In mm, N and rad.

    Raises
    ------
    InputError
        For a plan, or fewer than degree + 2 force levels.
    """
    check_campaign(campaign)
    if campaign.is_plan:
        raise InputError(
            "least squares must have readings, got a plan. Run the tests, or simulate it."
        )
    flat_prior = HybridModel.paper().prior
    model = HybridModel(degree, (), flat_prior, reference_force_N, "paper", fixed)
    bound = model.bind(campaign)
    # Under a flat prior the centre is the least-squares estimate.
    estimate = bound.centre
    coefficients = machine_coefficients(bound, estimate[None])[0]
    predicted_um = {
        test.name: basis(test.angles_rad()) @ of_test * 1e3
        for test, of_test in zip(campaign.tests, coefficients, strict=True)
    }
    quality = fit_quality(bound, np.ones((1, 1)), estimate[None])
    units = [parameter.unit for parameter in bound.parameters]
    uncertainty = _uncertainty(bound, quality)
    columns = {"unit": units, "estimate": estimate, "u": uncertainty}
    table = pd.DataFrame(columns, index=list(bound.names))
    if np.isnan(uncertainty).any():
        table["estimate"] = np.nan
    return LeastSquares(readable(table, "Least squares"), quality, predicted_um)


def _uncertainty(bound: BoundModel, quality: FitQuality) -> Array:
    """Return the square roots of the diagonal of s² (JᵀJ)⁻¹, shape (p,).

    Not a number where J is singular or has as many columns as there are readings.
    """
    readings = sum(reduced.readings for reduced in bound.reduced)
    sum_of_squares = readings * (quality.rmse_um * 1e-3) ** 2
    freedom = readings - len(bound.names)
    rows = [reduced.factor @ bound.interest[r] for r, reduced in enumerate(bound.reduced)]
    jacobian = np.concatenate(rows) * bound.scale
    singular, right = np.linalg.svd(jacobian, full_matrices=False)[1:]
    too_few = freedom <= 0 or len(jacobian) < jacobian.shape[1]
    if too_few or singular[-1] < _SINGULAR * singular[0]:
        return np.full(len(bound.names), np.nan)
    inverse_diagonal = ((right.T / singular) ** 2).sum(axis=1)
    return np.asarray(np.sqrt(sum_of_squares / freedom * inverse_diagonal) * bound.scale)
