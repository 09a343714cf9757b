"""Roles of the columns of a table, determined from the headers and units of the columns.

A role is what a column holds: angle, reading, time, force, pressure, direction or test.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from ldbb_bayes.campaign.campaign import PER_TEST
from ldbb_bayes.errors import InputError, require, suggestion
from ldbb_bayes.reading.header_rows import heads_loads
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.names import load_in_name, load_is_ambiguous
from ldbb_bayes.reading.role_words import has_role
from ldbb_bayes.reading.travel_direction import direction_named, senses_in, senses_of_header
from ldbb_bayes.reading.unit_lines import partner_of_units
from ldbb_bayes.reading.words import LONGEST_NAME, ROLES, UNITS, WORDS, comparable

__all__ = ["ColumnRoles", "find_columns", "names_circle", "names_runs"]

# Regular expression for the name of a column that holds one of several runs, such as "Run 1" or
# "Reading run 1".
_RUN = re.compile(rf"(?P<name>(?:.*\W)?(?:{WORDS['names']['run']}))\W*(?P<number>\d{{1,3}})")
# Roles of columns that hold the load of a test.
_LOADS = ("force", "pressure")
# Regular expression for a header that is the name of a load alone, such as "Radial force".
_NAME_OF_LOAD = re.compile(
    f"(?:{WORDS['numbers']['force_N']['words']})|(?:{WORDS['numbers']['pressure_bar']['words']})",
    re.IGNORECASE,
)
# If the name of a column shows no role, the unit of the column may show one of these roles.
_ROLES_BY_UNIT = ("angle", "reading", "force")
# Regular expression for the header of a column of temperatures.
_TEMPERATURE = re.compile(WORDS["columns"]["temperature"], re.IGNORECASE)
# Regular expression for the header of an angle, such as a tilt, that is not the angle of the bar.
_OTHER_ANGLE = re.compile(rf"(?<![^\W_])(?:{WORDS['columns']['other_angle']})(?![^\W_])", re.I)
# Regular expression for a word that means the angle of the bar, unless it stands beside a load: of
# "300 N position 1", it is a place on the table.
_PLACE_ON_TABLE = re.compile(r"(?<![^\W_])position\w*", re.IGNORECASE)
# Those entries of the file ``words.toml`` that hold words for the radius or the diameter of a
# circle. The file lists the words that this package recognises.
_CIRCLE_WORDS = [
    entry for key, entry in WORDS["numbers"].items() if entry.get("field", key) == "radius_mm"
]
# Names of a column of measured lengths, such as "Ist", beside a column of nominal ones, "Soll".
_ACTUAL = frozenset(WORDS["columns"]["actual"].split())
_NOMINAL = frozenset(WORDS["columns"]["nominal"].split())


@dataclass
class ColumnRoles:
    """Columns of a table by their roles, such as angle, reading or time."""

    #: dict with the index (from 0) of the column for each role; the keys are the roles, such as
    #: angle
    columns: dict[str, int] = field(default_factory=dict)
    #: indices of all columns of readings, from 0; if there are several, each is a separate test
    readings: list[int] = field(default_factory=list)


def find_columns(
    place: str, layout: Layout, headers: Sequence[str], units: Sequence[str] = ()
) -> ColumnRoles:
    """Return which column has which role, such as angle.

    The role of a column is stated by the user in the layout, or else shown by the column's header.

    Parameters
    ----------
    place
        Name of the table in error messages.
    layout
        Layout that the user states.
    headers
        Header of each column; all are empty for a table without a header.
    units
        Unit of each column; empty for a column without a stated unit. If the name of a column shows
        no role, the column gets the role to which its unit belongs, such as angle for deg. This is
        done only if no other column has this role, and no other column without a role has a unit
        that belongs to this role.

    Raises
    ------
    InputError
        If a stated column does not exist, if several columns could have the same role, or if a
        table has a column that names tests, and several columns of readings that neither the user
        states nor directions of travel distinguish. For a table without a header, the layout must
        state the column of readings and the column of angles or times. If it states no column at
        all, the table must have exactly two columns.
    """
    roles = _stated_columns(place, layout, headers)
    if not any(headers):
        return _columns_without_header(place, roles, len(headers))
    names = _with_actual_as_reading(_without_other_content(headers, units), units)
    names_by_role = dict.fromkeys(ROLES, names)
    names_by_role["reading"] = _without_loads(names, units)
    for role in ROLES:
        if role not in roles.columns:
            _find_role(place, role, roles, names_by_role[role])
    for role in _ROLES_BY_UNIT:
        candidates = units
        if role == "angle":
            candidates = _units_of_angles(headers, units, "time" in layout.columns)
        _find_role_by_unit(role, roles, candidates, headers)
    if "angle" not in roles.columns:
        _find_role_by_unit("time", roles, units, headers)
    _settle_time(roles, layout, headers)
    _settle_readings(roles)
    if "test" in roles.columns and not _are_circles_of_each_test(roles.readings, layout, headers):
        test_header = headers[roles.columns["test"]][:LONGEST_NAME]
        raise InputError(
            f"{place}: a table must have one column of readings, or none that names the test, got"
            f" {len(roles.readings)} of readings beside {test_header!r}. Say which:"
            " --reading-column, once for each column if each is a circle of every test."
        )
    return roles


def _are_circles_of_each_test(
    readings: Sequence[int], layout: Layout, headers: Sequence[str]
) -> bool:
    """Return whether each column of readings holds one circle of every test of a table.

    This is so if there is only one column, if the user states all of them, or if there is one for
    each direction of travel, as in ``CW [um]`` and ``CCW [um]``. ``readings`` are the indices of
    the columns of readings, and ``headers`` the headers of all columns.
    """
    if len(readings) < 2 or "reading" in layout.columns:
        return True
    return len(readings) == len(_named_after_directions(readings, headers))


def _without_other_content(headers: Sequence[str], units: Sequence[str]) -> list[str]:
    """Return the headers, with an empty text for each column of units or of temperatures.

    A header such as ``theta_unit`` or ``T [°C]`` could otherwise be taken for the header of a
    column of angles or times. ``units`` holds the unit of each column.
    """
    names = list(headers)
    for column, header in enumerate(headers):
        texts = [header[:LONGEST_NAME]]
        texts += [f"{texts[0]} [{unit}]" for unit in units[column : column + 1]]
        is_temperature = any(_TEMPERATURE.search(text) for text in texts)
        if load_in_name(texts[:1]) is not None and unit_of(header).unit in UNITS["reading"]:
            is_temperature = False  # the remark of a circle, as in "36 N temp. 20 °C [um]"
        if partner_of_units(header) or is_temperature:
            names[column] = ""
    return names


def _without_loads(headers: Sequence[str], units: Sequence[str]) -> list[str]:
    """Return the headers, with an empty text for each column of forces or pressures.

    A header such as ``Radial force [N]``, or ``Radial force`` without a unit, could otherwise be
    taken for the header of a column of readings. A header that states the load of a circle, such as
    ``36 N``, is kept: its column holds readings. ``units`` holds the unit of each column.
    """
    names = list(headers)
    for column, header in enumerate(headers):
        unit = "".join(units[column : column + 1])
        is_load = any(has_role(header, role) and unit in UNITS[role] for role in _LOADS)
        if not unit and _NAME_OF_LOAD.fullmatch(header.strip()):
            is_load = True
        if is_load and load_in_name([header]) is None:
            names[column] = ""
    return names


def _with_actual_as_reading(headers: Sequence[str], units: Sequence[str]) -> list[str]:
    """Return the headers, with ``reading`` in place of ``Actual`` beside a column ``Nominal``.

    Both columns must have a unit of length, and no other header may name readings. ``units`` holds
    the unit of each column.
    """
    names = list(headers)
    bare = [comparable(unit_of(header).name).strip() for header in headers]
    lengths = [k for k, unit in enumerate(units) if unit in UNITS["reading"]]
    actual = [k for k in lengths if bare[k] in _ACTUAL]
    nominal = [k for k in lengths if bare[k] in _NOMINAL]
    is_pair = len(actual) == 1 and len(nominal) == 1
    if is_pair and not any(has_role(unit_of(header).name, "reading") for header in headers):
        names[actual[0]] = "reading"
    return names


def _settle_time(roles: ColumnRoles, layout: Layout, headers: Sequence[str]) -> None:
    """Decide which column holds the time of each reading; this column has the role time.

    If there is a column of angles, the role is removed from ``roles``, unless the layout states the
    column of times. If there is neither a column of angles nor a column of times, the column
    ``time_s`` receives the role. A column ``time_s`` that does not have the role holds the time at
    which each test started. ``headers`` are the headers of all columns.
    """
    if "angle" in roles.columns:
        if "time" not in layout.columns:
            roles.columns.pop("time", None)
    elif "time" not in roles.columns and "time_s" in headers:
        roles.columns["time"] = list(headers).index("time_s")


def _settle_readings(roles: ColumnRoles) -> None:
    """Make the list of the columns of readings and the roles of the columns agree.

    The list is ``roles.readings``. A column in this list loses any other role, such as angle. If
    the list is empty, the column that has the role of reading is added to it.
    """
    for role, column in list(roles.columns.items()):
        if role != "reading" and column in roles.readings:
            del roles.columns[role]
    if not roles.readings and "reading" in roles.columns:
        roles.readings = [roles.columns["reading"]]


def _stated_columns(place: str, layout: Layout, headers: Sequence[str]) -> ColumnRoles:
    """Return the roles of the columns of a table, as far as the user has stated them in the layout.

    ``place`` names the table in error messages, and ``headers`` are the headers of its columns.
    """
    roles = ColumnRoles()
    for role, stated in layout.columns.items():
        if isinstance(stated, list):
            references = stated
        else:
            references = [stated]
        columns = [_column_index(place, role, reference, headers) for reference in references]
        if not columns:
            continue
        roles.columns[role] = columns[0]
        if role == "reading":
            roles.readings = columns
    return roles


def _columns_without_header(place: str, roles: ColumnRoles, width: int) -> ColumnRoles:
    """Return the roles of the columns of a table without a header.

    ``roles`` are the roles that the layout states. If the layout states none, the table must have
    two columns: angle and reading. ``width`` is the number of columns. ``place`` names the table in
    error messages.
    """
    has_abscissa = "angle" in roles.columns or "time" in roles.columns
    if "reading" in roles.columns and has_abscissa:
        return roles
    stated = f"{width} columns"
    if roles.columns:
        stated = "only " + " and ".join(roles.columns)
    require(
        not roles.columns and width == 2,
        f"{place}: a table without a header must have its reading and its angle or time named by"
        f" number, got {stated}. Give --reading-column and --angle-column or --time-column. If a"
        " column names the tests: --test-column; if a line names the columns: --header-line.",
    )
    roles.columns = {"angle": 0, "reading": 1}
    roles.readings = [1]
    return roles


def _find_role(place: str, role: str, roles: ColumnRoles, headers: Sequence[str]) -> None:
    """Find the column whose header names ``role``, such as time, and record it in ``roles``.

    Only columns without a role are considered. If several of them could have the role, an
    `InputError` is raised, unless each of them holds the readings of a separate test. The header of
    such a column of readings is a load, such as ``36 N``, a bare number, or the name of a run, such
    as ``Run 1``. Headers that are names of runs are found when ``role`` is "test". Their columns
    are then recorded as columns of readings, unless columns of readings are already known.

    A column whose header is the name of a field of a test (`PER_TEST`), such as ``force_N``, gets a
    role here only if ``role`` is "reading". Raise an `InputError` if a column of readings holds
    angles. ``place`` names the table in error messages. ``headers`` are the headers of all columns.
    """
    free = _free_columns(role, roles, headers)
    candidates = _candidates(role, free, headers)
    if role == "reading":
        roles.readings = _several_readings(free, candidates, headers)
        _check_are_no_angles(place, [headers[column] for column in roles.readings])
        candidates = roles.readings[:1] or candidates
    if role == "test" and len(candidates) > 1 and _numbered(candidates, headers):
        # Each of the columns "Run 1", "Run 2" holds the readings of one test.
        if not roles.readings and "reading" not in roles.columns:
            roles.readings = candidates
            roles.columns["reading"] = candidates[0]
        return
    if len(candidates) > 1:
        raise _several_candidates(place, role, candidates, headers)
    if not candidates:
        return
    column = candidates[0]
    if role == "reading" or headers[column] not in PER_TEST:
        roles.columns[role] = column


def _free_columns(role: str, roles: ColumnRoles, headers: Sequence[str]) -> list[int]:
    """Return the indices of the columns that have no role yet and may have ``role``.

    If the headers of the readings state loads, as in ``F = 100 N``, all columns with such headers
    hold readings; none of them holds forces or pressures. ``roles`` holds the roles that are
    already known, and ``headers`` the headers of all columns.
    """
    assigned = {*roles.columns.values(), *roles.readings}
    free = [column for column in range(len(headers)) if column not in assigned]
    names_of_readings = [headers[column] for column in roles.readings]
    if role in ("force", "pressure") and load_in_name(names_of_readings) is not None:
        return [column for column in free if load_in_name([headers[column]]) is None]
    return free


def _several_candidates(
    place: str, role: str, candidates: Sequence[int], headers: Sequence[str]
) -> InputError:
    """Return the error for a role that several columns could have.

    ``place`` names the table, and ``candidates`` are the indices of the columns. ``headers`` are
    the headers of all columns.
    """
    names = " and ".join(repr(headers[column][:LONGEST_NAME]) for column in candidates)
    different = {comparable(headers[column]) for column in candidates}
    if role != "reading" and len(different) < len(candidates):
        return InputError(
            f"{place}: one column must hold the {role}, got {names}. Say which by its number,"
            f" one of {_numbers_of(candidates)}: --{role}-column {candidates[0] + 1}."
        )
    advice = ""
    if role == "reading":
        options = " ".join(f"--reading-column {column + 1}" for column in candidates[:3])
        advice = f", or all, each a test of its own: {options}"
        if len(candidates) > 3:
            advice += " …"
    return InputError(
        f"{place}: one column must hold the {role}, got {names}. Say which:"
        f" --{role}-column{advice}."
    )


def _units_of_angles(headers: Sequence[str], units: Sequence[str], is_log: bool) -> list[str]:
    """Return the unit of each column; it is empty if the column cannot hold angles of the bar.

    A column such as ``Tilt [deg]`` cannot hold the angle of the bar. If ``is_log`` is true, no
    column can: the user has then stated a column of times, from which the angles are computed.
    ``headers`` and ``units`` hold the header and the unit of each column.
    """
    units_of_angles = []
    for header, unit in zip(headers, units, strict=False):
        is_other = is_log or _OTHER_ANGLE.search(header[:LONGEST_NAME]) is not None
        units_of_angles.append("" if is_other else unit)
    return units_of_angles


def _find_role_by_unit(
    role: str, roles: ColumnRoles, units: Sequence[str], headers: Sequence[str]
) -> None:
    """Give a role to a free column whose unit fits this role, such as deg for angle.

    A free column is a column without any role. Nothing is done if another column already has the
    role, or if the units of several free columns fit. ``units`` holds the unit of each column. The
    role is recorded in ``roles``. ``headers`` are the headers of all columns.
    """
    if role in roles.columns:
        return
    if role == "reading" and roles.readings:
        return
    free = _free_columns(role, roles, headers)
    in_unit = [column for column, unit in enumerate(units) if unit in UNITS[role]]
    candidates = [column for column in in_unit if column in free]
    if len(candidates) == 1:
        roles.columns[role] = candidates[0]


def _several_readings(
    free: Sequence[int], candidates: Sequence[int], headers: Sequence[str]
) -> list[int]:
    """Return the indices of the columns of readings if there is one such column for each test.

    The header of such a column states the load of the test (``36 N [mm]``), names a run
    (``Run 1``), or is only a number. An ambiguous load such as ``1 238 N`` also counts; it may mean
    1238 N, or 238 N after another number. Two columns also count if their headers name the two
    directions of travel, as in ``CCW [mm]`` and ``CW [mm]``. Return an empty list if the table does
    not have several such columns.

    Parameters
    ----------
    free
        Indices of the columns that have no role.
    candidates
        Indices of the columns in ``free`` whose headers name readings.
    headers
        Header of each column.
    """
    if heads_loads(headers):
        return list(free)
    loaded = []
    for column in free:
        names = [headers[column]]
        if load_in_name(names) is not None or load_is_ambiguous(names):
            loaded.append(column)
    if len(loaded) > 1 and set(candidates) <= set(loaded):
        return loaded
    directed = _named_after_directions(free, headers)
    if directed and set(candidates) <= set(directed):
        return directed
    if len(candidates) > 1 and _numbered(candidates, headers):
        return list(candidates)
    return []


def _named_after_directions(free: Sequence[int], headers: Sequence[str]) -> list[int]:
    """Return the indices of two columns of readings, one for each direction of travel.

    Their headers are directions, as in ``CW [mm]``, right and left, or name a direction beside
    readings, as in ``Deviation CW [mm]``. Return an empty list if there is not exactly one column
    for each direction. ``free`` are the indices of the columns without a role, and ``headers`` the
    headers of all columns.
    """
    directed = []
    directions: list[str] = []
    for column in free:
        name, unit = unit_of(headers[column])[:2]
        senses = senses_of_header(name)
        may_be_readings = direction_named(name) in senses or has_role(name, "reading")
        if len(senses) == 1 and may_be_readings and (not unit or unit in UNITS["reading"]):
            directed.append(column)
            directions += senses
    if sorted(directions) != ["CCW", "CW"]:
        return []
    return directed


def _check_are_no_angles(place: str, headers: Sequence[str]) -> None:
    """Raise an `InputError` if the header of a column of readings names angles.

    An example is ``Angle 238 N (deg)``: each test then has a separate column of angles. ``place``
    names the table, and ``headers`` are the headers of the columns of readings.
    """
    for header in headers:
        name, unit = unit_of(header)
        if has_role(_without_place(name), "angle") or unit in UNITS["angle"]:
            raise InputError(
                f"{place}: a table with several columns of readings must have one column of angles,"
                f" got another: {header[:LONGEST_NAME]!r}. Order the columns as angle, reading,"
                " angle, reading … from the first column on, and leave out --angle-column."
            )


def _numbered(columns: Sequence[int], headers: Sequence[str]) -> bool:
    """Return whether columns are named after runs, such as "Run 1" and "Run 2".

    ``columns`` are the indices of these columns, and ``headers`` the headers of all columns.
    """
    return names_runs([unit_of(headers[column]).name for column in columns])


def names_runs(names: Sequence[str]) -> bool:
    """Return whether names are those of different runs, such as "Run 1" and "Run 2"."""
    numbers = set()
    words = set()
    for name in names:
        match = _RUN.fullmatch(comparable(name))
        if match is None:
            return False
        numbers.add(match["number"])
        words.add(match["name"])
    return len(words) == 1 and len(numbers) == len(names)


def _candidates(role: str, columns: Sequence[int], headers: Sequence[str]) -> list[int]:
    """Return the indices of those ``columns`` whose headers name ``role``, such as time.

    A column whose header is the name of a field of a test (`PER_TEST`), such as ``radius_mm``, is
    returned only if no other column names the role. ``headers`` are the headers of all columns.
    """
    candidates = []
    for column in columns:
        header = unit_of(headers[column])
        # A column "Circle [mm]" holds a length, but a column "Run 1 [mm]" holds the readings of a
        # test.
        is_length = header.unit in UNITS["reading"] and _RUN.fullmatch(header.name.lower()) is None
        name = header.name
        if role == "angle":
            name = _without_place(name)
        if has_role(name, role) and not (role == "test" and is_length):
            candidates.append(column)
    other_columns = [column for column in candidates if headers[column] not in PER_TEST]
    if role == "reading" and other_columns:
        other_columns = _candidates_for_readings(other_columns, columns, headers)
    return other_columns or candidates


def _without_place(name: str) -> str:
    """Return the name of a column without the word "position", if the name states a load."""
    if load_in_name([name]) is None:
        return name
    return _PLACE_ON_TABLE.sub("", name)


def _candidates_for_readings(
    named: Sequence[int], columns: Sequence[int], headers: Sequence[str]
) -> list[int]:
    """Return the indices of those ``columns`` that may hold readings.

    If there is also a column of deviations, a column "Radius" or "Diameter" does not hold readings,
    but the nominal size of the circle. A column "CW [um]" may hold further readings. ``named`` are
    the indices of the columns whose headers name readings, and ``headers`` the headers of all
    columns.
    """
    deviations = [column for column in named if not names_circle(headers[column])]
    candidates = deviations or list(named)
    lengths = _lengths_headed_by_directions(columns, headers)
    return candidates + [column for column in lengths if column not in candidates]


def _lengths_headed_by_directions(columns: Sequence[int], headers: Sequence[str]) -> list[int]:
    """Return the indices of those ``columns`` whose headers are a direction and a unit of length.

    An example is ``CW [um]``. ``headers`` are the headers of all columns.
    """
    lengths = []
    for column in columns:
        name, unit = unit_of(headers[column])[:2]
        if direction_named(name) in senses_in(name) and unit in UNITS["reading"]:
            lengths.append(column)
    return lengths


def names_circle(header: str) -> bool:
    """Return whether a header consists only of a word for the radius or diameter of the circle."""
    name = comparable(unit_of(header).name)
    return any(re.fullmatch(entry["words"], name, re.IGNORECASE) for entry in _CIRCLE_WORDS)


def _column_index(place: str, role: str, reference: str | int, headers: Sequence[str]) -> int:
    """Return the index of the column that the layout states for a role.

    ``reference`` is either the number of the column, counted from 1, or the column's header with or
    without the unit. ``place`` names the table in error messages, and ``headers`` are the headers
    of its columns.
    """
    if isinstance(reference, int):
        require(
            1 <= reference <= len(headers),
            f"{place}: column of the {role} must be 1 to {len(headers)}, got {reference}. Correct"
            " it.",
        )
        return reference - 1
    wanted = comparable(reference)
    matching = [k for k, header in enumerate(headers) if comparable(header) == wanted]
    if not matching:
        wanted = comparable(unit_of(reference).name)
        names = [comparable(unit_of(header).name) for header in headers]
        matching = [k for k, name in enumerate(names) if name == wanted]
    if len(matching) == 1:
        return matching[0]
    if matching:
        raise InputError(
            f"{place}: column of the {role} must be one, got several named {reference!r}. Say which"
            f" by its number, one of {_numbers_of(matching)}: --{role}-column {matching[0] + 1}."
        )
    raise _unknown_column(place, role, reference, headers)


def _numbers_of(columns: Sequence[int]) -> str:
    """Return a text with the numbers of columns, counted from 1: ``2, 3`` for indices 1 and 2."""
    return ", ".join(str(column + 1) for column in columns)


def _unknown_column(place: str, role: str, reference: str, headers: Sequence[str]) -> InputError:
    """Return the error for a column that the user names, but that the table does not have.

    ``reference`` is the header or the number by which the user names the column. ``headers`` are
    the headers of the table.
    """
    candidates = ", ".join(repr(header[:LONGEST_NAME]) for header in headers if header)
    hint = suggestion(reference, headers) if any(headers) else ""
    return InputError(
        f"{place}: column of the {role} must be one of {candidates or 'no header'}, got"
        f" {reference!r} (none such).{hint}"
    )
