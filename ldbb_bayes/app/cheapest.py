"""Search for the cheapest campaign that reaches the uncertainty goals typed on the browser page."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import ldbb_bayes as lb
from ldbb_bayes.analysis.design import Costs, GoalDesign, GoalPlan
from ldbb_bayes.analysis.design.certificate_offers import offers_in, require_missing
from ldbb_bayes.analysis.design.goals import USUAL_PROBABILITY, goals_in
from ldbb_bayes.analysis.design.possible_certificates import require_possible
from ldbb_bayes.app.fields import RESULT, linear_model, typed_value
from ldbb_bayes.app.goal_fields import GOAL_PREFIX, goal_texts, goals_typed
from ldbb_bayes.app.operator_rows import circle_rows, effort_row, pilot_row
from ldbb_bayes.app.page_words import LANGUAGES, words_of_page
from ldbb_bayes.app.sliders import COST_SLIDERS
from ldbb_bayes.app.understanding import refusal
from ldbb_bayes.cli.design_options import COST_OPTIONS, DESIGN_OPTIONS
from ldbb_bayes.cli.goal_designs import files_of_goal_design, find_for_goals
from ldbb_bayes.cli.output import write_files
from ldbb_bayes.errors import InputError, check_probability, require
from ldbb_bayes.report.passage_translation import passages_in_language
from ldbb_bayes.results import Passage, Table, parts_of

__all__ = [
    "CHEAPEST",
    "SEARCH_FIELDS",
    "SearchField",
    "find_cheapest_campaigns",
    "passages_shown",
    "wrong_entry",
]

# Name of the folder for the campaigns that a search finds. It contains one subfolder for each
# campaign, named 1, 2 or 3.
CHEAPEST = "cheapest"
# Name of the option of the command ``design`` that states the prices of certificates.
_CERTIFICATES = "certificates"
# Name of the command-line option for the probability with which a campaign must reach all goals for
# uncertainties.
_PROBABILITY = "probability"


class SearchField(NamedTuple):
    """An entry field of the browser page; it sets an option of the search for cheap campaigns.

    The option is one of the command ``ldbb-bayes design``.
    """

    name: str  #: Name of the command-line option, such as ``minutes_per_circle``.
    default: str  #: Default of the command-line option as text; empty if there is none.
    is_number: bool  #: Whether the value of the command-line option is a number.
    is_slider: bool = False  #: Whether a slider of the planned tests sets the option.


def _search_fields() -> tuple[SearchField, ...]:
    """Return the entry fields for costs, certificates and the probability of meeting the goals.

    A goal is an upper limit of a parameter's uncertainty. The defaults are those of the command
    ``design``.
    """
    costs = Costs()
    fields = []
    for name in COST_OPTIONS:
        value = getattr(costs, name)
        default = "" if value is None else f"{value:g}"
        is_slider = name in COST_SLIDERS
        fields.append(SearchField(name, default, is_number=True, is_slider=is_slider))
    fields.append(SearchField(_CERTIFICATES, "", is_number=False))
    fields.append(SearchField(_PROBABILITY, f"{USUAL_PROBABILITY:g}", is_number=True))
    return tuple(fields)


SEARCH_FIELDS = _search_fields()


# ---- texts typed on the page


def _option_value(name: str, asked: Mapping[str, Any], folder: Path) -> Any:
    """Return an option's value from the text typed on the page; None for an empty text.

    The value is the one that the command ``design`` reads from the same text. ``name`` is the name
    of the command's option, and ``folder`` the folder of the session (one browser tab).
    """
    option = DESIGN_OPTIONS[name]
    text = str(asked.get(name, "")).strip()
    if name == _CERTIFICATES:
        text = _certificates_as_in_command(text)
    if not text:
        return None
    return option.read(typed_value(option, name, text, folder), name)


def _certificates_as_in_command(text: str) -> str:
    """Return the typed list of certificates, with the names that the command ``design`` uses.

    The names may be typed in any language of the page: "Kugeln G10=300" becomes "balls G10=300".
    """
    for language in LANGUAGES:
        names = words_of_page(language)["cheapest"]["certificate_names"]
        for name, typed in names.items():
            text = re.sub(rf"\b{typed}\b", name, text, flags=re.IGNORECASE)
    return text


def _options_of(asked: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return the values that the user typed for options of the search for the cheapest campaign.

    The keys are the names of the command-line options. Options with an empty entry field are left
    out.
    """
    values = {}
    for field in SEARCH_FIELDS:
        value = _option_value(field.name, asked, folder)
        if value is not None:
            values[field.name] = value
    return values


