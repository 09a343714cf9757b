"""c_t = c + Δ e_j 1[t ≥ k] + w_t, t = 1..n in order of time: every step of one parameter, weighed against none.

In units of the prior's sd: c ~ N(0, I), b ~ N(0, I) the instrument's errors, the same in all campaigns, w_t ~ N(0, r² I) what the
machine itself changes from campaign to campaign, r ~ HalfNormal(repeatability), Δ ~ N(0, change_scale²). With the probability
given there is one step, j uniform over parameters and k over 2..n. Given r, j, k everything is Gaussian: w_t is integrated in
each campaign, the rest needs sums over t ≥ k and one small system for each r. A campaign's Λ may be singular: it is not inverted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf, logsumexp

from ldbb_bayes.fleet.statistics import FleetStatistics
from ldbb_bayes.model.gaussian import mixture_quantiles

__all__ = [
    "SURE",
    "Carried",
    "Chart",
    "Detection",
    "Levels",
    "Series",
    "Steps",
    "Weights",
    "carry",
    "chart_of",
    "detection",
    "instrument_moments",
    "levels_of",
    "scatter_rule",
    "steps_of",
    "weigh",
]

Array = NDArray[Any]
_LEAST, _MOST, _STEP = 0.03, 8.0, 0.12


@dataclass(frozen=True, eq=False)
class Series:
    """Likelihoods of one machine's campaigns in order of time, in units of the prior's sd from its mean.

    Attributes
    ----------
    information : ndarray, shape (n, q, q)
        Parameters first, then the instrument's errors.
    weighted : ndarray, shape (n, q)
    parameters : int
        p; q less p are the instrument's.
    """

    information: Array
    weighted: Array
    parameters: int

    @classmethod
    def of(cls, statistics: FleetStatistics, order: Sequence[int]) -> Series:
        """Of a fleet's statistics, in the order of time given."""
        sd = np.concatenate([statistics.prior_sd, statistics.instrument_sd])
        mean = np.concatenate([statistics.prior_mean, np.zeros_like(statistics.instrument_sd)])
        take = np.asarray(order, dtype=int)
        information = statistics.information[take]
        weighted = statistics.weighted[take] - information @ mean
        return cls(information * (sd[:, None] * sd), weighted * sd, len(statistics.prior_sd))

    def __len__(self) -> int:
        return len(self.information)

    def given(self, instrument: Array) -> Series:
        """The same with the instrument's errors known."""
        p = self.parameters
        known = self.weighted[:, :p] - self.information[:, :p, p:] @ instrument
        return Series(self.information[:, :p, :p], known, p)


@dataclass(frozen=True, eq=False)
class Carried:
    """ln p(y_t | c + step, b, r) = −½ zᵀ Λ z + ηᵀ z + constant: w_t integrated out, for every r.

    Attributes
    ----------
    information : ndarray, shape (r, n, q, q)
    weighted : ndarray, shape (r, n, q)
    log_constant : ndarray, shape (r, n)
    """

    information: Array
    weighted: Array
    log_constant: Array
    parameters: int


@dataclass(frozen=True, eq=False)
class Steps:
    """Every hypothesis given r, K = n − 1 times; sizes and levels in units of the prior's sd.

    Attributes
    ----------
    log_none : ndarray, shape (r,)
        Log evidence of no change, up to what all hypotheses share.
    log_ratio : ndarray, shape (r, K, p)
        Log evidence of a step of parameter j at t = k + 2 (k counted from 0), over none.
    size, variance : ndarray, shape (r, K, p)
        Of Δ there.
    mean : ndarray, shape (r, q)
        Of (c, b) where nothing changes.
    covariance : ndarray, shape (r, q, q)
    tilt : ndarray, shape (r, K, q, p)
        By how much the mean of (c, b) falls for each unit of Δ.
    """

    log_none: Array
    log_ratio: Array
    size: Array
    variance: Array
    mean: Array
    covariance: Array
    tilt: Array


@dataclass(frozen=True, eq=False)
class Weights:
    """Posterior probabilities; all together are 1.

    Attributes
    ----------
    none : ndarray, shape (r,)
    change : ndarray, shape (r, K, p)
    """

    none: Array
    change: Array

    @property
    def scatter(self) -> Array:
        """Of every r, shape (r,)."""
        return self.none + self.change.sum(axis=(1, 2))


