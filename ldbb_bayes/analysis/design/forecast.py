"""What to expect of tests before they are run: posterior sd of every parameter, information gained, constant or linear.

Of the linear Gaussian model at given hyper-parameters, averaged over these; sd inside the truncation, evidence without it. It
takes the general route through `ldbb_bayes.model.likelihood.Information` and none of the design search's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.inference.nodes import HyperPosterior, draw_parameters_given
from ldbb_bayes.model.gaussian import Gaussian, singular_root
from ldbb_bayes.model.hybrid import BoundModel, HybridModel, information_of, informations_of
from ldbb_bayes.result import Finite, Result

__all__ = [
    "DECISIVE",
    "Discrimination",
    "Expected",
    "Forecast",
    "States",
    "discrimination_of",
    "hyper_nodes",
    "narrowed",
    "posteriors",
    "states_before",
]

Array = NDArray[Any]
DECISIVE = 5.0
_REPEATS, _DRAWS = 4, 2048
_VERY_OFTEN, _RANK = 1e6, 1e-6
_KEPT: WeakKeyDictionary[Campaign, list[HyperPosterior]] = WeakKeyDictionary()


@dataclass(frozen=True)
class Expected(Result):
    """Of one parameter, in inside units.

    Attributes
    ----------
    prior_sd : float
        Infinite when flat.
    sd, untruncated_sd : float
        Posterior sd inside the truncation and without it, its square averaged over the hyper-parameters; infinite where flat
        priors leave something undetermined.
    floor_sd : float
        If every test were run a million times: what nuisances shared by all of them leave, narrowed by the truncation as ``sd``.
    """

    unit: str
    prior_sd: Finite
    sd: Finite
    untruncated_sd: Finite
    floor_sd: Finite


@dataclass(frozen=True)
class Discrimination(Result):
    """What ln B(with the slopes / without) will be.

    Attributes
    ----------
    size, threshold : float
        Of the slopes, in prior sd; |ln B| from which evidence is called decisive [nat].
    augmented : bool
        Whether tests already run are part of it: "with" then means slopes as those leave them, else drawn from their prior times
        ``size``.
    expected_with, expected_without : float
        Mean of ln B if there are slopes, and if there are none [nat].
    decisive_with, decisive_without, misleading_with, misleading_without : float
        Probabilities of decisive evidence for what is true, and for what is false.
    power : dict of slope to float
        Probability of decisive evidence for slopes if this one alone is there, of plus or minus ``size`` prior sd.
    """

    size: float
    augmented: bool
    threshold: float
    expected_with: float
    expected_without: float
    decisive_with: float
    decisive_without: float
    misleading_with: float
    misleading_without: float
    power: dict[str, float]


@dataclass(frozen=True, eq=False)
class Forecast(Result):
    """What to expect of tests.

    Attributes
    ----------
    information_gain : float
        Expected Kullback-Leibler divergence of the posterior from the prior, of all parameters of interest [nat]; infinite when
        the prior is flat.
    discrimination : Discrimination, optional
        Of the model with its slopes against the one without; None without slopes or with flat priors.
    """

    expected: dict[str, Expected]
    information_gain: Finite
    discrimination: Discrimination | None

    @property
    def determined(self) -> bool:
        """Whether the tests determine every parameter; with proper priors they do."""
        return all(np.isfinite(entry.sd) for entry in self.expected.values())


@dataclass(frozen=True, eq=False)
class States:
    """K equally likely states of the machine.

    Attributes
    ----------
    phi : ndarray, shape (K, h) [mm]
    beta : ndarray, shape (K, p)
        Parameters as they may be, inside the truncation; empty when their prior is flat.
    before : Gaussian
        What the analysis of all tests will start from at each φ, truncation aside: the prior, or the posterior of tests that
        count as run.
    """

    phi: Array
    beta: Array
    before: Gaussian


def hyper_nodes(model: HybridModel, pilot: Campaign, size: int, seed: int) -> Array:
    """Values of φ, equally likely, shape (size, h) [mm]: of its posterior given the pilot, or of its prior for a plan.

    For a prior their number is rounded up to a power of two. With flat priors variances are σ² times something that does not
    depend on it: one node, the root mean square.
    """
    if pilot.is_plan:
        prior = model.bind(pilot).hyper_prior
        points = scipy.stats.qmc.Sobol(len(prior.names), rng=np.random.default_rng(seed))
        nodes = np.asarray(prior.quantile(points.random_base2(int(np.ceil(np.log2(size))))))
    else:
        posterior = _posterior(model, pilot)
        nodes = posterior.bound.hyper_prior.phi(posterior.brief.pick(size, np.random.default_rng(seed)))
    return np.sqrt((nodes**2).mean(axis=0, keepdims=True)) if model.prior.flat else nodes


def states_before(model: HybridModel, pilot: Campaign, size: int, seed: int, *, augment: bool) -> States:
    """States drawn from the pilot's posterior, or from the prior for a plan."""
    bound = model.bind(pilot)
    rng = np.random.default_rng(seed)
    phi = hyper_nodes(model, pilot, size, seed)
    shape = len(phi), len(bound.names)
    if model.prior.flat:
        return States(phi, np.zeros((len(phi), 0)), Gaussian(np.zeros((*shape, shape[1])), np.zeros(shape)))
    if pilot.is_plan:
        beta = bound.draw_parameters(len(phi), rng)
    else:
        beta = draw_parameters_given(_posterior(model, pilot), bound.hyper_prior.free(phi), rng)
    if augment and not pilot.is_plan:
        given = bound.given(phi)[1]
        return States(phi, beta, Gaussian.factored(given.mean, given.root, given.scale))
    return States(phi, beta, Gaussian.of(np.broadcast_to(bound.prior_mean, shape), np.broadcast_to(bound.prior_sd**2, shape)))


