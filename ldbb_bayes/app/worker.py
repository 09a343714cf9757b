"""Functions, such as the fit of a model, that the server runs in separate processes.

A session is one browser tab of ``ldbb-bayes app``.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from ldbb_bayes.app.cheapest import find_cheapest_campaigns
from ldbb_bayes.app.fields import RESULT, linear_model, report_settings, source_from
from ldbb_bayes.app.understanding import refusal
from ldbb_bayes.cli.file_reports import STEPS, report_files
from ldbb_bayes.cli.output import Output
from ldbb_bayes.cli.progress import Begin, steps_of
from ldbb_bayes.files import write_whole

__all__ = [
    "ENTRIES_NAME",
    "OUTCOME_NAME",
    "PROGRESS_NAME",
    "answer",
    "main",
    "unexpected_message",
    "warm",
]

# name of the file with the texts that the user typed on the browser page
ENTRIES_NAME = "entries.json"
PROGRESS_NAME = "progress.json"  # name of the file with the progress of a computation
OUTCOME_NAME = "outcome.json"  # name of the file with a computation's result or error message
# Largest length of the message about an unexpected error that the browser page shows [characters].
_LONGEST_MESSAGE = 300
_LOOK_AT_PARENT_S = 1.0  # time between two checks of whether the server's process still runs [s]


def warm() -> None:
    """Do nothing. The server calls this function in a new process to make it import this module.

    Because the import takes time, it begins before the first request comes.
    """


def answer(work: Callable[..., dict[str, Any]], folder: str, *arguments: Any) -> dict[str, Any]:
    """Call a function with the folder of a session, and return its result or an error message.

    Parameters
    ----------
    work
        Function that is called with the folder and the other arguments.
    folder
        Path of the folder of the session (one browser tab).
    *arguments
        Further arguments of the function.

    Returns
    -------
    dict
        Result of the function, or ``{"refused": message}`` if the input cannot be used.
    """
    try:
        return work(Path(folder), *arguments)
    except (OSError, ArithmeticError, ValueError) as error:
        return {"refused": refusal(error, Path(folder))}


def unexpected_message(error: Exception) -> str:
    """Return the class and the beginning of the message of an unexpected error, for the page."""
    return f"{type(error).__name__}: {error}"[:_LONGEST_MESSAGE]


def main() -> None:
    """Run the fit or the search for one browser tab, in a process that the server has started.

    The three arguments of the process are a folder, the id of the server's process and the kind of
    computation: fit or search. The folder holds a copy of the files of the browser tab. The process
    writes into the same folder: the results, the progress (``progress.json``) and the outcome
    (``outcome.json``).
    """
    job = Path(sys.argv[1])
    parent = int(sys.argv[2])
    threading.Thread(target=_end_after_parent, args=(parent,), daemon=True).start()
    entries = json.loads((job / ENTRIES_NAME).read_text(encoding="utf-8"))
    try:
        outcome = answer(_COMPUTATIONS[sys.argv[3]], str(job), entries)
    except Exception as error:  # noqa: BLE001 - an error of any kind is shown on the browser page
        outcome = {"unexpected": unexpected_message(error)}
    write_whole(job / OUTCOME_NAME, json.dumps(outcome).encode())


def _end_after_parent(parent: int) -> None:
    """End this process, and the processes that it started, once its parent process has ended.

    ``parent`` is the id of the parent process, which is the process of the server.
    """
    while os.getppid() == parent:
        time.sleep(_LOOK_AT_PARENT_S)
    if hasattr(os, "killpg"):
        os.killpg(0, signal.SIGKILL)
    os._exit(1)


def _write_report(folder: Path, entries: Mapping[str, str]) -> dict[str, Any]:
    """Fit a model to the user's readings, write the report, and return its warnings and verdict.

    ``folder`` holds a copy of the files that the user added in one browser tab. ``entries`` are the
    texts typed on the page; the keys are the names of the entry fields. In the result,
    ``converged`` says whether the fit converged, ``alerts`` are the warnings, and ``state`` is the
    sentence on whether the results can be used. Both are in the language of the report,
    ``language``.
    """
    settings = report_settings(folder, entries)
    output = Output(folder / RESULT, force=True)
    written = report_files(
        source_from(folder, entries), output, settings, linear_model(), _steps_in_file(folder)
    )
    return {
        "converged": written.converged,
        "alerts": list(written.document.alerts),
        "state": written.document.state,
        "language": settings["language"],
    }


def _search_campaigns(folder: Path, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Search for the cheapest campaigns, and return the result of `find_cheapest_campaigns`.

    ``folder`` holds a copy of the campaign. ``asked`` are the texts typed on the page; the keys are
    the names of the entry fields.
    """
    begin = steps_of(partial(_write_progress, folder), search=1.0)
    return find_cheapest_campaigns(folder, asked, begin("search"))


# Functions that fit or search; the keys are the kinds of computation.
_COMPUTATIONS: Mapping[str, Callable[..., dict[str, Any]]] = {
    "fit": _write_report,
    "search": _search_campaigns,
}


@contextmanager
def _steps_in_file(folder: Path) -> Iterator[Begin]:
    """Yield a function that is called with the name of each step of a report when the step begins.

    A step in making a report is, for example, the fit of the model. Each call returns another
    function, which writes the progress of this step to the file ``progress.json`` in ``folder``.
    """
    yield steps_of(partial(_write_progress, folder), **STEPS)


def _write_progress(folder: Path, share: float, step: str, done: int, total: int) -> None:
    """Write the progress of a computation to the file ``progress.json`` in ``folder``.

    ``share`` is the completed share of the computation, and ``step`` the name of the present step.
    ``done`` of ``total`` parts of this step are finished.
    """
    progress = {"share": share, "step": step, "done": done, "of": total}
    write_whole(folder / PROGRESS_NAME, json.dumps(progress).encode())
