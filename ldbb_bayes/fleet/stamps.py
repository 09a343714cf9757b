"""Whether a campaign's files are those that were fitted: names, sizes and times of change, without reading them again."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator

__all__ = ["stamp_of"]

_READ = (".toml", ".csv")


def stamp_of(place: str | os.PathLike[str]) -> str | None:
    """Digest of what the files of a campaign look like from outside; None where nothing is there.

    Parameters
    ----------
    place : path
        A campaign folder, a campaign.toml or a tidy CSV.
    """
    digest = hashlib.blake2b(digest_size=8)
    seen = False
    try:
        for name, path in sorted(_files(os.fspath(place))):
            known = os.stat(path)
            digest.update(f"{name}\0{known.st_size}\0{known.st_mtime_ns}\n".encode(errors="surrogateescape"))
            seen = True
    except (OSError, ValueError):
        return None
    return digest.hexdigest() if seen else None


def _files(place: str) -> Iterator[tuple[str, str]]:
    """Names relative to the campaign, and paths."""
    root = place if os.path.isdir(place) else os.path.dirname(place) or "."
    if not os.path.isdir(place) and not place.lower().endswith(".toml"):
        yield os.path.basename(place), place
        return
    for folder, _, names in os.walk(root):
        for name in names:
            if name.lower().endswith(_READ):
                path = os.path.join(folder, name)
                yield os.path.relpath(path, root), path
