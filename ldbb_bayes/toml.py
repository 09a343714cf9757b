"""TOML that somebody else wrote: parsed if it is of sensible size and shape, refused in one line if not."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from ldbb_bayes.errors import InputError
from ldbb_bayes.files import bytes_of

__all__ = ["LARGEST_TOML_BYTES", "parse_toml", "read_toml"]

LARGEST_TOML_BYTES = 512 * 2**10
LONGEST_LINE = 20_000
# Keys of more parts cost time that grows with the square of their number; none of our files has more than three.
_DEEP = re.compile(r"(?:(?:[\w-]{1,200}|\"[^\"\n]{0,200}\"|'[^'\n]{0,200}')[ \t]{0,9}\.[ \t]{0,9}){8}")


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a file.

    Raises
    ------
    InputError
        Naming the file, and the place in it.
    """
    raw = bytes_of(path, LARGEST_TOML_BYTES, what="a readable TOML file")
    try:
        return parse_toml(raw.decode("utf-8-sig"), str(path))
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(f"{path}, line {line}: TOML must be UTF-8, got other bytes. Save it as UTF-8.") from None


def parse_toml(text: str, place: str) -> dict[str, Any]:
    """The content of a text; ``place`` is what a message calls it.

    Raises
    ------
    InputError
    """
    if len(text) > LARGEST_TOML_BYTES:
        raise InputError(
            f"{place} must hold at most {LARGEST_TOML_BYTES // 2**10} kB, got more. Remove what does not belong there."
        )
    for number, line in enumerate(text.split("\n"), start=1):
        if len(line) > LONGEST_LINE or _DEEP.search(line):
            raise InputError(
                f"{place}, line {number}: lines must be short and keys plain, got {line[:40]!r}…. Correct that line."
            )
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{place} must be valid TOML, got: {error}. Correct that place.") from None
    except (RecursionError, ValueError, OverflowError) as error:
        raise InputError(f"{place} must be valid TOML, got what cannot be read ({type(error).__name__}). Correct it.") from None
