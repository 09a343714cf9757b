"""Functions that write a folder with results either completely or not at all."""

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
    """Raise an `InputError` if a folder for results must not be replaced or cannot be written.

    Call this function before a long computation, to make sure that its results can be written. The
    folders that contain the target are created if they do not exist.

    Parameters
    ----------
    target
        Folder that is to be written.
    force
        Whether an existing folder may be replaced.
    ours
        Names of the files that this program writes. An existing folder is replaced only if it holds
        no other files.

    Raises
    ------
    InputError
        If the target exists and ``force`` is false; if it holds files that are not named in
        ``ours``; if it is a file, the working directory, or a folder that contains the working
        directory; or if it cannot be written.
    """
    _require_elsewhere(target)
    folder = target
    if target.is_symlink():
        # The temporary folder is made beside the folder that it replaces. If the target is a link,
        # the folder to which the link points is replaced.
        folder = target.resolve()
    with refuse_unwritable(target):
        is_file = False
        names: list[str] | None = None
        try:
            # The names of the files in an existing target folder are read only once. Another run of
            # the program could replace the folder before a second reading.
            names = os.listdir(target)
        except FileNotFoundError:
            pass
        except NotADirectoryError:
            is_file = target.exists()
        require(not is_file, f"{target} must be a folder, got a file. Choose another name.")
        require(
            names is None or force,
            f"{target} must not exist, got an existing one. Choose another name, or replace"
            " it: force=True (--force).",
        )
        for foreign in sorted(set(names or ()) - set(ours)):
            raise InputError(
                f"{target} must hold nothing but earlier results to be replaced, got {foreign!r}."
                " Move it away or choose another name."
            )
        folder.parent.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=folder.parent).cleanup()


def _require_elsewhere(target: Path) -> None:
    """Raise an `InputError` if the path ``target`` must not be a folder for results.

    The path must not be the working directory, a folder that contains the working directory, a link
    that leads to itself, or a name that is not valid in the file system.
    """
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
    """Provide a temporary folder that replaces ``target`` when the ``with`` block succeeds.

    The old folder remains until the new folder is complete. If writing fails, the old folder stays
    unchanged. If two runs of the program write the same folder, it holds the complete content from
    the run that finishes last. If ``target`` is a link, the folder to which it points is replaced.

    Parameters
    ----------
    target
        Folder that is to be written.
    force
        Whether an existing folder may be replaced.
    ours
        Names of the files that this program writes. An existing folder is replaced only if it holds
        no other files.

    Yields
    ------
    Path
        Path of the temporary folder, beside ``target``.
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
            _replace_folder(target, staging, force=force)
    except InputError as error:
        raise InputError(str(error).replace(str(staging), str(target))) from None
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _replace_folder(target: Path, staging: Path, *, force: bool) -> None:
    """Rename the folder ``staging`` to ``target``, and delete an existing folder ``target``.

    If ``target`` is an existing folder and ``force`` is false, an `InputError` is raised. If
    ``force`` is true, the old folder is renamed first. If another run of the program creates a
    folder ``target`` between the two renamings, both are repeated. If ``staging`` cannot be renamed
    for any other reason, the old folder gets its name back.
    """
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
            " name, or replace it: force=True (--force).",
        )
        shutil.rmtree(retired, ignore_errors=True)
        with suppress(FileNotFoundError):
            os.rename(target, retired)
    shutil.rmtree(retired, ignore_errors=True)


def _is_occupied(target: Path, error: OSError) -> bool:
    """Return whether a folder could not be renamed to ``target`` because ``target`` is a folder."""
    if error.errno in (errno.ENOTEMPTY, errno.EEXIST):
        return not target.is_file()
    return error.errno == errno.EACCES and target.is_dir()
