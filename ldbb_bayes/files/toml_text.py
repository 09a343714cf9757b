"""Reading of TOML files with limits on size and depth; errors name the file and the line."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from ldbb_bayes.errors import InputError, require
from ldbb_bayes.files.content import bytes_of

__all__ = ["LARGEST_TOML_BYTES", "parse_toml", "read_toml"]

# Largest size of a TOML file [bytes]; a campaign of a thousand tests needs half of this size.
LARGEST_TOML_BYTES = 512 * 2**10
# Longest line that a TOML file may contain [characters].
_LONGEST_LINE = 20_000
# Pattern of a key with eight dots or more (such as a.b.c.d.e.f.g.h.i), which is refused. The time
# to read a key grows with the square of its number of parts; valid files need at most three parts.
_DEEP_KEY = re.compile(r"(?:[\w-]{1,200}[ \t]{0,9}\.[ \t]{0,9}){8}")
# Regular expression for strings and comments in a TOML file. A string between triple quotes may end
# with two more quotes. A string without a closing quote is matched up to the end of the line or, if
# it began with triple quotes, up to the end of the file, so that no part of the file is searched
# twice. A file with an unclosed string is refused later.
_STRING_OR_COMMENT = re.compile(
    r'''
    """(?:[^\\]|\\(?:.|\Z))*?(?:"{3,5}|\Z)  # string between triple quotation marks
    | \'\'\'.*?(?:'{3,5}|\Z)  # string between triple apostrophes
    | "(?:[^"\\\n]|\\[^\n])*"?  # string between quotation marks
    | '[^'\n]*'?  # string between apostrophes
    | \#[^\n]*  # comment
    ''',
    re.DOTALL | re.VERBOSE,
)
# Largest number of characters of a TOML file's line that an error message shows.
_LINE_SHOWN = 40


def read_toml(path: Path) -> dict[str, Any]:
    """Return the content of a TOML file as a dictionary.

    If the file has a mistake, raise an `InputError` that names the file and the line.
    """
    content = bytes_of(path, LARGEST_TOML_BYTES, what="a readable TOML file")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise InputError(
            f"{path}, line {line}: TOML must be UTF-8, got other bytes. Save it as UTF-8."
        ) from None
    return parse_toml(text, str(path))


def parse_toml(text: str, place: str) -> dict[str, Any]:
    """Return the content of a TOML text as a dictionary.

    If the text has a mistake, raise an `InputError`; ``place`` names the text in the message.
    """
    require(
        len(text) <= LARGEST_TOML_BYTES,
        f"{place} must hold at most {LARGEST_TOML_BYTES // 2**10} kB, got more. Split it.",
    )
    lines = text.split("\n")
    lines_of_keys = _STRING_OR_COMMENT.sub(_placeholder, text).split("\n")
    for number, (line, keys) in enumerate(zip(lines, lines_of_keys, strict=True), start=1):
        if len(line) > _LONGEST_LINE or _DEEP_KEY.search(keys):
            ellipsis = "…" if len(line) > _LINE_SHOWN else ""
            raise InputError(
                f"{place}, line {number}: lines must be short and keys plain, got"
                f" {line[:_LINE_SHOWN]!r}{ellipsis}. Correct that line."
            )
    try:
        return tomllib.loads(text)
    except (RecursionError, ValueError, OverflowError) as error:
        raise InputError(f"{place} must be valid TOML, got: {error}. Correct that place.") from None


def _placeholder(string_or_comment: re.Match[str]) -> str:
    """Return the text that replaces a string or comment before the keys of a TOML file are checked.

    A comment is replaced by an empty text. A string, which may be part of a key, is replaced by an
    underscore, followed by as many line breaks as the string contains.
    """
    text = string_or_comment[0]
    if text.startswith("#"):
        return ""
    return "_" + "\n" * text.count("\n")
