"""All sessions (browser tabs) of the server: how they start, compute and end."""

from __future__ import annotations

import asyncio
import secrets
import shutil
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ldbb_bayes.app.answering_process import AnsweringProcess
from ldbb_bayes.app.computation import Computation
from ldbb_bayes.app.fields import FILES, RESULT
from ldbb_bayes.app.session import Session
from ldbb_bayes.app.templates import Templates

__all__ = ["SessionRegistry"]

MOST_SESSIONS = 32  # largest number of sessions (browser tabs) at the same time
LOOK_S = 1.0  # time between checks whether sessions (browser tabs) have ended [s]
# A browser page is silent if it has sent no request for this time [s]. The computation of a silent
# page is stopped if another computation of the same kind (fit or search) is waiting for a page that
# is not silent.
ABANDONED_S = 150.0


def _one_of_each_kind() -> dict[str, asyncio.Semaphore]:
    """Return locks that let one fit and one search run at a time; the keys are fit and search."""
    return {"fit": asyncio.Semaphore(1), "search": asyncio.Semaphore(1)}


@dataclass(eq=False)
class SessionRegistry:
    """All sessions (browser tabs), and the process that answers the requests of their pages."""

    folder: Path  #: Folder that holds one folder for each session (browser tab).
    #: Process that answers the requests of all sessions (browser tabs).
    answering_process: AnsweringProcess
    templates: Templates = field(default_factory=Templates)  #: Templates of the browser page.
    #: All sessions (browser tabs) that have not ended. The key of a session is the random text that
    #: identifies the session in URL paths.
    sessions: dict[str, Session] = field(default_factory=dict)
    #: Dict of two locks. The lock ``fit`` makes sure that only one fit runs at a time, because a
    #: fit uses all cores. The lock ``search`` makes sure that only one search runs at a time; a
    #: search looks for the cheapest campaign.
    turns: dict[str, asyncio.Semaphore] = field(default_factory=_one_of_each_kind)

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
        """End sessions (browser tabs) that nobody uses, and stop abandoned computations.

        The files of the ended sessions are deleted. These steps are repeated every second until the
        task is cancelled.
        """
        while True:
            await asyncio.sleep(LOOK_S)
            for session in list(self.sessions.values()):
                if session.is_over:
                    self.end(session)
            for kind in self.turns:
                self._stop_abandoned(kind)
            for folder in self.folder.iterdir():
                # A computation may have written files after the end of its session (browser tab):
                # delete them.
                if folder.name not in self.sessions:
                    shutil.rmtree(folder, ignore_errors=True)

    def _stop_abandoned(self, kind: str) -> None:
        """Stop each computation of a silent page, if the computation of another page is waiting.

        A page is the browser page of one session. It is silent if it has sent no request within the
        last 150 seconds. Computations are stopped only if the page of the waiting computation is
        not silent. ``kind`` is the kind of computation: fit or search.
        """
        abandoned = []
        is_awaited = False
        for session in self.sessions.values():
            computation = session.computations[kind]
            silence_s = time.monotonic() - session.last_request_s
            is_silent = silence_s > ABANDONED_S
            if computation.process is not None and is_silent:
                abandoned.append(session)
            if computation.process is None and computation.running and not is_silent:
                is_awaited = True
        if not is_awaited:
            return
        for session in abandoned:
            computation = session.computations[kind]
            computation.stop()
            computation.outcome = session.refusal(f"{kind}_gave_way")

    async def fit(self, session: Session) -> None:
        """Write the report of a session (one browser tab) in a separate process.

        The process reads a copy of the session's files. An earlier report is replaced only after
        the new report is complete. The result of the fit, or an error message, is then stored.
        """
        fit = session.fit
        try:
            async with self.turns[fit.kind]:
                edition = session.edition
                shutil.rmtree(fit.folder, ignore_errors=True)
                files = session.folder / FILES
                await asyncio.to_thread(shutil.copytree, files, fit.folder / FILES)
                outcome = await fit.compute(session.typed_texts())
            fit.outcome = _result_or_refusal(session, fit, outcome)
            if "refused" not in fit.outcome:
                session.forget_search()
                shutil.rmtree(session.folder / RESULT, ignore_errors=True)
                (fit.folder / RESULT).rename(session.folder / RESULT)
                session.edition_of_report = edition
                session.plan_entries = {}
        except OSError as error:
            fit.outcome = _refusal_of_files(session, error)

    async def search(self, session: Session) -> None:
        """Search for the cheapest campaign that reaches the uncertainty goals of a session.

        The session is one browser tab. The search runs in a separate process, which reads a copy of
        the campaign of the session's report. The result of the search, or an error message, is then
        stored.
        """
        search = session.search
        try:
            async with self.turns[search.kind]:
                shutil.rmtree(search.folder, ignore_errors=True)
                campaign = Path(RESULT) / "campaign"
                copy = search.folder / campaign
                await asyncio.to_thread(shutil.copytree, session.folder / campaign, copy)
                outcome = await search.compute(session.search_entries)
            search.outcome = _result_or_refusal(session, search, outcome)
        except OSError as error:
            search.outcome = _refusal_of_files(session, error)


def _result_or_refusal(
    session: Session, computation: Computation, outcome: dict[str, Any]
) -> dict[str, Any]:
    """Return the result of a computation, or an error message if there is no result.

    ``outcome`` is what the process of the computation wrote; it is empty if the process has ended
    without writing anything.
    """
    if not outcome:
        return session.refusal(f"{computation.kind}_died")
    if "unexpected" in outcome:
        return session.refusal("unexpected", error=outcome["unexpected"])
    return outcome


def _refusal_of_files(session: Session, error: OSError) -> dict[str, Any]:
    """Return the error message for files that could not be copied.

    ``session`` is the session (one browser tab) to which the files belong.
    """
    return session.refusal("unexpected", error=error.strerror or "a file could not be copied")
