"""Campaign folders and tidy tables: campaign.toml and CSVs into a campaign or plan, and back."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, field, fields, replace
from datetime import date
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tomli_w
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

from ldbb_bayes.campaign.campaign import (
    LABELS,
    PER_TEST,
    Ball,
    Campaign,
    CampaignFields,
    CircularTest,
    ForceLaw,
    Instrument,
    MountCompensation,
    TestFields,
)
from ldbb_bayes.campaign.dcc import read_dcc
from ldbb_bayes.campaign.field_types import Label, Length, Number, Percent, Positive
from ldbb_bayes.campaign.text_table import columns_of, read_strict_table, strict_numbers
from ldbb_bayes.errors import InputError, check_known, nearest, placed, require
from ldbb_bayes.files import read_toml, staged_folder, validated
from ldbb_bayes.results import Array

__all__ = [
    "IMPORT_NAME",
    "LARGEST_PLAN",
    "TOML_NAME",
    "TRUTH_NAME",
    "embedded_campaign",
    "files_of",
    "labels_of",
    "read_campaign",
    "write_campaign",
    "write_campaign_into",
]

SCHEMA = 1
TOML_NAME = "campaign.toml"
TRUTH_NAME = "truth.json"
IMPORT_NAME = "import.toml"
PLANNED_READINGS = 720
LARGEST_PLAN = 2_000_000
_LARGEST_COLUMNS = 1000
_LONGEST_LABEL = 200
_READINGS = ("angle_deg", "angle_rad", "reading_um", "reading_mm")
_OF_TEST = ("force_N", "pressure_bar", "direction", *PER_TEST)
_TEXTS = ("test", "direction", "plane")


def read_campaign(
    path: str | os.PathLike[str], *, certificates: Mapping[str, Any] | None = None, **options: Any
) -> Campaign:
    """Return the campaign, or the plan, of a campaign folder, a campaign.toml, or one tidy CSV;
    `InputError` names file and cure.

    ``certificates`` are fields of `Instrument`, before what campaign.toml says of them; options,
    for a tidy CSV only, what campaign.toml would say (``radius_mm=150``,
    ``mount=MountCompensation(...)``, …).
    """
    path = Path(path)
    if path.is_dir():
        path = path / TOML_NAME
    got = f"campaign must be a folder with {TOML_NAME}, a {TOML_NAME} or a tidy CSV, got {path},"
    require(
        path.is_file(),
        f"{got} which {'is no ordinary file' if path.exists() else 'does not exist'}. Check the"
        " path.",
    )
    check_known("option", options, [own.name for own in fields(Campaign) if own.name != "tests"])
    if path.suffix.lower() != ".toml":
        tests = _tests_of_table(path)
        options = {"name": path.stem} | options
    elif options:
        raise InputError(
            f"options must come with a tidy CSV, got {', '.join(options)} with {path}. Write them"
            f" into {path.name}."
        )
    else:
        tests, options = _tests_of_folder(path)
    with placed(path):
        unnamed = {
            f"{kind}_certificate": None
            for k in certificates or ()
            if (kind := k.partition("_")[0]) in ("bar", "force")
        }
        instrument = replace(
            options.pop("instrument", Instrument()), **unnamed | dict(certificates or {})
        )
        return Campaign(tests, instrument=instrument, **options)


def write_campaign(
    campaign: Campaign, folder: str | os.PathLike[str], *, force: bool = False
) -> Path:
    """Write a campaign (or plan) folder, whole or not at all, and return its path; an existing one
    goes with ``force`` only.

    Numbers are written so that they read back to the same doubles.
    """
    folder = Path(folder)
    with staged_folder(folder, force=force, ours=files_of(folder)) as staging:
        write_campaign_into(campaign, staging)
    return folder


_STRICT = ConfigDict(extra="forbid", defer_build=True)


@dataclass(frozen=True, kw_only=True, config=_STRICT)
class _TestFile(TestFields):
    file: str | None = None
    readings: Annotated[int, Field(ge=9, le=1_000_000)] | None = None
    start_deg: Number | None = None
    arc_deg: Annotated[Number, Field(ge=-360.0, le=360.0)] | None = None


# Certificates: a key of a table is the field of `Instrument` called after both.
@dataclass(frozen=True, config=_STRICT)
class _Balls:
    work: Ball = field(default_factory=Ball)
    tool: Ball = field(default_factory=Ball)


@dataclass(frozen=True, config=_STRICT)
class _Bar:
    length_error_um: Number = 0.0
    U_um: Positive | None = None
    certificate: Label | None = None


@dataclass(frozen=True, config=_STRICT)
class _Mount(MountCompensation):
    stiffness_N_per_um: Positive | None = None
    U_percent: Percent | None = None


@dataclass(frozen=True, config=_STRICT)
class _Force(ForceLaw):
    U_percent: Percent | None = None
    linearity_percent: Percent | None = None
    random_N: Positive | None = None
    certificate: Label | None = None


@dataclass(frozen=True, config=_STRICT)
class _Angle:
    U_deg: Positive | None = None


@dataclass(frozen=True, kw_only=True, config=_STRICT)
class _CampaignFile(CampaignFields):
    schema: Literal[1]
    topology: str
    plane: str
    radius_mm: Length
    mount: _Mount = field(default_factory=_Mount)
    force_law: Annotated[_Force, Field(alias="force")] = field(default_factory=_Force)
    balls: _Balls = field(default_factory=_Balls)
    bar: _Bar = field(default_factory=_Bar)
    angle: _Angle = field(default_factory=_Angle)
    tolerances: Annotated[dict[str, str], Field(alias="tolerance")] = field(default_factory=dict)
    test: Annotated[list[_TestFile], Field(min_length=1, max_length=1000)]


def _tests_of_folder(path: Path) -> tuple[tuple[CircularTest, ...], dict[str, Any]]:
    """The tests of a campaign.toml, and the other fields of its campaign."""
    content = _with_certificates(path, read_toml(path))
    file = validated(_CampaignFile, content, str(path))
    planned = sum(entry.readings or PLANNED_READINGS for entry in file.test if entry.file is None)
    got = f"a plan must have at most {LARGEST_PLAN} readings, got {planned}"
    require(planned <= LARGEST_PLAN, f"{path}: {got}. Plan fewer readings a circle.")
    tests = tuple(_test(path, i, entry) for i, entry in enumerate(file.test, start=1))
    stated = {own.name: getattr(file, own.name) for own in fields(CampaignFields)}
    return tests, stated | {"name": file.name or path.resolve().parent.name} | _instrument_of(
        path, file, content
    )


def _with_certificates(path: Path, content: dict[str, Any]) -> dict[str, Any]:
    """The content with what the DCCs that it names say in place of their names."""
    balls = content.get("balls", {})
    tables = {kind: content.get(kind) for kind in ("bar", "force")}
    tables |= (
        {f"balls.{ball}": balls.get(ball) for ball in ("work", "tool")}
        if isinstance(balls, dict)
        else {}
    )
    for name, table in tables.items():
        if isinstance(table, dict) and isinstance(dcc := table.pop("dcc", None), str):
            stated = read_dcc(_inside(path, f"[{name}]: dcc", dcc)).fields(
                "ball" if "." in name else name
            )
            twice = next((key for key in stated if key in table), None)
            require(
                twice is None,
                f"{path}: [{name}] must have {twice} or take it from its dcc, got both. Keep one of"
                " them.",
            )
            table |= stated
    return content


def _instrument_of(path: Path, file: _CampaignFile, content: Mapping[str, Any]) -> dict[str, Any]:
    """Mount, force law and certificates; a stiffness is a deflection per bar by the slope of the
    force law."""
    law = file.force_law
    mount = file.mount
    one = not {"stiffness_N_per_um", "deflection_um_per_bar"} <= content.get("mount", {}).keys()
    require(
        one,
        f"{path}: [mount] must have stiffness_N_per_um or deflection_um_per_bar, got both. Keep one"
        " of them.",
    )
    stiffness = mount.stiffness_N_per_um
    deflection = law.slope_N_per_bar / stiffness if stiffness else mount.deflection_um_per_bar
    tables: dict[str, Any] = {"bar": file.bar, "mount": mount, "force": law, "angle": file.angle}
    stated = vars(file.balls) | {
        f"{table}_{key}": own for table, held in tables.items() for key, own in vars(held).items()
    }
    with placed(path):
        instrument = Instrument(**{own.name: stated[own.name] for own in fields(Instrument)})
    plain = ForceLaw(law.slope_N_per_bar, law.offset_N)
    return {
        "mount": MountCompensation(deflection, mount.compensated),
        "force_law": plain,
        "instrument": instrument,
    }


def _test(toml: Path, k: int, entry: _TestFile) -> CircularTest:
    own = _given(vars(entry))
    planned = {key: own.pop(key) for key in ("readings", "start_deg", "arc_deg") if key in own}
    file = own.pop("file", None)
    if file is None:
        path = Path(f"{toml}, test {k}")
        n = planned.get("readings", PLANNED_READINGS)
        arc = planned.get("arc_deg", 360.0)
        own["angle_deg"] = planned.get("start_deg", 0.0) + arc * (
            np.arange(n) / (n if abs(arc) == 360.0 else n - 1)
        )
    elif planned:
        got = f"{next(iter(planned))} must stand in planned tests only, got it beside 'file'"
        raise InputError(f"{toml}, test {k}: {got}. Remove one of them.")
    else:
        path = _inside(toml, f"test {k}: file", file)
        own = {"name": Path(file).stem} | own | _checked(path, _read_columns(path, _READINGS))
    with placed(path):
        return CircularTest(**own)


def _inside(toml: Path, what: str, file: str) -> Path:
    """The referenced file, which must lie inside the campaign's folder, links followed."""
    root = toml.parent.resolve()
    place = f"{toml}, {what} must"
    try:
        path = (root / file).resolve()
        there = path.is_file()
    except (OSError, RuntimeError, ValueError):
        raise InputError(
            f"{place} be the name of one, got {file[:80]!r}, which leads nowhere. Check the name."
        ) from None
    inside = path.is_relative_to(root) and not Path(file).is_absolute()
    require(
        inside,
        f"{place} lie inside {toml.parent}, got {file!r}. Copy it there and use a relative name.",
    )
    require(
        there, f"{place} exist, got {file!r}, which is no file in {toml.parent}. Check the name."
    )
    return toml.parent / file


