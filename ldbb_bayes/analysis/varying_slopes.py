"""Subsets of slopes: which compliances vary with force, and C(F) averaged over the subsets."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.inference.coefficients import compliance_curves
from ldbb_bayes.inference.evidence import probabilities
from ldbb_bayes.inference.evidences import Evidences
from ldbb_bayes.inference.nodes import Nodes
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.prior import compliance_unit
from ldbb_bayes.results import Array, Numbers
from ldbb_bayes.units import ranked

__all__ = [
    "Curve",
    "SlopeSubset",
    "VaryingSlope",
    "averaged_curves",
    "count_subsets",
    "slope_subsets",
]


_DRAWS = 4000


_POINTS = 41


_EVERY = 729


_SEARCHED = 100


@dataclass(frozen=True)
class SlopeSubset:
    """One subset: the compliances that vary with force, its log evidence and posterior
    probability."""

    varying: tuple[str, ...]
    log_evidence: float
    probability: float


@dataclass(frozen=True)
class VaryingSlope:
    """Posterior probability that a compliance varies with force."""

    inclusion_probability: float


@dataclass(frozen=True, eq=False)
class Curve:
    """C(F) of one compliance: mean, median and equal-tailed credible band at each force, in inside
    units."""

    unit: str
    force_N: Numbers
    mean: Numbers
    median: Numbers
    low: Numbers
    high: Numbers
    ci_prob: float


def count_subsets(model: HybridModel, campaign: Campaign) -> int:
    """Return how many models `slope_subsets` weighs."""
    possible = 2 ** len(_slopes(model, campaign))
    return possible if possible <= _EVERY else _SEARCHED


def slope_subsets(
    model: HybridModel, evidences: Evidences, *, seed: int, ci_prob: float = 0.95
) -> tuple[dict[str, VaryingSlope], tuple[SlopeSubset, ...], dict[str, Curve]]:
    """Every compliance's probability of a slope, subsets of slopes at degree 1, most probable
    first, and C(F) averaged."""
    slopes = _slopes(model, evidences.campaign)

    def of(there: tuple[bool, ...]) -> Nodes:
        return evidences.of(
            model.fixing(
                *(slope for slope, own in zip(slopes.values(), there, strict=True) if not own)
            )
        )[0]

    every = itertools.product((False, True), repeat=len(slopes))
    weighed = (
        {there: of(there) for there in every}
        if 2 ** len(slopes) <= _EVERY
        else _best_first(len(slopes), of)
    )
    log_evidence = np.array([nodes.evidence.log_value for nodes in weighed.values()])
    share = probabilities(log_evidence)
    found = [
        SlopeSubset(tuple(itertools.compress(slopes, there)), *values)
        for there, *values in zip(weighed, log_evidence.tolist(), share.tolist(), strict=True)
    ]
    inclusion = (share @ np.array(list(weighed))).tolist()
    return (
        {
            name: VaryingSlope(probability)
            for name, probability in zip(slopes, inclusion, strict=True)
        },
        tuple(ranked(found, lambda subset: subset.probability)),
        averaged_curves(list(weighed.values()), share, seed, ci_prob),
    )


def _slopes(model: HybridModel, campaign: Campaign) -> dict[str, str]:
    """Compliances that have a slope, and its name."""
    return {p.compliance: p.name for p in model.bind(campaign).parameters if p.group == "slope"}


def _best_first(
    slopes: int, of: Callable[[tuple[bool, ...]], Nodes]
) -> dict[tuple[bool, ...], Nodes]:
    """From no slope and from all: the neighbours (one slope changed) of the best subset not yet
    expanded, until there are ``_SEARCHED``."""
    seen = {there: of(there) for there in ((False,) * slopes, (True,) * slopes)}
    expanded: set[tuple[bool, ...]] = set()
    while len(seen) < _SEARCHED and len(expanded) < len(seen):
        best = max(
            (there for there in seen if there not in expanded),
            key=lambda there: seen[there].evidence.log_value,
        )
        expanded.add(best)
        for near in ((*best[:i], not best[i], *best[i + 1 :]) for i in range(slopes)):
            if near not in seen and len(seen) < _SEARCHED:
                seen[near] = of(near)
    return seen


def averaged_curves(
    weighed: Sequence[Nodes], share: Array, seed: int, ci_prob: float
) -> dict[str, Curve]:
    """C(F), see `compliance_curves`, over the tested forces, averaged over models with these
    probabilities."""
    rng = np.random.default_rng(seed)
    bound = weighed[0].bound
    forces = bound.campaign.forces_N
    force = np.linspace(forces.min(), forces.max(), _POINTS) if np.ptp(forces) > 0 else forces[:1]
    counts = np.floor(share * _DRAWS + rng.random()).astype(int)
    values = []
    for nodes, count in zip(weighed, counts, strict=True):
        if count:
            beta, phi = nodes.draw(int(count), rng)
            values.append(compliance_curves(nodes.bound, phi, beta, force, rng))
    every = np.concatenate(values)
    low, median, high = np.quantile(every, [0.5 - 0.5 * ci_prob, 0.5, 0.5 + 0.5 * ci_prob], axis=0)
    mean = every.mean(axis=0)
    return {
        name.label: Curve(
            compliance_unit(name), force, mean[:, j], median[:, j], low[:, j], high[:, j], ci_prob
        )
        for j, name in enumerate(bound.compliances)
    }
