"""The cores of this machine as an executor whose processes are replaced when they die."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any

from threadpoolctl import threadpool_limits

from ldbb_bayes.errors import InputError

_LOOK_S, _LOOKS = 1.0, 2
__all__ = ["ONE_THREAD", "UNGUARDED", "environment", "leave_interrupts", "process_executor", "refuse_to_nest", "usable_cores"]

ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"), "1")
UNGUARDED = (
    "worker processes must be able to start, got some that ended at once. A script must do its work under "
    '`if __name__ == "__main__":`, because every worker imports it.'
)


@contextmanager
def process_executor(workers: int = 0) -> Iterator[Executor]:
    """Processes of this machine, one BLAS thread each; those at work are stopped by an interruption or an error.

    Parameters
    ----------
    workers : int
        0: one per core.
    """
    refuse_to_nest()
    with environment(ONE_THREAD):
        pool = _Processes(workers or usable_cores())
        try:
            yield pool
        except BaseException:
            pool.stop()
            raise
        pool.shutdown()


def usable_cores() -> int:
    """Those that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _Processes(Executor):
    """A pool of processes that can be started afresh when some of them died."""

    def __init__(self, workers: int) -> None:
        self._max_workers = workers
        self._failed_starts = 0
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pool = ProcessPoolExecutor(self._max_workers, mp_context=context, initializer=_settle)
        self._first = self._pool.submit(_nothing)
        # It has pool's ends of the pipes as long as it is at work, and waits for nothing but processes and results.
        self._manager: Any = self._pool._executor_manager_thread
        self._ended = threading.Event()
        self._watcher = threading.Thread(target=_watch, args=(self._pool, self._manager, self._ended), daemon=True)
        self._watcher.start()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        return self._pool.submit(fn, *args, **kwargs)

    def fresh(self) -> None:
        """Replace the processes if some died.

        Raises
        ------
        InputError
            When twice in a row none of them ever answered.
        """
        try:
            self._pool.submit(_nothing)
        except BrokenExecutor:
            self._failed_starts = self._failed_starts + 1 if self._first.exception() is not None else 0
            if self._failed_starts > 1:
                raise InputError(UNGUARDED) from None
            self._end()
            self._start()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self._ended.set()  # from here on they end in order, one after the other
        self._end(wait=wait, cancel=cancel_futures)

    def stop(self) -> None:
        """Now, whatever they are at."""
        processes = list((self._pool._processes or {}).values())
        for process in processes:
            process.terminate()
        self._end(cancel=True)

    def _end(self, *, wait: bool = True, cancel: bool = False) -> None:
        """The pool's own waiting would close the pipe that the watcher may be closing."""
        self._pool.shutdown(wait=False, cancel_futures=cancel)
        if wait:
            self._manager.join()
            self._ended.set()
            self._watcher.join()


def _watch(pool: ProcessPoolExecutor, manager: threading.Thread, ended: threading.Event) -> None:
    """Break a pool that does not see for itself that one of its processes died.

    It waits for the rest of a result for ever, when a worker is killed in the middle of sending it: this process holds the
    sending end of that pipe too, so that it never closes. A pool that sees the death ends at once.
    """
    writer: Any = pool._result_queue._writer  # type: ignore[attr-defined]
    processes: Any = pool._processes
    del pool
    dead = 0
    while dead < _LOOKS:
        if ended.wait(_LOOK_S) or not manager.is_alive():
            return
        dead = dead + 1 if any(own.exitcode is not None for own in list(processes.values())) else 0
    for own in list(processes.values()):
        own.kill()
    writer.close()


def _nothing() -> None:
    pass


def _settle() -> None:
    threadpool_limits(1)
    leave_interrupts()
    threading.Thread(target=_end_with_parent, daemon=True).start()


def leave_interrupts() -> None:
    """Ctrl-C reaches every process of the terminal; the first one answers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _end_with_parent() -> None:
    """A parent that is killed cannot say so; without it a worker would wait for jobs for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def refuse_to_nest() -> None:
    """End a worker that is still importing an unguarded script: its parent will say what is wrong, once.

    Raises
    ------
    SystemExit
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        sys.exit(1)


@contextmanager
def environment(values: Mapping[str, str]) -> Iterator[None]:
    """Variables for the processes started meanwhile; those before are put back."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
