"""Posterior draws of compliances C(F) at the ends and at the middle of the tested bar forces F."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr

from ldbb_bayes.inference.coefficients import shared_terms
from ldbb_bayes.inference.posterior import bound_of, curves_of
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.prior import compliance_unit
from ldbb_bayes.model.terms import JointLoad
from ldbb_bayes.results import Array

__all__ = ["CurveDraws", "ForceCurves", "force_curves"]

# C(F) is a deflection divided by the force F. If the reference force is zero, C there is the limit
# for small forces, computed at this force [N].
_SMALLEST_FORCE_N = 1e-9


class CurveDraws(NamedTuple):
    """Posterior draws of one compliance C(F) at three forces, in its internal unit."""

    unit: str  #: internal unit of the compliance, such as mm/N
    at_smallest: Array  #: draws of C at the smallest force tested, shape (draws,)
    at_reference: Array  #: draws of C at the model's reference force, shape (draws,)
    at_largest: Array  #: draws of C at the largest force tested, shape (draws,)

    @property
    def change(self) -> Array:
        """Draws of the change C(F_max) − C(F_min) over the tested forces, shape (draws,)."""
        return np.asarray(self.at_largest - self.at_smallest)


@dataclass(frozen=True, eq=False)
class ForceCurves:
    """Posterior draws of the compliances that change with force, and the forces they are for."""

    smallest_force_N: float  #: smallest force tested, F_min [N]
    reference_force_N: float  #: reference force of the model, F0 [N]
    largest_force_N: float  #: largest force tested, F_max [N]
    compliances: dict[str, CurveDraws]  #: draws of each compliance C(F) by name, such as C_XXX


def force_curves(posterior: xr.DataTree) -> ForceCurves:
    """Return posterior draws of every compliance C(F) that may change with force.

    C(F) is the compliance at the reference force with its slopes, and for direct compliances with
    what the term `JointLoad` adds; see `curves_of`. The compliances are those with a slope, or with
    a part of `JointLoad`. There are none if all tests have one force. In an average over models, a
    compliance that is constant in the model of a draw has the same value at all forces.
    """
    bound = bound_of(posterior)
    tested_N = bound.setting.force_N
    reference_N = bound.setting.reference_force_N
    smallest_N = float(tested_N.min())
    largest_N = float(tested_N.max())
    compliances: dict[str, CurveDraws] = {}
    changing = _changing_compliances(bound)
    if changing and largest_N > smallest_N:
        forces_N = np.array([smallest_N, reference_N or _SMALLEST_FORCE_N, largest_N])
        curves = curves_of(posterior, forces_N)
        for index, compliance in enumerate(bound.compliances):
            if compliance.label in changing:
                unit = compliance_unit(compliance)
                compliances[compliance.label] = CurveDraws(unit, *curves[:, :, index].T)
    return ForceCurves(smallest_N, float(reference_N), largest_N, compliances)


def _changing_compliances(bound: BoundModel) -> set[str]:
    """Return the names of the compliances with a slope or with a part of `JointLoad`."""
    changing = {parameter.compliance for parameter in bound.parameters if parameter.degree > 0}
    of_joints: list[str] = []
    for columns in shared_terms(bound.columns_of.get(JointLoad, ())):
        of_joints += columns.names
    for compliance in bound.compliances:
        prefix = f"joint_load_{compliance.twist}_"
        if compliance.kind == "direct" and any(name.startswith(prefix) for name in of_joints):
            changing.add(compliance.label)
    return changing
