"""Every test predicted from the others: ln p(y_r | y_−r) = ln Z(y) − ln Z(y_−r), exact, campaign properties frozen.

A test is what can be left out. Readings of one circle share their set-up shift and discrepancy: they are not independent facts,
and leaving one out tells how well its neighbours predict it, whatever the machine does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.inference.evidence import Evidence, evidence_on
from ldbb_bayes.inference.nodes import CHUNK, HyperPosterior, Lattice, draw_parameters_given
from ldbb_bayes.inference.posterior import psis_loo
from ldbb_bayes.inference.predictive import harmonics_of, own_nuisances, shared_columns
from ldbb_bayes.model.hybrid import BoundModel

__all__ = ["LeftOut", "leave_one_out", "pareto_smoothed", "replicate_left_out"]

Array = NDArray[Any]
_CHAINS = 4


@dataclass(frozen=True, eq=False)
class LeftOut:
    """One test left out.

    Attributes
    ----------
    name : str
    log_density : float
        ln p(y_r | y_−r) [nat]; of readings in mm.
    error : float
        Of the quadrature [nat].
    evidence, posterior, lattice : Evidence, HyperPosterior, Lattice
        Of the other tests.
    """

    name: str
    log_density: float
    error: float
    evidence: Evidence
    posterior: HyperPosterior
    lattice: Lattice


def leave_one_out(
    posterior: HyperPosterior, evidence: Evidence, *, tolerance: float = 1e-2, progress: Callable[[], None] | None = None
) -> dict[str, LeftOut]:
    """Leave out every test in turn; for campaigns of at least two tests.

    Parameters
    ----------
    posterior, evidence : HyperPosterior, Evidence
        Of all tests.
    """
    found = {}
    names = posterior.bound.test_names
    for name in names:
        rest = posterior.bound.keeping([other for other in names if other != name])
        start = HyperPosterior(rest, truncated=posterior.truncated, near=posterior.mode)
        lattice = start.lattice(tolerance)
        others = evidence_on(start, lattice)
        found[name] = LeftOut(name, evidence.log_value - others.log_value, evidence.error + others.error, others, start, lattice)
        if progress is not None:
            progress()
    return found


def pareto_smoothed(
    posterior: HyperPosterior, lattice: Lattice, *, draws: int = 4000, seed: int = 0
) -> tuple[Array, Array, float]:
    """The same by importance sampling from the posterior of all tests: see `psis_loo`."""
    bound, rng = posterior.bound, np.random.default_rng(seed)
    free = lattice.pick(draws // _CHAINS * _CHAINS, rng)
    beta, phi = draw_parameters_given(posterior, free, rng), bound.hyper_prior.phi(free)
    parts = [bound.log_likelihood_per_test(phi[i : i + CHUNK], beta[i : i + CHUNK]) for i in range(0, len(phi), CHUNK)]
    return psis_loo(np.concatenate(parts).reshape(_CHAINS, -1, len(bound.test_names)))


def replicate_left_out(bound: BoundModel, left: LeftOut, size: int, rng: np.random.Generator, *, each: int = 1) -> Array:
    """Least-squares harmonics of circles that the other tests expect in the place of the one left out, shape (size, 25) [mm].

    Parameters
    ----------
    bound : BoundModel
        Of all tests.
    each : int
        Circles per posterior draw.
    """
    rest, r = left.posterior.bound, bound.test_names.index(left.name)
    free = left.lattice.pick(-(-size // each), rng)
    beta, phi = draw_parameters_given(left.posterior, free, rng), rest.hyper_prior.phi(free)
    machine = beta @ bound.interest[r].T + bound.known_offset[r]
    shared = shared_columns(bound)[r]
    if shared.size:
        parts = [
            rest.given_interest.conditional(phi[i : i + CHUNK], beta[i : i + CHUNK] - rest.centre)[1].draw(rng)
            for i in range(0, len(phi), CHUNK)
        ]
        machine = machine + np.concatenate(parts) @ shared.T
    machine, phi = np.repeat(machine, each, axis=0)[:size], np.repeat(phi, each, axis=0)[:size]
    test = bound.reduced[r]
    sigma = phi[:, bound.hyper_prior.names.index("sigma")]
    noise = sigma[:, None] * rng.standard_normal((size, len(test.factor)))
    circle = (machine + own_nuisances(bound, phi, r, rng)) @ test.factor.T + noise
    return np.asarray(circle @ harmonics_of(bound, r).T)
