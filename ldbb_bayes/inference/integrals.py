"""∫ f of log densities on ℝ^h as sums over weighted nodes, with an error; nothing here knows of
circles.

In few dimensions the nodes are those of the trapezoidal rule on a grid that grows from the modes
until nothing is left to find. For a smooth function that dies away on every side the rule converges
geometrically in its step (Trefethen and Weideman, SIAM Review 56, 385-458, 2014). Two grids, the
second moved by half a step along every axis, make one body-centred lattice: errors along single
axes cancel in their mean.

In many dimensions they are quasi-random points of a proposal that is fitted, round by round, to
where the weights are: a mixture of split Student-t along the axes of the modes (Geweke,
Econometrica 57, 1317-1339, 1989). What a round finds is weighted by the proposal it was drawn from,
never by one fitted to it: such weights are too small, by 0.1 nat in 45 dimensions. Where they
cannot be trusted the nodes are emcee's draws, of equal weight, and ∫ f comes from bridge sampling.
"""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, stdtrit
from scipy.stats import qmc

from ldbb_bayes.inference.diagnostics import diagnose, pareto_k
from ldbb_bayes.inference.mcmc import StoppingRule, run_ensembles
from ldbb_bayes.results import Array

__all__ = [
    "CHUNK",
    "LARGEST_PARETO_K",
    "Integral",
    "Mixture",
    "SplitT",
    "bridge_sample",
    "grow_lattice",
    "importance_sample",
    "in_chunks",
    "integrate",
]

LogDensity = Callable[[Array], Array]
Random = np.random.Generator | np.random.RandomState
CHUNK = 256
_LATTICE = 5
LARGEST_PARETO_K = 0.6
_STUDENT = 2.0
_LUCK = 0.5
_HEAVY = (0.4, 0.1)


