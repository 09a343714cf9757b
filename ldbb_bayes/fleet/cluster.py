"""A Dask cluster as an executor: one started here for the purpose, or one that is there already."""

from __future__ import annotations

import asyncio
import logging
import os
import platform
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from functools import cache
from typing import Any

import ldbb_bayes
from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.processes import ONE_THREAD, UNGUARDED, environment, leave_interrupts, refuse_to_nest, usable_cores

__all__ = ["dask_executor"]

ANSWER_S = 10.0
# Dask has workers give freed memory back, to be fetched again page by page: stacks of small matrices take more than twice as long
# (`ldbb_bayes.model.memory`). And a worker's profile of itself grows with the jobs it has run, and is never looked at; what it
# logs of connections that close as it ends is no matter of the user's.
_SETTINGS: dict[str, Any] = {
    "distributed.worker.profile.enabled": False,
    "distributed.worker.preload": [__name__],
    "distributed.nanny.pre-spawn-environ": {
        "MALLOC_TRIM_THRESHOLD_": 1 << 26,
        "MALLOC_MMAP_THRESHOLD_": 1 << 25,
        "DASK_LOGGING__DISTRIBUTED": "critical",
        **ONE_THREAD,
    },
}


@contextmanager
def dask_executor(scheduler: str | None = None, workers: int = 0) -> Iterator[Executor]:
    """Workers of Dask, one process and one BLAS thread each.

    A job whose worker was killed is run again on another one by Dask itself.

    Parameters
    ----------
    scheduler : str, optional
        Address, for example tcp://10.0.0.1:8786. Default: a cluster on this machine that ends with the context.
    workers : int
        Of the cluster on this machine; 0: one per core.

    Raises
    ------
    InputError
        Without Dask, for an address that is none or does not answer in 10 s, or workers with other versions or more than one
        thread.
    """
    refuse_to_nest()
    try:
        import cloudpickle  # noqa: F401
        import dask
        import distributed
    except ImportError as error:
        raise InputError(
            f"--executor dask must find the library {error.name}, got none. Install it with pip install 'ldbb-bayes[fleet]'."
        ) from None
    with ExitStack() as stack:
        stack.enter_context(_quiet("distributed"))
        if scheduler is None:
            stack.enter_context(environment(ONE_THREAD))
            stack.enter_context(dask.config.set(_SETTINGS))
            cluster = stack.enter_context(_local(distributed, workers or usable_cores()))
            client = stack.enter_context(distributed.Client(cluster, set_as_default=False))
        else:
            client = stack.enter_context(_connected(distributed, scheduler))
            _check_workers(client, scheduler)
        executor = _Dask(client, {} if scheduler is None else _told())
        try:
            with _lacking_is_said():
                yield executor
        finally:
            executor.shutdown(wait=False)


@contextmanager
def _local(distributed: Any, workers: int) -> Iterator[Any]:
    try:
        cluster = distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            # Any free port: without a dashboard it would still ask for 8787, and warn where another cluster has it.
            scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
            memory_limit=0,
            silence_logs=logging.CRITICAL,
        )
    except RuntimeError:
        raise InputError(UNGUARDED) from None
    with cluster:
        yield cluster


@contextmanager
def _connected(distributed: Any, scheduler: str) -> Iterator[Any]:
    try:
        # A client that gets no answer cannot be closed either, so that one is made only where there is one.
        with ThreadPoolExecutor(1) as apart:
            kind = apart.submit(asyncio.run, _kind(distributed, scheduler)).result()
        if kind != "Scheduler":
            raise ValueError(f"a {kind.lower()} answers there")
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"--scheduler must be the address of a Dask scheduler that is at work, got {scheduler!r} "
            f"({str(error) or f'no answer in {ANSWER_S:g} s'}). "
            "Copy it from what dask scheduler says when it starts, for example tcp://10.0.0.1:8786."
        ) from None
    with distributed.Client(scheduler, timeout=ANSWER_S, set_as_default=False) as client:
        yield client


