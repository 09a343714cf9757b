"""compare(): what the readings say about models, how much, and what that rests on.

p(M | y) ∝ p(y | M) p(M), every evidence by exact quadrature; the same again under other assumptions; every test predicted from
the others. Models are compared on the same readings, with the same priors where they share parameters. A change with force has
several explanations, and every compliance a slope or none: every combination is a model, as probable as another beforehand.

Local fits take compliance as constant over two neighbouring force levels: what varies from pair to pair is what a slope would
have to explain. For every pair both the paper's least squares (Tables 7 and 8) and the posterior with nuisances. Pairs overlap
and share ball form, bar length and mount: neighbouring estimates err together, so the scatter of the points says less than their
bars seem to. Geometry is free in every pair, which therefore estimates the tangent d(F C)/dF = C + F dC/dF, not C(F) itself:
the two are one only where compliance is constant.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from operator import methodcaller
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ldbb_bayes.analysis.outliers import FALSE_ALARMS, outliers
from ldbb_bayes.campaign.campaign import Campaign, check_campaign, distinct_forces
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.evidence import Evidences, check_comparable, leave_one_out, log_bayes_factor, probabilities
from ldbb_bayes.inference.nodes import HyperPosterior, Nodes
from ldbb_bayes.inference.posterior import check_probability
from ldbb_bayes.inference.predictive import compliance_curves, fit_quality, least_squares
from ldbb_bayes.jobs import one_blas_thread
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.prior import compliance_unit
from ldbb_bayes.model.terms import CircleScale, Discrepancy, SetupShift, Term
from ldbb_bayes.result import Finite, Number, Numbers, Records, Result, read_result
from ldbb_bayes.units import ranked

__all__ = ["SLOPE_SCALES", "ComparedModel", "ComparedTest", "Comparison", "Sign", "compare", "local_fits", "read_comparison"]

Array = NDArray[Any]
SLOPE_SCALES = (0.03, 0.05, 0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.0, 1.5, 2.0, 3.0)
_REJECTED = 5.0
_QUALITY_DRAWS = 1000
_FINEST, _COARSEST = 1e-4, 1.0
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
_DRAWS = 8000
_POINTS = 41
_EVERY, _SEARCHED = 729, 100


class Sign(StrEnum):
    """How robust the sign of the log Bayes factor is."""

    OPEN = "depends on assumptions that the readings allow"
    HELD = "holds but for assumptions that the readings reject"
    FIRM = "holds under every assumption"


@dataclass(frozen=True)
class Readings:
    """The campaign that was compared on."""

    name: str
    sha256: str


@dataclass(frozen=True)
class Estimate:
    """Posterior mean and sd of a parameter, in its inside unit."""

    unit: str
    mean: float
    sd: float


@dataclass(frozen=True, eq=False)
class ComparedModel:
    """One of the models.

    Attributes
    ----------
    elpd_lofo, elpd_lofo_se : float
        Sum of the leave-one-force-out log densities and its standard error over the tests [nat]; not a number for one test.
    rmse_um : float
        Eq. 34 of the posterior mean prediction, machine and shared nuisances.
    least_squares_rmse_um : float
        Eq. 34 of the paper's least squares (Eq. 31) at the same degree; not a number where the forces do not determine it.
    """

    log_evidence: float
    log_evidence_error: Finite
    posterior_probability: float
    elpd_lofo: Number
    elpd_lofo_se: Number
    rmse_um: float
    least_squares_rmse_um: Number
    degree: int
    parameters: dict[str, Estimate]
    compliance_against_force: dict[str, Curve]


@dataclass(frozen=True, eq=False)
class ComparedTest:
    """One test, left out.

    Attributes
    ----------
    lofo_log_density : dict of model to float
        ln p(y_r | y_−r), exact [nat].
    lofo_p_value, lofo_family_wise_p_value, lofo_worst_order, lofo_p_value_by_order, flag : as in `Outlier`
    """

    force_N: float
    lofo_log_density: dict[str, float]
    lofo_p_value: float
    lofo_family_wise_p_value: float
    lofo_worst_order: int
    lofo_p_value_by_order: dict[int, float]
    flag: bool

    @property
    def stands_out(self) -> bool:
        """Whether the family-wise p-value is below 2 %, flagged or not."""
        return self.lofo_family_wise_p_value < FALSE_ALARMS


@dataclass(frozen=True)
class ScaledSlopes:
    """The comparison with the slopes' prior sd at this multiple of sd(C) over the range of force."""

    slope_scale: float
    log_bayes_factor: float
    error: Finite


