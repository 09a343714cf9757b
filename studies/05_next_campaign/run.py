"""The campaign that should come next, after the recovered experiment: which forces, how many circles, which clockings.

python studies/05_next_campaign/run.py            # fails when results.json is not reproduced
python studies/05_next_campaign/run.py --write    # states anew
"""

from __future__ import annotations

import argparse
import json
import sys
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import ldbb_bayes as lb
from ldbb_bayes.report.figures import expected_widths, information

HERE = Path(__file__).resolve().parent
LINEAR = lb.HybridModel.default(degree=1)
BOTH_BALLS = tuple(product((0.0, 45.0, 90.0), repeat=2))
TOLERANCE = 0.02


def paper_levels() -> lb.Plan:
    """The seven levels of the experiment, 112 N included."""
    return lb.Campaign(tuple(lb.CircularTest(force, np.arange(720) / 2.0) for force in (36, 112, 238, 364, 490, 616, 742)))


def designs() -> dict[str, lb.Design]:
    """Everything the page speaks of."""
    pilot = lb.read_campaign(HERE.parents[1] / "data" / "recovered_experiment")
    levels = range(36, 743, 2)
    coarse = tuple(np.linspace(36.0, 742.0, 15))
    found = {"six": lb.design(LINEAR, pilot, tests=6, against={"the paper's six": pilot}, robust=True)}
    for degree, name in enumerate(("flat, constant", "flat, linear")):
        flat = lb.HybridModel.paper(degree)
        found[name] = lb.design(flat, paper_levels(), tests=7, against={"the paper's seven": paper_levels()})
    found["slope of C_XYX"] = lb.design(LINEAR, pilot, power=0.9, parameters=["C_XYX_1"], forces_N=levels)
    found["squareness, forces alone"] = lb.design(LINEAR, pilot, targets={"E_C0YX": 3e-6}, forces_N=coarse)
    found["squareness, both balls"] = lb.design(
        LINEAR, pilot, targets={"E_C0YX": 1e-6}, forces_N=coarse, clockings_deg=BOTH_BALLS
    )
    return found


def stated(found: dict[str, lb.Design]) -> dict[str, Any]:
    """The numbers of README.md."""
    six = found["six"]
    paper = six.others[0]
    return {
        "six": {
            "forces_N": sorted(float(t.force_N or 0.0) for t in six.tests),
            "efficiency": {"recommended": six.efficiency} | {j.name: j.efficiency for j in (six.baseline, paper)},
            "width_over_the_papers": {
                name: entry.sd / paper.forecast.expected[name].sd for name, entry in six.forecast.expected.items()
            },
            "worst_efficiency": {str(name): float(value) for name, value in six.robustness["worst"].items()},
        },
        "flat": {
            name: {
                "shares": found[name].shares.round(4).groupby("force_N")["share"].sum().to_dict(),
                "the_papers_seven": found[name].others[0].efficiency,
            }
            for name in ("flat, constant", "flat, linear")
        },
        "slope of C_XYX": {
            "circles": len(found["slope of C_XYX"].tests),
            "equal_steps_efficiency": found["slope of C_XYX"].baseline.efficiency,
        },
        "squareness": {
            "alone_urad": 1e6 * found["squareness, forces alone"].forecast.expected["E_C0YX"].sd,
            "notes": [note for note in found["squareness, forces alone"].notes if "reach" in note],
            "both_balls_urad": 1e6 * found["squareness, both balls"].forecast.expected["E_C0YX"].sd,
            "both_balls_circles": len(found["squareness, both balls"].tests),
        },
    }


def differences(new: dict[str, Any], old: dict[str, Any]) -> list[str]:
    """Numbers that were not reproduced to 2 %."""
    one, other = (pd.json_normalize(values, sep="/").iloc[0].to_dict() for values in (new, old))
    keys = sorted({*one, *other})
    return [
        f"{key}: {one.get(key)}, stated {other.get(key)}"
        for key in keys
        if not (
            np.isclose(one[key], other[key], rtol=TOLERANCE, atol=TOLERANCE)
            if isinstance(other.get(key), float) and key in one
            else one.get(key) == other.get(key)
        )
    ]


def main() -> None:
    """Design and compare with what is stated; ``--write`` states anew."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="write results.json and the figures")
    options = parser.parse_args()
    found = designs()
    results = json.loads(json.dumps(stated(found)))
    if options.write:
        (HERE / "results.json").write_text(json.dumps(results, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
        information(found["six"]).savefig(HERE / "information.png", dpi=160)
        expected_widths(found["six"]).savefig(HERE / "expected_widths.png", dpi=160)
    for name, design in found.items():
        print(f"{name}\n{'-' * len(name)}\n{design}\n")
    wrong = differences(results, json.loads((HERE / "results.json").read_text(encoding="utf-8")))
    if wrong:
        sys.exit("Not reproduced:\n" + "\n".join(wrong))
    print("Reproduced.")


if __name__ == "__main__":
    main()
