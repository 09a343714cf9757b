"""Executor of worker processes on this computer, each of which has a separate communication pipe.

If a worker dies, even while it sends a result, no other job fails, and the executor continues. The
pools of the standard library and of loky (3.7, which joblib uses) have one pipe for the results of
all workers, and therefore three faults. If a worker dies, the whole pool breaks, and all running
jobs fail. If a worker is killed while it sends a result, the pool waits for ever. If the process
that started the workers is killed, the workers keep running.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from typing import Any, NamedTuple

from ldbb_bayes.errors import InputError
from ldbb_bayes.parallel.blas_threads import ONE_THREAD

__all__ = [
    "WorkerDiedError",
    "ignore_interruption",
    "process_executor",
    "refuse_to_nest",
    "usable_cores",
]

# Error message if worker processes end at once because the user's script lacks the line ``if
# __name__ == "__main__":``. Every worker imports the script. Without this line, the import would
# run the whole script again.
_UNGUARDED_SCRIPT = (
    "worker processes must be able to start, got some that ended at once. A script must do its work"
    ' under `if __name__ == "__main__":`, because every worker imports it.'
)


class WorkerDiedError(RuntimeError):
    """Error of a job whose worker process died; it does not affect the jobs of other processes."""


@contextmanager
def process_executor(workers: int = 0) -> Iterator[Executor]:
    """Yield an executor that runs jobs in worker processes on this computer.

    Each process has one thread of BLAS, the linear algebra library behind NumPy. When the ``with``
    block ends, the jobs that were already submitted are finished. If the block is interrupted or
    raises an error, the processes are killed instead.

    Parameters
    ----------
    workers : number of processes; 0 means one per processor core.

    Raises
    ------
    InputError
        If a worker process cannot start. The future of the job raises this error when the result is
        requested.
    """
    refuse_to_nest()
    pool = _ProcessPool(workers or usable_cores())
    try:
        yield pool
        pool.shutdown()
    finally:
        pool.kill()


def usable_cores() -> int:
    """Return the number of processor cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def refuse_to_nest() -> None:
    """End this process if it is a worker that is still importing the user's script.

    A script that starts workers outside ``if __name__ == "__main__":`` would start workers again
    whenever a worker imports it. The process that started this worker reports the fault.
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        sys.exit(1)


def ignore_interruption() -> None:
    """Make this worker process of a parallel computation ignore Ctrl-C.

    A terminal sends Ctrl-C to all processes of a program. The process that started the worker
    handles Ctrl-C.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)


class _Answer(NamedTuple):
    """Outcome of a job that a worker process ran: its result, or the exception that it raised."""

    succeeded: bool  # whether a job ended in its worker process without an exception
    # result of the job that a worker process ran, or the exception that the job raised
    content: Any


class _ProcessPool(Executor):
    """Executor of worker processes, with one thread that passes jobs to each worker process."""

    def __init__(self, workers: int) -> None:
        """Create an executor with ``workers`` worker processes on this computer.

        Each thread of the executor starts its worker process when the thread gets its first job.
        """
        self.workers = workers
        self._threads = ThreadPoolExecutor(workers)
        self._local = threading.local()
        self._processes: list[multiprocessing.process.BaseProcess] = []
        self._killed = False

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Submit the call ``fn(*args, **kwargs)`` to one of the worker processes.

        Return a future (of ``concurrent.futures``) that will hold the result of the call.
        """
        return self._threads.submit(self._call_in_process, partial(fn, *args, **kwargs))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Accept no more jobs for the worker processes.

        If ``wait`` is true, return only when the submitted jobs have ended. If ``cancel_futures``
        is true, cancel the jobs that have not begun.
        """
        self._threads.shutdown(wait, cancel_futures=cancel_futures)

    def kill(self) -> None:
        """Kill the worker processes at once, even if they are working on jobs."""
        self._killed = True
        for process in self._processes:
            if process.pid is not None:
                process.kill()
        self.shutdown(cancel_futures=True)
        for process in self._processes:
            process.join()

    def _call_in_process(self, call: Callable[[], Any]) -> Any:
        """Make a call in the worker process that belongs to this thread; return its result.

        Raise the error of the call, or a `WorkerDiedError` if the process ends. The process is
        started at the first call from this thread.
        """
        connection = getattr(self._local, "connection", None)
        if connection is None:
            connection = self._start_process()
            self._local.connection = connection
        try:
            connection.send(call)
            answer = connection.recv()
        except (EOFError, OSError):
            self._local.connection = None
            raise WorkerDiedError("the worker process ended") from None
        if answer.succeeded:
            return answer.content
        raise answer.content

    def _start_process(self) -> Connection:
        """Start a worker process, wait until it is ready, and return the connection to it.

        Raise an `InputError` if the process does not start.
        """
        context = multiprocessing.get_context("spawn")
        connection, worker_connection = context.Pipe()
        process = context.Process(target=_serve, args=(worker_connection,), daemon=True)
        try:
            process.start()
        except OSError as error:
            raise InputError(
                f"a worker process must start, got {error}. Use fewer workers."
            ) from None
        self._processes.append(process)
        if self._killed:
            process.kill()
        worker_connection.close()
        try:
            connection.recv()
        except (EOFError, OSError):
            raise InputError(_UNGUARDED_SCRIPT) from None
        return connection


def _serve(connection: Connection) -> None:
    """Run jobs in a worker process until its pipe is closed.

    ``connection`` is the worker's end of the pipe to the process that started the worker. The pipe
    also closes if that process dies.
    """
    ignore_interruption()
    os.environ.update(ONE_THREAD)
    try:
        connection.send("ready")
        while True:
            answer = _run_next_job(connection)
            if answer is None:
                return
            _send(connection, answer)
    except OSError:
        return


def _run_next_job(connection: Connection) -> _Answer | None:
    """Run the next job of a worker process, and return the job's result or exception.

    Jobs come through a pipe, and ``connection`` is the worker's end of this pipe. Return None if
    the pipe is closed.
    """
    try:
        call = connection.recv()
        return _Answer(True, call())
    except EOFError:
        return None
    except Exception as error:  # noqa: BLE001 - the process that started the worker raises it again
        error.add_note("".join(traceback.format_exception(error)))
        return _Answer(False, error)


def _send(connection: Connection, answer: _Answer) -> None:
    """Send the outcome of a job, which is its result or exception, through a pipe.

    If the outcome cannot be pickled, a `TypeError` is sent instead.
    """
    try:
        message = ForkingPickler.dumps(answer)
    except Exception as error:  # noqa: BLE001 - a class that cannot be pickled may raise any error
        message = ForkingPickler.dumps(_Answer(False, _not_picklable(answer, error)))
    connection.send_bytes(message)


def _not_picklable(answer: _Answer, error: Exception) -> TypeError:
    """Return an exception to send in place of a job's outcome that cannot be pickled.

    ``answer`` holds the outcome: the result of the job, or the exception that the job raised. The
    notes of such an exception state where it was raised; they are copied to the returned exception.
    ``error`` is the exception that pickling raised.
    """
    reason = TypeError(
        f"{type(answer.content).__name__} must be picklable, got: {error}. Return arrays, numbers"
        " and texts."
    )
    if not answer.succeeded:
        for note in answer.content.__notes__:
            reason.add_note(note)
    return reason
