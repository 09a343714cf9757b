"""Gaussian likelihood of one campaign: the posterior of its fit divided by the prior of this fit.

The likelihood is a function of q quantities: parameters of the machine, errors of the instrument
and effects of the machine. Compliances are converted to a reference force that all campaigns have
in common.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ldbb_bayes.errors import InputError
from ldbb_bayes.machine.parameters import ComplianceName
from ldbb_bayes.model.terms import JointLoad
from ldbb_bayes.model.terms.joints import joint_load_names, secants_along_axis
from ldbb_bayes.results import Array
from ldbb_bayes.units import is_compliance_or_slope

__all__ = ["SLOPE_NAME", "CampaignLikelihood", "campaign_likelihood"]

# Pattern of the names of the coefficients of a compliance's change with force: slopes, such as
# C_XXX_1, and curvatures, such as C_XXX_2.
SLOPE_NAME = re.compile(r"(C_.+)_([12])")


class CampaignLikelihood(NamedTuple):
    """Likelihood of q quantities from one campaign, and their prior in the campaign's fit.

    The quantities are parameters of the machine, errors of the instrument and effects of the
    machine.
    """

    #: precision matrix (inverse covariance) of the likelihood of q quantities, shape (q, q)
    precision: Array
    #: precision matrix of the likelihood times the estimate of the q quantities, shape (q,). The
    #: estimate is the maximum of the likelihood.
    shift: Array
    prior_mean: Array  #: prior means, in the campaign's fit, of the q quantities, shape (q,)
    #: prior standard deviations, in the campaign's fit, of the q quantities, shape (q,)
    prior_sd: Array


def campaign_likelihood(
    row: Mapping[Any, Any], wanted: Sequence[str], force_N: float
) -> CampaignLikelihood:
    """Return the likelihood of a campaign: the Gaussian posterior of its fit divided by the prior.

    Parameters
    ----------
    row : row of the campaign in the table of a batch, with the posterior moments and the priors of
        the campaign's fit.
    wanted : names of the q quantities. In the likelihood, precision and shift are zero for
        quantities that are not in the campaign's fit.
    force_N : reference force common to all campaigns [N]. Compliances are converted to this force
        by means of their slopes and curvatures (linear and quadratic changes with force), and of
        `JointLoad`.
    """
    names = list(row["gaussian_names"])
    mean = np.array(row["gaussian_mean"], dtype=float)
    prior_mean = np.array(row["gaussian_prior_mean"], dtype=float)
    prior_sd = np.array(row["gaussian_prior_sd"], dtype=float)
    covariance = _full_covariance(row["gaussian_covariance"], len(names))
    _require_nominal_mount(row, dict(zip(names, prior_mean.tolist(), strict=True)))
    to_force = _map_to_force(names, wanted, force_N, row)
    present = np.flatnonzero(to_force.any(axis=1))
    columns = [names.index(wanted[int(i)]) for i in present]
    to_force = to_force[present]
    precision, shift = _divide_out_prior(
        mean=to_force @ mean,
        covariance=to_force @ covariance @ to_force.T,
        prior_mean=to_force @ prior_mean,
        prior_covariance=(to_force * prior_sd**2) @ to_force.T,
    )
    likelihood = CampaignLikelihood(
        precision=np.zeros((len(wanted), len(wanted))),
        shift=np.zeros(len(wanted)),
        prior_mean=np.zeros(len(wanted)),
        prior_sd=np.zeros(len(wanted)),
    )
    likelihood.precision[np.ix_(present, present)] = precision
    likelihood.shift[present] = shift
    likelihood.prior_mean[present] = prior_mean[columns]
    likelihood.prior_sd[present] = prior_sd[columns]
    return likelihood


def _require_nominal_mount(row: Mapping[Any, Any], prior_mean: Mapping[str, float]) -> None:
    """Raise an `InputError` for a row of an earlier version, without the mount's deflection.

    Such a row states the error of the deflection about an unknown nominal value. ``prior_mean``
    holds the prior mean of every quantity of the row.
    """
    if prior_mean.get("mount") == 0.0:
        raise InputError(
            f"the row of {row['campaign']} must hold the mount's deflection, got one of an earlier"
            " version, which holds its error alone. Run batch again."
        )


def _divide_out_prior(
    *, mean: Array, covariance: Array, prior_mean: Array, prior_covariance: Array
) -> tuple[Array, Array]:
    """Return the precision (q, q) and the shift (q,) of a likelihood.

    The likelihood is a posterior divided by its prior; all three are Gaussian functions of q
    quantities. The arguments are the means, shape (q,), and the covariances, shape (q, q), of the
    posterior and of the prior. The precision (inverse covariance) of the likelihood is the
    precision of the posterior minus the precision of the prior. Negative eigenvalues of this
    difference are set to zero, because the readings add nothing to the prior in the directions of
    the corresponding eigenvectors. The shift is the precision times the estimate.
    """
    scale = np.sqrt(np.diag(prior_covariance))
    squared_scale = scale[:, None] * scale
    posterior_precision = np.linalg.inv(covariance / squared_scale)
    prior_precision = np.linalg.inv(prior_covariance / squared_scale)
    symmetric_precision = 0.5 * (posterior_precision + posterior_precision.T)
    gain, directions = np.linalg.eigh(symmetric_precision - prior_precision)
    informed = directions * (gain > 0.0)
    posterior_shift = posterior_precision @ (mean / scale)
    prior_shift = prior_precision @ (prior_mean / scale)
    precision = (informed * gain) @ informed.T / squared_scale
    shift = informed @ (informed.T @ (posterior_shift - prior_shift)) / scale
    return precision, shift


def _full_covariance(lower_triangle: Sequence[float], q: int) -> Array:
    """Return the covariance matrix of q quantities, shape (q, q), from its lower triangle.

    ``lower_triangle`` lists the elements of the lower triangle row by row.
    """
    covariance = np.zeros((q, q))
    covariance[np.tril_indices(q)] = lower_triangle
    covariance += np.tril(covariance, -1).T
    return covariance


def _map_to_force(
    names: Sequence[str], wanted: Sequence[str], force_N: float, row: Mapping[Any, Any]
) -> Array:
    """Return the matrix that converts a campaign's quantities to the force ``force_N`` [N].

    The rows of the matrix belong to the quantities ``wanted``, and the columns to the quantities
    ``names`` that the campaign has. ``row`` is the row of the campaign in the table of a batch. Let
    ΔF be ``force_N`` minus the reference force of the campaign. A compliance at ``force_N`` is the
    compliance at the reference force, plus its slope times ΔF, plus its curvature times ΔF². A
    direct compliance also changes by what `JointLoad` adds. Slopes and coefficients of `JointLoad`
    are returned as they are; those of quadratic compliance, which depend on the reference force,
    must not be among ``wanted``.
    """
    reference_N = float(row["reference_force_N"])
    matrix = np.zeros((len(wanted), len(names)))
    for i, name in enumerate(wanted):
        for power, coefficient in enumerate((name, f"{name}_1", f"{name}_2")):
            if coefficient in names:
                matrix[i, names.index(coefficient)] = (force_N - reference_N) ** power
        for coefficient, secant in _joint_load(name, force_N, row).items():
            if coefficient in names:
                matrix[i, names.index(coefficient)] = secant
    return matrix


def _joint_load(name: str, force_N: float, row: Mapping[Any, Any]) -> dict[str, float]:
    """Return by how much the coefficients of `JointLoad` change a compliance at another force.

    The keys of the result are the names of the coefficients; it is empty if the compliance ``name``
    is not a direct one. ``row`` is the row of the campaign in the table of a batch, and ``force_N``
    the other force [N].
    """
    if not is_compliance_or_slope(name) or SLOPE_NAME.fullmatch(name) is not None:
        return {}
    compliance = ComplianceName(*name.removeprefix("C_"))
    reference_N = float(row["reference_force_N"])
    if compliance.kind != "direct" or force_N == reference_N:
        return {}
    coefficients = joint_load_names(compliance.twist)
    if force_N == 0.0 and any(coefficient in row["gaussian_names"] for coefficient in coefficients):
        raise InputError(
            "reference_force_N must be positive where joints yield to their own load (JointLoad),"
            " got 0. Give a force that was tested."
        )
    if JointLoad.__name__ in row["terms"] and coefficients[0] not in row["gaussian_names"]:
        raise InputError(
            f"the row of {row['campaign']} must hold what JointLoad adds to {name} at"
            f" {force_N:g} N, got one of an earlier version. Run batch again, or give the force"
            f" {reference_N:g} N."
        )
    secants = secants_along_axis(np.array([force_N]), reference_N, float(row["force_max_N"]))
    return dict(zip(coefficients, secants[0].tolist(), strict=True))
