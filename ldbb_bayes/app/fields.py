"""Entry fields of the browser page, and conversion of typed texts to command-line options."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import ldbb_bayes as lb
from ldbb_bayes.campaign.folder import TOML_NAME
from ldbb_bayes.campaign.tested_forces import check_force
from ldbb_bayes.cli.arguments import campaign_fields, instrument_fields
from ldbb_bayes.cli.chosen_model import model_from
from ldbb_bayes.cli.fit_results import with_tolerances
from ldbb_bayes.cli.layout_options import LAYOUT_OPTIONS
from ldbb_bayes.cli.options import FORCES, PRESSURES, Kind, Option, group, option, options_of
from ldbb_bayes.cli.questions import MACHINES
from ldbb_bayes.cli.reporting import REPORT_OPTIONS
from ldbb_bayes.cli.sources import ReportSource, SourceCampaign
from ldbb_bayes.errors import InputError, require
from ldbb_bayes.reading.file_patterns import matching

__all__ = [
    "FIELDS",
    "FILES",
    "RESULT",
    "Field",
    "linear_model",
    "read_files",
    "report_settings",
    "source_from",
    "typed_value",
    "with_decimal_points",
]

FILES = "campaign"  # subfolder of a session (one browser tab) for the files that the user added
RESULT = "result"  # subfolder of a session (one browser tab) for the finished report
_DCC_SUFFIX = ".xml"


class Field(NamedTuple):
    """One entry field of the browser page, which sets one option of ``ldbb-bayes report``."""

    name: str  #: Name of the command-line option, such as ``radius_mm``.
    #: Group of entry fields to which the command-line option belongs: name, table, certificates,
    #: labels, layout or report.
    group: str
    #: Flag that sets the option on the command line, such as ``--radius-mm``.
    flag: str
    #: Help text of the command-line option, which the browser page shows at the entry field.
    help: str
    #: Kind of the entry field: text, number, lines (several texts), choice, or file (the name of a
    #: file that the user added).
    kind: str
    #: Values that the user can choose in the entry field, each with its description; empty if the
    #: entry is free text.
    choices: tuple[tuple[str, str], ...] = ()


_GROUPS: Mapping[str, Mapping[str, Option]] = {
    "name": {"name": option(str, "Name of the campaign. Default: of the file or its folder.")},
    "table": options_of("table"),
    "certificates": options_of("certificates"),
    "labels": options_of("labels"),
    "layout": {
        name: layout_option
        for name, layout_option in LAYOUT_OPTIONS.options.items()
        if name != "layout"
    },
    "report": REPORT_OPTIONS.options,
}
# Options of the command ``report`` that have entry fields on the browser page. The server sets the
# other options of this command.
_REPORT_FIELDS = ("force_N", "tolerance", "language")
_CHOICES: Mapping[str, tuple[str, ...]] = {
    "plane": ("XY", "YZ", "ZX"),
    "direction": ("CW", "CCW"),
    "zero": ("deviation", "distance"),
    "laps": ("keep", "average"),
    "sign": ("1", "-1"),
    "measured": ("radius", "diameter"),
    "angle_zero": ("+X", "-X", "+Y", "-Y", "+Z", "-Z"),
    "angle_sense": ("CCW", "CW"),
    "angle_sign": ("1", "-1"),
    "gaps": ("still", "moving"),
    "decimal": (".", ","),
    "raw": ("yes",),
    "order": ("random",),
    "no_drift": ("yes",),
}
_KINDS_OF_ENTRY: Mapping[Any, str] = {
    int: "number",
    float: "number",
    Path: "file",
    list[str]: "lines",
}


def _type_of_entry(field_option: Option) -> Any:
    """Return the Python type to which the command line converts the typed value of an option."""
    kind = field_option.kind
    return kind.typed if isinstance(kind, Kind) else kind


def _entry_field(name: str, group_name: str, field_option: Option) -> Field:
    """Return the entry field for the command-line option ``name``.

    ``group_name`` is the name of the group to which the option belongs. The result also states the
    kind of the field and, if only certain values are allowed, these values.
    """
    choices = tuple((value, value) for value in _CHOICES.get(name, ()))
    if name == "topology":
        choices = tuple(
            (machine.topology, f"{machine.name} ({machine.topology}): {machine.looks}")
            for machine in MACHINES
        )
    kind = "choice"
    if not choices:
        kind = _KINDS_OF_ENTRY.get(_type_of_entry(field_option), "text")
    flag = field_option.flag(name)
    return Field(name, group_name, flag, field_option.help, kind, choices)


def _all_fields() -> dict[str, Field]:
    """Return the entry fields for options of ``ldbb-bayes report``; the keys are option names."""
    fields = {}
    for group_name, options in _GROUPS.items():
        for name, field_option in options.items():
            if group_name != "report" or name in _REPORT_FIELDS:
                fields[name] = _entry_field(name, group_name, field_option)
    return fields


FIELDS: Mapping[str, Field] = _all_fields()


# ---- conversion of texts typed on the browser page


def typed_value(field_option: Option, name: str, text: str, folder: Path) -> Any:
    """Return the value of an option from the text typed on the page.

    Parameters
    ----------
    field_option
        The option.
    name
        Name of the option.
    text
        Text typed on the page.
    folder
        Folder of the session (one browser tab), which contains the files that the user added.

    Returns
    -------
    object
        The value that Typer, the library that reads the command line, would return.

    Raises
    ------
    InputError
        If the text cannot be read.
    """
    typed = _type_of_entry(field_option)
    flag = field_option.flag(name)
    if typed is bool:
        return text == "yes"
    if typed is Path:
        return _added_file(text, flag, folder)
    if typed == list[str]:
        return _typed_lines(name, text)
    if typed in (int, float):
        return _typed_number(field_option, flag, text)
    if field_option.kind in (FORCES, PRESSURES) and ";" in text:
        # The text that the user typed has decimal commas, and semicolons between numbers. Replace
        # the commas by decimal points, and the semicolons by commas.
        return text.replace(",", ".").replace(";", ",")
    return text


def _added_file(name: str, flag: str, folder: Path) -> Path:
    """Return the path of a file that the user added and then chose in an entry field.

    ``name`` is the name of the file, and ``flag`` the command-line flag of the option that the
    field sets. Raise an `InputError` if no added file has this name.
    """
    names = [path.name for path in (folder / FILES).iterdir()]
    require(
        name in names,
        f"{flag} must be a file that was added, got {name!r}. Add it, or choose none.",
    )
    return folder / FILES / name


def _typed_lines(name: str, text: str) -> list[str]:
    """Return the lines that the user typed into an entry field. Empty lines are left out.

    ``name`` is the name of the command-line option that the field sets. Decimal commas in
    tolerances are replaced by decimal points.
    """
    lines = [line.strip() for line in text.splitlines()]
    lines = [line for line in lines if line]
    if name == "tolerance":
        return [with_decimal_points(line, "a tolerance") for line in lines]
    return lines


def with_decimal_points(text: str, what: str) -> str:
    """Return a text in which decimal commas are replaced by decimal points.

    Raise an `InputError` if a comma may stand between thousands, as in 1,000. ``what`` says in the
    error message what the text is.
    """
    require(
        re.search(r"(?<![\d.,])[1-9]\d{0,2}(,\d{3})+(?!\d)", text) is None,
        f"{what} must be a number without marks between thousands, got {text!r}. Write it like 1000"
        " or 1.5.",
    )
    return re.sub(r"(?<=\d),(?=\d)", ".", text)


def _typed_number(field_option: Option, flag: str, text: str) -> float:
    """Return the number that the user typed into a field.

    A decimal comma is accepted. The field sets a command-line option; ``flag`` is its flag, such as
    ``--radius-mm``. Raise an `InputError` if the text is no number, if it has marks between
    thousands, or if the number is outside the limits of the option.
    """
    typed = _type_of_entry(field_option)
    has_thousands = re.fullmatch(r"[-−]?[1-9]\d{0,2}([.,]\d{3})+", text) or "_" in text
    require(
        not has_thousands,
        f"{flag} must be a number without marks between thousands, got {text!r}. Write it like 1000"
        " or 1.5.",
    )
    try:
        number: float = typed(text.replace(",", ".").replace("−", "-"))
    except ValueError:
        wanted = "whole number" if typed is int else "number"
        cure = "Correct it."
        if re.match(r"[-−+]?\d[\d.,]*\s*([^\W\d_]|[°%])", text):
            cure = "Write the number alone, without its unit."
        raise InputError(f"{flag} must be a {wanted}, got {text!r}. {cure}") from None

    low = field_option.settings.get("min", -math.inf)
    high = field_option.settings.get("max", math.inf)
    limits = []
    if low > -math.inf:
        limits.append(f"at least {low:g}")
    if high < math.inf:
        limits.append(f"at most {high:g}")
    elif not math.isfinite(number):
        limits.append("finite")
    require(
        math.isfinite(number) and low <= number <= high,
        f"{flag} must be {' and '.join(limits) or 'finite'}, got {number:g}. Correct it.",
    )
    return number


def _make_from_entries(
    group_name: str, make: Callable[..., Any], entries: Mapping[str, str], folder: Path
) -> Any:
    """Return the result of calling a function with the values of a group of options.

    The command ``ldbb-bayes report`` obtains the same result from the same values of the options.

    Parameters
    ----------
    group_name
        Name of the group of options, such as layout.
    make
        Function that is called, such as a function that returns the layout of the tables. Its
        keyword arguments are the values of the options.
    entries
        Texts typed on the page; the keys are the names of the entry fields.
    folder
        Folder of the session (one browser tab), which contains the files that the user added.

    Returns
    -------
    object
        What ``make`` returns. An option whose entry field is empty has its default value.
    """
    options = _GROUPS[group_name]
    typed = {}
    for name, field_option in options.items():
        text = entries.get(name, "").strip() if name in FIELDS else ""
        typed[name] = field_option.default
        if text:
            typed[name] = typed_value(field_option, name, text, folder)
    return group(make, **options).take_from(typed)


def report_settings(folder: Path, entries: Mapping[str, str]) -> dict[str, Any]:
    """Return the options of a session's report, converted as ``ldbb-bayes report`` converts them.

    Parameters
    ----------
    folder
        Folder of the session (one browser tab).
    entries
        Texts typed on the page; the keys are the names of the entry fields.

    Returns
    -------
    dict
        Values of the options; the keys are the names of the options.

    Raises
    ------
    InputError
        If an entry cannot be read.
    """
    settings: dict[str, Any] = _make_from_entries("report", dict, entries, folder)
    return settings


def source_from(folder: Path, entries: Mapping[str, str]) -> ReportSource:
    """Return the files of a session, and the command-line options that describe their content.

    Parameters
    ----------
    folder
        Folder of the session (one browser tab).
    entries
        Texts typed on the page; the keys are the names of the entry fields.

    Returns
    -------
    ReportSource
        Paths of the files, the layout of their tables, and the properties of the campaign and of
        the instrument that the user stated.

    Raises
    ------
    InputError
        If there are no files with readings, or an entry cannot be read.
    """
    paths = sorted((folder / FILES).iterdir())
    paths = [path for path in paths if path.suffix.lower() != _DCC_SUFFIX]
    require(
        paths,
        "files with readings must be given, got none. Drop a workbook, CSV or text files, or take"
        " the example.",
    )
    files = paths
    if any(path.name == TOML_NAME for path in paths):
        files = [folder / FILES]
    elif len(paths) > 1:
        # Name the files by wildcards such as ``*.csv``. Files without readings are then skipped,
        # whereas a file without readings that is named in full would be refused.
        suffixes = sorted({path.suffix for path in paths} - {""})
        files = [folder / FILES / f"*{suffix}" for suffix in suffixes]
        files += [path for path in paths if not path.suffix]

    stated: dict[str, Any] = {}
    for group_name in ("name", "table", "labels"):
        stated |= _make_from_entries(group_name, dict, entries, folder)
    instrument_of_length = partial(instrument_fields, bar_length_mm=stated.get("radius_mm"))
    return ReportSource(
        typed_paths=files,
        paths=matching(files),
        layout=_make_from_entries("layout", LAYOUT_OPTIONS.make, entries, folder),
        campaign_fields=campaign_fields(**stated),
        certificates=_make_from_entries("certificates", instrument_of_length, entries, folder),
    )


def read_files(folder: Path, entries: Mapping[str, str]) -> SourceCampaign:
    """Return the campaign that the files of a session contain.

    The files are read in the same way as for the report.

    Parameters
    ----------
    folder
        Folder of the session (one browser tab).
    entries
        Texts typed on the page; the keys are the names of the entry fields.

    Returns
    -------
    SourceCampaign
        The campaign, and the assumptions made when it was imported.

    Raises
    ------
    InputError
        If a file or an entry cannot be used.
    """
    campaign, imported = source_from(folder, entries).read(ask=False)
    settings = report_settings(folder, entries)
    check_force(campaign, settings.get("force_N"))
    campaign = with_tolerances(campaign, model_from(), settings.get("tolerances", {}))
    return SourceCampaign(campaign, imported)


def linear_model() -> lb.HybridModel:
    """Return the model that the browser page fits: compliance linear in force."""
    return model_from()
