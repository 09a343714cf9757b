"""Sheets for the operator that commands write beside a plan."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import ldbb_bayes as lb

if TYPE_CHECKING:
    from ldbb_bayes.analysis.design import NextCircle

__all__ = ["SHEET", "language_in", "sheet_of_circle", "sheet_of_plan"]

# Name of the file with the sheet that tells the operator which circles to run.
SHEET = "sheet.html"

# The modules that write sheets take a long time to load, and only --out needs them. They are
# therefore imported in the functions below, and not at the top of the file.


def language_in(settings: dict[str, Any]) -> str:
    """Remove the option ``language`` from the settings of a command, and return its value.

    Raise an `InputError` if there are no sheets in this language.
    """
    from ldbb_bayes.report.translation import check_language

    language = str(settings.pop("language"))
    check_language(language)
    return language


def sheet_of_circle(step: NextCircle, plan: lb.Campaign, language: str) -> str:
    """Return the sheet of the next circle as an HTML page.

    ``plan`` is the next circle as a plan, and ``language`` the code of the sheet's language.
    """
    from ldbb_bayes.report import operator_sheet

    return operator_sheet.page(step, plan, language)


def sheet_of_plan(plan: lb.Campaign, language: str) -> str:
    """Return the sheet of all circles of a plan as an HTML page, in the language of this code."""
    from ldbb_bayes.report import operator_sheet

    return operator_sheet.page_of_plan(plan, language)