def _posterior(model: HybridModel, pilot: Campaign) -> HyperPosterior:
    """p(φ | pilot), computed once while the pilot lives."""
    kept = _KEPT.setdefault(pilot, [])
    if not any(posterior.bound.model == model for posterior in kept):
        bound = model.bind(pilot)
        kept.append(HyperPosterior(bound, truncated=bound.truncation.active))
    return next(posterior for posterior in kept if posterior.bound.model == model)


def _mean_to_come(precision: Array, after: Array) -> tuple[Array, Array]:
    """W and a root of V with m | β ~ N(m₁ + W (β − m₁), V) for the mean m that an analysis will find, shapes (K, p, p).

    From the precision P₁ before and the covariance C after the tests: W = 1 − C P₁ and V = W C.
    """
    weight = np.eye(after.shape[-1]) - after @ precision
    return weight, singular_root(weight @ after)


def narrowed(bound: BoundModel, states: States, covariance: Array, seed: int) -> Array:
    """Expected posterior variances inside the truncation, shape (p,), from those without it, (K, p, p).

    States that the new tests' forces rule out are left out. For every state the mean that the analysis would find is drawn, and
    the truncated Gaussian about it is taken.
    """
    plain = np.einsum("kii->ki", covariance).mean(axis=0)
    if not bound.truncation.active:
        return np.asarray(plain)
    possible = bound.truncation.holds(states.beta)
    possible |= not possible.any()
    scale, start = bound.scale, states.before.mean[possible]
    both = np.outer(scale, scale)
    after = covariance[possible] / both
    weight, root = _mean_to_come(states.before.precision[possible] * both, after)
    mean = start / scale + np.einsum("kij,kj->ki", weight, (states.beta[possible] - start) / scale)
    spread = singular_root(after) * scale[:, None]
    rng = np.random.default_rng(seed)
    variances = []
    for _ in range(_REPEATS):
        drawn = scale * (mean + np.einsum("kij,kj->ki", root, rng.standard_normal(mean.shape)))
        shift, inside, axes = bound.truncation.orthants(drawn, spread).moments()
        along = spread @ np.swapaxes(axes, 1, 2)
        change = np.einsum("kpd,kde,kpe->kp", along, inside - np.eye(shift.shape[1]), along)
        variances.append(change.mean(axis=0))
    return np.asarray(np.maximum(plain + np.mean(variances, axis=0), 0.0))


def discrimination_of(
    covariance: Array,
    names: tuple[str, ...],
    *,
    size: float,
    before: Gaussian | None = None,
    threshold: float = DECISIVE,
    seed: int = 1,
) -> Discrimination:
    """What ln B will be, from the slopes' posterior covariances (K, s, s) in units of their prior sd, one for every value of φ.

    ``before`` is their posterior after tests already run, in the same units; default: none were.
    """
    count, s = covariance.shape[:2]
    start = Gaussian.of(np.zeros((count, s)), np.ones((count, s))) if before is None else before
    mean = start.mean[:, None]
    weight, root = _mean_to_come(start.precision, covariance)
    log_volume = np.linalg.slogdet(covariance)[1]
    rng = np.random.default_rng(seed)
    noise = np.einsum("kij,kdj->kdi", root, rng.standard_normal((count, _DRAWS, s)))

    def log_bayes_factor(slopes: Array) -> Array:
        centre = mean + np.einsum("kij,kdj->kdi", weight, slopes - mean)
        to_come = np.swapaxes(centre + noise, 1, 2)
        square = (to_come * np.linalg.solve(covariance, to_come)).sum(axis=1)
        return 0.5 * (log_volume[:, None] + square)

    drawn = rng.standard_normal((count, _DRAWS, s))
    there = size * drawn if before is None else mean + np.einsum("kij,kdj->kdi", singular_root(start.covariance), drawn)
    with_, without = log_bayes_factor(there), log_bayes_factor(np.zeros((count, 1, s)))
    sign = np.where(np.arange(_DRAWS) % 2, 1.0, -1.0)[None, :, None]
    alone = {name: log_bayes_factor(size * sign * np.eye(s)[j]) for j, name in enumerate(names)}
    return Discrimination(
        size,
        before is not None,
        threshold,
        float(with_.mean()),
        float(without.mean()),
        float((with_ > threshold).mean()),
        float((without < -threshold).mean()),
        float((with_ < -threshold).mean()),
        float((without > threshold).mean()),
        {name: float((values > threshold).mean()) for name, values in alone.items()},
    )


def posteriors(bound: BoundModel, phi: Array) -> tuple[Gaussian | None, Array]:
    """p(β | y, φ) about zero and floor sd (p,), both in units of the prior sd; none where flat priors leave something open."""
    one = information_of(bound, phi[0])
    own, flat, size = one.own, one.flat, len(one.names)
    # All that the readings say of the coefficients, in as few rows as these are.
    rows = np.array([np.linalg.qr(information.rows(), mode="r") for information in informations_of(bound, phi)])
    if flat and np.linalg.matrix_rank(rows[..., own], tol=_RANK).min() < len(own):
        return None, np.zeros(0)
    run = np.array([1.0, np.sqrt(_VERY_OFTEN)])[:, None, None, None] * rows
    nothing = np.zeros(run.shape[:-1])
    prior = Gaussian.of(np.zeros(size), np.ones(size))
    both = Gaussian.from_rows(run, nothing) if flat else prior.observe(run, nothing).marginal(own.tolist())
    return Gaussian.factored(both.mean[0], both.root[0], both.scale[0]), np.sqrt((both.sd[1] ** 2).mean(axis=0))
