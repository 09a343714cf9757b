"""A campaign on disk: a folder with campaign.toml and one CSV per test, read, checked and written."""

from __future__ import annotations

import datetime as dt
import os
from dataclasses import fields
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
import tomli_w
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.circular_test import CircularTest
from ldbb_bayes.campaign.loading import ForceLaw, MountCompensation
from ldbb_bayes.campaign.table import READING_COLUMNS, read_columns, read_tidy, readings_of
from ldbb_bayes.errors import InputError, check_known, nearest
from ldbb_bayes.files import staged_folder
from ldbb_bayes.toml import read_toml

__all__ = [
    "IMPORT_NAME",
    "LARGEST_PLAN",
    "TOML_NAME",
    "TRUTH_NAME",
    "files_of",
    "iso",
    "read_campaign",
    "write_campaign",
    "write_campaign_into",
]

SCHEMA = 1
TOML_NAME = "campaign.toml"
TRUTH_NAME = "truth.json"
IMPORT_NAME = "import.toml"
PLANNED_READINGS, LARGEST_PLAN = 720, 2_000_000


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class _MountFile(_Strict):
    deflection_um_per_bar: float = 2.33
    compensated: bool = True


class _ForceFile(_Strict):
    slope_N_per_bar: float = 126.04
    offset_N: float = -14.2


class _TestFile(_Strict):
    file: str | None = None
    force_N: float | None = None
    pressure_bar: float | None = None
    name: str | None = None
    direction: Literal["CW", "CCW"] | None = None
    work_ball_deg: float = 0.0
    tool_ball_deg: float = 0.0
    radius_mm: float | None = None
    plane: Literal["XY", "YZ", "ZX"] | None = None
    centre_x_mm: float | None = None
    centre_y_mm: float | None = None
    centre_z_mm: float | None = None
    setup: int | None = None
    temperature_C: float | None = None
    time_s: float | None = None
    readings: int | None = Field(default=None, ge=9, le=1_000_000)
    start_deg: float | None = None
    arc_deg: float | None = Field(default=None, ge=-360.0, le=360.0)


class _CampaignFile(_Strict):
    schema_: Literal[1] = Field(alias="schema")
    topology: str
    plane: Literal["XY", "YZ", "ZX"]
    radius_mm: float
    name: str | None = None
    machine_id: str | None = None
    date: dt.datetime | dt.date | str | None = None
    feed_mm_per_min: float | None = None
    resolution_um: float = 0.24
    mount: _MountFile = _MountFile()
    force: _ForceFile = _ForceFile()
    frames_mm: dict[str, list[float]] = Field(default_factory=dict)
    test: list[_TestFile] = Field(min_length=1, max_length=1000)


