"""What a second radius, the other direction and further planes make known: as predicted, and in
simulated campaigns.

python studies/08_other_campaigns/run.py            # fails when a stated number is not reproduced
python studies/08_other_campaigns/run.py --write    # states anew
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure
from scipy.stats import binom

import ldbb_bayes as lb

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
sys.path.insert(0, str(HERE))
from plans import (
    FORCES_N,
    MODEL,
    both_directions,
    everything,
    one_radius,
    three_planes,
    two_radii,
)
from simulated import (
    CLOCKWISE,
    DEFAULT,
    LEVEL,
    PLANS,
    analysed,
    analysed_by_default,
    summary,
)
from study import Effort, Study, executor, kept, replicated, run

CAMPAIGNS = 200
# Analysed by the third edition too, which takes longer.
BY_DEFAULT = 40
CALIBRATED = 200
DRAWS = 99
BAND = 0.99
AGAIN: dict[Effort, int] = {"quick": 2, "usual": 12}
DEFAULT_AGAIN: dict[Effort, int] = {"quick": 1, "usual": 4}
# A draw equal to the truth within rounding falls on either side of it, by version of the libraries.
ONE_RANK = 1.5 / DRAWS
# And where the choice of a draw hangs on rounding, all that follow are others.
ASTRAY = 0.01
RANKS_AGAIN: dict[Effort, int] = {"quick": 10, "usual": 40, "write": CALIBRATED}


def predicted() -> dict[str, Any]:
    """Verdict and expected sd of every parameter (no slopes) at the hyper-parameters' prior
    median."""
    plans = (one_radius(), two_radii(), both_directions(), three_planes())
    by_plan = {plan.name: verdicts(MODEL, plan) for plan in plans}
    drifting, timed_plan = everything()
    by_plan[timed_plan.name] = verdicts(drifting, timed_plan)
    return by_plan


def verdicts(model: lb.HybridModel, plan: lb.Plan) -> dict[str, Any]:
    """Verdict, expected sd and confounding with the balls' form of every parameter but slopes."""
    by_name = {}
    for name, entry in lb.identify(model, plan).parameters.items():
        if not name.endswith("_1"):
            by_name[name] = {
                "verdict": entry.verdict,
                "sd": entry.sd,
                "ball_form": entry.confounding["BallForm"],
            }
    return by_name


def calibration(effort: Effort) -> dict[str, Any]:
    """Ranks with radii, directions and drift on."""
    model, plan = everything()
    with executor() as pool:
        result = lb.calibrate(
            model,
            plan,
            replicates=RANKS_AGAIN[effort],
            draws=DRAWS,
            prob=BAND,
            sampler="independent",
            seed=8,
            executor=pool,
        )
    if result.failures:
        sys.exit(f"08_other_campaigns: {result.failures[0]}")
    ranks_again = pd.DataFrame(result.ranks.astype(float), columns=list(result.names))
    rows = kept(
        HERE / "ranks.csv",
        ranks_again.assign(kind="everything", seed=range(len(ranks_again))),
        {"everything": CALIBRATED},
        effort,
        tolerance=ONE_RANK,
        astray=ASTRAY,
    )
    ranks = rows.drop(columns=["kind", "seed"])
    full = lb.analysis.Validation(
        tuple(ranks.columns), ranks.to_numpy(dtype=int), DRAWS, "independent", BAND, ()
    )
    return {
        "replicates": full.replicates,
        "quantities": len(full.names),
        "outside": list(full.outside),
        "percent": 100.0 * BAND,
    }


def measure(effort: Effort) -> dict[str, Any]:
    """Everything the page states."""
    kinds = dict.fromkeys([*PLANS, *CLOCKWISE], CAMPAIGNS)
    rows = replicated(HERE / "campaigns.csv", analysed, kinds, effort, again=AGAIN)
    simulated = summary(rows)
    by_default = replicated(
        HERE / "third.csv",
        analysed_by_default,
        dict.fromkeys(CLOCKWISE, BY_DEFAULT),
        effort,
        again=DEFAULT_AGAIN,
    )
    return {
        "forces_N": list(FORCES_N),
        "campaigns": CAMPAIGNS,
        "se": float((LEVEL * (1.0 - LEVEL) / CAMPAIGNS) ** 0.5),
        "predicted": predicted(),
        "simulated": simulated,
        "by_default": summary(by_default),
        "friction": {
            "one_way": friction_of(DEFAULT, one_radius()),
            "both_ways": friction_of(MODEL, both_directions()),
        },
        "se_by_default": float((LEVEL * (1.0 - LEVEL) / BY_DEFAULT) ** 0.5),
        "chance_of_lowest": chance_of_lowest(simulated["three planes"]["coverage"]),
        "calibration": calibration(effort),
    }


def friction_of(model: lb.HybridModel, plan: lb.Plan) -> float:
    """Prior sd of what changes its sign with the direction and grows with force, at order 1
    [µm/kN]."""
    in_proportion = model.bind(plan).columns_of[lb.terms.Hysteresis][1]
    return 1e6 * float(in_proportion.sd[1])


def chance_of_lowest(coverage: Mapping[str, float]) -> float:
    """Probability that of so many calibrated parameters, taken as independent, one is covered as
    rarely as the rarest here."""
    hits = round(min(coverage.values()) * CAMPAIGNS)
    return float(1.0 - (1.0 - binom.cdf(hits, CAMPAIGNS, LEVEL)) ** len(coverage))


@lb.figures.styled
def two_radii_figure(verdicts_by_plan: dict[str, Any]) -> Figure:
    """Expected sd of every parameter with a second radius, relative to one radius."""
    one = verdicts_by_plan["one radius"]
    two = verdicts_by_plan["two radii"]
    figure = lb.figures.new_figure(7.2, 3.4)
    axes = figure.subplots()
    for k, name in enumerate(one):
        is_identified = two[name]["verdict"] == "identified"
        colour = lb.figures.PALETTE[0] if is_identified else "#B0B0B0"
        axes.bar(k, two[name]["sd"] / one[name]["sd"], color=colour)
    axes.axhline(1.0, color="black", linewidth=0.8, linestyle="--")
    labels = [name.replace("C0YX", "C(0Y)X") for name in one]
    axes.set_xticks(range(len(labels)), labels, rotation=45, ha="right")
    axes.set_ylabel("expected sd, two radii / one radius (1)")
    axes.set_title(
        "Ten circles of 150 mm against five of 150 and five of 100 mm (blue: identified)",
        fontsize=10,
    )
    return figure


def draw(results: dict[str, Any]) -> dict[str, Figure]:
    """Figures of the page."""
    return {"two_radii": two_radii_figure(results["predicted"])}


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    run(Study(HERE, measure, draw))


if __name__ == "__main__":
    main()
