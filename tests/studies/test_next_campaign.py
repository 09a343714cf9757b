"""The study's designs are reproduced, its page says what they are, and simulated campaigns bear out the predicted widths."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

STUDY = Path(__file__).parents[2] / "studies" / "05_next_campaign"


def page() -> str:
    return (STUDY / "README.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_reproduced() -> None:
    done = subprocess.run([sys.executable, str(STUDY / "run.py")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_page_says_what_was_found() -> None:
    found = json.loads((STUDY / "results.json").read_text(encoding="utf-8"))
    six, flat, text = found["six"], found["flat"], page()
    efficiency, paper = six["efficiency"], "the paper's six"
    ratios = {name: ratio for name, ratio in six["width_over_the_papers"].items() if name.startswith("C_")}
    constant, linear = (flat[name]["shares"] for name in ("flat, constant", "flat, linear"))
    assert six["forces_N"] == [36.0, 36.0, 389.0, 389.0, 742.0, 742.0]
    for claim in (
        f"efficiency {efficiency['recommended']:.2f}; the paper's six {efficiency[paper]:.2f}, "
        f"equal steps {efficiency['equal steps']:.2f}",
        f"shares {constant['36.0']:.4f} at 36 N and {constant['742.0']:.4f} at 742 N; the paper's seven levels "
        f"{flat['flat, constant']['the_papers_seven']:.3f}",
        f"shares {linear['36.0']:.4f}, {linear['386.0'] + linear['387.0']:.4f}, {linear['742.0']:.4f} at 36, 386, 742 N; "
        f"the paper's seven levels {flat['flat, linear']['the_papers_seven']:.3f}",
        f"found with probability 0.9 | {found['slope of C_XYX']['circles']} circles",
        f"cannot be had: {found['squareness']['alone_urad']:.1f} µrad",
        f"{found['squareness']['both_balls_circles']} circles: {found['squareness']['both_balls_urad']:.2f} µrad",
        f"are {min(ratios.values()):.2f} to {max(ratios.values()):.2f} times as wide",
        f"its efficiency is {six['worst_efficiency']['good over all']:.2f} if compliance is constant",
        f"One made for constant compliance falls to {six['worst_efficiency']['best for: constant compliance']:.2f}",
    ):
        assert claim in text, claim


def test_predicted_widths_and_coverage() -> None:
    """Every width within 10 % of what was predicted, in 200 campaigns of each design; coverage as claimed; the page says so."""
    found = json.loads((STUDY / "simulations.json").read_text(encoding="utf-8"))
    assert found.pop("campaigns") == 200
    text = page()
    for name, parameters in found.items():
        widths = [entry["width_over_predicted"] for entry in parameters.values()]
        covered = [entry["coverage_95"] for entry in parameters.values()]
        assert 0.9 < min(widths) <= max(widths) < 1.1, name
        assert min(covered) >= 0.90, name
        (row,) = [line for line in text.splitlines() if line.startswith(f"| {name} |")]
        shown = [float(number) for number in re.findall(r"\d\.\d+", row)]
        assert shown == pytest.approx(
            [min(widths), max(widths), min(covered), max(covered), sum(covered) / len(covered)], abs=6e-3
        )
