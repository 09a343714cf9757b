"""Tables for display in a terminal, in a notebook and on the report's page."""

from __future__ import annotations

import html
import re
import shutil
import textwrap
from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
import pandas as pd

from ldbb_bayes.errors import InputError
from ldbb_bayes.units import display_name, display_unit, round_like, round_uncertainty, typeset

__all__ = [
    "ReadableFrame",
    "Table",
    "readable",
    "table_of",
    "terminal_width",
    "with_rows_instead",
    "wrapped",
]

# Largest number of rows of a data frame that are displayed. If a data frame has more rows, only its
# first and its last rows are displayed.
_MOST_ROWS = 60
# Smallest line width for which tables and texts are laid out [characters]. This width is also used
# if there is no terminal.
_NARROWEST = 80
# Largest line width for which tables and texts are laid out [characters].
_WIDEST = 100
# Number of lines that a terminal of unknown size is assumed to have.
_TERMINAL_LINES = 24
# Largest number of lines of a table that ``print`` shows with all columns. If a table is longer,
# ``print`` leaves out the columns that do not fit side by side.
_SCREEN_LINES = 45
# Widths [characters] for the column headings of a displayed table. Headings that are wider than the
# first width are broken into lines, between words. If the table is still too wide, the headings are
# broken again for the next width.
_HEAD_WIDTHS = (12, 9, 7, 1)
# Number of spaces between the columns of a displayed table.
_GAP = 2
# Names of columns whose numbers are in the unit that the column "unit" states in the same row.
_IN_UNIT_OF_ROW = frozenset(
    (
        "mean",
        "sd",
        "median",
        "ci_low",
        "ci_high",
        "prior_mean",
        "prior_sd",
        "estimate",
        "u",
        "first",
        "second",
        "difference",
        "least_squares",
        "least_squares_u",
        "sd_error",
        "floor_sd",
        "baseline_sd",
    )
)
# Names of columns whose numbers are rounded like the standard uncertainty in the same row.
_ROUNDED_LIKE_U = frozenset(
    ("mean", "median", "ci_low", "ci_high", "estimate", "difference", "U_k2")
)
# Names of columns that hold a standard uncertainty.
_STANDARD_UNCERTAINTIES = ("sd", "u")
# Names of columns that hold an estimate or its uncertainty. In a table that is too wide for a line
# of text, the cells of some columns are moved to lines beneath their rows. Cells of the columns
# named here are moved only if moving the cells of all other columns is not enough.
_ESTIMATE = frozenset(("mean", "sd", "ci_low", "ci_high", "difference"))
# Names of columns whose texts can name the rows of a data frame. If the rows are only numbered, the
# first column in this list that exists in the data frame is used, and its texts are displayed as
# the names of the rows.
_NAMING = ("parameter", "quantity", "source")
# Regular expression for the heading of a column of numbers with their unit, such as "noise (µm)".
_HEAD_WITH_UNIT = re.compile(r"(?P<name>.+?) \((?P<unit>.+)\)")
# Regular expression for units before which a line of text must not be broken.
_UNIT = r"%|°|bar\b|[nµm]?m\b|k?N\b|[nµm]?rad\b|per kN|nats?\b|times\b|u\b"
# Regular expression for spaces at which a line of text must not be broken: before units, brackets
# and "per kN", and beside signs such as ± and =.
_UNBREAKABLE = "|".join(
    (
        rf"(?<=[\d)\]]) (?={_UNIT})",
        r" (?=\([^()]{1,16}\))",
        r"(?<=/N) (?=per kN)",
        r"(?<=\bln) (?=[BPp]\()",
        r" (?=[=±→≤≥<>·−] [\w(−+.])",
        r"(?<= [=±→≤≥<>·−]) (?=[\w(−+.])",
    )
)
# Regular expression for short texts in brackets, within which a line of text must not be broken.
_SHORT_BRACKETS = r"[(\[][^()\[\]]{1,16}[)\]]"
# No-break space: a line of text is not broken at this character.
_NO_BREAK = "\xa0"


