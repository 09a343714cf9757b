"""Executors that run jobs in other processes, selected by the options of a command.

Executors have the interface of ``concurrent.futures`` of the standard library.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.parallel.dask_workers import dask_executor
from ldbb_bayes.parallel.process_pool import process_executor, usable_cores

__all__ = ["EXECUTORS", "executor_named", "second_process"]

# Possible values of the command-line option --executor. With "process", jobs run in worker
# processes on this computer. With "dask", the library Dask runs them; it can distribute jobs over
# several computers.
EXECUTORS = ("process", "dask")


@contextmanager
def second_process() -> Iterator[Executor | None]:
    """Yield an executor that runs jobs in a second process, in addition to this process.

    Yield None if this process may use only one processor core.
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
    """Yield the executor that the options of a command select.

    Parameters
    ----------
    kind : "process" for worker processes on this computer, or "dask" for the library Dask.
    workers : number of worker processes; 0 means one per processor core.
    scheduler : address of a Dask scheduler, which distributes jobs to workers on other computers.
        If it is None, the workers are on this computer.

    Returns
    -------
    The executor. If ``kind`` is "process" and there would be only one worker process, None is
    returned instead; jobs then run in this process.

    Raises
    ------
    InputError
        If an option has an unknown or impossible value, if two options contradict each other, or if
        the executor cannot start.
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
