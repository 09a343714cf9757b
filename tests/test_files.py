"""Written whole or not at all: killed at any moment, the disk full, two at once."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.campaign.folder import write_campaign_into
from ldbb_bayes.files import check_target, staged_folder, write_whole

# Ends at the n-th time that Python opens, renames, makes or removes something below a folder.
WRITE = """
import os, sys
from pathlib import Path
import numpy as np
import ldbb_bayes as lb
place, moment, version = sys.argv[1], int(sys.argv[2]), sys.argv[3]
count = 0
EVENTS = {"open", "os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.chmod", "os.listdir", "os.scandir"}
def watch(event, arguments):
    global count
    if event in EVENTS and any(place in str(a) for a in arguments):
        count += 1
        if count == moment:
            os._exit(9)
angle = np.arange(72) * 5.0
tests = tuple(lb.CircularTest(force, angle, float(version) + 0.1 * np.cos(angle)) for force in (36.0, 389.0, 742.0))
sys.addaudithook(watch)
lb.write_campaign(lb.Campaign(tests, name=f"version {version}"), Path(place) / "result", force=True)
print(count)
"""
FILES = {"campaign.toml", "f036.csv", "f389.csv", "f742.csv"}


def campaign(version: int) -> lb.Campaign:
    angle = np.arange(72) * 5.0
    tests = tuple(lb.CircularTest(force, angle, float(version) + 0.1 * np.cos(angle)) for force in (36.0, 389.0, 742.0))
    return lb.Campaign(tests, name=f"version {version}")


def version_of(folder: Path) -> int:
    """Which version stands there, whole; a mixture fails."""
    read = lb.read_campaign(folder)
    version = int(read.name.removeprefix("version "))
    assert {path.name for path in folder.iterdir()} == FILES
    assert read.sha256 == campaign(version).sha256
    return version


def write_and_die(place: Path, moment: int, version: int) -> subprocess.CompletedProcess[str]:
    arguments = [sys.executable, "-c", WRITE, str(place), str(moment), str(version)]
    return subprocess.run(arguments, capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_killed_at_the_moments_of_writing(tmp_path: Path) -> None:
    """Spread over all moments, and each of the last twelve: the old result or the new one, put back where it lacks its name."""
    lb.write_campaign(campaign(1), tmp_path / "result")
    moments = int(write_and_die(tmp_path, 0, 1).stdout)
    assert moments > 16
    put_back, seen = 0, set()
    for k, moment in enumerate([*range(1, moments - 12, 4), *range(moments - 11, moments + 1)], start=2):
        assert write_and_die(tmp_path, moment, k).returncode == 9
        put_back += not (tmp_path / "result").exists()
        check_target(tmp_path / "result", force=True, ours=FILES)
        seen.add(version_of(tmp_path / "result"))
    assert put_back >= 1
    assert len(seen) > 1
    lb.write_campaign(campaign(99), tmp_path / "result", force=True)
    assert version_of(tmp_path / "result") == 99


@contextmanager
def full_disk(largest_bytes: int) -> Iterator[None]:
    """Files may not grow beyond so much: as on a full disk, writing fails in the middle."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, handler)


def test_disk_full_keeps_the_old_result(tmp_path: Path) -> None:
    lb.write_campaign(campaign(1), tmp_path / "result")
    with full_disk(300), pytest.raises(lb.InputError, match=r"result must be writable, got: .*Free some space"):
        lb.write_campaign(campaign(2), tmp_path / "result", force=True)
    assert version_of(tmp_path / "result") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["result"]


