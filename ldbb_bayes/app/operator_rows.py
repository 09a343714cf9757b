"""What the operator's sheet of the browser page states of a plan and of its pilot, as texts."""

from __future__ import annotations

from typing import Any

import ldbb_bayes as lb
from ldbb_bayes.analysis.design.costs import effort_of
from ldbb_bayes.campaign.mountings import mounted_anew, setups_as_run
from ldbb_bayes.report.operator_sheet import handling_sentences, mounting_sentences

__all__ = ["circle_rows", "effort_row", "pilot_row"]

# Names of the attributes of a campaign that are texts on the operator's sheet.
_PILOT_TEXTS = (
    "name",
    "machine_type",
    "serial_number",
    "place",
    "ball_bar",
    "force_device",
    "topology",
)


def effort_row(plan: lb.Campaign) -> dict[str, int]:
    """Return the numbers of set-ups and of turns of the balls that a plan needs.

    Parameters
    ----------
    plan
        Plan of the tests.

    Returns
    -------
    dict
        The keys are ``setups`` and ``turns``.
    """
    effort = effort_of(plan.tests)
    return {"setups": effort.setups, "turns": effort.turns}


def circle_rows(plan: lb.Campaign) -> dict[str, Any]:
    """Return what the operator's sheet states of the circles of a plan.

    Parameters
    ----------
    plan
        Plan of the tests, in the order in which to run them.

    Returns
    -------
    dict
        ``tests`` holds the settings of each circle as texts, among them the number of the set-up
        in which it will be run. ``mountings`` holds sentences in English on when to mount the bar
        anew, and ``handling`` on how to turn the balls and on a bar that stays mounted.
        ``keeps_setup`` states whether the bar is never mounted anew.
    """
    tests = []
    for test, setup in zip(plan.tests, setups_as_run(plan), strict=True):
        tests.append({**_test_row(test, plan), "setup": f"{setup}"})
    return {
        "tests": tests,
        "mountings": list(mounting_sentences(plan)),
        "handling": list(handling_sentences(plan)),
        "keeps_setup": not mounted_anew(plan),
    }


def _test_row(test: lb.CircularTest, plan: lb.Campaign) -> dict[str, Any]:
    """Return the settings of a test as texts; the pressure follows from the plan's force law."""
    force = float(test.force_N or 0.0)
    return {
        "force": f"{force:.4g}",
        "pressure": f"{plan.force_law.pressure_bar(force):.3g}",
        "plane": test.plane,
        "direction": test.direction or "",
        "radius": f"{test.radius_mm:g}",
        "work": f"{test.work_ball_deg or 0:g}",
        "tool": f"{test.tool_ball_deg or 0:g}",
    }


def pilot_row(pilot: lb.Campaign) -> dict[str, Any]:
    """Return what the operator's sheet states about the campaign that a plan is based on.

    Parameters
    ----------
    pilot
        Campaign on which a plan is based.

    Returns
    -------
    dict
        Texts with the keys ``name``, ``machine_type``, ``serial_number``, ``place``, ``ball_bar``,
        ``force_device``, ``topology`` and ``feed`` [mm/min]; a text is empty if the campaign does
        not state it. Three numbers with the keys ``low`` and ``high``, the lowest and the highest
        force [N], and ``tests``, the number of tests.
    """
    row: dict[str, Any] = {name: getattr(pilot, name) or "" for name in _PILOT_TEXTS}
    row["feed"] = ""
    if pilot.feed_mm_per_min is not None:
        row["feed"] = f"{pilot.feed_mm_per_min:g}"
    row["low"] = float(pilot.forces_N.min())
    row["high"] = float(pilot.forces_N.max())
    row["tests"] = len(pilot.tests)
    return row
