"""Fields of the campaign that files state, and values that are assumed for unstated fields."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ldbb_bayes.campaign.campaign import LABELS, CircularTest, ForceLaw, MountCompensation
from ldbb_bayes.campaign.preview import resolution_of
from ldbb_bayes.errors import InputError, require
from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.reading.assumptions import AssumptionLog
from ldbb_bayes.reading.names import plane_in_name
from ldbb_bayes.reading.recording import UNITS_SHOWN, Recording, option_for

__all__ = ["find_resolution", "note_assumed_fields", "take_stated_fields"]

# Fields of the campaign that lines above a table may state, with the options for these fields.
_OPTIONS = {
    "plane": "--plane",
    "resolution_um": "--resolution-um",
    "mount": "--raw, --mount-um-per-bar",
    "feed_mm_per_min": "--feed-mm-per-min",
    **{key: option_for(key) for key in LABELS},
}
# Fields that may differ from test to test.
_FIELDS_OF_EACH = ("plane", "date")
# Fields for people, places and instruments; if several are stated, all are listed.
_NAMES = ("operator", "place", "ball_bar", "force_device")
# Fields for which several different values are no contradiction.
_MAY_DIFFER = (*_NAMES, "ball_bar_calibrated", "feed_mm_per_min")
# Number of decimals to which stated numbers are compared.
_COMPARED_PLACES = 9
# Smallest and largest step that a readout may have [µm].
_SMALLEST_STEP_UM = 0.001
_LARGEST_STEP_UM = 5.0
# Largest step of a readout, as a share of the span of the readings.
_LARGEST_STEP_SHARE = 0.1
# Relative difference from the force law above which stated forces are noted.
_OFF_FORCE_LAW = 0.05
# Values that are assumed for unstated fields, with the options that state these fields.
_ASSUMED = {
    "topology": ("wCAFYXZSt", "--topology"),
    "plane": ("XY", "--plane"),
    "radius_mm": ("150 mm", "--radius-mm"),
    "resolution_um": ("0.24 µm", "--resolution-um"),
    "mount": ("readings compensated for its deflection", "--raw"),
}
# A message shows so many characters of a list.
_LIST_SHOWN = 200


class _StatedValue(NamedTuple):
    """A value of a field, and the place that states it."""

    value: Any
    source: str  # line or name that states the value
    place: str  # the source with its file


def take_stated_fields(campaign: dict[str, Any], recordings: Sequence[Recording]) -> None:
    """Fill unstated fields of the campaign from lines above tables and from names.

    Planes and temperatures are fields of each test; a plane common to all tests, and all other
    fields, are fields of the campaign.

    Parameters
    ----------
    campaign
        Fields of the campaign that options state; fields found in the files are added.
    recordings
        Recordings of the tests; planes and temperatures are added to their fields.
    """
    for key in _OPTIONS:
        places = _places_by_value(recordings, key)
        if key == "plane" and not _is_common_plane(recordings, places):
            continue
        if places:
            _take_field(campaign, key, list(places))
    machine_id = campaign.get("serial_number") or campaign.get("machine_type")
    campaign.setdefault("machine_id", machine_id)
    for recording in recordings:
        _take_temperature(recording)


def _places_by_value(recordings: Sequence[Recording], key: str) -> dict[Any, str]:
    """Return every value that files state for a field, with the place that states it.

    The values are noted as assumptions, and a plane is added to the fields of its test. The
    statements about a test do not count if a user or a column states the field of this test. Raise
    an `InputError` for contradictory statements.

    Parameters
    ----------
    recordings
        Recordings of all tests.
    key
        Name of the field.
    """
    places: dict[Any, str] = {}
    for recording in recordings:
        values = _stated_values(recording, key)
        certain = _certain_value(recording, key)
        if certain is not None:
            _note_contradictions(recording, key, certain, values)
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
    """Note a stated value as an assumption; add a plane to the fields of its test."""
    text = stated.value
    if key in UNITS_SHOWN:
        text = f"{stated.value:g} {UNITS_SHOWN[key]}"
    recording.note(key, text, stated.source, _OPTIONS[key])
    if key == "plane":
        recording.fields[key] = stated.value


def _stated_values(recording: Recording, key: str) -> dict[Any, _StatedValue]:
    """Return the values of a field that lines above a table state, by value.

    A plane may also be stated by the names of test, column, sheet and file.
    """
    values: dict[Any, _StatedValue] = {}
    if key == "plane":
        plane = plane_in_name(recording.names())
        if plane is not None:
            values[plane] = _StatedValue(plane, "its name", "its name")
    for statement in recording.statements.get(key, ()):
        value = statement.value
        if not isinstance(value, str):
            if math.isnan(value):
                continue
            value = round(value, _COMPARED_PLACES)
        source = f"line {statement.line}"
        place = source
        if " of " not in source:
            place = f"{source} of {recording.sheet.place}"
        values[value] = _StatedValue(value, source, place)
    return values


def _certain_value(recording: Recording, key: str) -> Any:
    """Return the value of a field that a user or a column states; None where neither does."""
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
    """Note stated values that differ from the certain one, which a user or a column states.

    A line that calls readings raw while they are said to be compensated is an `InputError`.
    """
    different = {value: stated for value, stated in values.items() if value != certain}
    if "raw" in different:
        raise InputError(
            f"{recording.place}: {key} must be said once, got {certain} as given and raw in"
            f" {different['raw'].place}. Correct the line, or give --raw."
        )
    for value, stated in different.items():
        reason = f"{stated.source} says {value}"
        recording.note(key, f"{certain}, as given", reason, _OPTIONS[key])


def _check_stated(recording: Recording, key: str, places: Mapping[Any, str]) -> None:
    """Raise an `InputError` for contradicting values of a field, and for unknown planes."""
    listed = " and ".join(f"{value} in {place}" for value, place in places.items())
    remedy = f"Correct the lines, or give {_OPTIONS[key]}."
    require(
        len(places) <= 1 or key in _MAY_DIFFER,
        f"{recording.place}: {key} must be said once, got {listed}. {remedy}",
    )
    require(
        key != "plane" or places.keys() <= PLANES.keys(),
        f"{recording.place}: {key} must be one of {', '.join(PLANES)}, got {listed}. {remedy}",
    )


def _is_common_plane(recordings: Sequence[Recording], places: Mapping[Any, str]) -> bool:
    """Return whether only one plane is stated and all tests have it."""
    planes = {recording.fields.get("plane") for recording in recordings}
    return len(places) == 1 and planes == set(places)


def _take_field(campaign: dict[str, Any], key: str, values: Sequence[Any]) -> None:
    """Set a field of the campaign from its stated values.

    All people, places and instruments are listed. Of dates of calibration the latest counts, of
    other dates the earliest. Feeds that differ leave the campaign's feed unset.
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
    """Set the temperature of a test, if unstated, from the first line that states one."""
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
        f"line {temperature.line}",
        "a [[test]] in --layout",
    )


