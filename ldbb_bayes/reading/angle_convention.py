"""Convention of the angles in a file: the axis at which they are zero, and their positive sense.

The sense is clockwise or counter-clockwise. Axis and sense may be stated in the header of the
column of angles, in lines above the table, or in names of files. An example is the header
``Angle from Y clockwise``.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from typing import NamedTuple

from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.cited_lines import TEXT_SHOWN, CitedLine, cited_line, quoted_line
from ldbb_bayes.reading.line_parts import (
    divide_line,
    segments_of_line,
    sentences_of_line,
    statements_of_line,
)
from ldbb_bayes.reading.lines_above import statements_in
from ldbb_bayes.reading.names import name_as_words
from ldbb_bayes.reading.open_question import OpenQuestionError
from ldbb_bayes.reading.qualifications import (
    without_usual_view,
    words_of_another_zero,
    words_of_exception,
    words_of_view,
)
from ldbb_bayes.reading.recording import Recording
from ldbb_bayes.reading.travel_direction import senses_in
from ldbb_bayes.reading.unit_lines import unit_mentioned
from ldbb_bayes.reading.words import LONGEST_TEXT, WORDS

__all__ = [
    "AngleConvention",
    "angle_convention",
    "angle_of_axis",
    "header_of_quadrants",
    "header_of_rotary_axis",
    "header_of_rotation",
    "is_about_angles",
    "name_is_about_angles",
    "says_where_angles_begin",
    "states_angles",
    "states_zero",
]

_WORDS = WORDS["angle_convention"]
# The axes at which the angles of a file may begin.
_AXES_WITH_SIGN = ("+X", "+Y", "-X", "-Y")
# Regular expression for the axis at which angles begin, after words such as "from" or "zero at".
_ZERO = re.compile(
    rf"(?:{_WORDS['zero']})[^\w+\-−]*(?:(?:{_WORDS['filling']})[^\w+\-−]+)*"
    r"(?P<sign>[+\-−]?|negative[nr]?\s|neg\.?\s|minus\s)\s?(?P<axis>[XYZ])(?P<behind>[+\-−](?!\w))?"
    r"(?![^\W_])",
    re.IGNORECASE,
)
# Regular expression for the name of an axis that is followed by the angle zero, as in "+Y = 0°".
_ZERO_BEHIND = re.compile(_WORDS["zero_behind"], re.IGNORECASE)
# Regular expression for the name of an axis before a word for "from", as in "+Y軸から".
_ZERO_BEFORE_FROM = re.compile(_WORDS["zero_before_from"], re.IGNORECASE)
_ZEROS = (_ZERO, _ZERO_BEHIND, _ZERO_BEFORE_FROM)
# Regular expression for an axis after a word such as "towards".
_TOWARDS = re.compile(
    rf"(?:{_WORDS['towards']}) ?(?P<sign>[+\-−]?) ?(?P<axis>[XYZ])(?![^\W_])", re.IGNORECASE
)
# Regular expression for words which say that the sense of angles is reversed.
_REVERSED = re.compile(_WORDS["reversed"], re.IGNORECASE)
# Regular expression for a text which says that an axis is mirrored, as in "Y axis inverted".
_TURNED_AXIS = re.compile(_WORDS["turned_axis"], re.IGNORECASE)
# Regular expression for words for the mathematical sense of angles, which is counter-clockwise.
_MATHEMATICAL = re.compile(_WORDS["math"], re.IGNORECASE)
# Regular expression for negations, such as "not".
_DENIED = re.compile(WORDS["reading_sign"]["denied"], re.IGNORECASE)
# Regular expression for words, such as "step", which show that a line about angles does not state
# where angles begin or in which sense they run.
_HARMLESS = re.compile(_WORDS["harmless"], re.IGNORECASE)
# Regular expression for words, such as "compass", which show that angles are counted clockwise from
# north.
_COMPASS = re.compile(_WORDS["compass"], re.IGNORECASE)
# Regular expression for words, such as "begin", for the start of a circle.
_START = re.compile(_WORDS["start"], re.IGNORECASE)
# Regular expression for the name of an axis as a separate word, such as +X or x axis.
_AXIS = re.compile(
    r"(?<![\w/])[+\-−]?(?:[XYZ][+\-−]?|[xyz](?=[ -]?(?:axis|achse)))(?![\w/])"
    r"|(?<![A-Za-z0-9/])[+\-−]?[XYZ](?=[軸轴축])"
)
# Regular expression for an axis with the digit 0, as in "theta Y0 cw", which may say that angles
# begin at this axis.
_AXIS_ZERO = re.compile(r"(?<![\w/.])[+\-−]?[XYZ]0(?![\w.,/])", re.IGNORECASE)
# Regular expression for words for a direction that is not an axis, such as north.
_NO_AXIS = re.compile(_WORDS["no_axis"], re.IGNORECASE)
# Regular expression for a column header that means an angle with the opposite sign, such as
# "-angle".
_MINUS = re.compile(_WORDS["minus"], re.IGNORECASE)
# Regular expression for words in a header, such as "travelled", which mean that angles are counted
# in the direction of travel.
_TRAVELLED = re.compile(_WORDS["travelled"], re.IGNORECASE)
# Regular expression for words in a header, such as "path angle", which leave open whether angles
# are counted in the direction of travel.
_ROTATION = re.compile(_WORDS["rotation"], re.IGNORECASE)
# Regular expression for the name of a rotary axis of the machine, such as "C axis".
_ROTARY_AXIS = re.compile(_WORDS["rotary_axis"], re.IGNORECASE)
# Regular expression for the header of a column that says in which quadrant an angle lies.
_QUADRANT = re.compile(_WORDS["quadrant"], re.IGNORECASE)
# Regular expression for words that mean an angle.
_ANGLE = re.compile(_WORDS["angle"], re.IGNORECASE)
# Regular expression for words which show that an axis in the same text is not the axis at which
# angles begin.
_OTHER_AXIS = re.compile(_WORDS["other_axis"], re.IGNORECASE)
# Regular expression for words that state the angle zero and may be followed by an axis, as in "0° =
# +Y" or "zero at +Y".
_ZERO_DEGREES = re.compile(
    r"(?<![\d.,])0 ?(?:°|deg\w*) ?(?:=|is|at|on|along|bei|:)|\bzero at\b", re.I
)
# Regular expression for a word that announces where angles begin, and for the text after this word.
_ANNOUNCED = re.compile(rf"(?:{_WORDS['announced']})(?P<zero>[^;|\t]*)", re.IGNORECASE)
# Regular expression for words which show that a line is about angles.
_SUBJECT = re.compile(_WORDS["subject"], re.IGNORECASE)
# Regular expression for words which show that a line is not about the angles of the readings.
_OTHER_SUBJECT = re.compile(_WORDS["other"], re.IGNORECASE)
# Regular expression for words which show that a line says in which sense angles are counted. In a
# line without such words, a word such as "clockwise" may mean the direction of travel.
_SENSE = re.compile(_WORDS["sense"], re.IGNORECASE)
# Regular expression for words which show that a part of a line is about readings or an instrument.
_OF_READINGS = re.compile(_WORDS["of_readings"], re.IGNORECASE)
_RIGHT_ANGLE_DEG = 90.0
_HALF_TURN_DEG = 180.0


class AngleConvention(NamedTuple):
    """Conversion of an angle in a file to the angle that this package uses.

    The converted angle is ``sign * (angle - offset_deg)``.
    """

    sign: int  #: −1 if the file counts angles clockwise, else 1
    #: angle that the file gives when the bar is along the plane's first axis [deg]
    offset_deg: float


class _AngleStatement(NamedTuple):
    """What a text states about angles: where they begin, and in which direction they increase."""

    zero: str  # axis at which angles begin, such as +Y; empty if it is not stated
    sense: str  # sense in which angles are counted, CW or CCW; empty if it is not stated
    source: str | CitedLine  # place of the words about angles in the file, such as "line 3"


def angle_convention(recording: Recording, plane: str) -> AngleConvention:
    """Return the conversion from the angles in a test's file to the angles of this package.

    If the user states the sign or the offset of the angles, only these two values are used.
    Otherwise, the conversion follows from the axis at which angles begin and the sense in which
    they run. Axis and sense are those that the user states, or else those that words in the file
    state. If nothing is stated, angles are counted counter-clockwise from the plane's first axis.

    Parameters
    ----------
    recording
        Rows of the test in the file, and everything that the file or the user states about the
        test.
    plane
        Plane of the test, such as XY.

    Raises
    ------
    InputError
        If an axis lies outside the plane, or if words contradict each other. The error is also
        raised if nothing states the sense, and angles do not begin at the plane's first axis.
    """
    _check_turned_axes(recording, plane)
    words = _statements_about_angles(recording)
    layout = recording.layout
    if layout.angle_sign is not None or layout.angle_offset_deg is not None:
        convention = AngleConvention(layout.angle_sign or 1, layout.angle_offset_deg or 0.0)
        _note_words(recording, words, convention)
        return convention
    zero = layout.angle_zero or _agreed_statement(
        recording, "zero", [entry.zero for entry in words]
    )
    sense = layout.angle_sense or _agreed_statement(
        recording, "sense", [entry.sense for entry in words]
    )
    _note_unread(recording, plane, zero, sense)
    if not sense and _sense_of_travelled_angle(recording):
        return _convention_along_travel(recording, plane, words, zero)
    return _convention_in_words(recording, plane, words, zero, sense)


def header_of_rotation(recording: Recording) -> str:
    """Return the header of the angles if it leaves open whether they are counted along the travel.

    Such a header is ``Path angle [deg]``. The result is empty for any other header, and if the
    layout states in which sense angles are counted.
    """
    layout = recording.layout
    if layout.angle_sense is not None or layout.angle_sign is not None:
        return ""
    header = _header_of_angles(recording)
    return header if _ROTATION.search(name_as_words(header)) else ""


def header_of_rotary_axis(recording: Recording) -> str:
    """Return the header of the angles if it names a rotary axis, such as ``C axis [deg]``.

    The result is empty for any other header, and if the layout states in which sense angles are
    counted.
    """
    layout = recording.layout
    if layout.angle_sense is not None or layout.angle_sign is not None:
        return ""
    header = _header_of_angles(recording)
    return header if _ROTARY_AXIS.search(header) else ""


def header_of_quadrants(recording: Recording) -> str:
    """Return the header of a column, beside the angles, that says in which quadrant they lie.

    The result is empty if there is no such column.
    """
    heading = recording.heading
    for column, header in enumerate(heading.headers):
        if column != heading.roles.get("angle") and _QUADRANT.search(header):
            return header
    return ""


def _sense_of_travelled_angle(recording: Recording) -> str:
    """Return the direction of travel if the header says that angles are counted along the travel.

    Such a header is ``Travelled angle [deg]``. The result is CW or CCW; it is empty for any other
    header, and if nothing states the direction of travel.
    """
    header = _header_of_angles(recording)
    if not _TRAVELLED.search(name_as_words(header)):
        return ""
    return recording.fields.get("direction") or ""


def _convention_along_travel(
    recording: Recording, plane: str, words: list[_AngleStatement], zero: str
) -> AngleConvention:
    """Return the convention of angles that are counted in the direction of travel.

    ``zero`` is the axis at which angles begin; if it is empty, it is the plane's first axis. A note
    is added for the header of the angles, and for each of the statements about angles in ``words``.
    The sense is not stored in the layout, because other tests may run in the other direction.
    """
    sense = _sense_of_travelled_angle(recording)
    sign = -1 if sense == "CW" else 1
    if not zero:
        start_deg = _start_of_travel(recording)
        if start_deg is not None:
            header = f"the header {_header_of_angles(recording)!r}"
            recording.note("angle", f"from {start_deg:g}°, {sense}", header, "--angle-zero")
            return AngleConvention(sign, -sign * start_deg)
    zero = zero or f"+{plane[0]}"
    sources = [f"the header {_header_of_angles(recording)!r}", *(entry.source for entry in words)]
    for source in sources:
        recording.note("angle", f"from {zero}, {sense}", source, "--angle-zero, --angle-sense")
    return AngleConvention(sign, -sign * angle_of_axis(recording, zero, plane))


def _start_of_travel(recording: Recording) -> float | None:
    """Return the stated angle at which the circle starts [deg]; None if nothing states a start.

    Raise an `OpenQuestionError` if lines state several angles, or the start by an axis.
    """
    starts = {statement.value for statement in recording.statements.get("start_deg", ())}
    for line, content in recording.lines_outside:
        text = content[:LONGEST_TEXT]
        if len(starts) > 1 or (_START.search(text) and _AXIS.search(text)):
            raise _unknown_start(recording, cited_line(line), text.strip()[:TEXT_SHOWN])
    return starts.pop() if starts else None


def _note_unread(recording: Recording, plane: str, zero: str, sense: str) -> None:
    """Add a note for each line that is not understood but is about angles or the circle's start.

    ``zero`` is the axis at which angles begin, such as +Y; it is empty if nothing states the axis.
    ``sense`` is CW or CCW; it is empty if nothing states the sense. Nothing is noted if the user
    states the axis or the sense.
    """
    if recording.layout.angle_zero or recording.layout.angle_sense:
        return
    convention = f"from {zero or f'+{plane[0]}'}, {sense or 'CCW'}"
    for line, content in recording.lines_outside:
        text = content[:LONGEST_TEXT]
        if _is_unread(recording, line, text):
            reason = quoted_line(line, text, "not understood", TEXT_SHOWN)
            recording.note("angle", convention, reason, "--angle-zero, --angle-sense")


def _is_unread(recording: Recording, line: int | str, text: str) -> bool:
    """Return whether a line about the start or the sense of angles is not understood.

    Angles begin at an axis, such as +Y. Their sense is clockwise or counter-clockwise.
    """
    if any(_is_inseparable(statement) for statement in statements_of_line(text, _is_mixed)):
        return True
    statements = statements_in([(line, text)])
    if statements and not _states_only_unit(line, text, statements):
        return False  # the line is understood: it states a field, such as the radius
    if _START.search(text) and _AXIS.search(text):
        return True
    if not _ANGLE.search(text) or _OTHER_SUBJECT.search(text) or _OTHER_AXIS.search(text):
        return False
    if unit_mentioned(text):
        return False
    words = _statement_about_angles(recording, cited_line(line), text, is_header=False)
    return not (words.zero or words.sense or _HARMLESS.search(text))


def _is_inseparable(text: str) -> bool:
    """Return whether one phrase says where angles begin, but is also about another subject.

    An example is ``Angles from +Y with the travel clockwise``.
    """
    if not _is_mixed(text) or not _ANGLE.search(text) or _OTHER_AXIS.search(text):
        return False
    return _zero_in(text) not in ("", "+X")


def _states_only_unit(line: int | str, text: str, fields: Collection[str]) -> bool:
    """Return whether a line states the unit of angles and also holds words that are not understood.

    ``fields`` are the fields for which values were found in the line. If one of them is not the
    unit of angles (``angle_unit``), the result is False.
    """
    if set(fields) != {"angle_unit"}:
        return False
    return any(part.strip() and not statements_in([(line, part)]) for part in divide_line(text))


def _convention_in_words(
    recording: Recording, plane: str, words: list[_AngleStatement], zero: str, sense: str
) -> AngleConvention:
    """Return the convention of angles that begin at the axis ``zero`` and run in ``sense``.

    If ``zero`` is empty, the plane's first axis is assumed. If ``sense`` is empty,
    counter-clockwise is assumed, but only for angles that begin at the plane's first axis; for any
    other axis, raise an `OpenQuestionError`. ``words`` are the statements about angles in the file;
    a note is added for each of them. If both are empty, nothing is noted.
    """
    if not zero and not sense:
        return AngleConvention(1, 0.0)
    first_axis = f"+{plane[0]}"
    zero = zero or first_axis
    if not sense and zero != first_axis:
        raise OpenQuestionError(
            f"{recording.place}: angles from {zero} must run clockwise or counter-clockwise, got no"
            " word on it. Say which: --angle-sense CW or CCW.",
            "angle_sense",
            ("CW", "CCW"),
        )
    sense = sense or "CCW"
    for entry in words:
        options = "--angle-zero, --angle-sense"
        recording.note("angle", f"from {zero}, {sense}", entry.source, options)
    recording.log.keep(angle_zero=zero, angle_sense=sense)
    sign = -1 if sense == "CW" else 1
    return AngleConvention(sign, -sign * angle_of_axis(recording, zero, plane))


def _note_words(
    recording: Recording, words: list[_AngleStatement], convention: AngleConvention
) -> None:
    """Add a note on each statement about angles that is replaced by the user's sign and offset.

    ``words`` are these statements in the file, and ``convention`` holds the sign and the offset
    with which the user converts angles.
    """
    for entry in words:
        value = f"sign {convention.sign}, offset {convention.offset_deg:g}°, as given"
        reason = f"{entry.source} says {entry.zero} {entry.sense}".strip()
        recording.note("angle", value, reason, "--angle-sign, --angle-offset-deg")


def _agreed_statement(recording: Recording, subject: str, stated: list[str]) -> str:
    """Return the axis at which a file says that angles begin, or their sense (CW or CCW).

    ``subject`` is "zero" for the axis, and "sense" for the sense. ``stated`` holds the axis or the
    sense that each place in the file states, or an empty string for a place that states none. If no
    place states one, the result is an empty string. Raise an `InputError` if places contradict each
    other.
    """
    values = list(dict.fromkeys(value for value in stated if value))
    if len(values) > 1:
        raise InputError(
            f"{recording.place}: the {subject} of the angle must be said once, got"
            f" {' and '.join(values)}. Give --angle-{subject}."
        )
    return values[0] if values else ""


def angle_of_axis(recording: Recording, axis: str, plane: str) -> float:
    """Return the angle [deg] from the first axis of the plane to an axis such as −Y."""
    letter = axis[-1]
    if letter not in plane:
        raise InputError(
            f"{recording.place}: angles must begin at an axis of plane {plane}, got {axis}. Give"
            " --angle-zero (of a log: --start-deg), or --plane."
        )
    angle = _RIGHT_ANGLE_DEG * plane.index(letter)
    if axis.startswith("-"):
        angle += _HALF_TURN_DEG
    return angle


def _statements_about_angles(recording: Recording) -> list[_AngleStatement]:
    """Return all statements in a file on where angles begin and in which sense they run.

    There is one entry for each source that states the axis or the sense. Sources are the header of
    the column of angles, lines above the table, lines that concern all tests, and the names of
    test, sheet and file.
    """
    header = _header_of_angles(recording)
    text = name_as_words(header)
    words = [_statement_about_angles(recording, f"the header {header!r}", text, is_header=True)]
    for line, content in recording.lines_outside:
        content = content[:LONGEST_TEXT].replace("_", " ")
        for text in statements_of_line(content, _is_mixed):
            if _SUBJECT.search(text) and not _OTHER_SUBJECT.search(text):
                words.append(
                    _statement_about_angles(recording, cited_line(line), text, is_header=False)
                )
    for name in recording.names_of_files():
        if name_is_about_angles(name):
            text = name_as_words(name)
            words.append(_statement_about_angles(recording, "its name", text, is_header=False))
    return [entry for entry in words if entry.zero or entry.sense]


def _header_of_angles(recording: Recording) -> str:
    """Return the header of the column of angles; empty if the table has no such column."""
    column = recording.heading.roles.get("angle")
    return "" if column is None else recording.heading.headers[column]


def _check_turned_axes(recording: Recording, plane: str) -> None:
    """Raise an error if a line says that an axis of the plane is mirrored, as in ``Y inverted``.

    The angles of the file may then run clockwise, or begin at the negative first axis. If the user
    states the sense of angles or, for the first axis, where they begin, no error is raised.
    """
    for line, content in recording.lines_outside:
        for segment in segments_of_line(content[:LONGEST_TEXT].replace("_", " ")):
            match = _TURNED_AXIS.fullmatch(segment)
            if match is None:
                continue
            axis = (match["axis"] or match["behind"]).upper()
            if axis == plane[0] and not _is_zero_given(recording):
                shown = segment.strip()[:TEXT_SHOWN]
                raise _unknown_zero(recording, cited_line(line), shown)
            if axis == plane[1] and not _is_sense_given(recording):
                raise _unknown_sense(recording, cited_line(line), segment)


def _is_mixed(text: str) -> bool:
    """Return whether a line is about angles and also about another subject, such as the feed."""
    return _SUBJECT.search(text) is not None and _OTHER_SUBJECT.search(text) is not None


def _statement_about_angles(
    recording: Recording, source: str | CitedLine, text: str, is_header: bool
) -> _AngleStatement:
    """Return where angles begin and in which sense they run, as stated by a text.

    ``text`` is a header, a line or a name, and ``source`` tells where it is, such as "line 3".
    ``is_header`` states whether the text is the header of the column of angles; a minus sign in
    this header means clockwise. Raise an error if the text is about angles, but ambiguous.
    """
    zero = _zero_in(text)
    layout = recording.layout
    if not zero and layout.angle_zero is None and layout.angle_offset_deg is None:
        _check_announced(recording, source, text)
        _check_no_axis(recording, source, text)
    sense = ""
    if is_header and _MINUS.search(text):
        sense = "CW"
    elif is_header or zero or _SENSE.search(text) or _ANGLE.search(text):
        sense = _sense_in(text)
        _check_reversed(recording, source, text, is_header)
    if zero or sense or is_header:
        _check_qualified(recording, source, text)
    return _AngleStatement(zero, sense, source)


def _sense_in(text: str) -> str:
    """Return the sense of angles, CW or CCW, that a text names; empty if it names none or both.

    A text that leads from one axis towards another, such as ``from +X towards -Y``, names a sense,
    too.
    """
    senses = senses_in(text)
    if len(senses) == 1:
        return senses.pop()
    return "" if senses else _sense_between_axes(text)


def _sense_between_axes(text: str) -> str:
    """Return the sense in which angles run from their zero towards the second axis of a text.

    The result is empty if the text names no second axis after a word such as "towards". In all
    planes (XY, YZ and ZX), the way from the first axis to the second is counter-clockwise.
    """
    zero = _zero_in(text)
    match = _TOWARDS.search(text)
    if not zero or match is None or match["axis"].upper() == zero[-1]:
        return ""
    is_next = "XYZX".find(zero[-1] + match["axis"].upper()) >= 0
    n_turned = [is_next, zero[0] == "+", match["sign"] in ("", "+")].count(False)
    return "CW" if n_turned % 2 else "CCW"


def _check_qualified(recording: Recording, source: str | CitedLine, text: str) -> None:
    """Raise an error if a text about angles holds words that change what it states.

    Such words are a view from below, an angle that is added, "except", a second axis, or a second
    sense. ``source`` tells where the text is, such as "line 3". No error is raised if the user
    states what the words change.
    """
    if not _is_sense_given(recording):
        _check_view(recording, source, text)
    if not _is_zero_given(recording):
        _check_shift(recording, source, text)
    if not (_is_zero_given(recording) and _is_sense_given(recording)):
        _check_exception(recording, source, text)
    if len(_zeros_in(text)) > 1 and not _is_zero_given(recording):
        raise _unknown_zero(recording, source, text.strip())
    if len(senses_in(text)) > 1 and not _is_sense_given(recording):
        raise _unknown_sense(recording, source, text)


def _is_zero_given(recording: Recording) -> bool:
    """Return whether the user states where angles begin."""
    layout = recording.layout
    return layout.angle_zero is not None or layout.angle_offset_deg is not None


def _is_sense_given(recording: Recording) -> bool:
    """Return whether the user states in which sense angles run."""
    layout = recording.layout
    return layout.angle_sense is not None or layout.angle_sign is not None


def _check_view(recording: Recording, source: str | CitedLine, text: str) -> None:
    """Raise an error if a text states the sense of angles as seen from below or from behind."""
    view = words_of_view(text)
    if view:
        raise OpenQuestionError(
            f"{recording.place}: angles must run clockwise or counter-clockwise as seen from above,"
            f" got {view!r} in {source}. Say which: --angle-sense CW or CCW.",
            "angle_sense",
            ("CW", "CCW"),
        )


def _check_shift(recording: Recording, source: str | CitedLine, text: str) -> None:
    """Raise an error if a text adds a number to angles, or gives an angle besides the zero."""
    shift = words_of_another_zero(_part_about_angles(text))
    if shift:
        raise InputError(
            f"{recording.place}: angles must begin at an axis, got {text.strip()!r} with {shift!r}"
            f" in {source}. Give --angle-offset-deg, the angle of the plane's first axis as the"
            " file counts (and --angle-sign -1 if it counts clockwise); or --angle-zero, if they do"
            " begin at one."
        )


def _check_exception(recording: Recording, source: str | CitedLine, text: str) -> None:
    """Raise an error if a text limits what it states by a word such as "except"."""
    exception = words_of_exception(_part_about_angles(text))
    if exception:
        raise InputError(
            f"{recording.place}: the angle must be said once for all tests, got {text.strip()!r}"
            f" with {exception!r} in {source}. Give --angle-zero and --angle-sense. Tests that"
            " differ need an import of their own."
        )


def name_is_about_angles(name: str) -> bool:
    """Return whether a name, such as ``300N_fromY_cw``, says something about angles."""
    text = name_as_words(name)
    return any(words.search(text) for words in (_ANGLE, _ZERO, _COMPASS))


def is_about_angles(text: str) -> bool:
    """Return whether a text has a word for angles or for the axis at which they begin."""
    return _SUBJECT.search(text) is not None


def says_where_angles_begin(text: str) -> bool:
    """Return whether a line says that angles run clockwise or that they do not begin at +X.

    The result is false for a line that states the usual convention, which is counter-clockwise from
    +X.
    """
    statements = statements_of_line(text, _is_mixed)
    return any(_states_where_angles_begin(statement) for statement in statements)


def states_angles(text: str) -> bool:
    """Return whether a text states where angles begin, or in which sense they run."""
    if not _SUBJECT.search(text) or _OTHER_SUBJECT.search(text):
        return False
    return bool(_zero_in(text)) or bool(senses_in(text))


def _states_where_angles_begin(text: str) -> bool:
    """Return whether a statement in a file says that angles run clockwise or do not begin at +X."""
    if not _SUBJECT.search(text) or _OTHER_SUBJECT.search(text):
        return False
    is_turned = _ANGLE.search(text) is not None and "CW" in senses_in(text)
    return _zero_in(text) not in ("", "+X") or is_turned


def _zero_in(text: str) -> str:
    """Return the axis, such as +Y, at which angles begin according to a text.

    The result is an empty string if the text names no such axis.
    """
    text = without_usual_view(text)
    for pattern in _ZEROS:
        match = pattern.search(text)
        if match is not None:
            return _axis_of(match)
    return ""


def states_zero(text: str) -> bool:
    """Return whether a text names the axis at which angles begin, as in ``zero on the X axis``."""
    return bool(_zero_in(text))


def _zeros_in(text: str) -> set[str]:
    """Return all axes, such as +Y, at which angles begin according to a text."""
    text = without_usual_view(text)
    zeros = set()
    for pattern in _ZEROS:
        for match in pattern.finditer(text):
            zeros.add(_axis_of(match))
    return zeros


def _axis_of(match: re.Match[str]) -> str:
    """Return the axis with its sign, such as +Y, from a match of one of the patterns for zeros."""
    signs = {match["sign"], match["behind"] or "", match.groupdict().get("negative") or ""}
    if signs <= {"", "+"}:
        return f"+{match['axis'].upper()}"
    return f"-{match['axis'].upper()}"


def _part_about_angles(text: str) -> str:
    """Return the sentences of a text that are about angles, without their parts on readings.

    Words such as "offset" in the other sentences and parts do not concern the angles.
    """
    parts = []
    for sentence in sentences_of_line(text):
        if not (_SUBJECT.search(sentence) or _zero_in(sentence) or senses_in(sentence)):
            continue
        for part in divide_line(sentence):
            if _SUBJECT.search(part) or not _OF_READINGS.search(part):
                parts.append(part)
    return ",".join(parts)


def _check_reversed(
    recording: Recording, source: str | CitedLine, text: str, is_header: bool
) -> None:
    """Raise an error if a text says that angles are reversed, but not in which sense they run.

    ``source`` tells where the text is, such as "line 3". ``is_header`` states whether the text is
    the header of the column of angles. Any other text causes the error only if it has a word for
    angles. If the user states the sense or the sign of angles, no error is raised.
    """
    layout = recording.layout
    if layout.angle_sense is not None or layout.angle_sign is not None:
        return
    is_about_angles = is_header or _ANGLE.search(text) is not None
    if not is_about_angles or _MATHEMATICAL.search(text) or _DENIED.search(text):
        return
    if _REVERSED.search(text) is None:
        return
    raise _unknown_sense(recording, source, text)


def _unknown_sense(recording: Recording, source: str | CitedLine, text: str) -> OpenQuestionError:
    """Return the error for a text about angles from which no sense can be read.

    ``source`` tells where the text is, such as "line 3".
    """
    return OpenQuestionError(
        f"{recording.place}: angles must run clockwise or counter-clockwise, got"
        f" {text.strip()[:TEXT_SHOWN]!r} in {source}. Say which: --angle-sense CW or CCW.",
        "angle_sense",
        ("CW", "CCW"),
    )


def _check_announced(recording: Recording, source: str | CitedLine, text: str) -> None:
    """Raise an error if a text names no axis after words such as "zero at".

    The axis at which angles begin should follow these words. If no text at all follows them, no
    error is raised. ``source`` tells where the text is, such as "line 3".
    """
    match = _ANNOUNCED.search(text)
    if match is None:
        return
    shown = match["zero"].strip(" :=")
    if shown:
        raise _unknown_zero(recording, source, shown)


def _check_no_axis(recording: Recording, source: str | CitedLine, text: str) -> None:
    """Raise an error if a text about angles is ambiguous about the axis at which angles begin.

    The text is ambiguous if it names a direction such as north instead of an axis, or if it names
    exactly one axis. This function is called only for texts without a word such as "from", which
    would show that angles begin at the named axis. ``source`` tells where the text is, such as
    "line 3".
    """
    if not any(words.search(text) for words in (_ANGLE, _ZERO_DEGREES, _COMPASS)):
        return
    axes = [*_AXIS.findall(text), *_AXIS_ZERO.findall(text)]
    is_one_axis = len(axes) == 1 and not _OTHER_AXIS.search(text)
    if is_one_axis or _NO_AXIS.search(text):
        raise _unknown_zero(recording, source, text.strip()[:TEXT_SHOWN])


def _unknown_start(recording: Recording, source: str | CitedLine, shown: str) -> OpenQuestionError:
    """Return the error for travelled angles and a text that may state where they begin.

    ``shown`` is the text, and ``source`` tells where it is, such as "line 3".
    """
    return OpenQuestionError(
        f"{recording.place}: the angle travelled must be counted from a stated axis; {shown!r} in"
        f" {source} may name it. Say at which angles begin: --angle-zero +X, +Y, -X or -Y. If they"
        " begin at no axis, give --angle-offset-deg.",
        "angle_zero",
        _AXES_WITH_SIGN,
    )


def _unknown_zero(recording: Recording, source: str | CitedLine, shown: str) -> OpenQuestionError:
    """Return the error for a text that should name the axis where angles begin, but does not.

    ``shown`` is the text, and ``source`` tells where it is, such as "line 3".
    """
    return OpenQuestionError(
        f"{recording.place}: angles must begin at an axis, got {shown!r} in {source}. Say at which:"
        " --angle-zero +X, +Y, -X or -Y. If they begin at no axis, give --angle-offset-deg.",
        "angle_zero",
        _AXES_WITH_SIGN,
    )
