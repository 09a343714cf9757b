"""Sentences on the next circle of a campaign that is not finished."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from ldbb_bayes.report.wording.fit_words import concern_sentences
from ldbb_bayes.report.wording.goal_words import goal_notes
from ldbb_bayes.report.wording.sentence_file import SentenceFile
from ldbb_bayes.units import digits_apart, display_name, display_unit

if TYPE_CHECKING:
    from ldbb_bayes.analysis.design import NextCircle

__all__ = [
    "next_circle_concerns",
    "next_circle_goals",
    "next_circle_head",
    "next_circle_model",
    "next_circle_tolerances",
]

_TEMPLATES = SentenceFile("next_circle")

# A goal that is out of reach in the mean may be met all the same. This is said if the next circle
# meets the goal with at least this probability.
_MAY_BE_MET = 0.05


def next_circle_concerns(step: NextCircle) -> tuple[str, ...]:
    """Return warnings of what the readings so far contradict, to be read before anything else."""
    return tuple(concern_sentences(step.concerns, {}))


def next_circle_head(step: NextCircle) -> tuple[str, ...]:
    """Return the first sentences on the next circle.

    If every aim is reached, they say that the campaign may stop. Otherwise, they state the settings
    of the best next circle, and how many more circles are expected to be enough. They name the
    aims, and the goals that no number of circles reaches.
    """
    best_circle = step.table.to_dict(orient="records")[0]
    # A direction that is the same for all possible circles has no column in the table.
    best_circle.setdefault("direction", step.direction)
    aims = _aims_in_words(step.goals, step.tolerances, step.model_is_aim)
    unreached = _aims_in_words(
        step.unreached_goals, step.unreached_tolerances, step.model_is_unreached
    )
    out_of_reach = []
    for name, goal in step.goals.items():
        if goal.probability < step.confidence and goal.U_floor > goal.U_needed:
            factor, unit = display_unit(goal.unit)
            # A goal in percent may take less U than the goal for the estimate, for the true value
            # may be smaller.
            by_true_value = goal.U_floor <= goal.limit
            largest_U = goal.U_needed if by_true_value else goal.limit
            limit, floor = digits_apart(largest_U, [goal.U_floor], factor)
            out_of_reach.append(
                {
                    "name": display_name(name),
                    "floor": f"{floor} {unit}",
                    "limit": f"{limit} {unit}",
                    "needed": f"{limit} {unit}" if by_true_value else "",
                    "may_be_met": goal.probability_next >= _MAY_BE_MET,
                    "probability_next": goal.probability_next,
                }
            )
    undecidable = []
    for name, tolerance in step.tolerances.items():
        if not tolerance.decided and tolerance.U_floor > tolerance.U_needed:
            factor, unit = display_unit(tolerance.now.unit)
            needed, floor = digits_apart(tolerance.U_needed, [tolerance.U_floor], factor)
            undecidable.append(
                {
                    "name": display_name(name),
                    "floor": f"{floor} {unit}",
                    "needed": f"{needed} {unit}",
                }
            )
    return _TEMPLATES.sentences(
        "next_circle_head", step, best_circle, aims, unreached or aims, out_of_reach, undecidable
    )


def _aims_in_words(goals: Iterable[str], tolerances: Iterable[str], model: bool) -> list[str]:
    """Return the names, in words, of aims of a campaign.

    ``goals`` are the names of parameters whose U has a limit, and ``tolerances`` those of
    quantities whose conformity is to be decided. ``model`` states whether the choice between
    constant and linear compliance is one of the aims.
    """
    aims = [f"U of {display_name(name)}" for name in goals]
    aims += [f"conformity of {display_name(name)}" for name in tolerances]
    if model:
        aims.append("whether compliance is constant or linear in force")
    return aims


def next_circle_goals(step: NextCircle) -> tuple[str, ...]:
    """Return sentences on the numbers of the goals for uncertainties, which a table lists.

    They state of which value a goal in percent is, and the U of a fit of the circles run so far
    where it is not the U now. The tuple is empty if nothing is to be said.
    """
    shares = {name: goal.share for name, goal in step.goals.items()}
    units = {name: goal.unit for name, goal in step.goals.items()}
    return goal_notes(step.goals, shares, units, {}, measured=True, of_next=True)


def next_circle_tolerances(step: NextCircle) -> tuple[str, ...]:
    """Return a tuple with a sentence on the model with which tolerances are decided.

    The tuple is empty if there are no tolerances, or if compliance is constant in the model.
    """
    if not step.tolerances or step.model is None:
        return ()
    return _TEMPLATES.sentences("next_circle_tolerances")


def next_circle_model(step: NextCircle) -> tuple[str, ...]:
    """Return a tuple with a sentence on the choice between constant and linear compliance.

    The tuple is empty if compliance cannot change with force in the model of the campaign.
    """
    if step.model is None:
        return ()
    return _TEMPLATES.sentences("next_circle_model", step)
