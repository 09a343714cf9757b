"""How tables are written: units and words for columns, what a user says of them, and notes of what was assumed."""

from __future__ import annotations

import os
import tomllib
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import Annotated, Any, Literal

import tomli_w
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationInfo, field_validator
from pydantic.dataclasses import dataclass

from ldbb_bayes.campaign.campaign import Number, TestFields
from ldbb_bayes.errors import check_known
from ldbb_bayes.files import read_toml, validated
from ldbb_bayes.result import Shown

__all__ = [
    "ROLES", "UNITS", "WORDS", "Assumption", "Layout", "Notes", "TestLayout", "layout_to_toml", "plain", "read_layout",
    "unit_named",
]  # fmt: skip

# Words and units by which files name what they hold, in English, German and some others.
WORDS: Mapping[str, Any] = tomllib.loads((Path(__file__).parent / "words.toml").read_text(encoding="utf-8"))
UNITS: Mapping[str, Mapping[str, float]] = {
    role: {unit: float(one) for unit, (one, *_) in units.items()} for role, units in WORDS["units"].items()
}
ROLES: Mapping[str, Sequence[str]] = {role: words.split() for role, words in WORDS["roles"].items()}


def plain(text: str) -> str:
    """For comparing: one sign for micro, no capitals, no blanks or dots around it."""
    return unicodedata.normalize("NFKC", text).casefold().strip(" .:")


_BY_WORD = {
    plain(word): unit for units in WORDS["units"].values() for unit, (_, *words) in units.items() for word in (unit, *words)
}


def unit_named(text: str) -> str:
    """Return our name of a unit; empty where the text is none."""
    return _BY_WORD.get(plain(text), "") if len(text) <= 40 else ""


@dataclass(frozen=True, kw_only=True, config=ConfigDict(extra="forbid"))
class TestLayout(TestFields):
    """What one file (or sheet, or name in the test column) is, where the table does not say."""

    file: str
    start_deg: Number | None = None

    def stated(self) -> dict[str, Any]:
        """What it says, the file's name included."""
        return {key: value for key, value in vars(self).items() if value is not None}


def _known_encoding(name: str) -> str:
    try:
        "".encode(name)
    except (LookupError, ValueError):
        raise ValueError("it should be one that Python knows, for example utf-8, utf-16-le, utf-16-be, cp1252") from None
    return name


def _sign(separator: str) -> str:
    named = {"comma": ",", "semicolon": ";", "tab": "\t", "bar": "|", "space": " "}
    if separator not in (*named, *named.values()):
        raise ValueError(f"it should be one of {', '.join(named)}, or the sign itself")
    return named.get(separator, separator)


_Column = str | int | list[str | int]


