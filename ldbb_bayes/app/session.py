"""A session of the page: one browser tab with its files, its entries and its fit."""

from __future__ import annotations

import asyncio
import json
import os
import re
import signal
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from ldbb_bayes.app.fields import FIELDS, FILES, TOML
from ldbb_bayes.app.templates import words_of_page
from ldbb_bayes.app.worker import PROGRESS_NAME

__all__ = ["JOB", "Session", "kill_process"]

JOB = "job"  # subfolder of a session in which its report is written
# Seconds without a request after which a session ends: if its tabs were closed (a page that is
# reloaded closes only for a moment), if no tab was ever opened, and if a tab is open but silent
# (tabs in the background send no requests).
CLOSED_S = 8.0
UNOPENED_S = 60.0
SILENT_S = 3600.0


@dataclass(eq=False)
class Session:
    """One browser tab: its folder, the entries of its page, and its fit."""

    key: str
    folder: Path
    language: str
    #: Texts typed on the page, by the name of the entry.
    choices: dict[str, str] = field(default_factory=dict)
    #: Names of the entries that were refused.
    wrong: list[str] = field(default_factory=list)
    #: Number of changes of files and entries so far.
    edition: int = 0
    #: Value of ``edition`` for which the report was made; -1 without a report.
    fitted: int = -1
    #: Values of the sliders that describe the plan.
    asked: dict[str, Any] = field(default_factory=dict)
    #: Outcome of the last fit.
    outcome: dict[str, Any] = field(default_factory=dict)
    task: asyncio.Task[None] | None = None
    process: asyncio.subprocess.Process | None = None
    #: Time of the last request of its page, on the monotonic clock [s].
    last_request_s: float = field(default_factory=time.monotonic)
    #: Browser tabs that show the session; None before the first request.
    tabs: set[str] | None = None
    #: Closed browser tabs; their last requests may arrive late.
    closed: set[str] = field(default_factory=set)
    #: Original names of the files, by the names under which they are stored.
    names: dict[str, str] = field(default_factory=dict)
    #: Lets one file be added at a time, so that the limit on their total size holds.
    adding: asyncio.Lock = field(default_factory=asyncio.Lock)

    @property
    def is_over(self) -> bool:
        """Whether the session's tabs were closed, are silent for too long, or were never opened."""
        limit_s = CLOSED_S
        if self.tabs is None:
            limit_s = UNOPENED_S
        elif self.tabs:
            limit_s = SILENT_S
        return time.monotonic() - self.last_request_s > limit_s

    @property
    def held(self) -> dict[str, int]:
        """Sizes of the session's files [bytes] by name, in the order of their import."""
        paths = sorted((self.folder / FILES).iterdir(), key=_import_order)
        return {path.name: path.stat().st_size for path in paths}

    @property
    def certificates(self) -> list[str]:
        """Names of the files that may be certificates."""
        return [name for name in self.held if name.lower().endswith(".xml")]

    @property
    def running(self) -> bool:
        """Whether a fit of the session is running or waits for its turn."""
        return self.task is not None and not self.task.done()

    def drop(self, name: str = "*") -> None:
        """Delete one file, or all (``*``)."""
        for stored_name in self.held:
            if name in (stored_name, "*"):
                (self.folder / FILES / stored_name).unlink(missing_ok=True)
        self.update_after_file_change()

    def update_after_file_change(self) -> None:
        """Drop the typed entries that no longer apply, and count the change of the files.

        Entries that no longer apply are names of certificates that were deleted and, where there is
        a campaign.toml, all that it states itself.
        """
        file_sizes = self.held
        has_campaign_file = TOML in file_sizes
        choices = {}
        for name, text in self.choices.items():
            entry = FIELDS[name]
            is_deleted_file = entry.kind == "file" and text not in file_sizes
            is_in_campaign_file = has_campaign_file and entry.group in ("name", "table", "layout")
            if not (is_deleted_file or is_in_campaign_file):
                choices[name] = text
        self.choices = choices
        self.edition += 1

    def state(self) -> dict[str, Any]:
        """Return the state of the session, which its page requests repeatedly."""
        return {
            "files": len(self.held),
            "edition": self.edition,
            "fitted": self.fitted,
            "running": self.running,
            "progress": self._progress(),
            "outcome": self.outcome,
        }

    def _progress(self) -> dict[str, Any]:
        if self.process is None:
            return {"share": 0.0, "step": "waiting", "of": 0}
        if self.running:
            with suppress(OSError, ValueError):
                path = self.folder / JOB / PROGRESS_NAME
                progress: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
                return progress
        return {"share": 0.0, "step": "start", "of": 0}

    def word(self, key: str, **values: object) -> str:
        """Return the text of a refusal in the language of the session."""
        return str(words_of_page(self.language)["errors"][key]).format(**values)

    def said(self) -> dict[str, str]:
        """Return the typed texts by entry, with the language of the report."""
        return {**self.choices, "language": self.language}

    def stop(self) -> None:
        """Stop the fit of the session at once, with its processes."""
        if self.task is not None:
            self.task.cancel()
        kill_process(self.process)


class _ImportOrder(NamedTuple):
    """Sort key of files: those without a suffix last, then by suffix, then "2 N" before "10 N"."""

    has_no_suffix: bool
    suffix: str
    pieces: list[Any]


def _import_order(path: Path) -> _ImportOrder:
    pieces: list[Any] = re.split(r"([0-9]+)", path.name.casefold())
    for k, piece in enumerate(pieces):
        if piece.isdigit():
            pieces[k] = int(piece)
    return _ImportOrder(not path.suffix, path.suffix, pieces)


def kill_process(process: asyncio.subprocess.Process | None) -> None:
    """End a process and the processes that it started.

    Parameters
    ----------
    process
        Leader of a process group. Nothing is done for None or a process that has ended.
    """
    if process is None or process.returncode is not None:
        return
    with suppress(ProcessLookupError, PermissionError):
        if hasattr(os, "killpg"):
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
