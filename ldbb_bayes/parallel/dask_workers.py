"""Workers of Dask, on this machine or on a cluster.

`distributed.Client.get_executor()` cannot be used: a result that is lost between its arrival and
its use reaches the caller as a ValueError (raised while the outcome is unpacked), which looks like
an error of the job, so that such a job could not be run again.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from typing import Any

from ldbb_bayes.errors import InputError
from ldbb_bayes.parallel.blas_threads import ONE_THREAD
from ldbb_bayes.parallel.process_pool import (
    UNGUARDED_SCRIPT,
    ignore_interruption,
    refuse_to_nest,
    usable_cores,
)
from ldbb_bayes.parallel.versions import versions

__all__ = ["ANSWER_S", "dask_executor", "dask_setup"]

# Seconds until a scheduler that does not answer counts as missing.
ANSWER_S = 10.0
# Threads that wait for results: jobs in flight at once.
_WAITING_THREADS = 64
# What these log is raised as an exception as well.
_LOGGERS = (
    "distributed",
    "distributed.client",
    "distributed.nanny",
    "distributed.scheduler",
    "distributed.core",
)
_WORKER_ENVIRONMENT: dict[str, Any] = {
    # Dask has workers give freed memory back, to be fetched again page by page: stacks of small
    # matrices take more than twice as long. These thresholds keep the memory.
    "MALLOC_TRIM_THRESHOLD_": 1 << 26,
    "MALLOC_MMAP_THRESHOLD_": 1 << 25,
    # What a worker logs of connections that close is of no use to the user.
    "DASK_LOGGING__DISTRIBUTED": "critical",
    **ONE_THREAD,
}
_DASK_OPTIONS: dict[str, Any] = {
    # A job whose worker was killed is not begun again at once, but by `done`, last.
    "distributed.scheduler.allowed-failures": 0,
    "distributed.comm.timeouts.connect": ANSWER_S,
    # A worker's profile of itself grows with the jobs that it has run.
    "distributed.worker.profile.enabled": False,
    "distributed.worker.preload": [__name__],
    "distributed.nanny.pre-spawn-environ": _WORKER_ENVIRONMENT,
}
_CLUSTER_OPTIONS: dict[str, Any] = {
    "threads_per_worker": 1,
    "processes": True,
    "memory_limit": 0,
    "silence_logs": logging.CRITICAL,
    "dashboard_address": None,
    # Any free port: without a dashboard the scheduler would still ask for 8787, and warn where
    # another cluster has it.
    "scheduler_kwargs": {"dashboard_address": "127.0.0.1:0"},
}


def dask_setup(_: Any) -> None:
    """Prepare a worker of this machine; Dask calls this when it starts."""
    ignore_interruption()


@contextmanager
def dask_executor(scheduler: str | None = None, workers: int = 0) -> Iterator[Executor]:
    """Yield an executor of Dask's workers, one process and one BLAS thread each.

    Parameters
    ----------
    scheduler : address of a scheduler (tcp://10.0.0.1:8786); None: a cluster on this machine, which
        ends with the context.
    workers : number of workers of a cluster on this machine; 0: one per core.

    Raises
    ------
    InputError
        If Dask is not installed, no scheduler answers, or its workers do not fit.
    """
    refuse_to_nest()
    try:
        import dask  # an optional dependency
        import distributed
    except ImportError as error:
        raise InputError(
            f"--executor dask must find the library {error.name}, got none. Install it with pip"
            " install 'ldbb-bayes[fleet]'."
        ) from None
    for name in _LOGGERS:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with ExitStack() as stack:
        address: Any = scheduler
        if scheduler is None:
            stack.enter_context(dask.config.set(_DASK_OPTIONS))
            address = stack.enter_context(_local_cluster(workers))
        try:
            client = stack.enter_context(
                distributed.Client(address, timeout=ANSWER_S, set_as_default=False)
            )
        except Exception as error:  # noqa: BLE001 - what is at the address may answer anything
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
    """Threads, each of which waits for one job of Dask."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._threads = ThreadPoolExecutor(_WAITING_THREADS)
        self.workers = _WAITING_THREADS

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Return the future of a call in one of the workers."""
        return self._threads.submit(self._call_in_worker, partial(fn, *args, **kwargs))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more jobs; by default wait for those submitted."""
        self._threads.shutdown(wait, cancel_futures=cancel_futures)

    def _call_in_worker(self, call: Callable[[], Any]) -> Any:
        dask_future = self._client.submit(call, pure=False)
        try:
            return dask_future.result()
        except BaseException as error:
            if dask_future.status == "error":
                raise  # the job's own
            raise BrokenExecutor(str(error)) from error


@contextmanager
def _local_cluster(workers: int) -> Iterator[Any]:
    """Yield a cluster on this machine.

    One that closes slowly, because a worker died, is left to do so: all results are there.
    """
    from distributed import LocalCluster  # an optional dependency

    try:
        cluster = LocalCluster(n_workers=workers or usable_cores(), **_CLUSTER_OPTIONS)
    except RuntimeError:
        raise InputError(UNGUARDED_SCRIPT) from None
    try:
        yield cluster
    finally:
        with suppress(TimeoutError):
            cluster.close(timeout=ANSWER_S)


def _check_workers(client: Any, scheduler: str) -> None:
    """Refuse workers that would fail at every job, or give other numbers than this process."""
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
    """Compare the versions of a worker, or the exception that it raised, with those here."""
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