def read_campaign(path: str | os.PathLike[str], **options: Any) -> Campaign:
    """Read a campaign or a plan.

    Parameters
    ----------
    path : path
        A campaign folder, a campaign.toml, or one tidy CSV.
    **options
        For a tidy CSV only: what campaign.toml would say (`radius_mm=150`, `mount=MountCompensation(...)`, …).

    Raises
    ------
    InputError
        One message that names the file, the place and the cure.
    """
    path = Path(path)
    if path.is_dir():
        path = path / TOML_NAME
    if not path.is_file():
        raise InputError(
            f"campaign must be a folder with {TOML_NAME}, a {TOML_NAME} or a tidy CSV, got {path}, "
            f"which {'is no ordinary file' if path.exists() else 'does not exist'}. Check the path."
        )
    check_known("option", options, [field.name for field in fields(Campaign) if field.name != "tests"])
    if path.suffix.lower() != ".toml":
        return read_tidy(path, **options)
    if options:
        raise InputError(f"options must come with a tidy CSV, got {', '.join(options)} with {path}. Write them into {path.name}.")
    described = _parse(path)
    planned = sum(entry.readings or PLANNED_READINGS for entry in described.test if entry.file is None)
    if planned > LARGEST_PLAN:
        raise InputError(
            f"{path}: a plan must have at most {LARGEST_PLAN} readings, got {planned}. Plan fewer readings a circle."
        )
    tests = tuple(_test(path, i, entry) for i, entry in enumerate(described.test, start=1))
    try:
        return Campaign(
            tests,
            topology=described.topology,
            plane=described.plane,
            radius_mm=described.radius_mm,
            name=described.name or path.resolve().parent.name,
            feed_mm_per_min=described.feed_mm_per_min,
            machine_id=described.machine_id,
            date=iso(described.date),
            resolution_um=described.resolution_um,
            mount=MountCompensation(described.mount.deflection_um_per_bar, described.mount.compensated),
            force_law=ForceLaw(described.force.slope_N_per_bar, described.force.offset_N),
            frames_mm={axis: tuple(frame) for axis, frame in described.frames_mm.items()},  # type: ignore[misc]
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def write_campaign(campaign: Campaign, folder: str | os.PathLike[str], *, force: bool = False) -> Path:
    """Write a campaign (or plan) folder, whole or not at all.

    Numbers are written so that they read back to the same doubles.

    Parameters
    ----------
    force : bool
        Replace an existing folder.

    Raises
    ------
    InputError
        When the folder exists and ``force`` is false, or it cannot be written.
    """
    folder = Path(folder)
    with staged_folder(folder, force=force, ours=files_of(folder)) as staging:
        write_campaign_into(campaign, staging)
    return folder


def files_of(folder: Path) -> set[str]:
    """Names in a folder that belong to the campaign in it: what may go when the campaign is replaced."""
    try:
        content = read_toml(folder / TOML_NAME)
        listed = {str(entry.get("file", "")) for entry in content.get("test", [])}
    except (InputError, AttributeError, TypeError):
        return set()
    return {TOML_NAME, TRUTH_NAME, IMPORT_NAME, *listed}


def write_campaign_into(campaign: Campaign, folder: Path) -> None:
    """Write campaign.toml and the CSVs into an existing folder."""
    head: dict[str, Any] = {
        "schema": SCHEMA,
        "topology": campaign.topology,
        "plane": campaign.plane,
        "radius_mm": campaign.radius_mm,
        "name": campaign.name,
        "machine_id": campaign.machine_id,
        "date": campaign.date,
        "feed_mm_per_min": campaign.feed_mm_per_min,
        "resolution_um": campaign.resolution_um,
        "mount": {
            "deflection_um_per_bar": campaign.mount.deflection_um_per_bar,
            "compensated": campaign.mount.compensated,
        },
        "force": {"slope_N_per_bar": campaign.force_law.slope_N_per_bar, "offset_N": campaign.force_law.offset_N},
        "frames_mm": {axis: list(frame) for axis, frame in campaign.frames_mm.items()} or None,
    }
    entries = [f"\n[[test]]\n{tomli_w.dumps(_test_entry(campaign, test))}" for test in campaign.tests]
    (folder / TOML_NAME).write_text(tomli_w.dumps(_given(head)) + "".join(entries), encoding="utf-8")
    for test in campaign.tests:
        if test.reading_um is not None:
            frame = pd.DataFrame({"angle_deg": test.angle_deg, "reading_um": test.reading_um})
            frame.to_csv(folder / f"{test.name}.csv", index=False, lineterminator="\n")


def _test_entry(campaign: Campaign, test: CircularTest) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "file": None if test.reading_um is None else f"{test.name}.csv",
        "force_N": test.force_N,
        "pressure_bar": test.pressure_bar,
        "name": test.name,
        "direction": test.direction,
        "work_ball_deg": test.work_ball_deg or None,
        "tool_ball_deg": test.tool_ball_deg or None,
        "radius_mm": None if test.radius_mm == campaign.radius_mm else test.radius_mm,
        "plane": None if test.plane == campaign.plane else test.plane,
        "centre_x_mm": test.centre_x_mm or None,
        "centre_y_mm": test.centre_y_mm or None,
        "centre_z_mm": test.centre_z_mm or None,
        "setup": None if test.setup == 1 else test.setup,
        "temperature_C": test.temperature_C,
        "time_s": test.time_s,
    }
    if test.reading_um is None:
        entry |= _uniform(test)
    return _given(entry)


def _uniform(test: CircularTest) -> dict[str, Any]:
    """How a planned test's angles are written: number, start and arc."""
    n = len(test.angle_deg)
    step = float(test.angle_deg[1] - test.angle_deg[0])
    if not np.allclose(np.diff(test.angle_deg), step, rtol=1e-6):
        raise InputError(f"a plan's angles must be evenly spaced to be written, got test {test.name!r}. Plan even angles.")
    full = abs(abs(n * step) - 360.0) < 1e-6 * 360.0
    arc = np.copysign(360.0, step) if full else (n - 1) * step
    if abs(arc) > 360.0:
        raise InputError(
            f"a plan's angles must span one turn to be written, got {arc:g}° in test {test.name!r}. Plan one turn a test."
        )
    return {"readings": n, "start_deg": float(test.angle_deg[0]), "arc_deg": float(arc)}


