"""Options shared by the commands, and what they mean."""

from __future__ import annotations

import functools
import inspect
import math
import os
import sys
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from ldbb_bayes.errors import InputError, plain_reason

if TYPE_CHECKING:
    from ldbb_bayes.campaign.campaign import Campaign
    from ldbb_bayes.model.hybrid import HybridModel

__all__ = [
    "EXIT_INTERRUPTED",
    "CampaignArgument",
    "ChosenModel",
    "CiOption",
    "ExecutorOption",
    "ForceOption",
    "GivenCampaign",
    "JsonOption",
    "Output",
    "PriorFromOption",
    "QuietOption",
    "SchedulerOption",
    "SeedOption",
    "TableFields",
    "WorkersOption",
    "campaign_from",
    "command",
    "fail",
    "names_in",
    "pairs_in",
    "three_numbers",
    "with_population",
]

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130

CampaignArgument = Annotated[Path, typer.Argument(help="A campaign folder, a campaign.toml or a tidy CSV.", metavar="CAMPAIGN")]
PriorFromOption = Annotated[
    Path | None,
    typer.Option(
        "--prior-from",
        help="Result of a population of such machines (folder or population.json), the prior of the compliances. This campaign "
        "must not be one of the population's.",
        metavar="POPULATION",
    ),
]
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

_CAMPAIGN: Mapping[str, tuple[Any, Any]] = {"campaign": (CampaignArgument, inspect.Parameter.empty)}
_MODEL: Mapping[str, tuple[Any, Any]] = {
    "degree": (
        Annotated[
            int | None,
            typer.Option(help="Compliance constant (0), linear (1) or quadratic (2) in force. Default 1.", min=0, max=2),
        ],
        None,
    ),
    "preset": (
        Annotated[str | None, typer.Option(help="default: all nuisances and priors. paper: plain least squares (Eq. 31).")],
        None,
    ),
    "without": (
        Annotated[
            str,
            typer.Option(
                help="Comma-separated terms to leave out: ball-form, bar-length, mount, force-error, setup-shift, discrepancy, "
                "hysteresis, drift, truncation."
            ),
        ],
        "",
    ),
    "drift": (
        Annotated[
            str | None,
            typer.Option(
                help="Centre and length drift with time or temperature, as the tests record it.", metavar="time|temperature"
            ),
        ],
        None,
    ),
    "model": (
        Annotated[Path | None, typer.Option(help="Model as TOML (priors, terms, degree).", metavar="FILE.toml")],
        None,
    ),
}


def _of_table(kind: Any, name: str, text: str, default: Any = None) -> tuple[Any, Any]:
    return Annotated[kind, typer.Option(name, help=text, rich_help_panel="For a tidy CSV")], default


_TABLE: Mapping[str, tuple[Any, Any]] = {
    "topology": _of_table(str | None, "--topology", "Joints from workpiece to tool."),
    "plane": _of_table(str | None, "--plane", "XY, YZ or ZX."),
    "radius_mm": _of_table(float | None, "--radius-mm", "Nominal radius (mm). Default 150."),
    "resolution_um": _of_table(float | None, "--resolution-um", "Step of the readout (µm). Default 0.24."),
    "raw": _of_table(bool, "--raw", "The readings are not compensated for the mount.", False),
    "mount_um_per_bar": _of_table(float | None, "--mount-um-per-bar", "Deflection of the mount. Default 2.33."),
    "force_slope": _of_table(float | None, "--force-slope", "Force law, N per bar. Default 126.04."),
    "force_offset": _of_table(float | None, "--force-offset", "Force law, force at zero pressure (N). Default -14.2."),
}
_OUTPUT: Mapping[str, tuple[Any, Any]] = {
    "out": (
        Annotated[Path | None, typer.Option(help="Folder to write results to. Without it nothing is written.", metavar="DIR")],
        None,
    ),
    "force": (ForceOption, False),
    "as_json": (JsonOption, False),
    "quiet": (QuietOption, False),
}


@dataclass(frozen=True)
class Output:
    """Where a result goes: files into a folder, all or none, and stdout, as JSON or for reading."""

    out: Path | None
    force: bool
    as_json: bool
    quiet: bool

    def check(self, files: Collection[str]) -> None:
        """Refuse a folder that must not be replaced, before any work is done; ``files`` may be.

        Raises
        ------
        InputError
        """
        from ldbb_bayes.files import check_target

        if self.out is not None:
            check_target(self.out, force=self.force, ours=files)

    def deliver(
        self,
        record: Mapping[str, Any],
        files: Collection[str],
        write: Callable[[Path], None],
        show: Callable[[], None],
        written: str = "",
    ) -> None:
        """Write a result into the folder, then print its record or show it, and what was written (default: the files).

        Raises
        ------
        InputError
            When it cannot be written.
        """
        from ldbb_bayes.cli.show import print_json
        from ldbb_bayes.files import staged_folder

        if self.out is not None:
            with staged_folder(self.out, force=self.force, ours=files) as staging:
                write(staging)
        if self.as_json:
            print_json(record)
            return
        show()
        if self.out is not None and not self.quiet:
            typer.echo(f"Written: {written or ', '.join(f'{self.out}/{name}' for name in files)}")


