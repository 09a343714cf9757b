"""Recognition of file formats, such as XML, that cannot be imported.

Error messages about files without a table of readings name these formats.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from ldbb_bayes.reading.numerals import NUMBER_IN_TEXT
from ldbb_bayes.reading.sheet import Sheet

__all__ = ["advice_on_format", "format_of", "is_in_latex"]

# Regular expression for the beginning of a file in XML or HTML.
_MARKUP = re.compile(r"<(?:\?xml|!doctype|!--|[a-z][\w:.-]*[\s>/])", re.IGNORECASE)
_WEB_PAGE = re.compile(r"<(?:!doctype html|html|table)", re.IGNORECASE)
# Regular expression for a line of YAML that cannot be a row of a table. Such a line is a key with a
# value, or an entry of a list.
_YAML_LINE = re.compile(r"(?:- )?[^\W\d][\w. -]*:(?:\s.*)?|- .*|[-+\d.,eE\[\] ]+|#.*|---")
_SUFFIXES_OF_YAML = (".yml", ".yaml")
# Regular expressions for lines that only files of one program or language have.
_LINES_OF_PROGRAMS = {
    "values with K-fields of Q-DAS": re.compile(r"K0100\b|K[012]\d{3}/\d+\b"),
    "an export of TwinCAT Scope, with columns of times": re.compile(
        r"(?:Symbol ?Comment|Data-Type|SampleTime ?\[ms\])\W"
    ),
}
# Regular expression for a line of LaTeX.
_LINE_OF_LATEX = re.compile(r"\\(?:begin\{|hline|toprule|addplot)")
# Lines of programs are searched for among this number of lines.
_LONGEST_HEAD = 40
# Regular expressions for the name of a section in a file of settings, and for a line of it.
_SECTION = re.compile(r"\[[^\[\]]*[^\W\d][^\[\]]*\]")
_SETTING = re.compile(r"[^=]+=.*")
# Share of the lines of a file of settings that must be settings.
_SHARE_OF_SETTINGS = 0.8
# Regular expression for the name of a list of numbers, such as "angle" or "run(1).theta".
_NAME = r"(?P<name>[^\W\d][\w.(){} -]*?)"
# Regular expression for a line that opens a list of numbers but does not close it, such as
# ``angle = [ ...`` or ``angle = np.array([0, 5,``. The numbers are matched only once (``*+``),
# because a list of n numbers that is closed could otherwise be divided in about 2^n ways.
_OPENED_LIST = re.compile(
    rf"{_NAME}\s*(?:=|<-)\s*[\w.]*\(?[\[({{](?:\s*{NUMBER_IN_TEXT}[,;\s])*+\s*"
    r"(?P<dots>\.\.\.)?\s*"
)
# Regular expression for a line with a name and a list of numbers, as in "angle = [0, 5, 10]".
_NAMED_LIST = re.compile(rf"{_NAME}\s*[=:]\s*[\[({{]?(?:\s*{NUMBER_IN_TEXT}[,;\s]){{9}}.*")

# Regular expression for a range of numbers in MATLAB with its name, as in "phi = 0:10:350".
_RANGE = re.compile(rf"{_NAME}\s*=\s*\[?\s*{NUMBER_IN_TEXT}\s*:\s*{NUMBER_IN_TEXT}\s*:")
# Regular expression for the numbers in names that distinguish circles, as in "B(1).dl".
_NUMBER = re.compile(r"\d+")


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
    if is_in_latex(sheet):
        return "a table in LaTeX"
    if _is_of_settings(texts):
        return "settings with a name and a value in each line"
    return _format_of_program(texts) or _format_of_lists(sheet, texts)


def _format_of_program(texts: Sequence[str]) -> str:
    """Return a description of a file with lines that only one program writes; empty for others.

    ``texts`` are the lines of the file.
    """
    for name, line_of_program in _LINES_OF_PROGRAMS.items():
        if any(line_of_program.match(text) for text in texts[:_LONGEST_HEAD]):
            return name
    return ""


def is_in_latex(sheet: Sheet) -> bool:
    r"""Return whether a text is in LaTeX, as a table between ``\begin{tabular}`` and its end is."""
    if not sheet.separator:
        return False
    texts = sheet.texts(sheet.rows[:_LONGEST_HEAD])
    return any(_LINE_OF_LATEX.match(text.strip()) for _, text in texts)


def _format_of_lists(sheet: Sheet, texts: Sequence[str]) -> str:
    """Return a description of a file that holds lists of numbers instead of columns.

    An example is "lists of numbers in lines: 'angle' and 'reading'". The result is empty if the
    file holds fewer than two lists of numbers. ``texts`` are the lines of the file.
    """
    lists = _names_of_lists(texts)
    if len(lists) < 2:
        return ""
    names = f"{lists[0]!r} and {lists[1]!r}"
    if _is_program_of_matlab(sheet, texts):
        return f"a program of MATLAB with vectors in lines: {names}"
    return f"lists of numbers in lines: {names}"


def advice_on_format(sheet: Sheet) -> str:
    """Return the advice of the error message about a file in a format that cannot be imported.

    For a MATLAB program, the advice names a command that saves vectors as columns.
    """
    advice = (
        "Save the readings as CSV: the line 'Angle [deg],Reading [um]', and below it a line such as"
        " '5.0,-1.234' for each reading. Write each circle into a file of its own, and its force"
        " into the name, such as '300 N.csv'."
    )
    texts = [text.strip() for _, text in sheet.texts(sheet.rows)]
    if texts and _WEB_PAGE.match(texts[0]):
        return f"{advice} Or open the page in a spreadsheet program, and save it as XLSX."
    lists = _names_of_lists(texts)
    if len(lists) < 2 or not _is_program_of_matlab(sheet, texts):
        return advice
    angle, reading = lists[:2]
    if _NUMBER.sub("", angle) == _NUMBER.sub("", reading):
        # Both vectors hold readings, of different circles.
        reading = angle
        angle = _name_of_range(texts) or "angle"
    command = f"writematrix([{angle}(:) {reading}(:)], '36 N.csv')"
    advice = f"{advice} In MATLAB, for each circle: {command}."
    if any(text.startswith("%") for text in texts):
        advice += " Copy the lines that begin with % above its numbers."
    return advice


def _name_of_range(texts: Sequence[str]) -> str:
    """Return the name of the first range in a program of MATLAB, as in ``phi = 0:10:350;``.

    The result is empty if there is no range. ``texts`` are the lines of the program.
    """
    for text in texts:
        match = _RANGE.match(text)
        if match:
            return match["name"]
    return ""


def _names_of_lists(texts: Sequence[str]) -> list[str]:
    """Return the names of the lists of numbers in a text, in the order of its lines.

    A list in one line, such as ``angle = [0, 5, 10, …]``, must have at least nine numbers. A list
    may also begin in one line, such as ``angle = [ ...``, and continue in the next lines.
    """
    names = []
    for text in texts:
        match = _NAMED_LIST.fullmatch(text) or _OPENED_LIST.fullmatch(text)
        if match:
            names.append(match["name"])
    return names


def _is_program_of_matlab(sheet: Sheet, texts: Sequence[str]) -> bool:
    """Return whether a file is a MATLAB program.

    The file is a MATLAB program if its name ends with ``.m``. It is also one if a list of numbers
    is continued on the next line, so that its first line ends with ``...``. ``texts`` are the lines
    of the file.
    """
    if sheet.path.suffix.lower() == ".m":
        return True
    openings = [_OPENED_LIST.fullmatch(text) for text in texts]
    return any(opening is not None and opening["dots"] for opening in openings)


def _is_yaml(sheet: Sheet, texts: Sequence[str]) -> bool:
    """Return whether a text is in YAML: each line is a key with a value, or a list entry.

    The result is True only if the first line is ``---`` or the name of the file ends like that of a
    YAML file. ``texts`` are the lines of the file.
    """
    is_named_yaml = sheet.path.suffix.lower() in _SUFFIXES_OF_YAML
    if not is_named_yaml and texts[0] != "---":
        return False
    return all(_YAML_LINE.fullmatch(text) for text in texts)


def _is_of_settings(texts: Sequence[str]) -> bool:
    """Return whether a text holds settings such as ``Reading1=3.2``, below names in brackets.

    ``texts`` are the lines of the file.
    """
    if _SECTION.fullmatch(texts[0]) is None:
        return False
    settings = [text for text in texts if _SETTING.fullmatch(text)]
    return len(settings) >= _SHARE_OF_SETTINGS * len(texts)
