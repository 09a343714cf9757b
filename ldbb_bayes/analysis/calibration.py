"""Are ranks uniform? The band that the empirical distribution of uniform numbers stays inside,
everywhere at once.

Säilynoja, Bürkner and Vehtari, Graphical test for discrete uniformity, Statistics and Computing
32:32 (2022): pointwise binomial intervals, their level adjusted so that all of them hold together
with the probability asked for. That probability is computed exactly here, count by count along the
band.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from pydantic import model_serializer

from ldbb_bayes.analysis.rank_uniformity import ecdf, simultaneous_band
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import InputError, require
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.inference.sample import draw, sampler_named
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.parallel import Lost, done
from ldbb_bayes.results import Array, Numbers, Result, readable

__all__ = ["LOG_LIKELIHOOD", "Validation", "validate"]


LOG_LIKELIHOOD = "log_likelihood"
_INTERVALS = (0.5, 0.8, 0.95)


@dataclass(frozen=True, eq=False)
class Validation(Result):
    """Ranks of true values among their posterior draws."""

    names: tuple[str, ...]  #: parameters, hyper-parameters, and ``log_likelihood``
    ranks: Numbers  #: 0 … draws, shape (replicates, quantities); uniform when calibrated
    draws: int  #: of each replicate
    sampler: str  #: joint or independent
    prob: float  #: of the band, simultaneous over ranks and quantities
    #: what went wrong in replicates that gave no draws; these are not among the ranks
    failures: tuple[str, ...]
    #: rows for which emcee took over, the weights of independent draws not to be trusted
    by_emcee: tuple[int, ...] = ()

    @property
    def replicates(self) -> int:
        """Replicates with ranks."""
        return len(self.ranks)

    @cached_property
    def band(self) -> tuple[Array, Array]:
        """The band of `ecdf` for one quantity, shape (draws,) each: together they hold with
        probability ``prob``.
        """
        return simultaneous_band(self.replicates, self.draws, self.prob ** (1.0 / len(self.names)))

    @property
    def pit(self) -> xr.DataTree:
        """Return the ranks as shares of the draws in ArviZ's group ``prior_sbc``.

        For ``arviz_plots.plot_ecdf_pit``. A replicate stands where ArviZ expects a draw; a share is
        (rank + ½) / (draws + 1).
        """
        shares = (self.ranks + 0.5) / (self.draws + 1.0)
        data = {
            name: (("chain", "draw"), shares[None, :, index])
            for index, name in enumerate(self.names)
        }
        coordinates = {"chain": [0], "draw": np.arange(self.replicates)}
        return xr.DataTree.from_dict({"prior_sbc": xr.Dataset(data, coordinates)})

    def ecdf(self, name: str) -> Array:
        """Return the empirical distribution of one quantity's ranks, shape (draws,)."""
        return ecdf(self.ranks[:, self.names.index(name)], self.draws)

    @cached_property
    def outside(self) -> tuple[str, ...]:
        """Quantities whose ranks leave the band."""
        lower, upper = self.band
        return tuple(
            name
            for name in self.names
            if np.any((self.ecdf(name) < lower) | (self.ecdf(name) > upper))
        )

    @property
    def calibrated(self) -> bool:
        """Whether all ranks stay inside the band and no replicate failed."""
        return not self.outside and not self.failures

    def coverage(self) -> pd.DataFrame:
        """Return the share of true values inside their equal-tailed intervals, one row per
        quantity, and its standard error.

        Columns 50, 80, 95 (what the interval claims, in per cent) and u50, u80, u95 (binomial
        standard errors if calibrated).
        """
        distance = np.abs(2 * self.ranks - self.draws)
        table = pd.DataFrame(index=list(self.names))
        for prob in _INTERVALS:
            limit = prob * (self.draws + 1)
            inside = 0.5 * (distance < limit - 1e-9) + 0.5 * (distance < limit + 1e-9)
            table[f"{100 * prob:g}"] = inside.mean(axis=0)
            table[f"u{100 * prob:g}"] = np.sqrt(prob * (1.0 - prob) / self.replicates)
        return readable(table, "Share of true values inside their intervals")

    @model_serializer
    def _all_but_ranks(self) -> dict[str, Any]:
        coverage = self.coverage()[[f"{100 * prob:g}" for prob in _INTERVALS]].to_dict(
            orient="index"
        )
        return {
            "sampler": self.sampler,
            "replicates": self.replicates,
            "draws": self.draws,
            "band_probability": self.prob,
            "quantities": {
                n: {"inside_band": n not in self.outside, "coverage": coverage[n]}
                for n in self.names
            },
            "failures": list(self.failures),
            "by_emcee": list(self.by_emcee),
            "calibrated": self.calibrated,
        }


