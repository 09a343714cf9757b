"""``ldbb-bayes fit``: readings → credible intervals."""

from __future__ import annotations

import json

import typer

from ldbb_bayes.cli.options import (
    CampaignArgument,
    CiOption,
    DegreeOption,
    ForceOption,
    JsonOption,
    ModelOption,
    OutOption,
    PresetOption,
    QuietOption,
    RadiusOption,
    SeedOption,
    WithoutOption,
    campaign_from,
    guarded,
    model_from,
)

__all__ = ["fit"]


@guarded
def fit(
    campaign: CampaignArgument,
    degree: DegreeOption = None,
    preset: PresetOption = None,
    without: WithoutOption = "",
    model: ModelOption = None,
    sampler: str = typer.Option("joint", help="joint: emcee over all parameters of interest and hyper-parameters."),
    ess: float = typer.Option(1000.0, help="Bulk and tail effective sample size every parameter must reach.", min=100.0),
    max_steps: int = typer.Option(20_000, help="Steps of each ensemble at which sampling gives up.", min=200),
    radius_mm: RadiusOption = None,
    out: OutOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
    seed: SeedOption = 1,
    ci: CiOption = 0.95,
    quiet: QuietOption = False,
) -> None:
    """Credible intervals on compliances, force slopes and geometric errors.

    Exit code 1 when the sampler missed its target.
    """
    from ldbb_bayes.cli.show import print_fit, print_json, sampling_progress
    from ldbb_bayes.files import check_target, staged_folder
    from ldbb_bayes.inference.ensemble import StoppingRule
    from ldbb_bayes.inference.origin import record_of
    from ldbb_bayes.inference.posterior import save
    from ldbb_bayes.inference.sample import sample
    from ldbb_bayes.inference.summary import check_probability, result_json

    check_probability(ci)
    chosen = model_from(degree, preset, without, model)
    readings = campaign_from(campaign, radius_mm)
    if out is not None:
        check_target(out, force=force)
    with sampling_progress(quiet) as progress:
        rule = StoppingRule(ess=ess, max_steps=max_steps)
        posterior = sample(chosen, readings, sampler=sampler, seed=seed, rule=rule, progress=progress)
    result = result_json(posterior, ci_prob=ci)
    if out is not None:
        with staged_folder(out, force=force) as staging:
            save(posterior, staging / "posterior.nc")
            (staging / "summary.json").write_text(json.dumps(result, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
            (staging / "model.toml").write_text(record_of(posterior)["model"]["toml"], encoding="utf-8")
    if as_json:
        print_json(result)
    else:
        print_fit(result)
        if out is not None:
            typer.echo(f"Written: {out}/posterior.nc, summary.json, model.toml")
    if not result["sampler"]["converged"]:
        raise typer.Exit(1)
