"""c_t = c + Δ e_j 1[t ≥ k] + w_t, t = 1..n over one machine's campaigns: has a parameter changed, when, and how soon is it found?

In units of the prior's sd: c ~ N(0, I), b ~ N(0, I) the instrument's errors, the same in all campaigns, w_t ~ N(0, r² I) what the
machine itself changes from campaign to campaign, r ~ HalfNormal(repeatability), Δ ~ N(0, change_scale²). With the probability
given there is one step, j uniform over parameters and k over 2..n. Given r, j, k everything is Gaussian: w_t is integrated in
each campaign, the rest needs sums over t ≥ k and one small system for each r, k, j. A campaign's Λ may be singular.

Truncation is left aside. Parameters not chosen are integrated out anew in each campaign, as ball form and bar length are, though
one machine and one bar keep theirs: that is conservative for changes, above all of geometric errors, but not for levels.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import Field, PlainSerializer
from scipy.special import erf, logsumexp, ndtri

from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.fleet.statistics import (
    Caveat,
    CaveatKind,
    FleetStatistics,
    Summary,
    alone,
    choose,
    deviating,
    fleet_statistics,
    force_caveats,
    keyed,
    labels,
    mixture_covariance,
    narrow_forces,
)
from ldbb_bayes.inference.posterior import check_probability
from ldbb_bayes.jobs import one_blas_thread
from ldbb_bayes.model.gaussian import Gaussian, mixture_moments, mixture_quantiles
from ldbb_bayes.report.text import parts_of
from ldbb_bayes.report.wording import caveat_words, probability_words, trend_sentences, with_words
from ldbb_bayes.result import Number, Result, Table
from ldbb_bayes.units import display_name, display_unit, plus_minus, ranked, round_uncertainty, units_for

__all__ = ["LIMITS", "SURE", "MostProbable", "ParameterChange", "Trend", "Visit", "trend"]

Array = NDArray[Any]
LIMITS, SURE = 0.997, 0.9
_LEAST, _MOST, _STEP, _COARSE = 0.03, 8.0, 0.12, 0.35
_NEGLIGIBLE = 1e-7

# ---- the model


def scatter_rule(repeatability: float, *, step: float = _STEP) -> tuple[Array, Array]:
    """Nodes of r and their weights, shape (r,): trapezoids in ln r (of this step); what lies below the lowest counts there."""
    count = int(np.ceil(np.log(_MOST / _LEAST) / step)) + 1
    log_ratio = np.linspace(np.log(_LEAST), np.log(_MOST), count)
    ratio = np.exp(log_ratio)
    weight = ratio * np.sqrt(2.0 / np.pi) * np.exp(-0.5 * ratio**2) * (log_ratio[1] - log_ratio[0])
    weight[[0, -1]] *= 0.5
    weight[0] += erf(_LEAST / np.sqrt(2.0))
    return repeatability * ratio, weight / weight.sum()


def hypotheses(carried: Gaussian, parameters: int, change_scale: float) -> Gaussian:
    """(c, b, Δ) under every hypothesis, shape (r, n, p, q + 1); ``log_integral`` is their log evidence, up to what all share.

    Place k, counted from 0, is a step just before campaign k + 2; the last, of whatever parameter, is no step at all. ``carried``
    are the campaigns in order of time, (r, n, q), their w_t integrated: `deviating`.
    """
    precision, shift = (np.cumsum(own[:, ::-1], axis=1)[:, ::-1] for own in (carried.precision, carried.shift))
    (r, n, q), p = shift.shape, parameters
    late = np.swapaxes(precision[:, 1:, :, :p], -1, -2)
    whole, pull = np.zeros((r, n, p, q + 1, q + 1)), np.zeros((r, n, p, q + 1))
    whole[..., :q, :q] = np.eye(q) + precision[:, None, :1]
    whole[..., q, q] = change_scale**-2.0
    whole[:, :-1, :, q, q] += np.einsum("rkjj->rkj", late[..., :p])
    whole[:, :-1, :, :q, q] = whole[:, :-1, :, q, :q] = late
    pull[..., :q], pull[:, :-1, :, q] = shift[:, None, :1], shift[:, 1:, :p]
    return Gaussian(whole, pull, carried.log_constant.sum(axis=1)[:, None, None])


def weigh(log_evidence: Array, scatter_weight: Array, probability: float) -> Array:
    """Posterior probability of every hypothesis, (r, n, p), from their log evidence, weights of r and the prior of a change."""
    log_weight = log_evidence + _log_prior(log_evidence.shape[1:], probability) + np.log(scatter_weight)[:, None, None]
    return np.asarray(np.exp(log_weight - logsumexp(log_weight)))


def _log_prior(shape: tuple[int, ...], probability: float) -> Array:
    times, parameters = shape
    prior = np.full(shape, probability / max((times - 1) * parameters, 1))
    prior[-1] = (1.0 - probability) / parameters
    return np.log(prior)


def _changed(series: Gaussian, parameters: int, change_scale: float, repeatability: float, probability: float) -> float:
    scatter, prior = scatter_rule(repeatability)
    found = hypotheses(deviating(series, np.outer(scatter, np.ones(parameters))), parameters, change_scale)
    return 1.0 - float(weigh(found.log_integral, prior, probability)[:, -1].sum())


def instrument_moments(found: Gaussian, weights: Array) -> tuple[Array, Array]:
    """Posterior mean and covariance of the instrument's errors, averaged over hypotheses; shapes (s,), (s, s)."""
    p, q = weights.shape[2], found.mean.shape[-1] - 1
    spread = found.spread(np.eye(q + 1)[p:q])
    covariance = (spread @ np.swapaxes(spread, -1, -2)).reshape(weights.size, q - p, q - p)
    return mixture_covariance(weights.ravel(), found.mean[..., p:q].reshape(weights.size, q - p), covariance)


