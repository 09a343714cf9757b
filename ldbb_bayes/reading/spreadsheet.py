"""Files as they are found into text cells, and text cells into numbers and times."""

from __future__ import annotations

import csv
import io
import re
import zipfile
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ldbb_bayes.errors import InputError, check_known, require
from ldbb_bayes.files import LARGEST_TABLE_BYTES, bytes_of
from ldbb_bayes.results import Array

__all__ = [
    "Rows",
    "Sheet",
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

Rows = list[tuple[int, list[str]]]
# Cells of a table; signs of a line, of a cell shown.
_LARGEST_TABLE = 4_000_000
_LARGEST_LINE = 100_000
_SHOWN = 60
_GAP = r"[ '\u00a0\u202f\u2009]"
_EXPONENT = r"(?:[eEdD][+\-−–]?\d+)?"
_NUMBER = re.compile(
    rf"[+\-−–]?(?:\d{{1,3}}(?:{_GAP}\d{{3}})+(?:[.,]\d+)?|\d[\d.,]*{_EXPONENT}|[.,]\d+{_EXPONENT})"
)
# 12:00:01.250, 00:01,25 (minutes, seconds), 2026-03-04T12:00:01Z, 12:00:01 PM.
_DATE = r"(?:\d{4}-\d\d-\d\d|\d{1,2}[./]\d{1,2}[./]\d{4})[T ]"
_ZONE = r"Z|[+-]\d\d:\d\d|\s?([AaPp])\.?[Mm]\.?"
_CLOCK = re.compile(
    rf"(?:{_DATE})?(?:(\d{{1,2}}):)?(\d{{1,2}}):(\d{{1,2}}(?:[.,]\d{{1,9}})?)(?:{_ZONE})?"
)
_MISSING = (
    "-",
    "--",
    "---",
    "nan",
    "n/a",
    "na",
    "#n/a",
    "#div/0!",
    "#value!",
    "#ref!",
    "null",
    "none",
)


@dataclass(frozen=True, eq=False)
class Sheet:
    """Text cells of one file, or of one sheet of a workbook."""

    path: Path
    name: str  # of the sheet; empty for a text file
    rows: Rows  # (line as the file counts it, cells) without empty lines
    encoding: str = ""  # of a text file, as its separator
    separator: str = ""
    only: bool = False  # the one table of its file, which bears the file's name

    @property
    def own_name(self) -> str:
        """What distinguishes it in its file; empty for the one table of a file."""
        return "" if self.only else self.name

    @property
    def place(self) -> str:
        """What a message calls it."""
        return f"{self.path}, sheet {self.name!r}" if self.name else str(self.path)


def looks_like_number(cell: str) -> bool:
    """Whether a cell is a number, whatever its decimal mark, or a time of day."""
    return _NUMBER.fullmatch(cell) is not None or is_clock(cell)


def is_missing(cell: str) -> bool:
    """Whether a cell stands for a number that is not there: such rows belong to the table, and are
    refused by name."""
    return cell.casefold() in _MISSING


def is_clock(cell: str) -> bool:
    """Whether a cell is a time of day, or minutes and seconds."""
    return ":" in cell and _CLOCK.fullmatch(cell) is not None


def could_be_thousands(cell: str) -> bool:
    """Whether the mark in a cell may stand between thousands: ``12,310`` may, ``0,310`` and
    ``12,31`` may not."""
    return re.fullmatch(r"[+\-−–]?[1-9]\d{0,2}[.,]\d{3}", cell) is not None


def _in_thousands(text: str, mark: str) -> bool:
    return re.fullmatch(rf"[+\-]?\d{{1,3}}(?:{mark}\d{{3}})+", text) is not None


def number(cell: str, decimal: str = ".") -> float:
    """The number in a cell; thousands may stand apart by the other of comma and point, blanks or an
    apostrophe."""
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
    place: str,
    what: str,
    lines: Sequence[int],
    cells: Sequence[str],
    decimal: str | None,
    *,
    strict: bool = False,
) -> Array:
    """One column of finite numbers; a strict table has no marks between thousands."""
    values = np.full(len(cells), np.nan)
    for k, cell in enumerate(cells):
        with suppress(ValueError):
            values[k] = (
                float(cell.replace(decimal or ".", ".")) if strict else number(cell, decimal or ".")
            )
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        cell = cells[bad[0]]
        got = repr(cell[:_SHOWN]) if cell else "nothing"
        cure = (
            "Correct it, or give another --decimal"
            if not strict and re.fullmatch(r"[+\-−–]?\d+[.,]\d+", cell)
            else "Correct or remove the line"
        )
        if re.match(r"\d{4}-\d\d-\d\d", cell):
            cure = "A spreadsheet took a number for a date: format the column as number"
        raise InputError(
            f"{place}, line {lines[bad[0]]}: {what} must be a finite number, got {got}. {cure}."
        )
    return values


