"""Reading of campaign.toml, and of the CSV files and calibration certificates that it names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, fields
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import ConfigDict, Field, StrictBool
from pydantic.dataclasses import dataclass

from ldbb_bayes.campaign.campaign import Campaign, CampaignFields
from ldbb_bayes.campaign.certified_instrument import Ball, Instrument
from ldbb_bayes.campaign.circular_test import (
    FEWEST_READINGS,
    CircularTest,
    TestFields,
    planned_angles,
)
from ldbb_bayes.campaign.dcc_reader import read_dcc
from ldbb_bayes.campaign.field_types import Label, Length, Number, Percent, Positive
from ldbb_bayes.campaign.loading import ForceLaw, MountCompensation
from ldbb_bayes.campaign.readings_table import read_readings
from ldbb_bayes.errors import InputError, placed, require
from ldbb_bayes.files import read_toml, validated

__all__ = ["LARGEST_PLAN", "CampaignContent", "read_campaign_toml"]

# Number of readings of a planned test if campaign.toml does not give this number.
_PLANNED_READINGS = 720
# Largest total number of readings that the planned tests of a campaign may have.
LARGEST_PLAN = 2_000_000
# Keys of a table [[test]] in campaign.toml that are permitted only if the test is planned, that is,
# has no readings.
_PLAN_KEYS = ("readings", "start_deg", "arc_deg")
_STRICT = ConfigDict(extra="forbid", defer_build=True)


@dataclass(frozen=True, kw_only=True, config=_STRICT)
class _PlannedTest(TestFields):
    """A table [[test]] or [[foreseen]] of campaign.toml for a test without readings.

    ``readings`` is the number of evenly spaced angles, ``start_deg`` the first angle and
    ``arc_deg`` the arc that the angles cover.
    """

    readings: Annotated[int, Field(ge=FEWEST_READINGS, le=1_000_000)] | None = None
    start_deg: Number | None = None
    arc_deg: Annotated[Number, Field(ge=-360.0, le=360.0)] | None = None


@dataclass(frozen=True, kw_only=True, config=_STRICT)
class _TestFile(_PlannedTest):
    """A table [[test]] of campaign.toml; ``file`` names the file with the readings, if any."""

    file: str | None = None


# The classes _Balls, _Bar, _Mount, _Force and _Angle describe the tables of campaign.toml that hold
# certified values. Each key of a table becomes a field of `Instrument`. The name of the field
# begins with the name of the table: the key U_um of the table [bar] becomes the field bar_U_um.
@dataclass(frozen=True, config=_STRICT)
class _Balls:
    """The table [balls] of campaign.toml: form deviations of work ball and tool ball."""

    work: Ball = field(default_factory=Ball)
    tool: Ball = field(default_factory=Ball)


@dataclass(frozen=True, config=_STRICT)
class _Bar:
    """The table [bar] of campaign.toml: error of the bar's length and its uncertainty (k = 2)."""

    length_error_um: Number = 0.0
    U_um: Positive | None = None
    certificate: Label | None = None


@dataclass(frozen=True, config=_STRICT)
class _Mount(MountCompensation):
    """The table [mount] of campaign.toml: deflection of the work ball's mount.

    Instead of the deflection, the table may give the stiffness. ``U_percent`` is the expanded
    uncertainty (k = 2) of the deflection.
    """

    stiffness_N_per_um: Positive | None = None
    U_percent: Percent | None = None


@dataclass(frozen=True, config=_STRICT)
class _Force(ForceLaw):
    """The table [force] of campaign.toml: force law and certified errors of the force."""

    U_percent: Percent | None = None
    linearity_percent: Percent | None = None
    random_N: Positive | None = None
    certificate: Label | None = None


@dataclass(frozen=True, config=_STRICT)
class _Angle:
    """The table [angle] of campaign.toml: expanded uncertainty (k = 2) of the angles [deg]."""

    U_deg: Positive | None = None


@dataclass(frozen=True, kw_only=True, config=_STRICT)
class _CampaignFile(CampaignFields):
    """Fields that a file campaign.toml may contain.

    The library pydantic checks the content of a file against the types of these fields.
    """

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
    foreseen: Annotated[list[_PlannedTest], Field(max_length=1000)] = field(default_factory=list)
    pilot: str | None = None
    adds_to_pilot: StrictBool = False


class CampaignContent(NamedTuple):
    """Content of campaign.toml: the tests, and the values of the other fields of `Campaign`.

    One of the other fields holds the foreseen tests. These have no readings and may be run later.
    """

    tests: tuple[CircularTest, ...]
    # dictionary of all fields of `Campaign` except the tests, as campaign.toml states them; the
    # keys are the names of the fields
    fields: dict[str, Any]


