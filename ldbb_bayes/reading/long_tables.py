"""Refusal of tables with one row for each value of a signal, and of pivot tables."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.numerals import looks_like_number
from ldbb_bayes.reading.role_words import has_role
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.words import LONGEST_NAME, WORDS, comparable

__all__ = ["check_has_row_for_each_reading"]

# Regular expressions for the header of the column that names the signal of each value, for that of
# the column of values, and for the header of the first column of a pivot table.
_SIGNAL = re.compile(WORDS["long_tables"]["signal"], re.IGNORECASE)
_VALUE = re.compile(WORDS["long_tables"]["value"], re.IGNORECASE)
_PIVOT = re.compile(WORDS["long_tables"]["pivot"], re.IGNORECASE)
# Regular expression for the header of the nodes of an OPC UA server. Their names, such as
# ``ns=2;s=Angle``, hold separators, so that a row is not divided into its cells.
_NODE = re.compile(r"node ?id", re.IGNORECASE)
# The header of a table is searched for among this number of rows.
_LONGEST_HEAD = 40
# The names of signals are searched for among this number of rows.
_ROWS_EXAMINED = 100
# Characters that separate the cells of a row, in the order in which they are tried.
_SEPARATORS = ",;\t|"
# A message shows this number of names of signals.
_NAMES_SHOWN = 2


def check_has_row_for_each_reading(sheet: Sheet, layout: Layout) -> None:
    """Raise an `InputError` if the rows of a sheet hold single values of signals, or sums.

    An example is an export of an OPC UA server with the columns ``NodeId``, ``Timestamp`` and
    ``Value``: the angle and the reading stand in different rows. In a pivot table, the rows are
    sums or means of readings. Nothing is checked if the user states a column of the table.

    Parameters
    ----------
    sheet
        The sheet of the table.
    layout
        Layout that the user states.
    """
    if layout.columns:
        return
    for index, row in enumerate(sheet.rows[:_LONGEST_HEAD]):
        for cell in row.cells:
            if _PIVOT.fullmatch(cell.strip()):
                raise InputError(
                    f"{sheet.place}, line {row.line}: a table must have one row for each reading,"
                    f" got a pivot table with {cell.strip()!r}. Export the rows that it sums up,"
                    " with columns 'Angle [deg]' and 'Deviation [um]'."
                )
        _check_no_signals(sheet, row, sheet.rows[index + 1 : index + 1 + _ROWS_EXAMINED])


def _check_no_signals(sheet: Sheet, header: Row, rows: Sequence[Row]) -> None:
    """Raise an `InputError` if a header names a column of signals and one of their values.

    No error is raised if another column holds angles, or if all ``rows`` below the header are of
    one signal.
    """
    text = sheet.text_of(header.cells)
    for separator in _SEPARATORS:
        names = [comparable(name).strip(" \"'") for name in text.split(separator)]
        signal = [k for k, name in enumerate(names) if _SIGNAL.fullmatch(name)]
        values = [name for name in names if _VALUE.fullmatch(name)]
        if len(signal) != 1 or not values or any(has_role(name, "angle") for name in names):
            continue
        labels = _labels_in(sheet, rows, separator, signal[0])
        listed = " and ".join(repr(label[:LONGEST_NAME]) for label in labels[:_NAMES_SHOWN])
        is_of_nodes = _NODE.fullmatch(names[signal[0]]) is not None
        if is_of_nodes:
            listed = f"{text.split(separator)[signal[0]].strip()!r}"
        if is_of_nodes or len(labels) >= _NAMES_SHOWN:
            raise InputError(
                f"{sheet.place}, line {header.line}: a table must have one row for each reading,"
                f" got one for each value of {listed}. Export one row for each reading, with"
                " columns 'Angle [deg]' and 'Deviation [um]'."
            )


def _labels_in(sheet: Sheet, rows: Sequence[Row], separator: str, column: int) -> list[str]:
    """Return the different texts in a column, in the order of the rows. Numbers are left out."""
    labels: dict[str, None] = {}
    for row in rows:
        cells = sheet.text_of(row.cells).split(separator)
        label = "".join(cells[column : column + 1]).strip()
        if label and not looks_like_number(label):
            labels[label] = None
    return list(labels)
