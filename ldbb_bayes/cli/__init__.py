"""The command line: ``ldbb-bayes COMMAND``. Its matrices are small: one BLAS thread is faster than
several."""

from __future__ import annotations

import gc
import io
import os
import sys
import warnings
from collections.abc import Sequence
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from ldbb_bayes import __version__
from ldbb_bayes.cli import options
from ldbb_bayes.cli.analyses import compare, demo, design, fit, identify, summarize, validate
from ldbb_bayes.cli.campaigns import batch, check, import_, machine, population, simulate, trend
from ldbb_bayes.cli.options import EXIT_BAD_INPUT, EXIT_INTERRUPTED
from ldbb_bayes.cli.reporting import report
from ldbb_bayes.errors import InputError

__all__ = ["app", "main"]

for _threads in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")
# Looking for garbage took a twentieth of a command's time.
gc.set_threshold(50_000, 20, 20)

# Click's, or Typer's own copy of it.
_UsageError: Any = typer.BadParameter.__base__


class _Commands(TyperGroup):
    """Commands whose wrong use is answered like any other bad input: one message that names what
    was typed, exit code 2."""

    def main(self, args: Sequence[str] | None = None, *rest: Any, **more: Any) -> Any:
        given = list(sys.argv[1:] if args is None else args) or ["--help"]
        try:
            code = super().main(given, *rest, **{**more, "standalone_mode": False})
            # What Typer makes of Ctrl-C; Click makes it Abort.
            if code == EXIT_INTERRUPTED:
                raise typer.Abort
        except typer.Abort:
            raise KeyboardInterrupt from None
        except (_UsageError, InputError) as error:
            code = EXIT_BAD_INPUT
            said = (
                str(error)
                if isinstance(error, InputError)
                else f"{error.format_message().rstrip('.?')}. See --help."
            )
            print(f"ldbb-bayes: {said}", file=sys.stderr)
        sys.exit(code)


app = typer.Typer(
    cls=_Commands,
    name="ldbb-bayes",
    help="Bayesian uncertainty quantification for the loaded double ball bar.",
    add_completion=False,
    pretty_exceptions_enable=False,
)
_COMMANDS = (
    *(report, demo, machine, check, fit, batch, trend, population),
    *(identify, compare, design, simulate, summarize, validate),
)
for command in _COMMANDS:
    app.command()(command)
app.command("import")(import_)


@app.command("app")
@options.command
def app_(
    port: Annotated[
        int,
        options.option(
            int, "Port of this machine. Default: any that is free.", 0, min=0, max=65535
        ),
    ],
    no_browser: Annotated[
        bool, options.option(bool, "Print the address, and open no browser.", False)
    ],
) -> None:
    """A page in the browser: drop files, read the sheets, plan the next circles. It is served to
    this machine alone.

    Prints its address, and answers until it is interrupted (Ctrl-C). Needs the extra app.
    """
    try:
        from ldbb_bayes.app.server import serve
    except ModuleNotFoundError as error:
        got = "got none. Install it with pip install 'ldbb-bayes[app]'"
        raise InputError(f"app must find the library {error.name}, {got}.") from None
    serve(port, show=not no_browser, say=typer.echo)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"ldbb-bayes {__version__}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version.", callback=_print_version, is_eager=True
        ),
    ] = False,
) -> None:
    """Bayesian uncertainty quantification for the loaded double ball bar."""


def main() -> None:
    """Entry point. Signs that the terminal's encoding lacks are replaced, not fatal; a warning is a
    line."""
    warnings.formatwarning = lambda message, *_: f"ldbb-bayes: {message}\n"
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    app()
