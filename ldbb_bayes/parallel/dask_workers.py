"""Executor that runs jobs in worker processes of Dask, on this computer or on a cluster.

Dask is a library that distributes computations over several computers. Dask's own executor,
`distributed.Client.get_executor()`, is not used. If the result of a finished job is lost, Dask's
executor raises a ValueError. This package would take the ValueError for an error of the job itself,
and would not run the job again.
"""

from __future__ import annotations

import logging
import re
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from typing import Any

from ldbb_bayes.errors import InputError
from ldbb_bayes.parallel.blas_threads import ONE_THREAD
from ldbb_bayes.parallel.process_pool import (
    ignore_interruption,
    refuse_to_nest,
    usable_cores,
)
from ldbb_bayes.parallel.versions import versions

__all__ = ["ANSWER_S", "dask_executor", "dask_setup"]

# Longest time that this program waits for the answer of a Dask scheduler [s].
ANSWER_S = 10.0
# Port at the end of the address of a Dask scheduler, such as tcp://10.0.0.1:8786. A scheduler in
# this process has no port.
_ADDRESS = re.compile(r":\d+$|^inproc://")
# Number of threads of this process that wait for results of Dask workers. Each thread waits for one
# job, so that Dask has at most this number of jobs at a time.
_WAITING_THREADS = 64
# Names of Dask's loggers that are silenced, because this package raises errors for the faults that
# they report.
_LOGGERS = (
    "distributed",
    "distributed.client",
    "distributed.nanny",
    "distributed.scheduler",
    "distributed.core",
)
# Environment variables with which the worker processes of a local Dask cluster start.
_WORKER_ENVIRONMENT: dict[str, Any] = {
    # These thresholds of the C library [bytes] let Dask workers keep freed memory. With Dask's
    # defaults, workers return freed memory to the operating system and then request it again;
    # computations with many small matrices then take more than twice as long.
    "MALLOC_TRIM_THRESHOLD_": 1 << 26,
    "MALLOC_MMAP_THRESHOLD_": 1 << 25,
    # With this logging level, Dask does not report closed connections; such reports do not help the
    # user.
    "DASK_LOGGING__DISTRIBUTED": "critical",
    **ONE_THREAD,
}
# Configuration of the library Dask for a cluster of worker processes on this computer.
_DASK_OPTIONS: dict[str, Any] = {
    # Dask must not repeat a job whose worker process was killed. The function `done` of this
    # package repeats the job after all other jobs.
    "distributed.scheduler.allowed-failures": 0,
    "distributed.comm.timeouts.connect": ANSWER_S,
    # Dask's profiler is switched off in the worker processes, because its record of run times would
    # grow with every job.
    "distributed.worker.profile.enabled": False,
    "distributed.worker.preload": [__name__],
    "distributed.nanny.pre-spawn-environ": _WORKER_ENVIRONMENT,
}
# Arguments with which a cluster of the library Dask is started on this computer.
_CLUSTER_OPTIONS: dict[str, Any] = {
    "threads_per_worker": 1,
    "processes": True,
    "memory_limit": 0,
    "silence_logs": logging.CRITICAL,
    "dashboard_address": None,
    # Port of Dask's scheduler for its dashboard; 0 means any free port. Without this setting the
    # scheduler would ask for port 8787, even though it has no dashboard, and warn if another
    # cluster uses the port.
    "scheduler_kwargs": {"dashboard_address": "127.0.0.1:0"},
}


def dask_setup(_: Any) -> None:
    """Make a worker process ignore Ctrl-C; Dask calls this function when the worker starts.

    The process that started the worker handles Ctrl-C.
    """
    ignore_interruption()


@contextmanager
def dask_executor(scheduler: str | None = None, workers: int = 0) -> Iterator[Executor]:
    """Yield an executor that runs jobs in Dask workers, each a process with one BLAS thread.

    Dask is a library that distributes computations over several computers; BLAS is the linear
    algebra library behind NumPy.

    Parameters
    ----------
    scheduler : address of a Dask scheduler that is running, such as tcp://10.0.0.1:8786. If it is
        None, a cluster is started on this computer, and ends with the ``with`` block.
    workers : number of workers of a cluster on this computer; 0 means one per processor core. This
        argument has no effect if ``scheduler`` is given.

    Raises
    ------
    InputError
        If Dask is not installed, if no scheduler answers, or if worker processes cannot start. The
        error is also raised if a worker has several threads, or library versions that differ from
        those of this process.
    """
    refuse_to_nest()
    try:
        # Dask is imported here, and not at the top of the file, because it need not be installed.
        import dask
        import distributed
    except ImportError as error:
        raise InputError(
            f"--executor dask must find the library {error.name}, got none. Install it with pip"
            " install 'ldbb-bayes[fleet]'."
        ) from None
    for name in _LOGGERS:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    if scheduler is not None and not _ADDRESS.search(scheduler):
        raise InputError(
            "--scheduler must be the address of a Dask scheduler that is at work, with its port,"
            f" got {scheduler!r}. Copy it from what dask scheduler says when it starts."
        )
    with ExitStack() as stack:
        address: Any = scheduler
        if scheduler is None:
            stack.enter_context(dask.config.set(_DASK_OPTIONS))
            address = stack.enter_context(_local_cluster(workers))
        try:
            client = stack.enter_context(
                distributed.Client(address, timeout=ANSWER_S, set_as_default=False)
            )
        except Exception as error:  # noqa: BLE001 - a server other than Dask may cause any error
            raise InputError(
                "--scheduler must be the address of a Dask scheduler that is at work, got"
                f" {scheduler!r} ({error}). Copy it from what dask scheduler says when it starts."
            ) from None
        if scheduler is not None:
            _check_workers(client, scheduler)
        executor = _DaskExecutor(client)
        stack.callback(executor.shutdown, wait=False, cancel_futures=True)
        yield executor


