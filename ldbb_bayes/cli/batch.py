"""``ldbb-bayes batch``: many campaigns → one table."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ldbb_bayes.cli.options import (
    EXIT_INTERRUPTED,
    CiOption,
    DegreeOption,
    DriftOption,
    ExecutorOption,
    ForceOffsetOption,
    ForceOption,
    ForceSlopeOption,
    JsonOption,
    ModelOption,
    MountOption,
    PlaneOption,
    PresetOption,
    PriorFromOption,
    QuietOption,
    RadiusOption,
    RawOption,
    ResolutionOption,
    SchedulerOption,
    SeedOption,
    TopologyOption,
    WithoutOption,
    WorkersOption,
    campaign_fields,
    fail,
    guarded,
    model_from,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from ldbb_bayes.fleet.batch import Batch

__all__ = ["batch"]

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


@guarded
def batch(
    campaigns: CampaignsArgument,
    out: Annotated[Path, typer.Option(help="Folder for the journal and the table.", metavar="DIR", show_default=False)],
    degree: DegreeOption = None,
    preset: PresetOption = None,
    without: WithoutOption = "",
    drift: DriftOption = None,
    model: ModelOption = None,
    prior_from: PriorFromOption = None,
    sampler: str = typer.Option("quadrature", help="quadrature, joint or collapsed."),
    ess: float = typer.Option(1000.0, help="Bulk and tail effective sample size every parameter must reach.", min=100.0),
    executor: ExecutorOption = "process",
    scheduler: SchedulerOption = None,
    workers: WorkersOption = 0,
    posteriors: bool = typer.Option(False, "--posteriors", help="Keep the posterior of every campaign as well (1 MB each)."),
    no_compare: bool = typer.Option(False, "--no-compare", help="Do not weigh linear compliance against constant."),
    resume: bool = typer.Option(False, "--resume", help="Go on with a batch that stopped."),
    retry: bool = typer.Option(
        False, "--retry", help="With --resume: also do again what failed, and campaigns whose files have changed since."
    ),
    force: ForceOption = False,
    as_json: JsonOption = False,
    seed: SeedOption = 1,
    ci: CiOption = 0.95,
    quiet: QuietOption = False,
    topology: TopologyOption = None,
    plane: PlaneOption = None,
    radius_mm: RadiusOption = None,
    resolution_um: ResolutionOption = None,
    raw: RawOption = False,
    mount_um_per_bar: MountOption = None,
    force_slope: ForceSlopeOption = None,
    force_offset: ForceOffsetOption = None,
) -> None:
    """Fit many campaigns, each by itself: one table with a row per campaign (Parquet), which lb.read_batch reads.

    A campaign that cannot be fitted is a row that says why. Whatever stops a batch, the same command with --resume goes on to the
    very same table. Exit code 0 also when campaigns failed, 1 when one missed its sampling target. The options for tidy CSVs
    apply to those among the campaigns.
    """
    from ldbb_bayes.cli.show import failing_progress, print_json
    from ldbb_bayes.fleet.batch import batch as run
    from ldbb_bayes.fleet.begun import RECORD
    from ldbb_bayes.fleet.executors import check_executor, executor_named
    from ldbb_bayes.model.population_prior import prior_from as read_prior

    chosen = model_from(degree, preset, without, model, drift)
    fields: dict[str, Any] = {"topology": topology, "plane": plane, "radius_mm": radius_mm, "resolution_um": resolution_um}
    table = campaign_fields(
        raw=raw, mount_um_per_bar=mount_um_per_bar, force_slope=force_slope, force_offset=force_offset, **fields
    )
    check_executor(executor, workers, scheduler)
    if resume and not (out / RECORD).exists():
        typer.echo(f"{out} holds no unfinished batch: this one begins anew.", err=True)
    try:
        with failing_progress(quiet, "campaigns") as progress:
            done = run(
                campaigns,
                out,
                model=chosen,
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
        if not (out / RECORD).exists():
            raise
        fail(f"interrupted; {out} keeps what is done. The same command with --resume goes on with it.", EXIT_INTERRUPTED)
    for path in done.repeated[:_SHOWN]:
        typer.echo(f"{path} was given more than once: kept once.", err=True)
    if len(done.repeated) > _SHOWN:
        typer.echo(f"… and {len(done.repeated) - _SHOWN} more.", err=True)
    if done.damaged:
        typer.echo(
            f"{done.damaged} lines of the journal were damaged. What they held, and what had failed before, is done again: "
            f"{done.fitted} campaigns by this run.",
            err=True,
        )
    if as_json:
        print_json(done.as_dict())
    else:
        _print(done)
    if done.not_converged:
        raise typer.Exit(1)


def _print(done: Batch) -> None:
    """How many of what, the first failures and doubts with their reasons, and where the table is."""
    from rich.table import Table

    from ldbb_bayes.cli.show import reading_console

    console = reading_console()
    table = Table("campaigns", "number")
    for what, number in (
        ("fitted", done.done),
        ("… not converged: do not use their numbers", done.not_converged),
        ("… with doubts: see their verdict", done.doubtful),
        ("failed", done.failed),
        ("in all", done.campaigns),
    ):
        table.add_row(what, f"{number}")
    console.print(table)
    if done.failures:
        _list(console, "Failed", done.failures, done.failed)
    if done.doubts:
        _list(console, "To look at", done.doubts, done.not_converged + done.doubtful)
    if done.failures or done.doubts:
        console.print("Each is a row too. What has been mended is done again with --resume --retry.", markup=False)
    if done.fitted:
        rate = done.fitted / max(done.seconds, 1e-9)
        console.print(f"{done.fitted} campaigns in {done.seconds:.1f} s: {rate:.3g} a second.", markup=False)
    else:
        console.print("Nothing was left to do.", markup=False)
    console.print(f"Written: {done.dataset}", markup=False, soft_wrap=True)


def _list(console: Console, head: str, entries: Sequence[tuple[str, str]], number: int) -> None:
    """The first campaigns, one a paragraph; what is said of each names it or follows its name."""
    console.print(f"{head}:", markup=False)
    for campaign, said in entries[:_SHOWN]:
        console.print(
            f"  {said if said.startswith(campaign) else f'{campaign}: {said}'}", markup=False, highlight=False, soft_wrap=True
        )
    if number > _SHOWN:
        console.print(f"  … and {number - _SHOWN} more.", markup=False)