async def _kind(distributed: Any, address: str) -> str:
    """What answers: Scheduler, Worker or Nanny."""

    async def ask() -> str:
        async with distributed.core.rpc(address) as there:
            return str((await there.identity())["type"])

    return await asyncio.wait_for(ask(), ANSWER_S)


def _check_workers(client: Any, scheduler: str) -> None:
    """Those there must give the numbers that are given here: others fail at every job, or mix versions in one table."""
    found = client.run(_told, on_error="return")
    if not found:
        warnings.warn(f"the scheduler {scheduler} has no workers yet; jobs wait for the first one.", stacklevel=7)
    for address, told in found.items():
        if not isinstance(told, dict):
            raise _lacking(f"{' '.join(str(told).split())} at {address}")
        _check_versions(_told(), told, address)
    for address, threads in client.nthreads().items():
        if threads > 1:
            raise InputError(
                f"workers must have one thread each, got {threads} at {address}. Start workers with --nthreads 1, as many as "
                "there are cores (--nworkers)."
            )


@cache
def _told() -> dict[str, str]:
    """Versions that numbers come from; here, or in the worker that is asked."""
    from ldbb_bayes.inference.sample import versions  # takes seconds: not for every worker that starts

    return versions() | {"python": platform.python_version()}


def _check_versions(ours: dict[str, str], theirs: dict[str, str], where: str) -> None:
    for name, version in ours.items():
        if theirs.get(name) != version:
            raise InputError(
                f"workers must have {name} {version} as it is here, got {theirs.get(name, 'none')} at {where}. Install it there, "
                "and start the worker again."
            )


def _lacking(got: str) -> InputError:
    return InputError(
        f"workers must have ldbb_bayes {ldbb_bayes.__version__}, got {got}. Install it there, and start the worker again."
    )


@contextmanager
def _lacking_is_said() -> Iterator[None]:
    """Of a worker that came when jobs were at work already, and cannot take one."""
    try:
        yield
    except (ImportError, RuntimeError) as error:
        seen: BaseException | None = error
        while seen is not None and not (isinstance(seen, ImportError) and (seen.name or "").partition(".")[0] == "ldbb_bayes"):
            seen = seen.__cause__ or seen.__context__
        if seen is None:
            raise
        raise _lacking(f"a worker that says {seen}") from None


class _Dask(Executor):
    """Jobs go as sealed bytes: Dask looks into arguments for what might be tasks and data of its own."""

    def __init__(self, client: Any, versions_here: dict[str, str]) -> None:
        self._versions = versions_here
        self._inner = client.get_executor(pure=False)
        self._max_workers = sum(client.nthreads().values())

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        import cloudpickle

        return self._inner.submit(_carried, cloudpickle.dumps((fn, args, kwargs)), self._versions)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self._inner.shutdown(wait=wait and not cancel_futures)


def _carried(job: bytes, versions_there: dict[str, str]) -> Any:
    from ldbb_bayes.fleet.cluster import unsealed

    return unsealed(job, versions_there)


# Sent as code, not by name: a worker without this package would not survive the name, and the next one would be sent the job.
_carried.__module__ = "__main__"


def unsealed(job: bytes, versions_there: dict[str, str]) -> Any:
    """What the job gives, on a worker; of a cluster started here no versions are asked for, for they are the same."""
    import pickle

    if versions_there:
        _check_versions(versions_there, _told(), f"{platform.node()} (process {os.getpid()})")
    fn, args, kwargs = pickle.loads(job)
    return fn(*args, **kwargs)


def dask_setup(worker: Any) -> None:
    """What Dask calls in every worker of a cluster of this machine."""
    leave_interrupts()


@contextmanager
def _quiet(name: str) -> Iterator[None]:
    """What it has to say comes as exceptions. Its loggers have levels of their own."""
    loggers = [logging.getLogger(each) for each in list(logging.root.manager.loggerDict) if each.split(".")[0] == name]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)
