"""Least-squares estimate of the parameters of a machine, as in the article on the model (Eq. 31).

The parameters are compliances, their changes with force, and geometric errors. The uncertainty of
the estimate accounts for white noise alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ldbb_bayes.campaign.campaign import Campaign, require_campaign
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.coefficients import machine_coefficients
from ldbb_bayes.inference.residuals import FitQuality, fit_quality
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, ByRow, Numbers, Result, readable

__all__ = ["LeastSquares", "fit_least_squares"]

# The matrix of the derivatives of the readings with respect to the parameters counts as singular if
# its smallest singular value is below this fraction of its largest singular value.
_SINGULAR = 1e-10


@dataclass(frozen=True, eq=False)
class LeastSquares(Result):
    """Least-squares estimate of the parameters, and how well the estimate fits the readings.

    Examples
    --------
    >>> fit = lb.fit_least_squares(campaign)
    >>> round(fit.estimate["C_XXX"] * 1e6)  # nm/N
    62
    >>> round(fit.quality.rmse_um, 1)
    1.1
    >>> fit.predicted_um["f742"].shape  # one value for each reading of the test
    (720,)
    """

    #: table of the least-squares estimates of the parameters, with the columns unit, estimate and
    #: u, in mm, N and rad. u is the standard uncertainty from the scatter of the residuals, taken
    #: as white noise. All estimates and all u are NaN if the readings do not determine every
    #: parameter, or if there are at most as many readings as parameters.
    table: ByRow
    #: root-mean-square residual over all readings and for each test [µm], and fitness of each test
    #: [%] (Eq. 34-35 of the article on the model)
    quality: FitQuality
    #: predicted readings of each test [µm], in the order of the test's readings; the keys are the
    #: names of the tests
    predicted_um: dict[str, Numbers]

    @property
    def estimate(self) -> dict[str, float]:
        """Return the estimates in mm, N and rad, as a dict by the names of the parameters."""
        return {str(name): float(value) for name, value in self.table["estimate"].items()}


@one_blas_thread
def fit_least_squares(
    campaign: Campaign,
    degree: int = 0,
    *,
    reference_force_N: float | None = None,
    fixed: Sequence[str] = (),
) -> LeastSquares:
    """Return least-squares estimates of compliances and geometric errors.

    The estimates are those of the article on the model (Eq. 31). If ``degree`` is 1 or 2, the
    changes of the compliances with force are estimated too. The model does not contain errors of
    the balls, the bar and the mount. These errors therefore bias the estimates, and the standard
    uncertainties u are too small. The models of `sample` contain these errors.

    Parameters
    ----------
    campaign : Campaign
        Campaign with readings.
    degree : {0, 1, 2}
        Degree of the compliances as polynomials in the force: constant (0), linear (1, Eq. 33) or
        quadratic (2).
    reference_force_N : float, optional
        Reference force F0, at which the changes of the compliances with force are zero [N].
        Default: the mid-range of the campaign's forces. Zero gives exactly Eq. 33.
    fixed : tuple of str
        Names of parameters held at zero.

    Returns
    -------
    LeastSquares
        Estimate in mm, N and rad. All estimates and all u are NaN if the readings do not determine
        every parameter, or if there are at most as many readings as parameters.

    Raises
    ------
    InputError
        For an object that is not a campaign, a plan (a campaign without readings), a degree other
        than 0, 1 or 2, an unknown name in ``fixed``, or a campaign with fewer than degree + 2
        different forces.

    Examples
    --------
    >>> fit = lb.fit_least_squares(campaign, degree=1, reference_force_N=0.0)
    >>> round(fit.estimate["C_XXX"] * 1e6)  # nm/N
    60
    >>> round(fit.estimate["C_XXX_1"] * 1e9, 1)  # nm/N per kN
    0.9
    """
    require_campaign(campaign)
    if campaign.is_plan:
        raise InputError(
            "least squares must have readings, got a plan. Run the tests, or simulate it."
        )
    flat_prior = HybridModel.paper().prior
    model = HybridModel(
        degree=degree,
        nuisances=(),
        prior=flat_prior,
        reference_force_N=reference_force_N,
        preset="paper",
        fixed=fixed,
    )
    bound = model.bind(campaign)
    # After a model has been applied to readings, its attribute ``centre`` is the least-squares
    # estimate of its parameters.
    estimate = bound.least_squares_estimate
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
    """Return the standard uncertainty of each of the p parameters, shape (p,).

    The uncertainties are the square roots of the diagonal of s² (JᵀJ)⁻¹, in internal units (mm, N,
    rad). The Jacobian J, shape (readings, p), holds the derivatives of the readings with respect to
    the parameters; s² is the sum of squares of the residuals divided by the number of readings
    minus p. The uncertainty is NaN if J is singular or if there are at most p readings. ``bound``
    is the model of the campaign. ``quality`` holds the root-mean-square residual of the fit.
    """
    readings = sum(reduced.readings for reduced in bound.reduced)
    sum_of_squares = readings * (quality.rmse_um * 1e-3) ** 2
    freedom = readings - len(bound.names)
    rows = [reduced.factor @ bound.interest_columns[r] for r, reduced in enumerate(bound.reduced)]
    jacobian = np.concatenate(rows) * bound.scale
    singular, right = np.linalg.svd(jacobian, full_matrices=False)[1:]
    too_few = freedom <= 0 or len(jacobian) < jacobian.shape[1]
    if too_few or singular[-1] < _SINGULAR * singular[0]:
        return np.full(len(bound.names), np.nan)
    inverse_diagonal = ((right.T / singular) ** 2).sum(axis=1)
    return np.asarray(np.sqrt(sum_of_squares / freedom * inverse_diagonal) * bound.scale)
