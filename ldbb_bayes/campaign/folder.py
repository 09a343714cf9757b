"""Campaign folders and tidy tables: campaign.toml and CSVs into a campaign or plan, and back."""

from __future__ import annotations

import datetime as dt
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
import tomli_w
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from ldbb_bayes.campaign.campaign import PER_TEST, Campaign, CircularTest, ForceLaw, MountCompensation
from ldbb_bayes.campaign.spreadsheet import columns_of, numbers_of, read_strict_table
from ldbb_bayes.errors import InputError, check_known, nearest, placed, require
from ldbb_bayes.files import read_toml, staged_folder, validated

__all__ = [
    "IMPORT_NAME",
    "LARGEST_PLAN",
    "TOML_NAME",
    "TRUTH_NAME",
    "TestFields",
    "embedded_campaign",
    "files_of",
    "iso",
    "labels_of",
    "read_campaign",
    "write_campaign",
    "write_campaign_into",
]

Array = NDArray[np.float64]
SCHEMA = 1
TOML_NAME, TRUTH_NAME, IMPORT_NAME = "campaign.toml", "truth.json", "import.toml"
PLANNED_READINGS, LARGEST_PLAN = 720, 2_000_000
_LARGEST_COLUMNS, _LONGEST_LABEL = 1000, 200
_READINGS = ("angle_deg", "angle_rad", "reading_um", "reading_mm")
_OF_TEST = ("force_N", "pressure_bar", "direction", *PER_TEST)
_TEXTS = ("test", "direction", "plane")


def read_campaign(path: str | os.PathLike[str], **options: Any) -> Campaign:
    """Return the campaign, or the plan, of a folder or file.

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
    got = f"campaign must be a folder with {TOML_NAME}, a {TOML_NAME} or a tidy CSV, got {path},"
    require(path.is_file(), f"{got} which {'is no ordinary file' if path.exists() else 'does not exist'}. Check the path.")
    check_known("option", options, [field.name for field in fields(Campaign) if field.name != "tests"])
    if path.suffix.lower() != ".toml":
        tests = _tests_of_table(path)
        options = {"name": path.stem} | options
    elif options:
        raise InputError(f"options must come with a tidy CSV, got {', '.join(options)} with {path}. Write them into {path.name}.")
    else:
        tests, options = _tests_of_folder(path)
    with placed(path):
        return Campaign(tests, **options)


def write_campaign(campaign: Campaign, folder: str | os.PathLike[str], *, force: bool = False) -> Path:
    """Write a campaign (or plan) folder, whole or not at all, and return its path.

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


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class _MountFile(_Strict):
    deflection_um_per_bar: float = 2.33
    compensated: bool = True


class _ForceFile(_Strict):
    slope_N_per_bar: float = 126.04
    offset_N: float = -14.2


class TestFields(_Strict):
    """What a file may say of a test."""

    __test__ = False

    name: str | None = None
    force_N: float | None = None
    pressure_bar: float | None = None
    direction: Literal["CW", "CCW"] | None = None
    work_ball_deg: float | None = None
    tool_ball_deg: float | None = None
    radius_mm: float | None = None
    plane: Literal["XY", "YZ", "ZX"] | None = None
    centre_x_mm: float | None = None
    centre_y_mm: float | None = None
    centre_z_mm: float | None = None
    setup: int | None = None
    temperature_C: float | None = None
    time_s: float | None = None
    start_deg: float | None = None


class _TestFile(TestFields):
    file: str | None = None
    readings: int | None = Field(default=None, ge=9, le=1_000_000)
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


def _tests_of_folder(path: Path) -> tuple[tuple[CircularTest, ...], dict[str, Any]]:
    """The tests of a campaign.toml, and the other fields of its campaign."""
    content = read_toml(path)
    schema = content.get("schema")
    if isinstance(schema, int) and schema > SCHEMA:
        raise InputError(f"{path}: schema must be {SCHEMA}, got {schema}, written by a newer version. Upgrade ldbb-bayes.")
    file = validated(_CampaignFile, content, str(path))
    planned = sum(entry.readings or PLANNED_READINGS for entry in file.test if entry.file is None)
    got = f"a plan must have at most {LARGEST_PLAN} readings, got {planned}"
    require(planned <= LARGEST_PLAN, f"{path}: {got}. Plan fewer readings a circle.")
    tests = tuple(_test(path, i, entry) for i, entry in enumerate(file.test, start=1))
    with placed(path):
        law = ForceLaw(**file.force.model_dump())
    return tests, file.model_dump(exclude={"schema_", "mount", "force", "test"}) | {
        "name": file.name or path.resolve().parent.name,
        "date": iso(file.date),
        "mount": MountCompensation(**file.mount.model_dump()),
        "force_law": law,
        "frames_mm": {axis: tuple(frame) for axis, frame in file.frames_mm.items()},
    }