def wrong_entry(folder: Path, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return the first entry that cannot be used to search for the cheapest campaign.

    Parameters
    ----------
    folder
        Folder of the session (one browser tab).
    asked
        Texts typed on the page; the keys are the names of the entry fields.

    Returns
    -------
    dict
        ``refused`` is the reason why the entry cannot be used, and ``wrong`` is the name of its
        field. The dictionary is empty if all entries can be used.

    Raises
    ------
    InputError
        If there is no fit yet.
    """
    campaign = folder / RESULT / "campaign"
    require(campaign.is_dir(), "a plan must follow a fit, got none yet. Fit first.")
    pilot = lb.read_campaign(campaign)
    bound = linear_model().bind(pilot)
    name = ""
    try:
        for parameter, text in goal_texts(asked).items():
            name = GOAL_PREFIX + parameter
            goals_in(bound, goals_typed({parameter: text}))
        for field in SEARCH_FIELDS:
            name = field.name
            _check_entry(name, _option_value(name, asked, folder), pilot)
    except InputError as error:
        return {"refused": refusal(error, folder), "wrong": name}
    return {}


def _check_entry(name: str, value: Any, pilot: lb.Campaign) -> None:
    """Raise an `InputError` if an option of the search for the cheapest campaign is not valid.

    ``name`` is the name of the option, and ``value`` its value. The value None is not checked.
    ``pilot`` is the campaign that the search starts from: a certificate must not state what the
    campaign states already, and its readings must not contradict the certificate.
    """
    if value is None:
        return
    if name == _CERTIFICATES:
        offers = offers_in(value)
        require_missing(offers, pilot.instrument)
        require_possible(offers, linear_model(), pilot)
    elif name == _PROBABILITY:
        check_probability(value, name)
    else:
        Costs(**{name: value})


# ---- search for the cheapest campaign, and files of the campaigns found


def find_cheapest_campaigns(
    folder: Path, asked: Mapping[str, Any], progress: Callable[[int, int], None] | None
) -> dict[str, Any]:
    """Find the cheapest campaigns that reach the uncertainty goals, and write their files.

    The search and the files are the same as those of the command ``design`` with ``--goal``.

    Parameters
    ----------
    folder
        Folder of the search. Its subfolder ``result/campaign`` has the campaign that the search
        starts from. The files of the campaigns found are written into its subfolder ``cheapest``.
    asked
        Texts typed on the page; the keys are the names of the entry fields.
    progress
        Function that is called with the number of steps done and the number of all steps.

    Returns
    -------
    dict
        ``passages`` holds the tables and sentences that the command prints. ``pilot`` holds the
        texts on the machine and the instrument for the operator's sheets. ``campaigns`` holds the
        cost of each campaign, and its circles in the order in which to run them.

    Raises
    ------
    InputError
        If a goal or a cost cannot be used.
    """
    pilot = lb.read_campaign(folder / RESULT / "campaign")
    seed = DESIGN_OPTIONS["seed"].default
    settings = {
        "goals": goals_typed(goal_texts(asked)),
        "augment": bool(asked.get("augment")),
        "seed": seed,
        **_options_of(asked, folder),
    }
    result = find_for_goals(linear_model(), pilot, settings, progress)
    campaigns = []
    for number, plan in enumerate(result.plans, start=1):
        _write_campaign(folder / CHEAPEST / str(number), result, seed, number)
        campaigns.append(_campaign_row(plan))
    return {
        "passages": [_passage_record(passage) for passage in parts_of(result)],
        "pilot": pilot_row(pilot),
        "campaigns": campaigns,
    }


def _write_campaign(folder: Path, result: GoalDesign, seed: int, number: int) -> None:
    """Write the files of one campaign found by a search into the new folder ``folder``.

    ``result`` is the result of the search, and ``seed`` its seed. ``number`` is 1 for the cheapest
    campaign found, 2 for the second cheapest, and so on.
    """
    files = files_of_goal_design(result, seed, number)
    folder.mkdir(parents=True)
    write_files(folder, files.contents)
    if files.write_more is not None:
        files.write_more(folder)


def _campaign_row(plan: GoalPlan) -> dict[str, Any]:
    """Return the cost of a campaign, and its circles in the order in which to run them."""
    planned = plan.plan()
    return {
        **effort_row(planned),
        "circles": plan.circles,
        "minutes": plan.minutes,
        "price": plan.price,
        "certificates": list(plan.certificates),
        **circle_rows(planned),
    }


# ---- tables and sentences: conversion to JSON, and translation into the language of the page


def _passage_record(passage: Passage) -> dict[str, Any]:
    """Return a table or a sentence as a dictionary that can be written as JSON."""
    if isinstance(passage, Table):
        return {"table": asdict(passage)}
    return {"text": passage}


def _passage_from(record: Mapping[str, Any]) -> Passage:
    """Return the table or sentence from which `_passage_record` has made ``record``."""
    if "text" in record:
        return str(record["text"])
    table = record["table"]
    return Table(
        table["caption"],
        tuple(table["heads"]),
        tuple(table["numeric"]),
        tuple(tuple(row) for row in table["rows"]),
    )


def passages_shown(outcome: Mapping[str, Any], language: str) -> Sequence[Passage]:
    """Return the tables and sentences that describe the result of a search for campaigns.

    Parameters
    ----------
    outcome
        Result of `find_cheapest_campaigns`, an error message, or an empty dictionary.
    language
        Language of the tables and sentences: en or de.

    Returns
    -------
    sequence of Table or str
        Empty if ``outcome`` is not a result.
    """
    if "passages" not in outcome:
        return ()
    passages = [_passage_from(record) for record in outcome["passages"]]
    translated = passages_in_language(passages, language, [outcome["pilot"]["name"]])
    words = words_of_page(language)
    label = words["quoted"].format(text=words["plan"]["augment"])
    shown: list[Passage] = []
    for passage in translated:
        if isinstance(passage, str):
            # What is an option of the command is a box to tick on the page.
            passage = passage.replace("--augment", label)
        shown.append(passage)
    return tuple(shown)