class _DaskExecutor(Executor):
    """Executor with several threads; each thread sends one job at a time to the Dask workers."""

    def __init__(self, client: Any) -> None:
        """Create an executor for Dask workers; ``client`` is the connection to Dask's scheduler."""
        self._client = client
        self._threads = ThreadPoolExecutor(_WAITING_THREADS)
        self.workers = _WAITING_THREADS

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Submit the call ``fn(*args, **kwargs)`` to one of the Dask workers.

        Return a future (of ``concurrent.futures``) that will hold the result of the call.
        """
        return self._threads.submit(self._call_in_worker, partial(fn, *args, **kwargs))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Accept no more jobs for the Dask workers.

        If ``wait`` is true, return only when the submitted jobs have ended. If ``cancel_futures``
        is true, cancel the jobs that have not begun.
        """
        self._threads.shutdown(wait, cancel_futures=cancel_futures)

    def _call_in_worker(self, call: Callable[[], Any]) -> Any:
        """Make a call in a Dask worker, and return its result or raise its error.

        If the worker died, raise Dask's error KilledWorker. If Dask cannot return the result for
        another reason, raise a BrokenExecutor.
        """
        dask_future = self._client.submit(call, pure=False)
        try:
            return dask_future.result()
        except BaseException as error:
            if dask_future.status == "error":
                # The error was raised by the function called in the Dask worker, or by Dask because
                # the worker died.
                raise
            raise BrokenExecutor(str(error)) from error


@contextmanager
def _local_cluster(workers: int) -> Iterator[Any]:
    """Yield a Dask cluster of worker processes on this computer; it ends with the ``with`` block.

    ``workers`` is the number of processes; 0 means one per processor core. When the ``with`` block
    ends, no more results are needed. Closing the cluster may take long if a worker process has
    died; this function therefore waits for it at most ten seconds.
    """
    # Dask is imported here, and not at the top of the file, because it need not be installed.
    from distributed import LocalCluster

    try:
        cluster = LocalCluster(n_workers=workers or usable_cores(), **_CLUSTER_OPTIONS)
    except RuntimeError as error:
        cause = " ".join(str(error).split())
        raise InputError(
            f"worker processes must be able to start, got {cause!r}. Remove this cause. A script"
            ' must do its work under `if __name__ == "__main__":`, because every worker imports it.'
        ) from None
    try:
        yield cluster
    finally:
        with suppress(TimeoutError):
            cluster.close(timeout=ANSWER_S)


def _check_workers(client: Any, scheduler: str) -> None:
    """Raise an `InputError` if a Dask worker has several threads or other library versions.

    If its versions differ from those of this process, the worker could fail or give other results.
    If the scheduler has no workers yet, give a warning. ``client`` is Dask's connection to the
    scheduler, and ``scheduler`` is the scheduler's address, which messages name.
    """
    versions_by_worker = client.run(partial(versions, python=True), on_error="return")
    if not versions_by_worker:
        warnings.warn(
            f"the scheduler {scheduler} has no workers yet; jobs wait for the first one.",
            stacklevel=6,
        )
    for address, threads in client.nthreads().items():
        if threads != 1:
            raise InputError(
                f"workers must have one thread each, got {threads} at {address}. Start workers with"
                " --nthreads 1, as many as there are cores (--nworkers)."
            )
    for address, worker_versions in versions_by_worker.items():
        _check_versions(address, worker_versions)


def _check_versions(address: str, worker_versions: Any) -> None:
    """Raise an `InputError` if the library versions of a worker differ from those of this process.

    ``address`` is the address of the worker. ``worker_versions`` are its versions; the keys are the
    names of the libraries. An `InputError` is also raised if the worker returned an exception
    instead of versions.
    """
    if not isinstance(worker_versions, dict):
        worker_versions = {}
    for name, version_here in versions(python=True).items():
        version_there = worker_versions.get(name)
        if version_there != version_here:
            raise InputError(
                f"workers must have {name} {version_here} as it is here, got"
                f" {version_there or 'none'} at {address}. Install it there, and start the worker"
                " again."
            )
