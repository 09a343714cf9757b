"""The report of the published experiment: how long it takes after the fit, how large the page is,
what it counts.

python studies/09_report/run.py            # fails when a stated number is not reproduced (seconds
are not compared) python studies/09_report/run.py --write    # states anew; pictures of sheet 1 and,
where a Chromium is installed, of the page
"""

from __future__ import annotations

import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pandas as pd
import pypdfium2

import ldbb_bayes as lb

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
from study import DATA, Effort, Study, run

CAMPAIGN = DATA / "recovered_experiment"
RUNS: dict[Effort, int] = {"quick": 1, "usual": 3, "write": 5}
WORKBOOK = HERE.parents[1] / "docs" / "tutorials" / "practice.xlsx"
SCREEN = "1280,900"
NAMES = ("C_XXX", "C_YYY", "C_CCY", "E_XX1", "E_YX2")


def measure(effort: Effort) -> dict[str, Any]:
    """Fit, report, and read the numbers back."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "results"
        command = [sys.executable, "-m", "ldbb_bayes"]
        subprocess.run(
            [*command, "fit", str(CAMPAIGN), "--out", str(folder), "--quiet"],
            check=True,
            stdout=subprocess.DEVNULL,
        )
        seconds = []
        for _ in range(RUNS[effort]):
            start = processor_seconds()
            subprocess.run(
                [*command, "report", str(folder), "--force", "--quiet"],
                check=True,
                stdout=subprocess.DEVNULL,
            )
            seconds.append(processor_seconds() - start)
        if effort == "write":
            picture(folder / "report.html")
            subprocess.run(
                [*command, "report", str(WORKBOOK), "--out", f"{name}/book", "--yes", "--quiet"],
                check=True,
            )
            with pypdfium2.PdfDocument(f"{name}/book/report.pdf") as sheets:
                sheets[0].render(scale=1.25).to_pil().convert("P", palette=1, colors=64).save(
                    HERE / "sheet_1.png", optimize=True
                )
        return {"seconds": {"processor": min(seconds), "runs": len(seconds)}} | numbers(folder)


def processor_seconds() -> float:
    """Time of the processor that commands have taken, which other work does not lengthen [s]."""
    taken = resource.getrusage(resource.RUSAGE_CHILDREN)
    return taken.ru_utime + taken.ru_stime


def numbers(folder: Path) -> dict[str, Any]:
    """Of the page, of its budgets, and of the paper's own least squares beside Figs. 9 and 10."""
    posterior = lb.load(folder)
    budgets = lb.analysis.budget_uncertainty(posterior)
    page = (folder / "report.html").read_text(encoding="utf-8")
    paper = lb.sample(
        lb.HybridModel.paper(0), lb.read_campaign(CAMPAIGN), sampler="independent", seed=1
    )
    size = lb.analysis.decompose_deviation(paper).set_index("source")["peak_to_peak"]
    values = pd.read_csv(DATA / "published_tables" / "figure_values.csv")
    stated = values[values["figure"].isin(["9", "10"])].set_index("quantity")
    return {
        "page_MB": len(page.encode()) / 1e6,
        "figures": page.count("<figure"),
        "tables": page.count("<table"),
        "shares_sum_to_one": (
            max(
                abs(sum(line.share for line in own.contributions) - 1.0) for own in budgets.values()
            )
            < 1e-9
        ),
        "E_XX1_bar_length": budgets["E_XX1"].share("BarLength"),
        "peak_to_peak_um": {
            name: {
                "found": float(size[name]),
                "printed": 1e3 * float(stated.loc[name, "printed_mm"]),
            }
            for name in NAMES
        },
    }


def picture(page: Path) -> None:
    """The first screen, where a Chromium is installed."""
    browser = next(
        (
            path
            for path in map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))
            if path
        ),
        None,
    )
    if browser is None:
        print("no Chromium here: first_screen.png stays as it is")
        return
    options = [
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--hide-scrollbars",
        "--disable-background-networking",
    ]
    shot = f"--screenshot={HERE / 'first_screen.png'}"
    subprocess.run(
        [browser, *options, f"--window-size={SCREEN}", shot, page.as_uri()],
        check=True,
        capture_output=True,
    )


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    run(Study(HERE, measure, tolerance=0.05, once=("seconds*",)))


if __name__ == "__main__":
    main()
