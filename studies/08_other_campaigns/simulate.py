"""Campaigns of several radii, directions and planes, simulated with everything drawn from its prior and analysed.

python studies/08_other_campaigns/simulate.py            # 20 campaigns of each, a minute
python studies/08_other_campaigns/simulate.py --write    # 400 of each, some ten minutes
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
from collections.abc import Mapping
from concurrent.futures import Executor, ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from plans import MODEL, both_directions, everything, one_radius, three_planes, two_radii

import ldbb_bayes as lb
from ldbb_bayes.inference.marginals import moments, quantiles
from ldbb_bayes.inference.quadrature import HyperPosterior

HERE = Path(__file__).resolve().parent
Row = dict[str, tuple[float, float, bool]]


def analysed(campaign: lb.Campaign, truth: Mapping[str, float], seed: int) -> Row:
    """Error of the mean, sd, and whether the 95 % interval held the truth, of every parameter."""
    bound = MODEL.bind(campaign)
    posterior = HyperPosterior(bound, truncated=True)
    mean, sd = moments(posterior, posterior.brief, spare=1e-3)
    low, high = quantiles(posterior, posterior.brief, np.array([0.025, 0.975]), seed, components=1024)
    return {
        name: (float(m - truth[name]), float(s), bool(a <= truth[name] <= b))
        for name, m, s, a, b in zip(bound.names, mean, sd, low, high, strict=True)
    }


def one(seed: int) -> dict[str, Row]:
    """One machine of each kind, as every campaign sees it."""
    found = {}
    for plan in (one_radius(), two_radii(), three_planes()):
        made = MODEL.simulate(plan, seed=seed)
        found[plan.name] = analysed(made.campaign, made.parameters, seed)
    made = MODEL.simulate(both_directions(), seed=seed)
    clockwise = [test.name for test in made.campaign.tests if test.direction == "CW"]
    found["both directions"] = analysed(made.campaign, made.parameters, seed)
    found["its clockwise half"] = analysed(made.campaign.select(clockwise), made.parameters, seed)
    return found


def measured(count: int, pool: Executor) -> dict[str, Any]:
    """Width, error and coverage of every parameter in every campaign."""
    rows = list(pool.map(one, range(5000, 5000 + count)))
    found: dict[str, Any] = {"campaigns": count}
    for name in rows[0]:
        found[name] = {}
        for parameter in rows[0][name]:
            error, sd, inside = (np.array(column) for column in zip(*(row[name][parameter] for row in rows), strict=True))
            found[name][parameter] = {
                "rms_sd": float(np.sqrt((sd**2).mean())),
                "rms_error": float(np.sqrt((error**2).mean())),
                "coverage_95": float(inside.mean()),
            }
    return found


def calibration(count: int, pool: Executor) -> dict[str, Any]:
    """Ranks with radii, directions and drift on."""
    model, plan = everything()
    result = lb.validate(model, plan, replicates=count, seed=8, executor=pool)
    coverage = result.coverage()["95"]
    return {
        "replicates": result.replicates,
        "quantities": len(result.names),
        "outside": list(result.outside),
        "failures": list(result.failures),
        "coverage_95": {str(name): float(value) for name, value in coverage.items()},
    }


def main() -> None:
    """Measure; ``--write`` keeps the numbers."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="400 campaigns of each; write simulations.json")
    count = 400 if (options := parser.parse_args()).write else 20
    with ProcessPoolExecutor(os.cpu_count(), mp_context=multiprocessing.get_context("spawn")) as pool:
        results = measured(count, pool) | {"calibration": calibration(count, pool)}
    print(json.dumps(results, indent=2))
    if options.write:
        (HERE / "simulations.json").write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
