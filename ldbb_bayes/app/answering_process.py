"""A process that computes answers to the short requests of all browser pages, one at a time."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import partial
from typing import Any

from ldbb_bayes.app import worker
from ldbb_bayes.app.session import Session
from ldbb_bayes.parallel import WorkerDiedError, process_executor

__all__ = ["AnsweringProcess"]

MOST_WAITING = 100  # largest number of requests that wait for an answer; more are refused
ANSWER_S = 120.0  # longest time for the answer to one request of a browser page [s]
_ATTEMPTS = 2  # largest number of attempts to answer a request; the last attempt uses a new process


class AnsweringProcess:
    """One process that answers the requests of all browser pages, one request at a time.

    If the process dies, or takes longer than two minutes for an answer, a new process replaces it.
    """

    def __init__(self) -> None:
        """Start the process that computes the answers to the requests of all browser pages."""
        self._waiting = 0
        self._turn = asyncio.Semaphore(1)
        self._start_process()

    def _start_process(self) -> None:
        """Start a process for answers to requests, and let it import the modules that it needs."""
        self._stack = ExitStack()
        self._pool = self._stack.enter_context(process_executor(1))
        self._ready = self._pool.submit(worker.warm)

    async def ask(
        self, work: Callable[..., dict[str, Any]], session: Session, *arguments: Any
    ) -> dict[str, Any]:
        """Return the result of a function run in the answering process, or an error message.

        The function must return within two minutes. The two minutes do not include the time spent
        waiting for the answers to other requests.

        Parameters
        ----------
        work
            Function that is called with the folder of the session and the other arguments.
        session
            Session (one browser tab) whose page sent the request.
        *arguments
            Further arguments of the function.

        Returns
        -------
        dict
            Result of the function, or ``{"refused": message}``.
        """
        if self._waiting >= MOST_WAITING:
            return session.refusal("busy")
        self._waiting += 1
        call = partial(worker.answer, work, str(session.folder), *arguments)
        try:
            async with self._turn:
                return await self._answer(call, session)
        except Exception as error:  # noqa: BLE001 - the browser page shows an error of any kind
            return session.refusal("unexpected", error=worker.unexpected_message(error))
        finally:
            self._waiting -= 1

    async def _answer(self, call: Callable[[], dict[str, Any]], session: Session) -> dict[str, Any]:
        """Return the result of ``call``, which runs in the answering process, or an error message.

        If the process dies, the call is repeated in a new process. If the call takes longer than
        two minutes, the process is ended and replaced, and the call is not repeated.
        """
        if not session.folder.exists():
            return session.refusal("died")
        for _ in range(_ATTEMPTS):
            with suppress(WorkerDiedError):
                await asyncio.wait([asyncio.wrap_future(self._ready)])
                future = asyncio.wrap_future(self._pool.submit(call))
                try:
                    return await asyncio.wait_for(future, ANSWER_S)
                except TimeoutError:
                    await asyncio.to_thread(self.stop)
                    self._start_process()
                    break
        return session.refusal("died")

    def stop(self) -> None:
        """End the process that answers the browser pages, even while it computes an answer."""
        # `process_executor` kills its processes at once if its ``with`` block is interrupted. If
        # the block ended without an interruption, the current answer would be finished first.
        interruption = KeyboardInterrupt()
        self._stack.__exit__(type(interruption), interruption, None)
