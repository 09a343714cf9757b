"""``ldbb-bayes design``: which forces, how many circles, which clockings to run next."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ldbb_bayes.cli.options import (
    DegreeOption,
    DriftOption,
    ForceOption,
    JsonOption,
    ModelOption,
    OutOption,
    PresetOption,
    QuietOption,
    SeedOption,
    WithoutOption,
    model_from,
    of_campaign,
    three_numbers,
)
from ldbb_bayes.errors import InputError

if TYPE_CHECKING:
    from ldbb_bayes.campaign.campaign import Campaign

__all__ = ["DESIGN_FILES", "design"]

_FIGURES = ("information", "efficiency", "trade_off", "expected_widths")
DESIGN_FILES = (
    "campaign.toml",
    "model.toml",
    "design.json",
    "expected.csv",
    "sensitivity.csv",
    "trade_off.csv",
    "robustness.csv",
    *(f"{name}.{kind}" for name in _FIGURES for kind in ("png", "svg")),
)
_MOST_VALUES = 5000


@of_campaign
def design(
    pilot: Campaign,
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
    degree: DegreeOption = None,
    preset: PresetOption = None,
    without: WithoutOption = "",
    drift: DriftOption = None,
    model: ModelOption = None,
    out: OutOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
    seed: SeedOption = 1,
    quiet: QuietOption = False,
) -> None:
    """The best tests to run next, how good they are, and what they will tell. A plan will do as pilot.

    --out DIR becomes a plan (campaign.toml) that identify and simulate read, in the order in which to run it, with the model for
    its analysis. Exit code 1: a target or power that is not reached, or the certificate that nothing is better does not hold.
    """
    from ldbb_bayes.analysis.costs import Costs
    from ldbb_bayes.analysis.design import design as run
    from ldbb_bayes.campaign.folder import read_campaign
    from ldbb_bayes.cli.show import print_design, print_json, write_design
    from ldbb_bayes.files import check_target, staged_folder

    chosen = model_from(degree, preset, without, model, drift)
    if out is not None:
        check_target(out, force=force, ours=DESIGN_FILES)
    compared = _named(against, "--against", "PATH")
    found = run(
        chosen,
        pilot,
        tests=tests,
        budget=budget,
        targets={name: _number(value, "--target") for name, value in _named(target, "--target", "SD").items()},
        power=power,
        forces_N=_range(forces, "--forces") if forces else None,
        clockings_deg=_clockings(clockings),
        radii_mm=_range(radii, "--radii") if radii else (),
        planes=_list(planes),
        directions=_list(directions),  # type: ignore[arg-type]
        centres_mm=[three_numbers(text, "--centre") for text in centre or ()],
        readings=readings,
        criterion=criterion,  # type: ignore[arg-type]
        parameters=_list(parameters),
        augment=augment,
        costs=Costs(cost_circle, cost_work_ball, cost_tool_ball),
        against={name: read_campaign(Path(path)) for name, path in compared.items()},
        slope_size=slope_size,
        threshold=threshold,
        robust=robust,
        curve=out is not None,
        seed=seed,
    )
    record: dict[str, Any] = {
        "schema": 1,
        "pilot": {"name": pilot.name, "sha256": pilot.sha256},
        "seed": seed,
        **found.as_dict(),
    }
    if out is not None:
        with staged_folder(out, force=force, ours=DESIGN_FILES) as staging:
            write_design(found, record, staging, seed)
    if as_json:
        print_json(record)
    else:
        print_design(found)
        if out is not None and not quiet:
            order = ", ".join(test.name for test in found.plan(seed=seed).tests)
            typer.echo(f"Run in this order: {order}")
            typer.echo(
                f"Written: {out}/campaign.toml (the plan), model.toml (for its analysis: fit --model), design.json, tables (CSV) "
                "and figures (PNG and SVG)"
            )
    if not (found.certificate.holds and found.reached):
        raise typer.Exit(1)


def _list(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(",") if part.strip())


def _named(entries: list[str] | None, option: str, what: str) -> dict[str, str]:
    """NAME=VALUE, each name once."""
    found: dict[str, str] = {}
    for entry in entries or ():
        name, sign, value = entry.partition("=")
        if not (name and sign and value):
            raise InputError(f"{option} must be NAME={what}, got {entry!r}. Put a name, '=' and the {what.lower()}.")
        if name in found:
            raise InputError(f"{option} must give each name once, got {name!r} again. Remove one.")
        found[name] = value
    return found


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
