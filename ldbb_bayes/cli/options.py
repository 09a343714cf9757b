"""Options of the commands, what they mean, and where a result goes: a folder, JSON on stdout,
tables; progress on stderr."""

from __future__ import annotations

import functools
import inspect
import math
import os
import re
import shutil
import sys
import tomllib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, NoReturn, cast

import typer

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError, placed, plain_reason, require

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ldbb_bayes.campaign.campaign import Ball, Campaign
    from ldbb_bayes.inference.mcmc import Progress
    from ldbb_bayes.model.hybrid import HybridModel

EXIT_MISSED = 1
EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130
REQUIRED = inspect.Parameter.empty
# Short, so that names of options stay whole in the help on narrow terminals.
_METAVARS: Mapping[Any, str] = {float: "X", int: "N", str: "TEXT", bool: " "}
CATALOGUE: Mapping[str, Any] = tomllib.loads(
    (Path(__file__).parent / "options.toml").read_text(encoding="utf-8")
)


# ---- groups of options


class Kind(NamedTuple):
    """What is typed, and what it means: ``read`` gets it and the option's name."""

    typed: Any
    read: Callable[[Any, str], Any]
    metavar: str | None = None


@dataclass(frozen=True)
class Option:
    """One option, handed on as the keyword ``to``; None is not, so that the function's own default
    holds.

    ``more`` is of `typer.Option`, with the option's ``name`` where it is another.
    """

    kind: Any
    help: str
    default: Any
    to: str
    more: Mapping[str, Any]

    def flag(self, name: str) -> str:
        """What one types."""
        return str(self.more.get("name", "--" + name.replace("_", "-")))

    def parameter(self, name: str) -> inspect.Parameter:
        """What typer reads."""
        more = {key: value for key, value in self.more.items() if key != "name"}
        typed = self.kind
        default = self.default
        if isinstance(typed, Kind):
            more.setdefault("metavar", typed.metavar)
            typed = typed.typed
        more.setdefault("metavar", _METAVARS.get(typed))
        typed = typed | None if default is None else typed
        annotation = Annotated[typed, typer.Option(self.flag(name), help=self.help, **more)]  # type: ignore[valid-type]
        return inspect.Parameter(
            name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation
        )

    def read(self, typed: Any, name: str) -> Any:
        """What was typed means."""
        if typed is None:
            return None
        if isinstance(self.kind, Kind):
            return self.kind.read(typed, self.flag(name))
        finite = not isinstance(typed, float) or math.isfinite(typed)
        require(finite, f"{self.flag(name)} must be a finite number, got {typed}. Correct it.")
        return typed


@dataclass(frozen=True)
class Group:
    """Options that together make one argument of a command, after one that is no option where
    ``first`` is given."""

    options: Mapping[str, Option]
    make: Callable[..., Any]
    first: inspect.Parameter | None

    def parameters(self) -> list[inspect.Parameter]:
        """What typer reads."""
        first = [] if self.first is None else [self.first]
        return [*first, *(option.parameter(name) for name, option in self.options.items())]

    def made(self, typed: dict[str, Any]) -> Any:
        """The argument; its options are taken out of what was typed."""
        first = () if self.first is None else (typed.pop(self.first.name),)
        read = {
            option.to or name: option.read(typed.pop(name), name)
            for name, option in self.options.items()
        }
        return self.make(
            *first, **{name: value for name, value in read.items() if value is not None}
        )


def option(kind: Any, help: str, default: Any = None, to: str = "", **more: Any) -> Option:
    """One option of a command or of a `group`."""
    return Option(kind, help, default, to, more)


def group(
    make: Callable[..., Any] = dict, first: inspect.Parameter | None = None, /, **options: Option
) -> Group:
    """Options that make one argument: by default a dictionary of those given."""
    return Group(options, make, first)


def options_of(*groups: str, **kinds: Any) -> dict[str, Option]:
    """The options of groups in options.toml, those of a panel under its heading; ``kinds`` beside
    `KINDS`."""

    def made(own: Mapping[str, Any] | str) -> Option:
        stated = dict(CATALOGUE["shared"][own] if isinstance(own, str) else own)
        return option({**KINDS, **kinds}[stated.pop("kind", "text")], stated.pop("help"), **stated)

    found: dict[str, Option] = {}
    for key, own in [entry for group in groups for entry in CATALOGUE[group].items()]:
        if isinstance(own, str) or "help" in own:
            found[key] = made(own)
        else:
            found |= {name: made({**one, "rich_help_panel": key}) for name, one in own.items()}
    return found


