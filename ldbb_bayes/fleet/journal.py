"""Rows of a batch on disk as they come: one line each, with its digest, only ever appended to.

    <digest> <index> <status> <the row as JSON>

A line that a killed run has torn is dropped; a damaged one counts as never written. The last line of an index is the one that
holds, so that what is done again replaces what was there only once it is there itself. A line of status void says that damage
before it is known, and that rows before it that failed do not hold: the damaged line may have been what replaced them.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import time
from array import array
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

from ldbb_bayes.errors import InputError

__all__ = ["JOURNAL_FILES", "Journal"]

JOURNAL_FILES = _NAME, _STALE = "rows.jsonl", "stale"
_DIGEST, _DIGITS = 8, 16
_LONGEST_LINE = 2**26
_SYNC_S = 1.0
_VOID = "void"
_STATES: dict[str, Literal[0, 1, 2]] = {_VOID: 0, "done": 1, "failed": 2}


class Journal:
    """The finished rows of a batch. In memory there are 9 bytes a campaign, whatever the rows hold.

    Parameters
    ----------
    folder : path
        Made if need be.
    campaigns : int
    key : str
        Digest of what the batch is: a line of another batch counts as damaged.

    Attributes
    ----------
    damaged : int
        Lines that were dropped on opening, a torn last one and those known before aside. Rows that failed then count as lacking.
    torn : bool
        Whether there was one.

    Raises
    ------
    InputError
        When the folder cannot be used.
    """

    def __init__(self, folder: str | os.PathLike[str], campaigns: int, key: str) -> None:
        self.folder, self._key = Path(folder), hashlib.blake2b(key.encode()).digest()
        self.path = self.folder / _NAME
        self._offsets = array("q", [-1]) * campaigns
        self._states = bytearray(campaigns)
        self._failed = 0
        self.damaged, self.torn = 0, False
        self._synced, self._end = time.monotonic(), 0
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self.path.touch()
            self._file = self.path.open("r+b", buffering=0)
            self._scan()
            if self.damaged:
                self._write(f"0 {_VOID} {{}}".encode())
                self._void()
        except OSError as error:
            raise self._unusable(error) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def __len__(self) -> int:
        """Campaigns that have a row."""
        return len(self._states) - self._states.count(0)

    @property
    def failed(self) -> int:
        """Campaigns whose row says that they failed."""
        return self._failed

    def lacks(self, index: int, *, retry: bool = False) -> bool:
        """Whether a campaign has no row; with ``retry`` also whether it failed."""
        return self._states[index] == 0 or (retry and self._states[index] == 2)

    def append(self, index: int, row: dict[str, Any]) -> None:
        """Keep a row for good.

        Raises
        ------
        InputError
            When it cannot be written; the rows before are sound.
        """
        body = f"{index} {row['status']} {json.dumps(_finite(row), ensure_ascii=True, allow_nan=False)}".encode()
        before = self._end
        self._write(body)
        self._put(index, _STATES[row["status"]], before)
        if time.monotonic() - self._synced > _SYNC_S:
            self.sync()

    def _write(self, body: bytes) -> None:
        line = memoryview(self._digest(body) + b" " + body + b"\n")
        try:
            self._file.seek(self._end)
            while line:
                line = line[self._file.write(line) :]
        except OSError as error:
            self._cut()
            raise self._unusable(error) from None
        self._end = self._file.tell()

    def read(self, index: int) -> dict[str, Any]:
        """The row of a campaign that has one.

        Raises
        ------
        InputError
            When the file was changed meanwhile.
        """
        try:
            self._file.seek(self._offsets[index])
            line = self._line()
        except OSError as error:
            raise self._unusable(error) from None
        if self._parsed(line) is None:
            raise InputError(f"{self.path} must stay as it was written, got another line for row {index}. Run with --resume.")
        row: dict[str, Any] = json.loads(line.split(b" ", 3)[3])
        return row

    def sync(self) -> None:
        """Have everything on the disk."""
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # some mounts cannot
                raise self._unusable(error) from None
        self._synced = time.monotonic()

    def close(self) -> None:
        """Have everything on the disk, and let go."""
        if not self._file.closed:
            try:
                self.sync()
            finally:
                self._file.close()

    @property
    def stale(self) -> bool:
        """Whether rows came after the dataset was written."""
        return (self.folder / _STALE).exists()

    @stale.setter
    def stale(self, value: bool) -> None:
        mark = self.folder / _STALE
        try:
            if value:
                mark.touch()
            else:
                mark.unlink(missing_ok=True)
        except OSError as error:
            raise self._unusable(error) from None

    def _scan(self) -> None:
        """Find the last sound line of every index, and cut off a torn end."""
        with self.path.open("rb") as file:
            while line := file.readline(_LONGEST_LINE):
                found = self._parsed(line)
                if found is not None and found[1]:
                    self._put(*found, self._end)
                elif found is not None:
                    self._void()
                    self.damaged = 0
                elif line.endswith(b"\n"):
                    self.damaged += 1
                else:
                    # No end within what a row can be: the file's end, or a damaged stretch to be passed over.
                    while line and not line.endswith(b"\n"):
                        line = file.readline(_LONGEST_LINE)
                    if not line:
                        self.torn = True
                        break
                    self.damaged += 1
                self._end = file.tell()
        self._cut()

    def _put(self, index: int, state: int, offset: int) -> None:
        self._failed += (state == 2) - (self._states[index] == 2)
        self._states[index], self._offsets[index] = state, offset

    def _void(self) -> None:
        self._states, self._failed = self._states.replace(b"\2", b"\0"), 0

    def _parsed(self, line: bytes) -> tuple[int, int] | None:
        """Index and state of a sound line."""
        if not line.endswith(b"\n") or line[:_DIGITS] != self._digest(line[_DIGITS + 1 : -1]):
            return None
        _, index, status, _ = line.split(b" ", 3)
        place = int(index)
        return (place, _STATES[status.decode()]) if place < len(self._states) else None

    def _digest(self, body: bytes) -> bytes:
        return hashlib.blake2b(body, key=self._key, digest_size=_DIGEST).hexdigest().encode()

    def _line(self) -> bytes:
        """The line at the file's place; unbuffered files read single bytes by themselves."""
        parts = []
        while part := self._file.read(1 << 16):
            head, found, _ = part.partition(b"\n")
            parts.append(head + found)
            if found:
                break
        return b"".join(parts)

    def _cut(self) -> None:
        try:
            self._file.truncate(self._end)
        except OSError as error:
            raise self._unusable(error) from None

    def _unusable(self, error: OSError) -> InputError:
        return InputError(
            f"{self.path} must be writable, got: {error.strerror or error}. What is in it is kept: "
            "free some space or mend the place, then go on with --resume."
        )


def _finite(value: Any) -> Any:
    """Numbers that are none become null."""
    if isinstance(value, dict):
        return {name: _finite(own) for name, own in value.items()}
    if isinstance(value, list):
        return [_finite(own) for own in value]
    return None if isinstance(value, float) and value - value != 0.0 else value