@dataclass(frozen=True)
class Table:
    """Table of results with a caption and headings, for display and for files.

    Floating-point numbers are displayed with four significant digits, and None is displayed as a
    dash. All other cells are displayed unchanged.
    """

    caption: str
    #: headings of the table's columns, each with its unit, such as force (N)
    heads: tuple[str, ...]
    #: one truth value for each column of the table: whether the column holds numbers. Numbers are
    #: aligned right.
    numeric: tuple[bool, ...]
    #: rows of cells of the table; the first cell of a row is the name of the row
    rows: tuple[tuple[Any, ...], ...]

    @classmethod
    def of(
        cls,
        caption: str,
        heads: Sequence[str],
        rows: Sequence[Sequence[Any]],
        *,
        text: Collection[str] = (),
    ) -> Self:
        """Return a table with a caption, the headings of its columns, and its rows of cells.

        All columns hold numbers, except the first column and the columns whose headings are in
        ``text``.
        """
        numeric = tuple(position > 0 and head not in text for position, head in enumerate(heads))
        return cls(caption, tuple(heads), numeric, tuple(tuple(row) for row in rows))

    def shown(self) -> tuple[tuple[str, ...], ...]:
        """Return the cells of the table as texts for display, row by row."""
        return tuple(_typeset_row(row) for row in self.rows)

    def text(self, width: int = 120) -> str:
        """Return the table as lines of at most ``width`` characters, if its cells are short enough.

        If the table is too wide, the headings of its columns are broken into lines. If it is still
        too wide, columns with the same value in every row are left out, and these values are stated
        once below the table. If that is not enough, the cells of further columns are moved to lines
        beneath their rows: first the cells of columns with texts, then of columns with numbers, and
        finally of columns with an estimate or its uncertainty.
        """
        return _TextLayout(self, width).text()

    def screen(self, width: int = 100) -> str:
        """Return the table as text for a screen. If the text is long, some columns are left out.

        Lines have at most ``width`` characters. The method `text` writes the cells that do not fit
        into a line on additional lines below their row. If its text has more than 45 lines, the
        columns of these cells are left out here, and the last line names them. No row is left out;
        the text may therefore still be longer than a screen.
        """
        layout = _TextLayout(self, width)
        text = layout.text()
        if text.count("\n") < _SCREEN_LINES:
            return text
        return layout.text_without_columns_beneath()

    def html(self) -> str:
        """Return the table as HTML. Special characters in its texts are escaped."""
        heads = [typeset(head) for head in self.heads]
        head_tags = ['th scope="col"'] * len(heads)
        # On narrow screens, the page of the report shows each cell of a table after the heading of
        # the cell's column.
        cell_tags = [f'td data-head="{html.escape(head)}"' for head in heads[1:]]
        row_tags = ['th scope="row"', *cell_tags]
        head = self._html_row(head_tags, heads)
        body = "".join(f"<tr>{self._html_row(row_tags, row)}</tr>\n" for row in self.shown())
        caption = ""
        if self.caption:
            caption = f"<caption>{html.escape(typeset(self.caption))}</caption>"
        return f"<table>{caption}<thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody></table>"

    def _html_row(self, tags: Iterable[str], values: Iterable[str]) -> str:
        """Return the cells of one row of the table as HTML.

        ``tags`` holds the name and the attributes of each cell's HTML element, and ``values`` the
        texts of the cells. The elements of cells in columns with numbers also have the class ``n``.
        """
        cells = []
        for tag, numeric, value in zip(tags, self.numeric, values, strict=True):
            mark = ' class="n"' if numeric else ""
            cells.append(f"<{tag}{mark}>{html.escape(value)}</{tag.split()[0]}>")
        return "".join(cells)


