"""compare(): what the readings say about models, how much, and what that rests on.

p(M | y) ∝ p(y | M) p(M), every evidence by exact quadrature; the same again under other assumptions; every test predicted from
the others. Models are compared on the same readings, with the same priors where they share parameters.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from operator import methodcaller
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from ldbb_bayes.analysis.outliers import FALSE_ALARMS, Dropped, dropped, outliers
from ldbb_bayes.analysis.sensitivity import (
    WHITE_NOISE,
    Assumed,
    Curve,
    SlopeSubset,
    SlopeSubsets,
    VaryingSlope,
    averaged_curves,
    count_subsets,
    discrepancy_assumptions,
    local_fits,
    nuisance_assumptions,
    slope_subsets,
    under,
)
from ldbb_bayes.campaign.campaign import Campaign, check_campaign
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.evidence import (
    Evidences,
    check_comparable,
    leave_one_out,
    log_bayes_factor,
    probabilities,
    savage_dickey,
)
from ldbb_bayes.inference.least_squares import least_squares
from ldbb_bayes.inference.nodes import CHUNK, Nodes
from ldbb_bayes.inference.posterior import campaign_of, check_probability, model_of, psis_loo
from ldbb_bayes.inference.predictive import fit_quality
from ldbb_bayes.jobs import one_blas_thread
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.result import Number, Records, Result, read_result
from ldbb_bayes.units import ranked

__all__ = [
    "SLOPE_SCALES",
    "ComparedModel",
    "ComparedTest",
    "Comparison",
    "SavageDickey",
    "Sign",
    "compare",
    "pareto_smoothed",
    "read_comparison",
]

Array = NDArray[Any]
SLOPE_SCALES = (0.03, 0.05, 0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.0, 1.5, 2.0, 3.0)
_REJECTED = 5.0
_QUALITY_DRAWS, _SMOOTHED_DRAWS = 1000, 4000
_FINEST, _COARSEST = 1e-4, 1.0


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


@dataclass(frozen=True)
class Squares:
    """Eq. 34-35 of the paper's least squares (Eq. 31); not a number where the forces do not determine it."""

    rmse_um: Number
    fitness_percent: dict[str, Number]


@dataclass(frozen=True, eq=False)
class ComparedModel:
    """One of the models.

    Attributes
    ----------
    elpd_lofo, elpd_lofo_se : float
        Sum of the leave-one-force-out log densities and its standard error over the tests [nat]; not a number for one test.
    rmse_um, fitness_percent : float, dict of test to float
        Eq. 34-35 of the posterior mean prediction, machine and shared nuisances; ``least_squares`` at the same degree.
    """

    log_evidence: float
    log_evidence_error: float
    posterior_probability: float
    elpd_lofo: Number
    elpd_lofo_se: Number
    rmse_um: float
    fitness_percent: dict[str, Number]
    least_squares: Squares
    degree: int
    terms: tuple[str, ...]
    parameters: dict[str, Estimate]
    compliance_against_force: dict[str, Curve]


@dataclass(frozen=True)
class Smoothed:
    """A left-out log density by importance sampling, and whether that can be trusted."""

    log_density: Number
    pareto_k: Number
    trustworthy: bool


@dataclass(frozen=True, eq=False)
class ComparedTest:
    """One test, left out.

    Attributes
    ----------
    lofo_log_density, lofo_log_density_error : dict of model to float
        ln p(y_r | y_−r), exact, and the quadrature's error [nat].
    lofo_p_value, lofo_family_wise_p_value, lofo_worst_order, lofo_p_value_by_order, flag : as in `Outlier`
    psis_loo_good_k : float
        Above this Pareto k importance sampling cannot be trusted.
    """

    force_N: float
    lofo_log_density: dict[str, float]
    lofo_log_density_error: dict[str, float]
    lofo_p_value: float
    lofo_family_wise_p_value: float
    lofo_worst_order: int
    lofo_p_value_by_order: dict[int, float]
    flag: bool
    psis_loo_good_k: float
    psis_loo: dict[str, Smoothed]
    without_it: dict[str, dict[str, Dropped]]

    @property
    def stands_out(self) -> bool:
        """Whether the family-wise p-value is below 2 %, flagged or not."""
        return self.lofo_family_wise_p_value < FALSE_ALARMS


