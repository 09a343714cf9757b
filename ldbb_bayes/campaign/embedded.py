"""The campaign that comes with the package."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from ldbb_bayes.errors import InputError

__all__ = ["embedded_campaign"]


def embedded_campaign(name: str = "recovered_experiment") -> Path:
    """Folder of an embedded campaign, from the installed wheel or from the checkout.

    Raises
    ------
    InputError
        When the installation came without its data.
    """
    package = Path(str(files("ldbb_bayes")))
    for folder in (package / "_data" / name, package.parent / "data" / name):
        if (folder / "campaign.toml").is_file():
            return folder
    raise InputError(
        f"embedded campaign must be one of those installed, got {name!r}, which is missing. Install the package again."
    )
