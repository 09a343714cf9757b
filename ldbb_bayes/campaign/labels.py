"""Whose a campaign is and of when, as its campaign.toml says it, even where nothing else in it can be read."""

from __future__ import annotations

import os
from pathlib import Path

from ldbb_bayes.campaign.folder import TOML_NAME, iso
from ldbb_bayes.errors import InputError
from ldbb_bayes.toml import read_toml

__all__ = ["labels_of"]

_LABELS = ("name", "machine_id", "date")
_LONGEST = 200


def labels_of(path: str | os.PathLike[str]) -> dict[str, str]:
    """Name, machine_id and date [ISO 8601] of a campaign folder or campaign.toml, those that are there; of a tidy CSV none."""
    file = Path(path) / TOML_NAME if os.path.isdir(path) else Path(path)
    if file.suffix.lower() != ".toml":
        return {}
    try:
        content = read_toml(file)
    except InputError:
        return {}
    found = {label: iso(content.get(label)) for label in _LABELS}
    return {
        label: value
        for label, value in found.items()
        if isinstance(value, str) and value.isprintable() and 0 < len(value) <= _LONGEST
    }