def decimal_mark(place: str, cells: Iterable[tuple[int, str]]) -> str | None:
    """The decimal mark of a table's (line, cell); None where no cell has one. Of a comma and a
    point in one cell the last is the decimal mark. Cells of commas alone beside cells of points
    alone contradict each other, unless those of one kind can only be thousands of the other."""
    sure: str | None = None
    alone: dict[str, tuple[int, str]] = {}
    wrong: tuple[int, str] | None = None
    for line, cell in cells:
        comma = cell.rfind(",")
        point = cell.rfind(".")
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
    if (
        wrong is None
        and sure
        and other in alone
        and not _in_thousands(alone[other][1], re.escape(other))
    ):
        wrong = alone[other]
    if wrong is not None:
        got = f"the decimal mark must be the same in all rows, got {wrong[1][:_SHOWN]!r}"
        raise InputError(
            f"{place}, line {wrong[0]}: {got}. Correct it; or give --decimal, if the other stands"
            " between thousands."
        )
    return sure or next(iter(alone), None)


def seconds_of(place: str, lines: Sequence[int], cells: Sequence[str]) -> Array:
    """Times of day as seconds that go on over midnight (minutes and seconds: over the hour); a date
    is left out."""
    times = np.zeros(len(cells))
    round_s = 3600.0
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
    place: str,
    test: str,
    name: str,
    lines: Sequence[int],
    cells: Sequence[str],
    decimal: str | None,
) -> str | float | None:
    """The one value that a column holds in all rows of a test; None where it is empty."""
    other = next((k for k, cell in enumerate(cells) if cell != cells[0]), None)
    if other is not None:
        got = (
            f"{name} must be the same in all rows of test {test!r}, got {cells[other][:_SHOWN]!r}"
            f" after {cells[0][:_SHOWN]!r}"
        )
        raise InputError(f"{place}, line {lines[other]}: {got}. Correct it.")
    if not cells[0] or name in ("plane", "direction"):
        return cells[0] or None
    return float(numbers_of(place, name, lines[:1], cells[:1], decimal)[0])


