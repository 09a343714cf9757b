"""The campaigns of a batch: paths as given, folders of campaigns and lists opened, each campaign once."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from ldbb_bayes.campaign.folder import TOML_NAME
from ldbb_bayes.errors import InputError
from ldbb_bayes.files import bytes_of

__all__ = ["Gathered", "gather", "listed"]

_LARGEST_LIST = 2**30
_COMMENT = re.compile(r"(^|\s)#.*")
_QUOTED = re.compile(r'"(.+)"')


@dataclass(frozen=True)
class Gathered:
    """Paths of campaigns in the order given, and those that were given again."""

    paths: tuple[str, ...]
    repeated: tuple[str, ...]


def gather(given: Iterable[str | os.PathLike[str]]) -> Gathered:
    """Open folders of campaigns and lists.

    Parameters
    ----------
    given : iterable of path
        A campaign folder, a campaign.toml or a tidy CSV stands for itself; any other folder for its direct subfolders with a
        campaign.toml, sorted; ``@FILE`` or a .txt file for the paths in it, one a line, ' #' beginning a comment but for paths in
        double quotes, which are taken as they are. What does not exist stays: the batch says so in its row.

    Raises
    ------
    InputError
        For no campaign, none that exists, or a path that cannot stand on a line.
    """
    if isinstance(given, str | os.PathLike):
        given = [given]
    seen: dict[str, str] = {}
    repeated = []
    for path in _opened(given):
        _check_line(path)
        key = os.path.abspath(path)
        key = os.path.dirname(key) if os.path.basename(key) == TOML_NAME else key
        if key in seen:
            repeated.append(path)
        else:
            seen[key] = path
    paths = tuple(seen.values())
    if not paths:
        raise InputError("a batch must have at least one campaign, got none. Name campaigns, folders of them, or a list (@FILE).")
    if not any(map(_is_campaign, paths)):
        raise InputError(
            f"a batch must have campaigns that exist, got none among {len(paths)} ({paths[0]}). "
            f"Name folders with {TOML_NAME}, tidy CSVs, folders of campaigns, or a list (@FILE)."
        )
    return Gathered(paths, tuple(repeated))


def _opened(given: Iterable[str | os.PathLike[str]]) -> Iterator[str]:
    for entry in (os.fspath(own) for own in given):
        if entry.startswith("@") or (entry.lower().endswith(".txt") and os.path.isfile(entry)):
            for line in _lines(Path(entry.removeprefix("@"))):
                yield from _inside(line)
        else:
            yield from _inside(entry)


def _inside(path: str) -> list[str]:
    """The path itself, or the campaigns right in a folder of campaigns."""
    if not os.path.isdir(path) or os.path.isfile(os.path.join(path, TOML_NAME)):
        return [path]
    try:
        with os.scandir(path) as entries:
            names = sorted(own.name for own in entries if os.path.isfile(os.path.join(own.path, TOML_NAME)))
    except OSError as error:
        raise InputError(f"{path} must be a readable folder, got: {error.strerror}. Check its permissions.") from None
    return [os.path.join(path, name) for name in names] or [path]


def _lines(file: Path) -> Iterator[str]:
    raw = bytes_of(file, _LARGEST_LIST, what="a list of campaigns, one path a line")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{file} must be UTF-8 text, got another encoding. Save it as UTF-8.") from None
    for line in text.splitlines():
        path = line.strip()
        if not _QUOTED.fullmatch(path):
            path = _COMMENT.sub("", path).strip()
        if path:
            yield _QUOTED.sub(r"\1", path) if _QUOTED.fullmatch(path) else path


def listed(paths: Iterable[str]) -> bytes:
    """A list that is read as these paths: quoted where a part would be a comment."""
    return "".join(f'"{path}"\n' if _COMMENT.search(path) or _QUOTED.fullmatch(path) else f"{path}\n" for path in paths).encode()


def _check_line(path: str) -> None:
    try:
        path.encode()
    except UnicodeEncodeError:
        path, good = repr(path), False
    else:
        good = path.isprintable() and path == path.strip() and bool(path)
    if not good:
        raise InputError(f"paths of campaigns must be printable and stand on one line, got {path!r}. Rename it.")


def _is_campaign(path: str) -> bool:
    return os.path.isfile(os.path.join(path, TOML_NAME)) if os.path.isdir(path) else os.path.isfile(path)
