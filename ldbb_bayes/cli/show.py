"""What a command prints: JSON on stdout, tables for reading, progress on stderr."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

    import xarray as xr
    from rich.console import Console

    from ldbb_bayes.analysis.compared import Comparison
    from ldbb_bayes.analysis.designed import Design
    from ldbb_bayes.analysis.identified import Identifiability
    from ldbb_bayes.analysis.validation import Validation
    from ldbb_bayes.campaign.campaign import Campaign
    from ldbb_bayes.inference.ensemble import Progress
    from ldbb_bayes.machine.chain import Circle, Machine

__all__ = [
    "RESULT_FILES",
    "counting_progress",
    "failing_progress",
    "print_comparison",
    "print_design",
    "print_fit",
    "print_json",
    "reading_console",
    "sampling_progress",
    "write_atlases",
    "write_comparison",
    "write_design",
    "write_identifiability",
    "write_result",
    "write_validation",
]


RESULT_FILES = ("posterior.nc", "summary.json", "model.toml", "report.html", "report.md", "report.json", "tables")


def print_json(result: Mapping[str, Any]) -> None:
    """One JSON document on stdout."""
    from ldbb_bayes.report.plain import json_text

    sys.stdout.write(json_text(result))


def reading_console() -> Console:
    """Where tables go: stdout, 120 columns when it is no terminal."""
    from rich.console import Console

    class Terminal(Console):
        """rich ends the program when a reader closes the pipe; that is for the command to answer."""

        def on_broken_pipe(self) -> None:
            raise BrokenPipeError

    return Terminal(width=None if sys.stdout.isatty() else 120, highlight=False)


def write_result(posterior: xr.DataTree, result: Mapping[str, Any], folder: Path) -> None:
    """posterior.nc, summary.json and model.toml of a fit, into a folder that is made."""
    from ldbb_bayes.inference.origin import record_of
    from ldbb_bayes.inference.posterior import save
    from ldbb_bayes.report.plain import json_text

    folder.mkdir(exist_ok=True)
    save(posterior, folder / "posterior.nc")
    (folder / "summary.json").write_text(json_text(result), encoding="utf-8")
    (folder / "model.toml").write_text(record_of(posterior)["model"]["toml"], encoding="utf-8")


def write_validation(validation: Validation, record: Mapping[str, Any], folder: Path) -> None:
    """The result, the ranks and their figure."""
    import pandas as pd

    from ldbb_bayes.report.figures import rank_ecdf, save_figure
    from ldbb_bayes.report.plain import json_text

    (folder / "validation.json").write_text(json_text(record), encoding="utf-8")
    pd.DataFrame(validation.ranks, columns=list(validation.names)).to_csv(folder / "ranks.csv", index_label="replicate")
    save_figure(rank_ecdf(validation), folder, "rank_ecdf")


def write_identifiability(result: Identifiability, record: Mapping[str, Any], campaign: Campaign, folder: Path) -> None:
    """The result, its tables and figures, and the atlases of the campaign's machine."""
    from ldbb_bayes.report.figures import (
        alias_map,
        correlation_map,
        nuisance_costs,
        prior_and_posterior,
        save_figure,
    )
    from ldbb_bayes.report.plain import json_text

    (folder / "identify.json").write_text(json_text(record), encoding="utf-8")
    result.table().to_csv(folder / "parameters.csv", index_label="parameter")
    result.alias.to_csv(folder / "alias.csv", index_label="parameter")
    result.correlation.to_csv(folder / "correlation.csv", index_label="coefficient")
    save_figure(correlation_map(result), folder, "correlation")
    save_figure(prior_and_posterior(result), folder, "prior_and_posterior")
    save_figure(alias_map(result), folder, "alias")
    save_figure(nuisance_costs(result), folder, "nuisance_costs")
    write_atlases(campaign.machine(), [test.circle for test in campaign.tests], folder)


def write_atlases(machine: Machine, circles: Sequence[Circle], folder: Path) -> None:
    """Patterns of compliances and geometric errors, for the first circle of every plane."""
    from ldbb_bayes.report.figures import compliance_atlas, geometric_atlas, save_figure

    first = {circle.plane: circle for circle in reversed(circles)}
    for plane in machine.planes:
        stem = f"_{plane}" if len(machine.planes) > 1 else ""
        save_figure(compliance_atlas(machine, first[plane]), folder, f"compliance_atlas{stem}")
        save_figure(geometric_atlas(machine, first[plane]), folder, f"geometric_atlas{stem}")


