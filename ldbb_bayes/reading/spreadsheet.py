"""Reading of foreign files into text cells: workbooks and texts of any encoding and separator."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from ldbb_bayes.campaign.text_table import (
    ARCHIVE_SIGNATURE,
    BYTE_ORDER_MARKS,
    COMPOUND_SIGNATURE,
    decode_text,
    rows_of_text,
    table_bytes,
)
from ldbb_bayes.errors import InputError, require
from ldbb_bayes.reading.numerals import looks_like_number
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.workbook import WORKBOOK_SUFFIXES, read_workbook

__all__ = ["read_sheets"]

# First bytes of PDF files and pictures, which hold no table that can be read.
_PICTURE_SIGNATURES = (b"%PDF-", b"\x89PNG\r\n", b"\xff\xd8\xff", b"GIF8")
# So many bytes at the beginning of a text are searched for zeros, which indicate UTF-16.
_HEAD_BYTES = 4096
# A text is UTF-16 if more than this share of the bytes searched are zeros in the same place of
# their byte pairs.
_SHARE_OF_ZEROS = 0.2
# Signs that may separate cells, in order of preference.
_SEPARATORS = (";", "\t", "|", ",", " ")
# A separator is judged by so many lines.
_SAMPLE_LINES = 200
# The score of a separator must exceed the scores of preferred ones by more than this.
_SCORE_MARGIN = 0.02


def read_sheets(
    path: Path,
    *,
    encoding: str | None = None,
    separator: str | None = None,
    sheets: Sequence[str] = (),
) -> list[Sheet]:
    """Return the tables in a file.

    Parameters
    ----------
    path
        A workbook (XLSX, XLS, ODS) or a text file. PDF and pictures give one sheet without rows.
    encoding, separator
        Encoding and separator of a text file; None if they are to be found.
    sheets
        Names of the sheets to read from a workbook; empty for all that are not empty.

    Raises
    ------
    InputError
        For a file that is neither a workbook nor a text, and for a name that no sheet has.
    """
    raw = table_bytes(path)
    require(
        path.suffix.lower() != ".zip",
        f"{path} must be unpacked, got an archive. Unpack it and name the files in it.",
    )
    is_workbook = raw.startswith((ARCHIVE_SIGNATURE, COMPOUND_SIGNATURE))
    if is_workbook or path.suffix.lower() in WORKBOOK_SUFFIXES:
        return read_workbook(path, raw, sheets)
    if raw.startswith(_PICTURE_SIGNATURES):
        return [Sheet(path, "", [])]
    if sheets:
        raise InputError(
            f"{path} must be a workbook to have sheets, got a text file with sheet {sheets[0]!r}"
            " asked for. Leave it out."
        )
    if encoding is None:
        encoding = _find_encoding(raw)
    text = decode_text(path, raw, encoding)
    if separator is None:
        separator = _find_separator(text.split("\n"))
    return [Sheet(path, "", rows_of_text(path, text, separator), encoding, separator)]


def _find_encoding(raw: bytes) -> str:
    """Return the encoding of a text, found by its byte-order mark or its zero bytes.

    Without either it is UTF-8 if the text can be decoded so, else Windows-1252. Libraries that
    detect encodings often mistake Windows-1252 with few non-ASCII characters for others.
    """
    for encoding, mark in BYTE_ORDER_MARKS.items():
        if raw.startswith(mark):
            return encoding
    head = raw[:_HEAD_BYTES]
    if head[1::2].count(0) > _SHARE_OF_ZEROS * len(head):
        return "utf-16-le"
    if head[::2].count(0) > _SHARE_OF_ZEROS * len(head):
        return "utf-16-be"
    with suppress(UnicodeDecodeError):
        raw.decode("utf-8")
        return "utf-8"
    return "cp1252"


def _find_separator(lines: Sequence[str]) -> str:
    """Return the separator that splits most lines into equally many cells.

    The first third of the lines, which may precede the table, is not considered.
    """
    sample = [line for line in lines if line.strip()]
    sample = sample[len(sample) // 3 :][:_SAMPLE_LINES]
    best_separator = ","
    best_score = 0.0
    if not sample:
        return best_separator
    for separator in _SEPARATORS:
        score = _separator_score(sample, separator)
        if score > best_score + _SCORE_MARGIN:
            best_separator = separator
            best_score = score
    return best_separator


def _separator_score(sample: Sequence[str], separator: str) -> float:
    """Return a separator's score: the share of lines with the usual number of cells.

    The share is multiplied by 1 plus the share of numbers among the filled cells.
    """
    widths = []
    n_filled = 0
    n_numbers = 0
    for line in sample:
        if separator == " ":
            cells = line.split()
        else:
            cells = [cell.strip(' "') for cell in line.split(separator)]
        widths.append(len(cells))
        filled = [cell for cell in cells if cell]
        n_filled += len(filled)
        n_numbers += sum(looks_like_number(cell) for cell in filled)
    usual_width = max(sorted(set(widths)), key=widths.count)
    if usual_width == 1:
        return 0.0
    share = widths.count(usual_width) / len(widths)
    return share * (1.0 + n_numbers / max(n_filled, 1))
