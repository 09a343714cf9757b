"""ln p(y) of the recovered experiment from nodes, from nested sampling and by a bridge from draws
of NUTS."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from nuts import ReducedNuts
from peer_evidence import Estimate, bridged_log_evidence, nested_log_evidence
from reduced_density import ReducedDensity
from setting import Clocked, Size, clocked, has, recovered, say, spread

import ldbb_bayes as lb
from ldbb_bayes.model.hybrid import BoundModel

__all__ = ["evidence_rows"]


@dataclass(frozen=True)
class Method:
    """A way to the evidence: ``estimate(seed)`` is run ``repeats`` times."""

    name: str
    repeats: int
    estimate: Callable[[int], Estimate]


def evidence_rows(size: Size) -> list[dict[str, Any]]:
    """A row for every degree, with truncation and without, and way to the evidence."""
    rows = []
    for degree in size.degrees:
        for truncated in (False, True):
            model = lb.HybridModel.first(degree)
            if not truncated:
                model = model.without("truncation")
            for row in rows_of_model(model, truncated=truncated):
                rows.append({"degree": degree, "truncated": truncated, **row})
                say(
                    f"evidence, degree {degree}, {row['way']}:"
                    f" {row['value']:.4f} ± {row['error']:.4f}"
                )
    return rows


def rows_of_model(model: lb.HybridModel, *, truncated: bool) -> list[dict[str, Any]]:
    """The evidence of one model by all ways that are installed, the nodes first."""
    rows: list[dict[str, Any]] = []
    by_nodes: Estimate | None = None
    for method in methods_of_evidence(model, truncated=truncated):
        estimates = []
        times = []
        for seed in range(1, method.repeats + 1):
            estimate, took = clocked(method.estimate, seed)
            estimates.append(estimate)
            times.append(took)
        if by_nodes is None:
            by_nodes = estimates[0]
        rows.append(
            {
                "way": method.name,
                "value": estimates[0].log_evidence,
                "error": estimates[0].error,
                "apart": difference_in_errors(estimates[0], by_nodes),
                "runs": method.repeats,
                **spread_of_times(times),
            }
        )
    return rows


def methods_of_evidence(model: lb.HybridModel, *, truncated: bool) -> list[Method]:
    """Nodes, and the peers that are installed, compiled."""
    bound = model.bind(recovered())
    methods = [Method("nodes", 5, partial(estimate_by_nodes, model))]
    if has("dynesty") and has("jax"):
        density = ReducedDensity(bound)
        density.prepare()
        methods.append(Method("dynesty", 1, partial(estimate_by_nesting, density)))
    if has("numpyro") and not truncated:
        nuts = ReducedNuts(bound, whitened=True)
        nuts.prepare()
        methods.append(Method("bridge on NUTS", 3, partial(estimate_by_bridge, bound, nuts)))
    return methods


def estimate_by_nodes(model: lb.HybridModel, seed: int) -> Estimate:
    """Nothing is random that a seed could change."""
    evidence = lb.log_evidence(model, recovered())
    return Estimate(evidence.log_value, evidence.error)


def estimate_by_nesting(density: ReducedDensity, seed: int) -> Estimate:
    """By nested sampling."""
    return nested_log_evidence(density, seed=seed)


def estimate_by_bridge(bound: BoundModel, nuts: ReducedNuts, seed: int) -> Estimate:
    """By a bridge; the run of NUTS that it stands on is included."""
    return bridged_log_evidence(bound, nuts.run(seed), seed=seed)


def difference_in_errors(estimate: Estimate, reference: Estimate) -> float:
    """Absolute difference in standard errors of both."""
    difference = abs(estimate.log_evidence - reference.log_evidence)
    return difference / float(np.hypot(estimate.error, reference.error))


def spread_of_times(times: list[Clocked]) -> dict[str, dict[str, float]]:
    """Median and quartiles of the seconds of processor and clock."""
    return {
        "cpu": spread([took.cpu for took in times]),
        "wall": spread([took.wall for took in times]),
    }
