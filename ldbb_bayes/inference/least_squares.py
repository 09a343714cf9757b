"""The paper's own estimate (Eq. 31): least squares of the readings on the hybrid Jacobian.

Its uncertainty accounts for white noise alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from ldbb_bayes.campaign.campaign import Campaign, check_campaign
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.coefficients import (
    machine_coefficients,
)
from ldbb_bayes.inference.residuals import (
    FitQuality,
    fit_quality,
)
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, ByRow, Numbers, Result, readable

__all__ = ["LeastSquares", "least_squares"]


_SINGULAR = 1e-10


@dataclass(frozen=True, eq=False)
class LeastSquares(Result):
    """A least-squares estimate and how well it fits."""

    #: One row per parameter: unit, estimate, u (standard uncertainty from the scatter of the residuals, as if they were white
    #: noise; not a number where the readings do not determine the parameters), in inside units.
    table: ByRow
    #: RMSE over all readings and of every test [µm], fitness of every test [%] (Eq. 34-35)
    quality: FitQuality
    predicted_um: dict[str, Numbers]  #: by test, in the order of its readings

    @property
    def estimate(self) -> dict[str, float]:
        """Parameter to estimate, in inside units."""
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

    InputError for a plan, or fewer than degree + 2 force levels.

    Parameters
    ----------
    campaign : with readings.
    degree : {0, 1, 2}
        Compliance constant, linear (Eq. 33) or quadratic in force.
    reference_force_N : F0; default: mid-range of the campaign's forces. 0 gives Eq. 33 literally.
    fixed : parameters held at zero.
    """
    check_campaign(campaign)
    if campaign.is_plan:
        raise InputError(
            "least squares must have readings, got a plan. Run the tests, or simulate it."
        )
    bound = HybridModel(
        degree, (), HybridModel.paper().prior, reference_force_N, "paper", fixed
    ).bind(campaign)
    predicted = machine_coefficients(bound, bound.centre[None])[0]
    readings = {
        test.name: basis(test.angles_rad()) @ own * 1e3
        for test, own in zip(campaign.tests, predicted, strict=True)
    }
    quality = fit_quality(bound, np.ones((1, 1)), bound.centre[None])
    units = [parameter.unit for parameter in bound.parameters]
    table = pd.DataFrame(
        {"unit": units, "estimate": bound.centre, "u": _uncertainty(bound, quality)},
        index=list(bound.names),
    )
    if table["u"].isna().any():
        table["estimate"] = np.nan
    return LeastSquares(readable(table, "Least squares"), quality, readings)


def _uncertainty(bound: BoundModel, quality: FitQuality) -> Array:
    """Square roots of the diagonal of s² (JᵀJ)⁻¹, shape (p,); not a number where J is singular or
    as many as the readings."""
    readings = sum(test.readings for test in bound.reduced)
    square = readings * (quality.rmse_um * 1e-3) ** 2
    freedom = readings - len(bound.names)
    rows = (
        np.concatenate([test.factor @ bound.interest[r] for r, test in enumerate(bound.reduced)])
        * bound.scale
    )
    singular, right = np.linalg.svd(rows, full_matrices=False)[1:]
    if freedom <= 0 or len(rows) < rows.shape[1] or singular[-1] < _SINGULAR * singular[0]:
        return np.full(len(bound.names), np.nan)
    return np.asarray(
        np.sqrt(square / freedom * ((right.T / singular) ** 2).sum(axis=1)) * bound.scale
    )
