"""Load, radius, feed and direction of travel of a test, from all sources.

Values that the user or a column states are trusted. If another source contradicts such a value, the
contradiction is noted. Values in lines above a table and in names of files are less reliable. Their
use is noted, and an `InputError` is raised if they contradict each other.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from ldbb_bayes.errors import InputError, require
from ldbb_bayes.reading.angle_convention import name_is_about_angles
from ldbb_bayes.reading.cited_lines import (
    TEXT_SHOWN,
    CitedLine,
    cited_line,
    quoted_line,
    with_words,
)
from ldbb_bayes.reading.column_units import is_unit_stated, unit_size
from ldbb_bayes.reading.columns_of_tests import cells_of, columns_that_name_tests
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.loads_in_lines import (
    LoadInLine,
    line_with_unit_of_loads,
    lines_with_preload,
    lines_with_unread_load,
    load_of_lines,
    loads_in_lines,
    unit_of_all_loads,
)
from ldbb_bayes.reading.names import load_in_name, load_is_ambiguous, radius_in_name
from ldbb_bayes.reading.numbering_columns import are_repeated
from ldbb_bayes.reading.programmed_circles import programmed_arcs
from ldbb_bayes.reading.recording import (
    LOAD_ROLES,
    UNITS_SHOWN,
    Recording,
    option_for,
)
from ldbb_bayes.reading.travel_direction import (
    check_direction_is_clear,
    direction_named,
    directions_stated,
    senses_of_header,
)
from ldbb_bayes.reading.words import comparable, size_of_unit
from ldbb_bayes.results import Array

__all__ = ["direction_of", "loads_of", "quantity_of"]

# Words in headers for the two ways around a circle. They do not say which is clockwise; opposite
# ways have opposite signs.
_WAYS = {
    "forward": 1,
    "backward": -1,
    "forwards": 1,
    "backwards": -1,
    "vorwärts": 1,
    "rückwärts": -1,
}
# If two lines of a file state a quantity, such as the radius, their values agree if the relative
# difference is at most this number.
_ROUNDED_IN_LINE = 1e-3
# Values in the names of files, sheets and tests are often rounded. Such a value agrees with another
# value of the quantity if their relative difference is at most this number.
_ROUNDED_IN_NAME = 0.02
# The forces (or the pressures) in all rows of a test count as equal if they agree within this
# relative tolerance.
_CONSTANT = 1e-9
# Largest deviation that the forces (or the pressures) measured within a test may have from their
# mean, as a fraction of the mean.
_LARGEST_VARIATION = 0.02
# A load (force or pressure) that varies from row to row is taken to be measured if it changes, on
# average, at least once in this number of rows. If it changes less often, the rows probably belong
# to several tests with different nominal loads.
_ROWS_OF_CHANGE = 20
# Number of digits to which the mean of a measured load is rounded.
_DIGITS_OF_MEAN = 6
# Advice in the error message if the rows of a test have different directions.
_WRITE_DIRECTIONS = "Write CW or CCW into the column, or give --direction if all tests ran alike."
# Advice in the error message if the rows are circles in both directions.
_NAME_TESTS = "Name the test of each row in a column of its own (--test-column)."
# Advice in the error message if a column of directions contains a word that is not understood.
_WORDS_FOR_DIRECTIONS = (
    f"{_WRITE_DIRECTIONS} These are read, too: clockwise, counter-clockwise, Uhrzeigersinn, gegen"
    " den Uhrzeigersinn, UZS, GUZS, rechts, links, G2, G3."
)


class _Evidence(NamedTuple):
    """Value of a quantity of a test, with the line, name or column that states it."""

    # stated value of the quantity; NaN if it is unclear, for example because the number can be read
    # in two ways
    value: float
    source: str | CitedLine  # place that states the value, in words for a message, such as "line 3"
    # largest relative difference at which this value and another value of the quantity count as
    # equal; they may differ slightly because they are rounded
    tolerance: float
    # reason why the stated value is uncertain. The text is empty if the value is certain. It is
    # also empty if the only doubt is whether a comma or point in the value separates thousands.
    doubt: str = ""


def quantity_of(recording: Recording, key: str, column_value: float | None = None) -> float | None:
    """Return a quantity of a test, such as its radius; None if nothing states it.

    The quantity is in the unit with which the name of the field ends, such as mm. Values that the
    user or a column of the table states take precedence over values in lines above the table and in
    names of files.

    Parameters
    ----------
    recording
        Rows of the test in the file, and everything that the file or the user states about the
        test.
    key
        Field of the quantity: force_N, pressure_bar, radius_mm, feed_mm_per_min, start_deg or
        overshoot_deg.
    column_value
        Value in the column of the quantity, in the unit of the field; None without such a column.

    Raises
    ------
    InputError
        If lines or names contradict each other, or state a number such as 1,000 that can be read in
        two ways. The error is raised only if neither the user nor a column states the quantity.
    """
    certain = _certain_evidence(recording, key, column_value)
    uncertain = _uncertain_evidence(recording, key)
    if not certain and not uncertain:
        return None
    unit = UNITS_SHOWN.get(key, "°")
    option = option_for(key)
    evidence, *further_evidence = certain + uncertain
    value = evidence.value
    if math.isnan(value):
        got = f"a mark in {evidence.source} that may stand between thousands"
        if evidence.doubt:
            got = f"{evidence.doubt} in {evidence.source}"
        raise InputError(f"{recording.place}: {key} must be one number, got {got}. Give {option}.")
    for other in further_evidence:
        if _agrees(other, value):
            continue
        if not certain:
            raise InputError(
                f"{recording.place}: {key} must be said once, got {value:g} {unit} in"
                f" {evidence.source} and {other.value:g} {unit} in {other.source}. Give {option}."
            )
        reason = with_words(other.source, f" says {other.value:g} {unit}")
        recording.note(key, f"{value:g} {unit}, {evidence.source}", reason, option)
    if not certain:
        statements = recording.statements.get(key)
        reason = evidence.source
        if statements and not statements[0].unit and not _unit_of_all_loads(recording, key):
            if key in LOAD_ROLES:
                _check_unit_of_loads(recording, key, f"line {statements[0].line}")
            reason = with_words(reason, ", no unit there")
        recording.note(key, f"{value:g} {unit}", reason, option)
    return value


def _check_unit_of_loads(recording: Recording, key: str, source: str) -> None:
    """Raise an `InputError` if a line states another unit of all loads than the usual one.

    Such a line is, for example, ``all forces in kN``; without it, a force without a unit is in N.
    ``key`` is force_N or pressure_bar, and ``source`` describes in words the place of a load
    without a unit, such as "line 3".
    """
    lines = [*recording.heading.lines_above, *recording.lines_of_all_tests]
    stated = line_with_unit_of_loads(key, lines)
    if stated is not None:
        line, text = stated
        raise InputError(
            f"{recording.place}: {key} must have its unit beside it, got none in {source}, and"
            f" {text[:TEXT_SHOWN]!r} in line {line}. Write the unit there, or give"
            f" {option_for(key)}."
        )


def _agrees(evidence: _Evidence, value: float) -> bool:
    """Return whether a value stated in a file agrees with ``value`` up to rounding.

    A number that can be read in two ways, such as 1,000, counts as agreeing. ``evidence`` holds the
    stated value, its source and the tolerance for rounding.
    """
    if math.isnan(evidence.value):
        return True
    return bool(np.isclose(evidence.value, value, rtol=evidence.tolerance))


def _certain_evidence(
    recording: Recording, key: str, column_value: float | None
) -> list[_Evidence]:
    """Return the values of a quantity that the user and a column of the table state.

    The value that takes precedence comes first. For a radius, this is the value of the column; for
    any other quantity, it is the value of the user. ``key`` is the field of the quantity, such as
    radius_mm; ``column_value`` is the value of its column, or None. ``recording`` holds the rows of
    the test in its file, and everything that the file or the user states about the test.
    """
    user_evidence = _evidence_if_stated(recording.stated_value(key), "as given")
    column_evidence = _evidence_if_stated(column_value, "its column")
    if key == "radius_mm":
        return column_evidence + user_evidence
    return user_evidence + column_evidence


def _evidence_if_stated(value: float | None, source: str) -> list[_Evidence]:
    """Return a list with a stated value and its source; an empty list if the value is None.

    ``source`` describes in words what states the value of the quantity, such as "its column".
    """
    if value is None:
        return []
    return [_Evidence(float(value), source, _ROUNDED_IN_LINE)]


def _uncertain_evidence(recording: Recording, key: str) -> list[_Evidence]:
    """Return the values of a quantity that are stated in lines above the table or in names.

    Such values are used only if neither the user nor a column states the quantity. They are
    returned in this order:

    - values in lines; if a line leaves the value open, for example because it lists several
      numbers, it comes after the other lines,
    - if the quantity is a load or a radius: the value in the name of the test, or else in the name
      of its column, sheet or file,
    - if the quantity is a radius: the radii of arcs in G-code.

    For a feed, the value in G-code is returned only if no other line states one. ``key`` is the
    field of the quantity, such as force_N. ``recording`` holds the rows of the test in its file,
    and everything that the file or the user states about the test.
    """
    evidence = []
    unit = _unit_of_all_loads(recording, key)
    for statement in recording.statements.get(key, ()):
        source = cited_line(statement.line)
        value = statement.value
        if unit and not statement.unit:
            value *= size_of_unit(LOAD_ROLES[key], unit) or 1.0
        evidence.append(_Evidence(value, source, _ROUNDED_IN_LINE, statement.doubt))
    evidence.sort(key=lambda stated: bool(stated.doubt))
    if key in LOAD_ROLES:
        load = load_in_name(recording.names(), key)
        if load is not None:
            evidence.append(_Evidence(load.value, f"the name {load.name!r}", _ROUNDED_IN_NAME))
    if key == "radius_mm":
        radius = radius_in_name(recording.names())
        if radius is not None:
            evidence.append(_Evidence(radius, "its name", _ROUNDED_IN_NAME))
        evidence += _programmed_evidence(recording, evidence)
    if key == "feed_mm_per_min" and not evidence:
        for statement in recording.statements.get("programmed_feed_mm_per_min", ()):
            source = cited_line(statement.line)
            evidence.append(_Evidence(statement.value, source, _ROUNDED_IN_LINE))
    return evidence


def _unit_of_all_loads(recording: Recording, key: str) -> str:
    """Return the unit that the user or a line states for all loads, such as kN; empty if none does.

    ``key`` is the field of a quantity, such as force_N; the result is empty if it is no load.
    """
    if key not in LOAD_ROLES:
        return ""
    stated_by_user: str | None = getattr(recording.layout, f"{LOAD_ROLES[key]}_unit")
    lines = [*recording.heading.lines_above, *recording.lines_of_all_tests]
    return stated_by_user or unit_of_all_loads(key, lines)


def _programmed_evidence(recording: Recording, evidence: Sequence[_Evidence]) -> list[_Evidence]:
    """Return the radii of arcs that are programmed by G-code in lines above the table.

    ``evidence`` holds the radii from other sources. If an arc has one of these radii, this arc is
    the measured circle, and the other arcs only lead to it and away from it. The result is then an
    empty list, because the radius of the circle is already known.
    """
    programmed = []
    for statement in recording.statements.get("programmed_radius_mm", ()):
        source = cited_line(statement.line)
        programmed.append(_Evidence(statement.value, source, _ROUNDED_IN_LINE))
    for arc in programmed:
        if any(_agrees(stated, arc.value) for stated in evidence):
            return []
    return programmed


def loads_of(recording: Recording) -> dict[str, float]:
    """Return a dict with the stated force [N] and pressure [bar] of a test.

    The keys are ``force_N``, ``pressure_bar`` or both. ``recording`` holds the rows of the test in
    its file, and everything that the file or the user states about the test.

    Raises
    ------
    InputError
        If neither force nor pressure is stated, if sources contradict each other, or if the values
        in the column of forces or pressures differ too much.
    """
    is_stated = any(recording.stated_value(key) is not None for key in LOAD_ROLES)
    loads = {}
    for key in LOAD_ROLES:
        column_value = None if is_stated else _constant_load(recording, key)
        value = quantity_of(recording, key, column_value)
        if value is not None:
            _check_force_is_positive(recording, key, value, column_value)
            loads[key] = value
    in_lines = list(loads_in_lines(recording.heading.lines_above))
    if not loads and not recording.label:
        loads = _load_of_lines(recording, in_lines)
    question = _question_on_load(recording, in_lines)
    require(
        loads,
        f"{recording.place}: force or pressure must be known, got neither from a column, the lines"
        f" above the table or the name{question}. Give --forces-N or --pressures-bar, one for each"
        " test in the order of files and sheets, or a [[test]] in --layout.",
    )
    return loads


def _question_on_load(recording: Recording, in_lines: Sequence[LoadInLine]) -> str:
    """Return a question to the user on a name or line that may state the load of a test.

    ``in_lines`` are the loads in the lines above the table. The question is empty if neither a name
    nor a line may state the load.
    """
    if load_is_ambiguous(recording.names()):
        return f" (which number does {recording.title!r} mean?)"
    lines = [(load.line, load.text) for load in in_lines]
    if not lines:
        lines = lines_with_unread_load(recording.heading.lines_above)
    if not lines:
        lines = lines_with_preload(recording.heading.lines_above)
    if not lines:
        return ""
    line, text = lines[0]
    return f" (is {text[:TEXT_SHOWN]!r} in line {line} the load?)"


def _check_force_is_positive(
    recording: Recording, key: str, value: float, column_value: float | None
) -> None:
    """Raise an `InputError` with the line of a force that is zero or negative.

    ``value`` is the load of the test, in the unit with which the field ``key`` ends, and
    ``column_value`` the value of its column, or None. The line of a force that the user states, or
    that a name states, is not known; later code raises an error for such a force.
    """
    if key != "force_N" or value > 0.0:
        return
    line: int | str | None = None
    if column_value is not None:
        line = recording.lines[0]
    elif recording.stated_value(key) is None and recording.statements.get(key):
        line = recording.statements[key][0].line
    if line is not None:
        raise InputError(
            f"{recording.place}, line {line}: {key} must be greater than 0, got {value:g} N."
            " Correct it."
        )


def _load_of_lines(recording: Recording, in_lines: Sequence[LoadInLine]) -> dict[str, float]:
    """Return the load of a test from lines such as ``238 N``, without a word for force or pressure.

    ``in_lines`` are the loads in the lines above the table. The load is noted as an assumption. The
    result is empty if there is no load, if the loads differ, or if one of them may be something
    other than the load of the test.
    """
    load = load_of_lines(in_lines)
    if load is None:
        return {}
    reason = quoted_line(load.line, load.text, longest=TEXT_SHOWN)
    value_and_unit = f"{load.value:.6g} {UNITS_SHOWN[load.key]}"
    recording.note(load.key, value_and_unit, reason, option_for(load.key))
    return {load.key: load.value}


def _constant_load(recording: Recording, key: str) -> float | None:
    """Return the force [N] or pressure [bar] of a test from its column; None if there is no column.

    If all values in the column are equal, this value is returned. If they vary like measured values
    (see `_is_measured`), their mean is returned, and a note says so. If they vary in any other way,
    an `InputError` is raised. ``key`` is force_N or pressure_bar. ``recording`` holds the rows of
    the test in its file, and everything that the file or the user states about the test.
    """
    role = LOAD_ROLES[key]
    unit = UNITS_SHOWN[key]
    if role not in recording.numbers:
        return None
    if not is_unit_stated(recording, role):
        _check_unit_of_loads(recording, key, "its column")
    values = recording.numbers[role] * unit_size(recording, role, unit)
    tolerance = _CONSTANT * max(float(np.abs(values).max()), 1.0)
    different = np.flatnonzero(np.abs(values - values[0]) > tolerance)
    if not different.size:
        return float(values[0])
    extremes = f"{values.min():g} to {values.max():g} {unit}"
    if not _is_measured(values):
        usual_advice = (
            "Name the test of each row in a column (--test-column), or give the nominal value"
            f" ({option_for(key)})."
        )
        advice = _advice_on_loads(recording, key, usual_advice)
        raise InputError(
            f"{recording.place}, line {recording.lines[different[0]]}: {role} must be the same in"
            f" all rows of a test, or vary by at most {100.0 * _LARGEST_VARIATION:g} % around its"
            f" mean from row to row, got {extremes}. {advice}"
        )
    mean = float(f"{values.mean():.{_DIGITS_OF_MEAN}g}")
    reason = f"its column varies from {extremes}"
    recording.note(key, f"{mean:g} {unit}, the mean", reason, option_for(key))
    return mean


def _advice_on_loads(recording: Recording, key: str, usual_advice: str) -> str:
    """Return advice for a user in whose file the rows of one test have different loads.

    The rows with one load may be a test of their own if they follow each other and if all rows of
    the file have the same direction. The advice then says which option splits the rows into tests
    by their load. Otherwise, the advice is that of `_advice`. ``key`` is force_N or pressure_bar.
    """
    header = recording.heading.headers[recording.heading.roles[LOAD_ROLES[key]]]
    is_one_direction = len(recording.direction_words) < 2
    may_name_tests = "test" not in recording.layout.columns and is_one_direction
    if may_name_tests and header in columns_that_name_tests(recording):
        option = option_for(key)
        return (
            f"If each value is a test, give --test-column '{header}'; if not, give the nominal"
            f" value ({option})."
        )
    return _advice(recording, usual_advice)


def _advice(recording: Recording, usual_advice: str) -> str:
    """Return advice if the rows of one test have different loads or directions.

    In some files, only two columns together name the tests. If the user has stated with the option
    ``--test-column`` that one column names them, the advice is to leave this option out. In all
    other cases, ``usual_advice`` is returned.
    """
    headers = recording.numbering_headers
    if not headers or "test" not in recording.layout.columns:
        return usual_advice
    names = " and ".join(repr(header) for header in headers)
    return f"Only {names} together name tests of one force. Leave --test-column out."


def _advice_on_directions(recording: Recording, senses: Collection[str]) -> str:
    """Return advice for a user whose column of directions does not state the direction of a test.

    ``senses`` are the different directions in the rows of the test: CW, CCW, or words that are not
    understood. If there are several and, in another column, rows with the same text always have the
    same direction, this column may name the tests. The advice is then to state that it does. If
    there is no such column, the advice is that of `_advice`, usually to write CW or CCW into the
    column of directions.
    """
    if "test" not in recording.layout.columns and len(senses) > 1:
        column = recording.heading.roles["direction"]
        words = cells_of(recording, column)
        parting = columns_that_name_tests(recording, [direction_named(word) for word in words])
        if parting and not recording.label:
            return f"Say which column names the test of each row: --test-column '{parting[0]}'."
    if set(senses) == {"CW", "CCW"} and _repeats_angles(recording):
        return _advice(recording, _NAME_TESTS)
    if set(senses) <= {"CW", "CCW"}:
        return _advice(recording, _WRITE_DIRECTIONS)
    return _advice(recording, _WORDS_FOR_DIRECTIONS)


def _repeats_angles(recording: Recording) -> bool:
    """Return whether most angles of a test occur more than once, as those of several circles do."""
    column = recording.heading.roles.get("angle")
    return column is not None and are_repeated(cells_of(recording, column))


def _is_measured(values: Array) -> bool:
    """Return whether the loads of the rows of a test, shape (n,), vary as measured loads do.

    Loads are forces [N] or pressures [bar]. Measured loads stay near their mean and change often.
    Nominal loads change only where the next test in the table begins. ``values`` are the loads of
    the rows.
    """
    mean = float(values.mean())
    largest_deviation = float(np.abs(values - mean).max())
    n_changes = int(np.count_nonzero(np.diff(values)))
    is_small = largest_deviation <= _LARGEST_VARIATION * abs(mean)
    return is_small and n_changes * _ROWS_OF_CHANGE >= len(values)


class _StatedSenses(NamedTuple):
    """Directions of travel, CW and CCW, that a source outside the table states."""

    senses: set[str]  # stated directions of travel: CW, CCW, both or none
    source: str | CitedLine  # place that states the direction of travel, such as "line 3"


def _directions_above(recording: Recording) -> _StatedSenses:
    """Return the directions of travel from the first source outside the table that states any.

    There are three sources, which are tried in this order:

    - lines above and below the table, and names of the test, its column, its sheet or its file,
    - G-code in lines above the table,
    - sheets without a table.

    If G-code or sheets without a table state both directions, the two directions belong to
    different circles and are not used.
    """
    lines_above = recording.heading.lines_above
    names = [name for name in recording.names() if not name_is_about_angles(name)]
    senses = directions_stated([*lines_above, *recording.lines_around], names)
    if senses:
        return _StatedSenses(senses, _source_of_direction(recording))
    arcs = programmed_arcs(lines_above)
    senses = {arc.direction for arc in arcs}
    if len(senses) == 1:
        return _StatedSenses(senses, cited_line(arcs[0].line))
    senses = directions_stated(recording.lines_of_all_tests)
    if len(senses) != 1:
        senses = set()
    return _StatedSenses(senses, "a sheet without a table")


def _source_of_direction(recording: Recording) -> str:
    """Return a text for messages that says where a file states the direction of travel.

    There are five places: a list of tests on another sheet, a line above the table, a line below
    the table, a text beside the table, and a name, such as that of the file. ``recording`` stores
    the entries of a list of tests together with the lines above the table. Such an entry has no
    line number, but a text such as "3 of notes.txt" (line 3 of that file).
    """
    for line, text in recording.heading.lines_above:
        if directions_stated([(line, text)]):
            if isinstance(line, str):
                return "the list of tests on another sheet"
            return "a line above the table"
    if directions_stated(recording.lines_below):
        return "a line below the table"
    if directions_stated(recording.lines_beside):
        return "a text beside the table"
    return "the name"


def _sense_beside_its_opposite(recording: Recording) -> set[str]:
    """Return the direction CW or CCW of a column such as ``rechts`` beside a column ``links``.

    The result is empty if the name of the column of readings is no word for a direction, or if no
    other column of the table is named after the opposite direction.
    """
    column = recording.heading.roles.get("reading")
    if column is None:
        return set()
    senses_of_columns = [senses_of_header(unit_of(name).name) for name in recording.heading.headers]
    senses = senses_of_columns[column]
    opposite = {"CW", "CCW"} - senses
    return senses if len(senses) == 1 and opposite in senses_of_columns else set()


def _check_ways_are_stated(recording: Recording) -> None:
    """Raise an error for a column such as ``Forward`` beside a column ``Backward``.

    Both name a direction of travel, but do not say which of them is clockwise.
    """
    column = recording.heading.roles.get("reading")
    if column is None:
        return
    headers = recording.heading.headers
    ways = [_WAYS.get(comparable(unit_of(header).name)) for header in headers]
    way = ways[column]
    if way is None or -way not in ways:
        return
    opposite = headers[ways.index(-way)]
    raise InputError(
        f"{recording.place}: direction must be CW or CCW, got column {headers[column]!r} beside"
        f" {opposite!r}. Write CW and CCW into their headers, or give direction in a [[test]] of"
        " --layout."
    )


def _contradiction_of(senses: set[str]) -> str:
    """Return a text which says that a file contradicts the direction of travel the user gave.

    The text becomes part of a note.

    ``senses`` are the directions in the file: CW, CCW, or words that are not understood.
    """
    unread = sorted(senses - {"CW", "CCW"})
    if unread:
        return f"the file says {', '.join(unread)[:TEXT_SHOWN]!r}, not understood"
    return "the file says the other"


def direction_of(recording: Recording) -> str | None:
    """Return the direction of travel of a test, CW or CCW; None if nothing states it.

    There are six sources, which are tried in this order:

    - the user,
    - the column of directions,
    - lines above and below the table, and names of the test, its column, its sheet or its file,
    - G-code in lines above the table,
    - sheets without a table,
    - the name of a column, such as "right", beside one with the opposite name.

    The first source that states a direction is used. G-code and sheets without a table that state
    both directions are ignored. If another source states both directions, an `InputError` is
    raised. It is also raised if the column has a word that means neither direction. ``recording``
    holds the rows of the test in its file, and everything that the file or the user states about
    the test.
    """
    column_senses: dict[str, int] = {}
    for word, line in recording.direction_words.items():
        if word:
            column_senses.setdefault(direction_named(word), line)
    senses = set(column_senses)
    source: str | CitedLine = "the column of directions"
    if not senses:
        above = _directions_above(recording)
        senses = above.senses
        source = above.source
    if not senses:
        senses = _sense_beside_its_opposite(recording)
        source = "the name"
    stated: str | None = recording.stated_value("direction")
    if stated is not None:
        if senses - {stated}:
            reason = _contradiction_of(senses)
            recording.note("direction", f"{stated}, as given", reason, "--direction")
        return stated
    if len(column_senses) > 1 or set(column_senses) - {"CW", "CCW"}:
        words = ", ".join(sorted(column_senses))
        raise InputError(
            f"{recording.place}, line {max(column_senses.values())}: direction must be CW or CCW in"
            f" all rows of a test, got {words[:TEXT_SHOWN]!r}."
            f" {_advice_on_directions(recording, column_senses)}"
        )
    require(
        len(senses) <= 1,
        f"{recording.place}: direction must be said once, got CW and CCW above the table or in"
        " names. Give --direction if all tests ran alike, or direction in a [[test]] of --layout.",
    )
    if not senses:
        check_direction_is_clear(recording.place, recording.lines_outside)
        _check_ways_are_stated(recording)
        return None
    direction = senses.pop()
    if not column_senses:
        recording.note("direction", direction, source, "--direction")
    return direction
