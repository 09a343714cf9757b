"""``ldbb-bayes demo``: the main job on the embedded campaign."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ldbb_bayes.cli.options import ForceOption, JsonOption, QuietOption, SeedOption, guarded

__all__ = ["demo"]

DEMO_FILES = ("campaign", "constant", "linear", "figures")


@guarded
def demo(
    out: Annotated[Path, typer.Option(help="Folder to write results and figures to.", metavar="DIR")] = Path("ldbb_demo"),
    force: ForceOption = False,
    seed: SeedOption = 1,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Fit constant and linear compliance to the published experiment, and say what it means.

    The readings are recovered from the printed tables of the paper; what in them is not data is said in the folder's README.
    """
    import shutil

    from ldbb_bayes.analysis.identifiability import verdicts
    from ldbb_bayes.campaign.embedded import embedded_campaign
    from ldbb_bayes.campaign.folder import read_campaign
    from ldbb_bayes.cli.show import print_json, reading_console, sampling_progress, write_result
    from ldbb_bayes.files import check_target, staged_folder
    from ldbb_bayes.fleet.executors import process_executor
    from ldbb_bayes.inference.sample import sample
    from ldbb_bayes.model.hybrid import HybridModel
    from ldbb_bayes.report.figures import save_figures
    from ldbb_bayes.report.findings import compare_for_report
    from ldbb_bayes.report.result import full_result
    from ldbb_bayes.report.text import engineer_table, meaning
    from ldbb_bayes.report.writing import write_report

    check_target(out, force=force, ours=DEMO_FILES)
    source = embedded_campaign()
    campaign = read_campaign(source)
    fits = {}
    for name, degree in (("constant", 0), ("linear", 1)):
        with sampling_progress(quiet, name) as progress:
            fits[name] = sample(HybridModel.default(degree), campaign, seed=seed, progress=progress)
    results = {name: full_result(posterior, 0.95) for name, posterior in fits.items()}
    with process_executor(1) as executor, staged_folder(out, force=force, ours=DEMO_FILES) as staging:
        shutil.copytree(source, staging / "campaign")
        for name, posterior in fits.items():
            write_result(posterior, results[name], staging / name)
        running = executor.submit(compare_for_report, staging / "linear")
        save_figures(fits["linear"], staging / "figures")
        write_report(fits["linear"], staging / "linear", comparison=running)
    if as_json:
        print_json({"schema": 1, "out": str(out), **results})
    else:
        console = reading_console()
        for name, posterior in fits.items():
            console.print(f"{name.capitalize()} compliance", style="bold")
            console.print(engineer_table(results[name], verdicts(posterior)))
            console.print()
        for line in meaning(results["constant"], results["linear"]):
            console.print(line, markup=False)
        console.print()
        console.print(f"Report: {out}/linear/report.html", markup=False)
        console.print(f"Files: {out}/campaign, {out}/constant, {out}/linear, {out}/figures (PNG and SVG)", markup=False)
    if not all(result["sampler"]["converged"] for result in results.values()):
        raise typer.Exit(1)
