"""compare(): what the readings say about models, how much, and what that rests on.

p(M | y) ∝ p(y | M) p(M), every evidence by exact quadrature; the same again under other assumptions; every test predicted from
the others. Models are compared on the same readings, with the same priors where they share parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from ldbb_bayes.analysis.assumptions import (
    SLOPE_SCALES,
    compare_under,
    crossings,
    discrepancy_assumptions,
    nuisance_assumptions,
    with_slope_scale,
)
from ldbb_bayes.analysis.belonging import belonging_of, dropping
from ldbb_bayes.analysis.compared import ComparedModel, ComparedTest, Comparison, ScaledSlopes
from ldbb_bayes.analysis.evidences import Evidences, Weighed, probabilities
from ldbb_bayes.analysis.local_fits import local_fits
from ldbb_bayes.analysis.slopes import count_subsets, model_curves, slope_subsets
from ldbb_bayes.analysis.weight import verdict_of
from ldbb_bayes.campaign.campaign import Campaign, check_campaign
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.collapsed import draw_parameters_given
from ldbb_bayes.inference.evidence import check_comparable, log_bayes_factor
from ldbb_bayes.inference.least_squares import least_squares
from ldbb_bayes.inference.leave_one_out import LeftOut, leave_one_out, pareto_smoothed
from ldbb_bayes.inference.marginals import moments
from ldbb_bayes.inference.origin import campaign_of, model_of
from ldbb_bayes.inference.predictive import FitQuality, fit_quality
from ldbb_bayes.inference.savage_dickey import savage_dickey
from ldbb_bayes.inference.summary import check_probability
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.wording import joined
from ldbb_bayes.threads import one_blas_thread

__all__ = ["compare"]

Array = NDArray[Any]
_QUALITY_DRAWS = 1000
_FINEST, _COARSEST = 1e-4, 1.0


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
    pair = {first: chosen[first], second: chosen[second]}
    largest = max(chosen.values(), key=lambda model: (model.degree, -len(model.fixed)))
    selected = largest.with_degree(2 if quadratic else min(largest.degree, 1))
    steps = _Steps(progress)
    evidences = Evidences(campaign, tolerance=tolerance, progress=steps)
    scales = SLOPE_SCALES if any(model.degree for model in pair.values()) else ()
    several = len(campaign.tests) > 1 and not evidence_only
    subsets = bool(selected.degree) and not evidence_only
    windows = campaign.force_levels > 1 and not evidence_only
    steps.total = len(chosen) * (1 + several * len(campaign.tests))
    steps.total += 2 * len([*scales, *discrepancy_assumptions(pair), *nuisance_assumptions(pair, campaign)])
    steps.total += count_subsets(selected, evidences, quadratic=quadratic) if subsets else 0

    weighed = {name: evidences.of(model) for name, model in chosen.items()}
    left = {
        name: leave_one_out(one.posterior, one.evidence, tolerance=tolerance, progress=steps) if several else {}
        for name, one in weighed.items()
    }
    scaled = compare_under(pair, (with_slope_scale(scale) for scale in scales), evidences)
    found = Comparison(
        campaign=campaign.name,
        sha256=campaign.sha256,
        pair=(first, second),
        models=_models(weighed, left, seed, ci_prob),
        log_bayes_factor={
            f"{name}/{first}": log_bayes_factor(one.evidence, weighed[first].evidence)
            for name, one in weighed.items()
            if name != first
        },
        savage_dickey=_nested(weighed, first),
        elpd_difference={f"{name}/{first}": _difference(left[name], left[first]) for name in chosen if several and name != first},
        prior_sensitivity=tuple(ScaledSlopes(s, a.log_bayes_factor, a.error) for s, a in zip(scales, scaled, strict=True)),
        crossings=crossings(np.array(scales), np.array([assumed.log_bayes_factor for assumed in scaled])),
        discrepancy_sensitivity=compare_under(pair, discrepancy_assumptions(pair), evidences),
        nuisances=compare_under(pair, nuisance_assumptions(pair, campaign), evidences),
        slopes=slope_subsets(selected, evidences, quadratic=quadratic, seed=seed, ci_prob=ci_prob) if subsets else None,
        tests=_tests(weighed, left, seed, tolerance) if several else {},
        local_fits=local_fits(largest, campaign, ci_prob=ci_prob) if windows else pd.DataFrame(),
        verdict=(),
        tolerance=tolerance,
        largest_error=max([evidences.largest_error, *(one.evidence.error for tests in left.values() for one in tests.values())]),
    )
    return replace(found, verdict=verdict_of(found, tuple(_prior_notes(weighed))))


class _Steps:
    """Counts what is done."""

    def __init__(self, progress: Callable[[int, int], None] | None) -> None:
        self.total, self._done, self._progress = 0, 0, progress

    def __call__(self) -> None:
        self._done += 1
        if self._progress is not None:
            self._progress(self._done, self.total)


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
    for name, model in chosen.items():
        alike = next((other for other, own in chosen.items() if other != name and own == model), None)
        if alike is not None:
            raise InputError(
                f"models must differ, got {name!r} and {alike!r} alike. Leave one out, or change its degree or terms."
            )
        check_comparable(model, campaign)
    return chosen, campaign


def _models(
    weighed: Mapping[str, Weighed], left: Mapping[str, Mapping[str, LeftOut]], seed: int, ci_prob: float
) -> dict[str, ComparedModel]:
    share = probabilities(np.array([one.evidence.log_value for one in weighed.values()]))
    found = {}
    for (name, one), probability in zip(weighed.items(), share, strict=True):
        bound = one.posterior.bound
        rng = np.random.default_rng(seed)
        free = one.lattice.pick(_QUALITY_DRAWS, rng)
        quality = fit_quality(bound, bound.hyper_prior.phi(free), draw_parameters_given(one.posterior, free, rng))
        squares = _least_squares_quality(bound.model, bound.campaign)
        mean, sd = moments(one.posterior, one.lattice)
        densities = np.array([test.log_density for test in left[name].values()])
        found[name] = ComparedModel(
            name,
            bound.model.degree,
            bound.terms,
            one.evidence,
            float(probability),
            float(densities.sum()) if densities.size else np.nan,
            _standard_error(densities),
            quality.rmse_um,
            quality.fitness_percent,
            np.nan if squares is None else squares.rmse_um,
            {} if squares is None else squares.fitness_percent,
            {p.name: (p.unit, float(m), float(s)) for p, m, s in zip(bound.parameters, mean, sd, strict=True)},
            model_curves(one, seed, ci_prob),
        )
    return found


def _least_squares_quality(model: HybridModel, campaign: Campaign) -> FitQuality | None:
    """RMSE and fitness of the paper's least squares at the same degree; None where the forces do not determine it."""
    if campaign.force_levels < model.degree + 2:
        return None
    return least_squares(campaign, model.degree, reference_force_N=model.reference_force_N, fixed=model.fixed).quality


