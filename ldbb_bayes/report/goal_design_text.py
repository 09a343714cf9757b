"""Tables and sentences on the cheapest campaign that reaches all goals for uncertainties."""

from __future__ import annotations

from typing import Any

from ldbb_bayes.analysis.design import GoalDesign, GoalPlan
from ldbb_bayes.report import wording
from ldbb_bayes.results import Passage, Table, parts_of
from ldbb_bayes.units import digits_apart, display_name, display_unit, two_digits

__all__ = ["parts_of"]

# Name of the column that states how often each test of a plan is run. It is the last column.
_COUNT = "count"


@parts_of.register
def _passages_of_goal_design(result: GoalDesign) -> tuple[Passage, ...]:
    """Return the tables and sentences on the cheapest campaign that reaches all goals.

    The goals are upper limits for the uncertainties of parameters. The first sentences say what to
    run. The tables list the goals, the cheapest campaigns, and the campaigns that are customary
    today. If a goal cannot be reached, a sentence states the reason.
    """
    passages: list[Passage] = [*wording.goal_design_head(result), _goals_table(result)]
    if result.plans:
        passages += [_tests_table(result.best), _plans_table(result), _forecasts_table(result)]
    if result.customary:
        passages.append(_customary_table(result))
    return (*passages, *wording.goal_design_sentences(result))


@wording.with_words.register
def _record_of_goal_design(result: GoalDesign) -> dict[str, Any]:
    """Return the JSON record of the cheapest campaign that reaches all goals.

    The goals are upper limits for the uncertainties of parameters. The record also has sentences
    that describe the campaign.
    """
    sentences = [*wording.goal_design_head(result), *wording.goal_design_sentences(result)]
    return {**result.as_dict(), "sentences": sentences}


def _goals_table(result: GoalDesign) -> Table:
    """Return a table of the goals for the expanded uncertainty U (k = 2) of parameters.

    For each goal, the table states the largest U that is allowed, the present U (that of a fit of
    the circles run so far), the U to expect after the cheapest campaign, and a limit for this U.
    The probability that U is at most this limit is 90 %, given what is known so far. If a goal is
    not reached, the table says so, and states the U that the campaign is expected to leave.
    """
    after = dict(result.unreached)
    if result.plans:
        after |= result.best.goals
    rows = []
    for name, stated in result.goals.items():
        factor, unit = display_unit(stated.goal.unit)
        sizes = [stated.U if stated.U_of_fit is None else stated.U_of_fit]
        if name in after:
            sizes += [after[name].U, after[name].likely_U]
        limit, now, *forecast = digits_apart(stated.limit_U, sizes, factor)
        expected, likely = forecast or ("", "")
        if stated.met_by_pilot:
            likely = "met already"
        elif name in result.unreachable or name in result.near_misses or not result.plans:
            likely = "not reached"
        columns = [expected, likely] if result.plans else [likely]
        rows.append((display_name(name), limit, now, *columns, unit))
    before = "prior"
    if result.measured:
        before = "now"
    columns = ["U expected"] if result.plans else []
    heads = ("goal for U (k = 2)", "wanted", before, *columns, "nine in ten at most", "unit")
    return Table.of("Goals", heads, rows, text=("unit", "nine in ten at most"))


def _tests_table(plan: GoalPlan) -> Table:
    """Return a table of a plan's circles. The last column states how often to run each circle."""
    columns = [str(column) for column in plan.tests.columns if column != _COUNT]
    heads = [wording.PAGE["tests"].get(name, name) for name in columns]
    rows = []
    for row in plan.tests.to_numpy(dtype=object).tolist():
        cells = [value if isinstance(value, str) else f"{value:.4g}" for value in row]
        rows.append(cells)
    return Table.of("Circles of the cheapest campaign", (*heads, "circles"), rows)


def _plans_table(result: GoalDesign) -> Table:
    """Return a table of the cheapest campaigns, one per row. The cheapest campaign comes first."""
    rows = []
    for plan in result.plans:
        settings = [
            f"{plan.tests['radius_mm'].nunique()}",
            f"{len(plan.tests[['work_ball_deg', 'tool_ball_deg']].drop_duplicates())}",
        ]
        rows.append(
            (
                f"{plan.circles}",
                *settings,
                ", ".join(plan.certificates) or "none",
                f"{plan.minutes:.0f}",
                f"{plan.price:.0f}",
                wording.probability_words(plan.probability),
            )
        )
    heads = (
        "circles",
        "radii",
        "clockings",
        "certificates to buy",
        "min",
        "price",
        "all goals met",
    )
    return Table.of(
        "The cheapest campaigns", heads, rows, text=("certificates to buy", "all goals met")
    )


def _forecasts_table(result: GoalDesign) -> Table:
    """Return a table of the uncertainties that each of the cheapest campaigns is expected to give.

    For each campaign and goal, the table states the median and the 90 % quantile of the expanded
    uncertainty U (k = 2), and the probability that the goal is reached.
    """
    rows = []
    for number, plan in enumerate(result.plans, start=1):
        for name, forecast in plan.goals.items():
            factor, unit = display_unit(forecast.unit)
            rows.append(
                (
                    f"{number}",
                    display_name(name),
                    two_digits(forecast.U, factor),
                    two_digits(forecast.likely_U, factor),
                    unit,
                    wording.probability_words(forecast.probability),
                )
            )
    heads = ("campaign", "of", "U expected", "nine in ten at most", "unit", "goal met")
    return Table.of(
        "The goals after each of them, the cheapest first", heads, rows, text=("of", "unit")
    )


def _customary_table(result: GoalDesign) -> Table:
    """Return a table that compares customary campaigns with planned campaigns of the same size.

    For each parameter with a goal, the table states U (k = 2) after a campaign that is customary
    today, and U after the best campaign with the same number of circles.
    """
    rows = []
    for compared in result.customary:
        for name, usual in compared.customary.goals.items():
            factor, unit = display_unit(usual.unit)
            rows.append(
                (
                    compared.name,
                    f"{compared.customary.circles}",
                    display_name(name),
                    two_digits(usual.U, factor),
                    two_digits(compared.ours.goals[name].U, factor),
                    unit,
                )
            )
    planned = "U, as planned"
    if result.best.certificates:
        planned += ", certified"
    heads = ("balls as they are", "circles", "of", "U", planned, "unit")
    return Table.of("As it is done today", heads, rows, text=("of", "unit"))
