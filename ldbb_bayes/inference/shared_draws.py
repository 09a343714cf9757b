"""Exact random draws of the parameters together with the nuisances that tests share.

β are the p parameters: compliances, their changes with force, and geometric errors. φ are the
hyper-parameters, such as the standard deviation of the noise. Nuisances are effects that are
modelled but not of interest; u are the q coefficients of the nuisances that tests share. Given φ
and the readings y, the joint density p(u, β | y, φ) is Gaussian. Several draws from it cost little
more than a single draw. Draws of β with negative compliances can be excluded (truncation).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ldbb_bayes.inference.conditional_sampling import no_physical_draw
from ldbb_bayes.inference.integrals import CHUNK, Index
from ldbb_bayes.model.conditional import ParameterConditional
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = ["SharedDraws", "draw_with_shared"]

# A draw of the parameters with a negative compliance is replaced by a new draw from the same
# Gaussian density, at most this number of times. If a compliance is still negative, the parameters
# are drawn from a density that is shifted towards compliances that are not negative.
_PLAIN_TRIES = 4
# A draw of the parameters with a negative compliance may be replaced by a draw from a density that
# is shifted towards compliances that are not negative. If the sampler rejects the new draw, it
# makes another one. This is the largest number of such attempts.
_REPEATS = 20


class SharedDraws(NamedTuple):
    """Random draws of the hyper-parameters, the parameters and the shared nuisances.

    Shared nuisances are effects that are modelled but not of interest and that are common to
    several tests.
    """

    #: n random draws of the h hyper-parameters (such as the standard deviation of the noise), shape
    #: (n, h); values that are lengths are in mm
    phi: Array
    #: n random draws of the p parameters (compliances, their changes with force, geometric errors)
    #: in mm, N and rad, shape (n, p)
    beta: Array
    #: n random draws of the q shared nuisance coefficients, shape (n, q)
    shared: Array


def draw_with_shared(
    bound: BoundModel, free: Array, repeats: int, rng: np.random.Generator
) -> SharedDraws:
    """Return ``repeats`` draws of the parameters and shared nuisances for each of w values of φ.

    Shared nuisances are effects that are modelled but not of interest, with coefficients that are
    the same in all tests. Effects with separate coefficients for each test are not drawn. φ are the
    h hyper-parameters (such as the standard deviation of the noise); ``free``, shape (w, h), holds
    the w values of φ in unbounded coordinates, mostly ln(φ − lower bound). ``bound`` is the model
    of the campaign. The result has w × ``repeats`` draws; the draws for one value of φ are next to
    each other, and the result contains this value ``repeats`` times. A model may require all
    compliances to be at least zero; if no such draw is found, an `InputError` is raised.
    """
    p = len(bound.names)
    phi = bound.hyper_prior.phi(free)
    standard = []
    for start in range(0, len(phi), CHUNK):
        conditional = bound.given(phi[start : start + CHUNK]).parameters
        conditional.physical = bound.truncation
        standard.append(_draw_standard(conditional, repeats, rng))
    coefficients = bound.collapsed.draw_shared(phi, np.concatenate(standard), rng)
    flat = coefficients.reshape(-1, coefficients.shape[2])
    return SharedDraws(
        np.repeat(phi, repeats, axis=0), flat[:, -p:] + bound.least_squares_estimate, flat[:, :-p]
    )


def _draw_standard(
    conditional: ParameterConditional, repeats: int, rng: np.random.Generator
) -> Array:
    """Return random draws of the p parameters in standard coordinates, shape (w, repeats, p).

    For each of w values of the hyper-parameters, ``repeats`` draws are made. In standard
    coordinates the Gaussian density of the p parameters given the hyper-parameters is N(0, I). If
    the model excludes negative compliances, the draws contain none. ``conditional`` holds the
    densities of the parameters.
    """
    w, p = conditional.mean.shape
    standard = rng.standard_normal((w * repeats, p))
    if not conditional.physical.active:
        return standard.reshape(w, repeats, p)
    phi_index = np.repeat(np.arange(w), repeats)
    spread = np.swapaxes(conditional.spread(conditional.physical.rows), 1, 2)
    mean = conditional.mean @ conditional.physical.rows.T

    def is_outside(draws: Array, index: Index) -> Array:
        # Return for each random draw of the parameters whether a compliance is negative. ``index``
        # holds the indices of the values of the hyper-parameters to which the draws belong.
        compliances = np.einsum("np,npm->nm", draws, spread[index]) + mean[index]
        return (compliances < 0.0).any(axis=1)

    missing = np.flatnonzero(is_outside(standard, phi_index))
    for _ in range(_PLAIN_TRIES):
        draws = rng.standard_normal((len(missing), p))
        standard[missing] = draws
        missing = missing[is_outside(draws, phi_index[missing])]
    for _ in range(_REPEATS):
        if not missing.size:
            break
        orthant = conditional.select(phi_index[missing]).orthant
        standard[missing], accepted = orthant.draw_standard(rng)
        missing = missing[~accepted]
    if missing.size:
        raise no_physical_draw()
    return standard.reshape(w, repeats, p)
