"""Estimates of a machine, about which the model of a campaign is linearised.

Some effects, such as an error of the angle, depend on the readings that the machine's compliances
and geometric errors cause. These effects are computed for the estimated compliances Ĉ and geometric
errors Ê. The prior sds of some effects, such as the load on the joints, are proportional to the
magnitude of a compliance, √(Ĉ² + u(Ĉ)²), where u(Ĉ) is the standard uncertainty of the estimate.
For a plan, which has no readings, typical values of Ĉ are assumed.

The estimate is the posterior mean from the linearised model, and the model is linearised about the
estimate. The estimate is therefore computed by iteration, starting from the least-squares estimate
(module `reference_posterior`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ldbb_bayes.machine.chain import LINEAR
from ldbb_bayes.machine.parameters import ComplianceName
from ldbb_bayes.model.interest import ParametersOfInterest
from ldbb_bayes.model.linear_algebra import minimum_norm_solution
from ldbb_bayes.model.prior import Prior
from ldbb_bayes.model.reduction import Reduced
from ldbb_bayes.model.setting import Setting
from ldbb_bayes.results import Array

__all__ = [
    "MachineEstimate",
    "estimate_machine",
    "fit_nearest",
    "linearise",
    "nominal_mount_offset",
    "planned_compliances",
]

# Direct compliance of a typical machine tool [mm/N], which corresponds to a stiffness of 20 N/µm.
# This value is assumed for a direct compliance if no readings depend on it, as in a plan.
_USUAL_DIRECT_COMPLIANCE = 5e-5


class MachineEstimate(NamedTuple):
    """Estimated compliances and geometric errors of a machine.

    The values are in internal units (mm, N, rad) and in the order in which the model lists
    compliances and geometric errors.
    """

    compliances: Array
    #: standard uncertainties of the estimated compliances, in internal units (mm, N, rad); zero if
    #: the compliances are treated as known
    compliance_sd: Array
    geometric_errors: Array

    @classmethod
    def known(cls, compliances: Array, geometric_errors: Array) -> MachineEstimate:
        """Return an estimate of a machine whose compliances are treated as exactly known.

        ``compliances`` and ``geometric_errors`` are the estimated values in internal units
        (mm, N, rad). The standard uncertainties of the compliances are zero.
        """
        return cls(compliances, np.zeros(len(compliances)), geometric_errors)


def linearise(
    setting: Setting, compliances: Sequence[ComplianceName], estimate: MachineEstimate
) -> Setting:
    """Return the test conditions, supplemented with estimates of the machine's parameters.

    ``setting`` describes the test conditions. ``estimate`` holds the estimated parameters of the
    machine, which are compliances and geometric errors, and ``compliances`` the names of the
    compliances. The result is a copy of ``setting`` in which four fields are replaced. They are the
    estimated compliances; the magnitude of each compliance, in which the estimate and its
    uncertainty are added in quadrature; the magnitude of the direct compliance along each axis; and
    the readings that the estimates predict.
    """
    axial = np.zeros(3)
    axial_sd = np.zeros(3)
    for name, value, sd in zip(
        compliances, estimate.compliances, estimate.compliance_sd, strict=True
    ):
        if name.kind == "direct":
            axis = LINEAR.index(name.twist)
            axial[axis] += value
            axial_sd[axis] = np.hypot(axial_sd[axis], sd)
    elastic = setting.force_N[:, None] * (setting.elastic @ estimate.compliances)
    fitted = elastic + setting.geometric @ estimate.geometric_errors
    return replace(
        setting,
        compliance_estimate=estimate.compliances,
        compliance_size_estimate=np.hypot(estimate.compliances, estimate.compliance_sd),
        axial_size_estimate=np.hypot(axial, axial_sd),
        fitted=fitted,
    )


def nominal_mount_offset(setting: Setting) -> Array:
    """Return the nominal deflection of the work ball's mount contained in the readings [mm].

    The nominal deflection is proportional to the pressure (Eq. 32 of the article on the model). The
    result holds Fourier coefficients, shape (tests, 25), which are zero if the readings are
    compensated for the deflection. ``setting`` describes the test conditions.
    """
    nominal = 0.0 if setting.compensated else setting.deflection_um_per_bar * 1e-3
    return setting.constant(setting.pressure_bar * nominal)[:, :, 0]


def planned_compliances(compliances: Sequence[ComplianceName], prior: Prior) -> Array:
    """Return the compliances assumed for a plan, which has no readings, shape (compliances,).

    If the user gave a prior mean for a compliance, this mean is used. Otherwise the value is 5e-5
    mm/N for a direct compliance and zero for any other compliance.
    """
    values = []
    for name in compliances:
        usual = _USUAL_DIRECT_COMPLIANCE if name.kind == "direct" else 0.0
        values.append(prior.means.get(name.label, usual))
    return np.array(values)


def estimate_machine(
    interest: ParametersOfInterest, prior: Prior, setting: Setting, reduced: Sequence[Reduced]
) -> MachineEstimate:
    """Return compliances and geometric errors estimated by least squares from the whole campaign.

    Compliances are taken as constant in force, and those of the result are treated as exactly
    known. If the least-squares solution is not unique, the solution nearest to the prior mean is
    returned, with distances in units of the prior sd.

    A plan has no readings. Its geometric errors are set to their prior means, and its compliances
    to values that are assumed for a plan. In a campaign with readings, a compliance is set to its
    assumed value only if it influences no reading.

    Parameters
    ----------
    interest
        Parameters of interest of the campaign.
    prior
        Prior of the parameters. If it is flat, the prior of the first version of the model (preset
        ``first``) is used instead.
    setting
        Conditions of all tests.
    reduced
        Readings of every test, reduced to at most 25 numbers.
    """
    planned = planned_compliances(interest.compliances, prior)
    proper = Prior.first() if prior.flat else prior
    elastic = setting.force_N[:, None, None] * setting.elastic
    columns = np.concatenate([elastic, setting.geometric], axis=2)
    scale = np.concatenate(
        [interest.compliance_sd(proper), proper.geometric_sd(interest.geometric_errors)]
    )
    names = [name.label for name in interest.compliances]
    names += [name.label for name in interest.geometric_errors]
    mean = np.array([proper.means.get(name, 0.0) for name in names])
    estimate = fit_nearest(columns, mean, scale, reduced, nominal_mount_offset(setting))
    count = len(interest.compliances)
    if reduced[0].reading_mm is None:
        return MachineEstimate.known(planned, estimate[count:])
    visible = np.abs(setting.elastic).max(axis=(0, 1)) > 0.0
    compliances = np.where(visible, estimate[:count], planned)
    return MachineEstimate.known(compliances, estimate[count:])


def fit_nearest(
    columns: Array, near: Array, scale: Array, reduced: Sequence[Reduced], offset: Array
) -> Array:
    """Return a least-squares estimate of p parameters from the readings, shape (p,).

    If several estimates fit the readings equally well, the one nearest to the point ``near`` is
    returned. If there are no readings, as for a plan, ``near`` itself is returned.

    Parameters
    ----------
    columns
        Reading per unit of each of the p parameters, as 25 Fourier coefficients, shape
        (tests, 25, p).
    near
        Point in the space of the parameters, shape (p,).
    scale
        Unit of each parameter when the distance from the point is computed, shape (p,).
    reduced
        Readings of every test, reduced to at most 25 numbers.
    offset
        Known part of the readings, as Fourier coefficients, shape (tests, 25) [mm]. This part is
        subtracted from the readings.
    """
    rows = []
    values = []
    for r, test in enumerate(reduced):
        if test.reading_mm is None:
            return near
        rows.append(test.factor @ columns[r])
        values.append(test.reading_mm - test.factor @ offset[r])
    jacobian = np.concatenate(rows)
    residuals = np.concatenate(values) - jacobian @ near
    return near + minimum_norm_solution(jacobian, residuals, scale)
