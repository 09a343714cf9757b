"""Statements in the lines above a table: numbers, names, dates and directions.

An example is the line ``Radius: 150 mm``, which states the field ``radius_mm``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

from ldbb_bayes.reading.bar_extensions import length_of_sum, names_extension
from ldbb_bayes.reading.cited_lines import TEXT_SHOWN, CitedLine
from ldbb_bayes.reading.dates import iso_date
from ldbb_bayes.reading.force_laws import states_force_law
from ldbb_bayes.reading.header_rows import names_any_role
from ldbb_bayes.reading.line_parts import divide_line
from ldbb_bayes.reading.measured_length import measured_length_stated
from ldbb_bayes.reading.mount_statement import mount_state
from ldbb_bayes.reading.numerals import (
    NUMBER_IN_TEXT,
    is_missing,
    may_be_thousands,
    number_in_text,
)
from ldbb_bayes.reading.planes import axes_in_two_lines, plane_of_words
from ldbb_bayes.reading.programmed_circles import (
    programmed_arcs,
    programs_arc,
    radius_beside_feed,
)
from ldbb_bayes.reading.travel_direction import NAMES_DIRECTION, directions_stated
from ldbb_bayes.reading.unit_lines import units_stated
from ldbb_bayes.reading.words import (
    ABSOLUTE_PRESSURE,
    LONGEST_TEXT,
    OTHER_QUANTITY,
    UNITS,
    WORDS,
    unit_named,
)

__all__ = [
    "LineStatement",
    "Lines",
    "is_label",
    "not_understood",
    "statements_in",
    "unknown_length",
]

# Type of lines of text: pairs of line number and text. For a line of another sheet, the line number
# is replaced by a text such as "3 of notes.txt".
Lines = Sequence[tuple[int | str, str]]


@dataclass(frozen=True)
class LineStatement:
    """Value that a line above a table states for a field of a test or campaign."""

    #: value that the line states for a field of a test or campaign. The end of the field's name
    #: shows the unit of the value: ``radius_mm`` is in mm. The value is NaN if it is unclear, for
    #: example because its number can be read in two ways, such as 1,000
    value: Any
    unit: str  #: unit of the stated value as the line writes it; empty if the line states none
    #: number of the line in its file. If the line and the test are on different sheets, this is a
    #: text that also names the sheet of the line, as in "3 of notes.txt"
    line: int | str
    #: reason why the stated value is NaN, such as "several numbers"; empty if the value is certain.
    #: It is also empty if the value is NaN because a comma or point in the number may separate
    #: thousands, as in 1,000
    doubt: str = ""


class _Quantity(NamedTuple):
    """Quantity, such as the radius, whose value a line above a table may state."""

    field: str  #: field of a test or campaign in which the value is stored, such as radius_mm
    words: str  #: regular expression for the words, such as "Radius", that name the quantity
    #: unit of the quantity that is assumed if a line states only a number; empty if the line must
    #: state a unit
    usual_unit: str
    #: dict of the permitted units of the quantity. The values are the sizes of the units, expressed
    #: in the unit in which the quantity is stored: for a radius, which is stored in mm, the size of
    #: cm is 10
    units: Mapping[str, float]
    is_of_bar: bool  #: whether the quantity is the length of a bar, which may have an extension


def _expand_parts() -> dict[str, str]:
    """Return a dict with named parts of regular expressions; the keys are the names of the parts.

    The parts come from ``words.toml``. There, a part may contain the names of earlier parts. In the
    result, each of these names is replaced by the regular expression that it stands for.
    """
    expanded: dict[str, str] = {}
    for name, pattern in WORDS["parts"].items():
        expanded[name] = pattern % expanded
    return expanded


def _quantities() -> dict[str, _Quantity]:
    """Return a dict with the quantities that lines above a table may state.

    The keys are the names of the quantities in ``words.toml``.
    """
    quantities = {}
    for key, entry in WORDS["numbers"].items():
        units = entry["units"]
        # In ``words.toml``, the name of a role, such as force, may take the place of a list of
        # units. It stands for all units of force.
        if isinstance(units, str):
            units = UNITS[units]
        # ``UNITS`` states the sizes of units of length in µm, but a radius is stored in mm. The key
        # ``one`` of an entry in ``words.toml`` is the factor that converts these sizes, here 0.001.
        # For a diameter, it is 0.0005, because half the diameter is stored as the radius.
        factor = entry.get("one", 1.0)
        sizes = {unit: factor * size for unit, size in units.items()}
        quantities[key] = _Quantity(
            field=entry.get("field", key),
            words=entry["words"],
            usual_unit=entry["unit"],
            units=sizes,
            is_of_bar=entry.get("is_of_bar", False),
        )
    return quantities


_PARTS = _expand_parts()
_QUANTITIES = _quantities()
# Regular expression for a complete number in a line above a table. The expression does not match
# the beginning of a time, a date or a longer number.
_WHOLE_NUMBER = rf"(?P<number>{NUMBER_IN_TEXT})(?![\d:/]|[.,]\d|[\-−]\d|\s\d{{3}}(?!\d))(?!')"
# Regular expression for a unit that a line states before the number. The unit is a word after "in",
# a text in brackets, or a symbol in front of a separator, as in "mm:".
_UNIT_BEFORE = (
    r"(?:in\s+(?P<inside>[^\s:=;,|]+)|[\[(](?:in\s+)?(?P<brackets>[^\])]*)[\])]"
    r"|(?P<cell_before>mm|cm|inch|in|N|kN|daN|bar|MPa|mm/min)(?=[;,|\t]|\s?[:=]))"
)
# Regular expression for what may follow a number before its unit: a decimal mark without decimals,
# and a tolerance, as in "150. ± 0.1 mm".
_TOLERANCE = rf"\.?(?:\s?(?:±|\+/?[-−])\s?{NUMBER_IN_TEXT})?"
# Regular expression for the word that follows a number, in the same cell or in the next cell.
_FOLLOWING = _TOLERANCE + r"\s*(?P<cell>[;|,\t]?)\s*(?P<following>[^\s;,|()\[\]]*)"
# Regular expressions for words, such as "Operator", after which a line above a table states a name.
# The keys are the fields whose values are these names. ``_NAME_AFTER`` is the regular expression
# for one of these words together with the name.
_NAME_WORDS = {key: words % _PARTS for key, words in WORDS["names"].items()}
_NAME_AFTER = rf"{_PARTS['cell']}(?:%s)\s*(?:[:=]\s*[;,|\t]?|[;|\t])\s*(\w(?:[^;,|\t]|,\s)*)"
# Regular expressions for statements in words, such as "plane XY" or a date. The keys are the fields
# that these statements state.
_IN_WORDS = {key: words % _PARTS for key, words in WORDS["in_words"].items()}
_IN_WORDS |= {key: _NAME_AFTER % words for key, words in _NAME_WORDS.items()}
# Regular expression for a cell that holds a label, such as "Operator" or "Date", without its value.
_LABEL = re.compile(
    "|".join((*_NAME_WORDS.values(), "date|datum|plane|ebene", _PARTS["calibrated"])),
    re.IGNORECASE,
)
# Fields of a campaign that are dates.
_DATES = ("date", "ball_bar_calibrated")
# Regular expression for the name in a second pair of name and value, such as "plane=" in
# "machine=DMU 50 plane=XY". The value of the first pair ends before this name.
_FURTHER_PAIR = re.compile(r"\s+[^\W\d]\w*=")
# Regular expression for words such as "calibrated on", which may follow the name of a ball bar.
_CALIBRATED_BEHIND = re.compile(rf",\s*{_PARTS['calibrated']}", re.IGNORECASE)
_PRODUCT = re.compile(_PARTS["product"], re.IGNORECASE)
# Regular expression for words which show that a line is about the readings or about the ball's
# mount.
_READINGS = re.compile(WORDS["mount"]["readings"], re.IGNORECASE)
# Regular expression for words, such as "the" and "readings", that are left out before a statement
# on the deflection of the ball's mount is examined. The statement says whether the readings are
# compensated for this deflection.
_FILLING = re.compile(f"{_READINGS.pattern}|{WORDS['mount']['filling']}", re.IGNORECASE)
_MOUNT_STATES = {state: WORDS["mount"][state] for state in ("raw", "compensated")}
# Regular expression for a length with its unit, together with the words before the length.
_LENGTH = re.compile(
    rf"[^;,|\t]*?(?P<number>(?<![\d.,:/-]){NUMBER_IN_TEXT})[\s;|\t]?(?P<unit>[^\W\d_]+|\")(?![/\w])"
)
# Regular expression for a unit in brackets, followed by a number.
_UNIT_AND_NUMBER = re.compile(rf"[\[(]([^\W\d]+)[\])]\s*[:=]?\s*({NUMBER_IN_TEXT})")
# Regular expression for a letter that means a radius or a diameter, followed by a number, as in
# D200. An abbreviation of the word "nominal" may stand between the letter and the number, as in
# Rnom: 100.
_LETTER_AND_NUMBER = re.compile(
    r"(?<![\w.])(?:CR|[RrDØø](?:[_ ]?(?:nom\w*|soll|0(?=\W)))?)\s?[:=]?\s?"
    r"(?:[5-9]\d|[1-9]\d\d)(?:[.,]\d+)?(?![\w.,])"
)
# Regular expression for a word that means the radius or the diameter of a circle.
_CIRCLE = re.compile(rf"(?<![^\W_])(?:{WORDS['circle']['named']})", re.IGNORECASE)
# Regular expression for a word that means the bar, followed by a number from 50 to 999, which may
# be a radius in mm.
_BAR_AND_NUMBER = re.compile(
    rf"(?<!\w)(?:{WORDS['circle']['bar']})\b.*?(?<![\w.,])(?:[5-9]\d|[1-9]\d\d)(?:[.,]\d+)?"
    r"(?![\d.,]|-\d)(?!\s?\w{3})",
    re.IGNORECASE,
)
# Regular expression for a unit that no number of a test has, such as kg in "Force;10;kg". The
# number before it is therefore not taken in the usual unit.
_OTHER_UNIT = re.compile(WORDS["units_not_taken"]["words"], re.IGNORECASE)
# Regular expression for the end of a unit such as mm/min.
_PER_MINUTE = re.compile(r"/\s?min\b", re.IGNORECASE)
# Regular expression for words that mean the ball bar. These words are removed from a line before it
# is searched for words that mean other balls.
_BALL_BAR = re.compile(WORDS["circle"]["ball_bar"], re.IGNORECASE)
# Fields that state the load of a test: its force and its pressure.
_LOADS = ("force_N", "pressure_bar")
# Fields of a test whose value in a line is one number, and never a list of numbers.
_FIELDS_OF_ONE_NUMBER = ("force_N", "pressure_bar", "radius_mm")
# Largest number that is taken for the angle at which a circle starts if it has no unit [deg]. A
# larger number, as in ``Start: 1772706000``, may be the time of the start.
_LARGEST_START_DEG = 360.0
# Regular expression for a further number in a list of numbers, with its unit if it has one, such as
# 390 N in "36 N, 390 N".
_FURTHER_NUMBER = rf"[\s;,|]+{NUMBER_IN_TEXT}(?:\s?[^\W\d_]+)?"
# Regular expression for all that follows the first number in a list of numbers, such as " N, 390 N"
# in "36 N, 390 N".
_FURTHER_NUMBERS = re.compile(rf"(?:\s?[^\W\d_]+)?(?:{_FURTHER_NUMBER})+[\s;,|]*")
# Regular expression for a text behind a number, with a second number that is added to it or
# subtracted from it, as in "26 N + 10 N", or by which it is to be multiplied.
_COMPUTED = re.compile(WORDS["qualifications"]["computed"], re.IGNORECASE)
# Reason that a message gives if the value of a quantity is not known because the line has a list of
# numbers.
_LIST_OF_NUMBERS = "several numbers"
# Reason that a message gives if the length of a bar is not known because the bar has an extension.
_WITH_EXTENSION = "a bar and an extension"
# Smallest and largest length that may be the radius or diameter of a circle [µm].
_RADII_UM = (2e4, 2e6)
# Regular expression for a text that ends with a word such as "under". In "under load", the word
# "load" does not state a value.
_UNDER = re.compile(
    r"\b(?:unter|under|mit|with|ohne|without|bei|sous|sotto|bajo)\s+$", re.IGNORECASE
)
# Regular expressions for words which show that a line is about a field, even if the line cannot be
# understood; the keys are the fields.
_SUBJECTS = {
    "force_N": re.compile(rf"\b{_QUANTITIES['force_N'].words}\b", re.IGNORECASE),
    "pressure_bar": re.compile(rf"\b{_QUANTITIES['pressure_bar'].words}\b", re.IGNORECASE),
    "feed_mm_per_min": re.compile(rf"\b{_QUANTITIES['feed_mm_per_min'].words}\b", re.IGNORECASE),
    "radius_mm": re.compile("(?i)(?<!kugel)radius"),
    "direction": NAMES_DIRECTION,
    "mount": re.compile("(?i)ompens|mount"),
}


def statements_in(lines: Lines) -> dict[str, list[LineStatement]]:
    """Return a dict with all statements that lines of text make about fields of a test or campaign.

    The keys are the fields, and each value is the list of the statements about this field. Numbers
    with an unknown unit are ignored. Quantities that are not fields, such as a maximum or an
    ambient value, are ignored, too.
    """
    statements: dict[str, list[LineStatement]] = {}
    is_extended = any(names_extension(text[:LONGEST_TEXT]) for _, text in lines)
    for line, content in lines:
        text = content[:LONGEST_TEXT]
        for field, statement in _numbers_stated(text, line, is_extended):
            statements.setdefault(field, []).append(statement)
        if "radius_mm" not in statements:
            for radius, unit in _radii_before_words(text):
                statement = LineStatement(radius, unit, line)
                statements.setdefault("radius_mm", []).append(statement)
        in_words = {**units_stated(text), **measured_length_stated(text)}
        for key, words in (*_stated_in_words(text), *in_words.items()):
            statements.setdefault(key, []).append(LineStatement(words, "", line))
    axes = axes_in_two_lines(lines)
    if axes is not None:
        line_of_axes, plane = axes
        statements.setdefault("plane", []).append(LineStatement(plane, "", line_of_axes))
    for field, statement in _programmed_numbers(lines):
        statements.setdefault(field, []).append(statement)
    return statements


def _programmed_numbers(lines: Lines) -> Iterator[tuple[str, LineStatement]]:
    """Yield the radii and feeds that lines of G-code state.

    Each item is a pair: the name of the field, such as ``programmed_radius_mm``, and an object with
    the number in the unit of the field.
    """
    for arc in programmed_arcs(lines):
        if arc.radius_mm is not None:
            yield "programmed_radius_mm", LineStatement(arc.radius_mm, "mm", arc.line)
        if arc.feed is not None:
            statement = LineStatement(arc.feed.mm_per_min, "mm/min", arc.feed.line)
            yield "programmed_feed_mm_per_min", statement
    for line, text in lines:
        words = radius_beside_feed(text)
        if words is not None:
            radius_mm, feed_mm_per_min = words
            yield "programmed_radius_mm", LineStatement(radius_mm, "mm", line)
            yield "programmed_feed_mm_per_min", LineStatement(feed_mm_per_min, "mm/min", line)


def _numbers_stated(
    text: str, line: int | str, is_extended: bool
) -> Iterator[tuple[str, LineStatement]]:
    """Yield the numbers that a line states for fields of a test or campaign.

    Each item is a pair: the name of the field, such as ``radius_mm``, and an object with the number
    in the unit of the field. A line that gives the force as a function of the pressure states
    neither force nor pressure. ``line`` is the number of the line. ``is_extended`` says whether the
    bar has an extension.
    """
    is_law = states_force_law(text)
    for quantity in _QUANTITIES.values():
        if is_law and quantity.field in _LOADS:
            continue  # the numbers in the line are the constants of a force law, and not loads
        for match in _pattern_of_number(quantity.words).finditer(text):
            statement = _length_with_extension(quantity, match, line, is_extended)
            if statement is None:
                statement = _stated_number(quantity, match, line)
            if statement is not None:
                yield quantity.field, statement


def _radii_before_words(text: str) -> Iterator[tuple[float, str]]:
    """Yield each radius that stands before the word for it, such as 100 mm in ``100 mm bar``.

    Each item is a pair: the radius [mm], and its unit as it stands in the text.
    """
    for quantity in _QUANTITIES.values():
        if quantity.field != "radius_mm":
            continue
        for match in _pattern_of_length_before_name(quantity.words).finditer(text):
            unit = _unit_among(match["unit"], quantity.units)
            value = number_in_text(match["number"])
            if unit and value is not None and not OTHER_QUANTITY.search(text[: match.start()]):
                yield value * quantity.units[unit], match["unit"]


@cache
def _pattern_of_length_before_name(words: str) -> re.Pattern[str]:
    """Return a compiled regular expression for a length before a word for it: ``100 mm bar``.

    ``words`` is the regular expression for this word, here ``bar``.
    """
    return re.compile(
        rf"(?<![\d.,:/-])(?P<number>{NUMBER_IN_TEXT})\s?(?P<unit>[^\W\d_]+|\")\s(?:{words})"
        r"(?![\w=:])",
        re.IGNORECASE,
    )


@cache
def _pattern_of_number(words: str) -> re.Pattern[str]:
    """Return a compiled regular expression for a statement such as ``Radius: 150 mm``.

    ``words`` is the regular expression for the words that name the quantity, such as ``Radius``.
    The unit may be before or after the number.
    """
    between = rf"{_PARTS['between']}{{0,4}}"
    return re.compile(
        rf"\b(?P<words>{words})(?!\w){between}(?:{_UNIT_BEFORE}{between})?{_WHOLE_NUMBER}"
        rf"{_FOLLOWING}",
        re.IGNORECASE,
    )


def _stated_number(
    quantity: _Quantity, match: re.Match[str], line: int | str
) -> LineStatement | None:
    """Return the number that a line states for a quantity, in the unit of the field.

    The number is NaN if it can be read in two ways, such as 1,000, or if the line lists several
    numbers where only one is allowed. Return None if the number belongs to another quantity, is
    part of a title, has a unit that is not permitted, or is too large for computations. The same
    holds for a start angle without a unit that is larger than a turn.

    Parameters
    ----------
    quantity
        The quantity with its field and its permitted units.
    match
        Match of the regular expression for the quantity, its number and its unit.
    line
        Number of the line in its file, or number and sheet as text.
    """
    if _is_other_quantity(quantity, match):
        return None
    named = _unit_beside(quantity, match)
    unit: str | None = quantity.usual_unit
    if not named and quantity.field in ("force_N", "pressure_bar") and _is_in_title(match):
        return None
    if named:
        unit = _unit_among(named, quantity.units)
    value = number_in_text(match["number"])
    if not unit or value is None or (not named and _is_no_start(quantity, value)):
        return None
    if may_be_thousands(quantity.field, match["number"], quantity.units[unit]):
        return LineStatement(math.nan, named, line)
    if quantity.field in _FIELDS_OF_ONE_NUMBER and _lists_numbers(match, quantity.units):
        return LineStatement(math.nan, named, line, _LIST_OF_NUMBERS)
    return LineStatement(value * quantity.units[unit], named, line)


def _is_other_quantity(quantity: _Quantity, match: re.Match[str]) -> bool:
    """Return whether the words around a number show that it is not that of the quantity.

    An example is a maximum, or an absolute pressure, as in ``Pressure: 2 bar abs``. ``match`` is
    the match of the regular expression for the quantity, its number and its unit.
    """
    words_before = _words_before_number(match)
    if OTHER_QUANTITY.search(words_before) or OTHER_QUANTITY.fullmatch(match["following"]):
        return True
    if quantity.field != "pressure_bar":
        return False
    behind = re.split(r"[;,|\t]", match.string[match.end() :])[0]
    return ABSOLUTE_PRESSURE.search(words_before + match[0] + behind) is not None


def _is_no_start(quantity: _Quantity, value: float) -> bool:
    """Return whether a number without a unit is too large for the angle at which a circle starts.

    ``quantity`` is the quantity that the line states, which may be another, and ``value`` is the
    number.
    """
    return quantity.field == "start_deg" and abs(value) > _LARGEST_START_DEG


def _unit_beside(quantity: _Quantity, match: re.Match[str]) -> str:
    """Return the unit before or after the number of a quantity; empty if the line states none.

    ``match`` is the match of the regular expression for the quantity, its number and its unit.
    """
    following: str = match["following"]
    is_unit = _unit_among(following, quantity.units) or _OTHER_UNIT.fullmatch(following)
    if match["cell"] and not is_unit:
        # the text after the number is in a cell of its own and is no unit, so that it does not
        # belong to the number
        following = ""
    return match["inside"] or match["brackets"] or match["cell_before"] or following


def _lists_numbers(match: re.Match[str], units: Mapping[str, float]) -> bool:
    """Return whether several numbers follow the name of a quantity: ``load [lbf]: 8 8 80 80``.

    The same holds for a number that is computed from two, as in ``Force: 26 N + 10 N``. A list must
    reach to the end of the line. A single number that is merely repeated does not
    count as a list, and neither do numbers with a unit of another quantity. ``units`` are the
    permitted units of the quantity.
    """
    number = match["number"]
    behind = match.string[match.end("number") :]
    computed = _COMPUTED.match(behind)
    if computed is not None and _unit_among(computed["unit"] or "", units) is not None:
        return True
    if computed is not None and (computed["word"] or computed["times"]):
        return True
    if _FURTHER_NUMBERS.fullmatch(behind) is None:
        return False
    if any(_unit_among(word, units) is None for word in re.findall(r"[^\W\d_]+", behind)):
        return False
    further = re.findall(NUMBER_IN_TEXT, behind)
    return any(number_in_text(text) != number_in_text(number) for text in further)


def _length_with_extension(
    quantity: _Quantity, match: re.Match[str], line: int | str, is_extended: bool
) -> LineStatement | None:
    """Return a statement of the total length of a bar and its extension [mm], or None.

    The length of the bar is stated in a line above a table. The value of the statement is NaN if
    the lines name an extension, but do not show whether the stated length includes it. Return None
    if the bar has no extension, or if the matched quantity is not the length of the bar, which is
    the radius of the circle.

    Parameters
    ----------
    quantity
        The quantity whose number was matched.
    match
        Match of the regular expression for the quantity, its number and its unit.
    line
        Number of the line in its file, or number and sheet as text.
    is_extended
        Whether a line names an extension of the bar with its length.
    """
    if quantity.field != "radius_mm" or OTHER_QUANTITY.search(_words_before_number(match)):
        return None
    total = length_of_sum(match.string[match.start("number") :])
    if total is None and quantity.is_of_bar and is_extended:
        total = math.nan
    if total is None:
        return None
    if math.isnan(total):
        return LineStatement(total, "mm", line, _WITH_EXTENSION)
    return LineStatement(total, "mm", line)


def _is_in_title(match: re.Match[str]) -> bool:
    """Return whether a load without a unit is part of a title: ``Circular test under load 2``.

    The load is part of a title in two cases: there is no separator, such as a colon, between the
    name of the load and the number, or a word such as "under" stands before the name.
    """
    if _UNDER.search(match.string[: match.start()]):
        return True
    return re.search(r"[:=;,|\t]", match.string[match.start() : match.start("number")]) is None


def _words_before_number(match: re.Match[str]) -> str:
    """Return the words that stand before the number of a quantity, in the same cell.

    ``match`` is the match of the regular expression for the quantity, its number and its unit, as
    in ``Feed [mm/min]: 2000``. The name of the quantity and its unit are left out, because words in
    them could be mistaken for another quantity: "ball" in "ball bar", or "min" in "mm/min".
    """
    before_match = match.string[: match.start()]
    cell = _PER_MINUTE.sub("", re.split(r"[;,|\t]", before_match)[-1])
    words = match.string[match.end("words") : match.start("number")]
    for unit in (match["inside"], match["brackets"]):
        if unit:
            words = words.replace(unit, "")
    if " of " in match["words"]:
        # The matched name of a quantity may itself say that it belongs to something other than the
        # circle, as in "diameter of workpiece".
        words += _BALL_BAR.sub("", match["words"])
    return cell + words


def _unit_among(name: str, units: Mapping[str, float]) -> str | None:
    """Return the unit from ``units`` that means the same as ``name``; None if there is none.

    The spelling may differ, also in upper and lower case. The keys of ``units`` are the units.
    """
    wanted = {name.casefold(), unit_named(name).casefold()}
    for unit in units:
        if unit.casefold() in wanted:
            return unit
    return None


def _stated_in_words(text: str) -> Iterator[tuple[str, str]]:
    """Yield each field that a line above a table states in words, and the value of the field.

    The fields are the plane, dates (in ISO 8601), and names of people, places and instruments. A
    further field says whether readings are raw or compensated for the deflection of the ball's
    mount.
    """
    for key, pattern in _IN_WORDS.items():
        for match in re.finditer(pattern, text, re.IGNORECASE):
            groups = [group for group in match.groups() if group]
            value = _value_in_words(key, groups[0].strip(), match[0])
            if value.isprintable() and not is_missing(value or "-"):
                yield key, value
    states = [mount_state(statement) for statement in divide_line(text)]
    for passage in dict.fromkeys((text, *re.split(r"[;|\t]|,(?!\s)", text))):
        states += _mount_states(passage, is_whole_line=passage == text)
    for state in dict.fromkeys(states):
        if state:
            yield "mount", state


def _value_in_words(key: str, value: str, matched: str) -> str:
    """Return the value that the words of a line state for a field; empty if they state no value.

    ``key`` is the name of the field, and ``value`` the words that may be its value. ``matched`` is
    the whole statement: these words with the label in front of them.
    """
    if key == "plane":
        return plane_of_words(value)
    if key in _DATES:
        return iso_date(value)
    if key in _NAME_WORDS:
        if _is_header_beside(key, value, matched):
            return ""
        value = _CALIBRATED_BEHIND.split(value)[0]
        return _FURTHER_PAIR.split(value)[0]
    return value


def _is_header_beside(key: str, value: str, matched: str) -> bool:
    """Return whether the text after a label is another label or a header, and not a value.

    In ``Operator;Date``, for example, both words are labels. ``key`` is the field that the first
    label names, and ``value`` is the text after the first label, here ``Date``. ``matched`` is the
    whole passage, here ``Operator;Date``.
    """
    if key == "ball_bar" and _PRODUCT.fullmatch(value):
        return False
    if _LABEL.fullmatch(value):
        return True
    return names_any_role(value) and re.search(r"[:=\d]", matched) is None


def _mount_states(passage: str, is_whole_line: bool) -> Iterator[str]:
    """Yield "raw" or "compensated" if a passage says that the readings are raw or compensated.

    Compensated readings are corrected for the deflection of the work ball's mount. A passage is a
    whole line or a single cell of a line. A single cell must also name the readings or the mount; a
    whole line with a word such as "compensated" need not name either. ``is_whole_line`` is
    true for a whole line.
    """
    remaining = " ".join(_FILLING.sub(" ", passage.casefold()).split())
    if not (_READINGS.search(passage) or (is_whole_line and "ompens" in remaining)):
        return
    for state, pattern in _MOUNT_STATES.items():
        if re.fullmatch(pattern, remaining):
            yield state


def unknown_length(lines: Lines) -> CitedLine | None:
    """Return a note on the first line with a length that may be the radius of the circle.

    Examples of such lines are ``Reach: 100 mm``, ``R100``, G-code for an arc, and a line that
    contains a number and a word for a circle or a bar. The note is empty if there is no such line,
    or if a line clearly states the radius.
    """
    statements = statements_in(lines)
    if "radius_mm" in statements or "programmed_radius_mm" in statements:
        return None
    for line, content in lines:
        # A unit in brackets before a number, as in "Circle [mm]: 100", is moved after the number.
        text = _UNIT_AND_NUMBER.sub(r"\2 \1", content[:LONGEST_TEXT])
        length = _possible_radius(text)
        if length:
            return CitedLine(f"line {line} says {length[:TEXT_SHOWN]}, not taken", line, length)
    return None


def _possible_radius(text: str) -> str:
    """Return the words of a line that may state the radius of a circle; empty if no words do."""
    if OTHER_QUANTITY.search(_BALL_BAR.sub("bar", text)):
        return ""
    smallest_um, largest_um = _RADII_UM
    for match in _LENGTH.finditer(text):
        if match["unit"] == '"' and text[: match.end()].count('"') % 2 == 0:
            continue  # the sign " is a closing quotation mark, and does not mean inches
        size_um = UNITS["reading"].get(unit_named(match["unit"]), 0.0)
        length = number_in_text(match["number"])
        if length is not None and smallest_um <= abs(length) * size_um <= largest_um:
            return match[0].strip()
    letter = _LETTER_AND_NUMBER.search(text)
    if letter is not None:
        return letter[0]
    if measured_length_stated(text):
        return ""
    has_number = re.search(r"\d|mm", text) is not None
    names_circle = has_number and _CIRCLE.search(text) is not None
    if names_circle or _BAR_AND_NUMBER.search(text) or programs_arc(text):
        return text.strip()
    return ""


def is_label(text: str) -> bool:
    """Return whether a text is a label without its value, such as ``Operator`` or ``Radius``."""
    if len(text) < 2:
        return False
    if _LABEL.fullmatch(text) or NAMES_DIRECTION.fullmatch(text):
        return True
    quantities = _QUANTITIES.values()
    return any(re.fullmatch(quantity.words, text, re.IGNORECASE) for quantity in quantities)


def not_understood(lines: Lines) -> dict[str, CitedLine]:
    """Return a dict with a note on each field that a line mentions but does not state clearly.

    The keys are fields. A line mentions a field without stating it if the line contains a word for
    the field, such as "force", but no value that can be read. The note on a field names the first
    of these lines.
    """
    unclear: dict[str, CitedLine] = {}
    for line, text in lines:
        if _is_understood(line, text):
            continue
        for key, words in _SUBJECTS.items():
            match = words.search(text[:LONGEST_TEXT])
            if match and not _UNDER.search(text[: match.start()]):
                subject = key.split("_")[0]
                reason = f"line {line} says {subject}, not understood"
                unclear.setdefault(key, CitedLine(reason, line))
    return unclear


def _is_understood(line: int | str, text: str) -> bool:
    """Return whether it is known what a line is about.

    This is so if the line states a field of a test or campaign, or exactly one direction of travel.
    It is also so if the line names a quantity that is not a field, such as a maximum or an ambient
    pressure.
    """
    if statements_in([(line, text)]) or OTHER_QUANTITY.search(text):
        return True
    return len(directions_stated([(line, text)])) == 1
