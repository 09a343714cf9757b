"""``ldbb-bayes report``: a fit → one page to read and sign."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ldbb_bayes.cli.options import CiOption, ForceOption, JsonOption, QuietOption, guarded
from ldbb_bayes.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["report"]

_FORMATS = ("svg", "png", "pdf")


@guarded
def report(
    result: Annotated[
        list[Path], typer.Argument(help="The --out folder of a fit; more of them are set beside the first.", metavar="RESULT...")
    ],
    out: Annotated[Path | None, typer.Option(help="Folder to write to. Default: RESULT.", metavar="DIR")] = None,
    force: ForceOption = False,
    comparison: Annotated[
        Path | None, typer.Option(help="The --out folder of an earlier compare of the same readings.", metavar="DIR")
    ] = None,
    design: Annotated[
        Path | None, typer.Option(help="The --out folder of an earlier design after the same readings.", metavar="DIR")
    ] = None,
    tests: Annotated[int | None, typer.Option(help="Circles to recommend. Default: as many as were run.", min=1, max=300)] = None,
    same_instrument: Annotated[
        bool, typer.Option("--same-instrument", help="Campaigns beside one another share bar, balls, mount and force device.")
    ] = False,
    figures: Annotated[
        Path | None,
        typer.Option(help="Folder for the figures of the page and the analyses' others, as SVG, PNG and PDF.", metavar="DIR"),
    ] = None,
    as_json: JsonOption = False,
    ci: CiOption = 0.95,
    quiet: QuietOption = False,
) -> None:
    """One self-contained page: results, what the data cannot tell, budgets, circular-test quantities, next tests.

    Writes report.html, report.md, report.json and tables (CSV) into RESULT, working out what the fit did not keep. Exit code 1
    when the fit had missed its target; the page then says so at its top.
    """
    from ldbb_bayes.analysis.recorded import read_comparison, read_design
    from ldbb_bayes.cli.show import counting_progress
    from ldbb_bayes.files import check_target, staged_folder
    from ldbb_bayes.fleet.executors import process_executor
    from ldbb_bayes.inference.origin import record_of
    from ldbb_bayes.inference.posterior import load
    from ldbb_bayes.inference.summary import check_probability
    from ldbb_bayes.report.figures import save_figure
    from ldbb_bayes.report.findings import compare_for_report
    from ldbb_bayes.report.result import sizes_of
    from ldbb_bayes.report.writing import REPORT_FILES, write_report
    from ldbb_bayes.units import units_for

    check_probability(ci)
    folder = out or (result[0] if result[0].is_dir() else result[0].parent)
    there = next((name for name in REPORT_FILES if (folder / name).exists()), None)
    if there is not None and not force:
        raise InputError(f"{folder / there} must not exist, got an earlier report. Choose another --out or pass --force.")
    if figures is not None:
        check_target(figures, force=force, ours=_figure_files())
    if design is not None and tests is not None:
        raise InputError("--tests must not go with --design, got both. The design says how many.")
    if same_instrument and len(result) == 1:
        raise InputError("--same-instrument must go with a second RESULT, got one alone. Name the campaign to set beside it.")
    # The comparison is the longest part and waits for nothing.
    beside = process_executor(1) if comparison is None else nullcontext()
    with beside as executor, counting_progress(quiet, "sections") as progress:
        running = None if executor is None else executor.submit(compare_for_report, result[0])
        first, *others = (load(path) for path in result)
        document = write_report(
            first,
            folder,
            beside_it=_named(first, others, result[1:]),
            same_instrument=same_instrument,
            ci_prob=ci,
            tests=tests,
            comparison=running if comparison is None else read_comparison(comparison),
            recommended=None if design is None else read_design(design),
            progress=progress,
        )
    if figures is not None:
        with staged_folder(figures, force=force, ours=_figure_files()) as staging:
            for picture in document.pictures:
                save_figure(picture.figure, staging, picture.key, formats=_FORMATS)
            with units_for(sizes_of(first)):
                for name, draw in document.further.items():
                    save_figure(draw(), staging, name, formats=_FORMATS)
    if as_json:
        typer.echo((folder / "report.json").read_text(encoding="utf-8"), nl=False)
    else:
        for alert in document.alerts:
            typer.echo(f"Note: {alert}")
        drawn = "" if figures is None else f"; figures: {figures}"
        typer.echo(f"Written: {', '.join(f'{folder}/{name}' for name in REPORT_FILES)}{drawn}")
    if not record_of(first)["sampler"]["converged"]:
        raise typer.Exit(1)


def _figure_files() -> tuple[str, ...]:
    """Figures that may be replaced: those of an earlier report."""
    from ldbb_bayes.report.figures import FIGURES

    known = {*FIGURES, "budget", "differences", "evidence", "compliance_with_local_fits", "geometry_with_local_fits"}
    known |= {"predictive_p_values", "expected_widths", "information", "efficiency", "nuisance_costs", "prior_and_posterior"}
    known |= {"alias", "correlation"}
    return tuple(f"{name}.{kind}" for name in sorted(known) for kind in _FORMATS)


def _named(first: xr.DataTree, posteriors: list[xr.DataTree], paths: list[Path]) -> dict[str, xr.DataTree]:
    """Keyed by the campaign's name; by the folder's where two have the same."""
    from ldbb_bayes.inference.origin import record_of

    names = [str(record_of(posterior)["campaign"]["name"]) for posterior in (first, *posteriors)]
    told = (
        names[1:] if len(set(names)) == len(names) else [f"{name} ({path})" for name, path in zip(names[1:], paths, strict=True)]
    )
    return dict(zip(told, posteriors, strict=True))
