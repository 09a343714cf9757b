"""Removal of page headers, such as ``Lab 3 Page 2 of 3``, from the text of printed pages.

Such headers stand between the rows of a table that is longer than one page.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from ldbb_bayes.reading.cell_units import number_in_cell
from ldbb_bayes.reading.header_rows import names_any_role, names_columns
from ldbb_bayes.reading.lines_above import statements_in
from ldbb_bayes.reading.names import load_in_name
from ldbb_bayes.reading.travel_direction import directions_stated
from ldbb_bayes.reading.words import LONGEST_TEXT

__all__ = ["TextOfPages", "without_page_marks"]

# Regular expression for the number of a page, such as "Page 2 of 3" or "- Seite 2 -".
_PAGE_MARK = re.compile(
    r"(?<![^\s;,|])(?:[-–—|(\[]+\s*)?"
    r"(?:page|seite|blatt|feuille|pagina|página|pag\.|pág\.|strana|strona|стр\.?)"
    r"\s*:?\s*\d+(?:\s*(?:of|von|de|di|sur|z|из|/)\s*\d+)?(?:\s*[-–—|)\]]+)?(?![^\s;,|])",
    re.IGNORECASE,
)


class TextOfPages(NamedTuple):
    """Text of several printed pages, without the headers of these pages."""

    text: str
    #: number of lines, such as page numbers, that were removed from between the rows of numbers
    n_removed: int


def without_page_marks(text: str, separator: str) -> TextOfPages:
    """Return a text without page numbers, and without the titles that are repeated next to them.

    A removed line becomes an empty line. Between rows of numbers, the whole line with a page number
    is removed, unless it names columns or states a value, such as a force. Lines next to it are
    also removed if they repeat an earlier line, such as a title. If a character other than a blank
    separates the cells, a page number is removed only if it is alone on its line.

    Parameters
    ----------
    text
        Text whose lines are rows of cells.
    separator
        Character between the cells.
    """
    lines = text.split("\n")
    if not any(_PAGE_MARK.search(line[:LONGEST_TEXT]) for line in lines):
        return TextOfPages(text, 0)
    numbers = [k for k, line in enumerate(lines) if _is_row_of_numbers(line, separator)]
    n_removed = 0
    for k, line in enumerate(lines):
        if _PAGE_MARK.search(line[:LONGEST_TEXT]) is None:
            continue
        is_between = bool(numbers) and numbers[0] < k < numbers[-1]
        lines[k] = _without_mark(line, separator, is_between)
        if is_between and not lines[k]:
            n_removed += 1 + _remove_titles(lines, k, separator)
    return TextOfPages("\n".join(lines), n_removed)


def _without_mark(line: str, separator: str, is_between: bool) -> str:
    """Return a line without its page number; an empty text if the whole line is to be removed.

    Parameters
    ----------
    line
        Line with the number of a page.
    separator
        Character between the cells of the text.
    is_between
        Whether the line stands between rows of numbers.
    """
    rest = _PAGE_MARK.sub(lambda mark: " " * len(mark[0]), line, count=1)
    if not rest.strip(f" \t\f{separator}"):
        return ""
    if separator != " ":
        return line
    if is_between and not _states_something(rest):
        return ""
    return rest


def _is_row_of_numbers(line: str, separator: str) -> bool:
    """Return whether a line has at least two numbers, and at most as many words as numbers."""
    cells = line.split() if separator == " " else line.split(separator)
    filled = [cell.strip() for cell in cells if cell.strip()]
    n_numbers = sum(number_in_cell(cell) is not None for cell in filled)
    has_mark = _PAGE_MARK.search(line[:LONGEST_TEXT]) is not None
    return n_numbers >= 2 and 2 * n_numbers >= len(filled) and not has_mark


def _names_columns(line: str) -> bool:
    """Return whether a line may be the header of a table, with names of at least two columns."""
    words = line.split()
    return names_columns(words) and sum(names_any_role(word) for word in words) >= 2


def _states_something(line: str) -> bool:
    """Return whether a line names columns, or states a value or a direction of travel."""
    if _names_columns(line):
        return True
    is_stated = bool(statements_in([(0, line)])) or load_in_name([line]) is not None
    return is_stated or bool(directions_stated([(0, line)]))


def _remove_titles(lines: list[str], marked: int, separator: str) -> int:
    """Replace lines next to a page number by empty lines if they repeat an earlier line.

    Such a line may be a title. Return how many lines were replaced. The search goes up and down
    from the page number. In each direction, it ends at the first line that does not repeat an
    earlier line, or that contains numbers or names of columns. ``marked`` is the index of the line
    with the page number.
    """
    earlier = {line.strip() for line in lines[:marked]}
    n_removed = 0
    for neighbours in (range(marked - 1, -1, -1), range(marked + 1, len(lines))):
        for k in neighbours:
            line = lines[k].strip()
            is_repeated = line in earlier if k > marked else lines[:k].count(lines[k]) > 0
            if _is_row_of_numbers(line, separator) or not (line == "" or is_repeated):
                break
            if _names_columns(line):
                break
            n_removed += line != ""
            lines[k] = ""
    return n_removed
