"""Command ``ldbb-bayes report``: makes the page of a report from files of readings or fits."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from ldbb_bayes.cli import arguments
from ldbb_bayes.cli.options import command, group, option, options_of
from ldbb_bayes.reading.file_patterns import matching

__all__ = ["REPORT_OPTIONS", "report"]

REPORT_OPTIONS = group(**options_of("report"))
_FILES = typer.Argument(
    help=(
        "Tables as they are found (workbook, CSV, text; * and ? are expanded), a campaign, or the"
        " --out folder of a fit; more fits are set beside the first."
    ),
    metavar="FILE...",
)


@command
def report(
    files: Annotated[list[Path], _FILES],
    output: arguments.ReportOutput,
    settings: Annotated[dict[str, Any], REPORT_OPTIONS],
    figures: Annotated[
        Path | None,
        option(Path, "Folder for the figures of the page, as SVG, PNG and PDF.", metavar="DIR"),
    ],
    yes: Annotated[
        bool,
        option(
            bool,
            "Ask nothing: machine, mount and balls that nothing states are assumed, and said;"
            " tables that leave something else open are refused, with the option that says it.",
            False,
        ),
    ],
    model: arguments.ChosenModel,
    layout: arguments.ChosenLayout,
    table: arguments.TableFields,
    certificates: arguments.Certificates,
) -> None:
    """Make a page, and a PDF for signing, from files of readings or from fits.

    The command reads, checks and fits the files, compares models, and chooses the next tests. If it
    runs at a terminal, it asks for information that the files do not give, and asks at most three
    questions about the machine, the mount and the balls. It writes the page, the PDF, a JSON file,
    the digital calibration certificate (DCC), the tables, the campaign and the fit into the folder
    FILE_report beside the first file. It writes the report of a fit into the folder of the fit.

    The exit code is 1 if the random draws of a fit did not reach the required effective sample
    size. The page then says so at its top.
    """
    # The module that makes reports is imported here, and not at the top of the file, because it
    # loads Matplotlib and fpdf2, which takes a long time.
    from ldbb_bayes.cli.report_making import make_report
    from ldbb_bayes.cli.sources import ReportSource

    source = ReportSource(files, matching(files), layout, table, certificates)
    make_report(source, output, settings, model, figures, may_ask=not yes)
