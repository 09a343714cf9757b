"""Functions of ``ldbb-bayes report`` that make a report from files of readings or of fits."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

import ldbb_bayes as lb
from ldbb_bayes.analysis.tolerances import quantities_of, tolerances_in
from ldbb_bayes.cli.campaign_notes import notes_on_campaign
from ldbb_bayes.cli.file_reports import (
    AVERAGED_NAME,
    STEPS,
    WrittenReport,
    page_settings,
    report_files,
)
from ldbb_bayes.cli.options import EXIT_MISSED
from ldbb_bayes.cli.output import Output, figure_files, show, show_written
from ldbb_bayes.cli.progress import counting_progress, step_progress
from ldbb_bayes.cli.questions import can_ask
from ldbb_bayes.cli.sources import ReportSource
from ldbb_bayes.errors import InputError, check_probability, require
from ldbb_bayes.files import check_target, staged_folder
from ldbb_bayes.inference.posterior import bound_of, campaign_of, record_of
from ldbb_bayes.report.page import BESIDE, REPORT_FILES, Document, check_report_target
from ldbb_bayes.report.pictures import PICTURES
from ldbb_bayes.report.terminal_translation import printed_in_language
from ldbb_bayes.report.translation import check_language, words_of
from ldbb_bayes.results import Passage, Table

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["make_report", "report_figure_files"]

# File formats in which the figures of a report are written into a separate folder.
_FIGURE_FORMATS = ("svg", "png", "pdf")


def make_report(
    source: ReportSource,
    output: Output,
    settings: dict[str, Any],
    model: lb.HybridModel,
    figures: Path | None,
    *,
    may_ask: bool,
) -> None:
    """Write a report, and print its results in words or as JSON.

    Parameters
    ----------
    source
        Files of readings, a campaign, or fits.
    output
        Output of the command.
    settings
        Options of the report; the keys are the names of the options.
    model
        Model with compliance linear in force.
    figures
        Folder for the figures of the page; if None, no figures are written.
    may_ask
        Whether to ask the user, if there is a terminal, for facts that neither files nor options
        state.

    Raises
    ------
    InputError
        If files or options cannot be used; nothing is written.
    typer.Exit
        With exit code 1, if the random draws of a fit did not reach the required effective sample
        size.
    """
    check_probability(settings["prob"])
    check_language(settings["language"])
    require(
        model.degree == 1,
        "report must weigh constant and linear compliance, --degree 1, got"
        f" {model.degree}. Give --degree 1; or fit it, and report the fit.",
    )
    if figures is not None:
        check_target(figures, force=output.force, ours=report_figure_files())
    if source.is_result:
        written = _report_fits(source, output, settings)
    else:
        steps = step_progress(output.quiet, **STEPS)
        ask = may_ask and can_ask()
        written = report_files(source, output, settings, model, steps, ask=ask)
    if figures is not None:
        with staged_folder(figures, force=output.force, ours=report_figure_files()) as staging:
            for picture in written.document.pictures:
                lb.figures.save_figure(
                    picture.figure, staging, picture.key, formats=_FIGURE_FORMATS
                )
    _print_report(output, written, figures, settings["language"])
    if not written.converged:
        raise typer.Exit(EXIT_MISSED)


def report_figure_files() -> tuple[str, ...]:
    """Return the names of a report's figure files, which a new report may replace."""
    return figure_files(PICTURES, _FIGURE_FORMATS)


def _print_report(
    output: Output, written: WrittenReport, figures: Path | None, language: str
) -> None:
    """Print a report that was written into a folder, in the language of its sheets.

    With the option ``--json``, the content of the file report.json is printed. Without this option,
    the results are printed in words, with the sentence of the first sheet on whether they can be
    used, followed by the paths of the files. ``figures`` is the folder of the figures, or None if
    no figures were written.
    """
    folder = output.out or Path()
    if output.as_json:
        typer.echo((folder / "report.json").read_text(encoding="utf-8"), nl=False)
        return
    words = words_of(language)
    alerts = [words("terminal.note", text=alert) for alert in written.document.alerts]
    state = written.document.state_and_cure
    if written.compared_campaign:
        show(f"{written.compared_campaign}: {state}", *alerts, *written.parts)
    else:
        show(*written.parts, *alerts, state)
    if output.quiet:
        return
    files = ", ".join(f"{folder}/{name}" for name in REPORT_FILES)
    line = words("terminal.written", files=files)
    if figures is not None:
        line += words("terminal.figures", folder=str(figures))
    show_written(line)


# ---- report made from stored fits


