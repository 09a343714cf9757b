"""Changes C(F_max) − C(F_min) of compliances over the tested forces, as sums of coefficients.

The change of a compliance C(F) depends on its slopes (coefficients of powers of the force). The
change of a direct compliance also depends on the coefficients of the term `JointLoad` (nonlinear
deflection of joints under load). Each change is therefore a weighted sum of coefficients of the
linear model. The uncertainty of this sum can be computed without readings.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.prior import compliance_unit
from ldbb_bayes.model.terms import JointLoad
from ldbb_bayes.model.terms.joints import joint_load_columns
from ldbb_bayes.results import Array

__all__ = ["CurveChange", "curve_changes"]


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
    rows = bound.compliance_at(largest_N) - bound.compliance_at(smallest_N)
    interest = information.interest
    for index, compliance in enumerate(bound.compliances):
        weights = np.zeros(len(information.names))
        weights[interest] = rows[index]
        if compliance.kind == "direct":
            weights += _joint_load_weights(bound, information, compliance.twist)
        if not weights.any():
            continue
        slopes = [
            parameter.name
            for parameter in bound.parameters
            if parameter.degree > 0 and parameter.compliance == compliance.label
        ]
        changes[compliance.label] = CurveChange(
            compliance=compliance.label,
            unit=compliance_unit(compliance),
            smallest_force_N=smallest_N,
            largest_force_N=largest_N,
            slopes=tuple(slopes),
            weights=weights * information.scale,
        )
    return changes


def _joint_load_weights(bound: BoundModel, information: Information, axis: str) -> Array:
    """Return the effect of each joint-load coefficient on a compliance's change with force.

    The compliance is the direct compliance of ``axis``. Its change is its value at the largest
    tested force minus its value at the smallest. The result, shape (m,), is this change per unit of
    each of the m coefficients that ``information`` lists. It is zero for all coefficients that do
    not belong to the term `JointLoad` (nonlinear deflection of joints under load). All elements are
    zero if the model does not have this term, or if no circle moves the axis.
    """
    weights = np.zeros(len(information.names))
    columns = joint_load_columns(bound.setting, bound.columns_of.get(JointLoad, ())).get(axis)
    if columns is None:
        return weights
    places = [information.names.index(name) for name in columns.names]
    for term in bound.model.nuisances:
        if isinstance(term, JointLoad):
            force_N = bound.setting.force_N
            ends_N = np.array([force_N.min(), force_N.max()])
            # The term `JointLoad` has three coefficients for the axis. ``secants``, shape (2, 3),
            # holds the change of the compliance per unit of each of these coefficients: first at
            # the smallest force tested, then at the largest.
            secants = term.secants(bound.setting, ends_N)
            weights[places] = secants[1] - secants[0]
    return weights