class Chart(NamedTuple):
    """What is drawn of every campaign, in order of time, the instrument's errors at their posterior mean.

    ``own`` and ``own_sd`` (n, p) are of each campaign alone, ``limits`` (2, n, p) NaN at the first; ``common_sd`` (p,) what the
    instrument's errors add to the level of all campaigns together.
    """

    own: Array
    own_sd: Array
    limits: Array
    common_sd: Array


def chart_of(
    series: Gaussian,
    carried: Gaussian,
    scatter: Array,
    scatter_weight: Array,
    instrument: tuple[Array, Array],
    *,
    limits: float = LIMITS,
) -> Chart:
    """Points with their uncertainty, and limits of this probability from the campaigns before each.

    ``series`` (n, q) and ``carried`` (r, n, q) are the campaigns in order of time, scatter and its weights (r,) the prior of r,
    ``instrument`` posterior mean and covariance of the instrument's errors.
    """
    known, spread = instrument
    q = series.shift.shape[-1]
    p = q - len(known)
    shrink, seen, estimate = alone(series, p)
    own = estimate - seen[..., p:] @ known
    whole = series.precision[:, :p].sum(axis=0)
    pulled = np.linalg.solve(np.eye(p) + whole[:, :p], whole[:, p:])
    common = np.sqrt(np.einsum("as,su,au->a", pulled, spread, pulled))

    sums = [np.cumsum(part[:, :-1], axis=1) for part in (carried.precision, carried.shift, carried.log_constant)]
    before = Gaussian(np.eye(q) + sums[0], *sums[1:])
    log_weight = np.log(scatter_weight)[:, None] + before.log_integral
    weight = np.exp(log_weight - logsumexp(log_weight, axis=0))
    take = seen[1:]
    expected = np.einsum("tab,rtb->rta", take, before.mean) - take[..., p:] @ known
    deviation = scatter[:, None, None] ** 2 * (take[..., :p] ** 2).sum(axis=-1)
    noise = np.einsum("tab,tab->ta", take[..., :p], shrink[1:])
    sd = np.sqrt((before.spread(take) ** 2).sum(axis=-1) + deviation + noise)
    tail = 0.5 - 0.5 * limits
    ends = mixture_quantiles(weight[:, :, None], expected, np.maximum(sd, 1e-300), (tail, 1.0 - tail))
    nothing = np.full((2, 1, p), np.nan)
    return Chart(own, np.sqrt(np.einsum("taa->ta", shrink)), np.concatenate([nothing, ends], axis=1), common)


class Levels(NamedTuple):
    """c and the step at every campaign, averaged over hypotheses: mean and sd (n, p) of the mixture, interval (2, n, p)."""

    mean: Array
    sd: Array
    interval: Array


