"""Simulation-based calibration: does the whole computation return the posterior it claims to?

(β, φ) ~ prior, readings ~ model(β, φ), draws ~ posterior(readings): the rank of each true value among its draws is uniform when
simulation, likelihood, priors and sampler fit together (Talts et al. 2018, arXiv:1804.06788; the likelihood as a further quantity
as in Modrák et al. 2023).
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ldbb_bayes.analysis.ranks import ecdf, simultaneous_band
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.inference.quadrature import HyperPosterior
from ldbb_bayes.inference.samplers import SAMPLERS, draw
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.notebook import table_html
from ldbb_bayes.work import Lost, done

__all__ = ["LOG_LIKELIHOOD", "Validation", "validate"]

Array = NDArray[Any]
LOG_LIKELIHOOD = "log_likelihood"
_INTERVALS = (0.5, 0.8, 0.95)


@dataclass(frozen=True, eq=False)
class Validation:
    """Ranks of true values among their posterior draws.

    Attributes
    ----------
    names : tuple of str
        Parameters, hyper-parameters, and ``log_likelihood``.
    ranks : ndarray of int, shape (replicates, quantities)
        0 … draws; uniform when calibrated.
    draws : int
    sampler : str
    prob : float
        Probability of the band, simultaneous over ranks and quantities.
    failures : tuple of str
        What went wrong in replicates that gave no draws; these are not among the ranks.
    """

    names: tuple[str, ...]
    ranks: Array
    draws: int
    sampler: str
    prob: float
    failures: tuple[str, ...]

    @property
    def replicates(self) -> int:
        """Replicates with ranks."""
        return len(self.ranks)

    @cached_property
    def band(self) -> tuple[Array, Array]:
        """The band of `ecdf` for one quantity, shape (draws,) each: together they hold with probability ``prob``."""
        return simultaneous_band(self.replicates, self.draws, self.prob ** (1.0 / len(self.names)))

    def ecdf(self, name: str) -> Array:
        """Empirical distribution of one quantity's ranks, shape (draws,)."""
        return ecdf(self.ranks[:, self.names.index(name)], self.draws)

    @cached_property
    def outside(self) -> tuple[str, ...]:
        """Quantities whose ranks leave the band."""
        lower, upper = self.band
        return tuple(name for name in self.names if np.any((self.ecdf(name) < lower) | (self.ecdf(name) > upper)))

    @property
    def calibrated(self) -> bool:
        """Whether all ranks stay inside the band and no replicate failed."""
        return not self.outside and not self.failures

    def coverage(self) -> pd.DataFrame:
        """Share of true values inside their equal-tailed intervals, one row per quantity, and its standard error.

        Columns 50, 80, 95 (what the interval claims, in per cent) and u50, u80, u95 (binomial standard errors expected of a
        calibrated computation).
        """
        distance = np.abs(2 * self.ranks - self.draws)
        table = {}
        for prob in _INTERVALS:
            limit = prob * (self.draws + 1)
            inside = 0.5 * (distance < limit - 1e-9) + 0.5 * (distance < limit + 1e-9)
            table[f"{100 * prob:g}"] = inside.mean(axis=0)
            table[f"u{100 * prob:g}"] = np.full(len(self.names), np.sqrt(prob * (1.0 - prob) / self.replicates))
        return pd.DataFrame(table, index=list(self.names))

    @property
    def verdict(self) -> str:
        """One line."""
        tested = f"{self.replicates} replicates, {len(self.names)} quantities, {100 * self.prob:g} % band"
        if self.failures:
            return f"NOT CALIBRATED: {len(self.failures)} replicates failed, first: {self.failures[0]} ({tested})."
        if self.outside:
            return f"NOT CALIBRATED: the ranks of {', '.join(self.outside)} leave the band ({tested})."
        return f"Calibrated as far as {tested} can tell."

    def as_dict(self) -> dict[str, Any]:
        """Everything but the ranks, for JSON."""
        coverage = self.coverage()
        level = np.arange(1, self.draws + 1) / (self.draws + 1)
        quantities = {
            name: {
                "inside_band": name not in self.outside,
                "largest_difference": float(np.abs(self.ecdf(name) - level).max()),
                "coverage": {f"{100 * p:g}": float(coverage[f"{100 * p:g}"].loc[name]) for p in _INTERVALS},
            }
            for name in self.names
        }
        return {
            "sampler": self.sampler,
            "replicates": self.replicates,
            "draws": self.draws,
            "band_probability": self.prob,
            "quantities": quantities,
            "failures": list(self.failures),
            "calibrated": self.calibrated,
            "verdict": self.verdict,
        }

    def _repr_html_(self) -> str:
        rows: list[dict[str, object]] = []
        for name, shares in self.coverage().iterrows():
            row: dict[str, object] = {"quantity": str(name), "inside the band": "no" if name in self.outside else "yes"}
            rows.append(row | {f"{100 * p:g} % interval": f"{100 * shares[f'{100 * p:g}']:.1f} %" for p in _INTERVALS})
        return table_html(self.verdict, rows)


