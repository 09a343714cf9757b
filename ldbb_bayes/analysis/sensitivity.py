"""What a comparison rests on: two models under other assumptions, every subset of slopes as a model of its own, windows of force.

Which compliances vary with force? Every one varies or not with probability ½ beforehand, independently of the others, and the
exact evidence of a subset says how probable it is. C(F) is averaged over all subsets; where there are too many (several planes),
over those that a search from the best to its neighbours visits first.

Local fits take compliance as constant over windows of force: what varies from window to window is what a slope would have to
explain. For every window both the paper's least squares (Tables 7 and 8) and the posterior with nuisances. Windows overlap and
share ball form, bar length and mount: neighbouring estimates err together, so the scatter of the points says less than their
bars seem to. Geometry is free in every window, so that a window estimates the tangent d(F C)/dF = C + F dC/dF, not C(F) itself:
the two are one only where compliance is constant.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import methodcaller
from typing import Annotated, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import Field, model_serializer, model_validator

from ldbb_bayes.campaign.campaign import Campaign, check_campaign, distinct_forces
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.evidence import Evidences, check_comparable, log_bayes_factor, probabilities
from ldbb_bayes.inference.least_squares import least_squares
from ldbb_bayes.inference.nodes import HyperPosterior, Nodes
from ldbb_bayes.inference.posterior import check_probability
from ldbb_bayes.jobs import one_blas_thread
from ldbb_bayes.model.fourier import Setting
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.prior import compliance_unit
from ldbb_bayes.model.terms import Discrepancy, Drift, Hysteresis, SetupShift, Term
from ldbb_bayes.result import Numbers
from ldbb_bayes.units import ranked

__all__ = [
    "WHITE_NOISE",
    "Assumed",
    "Curve",
    "SlopeSubset",
    "SlopeSubsets",
    "VaryingSlope",
    "averaged_curves",
    "count_subsets",
    "discrepancy_assumptions",
    "local_fits",
    "nuisance_assumptions",
    "slope_subsets",
    "under",
    "windows",
]

Array = NDArray[Any]
Change = Callable[[HybridModel], HybridModel]
WHITE_NOISE = "white noise only, no truncation"
_AS_GIVEN = "as in the model"
_DISCREPANCIES: tuple[tuple[str, type[Term], Term | None], ...] = (
    ("discrepancy κ/n", Discrepancy, Discrepancy(1.0)),
    ("discrepancy κ/n²", Discrepancy, Discrepancy(2.0)),
    ("without discrepancy", Discrepancy, None),
    ("set-up shift: one scale for orders 0 and 1", SetupShift, SetupShift("together")),
    ("set-up shift: own scales for orders 0 and 1", SetupShift, SetupShift("apart")),
    ("set-up shift of order 0 (zero) only", SetupShift, SetupShift("zero")),
    ("set-up shift of order 1 (centre) only", SetupShift, SetupShift("centre")),
    ("without set-up shift", SetupShift, None),
)
_DRAWS = 8000
_POINTS = 41
_EVERY, _SEARCHED = 729, 100


@dataclass(frozen=True)
class Assumed:
    """The comparison under one assumption: log evidence of both models, second over first [nat]."""

    assumption: str
    log_bayes_factor: float
    log_bayes_factor_error: float
    log_evidence: dict[str, float]

    @property
    def best(self) -> float:
        """The larger of the log evidences."""
        return max(self.log_evidence.values())


def discrepancy_assumptions(models: Collection[HybridModel]) -> dict[str, Change]:
    """Return how circles may differ from one another: what the models say, then one idea after the other changed."""
    changes: dict[str, Change] = {_AS_GIVEN: replace}
    for label, kind, term in _DISCREPANCIES:
        if any(_term(model, kind) != term for model in models):
            changes[label] = methodcaller("without", kind.key()) if term is None else methodcaller("including", term)
    return changes


def nuisance_assumptions(models: Collection[HybridModel], setting: Setting) -> dict[str, Change]:
    """Return every nuisance that can act on the campaign switched over, then the truncation, and nothing but white noise."""
    changes: dict[str, Change] = {_AS_GIVEN: replace}
    for kind in Term.kinds.values():
        if kind is Hysteresis and not setting.both_ways:
            continue
        if any(_term(model, kind) is not None for model in models):
            changes[f"without {kind.words}"] = methodcaller("without", kind.key())
        elif kind is Drift:
            if np.ptp(setting.time_h) > 0.0:
                changes[f"with {kind.words} over time"] = methodcaller("including", Drift("time"))
            if np.ptp(setting.temperature_K) > 0.0:
                changes[f"with {kind.words} over temperature"] = methodcaller("including", Drift("temperature"))
        elif not kind.on_demand:
            changes[f"with {kind.words}"] = methodcaller("including", kind())
    if any(model.prior.truncated for model in models):
        changes["without truncation"] = methodcaller("without", "truncation")
    else:
        changes["with truncation"] = _with_truncation
    return changes | {WHITE_NOISE: methodcaller("without", "truncation", *(kind.key() for kind in Term.kinds.values()))}


def _term(model: HybridModel, kind: type[Term]) -> Term | None:
    return next((term for term in model.nuisances if isinstance(term, kind)), None)


def _with_truncation(model: HybridModel) -> HybridModel:
    return replace(model, prior=replace(model.prior, truncated=True))


def under(pair: Mapping[str, HybridModel], changes: Mapping[str, Change], evidences: Evidences) -> tuple[Assumed, ...]:
    """Return the two models compared under every assumption that leaves a difference between them."""
    assumed = []
    for label, change in changes.items():
        first, second = (change(model) for model in pair.values())
        if first != second:
            one, two = evidences.of(first).evidence, evidences.of(second).evidence
            values = dict(zip(pair, (one.log_value, two.log_value), strict=True))
            assumed.append(Assumed(label, *log_bayes_factor(two, one), values))
    return tuple(assumed)


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


_TOLERANCE = 1e-2
_SPARE, _COMPONENTS = 1e-3, 2048


@one_blas_thread
def local_fits(model: HybridModel, campaign: Campaign, *, width: int = 2, ci_prob: float = 0.95, seed: int = 0) -> pd.DataFrame:
    """Fit constant compliance and geometry to every window of neighbouring force levels.

    Parameters
    ----------
    model : HybridModel
        Nuisances and priors; its degree is set to 0. What belongs to the campaign (two balls, Ĉ) stays the campaign's.
    width : int
        Force levels in a window; 2 gives the paper's adjacent pairs.
    ci_prob : float
        Probability of the equal-tailed credible intervals.

    Returns
    -------
    DataFrame
        One row per window and parameter: force_low_N, force_high_N, force_N (mean of the window's tests), tests, parameter, unit,
        least_squares, least_squares_u (white noise alone; not a number where the window does not determine it), mean, sd,
        ci_low, ci_high; in inside units.

    Raises
    ------
    InputError
        For fewer force levels than the width, a width below 2, a plan, or a flat prior.
    """
    check_campaign(campaign)
    check_comparable(model, campaign)
    check_probability(ci_prob)
    constant = model.with_degree(0)
    whole = constant.bind(campaign)
    levels = np.array([0.5 - 0.5 * ci_prob, 0.5 + 0.5 * ci_prob])
    tables = []
    near = None
    for names in windows(campaign, width):
        bound = whole.keeping(names)
        posterior = HyperPosterior(bound, truncated=bound.truncation.active, near=near)
        near, nodes = posterior.mode, posterior.nodes(_TOLERANCE)
        mean, sd = nodes.moments(spare=_SPARE)
        low, high = nodes.quantiles(levels, seed=seed, components=_COMPONENTS)
        window = replace(campaign.select(names), foreseen=campaign.scope)
        squares = least_squares(window, fixed=constant.fixed).table
        forces = bound.setting.force_N
        columns = {
            "force_low_N": float(forces.min()),
            "force_high_N": float(forces.max()),
            "force_N": float(forces.mean()),
            "tests": len(names),
            "parameter": bound.names,
            "unit": [parameter.unit for parameter in bound.parameters],
            "least_squares": squares["estimate"].to_numpy(),
            "least_squares_u": squares["u"].to_numpy(),
            "mean": mean,
            "sd": sd,
            "ci_low": low,
            "ci_high": high,
        }
        tables.append(pd.DataFrame(columns))
    return pd.concat(tables, ignore_index=True)


def windows(campaign: Campaign, width: int) -> list[tuple[str, ...]]:
    """Names of the tests of every window of ``width`` neighbouring force levels."""
    if width < 2:
        raise InputError(
            f"width must be at least 2 force levels, got {width}. At one force compliance and geometry cannot be separated."
        )
    if campaign.force_levels < width:
        levels = campaign.force_levels
        raise InputError(f"width must be at most the campaign's {levels} force levels, got {width}. Use a smaller one.")
    order = np.argsort(campaign.forces_N, kind="stable")
    forces = campaign.forces_N[order]
    level = np.searchsorted(distinct_forces(forces), forces, side="right") - 1
    names = [campaign.tests[i].name for i in order]
    return [
        tuple(name for name, own in zip(names, level, strict=True) if first <= own < first + width)
        for first in range(level[-1] - width + 2)
    ]
