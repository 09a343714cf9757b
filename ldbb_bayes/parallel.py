"""Independent jobs on this process, the cores of this machine or a Dask cluster: every result once,
whatever workers die."""

from __future__ import annotations

import functools
import logging
import multiprocessing
import os
import platform
import signal
import sys
import threading
import traceback
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from functools import cache, partial
from importlib import import_module
from importlib.metadata import version
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any, ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

from ldbb_bayes.errors import InputError, check_known, require

__all__ = [
    "EXECUTORS",
    "Lost",
    "ahead",
    "dask_executor",
    "done",
    "executor_named",
    "one_blas_thread",
    "process_executor",
    "second_process",
    "versions",
]

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")
EXECUTORS = ("process", "dask")
_PACKAGES = ("numpy", "scipy", "emcee")
ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"), "1")
ANSWER_S = 10.0
# A job may have jobs of its own.
_TURN = threading.RLock()
_PER_WORKER = 4
_UNCOUNTED = 64
_UNGUARDED = (
    "worker processes must be able to start, got some that ended at once. A script must do its work"
    ' under `if __name__ == "__main__":`, because every worker imports it.'
)


def one_blas_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Return the same function; while it runs BLAS has one thread: its matrices are small, and
    waiting threads cost far more."""

    @functools.wraps(function)
    def inner(*args: P.args, **kwargs: P.kwargs) -> R:
        with threadpool_limits(1, user_api="blas"):
            return function(*args, **kwargs)

    return inner


@dataclass(frozen=True)
class Lost:
    """What a job gives whose worker died twice."""

    reason: str = (
        "its worker died twice, the second time with no other job at work (killed, or out of"
        " memory?)"
    )


class WorkerDied(RuntimeError):
    """The process of one job ended; the others go on."""


def done(
    function: Callable[[T], R], jobs: Iterable[T], executor: Executor | None = None
) -> Iterator[tuple[int, R | Lost]]:
    """Run a function on every job, one BLAS thread each, and yield (index from 0, result) as they
    come.

    A job whose worker dies (killed, out of memory) is tried once more when all others are done,
    with no other job at work; then it is `Lost`. Threads of one process take turns: processes are
    faster.

    On other processes the function is imported, and jobs, read as far as needed, and results are
    pickled. Without an executor they run here, one after the other. The exception of the first job
    that raises is raised, with a note that says which; what is pending is cancelled, as it is when
    the iterator is closed. An executor that gave its jobs up is an `InputError`.
    """
    fresh = enumerate(jobs)
    again = deque[tuple[int, T]]()
    room = (
        1 if executor is None else _PER_WORKER * getattr(executor, "_max_workers", 0) or _UNCOUNTED
    )
    flying: dict[Future[R], tuple[int, T, bool]] = {}
    landed: SimpleQueue[Future[R]] = SimpleQueue()

    def submit(index: int, work: T, last: bool) -> None:
        future = _submitted(partial(_alone, function, work), executor)
        flying[future] = (index, work, last)
        future.add_done_callback(landed.put)

    try:
        while True:
            while len(flying) < room and (job := next(fresh, None)) is not None:
                submit(*job, last=False)
            if not flying and again:
                submit(*again.popleft(), last=True)
            elif not flying:
                return
            future = landed.get()
            index, work, last = flying.pop(future)
            error = BrokenExecutor("cancelled") if future.cancelled() else future.exception()
            if error is None:
                yield index, future.result()
            elif isinstance(error, WorkerDied) or type(error).__name__ == "KilledWorker":
                if last:
                    yield index, Lost()
                else:
                    again.append((index, work))
            else:
                error.add_note(f"In job {index}, counted from 0.")
                raise error
            del future  # a result is not kept while the consumer works on the next
    except BrokenExecutor as error:
        raise InputError(
            "the executor must last as long as its jobs, got one that gave them up (its workers"
            " died, or its scheduler ended). Finished work is kept. Run what is left on"
            " process_executor() of ldbb_bayes.parallel, which starts workers afresh."
        ) from error
    finally:
        for future in flying:
            future.cancel()


def ahead(call: Callable[[], R], executor: Executor | None) -> Callable[[], R]:
    """Begin a call on an executor, and return what gives its result: worked out here where there is
    none, or it failed there."""
    future = None if executor is None else executor.submit(call)

    def result() -> R:
        if future is not None:
            with suppress(Exception):
                return future.result()
        return call()

    return result


def _submitted(call: Callable[[], R], executor: Executor | None) -> Future[R]:
    if executor is not None:
        return executor.submit(call)
    future: Future[R] = Future()
    try:
        future.set_result(call())
    except Exception as error:  # of whatever kind: it is raised where results are handed out
        future.set_exception(error)
    return future


def _alone(function: Callable[[T], R], work: T) -> R:
    """The number of BLAS threads and the filters of warnings are the whole process's: its threads
    take turns."""
    with _TURN, threadpool_limits(1):
        return function(work)


@contextmanager
def process_executor(workers: int = 0) -> Iterator[Executor]:
    """Yield processes of this machine (0: one per core), one BLAS thread each; an interruption or
    an error stops them."""
    _refuse_to_nest()
    pool = _Processes(workers or _usable_cores())
    try:
        yield pool
        pool.shutdown()
    finally:
        pool.stop()


@contextmanager
def second_process() -> Iterator[Executor | None]:
    """Yield one process beside this one, as of `process_executor`; none where there is one core."""
    with nullcontext() if _usable_cores() == 1 else process_executor(1) as executor:
        yield executor


def _usable_cores() -> int:
    """Those that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _Processes(ThreadPoolExecutor):
    """Every thread has a process of its own behind a pipe of its own. So one that dies, even in the
    middle of sending, takes no other job with it and leaves nobody waiting: the pools of the
    standard library and of loky share one pipe for all results, and wait for ever for the rest of
    what a killed worker sent."""

    def __init__(self, workers: int) -> None:
        super().__init__(workers)
        self._thread = threading.local()
        self._every: list[multiprocessing.process.BaseProcess] = []
        self._stopped = False

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        return super().submit(self._there, partial(fn, *args, **kwargs))

    def _there(self, call: Callable[[], Any]) -> Any:
        pipe = getattr(self._thread, "pipe", None) or self._start()
        try:
            pipe.send(call)
            good, answer = pipe.recv()
        except (EOFError, OSError):
            self._thread.pipe = None
            raise WorkerDied("the worker process ended") from None
        if good:
            return answer
        raise answer

    def _start(self) -> Connection:
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe()
        process = context.Process(target=_serve, args=(there,), daemon=True)
        try:
            process.start()
        except OSError as error:
            raise InputError(
                f"a worker process must start, got {error}. Use fewer workers."
            ) from None
        self._every.append(process)
        if self._stopped:
            process.kill()
        there.close()
        try:
            here.recv()
        except (EOFError, OSError):
            raise InputError(_UNGUARDED) from None
        self._thread.pipe = here
        return here

    def stop(self) -> None:
        """End the processes now, whatever they are at."""
        self._stopped = True
        for process in self._every:
            if process.pid is not None:
                process.kill()
        self.shutdown(cancel_futures=True)
        for process in self._every:
            process.join()


