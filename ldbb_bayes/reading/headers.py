"""What stands around the numbers of a sheet: the header and its columns, the lines above, loads and
directions in names; what a user says of it, a layout; and notes of what was assumed."""

from __future__ import annotations

import math
import os
import re
import tomllib
import unicodedata
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import date
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

import tomli_w
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationInfo, field_validator
from pydantic.dataclasses import dataclass as checked

from ldbb_bayes.campaign.campaign import PER_TEST, Number, TestFields
from ldbb_bayes.errors import InputError, check_known, nearest, require
from ldbb_bayes.files import read_toml, validated
from ldbb_bayes.reading.spreadsheet import (
    Rows,
    Sheet,
    could_be_thousands,
    is_missing,
    looks_like_number,
    number,
)
from ldbb_bayes.results import Shown

__all__ = [
    "UNITS",
    "WORDS",
    "Assumption",
    "Heading",
    "Layout",
    "Notes",
    "Said",
    "TestLayout",
    "directions_said",
    "find_headings",
    "layout_to_toml",
    "load_in_name",
    "load_is_ambiguous",
    "not_understood",
    "note_heading",
    "plane_in_name",
    "radius_in_name",
    "read_layout",
    "said_above",
    "said_elsewhere",
    "unit_of",
]

# Words and units by which files name what they hold, in English, German and some others.
WORDS: Mapping[str, Any] = tomllib.loads(
    (Path(__file__).parent / "words.toml").read_text(encoding="utf-8")
)
UNITS: Mapping[str, Mapping[str, float]] = {
    role: {unit: float(one) for unit, (one, *_) in units.items()}
    for role, units in WORDS["units"].items()
}
ROLES: Mapping[str, Sequence[str]] = {role: words.split() for role, words in WORDS["roles"].items()}


def plain(text: str) -> str:
    """For comparing: one sign for micro, no capitals, no blanks or dots around it."""
    return unicodedata.normalize("NFKC", text).casefold().strip(" .:")


_BY_WORD = {
    plain(word): unit
    for units in WORDS["units"].values()
    for unit, (_, *words) in units.items()
    for word in (unit, *words)
}


def unit_named(text: str) -> str:
    """Return our name of a unit; empty where the text is none."""
    return _BY_WORD.get(plain(text), "") if len(text) <= 40 else ""


@checked(frozen=True, kw_only=True, config=ConfigDict(extra="forbid"))
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
        raise ValueError(
            "it should be one that Python knows, for example utf-8, utf-16-le, utf-16-be, cp1252"
        ) from None
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
    #: 0: there is none, columns then go by number from 1
    header_line: int | None = Field(default=None, ge=0)
    sheets: list[str] = Field(default_factory=list)
    #: by role: header or number; several of the reading, each a test
    columns: dict[str, _Column] = Field(default_factory=dict)
    #: Of the tests, in the order they stand in files, sheets and rows; before what a [[test]] says.
    forces_N: list[Number] = Field(default_factory=list)
    pressures_bar: list[Number] = Field(default_factory=list)
    reading_unit: str | None = None
    angle_unit: str | None = None
    time_unit: str | None = None
    force_unit: str | None = None
    pressure_unit: str | None = None
    #: readings are deviations from the radius, or distances of the balls
    zero: Literal["deviation", "distance"] | None = None
    sign: Literal[1, -1] = 1  #: −1 where the instrument counts a longer bar as negative
    angle_sign: Literal[1, -1] = 1  #: −1 where the file counts clockwise
    #: of the plane's first axis, as the file counts: θ = angle_sign · (angle − angle_offset_deg)
    angle_offset_deg: float = 0.0
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
            raise ValueError(
                f"[[test]] must be one for each file, sheet or label, got two for {file!r}"
            )
        return tests

    @field_validator("columns")
    @classmethod
    def _one_column(cls, columns: dict[str, _Column]) -> dict[str, _Column]:
        for role in (
            role
            for role, column in columns.items()
            if role != "reading" and isinstance(column, list)
        ):
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
            spoken["test"] = [
                {key: value for key, value in entry.stated().items() if key not in of_tests}
                for entry in self.test
            ]
        return validated(Layout, {**self.model_dump(by_alias=True), **spoken}, "options")


def layout_to_toml(layout: Layout) -> str:
    """What was found out and said, so that the next import needs no guess."""
    content = layout.model_dump(by_alias=True, exclude_none=True)
    tests = content.pop("test")
    content = {key: value for key, value in content.items() if value not in ([], {})}
    return tomli_w.dumps(content) + "".join(
        f"\n[[test]]\n{tomli_w.dumps(entry)}" for entry in tests
    )


def read_layout(path: str | os.PathLike[str]) -> Layout:
    """Return a layout from TOML. InputError names the place of what does not fit."""
    layout = validated(Layout, read_toml(Path(path)), str(path))
    check_known(f"{path}: columns key", layout.columns, ROLES)
    return layout


@dataclass(frozen=True)
class Assumption:
    """What was assumed in a file, sheet or test, or in how many (empty: in all), and the option to
    say otherwise."""

    place: str
    what: str
    value: str
    because: str
    option: str


