"""Units that lines above a table state, such as ``Units: inch`` or ``1 count = 0.1 µm``."""

from __future__ import annotations

import re
from typing import NamedTuple

from ldbb_bayes.reading.line_parts import segments_of_line
from ldbb_bayes.reading.numerals import NUMBER_IN_TEXT, number_in_text
from ldbb_bayes.reading.unit_sentences import units_in_sentences
from ldbb_bayes.reading.words import (
    LONGEST_NAME,
    LONGEST_TEXT,
    ROLES,
    SHARE,
    UNITS,
    WORDS,
    comparable,
    joined_prefixes,
    scaled_unit,
    shares_mentioned,
    size_of_unit,
    unit_named,
)

__all__ = [
    "COUNT",
    "UNIT_COLUMN",
    "UNIT_KEYS",
    "header_has_factor",
    "inch_alone",
    "is_unit_with_unread_factor",
    "mentions_scale",
    "multiplies_readings",
    "partner_of_units",
    "states_gain",
    "unit_mentioned",
    "units_stated",
    "unknown_unit_in",
]

_WORDS = WORDS["unit_lines"]
# Keys of the dict with the units that a line states. There is one key for the unit of each
# quantity, such as ``angle_unit``. The key ``reading_scale`` is for the size of one count (digital
# step) of the instrument, ``angle_scale`` for the size of one count of an encoder, and
# ``time_scale`` for the time from one sample to the next.
UNIT_KEYS = (*(f"{role}_unit" for role in UNITS), "reading_scale", "angle_scale", "time_scale")
# Regular expression for a line that states units: a label with a word such as "unit", a separator,
# and the units.
_LINE = re.compile(
    rf"(?:^|[;,|\t])\s*(?P<label>[^:=;,|\t]*?(?<!\w)(?:{_WORDS['label']})(?!\w)[^:=;,|\t]*)"
    r"[:=;,|\t]\s*(?P<units>.+)",
    re.IGNORECASE,
)
# Regular expression for a factor in front of a unit, such as 0.1 or 1/1000. A number that ends a
# range, as in 0-360 deg, is not a factor.
_FACTOR_IN_LIST = r"(?<![\w.\-–])(?<!\d,)(?P<factor>(?:1\s?/\s?)?\d+(?:[.,]\d+)?)\s*[x×*·]?\s*"
# Regular expression for one unit, with or without a factor, in the part of a line that states
# units.
_UNIT = re.compile(rf"(?:{_FACTOR_IN_LIST})?(?P<unit>[^\s\d;,|:=()\[\]/][^\s;,|:=()\[\]/]*)")
# Regular expression for the marks between the units of a list, such as "deg / mm".
_BETWEEN_UNITS = re.compile(r"[\s;,|/()\[\]\-–#%]*")
# Regular expression for the number of a revision, as in "rev 2"; "rev" is then not a unit of angle.
_REVISION = re.compile(_WORDS["revision"], re.IGNORECASE)
# Largest number before a unit of angle that is taken as a factor of the unit. A larger number, as
# in 360 deg, is the range of the angles.
_LARGEST_ANGLE_FACTOR = 10.0
# Regular expression for the name of a property of an instrument, such as "resolution". The value of
# such a property may be a fraction of a unit.
_PROPERTY = re.compile(rf"(?<!\w)(?:{_WORDS['property']})(?!\w)", re.IGNORECASE)
# Regular expression for a line that is nothing but a label and a unit, such as "Units - mm".
_BARE_LINE = re.compile(
    rf"\W*(?:(?:{_WORDS['filling']})\s)*(?:{_WORDS['label']})\s*[-–(\[]?\s*"
    r"(?P<unit>(?:(?:1/)?[\d.,]+\s)?[^\s;|()\[\]]+)[\])\s;,|\t]*",
    re.IGNORECASE,
)
# Regular expression for a line that consists of a unit, such as "um", or of a word for readings and
# a unit in brackets, such as "Readings (um)".
_UNIT_ALONE = re.compile(
    rf"\W*(?:{_WORDS['bracketed']})\s*[\[(](?P<bracketed>[^\])]+)[\])]\W*|\W*"
    r"(?P<unit>(?:(?:0[.,]0*1|1/10+|100?(?=\s?nm))\s?)?[^\W\d]+)\W*",
    re.IGNORECASE,
)
# Regular expression for the word "in" beside a sign, as in "+ = in". Here the word means inward and
# not inches.
_SIGN_IN = re.compile(r"\s*[+\-−]\s*[:=]?\s*in\W*|\s*in\s*[:=]\s*[+\-−]\W*", re.IGNORECASE)
# Regular expression for the separators in a list of quantities and units, such as the comma in
# "Angle: deg, Force: N".
_BETWEEN_PAIRS = re.compile(r"[;,|\t](?!\d)|\s{2,}(?=[^\W\d]+\s*[:=])")
# Regular expression for the marks between a unit and remarks, as in "0.1 um; from +X".
_BETWEEN_REMARKS = re.compile(r"[;|\t]")
# Regular expression for a pair of a quantity and its unit, such as "Angle: deg".
_PAIR = re.compile(r"\s*(?P<label>[^:=]+)[:=](?P<unit>[^:=]+)")
# Regular expression for a quantity and its unit in an East Asian language, in which no blanks
# separate the words, as in 位移单位0.1微米 (unit of displacement 0.1 µm).
_WITHOUT_BLANKS = re.compile(
    r"(?P<label>[^\W\d_]+)\s?(?:单位|單位|単位|단위)\s*[:=为為は]?\s*"
    r"(?P<unit>(?:\d[\d./]*\s*)?(?:[^\W\d_]+|°))(?=\s*(?:$|[;,、。|()\t]))",
    re.IGNORECASE,
)
# Regular expression for a number that may be the factor of a unit: 1, 10, 100, or a fraction such
# as 0.1 or 1/100. A text with any other number, such as 5 µm, is a value and not a unit.
_FACTOR_OF_TEN = re.compile(r"(?:1\s?/\s?10+|10{0,2})(?![\d.,])|0[.,]0*1(?!\d)")
# Regular expression for units of readings that are not units of length, such as V.
_NO_LENGTH = re.compile(_WORDS["no_length"], re.IGNORECASE)
# Regular expression for words which say that readings are multiplied or divided by a number.
_MULTIPLIED = re.compile(_WORDS["multiplied"], re.IGNORECASE)
# Regular expression for a text that is nothing but the gain of an amplifier, as in "Gain 10".
_GAIN_ALONE = re.compile(_WORDS["gain_alone"], re.IGNORECASE)
# Regular expression for a factor alone in brackets, as in "Reading [um] (x10)".
_FACTOR_IN_BRACKETS = re.compile(
    r"[\[(]\s*(?:[x×*·÷]\s?(?!1\s*[\])])\d[\d.,]*|(?!1\s?[x×])\d[\d.,]*\s?[x×])\s*[\])]",
    re.IGNORECASE,
)
# Regular expression for a factor in the header of readings, outside the brackets with the unit.
_FACTOR_OF_HEADER = re.compile(_WORDS["factor_of_header"], re.IGNORECASE)
_IN_BRACKETS = re.compile(r"\[[^\]]*\]|\([^)]*(?:m|in|inch|mil|\")\)|\{[^}]*\}")
# Regular expression for a word that may be a unit, with the number before it if there is one. Words
# beside a slash, such as mm/min, do not match.
_MENTIONED = re.compile(
    r"(?<![\w.,/])(?P<number>\d[\d.,]*\s?)?(?P<unit>[^\W\d_]+)(?![\w/])", re.IGNORECASE
)
# Regular expression for a number at the end of a text, as in "1/10".
_NUMBER_AT_END = re.compile(r"\d\s?$")
# Regular expression for a factor after a unit, as in "µm/10". In a list of units, the factor must
# be followed by the end of the list or by a separator.
_FACTOR_BEHIND = re.compile(r"[^\W\d]\s?[/x×*·]\s?\d[\d.,]*\s*(?:$|[;,|)\]])")
# Regular expression for a label, such as "Units:", in front of the units of a line.
_LABEL_IN_FRONT = re.compile(rf"\W*(?:{_WORDS['label']})(?!\w)\s*[-–]?\s*", re.IGNORECASE)
# Regular expression for a factor in front of a unit, such as "x 10" in "x 10 µm".
_FACTOR = re.compile(r"[x×*]\s*\d|\d")
# Regular expression for a power of ten in front of a unit, such as 1e-3, E-3, 10^-3 or 10-3.
_POWER_OF_TEN = re.compile(
    r"(?<![^\W_])\d*[.,]?\d*e[+\-−–]?\d+\s?[^\W\d]"
    r"|(?<!\d)10\s?\^?\s?[(]?[\-−–⁻]\s?[1-9¹²³⁴⁵⁶⁷⁸⁹][)]?\s?[^\W\d]",
    re.IGNORECASE,
)
_UNREAD_FACTOR = re.compile(r"(?<!\d)(?<!\d )[x×*]\s*\d\S*\s*[^\W\d_]+", re.IGNORECASE)
_LABEL_WORD = re.compile(r"[^\W\d_]+")
_UNIT_WORD = re.compile(_WORDS["label"], re.IGNORECASE)
_FILLING = re.compile(_WORDS["filling"], re.IGNORECASE)
_OTHER = re.compile(rf"\b(?:{_WORDS['other']})\b", re.IGNORECASE)
# Regular expression for a word for one count (digital step) of an instrument, such as "digit".
COUNT = re.compile(_WORDS["count"], re.IGNORECASE)
# Regular expression for the header of a column that holds the unit of each row.
UNIT_COLUMN = re.compile(_WORDS["column"], re.IGNORECASE)
# Regular expressions for the header of a column of units that also names the column of numbers to
# which the units belong, as in "theta_unit" or "Winkeleinheit".
_PARTNERS = (
    re.compile(rf"(?P<partner>.*[^\W\d])[\W_]+(?:{_WORDS['label']})\W*", re.IGNORECASE),
    re.compile(
        rf"\W*(?:{_WORDS['label']})[\W_]+(?:(?:{_WORDS['filling']})\s)*(?P<partner>.*\w)\W*",
        re.IGNORECASE,
    ),
    re.compile(r"(?P<partner>[^\W\d_]{3,}?)s?einheit(?:en)?", re.IGNORECASE),
)
# Regular expressions for the size of one count (digital step of the instrument), as in "0.1 µm per
# count" or "1 count = 0.1 µm".
_SIZE = rf"(?P<size>{NUMBER_IN_TEXT}[\s;|]*[^\W\d]+)"
_SCALES = (
    re.compile(rf"{_SIZE}\s*(?:{_WORDS['per']})\s*(?:{_WORDS['count']})(?!\w)", re.IGNORECASE),
    re.compile(
        rf"(?<!\w)(?:1\s*)?(?:{_WORDS['count']})\s*(?:{_WORDS['equals']})?\s*{_SIZE}", re.IGNORECASE
    ),
)
# Regular expression for the number of counts in a turn, as in "36000 counts per revolution".
_COUNTS_OF_TURN = re.compile(
    rf"(?<![\w.,])(?P<number>\d+)\s*(?:{_WORDS['count']})\s*(?:{_WORDS['per']})\s*"
    r"(?P<turn>[^\W\d_]+)",
    re.IGNORECASE,
)
# Regular expressions for the time between samples, as in "Sampling period: 100 ms", and for the
# number of samples in a second, as in "Sampling rate: 10 Hz".
_SAMPLE_PERIOD = re.compile(
    rf"(?<!\w){_WORDS['sample_period']}\s*[:=;,|\t]?\s*(?P<size>{NUMBER_IN_TEXT}\s*[^\W\d_]+)",
    re.IGNORECASE,
)
_SAMPLE_RATE = re.compile(
    rf"(?<!\w){_WORDS['sample_rate']}\s*[:=;,|\t]?\s*(?P<number>{NUMBER_IN_TEXT})"
    r"\s*(?P<kilo>k?)Hz(?!\w)",
    re.IGNORECASE,
)
# Number of degrees in a turn.
_TURN_DEG = 360.0
_SCALE = re.compile(rf"(?<!\w)(?:{_WORDS['scale']})(?!\w)", re.IGNORECASE)
# Units that are also ordinary words, such as "in". In a text with another unit of the same
# quantity, such a word is not taken as a unit.
_ALSO_WORDS = ("in",)