def find_resolution(
    campaign: dict[str, Any], tests: Sequence[CircularTest], log: AssumptionLog
) -> None:
    """Set an unstated resolution to the smallest step of the readings.

    Nothing is set unless the readings of every test have a step that a readout may have.

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
    unclear: Mapping[str, str],
) -> tuple[str, ...]:
    """Note the usual values that are assumed for unstated fields of the campaign.

    Parameters
    ----------
    campaign
        Fields of the campaign that are stated.
    tests
        All tests.
    log
        Log to which the assumptions are added.
    unclear
        Notes of lines that could not be understood, by the field they are about.

    Returns
    -------
    The fields that have their usual values.
    """
    reasons = dict(unclear)
    assumed = []
    for key, (value, option) in _ASSUMED.items():
        if key in campaign:
            continue
        if key in ("radius_mm", "plane") and all(getattr(test, key) for test in tests):
            continue
        log.add("", key, value, reasons.pop(key, "nothing says otherwise"), option)
        assumed.append(key)
    for key, reason in reasons.items():
        log.add("", key, "not taken from there", reason, option_for(key))
    if "force_law" not in campaign:
        _note_force_law(tests, log)
    return tuple(assumed)


def _note_force_law(tests: Sequence[CircularTest], log: AssumptionLog) -> None:
    """Note forces that differ from the usual force law, and that it supplies missing forces."""
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
        forces = ", ".join(stated)[:_LIST_SHOWN]
        reason = f"of the pressures the force law makes {', '.join(by_law)[:_LIST_SHOWN]}"
        log.add("", "force", forces, reason, options)
    if any(test.force_N is None for test in tests):
        words = f"{law.slope_N_per_bar:g} N/bar × pressure − {-law.offset_N:g} N"
        log.add("", "force", words, "pressure alone is given", options)