def scatter_rule(repeatability: float, *, step: float = _STEP) -> tuple[Array, Array]:
    """Nodes of r and their weights: trapezoids in ln r; what lies below the lowest counts there.

    Parameters
    ----------
    repeatability : float
        Scale of the half-normal density.
    step : float
        In ln r.

    Returns
    -------
    tuple of ndarray, shape (r,)
    """
    count = int(np.ceil(np.log(_MOST / _LEAST) / step)) + 1
    log_ratio = np.linspace(np.log(_LEAST), np.log(_MOST), count)
    ratio = np.exp(log_ratio)
    weight = ratio * np.sqrt(2.0 / np.pi) * np.exp(-0.5 * ratio**2) * (log_ratio[1] - log_ratio[0])
    weight[[0, -1]] *= 0.5
    weight[0] += erf(_LEAST / np.sqrt(2.0))
    return repeatability * ratio, weight / weight.sum()


def carry(series: Series, scatter: Array) -> Carried:
    """Integrate w_t ~ N(0, r² I) in every campaign, for every r: (I + Λ D)⁻¹ Λ, D = r² on the parameters."""
    p, q = series.parameters, series.information.shape[-1]
    spread = np.zeros((len(scatter), q))
    spread[:, :p] = scatter[:, None] ** 2
    system = np.eye(q) + series.information * spread[:, None, None, :]
    right = np.concatenate([series.information, series.weighted[:, :, None]], axis=2)
    solved = np.linalg.solve(system, np.broadcast_to(right, (len(scatter), *right.shape)))
    information, weighted = solved[..., :q], solved[..., q]
    gain = np.einsum("rq,tq,rtq->rt", spread, series.weighted, weighted)
    _, log_size = np.linalg.slogdet(system)
    return Carried(0.5 * (information + np.swapaxes(information, -1, -2)), weighted, 0.5 * (gain - log_size), p)


def steps_of(carried: Carried, change_scale: float) -> Steps:
    """Evidence of every step over none, its size, and what it makes of (c, b)."""
    p, q = carried.parameters, carried.information.shape[-1]
    after, pull = (np.cumsum(own[:, ::-1], axis=1)[:, ::-1] for own in (carried.information, carried.weighted))
    total, all_pull = after[:, 0], pull[:, 0]
    after, pull = after[:, 1:, :, :p], pull[:, 1:, :p]
    system = np.eye(q) + total
    covariance = np.linalg.inv(system)
    mean = np.einsum("rab,rb->ra", covariance, all_pull)
    _, log_size = np.linalg.slogdet(system)
    log_none = 0.5 * (np.einsum("ra,ra->r", all_pull, mean) - log_size) + carried.log_constant.sum(axis=1)
    tilt = covariance[:, None] @ after
    precision = np.einsum("rkjj->rkj", after[:, :, :p]) - np.einsum("rkaj,rkaj->rkj", after, tilt)
    push = pull - np.einsum("rkaj,ra->rkj", after, mean)
    shrunk = change_scale**2 / (1.0 + change_scale**2 * np.maximum(precision, 0.0))
    log_ratio = 0.5 * (shrunk * push**2 + np.log(shrunk / change_scale**2))
    return Steps(log_none, log_ratio, shrunk * push, shrunk, mean, covariance, tilt)


def weigh(steps: Steps, scatter_weight: Array, probability: float) -> Weights:
    """Posterior probability of every hypothesis.

    Parameters
    ----------
    probability : float
        Prior probability of a change.
    """
    base = np.log(scatter_weight) + steps.log_none
    _, times, parameters = steps.log_ratio.shape
    none = base + np.log1p(-probability)
    change = base[:, None, None] + steps.log_ratio + np.log(probability / (times * parameters))
    whole = np.logaddexp(logsumexp(none), logsumexp(change))
    return Weights(np.exp(none - whole), np.exp(change - whole))


_NEGLIGIBLE = 1e-7


@dataclass(frozen=True, eq=False)
class Chart:
    """What is drawn of every campaign, in order of time.

    Attributes
    ----------
    own, own_sd : ndarray, shape (n, p)
        Of each campaign alone, the instrument's errors at their posterior mean.
    limits : ndarray, shape (2, n, p)
        Control limits; of the first campaign NaN.
    common_sd : ndarray, shape (p,)
        What the instrument's errors add to the level of all campaigns together.
    """

    own: Array
    own_sd: Array
    limits: Array
    common_sd: Array


