"""Processes and Dask give the same; what they do when workers or the scheduler die, and what they say to bad options.

Dask runs in a process of its own: it warns of what is no concern of these tests.
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.executors import dask_executor, executor_named, process_executor
from ldbb_bayes.work import done

DASK_SCRIPT = """
import json, os, signal, sys, time
from pathlib import Path

from ldbb_bayes.fleet.executors import dask_executor
from ldbb_bayes.work import Lost, done

FOLDER = Path(sys.argv[1])


def job(x):
    time.sleep(0.01)
    if x == 5 and not (FOLDER / "died").exists():
        (FOLDER / "died").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if x == 9 and sys.argv[2] == "poison":
        os.kill(os.getpid(), signal.SIGKILL)
    # Dask would take a list like this for a task of its own, if it saw it.
    return (max, [x * x, 0])


if __name__ == "__main__":
    with dask_executor(workers=2) as executor:
        found = dict(done(job, range(40), executor))
        ranks = None
        if sys.argv[2] == "validate":
            import ldbb_bayes as lb
            from campaigns import plan

            small = plan((40, 40, 40), forces_N=(36.0, 400.0, 742.0))
            model = lb.HybridModel.default(0)
            ranks = lb.validate(model, small, replicates=10, draws=19, seed=3, executor=executor).ranks.tolist()
    lost = [k for k, value in found.items() if isinstance(value, Lost)]
    right = all(value == (max, [k * k, 0]) for k, value in found.items() if k not in lost)
    print(json.dumps({"count": len(found), "right": right, "lost": lost, "ranks": ranks}))
"""
UNGUARDED = """
import sys
from math import sqrt
from ldbb_bayes.fleet.executors import executor_named
from ldbb_bayes.work import done

with executor_named(sys.argv[1], 2) as executor:
    print(dict(done(sqrt, range(5), executor)))
"""
SCHEDULER_LOST = """
import os, subprocess, sys, time

from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.executors import executor_named
from ldbb_bayes.work import done


def job(x):
    time.sleep(0.05)
    return x


if __name__ == "__main__":
    address = sys.argv[1]
    started = [
        subprocess.Popen([sys.executable, "-m", f"distributed.cli.{which}", *more, "--no-dashboard"], stderr=subprocess.DEVNULL)
        for which, more in (
            ("dask_scheduler", ["--port", address.split(":")[-1]]),
            ("dask_worker", [address, "--nthreads", "1", "--no-nanny"]),
        )
    ]
    try:
        time.sleep(1.0)
        with executor_named("dask", 0, address) as executor:
            for count, _ in enumerate(done(job, range(10_000), executor)):
                if count == 10:
                    started[0].kill()
    except InputError as error:
        print(count, error)
    finally:
        for process in started:
            process.kill()
            process.wait()