def test_disk_full_keeps_the_old_posterior(tmp_path: Path) -> None:
    """The library underneath does not survive this; the file is made in memory."""
    posterior = lb.sample(lb.HybridModel.default(0), campaign(1), sampler="independent", seed=1)
    lb.save(posterior, tmp_path / "posterior.nc")
    before = (tmp_path / "posterior.nc").read_bytes()
    for largest in (0, len(before) // 2, len(before) - 1):
        with full_disk(largest), pytest.raises(lb.InputError, match=r"posterior\.nc must be writable, got: .*Free some space"):
            lb.save(posterior, tmp_path / "posterior.nc")
        assert (tmp_path / "posterior.nc").read_bytes() == before
        assert [path.name for path in tmp_path.iterdir()] == ["posterior.nc"]


@pytest.mark.parametrize("call", ["rename", "chmod"])
def test_permission_denied_keeps_the_old_result(call: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lb.write_campaign(campaign(1), tmp_path / "result")

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os if call == "rename" else Path, call, refuse)
    with pytest.raises(lb.InputError, match="must be writable, got: Operation not permitted"):
        lb.write_campaign(campaign(2), tmp_path / "result", force=True)
    monkeypatch.undo()
    assert version_of(tmp_path / "result") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["result"]


def test_of_two_runs_into_one_new_folder_the_second_is_refused(tmp_path: Path) -> None:
    """Without --force nobody's result is replaced, even if it came while this one was at work."""
    target = tmp_path / "result"
    mine = staged_folder(target, force=False)
    (mine.__enter__() / "mine").write_text("2")
    with staged_folder(target, force=False) as other:
        (other / "theirs").write_text("1")
    with pytest.raises(lb.InputError, match="another run wrote meanwhile"):
        mine.__exit__(None, None, None)
    assert [path.name for path in target.iterdir()] == ["theirs"]


def test_runs_into_one_folder_at_once(tmp_path: Path) -> None:
    """In the end it is one of theirs, whole, and nothing is left beside it."""

    def replace(k: int) -> None:
        with staged_folder(tmp_path / "result", force=True, ours=FILES) as staging:
            write_campaign_into(campaign(2 + k % 4), staging)

    with ThreadPoolExecutor(4) as threads:
        list(threads.map(replace, range(40)))
        list(threads.map(lambda _: write_whole(tmp_path / "one", bytes(20_000)), range(100)))
    assert version_of(tmp_path / "result") in (2, 3, 4, 5)
    assert {path.name for path in tmp_path.iterdir()} == {"result", "one"}
    assert (tmp_path / "one").read_bytes() == bytes(20_000)


def test_a_folder_that_another_run_takes_away_between_two_renames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was there when this run came, and is not when this run looks again."""
    rename, moments = os.rename, iter([OSError(39, "Directory not empty")])

    def taken_away(source: str, target: str) -> None:
        for error in moments:
            raise error
        rename(source, target)

    monkeypatch.setattr(os, "rename", taken_away)
    lb.write_campaign(campaign(3), tmp_path / "result", force=True)
    assert version_of(tmp_path / "result") == 3
    listdir = os.listdir
    monkeypatch.setattr(os, "listdir", lambda path: listdir(f"{path}-gone"))
    monkeypatch.setattr(Path, "iterdir", lambda path: (path / name for name in listdir(f"{path}-gone")))
    check_target(tmp_path / "result", force=True, ours=FILES)


def test_links_to_themselves_and_names_of_nothing_are_refused(tmp_path: Path) -> None:
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    with pytest.raises(lb.InputError, match="leads nowhere"), staged_folder(loop, force=True):
        pass
    lb.write_campaign(campaign(1), tmp_path / "c")
    (tmp_path / "c" / "f036.csv").unlink()
    (tmp_path / "c" / "f036.csv").symlink_to(tmp_path / "c" / "f036.csv")
    with pytest.raises(lb.InputError, match=r"f036\.csv"):
        lb.read_campaign(tmp_path / "c")
    toml = tmp_path / "c" / "campaign.toml"
    toml.write_text(toml.read_text().replace("f036.csv", "f0\\u000036.csv"))
    with pytest.raises(lb.InputError, match="test 1: file"):
        lb.read_campaign(tmp_path / "c")


def test_another_results_folder_is_not_put_back(tmp_path: Path) -> None:
    (tmp_path / ".res-2-abcd1234-old").mkdir()
    check_target(tmp_path / "res", force=False)
    assert not (tmp_path / "res").exists()
    (tmp_path / ".res-abcd1234-old").mkdir()
    with pytest.raises(lb.InputError, match="must not exist"):
        check_target(tmp_path / "res", force=False)


@pytest.mark.parametrize(("code", "kept"), [(22, b"new"), (28, b"before")])
def test_a_mount_that_cannot_sync_is_no_error_and_a_full_one_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int, kept: bytes
) -> None:
    (tmp_path / "p").write_bytes(b"before")

    def refused(_: int) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(os, "fsync", refused)
    if code == 28:
        with pytest.raises(lb.InputError, match="p must be writable, got: No space left on device"):
            write_whole(tmp_path / "p", b"new")
    else:
        write_whole(tmp_path / "p", b"new")
    assert (tmp_path / "p").read_bytes() == kept
    assert [own.name for own in tmp_path.iterdir()] == ["p"]