def _test(toml: Path, k: int, entry: _TestFile) -> CircularTest:
    own: dict[str, Any] = entry.model_dump(exclude_none=True, exclude={"file", "name", "readings", "start_deg", "arc_deg"})
    own["name"] = entry.name or (Path(entry.file).stem if entry.file else "")
    planned = [key for key in ("readings", "start_deg", "arc_deg") if getattr(entry, key) is not None]
    if entry.file is None:
        path, n, arc = Path(f"{toml}, test {k}"), entry.readings or PLANNED_READINGS, entry.arc_deg or 360.0
        own["angle_deg"] = (entry.start_deg or 0.0) + arc * (np.arange(n) / (n if abs(arc) == 360.0 else n - 1))
    elif planned:
        got = f"{planned[0]} must stand in planned tests only, got it beside 'file'"
        raise InputError(f"{toml}, test {k}: {got}. Remove one of them.")
    else:
        path = _inside(toml, k, entry.file)
        own |= _checked(path, _read_columns(path, _READINGS))
    with placed(path):
        return CircularTest(**own)


def _inside(toml: Path, k: int, file: str) -> Path:
    """The referenced file, which must lie inside the campaign's folder, links followed."""
    root, place = toml.parent.resolve(), f"{toml}, test {k}: file must"
    try:
        path = (root / file).resolve()
    except (OSError, RuntimeError, ValueError):
        raise InputError(f"{place} be the name of one, got {file[:80]!r}, which leads nowhere. Check the name.") from None
    if Path(file).is_absolute() or not path.is_relative_to(root):
        raise InputError(f"{place} lie inside {toml.parent}, got {file!r}. Copy it there and use a relative name.")
    if not path.is_file():
        got = "is no ordinary file" if path.exists() else f"is not in {toml.parent}"
        raise InputError(f"{place} exist, got {file!r}, which {got}. Check the name.")
    return toml.parent / file


def _tests_of_table(path: Path) -> tuple[CircularTest, ...]:
    """The tests of a tidy CSV: columns test, force_N (or pressure_bar), angle_deg, reading_um, optionally others."""
    columns = _read_columns(path, ("test", *_READINGS, *_OF_TEST))
    require("test" in columns, f"{path}, line 1: columns must hold 'test', got none. Name the test each row belongs to.")
    readings = _checked(path, columns)
    tests = []
    for name in dict.fromkeys(columns["test"].tolist()):
        rows = columns["test"] == name
        own: dict[str, Any] = {key: values[rows] for key, values in readings.items()}
        for key in (key for key in _OF_TEST if key in columns):
            values = columns[key][rows]
            got = f"{path}: {key} must be the same in all rows of a test, got {values.min()} to {values.max()} in {name!r}."
            require(len(set(values.tolist())) == 1, f"{got} Split the test or correct the rows.")
            own[key] = (values[0] or None) if key in _TEXTS else float(values[0])
        with placed(path):
            tests.append(CircularTest(name=name, **own))
    return tuple(tests)


def _read_columns(path: Path, known: Sequence[str]) -> dict[str, Any]:
    """Columns of a CSV by name: numbers, or texts. Where semicolons or tabs separate and no point stands, commas are decimal."""
    rows, separator = read_strict_table(path)
    names = [name.strip() for name in rows[0][1]] if rows[0][0] == 1 else [""]
    if len(names) > _LARGEST_COLUMNS:
        many = f"a table must have at most {_LARGEST_COLUMNS} columns, got {len(names)}"
        raise InputError(f"{path}, line 1: {many}. Export it again.")
    for name in names:
        if name not in known:
            raise InputError(
                f"{path}, line 1: columns must be among {', '.join(known)}, got {name[:60]!r}. "
                f"Did you mean {nearest(name[:60], known)!r}? Rename or remove the column, "
                "or let ldbb-bayes import read the file."
            )
        require(names.count(name) == 1, f"{path}, line 1: columns must differ, got {name!r} twice. Remove one.")
    filled = [row for row in rows[1:] if any(row[1])]
    require(filled, f"{path} must hold readings below its header, got none. Fill the file or remove the test.")
    if all(any(cells[len(names) :]) for _, cells in filled):
        raise InputError(
            f"{path}, line 1: the header must name every column, got fewer names than columns. Name them all; "
            "with decimal commas separate the cells by semicolons."
        )
    lines, cells = columns_of(str(path), filled, len(names))
    columns = dict(zip(names, cells, strict=True))
    points = any("." in cell for name in names if name not in _TEXTS for cell in columns[name])
    decimal = "," if separator != "," and not points else "."
    return {
        name: np.array(own, dtype=object) if name in _TEXTS else numbers_of(str(path), name, lines, own, decimal, strict=True)
        for name, own in columns.items()
    }