class _ListedUnit(NamedTuple):
    """Unit in a list such as ``deg / 0.1 µm``."""

    name: str  # unit without its factor, in the spelling of this package, such as "um"
    # unit with its factor, such as "0.1 um"; if it has no factor, the unit alone
    with_factor: str
    is_also_word: bool  # whether the unit is also an ordinary word, such as "in"


def units_stated(text: str) -> dict[str, str]:
    """Return a dict with the units that a line states.

    The keys are ``reading_unit``, ``angle_unit`` and so on. The value for the key ``reading_scale``
    is the size of one count (digital step) of the instrument, such as ``0.1 um``, and the value for
    ``angle_scale`` the size of one count of an encoder, such as ``0.01 deg``. The value for
    ``time_scale`` is the time from one sample to the next, such as ``100 ms``. An unknown unit is
    returned as written, and several units for one quantity (angle, reading, …) are returned as one
    text. In both cases, later code raises an error if the table itself does not state the unit.
    """
    text = joined_prefixes(text[:LONGEST_TEXT])
    stated = _sizes_of_counts(text)
    stated |= units_in_sentences(text)
    units_of_line = _units_of_whole_line(text)
    if units_of_line:
        return stated | units_of_line
    match = _LINE.search(text)
    if match is None or _OTHER.search(match["label"]):
        return stated
    role = _role_of_label(match["label"])
    if role is None:
        return stated
    text = _unit_before_remarks(match["units"].strip())
    if _has_unread_factor(text) and not _lists_units(text):
        return stated | {f"{role or 'reading'}_unit": text}
    # the text is a unit with a factor, such as 10 nm
    if scaled_unit(text) and not unit_named(text):
        return stated | _scaled_units(scaled_unit(text), role)
    return stated | _units_of_roles(text, role)


