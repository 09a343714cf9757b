"""Independent jobs: every result once, few in flight, and what happens when a job raises, a worker dies or nobody wants more."""

from __future__ import annotations

import os
import signal
import struct
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.processes import process_executor
from ldbb_bayes.work import Lost, done


class Late(Executor):
    """Holds jobs back until asked; runs the last one first."""

    def __init__(self, workers: int | None = None) -> None:
        if workers is not None:
            self._max_workers = workers
        self.held: list[tuple[Future[Any], Callable[[], Any]]] = []
        self.most = 0
        self.made: list[Future[Any]] = []

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.held.append((future, partial(fn, *args, **kwargs)))
        self.made.append(future)
        self.most = max(self.most, len(self.held))
        return future

    def finish(self) -> None:
        future, run = self.held.pop()
        future.set_result(run())


class Eager(Late):
    """Runs a job as soon as so many are held."""

    def __init__(self, workers: int | None, at: int) -> None:
        super().__init__(workers)
        self.at = at

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future = super().submit(fn, *args, **kwargs)
        if len(self.held) == self.at:
            for _ in range(self.at):
                self.finish()
        return future


def square(x: int) -> int:
    return x * x


def endless(read: list[int]) -> Iterator[int]:
    k = 0
    while True:
        read.append(k)
        yield k
        k += 1


def dies(folder: Path, times: int, at: int, x: int) -> int:
    """Kills its worker so many times (−1: always) when it comes to one job."""
    time.sleep(0.01)
    if x == at:
        tries = len(list(folder.iterdir()))
        if times < 0 or tries < times:
            (folder / str(tries)).touch()
            os.kill(os.getpid(), signal.SIGKILL)
    return x * x


def dies_sending(folder: Path, at: int, x: int) -> int:
    """Kills its worker once, in the middle of sending a result."""
    if x == at and not (folder / "died").exists():
        (folder / "died").touch()
        frame = sys._getframe()
        while "result_queue" not in frame.f_locals:
            assert frame.f_back is not None
            frame = frame.f_back
        os.write(frame.f_locals["result_queue"]._writer.fileno(), struct.pack("!i", 1000) + b"half")
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.01)
    return x * x


