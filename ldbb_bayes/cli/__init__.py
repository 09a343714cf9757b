"""The command line: ``ldbb-bayes COMMAND``. Its matrices are small: one BLAS thread is faster than several."""

from __future__ import annotations

import io
import os
import sys
from typing import Annotated

import typer

from ldbb_bayes import __version__
from ldbb_bayes.cli.analyses import compare, demo, design, fit, identify, report, summarize, validate
from ldbb_bayes.cli.campaigns import batch, check, import_, machine, population, simulate, trend

__all__ = ["app", "main"]

for _threads in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")

app = typer.Typer(
    name="ldbb-bayes",
    help="Bayesian uncertainty quantification for the loaded double ball bar.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
_COMMANDS = (
    *(demo, machine, check, fit, batch, trend, population),
    *(identify, compare, design, report, simulate, summarize, validate),
)
for command in _COMMANDS:
    app.command()(command)
app.command("import")(import_)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"ldbb-bayes {__version__}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Bayesian uncertainty quantification for the loaded double ball bar."""


def main() -> None:
    """Entry point. Signs that the terminal's encoding lacks are replaced, not fatal."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    app()