def _checked(path: Path, columns: Mapping[str, Any]) -> dict[str, Array]:
    """The columns of angles and readings; a span that contradicts the angle's unit is refused."""
    found: dict[str, Array] = {}
    for pair in (_READINGS[:2], _READINGS[2:]):
        present = [name for name in pair if name in columns]
        if len(present) != 1:
            got = "both" if present else "neither"
            raise InputError(f"{path}, line 1: columns must hold {pair[0]} or {pair[1]}, got {got}. Correct the header.")
        found[present[0]] = columns[present[0]]
    (angle, values), _ = found.items()
    span = float(np.ptp(values))
    if angle == "angle_deg" and span < 7.0:
        cure = "If the angles are radians, name the column angle_rad"
        raise InputError(f"{path}: angle_deg must span more than 7°, got {span:.3g}°. {cure}.")
    if angle == "angle_rad" and span > 8.0 * np.pi:
        cure = "If the angles are degrees, name the column angle_deg"
        raise InputError(f"{path}: angle_rad must span at most 4 turns, got {span:.4g} rad. {cure}.")
    return found


def write_campaign_into(campaign: Campaign, folder: Path) -> None:
    """Write campaign.toml and the CSVs into an existing folder."""
    head: dict[str, Any] = {"schema": SCHEMA}
    head |= {key: getattr(campaign, key) for key in ("topology", "plane", "radius_mm", "name", "machine_id", "date")}
    head |= {"feed_mm_per_min": campaign.feed_mm_per_min, "resolution_um": campaign.resolution_um}
    head |= {"mount": asdict(campaign.mount), "force": asdict(campaign.force_law)}
    head["frames_mm"] = {axis: list(frame) for axis, frame in campaign.frames_mm.items()} or None
    entries = [f"\n[[test]]\n{tomli_w.dumps(_entry(campaign, test))}" for test in campaign.tests]
    (folder / TOML_NAME).write_text(tomli_w.dumps(_given(head)) + "".join(entries), encoding="utf-8")
    for test in campaign.tests:
        if test.reading_um is not None:
            frame = pd.DataFrame({"angle_deg": test.angle_deg, "reading_um": test.reading_um})
            frame.to_csv(folder / f"{test.name}.csv", index=False, lineterminator="\n")


def _entry(campaign: Campaign, test: CircularTest) -> dict[str, Any]:
    """A [[test]] of campaign.toml, without what is as usual."""
    usual = {"radius_mm": campaign.radius_mm, "plane": campaign.plane, "setup": 1, "temperature_C": None, "time_s": None}
    entry: dict[str, Any] = {"file": None if test.reading_um is None else f"{test.name}.csv"}
    entry |= {key: getattr(test, key) for key in ("force_N", "pressure_bar", "name", "direction")}
    entry |= {key: own for key in PER_TEST if (own := getattr(test, key)) != usual.get(key, 0.0)}
    if test.reading_um is not None:
        return _given(entry)
    n, step = len(test.angle_deg), float(test.angle_deg[1] - test.angle_deg[0])
    if not np.allclose(np.diff(test.angle_deg), step, rtol=1e-6):
        raise InputError(f"a plan's angles must be evenly spaced to be written, got test {test.name!r}. Plan even angles.")
    full = abs(abs(n * step) - 360.0) < 1e-6 * 360.0
    arc = float(np.copysign(360.0, step) if full else (n - 1) * step)
    got = f"{arc:g}° in test {test.name!r}"
    require(abs(arc) <= 360.0, f"a plan's angles must span one turn to be written, got {got}. Plan one turn a test.")
    return _given(entry | {"readings": n, "start_deg": float(test.angle_deg[0]), "arc_deg": arc})


def _given(entry: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in entry.items() if value is not None}


def files_of(folder: Path) -> set[str]:
    """Names in a folder that belong to the campaign in it: what may go when the campaign is replaced."""
    try:
        listed = {str(entry.get("file", "")) for entry in read_toml(folder / TOML_NAME).get("test", [])}
    except (InputError, AttributeError, TypeError):
        return set()
    return {TOML_NAME, TRUTH_NAME, IMPORT_NAME, *listed}


def iso(date: dt.date | str | None) -> str | None:
    """A date or time as ISO 8601 text; a text as it is."""
    return date.isoformat() if isinstance(date, dt.date) else date


def labels_of(path: str | os.PathLike[str]) -> dict[str, str]:
    """Name, machine_id and date [ISO 8601] of a campaign folder or campaign.toml, those that are there; of a tidy CSV none."""
    file = Path(path) / TOML_NAME if os.path.isdir(path) else Path(path)
    try:
        content = read_toml(file) if file.suffix.lower() == ".toml" else {}
    except InputError:
        return {}
    found = {label: iso(content.get(label)) for label in ("name", "machine_id", "date")}
    texts = {label: value for label, value in found.items() if isinstance(value, str)}
    return {label: value for label, value in texts.items() if value.isprintable() and 0 < len(value) <= _LONGEST_LABEL}


def embedded_campaign(name: str = "recovered_experiment") -> Path:
    """Folder of an embedded campaign, from the installed wheel or from the checkout.

    Raises
    ------
    InputError
        When the installation came without its data.
    """
    package = Path(str(files("ldbb_bayes")))
    for folder in (package / "_data" / name, package.parent / "data" / name):
        if (folder / TOML_NAME).is_file():
            return folder
    raise InputError(
        f"embedded campaign must be one of those installed, got {name!r}, which is missing. Install the package again."
    )