@dataclass(frozen=True, eq=False)
class Integral:
    """∫ f of a density f on ℝ^h as a sum over n weighted nodes."""

    free: Array  # the nodes (n, h)
    log_density: Array  # ln f there
    log_volume: Array  # ln of the volume that each stands for
    part: NDArray[
        np.intp
        # which of several estimates of the integral a node belongs to: two grids, or independent
        # scrambles
    ]
    edge: NDArray[np.bool_]  # nodes of a lattice beyond which nothing was looked for
    proposal: (
        Mixture | None
    )  # what a sample was drawn from, a density much like f; none of a lattice
    left_out: float = (
        0.0  # at most this share of the integral is in nodes whose density was not evaluated
    )
    # how far apart a lattice's two grids were with the step before this [nat]; zero of the first
    coarser: float = 0.0
    bridge_error: float = (
        0.0  # of ln ∫ f by bridge sampling, where the nodes are emcee's draws; zero of others
    )

    @cached_property
    def _log_weight(self) -> Array:
        return self.log_density + self.log_volume

    @cached_property
    def weight(self) -> Array:
        """Normalised weights of the nodes, shape (n,)."""
        weight = np.exp(self._log_weight - self._log_weight.max())
        return weight / weight.sum()

    @property
    def log_integral(self) -> float:
        """ln ∫ f."""
        return float(np.logaddexp.reduce(self._log_weight))

    @property
    def ess(self) -> float:
        """How many equally weighted nodes these are worth."""
        return float(1.0 / (self.weight**2).sum())

    @cached_property
    def apart(self) -> float:
        """Difference of the two grids of a lattice [nat]."""
        return abs(
            float(np.diff(np.log(np.maximum(np.bincount(self.part, self.weight), 1e-300)))[0])
        )

    @cached_property
    def error(self) -> float:
        """Of ln ∫ f [nat].

        Of a lattice a part of the two grids' difference, whose first order cancels in their mean,
        and what lies beyond the edge or was not looked at. As steps shorten the difference may
        change sign: it counts as no less than a part of the one before. Of a sample twice the
        scatter between independent scrambles; no less than half of what plain random numbers would
        leave, as few scrambles may agree by luck; more where the tail of the weights is heavy,
        infinite where they cannot be trusted. Of emcee's draws the bridge's besides.
        """
        if not self.trusted:
            return np.inf
        if self.proposal is None:
            apart = max(self.apart, _DECLINE * self.coarser)
            beyond = _BEYOND * float(self.weight[self.edge].sum())
            return max(apart**2, _MEAN_OF_TWO * min(apart, _CANCELS)) + beyond + self.left_out
        share = np.bincount(self.part, self.weight)
        plain = np.sqrt(max(1.0 / self.ess - 1.0 / len(self.weight), 0.0))
        heavy = 1.0 + max(self.pareto_k - _HEAVY[0], 0.0) / _HEAVY[1]
        scatter = max(_STUDENT * share.std(ddof=1) * np.sqrt(len(share)), _LUCK * plain)
        return float(scatter * heavy) + self.left_out + self.bridge_error

    @cached_property
    def pareto_k(self) -> float:
        """Shape of the tail of weights (Vehtari et al. 2024): above 0.6 trust neither integral nor
        error. −inf for a lattice."""
        return -np.inf if self.proposal is None else pareto_k(self._log_weight)

    @property
    def trusted(self) -> bool:
        """Whether the weights can be trusted."""
        return self.pareto_k <= LARGEST_PARETO_K

    def heaviest(self, spare: float) -> tuple[Array, Array]:
        """Nodes and normalised weights, but for a share ``spare`` of the integral."""
        heavy = self._heavy(spare)
        return self.free[heavy], self.weight[heavy] / self.weight[heavy].sum()

    def _heavy(self, spare: float) -> NDArray[np.intp]:
        order = np.argsort(self.weight)
        return np.sort(order[np.cumsum(self.weight[order]) >= spare])

    def pick(self, size: int, rng: np.random.Generator) -> Array:
        """Nodes picked by their weights, systematically and in random order, shape (size, h)."""
        order = np.lexsort(self.free.T)
        reached = np.searchsorted(
            np.cumsum(self.weight[order]), (rng.random() + np.arange(size)) / size
        )
        return rng.permutation(self.free[order][np.minimum(reached, len(order) - 1)])

    def draw(self, size: int, rng: Random, *, temperature: float = 1.0) -> Array:
        """Independent draws from a sample's proposal, shape (size, h); made wider by a temperature
        above one."""
        return cast("Mixture", self.proposal).draw(size, rng, temperature=temperature)

    def log_proposal(self, free: Array) -> Array:
        """Log density with which `draw` gives points (n, h), shape (n,)."""
        return cast("Mixture", self.proposal).log_density(free)

    def times(self, log_factor: Callable[[NDArray[np.intp]], Array], spare: float) -> Integral:
        """∫ f g: ln g at the nodes of an index, (k,), is evaluated where they count. The others, a
        share ``spare`` of ∫ f, are left out; their share of ∫ f g, were g as large there as
        anywhere, goes into the error."""
        heavy = self._heavy(spare)
        values = np.full(len(self.free), -np.inf)
        factor = log_factor(heavy)
        values[heavy] = self.log_density[heavy] + factor
        found = replace(self, log_density=values)
        share = max(1.0 - float(self.weight[heavy].sum()), 0.0)
        return replace(
            found,
            left_out=share * float(np.exp(factor.max() + self.log_integral - found.log_integral)),
        )


def integrate(
    log_density: LogDensity,
    modes: Sequence[tuple[Array, Array]],
    *,
    tolerance: float = 1e-3,
    step: float | None = None,
    seed: int = 0,
) -> Integral:
    """∫ f from the modes of f, highest first, and a root (h, h) of the inverse curvature at each. A
    lattice, its first ``step`` in sd, in up to five dimensions; importance sampling in more, emcee
    where its weights fail. ``log_density``: (n, h) → (n,)."""
    if len(modes[0][0]) <= _LATTICE:
        return grow_lattice(log_density, modes, tolerance=tolerance, step=step)
    # What is averaged over the nodes adds errors of its own.
    found = importance_sample(log_density, modes, tolerance=0.8 * tolerance, seed=seed)
    return found if found.trusted else bridge_sample(log_density, found, seed=seed)