@dataclass(frozen=True)
class Difference:
    """A difference of elpd, and its standard error over the tests [nat]."""

    value: Number
    se: Number


@dataclass(frozen=True, eq=False)
class Comparison(Result):
    """Models of one campaign compared; logarithms are natural, parameters in inside units.

    Attributes
    ----------
    log_bayes_factor, log_bayes_factor_error : dict of "model/first model" to float
        [nat].
    explanations : Explanations, optional
        Where the second model is the first with slopes, and has rivals of slopes.
    sensitivity_of : str
        Second model over the first, as both sensitivities are.
    prior_sensitivity_crossings : tuple of float
        Slope scales at which the log Bayes factor changes sign.
    discrepancy_sensitivity : tuple of Assumed
        Ideas of how circles differ from one another, that of the models first, white noise alone last.
    slopes : dict of compliance to VaryingSlope
        Empty where no model has slopes, or evidence alone was asked for.
    slope_subsets : tuple of SlopeSubset
        The most probable first; not all of them where there are too many.
    compliance_against_force : dict of compliance to Curve
        Averaged over the subsets.
    tests : dict of name to ComparedTest
        Empty for one test.
    tolerance, largest_error : float
        Asked of every log evidence, and the largest seen [nat].
    by_emcee : int
        How many evidences emcee and bridge sampling took over, the weights of the nodes not to be trusted.
    """

    campaign: Readings
    models: dict[str, ComparedModel]
    log_bayes_factor: dict[str, float]
    log_bayes_factor_error: dict[str, Finite]
    elpd_difference: dict[str, Difference]
    sensitivity_of: str
    prior_sensitivity: tuple[ScaledSlopes, ...]
    prior_sensitivity_crossings: tuple[float, ...]
    discrepancy_sensitivity: tuple[Assumed, ...]
    slopes: dict[str, VaryingSlope]
    slope_subsets: tuple[SlopeSubset, ...]
    compliance_against_force: dict[str, Curve]
    tests: dict[str, ComparedTest]
    local_fits: Records
    tolerance: float
    largest_error: Finite
    by_emcee: int = 0
    explanations: Explanations | None = None

    @property
    def pair(self) -> tuple[str, str]:
        """The first two models, which sensitivities compare."""
        first, second, *_ = self.models
        return first, second

    @property
    def headline(self) -> tuple[float, float]:
        """ln B of the second model over the first and its error [nat]: averaged over rivals of slopes where there are any."""
        if self.explanations is None:
            return self.log_bayes_factor[self.sensitivity_of], self.log_bayes_factor_error[self.sensitivity_of]
        return self.explanations.averaged.log_bayes_factor, self.explanations.averaged.log_bayes_factor_error

    @property
    def within_tolerance(self) -> bool:
        """Whether every log evidence is as exact as was asked."""
        return self.largest_error <= self.tolerance

    def gain(self, assumed: Assumed) -> float:
        """How much more evidence an assumption has than the models' own [nat]."""
        return assumed.best - self.discrepancy_sensitivity[0].best

    def turning(self) -> list[Assumed]:
        """Assumptions that turn the sign of `headline`, the best supported first; white noise alone is none."""
        sign = np.sign(self.headline[0])
        turned = [a for a in self.discrepancy_sensitivity if np.sign(a.log_bayes_factor) == -sign and a.assumption != WHITE_NOISE]
        return ranked(turned, self.gain)

    def allowed(self, assumed: Assumed) -> bool:
        """Whether the readings do not reject an assumption."""
        return self.gain(assumed) > -_REJECTED

    @property
    def sign(self) -> Sign:
        """How robust the sign of the log Bayes factor is."""
        turning = self.turning()
        if self.prior_sensitivity_crossings or any(map(self.allowed, turning)):
            return Sign.OPEN
        return Sign.HELD if turning else Sign.FIRM

    def preferred_assumption(self) -> Assumed | None:
        """The assumption with most evidence, where the models' own would be rejected for it."""
        best = ranked(self.discrepancy_sensitivity, lambda a: a.best)[0]
        return best if self.gain(best) > _REJECTED else None