def model_from(degree: int | None, preset: str | None, without: str, model: Path | None, drift: str | None = None) -> HybridModel:
    """The model the options describe.

    Raises
    ------
    InputError
        For unknown names, or a preset beside a model file.
    """
    from ldbb_bayes.model.hybrid import HybridModel
    from ldbb_bayes.model.specification import read_model
    from ldbb_bayes.model.terms import Drift

    if model is not None and preset is not None:
        raise InputError("the model must come from --model or --preset, got both. Write preset = … into the file.")
    if model is None:
        chosen = HybridModel.from_preset(preset or "default", 1 if degree is None else degree)
    else:
        chosen = read_model(model, degree=1)
        chosen = chosen if degree is None else chosen.with_degree(degree)
    chosen = chosen.without(*names_in(without))
    return chosen if drift is None else chosen.including(Drift(drift))  # type: ignore[arg-type]


def with_population(model: HybridModel, population: Path | None, campaign: Campaign) -> tuple[HybridModel, dict[str, Any] | None]:
    """The model with the prior that --prior-from names, and what a result says of it; its doubts go to stderr.

    Raises
    ------
    InputError
        Where the population does not go with the model or the campaign.
    """
    if population is None:
        return model, None
    from ldbb_bayes.fleet.population_prior import prior_from

    prior = prior_from(population)
    doubts = prior.doubts(campaign)
    for doubt in doubts:
        typer.echo(f"--prior-from: {doubt}", err=True)
    said = {"path": str(population), "machines": prior.machines, "campaigns": prior.campaigns}
    return prior.model(model), said | {"sha256": prior.sha256, "doubts": list(doubts)}


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
    from ldbb_bayes.campaign.campaign import ForceLaw, MountCompensation

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


@dataclass(frozen=True)
class _Group:
    """Options that together make one argument of a command."""

    options: Mapping[str, tuple[Any, Any]]
    make: Callable[..., Any]


# In a command's signature each of these stands for a group of options; the command gets what they make.
if TYPE_CHECKING:
    GivenCampaign = Campaign
    ChosenModel = HybridModel
    TableFields = dict[str, Any]
else:
    GivenCampaign = _Group({**_CAMPAIGN, **_TABLE}, lambda campaign, **table: campaign_from(campaign, **table))
    ChosenModel = _Group(_MODEL, model_from)
    TableFields = _Group(_TABLE, campaign_fields)


def command(function: Callable[..., None]) -> Callable[..., None]:
    """A function as a command: groups of options spelled out, bad input answered with one message, never a traceback."""
    groups: dict[str, _Group] = {}
    parameters: list[inspect.Parameter] = []
    kinds = inspect.get_annotations(function, eval_str=True)
    for name, own in inspect.signature(function).parameters.items():
        kind = _Group(_OUTPUT, Output) if kinds[name] is Output else kinds[name]
        if isinstance(kind, _Group):
            groups[name] = kind
        options = kind.options if isinstance(kind, _Group) else {name: (kind, own.default)}
        parameters += [
            inspect.Parameter(option, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
            for option, (annotation, default) in options.items()
        ]

    @functools.wraps(function)
    def run(**given: Any) -> None:
        for name, group in groups.items():
            made = group.make(**{option: given.pop(option) for option in group.options})
            given[name] = made
        function(**given)

    guarded = _guarded(run)
    guarded.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    guarded.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return guarded


def names_in(text: str | None) -> tuple[str, ...]:
    """Comma-separated names."""
    return tuple(name.strip() for name in (text or "").split(",") if name.strip())


def pairs_in(entries: list[str] | None, option: str, form: str) -> dict[str, str]:
    """NAME=VALUE of an option that may be repeated, each name once."""
    pairs: dict[str, str] = {}
    for entry in entries or ():
        name, sign, value = entry.partition("=")
        if not (name and sign and value):
            raise InputError(f"{option} must be {form}, got {entry!r}. Put a name, '=' and what belongs to it.")
        if name in pairs:
            raise InputError(f"{option} must give each name once, got {name!r} again. Remove one.")
        pairs[name] = value
    return pairs


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


def _guarded(command: Callable[..., None]) -> Callable[..., None]:
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
