"""``ldbb-bayes import``: files as they are found into a campaign folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ldbb_bayes.cli.options import (
    ForceOffsetOption,
    ForceOption,
    ForceSlopeOption,
    JsonOption,
    MountOption,
    PlaneOption,
    RadiusOption,
    RawOption,
    ResolutionOption,
    TopologyOption,
    campaign_fields,
    guarded,
)

if TYPE_CHECKING:
    pass

__all__ = ["import_"]

_COLUMNS = "Which column is what (its header, or its number from 1)"
_TABLE = "How the files are read"
_LOG = "A log over time"
Column = str | None


@guarded
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
    topology: TopologyOption = None,
    plane: PlaneOption = None,
    radius_mm: RadiusOption = None,
    resolution_um: ResolutionOption = None,
    raw: RawOption = False,
    mount_um_per_bar: MountOption = None,
    force_slope: ForceSlopeOption = None,
    force_offset: ForceOffsetOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Read tables as instruments and spreadsheets write them, and write the campaign; says what it assumed.

    Every assumption can be given as an option, or in --layout.
    """
    from rich.table import Table
    from rich.text import Text

    from ldbb_bayes.campaign.folder import IMPORT_NAME, files_of, write_campaign_into
    from ldbb_bayes.cli.show import print_json, reading_console
    from ldbb_bayes.files import check_target, staged_folder
    from ldbb_bayes.tables.importing import import_campaign
    from ldbb_bayes.tables.layout import Layout, layout_to_toml, read_layout

    check_target(out, force=force, ours=files_of(out))
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
    fields = campaign_fields(
        topology=topology,
        plane=plane,
        radius_mm=radius_mm,
        resolution_um=resolution_um,
        raw=raw,
        mount_um_per_bar=mount_um_per_bar,
        force_slope=force_slope,
        force_offset=force_offset,
        name=name,
    )
    found = import_campaign(files, layout=known, **fields)
    with staged_folder(out, force=force, ours=files_of(out)) as staging:
        write_campaign_into(found.campaign, staging)
        (staging / IMPORT_NAME).write_text(layout_to_toml(found.layout), encoding="utf-8")
    if as_json:
        print_json(found.as_dict())
        return
    console = reading_console()
    table = Table("where", "assumed", "because", "option", title="Assumed", title_justify="left")
    for own in found.assumptions:
        cells = (own.place or "the campaign", f"{own.what}: {own.value}", own.because, own.option)
        table.add_row(*(Text(cell) for cell in cells))
    console.print(table)
    tests, readings = len(found.campaign.tests), found.campaign.readings
    console.print(
        f"Written: {out} ({tests} tests, {readings} readings). Look at it: ldbb-bayes check {out}", markup=False, soft_wrap=True
    )


def _numbers(option: str, text: str | None) -> list[float] | None:
    from ldbb_bayes.errors import InputError

    if text is None:
        return None
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"{option} must hold numbers separated by commas, got {text!r}. For example 1,3.5,6.") from None


def _named(column: str) -> str | int:
    return int(column) if column.isdecimal() else column
