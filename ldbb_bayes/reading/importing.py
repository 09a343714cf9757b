"""Import of foreign files as a campaign.

Foreign files are tables that were not written by this package, such as spreadsheets and exports of
instruments. They may have any format. Values that the files do not state are assumed, and each
assumption is noted.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.campaign.text_decoding import EmptyFileError
from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.assumptions import LIST_SHOWN, AssumptionLog, shown_list
from ldbb_bayes.reading.campaign_fields import (
    find_resolution,
    note_assumed_fields,
    take_stated_fields,
)
from ldbb_bayes.reading.circle_centre import take_centres, without_centre
from ldbb_bayes.reading.cited_lines import CitedLine, quoted_line
from ldbb_bayes.reading.columns_of_tests import advice_on_tests
from ldbb_bayes.reading.companion_files import or_left_out
from ldbb_bayes.reading.converted_loads import note_converted_loads
from ldbb_bayes.reading.derived_tests import check_no_test_is_derived
from ldbb_bayes.reading.diameters import halve_readings_of_diameter
from ldbb_bayes.reading.file_patterns import matching
from ldbb_bayes.reading.force_laws import check_force_law
from ldbb_bayes.reading.half_circles import MeasuredArc, join_half_circles
from ldbb_bayes.reading.import_result import Imported
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.lines_above import (
    Lines,
    not_understood,
    statements_in,
    unknown_length,
)
from ldbb_bayes.reading.loads_above import with_loads_in_header
from ldbb_bayes.reading.log_start import check_feed_is_whole
from ldbb_bayes.reading.mount_statement import check_mount_is_clear, unread_mount
from ldbb_bayes.reading.names import unknown_length_in_name
from ldbb_bayes.reading.open_corrections import check_readings_are_corrected
from ldbb_bayes.reading.paired_columns import split_pairs
from ldbb_bayes.reading.planes import take_plane_option, unread_plane
from ldbb_bayes.reading.possible_radii import check_radius_is_possible, check_unit_of_radius
from ldbb_bayes.reading.recording import LOAD_LISTS, LOAD_ROLES, Recording, option_for
from ldbb_bayes.reading.removed_means import check_mean_is_not_removed
from ldbb_bayes.reading.repeated_readings import note_repeated_readings, note_repeated_zeros
from ldbb_bayes.reading.runs_above import with_runs_in_header
from ldbb_bayes.reading.setups import note_assumed_setup
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.sheet_selection import SheetSelection, note_left_out, select_sheets
from ldbb_bayes.reading.splitting import layout_names, split_sheet
from ldbb_bayes.reading.spreadsheet import read_sheets
from ldbb_bayes.reading.start_times import take_start_times
from ldbb_bayes.reading.stated_values import direction_of, loads_of, quantity_of
from ldbb_bayes.reading.trace import trace_of
from ldbb_bayes.reading.travel_direction import unread_direction
from ldbb_bayes.reading.unit_guess import assume_units
from ldbb_bayes.reading.unstated import note_unstated

__all__ = ["import_campaign"]

# Largest number of tests in a campaign.
LARGEST_TESTS = 1000


def import_campaign(
    files: Sequence[str | os.PathLike[str]] | str | os.PathLike[str],
    *,
    layout: Layout | None = None,
    **campaign: Any,
) -> Imported:
    """Return a campaign from tables in files of any kind.

    A file, or a sheet of a workbook, holds one or several tests. If it holds several tests, either
    a column names the test of each row, or there is one column of readings for each test. What the
    layout does not state is determined from the files and noted.

    Parameters
    ----------
    files : str, os.PathLike, or sequence of them
        CSV or other text files, and workbooks (XLSX, XLS, ODS); names may be patterns with ``*``
        and ``?``.
    layout : Layout, optional
        Layout with which the tables are to be read. If None, the layout is determined from the
        files.
    **campaign : object
        Values for fields of `Campaign`, such as ``radius_mm=150`` or ``plane="XY"``. They replace
        what the files state.

    Returns
    -------
    Imported
        The campaign, the layout with which the files can be read again, and all assumptions.

    Raises
    ------
    InputError
        If a file cannot be read. The message names the file and the line, and says what to do.

    Examples
    --------
    >>> angle_deg = np.arange(0.0, 360.0, 5.0)
    >>> table = np.column_stack([angle_deg, np.cos(np.deg2rad(2.0 * angle_deg))])
    >>> np.savetxt("36 N.csv", table, header="angle [deg];reading [um]", delimiter=";", comments="")
    >>> imported = lb.import_campaign("36 N.csv", radius_mm=100.0)
    >>> imported.campaign
    <Campaign 36 N: 1 tests, 36 to 36 N, 72 readings>
    >>> [assumption.value for assumption in imported.assumptions if assumption.what == "force_N"]
    ['36 N']
    """
    if layout is None:
        layout = Layout()
    take_plane_option(campaign)
    log = AssumptionLog()
    named = [files] if isinstance(files, str | os.PathLike) else list(files)
    paths = matching(named)
    matched = set(paths) - {Path(file) for file in named}
    selection = _select_tables(paths, matched, layout, log)
    recordings = _split_into_tests(selection, layout, campaign, log)
    note_left_out(selection.left_out, _sheets_that_list_tests(recordings), log)
    for recording in recordings:
        check_feed_is_whole(recording)
    _check_lines(recordings, campaign)
    loads = _stated_loads(recordings, layout)
    take_stated_fields(campaign, recordings)
    columns_of_times = take_start_times(campaign, recordings, log)
    _note_unused_columns(recordings, columns_of_times, log)
    _take_conditions_of_all(recordings, loads, log)
    take_centres(recordings)
    _check_directions(recordings, campaign)
    assume_units(recordings, campaign)
    arcs = [_measured_arc(recording) for recording in recordings]
    tests = _name_tests(join_half_circles(arcs))
    _check_names_differ(tests, paths)
    _note_unused_entries(recordings, layout, log)
    find_resolution(campaign, tests, log)
    lines_of_all_tests = recordings[0].lines_of_all_tests
    _note_unused_loads(lines_of_all_tests, log)
    unclear: dict[str, str | CitedLine] = {**not_understood(lines_of_all_tests)}
    for recording in recordings:
        unclear = _not_understood_of(recording) | unclear
    for key in _fields_without_doubt(recordings, tests):
        unclear.pop(key, None)
    assumed = note_assumed_fields(campaign, tests, log, unclear)
    note_unstated(recordings, tests, layout, log)
    campaign.setdefault("name", _campaign_name(paths))
    imported = Campaign(tuple(tests), **campaign)
    note_assumed_setup(imported, tests, log)
    return Imported(imported, log.layout(layout), log.assumptions(), assumed)


def _fields_without_doubt(
    recordings: Sequence[Recording], tests: Sequence[CircularTest]
) -> list[str]:
    """Return the fields whose values are known even if a line about them is not understood.

    These are the force or the pressure if it is known for all tests, and the direction of travel if
    the user states it for all tests. If a line about such a field is not understood, no separate
    note is written; the line is only listed with the texts that are not used.
    """
    fields = [key for key in LOAD_ROLES if all(getattr(test, key) is not None for test in tests)]
    if all(recording.stated_value("direction") is not None for recording in recordings):
        fields.append("direction")
    return fields


def _not_understood_of(recording: Recording) -> dict[str, str | CitedLine]:
    """Return a dict with notes on those lines that may state a field but are not understood.

    The fields are the plane, the radius and the direction of the test, and the field ``mount``:
    whether the readings are compensated for the deflection of the mount. The keys of the dict are
    the names of the fields, such as ``radius_mm``. A note on the radius may also be about a column
    with the same content in every row, or about a name: of the test, its column, its sheet or its
    file.
    """
    lines_above = recording.heading.lines_above
    notes: dict[str, str | CitedLine | None] = {}
    unread = unread_direction(recording.lines_outside)
    if unread is not None:
        notes["direction"] = quoted_line(unread.line, unread.text, "not understood")
    if "mount" not in recording.statements:
        notes["mount"] = unread_mount([*lines_above, *recording.lines_around])
    if recording.fields.get("plane") is None:
        notes["plane"] = unread_plane([*recording.lines_of_all_tests, *lines_above])
    if recording.fields.get("radius_mm") is None:
        lines = [(line, without_centre(text)) for line, text in lines_above]
        length = unknown_length([*lines, *recording.constant_columns])
        notes["radius_mm"] = length or unknown_length_in_name(recording.names())
    return {key: note for key, note in notes.items() if note}


def _select_tables(
    paths: Sequence[Path], matched: set[Path], layout: Layout, log: AssumptionLog
) -> SheetSelection:
    """Return the sheets of all files, sorted into sheets with a table of readings and other sheets.

    ``matched`` are the paths of the files that were found by a pattern with ``*`` or ``?``. These
    files need not have a table.
    """
    sheets = []
    for path in paths:
        for sheet in _sheets_of_file(path, layout, is_only_file=len(paths) == 1):
            named = with_runs_in_header(with_loads_in_header(sheet))
            sheets += split_pairs(named, layout)
    return select_sheets(sheets, layout, log, matched)


def _sheets_of_file(path: Path, layout: Layout, is_only_file: bool) -> list[Sheet]:
    """Return the sheets of a file.

    If the file cannot be read and other files are imported too, the error message advises leaving
    this file out. ``is_only_file`` states whether the file is the only imported file.
    """
    try:
        return read_sheets(
            path, encoding=layout.encoding, separator=layout.separator, sheets=layout.sheets
        )
    except EmptyFileError:
        raise
    except InputError as error:
        if is_only_file or not path.exists():
            raise
        raise or_left_out(error, path) from error


def _split_into_tests(
    selection: SheetSelection, layout: Layout, campaign: Mapping[str, Any], log: AssumptionLog
) -> list[Recording]:
    """Return the tests of all sheets with a table, in the order of files, sheets and rows.

    ``campaign`` are the fields of the campaign that the user's options set. ``selection`` holds the
    sheets with a table and the sheets without one.
    """
    recordings: list[Recording] = []
    for sheet, heading in selection.tables:
        recordings += split_sheet(sheet, heading, layout, campaign, log, selection.left_out)
        if len(recordings) > LARGEST_TESTS:
            raise InputError(
                f"{sheet.path}: a campaign must have at most {LARGEST_TESTS} tests, got more."
                " Import fewer at once."
            )
    return recordings


def _sheets_that_list_tests(recordings: Iterable[Recording]) -> set[str]:
    """Return the places (file and sheet) of all lists of tests that were used.

    A list of tests is a sheet or file that describes tests whose tables are elsewhere. The cells
    that describe a test are stored with the lines above the table of the test. Instead of a line
    number, such a cell has a text such as "3 of notes.txt". The words after "of" are the place of
    the list.
    """
    places = set()
    for recording in recordings:
        for line, _ in recording.heading.lines_above:
            _, _, place = str(line).partition(" of ")
            places.add(place)
    return places


def _stated_loads(recordings: Sequence[Recording], layout: Layout) -> dict[str, list[float]]:
    """Return the lists in the layout that state a force or a pressure for each test.

    The keys of the result are ``force_N`` and ``pressure_bar``. A key is left out if the layout has
    no list for it. Raise an `InputError` if a list does not have one number for each test.
    """
    loads = {}
    for key, field_name in LOAD_LISTS.items():
        values = getattr(layout, field_name)
        if not values:
            continue
        titles = ", ".join(recording.title for recording in recordings)
        if len(values) != len(recordings):
            usual_advice = "Give all, in the order of files and sheets."
            advice = advice_on_tests(recordings, len(values)) or usual_advice
            raise InputError(
                f"{option_for(key)} must hold one number for each test, got {len(values)} for"
                f" {len(recordings)} tests ({titles[:LIST_SHOWN]}). {advice}"
            )
        loads[key] = values
    return loads


def _take_conditions_of_all(
    recordings: Sequence[Recording], loads: Mapping[str, Sequence[float]], log: AssumptionLog
) -> None:
    """Set the fields of all tests, such as force and radius; see `_take_conditions`.

    Raise an error if some tests hold numbers that were computed from other tests of the same
    conditions. ``loads`` holds the lists in the layout that state a force or a pressure for each
    test. The log notes from which unit the forces of a column were converted.
    """
    for k, recording in enumerate(recordings):
        loads_of_test = {key: values[k] for key, values in loads.items()}
        _take_conditions(recording, loads_of_test)
    check_no_test_is_derived(recordings)
    note_repeated_readings(recordings)
    note_repeated_zeros(recordings)
    note_converted_loads(recordings, log)


def _take_conditions(recording: Recording, loads: Mapping[str, float]) -> None:
    """Set the fields of a test, such as force and radius, and halve readings of the diameter.

    The values come from the user's options, the layout and the file. They are stored in
    ``recording.fields``, and values that were taken from the file are noted in the log. The entries
    ``file`` and ``start_deg`` of the layout's [[test]] are not fields of the test. The readings of
    the test are halved if they measure the diameter of the circle instead of its radius.

    ``loads`` holds the force or pressure of this test, taken from the lists in the layout. If
    ``loads`` is not empty, it replaces the force and pressure that an entry [[test]] of the layout
    states for this test. Raise an `InputError` if sources contradict each other, if nothing states
    the force or pressure, or if it is unclear whether the readings measure the diameter.
    """
    if loads:
        for key in LOAD_ROLES:
            recording.stated.pop(key, None)
        recording.stated |= loads
    fields = recording.fields
    for key, value in recording.stated.items():
        if key not in ("file", "start_deg"):
            fields[key] = value
    if "name" not in fields:
        fields["name"] = recording.name_of_file(recording.title)
    fields["direction"] = direction_of(recording)
    fields |= loads_of(recording)
    halve_readings_of_diameter(recording)
    fields["radius_mm"] = quantity_of(recording, "radius_mm", fields.get("radius_mm"))
    if recording.stated_value("radius_mm") is None:
        check_radius_is_possible(recording.place, fields["radius_mm"])
        if fields["radius_mm"] is None:
            check_unit_of_radius(recording.place, recording.heading.lines_above)


def _check_lines(recordings: Iterable[Recording], campaign: Mapping[str, Any]) -> None:
    """Raise an error for lines with a force law or a correction, or unclear lines on the mount.

    An error is also raised for readings whose mean was removed.

    A line with a force law is accepted if the user gives the force law as an option. A line about
    the mount is accepted if an option says whether readings contain the deflection of the mount.
    ``campaign`` are the fields of the campaign that the user's options set.
    """
    for recording in recordings:
        for lines in (recording.heading.lines_above, recording.lines_of_all_tests):
            if "force_law" not in campaign:
                check_force_law(recording.place, lines)
        if "mount" not in campaign:
            check_mount_is_clear(recording.place, recording.lines_outside)
        check_readings_are_corrected(recording.place, recording.lines_outside)
        check_mean_is_not_removed(recording)


def _check_directions(recordings: Iterable[Recording], campaign: Mapping[str, Any]) -> None:
    """Raise an error if some tests of a plane state their direction of travel, and others do not.

    ``campaign`` holds the fields of the campaign that are given as options or stated in files.
    """
    stated: dict[Any, Recording] = {}
    unstated: dict[Any, Recording] = {}
    for recording in recordings:
        plane = recording.fields.get("plane") or campaign.get("plane")
        group = unstated if recording.fields["direction"] is None else stated
        group.setdefault(plane, recording)
    for plane, recording in unstated.items():
        if plane not in stated:
            continue
        other = stated[plane]
        raise InputError(
            f"{recording.place}: direction must be stated by all tests of a plane or by none, got"
            f" none here and {other.fields['direction']} in {other.title!r}. Give --direction if"
            " all ran alike, or direction in a [[test]] of --layout."
        )


def _measured_arc(recording: Recording) -> MeasuredArc:
    """Return the angles and readings of one test with its stated fields, such as its force."""
    fields = recording.fields
    trace = trace_of(recording, fields["direction"])
    fields["direction"] = trace.direction
    stated_fields = {key: value for key, value in fields.items() if value is not None}
    return MeasuredArc(recording, stated_fields, trace.angle_deg, trace.reading_um)


def _name_tests(arcs: Iterable[MeasuredArc]) -> list[CircularTest]:
    """Return a circular test for each measured arc, in the same order.

    If an earlier test has the same name, and the sheet or the text file holds several tests, the
    name of the sheet or file is put in front of the name of the test.
    """
    tests: list[CircularTest] = []
    paths_by_name: dict[str, Path] = {}
    for arc in arcs:
        test = arc.to_test()
        recording = arc.recording
        source = _name_of_source(recording, paths_by_name.get(test.name))
        if test.name in paths_by_name and source:
            name = recording.name_of_file(f"{source} {test.name}")
            reason = f"{test.name!r} stands elsewhere too"
            recording.note("name of the test", name, reason, "a [[test]] in --layout")
            test = replace(test, name=name)
        paths_by_name.setdefault(test.name, recording.sheet.path)
        tests.append(test)
    return tests


def _name_of_source(recording: Recording, path_of_name: Path | None) -> str:
    """Return the name of the sheet or text file of a test, if it holds several tests.

    The result is empty if the sheet holds a single test. For a text file with several tables, it is
    also empty if ``path_of_name``, the file of the earlier test with the same name, is this file.
    """
    sheet = recording.sheet
    if recording.label:
        return sheet.title
    is_one_of_several_tables = bool(sheet.separator) and sheet.title != sheet.path.stem
    if is_one_of_several_tables and path_of_name != sheet.path:
        return sheet.path.stem
    return ""


def _check_names_differ(tests: Sequence[CircularTest], paths: Sequence[Path]) -> None:
    """Raise an `InputError` if two tests of the campaign have the same name.

    ``paths`` are the imported files, which the message lists.
    """
    names = set()
    for test in tests:
        if test.name in names:
            listed = ", ".join(str(path) for path in paths)
            raise InputError(
                f"{listed[:LIST_SHOWN]}: tests must bear different names, got {test.name!r}"
                " twice. A file or sheet named twice? Else rename one, or give it a name in a"
                " [[test]] of --layout."
            )
        names.add(test.name)


def _note_unused_columns(
    recordings: Iterable[Recording], columns_of_times: set[str], log: AssumptionLog
) -> None:
    """For each sheet with unused columns, add a note to the log that names these columns.

    ``columns_of_times`` are the headers of the columns that state when the tests were run.
    """
    places = set()
    for recording in recordings:
        place = recording.sheet.place
        headers = [name for name in recording.unused_columns if name not in columns_of_times]
        if headers and place not in places:
            places.add(place)
            reason = "no role is known for them"
            option = "--…-column, or a [[test]] in --layout"
            log.add(place, "columns not used", shown_list(headers), reason, option)


def _note_unused_entries(
    recordings: Iterable[Recording], layout: Layout, log: AssumptionLog
) -> None:
    """Add a note to the log for each entry [[test]] of the layout that belongs to no test.

    An entry [[test]] states fields of a test, such as its force. The key ``file`` of the entry
    holds the label of the test, or the name of its sheet or file.
    """
    names: set[str] = set()
    for recording in recordings:
        names.update(layout_names(recording.sheet, recording.label))
    for entry in layout.test:
        if entry.file not in names:
            reason = "no file, sheet or label of that name"
            log.add("", "[[test]] not used", entry.file[:LIST_SHOWN], reason, "--layout")


def _note_unused_loads(lines: Lines, log: AssumptionLog) -> None:
    """Add a note to the log for each force or pressure that cannot be assigned to a test.

    ``lines`` are the lines of sheets without a table, except the rows of lists of tests. Nothing
    shows to which test a force or pressure in these lines belongs.
    """
    for key, statements in statements_in(lines).items():
        if key not in LOAD_ROLES:
            continue
        unit = key.partition("_")[2]
        for statement in statements:
            sentence = (
                f"line {statement.line} says {statement.value:g} {unit} outside the list of tests"
            )
            reason = CitedLine(sentence, statement.line)
            log.add("", key, "taken for no test", reason, option_for(key))


def _campaign_name(paths: Sequence[Path]) -> str:
    """Return a name for the campaign: the name of its only file, or that of the files' folder."""
    if len(paths) == 1:
        return paths[0].stem
    return paths[0].resolve().parent.name or "campaign"