def validate(
    model: HybridModel,
    plan: Campaign,
    *,
    replicates: int = 100,
    draws: int = 99,
    sampler: str = "independent",
    generator: HybridModel | None = None,
    prob: float = 0.99,
    seed: int = 1,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Validation:
    """Simulate, infer, rank: hyper-parameters and parameters from their priors, every replicate.

    InputError for a flat prior, an unknown sampler, or numbers out of range.

    Parameters
    ----------
    model : with proper priors.
    plan : forces, angles, clockings; readings are ignored.
    replicates, draws : simulated campaigns, and independent posterior draws of each.
    sampler : {"independent", "joint"}
    generator : what the readings are drawn from; default ``model``. Another one shows what a wrong
        model does.
    prob : probability of the band, simultaneous over ranks and quantities.
    executor : runs the replicates, one BLAS thread each; default: here, one after the other. The
        result does not depend on it.
    progress : called with the number of replicates done and their total.
    """
    sampler = sampler_named(sampler)
    proper = not (model.prior.flat or (generator is not None and generator.prior.flat))
    require(
        proper,
        "validation must start from proper priors, got flat ones: nothing can be drawn. Use the"
        " default preset.",
    )
    for name, value, least in (("replicates", replicates, 10), ("draws", draws, 9)):
        require(value >= least, f"{name} must be at least {least}, got {value}. Ask for more.")
    require(
        0.0 < prob < 1.0, f"prob must lie between 0 and 1, got {prob}. For a 99 % band give 0.99."
    )
    bound = model.bind(plan)
    job = partial(_ranks, model, generator or model, plan, sampler, draws)
    rows: dict[int, Array | str] = {}
    for i, row in done(job, np.random.SeedSequence(seed).spawn(replicates), executor):
        rows[i] = row.reason if isinstance(row, Lost) else row
        if progress is not None:
            progress(len(rows), replicates)
    failures = tuple(row for _, row in sorted(rows.items()) if isinstance(row, str))
    if len(failures) == replicates:
        raise InputError(
            f"at least one replicate must give draws, got none. First reason: {failures[0]}"
        )
    found = np.array([rows[i] for i in range(replicates) if not isinstance(rows[i], str)])
    names = (*bound.names, *bound.hyper_prior.names, LOG_LIKELIHOOD)
    by_emcee = np.flatnonzero(found[:, -1]).tolist()
    return Validation(names, found[:, :-1], draws, sampler, prob, failures, tuple(by_emcee))


def _ranks(
    model: HybridModel,
    generator: HybridModel,
    plan: Campaign,
    sampler: str,
    draws: int,
    seed: np.random.SeedSequence,
) -> Array | str:
    """Ranks of the truth among the draws of one simulated campaign, then whether emcee took over;
    or why there are none.
    """
    simulating, sampling = seed.spawn(2)
    simulation = generator.simulate(plan, seed=int(simulating.generate_state(1)[0]))
    bound = model.bind(simulation.campaign)
    start = HyperPosterior(bound, truncated=bound.truncation.active)
    try:
        beta, phi, by_emcee = draw(sampler, start, draws, seed=sampling)
    except InputError as error:
        return str(error)
    shown = zip(bound.hyper_prior.names, bound.hyper_prior.shown, strict=True)
    true = simulation.parameters | {
        name: simulation.hyper_um.get(name, 0.0) / float(factor) for name, factor in shown
    }
    truth = np.array([true.get(name, 0.0) for name in (*bound.names, *bound.hyper_prior.names)])
    ranks = (np.hstack([beta, phi]) < truth).sum(axis=0)
    p = len(bound.names)
    true_likelihood = bound.log_likelihood(truth[None, p:], truth[None, :p])[0]
    return np.append(
        ranks,
        [
            (bound.log_likelihood(phi, beta) < true_likelihood).sum(),
            by_emcee and sampler == "independent",
        ],
    )
