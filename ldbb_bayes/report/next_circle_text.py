"""Tables and sentences on the next circle to run in a campaign that is not finished."""

from __future__ import annotations

from ldbb_bayes.analysis.design import NextCircle
from ldbb_bayes.report import wording
from ldbb_bayes.results import Passage, Table, parts_of
from ldbb_bayes.units import digits_apart, display_name, display_unit, value_and_uncertainty

__all__ = ["aims_passages", "parts_of"]


@parts_of.register
def _passages_of_next_circle(step: NextCircle) -> tuple[Passage, ...]:
    """Return sentences and tables on the best next circle and on the aims of the campaign.

    The aims are target uncertainties, decisions on tolerances, and the choice of a model. The first
    sentences name the best next circle. Tables and sentences then state how far each aim is
    reached. The last table lists several good choices for the next circle; the table is left out if
    the campaign may stop. If the readings contradict what was known beforehand, warnings of this
    come before everything else.
    """
    passages: list[Passage] = [
        *wording.next_circle_concerns(step),
        *wording.next_circle_head(step),
        *aims_passages(step),
    ]
    if not step.finished:
        passages.append(_circles_table(step))
    return tuple(passages)


def aims_passages(step: NextCircle) -> list[Passage]:
    """Return tables and sentences on a campaign's aims, now and after the next circle.

    Parameters
    ----------
    step
        The best next circle of a campaign, with the campaign's aims (goals for uncertainties,
        decisions on tolerances, and the choice of a model).

    Returns
    -------
    list
        Tables and sentences.
    """
    passages: list[Passage] = []
    if step.goals:
        passages += [_goals_table(step), *wording.next_circle_goals(step)]
    if step.tolerances:
        passages += [_tolerances_table(step), *wording.next_circle_tolerances(step)]
    return [*passages, *wording.next_circle_model(step)]


def _goals_table(step: NextCircle) -> Table:
    """Return a table of the goals for the expanded uncertainty U (k = 2) of parameters.

    For each goal, the table states the present U of a fit, the expected U after the next circle,
    and the U that would remain after very many further circles. Two further columns state the
    probability that the goal is reached now, and the probability that it is reached after the next
    circle.
    """
    rows = []
    for name, goal in step.goals.items():
        factor, unit = display_unit(goal.unit)
        expanded = goal.U if goal.U_of_fit is None else goal.U_of_fit
        sizes = [expanded, goal.U_next, goal.U_floor]
        limit, now, after_next, floor = digits_apart(goal.limit, sizes, factor)
        met = wording.probability_words(goal.probability)
        met_next = wording.probability_words(goal.probability_next)
        rows.append((display_name(name), now, limit, met, after_next, met_next, floor, unit))
    heads = (
        "goal for U (k = 2)",
        "now",
        "wanted",
        "met (p)",
        "after the next",
        "met (p)",
        "no less than",
        "unit",
    )
    return Table.of("", heads, rows, text=("unit",))


def _tolerances_table(step: NextCircle) -> Table:
    """Return a table with one row for each quantity that has a tolerance.

    The columns include the value of the quantity, U (k = 2), the tolerance, and the decision on
    conformity. The caption states the force of compliances and stiffnesses.
    """
    rows = []
    for name, state in step.tolerances.items():
        now = state.now
        factor, unit = display_unit(now.unit)
        limits = wording.limit_words(now.lower, now.upper, factor)
        value, expanded = "–", "–"
        if now.mean is not None and now.sd is not None:
            value, expanded = value_and_uncertainty(now.mean * factor, 2.0 * now.sd * factor)
        rows.append(
            (
                display_name(name),
                value.replace("-", "−"),
                expanded,
                limits,
                unit,
                wording.probability_words(now.probability),
                now.decision.value,
                wording.probability_words(state.decided_next),
            )
        )
    heads = ("tolerance", "value", "U", "limit", "unit", "conforms", "decision", "decided next")
    forces_N = set()
    for state in step.tolerances.values():
        if state.now.force_N is not None:
            forces_N.add(state.now.force_N)
    caption = ", ".join(f"Tolerances at {force:g} N" for force in sorted(forces_N))
    return Table.of(caption, heads, rows, text=("unit", "limit", "decision"))


def _circles_table(step: NextCircle) -> Table:
    """Return a table of good choices for the next circle. The best choice comes first."""
    columns = [str(column) for column in step.table.columns[:-1]]
    heads = [wording.PAGE["tests"].get(name, name) for name in columns]
    rows = []
    for row in step.table.to_numpy(dtype=object).tolist():
        settings = [str(value) if isinstance(value, str) else f"{value:.4g}" for value in row[:-1]]
        rows.append([*settings, f"{100.0 * float(row[-1]):.1f}"])
    return Table.of("", (*heads, "nearer by (%)"), rows)