@dataclass(frozen=True, eq=False)
class Levels:
    """c and the step at every campaign, averaged over hypotheses, the instrument's errors at their posterior mean.

    Attributes
    ----------
    mean, sd : ndarray, shape (n, p)
        Of the mixture over hypotheses.
    interval : ndarray, shape (2, n, p)
    """

    mean: Array
    sd: Array
    interval: Array


def instrument_moments(steps: Steps, weights: Weights, parameters: int) -> tuple[Array, Array]:
    """Posterior mean and covariance of the instrument's errors, averaged over hypotheses; shapes (s,), (s, s)."""
    tilt = steps.tilt[:, :, parameters:]
    apart = -tilt * steps.size[:, :, None]
    base = steps.mean[:, parameters:]
    every = base[:, None, :, None] + apart
    mean = np.einsum("r,rs->s", weights.none, base) + np.einsum("rkj,rksj->s", weights.change, every)
    alone, other = base - mean, every - mean[:, None]
    inside = steps.covariance[:, parameters:, parameters:]
    covariance = np.einsum("r,rst->st", weights.scatter, inside) + np.einsum("r,rs,rt->st", weights.none, alone, alone)
    covariance += np.einsum("rkj,rksj,rktj->st", weights.change, other, other)
    return mean, covariance + np.einsum("rkj,rksj,rktj->st", weights.change * steps.variance, tilt, tilt)


def chart_of(
    series: Series,
    carried: Carried,
    scatter: Array,
    scatter_weight: Array,
    instrument: tuple[Array, Array],
    *,
    limits: float = 0.997,
) -> Chart:
    """Points with their uncertainty, and limits from the campaigns before each.

    Parameters
    ----------
    scatter, scatter_weight : ndarray, shape (r,)
        Values of r and their prior probabilities.
    instrument : tuple of ndarray
        Posterior mean and covariance of the instrument's errors.
    limits : float
        Probability of lying between the limits where nothing changes.
    """
    p, q = series.parameters, series.information.shape[-1]
    known, spread = instrument
    alone = series.given(known)
    shrink = np.linalg.inv(np.eye(p) + alone.information)
    own = np.einsum("tab,tb->ta", shrink, alone.weighted)
    seen = shrink @ series.information[:, :p, p:]
    whole = series.information[:, :p].sum(axis=0)
    pulled = np.linalg.solve(np.eye(p) + whole[:, :p], whole[:, p:])
    common = np.sqrt(np.einsum("as,su,au->a", pulled, spread, pulled))

    before, pull = (np.cumsum(part[:, :-1], axis=1) for part in (carried.information, carried.weighted))
    system = np.eye(q) + before
    covariance = np.linalg.inv(system)
    mean = np.einsum("rtab,rtb->rta", covariance, pull)
    log_evidence = 0.5 * (np.einsum("rta,rta->rt", pull, mean) - np.linalg.slogdet(system)[1])
    log_weight = np.log(scatter_weight)[:, None] + log_evidence + np.cumsum(carried.log_constant[:, :-1], axis=1)
    weight = np.exp(log_weight - log_weight.max(axis=0))
    weight /= weight.sum(axis=0)

    take = shrink[1:] @ series.information[1:, :p]
    covariance[:, :, range(p), range(p)] += scatter[:, None, None] ** 2
    noise = np.einsum("tab,tbc,tac->ta", shrink[1:], alone.information[1:], shrink[1:])
    expected = np.einsum("tab,rtb->rta", take, mean) - np.einsum("tas,s->ta", seen[1:], known)
    sd = np.sqrt(np.einsum("tab,rtbc,tac->rta", take, covariance, take) + noise)
    tail = 0.5 - 0.5 * limits
    ends = mixture_quantiles(weight[:, :, None], expected, np.maximum(sd, 1e-300), (tail, 1.0 - tail))
    nothing = np.full((2, 1, p), np.nan)
    return Chart(
        own,
        np.sqrt(np.einsum("taa->ta", shrink)),
        np.concatenate([nothing, ends], axis=1),
        common,
    )