def levels_of(
    series: Gaussian, scatter: Array, weights: Array, known: Array, change_scale: float, *, ci_prob: float = 0.95
) -> Levels:
    """Level of every parameter at every campaign; ``known`` are the instrument's errors, ``weights`` those with them unknown."""
    n, p = weights.shape[1:]
    given = series.given(range(p, p + len(known)), known) if len(known) else series
    found = hypotheses(deviating(given, np.outer(scatter, np.ones(p))), p, change_scale)
    total = weights.sum(axis=0)
    share = np.divide(weights, total, out=np.full_like(weights, 1.0 / len(weights)), where=total > 0.0)
    level = np.zeros((2, p, p, p + 1))  # c, and c with the step of each
    level[:, :, range(p), range(p)] = 1.0
    level[1, range(p), range(p), p] = 1.0
    mean = np.einsum("xjab,rkjb->rxkja", level, found.mean)
    square = np.stack([(found.spread(own) ** 2).sum(axis=-1) for own in level], axis=1)
    middle = np.einsum("rkj,rxkja->xkja", share, mean)
    variance = np.einsum("rkj,rxkja->xkja", share, square + (mean - middle) ** 2)

    counts = total > _NEGLIGIBLE * total[:-1].max()
    counts[-1] = True
    times, movers = np.nonzero(counts)
    weight = total[times, movers] / total[times, movers].sum()
    moved = (np.arange(n) > times[:, None]).astype(int), times[:, None], movers[:, None]
    ends = (0.5 - 0.5 * ci_prob, 0.5 + 0.5 * ci_prob)
    sd = np.sqrt(variance[moved])
    return Levels(*mixture_moments(weight, middle[moved], sd), mixture_quantiles(weight, middle[moved], sd, ends))


# ---- how soon a change would be found


@dataclass(frozen=True)
class Foreseen(Result):
    """How soon a change of one parameter would be found.

    ``found_within`` is the probability that it has been after 1..N further campaigns, ``error`` the standard error of counting,
    never less than that of half a count; NaN where there is no change to ask for. ``campaigns_for_90_percent`` is the least
    number that finds it with probability 0.9; None where more are needed than looked at.
    """

    found_within: tuple[Number, ...]
    error: tuple[Number, ...]
    campaigns_for_90_percent: int | None


@dataclass(frozen=True)
class FalseAlarm(Result):
    """Probability that some change has been said to be there ``within`` 1..N further campaigns while nothing changed.

    ``campaigns_before`` the change there are; ``replicates`` is the number of simulated series that are counted.
    """

    within: tuple[float, ...]
    error: tuple[float, ...]
    campaigns_before: int
    replicates: int


