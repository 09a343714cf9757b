"""Priors of the hyper-parameters φ, and the unbounded coordinates in which φ are sampled.

The h hyper-parameters are of three kinds: lengths, which are the scales (standard deviations) of
the noise and of other effects on the readings; the decay p, where the prior sd of a form error of
order n is proportional to n^(−p); and noise factors λ, each of which multiplies the noise of one
circle. Decay and λ have no unit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import (
    erfc,
    erfcinv,
    expit,
    gammaincc,
    gammainccinv,
    gammaln,
    log_expit,
    ndtr,
    ndtri,
)

from ldbb_bayes.model.terms.columns import Hyper, Law
from ldbb_bayes.results import Array

__all__ = ["HyperPrior"]

# Lower bound of the decay p.
_LEAST_DECAY = 0.5
# Upper bound of the decay p.
_MOST_DECAY = 3.5
# Shape parameter of the inverse gamma prior of λ².
_SHAPE = 1.5
# Rate parameter of the inverse gamma prior of λ².
_RATE = 1.5
# A model may take the values of its hyper-parameters from another model. If the other model lacks a
# hyper-parameter that is a key of this dict, the value of its substitute is taken. A model lacks
# the scale ω of the machine's pattern (geometric and cyclic errors of higher orders) if no ball is
# clocked (turned in its socket between tests) and no ball is certified. The pattern is then
# included in the form errors of the balls, so that their scale τ is the substitute for ω.
_PREDECESSORS: Mapping[Hyper, Hyper] = {"omega": "tau"}


@dataclass(frozen=True, eq=False)
class HyperPrior:
    """Independent prior densities of the h hyper-parameters, which are of three kinds (``laws``).

    - A length has a half-normal prior with the scale ``scale`` [mm], truncated to values of at
      least ``lower`` [mm].
    - A decay p has the prior Normal(``scale``, ``decay_sd``), truncated to [0.5, 3.5].
    - The square of a noise factor λ has an inverse gamma prior, λ² ~ InvGamma(3/2, 3/2).
    """

    names: tuple[Hyper, ...]
    #: scale of the prior of each length [mm], and prior mean of the decay, shape (h,); not used for
    #: noise factors
    scale: Array
    #: lower bound of each length [mm], shape (h,); not used for the decay
    lower: Array
    laws: tuple[Law, ...]
    decay_sd: float

    @cached_property
    def in_mm(self) -> NDArray[np.bool_]:
        """Whether each of the h hyper-parameters is a length, such as the sd of the noise.

        The array has the shape (h,).
        """
        return np.array([law == "half-normal" for law in self.laws])

    @property
    def units(self) -> tuple[str, ...]:
        """Internal unit of each hyper-parameter: mm, or an empty string if it has no unit."""
        return tuple("mm" if length else "" for length in self.in_mm)

    @property
    def display_factors(self) -> Array:
        """Factors that convert internal values of the hyper-parameters to displayed values.

        The factor is 1000 for lengths, which are displayed in µm instead of mm, and 1 for numbers
        without unit.
        """
        return np.where(self.in_mm, 1e3, 1.0)

    def display_values(self, phi: Array) -> dict[str, float]:
        """Return a dict with the values of the h hyper-parameters, with lengths in µm.

        The keys are the names of the hyper-parameters. ``phi``, shape (h,), holds the values with
        lengths in mm.
        """
        return dict(zip(self.names, (phi * self.display_factors).tolist(), strict=True))

    def values_from(self, other: HyperPrior, phi: Array) -> Array:
        """Return values of this model's hyper-parameters, taken from another model, shape (..., h).

        This model has h hyper-parameters. ``other`` is the prior of the other model, and ``phi``
        holds values of the other model's hyper-parameters along its last dimension. Each of the h
        hyper-parameters is set to the value of the hyper-parameter of the same name in ``other``.
        If ``other`` lacks the scale ω of the machine's pattern (geometric and cyclic errors of
        higher orders), ω is set to the scale τ of the balls' form errors, which include the pattern
        in this case. All further hyper-parameters that ``other`` lacks are set to their prior
        medians. Lengths are in mm.
        """
        median = self.quantile(np.full(len(self.names), 0.5))
        values = np.broadcast_to(median, (*phi.shape[:-1], len(self.names))).copy()
        for k, name in enumerate(self.names):
            source = name
            if name not in other.names:
                source = _PREDECESSORS.get(name, name)
            if source in other.names:
                values[..., k] = phi[..., other.names.index(source)]
        return values

    @cached_property
    def _is_decay(self) -> NDArray[np.bool_]:
        """Whether each of the h hyper-parameters is a decay, shape (h,)."""
        return np.array([law == "decay" for law in self.laws])

    @cached_property
    def _is_noise_factor(self) -> NDArray[np.bool_]:
        """Whether each of the h hyper-parameters is a noise factor, shape (h,)."""
        return np.array([law == "circle" for law in self.laws])

    @property
    def bounds(self) -> Array:
        """Lower and upper bound of each of the h hyper-parameters, shape (h, 2).

        Lengths are in mm. The upper bound is infinite for lengths and for factors that multiply the
        noise of a circle.
        """
        low = np.where(self._is_decay, _LEAST_DECAY, self.lower)
        high = np.where(self._is_decay, _MOST_DECAY, np.inf)
        return np.stack([low, high], axis=1)

    def log_density(self, phi: Array) -> Array:
        """Return the log of the joint prior density of hyper-parameters φ, shape (...).

        ``phi``, shape (..., h), holds the h hyper-parameters, with lengths in mm. The log density
        is −inf where one of the hyper-parameters is outside its bounds, or a factor that multiplies
        the noise of a circle is not positive.
        """
        total = self._log_density_of_lengths(phi[..., self.in_mm])
        if self._is_decay.any():
            total = total + self._log_density_of_decay(phi[..., self._is_decay])
        if self._is_noise_factor.any():
            total = total + self._log_density_of_noise_factors(phi[..., self._is_noise_factor])
        return np.asarray(total)

    def _log_density_of_lengths(self, length: Array) -> Array:
        """Return the log of the joint prior density of the lengths, shape (...).

        ``length``, shape (..., lengths), holds the lengths in mm.
        """
        scale = self.scale[self.in_mm]
        with np.errstate(over="ignore"):
            quadratic = -0.5 * (length / scale) ** 2
        constant = 0.5 * np.log(2.0 / np.pi) - np.log(scale) - np.log(self._mass_above_bound)
        inside = length >= self.lower[self.in_mm]
        total: Array = np.where(inside, quadratic + constant, -np.inf).sum(axis=-1)
        return total

    def _log_density_of_decay(self, decay: Array) -> Array:
        """Return the log of the joint prior density of the decays, shape (...).

        ``decay`` has the shape (..., decays).
        """
        low, high = self._decay_levels
        white = (decay - self.scale[self._is_decay]) / self.decay_sd
        constant = -np.log(self.decay_sd * np.sqrt(2.0 * np.pi) * (high - low))
        inside = (decay >= _LEAST_DECAY) & (decay <= _MOST_DECAY)
        total: Array = np.where(inside, constant - 0.5 * white**2, -np.inf).sum(axis=-1)
        return total

    def _log_density_of_noise_factors(self, noise_factor: Array) -> Array:
        """Return the log of the joint prior density of the noise factors λ, shape (...).

        ``noise_factor``, shape (..., circles), holds the factors.
        """
        constant = np.log(2.0) + _SHAPE * np.log(_RATE) - gammaln(_SHAPE)
        with np.errstate(divide="ignore", over="ignore"):
            precision = noise_factor**-2.0
            # If λ is so small that λ⁻² overflows, the density is set to zero.
            inside = (noise_factor > 0.0) & np.isfinite(precision)
            precision = np.where(inside, precision, 1.0)
            power = (_SHAPE + 0.5) * np.log(precision)
        density = np.where(inside, constant + power - _RATE * precision, -np.inf)
        total: Array = density.sum(axis=-1)
        return total

    def log_density_of_log_noise(self, log_noise: Array) -> Array:
        """Return the log prior density of ln λ at values of ln λ, an array of the same shape."""
        with np.errstate(over="ignore"):
            noise_factor = np.exp(log_noise)[..., None]
        return self._log_density_of_noise_factors(noise_factor) + log_noise

    def free(self, phi: Array) -> Array:
        """Return unbounded coordinates of the h hyper-parameters φ, shape (..., h).

        ``phi``, shape (..., h), holds the hyper-parameters, with lengths in mm. The coordinate of a
        hyper-parameter is ln(φ − lower), where ``lower`` is its lower bound. The decay is bounded
        on both sides. Its coordinate is ln(s / (1 − s)), where s is its position between the
        bounds, from 0 to 1.
        """
        with np.errstate(divide="ignore"):
            free = np.log(phi - self.lower)
            decay = phi[..., self._is_decay]
            free[..., self._is_decay] = np.log((decay - _LEAST_DECAY) / (_MOST_DECAY - decay))
        return free

    def phi(self, free: Array) -> Array:
        """Return the h hyper-parameters for given unbounded coordinates, shape (..., h).

        ``free``, shape (..., h), holds the coordinates. The method `free` explains how they are
        computed from the hyper-parameters. Lengths in the result are in mm.
        """
        with np.errstate(over="ignore"):
            phi = self.lower + np.exp(free)
        share = expit(free[..., self._is_decay])
        phi[..., self._is_decay] = _LEAST_DECAY + (_MOST_DECAY - _LEAST_DECAY) * share
        return phi

    def log_density_of_free(self, free: Array) -> Array:
        """Return the log of the prior density of the unbounded coordinates, shape (...).

        ``free``, shape (..., h), holds the coordinates of the h hyper-parameters, mostly ln(value −
        lower bound); the method `free` defines them. The density includes the Jacobian of the
        transformation from coordinates to hyper-parameters.
        """
        jacobian = free[..., ~self._is_decay].sum(axis=-1)
        logit = free[..., self._is_decay]
        if logit.shape[-1]:
            slope = np.log(_MOST_DECAY - _LEAST_DECAY) + log_expit(logit) + log_expit(-logit)
            jacobian = jacobian + slope.sum(axis=-1)
        return np.asarray(self.log_density(self.phi(free)) + jacobian)

    @cached_property
    def _mass_above_bound(self) -> Array:
        """Probability that each length exceeds its lower bound under the prior before truncation.

        The result has the shape (lengths,).
        """
        return np.asarray(erfc(self.lower[self.in_mm] / self.scale[self.in_mm] / np.sqrt(2.0)))

    @cached_property
    def _decay_levels(self) -> Array:
        """Prior probabilities of values below the bounds of each decay, before the truncation.

        The result has the shape (2, decays): the first row belongs to the lower bound, and the
        second row to the upper bound.
        """
        limits = np.array([[_LEAST_DECAY], [_MOST_DECAY]])
        return np.asarray(ndtr((limits - self.scale[self._is_decay]) / self.decay_sd))

    def draw(self, size: int, rng: np.random.Generator) -> Array:
        """Return ``size`` random draws of the h hyper-parameters from the prior, shape (size, h).

        Lengths are in mm.
        """
        return self.quantile(rng.random((size, len(self.names))))

    @staticmethod
    def draw_noise_factor(size: int, rng: np.random.Generator) -> Array:
        """Return ``size`` random draws of a noise factor λ from its prior."""
        return np.asarray(np.sqrt(_RATE / rng.standard_gamma(_SHAPE, size)))

    def quantile(self, level: Array) -> Array:
        """Return the prior quantiles of the h hyper-parameters, shape (..., h).

        Quantiles of lengths are in mm.

        Parameters
        ----------
        level
            Probabilities of the quantiles in [0, 1]: one for each hyper-parameter, shape (..., h),
            or one for all hyper-parameters, shape (..., 1).
        """
        level = np.broadcast_to(level, (*level.shape[:-1], len(self.names)))
        phi = np.empty(level.shape)
        length = erfcinv((1.0 - level[..., self.in_mm]) * self._mass_above_bound)
        phi[..., self.in_mm] = self.scale[self.in_mm] * np.sqrt(2.0) * length
        low, high = self._decay_levels
        standard_normal = ndtri(low + (high - low) * level[..., self._is_decay])
        decay = self.scale[self._is_decay] + self.decay_sd * standard_normal
        phi[..., self._is_decay] = np.clip(decay, _LEAST_DECAY, _MOST_DECAY)
        noise_level = level[..., self._is_noise_factor]
        phi[..., self._is_noise_factor] = np.sqrt(_RATE / gammainccinv(_SHAPE, noise_level))
        return phi

    def level(self, phi: Array) -> Array:
        """Return the prior probability that each hyper-parameter is smaller than a given value.

        This is the inverse of `quantile`.

        Parameters
        ----------
        phi
            Values of the h hyper-parameters, shape (..., h), with lengths in mm.

        Returns
        -------
        Array
            Probability that each hyper-parameter is smaller than its value in ``phi``, shape
            (..., h).
        """
        level = np.empty(phi.shape)
        length = phi[..., self.in_mm] / self.scale[self.in_mm] / np.sqrt(2.0)
        level[..., self.in_mm] = 1.0 - erfc(length) / self._mass_above_bound
        low, high = self._decay_levels
        white = (phi[..., self._is_decay] - self.scale[self._is_decay]) / self.decay_sd
        level[..., self._is_decay] = (ndtr(white) - low) / (high - low)
        noise_factor = phi[..., self._is_noise_factor]
        level[..., self._is_noise_factor] = gammaincc(_SHAPE, _RATE / noise_factor**2)
        return np.clip(level, 0.0, 1.0)

    @property
    def sd(self) -> Array:
        """Prior standard deviations of the h hyper-parameters, shape (h,).

        Standard deviations of lengths are in mm; standard deviations of other hyper-parameters have
        no unit.
        """
        centre = np.where(self._is_decay, self.scale, 0.0)
        spread = np.where(self._is_decay, self.decay_sd, self.scale)
        edges = (self.bounds - centre[:, None]) / spread[:, None]
        mass = -np.diff(ndtr(-edges))
        density = np.exp(-0.5 * edges**2) / np.sqrt(2.0 * np.pi)
        moments = np.diff([density, np.where(density > 0.0, edges, 0.0) * density]) / mass
        variance = 1.0 - moments[1, :, 0] - moments[0, :, 0] ** 2
        mean = np.sqrt(_RATE) * np.exp(gammaln(_SHAPE - 0.5) - gammaln(_SHAPE))
        noise_factor_sd = np.sqrt(_RATE / (_SHAPE - 1.0) - mean**2)
        return np.where(self._is_noise_factor, noise_factor_sd, spread * np.sqrt(variance))

    def starts(self, level: Array) -> Array:
        """Return points from which the search for the posterior's maximum starts, shape (..., h).

        The points are given in the unbounded coordinates of the h hyper-parameters (method `free`).
        For most hyper-parameters, this coordinate is ln(value − lower bound). ``level``, shape
        (..., h), holds a number between 0 and 1 for each coordinate. For lengths, 0 selects a large
        and 1 a small value; for hyper-parameters without unit, 0 selects a small and 1 a large
        value.
        """
        reach = np.where(self.lower > 0.0, 12.0, 6.0)
        inside = self.free(self.quantile(0.1 + 0.8 * level))
        return np.where(self.in_mm, np.log(2.0 * self.scale) - level * reach, inside)