@dataclass
class Notes:
    """What was assumed and found out on the way; what is the same in several places is told
    once."""

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
            Assumption(
                places[0] if len(places) == 1 else f"{len(places)} places" if places[0] else "",
                *key,
            )
            for key, places in self._told.items()
        )

    def layout(self, given: Layout) -> Layout:
        """What was given, and how the sheets are written where all are alike. What they say of the
        tests is for them to say."""
        return given.with_given(
            {
                key: own[0]
                for key, own in self._found.items()
                if all(value == own[0] for value in own)
            }
        )


# Signs of a line that are looked at, and of a name; lines above a table; rows of numbers that make
# one.
_LONGEST = 300
_LONGEST_NAME = 200
_LARGEST_ABOVE = 1000
_BLOCK = 9
_NUMBER = r"[+\-−]?(?:\d+(?:[.,]\d+)?|[.,]\d+)(?:[eE][+\-]?\d{1,3})?"
# A number, not the beginning of a clock, a date or a longer number.
_WHOLE = r"(?![\d:/]|[.,]\d|[\-−]\d|\s\d{3}(?!\d))"
_MONTHS = (
    "jan",
    "feb",
    "mar mär",
    "apr",
    "may mai",
    "jun",
    "jul",
    "aug",
    "sep",
    "oct okt",
    "nov",
    "dec dez",
)
_PARTS = dict[str, str]()
for _name, _text in WORDS["parts"].items():
    _PARTS[_name] = _text % _PARTS
_BETWEEN = _PARTS["between"]


def _units_of(units: str | Mapping[str, float], one: float = 1.0) -> Mapping[str, float]:
    return {
        unit: one * size
        for unit, size in (UNITS[units] if isinstance(units, str) else units).items()
    }


# By word: the unit meant where none is named, and all units with what one is in ours.
_SAID: Mapping[str, tuple[str, str, Mapping[str, float]]] = {
    key: (own["words"], own["unit"], _units_of(own["units"], own.get("one", 1.0)))
    for key, own in WORDS["numbers"].items()
}
_NAMES = {key: words % _PARTS for key, words in WORDS["names"].items()}
_AND_CALIBRATED = _PARTS["calibrated"]
_VALUE = rf"{_PARTS['cell']}(?:%s)\s*(?:[:=]\s*[;,|\t]?|[;|\t])\s*(\w(?:[^;,|\t]|,\s)*)"
_IN_WORDS = {key: words % _PARTS for key, words in WORDS["in_words"].items()}
_IN_WORDS |= {key: _VALUE % words for key, words in _NAMES.items()}
_KEY = re.compile(
    "|".join((*_NAMES.values(), "date|datum|plane|ebene", _AND_CALIBRATED)), re.IGNORECASE
)
_READINGS = re.compile(WORDS["mount"]["readings"], re.IGNORECASE)
_FILLING = re.compile(f"{_READINGS.pattern}|{WORDS['mount']['filling']}", re.IGNORECASE)
_MOUNT = {name: WORDS["mount"][name] for name in ("raw", "compensated")}
_ANOTHER = re.compile(rf"\b(?:{WORDS['others']['words']})\b", re.IGNORECASE)
_IN_NAME = re.compile(
    rf"(?<![\d.,A-Za-z])({_NUMBER})[ _-]?(kN|daN|N|newton|bar|mbar|MPa|kPa|psi)(?![a-zA-Z])",
    re.IGNORECASE,
)
# A decimal mark that a file name cannot hold (3_5bar), marks between thousands (1 238 N; there is
# no force of 10 236 N).
_CUT = re.compile(
    r"\d[_p\-]\d+[ _]?(?:[a-z]*bar|kN|MPa|kPa|psi)|(?<!\d)0[_p\-]\d+[ _]?N(?![a-z])|\d[_p\-]\d["
    r" _]?N(?![a-z])"
    r"|(?<![a-zA-Z\d])[1-5][ ']\d{3}[ _]?k?N(?![a-z])",
    re.IGNORECASE,
)
# Three digits at most: F2000 is a feed.
_AS_F = re.compile(r"(?<![a-zA-Z0-9])[fF](\d{2,3})(?![\d.,])")
# A radius from 50 mm on: R10 numbers a run.
_AS_R = re.compile(
    r"(?<![a-zA-Z0-9])R(?:adius)?[ _=]?([5-9]\d|[1-9]\d{2,3})(?:[ _]?mm)?(?![a-zA-Z\d.,])"
)
_PLANE = re.compile(r"(?<![a-zA-Z])(XY|YX|YZ|ZY|ZX|XZ)(?![a-zA-Z])")
_TURNED = {"YX": "XY", "ZY": "YZ", "XZ": "ZX"}
# Up to these a number with a mark before three digits may be of thousands.
_LARGEST = {"force_N": 5000.0, "radius_mm": 2000.0, "feed_mm_per_min": 100_000.0}
_WAYS: Mapping[str, Any] = WORDS["directions"]
_SENSE = re.compile(
    rf"(?<![a-zA-Z])({_WAYS['clock_hand']}|ccw|cw|{_WAYS['in_words']})(?![a-z])", re.IGNORECASE
)
_DIRECTION = re.compile(_WAYS["after"], re.IGNORECASE)
Lines = Sequence[tuple[int | str, str]]


