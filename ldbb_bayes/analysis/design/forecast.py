"""What to expect of tests before they are run: posterior sd of every parameter, information gained, constant or linear.

Of the linear Gaussian model at given hyper-parameters, averaged over these; sd inside the truncation, evidence without it. It
takes the general route through `ldbb_bayes.model.likelihood.Information` and none of the design search's.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from scipy.special import ndtr, ndtri

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.inference.nodes import HyperPosterior, draw_parameters_given
from ldbb_bayes.model.gaussian import Gaussian, Sobol, singular_root
from ldbb_bayes.model.hybrid import BoundModel, HybridModel, information_of, informations_of
from ldbb_bayes.result import Array, Finite, Result

__all__ = ["DECISIVE", "Discrimination", "Expected", "Forecast", "States", "carried", "hyper_nodes", "states_before"]

DECISIVE = 5.0
_REPEATS, _EACH, _LEAST = 4, 256, 1e-12
_VERY_OFTEN, _RANK = 1e6, 1e-6
_KEPT: WeakKeyDictionary[Campaign, list[HyperPosterior]] = WeakKeyDictionary()


@dataclass(frozen=True)
class Expected(Result):
    """Prior sd of one parameter (infinite when flat), in inside units, and its expected posterior sd.

    ``sd`` is inside the truncation, ``untruncated_sd`` without it: their squares are averaged over the hyper-parameters; infinite
    where flat priors leave something undetermined. ``sd_error`` is the standard error of ``sd``, a mean over states of the
    machine, as if these were independent; they are spread more evenly. ``floor_sd`` is what nuisances shared by all tests leave
    if every test were run a million times, narrowed by the truncation as ``sd``.
    """

    unit: str
    prior_sd: Finite
    sd: Finite
    sd_error: Finite
    untruncated_sd: Finite
    floor_sd: Finite


@dataclass(frozen=True)
class Discrimination(Result):
    """What ln B(with the slopes / without) will be: its mean [nat] and the probabilities of decisive evidence for what is true,
    and for what is false, if there are slopes, and if there are none."""

    size: float  # of the slopes, in prior sd
    augmented: bool  # tests already run are part of it: slopes are as those leave them, else drawn from their prior × ``size``
    threshold: float  # |ln B| from which evidence is called decisive [nat]
    expected_with: float
    expected_without: float
    decisive_with: float
    decisive_without: float
    misleading_with: float
    misleading_without: float
    power: dict[str, float]  # probability of decisive evidence if this slope alone is there, of plus or minus ``size`` prior sd


@dataclass(frozen=True, eq=False)
class Forecast(Result):
    """What to expect of tests: sd of every parameter; the expected Kullback-Leibler divergence of the posterior from the prior
    [nat], infinite when that is flat; constant or linear, None without slopes or with flat priors."""

    expected: dict[str, Expected]
    information_gain: Finite
    discrimination: Discrimination | None

    @property
    def determined(self) -> bool:
        """Whether the tests determine every parameter; with proper priors they do."""
        return all(np.isfinite(entry.sd) for entry in self.expected.values())


@dataclass(frozen=True, eq=False)
class States:
    """K equally likely states of the machine: hyper-parameters φ (K, h) [mm], and parameters β (K, p) inside the truncation, none
    when their prior is flat. ``before`` is what the analysis starts from at each φ, truncation aside: the prior, or the posterior
    of tests that count as run."""

    phi: Array
    beta: Array
    before: Gaussian


def hyper_nodes(model: HybridModel, pilot: Campaign, size: int, seed: int) -> Array:
    """Values of φ, equally likely, shape (size, h) [mm]: of its posterior given the pilot, or of its prior for a plan. For a
    prior their number is rounded up to a power of two. With flat priors variances are σ² times something that does not depend on
    it: one node, the root mean square."""
    if pilot.is_plan:
        prior = model.bind(pilot).hyper_prior
        points = Sobol(len(prior.names), np.random.default_rng(seed))
        nodes = np.asarray(prior.quantile(points.random(1 << int(np.ceil(np.log2(size))))))
    else:
        posterior = _posterior(model, pilot)
        nodes = posterior.bound.hyper_prior.phi(posterior.brief.pick(size, np.random.default_rng(seed)))
    return np.sqrt((nodes**2).mean(axis=0, keepdims=True)) if model.prior.flat else nodes


def carried(bound: BoundModel, phi: Array, run: int) -> Array:
    """φ (K, h) of the pilot for a binding of ``run`` of its circles and of circles to come. These have λ = 1, as 1/λ² is one on
    average; scales that do not act on the pilot are spread over their prior."""
    pilot = bound.pilot or bound.campaign
    before = bound if pilot is bound.campaign else _posterior(bound.model, pilot).bound
    place = {name: k for k, name in enumerate(before.hyper_prior.names)}
    circles = dict(zip(bound.setting.circle[:run].tolist(), before.setting.circle.tolist(), strict=False))
    levels = np.random.default_rng(0).permuted(
        np.tile((np.arange(len(phi)) + 0.5) / len(phi), (len(bound.hyper_prior.names), 1)), axis=1
    )
    found = bound.hyper_prior.quantile(levels.T)
    for k, (name, law) in enumerate(zip(bound.hyper_prior.names, bound.hyper_prior.laws, strict=True)):
        own = circles.get(name, "") if law == "circle" else name
        if own in place:
            found[:, k] = phi[:, place[own]]
        elif law == "circle":
            found[:, k] = 1.0
    return found


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


def narrowed(bound: BoundModel, states: States, covariance: Array, seed: int) -> tuple[Array, Array]:
    """Expected posterior variances inside the truncation and their standard errors, (p,) each, from the covariances without it
    (K, p, p). States that the new tests' forces rule out are left out. For every state the mean that the analysis would find is
    drawn, and the truncated Gaussian about it is taken. The errors are those of a mean over as many states."""
    each = np.einsum("kii->ki", covariance)
    plain, change = each.mean(axis=0), np.zeros_like(each)
    if bound.truncation.active:
        possible = bound.truncation.holds(states.beta)
        possible |= not possible.any()
        each, change = each[possible], _change_inside(bound, states, possible, covariance, seed)
    error = (each + change).std(axis=0) / np.sqrt(max(len(each) - 1, 1))
    return np.maximum(plain + change.mean(axis=0), 0.0), error


def _change_inside(bound: BoundModel, states: States, possible: Array, covariance: Array, seed: int) -> Array:
    """What the truncation adds to the variances in possible states, shape (states, p). The mean m that an analysis will find is
    m | β ~ N(m₁ + W (β − m₁), W C), W = 1 − C P₁, with the precision P₁ before the tests and the covariance C after them."""
    scale, start = bound.scale, states.before.mean[possible]
    both = np.outer(scale, scale)
    after = covariance[possible] / both
    weight = np.eye(len(scale)) - after @ (states.before.precision[possible] * both)
    root = singular_root(weight @ after)
    mean = start / scale + np.einsum("kij,kj->ki", weight, (states.beta[possible] - start) / scale)
    spread = singular_root(after) * scale[:, None]
    noise = np.random.default_rng(seed).standard_normal((_REPEATS, *mean.shape))
    drawn = scale * (mean + np.einsum("kij,rkj->rki", root, noise)).reshape(-1, len(scale))
    spread = np.tile(spread, (_REPEATS, 1, 1))
    shift, inside, axes = bound.truncation.orthants(drawn, spread).moments()
    along = spread @ np.swapaxes(axes, 1, 2)
    change = np.einsum("kpd,kpd->kp", along @ (inside - np.eye(shift.shape[1])), along)
    return np.asarray(change.reshape(_REPEATS, *mean.shape).mean(axis=0))


def discrimination_of(
    covariance: Array,
    names: tuple[str, ...],
    *,
    size: float,
    before: Gaussian | None = None,
    threshold: float = DECISIVE,
    seed: int = 1,
) -> Discrimination:
    """What ln B will be, from the slopes' posterior covariances C (K, s, s) in units of their prior sd, one for every value of φ.

    ``before`` is their posterior after tests already run, in the same units; default: none were. With the mean m that the
    analysis will find, ln B = ½ (ln det C + mᵀ C⁻¹ m). With P₁ the precision before, C = L Lᵀ and Lᵀ P₁ L = U e Uᵀ, what
    z = Uᵀ L⁻¹ m consists of is independent: given slopes β with means e Uᵀ L⁻¹ m₁ + (1 − e) Uᵀ L⁻¹ β and variances 1 − e.
    """
    count, s = covariance.shape[:2]
    start = Gaussian.of(np.zeros((count, s)), np.ones((count, s))) if before is None else before
    root = np.linalg.cholesky(covariance)
    left, axes = np.linalg.eigh(np.swapaxes(root, 1, 2) @ start.precision @ root)
    left = np.clip(left, _LEAST, 1.0)
    learnt, turn = 1.0 - left, np.linalg.solve(root @ axes, np.broadcast_to(np.eye(s), covariance.shape))
    log_volume, mean = np.linalg.slogdet(covariance)[1], np.einsum("kij,kj->ki", turn, start.mean)
    points = _points(count, s - 1, seed)

    def probability(centre: Array, variance: Array, level: float) -> float:
        """P(ln B > level), z of these means (K, 1 or 2, s), which the points take in turn, and variances (K, s)."""
        first = np.argsort(-variance, axis=1)[:, None]
        sd = np.sqrt(np.maximum(np.take_along_axis(variance[:, None], first, axis=2), _LEAST))
        own = np.take_along_axis(centre, first, axis=2)[:, np.arange(points.shape[1]) % centre.shape[1]]
        rest = 2.0 * level - log_volume[:, None] - ((own[..., 1:] + sd[..., 1:] * points) ** 2).sum(axis=2)
        # The component of the largest variance is integrated out.
        edge, middle = np.sqrt(np.maximum(rest, 0.0)) / sd[..., 0], own[..., 0] / sd[..., 0]
        return float(np.where(rest > 0.0, ndtr(-edge - middle) + ndtr(middle - edge), 1.0).mean())

    there = mean[:, None], learnt * (1.0 + learnt * (size**2 if before is None else 1.0) / left)
    nothing = (left * mean)[:, None], learnt
    expected = [0.5 * (log_volume + (own[:, 0] ** 2 + variance).sum(axis=1)).mean() for own, variance in (there, nothing)]
    moved = size * np.array([1.0, -1.0])[:, None] * (learnt[:, None] * np.swapaxes(turn, 1, 2))[:, :, None]
    return Discrimination(
        size,
        before is not None,
        threshold,
        float(expected[0]),
        float(expected[1]),
        probability(*there, threshold),
        1.0 - probability(*nothing, -threshold),
        1.0 - probability(*there, -threshold),
        probability(*nothing, threshold),
        {name: probability(nothing[0] + moved[:, j], learnt, threshold) for j, name in enumerate(names)},
    )


def _points(count: int, dimensions: int, seed: int) -> Array:
    """Standard normal points, shape (count, _EACH, dimensions): quasi-random ones, moved at random for each."""
    rng = np.random.default_rng(seed)
    points = Sobol(dimensions, rng).random(_EACH) if dimensions else np.zeros((_EACH, 0))
    return np.asarray(ndtri((points + rng.random((count, 1, dimensions))) % 1.0))


def posteriors(bound: BoundModel, phi: Array, run: int) -> tuple[Gaussian | None, Array]:
    """p(β | y, φ), ``run`` circles being the pilot's, about zero and floor sd (p,), both in units of the prior sd; none where
    flat priors leave something open."""
    phi = carried(bound, phi, run)
    one = information_of(bound, phi[0])
    own, flat, size = one.own, one.flat, len(one.names)
    # All that the readings say of the coefficients, in as few rows as these are.
    rows = np.array([np.linalg.qr(information.rows(), mode="r") for information in informations_of(bound, phi)])
    if flat and np.linalg.matrix_rank(rows[..., own], tol=_RANK).min() < len(own):
        return None, np.zeros(0)
    repeated = np.array([1.0, np.sqrt(_VERY_OFTEN)])[:, None, None, None] * rows
    nothing = np.zeros(repeated.shape[:-1])
    prior = Gaussian.of(np.zeros(size), np.ones(size))
    both = Gaussian.from_rows(repeated, nothing) if flat else prior.observe(repeated, nothing).marginal(own.tolist())
    return Gaussian.factored(both.mean[0], both.root[0], both.scale[0]), np.sqrt((both.sd[1] ** 2).mean(axis=0))
