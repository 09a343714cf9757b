"""The sheets of a report that compare its campaign with further campaigns, one sheet for each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ldbb_bayes.analysis.common_effects import Shared
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.inference.posterior import campaign_of
from ldbb_bayes.report import wording
from ldbb_bayes.report.annex_translation import annex_translation, section_in_language
from ldbb_bayes.report.blocks import Banner, Block, Fields, Items, ReportSheet
from ldbb_bayes.report.findings import Findings, FurtherCampaign
from ldbb_bayes.report.sections import Section, beside
from ldbb_bayes.report.sheet_fields import shorten
from ldbb_bayes.report.sheets import sheet_line, signatures
from ldbb_bayes.report.translation import Words
from ldbb_bayes.results import Table

__all__ = ["difference_sheets"]


def difference_sheets(
    findings: Findings, others: Sequence[FurtherCampaign], shared: Shared, words: Words
) -> Iterator[ReportSheet]:
    """Yield a sheet on the differences between the campaign of a report and each further campaign.

    Parameters
    ----------
    findings
        All results of the fit that the report shows.
    others
        The further campaigns.
    shared
        What the further campaigns have in common with the campaign of the fit.
    words
        Texts of the test certificate, in its language.

    Yields
    ------
    ReportSheet
        Sheets of any length; see `fit_to_pages`.
    """
    first = campaign_of(findings.posterior)
    sheets = 2 + len(others)
    for number, other in enumerate(others, 3):
        yield ReportSheet(
            f"difference-sheet-{number}",
            words("sheet.difference"),
            sheet_line(words, number, sheets, f"{first.name}, {other.name}"),
            tuple(_blocks(findings, other, shared, words)),
        )


def _blocks(
    findings: Findings, other: FurtherCampaign, shared: Shared, words: Words
) -> Iterator[Block]:
    """Yield the content of the sheet that compares the report's campaign with another campaign.

    The content is: doubts about the comparison, the two campaigns, the parameters that have
    changed, a table of all differences, what is taken to be common, and the fields for signatures.
    """
    first = campaign_of(findings.posterior)
    names = frozenset([str(first.name), other.name])
    section = Section("", "", tuple(beside(findings.result, [other], shared, prob=findings.prob)))
    doubts = wording.difference_doubts(
        str(first.name),
        other.name,
        other.result["sampler"]["converged"],
        other.differences.attrs.get("conflict"),
    )
    translation = annex_translation(words, names)
    if translation is not None:
        section = section_in_language(section, translation)
        doubts = tuple(translation.text(doubt) for doubt in doubts)
    if doubts:
        yield Banner("unusable", " ".join(doubts))
    yield Fields(
        (
            (words("fields.first_campaign"), _campaign_text(str(first.name), first)),
            (words("fields.second_campaign"), _campaign_text(other.name, other.campaign)),
        )
    )
    assumptions = ""
    for part in section.content:
        if isinstance(part, str):
            assumptions = part
        elif isinstance(part, tuple):
            yield Items(words("sheet.plain"), part)
        elif isinstance(part, Table):
            yield part
    yield assumptions
    yield signatures(words)


def _campaign_text(name: str, campaign: Campaign) -> str:
    """Return a string that names a campaign, its machine and its date, as far as they are known."""
    pieces = [name]
    for entry in (campaign.machine_type, campaign.machine_id, campaign.date):
        if entry is not None and str(entry) != name:
            pieces.append(str(entry))
    return shorten(", ".join(pieces))
