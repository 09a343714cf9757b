"""Which compliances vary with force? Every subset of slopes is a model; its exact evidence says how probable it is.

Every compliance varies or not with probability ½ beforehand, independently of the others. C(F) is averaged over all subsets;
where there are too many (several planes), over those that a search from the best to its neighbours visits first.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.analysis.evidences import Evidences, Weighed, probabilities
from ldbb_bayes.inference.collapsed import draw_parameters_given
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.prior import compliance_unit

__all__ = ["Curve", "SlopeSubset", "SlopeSubsets", "averaged_curves", "count_subsets", "model_curves", "slope_subsets"]

Array = NDArray[Any]
_DRAWS = 8000
_POINTS = 41
_EVERY, _SEARCHED = 729, 100


@dataclass(frozen=True)
class SlopeSubset:
    """One subset: the power of force up to which each compliance varies, its log evidence and posterior probability."""

    powers: Mapping[str, int]
    log_evidence: float
    probability: float

    @property
    def varying(self) -> tuple[str, ...]:
        """Compliances that vary with force."""
        return tuple(name for name, power in self.powers.items() if power)

    @property
    def words(self) -> tuple[str, ...]:
        """The same, with ² where the compliance varies quadratically."""
        return tuple(f"{name}{'²' if self.powers[name] > 1 else ''}" for name in self.varying)


@dataclass(frozen=True, eq=False)
class Curve:
    """C(F) of one compliance: mean, median and equal-tailed credible band at each force, in inside units."""

    unit: str
    ci_prob: float
    force_N: Array
    mean: Array
    median: Array
    low: Array
    high: Array

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        values = {name: getattr(self, name).tolist() for name in ("force_N", "mean", "median")}
        return {"unit": self.unit, **values, f"ci{100 * self.ci_prob:g}": [self.low.tolist(), self.high.tolist()]}


@dataclass(frozen=True, eq=False)
class SlopeSubsets:
    """All subsets, the most probable first, and what follows from them.

    Attributes
    ----------
    subsets : tuple of SlopeSubset
    inclusion, quadratic : mapping of compliance to float
        Posterior probability that it varies with force; that it varies with a quadratic part (empty unless asked for).
    curves : mapping of compliance to Curve
        Averaged over the subsets.
    possible : int
        How many subsets there are; more than ``subsets`` where only the best were searched for.
    error : float
        Largest of the log evidences [nat].
    """

    subsets: tuple[SlopeSubset, ...]
    inclusion: Mapping[str, float]
    quadratic: Mapping[str, float]
    curves: Mapping[str, Curve]
    error: float
    possible: int


def count_subsets(model: HybridModel, evidences: Evidences, *, quadratic: bool) -> int:
    """How many models `slope_subsets` weighs."""
    options = _options(model.bind(evidences.campaign), quadratic=quadratic)
    possible = int(np.prod([len(own) for own in options.values()]))
    return possible if possible <= _EVERY else _SEARCHED


def slope_subsets(model: HybridModel, evidences: Evidences, *, quadratic: bool, seed: int, ci_prob: float = 0.95) -> SlopeSubsets:
    """Weigh every subset of the model's slopes.

    Parameters
    ----------
    model : HybridModel
        The largest one.
    quadratic : bool
        Choose linear or quadratic for every compliance apart; else a compliance that varies does so in the model's degree.
    """
    bound = model.bind(evidences.campaign)
    options = _options(bound, quadratic=quadratic)
    possible = int(np.prod([len(own) for own in options.values()]))

    def of(powers: tuple[int, ...]) -> Weighed:
        return evidences.of(model.fixing(*_fixed(bound, dict(zip(options, powers, strict=True)))))

    every = itertools.product(*options.values())
    found = {powers: of(powers) for powers in every} if possible <= _EVERY else _best_first(list(options.values()), of)
    choices = [dict(zip(options, powers, strict=True)) for powers in found]
    weighed = list(found.values())
    log_evidence = np.array([one.evidence.log_value for one in weighed])
    share = probabilities(log_evidence)
    powers = np.array([list(choice.values()) for choice in choices])
    labels = list(choices[0])
    subsets = [SlopeSubset(*parts) for parts in zip(choices, log_evidence.tolist(), share.tolist(), strict=True)]
    return SlopeSubsets(
        tuple(sorted(subsets, key=lambda subset: -subset.probability)),
        dict(zip(labels, (share @ (powers > 0)).tolist(), strict=True)),
        dict(zip(labels, (share @ (powers > 1)).tolist(), strict=True)) if quadratic else {},
        averaged_curves(weighed, share, np.random.default_rng(seed), ci_prob),
        max(one.evidence.error for one in weighed),
        possible,
    )


def _best_first(options: Sequence[Sequence[int]], of: Callable[[tuple[int, ...]], Weighed]) -> dict[tuple[int, ...], Weighed]:
    """From no slope and from all: the neighbours (one compliance changed) of the best subset whose neighbours are not yet known,
    until there are ``_SEARCHED``."""
    found = {powers: of(powers) for powers in (tuple(own[0] for own in options), tuple(own[-1] for own in options))}
    expanded: set[tuple[int, ...]] = set()
    while len(found) < _SEARCHED and len(expanded) < len(found):
        best = max((powers for powers in found if powers not in expanded), key=lambda powers: found[powers].evidence.log_value)
        expanded.add(best)
        near = ((*best[:i], power, *best[i + 1 :]) for i, own in enumerate(options) for power in own)
        for powers in near:
            if powers not in found and len(found) < _SEARCHED:
                found[powers] = of(powers)
    return found


def averaged_curves(
    weighed: Sequence[Weighed], share: Array, rng: np.random.Generator, ci_prob: float = 0.95
) -> dict[str, Curve]:
    """C(F) over the tested forces, averaged over models with these probabilities."""
    bound = weighed[0].posterior.bound
    forces = bound.campaign.forces_N
    force = np.linspace(forces.min(), forces.max(), _POINTS) if np.ptp(forces) > 0 else forces[:1]
    counts = np.floor(share * _DRAWS + rng.random()).astype(int)
    parts = [_compliances(one, int(count), force, rng) for one, count in zip(weighed, counts, strict=True) if count]
    values = np.concatenate(parts)
    low, median, high = np.quantile(values, [0.5 - 0.5 * ci_prob, 0.5, 0.5 + 0.5 * ci_prob], axis=0)
    mean = values.mean(axis=0)
    return {
        name.label: Curve(compliance_unit(name), ci_prob, force, mean[:, j], median[:, j], low[:, j], high[:, j])
        for j, name in enumerate(bound.compliances)
    }


def model_curves(weighed: Weighed, seed: int, ci_prob: float = 0.95) -> dict[str, Curve]:
    """C(F) of one model."""
    return averaged_curves([weighed], np.ones(1), np.random.default_rng(seed), ci_prob)


def _compliances(weighed: Weighed, size: int, force_N: Array, rng: np.random.Generator) -> Array:
    """Draws of C(F), shape (size, forces, compliances)."""
    beta = draw_parameters_given(weighed.posterior, weighed.lattice.pick(size, rng), rng)
    rows = np.stack([weighed.posterior.bound.compliance_at(force) for force in force_N])
    return np.einsum("fcp,wp->wfc", rows, beta)


def _options(bound: BoundModel, *, quadratic: bool) -> dict[str, tuple[int, ...]]:
    """Powers of force to choose from, of every compliance that has slopes."""
    highest: dict[str, int] = {}
    for parameter in bound.parameters:
        if parameter.group == "slope":
            highest[parameter.compliance] = max(highest.get(parameter.compliance, 0), parameter.degree)
    return {name: tuple(range(top + 1)) if quadratic else (0, top) for name, top in highest.items()}


def _fixed(bound: BoundModel, powers: Mapping[str, int]) -> list[str]:
    return [p.name for p in bound.parameters if p.group == "slope" and p.degree > powers[p.compliance]]
