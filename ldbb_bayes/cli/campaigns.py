"""``ldbb-bayes import``, ``check``, ``simulate``, ``machine``: campaigns, before anything is fitted."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ldbb_bayes.cli.options import (
    ChosenModel,
    ForceOption,
    GivenCampaign,
    JsonOption,
    Output,
    SeedOption,
    TableFields,
    campaign_from,
    command,
    names_in,
    pairs_in,
    three_numbers,
)
from ldbb_bayes.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ldbb_bayes.machine.chain import Circle, Machine

__all__ = ["check", "import_", "machine", "simulate", "write_atlases"]

_COLUMNS = "Which column is what (its header, or its number from 1)"
_TABLE = "How the files are read"
_LOG = "A log over time"
Column = str | None


@command
def import_(
    files: Annotated[
        list[Path],
        typer.Argument(help="Tables: CSV, text or XLSX; one test each, or a column that names the test.", metavar="FILE..."),
    ],
    out: Annotated[Path, typer.Option(help="Campaign folder to write.", metavar="CAMPAIGN")],
    layout: Annotated[
        Path | None,
        typer.Option(help="What is known of the tables, as TOML; import.toml of an earlier import will do.", metavar="FILE.toml"),
    ] = None,
    forces_n: Annotated[
        str | None, typer.Option("--forces-N", help="Force of each test, in the order of files and sheets (N).", metavar="F,F,…")
    ] = None,
    pressures_bar: Annotated[
        str | None, typer.Option(help="Pressure of each test, in that order (bar).", metavar="P,P,…")
    ] = None,
    angle_column: Annotated[Column, typer.Option(help="Of every reading.", rich_help_panel=_COLUMNS)] = None,
    reading_column: Annotated[
        list[str] | None, typer.Option(help="Several, each a test of its own: once for each.", rich_help_panel=_COLUMNS)
    ] = None,
    time_column: Annotated[
        Column, typer.Option(help="Of every reading, where no column holds the angle.", rich_help_panel=_COLUMNS)
    ] = None,
    force_column: Annotated[Column, typer.Option(help="The same in all rows of a test.", rich_help_panel=_COLUMNS)] = None,
    pressure_column: Annotated[Column, typer.Option(help="The same in all rows of a test.", rich_help_panel=_COLUMNS)] = None,
    test_column: Annotated[Column, typer.Option(help="Names the test of each row.", rich_help_panel=_COLUMNS)] = None,
    direction_column: Annotated[Column, typer.Option(help="CW or CCW.", rich_help_panel=_COLUMNS)] = None,
    unit: Annotated[
        str | None, typer.Option(help="Of the readings: um, mm, nm, m, cm, inch, mil, uinch.", rich_help_panel=_TABLE)
    ] = None,
    angle_unit: Annotated[str | None, typer.Option(help="deg, rad, gon, mrad or arcmin.", rich_help_panel=_TABLE)] = None,
    time_unit: Annotated[str | None, typer.Option(help="s, ms, us, min, h or d.", rich_help_panel=_TABLE)] = None,
    force_unit: Annotated[str | None, typer.Option(help="N, kN, daN, lbf or kgf.", rich_help_panel=_TABLE)] = None,
    pressure_unit: Annotated[str | None, typer.Option(help="bar, mbar, MPa, kPa, Pa or psi.", rich_help_panel=_TABLE)] = None,
    zero: Annotated[
        str | None, typer.Option(help="deviation (from the nominal radius) or distance (of the balls).", rich_help_panel=_TABLE)
    ] = None,
    sign: Annotated[int | None, typer.Option(help="-1 where a longer bar counts as negative.", rich_help_panel=_TABLE)] = None,
    angle_sign: Annotated[
        int | None, typer.Option(help="-1 where the file counts angles clockwise.", rich_help_panel=_TABLE)
    ] = None,
    angle_offset_deg: Annotated[
        float | None, typer.Option(help="Angle of the plane's first axis, as the file counts.", rich_help_panel=_TABLE)
    ] = None,
    encoding: Annotated[str | None, typer.Option(help="Of the text, e.g. utf-16-le, cp1252.", rich_help_panel=_TABLE)] = None,
    separator: Annotated[
        str | None, typer.Option(help="comma, semicolon, tab, bar, space, or the sign itself.", rich_help_panel=_TABLE)
    ] = None,
    decimal: Annotated[str | None, typer.Option(help="Decimal mark: . or ,", rich_help_panel=_TABLE)] = None,
    header_line: Annotated[
        int | None, typer.Option(help="Line of the column names; 0: there is none.", rich_help_panel=_TABLE)
    ] = None,
    sheets: Annotated[
        str | None, typer.Option(help="Sheets of a workbook to read, comma-separated.", rich_help_panel=_TABLE)
    ] = None,
    laps: Annotated[
        str | None, typer.Option(help="Of a recording longer than a turn: keep or average.", rich_help_panel=_TABLE)
    ] = None,
    direction: Annotated[str | None, typer.Option(help="CW or CCW, of all tests.", rich_help_panel=_LOG)] = None,
    feed_mm_per_min: Annotated[float | None, typer.Option(help="Feed along the circle (mm/min).", rich_help_panel=_LOG)] = None,
    start_deg: Annotated[
        float | None, typer.Option(help="Angle at which the circle begins. Default 0.", rich_help_panel=_LOG)
    ] = None,
    overshoot_deg: Annotated[float | None, typer.Option(help="Run-in before the start. Default 0.", rich_help_panel=_LOG)] = None,
    name: Annotated[str | None, typer.Option(help="Name of the campaign.")] = None,
    *,
    table: TableFields,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Read tables as instruments and spreadsheets write them, and write the campaign; says what it assumed.

    Every assumption can be given as an option, or in --layout.
    """
    from ldbb_bayes.campaign.folder import IMPORT_NAME, files_of, write_campaign_into
    from ldbb_bayes.campaign.importing import import_campaign
    from ldbb_bayes.campaign.layout import Layout, layout_to_toml, read_layout
    from ldbb_bayes.cli.show import show
    from ldbb_bayes.report.text import parts_of

    output = Output(out, force, as_json, quiet=False)
    output.check(files_of(out))
    if name == "":
        raise InputError("--name must not be empty. Leave it out, or give one.")
    known = Layout() if layout is None else read_layout(layout)
    roles = {
        "angle": angle_column,
        "time": time_column,
        "force": force_column,
        "pressure": pressure_column,
        "test": test_column,
        "direction": direction_column,
    }
    columns = known.columns | {role: _named(own) for role, own in roles.items() if own is not None}
    if reading_column:
        columns["reading"] = [_named(own) for own in reading_column]
    known = known.with_given(
        {
            "columns": columns,
            "reading_unit": unit,
            "angle_unit": angle_unit,
            "time_unit": time_unit,
            "force_unit": force_unit,
            "pressure_unit": pressure_unit,
            "zero": zero,
            "sign": sign,
            "angle_sign": angle_sign,
            "angle_offset_deg": angle_offset_deg,
            "encoding": encoding,
            "separator": separator,
            "decimal": decimal,
            "header_line": header_line,
            "sheets": None if sheets is None else [own.strip() for own in sheets.split(",")],
            "laps": laps,
            "direction": direction,
            "feed_mm_per_min": feed_mm_per_min,
            "start_deg": start_deg,
            "overshoot_deg": overshoot_deg,
            "forces_N": _numbers("--forces-N", forces_n),
            "pressures_bar": _numbers("--pressures-bar", pressures_bar),
        }
    )
    result = import_campaign(files, layout=known, **table, **({} if name is None else {"name": name}))

    def write(folder: Path) -> None:
        write_campaign_into(result.campaign, folder)
        (folder / IMPORT_NAME).write_text(layout_to_toml(result.layout), encoding="utf-8")

    written = f"{out} ({len(result.campaign.tests)} tests, {result.campaign.readings} readings). "
    written += f"Look at it: ldbb-bayes check {out}"
    output.deliver(result.as_dict(), files_of(out), write, lambda: show(*parts_of(result)), written)