def command(function: Callable[..., None]) -> Callable[..., None]:
    """A function as a command: groups of options spelled out, bad input answered with one message,
    never a traceback."""
    groups: dict[str, Group] = {}
    parameters: list[inspect.Parameter] = []
    kinds = inspect.get_annotations(function, eval_str=True)
    for name, own in inspect.signature(function).parameters.items():
        stated = getattr(kinds[name], "__metadata__", (None,))[0]
        if isinstance(stated, Option):
            stated = group(lambda **own: next(iter(own.values()), None), **{name: stated})
        if isinstance(stated, Group):
            groups[name] = stated
            parameters += stated.parameters()
        else:
            parameters.append(
                own.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=kinds[name])
            )

    @functools.wraps(function)
    def run(**typed: Any) -> None:
        try:
            function(**{name: group.made(typed) for name, group in groups.items()}, **typed)
            sys.stdout.flush()
        except BrokenPipeError:
            sys.stdout = open(os.devnull, "w")
        except (OSError, ArithmeticError, ValueError) as error:
            said = plain_reason(error)
            if said is None:
                raise
            fail(said, EXIT_BAD_INPUT)

    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


def fail(message: str, code: int) -> NoReturn:
    """Say one thing on stderr and leave."""
    print(f"ldbb-bayes: {message}", file=sys.stderr)
    sys.exit(code)


# ---- what is typed


