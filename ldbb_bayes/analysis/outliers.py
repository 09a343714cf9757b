"""Does every test belong with the others? Each is compared with circles that the others expect in its place.

p-values are exact under the models compared: replicates come from p(y_r | y_−r), the models weighted by what the other tests
say of them; the distance of a circle is measured alike for readings and replicates, order by order, and the smallest p-value of
a test is judged by how small the replicates' smallest are. Over the tests the family-wise error is held by Holm's method, step by
step: a flagged test is taken out before the rest is looked at again, or it would make its neighbours look odd.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import special

from ldbb_bayes.campaign.campaign import Campaign, check_campaign
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.evidence import Evidences, Weighed, moments, probabilities
from ldbb_bayes.inference.leave_one_out import LeftOut, leave_one_out, replicate_left_out
from ldbb_bayes.inference.predictive import harmonics_of
from ldbb_bayes.jobs import one_blas_thread
from ldbb_bayes.model.fourier import MAX_ORDER, ORDERS
from ldbb_bayes.model.gaussian import holm
from ldbb_bayes.model.hybrid import HybridModel

__all__ = ["FALSE_ALARMS", "Dropped", "Outlier", "belonging", "dropped", "outliers"]

Array = NDArray[Any]
FALSE_ALARMS = 0.02
_REPLICATES = 20_000
_EACH = 400
_CLOSER, _TOGETHER, _MORE = 0.05, 5, 2
_SPARE = 1e-3


@dataclass(frozen=True)
class Outlier:
    """One test against what the others, flagged ones aside, expect.

    Attributes
    ----------
    p_value : float
        Probability that a circle of the same machine stands out so much in any Fourier order.
    family_wise_p_value : float
        Allowing for the number of tests (Holm).
    order_p_values : tuple of float
        Of orders 0 … 12, each by itself.
    worst_order : int
        Where it stands out most.
    flag : bool
        The family-wise p-value is below 2 %, and more than half of the tests agree without it. Two tests that disagree with one
        another have a small p-value both, and no flag: nothing says which of them is wrong.
    """

    p_value: float
    family_wise_p_value: float
    order_p_values: tuple[float, ...]
    worst_order: int
    flag: bool


@dataclass(frozen=True)
class Dropped:
    """A parameter without the test: mean and sd, and how far the mean moves in units of the sd with all tests."""

    mean: float
    sd: float
    shift: float


@one_blas_thread
def belonging(
    models: Mapping[str, HybridModel],
    campaign: Campaign,
    *,
    seed: int = 1,
    tolerance: float = 1e-2,
    replicates: int | None = None,
) -> pd.DataFrame:
    """Which tests do not belong with the others, under one or several models of a campaign of at least two tests.

    Parameters
    ----------
    models : mapping of name to HybridModel
        Weighted by what the other tests say of them.
    seed : int
        Of the replicates.
    tolerance : float
        Error of every log evidence [nat].
    replicates : int, optional
        Circles drawn in the place of each test; no p-value is smaller than one over their number. Default 20,000, more from 50
        tests on.

    Returns
    -------
    DataFrame
        One row per test: force_N, p_value, family_wise_p_value, flag, and order_0 … order_12, the p-values by Fourier order.

    Raises
    ------
    InputError
        For fewer than two tests, a plan, or an improper prior.
    """
    check_campaign(campaign)
    if not models:
        raise InputError("models must be at least one, got none. Give for example {'linear': HybridModel.default(1)}.")
    if replicates is not None and replicates < 1:
        raise InputError(f"replicates must be at least 1, got {replicates}. Leave it out for the default.")
    if len(campaign.tests) < 2:
        raise InputError("a campaign must have at least two tests to compare them, got one. Add tests.")
    evidences = Evidences(campaign, tolerance=tolerance)
    weighed = {name: evidences.of(model) for name, model in models.items()}
    left = {name: leave_one_out(one.posterior, one.evidence, tolerance=tolerance) for name, one in weighed.items()}
    found = outliers(weighed, left, seed=seed, tolerance=tolerance, replicates=replicates)
    rows = {
        test.name: {
            "force_N": test.force_N,
            "p_value": found[test.name].p_value,
            "family_wise_p_value": found[test.name].family_wise_p_value,
            "flag": found[test.name].flag,
            **{f"order_{n}": p for n, p in enumerate(found[test.name].order_p_values)},
        }
        for test in campaign.tests
    }
    return pd.DataFrame.from_dict(rows, orient="index")


def outliers(
    models: Mapping[str, Weighed],
    left: Mapping[str, Mapping[str, LeftOut]],
    *,
    seed: int,
    tolerance: float,
    replicates: int | None = None,
) -> dict[str, Outlier]:
    """Return every test against the others, from evidences at hand.

    Parameters
    ----------
    models : mapping of model to Weighed
    left : mapping of model to mapping of test to LeftOut
    """
    rng = np.random.default_rng(seed)
    names = list(next(iter(left.values())))
    size = replicates or max(_REPLICATES, _EACH * len(names))
    if (_MORE * size + 1) * FALSE_ALARMS <= len(names):
        least = int(len(names) / (FALSE_ALARMS * _MORE)) + 1
        raise InputError(
            f"replicates must be at least {least} to judge {len(names)} tests, got {size}. Leave them out for the default."
        )
    flagged: dict[str, Outlier] = {}
    while True:
        seen = {name: _against_the_others(models, left, name, size, rng) for name in names if name not in flagged}
        worst = min(seen, key=lambda name: (seen[name].p_value, -seen[name].distance))
        reached = max((own.family_wise_p_value for own in flagged.values()), default=0.0)
        family = max(reached, min(1.0, len(seen) * seen[worst].p_value))
        if family >= FALSE_ALARMS or 2 * (len(flagged) + 1) >= len(names):
            break
        flagged[worst] = seen[worst].judged(family, flag=True)
        models = {model: Weighed(own.posterior, own.lattice, own.evidence) for model, own in _without(worst, left).items()}
        left = {model: leave_one_out(one.posterior, one.evidence, tolerance=tolerance) for model, one in models.items()}
    adjusted = np.maximum(holm(np.array([own.p_value for own in seen.values()])), reached)
    rest = {name: own.judged(float(p), flag=False) for (name, own), p in zip(seen.items(), adjusted, strict=True)}
    return {name: (flagged | rest)[name] for name in names}


def dropped(weighed: Weighed, left: Mapping[str, LeftOut]) -> dict[str, dict[str, Dropped]]:
    """Return what every parameter becomes when a test is left out."""
    mean, sd = moments(weighed.posterior, weighed.lattice, spare=_SPARE)
    found = {}
    for name, without in left.items():
        other_mean, other_sd = moments(without.posterior, without.lattice, spare=_SPARE)
        rows = zip(weighed.posterior.bound.names, other_mean, other_sd, (other_mean - mean) / sd, strict=True)
        found[name] = {parameter: Dropped(float(m), float(s), float(shift)) for parameter, m, s, shift in rows}
    return found


@dataclass(frozen=True)
class _Seen:
    """p of a test as a whole and of every order, and its distance in the worst [−ln of a χ² tail]: it breaks ties of p."""

    p_value: float
    order_p_values: tuple[float, ...]
    worst_order: int
    distance: float

    def judged(self, family_wise_p_value: float, *, flag: bool) -> Outlier:
        return Outlier(self.p_value, family_wise_p_value, self.order_p_values, self.worst_order, flag)


def _without(name: str, left: Mapping[str, Mapping[str, LeftOut]]) -> dict[str, LeftOut]:
    return {model: by_test[name] for model, by_test in left.items()}


def _against_the_others(
    models: Mapping[str, Weighed], left: Mapping[str, Mapping[str, LeftOut]], name: str, size: int, rng: np.random.Generator
) -> _Seen:
    """One test against circles that the others expect in its place; a closer look where few lie as far out.

    Circles of one posterior draw lie out together, so that small p-values need many draws.
    """
    bound = next(iter(models.values())).posterior.bound
    r = bound.test_names.index(name)
    observed = harmonics_of(bound, r) @ np.asarray(bound.reduced[r].projection)
    without = _without(name, left)
    share = probabilities(np.array([own.evidence.log_value for own in without.values()]))

    def seen(size: int, each: int) -> _Seen:
        counts = np.round(share * size).astype(int)
        circles = [
            replicate_left_out(models[model].posterior.bound, own, int(count), rng, each=each)
            for (model, own), count in zip(without.items(), counts, strict=True)
            if count
        ]
        return _compared(observed, np.concatenate(circles))

    first = seen(size, _TOGETHER)
    return first if first.p_value > _CLOSER else seen(_MORE * size, 1)


def _compared(observed: Array, replicates: Array) -> _Seen:
    """Harmonics of a test, (25,), against those of replicates, (n, 25)."""
    n = len(replicates)
    centred, own = replicates - replicates.mean(axis=0), observed - replicates.mean(axis=0)
    p_own, p_replicates, distances = [], [], []
    for order in range(MAX_ORDER + 1):
        part = centred[:, order == ORDERS]
        root = np.linalg.cholesky(np.cov(part, rowvar=False).reshape(part.shape[1], -1))
        theirs, mine = _distance(part, root), _distance(own[None, order == ORDERS], root)[0]
        ordered = np.sort(theirs)
        p_own.append(float((1.0 + n - np.searchsorted(ordered, mine)) / (n + 1.0)))
        p_replicates.append((n - np.searchsorted(ordered, theirs)) / n)
        distances.append(0.5 * float(mine) if part.shape[1] == 2 else -float(special.log_ndtr(-np.sqrt(mine)) + np.log(2.0)))
    smallest = np.min(p_replicates, axis=0)
    return _Seen(
        float((1.0 + np.sum(smallest <= min(p_own))) / (n + 1.0)), tuple(p_own), int(np.argmax(distances)), max(distances)
    )


def _distance(harmonics: Array, root: Array) -> Array:
    """Squared Mahalanobis distance of (n, k), shape (n,)."""
    return np.asarray((np.linalg.solve(root, harmonics.T) ** 2).sum(axis=0))
