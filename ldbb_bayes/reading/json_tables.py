"""Tables in JSON: lists of records, lists of rows, or columns as lists of numbers."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ldbb_bayes.campaign.circular_test import FEWEST_READINGS
from ldbb_bayes.errors import InputError, placed
from ldbb_bayes.reading.entry_tables import EntryTable, sheets_of_entries, statement_of
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.words import LONGEST_NAME

__all__ = ["is_json", "sheets_of_json"]

# Regular expression for the beginning of a file in JSON. Other text files may also begin with [[,
# as in [[Circle]], but not with [[ followed by a number.
_BEGINNING = re.compile(r'\{"|\[\{"|\[\[[-"\d]')
# Characters with which a line in JSON begins.
_MARKS = '{["]},'
# JSON keys, in lower case, under which a file gives the name of a table, as in "label": "run 1".
_KEYS_OF_NAME = ("name", "label", "test", "id", "title")
# JSON keys, in lower case, under which a dict holds the list of the numbers of a column. Other keys
# of the same dict hold further properties of the column, such as its unit.
_KEYS_OF_NUMBERS = ("values", "data", "value", "samples")
# JSON keys, in lower case, under which a dict gives the unit of its numbers, as in {"value": 150,
# "unit": "mm"}.
_KEYS_OF_UNIT = ("unit", "units", "einheit")
# JSON keys, in lower case, under which a file lists the names of a table's columns.
_KEYS_OF_HEADER = ("columns", "header", "headers", "fields", "names")


class _Number(str):
    """Number as text, with all digits that the file has."""

    __slots__ = ()


def is_json(text: str) -> bool:
    """Return whether a text is in JSON, or has one JSON record in each line.

    The result is False if only the first line is JSON and a table in another format follows.
    """
    if _BEGINNING.match("".join(text[:200].split())) is None:
        return False
    first_line, _, following = text.strip().partition("\n")
    following = following.strip()
    if not following or not _closes_its_brackets(first_line):
        return True
    return following[0] in _MARKS


def _closes_its_brackets(line: str) -> bool:
    """Return whether a line has as many closing as opening brackets of each kind."""
    return line.count("{") == line.count("}") and line.count("[") == line.count("]")


def sheets_of_json(sheet: Sheet, text: str) -> list[Sheet]:
    """Return one sheet for each table in a text in JSON.

    The statements around a table, such as ``"radius_mm": 150``, become lines above it. Without a
    table, the result is one sheet with the statements.

    Parameters
    ----------
    sheet
        Sheet without rows, which holds the path of the file.
    text
        The text.

    Raises
    ------
    InputError
        If the text is not valid JSON, or if its lists and objects are nested too deeply.
    """
    content = _content_of_json(sheet, text)
    try:
        tables = list(_tables_in(content, ""))
        if not tables:
            tables = [EntryTable("", _statements_of("", content), [], [])]
    except RecursionError:
        raise _error_at(sheet, 1) from None
    return sheets_of_entries(sheet, tables, "JSON")


def _content_of_json(sheet: Sheet, text: str) -> Any:
    """Return the content of a text in JSON, which consists of lists, dicts and single values.

    If each line of the text is a JSON record of its own, the result is the list of these records.
    Raise an `InputError` for any other text that is not valid JSON. ``sheet`` names the file in the
    message.
    """
    decoder = json.JSONDecoder(
        parse_float=_Number, parse_int=_Number, object_pairs_hook=_with_different_keys
    )
    try:
        with placed(sheet.place):
            return decoder.decode(text)
    except (json.JSONDecodeError, RecursionError) as error:
        fault = error
    try:
        return [decoder.decode(line) for line in text.split("\n") if line.strip()]
    except (json.JSONDecodeError, RecursionError):
        raise _error_at(sheet, getattr(fault, "lineno", 1)) from None


def _error_at(sheet: Sheet, line: int) -> InputError:
    """Return the error for a text that is not valid JSON; ``line`` is the line of the fault."""
    return InputError(
        f"{sheet.place}, line {line}: JSON must be valid, got an error there. Export it again, or"
        " save its readings as CSV."
    )


def _with_different_keys(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """Return the keys and values of a JSON object as a dict.

    Raise an `InputError` if a key occurs twice.
    """
    content = dict(pairs)
    if len(content) < len(pairs):
        keys = [key for key, _ in pairs]
        repeated = next(key for key in keys if keys.count(key) > 1)
        raise InputError(
            f"keys in JSON must differ, got {repeated[:LONGEST_NAME]!r} twice in one place."
            " Rename one."
        )
    return content


def _tables_in(content: Any, name: str) -> Iterator[EntryTable]:
    """Yield the tables in a part of a JSON file, each with the statements that apply to it.

    ``content`` is the part: a dict, a list of records, a list of rows, or a list of further parts.
    Anything else holds no table. ``name`` is the name of the part.
    """
    if isinstance(content, dict):
        yield from _tables_in_dict(content, name)
        return
    if not isinstance(content, list):
        return
    if _are_records(content):
        header = list(dict.fromkeys(key for record in content for key in record))
        rows = [[_text_of(record.get(key, "")) for key in header] for record in content]
        yield EntryTable(name, [], header, rows)
    elif _are_rows(content):
        yield EntryTable(name, [], [], [[_text_of(cell) for cell in row] for row in content])
    else:
        for number, part in enumerate(content, start=1):
            yield from _tables_in(part, f"{name} {number}".strip())


def _tables_in_dict(content: Mapping[str, Any], name: str) -> Iterator[EntryTable]:
    """Yield the tables in a JSON object, which consists of keys and values.

    ``content`` is the object as a dict, and ``name`` is its name.
    """
    columns = _columns_in(content)
    statements = []
    inner_tables: list[EntryTable] = []
    for key, value in content.items():
        if key not in columns:
            tables = list(_tables_in(value, _name_of_part(content, key, name)))
            inner_tables += tables
            if not tables:
                statements += _statements_of(key, _with_unit_beside(content, key))
    if len(columns) > 1:
        header = [_header_of(key, content[key]) for key in columns]
        rows = [list(row) for row in zip(*columns.values(), strict=True)]
        properties = _statements_beside(content, columns)
        yield EntryTable(_name_in(content) or name, [*statements, *properties], header, rows)
    for table in inner_tables:
        outer_statements = list(statements)
        key = _key_of_header(content, len(table.rows[0]))
        if key and not table.header:
            table.header = list(content[key])
            repeated = _statements_of(key, content[key])
            outer_statements = [line for line in statements if line not in repeated]
        table.statements = [*outer_statements, *table.statements]
        yield table


def _with_unit_beside(content: Mapping[str, Any], key: str) -> Any:
    """Return the value under a key of a JSON object, with the unit under another key if it has one.

    The unit of the number under ``radius`` is the text under ``radius_unit``.
    """
    unit = content.get(f"{key}_unit")
    if isinstance(content[key], _Number) and isinstance(unit, str):
        return {"value": content[key], "unit": unit}
    return content[key]


def _name_of_part(content: Mapping[str, Any], key: str, name: str) -> str:
    """Return a name for one part of a JSON file.

    The part is the value that the dict ``content`` has under ``key``. It receives the name of
    ``content``, followed by ``key`` if ``content`` holds several dicts or lists. The name of
    ``content`` is its text under a key such as "name", or else the argument ``name``. If both are
    empty, the part is named ``key``.
    """
    outer_name = _name_in(content) or name
    inner_parts = [value for value in content.values() if isinstance(value, dict | list)]
    if outer_name and len(inner_parts) > 1:
        return f"{outer_name} {key}"
    return outer_name or key


def _name_in(content: Mapping[str, Any]) -> str:
    """Return the text under a key such as "name" in a JSON object.

    ``content`` is the object as a dict. The result is an empty text if there is no such key.
    """
    for key, value in content.items():
        if key.casefold() in _KEYS_OF_NAME and isinstance(value, str):
            return value
    return ""


def _columns_in(content: Mapping[str, Any]) -> dict[str, list[str]]:
    """Return a dict with the columns of numbers in a JSON object.

    The keys are keys of the object. Each value is a column, as the list of its cells. If the
    columns differ in length, only those with the most frequent length are returned. ``content`` is
    the object as a dict.
    """
    columns = {}
    for key, value in content.items():
        numbers = _column_of_numbers(value)
        if len(numbers) >= FEWEST_READINGS:
            columns[key] = numbers
    lengths = [len(numbers) for numbers in columns.values()]
    usual = max(lengths, key=lengths.count, default=0)
    return {key: numbers for key, numbers in columns.items() if len(numbers) == usual}


def _column_of_numbers(value: Any) -> list[str]:
    """Return the numbers of a column in a JSON file as texts.

    A column is written in one of three ways: as a list, as a dict whose keys are the numbers of the
    rows, or as a dict that holds a list and further properties such as the unit. The result is
    empty if ``value`` is none of these.
    """
    if isinstance(value, dict):
        return _column_of_numbers(_cells_of_dict(value))
    if not isinstance(value, list) or not any(isinstance(cell, _Number) for cell in value):
        return []
    if any(isinstance(cell, dict | list) for cell in value):
        return []
    return [_text_of(cell) for cell in value]


def _cells_of_dict(content: Mapping[str, Any]) -> list[Any]:
    """Return the cells of a column that is stored as a dict in a JSON file.

    The dict holds a list under a key such as "data", as in ``{"data": [1.2, 1.4]}``, or its keys
    are the numbers of the rows, as in ``{"0": 1.2, "1": 1.4}``. For any other dict, the result is
    an empty list.
    """
    if content and all(key.isdigit() for key in content):
        return list(content.values())
    for key, cells in content.items():
        if key.casefold() in _KEYS_OF_NUMBERS and isinstance(cells, list):
            return cells
    return []


def _header_of(key: str, value: Any) -> str:
    """Return the header of a column: its key and, if the file states it, its unit in brackets."""
    if isinstance(value, dict) and _unit_beside(value):
        return f"{key} [{_unit_beside(value)}]"
    return key


def _unit_beside(value: Mapping[str, Any]) -> str:
    """Return the unit in a dict such as ``{"value": 150, "unit": "mm"}``.

    The result is an empty text if the dict holds no unit.
    """
    for key, unit in value.items():
        if key.casefold() in _KEYS_OF_UNIT and isinstance(unit, str):
            return unit
    return ""


def _statements_beside(content: Mapping[str, Any], columns: Mapping[str, Any]) -> list[str]:
    """Return lines of text that state properties of columns, except their units.

    An example is ``dev radius: 150 mm`` for a column with the key ``dev``. A JSON file may store a
    column as a dict that holds a list of numbers and the properties of the column. ``content`` is
    the dict that holds all columns. The keys of ``columns`` are those keys of ``content`` under
    which it holds columns.
    """
    statements = []
    for key in columns:
        value = content[key]
        if not isinstance(value, dict) or all(name.isdigit() for name in value):
            continue
        for name, entry in value.items():
            if name.casefold() not in _KEYS_OF_UNIT and not isinstance(entry, list):
                statements += _statements_of(f"{key} {name}", entry)
    return statements


def _key_of_header(content: Mapping[str, Any], width: int) -> str:
    """Return the key of the list that holds the names of a table's columns, such as "columns".

    ``content`` is the dict that contains the table, and ``width`` is the number of columns. The
    result is empty if the dict has no such list.
    """
    for key, value in content.items():
        is_list = key.casefold() in _KEYS_OF_HEADER and isinstance(value, list)
        if is_list and len(value) == width and all(type(name) is str for name in value):
            return key
    return ""


def _are_records(content: Sequence[Any]) -> bool:
    """Return whether a list consists of records, which are the rows of a table.

    A record is a dict without lists. At least two values of the first record must be numbers or
    dicts.
    """
    if len(content) < FEWEST_READINGS or not all(isinstance(record, dict) for record in content):
        return False
    for record in content:
        if any(isinstance(value, list) for value in record.values()):
            return False
    return sum(isinstance(value, _Number | dict) for value in content[0].values()) >= 2


def _are_rows(content: Sequence[Any]) -> bool:
    """Return whether a list consists of the rows of a table, which are lists of equal length.

    The first row must hold at least two numbers.
    """
    if len(content) < FEWEST_READINGS or not all(isinstance(row, list) for row in content):
        return False
    widths = {len(row) for row in content}
    return len(widths) == 1 and sum(isinstance(cell, _Number) for cell in content[0]) >= 2


def _statements_of(key: str, value: Any) -> list[str]:
    """Return the lines of text that state the value, or the values, under a key of a JSON file.

    An example is the line ``radius: 150 mm``.
    """
    name = key.replace("_", " ")
    if isinstance(value, dict):
        if "value" in value and not isinstance(value["value"], dict | list):
            return [f"{name}: {_text_of(value)}"]
        lines = []
        for inner_key, inner in value.items():
            lines += _statements_of(f"{key} {inner_key}".strip(), inner)
        return lines
    if isinstance(value, list):
        if any(isinstance(entry, dict | list) for entry in value):
            return []
        return [f"{name}: {', '.join(_text_of(entry) for entry in value)}"]
    return [statement_of(key, _text_of(value)).removeprefix(": ")]


def _text_of(value: Any) -> str:
    """Return a single value as a text; for a value with a unit, a text such as ``36 N``."""
    if value is None:
        return ""
    if isinstance(value, dict):
        return f"{_text_of(value.get('value'))} {_unit_beside(value)}".strip()
    return " ".join(str(value).split())