@dataclass(frozen=True)
class Said:
    """One value of a line above the table, in the unit of its field's name; NaN where it is not
    clear which: 1,000."""

    value: Any
    unit: str
    line: int | str


def said_above(above: Lines) -> dict[str, list[Said]]:
    """Everything the lines say, by field; what is in no known unit, or of another kind (maximum,
    ambient, …), is left alone."""
    found: dict[str, list[Said]] = {}
    for line, text in above:
        for key, (words, usual, units) in _SAID.items():
            for match in _pattern(words).finditer(text[:_LONGEST]):
                before = (
                    re.split(r"[;,|\t]", text[: match.start()])[-1]
                    + match[0][: match.start("number") - match.start()]
                )
                if _ANOTHER.search(before) or _ANOTHER.fullmatch(match["after"]):
                    continue
                after = (
                    "" if match["cell"] and _unit(match["after"], units) is None else match["after"]
                )
                named = match["inside"] or match["brackets"] or after
                unit = _unit(named, units) if named else usual
                if unit:
                    value = (
                        math.nan
                        if _may_be_thousands(key, match["number"])
                        else _value(match["number"]) * units[unit]
                    )
                    found.setdefault(key, []).append(Said(value, named, line))
        for key, text_said in _said_in_words(text[:_LONGEST]):
            found.setdefault(key, []).append(Said(text_said, "", line))
    return found


def _said_in_words(text: str) -> Iterator[tuple[str, str]]:
    """Plane, date [ISO 8601], names of machine, people and instruments, and whether readings are
    raw or compensated."""
    for key, pattern in _IN_WORDS.items():
        for match in re.finditer(pattern, text, re.IGNORECASE):
            value = next(filter(None, match.groups())).strip()
            value = re.sub("[-/]", "", value.upper()) if key == "plane" else value
            value = _iso(value) if key in ("date", "ball_bar_calibrated") else value
            if key in _NAMES:
                column = _KEY.fullmatch(value) or (
                    _is_header(value) and not re.search(r"[:=\d]", match[0])
                )
                column = column and not (
                    key == "ball_bar" and re.fullmatch(_PARTS["product"], value, re.IGNORECASE)
                )
                value = "" if column else re.split(rf",\s*{_AND_CALIBRATED}", value, flags=re.I)[0]
            if value.isprintable() and not is_missing(value or "-"):
                yield key, value
    for part in (text, *re.split(r"[;|\t]|,(?!\s)", text)):
        rest = " ".join(_FILLING.sub(" ", part.casefold()).split())
        if _READINGS.search(part) or (part == text and "ompens" in rest):
            yield from (
                ("mount", name) for name, pattern in _MOUNT.items() if re.fullmatch(pattern, rest)
            )


def _iso(text: str) -> str:
    """A date as ISO 8601; empty for one that the calendar lacks."""
    parts = [part for part in re.split(r"[-/., ]+", text.casefold()) if part]
    parts = [parts[1], parts[0], parts[2]] if parts[0].isalpha() else parts
    if parts[1].isalpha():
        parts[1] = next(
            (str(k) for k, names in enumerate(_MONTHS, start=1) if parts[1][:3] in names), "0"
        )
    year, month, day = map(int, parts if len(parts[0]) == 4 else reversed(parts))
    try:
        return date(year, month, day).isoformat()
    except ValueError:
        return ""


def _is_header(cell: str) -> bool:
    """Whether a cell names a column."""
    return any(_called(unit_of(cell)[0], role) for role in ROLES)


@cache
def _pattern(words: str) -> re.Pattern[str]:
    """Words, a unit in brackets or after "in", the number, and what follows it."""
    unit = r"(?:in\s+(?P<inside>[^\s:=;,|]+)|[\[(](?P<brackets>[^\])]*)[\])])"
    rest = r"\s*(?P<cell>[;|,\t]?)\s*(?P<after>[^\s;,|()\[\]]*)"
    return re.compile(
        rf"\b{words}\b{_BETWEEN}{{0,4}}(?:{unit}{_BETWEEN}{{0,4}})?(?P<number>{_NUMBER}){_WHOLE}(?!'){rest}",
        re.IGNORECASE,
    )


def _unit(named: str, units: Mapping[str, float]) -> str | None:
    wanted = {named.casefold(), unit_named(named).casefold()}
    return next((unit for unit in units if unit.casefold() in wanted), None)


def _value(text: str) -> float:
    return number(text, "," if "," in text else ".")


def _may_be_thousands(key: str, text: str) -> bool:
    """Whether a mark before three digits may stand between thousands, by the sizes there are:
    ``1,000 N``, not ``150.000 mm``."""
    return could_be_thousands(text) and float(re.sub(r"[^\d]", "", text)) <= _LARGEST.get(key, 0.0)


