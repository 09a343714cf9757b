"""Options shared by the commands, and what they mean."""

from __future__ import annotations

import functools
import inspect
import math
import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from ldbb_bayes.errors import InputError, plain_reason

if TYPE_CHECKING:
    from ldbb_bayes.campaign.campaign import Campaign
    from ldbb_bayes.model.hybrid import HybridModel

__all__ = [
    "EXIT_INTERRUPTED",
    "CampaignArgument",
    "CiOption",
    "DegreeOption",
    "DriftOption",
    "ExecutorOption",
    "ForceOffsetOption",
    "ForceOption",
    "ForceSlopeOption",
    "JsonOption",
    "ModelOption",
    "MountOption",
    "OutOption",
    "PlaneOption",
    "PresetOption",
    "PriorFromOption",
    "QuietOption",
    "RadiusOption",
    "RawOption",
    "ResolutionOption",
    "SchedulerOption",
    "SeedOption",
    "TopologyOption",
    "WithoutOption",
    "WorkersOption",
    "campaign_fields",
    "campaign_from",
    "fail",
    "guarded",
    "model_from",
    "of_campaign",
    "three_numbers",
    "with_population",
]

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130

CampaignArgument = Annotated[Path, typer.Argument(help="A campaign folder, a campaign.toml or a tidy CSV.", metavar="CAMPAIGN")]
DegreeOption = Annotated[
    int | None, typer.Option(help="Compliance constant (0), linear (1) or quadratic (2) in force. Default 1.", min=0, max=2)
]
PresetOption = Annotated[str | None, typer.Option(help="default: all nuisances and priors. paper: plain least squares (Eq. 31).")]
WithoutOption = Annotated[
    str,
    typer.Option(
        help="Comma-separated terms to leave out: ball-form, bar-length, mount, force-error, setup-shift, discrepancy, "
        "hysteresis, drift, truncation."
    ),
]
DriftOption = Annotated[
    str | None,
    typer.Option(
        "--drift", help="Centre and length drift with time or temperature, as the tests record it.", metavar="time|temperature"
    ),
]
ModelOption = Annotated[Path | None, typer.Option("--model", help="Model as TOML (priors, terms, degree).", metavar="FILE.toml")]
PriorFromOption = Annotated[
    Path | None,
    typer.Option(
        "--prior-from",
        help="Result of a population of such machines (folder or population.json), the prior of the compliances. This campaign "
        "must not be one of the population's.",
        metavar="POPULATION",
    ),
]
OutOption = Annotated[Path | None, typer.Option(help="Folder to write results to. Without it nothing is written.", metavar="DIR")]
ForceOption = Annotated[bool, typer.Option("--force", help="Replace existing results.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as JSON on stdout, and nothing else there.")]
SeedOption = Annotated[int, typer.Option(help="Seed of all random numbers.", min=0, max=2**63 - 1)]
CiOption = Annotated[float, typer.Option(help="Probability of the credible intervals.")]
QuietOption = Annotated[bool, typer.Option("--quiet", help="No progress.")]
ExecutorOption = Annotated[
    str,
    typer.Option("--executor", help="What the jobs run on: process (the cores here) or dask.", metavar="process|dask"),
]
SchedulerOption = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        help="Dask scheduler to use, for example tcp://10.0.0.1:8786. Default: workers on this machine.",
        metavar="ADDRESS",
    ),
]
WorkersOption = Annotated[
    int, typer.Option("--workers", help="Processes, one BLAS thread each; 0: one per core. None is started for 1.", min=0)
]
_TABLE = "For a tidy CSV"
RadiusOption = Annotated[float | None, typer.Option(help="Nominal radius (mm). Default 150.", rich_help_panel=_TABLE)]
TopologyOption = Annotated[str | None, typer.Option(help="Joints from workpiece to tool.", rich_help_panel=_TABLE)]
PlaneOption = Annotated[str | None, typer.Option(help="XY, YZ or ZX.", rich_help_panel=_TABLE)]
ResolutionOption = Annotated[float | None, typer.Option(help="Step of the readout (µm). Default 0.24.", rich_help_panel=_TABLE)]
RawOption = Annotated[bool, typer.Option("--raw", help="The readings are not compensated for the mount.", rich_help_panel=_TABLE)]
MountOption = Annotated[
    float | None, typer.Option("--mount-um-per-bar", help="Deflection of the mount. Default 2.33.", rich_help_panel=_TABLE)
]
ForceSlopeOption = Annotated[
    float | None, typer.Option("--force-slope", help="Force law, N per bar. Default 126.04.", rich_help_panel=_TABLE)
]
ForceOffsetOption = Annotated[
    float | None,
    typer.Option("--force-offset", help="Force law, force at zero pressure (N). Default -14.2.", rich_help_panel=_TABLE),
]

