"""Commands ``identify``, ``compare``, ``design`` and ``validate`` of ``ldbb-bayes``."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import pandas as pd
import typer

import ldbb_bayes as lb
from ldbb_bayes.campaign.folder import MODEL_NAME, pilot_of_plan, write_campaign_into
from ldbb_bayes.cli import arguments
from ldbb_bayes.cli.atlases import ATLAS_FILES, write_atlases
from ldbb_bayes.cli.campaign_notes import assumptions_of, with_notes
from ldbb_bayes.cli.design_options import COST_OPTIONS, DESIGN_OPTIONS
from ldbb_bayes.cli.goal_designs import (
    GOAL_FILES,
    files_of_goal_design,
    find_for_goals,
    running_order,
)
from ldbb_bayes.cli.operator_sheets import SHEET, language_in, sheet_of_plan
from ldbb_bayes.cli.options import EXIT_MISSED, Kind, command, group, options_of
from ldbb_bayes.cli.output import drawing
from ldbb_bayes.cli.progress import counting_progress
from ldbb_bayes.cli.values import pairs_in
from ldbb_bayes.errors import require
from ldbb_bayes.model.parameter_kinds import DEGREE_NAMES
from ldbb_bayes.parallel import executor_named, second_process
from ldbb_bayes.report import wording
from ldbb_bayes.results import parts_of

if TYPE_CHECKING:
    from ldbb_bayes.cli.sources import SourceCampaign

__all__ = ["compare", "design", "identify", "validate"]

# Columns of the file parameters.csv, which the command ``identify`` writes. The file has one more
# column, with the names of the parameters.
_PARAMETER_COLUMNS = ["unit", "prior_sd", "sd", "contraction", "information_gain", "verdict"]
# What the command ``design`` of ``ldbb-bayes`` says of the plan that it has written.
_NOTE_ON_PLAN = f", a plan; {MODEL_NAME} is the model of its analysis, {SHEET} for the operator"
# Names of the figures that the command ``compare`` of ``ldbb-bayes`` writes.
_COMPARISON_FIGURES = ("evidence", "compliance_with_local_fits", "geometry_with_local_fits")


@command
def identify(
    source: arguments.GivenReadings,
    model: arguments.ChosenModel,
    output: arguments.OutputOptions,
    settings: Annotated[dict[str, Any], group(**options_of("identify"))],
) -> None:
    """Say which effects make each parameter uncertain, which are confounded, and what would help.

    The campaign may be a plan (without readings), so that these questions can be answered before
    the experiment. Tables of readings are read in the same way as by the command ``report``.
    """
    # The modules that write the texts of this command take a long time to load. They are therefore
    # imported here, and not at the top of the file.
    from ldbb_bayes.report import identifiability_text, screens

    output.check(
        "identify.json",
        "parameters.csv",
        "alias.csv",
        "correlation.csv",
        *ATLAS_FILES,
        figures=["prior_and_posterior"],
    )
    campaign = source.campaign
    result = lb.identify(model, campaign)
    record = {
        "schema": 1,
        "campaign": campaign.name,
        "degree": model.degree,
        **lb.report.with_words(result),
    }
    parameters = pd.DataFrame.from_dict(record["parameters"], orient="index")
    contents = {
        "identify.json": record,
        "parameters.csv": parameters[_PARAMETER_COLUMNS].rename_axis("parameter").reset_index(),
        "alias.csv": result.alias.rename_axis("parameter").reset_index(),
        "correlation.csv": result.correlation.rename_axis("coefficient").reset_index(),
    }
    circles = [test.circle for test in campaign.tests]
    passages = (*screens.screen_of(result)[:-1], wording.ALL_DETAILS)
    if settings["details"]:
        passages = identifiability_text.parts_of(result)
    output.deliver(
        record,
        (
            *assumptions_of(source),
            f"Compliance {DEGREE_NAMES[model.degree]} in force.",
            *with_notes(passages, campaign),
        ),
        contents,
        {"prior_and_posterior": drawing("prior_and_posterior", result)},
        write_more=partial(write_atlases, campaign.machine(), circles),
    )


_MODEL_FILES = Kind(list[str], partial(pairs_in, form="NAME=FILE.toml"))
_COMPARE_OPTIONS = group(**options_of("compare", models=_MODEL_FILES))


@command
def compare(
    campaign: arguments.MeasuredCampaign,
    model: arguments.ChosenModel,
    output: arguments.OutputOptions,
    settings: Annotated[dict[str, Any], _COMPARE_OPTIONS],
) -> None:
    """Compare constant compliance with compliance linear in force, by evidence and prediction.

    The evidence is computed under several priors and assumptions, and each test is predicted from
    the others. The command also states which compliances change with force, and which tests do not
    agree with the others. With --degree 2, quadratic compliance is compared too.

    The exit code is 1 if the numerical error of an evidence exceeds --tolerance.
    """
    require(
        model.degree > 0,
        "compare must have a degree of at least 1, got 0: there is nothing to compare with. Use"
        " --degree 1 or 2.",
    )
    models = {name: model.with_degree(k) for k, name in enumerate(DEGREE_NAMES[: model.degree + 1])}
    for name, file in settings.pop("also", {}).items():
        require(
            name not in models, f"--also must give a new name, got {name!r} again. Choose another."
        )
        models[name] = lb.read_model(file, degree=model.degree)

    output.check("comparison.json", "local_fits.csv", figures=_COMPARISON_FIGURES)
    with counting_progress(output.quiet, "models weighed") as progress, second_process() as other:
        result = lb.compare(models, campaign, **settings, progress=progress, executor=other)
    record = {"schema": 1, "seed": settings["seed"], **lb.report.with_words(result)}
    output.deliver(
        record,
        with_notes(parts_of(result), campaign),
        {"comparison.json": record, "local_fits.csv": result.local_fits},
        {name: drawing(name, result) for name in _COMPARISON_FIGURES},
    )
    if not result.within_tolerance:
        raise typer.Exit(EXIT_MISSED)


@command
def design(
    source: arguments.GivenReadings,
    model: arguments.ChosenModel,
    output: arguments.OutputOptions,
    settings: Annotated[dict[str, Any], group(**DESIGN_OPTIONS)],
) -> None:
    """Find the best tests to run next, and say how good they are and what they will show.

    The choice is based on the given campaign, which may be a plan (without readings). The chosen
    tests are written into --out DIR as a plan, in the order in which to run them, with the model
    for their analysis.

    With --goal, the command finds the cheapest campaign and certificates that reach every goal for
    an expanded uncertainty, and the next best two. If no number of circles reaches a goal, the
    command names the effect that prevents this.

    The exit code is 1 if the tests are not proven to be the best, or if a goal is not reached.
    """
    language = language_in(settings)
    if "goals" in settings:
        _design_for_goals(source, model, output, settings, language)
        return
    for name in (*COST_OPTIONS, "certificates", "probability"):
        require(
            name not in settings,
            f"--{name.replace('_', '-')} must go with --goal, got none. Give for example --goal"
            " C_XXX=5%.",
        )
    # The module that writes model files is imported here, and not at the top of the file, because
    # it loads SciPy, which takes a long time.
    from ldbb_bayes.model.specification import model_to_toml

    output.check(
        "campaign.toml",
        MODEL_NAME,
        "design.json",
        "expected.csv",
        "sensitivity.csv",
        SHEET,
        *pilot_of_plan(output.out),
        figures=["expected_widths"],
    )
    campaign = source.campaign
    result = lb.design(model, campaign, **settings)
    record = {"schema": 1, "seed": settings["seed"], **lb.report.with_words(result)}
    plan = result.plan(seed=settings["seed"])
    contents = {
        MODEL_NAME: model_to_toml(result.model),
        "design.json": record,
        "expected.csv": result.expected_table(),
        "sensitivity.csv": result.sensitivity,
    }
    if output.out is not None:
        contents[SHEET] = sheet_of_plan(plan, language)
    output.deliver(
        record,
        (
            *assumptions_of(source),
            *with_notes(parts_of(result), campaign),
            f"Run in this order: {running_order(plan)}",
        ),
        contents,
        {"expected_widths": drawing("expected_widths", result)},
        write_more=partial(write_campaign_into, plan),
        note=_NOTE_ON_PLAN,
    )
    if not result.certificate.holds:
        raise typer.Exit(EXIT_MISSED)


def _design_for_goals(
    source: SourceCampaign,
    model: lb.HybridModel,
    output: arguments.OutputOptions,
    settings: dict[str, Any],
    language: str,
) -> None:
    """Find, print and write the cheapest campaign that reaches the goals for uncertainties.

    ``settings`` are the options of the command ``design``, which include the goals; the keys are
    the names of the options. The campaign is written as a plan, with a sheet for the operator in
    ``language``. Exit with code 1 if a goal is not reached.
    """
    output.check(*GOAL_FILES, *pilot_of_plan(output.out))
    with counting_progress(output.quiet, "steps of the search") as progress:
        result = find_for_goals(model, source.campaign, settings, progress)
    files = files_of_goal_design(result, settings["seed"], language=language)
    passages = [*assumptions_of(source), *with_notes(parts_of(result), source.campaign)]
    note = "/goals.json; there is no plan"
    if result.plans:
        passages.append(f"Run in this order: {running_order(result.plan())}")
        note = _NOTE_ON_PLAN
    output.deliver(
        files.record, tuple(passages), files.contents, write_more=files.write_more, note=note
    )
    if not result.all_reached:
        raise typer.Exit(EXIT_MISSED)


# ---- check of the credible intervals by simulation


@command
def validate(
    campaign: arguments.GivenCampaign,
    model: arguments.ChosenModel,
    output: arguments.OutputOptions,
    settings: Annotated[dict[str, Any], group(**options_of("validate"))],
    pool: arguments.PoolOptions,
) -> None:
    """Check by simulation that credible intervals cover true values as often as they should.

    The tests are those of a plan or a campaign. True values are drawn at random from the priors,
    and readings are simulated with these values. The ranks of the true values among the random
    draws of each posterior must be uniformly distributed.

    With --workflow, a campaign with readings goes through all checks of a Bayesian workflow, and
    true values are drawn from its posterior.

    The exit code is 1 if the ranks are not uniformly distributed, if a simulation failed, or if a
    check of the workflow fails.
    """
    if settings.pop("workflow"):
        _check_workflow(campaign, model, output, settings, pool)
        return
    if "data_model" in settings:
        settings["generator"] = lb.read_model(settings.pop("data_model"), degree=model.degree)
    output.check("validation.json", "ranks.csv", figures=["rank_ecdf"])
    with (
        executor_named(**pool) as executor,
        counting_progress(output.quiet, "simulated campaigns") as progress,
    ):
        result = lb.calibrate(model, campaign, **settings, executor=executor, progress=progress)
    record = {
        "schema": 1,
        "campaign": campaign.name,
        "seed": settings["seed"],
        **lb.report.with_words(result),
    }
    ranks = pd.DataFrame(result.ranks, columns=list(result.names))
    output.deliver(
        record,
        result,
        {
            "validation.json": record,
            "ranks.csv": ranks.rename_axis("replicate").reset_index(),
        },
        {"rank_ecdf": drawing("rank_ecdf", result)},
    )
    if not result.calibrated:
        raise typer.Exit(EXIT_MISSED)


def _check_workflow(
    campaign: lb.Campaign,
    model: lb.HybridModel,
    output: arguments.OutputOptions,
    settings: dict[str, Any],
    pool: dict[str, Any],
) -> None:
    """Run all checks of a Bayesian workflow on a campaign with readings, and write the results.

    ``settings`` are the options of the command ``validate``. Exit with code 1 if a check fails.
    """
    require(
        "data_model" not in settings,
        "--data-model must go without --workflow, whose readings are simulated from the posterior."
        " Leave out one of the two.",
    )
    require(
        settings["sampler"] == "independent",
        f"--sampler must be independent with --workflow, got {settings['sampler']}. Leave it out.",
    )
    output.check("workflow.json", "ranks.csv", figures=["rank_ecdf", "workflow_checks"])
    with (
        executor_named(**pool) as executor,
        counting_progress(output.quiet, "simulated campaigns") as progress,
    ):
        result = lb.analysis.check_workflow(
            model,
            campaign,
            replicates=settings["replicates"],
            draws=settings["draws"],
            seed=settings["seed"],
            executor=executor,
            progress=progress,
        )
    record = {"schema": 1, "seed": settings["seed"], **lb.report.with_words(result)}
    ranks = pd.DataFrame(result.calibration.ranks, columns=list(result.calibration.names))
    output.deliver(
        record,
        result,
        {"workflow.json": record, "ranks.csv": ranks.rename_axis("replicate").reset_index()},
        {
            "rank_ecdf": drawing("rank_ecdf", result.calibration),
            "workflow_checks": drawing("workflow_checks", result),
        },
    )
    if not result.passed:
        raise typer.Exit(EXIT_MISSED)
