"""``ldbb-bayes identify``: what the data can tell apart, and what they cannot. A plan will do."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ldbb_bayes.cli.machine import ATLAS_FILES
from ldbb_bayes.cli.options import (
    DegreeOption,
    DriftOption,
    ForceOption,
    JsonOption,
    ModelOption,
    OutOption,
    PresetOption,
    QuietOption,
    WithoutOption,
    model_from,
    of_campaign,
)

if TYPE_CHECKING:
    from ldbb_bayes.campaign.campaign import Campaign

__all__ = ["identify"]

_FIGURES = ("correlation", "prior_and_posterior", "alias", "nuisance_costs")
IDENTIFY_FILES = (
    "identify.json",
    "parameters.csv",
    "alias.csv",
    "correlation.csv",
    *(f"{name}.{kind}" for name in _FIGURES for kind in ("png", "svg")),
    *ATLAS_FILES,
)


@of_campaign
def identify(
    tests: Campaign,
    degree: DegreeOption = None,
    preset: PresetOption = None,
    without: WithoutOption = "",
    drift: DriftOption = None,
    model: ModelOption = None,
    out: OutOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """What the data can tell apart: verdict and confounding of every parameter, degeneracies and their cures.

    A plan (a campaign without readings) will do: ask before the experiment.
    """
    from ldbb_bayes.analysis.identifiability import identify as run
    from ldbb_bayes.cli.show import print_json, reading_console, write_identifiability
    from ldbb_bayes.files import check_target, staged_folder
    from ldbb_bayes.report.text import identifiability_lines, identifiability_table

    chosen = model_from(degree, preset, without, model, drift)
    if out is not None:
        check_target(out, force=force, ours=IDENTIFY_FILES)
    result = run(chosen, tests)
    record = {"schema": 1, "campaign": tests.name, "degree": chosen.degree, **result.as_dict()}
    if out is not None:
        with staged_folder(out, force=force, ours=IDENTIFY_FILES) as staging:
            write_identifiability(result, record, tests, staging)
    if as_json:
        print_json(record)
        return
    console = reading_console()
    console.print(f"Compliance {('constant', 'linear', 'quadratic')[chosen.degree]} in force.")
    console.print(identifiability_table(result))
    console.print()
    for line in identifiability_lines(result):
        console.print(line, markup=False)
    if out is not None and not quiet:
        console.print(f"Written: {out}/identify.json, tables (CSV) and figures (PNG and SVG)", markup=False)
