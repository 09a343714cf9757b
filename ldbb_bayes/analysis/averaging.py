"""Average one posterior over models.

p(β, φ | y) = Σ_M p(M | y) p(β, φ | y, M): the average over models, each by its exact posterior
probability. They differ in whether compliance changes with force and in what else explains such a
change, the rivals of slopes; every combination is as probable as another beforehand, as in
`explanations`. A coefficient that a model lacks is zero in its draws, so that the share of zeros is
the probability that it is not there (Hoeting, Madigan, Raftery and Volinsky 1999).
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from ldbb_bayes.analysis import sensitivity
from ldbb_bayes.campaign.campaign import Campaign, check_campaign
from ldbb_bayes.errors import require
from ldbb_bayes.inference import evidence
from ldbb_bayes.inference.coefficients import ModelDraws
from ldbb_bayes.inference.evidence import (
    Evidences,
    probabilities,
)
from ldbb_bayes.inference.fit import Concern, ConcernKind, fit_of_parts
from ldbb_bayes.inference.mcmc import StoppingRule, assess
from ldbb_bayes.inference.nodes import HyperPosterior, Nodes
from ldbb_bayes.inference.posterior import build_tree
from ldbb_bayes.inference.sample import densities_of, groups_of, prior_draws_of, record_from
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array

__all__ = ["average"]

if TYPE_CHECKING:
    import xarray as xr


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
        ModelDraws(weighed[k].bound, *reversed(weighed[k].draw(int(count), rng)))
        for k, count in counts
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
