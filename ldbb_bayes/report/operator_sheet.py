"""Sheets for the operator: the next circle to run, or all circles of a plan.

The sheet of the next circle also states how close the campaign is to its aims: goals for
uncertainties, decisions on tolerances, and the choice of a model.
"""

from __future__ import annotations

from dataclasses import asdict

from ldbb_bayes.analysis.design import NextCircle
from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.campaign.mountings import mounted_anew, setups_as_run
from ldbb_bayes.report import wording
from ldbb_bayes.report.html_templates import template_of
from ldbb_bayes.report.next_circle_text import aims_passages
from ldbb_bayes.report.passage_translation import passages_in_language
from ldbb_bayes.results import Passage, Table

__all__ = ["handling_sentences", "mounting_sentences", "page", "page_of_plan"]

# Settings of a circle that the operator fills in, or that differ between circles by their nature.
# They always have a column in the table of circles.
_OF_EVERY_CIRCLE = ("Force", "Pressure", "File", "Time", "Temperature (°C)")
# What the operator does with the readings of a plan's circles, and of the one circle of `next`.
_AFTER_PLAN = (
    "Save the readings of each circle under its file name in the folder of the plan, and enter this"
    " name as file in campaign.toml."
)
_AFTER_ADDED_CIRCLES = (
    "Save the readings of each circle under its file name in the folder of the campaign so far."
    " Copy the [[test]] of each circle from the campaign.toml beside this sheet into that of the"
    " campaign, and enter the name there as file: the uncertainties of this plan are those of all"
    " circles together."
)
_BAR_STAYS = (
    "The bar stays as it was mounted for the circles before. If it has been taken off since, enter"
    " a new number as setup for these circles."
)
_TURN_A_BALL = (
    "Turn a ball in its socket about the normal of the circle's plane, counterclockwise as the"
    " angles of the circle count. Its position in the circles run before is 0°; without such"
    " circles, mark it when the bar is mounted."
)
_AFTER_ONE_CIRCLE = (
    "Save the readings under this file name in the folder of the campaign so far. Copy the [[test]]"
    " of this circle from the campaign.toml beside this sheet into that of the campaign, and enter"
    " the name there as file."
)
_TIME_OF_ONE_CIRCLE = (
    "Enter its time there as time_s, in seconds on the scale of the other circles: times count only"
    " if every circle states one."
)
_TIMES_OF_ADDED_CIRCLES = (
    "Enter the time of each circle there as time_s, in seconds on the scale of the other circles:"
    " times count only if every circle states one."
)


def page(step: NextCircle, plan: Campaign, language: str = "en") -> str:
    """Return a sheet for the machine's operator, with the next circle to run, as an HTML page.

    Parameters
    ----------
    step
        The best next circle of a campaign, with the campaign's aims.
    plan
        A plan of tests whose only test is the next circle.
    language
        Code of the language of the sheet, ``en`` or ``de``.

    Returns
    -------
    str
        The page as HTML.
    """
    campaign = (plan.pilot or plan).name

    def in_language(*passages: Passage) -> tuple[Passage, ...]:
        """Return tables and sentences in the language of the sheet."""
        return passages_in_language(passages, language, [campaign, _machine_of(plan)])

    setups = setups_as_run(plan)
    entries = [*_entries_of_campaign(plan), *_settings(plan, plan.tests[0], setups[0])]
    names, values = zip(*entries, strict=True)
    return template_of("operator.html.j2").render(
        language=language,
        in_language=in_language,
        title=in_language(f"Circle {step.circles + 1} of {campaign}")[0],
        concerns=in_language(*wording.next_circle_concerns(step)),
        head=in_language(*wording.next_circle_head(step)),
        finished=step.finished,
        mountings=in_language(*mounting_sentences(plan, step.circles + 1)),
        settings=zip(in_language(*names), in_language(*values), strict=True),
        passages=in_language(*aims_passages(step)),
        advice=in_language(*_advice(plan), *_after_one_circle(plan)),
    )


def page_of_plan(plan: Campaign, language: str = "en") -> str:
    """Return a sheet for the machine's operator, with all circles of a plan, as an HTML page.

    Parameters
    ----------
    plan
        Plan of tests, in the order in which to run them.
    language
        Code of the language of the sheet, ``en`` or ``de``.

    Returns
    -------
    str
        The page as HTML. Settings that are the same for all circles stand above the table of the
        circles.
    """
    names = [plan.name, _machine_of(plan), *(test.name for test in plan.tests)]

    def in_language(*passages: Passage) -> tuple[Passage, ...]:
        """Return tables and sentences in the language of the sheet."""
        return passages_in_language(passages, language, names)

    setups = setups_as_run(plan)
    circles = []
    for test, setup in zip(plan.tests, setups, strict=True):
        circles.append(dict(_settings(plan, test, setup)))
    common = dict(_entries_of_campaign(plan))
    for name, value in circles[0].items():
        if name not in _OF_EVERY_CIRCLE and all(circle[name] == value for circle in circles):
            common[name] = value
    heads = [name for name in circles[0] if name not in common]
    rows = []
    for number, circle in enumerate(circles, start=1):
        rows.append((f"{number}", *(circle[name] for name in heads)))
    table = Table.of("", ("Circle", *heads), rows, text=heads)
    common_names, common_values = zip(*common.items(), strict=True)
    return template_of("operator_plan.html.j2").render(
        language=language,
        title=in_language(f"Circles of {plan.name}")[0],
        lead=in_language("Run the circles in this order.")[0],
        mountings=in_language(*mounting_sentences(plan)),
        common=zip(in_language(*common_names), in_language(*common_values), strict=True),
        circles=in_language(table)[0],
        advice=in_language(*_advice(plan), *_to_buy(plan), *_after_plan(plan)),
    )


