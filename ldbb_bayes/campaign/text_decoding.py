"""Decoding of text files that hold a table: their bytes, their encoding, and what is no text."""

from __future__ import annotations

import re
from pathlib import Path

from ldbb_bayes.errors import InputError, require
from ldbb_bayes.files import LARGEST_TABLE_BYTES, bytes_of

__all__ = [
    "ARCHIVE_SIGNATURE",
    "BYTE_ORDER_MARKS",
    "COMPOUND_SIGNATURE",
    "EmptyFileError",
    "decode_text",
    "table_bytes",
]

# Byte-order mark with which a text file may begin, for each encoding.
BYTE_ORDER_MARKS = {
    "utf-8": b"\xef\xbb\xbf",
    "utf-16-le": b"\xff\xfe",
    "utf-16-be": b"\xfe\xff",
}
# First bytes of a file that is a zip archive; workbooks in the formats XLSX and ODS are such
# archives.
ARCHIVE_SIGNATURE = b"PK\x03\x04"
# First bytes of a file in Microsoft's compound file format, the format of XLS workbooks and of
# workbooks with a password.
COMPOUND_SIGNATURE = b"\xd0\xcf\x11\xe0"
# Character (Ctrl-Z) with which old text files end; it is removed when a text table is read.
_CONTROL_Z = b"\x1a"


class EmptyFileError(InputError):
    """Error for a text table whose file is empty or contains only blanks."""


def table_bytes(path: Path) -> bytes:
    """Return the bytes of a file that holds a table.

    Raise an `InputError` if the file is empty, too large or cannot be read.
    """
    raw = bytes_of(path, LARGEST_TABLE_BYTES, what="a file")
    if not raw.strip(b" \t\r\n\0"):
        raise EmptyFileError(
            f"{path} must hold a table, got an empty file. Leave it out or export it again."
        )
    return raw


def decode_text(path: Path, raw: bytes, encoding: str) -> str:
    r"""Return the text of a file without its byte-order mark, with ``\n`` at the ends of lines.

    ``raw`` are the bytes of the file, and ``path`` is its path for error messages.

    Raises
    ------
    InputError
        If the file is a workbook, if bytes are invalid in the encoding, or if the text contains
        control characters.
    """
    require(
        not raw.startswith((ARCHIVE_SIGNATURE, COMPOUND_SIGNATURE)),
        f"{path} must be a text file, got a workbook. Import it: ldbb-bayes import {path} --out"
        " FOLDER.",
    )
    for mark in BYTE_ORDER_MARKS.values():
        if raw.startswith(mark):
            raw = raw[len(mark) :]
            break
    remedy = "Save it as 'CSV UTF-8', or import it with --encoding."
    try:
        text = raw.rstrip(_CONTROL_Z).decode(encoding)
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise InputError(
            f"{path}, line {line}: text must be {encoding}, got other bytes. {remedy}"
        ) from None
    control_character = re.search(r"[^ -\U0010ffff\t\r\n\f]", text)
    if control_character is not None:
        line = text.count("\n", 0, control_character.start()) + 1
        raise InputError(f"{path}, line {line}: a table must be text, got binary data. {remedy}")
    return text.replace("\r\n", "\n").replace("\r", "\n")