_TABLE_OPTIONS: Mapping[str, tuple[Any, Any]] = MappingProxyType(
    {
        "topology": (TopologyOption, None),
        "plane": (PlaneOption, None),
        "radius_mm": (RadiusOption, None),
        "resolution_um": (ResolutionOption, None),
        "raw": (RawOption, False),
        "mount_um_per_bar": (MountOption, None),
        "force_slope": (ForceSlopeOption, None),
        "force_offset": (ForceOffsetOption, None),
    }
)


def model_from(degree: int | None, preset: str | None, without: str, file: Path | None, drift: str | None = None) -> HybridModel:
    """The model the options describe.

    Raises
    ------
    InputError
        For unknown names, or a preset beside a model file.
    """
    from ldbb_bayes.model.hybrid import HybridModel
    from ldbb_bayes.model.spec import read_model

    if file is not None and preset is not None:
        raise InputError("the model must come from --model or --preset, got both. Write preset = … into the file.")
    if file is None:
        model = HybridModel.from_preset(preset or "default", 1 if degree is None else degree)
    else:
        model = read_model(file, degree=1)
        model = model if degree is None else model.with_degree(degree)
    names = [name.strip() for name in without.split(",") if name.strip()]
    return _drifting(model.without(*names), drift)


def with_population(model: HybridModel, population: Path | None, campaign: Campaign) -> tuple[HybridModel, dict[str, Any] | None]:
    """The model with the prior that --prior-from names, and what a result says of it; its doubts go to stderr.

    Raises
    ------
    InputError
        Where the population does not go with the model or the campaign.
    """
    if population is None:
        return model, None
    from ldbb_bayes.model.population_prior import prior_from

    prior = prior_from(population)
    doubts = prior.doubts(campaign)
    for doubt in doubts:
        typer.echo(f"--prior-from: {doubt}", err=True)
    said = {"path": str(population), "machines": prior.machines, "campaigns": prior.campaigns}
    return prior.model(model), said | {"sha256": prior.sha256, "doubts": list(doubts)}


def _drifting(model: HybridModel, drift: str | None) -> HybridModel:
    from ldbb_bayes.model.terms import Drift

    return model if drift is None else model.including(Drift(drift))  # type: ignore[arg-type]


def campaign_from(
    path: Path,
    *,
    raw: bool = False,
    mount_um_per_bar: float | None = None,
    force_slope: float | None = None,
    force_offset: float | None = None,
    **fields: Any,
) -> Campaign:
    """The campaign the argument names; the options say of a tidy CSV what campaign.toml would say."""
    from ldbb_bayes.campaign.folder import read_campaign

    given = campaign_fields(
        raw=raw, mount_um_per_bar=mount_um_per_bar, force_slope=force_slope, force_offset=force_offset, **fields
    )
    if given and (path.is_dir() or path.suffix.lower() == ".toml"):
        options = ", ".join(_OF_FIELDS.get(name, "--" + name.replace("_", "-")) for name in given)
        raise InputError(f"{options} must come with a tidy CSV, got {path}. Write what it says into its campaign.toml.")
    return read_campaign(path, **given)


# Options of fields that bear another name.
_OF_FIELDS = {"mount": "--raw or --mount-um-per-bar", "force_law": "--force-slope or --force-offset"}