class _TextLayout:
    """Layout of a table as text, with lines of a given width if possible."""

    def __init__(self, table: Table, width: int) -> None:
        """Store the texts of ``table``, to be laid out in lines of ``width`` characters.

        At first, all columns stand side by side. If the table is too wide, `_make_fit` later moves
        the cells of some columns to places below the table or below their rows.
        """
        self._caption = typeset(table.caption)
        self._heads = [typeset(head) for head in table.heads]
        self._numeric = table.numeric
        self._rows = table.shown()
        self._width = width
        # Every column is in one of three groups, which hold the indices of columns. The columns in
        # ``_columns`` stand side by side as usual. The columns in ``_constant`` have the same value
        # in all rows, which is stated once below the table. The cells of the columns in
        # ``_beneath`` are moved to lines beneath their rows.
        self._columns = list(range(len(self._heads)))
        self._constant: list[int] = []
        self._beneath: list[int] = []
        # Lines into which the heading of each column of the table is broken; the unit is on a line
        # of its own.
        self._head_lines = [head.replace(" (", "\n(").split("\n") for head in self._heads]

    def text(self) -> str:
        """Return the whole table as text, in lines of the given width if possible."""
        if self._is_too_wide():
            self._make_fit()
        return "\n".join(self._lines(sorted(self._beneath)))

    def text_without_columns_beneath(self) -> str:
        """Return the table as lines of text, without the columns for which the lines are too short.

        The last line names the columns that are left out.
        """
        if self._is_too_wide():
            self._make_fit()
        lines = self._lines(())
        if self._beneath:
            names = ", ".join(self._heads[column] for column in sorted(self._beneath))
            note = f"Left out: {names}. All columns: print(table.details())."
            lines += wrapped(note, self._width)
        return "\n".join(lines)

    def _lines(self, beneath: Sequence[int]) -> list[str]:
        """Return the table as lines of text: caption, headings and rows.

        Cells of the columns with the indices ``beneath`` are on separate lines below each row.
        """
        lines = wrapped(self._caption, self._width)
        lines += self._lines_of_heads()
        for row in self._rows:
            lines.append(self._line(row))
            lines += wrapped(self._entries(row, beneath), self._width, "    ", "    ")
        if self._constant:
            entries = self._entries(self._rows[0], self._constant)
            lines += wrapped(f"In every row: {entries}", self._width)
        return lines

    def _make_fit(self) -> None:
        """Change the layout of the table until its lines have the required width, if possible.

        First, the headings of columns are broken into lines. If the table is still too wide,
        columns with the same value in all rows are left out, and these values are stated once below
        the table. If that is not enough, the cells of further columns are moved to lines beneath
        their rows.
        """
        self._break_heads(1)
        if self._is_too_wide() and len(self._rows) > 1:
            self._constant = [column for column in self._columns[1:] if self._is_constant(column)]
        last_first = self._columns[:0:-1]
        for column in sorted(last_first, key=self._importance):
            if self._is_too_wide() and column not in self._constant:
                self._beneath.insert(0, column)
            elsewhere = {*self._constant, *self._beneath}
            self._columns = [column for column in self._columns if column not in elsewhere]
        self._break_heads(_HEAD_WIDTHS[0])
        for least_width in _HEAD_WIDTHS[1:]:
            if self._is_too_wide():
                self._break_heads(least_width)

    def _importance(self, column: int) -> tuple[bool, bool, bool]:
        """Return a sort key that states how important a column of the table is.

        ``column`` is the index of the column. If the table is too wide, the cells of the least
        important columns are moved to separate lines below the rows. Columns with texts are moved
        first, then columns with numbers, then columns with an estimate or its uncertainty, and last
        the column of the unit.
        """
        head = self._heads[column]
        return head == "unit", head in _ESTIMATE, self._numeric[column]

    def _is_constant(self, column: int) -> bool:
        """Return whether a column, other than "unit", has the same value in all rows."""
        values = {row[column] for row in self._rows}
        return self._heads[column] != "unit" and len(values) == 1

    def _is_too_wide(self) -> bool:
        """Return whether the table's columns that stand side by side are too wide for one line."""
        gaps = _GAP * (len(self._columns) - 1)
        return sum(self._column_width(column) for column in self._columns) + gaps > self._width

    def _column_width(self, column: int) -> int:
        """Return the width of a table's column with its present heading [characters]."""
        return self._width_with(column, self._head_lines[column])

    def _width_with(self, column: int, head_lines: Sequence[str]) -> int:
        """Return the width [characters] of a column whose heading has the lines ``head_lines``.

        ``column`` is the index of the column.
        """
        cells = [row[column] for row in self._rows]
        return max(len(text) for text in [*head_lines, *cells])

    def _break_heads(self, least_width: int) -> None:
        """Break long column headings into several lines, to make the columns narrower.

        Headings are broken between words. No heading is made narrower than ``least_width``
        [characters].
        """
        for column in self._columns:
            words = _with_no_break_spaces(self._heads[column]).split(" ")
            line_width = max(least_width, self._width_with(column, words))
            # A heading without text, such as that of the rows' names, is one empty line.
            self._head_lines[column] = textwrap.wrap(" ".join(words), line_width) or [""]

    def _lines_of_heads(self) -> list[str]:
        """Return lines of text with the headings of all columns that stand side by side.

        Columns that do not fit side by side have no heading here. Their cells are written on lines
        below each row, or below the table if they are the same in all rows. A heading may be broken
        into several lines. Empty lines are put above headings with fewer lines than the longest
        one.
        """
        height = max(len(self._head_lines[column]) for column in self._columns)
        lines = []
        for line in range(height):
            cells = [""] * len(self._heads)
            for column in self._columns:
                head_lines = self._head_lines[column]
                blank = height - len(head_lines)
                if line >= blank:
                    cells[column] = head_lines[line - blank]
            lines.append(self._line(cells))
        return lines

    def _line(self, cells: Sequence[str]) -> str:
        """Return one line of the printed table, with aligned cells.

        ``cells`` holds one text for every column of the table. The line contains only the cells of
        the columns that stand side by side.
        """
        aligned = []
        for column in self._columns:
            width = self._column_width(column)
            if self._numeric[column]:
                aligned.append(cells[column].rjust(width))
            else:
                aligned.append(cells[column].ljust(width))
        return (" " * _GAP).join(aligned).replace(_NO_BREAK, " ").rstrip()

    def _entries(self, row: Sequence[str], columns: Iterable[int]) -> str:
        """Return the cells of a table's row in some columns as text, each after its heading.

        An example is "noise 0.12 µm; direction: CW". ``columns`` are indices of columns. Empty
        cells are left out.
        """
        entries = []
        for column in columns:
            if row[column] not in ("", "–"):
                entries.append(
                    _cell_with_heading(self._heads[column], row[column], self._numeric[column])
                )
        return "; ".join(entries)


