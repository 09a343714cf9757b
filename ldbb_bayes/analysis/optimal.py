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
from functools import cached_property
from itertools import combinations
from math import comb
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import distinct_forces
from ldbb_bayes.errors import InputError
from ldbb_bayes.results import Array, Shown

__all__ = [
    "MOST_TESTS",
    "Criterion",
    "Determinant",
    "Found",
    "LogBayesFactor",
    "Objective",
    "Search",
    "Variance",
]

_NEGLIGIBLE = 1e-14
_NOTHING = 1e-6
_CHUNK = 1 << 22


@dataclass(frozen=True)
class Determinant:
    """Φ = ln det S: D and D_s; with proper priors Φ/2 is the expected information gain but for a
    constant [nat]."""

    concave: ClassVar[bool] = True
    size: int

    def value(self, root: Array) -> Array:
        return np.asarray(2.0 * np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1))

    def directions(self, root: Array) -> Array:
        return _inverse_transposed(root)

    def efficiency(self, value: float, best: float) -> float:
        """(det S / det S*)^(1/s), s the number of parameters."""
        return float(np.exp((value - best) / self.size))


@dataclass(frozen=True, eq=False)
class Variance:
    """Φ = −tr(W S⁻¹), W (s, s): A (W = 1), c (W = c cᵀ), I (W the mean of x xᵀ over what is to be
    predicted)."""

    concave: ClassVar[bool] = True
    weight: Array

    def value(self, root: Array) -> Array:
        inverse = _inverse_transposed(root)
        return np.asarray(-np.einsum("ij,...jk,...ik->...", self.weight, inverse, inverse))

    def directions(self, root: Array) -> Array:
        """S⁻¹ W^½."""
        inverse = _inverse_transposed(root)
        values, vectors = np.linalg.eigh(self.weight)
        kept = values > _NEGLIGIBLE * values.max()
        return np.asarray(
            inverse @ np.swapaxes(inverse, -1, -2) @ (vectors[:, kept] * np.sqrt(values[kept]))
        )

    def efficiency(self, value: float, best: float) -> float:
        """Ratio of the mean variances."""
        return float(best / value)


@dataclass(frozen=True)
class LogBayesFactor:
    """Φ = the expected ln B in favour of the truth, with the parameters or without them, both
    equally probable.

    S must be in units of the prior, eigenvalues 1 + λ: scale ``rows`` and ``prior`` so that the
    prior alone is the identity. If parameters are ``size`` prior sd in the mean square, E[ln B] is
    ½ Σ [(1 + size² λ) λ/(1 + λ) − ln(1 + λ)], and ½ Σ [λ/(1 + λ) − ln(1 + λ)] if they are not
    there; half the difference is Φ = ¼ size² Σ λ²/(1 + λ), which never falls. For one parameter it
    leads to the design of T-optimality. Not concave: an optimum is a local one.
    """

    concave: ClassVar[bool] = False
    size: float = 1.0

    def value(self, root: Array) -> Array:
        gain = np.maximum(np.linalg.eigvalsh(_square(root)) - 1.0, 0.0)
        return np.asarray(0.25 * self.size**2 * (gain**2 / (1.0 + gain)).sum(axis=-1))

    def directions(self, root: Array) -> Array:
        """The eigenvectors times the root of dΦ/d(1 + λ)."""
        s, vectors = np.linalg.eigh(_square(root))
        rate = 0.25 * self.size**2 * (1.0 - 1.0 / np.maximum(s, 1.0) ** 2)
        return np.asarray(vectors * np.sqrt(rate)[..., None, :])

    def efficiency(self, value: float, best: float) -> float:
        return float(value / best)


Criterion: TypeAlias = Determinant | Variance | LogBayesFactor


def _square(root: Array) -> Array:
    return np.asarray(root @ np.swapaxes(root, -1, -2))


