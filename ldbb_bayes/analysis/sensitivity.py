"""What a comparison rests on: two models under other assumptions, what else explains a change with
force, subsets of slopes.

Slopes, joint load, a curved mount and a curved force law may each explain a change with force, and
every compliance may have a slope or none: every combination is a model, as probable as another
beforehand, and the exact evidence says how probable it is afterwards. C(F) is averaged over all
subsets of slopes; where there are too many (several planes), over those that a search from the best
to its neighbours visits first.

Local fits take compliance as constant over two neighbouring force levels: what varies from pair to
pair is what a slope would have to explain. For every pair both the paper's least squares (Tables 7
and 8) and the posterior with nuisances. Pairs overlap and share ball form, bar length and mount:
neighbouring estimates err together, so the scatter of the points says less than their bars seem to.
Geometry is free in every pair, which therefore estimates the tangent d(F C)/dF = C + F dC/dF, not
C(F) itself: the two are one only where compliance is constant.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import methodcaller

import numpy as np
import pandas as pd

from ldbb_bayes.campaign.campaign import Campaign, check_campaign, distinct_forces
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.coefficients import compliance_curves
from ldbb_bayes.inference.evidence import (
    Evidences,
    check_comparable,
    log_bayes_factor,
    probabilities,
)
from ldbb_bayes.inference.least_squares import least_squares
from ldbb_bayes.inference.nodes import HyperPosterior, Nodes
from ldbb_bayes.inference.summary import check_probability
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.prior import compliance_unit
from ldbb_bayes.model.terms import CircleScale, Discrepancy, SetupShift, Term
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, Finite, Numbers, readable
from ldbb_bayes.units import ranked

__all__ = [
    "WHITE_NOISE",
    "Assumed",
    "Curve",
    "Explanations",
    "SlopeSubset",
    "VaryingSlope",
    "averaged_curves",
    "changed",
    "count_subsets",
    "discrepancy_assumptions",
    "explanations",
    "local_fits",
    "slope_subsets",
    "subsets",
    "under",
]

Change = Callable[[HybridModel], HybridModel]
WHITE_NOISE = "white noise only, no truncation"
_DISCREPANCIES: tuple[tuple[str, type[Term], Term | None], ...] = (
    ("discrepancy κ/n", Discrepancy, Discrepancy(1.0)),
    ("discrepancy κ/n²", Discrepancy, Discrepancy(2.0)),
    ("without discrepancy", Discrepancy, None),
    ("set-up shift: one scale for orders 0 and 1", SetupShift, SetupShift("together")),
    ("set-up shift: own scales for orders 0 and 1", SetupShift, SetupShift("apart")),
    ("set-up shift of order 0 (zero) only", SetupShift, SetupShift("zero")),
    ("set-up shift of order 1 (centre) only", SetupShift, SetupShift("centre")),
    ("without set-up shift", SetupShift, None),
    ("circles of one scatter", CircleScale, None),
)
_DRAWS = 4000
_POINTS = 41
_EVERY = 729
_SEARCHED = 100


@dataclass(frozen=True)
class Assumed:
    """The comparison under one assumption: log evidence of both models, second over first [nat]."""

    assumption: str
    log_bayes_factor: float
    log_bayes_factor_error: Finite
    log_evidence: dict[str, float]

    @property
    def best(self) -> float:
        """The larger of the log evidences."""
        return max(self.log_evidence.values())


def discrepancy_assumptions(models: Collection[HybridModel]) -> dict[str, Change]:
    """Return how circles may differ from one another: what the models say, one idea after the other
    changed, and not at all."""
    changes: dict[str, Change] = {"as in the model": replace}
    for label, kind, term in _DISCREPANCIES:
        if any(
            next((own for own in model.nuisances if isinstance(own, kind)), None) != term
            for model in models
        ):
            changes[label] = (
                methodcaller("without", kind.key())
                if term is None
                else methodcaller("with_term", term)
            )
    return changes | {
        WHITE_NOISE: methodcaller(
            "without", "truncation", *(kind.key() for kind in Term.kinds.values())
        )
    }


def changed(
    pair: Iterable[HybridModel], changes: Mapping[str, Change]
) -> dict[str, tuple[HybridModel, ...]]:
    """Return the two models under every assumption that leaves a difference between them."""
    both = {label: tuple(map(change, pair)) for label, change in changes.items()}
    return {label: models for label, models in both.items() if models[0] != models[1]}


def under(
    names: Iterable[str],
    assumptions: Mapping[str, Sequence[HybridModel]],
    weigh: Callable[..., Sequence[Nodes]],
) -> tuple[Assumed, ...]:
    """Return the two models compared under every assumption."""
    assumed = []
    for label, models in assumptions.items():
        one, two = (nodes.evidence for nodes in weigh(*models))
        values = dict(zip(names, (one.log_value, two.log_value), strict=True))
        assumed.append(Assumed(label, *log_bayes_factor(two, one), values))
    return tuple(assumed)


_SLOPES = "slopes"
_ASKED = 1.0


@dataclass(frozen=True)
class Explained:
    """One combination of explanations of a change with force, its log evidence and error, and its
    posterior probability."""

    by: tuple[str, ...]
    log_evidence: float
    log_evidence_error: Finite
    probability: float


@dataclass(frozen=True)
class Explanations:
    """Every combination of what explains a change with force, each as probable as another
    beforehand, the likeliest first; the two models ``averaged`` over the explanations other than
    slopes, and ``alone``, with none of these: the paper's question."""

    inclusion_probability: dict[str, float]
    models: tuple[Explained, ...]
    averaged: Assumed
    alone: Assumed

    @property
    def instead(self) -> tuple[str, ...]:
        """What explains the readings as well as slopes, which they would ask for were there nothing
        else; else nothing."""
        asked = self.alone.log_bayes_factor > _ASKED > self.averaged.log_bayes_factor
        return next(own.by for own in self.models if _SLOPES not in own.by) if asked else ()