def _cell_with_heading(head: str, value: str, numeric: bool) -> str:
    """Return the heading of a column and one of its cells as one text.

    ``head`` is the heading, and ``value`` the text of the cell. If the column is ``numeric``, the
    unit is moved from the heading to the end: "noise (µm)" and "0.12" give "noise 0.12 µm". The
    heading's "(1)" of numbers without a unit is left out. If the column is not numeric, a colon
    separates heading and cell, as in "direction: CW".
    """
    if not numeric:
        return f"{head}: {value}"
    with_unit = _HEAD_WITH_UNIT.fullmatch(head)
    if with_unit is None:
        return f"{head} {value}"
    if with_unit["unit"] == "1":
        return f"{with_unit['name']} {value}"
    return f"{with_unit['name']} {value} {with_unit['unit']}".replace(" °", "°")


def _typeset_row(row: Sequence[Any]) -> tuple[str, ...]:
    """Return the cells of a table's row as texts with true minus signs and powers of ten."""
    return tuple(typeset(_text_of_cell(value)) for value in row)


def _text_of_cell(value: Any) -> str:
    """Return a table's cell as text: a dash for None, four significant digits for a float."""
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.4g}"
    return str(value)


class ReadableFrame(pd.DataFrame):
    """Data frame of pandas that is displayed as a `Table`.

    If the table is longer than a screen, ``print`` leaves out the columns that do not fit side by
    side, and names these columns.
    """

    @property
    def _constructor(self) -> type[pd.DataFrame]:
        """Class of the data frames that pandas makes from this one, such as a selection of rows."""
        return ReadableFrame

    def __repr__(self) -> str:
        """Return the data frame as a table for one screen, without columns that do not fit."""
        return table_of(_for_print(self)).screen(terminal_width())

    def details(self) -> str:
        """Return a text that shows all columns and rows of the data frame as a table."""
        return table_of(_for_print(self, all_rows=True)).text(terminal_width())

    def _repr_html_(self) -> str:
        """Return the data frame as a table in HTML, for a notebook."""
        return table_of(_for_print(self)).html()