def _serve(pipe: Connection) -> None:
    """Do jobs until the other end is closed: when the pool ends, or its process is killed."""
    dask_setup(None)
    os.environ.update(ONE_THREAD)
    try:
        pipe.send("ready")
    except OSError:
        return
    while True:
        try:
            answer = True, pipe.recv()()
        except EOFError:
            return
        except Exception as error:  # whatever it is, it is raised where the result is asked for
            error.add_note("".join(traceback.format_exception(error)))
            answer = False, error
        try:
            pipe.send(answer)
        except OSError:
            return
        except Exception as error:  # what does not pickle
            pipe.send(
                (
                    False,
                    TypeError(
                        f"{type(answer[1]).__name__} must be picklable, got: {error}. {answer[1]}"
                    ),
                )
            )


def _refuse_to_nest() -> None:
    """End a worker that is still importing an unguarded script: its parent will say what is wrong,
    once."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        sys.exit(1)


# Dask has workers give freed memory back, to be fetched again page by page: stacks of small
# matrices take more than twice as long. A worker's profile of itself grows with the jobs it has
# run; what it logs of connections that close is no matter of the user's. A worker that is killed
# while it starts is not replaced: what kills one is not begun again at once, but by `done`, last.
_DASK: dict[str, Any] = {
    "distributed.scheduler.allowed-failures": 0,
    "distributed.comm.timeouts.connect": ANSWER_S,
    "distributed.worker.profile.enabled": False,
    "distributed.worker.preload": [__name__],
    "distributed.nanny.pre-spawn-environ": {
        "MALLOC_TRIM_THRESHOLD_": 1 << 26,
        "MALLOC_MMAP_THRESHOLD_": 1 << 25,
        "DASK_LOGGING__DISTRIBUTED": "critical",
        **ONE_THREAD,
    },
}


def dask_setup(_: Any) -> None:
    """In every worker of this machine: Ctrl-C reaches all processes of the terminal; the first one
    answers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def dask_executor(scheduler: str | None = None, workers: int = 0) -> Iterator[Executor]:
    """Yield workers of Dask, one process and one BLAS thread each: of the scheduler at an address
    (tcp://10.0.0.1:8786), or of a cluster on this machine, by default one per core, that ends with
    the context."""
    _refuse_to_nest()
    try:
        import dask
        import distributed
    except ImportError as error:
        raise InputError(
            f"--executor dask must find the library {error.name}, got none. Install it with pip"
            " install 'ldbb-bayes[fleet]'."
        ) from None
    # What they have to say comes as exceptions.
    for name in (
        "distributed",
        "distributed.client",
        "distributed.nanny",
        "distributed.scheduler",
        "distributed.core",
    ):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with ExitStack() as stack:
        place: Any = scheduler
        if scheduler is None:
            stack.enter_context(dask.config.set(_DASK))
            place = stack.enter_context(_cluster(workers))
        try:
            client = stack.enter_context(
                distributed.Client(place, timeout=ANSWER_S, set_as_default=False)
            )
        except Exception as error:  # of whatever kind: what is there may speak anything
            got = (
                f"got {scheduler!r} ({error}). Copy it from what dask scheduler says when it starts"
            )
            raise InputError(
                f"--scheduler must be the address of a Dask scheduler that is at work, {got}."
            ) from None
        if scheduler is not None:
            _check_workers(client, scheduler)
        pool = _OnDask(client)
        stack.callback(pool.shutdown, wait=False, cancel_futures=True)
        yield pool