def _sizes_of_counts(text: str) -> dict[str, str]:
    """Return a dict with the sizes of counts that a line states, such as ``1 count = 0.1 µm``.

    The keys are ``reading_scale`` for one count of the instrument, ``angle_scale`` for one count of
    an encoder, and ``time_scale`` for the time from one sample to the next.
    """
    sizes = {
        "reading_scale": _size_of_count(text),
        "angle_scale": _size_of_angular_count(text),
        "time_scale": _period_of_samples(text),
    }
    return {key: size for key, size in sizes.items() if size}


def _unit_before_remarks(text: str) -> str:
    """Return a unit without the remarks that follow it, as in ``0.001 deg; from +X; positive=CCW``.

    The remarks are removed only if the unit has a factor, such as 0.001, and if the remarks name no
    other unit. Any other text is returned unchanged.
    """
    first, *remarks = _BETWEEN_REMARKS.split(text)
    unit = scaled_unit(first.strip())
    if not unit or unit_named(first) or _units_in(" ; ".join(remarks)):
        return text
    return first.strip()


def _units_of_whole_line(text: str) -> dict[str, str]:
    """Return a dict with the units of a line that states nothing but units.

    Such a line is a list of quantities with their units, a list of units, one unit alone, or a
    label and a unit. The keys are ``reading_unit``, ``angle_unit`` and so on. The dict is empty for
    any other line.
    """
    units_of_pairs = _units_of_pairs(text) or _units_without_blanks(text)
    if units_of_pairs:
        return units_of_pairs
    units_of_list = _units_of_list(_LABEL_IN_FRONT.sub("", text, count=1))
    if units_of_list:
        return units_of_list
    unit_alone = _unit_alone(text)
    if unit_alone:
        return {"reading_unit": unit_alone}
    return _units_of_bare_line(text)