def _for_print(frame: pd.DataFrame, *, all_rows: bool = False) -> pd.DataFrame:
    """Return a data frame as it is displayed, with substitutes for some of its rows.

    `with_rows_instead` states which rows are replaced, which rows are their substitutes, and above
    which row the substitutes stand. If ``all_rows`` is true, the substitutes are added, and the
    replaced rows stay. The data frame is returned unchanged if it has no substitutes. It is also
    returned unchanged if its number of rows has changed since `with_rows_instead` was called,
    because the user has then selected rows.
    """
    instead: _RowsInstead | None = frame.attrs.get("rows_instead")
    if instead is None or len(frame) != instead.length:
        return frame
    is_kept = np.array([all_rows or name not in instead.replaced for name in frame.index])
    kept = frame.loc[is_kept]
    displayed = pd.DataFrame.from_dict(dict(instead.displayed), orient="index")[list(frame.columns)]
    above = int(is_kept[: instead.position].sum())
    result = ReadableFrame(pd.concat([kept.iloc[:above], displayed, kept.iloc[above:]]))
    result.attrs = dict(frame.attrs)
    return result


class _RowsInstead(NamedTuple):
    """Rows that are displayed instead of some rows of a data frame.

    The data frame itself keeps the rows that are not displayed.
    """

    #: names of the rows in whose place other rows are displayed; only `ReadableFrame.details`
    #: displays the rows with these names
    replaced: tuple[str, ...]
    #: dictionary of the substitutes, which are displayed in place of some rows of a data frame. The
    #: keys are the names of the substitutes. Each value is a dictionary with the cells of one
    #: substitute; its keys are the names of the columns.
    displayed: Mapping[str, Mapping[str, Any]]
    #: index of the row of the data frame above which the substitutes are displayed
    position: int
    #: number of rows that the data frame had when it was decided which rows are displayed in place
    #: of others; if the number has changed since then, the data frame is displayed as it is
    length: int


def with_rows_instead(
    frame: pd.DataFrame,
    replaced: Iterable[str],
    displayed: Mapping[str, Mapping[str, Any]],
    position: int,
) -> pd.DataFrame:
    """Make a data frame display substitutes for some of its rows, and return the data frame.

    The values in the data frame do not change. Its method ``details`` displays both the replaced
    rows and their substitutes.

    Parameters
    ----------
    frame
        The data frame.
    replaced
        Names of the replaced rows.
    displayed
        Dictionary of the substitutes. The keys are the names of the substitutes. Each value is a
        dictionary with the cells of one substitute; its keys are the names of the columns.
    position
        Index of the row of the data frame above which the substitutes are displayed.
    """
    rows_instead = _RowsInstead(tuple(replaced), displayed, position, len(frame))
    frame.attrs["rows_instead"] = rows_instead
    return frame


def readable(
    frame: pd.DataFrame, caption: str = "", units: Mapping[str, str] | None = None
) -> pd.DataFrame:
    """Return a data frame that is displayed as a table with a caption and display units.

    Stored values do not change.

    Parameters
    ----------
    frame
        The data frame. If it has a column "unit" with internal units (mm, N, rad), the values of
        each row are displayed in the display unit, such as nm/N.
    caption
        Caption of the table.
    units
        Mapping from the names of columns to the units that are displayed in the column headings.
    """
    copy = ReadableFrame(frame)
    copy.attrs = {**frame.attrs, "caption": caption, "units": dict(units or {})}
    return copy


def terminal_width() -> int:
    """Return the width of the terminal [characters], at least 80 and at most 100.

    If the width is unknown, for example without a terminal, 80 is returned.
    """
    columns = shutil.get_terminal_size((_NARROWEST, _TERMINAL_LINES)).columns
    return min(max(columns, _NARROWEST), _WIDEST)


