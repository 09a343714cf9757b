"""Options of the commands: declaration, conversion of values, and grouping into arguments.

A command is a function whose annotations contain an `Option`, or a `Group` of options that together
make one argument. `command` passes these options to Typer, the library that reads the command line.
The file ``options.toml`` holds the names, help texts and defaults of the options.
"""

from __future__ import annotations

import inspect
import math
import os
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial, wraps
from pathlib import Path
from typing import Annotated, Any, NamedTuple, NoReturn

import typer

from ldbb_bayes.cli.values import ball_in, names_in, numbers_in, pairs_in, points_in
from ldbb_bayes.errors import check_probability, plain_reason, require

__all__ = [
    "CATALOGUE",
    "EXIT_BAD_INPUT",
    "EXIT_INTERRUPTED",
    "EXIT_MISSED",
    "FORCES",
    "PRESSURES",
    "REQUIRED",
    "Group",
    "Kind",
    "Option",
    "command",
    "fail",
    "group",
    "option",
    "options_of",
]

# exit code if a target was not reached, such as the required number of draws, the required accuracy
# of an evidence, or the proof that a design is the best
EXIT_MISSED = 1
EXIT_BAD_INPUT = 2  # exit code of the program if options or files cannot be used
# exit code if the user types Ctrl-C: 128 plus the number of the signal, as in shells
EXIT_INTERRUPTED = 130
# If this value is the default of a command-line option, the user must type the option.
REQUIRED = inspect.Parameter.empty
# Placeholders that stand for an option's value in the help; the keys are the types of the value.
# The placeholders are short, so that the names of options fit on narrow terminals.
_METAVARS: Mapping[Any, str] = {float: "X", int: "N", str: "TEXT", bool: " "}
# Content of the file options.toml, which states the options of all commands.
CATALOGUE: Mapping[str, Any] = tomllib.loads(
    (Path(__file__).parent / "options.toml").read_text(encoding="utf-8")
)


class Kind(NamedTuple):
    """Kind of value that a command-line option can have, and how the typed value is converted."""

    #: Python type of the value that Typer, the library that reads the command line, returns for an
    #: option.
    typed: Any
    #: Function that converts the value that Typer returns for an option; its arguments are this
    #: value and the option's flag, which is used in error messages.
    read: Callable[[Any, str], Any]
    #: Placeholder that stands for the option's value in the help, such as X,Y,Z; None for the usual
    #: placeholder of the type.
    metavar: str | None = None


@dataclass(frozen=True)
class Option:
    """One option of a command, such as ``--radius-mm``.

    An option may have no default. Its value is then passed to the function that the command calls
    only if the user types the option. Otherwise, the function uses its own default.
    """

    #: Python type to which Typer, the library that reads the command line, converts the typed
    #: value; or a `Kind`, which has its own function for the conversion
    kind: Any
    help: str  #: text that describes the option in the help of the command
    #: value that is used if the user does not type the option; if None, no value is passed to the
    #: command's function
    default: Any
    #: name of the command's keyword argument to which the option's value is passed; if empty, the
    #: argument has the same name as the option
    to: str
    #: further arguments of `typer.Option`. The key ``name`` holds the flag that the user types,
    #: such as ``--goal`` for the option ``goals``. It is not needed if the option has the usual
    #: flag, such as ``--radius-mm`` for the option ``radius_mm``.
    settings: Mapping[str, Any]

    def flag(self, name: str) -> str:
        """Return the flag that a user types for the command-line option named ``name``.

        For ``radius_mm`` it is ``--radius-mm``, unless the declaration of the option states
        another flag.
        """
        return str(self.settings.get("name", "--" + name.replace("_", "-")))

    def parameter(self, name: str) -> inspect.Parameter:
        """Return the function parameter from which Typer makes the option named ``name``.

        Typer, the library that reads the command line, makes options from the parameters of
        functions.
        """
        settings = {key: value for key, value in self.settings.items() if key != "name"}
        typed = self.kind
        if isinstance(typed, Kind):
            settings.setdefault("metavar", typed.metavar)
            typed = typed.typed
        settings.setdefault("metavar", _METAVARS.get(typed))
        if self.default is None:
            typed = typed | None
        declared = typer.Option(self.flag(name), help=self.help, **settings)
        return inspect.Parameter(
            name,
            inspect.Parameter.KEYWORD_ONLY,
            default=self.default,
            annotation=Annotated[typed, declared],
        )

    def read(self, typed: Any, name: str) -> Any:
        """Return the converted value of a command-line option; None if the user did not type it.

        ``typed`` is the value as Typer (the library that reads the command line) returns it, and
        ``name`` the name of the option.
        """
        if typed is None:
            return None
        if isinstance(self.kind, Kind):
            return self.kind.read(typed, self.flag(name))
        finite = not isinstance(typed, float) or math.isfinite(typed)
        require(finite, f"{self.flag(name)} must be a finite number, got {typed}. Correct it.")
        return typed


