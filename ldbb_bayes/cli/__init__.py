"""The command line program ``ldbb-bayes COMMAND``."""

from __future__ import annotations

import io
import sys
import warnings
from collections.abc import Sequence
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from ldbb_bayes import __version__
from ldbb_bayes.cli.analyses import compare, design, identify, validate
from ldbb_bayes.cli.atlases import machine
from ldbb_bayes.cli.campaigns import check, import_, simulate
from ldbb_bayes.cli.fits import demo, fit, summarize
from ldbb_bayes.cli.fleets import batch, population, trend
from ldbb_bayes.cli.missing_characters import replace_missing_characters
from ldbb_bayes.cli.next_circles import next_
from ldbb_bayes.cli.options import EXIT_BAD_INPUT, EXIT_INTERRUPTED, command, fail, option
from ldbb_bayes.cli.reporting import report
from ldbb_bayes.errors import InputError

__all__ = ["app", "main"]

# Class of the errors that are raised if a command is used wrongly. Typer, the library that reads
# the command line, takes this class from the library Click or from its own copy of Click.
_UsageError: Any = typer.BadParameter.__base__
# Options that do not exist, but that a user may type because Python functions have arguments of
# these names. The dictionary states, for each of these options, the option to type instead.
_OPTIONS_BY_ARGUMENT = {"--prob": "--ci", "--ci-prob": "--ci"}
# Names of Python functions that users may type instead of a command. The dictionary states, for
# each of these names, the command that does the same.
_COMMANDS_BY_FUNCTION = {
    "calibrate": "validate",
    "preview": "check",
    "sample": "fit",
}


class _Commands(TyperGroup):
    """Group of all commands of ``ldbb-bayes``.

    If a command is used wrongly, one message is printed, and the exit code is 2.
    """

    def main(self, args: Sequence[str] | None = None, *positional: Any, **keywords: Any) -> Any:
        """Run the command of ``ldbb-bayes`` that the arguments name, or show the help.

        ``args`` are the arguments typed after ``ldbb-bayes``; if they are None, the arguments of
        this process are used. ``positional`` and ``keywords`` are passed on to Typer, the library
        that reads the command line.
        """
        arguments = list(sys.argv[1:] if args is None else args)
        keywords["standalone_mode"] = False
        try:
            code = super().main(arguments or ["--help"], *positional, **keywords)
        except typer.Abort:
            raise KeyboardInterrupt from None
        except InputError as error:
            fail(str(error), EXIT_BAD_INPUT)
        except _UsageError as error:
            option_name = getattr(error, "option_name", None)
            if option_name in _OPTIONS_BY_ARGUMENT:
                right_option = _OPTIONS_BY_ARGUMENT[option_name]
                fail(f"No such option: {option_name}. Type {right_option}.", EXIT_BAD_INPUT)
            fail(f"{error.format_message().rstrip('.?')}. See --help.", EXIT_BAD_INPUT)
        # Ctrl-C reaches this method in one of two ways: the library Click raises the error Abort,
        # which is caught above, or the library Typer returns the exit code 130.
        if code == EXIT_INTERRUPTED:
            raise KeyboardInterrupt
        sys.exit(code)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the name of the typed command, the command itself, and the remaining arguments.

        If the user types the name of a function of this package, such as preview, raise an
        `InputError` that names the command which does the same. ``args`` are the typed arguments.
        ``ctx`` is the context in which Typer, the library that reads the command line, looks for
        the command.
        """
        if args[0] in _COMMANDS_BY_FUNCTION:
            raise InputError(
                f"No such command '{args[0]}'. Type ldbb-bayes {_COMMANDS_BY_FUNCTION[args[0]]}."
            )
        return super().resolve_command(ctx, args)


# The command line program, as an object of Typer, the library that reads the command line.
app = typer.Typer(
    cls=_Commands,
    name="ldbb-bayes",
    help="Bayesian uncertainty quantification for the loaded double ball bar.",
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.command()(report)
app.command()(demo)
app.command()(machine)
app.command()(check)
app.command()(fit)
app.command()(batch)
app.command()(trend)
app.command()(population)
app.command()(identify)
app.command()(compare)
app.command()(design)
app.command("next")(next_)
app.command()(simulate)
app.command()(summarize)
app.command()(validate)
app.command("import")(import_)


@app.command("app")
@command
def app_(
    port: Annotated[
        int,
        option(int, "Port of this machine. Default: any that is free.", 0, min=0, max=65535),
    ],
    no_browser: Annotated[bool, option(bool, "Print the address, and open no browser.", False)],
) -> None:
    """Serve a browser page on which to add files, read the report and plan the next tests.

    The page can be opened on this computer only. The command prints the address of the page and
    runs until Ctrl-C. It needs libraries that the extra "app" of this package installs.
    """
    try:
        # The import is here and not at the top of the file, because the libraries that the browser
        # page needs are optional.
        from ldbb_bayes.app.server import serve
    except ModuleNotFoundError as error:
        raise InputError(
            f"app must find the library {error.name}, got none. Install it with pip install"
            " 'ldbb-bayes[app]'."
        ) from None
    serve(port, show=not no_browser, say=typer.echo)


def _print_version(wanted: bool) -> None:
    """If the option ``--version`` was typed, print the program's version and end the program."""
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


def _warning_line(message: Warning | str, *_: Any, **__: Any) -> str:
    """Return a warning as one line of text, without the place in the code."""
    return f"ldbb-bayes: {message}\n"


def main() -> None:
    """Run the command of ``ldbb-bayes`` that the user typed.

    Characters that the terminal cannot show are replaced by similar ones. A warning is printed as
    one line.
    """
    warnings.formatwarning = _warning_line
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            replace_missing_characters(stream)
    app()
