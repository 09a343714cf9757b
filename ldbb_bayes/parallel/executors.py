"""Executors, which run jobs in other processes, as the options of a command choose them."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.parallel.dask_workers import dask_executor
from ldbb_bayes.parallel.process_pool import process_executor, usable_cores

__all__ = ["EXECUTORS", "executor_named", "second_process"]

# Possible values of the command-line option --executor.
EXECUTORS = ("process", "dask")


@contextmanager
def second_process() -> Iterator[Executor | None]:
    """Yield an executor with one process in addition to this one.

    Yield None if the computer has one processor core only.
    """
    if usable_cores() == 1:
        yield None
    else:
        with process_executor(1) as executor:
            yield executor


@contextmanager
def executor_named(
    kind: str, workers: int = 0, scheduler: str | None = None
) -> Iterator[Executor | None]:
    """Yield the executor that runs jobs as the options of a command state.

    Parameters
    ----------
    kind : "process" or "dask".
    workers : number of worker processes; 0: one per processor core.
    scheduler : address of a Dask scheduler, which distributes jobs to workers.

    Returns
    -------
    The executor; None if one process would do all jobs, so that they run in this process.

    Raises
    ------
    InputError
        If an option is unknown, out of range, or cannot be combined with another.
    """
    check_known("--executor", [kind], EXECUTORS)
    if workers < 0:
        raise InputError(f"--workers must be 0 or more, got {workers}. 0 is one per core.")
    if scheduler is not None and kind != "dask":
        raise InputError(
            f"--scheduler must go with --executor dask, got --executor {kind}. Add it, or leave the"
            " address out."
        )
    if scheduler is not None and workers:
        raise InputError(
            f"--workers must not go with --scheduler, got {workers}. A cluster has the workers it"
            " was started with."
        )
    if kind == "dask":
        with dask_executor(scheduler, workers) as executor:
            yield executor
    elif (workers or usable_cores()) == 1:
        yield None
    else:
        with process_executor(workers) as executor:
            yield executor
