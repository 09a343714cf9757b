"""A file written whole or not at all, also by two at once."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from ldbb_bayes.errors import InputError
from ldbb_bayes.files import write_whole


def test_two_that_write_the_same_file_do_not_fight(tmp_path: Path) -> None:
    """As two workers do that were given one job; both have the same to write, and neither may take the other's scratch."""
    content = os.urandom(20_000)
    with ThreadPoolExecutor(8) as threads:
        list(threads.map(lambda _: write_whole(tmp_path / "p.nc", content), range(200)))
    assert [own.name for own in tmp_path.iterdir()] == ["p.nc"]
    assert (tmp_path / "p.nc").read_bytes() == content


def test_a_mount_that_cannot_sync_is_no_error_and_a_full_one_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "p").write_bytes(b"before")
    for code, expected in ((22, b"new"), (28, b"new")):

        def refused(_: int, code: int = code) -> None:
            raise OSError(code, os.strerror(code))

        monkeypatch.setattr(os, "fsync", refused)
        if code == 28:
            with pytest.raises(InputError, match="p must be writable, got: No space left on device"):
                write_whole(tmp_path / "p", b"newer")
        else:
            write_whole(tmp_path / "p", b"new")
        assert (tmp_path / "p").read_bytes() == expected
        assert [own.name for own in tmp_path.iterdir()] == ["p"]