def _tests_of_table(path: Path) -> tuple[CircularTest, ...]:
    """The tests of a tidy CSV: columns test, force_N (or pressure_bar), angle_deg, reading_um,
    optionally others."""
    columns = _read_columns(path, ("test", *_READINGS, *_OF_TEST))
    require(
        "test" in columns,
        f"{path}, line 1: columns must hold 'test', got none. Name the test each row belongs to.",
    )
    readings = _checked(path, columns)
    tests = []
    for name in dict.fromkeys(columns["test"].tolist()):
        rows = columns["test"] == name
        own: dict[str, Any] = {key: values[rows] for key, values in readings.items()}
        for key in (key for key in _OF_TEST if key in columns):
            values = columns[key][rows]
            got = (
                f"{path}: {key} must be the same in all rows of a test, got {values.min()} to"
                f" {values.max()} in {name!r}."
            )
            require(len(set(values.tolist())) == 1, f"{got} Split the test or correct the rows.")
            own[key] = (values[0] or None) if key in _TEXTS else float(values[0])
        with placed(path):
            tests.append(CircularTest(name=name, **own))
    return tuple(tests)


def _read_columns(path: Path, known: Sequence[str]) -> dict[str, Any]:
    """Columns of a CSV by name: numbers, or texts. Where semicolons or tabs separate and no point
    stands, commas are decimal."""
    rows, separator = read_strict_table(path)
    names = [name.strip() for name in rows[0][1]] if rows[0][0] == 1 else [""]
    many = f"a table must have at most {_LARGEST_COLUMNS} columns, got {len(names)}"
    require(len(names) <= _LARGEST_COLUMNS, f"{path}, line 1: {many}. Export it again.")
    for name in names:
        got = (
            f"columns must be among {', '.join(known)}, got {name[:60]!r}. Did you mean"
            f" {nearest(name[:60], known)!r}?"
        )
        cure = "Rename or remove the column, or let ldbb-bayes import read the file"
        require(name in known, f"{path}, line 1: {got} {cure}.")
        require(
            names.count(name) == 1,
            f"{path}, line 1: columns must differ, got {name!r} twice. Remove one.",
        )
    filled = [row for row in rows[1:] if any(row[1])]
    require(
        filled,
        f"{path} must hold readings below its header, got none. Fill the file or remove the test.",
    )
    got = (
        "got fewer names than columns. Name them all; with decimal commas separate the cells by"
        " semicolons"
    )
    named = not all(any(cells[len(names) :]) for _, cells in filled)
    require(named, f"{path}, line 1: the header must name every column, {got}.")
    lines, cells = columns_of(str(path), filled, len(names))
    columns = dict(zip(names, cells, strict=True))
    points = any("." in cell for name in names if name not in _TEXTS for cell in columns[name])
    decimal = "," if separator != "," and not points else "."
    return {
        name: (
            np.array(own, dtype=object)
            if name in _TEXTS
            else strict_numbers(str(path), name, lines, own, decimal)
        )
        for name, own in columns.items()
    }