def mounting_sentences(plan: Campaign, first: int = 1) -> tuple[str, ...]:
    """Return sentences for the operator on when to mount the bar anew; none if it stays in place.

    If the set-up numbers in which the circles will be run are not those of the plan, a sentence
    says so.

    Parameters
    ----------
    plan
        Plan of tests, in the order in which to run them.
    first
        Number of the first circle.
    """
    setups = setups_as_run(plan)
    sentences = []
    for k in mounted_anew(plan):
        sentences.append(f"Mount the bar anew before circle {first + k} (set-up {setups[k]}).")
    if any(setup != test.setup for setup, test in zip(setups, plan.tests, strict=True)):
        sentences.append(
            "Enter the set-up numbers of this sheet as setup in campaign.toml: a bar that is"
            " mounted anew has a new number."
        )
    return tuple(sentences)


def handling_sentences(plan: Campaign) -> tuple[str, ...]:
    """Return sentences for the operator on how to handle the bar and the balls.

    If the bar stays as it was mounted for the circles before the ``plan``, a sentence says so. If a
    ball is turned in a circle of the plan, sentences state about which axis, in which sense and
    from which position the angles of the balls are measured.

    Parameters
    ----------
    plan
        Plan of tests, in the order in which to run them.
    """
    sentences = []
    if plan.adds_to_pilot and 0 not in mounted_anew(plan):
        sentences.append(_BAR_STAYS)
    if any(test.work_ball_deg or test.tool_ball_deg for test in plan.tests):
        sentences.append(_TURN_A_BALL)
    return tuple(sentences)


def _advice(plan: Campaign) -> tuple[str, ...]:
    """Return sentences for the operator on how to run the circles of a plan."""
    start = (
        "Warm up the machine first, keep one set-up, and write down the time at which each circle"
        " starts."
    )
    if mounted_anew(plan):
        start = "Warm up the machine first, and write down the time at which each circle starts."
    return start, *handling_sentences(plan)


def _to_buy(plan: Campaign) -> tuple[str, ...]:
    """Return a sentence on certificates that a plan counts on and its pilot does not state."""
    if plan.pilot is None or plan.instrument == plan.pilot.instrument:
        return ()
    of_plan = asdict(plan.instrument)
    of_pilot = asdict(plan.pilot.instrument)
    tables = []
    for name, value in of_plan.items():
        if value != of_pilot[name]:
            tables.append("balls" if name in ("work", "tool") else name.partition("_")[0])
    named = ", ".join(f"[{table}]" for table in dict.fromkeys(tables))
    return (
        f"The campaign.toml beside this sheet counts on certificates that are still to be bought:"
        f" {named}. Delete what it states of those that you do not buy.",
    )


def _after_plan(plan: Campaign) -> tuple[str, ...]:
    """Return sentences on what to do with the readings of a plan's circles."""
    if not plan.adds_to_pilot:
        return (_AFTER_PLAN,)
    if _times_are_needed(plan):
        return _AFTER_ADDED_CIRCLES, _TIMES_OF_ADDED_CIRCLES
    return (_AFTER_ADDED_CIRCLES,)


def _after_one_circle(plan: Campaign) -> tuple[str, ...]:
    """Return sentences on what to do with the readings of the next circle."""
    if _times_are_needed(plan):
        return _AFTER_ONE_CIRCLE, _TIME_OF_ONE_CIRCLE
    return (_AFTER_ONE_CIRCLE,)


def _times_are_needed(plan: Campaign) -> bool:
    """Return whether the circles of a plan that adds to its pilot must state their times.

    All circles run so far, which are those of the pilot of ``plan``, may state their times. They
    would be lost without those of the further circles.
    """
    run = plan.pilot.tests if plan.pilot is not None else ()
    return bool(run) and all(test.time_s is not None for test in run)


def _machine_of(plan: Campaign) -> str:
    """Return the type and the name or serial number of a plan's machine; empty if not stated."""
    return ", ".join(entry for entry in (plan.machine_type, plan.machine_id) if entry)


def _entries_of_campaign(plan: Campaign) -> list[tuple[str, str]]:
    """Return entries of the operator's sheet on the whole plan, each a tuple of name and text.

    Entries that the operator fills in have an empty text.
    """
    return [("Machine", _machine_of(plan)), ("Operator", ""), ("Date", "")]


def _settings(plan: Campaign, test: CircularTest, setup: int) -> list[tuple[str, str]]:
    """Return the settings of a circle of a plan as entries of the operator's sheet.

    ``setup`` is the number of the set-up in which the circle will be run. Each entry is a tuple of
    name and text. The texts state the settings with their units. Entries that the operator fills in
    have an empty text.
    """
    force = float(test.force_N or 0.0)
    feed = ""
    if plan.feed_mm_per_min is not None:
        feed = f"{plan.feed_mm_per_min:g} mm/min"
    return [
        ("Force", f"{force:.4g} N"),
        ("Pressure", f"{plan.force_law.pressure_bar(force):.3g} bar"),
        ("Plane", str(test.plane)),
        ("Set-up", f"{setup}"),
        ("Direction", test.direction or "as before"),
        ("Start angle", f"{test.angle_deg[0] % 360.0:g}°"),
        ("Arc", f"{abs(test.planned_arc_deg):g}°"),
        ("Radius", f"{test.radius_mm:g} mm"),
        ("Feed", feed),
        ("Work ball turned", f"{test.work_ball_deg:g}°"),
        ("Tool ball turned", f"{test.tool_ball_deg:g}°"),
        ("File", f"{test.name}.csv"),
        ("Time", ""),
        ("Temperature (°C)", ""),
    ]
