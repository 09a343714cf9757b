"""Files as they are found into text cells, and text cells into numbers and times."""

from __future__ import annotations

import csv
import io
import re
import warnings
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError, check_known, require
from ldbb_bayes.files import LARGEST_TABLE_BYTES, bytes_of

__all__ = [
    "Sheet",
    "Unusable",
    "columns_of",
    "constant",
    "could_be_thousands",
    "decimal_mark",
    "is_clock",
    "is_missing",
    "looks_like_number",
    "number",
    "numbers_of",
    "read_sheets",
    "read_strict_table",
    "seconds_of",
]

Array = NDArray[np.float64]
Rows = list[tuple[int, list[str]]]
# Cells of a text, and of a workbook, which takes three times as much memory for each; signs of a line, of a cell shown.
_LARGEST_TEXT, _LARGEST_WORKBOOK, _LARGEST_LINE, _SHOWN = 4_000_000, 1_200_000, 100_000, 60
_GAP = r"[ '\u00a0\u202f\u2009]"
_EXPONENT = r"(?:[eEdD][+\-−–]?\d+)?"
_NUMBER = re.compile(rf"[+\-−–]?(?:\d{{1,3}}(?:{_GAP}\d{{3}})+(?:[.,]\d+)?|\d[\d.,]*{_EXPONENT}|[.,]\d+{_EXPONENT})")
# 12:00:01.250, 00:01,25 (minutes, seconds), 2026-03-04T12:00:01Z, 12:00:01 PM.
_DATE = r"(?:\d{4}-\d\d-\d\d|\d{1,2}[./]\d{1,2}[./]\d{4})[T ]"
_ZONE = r"Z|[+-]\d\d:\d\d|\s?([AaPp])\.?[Mm]\.?"
_CLOCK = re.compile(rf"(?:{_DATE})?(?:(\d{{1,2}}):)?(\d{{1,2}}):(\d{{1,2}}(?:[.,]\d{{1,9}})?)(?:{_ZONE})?")
_MISSING = ("-", "--", "---", "nan", "n/a", "na", "#n/a", "#div/0!", "#value!", "#ref!", "null", "none")


@dataclass(frozen=True, eq=False)
class Sheet:
    """Text cells of one file, or of one sheet of a workbook.

    Attributes
    ----------
    name : str
        Of the sheet; empty for a text file.
    rows : list of (line, cells)
        Line as the file counts it, from 1; empty lines are left out.
    only : bool
        Whether it is the one table of its file, and so bears the file's name.
    encoding, separator : str
        How a text file was read; empty for a workbook.
    hidden : str
        What the spreadsheet does not show of it; empty for none.
    """

    path: Path
    name: str
    rows: Rows
    only: bool = False
    encoding: str = ""
    separator: str = ""
    hidden: str = ""

    @property
    def own_name(self) -> str:
        """What distinguishes it in its file; empty for the one table of a file."""
        return "" if self.only else self.name

    @property
    def place(self) -> str:
        """What a message calls it."""
        return f"{self.path}, sheet {self.name!r}" if self.name else str(self.path)


class Unusable(str):
    """A cell that holds no value of its own (a formula, an error, a date), and what to say if it is used."""

    why: str


def looks_like_number(cell: str) -> bool:
    """Whether a cell is a number, whatever its decimal mark, or a time of day."""
    return _NUMBER.fullmatch(cell) is not None or is_clock(cell)


def is_missing(cell: str) -> bool:
    """Whether a cell stands for a number that is not there: such rows belong to the table, and are refused by name."""
    return cell.casefold() in _MISSING or isinstance(cell, Unusable)


def is_clock(cell: str) -> bool:
    """Whether a cell is a time of day, or minutes and seconds."""
    return ":" in cell and _CLOCK.fullmatch(cell) is not None


def could_be_thousands(cell: str) -> bool:
    """Whether the mark in a cell may stand between thousands: ``12,310`` may, ``0,310`` and ``12,31`` may not."""
    return re.fullmatch(r"[+\-−–]?[1-9]\d{0,2}[.,]\d{3}", cell) is not None


def _in_thousands(text: str, mark: str) -> bool:
    return re.fullmatch(rf"[+\-]?\d{{1,3}}(?:{mark}\d{{3}})+", text) is not None


