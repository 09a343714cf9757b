"""Units that tables are written in, by the words and signs people use for them, and what one of each is in ours."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping

__all__ = ["ANGLE_UNITS", "FORCE_UNITS", "LENGTH_UNITS", "PRESSURE_UNITS", "TIME_UNITS", "UNITS", "in_ours", "unit_named"]

LENGTH_UNITS = {"um": 1.0, "mm": 1e3, "nm": 1e-3, "m": 1e6, "cm": 1e4, "inch": 25_400.0, "mil": 25.4, "uinch": 0.0254}
ANGLE_UNITS = {"deg": 1.0, "rad": 57.29577951308232, "gon": 0.9, "mrad": 0.05729577951308232, "arcmin": 1.0 / 60.0}
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0, "d": 86_400.0}
FORCE_UNITS = {"N": 1.0, "kN": 1e3, "daN": 10.0, "lbf": 4.4482216152605, "kgf": 9.80665}
PRESSURE_UNITS = {"bar": 1.0, "mbar": 1e-3, "MPa": 10.0, "kPa": 0.01, "Pa": 1e-5, "psi": 0.0689475729317831}
# By role; the first is meant where none is named.
UNITS: Mapping[str, Mapping[str, float]] = {
    "angle": ANGLE_UNITS,
    "reading": LENGTH_UNITS,
    "time": TIME_UNITS,
    "force": FORCE_UNITS,
    "pressure": PRESSURE_UNITS,
}
_WORDS: Mapping[str, tuple[str, ...]] = {
    "um": ("um", "µm", "μm", "micron", "microns", "micrometer", "micrometers", "micrometre", "micrometres", "mikrometer"),
    "mm": ("mm", "millimeter", "millimeters", "millimetre", "millimetres"),
    "nm": ("nm", "nanometer", "nanometers", "nanometre", "nanometres"),
    "cm": ("cm",),
    "m": ("m",),
    "inch": ("in", "inch", "inches", '"'),
    "mil": ("mil", "mils", "thou"),
    "uinch": ("uin", "µin", "μin", "uinch", "µinch", "μinch", "microinch", "microinches"),
    "deg": ("deg", "degs", "°", "degree", "degrees"),
    "rad": ("rad", "radian", "radians"),
    "mrad": ("mrad",),
    "arcmin": ("arcmin", "'"),
    "gon": ("gon", "grads", "gradian", "gradians"),
    "s": ("s", "sec", "secs", "second", "seconds", "sekunden"),
    "ms": ("ms", "msec"),
    "us": ("us", "µs", "μs"),
    "min": ("min", "minutes"),
    "h": ("h", "hour", "hours"),
    "d": ("d", "day", "days"),
    "N": ("n", "newton", "newtons"),
    "kN": ("kn", "kilonewton"),
    "daN": ("dan",),
    "lbf": ("lbf", "lb", "lbs"),
    "kgf": ("kgf", "kp"),
    "bar": ("bar", "bars", "barg"),
    "mbar": ("mbar", "hpa", "millibar"),
    "MPa": ("mpa",),
    "kPa": ("kpa",),
    "Pa": ("pa",),
    "psi": ("psi", "psig"),
}
_FACTOR = re.compile(r"(\d{1,6}(?:[.,]\d{1,6})?)(?:\s*/\s*(\d{1,6}))?\s*(\D.*)")


def plain(text: str) -> str:
    """For comparing: one sign for micro, no capitals, no blanks or dots around it."""
    return unicodedata.normalize("NFKC", text).casefold().strip(" .:")


_BY_WORD = {plain(word): unit for unit, words in _WORDS.items() for word in words}


def unit_named(text: str) -> str:
    """Our name of a unit, with the factor that stands before it (``1/1000 mm``); empty where the text is none."""
    if len(text) > 40:
        return ""
    unit = _BY_WORD.get(plain(text), "")
    if unit:
        return unit
    match = _FACTOR.fullmatch(text.strip())
    if match and re.fullmatch(r"[1-9]\d{0,2}[.,]\d{3}", match[1]):
        return ""
    unit = _BY_WORD.get(plain(match[3]), "") if match else ""
    return f"{match[1].replace(',', '.')}{'/' + match[2] if match[2] else ''} {unit}" if match and unit else ""


def in_ours(role: str, unit: str) -> float | None:
    """One of a unit (as `unit_named` gives it) in ours; None where it is not one for that role."""
    factor, _, name = unit.rpartition(" ")
    one = UNITS[role].get(name)
    if one is None or not re.fullmatch(r"(?:\d+(?:\.\d+)?(?:/[1-9]\d*)?)?", factor):
        return None
    above, _, below = factor.partition("/")
    return one * (float(above) if above else 1.0) / (float(below) if below else 1.0)
