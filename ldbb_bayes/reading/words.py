"""Words and units that files of readings use, in English, German and other languages.

The words themselves are in the file ``words.toml``.
"""

from __future__ import annotations

import math
import re
import tomllib
import unicodedata
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

__all__ = [
    "ABSOLUTE_PRESSURE",
    "ARE_STATED",
    "LONGEST_NAME",
    "LONGEST_TEXT",
    "OTHER_QUANTITY",
    "ROLES",
    "SHARE",
    "UNITS",
    "WORDS",
    "comparable",
    "joined_prefixes",
    "scaled_unit",
    "shares_mentioned",
    "size_of_unit",
    "unit_in_shares",
    "unit_named",
    "without_accents",
]

# Regular expression for the words between a quantity and its unit, such as "are given".
ARE_STATED = "(?: (?:are|is|sind|given|stated|angegeben))*"
# Only this many characters at the beginning of a line are examined.
LONGEST_TEXT = 300
# Only this many characters at the beginning of a column's header are examined.
LONGEST_NAME = 200
# A text with more characters than this is not a unit.
_LONGEST_UNIT = 40
# Removing accents from a text takes time, and many steps of an import need the same results. At
# most this many results are stored.
_KEPT_WORDS = 4096
# Regular expression for a unit with a factor, such as 0.1 µm. Readings have this unit if the
# instrument counts digital steps and each step is 0.1 µm.
_SCALED_UNIT = re.compile(
    r"(?P<inverse>1/)?(?P<factor>\d+(?:[.,]\d+)?(?:e[+\-]?\d+)?)\s*[x×*]?\s*(?P<unit>\D+)", re.I
)

# Values of the fractions that are written as words before a unit, such as 0.1 for "tenths" in
# "tenths of a micron". The file ``words.toml`` lists the words.
_SHARE_SIZES = {
    "tenth": 1e-1,
    "hundredth": 1e-2,
    "ten_thousandth": 1e-4,
    "hundred_thousandth": 1e-5,
    "thousandth": 1e-3,
    "millionth": 1e-6,
}

# Content of ``words.toml``: words and units that files of readings use.
WORDS: Mapping[str, Any] = tomllib.loads(
    (Path(__file__).parent / "words.toml").read_text(encoding="utf-8")
)


def _role_words() -> dict[str, list[str]]:
    """Return a dict with the words that headers use for each role of a column.

    A role is what a column holds, such as angle or reading. The keys of the dict are the roles.
    """
    role_words = {}
    for role, words in WORDS["roles"].items():
        role_words[role] = words.split()
    return role_words


# Mapping from the roles of columns, such as angle, to the words that headers use for each role. If
# a header has words of several roles, the role that is first among the keys is used.
ROLES: Mapping[str, Sequence[str]] = _role_words()
# Regular expression for words that name other quantities, such as a maximum or an ambient pressure.
# These must not be mistaken for the load or the radius of a test.
OTHER_QUANTITY = re.compile(rf"\b(?:{WORDS['others']['words']})\b", re.IGNORECASE)


# Regular expression for words which show that a pressure is absolute, as in "bar abs" or "bar(a)".
ABSOLUTE_PRESSURE = re.compile(WORDS["others"]["absolute"], re.IGNORECASE)


# Regular expression for a word that names a fraction of a unit, such as "tenths".
SHARE = re.compile(
    rf"(?<!\w)(?:{'|'.join(WORDS['shares'][share] for share in _SHARE_SIZES)})(?!\w)", re.IGNORECASE
)
# Regular expression for a prefix that stands alone in front of a unit, such as "micro metres".
_PREFIX = re.compile(
    rf"(?<![^\W_])(?P<prefix>{'|'.join(WORDS['columns']['prefixes'])})[\s._\-]+(?P<unit>[^\W\d_]+)",
    re.IGNORECASE,
)
# Regular expressions for a fraction of a unit in words, such as "tenths of a micron". The keys are
# the names of the fractions, such as "tenth".
_UNIT_IN_SHARES = {
    share: re.compile(
        rf"(?<!\w)(?:{WORDS['shares'][share]})[\s\-]*(?:{WORDS['shares']['between']})*"
        r"(?P<unit>[^\W\d_]+)(?!\w)",
        re.IGNORECASE,
    )
    for share in _SHARE_SIZES
}


def comparable(text: str) -> str:
    """Return a text in a standard form, so that texts which differ only in notation become equal.

    Capitals become small letters. Equivalent characters, such as the two signs for micro, become
    one character. Blanks, dots and colons at both ends are removed.
    """
    return unicodedata.normalize("NFKC", text).casefold().strip(" .:")


@lru_cache(maxsize=_KEPT_WORDS)
def without_accents(text: str) -> str:
    """Return a text without accents and other marks on letters: ``forca`` for ``força``.

    Files are often written without these marks.
    """
    letters = unicodedata.normalize("NFD", text)
    plain = "".join(letter for letter in letters if unicodedata.category(letter) != "Mn")
    return unicodedata.normalize("NFC", plain)


