"""P(P(change | η_1..η_{m+N}) > threshold for some N ≤ N*), η_t = Λ̄ (c + Δ e_j 1[t > m] + w_t, b) + N(0, Λ̄): how soon it is found.

Series to come are simulated as their statistics, m campaigns without a change and then those after it, all as informative as the
campaigns so far on average. A change moves every statistic by an amount that is known, so that all parameters share the noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.fleet.change import Series, carry, scatter_rule

__all__ = ["SURE", "Detection", "detection"]

Array = NDArray[Any]
SURE = 0.9
_COARSE = 0.35


@dataclass(frozen=True, eq=False)
class Detection:
    """How soon changes would be found.

    Attributes
    ----------
    changes : ndarray, shape (p,)
        In units of the prior's sd; NaN where there is none to ask for.
    found : ndarray, shape (p, N)
        Probability that the change has been found after 1..N further campaigns; NaN likewise.
    false_alarm : ndarray, shape (N,)
        That some change has been said to be there while nothing changed.
    before : int
        Campaigns before the change.
    replicates : int
        Simulated series that probabilities are counted in.
    """

    changes: Array
    found: Array
    false_alarm: Array
    before: int
    replicates: int

    def error(self, probability: Array) -> Array:
        """Standard error of counting, never less than that of half a count."""
        share = np.clip(probability, 0.5 / self.replicates, 1.0 - 0.5 / self.replicates)
        return np.where(np.isnan(probability), np.nan, np.sqrt(share * (1.0 - share) / self.replicates))

    def campaigns(self, parameter: int) -> int | None:
        """The least number of further campaigns that finds it with probability 0.9; None where more are needed than looked at."""
        enough = np.flatnonzero(self.found[parameter] >= SURE)
        return int(enough[0]) + 1 if len(enough) else None


def detection(
    information: Array,
    parameters: int,
    level: Array,
    changes: Array,
    *,
    before: int,
    scatter: tuple[Array, Array],
    change_scale: float,
    repeatability: float,
    probability: float,
    threshold: float,
    further: int = 12,
    replicates: int = 400,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Detection:
    """Simulate series to come, and look at each after every further campaign.

    Parameters
    ----------
    information : ndarray, shape (q, q)
        Λ̄ of one campaign, in units of the prior's sd.
    parameters : int
    level : ndarray, shape (q,)
        c and b, what they are now.
    changes : ndarray, shape (p,)
        Δ of each parameter; NaN leaves it out.
    before : int
        Campaigns before the change, at least one.
    scatter : tuple of ndarray
        Values of r and their probabilities, from which series are drawn; the analysis weighs r by its prior.
    further : int
    replicates : int
        Those that give a false alarm before the change are left out of the counts.
    """
    rng = np.random.default_rng(seed)
    p, n = parameters, before + further
    r = rng.choice(scatter[0], size=replicates, p=scatter[1] / scatter[1].sum())
    values, vectors = np.linalg.eigh(information)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    z = np.tile(level, (replicates, n, 1))
    z[:, :, :p] += r[:, None, None] * rng.standard_normal((replicates, n, p))
    weighted = z @ information + rng.standard_normal(z.shape) @ root.T
    known = np.flatnonzero(np.isfinite(changes))
    shifts = np.concatenate([np.zeros((1, len(level))), changes[known, None] * information[known]])
    looks = _Looks(information, p, scatter_rule(repeatability, step=_COARSE), change_scale, probability)
    alarm = np.zeros((further + 1, len(shifts), replicates), dtype=bool)
    for count in range(further + 1):
        if before + count > 1:
            alarm[count] = looks.change(weighted[:, : before + count], shifts, count) > np.log(threshold / (1.0 - threshold))
        if progress is not None:
            progress(count + 1, further + 1)
    fresh = ~alarm[0, 0]
    if not fresh.any():
        fresh[:] = True
    share = np.logical_or.accumulate(alarm[1:], axis=0)[:, :, fresh].mean(axis=2)
    found = np.full((p, further), np.nan)
    found[known] = share[:, 1:].T
    return Detection(changes, found, share[:, 0], before, int(fresh.sum()))


class _Looks:
    """Log odds of a change for many series of equally informative campaigns."""

    def __init__(
        self, information: Array, parameters: int, rule: tuple[Array, Array], change_scale: float, probability: float
    ) -> None:
        q = len(information)
        nodes, self._weight = rule
        self._scale, self._probability, self._p = change_scale, probability, parameters
        carried = carry(Series(information[None], np.zeros((1, q)), parameters), nodes)
        self._information, self._log_constant = carried.information[:, 0], carried.log_constant[:, 0]
        square = np.zeros((len(nodes), q))
        square[:, :parameters] = nodes[:, None] ** 2
        self._take = np.linalg.inv(np.eye(q) + information * square[:, None, :])
        self._gain = square[:, :, None] * self._take

    def change(self, weighted: Array, shifts: Array, moved: int) -> Array:
        """Log odds of a change, shape (shifts, series); the last ``moved`` campaigns of each are moved by a shift.

        Parameters
        ----------
        weighted : ndarray, shape (series, t, q)
        shifts : ndarray, shape (shifts, q)
        """
        series, n, q = weighted.shape
        p, after = self._p, np.arange(n - 1, 0, -1)
        log_step = np.log(self._probability / (1.0 - self._probability) / ((n - 1) * p))
        sums = np.cumsum(weighted[:, ::-1], axis=1)[:, ::-1]
        total = sums[:, 0] + moved * shifts[:, None]
        late = sums[:, n - moved] if moved else np.zeros((series, q))
        changed, none = (np.full((len(shifts), series), -np.inf) for _ in range(2))
        for i, weight in enumerate(self._weight):
            information, take, gain = self._information[i], self._take[i], self._gain[i]
            system = np.eye(q) + n * information
            reduced = np.linalg.solve(system, information[:, :p]).T
            precision = after[:, None] * np.diag(information)[:p] - after[:, None] ** 2 * np.diag(reduced @ information[:, :p])
            shrunk = self._scale**2 / (1.0 + self._scale**2 * np.maximum(precision, 0.0))
            fitted = total @ take.T
            own = 0.5 * np.einsum("msq,qr,msr->ms", fitted, np.linalg.inv(system), fitted)
            own += 0.5 * np.einsum("stq,qr,str->s", weighted, gain, weighted, optimize=True) + n * self._log_constant[i]
            own += shifts @ gain @ late.T + 0.5 * moved * np.einsum("mq,qr,mr->m", shifts, gain, shifts)[:, None]
            own += np.log(weight) - 0.5 * np.linalg.slogdet(system)[1]
            none = np.logaddexp(none, own)
            push = sums[:, 1:] @ take[:p].T
            for m, shift in enumerate(shifts):
                steps = push + np.minimum(after, moved)[:, None] * (take[:p] @ shift)
                steps -= after[:, None] * (fitted[m] @ reduced.T)[:, None]
                log_ratio = 0.5 * (shrunk * steps**2 + np.log(shrunk / self._scale**2)).reshape(series, -1)
                top = log_ratio.max(axis=1)
                whole = top + np.log(np.exp(log_ratio - top[:, None]).sum(axis=1))
                changed[m] = np.logaddexp(changed[m], own[m] + whole)
        return changed + log_step - none
