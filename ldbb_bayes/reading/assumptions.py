"""Log of the assumptions, such as the unit of the readings, made when files are imported."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from ldbb_bayes.reading.cited_lines import CitedLine
from ldbb_bayes.reading.layout import Layout

__all__ = [
    "LIST_SHOWN",
    "NOTHING_STATED",
    "Assumption",
    "AssumptionLog",
    "shown_list",
]

# A note or an error message shows at most this number of characters of a list, such as a list of
# tests or columns.
LIST_SHOWN = 200
#: reason for a value that is assumed because nothing in the files states it
NOTHING_STATED = "nothing says otherwise"
# Reason for an assumed value if some texts in the files were not understood. No other text states
# the value, but one of these texts may state it.
_NOTHING_UNDERSTOOD = "no text that is understood says otherwise"
# Subjects of assumptions whose places are listed, because their number alone does not tell which
# files or sheets are lost.
_SUBJECTS_WITH_PLACES = ("left out", "list of tests")
_PLACES_SHOWN = 300  # longest list of such places [characters]


def shown_list(texts: Iterable[str], longest: int = LIST_SHOWN) -> str:
    """Return a list of texts, such as file names, separated by commas; a long list is shortened.

    If the list is longer than ``longest`` characters, the texts that do not fit completely are
    replaced by an ellipsis. If not even the first text fits, its beginning is returned, with an
    ellipsis.
    """
    listed = ""
    for text in texts:
        longer = f"{listed}, {text}" if listed else text
        if len(longer) > longest:
            return f"{listed}, …" if listed else f"{text[:longest]}…"
        listed = longer
    return listed


@dataclass(frozen=True)
class Assumption:
    """Assumption made when files are imported, such as the unit of the readings."""

    #: file, sheet or test for which the assumption was made, or a text such as "3 places" if there
    #: are several (what is left out is listed, too); empty if the assumption concerns all files
    place: str
    what: str  #: subject of the assumption, such as "separator"
    value: str  #: value that was assumed, as text
    because: str  #: reason why the value was assumed, such as "line 3 says 'R = 100 mm'"
    option: str  #: command-line option that changes the assumed value


class _Entry(NamedTuple):
    """An assumption, without the places (files, sheets or tests) for which it was made."""

    subject: str  # subject of the assumption, such as "separator"
    value: str  # value that was assumed, as text
    reason: str  # reason why the value was assumed, such as "line 3 says 'R = 100 mm'"
    option: str  # command-line option that changes the assumed value


@dataclass
class AssumptionLog:
    """Log of the assumptions that are made when files are imported.

    An assumption that is made for several files, sheets or tests is listed only once. The log also
    stores facts about the layout that were found in the sheets, such as the separator of cells.
    """

    # For each assumption, the list of the files, sheets or tests for which it was made. The keys
    # are the assumptions
    _places: dict[_Entry, list[str]] = field(default_factory=dict)
    # For each field of the layout, the list of the values that were found for it in the sheets. The
    # keys are the names of the fields
    _layout_values: dict[str, list[Any]] = field(default_factory=dict)
    # lines of files that reasons for assumptions cite. Each key is a file, a sheet or a test; its
    # value is the list of the lines that are cited for assumptions about it
    _cited_lines: dict[str, list[CitedLine]] = field(default_factory=dict)

    def add(
        self, place: str, subject: str, value: str, reason: str | CitedLine, option: str
    ) -> None:
        """Add an assumption to the log.

        Parameters
        ----------
        place
            File, sheet or test for which the assumption is made; empty if it concerns all files.
        subject
            Subject of the assumption, such as "separator".
        value
            Value that is assumed.
        reason
            Reason why this value is assumed; a `CitedLine` if the reason is a line of a file.
        option
            Command-line option that changes the value.
        """
        entry = _Entry(subject, value, str(reason), option)
        self._places.setdefault(entry, []).append(place)
        if isinstance(reason, CitedLine):
            self.cite(place, [reason])

    def cite(self, place: str, lines: Iterable[CitedLine]) -> None:
        """Store the lines of files that are the reason for an assumption.

        ``place`` is the file, sheet or test about which the assumption is made.
        """
        self._cited_lines.setdefault(place, []).extend(lines)

    def allow_for_unused_texts(self, has_unused_texts: bool) -> None:
        """Weaken the reason of every assumption whose reason is that nothing states the value.

        If the files contain texts that were not used (``has_unused_texts``), or if a reason cites a
        line that is not understood, one of these texts may state the value. The new reason is
        therefore that no text states the value, as far as the texts are understood.
        """
        if not (has_unused_texts or self._cites_line_not_understood()):
            return
        places_of_entries: dict[_Entry, list[str]] = {}
        for entry, places in self._places.items():
            if entry.reason == NOTHING_STATED:
                entry = entry._replace(reason=_NOTHING_UNDERSTOOD)
            places_of_entries.setdefault(entry, []).extend(places)
        self._places = places_of_entries

    def keep(self, **fields: Any) -> None:
        """Store values with which a sheet was read, for example its separator.

        The method `layout` adds these values to the user's layout. The keyword arguments are fields
        of the layout, as in ``separator=";"``. The value None leaves the field of the layout as the
        user states it, because the sheet itself gives the value, for example in a header with a
        unit.
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
                if entry.subject in _SUBJECTS_WITH_PLACES:
                    listed = shown_list(places, _PLACES_SHOWN)
                    place = f"{place}: {listed}" if listed.endswith("…") else listed
            assumptions.append(Assumption(place, *entry))
        return tuple(assumptions)

    def _cites_line_not_understood(self) -> bool:
        """Return whether a reason for an assumption cites a line that was not understood."""
        for lines in self._cited_lines.values():
            if not all(line.is_understood for line in lines):
                return True
        return False

    def lines_cited_for(self, places: Iterable[str]) -> list[CitedLine]:
        """Return the lines of files that are cited as reasons for assumptions about ``places``.

        A place is a file, a sheet or a test. The empty place stands for all files.
        """
        lines = []
        for place in places:
            lines += self._cited_lines.get(place, [])
        return lines

    def layout(self, stated: Layout) -> Layout:
        """Return the user's layout, completed with the values that were found in the sheets.

        ``stated`` is the user's layout, which states how tables are to be read. A field of the
        layout is not changed if different sheets have different values for it.
        """
        common = {}
        for key, values in self._layout_values.items():
            if all(value == values[0] for value in values):
                common[key] = values[0]
        return stated.with_given(common)
