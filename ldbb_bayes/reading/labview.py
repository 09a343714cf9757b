"""Text files of LabVIEW (LVM), whose header states units and time steps of the channels."""

from __future__ import annotations

from collections.abc import Sequence

from ldbb_bayes.campaign.text_table import Row

__all__ = ["is_labview", "rows_of_labview"]

_FIRST_WORDS = "LabVIEW Measurement"
# First cell of the line that ends a part of the header in a text file of LabVIEW.
_END = "***End_of_Header***"
# Labels of the lines in the header of a LabVIEW file that are kept because they may describe the
# test. All other lines of the header are left out.
_KEPT_LABELS = ("Operator", "Date", "Time", "Description", "Project")


def is_labview(text: str) -> bool:
    """Return whether a text is the content of a text file of LabVIEW."""
    return text.startswith(_FIRST_WORDS)


def rows_of_labview(rows: Sequence[Row]) -> list[Row]:
    """Return the rows of a LabVIEW file as a plain table with units in its header.

    The first column has the unit s if ``X_Dimension`` in the header of the file is ``Time``. The
    units of the other columns are the units that ``Y_Unit_Label`` lists. If the file has no column
    of times (``X_Columns`` is ``No``), the times are computed from ``X0`` and ``Delta_X``. Rows of
    a file with another structure are returned unchanged.

    Parameters
    ----------
    rows
        Rows of the file.
    """
    # The header of a LabVIEW file has two parts. The first is about the file, the second is about
    # the measured channels.
    ends_of_parts = [k for k, row in enumerate(rows) if row.cells[:1] == [_END]]
    if len(ends_of_parts) != 2 or ends_of_parts[1] + 1 >= len(rows):
        return list(rows)
    end_of_file_part = ends_of_parts[0]
    end_of_header = ends_of_parts[1]
    labels = {}
    for row in rows[:end_of_header]:
        labels[row.cells[0]] = row.cells[1:]
    plain = [row for row in rows[:end_of_file_part] if row.cells[0] in _KEPT_LABELS]
    names = rows[end_of_header + 1]
    header = _names_with_units(names.cells, labels)
    plain.append(Row(names.line, header))
    for number, row in enumerate(rows[end_of_header + 2 :]):
        cells = list(row.cells) + [""] * (len(header) - len(row.cells))
        if _has_no_times(labels):
            cells[0] = _time_of_row(number, labels)
        plain.append(Row(row.line, cells))
    return plain


def _has_no_times(labels: dict[str, list[str]]) -> bool:
    """Return whether the header of a LabVIEW file says that the file has no column of times.

    ``labels`` holds the cells of each line in the header; the keys are the labels of the lines.
    """
    return labels.get("X_Columns", [""])[0] == "No"


def _time_of_row(number: int, labels: dict[str, list[str]]) -> str:
    """Return the time of a row of numbers in a LabVIEW file, as text.

    The time is computed from the first time and the time step that the header of the file states.
    The text has the same decimal mark as the step. It is empty if the first time or the step is not
    a number. ``number`` is the number of the row, counted from 0. ``labels`` holds the cells of
    each line in the header; the keys are the labels of the lines.
    """
    start = labels.get("X0", ["0"])[0]
    step = labels.get("Delta_X", [""])[0]
    try:
        time = float(start.replace(",", ".")) + number * float(step.replace(",", "."))
    except ValueError:
        return ""
    mark = "," if "," in step else "."
    return f"{time:.9g}".replace(".", mark)


def _names_with_units(names: Sequence[str], labels: dict[str, list[str]]) -> list[str]:
    """Return the names of the columns of a LabVIEW file, each followed by its unit in brackets.

    The keys of ``labels`` are the labels of the lines in the header, and the values are the cells
    of these lines. One of the lines states the units of the columns.
    """
    dimensions = labels.get("X_Dimension", [""])
    units = labels.get("Y_Unit_Label", [])
    named = []
    for column, name in enumerate(names):
        unit = ""
        if column == 0 and dimensions[0] == "Time":
            name = "Time"
            unit = "s"
        elif 0 < column <= len(units):
            unit = units[column - 1]
        named.append(f"{name} [{unit}]" if unit else name)
    return named