def _standard_error(densities: Array) -> float:
    """Of the sum, from its scatter over the tests."""
    return float(np.sqrt(len(densities) * densities.var(ddof=1))) if len(densities) > 1 else np.nan


def _difference(left: Mapping[str, LeftOut], other: Mapping[str, LeftOut]) -> tuple[float, float]:
    differences = np.array([left[name].log_density - other[name].log_density for name in left])
    return float(differences.sum()), _standard_error(differences)


def _nested(weighed: Mapping[str, Weighed], first: str) -> dict[str, tuple[float, float]]:
    """Savage-Dickey ratios over the first model, where one of the two is the other with parameters fixed at zero."""
    found = {}
    for name, one in weighed.items():
        pair = (weighed[first], one)
        smaller, larger = sorted(pair, key=lambda own: len(own.posterior.bound.names))
        inner, outer = smaller.posterior.bound, larger.posterior.bound
        extra = [parameter for parameter in outer.names if parameter not in inner.names]
        alike = replace(inner.model, degree=outer.model.degree, fixed=outer.model.fixed, preset=outer.model.preset) == outer.model
        if name == first or not extra or not alike or not set(inner.names) < set(outer.names):
            continue
        value, error = savage_dickey(larger.posterior, larger.evidence, extra)
        found[f"{name}/{first}"] = (-value if larger is one else value, error)
    return found


def _tests(
    weighed: Mapping[str, Weighed], left: Mapping[str, Mapping[str, LeftOut]], seed: int, tolerance: float
) -> dict[str, ComparedTest]:
    """Every test against the others."""
    names = list(next(iter(left.values())))
    if not names:
        return {}
    belongs = belonging_of(weighed, left, seed=seed, tolerance=tolerance)
    dropped = {model: dropping(one, left[model]) for model, one in weighed.items()}
    smoothed = {model: pareto_smoothed(one.posterior, one.lattice, seed=seed) for model, one in weighed.items()}
    forces = next(iter(weighed.values())).posterior.bound.setting.force_N
    return {
        name: ComparedTest(
            float(forces[r]),
            {model: tests[name].log_density for model, tests in left.items()},
            {model: tests[name].error for model, tests in left.items()},
            {model: float(log_density[r]) for model, (log_density, _, _) in smoothed.items()},
            {model: float(pareto_k[r]) for model, (_, pareto_k, _) in smoothed.items()},
            min(good_k for _, _, good_k in smoothed.values()),
            belongs[name],
            {model: by_test[name] for model, by_test in dropped.items()},
        )
        for r, name in enumerate(names)
    }


def _prior_notes(weighed: Mapping[str, Weighed]) -> Iterator[str]:
    """Shared parameters with different priors: their Bayes factor compares these too."""
    seen: dict[str, tuple[float, float]] = {}
    differing: dict[str, None] = {}
    for one in weighed.values():
        bound = one.posterior.bound
        hyper = zip(bound.hyper_prior.names, bound.hyper_prior.scale_mm, strict=True)
        own = [(p.name, p.prior_mean, p.prior_sd) for p in bound.parameters]
        for name, mean, sd in [*own, *((str(n), 0.0, float(s)) for n, s in hyper)]:
            if not np.allclose(seen.setdefault(name, (mean, sd)), (mean, sd), rtol=1e-9, atol=0.0):
                differing[name] = None
    if differing:
        yield f"The models give {joined(list(differing))} different priors: the Bayes factor compares these too."