def directions_said(above: Lines, names: Sequence[str]) -> set[str]:
    """CW and CCW as the lines above say them after a word for direction, and as the first name
    holds them that holds any."""
    found = next((senses for name in names if (senses := _senses(name[:_LONGEST]))), set())
    for text in (match[1] for _, line in above if (match := _DIRECTION.search(line[:_LONGEST]))):
        both = len(_senses(text)) > 1
        # Of a line that lists both before it says one, what stands behind the last mark: (CW/CCW):
        # CCW.
        found = found | _senses(re.split(r"[:=;|\t]", text)[-1] if both else text)
    return found


def _senses(text: str) -> set[str]:
    return {
        "CCW" if match[1].casefold().startswith(tuple(_WAYS["counter"])) else "CW"
        for match in _SENSE.finditer(text)
    }


def load_in_name(names: Sequence[str], kind: str = "") -> tuple[str, float, str] | None:
    """Field (of one kind if asked), value and the name that says it alone: ``238N``, ``2.5 bar``,
    ``f238``."""
    for name in names:
        found = [(text, unit_named(word)) for text, word in _IN_NAME.findall(name[:_LONGEST])]
        said = [
            ("force_N", text, UNITS["force"][unit])
            for text, unit in found
            if unit in UNITS["force"]
        ]
        said += [
            ("pressure_bar", text, UNITS["pressure"][unit])
            for text, unit in found
            if unit in UNITS["pressure"]
        ]
        said = [own for own in said if kind in ("", own[0])]
        short = _AS_F.findall(name[:_LONGEST])
        if not said and len(short) == 1:
            return "force_N", float(short[0]), name
        for key, text, one in said if len(said) == 1 and not _CUT.search(name) else ():
            if key != "force_N" or not _may_be_thousands(key, text):
                return key, abs(_value(text)) * one, name
    return None


def load_is_ambiguous(names: Sequence[str]) -> bool:
    """Whether the number before a unit may be the rest of another: ``1 238 N``."""
    return any(_CUT.search(name) for name in names)


def radius_in_name(names: Sequence[str]) -> float | None:
    """The radius [mm] of the first name that says one alone: ``R100``, ``Radius 250 mm``."""
    found = (set(_AS_R.findall(name[:_LONGEST])) for name in names)
    return next((float(radii.pop()) for radii in found if len(radii) == 1), None)


def plane_in_name(names: Sequence[str]) -> str | None:
    """The plane of the first name that says one alone: ``ZX``; ``XZ`` is the same."""
    found = ({_TURNED.get(own, own) for own in _PLANE.findall(name[:_LONGEST])} for name in names)
    return next((planes.pop() for planes in found if len(planes) == 1), None)


# Beside the word for a test in the header of the column that names it.
_NUMBERING = {"name", "no", "nr", "number", "id", "label", "index"}
_BRACKET = re.compile(r"[\[({<]")
_INSIDE = re.compile(r"[\[({<]\s*([^\[\](){}<>]+?)\s*(?=[\[\](){}<>])")
# 0-360°
_RANGE = re.compile(r"-?\d+\s*(?:-|–|to|\.\.\.?)\s*\d+\s*(?=°|deg)")
# What scales the unit behind it, as in 10-3 mm, x 10 µm, 0.1 µm; one or two digits alone number the
# column, but for ten.
_FACTOR = re.compile(r"[x×*]|\S*[\d⁰¹²³⁴⁵⁶⁷⁸⁹]\S*")
_COLUMN_NUMBER = re.compile(r"(?!10)\d{1,2}")
_AFTER_IN = re.compile(r"(.*?)\s+in\s+(.+)")
_AT_END = re.compile(r"(.*?)(?:\s*/\s*|_|\s*,\s*|\s+)([^\s/_,\d]+)\s*")
_RULE = re.compile(r"[-=+_|: ]*")


def unit_of(header: str) -> tuple[str, str]:
    """A header's name and unit: ``Angle [°]`` → ("Angle", "deg"), ``reading_um`` → ("reading",
    "um"). What stands in brackets or after "in" and is no unit comes back as it is, to be refused
    where the column is used."""
    header = header.strip().lstrip("#").strip()
    if len(header) > _LONGEST_NAME:
        return header, ""
    name = _BRACKET.split(header)[0].strip(" _")
    inside = [_RANGE.sub("", text) for text in _INSIDE.findall(header)]
    after = _AFTER_IN.fullmatch(header)
    if not (inside and name) and after:
        name = after[1].strip(" _")
        inside = [after[2].strip()]
    if inside and name:
        if [plain(text) for text in inside] == ["grad"] and plain(name).startswith("winkel"):
            return name, "deg"
        known = {unit_named(text) for text in inside} - {""}
        scaled = not after and bool(re.search(r"\d", re.split(r"[\])}>]", header)[-1]))
        return name, (
            known.pop() if len(known) == 1 and not scaled else " and ".join(inside) + " …" * scaled
        )
    match = _AT_END.fullmatch(header)
    unit = unit_named(match[2]) if match else ""
    if not match or not unit:
        return header, ""
    name = match[1].strip(" _")
    last = re.split(r"[\s_]+", name)[-1]
    if _FACTOR.fullmatch(last) and not _COLUMN_NUMBER.fullmatch(last):
        return name, f"({last}) {unit}"
    return (name, unit) if name else (header, "")


