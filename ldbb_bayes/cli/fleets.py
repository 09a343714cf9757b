"""``ldbb-bayes batch``, ``trend``, ``population``: many campaigns."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import ldbb_bayes as lb
from ldbb_bayes.cli import options
from ldbb_bayes.cli.options import (
    CI,
    EXIT_INTERRUPTED,
    EXIT_MISSED,
    NAMES,
    NEGATED,
    SEED,
    command,
    counting_progress,
    group,
    option,
)

if TYPE_CHECKING:
    from ldbb_bayes.table import Table

__all__ = ["batch", "population", "trend"]

_SHOWN = 10
_BATCH = group(
    sampler=options.SAMPLER,
    ess=options.ESS,
    posteriors=option(bool, "Keep the posterior of every campaign as well (1 MB each).", False),
    no_compare=option(NEGATED, "Do not weigh linear compliance against constant.", False, "compare"),
    resume=option(bool, "Go on with a batch that stopped.", False),
    retry=option(bool, "With --resume: also do again what failed, and campaigns whose files have changed since.", False),
    force=options.FORCE,
    seed=SEED,
    ci=CI,
)


@command
def batch(
    campaigns: Annotated[
        list[str],
        typer.Argument(
            help="Campaign folders, campaign.toml files, tidy CSVs, folders of campaigns, or lists of any of them, one a line: "
            "@FILE or a .txt file.",
            metavar="CAMPAIGNS...",
            show_default=False,
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder for the journal and the table.", metavar="DIR", show_default=False)],
    model: options.ChosenModel,
    table: options.TableFields,
    asked: Annotated[dict[str, Any], _BATCH],
    pool: options.PoolOptions,
    prior_from: options.PriorFromOption = None,
    as_json: options.JsonOption = False,
    quiet: options.QuietOption = False,
) -> None:
    """Fit many campaigns, each by itself: one table with a row per campaign (Parquet), which lb.read_batch reads.

    A campaign that cannot be fitted is a row that says why. Whatever stops a batch, the same command with --resume goes on to the
    very same table. Exit code 0 also when campaigns failed, 1 when one missed its sampling target. The options for tidy CSVs
    apply to those among the campaigns.
    """
    from ldbb_bayes.fleet.row import JOURNAL
    from ldbb_bayes.jobs import executor_named

    if asked["resume"] and not (out / JOURNAL).exists():
        typer.echo(f"{out} holds no unfinished batch: this one begins anew.", err=True)
    asked["prior_from"] = None if prior_from is None else lb.prior_from(prior_from)
    try:
        with counting_progress(quiet, "campaigns") as progress:
            executor = partial(executor_named, **pool)
            done = lb.batch(campaigns, out, model=model, executor=executor, table=table, **asked, progress=progress)
    except KeyboardInterrupt:
        if not (out / JOURNAL).exists():
            raise
        options.fail(f"interrupted; {out} keeps what is done. The same command with --resume goes on with it.", EXIT_INTERRUPTED)
    for path in done.repeated[:_SHOWN]:
        typer.echo(f"{path} was given more than once: kept once.", err=True)
    if len(done.repeated) > _SHOWN:
        typer.echo(f"… and {len(done.repeated) - _SHOWN} more.", err=True)
    options.Output(as_json=as_json).deliver({"schema": 1, **lb.with_words(done)}, _batch_parts(done))
    if done.not_converged:
        raise typer.Exit(EXIT_MISSED)


def _batch_parts(done: lb.Batch) -> tuple[Table | str, ...]:
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


BatchesArgument = Annotated[list[Path], typer.Argument(help="Folders that ldbb-bayes batch wrote.", metavar="BATCH...")]
_ROWS = {
    "parameters": option(
        NAMES,
        "Comma-separated compliances and geometric errors. Default: all constant compliances. Ball form and bar length are taken "
        "anew in each campaign: what is said of differences of geometric errors is conservative, of their levels not.",
    ),
    "exclude": option(
        list[str], "Campaign (path, last part of it, or name) or machine to leave out; may be repeated.", metavar="NAME"
    ),
    "since": option(str, "Leave out campaigns before this date (ISO 8601).", metavar="DATE"),
    "include_misfits": option(bool, "Keep campaigns whose readings the model does not expect; else they are left out.", False),
    "reference_force": option(
        float, "Force at which compliances are meant (N). Default: the campaigns' median.", to="reference_force_N", metavar="F"
    ),
    "own_instruments": option(NEGATED, "Every campaign had a bar, a mount and a regulator of its own.", False, "one_instrument"),
}
_TREND = group(
    machine=option(str, "Whose campaigns; needed where they are of several machines.", metavar="ID"),
    **_ROWS,
    change_scale=option(float, "Size of a change (1 sd), in units of a parameter's default prior sd: 2e-5 mm/N of C_XXX.", 0.2),
    repeatability=option(
        float, "What a machine itself changes from campaign to campaign (1 sd), same units: 1e-6 mm/N of C_XXX.", 0.01
    ),
    probability=option(float, "Of a change, before the readings.", 0.5),
    threshold=option(float, "Probability above which a change counts as found.", 0.95),
    detect=option(float, "Relative change whose detection is predicted: 0.2 is +20 %.", 0.2),
    ci=CI,
    seed=SEED,
)


@command
def trend(batches: BatchesArgument, output: options.OutputOptions, asked: Annotated[dict[str, Any], _TREND]) -> None:
    """One machine over time: control chart, probability that a parameter has changed and when, how soon a change is found.

    One lasting step of one parameter is looked for. Exit code 0 whatever is found.
    """
    from ldbb_bayes.fleet.row import read_batch
    from ldbb_bayes.fleet.statistics import FLEET_COLUMNS

    output.check("trend.json", "trend.csv", figures=["control_chart"])
    rows = read_batch(batches, FLEET_COLUMNS)
    with counting_progress(output.quiet, "further campaigns simulated") as progress:
        result = lb.trend(rows, **asked, progress=progress)
    record = {"schema": 1, **lb.with_words(result)}
    contents = {"trend.json": record, "trend.csv": result.estimates}
    output.deliver(record, result, contents, {"control_chart": partial(lb.control_chart, result)})


_SPREAD = "Prior of a spread: half-normal of this many default prior sd of the parameter."
_POPULATION = group(**_ROWS, spread_scale=option(float, _SPREAD, 0.3, metavar="X"), ci=CI, seed=SEED)


@command
def population(batches: BatchesArgument, output: options.OutputOptions, asked: Annotated[dict[str, Any], _POPULATION]) -> None:
    """The population that the machines of a batch come from: mean, spread, the next machine, and machines that do not belong.

    Campaigns of one machine (machine_id in campaign.toml) are taken together; each machine is told what the others say.
    """
    from ldbb_bayes.fleet.row import read_batch
    from ldbb_bayes.fleet.statistics import FLEET_COLUMNS

    output.check("population.json", "machines.csv", figures=["machines"])
    rows = read_batch(batches, FLEET_COLUMNS)
    with counting_progress(output.quiet, "machines left out") as progress:
        result = lb.population(rows, **asked, progress=progress)
    record = lb.with_words(result)
    contents = {"population.json": record, "machines.csv": result.machines_table().rename_axis("machine").reset_index()}
    output.deliver(record, result, contents, {"machines": partial(lb.machine_chart, result)})
