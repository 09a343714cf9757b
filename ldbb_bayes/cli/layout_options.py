"""Command-line options that say how tables are to be read, and the layout made from them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import ldbb_bayes as lb
from ldbb_bayes.cli.options import Kind, group, options_of

__all__ = ["LAYOUT_FLAGS", "LAYOUT_OPTIONS"]

# Quantities, such as angle and reading, that the columns of an imported table can hold.
_COLUMN_ROLES = ("angle", "time", "force", "pressure", "test", "direction", "reading")


def _read_column(text: str, flag: str) -> str | int:
    """Return the number or the heading by which the user names a column of a table.

    If ``text`` consists only of digits, it is the number of the column, counted from 1. Otherwise
    it is the heading of the column.
    """
    return int(text) if text.isdecimal() else text


def _read_columns(entries: list[str], flag: str) -> list[str | int]:
    """Return the numbers or headings by which the user names columns of a table."""
    return [_read_column(text, flag) for text in entries]


def _read_sheets(text: str, flag: str) -> list[str]:
    """Return the names of a workbook's sheets, which the user typed with commas between them."""
    return [name.strip() for name in text.split(",")]


def _layout(layout: Path | None = None, **options: Any) -> lb.reading.Layout:
    """Return the layout (how imported tables are to be read) from a layout file and options.

    ``layout`` is the path of the file, or None if there is no file. ``options`` holds values of
    fields of `Layout`; the keys are names of fields. These values replace those in the file.
    """
    from_file = lb.reading.Layout() if layout is None else lb.reading.read_layout(layout)
    columns = dict(from_file.columns)
    for role in _COLUMN_ROLES:
        if f"{role}_column" in options:
            columns[role] = options.pop(f"{role}_column")
    return from_file.with_given({"columns": columns, **options}, LAYOUT_FLAGS)


# Options that say how tables are to be read.
_OPTIONS = options_of(
    "layout",
    column=Kind(str, _read_column),
    columns=Kind(list[str], _read_columns),
    sheets=Kind(str, _read_sheets),
)
# Flags, such as --unit, of the options that say how tables are to be read. The keys are the names
# of the keyword arguments that take the values of the options, such as reading_unit. Most of these
# keyword arguments are fields of the layout.
LAYOUT_FLAGS = {option.to or name: option.flag(name) for name, option in _OPTIONS.items()}
LAYOUT_OPTIONS = group(_layout, **_OPTIONS)
