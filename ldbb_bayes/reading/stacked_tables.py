"""Several tables below each other in one sheet: pages of one table, or one table per test.

The header of the first table is repeated above each further table.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence, Set
from dataclasses import replace

from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.reading.column_roles import names_runs
from ldbb_bayes.reading.header_rows import count_numbers, is_rule, names_any_role, names_columns
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.line_parts import segments_of_line
from ldbb_bayes.reading.lines_above import statements_in
from ldbb_bayes.reading.names import load_in_name, radii_of_columns
from ldbb_bayes.reading.role_words import has_role
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.timestamps import stamps_in, without_stamps
from ldbb_bayes.reading.travel_direction import direction_named, directions_stated
from ldbb_bayes.reading.unit_rows import row_of_units
from ldbb_bayes.reading.words import comparable

__all__ = [
    "first_header",
    "is_row_of_numbers",
    "lines_that_still_apply",
    "named_sheets",
    "split_tables",
]

# Regular expression for a cell that is empty or holds only the number of a printed page, such as
# "Page 2 of 3".
_PAGE = re.compile(
    r"\W*(?:page|seite|blatt|pagina|página|стр\.?|第)?\W*\d*"
    r"\W*(?:of|von|de|di|/|из)?\W*\d*\W*(?:页|頁)?",
    re.IGNORECASE,
)
# Regular expression for a word, such as "continued", which says that a table is continued on a
# further page.
_CONTINUED = re.compile(
    r"continued|cont|fortsetzung|forts|suite|segue|continua\w*|continuación|pokračování"
)
# A row that begins with a word may be a sentence if it has at least this number of words for each
# number.
_WORDS_PER_NUMBER = 2
# Texts in which the import repeats a value, such as the radius, above a later table of the same
# sheet. This is needed if a line above the first table states several values, and only some of them
# also apply to the later table. The keys are the names of the fields of a test. The value takes the
# place of the braces.
_STATED_AS = {
    "plane": "plane {}",
    "radius_mm": "radius {:g} mm",
    "feed_mm_per_min": "feed {:g} mm/min",
}


def split_tables(sheet: Sheet) -> list[Sheet]:
    """Return the tables that stand below each other in a sheet, each as a separate sheet.

    A repeated header begins a further table in three cases: if a line such as ``Direction: CCW``
    stands above it, if a line above it names another run, as in ``Run 2``, or if the first cell
    below it is the same as in the first table, such as 0°. Any other repeated header is removed,
    together with a page number and a repeated title above it, and the table continues. A line above
    the first table also applies to a further table, unless a line above the further table states
    the same property, such as the force.
    """
    header = first_header(sheet.rows)
    if header is None:
        return [sheet]
    headers = _repeated_headers(sheet.rows, header)
    if not headers:
        return [sheet]
    tables = [list(sheet.rows[: header + 1])]
    lines_above_first = sheet.rows[:header]
    lines_above_table = lines_above_first
    first_row = header + 1  # index of the row below the header that was examined last
    for next_header in headers:
        end = _end_of_numbers(sheet.rows, first_row, next_header)
        tables[-1] += sheet.rows[first_row:end]
        lines_between = sheet.rows[end:next_header]
        begins_anew = _begins_anew(sheet.rows, header, next_header)
        begins_anew |= _name_another_run(sheet, lines_above_table, lines_between)
        lines = [row for row in lines_between if not _is_of_page(row, lines_above_first)]
        if not begins_anew:
            lines = _without_titles(sheet, lines, lines_above_first)
        if lines or begins_anew:
            lines_of_first = lines_that_still_apply(sheet, lines_above_first, lines)
            tables.append([*lines_of_first, *lines, sheet.rows[next_header]])
            lines_above_table = lines_between
        first_row = next_header + 1
        if not (lines or begins_anew):
            first_row = _row_below_units(sheet.rows, header, next_header)
    tables[-1] += sheet.rows[first_row:]
    if len(tables) == 1:
        return [replace(sheet, rows=tables[0], n_headers=len(headers))]
    return named_sheets(sheet, tables)


def _repeated_headers(rows: Sequence[Row], header: int) -> list[int]:
    """Return the indices of the rows below the header that repeat the header.

    ``header`` is the index of the header among the rows.
    """
    wanted = [comparable(cell) for cell in rows[header].cells]
    repeated = []
    for k in range(header + 1, len(rows)):
        cells = rows[k].cells
        if len(cells) != len(wanted):
            continue
        if all(comparable(cell) == title for cell, title in zip(cells, wanted, strict=True)):
            repeated.append(k)
    return repeated


def _end_of_numbers(rows: Sequence[Row], start: int, header: int) -> int:
    """Return the index of the row that follows the last row of numbers of a table.

    ``start`` is the index of the first row below the header of the table, and ``header`` is the
    index of the next header. If no row between the two headers holds numbers, the result is
    ``start``.
    """
    width = len(rows[header].cells)
    end = header
    while end > start and not is_row_of_numbers(rows[end - 1].cells, width):
        end -= 1
    return end


def is_row_of_numbers(cells: Sequence[str], width: int) -> bool:
    """Return whether a row has at least two numbers and is not a sentence.

    A sentence, such as ``Run 2: force 122 N, plane XY, radius 150 mm`` divided at its blanks,
    begins with a word, has many words for each number, and differs from the table in the number of
    its cells.
    ``width`` is the number of cells of the header of the table.
    """
    n_numbers = count_numbers(cells)
    if n_numbers < 2:
        return False
    n_words = sum(cell != "" for cell in cells) - n_numbers
    is_sentence = count_numbers(cells[:1]) == 0 and n_words >= _WORDS_PER_NUMBER * n_numbers
    return len(cells) == width or not is_sentence


def first_header(rows: Sequence[Row]) -> int | None:
    """Return the index of the first header of a table; None if there is no header.

    A header names columns, and a table of numbers begins below it, directly or below a row of units
    or a line of dashes. A row is not a header if it states loads or directions for the columns, or
    if the row below it names angles and readings. A row of directions is a header if its first cell
    names the angles, and numbers or units stand directly below it.
    """
    for k in range(len(rows) - 1):
        cells = rows[k].cells
        if not (names_columns(cells) and any(names_any_role(cell) for cell in cells)):
            continue
        # A row above the header, for example a row of loads, may look like a header.
        is_above_header = _describes_columns(cells) and not _heads_directions(rows, k)
        if is_above_header or _names_circle(rows[k + 1].cells):
            continue
        if _stands_above_numbers(rows, k):
            return k
    return None


def _stands_above_numbers(rows: Sequence[Row], header: int) -> bool:
    """Return whether a table of numbers begins below a row, directly or below a row of units.

    Two of the three rows below the header must hold numbers, because a single row with numbers may
    be a short sentence, such as ``36 N, radius 150 mm``. Lines of dashes that underline the header
    are skipped. Near the end of the sheet, a single row of numbers is enough. ``header`` is the
    index of the header among the rows.
    """
    below = [row for row in rows[header + 1 : header + 6] if not is_rule(row.cells)][:3]
    width = len(rows[header].cells)
    n_with_numbers = sum(is_row_of_numbers(row.cells, width) for row in below)
    return n_with_numbers >= 2 or (n_with_numbers == 1 and len(below) < 3)


def _names_circle(cells: Sequence[str]) -> bool:
    """Return whether a row is a header with both a column of angles and a column of readings."""
    if not names_columns(cells):
        return False
    names = [unit_of(cell).name for cell in cells]
    has_angle = any(has_role(name, "angle") for name in names)
    return has_angle and any(has_role(name, "reading") for name in names)


def _describes_columns(cells: Sequence[str]) -> bool:
    """Return whether a row states a direction, a load or a radius for each column but the first.

    The first cell of such a row is a label. Further cells may be empty, because they are merged
    with the cell to the left of them. A load is a force or a pressure. Examples are
    ``Direction;CW;;CCW;`` and ``Force;100 N;300 N``.
    """
    stated = [cell for cell in cells[1:] if cell]
    # A row of two cells may be a label and its value, as in Force;300 N.
    if len(cells) < 3 or not stated:
        return False
    if {direction_named(cell) for cell in stated} <= {"CW", "CCW"} or radii_of_columns(cells):
        return True
    label = unit_of(cells[0]).name
    is_load = has_role(label, "force") or has_role(label, "pressure")
    return is_load and all(load_in_name([cell]) is not None for cell in stated)


def _heads_directions(rows: Sequence[Row], k: int) -> bool:
    """Return whether row ``k`` is a header of directions, such as ``Angle;CW;CCW;CW;CCW``.

    Its first cell names the angles, each other cell is a direction, and the row directly below
    holds numbers or units.
    """
    cells = rows[k].cells
    below = rows[k + 1].cells
    if not has_role(unit_of(cells[0]).name, "angle"):
        return False
    if not {direction_named(cell) for cell in cells[1:]} <= {"CW", "CCW"}:
        return False
    return is_row_of_numbers(below, len(cells)) or bool(row_of_units(below, ","))


def _row_below_units(rows: Sequence[Row], first_header: int, header: int) -> int:
    """Return the index of the first row below a repeated header and its rows of units or dashes.

    A row of units or dashes is recognised because the same row, which must hold no numbers, stands
    at the same distance below the first header.
    ``first_header`` and ``header`` are the indices of the two headers among the rows.
    """
    n_repeated = 1
    while first_header + n_repeated < header and header + n_repeated < len(rows):
        cells = rows[header + n_repeated].cells
        if cells != rows[first_header + n_repeated].cells or count_numbers(cells):
            break
        n_repeated += 1
    return header + n_repeated


def _begins_anew(rows: Sequence[Row], first_header: int, header: int) -> bool:
    """Return whether the first rows below two headers begin with the same cell, such as 0°.

    Rows of units or dashes are skipped if they stand below both headers. ``first_header`` and
    ``header`` are the indices of the two headers among the rows.
    """
    below = _row_below_units(rows, first_header, header)
    below_first = first_header + below - header
    first_cells = [row.cells[:1] for row in (*rows[below_first:][:1], *rows[below:][:1])]
    return len(first_cells) == 2 and first_cells[0] == first_cells[1]


def _name_another_run(sheet: Sheet, lines: Sequence[Row], further_lines: Sequence[Row]) -> bool:
    """Return whether the lines above two tables name different runs, such as "Run 1" and "Run 2".

    A line names a run if it consists of a word such as "Run" and a number. ``lines`` are the lines
    above the first of the two tables, and ``further_lines`` are those above the second.
    """
    names = [text.strip() for _, text in sheet.texts(lines)]
    for _, text in sheet.texts(further_lines):
        if any(names_runs([name, text.strip()]) for name in names):
            return True
    return False


def _is_of_page(row: Row, lines_above_first: Sequence[Row]) -> bool:
    """Return whether a row holds only a page number, or repeats a row above the first table."""
    if any(row.cells == other.cells for other in lines_above_first):
        return True
    return all(_PAGE.fullmatch(cell) is not None for cell in row.cells)


def _without_titles(sheet: Sheet, lines: Sequence[Row], first: Sequence[Row]) -> list[Row]:
    """Return the lines above a repeated header without the titles that pages of a table repeat.

    A title differs from a line above the first table only in its numbers or by a word such as
    "continued". For example, ``Test 7, page 2`` repeats the title ``Test 7, page 1``. A line that
    states a property of a test, such as the force, is never a title. A title that states a time is
    kept if at least one of the other lines is not a title, because a further test then begins here,
    and the time may be its start.

    Parameters
    ----------
    sheet
        The sheet.
    lines
        Lines above the repeated header.
    first
        Lines above the first table.
    """
    titles = {_without_numbers(sheet.text_of(row.cells)) for row in first}
    is_title = {}
    for row in lines:
        text = sheet.text_of(row.cells)
        is_repeated = _without_numbers(text) in titles or not _without_numbers(text)
        states_load = load_in_name([text]) is not None
        states_field = bool(_keys_of(sheet, [row]) - {"time", "date"})
        is_title[row.line] = is_repeated and not (states_load or states_field)
    if all(is_title.values()):
        return []
    return [row for row in lines if not is_title[row.line] or "time" in _keys_of(sheet, [row])]


def _without_numbers(text: str) -> str:
    """Return the words of a line in lower case, without numbers and words such as "continued".

    Titles that differ only in numbers, such as ``Test 7, page 1`` and ``Test 7, page 2``, thus
    become equal.
    """
    words = re.findall(r"[^\W\d_]+", comparable(text))
    return " ".join(word for word in words if not _CONTINUED.fullmatch(word))


def lines_that_still_apply(sheet: Sheet, first: Sequence[Row], lines: Sequence[Row]) -> list[Row]:
    """Return the lines above the first table that also apply to a further table.

    ``first`` are all lines above the first table, and ``lines`` are the lines above the further
    table. If ``lines`` state a new value of a field, such as the force, the old value is removed
    from its line, and the rest of the line is kept. For example, a line of ``first`` may begin with
    a date. If ``lines`` state another date, only the text after the old date is returned.
    """
    stated = _keys_of(sheet, lines)
    lines_that_apply = []
    for row in first:
        text = sheet.text_of(row.cells)
        if not _keys_of_text(text) & stated:
            lines_that_apply.append(row)
            continue
        remaining = _without_fields(text, stated)
        if remaining:
            lines_that_apply.append(row._replace(cells=[remaining]))
    return lines_that_apply


def _without_fields(text: str, fields: Set[str]) -> str:
    """Return a line without its statements about ``fields``, such as the force.

    Each segment of the line that states one of these fields is left out. If such a segment also
    states another field, as in ``238 N in plane ZX``, the value of the other field is kept as
    ``plane ZX``. The result is empty if nothing remains.
    """
    if "time" in fields:
        text = without_stamps(text)
    segments = []
    for segment in segments_of_line(text):
        if not _keys_of_text(segment) & fields:
            segments.append(segment.strip())
    remaining = "; ".join(segments)
    # In a line such as "Operator;Meier", neither segment states a field alone, but both together
    # do. If the remaining segments together state one of ``fields`` in this way, none of them is
    # kept.
    if _keys_of_text(remaining) & fields or not re.search(r"[^\W\d_]", remaining):
        remaining = ""
    restated = _restated(text, fields | _keys_of_text(remaining))
    return "; ".join([text for text in (remaining, *restated) if text])


def _restated(text: str, except_fields: Set[str]) -> list[str]:
    """Return texts, such as ``plane ZX``, that repeat what a line states about certain fields.

    These fields are the plane, the radius, the feed and the direction of travel. Those in
    ``except_fields`` are left out.
    """
    segments = []
    statements = statements_in([(0, text)])
    for field, words in _STATED_AS.items():
        for statement in statements.get(field, ())[:1]:
            is_unclear = isinstance(statement.value, float) and math.isnan(statement.value)
            if field not in except_fields and not is_unclear:
                segments.append(words.format(statement.value))
    if "direction" not in except_fields:
        segments += [f"direction {word}" for word in directions_stated([(0, text)])]
    return segments


def _keys_of(sheet: Sheet, rows: Sequence[Row]) -> set[str]:
    """Return the names of those fields of a test, such as radius_mm, that the given rows state.

    ``sheet`` is the sheet that contains the rows.
    """
    keys: set[str] = set()
    for _, text in sheet.texts(rows):
        keys |= _keys_of_text(text)
    return keys


def _keys_of_text(text: str) -> set[str]:
    """Return the names of the fields of a test, such as radius_mm, that a line states."""
    keys = set(statements_in([(0, text)]))
    if directions_stated([(0, text)]):
        keys.add("direction")
    if any(stamp.seconds is not None for stamp in stamps_in(text)):
        keys.add("time")
    return keys


def named_sheets(sheet: Sheet, tables: Sequence[list[Row]]) -> list[Sheet]:
    """Return the tables that stand below each other in a sheet, each as a named sheet.

    A table is named after its sheet or file and after the direction of travel that is stated above
    the table. If the directions do not distinguish the tables, the tables are numbered instead.
    ``tables`` holds the rows of each table.
    """
    names = []
    for number, rows in enumerate(tables, start=1):
        header = first_header(rows) or 0
        directions = directions_stated(list(sheet.texts(rows[:header])))
        name = directions.pop() if len(directions) == 1 else f"table {number}"
        names.append(f"{sheet.title} {name}")
    if len(set(names)) < len(names):
        names = [f"{sheet.title} table {number}" for number in range(1, len(tables) + 1)]
    sheets = []
    for name, rows in zip(names, tables, strict=True):
        sheets.append(replace(sheet, name=name, rows=rows))
    return sheets
