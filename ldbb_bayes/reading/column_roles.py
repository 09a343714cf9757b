"""Roles and units of the columns of a table, determined from the headers of the columns.

A role is what a column holds: angle, reading, time, force, pressure, direction or test.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache
from typing import NamedTuple

from ldbb_bayes.campaign.campaign import PER_TEST
from ldbb_bayes.errors import InputError, require, suggestion
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.names import LOAD_IN_NAME, load_in_name, load_is_ambiguous
from ldbb_bayes.reading.numerals import is_missing, looks_like_number
from ldbb_bayes.reading.travel_direction import direction_named, senses_in, senses_of_header
from ldbb_bayes.reading.unit_lines import COUNT, partner_of_units
from ldbb_bayes.reading.words import (
    LONGEST_NAME,
    OTHER_QUANTITY,
    ROLES,
    UNITS,
    WORDS,
    comparable,
    joined_prefixes,
    unit_in_shares,
    unit_named,
    without_accents,
)

__all__ = [
    "BRACKET",
    "RULE",
    "ColumnRoles",
    "Header",
    "count_numbers",
    "find_columns",
    "has_role",
    "heads_loads",
    "is_rule",
    "names_any_role",
    "names_circle",
    "names_columns",
    "names_runs",
    "unit_of",
]

# Words that may follow or precede "test" in the header of the column that names the tests.
_NUMBERING = {"name", "no", "nr", "number", "id", "label", "index"}
# Regular expression for the name of a column that holds one of several runs, such as "Run 1" or
# "Reading run 1".
_RUN = re.compile(rf"(?P<name>(?:.*\W)?(?:{WORDS['names']['run']}))\W*(?P<number>\d{{1,3}})")
# Regular expression for a text that is the number of a test, such as "T1" or "T2 new". Without this
# check, such a text would be read as the header "t" of a column of times.
_NUMBER_OF_TEST = re.compile(r"[^\W\d_]{1,3}[-_]?\d+(?:[^\W\d_]|[\s_-]+[^\W\d_].*)?")
# If the name of a column shows no role, the unit of the column may show one of these roles.
_ROLES_BY_UNIT = ("angle", "reading", "force")
# ``words.toml`` lists words for each role. A listed word with at most this number of letters, such
# as "t" or "dir", must be a whole word of a header. A longer listed word may also be only the
# beginning of a word of the header.
_SHORT_WORD = 3
# Regular expression for the opening bracket in front of the unit in a header.
BRACKET = re.compile(r"[\[({<]")
_INSIDE_BRACKETS = re.compile(r"[\[({<]\s*([^\[\](){}<>]+?)\s*(?=[\[\](){}<>])")
# Regular expression for a range before a unit of angle in a header, such as 0-360°.
_RANGE = re.compile(r"-?\d+\s*(?:-|–|to|\.\.\.?)\s*\d+\s*(?=°|deg)")
# Regular expression for words that stand before a unit in brackets, such as "in" in "(in mm)".
_BEFORE_UNIT = re.compile(r"^(?:all\s)?(?:in|units?|einheit)\s?:?\s(?=\S)", re.IGNORECASE)
# Regular expression for a factor before a unit in a header, as in "10-3 mm" (10⁻³ mm), "x 10 µm" or
# "0.1 µm". The number of a run, as in "run1", is no factor.
_FACTOR = re.compile(r"[x×*]|(?!(?!mal|times)[^\W\d_]{2,}\d{1,2}$)\S*[\d⁰¹²³⁴⁵⁶⁷⁸⁹]\S*")
# Regular expression for the number of a column in its header, such as 2 in "reading 2 µm". The
# number has one or two digits. It is not 10, which is a factor of the unit, as in "10 µm".
_COLUMN_NUMBER = re.compile(r"(?!10)\d{1,2}")
# Regular expression for the header of a column in a table of the program R, which has dots in place
# of blanks and brackets, such as ``force..lbf.``.
_HEADER_WITH_DOTS = re.compile(r"[^\W\d_][\w.]*\.[\w.]*")
# Regular expression for the dots that the program R writes in a header in place of blanks and other
# characters. Decimal points are not matched.
_DOTS = re.compile(r"(?<!\d)\.+|\.+(?!\d)")
# Regular expression for a unit whose first character is missing in a header that the program R
# wrote. R writes a dot for each blank, bracket and µ, so that `` (µm)`` becomes ``...m.``.
_LOST_SIGN = re.compile(r"\.{3,}(?:m|s|N|in|inch)\.$")
# Regular expression for the number that the program R adds to the second of two equal headers.
_NUMBER_OF_EQUAL = re.compile(r"\.\d+$")
# Regular expression for a word which shows that the next word is not a unit, such as "of" in "Angle
# of turn".
_BEFORE_NO_UNIT = re.compile(WORDS["columns"]["before_no_unit"], re.IGNORECASE)
# Regular expressions for two kinds of words before a unit. The first is for a word that multiplies
# or divides the unit, such as "half". The second is for a word that may stand between this word and
# the unit, such as "of".
_MULTIPLIER = re.compile(WORDS["columns"]["multiplier"], re.IGNORECASE)
_BETWEEN = re.compile(WORDS["columns"]["between"], re.IGNORECASE)
# For each role of a column, such as force, the regular expression for headers that end with a unit
# that this package does not read. The keys are the roles.
_FOREIGN_UNITS = {
    role: re.compile(
        rf"(?P<name>.*[^\W_])[\s_/.,]+(?P<unit>{WORDS['columns'][f'foreign_{role}']})\.?", re.I
    )
    for role in ("force", "pressure", "reading", "angle")
}
# Words in headers that begin like a word for time, but mean something else.
_NO_TIMES = WORDS["columns"]["no_time"].split()
# Regular expression for the header of a column of temperatures.
_TEMPERATURE = re.compile(WORDS["columns"]["temperature"], re.IGNORECASE)
# Regular expression for a factor and a unit without a blank between them, as in "Reading 0.1um" and
# "reading_10um".
_FACTOR_AND_UNIT = re.compile(r"(?<![^\W_])(?:0[.,]?\d+|10+)(?P<unit>[^\W\d_]+)$")
# Regular expression for the header of an angle, such as a tilt, that is not the angle of the bar.
_OTHER_ANGLE = re.compile(rf"(?<![^\W_])(?:{WORDS['columns']['other_angle']})(?![^\W_])", re.I)
# Units whose words may also mean a way, such as the Spanish "vuelta" (way back).
_WORDS_FOR_WAYS = ("turn",)
# Regular expression for a load at the end of the text before a word, as in "300 N vuelta".
_LOAD_AT_END = re.compile(rf"{LOAD_IN_NAME.pattern}$", re.IGNORECASE)
# Regular expression for a word that means the angle of the bar, unless it stands beside a load: of
# "300 N position 1", it is a place on the table.
_PLACE_ON_TABLE = re.compile(r"(?<![^\W_])position\w*", re.IGNORECASE)
# Regular expression for a length at the end of a name, as in "deviation from 150 mm".
_LENGTH_WITH_NUMBER = re.compile(r"(?<=\s)[1-9]\d+\s?mm$")
# Regular expression for the number of a column behind its unit, as in "Reading [um] 2".
_NUMBER_BEHIND = re.compile(r"\s+(?!10)\d{1,2}\s*")
_UNIT_AFTER_IN = re.compile(r"(.*?)\s+in\s+(.+)")
_UNIT_AT_END = re.compile(r"(.*?)(?:\s*/\s*|_|\s*,\s*|\s+)([^\s/_,\d]+)\s*")
# Those entries of the file ``words.toml`` that hold words for the radius or the diameter of a
# circle. The file lists the words that this package recognises.
_CIRCLE_WORDS = [
    entry for key, entry in WORDS["numbers"].items() if entry.get("field", key) == "radius_mm"
]
# Regular expression for a difference of two radii that defines the readings, such as "nominal -
# measured".
_DIFFERENCE = re.compile(
    rf"\s*(?:{WORDS['reading_sign']['nominal_less_actual']}"
    rf"|{WORDS['reading_sign']['actual_less_nominal']})\s*"
)
# The name, unit and roles of at most this number of headers are kept in memory, because many steps
# of an import need them again.
_KEPT_HEADERS = 4096
# Regular expression for a cell of dashes or similar signs that underlines a header.
RULE = re.compile(r"[-=+_|: ]*")


class Header(NamedTuple):
    """Name and unit that the header of a column states."""

    name: str
    #: name that this package uses for the unit; for an unknown unit, the text in the header; empty
    #: if the header states no unit
    unit: str


@lru_cache(maxsize=_KEPT_HEADERS)
def unit_of(header: str) -> Header:
    """Return the name and the unit that a header states: "Angle" and "deg" for ``Angle [°]``.

    The unit is empty if the header states none. An unknown unit, in brackets or after "in", is
    returned as the text in the header; later code raises an error for it only if the column is
    used. If a header states two units of one quantity, such as mm and µm, both are returned as one
    text, which later code treats as an unknown unit.
    """
    header = joined_prefixes(header)
    stated = _with_multiplier(_unit_between_dots(header) or _name_and_unit(header))
    behind = re.split(r"[\])}>]", header)[-1]
    for text in (stated.name, behind):
        words = re.split(r"[\s_]+", _LENGTH_WITH_NUMBER.sub("", text.strip()))
        if _contradicts(words[-1], stated.unit):
            return Header(stated.name, f"{words[-1]} and {stated.unit}")
    return stated


def _unit_between_dots(header: str) -> Header | None:
    """Return the name and unit of a header in which the program R put dots for blanks and brackets.

    Examples are ``force..lbf.`` for ``force [lbf]``, and ``deviation.thousandths.of.an.inch``.
    Return None for any other header, and for one that states no unit.
    """
    header = _NUMBER_OF_EQUAL.sub("", header.strip()[:LONGEST_NAME])
    if _HEADER_WITH_DOTS.fullmatch(header) is None:
        return None
    if _LOST_SIGN.search(header):
        return Header(_DOTS.split(header)[0], f"?{_DOTS.split(header.strip('.'))[-1]}")
    words = _DOTS.sub(" ", header).split()
    for k in range(1, len(words)):
        unit = " ".join(words[k:])
        if _BEFORE_NO_UNIT.fullmatch(words[k - 1]) or _FACTOR.fullmatch(words[k - 1]):
            continue
        if unit_named(unit) or unit_in_shares(unit):
            return Header(" ".join(words[:k]), unit_named(unit) or unit)
    stated = _unit_at_end(" ".join(words))
    return stated if stated.unit else None


def _with_multiplier(stated: Header) -> Header:
    """Return a header after moving words that multiply the unit from the name to the unit.

    For the name "Angle half" and the unit deg, the unit becomes the text "half deg". Later code
    raises an error for such a text unless it is a known fraction of a unit, such as "tenths of a
    deg".
    """
    words = re.split(r"[\s_.]+", stated.name)
    first = len(words)
    while first > 1 and (_MULTIPLIER.fullmatch(words[first - 1]) or _is_between(words, first - 1)):
        first -= 1
    multiplier = words[first:]
    if not stated.unit or not multiplier or _BETWEEN.fullmatch(multiplier[0]):
        return stated
    return Header(" ".join(words[:first]), " ".join([*multiplier, stated.unit]))


def _is_between(words: Sequence[str], k: int) -> bool:
    """Return whether a word of a header, such as "of", may stand between a multiplier and a unit.

    A multiplier is a word such as "half". ``words`` are the words of the header, and ``k`` is the
    index of the word.
    """
    return k > 1 and _BETWEEN.fullmatch(words[k]) is not None


def _contradicts(word: str, unit: str) -> bool:
    """Return whether a word of a header is a unit that contradicts ``unit``.

    The word contradicts if it is another unit of the same quantity.
    """
    other = unit_named(word)
    if other in ("", unit) or len(word) < 2 or comparable(word) == "in":
        return False
    return any(other in units and unit in units for units in UNITS.values())


def _name_and_unit(header: str) -> Header:
    """Return the name and the unit that a header states in brackets or one after the other.

    Examples are ``Angle [deg]``, ``[deg] Angle``, ``Angle in deg`` and ``Angle, deg``. A number
    after the brackets, as in ``Reading [um] x 10``, may be a factor; the unit is then returned as a
    text that later code treats as an unknown unit.
    """
    header = header.strip().lstrip("#%").strip()
    if len(header) > LONGEST_NAME:
        return Header(header, "")
    name = BRACKET.split(header)[0].strip(" _")
    if not name:  # the unit precedes the name, as in "[mm] Reading"
        name = re.sub(r"[\[({<][^\])}>]*[\])}>]", "", header).strip(" _")
    before_brackets = _unit_before_remark(header, name)
    if before_brackets is not None:
        return before_brackets
    bracketed = []
    for text in _INSIDE_BRACKETS.findall(header):
        bracketed.append(_BEFORE_UNIT.sub("", _RANGE.sub("", text)))
    if name and bracketed:
        after_brackets = re.split(r"[\])}>]", header)[-1].removesuffix(name)
        is_scaled = re.search(r"\d", after_brackets) is not None
        if _NUMBER_BEHIND.fullmatch(after_brackets):
            is_scaled = False
        is_after_in = _UNIT_AFTER_IN.fullmatch(header) is not None
        return Header(name, _stated_unit(name, bracketed, is_scaled and not is_after_in))
    after_in = _UNIT_AFTER_IN.fullmatch(header)
    if after_in:
        name = after_in[1].strip(" _")
        bracketed = [after_in[2].strip()]
    if name and bracketed:
        return Header(name, _stated_unit(name, bracketed, is_scaled=False))
    return _unit_at_end(header)


def _unit_before_remark(header: str, name: str) -> Header | None:
    """Return the name and unit of a header in which a remark in brackets follows them.

    An example is "Reading, µm (radial)". Return None for any other header. ``name`` is the part of
    the header before its first bracket, here "Reading, µm".
    """
    remarks = _INSIDE_BRACKETS.findall(header)
    if len(remarks) != 1 or not re.fullmatch(r"[^\W\d_]{4,}(?: [^\W\d_]+)*", remarks[0]):
        return None
    if unit_named(remarks[0]):
        return None
    header_before_bracket = _unit_at_end(name)
    if header_before_bracket.unit in ("", name) or not unit_named(header_before_bracket.unit):
        return None
    return header_before_bracket


def _stated_unit(name: str, texts: Sequence[str], is_scaled: bool) -> str:
    """Return the unit that the header of a column states in brackets or after "in".

    ``name`` is the name of the column, and ``texts`` are the texts in brackets or after "in". If
    they state exactly one known unit, this unit is returned. If they state no known unit, or
    several, the texts are returned, joined by "and". The texts are also returned, followed by "…",
    if a number stands behind the brackets (``is_scaled``) and may multiply the unit. Later code
    raises an error for such a result, because it is not a known unit.
    """
    is_german_angle = comparable(name).startswith("winkel")
    if is_german_angle and len(texts) == 1 and comparable(texts[0]) == "grad":
        # In German, Grad means degree; in other languages a grad is a hundredth of a right angle.
        return "deg"
    if len(texts) == 1 and unit_in_shares(texts[0]):
        return texts[0]
    texts = [_without_definition(text) for text in texts]
    units = {unit_named(text) for text in texts} - {""}
    if len(units) == 1 and not is_scaled:
        return units.pop()
    stated = " and ".join(texts)
    if is_scaled:
        return f"{stated} …"
    return stated


def _without_definition(text: str) -> str:
    """Return the unit in a text in which a definition of the readings follows the unit.

    An example is ``mm, nominal - measured``. Any other text is returned unchanged.
    """
    unit, _, definition = text.partition(",")
    if unit_named(unit.strip()) and _DIFFERENCE.fullmatch(comparable(definition)):
        return unit.strip()
    return text


def _with_factor_apart(header: str) -> str:
    """Return a header with a blank between factor and unit.

    For example, ``Reading 0.1um`` becomes ``Reading 0.1 um``. Other headers are not changed.
    """
    joined = _FACTOR_AND_UNIT.search(header)
    if joined is None or unit_named(joined["unit"]) not in UNITS["reading"]:
        return header
    return f"{header[: joined.start('unit')]} {joined['unit']}"


def _unit_at_end(header: str) -> Header:
    """Return the name and the unit of a header that ends with its unit, such as ``reading_um``.

    A factor in front of the unit, as in ``Reading 10 um``, becomes part of the unit: ``(10) um``,
    which later code treats as an unknown unit. The unit is empty if the header does not end with a
    unit, or if its last word belongs to the name, as in ``Angle of turn``.
    """
    written = header
    header = _with_factor_apart(written)
    match = _UNIT_AT_END.fullmatch(header)
    if not match:
        return _unread_unit_at_end(header)
    name = match[1].strip(" _")
    unit = unit_named(match[2])
    if comparable(match[2]) == "grad" and comparable(name).startswith("winkel"):
        unit = "deg"  # in German, Grad means degree
    if not unit and COUNT.fullmatch(comparable(match[2])) and has_role(name, "reading"):
        # The readings are counts (digital steps); the size of one count must be stated elsewhere.
        return Header(name, match[2])
    if not unit:
        return _unread_unit_at_end(header)
    last_word = re.split(r"[\s_]+", name)[-1]
    if _BEFORE_NO_UNIT.fullmatch(last_word) or _is_way(name, unit):
        return Header(header, "")
    if _is_factor(last_word, is_joined=header != written):
        return Header(name, f"({last_word}) {unit}")
    if not name:
        return Header(header, "")
    return Header(name, unit)


def _is_factor(word: str, is_joined: bool) -> bool:
    """Return whether a word before a unit is its factor, and not the number of the column.

    If factor and unit are written as one word (``is_joined``), as in ``reading_01um``, the number
    is no number of a column.
    """
    is_number_of_column = _COLUMN_NUMBER.fullmatch(word) is not None and not is_joined
    return _FACTOR.fullmatch(word) is not None and not is_number_of_column


def _is_way(name: str, unit: str) -> bool:
    """Return whether a word for ``unit`` means a way back, because ``name`` ends with a load."""
    return unit in _WORDS_FOR_WAYS and _LOAD_AT_END.search(name) is not None


def _unread_unit_at_end(header: str) -> Header:
    """Return the name and the unit of a header that ends with a unit that this package cannot read.

    Examples are a force in oz, and a reading in "tenths", which may be tenths of a millimetre or of
    another unit. The name must have a word for the quantity that has this unit, such as "force" for
    oz. For any other header, the name is the whole header and the unit is empty.
    """
    for role, pattern in _FOREIGN_UNITS.items():
        match = pattern.fullmatch(header)
        if match is not None and has_role(match["name"], role):
            return Header(match["name"], match["unit"])
    return Header(header, "")


@cache
def _plain_words(role: str) -> tuple[str, ...]:
    """Return the words for the role of a column, with their accents removed."""
    return tuple(without_accents(word) for word in ROLES[role])


@lru_cache(maxsize=_KEPT_HEADERS)
def has_role(name: str, role: str) -> bool:
    """Return whether the name of a column contains a word for ``role``, such as angle or time.

    Accents are ignored. A word of the name may be longer than the word for the role: ``angles``
    begins with ``angle``. A word for a role that is as short as ``t`` must be equal to a word of
    the name. Words that begin like a word for time, but mean something else, are ignored for the
    role "time". For the role "test", every word of the name must be a word for a test or a word
    such as "number". For the roles "force" and "pressure", the name must not contain a word such as
    "maximum", which shows that the column holds another quantity.
    """
    name_words = re.findall(r"[^\W\d_]+", without_accents(comparable(name[:LONGEST_NAME])))
    role_words = _plain_words(role)
    if role == "time":
        name_words = [word for word in name_words if word not in _NO_TIMES]
    if role in ("force", "pressure") and OTHER_QUANTITY.search(" ".join(name_words)):
        return False
    if role == "test" and not set(name_words) <= {*role_words, *_NUMBERING}:
        return False
    beginnings = tuple(word for word in role_words if len(word) > _SHORT_WORD)
    return any(word in role_words or word.startswith(beginnings) for word in name_words)


def names_any_role(cell: str) -> bool:
    """Return whether a cell is a header that names any role, such as angle, reading or time."""
    name = unit_of(cell).name
    return any(has_role(name, role) for role in ROLES)


def names_columns(cells: Sequence[str]) -> bool:
    """Return whether a row of cells is the header of a table.

    A header has at least two cells with words, and no number. A row with numbers is also a header
    if its words name at least two of the roles angle, reading and time.
    """
    words = [cell for cell in cells if _is_word(cell)]
    if len(words) < 2:
        return False
    if count_numbers(cells) == 0:
        return True
    names = [unit_of(word).name for word in words]
    n_roles = 0
    for role in ("angle", "reading", "time"):
        n_roles += any(has_role(name, role) for name in names)
    return n_roles >= 2


def heads_loads(cells: Sequence[str]) -> bool:
    """Return whether a row is a header in which numbers stand above the columns of readings.

    An example is ``Angle,100,300,600``, where the numbers are loads. A row whose first cell is the
    number of a test, such as ``T1``, is not such a header.
    """
    if _NUMBER_OF_TEST.fullmatch(cells[0]):
        return False
    name = unit_of(cells[0]).name
    names_abscissa = has_role(name, "angle") or has_role(name, "time")
    has_several = len(cells) > 2
    return names_abscissa and has_several and all(looks_like_number(cell) for cell in cells[1:])


def _is_word(cell: str) -> bool:
    """Return whether a cell holds words: it is not empty, not a number and not a line of dashes.

    A text in place of a missing number, such as NaN, does not count as words.
    """
    if not cell or looks_like_number(cell) or is_missing(cell):
        return False
    return RULE.fullmatch(cell) is None


def is_rule(cells: Sequence[str]) -> bool:
    """Return whether a row consists of dashes or similar signs that underline a header."""
    return all(RULE.fullmatch(cell) for cell in cells)


def count_numbers(cells: Sequence[str]) -> int:
    """Return how many cells of a row are numbers."""
    return sum(looks_like_number(cell) for cell in cells)


@dataclass
class ColumnRoles:
    """Columns of a table by their roles, such as angle, reading or time."""

    #: dict with the index (from 0) of the column for each role; the keys are the roles, such as
    #: angle
    columns: dict[str, int] = field(default_factory=dict)
    #: indices of all columns of readings, from 0; if there are several, each is a separate test
    readings: list[int] = field(default_factory=list)


def find_columns(
    place: str, layout: Layout, headers: Sequence[str], units: Sequence[str] = ()
) -> ColumnRoles:
    """Return which column has which role, such as angle.

    The role of a column is stated by the user in the layout, or else shown by the column's header.

    Parameters
    ----------
    place
        Name of the table in error messages.
    layout
        Layout that the user states.
    headers
        Header of each column; all are empty for a table without a header.
    units
        Unit of each column; empty for a column without a stated unit. If the name of a column shows
        no role, the column gets the role to which its unit belongs, such as angle for deg. This is
        done only if no other column has this role, and no other column without a role has a unit
        that belongs to this role.

    Raises
    ------
    InputError
        If a stated column does not exist, if several columns could have the same role, or if a
        table has a column that names tests, and several columns of readings that neither the user
        states nor directions of travel distinguish. For a table without a header, the layout must
        state the column of readings and the column of angles or times. If it states no column at
        all, the table must have exactly two columns.
    """
    roles = _stated_columns(place, layout, headers)
    if not any(headers):
        return _columns_without_header(place, roles, len(headers))
    names = _without_other_content(headers, units)
    for role in ROLES:
        if role not in roles.columns:
            _find_role(place, role, roles, names)
    for role in _ROLES_BY_UNIT:
        candidates = units
        if role == "angle":
            candidates = _units_of_angles(headers, units, "time" in layout.columns)
        _find_role_by_unit(role, roles, candidates, headers)
    if "angle" not in roles.columns:
        _find_role_by_unit("time", roles, units, headers)
    _settle_time(roles, layout, headers)
    _settle_readings(roles)
    if "test" in roles.columns and not _are_circles_of_each_test(roles.readings, layout, headers):
        test_header = headers[roles.columns["test"]][:LONGEST_NAME]
        raise InputError(
            f"{place}: a table must have one column of readings, or none that names the test, got"
            f" {len(roles.readings)} of readings beside {test_header!r}. Say which:"
            " --reading-column, once for each column if each is a circle of every test."
        )
    return roles


def _are_circles_of_each_test(
    readings: Sequence[int], layout: Layout, headers: Sequence[str]
) -> bool:
    """Return whether each column of readings holds one circle of every test of a table.

    This is so if there is only one column, if the user states all of them, or if there is one for
    each direction of travel, as in ``CW [um]`` and ``CCW [um]``. ``readings`` are the indices of
    the columns of readings, and ``headers`` the headers of all columns.
    """
    if len(readings) < 2 or "reading" in layout.columns:
        return True
    return len(readings) == len(_named_after_directions(readings, headers))


def _without_other_content(headers: Sequence[str], units: Sequence[str]) -> list[str]:
    """Return the headers, with an empty text for each column of units or of temperatures.

    A header such as ``theta_unit`` or ``T [°C]`` could otherwise be taken for the header of a
    column of angles or times. ``units`` holds the unit of each column.
    """
    names = list(headers)
    for column, header in enumerate(headers):
        texts = [header[:LONGEST_NAME]]
        texts += [f"{texts[0]} [{unit}]" for unit in units[column : column + 1]]
        is_temperature = any(_TEMPERATURE.search(text) for text in texts)
        if load_in_name(texts[:1]) is not None and unit_of(header).unit in UNITS["reading"]:
            is_temperature = False  # the remark of a circle, as in "36 N temp. 20 °C [um]"
        if partner_of_units(header) or is_temperature:
            names[column] = ""
    return names


def _settle_time(roles: ColumnRoles, layout: Layout, headers: Sequence[str]) -> None:
    """Decide which column holds the time of each reading; this column has the role time.

    If there is a column of angles, the role is removed from ``roles``, unless the layout states the
    column of times. If there is neither a column of angles nor a column of times, the column
    ``time_s`` receives the role. A column ``time_s`` that does not have the role holds the time at
    which each test started. ``headers`` are the headers of all columns.
    """
    if "angle" in roles.columns:
        if "time" not in layout.columns:
            roles.columns.pop("time", None)
    elif "time" not in roles.columns and "time_s" in headers:
        roles.columns["time"] = list(headers).index("time_s")


def _settle_readings(roles: ColumnRoles) -> None:
    """Make the list of the columns of readings and the roles of the columns agree.

    The list is ``roles.readings``. A column in this list loses any other role, such as angle. If
    the list is empty, the column that has the role of reading is added to it.
    """
    for role, column in list(roles.columns.items()):
        if role != "reading" and column in roles.readings:
            del roles.columns[role]
    if not roles.readings and "reading" in roles.columns:
        roles.readings = [roles.columns["reading"]]


def _stated_columns(place: str, layout: Layout, headers: Sequence[str]) -> ColumnRoles:
    """Return the roles of the columns of a table, as far as the user has stated them in the layout.

    ``place`` names the table in error messages, and ``headers`` are the headers of its columns.
    """
    roles = ColumnRoles()
    for role, stated in layout.columns.items():
        if isinstance(stated, list):
            references = stated
        else:
            references = [stated]
        columns = [_column_index(place, role, reference, headers) for reference in references]
        if not columns:
            continue
        roles.columns[role] = columns[0]
        if role == "reading":
            roles.readings = columns
    return roles


def _columns_without_header(place: str, roles: ColumnRoles, width: int) -> ColumnRoles:
    """Return the roles of the columns of a table without a header.

    ``roles`` are the roles that the layout states. If the layout states none, the table must have
    two columns: angle and reading. ``width`` is the number of columns. ``place`` names the table in
    error messages.
    """
    has_abscissa = "angle" in roles.columns or "time" in roles.columns
    if "reading" in roles.columns and has_abscissa:
        return roles
    stated = f"{width} columns"
    if roles.columns:
        stated = "only " + " and ".join(roles.columns)
    require(
        not roles.columns and width == 2,
        f"{place}: a table without a header must have its reading and its angle or time named by"
        f" number, got {stated}. Give --reading-column and --angle-column or --time-column. If a"
        " column names the tests: --test-column; if a line names the columns: --header-line.",
    )
    roles.columns = {"angle": 0, "reading": 1}
    roles.readings = [1]
    return roles


def _find_role(place: str, role: str, roles: ColumnRoles, headers: Sequence[str]) -> None:
    """Find the column whose header names ``role``, such as time, and record it in ``roles``.

    Only columns without a role are considered. If several of them could have the role, an
    `InputError` is raised, unless each of them holds the readings of a separate test. The header of
    such a column of readings is a load, such as ``36 N``, a bare number, or the name of a run, such
    as ``Run 1``. Headers that are names of runs are found when ``role`` is "test". Their columns
    are then recorded as columns of readings, unless columns of readings are already known.

    A column whose header is the name of a field of a test (`PER_TEST`), such as ``force_N``, gets a
    role here only if ``role`` is "reading". Raise an `InputError` if a column of readings holds
    angles. ``place`` names the table in error messages. ``headers`` are the headers of all columns.
    """
    free = _free_columns(role, roles, headers)
    candidates = _candidates(role, free, headers)
    if role == "reading":
        roles.readings = _several_readings(free, candidates, headers)
        _check_are_no_angles(place, [headers[column] for column in roles.readings])
        candidates = roles.readings[:1] or candidates
    if role == "test" and len(candidates) > 1 and _numbered(candidates, headers):
        # Each of the columns "Run 1", "Run 2" holds the readings of one test.
        if not roles.readings and "reading" not in roles.columns:
            roles.readings = candidates
            roles.columns["reading"] = candidates[0]
        return
    if len(candidates) > 1:
        raise _several_candidates(place, role, candidates, headers)
    if not candidates:
        return
    column = candidates[0]
    if role == "reading" or headers[column] not in PER_TEST:
        roles.columns[role] = column


def _free_columns(role: str, roles: ColumnRoles, headers: Sequence[str]) -> list[int]:
    """Return the indices of the columns that have no role yet and may have ``role``.

    If the headers of the readings state loads, as in ``F = 100 N``, all columns with such headers
    hold readings; none of them holds forces or pressures. ``roles`` holds the roles that are
    already known, and ``headers`` the headers of all columns.
    """
    assigned = {*roles.columns.values(), *roles.readings}
    free = [column for column in range(len(headers)) if column not in assigned]
    names_of_readings = [headers[column] for column in roles.readings]
    if role in ("force", "pressure") and load_in_name(names_of_readings) is not None:
        return [column for column in free if load_in_name([headers[column]]) is None]
    return free


def _several_candidates(
    place: str, role: str, candidates: Sequence[int], headers: Sequence[str]
) -> InputError:
    """Return the error for a role that several columns could have.

    ``place`` names the table, and ``candidates`` are the indices of the columns. ``headers`` are
    the headers of all columns.
    """
    names = " and ".join(repr(headers[column][:LONGEST_NAME]) for column in candidates)
    different = {comparable(headers[column]) for column in candidates}
    if role != "reading" and len(different) < len(candidates):
        return InputError(
            f"{place}: one column must hold the {role}, got {names}. Say which by its number,"
            f" one of {_numbers_of(candidates)}: --{role}-column {candidates[0] + 1}."
        )
    advice = ""
    if role == "reading":
        options = " ".join(f"--reading-column {column + 1}" for column in candidates[:3])
        advice = f", or all, each a test of its own: {options}"
        if len(candidates) > 3:
            advice += " …"
    return InputError(
        f"{place}: one column must hold the {role}, got {names}. Say which:"
        f" --{role}-column{advice}."
    )


def _units_of_angles(headers: Sequence[str], units: Sequence[str], is_log: bool) -> list[str]:
    """Return the unit of each column; it is empty if the column cannot hold angles of the bar.

    A column such as ``Tilt [deg]`` cannot hold the angle of the bar. If ``is_log`` is true, no
    column can: the user has then stated a column of times, from which the angles are computed.
    ``headers`` and ``units`` hold the header and the unit of each column.
    """
    units_of_angles = []
    for header, unit in zip(headers, units, strict=False):
        is_other = is_log or _OTHER_ANGLE.search(header[:LONGEST_NAME]) is not None
        units_of_angles.append("" if is_other else unit)
    return units_of_angles


def _find_role_by_unit(
    role: str, roles: ColumnRoles, units: Sequence[str], headers: Sequence[str]
) -> None:
    """Give a role to a free column whose unit fits this role, such as deg for angle.

    A free column is a column without any role. Nothing is done if another column already has the
    role, or if the units of several free columns fit. ``units`` holds the unit of each column. The
    role is recorded in ``roles``. ``headers`` are the headers of all columns.
    """
    if role in roles.columns:
        return
    if role == "reading" and roles.readings:
        return
    free = _free_columns(role, roles, headers)
    in_unit = [column for column, unit in enumerate(units) if unit in UNITS[role]]
    candidates = [column for column in in_unit if column in free]
    if len(candidates) == 1:
        roles.columns[role] = candidates[0]


def _several_readings(
    free: Sequence[int], candidates: Sequence[int], headers: Sequence[str]
) -> list[int]:
    """Return the indices of the columns of readings if there is one such column for each test.

    The header of such a column states the load of the test (``36 N [mm]``), names a run
    (``Run 1``), or is only a number. An ambiguous load such as ``1 238 N`` also counts; it may mean
    1238 N, or 238 N after another number. Two columns also count if their headers name the two
    directions of travel, as in ``CCW [mm]`` and ``CW [mm]``. Return an empty list if the table does
    not have several such columns.

    Parameters
    ----------
    free
        Indices of the columns that have no role.
    candidates
        Indices of the columns in ``free`` whose headers name readings.
    headers
        Header of each column.
    """
    if heads_loads(headers):
        return list(free)
    loaded = []
    for column in free:
        names = [headers[column]]
        if load_in_name(names) is not None or load_is_ambiguous(names):
            loaded.append(column)
    if len(loaded) > 1 and set(candidates) <= set(loaded):
        return loaded
    directed = _named_after_directions(free, headers)
    if directed and set(candidates) <= set(directed):
        return directed
    if len(candidates) > 1 and _numbered(candidates, headers):
        return list(candidates)
    return []


def _named_after_directions(free: Sequence[int], headers: Sequence[str]) -> list[int]:
    """Return the indices of two columns of readings, one for each direction of travel.

    Their headers are directions, as in ``CW [mm]``, right and left, or name a direction beside
    readings, as in ``Deviation CW [mm]``. Return an empty list if there is not exactly one column
    for each direction. ``free`` are the indices of the columns without a role, and ``headers`` the
    headers of all columns.
    """
    directed = []
    directions: list[str] = []
    for column in free:
        name, unit = unit_of(headers[column])[:2]
        senses = senses_of_header(name)
        may_be_readings = direction_named(name) in senses or has_role(name, "reading")
        if len(senses) == 1 and may_be_readings and (not unit or unit in UNITS["reading"]):
            directed.append(column)
            directions += senses
    if sorted(directions) != ["CCW", "CW"]:
        return []
    return directed


def _check_are_no_angles(place: str, headers: Sequence[str]) -> None:
    """Raise an `InputError` if the header of a column of readings names angles.

    An example is ``Angle 238 N (deg)``: each test then has a separate column of angles. ``place``
    names the table, and ``headers`` are the headers of the columns of readings.
    """
    for header in headers:
        name, unit = unit_of(header)
        if has_role(_without_place(name), "angle") or unit in UNITS["angle"]:
            raise InputError(
                f"{place}: a table with several columns of readings must have one column of angles,"
                f" got another: {header[:LONGEST_NAME]!r}. Order the columns as angle, reading,"
                " angle, reading … from the first column on, and leave out --angle-column."
            )


def _numbered(columns: Sequence[int], headers: Sequence[str]) -> bool:
    """Return whether columns are named after runs, such as "Run 1" and "Run 2".

    ``columns`` are the indices of these columns, and ``headers`` the headers of all columns.
    """
    return names_runs([unit_of(headers[column]).name for column in columns])


def names_runs(names: Sequence[str]) -> bool:
    """Return whether names are those of different runs, such as "Run 1" and "Run 2"."""
    numbers = set()
    words = set()
    for name in names:
        match = _RUN.fullmatch(comparable(name))
        if match is None:
            return False
        numbers.add(match["number"])
        words.add(match["name"])
    return len(words) == 1 and len(numbers) == len(names)


def _candidates(role: str, columns: Sequence[int], headers: Sequence[str]) -> list[int]:
    """Return the indices of those ``columns`` whose headers name ``role``, such as time.

    A column whose header is the name of a field of a test (`PER_TEST`), such as ``radius_mm``, is
    returned only if no other column names the role. ``headers`` are the headers of all columns.
    """
    candidates = []
    for column in columns:
        header = unit_of(headers[column])
        # A column "Circle [mm]" holds a length, but a column "Run 1 [mm]" holds the readings of a
        # test.
        is_length = header.unit in UNITS["reading"] and _RUN.fullmatch(header.name.lower()) is None
        name = header.name
        if role == "angle":
            name = _without_place(name)
        if has_role(name, role) and not (role == "test" and is_length):
            candidates.append(column)
    other_columns = [column for column in candidates if headers[column] not in PER_TEST]
    if role == "reading" and other_columns:
        other_columns = _candidates_for_readings(other_columns, columns, headers)
    return other_columns or candidates


def _without_place(name: str) -> str:
    """Return the name of a column without the word "position", if the name states a load."""
    if load_in_name([name]) is None:
        return name
    return _PLACE_ON_TABLE.sub("", name)


def _candidates_for_readings(
    named: Sequence[int], columns: Sequence[int], headers: Sequence[str]
) -> list[int]:
    """Return the indices of those ``columns`` that may hold readings.

    If there is also a column of deviations, a column "Radius" or "Diameter" does not hold readings,
    but the nominal size of the circle. A column "CW [um]" may hold further readings. ``named`` are
    the indices of the columns whose headers name readings, and ``headers`` the headers of all
    columns.
    """
    deviations = [column for column in named if not names_circle(headers[column])]
    candidates = deviations or list(named)
    lengths = _lengths_headed_by_directions(columns, headers)
    return candidates + [column for column in lengths if column not in candidates]


def _lengths_headed_by_directions(columns: Sequence[int], headers: Sequence[str]) -> list[int]:
    """Return the indices of those ``columns`` whose headers are a direction and a unit of length.

    An example is ``CW [um]``. ``headers`` are the headers of all columns.
    """
    lengths = []
    for column in columns:
        name, unit = unit_of(headers[column])[:2]
        if direction_named(name) in senses_in(name) and unit in UNITS["reading"]:
            lengths.append(column)
    return lengths


def names_circle(header: str) -> bool:
    """Return whether a header consists only of a word for the radius or diameter of the circle."""
    name = comparable(unit_of(header).name)
    return any(re.fullmatch(entry["words"], name, re.IGNORECASE) for entry in _CIRCLE_WORDS)


def _column_index(place: str, role: str, reference: str | int, headers: Sequence[str]) -> int:
    """Return the index of the column that the layout states for a role.

    ``reference`` is either the number of the column, counted from 1, or the column's header with or
    without the unit. ``place`` names the table in error messages, and ``headers`` are the headers
    of its columns.
    """
    if isinstance(reference, int):
        require(
            1 <= reference <= len(headers),
            f"{place}: column of the {role} must be 1 to {len(headers)}, got {reference}. Correct"
            " it.",
        )
        return reference - 1
    wanted = comparable(reference)
    matching = [k for k, header in enumerate(headers) if comparable(header) == wanted]
    if not matching:
        wanted = comparable(unit_of(reference).name)
        names = [comparable(unit_of(header).name) for header in headers]
        matching = [k for k, name in enumerate(names) if name == wanted]
    if len(matching) == 1:
        return matching[0]
    if matching:
        raise InputError(
            f"{place}: column of the {role} must be one, got several named {reference!r}. Say which"
            f" by its number, one of {_numbers_of(matching)}: --{role}-column {matching[0] + 1}."
        )
    raise _unknown_column(place, role, reference, headers)


def _numbers_of(columns: Sequence[int]) -> str:
    """Return a text with the numbers of columns, counted from 1: ``2, 3`` for indices 1 and 2."""
    return ", ".join(str(column + 1) for column in columns)


def _unknown_column(place: str, role: str, reference: str, headers: Sequence[str]) -> InputError:
    """Return the error for a column that the user names, but that the table does not have.

    ``reference`` is the header or the number by which the user names the column. ``headers`` are
    the headers of the table.
    """
    candidates = ", ".join(repr(header[:LONGEST_NAME]) for header in headers if header)
    hint = suggestion(reference, headers) if any(headers) else ""
    return InputError(
        f"{place}: column of the {role} must be one of {candidates or 'no header'}, got"
        f" {reference!r} (none such).{hint}"
    )
