"""Advice on the path of a file that does not exist: the most similar name in its folder."""

from __future__ import annotations

from difflib import SequenceMatcher
from itertools import islice
from pathlib import Path

from ldbb_bayes.errors import nearest

__all__ = ["MOST_ENTRIES", "advice_on_path"]

# Two names count as similar if their similarity, computed by `difflib.SequenceMatcher.ratio`, is at
# least this value.
_SIMILAR = 0.6
# Largest number of entries of a folder that are looked at for advice on a path.
MOST_ENTRIES = 2000


def advice_on_path(path: Path) -> str:
    """Return advice for the error message about a path that does not exist.

    If a folder of the path does not exist, the advice names the first such folder. If all folders
    exist, the advice names the file or folder with the most similar name in the last folder. If no
    name is similar, the advice only asks the user to check the path.

    Parameters
    ----------
    path
        Path that does not exist.

    Returns
    -------
    str
        Advice, such as "Did you mean '36N.csv'?".
    """
    for folder in reversed(path.parents):
        if not folder.exists():
            return f"There is no folder {folder}. Check the path."
    try:
        names = [entry.name for entry in islice(path.parent.iterdir(), MOST_ENTRIES)]
    except OSError:
        return "Check the path."
    if not names:
        return "Check the path."
    name = nearest(path.name, sorted(names))
    if SequenceMatcher(None, name.casefold(), path.name.casefold()).ratio() < _SIMILAR:
        return "Check the path."
    return f"Did you mean {str(path.parent / name)!r}?"