def read_campaign_toml(path: Path) -> CampaignContent:
    """Return the content of a campaign.toml: tests, and values of the other fields of `Campaign`.

    The CSV files and calibration certificates that campaign.toml names are also read. If some of
    the tests name a file of readings and others do not, the others are foreseen tests. Raise an
    `InputError` for a mistake in a file; the message names the file.
    """
    content = read_toml(path)
    _fill_from_certificates(path, content)
    file = validated(_CampaignFile, content, str(path))
    planned_tests: list[_PlannedTest] = [entry for entry in file.test if entry.file is None]
    planned_tests += file.foreseen
    planned = sum(entry.readings or _PLANNED_READINGS for entry in planned_tests)
    require(
        planned <= LARGEST_PLAN,
        f"{path}: a plan must have at most {LARGEST_PLAN} readings, got {planned}. Plan fewer"
        " readings a circle.",
    )
    tests = [_read_test(path, number, entry) for number, entry in enumerate(file.test, start=1)]
    tests_run = [test for test in tests if test.reading_um is not None]
    foreseen = []
    # In a plan of which only some tests have been run, the others may be run later.
    if tests_run:
        foreseen = [test for test in tests if test.reading_um is None]
        tests = tests_run
    for number, foreseen_test in enumerate(file.foreseen, start=1):
        foreseen.append(_planned_test(f"{path}, foreseen test {number}", foreseen_test))
    campaign_fields = {entry.name: getattr(file, entry.name) for entry in fields(CampaignFields)}
    campaign_fields["name"] = file.name or path.resolve().parent.name
    law = file.force_law
    campaign_fields["force_law"] = ForceLaw(law.slope_N_per_bar, law.offset_N)
    campaign_fields["mount"] = _mount_of(path, file, content)
    campaign_fields["instrument"] = _instrument_of(path, file)
    campaign_fields["foreseen"] = tuple(foreseen)
    campaign_fields["pilot"] = _pilot_of(path, file)
    campaign_fields["adds_to_pilot"] = file.adds_to_pilot
    return CampaignContent(tuple(tests), campaign_fields)


def _pilot_of(path: Path, file: _CampaignFile) -> Campaign | None:
    """Return the campaign or plan from which a plan was designed, or None if there is none.

    This campaign is called the pilot. The campaign.toml of the plan names the pilot's folder, which
    is inside the plan's folder. ``file`` is the validated content of the campaign.toml at ``path``.
    Raise an `InputError` if the pilot's folder is not inside the plan's folder or holds no
    campaign. Also raise it if the pilot names a pilot itself.
    """
    if file.pilot is None:
        return None
    toml = _path_inside(path, "pilot", f"{file.pilot}/{path.name}")
    require(
        toml.parent.resolve() != path.parent.resolve(),
        f"{path}: pilot must be a folder inside the plan's, got {file.pilot!r}, which is the plan's"
        " own. Copy the pilot's folder into it.",
    )
    require(
        "pilot" not in read_toml(toml),
        f"{toml} must be a campaign without a pilot, got one that names its own. Take that out.",
    )
    tests, pilot_fields = read_campaign_toml(toml)
    with placed(toml):
        return Campaign(tests, **pilot_fields)


def _fill_from_certificates(path: Path, content: dict[str, Any]) -> None:
    """In each table of campaign.toml, replace the key ``dcc`` with what the certificate states.

    The key ``dcc`` names the file of a digital calibration certificate (DCC). ``content`` is the
    content of the campaign.toml at ``path`` and is changed in place. Raise an `InputError` if the
    key is no text, or if a table and its certificate both give the same value.
    """
    tables = {"bar": content.get("bar"), "force": content.get("force")}
    balls = content.get("balls", {})
    if isinstance(balls, dict):
        tables["balls.work"] = balls.get("work")
        tables["balls.tool"] = balls.get("tool")
    for name, table in tables.items():
        if not isinstance(table, dict) or "dcc" not in table:
            continue
        dcc = table.pop("dcc")
        if not isinstance(dcc, str):
            raise InputError(
                f"{path}: dcc of [{name}] must be the name of a certificate's file, got {dcc!r}."
                ' Write it like dcc = "bar.xml".'
            )
        certified = "ball" if name.startswith("balls.") else name
        certificate = read_dcc(_path_inside(path, f"[{name}]: dcc", dcc))
        radius_mm = content.get("radius_mm")
        bar_length_mm = float(radius_mm) if isinstance(radius_mm, int | float) else None
        stated = certificate.fields(certified, bar_length_mm=bar_length_mm)
        for key in stated:
            require(
                key not in table,
                f"{path}: [{name}] must have {key} or take it from its dcc, got both. Keep one of"
                " them.",
            )
        table |= stated


