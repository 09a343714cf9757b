"""``ldbb-bayes batch``, ``trend``, ``population``: many campaigns."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ldbb_bayes.cli.options import (
    EXIT_INTERRUPTED,
    ChosenModel,
    CiOption,
    ExecutorOption,
    ForceOption,
    JsonOption,
    Output,
    PriorFromOption,
    QuietOption,
    SchedulerOption,
    SeedOption,
    TableFields,
    WorkersOption,
    command,
    fail,
    names_in,
)
from ldbb_bayes.cli.show import counting_progress, figure_files, show, write_files

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ldbb_bayes.fleet.batch import Batch
    from ldbb_bayes.table import Table

__all__ = ["batch", "population", "trend"]

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


CampaignsArgument = Annotated[
    list[str],
    typer.Argument(
        help="Campaign folders, campaign.toml files, tidy CSVs, folders of campaigns, or lists of any of them, one a line: "
        "@FILE or a .txt file.",
        metavar="CAMPAIGNS...",
        show_default=False,
    ),
]
_SHOWN = 10


@command
def batch(
    campaigns: CampaignsArgument,
    out: Annotated[Path, typer.Option(help="Folder for the journal and the table.", metavar="DIR", show_default=False)],
    model: ChosenModel,
    table: TableFields,
    prior_from: PriorFromOption = None,
    sampler: Annotated[str, typer.Option(help="independent or joint.")] = "independent",
    ess: Annotated[
        float, typer.Option(help="Bulk and tail effective sample size every parameter must reach.", min=100.0)
    ] = 1000.0,
    executor: ExecutorOption = "process",
    scheduler: SchedulerOption = None,
    workers: WorkersOption = 0,
    posteriors: Annotated[
        bool, typer.Option("--posteriors", help="Keep the posterior of every campaign as well (1 MB each).")
    ] = False,
    no_compare: Annotated[bool, typer.Option("--no-compare", help="Do not weigh linear compliance against constant.")] = False,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with a batch that stopped.")] = False,
    retry: Annotated[
        bool,
        typer.Option("--retry", help="With --resume: also do again what failed, and campaigns whose files have changed since."),
    ] = False,
    force: ForceOption = False,
    as_json: JsonOption = False,
    seed: SeedOption = 1,
    ci: CiOption = 0.95,
    quiet: QuietOption = False,
) -> None:
    """Fit many campaigns, each by itself: one table with a row per campaign (Parquet), which lb.read_batch reads.

    A campaign that cannot be fitted is a row that says why. Whatever stops a batch, the same command with --resume goes on to the
    very same table. Exit code 0 also when campaigns failed, 1 when one missed its sampling target. The options for tidy CSVs
    apply to those among the campaigns.
    """
    from ldbb_bayes.fleet.batch import batch as run
    from ldbb_bayes.fleet.dataset import JOURNAL
    from ldbb_bayes.fleet.population_prior import prior_from as read_prior
    from ldbb_bayes.jobs import check_executor, executor_named
    from ldbb_bayes.report.wording import with_words

    check_executor(executor, workers, scheduler)
    if resume and not (out / JOURNAL).exists():
        typer.echo(f"{out} holds no unfinished batch: this one begins anew.", err=True)
    try:
        with counting_progress(quiet, "campaigns") as progress:
            done = run(
                campaigns,
                out,
                model=model,
                prior_from=None if prior_from is None else read_prior(prior_from),
                sampler=sampler,
                executor=partial(executor_named, executor, workers, scheduler),
                seed=seed,
                ess=ess,
                ci_prob=ci,
                posteriors=posteriors,
                compare=not no_compare,
                table=table,
                resume=resume,
                retry=retry,
                force=force,
                progress=progress,
            )
    except KeyboardInterrupt:
        if not (out / JOURNAL).exists():
            raise
        fail(f"interrupted; {out} keeps what is done. The same command with --resume goes on with it.", EXIT_INTERRUPTED)
    for path in done.repeated[:_SHOWN]:
        typer.echo(f"{path} was given more than once: kept once.", err=True)
    if len(done.repeated) > _SHOWN:
        typer.echo(f"… and {len(done.repeated) - _SHOWN} more.", err=True)
    Output(None, False, as_json, quiet).deliver(
        {"schema": 1, **with_words(done)}, (), lambda _: None, lambda: show(*_batch_parts(done))
    )
    if done.not_converged:
        raise typer.Exit(1)


@command
def trend(
    batches: BatchesArgument,
    output: Output,
    machine: Annotated[
        str | None, typer.Option(help="Whose campaigns; needed where they are of several machines.", metavar="ID")
    ] = None,
    parameters: ParametersOption = None,
    exclude: ExcludeOption = None,
    since: SinceOption = None,
    include_misfits: MisfitsOption = False,
    reference_force: ReferenceForceOption = None,
    own_instruments: OwnInstrumentsOption = False,
    change_scale: Annotated[
        float, typer.Option(help="Size of a change (1 sd), in units of a parameter's default prior sd: 2e-5 mm/N of C_XXX.")
    ] = 0.2,
    repeatability: Annotated[
        float,
        typer.Option(help="What a machine itself changes from campaign to campaign (1 sd), same units: 1e-6 mm/N of C_XXX."),
    ] = 0.01,
    probability: Annotated[float, typer.Option(help="Of a change, before the readings.")] = 0.5,
    threshold: Annotated[float, typer.Option(help="Probability above which a change counts as found.")] = 0.95,
    detect: Annotated[float, typer.Option(help="Relative change whose detection is predicted: 0.2 is +20 %.")] = 0.2,
    ci: CiOption = 0.95,
    seed: SeedOption = 1,
) -> None:
    """One machine over time: control chart, probability that a parameter has changed and when, how soon a change is found.

    One lasting step of one parameter is looked for. Exit code 0 whatever is found.
    """
    from ldbb_bayes.fleet.charts import control_chart
    from ldbb_bayes.fleet.dataset import read_batch
    from ldbb_bayes.fleet.statistics import FLEET_COLUMNS
    from ldbb_bayes.fleet.trend import trend as run
    from ldbb_bayes.report.text import parts_of
    from ldbb_bayes.report.wording import with_words

    files = ("trend.json", "trend.csv", *figure_files(["control_chart"]))
    output.check(files)
    rows = read_batch(batches, FLEET_COLUMNS)
    with counting_progress(output.quiet, "further campaigns simulated") as progress:
        result = run(
            rows,
            machine=machine,
            parameters=None if parameters is None else names_in(parameters),
            exclude=exclude or (),
            since=since,
            include_misfits=include_misfits,
            reference_force_N=reference_force,
            one_instrument=not own_instruments,
            change_scale=change_scale,
            repeatability=repeatability,
            probability=probability,
            threshold=threshold,
            detect=detect,
            ci_prob=ci,
            seed=seed,
            progress=progress,
        )
    record = {"schema": 1, **with_words(result)}

    def write(folder: Path) -> None:
        contents = {"trend.json": record, "trend.csv": result.estimates}
        write_files(folder, contents, {"control_chart": partial(control_chart, result)})

    output.deliver(record, files, write, lambda: show(*parts_of(result)))


@command
def population(
    batches: BatchesArgument,
    output: Output,
    parameters: ParametersOption = None,
    exclude: ExcludeOption = None,
    since: SinceOption = None,
    include_misfits: MisfitsOption = False,
    reference_force: ReferenceForceOption = None,
    own_instruments: OwnInstrumentsOption = False,
    spread_scale: Annotated[
        float, typer.Option(help="Prior of a spread: half-normal of this many default prior sd of the parameter.", metavar="X")
    ] = 0.3,
    ci: CiOption = 0.95,
    seed: SeedOption = 1,
) -> None:
    """The population that the machines of a batch come from: mean, spread, the next machine, and machines that do not belong.

    Campaigns of one machine (machine_id in campaign.toml) are taken together; each machine is told what the others say.
    """
    from ldbb_bayes.fleet.charts import machine_chart
    from ldbb_bayes.fleet.dataset import read_batch
    from ldbb_bayes.fleet.population import population as run
    from ldbb_bayes.fleet.statistics import FLEET_COLUMNS
    from ldbb_bayes.report.text import parts_of
    from ldbb_bayes.report.wording import with_words

    files = ("population.json", "machines.csv", *figure_files(["machines"]))
    output.check(files)
    rows = read_batch(batches, FLEET_COLUMNS)
    with counting_progress(output.quiet, "machines left out") as progress:
        result = run(
            rows,
            parameters=None if parameters is None else names_in(parameters),
            exclude=exclude or (),
            since=since,
            include_misfits=include_misfits,
            reference_force_N=reference_force,
            spread_scale=spread_scale,
            one_instrument=not own_instruments,
            ci_prob=ci,
            seed=seed,
            progress=progress,
        )
    record = with_words(result)

    def write(folder: Path) -> None:
        contents = {"population.json": record, "machines.csv": result.machines_table().rename_axis("machine").reset_index()}
        write_files(folder, contents, {"machines": partial(machine_chart, result)})

    output.deliver(record, files, write, lambda: show(*parts_of(result)))


def _batch_parts(done: Batch) -> tuple[Table | str, ...]:
    """How many of what, the first failures and doubts with their reasons, and where the table is."""
    from ldbb_bayes.table import Table

    numbers = (
        ("fitted", done.done),
        ("… not converged: do not use their numbers", done.not_converged),
        ("… with doubts: see their verdict", done.doubtful),
        ("failed", done.failed),
        ("in all", done.campaigns),
    )
    doubts = done.not_converged + done.doubtful
    parts = [*_listed("Failed", [(one.campaign, one.reason) for one in done.failures], done.failed)]
    parts += _listed("To look at", [(one.campaign, one.verdict) for one in done.doubts], doubts)
    if parts:
        parts.append("Each is a row too. What has been mended is done again with --resume --retry.")
    rate = f"{done.fitted} campaigns in {done.seconds:.1f} s: {done.fitted / max(done.seconds, 1e-9):.3g} a second."
    ended = (rate if done.fitted else "Nothing was left to do.", f"Written: {done.dataset}")
    return (Table.of("", ("campaigns", "number"), numbers), *parts, *ended)


def _listed(head: str, entries: Sequence[tuple[str, str]], number: int) -> list[str]:
    """The first campaigns, one a paragraph; what is said of each names it or follows its name."""
    if not entries:
        return []
    lines = [f"  {said if said.startswith(campaign) else f'{campaign}: {said}'}" for campaign, said in entries[:_SHOWN]]
    return [f"{head}:", *lines, *([f"  … and {number - _SHOWN} more."] if number > _SHOWN else [])]
