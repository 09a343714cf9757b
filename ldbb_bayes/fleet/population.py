"""c_m ~ N(μ, diag(s²)), b ~ N(0, I), μ_j ~ N(0, 1), s_j ~ HalfNormal(spread_scale), all in units of
the parameters' prior sd.

c_m are the parameters of machine m, the same in all its campaigns; b the errors of the one
instrument. What the campaigns say of both is Gaussian (`FleetStatistics`), so that everything but s
is integrated out exactly: every machine's deviation from μ for many s at once, then x = (μ, b); ln
s is drawn about its mode and weighted. A machine is compared with what the others predict of it,
everything but their spread integrated out.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from pydantic import Field
from scipy.special import gammaincinv, ndtr, ndtri
from scipy.stats import qmc

from ldbb_bayes.analysis.multiple_testing import holm
from ldbb_bayes.campaign.campaign import Campaign, check_campaign
from ldbb_bayes.errors import require
from ldbb_bayes.fleet import statistics as stats
from ldbb_bayes.fleet.dataset import Caveat, CaveatKind, choose, labels
from ldbb_bayes.fleet.statistics import (
    FleetStatistics,
    Meaning,
    Summary,
    alone,
    fleet_statistics,
    whitened,
)
from ldbb_bayes.inference.diagnostics import pareto_smooth
from ldbb_bayes.inference.summary import check_probability
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.mixtures import mixture_moments, mixture_quantiles, weighted_quantiles
from ldbb_bayes.model.newton import newton
from ldbb_bayes.model.triangular import eliminate
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.report.text import parts_of
from ldbb_bayes.report.wording import (
    PAGE,
    caveat_words,
    nuisance_words,
    population_doubts,
    population_sentences,
    with_words,
)
from ldbb_bayes.results import Array, Result, Shown, Table, json_text, read_result, readable
from ldbb_bayes.units import (
    display_name,
    display_unit,
    plus_minus,
    ranked,
    round_uncertainty,
    state,
)

__all__ = [
    "PooledMachine",
    "PooledParameter",
    "Population",
    "PopulationPrior",
    "digest_of",
    "pool",
    "population",
    "prior_from",
]

FEWEST = 6
FALSE_ALARMS = 0.05

# ---- machines of a population, everything but their spreads integrated out

# Pairs of a spread and a machine that are worked on at once.
_TOGETHER = 4096


def machines_of(statistics: FleetStatistics) -> tuple[tuple[str, ...], Gaussian]:
    """The machines in the order in which they first appear, and the product of each one's
    likelihoods, shape (n, q)."""
    place = {name: k for k, name in enumerate(dict.fromkeys(statistics.machines))}
    of = [place[name] for name in statistics.machines]
    sums = []
    for part in (statistics.likelihood.precision, statistics.likelihood.shift):
        sums.append(np.zeros((len(place), *part.shape[1:])))
        np.add.at(sums[-1], of, part)
    return tuple(place), Gaussian(*sums)


def chunks(spread: Array, likelihood: Gaussian) -> Iterator[slice]:
    """Slices of spreads, so many that what they take with all machines stays near the processor."""
    size = max(1, _TOGETHER // len(likelihood.shift))
    return (slice(start, start + size) for start in range(0, len(spread), size))


def common_of(likelihood: Gaussian, spread: Array) -> Gaussian:
    """x = (μ, b) for k spreads (k, c), shape (k, q); ``log_integral`` is ln p(y | s), up to a
    constant."""
    (k, c), q = spread.shape, likelihood.shift.shape[1]
    square = np.empty((k, q + 1, q + 1))
    constant = np.empty(k)
    for rows in chunks(spread, likelihood):
        whole = whitened(likelihood, spread[rows])
        flat = whole[:, c:].transpose(2, 1, 0, 3).reshape(whole.shape[2], q + 1, -1)
        square[rows] = flat @ np.swapaxes(flat, 1, 2)
        constant[rows] = -np.log(whole[range(c), range(c)]).sum(axis=(0, 2))
    precision = np.eye(q) + likelihood.precision.sum(axis=0) - square[:, :q, :q]
    return Gaussian(
        precision, likelihood.shift.sum(axis=0) - square[:, :q, q], constant + 0.5 * square[:, q, q]
    )


def estimates_of(likelihood: Gaussian, spread: Array, common: Gaussian) -> Array:
    """Mean and sd of c_m, mean and variance of z_m = (c_m − μ) / s, shape (4, k, n, c)."""
    c = spread.shape[1]
    q = likelihood.shift.shape[1]
    root = np.swapaxes(common.spread(), 1, 2)
    found = np.empty((4, len(spread), len(likelihood.shift), c))
    for rows in chunks(spread, likelihood):
        whole = whitened(likelihood, spread[rows], inverse=True)
        inverse = whole[:, c + q + 1 :]
        s = spread[rows].T[..., None]
        gain = np.einsum("ijkn,irkn->jrkn", inverse, whole[:, c : c + q + 1])
        z = gain[:, q] - np.einsum("jrkn,kr->jkn", gain[:, :q], common.mean[rows])
        own = np.eye(c, q)[..., None, None] - s[:, None] * gain[:, :q]
        of_z, of_c = (
            ((root[rows] @ part.transpose(0, 2, 1, 3)) ** 2).sum(axis=2)
            for part in (gain[:, :q], own)
        )
        share = (inverse**2).sum(axis=0)
        parts = (
            common.mean[rows, :c].T[..., None] + s * z,
            np.sqrt(s**2 * share + of_c),
            z,
            share + of_z,
        )
        found[:, rows] = np.moveaxis(np.stack(parts), 1, -1)
    return found


_FREEDOM = 5.0
_STEP = 1e-4
_DOWN = 80.0
_UP = 25.0
_GOOD_SHARE = 0.2
_LEAST_VARIANCE = 0.05
_FLATTEST = 1e-3


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
        """∂ ln p(t | y) / ∂ t, shape (k, c): Σ_m (E[z_m² | y, s] − 1) (Fisher's identity) and the
        prior's."""
        s = np.exp(t)
        _, _, z, variance = estimates_of(self.likelihood, s, common_of(self.likelihood, s))
        return np.asarray((z**2 + variance - 1.0).sum(axis=1) + 1.0 - (s / self.scale) ** 2)

    def derivatives(self, t: Array) -> tuple[Array, Array]:
        """Gradient (c,) and Hessian (c, c) at one t."""
        step = _STEP * np.eye(len(t))
        slope = self.gradient(np.concatenate([t[None], t + step, t - step]))
        hessian = (slope[1 : len(t) + 1] - slope[len(t) + 1 :]) / (2.0 * _STEP)
        return slope[0], 0.5 * (hessian + hessian.T)

    def mode(self, start: Array) -> tuple[Array, Array]:
        """Where the density is highest, shape (c,), and the curvature there, every eigenvalue by
        its size and none near zero."""
        t = newton(self.log, self.derivatives, start, gain=1e-10)
        values, vectors = np.linalg.eigh(-self.derivatives(t)[1])
        return t, np.asarray((vectors * np.maximum(np.abs(values), _FLATTEST)) @ vectors.T)


@dataclass(frozen=True, eq=False)
class Spreads:
    """Weighted draws of s (k, c), in units of the prior sd. ``log_weight`` is ln of target over
    proposal, as it came, ``weight`` Pareto-smoothed, summing to one; above ``good_k`` the draws
    cannot be trusted. ``mode`` is that of ln s."""

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
        log_weight = self.log_weight[:size]
        return Spreads(self.spread[:size], log_weight, *pareto_smooth(log_weight), self.mode)


def draw_spreads(
    density: SpreadDensity,
    parameters: int,
    *,
    seed: int,
    size: int = 2048,
    start: Array | None = None,
) -> Spreads:
    """Draws from a Student t about the mode, weighted; once more about their own moments where
    these fit better. Points are scrambled Sobol ones, ``size`` a power of two; the search for the
    mode starts at ln τ, or ``start``."""
    mode, curvature = density.mode(
        np.full(parameters, np.log(density.scale)) if start is None else start
    )
    inverse = np.linalg.inv(curvature)
    found = _weighed(density, mode, mode, inverse, seed=seed, size=size)
    if found.trusted and found.effective > _GOOD_SHARE * size:
        return found
    middle, covariance = stats.mixture_covariance(found.weight, np.log(found.spread))
    other = _weighed(
        density, mode, middle, covariance + _LEAST_VARIANCE * inverse, seed=seed + 1, size=size
    )
    return min(
        found,
        other,
        key=lambda own: (not own.trusted, own.pareto_k if not own.trusted else -own.effective),
    )


def _weighed(
    density: SpreadDensity, mode: Array, middle: Array, covariance: Array, *, seed: int, size: int
) -> Spreads:
    c = len(middle)
    points = np.clip(
        qmc.Sobol(c + 1, rng=np.random.default_rng(seed)).random(size), 1e-12, 1.0 - 1e-12
    )
    chi = 2.0 * gammaincinv(0.5 * _FREEDOM, points[:, 0])
    white = ndtri(points[:, 1:]) * np.sqrt(_FREEDOM / chi)[:, None]
    limits = np.log(density.scale) - _DOWN, max(np.log(density.scale), float(mode.max())) + _UP
    t = np.clip(middle + white @ np.linalg.cholesky(covariance).T, *limits)
    log_weight = density.log(t) + 0.5 * (_FREEDOM + c) * np.log1p((white**2).sum(axis=1) / _FREEDOM)
    return Spreads(np.exp(t), log_weight, *pareto_smooth(log_weight), mode)


# ---- which machines do not belong

_ANEW = 512
_MOST_ANEW = 200


@dataclass(frozen=True, eq=False)
class Belonging:
    """The n machines, each against the others.

    ``p_value`` (n,) is the probability, at most, that of so many machines of one population a
    parameter of one stands out so much (Bonferroni over parameters, Holm over machines), ``single``
    (n, c) the two-sided one of each parameter by itself, ``z`` the same as a normal deviate.
    p-values that are ``doubtful`` cannot be trusted (Pareto's k̂).
    """

    p_value: Array
    single: Array
    z: Array
    doubtful: Array


def belonging_of(
    density: SpreadDensity,
    spreads: Spreads,
    common: Gaussian,
    *,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
) -> Belonging:
    """Every machine left out in turn: by weights of these draws, or where they cannot be trusted by
    drawing s anew without it. ``common`` is that of the draws."""
    likelihood, (n, c) = (
        density.likelihood,
        (len(density.likelihood.shift), spreads.spread.shape[1]),
    )
    by_itself = alone(likelihood, c)
    log_density, z = _left_out(likelihood, by_itself, spreads.spread, common)
    smoothed = [pareto_smooth(spreads.log_weight - log_density[:, m]) for m in range(n)]
    weight, k, good = (np.array(part) for part in zip(*smoothed, strict=True))
    single, side = _averaged(weight, z)
    doubtful = k > good
    again = np.flatnonzero(doubtful)
    again = again[np.argsort(single.min(axis=1)[again], kind="stable")][:_MOST_ANEW]
    for done, m in enumerate(again):
        kept = np.arange(n) != m
        others = SpreadDensity(
            Gaussian(likelihood.precision[kept], likelihood.shift[kept]), density.scale
        )
        own = draw_spreads(others, c, seed=seed, size=_ANEW, start=spreads.mode)
        x = common_of(others.likelihood, own.spread)
        one = [part[m : m + 1] for part in by_itself]
        _, left = _against(
            one, np.moveaxis(x.precision, 0, -1)[..., None], x.shift.T[..., None], own.spread
        )
        doubtful[m] = not own.trusted
        single[m], side[m] = (part[0] for part in _averaged(own.weight[None], left))
        if progress is not None:
            progress(done + 1, len(again))
    overall = holm(np.minimum(1.0, c * single.min(axis=1)))
    return Belonging(overall, single, -side * ndtri(0.5 * single), doubtful)


def _left_out(
    likelihood: Gaussian, by_itself: Sequence[Array], spread: Array, common: Gaussian
) -> tuple[Array, Array]:
    """ln p(y_m | y_−m, s) of every machine, up to a constant, (k, n), and z, (c, k, n)."""
    c = spread.shape[1]
    q = likelihood.shift.shape[1]
    log_density = np.empty((len(spread), len(likelihood.shift)))
    z = np.empty((c, len(spread), len(likelihood.shift)))
    for rows in chunks(spread, likelihood):
        whole = whitened(likelihood, spread[rows])
        square = np.einsum("iakn,ibkn->abkn", whole[:, c:], whole[:, c:])
        precision = (
            np.moveaxis(common.precision[rows], 0, -1)[..., None]
            - likelihood.precision.T[:, :, None]
            + square[:q, :q]
        )
        shift = common.shift[rows].T[..., None] - likelihood.shift.T[:, None] + square[:q, q]
        others, z[:, rows] = _against(by_itself, precision, shift, spread[rows])
        own = 0.5 * square[q, q] - np.log(whole[range(c), range(c)]).sum(axis=0)
        log_density[rows] = (common.log_integral - common.log_constant)[rows, None] + own - others
    return log_density, z


def _against(
    by_itself: Sequence[Array], precision: Array, shift: Array, spread: Array
) -> tuple[Array, Array]:
    """ln ∫ of x as the other machines know it, up to a constant (k, n), and z of what machines by
    themselves estimate (`alone`), (c, k, n); x has precision (q, q, k, n) and shift (q, k, n)."""
    q, c, (own, seen, estimate) = len(shift), spread.shape[1], by_itself
    rows = np.broadcast_to(seen.T[:, :, None], (q, c, *shift.shape[1:]))
    whole = np.concatenate([precision, shift[:, None], rows], axis=1)
    eliminate(whole.reshape(1, *whole.shape[:2], -1))
    x = whole[:, q]
    gain = whole[:, q + 1 :]
    noise = (seen[..., :c] * own).sum(axis=-1).T[:, None]
    variance = (
        (gain**2).sum(axis=0) + np.einsum("ka,nja->jkn", spread**2, seen[..., :c] ** 2) + noise
    )
    left = estimate.T[:, None] - (gain * x[:, None]).sum(axis=0)
    z = np.divide(left, np.sqrt(variance), out=np.zeros_like(left), where=variance > 0.0)
    return 0.5 * (x**2).sum(axis=0) - np.log(whole[range(q), range(q)]).sum(axis=0), z


def _averaged(weights: Array, z: Array) -> tuple[Array, Array]:
    """Two-sided p over s, twice the lesser tail of the mixture, and the side, each (n, c); weights
    (n, k), z (c, k, n)."""
    above, below = (np.einsum("mk,jkm->mj", weights, ndtr(side * z)) for side in (-1.0, 1.0))
    return np.clip(2.0 * np.minimum(above, below), 1e-300, 1.0), np.where(above < below, 1.0, -1.0)


# ---- what is found


@dataclass(frozen=True)
class PooledParameter(Result):
    """One parameter over the machines."""

    unit: str
    prior_sd: float  #: of what was believed of the mean of the population, about zero
    mean: Summary  #: of the population
    spread: Summary  #: standard deviation of the machines about it
    next: Summary  #: a machine of the population that was not measured
    #: part of the sd of the mean that comes with the one instrument: more machines do not make it
    #: less
    instrument_sd: float


@dataclass(frozen=True)
class PooledMachine(Result):
    """One machine. ``p_value`` is, at most, that of so many machines of one population a parameter
    of one stands out so much from the others (Bonferroni over parameters, Holm over machines); none
    with too few machines."""

    name: Annotated[str, Field(exclude=True)]
    campaigns: int
    estimate: dict[str, Summary]  #: with what the population tells of it
    #: from its campaigns and the prior of a fit, the instrument's errors as all campaigns know
    #: them
    alone: dict[str, Summary]
    p_value: float | None = None
    flag: bool = False  #: the p-value is below 5 %
    #: of each parameter, against what the other machines predict
    z: dict[str, float] = field(default_factory=dict)


_CONSTANT = re.compile(r"C_...")


@dataclass(frozen=True, eq=False)
class Population(Result):
    """Machines of one kind, partially pooled; only where all could be ``judged`` none standing out
    means that."""

    parameters: dict[str, PooledParameter]  #: mean, spread and next machine, by name
    machine: dict[str, PooledMachine]  #: by machine_id
    campaigns: int  #: their number
    reference_force_N: float  #: at which compliances are meant
    forces_N: tuple[float, float]  #: lowest and highest tested in all campaigns
    topology: str  #: of the machines
    compliances: Mapping[str, Meaning]  #: what they stand for, where the batch says it
    instrument: tuple[str, ...]  #: errors taken as common to all campaigns
    spread_scale: float  #: prior of a spread: HalfNormal(spread_scale · prior_sd)
    seed: int  #: of the draws
    pareto_k: float  #: of the weights of the spreads, the lower the better
    trusted: bool  #: whether that is low enough
    caveats: tuple[Caveat, ...]  #: what to mind
    ci_prob: Annotated[float, Field(exclude=True)]  #: of the intervals
    judged: Annotated[bool, Field(exclude=True)]
    #: so that no campaign takes its prior from itself
    readings: Annotated[tuple[str, ...], Field(alias="readings_sha256")] = ()

    @property
    def not_belonging(self) -> tuple[str, ...]:
        """Machines that stand out from the others, the worst first."""
        flagged = sorted(own.name for own in self.machine.values() if own.flag)
        return tuple(ranked(flagged, lambda name: max(map(abs, self.machine[name].z.values()))))

    def as_dict(self) -> dict[str, Any]:
        """For JSON: population.json; ``next`` is what `prior_from` reads."""
        following = {
            name: {"unit": own.unit, "mean": own.next.mean, "sd": own.next.sd}
            for name, own in self.parameters.items()
            if _CONSTANT.fullmatch(name)
        }
        found = {
            "schema": 1,
            "kind": "population",
            "machines": len(self.machine),
            **stats.keyed(super().as_dict(), self.ci_prob),
        }
        return found | {"next": following, "not_belonging": list(self.not_belonging)}

    def machines_table(self) -> pd.DataFrame:
        """One row per machine, inside units."""
        rows: dict[str, dict[str, Any]] = {}
        for name, own in self.machine.items():
            rows[name] = {what: getattr(own, what) for what in ("campaigns", "p_value", "flag")}
            for parameter, one in own.estimate.items():
                by_itself = own.alone[parameter]
                numbers = (
                    one.mean,
                    one.sd,
                    *one.interval,
                    by_itself.mean,
                    by_itself.sd,
                    own.z.get(parameter),
                )
                heads = ("mean", "sd", "ci_low", "ci_high", "alone_mean", "alone_sd", "z")
                rows[name] |= {
                    f"{parameter}.{head}": value for head, value in zip(heads, numbers, strict=True)
                }
        return readable(pd.DataFrame.from_dict(rows, orient="index").rename_axis("machine"))


@with_words.register
def _in_words(found: Population) -> dict[str, Any]:
    record = found.as_dict() | {"doubts": list(population_doubts(found))}
    return {**record, "sha256": digest_of(json.loads(json_text(record)))}


@parts_of.register
def _parts(found: Population) -> tuple[Table | str, ...]:
    """A row per parameter with its unit, then what to mind."""
    rows = []
    for name, own in found.parameters.items():
        factor, unit = display_unit(own.unit)
        whole = (
            plus_minus(one.mean, one.sd, one.interval, own.unit) for one in (own.mean, own.next)
        )
        mean, following = (text.removesuffix(f" {unit}") for text in whole)
        common = (
            round_uncertainty(2.0 * own.instrument_sd * factor)[0]
            if own.instrument_sd > 0.0
            else "–"
        )
        spread = state(own.spread.mean, own.spread.sd, own.spread.interval, own.unit)
        rows.append(
            (display_name(name), unit, mean, common, spread.value, spread.interval, following)
        )
    heads = (
        "parameter",
        "unit",
        "mean",
        "U of the bar",
        "spread",
        f"spread, {100 * found.ci_prob:g} %",
        "next machine",
    )
    table = Table.of("Population", heads, rows, text=("unit",))
    return (table, PAGE["population"], "", *population_sentences(found), *population_doubts(found))


def _summaries(scale: Array, mean: Array, sd: Array, ends: Array) -> list[Summary]:
    """Of every parameter, arrays of shape (c,), ends (2, c), in inside units."""
    parts = ((scale * part).tolist() for part in (mean, sd, *ends))
    return [Summary(m, u, (a, b)) for m, u, a, b in zip(*parts, strict=True)]


def _mixture(
    weight: Array, mean: Array, sd: Array, tails: tuple[float, float]
) -> tuple[Array, Array, Array]:
    return (*mixture_moments(weight, mean, sd), mixture_quantiles(weight, mean, sd, tails))


def _pooled_parameters(
    statistics: FleetStatistics,
    spreads: Spreads,
    few: Spreads,
    common: Gaussian,
    tails: tuple[float, float],
) -> dict[str, PooledParameter]:
    """μ and the next machine from conditional Gaussians, s from its draws; ``few`` are the first,
    ``common`` is theirs."""
    c = len(statistics.parameters)
    weight = few.weight
    scale = statistics.prior_sd[:c]
    mean = common.mean[:, :c]
    sd = common.sd[:, :c]
    mu, following = (_mixture(weight, mean, own, tails) for own in (sd, np.hypot(sd, few.spread)))
    moments = mixture_moments(spreads.weight, spreads.spread, np.zeros_like(spreads.spread))
    known = np.diagonal(np.linalg.inv(common.precision[:, :c, :c]), axis1=1, axis2=2)
    shared = np.sqrt(weight @ (sd**2 - known).clip(min=0.0)) * bool(statistics.instrument)
    parts = [
        _summaries(scale, *own)
        for own in (
            mu,
            (*moments, weighted_quantiles(spreads.weight, spreads.spread, tails)),
            following,
        )
    ]
    rows = zip(
        statistics.parameters,
        statistics.units,
        scale.tolist(),
        *parts,
        (scale * shared).tolist(),
        strict=True,
    )
    return {name: PooledParameter(*own) for name, *own in rows}


def _pooled_machines(
    statistics: FleetStatistics,
    machines: Sequence[str],
    likelihood: Gaussian,
    spreads: Spreads,
    common: Gaussian,
    belonging: Belonging | None,
    tails: tuple[float, float],
) -> dict[str, PooledMachine]:
    """Every machine with the population, alone, and against the others."""
    names = statistics.parameters
    c = len(statistics.parameters)
    weight = spreads.weight
    mean, sd, _, _ = estimates_of(likelihood, spreads.spread, common)
    b, covariance = stats.mixture_covariance(
        weight, common.mean[:, c:], common.covariance[:, c:, c:]
    )
    inverse, seen, estimate = alone(likelihood, c)
    gain = seen[..., c:]
    middle = estimate - gain @ b
    width = np.sqrt(
        np.diagonal(inverse + gain @ covariance @ np.swapaxes(gain, 1, 2), axis1=1, axis2=2)
    )
    pooled = _mixture(weight, mean, sd, tails)
    by_itself = (middle, width, middle + ndtri(tails)[:, None, None] * width)
    campaigns = Counter(statistics.machines)
    found = {}
    for m, name in enumerate(machines):
        together, apart = (
            dict(
                zip(
                    names,
                    _summaries(statistics.prior_sd[:c], own[0][m], own[1][m], own[2][:, m]),
                    strict=True,
                )
            )
            for own in (pooled, by_itself)
        )
        judged: dict[str, Any] = {}
        if belonging is not None:
            value = float(belonging.p_value[m])
            z = dict(zip(names, belonging.z[m].tolist(), strict=True))
            judged = {"p_value": value, "flag": value < FALSE_ALARMS, "z": z}
        found[name] = PooledMachine(name, campaigns[name], together, apart, **judged)
    return found


def _caveats(
    statistics: FleetStatistics,
    parameters: Mapping[str, PooledParameter],
    spreads: Spreads,
    belonging: Belonging | None,
    machines: Sequence[str],
) -> Iterator[Caveat]:
    yield from statistics.caveats
    if not spreads.trusted:
        yield Caveat(CaveatKind.SPREADS_NOT_TRUSTED, values=(spreads.pareto_k, spreads.good_k))
    if statistics.instrument:
        shares = {
            name: 100.0 * (own.instrument_sd / own.mean.sd) ** 2 for name, own in parameters.items()
        }
        most = ranked(shares, lambda name: shares[name])[0]
        errors = ", ".join(map(nuisance_words, statistics.instrument))
        yield Caveat(CaveatKind.ONE_INSTRUMENT, (most,), (min(100.0, shares[most]),), errors)
    if belonging is None:
        yield Caveat(CaveatKind.FEW_MACHINES, values=(len(machines), FEWEST))
        return
    if belonging.doubtful.any():
        names = tuple(name for name, own in zip(machines, belonging.doubtful, strict=True) if own)
        yield Caveat(CaveatKind.UNCERTAIN_P_VALUES, names)


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
    """The population that the machines of a batch come from, the next machine, and which machines
    do not belong.

    InputError for rows that are no batch's, fewer than two machines, machines with other joints, or
    options out of range.

    Parameters
    ----------
    rows : of `read_batch`: one row per campaign; campaigns without machine_id count as machines of
        their own. Which of them count, and ``exclude``, ``since`` and ``include_misfits``: see
        `choose`.
    parameters, reference_force_N, one_instrument
        See `fleet_statistics`; default: all constant compliances at the median of the campaigns'
        forces, one bar.
    spread_scale : prior of each spread: HalfNormal(spread_scale · default prior sd of the
        parameter), see `reference_sd`.
    ci_prob : float
    seed : int
    progress : told of machines that are left out by drawing anew: done and total.
    """
    check_probability(ci_prob)
    said = (
        f"spread_scale must be a finite number above zero, got {spread_scale}. The default is 0.3."
    )
    require(0.0 < spread_scale < np.inf, said)
    relied, caveats = choose(rows, exclude, since, include_misfits)
    statistics = fleet_statistics(
        relied,
        parameters=parameters,
        reference_force_N=reference_force_N,
        one_instrument=one_instrument,
    )
    why = " ".join(("Add campaigns of others.", *map(caveat_words, caveats)))
    several = len(set(statistics.machines)) > 1
    require(
        several,
        f"a population must have at least two machines, got only {statistics.machines[0]}. {why}",
    )
    found = pool(
        statistics, spread_scale=spread_scale, ci_prob=ci_prob, seed=seed, progress=progress
    )
    nameless = ~relied["machine_id"].map(lambda own: isinstance(own, str)).astype(bool)
    if nameless.any():
        caveats.append(Caveat(CaveatKind.MACHINES_OF_THEIR_OWN, tuple(labels(relied[nameless]))))
    readings = tuple(str(own) for own in relied["sha256"] if isinstance(own, str))
    return replace(found, caveats=(*caveats, *found.caveats), readings=readings)


# Draws of s, a power of two, as many as so many pairs of draw and machine allow: of the spreads
# themselves, of every machine.
_SPREADS = (4_000_000, 2048, 8192)
_MACHINES = (1_000_000, 256, 2048)


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
    sizes = [
        2 ** int(np.log2(min(max(pairs / len(machines), fewest), most)))
        for pairs, fewest, most in (_SPREADS, _MACHINES)
    ]
    density = SpreadDensity(likelihood, spread_scale)
    tails = (0.5 - 0.5 * ci_prob, 0.5 + 0.5 * ci_prob)
    spreads = draw_spreads(density, len(statistics.parameters), seed=seed, size=sizes[0])
    few = spreads.first(sizes[1])
    common = common_of(likelihood, few.spread)
    parameters = _pooled_parameters(statistics, spreads, few, common, tails)
    belonging = (
        belonging_of(density, few, common, seed=seed, progress=progress)
        if len(machines) >= FEWEST
        else None
    )
    return Population(
        parameters=parameters,
        machine=_pooled_machines(statistics, machines, likelihood, few, common, belonging, tails),
        campaigns=len(statistics),
        **{
            key: getattr(statistics, key)
            for key in ("reference_force_N", "forces_N", "topology", "compliances", "instrument")
        },
        spread_scale=spread_scale,
        seed=seed,
        pareto_k=spreads.pareto_k,
        trusted=spreads.trusted,
        caveats=tuple(_caveats(statistics, parameters, spreads, belonging, machines)),
        ci_prob=ci_prob,
        judged=belonging is not None and not belonging.doubtful.any(),
    )


# ---- the prior of one more machine

_SAME_FORCE = 1e-9


@dataclass(frozen=True)
class PopulationPrior(Shown):
    """What a population of machines says of the next one: C ~ N(mean, sd²) at the population's
    reference force.

    Compliances alone, in inside units (mm, N, rad): their slopes and the geometric errors keep the
    model's own priors.
    """

    reference_force_N: float  #: F0, at which the compliances are meant
    machines: int  #: their number
    campaigns: int  #: their number
    means: Mapping[str, float]  #: by compliance
    sds: Mapping[str, float]  #: by compliance
    sha256: str  #: of the population
    topology: str  #: of the machines
    #: one that is missing is the campaign's
    compliances: Mapping[str, Meaning] = field(default_factory=dict)
    machine_ids: frozenset[str] = frozenset()  #: of the machines
    readings: frozenset[str] = frozenset()  #: SHA-256 of the campaigns
    own_doubts: tuple[str, ...] = ()  #: what the population says is to be minded

    def model(self, model: HybridModel) -> HybridModel:
        """The same model with these priors of the compliances, at the population's reference force;
        slopes keep their sd."""
        prior = model.prior
        cure = "got flat ones. Use the default preset."
        require(not prior.flat, f"the model must have proper priors to take a population's, {cure}")
        for name in self.means:
            free = name not in model.fixed
            require(
                free,
                f"{name} must be free to have the population's prior, got one fixed at zero."
                " Free it.",
            )
            two = name in prior.overrides or name in prior.means
            require(
                not two,
                f"{name} must have one prior, got the population's and the model's own. Remove one"
                " of them.",
            )
        own = self.reference_force_N if model.reference_force_N is None else model.reference_force_N
        got = f"got {own:g} N. Leave reference_force_N out of the model."
        said = (
            f"reference_force_N must be the population's {self.reference_force_N:g} N, at which its"
            f" compliances are meant, {got}"
        )
        require(np.isclose(own, self.reference_force_N, rtol=_SAME_FORCE), said)
        prior = replace(
            prior, overrides={**prior.overrides, **self.sds}, means={**prior.means, **self.means}
        )
        return replace(model, reference_force_N=self.reference_force_N, prior=prior)

    def doubts(self, campaign: Campaign) -> tuple[str, ...]:
        """What speaks against using it for a campaign (or plan), in sentences; a machine that it
        does not speak of is refused."""
        check_campaign(campaign)
        self._check_machine(campaign)
        doubts = []
        if campaign.machine_id in self.machine_ids:
            doubts.append(PAGE["own_machine"].format(machine=campaign.machine_id))
        low = float(campaign.forces_N.min())
        high = float(campaign.forces_N.max())
        if not low <= self.reference_force_N <= high:
            doubts.append(
                PAGE["other_forces"].format(force=self.reference_force_N, low=low, high=high)
            )
        return (*doubts, *(f"The population says: {doubt}" for doubt in self.own_doubts))

    def _check_machine(self, campaign: Campaign) -> None:
        got = f"got {campaign.topology!r}. Use a population of such machines, or no --prior-from."
        same = campaign.topology == self.topology
        require(
            same, f"topology must be the population's {self.topology!r} to use its prior, {got}"
        )
        sums = stats.stands_for(campaign)
        missing = [name for name in self.means if name not in sums]
        got = (
            f"got {', '.join(sums)} without {', '.join(missing)}. Use a population whose circles"
            " lie in the same planes."
        )
        require(not missing, f"the campaign must have the population's compliances, {got}")
        for name in self.means:
            got = (
                "got circles or joints' frames that stand elsewhere, so that it is the sum of other"
                " compliances"
            )
            same = name not in self.compliances or stats.same_meaning(
                name, self.compliances[name], sums[name]
            )
            cure = "Use a population measured in the same place."
            require(
                same, f"the campaign must mean by {name} what the population does, {got}. {cure}"
            )
        got = "got readings that it was made from: they would count twice"
        cure = "Make the population without it (--exclude), or fit without --prior-from."
        apart = campaign.sha256 not in self.readings
        require(
            apart, f"the campaign must not be in the population that gives its prior, {got}. {cure}"
        )


def prior_from(path: str | os.PathLike[str]) -> PopulationPrior:
    """The prior for one more machine in a population's result, unchanged: its folder, or the
    ``population.json`` in it."""
    return read_result(Path(path), "population", "population", _prior_of)


def _prior_of(record: Mapping[str, Any]) -> PopulationPrior:
    if (record["kind"], record["schema"], record["sha256"]) != ("population", 1, digest_of(record)):
        raise ValueError(
            "its sha256 is not that of its contents: it was edited, or is of another edition"
        )
    return PopulationPrior(
        **{
            name: record[name]
            for name in (
                "reference_force_N",
                "machines",
                "campaigns",
                "topology",
                "sha256",
                "compliances",
            )
        },
        means={name: entry["mean"] for name, entry in record["next"].items()},
        sds={name: entry["sd"] for name, entry in record["next"].items()},
        machine_ids=frozenset(record["machine"]),
        readings=frozenset(record["readings_sha256"]),
        own_doubts=tuple(record["doubts"]),
    )


def digest_of(record: Mapping[str, Any]) -> str:
    """SHA-256 of a population.json, as read, but for its ``sha256``: of its JSON with sorted
    keys."""
    plain = {name: value for name, value in record.items() if name != "sha256"}
    return hashlib.sha256(
        json.dumps(plain, sort_keys=True, separators=(",", ":")).encode()
    ).hexdigest()
