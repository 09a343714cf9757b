"""The best shares of tests with their certificate, and the best whole tests, of a number or within a budget."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import combinations
from math import comb
from typing import Any

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from ldbb_bayes.analysis.design.criteria import Objective, SmallestEigenvalue
from ldbb_bayes.campaign.campaign import distinct_forces
from ldbb_bayes.errors import InputError

__all__ = [
    "MOST_TESTS",
    "Found",
    "Optimum",
    "Search",
    "better",
    "certificate",
    "efficient_rounding",
    "exchange",
    "optimal_shares",
]

Array = NDArray[Any]
# Values that differ by less, relative to the largest, count as equal: the first of them in the candidates' order is taken.
_EQUAL = 1e-9
_ROUNDS, _ITERATIONS, _SWEEPS = 400, 40, 50
_ADDED, _FIRST = 3, 32
_GONE, _FRESH = 1e-10, 0.02
_UNDETERMINED = 1e6
_KINKED = 1e-5
_LOOSE, _TIGHT, _SLACK = 1e-5, 1e-15, 1e-3
_NO_GAIN = 1e-13


def _largest(values: Array, number: int = 1) -> NDArray[np.intp]:
    """Positions of the largest values, those that count as equal in the order they have."""
    finite = np.isfinite(values)
    unit = _EQUAL * max(float(np.abs(values[finite]).max(initial=0.0)), 1e-300)
    return np.argsort(-np.where(finite, np.rint(values / unit), -np.inf), kind="stable")[:number]


def better(value: float, than: float) -> bool:
    """Whether a value is larger by more than rounding."""
    return bool(value > than + (_EQUAL * max(1.0, abs(than)) if np.isfinite(than) else 0.0))


@dataclass(frozen=True, eq=False)
class Optimum:
    """Shares of N tests (candidates,), their Φ, and N ∂Φ/∂n_i, nowhere above its mean over the shares if these are the best."""

    share: Array
    value: float
    sensitivity: Array
    bound: float

    @property
    def excess(self) -> float:
        """Of the largest sensitivity over the bound: for a concave Φ no design is better by more than bound · excess."""
        return float(self.sensitivity.max() / self.bound - 1.0)


def certificate(objective: Objective, share: Array, tests: float) -> Optimum:
    """Value, sensitivities and bound of shares of N tests."""
    value, slope = objective.sensitivity(tests * share)
    return Optimum(share, value, tests * slope, float(tests * slope @ share))


def optimal_shares(objective: Objective, tests: float, *, tolerance: float = 1e-6, start: Array | None = None) -> Optimum:
    """The shares of N tests that make Φ largest, from a start or equal shares, until the relative excess is within the tolerance.

    N does not matter where the prior is flat; `Optimum.excess` says what was reached.
    """
    found = _fully_corrective(objective, tests, tolerance, start)
    kinked = any(isinstance(case.criterion, SmallestEigenvalue) for case in objective.cases)
    if not kinked or found.excess <= tolerance:
        return found
    return _by_cutting_planes(objective, tests, max(tolerance, _KINKED), found)


def _fully_corrective(objective: Objective, tests: float, tolerance: float, start: Array | None) -> Optimum:
    """Shares of a few candidates solved for; candidates above the bound join them."""
    n = objective.candidates
    share = np.full(n, 1.0 / n) if start is None else start
    if not np.isfinite(objective.value(tests * share)):
        raise InputError(
            "the candidates must determine the parameters, got too few different ones. "
            "Offer more force levels, or use proper priors."
        )
    found = certificate(objective, share, tests)
    active = np.flatnonzero(share)
    if start is None:
        spread = np.unique(np.linspace(0, n - 1, min(n, _FIRST)).astype(int))
        active = np.union1d(spread, _largest(found.sensitivity, _ADDED))
    slack, before = _LOOSE, -np.inf
    for _ in range(_ROUNDS):
        highest = _largest(found.sensitivity, _ADDED)
        above = highest[found.sensitivity[highest] > found.bound]
        new = np.setdiff1d(above if len(above) else highest[:1], active)
        if not len(new) and slack <= _TIGHT and found.value - before <= _NO_GAIN * abs(found.bound):
            break
        slack = slack if len(new) else _TIGHT
        active = np.concatenate([active, new])
        inner = _solve(objective.among(active), tests, share[active], slack)
        share = np.zeros(n)
        share[active] = inner
        before, found = found.value, certificate(objective, share, tests)
        if found.excess <= tolerance:
            break
        active = active[inner > _GONE]
        slack = max(_TIGHT, min(slack, _SLACK * found.excess))
    return found


def _solve(objective: Objective, tests: float, start: Array, slack: float) -> Array:
    """Shares among few candidates."""
    n = objective.candidates
    if n == 1:
        return np.ones(1)
    initial = np.maximum(start, _FRESH / n)
    initial /= initial.sum()
    scale = abs(objective.sensitivity(tests * initial)[1] @ initial) * tests

    def loss(share: Array) -> tuple[Any, Any]:
        try:
            value, slope = objective.sensitivity(tests * np.maximum(share, 0.0))
        except np.linalg.LinAlgError:
            return _UNDETERMINED, np.zeros(n)
        return -value / scale, -tests * slope / scale

    minimize: Any = scipy.optimize.minimize
    one = {"type": "eq", "fun": lambda x: x.sum() - 1.0, "jac": lambda x: np.ones((1, len(x)))}
    options = {"ftol": slack, "maxiter": _ITERATIONS}
    x = minimize(loss, initial, jac=True, method="SLSQP", bounds=[(0.0, 1.0)] * n, constraints=one, options=options).x
    share = np.where(x > _GONE, x, 0.0)
    return np.asarray(share / share.sum())


def _by_cutting_planes(objective: Objective, tests: float, tolerance: float, smooth: Optimum) -> Optimum:
    """max Σ q_k t_k with t_k ≤ zᵀ M_k z for ever more z, the eigenvectors met: linear programs with exact cuts (Kelley 1960)."""
    n, cases = objective.candidates, objective.cases
    weights = np.concatenate([case.weight for case in cases])
    cost = np.concatenate([np.zeros(n), -weights])
    equal = np.concatenate([np.ones(n), np.zeros(len(weights))])[None]
    bounds = [(0.0, None)] * n + [(None, None)] * len(weights)
    rows: list[Array] = []
    sides: list[float] = []
    share, best, best_value = smooth.share, smooth.share, smooth.value
    found: Any = None
    for _ in range(_ROUNDS):
        value = objective.value(tests * share)
        if value > best_value:
            best, best_value = share, value
        nodes = [(c.interest, *own) for c in cases for own in zip(c.precision(tests * share), c.prior, c.rows, strict=True)]
        for unit, (interest, precision, prior, design) in zip(np.eye(len(weights)), nodes, strict=True):
            z = _worst(precision, interest)
            rows.append(np.concatenate([-tests * ((design @ z) ** 2).sum(axis=1), unit]))
            sides.append(float(z @ prior @ z))
        found = scipy.optimize.linprog(cost, np.array(rows), np.array(sides), equal, [1.0], bounds)
        share = np.maximum(found.x[:n], 0.0)
        if -found.fun - best_value <= tolerance * abs(best_value):
            break
    # The multipliers of the cuts weigh the eigenvectors: with them the equivalence theorem holds at a kink too.
    multipliers = found.ineqlin.marginals
    return Optimum(best, best_value, multipliers @ np.array(rows)[:, :n], best_value + float(multipliers @ np.array(sides)))


def _worst(precision: Array, s: int) -> Array:
    """z with zᵀ M z the smallest eigenvalue of the Schur complement."""
    nuisance, cross = precision[:-s, :-s], precision[:-s, -s:]
    back = -np.linalg.lstsq(nuisance, cross, rcond=None)[0] if len(nuisance) else np.zeros((0, s))
    vector = np.linalg.eigh(precision[-s:, -s:] + cross.T @ back)[1][:, 0]
    return np.concatenate([back @ vector, vector])


_ALL, _LEADING, _THOROUGH = 64, 12, 128


def efficient_rounding(share: Array, tests: int) -> Array:
    """Whole numbers of tests nearest to shares (Pukelsheim and Rieder 1992), shape (candidates,), summing to ``tests``."""
    share = share / share.sum()
    support = np.flatnonzero(share)
    if len(support) > tests:
        support = support[_largest(share[support], tests)]
    own = share[support]
    counts = np.ceil((tests - 0.5 * len(support)) * own).astype(int)
    while (total := counts.sum()) != tests:
        if total < tests:
            counts[_largest(-counts / own)] += 1
        else:
            counts[_largest((counts - 1) / own)] -= 1
    every = np.zeros(len(share), dtype=int)
    every[support] = counts
    return every


def exchange(
    objective: Objective,
    start: Array,
    rng: np.random.Generator,
    *,
    feasible: Callable[[Array], bool] = lambda counts: True,
    thorough: bool = True,
) -> tuple[Array, float]:
    """Counts and value of a design in which one test at a time, those of ``start``, is replaced by a better one until none is.

    Parameters
    ----------
    feasible : callable
        Whether a design (counts) may be had; that of ``start`` must be.
    thorough : bool
        End only when all candidates were tried in every place (of many, those of the largest sensitivity); else when a few were.
    """
    n = objective.candidates
    counts, value = start.copy(), objective.value(start.astype(float))
    size = _LEADING if n > _ALL else n
    for _ in range(_SWEEPS):
        before = value
        for i in rng.permutation(np.flatnonzero(counts)):
            base = _with(counts, i, -1)
            into = np.array([j for j in _likely(objective, base, size, rng) if feasible(_with(base, j))], dtype=int)
            values = objective.after_adding(base.astype(float), into)
            for best in _largest(values):
                if better(values[best], value):
                    counts, value = _with(base, into[best]), float(values[best])
        if value > before:
            continue
        if size >= min(_THOROUGH, n) or not thorough:
            break
        size = _THOROUGH
    return counts, value


def _with(counts: Array, j: int, more: int = 1) -> Array:
    changed = counts.copy()
    changed[j] += more
    return changed


def _likely(objective: Objective, base: Array, size: int, rng: np.random.Generator) -> Array:
    """The candidates of the largest sensitivity, and some at random; all when there are no more."""
    n = objective.candidates
    if size >= n:
        return np.arange(n)
    drawn = rng.choice(n, size, replace=False)
    try:
        return np.union1d(_largest(objective.sensitivity(base.astype(float))[1], size), drawn)
    except np.linalg.LinAlgError:
        return drawn


_STARTS, _TOLERANCE = 6, 1e-5
_MOST_SHAKES, _WORK, _FEW_DESIGNS = 100, 4_000_000, 1000
_CLOSE, _NO_LOSS = 0.05, 1e-4
MOST_TESTS = 300


@dataclass(frozen=True, eq=False)
class Found:
    """A design of whole tests, chosen among ``allowed`` candidates, and its efficiency beside the best shares of these."""

    counts: Array
    value: float
    allowed: Array
    optimum: Optimum
    efficiency: float

    @property
    def tests(self) -> int:
        """Their number."""
        return int(self.counts.sum())


@dataclass(frozen=True, eq=False)
class Search:
    """Candidates, each with its force, among which designs of at least ``levels`` different forces are looked for."""

    objective: Objective
    forces_N: Array
    levels: int
    seed: int
    _shares: dict[float, Optimum] = field(default_factory=dict, init=False)

    def among(self, allowed: Array) -> Search:
        """The same with only some of the candidates."""
        return Search(self.objective.among(allowed), self.forces_N[allowed], self.levels, self.seed)

    def shares(self, tests: float) -> Optimum:
        """The best shares of this many tests."""
        if tests not in self._shares:
            near = next((optimum.share for optimum in reversed(self._shares.values())), None)
            self._shares[tests] = optimal_shares(self.objective, tests, tolerance=_TOLERANCE, start=near)
        return self._shares[tests]

    def of_number(self, tests: int, *, starts: int = _STARTS, thorough: bool = True) -> Found:
        """The best design of this many whole tests; see `exchange` for ``thorough``."""
        there = min(tests, len(distinct_forces(self.forces_N)))
        if there < self.levels:
            raise InputError(
                f"tests must be at {self.levels} different forces at least for this degree, got {there}. Ask for more tests, "
                "offer more force levels, or use --augment."
            )
        optimum, rng = self.shares(float(tests)), np.random.default_rng(self.seed)
        best, value = np.zeros(self.objective.candidates, dtype=int), -np.inf
        first = _designs_to_start_from(optimum.share, tests, rng, starts)
        for k in range(starts + (self._shakes(tests) if starts == _STARTS else 0)):
            start = self._repaired(first[k] if k < starts else _shaken(best, rng), rng)
            counts, own = exchange(self.objective, start, rng, feasible=self._feasible, thorough=False)
            if better(own, value):
                best, value = counts, own
        best, value = exchange(self.objective, best, rng, feasible=self._feasible, thorough=thorough)
        if not np.isfinite(value):
            raise InputError(
                f"tests must be enough to determine the parameters, got {tests}. Ask for more tests, offer more force levels, or "
                "use proper priors."
            )
        best, value = self._at_fewer_forces(best, value)
        efficiency = self.objective.efficiency(value, optimum.value)
        return Found(best, value, np.arange(len(best)), optimum, efficiency)

    def _feasible(self, counts: Array) -> bool:
        return len(distinct_forces(self.forces_N[counts > 0])) >= self.levels

    def _at_fewer_forces(self, counts: Array, value: float) -> tuple[Array, float]:
        """The design with tests at neighbouring forces at one of them, where that costs no more than a ten-thousandth."""
        least = value
        for i, j in combinations(np.flatnonzero(counts).tolist(), 2):
            if counts[i] and counts[j] and 0.0 < abs(self.forces_N[i] - self.forces_N[j]) <= _CLOSE * np.ptp(self.forces_N):
                moved = [_with(_with(counts, k, -int(counts[k])), m, int(counts[k])) for k, m in ((i, j), (j, i))]
                values = [self.objective.value(own.astype(float)) for own in moved]
                k = int(_largest(np.array(values))[0])
                if self.objective.efficiency(values[k], least) >= 1.0 - _NO_LOSS and self._feasible(moved[k]):
                    counts, value = moved[k], values[k]
        return counts, value

    def _repaired(self, start: Array, rng: np.random.Generator) -> Array:
        """The design, or one with a test at another force where it has too few forces."""
        if not self._feasible(start):
            start[np.argmax(start)] -= 1
            start[rng.choice(np.flatnonzero(self.forces_N != self.forces_N[np.argmax(start)]))] += 1
        return start

    def _shakes(self, tests: int) -> int:
        """How often a part of the best design is drawn anew: as often as costs little, where there are many designs."""
        n = self.objective.candidates
        size = sum(case.prior.size for case in self.objective.cases) * tests * (n if n <= _ALL else 2 * _LEADING)
        return min(_MOST_SHAKES, _WORK // size) if comb(n + tests - 1, tests) > _FEW_DESIGNS else 0


def _designs_to_start_from(share: Array, tests: int, rng: np.random.Generator, starts: int) -> list[Array]:
    """The rounded optimum, and draws from it and from all candidates in turn."""
    n = len(share)
    drawn = [np.bincount(rng.choice(n, tests, p=share if k % 3 else None), minlength=n) for k in range(1, starts)]
    return [efficient_rounding(share, tests), *drawn]


def _shaken(counts: Array, rng: np.random.Generator) -> Array:
    """The design with a third of its tests drawn anew from all candidates."""
    n, some = len(counts), max(1, int(counts.sum()) // 3)
    out = rng.choice(np.repeat(np.arange(n), counts), some, replace=False)
    return np.asarray(counts - np.bincount(out, minlength=n) + np.bincount(rng.integers(n, size=some), minlength=n))
