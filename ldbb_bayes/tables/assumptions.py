"""What reading a file took for granted: told to the user, and written into the layout so that it is not guessed again."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from ldbb_bayes.tables.layout import Layout

__all__ = ["Assumption", "Notes"]


@dataclass(frozen=True)
class Assumption:
    """What was taken for granted, and how to say otherwise.

    Attributes
    ----------
    place : str
        File, sheet or test; how many of them; empty for the whole campaign.
    what, value, because, option : str
    """

    place: str
    what: str
    value: str
    because: str
    option: str


@dataclass
class Notes:
    """Collected on the way; what is the same in several places is told once."""

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
        alike = {key: values[0] for key, values in self._found.items() if all(own == values[0] for own in values)}
        same = {key: value for key, value in alike.items() if value is not None}
        return given.with_given(same)
