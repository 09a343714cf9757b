"""Does every test belong with the others? Each is compared with circles that the others expect in its place.

p-values are exact under the models compared: replicates come from p(y_r | y_−r), the models weighted by what the other tests
say of them; the distance of a circle is measured alike for readings and replicates, order by order, and the smallest p-value of
a test is judged by how small the replicates' smallest are. Over the tests the family-wise error is held by Holm's method.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.analysis.evidences import Weighed, probabilities
from ldbb_bayes.inference.leave_one_out import LeftOut, harmonics_of, replicate_left_out
from ldbb_bayes.inference.marginals import moments
from ldbb_bayes.model.basis import MAX_ORDER, ORDERS

__all__ = ["Belonging", "Dropping", "belonging", "dropping"]

Array = NDArray[Any]
FALSE_ALARMS = 0.05
_REPLICATES = 20_000
_SPARE = 1e-3


@dataclass(frozen=True)
class Belonging:
    """One test against what the others expect.

    Attributes
    ----------
    p_value : float
        Probability that a circle of the same machine stands out so much in any Fourier order.
    family_wise_p_value : float
        Allowing for the number of tests (Holm).
    order_p_values : tuple of float
        Of orders 0 … 12, each by itself.
    flag : bool
        The family-wise p-value is below 5 %.
    """

    p_value: float
    family_wise_p_value: float
    order_p_values: tuple[float, ...]
    flag: bool


@dataclass(frozen=True)
class Dropping:
    """A parameter without the test: mean and sd, and how far the mean moves in units of the sd with all tests."""

    mean: float
    sd: float
    shift: float


def belonging(
    models: Mapping[str, Weighed],
    left: Mapping[str, Mapping[str, LeftOut]],
    *,
    seed: int,
    prior: Array | None = None,
    replicates: int = _REPLICATES,
) -> dict[str, Belonging]:
    """Every test of a campaign with at least two.

    Parameters
    ----------
    models : mapping of model to Weighed
    left : mapping of model to mapping of test to LeftOut
    prior : ndarray, optional
        Prior probabilities of the models; equal by default.
    """
    rng = np.random.default_rng(seed)
    names = list(next(iter(left.values())))
    found = {}
    for name in names:
        share = probabilities(np.array([left[model][name].evidence.log_value for model in models]), prior)
        counts = np.round(share * replicates).astype(int)
        circles = [
            replicate_left_out(one.posterior.bound, left[model][name], int(count), rng)
            for (model, one), count in zip(models.items(), counts, strict=True)
            if count
        ]
        bound = next(iter(models.values())).posterior.bound
        r = bound.test_names.index(name)
        found[name] = _p_values(harmonics_of(bound, r) @ np.asarray(bound.reduced[r].projection), np.concatenate(circles))
    adjusted = _holm(np.array([p for p, _ in found.values()]))
    return {
        name: Belonging(p, float(family), orders, bool(family < FALSE_ALARMS))
        for (name, (p, orders)), family in zip(found.items(), adjusted, strict=True)
    }


def dropping(weighed: Weighed, left: Mapping[str, LeftOut]) -> dict[str, dict[str, Dropping]]:
    """What every parameter becomes when a test is left out."""
    mean, sd = moments(weighed.posterior, weighed.lattice, spare=_SPARE)
    found = {}
    for name, without in left.items():
        other_mean, other_sd = moments(without.posterior, without.lattice, spare=_SPARE)
        shift = (other_mean - mean) / sd
        found[name] = {
            parameter: Dropping(float(m), float(s), float(d))
            for parameter, m, s, d in zip(weighed.posterior.bound.names, other_mean, other_sd, shift, strict=True)
        }
    return found


def _p_values(observed: Array, replicates: Array) -> tuple[float, tuple[float, ...]]:
    """p of the test as a whole, and of every order; observed (25,), replicates (n, 25)."""
    n = len(replicates)
    centred, own = replicates - replicates.mean(axis=0), observed - replicates.mean(axis=0)
    p_own, p_replicates = [], []
    for order in range(MAX_ORDER + 1):
        part = centred[:, order == ORDERS]
        root = np.linalg.cholesky(np.cov(part, rowvar=False).reshape(part.shape[1], -1))
        distance = np.sort(_distance(part, root))
        p_own.append((1.0 + n - np.searchsorted(distance, _distance(own[None, order == ORDERS], root)[0])) / (n + 1.0))
        p_replicates.append((n - np.searchsorted(distance, _distance(part, root))) / n)
    smallest = np.min(p_replicates, axis=0)
    return float((1.0 + np.sum(smallest <= min(p_own))) / (n + 1.0)), tuple(float(p) for p in p_own)


def _distance(harmonics: Array, root: Array) -> Array:
    """Squared Mahalanobis distance of (n, k), shape (n,)."""
    return np.asarray((np.linalg.solve(root, harmonics.T) ** 2).sum(axis=0))


def _holm(p: Array) -> Array:
    """p-values that hold the family-wise error whatever the dependence (Holm 1979)."""
    order = np.argsort(p)
    stepped = np.minimum(np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1)), 1.0)
    adjusted = np.empty(len(p))
    adjusted[order] = stepped
    return adjusted