def _checked(path: Path, columns: Mapping[str, Any]) -> dict[str, Array]:
    """The columns of angles and readings; a span that contradicts the angle's unit is refused."""
    found: dict[str, Array] = {}
    for pair in (_READINGS[:2], _READINGS[2:]):
        present = [name for name in pair if name in columns]
        if len(present) != 1:
            got = "both" if present else "neither"
            raise InputError(
                f"{path}, line 1: columns must hold {pair[0]} or {pair[1]}, got {got}. Correct the"
                " header."
            )
        found[present[0]] = columns[present[0]]
    (angle, values), _ = found.items()
    span = float(np.ptp(values))
    cure = "If the angles are {}, name the column {}"
    got = (
        f"{path}: angle_deg must span more than 7°, got {span:.3g}°."
        f" {cure.format('radians', 'angle_rad')}."
    )
    require(angle != "angle_deg" or span >= 7.0, got)
    got = (
        f"{path}: angle_rad must span at most 4 turns, got {span:.4g} rad."
        f" {cure.format('degrees', 'angle_deg')}."
    )
    require(angle != "angle_rad" or span <= 8.0 * np.pi, got)
    return found


def write_campaign_into(campaign: Campaign, folder: Path) -> None:
    """Write campaign.toml and the CSVs into an existing folder."""
    head: dict[str, Any] = {"schema": SCHEMA}
    head |= {
        key: getattr(campaign, key) for key in ("topology", "plane", "radius_mm", "name", *LABELS)
    }
    head |= {"feed_mm_per_min": campaign.feed_mm_per_min, "resolution_um": campaign.resolution_um}
    head |= {"mount": asdict(campaign.mount), "force": asdict(campaign.force_law)}
    known = asdict(campaign.instrument)
    head["balls"] = {
        ball: own
        for ball in ("work", "tool")
        if (own := {k: v for k, v in known.pop(ball).items() if v})
    } or None
    for table, key, own in ((*name.partition("_")[::2], own) for name, own in known.items() if own):
        head.setdefault(table, {})[key] = own
    head["tolerance"] = dict(campaign.tolerances) or None
    head["frames_mm"] = {axis: list(frame) for axis, frame in campaign.frames_mm.items()} or None
    entries = [f"\n[[test]]\n{tomli_w.dumps(_entry(campaign, test))}" for test in campaign.tests]
    (folder / TOML_NAME).write_text(
        tomli_w.dumps(_given(head)) + "".join(entries), encoding="utf-8"
    )
    for test in campaign.tests:
        if test.reading_um is not None:
            rows = (
                f"{angle},{own}\n"
                for angle, own in zip(
                    test.angle_deg.tolist(), test.reading_um.tolist(), strict=True
                )
            )
            (folder / f"{test.name}.csv").write_text(
                "angle_deg,reading_um\n" + "".join(rows), encoding="utf-8"
            )


