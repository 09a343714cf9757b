"""The best shares of tests among candidates, and the certificate that they are the best (Kiefer and Wolfowitz 1960).

A share w_i of N tests goes to candidate i. The search keeps few candidates, solves for their shares, and adds those whose
sensitivity is above the bound until there are none; where the smallest eigenvalue is a multiple one, by cutting planes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from ldbb_bayes.analysis.optimal.criteria import SmallestEigenvalue
from ldbb_bayes.analysis.optimal.objective import Objective
from ldbb_bayes.errors import InputError

__all__ = ["Optimum", "certificate", "optimal_shares"]

Array = NDArray[Any]
_ROUNDS = 400
_ADDED = 3
_GONE = 1e-10
_UNDETERMINED = 1e6
_KINKED = 1e-5
_LOOSE, _TIGHT, _SLACK = 1e-5, 1e-15, 1e-3
_FRESH = 0.02
_ITERATIONS = 40
_NO_GAIN = 1e-13


@dataclass(frozen=True, eq=False)
class Optimum:
    """A design in shares.

    Attributes
    ----------
    share : ndarray, shape (candidates,)
        Sums to one.
    value : float
        Φ of N tests so shared.
    sensitivity : ndarray, shape (candidates,)
        N ∂Φ/∂n_i; nowhere above ``bound`` if this is the optimum.
    bound : float
        The mean of the sensitivity over the design.
    concave : bool
        Whether the certificate rules out every other design, or only those nearby.
    """

    share: Array
    value: float
    sensitivity: Array
    bound: float
    concave: bool

    @property
    def max_sensitivity(self) -> float:
        """The largest sensitivity of any candidate."""
        return float(self.sensitivity.max())

    @property
    def excess(self) -> float:
        """By how much it exceeds the bound, relative to it. For a concave Φ no design is better by more than bound · excess."""
        return float(self.max_sensitivity / self.bound - 1.0)


def certificate(objective: Objective, share: Array, tests: float) -> Optimum:
    """Value, sensitivities and bound of shares of N tests."""
    value, slope = objective.sensitivity(tests * share)
    return Optimum(share, value, tests * slope, float(tests * slope @ share), objective.concave)


def optimal_shares(objective: Objective, tests: float, *, tolerance: float = 1e-6, start: Array | None = None) -> Optimum:
    """The shares of N tests that make Φ largest.

    Parameters
    ----------
    tests : float
        N; the number of tests does not matter where the prior is flat.
    tolerance : float
        Relative excess of the largest sensitivity over the bound at which to stop; `Optimum.excess` says what was reached.
    start : ndarray, shape (candidates,), optional
        Shares to start from; default: equal.
    """
    found = _fully_corrective(objective, tests, tolerance, start)
    kinked = any(isinstance(case.criterion, SmallestEigenvalue) for case in objective.cases)
    if not kinked or found.excess <= tolerance:
        return found
    return _by_cutting_planes(objective, tests, max(tolerance, _KINKED), found)


def _fully_corrective(objective: Objective, tests: float, tolerance: float, start: Array | None) -> Optimum:
    """Shares of a few candidates solved for; candidates above the bound join them."""
    share = np.full(objective.candidates, 1.0 / objective.candidates) if start is None else start
    if not np.isfinite(objective.value(tests * share)):
        raise InputError(
            "the candidates must determine the parameters, got too few different ones. "
            "Offer more force levels, or use proper priors."
        )
    found = certificate(objective, share, tests)
    active = _few(found.sensitivity) if start is None else np.flatnonzero(share)
    slack, before = _LOOSE, -np.inf
    for _ in range(_ROUNDS):
        new = np.setdiff1d(_peaks(found.sensitivity, found.bound), active)
        if not len(new) and slack <= _TIGHT and found.value - before <= _NO_GAIN * abs(found.bound):
            break
        slack = slack if len(new) else _TIGHT
        active = np.concatenate([active, new])
        inner = _solve(objective.among(active), tests, share[active], slack)
        share = np.zeros(objective.candidates)
        share[active] = inner
        before, found = found.value, certificate(objective, share, tests)
        if found.excess <= tolerance:
            break
        active = active[inner > _GONE]
        slack = max(_TIGHT, min(slack, _SLACK * found.excess))
    return found


def _few(sensitivity: Array, size: int = 32) -> Array:
    """The candidates to begin with: spread over all, and the most sensitive."""
    n = len(sensitivity)
    spread = np.unique(np.linspace(0, n - 1, min(n, size)).astype(int))
    return np.union1d(spread, np.argsort(-sensitivity)[:_ADDED])


def _peaks(sensitivity: Array, bound: float) -> Array:
    """The candidates that are most above the bound."""
    order = np.argsort(-sensitivity)[:_ADDED]
    above = order[sensitivity[order] > bound]
    return above if len(above) else order[:1]


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
    found = minimize(
        loss,
        initial,
        jac=True,
        method="SLSQP",
        bounds=[(0.0, 1.0)] * n,
        constraints={"type": "eq", "fun": lambda x: x.sum() - 1.0, "jac": lambda x: np.ones((1, len(x)))},
        options={"ftol": slack, "maxiter": _ITERATIONS},
    )
    share = np.where(found.x > _GONE, found.x, 0.0)
    return np.asarray(share / share.sum())


def _by_cutting_planes(objective: Objective, tests: float, tolerance: float, smooth: Optimum) -> Optimum:
    """max Σ q_k t_k with t_k ≤ zᵀ M_k z for ever more z, the eigenvectors met: linear programs with exact cuts (Kelley 1960)."""
    n = objective.candidates
    weights = np.concatenate([w * case.weight for w, case in zip(objective.share, objective.cases, strict=True)])
    rows: list[Array] = []
    sides: list[float] = []
    share, best, best_value = smooth.share, smooth.share, smooth.value
    found: Any = None
    for _ in range(_ROUNDS):
        value = objective.value(tests * share)
        if value > best_value:
            best, best_value = share, value
        k = 0
        for case in objective.cases:
            precision = case.precision(tests * share)
            for own, prior, design in zip(precision, case.prior, case.rows, strict=True):
                z = _worst(own, case.interest)
                row = np.zeros(n + len(weights))
                row[:n] = -tests * ((design @ z) ** 2).sum(axis=1)
                row[n + k] = 1.0
                rows.append(row)
                sides.append(float(z @ prior @ z))
                k += 1
        cost = np.concatenate([np.zeros(n), -weights])
        equal = np.concatenate([np.ones(n), np.zeros(len(weights))])[None]
        found = scipy.optimize.linprog(
            cost, np.array(rows), np.array(sides), equal, [1.0], [(0.0, None)] * n + [(None, None)] * len(weights)
        )
        share = np.maximum(found.x[:n], 0.0)
        if -found.fun - best_value <= tolerance * abs(best_value):
            break
    # The multipliers of the cuts weigh the eigenvectors: with them the equivalence theorem holds at a kink too.
    sensitivity = found.ineqlin.marginals @ np.array(rows)[:, :n]
    known = float(-found.ineqlin.marginals @ np.array(sides))
    return Optimum(best, best_value, sensitivity, best_value - known, objective.concave)


def _worst(precision: Array, interest: int) -> Array:
    """z with zᵀ M z the smallest eigenvalue of the Schur complement."""
    s = interest
    nuisance, cross = precision[:-s, :-s], precision[:-s, -s:]
    back = -np.linalg.lstsq(nuisance, cross, rcond=None)[0] if len(nuisance) else np.zeros((0, s))
    schur = precision[-s:, -s:] + cross.T @ back
    vector = np.linalg.eigh(schur)[1][:, 0]
    return np.concatenate([back @ vector, vector])