def _numbers(option: str, text: str | None) -> list[float] | None:
    try:
        return None if text is None else [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"{option} must hold numbers separated by commas, got {text!r}. For example 1,3.5,6.") from None


def _named(column: str) -> str | int:
    return int(column) if column.isdecimal() else column


@command
def check(campaign: GivenCampaign, as_json: JsonOption = False) -> None:
    """Preview a campaign: per test what is there and what looks odd, and what a fit will assume. Fits nothing."""
    from ldbb_bayes.campaign.preview import preview
    from ldbb_bayes.cli.show import show
    from ldbb_bayes.report.text import parts_of
    from ldbb_bayes.report.wording import with_words

    seen = preview(campaign)
    Output(None, False, as_json, quiet=True).deliver(with_words(seen), (), lambda _: None, lambda: show(*parts_of(seen)))


@command
def simulate(
    source: Annotated[Path, typer.Argument(help="A TOML of truths (forces_N, parameters, hyper_um), or a plan or campaign.")],
    out: Annotated[Path, typer.Option(help="Campaign folder to write.", metavar="DIR")],
    model: ChosenModel,
    truth: Annotated[Path | None, typer.Option(help="Truths for a plan, as TOML.", metavar="FILE.toml")] = None,
    force: ForceOption = False,
    seed: SeedOption = 1,
    as_json: JsonOption = False,
) -> None:
    """Write a campaign with simulated readings, and truth.json beside it.

    What the truths leave out is drawn from the priors.
    """
    from ldbb_bayes.campaign.folder import TRUTH_NAME, files_of, write_campaign_into
    from ldbb_bayes.model.specification import Truths, is_truths, read_truths
    from ldbb_bayes.table import json_text

    if is_truths(source):
        if truth is not None:
            raise InputError(
                f"truths must come from one file, got {source} and {truth}. Give a plan as first argument, or drop --truth."
            )
        truths = read_truths(source)
        if truths.plan is None:
            raise InputError(
                f"{source}: 'forces_N' must be given, got nothing. List the forces, or give a plan as first argument."
            )
        plan = truths.plan
    else:
        plan = campaign_from(source)
        truths = Truths(None, None, {}, False) if truth is None else read_truths(truth)
        if truths.plan is not None:
            raise InputError(f"{truth}: 'forces_N' must stand in truths given alone, got it beside {source}. Remove one of them.")
    made = model.simulate(plan, seed=seed, parameters=truths.parameters, hyper_um=truths.hyper_um, exact=truths.exact)
    record = {"schema": 1, "seed": seed, "sha256": made.campaign.sha256, "parameters": made.parameters, "hyper_um": made.hyper_um}

    def write(folder: Path) -> None:
        write_campaign_into(made.campaign, folder)
        (folder / TRUTH_NAME).write_text(json_text(record), encoding="utf-8")

    written = f"{out} ({len(made.campaign.tests)} tests, {made.campaign.readings} readings), the truth in {out}/truth.json"
    Output(out, force, as_json, quiet=False).deliver(record, files_of(out), write, lambda: None, written)