def subsets(names: Sequence[str]) -> list[tuple[str, ...]]:
    """Return every combination of names, all of them first."""
    return [
        tuple(itertools.compress(names, there))
        for there in itertools.product((True, False), repeat=len(names))
    ]


def explanations(pair: Mapping[str, HybridModel], evidences: Evidences) -> Explanations:
    """Weigh every combination of slopes, the difference of two models, and of the rivals of slopes
    that both have."""
    constant, linear = pair.values()
    names = (_SLOPES, *linear.rivals)
    combined = subsets(names)
    weighed = evidences.of(
        *((linear if _SLOPES in by else constant).with_rivals(*by) for by in combined)
    )
    value, error = (
        np.array([getattr(nodes.evidence, part) for nodes in weighed])
        for part in ("log_value", "error")
    )
    share = probabilities(value)
    found = map(Explained, combined, value.tolist(), error.tolist(), share.tolist())

    def assumed(label: str, log_evidence: Array, error: float) -> Assumed:
        slopes, none = log_evidence.tolist()
        return Assumed(label, slopes - none, error, dict(zip(pair, (none, slopes), strict=True)))

    by_slopes = value.reshape(2, -1)
    errors = error.reshape(2, -1)
    averaged = np.logaddexp.reduce(by_slopes, axis=1) - np.log(by_slopes.shape[1])
    return Explanations(
        {name: float(share[[name in by for by in combined]].sum()) for name in names},
        tuple(ranked(found, lambda own: own.probability)),
        assumed("averaged over other explanations", averaged, float(errors.max(axis=1).sum())),
        assumed("no other explanation", by_slopes[:, -1], float(errors[:, -1].sum())),
    )


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


# As exact as a figure needs: sd within 2 %.
_TOLERANCE = 5e-2
_SPARE = 1e-3
_POINTS_INSIDE = 128
_COMPONENTS = 2048


@one_blas_thread
def local_fits(
    model: HybridModel, campaign: Campaign, *, ci_prob: float = 0.95, seed: int = 0
) -> pd.DataFrame:
    """Fit constant compliance and geometry to every pair of neighbouring force levels.

    InputError for one force level, a plan, or a flat prior.

    Parameters
    ----------
    model : nuisances and priors; its degree is set to 0. What belongs to the campaign (two balls,
        Ĉ) stays the campaign's.
    ci_prob : probability of the equal-tailed credible intervals.

    Returns
    -------
    One row per pair and parameter: force_low_N, force_high_N, force_N (mean of the pair's tests),
    tests, parameter, unit, least_squares, least_squares_u (white noise alone; not a number where
    the pair does not determine it), mean, sd, ci_low, ci_high; in inside units.
    """
    check_campaign(campaign)
    check_comparable(model, campaign)
    check_probability(ci_prob)
    # A pair of circles does not tell an odd one.
    constant = model.with_degree(0).without("circle-scale")
    whole = constant.bind(campaign)
    levels = np.array([0.5 - 0.5 * ci_prob, 0.5 + 0.5 * ci_prob])
    tables = []
    near = None
    for names in _pairs(campaign):
        bound = whole.keeping(names)
        posterior = HyperPosterior(bound, truncated=bound.truncation.active, near=near)
        near = posterior.plain.mode
        nodes = posterior.nodes(_TOLERANCE)
        mean, sd = nodes.moments(spare=_SPARE, points=_POINTS_INSIDE)
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
    return readable(
        pd.concat(tables, ignore_index=True),
        f"Fits of neighbouring forces, {100 * ci_prob:g} % intervals",
    )


def _pairs(campaign: Campaign) -> list[tuple[str, ...]]:
    """Names of the tests of every two neighbouring force levels."""
    if campaign.force_levels < 2:
        raise InputError(
            "local fits must have at least two force levels, got one: compliance and geometry"
            " cannot be separated."
        )
    order = np.argsort(campaign.forces_N, kind="stable")
    forces = campaign.forces_N[order]
    level = np.searchsorted(distinct_forces(forces), forces, side="right") - 1
    names = [campaign.tests[i].name for i in order]
    return [
        tuple(name for name, at in zip(names, level, strict=True) if at in (first, first + 1))
        for first in range(level[-1])
    ]
