"""Unit of a column of numbers, from all sources that state it.

The sources are the user, a column of units, the header, and lines above the table. Sources in the
file must not contradict each other, unless the user states the unit.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.cited_lines import CitedLine, cited_line, with_words
from ldbb_bayes.reading.recording import Recording
from ldbb_bayes.reading.sexagesimal import SECONDS_UNIT, names_sexagesimal
from ldbb_bayes.reading.unit_lines import COUNT
from ldbb_bayes.reading.words import (
    LONGEST_TEXT,
    SHARE,
    UNITS,
    comparable,
    scaled_unit,
    size_of_unit,
    unit_in_shares,
)
from ldbb_bayes.results import Array

__all__ = ["is_unit_stated", "unit_in_file", "unit_size"]

# Word that messages show as the unit of a row that has no unit.
_NO_UNIT = "none"
# Regular expression for the size of one count in the header of readings, such as 0.1 in "0.1 µm" or
# 1/10 in "1/10 µm".
_SIZE_OF_COUNT = re.compile(r"(?:0[.,]0*1|1/10+|10?[.,]?0*e-\d+)\s?[^\W\d]", re.IGNORECASE)
# Regular expression for the length that a voltage stands for, as in "1 V = 10 µm" or "10 µm/V".
_SENSITIVITY = re.compile(
    r"(?<![\d.,])1\s*(?P<volt>m?V)\s*(?:=|≙|:)\s*(?P<size>\d[\d.,]*\s*[^\W\d_]+)"
    r"|(?P<share>\d[\d.,]*\s*[^\W\d_]+)\s*/\s*(?P<per>m?V)(?![^\W_])"
)
# Abbreviations that mean gon in some languages and degrees in others.
_GRADS = ("gr", "grad", "g")
# Units of mass. If a file states a force in one of these units, the error message advises kgf.
_KILOGRAMS = ("kg", "kgs", "kilogram", "kilograms", "kilogramm")
# An error message shows at most this number of characters of a unit from a file.
_UNIT_SHOWN = 40


class _UnitEvidence(NamedTuple):
    """Units of a column that one place in the file states, such as a line or the cells."""

    # unit of the column's number in each row, or one unit for all rows; a unit that this package
    # does not know is stored as the file writes it
    units: Sequence[str]
    source: str | CitedLine  # place that states the unit, for messages, such as "line 3"


def is_unit_stated(recording: Recording, role: str) -> bool:
    """Return whether the user or the file states the unit of a column.

    ``role`` is what the column holds, such as angle or reading.
    """
    if getattr(recording.layout, f"{role}_unit") is not None:
        return True
    return bool(_evidence_in_file(recording, role))


def unit_in_file(recording: Recording, role: str) -> str:
    """Return the unit that the file states for a column, the same in all rows; else an empty text.

    The text is empty, too, if the user states the unit. ``role`` is what the column holds, such as
    force.
    """
    if getattr(recording.layout, f"{role}_unit") is not None:
        return ""
    units: set[str] = set()
    for evidence in _evidence_in_file(recording, role):
        units.update(evidence.units)
    units.discard(_NO_UNIT)
    return units.pop() if len(units) == 1 else ""


def unit_size(
    recording: Recording, role: str, usual: str, reason: str | CitedLine = "no unit in the header"
) -> float | Array:
    """Return the factor that converts the numbers of a column to the unit that this package uses.

    The factor is an array of shape (n,) if the unit changes from row to row. The unit that the user
    states is used, or else the unit that the file states. If neither of them states a unit, the
    usual unit is assumed and the assumption is noted.

    Parameters
    ----------
    recording
        Rows of the test in the file, and everything that the file or the user states about the
        test.
    role
        Role of the column, such as reading.
    usual
        Unit that is assumed if none is stated.
    reason
        Reason that the note gives for the usual unit.

    Raises
    ------
    InputError
        If the unit is unknown for this role, or if the user states no unit and sources in the file
        contradict each other.
    """
    stated_unit: str | None = getattr(recording.layout, f"{role}_unit")
    evidence = _evidence_in_file(recording, role)
    subject = f"unit of the {role}"
    option = _option(role)
    if stated_unit is not None:
        for other in evidence:
            if set(other.units) != {stated_unit}:
                contradiction = with_words(other.source, f" says {_units_as_text(other.units)}")
                recording.note(subject, f"{stated_unit}, as given", contradiction, option)
        recording.log.keep(**{f"{role}_unit": stated_unit})
        return _size_of_known_unit(recording, role, stated_unit, "as given")
    if not evidence:
        recording.note(subject, usual, reason, option)
        recording.log.keep(**{f"{role}_unit": usual})
        return UNITS[role][usual]
    recording.log.keep(**{f"{role}_unit": None})
    # Several places in the file may state the unit of the column. Places that state it for every
    # row come first in the sorted list. Each later place must state the same units as the first
    # place. If the first place states a unit for every row, a later one may omit it in some rows.
    first, *further_evidence = sorted(evidence, key=lambda entry: _NO_UNIT in entry.units)
    is_complete = _NO_UNIT not in first.units
    for other in further_evidence:
        units = set(other.units)
        if is_complete:
            units.discard(_NO_UNIT)
        if units != set(first.units):
            units_of_first = _units_as_text(first.units)
            units_of_other = _units_as_text(other.units)
            raise InputError(
                f"{recording.place}: the unit of the {role} must be said once, got"
                f" {units_of_first} in {first.source} and {units_of_other} in {other.source}."
                f" Correct the file, or give {option}."
            )
    _note_source(recording, role, first)
    return _size_of_rows(recording, role, first)


def _note_source(recording: Recording, role: str, evidence: _UnitEvidence) -> None:
    """Add a note on the source of a column's unit, unless the column's header is the source.

    ``evidence`` holds the unit and its source, and ``role`` is the role of the column.
    """
    is_scaled = recording.heading.roles[role] in recording.heading.scaled_units
    is_scaled = is_scaled or _SIZE_OF_COUNT.match(evidence.units[0]) is not None
    if evidence.source == _header_source(recording, role) and not is_scaled:
        return
    subject = f"unit of the {role}"
    value = _units_as_text([unit_in_shares(unit) or unit for unit in evidence.units])
    if value == SECONDS_UNIT:
        value += ", degrees and minutes included"
    recording.note(subject, value, evidence.source, _option(role))


def _size_of_rows(recording: Recording, role: str, evidence: _UnitEvidence) -> float | Array:
    """Return the factor that converts a column of a file to the unit that this package uses.

    For readings in mm, the factor is 1000, because the package uses µm. The result is an array with
    one factor for each row if the unit changes from row to row. ``evidence`` holds the unit of each
    row, or one unit for all rows, and its source.
    """
    sizes = {}
    for unit in dict.fromkeys(evidence.units):
        source = evidence.source
        if len(evidence.units) > 1:
            line = recording.lines[list(evidence.units).index(unit)]
            source = cited_line(line)
        sizes[unit] = _size_of_known_unit(recording, role, unit, source)
    if len(sizes) == 1:
        return next(iter(sizes.values()))
    return np.array([sizes[unit] for unit in evidence.units])


def _size_of_known_unit(
    recording: Recording, role: str, unit: str, source: str | CitedLine
) -> float:
    """Return the factor that converts numbers from a unit to the unit that this package uses.

    For readings in mm, the factor is 1000, because the package uses µm for readings. ``role`` is
    what the numbers are, such as reading. ``source`` says where the unit is stated, such as "line
    3". Raise an `InputError` if the role has no such unit.
    """
    size = size_of_unit(role, unit)
    if size is None:
        if role == "reading":
            _check_sensitivity(recording, unit)
        option = _option(role) + _hint_on_unit(role, unit)
        raise InputError(
            f"{recording.place}: the {role} must be in {', '.join(UNITS[role])}, got"
            f" {unit[:_UNIT_SHOWN]!r} in {source}. Correct the header, or give {option}."
        )
    return size


def _hint_on_unit(role: str, unit: str) -> str:
    """Return the last words of the advice on a unit that this package does not know.

    The advice is part of an error message and names the option that states the unit, such as
    ``--angle-unit``. The words returned here are added after this option; the result is empty if
    there is nothing to add. ``role`` is the role of the column, such as angle.
    """
    if role == "reading" and SHARE.search(unit):
        return (
            " ('0.1 mil' for tenths of a thou, which are 0.0001 inch; '0.01 mm' for hundredths of"
            " a millimetre)"
        )
    if role == "reading":
        return " (--unit '0.1 um' for counts of 0.1 µm)"
    if role == "angle":
        return _hint_on_unit_of_angle(unit)
    if role == "force" and comparable(unit) in _KILOGRAMS:
        return " kgf (the weight of a kilogram)"
    return ""


def _hint_on_unit_of_angle(unit: str) -> str:
    """Return the last words of the advice on a unit of angles that this package does not know.

    The advice is part of an error message and names the option ``--angle-unit``. The words returned
    here are added after this option; the result is empty if there is nothing to add.
    """
    if names_sexagesimal(unit):
        return " deg if they have decimals; or write them as in 12°30'15\""
    if comparable(unit) in _GRADS:
        return " gon (400 in a turn) or --angle-unit deg (360)"
    if not any(scaled_unit(unit) in units for units in UNITS.values()):
        return " (--angle-unit '0.01 deg' for counts of 0.01°)"
    return ""


def _check_sensitivity(recording: Recording, unit: str) -> None:
    """Raise an `InputError` if a line states the length per volt for readings in volts.

    Such a line is ``10 µm/V`` or ``1 V = 10 µm``. The length in this line is not used without the
    user's consent. The error message therefore advises the user to state the length with the option
    ``--unit``. ``unit`` is the unit of the readings, V or mV.
    """
    for line, text in recording.lines_outside:
        stated = _SENSITIVITY.search(text[:LONGEST_TEXT])
        if stated is None or comparable(stated["volt"] or stated["per"]) != comparable(unit):
            continue
        size = scaled_unit(stated["size"] or stated["share"])
        if size_of_unit("reading", size) is not None:
            raise InputError(
                f"{recording.place}: readings must be lengths, got {unit!r}, and {stated[0]!r} in"
                f" line {line}. If this is their size, give --unit '{size}'."
            )


def _option(role: str) -> str:
    """Return the command-line option that states the unit of a column, such as --angle-unit."""
    return "--unit" if role == "reading" else f"--{role}-unit"


def _units_as_text(units: Sequence[str]) -> str:
    """Return the different units as text for messages: ``mm and um``."""
    return " and ".join(dict.fromkeys(units))[:_UNIT_SHOWN]


def _header_source(recording: Recording, role: str) -> str:
    """Return a text that names the line of a column's header, or of the unit below the header.

    The line of the unit is named if the file has a row of units below the header, and this row
    states the unit of the column. ``role`` is what the column holds, such as angle.
    """
    heading = recording.heading
    if heading.roles[role] in heading.columns_with_unit_below:
        return f"line {heading.unit_line}"
    return f"line {heading.line}"


def _evidence_in_file(recording: Recording, role: str) -> list[_UnitEvidence]:
    """Return the units that a file states for one of its columns, with one entry for each source.

    ``role`` is what the column holds, such as angle or reading. Some instruments give readings in
    counts (digital steps), and a line above the table may state the size of one count. If the
    readings are in counts or have no stated unit, this size is returned as their unit. The unit of
    angles in counts is the size of one count of the encoder. The unit of times that are numbers of
    samples is the time between samples. The unit of times of day is s.
    """
    evidence = []
    for row_units in recording.row_units.get(role, ()):
        units = []
        for text in row_units.units:
            units.append(scaled_unit(text.strip("[]() ")) or text or _NO_UNIT)
        evidence.append(_UnitEvidence(units, row_units.source))
    evidence += _evidence_of_header(recording, role, evidence)
    for statement in recording.statements.get(f"{role}_unit", ()):
        evidence.append(_UnitEvidence([statement.value], cited_line(statement.line)))
    scales = recording.statements.get(f"{role}_scale", ())
    without_counts = [other for other in evidence if not _is_count(other.units)]
    if scales and not without_counts and _may_be_counts(recording, role):
        return [_UnitEvidence([scale.value], cited_line(scale.line)) for scale in scales]
    return evidence


def _evidence_of_header(
    recording: Recording, role: str, evidence: Sequence[_UnitEvidence]
) -> list[_UnitEvidence]:
    """Return a list with the unit that the header of a column states; empty if it states none.

    The unit may also be stated in the row of units below the header. ``evidence`` holds the units
    that cells of the table state, as in a column of units.
    """
    heading = recording.heading
    column = heading.roles[role]
    if column in heading.scaled_units:
        return [_UnitEvidence([heading.scaled_units[column]], _header_source(recording, role))]
    header_unit = _unit_of_header(recording, role, evidence)
    if not header_unit:
        return []
    # A number in the unit of a header, as in 10 µm, may be a factor or the range of the
    # instrument. A unit with a number is therefore treated as unknown.
    # A tenth, hundredth and so on, as in 0.1 µm, is the size of one count.
    if role == "reading" and _SIZE_OF_COUNT.match(header_unit) and scaled_unit(header_unit):
        return [_UnitEvidence([scaled_unit(header_unit)], _header_source(recording, role))]
    factor = " …" if re.search(r"\d", header_unit) else ""
    return [_UnitEvidence([header_unit + factor], _header_source(recording, role))]


def _unit_of_header(recording: Recording, role: str, evidence: Sequence[_UnitEvidence]) -> str:
    """Return the unit that the header of a column states; empty if it states none.

    If the cells hold degrees, minutes and seconds, the word for degrees in the header is ignored,
    because it describes only the first of these three numbers. ``evidence`` holds the units that
    are stated in cells of the table.
    """
    unit = recording.heading.units[recording.heading.roles[role]]
    names_degrees = unit == "deg" or names_sexagesimal(unit)
    are_in_seconds = any(set(entry.units) == {SECONDS_UNIT} for entry in evidence)
    if role == "angle" and names_degrees and are_in_seconds:
        return ""
    return unit


def _may_be_counts(recording: Recording, role: str) -> bool:
    """Return whether the numbers of a column may be counts (digital steps of an instrument).

    The result is true for readings, for angles whose header has a word for counts, and for times
    that are successive integers, because these number the samples. A line of the file may then
    state the size of one count. ``role`` is what the column holds: reading, angle or time.
    """
    if role == "angle":
        return _heads_counts(recording, role)
    if role == "time":
        return bool(np.all(np.diff(recording.numbers[role]) == 1.0))
    return True


def _heads_counts(recording: Recording, role: str) -> bool:
    """Return whether the header of a column has a word for counts of an encoder.

    ``role`` is what the column holds, such as angle.
    """
    heading = recording.heading
    header = heading.headers[heading.roles[role]][:LONGEST_TEXT]
    words = re.split(r"[\W_]+", comparable(header))
    return any(COUNT.fullmatch(word) for word in words)


def _is_count(units: Sequence[str]) -> bool:
    """Return whether all units are words for counts (digital steps of an instrument)."""
    return all(COUNT.fullmatch(comparable(unit)) is not None for unit in units)
