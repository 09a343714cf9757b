"""Campaign folders and tidy tables: read into a campaign or plan, and written."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields, replace
from datetime import date
from importlib.resources import files
from pathlib import Path
from typing import Any

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.campaign_toml import LARGEST_PLAN, read_campaign_toml
from ldbb_bayes.campaign.campaign_writer import TOML_NAME, write_campaign_into
from ldbb_bayes.campaign.certified_instrument import Instrument
from ldbb_bayes.campaign.readings_table import tests_of_table
from ldbb_bayes.errors import InputError, check_known, placed
from ldbb_bayes.files import read_toml, staged_folder

__all__ = [
    "IMPORT_NAME",
    "LARGEST_PLAN",
    "TOML_NAME",
    "TRUTH_NAME",
    "embedded_campaign",
    "files_of",
    "labels_of",
    "read_campaign",
    "write_campaign",
    "write_campaign_into",
]

# Files beside campaign.toml: the truth of a simulation, and how foreign files were read.
TRUTH_NAME = "truth.json"
IMPORT_NAME = "import.toml"
# Longest name, machine_id or date that is a label [characters].
_LONGEST_LABEL = 200


def read_campaign(
    path: str | os.PathLike[str], *, certificates: Mapping[str, Any] | None = None, **options: Any
) -> Campaign:
    """Return the campaign, or the plan, of a campaign folder, a campaign.toml, or one tidy CSV.

    Parameters
    ----------
    path
        Of the folder or file.
    certificates
        Fields of `Instrument`, before what campaign.toml says of them.
    **options
        For a tidy CSV only, what campaign.toml would say (``radius_mm=150``,
        ``mount=MountCompensation(...)``, …).

    Returns
    -------
    Campaign
        The campaign or plan.

    Raises
    ------
    InputError
        Names the file, what is wrong and how to mend it.
    """
    path = Path(path)
    if path.is_dir():
        path = path / TOML_NAME
    if not path.is_file():
        fault = "is no ordinary file" if path.exists() else "does not exist"
        raise InputError(
            f"campaign must be a folder with {TOML_NAME}, a {TOML_NAME} or a tidy CSV, got {path},"
            f" which {fault}. Check the path."
        )
    known_options = [entry.name for entry in fields(Campaign) if entry.name != "tests"]
    check_known("option", options, known_options)
    if path.suffix.lower() != ".toml":
        tests = tests_of_table(path)
        campaign_fields = {"name": path.stem, **options}
    elif options:
        raise InputError(
            f"options must come with a tidy CSV, got {', '.join(options)} with {path}. Write them"
            f" into {path.name}."
        )
    else:
        tests, campaign_fields = read_campaign_toml(path)
    with placed(path):
        instrument = campaign_fields.pop("instrument", Instrument())
        if certificates:
            instrument = _with_certificates(instrument, certificates)
        return Campaign(tests, instrument=instrument, **campaign_fields)


def _with_certificates(instrument: Instrument, certificates: Mapping[str, Any]) -> Instrument:
    """Return the instrument with other certified fields.

    A certificate that is named for what they replace is no longer named.
    """
    changes: dict[str, Any] = {}
    for name in certificates:
        certified = name.partition("_")[0]
        if certified in ("bar", "force"):
            changes[f"{certified}_certificate"] = None
    return replace(instrument, **changes | dict(certificates))


def write_campaign(
    campaign: Campaign, folder: str | os.PathLike[str], *, force: bool = False
) -> Path:
    """Write a campaign (or plan) folder, whole or not at all, and return its path.

    Numbers are written so that they read back to the same doubles.

    Parameters
    ----------
    campaign
        A campaign or plan.
    folder
        Where to write it.
    force
        Whether an existing campaign folder is replaced.

    Returns
    -------
    pathlib.Path
        The folder.
    """
    folder = Path(folder)
    with staged_folder(folder, force=force, ours=files_of(folder)) as staging:
        write_campaign_into(campaign, staging)
    return folder


def files_of(folder: Path) -> set[str]:
    """Return the names in a folder that may go when its campaign is replaced."""
    try:
        tests = read_toml(folder / TOML_NAME).get("test", [])
        listed = {str(entry.get("file", "")) for entry in tests}
    except (InputError, AttributeError, TypeError):
        return set()
    return {TOML_NAME, TRUTH_NAME, IMPORT_NAME, *listed}


def labels_of(path: str | os.PathLike[str]) -> dict[str, str]:
    """Return name, machine_id and date [ISO 8601] of a campaign folder or campaign.toml.

    Those that are there; the machine_id is by default the serial number. A tidy CSV has none.
    """
    file = Path(path)
    if os.path.isdir(path):
        file = file / TOML_NAME
    content: dict[str, Any] = {}
    if file.suffix.lower() == ".toml":
        with suppress(InputError):
            content = read_toml(file)
    content = {"machine_id": content.get("serial_number"), **content}
    labels = {}
    for label in ("name", "machine_id", "date"):
        text = content.get(label)
        if isinstance(text, date):
            text = text.isoformat()
        if isinstance(text, str) and text.isprintable() and 0 < len(text) <= _LONGEST_LABEL:
            labels[label] = text
    return labels


def embedded_campaign(name: str = "recovered_experiment") -> Path:
    """Return the folder of an embedded campaign.

    Parameters
    ----------
    name
        Of the campaign.

    Returns
    -------
    pathlib.Path
        In the installed wheel or in the checkout.

    Raises
    ------
    InputError
        If it is not installed.
    """
    package = Path(str(files("ldbb_bayes")))
    for folder in (package / "_data" / name, package.parent / "data" / name):
        if (folder / TOML_NAME).is_file():
            return folder
    raise InputError(
        f"embedded campaign must be one of those installed, got {name!r}, which is missing. Install"
        " the package again."
    )