ATLAS_FILES = tuple(
    f"{kind}_atlas{plane}.{ending}"
    for kind in ("compliance", "geometric")
    for plane in ("", "_XY", "_YZ", "_ZX")
    for ending in ("png", "svg")
)


def write_atlases(machine: Machine, circles: Sequence[Circle], folder: Path) -> None:
    """Write the patterns of compliances and geometric errors, for the first circle of every plane."""
    from ldbb_bayes.cli.show import write_files
    from ldbb_bayes.report.figures import compliance_atlas, geometric_atlas

    first = {circle.plane: circle for circle in reversed(circles)}
    for plane in machine.planes:
        stem = f"_{plane}" if len(machine.planes) > 1 else ""
        atlases = {"compliance": compliance_atlas, "geometric": geometric_atlas}
        drawn = {f"{name}_atlas{stem}": partial(draw, machine, first[plane]) for name, draw in atlases.items()}
        write_files(folder, {}, drawn)


@command
def machine(
    topology: Annotated[str, typer.Argument(help="Joints from workpiece to tool, for example wCAFYXZSt.", metavar="TOPOLOGY")],
    output: Output,
    plane: Annotated[str, typer.Option(help="XY, YZ or ZX, or several, comma-separated.")] = "XY",
    frame: Annotated[
        list[str] | None,
        typer.Option(help="Where a joint's frame stands (mm), axes at zero; can be repeated.", metavar="AXIS=X,Y,Z"),
    ] = None,
    centre: Annotated[
        list[str] | None,
        typer.Option(help="Centre of the circles (mm); can be repeated: all of them are measured.", metavar="X,Y,Z"),
    ] = None,
) -> None:
    """Which compliances and geometric errors circular tests show, with the pattern of each and the set it stands for.

    Names follow ISO 230-1 and the paper. c = cos θ, s = sin θ; lengths in mm.
    """
    from ldbb_bayes.analysis.describe import describe
    from ldbb_bayes.cli.show import show, write_files
    from ldbb_bayes.machine.chain import Circle, Machine
    from ldbb_bayes.report.text import parts_of

    frames = {axis: three_numbers(place, "--frame") for axis, place in pairs_in(frame, "--frame", "AXIS=X,Y,Z").items()}
    own = Machine(topology, names_in(plane), frames)
    centres = [three_numbers(text, "--centre") for text in centre or ("0,0,0",)]
    circles = [Circle(centre_mm=at, plane=name) for name in own.planes for at in centres]
    seen = describe(own, circles)
    record = {"schema": 1, **seen.as_dict()}

    def write(folder: Path) -> None:
        write_files(folder, {"machine.json": record}, {})
        write_atlases(own, circles, folder)

    files, written = ("machine.json", *ATLAS_FILES), f"{output.out}/machine.json and atlases (PNG and SVG)"
    output.check(files)
    output.deliver(record, files, write, lambda: show(*parts_of(seen)), written)
