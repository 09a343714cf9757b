"""Notes on conventions that files do not state, and on texts that are read but not used.

If nothing states the sign of readings or where angles begin, this package assumes its own
convention. The notes show these assumptions, so that the user can correct them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from ldbb_bayes.campaign.campaign import CircularTest
from ldbb_bayes.reading.angle_convention import is_about_angles
from ldbb_bayes.reading.assumptions import NOTHING_STATED, AssumptionLog
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.lines_above import statements_in
from ldbb_bayes.reading.mount_statement import unread_mount
from ldbb_bayes.reading.reading_sign import is_about_sign
from ldbb_bayes.reading.recording import Recording
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.travel_direction import NAMES_DIRECTION, directions_stated, senses_in
from ldbb_bayes.reading.unit_lines import unit_mentioned
from ldbb_bayes.reading.unused_segments import states_correction, unused_segments

__all__ = ["note_unstated"]

# Largest number of notes on texts that the import does not use. A text on a convention, such as the
# sign of readings, always gets a note, even beyond this number. One more note states how many texts
# have none.
_MOST_TEXTS = 6
# A note quotes at most this many characters of an unused text.
_TEXT_SHOWN = 160
# Names of the fields with the size of one digital step of the instrument. An import does not always
# need this size. A line that states it therefore counts as used only if a note to the user cites
# the line.
_CITED_WHERE_USED = {"reading_scale", "angle_scale", "time_scale"}
# Regular expression for a number in a text that the import does not use. If several such texts
# differ only in their numbers, the user is shown only the first, unless they are corrections.
_NUMBER = re.compile(r"[\d.,]+")
# Regular expression for a letter. A text without any letter gets no note.
_LETTER = re.compile(r"[^\W\d_]")


class _Text(NamedTuple):
    """Unused text outside a table, shortened for a note."""

    # number of the line that holds the text; if the line is on another sheet, a text with the
    # number and the sheet, such as "3 of notes.txt"
    line: int | str
    text: str


class _TextOutside(NamedTuple):
    """Line or cell of a file outside the tables of readings, and whether it was used."""

    # number of the line that holds the text; if the line is on another sheet, a text with the
    # number and the sheet, such as "3 of notes.txt"
    line: int | str
    text: str
    # whether the import took a value, such as the radius, from the text of the line or cell
    is_used: bool


def note_unstated(
    recordings: Sequence[Recording],
    tests: Sequence[CircularTest],
    layout: Layout,
    log: AssumptionLog,
) -> None:
    """Add notes on conventions that had to be assumed, and on texts that the import did not use.

    A convention, such as the sign of readings, is assumed if neither the files nor the user state
    it. The unused texts stand outside the tables.

    Parameters
    ----------
    recordings
        For each test, its rows in the files and all that the files state about it.
    tests
        The tests of the campaign that was made from these rows.
    layout
        Layout of the files, as far as the user states it.
    log
        Log with all other notes, to which these notes are added.
    """
    noted = {assumption.what for assumption in log.assumptions()}
    unused = _unused_texts(recordings, log)
    reason = NOTHING_STATED
    has_reading = _has_column(recordings, "reading")
    if has_reading and layout.sign is None and "sign of the reading" not in noted:
        log.add("", "sign of the reading", "1: a longer bar is positive", reason, "--sign")
    if has_reading and layout.measured is None and "reading" not in noted:
        log.add("", "reading", "of the radius, not of the diameter", reason, "--measured")
    if "angle" not in noted and _has_column(recordings, "angle") and not _states_angles(layout):
        convention = "from the plane's first axis, CCW"
        log.add("", "angle", convention, reason, "--angle-zero, --angle-sense")
    if "direction" not in noted and all(test.direction is None for test in tests):
        log.add("", "direction", "not stated", reason, "--direction")
    log.allow_for_unused_texts(bool(unused))
    _note_unused_texts(unused, log)


def _has_column(recordings: Sequence[Recording], role: str) -> bool:
    """Return whether a table has a column with the role ``role``, such as angle."""
    return any(role in recording.heading.roles for recording in recordings)


def _states_angles(layout: Layout) -> bool:
    """Return whether the user states where angles begin, or in which sense they run."""
    values = (layout.angle_sign, layout.angle_offset_deg, layout.angle_zero, layout.angle_sense)
    return any(value not in (None, "") for value in values)


def _unused_texts(recordings: Sequence[Recording], log: AssumptionLog) -> list[_Text]:
    """Return the unused texts above, below or beside the tables.

    A text is unused if the import took nothing from it. If the import used a part of a text, or if
    a note in ``log`` already cites the line of the text, only the unused segments of the text are
    returned. ``recordings`` are the tests in the files.
    """
    last_lines: dict[Sheet, int] = {}
    for recording in recordings:
        last = max(recording.lines, default=0)
        last_lines[recording.sheet] = max(last, last_lines.get(recording.sheet, 0))
    unused: dict[_Text, None] = {}
    for recording in recordings:
        places = {"", recording.place, recording.sheet.place}
        cited = log.lines_cited_for(places)
        for outside in _texts_outside(recording, last_lines[recording.sheet]):
            unused_text = outside.text
            of_line = [citation for citation in cited if citation.line == outside.line]
            if of_line or outside.is_used:
                quoted = [citation.quoted for citation in of_line]
                unused_text = unused_segments(outside.text, quoted)
            if _LETTER.search(unused_text):
                unused[_Text(outside.line, unused_text.strip()[:_TEXT_SHOWN])] = None
    return list(unused)


def _note_unused_texts(unused: Sequence[_Text], log: AssumptionLog) -> None:
    """Add notes on unused texts outside the tables.

    Each of the most important texts in ``unused`` gets a note. One more note says how many other
    texts there are.
    """
    option = "the option for what they state"
    shown = _most_important(unused)
    for line, text in shown:
        log.add("", "texts not used", repr(text), f"line {line}", option)
    further = len(unused) - len(shown)
    if further > 0:
        log.add("", "texts not used", str(further), "further lines", option)


def _most_important(texts: Sequence[_Text]) -> list[_Text]:
    """Return the unused texts that are important enough for a note of their own.

    Texts on angles, signs, units, corrections, directions and the mount come first. Their number is
    not limited, because they may change the numbers of the campaign. If several texts differ only
    in their numbers, the first of them stands for all. Corrections, such as ``Preset: 10 um``, are
    an exception: several may be returned although they differ only in their numbers.
    """
    distinct: dict[str, _Text] = {}
    for text in texts:
        distinct.setdefault(_NUMBER.sub("", text.text), text)
    conventions = [text for text in distinct.values() if _may_be_convention(text)]
    others = [text for text in texts if states_correction(text.text) and text not in conventions]
    others += [text for text in distinct.values() if not _may_be_convention(text)]
    n_others = max(0, _MOST_TEXTS - len(conventions))
    return conventions + others[:n_others]


def _may_be_convention(text: _Text) -> bool:
    """Return whether a text may be about angles, signs, units, directions or the mount.

    A text on a correction of readings, such as a preset of the gauge, counts too.
    """
    if is_about_angles(text.text) or is_about_sign(text.text) or states_correction(text.text):
        return True
    if NAMES_DIRECTION.search(text.text) is not None or senses_in(text.text):
        return True
    return bool(unread_mount([(text.line, text.text)]) or unit_mentioned(text.text))


def _texts_outside(recording: Recording, last_line: int) -> Iterator[_TextOutside]:
    """Yield each line and cell outside the table of a test, and whether the import used it.

    A line above the table counts as used if it states a field of a test or campaign, or the
    direction of travel. The same holds for the lines of a sheet without a table. A line below the
    table, or a text beside it, counts as used only if it states the direction of travel.
    ``last_line`` is the number of the last line of the table.
    """
    for line, text in (*recording.heading.lines_above, *recording.lines_of_all_tests):
        fields = set(statements_in([(line, text)])) - _CITED_WHERE_USED
        yield _TextOutside(line, text, bool(fields or directions_stated([(line, text)])))
    sheet = recording.sheet
    for line, text in sheet.texts(row for row in sheet.rows if row.line > last_line):
        yield _TextOutside(line, text, bool(directions_stated([(line, text)])))
    for entry in recording.texts_beside:
        placed_text = (entry.place, entry.text)
        is_of_test = placed_text in recording.lines_beside
        is_used = is_of_test and bool(directions_stated([placed_text]))
        yield _TextOutside(entry.place, entry.text, is_used)