def validate(
    model: HybridModel,
    plan: Campaign,
    *,
    replicates: int = 100,
    draws: int = 99,
    sampler: str = "quadrature",
    generator: HybridModel | None = None,
    prob: float = 0.99,
    seed: int = 1,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Validation:
    """Simulate, infer, rank: hyper-parameters and parameters from their priors, every replicate.

    Parameters
    ----------
    model : HybridModel
        With proper priors.
    plan : Campaign
        Forces, angles, clockings; readings are ignored.
    replicates, draws : int
        Simulated campaigns, and independent posterior draws of each.
    sampler : {"quadrature", "joint", "collapsed"}
    generator : HybridModel, optional
        What the readings are drawn from; default ``model``. Another one shows what a wrong model does.
    prob : float
        Probability of the band, simultaneous over ranks and quantities.
    executor : concurrent.futures.Executor, optional
        Runs the replicates, one BLAS thread each; default: here, one after the other. The result does not depend on it.
    progress : callable, optional
        Called with the number of replicates done and their total.

    Raises
    ------
    InputError
        For a flat prior, an unknown sampler, or numbers out of range.
    """
    _check(model, generator, replicates, draws, sampler, prob)
    made = generator or model
    seeds = np.random.SeedSequence(seed).spawn(replicates)
    rows: list[_Replicate | None] = [None] * replicates
    job = partial(_replicate, model, made, plan, sampler, draws)
    for count, (i, row) in enumerate(done(job, seeds, executor)):
        rows[i] = _Replicate((), np.zeros(0), row.reason) if isinstance(row, Lost) else row
        if progress is not None:
            progress(count + 1, replicates)
    finished = [row for row in rows if row is not None]
    ranks = [row.ranks for row in finished if row.failure is None]
    failures = tuple(row.failure for row in finished if row.failure is not None)
    names = next((row.names for row in finished if row.failure is None), ())
    if not ranks:
        raise InputError(f"at least one replicate must give draws, got none. First reason: {failures[0]}")
    return Validation(names, np.array(ranks), draws, sampler, prob, failures)


@dataclass(frozen=True, eq=False)
class _Replicate:
    names: tuple[str, ...]
    ranks: Array
    failure: str | None = None


def _replicate(
    model: HybridModel, generator: HybridModel, plan: Campaign, sampler: str, draws: int, seed: np.random.SeedSequence
) -> _Replicate:
    """One simulated campaign: ranks of the truth among the draws of its posterior."""
    simulating, sampling = seed.spawn(2)
    simulation = generator.simulate(plan, seed=int(simulating.generate_state(1)[0]))
    bound = model.bind(simulation.campaign)
    start = HyperPosterior(bound, truncated=bound.truncation.active)
    try:
        beta, phi = draw(sampler, start, draws, seed=sampling)
    except InputError as error:
        return _Replicate((), np.zeros(0), str(error))
    names = (*bound.names, *bound.hyper_prior.names)
    truth = np.array([(simulation.parameters | _in_mm(simulation.hyper_um)).get(name, 0.0) for name in names])
    ranks = (np.hstack([beta, phi]) < truth).sum(axis=0)
    p = len(bound.names)
    true_likelihood = bound.log_likelihood(truth[None, p:], truth[None, :p])[0]
    likelihood = bound.log_likelihood(phi, beta)
    return _Replicate((*names, LOG_LIKELIHOOD), np.append(ranks, (likelihood < true_likelihood).sum()))


def _in_mm(hyper_um: dict[str, float]) -> dict[str, float]:
    return {name: value * 1e-3 for name, value in hyper_um.items()}


def _check(model: HybridModel, generator: HybridModel | None, replicates: int, draws: int, sampler: str, prob: float) -> None:
    check_known("sampler", [sampler], SAMPLERS)
    if model.prior.flat or (generator is not None and generator.prior.flat):
        raise InputError("validation must start from proper priors, got flat ones: nothing can be drawn. Use the default preset.")
    for name, value, least in (("replicates", replicates, 10), ("draws", draws, 9)):
        if value < least:
            raise InputError(f"{name} must be at least {least}, got {value}. Ask for more.")
    if not 0.0 < prob < 1.0:
        raise InputError(f"prob must lie between 0 and 1, got {prob}. For a 99 % band give 0.99.")
