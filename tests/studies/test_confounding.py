"""The study's numbers are reproduced, and its page says what they are."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

STUDY = Path(__file__).parents[2] / "studies" / "03_confounding"


@pytest.mark.slow
def test_reproduced() -> None:
    done = subprocess.run([sys.executable, str(STUDY / "run.py")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_page_says_what_was_found() -> None:
    results = json.loads((STUDY / "results.json").read_text(encoding="utf-8"))
    lines = (STUDY / "README.md").read_text(encoding="utf-8").replace("−", "-").splitlines()
    for name, entry in results["parameters"].items():
        shown = name.replace("E_C0YX", "E_C(0Y)X")
        row = next(line for line in lines if line.startswith(f"| {shown} ("))
        cells = [cell.strip() for cell in row.strip("|").split("|")]
        assert float(cells[1]) == pytest.approx(entry["published"])
        for cell, label in zip(cells[2:], ("least squares", "without form", "with form"), strict=True):
            value, spread = (float(part) for part in cell.split("±"))
            assert spread == pytest.approx(entry[label]["sd"], rel=0.06)
            assert value == pytest.approx(entry[label]["mean"], abs=0.06 * entry[label]["sd"] + 0.5 * 10 ** -_decimals(cell))
    plans = results["plans"]
    order = ("as run", "work ball alone", "both balls at 0, 45, 90° in turn", "both balls, length calibrated")
    for name in ("E_XX1", "E_YX2", "E_C0YX", "C_CCY"):
        shown = name.replace("E_C0YX", "E_C(0Y)X")
        row = [line for line in lines if line.startswith((f"| {shown},", f"| {shown} ("))][-1]
        cells = [cell.strip() for cell in row.strip("|").split("|")][1:]
        for cell, plan in zip(cells, order, strict=True):
            assert float(cell) == pytest.approx(plans[plan][name]["sd"], rel=0.06)


def _decimals(cell: str) -> int:
    value = cell.split("±")[0].strip()
    return len(value.split(".")[1]) if "." in value else 0
