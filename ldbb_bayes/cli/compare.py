"""``ldbb-bayes compare``: constant or linear compliance, how sure, and what that hangs on."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ldbb_bayes.cli.options import (
    CiOption,
    DegreeOption,
    DriftOption,
    ForceOption,
    JsonOption,
    ModelOption,
    OutOption,
    PresetOption,
    QuietOption,
    SeedOption,
    WithoutOption,
    model_from,
    of_campaign,
)
from ldbb_bayes.errors import InputError

if TYPE_CHECKING:
    from ldbb_bayes.campaign.campaign import Campaign

__all__ = ["COMPARE_FILES", "compare"]

_NAMES = ("constant", "linear", "quadratic")
_FIGURES = ("evidence", "compliance_with_local_fits", "geometry_with_local_fits", "predictive_p_values")
COMPARE_FILES = (
    "comparison.json",
    "sensitivity.csv",
    "slope_subsets.csv",
    "tests.csv",
    "local_fits.csv",
    *(f"{name}.{kind}" for name in _FIGURES for kind in ("png", "svg")),
)


@of_campaign
def compare(
    tests: Campaign,
    degree: DegreeOption = None,
    preset: PresetOption = None,
    without: WithoutOption = "",
    drift: DriftOption = None,
    model: ModelOption = None,
    also: Annotated[
        list[str] | None, typer.Option(help="Another model to compare, as NAME=FILE.toml; can be repeated.", metavar="NAME=FILE")
    ] = None,
    quadratic: Annotated[
        bool, typer.Option("--quadratic", help="Choose constant, linear or quadratic for every compliance apart (minutes).")
    ] = False,
    leave_out: Annotated[str, typer.Option(help="What leave-one-out leaves out: test. Readings are refused.")] = "test",
    tolerance: Annotated[float, typer.Option(help="Error asked of every log evidence (nat).")] = 1e-2,
    ci: CiOption = 0.95,
    out: OutOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
    seed: SeedOption = 1,
    quiet: QuietOption = False,
) -> None:
    """Constant or linear compliance? Evidence, its sensitivity, leave-one-force-out, which slopes, which tests do not belong.

    Compares constant with linear compliance; with --degree 2 also quadratic. Exit code 1: an evidence is less exact than asked.
    """
    from ldbb_bayes.analysis.comparison import compare as run
    from ldbb_bayes.cli.show import counting_progress, print_comparison, print_json, write_comparison
    from ldbb_bayes.files import check_target, staged_folder
    from ldbb_bayes.model.spec import read_model

    largest = model_from(degree, preset, without, model, drift)
    if largest.degree == 0:
        raise InputError(
            "compare must have a degree of at least 1, got 0: there is nothing to compare with. Use --degree 1 or 2."
        )
    models = {_NAMES[k]: largest.with_degree(k) for k in range(largest.degree + 1)}
    for name, file in (_named_file(entry) for entry in also or ()):
        if name in models:
            raise InputError(f"--also must give a new name, got {name!r} again. Choose another.")
        models[name] = read_model(file, degree=largest.degree)
    if out is not None:
        check_target(out, force=force, ours=COMPARE_FILES)
    with counting_progress(quiet, "models weighed") as progress:
        result = run(
            models,
            tests,
            quadratic=quadratic,
            leave_out=leave_out,  # type: ignore[arg-type]
            tolerance=tolerance,
            ci_prob=ci,
            seed=seed,
            progress=progress,
        )
    record = {"schema": 1, "campaign": {"name": tests.name, "sha256": tests.sha256}, "seed": seed, **result.as_dict()}
    if out is not None:
        with staged_folder(out, force=force, ours=COMPARE_FILES) as staging:
            write_comparison(result, record, staging)
    if as_json:
        print_json(record)
    else:
        print_comparison(result)
        if out is not None and not quiet:
            typer.echo(f"Written: {out}/comparison.json, tables (CSV) and figures (PNG and SVG)")
    if not result.within_tolerance:
        raise typer.Exit(1)


def _named_file(entry: str) -> tuple[str, Path]:
    name, sign, file = entry.partition("=")
    if not (name and sign and file):
        raise InputError(f"--also must be NAME=FILE.toml, got {entry!r}. For example --also mine=model.toml.")
    return name, Path(file)