@dataclass(frozen=True)
class ScaledSlopes:
    """The comparison with the slopes' prior sd at this multiple of sd(C) over the range of force."""

    slope_scale: float
    log_bayes_factor: float
    error: float


@dataclass(frozen=True)
class SavageDickey:
    """A log Bayes factor by the Savage-Dickey ratio [nat]."""

    log_bayes_factor: float
    error: float


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
    models : dict of name to ComparedModel
    log_bayes_factor, log_bayes_factor_error : dict of "model/first model" to float
        [nat].
    savage_dickey, elpd_difference : dict of "model/first model" to SavageDickey, Difference
        The former where the two are nested.
    sensitivity_of : str
        Second model over the first, as all sensitivities are.
    prior_sensitivity : tuple of ScaledSlopes
    prior_sensitivity_crossings : tuple of float
        Slope scales at which the log Bayes factor changes sign.
    discrepancy_sensitivity, nuisances : tuple of Assumed
    white_noise_overstates_by_nats : float
        By how much white noise alone moves the log Bayes factor; not a number where it leaves no difference.
    slopes : dict of compliance to VaryingSlope
        Empty where no model has slopes, or evidence alone was asked for.
    slope_subsets : tuple of SlopeSubset
        The most probable first; ``slope_subsets_possible`` may be more.
    compliance_against_force : dict of compliance to Curve
        Averaged over the subsets.
    tests : dict of name to ComparedTest
        Empty for one test.
    local_fits : DataFrame
        Of windows of two force levels; empty where there is one level.
    tolerance, largest_error : float
        Asked of every log evidence, and the largest seen [nat].
    differing_priors : tuple of str
        Parameters and scales to which the models give different priors: the Bayes factor compares these too.
    """

    campaign: Readings
    models: dict[str, ComparedModel]
    log_bayes_factor: dict[str, float]
    log_bayes_factor_error: dict[str, float]
    savage_dickey: dict[str, SavageDickey]
    elpd_difference: dict[str, Difference]
    sensitivity_of: str
    prior_sensitivity: tuple[ScaledSlopes, ...]
    prior_sensitivity_crossings: tuple[float, ...]
    discrepancy_sensitivity: tuple[Assumed, ...]
    nuisances: tuple[Assumed, ...]
    white_noise_overstates_by_nats: Number
    slopes: dict[str, VaryingSlope]
    slope_subsets: tuple[SlopeSubset, ...]
    slope_subsets_possible: int | None
    compliance_against_force: dict[str, Curve]
    tests: dict[str, ComparedTest]
    local_fits: Records
    tolerance: float
    largest_error: float
    differing_priors: tuple[str, ...] = ()

    @property
    def pair(self) -> tuple[str, str]:
        """The first two models, which sensitivities compare."""
        first, second, *_ = self.models
        return first, second

    @property
    def within_tolerance(self) -> bool:
        """Whether every log evidence is as exact as was asked."""
        return self.largest_error <= self.tolerance

    @property
    def assumptions(self) -> dict[str, Assumed]:
        """Every assumption once, by name: nuisances on and off, then ideas of discrepancy."""
        return {a.assumption: a for a in (*self.nuisances, *self.discrepancy_sensitivity)}

    def gain(self, assumed: Assumed) -> float:
        """How much more evidence an assumption has than the models' own [nat]."""
        return assumed.best - self.nuisances[0].best

    def turning(self) -> list[Assumed]:
        """Assumptions that turn the sign of the log Bayes factor, the best supported first."""
        sign = np.sign(self.log_bayes_factor[self.sensitivity_of])
        every = {a.assumption: a for a in (*self.discrepancy_sensitivity, *self.nuisances)}
        distinct = {a.log_bayes_factor: a for a in reversed(every.values())}
        turned = [a for a in distinct.values() if np.sign(a.log_bayes_factor) == -sign and a.assumption != WHITE_NOISE]
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
        best = ranked((*self.discrepancy_sensitivity, *self.nuisances), lambda a: a.best)[0]
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
    models: Mapping[str, HybridModel | xr.DataTree],
    campaign: Campaign | None = None,
    *,
    quadratic: bool = False,
    leave_out: Literal["test", "reading"] = "test",
    evidence_only: bool = False,
    tolerance: float = 1e-2,
    ci_prob: float = 0.95,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Comparison:
    """Compare models of one campaign.

    Parameters
    ----------
    models : mapping of name to HybridModel, or to a posterior from `sample`
        At least two. Sensitivity is of the second over the first.
    campaign : Campaign, optional
        Needed unless every model comes as a posterior, which brings its own.
    quadratic : bool
        Choose constant, linear or quadratic for every compliance apart when slopes are selected (3⁶ models, some minutes),
        whatever the degree of the models; else constant or linear.
    leave_out : {"test"}
        What leave-one-out leaves out. Readings are refused: those of one circle are not independent facts.
    evidence_only : bool
        Only evidence and what it hangs on, three times as fast: no test left out, no slope subsets, no local fits.
    tolerance : float
        Error asked of every log evidence [nat].
    ci_prob : float
        Probability of the bands of C(F) and of the intervals of local fits.
    seed : int
        Of replicates, bands and the importance-sampling check.
    progress : callable, optional
        Called with the steps done and their number.

    Raises
    ------
    InputError
        For fewer than two models, an improper prior, a plan, posteriors of different readings, or ``leave_out="reading"``.
    """
    check_probability(ci_prob)
    chosen, campaign = _checked(models, campaign, leave_out, tolerance)
    first, second, *_ = chosen
    pair, ratio = {name: chosen[name] for name in (first, second)}, f"{second}/{first}"
    largest = max(chosen.values(), key=lambda model: (model.degree, -len(model.fixed)))
    selected = largest.with_degree(2 if quadratic else min(largest.degree, 1))
    evidences = Evidences(campaign, tolerance=tolerance)
    scales = SLOPE_SCALES if any(model.degree for model in pair.values()) else ()
    by_scale = {f"slope scale {s:g}": methodcaller("with_slope_scale", s) for s in scales}
    discrepancies = discrepancy_assumptions(pair.values())
    nuisances = nuisance_assumptions(pair.values(), chosen[first].bind(campaign).setting)
    several, subsets = (not evidence_only and wanted for wanted in (len(campaign.tests) > 1, selected.degree > 0))
    windows = campaign.force_levels > 1 and not evidence_only
    if progress is not None:
        total = len(chosen) * (1 + several * len(campaign.tests)) + 2 * len([*by_scale, *discrepancies, *nuisances])
        total += count_subsets(selected, evidences, quadratic=quadratic) if subsets else 0
        steps = itertools.count(1)
        evidences.progress = lambda: progress(next(steps), total)

    weighed = {name: evidences.of(model) for name, model in chosen.items()}
    left = {
        name: leave_one_out(nodes, tolerance=tolerance, progress=evidences.progress) if several else {}
        for name, nodes in weighed.items()
    }
    factors = {f"{n}/{first}": log_bayes_factor(o.evidence, weighed[first].evidence) for n, o in weighed.items() if n != first}
    scaled, circles, switched = (under(pair, changes, evidences) for changes in (by_scale, discrepancies, nuisances))
    overstated = [a.log_bayes_factor - factors[ratio][0] for a in switched if a.assumption == WHITE_NOISE]
    slopes = SlopeSubsets()
    if subsets:
        slopes = slope_subsets(selected, evidences, quadratic=quadratic, seed=seed, ci_prob=ci_prob)
    densities = {name: _left_out_densities(nodes, left[name]) for name, nodes in weighed.items()}
    return Comparison(
        campaign=Readings(campaign.name, campaign.sha256),
        models=_models(weighed, densities, seed, ci_prob),
        log_bayes_factor={name: value for name, (value, _) in factors.items()},
        log_bayes_factor_error={name: error for name, (_, error) in factors.items()},
        savage_dickey=_nested(weighed, first),
        elpd_difference={
            f"{n}/{first}": Difference(*_sum_over_tests(densities[n] - densities[first]))
            for n in chosen
            if several and n != first
        },
        sensitivity_of=ratio,
        prior_sensitivity=tuple(
            ScaledSlopes(s, a.log_bayes_factor, a.log_bayes_factor_error) for s, a in zip(scales, scaled, strict=True)
        ),
        prior_sensitivity_crossings=_crossings(np.array(scales), np.array([a.log_bayes_factor for a in scaled])),
        discrepancy_sensitivity=circles,
        nuisances=switched,
        white_noise_overstates_by_nats=overstated[0] if overstated else np.nan,
        slopes=slopes.slopes,
        slope_subsets=slopes.subsets,
        slope_subsets_possible=slopes.possible,
        compliance_against_force=slopes.curves,
        tests=_tests(weighed, left, densities, seed, tolerance) if several else {},
        local_fits=local_fits(largest, campaign, ci_prob=ci_prob) if windows else pd.DataFrame(),
        tolerance=tolerance,
        largest_error=max([evidences.largest_error, *(n.evidence.error for others in left.values() for n in others.values())]),
        differing_priors=_differing_priors([nodes.bound for nodes in weighed.values()]),
    )


