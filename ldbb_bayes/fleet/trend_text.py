"""Trend of one machine as tables, sentences and a JSON record with sentences."""

from __future__ import annotations

from typing import Any

from ldbb_bayes.fleet.stiffness_series import stiffness_table
from ldbb_bayes.fleet.trend import ParameterChange, Trend
from ldbb_bayes.report.conformity_tables import conformity_table
from ldbb_bayes.report.text import parts_of
from ldbb_bayes.report.wording import caveat_words, probability_words, trend_sentences, with_words
from ldbb_bayes.report.wording.number_words import SMALLEST_SHOWN_PROBABILITY
from ldbb_bayes.results import Table
from ldbb_bayes.units import (
    NO_VALUE,
    counted,
    display_name,
    display_unit,
    plus_minus,
    round_uncertainty,
)

__all__ = ["parts_of"]


@parts_of.register
def _trend_parts(trend: Trend) -> tuple[Table | str, ...]:
    """Return what ``print`` shows of a trend: tables of its quantities, then sentences.

    There is a table of parameters, a table of conformity and a table of stiffness by direction. The
    table of conformity holds the decisions from the newest campaign; it is left out if there are no
    tolerances. The table of stiffness is left out if the batches have no stiffness by direction.
    The sentences state the findings and the limitations.
    """
    heads = ("parameter", "level now", "U, common", "P(changed)", "change, if it did", "of level")
    rows = [_table_row(name, change) for name, change in trend.parameters.items()]
    machine = f"{trend.machine}, " if trend.machine else ""
    force = f"compliances at {trend.reference_force_N:g} N"
    campaigns = counted(len(trend.campaigns), "campaign")
    table = Table.of(f"{machine}{campaigns}, {force}", heads, rows)
    percent = f"{100.0 * trend.assumptions['ci']:g} %"
    legend = (
        "Level now: from all campaigns together, at the newest of them."
        f" ± U = 2u; [low, high]: {percent} interval, where ± U does not describe it. U, common:"
        " what instrument and machine add to all campaigns alike."
    )
    passages: list[Table | str] = [table, legend, ""]
    newest_decisions = {}
    for name, decision_by_campaign in trend.conformity.items():
        if decision_by_campaign:
            *_, newest = decision_by_campaign.values()
            newest_decisions[name] = newest.as_dict()
    if newest_decisions:
        newest_campaign = trend.campaigns[-1].campaign
        passages.append(conformity_table(newest_decisions))
        passages.append(
            f"Value of the newest campaign alone, {newest_campaign}, with what the others say of"
            " the errors and effects that all have in common. The level now, of all campaigns, may"
            " differ from it."
        )
        passages.append("")
    if trend.stiffness:
        passages.append(stiffness_table(trend.stiffness))
    passages += trend_sentences(trend)
    passages += map(caveat_words, trend.caveats)
    return tuple(passages)


def _table_row(name: str, parameter: ParameterChange) -> list[str]:
    """Return the cells of one parameter's row in the printed table of a trend.

    The cells are

    - the name of the parameter;
    - its present level ± U, and the part of U that is common to all campaigns;
    - the probability that the parameter changed;
    - the size of this change ± U, also in per cent of the level before the change.

    U is the expanded uncertainty. The size is replaced by a dash if the probability of a change is
    negligible. The percentage is also replaced by a dash if the level before the change is too
    uncertain.
    """
    factor, unit = display_unit(parameter.unit)
    level = parameter.level_now
    common = NO_VALUE
    if parameter.common_sd > 0.0:
        common = f"{round_uncertainty(2.0 * parameter.common_sd * factor)[0]} {unit}"
    size = NO_VALUE
    percent = NO_VALUE
    # Beside a probability that is shown as zero, no size of the change is stated.
    if parameter.probability >= SMALLEST_SHOWN_PROBABILITY:
        change = parameter.change
        size = plus_minus(change.mean, change.sd, change.interval, parameter.unit)
        if parameter.percent is not None:
            percent = f"{parameter.percent:+.0f} %".replace("-", "−")
    return [
        display_name(name),
        plus_minus(level.mean, level.sd, level.interval, parameter.unit),
        common,
        probability_words(parameter.probability),
        size,
        percent,
    ]


@with_words.register
def _trend_record(trend: Trend) -> dict[str, Any]:
    """Return the content of trend.json: the result, and sentences on findings and limitations."""
    doubts = [caveat_words(caveat) for caveat in trend.caveats]
    return trend.as_dict() | {"doubts": doubts, "verdict": list(trend_sentences(trend))}
