"""compare(): what the readings say about models, how much, and what that rests on; which tests do
not belong; `average`.

p(M | y) ∝ p(y | M) p(M), every evidence by exact quadrature; the same again under other
assumptions; every test predicted from the others. Models are compared on the same readings, with
the same priors where they share parameters.

Does every test belong with the others? Each is compared with circles that the others expect in its
place. p-values are exact under the models compared: replicates come from p(y_r | y_−r), the models
weighted by what the other tests say of them; the distance of a circle is measured alike for
readings and replicates, order by order, and the smallest p-value of a test is judged by how small
the replicates' smallest are. Over the tests the family-wise error is held by Holm's method, step by
step: a flagged test is taken out before the rest is looked at again, or it would make its
neighbours look odd.

p(β, φ | y) = Σ_M p(M | y) p(β, φ | y, M): the average over models, each by its exact posterior
probability. They differ in whether compliance changes with force and in what else explains such a
change, the rivals of slopes; every combination is as probable as another beforehand, as in
`explanations`. A coefficient that a model lacks is zero in its draws, so that the share of zeros is
the probability that it is not there (Hoeting, Madigan, Raftery and Volinsky 1999).
"""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from enum import StrEnum
from functools import partial
from operator import methodcaller
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from scipy import special

from ldbb_bayes.analysis import sensitivity
from ldbb_bayes.analysis.multiple_testing import holm
from ldbb_bayes.analysis.sensitivity import (
    WHITE_NOISE,
    Assumed,
    Curve,
    Explanations,
    SlopeSubset,
    VaryingSlope,
)
from ldbb_bayes.campaign.campaign import Campaign, check_campaign
from ldbb_bayes.errors import require
from ldbb_bayes.inference import evidence
from ldbb_bayes.inference.coefficients import ModelDraws
from ldbb_bayes.inference.evidence import (
    Evidences,
    check_comparable,
    leave_one_out,
    log_bayes_factor,
    probabilities,
)
from ldbb_bayes.inference.fit import Concern, ConcernKind, fit_of_parts
from ldbb_bayes.inference.least_squares import least_squares
from ldbb_bayes.inference.mcmc import StoppingRule, assess
from ldbb_bayes.inference.nodes import Evidence, HyperPosterior, Nodes
from ldbb_bayes.inference.posterior import build_tree
from ldbb_bayes.inference.prediction import replicate_left_out
from ldbb_bayes.inference.residuals import fit_quality, harmonics_of
from ldbb_bayes.inference.sample import densities_of, groups_of, prior_draws_of, record_from
from ldbb_bayes.inference.summary import check_probability
from ldbb_bayes.model.fourier import MAX_ORDER, ORDERS
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.parallel import ahead, one_blas_thread
from ldbb_bayes.results import Array, Finite, Number, Records, Result, read_result, readable
from ldbb_bayes.units import ranked

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "FALSE_ALARMS",
    "SLOPE_SCALES",
    "ComparedModel",
    "ComparedTest",
    "Comparison",
    "Outlier",
    "Sign",
    "average",
    "belonging",
    "compare",
    "outliers",
    "read_comparison",
]

SLOPE_SCALES = (0.03, 0.05, 0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.0, 1.5, 2.0, 3.0)
FALSE_ALARMS = 0.02  # of which a test is flagged, over all tests
_REJECTED = 5.0
_FAR = 10.0
_QUALITY_DRAWS = 1000
_SPARE = 1e-4
_POINTS = 256
_FINEST = 1e-4
_COARSEST = 1.0


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
    """One of the models."""

    log_evidence: float
    log_evidence_error: Finite
    posterior_probability: float
    #: sum of the leave-one-force-out log densities [nat]; not a number for one test
    elpd_lofo: Number
    elpd_lofo_se: Number  #: its standard error over the tests
    rmse_um: float  #: Eq. 34 of the posterior mean prediction, machine and shared nuisances
    #: Eq. 34 of the paper's least squares (Eq. 31); not a number where forces do not determine it
    least_squares_rmse_um: Number
    degree: int
    parameters: dict[str, Estimate]
    compliance_against_force: dict[str, Curve]