def campaign_fields(
    *,
    raw: bool = False,
    mount_um_per_bar: float | None = None,
    force_slope: float | None = None,
    force_offset: float | None = None,
    **fields: Any,
) -> dict[str, Any]:
    """What the options say of a campaign that no table says: those given, as fields of `Campaign`."""
    from ldbb_bayes.campaign.loading import ForceLaw, MountCompensation

    given = {name: value for name, value in fields.items() if value is not None}
    if given.get("name") == "":
        raise InputError("--name must not be empty. Leave it out, or give one.")
    for name in ("radius_mm", "resolution_um"):
        if name in given and not (math.isfinite(given[name]) and given[name] > 0.0):
            raise InputError(f"--{name.replace('_', '-')} must be above zero, got {given[name]:g}. Correct it.")
    for option, number in (
        ("--mount-um-per-bar", mount_um_per_bar),
        ("--force-slope", force_slope),
        ("--force-offset", force_offset),
    ):
        if number is not None and (not math.isfinite(number) or (option == "--force-slope" and not number > 0.0)):
            kind = "above zero" if option == "--force-slope" else "a finite number"
            raise InputError(f"{option} must be {kind}, got {number:g}. Correct it.")
    if raw or mount_um_per_bar is not None:
        given["mount"] = MountCompensation(2.33 if mount_um_per_bar is None else mount_um_per_bar, compensated=not raw)
    if force_slope is not None or force_offset is not None:
        default = ForceLaw()
        slope = default.slope_N_per_bar if force_slope is None else force_slope
        given["force_law"] = ForceLaw(slope, default.offset_N if force_offset is None else force_offset)
    return given


def of_campaign(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command CAMPAIGN as its first argument, and the options that say of a tidy CSV what campaign.toml would say.

    The command itself gets the campaign read. Wrapped in `guarded`.
    """
    first, *others = inspect.signature(command).parameters
    known = inspect.get_annotations(command, eval_str=True, globals={**command.__globals__, "Campaign": object})
    own = inspect.signature(command).parameters
    keyword = inspect.Parameter.KEYWORD_ONLY
    parameters = [
        inspect.Parameter("campaign", inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=CampaignArgument),
        *(inspect.Parameter(name, keyword, default=own[name].default, annotation=known[name]) for name in others),
        *(inspect.Parameter(name, keyword, default=default, annotation=kind) for name, (kind, default) in _TABLE_OPTIONS.items()),
    ]

    @functools.wraps(command)
    def run(campaign: Path, **given: Any) -> None:
        table = {name: given.pop(name) for name in _TABLE_OPTIONS}
        command(**{first: campaign_from(campaign, **table)}, **given)

    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return guarded(run)


def three_numbers(text: str, option: str) -> tuple[float, float, float]:
    """X,Y,Z of an option [mm]."""
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        x = y = z = math.nan
    if not all(math.isfinite(value) for value in (x, y, z)):
        raise InputError(f"{option} must hold three finite numbers X,Y,Z in mm, got {text!r}. For example 0,-200,350.")
    return x, y, z


def fail(message: str, code: int) -> NoReturn:
    """Say one thing on stderr and leave."""
    print(f"ldbb-bayes: {message}", file=sys.stderr)  # noqa: T201
    raise typer.Exit(code)


def guarded(command: Callable[..., None]) -> Callable[..., None]:
    """Answer bad input with one message and exit code 2, an interruption with 130; never a traceback for either."""

    @functools.wraps(command)
    def run(*args: Any, **kwargs: Any) -> None:
        try:
            command(*args, **kwargs)
            sys.stdout.flush()
        except BrokenPipeError:
            sys.stdout = open(os.devnull, "w")  # noqa: SIM115
        except (OSError, ArithmeticError, ValueError) as error:
            said = plain_reason(error)
            if said is None:
                raise
            fail(said, EXIT_BAD_INPUT)
        except KeyboardInterrupt:
            fail("interrupted; nothing was written.", EXIT_INTERRUPTED)

    return run
