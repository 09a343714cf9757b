"""What jobs run on, by name: this process, the cores of this machine, or a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.fleet.cluster import dask_executor
from ldbb_bayes.fleet.processes import process_executor, usable_cores

__all__ = ["EXECUTORS", "check_executor", "dask_executor", "executor_named", "process_executor"]

EXECUTORS = ("process", "dask")


def check_executor(kind: str, workers: int = 0, scheduler: str | None = None) -> None:
    """Refuse options that `executor_named` would refuse, before anything is started.

    Raises
    ------
    InputError
        For an unknown kind, or options that exclude one another.
    """
    check_known("--executor", [kind], EXECUTORS)
    if workers < 0:
        raise InputError(f"--workers must be 0 or more, got {workers}. 0 is one per core.")
    if scheduler is not None and kind != "dask":
        raise InputError(f"--scheduler must go with --executor dask, got --executor {kind}. Add it, or leave the address out.")
    if scheduler is not None and workers:
        raise InputError(f"--workers must not go with --scheduler, got {workers}. A cluster has the workers it was started with.")


@contextmanager
def executor_named(kind: str, workers: int = 0, scheduler: str | None = None) -> Iterator[Executor | None]:
    """What the options ask for; None where there is one process only, and jobs are run here.

    Parameters
    ----------
    kind : {"process", "dask"}
    workers : int
        Processes; 0: one per core.
    scheduler : str, optional
        Address of a Dask scheduler.

    Raises
    ------
    InputError
        For an unknown kind, options that exclude one another, or a scheduler that does not answer.
    """
    check_executor(kind, workers, scheduler)
    if kind == "dask":
        with dask_executor(scheduler, workers) as executor:
            yield executor
    elif (workers or usable_cores()) == 1:
        yield None
    else:
        with process_executor(workers) as executor:
            yield executor
