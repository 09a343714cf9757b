"""Functions that run independent jobs in one process, in several processes, or on a Dask cluster.

Dask is a library that distributes computations over several computers.
"""

from ldbb_bayes.parallel.blas_threads import ONE_THREAD, one_blas_thread
from ldbb_bayes.parallel.dask_workers import dask_executor
from ldbb_bayes.parallel.executors import EXECUTORS, executor_named, second_process
from ldbb_bayes.parallel.jobs import Lost, done, start_early
from ldbb_bayes.parallel.process_pool import WorkerDiedError, process_executor
from ldbb_bayes.parallel.versions import versions

__all__ = [
    "EXECUTORS",
    "ONE_THREAD",
    "Lost",
    "WorkerDiedError",
    "dask_executor",
    "done",
    "executor_named",
    "one_blas_thread",
    "process_executor",
    "second_process",
    "start_early",
    "versions",
]
