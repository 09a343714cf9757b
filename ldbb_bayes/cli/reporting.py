"""``ldbb-bayes report``: from files as they are found, or from a fit, to the page, in one go."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, cast

import typer

import ldbb_bayes as lb
from ldbb_bayes.cli import options
from ldbb_bayes.cli.analyses import RESULT_FILES, with_tolerances, write_result
from ldbb_bayes.cli.campaigns import LAYOUT_OPTIONS
from ldbb_bayes.cli.options import Output, command, group, option, options_of
from ldbb_bayes.errors import InputError, require

if TYPE_CHECKING:
    from concurrent.futures import Executor

    import xarray as xr

    from ldbb_bayes.campaign.campaign import Ball
    from ldbb_bayes.reading.importing import Imported
    from ldbb_bayes.report.page import Document

__all__ = ["MACHINES", "REPORT_OPTIONS", "STEPS", "Given", "figure_names", "report", "report_files"]

_FORMATS = ("svg", "png", "pdf")
TOML_NAME = "campaign.toml"
AVERAGED_NAME = "averaged.nc"
BESIDE = (AVERAGED_NAME, "campaign", "comparison.json", "design.json")


class MachineType(NamedTuple):
    """A kind of machine in words, the chain of its joints from workpiece to tool, and which of them
    move what."""

    name: str
    topology: str
    looks: str


MACHINES = tuple(MachineType(**own) for own in options.CATALOGUE["machines"])


# ---- what is asked where a terminal can answer


def _can_ask() -> bool:
    return sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()


def _ask(question: str, default: str, read: Callable[[str], Any]) -> Any:
    """The answer as ``read`` understands it; asked again where it does not."""
    while True:
        try:
            return read(
                str(
                    typer.prompt(question, default=default, err=True, show_default=bool(default))
                ).strip()
            )
        except InputError as error:
            typer.echo(str(error), err=True)


def _topology(answer: str) -> str:
    if answer.isdecimal():
        require(
            1 <= int(answer) <= len(MACHINES),
            f"a number must be 1 to {len(MACHINES)}, got {answer}. Or type the joints.",
        )
        return MACHINES[int(answer) - 1].topology
    return lb.Machine(answer).topology


def _is_yes(answer: str) -> bool:
    known = {"y": True, "yes": True, "j": True, "ja": True, "n": False, "no": False, "nein": False}
    require(
        answer.casefold() in known, f"the answer must be y or n, got {answer!r}. Type one of them."
    )
    return known[answer.casefold()]


def _grade(answer: str) -> Ball | None:
    return options.ball_in(answer, "the grade") if answer else None


def _answered(campaign: lb.Campaign, unsaid: set[str]) -> lb.Campaign:
    """The campaign with what its user says of machine, mount and balls; of each only what nothing
    says yet."""
    changed: dict[str, Any] = {}
    if "topology" in unsaid:
        typer.echo("What does the machine look like?", err=True)
        for k, own in enumerate(MACHINES, start=1):
            typer.echo(f"  {k}  {own.name} ({own.topology}): {own.looks}", err=True)
        plane = campaign.machine().plane
        chosen = _ask(
            f"Its number, or its joints from workpiece to tool (plane {plane})", "1", _topology
        )
        changed |= {"topology": chosen, "frames_mm": {}} if chosen != campaign.topology else {}
    if "mount" in unsaid and not _ask(
        "Are the readings compensated for the mount of the work ball? (y/n)", "y", _is_yes
    ):
        changed["mount"] = replace(campaign.mount, compensated=False)
    if "balls" in unsaid:
        ball = _ask(
            "Grade of the balls, G3 to G200, or deviation from sphericity, for example 0.5um"
            " (Enter: not known)",
            "",
            _grade,
        )
        changed |= (
            {}
            if ball is None
            else {"instrument": replace(campaign.instrument, work=ball, tool=ball)}
        )
    return replace(campaign, **changed) if changed else campaign


# ---- what is reported


@dataclass(frozen=True)
class Given:
    """What is read: paths, and what options say of tables, of their campaign and of the
    instrument."""

    files: Sequence[Path]  # as they are given
    paths: Sequence[Path]  # * and ? expanded
    layout: lb.Layout
    table: dict[str, Any]
    certificates: dict[str, Any]

    @property
    def is_result(self) -> bool:
        """Whether the first is a fit."""
        first = self.paths[0]
        return first.suffix == ".nc" or (first.is_dir() and (first / "posterior.nc").exists())

    @property
    def is_campaign(self) -> bool:
        """Whether the first is a campaign already, not tables to be imported."""
        first = self.paths[0]
        return first.suffix.lower() == ".toml" or (first / TOML_NAME).is_file()

    def check_alone(self) -> None:
        """Refuse what goes with an import beside a fit."""
        plain = self.layout == lb.Layout() and not self.table and not self.certificates
        cure = "Fit again with them."
        require(
            plain,
            "options of tables, machine and instrument must go with files, got a fit,"
            f" {self.paths[0]}. {cure}",
        )

    def folder(self) -> Path:
        """Where the report goes by default: beside the first file."""
        first = self.paths[0].parent if self.paths[0].name == TOML_NAME else self.paths[0]
        first = first.resolve() if first.is_dir() else first
        return first.parent / f"{first.name if first.is_dir() else first.stem}_report"

    def campaign(self, *, ask: bool) -> tuple[lb.Campaign, Imported | None]:
        """The campaign, and where it was imported what was assumed."""
        from ldbb_bayes.campaign.campaign import LABELS

        imported = None
        first = self.paths[0]
        if self.is_campaign:
            got = f"got {len(self.paths)}. Report each by itself; several fits go side by side"
            require(len(self.paths) == 1, f"report must have one campaign, {got}.")
            require(
                self.layout == lb.Layout(),
                f"options of an import must go with tables, got a campaign, {first}. Leave them"
                " out.",
            )
            labels = {key: self.table[key] for key in ("name", *LABELS) if key in self.table}
            others = {key: own for key, own in self.table.items() if key not in labels}
            campaign = replace(
                lb.read_campaign(first, certificates=self.certificates, **others), **labels
            )
        else:
            neither = (
                f"{first} must hold {TOML_NAME} or posterior.nc, got neither. Name the tables in"
                f" it: {first}/*"
            )
            require(not first.is_dir(), neither)
            instrument = lb.Instrument(**self.certificates)
            imported = lb.import_campaign(
                self.files, layout=self.layout, **self.table, instrument=instrument
            )
            campaign = imported.campaign
        got = "got a plan. Ask ldbb-bayes identify or design, or run it"
        require(not campaign.is_plan, f"{first} must have readings to be reported, {got}.")
        unsaid = {*(imported.unsaid if imported else ())}
        unsaid |= (
            {"balls"}
            if campaign.instrument.work == campaign.instrument.tool == lb.Ball()
            else set()
        )
        if ask:
            campaign = _answered(campaign, unsaid)
            if imported is not None:
                left = tuple(
                    own
                    for own in imported.assumptions
                    if own.what not in {"topology", "mount"} & unsaid
                )
                imported = replace(imported, campaign=campaign, assumptions=left)
        return campaign, imported


# ---- the report of files

STEPS = {"fit": 1.0, "compare": 10.0, "average": 1.0, "page": 8.0}
# Of a log evidence [nat]: a third to a tenth of the time that 0.01 takes, which compare asks.
_TOLERANCE = 0.05
Begin = Callable[[str], Callable[..., None] | None]
Reported = tuple["Document", tuple[Any, ...], bool]


def report_files(
    source: Given,
    output: Output,
    asked: dict[str, Any],
    model: lb.HybridModel,
    steps: AbstractContextManager[Begin],
    *,
    ask: bool = False,
) -> Reported:
    """Write everything into a folder of its own; return the page, what is printed, and whether all
    fits reached their target.

    ``steps``, as of `ldbb_bayes.cli.options.step_progress`, is told of every step of `STEPS` that
    begins.
    """
    from ldbb_bayes.analysis.conformity import check_force
    from ldbb_bayes.files import staged_folder
    from ldbb_bayes.inference.posterior import record_of
    from ldbb_bayes.parallel import second_process
    from ldbb_bayes.report.text import full_result

    for name in ("comparison", "design"):
        require(
            name not in asked,
            f"--{name} must go with a fit, got {source.paths[0]}. Leave it out: it is worked out.",
        )
    require(
        not asked["same_instrument"],
        "--same-instrument must go with several fits, got files. Leave it out.",
    )
    from ldbb_bayes.report.page import REPORT_FILES

    output.out = output.out or source.folder()
    output.check(*RESULT_FILES, *REPORT_FILES, *BESIDE)
    campaign, imported = source.campaign(ask=ask)
    check_force(campaign, asked.get("force_N"))
    campaign = with_tolerances(campaign, model, asked.get("tolerances", {}))
    with steps as begin, second_process() as executor:
        fit, worked = _worked(campaign, model, begin, asked, executor)
        numbers = fit if worked["averaged"] is None else worked["averaged"]
        result, stated = (full_result(own, asked["ci_prob"]) for own in (fit, numbers))
        if campaign.tolerances:  # decided once: what the sheets state, at their force
            decided = lb.conformity(numbers, force_N=asked.get("force_N"))
            result["conformity"] = stated["conformity"] = {
                name: own.as_dict() for name, own in decided.items()
            }
        with staged_folder(output.out, force=output.force, ours=output.files) as staging:
            document = lb.write_report(
                fit, staging, **worked, **_of_page(asked), progress=begin("page")
            )
            worked["recommended"] = worked["recommended"]()
            _write_beside(staging, fit, result, imported, worked)
    parts = _said(imported, fit, stated, worked)
    return document, parts, record_of(fit)["sampler"]["converged"]


def _of_page(asked: dict[str, Any]) -> dict[str, Any]:
    """What is asked of the page alone."""
    return {key: asked[key] for key in ("ci_prob", "language", "annex", "force_N") if key in asked}


def _worked(
    campaign: lb.Campaign,
    model: lb.HybridModel,
    begin: Begin,
    asked: dict[str, Any],
    executor: Executor | None,
) -> tuple[xr.DataTree, dict[str, Any]]:
    """The fit of linear compliance; how constant and linear compare, their average, and, when
    asked, the tests to run next; or why not."""
    from ldbb_bayes.inference.evidence import Evidences
    from ldbb_bayes.parallel import ahead

    seed = asked["seed"]
    models = {"constant": model.with_degree(0), "linear": model}
    ahead(
        partial(callable, lb.compare), executor
    )  # The other process starts and imports meanwhile.
    begin("fit")
    fit = lb.sample(model, campaign, sampler="independent", seed=seed)
    both = {"evidences": Evidences(campaign, tolerance=_TOLERANCE), "seed": seed}
    told = begin("compare")
    of_pair = partial(
        lb.compare,
        models,
        campaign,
        ci_prob=asked["ci_prob"],
        progress=told,
        executor=executor,
        **both,
    )
    comparison = _or_reason(of_pair)
    design = ahead(
        partial(
            _or_reason,
            partial(lb.design, model, pilot=campaign, tests=asked.get("tests"), seed=seed),
        ),
        executor,
    )
    begin("average")
    mean = _or_reason(partial(lb.average, models, campaign, **both))
    return fit, {
        "comparison": comparison,
        "recommended": cache(design),
        "averaged": None if isinstance(mean, str) else mean,
    }


def _or_reason(work: Callable[[], Any]) -> Any:
    """What comes of it, or why it cannot be had: a page says so in its place."""
    try:
        return work()
    except InputError as error:
        return str(error)


def _write_beside(
    folder: Path,
    fit: xr.DataTree,
    result: dict[str, Any],
    imported: Imported | None,
    worked: dict[str, Any],
) -> None:
    """What stands beside the page: the fit, the campaign as it was understood, comparison and
    design."""
    from ldbb_bayes.campaign.folder import IMPORT_NAME, write_campaign_into
    from ldbb_bayes.inference.posterior import campaign_of
    from ldbb_bayes.reading.headers import layout_to_toml

    write_result(fit, result, folder)
    if worked["averaged"] is not None:
        lb.save(worked["averaged"], folder / AVERAGED_NAME)
    (folder / "campaign").mkdir()
    write_campaign_into(campaign_of(fit), folder / "campaign")
    if imported is not None:
        options.write_files(folder / "campaign", {IMPORT_NAME: layout_to_toml(imported.layout)})
    kept = {"comparison.json": worked["comparison"], "design.json": worked["recommended"]}
    found = {
        name: {"schema": 1, **lb.with_words(own)}
        for name, own in kept.items()
        if not isinstance(own, str)
    }
    options.write_files(folder, found)


def _said(
    imported: Imported | None, fit: xr.DataTree, result: dict[str, Any], worked: dict[str, Any]
) -> tuple[Any, ...]:
    """What is printed: what was assumed, what looks odd, the results but for slopes, constant or
    linear, what to run next."""
    from ldbb_bayes.inference.posterior import campaign_of, model_of
    from ldbb_bayes.reading.headers import Assumption
    from ldbb_bayes.report import text, wording

    campaign = campaign_of(fit)
    comparison = worked["comparison"]
    design = worked["recommended"]
    constant = model_of(fit).with_degree(0).bind(campaign).names
    shown = {name: own for name, own in result["parameters"].items() if name in constant}
    table = text.results_table(result | {"parameters": shown}, lb.verdicts(fit))
    head = (
        "Linear compliance:"
        if worked["averaged"] is None
        else "Averaged over constant and linear compliance:"
    )
    weighed = (
        comparison if isinstance(comparison, str) else wording.comparison_sentences(comparison)[0]
    )
    planned = (
        design
        if isinstance(design, str)
        else f"Run next: {', '.join(test.name for test in design.plan().tests)}"
    )
    balls = Assumption(
        "",
        "balls",
        "as the model assumes",
        "nothing says otherwise",
        "--balls, --work-ball, --tool-ball",
    )
    made = imported.assumptions if imported else ()
    made += (balls,) if campaign.instrument.work == campaign.instrument.tool == lb.Ball() else ()
    assumed = (
        text.parts_of(replace(imported, assumptions=made))
        if imported
        else tuple(map(wording.assumption_words, made))
    )
    limits = [text.conformity_table(result["conformity"])] if "conformity" in result else []
    return (
        *assumed,
        *wording.preview_sentences(lb.preview(campaign)),
        head,
        table,
        *limits,
        weighed,
        planned,
    )


# ---- the report of fits


def _of_fits(source: Given, output: Output, asked: dict[str, Any]) -> Reported:
    """The page, written into the folder of the fit or another."""
    from ldbb_bayes.analysis.conformity import quantities_of, tolerances_in
    from ldbb_bayes.inference.posterior import bound_of, campaign_of, record_of
    from ldbb_bayes.report.page import REPORT_FILES, check_folder

    source.check_alone()
    paths = source.paths
    out = output.out
    folder = output.out = out or (paths[0] if paths[0].is_dir() else paths[0].parent)
    there = next((name for name in REPORT_FILES if (folder / name).exists()), None)
    if there is not None and not output.force:
        raise InputError(
            f"{folder / there} must not exist, got an earlier report. Choose another --out or pass"
            " --force."
        )
    check_folder(folder)
    own = paths[0] if paths[0].is_dir() else paths[0].parent
    kept = [own if (own / f"{name}.json").exists() else None for name in ("comparison", "design")]
    comparison = asked.get("comparison", kept[0])
    design = asked.get("design", None if "tests" in asked else kept[1])
    if design is not None and "tests" in asked:
        raise InputError("--tests must not go with --design, got both. The design says how many.")
    if asked["same_instrument"] and len(paths) == 1:
        raise InputError(
            "--same-instrument must go with a second fit, got one alone. Name the fit to set"
            " beside it."
        )
    first, *others = (lb.load(path) for path in paths)
    tolerances = dict(campaign_of(first).tolerances) | asked.get("tolerances", {})
    tolerances_in(quantities_of(bound_of(first)), tolerances)
    with options.counting_progress(output.quiet, "sections") as progress:
        document = lb.write_report(
            first,
            folder,
            beside_it=_named(first, others, paths[1:]),
            **{key: asked[key] for key in ("tests", "same_instrument") if key in asked},
            **_of_page(asked),
            tolerances=tolerances,
            comparison=None if comparison is None else lb.read_comparison(comparison),
            recommended=None if design is None else lb.read_design(design),
            averaged=lb.load(own / AVERAGED_NAME) if (own / AVERAGED_NAME).exists() else None,
            progress=progress,
        )
    return document, (), record_of(first)["sampler"]["converged"]


def figure_names() -> tuple[str, ...]:
    """Figures that may be replaced: those of an earlier report."""
    from ldbb_bayes.report.sections import PICTURES

    return options.figure_files(PICTURES, _FORMATS)


def _named(
    first: xr.DataTree, posteriors: list[xr.DataTree], paths: Sequence[Path]
) -> dict[str, xr.DataTree]:
    """Keyed by the campaign's name; by the folder's where two have the same."""
    from ldbb_bayes.inference.posterior import record_of

    names = [str(record_of(posterior)["campaign"]["name"]) for posterior in (first, *posteriors)]
    if len(set(names)) < len(names):
        names = ["", *(f"{name} ({path})" for name, path in zip(names[1:], paths, strict=True))]
    return dict(zip(names[1:], posteriors, strict=True))


# ---- the command

REPORT_OPTIONS = group(**options_of("report"))
_FILES = typer.Argument(
    help=(
        "Tables as they are found (workbook, CSV, text; * and ? are expanded), a campaign, or the"
        " --out folder of a fit; more fits are set beside the first."
    ),
    metavar="FILE...",
)


@command
def report(
    files: Annotated[list[Path], _FILES],
    output: options.OutputOptions,
    asked: Annotated[dict[str, Any], REPORT_OPTIONS],
    figures: Annotated[
        Path | None,
        option(Path, "Folder for the figures of the page, as SVG, PNG and PDF.", metavar="DIR"),
    ],
    yes: Annotated[
        bool,
        option(
            bool, "Ask nothing: what neither files nor options say is assumed, and said.", False
        ),
    ],
    model: options.ChosenModel,
    layout: Annotated[Any, LAYOUT_OPTIONS],
    table: options.TableFields,
    certificates: options.Certificates,
) -> None:
    """From files to a page and a PDF for signing, in one go: reads, checks, fits, compares, and
    designs the next tests.

    Asks at most three questions where a terminal can answer them. Writes report.html, report.pdf,
    report.json, dcc.xml, tables, the campaign as it was understood, and the fit into FILE_report
    beside the first. Of a fit, the page goes into its own folder. Exit code 1 when a fit missed its
    target; the page then says so at its top.
    """
    from ldbb_bayes.files import check_target, staged_folder
    from ldbb_bayes.inference.summary import check_probability
    from ldbb_bayes.reading.importing import matching

    check_probability(asked["ci_prob"])
    source = Given(files, matching(files), layout, table, certificates)
    ours = figure_names()
    got = f"got {model.degree}. Leave --degree out; or fit it, and report the fit"
    require(
        model.degree == 1, f"report must weigh constant and linear compliance, --degree 1, {got}."
    )
    if figures is not None:
        check_target(figures, force=output.force, ours=ours)
    if source.is_result:
        document, parts, converged = _of_fits(source, output, asked)
    else:
        steps = options.step_progress(output.quiet, **STEPS)
        document, parts, converged = report_files(
            source, output, asked, model, steps, ask=not yes and _can_ask()
        )
    if figures is not None:
        with staged_folder(figures, force=output.force, ours=ours) as staging:
            for picture in document.pictures:
                lb.figures.save_figure(picture.figure, staging, picture.key, formats=_FORMATS)
    _print(output, parts, document, "" if figures is None else f"; figures: {figures}")
    if not converged:
        raise typer.Exit(options.EXIT_MISSED)


def _print(output: Output, parts: tuple[Any, ...], document: Document, more: str) -> None:
    """The JSON of the report, or what is read of it and where it stands."""
    from ldbb_bayes.report.page import REPORT_FILES

    folder = cast("Path", output.out)
    if output.as_json:
        typer.echo((folder / "report.json").read_text(encoding="utf-8"), nl=False)
        return
    options.show(*parts, *(f"Note: {alert}" for alert in document.alerts))
    typer.echo(f"Written: {', '.join(f'{folder}/{name}' for name in REPORT_FILES)}{more}")
