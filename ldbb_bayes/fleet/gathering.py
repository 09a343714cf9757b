"""Search for the campaigns of a batch in the folders, files and lists that the user names."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from ldbb_bayes.campaign.folder import TOML_NAME
from ldbb_bayes.campaign.folder_of_tables import advice_on_folder
from ldbb_bayes.errors import InputError
from ldbb_bayes.files import bytes_of

__all__ = ["find_passed_over", "gather"]

# Largest permitted size of a text file that lists the file paths of campaigns [bytes].
_LARGEST_LIST = 2**30


def gather(entries: Iterable[str | os.PathLike[str]]) -> tuple[str, ...]:
    """Return the file paths of the campaigns that the user's entries stand for, each campaign once.

    Parameters
    ----------
    entries : paths of folders, files and lists, or a single path. The path of a campaign folder, of
        a campaign.toml or of a tidy CSV file stands for this one campaign. Any other folder stands
        for its direct subfolders that hold a campaign.toml, sorted by name. ``@FILE`` or a .txt
        file stands for the paths that the file lists, one per line; lines that begin with # are
        comments. A path that does not exist is kept, and its row in the table of the batch will
        state that it does not exist.

    Returns
    -------
    File paths of the campaigns, in the order and spelling of the entries.

    Raises
    ------
    InputError
        If none of the campaigns exists, a file path cannot be written on one line, or a list or
        folder cannot be read.
    """
    if isinstance(entries, str | os.PathLike):
        entries = [entries]
    path_by_folder: dict[str, str] = {}
    for path in _expand_all(entries):
        _check_fits_a_line(path)
        folder = os.path.abspath(path)
        if os.path.basename(folder) == TOML_NAME:
            folder = os.path.dirname(folder)
        path_by_folder.setdefault(folder, path)
    paths = tuple(path_by_folder.values())
    if not any(_may_be_campaign(path) for path in paths):
        count = f"{len(paths)} ({paths[0]})" if paths else "0"
        advice = ""
        if paths and os.path.isdir(paths[0]):
            advice = f" {advice_on_folder(Path(paths[0]))}"
        raise InputError(
            f"a batch must have campaigns that exist, got none among {count}. Name folders with"
            f" {TOML_NAME}, tidy CSVs, folders of campaigns, or a list (@FILE).{advice}"
        )
    return paths


def find_passed_over(
    entries: Iterable[str | os.PathLike[str]], out: str | os.PathLike[str]
) -> tuple[str, ...]:
    """Return the file paths in folders of campaigns that are not taken as campaigns.

    These are tables, workbooks and other files, and folders without a campaign.toml, such as
    folders of folders. Hidden files are left out, and so is the folder of the batch.

    Parameters
    ----------
    entries : paths of folders, files and lists, as `gather` explains.
    out : folder of the batch.
    """
    paths: list[str] = []
    for path in _named_paths(entries):
        campaigns = set(_expand_folder(path))
        if campaigns == {path}:
            continue
        for name in sorted(os.listdir(path)):
            inner_path = os.path.join(path, name)
            is_ours = os.path.abspath(inner_path) == os.path.abspath(out)
            if inner_path not in campaigns and not name.startswith(".") and not is_ours:
                paths.append(inner_path)
    return tuple(dict.fromkeys(paths))


def _expand_all(entries: Iterable[str | os.PathLike[str]]) -> Iterator[str]:
    """Yield the file path of every campaign that the user's entries stand for.

    An entry is the path of a campaign, of a folder of campaigns, or of a text file that lists such
    paths (``@FILE`` or .txt).
    """
    for path in _named_paths(entries):
        yield from _expand_folder(path)


def _named_paths(entries: Iterable[str | os.PathLike[str]]) -> Iterator[str]:
    """Yield the paths that the user's entries name; a list of paths names each of its lines."""
    for entry in entries:
        path = os.fspath(entry)
        if _is_list(path):
            yield from _read_list(Path(path.removeprefix("@")))
        else:
            yield path


def _is_list(path: str) -> bool:
    """Return whether a path, as the user wrote it, names a text file that lists campaigns."""
    return path.startswith("@") or (path.lower().endswith(".txt") and os.path.isfile(path))


def _read_list(file: Path) -> list[str]:
    """Return the lines of a text file that lists campaigns, without empty lines and comments."""
    content = bytes_of(file, _LARGEST_LIST, what="a list of campaigns, one path a line")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(
            f"{file} must be UTF-8 text, got another encoding. Save it as UTF-8."
        ) from None
    lines = [line.strip() for line in text.splitlines()]
    return [line for line in lines if line and not line.startswith("#")]


def _expand_folder(path: str) -> list[str]:
    """Return the sorted file paths of the campaign folders that lie directly in a folder.

    The list contains only ``path`` itself if it is not a folder, if it is the folder of a campaign,
    or if it contains no campaign folders. Raise an `InputError` if the folder cannot be read.
    """
    if not os.path.isdir(path) or _has_toml(path):
        return [path]
    try:
        with os.scandir(path) as entries:
            names = sorted(entry.name for entry in entries if _has_toml(entry.path))
    except OSError as error:
        raise InputError(
            f"{path} must be a readable folder, got: {error.strerror}. Check its permissions."
        ) from None
    if not names:
        return [path]
    return [os.path.join(path, name) for name in names]


def _has_toml(folder: str) -> bool:
    """Return whether a folder contains a file campaign.toml."""
    return os.path.isfile(os.path.join(folder, TOML_NAME))


def _may_be_campaign(path: str) -> bool:
    """Return whether a path may be a campaign: a file, or a folder with a campaign.toml."""
    return _has_toml(path) or os.path.isfile(path)


def _check_fits_a_line(path: str) -> None:
    """Raise an `InputError` if a file path cannot be written as a line of a list of campaigns."""
    fits = path.isprintable() and path == path.strip() and path and path[0] != "#"
    if not fits:
        raise InputError(
            f"paths of campaigns must be printable and stand on one line, got {path!r}. Rename it."
        )
