"""Options shared by the commands, and what they mean."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from ldbb_bayes.errors import InputError

if TYPE_CHECKING:
    from ldbb_bayes.campaign.circular_test import Campaign
    from ldbb_bayes.model.hybrid import HybridModel

__all__ = [
    "CampaignArgument",
    "CiOption",
    "DegreeOption",
    "ForceOption",
    "JsonOption",
    "ModelOption",
    "OutOption",
    "PresetOption",
    "QuietOption",
    "RadiusOption",
    "SeedOption",
    "WithoutOption",
    "campaign_from",
    "guarded",
    "model_from",
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
        "truncation."
    ),
]
ModelOption = Annotated[Path | None, typer.Option("--model", help="Model as TOML (priors, terms, degree).", metavar="FILE.toml")]
OutOption = Annotated[Path | None, typer.Option(help="Folder to write results to. Without it nothing is written.", metavar="DIR")]
ForceOption = Annotated[bool, typer.Option("--force", help="Replace existing results.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as JSON on stdout, and nothing else there.")]
SeedOption = Annotated[int, typer.Option(help="Seed of all random numbers.", min=0)]
CiOption = Annotated[float, typer.Option(help="Probability of the credible intervals.")]
QuietOption = Annotated[bool, typer.Option("--quiet", help="No progress.")]
RadiusOption = Annotated[float | None, typer.Option(help="Nominal radius, for a tidy CSV [mm].")]


def model_from(degree: int | None, preset: str | None, without: str, file: Path | None) -> HybridModel:
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
    return model.without(*names)


def campaign_from(path: Path, radius_mm: float | None = None) -> Campaign:
    """The campaign the argument names; ``radius_mm`` belongs to a tidy CSV."""
    from ldbb_bayes.campaign.folder import read_campaign

    return read_campaign(path) if radius_mm is None else read_campaign(path, radius_mm=radius_mm)


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
        except InputError as error:
            fail(str(error), EXIT_BAD_INPUT)
        except OSError as error:
            fail(f"{error.filename or 'a file'} must be usable, got: {error.strerror}. Check it.", EXIT_BAD_INPUT)
        except KeyboardInterrupt:
            fail("interrupted; nothing was written.", EXIT_INTERRUPTED)

    return run
