"""What a second radius, the other direction and further planes make known, before any circle is run.

python studies/08_other_campaigns/run.py            # fails when results.json is not reproduced
python studies/08_other_campaigns/run.py --write    # states anew, and draws the figure
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from plans import MODEL, both_directions, everything, one_radius, three_planes, two_radii

import ldbb_bayes as lb
from ldbb_bayes.units import display_name

HERE = Path(__file__).resolve().parent
TOLERANCE = 0.02


def stated() -> dict[str, Any]:
    """Verdict and expected sd of every parameter (no slopes) at the hyper-parameters' prior median."""
    found = {}
    everything_model, everything_plan = everything()
    cases = [(MODEL, plan) for plan in (one_radius(), two_radii(), both_directions(), three_planes())]
    for model, plan in (*cases, (everything_model, everything_plan)):
        result = lb.identify(model, plan)
        found[plan.name] = {
            name: {"verdict": entry.verdict.word, "sd": entry.sd, "ball_form": entry.confounding["BallForm"]}
            for name, entry in result.parameters.items()
            if not name.endswith("_1")
        }
    return found


def figure(found: dict[str, Any]) -> Figure:
    """Expected sd of every geometric error with a second radius, relative to one radius."""
    one, two = found["one radius"], found["two radii"]
    names = list(one)
    ratio = [two[name]["sd"] / one[name]["sd"] for name in names]
    drawn = Figure(figsize=(7.2, 3.4), layout="constrained")
    axes = drawn.subplots()
    colours = ["#0072B2" if two[name]["verdict"] == "identified" else "#B0B0B0" for name in names]
    axes.bar(range(len(names)), ratio, color=colours)
    axes.axhline(1.0, color="black", linewidth=0.8, linestyle="--")
    axes.set_xticks(range(len(names)), [display_name(name) for name in names], rotation=45, ha="right")
    axes.set_ylabel("expected sd, two radii / one radius (1)")
    axes.set_title("Ten circles of 150 mm against five of 150 and five of 100 mm (blue: identified)", fontsize=10)
    return drawn


def differences(new: dict[str, Any], old: dict[str, Any]) -> list[str]:
    """What was not reproduced: verdicts, and numbers to 2 %."""
    said = []
    for name in sorted({*new, *old}):
        for parameter in sorted({*new.get(name, {}), *old.get(name, {})}):
            one, other = new.get(name, {}).get(parameter), old.get(name, {}).get(parameter)
            same = one and other and one["verdict"] == other["verdict"] and np.isclose(one["sd"], other["sd"], rtol=TOLERANCE)
            if not same:
                said.append(f"{name}, {parameter}: {one}, stated {other}")
    return said


def main() -> None:
    """Compute and compare; ``--write`` keeps."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="write results.json and the figure")
    found = stated()
    path = HERE / "results.json"
    if parser.parse_args().write:
        path.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
        figure(found).savefig(HERE / "two_radii.png", dpi=150)
        return
    wrong = differences(found, json.loads(path.read_text(encoding="utf-8")))
    if wrong:
        sys.exit("\n".join(wrong))


if __name__ == "__main__":
    main()
