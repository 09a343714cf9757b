"""What several commands say of the campaign that they read, beside their results."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import ldbb_bayes as lb
from ldbb_bayes.campaign.remarks import RemarkKind
from ldbb_bayes.report import wording
from ldbb_bayes.results import Passage

if TYPE_CHECKING:
    from ldbb_bayes.cli.sources import SourceCampaign

__all__ = ["assumptions_of", "notes_on_campaign", "notes_on_readings", "with_notes"]

# Kinds of the remarks that also concern commands whose results do not contain remarks.
_NOTED = (RemarkKind.UNIT, RemarkKind.COPY, RemarkKind.MIRRORED, RemarkKind.NOT_RUN)


def assumptions_of(source: SourceCampaign) -> tuple[Passage, ...]:
    """Return sentences on what was assumed when the campaign's tables were imported.

    Parameters
    ----------
    source
        The campaign and the record of its import.

    Returns
    -------
    tuple
        Tables and sentences; empty if nothing was imported.
    """
    if source.imported is None:
        return ()
    # The module for the input of commands is imported here, and not at the top of the file, because
    # it takes a long time to load.
    from ldbb_bayes.cli.sources import assumed_parts

    return assumed_parts(source.campaign, source.imported)


def notes_on_campaign(
    campaign: lb.Campaign, kinds: tuple[RemarkKind, ...] = _NOTED, name: str = ""
) -> tuple[Passage, ...]:
    """Return notes on what looks odd in a campaign as a whole.

    Parameters
    ----------
    campaign
        The campaign.
    kinds
        Kinds of the remarks to return. Default: numbers in a wrong unit, two tests with the same
        readings, a test whose readings have the other sign, and planned tests that have not been
        run.
    name
        Name of the campaign, with which each note begins if a result is about several campaigns.

    Returns
    -------
    tuple of str
    """
    notes = []
    beginning = f"Note: {name}: " if name else "Note: "
    for remark in lb.check_campaign(campaign).remarks:
        if remark.kind in kinds:
            words = wording.remark_words(remark)
            end = "" if words.endswith((".", "?")) else "."
            notes.append(f"{beginning}{words}{end}")
    return tuple(notes)


def notes_on_readings(campaign: lb.Campaign) -> tuple[Passage, ...]:
    """Return notes on readings that were probably imported wrongly.

    Such readings seem to be in another unit, or are the same in two tests.

    Parameters
    ----------
    campaign
        The campaign that was imported.

    Returns
    -------
    tuple of str
    """
    preview = lb.check_campaign(campaign)
    tests = []
    for test in preview.tests:
        remarks = tuple(remark for remark in test.remarks if remark.kind is RemarkKind.UNIT)
        tests.append(replace(test, remarks=remarks))
    of_tests = wording.peculiarity_sentences(replace(preview, tests=tuple(tests)))
    kinds = (RemarkKind.UNIT, RemarkKind.COPY, RemarkKind.MIRRORED)
    of_campaign = notes_on_campaign(campaign, kinds)
    return (*(f"Note: {sentence}" for sentence in of_tests), *of_campaign)


def with_notes(passages: tuple[Passage, ...], campaign: lb.Campaign) -> tuple[Passage, ...]:
    """Return tables and sentences about a result, followed by notes on the readings.

    The notes state what looks odd in the campaign, for example readings that seem to be in the
    wrong unit, or two tests with the same readings.

    Parameters
    ----------
    passages
        Tables and sentences about a result of the campaign.
    campaign
        The campaign.

    Returns
    -------
    tuple
        Tables and sentences.
    """
    preview = lb.check_campaign(campaign)
    return (*passages, *wording.peculiarity_sentences(preview), *notes_on_campaign(campaign))
