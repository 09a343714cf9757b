"""``ldbb-bayes check``: look at a campaign before fitting it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from ldbb_bayes.cli.options import (
    JsonOption,
    of_campaign,
)

if TYPE_CHECKING:
    from ldbb_bayes.campaign.campaign import Campaign

__all__ = ["check"]


@of_campaign
def check(
    readings: Campaign,
    sketch: Annotated[bool, typer.Option(help="Draw the circles in the terminal.")] = True,
    as_json: JsonOption = False,
) -> None:
    """Preview a campaign: per test what is there and what looks odd, and what a fit will assume. Fits nothing."""
    from ldbb_bayes.analysis.preview import preview
    from ldbb_bayes.cli.show import print_json, reading_console
    from ldbb_bayes.report.sketch import MOST_SKETCHES, polar_sketches
    from ldbb_bayes.report.text import preview_lines, preview_table

    seen = preview(readings)
    if as_json:
        print_json(seen.as_dict())
        return
    console = reading_console()
    console.print(preview_table(seen))
    if sketch and not seen.is_plan and console.encoding.lower().startswith("utf"):
        console.print()
        for line in polar_sketches(readings.tests[:MOST_SKETCHES], width=console.width):
            console.print(line, markup=False, highlight=False)
    for line in preview_lines(seen):
        console.print(line, markup=False)
