"""How many circles does it save to stop as soon as a decision stands? Exactly simulated machines,
judged against a limit for C_XXX after every circle.

python studies/15_stopping/run.py            # fails when a stated number is not reproduced
python studies/15_stopping/run.py --write    # states anew
"""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

import ldbb_bayes as lb
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.nodes import compute_nodes

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
sys.path.insert(0, str(HERE.parent / "12_real_machines"))
from machines import PLANS, simulate
from study import Effort, Study, replicated, run

Array = NDArray[np.float64]
Row = dict[str, float]

# Families of study 12 that are run in both directions in random order; seeds are others than there.
KINDS = ("mild, both ways, shuffled", "mild, both ways, shuffled, certificates")
MACHINES = 50
FIRST_SEED = 5000
# Circles come in blocks of two forces, each in both directions, in random order in the block [N].
BLOCKS_N = ((36.0, 742.0), (271.0, 507.0), (36.0, 742.0), (271.0, 507.0))
DIRECTIONS = ("CW", "CCW")
FEWEST = 4
MOST = len(DIRECTIONS) * sum(len(block) for block in BLOCKS_N)
COUNTS = range(FEWEST, MOST + 1)
# The limit over the true C_XXX: evenly spread in the logarithm.
LIMIT_RATIO = (0.7, 1.4)
# A decision stands where its probability is at least so much.
SURE = 0.95
DRAWS = 4000
TOLERANCE = 0.05
LEAST_SAVED = 0.25
AGAIN: dict[Effort, int] = {"quick": 1, "usual": 3}
MODEL = lb.HybridModel.default(1)


def job(kind: str, seed: int) -> Row:
    """One machine: the limit over the truth, and the probability that C_XXX keeps the limit after
    every circle."""
    family = PLANS[kind]
    rng = np.random.default_rng([FIRST_SEED, seed])
    pilot, _ = simulate(family, FIRST_SEED + seed, BLOCKS_N[0])
    plan = plan_in_blocks(pilot, rng)
    campaign, machine = simulate(family, FIRST_SEED + seed, plan=plan)
    ratio = float(np.exp(rng.uniform(*np.log(LIMIT_RATIO))))
    limit = ratio * machine.truth["C_XXX"]
    row = {"limit over truth": ratio}
    for count in COUNTS:
        first = replace(campaign, tests=campaign.tests[:count])
        row[f"after {count}"] = probability_below(first, limit, seed)
    return row


def plan_in_blocks(pilot: lb.Campaign, rng: np.random.Generator) -> lb.Plan:
    """The circles of all blocks, measured as those of the pilot campaign."""
    template = pilot.tests[0]
    tests: list[lb.CircularTest] = []
    for forces_N in BLOCKS_N:
        circles = list(product(forces_N, DIRECTIONS))
        for j in rng.permutation(len(circles)):
            force_N, direction = circles[j]
            name = f"circle_{len(tests) + 1:02d}"
            test = replace(template, force_N=force_N, direction=direction, name=name, time_s=None)
            tests.append(test)
    return replace(pilot, tests=tuple(tests)).plan()


def probability_below(campaign: lb.Campaign, limit: float, seed: int) -> float:
    """Posterior probability that C_XXX is at most ``limit`` [mm/N]."""
    bound = MODEL.bind(campaign)
    nodes = compute_nodes(HyperPosterior(bound, truncated=True), TOLERANCE)
    beta, _ = nodes.draw(DRAWS, np.random.default_rng(seed))
    return float((beta[:, bound.names.index("C_XXX")] <= limit).mean())


def outcomes(rows: pd.DataFrame) -> dict[str, Any]:
    """What fixed numbers of circles decide, what stopping does, and the fixed number that decides
    as much."""
    keeps_limit = rows["limit over truth"].to_numpy() >= 1.0
    probability = rows[[f"after {count}" for count in COUNTS]].to_numpy()
    accepted = probability >= SURE
    rejected = probability <= 1.0 - SURE
    decided = accepted | rejected
    wrong = np.where(keeps_limit[:, None], rejected, accepted)
    fixed = {}
    for k, count in enumerate(COUNTS):
        fixed[str(count)] = {
            "decided": float(decided[:, k].mean()),
            "wrong": float(wrong[:, k].mean()),
        }
    # Index of the number of circles after which one stops, the largest where nothing is decided.
    last = len(COUNTS) - 1
    stop = np.where(decided.any(axis=1), decided.argmax(axis=1), last)
    machines = np.arange(len(rows))
    stopped = {
        "circles": float(np.mean(np.array(COUNTS)[stop])),
        "decided": float(decided[machines, stop].mean()),
        "wrong": float(wrong[machines, stop].mean()),
        "at once": float((stop == 0).mean()),
    }
    by_most = saved(decided, stop)
    compared = [entry for entry in by_most if entry["fixed"] is not None]
    return {"fixed": fixed, "stopped": stopped, "saved": by_most, "compared": compared[-1]}


def saved(decided: Array, stop: Array) -> list[dict[str, float | int | None]]:
    """For every largest number of circles: mean circles where one stops, beside the smallest fixed
    number that decides at least as many machines; None if no number does."""
    counts = np.array(COUNTS)
    rows: list[dict[str, float | int | None]] = []
    for last in range(1, len(counts)):
        circles = counts[np.minimum(stop, last)].mean()
        share = decided[:, : last + 1].any(axis=1).mean()
        as_many = np.flatnonzero(decided.mean(axis=0) >= share)
        row = {
            "most": int(counts[last]),
            "circles": float(circles),
            "decided": float(share),
            "fixed": None,
        }
        if len(as_many):
            row["fixed"] = int(counts[as_many[0]])
        rows.append(row)
    return rows


def measure(effort: Effort) -> dict[str, Any]:
    """Everything the page states."""
    rows = replicated(
        HERE / "machines.csv", job, dict.fromkeys(KINDS, MACHINES), effort, again=AGAIN
    )
    families = {}
    for kind in KINDS:
        of_kind = rows[rows["kind"] == kind]
        families[kind] = outcomes(of_kind)
    return {
        "machines": MACHINES,
        "blocks_N": [list(block) for block in BLOCKS_N],
        "fewest": FEWEST,
        "most": MOST,
        "limit_ratio": list(LIMIT_RATIO),
        "sure": SURE,
        "pooled": outcomes(rows),
        "families": families,
        "must": LEAST_SAVED,
        "se": float(np.sqrt(0.25 / len(rows))),
    }


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    run(Study(HERE, measure))


if __name__ == "__main__":
    main()
