"""Are the predicted intervals those one gets? Designs run in simulation, many times, and analysed as any campaign.

python studies/05_next_campaign/simulate.py            # 20 campaigns of each design, a minute
python studies/05_next_campaign/simulate.py --write    # 200 of each, some minutes
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

import ldbb_bayes as lb
from ldbb_bayes.inference.collapsed import draw_parameters_given
from ldbb_bayes.inference.marginals import moments, quantiles
from ldbb_bayes.inference.quadrature import HyperPosterior

HERE = Path(__file__).resolve().parent
MODEL = lb.HybridModel.default(1)
CLOCKINGS = tuple(product((0.0, 45.0, 90.0), repeat=2))


def pilot() -> lb.Campaign:
    """The recovered experiment."""
    return lb.read_campaign(HERE.parents[1] / "data" / "recovered_experiment")


def designs() -> dict[str, tuple[lb.Plan, dict[str, float]]]:
    """Plans, and the standard uncertainty predicted of every parameter."""
    campaign = pilot()
    six = lb.design(MODEL, campaign, tests=6, against={"the paper's six": campaign})
    separating = lb.design(MODEL, campaign, tests=9, parameters=["E_C0YX"], clockings_deg=CLOCKINGS, forces_N=range(36, 743, 50))
    paper = six.others[0].forecast
    return {
        "recommended six": (six.plan(), {n: e.sd for n, e in six.forecast.expected.items()}),
        "the paper's six": (campaign.plan(), {n: e.sd for n, e in paper.expected.items()}),
        "nine, both balls clocked": (separating.plan(), {n: e.sd for n, e in separating.forecast.expected.items()}),
    }


def truths(count: int) -> list[tuple[dict[str, float], dict[str, float]]]:
    """Parameters and hyper-parameters [µm] from the pilot's posterior."""
    bound = MODEL.bind(pilot())
    posterior = HyperPosterior(bound, truncated=True)
    rng = np.random.default_rng(1)
    free = posterior.brief.pick(count, rng)
    beta, phi = draw_parameters_given(posterior, free, rng), bound.hyper_prior.phi(free)
    names, hypers = bound.names, bound.hyper_prior.names
    return [
        (dict(zip(names, b.tolist(), strict=True)), dict(zip(hypers, (1e3 * p).tolist(), strict=True)))
        for b, p in zip(beta, phi, strict=True)
    ]


def analysed(job: tuple[int, dict[str, float], dict[str, float]], plan: lb.Plan) -> tuple[list[float], list[float], list[bool]]:
    """Error of the mean, sd, and whether the 95 % interval held the truth, of every parameter."""
    seed, parameters, hyper_um = job
    campaign = MODEL.simulate(plan, seed=seed, parameters=parameters, hyper_um=hyper_um).campaign
    posterior = HyperPosterior(MODEL.bind(campaign), truncated=True)
    mean, sd = moments(posterior, posterior.brief, spare=1e-3)
    low, high = quantiles(posterior, posterior.brief, np.array([0.025, 0.975]), seed, components=1024)
    truth = np.array(list(parameters.values()))
    return (mean - truth).tolist(), sd.tolist(), ((low <= truth) & (truth <= high)).tolist()


def measure(count: int) -> dict[str, Any]:
    """Every design, run and analysed this often."""
    found: dict[str, Any] = {"campaigns": count}
    jobs = [(1000 + i, *truth) for i, truth in enumerate(truths(count))]
    with ProcessPoolExecutor(os.cpu_count(), mp_context=multiprocessing.get_context("spawn")) as pool:
        for name, (plan, predicted) in designs().items():
            rows = list(pool.map(partial(analysed, plan=plan), jobs, chunksize=2))
            error, sd, inside = (np.array(column) for column in zip(*rows, strict=True))
            found[name] = {
                parameter: {
                    "predicted_sd": predicted[parameter],
                    "mean_sd": float(np.sqrt((sd[:, j] ** 2).mean())),
                    "width_over_predicted": float(np.sqrt((sd[:, j] ** 2).mean()) / predicted[parameter]),
                    "rms_error_over_predicted": float(np.sqrt((error[:, j] ** 2).mean()) / predicted[parameter]),
                    "coverage_95": float(inside[:, j].mean()),
                }
                for j, parameter in enumerate(jobs[0][1])
            }
    return found


def main() -> None:
    """Measure; ``--write`` keeps the numbers."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="200 campaigns of each design; write simulations.json")
    options = parser.parse_args()
    results = measure(200 if options.write else 20)
    print(json.dumps(results, indent=2))
    if options.write:
        (HERE / "simulations.json").write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
