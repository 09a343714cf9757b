"""Difference of every parameter between two campaigns on machines of the same kind.

Examples are a machine before and after a repair, or machines A and B. With different instruments
and machines, the two posteriors are independent. With the same bar, balls, mount and force device,
the errors of the instrument largely cancel in the difference. With the same machine, the deflection
of its joints largely cancels, as far as it is not proportional to the force (`common_effects`).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import comb
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from scipy.special import ndtr, ndtri

from ldbb_bayes.analysis.circle_columns import is_tool_ball_offset
from ldbb_bayes.analysis.common_effects import Conflict, Shared, joint_difference
from ldbb_bayes.analysis.compliance_meaning import same_meaning, stands_for
from ldbb_bayes.analysis.differing_models import differing_parts
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.deprecation import renamed_keyword
from ldbb_bayes.errors import check_probability, require
from ldbb_bayes.inference.elastic_deflections import joint_load_secants
from ldbb_bayes.inference.fit import ConcernKind
from ldbb_bayes.inference.force_curves import draws_at
from ldbb_bayes.inference.posterior import bound_of, draws_of, fit_of, record_of
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, readable

__all__ = ["compare_posteriors", "states_two_machines"]

# Number of pairs of posterior draws from which the credible interval of a difference is computed.
# Each pair combines a draw of the first campaign with a draw of the second campaign.
_DRAWS = 20_000
# Warnings of the two fits that the table of differences states, as attributes. The keys are the
# names of the attributes.
_CONCERNS_STATED = {
    "contradicted_priors": ConcernKind.PRIOR,
    "doubted_units": ConcernKind.UNIT,
}


class _Differences(NamedTuple):
    """Posterior means of n parameters in two campaigns, and differences between the campaigns."""

    means: Array  #: posterior means of n parameters in two campaigns, shape (2, n)
    #: posterior mean of the difference of each of n parameters, second campaign minus first, shape
    #: (n,)
    difference: Array
    #: standard uncertainties of the differences of n parameters between two campaigns, shape (n,)
    sd: Array
    #: lower and upper ends of the equal-tailed credible intervals of the differences of n
    #: parameters between two campaigns, shape (2, n)
    interval: Array
    #: for each of n parameters, the probability that the parameter is larger in the second campaign
    #: than in the first, shape (n,)
    increase: Array
    #: common effect about which the readings of the two campaigns disagree most. None if
    #: instruments and machines are different, or if there is no common effect about which both
    #: campaigns give information.
    conflict: Conflict | None = None


@one_blas_thread
@renamed_keyword("ci_prob", "prob")
def compare_posteriors(
    posterior: xr.DataTree,
    other: xr.DataTree,
    *,
    same_instrument: bool = False,
    same_machine: bool = False,
    prob: float = 0.95,
) -> pd.DataFrame:
    """Return the difference of every parameter between two campaigns, second minus first.

    For example, the campaigns were run before and after a repair, or on two machines of the same
    kind.

    Parameters
    ----------
    posterior, other : DataTree
        First and second posterior, from `sample` or `load`, or, if instruments and machines are
        independent, from `average`. Their machines must have the same topology and joint frames,
        and the same planes must have been tested.
    same_instrument : bool
        Whether bar, balls, mount and force device were the same in both campaigns. If so, the
        errors of these parts largely cancel in the difference.
    same_machine : bool
        Whether both campaigns were run on one machine. If so, the coefficients of `JointLoad`,
        `Position` and `MachinePattern`, divided by their prior standard deviations, are nearly the
        same in both campaigns (prior correlation 0.99). For the last two, this is assumed only if
        the circles of both campaigns have the same planes, radii, centres and directions.
        Compliances, their changes with force and geometric errors may have changed by any amount.
    prob : float
        Probability of the equal-tailed intervals, between 0 and 1.

    Returns
    -------
    DataFrame
        One row for each parameter that occurs in both posteriors; offsets of the tool ball are left
        out. The columns are:

        - ``unit``: internal unit of the parameter, composed of mm, N and rad;
        - ``first`` and ``second``: posterior means in the two campaigns, both at the reference
          force of the first campaign;
        - ``difference`` and ``sd``: second minus first, and the standard uncertainty of this
          difference;
        - ``ci_low`` and ``ci_high``: ends of the credible interval of the difference;
        - ``probability_of_increase``: probability that the parameter is larger in the second
          campaign.

        If the instrument or the machine was the same, ``attrs["conflict"]`` names the common effect
        about which the readings of the two campaigns disagree most, and states the p-value of the
        disagreement (with Bonferroni correction). What the campaigns state of the common
        instrument, such as the mount's deflection, may disagree as well. If the p-value is below
        1 %, the differences cannot be used: `changed_parameters` then names no changes and raises
        an error. If both were different, or if there is no common effect about which both campaigns
        give information, ``attrs["conflict"]`` is None.

        ``attrs["contradicted_priors"]`` holds two tuples, one for each posterior: the names of the
        parameters whose prior the readings contradict. ``attrs["doubted_units"]`` holds two tuples
        likewise: the names of the tests whose readings probably are in another unit. The
        differences cannot be used if any of these is not empty. ``attrs["fits"]`` holds two
        ``Fit``s: how well each model fits its readings, with all warnings.
        ``attrs["differing_parts"]`` names the parts in which the two models differ, such as
        ``priors``.

    Raises
    ------
    InputError
        If the probability is not between 0 and 1; if both posteriors come from the same readings;
        if they belong to different machines or different planes; or if a compliance is not the sum
        of the same joint compliances in both, because circles have other centres. If
        ``same_machine`` is true, also if the campaigns state different serial numbers or
        machine_ids. If it or ``same_instrument`` is true, also if a prior is flat, or a posterior
        is averaged over models.

    Examples
    --------
    >>> simple = lb.HybridModel.first(0)
    >>> softer = simple.simulate(campaign, seed=2, parameters={"C_XXX": 90e-6}).campaign
    >>> before = lb.sample(simple, campaign, sampler="independent")
    >>> after = lb.sample(simple, softer, sampler="independent")
    >>> table = lb.analysis.compare_posteriors(before, after)
    >>> bool(table.loc["C_XXX", "probability_of_increase"] > 0.99)
    True
    """
    check_probability(prob)
    first = bound_of(posterior)
    second = bound_of(other)
    name_of_other = record_of(other)["campaign"]["name"]
    _check_comparable_machines(first, second, name_of_other)
    _check_same_compliances(first, second, name_of_other)
    if same_machine:
        _check_same_machine(first.campaign, second.campaign, name_of_other)
    names = _common_parameters(first, second)
    levels = np.array([0.5 - 0.5 * prob, 0.5 + 0.5 * prob])
    shared = Shared(instrument=same_instrument, machine=same_machine)
    if shared.anything:
        compared = _compare_jointly((posterior, other), names, shared, levels)
    else:
        compared = _compare_independent((posterior, other), names, levels)
    units = [first.parameters[first.names.index(name)].unit for name in names]
    table = pd.DataFrame(
        {
            "unit": units,
            "first": compared.means[0],
            "second": compared.means[1],
            "difference": compared.difference,
            "sd": compared.sd,
            "ci_low": compared.interval[0],
            "ci_high": compared.interval[1],
            "probability_of_increase": compared.increase,
        },
        index=names,
    )
    table.attrs["conflict"] = None
    if compared.conflict is not None:
        table.attrs["conflict"] = tuple(compared.conflict)
    fits = (fit_of(posterior), fit_of(other))
    table.attrs["fits"] = fits
    for key, kind in _CONCERNS_STATED.items():
        table.attrs[key] = tuple(fit.names_of_concerns(kind) for fit in fits)
    table.attrs["differing_parts"] = differing_parts(first.model, second.model)
    return readable(table, f"Second less first, {100 * prob:g} % intervals")


def _common_parameters(first: BoundModel, second: BoundModel) -> list[str]:
    """Return the names of the parameters that two models have, without offsets of the tool ball."""
    names = []
    for name, is_offset in zip(first.names, is_tool_ball_offset(first), strict=True):
        if not is_offset and name in second.names:
            names.append(name)
    return names


def _compare_jointly(
    posteriors: Sequence[xr.DataTree], names: Sequence[str], shared: Shared, levels: Array
) -> _Differences:
    """Return the differences of the parameters ``names`` between campaigns with common effects.

    The posterior of each difference is taken to be normal. It is computed at the posterior means of
    the hyper-parameters, and at the reference force of the first campaign.

    ``posteriors`` are those of the two campaigns. ``shared`` states what the campaigns have in
    common. ``levels``, shape (2,), are the probabilities below the lower and the upper end of the
    credible interval of each difference. Raise an `InputError` if a posterior is averaged over
    several models.
    """
    for posterior in posteriors:
        _check_single_model(posterior)
    bounds = [bound_of(posterior) for posterior in posteriors]
    reference_force_N = bounds[0].setting.reference_force_N
    phi = []
    rows = []
    for posterior, bound in zip(posteriors, bounds, strict=True):
        _, phi_of_draws = draws_of(posterior, bound)
        phi.append(phi_of_draws.mean(axis=0))
        rows.append(_rows_at_force(bound, names, reference_force_N))
    joint = joint_difference(bounds, phi, rows, shared)
    return _Differences(
        means=joint.means,
        difference=joint.difference,
        sd=joint.sd,
        interval=joint.difference + ndtri(levels)[:, None] * joint.sd,
        increase=ndtr(joint.difference / joint.sd),
        conflict=joint.conflict,
    )


def _compare_independent(
    posteriors: Sequence[xr.DataTree], names: Sequence[str], levels: Array
) -> _Differences:
    """Return the differences of the parameters ``names`` between two independent posteriors.

    Both are at the reference force of the first campaign. ``levels``, shape (2,), are the
    probabilities below the lower and the upper end of the credible interval of each difference.
    """
    reference_force_N = bound_of(posteriors[0]).setting.reference_force_N
    first, second = (
        _values_at_force(posterior, names, reference_force_N) for posterior in posteriors
    )
    means = np.array([first.mean(axis=0), second.mean(axis=0)])
    rng = np.random.default_rng(0)
    second_draws = second[rng.integers(len(second), size=_DRAWS)]
    first_draws = first[rng.integers(len(first), size=_DRAWS)]
    draws = second_draws - first_draws
    return _Differences(
        means=means,
        difference=means[1] - means[0],
        sd=np.sqrt(first.var(axis=0) + second.var(axis=0)),
        interval=np.quantile(draws, levels, axis=0),
        increase=(draws > 0.0).mean(axis=0),
    )


def _check_comparable_machines(first: BoundModel, second: BoundModel, name: str) -> None:
    """Raise an `InputError` if the parameters of two campaigns cannot be compared.

    ``first`` and ``second`` are the models of the two campaigns. The readings of the campaigns must
    differ. Their machines must have the same topology and joint frames, and the same planes must
    have been tested. ``name`` is the name of the second campaign, for the error message.
    """
    campaign = first.campaign
    other = second.campaign
    require(
        campaign.circles_sha256 != other.circles_sha256,
        f"results must be of different readings, got those of {name!r} twice (SHA-256"
        f" {other.sha256[:12]}…). Name another campaign; to compare models of one campaign use"
        " compare.",
    )
    require(
        campaign.topology == other.topology,
        f"results must be of machines with the same topology, got {campaign.topology!r} and"
        f" {other.topology!r} ({name!r}). Compare campaigns of one kind of machine.",
    )
    require(
        campaign.frames_mm == other.frames_mm,
        f"results must be of machines with the same frames_mm, got {campaign.frames_mm!r} and"
        f" {other.frames_mm!r} ({name!r}). Compare campaigns of one kind of machine.",
    )
    require(
        set(first.setting.planes) == set(second.setting.planes),
        f"results must be of the same planes, got {', '.join(first.setting.planes)} and"
        f" {', '.join(second.setting.planes)} ({name!r}): a compliance would stand for other sets."
        " Compare campaigns of the same planes.",
    )


def _check_same_compliances(first: BoundModel, second: BoundModel, name: str) -> None:
    """Raise an `InputError` if a compliance is the sum of other joint compliances in two campaigns.

    If circles are at another height, for example, or joints' frames stand elsewhere, tilts of the
    joints add to other compliances. The two compliances would differ although the machine is the
    same. ``name`` is the name of the second campaign, for the error message.
    """
    sums = stands_for(first.campaign)
    other_sums = stands_for(second.campaign)
    for compliance in sums:
        require(
            compliance not in other_sums
            or same_meaning(compliance, sums[compliance], other_sums[compliance]),
            f"results must mean the same by {compliance}, got it as the sum of other compliances"
            f" in {name!r}: its circles have other centres. Compare campaigns of circles at the"
            " same places.",
        )


def _check_single_model(posterior: xr.DataTree) -> None:
    """Raise an `InputError` if a posterior is averaged over several models."""
    record = record_of(posterior)
    require(
        "averaged" not in record,
        "results must be of one model each to have the instrument or the machine in common, got"
        f" {record['campaign']['name']!r} averaged over models. Give fits (sample), or leave out"
        " same_instrument and same_machine.",
    )


def states_two_machines(campaign: Campaign, other: Campaign) -> bool:
    """Return whether two campaigns state that their machines are different ones.

    Serial numbers decide, or the names of the machines where neither campaign has a serial number.
    What only one of the campaigns states decides nothing.
    """
    field = _identity_field(campaign, other)
    first = getattr(campaign, field)
    second = getattr(other, field)
    return first is not None and second is not None and first != second


def _identity_field(campaign: Campaign, other: Campaign) -> str:
    """Return the name of the field that identifies the machines of two campaigns."""
    if campaign.serial_number is None and other.serial_number is None:
        return "machine_id"
    return "serial_number"


def _check_same_machine(campaign: Campaign, other: Campaign, name: str) -> None:
    """Raise an `InputError` if two campaigns state that their machines are different ones.

    ``name`` is the name of the second campaign, for the error message.
    """
    field = _identity_field(campaign, other)
    first = getattr(campaign, field)
    second = getattr(other, field)
    require(
        not states_two_machines(campaign, other),
        f"{field} must be the same in both campaigns of one machine, got {first!r} and {second!r}"
        f" ({name!r}). Correct it in campaign.toml and fit again, or leave out same_machine"
        " (--same-machine).",
    )


def _values_at_force(
    posterior: xr.DataTree, names: Sequence[str], reference_force_N: float
) -> Array:
    """Return draws of the n parameters ``names`` at a reference force, shape (draws, n).

    The model of the posterior may have another reference force. Compliances contain what
    `JointLoad` adds at the force ``reference_force_N`` [N].
    """
    bound = bound_of(posterior)
    rows = _rows_at_force(bound, names, reference_force_N)
    beta = draws_of(posterior, bound)[0]
    values = beta @ np.stack([rows[name] for name in bound.names])
    if joint_load_secants(bound, reference_force_N):
        draws = draws_at(posterior, reference_force_N)
        for compliance in bound.compliances:
            if compliance.label in names:
                values[:, names.index(compliance.label)] = draws[compliance.label]
    return values


def _rows_at_force(
    bound: BoundModel, names: Sequence[str], reference_force_N: float
) -> dict[str, Array]:
    """Return what each coefficient of a model adds to its parameters at another reference force.

    ``bound`` is the model of one campaign, with parameters at its own reference force. The keys of
    the result are the names of these parameters, and of the coefficients of `JointLoad`. The
    arrays, shape (n,), hold what one unit of a coefficient adds to each of the n parameters
    ``names`` at the reference force ``reference_force_N`` [N].

    A compliance is a polynomial in F − F0, the force minus the reference force. Its coefficients
    for another reference force follow from the binomial theorem. Direct compliances also contain
    what `JointLoad` adds. Geometric errors do not depend on the reference force.
    """
    rows = {name: np.zeros(len(names)) for name in bound.names}
    shift_N = reference_force_N - bound.setting.reference_force_N
    for i, name in enumerate(names):
        target = bound.parameters[bound.names.index(name)]
        if target.group == "geometric":
            rows[name][i] = 1.0
            continue
        for parameter, parameter_name in zip(bound.parameters, bound.names, strict=True):
            same_compliance = (
                parameter.group != "geometric" and parameter.compliance == target.compliance
            )
            power = parameter.degree - target.degree
            if same_compliance and power >= 0:
                rows[parameter_name][i] = comb(parameter.degree, target.degree) * shift_N**power
    for name, secants in joint_load_secants(bound, reference_force_N).items():
        if name in names:
            for coefficient, secant in secants.items():
                rows.setdefault(coefficient, np.zeros(len(names)))[names.index(name)] = secant
    return rows
