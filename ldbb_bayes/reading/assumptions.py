"""Log of the assumptions made while files are read, each with the option that changes it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

from ldbb_bayes.reading.layout import Layout

__all__ = ["Assumption", "AssumptionLog"]


@dataclass(frozen=True)
class Assumption:
    """One assumption: where it was made, on what, and why."""

    #: file, sheet or test of the assumption, or the number of places; empty: everywhere
    place: str
    what: str  #: subject of the assumption, such as "separator"
    value: str  #: value that was assumed
    because: str  #: evidence for the value
    option: str  #: command-line option that changes the value


class _Entry(NamedTuple):
    """An assumption without its place."""

    subject: str
    value: str
    reason: str
    option: str


@dataclass
class AssumptionLog:
    """Log of assumptions in the order they are made.

    An assumption that is made in several places is kept once. The log also keeps the layout fields
    found in each sheet.
    """

    _places: dict[_Entry, list[str]] = field(default_factory=dict)
    _layout_values: dict[str, list[Any]] = field(default_factory=dict)

    def add(self, place: str, subject: str, value: str, reason: str, option: str) -> None:
        """Note that this value was assumed for a subject in a place."""
        entry = _Entry(subject, value, reason, option)
        self._places.setdefault(entry, []).append(place)

    def keep(self, **fields: Any) -> None:
        """Keep layout fields found in one sheet; None for what the sheet itself states."""
        for key, value in fields.items():
            self._layout_values.setdefault(key, []).append(value)

    def assumptions(self) -> tuple[Assumption, ...]:
        """Return the assumptions in the order of their first places."""
        assumptions = []
        for entry, places in self._places.items():
            place = places[0]
            if place and len(places) > 1:
                place = f"{len(places)} places"
            assumptions.append(Assumption(place, *entry))
        return tuple(assumptions)

    def layout(self, stated: Layout) -> Layout:
        """Return the stated layout, completed by the fields that are the same in all sheets.

        Fields that differ between sheets stay as stated.
        """
        common = {}
        for key, values in self._layout_values.items():
            if all(value == values[0] for value in values):
                common[key] = values[0]
        return stated.with_given(common)
