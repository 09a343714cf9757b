"""ln Z = ln ∫ p(y | φ) p(φ) dφ, everything linear integrated out exactly; truncated: ln Z + ln P(T | y) − ln P(T | prior)."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.inference.nodes import CHUNK, HyperPosterior, Lattice, draw_hyper, grow_lattice
from ldbb_bayes.jobs import one_blas_thread
from ldbb_bayes.model.gaussian import mixture_moments, mixture_quantiles
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.likelihood import ParameterConditional
from ldbb_bayes.model.specification import model_to_toml
from ldbb_bayes.model.terms import Hyper
from ldbb_bayes.model.truncation import Orthant

__all__ = [
    "Evidence",
    "Evidences",
    "Weighed",
    "check_comparable",
    "evidence_of",
    "evidence_on",
    "log_bayes_factor",
    "log_evidence",
    "log_prob_truncation",
    "marginals",
    "moments",
    "probabilities",
    "quantiles",
    "savage_dickey",
]

Array = NDArray[Any]
_NEARLY_ONE = 0.1
_CHECKED = 64
_LOG_2PI = float(np.log(2 * np.pi))
_STEP = 1.75
_SPARE = 1e-7
_COMPONENTS = 8192


@dataclass(frozen=True)
class Evidence:
    """ln Z of a model and a campaign.

    Attributes
    ----------
    log_value : float
        ln of the density of the readings in mm; only differences between models of the same readings mean anything.
    error : float
        Of ``log_value`` [nat].
    nodes : int
        Of the quadrature.
    sha256 : str
        Digest of the readings it is of.
    """

    log_value: float
    error: float
    nodes: int
    sha256: str


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
    bound = model.bind(campaign)
    return evidence_of(HyperPosterior(bound, truncated=bound.truncation.active), tolerance=tolerance)


def check_comparable(model: HybridModel, campaign: Campaign) -> None:
    """Refuse what has no evidence: improper priors, and plans."""
    if model.prior.flat:
        raise InputError(
            "a model must have a proper prior to have an evidence, got a flat one, under which it is undefined. "
            "Use the default preset."
        )
    if campaign.is_plan:
        raise InputError("a campaign must have readings to give an evidence, got a plan. Run the tests, or simulate it.")


def evidence_of(posterior: HyperPosterior, *, tolerance: float = 1e-3) -> Evidence:
    """The same from the density over the hyper-parameters."""
    return evidence_on(posterior, posterior.lattice(tolerance))


def evidence_on(posterior: HyperPosterior, lattice: Lattice) -> Evidence:
    """The same from nodes at hand."""
    prior = posterior.bound.log_prob_truncation_prior if posterior.truncated else 0.0
    error = lattice.error + _orthant_error(posterior, lattice)
    return Evidence(lattice.log_integral - prior, error, len(lattice.weight), _digest(posterior.bound))


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
    inside, every = truncated.brief, plain.brief
    error = inside.error + every.error + _orthant_error(truncated, inside)
    log_value = inside.log_integral - every.log_integral
    if log_value > _NEARLY_ONE + error:
        raise InputError(
            f"the probability of physical compliances must not exceed one, got ln P = {log_value:.3g} ± {error:.2g}: readings "
            "out of reach of double precision. Check their sign, the mount compensation and the forces."
        )
    return min(log_value, 0.0), error


def _digest(bound: BoundModel) -> str:
    """Of the readings the model is bound to."""
    campaign = bound.campaign
    if len(bound.test_names) == len(campaign.tests):
        return campaign.sha256
    return hashlib.sha256("\n".join([campaign.sha256, *bound.test_names]).encode()).hexdigest()


def _orthant_error(posterior: HyperPosterior, lattice: Lattice) -> float:
    """Error of P(T | y, φ), which all nodes share, over the heaviest nodes."""
    if not posterior.truncated:
        return 0.0
    heaviest = np.argsort(-lattice.weight)[:_CHECKED]
    _, error = posterior.given(lattice.free[heaviest])[1].orthant.log_probability()
    return float(np.average(error, weights=lattice.weight[heaviest]))


def savage_dickey(
    posterior: HyperPosterior, evidence: Evidence, names: Sequence[str], *, tolerance: float = 1e-2
) -> tuple[float, float]:
    """ln of the Bayes factor of the model with ``names`` fixed at zero over the model itself, and its error [nat].

    Parameters
    ----------
    posterior : HyperPosterior
        Of the larger model.
    evidence : Evidence
        Of the larger model.
    """
    bound = posterior.bound
    check_known("parameter", names, bound.names)
    index = [bound.names.index(name) for name in names]

    def log_density(free: Array) -> Array:
        """ln p(y, φ) p(ψ = 0, T | y, φ) of the larger model, shape (w,)."""
        total = bound.hyper_prior.log_density_of_free(free)
        inside = np.isfinite(total)
        if inside.any():
            log_given, given = posterior.given(free[inside])
            total[inside] += log_given + _log_at_zero(posterior, given, index)
        return np.asarray(total)

    lattice = grow_lattice(log_density, posterior.mode, posterior.spread, tolerance=tolerance, step=_STEP)
    mean, sd = bound.prior_mean[index], bound.prior_sd[index]
    prior_at_zero = float(-0.5 * ((mean / sd) ** 2).sum() - np.log(sd).sum() - 0.5 * len(index) * _LOG_2PI)
    value = lattice.log_integral - evidence.log_value - prior_at_zero
    if posterior.truncated:
        value -= bound.model.fixing(*names).bind(bound.campaign).log_prob_truncation_prior
    return value, lattice.error + evidence.error


def _log_at_zero(posterior: HyperPosterior, given: ParameterConditional, index: Sequence[int]) -> Array:
    """ln p(ψ = 0 | y, φ), and where there is truncation ln P(T | ψ = 0, y, φ) of the other parameters; shape (w,)."""
    spread = given.spread()
    basis, triangle = np.linalg.qr(np.swapaxes(spread[:, index], 1, 2))
    white = np.linalg.solve(np.swapaxes(triangle, 1, 2), given.mean[:, index, None])[..., 0]
    log_root = np.log(np.abs(np.diagonal(triangle, axis1=1, axis2=2))).sum(axis=1)
    density = -0.5 * ((white**2).sum(axis=1) + len(index) * _LOG_2PI) - log_root
    if not posterior.truncated:
        return np.asarray(density)
    rows = posterior.bound.physical.rows.copy()
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
    bound = model.bind(campaign)
    posterior = HyperPosterior(bound, truncated=bound.truncation.active, seed=seed)
    lattice = posterior.lattice(tolerance)
    levels = np.array([0.5, 0.5 - 0.5 * ci_prob, 0.5 + 0.5 * ci_prob])
    draws, _ = draw_hyper(posterior, 2 * _COMPONENTS, np.random.default_rng(seed))
    nodes = bound.hyper_prior.phi(lattice.free)
    beta = np.vstack([*moments(posterior, lattice), quantiles(posterior, lattice, levels, seed)])
    phi = np.vstack(
        [
            *mixture_moments(lattice.weight, nodes, np.zeros_like(nodes)),
            *np.quantile(bound.hyper_prior.phi(draws), levels, axis=0),
        ]
    )
    names = [*bound.names, *bound.hyper_prior.names]
    table = pd.DataFrame(np.hstack([beta, phi]).T, index=names, columns=["mean", "sd", "median", "ci_low", "ci_high"])
    table.insert(0, "unit", [*(parameter.unit for parameter in bound.parameters), *("mm" for _ in bound.hyper_prior.names)])
    return table


def moments(posterior: HyperPosterior, lattice: Lattice, *, spare: float = _SPARE) -> tuple[Array, Array]:
    """Mean and sd of β, each (p,): those given φ, exact, averaged over the nodes but for a share ``spare`` of the integral."""
    free, weight = lattice.heaviest(spare)
    means, variances = [], []
    for given, spread in _conditionals(posterior, free):
        mean, variance = given.mean, (spread**2).sum(axis=2)
        if posterior.truncated:
            shift, covariance, axes = given.orthant.moments()
            along = spread @ np.swapaxes(axes, 1, 2)
            mean = mean + np.einsum("wpd,wd->wp", along, shift)
            variance = variance + np.einsum("wpd,wde,wpe->wp", along, covariance - np.eye(shift.shape[1]), along)
        means.append(mean)
        variances.append(variance)
    every = np.concatenate(means)
    mean = weight @ every
    return mean, np.sqrt(weight @ (np.concatenate(variances) + (every - mean) ** 2))


def quantiles(posterior: HyperPosterior, lattice: Lattice, levels: Array, seed: int, *, components: int = _COMPONENTS) -> Array:
    """Quantiles of β, shape (levels, p): of Gaussians given φ and, inside the truncation, given the constrained directions."""
    rng = np.random.default_rng(seed)
    means, sds = [], []
    for given, spread in _conditionals(posterior, lattice.pick(components, rng)):
        mean, variance = given.mean, (spread**2).sum(axis=2)
        if posterior.truncated:
            x, _ = given.orthant.draw(rng)
            along = spread @ np.swapaxes(given.orthant.axes, 1, 2)
            mean = mean + np.einsum("wpd,wd->wp", along, x)
            variance = np.maximum(variance - (along**2).sum(axis=2), 0.0)
        means.append(mean)
        sds.append(np.sqrt(variance))
    mean, sd = np.concatenate(means), np.concatenate(sds)
    sd = np.maximum(sd, 1e-6 * mean.std(axis=0))
    return mixture_quantiles(np.full(len(mean), 1.0 / len(mean)), mean, sd, levels)


def _conditionals(posterior: HyperPosterior, free: Array) -> Iterator[tuple[ParameterConditional, Array]]:
    """p(β | y, φ) and roots of its covariances, a chunk of free coordinates at a time."""
    for start in range(0, len(free), CHUNK):
        _, given = posterior.given(free[start : start + CHUNK])
        yield given, given.spread()


@dataclass(frozen=True, eq=False)
class Weighed:
    """A model, its posterior over the hyper-parameters as weighted nodes, and its evidence."""

    posterior: HyperPosterior
    lattice: Lattice
    evidence: Evidence


class Evidences:
    """Evidences of the models of one campaign.

    Parameters
    ----------
    campaign : Campaign
    tolerance : float
        Error asked of each [nat].
    progress : callable, optional
        Called after each one asked for.
    """

    def __init__(self, campaign: Campaign, *, tolerance: float, progress: Callable[[], None] | None = None) -> None:
        self.campaign, self.tolerance = campaign, tolerance
        self._progress = progress
        self._found: dict[str, Weighed] = {}
        self._modes: dict[tuple[Hyper, ...], Array] = {}

    def of(self, model: HybridModel) -> Weighed:
        """Of one model; the search starts where another model with the same hyper-parameters had its mode."""
        key = model_to_toml(model)
        if key not in self._found:
            check_comparable(model, self.campaign)
            bound = model.bind(self.campaign)
            posterior = HyperPosterior(bound, truncated=bound.truncation.active, near=self._modes.get(model.hypers))
            lattice = posterior.lattice(self.tolerance)
            self._modes.setdefault(model.hypers, posterior.mode)
            self._found[key] = Weighed(posterior, lattice, evidence_on(posterior, lattice))
        if self._progress is not None:
            self._progress()
        return self._found[key]

    @property
    def largest_error(self) -> float:
        """Of all evidences so far [nat]."""
        return max((weighed.evidence.error for weighed in self._found.values()), default=0.0)


def probabilities(log_evidence: Array) -> Array:
    """Posterior probabilities of models from their log evidences, shape (n,), at equal prior probabilities."""
    share = np.exp(log_evidence - log_evidence.max())
    return np.asarray(share / share.sum())
