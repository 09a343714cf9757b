"""Tables inside other texts: in a mail that quotes a table, or in the output of a database."""

from __future__ import annotations

import re

from ldbb_bayes.reading.words import LONGEST_TEXT

__all__ = ["with_names_of_dump", "without_queries", "without_quote_marks"]

# Regular expression for the marks that a mail program writes before a quoted line.
_QUOTE_MARKS = re.compile(r"\s*>[> ]*")
# A text is regarded as quoted if at least this number of lines, and at least half of all lines that
# are not empty, begin with quote marks.
_FEWEST_QUOTED = 10
# Regular expressions for the lines directly before and after the rows of a table in a dump. A dump
# is the content of a database as text.
_COPY = re.compile(r"COPY \S+ \((?P<columns>[^)]+)\) FROM stdin;\s*")
_END_OF_ROWS = re.compile(r"\\\.\s*")
# Regular expression for a query of a database in one line. The prompt of the program may stand in
# front of the query.
_QUERY = re.compile(
    r"\s*(?:\S*>\s*)?select\s.*?\sfrom\s+[^;]*?(?:\swhere\s+(?P<condition>[^;]*?))?"
    r"(?:\sorder\s+by\s[^;]*)?;?\s*",
    re.IGNORECASE,
)


def without_quote_marks(text: str) -> str:
    """Return a text without the marks ``>`` with which a mail quotes the lines of another mail.

    A text in which few lines begin with such a mark is returned unchanged.
    """
    lines = text.split("\n")
    n_filled = sum(bool(line.strip()) for line in lines)
    n_quoted = sum(_QUOTE_MARKS.match(line) is not None for line in lines)
    if n_quoted < _FEWEST_QUOTED or 2 * n_quoted < n_filled:
        return text
    return "\n".join(_QUOTE_MARKS.sub("", line, count=1) for line in lines)


def with_names_of_dump(text: str) -> str:
    """Return the dump of a PostgreSQL database with the names of columns above each table.

    A dump is the content of a database as text. The names stand in a command ``COPY … FROM stdin;``
    above the rows of each table. All other commands below the first command of this kind become
    empty lines. Any other text is returned unchanged.
    """
    if "FROM stdin;" not in text:
        return text
    lines = []
    has_begun = False
    is_row = False
    for line in text.split("\n"):
        begins = _COPY.fullmatch(line)
        if begins is not None:
            has_begun = is_row = True
            names = [name.strip(' "') for name in begins["columns"].split(",")]
            lines.append("\t".join(names))
            continue
        is_row = is_row and _END_OF_ROWS.fullmatch(line) is None
        lines.append(line if is_row or not has_begun else "")
    return "\n".join(lines)


def without_queries(text: str) -> str:
    """Return a text in which each query of a database is replaced by the condition of the query.

    For example, the line ``db=> select angle, reading from circles where force=100;`` becomes
    ``force=100``, which states the force of the table below it.
    """
    if "select" not in text.casefold():
        return text
    lines = []
    for line in text.split("\n"):
        query = _QUERY.fullmatch(line[:LONGEST_TEXT])
        if query is None:
            lines.append(line)
            continue
        condition = re.sub(r"\s+and\s+", "; ", query["condition"] or "", flags=re.IGNORECASE)
        lines.append(re.sub(r"[\"']", "", condition))
    return "\n".join(lines)
