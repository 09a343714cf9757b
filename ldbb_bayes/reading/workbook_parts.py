"""Contents of an XLSX workbook other than the values of cells.

The contents are units in the number formats of cells, hidden rows, formulas without a stored value,
and cells whose text is struck through.
"""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import IO
from xml.etree import ElementTree

from ldbb_bayes.reading.words import scaled_unit

__all__ = ["PERCENT", "THOUSANDS", "SheetParts", "parts_of_sheets", "unit_shown", "xml_root"]

#: "unit" of a cell that shows its number in percent, that is, multiplied by 100
PERCENT = "%"
#: "unit" of a cell that shows its number divided by 1000, as in the format ``0.0,``
THOUSANDS = ","

_MAIN = "{http://schemas.openxmlformats.org/spreadsheetml/2006/main}"
_RELATIONS = "{http://schemas.openxmlformats.org/officeDocument/2006/relationships}"
_PACKAGE = "{http://schemas.openxmlformats.org/package/2006/relationships}"
# Regular expression for the texts that a number format shows beside the number. Such a text is in
# quotes, or is a single character after a backslash.
_TEXT_IN_FORMAT = re.compile(r'"([^"]*)"|\\(.)')
# Regular expression for commas behind the digits of a number format; each divides by 1000.
_COMMAS_BEHIND = re.compile(r"[0#?],+(?![0#?,.])")
_CELL_NAME = re.compile(r"([A-Z]+)(\d+)")
_LETTERS = 26
# Numbers of the formats 0% and 0.00%, which every XLSX workbook has without stating them.
_BUILT_IN_PERCENT = ("9", "10")
# A file inside a workbook is examined only if its size [bytes] is at most this value.
_LARGEST_PART = 64 * 2**20


@dataclass
class SheetParts:
    """Contents of one sheet of a workbook other than the values of cells."""

    #: dict with the unit in the number format of each cell that has one, such as µm in the format
    #: ``0.0 "µm"``, ``PERCENT`` or ``THOUSANDS``; each key is a pair of the line number and the
    #: column index of a cell
    units: dict[tuple[int, int], str] = field(default_factory=dict)
    hidden_lines: set[int] = field(default_factory=set)  #: line numbers of a sheet's hidden rows
    #: line number and column index of each cell that has a formula but no stored value
    formulas_without_value: set[tuple[int, int]] = field(default_factory=set)
    #: line number and column index of each cell whose text is struck through
    struck_cells: set[tuple[int, int]] = field(default_factory=set)


