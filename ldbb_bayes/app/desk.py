"""The process that answers the short questions of all pages in turn."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import partial
from typing import Any

from ldbb_bayes.app import worker
from ldbb_bayes.app.session import Session
from ldbb_bayes.parallel import WorkerDiedError, process_executor

__all__ = ["Desk"]

MOST_WAITING = 100
ANSWER_S = 120.0
_ATTEMPTS = 2  # a process that died is begun anew once
_LONGEST_MESSAGE = 300


class Desk:
    """One process that answers questions in turn; where it dies or hangs another begins."""

    def __init__(self) -> None:
        self._waiting = 0
        self._turn = asyncio.Semaphore(1)
        self._begin()

    def _begin(self) -> None:
        self._stack = ExitStack()
        self._pool = self._stack.enter_context(process_executor(1))
        self._ready = self._pool.submit(worker.warm)

    async def ask(
        self, work: Callable[..., dict[str, Any]], session: Session, *arguments: Any
    ) -> dict[str, Any]:
        """Return the answer of a function, or why there is none.

        The process has one question at a time: its time counts from where it begins.

        Parameters
        ----------
        work
            Gets the folder of the session and the other arguments, in the process.
        session
            Who asks.
        *arguments
            Handed on.

        Returns
        -------
        dict
            As of `ldbb_bayes.app.worker.answer`.
        """
        if self._waiting >= MOST_WAITING:
            return {"refused": session.word("busy")}
        self._waiting += 1
        call = partial(worker.answer, work, str(session.folder), *arguments)
        try:
            async with self._turn:
                return await self._answer(call, session)
        except Exception as error:  # noqa: BLE001, whatever it is, the page says so and goes on
            message = f"{type(error).__name__}: {error}"
            return {"refused": session.word("unexpected", error=message[:_LONGEST_MESSAGE])}
        finally:
            self._waiting -= 1

    async def _answer(self, call: Callable[[], dict[str, Any]], session: Session) -> dict[str, Any]:
        if not session.folder.exists():
            return {"refused": session.word("died")}
        for _ in range(_ATTEMPTS):
            with suppress(WorkerDiedError):
                await asyncio.wait([asyncio.wrap_future(self._ready)])
                future = asyncio.wrap_future(self._pool.submit(call))
                try:
                    return await asyncio.wait_for(future, ANSWER_S)
                except TimeoutError:
                    await asyncio.to_thread(self.stop)
                    self._begin()
                    break
        return {"refused": session.word("died")}

    def stop(self) -> None:
        """End the process, whatever it is at."""
        interruption = KeyboardInterrupt()
        self._stack.__exit__(type(interruption), interruption, None)