def _called(name: str, role: str) -> bool:
    """Whether a header names the role."""
    parts = re.findall(r"[^\W\d_]+", plain(name[:_LONGEST_NAME]))
    words = ROLES[role]
    if role in ("force", "pressure") and _ANOTHER.search(" ".join(parts)):
        return False
    if role == "test" and not set(parts) <= {*words, *_NUMBERING}:
        return False
    return any(
        word in parts or (len(word) > 3 and any(part.startswith(word) for part in parts))
        for word in words
    )


def _columns_of(
    where: str, layout: Layout, headers: Sequence[str]
) -> tuple[dict[str, int], list[int]]:
    """Which column is what, and all columns of readings: as the layout says, else by the words of
    the header."""
    asked = {
        role: column if isinstance(column, list) else [column]
        for role, column in layout.columns.items()
    }
    each = {
        role: [_asked(where, role, column, headers) for column in columns]
        for role, columns in asked.items()
        if columns
    }
    found = {role: columns[0] for role, columns in each.items()}
    readings = each.get("reading", [])
    if not any(headers):
        if "reading" not in found or not {"angle", "time"} & set(found):
            got = (
                f"got {len(headers)} of them. Give --reading-column and --angle-column or"
                " --time-column."
            )
            require(
                not found and len(headers) == 2,
                f"{where}: columns without a header must be named by number, {got}",
            )
            found = {"angle": 0, "reading": 1}
        return found, readings or [found["reading"]]
    names = [unit_of(header)[0] for header in headers]
    for role in (role for role in ROLES if role not in found):
        free = [k for k in range(len(headers)) if k not in found.values()]
        own = [k for k in free if _called(names[k], role)]
        own = [k for k in own if headers[k] not in PER_TEST] or own
        if (
            role == "reading"
        ):  # columns that are called by the load of a test: 36 N [mm], reading 238 N
            loaded = [k for k in free if load_in_name([headers[k]]) is not None]
            if len(loaded) > 1 and set(own) <= set(loaded):
                readings = loaded
                own = loaded[:1]
        if len(own) > 1:
            both = (
                ", or all, each a test of its own, by naming it once for each"
                if role == "reading"
                else ""
            )
            got = " and ".join(repr(headers[k][:_LONGEST_NAME]) for k in own)
            raise InputError(
                f"{where}: one column must hold the {role}, got {got}. Say which:"
                f" --{role}-column{both}."
            )
        if own and (role == "reading" or headers[own[0]] not in PER_TEST):
            found[role] = own[0]
    if "angle" in found and "time" not in layout.columns:
        found.pop("time", None)
    elif "angle" not in found and "time" not in found and "time_s" in headers:
        found["time"] = list(headers).index("time_s")
    found = {
        role: column
        for role, column in found.items()
        if role == "reading" or column not in readings
    }
    readings = readings or ([found["reading"]] if "reading" in found else [])
    if len(readings) > 1 and "test" in found:
        got = (
            f"{len(readings)} of readings beside {headers[found['test']][:_LONGEST_NAME]!r}. Say"
            " which: --reading-column"
        )
        raise InputError(
            f"{where}: a table must have one column of readings, or none that names the test, got"
            f" {got}."
        )
    return found, readings


def _asked(where: str, role: str, column: str | int, headers: Sequence[str]) -> int:
    """The column that was asked for, by its number or its header, with or without the unit."""
    if isinstance(column, int):
        right = 1 <= column <= len(headers)
        require(
            right,
            f"{where}: column of the {role} must be 1 to {len(headers)}, got {column}. Correct it.",
        )
        return column - 1
    exact = [k for k, header in enumerate(headers) if plain(header) == plain(column)]
    matching = exact or [
        k
        for k, header in enumerate(headers)
        if plain(unit_of(header)[0]) == plain(unit_of(column)[0])
    ]
    if len(matching) != 1:
        known = (
            ", ".join(repr(header[:_LONGEST_NAME]) for header in headers if header) or "no header"
        )
        hint = f" Did you mean {nearest(column, headers)!r}?" if any(headers) else ""
        got = f"{column!r} ({len(matching) or 'none'} such)"
        raise InputError(f"{where}: column of the {role} must be one of {known}, got {got}.{hint}")
    return matching[0]


class _NoTableError(InputError):
    """A sheet of words alone."""


