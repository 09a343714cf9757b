"""``ldbb-bayes identify``, ``compare``, ``design``, ``validate``: what readings tell, or would tell."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ldbb_bayes.cli.campaigns import ATLAS_FILES, write_atlases
from ldbb_bayes.cli.options import (
    CampaignArgument,
    ChosenModel,
    CiOption,
    ExecutorOption,
    GivenCampaign,
    Output,
    SchedulerOption,
    SeedOption,
    WorkersOption,
    campaign_from,
    command,
    names_in,
    pairs_in,
    three_numbers,
)
from ldbb_bayes.cli.show import counting_progress, figure_files, show, write_files
from ldbb_bayes.errors import InputError

if TYPE_CHECKING:
    from ldbb_bayes.analysis.design.design import Design
    from ldbb_bayes.campaign.campaign import Campaign

__all__ = ["compare", "design", "identify", "validate"]


@command
def identify(campaign: GivenCampaign, model: ChosenModel, output: Output) -> None:
    """What the data can tell apart: verdict and confounding of every parameter, degeneracies and their cures.

    A plan (a campaign without readings) will do: ask before the experiment.
    """
    from ldbb_bayes.analysis.identifiability import identify as run
    from ldbb_bayes.report import figures
    from ldbb_bayes.report.text import parameters_frame, parts_of
    from ldbb_bayes.report.wording import with_words

    drawn = ("correlation", "prior_and_posterior", "alias", "nuisance_costs")
    files = ("identify.json", "parameters.csv", "alias.csv", "correlation.csv", *figure_files(drawn), *ATLAS_FILES)
    output.check(files)
    result = run(model, campaign)
    record = {"schema": 1, "campaign": campaign.name, "degree": model.degree, **with_words(result)}

    def write(folder: Path) -> None:
        tables = {
            "parameters.csv": parameters_frame(result),
            "alias.csv": result.alias.rename_axis("parameter").reset_index(),
            "correlation.csv": result.correlation.rename_axis("coefficient").reset_index(),
        }
        draws = (figures.correlation_map, figures.prior_and_posterior, figures.alias_map, figures.nuisance_costs)
        write_files(
            folder, {"identify.json": record, **tables}, dict(zip(drawn, (partial(d, result) for d in draws), strict=True))
        )
        write_atlases(campaign.machine(), [test.circle for test in campaign.tests], folder)

    degree = ("constant", "linear", "quadratic")[model.degree]
    written = f"{output.out}/identify.json, tables (CSV) and figures (PNG and SVG)"
    output.deliver(record, files, write, lambda: show(f"Compliance {degree} in force.", *parts_of(result)), written)


@command
def compare(
    campaign: GivenCampaign,
    model: ChosenModel,
    output: Output,
    also: Annotated[
        list[str] | None, typer.Option(help="Another model to compare, as NAME=FILE.toml; can be repeated.", metavar="NAME=FILE")
    ] = None,
    quadratic: Annotated[
        bool, typer.Option("--quadratic", help="Choose constant, linear or quadratic for every compliance apart (minutes).")
    ] = False,
    leave_out: Annotated[str, typer.Option(help="What leave-one-out leaves out: test. Readings are refused.")] = "test",
    tolerance: Annotated[float, typer.Option(help="Error asked of every log evidence (nat).")] = 1e-2,
    ci: CiOption = 0.95,
    seed: SeedOption = 1,
) -> None:
    """Constant or linear compliance? Evidence, its sensitivity, leave-one-force-out, which slopes, which tests do not belong.

    Compares constant with linear compliance; with --degree 2 also quadratic. Exit code 1: an evidence is less exact than asked.
    """
    from ldbb_bayes.analysis.comparison import compare as run
    from ldbb_bayes.model.specification import read_model
    from ldbb_bayes.report import figures
    from ldbb_bayes.report.text import left_out_frame, parts_of, sensitivity_frame, subsets_frame
    from ldbb_bayes.report.wording import with_words

    if model.degree == 0:
        raise InputError(
            "compare must have a degree of at least 1, got 0: there is nothing to compare with. Use --degree 1 or 2."
        )
    models = {name: model.with_degree(k) for k, name in enumerate(("constant", "linear", "quadratic")[: model.degree + 1])}
    for name, file in pairs_in(also, "--also", "NAME=FILE.toml").items():
        if name in models:
            raise InputError(f"--also must give a new name, got {name!r} again. Choose another.")
        models[name] = read_model(Path(file), degree=model.degree)
    drawn = ("evidence", "compliance_with_local_fits", "geometry_with_local_fits", "predictive_p_values")
    tables = ("sensitivity.csv", "slope_subsets.csv", "tests.csv", "local_fits.csv")
    files = ("comparison.json", *tables, *figure_files(drawn))
    output.check(files)
    with counting_progress(output.quiet, "models weighed") as progress:
        result = run(
            models,
            campaign,
            quadratic=quadratic,
            leave_out=leave_out,  # type: ignore[arg-type]
            tolerance=tolerance,
            ci_prob=ci,
            seed=seed,
            progress=progress,
        )
    record = {"schema": 1, "seed": seed, **with_words(result)}

    def write(folder: Path) -> None:
        frames = (sensitivity_frame(result), subsets_frame(result), left_out_frame(result), result.local_fits)
        draws = {name: partial(getattr(figures, name), result) for name in drawn}
        write_files(folder, {"comparison.json": record, **dict(zip(tables, frames, strict=True))}, draws)

    written = f"{output.out}/comparison.json, tables (CSV) and figures (PNG and SVG)"
    output.deliver(record, files, write, lambda: show(*parts_of(result)), written)
    if not result.within_tolerance:
        raise typer.Exit(1)


_MOST_VALUES = 5000


@command
def design(
    campaign: GivenCampaign,
    model: ChosenModel,
    output: Output,
    tests: Annotated[int | None, typer.Option(help="Number of circles. Default: as many as the pilot has.")] = None,
    budget: Annotated[float | None, typer.Option(help="Instead of --tests: what they may cost.")] = None,
    target: Annotated[
        list[str] | None,
        typer.Option(
            help="Instead of --tests: the fewest circles for this expected sd, as NAME=SD in mm, N, rad; can be repeated.",
            metavar="NAME=SD",
        ),
    ] = None,
    power: Annotated[
        float | None, typer.Option(help="Instead of --tests: the fewest circles that find slopes with this probability.")
    ] = None,
    forces: Annotated[
        str, typer.Option(help="Levels to choose from (N). Default: the pilot's range, 1 N.", metavar="LO:HI:STEP or LIST")
    ] = "",
    clockings: Annotated[
        str,
        typer.Option(
            help="Clockings to choose from (°): of the work ball, or WORK/TOOL of both.",
            metavar="LO:HI:STEP or LIST",
        ),
    ] = "0",
    radii: Annotated[str, typer.Option(help="Radii to choose from (mm). Default: the pilot's.", metavar="LIST")] = "",
    planes: Annotated[str, typer.Option(help="Planes to choose from. Default: the pilot's.", metavar="LIST")] = "",
    directions: Annotated[
        str, typer.Option(help="Directions of travel to choose from: CW,CCW. Default: the pilot's.", metavar="LIST")
    ] = "",
    centre: Annotated[
        list[str] | None,
        typer.Option(help="Centre to choose from (mm); can be repeated. Default: the pilot's.", metavar="X,Y,Z"),
    ] = None,
    readings: Annotated[int | None, typer.Option(help="Readings per full circle. Default: as in the pilot.", min=25)] = None,
    criterion: Annotated[
        str | None, typer.Option(help="eig (default), d (default for flat priors), a, c, i, e or discriminate.")
    ] = None,
    parameters: Annotated[str, typer.Option(help="Parameters of interest, comma-separated. Default: all.")] = "",
    augment: Annotated[bool, typer.Option("--augment", help="The pilot's tests count as run; the new ones are added.")] = False,
    cost_circle: Annotated[float, typer.Option(help="Cost of a circle.")] = 1.0,
    cost_work_ball: Annotated[float, typer.Option(help="Cost of each change of the work ball's clocking.")] = 0.0,
    cost_tool_ball: Annotated[float, typer.Option(help="Cost of each change of the tool ball's clocking.")] = 0.0,
    against: Annotated[
        list[str] | None,
        typer.Option(help="Another design to judge: a plan or campaign, as NAME=PATH; can be repeated.", metavar="NAME=PATH"),
    ] = None,
    slope_size: Annotated[float, typer.Option(help="Slopes that are to be found, in prior sd.")] = 1.0,
    threshold: Annotated[float, typer.Option(help="|ln B| called decisive (nat).")] = 5.0,
    robust: Annotated[bool, typer.Option("--robust", help="A design good over several assumptions.")] = False,
    seed: SeedOption = 1,
) -> None:
    """The best tests to run next, how good they are, and what they will tell. A plan will do as pilot.

    --out DIR becomes a plan (campaign.toml) that identify and simulate read, in the order in which to run it, with the model for
    its analysis. Exit code 1: a target or power that is not reached, or the certificate that nothing is better does not hold.
    """
    from ldbb_bayes.analysis.design.candidates import Costs
    from ldbb_bayes.analysis.design.design import design as run
    from ldbb_bayes.campaign.folder import read_campaign
    from ldbb_bayes.report.text import parts_of
    from ldbb_bayes.report.wording import with_words

    drawn = ("information", "efficiency", "trade_off", "expected_widths")
    tables = ("expected.csv", "sensitivity.csv", "trade_off.csv", "robustness.csv")
    files = ("campaign.toml", "model.toml", "design.json", *tables, *figure_files(drawn))
    output.check(files)
    result = run(
        model,
        campaign,
        tests=tests,
        budget=budget,
        targets={name: _number(value, "--target") for name, value in pairs_in(target, "--target", "NAME=SD").items()},
        power=power,
        forces_N=_range(forces, "--forces") if forces else None,
        clockings_deg=_clockings(clockings),
        radii_mm=_range(radii, "--radii") if radii else (),
        planes=names_in(planes),
        directions=names_in(directions),  # type: ignore[arg-type]
        centres_mm=[three_numbers(text, "--centre") for text in centre or ()],
        readings=readings,
        criterion=criterion,  # type: ignore[arg-type]
        parameters=names_in(parameters),
        augment=augment,
        costs=Costs(cost_circle, cost_work_ball, cost_tool_ball),
        against={name: read_campaign(Path(path)) for name, path in pairs_in(against, "--against", "NAME=PATH").items()},
        slope_size=slope_size,
        threshold=threshold,
        robust=robust,
        curve=output.out is not None,
        seed=seed,
    )
    record: dict[str, Any] = {"schema": 1, "seed": seed, **with_words(result)}
    plan = result.plan(seed=seed)
    written = "the plan (campaign.toml), model.toml (for its analysis: fit --model), design.json, tables (CSV) and figures"
    output.deliver(
        record,
        files,
        partial(_write_design, result, record, plan, drawn),
        lambda: show(*parts_of(result), f"Run in this order: {', '.join(test.name for test in plan.tests)}"),
        f"{output.out}, {written}",
    )
    if not (result.certificate.holds and result.reached):
        raise typer.Exit(1)


def _write_design(design: Design, record: dict[str, Any], plan: Campaign, drawn: tuple[str, ...], folder: Path) -> None:
    from ldbb_bayes.campaign.folder import write_campaign_into
    from ldbb_bayes.model.specification import model_to_toml
    from ldbb_bayes.report import figures

    write_campaign_into(plan, folder)
    contents = {
        "model.toml": model_to_toml(design.model),
        "design.json": record,
        "expected.csv": design.expected_table(),
        "sensitivity.csv": design.sensitivity,
        "trade_off.csv": design.trade_off,
    }
    if not design.robustness.empty:
        contents["robustness.csv"] = design.robustness.rename_axis("design").reset_index()
    write_files(folder, contents, {name: partial(getattr(figures, name), design) for name in drawn})


def _number(text: str, option: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{option} must be made of numbers, got {text!r}. Write them like 36 or 2e-6.")
    return value


def _range(text: str, option: str) -> tuple[float, ...]:
    """LO:HI:STEP, both ends included, or a comma-separated list."""
    if ":" not in text:
        return tuple(_number(part.strip(), option) for part in text.split(","))
    parts = [_number(part, option) for part in text.split(":")]
    if len(parts) != 3 or parts[2] <= 0 or parts[1] < parts[0]:
        raise InputError(f"{option} must be LO:HI:STEP with LO ≤ HI and STEP > 0, or a list, got {text!r}. For example 36:742:1.")
    low, high, step = parts
    if (high - low) / step > _MOST_VALUES:
        raise InputError(f"{option} must give at most {_MOST_VALUES} values, got {(high - low) / step:.3g}. Take a longer step.")
    steps = math.floor((high - low) / step * (1 + 1e-12))
    return tuple(sorted({*(low + step * i for i in range(steps + 1)), high}))


def _clockings(text: str) -> tuple[tuple[float, float], ...]:
    """Angles of the work ball, or WORK/TOOL of both."""
    if "/" not in text:
        return tuple((angle, 0.0) for angle in _range(text, "--clockings"))
    pairs = [part.strip().split("/") for part in text.split(",")]
    if any(len(pair) != 2 or not all(pair) for pair in pairs):
        raise InputError(
            f"--clockings must be all angles of the work ball, or all WORK/TOOL, got {text!r}. For example 0/0,45/90."
        )
    return tuple((_number(work, "--clockings"), _number(tool, "--clockings")) for work, tool in pairs)


@command
def validate(
    plan: CampaignArgument,
    model: ChosenModel,
    output: Output,
    data_model: Annotated[
        Path | None,
        typer.Option(help="Draw the readings from this model instead, to see what a wrong model does.", metavar="FILE.toml"),
    ] = None,
    sampler: Annotated[str, typer.Option(help="independent or joint.")] = "independent",
    replicates: Annotated[int, typer.Option(help="Simulated campaigns.")] = 100,
    draws: Annotated[int, typer.Option(help="Posterior draws of each.")] = 99,
    executor: ExecutorOption = "process",
    scheduler: SchedulerOption = None,
    workers: WorkersOption = 0,
    seed: SeedOption = 1,
) -> None:
    """Simulation-based calibration on a plan (or the plan of a campaign): truths from the priors, readings, posterior, ranks.

    Exit code 1 when ranks are not uniform.
    """
    import pandas as pd

    from ldbb_bayes.analysis.calibration import validate as run
    from ldbb_bayes.jobs import executor_named
    from ldbb_bayes.model.specification import read_model
    from ldbb_bayes.report.figures import rank_ecdf
    from ldbb_bayes.report.text import parts_of
    from ldbb_bayes.report.wording import with_words

    generator = None if data_model is None else read_model(data_model, degree=model.degree)
    campaign = campaign_from(plan)
    files = ("validation.json", "ranks.csv", *figure_files(["rank_ecdf"]))
    output.check(files)
    with executor_named(executor, workers, scheduler) as pool, counting_progress(output.quiet, "simulated campaigns") as progress:
        result = run(
            model,
            campaign,
            replicates=replicates,
            draws=draws,
            sampler=sampler,
            generator=generator,
            seed=seed,
            executor=pool,
            progress=progress,
        )
    record = {"schema": 1, "campaign": campaign.name, "seed": seed, **with_words(result)}

    def write(folder: Path) -> None:
        ranks = pd.DataFrame(result.ranks, columns=list(result.names)).rename_axis("replicate").reset_index()
        write_files(folder, {"validation.json": record, "ranks.csv": ranks}, {"rank_ecdf": partial(rank_ecdf, result)})

    output.deliver(record, files, write, lambda: show(*parts_of(result)))
    if not result.calibrated:
        raise typer.Exit(1)
