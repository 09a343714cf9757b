"""Recognise columns of planes, directions and additional angles by the contents of their cells."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import replace

from ldbb_bayes.errors import InputError
from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.reading.assumptions import AssumptionLog
from ldbb_bayes.reading.header_rows import names_any_role
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.heading import CONDITION_ROLES, Heading
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.numerals import looks_like_number
from ldbb_bayes.reading.planes import PLANE_OF_SWAPPED, PLANES_OF_G_CODE, plane_named
from ldbb_bayes.reading.role_words import has_role
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.travel_direction import direction_named
from ldbb_bayes.reading.words import (
    LONGEST_NAME,
    OTHER_QUANTITY,
    ROLES,
    UNITS,
    comparable,
    unit_named,
    without_accents,
)

__all__ = [
    "check_angle_columns",
    "check_directions",
    "name_plane_column",
    "with_condition_that_names_tests",
]

# All words for a plane, in capitals. The two letters of a plane may be in either order.
_PLANE_CELLS = {*PLANES, *PLANES_OF_G_CODE, *PLANE_OF_SWAPPED}
# Largest number of different cells in a column that states the planes of the circles. If a column
# has more, it does not state planes, even if its header has a word such as "plane".
_MOST_PLANES = 4
# Cells that may mean a direction of travel if the header of their column has a word for travel.
_SIGNS = {"1", "-1", "+1", "+", "-", "−1", "−"}
# Cells that may say whether a direction of travel applies, if the direction heads their column.
_ANSWERS = {"", "0", "1", "x", "y", "n", "yes", "no", "true", "false", "ja", "nein", "oui", "non"}
# Regular expression for a word, such as "travel" or "rotation", in the header of a column that may
# state directions of travel.
_TRAVEL_WORD = re.compile(
    r"(?i)travel|motion|(?<![^\W_])(?:turn|move|run_?dir|rot(?![^\W_]))|rotat|dreh|umlauf|fahrt"
    r"|bahnricht"
)
# Regular expression for the words of a header. A capital also begins a new word, as in PlaneName.
_WORDS = re.compile(r"[A-Z]+(?![a-zäöüß])|[A-Z]?[a-zäöüß]+")
# Regular expression for the word "plane" in several languages, such as German "Ebene".
_PLANE_WORD = re.compile(r"planes?|plan|plano|piano|\w*ebene", re.IGNORECASE)


def with_condition_that_names_tests(
    sheet: Sheet, heading: Heading, cells: Sequence[Sequence[str]], layout: Layout
) -> Heading:
    """Return a heading in which the column that names the tests is also the column of forces.

    An example is the column ``Force [N]`` with cells such as 36 and 200, if the user states that
    it names the tests. The cells of the column must be numbers, and its header must name only the
    force or have a unit of force. A column of pressures, or of directions such as ``CW``, is
    treated in the same way. Any other heading is returned unchanged.

    Parameters
    ----------
    sheet, heading
        The sheet and the heading of its table.
    cells
        Cells of each column.
    layout
        Layout that the user states.

    Raises
    ------
    InputError
        If another column states the force as well, and the user does not say which counts.
    """
    if "test" not in layout.columns:
        return heading
    column = heading.roles["test"]
    header = heading.headers[column]
    for role in CONDITION_ROLES:
        is_stated = role in layout.columns or not _names_only(header, heading.units[column], role)
        if is_stated or not all(_states_condition(role, cell) for cell in cells[column]):
            continue
        other = heading.roles.get(role)
        if other is None:
            return replace(heading, roles=heading.roles | {role: column})
        raise InputError(
            f"{sheet.place}, line {heading.line}: one column must hold the {role}, got"
            f" {header[:LONGEST_NAME]!r} and {heading.headers[other][:LONGEST_NAME]!r}. Say which:"
            f" --{role}-column."
        )
    return heading


def _names_only(header: str, unit: str, role: str) -> bool:
    """Return whether the header and unit of a column show clearly that it holds a certain role.

    A role is what a column holds, such as force. If the header has a word for ``role``, it must not
    have further words, unless ``unit``, the unit of the column, is a unit of this role. If the
    header has no such word, ``unit`` must be a unit of the role, and the header must name neither
    another role nor another quantity, such as a maximum.
    """
    name = unit_of(header).name
    is_in_unit = unit in UNITS.get(role, {})
    if not has_role(name, role):
        return is_in_unit and not (names_any_role(name) or OTHER_QUANTITY.search(name))
    words = re.findall(r"[^\W\d_]+", without_accents(comparable(name)))
    return is_in_unit or set(words) <= set(map(without_accents, ROLES[role]))


def _states_condition(role: str, cell: str) -> bool:
    """Return whether a cell can belong to a column with a given role.

    For the role direction, the cell must name a direction of travel, such as CW. For any other
    role, such as force, the cell must be a number.
    """
    if role == "direction":
        return direction_named(cell) in ("CW", "CCW")
    return looks_like_number(cell)


def name_plane_column(
    sheet: Sheet,
    heading: Heading,
    cells: Sequence[Sequence[str]],
    stated_plane: str | None,
    log: AssumptionLog,
) -> Heading:
    """Return the heading of a table, with its column of planes renamed to ``plane``.

    A column without a role is the column of planes if every cell names a plane and the header has a
    word such as "plane", as in ``PlaneName``. The log notes that this column is used. If the user
    states the plane, the heading is returned unchanged; a note is added if a column names other
    planes.

    Parameters
    ----------
    sheet, heading
        The sheet and the heading of its table.
    cells
        Cells of each column.
    stated_plane
        Plane that the user states for all tests; None if the user states none.
    log
        Log to which the use of the column is added.

    Raises
    ------
    InputError
        If columns hold planes, but it is not clear which column to use, because a word such as
        "plane" is in none of their headers or in several. The error is also raised if the header of
        a column has such a word, but some of its cells name no plane.
    """
    if "plane" in heading.headers:
        return heading
    if stated_plane is None:
        _check_unread_planes(sheet, heading, cells)
    columns = _columns_of_planes(heading, cells)
    if stated_plane is not None:
        for column in columns:
            _note_contradiction(sheet, heading, column, cells[column], stated_plane, log)
        return heading
    named = [column for column in columns if _names_plane(heading.headers[column])]
    if len(named) == 1:
        headers = list(heading.headers)
        column = named[0]
        title = repr(headers[column][:LONGEST_NAME])
        log.add(sheet.place, "plane", f"column {title}", "its name and its cells", "--plane")
        replaced = {**heading.replaced_headers, column: headers[column]}
        headers[column] = "plane"
        return replace(heading, headers=headers, replaced_headers=replaced)
    if columns:
        titles = " and ".join(repr(_title_of_column(heading, column)) for column in columns)
        raise InputError(
            f"{sheet.place}: one column must state the plane, got planes in column {titles}. Give"
            " --plane if all tests have the same, or rename the header of the right column to"
            " 'plane'."
        )
    return heading


def _columns_of_planes(heading: Heading, cells: Sequence[Sequence[str]]) -> list[int]:
    """Return the indices of the columns whose cells all name a plane.

    Columns that are already in use, for example as angles, are left out. ``cells`` holds the cells
    of each column.
    """
    columns = []
    for column in _free_columns(heading, cells):
        if {plane_named(cell) for cell in cells[column]} <= _PLANE_CELLS:
            columns.append(column)
    return columns


def _note_contradiction(
    sheet: Sheet,
    heading: Heading,
    column: int,
    column_cells: Sequence[str],
    stated_plane: str,
    log: AssumptionLog,
) -> None:
    """Add a note to the log if a column of planes contradicts the plane that the user states.

    ``column`` is the index of the column in the table, and ``column_cells`` are its cells.
    """
    planes = sorted({plane_named(cell) for cell in column_cells} - {stated_plane})
    if planes:
        reason = f"column {_title_of_column(heading, column)!r} says {', '.join(planes)}"
        log.add(sheet.place, "plane", f"{stated_plane}, as given", reason, "--plane")


def _check_unread_planes(sheet: Sheet, heading: Heading, cells: Sequence[Sequence[str]]) -> None:
    """Raise an `InputError` if a column of planes has a cell that does not name a plane.

    A column without a role is taken as a column of planes in one case: its header has a word such
    as "plane" and no unit, and it has at most four different cells, which are not all empty. Names
    of planes are XY, YZ and ZX, the same letters in the other order, and G17 to G19. ``heading``
    holds the headers of the columns, ``cells`` the cells of each column, and ``sheet`` is named in
    the error message.
    """
    for column in _free_columns(heading, cells):
        header = heading.headers[column]
        words = set(cells[column])
        is_of_plane = _names_plane(header) and not unit_named(unit_of(header).unit)
        if not is_of_plane or words == {""} or len(words) > _MOST_PLANES:
            continue
        for word in sorted(words):
            if plane_named(word) not in _PLANE_CELLS:
                title = _title_of_column(heading, column)
                raise InputError(
                    f"{sheet.place}: column {title!r} must name the plane (XY, YZ"
                    f" or ZX) in all rows, got {word[:LONGEST_NAME]!r}. Correct it, or give"
                    " --plane."
                )


def check_directions(
    sheet: Sheet, heading: Heading, cells: Sequence[Sequence[str]], layout: Layout
) -> None:
    """Raise an `InputError` for an unused column that may hold directions of travel.

    The cells of such a column are words such as CW. They may also be signs such as + and −, if the
    header has a word for travel, or answers such as 1 and 0, if the header is a direction. No error
    is raised if the user states directions, or if another column is known to hold directions.
    ``heading`` is the heading of the table, and ``cells`` holds the cells of each column.
    """
    if "direction" in heading.roles or layout.direction is not None:
        return
    if any(entry.direction is not None for entry in layout.test):
        return
    for column in _free_columns(heading, cells):
        title = _title_of_column(heading, column)
        words = {cell.strip() for cell in cells[column]}
        if _means_directions(title, words):
            listed = ", ".join(sorted(words - {""}))
            raise InputError(
                f"{sheet.place}: directions must be CW or CCW, got {listed} in column {title!r}."
                " Give --direction if all tests ran alike, or write CW and CCW into the column and"
                " give --direction-column."
            )
        if all(_is_direction(word) for word in words):
            raise InputError(
                f"{sheet.place}: a column of directions must be used, got directions in column"
                f" {title!r}, whose name says something else. If it is the direction of travel,"
                f" give --direction-column '{title}'; otherwise remove it, or give --direction."
            )


def _means_directions(title: str, words: Collection[str]) -> bool:
    """Return whether a column holds signs or answers that mean directions of travel.

    Examples are + and − below ``rotation``, and 1 and 0 below ``CW``. ``title`` is the header of
    the column, and ``words`` are its different cells.
    """
    if set(words) <= _SIGNS and set(words) != {"1"} and _TRAVEL_WORD.search(title):
        return True
    name = unit_of(title).name
    names_direction = len(name) > 1 and direction_named(name) in ("CW", "CCW")
    answers = {word.casefold() for word in words}
    return names_direction and answers <= _ANSWERS and answers != {""}


def _is_direction(word: str) -> bool:
    """Return whether a cell is a word for a direction, such as CW. A sign such as + is no word."""
    return word not in _SIGNS and direction_named(word) in ("CW", "CCW")


def check_angle_columns(sheet: Sheet, heading: Heading, cells: Sequence[Sequence[str]]) -> None:
    """Raise an `InputError` if several columns of readings have different columns of angles.

    All tests of a table share one column of angles. A further column of angles is ignored only if
    its cells are equal to the cells of the shared column. ``heading`` is the heading of the table,
    and ``cells`` holds the cells of each column.
    """
    if len(heading.readings) < 2 or "angle" not in heading.roles:
        return
    shared = heading.roles["angle"]
    in_use = {*heading.roles.values(), *heading.readings, *heading.unit_columns}
    different = []
    for column, header in enumerate(heading.headers):
        if column in in_use or not has_role(unit_of(header).name, "angle"):
            continue
        if list(cells[column]) != list(cells[shared]):
            different.append(column)
    if not different:
        return
    titles = ", ".join(
        f"{_title_of_column(heading, column)!r} ({column + 1})" for column in different
    )
    raise InputError(
        f"{sheet.place}: all readings of a table must share one column of angles, got other angles"
        f" in the columns {titles[:LONGEST_NAME]}. Put each reading with its angles into a file of"
        " its own, or import one at a time: --angle-column and one --reading-column."
    )


def _free_columns(heading: Heading, cells: Sequence[Sequence[str]]) -> list[int]:
    """Return the indices of the columns that have contents and are not in use.

    ``cells`` holds the cells of each column.
    """
    in_use = {*heading.roles.values(), *heading.readings, *heading.unit_columns}
    return [k for k, column_cells in enumerate(cells) if column_cells and k not in in_use]


def _names_plane(header: str) -> bool:
    """Return whether a header has a word such as "plane", as in ``PlaneName``."""
    return any(_PLANE_WORD.fullmatch(word) for word in _WORDS.findall(header))


def _title_of_column(heading: Heading, column: int) -> str:
    """Return the header of a column; if it is empty, the number of the column, counted from 1.

    ``column`` is the index of the column, counted from 0.
    """
    return heading.headers[column][:LONGEST_NAME] or str(column + 1)
