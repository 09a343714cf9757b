"""Scatter of a new circle, learnt from the scatter of the measured circles.

The noise factor λ of a circle multiplies the circle's set-up shift (of zero and centre) and its
discrepancy (unexplained deviations). The prior of λ, λ² ~ InvGamma(a, a) with a = 3/2, has heavy
tails, so that one unusual measured circle hardly changes the compliances. Most circles of one
machine, however, scatter by a similar amount. If λ of a new circle were drawn from this prior, the
predicted band of the new circle's readings would be too wide. The shape a is therefore learnt from
the R measured circles. A few values of a are considered, with prior probabilities p(a). Each
posterior draw of the noise factors λ_1 … λ_R of the measured circles gives the probabilities

    p(a | λ_1 … λ_R) ∝ p(a) Π InvGamma(λ_r²; a, a).

A value of a is drawn with these probabilities, and λ² of the new circle is then drawn from
InvGamma(a, a). The model and its posterior are not changed.

The draws of λ come from a posterior that assumes a = 3/2. If there are few circles, the readings
determine each λ poorly. The probabilities of a then favour 3/2, and bands are wider than necessary:
by about a tenth if the circles scatter alike (studies/92_peers).
"""

from __future__ import annotations

import numpy as np
from scipy.special import gammaln, softmax

from ldbb_bayes.results import Array

__all__ = ["draw_new_noise_factors", "shape_probabilities"]

# Values of the shape a that are considered for the density InvGamma(a, a) of λ², where λ is the
# noise factor of a circle (the factor that multiplies its noise). The first value is the shape in
# the model's prior. With a large a, the noise factors of all circles are similar.
_SHAPES = np.array([1.5, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 40.0])
# Prior probability of the first shape a in ``_SHAPES``; all other shapes have equal prior
# probabilities. The square of a circle's noise factor (the factor that multiplies its noise) has
# the density InvGamma(a, a), whose tails are heaviest for the first shape. The prior probability of
# this shape is large, so that a few circles with a similar scatter cannot rule out that the next
# circle is unusual.
_FIRST_PROBABILITY = 0.5


def draw_new_noise_factors(noise_factors: Array, rng: np.random.Generator) -> Array:
    """Return random noise factors λ of a new circle, one for each of n posterior draws, shape (n,).

    λ multiplies two random effects on a circle: its set-up shift (of zero and centre) and its
    discrepancy (unexplained deviations). ``noise_factors``, shape (n, R), holds the noise factors
    of the R measured circles in each posterior draw.
    """
    cumulative = shape_probabilities(noise_factors).cumsum(axis=1)
    levels = rng.random((len(noise_factors), 1))
    chosen = np.minimum((cumulative < levels).sum(axis=1), len(_SHAPES) - 1)
    shapes = _SHAPES[chosen]
    return np.asarray(np.sqrt(shapes / rng.standard_gamma(shapes)))


def shape_probabilities(noise_factors: Array) -> Array:
    """Return the probability of each shape a in ``_SHAPES``, for each of n posterior draws.

    The shape a is the parameter of the density InvGamma(a, a) of λ², where λ is the noise factor of
    a circle (the factor that multiplies its noise). ``noise_factors``, shape (n, R), holds the
    noise factors of the R measured circles in each posterior draw. The result has one row for each
    draw and one column for each value in ``_SHAPES``.
    """
    prior = np.full(len(_SHAPES), (1.0 - _FIRST_PROBABILITY) / (len(_SHAPES) - 1))
    prior[0] = _FIRST_PROBABILITY
    log_square = 2.0 * np.log(noise_factors).sum(axis=1)[:, None]
    inverse_square = (noise_factors**-2.0).sum(axis=1)[:, None]
    constant = noise_factors.shape[1] * (_SHAPES * np.log(_SHAPES) - gammaln(_SHAPES))
    log_density = constant - (_SHAPES + 1.0) * log_square - _SHAPES * inverse_square
    return np.asarray(softmax(np.log(prior) + log_density, axis=1))
