"""Reading and writing of campaign folders, and reading of campaigns from one CSV file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, fields, replace
from datetime import date
from importlib.resources import files
from pathlib import Path
from typing import Any

import tomli_w

from ldbb_bayes.campaign.campaign import Campaign, require_campaign
from ldbb_bayes.campaign.campaign_toml import LARGEST_PLAN, read_campaign_toml
from ldbb_bayes.campaign.campaign_writer import PILOT_NAME, TOML_NAME, write_campaign_into
from ldbb_bayes.campaign.certified_instrument import Instrument
from ldbb_bayes.campaign.folder_of_tables import advice_on_folder
from ldbb_bayes.campaign.readings_table import tests_of_table
from ldbb_bayes.errors import InputError, check_known, placed, require
from ldbb_bayes.files import read_toml, staged_folder
from ldbb_bayes.files.similar_names import advice_on_path

__all__ = [
    "IMPORT_NAME",
    "LARGEST_PLAN",
    "MODEL_NAME",
    "TOML_NAME",
    "TRUTH_NAME",
    "embedded_campaign",
    "files_of",
    "labels_of",
    "pilot_of_plan",
    "read_campaign",
    "write_campaign",
    "write_campaign_into",
]

# Name of a file in the folder of a simulated campaign. The file holds the true parameters.
TRUTH_NAME = "truth.json"
# Name of a file in the folder of a plan. The file holds the model with which the plan was designed,
# for the analysis of the readings.
MODEL_NAME = "model.toml"
# Name of a file in the folder of an imported campaign. The file states how the imported files were
# read.
IMPORT_NAME = "import.toml"
# Largest number of characters of a name, machine_id or date that `labels_of` returns; longer
# texts are left out.
_LONGEST_LABEL = 200
# Fields of `Campaign` that have another name as a table of campaign.toml.
_TABLE_OF_FIELD = {"force_law": "force", "frames_mm": "frames"}


def read_campaign(
    path: str | os.PathLike[str], *, certificates: Mapping[str, Any] | None = None, **options: Any
) -> Campaign:
    """Return the campaign or plan that a campaign folder, a campaign.toml or a tidy CSV describes.

    A tidy CSV is a table with one reading in each row, and columns named like the fields of
    `CircularTest`. For tables that are not tidy, see `import_campaign`.

    Parameters
    ----------
    path : str or os.PathLike
        Path of the folder or file.
    certificates : mapping of str to object, optional
        Values of fields of `Instrument`; the keys are the names of the fields. These values replace
        those in ``campaign.toml``; a tidy CSV contains no such values.
    **options : object
        Values of fields of `Campaign`, such as ``radius_mm=150``. They are permitted only with a
        tidy CSV, because a ``campaign.toml`` already contains these values.

    Returns
    -------
    Campaign
        The campaign or plan.

    Raises
    ------
    InputError
        For anything that cannot be read. The message names the file and the fault, and says what
        the user can do.

    Examples
    --------
    >>> lb.read_campaign(lb.embedded_campaign())
    <Campaign wCAFYXZSt, recovered experiment: 6 tests, 36 to 742 N, 4320 readings>
    >>> calibrated = lb.read_campaign(lb.embedded_campaign(), certificates={"bar_U_um": 1.0})
    >>> calibrated.instrument.bar_U_um
    1.0
    """
    require(
        isinstance(path, str | os.PathLike),
        f"path must be the name of a folder or file, got {path!r}. Give for example 'campaign'.",
    )
    path = Path(path)
    if path.is_dir():
        path = path / TOML_NAME
    if path.name == TOML_NAME and path.parent.is_dir() and not path.exists():
        raise InputError(
            f"campaign must be a folder with {TOML_NAME}, got {path.parent}, a folder without one."
            f" {advice_on_folder(path.parent)}"
        )
    if not path.is_file():
        fault = "does not exist"
        advice = advice_on_path(path)
        if path.exists():
            fault = "is no ordinary file"
            advice = "Check the path."
        raise InputError(
            f"campaign must be a folder with {TOML_NAME}, a {TOML_NAME} or a tidy CSV (the command"
            f" import makes one of other tables and workbooks), got {path}, which {fault}."
            f" {advice}"
        )
    known_options = [entry.name for entry in fields(Campaign) if entry.name != "tests"]
    check_known("option", options, known_options)
    if path.suffix.lower() != ".toml":
        tests = tests_of_table(path)
        campaign_fields = {"name": path.stem, **options}
    elif options:
        raise InputError(
            f"options must come with a tidy CSV, got {', '.join(options)} with {path}."
            f" {_lines_to_write(options, path.name)}"
        )
    else:
        tests, campaign_fields = read_campaign_toml(path)
    instrument = campaign_fields.pop("instrument", Instrument())
    if certificates:
        with placed(f"what is given beside {path}"):
            instrument = _with_certificates(instrument, certificates)
    with placed(path):
        return Campaign(tests, instrument=instrument, **campaign_fields)


def _lines_to_write(options: Mapping[str, Any], file_name: str) -> str:
    """Return a sentence that tells the user to write values into the TOML file of a campaign.

    ``options`` holds these values, which the user gave as arguments; the keys are the names of
    fields of `Campaign`. ``file_name`` is the name of the TOML file, such as campaign.toml.
    """
    lines = []
    tables = []
    for name, value in options.items():
        if isinstance(value, str | bool | int | float):
            lines.append(tomli_w.dumps({name: value}).strip())
        else:
            entries = value if isinstance(value, Mapping) else asdict(value)
            table = _TABLE_OF_FIELD.get(name, name)
            tables.append(f"{', '.join(_toml_lines(entries))} under [{table}]")
    sentences = []
    if lines:
        written = "the line" if len(lines) == 1 else "the lines"
        sentences.append(
            f"Write {written} {' and '.join(lines)} into {file_name}, above its tables, instead."
        )
    if tables:
        sentences.append(f"Write {' and '.join(tables)} into {file_name} instead.")
    return " ".join(sentences)


def _toml_lines(entries: Any) -> list[str]:
    """Return the lines of a TOML table with the ``entries`` of a mapping; None is left out."""
    stated = {name: value for name, value in dict(entries).items() if value is not None}
    return tomli_w.dumps(stated).strip().splitlines()


def _with_certificates(instrument: Instrument, certificates: Mapping[str, Any]) -> Instrument:
    """Return a copy of the instrument in which the values in ``certificates`` replace the old ones.

    The keys of ``certificates`` are names of fields of `Instrument`. If a value of the bar or of
    the force device is replaced, the name of the certificate that stated the old value is removed.
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
    """Write a campaign or plan into a folder, completely or not at all; return the folder's path.

    The folder holds ``campaign.toml``. If the campaign is not a plan, the folder also holds one CSV
    file of readings for each test. Numbers are written with all digits, so that reading the folder
    returns exactly the same numbers.

    Parameters
    ----------
    campaign : Campaign
        A campaign or plan.
    folder : str or os.PathLike
        Path of the folder to write.
    force : bool, default False
        Whether an existing campaign folder may be replaced.

    Returns
    -------
    pathlib.Path
        Path of the folder.

    Raises
    ------
    InputError
        In any of these cases:

        - The folder exists, and ``force`` is false.
        - The folder holds files that do not belong to a campaign.
        - The folder is the working directory, or contains the working directory.
        - The folder cannot be written.
        - The angles of a plan are not evenly spaced.

    Examples
    --------
    >>> folder = lb.write_campaign(campaign, "six_circles")
    >>> sorted(path.name for path in folder.iterdir())
    ['campaign.toml', 'f036.csv', 'f238.csv', 'f364.csv', 'f490.csv', 'f616.csv', 'f742.csv']
    >>> lb.read_campaign(folder).sha256 == campaign.sha256
    True
    """
    require_campaign(campaign)
    folder = Path(folder)
    with staged_folder(folder, force=force, ours=files_of(folder)) as staging:
        write_campaign_into(campaign, staging)
    return folder


