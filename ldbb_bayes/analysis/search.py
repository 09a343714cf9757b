"""The search for tests: candidates under one criterion, their best shares, and the best whole tests for a number or a budget."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.analysis.costs import Costs
from ldbb_bayes.analysis.optimal.continuous import Optimum, optimal_shares
from ldbb_bayes.analysis.optimal.criteria import Criterion
from ldbb_bayes.analysis.optimal.exact import efficient_rounding, exchange
from ldbb_bayes.analysis.optimal.objective import Objective
from ldbb_bayes.campaign.circular_test import CircularTest
from ldbb_bayes.errors import InputError

__all__ = ["MOST_TESTS", "Found", "Search"]

Array = NDArray[Any]
_MOST_TRIALS, _FEW_STARTS = 120, 2
_AS_GOOD = 0.998
_QUICK = 4
MOST_TESTS = 300
_TOLERANCE, _ROUGH = 1e-5, 1e-3


@dataclass(frozen=True, eq=False)
class Found:
    """A design of whole tests.

    Attributes
    ----------
    counts : ndarray of int, shape (candidates,)
    value : float
    allowed : ndarray of int
        The candidates it was chosen from: all, or those whose clockings the budget pays for.
    optimum : Optimum
        The best shares of as many tests among these.
    efficiency : float
        Beside the best shares, which no design of as many whole tests can exceed.
    """

    counts: Array
    value: float
    allowed: Array
    optimum: Optimum
    efficiency: float


class Search:
    """Candidates and what one wants of them.

    Parameters
    ----------
    objective : Objective
        Of the candidates.
    tests : sequence of CircularTest
        The candidates.
    costs : Costs
    levels : int
        Fewest different forces of a design, so that the model can be fitted to it.
    starts : int
        From how many designs the exchange of single tests starts.
    seed : int
    """

    def __init__(
        self, objective: Objective, tests: Sequence[CircularTest], costs: Costs, *, levels: int, starts: int, seed: int
    ) -> None:
        self.objective, self.tests, self.costs = objective, tuple(tests), costs
        self._levels, self._starts, self._seed = levels, starts, seed
        self._forces = np.array([float(test.force_N or 0.0) for test in tests])
        self._known: dict[tuple[float, tuple[int, ...]], Optimum] = {}

    @cached_property
    def _quick(self) -> Objective:
        """The objective with few of the hyper-parameters' values, to rank clockings by."""
        cases = []
        for case in self.objective.cases:
            weight = case.weight[:_QUICK] / case.weight[:_QUICK].sum()
            cases.append(replace(case, rows=case.rows[:_QUICK], prior=case.prior[:_QUICK], weight=weight))
        return Objective(cases, self.objective.share)

    def under(self, criterion: Criterion) -> Search:
        """The same candidates under another criterion."""
        cases = [replace(case, criterion=criterion) for case in self.objective.cases]
        objective = Objective(cases, self.objective.share)
        return Search(objective, self.tests, self.costs, levels=self._levels, starts=self._starts, seed=self._seed)

    def shares(self, tests: float, allowed: Array | None = None) -> Optimum:
        """The best shares of this many tests, among some of the candidates or all."""
        key = (tests, () if allowed is None else tuple(allowed.tolist()))
        if key not in self._known:
            objective = self.objective if allowed is None else self.objective.among(allowed)
            near = [optimum.share for (_, own), optimum in self._known.items() if own == key[1]]
            self._known[key] = optimal_shares(objective, tests, tolerance=_TOLERANCE, start=near[-1] if near else None)
        return self._known[key]

    def of_number(self, tests: int, allowed: Array | None = None, *, starts: int | None = None, thorough: bool = True) -> Found:
        """The best design of this many whole tests; see `exchange` for ``thorough``."""
        chosen = np.arange(len(self.tests)) if allowed is None else allowed
        forces = self._forces[chosen]
        if tests < self._levels or len(np.unique(forces)) < self._levels:
            raise InputError(
                f"tests must be at {self._levels} different forces at least for this degree, got "
                f"{min(tests, len(np.unique(forces)))}. Ask for more tests, offer more force levels, or use --augment."
            )

        def feasible(counts: Array) -> bool:
            return len(np.unique(forces[counts > 0])) >= self._levels

        optimum = self.shares(float(tests), allowed)
        objective = self.objective if allowed is None else self.objective.among(allowed)
        rng = np.random.default_rng(self._seed)
        best, value = np.zeros(objective.candidates, dtype=int), -np.inf
        for start in self._designs_to_start_from(optimum.share, tests, rng, starts or self._starts):
            if not feasible(start):
                start[np.argmax(start)] -= 1
                start[rng.choice(np.flatnonzero(forces != forces[np.argmax(start)]))] += 1
            counts, own = exchange(objective, start, rng, feasible=feasible, thorough=False)
            if own > value:
                best, value = counts, own
        best, value = exchange(objective, best, rng, feasible=feasible, thorough=thorough)
        if not np.isfinite(value):
            raise InputError(
                f"tests must be enough to determine the parameters, got {tests}. Ask for more tests, offer more force levels, or "
                "use proper priors."
            )
        every = np.zeros(len(self.tests), dtype=int)
        every[chosen] = best
        return Found(every, value, chosen, optimum, self.objective.efficiency(value, optimum.value))

    def of_budget(self, budget: float) -> Found:
        """The best design that costs no more: ever more clockings of the balls are tried while they are worth their set-ups."""
        clockings = list(dict.fromkeys((test.work_ball_deg, test.tool_ball_deg) for test in self.tests))
        groups = {
            own: np.array([i for i, t in enumerate(self.tests) if (t.work_ball_deg, t.tool_ball_deg) == own]) for own in clockings
        }
        if budget / self.costs.circle > MOST_TESTS:
            raise InputError(
                f"budget must pay for at most {MOST_TESTS} circles, got {budget:g} with {self.costs.circle:g} each. Lower it."
            )
        best: Found | None = None
        used: list[tuple[float, float]] = []
        while (grown := self._grown(budget, used, clockings, groups, best)) is not None:
            best, used = grown
        if best is None:
            raise InputError(
                f"budget must pay for at least {self._levels} circle{'s' * (self._levels > 1)}, got {budget:g} with "
                f"{self.costs.circle:g} per circle. Raise it."
            )
        return best

    def _grown(
        self,
        budget: float,
        used: list[tuple[float, float]],
        clockings: Sequence[tuple[float, float]],
        groups: Mapping[tuple[float, float], Array],
        best: Found | None,
    ) -> tuple[Found, list[tuple[float, float]]] | None:
        """The best design with one more clocking, or two more where one is not worth its set-up; None if neither is."""
        left = [own for own in clockings if own not in used]
        for more in (1, 2):
            trials = []
            for further in islice(combinations(left, more), _MOST_TRIALS):
                own = [*used, *further]
                number = int(np.floor((budget - self.costs.setups(own)) / self.costs.circle * (1.0 + 1e-12)))
                if number < max(len(own), self._levels):
                    continue
                allowed = np.sort(np.concatenate([groups[pair] for pair in own]))
                value = optimal_shares(self._quick.among(allowed), float(number), tolerance=_ROUGH).value
                trials.append((value, own, number, allowed))
            if not trials:
                continue
            highest = max(trial[0] for trial in trials)
            _, own, number, allowed = next(t for t in trials if self.objective.efficiency(t[0], highest) >= _AS_GOOD)
            found = self.of_number(number, allowed, starts=_FEW_STARTS)
            if best is None or found.value > best.value:
                return found, own
        return None

    @staticmethod
    def _designs_to_start_from(share: Array, tests: int, rng: np.random.Generator, starts: int) -> list[Array]:
        """The rounded optimum, and draws from it and from all candidates in turn."""
        n = len(share)
        drawn = [np.bincount(rng.choice(n, tests, p=share if k % 3 else None), minlength=n) for k in range(1, starts)]
        return [efficient_rounding(share, tests), *drawn]