def _units_of_pairs(text: str) -> dict[str, str]:
    """Return a dict with the units of a line such as ``Angle: deg; Reading: 10 nm``.

    The line must consist of at least two pairs of a quantity and its unit. The keys are
    ``angle_unit``, ``reading_unit`` and so on. The dict is empty for any other line, for example if
    one of the pairs states a value, as in ``Angle: deg; Deviation: 5 µm``.
    """
    units: dict[str, str] = {}
    pairs = _BETWEEN_PAIRS.split(text.strip(" ;,|\t"))
    for pair in pairs:
        match = _PAIR.fullmatch(pair)
        if match is None or _OTHER.search(match["label"]):
            return {}
        role = _role_of_label(match["label"])
        if not role:
            return {}
        unit = _unit_of_pair(role, match["label"], match["unit"].strip())
        if not unit:
            return {}
        units[f"{role}_unit"] = unit
    if len(units) < 2 or len(units) < len(pairs):
        return {}
    return units


def _units_without_blanks(text: str) -> dict[str, str]:
    """Return a dict with the units in a line of an East Asian language, such as 力单位0.1N.

    The keys are ``reading_unit``, ``angle_unit`` and so on. The dict is empty if the line names no
    quantity with its unit in this way.
    """
    units = {}
    for match in _WITHOUT_BLANKS.finditer(text):
        role = _role_of_label(match["label"])
        unit = scaled_unit(match["unit"])
        if role and unit and unit.split()[-1] in UNITS[role]:
            units[f"{role}_unit"] = unit
    return units


