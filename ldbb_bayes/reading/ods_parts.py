"""Contents of an ODS workbook other than the values of cells.

The contents are units in the number formats of cells, hidden rows, formulas without a stored value,
and cells whose text is struck through.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Collection, Iterator, Mapping
from xml.etree import ElementTree

from ldbb_bayes.reading.workbook_parts import PERCENT, THOUSANDS, SheetParts, unit_shown, xml_root

__all__ = ["parts_of_ods"]

_OASIS = "urn:oasis:names:tc:opendocument:xmlns"
_TABLE = f"{{{_OASIS}:table:1.0}}"
_STYLE = f"{{{_OASIS}:style:1.0}}"
_NUMBER = f"{{{_OASIS}:datastyle:1.0}}"
_OFFICE = f"{{{_OASIS}:office:1.0}}"
# A row or cell that is repeated more often than this fills the rest of a sheet, without numbers.
_MOST_REPEATED = 1000
# A style is based on a parent, which may be based on another style, at most this many times.
_MOST_PARENTS = 10
# Attributes of a cell that hold its value.
_VALUES = ("value", "time-value", "date-value", "string-value", "boolean-value")


def parts_of_ods(raw: bytes) -> dict[str, SheetParts]:
    """Return a dict with the contents of each sheet other than the values of its cells.

    The keys of the dict are the names of the sheets. The dict is empty if the file is not in the
    format ODS or cannot be read.

    Parameters
    ----------
    raw
        Content of the file.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            return _parts_of_archive(archive)
    except (KeyError, ValueError, ElementTree.ParseError, zipfile.BadZipFile):
        return {}


def _parts_of_archive(archive: zipfile.ZipFile) -> dict[str, SheetParts]:
    """Return what `parts_of_ods` returns; ``archive`` is the file.

    Raise an error if the archive has no content, or if the content is damaged.
    """
    content = xml_root(archive, "content.xml")
    roots = [content]
    if "styles.xml" in archive.namelist():
        roots.insert(0, xml_root(archive, "styles.xml"))
    units = _units_of_styles(roots)
    struck_styles = _struck_styles(roots)
    parts = {}
    for table in content.iter(f"{_TABLE}table"):
        parts[table.get(f"{_TABLE}name", "")] = _parts_of_table(table, units, struck_styles)
    return parts


def _units_of_styles(roots: list[ElementTree.Element]) -> dict[str, str]:
    """Return a dict with the units in the number formats of cell styles.

    The keys are the names of the styles; an empty unit stands for a format without a unit. Styles
    without a number format are left out. ``roots`` are the files that hold styles. If two of them
    use one name, for two styles or formats, the later file overrides the earlier one.
    """
    unit_by_format = {}
    units = {}
    for root in roots:
        for data_style in root.iter(f"{_NUMBER}number-style"):
            texts = [text.text or "" for text in data_style.findall(f"{_NUMBER}text")]
            unit = unit_shown("".join(texts))
            digits = data_style.find(f"{_NUMBER}number")
            if digits is not None and digits.get(f"{_NUMBER}display-factor", "1") != "1":
                unit = THOUSANDS
            unit_by_format[data_style.get(f"{_STYLE}name")] = unit
        for percentage_style in root.iter(f"{_NUMBER}percentage-style"):
            unit_by_format[percentage_style.get(f"{_STYLE}name")] = PERCENT
        for style in root.iter(f"{_STYLE}style"):
            number_format = style.get(f"{_STYLE}data-style-name")
            if number_format is not None:
                units[style.get(f"{_STYLE}name", "")] = unit_by_format.get(number_format, "")
    return units


def _struck_styles(roots: list[ElementTree.Element]) -> set[str]:
    """Return the names of the cell styles whose text is struck through.

    ``roots`` are the files that hold styles. A style without a statement on this takes over that of
    its parent, the style on which it is based.
    """
    parents: dict[str, str] = {}
    lines: dict[str, str] = {}
    for root in roots:
        for style in root.iter(f"{_STYLE}style"):
            name = style.get(f"{_STYLE}name", "")
            parents[name] = style.get(f"{_STYLE}parent-style-name", "")
            for properties in style.iter(f"{_STYLE}text-properties"):
                lines[name] = properties.get(f"{_STYLE}text-line-through-style", "")
    return {name for name in parents if _line_through(name, parents, lines) != "none"}


