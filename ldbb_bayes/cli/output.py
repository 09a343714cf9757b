"""Where a result goes: files in a folder, JSON on stdout, tables for reading."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import typer

import ldbb_bayes as lb
from ldbb_bayes.files import check_target, staged_folder
from ldbb_bayes.report.text import parts_of
from ldbb_bayes.results import json_text, lines_of

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = ["Output", "drawing", "figure_files", "show", "write_files"]

_WIDTH = 120  # columns, where stdout is no terminal
_NARROWEST = 40  # columns; narrower terminals wrap


def show(*parts: Any) -> None:
    """Print tables, sentences and lists on stdout, as wide as the terminal.

    Parameters
    ----------
    *parts
        Tables (an empty line follows each), sentences and lists. Nothing is printed without any.
    """
    width = _WIDTH
    if sys.stdout.isatty() or "COLUMNS" in os.environ:
        width = shutil.get_terminal_size((_WIDTH, 24)).columns
    sys.stdout.write(lines_of(parts, max(width, _NARROWEST)))
    if parts:
        sys.stdout.write("\n")


def figure_files(names: Iterable[str], formats: Sequence[str] = ("png", "svg")) -> tuple[str, ...]:
    """Return the names of the files of figures.

    Parameters
    ----------
    names
        Names of figures.
    formats
        Each figure has a file in every one of them.

    Returns
    -------
    tuple of str
    """
    files: list[str] = []
    for name in names:
        files += [f"{name}.{extension}" for extension in formats]
    return tuple(files)


def drawing(name: str, *results: Any) -> Callable[[], Figure]:
    """Return what draws a figure of `ldbb_bayes.figures` when it is called.

    Parameters
    ----------
    name
        Function of `ldbb_bayes.figures`.
    *results
        Its arguments.

    Returns
    -------
    callable
        Draws the figure. matplotlib is loaded only where one is drawn.
    """

    def draw() -> Figure:
        return cast("Figure", getattr(lb.figures, name)(*results))

    return draw


def write_files(
    folder: Path,
    contents: Mapping[str, Any],
    figures: Mapping[str, Callable[[], Figure]] | None = None,
) -> None:
    """Write records, tables, texts and figures into a folder.

    Parameters
    ----------
    folder
        Exists already.
    contents
        By the name of the file: a record (.json), a table (.csv) or text.
    figures
        What draws each figure, by its name.
    """
    for name, content in contents.items():
        (folder / name).write_text(_text_of(name, content), encoding="utf-8")
    for name, draw in (figures or {}).items():
        lb.figures.save_figure(draw(), folder, name)


def _text_of(name: str, content: Any) -> str:
    if name.endswith(".json"):
        return json_text(content)
    if isinstance(content, str):
        return content
    table: pd.DataFrame = content
    return table.to_csv(index=False)


@dataclass
class Output:
    """Where a command's result goes: files into a folder, all or none, and stdout.

    Parameters
    ----------
    out
        Folder for the files. Without it none is written.
    force
        Whether files of an earlier result may be replaced.
    as_json
        Whether stdout gets the record as JSON and nothing else.
    quiet
        Whether nothing is said of what was written.
    files
        Names of the files that a result of this command consists of.
    """

    out: Path | None = None
    force: bool = False
    as_json: bool = False
    quiet: bool = True
    files: tuple[str, ...] = ()

    def check(self, *files: str, figures: Collection[str] = ()) -> None:
        """Refuse a folder whose files must not be replaced, before any work is done.

        Parameters
        ----------
        *files
            Files that this command writes; with ``force`` they are replaced.
        figures
            Names of its figures.

        Raises
        ------
        InputError
            The folder holds a result already, or files that are none of these.
        """
        self.files = (*files, *figure_files(figures))
        if self.out is not None:
            check_target(self.out, force=self.force, ours=self.files)

    def deliver(
        self,
        record: Mapping[str, Any],
        result: Any,
        contents: Mapping[str, Any] | None = None,
        figures: Mapping[str, Callable[[], Figure]] | None = None,
        *,
        write_more: Callable[[Path], object] | None = None,
        note: str = "",
    ) -> None:
        """Write the files, then print the record or the result.

        Parameters
        ----------
        record
            What is printed with ``--json``.
        result
            What is printed for reading: a result, or a tuple of tables and sentences.
        contents, figures
            Files, as of `write_files`.
        write_more
            Writes into the folder what is neither record nor table nor figure.
        note
            What else is said of the folder, after its name.

        Raises
        ------
        InputError
            The folder cannot be written; nothing is left half-written.
        """
        if self.out is not None:
            with staged_folder(self.out, force=self.force, ours=self.files) as staging:
                write_files(staging, contents or {}, figures or {})
                if write_more is not None:
                    write_more(staging)
        if self.as_json:
            sys.stdout.write(json_text(record))
            return
        parts = result if isinstance(result, tuple) else parts_of(result)
        show(*parts)
        if self.out is not None and not self.quiet:
            typer.echo(f"Written: {self.out}{note}")
