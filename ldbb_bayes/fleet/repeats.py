"""Do the campaigns of one machine agree? a_i = A_i c + B_i b + N(0, A_i) with one c for all of them, whatever it is: χ².

A machine that changed between campaigns has a sum of campaigns that is sure of something none of them says.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from ldbb_bayes.fleet.belonging_machines import holm
from ldbb_bayes.fleet.statistics import FleetStatistics

__all__ = ["changed_machines", "repeat_p_values"]

Array = NDArray[Any]
_FALSE_ALARMS, _SEEN = 0.01, 1e-6


def repeat_p_values(statistics: FleetStatistics, mean: Array, covariance: Array) -> dict[str, float]:
    """p of every machine with at least two campaigns.

    Parameters
    ----------
    mean, covariance : ndarray, shapes (s,) and (s, s)
        Of the instrument's errors b, in units of their prior sd, as all campaigns know them.
    """
    c = len(statistics.parameters)
    scale = np.concatenate([statistics.prior_sd, statistics.instrument_sd])
    of: dict[str, list[int]] = {}
    for place, name in enumerate(statistics.machines):
        of.setdefault(name, []).append(place)
    found = {}
    for name, places in of.items():
        if len(places) < 2:
            continue
        seen, left = [], []
        for i in places:
            rows = (statistics.information[i] * scale[:, None] * scale)[:c]
            values, vectors = np.linalg.eigh(rows[:, :c])
            told = values > _SEEN
            whiten = (vectors[:, told] / np.sqrt(values[told])).T
            seen.append(whiten @ rows)
            left.append(whiten @ (statistics.weighted[i] * scale)[:c] - whiten @ rows[:, c:] @ mean)
        design = np.concatenate(seen)
        root = np.linalg.cholesky(np.eye(len(design)) + design[:, c:] @ covariance @ design[:, c:].T)
        own, reading = np.linalg.solve(root, design[:, :c]), np.linalg.solve(root, np.concatenate(left))
        best, _, rank, _ = np.linalg.lstsq(own, reading, rcond=1e-10)
        freedom = len(design) - int(rank)
        found[name] = float(chdtrc(freedom, np.sum((reading - own @ best) ** 2))) if freedom > 0 else 1.0
    return found


def changed_machines(statistics: FleetStatistics, mean: Array, covariance: Array) -> list[str]:
    """Machines whose campaigns contradict one another: family-wise p (Holm) below 1 %."""
    p = repeat_p_values(statistics, mean, covariance)
    family = holm(np.array(list(p.values()))) if p else np.zeros(0)
    return [name for name, own in zip(p, family, strict=True) if own < _FALSE_ALARMS]
