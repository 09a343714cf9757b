"""c_m ~ N(μ, diag(s²)), b ~ N(0, I), μ_j ~ N(0, 1), s_j ~ HalfNormal(spread_scale), all in units of the parameters' prior sd.

c_m are the parameters of machine m, the same in all its campaigns; b the errors of the one instrument. What the campaigns say of
both is Gaussian (`FleetStatistics`), so that everything but s is integrated out exactly: every machine's deviation from μ for
many s at once, then x = (μ, b); ln s is drawn about its mode and weighted. A machine is compared with what the others predict of
it, everything but their spread integrated out; a machine's campaigns with one another.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import Field
from scipy.special import chdtrc, gammaincinv, ndtr, ndtri
from scipy.stats import qmc

from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.population_prior import Meaning, digest_of
from ldbb_bayes.fleet.statistics import (
    Caveat,
    CaveatKind,
    FleetStatistics,
    Summary,
    alone,
    choose,
    deviating,
    fleet_statistics,
    force_caveats,
    keyed,
    labels,
    mixture_covariance,
    narrow_forces,
    whitened,
)
from ldbb_bayes.inference.posterior import check_probability, pareto_smooth
from ldbb_bayes.jobs import one_blas_thread
from ldbb_bayes.model.gaussian import (
    Gaussian,
    holm,
    mixture_moments,
    mixture_quantiles,
    newton,
    solve_lower,
    weighted_quantiles,
)
from ldbb_bayes.report.text import parts_of
from ldbb_bayes.report.wording import caveat_words, nuisance_words, population_doubts, population_sentences, with_words
from ldbb_bayes.result import Result, Table, json_text
from ldbb_bayes.units import display_name, display_unit, plus_minus, ranked, round_uncertainty, state, units_for

__all__ = ["PooledMachine", "PooledParameter", "Population", "pool", "population"]

Array = NDArray[Any]
FEWEST, FALSE_ALARMS = 6, 0.05
# Pairs of a spread and a machine that are worked on at once.
_TOGETHER = 4096

# ---- everything but the spreads integrated out


def machines_of(statistics: FleetStatistics) -> tuple[tuple[str, ...], Gaussian]:
    """The machines in the order in which they first appear, and the product of each one's likelihoods, shape (n, q)."""
    place = {name: k for k, name in enumerate(dict.fromkeys(statistics.machines))}
    of = [place[name] for name in statistics.machines]
    sums = []
    for part in (statistics.likelihood.precision, statistics.likelihood.shift):
        sums.append(np.zeros((len(place), *part.shape[1:])))
        np.add.at(sums[-1], of, part)
    return tuple(place), Gaussian(*sums)


