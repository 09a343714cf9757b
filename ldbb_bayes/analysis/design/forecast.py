"""What to expect of tests before they are run: posterior sd of every parameter, information gained, constant or linear.

Of the linear Gaussian model at given hyper-parameters, averaged over these; sd inside the truncation, evidence without it. It
takes the general route through `ldbb_bayes.model.likelihood.Information` and none of the design search's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from ldbb_bayes.analysis.design.candidates import bind_tests
from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.inference.nodes import HyperPosterior, draw_parameters_given
from ldbb_bayes.model.gaussian import singular_root
from ldbb_bayes.model.hybrid import BoundModel, HybridModel, informations_of
from ldbb_bayes.result import Finite, Result

__all__ = [
    "DECISIVE",
    "Discrimination",
    "Expected",
    "Forecast",
    "States",
    "discrimination_of",
    "forecast",
    "hyper_nodes",
    "narrowed",
    "states_before",
]

Array = NDArray[Any]
DECISIVE = 5.0
_REPEATS = 4
_DRAWS = 2048
_VERY_OFTEN = 1e6
_RANK = 1e-6
_KEPT: WeakKeyDictionary[Campaign, list[tuple[HybridModel, HyperPosterior]]] = WeakKeyDictionary()


@dataclass(frozen=True)
class Expected(Result):
    """Of one parameter, in inside units.

    Attributes
    ----------
    unit : str
    prior_sd : float
        Infinite when flat.
    sd : float
        Posterior sd inside the truncation, its square averaged over the hyper-parameters; infinite where flat priors leave
        something undetermined.
    untruncated_sd : float
        The same without truncation.
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
    size : float
        Of the slopes, in prior sd.
    augmented : bool
        Whether tests already run are part of it: "with" then means slopes as those leave them, else drawn from their prior times
        ``size``.
    threshold : float
        |ln B| from which evidence is called decisive [nat].
    expected_with, expected_without : float
        Mean of ln B if there are slopes, and if there are none [nat].
    decisive_with, decisive_without : float
        Probabilities of decisive evidence for what is true.
    misleading_with, misleading_without : float
        Probabilities of decisive evidence for what is false.
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
    expected : dict of parameter to Expected
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
    mean, covariance : ndarray, shape (K, p) and (K, p, p)
        What the analysis of all tests will start from at each φ, truncation aside: the prior, or the posterior of tests that
        count as run.
    """

    phi: Array
    beta: Array
    mean: Array
    covariance: Array


def hyper_nodes(model: HybridModel, pilot: Campaign, size: int, seed: int) -> Array:
    """Values of φ, equally likely, shape (size, h) [mm]: of its posterior given the pilot, or of its prior for a plan.

    For a prior their number is rounded up to a power of two. With flat priors variances are σ² times something that does not
    depend on it: one node, the root mean square.
    """
    bound = model.bind(pilot)
    prior = bound.hyper_prior
    if pilot.is_plan:
        points = scipy.stats.qmc.Sobol(len(prior.names), rng=np.random.default_rng(seed))
        nodes = np.asarray(prior.quantile(points.random_base2(int(np.ceil(np.log2(size))))))
    else:
        nodes = prior.phi(_posterior(bound).brief.pick(size, np.random.default_rng(seed)))
    return np.sqrt((nodes**2).mean(axis=0, keepdims=True)) if model.prior.flat else nodes


def states_before(model: HybridModel, pilot: Campaign, size: int, seed: int, *, augment: bool) -> States:
    """States drawn from the pilot's posterior, or from the prior for a plan."""
    bound = model.bind(pilot)
    rng = np.random.default_rng(seed)
    phi = hyper_nodes(model, pilot, size, seed)
    count, p = len(phi), len(bound.names)
    if model.prior.flat:
        return States(phi, np.zeros((count, 0)), np.zeros((count, p)), np.full((count, p, p), np.inf))
    if pilot.is_plan:
        beta = bound.draw_parameters(count, rng)
    else:
        beta = draw_parameters_given(_posterior(bound), bound.hyper_prior.free(phi), rng)
    if augment and not pilot.is_plan:
        _, given = bound.given(phi)
        spread = given.spread()
        return States(phi, beta, given.mean, spread @ np.swapaxes(spread, 1, 2))
    prior = np.broadcast_to(np.diag(bound.prior_sd**2), (count, p, p))
    return States(phi, beta, np.broadcast_to(bound.prior_mean, (count, p)), prior)


def _posterior(bound: BoundModel) -> HyperPosterior:
    """p(φ | pilot), computed once while the pilot lives."""
    kept = _KEPT.setdefault(bound.campaign, [])
    found = next((posterior for model, posterior in kept if model == bound.model), None)
    if found is None:
        found = HyperPosterior(bound, truncated=bound.truncation.active)
        kept.append((bound.model, found))
    return found


def _mean_to_come(before: Array, after: Array) -> tuple[Array, Array]:
    """W and a root of V with m | β ~ N(m₁ + W (β − m₁), V) for the mean m that an analysis will find, shapes (K, p, p).

    From the covariances C₁ before and C after the tests: with G = C₁ − C the variance gained, W = G C₁⁻¹ and V = G − W G.
    """
    gained = before - after
    weight = np.swapaxes(np.linalg.solve(before, gained), 1, 2)
    return weight, singular_root(gained - weight @ gained)


