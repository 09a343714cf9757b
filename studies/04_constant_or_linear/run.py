"""Constant or linear compliance on the recovered experiment: RMSE's answer, white noise's answer, and the honest one.

python studies/04_constant_or_linear/run.py            # fails when results.json is not reproduced
python studies/04_constant_or_linear/run.py --write    # states anew
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

import ldbb_bayes as lb
from ldbb_bayes.report.figures import compliance_with_local_fits, evidence

HERE = Path(__file__).resolve().parent
DATA = HERE.parents[1] / "data"
TOLERANCE = 0.02


def compare() -> lb.Comparison:
    """Constant against linear compliance, everything else as by default."""
    linear = lb.HybridModel.default(degree=1)
    models = {"constant": linear.with_degree(0), "linear": linear}
    return lb.compare(models, lb.read_campaign(DATA / "recovered_experiment"))


def stated(found: lb.Comparison) -> dict[str, Any]:
    """The numbers of README.md."""
    record = found.as_dict()
    relative = max(record["nuisances"][0]["log_evidence"].values())
    assumed = {a["assumption"]: a for a in (*record["nuisances"], *record["discrepancy_sensitivity"])}
    return {
        "log_bayes_factor": record["log_bayes_factor"]["linear/constant"],
        "savage_dickey": record["savage_dickey"]["linear/constant"]["log_bayes_factor"],
        "probability": {name: model["posterior_probability"] for name, model in record["models"].items()},
        "least_squares_rmse_um": {name: model["least_squares"]["rmse_um"] for name, model in record["models"].items()},
        "white_noise_overstates_by_nats": record["white_noise_overstates_by_nats"],
        "slope_scale": {str(s["slope_scale"]): s["log_bayes_factor"] for s in record["prior_sensitivity"]},
        "assumptions": {
            label: {"log_bayes_factor": a["log_bayes_factor"], "evidence": max(a["log_evidence"].values()) - relative}
            for label, a in assumed.items()
        },
        "elpd_difference": record["elpd_difference"]["linear/constant"],
        "inclusion_probability": {name: own["inclusion_probability"] for name, own in record["slopes"].items()},
        "no_slope_probability": next(s["probability"] for s in record["slope_subsets"] if not any(s["powers"].values())),
        "flagged": [name for name, test in record["tests"].items() if test["flag"]],
    }


def differences(new: Any, old: Any, path: str = "") -> list[str]:
    """Numbers that were not reproduced to 0.02 (nat, or relative)."""
    if isinstance(old, dict):
        return [text for key, value in old.items() for text in differences(new[key], value, f"{path}/{key}")]
    if isinstance(old, float):
        return [] if np.isclose(new, old, rtol=TOLERANCE, atol=TOLERANCE) else [f"{path}: {new:.4g}, stated {old:.4g}"]
    return [] if new == old else [f"{path}: {new!r}, stated {old!r}"]


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="write results.json and the figures")
    options = parser.parse_args()
    found = compare()
    results = stated(found)
    if options.write:
        (HERE / "results.json").write_text(json.dumps(results, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
        evidence(found).savefig(HERE / "evidence.png", dpi=160)
        compliance_with_local_fits(found).savefig(HERE / "compliance.png", dpi=160)
    print(found)
    wrong = differences(results, json.loads((HERE / "results.json").read_text(encoding="utf-8")))
    if wrong:
        sys.exit("Not reproduced:\n" + "\n".join(wrong))
    print("Reproduced.")


if __name__ == "__main__":
    main()
