"""Command ``next`` of ``ldbb-bayes``: the next circle of a campaign, and whether to stop."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Any

import typer

import ldbb_bayes as lb
from ldbb_bayes.campaign.folder import pilot_of_plan, write_campaign_into
from ldbb_bayes.cli import arguments
from ldbb_bayes.cli.campaign_notes import assumptions_of, notes_on_campaign
from ldbb_bayes.cli.operator_sheets import SHEET, language_in, sheet_of_circle
from ldbb_bayes.cli.options import EXIT_MISSED, Kind, command, group, options_of
from ldbb_bayes.cli.ranges import read_clockings, read_force_levels, read_radii
from ldbb_bayes.cli.values import directions_in

__all__ = ["next_"]

# Options of the command ``next``, such as --radii, whose values become arguments of `next_circle`.
_OPTIONS = group(
    **options_of(
        "next",
        force_levels=Kind(str, read_force_levels),
        radii=Kind(str, read_radii),
        clockings=Kind(str, read_clockings),
        directions=Kind(str, directions_in),
    )
)


@command
def next_(
    source: arguments.MeasuredReadings,
    model: arguments.ChosenModel,
    output: arguments.OutputOptions,
    settings: Annotated[dict[str, Any], _OPTIONS],
) -> None:
    """Say which circle to run next, how likely it is that the goals are met, and when to stop.

    Run the command after each circle, with the readings of all circles so far. With --out the next
    circle is written as a plan, with a sheet for the operator. The evidence and the intervals
    remain valid however often the command is run.

    The exit code is 1 if circles of the kinds allowed are not expected to reach every aim.
    """
    # The module that writes the texts of this command takes a long time to load. It is therefore
    # imported here, and not at the top of the file.
    from ldbb_bayes.report import next_circle_text

    language = language_in(settings)
    # Before anything is computed, refuse an output folder with files that this command did not
    # write. The command writes the files named here, and a copy of the campaign from which the plan
    # was computed (the pilot of the plan). These files may be replaced.
    output.check("campaign.toml", "next.json", SHEET, *pilot_of_plan(output.out))
    step = lb.analysis.next_circle(model, source.campaign, **settings)
    record = {
        "schema": 1,
        "campaign": source.campaign.name,
        "seed": settings["seed"],
        **step.as_dict(),
    }
    contents = {}
    write_more = None
    circle = "one more circle, if it is run all the same" if step.finished else "one circle"
    if output.out is not None:
        plan = step.plan()
        contents = {
            "next.json": record,
            SHEET: sheet_of_circle(step, plan, language),
        }
        write_more = partial(write_campaign_into, plan)
    output.deliver(
        record,
        (
            *assumptions_of(source),
            *next_circle_text.parts_of(step),
            *notes_on_campaign(source.campaign),
        ),
        contents,
        write_more=write_more,
        note=f", a plan of {circle}; {SHEET} is for the operator",
    )
    if not step.finished and step.more_circles is None:
        raise typer.Exit(EXIT_MISSED)