def detection(
    information: Array,
    level: Array,
    changes: Array,
    *,
    before: int,
    scatter: tuple[Array, Array],
    change_scale: float,
    repeatability: float,
    probability: float,
    threshold: float,
    further: int = 12,
    replicates: int = 400,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[list[Foreseen], FalseAlarm]:
    """Simulate series to come, and look at each after every further campaign.

    Λ̄ of one campaign (q, q), what c and b are now (q,), and Δ of each parameter (p,), NaN to leave it out, are in units of the
    prior's sd. Series are drawn with r of these values and probabilities; the analysis weighs r by its prior. Those with a false
    alarm ``before`` the change are left out of the counts.
    """
    rng = np.random.default_rng(seed)
    p, n = len(changes), before + further
    r = rng.choice(scatter[0], size=replicates, p=scatter[1] / scatter[1].sum())
    values, vectors = np.linalg.eigh(information)
    z = np.tile(level, (replicates, n, 1))
    z[:, :, :p] += r[:, None, None] * rng.standard_normal((replicates, n, p))
    noise = rng.standard_normal(z.shape) @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
    asked = np.flatnonzero(np.isfinite(changes))
    drawn = np.tile(z @ information + noise, (1 + len(asked), 1, 1, 1))
    drawn[1:, :, before:] += (changes[asked, None] * information[asked])[:, None, None]
    drawn = drawn.reshape(-1, n, len(level))
    rule = scatter_rule(repeatability, step=_COARSE)
    alarm = np.zeros((further + 1, 1 + len(asked), replicates), dtype=bool)
    for count in range(further + 1):
        if before + count > 1:
            odds = _log_odds(drawn[:, : before + count], information, p, rule, change_scale, probability)
            alarm[count] = odds.reshape(-1, replicates) > np.log(threshold / (1.0 - threshold))
        if progress is not None:
            progress(count + 1, further + 1)
    fresh = ~alarm[0, 0]
    if not fresh.any():
        fresh[:] = True
    counted = int(fresh.sum())
    share = np.logical_or.accumulate(alarm[1:], axis=0)[:, :, fresh].mean(axis=2)
    found = np.full((p, further), np.nan)
    found[asked] = share[:, 1:].T
    every = [Foreseen(tuple(own.tolist()), _counting_error(own, counted), _soonest(own)) for own in found]
    return every, FalseAlarm(tuple(share[:, 0].tolist()), _counting_error(share[:, 0], counted), before, counted)


def _counting_error(share: Array, number: int) -> tuple[float, ...]:
    inside = np.clip(share, 0.5 / number, 1.0 - 0.5 / number)
    return tuple(np.sqrt(inside * (1.0 - inside) / number).tolist())


def _soonest(share: Array) -> int | None:
    enough = np.flatnonzero(share >= SURE)
    return int(enough[0]) + 1 if len(enough) else None


def _log_odds(
    weighted: Array, information: Array, parameters: int, rule: tuple[Array, Array], change_scale: float, probability: float
) -> Array:
    """Log odds of a change, shape (series,), of many series η (series, n, q) of equally informative campaigns.

    They share the precisions of `hypotheses`: ln p = constant + ½ Σ_t η_tᵀ D (I + Λ D)⁻¹ η_t + ½ ηᵀ E[x x] η + ½ E[Δ]² / Var(Δ).
    """
    (series, n, q), p, (nodes, weight) = weighted.shape, parameters, rule
    silent = Gaussian(np.tile(information, (n, 1, 1)), np.zeros((n, q)))
    every = hypotheses(deviating(silent, np.outer(nodes, np.ones(p))), p, change_scale)
    last = every.covariance[..., q, :]
    variance = last[..., q]
    log_prior = every.log_integral + _log_prior((n, p), probability) + np.log(weight)[:, None, None]
    sums = np.cumsum(weighted[:, ::-1], axis=1)[:, ::-1]
    squares = (np.swapaxes(weighted, 1, 2) @ weighted).reshape(series, q * q)
    changed, none = np.full((2, series), -np.inf)
    for i, node in enumerate(nodes):
        inner = np.diag([node**2] * p + [0.0] * (q - p))
        take = np.linalg.inv(np.eye(q) + information @ inner)
        total, late = sums[:, 0] @ take.T, sums[:, 1:] @ take[:p].T
        rest = np.linalg.inv(every.precision[i, -1, 0, :q, :q])
        own = 0.5 * squares @ (inner @ take).ravel() + 0.5 * ((total @ rest) * total).sum(axis=1)
        size = variance[i, :-1] * late + (total @ last[i, :-1, :, :q].reshape(-1, q).T).reshape(series, n - 1, p)
        log_step = (0.5 * size**2 / variance[i, :-1] + log_prior[i, :-1]).reshape(series, -1)
        top = log_step.max(axis=1)
        changed = np.logaddexp(changed, own + top + np.log(np.exp(log_step - top[:, None]).sum(axis=1)))
        none = np.logaddexp(none, own + logsumexp(log_prior[i, -1]))
    return changed - none


# ---- what is found


@dataclass(frozen=True)
class Step(Result):
    """A step of one parameter, inside units.

    Attributes
    ----------
    probability : float
        That it is this parameter that changed.
    change : Summary
        Given that it is.
    percent, percent_interval : float or None
        Of the level before, the interval of the change alone; None where the level is not known to a fifth.
    """

    unit: str
    probability: float
    change: Summary
    percent: float | None
    percent_interval: tuple[float, float] | None
    level_before: float


@dataclass(frozen=True)
class ParameterChange(Step):
    """The step of one parameter, whenever it was.

    Attributes
    ----------
    level_now, level_now_sd : float
        Level at the last campaign, averaged over hypotheses.
    common_sd : float
        What the instrument's errors add to the level of all campaigns together; in no point, limit or level.
    detection : Foreseen
        Of the change that is asked for.
    """

    level_now: float
    level_now_sd: float
    common_sd: float
    detection: Foreseen


@dataclass(frozen=True)
class MostProbable(Step):
    """The one step that is named where a change is found: of ``parameter``, just before the campaign of this place (from 0)."""

    parameter: str
    just_before: str
    place: int


@dataclass(frozen=True)
class Visit(Result):
    """A campaign: what it is called, when it was, and the probability that a parameter changed just before it."""

    campaign: str
    date: Annotated[datetime | None, PlainSerializer(lambda date: date and date.isoformat())]
    change_just_before: float


@dataclass(frozen=True, eq=False)
class Trend(Result):
    """Parameters of one machine over time.

    Attributes
    ----------
    assumptions : mapping
        change_scale, repeatability (units of the prior's sd), probability, threshold, detect, ci, one_instrument, seed.
    probability : float
        That one parameter has changed once; in JSON ``probability_of_change``.
    changed : bool
        Whether that is above the threshold.
    campaigns : tuple of Visit, length n
        In order of time.
    scatter : Summary
        Of r, what the machine changes from campaign to campaign, in units of the prior's sd.
    sensitivity : mapping of assumption to probability of a change
    estimates : DataFrame
        One row per campaign and parameter, inside units: campaign, date, parameter, unit, estimate, sd, ci_low, ci_high (of this
        campaign alone), limit_low, limit_high (99.7 % from the campaigns before, no change), outside, level, level_low,
        level_high, change_here, change_by_here (probabilities). The instrument's errors are at their posterior mean throughout.
        Not in JSON.
    """

    machine: str | None
    reference_force_N: float
    assumptions: Mapping[str, Any]
    probability: Annotated[float, Field(alias="probability_of_change")]
    changed: bool
    campaigns: tuple[Visit, ...]
    parameters: Mapping[str, ParameterChange]
    most_probable: MostProbable
    scatter: Summary
    sensitivity: Mapping[str, float]
    false_alarm: FalseAlarm
    caveats: tuple[Caveat, ...]
    estimates: Annotated[pd.DataFrame, Field(exclude=True)]
    limits_probability: float = LIMITS

    def sizes(self) -> dict[str, list[float]]:
        """Sizes of the estimates by inside unit, for `units_for`."""
        return {str(unit): own.tolist() for unit, own in self.estimates.groupby("unit", sort=False)["estimate"]}

    def as_dict(self) -> dict[str, Any]:
        """The findings for JSON, in inside units; intervals are named by their probability."""
        found: dict[str, Any] = keyed(super().as_dict(), self.assumptions["ci"])
        return found


# Three decimals show no less.
_UNLIKELY = 5e-4


@parts_of.register
def _parts(trend: Trend) -> tuple[Table | str, ...]:
    rows = []
    last = trend.estimates.tail(len(trend.parameters))
    ends = zip(last["level_low"].tolist(), last["level_high"].tolist(), strict=True)
    with units_for(trend.sizes()):
        for (name, own), level in zip(trend.parameters.items(), ends, strict=True):
            factor, label = display_unit(own.unit)
            likely, step, soon = own.probability >= _UNLIKELY, own.change, own.detection
            none = "–" if math.isnan(soon.found_within[0]) else f"over {len(soon.found_within)}"
            rows.append(
                (
                    display_name(name),
                    plus_minus(own.level_now, own.level_now_sd, level, own.unit),
                    f"{round_uncertainty(own.common_sd * factor)[0]} {label}" if own.common_sd > 0.0 else "–",
                    probability_words(own.probability),
                    plus_minus(step.mean, step.sd, step.interval, own.unit) if likely else "–",
                    f"{own.percent:+.0f} %".replace("-", "−") if likely and own.percent is not None else "–",
                    str(soon.campaigns_for_90_percent or none),
                )
            )
    asked = f"{100 * trend.assumptions['detect']:+.0f} % found within".replace("-", "−")
    heads = ("parameter", "level now", "u, common", "P(changed)", "change, if it did", "of level", asked)
    meant = "± U = 2u; of a probability ± u, of counting simulated series. u, common: what the bar adds to all campaigns alike."
    whose = f"{trend.machine}, " if trend.machine else ""
    table = Table.of(f"{whose}{len(trend.campaigns)} campaigns", heads, rows)
    return (table, meant, "", *trend_sentences(trend), *map(caveat_words, trend.caveats))


@with_words.register
def _in_words(trend: Trend) -> dict[str, Any]:
    doubts = [caveat_words(caveat) for caveat in trend.caveats]
    return trend.as_dict() | {"doubts": doubts, "verdict": list(trend_sentences(trend))}


# Standard uncertainties that a level must be away from zero: before a change is told in per cent of it (its own uncertainty, left
# aside there, is then at most a fifth), and before one is asked for.
_KNOWN, _TOLD = 5.0, 2.0


def _step(moments: tuple[Array, Array], share: Array, j: int, statistics: FleetStatistics, ci_prob: float) -> dict[str, Any]:
    """Fields of `Step`: of parameter j, from mean and sd of `hypotheses` under probabilities (r, n − 1) of r and when."""
    total, scale = float(share.sum()), float(statistics.prior_sd[j])
    share = (share / total if total > 0.0 else np.full_like(share, 1.0 / share.size)).ravel()
    (size, size_sd), (base, base_sd) = ([part[:, :-1, j, place].ravel() for part in moments] for place in (-1, j))
    mean, sd = (scale * float(one) for one in mixture_moments(share, size, size_sd))
    before, doubt = (scale * float(one) for one in mixture_moments(share, base, base_sd))
    seen, tail = share > 0.0, 0.5 - 0.5 * ci_prob
    ends = scale * mixture_quantiles(share[seen], size[seen], size_sd[seen], (tail, 1.0 - tail))
    known = abs(before) > _KNOWN * doubt
    return {
        "unit": statistics.units[j],
        "probability": total,
        "change": Summary(mean, sd, tuple(ends.tolist())),
        "percent": 100.0 * mean / before if known else None,
        "percent_interval": tuple(sorted((100.0 * ends / before).tolist())) if known else None,
        "level_before": before,
    }


def _parameters(
    moments: tuple[Array, Array],
    change: Array,
    statistics: FleetStatistics,
    now: tuple[Array, ...],
    soon: Sequence[Foreseen],
    ci_prob: float,
) -> dict[str, ParameterChange]:
    """Every parameter's step; ``now`` are its level, the level's sd, and what the instrument adds."""
    found = {}
    for j, (name, own) in enumerate(zip(statistics.parameters, np.stack(now, axis=1), strict=True)):
        level, sd, common = (statistics.prior_sd[j] * own).tolist()
        step = _step(moments, change[:, :, j], j, statistics, ci_prob)
        found[name] = ParameterChange(**step, level_now=level, level_now_sd=sd, common_sd=common, detection=soon[j])
    return found


def _most_probable(
    moments: tuple[Array, Array], change: Array, statistics: FleetStatistics, visits: Sequence[Visit], ci_prob: float
) -> MostProbable:
    """The parameter that most probably changed, and when it most probably did, given that it is this one."""
    here = change.sum(axis=0)
    j = ranked(range(here.shape[1]), lambda i: float(here[:, i].sum()))[0]
    k = ranked(range(len(here)), lambda t: float(here[t, j]))[0]
    share = np.zeros_like(change[:, :, j])
    share[:, k] = change[:, k, j]
    own = _step(moments, share, j, statistics, ci_prob)
    return MostProbable(**own, parameter=statistics.parameters[j], just_before=visits[k + 1].campaign, place=k + 1)


_SIZED = ("estimate", "sd", "ci_low", "ci_high", "limit_low", "limit_high", "level", "level_low", "level_high")


def _estimates(
    statistics: FleetStatistics, visits: Sequence[Visit], chart: Chart, levels: Levels, change: Array, ci_prob: float
) -> pd.DataFrame:
    """One row per campaign and parameter, as `Trend.estimates` has them."""
    reach = float(ndtri(0.5 + 0.5 * ci_prob)) * chart.own_sd
    own = (chart.own, chart.own_sd, chart.own - reach, chart.own + reach, *chart.limits, levels.mean, *levels.interval)
    n, p = chart.own.shape
    sized = np.stack(own, axis=-1) * statistics.prior_sd[:p, None]
    found = pd.DataFrame(sized.reshape(n * p, -1), columns=_SIZED)
    found.insert(6, "outside", ((chart.own < chart.limits[0]) | (chart.own > chart.limits[1])).ravel())
    when = np.array([own.date and own.date.isoformat() for own in visits], dtype=object)
    found.insert(0, "campaign", np.repeat([own.campaign for own in visits], p))
    found.insert(1, "date", np.repeat(when, p))
    found.insert(2, "parameter", np.tile(statistics.parameters, n))
    found.insert(3, "unit", np.tile(statistics.units, n))
    here = np.concatenate([np.zeros((1, p)), change.sum(axis=0)])
    return found.assign(change_here=here.ravel(), change_by_here=np.cumsum(here, axis=0).ravel())


def _of_one_machine(rows: pd.DataFrame, machine: str | None) -> tuple[pd.DataFrame, str | None, list[Caveat]]:
    """A batch's rows of one machine, its name, and what is to be minded of the choice."""
    ids = rows["machine_id"] if "machine_id" in rows else pd.Series(None, index=rows.index, dtype=object)
    named = ids.map(lambda own: isinstance(own, str)).astype(bool)
    known = sorted(set(ids[named]))
    if machine is not None:
        check_known("machine", [machine], known)
    elif len(known) > 1:
        raise InputError(
            f"the campaigns must be of one machine, got those of {', '.join(known)}. Choose one: "
            f"--machine {shlex.quote(known[0])} (machine={known[0]!r})."
        )
    if not known:
        return rows, None, [Caveat(CaveatKind.NO_MACHINES)]
    failed = ~named & (rows["status"] != "done")
    nameless = {CaveatKind.FAILED_WITHOUT_MACHINE: failed, CaveatKind.WITHOUT_MACHINE: ~named & ~failed}
    caveats = [Caveat(kind, tuple(labels(rows[which]))) for kind, which in nameless.items() if which.any()]
    return rows[ids == (machine or known[0])], machine or known[0], caveats


def _in_time(statistics: FleetStatistics) -> list[int]:
    """Campaigns in order of date, equal dates as given; as given where there are none."""
    missing = [name for name, date in zip(statistics.campaigns, statistics.dates, strict=True) if date is None]
    if missing and len(missing) < len(statistics):
        raise InputError(
            f"campaigns must have a date all or none, got none for {', '.join(missing[:5])}. Write date = … into campaign.toml, "
            "or take all dates out and give the campaigns in order."
        )
    return sorted(range(len(statistics)), key=lambda place: statistics.dates[place] or datetime.min)


def _caveats(rows: pd.DataFrame, statistics: FleetStatistics, one_bar: bool) -> list[Caveat]:
    """What the campaigns do not have in common."""
    found = force_caveats(statistics) + (narrow_forces(rows, statistics.parameters) if one_bar else [])
    if all(date is None for date in statistics.dates):
        found.append(Caveat(CaveatKind.NO_DATES))
    elif len(set(statistics.dates)) < len(statistics):
        found.append(Caveat(CaveatKind.SAME_DATES))
    return [*found, Caveat(CaveatKind.TWO_CAMPAIGNS)] if len(statistics) == 2 else found


@one_blas_thread
def trend(
    rows: pd.DataFrame,
    *,
    machine: str | None = None,
    parameters: Sequence[str] | None = None,
    exclude: Sequence[str] = (),
    since: str | None = None,
    include_misfits: bool = False,
    reference_force_N: float | None = None,
    one_instrument: bool = True,
    change_scale: float = 0.2,
    repeatability: float = 0.01,
    probability: float = 0.5,
    threshold: float = 0.95,
    detect: float = 0.2,
    ci_prob: float = 0.95,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Trend:
    """Parameters of one machine over time: has one of them changed, and how soon would a change be found?

    Parameters
    ----------
    rows : DataFrame
        Of `read_batch`; which of them count, and ``exclude``, ``since`` and ``include_misfits``: see `choose`.
    machine : str, optional
        Needed where the rows are of several.
    parameters, reference_force_N, one_instrument
        See `fleet_statistics`; default: all constant compliances at the median of the campaigns' forces, one bar.
    change_scale : float
        Standard deviation of a change, in units of the parameter's default prior sd: 2e-5 mm/N of C_XXX.
    repeatability : float
        Scale of the half-normal density of r, what the machine changes from campaign to campaign, in the same units: 1e-6 mm/N
        of C_XXX, 2 % of a usual 5e-5 mm/N.
    probability : float
        Of a change, before the readings.
    threshold : float
        Probability above which a change counts as found.
    detect : float
        Relative change whose detection is predicted: 0.2 is +20 %.
    ci_prob : float
    seed : int
        Of the series simulated for the prediction.
    progress : callable, optional
        Called with the steps done and their number.

    Raises
    ------
    InputError
        For fewer than two campaigns, several machines and none chosen, dates of some campaigns only, options out of range.
    """
    check_probability(ci_prob)
    _check(change_scale, repeatability, probability, threshold, detect)
    chosen, machine, caveats = _of_one_machine(rows, machine)
    relied, more = choose(chosen, exclude, since, include_misfits, among=rows)
    caveats += more
    statistics = fleet_statistics(
        relied, parameters=parameters, reference_force_N=reference_force_N, one_instrument=one_instrument
    )
    if len(statistics) < 2:
        raise InputError(
            f"a trend must have at least 2 campaigns of one machine to rely on, got {len(statistics)}. "
            + " ".join(("Measure again.", *map(caveat_words, caveats)))
        )
    order, p = _in_time(statistics), len(statistics.parameters)
    series = Gaussian(statistics.likelihood.precision[order], statistics.likelihood.shift[order])
    scatter, prior = scatter_rule(repeatability)
    carried = deviating(series, np.outer(scatter, np.ones(p)))
    found = hypotheses(carried, p, change_scale)
    weights = weigh(found.log_integral, prior, probability)
    instrument = instrument_moments(found, weights)
    chart = chart_of(series, carried, scatter, prior, instrument)
    levels = levels_of(series, scatter, weights, instrument[0], change_scale, ci_prob=ci_prob)
    total, change, moments = 1.0 - float(weights[:, -1].sum()), weights[:, :-1], (found.mean, found.sd)
    when = zip(labels(relied.iloc[order]), order, [0.0, *change.sum(axis=(0, 2)).tolist()], strict=True)
    visits = tuple(Visit(name, statistics.dates[i], share) for name, i, share in when)
    likely = _most_probable(moments, change, statistics, visits, ci_prob)
    believed: dict[str, Any] = {"change_scale": change_scale, "repeatability": repeatability, "probability": probability}
    now, common = levels.mean[-1], chart.common_sd
    measured = np.abs(now) > _TOLD * np.hypot(levels.sd[-1], common)
    soon, alarm = detection(
        series.precision.mean(axis=0),
        np.concatenate([now, instrument[0]]),
        np.where(measured, detect * now, np.nan),
        before=len(order) - (likely.place if total > threshold else 0),
        scatter=(scatter, weights.sum(axis=(1, 2))),
        **believed,
        threshold=threshold,
        seed=seed,
        progress=progress,
    )
    said = {"threshold": threshold, "detect": detect, "ci": ci_prob, "one_instrument": bool(statistics.instrument), "seed": seed}
    return Trend(
        machine=machine,
        reference_force_N=statistics.reference_force_N,
        assumptions=believed | said,
        probability=total,
        changed=total > threshold,
        campaigns=visits,
        parameters=_parameters(moments, change, statistics, (now, levels.sd[-1], common), soon, ci_prob),
        most_probable=likely,
        scatter=_scattered(scatter, weights.sum(axis=(1, 2)), ci_prob),
        sensitivity=_sensitivity(series, p, believed),
        false_alarm=alarm,
        caveats=(*caveats, *_caveats(relied, statistics, one_instrument)),
        estimates=_estimates(statistics, visits, chart, levels, change, ci_prob),
    )


def _scattered(scatter: Array, weight: Array, ci_prob: float) -> Summary:
    """Of the scatter between campaigns."""
    mean = float(weight @ scatter)
    ends = np.searchsorted(np.cumsum(weight), [0.5 - 0.5 * ci_prob, 0.5 + 0.5 * ci_prob])
    low, high = scatter[np.minimum(ends, len(scatter) - 1)].tolist()
    return Summary(mean, float(np.sqrt(weight @ (scatter - mean) ** 2)), (low, high))


def _check(change_scale: float, repeatability: float, probability: float, threshold: float, detect: float) -> None:
    for name, value in (("change_scale", change_scale), ("repeatability", repeatability)):
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{name} must be above zero, in units of the prior's sd, got {value:g}. Correct it.")
    for name, value in (("probability", probability), ("threshold", threshold)):
        if not 0.0 < value < 1.0:
            raise InputError(f"{name} must lie between 0 and 1, got {value:g}. Correct it.")
    if not math.isfinite(detect) or detect == 0.0 or detect < -1.0:
        raise InputError(
            f"detect must be a relative change other than 0 and not below -1 (-100 %), got {detect:g}. For +20 % give 0.2."
        )


def _sensitivity(series: Gaussian, parameters: int, believed: Mapping[str, float]) -> dict[str, float]:
    """Probability of a change under other assumptions."""
    other = {
        **{f"{word} the {name}": (name, factor * believed[name]) for name, word, factor in _HALF_AND_TWICE},
        **{f"a prior probability of {value:g}": ("probability", value) for value in (0.1, 0.9)},
    }
    return {label: _changed(series, parameters, **{**believed, name: value}) for label, (name, value) in other.items()}


_HALF_AND_TWICE = tuple(
    (name, word, size) for name in ("change_scale", "repeatability") for word, size in (("half", 0.5), ("twice", 2.0))
)
