"""Functions that find the cheapest campaign that reaches given goals, and prepare its files.

The command ``design`` with ``--goal`` and the page in the browser share these functions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import ldbb_bayes as lb
from ldbb_bayes.campaign.circular_test import setup_number
from ldbb_bayes.campaign.folder import MODEL_NAME, write_campaign_into
from ldbb_bayes.cli.design_options import COST_OPTIONS
from ldbb_bayes.cli.operator_sheets import SHEET, sheet_of_plan

if TYPE_CHECKING:
    from ldbb_bayes.analysis.design import GoalDesign

__all__ = [
    "GOAL_FILES",
    "GoalDesignFiles",
    "files_of_goal_design",
    "find_for_goals",
    "running_order",
]

# Names of the files that are written for a campaign that reaches the user's goals for
# uncertainties. A folder with the campaign from which the search starts may be written too.
GOAL_FILES = ("campaign.toml", MODEL_NAME, "goals.json", SHEET)


class GoalDesignFiles(NamedTuple):
    """Files about a campaign that reaches all goals for expanded uncertainties at low cost."""

    #: result of the search for the cheapest campaigns, as a JSON object with sentences that
    #: describe the result
    record: dict[str, Any]
    #: contents of the files about the campaign; the keys are the names of the files
    contents: dict[str, Any]
    #: function that writes the plan of the campaign into a folder; None if no campaign was found
    write_more: Callable[[Path], object] | None


def find_for_goals(
    model: lb.HybridModel,
    pilot: lb.Campaign,
    settings: Mapping[str, Any],
    progress: Callable[[int, int], None] | None,
) -> GoalDesign:
    """Return the cheapest campaigns that reach the user's goals for expanded uncertainties.

    Parameters
    ----------
    model
        Model whose parameters have the goals.
    pilot
        Campaign or plan that the search starts from.
    settings
        Values of the options of the command ``design``, which include the goals; the keys are the
        names of the options.
    progress
        Function that is called with the number of steps done and the number of all steps; None if
        no progress is reported.

    Returns
    -------
    GoalDesign

    Raises
    ------
    InputError
        If a goal, a cost or another option cannot be used.
    """
    # The modules that design campaigns are imported here, and not at the top of the file, because
    # they load SciPy, which takes a long time.
    from ldbb_bayes.analysis.design import Costs

    others = dict(settings)
    costs = {name: others.pop(name) for name in COST_OPTIONS if name in others}
    return lb.design(model, pilot, costs=Costs(**costs), progress=progress, **others)


def files_of_goal_design(
    result: GoalDesign, seed: int, number: int = 1, language: str = "en"
) -> GoalDesignFiles:
    """Return the contents of the files for the folder of a campaign that reaches the goals.

    Parameters
    ----------
    result
        The cheapest campaigns that reach the goals.
    seed
        Seed of the random numbers that the search for the campaigns used.
    number
        Number of the campaign: 1 for the cheapest, 2 and 3 for the next best.
    language
        Code of the language of the operator's sheet.

    Returns
    -------
    GoalDesignFiles
        The files. If no campaign was found, the only file is ``goals.json``, which holds the result
        of the search.
    """
    # The module that writes model files is imported here, and not at the top of the file, because
    # it loads SciPy, which takes a long time.
    from ldbb_bayes.model.specification import model_to_toml

    record = {"schema": 1, "seed": seed, **lb.report.with_words(result)}
    contents: dict[str, Any] = {"goals.json": record}
    write_more = None
    if result.plans:
        chosen = result.plans[number - 1]
        contents[MODEL_NAME] = model_to_toml(chosen.model)
        contents[SHEET] = sheet_of_plan(chosen.plan(), language)
        write_more = partial(write_campaign_into, chosen.plan())
    return GoalDesignFiles(record, contents, write_more)


def running_order(plan: lb.Campaign, labels: Sequence[str] | None = None) -> str:
    """Return one string that lists a plan's tests in the order in which to run them.

    Plane, set-up, direction, radius and the angles of the balls are stated in brackets after each
    test. A setting that is the same in all tests is left out.

    Parameters
    ----------
    plan
        Campaign without readings.
    labels
        Words for each test, such as "417 N". Default: the names of the tests.

    Returns
    -------
    str
    """
    settings_by_test = []
    for test in plan.tests:
        settings_by_test.append(
            (
                f"plane {test.plane}",
                f"set-up {setup_number(test)}",
                test.direction or "–",
                f"{test.radius_mm:g} mm",
                f"balls {test.work_ball_deg:g}/{test.tool_ball_deg:g}°",
            )
        )
    values_by_setting = list(zip(*settings_by_test, strict=True))
    varied = [k for k, values in enumerate(values_by_setting) if len(set(values)) > 1]

    if labels is None:
        labels = [test.name for test in plan.tests]
    entries = []
    for label, settings in zip(labels, settings_by_test, strict=True):
        entry = label
        if varied:
            entry += f" ({', '.join(settings[k] for k in varied)})"
        entries.append(entry)
    return ", ".join(entries)
