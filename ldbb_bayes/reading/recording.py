"""The rows of one test in a file, with everything that file, layout and options state of it."""

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

# Role of the column that holds a load.
LOAD_ROLES = {"force_N": "force", "pressure_bar": "pressure"}
# Field of the layout that lists a load of all tests.
LOAD_LISTS = {"force_N": "forces_N", "pressure_bar": "pressures_bar"}
# Units of quantities in messages.
UNITS_SHOWN = {
    "force_N": "N",
    "pressure_bar": "bar",
    "radius_mm": "mm",
    "feed_mm_per_min": "mm/min",
    "resolution_um": "µm",
}
# Radius where nothing states one [mm].
_USUAL_RADIUS_MM = 150.0
# Characters of a test's name.
_LONGEST_TEST_NAME = 100


def option_for(key: str) -> str:
    """Return the option that states a field."""
    name = LOAD_LISTS.get(key, key)
    return f"--{name}".replace("_", "-")


@dataclass
class Recording:
    """The rows of one test, and everything that is stated of it."""

    sheet: Sheet
    heading: Heading
    label: str  #: of its rows in the column of tests; empty where the whole sheet is one test
    lines: list[int]  #: of its rows in the file
    numbers: dict[str, Array]  #: columns by role, as the file has them, shape (n,) each
    direction_words: Mapping[str, int]  #: in the column of directions, and the line of each
    statements: Mapping[str, Sequence[LineStatement]]  #: of lines above the table, by field
    layout: Layout
    stated: dict[str, Any]  #: fields of a [[test]] in the layout
    campaign: Mapping[str, Any]  #: fields of the campaign that options state
    log: AssumptionLog
    fields: dict[str, Any]  #: of the test, from columns that hold one value for it
    lines_of_all_tests: Sequence[tuple[str, str]]  #: in sheets without a table

    @property
    def place(self) -> str:
        """Return what a message calls the test."""
        if self.label:
            return f"{self.sheet.place}, test {self.label!r}"
        return self.sheet.place

    @property
    def title(self) -> str:
        """Return what the file calls the test."""
        return self.label or self.sheet.title

    @property
    def radius_mm(self) -> float:
        """Return the radius of the test, of the campaign, or the usual one [mm]."""
        radius = self.fields.get("radius_mm") or self.campaign.get("radius_mm")
        return float(radius or _USUAL_RADIUS_MM)

    def names(self) -> list[str]:
        """Return the names of test, column, sheet and file."""
        column_name = ""
        if "reading" in self.heading.roles:
            column_name = self.heading.headers[self.heading.roles["reading"]]
        names = (self.label, column_name, self.sheet.name, self.sheet.path.stem)
        return [name for name in names if name]

    def note(self, subject: str, value: str, reason: str, option: str) -> None:
        """Note an assumption of this test."""
        self.log.add(self.place, subject, value, reason, option)

    def stated_value(self, key: str) -> Any:
        """Return what the [[test]], the layout or an option states; None where none does."""
        value = self.stated.get(key)
        if value is None:
            value = getattr(self.layout, key, None)
        if value is None:
            value = self.campaign.get(key)
        return value

    def name_of_file(self, title: str) -> str:
        """Return a title as the name of a test, which is that of a file; changes are noted."""
        name = re.sub(r"^[^\w+\-]|[^\w+\-. ]", "_", title)[:_LONGEST_TEST_NAME]
        if name != title:
            self.note("name of the test", name, "it names a file", "a [[test]] in --layout")
        return name
