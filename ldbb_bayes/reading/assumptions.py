"""What was assumed or found out while files were read, each with the option that changes it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

from ldbb_bayes.reading.layout import Layout

__all__ = ["Assumption", "AssumptionLog"]


@dataclass(frozen=True)
class Assumption:
    """What was assumed, where, and why."""

    place: str  #: file, sheet or test, or the number of places; empty: everywhere
    what: str  #: was assumed of
    value: str  #: that was taken
    because: str  #: of this evidence
    option: str  #: that changes it


class _Entry(NamedTuple):
    """An assumption without its place."""

    subject: str
    value: str
    reason: str
    option: str


@dataclass
class AssumptionLog:
    """Assumptions in the order they are made; the same one of several places is kept once."""

    _places: dict[_Entry, list[str]] = field(default_factory=dict)
    _layout_values: dict[str, list[Any]] = field(default_factory=dict)

    def add(self, place: str, subject: str, value: str, reason: str, option: str) -> None:
        """Note that the subject was taken to be the value in a place."""
        entry = _Entry(subject, value, reason, option)
        self._places.setdefault(entry, []).append(place)

    def keep(self, **fields: Any) -> None:
        """Keep fields of the layout as found out in one sheet; None: the sheet states it itself."""
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
        """Return the stated layout with what was found out the same in all sheets.

        What the sheets say of the tests is left to them.
        """
        common = {}
        for key, values in self._layout_values.items():
            if all(value == values[0] for value in values):
                common[key] = values[0]
        return stated.with_given(common)
