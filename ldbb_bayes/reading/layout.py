"""Layout of imported tables: what the user states about separator, columns, units and so on.

A user states the layout in a TOML file or by command-line options; options take precedence.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import tomli_w
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationInfo, field_validator
from pydantic.dataclasses import dataclass as validated_dataclass

from ldbb_bayes.campaign.campaign import TestFields
from ldbb_bayes.campaign.field_types import Number
from ldbb_bayes.errors import check_known
from ldbb_bayes.files import read_toml, validated
from ldbb_bayes.reading.travel_direction import direction_named
from ldbb_bayes.reading.words import ROLES, UNITS, scaled_unit, size_of_unit
from ldbb_bayes.results import Shown

__all__ = ["Layout", "TestLayout", "layout_to_toml", "read_layout"]

# Characters that may separate cells. The keys are the names of these characters in options and
# layouts.
_SEPARATORS = {"comma": ",", "semicolon": ";", "tab": "\t", "bar": "|", "space": " "}
# Two fields of the layout list the forces and the pressures of all tests. They are the keys of this
# dict; the values are the corresponding fields of a single test.
_LOAD_LISTS = {"forces_N": "force_N", "pressures_bar": "pressure_bar"}


@validated_dataclass(frozen=True, kw_only=True, config=ConfigDict(extra="forbid"))
class TestLayout(TestFields):
    """Fields of one test that the user states in the layout.

    These are fields that the table of the test does not state. ``file`` identifies the test by the
    name of its file, by the name of its sheet, or by its label in the column that names tests.
    """

    file: str  #: name of the test's file or sheet, or its label in the column that names tests
    #: angle at which the circle begins [deg], for a table with times instead of angles
    start_deg: Number | None = None

    def stated(self) -> dict[str, Any]:
        """Return a dict with the fields that the user has stated for the test.

        The keys are the names of the fields; one of them is ``file``.
        """
        return {key: value for key, value in vars(self).items() if value is not None}


def _check_encoding(name: str) -> str:
    """Return the name of an encoding unchanged; raise a ValueError if Python does not know it."""
    try:
        "".encode(name)
    except (LookupError, ValueError):
        raise ValueError(
            "it should be one that Python knows, for example utf-8, utf-16-le, utf-16-be, cp1252"
        ) from None
    return name


def _axis_with_sign(axis: str) -> str:
    """Return an axis with its sign, such as +Y for ``y``."""
    match = re.fullmatch(r"([+\-−]?)([XYZ])([+\-−]?)", axis.strip().upper())
    if match is None or (match[1] and match[3]):
        raise ValueError("it should be one of +X, -X, +Y, -Y, +Z, -Z")
    sign = match[1] or match[3] or "+"
    return f"{sign.replace('−', '-')}{match[2]}"


def _sense_in_capitals(sense: str) -> str:
    """Return the sense CW or CCW for a word such as ``cw`` or ``clockwise``."""
    named = direction_named(sense)
    if named not in ("CW", "CCW"):
        raise ValueError("it should be CW or CCW")
    return named


def _separator_sign(separator: str) -> str:
    """Return the character that separates cells.

    ``separator`` is the character itself or its name: comma, semicolon, tab, bar or space.
    """
    if separator in _SEPARATORS.values():
        return separator
    if separator not in _SEPARATORS:
        raise ValueError(f"it should be one of {', '.join(_SEPARATORS)}, or the sign itself")
    return _SEPARATORS[separator]


# Type of the entry by which a layout states which column holds a quantity, such as the angles. The
# entry is the header of the column or its number, counted from 1. For readings, it may also be a
# list of headers or numbers.
_Column = str | int | list[str | int]


class Layout(Shown, BaseModel, extra="forbid", allow_inf_nan=False):
    """Layout of tables that are to be imported as a campaign.

    If a field is None or empty, its value is determined from each file and noted as an assumption.
    The roles of columns are angle, reading, time, force, pressure, test (the name of the test) and
    direction.

    Raises
    ------
    pydantic.ValidationError
        If a field is unknown, or if a field cannot have the given value. This error is a
        ValueError.

    Examples
    --------
    >>> layout = lb.reading.Layout(separator="semicolon", decimal=",", reading_unit="mm")
    >>> layout.separator, layout.reading_unit
    (';', 'mm')
    >>> lb.reading.Layout(columns={"angle": "phi", "reading": 3}).columns["reading"]
    3
    """

    #: version of the format in which a layout is written; it is always 1
    schema_: Literal[1] = Field(default=1, alias="schema")
    #: encoding of text files, given by the name that Python uses, such as utf-8 or cp1252
    encoding: Annotated[str, AfterValidator(_check_encoding)] | None = None
    #: separator of cells in text files: one of the words ``comma``, ``semicolon``, ``tab``, ``bar``
    #: (for ``|``) and ``space``, or the character itself, such as ``;``
    separator: Annotated[str, AfterValidator(_separator_sign)] | None = None
    decimal: Literal[".", ","] | None = None  #: decimal mark of numbers in files: point or comma
    #: line number of the header in the file; 0 for a table without a header (its columns are then
    #: stated by their numbers from 1)
    header_line: int | None = Field(default=None, ge=0)
    #: names of the sheets to read from workbooks, or patterns with * and ?; empty for all sheets
    #: with a table of readings
    sheets: list[str] = Field(default_factory=list)
    #: dict with the columns of the table. The key is the role of a column, such as angle; the value
    #: is the column's header or its number, counted from 1. If several columns of readings are
    #: listed, each is a separate test
    columns: dict[str, _Column] = Field(default_factory=dict)
    #: forces of all tests, in the order of files, sheets and rows; they replace the forces in the
    #: entries [[test]] of the layout
    forces_N: list[Number] = Field(default_factory=list)
    #: pressures of all tests, in the order of files, sheets and rows; they replace the pressures in
    #: the entries [[test]] of the layout
    pressures_bar: list[Number] = Field(default_factory=list)
    #: unit of the readings, such as um or mm. If the readings are counts (digital steps) of an
    #: instrument, this is the size of one count, such as 0.1 um
    reading_unit: str | None = None
    angle_unit: str | None = None  #: unit of the angles in the files, such as deg or rad
    time_unit: str | None = None  #: unit of the times in the files, such as s or ms
    force_unit: str | None = None  #: unit of the forces in the files, such as N or kN
    pressure_unit: str | None = None  #: unit of the pressures in the files, such as bar
    #: what readings are measured from: the nominal radius (``deviation``), or zero distance between
    #: the two balls (``distance``)
    zero: Literal["deviation", "distance"] | None = None
    #: whether readings measure the radius or the diameter of the circle; readings of the diameter
    #: are halved
    measured: Literal["radius", "diameter"] | None = None
    #: sign of readings: −1 if a longer bar gives a smaller reading, else 1; None to take the sign
    #: from the words in the file
    sign: Literal[1, -1] | None = None
    #: sign of angles: −1 if the file counts angles clockwise, else 1; None to take the sign from
    #: the words in the file
    angle_sign: Literal[1, -1] | None = None
    #: angle in the file at which the bar is along the first axis of the plane [deg]; this angle is
    #: subtracted from all angles
    angle_offset_deg: float | None = None
    #: axis at which the angles in the file begin, such as +Y
    angle_zero: Annotated[str, AfterValidator(_axis_with_sign)] | None = None
    #: sense in which the file counts angles, CW or CCW
    angle_sense: Annotated[str, AfterValidator(_sense_in_capitals)] | None = None
    #: what the machine did when the times of a table have a gap: it stood still (``still``), or it
    #: continued to move (``moving``)
    gaps: Literal["still", "moving"] | None = None
    #: angle at which the circle begins [deg], for tables with times instead of angles
    start_deg: float | None = None
    #: angle that the machine travels before the circle begins [deg], for tables with times instead
    #: of angles
    overshoot_deg: float | None = Field(default=None, ge=0.0)
    #: feed of the machine along the circle [mm/min], for tables with times instead of angles
    feed_mm_per_min: float | None = Field(default=None, gt=0.0)
    #: direction of travel of all tests, CW or CCW
    direction: Annotated[str, AfterValidator(_sense_in_capitals)] | None = None
    #: whether the laps (turns) of a test with several laps are kept or averaged
    laps: Literal["keep", "average"] | None = None
    #: entries [[test]] of the layout. Each entry states values for one test, such as its force,
    #: that the table of this test does not state; the field ``file`` of the entry names the test
    test: list[TestLayout] = Field(default_factory=list)

    @field_validator("reading_unit", "angle_unit", "time_unit", "force_unit", "pressure_unit")
    @classmethod
    def _check_unit(cls, value: str | None, info: ValidationInfo) -> str | None:
        """Return the name that this package uses for a stated unit, such as ``um`` for ``µm``.

        Raise a ValueError if the role of the column does not have this unit. The role is taken from
        the name of the layout's field: for ``reading_unit``, it is reading.
        """
        if value is None:
            return None
        role = str(info.field_name).removesuffix("_unit")
        unit = scaled_unit(value)
        if size_of_unit(role, unit) is None:
            raise ValueError(f"it should be one of {', '.join(UNITS[role])}")
        return unit

    @field_validator("test")
    @classmethod
    def _check_files_differ(cls, tests: list[TestLayout]) -> list[TestLayout]:
        """Return the entries [[test]] unchanged; raise a ValueError if two name the same test."""
        files = set()
        for entry in tests:
            if entry.file in files:
                raise ValueError(
                    "[[test]] must be one for each file, sheet or label, got two for"
                    f" {entry.file!r}"
                )
            files.add(entry.file)
        return tests

    @field_validator("angle_sense")
    @classmethod
    def _check_sense_and_sign_agree(cls, sense: str | None, info: ValidationInfo) -> str | None:
        """Return the stated sense of the angles unchanged.

        Raise a ValueError if the stated sign of the angles says the opposite.
        """
        sign = info.data.get("angle_sign")
        if sense is not None and sign is not None and (sign == 1) != (sense == "CCW"):
            raise ValueError(f"it contradicts the sign {sign:+d} of the angles; state one of them")
        return sense

    @field_validator("columns")
    @classmethod
    def _check_single_columns(cls, columns: dict[str, _Column]) -> dict[str, _Column]:
        """Return the stated columns unchanged; raise a ValueError if a role has several columns.

        Only the role of reading may have several columns.
        """
        for role, column in columns.items():
            if role != "reading" and isinstance(column, list):
                raise ValueError(f"the {role} must be one column")
        return columns

    def with_given(self, options: dict[str, Any], flags: Mapping[str, str] | None = None) -> Layout:
        """Return the layout after replacing fields by the given command-line options.

        The keys of ``options`` are names of fields; an option with the value None changes nothing.
        Each entry [[test]] of the layout states fields of one test. A field that an option states
        for all tests, such as the direction, is removed from these entries. If an option lists
        forces or pressures, no other force or pressure of the layout or of its entries [[test]] is
        used.

        ``flags`` is a dict with the flags of options, such as ``--unit`` for the field
        ``reading_unit``; the keys are the names of the fields. An error message names a field by
        its flag, or by its name if no flags are given.
        """
        stated = {key: value for key, value in options.items() if value is not None}
        keys_of_tests = stated.keys() & TestLayout.__dataclass_fields__.keys()
        if _LOAD_LISTS.keys() & stated.keys():
            keys_of_tests |= set(_LOAD_LISTS.values())
            # If the options list forces, these replace the forces of the layout, and the pressures
            # of the layout are deleted. If the options list pressures, the forces of the layout are
            # deleted.
            stated = {key: [] for key in _LOAD_LISTS} | stated
        if keys_of_tests and "test" not in options:
            stated["test"] = [_without(entry.stated(), keys_of_tests) for entry in self.test]
        return validated(Layout, {**self.model_dump(by_alias=True), **stated}, "options", flags)


def _without(fields: dict[str, Any], keys: set[str]) -> dict[str, Any]:
    """Return a dict of fields without the fields whose names are in ``keys``."""
    return {key: value for key, value in fields.items() if key not in keys}


def layout_to_toml(layout: Layout) -> str:
    """Return a layout as the text of a TOML file that `read_layout` can read."""
    content = layout.model_dump(by_alias=True, exclude_none=True)
    tests = content.pop("test")
    content = {key: value for key, value in content.items() if value not in ([], {})}
    text = tomli_w.dumps(content)
    for entry in tests:
        text += f"\n[[test]]\n{tomli_w.dumps(entry)}"
    return text


def read_layout(path: str | os.PathLike[str]) -> Layout:
    """Return a layout from a TOML file.

    Parameters
    ----------
    path : str or os.PathLike
        Path of the file, such as the ``import.toml`` that the command ``import`` writes.

    Returns
    -------
    Layout
        The layout, to be passed to `import_campaign`.

    Raises
    ------
    InputError
        If the file is not TOML, or if it has an unknown field or an impossible value. The message
        names the place of the error.

    Examples
    --------
    >>> from pathlib import Path
    >>> size = Path("import.toml").write_text("forces_N = [36.0, 390.0, 742.0]")
    >>> lb.reading.read_layout("import.toml").forces_N
    [36.0, 390.0, 742.0]
    """
    layout = validated(Layout, read_toml(Path(path)), str(path))
    check_known(f"{path}: columns key", layout.columns, ROLES)
    return layout
