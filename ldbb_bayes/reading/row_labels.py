"""Labels that say to which test each row of a table belongs."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from ldbb_bayes.campaign.circular_test import FEWEST_READINGS
from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.assumptions import AssumptionLog
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.merged_rows import filled_downwards
from ldbb_bayes.reading.numbering_columns import numbers_circles
from ldbb_bayes.reading.sheet_columns import SheetColumns
from ldbb_bayes.reading.words import LONGEST_NAME

__all__ = ["labels_of"]


def _labels_of_several_columns(columns: SheetColumns, log: AssumptionLog) -> list[str]:
    """Return, for each row, the name of its test, made from the cells of several columns.

    A name is ``run 1 pass 2`` for columns that number the tests, and ``100 N CW`` for conditions
    that identify them. The use of these columns is noted. ``columns`` is the table of the sheet.
    """
    headers = columns.numbering_headers
    headings = columns.heading.headers
    numbers = [column for column in columns.numbering if numbers_circles(headings[column])]
    reason = "only both together name tests of one force"
    if len(columns.numbering) == 1:
        reason = "it numbers the repetitions of a circle"
    elif len(numbers) < len(columns.numbering):
        reason = "the rows of each test have the same cells in these columns"
    log.add(columns.sheet.place, "test of each row", ", ".join(headers), reason, "--test-column")
    labels = []
    for row in range(len(columns.lines)):
        words = []
        for header, column in zip(headers, columns.numbering, strict=True):
            cell = columns.cells[column][row]
            if column in numbers:
                words.append(f"{header} {cell}")
            else:
                words.append(f"{cell} {unit_of(header).unit}".strip())
        labels.append(" ".join(words))
    return labels


def labels_of(columns: SheetColumns, log: AssumptionLog) -> list[str]:
    """Return the name of the test to which each row of a table belongs.

    If no single column names the tests, but several columns together do, the names are made from
    the cells of these columns. If no columns name the tests, the names are empty. Raise an
    `InputError` if a single column names the tests, but has an empty cell that cannot be filled
    from above.
    ``columns`` is the table of the sheet.
    """
    if columns.numbering and "test" not in columns.heading.roles:
        return _labels_of_several_columns(columns, log)
    if "test" not in columns.heading.roles:
        return [""] * len(columns.lines)
    rows = range(len(columns.lines))
    # In the file, a number may be followed by a unit, which was removed when the file was read. The
    # unit is added again here, because a label such as "100 N" may be the name of a test.
    labels = columns.cells_with_units(columns.heading.roles["test"], rows)
    if "" in labels and _names_tests_once(labels):
        header = columns.heading.headers[columns.heading.roles["test"]][:LONGEST_NAME]
        reason = "each name stands once, above empty cells"
        value = f"column {header!r}, filled downwards"
        log.add(columns.sheet.place, "test of each row", value, reason, "a name in each row")
        labels = filled_downwards(labels)
    if "" in labels:
        line = columns.lines[labels.index("")]
        raise InputError(
            f"{columns.sheet.place}, line {line}: rows must name their test, got none. Complete or"
            " remove the line."
        )
    return labels


def _names_tests_once(labels: Sequence[str]) -> bool:
    """Return whether a column names each test only once, in the first row of the test.

    All other cells must be empty, as they are if the cells of a test were merged. There must be
    several names, and enough rows for this number of tests. ``labels`` are the cells of the column.
    """
    names = [label for label in labels if label]
    has_several_names = len(names) > 1 and len(set(names)) == len(names)
    has_enough_rows = len(labels) >= FEWEST_READINGS * len(names)
    if not has_several_names or not has_enough_rows:
        return False
    cells_below_names = [below for label, below in pairwise(labels) if label]
    return bool(labels[0]) and not any(cells_below_names)