def _entry(campaign: Campaign, test: CircularTest) -> dict[str, Any]:
    """A [[test]] of campaign.toml, without what is as usual."""
    usual = {
        "radius_mm": campaign.radius_mm,
        "plane": campaign.plane,
        "setup": 1,
        "temperature_C": None,
        "time_s": None,
    }
    entry: dict[str, Any] = {"file": None if test.reading_um is None else f"{test.name}.csv"}
    entry |= {key: getattr(test, key) for key in ("force_N", "pressure_bar", "name", "direction")}
    entry |= {key: own for key in PER_TEST if (own := getattr(test, key)) != usual.get(key, 0.0)}
    if test.reading_um is not None:
        return _given(entry)
    n = len(test.angle_deg)
    step = test.step_deg
    got = f"others in test {test.name!r}"
    require(
        step,
        f"a plan's angles must be evenly spaced within one turn to be written, got {got}. Plan even"
        " angles.",
    )
    full = abs(abs(n * step) - 360.0) < 1e-6 * 360.0
    arc = float(np.copysign(360.0, step) if full else (n - 1) * step)
    return _given(entry | {"readings": n, "start_deg": float(test.angle_deg[0]), "arc_deg": arc})


def _given(entry: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in entry.items() if value is not None}


def files_of(folder: Path) -> set[str]:
    """Names in a folder that belong to the campaign in it: what may go when the campaign is
    replaced."""
    try:
        listed = {
            str(entry.get("file", "")) for entry in read_toml(folder / TOML_NAME).get("test", [])
        }
    except (InputError, AttributeError, TypeError):
        return set()
    return {TOML_NAME, TRUTH_NAME, IMPORT_NAME, *listed}