def _chunks(spread: Array, likelihood: Gaussian) -> Iterator[slice]:
    size = max(1, _TOGETHER // len(likelihood.shift))
    return (slice(start, start + size) for start in range(0, len(spread), size))


def common_of(likelihood: Gaussian, spread: Array) -> Gaussian:
    """x = (μ, b) for k spreads (k, c), shape (k, q); ``log_integral`` is ln p(y | s), up to a constant."""
    sums = []
    for rows in _chunks(spread, likelihood):
        each = deviating(likelihood, spread[rows])
        sums.append((each.precision.sum(axis=1), each.shift.sum(axis=1), each.log_constant.sum(axis=1)))
    precision, shift, constant = (np.concatenate(parts) for parts in zip(*sums, strict=True))
    return Gaussian(np.eye(shift.shape[1]) + precision, shift, constant)


def estimates_of(likelihood: Gaussian, spread: Array, common: Gaussian) -> tuple[Array, Array, Array, Array, Array]:
    """Mean and sd of c_m, mean and variance of z_m = (c_m − μ) / s, and Var(z_m | y, μ, b, s), each (k, n, c)."""
    c, q = spread.shape[1], likelihood.shift.shape[1]
    lower, solved = whitened(likelihood, spread)
    inverse = solve_lower(lower, np.broadcast_to(np.eye(c), lower.shape))
    share = (inverse**2).sum(axis=-2)
    gain = np.swapaxes(inverse, -1, -2) @ solved
    z = gain[..., q] - (gain[..., :q] @ common.mean[:, None, :, None])[..., 0]
    root, s = common.spread()[:, None], spread[:, None]
    own = np.eye(c, q) - s[..., None] * gain[..., :q]
    sd = np.sqrt(s**2 * share + ((own @ root) ** 2).sum(axis=-1))
    return common.mean[:, None, :c] + s * z, sd, z, share + ((gain[..., :q] @ root) ** 2).sum(axis=-1), share


_FREEDOM, _STEP, _POLISH = 5.0, 1e-4, 4
_DOWN, _UP = 80.0, 25.0
_GOOD_SHARE, _LEAST_VARIANCE, _FLATTEST = 0.2, 0.05, 1e-3


@dataclass(frozen=True, eq=False)
class SpreadDensity:
    """ln p(t | y) of t = ln s, up to a constant; τ = ``scale``, in units of the prior sd."""

    likelihood: Gaussian
    scale: float

    def log(self, t: Array) -> Array:
        """ln p(t | y), shape (k,), of t of shape (k, c)."""
        prior = (t - 0.5 * np.exp(2.0 * (t - np.log(self.scale)))).sum(axis=-1)
        return np.asarray(common_of(self.likelihood, np.exp(t)).log_integral + prior)

    def gradient(self, t: Array) -> Array:
        """∂ ln p(t | y) / ∂ t, shape (k, c): Σ_m (E[z_m² | y, s] − 1) (Fisher's identity) and the prior's."""
        s = np.exp(t)
        _, _, z, variance, _ = estimates_of(self.likelihood, s, common_of(self.likelihood, s))
        return np.asarray((z**2 + variance - 1.0).sum(axis=1) + 1.0 - (s / self.scale) ** 2)

    def derivatives(self, t: Array) -> tuple[Array, Array]:
        """Gradient (c,) and Hessian (c, c) at one t."""
        step = _STEP * np.eye(len(t))
        slope = self.gradient(np.concatenate([t[None], t + step, t - step]))
        hessian = (slope[1 : len(t) + 1] - slope[len(t) + 1 :]) / (2.0 * _STEP)
        return slope[0], 0.5 * (hessian + hessian.T)

    def mode(self, start: Array) -> tuple[Array, Array]:
        """Where the density is highest, shape (c,), and the curvature there, made positive definite."""
        t = newton(self.log, self.derivatives, start)
        for _ in range(_POLISH):
            gradient, hessian = self.derivatives(t)
            step = np.linalg.solve(_upright(hessian), gradient)
            t = t + step / max(1.0, float(np.abs(step).max()))
        return t, _upright(self.derivatives(t)[1])


def _upright(hessian: Array) -> Array:
    """The curvature with every eigenvalue's size, and none near zero."""
    values, vectors = np.linalg.eigh(-hessian)
    return np.asarray((vectors * np.maximum(np.abs(values), _FLATTEST)) @ vectors.T)


@dataclass(frozen=True, eq=False)
class Spreads:
    """Weighted draws of s (k, c), in units of the prior sd.

    ``log_weight`` is ln of target over proposal, as it came, ``weight`` Pareto-smoothed, summing to one; above ``good_k`` the
    draws cannot be trusted. ``mode`` is that of ln s.
    """

    spread: Array
    log_weight: Array
    weight: Array
    pareto_k: float
    good_k: float
    mode: Array

    @property
    def trusted(self) -> bool:
        """Whether Pareto's k̂ is low enough."""
        return self.pareto_k <= self.good_k

    @property
    def effective(self) -> float:
        """Effective number of draws, 1 / Σ w²."""
        return 1.0 / float(np.sum(self.weight**2))

    def first(self, size: int) -> Spreads:
        """The first draws alone: they are spread as evenly as all of them."""
        if size >= len(self.weight):
            return self
        return Spreads(self.spread[:size], self.log_weight[:size], *pareto_smooth(self.log_weight[:size]), self.mode)


def draw_spreads(density: SpreadDensity, parameters: int, *, seed: int, size: int = 2048, start: Array | None = None) -> Spreads:
    """Draws from a Student t about the mode, weighted; once more about their own moments where these fit better.

    Points are scrambled Sobol ones, ``size`` a power of two; the search for the mode starts at ln τ, or ``start``.
    """
    mode, curvature = density.mode(np.full(parameters, np.log(density.scale)) if start is None else start)
    inverse = np.linalg.inv(curvature)
    found = _weighed(density, mode, mode, inverse, seed=seed, size=size)
    if found.trusted and found.effective > _GOOD_SHARE * size:
        return found
    middle, covariance = mixture_covariance(found.weight, np.log(found.spread))
    other = _weighed(density, mode, middle, covariance + _LEAST_VARIANCE * inverse, seed=seed + 1, size=size)
    return min(found, other, key=lambda own: (not own.trusted, own.pareto_k if not own.trusted else -own.effective))


def _weighed(density: SpreadDensity, mode: Array, middle: Array, covariance: Array, *, seed: int, size: int) -> Spreads:
    c = len(middle)
    points = np.clip(qmc.Sobol(c + 1, rng=np.random.default_rng(seed)).random(size), 1e-12, 1.0 - 1e-12)
    chi = 2.0 * gammaincinv(0.5 * _FREEDOM, points[:, 0])
    white = ndtri(points[:, 1:]) * np.sqrt(_FREEDOM / chi)[:, None]
    limits = np.log(density.scale) - _DOWN, max(np.log(density.scale), float(mode.max())) + _UP
    t = np.clip(middle + white @ np.linalg.cholesky(covariance).T, *limits)
    log_weight = density.log(t) + 0.5 * (_FREEDOM + c) * np.log1p((white**2).sum(axis=1) / _FREEDOM)
    return Spreads(np.exp(t), log_weight, *pareto_smooth(log_weight), mode)


# ---- which machines do not belong, and which contradict themselves

# Information, in units of the prior's: less tells nothing.
_SEEN = 1e-6
_ANEW, _MOST_ANEW = 512, 200


@dataclass(frozen=True, eq=False)
class Belonging:
    """The n machines, each against the others.

    ``p_value`` (n,) is the probability, at most, that a parameter of a machine of the same population stands out so much,
    ``family_wise`` allows for the number of machines (Holm); ``z`` and ``parameter_p_value`` (n, c) are of each parameter by
    itself, two-sided. Readings say something of machines that are ``seen``; p-values that are ``doubtful`` cannot be trusted
    (Pareto's k̂).
    """

    p_value: Array
    family_wise: Array
    z: Array
    parameter_p_value: Array
    seen: Array
    doubtful: Array

    @property
    def flagged(self) -> Array:
        """Machines that do not belong, shape (n,)."""
        return self.family_wise < FALSE_ALARMS


def belonging_of(
    density: SpreadDensity, spreads: Spreads, *, seed: int, progress: Callable[[int, int], None] | None = None
) -> Belonging:
    """Every machine left out in turn: by weights of these draws, or where they cannot be trusted by drawing s anew without it."""
    likelihood, spread = density.likelihood, spreads.spread
    n, c = len(likelihood.shift), spread.shape[1]
    by_itself = alone(likelihood, c)
    log_density, z = _left_out(likelihood, spread)
    smoothed = [pareto_smooth(spreads.log_weight - log_density[:, m]) for m in range(n)]
    weight, k, good = (np.array(part) for part in zip(*smoothed, strict=True))
    single, side = _averaged(weight, z)
    doubtful = k > good
    again = np.flatnonzero(doubtful)
    again = again[np.argsort(single.min(axis=1)[again], kind="stable")][:_MOST_ANEW]
    for done, m in enumerate(again):
        kept = np.arange(n) != m
        others = SpreadDensity(Gaussian(likelihood.precision[kept], likelihood.shift[kept]), density.scale)
        own = draw_spreads(others, c, seed=seed, size=_ANEW, start=spreads.mode)
        common = common_of(others.likelihood, own.spread)
        one = _standardised([part[m] for part in by_itself], common.mean, common.spread, own.spread)
        doubtful[m] = not own.trusted
        single[m], side[m] = (part[0] for part in _averaged(own.weight[None], one[:, None]))
        if progress is not None:
            progress(done + 1, len(again))
    overall = np.minimum(1.0, c * single.min(axis=1))
    seen = np.linalg.eigvalsh(likelihood.precision[:, :c, :c])[:, -1] > _SEEN
    return Belonging(overall, holm(overall), -side * ndtri(0.5 * single), single, seen, doubtful)


def _left_out(likelihood: Gaussian, spread: Array) -> tuple[Array, Array]:
    """ln p(y_m | y_−m, s) of every machine, (k, n), and z, (k, n, c)."""
    by_itself = alone(likelihood, spread.shape[1])
    common = common_of(likelihood, spread)
    parts = []
    for rows in _chunks(spread, likelihood):
        each = deviating(likelihood, spread[rows])
        others = Gaussian(common.precision[rows, None], common.shift[rows, None], common.log_constant[rows, None]) - each
        z = _standardised(by_itself, others.mean, others.spread, spread[rows, None])
        parts.append((common.log_integral[rows, None] - others.log_integral, z))
    log_density, z = (np.concatenate(part) for part in zip(*parts, strict=True))
    return log_density, z


def _standardised(by_itself: Sequence[Array], mean: Array, spread_of: Callable[[Array], Array], spread: Array) -> Array:
    """z of what machines by themselves estimate (`alone`), under x of this mean and the spread of machines."""
    own, seen, estimate = by_itself
    c = own.shape[-1]
    left = estimate - (seen @ mean[..., None])[..., 0]
    noise = (seen[..., :c] * own).sum(axis=-1)
    variance = (spread_of(seen) ** 2).sum(axis=-1) + ((seen[..., :c] * spread[..., None, :]) ** 2).sum(axis=-1) + noise
    return np.divide(left, np.sqrt(variance), out=np.zeros_like(left), where=variance > 0.0)


def _averaged(weights: Array, z: Array) -> tuple[Array, Array]:
    """Two-sided p over s, twice the lesser tail of the mixture, and the side, each (n, c); weights (n, k), z (k, n, c)."""
    above, below = (np.einsum("mk,kmj->mj", weights, ndtr(side * z)) for side in (-1.0, 1.0))
    return np.clip(2.0 * np.minimum(above, below), 1e-300, 1.0), np.where(above < below, 1.0, -1.0)


_CONTRADICTION = 0.01


def _repeat_p_values(statistics: FleetStatistics, mean: Array, covariance: Array) -> dict[str, float]:
    """χ² p of every machine with at least two campaigns; mean (s,) and covariance (s, s) of b, as all campaigns know it."""
    c, found = len(statistics.parameters), {}
    for name, places in pd.Series(statistics.machines).groupby(list(statistics.machines), sort=False).groups.items():
        seen, left = [], []
        for i in places:
            rows = statistics.likelihood.precision[i, :c]
            values, vectors = np.linalg.eigh(rows[:, :c])
            whiten = (vectors / np.sqrt(np.where(values > _SEEN, values, np.inf))).T
            seen.append(whiten @ rows)
            left.append(whiten @ (statistics.likelihood.shift[i, :c] - rows[:, c:] @ mean))
        if len(seen) > 1:
            design = np.concatenate(seen)
            told = design.any(axis=1)
            root = np.linalg.cholesky(np.eye(len(design)) + design[:, c:] @ covariance @ design[:, c:].T)
            own, reading = np.linalg.solve(root, design[:, :c]), np.linalg.solve(root, np.concatenate(left))
            best, _, rank, _ = np.linalg.lstsq(own, reading, rcond=1e-10)
            freedom = int(told.sum()) - int(rank)
            found[str(name)] = float(chdtrc(freedom, np.sum((reading - own @ best) ** 2))) if freedom > 0 else 1.0
    return found


def contradicting(statistics: FleetStatistics, mean: Array, covariance: Array) -> list[str]:
    """Machines whose campaigns contradict one another: family-wise p (Holm) below 1 %; arguments as for the p-values."""
    p = _repeat_p_values(statistics, mean, covariance)
    return [name for name, own in zip(p, holm(np.array(list(p.values()))), strict=True) if own < _CONTRADICTION]


# ---- what is found


@dataclass(frozen=True)
class PooledParameter(Result):
    """One parameter over the machines.

    Attributes
    ----------
    prior_mean, prior_sd : float
        What was believed of the mean of the population.
    mean : Summary
        Of the population.
    spread, spread_percent : Summary
        Standard deviation of the machines about it; in per cent of it, the uncertainty of the spread alone, None where the mean
        is not known to a fifth.
    next : Summary
        A machine of the population that was not measured.
    instrument_sd, instrument_share : float
        Part of the sd of the mean that comes with the one instrument, and its share of the variance: more machines do
        not make it less.
    """

    unit: str
    prior_mean: float
    prior_sd: float
    mean: Summary
    spread: Summary
    spread_percent: Summary | None
    next: Summary
    instrument_sd: float
    instrument_share: float


@dataclass(frozen=True)
class Against(Result):
    """One parameter of a machine against the others: z, and its two-sided p-value."""

    z: float
    p_value: float


@dataclass(frozen=True)
class PooledMachine(Result):
    """One machine.

    Attributes
    ----------
    estimate : dict of parameter to Summary
        With what the population tells of it.
    alone : dict of parameter to Summary
        From its own campaigns and the prior of a fit, the instrument's errors as all campaigns know them.
    shrinkage : dict of parameter to float
        Var(c_m | y, μ, b, s) / s²: 0 where the machine's own readings decide, 1 where the population does.
    p_value, family_wise_p_value : float or None
        At most, that a parameter of a machine of the population the others make up stands out so much, allowing for the number
        of parameters, in the second of machines too (Holm); none with too few machines.
    flag : bool
        The family-wise p-value is below 5 %.
    parameters : dict of parameter to Against
        Each by itself.
    """

    name: Annotated[str, Field(exclude=True)]
    campaigns: int
    estimate: dict[str, Summary]
    alone: dict[str, Summary]
    shrinkage: dict[str, float]
    p_value: float | None = None
    family_wise_p_value: float | None = None
    flag: bool = False
    parameters: dict[str, Against] = field(default_factory=dict)


_CONSTANT = re.compile(r"C_...")


@dataclass(frozen=True, eq=False)
class Population(Result):
    """Machines of one kind, partially pooled.

    Attributes
    ----------
    reference_force_N : float
        Force at which compliances are meant.
    forces_N : tuple of float
        Lowest and highest force tested in all campaigns.
    compliances : mapping of compliance to mapping
        What they stand for, where the batch says it.
    instrument : tuple of str
        Errors taken as common to all campaigns.
    spread_scale : float
        Prior of a spread: HalfNormal(spread_scale · prior_sd).
    pareto_k, trusted : float, bool
        Of the weights of the spreads, the lower the better; whether that is low enough.
    judged : bool
        Whether of every machine readings tell something and its p-value can be trusted: only then none standing out means that.
    readings : tuple of str
        Digests of the campaigns' readings, so that none of them takes its prior from what it said itself.
    """

    parameters: dict[str, PooledParameter]
    machine: dict[str, PooledMachine]
    campaigns: int
    reference_force_N: float
    forces_N: tuple[float, float]
    topology: str
    compliances: Mapping[str, Meaning]
    instrument: tuple[str, ...]
    spread_scale: float
    seed: int
    pareto_k: float
    trusted: bool
    caveats: tuple[Caveat, ...]
    ci_prob: Annotated[float, Field(exclude=True)]
    judged: Annotated[bool, Field(exclude=True)]
    readings: Annotated[tuple[str, ...], Field(alias="readings_sha256")] = ()

    @property
    def not_belonging(self) -> tuple[str, ...]:
        """Machines that stand out from the others, the worst first."""
        flagged = sorted(own.name for own in self.machine.values() if own.flag)
        return tuple(ranked(flagged, lambda name: -float(np.log(self.machine[name].p_value or 1.0))))

    def as_dict(self) -> dict[str, Any]:
        """For JSON: population.json; ``next`` is what `prior_from` reads."""
        following = {
            name: {"unit": own.unit, "mean": own.next.mean, "sd": own.next.sd}
            for name, own in self.parameters.items()
            if _CONSTANT.fullmatch(name)
        }
        found = {"schema": 1, "kind": "population", "machines": len(self.machine), **keyed(super().as_dict(), self.ci_prob)}
        return found | {"next": following, "not_belonging": list(self.not_belonging)}

    def sizes(self) -> dict[str, list[float]]:
        """Sizes of means and machines by inside unit, for `units_for`."""
        found: dict[str, list[float]] = {}
        for own in self.parameters.values():
            found.setdefault(own.unit, []).extend((own.mean.mean, own.next.mean))
        return found

    def machines_table(self) -> pd.DataFrame:
        """One row per machine, inside units."""
        rows: dict[str, dict[str, Any]] = {}
        for name, own in self.machine.items():
            rows[name] = {what: getattr(own, what) for what in ("campaigns", "p_value", "family_wise_p_value", "flag")}
            for parameter, found in own.estimate.items():
                against, by_itself = own.parameters.get(parameter), own.alone[parameter]
                numbers = (found.mean, found.sd, *found.interval, by_itself.mean, by_itself.sd, own.shrinkage[parameter])
                heads = ("mean", "sd", "ci_low", "ci_high", "alone_mean", "alone_sd", "shrinkage", "z")
                cells = zip(heads, (*numbers, against and against.z), strict=True)
                rows[name] |= {f"{parameter}.{head}": value for head, value in cells}
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("machine")


@with_words.register
def _in_words(found: Population) -> dict[str, Any]:
    record = found.as_dict() | {"doubts": list(population_doubts(found))}
    return {**record, "sha256": digest_of(json.loads(json_text(record)))}


@parts_of.register
def _parts(found: Population) -> tuple[Table | str, ...]:
    """A row per parameter with its unit, then what to mind."""
    rows = []
    with units_for(found.sizes()):
        for name, own in found.parameters.items():
            factor, unit = display_unit(own.unit)
            whole = (plus_minus(one.mean, one.sd, one.interval, own.unit) for one in (own.mean, own.next))
            mean, following = (text.removesuffix(f" {unit}") for text in whole)
            common = round_uncertainty(own.instrument_sd * factor)[0] if own.instrument_sd > 0.0 else "–"
            spread, percent = state(own.spread.mean, own.spread.sd, own.spread.interval, own.unit), own.spread_percent
            share = "–" if percent is None else f"{percent.mean:.{1 if percent.mean < 10.0 else 0}f} %"
            rows.append((display_name(name), unit, mean, common, spread.value, spread.interval, share, following))
    probability = f"{100 * found.ci_prob:g} %"
    heads = ("parameter", "unit", "mean", "u of the bar", "spread", f"spread, {probability}", "of mean", "next machine")
    meant = (
        "± U = 2u, or the interval where it is asymmetric. u of the bar: what more machines do not make less. Next machine: one "
        "not yet measured."
    )
    table = Table.of("Population", heads, rows, text=("unit",))
    return (table, meant, "", *population_sentences(found), *population_doubts(found))


# Standard uncertainties that a mean must be away from zero before a spread is told in per cent of it.
_KNOWN = 5.0
# sd / scale of a half-normal, and how much of it counts as nothing learnt.
_HALF_NORMAL, _HARDLY = float(np.sqrt(1.0 - 2.0 / np.pi)), 0.8


def _summaries(scale: Array, mean: Array, sd: Array, low: Array, high: Array) -> list[Summary]:
    """Of every parameter, arrays of shape (c,), in inside units."""
    parts = ((scale * part).tolist() for part in (mean, sd, low, high))
    return [Summary(m, u, (a, b)) for m, u, a, b in zip(*parts, strict=True)]


def _mixture(weight: Array, mean: Array, sd: Array, tails: tuple[float, float]) -> tuple[Array, ...]:
    return (*mixture_moments(weight, mean, sd), *mixture_quantiles(weight, mean, sd, tails))


def _instrument_moments(common: Gaussian, weight: Array, parameters: int) -> tuple[Array, Array]:
    """Mean and covariance of b as all campaigns know it."""
    return mixture_covariance(weight, common.mean[:, parameters:], common.covariance[:, parameters:, parameters:])


def _percent(spread: Summary, mean: Summary) -> Summary | None:
    if abs(mean.mean) <= _KNOWN * mean.sd:
        return None
    size, sd, low, high = (100.0 * part / abs(mean.mean) for part in (spread.mean, spread.sd, *spread.interval))
    return Summary(size, sd, (low, high))


def _pooled_parameters(
    statistics: FleetStatistics, spreads: Spreads, few: Spreads, common: Gaussian, tails: tuple[float, float]
) -> dict[str, PooledParameter]:
    """μ and the next machine from conditional Gaussians, s from its draws; ``few`` are the first, ``common`` is theirs."""
    c = len(statistics.parameters)
    scale, mean, sd = statistics.prior_sd[:c], common.mean[:, :c], common.sd[:, :c]
    mu, following = (_mixture(few.weight, mean, own, tails) for own in (sd, np.sqrt(sd**2 + few.spread**2)))
    middle, spread_sd = mixture_moments(spreads.weight, spreads.spread, np.zeros_like(spreads.spread))
    spread = (middle, spread_sd, *weighted_quantiles(spreads.weight, spreads.spread, tails))
    known = np.linalg.inv(common.precision[:, :c, :c])
    shared = few.weight @ (sd**2 - np.diagonal(known, axis1=1, axis2=2)).clip(min=0.0) * bool(statistics.instrument)
    parts = [_summaries(scale, *own) for own in (mu, spread, following)]
    found = {}
    for j, (own, width, after) in enumerate(zip(*parts, strict=True)):
        found[statistics.parameters[j]] = PooledParameter(
            unit=statistics.units[j],
            prior_mean=0.0,
            prior_sd=float(scale[j]),
            mean=own,
            spread=width,
            spread_percent=_percent(width, own),
            next=after,
            instrument_sd=float(scale[j] * np.sqrt(shared[j])),
            instrument_share=float(min(1.0, shared[j] / mu[1][j] ** 2)),
        )
    return found


def _pooled_machines(
    statistics: FleetStatistics, few: Spreads, common: Gaussian, belonging: Belonging | None, tails: tuple[float, float]
) -> dict[str, PooledMachine]:
    """Every machine with the population, alone, and against the others."""
    machines, likelihood = machines_of(statistics)
    names, c = statistics.parameters, len(statistics.parameters)
    mean, sd, share = np.empty((3, len(few.weight), len(machines), c))
    for rows in _chunks(few.spread, likelihood):
        own = Gaussian(common.precision[rows], common.shift[rows])
        mean[rows], sd[rows], _, _, share[rows] = estimates_of(likelihood, few.spread[rows], own)
    b, covariance = _instrument_moments(common, few.weight, c)
    inverse, seen, estimate = alone(likelihood, c)
    gain = seen[..., c:]
    middle = estimate - gain @ b
    width = np.sqrt(np.diagonal(inverse + gain @ covariance @ np.swapaxes(gain, 1, 2), axis1=1, axis2=2))
    pooled = _mixture(few.weight, mean, sd, tails)
    by_itself = (middle, width, *(middle + ndtri(tail) * width for tail in tails))
    shrinkage, campaigns = np.tensordot(few.weight, share, 1), Counter(statistics.machines)
    found = {}
    for m, name in enumerate(machines):
        together, apart = (
            dict(zip(names, _summaries(statistics.prior_sd[:c], *(part[m] for part in own)), strict=True))
            for own in (pooled, by_itself)
        )
        judged: dict[str, Any] = {}
        if belonging is not None:
            against = zip(belonging.z[m].tolist(), belonging.parameter_p_value[m].tolist(), strict=True)
            judged = {
                "p_value": float(belonging.p_value[m]),
                "family_wise_p_value": float(belonging.family_wise[m]),
                "flag": bool(belonging.flagged[m]),
                "parameters": {own: Against(*one) for own, one in zip(names, against, strict=True)},
            }
        own_share = dict(zip(names, shrinkage[m].tolist(), strict=True))
        found[name] = PooledMachine(name, campaigns[name], together, apart, own_share, **judged)
    return found


def _caveats(
    statistics: FleetStatistics,
    parameters: Mapping[str, PooledParameter],
    spreads: Spreads,
    belonging: Belonging | None,
    machines: Sequence[str],
    changed: Sequence[str],
    spread_scale: float,
) -> Iterator[Caveat]:
    yield from force_caveats(statistics)
    if not spreads.trusted:
        yield Caveat(CaveatKind.SPREADS_NOT_TRUSTED, values=(spreads.pareto_k, spreads.good_k))
    scales = {name: spread_scale * own.prior_sd for name, own in parameters.items()}
    prior = [
        name
        for name, own in parameters.items()
        if own.spread.sd > _HARDLY * _HALF_NORMAL * scales[name] and own.spread.mean < 2.0 * scales[name]
    ]
    if prior:
        yield Caveat(CaveatKind.PRIOR_SPREADS, tuple(prior), (spread_scale,))
    if statistics.instrument:
        most = ranked(parameters, lambda name: parameters[name].instrument_share)[0]
        errors = ", ".join(map(nuisance_words, statistics.instrument))
        yield Caveat(CaveatKind.ONE_INSTRUMENT, (most,), (100 * parameters[most].instrument_share,), errors)
    if changed:
        yield Caveat(CaveatKind.CHANGED_MACHINES, tuple(changed))
    if belonging is None:
        yield Caveat(CaveatKind.FEW_MACHINES, values=(len(machines), FEWEST))
        return
    doubts = {CaveatKind.SILENT_MACHINES: ~belonging.seen, CaveatKind.UNCERTAIN_P_VALUES: belonging.doubtful}
    for kind, which in doubts.items():
        if which.any():
            yield Caveat(kind, tuple(name for name, own in zip(machines, which, strict=True) if own))
    if belonging.flagged.any():
        yield Caveat(CaveatKind.OUTLIERS_INCLUDED)


# Draws of s, as many as so many pairs of draw and machine allow: for the spreads themselves, and for every machine.
_SPREADS, _MACHINES = (4_000_000, 2048, 8192), (1_000_000, 256, 2048)


def population(
    rows: pd.DataFrame,
    *,
    parameters: Sequence[str] | None = None,
    exclude: Sequence[str] = (),
    since: str | None = None,
    include_misfits: bool = False,
    reference_force_N: float | None = None,
    spread_scale: float = 0.3,
    one_instrument: bool = True,
    ci_prob: float = 0.95,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Population:
    """The population that the machines of a batch come from, the next machine, and which machines do not belong.

    Parameters
    ----------
    rows : DataFrame
        Of `read_batch`: one row per campaign; campaigns without machine_id count as machines of their own. Which of them count,
        and ``exclude``, ``since`` and ``include_misfits``: see `choose`.
    parameters, reference_force_N, one_instrument
        See `fleet_statistics`; default: all constant compliances at the median of the campaigns' forces, one bar.
    spread_scale : float
        Prior of each spread: HalfNormal(spread_scale · default prior sd of the parameter), see `reference_sd`.
    ci_prob : float
    seed : int
    progress : callable, optional
        Told of machines that are left out by drawing anew: done and total.

    Raises
    ------
    InputError
        For rows that are no batch's, fewer than two machines, machines with other joints, or options out of range.
    """
    _check(rows, spread_scale, ci_prob, reference_force_N)
    relied, caveats = choose(rows, exclude, since, include_misfits)
    statistics = fleet_statistics(
        relied, parameters=parameters, reference_force_N=reference_force_N, one_instrument=one_instrument
    )
    if len(set(statistics.machines)) < 2:
        why = " ".join(("Add campaigns of others.", *map(caveat_words, caveats)))
        raise InputError(f"a population must have at least two machines, got only {statistics.machines[0]}. {why}")
    found = pool(statistics, spread_scale=spread_scale, ci_prob=ci_prob, seed=seed, progress=progress)
    nameless = ~relied["machine_id"].map(lambda own: isinstance(own, str)).astype(bool)
    if nameless.any():
        caveats.append(Caveat(CaveatKind.MACHINES_OF_THEIR_OWN, tuple(labels(relied[nameless]))))
    if one_instrument:
        caveats += narrow_forces(relied, statistics.parameters)
    readings = tuple(str(own) for own in relied.get("sha256", ()) if isinstance(own, str))
    return replace(found, caveats=(*caveats, *found.caveats), readings=readings)


_NEEDED = ("campaign", "status", "machine_id", "date", "topology", "reference_force_N", "gaussian_names", "gaussian_mean")


def _check(rows: pd.DataFrame, spread_scale: float, ci_prob: float, reference_force_N: float | None) -> None:
    missing = [name for name in _NEEDED if name not in rows]
    if missing:
        raise InputError(f"rows must be the table of a batch, got one without {missing[0]}. Give what read_batch returns.")
    check_probability(ci_prob)
    if not (np.isfinite(spread_scale) and spread_scale > 0.0):
        raise InputError(f"spread_scale must be a finite number above zero, got {spread_scale}. The default is 0.3.")
    if reference_force_N is not None and not np.isfinite(reference_force_N):
        raise InputError(f"reference_force_N must be a finite number, got {reference_force_N}. Give a force in N.")


@one_blas_thread
def pool(
    statistics: FleetStatistics,
    *,
    spread_scale: float = 0.3,
    ci_prob: float = 0.95,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Population:
    """The same from statistics of at least two machines; options as for `population`."""
    machines, likelihood = machines_of(statistics)
    n, c = len(machines), len(statistics.parameters)
    density = SpreadDensity(likelihood, spread_scale)
    spreads = draw_spreads(density, c, seed=seed, size=_draws(n, *_SPREADS))
    few = spreads.first(_draws(n, *_MACHINES))
    common = common_of(likelihood, few.spread)
    tails = 0.5 - 0.5 * ci_prob, 0.5 + 0.5 * ci_prob
    parameters = _pooled_parameters(statistics, spreads, few, common, tails)
    belonging = belonging_of(density, few, seed=seed, progress=progress) if n >= FEWEST else None
    changed = contradicting(statistics, *_instrument_moments(common, few.weight, c))
    return Population(
        parameters=parameters,
        machine=_pooled_machines(statistics, few, common, belonging, tails),
        campaigns=len(statistics),
        reference_force_N=statistics.reference_force_N,
        forces_N=statistics.forces_N,
        topology=statistics.topology,
        compliances=statistics.compliances,
        instrument=statistics.instrument,
        spread_scale=spread_scale,
        seed=seed,
        pareto_k=spreads.pareto_k,
        trusted=spreads.trusted,
        caveats=tuple(_caveats(statistics, parameters, spreads, belonging, machines, changed, spread_scale)),
        ci_prob=ci_prob,
        judged=belonging is not None and bool(belonging.seen.all() and not belonging.doubtful.any()),
    )


def _draws(machines: int, pairs: int, fewest: int, most: int) -> int:
    """A power of two."""
    return 2 ** int(np.log2(np.clip(pairs / machines, fewest, most)))