def _checked(
    models: Mapping[str, HybridModel | xr.DataTree], campaign: Campaign | None, leave_out: str, tolerance: float
) -> tuple[dict[str, HybridModel], Campaign]:
    """The models and the one campaign they are of."""
    if leave_out == "reading":
        raise InputError(
            "leave_out must be 'test', got 'reading': readings of one circle share its set-up shift and discrepancy and are not "
            "independent facts, so leaving one out tells how well its neighbours predict it. Leave out tests."
        )
    if leave_out != "test":
        raise InputError(
            f"leave_out must be 'test', got {leave_out!r}: every test is left out in turn. To compare without one, take it out "
            "of the campaign (Campaign.without, or its entry in campaign.toml)."
        )
    if not isinstance(models, Mapping):
        raise InputError(f"models must be a mapping of names to models, got {type(models).__name__}. Give each model a name.")
    check_campaign(campaign)
    if len(models) < 2:
        raise InputError(f"models must be at least two, got {len(models)}. Give for example constant and linear compliance.")
    if not _FINEST <= tolerance <= _COARSEST:
        raise InputError(
            f"tolerance must lie between {_FINEST:g} and {_COARSEST:g} nats, got {tolerance}: there are hundreds of evidences. "
            "For one model log_evidence goes further."
        )
    chosen = {name: model_of(model) if isinstance(model, xr.DataTree) else model for name, model in models.items()}
    brought = {name: campaign_of(model) for name, model in models.items() if isinstance(model, xr.DataTree)}
    if campaign is None and len(brought) < len(models):
        raise InputError("compare must be given a campaign unless all models are posteriors, got none. Pass the campaign.")
    campaign = campaign or next(iter(brought.values()))
    other = next((name for name, own in brought.items() if own.sha256 != campaign.sha256), None)
    if other is not None:
        raise InputError(
            f"models must be of the same readings to be compared, got {other!r} of other ones (SHA-256 "
            f"{brought[other].sha256[:12]}… instead of {campaign.sha256[:12]}…). Fit both to one campaign."
        )
    alike = next(((a, b) for a, b in itertools.combinations(chosen, 2) if chosen[a] == chosen[b]), None)
    if alike is not None:
        raise InputError(
            f"models must differ, got {alike[0]!r} and {alike[1]!r} alike. Leave one out, or change its degree or terms."
        )
    for model in chosen.values():
        check_comparable(model, campaign)
    return chosen, campaign


