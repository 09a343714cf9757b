"""Advice on a folder that was named as a campaign and holds tables, or campaigns, instead."""

from __future__ import annotations

import shlex
from collections import Counter
from itertools import islice
from pathlib import Path

from ldbb_bayes.campaign.campaign_writer import TOML_NAME
from ldbb_bayes.files.similar_names import MOST_ENTRIES

__all__ = ["advice_on_folder"]


def advice_on_folder(folder: Path) -> str:
    """Return advice for the error message about a folder that holds no campaign.toml.

    If the folder holds campaign folders, the advice names one of them. If it holds files, the
    advice is the command that makes a campaign of them, and the one that reports on them directly.
    If it holds neither, the advice only asks the user to check the path.

    Parameters
    ----------
    folder
        Path of an existing folder without a campaign.toml.

    Returns
    -------
    str
        Advice, such as "Name one of the campaigns in it, such as shop/mill_1."
    """
    try:
        entries = sorted(islice(folder.iterdir(), MOST_ENTRIES))
        campaigns = [entry for entry in entries if (entry / TOML_NAME).is_file()]
        files = [entry for entry in entries if entry.is_file() and entry.name[:1] != "."]
    except OSError:
        return "Check the path."
    if campaigns:
        return f"Name one of the campaigns in it, such as {campaigns[0]}."
    if not files:
        return "Check the path."
    endings = Counter(file.suffix for file in files)
    ending, _ = endings.most_common(1)[0]
    tables = f"{shlex.quote(str(folder))}/*{ending}"
    return (
        "Make a campaign of the tables in it with ldbb-bayes import"
        f" {tables} --out DIR, and name DIR; or report on them with ldbb-bayes report {tables}."
    )
