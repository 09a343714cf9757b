"""Effective draws per second: the package's samplers beside NUTS, all in turn."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import arviz_stats.base
import numpy as np
import pandas as pd
from nuts import NUTS, ReducedNuts
from setting import (
    MODEL,
    SAMPLERS,
    UNTRUNCATED,
    Array,
    Clocked,
    Size,
    clocked,
    has,
    say,
    spread,
)

import ldbb_bayes as lb
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.sample import run_sampler
from ldbb_bayes.model.hybrid import BoundModel

__all__ = ["bulk_ess", "race", "sampler_draws"]

# What is measured of every run of a runner, and the ratios of it to the best NUTS.
COLUMNS = ("cpu", "wall", "min_bulk_ess", "per_cpu", "per_wall", "worst_mean_z", "worst_sd_error")
WORST = ("worst_mean_z", "worst_sd_error")
RATIOS = {"cpu_ratio": "per_cpu", "wall_ratio": "per_wall"}

Rows = Mapping[str, Mapping[str, list[float]]]


@dataclass(frozen=True)
class Runner:
    """A way to the posterior.

    ``run(seed)`` returns a chain (chains, draws, p + h) in mm, N, rad; ``compilation`` is the CPU
    seconds that compiling took.
    """

    truncated: bool
    call: str
    target: float | None
    run: Callable[[int], Array]
    compilation: float = 0.0


def sampler_draws(bound: BoundModel, sampler: str, ess: float, seed: int) -> Array:
    """From the bound model to the draws: search for the modes, nodes, proposals, burn-in and
    diagnostics included."""
    start = HyperPosterior(bound, truncated=bound.truncation.active, seed=seed)
    rule = lb.inference.StoppingRule(ess=ess)
    draws = run_sampler(sampler, start, rule=rule, seed=np.random.SeedSequence(seed))
    return np.concatenate([draws.beta, draws.phi], axis=2)


def whole_sample(model: lb.HybridModel, campaign: lb.Campaign, sampler: str, seed: int) -> Array:
    """`lb.sample` at its defaults, all that it computes included."""
    posterior = lb.sample(model, campaign, sampler=sampler, seed=seed)["posterior"]
    bound = model.bind(campaign)
    names = (*bound.names, *bound.hyper_prior.names)
    return np.stack([posterior[str(name)].to_numpy() for name in names], axis=-1)


def runners(campaign: lb.Campaign, size: Size, *, lb_sample: bool) -> dict[str, Runner]:
    """The package's samplers with truncation and without, those of NUTS that are installed;
    ``lb_sample``: `lb.sample` too."""
    by_name = package_runners(UNTRUNCATED, campaign, size, lb_sample=lb_sample)
    by_name |= package_runners(MODEL, campaign, size, lb_sample=lb_sample)
    if has("numpyro"):
        by_name |= nuts_runners(campaign)
    return by_name


def package_runners(
    model: lb.HybridModel, campaign: lb.Campaign, size: Size, *, lb_sample: bool
) -> dict[str, Runner]:
    """The package's samplers of one model; ``lb_sample``: at the default target too."""
    bound = model.bind(campaign)
    truncated = model is MODEL
    suffix = ""
    if truncated:
        suffix = ", truncated"
    default = lb.inference.StoppingRule().ess
    by_name = {}
    for sampler in SAMPLERS:
        run = partial(sampler_draws, bound, sampler, size.ess)
        by_name[f"{sampler}{suffix}"] = Runner(truncated, sampler, size.ess, run)
        if not lb_sample:
            continue
        if default != size.ess:
            run = partial(sampler_draws, bound, sampler, default)
            name = f"{sampler}{suffix}, default target"
            by_name[name] = Runner(truncated, sampler, default, run)
        call = f'lb.sample(…, sampler="{sampler}")'
        run = partial(whole_sample, model, campaign, sampler)
        by_name[f"lb.sample, {sampler}{suffix}"] = Runner(truncated, call, default, run)
    return by_name