def narrowed(bound: BoundModel, states: States, covariance: Array, seed: int) -> Array:
    """Expected posterior variances inside the truncation, shape (p,), from those without it, (K, p, p).

    States that the new tests' forces rule out are left out. For every state the mean that the analysis would find is drawn, and
    the truncated Gaussian about it is taken.
    """
    plain = np.einsum("kii->ki", covariance).mean(axis=0)
    if not bound.truncation.active:
        return np.asarray(plain)
    possible = bound.truncation.holds(states.beta)
    if possible.any():
        states = States(*(getattr(states, part.name)[possible] for part in fields(states)))
        covariance = covariance[possible]
    scale = bound.scale
    after = covariance / np.outer(scale, scale)
    weight, root = _mean_to_come(states.covariance / np.outer(scale, scale), after)
    mean = states.mean / scale + np.einsum("kij,kj->ki", weight, (states.beta - states.mean) / scale)
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
    before: tuple[Array, Array] | None = None,
    threshold: float = DECISIVE,
    seed: int = 1,
) -> Discrimination:
    """What ln B will be, from the slopes' posterior covariances (K, s, s) in units of their prior sd, one for every value of φ.

    ``before`` is their posterior mean and covariance after tests already run, shapes (K, s) and (K, s, s); default: none were.
    """
    count, s = covariance.shape[:2]
    mean, start = (np.zeros((count, s)), np.broadcast_to(np.eye(s), covariance.shape)) if before is None else before
    weight, root = _mean_to_come(start, covariance)
    log_volume = np.linalg.slogdet(covariance)[1]
    rng = np.random.default_rng(seed)
    noise = np.einsum("kij,kdj->kdi", root, rng.standard_normal((count, _DRAWS, s)))

    def log_bayes_factor(slopes: Array) -> Array:
        centre = mean[:, None] + np.einsum("kij,kdj->kdi", weight, slopes - mean[:, None])
        found = np.swapaxes(centre + noise, 1, 2)
        square = (found * np.linalg.solve(covariance, found)).sum(axis=1)
        return 0.5 * (log_volume[:, None] + square)

    drawn = rng.standard_normal((count, _DRAWS, s))
    there = size * drawn if before is None else mean[:, None] + np.einsum("kij,kdj->kdi", singular_root(start), drawn)
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


def forecast(
    model: HybridModel,
    pilot: Campaign,
    tests: Sequence[CircularTest],
    states: States,
    *,
    augment: bool = False,
    slopes: Sequence[str] | None = (),
    slope_size: float = 1.0,
    threshold: float = DECISIVE,
    seed: int = 1,
) -> Forecast:
    """Forecast of tests (added to the pilot's own when ``augment``), from the machine as it may be before them.

    ``slopes`` are to be decided on: empty for all, None for no decision.
    """
    bound = bind_tests(model, pilot, tests, keep=augment)
    scale, flat = bound.scale, model.prior.flat
    covariance, floor = _covariances(bound, states.phi)
    if covariance is None:
        nothing = {p.name: Expected(p.unit, p.prior_sd, np.inf, np.inf, np.inf) for p in bound.parameters}
        return Forecast(nothing, np.inf, None)
    gaussian = scale * np.sqrt(np.einsum("kii->ki", covariance).mean(axis=0))
    inside = np.sqrt(narrowed(bound, states, covariance * np.outer(scale, scale), seed))
    expected = {
        p.name: Expected(p.unit, p.prior_sd, float(sd), float(plain), float(min(least, least * sd / plain)))
        for p, sd, plain, least in zip(bound.parameters, inside, gaussian, floor, strict=True)
    }
    gain = np.inf if flat else float(-0.5 * np.linalg.slogdet(covariance)[1].mean())
    decided = [i for i, p in enumerate(bound.parameters) if p.group == "slope" and (not slopes or p.name in slopes)]
    if flat or not decided or slopes is None:
        return Forecast(expected, gain, None)
    before, unit = None, scale[decided]
    if augment and not pilot.is_plan:
        before = states.mean[:, decided] / unit, states.covariance[:, decided][:, :, decided] / np.outer(unit, unit)
    decision = discrimination_of(
        covariance[:, decided][:, :, decided],
        tuple(bound.names[i] for i in decided),
        size=slope_size,
        before=before,
        threshold=threshold,
        seed=seed,
    )
    return Forecast(expected, gain, decision)


def _covariances(bound: BoundModel, phi: Array) -> tuple[Array | None, Array]:
    """Posterior covariances (K, p, p) in units of the prior sd, and floor sd (p,); None where flat priors leave one open."""
    covariances, floors = [], []
    for information in informations_of(bound, phi):
        own = information.own
        if information.flat and np.linalg.matrix_rank(information.rows()[:, own], tol=_RANK) < len(own):
            return None, np.zeros(0)
        covariances.append(information.covariance()[np.ix_(own, own)])
        floors.append(information.variances(times=_VERY_OFTEN))
    return np.array(covariances), bound.scale * np.sqrt(np.mean(floors, axis=0))
