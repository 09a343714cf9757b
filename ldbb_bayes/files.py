"""Writing a folder whole or not at all."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ldbb_bayes.errors import InputError

__all__ = ["check_target", "staged_folder"]


def check_target(target: Path, *, force: bool) -> None:
    """Refuse an existing target unless ``force``, and a place that cannot be written, before any work is done.

    Raises
    ------
    InputError
    """
    if target.exists() and not force:
        raise InputError(f"{target} must not exist, got an existing one. Choose another name or pass --force.")
    if target.exists() and not target.is_dir():
        raise InputError(f"{target} must be a folder, got a file. Choose another name.")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{target.name}-", dir=target.parent):
            pass
    except OSError as error:
        raise InputError(f"{target} must be writable, got: {error.strerror}. Choose another place.") from None


@contextmanager
def staged_folder(target: Path, *, force: bool) -> Iterator[Path]:
    """A scratch folder beside ``target`` that takes its place when the block ends well.

    Raises
    ------
    InputError
        When the target exists and ``force`` is false, or writing fails; the old target then stands untouched.
    """
    check_target(target, force=force)
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
