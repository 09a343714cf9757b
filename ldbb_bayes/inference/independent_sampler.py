"""Independent random draws from the posterior by rejection sampling with a fitted proposal.

y are the readings; φ are the h hyper-parameters, such as the standard deviation of the noise; β are
the p parameters: compliances, their changes with force, and geometric errors. T (truncation) is the
condition that no compliance is negative. In names, ``inside`` means that a value of β has no
negative compliance. Free coordinates are φ transformed to be unbounded, mostly ln(φ − lower bound).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ldbb_bayes.inference.conditional_sampling import draw_parameters_given
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.integrals import Index, Integral
from ldbb_bayes.model.conditional import ParameterConditional
from ldbb_bayes.results import Array

__all__ = ["JointDraws", "TooRoughError", "draw_jointly"]

# The rejection sampler proposes draws in blocks, of a quarter of the number of draws requested, but
# of at least ``_SMALLEST_BLOCK`` and at most ``_LARGEST_BLOCK`` draws. Larger blocks take less time
# for each draw, but propose more draws than needed if few are requested.
_SMALLEST_BLOCK = 256
_LARGEST_BLOCK = 1024
# The rejection sampler gives up if it has proposed this many times the number of draws requested
# (or of the draws of the smallest block, if fewer draws are requested), and too few are accepted.
_MOST_PROPOSED = 50
# If the posterior probability that no compliance is negative is below this value, too many draws
# would be lost by rejecting draws with negative compliances. The parameters are then drawn from a
# density that is shifted towards compliances that are not negative.
_SMALLEST_SHARE_INSIDE = 0.02
# Several vectors of the parameters are drawn for each value of the hyper-parameters. Their number
# is chosen so that on average at least this many of them have no negative compliance.
_EXPECTED_INSIDE = 4.0
# Height of the envelope in rejection sampling. The envelope is the density from which draws are
# proposed, scaled to the same integral as the posterior density and multiplied by its height. A
# draw is accepted with a probability equal to the posterior density divided by the envelope. The
# envelope is above the posterior density at nodes that hold ``_SHARE_BELOW_ENVELOPE`` of the
# posterior probability, but never higher than ``_HIGHEST_ENVELOPE``. A lower envelope accepts more
# draws, but returns more values of the hyper-parameters several times.
_SHARE_BELOW_ENVELOPE = 0.95
_HIGHEST_ENVELOPE = 2.0
# The rejection sampler divides by an estimate of the probability that no compliance is negative. An
# estimate below this number is replaced by this number.
_LEAST_SHARE = 1e-9
# Where the posterior density exceeds the envelope, a value of the hyper-parameters is returned
# several times. If the effective number of values, divided by the number of draws, is below
# ``_LEAST_EFFECTIVE``, the proposal is fitted anew to all points so far, and all draws are made
# again. After ``_MOST_REFITS`` such fits the sampler gives up.
_LEAST_EFFECTIVE = 0.5
_MOST_REFITS = 3


class TooRoughError(Exception):
    """Error raised if the proposal resembles the posterior too little for rejection sampling.

    The proposal is the density from which points are drawn. Parameters and hyper-parameters must
    then be drawn with emcee instead.
    """


class JointDraws(NamedTuple):
    """Independent random draws from the posterior of hyper-parameters and parameters."""

    #: random draws of the h hyper-parameters (such as the standard deviation of the noise) in
    #: unbounded coordinates, shape (size, h). If a hyper-parameter has no upper bound, its
    #: coordinate is ln(value − lower bound).
    free: Array
    #: random draws of the p parameters (compliances, their changes with force, geometric errors) in
    #: mm, N and rad, shape (size, p)
    beta: Array
    #: number of random draws that the rejection sampler accepted; at least the number of draws
    #: requested. Draws are proposed in blocks, and the last block may give more draws than are
    #: needed.
    accepted: int
    proposed: int  #: number of random draws that were proposed to the rejection sampler
    #: log posterior density at every random draw, as `JointDensity` defines it, shape (size,)
    log_posterior: Array


def draw_jointly(posterior: HyperPosterior, size: int, rng: np.random.Generator) -> JointDraws:
    """Return ``size`` independent random draws of hyper-parameters φ and parameters β.

    The draws are made by rejection sampling. φ are the hyper-parameters, such as the standard
    deviation of the noise; β are compliances, their changes with force, and geometric errors. φ is
    drawn from a proposal, which is a density fitted to the posterior of φ. β is drawn from its
    Gaussian density given φ and the readings. The weight of a draw of φ is the posterior density
    divided by the proposal. Let r be this weight divided by an estimate of the mean weight, and by
    the height of the envelope (at most two). If r is below one, the draw is accepted with the
    probability r. If r exceeds one, the draw of φ may be returned several times, each time with
    another β. Equal φ follow one another, so that their number lowers the effective sample size. If
    there are too many of them, the proposal is fitted anew.

    If compliances must not be negative, several β are drawn for each φ, and the weight is
    multiplied by the share of these β without negative compliances. On average, the share is the
    probability, given φ and the readings, that no compliance is negative. The accepted draws
    therefore follow the posterior. If the posterior probability that no compliance is negative is
    below 2 %, almost all β would be rejected. The weight is then multiplied by the probability
    itself, and β is drawn from a density shifted towards compliances that are not negative.

    ``posterior`` is the posterior density of φ, and ``rng`` generates the random numbers.

    Raises
    ------
    TooRoughError
        If the weights of the points from which the proposal was fitted cannot be trusted, if almost
        no draw is accepted, or if few values of φ stand for many draws whatever the proposal.
    """
    share_inside = 1.0
    if posterior.truncated:
        share_inside = max(np.exp(posterior.coarse_probability.log_value), _LEAST_SHARE)
    tilted = share_inside < _SMALLEST_SHARE_INSIDE
    fitted_to = posterior if tilted else posterior.without_truncation
    sample = fitted_to.weighted_sample
    if not sample.trusted:
        raise TooRoughError(f"Pareto k {sample.pareto_k:.2f}")
    for _ in range(1 + _MOST_REFITS):
        envelope = _Envelope(sample, _block_size(size), 1.0 if tilted else share_inside)
        blocks = _propose_blocks(posterior, envelope, size, rng, tilted=tilted)
        draws = _joined(blocks, size)
        effective = _effective_number(draws.free)
        if effective >= _LEAST_EFFECTIVE * size:
            return draws
        points = np.concatenate([block.points for block in blocks])
        log_density = np.concatenate([block.log_density for block in blocks])
        sample = fitted_to.refitted_sample(sample, points, log_density)
    raise TooRoughError(f"effective number {effective:.0f} of {size} draws")


def _block_size(size: int) -> int:
    """Return the number of draws that are proposed at a time if ``size`` draws are requested."""
    return int(np.clip(size // 4, _SMALLEST_BLOCK, _LARGEST_BLOCK))


@dataclass(frozen=True, eq=False)
class _Envelope:
    """Envelope of the posterior density, from which the rejection sampler draws its proposals."""

    #: nodes (points) drawn from a density that was fitted to the posterior. Their weights are
    #: proportional to the posterior density divided by the fitted density.
    sample: Integral
    block: int  #: number of draws that are proposed at a time
    #: posterior probability that no compliance is negative, if the fitted density does not take it
    #: into account; otherwise one. Where the probability given the hyper-parameters is larger, so
    #: is the posterior density.
    share_inside: float

    @cached_property
    def _log_height(self) -> float:
        """Log of the height of the envelope.

        The height is relative to the fitted density, scaled to the same integral as the posterior
        density.
        """
        ascending = np.sort(self.sample.weight)
        first_above = np.searchsorted(np.cumsum(ascending), _SHARE_BELOW_ENVELOPE)
        relative_density = len(ascending) * ascending[first_above] / self.share_inside
        return float(np.log(min(relative_density, _HIGHEST_ENVELOPE)))

    def propose(self, rng: np.random.Generator) -> tuple[Array, Array]:
        """Return proposed draws of h hyper-parameters, and the log of the envelope at each of them.

        The draws, in unbounded coordinates, have the shape (block, h), and the logarithms the shape
        (block,). ``rng`` generates the random numbers.
        """
        free, log_density = self.sample.draw_with_log_density(self.block, rng)
        return free, log_density + self.sample.log_integral + self._log_height


def _propose_blocks(
    posterior: HyperPosterior,
    envelope: _Envelope,
    size: int,
    rng: np.random.Generator,
    *,
    tilted: bool,
) -> list[_ProposedBlock]:
    """Return blocks of proposed draws, so many that at least ``size`` draws are accepted.

    Raise a `TooRoughError` if almost no draw is accepted. The draws are proposed from ``envelope``.
    If ``tilted``, the parameters are drawn from a density that is shifted towards compliances that
    are not negative.
    """
    blocks: list[_ProposedBlock] = []
    accepted = 0
    proposed = 0
    while accepted < size:
        if proposed >= _MOST_PROPOSED * max(size, _SMALLEST_BLOCK):
            raise TooRoughError(f"{accepted} of {size} draws from {proposed} proposals")
        if tilted:
            block = _propose_tilted(posterior, envelope, rng)
        elif posterior.truncated:
            block = _propose_by_rejection(posterior, envelope, rng)
        else:
            block = _propose_unrestricted(posterior, envelope, rng)
        blocks.append(block)
        accepted += len(block.free)
        proposed += len(block.points)
    return blocks


def _joined(blocks: Sequence[_ProposedBlock], size: int) -> JointDraws:
    """Return the first ``size`` accepted draws of several blocks.

    Draws with the same hyper-parameters follow one another.
    """
    return JointDraws(
        free=np.concatenate([block.free for block in blocks])[:size],
        beta=np.concatenate([block.beta for block in blocks])[:size],
        accepted=sum(len(block.free) for block in blocks),
        proposed=sum(len(block.points) for block in blocks),
        log_posterior=np.concatenate([block.log_posterior for block in blocks])[:size],
    )


def _effective_number(free: Array) -> float:
    """Return the effective number n²/Σ c² of different values among n draws.

    ``free``, shape (n, h), holds draws of the h hyper-parameters. c is the number of times that a
    value occurs; equal values follow one another (Kish's effective sample size).
    """
    is_new = np.append(True, (free[1:] != free[:-1]).any(axis=1))
    counts = np.diff(np.append(np.flatnonzero(is_new), len(free)))
    return float(len(free) ** 2 / np.sum(counts.astype(float) ** 2))


class _ProposedBlock(NamedTuple):
    """Block of proposed draws of hyper-parameters φ, and the accepted draws of φ and β."""

    #: draws of h hyper-parameters that the rejection sampler accepted, in unbounded coordinates
    #: (mostly ln(value − lower bound)), shape (accepted, h)
    free: Array
    #: draws of p parameters in mm, N and rad, one for each accepted draw of the hyper-parameters,
    #: shape (accepted, p)
    beta: Array
    #: log posterior density at every accepted draw, as `JointDensity` defines it, shape (accepted,)
    log_posterior: Array
    #: all proposed draws of h hyper-parameters in unbounded coordinates, shape (block, h)
    points: Array
    #: log of the density to which the proposal is fitted, at every proposed draw of the
    #: hyper-parameters, shape (block,)
    log_density: Array


def _propose_tilted(
    posterior: HyperPosterior, envelope: _Envelope, rng: np.random.Generator
) -> _ProposedBlock:
    """Propose values of the hyper-parameters φ; return the accepted φ with draws of parameters β.

    φ is drawn from ``envelope`` and accepted with a probability proportional to its
    weight. The weight is the posterior density of φ under the condition that no compliance is
    negative, divided by the density of the proposal. β is drawn given the accepted φ, under the
    same condition, from a density that is shifted (tilted) towards compliances that are not
    negative.
    """
    free, log_envelope = envelope.propose(rng)
    log_density = posterior.log_density(free)
    accepted = free[_accept(log_density - log_envelope, rng)]
    beta = draw_parameters_given(posterior.bound, accepted, rng)
    log_evidence, conditional = posterior.given(accepted)
    log_marginal = posterior.bound.hyper_prior.log_density_of_free(accepted) + log_evidence
    log_posterior = log_marginal + conditional.log_density(beta)
    log_posterior -= posterior.bound.parameter_prior.normalisation.log_value
    return _ProposedBlock(accepted, beta, log_posterior, free, log_density)


def _propose_unrestricted(
    posterior: HyperPosterior, envelope: _Envelope, rng: np.random.Generator
) -> _ProposedBlock:
    """Propose values of the hyper-parameters φ; return the accepted φ with draws of parameters β.

    Compliances may be negative. φ is drawn from ``envelope`` and accepted with a
    probability proportional to its weight, which is the posterior density of φ divided by the
    density of the proposal. A φ of large weight may be accepted several times (`_accept`), each
    time with another β.
    """
    free, log_envelope = envelope.propose(rng)
    log_evidence, conditional = posterior.given(free)
    log_marginal = posterior.bound.hyper_prior.log_density_of_free(free) + log_evidence
    index = _accept(log_marginal - log_envelope, rng)
    accepted = conditional.select(index)
    beta = accepted.from_standard(rng.standard_normal((len(index), conditional.mean.shape[1])))
    log_posterior = log_marginal[index] + accepted.log_density(beta)
    return _ProposedBlock(free[index], beta, log_posterior, free, log_marginal)


def _propose_by_rejection(
    posterior: HyperPosterior, envelope: _Envelope, rng: np.random.Generator
) -> _ProposedBlock:
    """Propose values of the hyper-parameters φ; return the accepted φ with draws of parameters β.

    Compliances must not be negative. φ is drawn from ``envelope``, in coordinates
    without bounds, such as logarithms of standard deviations. For each φ, several β are drawn
    without regard to negative compliances. The weight of φ is proportional to its posterior density
    divided by the density of the proposal, times the share of these β that have no negative
    compliance. If the weight is below one, φ is accepted with a probability equal to the weight. If
    the weight is larger, φ may be accepted several times (`_accept`), each time with another β. One
    of the β without negative compliance is returned for each accepted φ.
    """
    tries = int(np.ceil(_EXPECTED_INSIDE / envelope.share_inside))
    free, log_envelope = envelope.propose(rng)
    log_evidence, conditional = posterior.given(free)
    log_marginal = posterior.bound.hyper_prior.log_density_of_free(free) + log_evidence
    draws = _draw_standard(conditional, tries, rng)
    with np.errstate(divide="ignore"):
        log_relative_share = np.log(draws.usable / tries / envelope.share_inside)
    index = _accept(log_marginal - log_envelope + log_relative_share, rng)
    # A value of φ may be accepted several times. Each time, it is returned with the next usable
    # draw of β; if there is none left, a new draw is made. ``repetition`` is the number of times
    # that the same φ has been accepted before. A draw is usable if it has no negative compliance.
    # ``draws.standard`` holds the draws of β as standard normal coordinates, and ``draws.usable``
    # the number of usable draws for each φ. The usable draws come before the other draws.
    repetition = np.arange(len(index)) - np.searchsorted(index, index)
    accepted = conditional.select(index)
    z = draws.standard[index, np.minimum(repetition, draws.usable[index] - 1)]
    beta = accepted.from_standard(z)
    is_missing = repetition >= draws.usable[index]
    if is_missing.any():
        # Another generator, so that the draws that follow do not depend on the number of new draws.
        beta[is_missing] = draw_parameters_given(
            posterior.bound, free[index[is_missing]], rng.spawn(1)[0]
        )
    log_posterior = log_marginal[index] + accepted.log_density(beta)
    log_posterior -= posterior.bound.parameter_prior.normalisation.log_value
    return _ProposedBlock(free[index], beta, log_posterior, free, log_marginal)


def _accept(log_weight: Array, rng: np.random.Generator) -> Index:
    """Return the indices of the accepted draws among n draws, in ascending order.

    ``log_weight``, shape (n,), holds the logarithms of the weights of the draws. A draw with a
    weight below one is accepted with a probability equal to its weight. A draw with a larger weight
    may be accepted several times. On average, the number of times that an index occurs equals the
    weight of the draw.
    """
    weight = np.exp(log_weight)
    rounded_up = rng.random(len(weight)) < weight % 1.0
    return np.repeat(np.arange(len(weight)), (np.floor(weight) + rounded_up).astype(int))


class _StandardDraws(NamedTuple):
    """Random draws of the p parameters, in coordinates in which they are standard normal.

    There are several draws for each of w values of the hyper-parameters, the usable ones first.
    """

    #: random draws of p parameters, in coordinates in which they are standard normal, for each of w
    #: values of the hyper-parameters, shape (w, tries, p); usable draws come first
    standard: Array
    #: number of usable draws, those without a negative compliance, for each of w values of the
    #: hyper-parameters, shape (w,)
    usable: Array


def _draw_standard(
    conditional: ParameterConditional, tries: int, rng: np.random.Generator
) -> _StandardDraws:
    """Return random draws of the parameters in coordinates in which they are standard normal.

    In these coordinates, the Gaussian density of the p parameters given the hyper-parameters is
    N(0, I). ``conditional`` holds the Gaussian densities for w values of the hyper-parameters. For
    each value, ``tries`` draws are made. Only draws without a negative compliance are usable.
    """
    z = rng.standard_normal((len(conditional.mean), tries, conditional.mean.shape[1]))
    rows = conditional.physical.rows
    spread = np.swapaxes(conditional.spread(rows), 1, 2)
    compliance = z @ spread + (conditional.mean @ rows.T)[:, None]
    is_usable = (compliance >= 0.0).all(axis=2)
    usable_first = np.argsort(~is_usable, axis=1, kind="stable")
    return _StandardDraws(
        np.take_along_axis(z, usable_first[:, :, None], axis=1), is_usable.sum(axis=1)
    )