def _unit_of_pair(role: str, label: str, text: str) -> str:
    """Return the unit that ``text`` states for the quantity ``role``, such as angle.

    In a line such as ``Winkel: Grad``, ``label`` is the word before the colon, and ``text`` is what
    follows it. The result is empty if the text is not a unit of the quantity, or if it begins with
    a number that cannot be the factor of the unit, such as 5 µm. A unit of readings or angles may
    have the factor 0.1, 0.01 and so on, or a fraction such as 1/10 or 1/3. A unit of readings may
    also have the factor 1, 10 or 100. Other units have no factor. After a label with ``Winkel``
    (German for angle), the word Grad is taken as deg, whatever ``role`` is.
    """
    if comparable(text) == "grad" and "winkel" in comparable(label):
        return "deg"  # in German, Grad means degree
    unit = scaled_unit(text)
    if not unit or unit.split()[-1] not in UNITS[role]:
        return ""
    has_number = re.match(r"\W*\d", text) is not None
    if has_number and not _may_be_factor(role, text):
        return ""
    return unit


def _may_be_factor(role: str, text: str) -> bool:
    """Return whether the number at the start of a text, such as ``0.1 um``, may be a unit's factor.

    ``role`` is the quantity that has the unit, such as reading or angle. A unit of readings or
    angles may have the factor 0.1, 0.01 and so on, or a fraction such as 1/10 or 1/3. A unit of
    readings may also have the factor 1, 10 or 100.
    """
    if _FACTOR_OF_TEN.match(text) is None:
        return False
    return role == "reading" or (role == "angle" and re.match(r"1\s?/|0[.,]", text) is not None)


