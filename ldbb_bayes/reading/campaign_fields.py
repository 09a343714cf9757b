"""Fields of a campaign, set to the values that imported files state, or else to assumed values."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ldbb_bayes.campaign.campaign import LABELS, CircularTest, ForceLaw, MountCompensation
from ldbb_bayes.campaign.circle_preview import resolution_of
from ldbb_bayes.errors import InputError, require
from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.reading.assumptions import NOTHING_STATED, AssumptionLog, shown_list
from ldbb_bayes.reading.cited_lines import CitedLine, cited_line, quoted_line, with_words
from ldbb_bayes.reading.machines_in_names import check_names_are_of_one_machine
from ldbb_bayes.reading.names import plane_in_name
from ldbb_bayes.reading.planes import PLANE_OF_SWAPPED, check_plane
from ldbb_bayes.reading.recording import FIELDS_OF_MACHINE, UNITS_SHOWN, Recording, option_for

__all__ = ["find_resolution", "note_assumed_fields", "take_stated_fields"]

# Command-line options for the fields of the campaign that lines above a table may state. The keys
# are the fields.
_OPTIONS = {
    "plane": "--plane",
    "resolution_um": "--resolution-um",
    "mount": "--raw, --mount-um-per-bar",
    "feed_mm_per_min": "--feed-mm-per-min",
    **{key: option_for(key) for key in LABELS},
}
# Fields that may differ between the tests of a campaign. Files may state them for each test.
_FIELDS_OF_EACH = ("plane", "date")
# Fields of a campaign that name people, places and instruments. If the files state several values
# for one of these fields, the campaign lists all of the values.
_NAMES = ("operator", "place", "ball_bar", "force_device")
# Fields of a campaign for which files may state different values. For any other field, different
# values are an error.
_MAY_DIFFER = (*_NAMES, "ball_bar_calibrated", "feed_mm_per_min")
# Two numbers that are stated for one field count as equal if they agree when rounded to this number
# of decimals.
_COMPARED_PLACES = 9
# Smallest step [µm] between readings that is accepted as the resolution of a readout.
_SMALLEST_STEP_UM = 0.001
# Largest step [µm] between readings that is accepted as the resolution of a readout.
_LARGEST_STEP_UM = 5.0
# Largest step between readings that is accepted as the resolution of a readout, as a fraction of
# the range of the readings.
_LARGEST_STEP_SHARE = 0.1
# If a test states both a force and a pressure, the stated force is compared with the force that the
# default `ForceLaw` gives for the pressure. A note is made if they differ by more than this
# fraction of the stated force.
_OFF_FORCE_LAW = 0.05
# Values that are assumed for unstated fields of the campaign. The keys are the fields. Each entry
# is a pair: the value, and the command-line option that states the field.
_ASSUMED = {
    "topology": ("wCAFYXZSt", "--topology"),
    "plane": ("XY", "--plane"),
    "radius_mm": ("150 mm", "--radius-mm"),
    "resolution_um": ("0.24 µm", "--resolution-um"),
    "mount": ("readings compensated for its deflection", "--raw"),
}
# Regular expression for words of a line that state the usual radius of 150 mm. Words about a
# diameter do not match.
_USUAL_RADIUS = re.compile(
    r"(?!.*(?:diam|durchm|[ØøΦ⌀]|\bD\W*\d))\D*(?<![.,])150(?:[.,]0+)?\s*(?:mm)?\W*", re.IGNORECASE
)


class _StatedValue(NamedTuple):
    """Value of a field, and the place in a file where it is stated."""

    value: Any
    source: str | CitedLine  # line or name that states the value of the field, such as "line 3"
    # words by which error messages name the place where the value is stated, such as "its name"; if
    # the place is a line, they also name the file, as in "line 3 of …"
    place: str


def take_stated_fields(campaign: dict[str, Any], recordings: Sequence[Recording]) -> None:
    """Fill in fields of a campaign and its tests from the files, unless options have set them.

    Lines above a table and in sheets without a table may state any of these fields. Columns whose
    cells are all equal may state the feed, lines below a table the deflection of the mount, and
    names of files, sheets, columns and tests the plane. Every value that is taken from a file is
    noted in the log. Lines and names are not used for a test if the user or the column of the field
    states the value; the log notes a contradiction.

    Planes and temperatures become fields of each test. The other fields become fields of the
    campaign, and so does the plane if it is the same for all tests. So does the feed that the user
    states for the tables. A feed that differs between tests is not stored. If the user states no
    ``machine_id``, the serial number of the machine is used, or else the type of the machine, or
    else None.

    Parameters
    ----------
    campaign
        Fields of the campaign for which the user has set an option. The fields found in the files
        are added.
    recordings
        Rows and statements of each test in the files. The planes and temperatures of the tests are
        added.

    Raises
    ------
    InputError
        If statements about a field contradict each other, if names number several machines, if a
        plane is unknown, or if a line says that readings are raw although the user states that they
        are compensated for the deflection of the mount.
    """
    for key in _OPTIONS:
        places = _places_by_value(recordings, key)
        if key == "plane" and not _is_common_plane(recordings, places):
            continue
        if places:
            _take_field(campaign, key, list(places))
    check_names_are_of_one_machine(recordings, campaign)
    machine_id = campaign.get("serial_number") or campaign.get("machine_type")
    campaign.setdefault("machine_id", machine_id)
    for recording in recordings:
        _take_temperature(recording)


def _places_by_value(recordings: Sequence[Recording], key: str) -> dict[Any, str]:
    """Return a dict that says where the files state values of a field, and which values they state.

    Each key of the dict is a value, and its entry is a text that says which line or name states the
    value. Every value is added to the log of assumptions. If the field is the plane, the value is
    also stored in the fields of the test for which it is stated. If the user or a column of the
    table states the field for a test, lines and names are not used for this test, and the log only
    notes if they contradict the user or the column. A feed that the user states is a key of the
    dict, too. Raise an `InputError` for contradictory statements or an unknown plane.

    Parameters
    ----------
    recordings
        Rows and statements of each test in the files.
    key
        Name of the field.
    """
    places: dict[Any, str] = {}
    for recording in recordings:
        values = _stated_values(recording, key)
        certain = _certain_value(recording, key)
        if certain is not None:
            if key == "plane":
                certain = _plane_of_column(recording, certain)
            _note_contradictions(recording, key, certain, values)
            if key == "feed_mm_per_min":
                # The user states the feed for the tables, not as a field of the campaign.
                places[certain] = "as given"
            continue
        places_of_test = {value: stated.place for value, stated in values.items()}
        places |= places_of_test
        if key in _FIELDS_OF_EACH:
            _check_stated(recording, key, places_of_test)
        else:
            _check_stated(recording, key, places)
        for stated in values.values():
            _note_stated(recording, key, stated)
    return places


def _note_stated(recording: Recording, key: str, stated: _StatedValue) -> None:
    """Add to the log of assumptions the value that a file states for a field of a test.

    ``key`` is the name of the field. A plane is also added to the fields of the test. ``stated`` is
    the value, with the place in the file that states it.
    """
    recording.note(key, _with_unit(key, stated.value), stated.source, _OPTIONS[key])
    if key == "plane":
        recording.fields[key] = stated.value


def _with_unit(key: str, value: Any) -> str:
    """Return the value of a field of a campaign as text, with its unit if it is a number.

    An example is ``150 mm``. ``key`` is the name of the field, such as radius_mm.
    """
    if key in UNITS_SHOWN:
        return f"{value:g} {UNITS_SHOWN[key]}"
    return str(value)


def _stated_values(recording: Recording, field: str) -> dict[Any, _StatedValue]:
    """Return a dict with the values that a file states for a field of a test.

    Each key is a stated value, such as 150.0. The item of a key holds the value again, and the
    place where it is stated. This is a line above the table, a line of a sheet without a table or,
    for some fields, a column with equal cells or a line below the table. A plane may also be stated
    in the name of the test, its column, its sheet or its file. Numbers are rounded, and NaN is left
    out. ``field`` is the name of the field, such as radius_mm.
    """
    values: dict[Any, _StatedValue] = {}
    if field == "plane":
        named = plane_in_name(recording.names())
        lines = [statement.value for statement in recording.statements.get(field, ())]
        # A line with the usual name, ZX, says how a name with swapped letters, XZ, is meant.
        if named is not None and PLANE_OF_SWAPPED.get(named) not in lines:
            values[named] = _StatedValue(named, "its name", "its name")
    for statement in recording.statements.get(field, ()):
        value = statement.value
        if not isinstance(value, str):
            if math.isnan(value):
                continue
            value = round(value, _COMPARED_PLACES)
        source = cited_line(statement.line)
        place = str(source)
        # An error message names the line and its sheet. If the sheet has no table of readings, the
        # text ``line`` already contains the name of the sheet, as in "3 of notes.txt".
        if isinstance(statement.line, int):
            place = f"{source} of {recording.sheet.place}"
        values[value] = _StatedValue(value, source, place)
    return values


def _certain_value(recording: Recording, key: str) -> Any:
    """Return the value that the user or a column of the table states for a field of a test.

    The user's entry [[test]] of the layout comes first, then the column, then the user's options.
    Return None if none of them states the field. ``key`` is the name of the field. The value of
    the field ``mount``, which says whether readings are compensated for the deflection of the
    mount, is returned as the text "compensated" or "raw".
    """
    value = recording.stated.get(key)
    if not value:
        value = recording.fields.get(key)
    if not value:
        value = recording.stated_value(key)
    if not isinstance(value, MountCompensation):
        return value
    if value.compensated:
        return "compensated"
    return "raw"


def _note_contradictions(
    recording: Recording, key: str, certain: Any, values: Mapping[Any, _StatedValue]
) -> None:
    """Add a note to the log on each value in the file that contradicts the user or a column.

    The user or a column of the table states the value ``certain``. The note names a line, or the
    name of a test, column, sheet or file, that states another value. Raise an `InputError` if the
    file states the value "raw" and ``certain`` is another value. For the field ``mount``, "raw"
    means that the readings are not compensated for the deflection of the mount, as the user states.
    The error is raised for every other field too, for example for an operator with the name "raw".

    Parameters
    ----------
    recording
        Rows and statements of the test in its file.
    key
        Name of the field.
    certain
        Value that the user or a column states. It is used whatever the lines and names state.
    values
        Values that lines or names in the file state, each with the place where it is stated.
    """
    compared = certain
    if isinstance(certain, float):
        compared = round(certain, _COMPARED_PLACES)
    different = {value: stated for value, stated in values.items() if value != compared}
    if "raw" in different:
        raise InputError(
            f"{recording.place}: {key} must be said once, got {certain} as given and raw in"
            f" {different['raw'].place}. Correct the line, or give --raw."
        )
    for value, stated in different.items():
        reason = with_words(stated.source, f" says {_with_unit(key, value)}")
        recording.note(key, f"{_with_unit(key, certain)}, as given", reason, _OPTIONS[key])


def _plane_of_column(recording: Recording, plane: str) -> str:
    """Return the plane that the user or a column states for a test.

    ``plane`` is the result of `_certain_value`, and is usually returned unchanged. There is one
    exception: a column may give the letters in the other order, such as XZ for ZX. If the option
    --plane then states the usual name ZX, this name is returned, and it also replaces the plane in
    the fields of the test. The log notes this. If the column and the option state different planes,
    the log notes this, too, and the plane of the column is kept. Raise an `InputError` for an
    unknown plane in the column.
    """
    option = recording.campaign.get("plane")
    column_plane = recording.fields.get("plane")
    if option is not None and column_plane in PLANES and column_plane != option:
        reason = f"--plane says {option}"
        recording.note("plane", f"{column_plane}, its column", reason, "a [[test]] in --layout")
    if option is not None and PLANE_OF_SWAPPED.get(plane) == option:
        recording.note("plane", f"{option}, as given", f"its column says {plane}", "--plane")
        recording.fields["plane"] = option
        return str(option)
    if plane == recording.fields.get("plane"):
        check_plane(recording.place, plane, "its column", "angle" in recording.numbers)
    return plane


def _check_stated(recording: Recording, key: str, places: Mapping[Any, str]) -> None:
    """Raise an `InputError` for an unknown plane, or for contradictory statements about a field.

    Fields such as the operator and the feed may have several values, and cause no error. ``key`` is
    the name of the field. The keys of ``places`` are the values stated for the field. For each
    value, ``places`` holds a text that says where the value is stated.
    """
    if key == "plane":
        for plane, place in places.items():
            check_plane(recording.place, plane, place, "angle" in recording.numbers)
    listed = " and ".join(f"{value} in {place}" for value, place in places.items())
    remedy = f"Correct the lines, or give {_OPTIONS[key]}."
    if key in FIELDS_OF_MACHINE:
        choice = "--sheets with those of one" if recording.sheet.name else "name the files of one"
        remedy = (
            f"Import machines one by one ({choice}). Of one machine, correct the lines, or give"
            f" {_OPTIONS[key]}."
        )
    require(
        len(places) <= 1 or key in _MAY_DIFFER,
        f"{recording.place}: {key} must be said once, got {listed}. {remedy}",
    )


def _is_common_plane(recordings: Sequence[Recording], places: Mapping[Any, str]) -> bool:
    """Return whether files state a single plane and all tests are in this plane.

    ``places`` is a dict. Its keys are the planes that the files state; the value of a key says
    where the plane is stated, as in "line 3 of …" or "its name". If a test has no plane, the result
    is False.
    """
    planes = {recording.fields.get("plane") for recording in recordings}
    return len(places) == 1 and planes == set(places)


def _take_field(campaign: dict[str, Any], key: str, values: Sequence[Any]) -> None:
    """Set the field ``key`` of the campaign from the different values that its files state.

    For the mount, the value becomes a `MountCompensation`. If the files name several people, places
    or instruments, the field lists all of them. The latest of several dates of calibration is used,
    and the earliest of several dates of measurement. If the files state different feeds, the feed
    of the campaign is not set. ``values`` are the different values that the files state.
    """
    if key == "mount":
        campaign[key] = MountCompensation(compensated=list(values) == ["compensated"])
    elif key in _NAMES:
        campaign[key] = ", ".join(values)
    elif key == "ball_bar_calibrated":
        campaign[key] = max(values)
    elif key != "feed_mm_per_min" or len(values) == 1:
        campaign[key] = min(values)


def _take_temperature(recording: Recording) -> None:
    """Set the temperature of a test from the first line that states a temperature.

    The line stands above the table or in a sheet without a table. The log notes the temperature.
    Nothing is done if the user or a column of the table already states the temperature.
    """
    statements = recording.statements.get("temperature_C", ())
    if not statements or "temperature_C" in recording.stated:
        return
    if recording.fields.get("temperature_C") is not None:
        return
    temperature = statements[0]
    recording.fields["temperature_C"] = temperature.value
    recording.note(
        "temperature_C",
        f"{temperature.value:g} °C",
        cited_line(temperature.line),
        "a [[test]] in --layout",
    )


def find_resolution(
    campaign: dict[str, Any], tests: Sequence[CircularTest], log: AssumptionLog
) -> None:
    """Determine the resolution of the bar's readout from the steps between the readings.

    A resolution that the user or a file states is kept. The resolution is determined only if, in
    every test, the readings have a common step that can be the resolution of a readout: 0.001 µm to
    5 µm, and at most a tenth of the range of the readings. The resolution is the smallest of these
    steps over all tests, rounded to three digits.

    Parameters
    ----------
    campaign
        Fields of the campaign, to which the resolution is added.
    tests
        All tests.
    log
        Log to which the resolution is added.
    """
    if "resolution_um" in campaign:
        return
    steps = []
    for test in tests:
        step = resolution_of(test.reading_um)
        largest = min(_LARGEST_STEP_UM, _LARGEST_STEP_SHARE * float(np.ptp(test.reading_um)))
        if not step or not _SMALLEST_STEP_UM <= step <= largest:
            return
        steps.append(step)
    if not steps:
        return
    resolution = float(f"{min(steps):.3g}")
    campaign["resolution_um"] = resolution
    reason = "the smallest step of the readings"
    log.add("", "resolution_um", f"{resolution:g} µm", reason, "--resolution-um")


def note_assumed_fields(
    campaign: Mapping[str, Any],
    tests: Sequence[CircularTest],
    log: AssumptionLog,
    unclear: Mapping[str, str | CitedLine],
) -> tuple[str, ...]:
    """Add to the log the values that are assumed for unstated fields of the campaign.

    Lines that could not be understood are noted, too. If the user states no force law, the default
    law is assumed. Further notes then name the stated forces that do not fit this law, and say that
    unstated forces are computed with it.

    Parameters
    ----------
    campaign
        Fields of the campaign that are stated.
    tests
        All tests.
    log
        Log to which the assumptions are added.
    unclear
        Notes on lines that could not be understood; the keys are the fields that they concern.

    Returns
    -------
    Names of the fields for which values are assumed.
    """
    reasons = dict(unclear)
    assumed = []
    for key, (value, option) in _ASSUMED.items():
        if key in campaign:
            continue
        if key in ("radius_mm", "plane") and all(getattr(test, key) for test in tests):
            continue
        reason = reasons.pop(key, NOTHING_STATED)
        if key == "radius_mm" and isinstance(reason, CitedLine):
            reason = _without_doubt(reason)
        log.add("", key, value, reason, option)
        assumed.append(key)
    for key, reason in reasons.items():
        log.add("", key, "not taken from there", reason, option_for(key))
    if "force_law" not in campaign:
        _note_force_law(tests, log)
    return tuple(assumed)


def _without_doubt(reason: CitedLine) -> CitedLine:
    """Remove, from a note on a length of 150 mm, the remark that the length is not used.

    ``reason`` is the note. It cites a line with a length that may be the radius, such as ``R=150``.
    A radius of 150 mm is assumed anyway, so that the remark would mislead. If the length is not
    150 mm, the note is returned unchanged.
    """
    if _USUAL_RADIUS.fullmatch(reason.quoted):
        return quoted_line(reason.line, reason.quoted)
    return reason


def _note_force_law(tests: Sequence[CircularTest], log: AssumptionLog) -> None:
    """Add notes on how the forces and pressures of the tests fit the default force law.

    The law gives the force of the ball bar as a linear function of the pressure. If a test states
    both a force and a pressure, the stated force is compared with the force that the law gives for
    the pressure. One note lists all tests in which they differ by more than 5 %. If any tests state
    only a pressure, one note says that their forces are computed with the law.
    """
    law = ForceLaw()
    options = "--force-slope, --force-offset"
    stated = []
    by_law = []
    for test in tests:
        if test.force_N is None or test.pressure_bar is None:
            continue
        force_by_law = law.force_N(test.pressure_bar)
        if abs(force_by_law - test.force_N) > _OFF_FORCE_LAW * abs(test.force_N):
            stated.append(f"{test.force_N:g} N at {test.pressure_bar:g} bar")
            by_law.append(f"{force_by_law:.4g} N")
    if stated:
        forces = shown_list(stated)
        reason = f"of the pressures the force law makes {shown_list(by_law)}"
        log.add("", "force", forces, reason, options)
    if any(test.force_N is None for test in tests):
        words = f"{law.slope_N_per_bar:g} N/bar × pressure − {-law.offset_N:g} N"
        log.add("", "force", words, "pressure alone is given", options)
