"""Commands ``fit``, ``summarize`` and ``demo`` of ``ldbb-bayes``: posteriors and their files.

The modules for sampling and summaries are imported only when a command runs, so that the help of
all commands appears sooner.
"""

from __future__ import annotations

import shutil
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

import ldbb_bayes as lb
from ldbb_bayes.cli import arguments
from ldbb_bayes.cli.options import EXIT_MISSED, command, group, option, options_of
from ldbb_bayes.cli.output import Output
from ldbb_bayes.cli.progress import counting_progress, sampling_progress
from ldbb_bayes.files import check_target, staged_folder
from ldbb_bayes.report import wording

__all__ = ["demo", "fit", "summarize"]

# Names of the folders that the command ``demo`` of ``ldbb-bayes`` writes.
_DEMO_FILES = ("campaign", "constant", "linear", "figures")
# name of the file that ``summarize --out`` writes
_SUMMARY_NAME = "summary.json"


@command
def fit(
    campaign: arguments.MeasuredCampaign,
    model: arguments.ChosenModel,
    output: arguments.OutputOptions,
    settings: Annotated[dict[str, Any], group(**options_of("fit"))],
    tolerances: arguments.Tolerances,
    prior_from: Annotated[Path | None, arguments.PRIOR_FROM],
) -> None:
    """Compute credible intervals of compliances, their changes with force, and geometric errors.

    The exit code is 1 if the effective sample size of the random draws from the posterior is
    smaller than the value of --ess.
    """
    from ldbb_bayes.cli.fit_results import RESULT_FILES, with_tolerances, write_result
    from ldbb_bayes.report.fit_record import full_result
    from ldbb_bayes.report.fit_tables import parts_of_fit

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
        result,
        parts_of_fit(result, details=settings["details"]),
        write_more=partial(write_result, posterior, result),
    )
    if not result["sampler"]["converged"]:
        raise typer.Exit(EXIT_MISSED)


@command
def summarize(
    result: Annotated[
        Path,
        typer.Argument(help="The --out folder of a fit, or its posterior.nc.", metavar="RESULT"),
    ],
    output: arguments.OutputOptions,
    ci: Annotated[float, arguments.CI],
    details: Annotated[bool, arguments.DETAILS],
) -> None:
    """Print the results of a stored fit, with credible intervals of the chosen probability."""
    from ldbb_bayes.report.fit_record import full_result
    from ldbb_bayes.report.fit_tables import parts_of_fit

    output.check(_SUMMARY_NAME)
    numbers = full_result(lb.load(result), ci)
    output.deliver(numbers, parts_of_fit(numbers, details=details), {_SUMMARY_NAME: numbers})


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
    """Fit constant and linear compliance to the published experiment, and explain the results.

    The readings are computed from the tables printed in the paper. What the tables do not determine
    is synthetic. This command also writes the folder "campaign" with the readings; the README in it
    states which parts of the readings were not measured.
    """
    from ldbb_bayes.cli.fit_results import write_result
    from ldbb_bayes.report.fit_record import full_result
    from ldbb_bayes.report.fit_tables import explanation_of_U, results_table

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

    headings = {
        "constant": "Constant compliance: what changes with force is the joint load alone",
        "linear": "Linear compliance",
    }
    parts: list[Any] = []
    for name, posterior in posteriors.items():
        parts.append(headings[name])
        table = results_table(results[name], lb.analysis.judge_posterior(posterior))
        parts += [table, *explanation_of_U(table)]
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
