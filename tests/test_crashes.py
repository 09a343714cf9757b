"""Killed while writing, the disk full, two at once: the old result or the new one, never a mixture and never nothing."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes import files
from ldbb_bayes.files import check_target, staged_folder

# Dies at the n-th time that Python opens, renames, makes or removes something below a folder.
DIE_AT = """
import os, sys
place, moment = sys.argv[1], int(sys.argv[2])
count = 0
EVENTS = {"open", "os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.chmod", "os.listdir", "os.scandir", "ctypes.dlsym"}
def watch(event, arguments):
    global count
    if event in EVENTS and (event.startswith("ctypes") or any(place in str(a) for a in arguments)):
        count += 1
        if count == moment:
            os._exit(9)
"""
WRITE = """
from pathlib import Path
import numpy as np
import ldbb_bayes as lb
angle = np.arange(72) * 5.0
reading = np.full(72, float(sys.argv[3])) + 0.1 * np.cos(angle)
tests = tuple(lb.CircularTest(force, angle, reading) for force in (36.0, 389.0, 742.0))
sys.addaudithook(watch)
lb.write_campaign(lb.Campaign(tests, name=f"version {sys.argv[3]}"), Path(place) / "result", force=True)
print(count)
"""


def campaign(version: int) -> lb.Campaign:
    angle = np.arange(72) * 5.0
    tests = (lb.CircularTest(force, angle, np.full(72, float(version)) + 0.1 * np.cos(angle)) for force in (36.0, 389.0, 742.0))
    return lb.Campaign(tuple(tests), name=f"version {version}")


def version_of(folder: Path) -> int:
    """Which version stands there, whole; a mixture fails."""
    found = lb.read_campaign(folder)
    (version,) = {round(float(np.mean(test.reading_um))) for test in found.tests}
    assert found.name == f"version {version}"
    assert {path.name for path in folder.iterdir()} == {"campaign.toml", "f036.csv", "f389.csv", "f742.csv"}
    assert found.sha256 == campaign(version).sha256
    return version


def write_and_die(place: Path, moment: int, version: int) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", DIE_AT + WRITE, str(place), str(moment), str(version)], capture_output=True, text=True, check=False
    )


@pytest.mark.slow
def test_killed_at_ten_moments_of_writing(tmp_path: Path, rng: np.random.Generator) -> None:
    """Ten moments among all at which the disk is touched; then one run to the end, which leaves nothing behind."""
    lb.write_campaign(campaign(1), tmp_path / "result")
    whole = write_and_die(tmp_path, 0, 1)
    moments = int(whole.stdout)
    assert moments > 10
    seen = set()
    for k, moment in enumerate(sorted(rng.choice(np.arange(1, moments + 1), size=10, replace=False).tolist()), start=2):
        died = write_and_die(tmp_path, moment, k)
        assert died.returncode == 9, died.stderr
        check_target(tmp_path / "result", force=True, ours=files_of_campaign())
        seen.add(version_of(tmp_path / "result"))
    assert len(seen) > 1
    lb.write_campaign(campaign(99), tmp_path / "result", force=True)
    assert version_of(tmp_path / "result") == 99


def files_of_campaign() -> set[str]:
    return {"campaign.toml", "f036.csv", "f389.csv", "f742.csv"}


@pytest.mark.slow
def test_killed_at_every_moment_where_folders_cannot_be_exchanged(tmp_path: Path) -> None:
    """Two renames instead of one step: killed between them, the next command puts the old folder back."""
    lb.write_campaign(campaign(1), tmp_path / "result")
    without = DIE_AT + "import ldbb_bayes.files as files\nfiles._exchanged = lambda one, other: False\n" + WRITE
    total = int(
        subprocess.run(
            [sys.executable, "-c", without, str(tmp_path), "0", "1"], capture_output=True, text=True, check=True
        ).stdout
    )
    put_back = 0
    for moment in range(max(total - 12, 1), total + 1):
        subprocess.run([sys.executable, "-c", without, str(tmp_path), str(moment), "2"], capture_output=True, check=False)
        put_back += not (tmp_path / "result").exists()
        check_target(tmp_path / "result", force=True, ours=files_of_campaign())
        assert version_of(tmp_path / "result") in (1, 2)
    assert put_back >= 1


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
    posterior = lb.sample(lb.HybridModel.default(0), campaign(1), sampler="quadrature", seed=1)
    lb.save(posterior, tmp_path / "posterior.nc")
    before = (tmp_path / "posterior.nc").read_bytes()
    for largest in (0, 1000, len(before) // 2, len(before) - 1):
        with full_disk(largest), pytest.raises(lb.InputError, match=r"posterior\.nc must be writable, got: .*Free some space"):
            lb.save(posterior, tmp_path / "posterior.nc")
        assert (tmp_path / "posterior.nc").read_bytes() == before
        assert [path.name for path in tmp_path.iterdir()] == ["posterior.nc"]


@pytest.mark.slow
def test_disk_full_in_a_fit(tmp_path: Path) -> None:
    """At every size from the first block to the last file: exit code 2, one line that names no scratch folder, the old result."""
    lb.write_campaign(campaign(1), tmp_path / "campaign")
    fit = [
        sys.executable,
        "-m",
        "ldbb_bayes",
        "fit",
        str(tmp_path / "campaign"),
        "--degree",
        "0",
        "--out",
        str(tmp_path / "r"),
        "--quiet",
    ]
    subprocess.run(fit, check=True, capture_output=True)
    files_before = {path.name: path.read_bytes() for path in (tmp_path / "r").iterdir()}
    largest = max(map(len, files_before.values()))
    for size in (0, 1000, largest // 2, 9 * largest // 10):
        with full_disk(size):
            done = subprocess.run(
                [*fit, "--force", "--seed", "9"], check=False, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
            )
        assert done.returncode == 2, done.stderr
        assert len(done.stderr.strip().splitlines()) == 1
        assert "must be writable" in done.stderr
        assert "/.r-" not in done.stderr
        assert {path.name: path.read_bytes() for path in (tmp_path / "r").iterdir()} == files_before


@pytest.mark.parametrize("call", ["rename", "chmod"])
def test_permission_denied_keeps_the_old_result(call: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lb.write_campaign(campaign(1), tmp_path / "result")

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    owner = os if call == "rename" else Path
    monkeypatch.setattr(owner, call, refuse)
    with pytest.raises(lb.InputError, match="must be writable, got: Operation not permitted"):
        lb.write_campaign(campaign(2), tmp_path / "result", force=True)
    monkeypatch.undo()
    assert version_of(tmp_path / "result") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["result"]


def test_of_two_runs_into_one_new_folder_the_second_is_told(tmp_path: Path) -> None:
    """Without --force nobody's result is replaced, even if it came while this one was at work."""
    target = tmp_path / "result"
    mine = staged_folder(target, force=False)
    (mine.__enter__() / "mine").write_text("2")
    with staged_folder(target, force=False) as other:
        (other / "theirs").write_text("1")
    with pytest.raises(lb.InputError, match="another run wrote meanwhile"):
        mine.__exit__(None, None, None)
    assert [path.name for path in target.iterdir()] == ["theirs"]