def _crossings(scale: Array, log_bayes_factor: Array) -> tuple[float, ...]:
    """Scales at which the log Bayes factor changes sign, interpolated in the logarithm of the scale."""
    x, y = np.log(scale), log_bayes_factor
    i = np.flatnonzero(np.sign(y[1:]) * np.sign(y[:-1]) < 0)
    return tuple(np.exp(x[i] + y[i] / (y[i] - y[i + 1]) * (x[i + 1] - x[i])).tolist())


def _left_out_densities(nodes: Nodes, left: Mapping[str, Nodes]) -> Array:
    """ln p(y_r | y_−r) = ln Z(y) − ln Z(y_−r), shape (tests,)."""
    return np.array([nodes.evidence.log_value - others.evidence.log_value for others in left.values()])


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
        quality = fit_quality(bound, phi, beta)
        elpd, elpd_se = _sum_over_tests(densities[name])
        moments = zip(bound.parameters, *nodes.moments(), strict=True)
        compared[name] = ComparedModel(
            log_evidence=nodes.evidence.log_value,
            log_evidence_error=nodes.evidence.error,
            posterior_probability=float(probability),
            elpd_lofo=elpd,
            elpd_lofo_se=elpd_se,
            rmse_um=quality.rmse_um,
            fitness_percent=quality.fitness_percent,
            least_squares=_least_squares(bound.model, bound.campaign),
            degree=bound.model.degree,
            terms=bound.terms,
            parameters={p.name: Estimate(p.unit, float(mean), float(sd)) for p, mean, sd in moments},
            compliance_against_force=averaged_curves([nodes], np.ones(1), seed, ci_prob),
        )
    return compared


