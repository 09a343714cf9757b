"""Any file of a table as text cells: CSV of any encoding and separator, or a workbook; broken and hostile ones refused."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ldbb_bayes.errors import InputError
from ldbb_bayes.files import LARGEST_TABLE_BYTES, bytes_of
from ldbb_bayes.tables.delimited import sheet_of_text
from ldbb_bayes.tables.sheet import Sheet
from ldbb_bayes.tables.workbook import sheets_of_workbook

__all__ = ["read_sheets"]

WORKBOOKS = (".xlsx", ".xlsm")
_ZIP = b"PK\x03\x04"
_OLD_WORKBOOK = b"\xd0\xcf\x11\xe0"


def read_sheets(
    path: Path, *, encoding: str | None = None, separator: str | None = None, sheets: Sequence[str] = ()
) -> list[Sheet]:
    """The tables in a file.

    Parameters
    ----------
    encoding : str, optional
        Of a text file. Default: by its byte-order mark; UTF-16 where every other byte is zero; UTF-8; else Windows-1252.
    separator : str, optional
        One of comma, semicolon, tab, bar, space, by name or by sign. Default: the one that splits most lines alike.
    sheets : sequence of str
        Of a workbook. Default: all that hold anything.

    Raises
    ------
    InputError
        For what is no table, too large, or not to be trusted; it names the file and the place.
    """
    raw = bytes_of(path, LARGEST_TABLE_BYTES, what="a file")
    if not raw.strip(b" \t\r\n\0"):
        raise InputError(f"{path} must hold a table, got an empty file. Leave it out or export it again.")
    if raw.startswith(_OLD_WORKBOOK):
        raise InputError(
            f"{path} must be a text table or an XLSX workbook, got the old binary XLS, or one with a "
            "password. Save it as .xlsx without one, or as 'CSV UTF-8'."
        )
    if raw.startswith(_ZIP) or path.suffix.lower() in WORKBOOKS:
        return sheets_of_workbook(path, raw, sheets)
    if sheets:
        raise InputError(
            f"{path} must be a workbook to have sheets, got a text file with sheet {sheets[0]!r} asked for. Leave it out."
        )
    return [sheet_of_text(path, raw, encoding, separator)]
