"""Independent jobs: every result once, whether a job raises, a worker dies or the caller stops."""

from __future__ import annotations

import json
import os
import shutil
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from itertools import count
from multiprocessing import Pipe, get_context
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy  # noqa: F401, its threads are counted
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.parallel import (
    Lost,
    dask_executor,
    done,
    executor_named,
    one_blas_thread,
    process_executor,
    second_process,
    start_early,
)
from ldbb_bayes.parallel.dask_workers import _local_cluster
from ldbb_bayes.parallel.process_pool import _Answer, _send


class Late(Executor):
    """Runs a job only when so many are in flight, the last one first."""

    def __init__(self, at: int, workers: int | None = None) -> None:
        if workers is not None:
            self.workers = workers
        self.at = at
        self.waiting = []
        self.made = []

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.waiting.append((future, partial(fn, *args, **kwargs)))
        self.made.append(future)
        if len(self.waiting) == self.at:
            while self.waiting:
                self.finish(*self.waiting.pop())
        return future

    def finish(self, future: Future[Any], call: Callable[[], Any]) -> None:
        future.set_result(call())


def cancel(future: Future[Any], _: Callable[[], Any]) -> None:
    future.cancel()


def square(x: int) -> int:
    return x * x


def reciprocal(x: int) -> float:
    return 1 / (x - 3)


def blas_threads(_: int) -> set[int]:
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


def dies(folder: Path, times: int, x: int) -> int:
    """Job 5 kills its worker so many times."""
    tries = len(list(folder.iterdir()))
    if x == 5 and tries < times:
        (folder / str(tries)).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return x * x


def dies_sending(folder: Path, x: int) -> int:
    """Job 5 kills its worker once, in the middle of sending a result."""
    if x == 5 and not (folder / "died").exists():
        (folder / "died").touch()
        frame = sys._getframe()
        while "connection" not in frame.f_locals:
            assert frame.f_back is not None
            frame = frame.f_back
        os.write(frame.f_locals["connection"].fileno(), struct.pack("!i", 1000) + b"half")
        os.kill(os.getpid(), signal.SIGKILL)
    return x * x


def where(_: int) -> tuple[int, str | None]:
    return os.getpid(), os.environ.get("OPENBLAS_NUM_THREADS")


def sleeps(x: int) -> int:
    time.sleep(60.0 if x else 0.0)
    return os.getpid()


def test_every_job_once_with_its_index_and_no_further_than_asked() -> None:
    numbers = count()
    results = done(square, numbers)
    assert [next(results) for _ in range(3)] == [(0, 0), (1, 1), (2, 4)]
    assert next(numbers) == 3
    with ThreadPoolExecutor(3) as threads:
        assert sorted(done(square, range(60), threads)) == [(k, k * k) for k in range(60)]


def test_one_blas_thread_inside_and_the_old_number_after() -> None:
    with threadpool_limits(2, user_api="blas"):
        assert next(done(blas_threads, [0])) == (0, {1})
        assert one_blas_thread(blas_threads)(0) == {1}
        assert blas_threads(0) == {2}
        with pytest.raises(ZeroDivisionError):
            one_blas_thread(reciprocal)(3)
        assert blas_threads(0) == {2}


@pytest.mark.parametrize(
    "function",
    [
        lb.sample,
        lb.log_evidence,
        lb.identify,
        lb.compare,
        lb.design,
        lb.find_outlying_tests,
        lb.local_fits,
        lb.fit_least_squares,
        lb.inference.marginalize,
        lb.inference.summarize_nuisances,
        lb.analysis.judge_posterior,
        lb.analysis.budget_uncertainty,
        lb.analysis.compare_posteriors,
        lb.analysis.predict_circularity,
        lb.analysis.decompose_deviation,
    ],
)
def test_what_computes_has_one_blas_thread(function: Any) -> None:
    computing = one_blas_thread(lambda: None).__code__
    codes = [function.__code__, getattr(function, "__wrapped__", function).__code__]
    assert computing in codes


def test_when_the_consumer_stops_the_rest_is_cancelled() -> None:
    """No more than four jobs a worker have been begun."""
    executor = Late(at=8, workers=3)
    results = done(square, range(100), executor)
    next(results)
    results.close()  # type: ignore[attr-defined]
    assert [future.cancelled() for future in executor.made] == [False] * 8 + [True] * (
        len(executor.made) - 8
    )
    assert len(executor.made) == 12


