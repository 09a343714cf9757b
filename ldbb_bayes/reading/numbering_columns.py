"""Columns that together say to which circle each row belongs.

Examples are ``run`` and ``pass``, or the force and the direction of travel.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from itertools import combinations, groupby

from ldbb_bayes.campaign.circular_test import FEWEST_READINGS
from ldbb_bayes.reading.words import comparable

__all__ = [
    "are_repeated",
    "column_that_repeats",
    "columns_that_number",
    "conditions_that_number",
    "divides_a_circle",
    "numbers_circles",
]

# Regular expression for the header of a column with the numbers of circles or of their repetitions.
_NUMBERS_CIRCLES = re.compile(
    r"(?:runs?|pass(?:es)?|laps?|repeat|repetition|rep|cycle|test|trial|series?|serie|set"
    r"|lauf|umlauf|durchgang|durchlauf|zyklus|wiederholung|messung|versuch|passage|essai|ciclo"
    r"|prova|prueba|circle|kreis|cercle|cerchio|wdh)(?:[ _.]?(?:no|nr|id|number|index))?\.?"
)
# Regular expression for the header of a column with the numbers of repetitions of a whole circle. A
# cycle or a pass may also be a lap of one circle.
_NUMBERS_REPETITIONS = re.compile(
    r"(?:repeat|repetition|rep|series?|serie|messreihe|wiederholung|wdh|répétition|ripetizione"
    r"|repetición|repetição|powtórzenie|opakování|повтор|повторение|回数|重复|반복)"
    r"\.?(?:[ _.]?(?:no|nr|id|number|index))?\.?"
)
# Regular expression for the header of a column with the numbers of the laps of a circle.
_NUMBERS_LAPS = re.compile(r"(?:laps?|turns?|umlauf|runde)(?:[ _.]?(?:no|nr|number|index))?\.?")
# Regular expression for an angle of one full turn [deg]. Zeros behind its decimal mark are kept.
_FULL_TURN = re.compile(r"^360(?![^.,])")


def columns_that_number(
    headers: Sequence[str], cells: Sequence[Sequence[str]], conditions: Sequence[int]
) -> list[int]:
    """Return the indices of one or two columns that identify the circles of a table.

    Columns identify the circles if all rows with the same cells in these columns also have the same
    conditions, such as the force. Two columns are returned only if no single column identifies the
    circles. The list is empty if no such columns exist.

    Parameters
    ----------
    headers
        Header of each column.
    cells
        Cells of each column.
    conditions
        Indices of the columns with the conditions of the circles.
    """
    candidates = []
    for column, header in enumerate(headers):
        if _NUMBERS_CIRCLES.fullmatch(comparable(header)) and column not in conditions:
            candidates.append(column)
    for n_columns in (1, 2):
        for columns in combinations(candidates, n_columns):
            if _determine_conditions(cells, columns, conditions):
                return list(columns)
    return []


def column_that_repeats(
    headers: Sequence[str],
    cells: Sequence[Sequence[str]],
    conditions: Sequence[int],
    angle: int | None,
) -> list[int]:
    """Return the index of the column that numbers repetitions of a circle, as a list of one.

    All rows must have the same conditions, and the same angles must occur in several repetitions.
    The list is empty if there is no such column.

    Parameters
    ----------
    headers
        Header of each column.
    cells
        Cells of each column.
    conditions
        Indices of the columns with the conditions of the circles, such as the force.
    angle
        Index of the column of angles; None if there is none.
    """
    if angle is None or any(len(set(cells[column])) > 1 for column in conditions):
        return []
    for column, header in enumerate(headers):
        is_repetition = _NUMBERS_REPETITIONS.fullmatch(comparable(header)) is not None
        if not is_repetition or len(set(cells[column])) < 2:
            continue
        if are_repeated(cells[angle]) and _identify_circles(headers, cells, [column], angle):
            return [column]
    return []


def _determine_conditions(
    cells: Sequence[Sequence[str]], columns: Sequence[int], conditions: Sequence[int]
) -> bool:
    """Return whether rows with equal cells in ``columns`` have equal conditions, such as the force.

    ``conditions`` are the indices of the columns with the conditions.
    """
    n_rows = len(cells[0])
    conditions_by_label: dict[tuple[str, ...], tuple[str, ...]] = {}
    for row in range(n_rows):
        label = tuple(cells[column][row] for column in columns)
        condition = tuple(cells[column][row] for column in conditions)
        if conditions_by_label.setdefault(label, condition) != condition:
            return False
    return True


def numbers_circles(header: str) -> bool:
    """Return whether a header names a column that numbers circles, and not laps of a circle."""
    is_number = _NUMBERS_CIRCLES.fullmatch(comparable(header)) is not None
    return is_number and not _numbers_laps(header)


def _numbers_laps(header: str) -> bool:
    """Return whether a header names a column with the numbers of the laps of a circle."""
    return _NUMBERS_LAPS.fullmatch(comparable(header)) is not None


def conditions_that_number(
    headers: Sequence[str],
    cells: Sequence[Sequence[str]],
    conditions: Sequence[int],
    angle: int | None,
    without_role: Collection[int] = (),
) -> list[int]:
    """Return the indices of conditions, such as force and direction, that identify the circles.

    The list holds two or more columns; it holds a single one if this has no role, such as a column
    of radii. A column such as ``rep no.`` is added if several circles have the same conditions.
    There must be at least nine rows with the same conditions. These rows must follow one another
    without interruption; in a table that is sorted by angle, all circles must have the same angles
    instead. Thus, a force that is measured for each row identifies no circles. The list is empty if
    no such columns exist, or if a further column, or a circle with twice the angles of the others,
    shows that several circles have the same conditions.

    Parameters
    ----------
    headers
        Header of each column.
    cells
        Cells of each column.
    conditions
        Indices of the columns with the conditions of the circles.
    angle
        Index of the column of angles; None if there is none.
    without_role
        Indices of those of the conditions that have no role, such as the radius.
    """
    changing = [column for column in conditions if len(set(cells[column])) > 1]
    if not changing or (len(changing) == 1 and not set(changing) & set(without_role)):
        return []
    candidates = [changing]
    for column, header in enumerate(headers):
        is_number = numbers_circles(header) and column not in changing
        if is_number and len(set(cells[column])) > 1:
            candidates.append(sorted([*changing, column]))
    for columns in candidates:
        if _identify_circles(headers, cells, columns, angle):
            return columns
    return []


def _identify_circles(
    headers: Sequence[str],
    cells: Sequence[Sequence[str]],
    columns: Sequence[int],
    angle: int | None,
) -> bool:
    """Return whether all rows with the same cells in ``columns`` are one circle.

    ``angle`` is the index of the column of angles, or None if there is none.
    """
    if any("" in cells[column] for column in columns):
        return False
    labels = list(zip(*[cells[column] for column in columns], strict=True))
    blocks = [len(list(block)) for _, block in groupby(labels)]
    if len(blocks) != len(set(labels)):
        return angle is not None and _have_the_same_angles(labels, cells[angle])
    if min(blocks) < FEWEST_READINGS:
        return False
    if divides_a_circle(headers, cells, blocks, (*columns, angle), angle):
        return False
    has_laps = any(_numbers_laps(header) for header in headers)
    return angle is None or has_laps or _have_alike_laps(blocks, cells[angle])


def _have_alike_laps(blocks: Sequence[int], angles: Sequence[str]) -> bool:
    """Return whether the angles occur once in all blocks of rows, or repeatedly in all of them.

    If the angles of some blocks occur once, the repeated angles of another block are hardly laps of
    one circle, but two circles. ``blocks`` are the numbers of successive rows, and ``angles`` the
    angles in all rows.
    """
    start = 0
    kinds = set()
    for n_rows in blocks:
        kinds.add(are_repeated(angles[start : start + n_rows]))
        start += n_rows
    return len(kinds) == 1


def are_repeated(angles: Sequence[str]) -> bool:
    """Return whether most of the angles occur more than once."""
    return 2 * len(set(angles)) <= len(angles) + FEWEST_READINGS


def divides_a_circle(
    headers: Sequence[str],
    cells: Sequence[Sequence[str]],
    blocks: Sequence[int],
    in_use: Collection[int | None],
    angle: int | None,
) -> bool:
    """Return whether a further column divides a block of rows into several circles.

    Most angles of the block must occur more than once. An example is a column with the height of
    the circle. A column that numbers laps divides no circle.

    Parameters
    ----------
    headers
        Header of each column.
    cells
        Cells of each column.
    blocks
        Numbers of successive rows that may be a circle each.
    in_use
        Indices of the columns that are not considered.
    angle
        Index of the column of angles; None if there is none.
    """
    if angle is None:
        return False
    further = []
    for column, header in enumerate(headers):
        if column not in in_use and not _numbers_laps(header):
            further.append(column)
    start = 0
    for n_rows in blocks:
        rows = slice(start, start + n_rows)
        start += n_rows
        if not are_repeated(cells[angle][rows]):
            continue
        for column in further:
            parts = [len(list(part)) for _, part in groupby(cells[column][rows])]
            if len(parts) > 1 and min(parts) >= FEWEST_READINGS:
                return True
    return False


def _have_the_same_angles(labels: Sequence[tuple[str, ...]], angles: Sequence[str]) -> bool:
    """Return whether all circles of a table have the same angles, each angle once.

    There must be at least nine angles. The angle 360 counts as 0, because circles in both
    directions may begin there, unless every circle has both angles. ``labels`` holds the conditions
    in each row, and ``angles`` the angle in each row.
    """
    return _agree_in(labels, angles) or _agree_in(
        labels, [_FULL_TURN.sub("0", angle) for angle in angles]
    )


def _agree_in(labels: Sequence[tuple[str, ...]], angles: Sequence[str]) -> bool:
    """Return whether rows with the same label have the same angles as all other rows, each once."""
    angles_by_label: dict[tuple[str, ...], list[str]] = {}
    for label, angle in zip(labels, angles, strict=True):
        angles_by_label.setdefault(label, []).append(angle)
    different = set(angles)
    if len(different) < FEWEST_READINGS:
        return False
    sorted_angles = sorted(different)
    return all(sorted(of_circle) == sorted_angles for of_circle in angles_by_label.values())
