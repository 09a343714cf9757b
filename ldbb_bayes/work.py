"""Independent jobs, here or on any executor: results as they come, few in flight, none lost with a worker that dies."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import dataclass, replace
from queue import SimpleQueue
from typing import Generic, TypeVar

from threadpoolctl import threadpool_limits

from ldbb_bayes.errors import InputError

__all__ = ["Lost", "done"]

T = TypeVar("T")
R = TypeVar("R")

# A job may have jobs of its own.
_TURN = threading.RLock()
_PER_WORKER, _LEAST, _WORKERS = 4, 64, 16


@dataclass(frozen=True)
class Lost:
    """What a job gives whose worker died again and again.

    Attributes
    ----------
    reason : str
    """

    reason: str


def done(
    function: Callable[[T], R],
    jobs: Iterable[T],
    executor: Executor | None = None,
    *,
    window: int | None = None,
    retries: int = 2,
) -> Iterator[tuple[int, R | Lost]]:
    """Run a function on every job, one BLAS thread each, and hand out results as they come.

    Threads of one process take turns: processes are faster.

    A worker that dies (killed, out of memory) is told apart from a job that raises. What was in flight when a pool broke is run
    again on a fresh one: first no more at a time than there are workers, then one by one, so that a job that kills its worker
    takes no other with it.

    Parameters
    ----------
    function : callable
        Job → result. On other processes it is imported, and jobs and results are pickled.
    jobs : iterable
        Read as far as needed; need not end soon.
    executor : concurrent.futures.Executor, optional
        Default: here, one after the other. One that has a method ``fresh()`` replaces workers that died.
    window : int, optional
        Jobs in flight at most; default: four per worker and at least 64.
    retries : int
        A job in flight in more breaks than these is `Lost`; the last of them it was alone in.

    Yields
    ------
    index : int
        Of the job, from 0.
    result
        Of the function, or `Lost`.

    Raises
    ------
    InputError
        When workers died that nothing replaces, or the executor gave its jobs up. Results handed out before are sound.
    Exception
        Of the first job that raises, with a note that says which. What is pending is cancelled, as it is when the iterator is
        closed.
    """
    for name, value in (("window", window), ("retries", retries)):
        if value is not None and value < 1:
            raise InputError(f"{name} must be at least 1, got {value}. Ask for more.")
    numbered = (_Job(index, job) for index, job in enumerate(jobs))
    return _here(function, numbered) if executor is None else _spread(function, numbered, executor, window, retries)


@dataclass(frozen=True)
class _Job(Generic[T]):
    index: int
    work: T
    deaths: int = 0


def _here(function: Callable[[T], R], jobs: Iterator[_Job[T]]) -> Iterator[tuple[int, R | Lost]]:
    for job in jobs:
        try:
            result = _alone(function, job.work)
        except BaseException as error:
            error.add_note(_which(job))
            raise
        yield job.index, result


def _spread(
    function: Callable[[T], R], jobs: Iterator[_Job[T]], executor: Executor, window: int | None, retries: int
) -> Iterator[tuple[int, R | Lost]]:
    workers = getattr(executor, "_max_workers", None) or _WORKERS
    room = window or max(_PER_WORKER * workers, _LEAST)
    flying: dict[Future[R], _Job[T]] = {}
    landed: SimpleQueue[Future[R]] = SimpleQueue()
    suspects = _Suspects[T](retries)
    broken = False
    try:
        while True:
            while not broken and len(flying) < suspects.room(workers, room):
                job = suspects.next() or next(jobs, None)
                if job is None:
                    break
                try:
                    future = executor.submit(_alone, function, job.work)
                except BrokenExecutor:
                    suspects.add(job)
                    broken = True
                else:
                    flying[future] = job
                    future.add_done_callback(landed.put)
                    del future
            if not flying:
                if not broken:
                    return
                _renew(executor)
                broken = False
                continue
            future = landed.get()
            job = flying.pop(future)
            if future.cancelled():
                raise InputError(
                    "the executor must last as long as its jobs, got one that gave them up (its scheduler or pool has ended). "
                    "Finished work is kept. Start it again, and run what is left."
                )
            error = future.exception()
            if error is None:
                suspects.clear(job)
                result = future.result()
                # Nothing here holds on to a result while the consumer works on it.
                del future
                yield job.index, result
                del result
            elif _worker_died(error):
                broken = broken or isinstance(error, BrokenExecutor)
                lost = suspects.add(job, alone=not isinstance(error, BrokenExecutor))
                if lost is not None:
                    yield job.index, lost
            else:
                error.add_note(_which(job))
                raise error
    finally:
        for future in flying:
            future.cancel()


class _Suspects(Generic[T]):
    """Jobs in flight when workers died, until it is known which of them are to blame."""

    def __init__(self, retries: int) -> None:
        self.retries = retries
        self.open: dict[int, _Job[T]] = {}
        self.waiting: dict[int, _Job[T]] = {}

    def room(self, workers: int, window: int) -> int:
        """Jobs in flight at most: the more often one was there, the fewer beside it."""
        worst = max((job.deaths for job in self.open.values()), default=0)
        return window if worst == 0 else workers if worst < self.retries else 1

    def next(self) -> _Job[T] | None:
        """The one most to blame, to be tried again."""
        if not self.waiting:
            return None
        return self.waiting.pop(max(self.waiting.values(), key=lambda job: job.deaths).index)

    def add(self, job: _Job[T], *, alone: bool = False) -> Lost | None:
        """A job whose worker died, to be tried again (by itself where asked); or why it is not."""
        again = replace(job, deaths=max(job.deaths + 1, self.retries if alone else 0))
        self.clear(job)
        if again.deaths > self.retries:
            return Lost(
                "its worker died whenever it was tried, the last time with no other job at work (killed, or out of memory?)"
            )
        self.open[job.index] = self.waiting[job.index] = again
        return None

    def clear(self, job: _Job[T]) -> None:
        """Not to blame, or done with."""
        self.open.pop(job.index, None)


def _alone(function: Callable[[T], R], work: T) -> R:
    """The number of BLAS threads and the filters of warnings are the whole process's: its threads take turns."""
    with _TURN, threadpool_limits(1):
        return function(work)


def _worker_died(error: BaseException) -> bool:
    """Dask's scheduler says so of one job after several deaths and goes on; a pool of all its jobs, and is of no use any more."""
    return isinstance(error, BrokenExecutor) or (
        type(error).__name__ == "KilledWorker" and type(error).__module__.startswith("distributed")
    )


def _which(job: _Job[T]) -> str:
    return f"In job {job.index}, counted from 0."


def _renew(executor: Executor) -> None:
    fresh = getattr(executor, "fresh", None)
    if fresh is None:
        raise InputError(
            "the executor's workers must live as long as their jobs, got some that died (killed, or out of memory?). Finished "
            "work is kept. Run what is left on process_executor() of ldbb_bayes.fleet.executors, which starts workers afresh."
        )
    fresh()
