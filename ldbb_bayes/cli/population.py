"""``ldbb-bayes population``: the machines of batches, their population, the next machine, and which do not belong."""

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

    from ldbb_bayes.fleet.pooled import Population

__all__ = ["POPULATION_FILES", "population"]

POPULATION_FILES = ("population.json", "machines.csv", "machines.png", "machines.svg")


@guarded
def population(
    batches: BatchesArgument,
    parameters: ParametersOption = None,
    exclude: ExcludeOption = None,
    since: SinceOption = None,
    include_misfits: MisfitsOption = False,
    reference_force: ReferenceForceOption = None,
    own_instruments: OwnInstrumentsOption = False,
    spread_scale: Annotated[
        float, typer.Option(help="Prior of a spread: half-normal of this many default prior sd of the parameter.", metavar="X")
    ] = 0.3,
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
    from ldbb_bayes.cli.show import counting_progress
    from ldbb_bayes.files import check_target
    from ldbb_bayes.fleet.population import population as run
    from ldbb_bayes.fleet.reading import read_batch
    from ldbb_bayes.fleet.statistics import FLEET_COLUMNS

    if out is not None:
        check_target(out, force=force, ours=POPULATION_FILES)
    rows = read_batch(batches, FLEET_COLUMNS)
    with counting_progress(quiet, "machines left out") as progress:
        found = run(
            rows,
            parameters=names_in(parameters),
            exclude=exclude or (),
            since=since,
            include_misfits=include_misfits,
            reference_force_N=reference_force,
            spread_scale=spread_scale,
            one_instrument=not own_instruments,
            ci_prob=ci,
            seed=seed,
            progress=progress,
        )
    record = found.as_dict()
    write, show = partial(_write, found, record), partial(_print, found)
    deliver(record, out, force=force, files=POPULATION_FILES, write=write, show=show, as_json=as_json, quiet=quiet)


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
    from ldbb_bayes.report.rounding import plus_minus, round_uncertainty, state
    from ldbb_bayes.units import display_name, display_unit, units_for

    percent = f"{100 * found.ci_prob:g} %"
    table = Table(box=None, pad_edge=False)
    for name in ("parameter", "unit"):
        table.add_column(name, no_wrap=True)
    for name in ("mean", "u of the bar", "spread", f"spread, {percent}", "of mean", "next machine"):
        table.add_column(name, justify="right", no_wrap=True)
    with units_for(found.sizes()):
        for own in found.parameters.values():
            factor, unit = display_unit(own.unit)
            whole = (plus_minus(one.mean, one.sd, one.interval, own.unit) for one in (own.mean, own.next))
            mean, following = (text.removesuffix(f" {unit}").replace("[", r"\[") for text in whole)
            common = round_uncertainty(own.instrument_sd * factor)[0] if own.instrument_sd > 0.0 else "–"
            spread = state(own.spread.mean, own.spread.sd, own.spread.interval, own.unit)
            share = "–" if own.percent is None else f"{own.percent.mean:.{1 if own.percent.mean < 10.0 else 0}f} %"
            interval = spread.interval.replace("[", r"\[")
            table.add_row(display_name(own.name), unit, mean, common, spread.value, interval, share, following)
    console = reading_console()
    console.print(table)
    console.print(
        "± U = 2u, or the interval where it is lopsided. u of the bar: what more machines do not make less. Next machine: one "
        "not yet measured.",
        markup=False,
    )
    console.print()
    for sentence in found.sentences():
        console.print(sentence, markup=False)
