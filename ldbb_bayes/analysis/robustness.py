"""How the best design changes with what is assumed: the same number of tests designed under each assumption, and every design
judged under every assumption."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ldbb_bayes.analysis.space import DesignSpace
from ldbb_bayes.campaign.circular_test import CircularTest
from ldbb_bayes.model.hybrid import HybridModel

__all__ = ["default_assumptions", "robustness"]

Array = NDArray[Any]
_WORDS = {
    "kappa": "discrepancy",
    "tau": "ball form",
    "delta": "set-up shift",
    "delta_0": "set-up shift of order 0",
    "delta_1": "set-up shift of order 1",
}
_FACTORS = {"a half": 0.5, "twice": 2.0}
_SLOPES = {"a third": 1.0 / 3.0, "three times": 3.0}


def default_assumptions(space: DesignSpace) -> dict[str, tuple[HybridModel, Mapping[str, float]]]:
    """Discrepancy, ball form and set-up shift half and twice as large, slopes expected a third and three times as large, and no
    slopes where parameters of interest are left."""
    wanted = set(space.chosen)
    return {
        label: (model, factors)
        for label, (model, factors) in _assumptions(space.model)
        if wanted & set(model.bind(space.pilot).names)
    }


def _assumptions(model: HybridModel) -> Iterator[tuple[str, tuple[HybridModel, Mapping[str, float]]]]:
    for hyper, words in _WORDS.items():
        if hyper in model.hypers:
            for much, factor in _FACTORS.items():
                yield f"{words} {much}", (model, {hyper: factor})
    if model.degree and not model.prior.flat:
        for much, factor in _SLOPES.items():
            yield f"slopes {much}", (model.with_slope_scale(factor * model.prior.slope_scale), {})
    if model.degree:
        yield "constant compliance", (model.with_degree(0), {})


def robustness(space: DesignSpace, counts: Array, steps: Sequence[CircularTest]) -> pd.DataFrame:
    """Efficiency of the best design under each assumption, of the one good over all, and of equal steps, under each assumption.

    Parameters
    ----------
    space : DesignSpace
        With the assumptions.
    counts : ndarray of int, shape (candidates,)
        The design good over all.
    steps : sequence of CircularTest
        Equal steps of force.

    Returns
    -------
    DataFrame
        One row per design (its forces in column ``tests``), one column per assumption, and ``worst``.
    """
    number = int(counts.sum())
    best = {label: search.shares(float(number)).value for label, search in space.alone.items()}
    designs = {"good over all": counts}
    designs |= {
        f"best for: {label}": search.of_number(number, starts=1, thorough=False).counts for label, search in space.alone.items()
    }
    rows = {
        name: {
            label: search.objective.efficiency(search.objective.value(own.astype(float)), best[label])
            for label, search in space.alone.items()
        }
        | {"tests": _forces([t for t, n in zip(space.tests, own, strict=True) for _ in range(n)])}
        for name, own in designs.items()
    }
    rows["equal steps"] = {
        label: objective.efficiency(objective.value(np.ones(len(steps))), best[label])
        for label, objective in space.objectives(steps).items()
    } | {"tests": _forces(steps)}
    table = pd.DataFrame.from_dict(rows, orient="index")
    table[list(best)] = table[list(best)].clip(upper=1.0)
    table["worst"] = table[list(best)].min(axis=1)
    return table


def _forces(tests: Sequence[CircularTest]) -> str:
    return ", ".join(f"{test.force_N:.4g}" for test in sorted(tests, key=lambda test: float(test.force_N or 0.0)))