def _units_of_list(text: str) -> dict[str, str]:
    """Return a dict with the units of a line that is nothing but a list of units.

    Examples are ``deg/0.1 µm`` and ``[°], [mm]``. The keys are ``angle_unit``, ``reading_unit`` and
    so on. The list must contain a unit of readings. Two units with a slash between them may be a
    rate such as mm/min. They are taken as a list only if one is a unit of angles, or if the first
    is a unit of time. The dict is empty for any other line.
    """
    if not _lists_units(text):
        return {}
    units = _units_of_roles(text, "")
    is_rate = len(_UNIT.findall(text)) == 2 and re.search(r"[^\d\s]\s?/", text) is not None
    if is_rate and "angle_unit" not in units and not _begins_with_time(text):
        return {}
    if "reading_unit" not in units:
        return {}
    return units


def _lists_units(text: str) -> bool:
    """Return whether a text consists of at least two units and the marks between them.

    The German word Grad may stand for the unit of angles.
    """
    matches = list(_UNIT.finditer(text))
    if len(matches) < 2 or _BETWEEN_UNITS.fullmatch(_UNIT.sub("", text)) is None:
        return False
    for match in matches:
        word = match["unit"].strip(".")
        if not unit_named(word) and comparable(word) != "grad":
            return False
    return re.search(r"[;,|/\])\t]", text) is not None


def _begins_with_time(text: str) -> bool:
    """Return whether the first unit in a list is a unit of time."""
    match = _UNIT.search(text)
    return match is not None and unit_named(match["unit"]) in UNITS["time"]


def _units_of_bare_line(text: str) -> dict[str, str]:
    """Return a dict with the units of a line that is nothing but a label and a known unit.

    The keys are ``reading_unit``, ``angle_unit`` and so on. The dict is empty for any other line.
    """
    match = _BARE_LINE.fullmatch(text)
    if match is None:
        return {}
    unit = match["unit"]
    if unit_named(unit):
        return _units_of_roles(unit, "")
    if scaled_unit(unit):
        return _scaled_units(scaled_unit(unit), "")
    return {}


def _unit_alone(text: str) -> str:
    """Return the unit of a line that only states the unit of readings, such as ``Readings [mm]``.

    Other examples are the lines ``mm`` and ``[mm]``. A unit with a factor that this package does
    not read, as in ``x 10 um``, and a unit that is not a unit of length, such as V, are returned as
    written. The result is empty for any other line.
    """
    if is_unit_with_unread_factor(text):
        return text.strip()
    match = _UNIT_ALONE.fullmatch(text)
    if match is None or comparable(text) in _ALSO_WORDS or _SIGN_IN.fullmatch(text):
        return ""
    if match["bracketed"] and _NO_LENGTH.fullmatch(match["bracketed"]):
        return str(match["bracketed"])
    unit = scaled_unit(match["bracketed"] or match["unit"])
    if unit.split(" ")[-1] not in UNITS["reading"]:
        return ""
    return unit


def _has_unread_factor(text: str) -> bool:
    """Return whether a unit has a factor that this package does not read.

    Examples are x 10 µm, µm/10, thousandths of a mm, and the second unit of ``deg; 1e-3 mm``.
    """
    if SHARE.search(text) or _FACTOR_BEHIND.search(text):
        return True
    if _POWER_OF_TEN.search(text) and not scaled_unit(text):
        return True
    return _FACTOR.match(text) is not None and not scaled_unit(text)


def _scaled_units(unit: str, role: str) -> dict[str, str]:
    """Return a dict with a unit that has a factor: ``{"reading_unit": "10 nm"}`` for 10 nm.

    If ``role``, such as angle, is not empty, only a unit of this quantity is returned.
    """
    name = unit.split()[-1]
    roles = [role] if role else list(UNITS)
    return {f"{unit_role}_unit": unit for unit_role in roles if name in UNITS[unit_role]}


def _size_of_count(text: str) -> str:
    """Return the size of one count (digital step) that a line states, such as ``0.1 um``.

    The result is an empty string if the line states no such size.
    """
    for pattern in _SCALES:
        match = pattern.search(text)
        if match is not None:
            return scaled_unit(re.sub(r"[;|]", " ", match["size"]))
    return ""