def read_comparison(path: Path) -> Comparison:
    """Return the comparison in a folder written by ``ldbb-bayes compare --out``, or in its comparison.json.

    Raises
    ------
    InputError
        When the file is missing, damaged, or not one of ours.
    """
    return read_result(path, "comparison", "compare", Comparison.from_dict)


@one_blas_thread
def compare(
    models: Mapping[str, HybridModel],
    campaign: Campaign,
    *,
    evidence_only: bool = False,
    tolerance: float = 1e-2,
    ci_prob: float = 0.95,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Comparison:
    """Compare models of one campaign.

    Parameters
    ----------
    models : mapping of name to HybridModel
        At least two. Sensitivity is of the second over the first.
    evidence_only : bool
        Only evidence and what it hangs on, three times as fast: no test left out, no slope subsets, no local fits.
    tolerance : float
        Error asked of every log evidence [nat].
    ci_prob : float
        Probability of the bands of C(F) and of the intervals of local fits.
    seed : int
        Of replicates and bands.
    progress : callable, optional
        Called with the steps done and their number.

    Raises
    ------
    InputError
        For fewer than two models, two that are the same, an improper prior, or a plan.
    """
    check_probability(ci_prob)
    _check(models, campaign, tolerance)
    first, second, *_ = models
    pair = {name: models[name] for name in (first, second)}
    largest = max(models.values(), key=lambda model: (model.degree, -len(model.fixed)))
    linear = largest.with_degree(min(largest.degree, 1))
    evidences = Evidences(campaign, tolerance=tolerance)
    scales = SLOPE_SCALES if any(model.degree for model in pair.values()) else ()
    by_scale = {f"slope scale {s:g}": methodcaller("with_slope_scale", s) for s in scales}
    discrepancies = discrepancy_assumptions(pair.values())
    several, subsets = (not evidence_only and wanted for wanted in (len(campaign.tests) > 1, linear.degree > 0))
    windows = campaign.force_levels > 1 and not evidence_only
    rivals = pair[second].rivals != () and pair[first] == pair[second].with_degree(0) != pair[second]
    if progress is not None:
        total = len(models) * (1 + several * len(campaign.tests)) + 2 * (len(by_scale) + len(discrepancies))
        steps = itertools.count(1)
        evidences.progress = lambda: progress(min(next(steps), total), total)

    weighed = dict(zip(models, evidences.of(*models.values()), strict=True))
    left = {
        name: leave_one_out(nodes, tolerance=tolerance, progress=evidences.progress) if several else {}
        for name, nodes in weighed.items()
    }
    others = [name for name in models if name != first]
    factors = {f"{name}/{first}": log_bayes_factor(weighed[name].evidence, weighed[first].evidence) for name in others}
    scaled, circles = (under(pair, changes, evidences) for changes in (by_scale, discrepancies))
    if (explained := explanations(pair, evidences) if rivals else None) is not None:
        circles = (*circles[:1], explained.averaged, explained.alone, *circles[1:])
    slopes, found, curves = slope_subsets(linear, evidences, seed=seed, ci_prob=ci_prob) if subsets else ({}, (), {})
    every = evidences.every + [own.evidence for others in left.values() for own in others.values()]
    # ln p(y_r | y_−r) = ln Z(y) − ln Z(y_−r), shape (tests,).
    densities = {
        name: nodes.evidence.log_value - np.array([others.evidence.log_value for others in left[name].values()])
        for name, nodes in weighed.items()
    }
    return Comparison(
        campaign=Readings(campaign.name, campaign.sha256),
        models=_models(weighed, densities, seed, ci_prob),
        log_bayes_factor={ratio: value for ratio, (value, _) in factors.items()},
        log_bayes_factor_error={ratio: error for ratio, (_, error) in factors.items()},
        elpd_difference={
            f"{name}/{first}": Difference(*_sum_over_tests(densities[name] - densities[first]))
            for name in (others if several else ())
        },
        sensitivity_of=f"{second}/{first}",
        prior_sensitivity=tuple(
            ScaledSlopes(s, a.log_bayes_factor, a.log_bayes_factor_error) for s, a in zip(scales, scaled, strict=True)
        ),
        prior_sensitivity_crossings=_crossings(np.array(scales), np.array([a.log_bayes_factor for a in scaled])),
        discrepancy_sensitivity=circles,
        slopes=slopes,
        slope_subsets=found,
        compliance_against_force=curves,
        tests=_tests(weighed, left, densities, seed, tolerance) if several else {},
        local_fits=local_fits(largest, campaign, ci_prob=ci_prob) if windows else pd.DataFrame(),
        tolerance=tolerance,
        largest_error=max(own.error for own in every),
        by_emcee=sum(own.by_emcee for own in every),
        explanations=explained,
    )


def _check(models: Mapping[str, HybridModel], campaign: Campaign, tolerance: float) -> None:
    check_campaign(campaign)
    if len(models) < 2:
        raise InputError(f"models must be at least two, got {len(models)}. Give for example constant and linear compliance.")
    if not _FINEST <= tolerance <= _COARSEST:
        raise InputError(
            f"tolerance must lie between {_FINEST:g} and {_COARSEST:g} nats, got {tolerance}: there are hundreds of evidences. "
            "For one model log_evidence goes further."
        )
    alike = next(((a, b) for a, b in itertools.combinations(models, 2) if models[a] == models[b]), None)
    if alike is not None:
        raise InputError(
            f"models must differ, got {alike[0]!r} and {alike[1]!r} alike. Leave one out, or change its degree or terms."
        )
    for model in models.values():
        check_comparable(model, campaign)


def _crossings(scale: Array, log_bayes_factor: Array) -> tuple[float, ...]:
    """Scales at which the log Bayes factor changes sign, interpolated in the logarithm of the scale."""
    x, y = np.log(scale), log_bayes_factor
    i = np.flatnonzero(np.sign(y[1:]) * np.sign(y[:-1]) < 0)
    return tuple(np.exp(x[i] + y[i] / (y[i] - y[i + 1]) * (x[i + 1] - x[i])).tolist())


def _sum_over_tests(densities: Array) -> tuple[float, float]:
    """Sum, and its standard error from the scatter over the tests; not a number where there is none."""
    n = len(densities)
    return float(densities.sum()) if n else np.nan, float(np.sqrt(n * densities.var(ddof=1))) if n > 1 else np.nan


def _models(weighed: Mapping[str, Nodes], densities: Mapping[str, Array], seed: int, ci_prob: float) -> dict[str, ComparedModel]:
    share = probabilities(np.array([nodes.evidence.log_value for nodes in weighed.values()]))
    compared = {}
    for (name, nodes), probability in zip(weighed.items(), share, strict=True):
        bound = nodes.bound
        beta, phi = nodes.draw(_QUALITY_DRAWS, np.random.default_rng(seed))
        elpd, elpd_se = _sum_over_tests(densities[name])
        moments = zip(bound.parameters, *nodes.moments(), strict=True)
        compared[name] = ComparedModel(
            log_evidence=nodes.evidence.log_value,
            log_evidence_error=nodes.evidence.error,
            posterior_probability=float(probability),
            elpd_lofo=elpd,
            elpd_lofo_se=elpd_se,
            rmse_um=fit_quality(bound, phi, beta).rmse_um,
            least_squares_rmse_um=_least_squares_rmse(bound.model, bound.campaign),
            degree=bound.model.degree,
            parameters={p.name: Estimate(p.unit, float(mean), float(sd)) for p, mean, sd in moments},
            compliance_against_force=averaged_curves([nodes], np.ones(1), seed, ci_prob),
        )
    return compared


def _least_squares_rmse(model: HybridModel, campaign: Campaign) -> float:
    options: Any = {"reference_force_N": model.reference_force_N, "fixed": model.fixed}
    enough = campaign.force_levels >= model.degree + 2
    return least_squares(campaign, model.degree, **options).quality.rmse_um if enough else np.nan


def _tests(
    weighed: Mapping[str, Nodes],
    left: Mapping[str, Mapping[str, Nodes]],
    densities: Mapping[str, Array],
    seed: int,
    tolerance: float,
) -> dict[str, ComparedTest]:
    """Every test against the others."""
    odd = outliers(weighed, left, seed=seed, tolerance=tolerance)
    forces = next(iter(weighed.values())).bound.setting.force_N
    return {
        name: ComparedTest(
            force_N=float(forces[r]),
            lofo_log_density={model: float(densities[model][r]) for model in weighed},
            lofo_p_value=own.p_value,
            lofo_family_wise_p_value=own.family_wise_p_value,
            lofo_worst_order=own.worst_order,
            lofo_p_value_by_order=dict(enumerate(own.order_p_values)),
            flag=own.flag,
        )
        for r, (name, own) in enumerate(odd.items())
    }


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
    """Return how circles may differ from one another: what the models say, one idea after the other changed, and not at all."""
    changes: dict[str, Change] = {"as in the model": replace}
    for label, kind, term in _DISCREPANCIES:
        if any(next((own for own in model.nuisances if isinstance(own, kind)), None) != term for model in models):
            changes[label] = methodcaller("without", kind.key()) if term is None else methodcaller("including", term)
    return changes | {WHITE_NOISE: methodcaller("without", "truncation", *(kind.key() for kind in Term.kinds.values()))}


def under(pair: Mapping[str, HybridModel], changes: Mapping[str, Change], evidences: Evidences) -> tuple[Assumed, ...]:
    """Return the two models compared under every assumption that leaves a difference between them."""
    assumed = []
    for label, change in changes.items():
        first, second = (change(model) for model in pair.values())
        if first != second:
            one, two = (nodes.evidence for nodes in evidences.of(first, second))
            values = dict(zip(pair, (one.log_value, two.log_value), strict=True))
            assumed.append(Assumed(label, *log_bayes_factor(two, one), values))
    return tuple(assumed)


_SLOPES, _ASKED = "slopes", 1.0


@dataclass(frozen=True)
class Explained:
    """One combination of explanations of a change with force, its log evidence and error, and its posterior probability."""

    by: tuple[str, ...]
    log_evidence: float
    log_evidence_error: Finite
    probability: float


@dataclass(frozen=True)
class Explanations:
    """Every combination of what explains a change with force, each as probable as another beforehand, the likeliest first; the
    two models ``averaged`` over the explanations other than slopes, and ``alone``, with none of these: the paper's question."""

    inclusion_probability: dict[str, float]
    models: tuple[Explained, ...]
    averaged: Assumed
    alone: Assumed

    @property
    def instead(self) -> tuple[str, ...]:
        """What explains the readings as well as slopes, which they would ask for were there nothing else; else nothing."""
        asked = self.alone.log_bayes_factor > _ASKED > self.averaged.log_bayes_factor
        return next(own.by for own in self.models if _SLOPES not in own.by) if asked else ()


def explanations(pair: Mapping[str, HybridModel], evidences: Evidences) -> Explanations:
    """Weigh every combination of slopes, the difference of two models, and of the rivals of slopes that both have."""
    constant, linear = pair.values()
    names = (_SLOPES, *linear.rivals)
    combined = [tuple(itertools.compress(names, there)) for there in itertools.product((True, False), repeat=len(names))]
    weighed = evidences.of(*((linear if _SLOPES in by else constant).with_rivals(*by) for by in combined))
    value, error = (np.array([getattr(nodes.evidence, part) for nodes in weighed]) for part in ("log_value", "error"))
    share = probabilities(value)
    found = map(Explained, combined, value.tolist(), error.tolist(), share.tolist())

    def assumed(label: str, log_evidence: Array, error: float) -> Assumed:
        slopes, none = log_evidence.tolist()
        return Assumed(label, slopes - none, error, dict(zip(pair, (none, slopes), strict=True)))

    by_slopes, errors = value.reshape(2, -1), error.reshape(2, -1)
    averaged = np.logaddexp.reduce(by_slopes, axis=1) - np.log(by_slopes.shape[1])
    return Explanations(
        {name: float(share[[name in by for by in combined]].sum()) for name in names},
        tuple(ranked(found, lambda own: own.probability)),
        assumed("averaged over other explanations", averaged, float(errors.max(axis=1).sum())),
        assumed("no other explanation", by_slopes[:, -1], float(errors[:, -1].sum())),
    )


@dataclass(frozen=True)
class SlopeSubset:
    """One subset: the compliances that vary with force, its log evidence and posterior probability."""

    varying: tuple[str, ...]
    log_evidence: float
    probability: float


@dataclass(frozen=True)
class VaryingSlope:
    """Posterior probability that a compliance varies with force."""

    inclusion_probability: float


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


def slope_subsets(
    model: HybridModel, evidences: Evidences, *, seed: int, ci_prob: float = 0.95
) -> tuple[dict[str, VaryingSlope], tuple[SlopeSubset, ...], dict[str, Curve]]:
    """Every compliance's probability of a slope, the subsets of the slopes of a model of degree 1, the most probable first, and
    C(F) averaged over them."""
    slopes = _slopes(model, evidences.campaign)

    def of(there: tuple[bool, ...]) -> Nodes:
        return evidences.of(model.fixing(*(slope for slope, own in zip(slopes.values(), there, strict=True) if not own)))[0]

    few = 2 ** len(slopes) <= _EVERY
    weighed = (
        {there: of(there) for there in itertools.product((False, True), repeat=len(slopes))}
        if few
        else _best_first(len(slopes), of)
    )
    log_evidence = np.array([nodes.evidence.log_value for nodes in weighed.values()])
    share = probabilities(log_evidence)
    subsets = [
        SlopeSubset(tuple(itertools.compress(slopes, there)), *values)
        for there, *values in zip(weighed, log_evidence.tolist(), share.tolist(), strict=True)
    ]
    inclusion = (share @ np.array(list(weighed))).tolist()
    return (
        {name: VaryingSlope(probability) for name, probability in zip(slopes, inclusion, strict=True)},
        tuple(ranked(subsets, lambda subset: subset.probability)),
        averaged_curves(list(weighed.values()), share, seed, ci_prob),
    )


def _slopes(model: HybridModel, campaign: Campaign) -> dict[str, str]:
    """Compliances that have a slope, and its name."""
    return {p.compliance: p.name for p in model.bind(campaign).parameters if p.group == "slope"}


def _best_first(slopes: int, of: Callable[[tuple[bool, ...]], Nodes]) -> dict[tuple[bool, ...], Nodes]:
    """From no slope and from all: the neighbours (one slope changed) of the best subset not yet expanded, until there are
    ``_SEARCHED``."""
    seen = {there: of(there) for there in ((False,) * slopes, (True,) * slopes)}
    expanded: set[tuple[bool, ...]] = set()
    while len(seen) < _SEARCHED and len(expanded) < len(seen):
        best = max((there for there in seen if there not in expanded), key=lambda there: seen[there].evidence.log_value)
        expanded.add(best)
        for near in ((*best[:i], not best[i], *best[i + 1 :]) for i in range(slopes)):
            if near not in seen and len(seen) < _SEARCHED:
                seen[near] = of(near)
    return seen


def averaged_curves(weighed: Sequence[Nodes], share: Array, seed: int, ci_prob: float) -> dict[str, Curve]:
    """C(F), see `compliance_curves`, over the tested forces, averaged over models with these probabilities."""
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
        name.label: Curve(compliance_unit(name), force, mean[:, j], median[:, j], low[:, j], high[:, j], ci_prob)
        for j, name in enumerate(bound.compliances)
    }