def _report_fits(source: ReportSource, output: Output, settings: dict[str, Any]) -> WrittenReport:
    """Write a report from stored fits, and return it.

    The report is written into the folder that the user chose; by default, this is the folder of the
    first fit. ``settings`` are the options of the report; the keys are the names of the options.
    """
    source.refuse_table_options()
    paths = source.paths
    fit_folder = paths[0] if paths[0].is_dir() else paths[0].parent
    folder = output.out or fit_folder
    output.out = folder
    _check_report_folder(folder, force=output.force)
    comparison_file = settings.get("comparison", _stored_result(fit_folder, "comparison"))
    design_file = _design_file(fit_folder, settings)
    for name in ("same_instrument", "same_machine"):
        require(
            not settings[name] or len(paths) > 1,
            f"--{name.replace('_', '-')} must go with a second fit, got one alone. Name the fit to"
            " set beside it.",
        )

    posteriors = [lb.load(path) for path in paths]
    first = posteriors[0]
    tolerances = {**campaign_of(first).tolerances, **settings.get("tolerances", {})}
    tolerances_in(quantities_of(bound_of(first)), tolerances)
    comparison = None
    if comparison_file is not None:
        comparison = lb.analysis.read_comparison(comparison_file)
    design = None
    if design_file is not None:
        design = lb.analysis.read_design(design_file)
    averaged = None
    if (fit_folder / AVERAGED_NAME).exists():
        averaged = lb.load(fit_folder / AVERAGED_NAME)
    with counting_progress(output.quiet, "sections") as progress:
        document = lb.write_report(
            first,
            folder,
            beside_it=_posteriors_by_name(posteriors, paths),
            tests=settings.get("tests"),
            same_instrument=settings["same_instrument"],
            same_machine=settings["same_machine"],
            **page_settings(settings),
            tolerances=tolerances,
            comparison=comparison,
            recommended=design,
            averaged=averaged,
            progress=progress,
        )
    notes: list[Passage] = []
    for name, posterior in _posteriors_by_name(posteriors, paths).items():
        campaign = campaign_of(posterior)
        names = [name, *(test.name for test in campaign.tests)]
        in_english = notes_on_campaign(campaign, name=name)
        notes += printed_in_language(in_english, settings["language"], names)
    return WrittenReport(
        document,
        (*notes, *_printed_differences(document)),
        record_of(first)["sampler"]["converged"],
        compared_campaign=str(campaign_of(first).name) if len(paths) > 1 else "",
    )


def _printed_differences(document: Document) -> tuple[Any, ...]:
    """Return the sentences and tables on differences between campaigns, for the terminal.

    They are those of the page, without the parts that are hidden until the reader opens them. The
    result is empty if the report is of one campaign.
    """
    parts: list[Any] = []
    for section in document.sections:
        if section.key == BESIDE:
            for part in section.content:
                if isinstance(part, str | Table):
                    parts.append(part)
                elif isinstance(part, tuple):
                    parts += part
    return tuple(parts)


def _check_report_folder(folder: Path, *, force: bool) -> None:
    """Raise an `InputError` if a report must not or cannot be written into a folder.

    If the folder already holds a report, this report may be replaced only if ``force`` is true. A
    report cannot be written if the path is not a folder, or if its subfolder ``tables`` holds files
    that do not belong to a report.
    """
    for name in REPORT_FILES:
        if (folder / name).exists() and not force:
            raise InputError(
                f"{folder / name} must not exist, got an earlier report. Choose another --out or"
                " pass --force."
            )
    check_report_target(folder)


def _stored_result(folder: Path, name: str) -> Path | None:
    """Return the folder of a fit if it holds the file ``<name>.json``; if not, return None.

    ``name`` is the name of a result, such as "comparison".
    """
    return folder if (folder / f"{name}.json").exists() else None


def _design_file(fit_folder: Path, settings: dict[str, Any]) -> Path | None:
    """Return the path of the stored design (choice of the next tests) that a report shows.

    The user can give this path with the option ``--design``. Without this option, it is
    ``fit_folder``, the folder of a fit, if a design is stored there. Return None if no design is
    stored, or if the user gives the number of tests, because a new design must then be computed.
    ``settings`` holds the options.
    """
    if "tests" not in settings:
        return settings.get("design", _stored_result(fit_folder, "design"))
    if "design" in settings:
        raise InputError("--tests must not go with --design, got both. The design says how many.")
    return None


def _posteriors_by_name(
    posteriors: Sequence[xr.DataTree], paths: Sequence[Path]
) -> dict[str, xr.DataTree]:
    """Return the posteriors that a report compares with the first of ``posteriors``.

    These are all posteriors except the first; the keys are the names of their campaigns. If any two
    campaigns have the same name, the path of the fit is added to every name. ``paths`` are the
    paths of the fits, in the order of the posteriors.
    """
    names = [str(record_of(posterior)["campaign"]["name"]) for posterior in posteriors]
    ambiguous = len(set(names)) < len(names)
    by_name = {}
    for name, posterior, path in zip(names[1:], posteriors[1:], paths[1:], strict=True):
        by_name[f"{name} ({path})" if ambiguous else name] = posterior
    return by_name