class Layout(Shown, BaseModel, extra="forbid", allow_inf_nan=False):
    """How tables are read. None: found out from each file, and said."""

    schema_: Literal[1] = Field(default=1, alias="schema")
    encoding: Annotated[str, AfterValidator(_known_encoding)] | None = None
    separator: Annotated[str, AfterValidator(_sign)] | None = None
    decimal: Literal[".", ","] | None = None
    header_line: int | None = Field(default=None, ge=0)  #: 0: there is none, columns then go by number from 1
    sheets: list[str] = Field(default_factory=list)
    columns: dict[str, _Column] = Field(default_factory=dict)  #: by role: header or number; several of the reading, each a test
    #: Of the tests, in the order they stand in files, sheets and rows; before what a [[test]] says.
    forces_N: list[Number] = Field(default_factory=list)
    pressures_bar: list[Number] = Field(default_factory=list)
    reading_unit: str | None = None
    angle_unit: str | None = None
    time_unit: str | None = None
    force_unit: str | None = None
    pressure_unit: str | None = None
    zero: Literal["deviation", "distance"] | None = None  #: readings are deviations from the radius, or distances of the balls
    sign: Literal[1, -1] = 1  #: −1 where the instrument counts a longer bar as negative
    angle_sign: Literal[1, -1] = 1  #: −1 where the file counts clockwise
    angle_offset_deg: float = 0.0  #: of the plane's first axis, as the file counts: θ = angle_sign · (angle − angle_offset_deg)
    start_deg: float | None = None  #: of a log over time: where the circle begins
    overshoot_deg: float | None = Field(default=None, ge=0.0)  #: likewise: run-in before it
    feed_mm_per_min: float | None = Field(default=None, gt=0.0)  #: likewise: along the circle
    direction: Literal["CW", "CCW"] | None = None
    laps: Literal["keep", "average"] | None = None  #: of a recording longer than a turn
    test: list[TestLayout] = Field(default_factory=list)

    @field_validator("reading_unit", "angle_unit", "time_unit", "force_unit", "pressure_unit")
    @classmethod
    def _known_unit(cls, value: str | None, info: ValidationInfo) -> str | None:
        role = str(info.field_name).removesuffix("_unit")
        named = unit_named(value or "")
        if value is not None and named not in UNITS[role]:
            raise ValueError(f"it should be one of {', '.join(UNITS[role])}")
        return named or None

    @field_validator("test")
    @classmethod
    def _each_once(cls, tests: list[TestLayout]) -> list[TestLayout]:
        files = [entry.file for entry in tests]
        for file in (file for k, file in enumerate(files) if file in files[:k]):
            raise ValueError(f"[[test]] must be one for each file, sheet or label, got two for {file!r}")
        return tests

    @field_validator("columns")
    @classmethod
    def _one_column(cls, columns: dict[str, _Column]) -> dict[str, _Column]:
        for role in (role for role, column in columns.items() if role != "reading" and isinstance(column, list)):
            raise ValueError(f"the {role} must be one column")
        return columns

    def with_given(self, given: dict[str, Any]) -> Layout:
        """The layout with what options say over it; options left at None do not speak."""
        spoken = {key: value for key, value in given.items() if value is not None}
        of_tests = spoken.keys() & TestLayout.__dataclass_fields__.keys()
        if {"forces_N", "pressures_bar"} & spoken.keys():
            of_tests |= {"force_N", "pressure_bar"}
            spoken = {"forces_N": [], "pressures_bar": []} | spoken
        if of_tests and "test" not in given:
            spoken["test"] = [{key: value for key, value in entry.stated().items() if key not in of_tests} for entry in self.test]
        return validated(Layout, {**self.model_dump(by_alias=True), **spoken}, "options")


def layout_to_toml(layout: Layout) -> str:
    """What was found out and said, so that the next import needs no guess."""
    content = layout.model_dump(by_alias=True, exclude_none=True)
    tests = content.pop("test")
    content = {key: value for key, value in content.items() if value not in ([], {})}
    return tomli_w.dumps(content) + "".join(f"\n[[test]]\n{tomli_w.dumps(entry)}" for entry in tests)


def read_layout(path: str | os.PathLike[str]) -> Layout:
    """Return a layout from TOML. InputError names the place of what does not fit."""
    layout = validated(Layout, read_toml(Path(path)), str(path))
    check_known(f"{path}: columns key", layout.columns, ROLES)
    return layout


@dataclass(frozen=True)
class Assumption:
    """What was assumed in a file, sheet or test, or in how many (empty: in all), and the option to say otherwise."""

    place: str
    what: str
    value: str
    because: str
    option: str


@dataclass
class Notes:
    """What was assumed and found out on the way; what is the same in several places is told once."""

    _told: dict[tuple[str, str, str, str], list[str]] = field(default_factory=dict)
    _found: dict[str, list[Any]] = field(default_factory=dict)

    def add(self, place: str, what: str, value: str, because: str, option: str) -> None:
        """Tell that ``what`` was taken to be ``value`` in a place."""
        self._told.setdefault((what, value, because, option), []).append(place)

    def keep(self, **fields: Any) -> None:
        """Fields of the layout as found out in one sheet; None: the sheet says it itself."""
        for key, value in fields.items():
            self._found.setdefault(key, []).append(value)

    def told(self) -> tuple[Assumption, ...]:
        """In the order of their first places."""
        return tuple(
            Assumption(places[0] if len(places) == 1 else f"{len(places)} places" if places[0] else "", *key)
            for key, places in self._told.items()
        )

    def layout(self, given: Layout) -> Layout:
        """What was given, and how the sheets are written where all are alike. What they say of the tests is for them to say."""
        return given.with_given({key: own[0] for key, own in self._found.items() if all(value == own[0] for value in own)})
