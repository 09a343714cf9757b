"""A trend in sentences: what changed and when, how soon a change would be found, which campaigns to look at."""

from __future__ import annotations

import numpy as np

from ldbb_bayes.fleet.trended import Trend, probability_words
from ldbb_bayes.model.wording import joined
from ldbb_bayes.report.rounding import plus_minus
from ldbb_bayes.units import display_name, is_direct, units_for

__all__ = ["verdict_of"]

_NAMED = 3


def verdict_of(trend: Trend) -> tuple[str, ...]:
    """Sentences, the most important first."""
    with units_for(trend.sizes()):
        return (*_change(trend), *_outside(trend), *_prediction(trend), *_scope(trend))


def _change(trend: Trend) -> list[str]:
    whose = f" of {trend.machine}" if trend.machine else ""
    prior, threshold = trend.assumptions["probability"], trend.assumptions["threshold"]
    found = "a change is found" if trend.changed else "no change is found"
    said = [
        f"Over {len(trend.campaigns)} campaigns{whose} {found}: its probability is {probability_words(trend.probability)} "
        f"(before the readings {prior:g}; found means above {threshold:g})."
    ]
    others = [probability > threshold for probability in trend.sensitivity.values()]
    differing = [name for name, other in zip(trend.sensitivity, others, strict=True) if other != trend.changed]
    if differing:
        told = [f"{probability_words(trend.sensitivity[name])} with {name}" for name in differing]
        said.append(f"That hangs on assumptions: {joined(told)}.")
    if trend.changed:
        name, k, own = trend.most_probable.parameter, trend.most_probable.place, trend.most_probable.change
        size = plus_minus(own.size, own.sd, own.interval, own.unit)
        percent = ""
        if own.percent is not None and own.percent_interval is not None:
            low, high = own.percent_interval
            percent = f", {own.percent:+.0f} % [{low:.0f}, {high:.0f}] of the level before".replace("-", "−")
        said.append(
            f"It is most probably one of {display_name(name)} ({probability_words(trend.parameters[name].probability)}), then "
            f"between {_when(trend, k - 1)} and {_when(trend, k)} (both: {probability_words(own.probability)}): {size}{percent}."
        )
    return said


def _when(trend: Trend, t: int) -> str:
    date = trend.dates[t]
    return trend.campaigns[t] if date is None else f"{date.date().isoformat()} ({trend.campaigns[t]})"


def _outside(trend: Trend) -> list[str]:
    out = trend.estimates[trend.estimates["outside"]]
    if out.empty:
        return []
    told = [f"{name} ({', '.join(map(display_name, own['parameter']))})" for name, own in out.groupby("campaign", sort=False)]
    more = [] if len(told) <= _NAMED else [f"{len(told) - _NAMED} more"]
    return [f"Outside the limits drawn from the campaigns before: {joined([*told[:_NAMED], *more])}."]


def _prediction(trend: Trend) -> list[str]:
    soon, asked = trend.detection, trend.assumptions["detect"]
    said, slow = [], []
    horizon = len(soon.false_alarm)
    for k, name in enumerate(trend.parameters):
        if not np.isfinite(soon.changes[k]):
            continue
        needed = soon.campaigns(k)
        at = (needed or horizon) - 1
        share = _share(float(soon.found[k, at]), float(soon.error(soon.found[k])[at]))
        step = f"{display_name(name)} {100 * asked:+.0f} %".replace("-", "−")
        if needed is None:
            slow.append(f"{step} ({share})")
            continue
        what = f"A loosened joint ({step})" if asked > 0.0 and is_direct(name) else f"A change of {step}"
        said.append(f"{what} would be found within {needed} campaign{'s' * (needed > 1)} with probability {share}.")
    if slow:
        said.append(f"Hardly found within {horizon} campaigns, in brackets with what probability: {joined(slow)}.")
    alarm, error = float(soon.false_alarm[-1]), float(soon.error(soon.false_alarm)[-1])
    after = "campaign" if soon.before == 1 else f"{soon.before} campaigns"
    where = f"the {after} since the change" if trend.changed else f"the {after} so far"
    return [
        *said,
        f"That counts {where}; a false alarm within the next {horizon} has probability {_share(alarm, error)}.",
    ]


def _share(share: float, error: float) -> str:
    digits = 3 if error < 0.0095 else 2
    if share < error:
        return f"below {share + 2.0 * error:.{digits}f}"
    return f"{share:.{digits}f} ± {error:.{digits}f}"


def _scope(trend: Trend) -> list[str]:
    again = " To watch for the next one, take the campaigns since as a series of their own." if trend.changed else ""
    said = [f"One lasting step of one parameter is looked for, not several and not a slow drift.{again}"]
    if trend.assumptions["one_instrument"]:
        said.append(
            "Left aside: that one bar has the same length and ball form in all campaigns. That is conservative for changes, not "
            "for levels."
        )
    return said
