"""One run at a time in a folder: by a lock of the system, or where it has none by a file that says who is at work."""

from __future__ import annotations

import errno
import json
import os
import secrets
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

from ldbb_bayes.errors import InputError
from ldbb_bayes.files import bytes_of

__all__ = ["HOLD_FILES", "alone_in"]

_LOCK, _RUNNING = ".lock", ".running"
HOLD_FILES = (_LOCK, _RUNNING)
_NO_LOCKS = {errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOTSUP, errno.EINVAL}
_LARGEST = 2**12
# Files of this process: their number says nothing of whether it is still at work.
_mine: set[Path] = set()


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Keep other runs from a folder while the block lasts.

    Raises
    ------
    InputError
        When another run is at work there.
    OSError
        When nothing can be written there.
    """
    handle = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        if _locked(handle, folder):
            yield
        else:
            with _named(folder):
                yield
    finally:
        os.close(handle)


def _locked(handle: int, folder: Path) -> bool:
    """Until the handle is closed or its process ends; False where the system or the mount has no locks."""
    if fcntl is None:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise InputError(
            f"{folder} must not be in use, got another run at work there. Wait for it, or choose another --out."
        ) from None
    except OSError as error:
        if error.errno in _NO_LOCKS:
            return False
        raise
    return True


@contextmanager
def _named(folder: Path) -> Iterator[None]:
    """A file that is there while the block lasts. One that a run left which was killed here is taken away first."""
    path = (folder / _RUNNING).resolve()
    own = json.dumps({"host": socket.gethostname(), "process": os.getpid()}).encode()
    try:
        _make(path, own)
    except FileExistsError:
        _take_away(path)
        try:
            _make(path, own)
        except FileExistsError:
            raise _in_use(path, "another run") from None
    _mine.add(path)
    try:
        yield
    finally:
        _mine.discard(path)
        with suppress(OSError):
            path.unlink()


def _make(path: Path, content: bytes) -> None:
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
    try:
        os.write(handle, content)
    finally:
        os.close(handle)


def _take_away(path: Path) -> None:
    """Under another name first: what another run made meanwhile is put back."""
    before = bytes_of(path, _LARGEST, what="the mark of a run")
    try:
        said = json.loads(before)
        host, process = str(said["host"]), int(said["process"])
    except (ValueError, KeyError, TypeError):
        raise _in_use(path, "a mark that does not say whose") from None
    if path in _mine or host != socket.gethostname() or (process != os.getpid() and _alive(process)):
        raise _in_use(path, f"process {process} on {host}")
    aside = path.with_name(f"{path.name}-{secrets.token_hex(4)}")
    os.rename(path, aside)
    if aside.read_bytes() != before:
        os.rename(aside, path)
        raise _in_use(path, "another run")
    aside.unlink()


def _alive(process: int) -> bool:
    if sys.platform == "win32":
        import ctypes

        handle = ctypes.windll.kernel32.OpenProcess(0x1000, False, process)  # to ask, nothing else
        if handle:
            ctypes.windll.kernel32.CloseHandle(handle)
        return bool(handle)
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


def _in_use(path: Path, who: str) -> InputError:
    return InputError(
        f"{path.parent} must not be in use, got {who} at work there. Wait for it, or choose another --out; if it has ended, "
        f"remove {path}."
    )