def _least_squares(model: HybridModel, campaign: Campaign) -> Squares:
    if campaign.force_levels < model.degree + 2:
        return Squares(np.nan, {})
    quality = least_squares(campaign, model.degree, reference_force_N=model.reference_force_N, fixed=model.fixed).quality
    return Squares(quality.rmse_um, quality.fitness_percent)


def _nested(weighed: Mapping[str, Nodes], first: str) -> dict[str, SavageDickey]:
    """Over the first model, where one of the two is the other with parameters fixed at zero."""
    ratios = {}
    for name, nodes in weighed.items():
        smaller, larger = sorted((weighed[first], nodes), key=lambda own: len(own.bound.names))
        inner, outer = smaller.bound, larger.bound
        extra = [parameter for parameter in outer.names if parameter not in inner.names]
        alike = replace(inner.model, degree=outer.model.degree, fixed=outer.model.fixed, preset=outer.model.preset) == outer.model
        if name != first and extra and alike and set(inner.names) < set(outer.names):
            value, error = savage_dickey(larger, extra)
            ratios[f"{name}/{first}"] = SavageDickey(-value if larger is nodes else value, error)
    return ratios


def _tests(
    weighed: Mapping[str, Nodes],
    left: Mapping[str, Mapping[str, Nodes]],
    densities: Mapping[str, Array],
    seed: int,
    tolerance: float,
) -> dict[str, ComparedTest]:
    """Every test against the others."""
    odd = outliers(weighed, left, seed=seed, tolerance=tolerance)
    without = {model: dropped(nodes, left[model]) for model, nodes in weighed.items()}
    smoothed = {model: pareto_smoothed(nodes, seed) for model, nodes in weighed.items()}
    good_k = min(own[2] for own in smoothed.values())
    forces = next(iter(weighed.values())).bound.setting.force_N
    return {
        name: ComparedTest(
            force_N=float(forces[r]),
            lofo_log_density={model: float(densities[model][r]) for model in weighed},
            lofo_log_density_error={m: weighed[m].evidence.error + left[m][name].evidence.error for m in weighed},
            lofo_p_value=own.p_value,
            lofo_family_wise_p_value=own.family_wise_p_value,
            lofo_worst_order=own.worst_order,
            lofo_p_value_by_order=dict(enumerate(own.order_p_values)),
            flag=own.flag,
            psis_loo_good_k=good_k,
            psis_loo={
                model: Smoothed(float(density[r]), float(k[r]), bool(k[r] <= good_k))
                for model, (density, k, _) in smoothed.items()
            },
            without_it={model: by_test[name] for model, by_test in without.items()},
        )
        for r, (name, own) in enumerate(odd.items())
    }


def pareto_smoothed(nodes: Nodes, seed: int) -> tuple[Array, Array, float]:
    """Left-out log densities by importance sampling from the posterior of all tests: see `psis_loo`."""
    beta, phi = nodes.draw(_SMOOTHED_DRAWS, np.random.default_rng(seed))
    parts = [slice(i, i + CHUNK) for i in range(0, len(phi), CHUNK)]
    return psis_loo(np.concatenate([nodes.bound.log_likelihood_per_test(phi[part], beta[part]) for part in parts]))


def _differing_priors(bounds: Sequence[BoundModel]) -> tuple[str, ...]:
    """What the models share and give different priors."""
    seen: dict[str, tuple[float, float]] = {}
    differing: dict[str, None] = {}
    for bound in bounds:
        hyper = zip(bound.hyper_prior.names, bound.hyper_prior.scale_mm, strict=True)
        priors = [(p.name, p.prior_mean, p.prior_sd) for p in bound.parameters] + [(str(n), 0.0, float(s)) for n, s in hyper]
        for name, mean, sd in priors:
            if not np.allclose(seen.setdefault(name, (mean, sd)), (mean, sd), rtol=1e-9, atol=0.0):
                differing[name] = None
    return tuple(differing)
