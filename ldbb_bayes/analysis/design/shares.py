"""TODO: say what this module is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.analysis.design.objective import Objective
from ldbb_bayes.errors import InputError
from ldbb_bayes.results import Array, Shown

# Values that differ by less, relative to the largest, count as equal: the first of them in the
# candidates' order is taken.
_EQUAL = 1e-9


_ROUNDS = 400


_ITERATIONS = 40


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
