"""Text of any encoding and separator as cells."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path

from ldbb_bayes.campaign.table import LARGEST_LINE
from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.tables.numerals import looks_like_number
from ldbb_bayes.tables.sheet import LARGEST_CELLS, Sheet

__all__ = ["SEPARATORS", "sheet_of_text"]

SEPARATORS = {"comma": ",", "semicolon": ";", "tab": "\t", "bar": "|", "space": " "}
ENCODINGS = ("utf-8", "utf-16-le", "utf-16-be", "cp1252")
_MARKS = ((b"\xef\xbb\xbf", "utf-8"), (b"\xff\xfe\x00\x00", "utf-32-le"), (b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be"))


def sheet_of_text(path: Path, raw: bytes, encoding: str | None, separator: str | None) -> Sheet:
    """The cells of a text file; see `read_sheets`."""
    text, found = _decoded(path, raw, encoding)
    return _split(path, text, found, _sign(separator))


def _decoded(path: Path, raw: bytes, encoding: str | None) -> tuple[str, str]:
    mark, marked = next(((sign, name) for sign, name in _MARKS if raw.startswith(sign)), (b"", ""))
    guess = encoding or marked or _without_mark(raw)
    try:
        text = raw[len(mark) :].rstrip(b"\x1a").decode(guess)
    except LookupError:
        raise InputError(
            f"{path}: encoding must be one Python knows, got {guess!r}. For example {', '.join(ENCODINGS)}."
        ) from None
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise InputError(
            f"{path}, line {line}: text must be {guess}, got other bytes. Give --encoding, or save it as 'CSV UTF-8'."
        ) from None
    strange = next((k for k, sign in enumerate(text) if sign < " " and sign not in "\t\r\n\f"), None)
    if strange is not None:
        line = text.count("\n", 0, strange) + 1
        raise InputError(
            f"{path}, line {line}: a table must be text, got binary data. Export it as 'CSV UTF-8', or give --encoding."
        )
    return text, guess


def _without_mark(raw: bytes) -> str:
    head = raw[:4096]
    if head[1::2].count(0) > 0.4 * len(head) / 2:
        return "utf-16-le"
    if head[::2].count(0) > 0.4 * len(head) / 2:
        return "utf-16-be"
    try:
        raw.decode("utf-8")
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8"


def _sign(separator: str | None) -> str | None:
    if separator is None or separator in SEPARATORS.values():
        return separator
    check_known("separator", [separator], SEPARATORS)
    return SEPARATORS[separator]


def _split(path: Path, text: str, encoding: str, separator: str | None) -> Sheet:
    if text.count("\n") + text.count("\r") > 2 * LARGEST_CELLS:
        raise InputError(f"{path} must hold at most {LARGEST_CELLS} cells, got more. Split it.")
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    long = next((k for k, line in enumerate(lines, start=1) if len(line) > LARGEST_LINE), None)
    if long is not None:
        raise InputError(
            f"{path}, line {long}: a line must hold at most {LARGEST_LINE} signs, got {len(lines[long - 1])}. Export it again."
        )
    sign = separator or _separator_of(lines)
    if len(lines) + text.count(sign) > LARGEST_CELLS:
        raise InputError(f"{path} must hold at most {LARGEST_CELLS} cells, got more. Split it.")
    return Sheet(path, "", list(_rows(path, lines, sign)), True, encoding, sign)


def _rows(path: Path, lines: Sequence[str], sign: str) -> Iterator[tuple[int, list[str]]]:
    """Cells without the blanks around them; quoted cells may not run over a line's end."""
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        if sign == " ":
            yield number, line.split()
        elif '"' not in line:
            yield number, [cell.strip() for cell in line.split(sign)]
        else:
            try:
                yield number, [cell.strip() for cell in next(csv.reader(io.StringIO(line), delimiter=sign, strict=True))]
            except (csv.Error, StopIteration):
                raise InputError(
                    f"{path}, line {number}: quotes must be closed in their cell, got {line[:60]!r}. Correct the line."
                ) from None


def _separator_of(lines: Sequence[str]) -> str:
    """The sign that splits most lines below the head into equally many cells; of equals the first that is no decimal mark."""
    sample = [line for line in lines if line.strip()]
    sample = sample[len(sample) // 3 :][:200]
    best, most = ",", 0.0
    if not sample:
        return best
    for sign in (";", "\t", "|", ",", " "):
        split = [line.split() if sign == " " else [cell.strip(' "') for cell in line.split(sign)] for line in sample]
        counts = [len(cells) for cells in split]
        usual = max(set(counts), key=counts.count)
        alike = counts.count(usual) / len(counts) if usual > 1 else 0.0
        cells = [cell for row in split for cell in row if cell]
        numbers = sum(map(looks_like_number, cells)) / max(len(cells), 1)
        if alike * (1.0 + numbers) > most + 0.02:
            best, most = sign, alike * (1.0 + numbers)
    return best
