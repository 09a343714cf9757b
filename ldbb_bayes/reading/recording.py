"""Recordings: the rows of one test in a file, and everything that is stated about the test."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from ldbb_bayes.reading.assumptions import AssumptionLog
from ldbb_bayes.reading.cited_lines import CitedLine
from ldbb_bayes.reading.heading import Heading
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.lines_above import LineStatement
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.texts_beside import TextBeside
from ldbb_bayes.results import Array

__all__ = [
    "FIELDS_OF_MACHINE",
    "LOAD_LISTS",
    "LOAD_ROLES",
    "UNITS_SHOWN",
    "AssumedUnit",
    "Recording",
    "RowUnits",
    "option_for",
]

# Words by which this package denotes columns of forces and of pressures. The keys are the fields of
# a test that hold these quantities.
LOAD_ROLES = {"force_N": "force", "pressure_bar": "pressure"}
# Names of fields. Each key is the field for the force or the pressure of one test; its value is the
# field of the user's layout that lists the forces or the pressures of all tests.
LOAD_LISTS = {"force_N": "forces_N", "pressure_bar": "pressures_bar"}
# Fields that state which machine was measured. If their values differ, the files may hold tests of
# several machines, which must not become one campaign.
FIELDS_OF_MACHINE = ("machine_type", "serial_number")
# Units in which messages show the values of fields; the keys are the names of the fields.
UNITS_SHOWN = {
    "force_N": "N",
    "pressure_bar": "bar",
    "radius_mm": "mm",
    "feed_mm_per_min": "mm/min",
    "resolution_um": "µm",
}
# Radius [mm] that is assumed if nothing states one.
_USUAL_RADIUS_MM = 150.0
# Longest name of a test [characters].
_LONGEST_TEST_NAME = 100


def option_for(key: str) -> str:
    """Return the command-line option that sets the field ``key`` of a test or campaign.

    Examples are --forces-N for force_N, and --radius-mm for radius_mm.
    """
    name = LOAD_LISTS.get(key, key)
    return f"--{name}".replace("_", "-")


class RowUnits(NamedTuple):
    """Units that one place in a file states for a column of numbers, one unit for each row.

    A place is, for example, a column of units beside the column of numbers.
    """

    #: unit of the column's number in each row, as the file writes it; empty if a row has no unit
    units: Sequence[str]
    source: str  #: place that states the units, in words for a message, such as "a column of units"


class AssumedUnit(NamedTuple):
    """Unit that is assumed for a column, because nothing states it."""

    unit: str
    reason: str | CitedLine  #: reason why this unit is assumed for a column without a stated unit


@dataclass
class Recording:
    """Rows of one test in a file, and everything that is stated about the test."""

    sheet: Sheet
    heading: Heading
    #: name of the test, from the column that names tests or the header of the test's readings;
    #: empty if the whole sheet is one test
    label: str
    lines: list[int]  #: line numbers of the test's rows in the file
    #: numbers in each column with a role (angle, reading, …), for the n rows of the test, in the
    #: unit of the file, shape (n,); the keys are the roles
    numbers: dict[str, Array]
    #: units that the file states separately for each row, for example in a column of units; the
    #: keys are the roles (angle, reading, …) of the columns with the numbers
    row_units: Mapping[str, Sequence[RowUnits]]
    #: text of every cell in the first row of the test; the keys are the headers of the columns
    first_cells: Mapping[str, str]
    #: line number at which each different word in the column of directions first appears; the keys
    #: are the words
    direction_words: Mapping[str, int]
    #: values that lines above the table state; the keys are fields of the test or campaign
    statements: Mapping[str, Sequence[LineStatement]]
    #: layout that the user states, for example which column holds the angles, and in which unit
    layout: Layout
    stated: dict[str, Any]  #: fields that the entry [[test]] of the layout states for this test
    #: fields of the campaign that the user's options set; the keys are the names of the fields
    campaign: Mapping[str, Any]
    log: AssumptionLog  #: log to which assumptions about the test are added
    #: fields of the test whose values come from columns of the table, such as the column "setup".
    #: Each of these columns has the same value in all rows of the test
    fields: dict[str, Any]
    #: lines from sheets without a table, which apply to all tests; each item holds the place of a
    #: line (line number and sheet) and the text of the line
    lines_of_all_tests: Sequence[tuple[str, str]]
    #: lines below the table, each with its line number. Every part of a line that holds a number is
    #: left out. These lines may say whether readings measure the radius or the diameter, and
    #: whether readings contain the deflection of the ball's mount. They may also state the sign of
    #: readings, the direction of travel, and how angles are counted
    lines_below: Sequence[tuple[int | str, str]] = ()
    #: texts beside the table, or in its unused columns, that may state what lines below it may
    #: state; each item holds the place of a text and the text
    lines_beside: Sequence[tuple[int | str, str]] = ()
    #: all texts beside the table, whether they may state something about the test or not
    texts_beside: Sequence[TextBeside] = ()
    #: columns without a role (angle, reading, …) whose cells are equal in all rows of the test;
    #: each item holds the place of a column, and its header and cell as text, as in "R [mm]: 100"
    constant_columns: Sequence[tuple[int | str, str]] = ()
    #: headers of columns that together identify the tests, although none of them does so alone;
    #: empty if there are none
    numbering_headers: Sequence[str] = ()
    #: headers of the columns of the sheet that are not used; start times of tests may be read from
    #: some of these columns later
    unused_columns: Sequence[str] = ()
    #: units that are assumed for columns without a unit; the keys are the roles (angle, reading, …)
    #: of the columns
    assumed_units: dict[str, AssumedUnit] = field(default_factory=dict)

    @property
    def place(self) -> str:
        """Name of the test in error messages: file, sheet and label."""
        if self.label:
            return f"{self.sheet.place}, test {self.label!r}"
        return self.sheet.place

    @property
    def title(self) -> str:
        """Name of the test in its file: its label, or else the name of its sheet or file."""
        return self.label or self.sheet.title

    @property
    def lines_outside(self) -> list[tuple[int | str, str]]:
        """Lines above and below the table, texts beside it, and lines of sheets without a table.

        A line of a sheet without a table is included only if it applies to all tests.
        """
        return [*self.lines_of_all_tests, *self.heading.lines_above, *self.lines_around]

    @property
    def lines_around(self) -> list[tuple[int | str, str]]:
        """Lines below the table of the test, and texts beside it that may state something."""
        return [*self.lines_below, *self.lines_beside]

    @property
    def radius_mm(self) -> float:
        """Radius of the test's circle [mm].

        If the test does not state its radius, it is that of the campaign. If the campaign does not
        state one either, it is 150 mm.
        """
        radius = self.fields.get("radius_mm") or self.campaign.get("radius_mm")
        return float(radius or _USUAL_RADIUS_MM)

    def names(self) -> list[str]:
        """Return the names of the test, its column of readings, its sheet and its file.

        Empty names are left out.
        """
        column_name = ""
        if "reading" in self.heading.roles:
            column_name = self.heading.headers[self.heading.roles["reading"]]
        names = (self.label, column_name, self.sheet.name, self.sheet.path.stem)
        return [name for name in names if name]

    def names_of_files(self) -> list[str]:
        """Return the names of the test, its sheet and its file.

        Empty names are left out.
        """
        names = (self.label, self.sheet.name, self.sheet.path.stem)
        return [name for name in names if name]

    def note(self, subject: str, value: str, reason: str | CitedLine, option: str) -> None:
        """Add an assumption about this test to the log.

        ``subject`` says what was assumed, such as "direction". ``value`` is the assumed value,
        ``reason`` says why it was assumed, and ``option`` is the command-line option that changes
        it.
        """
        self.log.add(self.place, subject, value, reason, option)

    def stated_value(self, key: str) -> Any:
        """Return the user's value for the field ``key`` of the test; None if the user states none.

        The value is taken from the first of three sources that states it: the entry [[test]] of the
        layout for this test, the other fields of the layout, and the options for the campaign.
        """
        value = self.stated.get(key)
        if value is None:
            value = getattr(self.layout, key, None)
        if value is None:
            value = self.campaign.get(key)
        return value

    def name_of_file(self, title: str) -> str:
        """Return the name of the test, ``title``, in a form that can be the name of a file.

        Characters other than letters, digits, blanks and ``_+-.`` are replaced by underscores, and
        only the first 100 characters are kept. If the name differs from ``title``, it is noted as
        an assumption.
        """
        name = re.sub(r"^[^\w+\-]|[^\w+\-. ]", "_", title)[:_LONGEST_TEST_NAME]
        if name != title:
            self.note("name of the test", name, "it names a file", "a [[test]] in --layout")
        return name
