"""Functions that run independent jobs and give a result for each job, even if workers die."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import islice
from queue import SimpleQueue
from typing import Generic, TypeVar

from ldbb_bayes.errors import InputError
from ldbb_bayes.parallel.blas_threads import one_blas_thread
from ldbb_bayes.parallel.process_pool import WorkerDiedError

__all__ = ["Lost", "done", "start_early"]

R = TypeVar("R")
T = TypeVar("T")

# Number of submitted jobs per worker process that may be unfinished at one time. It is larger than
# one, so that a worker need not wait while this process handles results.
_JOBS_PER_WORKER = 4
# Number of submitted jobs that may be unfinished at one time, for an executor whose number of
# workers is not known.
_JOBS_IN_FLIGHT = 64
# Lock that lets only one thread of a process run a job at a time. The threads share the linear
# algebra library BLAS and Python's settings for warnings; their jobs must therefore not run at the
# same time. One thread may take the lock twice, because a job may itself run jobs.
_TURN = threading.RLock()


@dataclass(frozen=True)
class Lost:
    """Object that stands in place of a job's result if the job's worker process died twice."""

    reason: str = (
        "its worker died twice, the second time with no other job at work (killed, or out of"
        " memory?)"
    )


@dataclass(frozen=True)
class _Attempt(Generic[T]):
    """One attempt to run a job of a parallel computation in a worker process.

    A second attempt is made if the worker process dies during the first.
    """

    index: int  # index of the job among the jobs of a parallel computation, from 0
    job: T  # argument of the function that a parallel computation calls once for each job
    # whether this is the second and last attempt to run the job of a parallel computation
    is_last: bool


def done(
    function: Callable[[T], R], jobs: Iterable[T], executor: Executor | None = None
) -> Iterator[tuple[int, R | Lost]]:
    """Yield the index (from 0) and the result of every job, in the order in which jobs finish.

    Each job uses one thread of BLAS, the linear algebra library behind NumPy. If the worker process
    of a job dies, for example because it lacks memory, the job is repeated alone after all other
    jobs. If the worker process dies again, the result of the job is `Lost`. With an executor of
    threads, jobs run one at a time. An executor of processes is faster, but requires that the
    function can be imported, and that jobs and results can be pickled. Jobs are taken from ``jobs``
    only when they are needed. When the iterator that this function returns is closed, pending jobs
    are cancelled.

    Parameters
    ----------
    function : function that is called with each job as its argument: once, or a second time if
        the worker process died the first time.
    jobs : the jobs.
    executor : executor that makes the calls. If it is None, this process does one job after the
        other.

    Raises
    ------
    Exception
        If a job raises an exception. The same exception is raised again, with a note that states
        the index of the job, and pending jobs are cancelled.
    InputError
        If the executor stopped before all jobs were done.
    """
    indexed_jobs = enumerate(jobs)
    limit = _limit_in_flight(executor)
    retries = deque[_Attempt[T]]()
    in_flight: dict[Future[R], _Attempt[T]] = {}
    finished: SimpleQueue[Future[R]] = SimpleQueue()

    def submit(attempt: _Attempt[T]) -> None:
        """Let the executor make one attempt to run a job.

        When the attempt ends, its future (of ``concurrent.futures``) is put into the queue
        ``finished``.
        """
        future = _submit(partial(_run_in_turn, function, attempt.job), executor)
        in_flight[future] = attempt
        future.add_done_callback(finished.put)

    try:
        while True:
            for index, job in islice(indexed_jobs, limit - len(in_flight)):
                submit(_Attempt(index, job, is_last=False))
            if not in_flight:
                if not retries:
                    return
                submit(retries.popleft())
            future = finished.get()
            attempt = in_flight.pop(future)
            error = _error_of(future)
            if error is None:
                yield attempt.index, future.result()
            elif not _is_death_of_worker(error):
                error.add_note(f"In job {attempt.index}, counted from 0.")
                raise error
            elif attempt.is_last:
                yield attempt.index, Lost()
            else:
                retries.append(_Attempt(attempt.index, attempt.job, is_last=True))
            # The result is deleted here, so that it does not stay in memory during the wait for the
            # next job.
            del future
    except BrokenExecutor as error:
        raise InputError(
            "the executor must last as long as its jobs, got one that gave them up (its workers"
            " died, or its scheduler ended). Finished work is kept. Run what is left on"
            " process_executor() of ldbb_bayes.parallel, which starts workers afresh."
        ) from error
    finally:
        for future in in_flight:
            future.cancel()


def start_early(call: Callable[[], R], executor: Executor | None) -> Callable[[], R]:
    """Start a call in another process, and return a function that waits for the result of the call.

    Parameters
    ----------
    call : function without arguments that is called.
    executor : executor that makes the call in another process. If it is None, this process makes
        the call when the returned function is called.

    Returns
    -------
    A function without arguments that returns the result of the call. If the other process is still
    busy with earlier calls and has not begun this one, or if the call failed there, the function
    makes the call in this process.
    """
    if executor is None:
        return call
    future = executor.submit(call)

    def result() -> R:
        """Return the result of the call that another process is making or has made.

        If the other process has not begun the call, or if the call failed there, this process makes
        the call.
        """
        if future.cancel():
            return call()
        with suppress(Exception):
            return future.result()
        return call()

    return result


def _limit_in_flight(executor: Executor | None) -> int:
    """Return how many submitted jobs of an executor may be unfinished at one time."""
    if executor is None:
        return 1
    workers: int = getattr(executor, "workers", 0)
    return _JOBS_PER_WORKER * workers or _JOBS_IN_FLIGHT


def _submit(call: Callable[[], R], executor: Executor | None) -> Future[R]:
    """Return a future for the result of a call that an executor makes.

    Without an executor, the call is made at once in this process, and the future holds its result.
    An exception of the call is not raised here, but held by the future.
    """
    if executor is not None:
        return executor.submit(call)
    future: Future[R] = Future()
    try:
        future.set_result(call())
    except Exception as error:  # noqa: BLE001 - `done` raises the error again
        future.set_exception(error)
    return future


def _run_in_turn(function: Callable[[T], R], job: T) -> R:
    """Call ``function`` with the argument ``job`` in this thread, and return the result.

    The linear algebra library BLAS is limited to one thread, and no other thread runs a job at the
    same time.
    """
    with _TURN:
        return one_blas_thread(function)(job)


def _error_of(future: Future[R]) -> BaseException | None:
    """Return the error of a job from its finished or cancelled future; None if it succeeded."""
    if future.cancelled():
        return BrokenExecutor("cancelled")
    return future.exception()


def _is_death_of_worker(error: BaseException) -> bool:
    """Return whether a job's error means that the worker process of the job died.

    Dask's error KilledWorker is recognised by its name, because Dask need not be installed.
    """
    return isinstance(error, WorkerDiedError) or type(error).__name__ == "KilledWorker"
