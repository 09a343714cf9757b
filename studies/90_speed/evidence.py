"""The evidence by quadrature against nested sampling (dynesty, extra `bench`).

python studies/90_speed/evidence.py            # fails when they differ by more than three of nested sampling's errors
python studies/90_speed/evidence.py --write    # and keeps evidence.json
python studies/90_speed/evidence.py --campaigns 300   # simulated ones, against a run ten times as exact; keeps nothing
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from peers import nested_log_evidence

import ldbb_bayes as lb

HERE = Path(__file__).parent


def campaign_of(seed: int) -> tuple[lb.HybridModel, lb.Campaign]:
    """2 to 40 tests, degree 0 to 2, arcs, clocked balls, strong and absent form, discrepancy near zero, truncation off and on."""
    rng = np.random.default_rng(seed)
    count, degree, arc = int(np.exp(rng.uniform(np.log(2.0), np.log(41.0)))), int(rng.integers(0, 3)), rng.random() < 0.4
    tests = []
    for force in np.round(np.sort(rng.uniform(30.0, 750.0, count))):
        readings, span = int(rng.integers(30, 90)), rng.uniform(200.0, 330.0) if arc else 360.0
        angle = arc * rng.uniform(0.0, 360.0) + np.arange(readings) * span / readings
        work, tool = (45.0 * rng.integers(0, 4, 2) * (seed % 3 == 0)).tolist()
        tests.append(lb.CircularTest(float(force), angle, name=f"t{len(tests)}", work_ball_deg=work, tool_ball_deg=tool))
    plan = lb.Campaign(tuple(tests))
    model = lb.HybridModel.default(min(degree, plan.force_levels - 1))
    choices = {"tau": (0.0, 0.3, 15.0), "kappa": (0.0, 0.02, 0.5), "delta": (0.0, 0.3, 2.0), "sigma": (0.05, 0.3)}
    hyper_um = {name: float(rng.choice(own)) for name, own in choices.items()}
    campaign = model.simulate(plan, seed=seed, hyper_um=hyper_um).campaign
    return (model if seed % 2 else model.without("truncation")), campaign


def cover(campaigns: int) -> None:
    """How often the stated error of the evidence holds; fails below 99 % within three of it, or 95 % stated below 0.02 nat."""
    rows = []
    for seed in range(campaigns):
        model, campaign = campaign_of(seed)
        found, finer = (lb.log_evidence(model, campaign, tolerance=tolerance) for tolerance in (1e-2, 1e-3))
        rows.append((abs(found.log_value - finer.log_value) / found.error, found.error))
        print(f"{seed:4d} {len(campaign.tests):3d} tests  {rows[-1][0]:.2f} errors of {found.error:.4f} nat", flush=True)
    ratio, error = np.array(rows).T
    within, small = float(np.mean(ratio <= 3.0)), float(np.mean(error <= 0.02))
    print(f"within three errors: {within:.3f}; stated error at most 0.02 nat: {small:.3f}; largest ratio {ratio.max():.2f}")
    if within < 0.99 or small < 0.95:
        sys.exit("The stated error does not hold.")


def main() -> None:
    """Constant and linear compliance, without and with truncation, over all parameters and over the hyper-parameters alone."""
    campaign = lb.read_campaign(HERE.parents[1] / "data" / "recovered_experiment")
    rows = []
    for degree in (0, 1):
        full = lb.HybridModel.default(degree)
        for truncation, model in (("off", full.without("truncation")), ("on", full)):
            exact = lb.log_evidence(model, campaign)
            for over in ("all", "hyper") if truncation == "off" else ("all",):
                value, error = nested_log_evidence(model.bind(campaign), seed=3, over=over)
                row = {"degree": degree, "truncation": truncation, "over": over, "nested": value, "error": error}
                rows.append(row | {"quadrature": exact.log_value, "apart": abs(value - exact.log_value) / error})
                print(row, flush=True)
    if "--write" in sys.argv[1:]:
        (HERE / "evidence.json").write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")
    if max(row["apart"] for row in rows) > 3.0:
        sys.exit("The two disagree.")


if __name__ == "__main__":
    cover(int(sys.argv[2])) if "--campaigns" in sys.argv[1:2] else main()
