"""Recognition of file formats, such as XML, that cannot be imported.

Error messages about files without a table of readings name these formats.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

from ldbb_bayes.reading.numerals import NUMBER_IN_TEXT
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.words import LONGEST_TEXT

__all__ = ["format_of"]

# Regular expression for the beginning of a file in XML or HTML.
_MARKUP = re.compile(r"<(?:\?xml|!doctype|!--|[a-z][\w:.-]*[\s>/])", re.IGNORECASE)
_WEB_PAGE = re.compile(r"<(?:!doctype html|html|table)", re.IGNORECASE)
# Regular expression for a line of YAML that cannot be a row of a table, such as a key with a value,
# or an entry of a list.
_YAML_LINE = re.compile(r"(?:- )?[^\W\d][\w. -]*:(?:\s.*)?|- .*|[-+\d.,eE\[\] ]+|#.*|---")
_SUFFIXES_OF_YAML = (".yml", ".yaml")
# Regular expression for a line with a name and a list of numbers, as in "angle = [0, 5, 10]".
_NAMED_LIST = re.compile(
    rf"(?P<name>[^\W\d][\w. -]*?)\s*[=:]\s*[\[({{]?(?:\s*{NUMBER_IN_TEXT}[,;\s]){{9}}.*"
)
# Regular expression for a name with a number, as in "theta=360.00deg".
_NAMED_NUMBER = re.compile(rf"[^\W\d][\w.]*\s*[=:]\s*(?={NUMBER_IN_TEXT})")
# If fewer lines than this number consist of names with numbers, they are not taken for the readings
# of a circle.
_FEWEST_LINES = 9


def format_of(sheet: Sheet) -> str:
    """Return a description, for error messages, of the format of a text file without a table.

    The result is empty for a workbook, and for a text whose format is not recognised.
    """
    if sheet.format:
        return f"{sheet.format} without lists of angles and readings of the same length"
    if not sheet.separator or not sheet.rows:
        return ""
    texts = [text.strip() for _, text in sheet.texts(sheet.rows)]
    if _MARKUP.match(texts[0]):
        return "a page in HTML" if _WEB_PAGE.match(texts[0]) else "XML"
    if _is_yaml(sheet, texts):
        return "YAML"
    lists = [match["name"] for match in map(_NAMED_LIST.fullmatch, texts) if match]
    if len(lists) >= 2:
        return f"lists of numbers in lines: {lists[0]!r} and {lists[1]!r}"
    return _names_beside_numbers(sheet, texts)


def _is_yaml(sheet: Sheet, texts: Sequence[str]) -> bool:
    """Return whether a text is in YAML: each line is a key with a value, or a list entry.

    The name of the file must also end as names of YAML files do, or the first line must be ``---``.
    ``texts`` are the lines of the file.
    """
    is_named_yaml = sheet.path.suffix.lower() in _SUFFIXES_OF_YAML
    if not is_named_yaml and texts[0] != "---":
        return False
    return all(_YAML_LINE.fullmatch(text) for text in texts)


def _names_beside_numbers(sheet: Sheet, texts: Sequence[str]) -> str:
    """Describe, for an error message, a file in which each number has a name beside it.

    Many lines must have the same names; otherwise the result is empty. ``texts`` are the lines of
    the sheet.
    """
    names_of_lines = [_names_in(text) for text in texts]
    n_lines = Counter(names_of_lines)
    for row, names in zip(sheet.rows, names_of_lines, strict=True):
        if len(names) >= 2 and n_lines[names] >= _FEWEST_LINES:
            listed = " and ".join(repr(name) for name in names[:2])
            return f"a name beside each number: {listed} in line {row.line}"
    return ""


def _names_in(text: str) -> tuple[str, ...]:
    """Return the names beside numbers in a line: theta and r for ``theta=0.00deg r=1.2um``."""
    names = _NAMED_NUMBER.finditer(text[:LONGEST_TEXT])
    return tuple(match[0].rstrip(" =:") for match in names)
