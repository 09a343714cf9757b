"""``ldbb-bayes validate``: does the computation return the posterior it claims to?"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ldbb_bayes.cli.options import (
    CampaignArgument,
    DegreeOption,
    DriftOption,
    ExecutorOption,
    ForceOption,
    JsonOption,
    ModelOption,
    OutOption,
    PresetOption,
    QuietOption,
    SchedulerOption,
    SeedOption,
    WithoutOption,
    WorkersOption,
    campaign_from,
    guarded,
    model_from,
)

__all__ = ["validate"]

VALIDATION_FILES = ("validation.json", "ranks.csv", "rank_ecdf.png", "rank_ecdf.svg")


@guarded
def validate(
    plan: CampaignArgument,
    degree: DegreeOption = None,
    preset: PresetOption = None,
    without: WithoutOption = "",
    drift: DriftOption = None,
    model: ModelOption = None,
    data_model: Annotated[
        Path | None,
        typer.Option(help="Draw the readings from this model instead, to see what a wrong model does.", metavar="FILE.toml"),
    ] = None,
    sampler: str = typer.Option("quadrature", help="quadrature, joint or collapsed."),
    replicates: int = typer.Option(100, help="Simulated campaigns."),
    draws: int = typer.Option(99, help="Posterior draws of each."),
    executor: ExecutorOption = "process",
    scheduler: SchedulerOption = None,
    workers: WorkersOption = 0,
    out: OutOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
    seed: SeedOption = 1,
    quiet: QuietOption = False,
) -> None:
    """Simulation-based calibration on a plan (or the plan of a campaign): truths from the priors, readings, posterior, ranks.

    Exit code 1 when ranks are not uniform.
    """
    from ldbb_bayes.analysis.validation import validate as run
    from ldbb_bayes.cli.show import counting_progress, print_json, reading_console, write_validation
    from ldbb_bayes.files import check_target, staged_folder
    from ldbb_bayes.fleet.executors import executor_named
    from ldbb_bayes.model.spec import read_model
    from ldbb_bayes.report.text import coverage_table

    chosen = model_from(degree, preset, without, model, drift)
    generator = None if data_model is None else read_model(data_model, degree=chosen.degree)
    campaign = campaign_from(plan)
    if out is not None:
        check_target(out, force=force, ours=VALIDATION_FILES)
    with executor_named(executor, workers, scheduler) as pool, counting_progress(quiet, "simulated campaigns") as progress:
        result = run(
            chosen,
            campaign,
            replicates=replicates,
            draws=draws,
            sampler=sampler,
            generator=generator,
            seed=seed,
            executor=pool,
            progress=progress,
        )
    record = {"schema": 1, "campaign": campaign.name, "seed": seed, **result.as_dict()}
    if out is not None:
        with staged_folder(out, force=force, ours=VALIDATION_FILES) as staging:
            write_validation(result, record, staging)
    if as_json:
        print_json(record)
    else:
        console = reading_console()
        console.print(coverage_table(result))
        console.print()
        console.print(result.verdict, markup=False)
        if out is not None:
            console.print(f"Written: {', '.join(f'{out}/{name}' for name in VALIDATION_FILES)}", markup=False)
    if not result.calibrated:
        raise typer.Exit(1)
