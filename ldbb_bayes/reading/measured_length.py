"""What readings are of: the radius of a circle, or its diameter, as headers and lines name it."""

from __future__ import annotations

import re

from ldbb_bayes.reading.words import LONGEST_TEXT, WORDS, comparable

__all__ = ["measured_length", "measured_length_stated"]

_WORDS = WORDS["diameters"]
# Pattern of a header or text that names a diameter.
_DIAMETER = re.compile(rf"(?<![a-zäöüéèáâ])(?:{_WORDS['header']})")
# Pattern of a diameter inside a longer word, such as Kreisdurchmesser.
_LONG_WORD = re.compile("durchmesser|diamet")
_RADIAL = re.compile(_WORDS["radial"])
# Pattern of a line that is about the readings.
_READINGS = re.compile(_WORDS["line"])


def measured_length(text: str) -> str:
    """Return "radius" or "diameter" as a text names it; empty if it names neither or both."""
    words = comparable(text[:LONGEST_TEXT])
    is_diameter = _DIAMETER.search(words) is not None or _LONG_WORD.search(words) is not None
    is_radial = _RADIAL.search(words) is not None
    if is_diameter == is_radial:
        return ""
    return "diameter" if is_diameter else "radius"


def measured_length_stated(text: str) -> dict[str, str]:
    """Return what a line such as ``Values: diameter deviation`` says of all readings.

    The result has the key ``measured``, with the value radius or diameter; it is empty for a line
    that is not about readings, or that states a number.
    """
    if _READINGS.search(comparable(text)) is None or re.search(r"\d", text):
        return {}
    length = measured_length(text)
    if not length:
        return {}
    return {"measured": length}