_MARKS = ((b"\xef\xbb\xbf", "utf-8"), (b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be"))
# How a zip (XLSX, ODS) and a compound file (XLS, or a workbook with a password) begin.
_ARCHIVE = b"PK\x03\x04"
_BINARY = b"\xd0\xcf\x11\xe0"
_WORKBOOKS = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")
# How PDF and pictures begin, which hold no table whatever they show.
_PICTURES = (b"%PDF-", b"\x89PNG\r\n", b"\xff\xd8\xff", b"GIF8")


def read_sheets(
    path: Path,
    *,
    encoding: str | None = None,
    separator: str | None = None,
    sheets: Sequence[str] = (),
) -> list[Sheet]:
    """Return the tables in a file: of a workbook (XLSX, XLS, ODS) the sheets asked for, by default
    all that hold anything."""
    raw = _bytes_of(path)
    require(
        path.suffix.lower() != ".zip",
        f"{path} must be unpacked, got an archive. Unpack it and name the files in it.",
    )
    if raw.startswith((_ARCHIVE, _BINARY)) or path.suffix.lower() in _WORKBOOKS:
        return _sheets_of_workbook(path, raw, sheets)
    if raw.startswith(_PICTURES):
        return [Sheet(path, "", [])]
    if sheets:
        got = f"a text file with sheet {sheets[0]!r} asked for"
        raise InputError(f"{path} must be a workbook to have sheets, got {got}. Leave it out.")
    text, encoding = _decoded(path, raw, encoding)
    sign = separator or _separator_of(text.split("\n"))
    return [Sheet(path, "", _rows_of_text(path, text, sign), encoding, sign)]


def read_strict_table(path: Path) -> tuple[Rows, str]:
    """Lines and cells of a table in UTF-8 whose first line is its header; and the separator: comma,
    semicolon or tab."""
    text, _ = _decoded(path, _bytes_of(path), "utf-8")
    sign = max(",;\t", key=text.partition("\n")[0].count)
    return _rows_of_text(path, text, sign), sign


def _bytes_of(path: Path) -> bytes:
    raw = bytes_of(path, LARGEST_TABLE_BYTES, what="a file")
    require(
        raw.strip(b" \t\r\n\0"),
        f"{path} must hold a table, got an empty file. Leave it out or export it again.",
    )
    return raw


def _decoded(path: Path, raw: bytes, encoding: str | None) -> tuple[str, str]:
    """The text of a file and its encoding."""
    workbook = (
        f"{path} must be a text file, got a workbook. Import it: ldbb-bayes import {path} --out"
        " FOLDER."
    )
    require(not raw.startswith((_ARCHIVE, _BINARY)), workbook)
    mark, marked = next(((sign, name) for sign, name in _MARKS if raw.startswith(sign)), (b"", ""))
    encoding = encoding or marked or _encoding_of(raw)
    cure = "Save it as 'CSV UTF-8', or import it with --encoding"
    try:
        text = raw[len(mark) :].rstrip(b"\x1a").decode(encoding)
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise InputError(
            f"{path}, line {line}: text must be {encoding}, got other bytes. {cure}."
        ) from None
    strange = re.search(r"[^ -\U0010ffff\t\r\n\f]", text)
    if strange is not None:
        line = text.count("\n", 0, strange.start()) + 1
        raise InputError(f"{path}, line {line}: a table must be text, got binary data. {cure}.")
    return text.replace("\r\n", "\n").replace("\r", "\n"), encoding


def columns_of(place: str, rows: Rows, width: int) -> tuple[list[int], list[list[str]]]:
    """Lines and columns of rows that are equally wide."""
    for line, cells in rows:
        if len(cells) < width or any(cells[width:]):
            cure = (
                "Complete or remove the line; with decimal commas separate the cells by semicolons"
            )
            raise InputError(
                f"{place}, line {line}: rows must have {width} cells, got {len(cells)}. {cure}."
            )
    return [line for line, _ in rows], [
        list(column) for column in zip(*(cells[:width] for _, cells in rows), strict=True)
    ]


def _encoding_of(raw: bytes) -> str:
    """Of a text without a byte-order mark; detectors of languages take Windows-1252 with few signs
    above ASCII for others."""
    head = raw[:4096]
    for encoding, half in (("utf-16-le", head[1::2]), ("utf-16-be", head[::2])):
        if half.count(0) > 0.2 * len(head):
            return encoding
    with suppress(UnicodeDecodeError):
        raw.decode("utf-8")
        return "utf-8"
    return "cp1252"


def _rows_of_text(path: Path, text: str, sign: str) -> Rows:
    if text.count("\n") + text.count(sign) > _LARGEST_TABLE:
        raise InputError(f"{path} must hold at most {_LARGEST_TABLE} cells, got more. Split it.")
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
        cells = (
            next(csv.reader(io.StringIO(line), delimiter=sign, strict=True))
            if '"' in line
            else line.split(sign)
        )
    except (csv.Error, StopIteration):
        got = f"quotes must be closed in their cell, got {line[:_SHOWN]!r}"
        raise InputError(f"{path}, line {k}: {got}. Correct the line.") from None
    return [cell.strip() for cell in cells]


def _separator_of(lines: Sequence[str]) -> str:
    """The sign that splits most lines below the head into equally many cells; of equals the first
    that is no decimal mark."""
    sample = [line for line in lines if line.strip()]
    sample = sample[len(sample) // 3 :][:200]
    best = ","
    most = 0.0
    for sign in (";", "\t", "|", ",", " ") if sample else ():
        split = [
            line.split() if sign == " " else [cell.strip(' "') for cell in line.split(sign)]
            for line in sample
        ]
        counts = [len(cells) for cells in split]
        usual = max(sorted(set(counts)), key=counts.count)
        alike = counts.count(usual) / len(counts) if usual > 1 else 0.0
        cells = [cell for row in split for cell in row if cell]
        score = alike * (1.0 + sum(map(looks_like_number, cells)) / max(len(cells), 1))
        if score > most + 0.02:
            best = sign
            most = score
    return best


# Of a workbook: what its parts may unpack to, how much more than it takes on disk, and cells too
# far out to make a table up to.
_LARGEST_UNPACKED = 256 * 2**20
_LARGEST_RATIO = 200.0
_SMALL = 2**20
_FAR = re.compile(rb'\br="([A-Z]{3,}\d+|[A-Z]+\d{6,})"')


def _sheets_of_workbook(path: Path, raw: bytes, wanted: Sequence[str]) -> list[Sheet]:
    """The sheets that hold anything, or those wanted. A formula counts by the value that was saved
    with it."""
    import python_calamine  # loads a compiled library that few commands need

    if raw.startswith(_ARCHIVE):
        _check_archive(path, raw)
    old = raw.startswith(_BINARY)  # by its path, as this tells whether it has a password
    got = "a cut one. Open and save it again"
    require(
        not old or len(raw) % 512 == 0, f"{path} must hold a workbook that can be read, got {got}."
    )
    try:
        with python_calamine.load_workbook(path if old else io.BytesIO(raw)) as book:
            check_known(f"{path}: sheet", wanted, book.sheet_names)
            found = []
            for name in wanted or book.sheet_names:
                cells = enumerate(
                    book.get_sheet_by_name(name).to_python(skip_empty_area=False), start=1
                )
                rows = [
                    (k, texts)
                    for k, row in cells
                    if any(texts := [_text_of(value) for value in row])
                ]
                found += [Sheet(path, name, rows)] if rows else []
    except python_calamine.PasswordError:
        raise InputError(
            f"{path} must be a workbook without a password, got one with. Save it without."
        ) from None
    except BaseException as error:
        panicked = (
            type(error).__name__ == "PanicException"
        )  # the library's assertions are no Exception
        if not (panicked or isinstance(error, python_calamine.CalamineError | OSError)):
            raise
        got = f"a damaged one ({error})".replace("\n", " ")
        raise InputError(
            f"{path} must hold a workbook that can be read, got {got}. Open and save it again."
        ) from None
    require(found, f"{path} must hold a table, got empty sheets. Leave it out or export it again.")
    size = sum(len(sheet.rows) * len(sheet.rows[0][1]) for sheet in found)
    require(
        size <= _LARGEST_TABLE,
        f"{path} must hold at most {_LARGEST_TABLE} cells, got {size}. Split it.",
    )
    return found


def _text_of(value: object) -> str:
    """A cell as text; a whole number without a point."""
    return (
        f"{value:.0f}"
        if isinstance(value, float) and value.is_integer() and abs(value) < 1e15
        else str(value).strip()
    )


def _check_archive(path: Path, raw: bytes) -> None:
    """Refuse what unpacks to too much, and a cell so far out that the table up to it has no room in
    memory."""
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            parts = archive.infolist()
            size, packed = (
                sum(getattr(part, own) for part in parts) for own in ("file_size", "compress_size")
            )
            got = (
                f"{size / 2**20:.0f} MB from {packed / 2**20:.2f} MB. Do not open it unless you"
                " know where it comes from"
            )
            most = f"{_LARGEST_UNPACKED / 2**20:.0f} MB and {_LARGEST_RATIO:.0f} times its size"
            fits = size <= min(_LARGEST_UNPACKED, _LARGEST_RATIO * packed + _SMALL)
            require(fits, f"{path} must unpack to at most {most}, got {got}.")
            for part in parts:
                if part.filename.startswith("xl/worksheets/") and (
                    far := _FAR.search(archive.read(part))
                ):
                    got = (
                        f"cell {far[1][:20].decode()}. Delete it, or save the sheet as 'CSV UTF-8'"
                    )
                    raise InputError(
                        f"{path} must hold its cells within column ZZ and row 99999, got {got}."
                    )
    except InputError:
        raise
    except Exception as error:  # whatever a damaged archive makes of the library
        got = f"a damaged one ({type(error).__name__})"
        raise InputError(
            f"{path} must hold a workbook that can be read, got {got}. Open and save it again."
        ) from None