def write_comparison(result: Comparison, record: Mapping[str, Any], folder: Path) -> None:
    """The result, its tables and figures."""
    from ldbb_bayes.report.comparison import left_out_frame, sensitivity_frame, subsets_frame
    from ldbb_bayes.report.figures import (
        compliance_with_local_fits,
        evidence,
        geometry_with_local_fits,
        predictive_p_values,
        save_figure,
    )
    from ldbb_bayes.report.plain import json_text

    (folder / "comparison.json").write_text(json_text(record), encoding="utf-8")
    sensitivity_frame(result).to_csv(folder / "sensitivity.csv", index=False)
    subsets_frame(result).to_csv(folder / "slope_subsets.csv", index=False)
    left_out_frame(result).to_csv(folder / "tests.csv", index=False)
    result.local_fits.to_csv(folder / "local_fits.csv", index=False)
    save_figure(evidence(result), folder, "evidence")
    save_figure(compliance_with_local_fits(result), folder, "compliance_with_local_fits")
    save_figure(geometry_with_local_fits(result), folder, "geometry_with_local_fits")
    save_figure(predictive_p_values(result), folder, "predictive_p_values")


def print_comparison(result: Comparison) -> None:
    """The verdict, and the tables behind it."""
    from ldbb_bayes.report.comparison import assumption_table, left_out_table, models_table, slopes_table

    console = reading_console()
    for table in (models_table(result), assumption_table(result), slopes_table(result), left_out_table(result)):
        if table.row_count:
            console.print(table)
            console.print()
    for sentence in result.verdict:
        console.print(sentence, markup=False)


def print_design(design: Design) -> None:
    """The tests, what they will tell, and the recommendation in words."""
    from ldbb_bayes.report.design import expected_table, robustness_table, tests_table

    console = reading_console()
    for table in (tests_table(design), expected_table(design), robustness_table(design)):
        if table.row_count:
            console.print(table)
            console.print()
    for sentence in design.sentences():
        console.print(sentence, markup=False)


def write_design(design: Design, record: Mapping[str, Any], folder: Path, seed: int) -> None:
    """The plan, the record, tables and figures into a folder."""
    from ldbb_bayes.campaign.folder import write_campaign_into
    from ldbb_bayes.model.spec import model_to_toml
    from ldbb_bayes.report.figures import save_figure
    from ldbb_bayes.report.figures.design import efficiency, expected_widths, information, trade_off
    from ldbb_bayes.report.plain import json_text

    write_campaign_into(design.plan(seed=seed), folder)
    (folder / "model.toml").write_text(model_to_toml(design.model), encoding="utf-8")
    (folder / "design.json").write_text(json_text(record), encoding="utf-8")
    design.expected_table().to_csv(folder / "expected.csv", index=False)
    design.sensitivity.to_csv(folder / "sensitivity.csv", index=False)
    design.trade_off.to_csv(folder / "trade_off.csv", index=False)
    if not design.robustness.empty:
        design.robustness.rename_axis("design").to_csv(folder / "robustness.csv")
    save_figure(information(design), folder, "information")
    save_figure(efficiency(design), folder, "efficiency")
    save_figure(trade_off(design), folder, "trade_off")
    save_figure(expected_widths(design), folder, "expected_widths")


def print_fit(result: Mapping[str, Any]) -> None:
    """The table of a fit and its notes."""
    from ldbb_bayes.report.text import TOLD, nuisance_table, parameter_table, verdict_lines

    console = reading_console()
    console.print(parameter_table(result))
    if any(entry["term"] in TOLD for entry in result["nuisances"].values()):
        console.print()
        console.print(nuisance_table(result))
    console.print()
    for line in verdict_lines(result):
        console.print(line, markup=False)


@contextmanager
def counting_progress(quiet: bool, what: str) -> Iterator[Callable[[int, int], None] | None]:
    """A bar on stderr for jobs that are counted, with the time left; none when quiet or stderr is no terminal."""
    with failing_progress(quiet, what) as progress:
        yield None if progress is None else lambda done, total: progress(done, total, 0)


@contextmanager
def failing_progress(quiet: bool, what: str) -> Iterator[Callable[[int, int, int], None] | None]:
    """The same for jobs of which some may fail: done with, all, failed."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = (TextColumn(what), BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"), TimeRemainingColumn())
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None)

        def show(done: int, total: int, failed: int) -> None:
            bar.update(task, completed=done, total=total, description=f"{failed} failed" if failed else "")

        yield show


@contextmanager
def sampling_progress(quiet: bool, what: str = "sampling") -> Iterator[Callable[[Progress], None] | None]:
    """A progress bar on stderr while sampling; none when quiet or stderr is no terminal."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    columns = (TextColumn(what), BarColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=1.0)

        def show(state: Progress) -> None:
            worst = state.assessment
            ess = min(worst.ess_bulk_min, worst.ess_tail_min)
            text = f"{state.steps} steps, ESS {ess:.0f} of {state.target_ess:.0f}, R-hat {worst.rhat_max:.3f}"
            if state.seconds_left is not None:
                text += f", about {state.seconds_left:.0f} s left"
            bar.update(task, completed=min(ess / state.target_ess, 1.0), description=text)

        yield show
