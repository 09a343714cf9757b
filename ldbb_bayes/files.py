"""Writing a file or a folder whole or not at all, whatever happens meanwhile."""

from __future__ import annotations

import ctypes
import errno
import os
import re
import secrets
import shutil
import sys
import tempfile
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ldbb_bayes.errors import InputError

__all__ = ["LARGEST_TABLE_BYTES", "bytes_of", "check_target", "staged_folder", "write_whole"]

LARGEST_TABLE_BYTES = 64 * 2**20
_RETIRED = "-old"
_DAY_S = 86_400.0
_AT_FDCWD, _RENAME_EXCHANGE = -100, 2


def bytes_of(path: Path, largest: int, *, what: str) -> bytes:
    """The content of a file of sensible size; no device, pipe or folder.

    Raises
    ------
    InputError
        Naming the file and the cure.
    """
    try:
        if not path.is_file():
            got = "a folder" if path.is_dir() else "no ordinary file" if path.exists() else "nothing"
            cure = f"Name the files in it: {path}/*" if path.is_dir() else "Check the path"
            raise InputError(f"{path} must be {what}, got {got}. {cure}.")
        with path.open("rb") as file:
            raw = file.read(largest + 1)
    except OSError as error:
        raise InputError(f"{path} must be a readable file, got: {error.strerror}. Check the name and the permissions.") from None
    if len(raw) > largest:
        size = f"{largest / 2**20:.0f} MB" if largest >= 2**20 else f"{largest / 2**10:.0f} kB"
        raise InputError(f"{path} must be at most {size}, got more. Remove what does not belong there, or split it.")
    return raw


def write_whole(target: Path, content: bytes) -> None:
    """Write a file in one step; of two that write the same one the later wins whole.

    Raises
    ------
    InputError
        When it cannot be written; what was there before then stands.
    """
    staging = target.with_name(f".{target.name}-{secrets.token_hex(4)}.part")
    try:
        try:
            with staging.open("xb") as file:
                file.write(content)
                file.flush()
                _to_disk(file.fileno())
            os.replace(staging, target)
        finally:
            staging.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(
            f"{target} must be writable, got: {error.strerror or error}. Free some space or choose another place."
        ) from None


def check_target(target: Path, *, force: bool, ours: Collection[str] = ()) -> None:
    """Refuse a target that must not be replaced or cannot be written, before any work is done.

    What a run that was killed between two renames left behind is put back first.

    Parameters
    ----------
    force : bool
        Whether an existing folder may be replaced.
    ours : collection of str
        Names that may be lost with the old folder; anything else in it is somebody's and is kept.

    Raises
    ------
    InputError
    """
    _put_back(target)
    if target.exists() and not force:
        raise InputError(f"{target} must not exist, got an existing one. Choose another name or pass --force.")
    if target.exists() and not target.is_dir():
        raise InputError(f"{target} must be a folder, got a file. Choose another name.")
    here = Path.cwd()
    if _resolved(target) in (here, *here.parents):
        raise InputError(f"{target} must not be the folder you stand in, or one above it. Choose another name.")
    foreign = sorted(entry.name for entry in target.iterdir() if entry.name not in ours) if target.exists() else []
    if foreign:
        raise InputError(
            f"{target} must hold nothing but earlier results to be replaced, got {foreign[0]!r}. "
            "Move it away or choose another name."
        )
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{target.name}-", dir=target.parent):
            pass
    except OSError as error:
        raise InputError(f"{target} must be writable, got: {error.strerror}. Choose another place.") from None


@contextmanager
def staged_folder(target: Path, *, force: bool, ours: Collection[str] = ()) -> Iterator[Path]:
    """A scratch folder beside ``target`` that takes its place when the block ends well.

    The old folder is there until the new one is: the two are exchanged in one step where the system can (Linux), else by two
    renames, of which `check_target` mends the first alone. Of two runs into one folder the later wins whole. A link stays; what
    it points to is replaced.

    Raises
    ------
    InputError
        As `check_target`, or when writing fails; the old target then stands untouched.
    """
    target = _resolved(target) if target.is_symlink() else target
    check_target(target, force=force, ours=ours)
    _clear(target)
    staging = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    try:
        yield staging
        staging.chmod(0o755)
        _sync(staging)
        _take_place(staging, target, force=force)
    except InputError as error:
        raise InputError(str(error).replace(str(staging), str(target))) from None
    except OSError as error:
        raise InputError(
            f"{target} must be writable, got: {error.strerror or error}. Free some space or choose another place."
        ) from None
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _take_place(staging: Path, target: Path, *, force: bool) -> None:
    """Make ``staging`` the target; what was the target is then ``staging``, or gone."""
    try:
        os.rename(staging, target)
        return
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST, errno.EACCES) or not target.is_dir():
            raise
    if not force:
        raise InputError(
            f"{target} must not exist, got one that another run wrote meanwhile. Choose another name or pass --force."
        )
    if _exchanged(staging, target):
        return
    retired = staging.with_name(staging.name + _RETIRED)
    target.rename(retired)
    try:
        staging.rename(target)
    except OSError:
        retired.rename(target)
        raise
    shutil.rmtree(retired, ignore_errors=True)


def _exchanged(one: Path, other: Path) -> bool:
    """Whether the system exchanged the two names in one step."""
    if not sys.platform.startswith("linux"):
        return False
    try:
        rename = ctypes.CDLL(None, use_errno=True).renameat2
    except (OSError, AttributeError):
        return False
    return rename(_AT_FDCWD, os.fsencode(one), _AT_FDCWD, os.fsencode(other), _RENAME_EXCHANGE) == 0


def _put_back(target: Path) -> None:
    """Give the target its name again if a run was killed after taking it and before giving it to the new one."""
    if target.exists() or not target.parent.is_dir():
        return
    left = sorted(_scratch(target, _RETIRED), key=lambda path: path.stat().st_mtime)
    if left:
        left[-1].rename(target)


def _clear(target: Path) -> None:
    """Remove what killed runs left beside the target, once it is a day old: no run writes for so long."""
    for path in _scratch(target):
        with suppress(OSError):
            if time.time() - path.stat().st_mtime > _DAY_S:
                shutil.rmtree(path)


def _scratch(target: Path, end: str = "") -> list[Path]:
    """Folders that `staged_folder` made for a target, which `tempfile` names by eight signs."""
    own = re.compile(rf"\.{re.escape(target.name)}-[a-z0-9_]{{8}}{end}")
    return [path for path in target.parent.iterdir() if own.fullmatch(path.name) and path.is_dir() and not path.is_symlink()]


def _resolved(path: Path) -> Path:
    """Links followed.

    Raises
    ------
    InputError
        For links that lead to themselves.
    """
    try:
        with suppress(FileNotFoundError, NotADirectoryError, PermissionError):
            path.stat()
        return path.resolve()
    except (OSError, RuntimeError, ValueError):
        raise InputError(f"{path} must be a name of a file or folder, got one that leads nowhere. Check the link.") from None


def _sync(folder: Path) -> None:
    """Have everything on the disk before the name changes."""
    for path in [*folder.rglob("*"), folder]:
        if path.is_symlink() or not (path.is_file() or path.is_dir()):
            continue
        try:
            handle = os.open(path, os.O_RDONLY)
        except OSError:
            continue
        try:
            _to_disk(handle)
        finally:
            os.close(handle)


def _to_disk(handle: int) -> None:
    """Where the system can; some mounts cannot, and say so by EINVAL and the like."""
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EIO):
            raise
