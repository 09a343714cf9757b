"""``ldbb-bayes fit``: readings → credible intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from ldbb_bayes.cli.options import (
    EXIT_INTERRUPTED,
    CiOption,
    DegreeOption,
    DriftOption,
    ForceOption,
    JsonOption,
    ModelOption,
    OutOption,
    PresetOption,
    PriorFromOption,
    QuietOption,
    SeedOption,
    WithoutOption,
    fail,
    model_from,
    of_campaign,
    with_population,
)

if TYPE_CHECKING:
    from ldbb_bayes.campaign.campaign import Campaign

__all__ = ["fit"]


@of_campaign
def fit(
    readings: Campaign,
    degree: DegreeOption = None,
    preset: PresetOption = None,
    without: WithoutOption = "",
    drift: DriftOption = None,
    model: ModelOption = None,
    prior_from: PriorFromOption = None,
    sampler: str = typer.Option(
        "joint", help="joint (emcee over everything), collapsed (emcee over the hyper-parameters) or quadrature."
    ),
    ess: float = typer.Option(1000.0, help="Bulk and tail effective sample size every parameter must reach.", min=100.0),
    max_steps: int = typer.Option(20_000, help="Steps of each ensemble at which sampling gives up.", min=200),
    out: OutOption = None,
    force: ForceOption = False,
    resume: bool = typer.Option(False, "--resume", help="Go on with the run that stopped before it had written --out."),
    as_json: JsonOption = False,
    seed: SeedOption = 1,
    ci: CiOption = 0.95,
    quiet: QuietOption = False,
) -> None:
    """Credible intervals on compliances, force slopes and geometric errors.

    Exit code 1 when the sampler missed its target. With --out the run is kept in DIR.checkpoint until it is done: whatever stops
    it, the same command with --resume goes on to the very same result.
    """
    from ldbb_bayes.cli.show import RESULT_FILES, print_fit, print_json, sampling_progress, write_result
    from ldbb_bayes.errors import InputError
    from ldbb_bayes.files import check_target, staged_folder
    from ldbb_bayes.inference.checkpoint import remove_checkpoint
    from ldbb_bayes.inference.sample import sample
    from ldbb_bayes.inference.stopping import StoppingRule
    from ldbb_bayes.inference.summary import check_probability
    from ldbb_bayes.report.result import full_result

    check_probability(ci)
    if resume and out is None:
        raise InputError("--resume must come with --out, got none. Give the folder the run was started with.")
    chosen, population = with_population(model_from(degree, preset, without, model, drift), prior_from, readings)
    if out is not None:
        check_target(out, force=force, ours=RESULT_FILES)
    checkpoint = None if out is None else out.with_name(out.name + ".checkpoint")
    if checkpoint is not None and force and not resume:
        remove_checkpoint(checkpoint)
    if resume and not (checkpoint and checkpoint.exists()):
        typer.echo(f"{checkpoint} holds no unfinished run: this one begins anew.", err=True)
    rule = StoppingRule(ess=ess, max_steps=max_steps)
    try:
        with sampling_progress(quiet) as progress:
            posterior = sample(
                chosen,
                readings,
                sampler=sampler,
                seed=seed,
                rule=rule,
                progress=progress,
                checkpoint=checkpoint,
                resume=resume,
            )
    except KeyboardInterrupt:
        if checkpoint is None or not checkpoint.exists():
            raise
        fail(f"interrupted; {checkpoint} keeps the run. The same command with --resume goes on with it.", EXIT_INTERRUPTED)
    result = full_result(posterior, ci)
    if population is not None:
        result["prior_from"] = population
    if out is not None:
        with staged_folder(out, force=force, ours=RESULT_FILES) as staging:
            write_result(posterior, result, staging)
    if as_json:
        print_json(result)
    else:
        print_fit(result)
        if population is not None:
            whose = f"{population['machines']} machines, {population['campaigns']} campaigns ({population['path']})"
            typer.echo(f"Prior of the compliances: population of {whose}.")
        if out is not None:
            typer.echo(f"Written: {out}/posterior.nc, summary.json, model.toml")
    if not result["sampler"]["converged"]:
        raise typer.Exit(1)
    if checkpoint is not None:
        remove_checkpoint(checkpoint)