@dataclass(frozen=True, eq=False)
class ComparedTest:
    """One test, left out; p-values, worst order and flag as in `Outlier`."""

    force_N: float
    lofo_log_density: dict[str, float]  #: by model: ln p(y_r | y_−r), exact [nat]
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
    """The comparison with the slopes' prior sd at this multiple of sd(C) over the range of
    force."""

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
    """Models of one campaign compared; logarithms are natural, parameters in inside units."""

    campaign: Readings
    models: dict[str, ComparedModel]  #: by the names given
    log_bayes_factor: dict[str, float]  #: by "model/first model"
    log_bayes_factor_error: dict[str, Finite]  #: likewise [nat]
    elpd_difference: dict[str, Difference]  #: by the same: leaving one force out
    sensitivity_of: str  #: second model over the first, as both sensitivities are
    prior_sensitivity: tuple[ScaledSlopes, ...]  #: ln B by the scale of the slopes' prior
    #: slope scales at which the log Bayes factor changes sign
    prior_sensitivity_crossings: tuple[float, ...]
    #: ideas of how circles differ, the models' first, white noise alone last
    discrepancy_sensitivity: tuple[Assumed, ...]
    #: by compliance; empty where no model has slopes, or evidence alone was asked for
    slopes: dict[str, VaryingSlope]
    #: the most probable first; not all of them where there are too many
    slope_subsets: tuple[SlopeSubset, ...]
    compliance_against_force: dict[str, Curve]  #: averaged over the subsets
    tests: dict[str, ComparedTest]  #: empty for one test
    local_fits: Records  #: as of `local_fits`
    #: asked of every log evidence [nat]; a tenth of a nat of assumptions that the readings reject
    #: by ten
    tolerance: float
    largest_error: Finite  #: that was seen, of these assumptions aside
    #: evidences that emcee and bridge sampling took over, the weights of the nodes not to be
    #: trusted
    by_emcee: int = 0
    #: where the second model is the first with slopes, and has rivals of slopes
    explanations: Explanations | None = None

    @property
    def pair(self) -> tuple[str, str]:
        """The first two models, which sensitivities compare."""
        first, second, *_ = self.models
        return first, second

    @property
    def headline(self) -> tuple[float, float]:
        """ln B of the second model over the first and its error [nat]: averaged over rivals of
        slopes where there are any."""
        if self.explanations is None:
            return (
                self.log_bayes_factor[self.sensitivity_of],
                self.log_bayes_factor_error[self.sensitivity_of],
            )
        return (
            self.explanations.averaged.log_bayes_factor,
            self.explanations.averaged.log_bayes_factor_error,
        )

    @property
    def within_tolerance(self) -> bool:
        """Whether every log evidence is as exact as was asked."""
        return self.largest_error <= self.tolerance

    def gain(self, assumed: Assumed) -> float:
        """How much more evidence an assumption has than the models' own [nat]."""
        return assumed.best - self.discrepancy_sensitivity[0].best

    def turning(self) -> list[Assumed]:
        """Assumptions that turn the sign of `headline`, the best supported first; white noise alone
        is none."""
        sign = np.sign(self.headline[0])
        turned = [
            a
            for a in self.discrepancy_sensitivity
            if np.sign(a.log_bayes_factor) == -sign and a.assumption != WHITE_NOISE
        ]
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