@dataclass(frozen=True, eq=False)
class Heading:
    """The columns of one sheet."""

    line: int  # of the header in the file; 0 where there is none
    first: int  # index into the sheet's rows of the first row of numbers
    headers: list[str]  # as the file has them
    units: list[str]  # that each header names, or empty
    roles: dict[str, int]  # column of each role, from 0
    above: list[tuple[int | str, str]]  # lines above the header, with their numbers
    readings: list[
        int
    ]  # where each column of readings is a test of its own, all of them; else the one, or none
    label: str = ""  # of one of several such tests

    def column(self, role: str, c: int) -> str:
        """What stands in a column, and the column's name or number, for messages."""
        return f"{role} (column {(self.headers[c][:_LONGEST_NAME] or c + 1)!r})"

    def each(self) -> Iterator[Heading]:
        """One heading for each column of readings, with its name as label where there are
        several."""
        if len(self.readings) < 2:
            yield self
            return
        for column in self.readings:
            label = (
                _BRACKET.split(self.headers[column])[0].strip()
                or self.headers[column]
                or f"column {column + 1}"
            )
            yield replace(
                self, roles=self.roles | {"reading": column}, readings=[column], label=label
            )


def _find_heading(sheet: Sheet, layout: Layout) -> Heading:
    """Find the table in a sheet, from below its header on, whatever its rows hold: the reader of
    rows refuses bad ones."""
    rows = sheet.rows
    block = _block(sheet, layout)
    k = _header_row(sheet, layout, block)
    width = len(rows[block][1])
    if k is None:
        first = last = _upwards(sheet, block)
        line = 0
        headers = [""] * width
        units = [""] * width
    else:
        line = rows[k][0]
        last = k
        first = k + 1
        headers = _headers(sheet, k, block)
        units = [unit_of(header)[1] for header in headers]
        below = _units_alone(rows[first][1]) if first < block else []
        if below:
            named = zip(headers, [*below, *[""] * width], strict=False)
            units = [unit and unit_of(f"{name} [{unit}]")[1] for name, unit in named]
            first = first + 1
        while first < block and all(_RULE.fullmatch(cell) for cell in rows[first][1]):
            first += 1
    above: list[tuple[int | str, str]] = [
        *_texts(sheet, rows[max(first - _LARGEST_ABOVE, 0) : last])
    ]
    roles, readings = _columns_of(
        f"{sheet.place}, line {line}" if line else sheet.place, layout, headers
    )
    for c in readings:
        if (
            units[c] == unit_of(headers[c])[1]
        ):  # the load in the name of a column, and the load's unit, are not of its readings
            units[c] = unit_of(f"reading {_IN_NAME.sub('', headers[c][:_LONGEST])}")[1]
    return Heading(line, first, headers, units, roles, above, readings)


def _texts(sheet: Sheet, rows: Rows) -> Iterator[tuple[int, str]]:
    """Lines as text, with their numbers."""
    return (
        (line, (sheet.separator or ";").join(cells if sheet.separator else filter(None, cells)))
        for line, cells in rows
    )


