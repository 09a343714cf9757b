"""What is known of one test beside its readings: what was given wins over what its file says, and contradictions are told."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ldbb_bayes.errors import InputError
from ldbb_bayes.tables.assumptions import Notes
from ldbb_bayes.tables.layout import Layout, TestLayout
from ldbb_bayes.tables.preamble import Said, direction_not_understood, directions_said, load_in_name

__all__ = ["Known"]

# By key: unit, and how to say it.
_KEYS = {
    "force_N": ("N", "--forces-N"),
    "pressure_bar": ("bar", "--pressures-bar"),
    "radius_mm": ("mm", "--radius-mm"),
    "feed_mm_per_min": ("mm/min", "--feed-mm-per-min"),
    "start_deg": ("°", "--start-deg"),
    "overshoot_deg": ("°", "--overshoot-deg"),
}
_SENSES = {
    "CLOCKWISE": "CW",
    "COUNTERCLOCKWISE": "CCW",
    "ANTICLOCKWISE": "CCW",
    "+": "CCW",
    "-": "CW",
    "G2": "CW",
    "G02": "CW",
    "G3": "CCW",
    "G03": "CCW",
}
# Shares by which a value may be rounded: in a line, in a name.
_IN_LINE, _IN_NAME = 1e-3, 0.02


def _sense(word: str) -> str:
    """CW or CCW, or the word itself."""
    return _SENSES.get(re.sub(r"(?<=\w)[-_ ]", "", word.upper()), word.upper())


@dataclass(frozen=True)
class Known:
    """Of one test.

    Attributes
    ----------
    place : str
        What a message calls the test.
    names : sequence of str
        Of test, sheet and file.
    lines : sequence of (line, text)
        Above the table.
    above : mapping of field to all values
        That these lines say.
    stated : TestLayout or None
        The layout's entry for the test.
    campaign : mapping
        Fields of the campaign that were given.
    """

    place: str
    names: Sequence[str]
    lines: Sequence[tuple[int, str]]
    above: Mapping[str, Sequence[Said]]
    layout: Layout
    stated: TestLayout | None
    campaign: Mapping[str, Any]
    notes: Notes

    def given(self, key: str) -> Any:
        """As an option or the layout gives it, of the test before of all; None where neither does."""
        for source in (getattr(self.stated, key, None), getattr(self.layout, key, None), self.campaign.get(key)):
            if source is not None:
                return source
        return None

    def number(self, key: str, column: float | None = None) -> float | None:
        """A quantity of the test: as given, by its column, the lines above the table, the name; None where none says it.

        Raises
        ------
        InputError
            When lines above the table contradict each other or the name, and nothing was given.
        """
        unit, option = _KEYS[key]
        given = self.given(key)
        lines = [(own.value, f"line {own.line}", "" if own.unit else ", no unit there") for own in self.above.get(key, ())]
        named = load_in_name(self.names, key) if key in ("force_N", "pressure_bar") else None
        in_name = [(named[1], f"the name {named[2]!r}", "")] if named is not None and named[0] == key else []
        first = given if given is not None else column
        if first is not None:
            by_column = [(column, "its column", "")] if given is not None and column is not None else []
            for value, where, _ in (*by_column, *lines, *in_name):
                if not (math.isnan(value) or np.isclose(value, first, rtol=_IN_NAME if "name" in where else _IN_LINE)):
                    how = "as given" if given is not None else "its column"
                    self.notes.add(self.place, key, f"{first:g} {unit}, {how}", f"{where} says {value:g} {unit}", option)
            return float(first)
        if not lines and not in_name:
            return None
        unclear = next((where for value, where, _ in lines if math.isnan(value)), None)
        if unclear is not None:
            raise InputError(
                f"{self.place}: {key} must be one number, got a mark in {unclear} that may stand between thousands. "
                f"Give {option}."
            )
        value, where, remark = (*lines, *in_name)[0]
        for other, there, _ in (*lines[1:], *in_name):
            if not np.isclose(other, value, rtol=_IN_NAME if "name" in there else _IN_LINE):
                raise InputError(
                    f"{self.place}: {key} must be said once, got {value:g} {unit} in {where} and {other:g} {unit} in {there}. "
                    f"Give {option}."
                )
        self.notes.add(self.place, key, f"{value:g} {unit}", where + remark, option)
        return value

    def direction(self, words: Mapping[str, int]) -> str | None:
        """CW or CCW: as given, by the words of its column, the lines above and names; None where none says it.

        Raises
        ------
        InputError
            For words that are neither, or when both are said and none was given.
        """
        given: str | None = self.given("direction")
        lines = {_sense(word): line for word, line in sorted(words.items(), key=lambda own: -own[1]) if word}
        senses = set(lines)
        if given is None and (len(senses) > 1 or senses - {"CW", "CCW"}):
            raise InputError(
                f"{self.place}, line {max(lines.values())}: direction must be CW or CCW in all rows of a test, "
                f"got {', '.join(sorted(senses))[:60]!r}. "
                "Correct it, or give --direction."
            )
        said = senses or directions_said(self.lines, self.names)
        if given is not None:
            if said - {given}:
                self.notes.add(self.place, "direction", f"{given}, as given", "the file says the other", "--direction")
            return given
        if len(said) > 1:
            raise InputError(
                f"{self.place}: direction must be said once, got CW and CCW above the table or in names. Give --direction."
            )
        if not said:
            line = direction_not_understood(self.lines)
            if line is not None:
                self.notes.add(self.place, "direction", "none", f"line {line} is not understood", "--direction")
            return None
        (direction,) = said
        if senses and directions_said(self.lines, self.names) - senses:
            self.notes.add(
                self.place, "direction", f"{direction}, its column", "a line above or a name says the other", "--direction"
            )
        if not senses:
            self.notes.add(self.place, "direction", direction, "a line above the table, or the name", "--direction")
        return direction