def test_a_job_that_raises_says_which() -> None:
    with pytest.raises(ZeroDivisionError) as raised:
        list(done(reciprocal, range(10)))
    assert raised.value.__notes__ == ["In job 3, counted from 0."]


def test_an_executor_that_gives_up_is_refused_after_what_is_done() -> None:
    executor = Late(at=64)
    executor.finish = cancel  # type: ignore[method-assign]
    with pytest.raises(
        InputError,
        match=r"the executor must last as long as its jobs, .* work is kept.*process_executor",
    ):
        list(done(square, range(100), executor))
    with (
        ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool,
        pytest.raises(InputError, match="its workers died"),
    ):
        list(done(os._exit, [0], pool))


@pytest.mark.slow
def test_processes(tmp_path: Path) -> None:
    """Two that last, none of them this one; killed ones cost nothing but their job, a job that
    always kills its worker a row."""
    with process_executor(2) as executor:
        workers = {worker for _, worker in done(where, range(20), executor)}
        assert {threads for _, threads in workers} == {"1"}
        assert len(workers) == 2
        assert os.getpid() not in dict(workers)
        with pytest.raises(ZeroDivisionError) as raised:
            list(done(reciprocal, range(4), executor))
        assert "in reciprocal" in raised.value.__notes__[0]
        for name, job, deaths in (
            ("once", partial(dies, tmp_path / "once", 1), 1),
            ("sending", partial(dies_sending, tmp_path / "sending"), 1),
            ("always", partial(dies, tmp_path / "always", 9), 2),
        ):
            (tmp_path / name).mkdir()
            results = dict(done(job, range(12), executor))
            lost = results.pop(5)
            assert results == {k: k * k for k in range(12) if k != 5}
            assert len(list((tmp_path / name).iterdir())) == deaths
            assert lost == 25 or name == "always"
        assert isinstance(lost, Lost)
        assert lost.reason.startswith(
            "its worker died twice, the second time with no other job at work"
        )
    for process, _ in workers:
        with pytest.raises(ProcessLookupError):
            os.kill(process, 0)
    with executor_named("process", 1) as executor:
        assert executor is None


class Unpicklable:
    """A result that refuses to be pickled and to be written as text."""

    def __init__(self, error: Exception) -> None:
        self.error = error

    def __reduce__(self) -> str:
        raise self.error

    def __str__(self) -> str:
        raise AssertionError("an unpicklable result is not written as text")


@pytest.mark.parametrize("error", [OSError("no file"), ValueError("no file")])
def test_a_result_that_cannot_be_pickled_is_told(error: Exception) -> None:
    connection, worker_connection = Pipe()
    _send(worker_connection, _Answer(True, Unpicklable(error)))
    answer = connection.recv()
    assert not answer.succeeded
    assert str(answer.content).startswith("Unpicklable must be picklable, got: no file.")


@pytest.mark.slow
def test_a_call_begun_ahead_has_its_result_whatever_becomes_of_its_process(tmp_path: Path) -> None:
    def result_of_begun(call: Callable[[], Any], executor: Executor | None) -> Any:
        result = start_early(call, executor)
        time.sleep(0.5)  # the other process has begun the call
        return result()

    with process_executor(1) as executor:
        assert result_of_begun(os.getpid, executor) != os.getpid()
        assert result_of_begun(os.getpid, None) == os.getpid()
        assert result_of_begun(partial(dies, tmp_path, 1, 5), executor) == 25
        assert len(list(tmp_path.iterdir())) == 1
        with pytest.raises(ZeroDivisionError):
            result_of_begun(partial(reciprocal, 3), executor)


@pytest.mark.slow
def test_a_call_that_another_process_has_not_begun_is_made_here() -> None:
    with process_executor(1) as executor:
        busy = start_early(partial(time.sleep, 2.0), executor)
        assert start_early(os.getpid, executor)() == os.getpid()
        busy()


