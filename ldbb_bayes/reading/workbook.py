"""Functions that check a workbook (XLSX, XLS or ODS) and read its sheets."""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from datetime import timedelta
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import python_calamine

from ldbb_bayes.campaign.circular_test import FEWEST_READINGS
from ldbb_bayes.campaign.text_decoding import ARCHIVE_SIGNATURE, COMPOUND_SIGNATURE, EmptyFileError
from ldbb_bayes.campaign.text_table import LARGEST_TABLE, Row
from ldbb_bayes.errors import InputError, check_known, require
from ldbb_bayes.reading.cell_units import number_in_cell
from ldbb_bayes.reading.ods_parts import parts_of_ods
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.words import LONGEST_NAME, unit_named
from ldbb_bayes.reading.workbook_parts import PERCENT, SheetParts, parts_of_sheets

__all__ = ["WORKBOOK_SUFFIXES", "read_workbook"]

WORKBOOK_SUFFIXES = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")
_MEGABYTE = 2**20
# A workbook may not be larger than this when it is unpacked [bytes].
_LARGEST_UNPACKED = 256 * _MEGABYTE
# A workbook may grow by at most this factor when it is unpacked.
_LARGEST_RATIO = 200.0
# Small workbooks may grow by a larger factor: the unpacked size may be at most ``_LARGEST_RATIO``
# times the packed size plus this value [bytes].
_SMALL_ARCHIVE = _MEGABYTE
# Regular expression for a cell with a very high row or column number. A table that extends to this
# cell does not fit into memory.
_DISTANT_CELL = re.compile(rb'\br="([A-Z]{3,}\d+|[A-Z]+\d{6,})"')
# Size [bytes] of one sector of a compound file, the format of XLS. A complete file consists of
# whole sectors.
_SECTOR = 512
# Regular expression for a duration in hours, minutes and seconds, as ODS stores it.
_DURATION = re.compile(r"PT(\d+)H(\d\d)M(\d\d(?:[.,]\d+)?)S")
# Beginnings of the names of the files in a zipped workbook: XLSX, XLSB and ODS.
_IN_WORKBOOKS = ("xl/", "content.xml", "[Content_Types].xml", "META-INF/", "mimetype")
# Whole numbers below this are converted to texts without a decimal point; double precision holds
# them exactly.
_LARGEST_WHOLE = 1e15


def read_workbook(path: Path, raw: bytes, wanted: Sequence[str]) -> list[Sheet]:
    """Return the non-empty sheets of a workbook, with their cells as texts.

    For a cell with a formula, the value saved in the file is read.

    Parameters
    ----------
    path
        Path of the file.
    raw
        Content of the file.
    wanted
        Names of the sheets to return, or patterns with ``*`` or ``?``. If no names are given, all
        sheets that are not hidden are returned, or all sheets if every sheet is hidden.

    Raises
    ------
    InputError
        If the workbook is damaged, empty, too large or protected by a password, or if no sheet has
        one of the wanted names.
    """
    if raw.startswith(ARCHIVE_SIGNATURE):
        _check_archive(path, raw)
    is_compound = raw.startswith(COMPOUND_SIGNATURE)
    if is_compound and len(raw) % _SECTOR:
        raise _unreadable(path, "a cut one")
    # The library that reads workbooks detects a password in an XLS file only if it gets the path of
    # the file, and not its content.
    source: Any = path if is_compound else io.BytesIO(raw)
    try:
        with python_calamine.load_workbook(source) as book:
            sheets = _wanted_sheets(path, book, wanted, parts_of_sheets(raw) or parts_of_ods(raw))
    except python_calamine.PasswordError:
        raise InputError(
            f"{path} must be a workbook without a password, got one with. Save it without."
        ) from None
    except (python_calamine.CalamineError, OSError) as error:
        raise _unreadable(path, f"a damaged one ({error})") from None
    except BaseException as error:
        # Because of a bug, the library that reads workbooks may raise a PanicException. This class
        # is not derived from Exception and cannot be imported.
        if type(error).__name__ != "PanicException":
            raise
        raise _unreadable(path, f"a damaged one ({error})") from None
    if not sheets:
        raise EmptyFileError(
            f"{path} must hold a table, got empty sheets. Leave it out or export it again."
        )
    size = sum(len(sheet.rows) * len(sheet.rows[0].cells) for sheet in sheets)
    require(
        size <= LARGEST_TABLE,
        f"{path} must hold at most {LARGEST_TABLE} cells, got {size}. Split it.",
    )
    return sheets


def _unreadable(path: Path, state: str) -> InputError:
    """Return the error for a workbook that cannot be read. ``state`` says what is wrong with it."""
    return InputError(
        f"{path} must hold a workbook that can be read, got {state}. Open and save it again."
    )


