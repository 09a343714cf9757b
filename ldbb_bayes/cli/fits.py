"""Commands ``fit``, ``summarize`` and ``demo`` of ``ldbb-bayes``: posteriors and their files."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import ldbb_bayes as lb
from ldbb_bayes.analysis.tolerances import quantities_of, tolerances_in
from ldbb_bayes.cli import arguments
from ldbb_bayes.cli.options import EXIT_MISSED, command, group, option, options_of
from ldbb_bayes.cli.output import Output, write_files
from ldbb_bayes.cli.progress import counting_progress, sampling_progress
from ldbb_bayes.files import check_target, staged_folder
from ldbb_bayes.inference.posterior import record_of
from ldbb_bayes.inference.summary import check_probability
from ldbb_bayes.report import wording
from ldbb_bayes.report.fit_tables import full_result, parts_of_fit, results_table
from ldbb_bayes.units import inside_name

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["RESULT_FILES", "demo", "fit", "summarize", "with_tolerances", "write_result"]

RESULT_FILES = (
    "posterior.nc",
    "summary.json",
    "model.toml",
    "report.html",
    "report.json",
    "tables",
)
_DEMO_FILES = ("campaign", "constant", "linear", "figures")


@command
def fit(
    campaign: arguments.GivenCampaign,
    model: arguments.ChosenModel,
    output: arguments.OutputOptions,
    settings: Annotated[dict[str, Any], group(**options_of("fit"))],
    tolerances: arguments.Tolerances,
    prior_from: Annotated[Path | None, arguments.PRIOR_FROM],
) -> None:
    """Compute credible intervals of compliances, force slopes and geometric errors.

    Exit code 1 when the sampler missed its target.
    """
    check_probability(settings["prob"])
    prior_record: dict[str, Any] = {}
    if prior_from is not None:
        prior = lb.fleet.read_population_prior(prior_from)
        doubts = list(prior.doubts(campaign))
        for doubt in doubts:
            typer.echo(f"--prior-from: {doubt}", err=True)
        model = prior.model(model)
        prior_record["prior_from"] = {
            "path": str(prior_from),
            "machines": prior.machines,
            "campaigns": prior.campaigns,
            "sha256": prior.sha256,
            "doubts": doubts,
        }
    campaign = with_tolerances(campaign, model, tolerances)
    output.check(*RESULT_FILES)
    rule = lb.inference.StoppingRule(ess=settings["ess"], max_steps=settings["max_steps"])
    with sampling_progress(output.quiet, "sampling") as progress:
        posterior = lb.sample(
            model,
            campaign,
            sampler=settings["sampler"],
            seed=settings["seed"],
            rule=rule,
            progress=progress,
        )
    result = full_result(posterior, settings["prob"]) | prior_record
    output.deliver(
        result, parts_of_fit(result), write_more=partial(write_result, posterior, result)
    )
    if not result["sampler"]["converged"]:
        raise typer.Exit(EXIT_MISSED)


def with_tolerances(
    campaign: lb.Campaign, model: lb.HybridModel, tolerances: Mapping[str, str]
) -> lb.Campaign:
    """Return a campaign with further tolerances, which replace those of the same quantities.

    Parameters
    ----------
    campaign
        The campaign.
    model
        Model with which the campaign will be fitted.
    tolerances
        Limits by quantity, for example ``{"C_XXX": "60 nm/N"}``.

    Returns
    -------
    Campaign

    Raises
    ------
    InputError
        If a limit cannot be read, or the model has no such quantity.
    """
    stated = {inside_name(name): limit for name, limit in tolerances.items()}
    campaign = replace(campaign, tolerances={**campaign.tolerances, **stated})
    if campaign.tolerances:
        tolerances_in(quantities_of(model.bind(campaign)), campaign.tolerances)
    return campaign


@command
def summarize(
    result: Annotated[
        Path,
        typer.Argument(help="The --out folder of a fit, or its posterior.nc.", metavar="RESULT"),
    ],
    as_json: Annotated[bool, arguments.JSON],
    ci: Annotated[float, arguments.CI],
) -> None:
    """Print table or JSON of a stored posterior, with intervals of any probability."""
    numbers = full_result(lb.load(result), ci)
    Output(as_json=as_json).deliver(numbers, parts_of_fit(numbers))


def write_result(posterior: xr.DataTree, result: Mapping[str, Any], folder: Path) -> None:
    """Write posterior.nc, summary.json and model.toml of a fit.

    Parameters
    ----------
    posterior
        Posterior of the fit.
    result
        Summary of the fit from `ldbb_bayes.report.fit_tables.full_result`.
    folder
        Folder for the files; it is created if necessary.
    """
    folder.mkdir(exist_ok=True)
    lb.save(posterior, folder / "posterior.nc")
    model_toml = record_of(posterior)["model"]["toml"]
    write_files(folder, {"summary.json": result, "model.toml": model_toml})


@command
def demo(
    out: Annotated[
        Path,
        option(Path, "Folder to write results and figures to.", Path("ldbb_demo"), metavar="DIR"),
    ],
    force: Annotated[bool, arguments.FORCE],
    seed: Annotated[int, arguments.SEED],
    as_json: Annotated[bool, arguments.JSON],
    quiet: Annotated[bool, arguments.QUIET],
) -> None:
    """Fit constant and linear compliance to the published experiment, and say what it means.

    The readings are recovered from the printed tables of the paper; what in them is not data is
    said in the folder's README.
    """
    check_target(out, force=force, ours=_DEMO_FILES)
    source = lb.embedded_campaign()
    campaign = lb.read_campaign(source)
    models = {"constant": lb.HybridModel.default(0), "linear": lb.HybridModel.default(1)}
    posteriors = {}
    for name, model in models.items():
        with sampling_progress(quiet, name) as progress:
            posteriors[name] = lb.sample(model, campaign, seed=seed, progress=progress)
    with counting_progress(quiet, "models compared") as progress:
        comparison = lb.compare(models, campaign, evidence_only=True, seed=seed, progress=progress)
    results = {name: full_result(posterior, 0.95) for name, posterior in posteriors.items()}

    with staged_folder(out, force=force, ours=_DEMO_FILES) as staging:
        shutil.copytree(source, staging / "campaign")
        for name, posterior in posteriors.items():
            write_result(posterior, results[name], staging / name)
        lb.figures.save_figures(posteriors["linear"], staging / "figures")
        document = lb.write_report(posteriors["linear"], staging / "linear", comparison=comparison)

    parts: list[Any] = []
    for name, posterior in posteriors.items():
        parts.append(f"{name.capitalize()} compliance")
        parts.append(results_table(results[name], lb.analysis.judge_posterior(posterior)))
    parts += [
        wording.comparison_sentences(comparison)[0],
        document.state,
        "",
        f"Report: {out}/linear/report.html",
        f"Files: {out}/campaign, {out}/constant, {out}/linear, {out}/figures (PNG and SVG)",
    ]
    Output(as_json=as_json).deliver({"schema": 1, "out": str(out), **results}, tuple(parts))
    if not all(result["sampler"]["converged"] for result in results.values()):
        raise typer.Exit(EXIT_MISSED)
