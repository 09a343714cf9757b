"""Priors of the hyper-parameters φ, and the coordinates in which φ are sampled.

The h hyper-parameters are the scales of the noise and of other effects on the readings.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc, erfcinv, expit, gammainccinv, gammaln, log_expit, ndtr, ndtri

from ldbb_bayes.model.terms.columns import Hyper, Law
from ldbb_bayes.results import Array

__all__ = ["HyperPrior"]


# Lower bound of the decay, the power by which the amplitude of form error falls with its order.
_LEAST_DECAY = 0.5


# Upper bound of the decay, the power by which the amplitude of form error falls with its order.
_MOST_DECAY = 3.5


# Shape a of the prior InvGamma(a, b) of λ², where λ is the factor on the noise of one circle.
_SHAPE = 1.5


# Rate b of the prior InvGamma(a, b) of λ², where λ is the factor on the noise of one circle.
_RATE = 1.5


@dataclass(frozen=True, eq=False)
class HyperPrior:
    """Independent prior densities of the h hyper-parameters, each with one of three laws.

    A length [mm] is half-normal with ``scale`` and not less than ``lower``. A decay, the power by
    which the amplitude of form falls with its order, is Normal(``scale``, ``decay_sd``) restricted
    to [0.5, 3.5]. The noise factor λ of a circle has λ² ~ InvGamma(3/2, 3/2). Decay and λ have no
    unit.
    """

    names: tuple[Hyper, ...]
    #: scale of each half-normal prior [mm], or prior mean of a decay, shape (h,)
    scale: Array
    lower: Array  #: lower bound of each of the h hyper-parameters [mm], shape (h,)
    laws: tuple[Law, ...]
    decay_sd: float

    @cached_property
    def in_mm(self) -> NDArray[np.bool_]:
        """Whether each of the h hyper-parameters is a length, shape (h,)."""
        return np.array([law == "half-normal" for law in self.laws])

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each hyper-parameter: mm, or empty text for a number without unit."""
        return tuple("mm" if length else "" for length in self.in_mm)

    @property
    def shown(self) -> Array:
        """Factors from internal to displayed values of the h hyper-parameters, shape (h,).

        Lengths are displayed in µm instead of mm.
        """
        return np.where(self.in_mm, 1e3, 1.0)

    def named(self, phi: Array) -> dict[str, float]:
        """Return the values of the h hyper-parameters by name, with lengths in µm.

        ``phi`` (h,) holds them in internal units, with lengths in mm.
        """
        return dict(zip(self.names, (phi * self.shown).tolist(), strict=True))

    @cached_property
    def _decay(self) -> NDArray[np.bool_]:
        return np.array([law == "decay" for law in self.laws])

    @cached_property
    def _is_noise_factor(self) -> NDArray[np.bool_]:
        return np.array([law == "circle" for law in self.laws])

    @property
    def bounds(self) -> Array:
        """Least and greatest value of each hyper-parameter, shape (h, 2)."""
        low = np.where(self._decay, _LEAST_DECAY, self.lower)
        high = np.where(self._decay, _MOST_DECAY, np.inf)
        return np.stack([low, high], axis=1)

    def log_density(self, phi: Array) -> Array:
        """Return the log prior density of hyper-parameters φ (..., h), shape (...).

        It is −inf where one of them is outside its bounds, or a noise factor is not positive.
        """
        total = self._log_density_of_lengths(phi[..., self.in_mm])
        if self._decay.any():
            total = total + self._log_density_of_decay(phi[..., self._decay])
        if self._is_noise_factor.any():
            total = total + self._log_density_of_noise_factors(phi[..., self._is_noise_factor])
        return np.asarray(total)

    def _log_density_of_lengths(self, length: Array) -> Array:
        scale = self.scale[self.in_mm]
        with np.errstate(over="ignore"):
            quadratic = -0.5 * (length / scale) ** 2
        constant = 0.5 * np.log(2.0 / np.pi) - np.log(scale) - np.log(self._mass)
        inside = length >= self.lower[self.in_mm]
        total: Array = np.where(inside, quadratic + constant, -np.inf).sum(axis=-1)
        return total

    def _log_density_of_decay(self, decay: Array) -> Array:
        low, high = self._decay_levels
        white = (decay - self.scale[self._decay]) / self.decay_sd
        constant = -np.log(self.decay_sd * np.sqrt(2.0 * np.pi) * (high - low))
        inside = (decay >= _LEAST_DECAY) & (decay <= _MOST_DECAY)
        total: Array = np.where(inside, constant - 0.5 * white**2, -np.inf).sum(axis=-1)
        return total

    def _log_density_of_noise_factors(self, noise_factor: Array) -> Array:
        constant = np.log(2.0) + _SHAPE * np.log(_RATE) - gammaln(_SHAPE)
        with np.errstate(divide="ignore", over="ignore"):
            precision = noise_factor**-2.0
            # The density is zero where the precision overflows.
            inside = (noise_factor > 0.0) & np.isfinite(precision)
            precision = np.where(inside, precision, 1.0)
            power = (_SHAPE + 0.5) * np.log(precision)
        density = np.where(inside, constant + power - _RATE * precision, -np.inf)
        total: Array = density.sum(axis=-1)
        return total

    def free(self, phi: Array) -> Array:
        """Return unbounded coordinates of hyper-parameters φ, shape (..., h).

        The coordinate is ln(φ − lower), where ``lower`` is the lower bound. For a decay (a power
        within bounds) it is the logit of its position between the bounds.
        """
        with np.errstate(divide="ignore"):
            free = np.log(phi - self.lower)
            decay = phi[..., self._decay]
            free[..., self._decay] = np.log((decay - _LEAST_DECAY) / (_MOST_DECAY - decay))
        return free

    def phi(self, free: Array) -> Array:
        """Return the hyper-parameters for unbounded coordinates (see `free`), shape (..., h)."""
        with np.errstate(over="ignore"):
            phi = self.lower + np.exp(free)
        share = expit(free[..., self._decay])
        phi[..., self._decay] = _LEAST_DECAY + (_MOST_DECAY - _LEAST_DECAY) * share
        return phi

    def log_density_of_free(self, free: Array) -> Array:
        """Return the log prior density with respect to unbounded coordinates, shape (...).

        The coordinates (see `free`) have shape (..., h). The density includes the Jacobian of the
        transformation from the hyper-parameters.
        """
        jacobian = free[..., ~self._decay].sum(axis=-1)
        logit = free[..., self._decay]
        if logit.shape[-1]:
            slope = np.log(_MOST_DECAY - _LEAST_DECAY) + log_expit(logit) + log_expit(-logit)
            jacobian = jacobian + slope.sum(axis=-1)
        return np.asarray(self.log_density(self.phi(free)) + jacobian)

    @cached_property
    def _mass(self) -> Array:
        """Probability that each half-normal hyper-parameter, if unrestricted, exceeds its bound."""
        return np.asarray(erfc(self.lower[self.in_mm] / self.scale[self.in_mm] / np.sqrt(2.0)))

    @cached_property
    def _decay_levels(self) -> Array:
        """Probabilities of the decay's unrestricted normal prior below each of its two bounds.

        The decay is the power by which the amplitude of form falls with its order. Shape (2, 1).
        """
        limits = np.array([[_LEAST_DECAY], [_MOST_DECAY]])
        return np.asarray(ndtr((limits - self.scale[self._decay]) / self.decay_sd))

    def draw(self, size: int, rng: np.random.Generator) -> Array:
        """Return random draws of the h hyper-parameters from the prior, shape (size, h)."""
        return self.quantile(rng.random((size, len(self.names))))

    def quantile(self, level: Array) -> Array:
        """Return the prior quantiles of every hyper-parameter, shape (..., h).

        Parameters
        ----------
        level
            Probabilities in [0, 1], shape (..., h), or (..., 1) to use one for all.
        """
        level = np.broadcast_to(level, (*level.shape[:-1], len(self.names)))
        phi = np.empty(level.shape)
        length = erfcinv((1.0 - level[..., self.in_mm]) * self._mass)
        phi[..., self.in_mm] = self.scale[self.in_mm] * np.sqrt(2.0) * length
        low, high = self._decay_levels
        standard_normal = ndtri(low + (high - low) * level[..., self._decay])
        decay = self.scale[self._decay] + self.decay_sd * standard_normal
        phi[..., self._decay] = np.clip(decay, _LEAST_DECAY, _MOST_DECAY)
        noise_level = level[..., self._is_noise_factor]
        phi[..., self._is_noise_factor] = np.sqrt(_RATE / gammainccinv(_SHAPE, noise_level))
        return phi

    @property
    def sd(self) -> Array:
        """Prior standard deviations of the hyper-parameters, shape (h,)."""
        centre = np.where(self._decay, self.scale, 0.0)
        spread = np.where(self._decay, self.decay_sd, self.scale)
        edges = (self.bounds - centre[:, None]) / spread[:, None]
        mass = -np.diff(ndtr(-edges))
        density = np.exp(-0.5 * edges**2) / np.sqrt(2.0 * np.pi)
        moments = np.diff([density, np.where(density > 0.0, edges, 0.0) * density]) / mass
        variance = 1.0 - moments[1, :, 0] - moments[0, :, 0] ** 2
        mean = np.sqrt(_RATE) * np.exp(gammaln(_SHAPE - 0.5) - gammaln(_SHAPE))
        noise_factor_sd = np.sqrt(_RATE / (_SHAPE - 1.0) - mean**2)
        return np.where(self._is_noise_factor, noise_factor_sd, spread * np.sqrt(variance))

    def starts(self, level: Array) -> Array:
        """Return starting points for the search of the posterior's maximum, shape (..., h).

        They are in unbounded coordinates (see `free`). ``level`` in [0, 1] chooses a point: for
        lengths, 0 gives large values and 1 small ones.
        """
        reach = np.where(self.lower > 0.0, 12.0, 6.0)
        inside = self.free(self.quantile(0.1 + 0.8 * level))
        return np.where(self.in_mm, np.log(2.0 * self.scale) - level * reach, inside)
