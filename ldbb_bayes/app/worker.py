"""What the processes of the page do: answer a question, or write the report of a session."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ldbb_bayes.app.fields import RESULT, linear_model, report_settings, source_from
from ldbb_bayes.app.understanding import refusal
from ldbb_bayes.cli.file_reports import STEPS, report_files
from ldbb_bayes.cli.output import Output
from ldbb_bayes.cli.progress import Begin, steps_of
from ldbb_bayes.files import write_whole

__all__ = ["CHOICES_NAME", "OUTCOME_NAME", "PROGRESS_NAME", "answer", "main", "warm"]

CHOICES_NAME = "said.json"  # what was typed on the page
PROGRESS_NAME = "progress.json"
OUTCOME_NAME = "outcome.json"
_LONGEST_MESSAGE = 300
_LOOK_AT_PARENT_S = 1.0


def warm() -> None:
    """Load this module, and with it all that answers need, before anything is asked."""


def answer(work: Callable[..., dict[str, Any]], folder: str, *arguments: Any) -> dict[str, Any]:
    """Return what a function makes of a session's folder, or why not.

    Parameters
    ----------
    work
        Gets the folder and the other arguments.
    folder
        Of the session.
    *arguments
        Handed on.

    Returns
    -------
    dict
        Of the function; ``{"refused": message}`` where input does not do.
    """
    try:
        return work(Path(folder), *arguments)
    except (OSError, ArithmeticError, ValueError) as error:
        return {"refused": refusal(error, Path(folder))}


def main() -> None:
    """Write the report of a session's job.

    The folder of the job and the process that wants it are the arguments of the command. How far it
    is stands in progress.json, what came of it in outcome.json.
    """
    job = Path(sys.argv[1])
    parent = int(sys.argv[2])
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    choices = json.loads((job / CHOICES_NAME).read_text(encoding="utf-8"))
    try:
        outcome = answer(_report, str(job), choices)
    except Exception as error:  # noqa: BLE001, whatever it is, the page says so
        message = f"unexpected {type(error).__name__}: {error}"
        outcome = {"refused": message[:_LONGEST_MESSAGE]}
    write_whole(job / OUTCOME_NAME, json.dumps(outcome).encode())


def _end_with(parent: int) -> None:
    """End this process and those it has started, once the parent has ended."""
    while os.getppid() == parent:
        time.sleep(_LOOK_AT_PARENT_S)
    if hasattr(os, "killpg"):
        os.killpg(0, signal.SIGKILL)
    os._exit(1)


def _report(folder: Path, choices: Mapping[str, str]) -> dict[str, Any]:
    settings = report_settings(folder, choices)
    output = Output(folder / RESULT, force=True)
    written = report_files(
        source_from(folder, choices), output, settings, linear_model(), _steps_in_file(folder)
    )
    return {
        "converged": written.converged,
        "alerts": list(written.document.alerts),
        "state": written.document.state,
    }


@contextmanager
def _steps_in_file(folder: Path) -> Iterator[Begin]:
    """Write the progress of the steps into a file."""

    def update(share: float, step: str, done: int, total: int) -> None:
        progress = {"share": share, "step": step, "done": done, "of": total}
        write_whole(folder / PROGRESS_NAME, json.dumps(progress).encode())

    yield steps_of(update, **STEPS)
