"""Sentences on what was assumed when a campaign was imported from tables."""

from __future__ import annotations

from ldbb_bayes.reading.import_result import Imported
from ldbb_bayes.report import wording
from ldbb_bayes.results import Passage, parts_of
from ldbb_bayes.units import counted

__all__ = ["parts_of"]


@parts_of.register
def _passages_of_imported(result: Imported) -> tuple[Passage, ...]:
    """Return a heading for an imported campaign, and a list of the assumptions made at import.

    The text on each assumption names the command-line option with which the user can change the
    assumption.
    """
    campaign = result.campaign
    tests = counted(len(campaign.tests), "test")
    heading = (
        f"{campaign.name}: {tests}, {campaign.readings} readings. Assumed"
        " (change it with the option named):"
    )
    return (heading, tuple(map(wording.assumption_words, result.assumptions)))
