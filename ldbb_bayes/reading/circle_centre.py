"""Reading of a circle's centre from a line such as ``centre X 300 Y -120 mm``.

A campaign states centres in machine coordinates, but a line may state a centre in the coordinates
of a programme or a workpiece. If a line is a comment in a programme or has words for such
coordinates, its centre is only shown in a note.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from ldbb_bayes.campaign.circular_test import CENTRE
from ldbb_bayes.reading.cited_lines import TEXT_SHOWN, quoted_line
from ldbb_bayes.reading.numerals import NUMBER_IN_TEXT, could_be_thousands, number_in_text
from ldbb_bayes.reading.recording import Recording
from ldbb_bayes.reading.words import LONGEST_TEXT, WORDS

__all__ = ["take_centres", "without_centre"]

# Regular expression for one coordinate, such as X300 or Y = -120 mm.
_COORDINATE = rf"[XYZ]\s?[:=]?\s?{NUMBER_IN_TEXT}"
# Regular expression for the unit that may follow a coordinate, such as mm in "X 300 mm".
_UNIT = r"(?:\s?(?:(?:mm|cm|m|in|inch|inches|[uµμ]m)(?!\w)|[\"″]))?"
# Regular expression for the characters that may separate two coordinates of the centre of a circle.
_BETWEEN = rf"{_UNIT}[\s,;|/]*"
# Regular expression for a word for the centre, followed by at least two of its coordinates. The
# letters of the axes may be missing if the numbers follow a colon, as in "Centre: 300, -120".
_CENTRE = re.compile(
    rf"(?<!\w)(?:{WORDS['circle']['centre']})(?!\w)(?:[^;|\t]*?(?<!\w){_COORDINATE}{_BETWEEN}"
    rf"{_COORDINATE}(?:{_BETWEEN}{_COORDINATE})?{_UNIT}|\s?[:=]\s?{NUMBER_IN_TEXT}{_UNIT}"
    rf"[\s,;|/]+{NUMBER_IN_TEXT}{_UNIT})",
    re.IGNORECASE,
)
_LETTER_AND_NUMBER = re.compile(rf"(?<!\w)([XYZ])\s?[:=]?\s?({NUMBER_IN_TEXT})", re.IGNORECASE)
# Regular expression for words which show that coordinates are not those of the machine, and for the
# beginning of a comment in a programme.
_OTHER_COORDINATES = re.compile(WORDS["circle"]["other_coordinates"], re.IGNORECASE)
# Regular expression for a unit other than mm after a coordinate.
_OTHER_UNIT = re.compile(r"\d\s?(?:[\"″]|(?:cm|m|in|inch|inches|[uµμ]m)(?!\w))", re.IGNORECASE)
_OPTION = "a [[test]] in --layout"


class _Centre(NamedTuple):
    """Centre of a circle, as stated in a line of a file."""

    # number of the line in which the centre is stated; for a line of another sheet, a text such as
    # "3 of notes.txt"
    line: int | str
    text: str  # words of the line that state the centre
    #: dict with the machine coordinates [mm] of the centre; the keys are names of fields, such as
    #: ``centre_x_mm``. The dict is empty if the line states the centre in other coordinates, in
    #: another unit, or without the letters of the axes
    coordinates: Mapping[str, float]


def take_centres(recordings: Iterable[Recording]) -> None:
    """Set the centre of each test if a line states it, and add a note to the log.

    A coordinate that the line does not state is set to zero. No centre is set if the lines state
    different centres, or if it is uncertain that the centre is in machine coordinates. A note then
    says so, and the centre is assumed to be the zero of the machine.
    """
    for recording in recordings:
        stated = recording.stated | recording.fields
        if "centre_mm" in recording.campaign or any(stated.get(key) is not None for key in CENTRE):
            continue
        lines = (*recording.lines_of_all_tests, *recording.heading.lines_above)
        centres = list(_centres_in(lines))
        if not centres:
            continue
        different = {tuple(sorted(centre.coordinates.items())) for centre in centres}
        coordinates = centres[0].coordinates
        if coordinates and len(different) == 1:
            recording.fields.update(dict.fromkeys(CENTRE, 0.0) | dict(coordinates))
            remark = "taken as machine coordinates"
            reason = quoted_line(centres[0].line, centres[0].text, remark)
            recording.note("centre", _coordinates_as_text(coordinates), reason, _OPTION)
            continue
        for centre in centres:
            remark = "perhaps not in machine coordinates"
            reason = quoted_line(centre.line, centre.text, remark)
            recording.note("centre", _coordinates_as_text({}), reason, _OPTION)


def without_centre(text: str) -> str:
    """Return the text of a line, with a blank in place of the coordinates of a centre.

    Without this step, these numbers could be taken for the radius of the circle.
    """
    return _CENTRE.sub(" ", text[:LONGEST_TEXT])


def _centres_in(lines: Iterable[tuple[int | str, str]]) -> Iterator[_Centre]:
    """Yield the centre of a circle from each line that states one.

    If the coordinates in the line cannot be used, an object without coordinates is yielded, so that
    a note can cite the line. Coordinates cannot be used if the line may be about a workpiece or a
    programme, if it states a unit other than mm, or if a coordinate is unclear.
    """
    for line, content in lines:
        text = content[:LONGEST_TEXT]
        match = _CENTRE.search(text)
        if match is None:
            continue
        coordinates = {}
        is_other = _OTHER_COORDINATES.search(text) or _OTHER_UNIT.search(match[0])
        if not is_other:
            coordinates = _coordinates_of(match[0])
        yield _Centre(line, match[0].strip()[:TEXT_SHOWN], coordinates)


def _coordinates_of(text: str) -> dict[str, float]:
    """Return a dict with the coordinates that a text states for the centre of a circle.

    The keys are ``centre_x_mm``, ``centre_y_mm`` and ``centre_z_mm``. The dict is empty if a
    coordinate is stated twice, or if its number can be read in two ways.
    """
    coordinates: dict[str, float] = {}
    for letter, digits in _LETTER_AND_NUMBER.findall(text):
        key = f"centre_{letter.lower()}_mm"
        value = number_in_text(digits)
        is_unclear = "," in digits and could_be_thousands(digits)
        if value is None or is_unclear or key in coordinates:
            return {}
        coordinates[key] = value
    return coordinates


def _coordinates_as_text(coordinates: Mapping[str, float]) -> str:
    """Return the coordinates of a centre as text; a coordinate that is not stated is zero.

    The keys of ``coordinates`` are names of fields, such as ``centre_x_mm``.
    """
    texts = []
    for letter, key in zip("XYZ", CENTRE, strict=True):
        texts.append(f"{letter} {coordinates.get(key, 0.0):g}")
    return f"{', '.join(texts)} mm"