def _line_through(name: str, parents: Mapping[str, str], lines: Mapping[str, str]) -> str:
    """Return how a style strikes text through, such as "solid"; "none" if it does not.

    ``parents`` are the names of the styles on which the styles are based, and ``lines`` state how
    the styles themselves strike text through; an entry is empty if a style does not state it. The
    keys are the names of the styles; ``name`` is one of them.
    """
    for _ in range(_MOST_PARENTS):
        line = lines.get(name, "")
        if line:
            return line
        name = parents.get(name, "")
    return "none"


def _parts_of_table(
    table: ElementTree.Element, units: Mapping[str, str], struck_styles: Collection[str]
) -> SheetParts:
    """Return what a sheet holds besides the values of its cells.

    ``units`` is a dict with the unit in the number format of each style of cells; its keys are the
    names of the styles. ``struck_styles`` are the names of the styles whose text is struck through.
    """
    parts = SheetParts()
    styles = _styles_of_columns(table)
    line = 0
    for row in table.iter(f"{_TABLE}table-row"):
        n_rows = _times_repeated(row, "rows")
        if n_rows > _MOST_REPEATED:
            line += n_rows
            continue
        for _ in range(n_rows):
            line += 1
            if row.get(f"{_TABLE}visibility") in ("collapse", "filter"):
                parts.hidden_lines.add(line)
            for column, cell, style in _styled_cells(row, styles):
                _add_cell(parts, (line, column), cell, units.get(style, ""))
                if style in struck_styles:
                    parts.struck_cells.add((line, column))
    return parts


def _styled_cells(
    row: ElementTree.Element, styles: Mapping[int, str]
) -> Iterator[tuple[int, ElementTree.Element, str]]:
    """Yield the column index, the XML element and the name of the style of each cell of a row.

    ``styles`` are the styles of the columns. A cell without a style has that of its row, or else
    that of its column.
    """
    style_of_row = row.get(f"{_TABLE}default-cell-style-name")
    for column, cell in _cells_of(row):
        style = cell.get(f"{_TABLE}style-name") or style_of_row or styles.get(column, "")
        yield column, cell, style


def _add_cell(
    parts: SheetParts, place: tuple[int, int], cell: ElementTree.Element, unit: str
) -> None:
    """Add the unit of a cell to ``parts``, or the cell if it has a formula without a value.

    ``place`` holds the line number and the column index of the cell. ``unit`` is the unit in its
    number format; it is empty if there is none.
    """
    has_value = any(cell.get(f"{_OFFICE}{name}") is not None for name in _VALUES)
    if cell.get(f"{_OFFICE}value-type") == "percentage":
        unit = PERCENT
    if has_value and unit:
        parts.units[place] = unit
    is_formula = cell.get(f"{_TABLE}formula") is not None
    if is_formula and not has_value and not "".join(cell.itertext()).strip():
        parts.formulas_without_value.add(place)


def _cells_of(row: ElementTree.Element) -> Iterator[tuple[int, ElementTree.Element]]:
    """Yield the column index and the XML element of each cell of a row."""
    column = 0
    for cell in row:
        if cell.tag not in (f"{_TABLE}table-cell", f"{_TABLE}covered-table-cell"):
            continue
        n_cells = _times_repeated(cell, "columns")
        if n_cells <= _MOST_REPEATED:
            for index in range(column, column + n_cells):
                yield index, cell
        column += n_cells


def _styles_of_columns(table: ElementTree.Element) -> dict[int, str]:
    """Return a dict with the default style of the cells of each column; the keys are indices."""
    styles: dict[int, str] = {}
    column = 0
    for element in table.iter(f"{_TABLE}table-column"):
        n_columns = _times_repeated(element, "columns")
        style = element.get(f"{_TABLE}default-cell-style-name")
        if style and n_columns <= _MOST_REPEATED:
            styles |= dict.fromkeys(range(column, column + n_columns), style)
        column += n_columns
    return styles


def _times_repeated(element: ElementTree.Element, kind: str) -> int:
    """Return how often a row, column or cell is repeated; ``kind`` is "rows" or "columns"."""
    return int(element.get(f"{_TABLE}number-{kind}-repeated", "1"))
