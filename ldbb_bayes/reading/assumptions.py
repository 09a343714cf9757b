"""Log of the assumptions that are made when foreign files are read."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

from ldbb_bayes.reading.layout import Layout

__all__ = ["Assumption", "AssumptionLog"]


@dataclass(frozen=True)
class Assumption:
    """Assumption about foreign files: place, subject, value and reason."""

    #: file, sheet or test of the assumption, or the number of places; empty for all files
    place: str
    what: str  #: subject of the assumption, such as "separator"
    value: str  #: value that was assumed
    because: str  #: reason for the value
    option: str  #: command-line option that changes the value


class _Entry(NamedTuple):
    """Assumption without the place where it was made."""

    subject: str
    value: str
    reason: str
    option: str


@dataclass
class AssumptionLog:
    """Log of assumptions about foreign files, in the order in which they are made.

    An assumption that is made in several places is kept once. The log also keeps the fields of the
    layout that are found in each sheet.
    """

    _places: dict[_Entry, list[str]] = field(default_factory=dict)
    _layout_values: dict[str, list[Any]] = field(default_factory=dict)

    def add(self, place: str, subject: str, value: str, reason: str, option: str) -> None:
        """Add an assumption: its place, subject, value, reason and the option that changes it."""
        entry = _Entry(subject, value, reason, option)
        self._places.setdefault(entry, []).append(place)

    def keep(self, **fields: Any) -> None:
        """Keep fields of the layout as found in one sheet.

        A value is None if the sheet itself states it; the layout then leaves the field open.
        """
        for key, value in fields.items():
            self._layout_values.setdefault(key, []).append(value)

    def assumptions(self) -> tuple[Assumption, ...]:
        """Return the assumptions in the order in which they were first made."""
        assumptions = []
        for entry, places in self._places.items():
            place = places[0]
            if place and len(places) > 1:
                place = f"{len(places)} places"
            assumptions.append(Assumption(place, *entry))
        return tuple(assumptions)

    def layout(self, stated: Layout) -> Layout:
        """Return the layout that the user states, completed by fields found in the sheets.

        Fields that differ between sheets do not change.
        """
        common = {}
        for key, values in self._layout_values.items():
            if all(value == values[0] for value in values):
                common[key] = values[0]
        return stated.with_given(common)
