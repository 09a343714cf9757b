"""Expansion of file names with ``*`` and ``?`` to the matching files."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path, PureWindowsPath

from ldbb_bayes.errors import require

__all__ = ["matching"]

# An error message shows at most this number of characters of a list of file names.
_LONGEST_LIST = 200


def matching(files: Iterable[str | os.PathLike[str]]) -> list[Path]:
    """Return the paths of the named files, with each pattern replaced by the matching files.

    A name with ``*`` or ``?`` is a pattern, unless a file with exactly this name exists. The
    function is needed because not every shell expands patterns. Matching files are in natural order
    (2 N before 10 N). Backslashes may separate folders. Hidden files, and lock files of spreadsheet
    programs (``~$``), do not match.

    Raises
    ------
    InputError
        If a pattern has no matching files, or if no file is named.
    """
    paths: list[Path] = []
    for file in files:
        text = os.fspath(file).strip('"')
        path = _path_of(text)
        wild_part = _first_wild_part(path)
        if wild_part is None or path.exists():
            paths.append(path)
            continue
        matches = _files_matching(text, path, wild_part)
        paths += [match for match in matches if match not in paths]
    require(paths, "files must be given, got none. Name the tables to read.")
    return paths


def _path_of(text: str) -> Path:
    """Return the path that a text states. Backslashes may separate the folders in the text."""
    path = Path(text)
    windows_path = PureWindowsPath(text)
    if "\\" not in text or windows_path.anchor or path.exists():
        return path
    return Path(*windows_path.parts)


def _first_wild_part(path: Path) -> int | None:
    """Return the index of the first part of a path that has ``*`` or ``?``; None if none has."""
    for k, name in enumerate(path.parts):
        if "*" in name or "?" in name:
            return k
    return None


def _files_matching(text: str, path: Path, wild_part: int) -> list[Path]:
    """Return the files that match a pattern with ``*`` or ``?``.

    If only folders match, the folders are returned. Hidden files and folders are left out. Raise
    an `InputError` if nothing matches. ``text`` is the pattern as the user wrote it, and ``path``
    is the same pattern as a path. ``wild_part`` is the index of the first part of the path that
    contains ``*`` or ``?``.
    """
    folder = Path(*path.parts[:wild_part])
    pattern = "/".join(path.parts[wild_part:]).replace("[", "[[]")
    matches = [match for match in folder.glob(pattern) if not _is_hidden(match)]
    matches = [match for match in matches if match.is_file()] or matches
    if not matches:
        require(
            folder.is_dir(),
            f"{text} must match a file, got none: there is no folder {folder}. Name the files, or"
            " correct the pattern.",
        )
        names = [entry.name for entry in folder.glob("*") if not _is_hidden(entry)]
        content = ", ".join(repr(name) for name in sorted(names, key=_natural_order))
        require(
            matches,
            f"{text} must match a file, got none: {folder} holds"
            f" {content[:_LONGEST_LIST] or 'nothing'}. Name the files, or correct the pattern.",
        )
    return sorted(matches, key=_natural_order)


def _is_hidden(path: Path) -> bool:
    """Return whether a file is hidden, or is a lock file of a spreadsheet program (``~$``)."""
    return path.name.startswith((".", "~$"))


def _natural_order(name: object) -> list[str | int]:
    """Return a key that sorts names by the values of the numbers in them: 2 N before 10 N."""
    key: list[str | int] = []
    for piece in re.split(r"([0-9]+)", str(name).casefold()):
        key.append(piece)
        if piece.isdigit():
            key[-1] = int(piece)
    return key
