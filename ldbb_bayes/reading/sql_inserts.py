"""Tables in the dump of a database whose rows stand in commands ``INSERT INTO … VALUES …``.

A dump is the content of a database as text. The program mysqldump writes many rows in one line.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from ldbb_bayes.reading.entry_tables import EntryTable, sheets_of_entries
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.words import unit_named

__all__ = ["has_sql_inserts", "sheets_of_sql_inserts"]

# Regular expressions for a text in quotation marks, and for the name of a table or a column.
_QUOTED = r"'(?:[^'\\]|\\.|'')*'(?!')"
_NAME = r"(?:\"[^\"]*\"|`[^`]*`|\[[^\]]*\]|[^\s(,;'\"`\[])+"
# Regular expression for a command that inserts rows: INSERT INTO `test` VALUES (1,36). The names of
# the columns may follow the name of the table.
_INSERT = re.compile(
    rf"^[ \t]*INSERT\s+(?:IGNORE\s+)?INTO\s+(?P<table>{_NAME})\s*"
    r"(?:\((?P<columns>[^()]*)\)\s*)?VALUES\b",
    re.IGNORECASE | re.MULTILINE,
)
# Regular expression for one part of the rows of such a command: a value or a mark.
_PART = re.compile(rf"\s*(?:(?P<value>{_QUOTED}|[^\s,;()'][^,;()']*)|(?P<mark>[(),;]))")
# Regular expression for the definition of one column of a table, which may contain brackets.
_BRACKETS = rf"\((?:[^'()]|{_QUOTED}|\([^()]{{0,99}}\)){{0,999}}\)"
_DEFINITION = rf"(?:[^,'()]|{_QUOTED}|{_BRACKETS})+"
# Regular expression for a command that creates a table.
_CREATE = re.compile(
    rf"^[ \t]*CREATE\s+TABLE\s+(?:IF\s+NOT\s+EXISTS\s+)?(?P<table>{_NAME})\s*"
    rf"\((?P<columns>{_DEFINITION}(?:,{_DEFINITION})*)\)(?P<options>(?:[^;']|{_QUOTED})*);",
    re.IGNORECASE | re.MULTILINE,
)
# Regular expression for the comment on a column or a table inside such a command.
_COMMENT = re.compile(rf"\bCOMMENT\s*=?\s*(?P<comment>{_QUOTED})", re.IGNORECASE)
# Regular expression for a command that comments on a column of a table.
_COMMENT_ON = re.compile(
    rf"^[ \t]*COMMENT\s+ON\s+COLUMN\s+(?P<column>{_NAME})\s+IS\s+(?P<comment>{_QUOTED})\s*;",
    re.IGNORECASE | re.MULTILINE,
)
# Regular expression for a line that is a comment.
_COMMENT_LINE = re.compile(r"^[ \t]*--[ \t]*(?P<comment>[^\s-].*)$", re.MULTILINE)
# First words of definitions that define no column.
_NO_COLUMNS = ("constraint", "foreign", "fulltext", "index", "key", "primary", "unique", "check")


def has_sql_inserts(text: str) -> bool:
    """Return whether a text is a dump whose rows stand in commands ``INSERT INTO``."""
    return _INSERT.search(text) is not None


def sheets_of_sql_inserts(sheet: Sheet, text: str) -> list[Sheet]:
    """Return one sheet for each table of a dump.

    The names of the columns stand in the command that inserts the rows, or in the command that
    creates the table. Units in the comments on columns become parts of the names; all other
    comments become lines above the table. ``sheet`` is a sheet without rows, which states the path
    of the file.
    """
    inserts = list(_INSERT.finditer(text))
    tables = {}
    for create in _CREATE.finditer(text):
        name = _plain_name(create["table"])
        tables[name] = _created_table(name, create)
    for insert in inserts:
        name = _plain_name(insert["table"])
        table = tables.setdefault(name, EntryTable(name, [], [], []))
        rows = list(_rows_from(text, insert.end()))
        if insert["columns"]:
            names = [_plain_name(cell) for cell in insert["columns"].split(",")]
            rows = _in_order_of_header(table, names, rows)
        table.rows += rows
    for comment in _COMMENT_ON.finditer(text):
        owner, _, column = comment["column"].rpartition(".")
        if _plain_name(owner) in tables:
            table = tables[_plain_name(owner)]
            _add_comment(table, _plain_name(column), _plain_value(comment["comment"]))
    filled = [table for table in tables.values() if table.rows]
    # A comment behind the last rows tells when the dump was completed.
    comments = [line["comment"] for line in _COMMENT_LINE.finditer(text, 0, inserts[-1].start())]
    for table in filled:
        table.statements = [*comments, *table.statements]
    return sheets_of_entries(sheet, filled, "SQL")


def _created_table(name: str, create: re.Match[str]) -> EntryTable:
    """Return a table without rows, from the command ``create`` that creates the table."""
    table = EntryTable(name, [], [], [])
    for comment in _COMMENT.finditer(create["options"]):
        table.statements.append(_plain_value(comment["comment"]))
    for definition in re.findall(_DEFINITION, create["columns"]):
        column = re.match(_NAME, definition.strip())
        if column is None or column[0].casefold() in _NO_COLUMNS:
            continue
        table.header.append(_plain_name(column[0]))
        for comment in _COMMENT.finditer(definition):
            _add_comment(table, table.header[-1], _plain_value(comment["comment"]))
    return table


def _in_order_of_header(
    table: EntryTable, names: list[str], rows: list[list[str]]
) -> list[list[str]]:
    """Return rows whose cells are put in the order of the header of a table.

    ``names`` are the names of the columns in the order of the cells of ``rows``. Names that the
    header lacks are added to it. A column that ``names`` lacks gets empty cells.
    """
    known = [_name_without_unit(header) for header in table.header]
    table.header += [name for name in names if name not in known]
    ordered = []
    for row in rows:
        cell_of = dict(zip(names, row, strict=False))
        ordered.append([cell_of.get(_name_without_unit(header), "") for header in table.header])
    return ordered


def _name_without_unit(header: str) -> str:
    """Return the name of a column from its header, to which a unit may have been added."""
    return header.partition(" [")[0]


def _add_comment(table: EntryTable, name: str, comment: str) -> None:
    """Add the comment on a column to a table: its unit to the header, the rest to the statements.

    An example is the comment ``nm, bar longer = positive``. ``name`` is the name of the column.
    """
    parts = [part.strip() for part in comment.split(",")]
    units = [part for part in parts if unit_named(part)]
    if name in table.header and len(units) == 1 and not unit_of(name).unit:
        table.header[table.header.index(name)] = f"{name} [{units[0]}]"
        parts.remove(units[0])
    if parts:
        table.statements.append(f"{name}: {', '.join(parts)}")


def _rows_from(text: str, start: int) -> Iterator[list[str]]:
    """Yield the rows of the command whose rows begin at the position ``start`` of a text."""
    row: list[str] = []
    cell = ""
    while (part := _PART.match(text, start)) is not None:
        start = part.end()
        if part["mark"] == ";":
            return
        if part["mark"] == "(":
            row = []
        elif part["mark"] == ")":
            yield [*row, cell]
            row, cell = [], ""
        elif part["mark"] == ",":
            row.append(cell)
            cell = ""
        else:
            cell = _plain_value(part["value"])


def _plain_value(value: str) -> str:
    """Return a value of a dump as a cell: without quotation marks, and empty for NULL."""
    value = value.strip()
    if value.casefold() == "null":
        return ""
    if value.startswith("'"):
        return re.sub(r"\\(.)|'(')", r"\1\2", value[1:-1])
    return value


def _plain_name(name: str) -> str:
    """Return the name of a table or a column without quotation marks and without its schema."""
    return name.strip().rpartition(".")[2].strip('`"[]')