def files_of(folder: Path) -> set[str]:
    """Return the names of all files in a campaign folder that belong to the folder's campaign.

    These files may be deleted when the campaign is replaced. The set is empty if the folder has no
    readable campaign.toml.
    """
    try:
        content = read_toml(folder / TOML_NAME)
        listed = {str(entry.get("file", "")) for entry in content.get("test", [])}
    except (InputError, AttributeError, TypeError):
        return set()
    return {TOML_NAME, TRUTH_NAME, IMPORT_NAME, *listed, *pilot_of_plan(folder)}


def pilot_of_plan(folder: Path | None) -> set[str]:
    """Return a set with the name of the pilot's folder, or an empty set if there is no pilot.

    The pilot is the campaign or plan from which the plan was designed. Its folder, which is inside
    the folder of the plan, holds only a copy and may be deleted when the plan is replaced.
    ``folder`` is the folder of the plan; if it is None, the set is empty.
    """
    if folder is None:
        return set()
    with suppress(InputError, AttributeError):
        if read_toml(folder / TOML_NAME).get("pilot") == PILOT_NAME:
            return {PILOT_NAME}
    return set()


def labels_of(path: str | os.PathLike[str]) -> dict[str, str]:
    """Return a dictionary with the name, the machine_id and the date that a campaign.toml states.

    The keys are name, machine_id and date. If machine_id is missing or empty, its value is the
    serial number of the machine. A date is a string in ISO 8601. Keys without a value, and keys
    whose values have more than 200 characters, are left out. The dictionary is empty for a file
    that cannot be read, and for a CSV file. ``path`` is the path of a campaign folder or of a file.
    """
    file = Path(path)
    if os.path.isdir(path):
        file = file / TOML_NAME
    content: dict[str, Any] = {}
    if file.suffix.lower() == ".toml":
        with suppress(InputError):
            content = read_toml(file)
    content["machine_id"] = content.get("machine_id") or content.get("serial_number")
    labels = {}
    for label in ("name", "machine_id", "date"):
        text = content.get(label)
        if isinstance(text, date):
            text = text.isoformat()
        if isinstance(text, str) and text.isprintable() and 0 < len(text) <= _LONGEST_LABEL:
            labels[label] = text
    return labels


def embedded_campaign(name: str = "recovered_experiment") -> Path:
    """Return the folder of a campaign that comes with the package.

    The readings of ``recovered_experiment`` are reconstructed from the tables of a published
    experiment: six circles at forces from 36 to 742 N. Details of the readings that the tables do
    not determine are synthetic.

    Parameters
    ----------
    name : str, default "recovered_experiment"
        Name of the campaign.

    Returns
    -------
    pathlib.Path
        Path of the folder, in the installed package or in the source repository.

    Raises
    ------
    InputError
        If there is no such campaign.

    Examples
    --------
    >>> lb.embedded_campaign().name
    'recovered_experiment'
    >>> len(lb.read_campaign(lb.embedded_campaign()).tests)
    6
    """
    package = Path(str(files("ldbb_bayes")))
    for folder in (package / "_data" / name, package.parent / "data" / name):
        if (folder / TOML_NAME).is_file():
            return folder
    raise InputError(
        f"embedded campaign must be one that is installed, got {name!r}. Leave the name out for"
        " recovered_experiment; if that is missing too, install the package again."
    )