def nuts_runners(campaign: lb.Campaign) -> dict[str, Runner]:
    """Both ways to run NUTS, compiled."""
    bound = UNTRUNCATED.bind(campaign)
    by_name = {}
    for name, whitened in NUTS.items():
        nuts = ReducedNuts(bound, whitened=whitened)
        _, took = clocked(nuts.prepare)
        by_name[name] = Runner(False, name, None, nuts.run, took.cpu)
    return by_name


def race(campaign: lb.Campaign, size: Size, *, lb_sample: bool) -> dict[str, Any]:
    """Minimum bulk ESS per second of everyone, all in turn in each repeat, and how far they are
    from the exact marginals."""
    exact = {
        True: lb.inference.marginalize(MODEL, campaign),
        False: lb.inference.marginalize(UNTRUNCATED, campaign),
    }
    everyone = runners(campaign, size, lb_sample=lb_sample)
    rows: dict[str, dict[str, list[float]]] = {}
    for name in everyone:
        rows[name] = {column: [] for column in COLUMNS}
    names = list(everyone)
    for repeat in range(size.repeats):
        first = repeat % len(names)
        for name in names[first:] + names[:first]:
            runner = everyone[name]
            chain, took = clocked(runner.run, repeat + 1)
            values = run_of(chain, took, exact[runner.truncated])
            for column in COLUMNS:
                rows[name][column].append(values[column])
            say(
                f"{len(campaign.tests)} circles, repeat {repeat + 1}, {name}:"
                f" {values['per_cpu']:,.0f} per CPU second"
            )
    return summary(everyone, rows)


def run_of(chain: Array, took: Clocked, exact: pd.DataFrame) -> dict[str, float]:
    """One run: effective draws, and the worst mean (in standard errors) and standard deviation
    (relative) of all parameters."""
    mean = exact["mean"].to_numpy()
    sd = exact["sd"].to_numpy()
    ess = bulk_ess(chain)
    draws = chain.reshape(-1, chain.shape[2])
    z = np.abs(draws.mean(axis=0) - mean) / (sd / np.sqrt(ess))
    sd_error = np.abs(draws.std(axis=0) / sd - 1.0)
    return {
        "cpu": took.cpu,
        "wall": took.wall,
        "min_bulk_ess": float(ess.min()),
        "per_cpu": float(ess.min() / took.cpu),
        "per_wall": float(ess.min() / took.wall),
        "worst_mean_z": float(z.max()),
        "worst_sd_error": float(sd_error.max()),
    }


def summary(everyone: Mapping[str, Runner], rows: Rows) -> dict[str, Any]:
    """Medians and quartiles of each row, and of its ratio to the best NUTS in the same repeat."""
    best = best_nuts(rows)
    by_name = {}
    for name, row in rows.items():
        runner = everyone[name]
        result: dict[str, Any] = {
            "what": runner.call,
            "truncated": runner.truncated,
            "target": runner.target,
            "compilation": runner.compilation,
        }
        result |= {column: spread(row[column]) for column in COLUMNS if column not in WORST}
        result |= {column: max(row[column]) for column in WORST}
        if best is not None and not runner.truncated:
            for ratio, column in RATIOS.items():
                result[ratio] = spread(np.divide(row[column], rows[best][column]))
        by_name[name] = result | {"reference": name == best}
    return by_name


def best_nuts(rows: Rows) -> str | None:
    """The way to run NUTS with most effective draws per CPU second; None where there is none."""
    medians = {name: float(np.median(rows[name]["per_cpu"])) for name in NUTS if name in rows}
    return max(medians, key=medians.__getitem__, default=None)


def bulk_ess(chain: Array) -> Array:
    """Bulk ESS of every parameter of a chain (chains, draws, d), by ArviZ."""
    effective = []
    for j in range(chain.shape[2]):
        column = np.ascontiguousarray(chain[..., j])
        ess = arviz_stats.base.array_stats.ess(column, chain_axis=0, draw_axis=1, method="bulk")
        effective.append(float(ess))
    return np.array(effective)