def outlasts(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def leaves(x: int) -> int:
    if x == 1:
        os._exit(3)
    return x


def blas_threads(_: int) -> set[int]:
    import numpy  # noqa: F401

    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


def test_here_one_after_the_other_and_no_further_than_asked() -> None:
    read: list[int] = []
    results = done(square, endless(read))
    assert [next(results) for _ in range(3)] == [(0, 0), (1, 1), (2, 4)]
    assert read == [0, 1, 2]


@pytest.mark.parametrize("workers", [1, 3])
def test_every_job_once_with_its_index(workers: int) -> None:
    with ThreadPoolExecutor(workers) as threads:
        assert sorted(done(square, range(500), threads)) == [(k, k * k) for k in range(500)]
    assert list(done(square, [], Late())) == []


def test_results_come_as_jobs_finish() -> None:
    """The executor runs what it holds backwards, five at a time; the fifth is known to be done when it is handed in."""
    assert [k for k, _ in done(square, range(10), Eager(2, at=5), window=5)] == [3, 2, 1, 0, 4, 8, 7, 6, 5, 9]


@pytest.mark.parametrize(
    ("workers", "window", "expected"), [(None, None, 64), (2, None, 64), (100, None, 400), (100, 7, 7), (None, 1, 1)]
)
def test_no_more_in_flight_than_the_window(workers: int | None, window: int | None, expected: int) -> None:
    read: list[int] = []
    executor = Eager(workers, at=expected)
    results = done(square, endless(read), executor, window=window)
    for count in range(1, 2 * expected):
        next(results)
        assert len(read) <= count + expected
    assert executor.most == expected
    results.close()


def test_a_million_jobs_are_no_million_futures() -> None:
    read: list[int] = []
    executor = Late(2)
    results = done(square, endless(read), executor)
    assert read == []
    executor.submit = partial(submitted_and_run, executor)  # type: ignore[method-assign]
    next(results)
    assert len(read) == 64


def submitted_and_run(executor: Late, fn: Callable[..., Any], *args: Any) -> Future[Any]:
    future = Late.submit(executor, fn, *args)
    executor.finish()
    return future


def test_one_blas_thread_each() -> None:
    with threadpool_limits(2, user_api="blas"):
        assert next(done(blas_threads, [0])) == (0, {1})


def test_threads_take_turns_and_leave_the_number_of_blas_threads() -> None:
    """Limits nest by time, not by thread: the first to end would give the others all threads, the last would keep one."""
    at_work, most = [0], [0]

    def job(x: int) -> set[int]:
        at_work[0] += 1
        most[0] = max(most[0], at_work[0])
        time.sleep(0.002 * (x % 3))
        found = blas_threads(x)
        at_work[0] -= 1
        return found

    before = blas_threads(0)
    with ThreadPoolExecutor(4) as threads:
        assert [found for _, found in done(job, range(30), threads)] == [{1}] * 30
    assert blas_threads(0) == before
    assert most == [1]


def test_a_job_may_have_jobs_of_its_own() -> None:
    with ThreadPoolExecutor(1) as threads:
        assert list(done(lambda x: list(done(square, range(x))), [2], threads)) == [(0, [(0, 0), (1, 1)])]


def test_when_the_consumer_stops_the_rest_is_cancelled() -> None:
    executor = Eager(None, at=64)

    def consume() -> None:
        for _ in done(square, range(1000), executor, window=100):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        consume()
    assert len(executor.made) == 100
    assert all(future.cancelled() for future in executor.made[64:])


def test_a_job_that_raises_says_which_and_ends_the_rest() -> None:
    with pytest.raises(ZeroDivisionError) as raised:
        list(done(lambda x: 1 // (x - 3), range(10)))
    assert raised.value.__notes__ == ["In job 3, counted from 0."]
    executor = Eager(None, at=1)
    executor.finish = lambda: executor.held.pop()[0].set_exception(ValueError("no"))  # type: ignore[method-assign]
    with pytest.raises(ValueError, match="no") as raised_there:
        list(done(square, range(10), executor))
    assert raised_there.value.__notes__ == ["In job 0, counted from 0."]


@pytest.mark.parametrize("name", ["window", "retries"])
def test_refused(name: str) -> None:
    with pytest.raises(InputError, match=f"{name} must be at least 1, got 0"):
        done(square, [], **{name: 0})


def test_an_executor_that_gives_up_is_said_once() -> None:
    executor = Eager(None, at=3)
    executor.finish = lambda: executor.held.pop()[0].cancel()  # type: ignore[method-assign, assignment, return-value]
    with pytest.raises(InputError, match=r"the executor must last as long as its jobs, .* Finished work is kept"):
        list(done(square, range(10), executor))


@pytest.mark.parametrize("times", [1, 2])
def test_a_killed_worker_costs_nothing(times: int, tmp_path: Path) -> None:
    with process_executor(2) as executor:
        results = dict(done(partial(dies, tmp_path, times, 5), range(100), executor))
    assert results == {k: k * k for k in range(100)}
    assert len(list(tmp_path.iterdir())) == times


def test_a_worker_killed_while_it_sends_costs_nothing(tmp_path: Path) -> None:
    """It left half a message in the pipe, for the rest of which its pool would wait for ever."""
    with process_executor(2) as executor:
        results = dict(done(partial(dies_sending, tmp_path, 5), range(100), executor))
    assert (tmp_path / "died").exists()
    assert results == {k: k * k for k in range(100)}


def test_an_interruption_while_a_half_message_is_waited_for(tmp_path: Path) -> None:
    def interrupted() -> None:
        with process_executor(2) as executor:
            executor.submit(dies_sending, tmp_path, 5, 5)
            while not (tmp_path / "died").exists():
                time.sleep(0.01)
            raise KeyboardInterrupt

    start = time.perf_counter()
    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert time.perf_counter() - start < 30.0


def test_processes_that_end_in_order_are_let_be(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last job outlasts the looks at the others, which have nothing left to do."""
    monkeypatch.setattr("ldbb_bayes.fleet.processes._LOOK_S", 0.1)
    with process_executor(2) as executor:
        futures = [executor.submit(outlasts, seconds) for seconds in (0.0, 1.0)]
    assert [future.result() for future in futures] == [0.0, 1.0]


def test_a_job_that_always_kills_its_worker_is_lost_alone(tmp_path: Path) -> None:
    with process_executor(2) as executor:
        results = dict(done(partial(dies, tmp_path, -1, 5), range(100), executor))
        assert dict(done(square, range(3), executor)) == {0: 0, 1: 1, 2: 4}
    lost = results.pop(5)
    assert isinstance(lost, Lost)
    assert lost.reason.startswith("its worker died whenever it was tried, the last time with no other job at work")
    assert results == {k: k * k for k in range(100) if k != 5}
    assert len(list(tmp_path.iterdir())) == 3


def test_a_plain_pool_whose_workers_die_is_refused_after_what_is_done() -> None:
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        results = done(leaves, range(10), pool)
        assert next(results) == (0, 0)
        with pytest.raises(InputError, match=r"workers must live as long as their jobs, .*work is kept.*process_executor"):
            list(results)


class KilledWorker(Exception):
    """As Dask's scheduler says it of one job, the others going on."""


KilledWorker.__module__ = "distributed.scheduler"


class Killing(ThreadPoolExecutor):
    """Blames some jobs for workers that died: the guilty whenever they run, others only beside them."""

    def __init__(self, guilty: set[int], beside: set[int]) -> None:
        super().__init__(1)
        self.guilty, self.beside, self.flying, self.alone = guilty, beside, 0, []

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        self.flying += 1
        future = super().submit(self._run, fn, *args)
        future.add_done_callback(self._landed)
        return future

    def _landed(self, _: Future[Any]) -> None:
        self.flying -= 1

    def _run(self, fn: Callable[..., Any], function: Callable[[int], int], x: int) -> int:
        time.sleep(0.005)
        if x in self.guilty or x in self.beside:
            if x in self.beside and self.flying == 1:
                return fn(function, x)
            raise KilledWorker(x)
        return fn(function, x)


def test_jobs_blamed_by_dask_are_tried_once_more_by_themselves() -> None:
    with Killing(guilty={3}, beside={4}) as executor:
        results = dict(done(square, range(50), executor))
    assert [k for k, result in results.items() if isinstance(result, Lost)] == [3]
    assert {k: result for k, result in results.items() if k != 3} == {k: k * k for k in range(50) if k != 3}