"""


def run(script: str, folder: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    path = folder / "script.py"
    path.write_text(script)
    own = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, str(path), *map(str, arguments)]
    return subprocess.run(command, env=own, capture_output=True, text=True, timeout=120, check=False)


def threads_told(_: int) -> tuple[str | None, str | None]:
    return os.environ.get("OPENBLAS_NUM_THREADS"), os.environ.get("MKL_NUM_THREADS")


def process_id(_: int) -> int:
    time.sleep(0.05)
    return os.getpid()


def long_sleep(x: int) -> int:
    time.sleep(60.0 if x else 0.0)
    return os.getpid()


def test_processes_have_one_thread_and_the_environment_is_put_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    with process_executor(1) as executor:
        assert next(done(threads_told, [0], executor)) == (0, ("1", "1"))
    assert threads_told(0) == ("7", None)


def test_so_many_processes_none_of_them_this_one() -> None:
    with executor_named("process", 2) as executor:
        found = {which for _, which in done(process_id, range(20), executor)}
    assert len(found) == 2
    assert os.getpid() not in found
    with executor_named("process", 1) as executor:
        assert executor is None


def test_an_interruption_stops_those_at_work() -> None:
    start = time.perf_counter()

    def interrupted() -> None:
        with process_executor(2) as executor:
            for _, which in done(long_sleep, range(10), executor):
                raise KeyboardInterrupt(which)

    with pytest.raises(KeyboardInterrupt) as raised:
        interrupted()
    assert time.perf_counter() - start < 20.0
    with pytest.raises(ProcessLookupError):
        os.kill(raised.value.args[0], 0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("proces", 0, None), "--executor must be one of process, dask, got 'proces'. Did you mean 'process'?"),
        (("process", 0, "tcp://a:1"), "--scheduler must go with --executor dask, got --executor process"),
        (("process", -1, None), "--workers must be 0 or more, got -1"),
        (("dask", 3, "tcp://a:1"), "--workers must not go with --scheduler, got 3"),
    ],
)
def test_options_that_do_not_fit(arguments: tuple[str, int, str | None], message: str) -> None:
    with pytest.raises(InputError) as raised, executor_named(*arguments):
        pass
    assert message in str(raised.value)


def test_without_dask_the_cure_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    monkeypatch.setitem(sys.modules, "dask", None)
    with pytest.raises(InputError, match=r"pip install 'ldbb-bayes\[fleet\]'"), dask_executor():
        pass


@pytest.mark.parametrize("kind", ["process", "dask"])
def test_an_unguarded_script_is_told_so_once(kind: str, tmp_path: Path) -> None:
    ended = run(UNGUARDED, tmp_path, kind)
    assert ended.returncode == 1
    assert ended.stderr.count("Traceback") == 1
    assert 'A script must do its work under `if __name__ == "__main__":`' in ended.stderr.splitlines()[-1]


WRONG = """
import sys
from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet import cluster
cluster.ANSWER_S = 1.0
for address in sys.argv[1:]:
    try:
        with cluster.dask_executor(address):
            pass
    except InputError as error:
        print(error)
"""


def test_a_scheduler_that_is_none(tmp_path: Path) -> None:
    with socket.socket() as silent, socket.socket() as closed:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        closed.bind(("127.0.0.1", 0))
        addresses = ["nonsense", "foo://x:1", *(f"tcp://127.0.0.1:{s.getsockname()[1]}" for s in (silent, closed))]
        ended = run(WRONG, tmp_path, *addresses)
    told = ended.stdout.splitlines()
    assert ended.stderr == ""
    for address, line in zip(addresses, told, strict=True):
        assert line.startswith(f"--scheduler must be the address of a Dask scheduler that is at work, got '{address}' (")
    assert "missing port number" in told[0]
    assert "unknown address scheme 'foo'" in told[1]
    assert "(no answer in 1 s)" in told[2]


UNLIKE = """
import os, subprocess, sys, time, warnings
from math import sqrt

from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.executors import dask_executor
from ldbb_bayes.work import done


def start(which, *more, path=""):
    own = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, [path, os.environ["PYTHONPATH"]]))}
    command = [sys.executable, "-m", f"distributed.cli.{which}", *more, "--no-dashboard"]
    return subprocess.Popen(command, stderr=subprocess.DEVNULL, env=own)


def worker(*more, path=""):
    return start("dask_worker", address, "--no-nanny", *more, path=path)


def tried(late=None):
    warnings.simplefilter("ignore")
    try:
        with dask_executor(address) as executor:
            started.append(late() if late else None)
            print(dict(done(sqrt, [4.0], executor)))
    except InputError as error:
        print(error)


if __name__ == "__main__":
    address, folder = sys.argv[1:]
    started = [start("dask_scheduler", "--port", address.split(":")[-1])]
    try:
        for threads, path in (("1", ""), ("2", ""), ("1", "old"), ("1", "none")):
            started.append(worker("--nthreads", threads, path=path and f"{folder}/{path}"))
            time.sleep(4.0)
            own = started[-1]
            tried()
            own.kill()
            time.sleep(1.0)
        for path in ("old", "none"):
            tried(lambda: worker("--nthreads", "1", path=f"{folder}/{path}"))
            started[-1].kill()
            time.sleep(1.0)
    finally:
        for process in filter(None, started):
            process.kill()
            process.wait()
