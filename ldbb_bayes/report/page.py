"""The report: sheets and sections on one HTML page, and files with its numbers beside the page."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr
from markupsafe import Markup

from ldbb_bayes.analysis.differences import compare_posteriors
from ldbb_bayes.analysis.tolerances import check_force
from ldbb_bayes.deprecation import renamed_keyword
from ldbb_bayes.errors import require
from ldbb_bayes.files import check_target, staged_folder, write_whole
from ldbb_bayes.inference.posterior import campaign_of, fit_of, record_of
from ldbb_bayes.inference.summary import result_json
from ldbb_bayes.report import wording
from ldbb_bayes.report.annex_translation import annex_translation
from ldbb_bayes.report.blocks import Banner, Block, Pair, PictureRow, ReportSheet
from ldbb_bayes.report.dcc_export import write_dcc
from ldbb_bayes.report.findings import Beside, Compared, Findings, Recommended, find
from ldbb_bayes.report.html_templates import template_of
from ldbb_bayes.report.number_tables import TABLE_FILES, tables
from ldbb_bayes.report.pdf import pdf_of
from ldbb_bayes.report.pictures import Picture
from ldbb_bayes.report.sections import SECTIONS, Section, beside
from ldbb_bayes.report.sheets import sheets
from ldbb_bayes.report.translation import words_of
from ldbb_bayes.results import Shown, json_text

__all__ = [
    "REPORT_FILES",
    "Document",
    "check_report_target",
    "compose",
    "html_page",
    "write_report",
]

REPORT_FILES = ("report.html", "report.pdf", "report.json", "dcc.xml", "tables")


@dataclass(frozen=True)
class Document(Shown):
    """A complete report on the fit of a campaign: the certificate's sheets and further sections.

    Parameters
    ----------
    title
        Title of the page.
    lines
        Lines under the title: machine, tests and fit that the report is about.
    alerts
        Warnings that a reader must see before any number.
    sections
        Sections of the annex in the order of the page; none if the annex is left out.
    sheets
        Sheets of the certificate, to be signed.
    annex
        Whether the sections are printed in addition to the sheets when the page is printed.
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
        for sheet in self.sheets:
            yield from sheet.blocks

    @property
    def state(self) -> str:
        """Sentence of the certificate that states whether its numbers can be used."""
        banners = [block for block in self._blocks() if isinstance(block, Banner)]
        return banners[0].sentence

    @property
    def pictures(self) -> Iterator[Picture]:
        """All figures of the report, in their order on the page."""
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
    others: Sequence[Beside] = (),
    *,
    same_instrument: bool = False,
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
        Other campaigns to compare with the first one.
    same_instrument, language, annex, force_N, progress
        The same arguments as those of `write_report`, where they are explained.

    Returns
    -------
    Document
    """
    writers = SECTIONS
    if findings.sheets_only:
        writers = {}
    steps = len(writers) + 1
    tell = progress or _ignore
    tell(0, steps)
    finished_sheets = sheets(findings, language=language, force_N=force_N)
    sections: list[Section] = []
    for key, (title, write) in writers.items():
        tell(len(sections) + 1, steps)
        sections.append(Section(key, title, tuple(write(findings))))
    tell(steps, steps)

    name = str(findings.result["campaign"]["name"])
    title = f"Loaded double ball bar: {name}"
    if others:
        side_by_side = beside(
            findings.result, others, same_instrument=same_instrument, prob=findings.prob
        )
        sections.insert(0, Section("beside", "Campaigns side by side", tuple(side_by_side)))
        title += f", beside {wording.joined([other.name for other in others])}"
    document = Document(
        title,
        _lines(findings),
        tuple(_alerts(findings, others)),
        tuple(sections),
        finished_sheets,
        annex,
        language,
    )
    names = [name, *(other.name for other in others)]
    names += [test.name for test in findings.seen.tests]
    return _in_language(document, frozenset(names))


def _in_language(document: Document, names: frozenset[str]) -> Document:
    """Return a document whose annex is in the language of the sheets.

    ``names`` are those of campaigns and tests, which are not translated.
    """
    translation = annex_translation(words_of(document.language), names)
    if translation is None:
        return document
    return replace(
        document,
        title=translation.text(document.title),
        lines=tuple(translation.text(line) for line in document.lines),
        alerts=tuple(translation.text(alert) for alert in document.alerts),
        sections=tuple(translation.section(section) for section in document.sections),
    )


def _ignore(done: int, total: int) -> None:
    """Do nothing; used in place of a function that shows progress.

    ``done`` and ``total`` are the numbers of finished and of all steps.
    """


def _lines(findings: Findings) -> tuple[str, str, str]:
    """Return the three lines of text below the report's title.

    They state the machine and its tests, the day of the fit and the version of this package, and
    the model that gave the numbers in the annex (the sections that follow the sheets).
    """
    result = findings.result
    seen = findings.seen
    forces_N = [test.force_N for test in seen.tests]
    version = result["provenance"]["versions"]["ldbb-bayes"]
    campaign = (
        f"Machine {seen.topology}, plane {seen.plane}. {len(seen.tests)} circular tests at"
        f" {min(forces_N):g} to {max(forces_N):g} N."
    )
    fitted = f"Fitted {result['provenance']['started'][:10]} with ldbb_bayes {version}."
    annex = wording.annex_words(result["model"]["degree"], bool(findings.probabilities))
    return campaign, fitted, annex


def _alerts(findings: Findings, others: Sequence[Beside]) -> Iterator[str]:
    """Yield the warnings that a reader of the report must see before any number.

    The warnings are about the fit of the campaign, and about its differences from ``others``.
    """
    yield from wording.alert_sentences(fit_of(findings.posterior), findings.result)
    name = str(findings.result["campaign"]["name"])
    for other in others:
        converged = other.result["sampler"]["converged"]
        conflict = other.differences.attrs.get("conflict")
        yield from wording.difference_doubts(name, other.name, converged, conflict)


def html_page(document: Document) -> str:
    """Return the report as an HTML page.

    The page has no scripts and loads no other files; a security policy in the page enforces this.
    Figures are inline SVG. All text is escaped.

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
    """Refuse a folder that a report cannot be written to, before any work is done.

    Parameters
    ----------
    folder
        Folder for the report.

    Raises
    ------
    InputError
        The path is not a folder, or its subfolder ``tables`` holds files that no report has
        written.
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

    The report consists of report.html, report.pdf (the two sheets of the certificate), dcc.xml (the
    numbers of the sheets), report.json, and the folder ``tables`` of CSV files.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample` or `load`.
    folder : path
        Folder for the report; it is made if missing, and other files in it are kept.
    beside_it : mapping of name to DataTree, optional
        Posteriors of other campaigns to compare with this one.
    same_instrument : bool
        Whether the other campaigns used the same bar, balls, mount and force device.
    prob : float
        Probability of the credible intervals.
    tests : int, optional
        Number of circles to recommend. Default: as many as the campaign has.
    comparison : Comparison, optional
        Result of `compare` for the same readings. Default: the evidences of constant and linear
        compliance are computed.
    recommended : Design, or callable that returns one, optional
        Result of `design` or `read_design` for the same readings. Default: a design with as many
        circles as ``tests``, at the forces tested.
    averaged : DataTree, optional
        Result of `average`, whose numbers the sheets state. Default: the sheets state the numbers
        of ``posterior`` and say so.
    tolerances : mapping of quantity to Tolerance, optional
        Tolerances for which the sheets state conformity. Default: those of the campaign.
    language : str
        Language of the sheets and of the annex: en or de.
    annex : bool
        Whether the annex, the sections that follow the sheets, is printed too when the page is
        printed.
    sheets_only : bool
        Whether the annex is left out. Nothing is computed then that only the annex shows: by
        default models are not compared and no tests are recommended, and of the tables only those
        of the parameters and of the sheets are written.
    force_N : float, optional
        Force at which the sheets state stiffness and circular deviation [N], from a tenth of the
        smallest force tested to 1.5 times the largest. Default: the model's reference force.
    progress : callable, optional
        Function called with the numbers of finished and of all steps. One step is a section, or
        both sheets.

    Returns
    -------
    Document
        The report as written; its pictures hold the figures.

    Raises
    ------
    InputError
        The comparison or design was made from other readings, the campaigns are of different
        machines, ``language`` is unknown, ``force_N`` is outside its range, the folder cannot be
        written, its subfolder ``tables`` holds files that no report has written, or
        ``sheets_only`` is given together with ``annex`` or ``beside_it``.

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
        difference = compare_posteriors(
            posterior, other, same_instrument=same_instrument, prob=prob
        )
        others.append(Beside(name, result_json(other, prob=prob), difference))
    findings = find(
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
        same_instrument=same_instrument,
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
        **_record(findings, document, frames),
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
    write_dcc(findings.numbers, folder / "dcc.xml", prob=prob)
    return document


def _check_no_annex_wanted(beside_it: Mapping[str, Any] | None, *, annex: bool) -> None:
    """Refuse arguments that only change the annex, for a report without it."""
    require(
        not annex,
        "annex (--annex) must not go with sheets_only (--sheets-only), got both. The annex is"
        " printed, or it is left out.",
    )
    require(
        not beside_it,
        f"sheets_only (--sheets-only) must go with one fit, got {len(beside_it or {})} beside it,"
        " which only the annex compares. Leave it out.",
    )


def _record(
    findings: Findings, document: Document, frames: Mapping[str, pd.DataFrame]
) -> dict[str, Any]:
    """Return the content of report.json, except the state and the decisions on conformity.

    It holds the campaign, the model, the alerts, the provenance, all tables, the comparison and the
    design. ``frames`` are the tables by name. A comparison or design that is missing is replaced by
    the reason.
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
    """Return the JSON record of an analysis, or a record of the reason why it is missing.

    ``result`` is the result of the analysis, or a text with the reason.
    """
    if isinstance(result, str):
        return {"missing": result}
    return wording.with_words(result)
