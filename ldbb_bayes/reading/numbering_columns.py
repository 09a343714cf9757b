"""Columns that together say to which circle each row belongs.

Examples are ``run`` and ``pass``, or the force and the direction of travel.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import combinations, groupby

from ldbb_bayes.reading.words import comparable

__all__ = ["columns_that_number", "conditions_that_number"]

# Regular expression for the header of a column with the numbers of circles or of their repetitions.
_NUMBERS_CIRCLES = re.compile(
    r"(?:runs?|pass(?:es)?|laps?|repeat|repetition|rep|cycle|test|trial|series?|serie|set"
    r"|lauf|umlauf|durchgang|durchlauf|zyklus|wiederholung|messung|versuch|passage|essai|ciclo"
    r"|prova|prueba)(?:[ _.]?(?:no|nr|id|number|index))?\.?"
)


# Smallest number of rows of a circle.
_FEWEST_ROWS = 9


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


def conditions_that_number(
    cells: Sequence[Sequence[str]], conditions: Sequence[int], angle: int | None = None
) -> list[int]:
    """Return the indices of conditions, such as force and direction, that identify the circles.

    The list holds two or more columns. There must be at least nine rows with the same conditions.
    These rows must follow one another without interruption; in a table that is sorted by angle, all
    circles must have the same angles instead. Thus, a force that is measured for each row
    identifies no circles. The list is empty if no such columns exist.

    Parameters
    ----------
    cells
        Cells of each column.
    conditions
        Indices of the columns with the conditions of the circles.
    angle
        Index of the column of angles; None if there is none.
    """
    changing = [column for column in conditions if len(set(cells[column])) > 1]
    if len(changing) < 2:
        return []
    labels = list(zip(*[cells[column] for column in changing], strict=True))
    if any("" in label for label in labels):
        return []
    blocks = [len(list(block)) for _, block in groupby(labels)]
    if len(blocks) == len(set(labels)):
        return changing if min(blocks) >= _FEWEST_ROWS else []
    if angle is not None and _have_the_same_angles(labels, cells[angle]):
        return changing
    return []


def _have_the_same_angles(labels: Sequence[tuple[str, ...]], angles: Sequence[str]) -> bool:
    """Return whether all circles of a table have the same angles, each angle once.

    There must be at least nine angles. ``labels`` holds the conditions in each row, and ``angles``
    the angle in each row.
    """
    angles_by_label: dict[tuple[str, ...], list[str]] = {}
    for label, angle in zip(labels, angles, strict=True):
        angles_by_label.setdefault(label, []).append(angle)
    different = set(angles)
    if len(different) < _FEWEST_ROWS:
        return False
    sorted_angles = sorted(different)
    return all(sorted(of_circle) == sorted_angles for of_circle in angles_by_label.values())
