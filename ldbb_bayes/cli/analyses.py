"""``ldbb-bayes demo``, ``fit``, ``summarize``, ``identify``, ``compare``, ``design``, ``validate``:
one campaign."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import ldbb_bayes as lb
from ldbb_bayes.cli import options
from ldbb_bayes.cli.campaigns import ATLAS_FILES, write_atlases
from ldbb_bayes.cli.options import Kind, Output, command, group, option, options_of
from ldbb_bayes.errors import InputError, require

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "compare",
    "demo",
    "design",
    "fit",
    "identify",
    "summarize",
    "validate",
    "with_tolerances",
    "write_result",
]

_DEGREES = ("constant", "linear", "quadratic")
_COLUMNS = ["unit", "prior_sd", "sd", "contraction", "information_gain", "verdict"]


@command
def identify(
    campaign: options.GivenCampaign, model: options.ChosenModel, output: options.OutputOptions
) -> None:
    """What the readings can separate: verdict and confounding of every parameter, exchange rates
    and cures.

    A plan (a campaign without readings) will do: ask before the experiment.
    """
    import pandas as pd

    output.check(
        "identify.json",
        "parameters.csv",
        "alias.csv",
        "correlation.csv",
        *ATLAS_FILES,
        figures=["prior_and_posterior"],
    )
    result = lb.identify(model, campaign)
    record = {
        "schema": 1,
        "campaign": campaign.name,
        "degree": model.degree,
        **lb.with_words(result),
    }
    table = pd.DataFrame.from_dict(record["parameters"], orient="index")
    contents = {
        "identify.json": record,
        "parameters.csv": table[_COLUMNS].rename_axis("parameter").reset_index(),
        "alias.csv": result.alias.rename_axis("parameter").reset_index(),
        "correlation.csv": result.correlation.rename_axis("coefficient").reset_index(),
    }
    output.deliver(
        record,
        (f"Compliance {_DEGREES[model.degree]} in force.", *_with_oddities(result, campaign)),
        contents,
        {"prior_and_posterior": options.drawing("prior_and_posterior", result)},
        also=partial(write_atlases, campaign.machine(), [test.circle for test in campaign.tests]),
    )


def _with_oddities(result: object, campaign: lb.Campaign) -> tuple[Any, ...]:
    """What a result says, and what looks odd about the readings that it takes as they are."""
    from ldbb_bayes.report import text, wording

    seen = lb.preview(campaign)
    odd = [
        f"Note: {wording.remark_words(remark)}"
        for remark in seen.remarks
        if remark.kind in ("unit", "copy")
    ]
    return (*text.parts_of(result), *wording.look_sentences(seen), *odd)


_MODELS = Kind(list[str], lambda entries, flag: options.pairs_in(entries, flag, "NAME=FILE.toml"))
_COMPARE = group(**options_of("compare", models=_MODELS))


@command
def compare(
    campaign: options.GivenCampaign,
    model: options.ChosenModel,
    output: options.OutputOptions,
    asked: Annotated[dict[str, Any], _COMPARE],
) -> None:
    """Constant or linear compliance? Evidence, its sensitivity, leave-one-force-out, which slopes,
    which tests do not fit in.

    Compares constant with linear compliance; with --degree 2 also quadratic. Exit code 1: an
    evidence is less exact than asked.
    """
    got = "got 0: there is nothing to compare with. Use --degree 1 or 2."
    require(model.degree > 0, f"compare must have a degree of at least 1, {got}")
    models = {name: model.with_degree(k) for k, name in enumerate(_DEGREES[: model.degree + 1])}
    for name, file in asked.pop("also", {}).items():
        require(
            name not in models, f"--also must give a new name, got {name!r} again. Choose another."
        )
        models[name] = lb.read_model(file, degree=model.degree)
    names = ("evidence", "compliance_with_local_fits", "geometry_with_local_fits")
    output.check("comparison.json", "local_fits.csv", figures=names)
    with options.counting_progress(output.quiet, "models weighed") as progress:
        result = lb.compare(models, campaign, **asked, progress=progress)
    record = {"schema": 1, "seed": asked["seed"], **lb.with_words(result)}
    contents = {"comparison.json": record, "local_fits.csv": result.local_fits}
    draws = {name: options.drawing(name, result) for name in names}
    output.deliver(record, _with_oddities(result, campaign), contents, draws)
    if not result.within_tolerance:
        raise typer.Exit(options.EXIT_MISSED)


_MOST_VALUES = 5000


def _range(text: str, option: str) -> tuple[float, ...]:
    """LO:HI:STEP, both ends included, or a comma-separated list."""
    if ":" not in text:
        return options.numbers_in(text, option)
    parts = options.numbers_in(text, option, ":")
    if len(parts) != 3 or parts[2] <= 0 or parts[1] < parts[0]:
        raise InputError(
            f"{option} must be LO:HI:STEP with LO ≤ HI and STEP > 0, or a list, got {text!r}. For"
            " example 36:742:1."
        )
    low, high, step = parts
    if (high - low) / step > _MOST_VALUES:
        raise InputError(
            f"{option} must give at most {_MOST_VALUES} values, got {(high - low) / step:.3g}. Take"
            " a longer step."
        )
    steps = math.floor((high - low) / step * (1 + 1e-12))
    return tuple(sorted({*(low + step * i for i in range(steps + 1)), high}))


def _clockings(text: str, option: str) -> tuple[tuple[float, float], ...]:
    """Angles of the work ball, or WORK/TOOL of both."""
    if "/" not in text:
        return tuple((angle, 0.0) for angle in _range(text, option))
    pairs = [options.numbers_in(part, option, "/") for part in text.split(",")]
    if any(len(pair) != 2 for pair in pairs):
        raise InputError(
            f"{option} must be all angles of the work ball, or all WORK/TOOL, got {text!r}. For"
            " example 0/0,45/90."
        )
    return tuple((work, tool) for work, tool in pairs)


_CHOSEN = {
    "range": Kind(str, _range),
    "clockings": Kind(str, _clockings),
    "designs": Kind(
        list[str],
        lambda entries, flag: {
            name: lb.read_campaign(Path(path))
            for name, path in options.pairs_in(entries, flag, "NAME=PATH").items()
        },
    ),
}
_DESIGN = group(**options_of("design", **_CHOSEN))


@command
def design(
    campaign: options.GivenCampaign,
    model: options.ChosenModel,
    output: options.OutputOptions,
    asked: Annotated[dict[str, Any], _DESIGN],
) -> None:
    """The best tests to run next, how good they are, and what they will show. A plan will do as
    pilot.

    --out DIR becomes a plan (campaign.toml) that identify and simulate read, in the order in which
    to run it, with the model for its analysis. Exit code 1: not proven best.
    """
    from ldbb_bayes.campaign.folder import write_campaign_into
    from ldbb_bayes.model.specification import model_to_toml

    output.check(
        "campaign.toml",
        "model.toml",
        "design.json",
        "expected.csv",
        "sensitivity.csv",
        figures=["expected_widths"],
    )
    result = lb.design(model, campaign, **asked)
    record = {"schema": 1, "seed": asked["seed"], **lb.with_words(result)}
    plan = result.plan(seed=asked["seed"])
    contents = {
        "model.toml": model_to_toml(result.model),
        "design.json": record,
        "expected.csv": result.expected_table(),
        "sensitivity.csv": result.sensitivity,
    }
    own = [
        (
            t.direction or "–",
            f"{t.radius_mm:g} mm",
            f"balls {t.work_ball_deg:g}/{t.tool_ball_deg:g}°",
        )
        for t in plan.tests
    ]
    varied = [k for k, values in enumerate(zip(*own, strict=True)) if len(set(values)) > 1]
    settings = [f" ({', '.join(values[k] for k in varied)})" if varied else "" for values in own]
    order = ", ".join(test.name + text for test, text in zip(plan.tests, settings, strict=True))
    output.deliver(
        record,
        (*_with_oddities(result, campaign), f"Run in this order: {order}"),
        contents,
        {"expected_widths": options.drawing("expected_widths", result)},
        also=partial(write_campaign_into, plan),
        more=", a plan; model.toml is for its analysis (fit --model)",
    )
    if not result.certificate.holds:
        raise typer.Exit(options.EXIT_MISSED)


@command
def validate(
    plan: options.CampaignArgument,
    model: options.ChosenModel,
    certificates: options.Certificates,
    output: options.OutputOptions,
    asked: Annotated[dict[str, Any], group(**options_of("validate"))],
    pool: options.PoolOptions,
) -> None:
    """Simulation-based calibration on a plan (or the plan of a campaign): truths from the priors,
    readings, posterior, ranks.

    Exit code 1 when ranks are not uniform.
    """
    import pandas as pd

    from ldbb_bayes.parallel import executor_named
    from ldbb_bayes.report.figures import rank_ecdf

    if "data_model" in asked:
        asked["generator"] = lb.read_model(asked.pop("data_model"), degree=model.degree)
    campaign = options.campaign_from(plan, **certificates)
    output.check("validation.json", "ranks.csv", figures=["rank_ecdf"])
    with (
        executor_named(**pool) as executor,
        options.counting_progress(output.quiet, "simulated campaigns") as progress,
    ):
        result = lb.validate(model, campaign, **asked, executor=executor, progress=progress)
    record = {
        "schema": 1,
        "campaign": campaign.name,
        "seed": asked["seed"],
        **lb.with_words(result),
    }
    ranks = (
        pd.DataFrame(result.ranks, columns=list(result.names))
        .rename_axis("replicate")
        .reset_index()
    )
    output.deliver(
        record,
        result,
        {"validation.json": record, "ranks.csv": ranks},
        {"rank_ecdf": partial(rank_ecdf, result)},
    )
    if not result.calibrated:
        raise typer.Exit(options.EXIT_MISSED)


RESULT_FILES = (
    "posterior.nc",
    "summary.json",
    "model.toml",
    "report.html",
    "report.json",
    "tables",
)


@command
def fit(
    campaign: options.GivenCampaign,
    model: options.ChosenModel,
    output: options.OutputOptions,
    asked: Annotated[dict[str, Any], group(**options_of("fit"))],
    tolerances: options.Tolerances,
    prior_from: Annotated[Path | None, options.PRIOR_FROM],
) -> None:
    """Credible intervals on compliances, force slopes and geometric errors. Exit code 1 when the
    sampler missed its target."""
    from ldbb_bayes.inference.summary import check_probability
    from ldbb_bayes.report.text import full_result, parts_of_fit

    check_probability(asked["ci_prob"])
    population: dict[str, Any] = {}
    if prior_from is not None:
        prior = lb.prior_from(prior_from)
        doubts = prior.doubts(campaign)
        said = {key: getattr(prior, key) for key in ("machines", "campaigns", "sha256")}
        for doubt in doubts:
            typer.echo(f"--prior-from: {doubt}", err=True)
        model = prior.model(model)
        population = {"prior_from": {"path": str(prior_from), **said, "doubts": list(doubts)}}
    campaign = with_tolerances(campaign, model, tolerances)
    output.check(*RESULT_FILES)
    rule = lb.StoppingRule(ess=asked["ess"], max_steps=asked["max_steps"])
    with options.sampling_progress(output.quiet, "sampling") as progress:
        posterior = lb.sample(
            model,
            campaign,
            sampler=asked["sampler"],
            seed=asked["seed"],
            rule=rule,
            progress=progress,
        )
    result = full_result(posterior, asked["ci_prob"]) | population
    output.deliver(result, parts_of_fit(result), also=partial(write_result, posterior, result))
    if not result["sampler"]["converged"]:
        raise typer.Exit(options.EXIT_MISSED)


def with_tolerances(
    campaign: lb.Campaign, model: lb.HybridModel, given: Mapping[str, str]
) -> lb.Campaign:
    """The campaign with these tolerances beside its own; those that the model has nothing for are
    refused before any work."""
    from ldbb_bayes.analysis.conformity import quantities_of, tolerances_in
    from ldbb_bayes.units import inside_name

    campaign = replace(
        campaign,
        tolerances={
            **campaign.tolerances,
            **{inside_name(name): own for name, own in given.items()},
        },
    )
    if campaign.tolerances:
        tolerances_in(quantities_of(model.bind(campaign)), campaign.tolerances)
    return campaign


@command
def summarize(
    result: Annotated[
        Path,
        typer.Argument(help="The --out folder of a fit, or its posterior.nc.", metavar="RESULT"),
    ],
    as_json: Annotated[bool, options.JSON],
    ci: Annotated[float, options.CI],
) -> None:
    """Table or JSON of a stored posterior, with intervals of any probability."""
    from ldbb_bayes.report.text import full_result, parts_of_fit

    numbers = full_result(lb.load(result), ci)
    Output(as_json=as_json).deliver(numbers, parts_of_fit(numbers))


def write_result(posterior: xr.DataTree, result: Mapping[str, Any], folder: Path) -> None:
    """posterior.nc, summary.json and model.toml of a fit, into a folder that is made."""
    from ldbb_bayes.inference.posterior import record_of

    folder.mkdir(exist_ok=True)
    lb.save(posterior, folder / "posterior.nc")
    options.write_files(
        folder, {"summary.json": result, "model.toml": record_of(posterior)["model"]["toml"]}
    )


DEMO_FILES = ("campaign", "constant", "linear", "figures")


@command
def demo(
    out: Annotated[
        Path,
        option(Path, "Folder to write results and figures to.", Path("ldbb_demo"), metavar="DIR"),
    ],
    force: Annotated[bool, options.FORCE],
    seed: Annotated[int, options.SEED],
    as_json: Annotated[bool, options.JSON],
    quiet: Annotated[bool, options.QUIET],
) -> None:
    """Fit constant and linear compliance to the published experiment, and say what it means.

    The readings are recovered from the printed tables of the paper; what in them is not data is
    said in the folder's README.
    """
    import shutil

    from ldbb_bayes.files import check_target, staged_folder
    from ldbb_bayes.report import wording
    from ldbb_bayes.report.text import full_result, results_table

    check_target(out, force=force, ours=DEMO_FILES)
    source = lb.embedded_campaign()
    campaign = lb.read_campaign(source)
    models = {"constant": lb.HybridModel.default(0), "linear": lb.HybridModel.default(1)}
    fits = {}
    for name, model in models.items():
        with options.sampling_progress(quiet, name) as progress:
            fits[name] = lb.sample(model, campaign, seed=seed, progress=progress)
    with options.counting_progress(quiet, "models compared") as told:
        comparison = lb.compare(models, campaign, evidence_only=True, seed=seed, progress=told)
    results = {name: full_result(posterior, 0.95) for name, posterior in fits.items()}
    with staged_folder(out, force=force, ours=DEMO_FILES) as staging:
        shutil.copytree(source, staging / "campaign")
        for name, posterior in fits.items():
            write_result(posterior, results[name], staging / name)
        lb.save_figures(fits["linear"], staging / "figures")
        document = lb.write_report(fits["linear"], staging / "linear", comparison=comparison)
    parts: list[Any] = []
    for name, posterior in fits.items():
        parts += [
            f"{name.capitalize()} compliance",
            results_table(results[name], lb.verdicts(posterior)),
        ]
    parts += [
        wording.comparison_sentences(comparison)[0],
        document.state,
        "",
        f"Report: {out}/linear/report.html",
    ]
    parts.append(
        f"Files: {out}/campaign, {out}/constant, {out}/linear, {out}/figures (PNG and SVG)"
    )
    Output(as_json=as_json).deliver({"schema": 1, "out": str(out), **results}, tuple(parts))
    if not all(result["sampler"]["converged"] for result in results.values()):
        raise typer.Exit(options.EXIT_MISSED)
