"""The report of a fit: an HTML page, and further files with the numbers of the report.

The page has the two sheets of the certificate and the annex. The annex consists of the sections
that follow the sheets.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr
from markupsafe import Markup

from ldbb_bayes.analysis.common_effects import NOTHING_SHARED, Shared
from ldbb_bayes.analysis.differences import compare_posteriors, states_two_machines
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.tested_forces import check_force
from ldbb_bayes.deprecation import renamed_keyword
from ldbb_bayes.errors import require
from ldbb_bayes.files import check_target, staged_folder, write_whole
from ldbb_bayes.inference.posterior import campaign_of, fit_of, record_of
from ldbb_bayes.inference.summary import result_json
from ldbb_bayes.report import wording
from ldbb_bayes.report.annex_translation import annex_translation, section_in_language
from ldbb_bayes.report.blocks import Banner, Block, Pair, PictureRow, ReportSheet
from ldbb_bayes.report.dcc_export import write_dcc_of_findings
from ldbb_bayes.report.difference_sheet import difference_sheets
from ldbb_bayes.report.findings import (
    Compared,
    Findings,
    FurtherCampaign,
    Recommended,
    findings_of_fit,
)
from ldbb_bayes.report.html_templates import template_of
from ldbb_bayes.report.number_tables import TABLE_FILES, tables
from ldbb_bayes.report.pdf import fit_to_pages, pdf_of
from ldbb_bayes.report.pictures import Picture
from ldbb_bayes.report.sections import SECTIONS, Section, beside
from ldbb_bayes.report.sheets import sheets
from ldbb_bayes.report.translation import words_of
from ldbb_bayes.results import Shown, json_text
from ldbb_bayes.units import U_PROBABILITY

__all__ = [
    "BESIDE",
    "REPORT_FILES",
    "Document",
    "check_report_target",
    "compose",
    "html_page",
    "write_report",
]

# Key of the section on differences between campaigns.
BESIDE = "beside"
REPORT_FILES = ("report.html", "report.pdf", "report.json", "dcc.xml", "tables")


@dataclass(frozen=True)
class Document(Shown):
    """A complete report on the fit of a campaign: the test certificate and the annex.

    Parameters
    ----------
    title
        Title of the page.
    lines
        Lines of text below the title. They name the machine, the tests and the fit.
    alerts
        Warnings that are shown before all numbers.
    sections
        Sections of the annex in the order of the page. The tuple is empty if the report has no
        annex.
    sheets
        The two sheets of the test certificate, and one for each further campaign. They have fields
        for signatures.
    annex
        Whether a printout of the page contains the annex. It always contains the sheets.
    language
        Language of the sheets and of the annex.
    """

    title: str
    lines: tuple[str, ...]
    alerts: tuple[str, ...]
    sections: tuple[Section, ...]
    sheets: tuple[ReportSheet, ...] = ()
    annex: bool = False
    language: str = "en"
    shown = ("title", "lines", "alerts")

    def _blocks(self) -> Iterator[Block]:
        """Yield the content of all sheets of the test certificate: texts, tables and figures."""
        for sheet in self.sheets:
            yield from sheet.blocks

    @property
    def state(self) -> str:
        """Sentence on whether the results can be used, as the test certificate states it."""
        return self._banner.sentence

    @property
    def state_and_cure(self) -> str:
        """The sentence ``state``, and a second one on what to do if something can be done."""
        return f"{self._banner.sentence} {self._banner.cure}".rstrip()

    @property
    def _banner(self) -> Banner:
        """Banner of the first sheet of the test certificate."""
        banners = [block for block in self._blocks() if isinstance(block, Banner)]
        return banners[0]

    @property
    def pictures(self) -> Iterator[Picture]:
        """All figures of the report, in their order on the HTML page."""
        for block in self._blocks():
            if isinstance(block, Pair):
                yield block.picture
            elif isinstance(block, PictureRow):
                yield from block.pictures
            elif isinstance(block, Picture):
                yield block
        for section in self.sections:
            for item in section.content:
                if isinstance(item, Picture):
                    yield item


def compose(
    findings: Findings,
    others: Sequence[FurtherCampaign] = (),
    *,
    shared: Shared = NOTHING_SHARED,
    language: str = "en",
    annex: bool = False,
    force_N: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Document:
    """Return a complete report, with its sheets and sections, from the results of a fit.

    Parameters
    ----------
    findings
        All results of the fit that the report shows.
    others
        Other campaigns that the report compares with the campaign of the fit.
    shared
        What the other campaigns have in common with the campaign of the fit.
    language, annex, force_N, progress
        See the arguments of `write_report` with the same names.

    Returns
    -------
    Document
    """
    writers = SECTIONS
    if findings.sheets_only:
        writers = {}
    steps = len(writers) + 1
    show_progress = progress or _ignore_progress
    show_progress(0, steps)
    fitted_sheets = fit_to_pages(
        (
            *sheets(findings, language=language, force_N=force_N, further=len(others)),
            *difference_sheets(findings, others, shared, words_of(language)),
        )
    )
    sections: list[Section] = []
    for key, (title, write) in writers.items():
        show_progress(len(sections) + 1, steps)
        sections.append(Section(key, title, tuple(write(findings))))
    show_progress(steps, steps)

    name = str(findings.result["campaign"]["name"])
    title = f"Loaded double ball bar: {name}"
    if others:
        side_by_side = beside(findings.result, others, shared, prob=findings.prob)
        sections.insert(0, Section(BESIDE, "Campaigns side by side", tuple(side_by_side)))
        title += f", beside {wording.joined([other.name for other in others])}"
    document = Document(
        title,
        _lines_below_title(findings),
        tuple(_alerts(findings, others)),
        tuple(sections),
        fitted_sheets,
        annex,
        language,
    )
    names = [name, *(other.name for other in others)]
    names += [test.name for test in findings.preview.tests]
    return _in_language(document, frozenset(names))


def _in_language(document: Document, names: frozenset[str]) -> Document:
    """Return a report with all texts in the language of the certificate.

    The texts of the annex, which are the sections after the certificate, are translated. ``names``
    are the names of campaigns and tests, which are not translated.
    """
    translation = annex_translation(words_of(document.language), names)
    if translation is None:
        return document
    return replace(
        document,
        title=translation.text(document.title),
        lines=tuple(translation.text(line) for line in document.lines),
        alerts=tuple(translation.text(alert) for alert in document.alerts),
        sections=tuple(section_in_language(part, translation) for part in document.sections),
    )


def _ignore_progress(done: int, total: int) -> None:
    """Do nothing. This function is used if the user gives no function that shows the progress.

    ``done`` is the number of finished steps, and ``total`` the number of all steps.
    """


def _lines_below_title(findings: Findings) -> tuple[str, str, str]:
    """Return the three lines of text below the report's title.

    The first line states the machine and its tests. The second line states the day of the fit and
    the version of this package. The third line names the model whose results are shown in the
    annex, that is, in the sections after the certificate.
    """
    result = findings.result
    preview = findings.preview
    forces_N = [test.force_N for test in preview.tests]
    version = result["provenance"]["versions"]["ldbb-bayes"]
    campaign = (
        f"Machine {preview.topology}, plane {preview.plane}. {len(preview.tests)} circular tests at"
        f" {min(forces_N):g} to {max(forces_N):g} N."
    )
    fitted = f"Fitted {result['provenance']['started'][:10]} with ldbb_bayes {version}."
    annex = wording.annex_words(result["model"]["degree"], bool(findings.probabilities))
    return campaign, fitted, annex


def _alerts(findings: Findings, others: Sequence[FurtherCampaign]) -> Iterator[str]:
    """Yield the warnings that the report shows before all numbers.

    The warnings are about the fit of the campaign, and about differences between this campaign and
    the other campaigns (``others``).
    """
    yield from wording.alert_sentences(fit_of(findings.posterior), findings.result)
    name = str(findings.result["campaign"]["name"])
    for other in others:
        converged = other.result["sampler"]["converged"]
        attributes = other.differences.attrs
        yield from wording.unusable_fit_sentences(name, other.name, converged, attributes)
        yield from wording.difference_doubts(name, other.name, attributes)
        yield from wording.difference_reservations(attributes)


def html_page(document: Document) -> str:
    """Return the report as an HTML page.

    The page contains no scripts and loads no other files. Its content security policy makes the
    browser refuse scripts and other files. Figures are inline SVG. All text is escaped.

    Parameters
    ----------
    document
        The report.

    Returns
    -------
    str
    """
    style = Markup(template_of("report.css").render())
    page = words_of(document.language).table["page"]
    return template_of("report.html.j2").render(document=document, style=style, page=page)


def check_report_target(folder: Path) -> None:
    """Raise an error if a report cannot be written into a folder.

    `write_report` calls this function before it computes anything.

    Parameters
    ----------
    folder
        Folder for the report.

    Raises
    ------
    InputError
        The path is not a folder, or its subfolder ``tables`` holds files that do not belong to a
        report.
    """
    target = folder / "tables" if folder.is_dir() else folder
    check_target(target, force=True, ours=TABLE_FILES)


@renamed_keyword("ci_prob", "prob")
def write_report(
    posterior: xr.DataTree,
    folder: str | os.PathLike[str],
    *,
    beside_it: Mapping[str, xr.DataTree] | None = None,
    same_instrument: bool = False,
    same_machine: bool = False,
    prob: float = 0.95,
    tests: int | None = None,
    comparison: Compared | None = None,
    recommended: Recommended | Callable[[], Recommended] | None = None,
    averaged: xr.DataTree | None = None,
    tolerances: Mapping[str, Any] | None = None,
    language: str = "en",
    annex: bool = False,
    sheets_only: bool = False,
    force_N: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Document:
    """Write the report of a fit into a folder.

    The report consists of report.html, report.pdf (the sheets of the certificate), dcc.xml (the
    numbers of its two sheets), report.json, and the folder ``tables``, which holds CSV files.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample` or `load`.
    folder : path
        Folder for the report. The folder is made if it does not exist. An earlier report in it is
        replaced; files that do not belong to a report are kept.
    beside_it : mapping of name to DataTree, optional
        Posteriors of other campaigns that the report compares with this campaign.
    same_instrument : bool
        Whether the other campaigns used the same bar, balls, mount and force device.
    same_machine : bool
        Whether the other campaigns were run on the same machine; see `compare_posteriors`.
    prob : float
        Probability of the credible intervals in brackets. U (k = 2) is of 95 %, and so are figures
        that say no other.
    tests : int, optional
        Number of circles to recommend. Default: as many as the campaign has.
    comparison : Comparison, optional
        Result of `compare` for the same readings. Default: the function computes the evidences of
        models with constant and with linear compliance.
    recommended : Design, or callable that returns a Design, optional
        Result of `design` or `read_design` for the same readings. Default: the function computes a
        design with ``tests`` circles at the forces tested.
    averaged : DataTree, optional
        Result of `average`. If it is given, the sheets state the results averaged over models.
        Default: the sheets state the results of ``posterior``, and say that these are from one
        model.
    tolerances : mapping of quantity to Tolerance, optional
        Tolerances for which the sheets state conformity. Default: the tolerances of the campaign.
    language : str
        Language of the sheets and of the annex: en or de.
    annex : bool
        Whether a printout of report.html contains the annex, that is, the sections that follow the
        sheets.
    sheets_only : bool
        Whether the report has no annex. If true, the function does not compute what only the annex
        shows: it compares no models and recommends no tests, and it writes only the tables with the
        parameters and the numbers of the sheets.
    force_N : float, optional
        Force at which the sheets state stiffness and circular deviation [N]. It may lie between a
        tenth of the smallest force tested and 1.5 times the largest force tested. Default: the
        model's reference force.
    progress : callable, optional
        Function that is called at the start and after each step with two numbers: the number of
        finished steps and the number of all steps. Each section is one step, and all sheets
        together are one step.

    Returns
    -------
    Document
        The report that was written. Its attribute ``pictures`` holds the figures.

    Raises
    ------
    InputError
        The comparison or the design was made from readings other than those of ``posterior``; the
        campaigns are of different machines; ``language`` is unknown; ``force_N`` is outside its
        range; the folder cannot be written; the subfolder ``tables`` holds files that do not belong
        to a report; or ``sheets_only`` is given together with ``annex`` or ``beside_it``.

    Examples
    --------
    >>> lb.write_report(posterior, "report").state  # doctest: +SKIP
    'THE RESULTS CAN BE USED WITH THIS RESERVATION. Not determined by the readings: E_XX1, E_YX2, …'
    """
    folder = Path(folder)
    check_report_target(folder)
    check_force(campaign_of(posterior), force_N)
    words_of(language)
    if sheets_only:
        _check_no_annex_wanted(beside_it, annex=annex)
    others = []
    for name, other in (beside_it or {}).items():
        compare = partial(
            compare_posteriors,
            posterior,
            other,
            same_instrument=same_instrument,
            same_machine=same_machine,
        )
        differences_with_95 = None
        if prob != U_PROBABILITY:
            differences_with_95 = compare(prob=U_PROBABILITY)
        others.append(
            FurtherCampaign(
                name,
                campaign_of(other),
                result_json(other, prob=prob),
                compare(prob=prob),
                differences_with_95,
            )
        )
    findings = findings_of_fit(
        posterior,
        prob=prob,
        tests=tests,
        comparison=comparison,
        recommended=recommended,
        averaged=averaged,
        tolerances=tolerances,
        sheets_only=sheets_only,
    )
    document = compose(
        findings,
        others,
        shared=Shared(
            instrument=same_instrument,
            machine=same_machine,
            states_two_machines=_all_of_other_machines(campaign_of(posterior), others),
        ),
        language=language,
        annex=annex,
        force_N=force_N,
        progress=progress,
    )
    frames = tables(findings, others, force_N=force_N)
    decisions = findings.conformity(force_N)
    conformity = {name: decision.as_dict() for name, decision in decisions.items()}
    if conformity:
        frame = pd.DataFrame.from_dict(conformity, orient="index")
        frames["conformity"] = frame.rename_axis("quantity")
    record = {
        **_content_of_report_json(findings, document, frames),
        "state": document.state,
        "conformity": conformity,
    }
    started = datetime.fromisoformat(findings.result["provenance"]["started"])
    page = html_page(document)
    pdf = pdf_of(document.sheets, document.title, language, started)

    with staged_folder(folder / "tables", force=True, ours=TABLE_FILES) as staging:
        for name, frame in frames.items():
            frame.to_csv(staging / f"{name}.csv")
    write_whole(folder / "report.json", json_text(record).encode())
    write_whole(folder / "report.html", page.encode())
    write_whole(folder / "report.pdf", pdf)
    write_dcc_of_findings(findings, folder / "dcc.xml")
    return document


def _all_of_other_machines(campaign: Campaign, others: Sequence[FurtherCampaign]) -> bool:
    """Return whether all other campaigns state other machines than the first one, ``campaign``."""
    return all(states_two_machines(campaign, other.campaign) for other in others)


def _check_no_annex_wanted(beside_it: Mapping[str, Any] | None, *, annex: bool) -> None:
    """Raise an error if the user wants a report without annex, but also something in the annex.

    The annex is needed if it is to be printed (``annex`` is true), or if other campaigns
    (``beside_it``) are to be compared with the campaign of the report.
    """
    require(
        not annex,
        "annex (--annex) must not go with sheets_only (--sheets-only), got both. The annex is"
        " printed, or it is left out.",
    )
    require(
        not beside_it,
        f"sheets_only (--sheets-only) must go with one fit, got {len(beside_it or {})} beside it."
        " Leave it out: a comparison has an annex.",
    )


def _content_of_report_json(
    findings: Findings, document: Document, frames: Mapping[str, pd.DataFrame]
) -> dict[str, Any]:
    """Return the content of report.json without the entries ``state`` and ``conformity``.

    The content is a dictionary with the campaign, the model, the alerts, the provenance, all
    tables, the comparison of models and the design. ``frames`` is a mapping from the names of the
    tables to the tables. If there is no comparison or no design, the dictionary states the reason.
    """
    records = {
        name: frame.reset_index().to_dict(orient="records") for name, frame in frames.items()
    }
    return {
        "schema": 1,
        "campaign": findings.result["campaign"],
        "model": findings.result["model"],
        "alerts": list(document.alerts),
        "provenance": record_of(findings.posterior)["provenance"],
        "tables": records,
        "comparison": _analysis_record(findings.comparison),
        "design": _analysis_record(findings.design),
    }


def _analysis_record(result: Any) -> dict[str, Any]:
    """Return the JSON record of an analysis, or the reason why the analysis was not made.

    ``result`` is the result of the analysis, or a string with this reason.
    """
    if isinstance(result, str):
        return {"missing": result}
    return wording.with_words(result)
