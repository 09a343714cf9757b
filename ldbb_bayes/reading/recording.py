"""Recordings: the rows of one test in a file, and all that file, layout and options state."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ldbb_bayes.reading.assumptions import AssumptionLog
from ldbb_bayes.reading.headers import Heading
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.lines_above import LineStatement
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.results import Array

__all__ = ["LOAD_LISTS", "LOAD_ROLES", "UNITS_SHOWN", "Recording", "option_for"]

# Role of the column that holds a load, by the load's field of a test.
LOAD_ROLES = {"force_N": "force", "pressure_bar": "pressure"}
# Field of the layout that lists a load of all tests, by the load's field of a test.
LOAD_LISTS = {"force_N": "forces_N", "pressure_bar": "pressures_bar"}
# Units of quantities in messages, by field.
UNITS_SHOWN = {
    "force_N": "N",
    "pressure_bar": "bar",
    "radius_mm": "mm",
    "feed_mm_per_min": "mm/min",
    "resolution_um": "µm",
}
# Radius that is assumed where nothing states one [mm].
_USUAL_RADIUS_MM = 150.0
# Longest name of a test [characters].
_LONGEST_TEST_NAME = 100


def option_for(key: str) -> str:
    """Return the command-line option that states a field."""
    name = LOAD_LISTS.get(key, key)
    return f"--{name}".replace("_", "-")


@dataclass
class Recording:
    """The rows of one test, and everything that is stated about the test."""

    sheet: Sheet
    heading: Heading
    #: name of the test in the column of tests, or header of its column of readings; empty where
    #: the whole sheet is one test
    label: str
    lines: list[int]  #: line numbers of the test's rows in the file
    #: columns of numbers by role, in the units of the file, shape (n,) each
    numbers: dict[str, Array]
    #: words in the column of directions, each with the line where it first stands
    direction_words: Mapping[str, int]
    #: what lines above the table state, by field
    statements: Mapping[str, Sequence[LineStatement]]
    layout: Layout
    stated: dict[str, Any]  #: fields that the [[test]] of the layout states
    campaign: Mapping[str, Any]  #: fields of the campaign that options state
    log: AssumptionLog
    #: fields of the test from columns that hold one value in all its rows
    fields: dict[str, Any]
    #: lines of sheets without a table that concern all tests: place and text of each
    lines_of_all_tests: Sequence[tuple[str, str]]

    @property
    def place(self) -> str:
        """Name of the test in messages: file, sheet and label."""
        if self.label:
            return f"{self.sheet.place}, test {self.label!r}"
        return self.sheet.place

    @property
    def title(self) -> str:
        """Name of the test in its file: its label, or else the sheet's title."""
        return self.label or self.sheet.title

    @property
    def radius_mm(self) -> float:
        """Radius of the test, else of the campaign, else the usual radius [mm]."""
        radius = self.fields.get("radius_mm") or self.campaign.get("radius_mm")
        return float(radius or _USUAL_RADIUS_MM)

    def names(self) -> list[str]:
        """Return the names of test, column of readings, sheet and file, without empty ones."""
        column_name = ""
        if "reading" in self.heading.roles:
            column_name = self.heading.headers[self.heading.roles["reading"]]
        names = (self.label, column_name, self.sheet.name, self.sheet.path.stem)
        return [name for name in names if name]

    def note(self, subject: str, value: str, reason: str, option: str) -> None:
        """Note an assumption of this test."""
        self.log.add(self.place, subject, value, reason, option)

    def stated_value(self, key: str) -> Any:
        """Return the value of a field that a user states; None where the user states none.

        The first of these counts: the [[test]] of the layout, the layout, an option.
        """
        value = self.stated.get(key)
        if value is None:
            value = getattr(self.layout, key, None)
        if value is None:
            value = self.campaign.get(key)
        return value

    def name_of_file(self, title: str) -> str:
        """Return a title as the name of a test, without signs that a file name cannot have.

        A change of the title is noted as an assumption.
        """
        name = re.sub(r"^[^\w+\-]|[^\w+\-. ]", "_", title)[:_LONGEST_TEST_NAME]
        if name != title:
            self.note("name of the test", name, "it names a file", "a [[test]] in --layout")
        return name
