"""Optimum designs: criteria, the best shares of tests with their certificate, and the best whole
tests.

A design is a number of tests n_i of every candidate, each of which adds its information G_iᵀG_i to
the precision M of all parameters. S, shape (..., s, s), is what M says of the s parameters of
interest, in units in which they are comparable, with all others projected out: the Schur
complement. It comes as its lower triangular root, S = L Lᵀ. A criterion has a `value` Φ(S), shape
(...), that never falls when information is added; `directions` Q (..., s, q) with ∂Φ/∂S = Q Qᵀ,
which drive the search; whether it is `concave`, so that a local optimum over shares is the optimum;
and the `efficiency`, 0 … 1, of a design beside the best.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import combinations
from math import comb

import numpy as np

from ldbb_bayes.analysis.design.objective import Objective
from ldbb_bayes.analysis.design.shares import Optimum, _better, _largest, optimal_shares
from ldbb_bayes.campaign.campaign import distinct_forces
from ldbb_bayes.errors import InputError
from ldbb_bayes.results import Array

__all__ = ["Found", "MOST_TESTS", "Search"]


# ---- shares

_SWEEPS = 50


# ---- whole tests

_ALL = 64
_LEADING = 12
_THOROUGH = 128
_SOME = 4


def efficient_rounding(share: Array, tests: int) -> Array:
    """Whole numbers of tests nearest to shares (Pukelsheim and Rieder 1992), shape (candidates,),
    summing to ``tests``."""
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
    """Counts and value of a design in which one test at a time, those of ``start``, is replaced by
    a better one until none is. All designs, that of ``start`` too, are ``feasible``; ``thorough``:
    all candidates were tried in every place at the end (of many, those of the largest sensitivity),
    else a few."""
    n = objective.candidates
    counts = start.copy()
    value = objective.value(start.astype(float))
    size = _LEADING if n > _ALL else n
    for _ in range(_SWEEPS):
        before = value
        for i in rng.permutation(np.flatnonzero(counts)):
            base = _with(counts, i, -1)
            into = np.array(
                [j for j in _likely(objective, base, size, rng) if feasible(_with(base, j))],
                dtype=int,
            )
            values = objective.after_adding(base.astype(float), into)
            for best in _largest(values):
                if _better(values[best], value):
                    counts = _with(base, into[best])
                    value = float(values[best])
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
    """The candidates of the largest sensitivity (at a few hyper-parameters), and some at random;
    all when there are no more."""
    n = objective.candidates
    if size >= n:
        return np.arange(n)
    drawn = rng.choice(n, size, replace=False)
    try:
        some = replace(objective, rows=objective.rows[::_SOME], prior=objective.prior[::_SOME])
        return np.union1d(_largest(some.sensitivity(base.astype(float))[1], size), drawn)
    except np.linalg.LinAlgError:
        return drawn


_STARTS = 6
_TOLERANCE = 1e-5
_MOST_SHAKES = 100
_WORK = 4_000_000
_FEW_DESIGNS = 1000
_CLOSE = 0.05
_NO_LOSS = 1e-4
MOST_TESTS = 300


@dataclass(frozen=True, eq=False)
class Found:
    """A design of whole tests, and its efficiency beside the best shares of as many."""

    counts: Array
    value: float
    optimum: Optimum
    efficiency: float


@dataclass(frozen=True, eq=False)
class Search:
    """Candidates, each with its force, among which designs of at least ``levels`` different forces
    are looked for."""

    objective: Objective
    forces_N: Array
    levels: int
    seed: int
    _shares: dict[float, Optimum] = field(default_factory=dict, init=False)

    def shares(self, tests: float) -> Optimum:
        """The best shares of this many tests."""
        if tests not in self._shares:
            self._shares[tests] = optimal_shares(self.objective, tests, tolerance=_TOLERANCE)
        return self._shares[tests]

    def of_number(self, tests: int) -> Found:
        """The best design of this many whole tests."""
        there = min(tests, len(distinct_forces(self.forces_N)))
        if there < self.levels:
            cure = "Ask for more tests, offer more force levels, or use --augment."
            raise InputError(
                f"tests must be at {self.levels} different forces at least for this degree, got"
                f" {there}. {cure}"
            )
        optimum = self.shares(float(tests))
        rng = np.random.default_rng(self.seed)
        n = self.objective.candidates
        share = optimum.share
        best = np.zeros(n, dtype=int)
        value = -np.inf
        # The rounded optimum, and draws from it and from all candidates in turn.
        drawn = [
            np.bincount(rng.choice(n, tests, p=share if k % 3 else None), minlength=n)
            for k in range(1, _STARTS)
        ]
        first = [efficient_rounding(share, tests), *drawn]
        for k in range(_STARTS + self._shakes(tests)):
            start = self._repaired(first[k] if k < _STARTS else _shaken(best, rng), rng)
            counts, own = exchange(
                self.objective, start, rng, feasible=self._feasible, thorough=False
            )
            if _better(own, value):
                best = counts
                value = own
        best, value = exchange(self.objective, best, rng, feasible=self._feasible)
        if not np.isfinite(value):
            cure = "Ask for more tests, offer more force levels, or use proper priors."
            raise InputError(
                f"tests must be enough to determine the parameters, got {tests}. {cure}"
            )
        best, value = self._at_fewer_forces(best, value)
        efficiency = self.objective.efficiency(value, optimum.value)
        return Found(best, value, optimum, efficiency)

    def _feasible(self, counts: Array) -> bool:
        return len(distinct_forces(self.forces_N[counts > 0])) >= self.levels

    def _at_fewer_forces(self, counts: Array, value: float) -> tuple[Array, float]:
        """The design with tests at neighbouring forces at one of them, where that costs no more
        than a ten-thousandth."""
        least = value
        for i, j in combinations(np.flatnonzero(counts).tolist(), 2):
            if (
                counts[i]
                and counts[j]
                and 0.0 < abs(self.forces_N[i] - self.forces_N[j]) <= _CLOSE * np.ptp(self.forces_N)
            ):
                moved = [
                    _with(_with(counts, k, -int(counts[k])), m, int(counts[k]))
                    for k, m in ((i, j), (j, i))
                ]
                values = [self.objective.value(own.astype(float)) for own in moved]
                k = int(_largest(np.array(values))[0])
                if self.objective.efficiency(values[k], least) >= 1.0 - _NO_LOSS and self._feasible(
                    moved[k]
                ):
                    counts = moved[k]
                    value = values[k]
        return counts, value

    def _repaired(self, start: Array, rng: np.random.Generator) -> Array:
        """The design, or one with a test at another force where it has too few forces."""
        if not self._feasible(start):
            start[np.argmax(start)] -= 1
            start[rng.choice(np.flatnonzero(self.forces_N != self.forces_N[np.argmax(start)]))] += 1
        return start

    def _shakes(self, tests: int) -> int:
        """How often a part of the best design is drawn anew: as often as costs little, where there
        are many designs."""
        n = self.objective.candidates
        size = self.objective.prior.size * tests * (n if n <= _ALL else 2 * _LEADING)
        return min(_MOST_SHAKES, _WORK // size) if comb(n + tests - 1, tests) > _FEW_DESIGNS else 0


def _shaken(counts: Array, rng: np.random.Generator) -> Array:
    """The design with a third of its tests drawn anew from all candidates."""
    n = len(counts)
    some = max(1, int(counts.sum()) // 3)
    out = rng.choice(np.repeat(np.arange(n), counts), some, replace=False)
    return np.asarray(
        counts
        - np.bincount(out, minlength=n)
        + np.bincount(rng.integers(n, size=some), minlength=n)
    )