"""
# What a worker imports first: it has another numpy, or lacks this package.
OLD = """
import importlib.metadata as m
real = m.version
m.version = lambda name: "0.1" if name == "numpy" else real(name)
"""
NONE = """
import sys
class Without:
    def find_spec(self, name, *_):
        if name.partition(".")[0] == "ldbb_bayes":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Without())
"""


@pytest.mark.slow
def test_workers_that_are_unlike_this_process_are_refused(tmp_path: Path) -> None:
    for name, text in (("old", OLD), ("none", NONE)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "sitecustomize.py").write_text(text)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    ended = run(UNLIKE, tmp_path, address, tmp_path)
    assert "Traceback" not in ended.stderr
    told = ended.stdout.splitlines()
    assert told[0] == "{0: 2.0}"
    for line, expected in zip(
        told[1:],
        (
            "workers must have one thread each, got 2 at tcp://",
            "workers must have numpy",
            "workers must have ldbb_bayes",
            "workers must have numpy",
            "workers must have ldbb_bayes",
        ),
        strict=True,
    ):
        assert line.startswith(expected)
    assert "got 0.1 at" in told[2]
    assert "got 0.1 at" in told[4]


def test_a_killed_dask_worker_costs_nothing(tmp_path: Path) -> None:
    ended = run(DASK_SCRIPT, tmp_path, tmp_path, "once")
    assert ended.stderr == ""
    found = json.loads(ended.stdout)
    assert (tmp_path / "died").exists()
    assert (found["count"], found["right"], found["lost"]) == (40, True, [])


@pytest.mark.slow
def test_validation_is_the_same_here_on_processes_and_on_dask(tmp_path: Path) -> None:
    # Not above: every worker of the other tests would import them.
    from campaigns import plan

    import ldbb_bayes as lb

    ended = run(DASK_SCRIPT, tmp_path, tmp_path, "validate")
    assert ended.stderr == ""
    ranks = json.loads(ended.stdout)["ranks"]
    small = plan((40, 40, 40), forces_N=(36.0, 400.0, 742.0))
    arguments = {"replicates": 10, "draws": 19, "seed": 3}
    assert ranks == lb.validate(lb.HybridModel.default(0), small, **arguments).ranks.tolist()
    with process_executor(2) as executor:
        assert ranks == lb.validate(lb.HybridModel.default(0), small, executor=executor, **arguments).ranks.tolist()


@pytest.mark.slow
def test_a_job_that_always_kills_its_dask_worker_is_lost_alone(tmp_path: Path) -> None:
    ended = run(DASK_SCRIPT, tmp_path, tmp_path, "poison")
    assert ended.stderr == ""
    found = json.loads(ended.stdout)
    assert (found["count"], found["right"], found["lost"]) == (40, True, [9])


@pytest.mark.slow
def test_a_scheduler_that_is_lost_is_said_once(tmp_path: Path) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    ended = run(SCHEDULER_LOST, tmp_path, address)
    count, _, message = ended.stdout.partition(" ")
    assert int(count) >= 10
    assert message.startswith("the executor must last as long as its jobs, got one that gave them up")
    assert "Finished work is kept." in message
    assert "Traceback" not in ended.stderr


def test_dask_workers_keep_freed_memory() -> None:
    """As processes do: what Dask sets for its workers costs more than half of their speed."""
    dask = pytest.importorskip("dask")
    from ldbb_bayes.fleet.cluster import _SETTINGS

    with dask.config.set(_SETTINGS):
        environment = dask.config.get("distributed.nanny.pre-spawn-environ")
    assert environment["MALLOC_TRIM_THRESHOLD_"] >= 2**25
    assert environment["MALLOC_MMAP_THRESHOLD_"] >= 2**25
    assert environment["OPENBLAS_NUM_THREADS"] == "1"
    assert environment["DASK_LOGGING__DISTRIBUTED"] == "critical"