def _period_of_samples(text: str) -> str:
    """Return the sampling period that a line states, such as ``100 ms``.

    The sampling period is the time from one sample to the next. It may also follow from the number
    of samples in a second. The result is an empty string if the line states neither.
    """
    period = _SAMPLE_PERIOD.search(text)
    if period is not None:
        unit = scaled_unit(period["size"])
        return unit if size_of_unit("time", unit) is not None else ""
    rate = _SAMPLE_RATE.search(text)
    if rate is None:
        return ""
    hertz = number_in_text(rate["number"])
    if not hertz:
        return ""
    if rate["kilo"]:
        hertz *= 1e3
    return f"{1.0 / hertz:.12g} s"


def _size_of_angular_count(text: str) -> str:
    """Return the size of one count of an encoder, such as ``0.01 deg``, from the counts in a turn.

    The result is an empty string if the line does not state the number of counts in a turn.
    """
    match = _COUNTS_OF_TURN.search(text)
    if match is None or unit_named(match["turn"]) != "turn" or int(match["number"]) == 0:
        return ""
    return f"{_TURN_DEG / int(match['number']):.12g} deg"


def _role_of_label(label: str) -> str | None:
    """Return the quantity to which the label of a unit refers: force for ``Force unit``.

    The result is an empty string for a label such as ``Units``, which refers to all columns. The
    result is None if the words of the label do not all name one quantity.
    """
    words = []
    for word in _LABEL_WORD.findall(comparable(label)):
        if not (_UNIT_WORD.fullmatch(word) or _FILLING.fullmatch(word)):
            words.append(word)
    if not words:
        return ""
    for role in UNITS:
        if all(word.startswith(tuple(ROLES[role])) for word in words):
            return role
    return None


def _units_of_roles(text: str, role: str) -> dict[str, str]:
    """Return a dict with the units in a text: ``{"angle_unit": "deg"}`` for ``deg``.

    If ``role`` is not empty, only units of this quantity, such as angle, are returned. Several
    units of one quantity are joined by "and". If the text has no known unit, the dict holds the
    whole text as the unit of ``role``, or as the unit of readings if ``role`` is empty.
    """
    roles = [role] if role else list(UNITS)
    names: dict[str, list[str]] = {}
    for unit in _units_in(_REVISION.sub(" ", text)):
        for unit_role in roles:
            if unit.name not in UNITS[unit_role]:
                continue
            names_of_role = names.setdefault(unit_role, [])
            is_word = unit.is_also_word and names_of_role
            if unit.with_factor not in names_of_role and not is_word:
                names_of_role.append(unit.with_factor)
    if not names:
        return {f"{role or 'reading'}_unit": text}
    return {f"{unit_role}_unit": " and ".join(units) for unit_role, units in names.items()}


def _units_in(text: str) -> list[_ListedUnit]:
    """Return the known units in a text, in the order in which the text names them.

    A number before a unit is taken as its factor, except in two cases: if the text also has the
    unit without a number, as in "um (range 1000 um)", or if the number is large and stands before a
    unit of angle, as in 360 deg.
    """
    matches = [match for match in _UNIT.finditer(text) if unit_named(match["unit"].strip("."))]
    plain = {unit_named(match["unit"].strip(".")) for match in matches if not match["factor"]}
    units = []
    for match in matches:
        word = match["unit"].strip(".")
        name = unit_named(word)
        with_factor = name
        if match["factor"] and name not in plain:
            with_factor = (
                scaled_unit(re.sub(r"1\s?/\s?", "1/", match["factor"]) + " " + word) or name
            )
            size = size_of_unit("angle", with_factor) or 0.0
            if name in UNITS["angle"] and size > _LARGEST_ANGLE_FACTOR * UNITS["angle"][name]:
                with_factor = name
        units.append(_ListedUnit(name, with_factor, comparable(word) in _ALSO_WORDS))
    return units