def _block(sheet: Sheet, layout: Layout) -> int:
    """The first of nine rows of numbers, cell for cell alike; of the first below the header line
    that was given."""
    rows = sheet.rows
    header = layout.header_line
    if header and header not in [line for line, _ in rows]:
        raise InputError(
            f"{sheet.place}: header line must hold names, got nothing in line {header}. Correct"
            " --header-line."
        )
    start = next((k for k, (line, _) in enumerate(rows) if line > (header or 0)), len(rows))
    for k in range(start, min(len(rows) - 1, start + _LARGEST_ABOVE)):
        if all(
            _numbers(cells) >= 2 and len(cells) == len(rows[k][1])
            for _, cells in rows[k : k + _BLOCK]
        ):
            return k
    line, cells = rows[len(rows) // 2] if rows else (0, [])
    example = (
        f"Line {line} reads {', '.join(repr(cell[:30]) for cell in cells[:6])}. " if rows else ""
    )
    raise _NoTableError(
        f"{sheet.place} must hold a table of at least {_BLOCK} rows with two columns of numbers,"
        f" got none. {example}Check the separator (--separator), the encoding (--encoding) and what"
        " the file is; units belong into the header, not into cells."
    )


def _numbers(cells: Sequence[str]) -> int:
    return sum(map(looks_like_number, cells))


def _upwards(sheet: Sheet, block: int) -> int:
    """Of a table without a header: up from good rows while there are as many cells, some of them
    numbers."""
    rows = sheet.rows
    k = block
    while k and len(rows[k - 1][1]) == len(rows[block][1]) and _numbers(rows[k - 1][1]):
        k -= 1
    if k and (_numbers(rows[k - 1][1]) or any(_numbers(cells) >= 2 for _, cells in rows[:k])):
        got = (
            "rows of a table without a header must be alike, got"
            f" {', '.join(map(repr, rows[k - 1][1]))[:60]}"
        )
        raise InputError(
            f"{sheet.place}, line {rows[k - 1][0]}: {got}. Correct or remove the line, or give"
            " --header-line."
        )
    return k


def _header_row(sheet: Sheet, layout: Layout, block: int) -> int | None:
    """Index of the row of names: as given, or the last row of words above the numbers."""
    rows = sheet.rows
    given = layout.header_line
    if given == 0:
        return None
    if given:
        k = [line for line, _ in rows].index(given)
        if _numbers(rows[k][1]) >= 2 and not _names_columns(rows[k][1]):
            cure = "Correct --header-line; 0: none"
            raise InputError(
                f"{sheet.place}, line {given}: the header must hold names, got numbers. {cure}."
            )
    else:
        wordy = [k for k, (_, cells) in enumerate(rows[:block]) if _names_columns(cells)]
        if not wordy:
            return None
        k = wordy[-2] if _units_alone(rows[wordy[-1]][1]) and len(wordy) > 1 else wordy[-1]
    amid = next(
        (
            line
            for line, cells in rows[:k]
            if _numbers(cells) >= 2 and len(cells) == len(rows[block][1])
        ),
        None,
    )
    got = f"the header must stand above all numbers, got numbers in line {amid}"
    require(
        amid is None,
        f"{sheet.place}, line {rows[k][0]}: {got}. Remove the line, or correct --header-line.",
    )
    return k


def _names_columns(cells: Sequence[str]) -> bool:
    """Two words or more, and no number, unless two of the words name what every table has."""
    words = [
        cell
        for cell in cells
        if cell and not (looks_like_number(cell) or is_missing(cell) or _RULE.fullmatch(cell))
    ]
    if len(words) < 2:
        return False
    return (
        _numbers(cells) == 0
        or sum(any(_called(unit_of(c)[0], r) for c in words) for r in ("angle", "reading", "time"))
        >= 2
    )


def _headers(sheet: Sheet, k: int, block: int) -> list[str]:
    """One name for every column; where blanks separate, a unit in brackets belongs to the word
    before it."""
    (line, cells), below = sheet.rows[k], sheet.rows[block][1]
    names = cells[1:] if cells[:1] == ["#"] else list(cells)
    if sheet.separator == " ":
        names = re.sub(r"\0(?=[\[({<])", " ", "\0".join(names)).split("\0")
    while len(names) > len(below) and not names[-1]:
        names.pop()
    if len(names) > len(below) or any(below[len(names) :]):
        got = f"the header must name every column, got {len(names)} names for {len(below)} cells"
        cure = (
            "Correct it; with decimal commas separate the cells by semicolons; --header-line where"
            " it is another, 0 for none"
        )
        raise InputError(f"{sheet.place}, line {line}: {got}. {cure}.")
    return [*names, *[""] * (len(below) - len(names))]


def _units_alone(cells: Sequence[str]) -> list[str]:
    """The units in a row that holds nothing else, all known or in brackets; empty where it holds
    names."""
    inside = [cell.strip("[](){} ") for cell in cells]
    known = [unit_named(text) for text in inside]
    filled = [k for k, cell in enumerate(cells) if cell]
    sure = [k for k in filled if known[k] or re.fullmatch(r"[\[({].*[\])}]", cells[k])]
    others = [cells[k] for k in filled if k not in sure]
    enough = len(sure) >= min(len(filled), 2 - ("grad" in map(plain, others))) and all(
        len(cell) <= 4 for cell in others
    )
    if not any(known) or not enough or any(load_in_name([cell]) is not None for cell in cells):
        return []
    return [known[k] or inside[k] for k in range(len(cells))]


def find_headings(
    sheets: Sequence[Sheet], layout: Layout, notes: Notes, matched: Collection[Path] = ()
) -> tuple[list[tuple[Sheet, Heading]], list[Sheet]]:
    """Return the sheets with their headings, and those left out, which is told: one of several in a
    workbook, or a file that a pattern ``matched``, without a table of angles and readings."""
    found: list[tuple[Sheet, Heading]] = []
    left: list[tuple[Sheet, InputError | Heading]] = []
    several = (
        {sheet.path for sheet, other in pairwise(sheets) if sheet.path == other.path}
        if not layout.sheets
        else set()
    )
    for sheet in sheets:
        try:
            heading = _find_heading(sheet, layout)
        except InputError as error:
            none = isinstance(error, _NoTableError) or not any(
                _names_readings(cells) for _, cells in sheet.rows[:_LARGEST_ABOVE]
            )
            if not none or sheet.path not in {*several, *matched}:
                raise
            left.append((sheet, error))
            continue
        there = bool(heading.readings) and bool({"angle", "time"} & heading.roles.keys())
        if there or sheet.path not in {*several, *matched}:
            found.append((sheet, heading))
        else:
            left.append((sheet, heading))
    if not found:
        found = [(own, why) for own, why in left if isinstance(why, Heading)]
        refused = [why for _, why in left]
        if not found:
            raise next(why for why in reversed(refused) if isinstance(why, InputError))
        left = []
    for sheet, _ in left:
        notes.add(
            sheet.place,
            "left out",
            "the sheet" if sheet.name else "the file",
            "it holds no table of angles and readings",
            "--sheets",
        )
    paths = [sheet.path for sheet, _ in found]
    found = [
        (replace(sheet, only=True) if paths.count(sheet.path) == 1 else sheet, heading)
        for sheet, heading in found
    ]
    return found, [sheet for sheet, _ in left]


def _names_readings(cells: Sequence[str]) -> bool:
    """Whether a row names angle or time, and reading."""
    names = [unit_of(cell)[0] for cell in cells if cell and not looks_like_number(cell)]
    return all(
        any(_called(name, role) for name in names for role in roles)
        for roles in (("angle", "time"), ("reading",))
    )


def said_elsewhere(
    sheets: Iterable[Sheet], names: Collection[str]
) -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
    """Lines of sheets without a table: those outside lists of tests, which speak of all tests; and
    of each row with one of these names, which speaks of that test, its cells as ``header:
    cell``."""
    of_all = []
    of_one = []
    wanted = {plain(name) for name in names}
    for sheet in sheets:
        header: list[str] = []
        for line, cells in sheet.rows[:_LARGEST_ABOVE]:
            where = f"{line} of {sheet.place}"
            filled = [cell for cell in cells if cell]
            if (mine := wanted & set(map(plain, filled))) and (
                plain(filled[0]) in mine or not _labels(filled[0])
            ):
                named = [
                    (name, cell) for name, cell in zip(header, cells, strict=False) if name and cell
                ]
                of_one += [
                    (where, f"{'direction' if _SENSE.fullmatch(cell) else name}: {cell}")
                    for name, cell in named
                ]
            elif _heads_a_list(filled):
                header = list(cells)
            elif not header or _labels(filled[0]):
                of_all.append((where, (sheet.separator or ";").join(filled)))
    return of_all, of_one


def _labels(cell: str) -> bool:
    """Whether a cell is the label of a value beside or behind it: ``Radius``, ``Ort:``."""
    name = unit_of(cell)[0].rstrip(" :")
    known = bool(_KEY.fullmatch(name) or _DIRECTION.fullmatch(name))
    known = known or any(re.fullmatch(words, name, re.IGNORECASE) for words, _, _ in _SAID.values())
    return bool(known or re.search(r"\D:|:$", cell))


def _heads_a_list(filled: Sequence[str]) -> bool:
    """Whether a row names the columns of a list of tests, and is no label with its value: ``Radius
    | 100 mm``."""
    if not _names_columns(filled) or any(
        cell.endswith(":") or re.match(_NUMBER, cell) for cell in filled
    ):
        return False
    if len(filled) == 2 and _labels(filled[0]):
        return _called(unit_of(filled[1])[0], "test")
    return any(
        _is_header(cell) or cell in PER_TEST
        for cell in filled[len(filled) == 2 or _labels(filled[0]) :]
    )


# What a line of such a sheet may speak of in words that are not understood.
_SPOKEN_OF = {
    key: re.compile(rf"\b{_SAID[key][0]}\b", re.I)
    for key in ("force_N", "pressure_bar", "feed_mm_per_min")
}
_SPOKEN_OF |= {
    "radius_mm": re.compile("(?i)(?<!kugel)radius"),
    "direction": _DIRECTION,
    "mount": re.compile("(?i)ompens|mount"),
}


def not_understood(lines: Lines) -> dict[str, str]:
    """By field, the first line that speaks of it and says nothing that is understood."""
    found: dict[str, str] = {}
    for line, text in lines:
        if not (
            said_above([(line, text)])
            or len(directions_said([(line, text)], ())) == 1
            or _ANOTHER.search(text)
        ):
            for key in (key for key, words in _SPOKEN_OF.items() if words.search(text[:_LONGEST])):
                found.setdefault(key, f"line {line} says {key.split('_')[0]}, not understood")
    return found


def note_heading(sheet: Sheet, heading: Heading, layout: Layout, notes: Notes) -> None:
    """Note encoding, separator, header line, which column was taken for what, and what was not
    used."""
    for key, value, usual, shown, because in (
        ("encoding", sheet.encoding, ("", "utf-8"), sheet.encoding, "its bytes"),
        ("separator", sheet.separator, ("", ","), repr(sheet.separator), "most lines split alike"),
        ("header_line", heading.line, (0, 1), f"line {heading.line}", "numbers begin below it"),
    ):
        if value != "" and getattr(layout, key) is None:
            notes.keep(**{key: value})
            if value not in usual:
                notes.add(
                    sheet.place, key.partition("_")[0], shown, because, "--" + key.replace("_", "-")
                )
    found: dict[str, Any] = {
        role: heading.headers[c] or c + 1
        for role, c in heading.roles.items()
        if role not in layout.columns
    }
    if len(heading.readings) > 1 and "reading" not in layout.columns:
        found["reading"] = [heading.headers[c] for c in heading.readings]
    if found:
        notes.keep(columns=dict(layout.columns) | found)
        shown = ", ".join(f"{role} = {column!r}" for role, column in found.items())[:_LONGEST_NAME]
        because = "their names" if heading.line else "no header: the first two"
        notes.add(
            sheet.place, "columns", shown, because, ", ".join(f"--{role}-column" for role in found)
        )
    used = {*heading.roles.values(), *heading.readings}
    others = [
        header
        for c, header in enumerate(heading.headers)
        if header and c not in used and header not in PER_TEST
    ]
    if others:
        names = ", ".join(others)[:_LONGEST_NAME]
        notes.add(
            sheet.place,
            "columns not used",
            names,
            "no role is known for them",
            "--…-column, or a [[test]] in --layout",
        )
