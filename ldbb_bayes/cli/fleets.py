"""Commands ``batch``, ``trend`` and ``population`` of ``ldbb-bayes``.

The command ``batch`` fits many campaigns. The other two commands evaluate the results of many
campaigns: ``trend`` follows one machine over time, and ``population`` compares machines.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

import ldbb_bayes as lb
from ldbb_bayes.campaign.folder import TOML_NAME
from ldbb_bayes.cli import arguments
from ldbb_bayes.cli.options import (
    EXIT_INTERRUPTED,
    EXIT_MISSED,
    REQUIRED,
    command,
    fail,
    group,
    option,
    options_of,
)
from ldbb_bayes.cli.output import Output
from ldbb_bayes.cli.progress import counting_progress
from ldbb_bayes.fleet.dataset import JOURNAL, read_fleet
from ldbb_bayes.parallel import executor_named
from ldbb_bayes.report.wording.effect_names import first_names
from ldbb_bayes.results import Table
from ldbb_bayes.units import counted

__all__ = ["batch", "population", "trend"]

# The command ``batch`` lists at most this number of campaigns that could not be fitted, and at most
# this number of campaigns whose fit is doubtful.
_LISTED = 10

_CAMPAIGNS_HELP = (
    "Campaign folders, campaign.toml files, tidy CSVs, folders of campaigns, or lists of any of"
    " them, one a line: @FILE or a .txt file."
)
_BatchesArgument = Annotated[
    list[Path], typer.Argument(help="Folders that ldbb-bayes batch wrote.", metavar="BATCH...")
]


@command
def batch(
    campaigns: Annotated[
        list[str], typer.Argument(help=_CAMPAIGNS_HELP, metavar="CAMPAIGNS...", show_default=False)
    ],
    out: Annotated[
        Path, option(Path, "Folder for the journal and the table.", REQUIRED, metavar="DIR")
    ],
    model: arguments.ChosenModel,
    table: arguments.TableFields,
    certificates: arguments.Certificates,
    tolerances: arguments.Tolerances,
    settings: Annotated[dict[str, Any], group(**options_of("batch"))],
    pool: arguments.PoolOptions,
    as_json: Annotated[bool, arguments.JSON],
    quiet: Annotated[bool, arguments.QUIET],
) -> None:
    """Fit many campaigns separately, and write a table (CSV and Parquet) with one row per campaign.

    The Python function lb.fleet.read_batch reads the table. If a campaign cannot be fitted, its row
    states the reason. If the command is stopped, the same command with --resume continues the fits
    and gives the same table. Options for tidy CSVs apply only to campaigns that are stored as tidy
    CSVs.

    The exit code is 1 if the random draws of a fit did not reach the effective sample size that
    --ess requires. Campaigns that cannot be fitted do not change the exit code.
    """
    if settings["resume"] and not (out / JOURNAL).exists():
        typer.echo(f"{out} holds no unfinished batch: this one begins anew.", err=True)
    try:
        with counting_progress(quiet, "campaigns") as progress:
            result = lb.fleet.run_batch(
                campaigns,
                out,
                executor=partial(executor_named, **pool),
                model=model,
                table=table,
                certificates=certificates,
                tolerances=tolerances,
                **settings,
                progress=progress,
            )
    except KeyboardInterrupt:
        if not (out / JOURNAL).exists():
            raise
        fail(
            f"interrupted; {out} keeps what is done. The same command with --resume goes on"
            " with it.",
            EXIT_INTERRUPTED,
        )
    Output(as_json=as_json).deliver(
        {"schema": 1, **lb.report.with_words(result)}, _batch_parts(result)
    )
    if result.not_converged:
        raise typer.Exit(EXIT_MISSED)


def _batch_parts(result: lb.fleet.Batch) -> tuple[Table | str, ...]:
    """Return the table and sentences to print about a batch of fits.

    The table states how many campaigns were fitted and how many failed. The sentences name at most
    ten failed and ten doubtful campaigns, each with the reason. They also state the time that the
    fits took, the file with the results, and what was passed over in folders of campaigns.
    """
    counts = (
        ("fitted", result.done),
        ("… not converged: do not use their numbers", result.not_converged),
        ("… with doubts: see their verdict", result.doubtful),
        ("failed", result.failures),
        ("in all", result.campaigns),
    )
    remarks: list[str] = []
    to_look_at = (*result.doubts, *result.odd_readings)
    for heading, entries in (("Failed", result.failed), ("To look at", to_look_at)):
        if entries:
            remarks.append(f"{heading}:")
        for entry in entries[:_LISTED]:
            campaign, reason = entry.values()
            remarks.append(f"  {campaign}: {reason}")
    if result.failed:
        remarks.append(
            "Each is a row too. A failed one that has been mended is done again with --resume"
            " --retry."
        )
    if to_look_at:
        remarks.append(
            "One to look at is not done again when it has been mended: begin the batch anew"
            " (--force)."
        )
    ending = "Nothing was left to do."
    if result.fitted:
        per_second = result.fitted / max(result.seconds, 1e-9)
        fitted = counted(result.fitted, "campaign")
        ending = f"{fitted} in {result.seconds:.1f} s: {per_second:.3g} a second."
    table = Table.of("", ("campaigns", "number"), counts)
    if result.passed_over:
        remarks.append(
            f"Passed over, for no {TOML_NAME} is in them ({len(result.passed_over)}):"
            f" {first_names(result.passed_over)}. Make campaigns of tables with ldbb-bayes"
            " import; name tidy CSVs and folders of folders themselves."
        )
    return (table, *remarks, ending, f"Written: {result.dataset}, {result.spreadsheet}")


@command
def trend(
    batches: _BatchesArgument,
    output: arguments.OutputOptions,
    tolerances: arguments.FollowedTolerances,
    settings: Annotated[dict[str, Any], group(**options_of("whose", "rows", "trend"))],
) -> None:
    """Follow one machine over time: control chart, and the probability that a parameter changed.

    The command says which parameter changed, when and by how much. It looks for a single lasting
    step of one parameter. The exit code is 0 whether or not a change is found.
    """
    output.check("trend.json", "trend.csv", figures=["control_chart"])
    rows = read_fleet(batches)
    result = lb.fleet.find_trend(rows, tolerances=tolerances, **settings)
    record = {"schema": 1, **lb.report.with_words(result)}
    output.deliver(
        record,
        result,
        {"trend.json": record, "trend.csv": result.estimates},
        {"control_chart": partial(lb.fleet.draw_control_chart, result)},
    )


@command
def population(
    batches: _BatchesArgument,
    output: arguments.OutputOptions,
    settings: Annotated[dict[str, Any], group(**options_of("rows", "population"))],
) -> None:
    """Estimate how much machines of a population differ, and predict the next machine.

    The machines are those of the campaigns in one or more batches. Campaigns of the same machine
    (machine_id in campaign.toml) are taken together. For each parameter, the mean of all machines
    and their standard deviation are estimated. Each machine is compared with the others, and
    machines that do not belong to the population are named.
    """
    output.check("population.json", "machines.csv")
    rows = read_fleet(batches)
    with counting_progress(output.quiet, "machines left out") as progress:
        result = lb.fleet.fit_population(rows, **settings, progress=progress)
    record = lb.report.with_words(result)
    contents = {
        "population.json": record,
        "machines.csv": result.machines_table().rename_axis("machine").reset_index(),
    }
    output.deliver(record, result, contents)