def labels_of(path: str | os.PathLike[str]) -> dict[str, str]:
    """Name, machine_id (default: the serial number) and date [ISO 8601] of a campaign folder or
    campaign.toml, those that are there; of a tidy CSV none."""
    file = Path(path) / TOML_NAME if os.path.isdir(path) else Path(path)
    content: dict[str, Any] = {}
    with suppress(InputError):
        content = read_toml(file) if file.suffix.lower() == ".toml" else {}
    content = {"machine_id": content.get("serial_number")} | content
    found = {label: content[label] for label in ("name", "machine_id", "date") if label in content}
    found |= {label: own.isoformat() for label, own in found.items() if isinstance(own, date)}
    texts = {label: own for label, own in found.items() if isinstance(own, str)}
    return {
        label: text
        for label, text in texts.items()
        if text.isprintable() and 0 < len(text) <= _LONGEST_LABEL
    }


def embedded_campaign(name: str = "recovered_experiment") -> Path:
    """Return the folder of an embedded campaign by its ``name``, from the installed wheel or from
    the checkout."""
    package = Path(str(files("ldbb_bayes")))
    for folder in (package / "_data" / name, package.parent / "data" / name):
        if (folder / TOML_NAME).is_file():
            return folder
    got = f"got {name!r}, which is missing"
    raise InputError(
        f"embedded campaign must be one of those installed, {got}. Install the package again."
    )