def names_in(text: str, _: str = "") -> tuple[str, ...]:
    """Comma-separated names."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def pairs_in(entries: Iterable[str], option: str, form: str) -> dict[str, str]:
    """NAME=VALUE of an option that may be repeated, each name once."""
    pairs: dict[str, str] = {}
    for entry in entries:
        name, sign, value = entry.partition("=")
        if not (name and sign and value):
            raise InputError(
                f"{option} must be {form}, got {entry!r}. Put a name, '=' and what belongs to it."
            )
        if name in pairs:
            raise InputError(f"{option} must give each name once, got {name!r} again. Remove one.")
        pairs[name] = value
    return pairs


def numbers_in(text: str, option: str, separator: str = ",") -> tuple[float, ...]:
    """Finite numbers."""
    try:
        numbers = tuple(map(float, text.split(separator)))
    except ValueError:
        numbers = (math.nan,)
    require(
        all(map(math.isfinite, numbers)),
        f"{option} must hold numbers, got {text!r}. Write them like 36{separator}2e-6.",
    )
    return numbers


def points_in(entries: Iterable[str], option: str) -> list[tuple[float, ...]]:
    """X,Y,Z of an option that may be repeated [mm]."""
    points = [numbers_in(text, option) for text in entries]
    for point in points:
        require(
            len(point) == 3,
            f"{option} must hold three numbers X,Y,Z in mm, got {len(point)}. For example"
            " 0,-200,350.",
        )
    return points


def ball_in(text: str, option: str) -> Ball:
    """A grade, or a deviation from sphericity with its unit."""
    size = re.fullmatch(r"(\d*\.?\d+) ?[uµμ]m", text.replace(",", "."))
    like = "a grade like G20, or a deviation from sphericity like 0.5um"
    require(
        size or text[:1] not in {*"+-.0123456789"},
        f"{option} must be {like}, got {text!r}. Correct it.",
    )
    with placed(option):
        return lb.Ball(grade=text) if size is None else lb.Ball(sphericity_um=float(size[1]))


KINDS: Mapping[str, Any] = {
    "text": str,
    "integer": int,
    "number": float,
    "flag": bool,
    "path": Path,
    "texts": list[str],
    "list": Kind(str, names_in, "LIST"),
    "names": Kind(str, names_in),
    "numbers": Kind(str, numbers_in),
    "ball": Kind(str, ball_in, "G20|0.5um"),
    "negated": Kind(bool, lambda value, _: not value),
    "points": Kind(list[str], points_in, "X,Y,Z"),
    "tolerances": Kind(list[str], lambda own, flag: pairs_in(own, flag, 'NAME="VALUE UNIT"')),
}


# ---- campaign and model


def campaign_from(path: Path, **options: Any) -> Campaign:
    """The campaign the argument names; the options say of a tidy CSV what campaign.toml would say,
    and what certificates say."""
    certificates = certified(**{name: options.pop(name) for name in _CERTIFIED if name in options})
    return lb.read_campaign(path, certificates=certificates, **campaign_fields(**options))


def certified(*, balls: Ball | None = None, **given: Any) -> dict[str, Any]:
    """What the options say of the instrument: those given, as fields of `Instrument`."""
    from ldbb_bayes.campaign.certificates import read_dcc

    stated: dict[str, Any] = {}
    for kind in ("bar", "force", "work", "tool"):
        if (file := given.pop(f"{kind}_dcc", None)) is not None and kind in ("bar", "force"):
            stated |= {f"{kind}_{key}": own for key, own in read_dcc(file).fields(kind).items()}
        elif file is not None:
            stated[kind] = lb.Ball(**read_dcc(file).fields("ball"))
    for key in stated.keys() & given:
        got = f"got --{key.replace('_', '-')} too" if "_" in key else f"got --{key}-ball too"
        raise InputError(
            f"what a DCC says must not be given by hand as well, {got}. Keep one of them."
        )
    return ({} if balls is None else {"work": balls, "tool": balls}) | stated | given


def campaign_fields(*, raw: bool = False, **given: Any) -> dict[str, Any]:
    """What the options say of a campaign that no table says: those given, as fields of
    `Campaign`."""
    deflection, slope, offset = (
        given.pop(name, None) for name in ("mount_um_per_bar", "force_slope", "force_offset")
    )
    if raw or deflection is not None:
        given["mount"] = lb.MountCompensation(
            2.33 if deflection is None else deflection, compensated=not raw
        )
    if slope is not None or offset is not None:
        usual = lb.ForceLaw()
        slope = usual.slope_N_per_bar if slope is None else slope
        given["force_law"] = lb.ForceLaw(slope, usual.offset_N if offset is None else offset)
    return given


def model_from(
    degree: int | None = None,
    preset: str | None = None,
    without: tuple[str, ...] = (),
    model: Path | None = None,
    drift: str | None = None,
) -> HybridModel:
    """The model the options describe."""
    if model is not None and preset is not None:
        raise InputError(
            "the model must come from --model or --preset, got both. Write preset = … into the"
            " file."
        )
    if model is None:
        chosen = lb.HybridModel.from_preset(preset or "default", 1 if degree is None else degree)
    else:
        chosen = lb.read_model(model, degree=1)
        chosen = chosen if degree is None else chosen.with_degree(degree)
    chosen = chosen.without(*without)
    return chosen if drift is None else chosen.with_term(lb.Drift(drift))  # type: ignore[arg-type]


_TABLE = options_of("table", "labels")
_CERTIFICATES = options_of("certificates")
_CERTIFIED = [
    *(own.to or name for name, own in _CERTIFICATES.items()),
    "bar_certificate",
    "force_certificate",
]
CampaignArgument = Annotated[
    Path,
    typer.Argument(help="A campaign folder, a campaign.toml or a tidy CSV.", metavar="CAMPAIGN"),
]
_PATH = inspect.Parameter("campaign", inspect.Parameter.KEYWORD_ONLY, annotation=CampaignArgument)
GivenCampaign = Annotated["Campaign", group(campaign_from, _PATH, **_TABLE, **_CERTIFICATES)]
Certificates = Annotated[dict[str, Any], group(certified, **_CERTIFICATES)]
TableFields = Annotated[dict[str, Any], group(campaign_fields, **_TABLE)]
ChosenModel = Annotated["HybridModel", group(model_from, **options_of("model"))]
SHARED = options_of("shared")
CI, SEED, SAMPLER, ESS, FORCE, JSON, QUIET, PRIOR_FROM, TOLERANCE = SHARED.values()
Tolerances = Annotated[
    dict[str, str], group(lambda tolerances=None: tolerances or {}, tolerance=TOLERANCE)
]
PoolOptions = Annotated[dict[str, Any], group(**options_of("pool"))]


# ---- where a result goes

_WIDTH = 120
_NARROWEST = 40


def show(*parts: Any) -> None:
    """Print tables (an empty line after each), sentences and lists on stdout, as wide as the
    terminal, else 120 columns."""
    from ldbb_bayes.results import lines_of

    stated = sys.stdout.isatty() or "COLUMNS" in os.environ
    width = shutil.get_terminal_size((_WIDTH, 24)).columns if stated else _WIDTH
    sys.stdout.write(lines_of(parts, max(width, _NARROWEST)) + "\n" * bool(parts))


def figure_files(names: Iterable[str], kinds: Collection[str] = ("png", "svg")) -> tuple[str, ...]:
    """Names of the files of figures."""
    return tuple(f"{name}.{kind}" for name in names for kind in kinds)


def drawing(name: str, *results: Any) -> Callable[[], Figure]:
    """Return what draws a figure of `lb.figures`: matplotlib is loaded only where a figure is
    wanted."""
    return lambda: cast("Figure", getattr(lb.figures, name)(*results))


def write_files(
    folder: Path,
    contents: Mapping[str, Any],
    figures: Mapping[str, Callable[[], Figure]] | None = None,
) -> None:
    """Write records as JSON, tables as CSV (by their files' names), text as it is and figures (PNG
    and SVG) into a folder."""
    from ldbb_bayes.results import json_text

    for name, content in contents.items():
        text = json_text(content) if name.endswith(".json") else content
        (folder / name).write_text(
            text if isinstance(text, str) else text.to_csv(index=False), encoding="utf-8"
        )
    for name, draw in (figures or {}).items():
        lb.figures.save_figure(draw(), folder, name)


@dataclass
class Output:
    """Where a result goes: files into a folder, all or none, and stdout, as JSON or for reading."""

    out: Path | None = None
    force: bool = False
    as_json: bool = False
    quiet: bool = True
    files: tuple[str, ...] = ()

    def check(self, *files: str, figures: Iterable[str] = ()) -> None:
        """Refuse a folder that must not be replaced, before any work is done; these files and
        figures may be."""
        from ldbb_bayes.files import check_target

        self.files = (*files, *figure_files(figures))
        if self.out is not None:
            check_target(self.out, force=self.force, ours=self.files)

    def deliver(
        self,
        record: Mapping[str, Any],
        result: Any,
        contents: Mapping[str, Any] | None = None,
        figures: Mapping[str, Callable[[], Figure]] | None = None,
        *,
        also: Callable[[Path], object] | None = None,
        more: str = "",
    ) -> None:
        """Write into the folder, then print the record or the result (or these parts of it), and
        where it was written, with ``more`` of it. ``also`` writes what is neither JSON nor table
        nor figure."""
        from ldbb_bayes.files import staged_folder
        from ldbb_bayes.report.text import parts_of
        from ldbb_bayes.results import json_text

        if self.out is not None:
            with staged_folder(self.out, force=self.force, ours=self.files) as staging:
                write_files(staging, contents or {}, figures or {})
                if also is not None:
                    also(staging)
        if self.as_json:
            sys.stdout.write(json_text(record))
            return
        show(*(result if isinstance(result, tuple) else parts_of(result)))
        if self.out is not None and not self.quiet:
            typer.echo(f"Written: {self.out}{more}")


OutputOptions = Annotated[Output, group(Output, **options_of("output"))]


# ---- progress


@contextmanager
def _progress(
    words: Callable[..., tuple[float, str]], quiet: bool, what: str
) -> Iterator[Callable[..., None] | None]:
    """A bar on stderr, whose ``words`` make share and text of what it is told; none when quiet or
    stderr is no terminal."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn(what),
        BarColumn(),
        TextColumn("{task.description}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=1.0)

        def update(*told: Any, **more: Any) -> None:
            share, text = words(*told, **more)
            bar.update(task, completed=share, description=text)

        yield update


def _counted(done: int, total: int, failed: int = 0) -> tuple[float, str]:
    return done / max(total, 1), f"{done}/{total}" + (f", {failed} failed" if failed else "")


def _sampled(state: Progress) -> tuple[float, str]:
    ess = min(state.assessment.ess_bulk_min, state.assessment.ess_tail_min)
    text = (
        f"{state.steps} steps, ESS {ess:.0f} of {state.target_ess:.0f}, R-hat"
        f" {state.assessment.rhat_max:.3f}"
    )
    return min(ess / state.target_ess, 1.0), text


counting_progress = functools.partial(_progress, _counted)
sampling_progress = functools.partial(_progress, _sampled)


def steps_of(
    update: Callable[[float, str, int, int], None] | None, **weights: float
) -> Callable[[str], Callable[..., None] | None]:
    """Return what begins a step and returns what tells how far it is: ``update`` gets the share of
    all steps done, each as long as its weight, the step, and what of it is done of how much (0: not
    known)."""
    before = dict(zip(weights, accumulate(weights.values(), initial=0.0), strict=False))
    total = sum(weights.values())

    def begin(step: str) -> Callable[..., None] | None:
        if update is None:
            return None

        def tell(done: int, of: int, _: int = 0) -> None:
            update((before[step] + weights[step] * done / max(of, 1)) / total, step, done, of)

        tell(0, 0)
        return tell

    return begin


@contextmanager
def step_progress(
    quiet: bool, **weights: float
) -> Iterator[Callable[[str], Callable[..., None] | None]]:
    """One bar over named steps, as of `steps_of`."""
    with _progress(
        lambda share, step, done, of: (share, f"{step} {done}/{of}" if of else step),
        quiet,
        "report",
    ) as update:
        yield steps_of(update, **weights)