def number(cell: str, decimal: str = ".") -> float:
    """The number in a cell; thousands may stand apart by the other of comma and point, blanks or an apostrophe."""
    if "_" in cell:
        raise ValueError(cell)
    if decimal == ".":
        with suppress(ValueError):
            return float(cell)
    text = cell.strip().translate(str.maketrans("−–", "--"))
    for mark in (_GAP, "," if decimal == "." else r"\."):
        if re.search(mark, text):
            if not _in_thousands(text.partition(decimal)[0], mark):
                raise ValueError(cell)
            text = re.sub(mark, "", text)
    return float(text.replace(decimal, ".").replace("D", "E").replace("d", "e"))


def numbers_of(
    place: str, what: str, lines: Sequence[int], cells: Sequence[str], decimal: str | None, *, strict: bool = False
) -> Array:
    """One column of finite numbers; a strict table has no marks between thousands."""
    values = np.full(len(cells), np.nan)
    for k, cell in enumerate(cells):
        with suppress(ValueError):
            values[k] = float(cell.replace(decimal or ".", ".")) if strict else number(cell, decimal or ".")
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        cell = cells[bad[0]]
        if isinstance(cell, Unusable):
            raise InputError(cell.why)
        cure = "Give --decimal" if not strict and re.fullmatch(r"[+\-−–]?\d+[.,]\d+", cell) else "Correct or remove the line"
        raise InputError(f"{place}, line {lines[bad[0]]}: {what} must be a finite number, got {cell[:_SHOWN]!r}. {cure}.")
    return values


def decimal_mark(place: str, cells: Iterable[tuple[int, str]]) -> str | None:
    """The decimal mark of a table's (line, cell); None where no cell has one.

    Of a comma and a point in one cell the last is the decimal mark. Cells of commas alone beside cells of points alone
    contradict each other, unless those of one kind can only be thousands of the other.
    """
    sure: str | None = None
    alone: dict[str, tuple[int, str]] = {}
    wrong: tuple[int, str] | None = None
    for line, cell in cells:
        comma, point = cell.rfind(","), cell.rfind(".")
        mark = "," if comma > point else "."
        if comma >= 0 and point >= 0:
            if sure not in (None, mark):
                wrong = line, cell
                break
            sure = mark
        elif comma >= 0 or point >= 0:
            alone.setdefault(mark, (line, cell))
    other = "." if sure == "," else ","
    if wrong is None and sure is None and len(alone) == 2:
        wrong = max(alone.values())
    if wrong is None and sure and other in alone and not _in_thousands(alone[other][1], re.escape(other)):
        wrong = alone[other]
    if wrong is not None:
        got = f"the decimal mark must be the same in all rows, got {wrong[1][:_SHOWN]!r}"
        raise InputError(f"{place}, line {wrong[0]}: {got}. Correct it, or give --decimal.")
    return sure or next(iter(alone), None)


def seconds_of(place: str, lines: Sequence[int], cells: Sequence[str]) -> Array:
    """Times of day as seconds that go on over midnight (minutes and seconds: over the hour); a date is left out."""
    times, round_s = np.zeros(len(cells)), 3600.0
    for k, cell in enumerate(cells):
        match = _CLOCK.fullmatch(cell)
        if match is None:
            got = f"time must be as in 12:00:01.25, got {cell[:_SHOWN]!r}"
            raise InputError(f"{place}, line {lines[k]}: {got}. Correct the line.")
        hours = int(match[1] or 0)
        if match[4]:
            hours = hours % 12 + 12 * (match[4] in "pP")
        round_s = 86_400.0 if match[1] else round_s
        times[k] = 3600.0 * hours + 60.0 * int(match[2]) + number(match[3].replace(",", "."))
    return times + round_s * np.concatenate([[0.0], np.cumsum(np.diff(times) < -0.5 * round_s)])


def constant(
    place: str, test: str, name: str, lines: Sequence[int], cells: Sequence[str], decimal: str | None
) -> str | float | None:
    """The one value that a column holds in all rows of a test; None where it is empty."""
    other = next((k for k, cell in enumerate(cells) if cell != cells[0]), None)
    if other is not None:
        got = f"{name} must be the same in all rows of test {test!r}, got {cells[other][:_SHOWN]!r} after {cells[0][:_SHOWN]!r}"
        raise InputError(f"{place}, line {lines[other]}: {got}. Correct it.")
    if not cells[0] or name in ("plane", "direction"):
        return cells[0] or None
    return float(numbers_of(place, name, lines[:1], cells[:1], decimal)[0])


