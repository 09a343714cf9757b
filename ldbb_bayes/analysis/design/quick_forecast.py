"""Quick forecast of how far campaigns are from their goals.

φ are the hyper-parameters, such as the standard deviation of the noise. A candidate is a test that
could be run. Let G be the derivatives of its readings with respect to all coefficients, divided by
the standard deviation of the noise. The test adds the information GᵀG to the precision matrix of
the coefficients. G is computed once for every candidate, at K values of φ that are likely before
the campaign. A search can therefore compare thousands of campaigns, each within milliseconds. The
forecast assumes that φ is known, and that the noise has the same size in all circles; compliances
may be negative. The best campaigns are examined with `forecast_plan`, which does not make these
simplifications.

Let r_g = u_g/u*_g be the expected standard uncertainty of the parameter of goal g, divided by the
largest standard uncertainty that the goal permits. The distance of a campaign from its goals is the
mean over φ of ln max_g r_g. The distance is zero if the goals are just met. The maximum is replaced
by a smooth function of all r_g (log-sum-exp). The distance therefore also decreases if u_g
decreases for a goal g that does not have the largest r_g.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import logsumexp

from ldbb_bayes.analysis.design.candidates import VERY_MANY_REPETITIONS
from ldbb_bayes.analysis.design.goals import Goal
from ldbb_bayes.analysis.design.objective import Objective
from ldbb_bayes.analysis.design.states import States
from ldbb_bayes.analysis.design.ties import ascending_order
from ldbb_bayes.results import Array

__all__ = ["QuickForecast", "limits_of_goals"]

# The largest of the values r_g of several goals is approximated by (Σ r_g^s)^(1/s), where s is this
# number. For two equal values r_g, the result is 4 % too large.
_SHARPNESS = 16.0
# Largest number of passes of the search for a campaign. A campaign states how many circles of each
# candidate test are run. In each pass, the search goes through the candidates that are run, and
# tries to replace one circle of each by a circle of a better candidate.
_MOST_PASSES = 4
# Rounding errors must not decide which circle is the best. Distances from the goals that differ by
# at most this number are treated as equal, and the first of the candidates is chosen. An exchange
# of circles must reduce the distance by more than this number.
_LEAST_GAIN = 1e-9


def limits_of_goals(goals: Mapping[str, Goal], states: States, names: Sequence[str]) -> Array:
    """Return the largest standard uncertainty that each goal permits, shape (K, goals).

    A goal may be a percentage of the parameter, so that its limit depends on the machine.
    ``states`` holds the parameters of K possible machines, and ``names`` the names of these
    parameters. The limits are in internal units (mm, N, rad).
    """
    columns = []
    for name, goal in goals.items():
        columns.append(goal.limit_u(states.beta[:, list(names).index(name)]))
    return np.stack(columns, axis=1)


def _smallest(distances: Array) -> int:
    """Return the index of the smallest distance, the first if several distances are equal."""
    return int(ascending_order(distances, _LEAST_GAIN)[0])


class QuickForecast:
    """Forecast of how far a campaign is from the goals, at known hyper-parameters.

    A goal limits the standard uncertainty of a parameter. A campaign consists of candidate tests.
    The forecast is made for K values of the hyper-parameters.

    Parameters
    ----------
    objective
        Design objective with the information of the candidate tests about all coefficients, which
        are in units of their prior standard deviations. The parameters with goals come last.
    relative_limits
        Largest standard uncertainty that each goal permits, divided by the prior standard deviation
        of the goal's parameter, shape (K, goals).
    """

    def __init__(self, objective: Objective, relative_limits: Array) -> None:
        """Store the information of the candidate tests, and the limits of the goals."""
        self._rows = objective.rows
        self._prior = objective.prior
        self._limits = relative_limits
        self.candidates = objective.candidates

    def distance(self, counts: Array) -> float:
        """Return the distance of a campaign from its goals: about zero if the goals are just met.

        With several goals, it is slightly larger than zero, because the smooth maximum of ln r is
        slightly larger than the true maximum. ``counts``, shape (candidates,), is the campaign's
        number of circles of every candidate test.
        """
        variances = self._variances_of_goals(self._covariance(counts))
        return float(self._distance(variances))

    def distances(self, counts: Array) -> Array:
        """Return ln(u/u*) of every goal, averaged over the hyper-parameters, shape (goals,).

        ``counts`` holds, for every candidate test, the number of circles in the campaign, shape
        (candidates,).
        """
        variances = self._variances_of_goals(self._covariance(counts))
        return np.asarray(self._log_ratio(variances).mean(axis=0))

    def floor(self) -> Array:
        """Return ln(u/u*) of every goal if every candidate were run very often, shape (goals,)."""
        return self.distances(np.full(self.candidates, VERY_MANY_REPETITIONS))

    def best_counts(self, circles: int, start: Array) -> Array:
        """Return the number of circles of each candidate test in the best campaign.

        The best campaign has ``circles`` circles, and comes closest to the goals for uncertainties.

        Circles are added one by one. The circle added each time is the one that makes the distance
        from the goals for uncertainties smallest. Then one circle of each candidate test in the
        campaign is exchanged for a circle of the best candidate, if this reduces the distance.
        These exchanges are repeated until nothing changes, at most four times.

        Parameters
        ----------
        circles
            Number of circles.
        start
            Number of circles of every candidate test in the campaign to which circles are added,
            shape (candidates,). The sum is at most ``circles``.

        Returns
        -------
        Array
            Number of circles of every candidate test, whole numbers, shape (candidates,).
        """
        counts = start.copy()
        covariance = self._covariance(counts)
        while counts.sum() < circles:
            best = _smallest(self._distances_after(covariance))
            counts[best] += 1
            covariance = self._covariance(counts)
        distance = float(self._distance(self._variances_of_goals(covariance)))
        for _ in range(_MOST_PASSES):
            changed = False
            for candidate in np.flatnonzero(counts).tolist():
                counts[candidate] -= 1
                after = self._distances_after(self._covariance(counts))
                best = _smallest(after)
                if best != candidate and after[best] < distance - _LEAST_GAIN:
                    distance = float(after[best])
                    changed = True
                else:
                    best = candidate
                counts[best] += 1
            if not changed:
                break
        return counts

    def _covariance(self, counts: Array) -> Array:
        """Return the covariances of all p coefficients after a campaign, shape (K, p, p).

        There is one covariance matrix for each of K values of the hyper-parameters. ``counts``,
        shape (candidates,), holds the number of circles of each candidate test in the campaign.
        """
        support = np.flatnonzero(counts)
        rows = self._rows[:, support] * np.sqrt(counts[support])[:, None, None]
        stacked = rows.reshape(len(rows), -1, rows.shape[-1])
        precision = self._prior + np.swapaxes(stacked, -1, -2) @ stacked
        return np.asarray(np.linalg.inv(precision))

    def _variances_of_goals(self, covariance: Array) -> Array:
        """Return the variances of the goals' parameters, shape (K, goals).

        ``covariance``, shape (K, p, p), are the covariances of all p coefficients, at K values of
        the hyper-parameters. The goals' parameters are the last of these coefficients.
        """
        number = self._limits.shape[1]
        return np.asarray(np.einsum("kii->ki", covariance)[:, -number:])

    def _distances_after(self, covariance: Array) -> Array:
        """Return the distances from the goals after each possible circle, shape (candidates,).

        ``covariance``, shape (K, p, p), is the covariance Σ of all p coefficients before the
        circle, at K values of the hyper-parameters. Let G be the derivatives of a circle's readings
        with respect to the coefficients, divided by the standard deviation of the noise. The circle
        adds GᵀG to the precision matrix. After the circle, the covariance is therefore Σ − ΣGᵀ (1 +
        GΣGᵀ)⁻¹ GΣ. The function computes only the variances of the goals' parameters.
        """
        number = self._limits.shape[1]
        variances = []
        for rows, before in zip(self._rows, covariance, strict=True):
            spread = rows @ before
            readings = spread @ np.swapaxes(rows, -1, -2)
            readings[:, range(rows.shape[1]), range(rows.shape[1])] += 1.0
            of_goals = spread[..., -number:]
            gain = np.einsum("cmg,cmg->cg", of_goals, np.linalg.solve(readings, of_goals))
            variances.append(np.diag(before)[-number:] - gain)
        return self._distance(np.array(variances).swapaxes(0, 1))

    def _log_ratio(self, variances: Array) -> Array:
        """Return ln(u/u*) of every goal, at K values of the hyper-parameters φ.

        ``variances`` holds the values of u². It has the same shape as the result, (..., K, goals).
        """
        return np.asarray(0.5 * np.log(variances) - np.log(self._limits))

    def _distance(self, variances: Array) -> Array:
        """Return how far each campaign is from its goals, shape (...).

        ``variances`` are the variances u² at K values of φ, shape (..., K, goals). Further
        dimensions, written (...), stand for campaigns.
        """
        soft = logsumexp(_SHARPNESS * self._log_ratio(variances), axis=-1) / _SHARPNESS
        return np.asarray(soft.mean(axis=-1))
