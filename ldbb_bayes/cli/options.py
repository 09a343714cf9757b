"""Options of the commands, what they mean, and where a result goes: a folder, JSON on stdout, tables; progress on stderr."""

from __future__ import annotations

import functools
import inspect
import math
import os
import re
import shutil
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
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

EXIT_MISSED, EXIT_BAD_INPUT, EXIT_INTERRUPTED = 1, 2, 130
REQUIRED = inspect.Parameter.empty
# Short, so that names of options stay whole in the help on narrow terminals.
_METAVARS: Mapping[Any, str] = {float: "X", int: "N", str: "TEXT", bool: " "}


# ---- groups of options


class Kind(NamedTuple):
    """What is typed, and what it means: ``read`` gets it and the option's name."""

    typed: Any
    read: Callable[[Any, str], Any]
    metavar: str | None = None


@dataclass(frozen=True)
class Option:
    """One option, handed on as the keyword ``to``; None is not, so that the function's own default holds.

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
        typed, default = self.kind, self.default
        if isinstance(typed, Kind):
            more.setdefault("metavar", typed.metavar)
            typed = typed.typed
        more.setdefault("metavar", _METAVARS.get(typed))
        typed = typed | None if default is None else typed
        annotation = Annotated[typed, typer.Option(self.flag(name), help=self.help, **more)]  # type: ignore[valid-type]
        return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)

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
    """Options that together make one argument of a command, after one that is no option where ``first`` is given."""

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
        read = {option.to or name: option.read(typed.pop(name), name) for name, option in self.options.items()}
        return self.make(*first, **{name: value for name, value in read.items() if value is not None})


def option(kind: Any, help: str, default: Any = None, to: str = "", **more: Any) -> Option:
    """One option of a command or of a `group`."""
    return Option(kind, help, default, to, more)


def group(make: Callable[..., Any] = dict, first: inspect.Parameter | None = None, /, **options: Option) -> Group:
    """Options that make one argument: by default a dictionary of those given."""
    return Group(options, make, first)


def in_panel(panel: str, **options: Option) -> dict[str, Option]:
    """The options under a heading of their own."""
    return {name: replace(own, more={**own.more, "rich_help_panel": panel}) for name, own in options.items()}


def command(function: Callable[..., None]) -> Callable[..., None]:
    """A function as a command: groups of options spelled out, bad input answered with one message, never a traceback."""
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
            parameters.append(own.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=kinds[name]))

    @functools.wraps(function)
    def run(**typed: Any) -> None:
        try:
            function(**{name: group.made(typed) for name, group in groups.items()}, **typed)
            sys.stdout.flush()
        except BrokenPipeError:
            sys.stdout = open(os.devnull, "w")  # noqa: SIM115
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
    print(f"ldbb-bayes: {message}", file=sys.stderr)  # noqa: T201
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
            raise InputError(f"{option} must be {form}, got {entry!r}. Put a name, '=' and what belongs to it.")
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
    require(all(map(math.isfinite, numbers)), f"{option} must hold numbers, got {text!r}. Write them like 36{separator}2e-6.")
    return numbers


def points_in(entries: Iterable[str], option: str) -> list[tuple[float, ...]]:
    """X,Y,Z of an option that may be repeated [mm]."""
    points = [numbers_in(text, option) for text in entries]
    for point in points:
        require(len(point) == 3, f"{option} must hold three numbers X,Y,Z in mm, got {len(point)}. For example 0,-200,350.")
    return points


def ball_in(text: str, option: str) -> Ball:
    """A grade, or a deviation from sphericity with its unit."""
    size, like = re.fullmatch(r"(\d*\.?\d+) ?[uµμ]m", text), "a grade like G20, or a deviation from sphericity like 0.5um"
    require(size or text[:1] not in {*"+-.0123456789"}, f"{option} must be {like}, got {text!r}. Correct it.")
    with placed(option):
        return lb.Ball(grade=text) if size is None else lb.Ball(sphericity_um=float(size[1]))


NAMES = Kind(str, names_in, "LIST")
BALL = Kind(str, ball_in, "G20|0.5um")
NEGATED = Kind(bool, lambda value, _: not value)
POINTS = Kind(list[str], points_in, "X,Y,Z")


# ---- campaign and model


def campaign_from(path: Path, **options: Any) -> Campaign:
    """The campaign the argument names; the options say of a tidy CSV what campaign.toml would say, and what certificates say."""
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
        raise InputError(f"what a DCC says must not be given by hand as well, {got}. Keep one of them.")
    return ({} if balls is None else {"work": balls, "tool": balls}) | stated | given


def campaign_fields(*, raw: bool = False, **given: Any) -> dict[str, Any]:
    """What the options say of a campaign that no table says: those given, as fields of `Campaign`."""
    deflection, slope, offset = (given.pop(name, None) for name in ("mount_um_per_bar", "force_slope", "force_offset"))
    if raw or deflection is not None:
        given["mount"] = lb.MountCompensation(2.33 if deflection is None else deflection, compensated=not raw)
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
        raise InputError("the model must come from --model or --preset, got both. Write preset = … into the file.")
    if model is None:
        chosen = lb.HybridModel.from_preset(preset or "default", 1 if degree is None else degree)
    else:
        chosen = lb.read_model(model, degree=1)
        chosen = chosen if degree is None else chosen.with_degree(degree)
    chosen = chosen.without(*without)
    return chosen if drift is None else chosen.including(lb.Drift(drift))  # type: ignore[arg-type]


_TABLE = in_panel(
    "For a tidy CSV",
    topology=option(str, "Joints from workpiece to tool."),
    plane=option(str, "XY, YZ or ZX."),
    radius_mm=option(float, "Nominal radius (mm). Default 150."),
    resolution_um=option(float, "Step of the readout (µm). Default 0.24."),
    raw=option(bool, "The readings are not compensated for the mount.", False),
    mount_um_per_bar=option(float, "Deflection of the mount. Default 2.33."),
    force_slope=option(float, "Force law, N per bar. Default 126.04."),
    force_offset=option(float, "Force law, force at zero pressure (N). Default -14.2."),
)
LABEL_OPTIONS = in_panel(
    "What was measured, when and with what (no number depends on it)",
    machine_type=option(str, "Maker and type of the machine."),
    serial_number=option(str, "Of the machine."),
    machine_id=option(str, "Name of the machine within a fleet. Default: the serial number."),
    date=option(str, "Of the measurement, ISO 8601.", metavar="DATE"),
    operator=option(str, "Who measured."),
    place=option(str, "Where."),
    ball_bar=option(str, "Type and number of the ball bar."),
    ball_bar_calibrated=option(str, "Date of its calibration, ISO 8601.", metavar="DATE"),
    force_device=option(str, "What makes or measures the force."),
)
_TABLE |= LABEL_OPTIONS
_LEAST = 1e-6
_CERTIFICATES = in_panel(
    "Certificates (U: expanded, k = 2), before what campaign.toml says",
    balls=option(BALL, "Form of both balls: grade (ISO 3290: G3 to G200), or deviation from sphericity, for example 0.5um."),
    work_ball=option(BALL, "The work ball's, likewise.", to="work"),
    tool_ball=option(BALL, "The tool ball's, likewise.", to="tool"),
    bar_length_error_um=option(float, "Error of the bar's length (µm)."),
    bar_U_um=option(float, "U of the bar's length (µm).", min=_LEAST),
    mount_U_percent=option(float, "U of the mount's deflection (%).", min=_LEAST, max=100),
    force_U_percent=option(float, "U of the force's gain (%).", min=_LEAST, max=100),
    force_linearity_percent=option(float, "Non-linearity of the force, at most (% of the largest force).", min=_LEAST, max=100),
    force_random_N=option(float, "Random error of every force (N, 1 sd).", min=_LEAST),
    angle_U_deg=option(float, "U of the angle (°).", min=_LEAST),
    bar_dcc=option(Path, "Digital calibration certificate (DCC, XML) of the bar.", metavar="FILE"),
    force_dcc=option(Path, "DCC of the force device.", metavar="FILE"),
    work_ball_dcc=option(Path, "DCC of the work ball.", to="work_dcc", metavar="FILE"),
    tool_ball_dcc=option(Path, "DCC of the tool ball.", to="tool_dcc", metavar="FILE"),
)
_CERTIFIED = [*(own.to or name for name, own in _CERTIFICATES.items()), "bar_certificate", "force_certificate"]
_TERMS = "ball-form, bar-length, mount, force-error, setup-shift, discrepancy, hysteresis, drift, truncation"
_MODEL = group(
    model_from,
    degree=option(int, "Compliance constant (0), linear (1) or quadratic (2) in force. Default 1.", min=0, max=2),
    preset=option(str, "default: all effects and priors. first: as in the first edition. paper: least squares (Eq. 31)."),
    without=option(NAMES, f"Comma-separated terms to leave out: {_TERMS}.", metavar=None),
    drift=option(str, "Centre and length drift with time or temperature, as the tests record it.", metavar="time|temperature"),
    model=option(Path, "Model as TOML (priors, terms, degree).", metavar="FILE.toml"),
)
CampaignArgument = Annotated[Path, typer.Argument(help="A campaign folder, a campaign.toml or a tidy CSV.", metavar="CAMPAIGN")]
_PATH = inspect.Parameter("campaign", inspect.Parameter.KEYWORD_ONLY, annotation=CampaignArgument)
GivenCampaign = Annotated["Campaign", group(campaign_from, _PATH, **_TABLE, **_CERTIFICATES)]
Certificates = Annotated[dict[str, Any], group(certified, **_CERTIFICATES)]
TableFields = Annotated[dict[str, Any], group(campaign_fields, **_TABLE)]
ChosenModel = Annotated["HybridModel", _MODEL]
TOLERANCE = option(
    Kind(list[str], lambda own, flag: pairs_in(own, flag, 'NAME="VALUE UNIT"'), "NAME=VALUE"),
    'Limit of a quantity: C_XXX="60 nm/N", stiffness_X="18 N/µm", G="20 µm", E_XX1="-20..40 µm/m"; can be repeated. '
    "Before what campaign.toml says.",
    to="tolerances",
)
Tolerances = Annotated[dict[str, str], group(lambda tolerances=None: tolerances or {}, tolerance=TOLERANCE)]


# ---- options that several commands have

CI = option(float, "Probability of the credible intervals.", 0.95, "ci_prob")
SEED = option(int, "Seed of all random numbers.", 1, min=0, max=2**63 - 1)
SAMPLER = option(str, "independent or joint.", "independent")
ESS = option(float, "Bulk and tail effective sample size every parameter must reach.", 1000.0, min=100.0)
FORCE = option(bool, "Replace existing results.", False)
JSON = option(bool, "Print the result as JSON on stdout, and nothing else there.", False, name="--json")
QUIET = option(bool, "No progress.", False)
PRIOR_FROM = option(
    Path,
    "Result of a population of other machines of the kind (folder or population.json), the prior of the compliances.",
    metavar="POPULATION",
)
PoolOptions = Annotated[
    dict[str, Any],
    group(
        executor=option(
            str, "What the jobs run on: process (the cores here) or dask.", "process", "kind", metavar="process|dask"
        ),
        scheduler=option(
            str, "Dask scheduler to use, for example tcp://10.0.0.1:8786. Default: workers on this machine.", metavar="ADDRESS"
        ),
        workers=option(int, "Processes, one BLAS thread each; 0: one per core. None is started for 1.", 0, min=0),
    ),
]


# ---- where a result goes

_WIDTH, _NARROWEST = 120, 40


def show(*parts: Any) -> None:
    """Print tables (an empty line after each), sentences and lists on stdout, as wide as the terminal, else 120 columns."""
    from ldbb_bayes.report.text import lines_of

    stated = sys.stdout.isatty() or "COLUMNS" in os.environ
    width = shutil.get_terminal_size((_WIDTH, 24)).columns if stated else _WIDTH
    sys.stdout.write(lines_of(parts, max(width, _NARROWEST)) + "\n" * bool(parts))


def figure_files(names: Iterable[str], kinds: Collection[str] = ("png", "svg")) -> tuple[str, ...]:
    """Names of the files of figures."""
    return tuple(f"{name}.{kind}" for name in names for kind in kinds)


def drawing(name: str, *results: Any) -> Callable[[], Figure]:
    """Return what draws a figure of `lb.figures`: matplotlib is loaded only where a figure is wanted."""
    return lambda: cast("Figure", getattr(lb.figures, name)(*results))


def write_files(folder: Path, contents: Mapping[str, Any], figures: Mapping[str, Callable[[], Figure]] | None = None) -> None:
    """Write records as JSON, tables as CSV (by their files' names), text as it is and figures (PNG and SVG) into a folder."""
    from ldbb_bayes.result import json_text

    for name, content in contents.items():
        text = json_text(content) if name.endswith(".json") else content
        (folder / name).write_text(text if isinstance(text, str) else text.to_csv(index=False), encoding="utf-8")
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
        """Refuse a folder that must not be replaced, before any work is done; these files and figures may be."""
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
        """Write into the folder, then print the record or the result (or these parts of it), and where it was written, with
        ``more`` of it. ``also`` writes what is neither JSON nor table nor figure."""
        from ldbb_bayes.files import staged_folder
        from ldbb_bayes.report.text import parts_of
        from ldbb_bayes.result import json_text

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


OutputOptions = Annotated[
    Output,
    group(
        Output,
        out=option(Path, "Folder to write results to. Without it nothing is written.", metavar="DIR"),
        force=FORCE,
        as_json=JSON,
        quiet=QUIET,
    ),
]


# ---- progress


@contextmanager
def _progress(words: Callable[..., tuple[float, str]], quiet: bool, what: str) -> Iterator[Callable[..., None] | None]:
    """A bar on stderr, whose ``words`` make share and text of what it is told; none when quiet or stderr is no terminal."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (TextColumn(what), BarColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), TimeRemainingColumn())
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
    text = f"{state.steps} steps, ESS {ess:.0f} of {state.target_ess:.0f}, R-hat {state.assessment.rhat_max:.3f}"
    return min(ess / state.target_ess, 1.0), text


counting_progress = functools.partial(_progress, _counted)
sampling_progress = functools.partial(_progress, _sampled)


@contextmanager
def step_progress(quiet: bool, **weights: float) -> Iterator[Callable[[str], Callable[..., None] | None]]:
    """One bar over named steps, each as long as its weight: what begins a step, and returns what tells how far it is."""
    before, total = dict(zip(weights, accumulate(weights.values(), initial=0.0), strict=False)), sum(weights.values())
    with _progress(lambda share, text: (share, text), quiet, "report") as update:

        def begin(step: str) -> Callable[..., None] | None:
            if update is None:
                return None

            def tell(done: int, of: int, _: int = 0) -> None:
                name = step.replace("_", " ")
                update((before[step] + weights[step] * done / max(of, 1)) / total, f"{name} {done}/{of}" if of else name)

            tell(0, 0)
            return tell

        yield begin
