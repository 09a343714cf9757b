"""Goals typed on the browser page: the largest expanded uncertainty U wanted for a parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ldbb_bayes.analysis.design.goals import COVERAGE_FACTOR, goals_in
from ldbb_bayes.app.fields import with_decimal_points
from ldbb_bayes.errors import InputError
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.units import display_unit, two_digits

__all__ = ["GOAL_PREFIX", "goal_texts", "goals_typed", "with_goals"]

# Beginning of the name of every entry field for a goal (limit of an uncertainty); the name of the
# parameter follows.
GOAL_PREFIX = "goal_"
# A text typed as a goal for an uncertainty is cut off after this number of characters.
_LONGEST_TEXT = 40


def goal_texts(settings: Mapping[str, Any]) -> dict[str, str]:
    """Return the texts typed as goals for uncertainties; empty fields are left out.

    Parameters
    ----------
    settings
        Values of the page's sliders and fields; the keys are the names of sliders and fields.

    Returns
    -------
    dict
        Texts such as "10 µrad" or "5 %", as they were typed; the keys are the names of the
        parameters.
    """
    texts = {}
    for name, value in settings.items():
        text = str(value).strip()[:_LONGEST_TEXT]
        if name.startswith(GOAL_PREFIX) and text:
            texts[name.removeprefix(GOAL_PREFIX)] = text
    return texts


def goals_typed(texts: Mapping[str, str]) -> dict[str, str]:
    """Return the texts of goals with decimal points, as `goals_in` reads them.

    The keys of ``texts`` are names of parameters. Raise an `InputError` if a comma may stand
    between thousands.
    """
    return {name: with_decimal_points(text, f"goal of {name}") for name, text in texts.items()}


def with_goals(
    rows: Sequence[Mapping[str, Any]],
    texts: Mapping[str, str],
    bound: BoundModel,
    estimates: Mapping[str, float],
) -> list[dict[str, Any]]:
    """Return the rows of the table of expected uncertainties, with the goal for each parameter.

    Parameters
    ----------
    rows
        Rows of the table, each a dict for one parameter. ``key`` is the name of the parameter. The
        readings so far are compatible with many possible machines. The expected standard
        uncertainty is at most ``sd`` on half of the possible machines, and at most ``likely_sd`` on
        nine in ten of them.
    texts
        Texts typed as goals; the keys are the names of the parameters.
    bound
        Model applied to the campaign. The model states the units of the parameters.
    estimates
        Estimates of the parameters; goals in percent refer to these estimates.

    Returns
    -------
    list
        The rows. Each row has three further texts. ``wanted`` is the largest U (k = 2) that the
        goal permits. ``reached`` says on how many of the possible machines U is small enough:
        "nine" means nine in ten, "half" means half, and "no" means fewer than half. ``refused`` is
        the error message if the text of the goal cannot be read. Texts that do not apply are empty.
    """
    extended = []
    for row in rows:
        goal_row: dict[str, Any] = {"wanted": "", "reached": "", "refused": ""}
        text = texts.get(row["key"], "")
        if text:
            goal_row |= _goal_row(row, text, bound, estimates)
        extended.append({**row, **goal_row})
    return extended


def _goal_row(
    row: Mapping[str, Any], text: str, bound: BoundModel, estimates: Mapping[str, float]
) -> dict[str, Any]:
    """Return texts about the goal for one parameter, as a dict.

    The goal is the largest permitted expanded uncertainty U (k = 2) of the parameter. The keys of
    the dict are ``wanted`` and ``reached``, or only ``refused`` if the goal cannot be read;
    `with_goals` describes the texts.
    """
    name = row["key"]
    try:
        goal = goals_in(bound, goals_typed({name: text}))[name]
    except InputError as error:
        return {"refused": str(error)}
    limit = float(goal.limit_U(estimates[name]))
    reached = "no"
    if COVERAGE_FACTOR * row["likely_sd"] <= limit:
        reached = "nine"
    elif COVERAGE_FACTOR * row["sd"] <= limit:
        reached = "half"
    factor, _ = display_unit(goal.unit)
    return {"wanted": two_digits(limit, factor), "reached": reached}
