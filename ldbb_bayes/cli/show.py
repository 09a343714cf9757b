"""What a command prints: JSON on stdout, tables for reading, progress on stderr."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure
    from rich.console import Console

    from ldbb_bayes.inference.mcmc import Progress

__all__ = ["counting_progress", "figure_files", "print_json", "reading_console", "sampling_progress", "show", "write_files"]


def print_json(result: Mapping[str, Any]) -> None:
    """One JSON document on stdout."""
    from ldbb_bayes.table import json_text

    sys.stdout.write(json_text(result))


def reading_console() -> Console:
    """Where tables go: stdout, 120 columns when it is no terminal."""
    from rich.console import Console

    class Terminal(Console):
        """rich ends the program when a reader closes the pipe; that is for the command to answer."""

        def on_broken_pipe(self) -> None:
            raise BrokenPipeError

    return Terminal(width=None if sys.stdout.isatty() else 120, highlight=False)


def show(*parts: Any) -> None:
    """Print tables (empty ones left out, a blank line after each) and sentences."""
    from ldbb_bayes.table import Table

    console = reading_console()
    for part in parts:
        if isinstance(part, str):
            console.print(part, markup=False, soft_wrap=len(part) < console.width)
        else:
            console.print(part.rich() if isinstance(part, Table) else part)
            console.print()


def figure_files(names: Collection[str], kinds: Collection[str] = ("png", "svg")) -> tuple[str, ...]:
    """Names of the files of figures."""
    return tuple(f"{name}.{kind}" for name in names for kind in kinds)


def write_files(folder: Path, contents: Mapping[str, Any], figures: Mapping[str, Callable[[], Figure]]) -> None:
    """Write records as JSON, tables as CSV (by their files' names) and figures (PNG and SVG) into a folder."""
    from ldbb_bayes.report.figures import save_figure
    from ldbb_bayes.table import json_text

    for name, content in contents.items():
        text = (
            json_text(content) if name.endswith(".json") else content if isinstance(content, str) else content.to_csv(index=False)
        )
        (folder / name).write_text(text, encoding="utf-8")
    for name, draw in figures.items():
        save_figure(draw(), folder, name)


@contextmanager
def _bar(quiet: bool, what: str, *, timed: bool) -> Iterator[Callable[[float, float, str], None] | None]:
    """A bar on stderr, told what is done, of how much, and more in words; none when quiet or stderr is no terminal."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    counted = () if timed else (MofNCompleteColumn(),)
    clock = TimeElapsedColumn() if timed else TimeRemainingColumn()
    columns = (TextColumn(what), BarColumn(), *counted, TextColumn("{task.description}"), clock)
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting" if timed else "", total=1.0 if timed else None)
        yield lambda done, total, text: bar.update(task, completed=done, total=total, description=text)


@contextmanager
def counting_progress(quiet: bool, what: str) -> Iterator[Callable[..., None] | None]:
    """Progress of jobs that are counted, with the time left: done with, all, and of these failed."""
    with _bar(quiet, what, timed=False) as bar:

        def update(done: int, total: int, failed: int = 0) -> None:
            if bar is not None:
                bar(done, total, f"{failed} failed" if failed else "")

        yield None if bar is None else update


@contextmanager
def sampling_progress(quiet: bool, what: str = "sampling") -> Iterator[Callable[[Progress], None] | None]:
    """Progress of a sampler towards its effective sample size."""
    with _bar(quiet, what, timed=True) as bar:

        def update(state: Progress) -> None:
            worst = state.assessment
            ess = min(worst.ess_bulk_min, worst.ess_tail_min)
            text = f"{state.steps} steps, ESS {ess:.0f} of {state.target_ess:.0f}, R-hat {worst.rhat_max:.3f}"
            if state.seconds_left is not None:
                text += f", about {state.seconds_left:.0f} s left"
            if bar is not None:
                bar(min(ess / state.target_ess, 1.0), 1.0, text)

        yield None if bar is None else update