@dataclass(frozen=True)
class Group:
    """Options whose values together make one argument of a command, such as the model."""

    #: command-line options whose values together make one argument of a command; the keys are the
    #: names of the options
    options: Mapping[str, Option]
    #: function that makes one argument of a command, such as the model, from the values of several
    #: command-line options
    make: Callable[..., Any]
    #: parameter of the command that is not an option, such as a file; None if there is no such
    #: parameter. Its value is passed to the function ``make`` as the first argument.
    positional: inspect.Parameter | None
    #: names of parameters of other groups whose typed values are passed to the function ``make``
    #: too, as keyword arguments, if the command has such parameters
    also_takes: tuple[str, ...] = ()

    def parameters(self) -> list[inspect.Parameter]:
        """Return the function parameters from which Typer makes the options of the group.

        Typer is the library that reads the command line.
        """
        parameters = [option.parameter(name) for name, option in self.options.items()]
        if self.positional is None:
            return parameters
        return [self.positional, *parameters]

    def take_from(self, typed: dict[str, Any], all_typed: Mapping[str, Any] | None = None) -> Any:
        """Return the argument of a command that is made from the values of this group of options.

        ``typed`` holds the values of the options of the command from which no argument has been
        made yet; the keys are the names of the options. The values of the options of this group are
        removed from ``typed``. ``all_typed`` holds the values of all options of the command; None
        if no group of the command needs those of another group.
        """
        positional = []
        if self.positional is not None:
            positional.append(typed.pop(self.positional.name))
        keywords = {}
        for name, option in self.options.items():
            value = option.read(typed.pop(name), name)
            if value is not None:
                keywords[option.to or name] = value
        if all_typed is not None:
            for name in self.also_takes:
                if name in all_typed:
                    keywords[name] = all_typed[name]
        return self.make(*positional, **keywords)


def option(kind: Any, help: str, default: Any = None, to: str = "", **settings: Any) -> Option:
    """Return the declaration of a command-line option, for a command or for a `group` of options.

    Parameters
    ----------
    kind
        Type of the value that Typer (the library that reads the command line) reads, or a `Kind`.
    help
        Help text of the option.
    default
        Value that is used if the user does not type the option. If it is None, no value is passed
        on.
    to
        Name of the keyword argument to which the value is passed. Default: the name of the option.
    **settings
        Further arguments of `typer.Option`. The argument ``name`` is the flag that the user types,
        such as ``--goal`` for the option ``goals``. It is not needed if the option has the usual
        flag, such as ``--radius-mm`` for the option ``radius_mm``.

    Returns
    -------
    Option
    """
    return Option(kind, help, default, to, settings)


def group(
    make: Callable[..., Any] = dict,
    positional: inspect.Parameter | None = None,
    /,
    **options: Option,
) -> Group:
    """Return a group of options that together make one argument of a command.

    Parameters
    ----------
    make
        Function that makes the argument of the command; its keyword arguments are the values of the
        options. Default: dict.
    positional
        Parameter of the command that is not an option; its value is the first argument of
        ``make``.
    **options
        Options of the group.

    Returns
    -------
    Group
    """
    return Group(options, make, positional)


def options_of(*groups: str, **kinds: Any) -> dict[str, Option]:
    """Return a dictionary of the options that the file ``options.toml`` declares.

    Parameters
    ----------
    *groups
        Names of groups of options. Each group is a table of the file. If this table contains an
        inner table, the help shows the options of the inner table together, under the name of the
        inner table.
    **kinds
        Kinds of option values, in addition to the kinds that exist for all commands. The keys are
        the names of the kinds in the file.

    Returns
    -------
    dict
        Declarations of the options; the keys are the names of the options.
    """
    known_kinds = {**_KINDS, **kinds}
    options: dict[str, Option] = {}
    for name in groups:
        for entry in _catalogue_entries(CATALOGUE[name]):
            settings = dict(entry.settings)
            kind = known_kinds[settings.pop("kind", "text")]
            options[entry.name] = option(kind, settings.pop("help"), **settings)
    return options


class _CatalogueEntry(NamedTuple):
    """Name of a command-line option, and its settings in the file ``options.toml``."""

    name: str
    settings: Mapping[str, Any]


