"""What ``trend`` and ``population`` share: which campaigns and parameters they take, and how they end."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

__all__ = [
    "BatchesArgument",
    "ExcludeOption",
    "MisfitsOption",
    "OwnInstrumentsOption",
    "ParametersOption",
    "ReferenceForceOption",
    "SinceOption",
    "deliver",
    "names_in",
]

BatchesArgument = Annotated[list[Path], typer.Argument(help="Folders that ldbb-bayes batch wrote.", metavar="BATCH...")]
ParametersOption = Annotated[
    str | None,
    typer.Option(
        help="Comma-separated compliances and geometric errors. Default: all constant compliances. Ball form and bar length are "
        "taken anew in each campaign: what is said of differences of geometric errors is conservative, of their levels not.",
        metavar="LIST",
    ),
]
ExcludeOption = Annotated[
    list[str] | None,
    typer.Option(
        "--exclude", help="Campaign (path, last part of it, or name) or machine to leave out; may be repeated.", metavar="NAME"
    ),
]
SinceOption = Annotated[
    str | None, typer.Option("--since", help="Leave out campaigns before this date (ISO 8601).", metavar="DATE")
]
MisfitsOption = Annotated[
    bool,
    typer.Option("--include-misfits", help="Keep campaigns whose readings the model does not expect; else they are left out."),
]
ReferenceForceOption = Annotated[
    float | None, typer.Option(help="Force at which compliances are meant (N). Default: the campaigns' median.", metavar="F")
]
OwnInstrumentsOption = Annotated[
    bool, typer.Option("--own-instruments", help="Every campaign had a bar, a mount and a regulator of its own.")
]


def names_in(text: str | None) -> list[str] | None:
    """Comma-separated names."""
    return None if text is None else [name.strip() for name in text.split(",") if name.strip()]


def deliver(
    record: Mapping[str, Any],
    out: Path | None,
    *,
    force: bool,
    files: Collection[str],
    write: Callable[[Path], None],
    show: Callable[[], None],
    as_json: bool,
    quiet: bool,
) -> None:
    """Write a result's files, all or none, and print it: as JSON or for reading.

    Raises
    ------
    InputError
        When they cannot be written.
    """
    from ldbb_bayes.cli.show import print_json
    from ldbb_bayes.files import staged_folder

    if out is not None:
        with staged_folder(out, force=force, ours=files) as staging:
            write(staging)
    if as_json:
        print_json(record)
        return
    show()
    if out is not None and not quiet:
        typer.echo(f"Written: {', '.join(f'{out}/{name}' for name in files)}")
