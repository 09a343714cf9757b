"""Compare models of one campaign by their evidences.

p(M | y) ∝ p(y | M) p(M), every evidence by exact quadrature. The comparison is repeated under other
assumptions, and every test is predicted from the other tests. Models are compared on the same
readings, with the same priors where they share parameters.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from operator import methodcaller
from typing import Any

import numpy as np
import pandas as pd

from ldbb_bayes.analysis import sensitivity
from ldbb_bayes.analysis.outlying_tests import FALSE_ALARMS, judge_tests
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
from ldbb_bayes.inference.evidence import (
    Evidences,
    check_comparable,
    leave_one_out,
    log_bayes_factor,
    probabilities,
)
from ldbb_bayes.inference.least_squares import least_squares
from ldbb_bayes.inference.nodes import Evidence, Nodes
from ldbb_bayes.inference.residuals import fit_quality
from ldbb_bayes.inference.summary import check_probability
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.parallel import ahead, one_blas_thread
from ldbb_bayes.results import Array, Finite, Number, Records, Result, read_result
from ldbb_bayes.units import ranked

__all__ = [
    "SLOPE_SCALES",
    "ComparedModel",
    "ComparedTest",
    "Comparison",
    "Sign",
    "compare",
    "read_comparison",
]

SLOPE_SCALES = (0.03, 0.05, 0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.0, 1.5, 2.0, 3.0)
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
    """One test, left out; p-values, worst order and flag as in `JudgedTest`."""

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
    odd = judge_tests(weighed, left, seed=seed, tolerance=tolerance) if left else {}
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


# ---- a posterior averaged over models
