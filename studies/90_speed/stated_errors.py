"""How often the error that an evidence states holds: simulated campaigns of every kind, against
finer nodes.

python studies/90_speed/stated_errors.py 0 300    # fails below 99 % within three stated errors, or
95 % stated below 0.02 nat
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray

import ldbb_bayes as lb
from ldbb_bayes.inference.evidences import Evidences
from ldbb_bayes.inference.nodes import HyperPosterior

TOLERANCE = 1e-2
FINER = 1e-3


def campaign_of(seed: int) -> tuple[lb.HybridModel, lb.Campaign]:
    """2 to 40 tests, degree 0 to 2, arcs, clocked balls, strong and absent form, discrepancy near
    zero, truncation off and on."""
    rng = np.random.default_rng(seed)
    count = int(np.exp(rng.uniform(np.log(2.0), np.log(41.0))))
    degree = int(rng.integers(0, 3))
    arc = rng.random() < 0.4
    tests = []
    for force in np.round(np.sort(rng.uniform(30.0, 750.0, count))):
        readings = int(rng.integers(30, 90))
        span = rng.uniform(200.0, 330.0) if arc else 360.0
        angle = arc * rng.uniform(0.0, 360.0) + np.arange(readings) * span / readings
        work, tool = (45.0 * rng.integers(0, 4, 2) * (seed % 3 == 0)).tolist()
        tests.append(
            lb.CircularTest(
                float(force), angle, name=f"t{len(tests)}", work_ball_deg=work, tool_ball_deg=tool
            )
        )
    plan = lb.Campaign(tuple(tests))
    model = lb.HybridModel.first(min(degree, plan.force_levels - 1))
    choices = {
        "tau": (0.0, 0.3, 15.0),
        "kappa": (0.0, 0.02, 0.5),
        "delta": (0.0, 0.3, 2.0),
        "sigma": (0.05, 0.3),
    }
    hyper_um = {name: float(rng.choice(own)) for name, own in choices.items()}
    campaign = model.simulate(plan, seed=seed, hyper_um=hyper_um).campaign
    return (model if seed % 2 else model.without("truncation")), campaign


def reference(model: lb.HybridModel, campaign: lb.Campaign) -> float:
    """ln Z from finer nodes and starts of another seed; P(T | y, φ) is finer too, and from other
    points for every few nodes."""
    bound = model.bind(campaign)
    density = HyperPosterior(bound, truncated=bound.truncation.active, seed=1)
    fine = density.plain.nodes(FINER).integral

    def log_inside(index: NDArray[np.intp]) -> NDArray[np.float64]:
        parts = enumerate(np.array_split(index, -(-len(index) // 32)))
        orthants = ((k, density.given(fine.free[part])[1].orthant) for k, part in parts)
        return np.concatenate(
            [orthant.log_probability(FINER, seed=2 + k % 16)[0] for k, orthant in orthants]
        )

    if density.truncated:
        fine = fine.times(log_inside, FINER / 10.0)
    return fine.log_integral - bound.log_prob_truncation_prior


def stated(seed: int) -> list[tuple[float, float]]:
    """How many stated errors the evidence is off, and that error [nat]: of a model, and where it
    has slopes of one with some of them fixed, from the nodes of the first."""
    model, campaign = campaign_of(seed)
    slopes = [name for name in model.bind(campaign).names if name.endswith("_1")]
    some = np.random.default_rng(seed).permutation(slopes)[: 1 + seed % 5]
    models = [model, model.fixing(*some)] if model.degree == 1 else [model]
    found = [nodes.evidence for nodes in Evidences(campaign, tolerance=TOLERANCE).of(*models)]
    exact = [reference(own, campaign) for own in models]
    return [
        (abs(own.log_value - value) / own.error, own.error)
        for own, value in zip(found, exact, strict=True)
    ]


def main() -> None:
    """From one seed to another."""
    rows: list[tuple[float, float]] = []
    for seed in range(int(sys.argv[1]), int(sys.argv[2])):
        rows += stated(seed)
        print(f"{seed:4d}  {rows[-1][0]:.2f} errors of {rows[-1][1]:.4f} nat", flush=True)
    ratio, error = np.array(rows).T
    within = float(np.mean(ratio <= 3.0))
    small = float(np.mean(error <= 0.02))
    print(
        f"within three errors: {within:.3f}; stated error at most 0.02 nat: {small:.3f}; largest"
        f" ratio {ratio.max():.2f}"
    )
    if within < 0.99 or small < 0.95:
        sys.exit("The stated error does not hold.")


if __name__ == "__main__":
    main()
