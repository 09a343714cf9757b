"""Companion files: files without readings among the imported files, such as a test report."""

from __future__ import annotations

import io
import re
import zipfile
from pathlib import Path

from ldbb_bayes.campaign.circular_test import FEWEST_READINGS
from ldbb_bayes.campaign.text_decoding import ARCHIVE_SIGNATURE
from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.heading import Heading
from ldbb_bayes.reading.numerals import NUMBER_IN_TEXT
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.words import LONGEST_NAME, LONGEST_TEXT

__all__ = [
    "holds_temperatures",
    "holds_text_only",
    "is_document",
    "or_left_out",
    "without_columns",
    "without_table",
]

# First bytes of PDF files and pictures, which hold no table that can be read.
_PICTURE_SIGNATURES = (
    b"%PDF-",
    b"\x89PNG\r\n",
    b"\xff\xd8\xff",
    b"GIF8",
    b"II*\x00",
    b"MM\x00*",
)
# Names of files inside a zip file by which a Word document or a PowerPoint presentation is
# recognised.
_PARTS_OF_DOCUMENTS = ("word/document.xml", "ppt/presentation.xml")
# Content of the file "mimetype" inside a zipped text document in the OpenDocument format.
_MIME_TYPE_OF_TEXT = b"application/vnd.oasis.opendocument.text"
# Units of temperature as headers write them.
_UNITS_OF_TEMPERATURE = ("°C", "degC", "C", "K", "°F", "℃")
# Regular expression for a number that is not part of a word.
_NUMBER = re.compile(rf"(?<![\w.,]){NUMBER_IN_TEXT}(?!\w)")


def is_document(raw: bytes) -> bool:
    """Return whether a file is a picture, a PDF file, a text document or a presentation.

    ``raw`` is the content of the file.
    """
    if raw.startswith(_PICTURE_SIGNATURES):
        return True
    if not raw.startswith(ARCHIVE_SIGNATURE):
        return False
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            names = archive.namelist()
    except zipfile.BadZipFile:
        # this file begins like a zip archive, but is not one: it is a damaged workbook, for which a
        # later check raises an error
        return False
    if any(name in names for name in _PARTS_OF_DOCUMENTS):
        return True
    # In an OpenDocument archive, the file "mimetype" comes first and is not compressed.
    return _MIME_TYPE_OF_TEXT in raw[:200]


def holds_text_only(sheet: Sheet) -> bool:
    """Return whether a sheet holds text, and too few numbers for the readings of a circle.

    An example is a description of the measurement. The result is false for a sheet without rows,
    such as the sheet of a PDF file, whose content is unknown.
    """
    n_lines = 0
    for _, text in sheet.texts(sheet.rows):
        numbers = _NUMBER.findall(text[:LONGEST_TEXT])
        is_number = len(numbers) == 1 and text.strip(" ;,|\t") == numbers[0].strip()
        n_lines += len(numbers) >= 2 or is_number
    return bool(sheet.rows) and n_lines < FEWEST_READINGS


def holds_temperatures(heading: Heading) -> bool:
    """Return whether all columns of readings in a table have a unit of temperature."""
    units = [heading.units[column] for column in heading.readings]
    return bool(units) and all(unit in _UNITS_OF_TEMPERATURE for unit in units)


def without_table(sheet: Sheet, error: InputError) -> InputError:
    """Return the error for a file that has no table, although other files of the campaign have one.

    ``error`` is the error that the search for the table raised.
    """
    if not sheet.rows:
        return InputError(
            f"{sheet.place} must hold a table, got a document or a picture. Leave it out, or save"
            " its table as CSV."
        )
    return or_left_out(error, sheet.path)


def or_left_out(error: InputError, path: Path) -> InputError:
    """Return the error about one of several files, with the added advice to leave out this file."""
    return InputError(f"{error} If it holds no circle, leave this file out: {path.name}.")


def without_columns(sheet: Sheet, heading: Heading) -> InputError:
    """Return the `InputError` for a table that lacks a column of angles or a column of readings.

    The other files have such columns. The table may hold, for example, pressures and forces, or
    temperatures.
    """
    headers = ", ".join(repr(header[:LONGEST_NAME]) for header in heading.headers if header)
    return InputError(
        f"{sheet.place} must hold a column of angles or times and a column of readings, got"
        f" {headers[:LONGEST_TEXT] or 'columns without names'}. If it holds no circle, leave this"
        f" file out: {sheet.path.name}. Else name its columns as in the other files, or say which"
        " they are: --angle-column, --reading-column."
    )