def in_chunks(log_density: LogDensity, points: Array, most: int = CHUNK) -> Array:
    """Return a log density at any number of points, evaluated a few hundred at a time."""
    return np.concatenate(
        [log_density(part) for part in np.array_split(points, max(1, -(-len(points) // most)))]
    )


_BEYOND = 3.0
_MEAN_OF_TWO = 0.25
_CANCELS = 0.02
_DECLINE = 0.35
_LOOSE = 1e-2


def grow_lattice(
    log_density: LogDensity,
    modes: Sequence[tuple[Array, Array]],
    *,
    tolerance: float = 1e-3,
    step: float | None = None,
    most: int = 200_000,
) -> Integral:
    """A lattice whose error of ln ∫ f is below the tolerance: grown out from the modes to what no
    longer counts, its step shortened as needed. Axes are those of the highest mode. The first
    ``step`` is in sd. At ``most`` nodes growing and shortening stop, and the error says what was
    left out."""
    (centre, root), h = modes[0], len(modes[0][0])
    loose = tolerance >= _LOOSE
    depth = 9.0 if loose else 5.5 - np.log(tolerance)
    finer = 0.85
    coarser = 0.0
    # The two grids of a Gaussian differ by 4 h exp(−2 π²/step²); a little less is allowed for.
    step = step or (2.0 if loose else 0.93 * np.pi * np.sqrt(2.0 / np.log(3.0 * h / tolerance)))
    while True:
        starts = [np.linalg.solve(root, mode - centre) / step for mode, _ in modes]
        grids = [
            _grow(log_density, partial(_places, centre, step * root), starts, offset, depth, most)
            for offset in (0.0, 0.5)
        ]
        place, values, edge = (np.concatenate(parts) for parts in zip(*grids, strict=True))
        half_a_cell = np.full(len(values), np.linalg.slogdet(step * root)[1] - np.log(2.0))
        part = np.repeat([0, 1], [len(grid[0]) for grid in grids])
        found = Integral(
            _places(centre, step * root, place),
            values,
            half_a_cell,
            part,
            edge,
            None,
            coarser=coarser,
        )
        if found.error <= tolerance or len(values) * finer**-h > most:
            return found
        if _BEYOND * found.weight[edge].sum() > tolerance / 2.0:
            depth += 3.0
        else:
            step = step * finer
            coarser = found.apart


def _places(centre: Array, cell: Array, place: Array) -> Array:
    return np.asarray(centre + place @ cell.T)


def _grow(
    log_density: LogDensity,
    points: Callable[[Array], Array],
    starts: Sequence[Array],
    offset: float,
    depth: float,
    most: int,
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Places of one grid, their log densities, and which of them are its edge: from the starts on,
    neighbours of what counts."""
    h = len(starts[0])
    neighbours = np.vstack([np.eye(h), -np.eye(h)])
    corners = np.array(list(itertools.product((0.0, -1.0) if offset else (0.0,), repeat=h)))
    front = np.unique(np.concatenate([np.rint(start) + corners for start in starts]), axis=0)
    keys = np.zeros(0, dtype=np.int64)
    index = np.zeros((0, h))
    values = np.zeros(0)
    top = -np.inf
    while len(front) and len(index) <= most:
        value = in_chunks(log_density, points(front + offset))
        index = np.concatenate([index, front])
        values = np.concatenate([values, value])
        keys = np.union1d(keys, _key(front))
        top = max(top, float(value.max()))
        last = len(front)
        candidates = (front[value > top - depth][:, None] + neighbours).reshape(-1, h)
        key, fresh = np.unique(_key(candidates), return_index=True)
        front = candidates[fresh[~np.isin(key, keys)]]
    edge = values <= top - depth
    if len(index) > most:
        edge[-last:] = True
    return index + offset, values, edge


def _key(index: Array) -> NDArray[np.int64]:
    """One integer for each grid point."""
    reach = 1 << 62 // index.shape[1] - 1
    limited = np.clip(index, -reach, reach - 1).astype(np.int64)
    key: NDArray[np.int64] = (limited + reach) @ (
        (2 * reach) ** np.arange(index.shape[1], dtype=np.int64)
    )
    return key


# Light tails are fitted in many dimensions only: in few they gain little and leave corners of the
# density in the tail.
_FREEDOMS = np.array([3.0, 5.0, 9.0, 20.0])
_HEAVY_TAILS = 2
_OFFSETS = np.linspace(-0.4, 0.4, 9)
_ALONG = np.array([0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.5, 8.0, 10.0])
_SCRAMBLES = 8
_LEAST = 32.0
_ROUNDS = 5
_EFFICIENT = 0.4
_WIDER = 1.05
_FITTED = 4096
_LIGHTEST = 0.02


@dataclass(frozen=True, eq=False)
class SplitT:
    """x = centre + root z, every z independent, Student-t with a scale and degrees of freedom for
    each side of zero.

    ``scale`` and ``freedom`` are (2, h): below, above. The density is continuous: both sides have
    the same height at zero.
    """

    centre: Array
    root: Array
    scale: Array
    freedom: Array

    def log_density(self, points: Array) -> Array:
        """Of points (n, h), shape (n,)."""
        z = np.linalg.solve(self.root, (points - self.centre).T).T
        above = z > 0.0
        scale, freedom = (np.where(above, own[1], own[0]) for own in (self.scale, self.freedom))
        tails = (0.5 * (freedom + 1.0) * np.log1p(z**2 / (freedom * scale**2))).sum(axis=1)
        return np.asarray(
            -np.log(_masses(self.scale, self.freedom).sum(axis=0)).sum()
            - np.linalg.slogdet(self.root)[1]
            - tails
        )

    def at(self, uniform: Array) -> Array:
        """Points from uniform numbers (n, h)."""
        masses = _masses(self.scale, self.freedom)
        share = masses / masses.sum(axis=0)
        below = uniform < share[0]
        level = np.clip(
            np.where(below, uniform / share[0], (1.0 - uniform) / share[1]) / 2.0, 1e-15, 0.5
        )
        scale, freedom = (np.where(below, own[0], own[1]) for own in (self.scale, self.freedom))
        return np.asarray(
            self.centre + np.where(below, scale, -scale) * stdtrit(freedom, level) @ self.root.T
        )


def _masses(scale: Array, freedom: Array) -> Array:
    """∫ (1 + z²/(freedom scale²))^(−(freedom + 1)/2) over one side."""
    log_height = gammaln(freedom / 2.0) - gammaln((freedom + 1.0) / 2.0)
    return np.asarray(0.5 * scale * np.sqrt(freedom * np.pi) * np.exp(log_height))


@dataclass(frozen=True, eq=False)
class Mixture:
    """Split Student-t, each with its share (k,)."""

    components: tuple[SplitT, ...]
    share: Array

    def log_density(self, points: Array) -> Array:
        """Of points (n, h), shape (n,)."""
        return np.asarray(np.logaddexp.reduce(self.by_component(points), axis=0))

    def by_component(self, points: Array) -> Array:
        """ln of share times density, shape (k, n)."""
        return np.stack(
            [
                np.log(a) + own.log_density(points)
                for a, own in zip(self.share, self.components, strict=True)
            ]
        )

    def draw(self, size: int, rng: Random, *, temperature: float = 1.0) -> Array:
        """Independent draws, shape (size, h), from scales √temperature as wide."""
        picked = np.searchsorted(np.cumsum(self.share)[:-1], rng.uniform(size=size), side="right")
        uniform = rng.uniform(size=(size, len(self.components[0].centre)))
        points = np.empty_like(uniform)
        for k, own in enumerate(self.components):
            points[picked == k] = replace(own, scale=own.scale * np.sqrt(temperature)).at(
                uniform[picked == k]
            )
        return points


def importance_sample(
    log_density: LogDensity,
    modes: Sequence[tuple[Array, Array]],
    *,
    tolerance: float = 1e-2,
    seed: int = 0,
    most: int = 65_536,
    tries: int = 2,
) -> Integral:
    """Quasi-random points whose error of ln ∫ f is below the tolerance and whose weights can be
    trusted; or the best of five rounds, of up to ``most`` points. A round draws from the mixture
    fitted to all rounds before it, the first to the density along the axes of every mode. Where the
    weights are even enough it draws on, twice as many, instead of fitting again. Where none can be
    trusted another seed is tried: a round may miss a tail by luck."""
    rng = np.random.default_rng(seed)
    h = len(modes[0][0])
    proposal = Mixture(
        tuple(_along_axes(log_density, *mode) for mode in modes),
        np.full(len(modes), 1.0 / len(modes)),
    )
    each = 1 << int(np.ceil(np.log2(max(_LEAST, 1.5 * h))))
    rounds = list[Integral]()
    while len(rounds) < _ROUNDS:
        count = np.maximum(np.rint(each * proposal.share), 1.0).astype(int)
        proposal = replace(proposal, share=count / count.sum())
        engines = [[qmc.Sobol(h, rng=rng) for _ in range(_SCRAMBLES)] for _ in count]
        found = None
        times = 1
        while True:
            found = _drawn(log_density, proposal, engines, times * count, found)
            efficient = found.trusted and found.ess > _EFFICIENT * len(found.free)
            if rounds and found.trusted and found.error <= tolerance:
                return found
            if not rounds or not efficient or 2 * len(found.free) > most:
                break
            times = len(found.free) // (_SCRAMBLES * count.sum())
        rounds.append(found)
        proposal = _fitted(rounds)
        each = min(4 * each, most // _SCRAMBLES)
    best = min(rounds[1:], key=lambda own: (not own.trusted, own.error))
    if best.trusted or tries < 2:
        return best
    again = importance_sample(
        log_density, modes, tolerance=tolerance, seed=seed + 1, most=most, tries=tries - 1
    )
    return again if again.trusted else best


def _drawn(
    log_density: LogDensity,
    proposal: Mixture,
    engines: Sequence[Sequence[qmc.Sobol]],
    count: NDArray[np.intp],
    before: Integral | None,
) -> Integral:
    """So many points of every component more in every scramble, and those there were before."""
    points = [
        own.at(_draw_points(engine, n))
        for own, scrambles, n in zip(proposal.components, engines, count, strict=True)
        for engine in scrambles
    ]
    free = np.concatenate(points)
    part = np.concatenate([np.repeat(np.arange(_SCRAMBLES), n) for n in count])
    values = in_chunks(log_density, free)
    if before is not None:
        free = np.concatenate([before.free, free])
        part = np.concatenate([before.part, part])
        values = np.concatenate([before.log_density, values])
    log_volume = -proposal.log_density(free) - np.log(len(free))
    return Integral(free, values, log_volume, part, np.zeros(len(free), dtype=bool), proposal)


def _draw_points(engine: qmc.Sobol, count: int) -> Array:
    """Draw the next points of a Sobol sequence, shape (count, h), as many as a component's share."""
    with warnings.catch_warnings():
        # SciPy warns of counts that are no powers of two: shares of a mixture rarely are.
        warnings.filterwarnings("ignore", message="The balance properties", category=UserWarning)
        return np.asarray(engine.random(count))


def _along_axes(log_density: LogDensity, mode: Array, root: Array) -> SplitT:
    """A split t fitted to the density along every axis through a mode."""
    variance, vectors = np.linalg.eigh(root @ root.T)
    root = (
        vectors * np.sqrt(variance) @ vectors.T
    )  # the root that turns the coordinates least: what is independent stays so
    z = np.concatenate([-_ALONG[::-1], [0.0], _ALONG])
    h = len(mode)
    points = (mode + z[:, None, None] * root.T).reshape(-1, h)
    values = in_chunks(log_density, points).reshape(-1, h)
    weight = np.exp(values - values.max(axis=0)) * np.gradient(z)[:, None]
    return _fit_axes(
        mode, root, np.broadcast_to(z[:, None], values.shape), weight / weight.sum(axis=0)
    )


def _fitted(rounds: Sequence[Integral]) -> Mixture:
    """The mixture that fits the points of all rounds, weighted by the mixture of all their
    proposals; weights are evened out while few points would carry all."""
    proposals = [own.proposal for own in rounds if own.proposal is not None]
    points, values = (
        np.concatenate(own)
        for own in zip(*((own.free, own.log_density) for own in rounds), strict=True)
    )
    of_rounds = [
        np.log(len(own.free)) + q.log_density(points)
        for own, q in zip(rounds, proposals, strict=True)
    ]
    log_weight = values - np.logaddexp.reduce(of_rounds, axis=0)
    h = points.shape[1]
    power = 1.0
    weight = np.zeros(0)
    while not weight.size or (
        1.0 / (weight**2).sum() < min(len(weight) / 3.0, 40.0 * (h + 1.0)) and power > 0.02
    ):
        weight = np.exp(power * (log_weight - log_weight.max()))
        weight = weight / weight.sum()
        power = 0.8 * power
    return _moved(proposals[-1], points, weight)


def _moved(proposal: Mixture, points: Array, weight: Array) -> Mixture:
    """Every component that counts refitted to its part of weighted points."""
    by_component = proposal.by_component(points)
    shares = weight * np.exp(by_component - np.logaddexp.reduce(by_component, axis=0))
    mass = shares.sum(axis=1)
    components = tuple(
        _refitted(own, points, part / total) if total > _LIGHTEST else own
        for own, part, total in zip(proposal.components, shares, mass, strict=True)
    )
    share = np.maximum(mass, _LIGHTEST)
    return Mixture(components, share / share.sum())


def _refitted(component: SplitT, points: Array, weight: Array) -> SplitT:
    """A component moved, turned and stretched to the mean, covariance and tails of weighted points;
    correlations are drawn towards none where few points carry them."""
    order = np.linspace(0.0, 1.0, _FITTED, endpoint=False) + 0.5 / _FITTED
    z = np.linalg.solve(component.root, (points - component.centre).T).T
    ess = 1.0 / (weight**2).sum()
    h = z.shape[1]
    centred = z - weight @ z
    covariance = (centred.T * weight) @ centred
    sd = np.sqrt(np.diag(covariance))
    correlation = (ess * covariance / np.outer(sd, sd) + 4.0 * h * np.eye(h)) / (ess + 4.0 * h)
    values, vectors = np.linalg.eigh(correlation)
    turned = centred / sd @ (vectors / np.sqrt(values)) @ vectors.T
    spread = np.sqrt(weight @ turned**2)
    root = (component.root * sd) @ (vectors * np.sqrt(values)) @ vectors.T * spread
    centre = component.centre + component.root @ (weight @ z)
    if len(points) > _FITTED:
        picked = np.minimum(np.searchsorted(np.cumsum(weight), order), len(weight) - 1)
        turned = turned[picked]
        weight = np.full(_FITTED, 1.0 / _FITTED)
    return _fit_axes(centre, root, turned / spread, np.broadcast_to(weight[:, None], turned.shape))


def _fit_axes(centre: Array, root: Array, z: Array, weight: Array) -> SplitT:
    """A split t most likely along every axis, from places z (n, h) with weights (n, h) that sum to
    one: scales by EM steps, degrees of freedom and the middle from a few."""
    h = z.shape[1]
    freedoms = _FREEDOMS[:_HEAVY_TAILS] if h <= _LATTICE else _FREEDOMS
    best: tuple[Array, ...] = (np.zeros(h), np.ones((2, h)), np.ones((2, h)))
    likely = np.full(h, -np.inf)
    for offset in _OFFSETS:
        apart = (z - offset) ** 2
        above = z > offset
        sides = np.stack([np.where(above, 0.0, weight), np.where(above, weight, 0.0)])
        scale = np.ones((2, h))
        freedom = np.full((2, h), 9.0)
        for _ in range(2):
            for _ in range(3):
                pull = (freedom[:, None] + 1.0) / (freedom[:, None] + apart / scale[:, None] ** 2)
                moment = (sides * pull * apart).sum(axis=1)
                masses = _masses(scale, freedom)
                scale = np.clip(np.cbrt(masses.sum(axis=0) * scale / masses * moment), 0.05, 20.0)
            for side in (0, 1):
                tails = np.array(
                    [(sides[side] * _tail(apart, scale[side], own)).sum(axis=0) for own in freedoms]
                )
                masses = np.array([_masses(scale[side], own) for own in freedoms])
                freedom[side] = freedoms[
                    np.argmin(np.log(masses + _masses(scale, freedom)[1 - side]) + tails, axis=0)
                ]
        log_likelihood = -np.log(_masses(scale, freedom).sum(axis=0)) - sum(
            (sides[side] * _tail(apart, scale[side], freedom[side])).sum(axis=0) for side in (0, 1)
        )
        better = log_likelihood > likely
        likely = np.where(better, log_likelihood, likely)
        best = tuple(
            np.where(better, new, old)
            for new, old in zip((np.full(h, offset), scale, freedom), best, strict=True)
        )
    return SplitT(centre + root @ best[0], root, _WIDER * best[1], best[2])


def _tail(square: Array, scale: Array, freedom: Array | float) -> Array:
    return np.asarray(0.5 * (freedom + 1.0) * np.log1p(square / (freedom * scale**2)))


_ENSEMBLES = 4
_WALKERS = 64
_DRAWS = 1000.0
_LONGER = 3
_RUNS = 4
_NODES = 4096
_WIDE = 1.5
_WANDERED = 20.0
_APART = 1.2
_SETTLED = 1e-6


def bridge_sample(log_density: LogDensity, sample: Integral, *, seed: int = 0) -> Integral:
    """emcee's draws as nodes of equal weight, ∫ f by bridge sampling; the sample itself where
    ensembles do not converge.

    Half of the ensembles start from the sample's heavy points, half from wide draws of its
    proposal. To one half a proposal is fitted; the other, with draws of that proposal, gives ∫ f
    (Meng and Wong, Statistica Sinica 6, 831-860, 1996; Gronau et al., J. Math. Psych. 81, 80-97,
    2017). Then they change roles: the two results must agree within the error.
    """
    random = np.random.RandomState(seed)
    chain = _chain(log_density, sample, random)
    if chain is None:
        return sample
    (one, its_error, _), (other, other_error, proposal) = (
        _bridge(log_density, sample, *halves, random)
        for halves in ((chain[:2], chain[2:]), (chain[2:], chain[:2]))
    )
    picked = chain.reshape(_ENSEMBLES, -1, chain.shape[3])[:, :: -(-chain[..., 0].size // _NODES)]
    free = np.concatenate(picked)
    part = np.repeat(np.arange(_ENSEMBLES), picked.shape[1])
    values = in_chunks(log_density, free)
    log_volume = 0.5 * (one + other) - np.log(len(free)) - values
    error = 0.5 * _STUDENT * max(float(np.hypot(its_error, other_error)), abs(one - other))
    return Integral(
        free,
        values,
        log_volume,
        part,
        np.zeros(len(free), dtype=bool),
        proposal,
        bridge_error=error,
    )


def _chain(
    log_density: LogDensity, sample: Integral, random: np.random.RandomState
) -> Array | None:
    """Draws of f, shape (ensembles, walkers, draws, h), of ensembles that have each been
    everywhere; none where they have not. The walkers of an ensemble wander together, unseen by
    diagnostics that take them for chains: it is their mean ln f, in the order of time, that must
    mix. Until it does a run three times as long begins where the last one ended."""
    h = sample.free.shape[1]
    half = _ENSEMBLES // 2 * (walkers := max(_WALKERS, 4 * h))
    heavy = np.argsort(-sample._log_weight - random.gumbel(size=len(sample.free)))[:half]
    starts = np.concatenate(
        [sample.free[heavy], sample.draw(half, random, temperature=_WIDE)]
    ).reshape(_ENSEMBLES, walkers, h)
    for k in range(_RUNS):
        rule = StoppingRule(ess=_DRAWS * _LONGER**k)
        sequence = np.random.SeedSequence(random.randint(1 << 31))
        run = run_ensembles(log_density, starts, rule=rule, seed=sequence)
        chain = run.chain.reshape(_ENSEMBLES, walkers, -1, h)
        height = in_chunks(log_density, chain.reshape(-1, h)).reshape(chain.shape[:3]).mean(axis=1)
        mixing = diagnose(height[..., None])
        if run.converged and mixing.ess_bulk[0] >= _WANDERED and mixing.rhat[0] <= _APART:
            return chain
        starts = chain[:, :, -1]
    return None


def _bridge(
    log_density: LogDensity, sample: Integral, fitted: Array, chain: Array, rng: Random
) -> tuple[float, float, Mixture]:
    """ln ∫ f from one chain (ensembles, walkers, draws, h) and draws of a proposal fitted to
    another; its standard error (Frühwirth-Schnatter, Econometrics Journal 7, 143-167, 2004), the
    chain's from means over walkers in the order of time; and the proposal."""
    own, points = (each.reshape(-1, chain.shape[3]) for each in (fitted, chain))
    proposal = cast("Mixture", sample.proposal)
    for _ in range(2):
        proposal = _moved(proposal, own, np.full(len(own), 1.0 / len(own)))
    drawn = proposal.draw(len(points), rng)
    here, there = (
        in_chunks(log_density, own) - proposal.log_density(own) for own in (points, drawn)
    )
    share = 1.0 / (
        1.0 + len(points) / diagnose(chain.reshape(len(chain), -1, chain.shape[3])).ess_bulk.min()
    )
    value = float(np.median(here))
    before = np.inf
    while abs(value - before) > _SETTLED:
        of_chain, of_drawn = (
            -np.logaddexp(np.log(share) + own, np.log1p(-share) + value) for own in (here, there)
        )
        before = value
        value = float(np.logaddexp.reduce(there + of_drawn) - np.logaddexp.reduce(of_chain))
    over_time = np.exp(of_chain + value).reshape(chain.shape[:3]).mean(axis=1)
    inside = np.exp(there + of_drawn)
    variance = over_time.var() / over_time.mean() ** 2 / diagnose(over_time[..., None]).ess_bulk[0]
    return (
        value,
        float(np.sqrt(variance + inside.var() / inside.mean() ** 2 / len(inside))),
        proposal,
    )