def _mount_of(path: Path, file: _CampaignFile, content: Mapping[str, Any]) -> MountCompensation:
    """Return the deflection of the work ball's mount, and whether readings are corrected for it.

    The deflection is in µm per bar of air pressure. If campaign.toml gives a stiffness [N/µm]
    instead, the slope of the bar's force law [N/bar] is divided by the stiffness to obtain the
    deflection. Raise an `InputError` if campaign.toml gives both stiffness and deflection.

    Parameters
    ----------
    path
        Path of campaign.toml.
    file
        Validated content of campaign.toml, with default values for missing keys.
    content
        Content of campaign.toml without default values.
    """
    stated = content.get("mount", {}).keys()
    require(
        not {"stiffness_N_per_um", "deflection_um_per_bar"} <= stated,
        f"{path}: [mount] must have stiffness_N_per_um or deflection_um_per_bar, got both. Keep one"
        " of them.",
    )
    deflection_um_per_bar = file.mount.deflection_um_per_bar
    key = "deflection_um_per_bar"
    if file.mount.stiffness_N_per_um:
        key = "stiffness_N_per_um"
        deflection_um_per_bar = file.force_law.slope_N_per_bar / file.mount.stiffness_N_per_um
    with placed(f"{path}: {key} of [mount]"):
        return MountCompensation(deflection_um_per_bar, file.mount.compensated)


def _instrument_of(path: Path, file: _CampaignFile) -> Instrument:
    """Return the instrument with the certified values that the tables of campaign.toml state.

    ``file`` is the validated content of the campaign.toml at ``path``.
    """
    tables = {"bar": file.bar, "mount": file.mount, "force": file.force_law, "angle": file.angle}
    stated: dict[str, Any] = {"work": file.balls.work, "tool": file.balls.tool}
    for table_name, table in tables.items():
        for key, value in vars(table).items():
            stated[f"{table_name}_{key}"] = value
    with placed(path):
        return Instrument(**{entry.name: stated[entry.name] for entry in fields(Instrument)})


def _read_test(toml: Path, number: int, entry: _TestFile) -> CircularTest:
    """Return the test that one table [[test]] of campaign.toml describes.

    If the table names a file, the readings are read from this file. Otherwise the test is a planned
    test, which has no readings. ``toml`` is the path of campaign.toml, and ``entry`` the validated
    content of the table. ``number`` is 1 for the first table [[test]], 2 for the second, and so on;
    error messages state this number.
    """
    if entry.file is None:
        return _planned_test(f"{toml}, test {number}", entry)
    stated = _stated_values(entry)
    file = stated.pop("file")
    # The table of a planned test states how its circle was to be run. When the circle has been run,
    # the operator adds its file; the readings then say how it was run.
    for key in _PLAN_KEYS:
        stated.pop(key, None)
    path = _path_inside(toml, f"test {number}: file", file)
    test_fields: dict[str, Any] = {"name": Path(file).stem, **stated, **read_readings(path)}
    with placed(path):
        return CircularTest(**test_fields)


def _planned_test(place: str, entry: _PlannedTest) -> CircularTest:
    """Return the planned test that a table of campaign.toml describes; it has no readings.

    The table is [[test]] or [[foreseen]]. ``place`` names the table in error messages; ``entry`` is
    the validated content of the table.
    """
    stated = _stated_values(entry)
    plan = {key: stated.pop(key) for key in _PLAN_KEYS if key in stated}
    with placed(place):
        return CircularTest(angle_deg=_planned_angles(plan), **stated)


def _stated_values(entry: _PlannedTest) -> dict[str, Any]:
    """Return what a table of campaign.toml states about a test without readings.

    The result is a dictionary; its keys are names of fields of `CircularTest`, such as force_N.
    """
    return {key: value for key, value in vars(entry).items() if value is not None}


def _planned_angles(plan: Mapping[str, Any]) -> Any:
    """Return the evenly spaced angles of a planned test [deg].

    ``plan`` has keys of campaign.toml: readings is the number of readings, start_deg the first
    angle, and arc_deg the arc. Their default values are 720, 0° and 360°. The angles include both
    ends of the arc, but in a full turn the first angle is not repeated.
    """
    readings = plan.get("readings", _PLANNED_READINGS)
    return planned_angles(readings, plan.get("start_deg", 0.0), plan.get("arc_deg", 360.0))


def _path_inside(toml: Path, place: str, file: str) -> Path:
    """Return the path of a file that campaign.toml names.

    Raise an `InputError` if the file does not exist, or is not inside the campaign's folder after
    symbolic links are followed.

    Parameters
    ----------
    toml
        Path of campaign.toml.
    place
        Place in campaign.toml that names the file, for error messages.
    file
        Name of the file, relative to the campaign's folder.
    """
    folder = toml.parent
    root = folder.resolve()
    subject = f"{toml}, {place} must"
    try:
        path = (root / file).resolve()
        is_file = path.is_file()
    except (OSError, RuntimeError, ValueError):
        raise InputError(
            f"{subject} be the name of one, got {file[:80]!r}, which leads nowhere. Check the name."
        ) from None
    require(
        path.is_relative_to(root) and not Path(file).is_absolute(),
        f"{subject} lie inside {folder}, got {file!r}. Copy it there and use a relative name.",
    )
    require(
        is_file, f"{subject} exist, got {file!r}, which is no file in {folder}. Check the name."
    )
    return folder / file
