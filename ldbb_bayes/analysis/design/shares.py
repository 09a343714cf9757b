"""Best shares of the candidate tests in a design, and a check that they are the best.

A candidate is a test that could be run, once or several times. N is the number of all runs. The
share of candidate i is n_i/N, where n_i is its number of runs and need not be whole. The criterion
Φ is the figure of merit of the design; it is largest for the best shares. The sensitivity of
candidate i is N ∂Φ/∂n_i, the derivative of Φ with respect to n_i, times N. The bound is the mean of
the sensitivities, weighted by the shares. For the best shares, no sensitivity exceeds the bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from ldbb_bayes.analysis.design.objective import Objective
from ldbb_bayes.analysis.design.ties import ascending_order
from ldbb_bayes.errors import InputError
from ldbb_bayes.results import Array, Shown

__all__ = ["Optimum", "certificate", "is_better", "largest_positions", "optimal_shares"]

# Rounding errors must not decide which of two candidates is better. Two values are therefore
# treated as equal if their relative difference is below this number. Among candidates with equal
# values, the first is chosen.
_EQUALITY_TOLERANCE = 1e-9
# Largest number of rounds in the optimization of the candidates' shares. A candidate is a test that
# could be run; its share is its number of runs divided by the number of all runs. Each round takes
# the candidates with a share above zero, adds a few others, and optimizes the shares of all of
# them.
_MAX_ROUNDS = 400
# The best shares of the candidate tests in a design are computed in rounds. This is the largest
# number of iterations of the solver SLSQP in each round.
_SOLVER_ITERATIONS = 40
# The best shares of the candidate tests in a design are computed in rounds. Each round adds at most
# this number of candidates to the candidates of the previous round.
_JOINING_CANDIDATES = 3
# Number of candidate tests whose shares are optimized in the first round. They are evenly spread
# over the list of all candidate tests. The share of a test is its number of runs divided by the
# number of all runs.
_FIRST_CANDIDATES = 32
# A candidate test is left out if its share is below this number. The share of a test is its number
# of runs divided by the number of all runs.
_ZERO_SHARE = 1e-10
# The share of a candidate test is its number of runs divided by the number of all runs. Before the
# solver starts, each share is raised to at least this number divided by the number of candidates
# whose shares are optimized. All shares are then divided by their sum.
_STARTING_SHARE = 0.02
# The solver SLSQP minimises the negative of the design criterion. It may try shares of the
# candidate tests with which the tests do not determine all parameters. The criterion cannot be
# computed for such shares, and the solver gets this large value instead.
_UNDETERMINED_LOSS = 1e6
# Tolerances of the solver SLSQP, which computes the best shares of the candidate tests in rounds.
# The first round uses ``_LOOSE_TOLERANCE``. The tolerance of a later round is at most
# ``_TOLERANCE_PER_EXCESS`` times `Optimum.excess`, which measures how far the shares are from the
# best shares. No tolerance is smaller than ``_TIGHT_TOLERANCE``.
_LOOSE_TOLERANCE = 1e-5
_TIGHT_TOLERANCE = 1e-15
_TOLERANCE_PER_EXCESS = 1e-3
# The best shares of tests are computed in rounds. The computation stops after a round that makes no
# progress, even if the required accuracy is not reached. A round makes no progress if no candidate
# can be added, the solver has its smallest tolerance, and the design criterion increases by at most
# this fraction of `Optimum.bound`.
_NO_GAIN = 1e-13


def largest_positions(values: Array, number: int = 1) -> NDArray[np.intp]:
    """Return the indices of the ``number`` largest values, the largest first.

    Values that differ only by rounding errors keep their order.
    """
    finite = values[np.isfinite(values)]
    tolerance = _EQUALITY_TOLERANCE * float(np.abs(finite).max(initial=0.0))
    return ascending_order(-values, tolerance)[:number]


def is_better(value: float, reference: float) -> bool:
    """Return whether a value of the design criterion exceeds ``reference`` noticeably.

    A difference that may be due to rounding errors alone does not count.
    """
    if not np.isfinite(reference):
        return bool(value > reference)
    return bool(value > reference + _EQUALITY_TOLERANCE * max(1.0, abs(reference)))


@dataclass(frozen=True, eq=False)
class Optimum(Shown):
    """Shares of candidate tests in a design of N tests, with the criterion Φ and its derivatives.

    A candidate is a test that could be run. Its share is its number of runs divided by N. The
    criterion Φ is the figure of merit of the design. The sensitivity of candidate i is N ∂Φ/∂n_i,
    where n_i is its number of runs. If the shares are optimal, no sensitivity exceeds the weighted
    mean of the sensitivities, in which each candidate's share is its weight.
    """

    #: share of each candidate test: its number of runs divided by the number of all runs, shape
    #: (candidates,); the sum is 1
    share: Array
    #: value Φ of the design criterion (figure of merit) for the shares ``share``
    value: float
    #: sensitivity of the design criterion to each candidate test, shape (candidates,): the
    #: derivative of the criterion with respect to the number of runs of this test, multiplied by
    #: the number of all runs
    sensitivity: Array
    #: mean of the derivatives ``sensitivity`` of the design criterion, weighted by ``share``; if
    #: the shares are optimal, no derivative exceeds this mean
    bound: float

    @property
    def excess(self) -> float:
        """Relative excess of the largest sensitivity over ``bound``; zero for the best shares.

        The sensitivity of a candidate test is the derivative of the design criterion with respect
        to its share; ``bound`` is the mean of the sensitivities, weighted by the shares. If the
        criterion is concave, no design with the same number of tests can exceed its present value
        by more than ``bound`` times ``excess``.
        """
        return float(self.sensitivity.max() / self.bound - 1.0)


def certificate(objective: Objective, share: Array, tests: float) -> Optimum:
    """Return the design criterion and the sensitivities of given shares of N tests.

    A candidate is a test that could be run, once or several times. Its share is its number of runs
    divided by N, the number of all runs.

    Parameters
    ----------
    objective
        Criterion Φ, the figure of merit, as a function of the number n_i of tests of each
        candidate i.
    share
        Share of each candidate, shape (candidates,); the sum is 1.
    tests
        Number N of tests.

    Returns
    -------
    Optimum
        The shares, the criterion Φ, the sensitivities and the bound. A sensitivity is the
        derivative of Φ with respect to n_i, times N. The bound is the mean of the sensitivities,
        weighted by the shares. The shares are the best if no sensitivity exceeds the bound (Kiefer
        and Wolfowitz 1960).
    """
    value, slope = objective.sensitivity(tests * share)
    return Optimum(share, value, tests * slope, float(tests * slope @ share))


def optimal_shares(objective: Objective, tests: float, *, tolerance: float = 1e-6) -> Optimum:
    """Return the shares of the candidate tests for which the design criterion Φ is largest.

    The criterion Φ is the figure of merit of a design of N tests. A candidate is a test that could
    be run, once or several times. Its share is its number of runs divided by N. Its sensitivity is
    N times the derivative of the criterion with respect to its number of tests. The bound is the
    mean of the sensitivities, weighted by the shares. The algorithm optimizes the shares of a few
    candidates, then adds candidates whose sensitivity exceeds the bound. These two steps are
    repeated, at most 400 times. They end when the largest sensitivity exceeds the bound by no more
    than the relative tolerance, or when the criterion no longer increases.

    Parameters
    ----------
    objective
        Criterion as a function of the number of runs of each candidate.
    tests
        Number N of tests. If the prior is flat, the best shares do not depend on N.
    tolerance
        Tolerance for `Optimum.excess`, the relative excess of the largest sensitivity over the
        bound. The shares are accepted when the excess is at most this number.

    Returns
    -------
    Optimum
        The shares, with the sensitivities and the bound that show how far they are from the best.

    Raises
    ------
    InputError
        If all candidates together do not determine the parameters.
    """
    n = objective.candidates
    share = np.full(n, 1.0 / n)
    if not np.isfinite(objective.value(tests * share)):
        raise InputError(
            "the candidates must determine the parameters, got too few different ones. Offer more"
            " force levels, or use proper priors."
        )
    optimum = certificate(objective, share, tests)
    spread = np.unique(np.linspace(0, n - 1, min(n, _FIRST_CANDIDATES)).astype(int))
    active = np.union1d(spread, largest_positions(optimum.sensitivity, _JOINING_CANDIDATES))
    solver_tolerance = _LOOSE_TOLERANCE
    previous_value = -np.inf
    for _ in range(_MAX_ROUNDS):
        joining = np.setdiff1d(_candidates_above_bound(optimum), active)
        if not len(joining):
            gain = optimum.value - previous_value
            if solver_tolerance <= _TIGHT_TOLERANCE and gain <= _NO_GAIN * abs(optimum.bound):
                break
            solver_tolerance = _TIGHT_TOLERANCE
        active = np.concatenate([active, joining])
        active_share = _solve_shares(
            objective.among(active), tests, share[active], solver_tolerance
        )
        share = np.zeros(n)
        share[active] = active_share
        previous_value = optimum.value
        optimum = certificate(objective, share, tests)
        if optimum.excess <= tolerance:
            break
        active = active[active_share > _ZERO_SHARE]
        needed_tolerance = min(solver_tolerance, _TOLERANCE_PER_EXCESS * optimum.excess)
        solver_tolerance = max(_TIGHT_TOLERANCE, needed_tolerance)
    return optimum


def _candidates_above_bound(optimum: Optimum) -> NDArray[np.intp]:
    """Return the indices of the candidates with the largest sensitivities above the bound.

    A candidate is a test that could be run; its share is its number of runs divided by the number
    of all runs. The sensitivity of a candidate is the derivative of the design criterion with
    respect to its share. The bound is the mean of the sensitivities, weighted by the shares. The
    sensitivities and the bound are attributes of ``optimum``. At most ``_JOINING_CANDIDATES``
    indices are returned. If no sensitivity is above the bound, the index of the candidate with the
    largest sensitivity is returned.
    """
    highest = largest_positions(optimum.sensitivity, _JOINING_CANDIDATES)
    above = highest[optimum.sensitivity[highest] > optimum.bound]
    if len(above):
        return above
    return highest[:1]


def _solve_shares(objective: Objective, tests: float, start: Array, tolerance: float) -> Array:
    """Return the shares of a few candidates that maximise the criterion, shape (candidates,).

    ``objective`` gives the design criterion as a function of the numbers of tests of these
    candidates, and ``tests`` is the number of all tests. Shares are not negative and sum to one.
    The solver SLSQP starts from the shares ``start``, shape (candidates,). It maximises the
    criterion divided by a typical value of its derivatives with respect to the shares.
    ``tolerance`` is the solver's tolerance for this ratio.
    """
    n = objective.candidates
    if n == 1:
        return np.ones(1)
    initial = np.maximum(start, _STARTING_SHARE / n)
    initial /= initial.sum()
    scale = abs(objective.sensitivity(tests * initial)[1] @ initial) * tests

    def loss(share: Array) -> tuple[Any, Any]:
        """Return the negative design criterion and its derivatives, all divided by ``scale``."""
        try:
            value, slope = objective.sensitivity(tests * np.maximum(share, 0.0))
        except np.linalg.LinAlgError:
            return _UNDETERMINED_LOSS, np.zeros(n)
        return -value / scale, -tests * slope / scale

    def sum_minus_one(share: Array) -> Any:
        """Return the sum of the candidates' shares minus one, which the solver keeps at zero."""
        return share.sum() - 1.0

    def gradient_of_sum(share: Array) -> Array:
        """Return n ones: the derivative of the sum of n shares with respect to each share."""
        return np.ones((1, len(share)))

    minimize: Any = optimize.minimize
    solution = minimize(
        loss,
        initial,
        jac=True,
        method="SLSQP",
        bounds=[(0.0, 1.0)] * n,
        constraints={"type": "eq", "fun": sum_minus_one, "jac": gradient_of_sum},
        options={"ftol": tolerance, "maxiter": _SOLVER_ITERATIONS},
    ).x
    share = np.where(solution > _ZERO_SHARE, solution, 0.0)
    return np.asarray(share / share.sum())
