"""Whether a change of one machine between two campaigns is found, and how well it is known.

Each machine is measured twice with one instrument. In between, C_XXX grows; nothing else of the
machine changes. The differences of the parameters are computed in three ways: as of two independent
posteriors, with one instrument, and with one instrument and one machine.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from machines import FAMILIES, MIDDLE_N, NEW, PLANS, simulate
from study import Effort, replicated

import ldbb_bayes as lb

__all__ = ["repairs"]

HERE = Path(__file__).resolve().parent

MACHINES = 30
AGAIN: dict[Effort, int] = {"quick": 1, "usual": 2}
GROWTH = 1.15
ONE_WAY = "mild"
BOTH_WAYS = "mild, both ways, shuffled"
# Families whose joints do not deflect in proportion to the force, or not alike along the travel.
JOINTS = ("contact", "own load", "travel", "seat")
FAMILY_OF_KIND = {ONE_WAY: FAMILIES[ONE_WAY], BOTH_WAYS: PLANS[BOTH_WAYS]}
for _joints in JOINTS:
    _family = (FAMILIES | NEW)[_joints]
    FAMILY_OF_KIND[f"{_joints}, both ways, shuffled"] = replace(
        _family, both_ways=True, shuffled=True
    )
# What is said of the two campaigns, and the options that say it.
KNOWLEDGE = {
    "nothing": {},
    "instrument": {"same_instrument": True},
    "machine": {"same_instrument": True, "same_machine": True},
}


def repairs(effort: Effort) -> dict[str, Any]:
    """Return what the page states of changes between two campaigns."""
    rows = replicated(
        HERE / "repairs.csv", change, dict.fromkeys(FAMILY_OF_KIND, MACHINES), effort, again=AGAIN
    )
    return {
        "machines": MACHINES,
        "growth": GROWTH - 1.0,
        "kinds": {str(kind): of_kind(rows[rows["kind"] == kind]) for kind in FAMILY_OF_KIND},
    }


def change(kind: str, seed: int) -> dict[str, float]:
    """Return how the change of one machine is judged.

    For each way of computing the differences: u of the change of C_XXX, as a share of C_XXX;
    whether C_XXX is found to have grown (probability above 97.5 %); the share of intervals that
    contain the true change; and the share of other parameters that are found to have changed.
    """
    family = FAMILY_OF_KIND[kind]
    first, first_machine = simulate(family, seed)
    second, second_machine = simulate(family, seed, plan=first, grown={"C_XXX": GROWTH})
    model = lb.HybridModel.default(1)
    posteriors = [
        lb.sample(model, campaign, sampler="independent", seed=seed) for campaign in (first, second)
    ]
    first_C_XXX = first_machine.secant("C_XXX", MIDDLE_N)
    second_C_XXX = second_machine.secant("C_XXX", MIDDLE_N)
    row = {}
    for knowledge, options in KNOWLEDGE.items():
        table = lb.analysis.compare_posteriors(*posteriors, **options)
        table = table[~table.index.str.endswith("_1")]
        truth = pd.Series(0.0, index=table.index)
        truth["C_XXX"] = second_C_XXX - first_C_XXX
        is_covered = (table["ci_low"] <= truth) & (truth <= table["ci_high"])
        increase = table["probability_of_increase"]
        tail = np.minimum(increase, 1.0 - increase)
        row[f"u {knowledge}"] = table.loc["C_XXX", "sd"] / first_C_XXX
        row[f"found {knowledge}"] = float(increase["C_XXX"] > 0.975)
        row[f"covered {knowledge}"] = float(is_covered.mean())
        row[f"false {knowledge}"] = float((tail.drop("C_XXX") < 0.025).mean())
    return row


def of_kind(rows: pd.DataFrame) -> dict[str, dict[str, float]]:
    """Return the numbers of one kind of machines, by what is known of the two campaigns."""
    numbers = {}
    for knowledge in KNOWLEDGE:
        numbers[knowledge] = {
            "u": float(rows[f"u {knowledge}"].median()),
            "found": float(rows[f"found {knowledge}"].mean()),
            "covered": float(rows[f"covered {knowledge}"].mean()),
            "false": float(rows[f"false {knowledge}"].mean()),
        }
    return numbers