def _inverse_transposed(root: Array) -> Array:
    """L⁻ᵀ, whose square is S⁻¹."""
    return np.linalg.solve(
        np.swapaxes(root, -1, -2), np.broadcast_to(np.eye(root.shape[-1]), root.shape)
    )


@dataclass(frozen=True, eq=False)
class Objective(Shown):
    """Φ of designs, averaged over K values of the hyper-parameters; a design is its numbers of
    tests, counts (candidates,)."""

    #: G (K, candidates, m, p), in sd of the noise: one test of a candidate adds GᵀG to the
    #: precision
    rows: Array
    #: P (K, p, p): the precision matrix before these tests, of prior and tests already run; zeros
    #: where flat
    prior: Array
    #: s: the last s of the p parameters are of interest, all others are projected out
    interest: int
    criterion: Criterion  #: `Determinant`, `Variance` or `LogBayesFactor`

    @property
    def candidates(self) -> int:
        return int(self.rows.shape[1])

    def among(self, chosen: Array) -> Objective:
        """The same with only some of the candidates."""
        return replace(self, rows=self.rows[:, chosen])

    def efficiency(self, value: float, best: float) -> float:
        """Of a design with this value beside the best."""
        return self.criterion.efficiency(value, best) if np.isfinite(value) else 0.0

    def value(self, counts: Array) -> float:
        """Φ of a design; −inf where it leaves something undetermined."""
        return float(self._values(self._precision(counts)).mean())

    def after_adding(self, counts: Array, chosen: Array) -> Array:
        """Φ with one more test of each of some candidates in turn, shape (chosen,)."""
        total = np.zeros(len(chosen))
        base = self._precision(counts)
        size = max(1, _CHUNK // base.size)
        for start in range(0, len(chosen), size):
            rows = self.rows[:, chosen[start : start + size]]
            precision = base + np.swapaxes(np.swapaxes(rows, -1, -2) @ rows, 0, 1)
            values = self._values(precision.reshape(-1, *base.shape[1:]))
            total[start : start + size] = values.reshape(-1, len(base)).mean(axis=1)
        return total

    def sensitivity(self, counts: Array) -> tuple[float, Array]:
        """Φ and ∂Φ/∂n_i = mean over K of ‖G_ki D_k‖², shape (candidates,), with ∂Φ/∂M = D Dᵀ."""
        s = self.interest
        precision = self._precision(counts)
        nuisance = precision[..., :-s, :-s]
        cross = precision[..., :-s, -s:]
        back = -np.linalg.solve(nuisance, cross)
        root = np.linalg.cholesky(precision[..., -s:, -s:] + np.swapaxes(cross, -1, -2) @ back)
        own = self.criterion.directions(root)
        slope = np.zeros(self.candidates)
        for rows, direction in zip(
            self.rows, np.concatenate([back @ own, own], axis=-2), strict=True
        ):
            seen = (rows.reshape(-1, rows.shape[-1]) @ direction).reshape(len(slope), -1)
            slope += np.einsum("ij,ij->i", seen, seen)
        return float(self.criterion.value(root).mean()), slope / len(root)

    def _precision(self, counts: Array) -> Array:
        """M, shape (K, p, p)."""
        used = np.flatnonzero(counts)
        scaled = self.rows[:, used] * np.sqrt(counts[used])[:, None, None]
        stacked = scaled.reshape(len(scaled), -1, scaled.shape[-1])
        return np.asarray(self.prior + np.swapaxes(stacked, -1, -2) @ stacked)

    def _values(self, precision: Array) -> Array:
        """Φ of every matrix M, −inf where it is singular."""
        try:
            root = np.linalg.cholesky(precision)
        except np.linalg.LinAlgError:
            if len(precision) == 1:
                return np.array([-np.inf])
            return np.concatenate([self._values(matrix[None]) for matrix in precision])
        values = self.criterion.value(root[:, -self.interest :, -self.interest :])
        if self._open:
            # Where only rounding kept a factorisation alive: what is left of a column beside the
            # others is nothing.
            left = np.diagonal(root, axis1=-2, axis2=-1) / np.sqrt(
                np.diagonal(precision, axis1=-2, axis2=-1)
            )
            values = np.where(left.min(axis=-1) < _NOTHING, -np.inf, values)
        return values

    @cached_property
    def _open(self) -> bool:
        """Whether the tests must determine something that nothing determines before."""
        return bool(np.linalg.matrix_rank(self.prior).min() < self.prior.shape[-1])


# ---- shares

# Values that differ by less, relative to the largest, count as equal: the first of them in the
# candidates' order is taken.
_EQUAL = 1e-9
_ROUNDS = 400
_ITERATIONS = 40
_SWEEPS = 50
_ADDED = 3
_FIRST = 32
_GONE = 1e-10
_FRESH = 0.02
_UNDETERMINED = 1e6
_LOOSE = 1e-5
_TIGHT = 1e-15
_SLACK = 1e-3
_NO_GAIN = 1e-13


def _largest(values: Array, number: int = 1) -> NDArray[np.intp]:
    """Positions of the largest values, those that count as equal in the order they have."""
    finite = np.isfinite(values)
    unit = _EQUAL * max(float(np.abs(values[finite]).max(initial=0.0)), 1e-300)
    return np.argsort(-np.where(finite, np.rint(values / unit), -np.inf), kind="stable")[:number]


def _better(value: float, than: float) -> bool:
    """Whether a value is larger by more than rounding."""
    return bool(value > than + (_EQUAL * max(1.0, abs(than)) if np.isfinite(than) else 0.0))


@dataclass(frozen=True, eq=False)
class Optimum(Shown):
    """Shares of N tests (candidates,), their Φ, and N ∂Φ/∂n_i, nowhere above its mean over the
    shares if these are the best."""

    share: Array
    value: float
    sensitivity: Array
    bound: float

    @property
    def excess(self) -> float:
        """Of the largest sensitivity over the bound: for a concave Φ no design is better by more
        than bound · excess."""
        return float(self.sensitivity.max() / self.bound - 1.0)


def certificate(objective: Objective, share: Array, tests: float) -> Optimum:
    """Value, sensitivities and bound of shares of N tests."""
    value, slope = objective.sensitivity(tests * share)
    return Optimum(share, value, tests * slope, float(tests * slope @ share))


def optimal_shares(objective: Objective, tests: float, *, tolerance: float = 1e-6) -> Optimum:
    """The shares of N tests that make Φ largest, from equal shares on, until the relative excess is
    within the tolerance. Fully corrective: shares of a few candidates are solved for, and
    candidates above the bound join them. N does not matter where the prior is flat;
    `Optimum.excess` says what was reached."""
    n = objective.candidates
    share = np.full(n, 1.0 / n)
    if not np.isfinite(objective.value(tests * share)):
        cure = "Offer more force levels, or use proper priors."
        raise InputError(
            f"the candidates must determine the parameters, got too few different ones. {cure}"
        )
    found = certificate(objective, share, tests)
    spread = np.unique(np.linspace(0, n - 1, min(n, _FIRST)).astype(int))
    active = np.union1d(spread, _largest(found.sensitivity, _ADDED))
    slack = _LOOSE
    before = -np.inf
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
        before = found.value
        found = certificate(objective, share, tests)
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

    from scipy import optimize

    minimize: Any = optimize.minimize
    one = {"type": "eq", "fun": lambda x: x.sum() - 1.0, "jac": lambda x: np.ones((1, len(x)))}
    options = {"ftol": slack, "maxiter": _ITERATIONS}
    x = minimize(
        loss,
        initial,
        jac=True,
        method="SLSQP",
        bounds=[(0.0, 1.0)] * n,
        constraints=one,
        options=options,
    ).x
    share = np.where(x > _GONE, x, 0.0)
    return np.asarray(share / share.sum())


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
