"""Posterior draws of compliances C(F): at any force, and at the ends of the tested forces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr

from ldbb_bayes.inference.elastic_deflections import added_compliances, joint_load_of
from ldbb_bayes.inference.posterior import bound_of, curves_of, draws_of, record_of
from ldbb_bayes.inference.posterior_cache import cached_by_posterior
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.parameter_kinds import compliance_unit
from ldbb_bayes.results import Array

__all__ = ["CurveDraws", "ForceCurves", "draws_at", "force_curves", "prior_changes"]

# Smallest force at which a compliance C(F) is computed [N]. C(F) is a deflection divided by the
# force F. A reference force of zero is replaced by this value, to avoid a division by zero.
_SMALLEST_FORCE_N = 1e-9
# Name of the term `JointLoad` (joints that deflect under their own load) among the alternative
# explanations of a model. Alternative explanations are effects that look like a change of
# compliance with force.
_JOINT_LOAD = "joint load"


class CurveDraws(NamedTuple):
    """Posterior draws of one compliance C(F) at three forces F, in a unit made of mm, N and rad.

    The forces are the smallest force tested, the reference force and the largest force tested.
    """

    unit: str  #: unit of the posterior draws of a compliance, such as mm/N
    #: posterior draws of a compliance at the smallest bar force tested, shape (draws,)
    at_smallest: Array
    #: posterior draws of a compliance at the reference force of the model, shape (draws,)
    at_reference: Array
    #: posterior draws of a compliance at the largest bar force tested, shape (draws,)
    at_largest: Array

    @property
    def change(self) -> Array:
        """Posterior draws of the change C(F_max) − C(F_min) of a compliance, shape (draws,).

        F_min and F_max are the smallest and the largest bar force tested.
        """
        return np.asarray(self.at_largest - self.at_smallest)


@dataclass(frozen=True, eq=False)
class ForceCurves:
    """Posterior draws of the compliances that may change with force, at three forces.

    The three forces are the smallest force tested, the reference force and the largest one tested.
    """

    smallest_force_N: float  #: smallest bar force tested, F_min [N]
    reference_force_N: float  #: reference force of the model, F0 [N]
    largest_force_N: float  #: largest bar force tested, F_max [N]
    #: posterior draws of each compliance C(F) at three bar forces F; the keys are the names of the
    #: compliances, such as C_XXX
    compliances: dict[str, CurveDraws]


def draws_at(posterior: xr.DataTree, force_N: float) -> dict[str, Array]:
    """Return posterior draws of every parameter, in units composed of mm, N and rad.

    The result is a dict of arrays of shape (draws,); its keys are the names of the parameters.
    Compliances are computed at the force ``force_N`` of the bar. Slopes (coefficients of the change
    of compliances with force) and geometric errors do not depend on this force. If the posterior is
    an average over models, two parameters' draws with the same index may come from different
    models.
    """
    bound = bound_of(posterior)
    draws = dict(zip(bound.names, draws_of(posterior, bound)[0].T, strict=True))
    if force_N == bound.setting.reference_force_N:
        return draws
    curves = curves_of(posterior, np.array([force_N]))[:, 0]
    for j, compliance in enumerate(bound.compliances):
        draws[compliance.label] = curves[:, j]
    return draws


@cached_by_posterior
def force_curves(posterior: xr.DataTree) -> ForceCurves:
    """Return posterior draws of every compliance C(F) that may change with force.

    C(F) is computed from the compliance at the reference force and its slopes (changes with force).
    If the model has the term `JointLoad` (joints that deflect under their own load), direct
    compliances also contain the contribution of this term; see `curves_of`. A compliance may change
    with force if it has a slope or a contribution of `JointLoad`. The result holds no compliances
    if all tests have the same force. For an average over models, each draw comes from one model; if
    the compliance is constant in this model, the draw has the same value at all forces.
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


def prior_changes(posterior: xr.DataTree) -> dict[str, Array]:
    """Return prior draws of the change of every compliance C(F) that may change with force.

    The change is C(F_max) − C(F_min), from the smallest force tested to the largest. The result is
    a dict; its keys are the names of the compliances, as in `force_curves`. For an average over
    models, the prior draws come from all models, including the models with constant compliances. If
    a third of the models, for example, have the term `JointLoad` (joints that deflect under their
    own load), its effect is added to a third of the draws, picked at random. The dict is empty if
    the prior is flat or if all tests have the same force.
    """
    bound = bound_of(posterior)
    tested_N = bound.setting.force_N
    ends_N = np.array([tested_N.min(), tested_N.max()])
    changes: dict[str, Array] = {}
    if bound.model.prior.flat or not ends_N[1] > ends_N[0]:
        return changes
    group = posterior["prior"].dataset
    beta = np.stack([np.ravel(group[name].values) for name in bound.names], axis=1)
    rows = bound.compliance_at(ends_N[1]) - bound.compliance_at(ends_N[0])
    rng = np.random.default_rng(0)
    has_joint_load = rng.random(len(beta)) < _share_with_joint_load(posterior)
    joint_load_sd = _joint_load_sd_of_change(bound, ends_N)
    changing = _changing_compliances(bound)
    for index, compliance in enumerate(bound.compliances):
        if compliance.label in changing:
            change = beta @ rows[index]
            if compliance.label in joint_load_sd:
                sd = joint_load_sd[compliance.label]
                change = change + has_joint_load * rng.normal(0.0, sd, len(beta))
            changes[compliance.label] = change
    return changes


def _share_with_joint_load(posterior: xr.DataTree) -> float:
    """Return the fraction of the averaged models that have the term `JointLoad`.

    If the posterior is of a single model, the result is 1.
    """
    averaged = record_of(posterior).get("averaged")
    if averaged is None:
        return 1.0
    return float(np.mean([_JOINT_LOAD in model["rivals"] for model in averaged["models"]]))


def _joint_load_sd_of_change(bound: BoundModel, ends_N: Array) -> dict[str, float]:
    """Return the prior standard deviations of the changes of direct compliances due to `JointLoad`.

    `JointLoad` is the term of a model for joints that deflect under their own load. Because of this
    term, the direct compliance along a machine axis changes from the smallest force tested to the
    largest; ``ends_N`` holds these two forces [N]. The result is a dict; its keys are the names of
    the direct compliances. ``bound`` is the model of the campaign.
    """
    joint_load = joint_load_of(bound)
    if joint_load is None:
        return {}
    at_smallest, at_largest = joint_load.secants(bound.setting, ends_N)
    sd_by_compliance = {}
    for added in added_compliances(bound):
        sd = np.linalg.norm((at_largest - at_smallest) * added.columns.sd)
        sd_by_compliance[added.label] = float(sd)
    return sd_by_compliance


def _changing_compliances(bound: BoundModel) -> set[str]:
    """Return the names of the compliances that may change with the force of the bar.

    A compliance may change with force if it has a slope, or if the term `JointLoad` (joints that
    deflect under their own load) contributes to it.
    """
    changing = {parameter.compliance for parameter in bound.parameters if parameter.degree > 0}
    return changing | {added.label for added in added_compliances(bound)}
