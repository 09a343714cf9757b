"""Where intervals do not hold, and why: more campaigns of the families that fall short, judged by
other intervals and by wider beliefs; and what holds the mild family's parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from machines import FAMILIES, FORCES_N, NEW, STATED, Disturbances, Machine, simulate
from numpy.typing import NDArray
from scipy.stats import binomtest
from study import Effort, replicated

import ldbb_bayes as lb
from ldbb_bayes.analysis.hyper_parameter_nodes import hyper_parameter_nodes
from ldbb_bayes.analysis.verdicts import judge_parameters
from ldbb_bayes.inference.elastic_deflections import compliance_curves
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.nodes import compute_nodes
from ldbb_bayes.model.bound_information import information_of

__all__ = ["holders_of_mild", "shortfalls"]

HERE = Path(__file__).resolve().parent
Array = NDArray[np.float64]
Row = dict[str, float]

MODEL = lb.HybridModel.default(1)
# Campaigns of each kind; none of them is among those of the families' table.
CAMPAIGNS = {
    "stiff": 90,
    "travel": 90,
    "travel, wider": 90,
    "seat": 70,
    "seat, wider": 30,
    "both ways": 55,
    "drives, drift, well planned": 35,
}
FIRST_SEED = 2000
AGAIN: dict[Effort, int] = {"quick": 1, "usual": 2}
# Kinds that are a family analysed with a wider belief: the family, and the term with its belief.
QUADRATIC_SD = 0.07
JOINT_SD = 0.8
WIDER: dict[str, tuple[str, lb.terms.Term]] = {
    "travel, wider": ("travel", lb.terms.Position(quadratic_sd=QUADRATIC_SD)),
    "seat, wider": ("seat", lb.terms.JointLoad(relative_sd=JOINT_SD)),
}
# What each kind is asked about: the number that fell short, or the pair of both axes.
AXES_AT_SMALLEST = ("C_XXX at 36 N", "C_YYY at 36 N")
ASKED: dict[str, tuple[str, ...]] = {
    "stiff": ("C_CCY",),
    "travel": ("C_CCY",),
    "travel, wider": ("C_CCY",),
    "seat": AXES_AT_SMALLEST,
    "seat, wider": AXES_AT_SMALLEST,
    "both ways": ("C_XYX",),
    "drives, drift, well planned": ("C_XYX",),
}
JUDGED_PARAMETERS = ("C_CCY", "C_XYX")
DRAWS = 4000
TOLERANCE = 0.05  # of the nodes of an integral over the hyper-parameters
PROB = 0.95
# Campaigns of the mild family of which it is asked what holds their parameters.
MILD_CAMPAIGNS = 3
# Terms left out one at a time, and together, to see which verdicts change.
LEFT_OUT = (
    ("hysteresis",),
    ("drift",),
    ("position",),
    ("joint-load",),
    ("machine-pattern",),
    ("ball-form",),
    ("bar-length",),
    ("hysteresis", "drift", "position"),
)


def job(kind: str, seed: int) -> Row:
    """One campaign of a family that falls short, with the numbers asked of any of them."""
    family, model = family_and_model(kind)
    campaign, machine = simulate(family, FIRST_SEED + seed)
    return judged_campaign(model, campaign, machine, FIRST_SEED + seed)


def family_and_model(kind: str) -> tuple[Disturbances, lb.HybridModel]:
    """The family of a kind, and the model that it is analysed by."""
    families = FAMILIES | NEW | STATED
    if kind not in WIDER:
        return families[kind], MODEL
    family, term = WIDER[kind]
    return families[family], MODEL.with_term(term)


def judged_campaign(
    model: lb.HybridModel, campaign: lb.Campaign, machine: Machine, seed: int
) -> Row:
    """Error and intervals of every number asked."""
    bound = model.bind(campaign)
    nodes = compute_nodes(HyperPosterior(bound, truncated=True), TOLERANCE)
    mean, sd = nodes.moments()
    beta, phi = nodes.draw(DRAWS, np.random.default_rng(seed))
    row: Row = {}
    for name in JUDGED_PARAMETERS:
        j = bound.names.index(name)
        row |= judged(name, beta[:, j], machine.truth[name], mean[j], sd[j])
    smallest = FORCES_N[0]
    curves = compliance_curves(
        bound, phi[::4], beta[::4], np.array([smallest]), np.random.default_rng(seed)
    )
    labels = [label.label for label in bound.compliances]
    for column in AXES_AT_SMALLEST:
        name = column.partition(" ")[0]
        draws = curves[:, 0, labels.index(name)]
        truth = machine.secant(name, smallest)
        row |= judged(column, draws, truth, float(np.median(draws)), float(draws.std()))
    return row


def judged(name: str, draws: Array, truth: float, estimate: float, sd: float) -> Row:
    """Error in u; the posterior probability below the truth, which says whether the truth is in the
    interval of equal tails or in that from zero; whether it is in the shortest interval."""
    low, high = shortest_interval(draws)
    return {
        f"{name}/error": (estimate - truth) / sd,
        f"{name}/below": float(np.mean(draws < truth)),
        f"{name}/shortest": bool(low <= truth <= high),
    }


def shortest_interval(draws: Array) -> tuple[float, float]:
    """The shortest interval that holds the share `PROB` of the draws."""
    ordered = np.sort(draws)
    inside = int(np.floor(PROB * len(ordered)))
    start = int((ordered[inside:] - ordered[:-inside]).argmin())
    return float(ordered[start]), float(ordered[start + inside])


def shortfalls(effort: Effort) -> dict[str, Any]:
    """Coverage of the numbers that fell short, of every kind."""
    rows = replicated(HERE / "shortfalls.csv", job, CAMPAIGNS, effort, again=AGAIN)
    stated = {}
    for kind, names in ASKED.items():
        of_kind = rows[rows["kind"] == kind]
        stated[kind] = coverage_of(of_kind, names) | {"campaigns": len(of_kind)}
    return {
        "kinds": stated,
        "quadratic_sd": QUADRATIC_SD,
        "joint_sd": JOINT_SD,
    }


def coverage_of(rows: pd.DataFrame, names: tuple[str, ...]) -> dict[str, Any]:
    """Shares of the truths that intervals of four kinds hold, pooled over the names."""
    error = rows[[f"{name}/error" for name in names]].to_numpy().ravel()
    below = rows[[f"{name}/below" for name in names]].to_numpy().ravel()
    shortest = rows[[f"{name}/shortest" for name in names]].to_numpy().ravel()
    tail = 0.5 * (1.0 - PROB)
    too_high = below < tail
    too_low = below > 1.0 - tail
    equal_tails = ~too_high & ~too_low
    likely = binomtest(int(equal_tails.sum()), len(equal_tails)).proportion_ci(PROB)
    return {
        "what": names[0] if len(names) == 1 else "C(F) at 36 N",
        "equal_tails": float(equal_tails.mean()),
        "likely": [float(likely.low), float(likely.high)],
        "above": int(too_high.sum()),
        "below": int(too_low.sum()),
        "within_U": float((np.abs(error) <= 2.0).mean()),
        "shortest": float(shortest.mean()),
        "from_zero": float((below <= PROB).mean()),
        "bias": float(error.mean()),
    }


def holders_of_mild() -> dict[str, Any]:
    """What holds the parameters of mild machines: their largest sources, and how many parameters
    are called confounded if a term were not in the model."""
    shares: dict[str, list[Mapping[str, float]]] = {}
    confounded: dict[str, list[int]] = {}
    for seed in range(MILD_CAMPAIGNS):
        campaign, _ = simulate(FAMILIES["mild"], seed)
        verdicts = verdicts_of(MODEL, campaign)
        for name, entry in verdicts.items():
            shares.setdefault(name, []).append(entry.shares)
        confounded.setdefault("", []).append(number_confounded(verdicts))
        for terms in LEFT_OUT:
            fewer = verdicts_of(MODEL.without(*terms), campaign)
            confounded.setdefault(", ".join(terms), []).append(number_confounded(fewer))
    return {
        "campaigns": MILD_CAMPAIGNS,
        "parameters": len(shares),
        "shares": {name: mean_shares(of_name) for name, of_name in shares.items()},
        "confounded": {terms: float(np.mean(counts)) for terms, counts in confounded.items()},
    }


def verdicts_of(model: lb.HybridModel, campaign: lb.Campaign) -> dict[str, Any]:
    """Verdicts on all parameters at the posterior mean of the hyper-parameters."""
    bound = model.bind(campaign)
    weight, phi = hyper_parameter_nodes(bound)
    mean = np.zeros(len(bound.names))
    return dict(judge_parameters(bound, information_of(bound, weight @ phi), mean))


def number_confounded(verdicts: Mapping[str, Any]) -> int:
    """How many parameters are called confounded."""
    return sum(entry.verdict == "confounded" for entry in verdicts.values())


def mean_shares(shares: list[Mapping[str, float]]) -> dict[str, float]:
    """Mean share of the three largest sources of a parameter's variance."""
    means = pd.DataFrame(shares).mean().sort_values(ascending=False)
    return {str(name): float(share) for name, share in means.head(3).items()}