def partner_of_units(header: str) -> str:
    """Return the name of the column to which a column of units belongs.

    ``header`` is the header of the column of units. For the header ``theta_unit``, the result is
    ``theta``. The result is empty if the header names no other column.
    """
    text = comparable(header[:LONGEST_NAME])
    for pattern in _PARTNERS:
        match = pattern.fullmatch(text)
        if match is not None and not unit_named(match["partner"]):
            return match["partner"].strip(" _")
    return ""


def is_unit_with_unread_factor(text: str) -> bool:
    """Return whether a text is a unit with a factor in a form that this package cannot read.

    An example is ``x 10 µm``.
    """
    return _UNREAD_FACTOR.fullmatch(text.strip()) is not None


def mentions_scale(text: str) -> bool:
    """Return whether a line mentions a scale or factor, but does not state the size of one count.

    A count is a digital step of the instrument.
    """
    text = text[:LONGEST_TEXT]
    return _SCALE.search(text) is not None and not _size_of_count(text)


def multiplies_readings(text: str) -> bool:
    """Return whether a line, such as ``Values x 10``, says that readings are multiplied."""
    return _MULTIPLIED.search(text[:LONGEST_TEXT]) is not None


def states_gain(text: str) -> bool:
    """Return whether a part of a line is nothing but a gain other than 1, such as ``Gain 10``."""
    text = text[:LONGEST_TEXT]
    parts = [text, *segments_of_line(text)]
    return any(_GAIN_ALONE.fullmatch(part) for part in parts)


def _words_outside_brackets(header: str) -> str:
    """Return the words of a header outside brackets, with blanks in place of underscores and dots.

    Decimal points are kept.
    """
    words = _IN_BRACKETS.sub(" ", header[:LONGEST_TEXT]).replace("_", " ")
    return re.sub(r"(?<!\d)\.|\.(?!\d)", " ", words)


def header_has_factor(header: str) -> bool:
    """Return whether a header says that its readings are multiplied or divided by a number.

    Examples are ``Reading x10 [um]`` and ``Reading [um] (x10)``.
    """
    is_in_brackets = _FACTOR_IN_BRACKETS.search(header[:LONGEST_TEXT]) is not None
    return is_in_brackets or _FACTOR_OF_HEADER.search(_words_outside_brackets(header)) is not None


def unit_mentioned(text: str) -> str:
    """Return the unit of readings that a text mentions, such as mm in ``Columns: deg, mm``.

    The first unit of readings without a number before it is returned. The result is empty if the
    text mentions no such unit. Some texts write the factor of a unit in a form that this package
    cannot read, as in ``Unit - x 10 um``. The result is then this unit with its factor.
    """
    words = re.sub(r"[_\-]", " ", text[:LONGEST_TEXT])
    if _OTHER.search(words):
        return ""
    with_factor = _UNREAD_FACTOR.search(words)
    if with_factor is not None and unit_named(with_factor[0].split()[-1]) in UNITS["reading"]:
        return with_factor[0]
    shares = shares_mentioned(words)
    if shares and not _PROPERTY.search(words):
        return shares
    for match in _MENTIONED.finditer(words):
        unit = unit_named(match["unit"])
        may_be_word = comparable(match["unit"]) in _ALSO_WORDS or len(match["unit"]) < 2
        has_number = match["number"] is not None or _NUMBER_AT_END.search(words[: match.start()])
        if unit in UNITS["reading"] and not has_number and not may_be_word:
            return unit
    return ""


def inch_alone(line: str) -> str:
    """Return "inch" if a line is nothing but ``in``, which may be this unit or the word "in".

    The result is empty for any other line.
    """
    return "inch" if comparable(line[:LONGEST_TEXT]) in _ALSO_WORDS else ""


def unknown_unit_in(line: str) -> str:
    """Return the unknown unit in a line such as ``Units (V)``, which is a label and a unit.

    The result is empty for any other line.
    """
    match = _BARE_LINE.fullmatch(line[:LONGEST_TEXT])
    if match is None or not match["unit"].isalpha() or unit_named(match["unit"]):
        return ""
    return match["unit"]