def iso(date: dt.date | str | None) -> str | None:
    """A date or time as ISO 8601 text; a text as it is."""
    return date.isoformat() if isinstance(date, dt.date) else date


def _given(entry: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in entry.items() if value is not None}


def _parse(path: Path) -> _CampaignFile:
    content = read_toml(path)
    schema = content.get("schema")
    if isinstance(schema, int) and schema > SCHEMA:
        raise InputError(f"{path}: schema must be {SCHEMA}, got {schema}, written by a newer version. Upgrade ldbb-bayes.")
    try:
        return _CampaignFile.model_validate(content)
    except ValidationError as error:
        raise InputError(f"{path}: {_first_error(error)}") from None


_KEYS: dict[str, type[BaseModel]] = {"mount": _MountFile, "force": _ForceFile, "test": _TestFile}


def _first_error(error: ValidationError) -> str:
    """One sentence for the first thing pydantic found, a misspelt key before the gap it leaves."""
    errors = error.errors()
    first = next((entry for entry in errors if entry["type"] == "extra_forbidden"), errors[0])
    where = [str(part + 1) if isinstance(part, int) else part for part in first["loc"]]
    table = f" in [{' '.join(where[:-1])}]" if len(where) > 1 else ""
    if first["type"] == "extra_forbidden":
        owner = _KEYS.get(where[0], _CampaignFile) if len(where) > 1 else _CampaignFile
        known = [field.alias or name for name, field in owner.model_fields.items()]
        nearest_key = nearest(where[-1], known)
        return f"keys{table} must be among {', '.join(known)}, got {where[-1]!r}. Did you mean {nearest_key!r}?"
    if first["type"] == "missing":
        return f"{where[-1]!r}{table} must be given, got nothing. Add it."
    message = first["msg"][0].lower() + first["msg"][1:]
    return f"{where[-1]!r}{table} must be valid, got {first['input']!r}: {message}. Correct it."


def _test(toml: Path, number: int, entry: _TestFile) -> CircularTest:
    name = entry.name or (Path(entry.file).stem if entry.file else "")
    fields = entry.model_dump(exclude={"file", "name", "readings", "start_deg", "arc_deg"})
    if entry.file is None:
        return _guarded(f"{toml}, test {number}", name, {"angle_deg": _planned_angles(entry)}, fields)
    planned = [key for key in ("readings", "start_deg", "arc_deg") if getattr(entry, key) is not None]
    if planned:
        raise InputError(
            f"{toml}, test {number}: {planned[0]} must stand in planned tests only, got it beside 'file'. Remove one of them."
        )
    path = _inside(toml, number, entry.file)
    return _guarded(str(path), name, dict(readings_of(path, read_columns(path, READING_COLUMNS))), fields)


def _planned_angles(entry: _TestFile) -> Any:
    n = entry.readings or PLANNED_READINGS
    arc = entry.arc_deg or 360.0
    steps = np.arange(n) / (n if abs(arc) == 360.0 else n - 1)
    return (entry.start_deg or 0.0) + arc * steps


def _guarded(place: str, name: str, readings: dict[str, Any], fields: dict[str, Any]) -> CircularTest:
    try:
        return CircularTest(name=name, **readings, **fields)
    except InputError as error:
        raise InputError(f"{place}: {error}") from None


def _inside(toml: Path, number: int, file: str) -> Path:
    """The referenced file, which must lie inside the campaign's folder, links followed."""
    root = toml.parent.resolve()
    try:
        path = (root / file).resolve()
    except (OSError, RuntimeError, ValueError):
        raise InputError(
            f"{toml}, test {number}: file must be the name of one, got {file[:80]!r}, which leads nowhere. Check the name."
        ) from None
    if Path(file).is_absolute() or not path.is_relative_to(root):
        raise InputError(
            f"{toml}, test {number}: file must lie inside {toml.parent}, got {file!r}. Copy it there and use a relative name."
        )
    if not path.is_file():
        got = "is no ordinary file" if path.exists() else f"is not in {toml.parent}"
        raise InputError(f"{toml}, test {number}: file must exist, got {file!r}, which {got}. Check the name.")
    return toml.parent / file
