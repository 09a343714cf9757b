"""Words and units that files use for what they hold, in English, German and other languages.

The words themselves are in ``words.toml``.
"""

from __future__ import annotations

import re
import tomllib
import unicodedata
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

__all__ = [
    "LONGEST_NAME",
    "LONGEST_TEXT",
    "OTHER_QUANTITY",
    "ROLES",
    "UNITS",
    "WORDS",
    "comparable",
    "unit_named",
]

# A line is examined up to so many characters.
LONGEST_TEXT = 300
# A header is examined up to so many characters.
LONGEST_NAME = 200
# Longest unit [characters]; a longer text is no unit.
_LONGEST_UNIT = 40

WORDS: Mapping[str, Any] = tomllib.loads(
    (Path(__file__).parent / "words.toml").read_text(encoding="utf-8")
)


def _role_words() -> dict[str, list[str]]:
    """Return the words by which a header names a role, by role."""
    role_words = {}
    for role, words in WORDS["roles"].items():
        role_words[role] = words.split()
    return role_words


# Words by which a header names a role, by role, in the order in which the roles are tried.
ROLES: Mapping[str, Sequence[str]] = _role_words()
# Pattern of words for quantities that are neither load nor radius of a test: a maximum, an ambient
# pressure, …
OTHER_QUANTITY = re.compile(rf"\b(?:{WORDS['others']['words']})\b", re.IGNORECASE)


def comparable(text: str) -> str:
    """Return a text in the form in which texts are compared.

    It has one sign for micro, no capitals, and no blanks, dots or colons at its ends.
    """
    return unicodedata.normalize("NFKC", text).casefold().strip(" .:")


def _unit_sizes() -> dict[str, dict[str, float]]:
    """Return the size of every known unit in the package's own unit, by role and unit."""
    sizes: dict[str, dict[str, float]] = {}
    for role, units in WORDS["units"].items():
        sizes[role] = {unit: float(entry[0]) for unit, entry in units.items()}
    return sizes


def _units_by_word() -> dict[str, str]:
    """Return the package's name of a unit, by every word that files use for the unit."""
    units_by_word: dict[str, str] = {}
    for units in WORDS["units"].values():
        for unit, (_, *synonyms) in units.items():
            for word in (unit, *synonyms):
                units_by_word[comparable(word)] = unit
    return units_by_word


UNITS: Mapping[str, Mapping[str, float]] = _unit_sizes()
_UNITS_BY_WORD = _units_by_word()


def unit_named(text: str) -> str:
    """Return the package's name of the unit that a text names; empty if it names no unit."""
    if len(text) > _LONGEST_UNIT:
        return ""
    return _UNITS_BY_WORD.get(comparable(text), "")