class _OnDask(ThreadPoolExecutor):
    """Every thread waits for one job of Dask: `Client.get_executor` waits for ever for a result
    that is lost as it arrives."""

    def __init__(self, client: Any) -> None:
        super().__init__(_UNCOUNTED)
        self._client = client

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        return super().submit(self._there, partial(fn, *args, **kwargs))

    def _there(self, call: Callable[[], Any]) -> Any:
        theirs = self._client.submit(call, pure=False)
        try:
            return theirs.result()
        except BaseException as error:
            if theirs.status == "error":
                raise  # the job's own
            raise BrokenExecutor(str(error)) from error


@contextmanager
def _cluster(workers: int) -> Iterator[Any]:
    """A cluster on this machine; results are there at its end, so one that closes slowly (a worker
    died) is left to do so."""
    from distributed import LocalCluster

    # Any free port: without a dashboard it would still ask for 8787, and warn where another cluster
    # has it.
    options: dict[str, Any] = {
        "dashboard_address": None,
        "scheduler_kwargs": {"dashboard_address": "127.0.0.1:0"},
    }
    options |= {
        "threads_per_worker": 1,
        "processes": True,
        "memory_limit": 0,
        "silence_logs": logging.CRITICAL,
    }
    try:
        cluster = LocalCluster(n_workers=workers or _usable_cores(), **options)
    except RuntimeError:
        raise InputError(_UNGUARDED) from None
    try:
        yield cluster
    finally:
        with suppress(TimeoutError):
            cluster.close(timeout=ANSWER_S)


def _check_workers(client: Any, scheduler: str) -> None:
    """Those there must give the numbers that are given here: others fail at every job, or mix
    versions in one table."""
    answers = client.run(partial(versions, python=True), on_error="return")
    if not answers:
        warnings.warn(
            f"the scheduler {scheduler} has no workers yet; jobs wait for the first one.",
            stacklevel=6,
        )
    for address, threads in client.nthreads().items():
        cure = "Start workers with --nthreads 1, as many as there are cores (--nworkers)"
        require(
            threads == 1, f"workers must have one thread each, got {threads} at {address}. {cure}."
        )
    for address, answer in answers.items():
        for name, wanted in versions(python=True).items():
            got = answer.get(name) if isinstance(answer, dict) else None
            cure = (
                f"got {got or 'none'} at {address}. Install it there, and start the worker again."
            )
            require(got == wanted, f"workers must have {name} {wanted} as it is here, {cure}")


@cache
def versions(*, python: bool = False) -> dict[str, str]:
    """Versions of what numbers come from; here, or in the worker that is asked."""
    own = {"ldbb-bayes": import_module("ldbb_bayes").__version__} | {
        name: version(name) for name in _PACKAGES
    }
    return own | ({"python": platform.python_version()} if python else {})


@contextmanager
def executor_named(
    kind: str, workers: int = 0, scheduler: str | None = None
) -> Iterator[Executor | None]:
    """Yield what the options of commands ask for; None where there is one process only, and jobs
    are run here."""
    check_known("--executor", [kind], EXECUTORS)
    require(workers >= 0, f"--workers must be 0 or more, got {workers}. 0 is one per core.")
    if scheduler is not None:
        cure = f"got --executor {kind}. Add it, or leave the address out."
        require(kind == "dask", f"--scheduler must go with --executor dask, {cure}")
        cure = "A cluster has the workers it was started with."
        require(not workers, f"--workers must not go with --scheduler, got {workers}. {cure}")
    if kind == "dask":
        with dask_executor(scheduler, workers) as executor:
            yield executor
    elif (workers or _usable_cores()) == 1:
        yield None
    else:
        with process_executor(workers) as executor:
            yield executor