def parts_of_sheets(raw: bytes) -> dict[str, SheetParts]:
    """Return a dict with the contents of each sheet other than the values of its cells.

    These contents are hidden rows, units in number formats, formulas without a stored value, and
    cells whose text is struck through.
    The keys of the dict are the names of the sheets. ``raw`` is the content of the file. The dict
    is empty if the file is not in the format XLSX or cannot be read.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            units = _units_of_styles(archive)
            struck_styles = _struck_styles(archive)
            parts = {}
            for name, path in _paths_of_sheets(archive).items():
                with archive.open(path) as stream:
                    parts[name] = _parts_of_sheet(stream, units, struck_styles)
            return parts
    except (KeyError, ValueError, ElementTree.ParseError, zipfile.BadZipFile):
        return {}


def xml_root(archive: zipfile.ZipFile, path: str) -> ElementTree.Element:
    """Return the root element of an XML file. ``path`` is its path inside the workbook.

    Raise a ValueError if the XML file is too large to be examined. ``archive`` is the open
    workbook.
    """
    if archive.getinfo(path).file_size > _LARGEST_PART:
        raise ValueError(path)
    return ElementTree.fromstring(archive.read(path))


def _paths_of_sheets(archive: zipfile.ZipFile) -> dict[str, str]:
    """Return a dict with the paths of the sheets inside the workbook. The keys are sheet names.

    ``archive`` is the open workbook.
    """
    targets = {}
    for relation in xml_root(archive, "xl/_rels/workbook.xml.rels").iter(f"{_PACKAGE}Relationship"):
        target = relation.get("Target", "")
        targets[relation.get("Id")] = target.lstrip("/") if target[:1] == "/" else f"xl/{target}"
    paths = {}
    for sheet in xml_root(archive, "xl/workbook.xml").iter(f"{_MAIN}sheet"):
        path = targets.get(sheet.get(f"{_RELATIONS}id"))
        if path in archive.namelist():
            paths[sheet.get("name", "")] = str(path)
    return paths


def _units_of_styles(archive: zipfile.ZipFile) -> dict[str, str]:
    """Return a dict with the units in the number formats of cell styles.

    The keys are the numbers of the styles as texts. Styles without a unit are left out. ``archive``
    is the open workbook.
    """
    if "xl/styles.xml" not in archive.namelist():
        return {}
    root = xml_root(archive, "xl/styles.xml")
    unit_by_format: dict[str | None, str] = dict.fromkeys(_BUILT_IN_PERCENT, PERCENT)
    for number_format in root.iter(f"{_MAIN}numFmt"):
        unit = _unit_in_format(number_format.get("formatCode", ""))
        if unit:
            unit_by_format[number_format.get("numFmtId")] = unit
    units = {}
    styles = root.find(f"{_MAIN}cellXfs")
    if styles is not None:
        for number, style in enumerate(styles):
            format_id = style.get("numFmtId")
            if format_id in unit_by_format:
                units[str(number)] = unit_by_format[format_id]
    return units


def _struck_styles(archive: zipfile.ZipFile) -> set[str]:
    """Return the numbers, as texts, of the cell styles whose font is struck through.

    ``archive`` is the open workbook.
    """
    if "xl/styles.xml" not in archive.namelist():
        return set()
    root = xml_root(archive, "xl/styles.xml")
    fonts = root.find(f"{_MAIN}fonts")
    styles = root.find(f"{_MAIN}cellXfs")
    if fonts is None or styles is None:
        return set()
    struck_fonts = set()
    for number, font in enumerate(fonts):
        strike = font.find(f"{_MAIN}strike")
        if strike is not None and strike.get("val", "1") not in ("0", "false"):
            struck_fonts.add(str(number))
    struck_styles = set()
    for number, style in enumerate(styles):
        if style.get("fontId") in struck_fonts:
            struck_styles.add(str(number))
    return struck_styles


def _unit_in_format(code: str) -> str:
    """Return the unit that a number format shows after numbers, such as mm for ``0.000" mm"``.

    A word that is not a known unit is returned as written. The result is ``PERCENT`` or
    ``THOUSANDS`` for a format that shows another number than is stored, and empty if the number
    format has no word. ``code`` is the number format.
    """
    positive = code.split(";")[0]
    marks = _TEXT_IN_FORMAT.sub("", positive)
    if PERCENT in marks:
        return PERCENT
    if _COMMAS_BEHIND.search(marks):
        return THOUSANDS
    text = "".join(quoted or escaped for quoted, escaped in _TEXT_IN_FORMAT.findall(positive))
    return unit_shown(text)


def unit_shown(text: str) -> str:
    """Return the unit in the text that a number format shows beside a number.

    A word that is not a known unit is returned as written. The result is empty if the text has no
    word.
    """
    text = text.strip("[]() ")
    unit = scaled_unit(text)
    if not unit and re.search(r"[^\W\d_]", text):
        return text
    return unit


def _parts_of_sheet(
    stream: IO[bytes], units: Mapping[str, str], struck_styles: Collection[str]
) -> SheetParts:
    """Return what an XLSX sheet holds besides the values of its cells.

    ``stream`` is the XML of the sheet. ``units`` is a dict with the unit in the number format of
    each style of cells; its keys are the numbers of the styles. ``struck_styles`` are the numbers
    of the styles whose font is struck through.
    """
    parts = SheetParts()
    for element in _elements(stream):
        if element.tag == f"{_MAIN}row":
            if element.get("hidden") in ("1", "true"):
                parts.hidden_lines.add(int(element.get("r", "0")))
            element.clear()
            continue
        place = _place_of(element.get("r", ""))
        if place is None:
            continue
        unit = units.get(element.get("s", ""))
        if unit is not None:
            parts.units[place] = unit
        if element.get("s", "") in struck_styles:
            parts.struck_cells.add(place)
        if element.find(f"{_MAIN}f") is not None and not element.findtext(f"{_MAIN}v"):
            parts.formulas_without_value.add(place)
    return parts


def _elements(stream: IO[bytes]) -> Iterator[ElementTree.Element]:
    """Yield the XML elements of the cells and rows of a sheet. Each row follows its cells.

    ``stream`` is the XML of the sheet.
    """
    for _, element in ElementTree.iterparse(stream):
        if element.tag in (f"{_MAIN}c", f"{_MAIN}row"):
            yield element


def _place_of(name: str) -> tuple[int, int] | None:
    """Return the line number and the column index of the cell that has a given name, such as B2.

    Return None if ``name`` is not the name of a cell.
    """
    match = _CELL_NAME.fullmatch(name)
    if match is None:
        return None
    column = 0
    for letter in match[1]:
        column = _LETTERS * column + ord(letter) - ord("A") + 1
    return int(match[2]), column - 1