def levels_of(
    series: Series, scatter: Array, weights: Weights, known: Array, change_scale: float, *, ci_prob: float = 0.95
) -> Levels:
    """Level of every parameter at every campaign, under the probabilities that hypotheses have.

    Parameters
    ----------
    weights : Weights
        Of the series with its instrument's errors unknown.
    known : ndarray, shape (s,)
        Their posterior mean.
    """
    n, p = len(series), series.parameters
    steps = steps_of(carry(series.given(known), scatter), change_scale)
    variance = np.einsum("raa->ra", steps.covariance)
    base = steps.mean[:, None, :, None] - steps.tilt * steps.size[:, :, None]
    reach = np.zeros((2, *base.shape[1:]))
    square = np.zeros_like(reach)
    share = _share(weights.change, axis=0)
    for moved in (0, 1):
        extra = moved * np.eye(p)
        mean = base + extra * steps.size[:, :, None]
        spread = variance[:, None, :, None] + (extra - steps.tilt) ** 2 * steps.variance[:, :, None]
        reach[moved] = np.einsum("rkj,rkij->kij", share, mean)
        square[moved] = np.einsum("rkj,rkij->kij", share, spread + (mean - reach[moved]) ** 2)
    of_none = _share(weights.none, axis=0)
    none = np.einsum("r,ra->a", of_none, steps.mean)
    none_variance = np.einsum("r,ra->a", of_none, variance + (steps.mean - none) ** 2)

    total = weights.change.sum(axis=0)
    times, movers = np.nonzero(total > _NEGLIGIBLE * total.max())
    weight = np.concatenate([[weights.none.sum()], total[times, movers]])
    weight /= weight.sum()
    moved_yet = (np.arange(n)[None, :] > times[:, None]).astype(int)
    means = np.concatenate([np.broadcast_to(none, (1, n, p)), reach[moved_yet, times[:, None], :, movers[:, None]]])
    variances = np.concatenate([np.broadcast_to(none_variance, (1, n, p)), square[moved_yet, times[:, None], :, movers[:, None]]])
    sd = np.sqrt(variances)
    half = 0.5 * ci_prob
    ends = mixture_quantiles(weight, means, sd, (0.5 - half, 0.5 + half))
    middle = np.einsum("h,hta->ta", weight, means)
    return Levels(middle, np.sqrt(np.einsum("h,hta->ta", weight, variances + (means - middle) ** 2)), ends)


def _share(weight: Array, axis: int) -> Array:
    """Of the whole along an axis; of nothing, equal shares."""
    total = weight.sum(axis=axis, keepdims=True)
    return np.where(total > 0.0, weight / np.where(total > 0.0, total, 1.0), 1.0 / weight.shape[axis])


SURE = 0.9
_COARSE = 0.35


@dataclass(frozen=True, eq=False)
class Detection:
    """How soon changes would be found.

    Attributes
    ----------
    changes : ndarray, shape (p,)
        In units of the prior's sd; NaN where there is none to ask for.
    found : ndarray, shape (p, N)
        Probability that the change has been found after 1..N further campaigns; NaN likewise.
    false_alarm : ndarray, shape (N,)
        That some change has been said to be there while nothing changed.
    before : int
        Campaigns before the change.
    replicates : int
        Simulated series that probabilities are counted in.
    """

    changes: Array
    found: Array
    false_alarm: Array
    before: int
    replicates: int

    def error(self, probability: Array) -> Array:
        """Standard error of counting, never less than that of half a count."""
        share = np.clip(probability, 0.5 / self.replicates, 1.0 - 0.5 / self.replicates)
        return np.where(np.isnan(probability), np.nan, np.sqrt(share * (1.0 - share) / self.replicates))

    def campaigns(self, parameter: int) -> int | None:
        """The least number of further campaigns that finds it with probability 0.9; None where more are needed than looked at."""
        enough = np.flatnonzero(self.found[parameter] >= SURE)
        return int(enough[0]) + 1 if len(enough) else None


