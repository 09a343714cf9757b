"""Evidences, Bayes factors and marginals from the nodes over φ, everything linear integrated out exactly; tests left out in turn.

ln p(y_r | y_−r) = ln Z(y) − ln Z(y_−r), campaign properties frozen. A test is what can be left out: readings of one circle share
their set-up shift and discrepancy and are not independent facts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.inference.nodes import Evidence, HyperPosterior, Nodes, draw_hyper, grow_lattice
from ldbb_bayes.jobs import one_blas_thread
from ldbb_bayes.model.gaussian import mixture_moments
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.likelihood import ParameterConditional
from ldbb_bayes.model.specification import model_to_toml
from ldbb_bayes.model.terms import Hyper
from ldbb_bayes.model.truncation import Orthant

__all__ = [
    "Evidences",
    "check_comparable",
    "leave_one_out",
    "log_bayes_factor",
    "log_evidence",
    "log_prob_truncation",
    "marginals",
    "probabilities",
    "savage_dickey",
]

Array = NDArray[Any]
_NEARLY_ONE = 0.1
_LOG_2PI = float(np.log(2 * np.pi))
_STEP = 1.75
_DRAWS = 16_384


@one_blas_thread
def log_evidence(model: HybridModel, campaign: Campaign, *, tolerance: float = 1e-3) -> Evidence:
    """The exact log evidence by quadrature over the hyper-parameters, truncation included.

    Parameters
    ----------
    tolerance : float
        Error asked for [nat]; ``error`` of the result says what was reached.

    Raises
    ------
    InputError
        For a flat prior, whose evidence is undefined, a plan, or a tolerance that is not positive.
    """
    check_comparable(model, campaign)
    if not tolerance > 0:
        raise InputError(f"tolerance must be a positive number of nats, got {tolerance}. For example 1e-3.")
    return _posterior(model, campaign).nodes(tolerance).evidence


def _posterior(model: HybridModel, campaign: Campaign, **options: Any) -> HyperPosterior:
    bound = model.bind(campaign)
    return HyperPosterior(bound, truncated=bound.truncation.active, **options)


def check_comparable(model: HybridModel, campaign: Campaign) -> None:
    """Refuse what has no evidence: improper priors, and plans."""
    if model.prior.flat:
        raise InputError(
            "a model must have a proper prior to have an evidence, got a flat one, under which it is undefined. "
            "Use the default preset."
        )
    if campaign.is_plan:
        raise InputError("a campaign must have readings to give an evidence, got a plan. Run the tests, or simulate it.")


def log_bayes_factor(evidence: Evidence, other: Evidence) -> tuple[float, float]:
    """ln of the Bayes factor of a model over another, and its error [nat].

    Raises
    ------
    InputError
        When the two are of different readings.
    """
    if evidence.sha256 != other.sha256:
        raise InputError(
            "a Bayes factor must be between models of the same readings, got two campaigns "
            f"({evidence.sha256[:12]}… and {other.sha256[:12]}…). Compute both evidences with the same campaign."
        )
    return evidence.log_value - other.log_value, evidence.error + other.error


def log_prob_truncation(plain: HyperPosterior, truncated: HyperPosterior) -> tuple[float, float]:
    """ln P(T | y) of the untruncated posterior, from coarse lattices with and without the truncation, and its error [nat]."""
    inside, every = (Nodes(density, density.brief) for density in (truncated, plain))
    error = inside.error + every.error
    log_value = inside.lattice.log_integral - every.lattice.log_integral
    if log_value > _NEARLY_ONE + error:
        raise InputError(
            f"the probability of physical compliances must not exceed one, got ln P = {log_value:.3g} ± {error:.2g}: readings "
            "out of reach of double precision. Check their sign, the mount compensation and the forces."
        )
    return min(log_value, 0.0), error


def savage_dickey(larger: Nodes, names: Sequence[str], *, tolerance: float = 1e-2) -> tuple[float, float]:
    """ln of the Bayes factor of the model with ``names`` fixed at zero over the model itself, and its error [nat]:
    ∫ p(y, φ) p(ψ = 0, T | y, φ) dφ over the evidence and the prior density at ψ = 0."""
    posterior, bound = larger.posterior, larger.bound
    check_known("parameter", names, bound.names)
    index = [bound.names.index(name) for name in names]

    def log_density(free: Array) -> Array:
        total = bound.hyper_prior.log_density_of_free(free)
        inside = np.isfinite(total)
        if inside.any():
            log_given, given = posterior.given(free[inside])
            total[inside] += log_given + _log_at_zero(given, index, truncated=posterior.truncated)
        return np.asarray(total)

    lattice = grow_lattice(log_density, posterior.mode, posterior.spread, tolerance=tolerance, step=_STEP)
    mean, sd = bound.prior_mean[index], bound.prior_sd[index]
    prior_at_zero = float(-0.5 * ((mean / sd) ** 2).sum() - np.log(sd).sum() - 0.5 * len(index) * _LOG_2PI)
    value = lattice.log_integral - larger.evidence.log_value - prior_at_zero
    if posterior.truncated:
        value -= bound.model.fixing(*names).bind(bound.campaign).log_prob_truncation_prior
    return value, lattice.error + larger.evidence.error


def _log_at_zero(given: ParameterConditional, index: Sequence[int], *, truncated: bool) -> Array:
    """ln p(ψ = 0 | y, φ), and where there is truncation ln P(T | ψ = 0, y, φ) of the other parameters; shape (w,)."""
    spread = given.spread()
    basis, triangle = np.linalg.qr(np.swapaxes(spread[:, index], 1, 2))
    white = np.linalg.solve(np.swapaxes(triangle, 1, 2), given.mean[:, index, None])[..., 0]
    log_root = np.log(np.abs(np.diagonal(triangle, axis1=1, axis2=2))).sum(axis=1)
    density = -0.5 * ((white**2).sum(axis=1) + len(index) * _LOG_2PI) - log_root
    if not truncated:
        return np.asarray(density)
    rows = given.physical.rows.copy()
    rows[:, index] = 0.0
    rows = np.array([row for row in dict.fromkeys(map(tuple, rows)) if any(row)]).reshape(-1, rows.shape[1])
    along = rows @ spread
    shared = along @ basis
    mean = given.mean @ rows.T - np.einsum("wmk,wk->wm", shared, white)
    return np.asarray(density + Orthant(mean, along - shared @ np.swapaxes(basis, 1, 2)).log_value())


@one_blas_thread
def marginals(
    model: HybridModel, campaign: Campaign, *, ci_prob: float = 0.95, tolerance: float = 1e-3, seed: int = 1
) -> pd.DataFrame:
    """The posterior's marginals by quadrature.

    Parameters
    ----------
    ci_prob : float
        Probability of the equal-tailed credible interval.
    tolerance : float
        Relative error of the integrals behind means and standard deviations.
    seed : int
        Of the points behind the quantiles; where a compliance is bounded their standard error is half a per cent of probability.

    Returns
    -------
    DataFrame
        Columns unit, mean, sd, median, ci_low, ci_high; one row per parameter and hyper-parameter, in mm, N, rad.

    Raises
    ------
    InputError
        For a plan, or a probability or tolerance out of range.
    """
    if campaign.is_plan:
        raise InputError("marginals must be asked of a campaign with readings, got a plan. Run the tests, or simulate it.")
    if not 0.0 < ci_prob < 1.0:
        raise InputError(f"ci_prob must lie between 0 and 1, got {ci_prob}. For 95 % give 0.95.")
    if not 0.0 < tolerance < 1.0:
        raise InputError(f"tolerance must lie between 0 and 1, got {tolerance}. For example 1e-3.")
    nodes = _posterior(model, campaign, seed=seed).nodes(tolerance)
    bound = nodes.bound
    levels = np.array([0.5, 0.5 - 0.5 * ci_prob, 0.5 + 0.5 * ci_prob])
    draws, _ = draw_hyper(nodes.posterior, _DRAWS, np.random.default_rng(seed))
    phi = bound.hyper_prior.phi(nodes.lattice.free)
    of_phi = [*mixture_moments(nodes.lattice.weight, phi, 0.0 * phi), *np.quantile(bound.hyper_prior.phi(draws), levels, axis=0)]
    of_beta = [*nodes.moments(), *nodes.quantiles(levels, seed=seed)]
    names = [*bound.names, *bound.hyper_prior.names]
    table = pd.DataFrame(np.hstack([of_beta, of_phi]).T, names, ["mean", "sd", "median", "ci_low", "ci_high"])
    table.insert(0, "unit", [*(parameter.unit for parameter in bound.parameters), *("mm" for _ in bound.hyper_prior.names)])
    return table


class Evidences:
    """Nodes and evidences of the models of one campaign, each with this error [nat]; ``progress`` is called after each."""

    def __init__(self, campaign: Campaign, *, tolerance: float, progress: Callable[[], None] | None = None) -> None:
        self.campaign, self.tolerance, self.progress = campaign, tolerance, progress
        self._weighed: dict[str, Nodes] = {}
        self._modes: dict[tuple[Hyper, ...], Array] = {}

    def of(self, model: HybridModel) -> Nodes:
        """Of one model; the search starts where another model with the same hyper-parameters had its mode."""
        key = model_to_toml(model)
        if key not in self._weighed:
            check_comparable(model, self.campaign)
            nodes = _posterior(model, self.campaign, near=self._modes.get(model.hypers)).nodes(self.tolerance)
            self._modes.setdefault(model.hypers, nodes.posterior.mode)
            self._weighed[key] = nodes
        if self.progress is not None:
            self.progress()
        return self._weighed[key]

    @property
    def largest_error(self) -> float:
        """Of all evidences so far [nat]."""
        return max((nodes.evidence.error for nodes in self._weighed.values()), default=0.0)


def leave_one_out(nodes: Nodes, *, tolerance: float = 1e-2, progress: Callable[[], None] | None = None) -> dict[str, Nodes]:
    """Every test's name to the nodes of the other tests; for campaigns of at least two tests."""
    others = {}
    names = nodes.bound.test_names
    for name in names:
        rest = nodes.bound.keeping([other for other in names if other != name])
        start = HyperPosterior(rest, truncated=nodes.posterior.truncated, near=nodes.posterior.mode)
        others[name] = start.nodes(tolerance)
        if progress is not None:
            progress()
    return others


def probabilities(log_evidence: Array) -> Array:
    """Posterior probabilities of models from their log evidences, shape (n,), at equal prior probabilities."""
    share = np.exp(log_evidence - log_evidence.max())
    return np.asarray(share / share.sum())
