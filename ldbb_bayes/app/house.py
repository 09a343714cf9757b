"""Start and end of the sessions (browser tabs) of the server, and the fits of the sessions."""

from __future__ import annotations

import asyncio
import json
import os
import secrets
import shutil
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from ldbb_bayes.app.desk import Desk
from ldbb_bayes.app.fields import FILES, RESULT
from ldbb_bayes.app.session import JOB, Session, kill_process
from ldbb_bayes.app.templates import Templates
from ldbb_bayes.app.worker import CHOICES_NAME, OUTCOME_NAME
from ldbb_bayes.parallel import ONE_THREAD

__all__ = ["House"]

MOST_SESSIONS = 32  # largest number of sessions (browser tabs) at the same time
LOOK_S = 1.0  # time between checks whether sessions (browser tabs) have ended [s]
# A fit is stopped if its page has sent no request for this time [s] and another fit is waiting. The
# page of the waiting fit must have sent a request within this time.
ABANDONED_S = 150.0
_FIT = "from ldbb_bayes.app.worker import main; main()"


@dataclass(eq=False)
class House:
    """All sessions (browser tabs), and the process that answers the requests of their pages."""

    folder: Path  #: Folder that holds one folder for each session.
    desk: Desk  #: Process that answers the requests of all sessions.
    templates: Templates = field(default_factory=Templates)  #: Templates of the browser page.
    #: Sessions; the keys are `Session.key`.
    sessions: dict[str, Session] = field(default_factory=dict)
    #: Lock that lets only one fit run at a time, because a fit uses all cores.
    turn: asyncio.Semaphore = field(default_factory=lambda: asyncio.Semaphore(1))

    def begin(self, language: str) -> Session | None:
        """Return a new session for a browser tab; None if there are already 32 sessions.

        ``language`` is the language of the page: en or de.
        """
        if len(self.sessions) >= MOST_SESSIONS:
            return None
        key = secrets.token_urlsafe(12)
        session = Session(key, self.folder / key, language)
        (session.folder / FILES).mkdir(parents=True)
        self.sessions[key] = session
        return session

    def end(self, session: Session) -> None:
        """Stop the computations of a session (one browser tab) and delete the session's files."""
        self.sessions.pop(session.key, None)
        session.stop()
        shutil.rmtree(session.folder, ignore_errors=True)

    async def look_after(self) -> None:
        """End sessions that nobody uses any more, delete their files, and stop abandoned fits.

        These steps are repeated every second until the task is cancelled.
        """
        while True:
            await asyncio.sleep(LOOK_S)
            for session in list(self.sessions.values()):
                if session.is_over:
                    self.end(session)
            self._stop_abandoned_fits()
            for folder in self.folder.iterdir():
                # A computation may have written files after the end of its session: delete them.
                if folder.name not in self.sessions:
                    shutil.rmtree(folder, ignore_errors=True)

    def _stop_abandoned_fits(self) -> None:
        """Stop each fit whose page sends no more requests, if the fit of another page is waiting.

        Fits are stopped only if the page of the waiting fit has sent a request within the last 150
        seconds.
        """
        abandoned = []
        is_awaited = False
        for session in self.sessions.values():
            silence_s = time.monotonic() - session.last_request_s
            is_silent = silence_s > ABANDONED_S
            if session.process is not None and is_silent:
                abandoned.append(session)
            if session.process is None and session.running and not is_silent:
                is_awaited = True
        if not is_awaited:
            return
        for session in abandoned:
            session.stop()
            session.outcome = session.refusal("gave_way")

    async def fit(self, session: Session) -> None:
        """Write the report of a session (one browser tab) in a separate process.

        The process reads a copy of the session's files. An earlier report is replaced only after
        the new report is complete. The outcome of the session is then stored: the result of the
        fit, or a refusal.
        """
        job = session.folder / JOB
        try:
            async with self.turn:
                edition = session.edition
                shutil.rmtree(job, ignore_errors=True)
                await asyncio.to_thread(shutil.copytree, session.folder / FILES, job / FILES)
                choices = json.dumps(session.said())
                (job / CHOICES_NAME).write_text(choices, encoding="utf-8")
                session.process = await _start_fit(job)
                await session.process.wait()
            session.outcome = session.refusal("fit_died")
            with suppress(OSError, ValueError):
                session.outcome = json.loads((job / OUTCOME_NAME).read_text(encoding="utf-8"))
            if "unexpected" in session.outcome:
                error = session.outcome["unexpected"]
                session.outcome = session.refusal("unexpected", error=error)
            if "refused" not in session.outcome:
                shutil.rmtree(session.folder / RESULT, ignore_errors=True)
                (job / RESULT).rename(session.folder / RESULT)
                session.fitted = edition
                session.asked = {}
        except OSError as error:
            reason = error.strerror or "a file could not be copied"
            session.outcome = session.refusal("unexpected", error=reason)
        finally:
            kill_process(session.process)
            session.process = None


async def _start_fit(job: Path) -> asyncio.subprocess.Process:
    nowhere = asyncio.subprocess.DEVNULL
    return await asyncio.create_subprocess_exec(
        sys.executable,
        "-P",
        "-c",
        _FIT,
        str(job),
        str(os.getpid()),
        stdin=nowhere,
        stdout=nowhere,
        stderr=nowhere,
        env={**os.environ, **ONE_THREAD},
        start_new_session=True,
    )
