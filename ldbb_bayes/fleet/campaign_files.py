"""Digest of the files of a campaign, by which a batch notices that a campaign has changed."""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ldbb_bayes.campaign.folder import TOML_NAME

__all__ = ["digest_of_files"]

# Keys of campaign.toml whose values name a file of readings or a calibration certificate.
_KEYS_OF_FILES = ("file", "dcc")
# Key of campaign.toml whose value names the folder of an earlier campaign, the pilot.
_KEY_OF_PILOT = "pilot"


def digest_of_files(path: str) -> str:
    """Return the SHA-256 digest of the contents of all files of a campaign.

    These are campaign.toml, the files of readings and the certificates that it names, and the files
    of its pilot; or else a tidy CSV. A file that cannot be read counts as an empty one.

    Parameters
    ----------
    path : path of a campaign folder, a campaign.toml or a tidy CSV.
    """
    main_file = Path(path)
    if main_file.is_dir():
        main_file = main_file / TOML_NAME
    digest = hashlib.sha256()
    for file in _files_of_campaign(main_file):
        content = _content_of(file)
        digest.update(f"{len(content)} ".encode())
        digest.update(content)
    return digest.hexdigest()


def _files_of_campaign(main_file: Path) -> Iterator[Path]:
    """Yield the files of a campaign; ``main_file`` is its campaign.toml or its tidy CSV.

    A pilot has no pilot, so the files of a pilot are followed no further.
    """
    pilots = []
    for key, name in _named_files(main_file):
        file = main_file.parent / name
        if key == _KEY_OF_PILOT:
            pilots.append(file / TOML_NAME)
        else:
            yield file
    yield main_file
    for pilot in pilots:
        yield pilot
        for key, name in _named_files(pilot):
            if key != _KEY_OF_PILOT:
                yield pilot.parent / name


def _named_files(main_file: Path) -> list[tuple[str, str]]:
    """Return the key and the value of each entry of campaign.toml that names a file or a folder.

    ``main_file`` is the path of campaign.toml. The list is empty for a tidy CSV, and for a file
    that cannot be read.
    """
    if main_file.suffix.lower() != ".toml":
        return []
    try:
        content = tomllib.loads(_content_of(main_file).decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError):
        return []
    return list(_entries_with_names(content))


def _entries_with_names(content: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the key and the value of each entry of a TOML file that names a file or a folder.

    ``content`` is the content of the TOML file.
    """
    for key, value in content.items():
        if isinstance(value, str) and key in (*_KEYS_OF_FILES, _KEY_OF_PILOT):
            yield key, value
        elif isinstance(value, Mapping):
            yield from _entries_with_names(value)
        elif isinstance(value, list):
            for entry in value:
                if isinstance(entry, Mapping):
                    yield from _entries_with_names(entry)


def _content_of(file: Path) -> bytes:
    """Return the content of a file; empty if the file cannot be read."""
    try:
        return file.read_bytes()
    except (OSError, ValueError):
        return b""
