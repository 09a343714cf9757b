"""``ldbb-bayes demo``, ``fit``, ``summarize``, ``report``, ``identify``, ``compare``, ``design``, ``validate``: one campaign."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import ldbb_bayes as lb
from ldbb_bayes.cli import options
from ldbb_bayes.cli.campaigns import ATLAS_FILES, write_atlases
from ldbb_bayes.cli.options import (
    CI,
    NAMES,
    SEED,
    Kind,
    Output,
    command,
    counting_progress,
    finite_number,
    group,
    option,
    pairs_in,
    sampling_progress,
)
from ldbb_bayes.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["compare", "demo", "design", "figure_names", "fit", "identify", "report", "summarize", "validate", "write_result"]

_DEGREES = ("constant", "linear", "quadratic")


@command
def identify(campaign: options.GivenCampaign, model: options.ChosenModel, output: options.OutputOptions) -> None:
    """What the data can tell apart: verdict and confounding of every parameter, degeneracies and their cures.

    A plan (a campaign without readings) will do: ask before the experiment.
    """
    from ldbb_bayes.report.text import parameters_frame, parts_of

    drawn = {
        "correlation": "correlation_map",
        "prior_and_posterior": "prior_and_posterior",
        "alias": "alias_map",
        "nuisance_costs": "nuisance_costs",
    }
    output.check("identify.json", "parameters.csv", "alias.csv", "correlation.csv", *ATLAS_FILES, figures=drawn)
    result = lb.identify(model, campaign)
    record = {"schema": 1, "campaign": campaign.name, "degree": model.degree, **lb.with_words(result)}
    contents = {
        "identify.json": record,
        "parameters.csv": parameters_frame(result),
        "alias.csv": result.alias.rename_axis("parameter").reset_index(),
        "correlation.csv": result.correlation.rename_axis("coefficient").reset_index(),
    }
    output.deliver(
        record,
        (f"Compliance {_DEGREES[model.degree]} in force.", *parts_of(result)),
        contents,
        {name: options.drawing(draw, result) for name, draw in drawn.items()},
        also=partial(write_atlases, campaign.machine(), [test.circle for test in campaign.tests]),
        written=f"{output.out}/identify.json, tables (CSV) and figures (PNG and SVG)",
    )


def _models(entries: list[str], flag: str) -> dict[str, Path]:
    return {name: Path(file) for name, file in pairs_in(entries, flag, "NAME=FILE.toml").items()}


_COMPARE = group(
    also=option(Kind(list[str], _models, "NAME=FILE"), "Another model to compare, as NAME=FILE.toml; can be repeated."),
    quadratic=option(bool, "Choose constant, linear or quadratic for every compliance apart (minutes).", False),
    leave_out=option(str, "What leave-one-out leaves out: test. Readings are refused.", "test"),
    tolerance=option(float, "Error asked of every log evidence (nat).", 1e-2),
    ci=CI,
    seed=SEED,
)


@command
def compare(
    campaign: options.GivenCampaign,
    model: options.ChosenModel,
    output: options.OutputOptions,
    asked: Annotated[dict[str, Any], _COMPARE],
) -> None:
    """Constant or linear compliance? Evidence, its sensitivity, leave-one-force-out, which slopes, which tests do not belong.

    Compares constant with linear compliance; with --degree 2 also quadratic. Exit code 1: an evidence is less exact than asked.
    """
    from ldbb_bayes.report.text import left_out_frame, sensitivity_frame, subsets_frame

    if model.degree == 0:
        raise InputError(
            "compare must have a degree of at least 1, got 0: there is nothing to compare with. Use --degree 1 or 2."
        )
    models = {name: model.with_degree(k) for k, name in enumerate(_DEGREES[: model.degree + 1])}
    for name, file in asked.pop("also", {}).items():
        if name in models:
            raise InputError(f"--also must give a new name, got {name!r} again. Choose another.")
        models[name] = lb.read_model(file, degree=model.degree)
    tables = ("sensitivity.csv", "slope_subsets.csv", "tests.csv", "local_fits.csv")
    names = ("evidence", "compliance_with_local_fits", "geometry_with_local_fits", "predictive_p_values")
    output.check("comparison.json", *tables, figures=names)
    with counting_progress(output.quiet, "models weighed") as progress:
        result = lb.compare(models, campaign, **asked, progress=progress)
    record = {"schema": 1, "seed": asked["seed"], **lb.with_words(result)}
    frames = (sensitivity_frame(result), subsets_frame(result), left_out_frame(result), result.local_fits)
    contents = {"comparison.json": record, **dict(zip(tables, frames, strict=True))}
    written = f"{output.out}/comparison.json, tables (CSV) and figures (PNG and SVG)"
    draws = {name: options.drawing(name, result) for name in names}
    output.deliver(record, result, contents, draws, written=written)
    if not result.within_tolerance:
        raise typer.Exit(options.EXIT_MISSED)


_MOST_VALUES = 5000


def _range(text: str, option: str) -> tuple[float, ...]:
    """LO:HI:STEP, both ends included, or a comma-separated list."""
    if ":" not in text:
        return tuple(finite_number(part.strip(), option) for part in text.split(","))
    parts = [finite_number(part, option) for part in text.split(":")]
    if len(parts) != 3 or parts[2] <= 0 or parts[1] < parts[0]:
        raise InputError(f"{option} must be LO:HI:STEP with LO ≤ HI and STEP > 0, or a list, got {text!r}. For example 36:742:1.")
    low, high, step = parts
    if (high - low) / step > _MOST_VALUES:
        raise InputError(f"{option} must give at most {_MOST_VALUES} values, got {(high - low) / step:.3g}. Take a longer step.")
    steps = math.floor((high - low) / step * (1 + 1e-12))
    return tuple(sorted({*(low + step * i for i in range(steps + 1)), high}))


def _clockings(text: str, option: str) -> tuple[tuple[float, float], ...]:
    """Angles of the work ball, or WORK/TOOL of both."""
    if "/" not in text:
        return tuple((angle, 0.0) for angle in _range(text, option))
    pairs = [part.strip().split("/") for part in text.split(",")]
    if any(len(pair) != 2 or not all(pair) for pair in pairs):
        raise InputError(f"{option} must be all angles of the work ball, or all WORK/TOOL, got {text!r}. For example 0/0,45/90.")
    return tuple((finite_number(work, option), finite_number(tool, option)) for work, tool in pairs)


def _targets(entries: list[str], flag: str) -> dict[str, float]:
    return {name: finite_number(value, flag) for name, value in pairs_in(entries, flag, "NAME=SD").items()}


def _designs(entries: list[str], flag: str) -> dict[str, Any]:
    return {name: lb.read_campaign(Path(path)) for name, path in pairs_in(entries, flag, "NAME=PATH").items()}


_FEWEST = "Instead of --tests: the fewest circles"
_LEVELS = "LO:HI:STEP or LIST"
_DESIGN = group(
    tests=option(int, "Number of circles. Default: as many as the pilot has."),
    budget=option(float, "Instead of --tests: what they may cost."),
    target=option(
        Kind(list[str], _targets, "NAME=SD"),
        f"{_FEWEST} for this expected sd, as NAME=SD in mm, N, rad; can be repeated.",
        to="targets",
    ),
    power=option(float, f"{_FEWEST} that find slopes with this probability."),
    forces=option(Kind(str, _range, _LEVELS), "Levels to choose from (N). Default: the pilot's range, 1 N.", to="forces_N"),
    clockings=option(
        Kind(str, _clockings, _LEVELS),
        "Clockings to choose from (°): of the work ball, or WORK/TOOL of both.",
        "0",
        "clockings_deg",
    ),
    radii=option(Kind(str, _range, "LIST"), "Radii to choose from (mm). Default: the pilot's.", to="radii_mm"),
    planes=option(NAMES, "Planes to choose from. Default: the pilot's."),
    directions=option(NAMES, "Directions of travel to choose from: CW,CCW. Default: the pilot's."),
    centre=option(options.POINTS, "Centre to choose from (mm); can be repeated. Default: the pilot's.", to="centres_mm"),
    readings=option(int, "Readings per full circle. Default: as in the pilot.", min=25),
    criterion=option(str, "eig (default), d (default for flat priors), a, c, i, e or discriminate."),
    parameters=option(NAMES, "Parameters of interest, comma-separated. Default: all.", metavar=None),
    augment=option(bool, "The pilot's tests count as run; the new ones are added.", False),
    cost_circle=option(float, "Cost of a circle.", 1.0),
    cost_work_ball=option(float, "Cost of each change of the work ball's clocking.", 0.0),
    cost_tool_ball=option(float, "Cost of each change of the tool ball's clocking.", 0.0),
    against=option(
        Kind(list[str], _designs, "NAME=PATH"), "Another design to judge: a plan or campaign, as NAME=PATH; can be repeated."
    ),
    slope_size=option(float, "Slopes that are to be found, in prior sd.", 1.0),
    threshold=option(float, "|ln B| called decisive (nat).", 5.0),
    robust=option(bool, "A design good over several assumptions.", False),
    seed=SEED,
)


@command
def design(
    campaign: options.GivenCampaign,
    model: options.ChosenModel,
    output: options.OutputOptions,
    asked: Annotated[dict[str, Any], _DESIGN],
) -> None:
    """The best tests to run next, how good they are, and what they will tell. A plan will do as pilot.

    --out DIR becomes a plan (campaign.toml) that identify and simulate read, in the order in which to run it, with the model for
    its analysis. Exit code 1: a target or power that is not reached, or the certificate that nothing is better does not hold.
    """
    from ldbb_bayes.campaign.folder import write_campaign_into
    from ldbb_bayes.model.specification import model_to_toml
    from ldbb_bayes.report.text import parts_of

    names = ("information", "efficiency", "trade_off", "expected_widths")
    tables = ("expected.csv", "sensitivity.csv", "trade_off.csv", "robustness.csv")
    output.check("campaign.toml", "model.toml", "design.json", *tables, figures=names)
    costs = lb.Costs(*(asked.pop(f"cost_{what}") for what in ("circle", "work_ball", "tool_ball")))
    result = lb.design(model, campaign, **asked, costs=costs, curve=output.out is not None)
    record = {"schema": 1, "seed": asked["seed"], **lb.with_words(result)}
    plan = result.plan(seed=asked["seed"])
    contents = {
        "model.toml": model_to_toml(result.model),
        "design.json": record,
        "expected.csv": result.expected_table(),
        "sensitivity.csv": result.sensitivity,
        "trade_off.csv": result.trade_off,
    }
    if not result.robustness.empty:
        contents["robustness.csv"] = result.robustness.rename_axis("design").reset_index()
    order = f"Run in this order: {', '.join(test.name for test in plan.tests)}"
    written = "the plan (campaign.toml), model.toml (for its analysis: fit --model), design.json, tables (CSV) and figures"
    output.deliver(
        record,
        (*parts_of(result), order),
        contents,
        {name: options.drawing(name, result) for name in names},
        also=partial(write_campaign_into, plan),
        written=f"{output.out}, {written}",
    )
    if not (result.certificate.holds and result.reached):
        raise typer.Exit(options.EXIT_MISSED)


_VALIDATE = group(
    data_model=option(Path, "Draw the readings from this model instead, to see what a wrong model does.", metavar="FILE.toml"),
    sampler=options.SAMPLER,
    replicates=option(int, "Simulated campaigns.", 100),
    draws=option(int, "Posterior draws of each.", 99),
    seed=SEED,
)


@command
def validate(
    plan: options.CampaignArgument,
    model: options.ChosenModel,
    output: options.OutputOptions,
    asked: Annotated[dict[str, Any], _VALIDATE],
    pool: options.PoolOptions,
) -> None:
    """Simulation-based calibration on a plan (or the plan of a campaign): truths from the priors, readings, posterior, ranks.

    Exit code 1 when ranks are not uniform.
    """
    import pandas as pd

    from ldbb_bayes.jobs import executor_named
    from ldbb_bayes.report.figures import rank_ecdf

    if "data_model" in asked:
        asked["generator"] = lb.read_model(asked.pop("data_model"), degree=model.degree)
    campaign = options.campaign_from(plan)
    output.check("validation.json", "ranks.csv", figures=["rank_ecdf"])
    with executor_named(**pool) as executor, counting_progress(output.quiet, "simulated campaigns") as progress:
        result = lb.validate(model, campaign, **asked, executor=executor, progress=progress)
    record = {"schema": 1, "campaign": campaign.name, "seed": asked["seed"], **lb.with_words(result)}
    ranks = pd.DataFrame(result.ranks, columns=list(result.names)).rename_axis("replicate").reset_index()
    output.deliver(record, result, {"validation.json": record, "ranks.csv": ranks}, {"rank_ecdf": partial(rank_ecdf, result)})
    if not result.calibrated:
        raise typer.Exit(options.EXIT_MISSED)


RESULT_FILES = ("posterior.nc", "summary.json", "model.toml", "report.html", "report.json", "tables")


_FIT = group(
    sampler=option(str, "joint (emcee over everything) or independent (exact draws from weighted nodes).", "joint"),
    ess=options.ESS,
    max_steps=option(int, "Steps of each ensemble at which sampling gives up.", 20_000, min=200),
    seed=SEED,
    ci=CI,
)


@command
def fit(
    campaign: options.GivenCampaign,
    model: options.ChosenModel,
    output: options.OutputOptions,
    asked: Annotated[dict[str, Any], _FIT],
    prior_from: options.PriorFromOption = None,
) -> None:
    """Credible intervals on compliances, force slopes and geometric errors. Exit code 1 when the sampler missed its target."""
    from ldbb_bayes.inference.posterior import check_probability
    from ldbb_bayes.report.findings import full_result

    check_probability(asked["ci_prob"])
    chosen, population = _with_population(model, prior_from, campaign)
    output.check(*RESULT_FILES)
    rule = lb.StoppingRule(ess=asked["ess"], max_steps=asked["max_steps"])
    with sampling_progress(output.quiet, "sampling") as progress:
        posterior = lb.sample(chosen, campaign, sampler=asked["sampler"], seed=asked["seed"], rule=rule, progress=progress)
    result = full_result(posterior, asked["ci_prob"]) | population
    written = f"{output.out}/posterior.nc, summary.json, model.toml"
    output.deliver(result, _parts_of_fit(result), also=partial(write_result, posterior, result), written=written)
    if not result["sampler"]["converged"]:
        raise typer.Exit(options.EXIT_MISSED)


def _with_population(model: lb.HybridModel, path: Path | None, campaign: lb.Campaign) -> tuple[lb.HybridModel, dict[str, Any]]:
    """The model with the prior that --prior-from names, and what a result says of it; its doubts go to stderr."""
    if path is None:
        return model, {}
    prior = lb.prior_from(path)
    doubts = prior.doubts(campaign)
    for doubt in doubts:
        typer.echo(f"--prior-from: {doubt}", err=True)
    said = {"path": str(path), "machines": prior.machines, "campaigns": prior.campaigns}
    return prior.model(model), {"prior_from": said | {"sha256": prior.sha256, "doubts": list(doubts)}}


@command
def summarize(
    result: Annotated[Path, typer.Argument(help="The --out folder of a fit, or its posterior.nc.", metavar="RESULT")],
    as_json: options.JsonOption = False,
    ci: options.CiOption = 0.95,
) -> None:
    """Table or JSON of a stored posterior, with intervals of any probability."""
    from ldbb_bayes.report.findings import full_result

    numbers = full_result(lb.load(result), ci)
    Output(as_json=as_json).deliver(numbers, _parts_of_fit(numbers))


def write_result(posterior: xr.DataTree, result: Mapping[str, Any], folder: Path) -> None:
    """posterior.nc, summary.json and model.toml of a fit, into a folder that is made."""
    from ldbb_bayes.inference.posterior import record_of

    folder.mkdir(exist_ok=True)
    lb.save(posterior, folder / "posterior.nc")
    options.write_files(folder, {"summary.json": result, "model.toml": record_of(posterior)["model"]["toml"]})


def _parts_of_fit(result: Mapping[str, Any]) -> tuple[Any, ...]:
    from ldbb_bayes.report.text import parts_of_fit

    own = result.get("prior_from")
    said = own and f"population of {own['machines']} machines, {own['campaigns']} campaigns ({own['path']})"
    return (*parts_of_fit(result), *([f"Prior of the compliances: {said}."] if own else []))


_FORMATS = ("svg", "png", "pdf")


@command
def report(
    result: Annotated[
        list[Path], typer.Argument(help="The --out folder of a fit; more of them are set beside the first.", metavar="RESULT...")
    ],
    out: Annotated[Path | None, typer.Option(help="Folder to write to. Default: RESULT.", metavar="DIR")] = None,
    force: options.ForceOption = False,
    comparison: Annotated[
        Path | None, typer.Option(help="The --out folder of an earlier compare of the same readings.", metavar="DIR")
    ] = None,
    design: Annotated[
        Path | None, typer.Option(help="The --out folder of an earlier design after the same readings.", metavar="DIR")
    ] = None,
    tests: Annotated[int | None, typer.Option(help="Circles to recommend. Default: as many as were run.", min=1, max=300)] = None,
    same_instrument: Annotated[
        bool, typer.Option("--same-instrument", help="Campaigns beside one another share bar, balls, mount and force device.")
    ] = False,
    figures: Annotated[
        Path | None,
        typer.Option(help="Folder for the figures of the page and the analyses' others, as SVG, PNG and PDF.", metavar="DIR"),
    ] = None,
    as_json: options.JsonOption = False,
    ci: options.CiOption = 0.95,
    quiet: options.QuietOption = False,
) -> None:
    """One self-contained page: results, what the data cannot tell, budgets, circular-test quantities, next tests.

    Writes report.html, report.json and tables (CSV) into RESULT, working out what the fit did not keep. Exit code 1
    when the fit had missed its target; the page then says so at its top.
    """
    from ldbb_bayes.files import check_target, staged_folder
    from ldbb_bayes.inference.posterior import check_probability, record_of
    from ldbb_bayes.jobs import process_executor
    from ldbb_bayes.report.findings import compare_for_report, sizes_of
    from ldbb_bayes.report.page import REPORT_FILES
    from ldbb_bayes.units import units_for

    check_probability(ci)
    folder = out or (result[0] if result[0].is_dir() else result[0].parent)
    there = next((name for name in REPORT_FILES if (folder / name).exists()), None)
    if there is not None and not force:
        raise InputError(f"{folder / there} must not exist, got an earlier report. Choose another --out or pass --force.")
    if figures is not None:
        check_target(figures, force=force, ours=figure_names())
    if design is not None and tests is not None:
        raise InputError("--tests must not go with --design, got both. The design says how many.")
    if same_instrument and len(result) == 1:
        raise InputError("--same-instrument must go with a second RESULT, got one alone. Name the campaign to set beside it.")
    # The comparison is the longest part and waits for nothing.
    beside = process_executor(1) if comparison is None else nullcontext()
    with beside as executor, counting_progress(quiet, "sections") as progress:
        running = None if executor is None else executor.submit(compare_for_report, result[0])
        first, *others = (lb.load(path) for path in result)
        document = lb.write_report(
            first,
            folder,
            beside_it=_named(first, others, result[1:]),
            same_instrument=same_instrument,
            ci_prob=ci,
            tests=tests,
            comparison=running if comparison is None else lb.read_comparison(comparison),
            recommended=None if design is None else lb.read_design(design),
            progress=progress,
        )
    if figures is not None:
        with staged_folder(figures, force=force, ours=figure_names()) as staging:
            for picture in document.pictures:
                lb.figures.save_figure(picture.figure, staging, picture.key, formats=_FORMATS)
            with units_for(sizes_of(first)):
                for name, draw in document.further.items():
                    lb.figures.save_figure(draw(), staging, name, formats=_FORMATS)
    if as_json:
        typer.echo((folder / "report.json").read_text(encoding="utf-8"), nl=False)
    else:
        for alert in document.alerts:
            typer.echo(f"Note: {alert}")
        drawn = "" if figures is None else f"; figures: {figures}"
        typer.echo(f"Written: {', '.join(f'{folder}/{name}' for name in REPORT_FILES)}{drawn}")
    if not record_of(first)["sampler"]["converged"]:
        raise typer.Exit(options.EXIT_MISSED)


def figure_names() -> tuple[str, ...]:
    """Figures that may be replaced: those of an earlier report."""
    others = "budget differences evidence compliance_with_local_fits geometry_with_local_fits predictive_p_values expected_widths"
    others += " information efficiency nuisance_costs prior_and_posterior alias correlation"
    return options.figure_files(sorted({*lb.figures.FIGURES, *others.split()}), _FORMATS)


def _named(first: xr.DataTree, posteriors: list[xr.DataTree], paths: list[Path]) -> dict[str, xr.DataTree]:
    """Keyed by the campaign's name; by the folder's where two have the same."""
    from ldbb_bayes.inference.posterior import record_of

    names = [str(record_of(posterior)["campaign"]["name"]) for posterior in (first, *posteriors)]
    keys = (
        names[1:] if len(set(names)) == len(names) else [f"{name} ({path})" for name, path in zip(names[1:], paths, strict=True)]
    )
    return dict(zip(keys, posteriors, strict=True))


DEMO_FILES = ("campaign", "constant", "linear", "figures")


@command
def demo(
    out: Annotated[Path, typer.Option(help="Folder to write results and figures to.", metavar="DIR")] = Path("ldbb_demo"),
    force: options.ForceOption = False,
    seed: options.SeedOption = 1,
    as_json: options.JsonOption = False,
    quiet: options.QuietOption = False,
) -> None:
    """Fit constant and linear compliance to the published experiment, and say what it means.

    The readings are recovered from the printed tables of the paper; what in them is not data is said in the folder's README.
    """
    import shutil

    from ldbb_bayes.files import check_target, staged_folder
    from ldbb_bayes.jobs import process_executor
    from ldbb_bayes.report.findings import compare_for_report, full_result
    from ldbb_bayes.report.text import results_table
    from ldbb_bayes.report.wording import two_fits_sentences

    check_target(out, force=force, ours=DEMO_FILES)
    source = lb.embedded_campaign()
    campaign = lb.read_campaign(source)
    fits = {}
    for name, degree in (("constant", 0), ("linear", 1)):
        with sampling_progress(quiet, name) as progress:
            fits[name] = lb.sample(lb.HybridModel.default(degree), campaign, seed=seed, progress=progress)
    results = {name: full_result(posterior, 0.95) for name, posterior in fits.items()}
    with process_executor(1) as executor, staged_folder(out, force=force, ours=DEMO_FILES) as staging:
        shutil.copytree(source, staging / "campaign")
        for name, posterior in fits.items():
            write_result(posterior, results[name], staging / name)
        running = executor.submit(compare_for_report, staging / "linear")
        lb.save_figures(fits["linear"], staging / "figures")
        lb.write_report(fits["linear"], staging / "linear", comparison=running)
    parts: list[Any] = []
    for name, posterior in fits.items():
        parts += [f"{name.capitalize()} compliance", results_table(results[name], lb.verdicts(posterior))]
    parts += [*two_fits_sentences(results["constant"], results["linear"]), "", f"Report: {out}/linear/report.html"]
    parts.append(f"Files: {out}/campaign, {out}/constant, {out}/linear, {out}/figures (PNG and SVG)")
    Output(as_json=as_json).deliver({"schema": 1, "out": str(out), **results}, tuple(parts))
    if not all(result["sampler"]["converged"] for result in results.values()):
        raise typer.Exit(options.EXIT_MISSED)
