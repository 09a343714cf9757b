"""Evidences, Bayes factors and marginals from the nodes over φ, everything linear integrated out
exactly; tests left out in turn.

ln p(y_r | y_−r) = ln Z(y) − ln Z(y_−r), campaign properties frozen. A test is what can be left out:
readings of one circle share their set-up shift and discrepancy and are not independent facts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import require
from ldbb_bayes.inference.integrals import CHUNK, Integral
from ldbb_bayes.inference.nodes import Evidence, HyperPosterior, Nodes, TooRoughError, draw_jointly
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.mixtures import mixture_moments
from ldbb_bayes.model.orthant import Orthant
from ldbb_bayes.model.specification import model_to_toml
from ldbb_bayes.model.terms import Hyper
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, Shown, readable

__all__ = [
    "Evidences",
    "check_comparable",
    "leave_one_out",
    "log_bayes_factor",
    "log_evidence",
    "log_prob_truncation",
    "marginals",
    "probabilities",
]

_NEARLY_ONE = 0.1
_ROUGH = 0.1
_DRAWS = 16_384
_SAME = 1e-12


@one_blas_thread
def log_evidence(model: HybridModel, campaign: Campaign, *, tolerance: float = 1e-3) -> Evidence:
    """The exact log evidence by quadrature over the hyper-parameters, truncation included.

    InputError for a flat prior, whose evidence is undefined, a plan, or a tolerance that is not
    positive.

    Parameters
    ----------
    tolerance : error asked for [nat]; ``error`` of the result says what was reached.
    """
    check_comparable(model, campaign)
    require(
        tolerance > 0,
        f"tolerance must be a positive number of nats, got {tolerance}. For example 1e-3.",
    )
    return _posterior(model, campaign).nodes(tolerance).evidence


def _posterior(model: HybridModel, campaign: Campaign, **options: Any) -> HyperPosterior:
    bound = model.bind(campaign)
    return HyperPosterior(bound, truncated=bound.truncation.active, **options)


def check_comparable(model: HybridModel, campaign: Campaign) -> None:
    """Refuse what has no evidence: improper priors, and plans."""
    require(
        not model.prior.flat,
        "a model must have a proper prior to have an evidence, got a flat one. Use the default"
        " preset.",
    )
    require(
        not campaign.is_plan,
        "a campaign must have readings to give an evidence, got a plan. Run the tests, or"
        " simulate it.",
    )


def log_bayes_factor(evidence: Evidence, other: Evidence) -> tuple[float, float]:
    """Return ln of the Bayes factor of a model, with this ``evidence``, over an ``other``, and its
    error [nat].

    InputError when the two are of different readings.
    """
    got = (
        f"got two campaigns ({evidence.sha256[:12]}… and {other.sha256[:12]}…). Compute both"
        " evidences with the same campaign."
    )
    require(
        evidence.sha256 == other.sha256,
        f"a Bayes factor must be between models of the same readings, {got}",
    )
    return evidence.log_value - other.log_value, evidence.error + other.error


def log_prob_truncation(truncated: HyperPosterior, tolerance: float = 0.02) -> tuple[float, float]:
    """ln P(T | y) of the untruncated posterior, and its error [nat]: from the same nodes with and
    without truncation, or where that moves them too far from nodes of each."""
    plain = truncated.plain.nodes(tolerance)
    inside = truncated.nodes(tolerance)
    error = inside.error + plain.error
    log_value = inside.integral.log_integral - plain.integral.log_integral
    require(
        not log_value > _NEARLY_ONE + error,
        f"the probability of physical compliances must not exceed one, got ln P = {log_value:.3g} ±"
        f" {error:.2g}: readings out of reach of double precision. Check their sign, the mount"
        " compensation and the forces.",
    )
    return min(log_value, 0.0), error


@one_blas_thread
def marginals(
    model: HybridModel,
    campaign: Campaign,
    *,
    ci_prob: float = 0.95,
    tolerance: float = 1e-3,
    seed: int = 1,
) -> pd.DataFrame:
    """The posterior's marginals by quadrature.

    InputError for a plan, or a probability or tolerance out of range.

    Parameters
    ----------
    ci_prob : probability of the equal-tailed credible interval.
    tolerance : relative error of the integrals behind means and standard deviations.
    seed : of the points behind the quantiles; where a compliance is bounded their standard error is
        0.5 % of probability.

    Returns
    -------
    Columns unit, mean, sd, median, ci_low, ci_high; one row per parameter and hyper-parameter, in
    mm, N, rad.
    """
    require(
        not campaign.is_plan,
        "marginals must be asked of a campaign with readings, got a plan. Run the tests or"
        " simulate.",
    )
    require(
        0.0 < ci_prob < 1.0, f"ci_prob must lie between 0 and 1, got {ci_prob}. For 95 % give 0.95."
    )
    require(
        0.0 < tolerance < 1.0,
        f"tolerance must lie between 0 and 1, got {tolerance}. For example 1e-3.",
    )
    nodes = _posterior(model, campaign, seed=seed).nodes(tolerance)
    bound = nodes.bound
    levels = np.array([0.5, 0.5 - 0.5 * ci_prob, 0.5 + 0.5 * ci_prob])
    try:
        draws, *_ = draw_jointly(nodes.posterior, _DRAWS, np.random.default_rng(seed))
    except TooRoughError:
        draws = nodes.posterior.emcee_nodes.pick(_DRAWS, np.random.default_rng(seed))
    phi = bound.hyper_prior.phi(nodes.integral.free)
    of_phi = [
        *mixture_moments(nodes.integral.weight, phi, 0.0 * phi),
        *np.quantile(bound.hyper_prior.phi(draws), levels, axis=0),
    ]
    of_beta = [*nodes.moments(), *nodes.quantiles(levels, seed=seed)]
    names = [*bound.names, *bound.hyper_prior.names]
    table = pd.DataFrame(
        np.hstack([of_beta, of_phi]).T, names, ["mean", "sd", "median", "ci_low", "ci_high"]
    )
    table.insert(
        0, "unit", [*(parameter.unit for parameter in bound.parameters), *bound.hyper_prior.units]
    )
    return readable(table, f"Marginals by quadrature, {100 * ci_prob:g} % intervals")


def _silent() -> None:
    """Nobody is told; unlike a lambda it goes to other processes."""


class Evidences(Shown):
    """Nodes and evidences of the models of one campaign, or of the tests to ``keep`` of it, each
    with this error [nat]; ``progress`` is called after each."""

    shown = ("campaign", "tolerance", "every")

    def __init__(
        self,
        campaign: Campaign,
        *,
        tolerance: float = 1e-2,
        progress: Callable[[], object] = _silent,
        keep: Sequence[str] | None = None,
    ) -> None:
        self.campaign = campaign
        self.tolerance = tolerance
        self.progress = progress
        self._keep = keep
        self._weighed: dict[str, Nodes] = {}
        self._relatives: dict[str, _Relatives] = {}
        self._modes: dict[tuple[Hyper, ...], Array] = {}

    def of_campaign(self, campaign: Campaign) -> Evidences:
        """Themselves; nodes of other readings are refused."""
        cure = (
            f"got those of {self.campaign.name or 'another'}. Make them anew: Evidences(campaign)."
        )
        require(
            campaign.sha256 == self.campaign.sha256,
            f"evidences must be of the campaign {campaign.name or ''}, {cure}",
        )
        return self

    def of(self, *models: HybridModel) -> list[Nodes]:
        """Of each model, those that are one Gaussian given φ from the nodes of the largest."""
        keys = {model_to_toml(model): model for model in models}
        for key, model in sorted(
            keys.items(), key=lambda own: (-own[1].degree, len(own[1].fixed), -len(own[1].rivals))
        ):
            if key not in self._weighed:
                self._weighed[key] = self._weigh(model)
            self.progress()
        return [self._weighed[key] for key in keys]

    def unless_rejected(self, below: float, *models: HybridModel) -> list[Nodes]:
        """As `of`, but to a coarse tolerance, and not among `every`, where all log evidences lie
        below a bound."""
        rough = [] if {*map(model_to_toml, models)} <= {*self._weighed} else self._rough.of(*models)
        if not rough or max(nodes.evidence.log_value + nodes.error for nodes in rough) > below:
            return self.of(*models)
        for _ in models:
            self.progress()
        return rough

    def apart(self, tolerance: float | None = None) -> Evidences:
        """Others of the same readings, without models as yet, that look for modes near those found
        here."""
        found = Evidences(self.campaign, tolerance=tolerance or self.tolerance, keep=self._keep)
        found._modes = {**self._modes}
        return found

    @cached_property
    def _rough(self) -> Evidences:
        return self.apart(max(self.tolerance, _ROUGH))

    def _weigh(self, model: HybridModel) -> Nodes:
        check_comparable(model, self.campaign)
        bound = BoundModel(model, self.campaign, keep=self._keep)
        names = bound.hyper_prior.names
        posterior = HyperPosterior(
            bound, truncated=bound.truncation.active, near=self._modes.get(names)
        )
        # What models that are one Gaussian given φ have in common: all but slopes, their rivals and
        # truncation.
        key = model_to_toml(
            model.without("truncation").with_slope_scale(1.0).with_degree(0).with_rivals()
        )
        if key not in self._relatives:
            self._relatives[key] = _Relatives(posterior.plain.nodes(self.tolerance), self.tolerance)
            self._modes.setdefault(names, posterior.plain.mode)
        return self._relatives[key].nodes(posterior)

    @property
    def every(self) -> list[Evidence]:
        """All evidences so far."""
        return [nodes.evidence for nodes in self._weighed.values()]


class _Relatives:
    """Models that are one Gaussian given φ: p(φ | y) and P(T | y, φ) of one from the nodes of
    another, without truncation.

    They differ only in the prior sd of parameters and of rivals of slopes, s₀ there and s₁ here, or
    fix some at zero. Their priors' ratio is a reading of the coefficient at its prior mean, of
    variance v = 1/(1/s₁² − 1/s₀²), or for one that is fixed an exact one at zero (the Savage-Dickey
    ratio): the posterior is conditioned on one after the other.
    """

    def __init__(self, plain: Nodes, tolerance: float) -> None:
        self._integral = plain.integral
        self._bound = plain.bound
        self._tolerance = tolerance

    def nodes(self, posterior: HyperPosterior) -> Nodes:
        """Of the other model; nodes of its own where it has other parameters, or these do not suit
        it."""
        if not set(posterior.bound.coefficients) <= set(self._bound.coefficients):
            return posterior.nodes(self._tolerance)
        log_ratio, *_ = self._changed(posterior.bound, [], np.arange(len(self._integral.free)))
        plain = replace(self._integral, log_density=self._integral.log_density + log_ratio)
        found = self._inside(posterior, plain) if posterior.truncated else Nodes(posterior, plain)
        return found if found.suit(self._tolerance) else posterior.nodes(self._tolerance)

    def _inside(self, posterior: HyperPosterior, plain: Integral) -> Nodes:
        names = [*self._bound.coefficients]
        rows = posterior.bound.physical.rows
        touched = np.flatnonzero((rows != 0.0).any(axis=0))
        own = [names.index(posterior.bound.names[j]) for j in touched]

        def orthant(index: Array) -> Orthant:
            _, mean, covariance = self._changed(posterior.bound, own, index)
            block = np.moveaxis(covariance, -1, 0)
            sd = np.sqrt(np.diagonal(block, axis1=1, axis2=2))
            root = sd[:, :, None] * np.linalg.cholesky(block / (sd[:, :, None] * sd[:, None, :]))
            return Orthant(mean.T @ rows[:, touched].T, rows[:, touched] @ root)

        return posterior.inside(plain, self._tolerance, orthant)

    @cached_property
    def _given(self) -> tuple[Array, Array]:
        """Mean (p, n) and covariance (p, p, n) of the coefficients at the nodes."""
        bound = self._bound
        free = self._integral.free
        p = len(self._bound.coefficients)
        mean = np.empty((p, len(free)))
        covariance = np.empty((p, p, len(free)))
        for start in range(0, len(free), CHUNK):
            part = slice(start, start + CHUNK)
            _, given = bound.collapsed.conditional(bound.hyper_prior.phi(free[part]), last=p)
            mean[:, part], covariance[..., part] = (
                given.mean.T,
                np.moveaxis(given.covariance, 0, -1),
            )
        return mean + np.pad(bound.centre, (p - len(bound.names), 0))[:, None], covariance

    def _changed(
        self, bound: BoundModel, own: list[int], nodes: Array
    ) -> tuple[Array, Array, Array]:
        """ln of the ratio of p(y | φ) (n,), and ``own`` coefficients' mean and covariance under the
        other prior, at nodes."""
        log_ratio = np.zeros(len(nodes))
        other = bound.coefficients
        priors = [
            (*before, other.get(name, (0.0, 0.0))[1])
            for name, before in self._bound.coefficients.items()
        ]
        changed = {j: own for j, own in enumerate(priors) if abs(own[2] - own[1]) > _SAME * own[1]}
        places = np.array([*own, *(j for j in changed if j not in own)], dtype=np.intp)
        mean, covariance = (
            part[np.ix_(*[places] * (part.ndim - 1), nodes)] for part in self._given
        )
        for j, (middle, sd_before, sd) in changed.items():
            k = int(np.argmax(places == j))
            variance = sd_before**2
            at, noise = (middle, 1.0 / (1.0 / sd**2 - 1.0 / variance)) if sd else (0.0, 0.0)
            here = covariance[k, k] + noise
            before = variance + noise
            apart = mean[k] - at
            log_ratio = log_ratio + 0.5 * (
                np.log(before / here) + (middle - at) ** 2 / before - apart**2 / here
            )
            gain = covariance[k] / here
            mean = mean - gain * apart
            covariance = covariance - gain[:, None] * covariance[k]
        return log_ratio, mean[: len(own)], covariance[: len(own), : len(own)]


def leave_one_out(
    weighed: Mapping[str, Nodes],
    *,
    tolerance: float = 1e-2,
    progress: Callable[[], object] = lambda: None,
) -> dict[str, dict[str, Nodes]]:
    """Of every model, by name, every test's name to the nodes of the other tests, from those of
    all; for at least two tests."""
    bounds = [nodes.bound for nodes in weighed.values()]
    tests = bounds[0].test_names
    left: dict[str, dict[str, Nodes]] = {name: {} for name in weighed}
    for test in tests:
        rest = [other for other in tests if other != test]
        evidences = Evidences(bounds[0].campaign, tolerance=tolerance, progress=progress, keep=rest)
        evidences._modes = {
            nodes.bound.hyper_prior.names: nodes.posterior.plain.mode for nodes in weighed.values()
        }
        for name, nodes in zip(
            weighed, evidences.of(*(bound.model for bound in bounds)), strict=True
        ):
            left[name][test] = nodes
    return left


def probabilities(log_evidence: Array) -> Array:
    """Posterior probabilities of models from their log evidences, shape (n,), at equal prior
    probabilities."""
    share = np.exp(log_evidence - log_evidence.max())
    return np.asarray(share / share.sum())
