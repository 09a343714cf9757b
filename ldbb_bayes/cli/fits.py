"""``ldbb-bayes demo``, ``fit``, ``summarize``, ``report``: readings → credible intervals → a page."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import ldbb_bayes as lb
from ldbb_bayes.cli import options
from ldbb_bayes.cli.options import CI, SEED, Output, command, counting_progress, group, option, sampling_progress
from ldbb_bayes.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["demo", "figure_names", "fit", "report", "summarize", "write_result"]

RESULT_FILES = ("posterior.nc", "summary.json", "model.toml", "report.html", "report.json", "tables")


_FIT = group(
    sampler=option(str, "joint (emcee over everything) or independent (exact draws from weighted nodes).", "joint"),
    ess=options.ESS,
    max_steps=option(int, "Steps of each ensemble at which sampling gives up.", 20_000, min=200),
    seed=SEED,
    ci=CI,
)


@command
def fit(
    campaign: options.GivenCampaign,
    model: options.ChosenModel,
    output: options.OutputOptions,
    asked: Annotated[dict[str, Any], _FIT],
    prior_from: options.PriorFromOption = None,
) -> None:
    """Credible intervals on compliances, force slopes and geometric errors. Exit code 1 when the sampler missed its target."""
    from ldbb_bayes.inference.posterior import check_probability
    from ldbb_bayes.report.findings import full_result

    check_probability(asked["ci_prob"])
    chosen, population = _with_population(model, prior_from, campaign)
    output.check(*RESULT_FILES)
    rule = lb.StoppingRule(ess=asked["ess"], max_steps=asked["max_steps"])
    with sampling_progress(output.quiet, "sampling") as progress:
        posterior = lb.sample(chosen, campaign, sampler=asked["sampler"], seed=asked["seed"], rule=rule, progress=progress)
    result = full_result(posterior, asked["ci_prob"]) | population
    written = f"{output.out}/posterior.nc, summary.json, model.toml"
    output.deliver(result, _parts_of_fit(result), also=partial(write_result, posterior, result), written=written)
    if not result["sampler"]["converged"]:
        raise typer.Exit(options.EXIT_MISSED)


def _with_population(model: lb.HybridModel, path: Path | None, campaign: lb.Campaign) -> tuple[lb.HybridModel, dict[str, Any]]:
    """The model with the prior that --prior-from names, and what a result says of it; its doubts go to stderr."""
    if path is None:
        return model, {}
    prior = lb.prior_from(path)
    doubts = prior.doubts(campaign)
    for doubt in doubts:
        typer.echo(f"--prior-from: {doubt}", err=True)
    said = {"path": str(path), "machines": prior.machines, "campaigns": prior.campaigns}
    return prior.model(model), {"prior_from": said | {"sha256": prior.sha256, "doubts": list(doubts)}}


@command
def summarize(
    result: Annotated[Path, typer.Argument(help="The --out folder of a fit, or its posterior.nc.", metavar="RESULT")],
    as_json: options.JsonOption = False,
    ci: options.CiOption = 0.95,
) -> None:
    """Table or JSON of a stored posterior, with intervals of any probability."""
    from ldbb_bayes.report.findings import full_result

    numbers = full_result(lb.load(result), ci)
    Output(as_json=as_json).deliver(numbers, _parts_of_fit(numbers))


def write_result(posterior: xr.DataTree, result: Mapping[str, Any], folder: Path) -> None:
    """posterior.nc, summary.json and model.toml of a fit, into a folder that is made."""
    from ldbb_bayes.inference.posterior import record_of

    folder.mkdir(exist_ok=True)
    lb.save(posterior, folder / "posterior.nc")
    options.write_files(folder, {"summary.json": result, "model.toml": record_of(posterior)["model"]["toml"]})


def _parts_of_fit(result: Mapping[str, Any]) -> tuple[Any, ...]:
    from ldbb_bayes.report.text import parts_of_fit

    own = result.get("prior_from")
    said = own and f"population of {own['machines']} machines, {own['campaigns']} campaigns ({own['path']})"
    return (*parts_of_fit(result), *([f"Prior of the compliances: {said}."] if own else []))


_FORMATS = ("svg", "png", "pdf")


@command
def report(
    result: Annotated[
        list[Path], typer.Argument(help="The --out folder of a fit; more of them are set beside the first.", metavar="RESULT...")
    ],
    out: Annotated[Path | None, typer.Option(help="Folder to write to. Default: RESULT.", metavar="DIR")] = None,
    force: options.ForceOption = False,
    comparison: Annotated[
        Path | None, typer.Option(help="The --out folder of an earlier compare of the same readings.", metavar="DIR")
    ] = None,
    design: Annotated[
        Path | None, typer.Option(help="The --out folder of an earlier design after the same readings.", metavar="DIR")
    ] = None,
    tests: Annotated[int | None, typer.Option(help="Circles to recommend. Default: as many as were run.", min=1, max=300)] = None,
    same_instrument: Annotated[
        bool, typer.Option("--same-instrument", help="Campaigns beside one another share bar, balls, mount and force device.")
    ] = False,
    figures: Annotated[
        Path | None,
        typer.Option(help="Folder for the figures of the page and the analyses' others, as SVG, PNG and PDF.", metavar="DIR"),
    ] = None,
    as_json: options.JsonOption = False,
    ci: options.CiOption = 0.95,
    quiet: options.QuietOption = False,
) -> None:
    """One self-contained page: results, what the data cannot tell, budgets, circular-test quantities, next tests.

    Writes report.html, report.json and tables (CSV) into RESULT, working out what the fit did not keep. Exit code 1
    when the fit had missed its target; the page then says so at its top.
    """
    from ldbb_bayes.files import check_target, staged_folder
    from ldbb_bayes.inference.posterior import check_probability, record_of
    from ldbb_bayes.jobs import process_executor
    from ldbb_bayes.report.findings import compare_for_report, sizes_of
    from ldbb_bayes.report.page import REPORT_FILES
    from ldbb_bayes.units import units_for

    check_probability(ci)
    folder = out or (result[0] if result[0].is_dir() else result[0].parent)
    there = next((name for name in REPORT_FILES if (folder / name).exists()), None)
    if there is not None and not force:
        raise InputError(f"{folder / there} must not exist, got an earlier report. Choose another --out or pass --force.")
    if figures is not None:
        check_target(figures, force=force, ours=figure_names())
    if design is not None and tests is not None:
        raise InputError("--tests must not go with --design, got both. The design says how many.")
    if same_instrument and len(result) == 1:
        raise InputError("--same-instrument must go with a second RESULT, got one alone. Name the campaign to set beside it.")
    # The comparison is the longest part and waits for nothing.
    beside = process_executor(1) if comparison is None else nullcontext()
    with beside as executor, counting_progress(quiet, "sections") as progress:
        running = None if executor is None else executor.submit(compare_for_report, result[0])
        first, *others = (lb.load(path) for path in result)
        document = lb.write_report(
            first,
            folder,
            beside_it=_named(first, others, result[1:]),
            same_instrument=same_instrument,
            ci_prob=ci,
            tests=tests,
            comparison=running if comparison is None else lb.read_comparison(comparison),
            recommended=None if design is None else lb.read_design(design),
            progress=progress,
        )
    if figures is not None:
        with staged_folder(figures, force=force, ours=figure_names()) as staging:
            for picture in document.pictures:
                lb.figures.save_figure(picture.figure, staging, picture.key, formats=_FORMATS)
            with units_for(sizes_of(first)):
                for name, draw in document.further.items():
                    lb.figures.save_figure(draw(), staging, name, formats=_FORMATS)
    if as_json:
        typer.echo((folder / "report.json").read_text(encoding="utf-8"), nl=False)
    else:
        for alert in document.alerts:
            typer.echo(f"Note: {alert}")
        drawn = "" if figures is None else f"; figures: {figures}"
        typer.echo(f"Written: {', '.join(f'{folder}/{name}' for name in REPORT_FILES)}{drawn}")
    if not record_of(first)["sampler"]["converged"]:
        raise typer.Exit(options.EXIT_MISSED)


def figure_names() -> tuple[str, ...]:
    """Figures that may be replaced: those of an earlier report."""
    others = "budget differences evidence compliance_with_local_fits geometry_with_local_fits predictive_p_values expected_widths"
    others += " information efficiency nuisance_costs prior_and_posterior alias correlation"
    return options.figure_files(sorted({*lb.figures.FIGURES, *others.split()}), _FORMATS)


def _named(first: xr.DataTree, posteriors: list[xr.DataTree], paths: list[Path]) -> dict[str, xr.DataTree]:
    """Keyed by the campaign's name; by the folder's where two have the same."""
    from ldbb_bayes.inference.posterior import record_of

    names = [str(record_of(posterior)["campaign"]["name"]) for posterior in (first, *posteriors)]
    keys = (
        names[1:] if len(set(names)) == len(names) else [f"{name} ({path})" for name, path in zip(names[1:], paths, strict=True)]
    )
    return dict(zip(keys, posteriors, strict=True))


DEMO_FILES = ("campaign", "constant", "linear", "figures")


@command
def demo(
    out: Annotated[Path, typer.Option(help="Folder to write results and figures to.", metavar="DIR")] = Path("ldbb_demo"),
    force: options.ForceOption = False,
    seed: options.SeedOption = 1,
    as_json: options.JsonOption = False,
    quiet: options.QuietOption = False,
) -> None:
    """Fit constant and linear compliance to the published experiment, and say what it means.

    The readings are recovered from the printed tables of the paper; what in them is not data is said in the folder's README.
    """
    import shutil

    from ldbb_bayes.files import check_target, staged_folder
    from ldbb_bayes.jobs import process_executor
    from ldbb_bayes.report.findings import compare_for_report, full_result
    from ldbb_bayes.report.text import results_table
    from ldbb_bayes.report.wording import two_fits_sentences

    check_target(out, force=force, ours=DEMO_FILES)
    source = lb.embedded_campaign()
    campaign = lb.read_campaign(source)
    fits = {}
    for name, degree in (("constant", 0), ("linear", 1)):
        with sampling_progress(quiet, name) as progress:
            fits[name] = lb.sample(lb.HybridModel.default(degree), campaign, seed=seed, progress=progress)
    results = {name: full_result(posterior, 0.95) for name, posterior in fits.items()}
    with process_executor(1) as executor, staged_folder(out, force=force, ours=DEMO_FILES) as staging:
        shutil.copytree(source, staging / "campaign")
        for name, posterior in fits.items():
            write_result(posterior, results[name], staging / name)
        running = executor.submit(compare_for_report, staging / "linear")
        lb.save_figures(fits["linear"], staging / "figures")
        lb.write_report(fits["linear"], staging / "linear", comparison=running)
    parts: list[Any] = []
    for name, posterior in fits.items():
        parts += [f"{name.capitalize()} compliance", results_table(results[name], lb.verdicts(posterior))]
    parts += [*two_fits_sentences(results["constant"], results["linear"]), "", f"Report: {out}/linear/report.html"]
    parts.append(f"Files: {out}/campaign, {out}/constant, {out}/linear, {out}/figures (PNG and SVG)")
    Output(as_json=as_json).deliver({"schema": 1, "out": str(out), **results}, tuple(parts))
    if not all(result["sampler"]["converged"] for result in results.values()):
        raise typer.Exit(options.EXIT_MISSED)
