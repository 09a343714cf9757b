"""Which compliances vary with force? Every subset of slopes is a model; its exact evidence says how probable it is.

Every compliance varies or not with probability ½ beforehand, independently of the others. C(F) is averaged over all subsets;
where there are too many (several planes), over those that a search from the best to its neighbours visits first.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_serializer, model_validator

from ldbb_bayes.inference.evidence import Evidences, probabilities
from ldbb_bayes.inference.nodes import Nodes
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.prior import compliance_unit
from ldbb_bayes.result import Numbers
from ldbb_bayes.units import ranked

__all__ = ["Curve", "SlopeSubset", "SlopeSubsets", "VaryingSlope", "averaged_curves", "count_subsets", "slope_subsets"]

Array = NDArray[Any]
_DRAWS = 8000
_POINTS = 41
_EVERY, _SEARCHED = 729, 100


@dataclass(frozen=True)
class SlopeSubset:
    """One subset: the power of force up to which each compliance varies, its log evidence and posterior probability."""

    powers: dict[str, int]
    log_evidence: float
    probability: float

    @property
    def varying(self) -> tuple[str, ...]:
        """Compliances that vary with force."""
        return tuple(name for name, power in self.powers.items() if power)


@dataclass(frozen=True)
class VaryingSlope:
    """Posterior probability that a compliance varies with force; with a quadratic part, where that was asked."""

    inclusion_probability: float
    quadratic_probability: Annotated[float | None, Field(exclude_if=lambda value: value is None)] = None


@dataclass(frozen=True, eq=False)
class Curve:
    """C(F) of one compliance: mean, median and equal-tailed credible band at each force, in inside units."""

    unit: str
    force_N: Numbers
    mean: Numbers
    median: Numbers
    low: Numbers
    high: Numbers
    ci_prob: float

    @model_serializer
    def _band_named(self) -> dict[str, Any]:
        values = {name: getattr(self, name).tolist() for name in ("force_N", "mean", "median")}
        return {"unit": self.unit, **values, f"ci{100 * self.ci_prob:g}": [self.low.tolist(), self.high.tolist()]}

    @model_validator(mode="before")
    @classmethod
    def _band_read(cls, values: Any) -> Any:
        key = next((key for key in values if key.startswith("ci")), "") if isinstance(values, dict) else ""
        if not key:
            return values
        low, high = values[key]
        return {**values, "low": low, "high": high, "ci_prob": float(key[2:]) / 100.0}


@dataclass(frozen=True, eq=False)
class SlopeSubsets:
    """All subsets, the most probable first, what follows from them, and how many there are: more than ``subsets`` where only the
    best were searched for."""

    slopes: dict[str, VaryingSlope] = field(default_factory=dict)
    subsets: tuple[SlopeSubset, ...] = ()
    curves: dict[str, Curve] = field(default_factory=dict)
    possible: int | None = None


def count_subsets(model: HybridModel, evidences: Evidences, *, quadratic: bool) -> int:
    """Return how many models `slope_subsets` weighs."""
    possible = _possible(_options(model.bind(evidences.campaign), quadratic=quadratic))
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
    slopes = [p for p in bound.parameters if p.group == "slope"]

    def of(powers: tuple[int, ...]) -> Nodes:
        highest = dict(zip(options, powers, strict=True))
        return evidences.of(model.fixing(*(p.name for p in slopes if p.degree > highest[p.compliance])))

    every = list(options.values())
    few = _possible(options) <= _EVERY
    weighed = {powers: of(powers) for powers in itertools.product(*every)} if few else _best_first(every, of)
    log_evidence = np.array([nodes.evidence.log_value for nodes in weighed.values()])
    share, powers = probabilities(log_evidence), np.array(list(weighed))
    subsets = [
        SlopeSubset(dict(zip(options, own, strict=True)), *values)
        for own, *values in zip(weighed, log_evidence.tolist(), share.tolist(), strict=True)
    ]
    quadratics = (share @ (powers > 1)).tolist() if quadratic else [None] * len(options)
    inclusion = zip((share @ (powers > 0)).tolist(), quadratics, strict=True)
    return SlopeSubsets(
        {name: VaryingSlope(*both) for name, both in zip(options, inclusion, strict=True)},
        tuple(ranked(subsets, lambda subset: subset.probability)),
        averaged_curves(list(weighed.values()), share, seed, ci_prob),
        _possible(options),
    )


def _options(bound: BoundModel, *, quadratic: bool) -> dict[str, tuple[int, ...]]:
    """Powers of force to choose from, of every compliance that has slopes."""
    highest: dict[str, int] = {}
    for parameter in bound.parameters:
        if parameter.group == "slope":
            highest[parameter.compliance] = max(highest.get(parameter.compliance, 0), parameter.degree)
    return {name: tuple(range(top + 1)) if quadratic else (0, top) for name, top in highest.items()}


def _possible(options: Mapping[str, Sequence[int]]) -> int:
    return int(np.prod([len(own) for own in options.values()]))


def _best_first(options: Sequence[Sequence[int]], of: Callable[[tuple[int, ...]], Nodes]) -> dict[tuple[int, ...], Nodes]:
    """From no slope and from all: the neighbours (one compliance changed) of the best subset not yet expanded, until there are
    ``_SEARCHED``."""
    seen = {powers: of(powers) for powers in (tuple(own[0] for own in options), tuple(own[-1] for own in options))}
    expanded: set[tuple[int, ...]] = set()
    while len(seen) < _SEARCHED and len(expanded) < len(seen):
        best = max((powers for powers in seen if powers not in expanded), key=lambda powers: seen[powers].evidence.log_value)
        expanded.add(best)
        near = ((*best[:i], power, *best[i + 1 :]) for i, own in enumerate(options) for power in own)
        for powers in near:
            if powers not in seen and len(seen) < _SEARCHED:
                seen[powers] = of(powers)
    return seen


def averaged_curves(weighed: Sequence[Nodes], share: Array, seed: int, ci_prob: float) -> dict[str, Curve]:
    """C(F) over the tested forces, averaged over models with these probabilities."""
    rng = np.random.default_rng(seed)
    bound = weighed[0].bound
    forces = bound.campaign.forces_N
    force = np.linspace(forces.min(), forces.max(), _POINTS) if np.ptp(forces) > 0 else forces[:1]
    counts = np.floor(share * _DRAWS + rng.random()).astype(int)
    values = []
    for nodes, count in zip(weighed, counts, strict=True):
        if count:
            rows = np.stack([nodes.bound.compliance_at(own) for own in force])
            values.append(np.einsum("fcp,wp->wfc", rows, nodes.draw(int(count), rng)[0]))
    every = np.concatenate(values)
    low, median, high = np.quantile(every, [0.5 - 0.5 * ci_prob, 0.5, 0.5 + 0.5 * ci_prob], axis=0)
    mean = every.mean(axis=0)
    return {
        name.label: Curve(compliance_unit(name), force, mean[:, j], median[:, j], low[:, j], high[:, j], ci_prob)
        for j, name in enumerate(bound.compliances)
    }
