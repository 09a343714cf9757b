"""Reading of files up to a size limit, and writing of files completely or not at all."""

from __future__ import annotations

import errno
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ldbb_bayes.errors import InputError, require
from ldbb_bayes.files.similar_names import advice_on_path

__all__ = ["LARGEST_TABLE_BYTES", "bytes_of", "refuse_unwritable", "write_whole"]

# Largest size of a file with readings [bytes], enough for a million lines of sixty characters.
LARGEST_TABLE_BYTES = 64 * 2**20
# Numbers of the operating-system errors for a full disk, for a user's quota that is used up, and
# for a file that is too large for the system.
_OUT_OF_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def bytes_of(path: Path, largest: int, *, what: str) -> bytes:
    """Return the content of a file as bytes; raise an `InputError` if the file is too large.

    Parameters
    ----------
    path
        Path of the file.
    largest
        Largest size of the file [bytes].
    what
        Kind of file that is expected, for the error message, such as "a readable TOML file".

    Returns
    -------
    bytes
        Content of the file.

    Raises
    ------
    InputError
        For a device, pipe or folder, and for a file that cannot be read or is too large.
    """
    try:
        _require_ordinary_file(path, what)
        with path.open("rb") as file:
            content = file.read(largest + 1)
    except OSError as error:
        raise InputError(
            f"{path} must be a readable file, got: {error.strerror}. Check the name and the"
            " permissions."
        ) from None
    require(
        len(content) <= largest,
        f"{path} must be at most {largest / 2**20:g} MB, got more. Remove what does not belong"
        " there, or split it.",
    )
    return content


def _require_ordinary_file(path: Path, expected: str) -> None:
    """Raise an `InputError` unless a path leads to an ordinary file, not a folder or device.

    ``expected`` is the kind of file that is expected, for the message.
    """
    if path.is_file():
        return
    if path.is_dir():
        raise InputError(
            f"{path} must be {expected}, got a folder. Name the files in it: {path}/*."
        )
    if path.exists():
        raise InputError(f"{path} must be {expected}, got no ordinary file. Check the path.")
    raise InputError(f"{path} must be {expected}, found none. {advice_on_path(path)}")


@contextmanager
def refuse_unwritable(target: Path) -> Iterator[None]:
    """Raise an `InputError` if the ``with`` block fails to write the file or folder ``target``.

    The `InputError`, whose message names ``target``, replaces the ``OSError`` that the ``with``
    block raises.
    """
    try:
        yield
    except OSError as error:
        advice = "Choose another place."
        if error.errno in _OUT_OF_SPACE:
            advice = "Free some space or choose another place."
        raise InputError(
            f"{target} must be writable, got: {error.strerror or error}. {advice}"
        ) from None


def write_whole(target: Path, content: bytes) -> None:
    """Write ``content`` to the file ``target``, completely or not at all.

    If writing fails, an existing file stays unchanged, and an `InputError` that names the file is
    raised. If two runs of the program write the same file at the same time, the file holds the
    complete content from the run that finishes last.
    """
    staging = target.with_name(f".{target.name}-{secrets.token_hex(4)}.part")
    with refuse_unwritable(target):
        try:
            staging.write_bytes(content)
            os.replace(staging, target)
        finally:
            staging.unlink(missing_ok=True)
