"""``ldbb-bayes simulate``: a campaign from truths or from a plan."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ldbb_bayes.cli.options import (
    DegreeOption,
    DriftOption,
    ForceOption,
    JsonOption,
    ModelOption,
    PresetOption,
    SeedOption,
    WithoutOption,
    campaign_from,
    guarded,
    model_from,
)

__all__ = ["simulate"]


@guarded
def simulate(
    source: Annotated[Path, typer.Argument(help="A TOML of truths (forces_N, parameters, hyper_um), or a plan or campaign.")],
    out: Annotated[Path, typer.Option(help="Campaign folder to write.", metavar="DIR")],
    truth: Annotated[Path | None, typer.Option(help="Truths for a plan, as TOML.", metavar="FILE.toml")] = None,
    degree: DegreeOption = None,
    preset: PresetOption = None,
    without: WithoutOption = "",
    drift: DriftOption = None,
    model: ModelOption = None,
    force: ForceOption = False,
    seed: SeedOption = 1,
    as_json: JsonOption = False,
) -> None:
    """Write a campaign with simulated readings, and truth.json beside it.

    What the truths leave out is drawn from the priors.
    """
    from ldbb_bayes.campaign.folder import TRUTH_NAME, files_of, write_campaign_into
    from ldbb_bayes.cli.show import print_json
    from ldbb_bayes.errors import InputError
    from ldbb_bayes.files import staged_folder
    from ldbb_bayes.model.truths import Truths, is_truths, read_truths
    from ldbb_bayes.report.plain import json_text

    chosen = model_from(degree, preset, without, model, drift)
    if is_truths(source):
        if truth is not None:
            raise InputError(
                f"truths must come from one file, got {source} and {truth}. Give a plan as first argument, or drop --truth."
            )
        truths = read_truths(source)
        if truths.plan is None:
            raise InputError(
                f"{source}: 'forces_N' must be given, got nothing. List the forces, or give a plan as first argument."
            )
        plan = truths.plan
    else:
        plan = campaign_from(source)
        truths = Truths(None, None, {}, False) if truth is None else read_truths(truth)
        if truths.plan is not None:
            raise InputError(f"{truth}: 'forces_N' must stand in truths given alone, got it beside {source}. Remove one of them.")
    made = chosen.simulate(plan, seed=seed, parameters=truths.parameters, hyper_um=truths.hyper_um, exact=truths.exact)
    record = {"schema": 1, "seed": seed, "sha256": made.campaign.sha256, "parameters": made.parameters, "hyper_um": made.hyper_um}
    with staged_folder(out, force=force, ours=files_of(out)) as staging:
        write_campaign_into(made.campaign, staging)
        (staging / TRUTH_NAME).write_text(json_text(record), encoding="utf-8")
    if as_json:
        print_json(record)
    else:
        tests, readings = len(made.campaign.tests), made.campaign.readings
        typer.echo(f"Written: {out} ({tests} tests, {readings} readings), the truth in {out}/truth.json")
