"""One table for the terminal, for HTML and for CSV; and results as JSON."""

from __future__ import annotations

import html
import io
import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import pandas as pd

from ldbb_bayes.units import typeset

if TYPE_CHECKING:
    from rich.table import Table as RichTable

__all__ = ["Table", "json_text", "table_html"]


@dataclass(frozen=True)
class Table:
    """A table as it is read, and as it is filed.

    Attributes
    ----------
    caption : str
    heads : tuple of str
        Names of the columns with their units: ``force (N)``.
    numeric : tuple of bool
        Columns that stand flush right.
    rows : tuple of tuple
        Cells; the first names the row. A number is shown with four digits, None as a dash, all else as it is.
    """

    caption: str
    heads: tuple[str, ...]
    numeric: tuple[bool, ...]
    rows: tuple[tuple[Any, ...], ...]

    @classmethod
    def of(cls, caption: str, heads: Sequence[str], rows: Sequence[Sequence[Any]], *, text: Collection[str] = ()) -> Self:
        """Return a table whose columns are numbers but for the first and those named in ``text``."""
        numeric = tuple(k > 0 and head not in text for k, head in enumerate(heads))
        return cls(caption, tuple(heads), numeric, tuple(tuple(row) for row in rows))

    @classmethod
    def of_frame(cls, caption: str, frame: pd.DataFrame, *, text: Collection[str] = ()) -> Self:
        """Return a data frame's columns as a table, without its index."""
        return cls.of(caption, [str(name) for name in frame.columns], frame.to_numpy(dtype=object).tolist(), text=text)

    def frame(self) -> pd.DataFrame:
        """Return the cells as they are, for CSV."""
        return pd.DataFrame(list(self.rows), columns=list(self.heads))

    def shown(self) -> tuple[tuple[str, ...], ...]:
        """Return the rows as texts."""
        return tuple(tuple(_cell(value) for value in row) for row in self.rows)

    def rich(self) -> RichTable:
        """Return the table for a console: only text beyond the first column is broken into lines."""
        from rich.table import Table as RichTable
        from rich.text import Text

        made = RichTable(title=self.caption or None, title_justify="left", box=None, pad_edge=False)
        for k, (head, numeric) in enumerate(zip(self.heads, self.numeric, strict=True)):
            made.add_column(Text(head.replace(" (", "\n(")), justify="right" if numeric else "left", no_wrap=numeric or k == 0)
        for row in self.shown():
            made.add_row(*map(Text, row))
        return made

    def text(self, width: int = 120) -> str:
        """Return the table as lines of at most ``width`` characters."""
        from rich.console import Console

        written = io.StringIO()
        Console(file=written, width=width, color_system=None).print(self.rich())
        return "\n".join(line.rstrip() for line in written.getvalue().splitlines())

    def html(self) -> str:
        """Return the table as HTML; everything is escaped."""

        def row_of(tags: Iterable[str], values: Iterable[str]) -> str:
            marks = [' class="n"' if numeric else "" for numeric in self.numeric]
            cells = zip(tags, marks, values, strict=True)
            return "".join(f"<{tag}{mark}>{html.escape(typeset(v))}</{tag.split()[0]}>" for tag, mark, v in cells)

        head = row_of(['th scope="col"'] * len(self.heads), self.heads)
        tags = ['th scope="row"', *["td"] * (len(self.heads) - 1)]
        body = "".join(f"<tr>{row_of(tags, row)}</tr>\n" for row in self.shown())
        caption = f"<caption>{html.escape(typeset(self.caption))}</caption>" if self.caption else ""
        return f"<table>{caption}<thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody></table>"


def _cell(value: Any) -> str:
    if value is None:
        return "–"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def table_html(caption: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows of the same keys as HTML; everything is escaped."""
    heads = list(rows[0]) if rows else []
    words = [head for head in heads if any(isinstance(row[head], str) for row in rows)]
    return Table.of(caption, heads, [list(row.values()) for row in rows], text=words).html()


def json_text(result: Mapping[str, Any]) -> str:
    """Return a result as JSON; numbers that are not finite become null."""
    return json.dumps(_plain(result), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    return None if isinstance(value, float) and value - value != 0.0 else value
