"""Independent draws from the posterior by rejection from a fitted proposal."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ldbb_bayes.inference.conditional_sampling import draw_parameters_given
from ldbb_bayes.inference.integrals import CHUNK, Index, Integral
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.model.conditional import ParameterConditional
from ldbb_bayes.model.triangular import solve_upper
from ldbb_bayes.results import Array

__all__ = ["JointDraws", "TooRoughError", "draw_jointly"]

# Chunks of proposals for each chunk of draws before the sampler gives up.
_MOST_ROUNDS = 50
# Draws of β for each φ from which P(T | y) is estimated.
_SHARE_TRIES = 64
# Below this P(T | y) draws without truncation are too rarely inside: β is drawn by tilting.
_SMALLEST_SHARE_INSIDE = 0.02
# So many draws of β inside the truncation are expected for each φ.
_EXPECTED_INSIDE = 4.0
# The envelope is so many times the proposal scaled to the integral.
_ENVELOPE = 2.0
# Least estimate of P(T | y), where no draw fell inside.
_LEAST_SHARE = 1e-9


class TooRoughError(Exception):
    """The weights of the hyper-parameters' proposal cannot be trusted: use the joint sampler."""


class JointDraws(NamedTuple):
    """Independent draws of the posterior."""

    free: Array  #: free coordinates of the hyper-parameters (size, h)
    beta: Array  #: parameters (size, p)
    acceptance: float  #: share of proposals used


def draw_jointly(posterior: HyperPosterior, size: int, rng: np.random.Generator) -> JointDraws:
    """Draw free coordinates and β independently by rejection from the proposal of a sample.

    Truncated, several β are drawn for each φ without truncation, and φ counts by how many are
    inside: exact, as that share is P(T | y, φ) on average. Where few are, φ is drawn by
    P(T | y, φ) itself, and β by tilting. A φ whose weight is above the envelope is used several
    times, each with another β.

    Raises
    ------
    TooRoughError
        When the weights of the sample cannot be trusted, or almost nothing is accepted.
    """
    share_inside = 1.0
    if posterior.truncated:
        share_inside = _estimate_share_inside(posterior, rng)
    tilted = share_inside < _SMALLEST_SHARE_INSIDE
    proposal = posterior.plain.proposal
    if tilted:
        proposal = posterior.proposal
    if not proposal.trusted:
        raise TooRoughError(f"Pareto k {proposal.pareto_k:.2f}")
    free = []
    beta = []
    accepted = 0
    proposed = 0
    for _ in range(_MOST_ROUNDS * max(1, -(-size // CHUNK))):
        if tilted:
            draws = _propose_tilted(posterior, proposal, rng)
        else:
            draws = _propose_untruncated(posterior, proposal, share_inside, rng)
        free.append(draws[0])
        beta.append(draws[1])
        accepted = accepted + len(draws[0])
        proposed = proposed + CHUNK
        if accepted >= size:
            order = rng.permutation(size)
            return JointDraws(
                np.concatenate(free)[order], np.concatenate(beta)[order], accepted / proposed
            )
    raise TooRoughError(f"{accepted} of {size} draws from {proposed} proposals")


def _propose_tilted(
    posterior: HyperPosterior, proposal: Integral, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Accept φ of one chunk by their density inside the truncation; draw β by tilting."""
    log_scale = proposal.log_integral + np.log(_ENVELOPE)
    free = proposal.draw(CHUNK, rng)
    log_weight = -proposal.log_proposal(free) - log_scale
    accepted = free[_accept(log_weight + posterior.log_density(free), rng)]
    return accepted, draw_parameters_given(posterior.bound, accepted, rng)


def _propose_untruncated(
    posterior: HyperPosterior, proposal: Integral, share_inside: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Accept φ of one chunk by how many of their β, drawn without truncation, are inside."""
    tries = 1
    if posterior.truncated:
        tries = int(np.ceil(_EXPECTED_INSIDE / share_inside))
    log_scale = proposal.log_integral + np.log(_ENVELOPE * share_inside)
    free = proposal.draw(CHUNK, rng)
    log_weight = -proposal.log_proposal(free) - log_scale
    log_evidence, conditional = posterior.given(free)
    log_weight += posterior.bound.hyper_prior.log_density_of_free(free) + log_evidence
    standard, count = _draw_standard(conditional, tries, rng, truncated=posterior.truncated)
    with np.errstate(divide="ignore"):
        index = _accept(log_weight + np.log(count / tries), rng)
    repetition = np.arange(len(index)) - np.searchsorted(index, index)
    z = standard[index, np.minimum(repetition, count[index] - 1)]
    if not posterior.truncated:
        z = rng.standard_normal(z.shape)
    root = conditional.root[index]
    beta = conditional.mean[index] + solve_upper(root, z) * conditional.scale[index]
    return free[index], beta


def _accept(log_weight: Array, rng: np.random.Generator) -> Index:
    """Return the index of the proposals accepted, each as often as its weight says on average."""
    weight = np.exp(log_weight)
    rounded_up = rng.random(len(weight)) < weight % 1.0
    return np.repeat(np.arange(len(weight)), (np.floor(weight) + rounded_up).astype(int))


def _draw_standard(
    conditional: ParameterConditional,
    tries: int,
    rng: np.random.Generator,
    *,
    truncated: bool = True,
) -> tuple[Array, Array]:
    """Draw standard coordinates of β without truncation, (w, tries, p), those inside it first.

    The second array says how many of them are inside, (w,).
    """
    z = rng.standard_normal((len(conditional.mean), tries, conditional.mean.shape[1]))
    rows = conditional.physical.rows
    if not truncated:
        rows = rows[:0]
    spread = np.swapaxes(conditional.spread(rows), 1, 2)
    compliance = z @ spread + (conditional.mean @ rows.T)[:, None]
    inside = (compliance >= 0.0).all(axis=2)
    order = np.argsort(~inside, axis=1, kind="stable")
    return np.take_along_axis(z, order[:, :, None], axis=1), inside.sum(axis=1)


def _estimate_share_inside(posterior: HyperPosterior, rng: np.random.Generator) -> float:
    """Estimate P(T | y) by the share of draws without truncation that are inside."""
    nodes = posterior.plain.proposal.pick(CHUNK, rng)
    conditional = posterior.given(nodes)[1]
    count = _draw_standard(conditional, _SHARE_TRIES, rng)[1]
    return max(float(count.mean()) / _SHARE_TRIES, _LEAST_SHARE)
