"""The journal: what is in it stays, what is torn or damaged is as if it never was, and memory does not grow with rows."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.journal import Journal


def row(index: int, **fields: object) -> dict[str, Any]:
    return {"campaign": f"c{index}", "status": "done", "rmse_um": 0.1 * index, **fields}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with Journal(tmp_path / "j", 4, "key") as journal:
        for index in (2, 0, 1):
            journal.append(index, row(index))
    return tmp_path / "j"


def test_rows_come_back_in_any_order(folder: Path) -> None:
    with Journal(folder, 4, "key") as journal:
        assert (len(journal), journal.failed, journal.damaged, journal.torn) == (3, 0, 0, False)
        assert [journal.read(index) for index in range(3)] == [row(0), row(1), row(2)]
        assert [journal.lacks(index) for index in range(4)] == [False, False, False, True]


def test_numbers_survive_to_the_last_bit_and_none_is_null(tmp_path: Path) -> None:
    with Journal(tmp_path, 1, "key") as journal:
        journal.append(0, row(0, a=0.1 + 0.2, b=float("nan"), c=[1e-310, float("inf")], d="µ\u2028\n"))
        assert journal.read(0) == row(0, a=0.1 + 0.2, b=None, c=[1e-310, None], d="µ\u2028\n")


@pytest.mark.parametrize("left", [1, 20, 60])
def test_a_torn_end_is_dropped_and_written_over(folder: Path, left: int) -> None:
    path = folder / "rows.jsonl"
    whole = path.read_bytes()
    last = whole.rstrip(b"\n").rindex(b"\n") + 1
    path.write_bytes(whole[: last + left])
    with Journal(folder, 4, "key") as journal:
        assert (len(journal), journal.damaged, journal.torn) == (2, 0, True)
        assert journal.lacks(1)
        journal.append(1, row(1))
    assert path.read_bytes() == whole


@pytest.mark.parametrize("place", [3, 18, 25, 40])
def test_a_damaged_line_counts_as_never_written(folder: Path, place: int) -> None:
    path = folder / "rows.jsonl"
    raw = bytearray(path.read_bytes())
    raw[place] ^= 1
    path.write_bytes(raw)
    with Journal(folder, 4, "key") as journal:
        assert (len(journal), journal.damaged) == (2, 1)
        assert journal.lacks(2)
        journal.append(2, row(2))
    with Journal(folder, 4, "key") as journal:
        assert [journal.read(index)["campaign"] for index in range(3)] == ["c0", "c1", "c2"]


def test_a_stretch_without_lines_is_passed_over(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = folder / "rows.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(lines[0] + bytes(5000) + b"\n" + lines[1] + lines[2] + bytes(5000))
    monkeypatch.setattr("ldbb_bayes.fleet.journal._LONGEST_LINE", 1024)
    with Journal(folder, 4, "key") as journal:
        assert (len(journal), journal.damaged, journal.torn) == (3, 1, True)
    assert path.read_bytes().splitlines(keepends=True)[-2] == lines[2]
    assert path.read_bytes().endswith(b" 0 void {}\n")


def test_lines_of_another_batch_are_damaged(folder: Path) -> None:
    with Journal(folder, 4, "another") as journal:
        assert (len(journal), journal.damaged) == (0, 3)
    with Journal(folder, 4, "key") as journal:
        assert (len(journal), journal.damaged) == (3, 1)
    with Journal(folder, 1, "key") as journal:
        assert (len(journal), journal.damaged) == (1, 0)


def test_damage_voids_failures_before_it_and_is_told_once(tmp_path: Path) -> None:
    """The damaged line may have been the one that replaced a failure; the failures after are known."""
    with Journal(tmp_path, 3, "key") as journal:
        journal.append(0, row(0, status="failed", reason="why"))
        journal.append(1, row(1))
        journal.append(0, row(0))
    path = tmp_path / "rows.jsonl"
    raw = bytearray(path.read_bytes())
    raw[-5] ^= 1
    path.write_bytes(raw)
    with Journal(tmp_path, 3, "key") as journal:
        assert (journal.damaged, journal.failed, [journal.lacks(k) for k in range(3)]) == (1, 0, [True, False, True])
    with Journal(tmp_path, 3, "key") as journal:
        assert (journal.damaged, journal.failed, journal.lacks(0)) == (0, 0, True)
        journal.append(0, row(0, status="failed", reason="again"))
        journal.append(2, row(2, status="failed", reason="too"))
        assert journal.failed == 2
    with Journal(tmp_path, 3, "key") as journal:
        assert (journal.damaged, journal.failed, len(journal)) == (0, 2, 3)
        assert journal.read(0)["reason"] == "again"


def test_a_mount_that_cannot_sync_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(_: int) -> None:
        raise OSError(22, "Invalid argument")

    monkeypatch.setattr(os, "fsync", refused)
    with Journal(tmp_path, 1, "key") as journal:
        journal.append(0, row(0))


def test_a_failed_row_stays_until_it_is_replaced(tmp_path: Path) -> None:
    with Journal(tmp_path, 2, "key") as journal:
        journal.append(0, row(0, status="failed", reason="why"))
        assert not journal.lacks(0)
        assert journal.lacks(0, retry=True)
        assert journal.read(0)["reason"] == "why"
        journal.append(0, row(0))
        assert not journal.lacks(0, retry=True)
    with Journal(tmp_path, 2, "key") as journal:
        assert journal.read(0) == row(0)
        assert journal.failed == 0


def test_a_full_disk_leaves_the_rows_before(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Full:
        """Takes 30 bytes, then no more."""

        def __init__(self, file: Any) -> None:
            self.file, self.room = file, 30

        def __getattr__(self, name: str) -> Any:
            return getattr(self.file, name)

        def write(self, part: Any) -> int:
            if not self.room:
                raise OSError(28, "No space left on device")
            wrote: int = self.file.write(part[: self.room])
            self.room -= wrote
            return wrote

    before = (folder / "rows.jsonl").read_bytes()
    with Journal(folder, 4, "key") as journal:
        monkeypatch.setattr(journal, "_file", Full(journal._file))
        with pytest.raises(InputError, match=r"rows.jsonl must be writable, got: No space left on device.*--resume"):
            journal.append(3, row(3))
        assert journal.lacks(3)
    assert (folder / "rows.jsonl").read_bytes() == before


def test_what_was_changed_meanwhile_is_not_believed(folder: Path) -> None:
    with Journal(folder, 4, "key") as journal:
        with (folder / "rows.jsonl").open("r+b") as file:
            file.seek(30)
            file.write(b"x")
        with pytest.raises(InputError, match="must stay as it was written, got another line for row 2"):
            journal.read(2)


def test_everything_is_on_the_disk_at_the_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[int] = []
    real = os.fsync
    monkeypatch.setattr(os, "fsync", lambda handle: (synced.append(1), real(handle))[1])
    with Journal(tmp_path, 3, "key") as journal:
        journal.append(0, row(0))
        assert len(synced) == 0
        monkeypatch.setattr("ldbb_bayes.fleet.journal._SYNC_S", 0.0)
        journal.append(1, row(1))
        assert len(synced) == 1
    assert len(synced) == 2


def test_a_file_in_its_place_is_refused(tmp_path: Path) -> None:
    (tmp_path / "j").write_text("x")
    with pytest.raises(InputError, match="must be writable"):
        Journal(tmp_path / "j", 1, "key")
