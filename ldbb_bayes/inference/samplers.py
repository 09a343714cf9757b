"""The three samplers behind one door."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.inference.collapsed import draw_parameters_given, sample_collapsed
from ldbb_bayes.inference.ensemble import BlockStore, EnsembleRun, Progress
from ldbb_bayes.inference.independent import draw_hyper, sample_quadrature
from ldbb_bayes.inference.joint import sample_joint
from ldbb_bayes.inference.posterior import assess
from ldbb_bayes.inference.quadrature import HyperPosterior
from ldbb_bayes.inference.stopping import StoppingRule

__all__ = ["SAMPLERS", "Sampler", "draw", "run_sampler"]

Array = NDArray[Any]
Sampler = Literal["joint", "collapsed", "quadrature"]
SAMPLERS: tuple[Sampler, ...] = ("joint", "collapsed", "quadrature")
_SPACING = 4.0


def run_sampler(
    sampler: str,
    start: HyperPosterior,
    *,
    ensembles: int = 4,
    walkers: int | None = None,
    rule: StoppingRule,
    seed: np.random.SeedSequence,
    progress: Callable[[Progress], None] | None = None,
    store: BlockStore | None = None,
) -> tuple[EnsembleRun, Array, Array]:
    """Run until the rule is met.

    Returns
    -------
    run : EnsembleRun
    beta : ndarray, shape (chains, draws, p)
    phi : ndarray, shape (chains, draws, h) [mm]
    """
    if sampler == "quadrature":
        return sample_quadrature(start, assess=assess, rule=rule, seed=seed, progress=progress)
    run = sample_collapsed if sampler == "collapsed" else sample_joint
    return run(start, assess=assess, ensembles=ensembles, walkers=walkers, rule=rule, seed=seed, progress=progress, store=store)


def draw(sampler: str, start: HyperPosterior, size: int, *, seed: np.random.SeedSequence) -> tuple[Array, Array]:
    """As good as independent draws: β, shape (size, p), and φ, shape (size, h) [mm].

    Quadrature draws are independent; those of emcee are thinned from a run worth four times as many.
    """
    if sampler == "quadrature":
        rng = np.random.default_rng(seed)
        free, _ = draw_hyper(start, size, rng)
        return draw_parameters_given(start, free, rng), start.bound.hyper_prior.phi(free)
    rule = StoppingRule(ess=_SPACING * size, rhat=1.05, lengths=2.0)
    _, beta, phi = run_sampler(sampler, start, rule=rule, seed=seed)
    flat_beta, flat_phi = beta.reshape(-1, beta.shape[2]), phi.reshape(-1, phi.shape[2])
    picked = np.linspace(0, len(flat_beta) - 1, size).astype(int)
    return flat_beta[picked], flat_phi[picked]
