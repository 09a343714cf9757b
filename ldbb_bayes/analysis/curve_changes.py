"""Compliances C(F), and their changes C(F_max) − C(F_min), as sums of coefficients.

A compliance C(F) depends on its slopes (coefficients of powers of the force F). A direct compliance
also depends on the coefficients of the term `JointLoad` (nonlinear deflection of joints under
load). Each compliance, and its change over the tested forces, is therefore a weighted sum of
coefficients of the linear model. The uncertainty of this sum can be computed without readings.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ldbb_bayes.inference.elastic_deflections import added_compliances, joint_load_of
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.parameter_kinds import compliance_unit
from ldbb_bayes.results import Array

__all__ = ["CurveChange", "compliance_weights", "curve_changes", "slopes_of"]


@dataclass(frozen=True, eq=False)
class CurveChange:
    """Change of one compliance C(F) from the smallest tested force F to the largest."""

    compliance: str  #: name of the compliance, such as C_XXX
    #: internal unit (composed of mm, N and rad) of the compliance and of its change with force
    unit: str
    smallest_force_N: float  #: smallest force tested, F_min [N]
    largest_force_N: float  #: largest force tested, F_max [N]
    #: names of the slopes, such as C_XXX_1, that the change of the compliance with force depends on
    slopes: tuple[str, ...]
    #: weight of each of the m coefficients of the model, shape (m,). The weight is the effect of
    #: the coefficient on the compliance's change with force, in ``unit``, if the coefficient
    #: changes by its prior standard deviation.
    weights: Array


def curve_changes(bound: BoundModel, information: Information) -> dict[str, CurveChange]:
    """Return a dict with the change of every compliance that may change with force.

    A compliance may change with force if it has a slope, or if it depends on the term `JointLoad`.
    The keys are the names of the compliances. The dict is empty if all tests have the same force.

    Parameters
    ----------
    bound
        Model applied to a campaign or plan.
    information
        Linear model of the readings (`Information`), at one value of the hyper-parameters.
    """
    force_N = bound.setting.force_N
    smallest_N = float(force_N.min())
    largest_N = float(force_N.max())
    changes: dict[str, CurveChange] = {}
    if not largest_N > smallest_N > 0.0:
        return changes
    at_largest = compliance_weights(bound, information, largest_N)
    at_smallest = compliance_weights(bound, information, smallest_N)
    for compliance in bound.compliances:
        weights = at_largest[compliance.label] - at_smallest[compliance.label]
        if not weights.any():
            continue
        changes[compliance.label] = CurveChange(
            compliance=compliance.label,
            unit=compliance_unit(compliance),
            smallest_force_N=smallest_N,
            largest_force_N=largest_N,
            slopes=slopes_of(bound, compliance.label),
            weights=weights,
        )
    return changes


def slopes_of(bound: BoundModel, compliance: str) -> tuple[str, ...]:
    """Return the names of a compliance's slopes, such as C_XXX_1 for the compliance C_XXX."""
    slopes = []
    for parameter in bound.parameters:
        if parameter.degree > 0 and parameter.compliance == compliance:
            slopes.append(parameter.name)
    return tuple(slopes)


def compliance_weights(
    bound: BoundModel, information: Information, force_N: float
) -> dict[str, Array]:
    """Return the effects of all coefficients on every compliance C(F) at one force F.

    An effect is the change of C(F) when one of the m coefficients alone changes by its prior sd. It
    is in the internal unit of the compliance. C(F) includes the term `JointLoad`.

    Parameters
    ----------
    bound
        Model applied to a campaign or plan.
    information
        Linear model of the readings (`Information`), at one value of the hyper-parameters.
    force_N
        Force F [N].

    Returns
    -------
    dict of array
        The effects, shape (m,). The keys are the names of the compliances.
    """
    rows = bound.compliance_at(force_N)
    weights_of = {}
    for index, compliance in enumerate(bound.compliances):
        weights = np.zeros(len(information.names))
        weights[information.interest] = rows[index]
        weights += _joint_load_weights(bound, information, compliance.label, force_N)
        weights_of[compliance.label] = weights * information.scale
    return weights_of


def _joint_load_weights(
    bound: BoundModel, information: Information, compliance: str, force_N: float
) -> Array:
    """Return the effect of each joint-load coefficient on a compliance at one force.

    ``compliance`` is the name of the compliance, and ``force_N`` the force [N]. The result, shape
    (m,), is the change of the compliance per unit of each of the m coefficients that
    ``information`` lists. It is zero for all coefficients that do not belong to the term
    `JointLoad` (nonlinear deflection of joints under load). All elements are zero if the term adds
    nothing to the compliance, for example because no circle moves its axis.
    """
    weights = np.zeros(len(information.names))
    joint_load = joint_load_of(bound)
    if joint_load is None:
        return weights
    # Change of a direct compliance per unit of each of the three coefficients of its axis.
    (secants,) = joint_load.secants(bound.setting, np.array([force_N]))
    for added in added_compliances(bound):
        if added.label == compliance:
            weights[added.places_in(information.names)] = secants
    return weights