def table_of(frame: pd.DataFrame) -> Table:
    """Return a data frame as a `Table`, with the numbers of each row in the row's display unit.

    A data frame of more than 60 rows is shortened to its first 30 and last 30 rows.
    """
    caption = frame.attrs.get("caption", "")
    frame = _with_named_rows(frame)
    heads = [str(frame.index.name or ""), *_heads_with_units(frame)]
    numeric = (False, *(kind.kind in "iufb" for kind in frame.dtypes))
    is_long = len(frame) > _MOST_ROWS
    excerpt = frame
    if is_long:
        excerpt = frame.take(np.r_[: _MOST_ROWS // 2, -_MOST_ROWS // 2 : 0])
    names = list(frame)
    rows = []
    for label, *values in excerpt.itertuples(name=None):
        rows.append((_row_label(label), *_displayed_cells(names, values)))
    if is_long:
        rows.insert(_MOST_ROWS // 2, ("…",) * len(heads))
        if caption:
            caption += ", "
        caption += f"{len(frame)} rows"
    return Table(caption, tuple(heads), numeric, tuple(rows))


def _with_named_rows(frame: pd.DataFrame) -> pd.DataFrame:
    """Return a data frame whose rows are named by one of its columns, instead of numbered.

    The column is "parameter", "quantity" or "source". A data frame with named rows, or without such
    a column, is returned unchanged.
    """
    if frame.index.name is not None or frame.index.dtype != int:
        return frame
    for name in _NAMING:
        if name in frame:
            return frame.set_index(name)
    return frame


def _heads_with_units(frame: pd.DataFrame) -> list[str]:
    """Return the headings of a data frame's columns, with the units of columns in brackets."""
    units = frame.attrs.get("units", {})
    heads = []
    for name in frame.columns:
        unit = units.get(name)
        heads.append(f"{name} ({unit})" if unit else str(name))
    return heads


def _row_label(label: Hashable) -> Hashable:
    """Return the name of a data frame's row as it is displayed, such as E_C(0Y)X for E_C0YX.

    If the name has several parts, slashes separate them.
    """
    if isinstance(label, tuple):
        return " / ".join(display_name(str(part)) for part in label)
    if isinstance(label, str):
        return display_name(label)
    return label


def _displayed_cells(names: Sequence[Hashable], values: Sequence[Any]) -> list[Any]:
    """Return the cells of a data frame's row for display, with numbers in the display unit.

    ``names`` are the names of the columns, and ``values`` the values of the row. Missing values
    become None.
    """
    factor = 1.0
    row = dict(zip(names, values, strict=True))
    unit = row.get("unit")
    # If a row states no internal unit, its numbers are displayed without conversion.
    with suppress(InputError):
        factor, unit = display_unit(str(unit))
    decimals = _decimals_of(row, factor)
    cells: list[Any] = []
    for name, value in zip(names, values, strict=True):
        is_missing = value != value
        if name == "unit":
            cells.append(unit)
        elif is_missing:
            cells.append(None)
        elif decimals is not None and name in (*_ROUNDED_LIKE_U, *_STANDARD_UNCERTAINTIES):
            cells.append(round_like(value * factor, decimals))
        elif isinstance(value, float) and name in _IN_UNIT_OF_ROW:
            cells.append(value * factor)
        else:
            cells.append(value)
    return cells


def _decimals_of(row: Mapping[Hashable, Any], factor: float) -> int | None:
    """Return the number of decimals with which a data frame's row is displayed.

    With these decimals, the standard uncertainty of the row has two significant digits. ``row`` is
    a mapping from the names of the columns to the cells of the row. ``factor`` converts the unit of
    the cells to the display unit. Return None for a row without a standard uncertainty.
    """
    for name in _STANDARD_UNCERTAINTIES:
        u = row.get(name)
        if isinstance(u, float) and 0.0 < u < np.inf:
            return round_uncertainty(u * factor)[1]
    return None


def wrapped(text: str, width: int, first: str = "", then: str = "") -> list[str]:
    """Return a text as lines of at most ``width`` characters.

    Lines are not broken between a number and its sign or unit, within words, or within file paths.
    A line with a very long word may therefore be longer than ``width``. ``first`` is put in front
    of the first line, and ``then`` in front of every further line.
    """
    lines = textwrap.wrap(
        _with_no_break_spaces(text),
        width,
        initial_indent=first,
        subsequent_indent=then,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace(_NO_BREAK, " ") for line in lines]


def _with_no_break_spaces(text: str) -> str:
    """Return a text with no-break spaces wherever a line must not be broken.

    A line must not be broken between a number and its unit or sign, or inside a short text in
    brackets.
    """
    text = re.sub(_UNBREAKABLE, _NO_BREAK, text)
    return re.sub(_SHORT_BRACKETS, _spaces_replaced, text)


def _spaces_replaced(match: re.Match[str]) -> str:
    """Return the matched text, in which each space is replaced by a no-break space."""
    return match[0].replace(" ", _NO_BREAK)