def _unit_sizes() -> dict[str, dict[str, float]]:
    """Return a dict with the sizes of all known units for each role of a column.

    The keys are roles, such as reading. Each value is a dict with the names of units as keys and
    their sizes as values. A size is given in the unit that this package uses for the role. For
    readings, this unit is µm; therefore, the size of mm is 1000.
    """
    sizes: dict[str, dict[str, float]] = {}
    for role, units in WORDS["units"].items():
        sizes[role] = {unit: float(entry[0]) for unit, entry in units.items()}
    return sizes


def _units_by_word() -> dict[str, str]:
    """Return a dict with the names that this package uses for units.

    The keys are the spellings of the units in files, in the form that `comparable` returns.
    """
    units_by_word: dict[str, str] = {}
    for units in WORDS["units"].values():
        for unit, (_, *synonyms) in units.items():
            for word in (unit, *synonyms):
                units_by_word[comparable(word)] = unit
    return units_by_word


# Sizes of all known units. The keys are roles of columns, such as reading. Each value is a mapping
# from the names of units to their sizes in the unit that this package uses for the role. This
# package uses µm for readings; therefore, the size of mm is 1000.
UNITS: Mapping[str, Mapping[str, float]] = _unit_sizes()
_UNITS_BY_WORD = _units_by_word()


# Polish sign for a kilogram-force. Only the capital letter distinguishes it from kg, a mass.
_POLISH_KILOGRAM_FORCE = "kG"


def unit_named(text: str) -> str:
    """Return this package's name for the unit in a text, such as "um" for "µm".

    The result is an empty text if the text is not a known unit.
    """
    if len(text) > _LONGEST_UNIT:
        return ""
    if text.strip(" .:") == _POLISH_KILOGRAM_FORCE:
        return "kgf"
    return _UNITS_BY_WORD.get(comparable(text), "")


def scaled_unit(text: str) -> str:
    """Return the name that this package uses for a unit: ``um`` for ``µm``.

    The unit may have a factor: ``0,1 µm`` gives ``0.1 um``, and ``1/1000 mm`` gives ``0.001 mm``.
    Readings have such a unit if they are numbers of digital steps (counts). Return an empty text if
    ``text`` names no known unit, or if the factor is zero.
    """
    unit = unit_named(text)
    match = _SCALED_UNIT.fullmatch(text.strip())
    if unit or match is None:
        return unit
    factor = float(match["factor"].replace(",", "."))
    unit = unit_named(match["unit"])
    if not unit or not 0.0 < factor < math.inf:
        return ""
    if match["inverse"]:
        factor = 1.0 / factor
    return f"{factor:.12g} {unit}"


def joined_prefixes(text: str) -> str:
    """Return a text in which a prefix that stands alone is joined to its unit.

    For example, ``micro metres`` becomes ``um``, and ``force.kilo.newton`` becomes ``force.kN``.
    """
    return _PREFIX.sub(_joined_prefix, text)


def _joined_prefix(match: re.Match[str]) -> str:
    """Return a matched prefix and unit, such as ``micro metres``, as one unit: ``um``.

    If the unit with this prefix is unknown, the matched text is returned unchanged.
    """
    sign = WORDS["columns"]["prefixes"][match["prefix"].lower()]
    unit = unit_named(match["unit"])
    if not unit:
        return match[0]
    return unit_named(sign + unit) or unit_named(match["prefix"] + unit) or match[0]


def unit_in_shares(text: str) -> str:
    """Return a fraction of a unit in digits: ``0.1 um`` for the words ``tenths of a micron``.

    The result is an empty string if the text is not a fraction of a unit in words.
    """
    for share, pattern in _UNIT_IN_SHARES.items():
        match = pattern.fullmatch(text.strip(" ."))
        if match is not None and unit_named(match["unit"]):
            return f"{_SHARE_SIZES[share]:g} {unit_named(match['unit'])}"
    return ""


def shares_mentioned(text: str) -> str:
    """Return the words in a text that name a fraction of a unit, such as ``tenths of a micron``.

    Only units of readings are considered. The result is an empty text if there are no such words.
    """
    for pattern in _UNIT_IN_SHARES.values():
        match = pattern.search(text)
        if match is not None and unit_named(match["unit"]) in UNITS["reading"]:
            return match[0]
    return ""


def size_of_unit(role: str, unit: str) -> float | None:
    """Return the size of a unit as a multiple of the unit that this package uses.

    For readings, the package uses µm; therefore, the size of ``mm`` is 1000. The unit may have a
    factor in digits or in words: both ``0.1 um`` and ``tenths of a micron`` have the size 0.1.
    Return None if the unit is not a known unit for columns with the role ``role``.

    Parameters
    ----------
    role
        Role of a column, such as reading.
    unit
        Unit as `scaled_unit` returns it, or a fraction of a unit in words.
    """
    unit = unit_in_shares(unit) or unit
    factor, _, name = unit.rpartition(" ")
    if name not in UNITS[role] or scaled_unit(unit) != unit:
        return None
    return float(factor or 1.0) * UNITS[role][name]
