"""Words and units by which files name what they hold, in English, German and some others."""

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

# Characters of a line that are looked at.
LONGEST_TEXT = 300
# Characters of a header that are looked at.
LONGEST_NAME = 200
# Characters of a unit; a longer text is none.
_LONGEST_UNIT = 40

WORDS: Mapping[str, Any] = tomllib.loads(
    (Path(__file__).parent / "words.toml").read_text(encoding="utf-8")
)


def _role_words() -> dict[str, list[str]]:
    """Return, by role, the words by which a header names it."""
    role_words = {}
    for role, words in WORDS["roles"].items():
        role_words[role] = words.split()
    return role_words


# Words by which a header names each role, in the order in which the roles are tried.
ROLES: Mapping[str, Sequence[str]] = _role_words()
# Quantities that are no load and no radius of a test: a maximum, the ambient temperature, …
OTHER_QUANTITY = re.compile(rf"\b(?:{WORDS['others']['words']})\b", re.IGNORECASE)


def comparable(text: str) -> str:
    """Return a text for comparing: one sign for micro, no capitals, no blanks or dots around it."""
    return unicodedata.normalize("NFKC", text).casefold().strip(" .:")


def _unit_sizes() -> dict[str, dict[str, float]]:
    """Return, by role, the size of every unit in ours."""
    sizes: dict[str, dict[str, float]] = {}
    for role, units in WORDS["units"].items():
        sizes[role] = {unit: float(entry[0]) for unit, entry in units.items()}
    return sizes


def _units_by_word() -> dict[str, str]:
    """Return our name of a unit by every word that people use for it."""
    units_by_word: dict[str, str] = {}
    for units in WORDS["units"].values():
        for unit, (_, *synonyms) in units.items():
            for word in (unit, *synonyms):
                units_by_word[comparable(word)] = unit
    return units_by_word


UNITS: Mapping[str, Mapping[str, float]] = _unit_sizes()
_UNITS_BY_WORD = _units_by_word()


def unit_named(text: str) -> str:
    """Return our name of a unit; empty where the text names none."""
    if len(text) > _LONGEST_UNIT:
        return ""
    return _UNITS_BY_WORD.get(comparable(text), "")
