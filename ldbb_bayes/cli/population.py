"""``ldbb-bayes population``: the machines of batches, their population, the next machine, and which do not belong."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ldbb_bayes.cli.options import CiOption, ForceOption, JsonOption, OutOption, QuietOption, SeedOption, guarded

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ldbb_bayes.fleet.pooled import Population

__all__ = ["POPULATION_FILES", "population"]

POPULATION_FILES = ("population.json", "machines.csv", "machines.png", "machines.svg")


@guarded
def population(
    batch: Annotated[list[Path], typer.Argument(help="Folders that ldbb-bayes batch wrote.", metavar="BATCH...")],
    parameters: Annotated[
        str | None,
        typer.Option(help="Comma-separated compliances and geometric errors. Default: all constant compliances.", metavar="LIST"),
    ] = None,
    reference_force: Annotated[
        float | None, typer.Option(help="Force at which compliances are meant (N). Default: the campaigns' median.", metavar="F")
    ] = None,
    spread_scale: Annotated[
        float, typer.Option(help="Prior of a spread: half-normal of this many default prior sd of the parameter.", metavar="X")
    ] = 0.3,
    own_instruments: Annotated[
        bool, typer.Option("--own-instruments", help="Every campaign had a bar, a mount and a regulator of its own.")
    ] = False,
    ci: CiOption = 0.95,
    out: OutOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
    seed: SeedOption = 1,
    quiet: QuietOption = False,
) -> None:
    """The population that the machines of a batch come from: mean, spread, the next machine, and machines that do not belong.

    Campaigns of one machine (machine_id in campaign.toml) are taken together; each machine is told what the others say.
    """
    from ldbb_bayes.cli.show import counting_progress, print_json
    from ldbb_bayes.files import check_target, staged_folder
    from ldbb_bayes.fleet.population import population as run
    from ldbb_bayes.fleet.reading import read_batch
    from ldbb_bayes.fleet.statistics import FLEET_COLUMNS

    if out is not None:
        check_target(out, force=force, ours=POPULATION_FILES)
    names = None if parameters is None else [name.strip() for name in parameters.split(",") if name.strip()]
    rows = read_batch(list(batch), FLEET_COLUMNS)
    with counting_progress(quiet, "machines left out") as progress:
        found = run(
            rows,
            parameters=names,
            reference_force_N=reference_force,
            spread_scale=spread_scale,
            one_instrument=not own_instruments,
            ci_prob=ci,
            seed=seed,
            progress=progress,
        )
    record = found.as_dict()
    if out is not None:
        with staged_folder(out, force=force, ours=POPULATION_FILES) as staging:
            _write(found, record, staging)
    if as_json:
        print_json(record)
        return
    _print(found)
    if out is not None and not quiet:
        typer.echo(f"Written: {', '.join(f'{out}/{name}' for name in POPULATION_FILES)}")


def _write(found: Population, record: Mapping[str, Any], folder: Path) -> None:
    from ldbb_bayes.fleet.figures_population import machine_chart
    from ldbb_bayes.report.figures import save_figure
    from ldbb_bayes.report.plain import json_text

    (folder / "population.json").write_text(json_text(record), encoding="utf-8")
    found.machines_table().to_csv(folder / "machines.csv")
    save_figure(machine_chart(found), folder, "machines")


def _print(found: Population) -> None:
    """A row per parameter with its unit, then what to mind."""
    from rich.table import Table

    from ldbb_bayes.cli.show import reading_console
    from ldbb_bayes.report.rounding import state, value_and_uncertainty
    from ldbb_bayes.units import display_name, display_unit

    percent = f"{100 * found.ci_prob:g} %"
    table = Table(box=None, pad_edge=False)
    table.add_column("parameter", no_wrap=True)
    for name in ("mean", "u", "u of the bar", "spread", percent, "% of mean", "next machine", "u"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    for own in found.parameters.values():
        factor, unit = display_unit(own.unit)
        mean, u = value_and_uncertainty(own.mean.mean * factor, own.mean.sd * factor)
        common, _ = value_and_uncertainty(own.instrument_sd * factor, own.mean.sd * factor)
        spread = state(own.spread.mean, own.spread.sd, own.spread.interval, own.unit)
        following, width = value_and_uncertainty(own.next.mean * factor, own.next.sd * factor)
        share = "–" if own.percent is None else f"{own.percent.mean:.2g}"
        interval = spread.interval.replace("[", r"\[")
        table.add_row(display_name(own.name), mean, u, common, spread.value, interval, share, following, width, unit)
    console = reading_console()
    console.print(table)
    console.print()
    for sentence in found.sentences():
        console.print(sentence, markup=False)
