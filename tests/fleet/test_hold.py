"""One run at a time in a folder, with locks of the system and without."""

from __future__ import annotations

import errno
import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet import hold
from ldbb_bayes.fleet.hold import alone_in


@pytest.fixture(params=["locks", "refused", "none"])
def system(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """With locks; a mount that has none; a system that has none."""
    if request.param == "refused":

        def flock(*_: object) -> None:
            raise OSError(errno.ENOLCK, "No locks available")

        monkeypatch.setattr("ldbb_bayes.fleet.hold.fcntl.flock", flock)
    elif request.param == "none":
        monkeypatch.setattr(hold, "fcntl", None)
    return str(request.param)


def test_the_second_is_refused_until_the_first_has_ended(system: str, tmp_path: Path) -> None:
    with alone_in(tmp_path), pytest.raises(InputError, match=r"must not be in use, got .* at work there"), alone_in(tmp_path):
        pass

    def interrupted() -> None:
        with alone_in(tmp_path):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    with alone_in(tmp_path):
        pass
    assert [own.name for own in tmp_path.iterdir()] == [".lock"]


def mark(folder: Path, host: str, process: int) -> Path:
    path = folder / ".running"
    path.write_text(json.dumps({"host": host, "process": process}))
    return path


def test_what_a_killed_run_left_is_taken_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hold, "fcntl", None)
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    for process in (ended.pid, os.getpid()):  # numbers of processes come again
        mark(tmp_path, socket.gethostname(), process)
        with alone_in(tmp_path):
            assert json.loads((tmp_path / ".running").read_text())["process"] == os.getpid()
        assert [own.name for own in tmp_path.iterdir()] == [".lock"]


def test_whoever_may_be_at_work_is_let_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hold, "fcntl", None)
    for host, process in ((socket.gethostname(), os.getppid()), ("elsewhere", 2**22 + 1)):
        path = mark(tmp_path, host, process)
        told = rf"got process {process} on {host} at work there.*if it has ended, remove {path}"
        with pytest.raises(InputError, match=told), alone_in(tmp_path):
            pass
        assert path.exists()
    path.write_text("{")
    with pytest.raises(InputError, match="got a mark that does not say whose"), alone_in(tmp_path):
        pass


def test_a_failing_disk_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def flock(*_: object) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr("ldbb_bayes.fleet.hold.fcntl.flock", flock)
    with pytest.raises(OSError, match="Input/output error"), alone_in(tmp_path):
        pass
