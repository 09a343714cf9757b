"""Conformity of a machine with its tolerances, decided from the draws of its posterior.

The decision follows the rules of ISO 14253-1 (`decision_rule`). The probability of conformance is
the share of the posterior draws between the limits.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import xarray as xr
from scipy.special import ndtr

from ldbb_bayes.analysis.decision_rule import (
    INTERVAL_LEVELS,
    Conformity,
    Decision,
    Distribution,
    decide,
)
from ldbb_bayes.analysis.toleranced_draws import TolerancedDraws, toleranced_draws
from ldbb_bayes.analysis.tolerances import Tolerance, quantities_of, tolerances_in
from ldbb_bayes.campaign.tested_forces import check_force, force_to_state
from ldbb_bayes.errors import require
from ldbb_bayes.inference.posterior import bound_of
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, ByName

__all__ = ["assess_conformity", "quantity_draws"]

# If at least this number of posterior draws lie on one side of a tolerance limit, the probability
# of this side is the number of these draws divided by the number of all draws. If fewer draws lie
# there, the probability is computed from a normal distribution. It is then limited: it is at least
# the share of the draws on this side, and at most ``_FEWEST_DRAWS`` divided by the number of all
# draws.
_FEWEST_DRAWS = 10
# Number of batches of posterior draws from which the numerical error of a probability is computed.
_BATCHES = 20
# Smallest standard deviation by which values are divided. A smaller posterior standard deviation is
# replaced by this number, to avoid a division by zero.
_LEAST_SD = 1e-300


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
    for name, toleranced in toleranced_draws(posterior, bound, limits, force).items():
        decision = _decide_by_draws(known[name].unit, toleranced, limits[name], confidence)
        if toleranced.parameter in untested:
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
        name: toleranced.values
        for name, toleranced in toleranced_draws(posterior, bound, decisions, force).items()
    }


def _decide_by_draws(
    unit: str, toleranced: TolerancedDraws, tolerance: Tolerance, confidence: float
) -> Conformity:
    """Return the decision on conformity from the share of posterior draws between the limits.

    ``toleranced`` holds the draws of the quantity, and ``tolerance`` its limits, both in ``unit``.
    If too few draws lie on one side of a limit, the probability of that side is taken from a normal
    distribution; see `_tail_probability`. For a stiffness, it is that of the compliance.
    ``confidence`` is the minimum probability at which a decision is made.
    """
    draws = toleranced.values
    ci_low, ci_high = np.quantile(draws, INTERVAL_LEVELS).tolist()
    distribution = Distribution(float(draws.mean()), float(draws.std(ddof=1)), ci_low, ci_high)
    low, high = tolerance.ends
    low_score, high_score = _scores(toleranced, (low, high))
    below = _tail_probability(draws < low, low_score)
    above = _tail_probability(draws > high, high_score)
    probability = min(max(1.0 - below - above, 0.0), 1.0)
    decision = decide(unit, distribution, tolerance, probability, confidence, toleranced.force_N)
    if toleranced.is_stiffness or toleranced.is_ratio:
        decision = replace(decision, value=float(np.median(draws)))
    return replace(decision, probability_error=_error_of_share((draws >= low) & (draws <= high)))


def _scores(toleranced: TolerancedDraws, limits: tuple[float, float]) -> tuple[float, float]:
    """Return how far the mean of a quantity lies beyond its limits, in standard deviations.

    The numbers belong to the lower and to the upper limit; they are negative if the mean lies
    inside the limit. For a stiffness, they are those of its reciprocal, a compliance.
    """
    low, high = limits
    draws = toleranced.values
    if not toleranced.is_stiffness:
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
