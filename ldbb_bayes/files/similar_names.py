"""Advice on the path of a file that does not exist: the most similar name in its folder."""

from __future__ import annotations

from difflib import SequenceMatcher
from itertools import islice
from pathlib import Path

from ldbb_bayes.errors import nearest

__all__ = ["advice_on_path"]

# Names are similar from this ratio on (`difflib.SequenceMatcher.ratio`).
_SIMILAR = 0.6
# Largest number of names in a folder that are compared.
_MOST_NAMES = 2000


def advice_on_path(path: Path) -> str:
    """Return a sentence for the message about a path where there is nothing.

    It names the most similar path in the same folder, or the first folder that does not exist.

    Parameters
    ----------
    path
        The path.

    Returns
    -------
    str
        The sentence, such as "Did you mean '36N.csv'?".
    """
    for folder in reversed(path.parents):
        if not folder.exists():
            return f"There is no folder {folder}. Check the path."
    try:
        names = [entry.name for entry in islice(path.parent.iterdir(), _MOST_NAMES)]
    except OSError:
        return "Check the path."
    if not names:
        return "Check the path."
    name = nearest(path.name, sorted(names))
    if SequenceMatcher(None, name.casefold(), path.name.casefold()).ratio() < _SIMILAR:
        return "Check the path."
    return f"Did you mean {str(path.parent / name)!r}?"
