"""Output of a command's results: files in a folder, and JSON or tables on stdout."""

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
from ldbb_bayes.results import json_text, lines_of, parts_of, wrapped

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = ["Output", "drawing", "figure_files", "show", "show_written", "write_files"]

_WIDTH = 120  # width of the tables that a command prints if stdout is not a terminal [characters]
_NARROWEST = 40  # smallest width of printed tables [characters]; narrower terminals wrap lines


def show(*parts: Any) -> None:
    """Print tables, sentences and lists on stdout, as wide as the terminal.

    Parameters
    ----------
    *parts
        Tables, sentences and lists. An empty line follows each table. Without parts, nothing is
        printed.
    """
    sys.stdout.write(lines_of(parts, _terminal_width() or _WIDTH))
    if parts:
        sys.stdout.write("\n")


def show_written(line: str) -> None:
    """Print a line that names what was written, wrapped between words on a terminal.

    Unlike in the sentences that `show` prints, no character of the line is changed, so that a path
    can be copied.
    """
    width = _terminal_width()
    if width is None:
        typer.echo(line)
    else:
        # The no-break space keeps a path that is wider than the terminal beside the first word.
        unbroken = line.replace(": ", ":\N{NO-BREAK SPACE}", 1)
        typer.echo("\n".join(wrapped(unbroken, width)))


def _terminal_width() -> int | None:
    """Return the width for texts on stdout [characters], or None if stdout is no terminal.

    The environment variable COLUMNS counts as the width of a terminal.
    """
    if sys.stdout.isatty() or "COLUMNS" in os.environ:
        return max(shutil.get_terminal_size((_WIDTH, 24)).columns, _NARROWEST)
    return None


def figure_files(names: Iterable[str], formats: Sequence[str] = ("png", "svg")) -> tuple[str, ...]:
    """Return the names of the files in which figures are saved.

    Parameters
    ----------
    names
        Names of the figures.
    formats
        File formats; each figure has one file in every format.

    Returns
    -------
    tuple of str
        Names such as ``rank_ecdf.png``.
    """
    files: list[str] = []
    for name in names:
        files += [f"{name}.{extension}" for extension in formats]
    return tuple(files)


def drawing(name: str, *results: Any) -> Callable[[], Figure]:
    """Return a function without arguments that draws a named figure of `ldbb_bayes.figures`.

    Parameters
    ----------
    name
        Name of a function of `ldbb_bayes.figures`.
    *results
        Arguments of that function.

    Returns
    -------
    callable
        Function without arguments that draws the figure. It loads matplotlib when it is called.
    """

    def draw() -> Figure:
        """Draw the figure named ``name`` from results such as a posterior, and return it."""
        return cast("Figure", getattr(lb.figures, name)(*results))

    return draw


def write_files(
    folder: Path,
    contents: Mapping[str, Any],
    figures: Mapping[str, Callable[[], Figure]] | None = None,
) -> None:
    """Write JSON files, tables, texts and figures into a folder.

    Parameters
    ----------
    folder
        Existing folder.
    contents
        Contents of the files: dictionaries (.json), tables (.csv) and texts. The keys are the names
        of the files.
    figures
        Functions that draw the figures; the keys are the names of the figures.
    """
    for name, content in contents.items():
        (folder / name).write_text(_text_of(name, content), encoding="utf-8")
    for name, draw in (figures or {}).items():
        lb.figures.save_figure(draw(), folder, name)


def _text_of(name: str, content: Any) -> str:
    """Return the content of a file as text.

    The text is JSON if the file's name ends with .json. Otherwise a table becomes a CSV text, and
    ``content`` that already is a text is returned unchanged.
    """
    if name.endswith(".json"):
        return json_text(content)
    if isinstance(content, str):
        return content
    table: pd.DataFrame = content
    return table.to_csv(index=False)


@dataclass
class Output:
    """Output of a command: text on stdout, and files in a folder.

    Either all files are written or none.

    Parameters
    ----------
    out
        Folder for the files. Without a folder no file is written.
    force
        Whether files of an earlier result may be replaced.
    as_json
        Whether to print only the dictionary of the result, as JSON.
    quiet
        Whether to omit the message that names the written folder.
    files
        Names of the files that this command writes. An existing folder is replaced only if it holds
        no other files.
    """

    out: Path | None = None
    force: bool = False
    as_json: bool = False
    quiet: bool = True
    files: tuple[str, ...] = ()

    def check(self, *files: str, figures: Collection[str] = ()) -> None:
        """Raise an `InputError` if the output folder must not be written.

        This method is called before the results are computed.

        Parameters
        ----------
        *files
            Names of the files that this command writes. If ``force`` is true, existing files of
            these names are replaced.
        figures
            Names of the figures that this command writes.

        Raises
        ------
        InputError
            If the folder exists and ``force`` is false, or if it holds files that this command does
            not write.
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
        """Write the files of a command's result, then print the result as JSON or as tables.

        Parameters
        ----------
        record
            Dictionary with the result. With the option ``--json`` it is printed as JSON.
        result
            What is printed without the option ``--json``: an object, or a tuple of tables and
            sentences.
        contents, figures
            Contents of the files, and functions that draw the figures. The keys are the names of
            the files and figures; see `write_files`.
        write_more
            Function that writes further files into the folder.
        note
            Text to print after the name of the written folder.

        Raises
        ------
        InputError
            If the folder cannot be written. No incomplete result is left in this case.
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
            show_written(f"Written: {self.out}{note}")
