"""Sentences on a campaign and its tests, before anything is fitted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ldbb_bayes.campaign.circle_preview import TestPreview
from ldbb_bayes.campaign.preview import CampaignPreview
from ldbb_bayes.campaign.remarks import Remark
from ldbb_bayes.model.terms import Term
from ldbb_bayes.model.terms.base import Uncertainty
from ldbb_bayes.report.wording.effect_names import first_names, nuisance_words
from ldbb_bayes.report.wording.fixed_texts import SENTENCES
from ldbb_bayes.report.wording.sentence_file import SentenceFile
from ldbb_bayes.report.wording.worded_records import with_words

__all__ = [
    "assumed_words",
    "assumption_words",
    "peculiarity_sentences",
    "preview_sentences",
    "remark_words",
    "travel_words",
]

_TEMPLATES = SentenceFile("campaign")


def preview_sentences(preview: CampaignPreview) -> tuple[str, ...]:
    """Return sentences that describe a campaign, with remarks on the campaign and on its tests."""
    return _TEMPLATES.sentences("preview_sentences", preview)


def travel_words(test: TestPreview) -> str:
    """Return the direction of travel of a test, or a dash if it is not known.

    A direction in parentheses is not given for the test; it follows from the order of the test's
    angles.
    """
    if test.direction:
        return test.direction
    if test.travel:
        return f"({test.travel})"
    return "–"


def assumption_words(assumption: Any) -> str:
    """Return a description of an assumption that the program made when readings were imported.

    The description states the assumption, its reason, and the command-line option that would change
    it.
    """
    reason = assumption.because
    if assumption.place:
        reason = f"{reason}; {assumption.place}"
    return f"{assumption.what}: {assumption.value} ({reason}): {assumption.option}"


def assumed_words(uncertainty: Uncertainty) -> tuple[str, str]:
    """Return the name of an instrument error, and the place where the user can state its value.

    The place is the entry of campaign.toml in which the user can write the value from a
    certificate, such as "[mount] U_percent". If there is no such entry, the string begins with
    "none" and names the model term that describes the error.
    """
    table, _, key = uncertainty.certificate.partition("_")
    if key:
        place = f"[{table}] {key}"
    elif table:
        place = f"[balls.{table}]"
    else:
        place = f"none: [terms.{Term.owner(uncertainty.name).__name__}] of a model"
    words = nuisance_words(uncertainty.name.replace("form_", "form_cos"))
    return words.partition(" (")[0], place


@_TEMPLATES.filter
def remark_words(remark: Remark) -> str:
    """Return the text of a remark on a campaign or on one of its tests."""
    if remark.kind in SENTENCES["remarks"]:
        return str(SENTENCES["remarks"][remark.kind].format(**remark.values))
    return _TEMPLATES.fill(SENTENCES["choices"][remark.kind], remark.values)


@_TEMPLATES.filter
def peculiarity_sentences(preview: CampaignPreview) -> list[str]:
    """Return one sentence on each peculiarity of a campaign's readings.

    Each sentence names the tests that have the peculiarity.
    """
    tests_by_words: dict[str, list[str]] = {}
    for test in preview.tests:
        for remark in test.remarks:
            tests_by_words.setdefault(remark_words(remark), []).append(test.name)
    return [f"Look at {first_names(tests)}: {words}." for words, tests in tests_by_words.items()]


@with_words.register
def _record_of_campaign_preview(result: CampaignPreview) -> dict[str, Any]:
    """Return the JSON record of the preview of a campaign, with its remarks as sentences."""
    record = {"schema": 1, **result.as_dict()}
    _add_remarks(record, result.remarks)
    for test_record, test in zip(record["tests"], result.tests, strict=True):
        _add_remarks(test_record, test.remarks)
    record["assumptions"] = [remark_words(remark) for remark in result.assumptions]
    return record


def _add_remarks(record: dict[str, Any], remarks: Sequence[Remark]) -> None:
    """Add the kinds and the texts of remarks to the JSON record of a campaign or of a test."""
    record["kinds"] = [str(remark.kind) for remark in remarks]
    record["remarks"] = [remark_words(remark) for remark in remarks]
