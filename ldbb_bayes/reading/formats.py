"""Recognition of file formats, such as XML, that cannot be imported.

Error messages about files without a table of readings name these formats.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from ldbb_bayes.reading.numerals import NUMBER_IN_TEXT
from ldbb_bayes.reading.sheet import Sheet

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
    return ""


def _is_yaml(sheet: Sheet, texts: Sequence[str]) -> bool:
    """Return whether a text is in YAML: each line is a key with a value, or a list entry.

    The name of the file must also end as names of YAML files do, or the first line must be ``---``.
    ``texts`` are the lines of the file.
    """
    is_named_yaml = sheet.path.suffix.lower() in _SUFFIXES_OF_YAML
    if not is_named_yaml and texts[0] != "---":
        return False
    return all(_YAML_LINE.fullmatch(text) for text in texts)
