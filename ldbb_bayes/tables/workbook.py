"""A workbook as cells; damaged and hostile ones are refused before a library unpacks them."""

from __future__ import annotations

import io
import re
import warnings
import zipfile
from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path
from typing import IO, Any

from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.tables.numerals import Unusable
from ldbb_bayes.tables.sheet import LARGEST_CELLS, Sheet

__all__ = ["sheets_of_workbook"]

MOST_EMPTY_ROWS = 50_000
LARGEST_SHEETS = 200
# Of a workbook: what its parts may unpack to, and how much more than it takes on disk.
LARGEST_UNPACKED_BYTES = 256 * 2**20
LARGEST_RATIO = 200.0
_SHARED, LARGEST_SHARED_BYTES = "sharedStrings.xml", 16 * 2**20
_CHUNK = 2**20
_LONGEST_TAG = 400
# Between two ends of tags: a cell's text has at most 32 767 signs.
_LONGEST_PART = 300_000
_HIDDEN_ROW = re.compile(rb'<row\b[^>]{0,300}\shidden="(?:1|true)"[^>]{0,300}>')


def sheets_of_workbook(path: Path, raw: bytes, wanted: Sequence[str]) -> list[Sheet]:
    """The sheets of a workbook that hold anything, or those wanted; see `read_sheets`."""
    hidden_rows = _check_zip(path, raw)
    try:
        import openpyxl
    except ImportError:
        raise InputError(
            f"{path} must be read with openpyxl, which is not installed. Save it as 'CSV UTF-8', "
            "or pip install 'ldbb-bayes[excel]'."
        ) from None
    try:
        with warnings.catch_warnings(action="ignore"):
            book = openpyxl.load_workbook(io.BytesIO(raw), read_only=True, data_only=False, keep_links=False)
    except Exception as error:  # noqa: BLE001  # whatever a damaged workbook makes of the library
        raise _damaged(str(path), "a workbook", error) from None
    names = [sheet.title for sheet in book.worksheets]
    check_known(f"{path}: sheet", wanted, names)
    found = []
    cells = 0
    for name in wanted or names[:LARGEST_SHEETS]:
        rows = []
        for number, texts in _rows_of(path, name, book[name]):
            cells += len(texts) + 1
            if cells > LARGEST_CELLS:
                raise InputError(
                    f"{path}, sheet {name!r}: a workbook must hold at most {LARGEST_CELLS} cells, got more. Split it."
                )
            if any(texts):
                rows.append((number, texts))
        if rows:
            width = max(len(texts) for _, texts in rows)
            whole = [(number, [*texts, *[""] * (width - len(texts))]) for number, texts in rows]
            hidden = ["the sheet"] if book[name].sheet_state != "visible" else []
            hidden += [f"{hidden_rows} rows of the workbook"] if hidden_rows else []
            found.append(Sheet(path, name, whole, hidden=" and ".join(hidden)))
    if not found:
        raise InputError(f"{path} must hold a table, got empty sheets. Leave it out or export it again.")
    return found


def _rows_of(path: Path, name: str, sheet: Any) -> Iterator[tuple[int, list[str]]]:
    """Rows as they stand in the sheet, whatever size it claims to have."""
    sheet.reset_dimensions()
    rows = sheet.iter_rows()
    number = empty = 0
    while True:
        try:
            row = next(rows)
        except StopIteration:
            return
        except Exception as error:  # noqa: BLE001  # whatever a damaged sheet makes of the library
            raise _damaged(f"{path}, sheet {name!r}, below row {number}", "rows", error) from None
        number += 1
        empty = empty + 1 if not row else 0
        if empty > MOST_EMPTY_ROWS:
            raise InputError(
                f"{path}, sheet {name!r}: rows must follow each other, got {empty} empty ones above row {number}. Delete them."
            )
        yield number, [_text_of(path, name, cell) for cell in row]


def _damaged(place: str, what: str, error: Exception) -> InputError:
    return InputError(
        f"{place} must hold {what} that can be read, got a damaged one ({type(error).__name__}). Open and save it again."
    )


def _text_of(path: Path, sheet: str, cell: Any) -> str:
    """A cell as text; what holds no value of its own says so if it is used."""
    value = cell.value
    if value is None:
        return ""
    place = f"{path}, sheet {sheet!r}, cell {cell.coordinate}: cells must hold"
    if cell.data_type == "f":
        return Unusable.because("formula", f"{place} values, got the formula {str(value)[:40]!r}. Paste the values in its place.")
    if cell.data_type == "e":
        return Unusable.because("error", f"{place} values, got the error {value}. Correct it.")
    if cell.data_type == "d":
        text = value.isoformat(" ") if isinstance(value, datetime) else str(value)
        advice = "The spreadsheet took a number for a date: format the column as number."
        return Unusable.because(text, f"{place} numbers or text, got the date {text}. {advice}")
    return repr(value) if isinstance(value, float) else str(value).strip()


def _check_zip(path: Path, raw: bytes) -> int:
    """Nothing is unpacked whose directory promises too much; no part may define entities. Returns how many rows are hidden."""
    beware = "Do not open it unless you know where it comes from."
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            parts = archive.infolist()
            hidden = 0
            size = sum(part.file_size for part in parts)
            packed = max(sum(part.compress_size for part in parts), 1)
            shared = sum(part.file_size for part in parts if part.filename.endswith(_SHARED))
            if (
                size > LARGEST_UNPACKED_BYTES
                or size > LARGEST_RATIO * packed + _CHUNK
                or shared > LARGEST_SHARED_BYTES
                or len(parts) > 10 * LARGEST_SHEETS
            ):
                raise InputError(
                    f"{path} must unpack to at most {LARGEST_UNPACKED_BYTES / 2**20:.0f} MB and {LARGEST_RATIO:.0f} times its "
                    f"size, got {len(parts)} parts and {size / 2**20:.0f} MB from {packed / 2**20:.2f} MB. {beware}"
                )
            for part in parts:
                if part.filename.startswith(("/", "\\")) or ".." in part.filename.replace("\\", "/").split("/"):
                    raise InputError(f"{path} must hold parts inside itself, got {part.filename[:60]!r}. {beware}")
                if not part.filename.endswith((".xml", ".rels")):
                    continue
                with archive.open(part) as stream:
                    entities, rows = _beware_of(stream)
                    hidden += rows
                    if entities:
                        raise InputError(f"{path}: {part.filename[:60]!r} must define no entities, got some. {beware}")
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001  # whatever a damaged archive makes of the library
        raise _damaged(str(path), "an XLSX workbook without a password", error) from None
    return hidden


def _beware_of(stream: IO[bytes]) -> tuple[bool, int]:
    """Whether a document type stands anywhere in an XML part, in any width of characters; and how many rows it hides."""
    tail, hidden = b"", 0
    while chunk := stream.read(_CHUNK):
        text = tail + chunk.replace(b"\0", b"")
        if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
            return True, 0
        if max(map(len, text.split(b">"))) > _LONGEST_PART:
            raise ValueError("a tag without end")
        hidden += len(_HIDDEN_ROW.findall(text))
        tail = text[text.rfind(b">") + 1 :][-_LONGEST_TAG:]
    return False, hidden
