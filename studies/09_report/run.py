"""The report of the published experiment: how long it takes after the fit, how large the page is,
what it counts.

python studies/09_report/run.py            # fails when a stated number is not reproduced (seconds
                                           # are not compared)
python studies/09_report/run.py --write    # states anew; pictures of sheet 1 and, where a Chromium
                                           # is installed, of the page
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
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "results"
        run_command("fit", str(CAMPAIGN), "--out", str(folder))
        seconds = []
        for _ in range(RUNS[effort]):
            start = processor_seconds()
            run_command("report", str(folder), "--force")
            seconds.append(processor_seconds() - start)
        if effort == "write":
            draw_page(folder / "report.html")
            book = Path(temporary) / "book"
            run_command("report", str(WORKBOOK), "--out", str(book), "--yes")
            draw_sheet_1(book / "report.pdf")
        return {"seconds": {"processor": min(seconds), "runs": len(seconds)}} | numbers(folder)


def run_command(*arguments: str) -> None:
    """Run a command of the package, which prints nothing."""
    subprocess.run(
        [sys.executable, "-m", "ldbb_bayes", *arguments, "--quiet"],
        check=True,
        stdout=subprocess.DEVNULL,
    )


def processor_seconds() -> float:
    """Time of the processor that commands have taken, which other work does not lengthen [s]."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def numbers(folder: Path) -> dict[str, Any]:
    """Of the page, of its budgets, and of the paper's least squares beside Figs. 9 and 10."""
    budgets = lb.analysis.budget_uncertainty(lb.load(folder))
    page = (folder / "report.html").read_text(encoding="utf-8")
    return {
        "page_MB": len(page.encode()) / 1e6,
        "figures": page.count("<figure"),
        "tables": page.count("<table"),
        "shares_sum_to_one": all(shares_sum_to_one(budget) for budget in budgets.values()),
        "E_XX1_bar_length": budgets["E_XX1"].share("BarLength"),
        "peak_to_peak_um": peak_to_peak_um(),
    }


def shares_sum_to_one(budget: Any) -> bool:
    """Whether the shares of the sources are the whole of a parameter's variance."""
    total = sum(line.share for line in budget.contributions)
    return bool(abs(total - 1.0) < 1e-9)


def peak_to_peak_um() -> dict[str, dict[str, float]]:
    """Contributions by the paper's least squares, beside those printed in Figs. 9 and 10."""
    campaign = lb.read_campaign(CAMPAIGN)
    posterior = lb.sample(lb.HybridModel.paper(0), campaign, sampler="independent", seed=1)
    size_um = lb.analysis.decompose_deviation(posterior).set_index("source")["peak_to_peak"]
    values = pd.read_csv(DATA / "published_tables" / "figure_values.csv")
    printed = values[values["figure"].isin(["9", "10"])].set_index("quantity")
    contributions = {}
    for name in NAMES:
        contributions[name] = {
            "found": float(size_um[name]),
            "printed": 1e3 * float(printed.loc[name, "printed_mm"]),
        }
    return contributions


def draw_sheet_1(report: Path) -> None:
    """Write a picture of the first sheet of a report."""
    with pypdfium2.PdfDocument(report) as sheets:
        image = sheets[0].render(scale=1.25).to_pil()
        image.convert("P", palette=1, colors=64).save(HERE / "sheet_1.png", optimize=True)


def draw_page(page: Path) -> None:
    """Write a picture of the page's first screen, where a Chromium is installed."""
    browser = (
        shutil.which("chromium")
        or shutil.which("chromium-browser")
        or shutil.which("google-chrome")
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