_TOLERANCE, _SPARE, _COMPONENTS = 1e-2, 1e-3, 2048


@one_blas_thread
def local_fits(model: HybridModel, campaign: Campaign, *, ci_prob: float = 0.95, seed: int = 0) -> pd.DataFrame:
    """Fit constant compliance and geometry to every pair of neighbouring force levels.

    Parameters
    ----------
    model : HybridModel
        Nuisances and priors; its degree is set to 0. What belongs to the campaign (two balls, Ĉ) stays the campaign's.
    ci_prob : float
        Probability of the equal-tailed credible intervals.

    Returns
    -------
    DataFrame
        One row per pair and parameter: force_low_N, force_high_N, force_N (mean of the pair's tests), tests, parameter, unit,
        least_squares, least_squares_u (white noise alone; not a number where the pair does not determine it), mean, sd, ci_low,
        ci_high; in inside units.

    Raises
    ------
    InputError
        For one force level, a plan, or a flat prior.
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
        near, nodes = posterior.plain.mode, posterior.nodes(_TOLERANCE)
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


def _pairs(campaign: Campaign) -> list[tuple[str, ...]]:
    """Names of the tests of every two neighbouring force levels."""
    if campaign.force_levels < 2:
        raise InputError("local fits must have at least two force levels, got one: compliance and geometry cannot be separated.")
    order = np.argsort(campaign.forces_N, kind="stable")
    forces = campaign.forces_N[order]
    level = np.searchsorted(distinct_forces(forces), forces, side="right") - 1
    names = [campaign.tests[i].name for i in order]
    return [
        tuple(name for name, own in zip(names, level, strict=True) if own in (first, first + 1)) for first in range(level[-1])
    ]