_SEPARATORS = {"comma": ",", "semicolon": ";", "tab": "\t", "bar": "|", "space": " "}
_MARKS = ((b"\xef\xbb\xbf", "utf-8"), (b"\xff\xfe\x00\x00", "utf-32-le"), (b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be"))
_ZIP, _OLD_WORKBOOK, _WORKBOOKS = b"PK\x03\x04", b"\xd0\xcf\x11\xe0", (".xlsx", ".xlsm")


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
    """
    raw = _bytes_of(path)
    got = "the old binary XLS, or one with a password. Save it as .xlsx without one, or as 'CSV UTF-8'"
    require(not raw.startswith(_OLD_WORKBOOK), f"{path} must be a text table or an XLSX workbook, got {got}.")
    if raw.startswith(_ZIP) or path.suffix.lower() in _WORKBOOKS:
        return _sheets_of_workbook(path, raw, sheets)
    if sheets:
        got = f"a text file with sheet {sheets[0]!r} asked for"
        raise InputError(f"{path} must be a workbook to have sheets, got {got}. Leave it out.")
    if separator is not None and separator not in _SEPARATORS.values():
        check_known("separator", [separator], _SEPARATORS)
        separator = _SEPARATORS[separator]
    text, encoding = _decoded(path, raw, encoding)
    sign = separator or _separator_of(text.split("\n"))
    return [Sheet(path, "", _rows_of_text(path, text, sign), True, encoding, sign)]


def read_strict_table(path: Path) -> tuple[Rows, str]:
    """Lines and cells of a table in UTF-8 whose first line is its header; and the separator: comma, semicolon or tab."""
    text, _ = _decoded(path, _bytes_of(path), "utf-8")
    sign = max(",;\t", key=text.partition("\n")[0].count)
    return _rows_of_text(path, text, sign), sign


def _bytes_of(path: Path) -> bytes:
    raw = bytes_of(path, LARGEST_TABLE_BYTES, what="a file")
    require(raw.strip(b" \t\r\n\0"), f"{path} must hold a table, got an empty file. Leave it out or export it again.")
    return raw


def _decoded(path: Path, raw: bytes, encoding: str | None) -> tuple[str, str]:
    """The text of a file and its encoding."""
    mark, marked = next(((sign, name) for sign, name in _MARKS if raw.startswith(sign)), (b"", ""))
    encoding, cure = encoding or marked or _encoding_of(raw), "Save it as 'CSV UTF-8', or import it with --encoding"
    try:
        text = raw[len(mark) :].rstrip(b"\x1a").decode(encoding)
    except LookupError:
        known = "utf-8, utf-16-le, utf-16-be, cp1252"
        raise InputError(f"{path}: encoding must be one Python knows, got {encoding!r}. For example {known}.") from None
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise InputError(f"{path}, line {line}: text must be {encoding}, got other bytes. {cure}.") from None
    strange = re.search(r"[^ -\U0010ffff\t\r\n\f]", text)
    if strange is not None:
        line = text.count("\n", 0, strange.start()) + 1
        raise InputError(f"{path}, line {line}: a table must be text, got binary data. {cure}.")
    return text.replace("\r\n", "\n").replace("\r", "\n"), encoding


def columns_of(place: str, rows: Rows, width: int) -> tuple[list[int], list[list[str]]]:
    """Lines and columns of rows that are equally wide."""
    for line, cells in rows:
        if len(cells) < width or any(cells[width:]):
            cure = "Complete or remove the line; with decimal commas separate the cells by semicolons"
            raise InputError(f"{place}, line {line}: rows must have {width} cells, got {len(cells)}. {cure}.")
    return [line for line, _ in rows], [list(column) for column in zip(*(cells[:width] for _, cells in rows), strict=True)]


def _encoding_of(raw: bytes) -> str:
    """Of a text without a byte-order mark; detectors of languages take Windows-1252 with few signs above ASCII for others."""
    head = raw[:4096]
    for encoding, half in (("utf-16-le", head[1::2]), ("utf-16-be", head[::2])):
        if half.count(0) > 0.2 * len(head):
            return encoding
    with suppress(UnicodeDecodeError):
        raw.decode("utf-8")
        return "utf-8"
    return "cp1252"


def _rows_of_text(path: Path, text: str, sign: str) -> Rows:
    if text.count("\n") + text.count(sign) > _LARGEST_TEXT:
        raise InputError(f"{path} must hold at most {_LARGEST_TEXT} cells, got more. Split it.")
    rows = []
    for k, line in enumerate(text.split("\n"), start=1):
        if len(line) > _LARGEST_LINE:
            got = f"a line must hold at most {_LARGEST_LINE} signs, got {len(line)}"
            raise InputError(f"{path}, line {k}: {got}. Export it again.")
        if line.strip():
            rows.append((k, _cells(path, k, line, sign)))
    return rows


def _cells(path: Path, k: int, line: str, sign: str) -> list[str]:
    """Cells without the blanks around them; quoted cells may not run over a line's end."""
    if sign == " ":
        return line.split()
    try:
        cells = next(csv.reader(io.StringIO(line), delimiter=sign, strict=True)) if '"' in line else line.split(sign)
    except (csv.Error, StopIteration):
        got = f"quotes must be closed in their cell, got {line[:_SHOWN]!r}"
        raise InputError(f"{path}, line {k}: {got}. Correct the line.") from None
    return [cell.strip() for cell in cells]


def _separator_of(lines: Sequence[str]) -> str:
    """The sign that splits most lines below the head into equally many cells; of equals the first that is no decimal mark."""
    sample = [line for line in lines if line.strip()]
    sample = sample[len(sample) // 3 :][:200]
    best, most = ",", 0.0
    for sign in (";", "\t", "|", ",", " ") if sample else ():
        split = [line.split() if sign == " " else [cell.strip(' "') for cell in line.split(sign)] for line in sample]
        counts = [len(cells) for cells in split]
        usual = max(sorted(set(counts)), key=counts.count)
        alike = counts.count(usual) / len(counts) if usual > 1 else 0.0
        cells = [cell for row in split for cell in row if cell]
        score = alike * (1.0 + sum(map(looks_like_number, cells)) / max(len(cells), 1))
        if score > most + 0.02:
            best, most = sign, score
    return best


_MOST_EMPTY_ROWS, _MOST_SHEETS, _MOST_PARTS = 50_000, 200, 2000
# Of a workbook: what its parts may unpack to, and how much more than it takes on disk.
_LARGEST_UNPACKED, _LARGEST_RATIO, _LARGEST_STRINGS = 256 * 2**20, 200.0, 16 * 2**20
# Bytes read at once, of a tag, and between two ends of tags: a cell's text has at most 32 767 signs.
_CHUNK, _LONGEST_TAG, _LONGEST_PART = 2**20, 400, 300_000
_HIDDEN_ROW = re.compile(rb'<row\b[^>]{0,300}\shidden="(?:1|true)"[^>]{0,300}>')


def _damaged(place: str, what: str, error: Exception) -> InputError:
    got = f"a damaged one ({type(error).__name__})"
    return InputError(f"{place} must hold {what} that can be read, got {got}. Open and save it again.")


def _sheets_of_workbook(path: Path, raw: bytes, wanted: Sequence[str]) -> list[Sheet]:
    """The sheets that hold anything, or those wanted."""
    hidden_rows = _check_archive(path, raw)
    try:
        import openpyxl
    except ImportError:
        cure = "Save it as 'CSV UTF-8', or pip install 'ldbb-bayes[excel]'"
        raise InputError(f"{path} must be read with openpyxl, which is not installed. {cure}.") from None
    try:
        with warnings.catch_warnings(action="ignore"):
            book = openpyxl.load_workbook(io.BytesIO(raw), read_only=True, data_only=False, keep_links=False)
    except Exception as error:  # noqa: BLE001  # whatever a damaged workbook makes of the library
        raise _damaged(str(path), "a workbook", error) from None
    names = [sheet.title for sheet in book.worksheets]
    check_known(f"{path}: sheet", wanted, names)
    found, cells = [], 0
    for name in wanted or names[:_MOST_SHEETS]:
        rows = []
        for k, texts in _rows_of(path, name, book[name]):
            cells += len(texts) + 1
            if cells > _LARGEST_WORKBOOK:
                got = f"a workbook must hold at most {_LARGEST_WORKBOOK} cells, got more"
                raise InputError(f"{path}, sheet {name!r}: {got}. Split it.")
            if any(texts):
                rows.append((k, texts))
        if rows:
            width = max(len(texts) for _, texts in rows)
            hidden = ["the sheet"] if book[name].sheet_state != "visible" else []
            hidden += [f"{hidden_rows} rows of the workbook"] if hidden_rows else []
            whole = [(k, [*texts, *[""] * (width - len(texts))]) for k, texts in rows]
            found.append(Sheet(path, name, whole, hidden=" and ".join(hidden)))
    require(found, f"{path} must hold a table, got empty sheets. Leave it out or export it again.")
    return found


def _rows_of(path: Path, name: str, sheet: Any) -> Iterator[tuple[int, list[str]]]:
    """Rows as they stand in the sheet, whatever size it claims to have."""
    k = empty = 0
    try:
        sheet.reset_dimensions()
        for k, row in enumerate(sheet.iter_rows(), start=1):
            empty = 0 if row else empty + 1
            if empty > _MOST_EMPTY_ROWS:
                got = f"rows must follow each other, got {empty} empty ones above row {k}"
                raise InputError(f"{path}, sheet {name!r}: {got}. Delete them.")
            yield k, [_text_of(f"{path}, sheet {name!r}", cell) for cell in row]
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001  # whatever a damaged sheet makes of the library
        raise _damaged(f"{path}, sheet {name!r}, below row {k}", "rows", error) from None


def _text_of(place: str, cell: Any) -> str:
    """A cell as text; what holds no value of its own says so if it is used."""
    value = cell.value
    if value is None or cell.data_type not in "fed":
        return "" if value is None else repr(value) if isinstance(value, float) else str(value).strip()
    date = value.isoformat(" ") if isinstance(value, datetime) else str(value)
    text, why = {
        "f": ("formula", f"values, got the formula {str(value)[:40]!r}. Paste the values in its place."),
        "e": ("error", f"values, got the error {value}. Correct it."),
        "d": (
            date,
            f"numbers or text, got the date {date}. The spreadsheet took a number for a date: format the column as number.",
        ),
    }[cell.data_type]
    found = Unusable(text)
    found.why = f"{place}, cell {cell.coordinate}: cells must hold {why}"
    return found


def _check_archive(path: Path, raw: bytes) -> int:
    """How many rows a workbook hides. Nothing is unpacked whose directory promises too much; no part may define entities."""
    hidden, beware = 0, "Do not open it unless you know where it comes from."
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            parts = archive.infolist()
            size, packed = (sum(getattr(part, own) for part in parts) for own in ("file_size", "compress_size"))
            strings = sum(part.file_size for part in parts if part.filename.endswith("sharedStrings.xml"))
            largest = min(_LARGEST_UNPACKED, _LARGEST_RATIO * max(packed, 1) + _CHUNK)
            if size > largest or strings > _LARGEST_STRINGS or len(parts) > _MOST_PARTS:
                raise InputError(
                    f"{path} must unpack to at most {_LARGEST_UNPACKED / 2**20:.0f} MB and {_LARGEST_RATIO:.0f} times its "
                    f"size, got {len(parts)} parts and {size / 2**20:.0f} MB from {packed / 2**20:.2f} MB. {beware}"
                )
            for part in parts:
                if part.filename.startswith(("/", "\\")) or ".." in re.split(r"[/\\]", part.filename):
                    raise InputError(f"{path} must hold parts inside itself, got {part.filename[:60]!r}. {beware}")
                if part.filename.endswith((".xml", ".rels")):
                    with archive.open(part) as stream:
                        rows = _hidden_rows(stream)
                    if rows is None:
                        raise InputError(f"{path}: {part.filename[:60]!r} must define no entities, got some. {beware}")
                    hidden += rows
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001  # whatever a damaged archive makes of the library
        raise _damaged(str(path), "an XLSX workbook without a password", error) from None
    return hidden


def _hidden_rows(stream: IO[bytes]) -> int | None:
    """How many rows an XML part hides; None where a document type stands anywhere in it, in any width of characters."""
    tail, hidden = b"", 0
    while chunk := stream.read(_CHUNK):
        text = tail + chunk.replace(b"\0", b"")
        if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
            return None
        if max(map(len, text.split(b">"))) > _LONGEST_PART:
            raise ValueError("a tag without end")
        hidden += len(_HIDDEN_ROW.findall(text))
        tail = text[text.rfind(b">") + 1 :][-_LONGEST_TAG:]
    return hidden