def read_comparison(path: str | os.PathLike[str]) -> Comparison:
    """Return the comparison in a folder written by ``ldbb-bayes compare --out``, or in its
    comparison.json.

    InputError when the file is missing, damaged, or not one of ours.
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
    evidences: Evidences | None = None,
    executor: Executor | None = None,
) -> Comparison:
    """Compare models of one campaign.

    InputError for fewer than two models, two that are the same, an improper prior, or a plan.

    Parameters
    ----------
    models : mapping of name to HybridModel
        At least two. Sensitivity is of the second over the first.
    evidence_only : only evidence and what it hangs on, three times as fast: no test left out, no
        slope subsets, no local fits.
    tolerance : error asked of every log evidence [nat].
    ci_prob : probability of the bands of C(F) and of the intervals of local fits.
    seed : of replicates and bands.
    progress : called with the steps done and their number.
    evidences : nodes to use and to add to, of this campaign: those that `average` uses too. Their
        tolerance is the one asked for.
    executor : works out local fits and other assumptions meanwhile, with the same result; see
        `process_executor`. Default: here.
    """
    check_probability(ci_prob)
    evidences = _checked(models, campaign, evidences or Evidences(campaign, tolerance=tolerance))
    tolerance = evidences.tolerance
    pair = {name: models[name] for name in tuple(models)[:2]}
    first, second = pair
    largest = max(models.values(), key=lambda model: (model.degree, -len(model.fixed)))
    linear = largest.with_degree(min(largest.degree, 1))
    scales = SLOPE_SCALES if any(model.degree for model in pair.values()) else ()
    by_scale = sensitivity.changed(
        pair.values(), {f"slope scale {s:g}": methodcaller("with_slope_scale", s) for s in scales}
    )
    as_is, *odd = sensitivity.changed(
        pair.values(), sensitivity.discrepancy_assumptions(pair.values())
    ).items()
    wishes = (len(campaign.tests) > 1, linear.degree > 0, campaign.force_levels > 1)
    several, subsets, windows = (not evidence_only and wanted for wanted in wishes)
    local = ahead(
        partial(sensitivity.local_fits, largest, campaign, ci_prob=ci_prob),
        executor if windows else None,
    )
    rivals = (
        pair[second].rivals != () and pair[first] == pair[second].with_degree(0) != pair[second]
    )
    if progress is not None:
        total = len(models) * (1 + several * len(campaign.tests)) + 2 * (
            len(by_scale) + 1 + (0 if executor else len(odd))
        )
        total += rivals * 2 ** (1 + len(pair[second].rivals)) + (
            sensitivity.count_subsets(linear, campaign) if subsets else 0
        )
        evidences.progress = map(progress, itertools.count(1), itertools.repeat(total)).__next__

    weighed = dict(zip(models, evidences.of(*models.values()), strict=True))
    least = max(weighed[name].evidence.log_value for name in pair) - _FAR
    apart = evidences.apart()
    apart.progress = apart.progress if executor else evidences.progress
    elsewhere = ahead(partial(_under, tuple(pair), dict(odd), apart, least), executor)
    left = (
        leave_one_out(weighed, tolerance=tolerance, progress=evidences.progress) if several else {}
    )
    others = [name for name in models if name != first]
    factors = {
        f"{name}/{first}": log_bayes_factor(weighed[name].evidence, weighed[first].evidence)
        for name in others
    }
    scaled, circles = (
        sensitivity.under(pair, assumed, evidences.of) for assumed in (by_scale, dict([as_is]))
    )
    explained = sensitivity.explanations(pair, evidences) if rivals else None
    slopes, found, curves = (
        sensitivity.slope_subsets(linear, evidences, seed=seed, ci_prob=ci_prob)
        if subsets
        else ({}, (), {})
    )
    circles += () if explained is None else (explained.averaged, explained.alone)
    values = {
        name: np.array([own.evidence.log_value for own in left.get(name, {}).values()])
        for name in weighed
    }
    densities = {
        name: nodes.evidence.log_value - values[name] for name, nodes in weighed.items()
    }  # ln p(y_r | y_−r), (tests,)
    described = _models(weighed, densities, seed, ci_prob)
    tests = _tests(weighed, left, densities, seed, tolerance)
    (assumed, theirs), evidences.progress = elsewhere(), lambda: None
    every = [
        *evidences.every,
        *theirs,
        *(own.evidence for others in left.values() for own in others.values()),
    ]
    return Comparison(
        campaign=Readings(campaign.name, campaign.sha256),
        models=described,
        log_bayes_factor={ratio: value for ratio, (value, _) in factors.items()},
        log_bayes_factor_error={ratio: error for ratio, (_, error) in factors.items()},
        elpd_difference={
            f"{name}/{first}": Difference(*_sum_over_tests(densities[name] - densities[first]))
            for name in (others if several else ())
        },
        sensitivity_of=f"{second}/{first}",
        prior_sensitivity=tuple(
            ScaledSlopes(s, a.log_bayes_factor, a.log_bayes_factor_error)
            for s, a in zip(scales, scaled, strict=True)
        ),
        prior_sensitivity_crossings=_crossings(
            np.array(scales), np.array([a.log_bayes_factor for a in scaled])
        ),
        discrepancy_sensitivity=circles + assumed,
        slopes=slopes,
        slope_subsets=found,
        compliance_against_force=curves,
        tests=tests,
        local_fits=local() if windows else pd.DataFrame(),
        tolerance=tolerance,
        largest_error=max(own.error for own in every),
        by_emcee=sum(own.by_emcee for own in every),
        explanations=explained,
    )


def _checked(
    models: Mapping[str, HybridModel], campaign: Campaign, evidences: Evidences
) -> Evidences:
    check_campaign(campaign)
    cure = "Give for example constant and linear compliance."
    require(len(models) > 1, f"models must be at least two, got {len(models)}. {cure}")
    got = (
        f"got {evidences.tolerance}: evidences are hundreds. For one model log_evidence goes"
        " further."
    )
    fine = _FINEST <= evidences.tolerance <= _COARSEST
    require(fine, f"tolerance must lie between {_FINEST:g} and {_COARSEST:g} nats, {got}")
    for one, other in itertools.combinations(models, 2):
        cure = "Leave one out, or change its degree or terms."
        require(
            models[one] != models[other],
            f"models must differ, got {one!r} and {other!r} alike. {cure}",
        )
    for model in models.values():
        check_comparable(model, campaign)
    return evidences.of_campaign(campaign)


def _under(
    names: Sequence[str],
    assumptions: Mapping[str, Sequence[HybridModel]],
    evidences: Evidences,
    least: float,
) -> tuple[tuple[Assumed, ...], list[Evidence]]:
    """The models under assumptions, roughly where these are rejected, and the evidences that are
    not rough."""
    return (
        sensitivity.under(names, assumptions, partial(evidences.unless_rejected, least)),
        evidences.every,
    )


def _crossings(scale: Array, log_bayes_factor: Array) -> tuple[float, ...]:
    """Scales at which the log Bayes factor changes sign, interpolated in the logarithm of the
    scale."""
    x = np.log(scale)
    y = log_bayes_factor
    i = np.flatnonzero(np.sign(y[1:]) * np.sign(y[:-1]) < 0)
    return tuple(np.exp(x[i] + y[i] / (y[i] - y[i + 1]) * (x[i + 1] - x[i])).tolist())


def _sum_over_tests(densities: Array) -> tuple[float, float]:
    """Sum, and its standard error from the scatter over the tests; not a number where there is
    none."""
    n = len(densities)
    return float(densities.sum()) if n else np.nan, (
        float(np.sqrt(n * densities.var(ddof=1))) if n > 1 else np.nan
    )


def _models(
    weighed: Mapping[str, Nodes], densities: Mapping[str, Array], seed: int, ci_prob: float
) -> dict[str, ComparedModel]:
    share = probabilities(np.array([nodes.evidence.log_value for nodes in weighed.values()]))
    compared = {}
    for (name, nodes), probability in zip(weighed.items(), share, strict=True):
        bound, model, campaign = nodes.bound, nodes.bound.model, nodes.bound.campaign
        options: Any = {"reference_force_N": model.reference_force_N, "fixed": model.fixed}
        enough = campaign.force_levels >= model.degree + 2
        squares = (
            least_squares(campaign, model.degree, **options).quality.rmse_um if enough else np.nan
        )
        beta, phi = nodes.draw(_QUALITY_DRAWS, np.random.default_rng(seed))
        elpd, elpd_se = _sum_over_tests(densities[name])
        moments = zip(bound.parameters, *nodes.moments(spare=_SPARE, points=_POINTS), strict=True)
        compared[name] = ComparedModel(
            log_evidence=nodes.evidence.log_value,
            log_evidence_error=nodes.evidence.error,
            posterior_probability=float(probability),
            elpd_lofo=elpd,
            elpd_lofo_se=elpd_se,
            rmse_um=fit_quality(bound, phi, beta).rmse_um,
            least_squares_rmse_um=squares,
            degree=model.degree,
            parameters={
                p.name: Estimate(p.unit, float(mean), float(sd)) for p, mean, sd in moments
            },
            compliance_against_force=sensitivity.averaged_curves(
                [nodes], np.ones(1), seed, ci_prob
            ),
        )
    return compared


def _tests(
    weighed: Mapping[str, Nodes],
    left: Mapping[str, Mapping[str, Nodes]],
    densities: Mapping[str, Array],
    seed: int,
    tolerance: float,
) -> dict[str, ComparedTest]:
    """Every test against the others; none where none was left out."""
    odd = outliers(weighed, left, seed=seed, tolerance=tolerance) if left else {}
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


# ---- tests that do not belong

_REPLICATES = 20_000
_EACH = 400
_CLOSER = 0.05
_TOGETHER = 5
_MORE = 2
_FEWER_TOGETHER = 2


@dataclass(frozen=True)
class Outlier:
    """One test against what the others, flagged ones aside, expect. Two tests that disagree with
    one another have a small p-value both, and no flag: nothing says which of them is wrong."""

    # probability that a circle of the same machine stands out so much in any Fourier order
    p_value: float
    family_wise_p_value: float  # the same, allowing for all tests (Holm)
    order_p_values: tuple[float, ...]  # of orders 0 … 12, each by itself
    worst_order: int
    # the family-wise p-value is below 2 %, and more than half of the tests agree without it
    flag: bool
    distance: float  # in the worst order [−ln of a χ² tail]; it breaks ties of p


@one_blas_thread
def belonging(
    models: Mapping[str, HybridModel],
    campaign: Campaign,
    *,
    seed: int = 1,
    tolerance: float = 1e-2,
    replicates: int | None = None,
) -> pd.DataFrame:
    """Which tests do not belong with the others, under one or several models of a campaign of at
    least two tests.

    InputError for fewer than two tests, a plan, or an improper prior.

    Parameters
    ----------
    models : mapping of name to HybridModel
        Weighted by what the other tests say of them.
    seed : of the replicates.
    tolerance : error of every log evidence [nat].
    replicates : circles drawn in the place of each test; no p-value is below one over their number.
        Default 20,000, or more.

    Returns
    -------
    One row per test: force_N, p_value, family_wise_p_value, flag, and order_0 … order_12, the
    p-values by Fourier order.
    """
    check_campaign(campaign)
    require(
        len(campaign.tests) > 1,
        "a campaign must have at least two tests to compare them, got one. Add tests.",
    )
    least = int(len(campaign.tests) / (_MORE * FALSE_ALARMS)) + 1
    few = replicates is not None and replicates < least
    require(
        not few,
        f"replicates must be at least {least} to judge {len(campaign.tests)} tests, got"
        f" {replicates}. Leave them out.",
    )
    evidences = Evidences(campaign, tolerance=tolerance)
    weighed = dict(zip(models, evidences.of(*models.values()), strict=True))
    left = leave_one_out(weighed, tolerance=tolerance)
    judged = outliers(weighed, left, seed=seed, tolerance=tolerance, replicates=replicates)
    rows = {}
    for test in campaign.tests:
        own = judged[test.name]
        seen = {
            "force_N": test.force_N,
            "p_value": own.p_value,
            "family_wise_p_value": own.family_wise_p_value,
            "flag": own.flag,
        }
        rows[test.name] = seen | {f"order_{n}": p for n, p in enumerate(own.order_p_values)}
    return readable(pd.DataFrame.from_dict(rows, orient="index"), "Which tests do not belong")


def outliers(
    models: Mapping[str, Nodes],
    left: Mapping[str, Mapping[str, Nodes]],
    *,
    seed: int,
    tolerance: float,
    replicates: int | None = None,
) -> dict[str, Outlier]:
    """Return every test against the others, from the nodes of all tests by model, and of all but
    one by model and test."""
    rng = np.random.default_rng(seed)
    names = next(iter(models.values())).bound.test_names
    size = replicates or max(_REPLICATES, _EACH * len(names))
    flagged: dict[str, Outlier] = {}
    reached = 0.0
    while True:
        rest = {
            name: _against_the_others(models, left, name, size, rng)
            for name in names
            if name not in flagged
        }
        worst = min(rest, key=lambda name: (rest[name].p_value, -rest[name].distance))
        family = max(reached, min(1.0, len(rest) * rest[worst].p_value))
        if family >= FALSE_ALARMS or 2 * (len(flagged) + 1) >= len(names):
            break
        flagged[worst], reached = (
            replace(rest[worst], family_wise_p_value=family, flag=True),
            family,
        )
        models = {model: by_test[worst] for model, by_test in left.items()}
        left = leave_one_out(models, tolerance=tolerance)
    adjusted = np.maximum(holm(np.array([own.p_value for own in rest.values()])), reached)
    rest = {
        name: replace(own, family_wise_p_value=float(p))
        for (name, own), p in zip(rest.items(), adjusted, strict=True)
    }
    return {name: (flagged | rest)[name] for name in names}


def _against_the_others(
    models: Mapping[str, Nodes],
    left: Mapping[str, Mapping[str, Nodes]],
    name: str,
    size: int,
    rng: np.random.Generator,
) -> Outlier:
    """One test against circles that the others expect in its place; a closer look where few lie as
    far out. Circles of one posterior draw lie out together, so that small p-values need many
    draws."""
    bound = next(iter(models.values())).bound
    r = bound.test_names.index(name)
    observed = harmonics_of(bound, r) @ np.asarray(bound.reduced[r].projection)
    share = probabilities(np.array([by_test[name].evidence.log_value for by_test in left.values()]))

    def seen(size: int, each: int) -> Outlier:
        counts = np.round(share * size).astype(int)
        circles = [
            replicate_left_out(nodes.bound, left[model][name], name, int(count), rng, each=each)
            for (model, nodes), count in zip(models.items(), counts, strict=True)
            if count
        ]
        return _compared(observed, np.concatenate(circles))

    first = seen(size, _TOGETHER)
    return first if first.p_value > _CLOSER else seen(_MORE * size, _FEWER_TOGETHER)


def _compared(observed: Array, replicates: Array) -> Outlier:
    """Harmonics of a test, (25,), against those of replicates, (n, 25), other tests not yet allowed
    for."""
    n = len(replicates)
    centred = replicates - replicates.mean(axis=0)
    own = observed - replicates.mean(axis=0)
    nearer = []
    distances = []
    every = []
    for order in range(MAX_ORDER + 1):
        part = centred[:, order == ORDERS]
        root = np.linalg.cholesky(np.cov(part, rowvar=False).reshape(part.shape[1], -1))
        theirs = _distance(part, root)
        mine = _distance(own[None, order == ORDERS], root)[0]
        nearer.append(int(np.sum(theirs < mine)))
        every.append(theirs)
        distances.append(
            0.5 * float(mine)
            if part.shape[1] == 2
            else -float(special.log_ndtr(-np.sqrt(mine)) + np.log(2.0))
        )
    # Replicates that have in any order as many of the others nearer as the test has in its worst.
    most = max(nearer)
    edge = np.partition(every, most - 1, axis=1)[:, most - 1, None] if most else -np.inf
    further = (np.array(every) > edge).any(axis=0)
    p_value, *p_order = (
        (1.0 + k) / (n + 1.0) for k in (int(further.sum()), *(n - k for k in nearer))
    )
    return Outlier(p_value, 1.0, tuple(p_order), int(np.argmax(distances)), False, max(distances))


def _distance(harmonics: Array, root: Array) -> Array:
    """Squared Mahalanobis distance of (n, k), shape (n,)."""
    return np.asarray((np.linalg.solve(root, harmonics.T) ** 2).sum(axis=0))


# ---- a posterior averaged over models

_CHAINS = 4
_FEWEST = 400
_NEGLIGIBLE = 1e-3
_ROUGH = 0.1


@one_blas_thread
def average(
    models: Mapping[str, HybridModel],
    campaign: Campaign,
    *,
    seed: int = 1,
    draws: int = 4000,
    evidences: Evidences | None = None,
) -> xr.DataTree:
    """Average the posterior over models and over what else explains a change with force.

    InputError for a plan, a flat prior, models that are not nested, or too few draws.

    Parameters
    ----------
    models : mapping of name to HybridModel
        For example constant and linear: the parameters of one are those of the largest, some fixed
        at zero.
    campaign : with readings.
    draws : in four chains; each model has its share of them.
    evidences : those that `compare` was given: the models it weighed are not worked out again.

    Returns
    -------
    As of `sample`, with the parameters of the largest model. ``sample_stats.model`` says which
    model a draw is of; the record lists them (``averaged``) with rivals, log evidence and
    probability. Priors are averaged too.
    """
    started = datetime.now(UTC)
    clock = time.perf_counter()
    check_campaign(campaign)
    holds = isinstance(models, Mapping) and all(
        isinstance(own, HybridModel) for own in models.values()
    )
    cure = 'Call lb.average({"constant": model.with_degree(0), "linear": model}, campaign)'
    require(
        holds,
        f"models must be HybridModels by name, not yet fitted, got {type(models).__name__}."
        f" {cure}.",
    )
    require(
        len(models) > 0,
        "models must be given, got none. Average for example constant and linear compliance.",
    )
    require(
        draws >= _FEWEST, f"draws must be at least {_FEWEST}, got {draws}. The default is 4000."
    )
    evidences = (evidences or Evidences(campaign)).of_campaign(campaign)
    kinds = [
        (name, rivals)
        for name, model in models.items()
        for rivals in sensitivity.subsets(model.rivals)
    ]
    weighed = evidences.of(*(models[name].with_rivals(*rivals) for name, rivals in kinds))
    largest = max(models.values(), key=lambda model: (model.degree, -len(model.fixed)))
    bound = evidences.of(largest)[0].bound
    _check_nested([nodes.bound for nodes in weighed], bound)
    share = probabilities(np.array([nodes.evidence.log_value for nodes in weighed]))
    drawing, believing, checking = (
        np.random.default_rng(own) for own in np.random.SeedSequence(seed).spawn(3)
    )

    each = draws // _CHAINS
    model, parts = _drawn(weighed, share, _CHAINS * each, drawing)
    size = -(-draws // len(weighed))
    believed = [
        ModelDraws(nodes.bound, *reversed(prior_draws_of(nodes.bound, size, believing)))
        for nodes in weighed
    ]
    order = drawing.permutation(len(model)).reshape(_CHAINS, each)
    beta, phi = (own[order] for own in _together(bound, parts))
    every = [densities_of(part) for part in parts]
    densities = {name: np.concatenate([own[name] for own in every])[order] for name in every[0]}
    groups = groups_of(bound, beta, phi, _together(bound, believed), densities)
    groups["sample_stats"]["model"] = model[order]

    error = float(np.array([nodes.evidence.error for nodes in weighed])[share > _NEGLIGIBLE].max())
    missed = [] if error <= _ROUGH else [Concern(ConcernKind.NOT_CONVERGED, each, draws)]
    near = weighed[0].posterior.plain.mode
    likeliest = weighed[int(np.argmax(share))].bound
    truncation = evidence.log_prob_truncation(HyperPosterior(likeliest, truncated=True, near=near))
    level = np.array([part.bound.log_prior(part.beta).mean() for part in believed])[model[order]]
    fit = fit_of_parts(bound, parts, groups, truncation, missed, checking, level)
    drawn = np.concatenate([beta, phi], axis=2)
    sampler = {
        "kind": "independent",
        "by_emcee": any(nodes.evidence.by_emcee for nodes in weighed),
        **asdict(assess(drawn[:, :, np.ptp(drawn, axis=(0, 1)) > 0.0])),
        "converged": not missed,
        "draws": _CHAINS * each,
        "seconds": time.perf_counter() - clock,
        "steps": each,
        "walkers": 1,
        "acceptance": 1.0,
        "target_ess": float(draws),
        "target_rhat": StoppingRule().rhat,
    }
    record = record_from(bound, sampler, fit, seed, started)
    record["model"] |= _prior(
        bound, [nodes.bound for nodes in weighed], record["model"]["prior_sd"]
    )
    return build_tree(
        groups,
        bound,
        record | {"averaged": _averaged(kinds, weighed, share) | {"log_evidence_error": error}},
    )


def _drawn(
    weighed: Sequence[Nodes], share: Array, size: int, rng: np.random.Generator
) -> tuple[Array, list[ModelDraws]]:
    """The model of every draw, and the draws of each: its share of them, but for less than one."""
    ends = np.floor(np.append(0.0, np.cumsum(share) / share.sum()) * size + rng.random()).astype(
        int
    )
    model = np.repeat(np.arange(len(weighed)), np.diff(ends))
    counts = zip(*np.unique(model, return_counts=True), strict=True)
    return model, [
        ModelDraws(weighed[k].bound, *reversed(weighed[k].draw(int(count), rng))) for k, count in counts
    ]


def _averaged(
    kinds: Sequence[tuple[str, tuple[str, ...]]], weighed: Sequence[Nodes], share: Array
) -> dict[str, Any]:
    """Every model with its probability, and those of each given model and of each rival of
    slopes."""
    names = dict.fromkeys(
        [*(name for name, _ in kinds), *(rival for _, rivals in kinds for rival in rivals)]
    )
    return {
        "models": [
            {
                "model": name,
                "rivals": rivals,
                "log_evidence": nodes.evidence.log_value,
                "probability": probability,
            }
            for (name, rivals), nodes, probability in zip(
                kinds, weighed, share.tolist(), strict=True
            )
        ],
        "probability": {
            name: float(share[[name in (kind, *rivals) for kind, rivals in kinds]].sum())
            for name in names
        },
    }


def _check_nested(bounds: Sequence[BoundModel], largest: BoundModel) -> None:
    for bound in bounds:
        alike = bound.hyper_prior.names == largest.hyper_prior.names and set(bound.names) <= set(
            largest.names
        )
        alike = alike and bound.setting.reference_force_N == largest.setting.reference_force_N
        got = (
            "got others (other terms, parameters or reference force). Make one from the other:"
            " linear.with_degree(0)."
        )
        require(
            alike,
            "models must be nested, those of fewer parameters the largest with some fixed at zero,"
            f" {got}",
        )


def _prior(
    bound: BoundModel, bounds: Sequence[BoundModel], prior_sd: Mapping[str, float]
) -> dict[str, dict[str, float]]:
    """Prior sd and mean of every parameter over models as probable as one another."""
    moments = np.zeros((2, len(bound.names)))
    for own in bounds:
        at = [bound.names.index(name) for name in own.names]
        moments[:, at] += np.stack([own.prior_mean, own.prior_mean**2 + own.prior_sd**2]) / len(
            bounds
        )
    mean = moments[0]
    sd = np.sqrt(moments[1] - moments[0] ** 2)
    averaged = dict(zip(bound.names, sd.tolist(), strict=True))
    return {
        "prior_sd": {**prior_sd, **averaged},
        "prior_mean": dict(zip(bound.names, mean.tolist(), strict=True)),
    }


def _together(bound: BoundModel, parts: Sequence[ModelDraws]) -> tuple[Array, Array]:
    """β (n, p) and φ (n, h) of all parts, one after the other; zero where a model lacks a
    parameter."""
    beta = [np.zeros((len(part.phi), len(bound.names))) for part in parts]
    for values, part in zip(beta, parts, strict=True):
        values[:, [bound.names.index(name) for name in part.bound.names]] = part.beta
    return np.concatenate(beta), np.concatenate([part.phi for part in parts])