def _catalogue_entries(entries: Mapping[str, Any]) -> Iterator[_CatalogueEntry]:
    """Yield the name and the declaration of each option in a group of the file ``options.toml``.

    ``entries`` is the content of the group. The help shows some options in a panel, which is a box
    with a heading. The heading is added to the declarations of these options.
    """
    for name, entry in entries.items():
        if isinstance(entry, str):
            yield _CatalogueEntry(name, CATALOGUE["shared"][entry])
        elif "help" in entry:
            yield _CatalogueEntry(name, entry)
        else:
            for option_in_panel in _catalogue_entries(entry):
                settings = {**option_in_panel.settings, "rich_help_panel": name}
                yield _CatalogueEntry(option_in_panel.name, settings)


def command(function: Callable[..., None]) -> Callable[..., None]:
    """Turn a function into a command for Typer, the library that reads the command line.

    Parameters
    ----------
    function
        Function whose annotations contain the options, as an `Option` or a `Group`.

    Returns
    -------
    callable
        Function that Typer calls. For bad input, this function prints one message without traceback
        and exits with code 2.
    """
    groups: dict[str, Group] = {}
    parameters: list[inspect.Parameter] = []
    annotations = inspect.get_annotations(function, eval_str=True)
    for name, parameter in inspect.signature(function).parameters.items():
        annotation = annotations[name]
        declared = getattr(annotation, "__metadata__", (None,))[0]
        if isinstance(declared, Option):
            declared = Group({name: declared}, _only_value, None)
        if isinstance(declared, Group):
            groups[name] = declared
            parameters += declared.parameters()
        else:
            keyword = inspect.Parameter.KEYWORD_ONLY
            parameters.append(parameter.replace(kind=keyword, annotation=annotation))

    @wraps(function)
    def run(**typed: Any) -> None:
        """Run the command with the typed values of its options.

        An error that the user's input caused is printed as one message, and ends the program with
        exit code 2.
        """
        try:
            all_typed = dict(typed)
            arguments = {}
            for name, group in groups.items():
                arguments[name] = group.take_from(typed, all_typed)
            function(**arguments, **typed)
            sys.stdout.flush()
        except BrokenPipeError:
            # Another program that reads the output of this command has closed the pipe. Output that
            # is flushed at exit is therefore discarded.
            sys.stdout = open(os.devnull, "w")  # noqa: SIM115, it stays open until the program ends
        except (OSError, ArithmeticError, ValueError) as error:
            reason = plain_reason(error)
            if reason is None:
                raise
            fail(reason, EXIT_BAD_INPUT)

    run.__doc__ = _with_paragraphs_joined(function.__doc__ or "")
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


def _with_paragraphs_joined(text: str) -> str:
    """Return a docstring with each paragraph on one line, for the help of a command.

    Typer keeps the line ends within paragraphs, which would not be those of the terminal.
    """
    paragraphs = inspect.cleandoc(text).split("\n\n")
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs)


def _only_value(**values: Any) -> Any:
    """Return the value of the only command-line option in a group; None if it was not typed."""
    for value in values.values():
        return value
    return None


def fail(message: str, code: int) -> NoReturn:
    """Print a message on stderr and end the program.

    Parameters
    ----------
    message
        One or two sentences, without the name of the program.
    code
        Exit code.

    Raises
    ------
    SystemExit
        Always.
    """
    print(f"ldbb-bayes: {message}", file=sys.stderr)  # noqa: T201, the message for the user
    sys.exit(code)


def _read_names(text: str, flag: str) -> tuple[str, ...]:
    """Return the names that the user typed as an option's value, separated by commas."""
    return names_in(text)


def _read_negated(flag_is_set: bool, flag: str) -> bool:
    """Return false if the user typed an option such as ``--no-compare``, and true if not."""
    return not flag_is_set


def _read_probability(probability: float, flag: str) -> float:
    """Return a probability that the user typed; raise an `InputError` unless it is in (0, 1)."""
    check_probability(probability, flag)
    return probability


# Kinds of command-line options whose value is a comma-separated list of forces [N] or of pressures
# [bar].
FORCES = Kind(str, partial(numbers_in, example="36,389,742"))
PRESSURES = Kind(str, partial(numbers_in, example="0.4,3.2,6"))
# Types of the values of command-line options: Python types, or objects of the class `Kind`. The
# keys are the names of these types in the file options.toml.
_KINDS: Mapping[str, Any] = {
    "text": str,
    "integer": int,
    "number": float,
    "flag": bool,
    "path": Path,
    "texts": list[str],
    "list": Kind(str, _read_names, "LIST"),
    "names": Kind(str, _read_names),
    "forces": FORCES,
    "pressures": PRESSURES,
    "ball": Kind(str, ball_in, "G20|0.5um"),
    "negated": Kind(bool, _read_negated),
    "probability": Kind(float, _read_probability, "X"),
    "points": Kind(list[str], points_in, "X,Y,Z"),
    "goals": Kind(list[str], partial(pairs_in, form="NAME=U")),
    "tolerances": Kind(list[str], partial(pairs_in, form='NAME="VALUE UNIT"')),
}
