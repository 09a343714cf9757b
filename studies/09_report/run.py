"""The report of the published experiment: how long it takes after the fit, how large the page is, what it counts."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import ldbb_bayes as lb

HERE = Path(__file__).parent
CAMPAIGN = HERE.parents[1] / "data" / "recovered_experiment"
RUNS = 3
SCREEN = "1280,900"


def numbers(folder: Path) -> dict[str, Any]:
    """What the README states."""
    posterior = lb.load(folder)
    budgets = lb.budgets(posterior)
    page = (folder / "report.html").read_text(encoding="utf-8")
    paper = lb.sample(lb.HybridModel.paper(0), lb.read_campaign(CAMPAIGN), sampler="quadrature", seed=1)
    size = lb.contributions(paper).set_index("source")["peak_to_peak"]
    return {
        "page_MB": len(page.encode()) / 1e6,
        "figures": page.count("<figure"),
        "tables": page.count("<table"),
        "shares_off_one": max(abs(sum(line.share for line in own.contributions) - 1.0) for own in budgets.values()),
        "E_XX1_bar_length": budgets["E_XX1"].share("BarLength"),
        "least_squares_peak_to_peak_um": {name: float(size[name]) for name in ("C_XXX", "C_YYY", "C_CCY", "E_XX1", "E_YX2")},
    }


def main(*, write: bool) -> None:
    """Fit, report three times, print; with --write also results.json and the picture."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "results"
        command = [sys.executable, "-m", "ldbb_bayes"]
        subprocess.run([*command, "fit", str(CAMPAIGN), "--out", str(folder), "--quiet"], check=True, stdout=subprocess.DEVNULL)
        seconds = []
        for _ in range(RUNS):
            start = time.perf_counter()
            subprocess.run([*command, "report", str(folder), "--force", "--quiet"], check=True, stdout=subprocess.DEVNULL)
            seconds.append(time.perf_counter() - start)
        found = numbers(folder)
        print(f"seconds after the fit, start of Python included: {', '.join(f'{value:.1f}' for value in sorted(seconds))}")
        print(json.dumps(found, indent=2))
        if write:
            (HERE / "results.json").write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
            _picture(folder / "report.html")


def _picture(page: Path) -> None:
    """The first screen, where a Chromium is installed."""
    browser = next((path for path in map(shutil.which, ("chromium", "chromium-browser", "google-chrome")) if path), None)
    if browser is None:
        print("no Chromium here: first_screen.png stays as it is")
        return
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--disable-background-networking"]
    shot = f"--screenshot={HERE / 'first_screen.png'}"
    subprocess.run([browser, *options, f"--window-size={SCREEN}", shot, page.as_uri()], check=True, capture_output=True)


if __name__ == "__main__":
    main(write="--write" in sys.argv[1:])
