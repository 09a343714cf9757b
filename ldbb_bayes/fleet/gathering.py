"""Split from its neighbours; see there."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from ldbb_bayes.campaign.folder import TOML_NAME
from ldbb_bayes.errors import InputError, require
from ldbb_bayes.files import bytes_of

__all__ = ["gather"]


_LARGEST_LIST = 2**30


def gather(given: Iterable[str | os.PathLike[str]]) -> tuple[str, ...]:
    """Return the campaigns that folders of campaigns and lists stand for, each once. A campaign
    folder, a campaign.toml or a tidy CSV stands for itself; any other folder for its direct
    subfolders with a campaign.toml, sorted; ``@FILE`` or a .txt file for the paths in it, one a
    line but for comments (#). What does not exist stays: the batch says so in its row."""
    seen: dict[str, str] = {}
    for path in _opened([given] if isinstance(given, str | os.PathLike) else given):
        line = path.isprintable() and path == path.strip() and path and path[0] != "#"
        require(
            line,
            f"paths of campaigns must be printable and stand on one line, got {path!r}. Rename it.",
        )
        whole = os.path.abspath(path)
        seen.setdefault(
            os.path.dirname(whole) if os.path.basename(whole) == TOML_NAME else whole, path
        )
    paths = tuple(seen.values())
    got = f"got none among {len(paths)}{f' ({paths[0]})' if paths else ''}"
    cure = f"Name folders with {TOML_NAME}, tidy CSVs, folders of campaigns, or a list (@FILE)."
    there = any(
        os.path.isfile(os.path.join(path, TOML_NAME)) or os.path.isfile(path) for path in paths
    )
    require(there, f"a batch must have campaigns that exist, {got}. {cure}")
    return paths


def _opened(given: Iterable[str | os.PathLike[str]]) -> Iterator[str]:
    """Every path by itself: lists read, folders of campaigns opened."""
    for entry in (os.fspath(each) for each in given):
        if not (
            entry.startswith("@") or (entry.lower().endswith(".txt") and os.path.isfile(entry))
        ):
            yield from _inside(entry)
            continue
        file = Path(entry.removeprefix("@"))
        try:
            text = bytes_of(
                file, _LARGEST_LIST, what="a list of campaigns, one path a line"
            ).decode("utf-8-sig")
        except UnicodeDecodeError:
            raise InputError(
                f"{file} must be UTF-8 text, got another encoding. Save it as UTF-8."
            ) from None
        for line in map(str.strip, text.splitlines()):
            if line and not line.startswith("#"):
                yield from _inside(line)


def _inside(path: str) -> list[str]:
    """The path itself, or the campaigns right in a folder of campaigns."""
    if not os.path.isdir(path) or os.path.isfile(os.path.join(path, TOML_NAME)):
        return [path]
    try:
        with os.scandir(path) as entries:
            names = sorted(
                entry.name
                for entry in entries
                if os.path.isfile(os.path.join(entry.path, TOML_NAME))
            )
    except OSError as error:
        raise InputError(
            f"{path} must be a readable folder, got: {error.strerror}. Check its permissions."
        ) from None
    return [os.path.join(path, name) for name in names] or [path]
