"""Folders that are written whole or not at all, whatever happens meanwhile."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ldbb_bayes.errors import InputError, require
from ldbb_bayes.files.content import refuse_unwritable

__all__ = ["check_target", "staged_folder"]


def check_target(target: Path, *, force: bool, ours: Collection[str] = ()) -> None:
    """Raise an `InputError` for a target that must not be replaced or cannot be written.

    This is meant to happen before any work is done.

    Parameters
    ----------
    target
        Folder that is to be written.
    force
        Whether an existing folder may be replaced.
    ours
        The only names that a folder to be replaced may hold.

    Raises
    ------
    InputError
        For a target that exists without ``force``, holds other names, is a file or the working
        directory, or cannot be written.
    """
    _require_elsewhere(target)
    with refuse_unwritable(target):
        is_file = False
        names: list[str] | None = None
        try:
            names = os.listdir(target)  # once: another run may be replacing the folder
        except FileNotFoundError:
            pass
        except NotADirectoryError:
            is_file = target.exists()
        is_free = names is None and not is_file
        require(
            is_free or force,
            f"{target} must not exist, got an existing one. Choose another name or pass --force.",
        )
        require(not is_file, f"{target} must be a folder, got a file. Choose another name.")
        for foreign in sorted(set(names or ()) - set(ours)):
            raise InputError(
                f"{target} must hold nothing but earlier results to be replaced, got {foreign!r}."
                " Move it away or choose another name."
            )
        target.parent.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryDirectory(prefix=f".{target.name}-", dir=target.parent).cleanup()


def _require_elsewhere(target: Path) -> None:
    """Refuse the working directory, the folders above it, and links that lead nowhere."""
    try:
        with suppress(FileNotFoundError, NotADirectoryError, PermissionError):
            target.stat()
        holds_working_directory = target.resolve() in (Path.cwd(), *Path.cwd().parents)
    except (OSError, RuntimeError, ValueError):
        raise InputError(
            f"{target} must be a name of a folder, got one that leads nowhere. Check the link."
        ) from None
    require(
        not holds_working_directory,
        f"{target} must not be the folder you stand in, or one above it. Choose another name.",
    )


@contextmanager
def staged_folder(target: Path, *, force: bool, ours: Collection[str] = ()) -> Iterator[Path]:
    """Give a scratch folder beside ``target`` that takes its place when the block ends well.

    The old folder is there until the new one is whole; then the old one is renamed, and the new
    one. Of two runs into one folder the later wins whole. A link stays; what it points to is
    replaced. Where writing fails the old target stands untouched.
    """
    check_target(target, force=force, ours=ours)
    if target.is_symlink():
        target = target.resolve()
    with refuse_unwritable(target):
        staging = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    try:
        with refuse_unwritable(target):
            yield staging
            staging.chmod(0o755)
            _take_place(staging, target, force=force)
    except InputError as error:
        raise InputError(str(error).replace(str(staging), str(target))) from None
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _take_place(staging: Path, target: Path, *, force: bool) -> None:
    """Make ``staging`` the target, also where another run does the same at the same time."""
    retired = staging.with_name(f"{staging.name}-old")
    while True:
        try:
            os.rename(staging, target)
            break
        except OSError as error:
            if not _is_occupied(target, error):
                if retired.is_dir() and not target.exists():
                    os.rename(retired, target)
                raise
        require(
            force,
            f"{target} must not exist, got one that another run wrote meanwhile. Choose another"
            " name or pass --force.",
        )
        shutil.rmtree(retired, ignore_errors=True)
        with suppress(FileNotFoundError):
            os.rename(target, retired)
    shutil.rmtree(retired, ignore_errors=True)


def _is_occupied(target: Path, error: OSError) -> bool:
    """Return whether renaming failed because a folder is there."""
    if error.errno in (errno.ENOTEMPTY, errno.EEXIST):
        return not target.is_file()
    return error.errno == errno.EACCES and target.is_dir()
