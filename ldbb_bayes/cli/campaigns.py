"""``ldbb-bayes import``, ``check``, ``simulate``, ``machine``, and of many campaigns ``batch``,
``trend``, ``population``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import ldbb_bayes as lb
from ldbb_bayes.cli import options
from ldbb_bayes.cli.options import Kind, Output, command, group, option, options_of
from ldbb_bayes.errors import InputError, require

if TYPE_CHECKING:
    from ldbb_bayes.machine.chain import Circle, Machine
    from ldbb_bayes.reading.headers import Layout
    from ldbb_bayes.results import Table

__all__ = [
    "ATLAS_FILES",
    "LAYOUT_OPTIONS",
    "batch",
    "check",
    "import_",
    "machine",
    "population",
    "simulate",
    "trend",
    "write_atlases",
]

_ROLES = ("angle", "time", "force", "pressure", "test", "direction", "reading")


def _named(column: str, _: str = "") -> str | int:
    return int(column) if column.isdecimal() else column


def _layout(layout: Path | None = None, **given: Any) -> Layout:
    """The layout of a file, and what the options say over it."""
    from_file = lb.Layout() if layout is None else lb.read_layout(layout)
    columns = {role: given.pop(f"{role}_column") for role in _ROLES if f"{role}_column" in given}
    return from_file.with_given({"columns": from_file.columns | columns, **given})


_READ = {
    "column": Kind(str, _named),
    "columns": Kind(list[str], lambda own, _: list(map(_named, own))),
    "sheets": Kind(str, lambda text, _: [own.strip() for own in text.split(",")]),
}
LAYOUT_OPTIONS = group(_layout, **options_of("layout", **_READ))


@command
def import_(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="CSV, text, XLSX, XLS or ODS; one test each, or a column that names the test.",
            metavar="FILE...",
        ),
    ],
    out: Annotated[
        Path, option(Path, "Campaign folder to write.", options.REQUIRED, metavar="CAMPAIGN")
    ],
    layout: Annotated[Any, LAYOUT_OPTIONS],
    name: Annotated[
        dict[str, Any], group(options.campaign_fields, name=option(str, "Name of the campaign."))
    ],
    table: options.TableFields,
    certificates: options.Certificates,
    force: Annotated[bool, options.FORCE],
    as_json: Annotated[bool, options.JSON],
) -> None:
    """Read tables as instruments and spreadsheets write them, and write the campaign; says what it
    assumed.

    Every assumption can be given as an option, or in --layout.
    """
    from ldbb_bayes.campaign.folder import IMPORT_NAME, files_of
    from ldbb_bayes.reading.headers import layout_to_toml

    output = Output(out, force, as_json, quiet=False)
    output.check(*files_of(out))
    result = lb.import_campaign(
        files, layout=layout, **table, **name, instrument=lb.Instrument(**certificates)
    )
    contents = {IMPORT_NAME: layout_to_toml(result.layout)}
    _deliver(
        output,
        result.campaign,
        result.as_dict(),
        result,
        contents,
        f". Look at it: ldbb-bayes check {out}",
    )


def _deliver(
    output: Output,
    campaign: lb.Campaign,
    record: Any,
    result: Any,
    contents: dict[str, Any],
    more: str,
) -> None:
    """Write a campaign and what stands beside it."""
    from ldbb_bayes.campaign.folder import write_campaign_into

    size = f" ({len(campaign.tests)} tests, {campaign.readings} readings)"
    output.deliver(
        record, result, contents, also=partial(write_campaign_into, campaign), more=f"{size}{more}"
    )


@command
def check(campaign: options.GivenCampaign, as_json: Annotated[bool, options.JSON]) -> None:
    """Preview a campaign: per test what is there and what looks odd, and what a fit will assume.
    Fits nothing."""
    from ldbb_bayes.report.text import parts_of

    seen = lb.preview(campaign)
    known = lb.uncertainties(campaign)
    record = lb.with_words(seen) | {
        "uncertainties": known.as_dict()["assumed"],
        "certificates": dict(known.certificates),
    }
    Output(as_json=as_json).deliver(record, (*parts_of(seen), *parts_of(known)))


@command
def simulate(
    source: Annotated[
        Path,
        typer.Argument(
            help="A TOML of truths (forces_N, parameters, hyper_um), or a plan or campaign."
        ),
    ],
    out: Annotated[
        Path, option(Path, "Campaign folder to write.", options.REQUIRED, metavar="DIR")
    ],
    model: options.ChosenModel,
    truth: Annotated[Path | None, option(Path, "Truths for a plan, as TOML.", metavar="FILE.toml")],
    certificates: options.Certificates,
    force: Annotated[bool, options.FORCE],
    seed: Annotated[int, options.SEED],
    as_json: Annotated[bool, options.JSON],
) -> None:
    """Write a campaign with simulated readings, and truth.json beside it.

    What the truths leave out is drawn from the priors.
    """
    from ldbb_bayes.campaign.folder import TRUTH_NAME, files_of
    from ldbb_bayes.model.specification import Truths, is_truths, read_truths

    if is_truths(source):
        cure = "Give a plan as first argument, or drop --truth."
        require(truth is None, f"truths must come from one file, got {source} and {truth}. {cure}")
        truths = read_truths(source)
        if truths.plan is None:
            cure = "List the forces, or give a plan as first argument."
            raise InputError(f"{source}: 'forces_N' must be given, got nothing. {cure}")
        plan = replace(truths.plan, instrument=lb.Instrument(**certificates))
    else:
        plan = options.campaign_from(source, **certificates)
        truths = Truths(None, None, {}, False) if truth is None else read_truths(truth)
        got = f"got it beside {source}. Remove one of them."
        require(truths.plan is None, f"{truth}: 'forces_N' must stand in truths given alone, {got}")
    made = model.simulate(
        plan, seed=seed, parameters=truths.parameters, hyper_um=truths.hyper_um, exact=truths.exact
    )
    found = {"parameters": made.parameters, "units": made.units, "hyper_um": made.hyper_um}
    record = {"schema": 1, "seed": seed, "sha256": made.campaign.sha256, **found}
    output = Output(out, force, as_json, quiet=False, files=tuple(files_of(out)))
    _deliver(
        output, made.campaign, record, (), {TRUTH_NAME: record}, f", the truth in {out}/truth.json"
    )


ATLAS_FILES = options.figure_files(
    f"{kind}_atlas{plane}"
    for kind in ("compliance", "geometric")
    for plane in ("", "_XY", "_YZ", "_ZX")
)


def write_atlases(machine: Machine, circles: Sequence[Circle], folder: Path) -> None:
    """Write the patterns of compliances and geometric errors, for the first circle of every
    plane."""
    first = {circle.plane: circle for circle in reversed(circles)}
    for plane in machine.planes:
        stem = f"_{plane}" if len(machine.planes) > 1 else ""
        atlases = {
            "compliance": lb.figures.compliance_atlas,
            "geometric": lb.figures.geometric_atlas,
        }
        drawn = {
            f"{name}_atlas{stem}": partial(draw, machine, first[plane])
            for name, draw in atlases.items()
        }
        options.write_files(folder, {}, drawn)


def _frames_in(entries: list[str], flag: str) -> dict[str, tuple[float, ...]]:
    pairs = options.pairs_in(entries, flag, "AXIS=X,Y,Z")
    return dict(zip(pairs, options.points_in(pairs.values(), flag), strict=True))


_MACHINE = group(**options_of("machine", frames=Kind(list[str], _frames_in, "AXIS=X,Y,Z")))


@command
def machine(
    topology: Annotated[
        str,
        typer.Argument(
            help="Joints from workpiece to tool, for example wCAFYXZSt.", metavar="TOPOLOGY"
        ),
    ],
    output: options.OutputOptions,
    asked: Annotated[dict[str, Any], _MACHINE],
) -> None:
    """Which compliances and geometric errors circular tests show, with the pattern of each and the
    set it stands for.

    Names follow ISO 230-1 and the paper. c = cos θ, s = sin θ; lengths in mm.
    """
    own = lb.Machine(topology, asked["plane"], asked.get("frames_mm", {}))
    circles = [
        lb.Circle(centre_mm=at, plane=name)
        for name in own.planes
        for at in asked.get("centre", [(0.0, 0.0, 0.0)])
    ]
    seen = lb.describe(own, circles)
    record = {"schema": 1, **seen.as_dict()}
    output.check("machine.json", *ATLAS_FILES)
    output.deliver(
        record, seen, {"machine.json": record}, also=partial(write_atlases, own, circles)
    )


_SHOWN = 10


_CAMPAIGNS = (
    "Campaign folders, campaign.toml files, tidy CSVs, folders of campaigns, or lists of any of"
    " them, one a line: "
)
_CAMPAIGNS += "@FILE or a .txt file."


@command
def batch(
    campaigns: Annotated[
        list[str], typer.Argument(help=_CAMPAIGNS, metavar="CAMPAIGNS...", show_default=False)
    ],
    out: Annotated[
        Path, option(Path, "Folder for the journal and the table.", options.REQUIRED, metavar="DIR")
    ],
    model: options.ChosenModel,
    table: options.TableFields,
    certificates: options.Certificates,
    tolerances: options.Tolerances,
    asked: Annotated[dict[str, Any], group(**options_of("batch"))],
    pool: options.PoolOptions,
    as_json: Annotated[bool, options.JSON],
    quiet: Annotated[bool, options.QUIET],
) -> None:
    """Fit many campaigns, each by itself: one table with a row per campaign (Parquet), which
    lb.read_batch reads.

    A campaign that cannot be fitted is a row that says why. Whatever stops a batch, the same
    command with --resume goes on to the very same table. Exit code 0 also when campaigns failed, 1
    when one missed its sampling target. The options for tidy CSVs apply to those among the
    campaigns.
    """
    from ldbb_bayes.fleet.dataset import JOURNAL
    from ldbb_bayes.parallel import executor_named

    if asked["resume"] and not (out / JOURNAL).exists():
        typer.echo(f"{out} holds no unfinished batch: this one begins anew.", err=True)
    try:
        with options.counting_progress(quiet, "campaigns") as progress:
            executor = partial(executor_named, **pool)
            given: dict[str, Any] = {
                "model": model,
                "table": table,
                "certificates": certificates,
                "tolerances": tolerances,
            }
            given |= asked
            done = lb.batch(campaigns, out, executor=executor, **given, progress=progress)
    except KeyboardInterrupt:
        if not (out / JOURNAL).exists():
            raise
        options.fail(
            f"interrupted; {out} keeps what is done. The same command with --resume goes on"
            " with it.",
            options.EXIT_INTERRUPTED,
        )
    options.Output(as_json=as_json).deliver(
        {"schema": 1, **lb.with_words(done)}, _batch_parts(done)
    )
    if done.not_converged:
        raise typer.Exit(options.EXIT_MISSED)


def _batch_parts(done: lb.Batch) -> tuple[Table | str, ...]:
    """How many of what, the first failures and doubts with their reasons, and where the table
    is."""
    from ldbb_bayes.results import Table

    numbers = (
        ("fitted", done.done),
        ("… not converged: do not use their numbers", done.not_converged),
        ("… with doubts: see their verdict", done.doubtful),
        ("failed", done.failed),
        ("in all", done.campaigns),
    )
    parts = []
    for head, entries in (("Failed", done.failures), ("To look at", done.doubts)):
        said = [tuple(one.values()) for one in entries[:_SHOWN]]
        parts += [f"{head}:", *(f"  {campaign}: {text}" for campaign, text in said)] if said else []
    if parts:
        parts.append("Each is a row too. What has been mended is done again with --resume --retry.")
    rate = (
        f"{done.fitted} campaigns in {done.seconds:.1f} s:"
        f" {done.fitted / max(done.seconds, 1e-9):.3g} a second."
    )
    ended = (rate if done.fitted else "Nothing was left to do.", f"Written: {done.dataset}")
    return (Table.of("", ("campaigns", "number"), numbers), *parts, *ended)


BatchesArgument = Annotated[
    list[Path], typer.Argument(help="Folders that ldbb-bayes batch wrote.", metavar="BATCH...")
]


@command
def trend(
    batches: BatchesArgument,
    output: options.OutputOptions,
    tolerances: options.Tolerances,
    asked: Annotated[dict[str, Any], group(**options_of("whose", "rows", "trend"))],
) -> None:
    """One machine over time: control chart, probability that a parameter has changed, which, when
    and by how much.

    One lasting step of one parameter is looked for. Exit code 0 whatever is found.
    """
    from ldbb_bayes.fleet.dataset import FLEET_COLUMNS, read_batch

    output.check("trend.json", "trend.csv", figures=["control_chart"])
    rows = read_batch(batches, FLEET_COLUMNS)
    result = lb.trend(rows, tolerances=tolerances, **asked)
    record = {"schema": 1, **lb.with_words(result)}
    contents = {"trend.json": record, "trend.csv": result.estimates}
    output.deliver(record, result, contents, {"control_chart": partial(lb.control_chart, result)})


_POPULATION = group(**options_of("rows", "population"))


@command
def population(
    batches: BatchesArgument,
    output: options.OutputOptions,
    asked: Annotated[dict[str, Any], _POPULATION],
) -> None:
    """The population that the machines of a batch come from: mean, spread, the next machine, and
    machines that do not belong.

    Campaigns of one machine (machine_id in campaign.toml) are taken together; each machine is
    compared with the others.
    """
    from ldbb_bayes.fleet.dataset import FLEET_COLUMNS, read_batch

    output.check("population.json", "machines.csv")
    rows = read_batch(batches, FLEET_COLUMNS)
    with options.counting_progress(output.quiet, "machines left out") as progress:
        result = lb.population(rows, **asked, progress=progress)
    record = lb.with_words(result)
    contents = {
        "population.json": record,
        "machines.csv": result.machines_table().rename_axis("machine").reset_index(),
    }
    output.deliver(record, result, contents)