def _wanted_sheets(
    path: Path,
    book: python_calamine.CalamineWorkbook,
    wanted: Sequence[str],
    parts: Mapping[str, SheetParts],
) -> list[Sheet]:
    """Return the wanted sheets of a workbook. Hidden rows and empty sheets are left out.

    ``wanted`` are the names of the wanted sheets, or patterns with ``*`` or ``?``. If no names are
    given, all sheets that are not hidden are returned, or all sheets if every sheet is hidden. The
    keys of ``parts`` are the names of sheets; each value states the hidden rows of the sheet, the
    units in its number formats, its formulas without a value, and its struck cells. ``book`` is the
    open workbook.
    """
    hidden = _hidden_sheets(book)
    visible = [name for name in book.sheet_names if name not in hidden]
    wanted = _names_matching(path, wanted, book.sheet_names, visible)
    hidden_sheets: tuple[str, ...] = ()
    sheets_not_wanted: tuple[str, ...] = ()
    if wanted:
        sheets_not_wanted = tuple(name for name in visible if name not in wanted)
    if visible and not wanted:
        hidden_sheets = hidden
    sheets = []
    for name in wanted or visible or hidden:
        sheet_parts = parts.get(name, SheetParts())
        values = book.get_sheet_by_name(name).to_python(skip_empty_area=False)
        rows = _visible_rows(values, sheet_parts)
        if rows:
            sheets.append(
                Sheet(
                    path,
                    name,
                    rows,
                    format_units=sheet_parts.units,
                    formulas_without_value=sheet_parts.formulas_without_value,
                    struck_cells=sheet_parts.struck_cells,
                    stores_numbers=not _holds_numbers_as_text(values),
                    is_examined=name in parts,
                    hidden_rows=len(sheet_parts.hidden_lines),
                    hidden_sheets=hidden_sheets,
                    sheets_not_wanted=sheets_not_wanted,
                )
            )
    return sheets


def _names_matching(
    path: Path, wanted: Sequence[str], names: Sequence[str], visible: Sequence[str]
) -> list[str]:
    """Return the names of the wanted sheets, with each pattern replaced by the matching names.

    A wanted name with ``*`` or ``?`` is a pattern, unless a sheet has exactly this name. Hidden
    sheets do not match a pattern. The matching names are in the order of the workbook, and each
    name is returned once. Raise an `InputError` if a name or pattern matches no sheet.

    Parameters
    ----------
    path
        Path of the workbook.
    wanted
        Names and patterns of the wanted sheets.
    names
        Names of all sheets of the workbook.
    visible
        Names of the sheets that a spreadsheet program shows.
    """
    patterns = {text for text in wanted if text not in names and ("*" in text or "?" in text)}
    check_known(f"{path}: sheet", [text for text in wanted if text not in patterns], names)
    selected: dict[str, None] = {}
    for text in wanted:
        if text not in patterns:
            selected[text] = None
            continue
        pattern = text.replace("[", "[[]")
        matching = [name for name in visible if fnmatchcase(name, pattern)]
        listed = ", ".join(repr(name) for name in visible)[:LONGEST_NAME]
        require(
            matching,
            f"{path}: sheets must match {text}, got none: it has {listed}. Name the sheets, or"
            " correct the pattern.",
        )
        selected |= dict.fromkeys(matching)
    return list(selected)


def _hidden_sheets(book: python_calamine.CalamineWorkbook) -> tuple[str, ...]:
    """Return the names of the sheets that a spreadsheet program does not show."""
    names = []
    for metadata in book.sheets_metadata:
        if metadata.visible != python_calamine.SheetVisibleEnum.Visible:
            names.append(metadata.name)
    return tuple(names)


def _visible_rows(values: Sequence[Sequence[object]], parts: SheetParts) -> list[Row]:
    """Return the rows of a sheet with their line numbers. Hidden and empty rows are left out.

    Outside a table of readings, the unit that a number format shows is written behind the number:
    the number 0.3 in the format ``0.0 "kN"`` becomes the text ``0.3 kN``, and 0.5 in the format
    ``0%`` becomes ``50 %``. ``values`` holds the values of the cells, row by row.
    """
    lines_of_table = _lines_of_table(values)
    rows = []
    for line, values_of_row in enumerate(values, start=1):
        texts = [_cell_text(value) for value in values_of_row]
        if line in parts.hidden_lines or not any(texts):
            continue
        if line not in lines_of_table:
            for column, value in enumerate(values_of_row):
                shown_unit = parts.units.get((line, column), "")
                if isinstance(value, float):
                    texts[column] = _text_with_unit(value, shown_unit)
        rows.append(Row(line, texts))
    return rows


def _text_with_unit(value: float, shown_unit: str) -> str:
    """Return a number as text, with the unit in its number format, as in ``0.3 kN``.

    A word in the number format that is not a known unit is left out. ``shown_unit`` is the unit in
    the number format; it is empty if there is none.
    """
    if shown_unit == PERCENT:
        return f"{100.0 * value:g} {PERCENT}"
    return f"{_cell_text(value)} {unit_named(shown_unit)}".strip()


