"""What stands where in a table of readings: columns, units and what holds for whole tests, kept in TOML."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import tomli_w
from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator
from pydantic_core import ErrorDetails

from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.tables.units import UNITS, in_ours, unit_named
from ldbb_bayes.toml import read_toml

__all__ = [
    "ROLES",
    "Layout",
    "TestLayout",
    "layout_to_toml",
    "read_layout",
]

# Words by which headers name what a column holds, in the order they are tried, and what is kept of it.
ROLES: dict[str, tuple[str, ...]] = {
    "angle": ("angle", "theta", "θ", "winkel", "angolo", "drehwinkel", "phi", "φ", "position"),
    "reading": (
        "reading",
        "radius",
        "deviation",
        "rho",
        "ρ",
        "abweichung",
        "messwert",
        "ldbb",
        "ballbar",
        "dbb",
        "error",
        "displacement",
        "delta",
        "verlagerung",
        "value",
    ),
    "time": ("time", "zeit", "tempo", "t"),
    "force": ("force", "kraft", "prüfkraft", "messkraft", "radialkraft", "forza", "last", "load", "f"),
    "pressure": ("pressure", "druck", "prüfdruck", "regeldruck", "messdruck", "pressione", "p"),
    "test": ("test", "circle", "run", "file", "versuch", "kreis"),
    "direction": ("direction", "dir", "richtung", "sense"),
}


# Fields whose option bears another name.
_OPTIONS = {"reading_unit": "--unit", "columns": "--…-column", "forces_N": "--forces-N"}


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class TestLayout(_Strict):
    """What one file (or sheet, or name in the test column) is, where the table does not say."""

    __test__ = False

    file: str
    name: str | None = None
    force_N: float | None = None
    pressure_bar: float | None = None
    direction: Literal["CW", "CCW"] | None = None
    work_ball_deg: float | None = None
    tool_ball_deg: float | None = None
    radius_mm: float | None = None
    setup: int | None = None
    temperature_C: float | None = None
    time_s: float | None = None
    start_deg: float | None = None


class Layout(_Strict):
    """How tables are read. None: found out from each file, and said.

    Attributes
    ----------
    encoding, separator, decimal, sheets, header_line
        Of the files; a header line of 0 says there is none, columns then go by number from 1.
    columns : dict of role to column
        Header as the file has it, or its number from 1; of the reading also a list of them, each a test.
    forces_N, pressures_bar : list of float
        Of the tests, in the order they stand in files, sheets and rows; before what a [[test]] says.
    reading_unit, angle_unit, time_unit, force_unit, pressure_unit
    zero : {"deviation", "distance"}
        Whether readings are deviations from the nominal radius, or distances of the balls.
    sign : {1, -1}
        −1 where the instrument counts a longer bar as negative.
    angle_sign : {1, -1}
        −1 where the file counts clockwise.
    angle_offset_deg : float
        Angle of the plane's first axis, as the file counts: θ = angle_sign · (angle − angle_offset_deg).
    start_deg, overshoot_deg, feed_mm_per_min, direction
        Of a log over time: angle where the circle begins, run-in before it, feed along the circle.
    laps : {"keep", "average"}
        Of a recording longer than a turn.
    """

    schema_: Literal[1] = Field(default=1, alias="schema")
    encoding: str | None = None
    separator: str | None = None
    decimal: Literal[".", ","] | None = None
    header_line: int | None = Field(default=None, ge=0)
    sheets: list[str] = Field(default_factory=list)
    columns: dict[str, str | int | list[str | int]] = Field(default_factory=dict)
    forces_N: list[float] = Field(default_factory=list)
    pressures_bar: list[float] = Field(default_factory=list)
    reading_unit: str | None = None
    angle_unit: str | None = None
    time_unit: str | None = None
    force_unit: str | None = None
    pressure_unit: str | None = None
    zero: Literal["deviation", "distance"] | None = None
    sign: Literal[1, -1] = 1
    angle_sign: Literal[1, -1] = 1
    angle_offset_deg: float = 0.0
    start_deg: float | None = None
    overshoot_deg: float | None = Field(default=None, ge=0.0)
    feed_mm_per_min: float | None = Field(default=None, gt=0.0)
    direction: Literal["CW", "CCW"] | None = None
    laps: Literal["keep", "average"] | None = None
    test: list[TestLayout] = Field(default_factory=list)

    @field_validator("reading_unit", "angle_unit", "time_unit", "force_unit", "pressure_unit")
    @classmethod
    def _known_unit(cls, value: str | None, info: ValidationInfo) -> str | None:
        role = str(info.field_name).removesuffix("_unit")
        if value is None:
            return None
        named = unit_named(value)
        if in_ours(role, named) is None:
            raise ValueError(f"it should be one of {', '.join(UNITS[role])}")
        return named

    @field_validator("test")
    @classmethod
    def _each_once(cls, tests: list[TestLayout]) -> list[TestLayout]:
        files = [entry.file for entry in tests]
        twice = next((file for k, file in enumerate(files) if file in files[:k]), None)
        if twice is not None:
            raise ValueError(f"[[test]] must be one for each file, sheet or label, got two for {twice!r}")
        return tests

    @field_validator("columns")
    @classmethod
    def _one_column(cls, columns: dict[str, str | int | list[str | int]]) -> dict[str, str | int | list[str | int]]:
        many = next((role for role, column in columns.items() if role != "reading" and isinstance(column, list)), None)
        if many is not None:
            raise ValueError(f"the {many} must be one column")
        return columns

    def with_given(self, given: dict[str, Any]) -> Layout:
        """The layout with what options say over it; options left at None do not speak."""
        spoken = {key: value for key, value in given.items() if value is not None}
        of_tests = spoken.keys() & TestLayout.model_fields.keys()
        if {"forces_N", "pressures_bar"} & spoken.keys():
            of_tests |= {"force_N", "pressure_bar"}
            spoken = {"forces_N": [], "pressures_bar": []} | spoken
        if of_tests and "test" not in given:
            spoken["test"] = [entry.model_dump(exclude=set(of_tests), exclude_none=True) for entry in self.test]
        try:
            return Layout.model_validate({**self.model_dump(by_alias=True), **spoken})
        except ValidationError as error:
            first = error.errors()[0]
            name = str(first["loc"][0]) if first["loc"] else "layout"
            option = _OPTIONS.get(name, "--" + name.replace("_", "-"))
            raise InputError(f"{option} must be valid, got {first['input']!r}: {_why(first)}. Correct it.") from None

    def of(self, *names: str) -> tuple[TestLayout | None, set[str]]:
        """What is said of a test, by any of its names, the first of them before the others; and the entries that say it."""
        own = sorted((entry for entry in self.test if entry.file in names), key=lambda entry: -names.index(entry.file))
        said: dict[str, Any] = {}
        for entry in own:
            said |= entry.model_dump(exclude_none=True)
        return (TestLayout.model_validate(said) if own else None), {entry.file for entry in own}


def layout_to_toml(layout: Layout) -> str:
    """What was found out and said, so that the next import needs no guess."""
    content = layout.model_dump(by_alias=True, exclude_none=True)
    tests = content.pop("test")
    content = {key: value for key, value in content.items() if value not in ([], {})}
    return tomli_w.dumps(content) + "".join(f"\n[[test]]\n{tomli_w.dumps(entry)}" for entry in tests)


def read_layout(path: Path) -> Layout:
    """A layout from TOML.

    Raises
    ------
    InputError
        For a file that is missing, too large or no TOML, and for unknown keys, columns and values; it names the place.
    """
    content = read_toml(path)
    check_known(f"{path}: key", content, [field.alias or name for name, field in Layout.model_fields.items()])
    tests = content.get("test")
    for k, entry in enumerate(tests if isinstance(tests, list) else [], start=1):
        if isinstance(entry, dict):
            check_known(f"{path}, [[test]] {k}: key", entry, TestLayout.model_fields)
            if "file" not in entry:
                raise InputError(
                    f"{path}, [[test]] {k} must have the key file, got none. Name the file, the sheet, "
                    "or the label in the column of tests."
                )
    try:
        layout = Layout.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        parts = first["loc"][: 3 if first["loc"][0] == "test" else 2]
        place = ".".join(str(part + 1 if isinstance(part, int) else part) for part in parts)
        raise InputError(f"{path}: {place!r} must be valid, got {first['input']!r}: {_why(first)}. Correct it.") from None
    check_known(f"{path}: columns key", layout.columns, ROLES)
    return layout


def _why(error: ErrorDetails) -> str:
    """What is wrong, without the library's own words."""
    return error["msg"].removeprefix("Value error, ")
