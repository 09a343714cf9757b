"""Words for planes: XY, YZ and ZX, the words G17 to G19 of G-code, and swapped letters.

In a file, the two letters of a plane may be swapped, as in XZ. The angles in this file may then
begin at either axis of the plane.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from ldbb_bayes.errors import InputError
from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.reading.cited_lines import TEXT_SHOWN, CitedLine, quoted_line
from ldbb_bayes.reading.words import LONGEST_TEXT, WORDS

__all__ = [
    "PLANES_OF_G_CODE",
    "PLANE_OF_SWAPPED",
    "axes_in_two_lines",
    "check_plane",
    "plane_named",
    "plane_of_words",
    "take_plane_option",
    "unread_plane",
]

# The planes that the words G17, G18 and G19 of G-code select.
PLANES_OF_G_CODE = {"G17": "XY", "G18": "ZX", "G19": "YZ"}
# Usual names of planes; the keys are the names with the letters swapped.
PLANE_OF_SWAPPED = {"YX": "XY", "ZY": "YZ", "XZ": "ZX"}
# Regular expression for the two letters of a plane. A mark may stand between the letters, and a
# word for plane may follow them.
_TWO_AXES = re.compile(r"(?P<first>[XYZ])[-/ ,;+_]?(?P<second>[XYZ])(?:[- ]?(?:PLANE|EBENE))?")
# Regular expression for the signs and words that may stand between two axes, as in "Z and X".
_BETWEEN_AXES = re.compile(r"[-/,;+&|\s]+(?:(?:and|und|et|e|i|и)\s+)?", re.IGNORECASE)
# Regular expressions for lines that name the first or the second axis of the plane.
_FIRST_AXIS = re.compile(WORDS["planes"]["first_axis"], re.IGNORECASE)
_SECOND_AXIS = re.compile(WORDS["planes"]["second_axis"], re.IGNORECASE)
# Regular expression for the label "plane" in several languages, with the text after the label.
_LABELLED = re.compile(WORDS["planes"]["labelled"], re.IGNORECASE)


def plane_named(cell: str) -> str:
    """Return the plane that a cell names, such as ``ZX`` for ``G18``, ``zx`` or ``Z-X plane``.

    Any other cell is returned in capitals.
    """
    word = cell.strip().upper()
    letters = _TWO_AXES.fullmatch(word)
    if letters is not None:
        return letters["first"] + letters["second"]
    return PLANES_OF_G_CODE.get(word, word)


def plane_of_words(words: str) -> str:
    """Return the plane that the words of a line name, such as ``ZX`` for ``Z and X``."""
    return plane_named(_BETWEEN_AXES.sub("", words.strip()))


def axes_in_two_lines(lines: Sequence[tuple[int | str, str]]) -> tuple[int | str, str] | None:
    """Return the plane whose first and second axis are named in separate places.

    An example are the lines ``Horizontal axis: Z`` and ``Vertical axis: X``, which name the plane
    ZX. The result holds the number of the line that names the second axis, and the plane. It is
    None if an axis is not named, or if both are the same.

    Parameters
    ----------
    lines
        Line number and text of each line.
    """
    first = ""
    second = ""
    line_of_second: int | str = 0
    for line, content in lines:
        text = content[:LONGEST_TEXT]
        first_match = _FIRST_AXIS.search(text)
        second_match = _SECOND_AXIS.search(text)
        if first_match is not None:
            first = first_match["axis"].upper()
        if second_match is not None:
            second = second_match["axis"].upper()
            line_of_second = line
    if not first or not second or first == second:
        return None
    return line_of_second, first + second


def take_plane_option(campaign: dict[str, Any]) -> None:
    """Replace the plane in the fields of a campaign by its usual name, such as ``ZX`` for ``g18``.

    Parameters
    ----------
    campaign
        Fields of the campaign that the user has given as options.

    Raises
    ------
    InputError
        If the letters of the plane are swapped, as in XZ. The message says which options to give
        instead.
    """
    if not isinstance(campaign.get("plane"), str):
        return
    plane = plane_named(campaign["plane"])
    if plane in PLANE_OF_SWAPPED:
        raise _swapped_error("options", plane, "--plane")
    if plane in PLANES:
        campaign["plane"] = plane


def check_plane(place: str, plane: str, source: str, has_angles: bool) -> None:
    """Raise an `InputError` for a plane other than XY, YZ and ZX.

    Parameters
    ----------
    place
        Name of the table in the message.
    plane
        The plane, in the form that `plane_named` returns.
    source
        What states the plane, such as "line 3".
    has_angles
        Whether the table has a column of angles. If not, it has times.
    """
    if plane in PLANES:
        return
    usual = PLANE_OF_SWAPPED.get(plane)
    if usual is None:
        raise InputError(
            f"{place}: plane must be XY, YZ or ZX, got {plane} in {source}. Correct it, or give"
            " --plane."
        )
    if has_angles:
        raise _swapped_error(place, plane, source)
    raise InputError(
        f"{place}: plane must be XY, YZ or ZX, got {plane} in {source}. Give --plane {usual}, with"
        f" --start-deg and --direction as they are in {usual}: angles from +{usual[0]} towards"
        f" +{usual[1]}."
    )


def _swapped_error(place: str, plane: str, source: str) -> InputError:
    """Return the error for a plane whose letters are swapped, such as XZ.

    If a file calls its plane XZ, its angles may begin at X or at Z. The message therefore states
    two sets of options, one for each case. For example, angles from Z towards X are
    counter-clockwise in the plane ZX, and angles from X towards Z are clockwise in this plane.
    ``place`` is the name of the table, or "options"; ``source`` is what states the plane, such as
    "line 3".
    """
    usual = PLANE_OF_SWAPPED[plane]
    first = usual[0]
    second = usual[1]
    return InputError(
        f"{place}: plane must be XY, YZ or ZX, got {plane} in {source}. If its angles run from"
        f" +{first} towards +{second}, give --plane {usual}; if from +{second} towards +{first},"
        f" give --plane {usual} --angle-zero +{second} --angle-sense CW."
    )


def unread_plane(lines: Sequence[tuple[int | str, str]]) -> CitedLine | None:
    """Return a note on the first line that has a label such as "Plane:", but no known plane.

    The result is None if there is no such line. ``lines`` holds the line number and the text of
    each line.
    """
    for line, content in lines:
        match = _LABELLED.search(content[:LONGEST_TEXT])
        if match is not None:
            return quoted_line(line, match[0].strip(" ;|,"), "not understood", TEXT_SHOWN)
    return None
