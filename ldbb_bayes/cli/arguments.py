"""Arguments that several commands have, and functions that make them from what the user typed."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import ldbb_bayes as lb
from ldbb_bayes.cli.chosen_model import model_file_of_campaign, model_from, model_options
from ldbb_bayes.cli.layout_options import LAYOUT_FLAGS, LAYOUT_OPTIONS
from ldbb_bayes.cli.options import Group, group, options_of
from ldbb_bayes.cli.output import Output
from ldbb_bayes.errors import InputError, require

if TYPE_CHECKING:
    from ldbb_bayes.cli.sources import SourceCampaign

__all__ = [
    "CI",
    "DETAILS",
    "ESS",
    "FORCE",
    "JSON",
    "PRIOR_FROM",
    "QUIET",
    "SEED",
    "CampaignArgument",
    "Certificates",
    "ChosenLayout",
    "ChosenModel",
    "FollowedTolerances",
    "GivenCampaign",
    "GivenReadings",
    "MeasuredCampaign",
    "MeasuredReadings",
    "ModelBeside",
    "OutputOptions",
    "PoolOptions",
    "ReportOutput",
    "TableFields",
    "Tolerances",
    "campaign_fields",
    "campaign_from",
    "instrument_fields",
]


def campaign_from(path: Path, *, needs_readings: bool = False, **options: Any) -> lb.Campaign:
    """Return the campaign in the file or folder that the user names as argument of a command.

    Parameters
    ----------
    path
        A campaign folder, a campaign.toml or a tidy CSV.
    needs_readings
        Whether a plan is refused.
    **options
        Values of the options for a tidy CSV and for certificates.

    Returns
    -------
    Campaign

    Raises
    ------
    InputError
        If the campaign cannot be read, if it is a plan but needs readings, or if options and files
        contradict each other.
    """
    certificates = {}
    for name in _CERTIFICATE_KEYWORDS:
        if name in options:
            certificates[name] = options.pop(name)
    campaign = lb.read_campaign(
        path,
        certificates=instrument_fields(bar_length_mm=options.get("radius_mm"), **certificates),
        **campaign_fields(**options),
    )
    if needs_readings:
        _require_readings(campaign, path)
    return campaign


def _require_readings(campaign: lb.Campaign, path: Path) -> None:
    """Raise an `InputError` that names the path of a campaign if the campaign is a plan."""
    require(
        not campaign.is_plan,
        f"{path} must have readings, got a plan: none of its tests names a file. Run its first"
        " circles and name the files of their readings in campaign.toml (file = …), or rehearse the"
        " plan with ldbb-bayes simulate.",
    )


def readings_from(
    files: list[Path], *, needs_readings: bool = False, yes: bool = False, **options: Any
) -> SourceCampaign:
    """Return the campaign or plan that is read from a campaign folder, a stored fit, or tables.

    Parameters
    ----------
    files
        Paths as typed by the user.
    needs_readings
        Whether a plan is refused.
    yes
        Whether nothing is asked, even at a terminal.
    **options
        Values of the options for tables, for their layout, and for certificates.

    Returns
    -------
    SourceCampaign
        The campaign, with the assumptions of its import if the files are tables.

    Raises
    ------
    InputError
        If the files cannot be read, if they are a plan but need readings, or if options and files
        contradict each other.
    """
    # The modules for the input of commands are imported here, and not at the top of the file,
    # because they take a long time to load.
    from ldbb_bayes.cli.sources import ReportSource
    from ldbb_bayes.reading.file_patterns import matching

    layout_options = {}
    certificates = {}
    for option_name in list(options):
        if option_name in LAYOUT_FLAGS:
            layout_options[option_name] = options.pop(option_name)
        elif option_name in _CERTIFICATE_KEYWORDS:
            certificates[option_name] = options.pop(option_name)
    bar_length_mm = options.get("radius_mm")
    source = ReportSource(
        files,
        matching(files),
        LAYOUT_OPTIONS.make(**layout_options),
        campaign_fields(**options),
        instrument_fields(bar_length_mm=bar_length_mm, **certificates),
    )
    read = source.read_any(may_ask=not yes)
    if needs_readings:
        _require_readings(read.campaign, files[0])
    return read


def instrument_fields(
    *, balls: lb.Ball | None = None, bar_length_mm: float | None = None, **options: Any
) -> dict[str, Any]:
    """Return the fields of `Instrument` that are set by options of the command line.

    Parameters
    ----------
    balls
        Properties of both the work ball and the tool ball, from the option ``--balls``.
    bar_length_mm
        Nominal length of the bar [mm]. This length is used to choose a bar if a certificate states
        several bars.
    **options
        Fields of `Instrument`, and paths of digital calibration certificates (DCC): ``bar_dcc``,
        ``force_dcc``, ``work_dcc``, ``tool_dcc``.

    Returns
    -------
    dict
        Fields of `Instrument` that options or certificates state; all other fields are left out.

    Raises
    ------
    InputError
        If a DCC cannot be read, or an option and a DCC state the same quantity.
    """
    from_files = _fields_from_dccs(options, bar_length_mm)
    for name in from_files:
        flag = ""
        if name in ("work", "tool"):
            flag = _ball_flag(name, options, balls)
        elif name in options:
            flag = f"--{name.replace('_', '-')}"
        if flag:
            raise InputError(
                f"what a DCC says must not be given by hand as well, got {flag} too. Keep one of"
                " them."
            )
    fields: dict[str, Any] = {}
    if balls is not None:
        fields = {"work": balls, "tool": balls}
    return fields | from_files | options


def _fields_from_dccs(options: dict[str, Any], bar_length_mm: float | None) -> dict[str, Any]:
    """Return a dictionary of the fields of `Instrument` that calibration certificates (DCC) state.

    The paths of the certificates are removed from ``options``. ``bar_length_mm`` is the nominal
    length of the bar [mm], which is used to choose a bar if a certificate describes several bars.
    """
    fields: dict[str, Any] = {}
    for kind in ("bar", "force"):
        file = options.pop(f"{kind}_dcc", None)
        if file is not None:
            certificate = lb.campaign.read_dcc(file)
            for name, value in certificate.fields(kind, bar_length_mm=bar_length_mm).items():
                fields[f"{kind}_{name}"] = value
    for ball in ("work", "tool"):
        file = options.pop(f"{ball}_dcc", None)
        if file is not None:
            fields[ball] = lb.Ball(**lb.campaign.read_dcc(file).fields("ball"))
    return fields


def _ball_flag(name: str, options: Mapping[str, Any], balls: lb.Ball | None) -> str:
    """Return the flag of the option with which the user described a ball.

    ``name`` is "work" or "tool", for the work ball or the tool ball. ``options`` are the options
    that the user typed, and ``balls`` is the value of the option ``--balls``. Return an empty
    string if no option describes the ball.
    """
    if name in options:
        return f"--{name}-ball"
    if balls is not None:
        return "--balls"
    return ""


def campaign_fields(
    *,
    raw: bool = False,
    mount_um_per_bar: float | None = None,
    force_slope: float | None = None,
    force_offset: float | None = None,
    no_drift: bool = False,
    **options: Any,
) -> dict[str, Any]:
    """Return the fields of `Campaign` that are set by options of the command line.

    Parameters
    ----------
    raw
        Whether the readings are not compensated for the deflection of the work ball's mount.
    mount_um_per_bar
        Deflection of the work ball's mount per unit of pressure [µm/bar]. The pressure is that of
        the regulator that produces the force.
    force_slope, force_offset
        Force per unit of the regulator's pressure [N/bar], and force at zero pressure [N].
    no_drift
        Whether the length of the bar and the centre of the circle did not drift from test to test.
    **options
        Other fields of `Campaign`.

    Returns
    -------
    dict
        Fields of `Campaign` that the options set; the keys are the names of the fields. Other
        fields are left out.
    """
    fields = dict(options)
    if raw or mount_um_per_bar is not None:
        mount = lb.campaign.MountCompensation(compensated=not raw)
        if mount_um_per_bar is not None:
            mount = replace(mount, deflection_um_per_bar=mount_um_per_bar)
        fields["mount"] = mount
    if force_slope is not None or force_offset is not None:
        default = lb.campaign.ForceLaw()
        slope = default.slope_N_per_bar if force_slope is None else force_slope
        offset = default.offset_N if force_offset is None else force_offset
        fields["force_law"] = lb.campaign.ForceLaw(slope, offset)
    if no_drift:
        fields["drift"] = False
    return fields


def _tolerances(tolerances: dict[str, str] | None = None) -> dict[str, str]:
    """Return a dictionary of the tolerances that the user typed; the keys name the quantities."""
    return tolerances or {}


# Options that describe a tidy CSV, which has one reading in each row, and options for labels of the
# measurement, such as its date.
_TABLE_OPTIONS = options_of("table", "labels")
# Command-line options for values that calibration certificates state.
_CERTIFICATE_OPTIONS = options_of("certificates")
# Arguments of `instrument_fields` for values from calibration certificates. The last two arguments
# are names of certificates. There are no command-line options for these names, because they are
# read from the files of the certificates.
_CERTIFICATE_KEYWORDS = [
    *(option.to or name for name, option in _CERTIFICATE_OPTIONS.items()),
    "bar_certificate",
    "force_certificate",
]
# Options that several commands share; the keys are the names of the options. Each constant below is
# one of these options.
_SHARED = options_of("shared")
CI = _SHARED["ci"]
SEED = _SHARED["seed"]
ESS = _SHARED["ess"]
FORCE = _SHARED["force"]
JSON = _SHARED["json"]
QUIET = _SHARED["quiet"]
DETAILS = _SHARED["details"]
PRIOR_FROM = _SHARED["prior_from"]
YES = _SHARED["yes"]

# The types of the arguments of commands are written as strings, such as "lb.Campaign". The classes
# that the strings name are then not imported, and the help of a command appears sooner.
CampaignArgument = Annotated[
    Path,
    typer.Argument(help="A campaign folder, a campaign.toml or a tidy CSV.", metavar="CAMPAIGN"),
]
_CAMPAIGN_PATH = inspect.Parameter(
    "campaign", inspect.Parameter.KEYWORD_ONLY, annotation=CampaignArgument
)
GivenCampaign = Annotated[
    "lb.Campaign", group(campaign_from, _CAMPAIGN_PATH, **_TABLE_OPTIONS, **_CERTIFICATE_OPTIONS)
]
MeasuredCampaign = Annotated[
    "lb.Campaign",
    group(
        partial(campaign_from, needs_readings=True),
        _CAMPAIGN_PATH,
        **_TABLE_OPTIONS,
        **_CERTIFICATE_OPTIONS,
    ),
]
_FILES = inspect.Parameter(
    "files",
    inspect.Parameter.KEYWORD_ONLY,
    annotation=Annotated[
        list[Path],
        typer.Argument(
            help=(
                "A campaign folder, a campaign.toml, a fit, or tables as they are found"
                " (workbook, CSV, text; * and ? are expanded)."
            ),
            metavar="CAMPAIGN|FILE...",
        ),
    ],
)
GivenReadings = Annotated[
    "SourceCampaign",
    group(
        readings_from,
        _FILES,
        yes=YES,
        **_TABLE_OPTIONS,
        **_CERTIFICATE_OPTIONS,
        **LAYOUT_OPTIONS.options,
    ),
]
MeasuredReadings = Annotated[
    "SourceCampaign",
    group(
        partial(readings_from, needs_readings=True),
        _FILES,
        yes=YES,
        **_TABLE_OPTIONS,
        **_CERTIFICATE_OPTIONS,
        **LAYOUT_OPTIONS.options,
    ),
]
Certificates = Annotated[dict[str, Any], group(instrument_fields, **_CERTIFICATE_OPTIONS)]
TableFields = Annotated[dict[str, Any], group(campaign_fields, **_TABLE_OPTIONS)]
# The model may lie beside the campaign, so that it depends on the paths of the campaign as well.
ChosenModel = Annotated[
    "lb.HybridModel",
    Group(
        model_options(),
        model_from,
        None,
        also_takes=("campaign", "files", "source", "campaigns"),
    ),
]
# Path of the model.toml beside the campaign; None if there is none.
ModelBeside = Annotated[
    "Path | None", Group({}, model_file_of_campaign, None, also_takes=("campaign",))
]
Tolerances = Annotated[dict[str, str], group(_tolerances, tolerance=_SHARED["tolerance"])]
# Tolerances of quantities that are followed over time: parameters, and stiffnesses along an axis.
FollowedTolerances = Annotated[dict[str, str], group(_tolerances, **options_of("followed"))]
PoolOptions = Annotated[dict[str, Any], group(**options_of("pool"))]
OutputOptions = Annotated[Output, group(Output, **options_of("output"))]
ReportOutput = Annotated[
    Output, group(Output, **{**options_of("output"), **options_of("report_output")})
]
ChosenLayout = Annotated["lb.reading.Layout", LAYOUT_OPTIONS]