def detection(
    information: Array,
    parameters: int,
    level: Array,
    changes: Array,
    *,
    before: int,
    scatter: tuple[Array, Array],
    change_scale: float,
    repeatability: float,
    probability: float,
    threshold: float,
    further: int = 12,
    replicates: int = 400,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Detection:
    """Simulate series to come, and look at each after every further campaign.

    Parameters
    ----------
    information : ndarray, shape (q, q)
        Λ̄ of one campaign, in units of the prior's sd.
    parameters : int
    level : ndarray, shape (q,)
        c and b, what they are now.
    changes : ndarray, shape (p,)
        Δ of each parameter; NaN leaves it out.
    before : int
        Campaigns before the change, at least one.
    scatter : tuple of ndarray
        Values of r and their probabilities, from which series are drawn; the analysis weighs r by its prior.
    further : int
    replicates : int
        Those that give a false alarm before the change are left out of the counts.
    """
    rng = np.random.default_rng(seed)
    p, n = parameters, before + further
    r = rng.choice(scatter[0], size=replicates, p=scatter[1] / scatter[1].sum())
    values, vectors = np.linalg.eigh(information)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    z = np.tile(level, (replicates, n, 1))
    z[:, :, :p] += r[:, None, None] * rng.standard_normal((replicates, n, p))
    weighted = z @ information + rng.standard_normal(z.shape) @ root.T
    known = np.flatnonzero(np.isfinite(changes))
    shifts = np.concatenate([np.zeros((1, len(level))), changes[known, None] * information[known]])
    looks = _Looks(information, p, scatter_rule(repeatability, step=_COARSE), change_scale, probability)
    alarm = np.zeros((further + 1, len(shifts), replicates), dtype=bool)
    for count in range(further + 1):
        if before + count > 1:
            alarm[count] = looks.change(weighted[:, : before + count], shifts, count) > np.log(threshold / (1.0 - threshold))
        if progress is not None:
            progress(count + 1, further + 1)
    fresh = ~alarm[0, 0]
    if not fresh.any():
        fresh[:] = True
    share = np.logical_or.accumulate(alarm[1:], axis=0)[:, :, fresh].mean(axis=2)
    found = np.full((p, further), np.nan)
    found[known] = share[:, 1:].T
    return Detection(changes, found, share[:, 0], before, int(fresh.sum()))


class _Looks:
    """Log odds of a change for many series of equally informative campaigns."""

    def __init__(
        self, information: Array, parameters: int, rule: tuple[Array, Array], change_scale: float, probability: float
    ) -> None:
        q = len(information)
        nodes, self._weight = rule
        self._scale, self._probability, self._p = change_scale, probability, parameters
        carried = carry(Series(information[None], np.zeros((1, q)), parameters), nodes)
        self._information, self._log_constant = carried.information[:, 0], carried.log_constant[:, 0]
        square = np.zeros((len(nodes), q))
        square[:, :parameters] = nodes[:, None] ** 2
        self._take = np.linalg.inv(np.eye(q) + information * square[:, None, :])
        self._gain = square[:, :, None] * self._take

    def change(self, weighted: Array, shifts: Array, moved: int) -> Array:
        """Log odds of a change, shape (shifts, series); the last ``moved`` campaigns of each are moved by a shift.

        Parameters
        ----------
        weighted : ndarray, shape (series, t, q)
        shifts : ndarray, shape (shifts, q)
        """
        series, n, q = weighted.shape
        p, after = self._p, np.arange(n - 1, 0, -1)
        log_step = np.log(self._probability / (1.0 - self._probability) / ((n - 1) * p))
        sums = np.cumsum(weighted[:, ::-1], axis=1)[:, ::-1]
        total = sums[:, 0] + moved * shifts[:, None]
        late = sums[:, n - moved] if moved else np.zeros((series, q))
        changed, none = (np.full((len(shifts), series), -np.inf) for _ in range(2))
        for i, weight in enumerate(self._weight):
            information, take, gain = self._information[i], self._take[i], self._gain[i]
            system = np.eye(q) + n * information
            reduced = np.linalg.solve(system, information[:, :p]).T
            precision = after[:, None] * np.diag(information)[:p] - after[:, None] ** 2 * np.diag(reduced @ information[:, :p])
            shrunk = self._scale**2 / (1.0 + self._scale**2 * np.maximum(precision, 0.0))
            fitted = total @ take.T
            own = 0.5 * np.einsum("msq,qr,msr->ms", fitted, np.linalg.inv(system), fitted)
            own += 0.5 * np.einsum("stq,qr,str->s", weighted, gain, weighted, optimize=True) + n * self._log_constant[i]
            own += shifts @ gain @ late.T + 0.5 * moved * np.einsum("mq,qr,mr->m", shifts, gain, shifts)[:, None]
            own += np.log(weight) - 0.5 * np.linalg.slogdet(system)[1]
            none = np.logaddexp(none, own)
            push = sums[:, 1:] @ take[:p].T
            for m, shift in enumerate(shifts):
                steps = push + np.minimum(after, moved)[:, None] * (take[:p] @ shift)
                steps -= after[:, None] * (fitted[m] @ reduced.T)[:, None]
                log_ratio = 0.5 * (shrunk * steps**2 + np.log(shrunk / self._scale**2)).reshape(series, -1)
                top = log_ratio.max(axis=1)
                whole = top + np.log(np.exp(log_ratio - top[:, None]).sum(axis=1))
                changed[m] = np.logaddexp(changed[m], own[m] + whole)
        return changed + log_step - none
