"""Find tests that do not belong with the others.

Does every test belong with the others? Each is compared with circles that the others expect in its
place. p-values are exact under the models compared: replicates come from p(y_r | y_−r), the models
weighted by what the other tests say of them; the distance of a circle is measured alike for
readings and replicates, order by order, and the smallest p-value of a test is judged by how small
the replicates' smallest are. Over the tests the family-wise error is held by Holm's method, step by
step: a flagged test is taken out before the rest is looked at again, or it would make its
neighbours look odd.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy import special

from ldbb_bayes.analysis.multiple_testing import holm
from ldbb_bayes.campaign.campaign import Campaign, check_campaign
from ldbb_bayes.errors import require
from ldbb_bayes.inference.evidence import (
    Evidences,
    leave_one_out,
    probabilities,
)
from ldbb_bayes.inference.nodes import Nodes
from ldbb_bayes.inference.prediction import replicate_left_out
from ldbb_bayes.inference.residuals import harmonics_of
from ldbb_bayes.model.fourier import MAX_ORDER, ORDERS
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, readable

__all__ = ["FALSE_ALARMS", "Outlier", "belonging", "outliers"]


FALSE_ALARMS = 0.02  # of which a test is flagged, over all tests


_REPLICATES = 20_000


_EACH = 400


_CLOSER = 0.05


_TOGETHER = 5


_MORE = 2


_FEWER_TOGETHER = 2


@dataclass(frozen=True)
class Outlier:
    """One test against what the others, flagged ones aside, expect. Two tests that disagree with
    one another have a small p-value both, and no flag: nothing says which of them is wrong."""

    # probability that a circle of the same machine stands out so much in any Fourier order
    p_value: float
    family_wise_p_value: float  # the same, allowing for all tests (Holm)
    order_p_values: tuple[float, ...]  # of orders 0 … 12, each by itself
    worst_order: int
    # the family-wise p-value is below 2 %, and more than half of the tests agree without it
    flag: bool
    distance: float  # in the worst order [−ln of a χ² tail]; it breaks ties of p


@one_blas_thread
def belonging(
    models: Mapping[str, HybridModel],
    campaign: Campaign,
    *,
    seed: int = 1,
    tolerance: float = 1e-2,
    replicates: int | None = None,
) -> pd.DataFrame:
    """Which tests do not belong with the others, under one or several models of a campaign of at
    least two tests.

    InputError for fewer than two tests, a plan, or an improper prior.

    Parameters
    ----------
    models : mapping of name to HybridModel
        Weighted by what the other tests say of them.
    seed : of the replicates.
    tolerance : error of every log evidence [nat].
    replicates : circles drawn in the place of each test; no p-value is below one over their number.
        Default 20,000, or more.

    Returns
    -------
    One row per test: force_N, p_value, family_wise_p_value, flag, and order_0 … order_12, the
    p-values by Fourier order.
    """
    check_campaign(campaign)
    require(
        len(campaign.tests) > 1,
        "a campaign must have at least two tests to compare them, got one. Add tests.",
    )
    least = int(len(campaign.tests) / (_MORE * FALSE_ALARMS)) + 1
    few = replicates is not None and replicates < least
    require(
        not few,
        f"replicates must be at least {least} to judge {len(campaign.tests)} tests, got"
        f" {replicates}. Leave them out.",
    )
    evidences = Evidences(campaign, tolerance=tolerance)
    weighed = dict(zip(models, evidences.of(*models.values()), strict=True))
    left = leave_one_out(weighed, tolerance=tolerance)
    judged = outliers(weighed, left, seed=seed, tolerance=tolerance, replicates=replicates)
    rows = {}
    for test in campaign.tests:
        own = judged[test.name]
        seen = {
            "force_N": test.force_N,
            "p_value": own.p_value,
            "family_wise_p_value": own.family_wise_p_value,
            "flag": own.flag,
        }
        rows[test.name] = seen | {f"order_{n}": p for n, p in enumerate(own.order_p_values)}
    return readable(pd.DataFrame.from_dict(rows, orient="index"), "Which tests do not belong")


def outliers(
    models: Mapping[str, Nodes],
    left: Mapping[str, Mapping[str, Nodes]],
    *,
    seed: int,
    tolerance: float,
    replicates: int | None = None,
) -> dict[str, Outlier]:
    """Return every test against the others, from the nodes of all tests by model, and of all but
    one by model and test."""
    rng = np.random.default_rng(seed)
    names = next(iter(models.values())).bound.test_names
    size = replicates or max(_REPLICATES, _EACH * len(names))
    flagged: dict[str, Outlier] = {}
    reached = 0.0
    while True:
        rest = {
            name: _against_the_others(models, left, name, size, rng)
            for name in names
            if name not in flagged
        }
        worst = min(rest, key=lambda name: (rest[name].p_value, -rest[name].distance))
        family = max(reached, min(1.0, len(rest) * rest[worst].p_value))
        if family >= FALSE_ALARMS or 2 * (len(flagged) + 1) >= len(names):
            break
        flagged[worst], reached = (
            replace(rest[worst], family_wise_p_value=family, flag=True),
            family,
        )
        models = {model: by_test[worst] for model, by_test in left.items()}
        left = leave_one_out(models, tolerance=tolerance)
    adjusted = np.maximum(holm(np.array([own.p_value for own in rest.values()])), reached)
    rest = {
        name: replace(own, family_wise_p_value=float(p))
        for (name, own), p in zip(rest.items(), adjusted, strict=True)
    }
    return {name: (flagged | rest)[name] for name in names}


def _against_the_others(
    models: Mapping[str, Nodes],
    left: Mapping[str, Mapping[str, Nodes]],
    name: str,
    size: int,
    rng: np.random.Generator,
) -> Outlier:
    """One test against circles that the others expect in its place; a closer look where few lie as
    far out. Circles of one posterior draw lie out together, so that small p-values need many
    draws."""
    bound = next(iter(models.values())).bound
    r = bound.test_names.index(name)
    observed = harmonics_of(bound, r) @ np.asarray(bound.reduced[r].projection)
    share = probabilities(np.array([by_test[name].evidence.log_value for by_test in left.values()]))

    def seen(size: int, each: int) -> Outlier:
        counts = np.round(share * size).astype(int)
        circles = [
            replicate_left_out(nodes.bound, left[model][name], name, int(count), rng, each=each)
            for (model, nodes), count in zip(models.items(), counts, strict=True)
            if count
        ]
        return _compared(observed, np.concatenate(circles))

    first = seen(size, _TOGETHER)
    return first if first.p_value > _CLOSER else seen(_MORE * size, _FEWER_TOGETHER)


def _compared(observed: Array, replicates: Array) -> Outlier:
    """Harmonics of a test, (25,), against those of replicates, (n, 25), other tests not yet allowed
    for."""
    n = len(replicates)
    centred = replicates - replicates.mean(axis=0)
    own = observed - replicates.mean(axis=0)
    nearer = []
    distances = []
    every = []
    for order in range(MAX_ORDER + 1):
        part = centred[:, order == ORDERS]
        root = np.linalg.cholesky(np.cov(part, rowvar=False).reshape(part.shape[1], -1))
        theirs = _distance(part, root)
        mine = _distance(own[None, order == ORDERS], root)[0]
        nearer.append(int(np.sum(theirs < mine)))
        every.append(theirs)
        distances.append(
            0.5 * float(mine)
            if part.shape[1] == 2
            else -float(special.log_ndtr(-np.sqrt(mine)) + np.log(2.0))
        )
    # Replicates that have in any order as many of the others nearer as the test has in its worst.
    most = max(nearer)
    edge = np.partition(every, most - 1, axis=1)[:, most - 1, None] if most else -np.inf
    further = (np.array(every) > edge).any(axis=0)
    p_value, *p_order = (
        (1.0 + k) / (n + 1.0) for k in (int(further.sum()), *(n - k for k in nearer))
    )
    return Outlier(p_value, 1.0, tuple(p_order), int(np.argmax(distances)), False, max(distances))


def _distance(harmonics: Array, root: Array) -> Array:
    """Squared Mahalanobis distance of (n, k), shape (n,)."""
    return np.asarray((np.linalg.solve(root, harmonics.T) ** 2).sum(axis=0))
