"""Conformity with tolerances.

The probability of conformance is p = P(lower ≤ η ≤ upper | y) of JCGM 106, for a quantity η with
tolerance limits ``lower`` and ``upper``, given the readings y. The decision follows ISO 14253-1.
The quantity conforms if p is at least the confidence that the user asks for. It does not conform if
1 − p is at least this confidence. In all other cases, no decision is made. For a normal posterior
and one limit, a quantity conforms if its estimate lies inside the limit, at least a guard band away
from it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np
import xarray as xr
from scipy.special import ndtr, ndtri

from ldbb_bayes.analysis.circularity import path_draws
from ldbb_bayes.analysis.directional_stiffness import stiffness_draws
from ldbb_bayes.analysis.stated_quantities import stiffness_from
from ldbb_bayes.analysis.tolerances import (
    PATH_QUANTITIES,
    STIFFNESS_QUANTITIES,
    Tolerance,
    name_in_plane,
    quantities_of,
    tolerances_in,
)
from ldbb_bayes.campaign.tested_forces import check_force, force_to_state
from ldbb_bayes.errors import require
from ldbb_bayes.inference.force_curves import draws_at
from ldbb_bayes.inference.posterior import bound_of
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, ByName, Result
from ldbb_bayes.units import is_direct

__all__ = [
    "Conformity",
    "Decision",
    "assess_conformity",
    "normal_conformity",
    "quantity_draws",
    "stiffness_conformity",
]

# If at least this number of posterior draws lie on one side of a tolerance limit, the probability
# of this side is the number of these draws divided by the number of all draws. If fewer draws lie
# there, the probability is computed from a normal distribution. It is then limited: it is at least
# the share of the draws on this side, and at most ``_FEWEST_DRAWS`` divided by the number of all
# draws.
_FEWEST_DRAWS = 10
# Number of posterior draws for which the machine's circular path is computed.
_PATH_DRAWS = 2000
# Number of batches of posterior draws from which the numerical error of a probability is computed.
_BATCHES = 20
# Smallest standard deviation by which values are divided. A smaller posterior standard deviation is
# replaced by this number, to avoid a division by zero.
_LEAST_SD = 1e-300
# Probabilities below the lower and the upper end of the equal-tailed 95 % credible intervals.
_LEVELS = (0.025, 0.975)


class Decision(StrEnum):
    """Decision on conformity with a tolerance by the rules of ISO 14253-1."""

    CONFORMS = "conforms"
    DOES_NOT_CONFORM = "does not conform"
    NOT_DECIDED = "not decided"


@dataclass(frozen=True)
class Conformity(Result):
    """Decision whether a quantity conforms with its tolerance.

    The unit ``unit`` of the quantity is composed of mm, N and rad. If a stiffness may be infinite,
    because its compliance may be zero, only the lower end of its 95 % interval is known: its value,
    mean, standard uncertainty, guard band and upper end are None.

    Examples
    --------
    >>> decisions = lb.assess_conformity(posterior, {"stiffness_X": "18 N/µm"})
    >>> stiffness = decisions["stiffness_X"]
    >>> stiffness.limits  # N/mm
    (18000.0, inf)
    >>> round(stiffness.probability, 1), stiffness.decision.value
    (0.6, 'not decided')
    """

    #: unit of the quantity that has the tolerance, and of its limits, mean, sd and guard band
    unit: str
    #: bar force for which the quantity that has the tolerance is computed [N]; None for geometric
    #: errors and changes of compliance with force, which do not depend on this force
    force_N: float | None
    lower: float | None  #: lower limit of the tolerance; None if it has no lower limit
    upper: float | None  #: upper limit of the tolerance; None if it has no upper limit
    #: value that tables and sheets state of the quantity that has the tolerance: the posterior
    #: median of a stiffness or of a ratio of stiffnesses, and otherwise the posterior mean; None
    #: for a stiffness that may be infinite
    value: float | None
    #: posterior mean of the quantity that has the tolerance; None for a stiffness that may be
    #: infinite
    mean: float | None
    #: standard uncertainty of the quantity that has the tolerance: its posterior standard
    #: deviation; None for a stiffness that may be infinite
    sd: float | None
    #: probability of conformance: the probability that the quantity lies between the limits of its
    #: tolerance
    probability: float
    #: guard band of ISO 14253-1 for a normally distributed quantity with a single tolerance limit.
    #: A decision is made if the estimate is at least this far from the limit. If the estimate meets
    #: the limit, the quantity conforms; otherwise it does not. None for a stiffness that may be
    #: infinite.
    guard_band: float | None
    #: minimum probability of conformance with the tolerance, or of non-conformance, at which a
    #: decision is made
    confidence: float
    #: decision on conformity of the quantity with its tolerance, by the rules of ISO 14253-1
    decision: Decision
    #: lower end of the equal-tailed 95 % credible interval of the quantity that has the tolerance;
    #: None if the quantity is a stiffness that is infinite in the whole interval
    ci_low: float | None
    #: upper end of the equal-tailed 95 % credible interval of the quantity that has the tolerance;
    #: None if it has no upper end, because the quantity is a stiffness and may be infinite
    ci_high: float | None
    #: numerical standard error of the probability of conformance, which is a share of posterior
    #: draws; zero if the probability is computed from a normal distribution
    probability_error: float = 0.0

    @property
    def limits(self) -> tuple[float, float]:
        """Lower and upper limit of the tolerance of a quantity; a missing limit is infinite."""
        return Tolerance(self.lower, self.upper).ends


@one_blas_thread
def assess_conformity(
    posterior: xr.DataTree,
    tolerances: Mapping[str, str | Tolerance] | None = None,
    *,
    force_N: float | None = None,
    confidence: float = 0.95,
) -> dict[str, Conformity]:
    """Decide whether a machine conforms with its tolerances.

    The probability of conformance is p = P(lower ≤ η ≤ upper | y) of JCGM 106, for a quantity η
    with tolerance limits ``lower`` and ``upper``, given the readings y. By ISO 14253-1 the quantity
    conforms if p is at least ``confidence``. It does not conform if 1 − p is at least
    ``confidence``. In all other cases, no decision is made. Nor is one made on a parameter, or its
    stiffness, on which no reading depends because the circles of its plane are still to be run.

    The probability that a quantity lies beyond a limit is the share of the posterior draws beyond
    the limit. If fewer than 10 of the n draws lie on one side of the limit, the probability of that
    side is taken from a normal distribution. This probability is not allowed to be smaller than the
    share of the draws on that side, or larger than 10/n. For a stiffness, the normal distribution
    is that of the compliance. If ``confidence`` is above 1 − 10/n (0.995
    for 2000 draws), the decision may therefore depend on the tail of a normal distribution. For a
    skewed posterior, this tail may be too thin; take more draws in this case.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.
    tolerances : mapping of str to str or Tolerance, optional
        Tolerances by name of the quantity. Default: the tolerances that the campaign states.
        Quantities are the parameters, ``stiffness_X`` (1/C_XXX), ``k_min``, ``k_max`` and
        ``k_ratio`` of the stiffness by direction (see `stiffness`), and G, F_max and F_min of the
        machine's circular path. If there are several planes, the name of a quantity of a plane ends
        with the plane (``G_YZ``). A tolerance given as text must have a unit, as in ``60 nm/N``,
        ``−20..40 µrad`` or ``≥ 18 N/µm``; a ratio has no unit. The limits of a `Tolerance` are in
        mm, N and rad.
    force_N : float, optional
        Bar force for which compliances, stiffnesses and the circular path are computed [N], from a
        tenth of the smallest force tested to 1.5 times the largest. Default: the model's reference
        force, at which the compliance C(F) is the parameter C.
    confidence : float
        Minimum probability of conformance, or of non-conformance, at which a decision is made,
        between 0.5 and 1.

    Returns
    -------
    dict of str to Conformity
        Decision on each quantity by name.

    Raises
    ------
    InputError
        For an unknown name, a missing or unsuitable unit, a lower limit above the upper limit, a
        negative limit for a quantity that cannot be negative, a force or confidence out of range,
        or a posterior from `to_units`.

    Examples
    --------
    >>> limits = {"C_XXX": "70 nm/N", "stiffness_X": "18 N/µm"}
    >>> decisions = lb.assess_conformity(posterior, limits)
    >>> {name: conformity.decision.value for name, conformity in decisions.items()}
    {'C_XXX': 'conforms', 'stiffness_X': 'not decided'}
    """
    require(
        0.5 < confidence < 1.0,
        f"confidence must lie between 0.5 and 1, got {confidence}. For 95 % give 0.95.",
    )
    bound = bound_of(posterior)
    if tolerances is None:
        tolerances = bound.campaign.tolerances
    known = quantities_of(bound)
    limits = tolerances_in(known, tolerances)
    check_force(bound.campaign, force_N)
    reference_N = bound.setting.reference_force_N
    force = force_to_state(bound.campaign, reference_N) if force_N is None else float(force_N)
    decisions = ByName[Conformity]()
    if not limits:
        return decisions
    untested = bound.untested_parameters
    for name, stated in _stated_draws(posterior, bound, limits, force).items():
        decision = _decide_by_draws(known[name].unit, stated, limits[name], confidence)
        if stated.parameter in untested:
            # Only the prior would decide.
            decision = replace(decision, decision=Decision.NOT_DECIDED)
        decisions[name] = decision
    return decisions


def quantity_draws(posterior: xr.DataTree, decisions: Mapping[str, Conformity]) -> dict[str, Array]:
    """Return posterior draws of the quantities that have a tolerance, in units of mm, N and rad.

    The result is a dict of arrays of shape (draws,). Its keys are the names of the quantities in
    ``decisions``. For quantities of the circular path, only 2000 of the posterior draws are used,
    evenly spaced among all draws.
    """
    bound = bound_of(posterior)
    force = bound.setting.reference_force_N
    for decision in decisions.values():
        force = decision.force_N or force
    return {
        name: stated.values
        for name, stated in _stated_draws(posterior, bound, decisions, force).items()
    }


class _Distribution(NamedTuple):
    """Posterior mean, standard deviation and 95 % credible interval of a quantity."""

    mean: float | None  #: posterior mean of the quantity; None if it is not known
    #: posterior standard deviation of the quantity; None if it is not known
    sd: float | None
    #: lower end of the quantity's 95 % credible interval; None if the whole interval is infinite
    low: float | None
    #: upper end of the quantity's 95 % credible interval; None if it has no upper end
    high: float | None


class _StatedDraws(NamedTuple):
    """Posterior draws of a quantity that has a tolerance, and the bar force that they are for."""

    values: Array  #: posterior draws of the quantity that has the tolerance, shape (draws,)
    #: bar force for which the quantity that has the tolerance is computed [N]; None for geometric
    #: errors and changes of compliance with force
    force_N: float | None
    #: whether the quantity is a stiffness. Its reciprocal, a compliance, is more nearly normally
    #: distributed.
    is_stiffness: bool = False
    #: whether the quantity is a ratio of two stiffnesses
    is_ratio: bool = False
    #: name of the parameter that the quantity is, or whose reciprocal it is; empty for a quantity
    #: of a plane
    parameter: str = ""


def _stated_draws(
    posterior: xr.DataTree, bound: BoundModel, names: Collection[str], force: float
) -> dict[str, _StatedDraws]:
    """Return posterior draws of the quantities ``names`` at a given bar force.

    The result is a dict with ``names`` as keys. They are names of parameters, of stiffnesses such
    as ``stiffness_X`` or ``k_min``, and of quantities of the circular path such as ``G``. ``force``
    is the force of the bar [N].
    """
    parameters = dict(zip(bound.names, bound.parameters, strict=True))
    values = draws_at(posterior, force)
    compliances = {f"stiffness_{name[2]}": name for name in bound.names if is_direct(name)}
    of_planes: dict[str, Array] = {}
    if any(name.startswith(tuple(PATH_QUANTITIES)) for name in names):
        of_planes |= _path_draws(posterior, bound, force)
    if any(name.startswith(tuple(STIFFNESS_QUANTITIES)) for name in names):
        of_planes |= _directional_draws(posterior, bound, force)
    draws = {}
    for name in names:
        if name in compliances:
            stiffness = stiffness_from(values[compliances[name]])
            draws[name] = _StatedDraws(
                stiffness, force, is_stiffness=True, parameter=compliances[name]
            )
        elif name in of_planes:
            draws[name] = _StatedDraws(
                of_planes[name],
                force,
                is_stiffness=name.startswith(("k_min", "k_max")),
                is_ratio=name.startswith("k_ratio"),
            )
        elif parameters[name].group == "compliance":
            draws[name] = _StatedDraws(values[name], force, parameter=name)
        else:
            draws[name] = _StatedDraws(values[name], None, parameter=name)
    return draws


def _path_draws(posterior: xr.DataTree, bound: BoundModel, force: float) -> dict[str, Array]:
    """Return a dict of posterior draws of G, F_max and F_min of the machine's circular path [mm].

    As in ISO 230-4, G is the circular deviation, F_max the largest radial deviation and F_min the
    smallest radial deviation. The keys are these names; if there are several planes, each name ends
    with the plane, as in ``G_YZ``. ``force`` is the force of the bar [N].
    """
    planes = bound.setting.tested_planes
    draws = {}
    for path in path_draws(posterior, [force], _PATH_DRAWS):
        for quantity in PATH_QUANTITIES:
            name = name_in_plane(quantity, path.place["plane"], planes)
            draws[name] = path.quantities[quantity] * 1e-3
    return draws


def _directional_draws(posterior: xr.DataTree, bound: BoundModel, force: float) -> dict[str, Array]:
    """Return posterior draws of the least and greatest stiffness in each plane, and their ratio.

    The result is a dict with three keys: ``k_min`` and ``k_max`` for the least and the greatest
    stiffness along the bar [N/mm], and ``k_ratio`` for the greatest stiffness divided by the least.

    If there are several planes, there are three keys for each plane. Each key then ends with the
    plane, as in ``k_min_YZ``. ``force`` is the force of the bar [N].
    """
    planes = bound.setting.tested_planes
    draws = {}
    for plane, quantities in stiffness_draws(posterior, force).items():
        for quantity, values in quantities.items():
            draws[name_in_plane(quantity, plane, planes)] = values
    return draws


def _decide_by_draws(
    unit: str, stated: _StatedDraws, tolerance: Tolerance, confidence: float
) -> Conformity:
    """Return the decision on conformity from the share of posterior draws between the limits.

    ``stated`` holds the draws of the quantity, and ``tolerance`` its limits, both in ``unit``. If
    too few draws lie on one side of a limit, the probability of that side is taken from a normal
    distribution; see `_tail_probability`. For a stiffness, it is that of the compliance.
    ``confidence`` is the minimum probability at which a decision is made.
    """
    draws = stated.values
    ci_low, ci_high = np.quantile(draws, _LEVELS).tolist()
    distribution = _Distribution(float(draws.mean()), float(draws.std(ddof=1)), ci_low, ci_high)
    low, high = tolerance.ends
    low_score, high_score = _scores(stated, (low, high))
    below = _tail_probability(draws < low, low_score)
    above = _tail_probability(draws > high, high_score)
    probability = min(max(1.0 - below - above, 0.0), 1.0)
    decision = _decide(unit, distribution, tolerance, probability, confidence, stated.force_N)
    if stated.is_stiffness or stated.is_ratio:
        decision = replace(decision, value=float(np.median(draws)))
    return replace(decision, probability_error=_error_of_share((draws >= low) & (draws <= high)))


def _scores(stated: _StatedDraws, limits: tuple[float, float]) -> tuple[float, float]:
    """Return how far the mean of a quantity lies beyond its limits, in standard deviations.

    The numbers belong to the lower and to the upper limit; they are negative if the mean lies
    inside the limit. For a stiffness, they are those of its reciprocal, a compliance.
    """
    low, high = limits
    draws = stated.values
    if not stated.is_stiffness:
        sd = max(float(draws.std(ddof=1)), _LEAST_SD)
        mean = float(draws.mean())
        return (low - mean) / sd, (mean - high) / sd
    compliance = 1.0 / draws
    sd = max(float(compliance.std(ddof=1)), _LEAST_SD)
    mean = float(compliance.mean())
    low_score = -np.inf
    if low > 0.0:
        low_score = (mean - 1.0 / low) / sd
    high_score = -np.inf
    if high < np.inf:
        high_score = (1.0 / high - mean) / sd
    return low_score, high_score


def _error_of_share(is_inside: Array) -> float:
    """Return the standard error of a share of posterior draws, from the means of batches.

    ``is_inside``, shape (draws,), is true for the draws that count. Draws that stand side by side
    may be correlated, because emcee makes each from the one before. Each batch therefore consists
    of draws that stand side by side. There are 20 batches, or as many as draws.
    """
    number = min(_BATCHES, len(is_inside))
    shares = np.array([batch.mean() for batch in np.array_split(is_inside, number)])
    return float(shares.std(ddof=1) / np.sqrt(number))


def _tail_probability(outside: Array, score: float) -> float:
    """Return the probability that a quantity lies beyond a limit.

    The probability is the share of posterior draws beyond the limit. ``outside``, shape (draws,),
    is true for the draws beyond the limit. ``score`` states how far the mean lies beyond the limit,
    in standard deviations; it is negative if the mean lies inside the limit. If fewer than
    ``_FEWEST_DRAWS`` draws lie on one side of the limit, the probability of that side is taken from
    a normal distribution instead. It is kept between the share of the draws on that side and
    ``_FEWEST_DRAWS`` / draws; see `_probability_of_few_draws`.
    """
    n = len(outside)
    count = int(outside.sum())
    if count < _FEWEST_DRAWS:
        return _probability_of_few_draws(count, n, float(ndtr(score)))
    if n - count < _FEWEST_DRAWS:
        return 1.0 - _probability_of_few_draws(n - count, n, float(ndtr(-score)))
    return count / n


def _probability_of_few_draws(count: int, n: int, normal_tail: float) -> float:
    """Return the probability of that side of a tolerance limit on which few draws lie.

    Only ``count`` of ``n`` draws lie on this side, too few to estimate the probability from their
    share. The result is therefore ``normal_tail``, the probability under a normal distribution. It
    is raised to ``count`` / ``n`` if it is smaller, and reduced to ``_FEWEST_DRAWS`` / ``n`` if it
    is larger.
    """
    largest_share = _FEWEST_DRAWS / n
    return max(count / n, min(normal_tail, largest_share))


def normal_conformity(
    unit: str, mean: float, sd: float, tolerance: Tolerance, *, confidence: float = 0.95
) -> Conformity:
    """Return the decision on the conformity of a quantity with a normal distribution.

    ``mean``, ``sd`` and the limits of ``tolerance`` are in ``unit``. ``confidence`` is the minimum
    probability at which a decision is made.
    """
    probability = _normal_probability(mean, sd, tolerance.ends)
    half_width = float(ndtri(_LEVELS[1])) * sd
    distribution = _Distribution(mean, sd, mean - half_width, mean + half_width)
    return _decide(unit, distribution, tolerance, probability, confidence, None)


def stiffness_conformity(
    unit: str,
    compliance_mean: float,
    compliance_sd: float,
    tolerance: Tolerance,
    *,
    confidence: float = 0.95,
) -> Conformity:
    """Return the decision on the conformity of a stiffness whose compliance has a normal posterior.

    The probability of conformance is the probability, under the normal distribution of the
    compliance C, that C lies between the inverses of the stiffness limits. A negative C is
    physically impossible, and counts as infinite stiffness. For a compliance with mean m and
    standard deviation s, the result states 1/m as value and mean of the stiffness, and s/m² as its
    standard deviation. If the 95 % interval of the compliance contains zero or lies below it, these
    approximations mean nothing, and value, mean, standard deviation and guard band are None. So is
    the upper end of the stiffness, and if the whole interval lies below zero, the lower end too.
    The decision does not depend on them.

    ``unit`` is the unit of the stiffness and of the limits of ``tolerance``. ``compliance_mean``
    and ``compliance_sd`` are the mean and the standard deviation of the compliance, in the inverse
    of this unit. ``confidence`` is the minimum probability at which a decision is made.
    """
    lowest_stiffness, highest_stiffness = tolerance.ends
    lowest_compliance = -np.inf
    if highest_stiffness < np.inf:
        lowest_compliance = 1.0 / highest_stiffness
    highest_compliance = np.inf
    if lowest_stiffness > 0.0:
        highest_compliance = 1.0 / lowest_stiffness
    probability = _normal_probability(
        compliance_mean, compliance_sd, (lowest_compliance, highest_compliance)
    )
    half_width = float(ndtri(_LEVELS[1])) * compliance_sd
    ci_low = None
    if compliance_mean + half_width > 0.0:
        ci_low = 1.0 / (compliance_mean + half_width)
    distribution = _Distribution(mean=None, sd=None, low=ci_low, high=None)
    if compliance_mean > half_width:
        distribution = _Distribution(
            mean=1.0 / compliance_mean,
            sd=compliance_sd / compliance_mean**2,
            low=ci_low,
            high=1.0 / (compliance_mean - half_width),
        )
    return _decide(unit, distribution, tolerance, probability, confidence, None)


def _normal_probability(mean: float, sd: float, limits: tuple[float, float]) -> float:
    """Return the probability that a normally distributed quantity lies between ``limits``.

    ``mean`` and ``sd`` are the mean and the standard deviation of the quantity, in the unit of the
    limits.
    """
    low, high = limits
    return float(ndtr((high - mean) / sd) - ndtr((low - mean) / sd))


def _decide(
    unit: str,
    distribution: _Distribution,
    tolerance: Tolerance,
    probability: float,
    confidence: float,
    force: float | None,
) -> Conformity:
    """Return the decision on conformity with a tolerance, for a given probability of conformance.

    ``probability`` is the probability of conformance, and ``confidence`` the minimum probability at
    which a decision is made. ``distribution`` is the posterior of the quantity, in ``unit``; its
    mean is also the value that is stated. ``force`` is the bar force for which the quantity is
    computed [N].
    """
    decision = Decision.NOT_DECIDED
    if probability <= 1.0 - confidence:
        decision = Decision.DOES_NOT_CONFORM
    elif probability >= confidence:
        decision = Decision.CONFORMS
    guard_band = None
    if distribution.sd is not None:
        guard_band = float(ndtri(confidence)) * distribution.sd
    return Conformity(
        unit=unit,
        force_N=force,
        lower=tolerance.lower,
        upper=tolerance.upper,
        value=distribution.mean,
        mean=distribution.mean,
        sd=distribution.sd,
        probability=probability,
        guard_band=guard_band,
        confidence=confidence,
        decision=decision,
        ci_low=distribution.low,
        ci_high=distribution.high,
    )
