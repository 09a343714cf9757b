"""Expected results of the next circular tests, and the files of the plan with these tests."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from ldbb_bayes.analysis.design.analysis_model import analysis_model
from ldbb_bayes.analysis.design.averaged_forecast import averaged_uncertainties
from ldbb_bayes.analysis.design.costs import Costs, minutes_of
from ldbb_bayes.analysis.design.simulated_analyses import simulate_analyses
from ldbb_bayes.app.goal_fields import goal_texts, with_goals
from ldbb_bayes.app.operator_rows import circle_rows, effort_row, pilot_row
from ldbb_bayes.app.planned_tests import (
    Report,
    pilot_of,
    planned_tests,
    report_of,
    settings_of_tests,
)
from ldbb_bayes.app.sliders import COST_SLIDERS, slider_values
from ldbb_bayes.app.worth import uncertainty_change
from ldbb_bayes.campaign.folder import MODEL_NAME, files_of, write_campaign_into
from ldbb_bayes.files import staged_folder
from ldbb_bayes.model.specification import model_to_toml
from ldbb_bayes.report.wording import is_noticeable
from ldbb_bayes.units import display_unit, two_digits

__all__ = ["PLAN", "forecast", "plan"]

PLAN = "plan"  # subfolder of a session (one browser tab) for the plan of the next tests
# Number of possible machines over which a forecast is averaged while the user moves a slider.
# Possible machines are machines that are likely given the readings so far. The number is smaller
# than for the final forecast, to make the forecast fast.
_QUICK_STATES = 16


def forecast(folder: Path, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the expected results of the tests that the sliders of the page describe.

    Parameters
    ----------
    folder
        Folder of the session (one browser tab).
    settings
        Values of the page's sliders and entry fields; the keys are their names.

    Returns
    -------
    dict
        Expanded uncertainty U (k = 2) of every parameter before these tests (from the fit), the U
        expected after these tests, and its goal (``rows``). Slopes (changes of compliance with
        force) are left out. The dict also has two probabilities of decisive evidence (``settle``):
        for linear compliance if the compliance is linear, and for constant compliance if it is
        constant. Further entries are the time and cost, the numbers of set-ups and of turns of
        the balls, the values of the sliders (``asked``), the campaign on which the plan is based
        (``pilot``), and the tests in the order in which to run them.

    Raises
    ------
    InputError
        If there is no fit yet, or the value of a slider is out of range.
    """
    costs = slider_values(settings, COST_SLIDERS)
    report = report_of(folder)
    settings_json = settings_of_tests(settings)
    planned = planned_tests(report, settings_json)
    expected = _expected_uncertainties(report, settings_json, fine=bool(settings.get("fine", True)))
    minutes = minutes_of(Costs(**costs), planned.plan.tests)
    stated: dict[str, Any] = {
        **planned.sliders,
        **costs,
        "directions": str(settings.get("directions") or ""),
        "augment": planned.space.augment,
    }
    pilot = planned.space.pilot
    texts = goal_texts(settings)
    stated["goals"] = texts
    rows = with_goals(expected["rows"], texts, planned.space.bound, pilot_of(report).mean)
    return {
        "rows": rows,
        "settle": expected["settle"],
        "asked": stated,
        "best": bool(settings.get("best")),
        **effort_row(planned.plan),
        "minutes": round(minutes),
        "cost": round(minutes / 60.0 * costs["price_per_hour"]),
        "pilot": pilot_row(pilot),
        **circle_rows(planned.plan),
    }


@lru_cache(maxsize=128)
def _expected_uncertainties(report: Report, settings_json: str, *, fine: bool) -> dict[str, Any]:
    """Return what to expect from planned tests: uncertainties, and the choice between two models.

    Entry ``rows`` of the result holds two expanded uncertainties U (k = 2) of every parameter: U
    from the fit, and U expected after the planned tests. Slopes (changes of compliance with force)
    are left out. Each row also holds the standard uncertainty to expect (``sd``) and the one that
    is not exceeded on 90 % of the possible machines (``likely_sd``). In a fine forecast, entry
    ``averaged`` of a row is U to expect, averaged over constant and linear compliance, with two
    digits. Entry ``settle`` holds two
    probabilities of decisive evidence: for compliance linear in force if the compliance is linear,
    and for constant compliance if it is constant. The entry is None if these probabilities cannot
    be forecast.

    Parameters
    ----------
    report
        Report of the fit on which the plan is based.
    settings_json
        Values of the page's sliders as JSON text; the keys are the names of the sliders.
    fine
        Whether to average over 64 possible machines, as the final forecast does. If False, the
        forecast averages over fewer machines and is faster.
    """
    space, plan_of_tests, _ = planned_tests(report, settings_json)
    sd_today = pilot_of(report).sd
    machines = None
    if not fine:
        machines = _QUICK_STATES
    analyses = simulate_analyses(space.model, plan_of_tests, machines=machines)
    expectation = space.forecast(plan_of_tests, analyses=analyses)
    averaged = averaged_uncertainties(analyses) if fine else {}
    rows = []
    for parameter in space.bound.parameters:
        if parameter.group != "slope":
            name = parameter.name
            expected = expectation.expected[name]
            sd_before = sd_today.get(name, math.inf)
            row = uncertainty_change(name, sd_before, expected.sd, expected.unit)
            row |= {"key": name, "sd": expected.sd, "likely_sd": expected.likely_sd}
            row["averaged"] = None
            if name in averaged and is_noticeable(averaged[name].sd, expected.sd):
                factor, _ = display_unit(expected.unit)
                row["averaged"] = two_digits(2.0 * averaged[name].sd, factor)
            rows.append(row)
    settle = None
    if expectation.discrimination is not None:
        settle = {
            "linear": expectation.discrimination.decisive_with,
            "constant": expectation.discrimination.decisive_without,
        }
    return {"rows": rows, "settle": settle}


def plan(folder: Path, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Write a plan with the tests that the page's sliders describe, and return its forecast.

    A plan is a campaign without readings. The file ``model.toml`` beside it is the model for the
    analysis of its readings. An earlier plan in the same folder is replaced.

    Parameters
    ----------
    folder
        Folder of the session (one browser tab); the plan is written into its subfolder ``plan``.
    settings
        Values of the page's sliders; the keys are the names of the sliders.

    Returns
    -------
    dict
        Result of `forecast`.

    Raises
    ------
    InputError
        If there is no fit yet, or the value of a slider is out of range.
    """
    expected = forecast(folder, settings)
    planned = planned_tests(report_of(folder), settings_of_tests(settings))
    campaign = replace(planned.plan, tolerances={})
    model = analysis_model(planned.space, campaign.tests)
    target = folder / PLAN
    with staged_folder(target, force=True, ours={MODEL_NAME, *files_of(target)}) as staging:
        write_campaign_into(campaign, staging)
        (staging / MODEL_NAME).write_text(model_to_toml(model), encoding="utf-8")
    return expected