def _lines_of_table(values: Sequence[Sequence[object]]) -> set[int]:
    """Return the line numbers of the rows that may belong to a table of readings.

    These are rows of at least ``FEWEST_READINGS`` numbers, which may hold a circle each, and
    sequences of at least as many rows that hold two numbers or more. The first row of a sequence is
    a header of loads, such as ``Angle;100;300``, if it alone begins with a word. ``values`` holds
    the values of the cells, row by row.
    """
    lines_of_table: set[int] = set()
    sequence: list[int] = []
    for line, values_of_row in enumerate(values, start=1):
        n_numbers = sum(_is_number(value) for value in values_of_row)
        if n_numbers >= FEWEST_READINGS:
            lines_of_table.add(line)
        if n_numbers < 2:
            sequence = []
            continue
        if len(sequence) == 1 and _is_number(values_of_row[0]):
            sequence = [number for number in sequence if _is_number(values[number - 1][0])]
        sequence.append(line)
        if len(sequence) >= FEWEST_READINGS:
            lines_of_table.update(sequence)
    return lines_of_table


def _is_number(value: object) -> bool:
    """Return whether a cell holds a number, also one that is stored as text, such as ``1,5 µm``."""
    return isinstance(value, float) or number_in_cell(str(value).strip()) is not None


def _holds_numbers_as_text(values: Iterable[Iterable[object]]) -> bool:
    """Return whether any cell of a sheet holds a decimal number as text, such as ``1,5 µm``.

    ``values`` holds the values of the cells, row by row.
    """
    for values_of_row in values:
        for value in values_of_row:
            has_mark = isinstance(value, str) and re.search(r"\d[.,]\d", value) is not None
            if has_mark and number_in_cell(str(value).strip()) is not None:
                return True
    return False


def _cell_text(value: object) -> str:
    """Return the value of a cell as text. A whole number is written without a decimal point.

    A duration is written with all its hours, as a spreadsheet shows it: ``175:00:00``. In ODS, it
    is stored as ``PT175H00M00S``.
    """
    duration = _DURATION.fullmatch(value) if isinstance(value, str) else None
    if duration is not None:
        return ":".join(duration.groups()).replace(",", ".")
    if isinstance(value, timedelta) and value >= timedelta(days=1):
        hours, remainder = divmod(value, timedelta(hours=1))
        minutes, seconds = divmod(remainder.total_seconds(), 60.0)
        return f"{hours}:{minutes:02.0f}:{seconds:06.3f}".removesuffix(".000")
    if isinstance(value, float) and value.is_integer() and abs(value) < _LARGEST_WHOLE:
        return f"{value:.0f}"
    return str(value).strip()


def _check_archive(path: Path, raw: bytes) -> None:
    """Raise an `InputError` for a zipped workbook that is damaged or would not fit into memory.

    XLSX and ODS files are zipped. A workbook is not expected to fit if it unpacks to too many
    bytes, or if it is an XLSX file with a very high row or column number. ``path`` is the path of
    the file, and ``raw`` its content, a ZIP archive.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            members = archive.infolist()
            holds_workbook = any(member.filename.startswith(_IN_WORKBOOKS) for member in members)
            require(
                holds_workbook or path.suffix.lower() in WORKBOOK_SUFFIXES,
                f"{path} must be unpacked, got an archive. Unpack it and name the files in it.",
            )
            _check_size(path, members)
            for member in members:
                if member.filename.startswith("xl/worksheets/"):
                    _check_cells(path, archive.read(member))
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001 - a damaged archive may raise any exception
        raise _unreadable(path, f"a damaged one ({type(error).__name__})") from None


def _check_size(path: Path, members: Sequence[zipfile.ZipInfo]) -> None:
    """Raise an `InputError` if a zipped workbook would unpack to too many bytes.

    ``members`` are the files inside the workbook.
    """
    unpacked = sum(member.file_size for member in members)
    packed = sum(member.compress_size for member in members)
    require(
        unpacked <= min(_LARGEST_UNPACKED, _LARGEST_RATIO * packed + _SMALL_ARCHIVE),
        f"{path} must unpack to at most {_LARGEST_UNPACKED / _MEGABYTE:.0f} MB and"
        f" {_LARGEST_RATIO:.0f} times its size, got {unpacked / _MEGABYTE:.0f} MB from"
        f" {packed / _MEGABYTE:.2f} MB. Do not open it unless you know where it comes from.",
    )


def _check_cells(path: Path, worksheet: bytes) -> None:
    """Raise an `InputError` if a sheet of an XLSX file has a very high row or column number.

    ``worksheet`` is the XML of the sheet.
    """
    distant = _DISTANT_CELL.search(worksheet)
    if distant:
        raise InputError(
            f"{path} must hold its cells within column ZZ and row 99999, got cell"
            f" {distant[1][:20].decode()}. Delete it, or save the sheet as 'CSV UTF-8'."
        )
