"""``ldbb-bayes trend``: one machine over time; has it changed, and how soon would a change be found?"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ldbb_bayes.cli.fleet import (
    BatchesArgument,
    ExcludeOption,
    MisfitsOption,
    OwnInstrumentsOption,
    ParametersOption,
    ReferenceForceOption,
    SinceOption,
    deliver,
    names_in,
)
from ldbb_bayes.cli.options import CiOption, ForceOption, JsonOption, OutOption, QuietOption, SeedOption, guarded

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ldbb_bayes.fleet.trended import Trend

__all__ = ["TREND_FILES", "trend"]

TREND_FILES = ("trend.json", "trend.csv", "control_chart.png", "control_chart.svg")


@guarded
def trend(
    batches: BatchesArgument,
    machine: Annotated[
        str | None, typer.Option(help="Whose campaigns; needed where they are of several machines.", metavar="ID")
    ] = None,
    parameters: ParametersOption = None,
    exclude: ExcludeOption = None,
    since: SinceOption = None,
    include_misfits: MisfitsOption = False,
    reference_force: ReferenceForceOption = None,
    own_instruments: OwnInstrumentsOption = False,
    change_scale: Annotated[
        float, typer.Option(help="Size of a change (1 sd), in units of a parameter's default prior sd: 2e-5 mm/N of C_XXX.")
    ] = 0.2,
    repeatability: Annotated[
        float,
        typer.Option(help="What a machine itself changes from campaign to campaign (1 sd), same units: 1e-6 mm/N of C_XXX."),
    ] = 0.01,
    probability: Annotated[float, typer.Option(help="Of a change, before the readings.")] = 0.5,
    threshold: Annotated[float, typer.Option(help="Probability above which a change counts as found.")] = 0.95,
    detect: Annotated[float, typer.Option(help="Relative change whose detection is predicted: 0.2 is +20 %.")] = 0.2,
    ci: CiOption = 0.95,
    out: OutOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
    seed: SeedOption = 1,
    quiet: QuietOption = False,
) -> None:
    """One machine over time: control chart, probability that a parameter has changed and when, how soon a change is found.

    One lasting step of one parameter is looked for. Exit code 0 whatever is found.
    """
    from ldbb_bayes.cli.show import counting_progress
    from ldbb_bayes.files import check_target
    from ldbb_bayes.fleet.reading import read_batch
    from ldbb_bayes.fleet.statistics import FLEET_COLUMNS
    from ldbb_bayes.fleet.trend import trend as run

    if out is not None:
        check_target(out, force=force, ours=TREND_FILES)
    rows = read_batch(batches, FLEET_COLUMNS)
    with counting_progress(quiet, "further campaigns simulated") as progress:
        found = run(
            rows,
            machine=machine,
            parameters=names_in(parameters),
            exclude=exclude or (),
            since=since,
            include_misfits=include_misfits,
            reference_force_N=reference_force,
            one_instrument=not own_instruments,
            change_scale=change_scale,
            repeatability=repeatability,
            probability=probability,
            threshold=threshold,
            detect=detect,
            ci_prob=ci,
            seed=seed,
            progress=progress,
        )
    record = {"schema": 1, **found.as_dict()}
    write, show = partial(_write, found, record), partial(_print, found)
    deliver(record, out, force=force, files=TREND_FILES, write=write, show=show, as_json=as_json, quiet=quiet)


def _write(result: Trend, record: Mapping[str, Any], folder: Path) -> None:
    from ldbb_bayes.fleet.figures_trend import control_chart
    from ldbb_bayes.report.figures import save_figure
    from ldbb_bayes.report.plain import json_text

    (folder / "trend.json").write_text(json_text(record), encoding="utf-8")
    result.estimates.to_csv(folder / "trend.csv", index=False)
    save_figure(control_chart(result), folder, "control_chart")


def _print(result: Trend) -> None:
    from rich.table import Table

    from ldbb_bayes.cli.show import reading_console

    rows = result.reading_rows()
    table = Table(box=None, pad_edge=False)
    for column in rows[0]:
        table.add_column(column, justify="left" if column == "parameter" else "right")
    for row in rows:
        table.add_row(*row.values())
    console = reading_console()
    console.print(table)
    console.print(
        "± U = 2u; of a probability ± u, of counting simulated series. u, common: what the bar adds to all campaigns alike.",
        markup=False,
    )
    console.print()
    for sentence in (*result.verdict, *result.doubts):
        console.print(sentence, markup=False)
