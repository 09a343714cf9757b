"""Functions that read workbooks, and text files in any encoding, as cells of text."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ldbb_bayes.campaign.text_decoding import (
    ARCHIVE_SIGNATURE,
    COMPOUND_SIGNATURE,
    decode_text,
    table_bytes,
)
from ldbb_bayes.campaign.text_table import Row, rows_of_text
from ldbb_bayes.errors import InputError, require
from ldbb_bayes.reading.aligned_headers import with_aligned_headers
from ldbb_bayes.reading.aligned_units import with_aligned_units
from ldbb_bayes.reading.binary_formats import check_is_no_binary_format
from ldbb_bayes.reading.cell_units import number_in_cell, split_units
from ldbb_bayes.reading.companion_files import is_document
from ldbb_bayes.reading.data_loggers import without_kinds_of_samples
from ldbb_bayes.reading.encodings import encoding_of
from ldbb_bayes.reading.index_rows import with_index_names
from ldbb_bayes.reading.json_tables import is_json, sheets_of_json
from ldbb_bayes.reading.labview import is_labview, rows_of_labview
from ldbb_bayes.reading.loads_between import with_loads_between
from ldbb_bayes.reading.matlab_display import displays_of_matlab, is_matlab_display
from ldbb_bayes.reading.named_numbers import rows_of_named_numbers
from ldbb_bayes.reading.octave import is_octave, sheets_of_octave
from ldbb_bayes.reading.page_marks import without_page_marks
from ldbb_bayes.reading.quoted_texts import (
    with_names_of_dump,
    without_queries,
    without_quote_marks,
)
from ldbb_bayes.reading.r_groups import with_runs_for_groups
from ldbb_bayes.reading.ragged_rows import with_remarks_joined, with_units_joined
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.single_columns import is_single_column, with_points_numbered
from ldbb_bayes.reading.sql_inserts import has_sql_inserts, sheets_of_sql_inserts
from ldbb_bayes.reading.stacked_tables import split_tables
from ldbb_bayes.reading.transposed_tables import with_circles_in_columns
from ldbb_bayes.reading.workbook import WORKBOOK_SUFFIXES, read_workbook

__all__ = ["read_sheets"]

# Table that replaces the wide characters of East Asian text, including the wide blank, by ASCII.
_NARROW = {code: code - 0xFEE0 for code in range(0xFF01, 0xFF5F)} | {0x3000: 0x20}
# Table that replaces the marks of Arabic numbers for decimals and thousands.
_ARABIC_MARKS = {0x066B: ".", 0x066C: ","}
_PLAIN: dict[int, int | str] = {**_NARROW, **_ARABIC_MARKS}
# Regular expression for a decimal number with its minus sign behind it, as some programs for
# accounting and stocks write it.
_MINUS_BEHIND = re.compile(r"(?P<number>\d[\d.,]*[.,]\d+)[-−–]")
# Regular expression for the beginning of a page in HTML, which some programs save as a workbook.
_WEB_PAGE = re.compile(rb"(?:\xef\xbb\xbf)?\s*<(?:!doctype html|html|table|meta)", re.IGNORECASE)
# Number of bytes at the beginning of a file that are examined for HTML.
_HEAD_BYTES = 200
# Ending of old workbooks. Programs of laboratories save tables of text under it, too.
_OLD_WORKBOOK = ".xls"
# First bytes of texts in UTF-16, and of files in XML, which is no table of text.
_MARKS_OF_UTF_16 = (b"\xff\xfe", b"\xfe\xff")
_XML = (b"<?xml", b"\xef\xbb\xbf<?xml")
# Regular expression for a character that no text holds, such as NUL.
_NO_TEXT = re.compile(rb"[\x00-\x08\x0e-\x1f\x7f]")
# First bytes of compressed files and archives: of gzip, bzip2, xz, 7-Zip and RAR.
_COMPRESSED = (b"\x1f\x8b", b"BZh", b"\xfd7zXZ\x00", b"7z\xbc\xaf\x27\x1c", b"Rar!\x1a\x07")
# Characters that may separate the cells of a text file, in order of preference.
_SEPARATORS = (";", "\t", "|", ",", " ")
# Characters that almost certainly separate the cells of a text file, because they seldom occur
# inside a cell.
_SURE = (";", "\t", "|")
# Score (see `_separator_score`) above which a character such as the semicolon is taken as the
# separator of a text file. Blanks are then not tried.
_SURE_SCORE = 1.3
# Number of lines of a text file that are used to compare the possible separators of cells.
_SAMPLE_LINES = 200
# Among the possible separators of cells, an earlier one in ``_SEPARATORS`` is preferred. A later
# one is chosen only if its score exceeds that of an earlier one by more than this value.
_SCORE_MARGIN = 0.02


# Signs of units that a program has encoded in UTF-8 twice.
_ENCODED_TWICE = {"Â°": "°", "Âµ": "µ", "Î¼": "μ", "Â±": "±"}


def read_sheets(
    path: Path,
    *,
    encoding: str | None = None,
    separator: str | None = None,
    sheets: Sequence[str] = (),
) -> list[Sheet]:
    """Return the sheets of a workbook, or one sheet for each table of a text file.

    Parameters
    ----------
    path
        Path of a workbook (XLSX, XLS, ODS) or a text file. A picture, or a document such as a PDF
        file, gives one sheet without rows.
    encoding, separator
        Encoding and separator of a text file; None to determine them from its content.
    sheets
        Names of the sheets to read from a workbook. If no names are given, all sheets except empty
        and hidden ones are read.

    Raises
    ------
    InputError
        If the file is neither a workbook nor a text, or if no sheet has one of the names in
        ``sheets``.
    """
    raw = table_bytes(path)
    require(
        path.suffix.lower() != ".zip" and not raw.startswith(_COMPRESSED),
        f"{path} must be unpacked, got an archive. Unpack it and name the files in it.",
    )
    if is_document(raw):
        return [Sheet(path, "", [])]
    check_is_no_binary_format(path, raw)
    if _is_workbook(path, raw):
        tables = []
        for sheet in read_workbook(path, raw, sheets):
            tables += _tables_below_each_other(_with_plain_cells(sheet))
        return tables
    if sheets:
        raise InputError(
            f"{path} must be a workbook to have sheets, got a text file with sheet {sheets[0]!r}"
            " asked for. Leave it out."
        )
    if encoding is None:
        encoding = encoding_of(raw)
    text = _with_signs_repaired(decode_text(path, raw, encoding))
    text = with_names_of_dump(without_quote_marks(text))
    text = with_runs_for_groups(without_kinds_of_samples(without_queries(text)))
    text = with_points_numbered(text)
    entries = _sheets_of_entries(Sheet(path, "", [], encoding, ","), text)
    if entries:
        return [_with_plain_cells(sheet) for sheet in entries]
    return _sheets_of_rows(path, text, encoding, separator or _find_separator(text.split("\n")))


def _with_signs_repaired(text: str) -> str:
    """Return a text with the signs of units that a program has encoded twice, such as ``Â°``."""
    for twice_encoded, sign in _ENCODED_TWICE.items():
        text = text.replace(twice_encoded, sign)
    return text


def _sheets_of_rows(path: Path, text: str, encoding: str, separator: str) -> list[Sheet]:
    """Return one sheet for each table of a text whose lines are rows of cells.

    ``separator`` is the character between the cells, and ``encoding`` is the encoding of the file.
    """
    n_removed = 0
    named_numbers = rows_of_named_numbers(text)
    if named_numbers.rows:
        sheet = Sheet(path, "", named_numbers.rows, encoding, ",", cell_units=named_numbers.units)
        return _tables_below_each_other(sheet)
    if is_labview(text):
        separator = "\t" if "\t" in text else ","
        rows = rows_of_labview(rows_of_text(path, text, separator))
    else:
        text, n_removed = without_page_marks(text, separator)
        rows = rows_of_text(path, text, separator)
    if is_matlab_display(text):
        displays = displays_of_matlab(Sheet(path, "", rows, encoding, separator), text)
        return [_with_plain_cells(display) for display in displays]
    if separator == " ":
        lines = text.split("\n")
        rows = with_aligned_units(with_aligned_headers(rows, lines), lines)
        rows = with_remarks_joined(with_units_joined(rows))
    sheet = Sheet(path, "", rows, encoding, separator, n_headers=n_removed)
    return _tables_below_each_other(_with_plain_cells(sheet))


def _tables_below_each_other(sheet: Sheet) -> list[Sheet]:
    """Return the tables that stand below each other in a sheet, each as a separate sheet."""
    upright = with_circles_in_columns(sheet)
    return split_tables(with_loads_between(with_index_names(upright)))


def _sheets_of_entries(sheet: Sheet, text: str) -> list[Sheet]:
    """Return one sheet for each table of a text in JSON, in SQL or in the format of Octave.

    The result is an empty list for a text in another format. ``sheet`` is a sheet without rows,
    which states the path of the file.
    """
    if is_json(text):
        return sheets_of_json(sheet, text)
    if is_octave(text):
        return sheets_of_octave(sheet, text)
    if has_sql_inserts(text):
        return sheets_of_sql_inserts(sheet, text)
    return []


def _is_workbook(path: Path, raw: bytes) -> bool:
    """Return whether a file with the content ``raw`` is a workbook, possibly a damaged one."""
    if raw.startswith((ARCHIVE_SIGNATURE, COMPOUND_SIGNATURE)):
        return True
    suffix = path.suffix.lower()
    if _WEB_PAGE.match(raw[:_HEAD_BYTES]) or (suffix == _OLD_WORKBOOK and _is_text(raw)):
        return False
    return suffix in WORKBOOK_SUFFIXES


def _is_text(raw: bytes) -> bool:
    """Return whether a file is a text, such as a table with tabs that was saved as ``.xls``.

    ``raw`` is the content of the file. A file in XML does not count.
    """
    if raw.startswith(_MARKS_OF_UTF_16):
        return True
    return not raw.startswith(_XML) and _NO_TEXT.search(raw) is None


def _with_plain_cells(sheet: Sheet) -> Sheet:
    """Return a sheet whose cells have no wide characters and no units after numbers.

    The wide characters of East Asian text are replaced by ASCII, and Arabic decimal marks by
    points. A minus sign behind a decimal number, as in ``3.45-``, is put before it. The units are
    moved to the field ``cell_units`` of the sheet.
    """
    rows = []
    for row in sheet.rows:
        rows.append(Row(row.line, [_plain_cell(cell) for cell in row.cells]))
    split = split_units(rows)
    return replace(sheet, rows=split.rows, cell_units=split.units)


def _plain_cell(cell: str) -> str:
    """Return a cell as `_with_plain_cells` describes it, with its unit."""
    plain = cell.translate(_PLAIN).strip()
    minus_behind = _MINUS_BEHIND.fullmatch(plain)
    return f"-{minus_behind['number']}" if minus_behind else plain


def _find_separator(lines: Sequence[str]) -> str:
    """Return the character that probably separates the cells of a text file.

    This character splits most lines into the same number of cells, many of which are numbers. The
    first third of the lines is not considered, because these lines may stand above the table. If no
    character splits the lines, the comma is returned. In a single column of readings, a comma is a
    decimal mark; the semicolon is then returned.
    """
    if is_single_column(lines):
        return ";"
    sample = [line for line in lines if line.strip()]
    sample = sample[len(sample) // 3 :][:_SAMPLE_LINES]
    best_separator = ","
    best_score = 0.0
    if not sample:
        return best_separator
    for separator in _SEPARATORS:
        if separator == " " and best_separator in _SURE and best_score > _SURE_SCORE:
            # The best separator found so far, such as a semicolon, is almost certainly right.
            # Blanks are then parts of cells, as in "100 N".
            continue
        score = _separator_score(sample, separator)
        if score > best_score + _SCORE_MARGIN:
            best_separator = separator
            best_score = score
    return best_separator


def _separator_score(sample: Sequence[str], separator: str) -> float:
    """Return a score from 0 to 2 that is large if ``separator`` probably separates the cells.

    The score is p (1 + q), where p is the fraction of the lines in ``sample`` that have the
    most frequent number of cells, and q is the fraction of the filled cells of these lines that are
    numbers. The score is zero if the most frequent number of cells is one.
    """
    rows = []
    for line in sample:
        if separator == " ":
            rows.append(line.split())
        else:
            rows.append([cell.strip(' "') for cell in line.split(separator)])
    widths = [len(cells) for cells in rows]
    usual_width = max(sorted(set(widths)), key=widths.count)
    if usual_width == 1:
        return 0.0
    n_filled = 0
    n_numbers = 0
    for cells in rows:
        if len(cells) != usual_width:
            continue
        filled = [cell for cell in cells if cell]
        n_filled += len(filled)
        n_numbers += sum(number_in_cell(cell) is not None for cell in filled)
    share = widths.count(usual_width) / len(widths)
    return share * (1.0 + n_numbers / max(n_filled, 1))
