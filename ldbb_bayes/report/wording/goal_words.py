"""Sentences on goals for uncertainties, and on the cheapest campaign that reaches them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from ldbb_bayes.model.terms import Hysteresis
from ldbb_bayes.report.wording.effect_names import source_in_table
from ldbb_bayes.report.wording.sentence_file import SentenceFile
from ldbb_bayes.units import (
    digits_apart,
    display_name,
    display_unit,
    two_digits,
    value_and_uncertainty,
)

if TYPE_CHECKING:
    from ldbb_bayes.analysis.design import GoalDesign
    from ldbb_bayes.analysis.design.aims_so_far import GoalSoFar
    from ldbb_bayes.analysis.design.goal_design_result import StatedGoal

__all__ = ["goal_design_head", "goal_design_sentences", "goal_notes", "holder_in_words"]

_TEMPLATES = SentenceFile("goals")

# A goal that is out of reach can be replaced by a larger one. The goal that is suggested exceeds by
# this factor the U that the nearest campaign leaves at most on as many machines as were asked for:
# the search judges its campaigns on further machines, too, and other circles come nearest to it.
_ABOVE_REACHED = 1.05


def goal_design_head(result: GoalDesign) -> tuple[str, ...]:
    """Return the first sentences on a design for goals: what to run, or that nothing will do."""
    met = [name for name, stated in result.goals.items() if stated.met_by_pilot]
    left_out = [name for name in result.goals if name in (*result.unreachable, *result.near_misses)]
    return _TEMPLATES.sentences("goal_design_head", result, met, left_out)


def goal_design_sentences(result: GoalDesign) -> tuple[str, ...]:
    """Return further sentences on the cheapest campaign that reaches goals for uncertainties.

    If some goals cannot be reached, the sentences state the reasons.
    """
    shares = {name: stated.goal.share for name, stated in result.goals.items()}
    units = {name: stated.goal.unit for name, stated in result.goals.items()}
    then: dict[str, float | None] = {}
    if result.plans:
        after = {**result.best.goals, **result.unreached}
        then = {name: goal.averaged_U for name, goal in after.items()}
    notes = goal_notes(result.goals, shares, units, then, measured=result.measured)
    obstacles = []
    for name, obstacle in result.obstacles.items():
        stated = result.goals[name]
        factor, unit = display_unit(stated.goal.unit)
        remaining = [obstacle.U_floor, obstacle.U_with_certificate]
        if stated.goal.share is not None:
            # U that remains is a multiple of what a goal in percent permits on each machine.
            factor, unit = 100.0 * stated.goal.share / stated.limit_U, "%"
        limit, floor, with_certificate = digits_apart(stated.limit_U, remaining, factor)
        obstacles.append(
            {
                "name": display_name(name),
                "floor": f"{floor} {unit}",
                "limit": f"{limit} {unit}",
                "held_by": holder_in_words(obstacle.held_by),
                "is_hysteresis": obstacle.held_by == Hysteresis.__name__,
                "share": f"{100.0 * obstacle.share:.0f} %",
                "certificate": obstacle.certificate,
                "with_certificate": f"{with_certificate} {unit}",
                "reached": obstacle.reached,
                "in_reach": _goal_in_reach(stated, obstacle.reachable_U),
                "is_near_miss": name in result.near_misses,
            }
        )
    near_misses = []
    for name, near_miss in result.near_misses.items():
        stated = result.goals[name]
        factor, unit = display_unit(stated.goal.unit)
        limit, likely_U = digits_apart(stated.limit_U, [near_miss.likely_U], factor)
        wanted = f"{limit} {unit}"
        if stated.goal.share is not None:
            wanted = f"{100.0 * stated.goal.share:g} %"
        near_misses.append(
            {
                "name": display_name(name),
                "circles": near_miss.circles,
                "bought": near_miss.bought,
                "likely_U": f"{likely_U} {unit}",
                "limit": wanted,
                "probability": f"{100.0 * near_miss.probability:.0f} %",
                "held_by": holder_in_words(near_miss.held_by),
                "is_hysteresis": near_miss.held_by == Hysteresis.__name__,
                "share": f"{100.0 * near_miss.share:.0f} %",
                "certificate": near_miss.certificate,
                "in_reach": _goal_in_reach(stated, near_miss.reachable_U),
            }
        )
    within_time = _goals_within_time(result)
    planes: list[str] = []
    if result.customary:
        tests = result.customary[0].customary.tests
        if "plane" in tests:
            planes = list(dict.fromkeys(tests["plane"]))
    reasons = _TEMPLATES.sentences(
        "goal_design_reasons", result, obstacles, near_misses, within_time, planes
    )
    return reasons + notes


def _goals_within_time(result: GoalDesign) -> list[dict[str, str | None]]:
    """Return texts on the goals that only the longest machine time keeps out of reach.

    They state what the nearest campaign within this time leaves.
    """
    if not result.too_long or result.nearest is None:
        return []
    items = []
    for name, reachable_U in result.in_reach.items():
        if name in result.unreachable:
            continue
        stated = result.goals[name]
        factor, unit = display_unit(stated.goal.unit)
        likely_U = result.nearest.goals[name].likely_U
        limit, likely = digits_apart(stated.limit_U, [likely_U], factor)
        items.append(
            {
                "name": display_name(name),
                "likely_U": f"{likely} {unit}",
                "limit": f"{limit} {unit}",
                "in_reach": _goal_in_reach(stated, reachable_U),
            }
        )
    return items


def _goal_in_reach(stated: StatedGoal, reachable_U: float | None) -> str | None:
    """Return a goal that is in reach, as text; empty if it would be no less than U now.

    ``reachable_U`` is the expanded uncertainty (k = 2) that the nearest campaign leaves at most on
    as many machines as the goals are to be met on; the result is None if it is. The text is rounded
    up, so that it is reached too.
    """
    if reachable_U is None:
        return None
    factor, unit = display_unit(stated.goal.unit)
    size = _ABOVE_REACHED * reachable_U * factor
    step = 10.0 ** (math.floor(math.log10(size)) - 1)
    rounded_up = step * math.ceil(size / step)
    present_U = stated.U if stated.U_of_fit is None else stated.U_of_fit
    if rounded_up >= present_U * factor:
        return ""
    return f"{two_digits(rounded_up)} {unit}"


def goal_notes(
    goals: Mapping[str, StatedGoal | GoalSoFar],
    shares: Mapping[str, float | None],
    units: Mapping[str, str],
    averaged_then: Mapping[str, float | None],
    *,
    measured: bool,
    of_next: bool = False,
) -> tuple[str, ...]:
    """Return sentences on the numbers of goals for uncertainties.

    They state of which value a goal in percent is, how probable it is that U now meets it, what U
    is with all effects that the possible circles can show, and U averaged over constant and linear
    compliance. The U now is that of a fit of the circles run so far. ``shares`` are the goals as
    fractions of the parameters, or None, and ``units`` are the internal units of the parameters.
    ``averaged_then`` is the averaged U to expect after the cheapest campaign, if it is known. The
    keys are the names of the parameters. ``measured`` states whether there are readings.
    ``of_next`` states whether the goals are those of the next circle, whose table shows the
    probability that U now is enough.
    """
    percentages = []
    other_U = []
    averaged_texts: dict[str, list[str]] = {"now": [], "then": []}
    for name, goal in goals.items():
        factor, unit = display_unit(units[name])
        share = shares[name]
        if share is not None:
            value, _ = value_and_uncertainty(goal.value * factor, goal.U * factor)
            probability = ""
            if goal.probability is not None and not of_next:
                probability = f"{100.0 * goal.probability:.0f} %"
            percentages.append(
                {
                    "name": display_name(name),
                    "percent": f"{100.0 * share:g}",
                    "value": f"{value} {unit}",
                    "probability": probability,
                }
            )
        if goal.U_of_fit is not None:
            text = two_digits(goal.U, factor)
            if text != two_digits(goal.U_of_fit, factor):
                other_U.append(f"{display_name(name)} {text} {unit}")
        averaged = {"now": goal.averaged_U, "then": averaged_then.get(name)}
        for time, averaged_U in averaged.items():
            if averaged_U is not None:
                text = f"{display_name(name)} {two_digits(averaged_U, factor)} {unit}"
                averaged_texts[time].append(text)
    return _TEMPLATES.sentences(
        "goal_notes", percentages, other_U, measured, *averaged_texts.values()
    )


def holder_in_words(name: str) -> str:
    """Return the name, in words, of the source of variance that keeps a goal out of reach.

    The goal is an upper limit of a parameter's uncertainty. The name has a capital first letter,
    because it begins a sentence.
    """
    words = source_in_table(name)
    return words[:1].upper() + words[1:]
