"""Writing a folder whole or not at all."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

from ldbb_bayes.errors import InputError

__all__ = ["check_target", "staged_folder"]


def check_target(target: Path, *, force: bool, ours: Collection[str] = ()) -> None:
    """Refuse a target that must not be replaced or cannot be written, before any work is done.

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
    if target.exists() and not force:
        raise InputError(f"{target} must not exist, got an existing one. Choose another name or pass --force.")
    if target.exists() and not target.is_dir():
        raise InputError(f"{target} must be a folder, got a file. Choose another name.")
    here = Path.cwd()
    if target.resolve() in (here, *here.parents):
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

    Raises
    ------
    InputError
        As `check_target`, or when writing fails; the old target then stands untouched.
    """
    check_target(target, force=force, ours=ours)
    staging = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    try:
        yield staging
        staging.chmod(0o755)
        if target.exists():
            retired = staging.with_name(staging.name + "-old")
            target.rename(retired)
            staging.rename(target)
            shutil.rmtree(retired)
        else:
            staging.rename(target)
    except OSError as error:
        raise InputError(
            f"{target} must be writable, got: {error.strerror or error}. Free some space or choose another place."
        ) from None
    finally:
        shutil.rmtree(staging, ignore_errors=True)
