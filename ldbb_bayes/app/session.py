"""A session of the page: one tab, its files, what was typed, and its fit."""

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

JOB = "job"  # folder of a session in which its report is written
# Seconds until a session ends: closed (a page that is loaded anew is back at once), never opened,
# silent (tabs in the background sleep).
CLOSED_S = 8.0
UNOPENED_S = 60.0
SILENT_S = 3600.0


@dataclass(eq=False)
class Session:
    """One tab: its folder, what its page was told, and its fit."""

    key: str
    folder: Path
    language: str
    #: What was typed, by the name of the entry.
    choices: dict[str, str] = field(default_factory=dict)
    #: Entries that were refused.
    wrong: list[str] = field(default_factory=list)
    #: Counts changes of files and choices.
    edition: int = 0
    #: Edition that the report is of; -1 where there is none.
    fitted: int = -1
    #: Sliders of the plan.
    asked: dict[str, Any] = field(default_factory=dict)
    #: What came of the last fit.
    outcome: dict[str, Any] = field(default_factory=dict)
    task: asyncio.Task[None] | None = None
    process: asyncio.subprocess.Process | None = None
    #: When its page last asked for something, on the monotonic clock [s].
    last_request_s: float = field(default_factory=time.monotonic)
    #: Tabs that show it; None until the first has asked.
    tabs: set[str] | None = None
    #: Closed tabs, whose last requests may come late.
    closed: set[str] = field(default_factory=set)
    #: Names by which files were sent, by those by which they are stored.
    names: dict[str, str] = field(default_factory=dict)
    #: Files come one after another, so that they fit together.
    adding: asyncio.Lock = field(default_factory=asyncio.Lock)

    @property
    def is_over(self) -> bool:
        """Whether its tabs were closed, are silent for too long, or never came."""
        limit_s = CLOSED_S
        if self.tabs is None:
            limit_s = UNOPENED_S
        elif self.tabs:
            limit_s = SILENT_S
        return time.monotonic() - self.last_request_s > limit_s

    @property
    def held(self) -> dict[str, int]:
        """Sizes of its files [bytes], in the order in which an import takes them."""
        paths = sorted((self.folder / FILES).iterdir(), key=_import_order)
        return {path.name: path.stat().st_size for path in paths}

    @property
    def certificates(self) -> list[str]:
        """Names of the files that may be certificates."""
        return [name for name in self.held if name.lower().endswith(".xml")]

    @property
    def running(self) -> bool:
        """Whether a fit is under way, or waits for its turn."""
        return self.task is not None and not self.task.done()

    def drop(self, name: str = "*") -> None:
        """Delete one file, or all (``*``)."""
        for stored_name in self.held:
            if name in (stored_name, "*"):
                (self.folder / FILES / stored_name).unlink(missing_ok=True)
        self.changed()

    def changed(self) -> None:
        """Forget what no longer applies to the files.

        That is what a campaign says itself, and certificates that were dropped.
        """
        sizes = self.held
        choices = {}
        for name, text in self.choices.items():
            entry = FIELDS[name]
            is_dropped = entry.kind == "file" and text not in sizes
            is_of_campaign = TOML in sizes and entry.group in ("name", "table", "layout")
            if not (is_dropped or is_of_campaign):
                choices[name] = text
        self.choices = choices
        self.edition += 1

    def state(self) -> dict[str, Any]:
        """Return what the page asks for again and again."""
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
        """Return what a refusal says, in the language of the session."""
        return str(words_of_page(self.language)["errors"][key]).format(**values)

    def said(self) -> dict[str, str]:
        """Return what was typed, with the language of the sheets."""
        return {**self.choices, "language": self.language}

    def stop(self) -> None:
        """End its processes now."""
        if self.task is not None:
            self.task.cancel()
        kill_process(self.process)


class _ImportOrder(NamedTuple):
    """Files without a suffix last, then by suffix, 2 N before 10 N."""

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
    """End a process and those that it has started.

    Parameters
    ----------
    process
        Leads a process group of its own; None, or one that has ended, is left alone.
    """
    if process is None or process.returncode is not None:
        return
    with suppress(ProcessLookupError, PermissionError):
        if hasattr(os, "killpg"):
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
