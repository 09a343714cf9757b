"""What the lines above a table and the names of files say of a test: force, pressure, radius, feed, start and overshoot."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

from ldbb_bayes.tables.numerals import could_be_thousands
from ldbb_bayes.tables.units import ANGLE_UNITS, FORCE_UNITS, LENGTH_UNITS, PRESSURE_UNITS, unit_named

__all__ = [
    "Said",
    "direction_not_understood",
    "directions_said",
    "load_in_name",
    "loads_not_understood",
    "said_above",
    "without_load",
]

_LONGEST = 300
_NUMBER = r"[+\-−]?(?:\d+(?:[.,]\d+)?|[.,]\d+)(?:[eE][+\-]?\d{1,3})?"
_BETWEEN = r"[\s:=;,|]"
# A number, not the beginning of a clock, a date or a longer number.
_WHOLE = r"(?![\d:/]|[.,]\d|[\-−]\d|\s\d{3}(?!\d))"
_MM_PER_MIN = {"mm/min": 1.0, "m/min": 1e3, "inch/min": 25.4, "in/min": 25.4, "ipm": 25.4, "mm/s": 60.0, "mm/sec": 60.0}
_MM = {unit: 1e-3 * one for unit, one in LENGTH_UNITS.items()}
# By word: the unit meant where none is named, and all units with what one is in ours.
_SAID: Mapping[str, tuple[str, str, Mapping[str, float]]] = {
    "force_N": (
        r"(?:radial )?(?:force|(?:prüf|mess|radial|soll|ist|zug)?kraft|last|load|force_N)(?: F| setpoint| nominal)?",
        "N",
        FORCE_UNITS,
    ),
    "pressure_bar": (r"(?:pressure|(?:prüf|mess|regel|zylinder|soll|ist)?druck|pressure_bar)(?: P)?", "bar", PRESSURE_UNITS),
    "radius_mm": (r"(?:radius|nominal length)(?: R)?", "mm", _MM),
    "feed_mm_per_min": (r"(?:feed|feedrate|feed rate|vorschub)", "mm/min", _MM_PER_MIN),
    "start_deg": (r"(?:start(?:ing)? angle|start|startwinkel)(?: at)?", "deg", ANGLE_UNITS),
    "overshoot_deg": (r"(?:angular overshoot|overshoot|run-in|überlauf)(?: angle)?", "deg", ANGLE_UNITS),
}
_ANOTHER = re.compile(
    r"\b(?:max|maximum|min|minimum|limit|ambient|supply|preload|range|rated|case|no|nr|number|clamping|spring|gravity|cutting|"
    r"air|atmospheric|barometric|system|hydraulic|oil|ball|tool|corner|nose)\b",
    re.IGNORECASE,
)
_IN_NAME = re.compile(rf"(?<![\d.,A-Za-z])({_NUMBER})[ _]?(kN|N|newton|bar|mbar|MPa|kPa|psi)(?![a-zA-Z])", re.IGNORECASE)
# A decimal mark that a file name cannot hold (3_5bar), marks between thousands (1 238 N).
_CUT = re.compile(
    r"\d[_p\-]\d+[ _]?(?:[a-z]*bar|kN|MPa|kPa|psi)|(?<!\d)0[_p\-]\d+[ _]?N(?![a-z])|\d[_p\-]\d[ _]?N(?![a-z])"
    r"|\d[ ']\d{3}[ _]?k?N(?![a-z])",
    re.IGNORECASE,
)
# Three digits at most: F2000 is a feed.
_AS_F = re.compile(r"(?<![a-zA-Z0-9])[fF](\d{2,3})(?![\d.,])")
# Up to these a number with a mark before three digits may be of thousands.
_LARGEST = {"force_N": 5000.0, "radius_mm": 2000.0, "feed_mm_per_min": 100_000.0}


_COUNTER = ("ccw", "counter", "anti", "contra", "gegen", "entgegen")
_CLOCK_HAND = r"(?:ent)?gegen(?:[ _-]de[nm])?[ _-]?uhrzeigersinn|(?:im[ _-])?uhrzeigersinn"
_SENSES = rf"({_CLOCK_HAND}|ccw|cw|(?:counter|anti|contra)[^a-z0-9]{{0,3}}clock[-_ ]?wise|clock[-_ ]?wise)(?![a-z])"
_DIRECTION = re.compile(r"\b(?:direction|dir|\w*richtung|sense)\b(.*)", re.IGNORECASE)
_SENSE = re.compile(rf"(?<![a-zA-Z]){_SENSES}", re.IGNORECASE)


@dataclass(frozen=True)
class Said:
    """One value of a line above the table, in the unit of its field's name.

    Attributes
    ----------
    value : float
        NaN where it is not clear which: 1,000.
    unit : str
        As the line names it; empty where it names none.
    """

    value: float
    unit: str
    line: int


def said_above(above: Sequence[tuple[int, str]]) -> dict[str, list[Said]]:
    """Everything the lines say, by field; what is in no known unit, or of another kind (maximum, ambient, …), is left alone."""
    found: dict[str, list[Said]] = {}
    for number, text in above:
        for key, (words, usual, units) in _SAID.items():
            for match in _pattern(words).finditer(text[:_LONGEST]):
                before = re.split(r"[;,|\t]", text[: match.start()])[-1]
                if _ANOTHER.search(before + match[0][: match.start("number") - match.start()]) or _ANOTHER.fullmatch(
                    match["after"]
                ):
                    continue
                after = "" if match["cell"] and _unit(match["after"], units) is None else match["after"]
                named = next((own for own in (match["inside"], match["brackets"], after) if own), "")
                unit = _unit(named, units) if named else usual
                if unit is not None:
                    value = math.nan if _may_be_thousands(key, match["number"]) else _value(match["number"]) * units[unit]
                    found.setdefault(key, []).append(Said(value, named, number))
    return found


def _may_be_thousands(key: str, number: str) -> bool:
    """Whether a mark before three digits may stand between thousands, by the sizes there are: ``1,000 N``, not ``150.000 mm``."""
    return could_be_thousands(number) and float(re.sub(r"[^\d]", "", number)) <= _LARGEST.get(key, 0.0)


@cache
def _pattern(words: str) -> re.Pattern[str]:
    """Words, a unit in brackets or after "in", the number, and what follows it."""
    unit = r"(?:in\s+(?P<inside>[^\s:=;,|]+)|[\[(](?P<brackets>[^\])]*)[\])])"
    number = rf"(?P<number>{_NUMBER}){_WHOLE}(?!')"
    return re.compile(
        rf"\b{words}\b{_BETWEEN}{{0,4}}(?:{unit}{_BETWEEN}{{0,4}})?{number}\s*(?P<cell>[;|,\t]?)\s*(?P<after>[^\s;,|()\[\]]*)",
        re.IGNORECASE,
    )


def _unit(named: str, units: Mapping[str, float]) -> str | None:
    """The key of a unit as the line names it, None where it is none of these."""
    wanted = {named.casefold(), unit_named(named).casefold()}
    return next((own for own in units if own.casefold() in wanted), None)


def directions_said(above: Sequence[tuple[int, str]], names: Sequence[str]) -> set[str]:
    """CW and CCW as the lines above say them after a word for direction, and as the first name holds them that holds any."""
    lines = [match[1] for _, text in above if (match := _DIRECTION.search(text[:_LONGEST]))]
    in_name = next((senses for name in names if (senses := _senses(name[:_LONGEST]))), set())
    return {sense for text in map(_last_said, lines) for sense in _senses(text)} | in_name


def direction_not_understood(above: Sequence[tuple[int, str]]) -> int | None:
    """The first line that speaks of a direction and says none we know; None where there is none."""
    said = ((number, match[1]) for number, text in above if (match := _DIRECTION.search(text[:_LONGEST])))
    return next((number for number, after in said if after.strip(" :;=,|\t") and not _senses(after)), None)


def _senses(text: str) -> set[str]:
    return {"CCW" if match[1].casefold().startswith(_COUNTER) else "CW" for match in _SENSE.finditer(text)}


def _last_said(text: str) -> str:
    """Of a line that lists both before it says one, what stands behind the last mark: ``(CW/CCW): CCW``."""
    return text if len(_senses(text)) < 2 else re.split(r"[:=;|\t]", text)[-1] if re.search(r"[:=;|\t]", text) else text


def loads_not_understood(above: Sequence[tuple[int, str]]) -> str:
    """Of lines that name a value in newtons or bar, the first; for the message when no load is found."""
    for number, text in above:
        if _IN_NAME.search(text[:_LONGEST]):
            return f" Line {number} reads {text[:60]!r}; it was not taken for either."
    return ""


def without_load(name: str) -> str:
    """A name without the loads in it."""
    return _IN_NAME.sub("", name[:_LONGEST])


def load_in_name(names: Sequence[str], kind: str = "") -> tuple[str, float, str] | None:
    """Field, value and the name that says it: ``238N``, ``2.5 bar``, ``f238``; None where none says one thing alone.

    Parameters
    ----------
    kind : {"force_N", "pressure_bar", ""}
        Whether of this alone.
    """
    units_of = {"force_N": FORCE_UNITS, "pressure_bar": PRESSURE_UNITS, "": FORCE_UNITS | PRESSURE_UNITS}[kind]
    for name in names:
        said = [own for own in _IN_NAME.findall(name[:_LONGEST]) if unit_named(own[1]) in units_of]
        if len(said) == 1:
            number, word = said[0]
            unit = unit_named(word)
            if _CUT.search(name) or (unit in FORCE_UNITS and _may_be_thousands("force_N", number)):
                continue
            key, units = ("force_N", FORCE_UNITS) if unit in FORCE_UNITS else ("pressure_bar", PRESSURE_UNITS)
            return key, abs(_value(number)) * units[unit], name
        short = _AS_F.findall(name[:_LONGEST])
        if not said and len(short) == 1:
            return "force_N", float(short[0]), name
    return None


def _value(text: str) -> float:
    return float(text.replace(",", ".").replace("−", "-"))
