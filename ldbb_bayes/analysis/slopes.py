"""Which compliances vary with force? Every subset of slopes is a model; its exact evidence says how probable it is.

Every compliance varies or not with probability ½ beforehand, independently of the others. C(F) is averaged over all subsets;
where there are too many (several planes), over those that a search from the best to its neighbours visits first.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_serializer, model_validator

from ldbb_bayes.inference.evidence import Evidences, Weighed, probabilities
from ldbb_bayes.inference.nodes import draw_parameters_given
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.prior import compliance_unit
from ldbb_bayes.result import Numbers
from ldbb_bayes.units import ranked

__all__ = ["Curve", "SlopeSubset", "SlopeSubsets", "VaryingSlope", "count_subsets", "model_curves", "slope_subsets"]

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
    """All subsets, the most probable first, and what follows from them.

    Attributes
    ----------
    slopes : dict of compliance to VaryingSlope
    subsets : tuple of SlopeSubset
    curves : dict of compliance to Curve
        Averaged over the subsets.
    possible : int
        How many subsets there are; more than ``subsets`` where only the best were searched for.
    """

    slopes: dict[str, VaryingSlope]
    subsets: tuple[SlopeSubset, ...]
    curves: dict[str, Curve]
    possible: int


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

    def of(powers: tuple[int, ...]) -> Weighed:
        highest = dict(zip(options, powers, strict=True))
        return evidences.of(model.fixing(*(p.name for p in slopes if p.degree > highest[p.compliance])))

    every = list(options.values())
    few = _possible(options) <= _EVERY
    found = {powers: of(powers) for powers in itertools.product(*every)} if few else _best_first(every, of)
    log_evidence = np.array([one.evidence.log_value for one in found.values()])
    share = probabilities(log_evidence)
    powers = np.array(list(found))
    subsets = [
        SlopeSubset(dict(zip(options, own, strict=True)), *values)
        for own, *values in zip(found, log_evidence.tolist(), share.tolist(), strict=True)
    ]
    quadratics = (share @ (powers > 1)).tolist() if quadratic else [None] * len(options)
    inclusion = zip((share @ (powers > 0)).tolist(), quadratics, strict=True)
    return SlopeSubsets(
        {name: VaryingSlope(*both) for name, both in zip(options, inclusion, strict=True)},
        tuple(ranked(subsets, lambda subset: subset.probability)),
        _averaged_curves(list(found.values()), share, seed, ci_prob),
        _possible(options),
    )


def model_curves(weighed: Weighed, seed: int, ci_prob: float = 0.95) -> dict[str, Curve]:
    """Return C(F) of one model."""
    return _averaged_curves([weighed], np.ones(1), seed, ci_prob)


def _options(bound: BoundModel, *, quadratic: bool) -> dict[str, tuple[int, ...]]:
    """Powers of force to choose from, of every compliance that has slopes."""
    highest: dict[str, int] = {}
    for parameter in bound.parameters:
        if parameter.group == "slope":
            highest[parameter.compliance] = max(highest.get(parameter.compliance, 0), parameter.degree)
    return {name: tuple(range(top + 1)) if quadratic else (0, top) for name, top in highest.items()}


def _possible(options: Mapping[str, Sequence[int]]) -> int:
    return int(np.prod([len(own) for own in options.values()]))


def _best_first(options: Sequence[Sequence[int]], of: Callable[[tuple[int, ...]], Weighed]) -> dict[tuple[int, ...], Weighed]:
    """From no slope and from all: the neighbours (one compliance changed) of the best subset not yet expanded, until there are
    ``_SEARCHED``."""
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


def _averaged_curves(weighed: Sequence[Weighed], share: Array, seed: int, ci_prob: float) -> dict[str, Curve]:
    """C(F) over the tested forces, averaged over models with these probabilities."""
    rng = np.random.default_rng(seed)
    bound = weighed[0].posterior.bound
    forces = bound.campaign.forces_N
    force = np.linspace(forces.min(), forces.max(), _POINTS) if np.ptp(forces) > 0 else forces[:1]
    counts = np.floor(share * _DRAWS + rng.random()).astype(int)
    values = np.concatenate([_draws(one, int(count), force, rng) for one, count in zip(weighed, counts, strict=True) if count])
    low, median, high = np.quantile(values, [0.5 - 0.5 * ci_prob, 0.5, 0.5 + 0.5 * ci_prob], axis=0)
    mean = values.mean(axis=0)
    return {
        name.label: Curve(compliance_unit(name), force, mean[:, j], median[:, j], low[:, j], high[:, j], ci_prob)
        for j, name in enumerate(bound.compliances)
    }


def _draws(weighed: Weighed, size: int, force_N: Array, rng: np.random.Generator) -> Array:
    """Of C(F), shape (size, forces, compliances)."""
    beta = draw_parameters_given(weighed.posterior, weighed.lattice.pick(size, rng), rng)
    rows = np.stack([weighed.posterior.bound.compliance_at(force) for force in force_N])
    return np.einsum("fcp,wp->wfc", rows, beta)
