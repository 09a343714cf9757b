"""Search for the best design with whole numbers of runs (an exact design).

A candidate is a test that could be run, once or several times. A design states the number of runs
of each candidate. The criterion Φ is the figure of merit that the search maximises. The search
starts from several designs. In the first, the numbers of runs are the optimal ones, which need not
be whole numbers, rounded to whole numbers. The other designs are random. In each design, the search
replaces one test at a time by a better candidate, until none of the replacements that are tried
improves the design (coordinate exchange).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import combinations
from math import comb

import numpy as np

from ldbb_bayes.analysis.design.objective import Objective
from ldbb_bayes.analysis.design.shares import (
    Optimum,
    is_better,
    largest_positions,
    optimal_shares,
)
from ldbb_bayes.campaign.campaign import distinct_forces
from ldbb_bayes.errors import InputError
from ldbb_bayes.results import Array

__all__ = ["MAX_TESTS", "ExactDesign", "Search", "efficient_rounding", "exchange"]

# Largest number of tests (circles) that a design may have.
MAX_TESTS = 300
# Largest number of times that the search goes through all tests of a design, to replace each test
# by a better candidate.
_MAX_SWEEPS = 50
# If there are at most this many candidate tests, all candidates are tried as replacements for each
# test of a design.
_FEW_CANDIDATES = 64
# If there are more than ``_FEW_CANDIDATES`` candidate tests, two groups of this size are tried as
# replacements for each test of a design: the candidates with the largest sensitivities, and random
# candidates. The sensitivity is the derivative of the criterion (figure of merit) with respect to
# the number of runs of the candidate.
_TRIED_CANDIDATES = 12
# At the end of a thorough search, two groups of this size are tried as replacements for each test
# of a design: the candidates with the largest sensitivities (derivatives of the design criterion),
# and random candidates.
_TRIED_AT_THE_END = 128
# Candidate tests are selected by their sensitivity (derivative of the design criterion with respect
# to the number of runs), averaged over values of the hyper-parameters. To save time, the average is
# taken over only one in ``_HYPER_STEP`` of these values.
_HYPER_STEP = 4
# Number of designs that the search starts from. The share of a candidate test is its number of runs
# divided by the number of all runs. The first design has the best shares, rounded to whole numbers
# of runs. In the other designs, the tests are drawn at random from the candidates. In every third
# of these designs, all candidates have the same probability. In the rest, the probabilities are the
# best shares.
_STARTS = 6
# Tolerance of the search for the best shares. The share of a candidate test is its number of runs
# divided by the number of all runs. Its sensitivity is the derivative of the design criterion with
# respect to its share. The search ends when the largest sensitivity exceeds the mean of the
# sensitivities, weighted by the shares, by at most this fraction of the mean.
_SHARES_TOLERANCE = 1e-5
# Largest number of restarts of the search from randomly changed designs. There are fewer restarts
# if their computing cost would otherwise exceed ``_RESTART_COST``. The cost is a product of four
# numbers: restarts, tests, candidates that are tried as replacements for each test, and elements of
# the precision matrices.
_MAX_RESTARTS = 100
_RESTART_COST = 4_000_000
# If at most this many designs are possible, the search does not restart from randomly changed
# designs.
_FEW_DESIGNS = 1000
# Two forces of a design are close if they differ by at most ``_CLOSE_FORCES`` times the range of
# force. If two candidates have close forces, all runs of one candidate are replaced by runs of the
# other, unless the relative loss of efficiency exceeds ``_MERGING_LOSS``.
_CLOSE_FORCES = 0.05
_MERGING_LOSS = 1e-4


def efficient_rounding(share: Array, tests: int) -> Array:
    """Round given shares of the candidates to whole numbers of runs, whose sum is ``tests``.

    The method is that of Pukelsheim and Rieder (1992).

    Parameters
    ----------
    share
        Share of each candidate in the number of all runs, shape (candidates,).
    tests
        Number of tests.

    Returns
    -------
    Array
        Number of runs of each candidate, shape (candidates,); the sum is ``tests``.
    """
    share = share / share.sum()
    support = np.flatnonzero(share)
    if len(support) > tests:
        support = support[largest_positions(share[support], tests)]
    support_share = share[support]
    counts = np.ceil((tests - 0.5 * len(support)) * support_share).astype(int)
    while counts.sum() < tests:
        counts[largest_positions(-counts / support_share)] += 1
    while counts.sum() > tests:
        counts[largest_positions((counts - 1) / support_share)] -= 1
    all_counts = np.zeros(len(share), dtype=int)
    all_counts[support] = counts
    return all_counts


def _always_feasible(_counts: Array) -> bool:
    """Return True: every design is allowed, whatever its numbers of tests."""
    return True


def exchange(
    objective: Objective,
    start: Array,
    rng: np.random.Generator,
    *,
    feasible: Callable[[Array], bool] = _always_feasible,
    thorough: bool = True,
) -> tuple[Array, float]:
    """Return a design improved by exchanging one test at a time, and its criterion.

    A design states the number of runs of each candidate. A test is exchanged for another candidate
    if this improves the design. The function ends when none of the exchanges that are tried
    improves the design, or after it has gone through all tests 50 times.

    Parameters
    ----------
    objective
        Criterion as a function of the number of runs of each candidate.
    start
        Number of runs of each candidate in the design to start from, shape (candidates,). The
        design must be allowed by ``feasible``.
    rng
        Random generator for the order in which tests are replaced, and for the candidates that are
        tried.
    feasible
        Function that takes the counts of a design and returns whether the design is allowed.
        Default: all designs are allowed.
    thorough
        Whether the search tries more candidates as replacements for each test after the first
        candidates bring no further improvement. If false, the search always tries only a few
        candidates.

    Returns
    -------
    counts : Array
        Number of runs of each candidate in the design, shape (candidates,).
    value : float
        Value Φ of the criterion for the design.
    """
    n = objective.candidates
    counts = start.copy()
    value = objective.value(start.astype(float))
    size = n
    if n > _FEW_CANDIDATES:
        size = _TRIED_CANDIDATES
    coarse = objective.at_every(_HYPER_STEP)
    for _ in range(_MAX_SWEEPS):
        previous_value = value
        for position in rng.permutation(np.flatnonzero(counts)):
            base = _with_tests(counts, position, -1)
            likely = _likely_candidates(coarse, base, size, rng)
            replacements = np.array([j for j in likely if feasible(_with_tests(base, j))], int)
            values = objective.after_adding(base.astype(float), replacements)
            # There is one best replacement for the test, or none if no replacement is allowed. The
            # loop therefore runs at most once.
            for best in largest_positions(values):
                if is_better(values[best], value):
                    counts = _with_tests(base, replacements[best])
                    value = float(values[best])
        if value > previous_value:
            continue
        if not thorough or size >= min(_TRIED_AT_THE_END, n):
            break
        size = _TRIED_AT_THE_END
    return counts, value


def _with_tests(counts: Array, candidate: int, number: int = 1) -> Array:
    """Return the numbers of runs in a design after ``number`` runs of one candidate are added.

    ``candidate`` is the index of this candidate. ``counts`` holds the number of runs of each
    candidate before the addition, shape (candidates,).
    """
    changed = counts.copy()
    changed[candidate] += number
    return changed


def _likely_candidates(
    objective: Objective, base: Array, size: int, rng: np.random.Generator
) -> Array:
    """Return the indices of candidates whose addition to a design is likely to improve it.

    The result holds the ``size`` candidates with the largest sensitivities, and ``size`` random
    candidates. The sensitivity is the derivative of the criterion with respect to the number of
    runs of the candidate. If there are at most ``size`` candidates, all are returned. ``base``
    holds the number of runs of each candidate in the design, shape (candidates,).
    """
    n = objective.candidates
    if size >= n:
        return np.arange(n)
    random_candidates = rng.choice(n, size, replace=False)
    try:
        sensitivity = objective.sensitivity(base.astype(float))[1]
    except np.linalg.LinAlgError:
        return random_candidates
    return np.union1d(largest_positions(sensitivity, size), random_candidates)


@dataclass(frozen=True, eq=False)
class ExactDesign:
    """A design with whole numbers of tests, and the best design with fractions of tests."""

    #: number of runs of each candidate in the design, as an integer, shape (candidates,)
    counts: Array
    value: float  #: value Φ of the design criterion (figure of merit) for this design
    #: best design with the same total number of tests, if fractions of tests are permitted
    optimum: Optimum
    #: efficiency of the design: 1 if its ``value`` equals the value of the criterion for
    #: ``optimum``, and smaller if the design is worse
    efficiency: float


@dataclass(frozen=True, eq=False)
class Search:
    """Search for the best design among candidate tests.

    A design states the number of runs of each candidate. The objective is a function that measures
    how good a design is. ``seed`` is the seed of the random numbers.
    """

    objective: Objective
    forces_N: Array  #: force of each candidate test [N], shape (candidates,)
    levels: int  #: minimum number of different forces that a design must have
    seed: int
    _shares: dict[float, Optimum] = field(default_factory=dict, init=False)

    def shares(self, tests: float) -> Optimum:
        """Return the best share of each candidate, and the sensitivity of each candidate.

        The number of all runs is ``tests``; the share of a candidate is its number of runs divided
        by ``tests``. The sensitivity of a candidate is the derivative of the design criterion with
        respect to its share. The result is computed only once for each number of tests.
        """
        if tests not in self._shares:
            self._shares[tests] = optimal_shares(self.objective, tests, tolerance=_SHARES_TOLERANCE)
        return self._shares[tests]

    def find_design(self, tests: int) -> ExactDesign:
        """Return the best design found for a number of tests.

        Raise an `InputError` if no design has tests at enough different forces, or if the best
        design does not determine all parameters.
        """
        possible_levels = min(tests, len(distinct_forces(self.forces_N)))
        if possible_levels < self.levels:
            raise InputError(
                f"tests must be at {self.levels} different forces at least for this degree, got"
                f" {possible_levels}. Ask for more tests, offer more force levels, or use"
                " --augment."
            )
        optimum = self.shares(float(tests))
        rng = np.random.default_rng(self.seed)
        best = np.zeros(self.objective.candidates, dtype=int)
        value = -np.inf
        starts = self._starting_designs(optimum.share, tests, rng)
        for k in range(_STARTS + self._number_of_restarts(tests)):
            if k >= _STARTS:
                starts.append(_perturbed(best, rng))
            start = self._at_enough_forces(starts[k], rng)
            counts, start_value = exchange(
                self.objective, start, rng, feasible=self._is_feasible, thorough=False
            )
            if is_better(start_value, value):
                best = counts
                value = start_value
        best, value = exchange(self.objective, best, rng, feasible=self._is_feasible)
        if not np.isfinite(value):
            raise InputError(
                f"tests must be enough to determine the parameters, got {tests}. Ask for more"
                " tests, offer more force levels, or use proper priors."
            )
        best, value = self._merge_close_forces(best, value)
        efficiency = self.objective.efficiency(value, optimum.value)
        return ExactDesign(best, value, optimum, efficiency)

    def _starting_designs(self, share: Array, tests: int, rng: np.random.Generator) -> list[Array]:
        """Return the designs from which the search starts, as arrays of shape (candidates,).

        A design holds the number of runs of each candidate. ``share``, shape (candidates,), holds
        the best fraction of all ``tests`` for each candidate. The first design is found by rounding
        these fractions to whole tests; the other designs are random.
        """
        n = self.objective.candidates
        starts = [efficient_rounding(share, tests)]
        for k in range(1, _STARTS):
            probabilities = share if k % 3 else None
            starts.append(np.bincount(rng.choice(n, tests, p=probabilities), minlength=n))
        return starts

    def _is_feasible(self, counts: Array) -> bool:
        """Return whether a design has tests at ``levels`` different forces or more.

        ``counts`` holds the number of runs of each candidate in the design.
        """
        return len(distinct_forces(self.forces_N[counts > 0])) >= self.levels

    def _merge_close_forces(self, counts: Array, value: float) -> tuple[Array, float]:
        """Return a design in which close forces are merged, and the value of its criterion.

        Two forces are close if they are nearly equal. If two candidate tests have close forces, all
        runs of one are replaced by runs of the other. The replacement is made only if it reduces
        the efficiency by at most 0.01 %, and if enough different forces remain. ``counts`` states
        how often each candidate is run before merging, shape (candidates,), and ``value`` is the
        criterion of the design before merging.
        """
        unmerged_value = value
        close_N = _CLOSE_FORCES * np.ptp(self.forces_N)
        for i, j in combinations(np.flatnonzero(counts).tolist(), 2):
            distance_N = abs(self.forces_N[i] - self.forces_N[j])
            if not (counts[i] and counts[j] and 0.0 < distance_N <= close_N):
                continue
            merged = [_merge_tests(counts, i, j), _merge_tests(counts, j, i)]
            values = [self.objective.value(design.astype(float)) for design in merged]
            best = int(largest_positions(np.array(values))[0])
            efficiency = self.objective.efficiency(values[best], unmerged_value)
            if efficiency >= 1.0 - _MERGING_LOSS and self._is_feasible(merged[best]):
                counts = merged[best]
                value = values[best]
        return counts, value

    def _at_enough_forces(self, counts: Array, rng: np.random.Generator) -> Array:
        """Return a design with tests at ``levels`` different forces or more.

        ``levels`` is one or two. ``counts`` holds the number of runs of each candidate in the
        original design. This design is returned unchanged if it has enough different forces.
        Otherwise, one of its tests is replaced by a candidate at another force, drawn at random
        with ``rng``. Forces that are nearly equal do not count as different. If the force of no
        candidate differs enough from that of the other tests, the other tests are first replaced by
        tests of the candidate with the lowest force.
        """
        if self._is_feasible(counts):
            return counts
        without_one = _with_tests(counts, int(np.argmax(counts)), -1)
        candidates = self._completing_candidates(without_one)
        if not candidates:
            tests = int(without_one.sum())
            lowest_force = int(np.argmin(self.forces_N))
            without_one = _with_tests(np.zeros_like(counts), lowest_force, tests)
            candidates = self._completing_candidates(without_one)
        return _with_tests(without_one, rng.choice(candidates))

    def _completing_candidates(self, counts: Array) -> list[int]:
        """Return the indices of candidates that can give a design enough different forces.

        With one more run of any of these candidates, the design has tests at ``levels`` different
        forces or more. ``counts`` holds the number of runs of each candidate in the design.
        """
        n = self.objective.candidates
        return [j for j in range(n) if self._is_feasible(_with_tests(counts, j))]

    def _number_of_restarts(self, tests: int) -> int:
        """Return how many times the search restarts from randomly changed designs.

        ``tests`` is the number of tests of a design. The number of restarts is limited to save
        time. There are no restarts if at most 1000 designs are possible.
        """
        n = self.objective.candidates
        possible_designs = comb(n + tests - 1, tests)
        if possible_designs <= _FEW_DESIGNS:
            return 0
        exchanges_per_test = n
        if n > _FEW_CANDIDATES:
            exchanges_per_test = 2 * _TRIED_CANDIDATES
        cost = self.objective.prior.size * tests * exchanges_per_test
        return min(_MAX_RESTARTS, _RESTART_COST // cost)


def _merge_tests(counts: Array, source: int, target: int) -> Array:
    """Return a design in which all runs of candidate ``source`` are replaced by runs of ``target``.

    ``source`` and ``target`` are the indices of two candidate tests. ``counts`` states how often
    each candidate is run before the replacement, and the result how often it is run afterwards;
    both have the shape (candidates,).
    """
    number = int(counts[source])
    return _with_tests(_with_tests(counts, source, -number), target, number)


def _perturbed(counts: Array, rng: np.random.Generator) -> Array:
    """Return a design in which a third of the tests are replaced by random tests.

    A design is described by an array, shape (candidates,), that states how often each candidate
    test is run; ``counts`` is the original design. At least one test is replaced. Every replacement
    is drawn from all candidates.
    """
    n = len(counts)
    number = max(1, int(counts.sum()) // 3)
    removed = rng.choice(np.repeat(np.arange(n), counts), number, replace=False)
    added = rng.integers(n, size=number)
    return np.asarray(counts - np.bincount(removed, minlength=n) + np.bincount(added, minlength=n))