@pytest.mark.slow
def test_an_interruption_stops_those_at_work() -> None:
    def interrupted() -> None:
        with process_executor(2) as executor:
            for _, process in done(sleeps, range(10), executor):
                raise KeyboardInterrupt(process)

    start = time.perf_counter()
    with pytest.raises(KeyboardInterrupt) as raised:
        interrupted()
    assert time.perf_counter() - start < 20.0
    with pytest.raises(ProcessLookupError):
        os.kill(raised.value.args[0], 0)


KilledWorker = type("KilledWorker", (Exception,), {})


def test_a_job_blamed_by_dask_is_tried_once_more_when_all_others_are_done() -> None:
    executor = Late(at=4, workers=1)
    tried = []

    def finish(future: Future[Any], call: Callable[[], Any]) -> None:
        executor.at = 1
        work = call.args[-1]  # type: ignore[attr-defined]
        tried.append(work)
        if work == 3:
            future.set_exception(KilledWorker())
        else:
            future.set_result(call())

    executor.finish = finish  # type: ignore[method-assign]
    results = list(done(square, range(12), executor))
    assert tried == [3, 2, 1, 0, *range(4, 12), 3]
    assert results[-1] == (3, Lost())
    assert sorted(results[:-1]) == [(k, k * k) for k in range(12) if k != 3]


def test_executors_that_cannot_be_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with (
        pytest.raises(InputError, match="--workers must be 0 or more, got -1"),
        executor_named("process", -1),
    ):
        pass
    with (
        pytest.raises(InputError, match="--workers must not go with --scheduler, got 3"),
        executor_named("dask", 3, "tcp://a:1"),
    ):
        pass
    monkeypatch.setattr("multiprocessing.context.SpawnProcess.start", fails_to_start)
    with (
        pytest.raises(InputError, match=r"a worker process must start, got no room"),
        process_executor(1) as executor,
    ):
        executor.submit(int).result()
    for cores in (1, 2):
        monkeypatch.setattr("ldbb_bayes.parallel.executors.usable_cores", lambda cores=cores: cores)
        with second_process() as executor:
            assert (executor is None, start_early(os.getpid, executor)()) == (
                cores == 1,
                os.getpid(),
            )
    monkeypatch.setitem(sys.modules, "dask", None)
    with (
        pytest.raises(
            InputError, match=r"find the library dask, got none.*pip install 'ldbb-bayes\[fleet\]'"
        ),
        dask_executor(),
    ):
        pass


def fails_to_start(_: object) -> None:
    raise OSError("no room")


def run(script: str, folder: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    shutil.copy(Path(__file__).parent / "scripts" / f"{script}.py", folder / "script.py")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, str(folder / "script.py"), *map(str, arguments)]
    return subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=120, check=False
    )


def test_why_a_cluster_of_dask_does_not_start_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def cluster_without_port(**_: object) -> None:
        raise RuntimeError("Cluster failed to start: no free port")

    distributed = SimpleNamespace(LocalCluster=cluster_without_port)
    monkeypatch.setitem(sys.modules, "distributed", distributed)
    with (
        pytest.raises(InputError, match=r"got 'Cluster failed to start: no free port'\. Remove"),
        _local_cluster(1),
    ):
        pass


@pytest.mark.parametrize("kind", ["process", pytest.param("dask", marks=pytest.mark.slow)])
def test_an_unguarded_script_is_told_so_once(kind: str, tmp_path: Path) -> None:
    ended = run("unguarded", tmp_path, kind)
    assert ended.returncode == 1
    assert ended.stderr.count("Traceback") == 1
    assert 'A script must do its work under `if __name__ == "__main__":`' in ended.stderr


@pytest.mark.slow
def test_jobs_run_on_workers_of_dask(tmp_path: Path) -> None:
    """In a process of its own: it warns of what is no concern here."""
    ended = run("dask", tmp_path, tmp_path)
    assert ended.stdout, ended.stderr
    first, *refused = ended.stdout.splitlines()
    assert json.loads(first) == [list(range(20)), [9], True], ended.stderr
    assert (tmp_path / "died").exists()
    assert "that is at work, with its port, got 'nonsense'. Copy it" in refused[0]
    assert "got 'tcp://127.0.0.1:1' (" in refused[1]
    assert refused[2].startswith("workers must have one thread each, got 2 at inproc://")