@pytest.mark.slow
def test_runs_into_one_folder_at_once(tmp_path: Path) -> None:
    """Four processes replace one folder over and over: it is never gone, and in the end it is one of theirs, whole."""
    lb.write_campaign(campaign(1), tmp_path / "result")
    again = DIE_AT + WRITE.replace("sys.addaudithook(watch)\n", "").replace(
        "lb.write_campaign", "for _ in range(25): lb.write_campaign"
    )
    runs = [
        subprocess.Popen([sys.executable, "-c", again, str(tmp_path), "0", str(version)], stderr=subprocess.PIPE)
        for version in (2, 3, 4, 5)
    ]
    gone = 0
    while any(run.poll() is None for run in runs):
        gone += not (tmp_path / "result").is_dir()
        time.sleep(0.002)
    for run in runs:
        assert run.wait() == 0, run.stderr.read().decode() if run.stderr else ""
        if run.stderr:
            run.stderr.close()
    if sys.platform.startswith("linux"):
        assert gone == 0
    assert version_of(tmp_path / "result") in (2, 3, 4, 5)
    assert [path.name for path in tmp_path.iterdir()] == ["result"]


def test_exchange_is_one_step_on_linux(tmp_path: Path) -> None:
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        (tmp_path / name / name).touch()
    if not files._exchanged(tmp_path / "one", tmp_path / "other"):
        assert not sys.platform.startswith("linux")
        return
    assert (tmp_path / "one" / "other").exists()
    assert (tmp_path / "other" / "one").exists()


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


def test_what_killed_runs_left_goes_when_it_is_a_day_old(tmp_path: Path) -> None:
    """And nothing else: neither what is younger, nor of another name."""
    names = [".res-abcd1234", ".res-efgh5678", ".res-2-abcd1234", ".res-notes", "res-abcd1234"]
    for name in names:
        (tmp_path / name).mkdir()
        if name != ".res-efgh5678":
            os.utime(tmp_path / name, (1e9, 1e9))
    with staged_folder(tmp_path / "res", force=False) as staging:
        (staging / "a").write_text("a")
    assert {path.name for path in tmp_path.iterdir()} == {"res", *names} - {".res-abcd1234"}


def test_another_results_folder_is_not_put_back(tmp_path: Path) -> None:
    (tmp_path / ".res-2-abcd1234-old").mkdir()
    check_target(tmp_path / "res", force=False)
    assert not (tmp_path / "res").exists()
    (tmp_path / ".res-abcd1234-old").mkdir()
    with pytest.raises(lb.InputError, match="must not exist"):
        check_target(tmp_path / "res", force=False)
