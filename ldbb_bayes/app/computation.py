"""Computations (fits and searches) that run in separate processes and can be stopped.

Each computation belongs to one browser tab. A search finds the cheapest campaigns that reach goals
for uncertainties.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ldbb_bayes.app.worker import ENTRIES_NAME, OUTCOME_NAME, PROGRESS_NAME
from ldbb_bayes.parallel import ONE_THREAD

__all__ = ["Computation"]

_MAIN = "from ldbb_bayes.app.worker import main; main()"


@dataclass(eq=False)
class Computation:
    """A fit, or a search for the cheapest campaign, that runs in a separate process."""

    kind: str  #: Kind of computation: fit or search.
    folder: Path  #: Folder in which the process of the fit or search reads and writes.
    #: Result of the last fit or search, or an error message; empty if there was none yet.
    outcome: dict[str, Any] = field(default_factory=dict)
    #: Asyncio task that runs the fit or search, or waits for its turn; None before the first start.
    task: asyncio.Task[None] | None = None
    #: Process in which the fit or search runs; None while none is running.
    process: asyncio.subprocess.Process | None = None
    #: Time at which the process was started, on the monotonic clock [s].
    started_s: float = 0.0

    @property
    def running(self) -> bool:
        """Whether the fit or search is running or waits for its turn."""
        return self.task is not None and not self.task.done()

    @property
    def progress(self) -> dict[str, Any]:
        """Progress of a fit or search: the completed share, and the name of the present step.

        The progress also states into how many parts this step is divided (``of``), for how many
        seconds the process has run and, once the process has reported progress, how many of these
        parts are done.
        """
        if self.process is None:
            return {"share": 0.0, "step": "waiting", "of": 0, "seconds": 0}
        seconds = int(time.monotonic() - self.started_s)
        if self.running:
            with suppress(OSError, ValueError):
                path = self.folder / PROGRESS_NAME
                progress: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
                return {**progress, "seconds": seconds}
        return {"share": 0.0, "step": "start", "of": 0, "seconds": seconds}

    async def compute(self, entries: dict[str, Any]) -> dict[str, Any]:
        """Run the fit or search in a new process, and return what the process wrote.

        Parameters
        ----------
        entries
            What the user typed; the process reads it.

        Returns
        -------
        dict
            Result of the computation, or an error message; empty if the process ended without
            either.
        """
        (self.folder / ENTRIES_NAME).write_text(json.dumps(entries), encoding="utf-8")
        self.started_s = time.monotonic()
        nowhere = asyncio.subprocess.DEVNULL
        self.process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-P",
            "-c",
            _MAIN,
            str(self.folder),
            str(os.getpid()),
            self.kind,
            stdin=nowhere,
            stdout=nowhere,
            stderr=nowhere,
            env={**os.environ, **ONE_THREAD},
            start_new_session=True,
        )
        try:
            await self.process.wait()
        finally:
            self._end_process()
            self.process = None
        outcome: dict[str, Any] = {}
        with suppress(OSError, ValueError):
            outcome = json.loads((self.folder / OUTCOME_NAME).read_text(encoding="utf-8"))
        return outcome

    def _end_process(self) -> None:
        """End the process of the fit or search, and the processes that it started.

        On Windows, only the process itself is ended. Nothing is done if no process is running.
        """
        process = self.process
        if process is None or process.returncode is not None:
            return
        with suppress(ProcessLookupError, PermissionError):
            if hasattr(os, "killpg"):
                os.killpg(process.pid, signal.SIGKILL)
            else:
                process.kill()

    def stop(self) -> None:
        """Stop the fit or search at once, and end all its processes."""
        if self.task is not None:
            self.task.cancel()
        self._end_process()
