"""y | β, σ ~ N(Jβ, σ²V): linear regression with a noise scale to be inferred, dense and free of any domain.

Column-scaled, pivoted QR and one singular value decomposition; nothing is inverted, no normal equations. Gamma(a, b) has shape a
and rate b. With a flat prior the posterior is what textbooks call least squares (Gelman et al., Bayesian Data Analysis, 3rd ed.,
sections 14.2 and 14.8).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg
import scipy.special
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError
from ldbb_bayes.model.gaussian import Gaussian, covariance_root, lower_root
from ldbb_bayes.model.normal_gamma import NormalGamma, check_between

__all__ = ["ScaleMixture", "ScaledLinearGaussian"]

Array = NDArray[Any]
_LOG_2 = float(np.log(2.0))
_LOG_2PI = float(np.log(2.0 * np.pi))
# A pivot this much smaller than the first has at most three digits above rounding.
_RANK_TOLERANCE = 1e-13
# e⁻⁴⁰ is below the rounding of a sum of one.
_NEGLIGIBLE = 40.0
_BISECTIONS = 64
_TINY = 1e-300


@dataclass(frozen=True, eq=False)
class ScaleMixture:
    """β | σ ~ N(centre + basis shift(σ), basis diag(spread(σ)²) basisᵀ), σ on k nodes: a posterior by quadrature over ln σ.

    Attributes
    ----------
    log_evidence : float
        ln p(y) [nat].
    sigma : ndarray, shape (k,)
        Nodes, equally spaced in ln σ [unit of y].
    weight : ndarray, shape (k,)
        Posterior probabilities of the nodes; they sum to one.
    centre : ndarray, shape (p,)
    basis : ndarray, shape (p, p)
        Axes along which J leaves the coefficients independent, whatever σ.
    shift, spread : ndarray, shape (k, p)
        Means and standard deviations along the axes.
    """

    log_evidence: float
    sigma: Array
    weight: Array
    centre: Array
    basis: Array
    shift: Array
    spread: Array

    @property
    def mean(self) -> Array:
        """Posterior mean of β, shape (p,)."""
        return self.centre + self.basis @ (self.weight @ self.shift)

    @property
    def covariance(self) -> Array:
        """Posterior covariance of β, shape (p, p)."""
        within = self.basis * np.sqrt(self.weight @ self.spread**2)
        between = np.sqrt(self.weight)[:, None] * (self.shift - self.weight @ self.shift) @ self.basis.T
        return within @ within.T + between.T @ between

    @property
    def sd(self) -> Array:
        """Posterior standard deviations of β, shape (p,)."""
        return np.sqrt(np.diag(self.covariance))

    def interval(self, prob: float) -> Array:
        """Equal-tailed marginal intervals of β of probability ``prob``, shape (2, p): lower and upper ends."""
        check_between("prob", prob, 1.0, "Give 0.95 for 95 %.")
        tail = 0.5 - 0.5 * prob
        return np.stack([self._quantile(tail), self._quantile(1.0 - tail)])

    def log_density(self, beta: Array) -> float:
        """ln p(β | y), σ integrated out; too low in tails that only σ of probability below e⁻⁴⁰ would reach."""
        white = (np.linalg.solve(self.basis, beta - self.centre) - self.shift) / self.spread
        log_given = -0.5 * (white**2).sum(axis=1) - np.log(self.spread).sum(axis=1)
        log_volume = np.linalg.slogdet(self.basis)[1] + 0.5 * len(beta) * _LOG_2PI
        return float(scipy.special.logsumexp(log_given + np.log(self.weight)) - log_volume)

    def draw(self, size: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """Independent draws of β and of σ (on the nodes), shapes (size, p) and (size,)."""
        node = rng.choice(len(self.sigma), size, p=self.weight)
        along = self.shift[node] + self.spread[node] * rng.standard_normal((size, len(self.centre)))
        return self.centre + along @ self.basis.T, self.sigma[node]

    def _quantile(self, prob: float) -> Array:
        """Marginal quantiles, shape (p,), by bisection between the extremes of the components' own."""
        mean, sd = self.centre + self.shift @ self.basis.T, np.sqrt(self.spread**2 @ (self.basis**2).T)
        component = mean + sd * scipy.special.ndtri(prob)
        low, high = component.min(axis=0), component.max(axis=0)
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            below = self.weight @ scipy.special.ndtr((middle - mean) / sd) < prob
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return 0.5 * (low + high)


@dataclass(frozen=True, eq=False)
class ScaledLinearGaussian:
    """y | β, σ ~ N(Jβ, σ²V), both β and σ to be inferred, under one of three priors.

    | prior | p(β, σ) | posterior |
    |---|---|---|
    | flat | ∝ 1/σ | `flat_posterior(y)` |
    | normal–gamma | β given σ ~ N(m, σ²S), 1/σ² ~ Gamma(a, b) | `normal_gamma_posterior(y, prior)` |
    | normal | β ~ N(m, S), 1/σ² ~ Gamma(a, b), independent | `normal_posterior(y, prior, shape=a, rate=b)` |

    Attributes
    ----------
    jacobian : ndarray, shape (n, p)
        J.
    relative_noise : ndarray, shape (n, n), or (n,) variances, optional
        V; default: the identity.

    Raises
    ------
    InputError
        For shapes that do not fit or a V that is not positive definite.
    """

    jacobian: Array
    relative_noise: Array | None = None

    def __post_init__(self) -> None:
        if self.jacobian.ndim != 2 or self.jacobian.size == 0 or not np.isfinite(self.jacobian).all():
            raise InputError(
                f"jacobian must be finite, of shape (n, p), n and p > 0, got shape {self.jacobian.shape}. Give a row per value."
            )
        n = len(self.jacobian)
        if self.relative_noise is not None and self.relative_noise.shape not in ((n,), (n, n)):
            raise InputError(
                f"relative_noise must have shape ({n},) or ({n}, {n}), got {self.relative_noise.shape}. Check the sizes."
            )

    def likelihood(self, beta: Array, sigma: float) -> Gaussian:
        """p(y | β, σ)."""
        return Gaussian(self.jacobian @ beta, sigma * self._noise_root)

    def flat_posterior(self, y: Array) -> NormalGamma:
        """p(β, σ | y) under p(β, σ) ∝ 1/σ: β is Student-t with n − p degrees of freedom about least squares, scale s² (JᵀV⁻¹J)⁻¹.

        Raises
        ------
        InputError
            Without more observations than columns, for columns that depend on each other, or where y is fitted exactly: there is
            no such posterior.
        """
        n, p = self.jacobian.shape
        white, reading = self._whiten(self.jacobian), self._whiten(self._checked(y))
        if n <= p:
            raise InputError(f"y must have more than {p} values under a flat prior, got {n}. Add values or give a proper prior.")
        unit = _powers_of_two(white)
        pivots, order = scipy.linalg.qr(white * unit, mode="r", pivoting=True)
        if abs(pivots[p - 1, p - 1]) <= _RANK_TOLERANCE * abs(pivots[0, 0]):
            raise InputError(
                "jacobian must have independent columns under a flat prior, "
                f"got column {order[-1]} (counted from 0) that follows from the others. Drop a column or give a proper prior."
            )
        triangle = np.asarray(np.linalg.qr(np.column_stack([(white * unit)[:, order], reading]), mode="r"))
        estimate, spread = np.empty(p), np.empty((p, p))
        estimate[order] = scipy.linalg.solve_triangular(triangle[:p, :p], triangle[:p, p])
        spread[order] = scipy.linalg.solve_triangular(triangle[:p, :p], np.eye(p))
        residual = float(abs(triangle[p, p]))
        if residual == 0.0:
            raise InputError("y must not be fitted exactly under a flat prior, got no residual at all. Give a proper prior.")
        return NormalGamma(unit * estimate, lower_root(unit[:, None] * spread), 0.5 * (n - p), 0.5 * residual**2)

    def normal_gamma_posterior(self, y: Array, prior: NormalGamma) -> NormalGamma:
        """p(β, σ | y) under a normal–gamma prior, from the QR factors of the whitened stack [V^-½ J S^½; I]."""
        n, p = self.jacobian.shape
        scaled, residual = self._about(y, prior.mean, prior.root)
        stack = np.vstack([np.column_stack([scaled, residual]), np.eye(p, p + 1)])
        triangle = np.asarray(np.linalg.qr(stack, mode="r"))
        shift = scipy.linalg.solve_triangular(triangle[:p, :p], triangle[:p, p])
        spread = scipy.linalg.solve_triangular(triangle[:p, :p], np.eye(p))
        shape, rate = prior.shape + 0.5 * n, prior.rate + 0.5 * float(triangle[p, p]) ** 2
        return NormalGamma(prior.mean + prior.root @ shift, lower_root(prior.root @ spread), shape, rate)

    def normal_gamma_log_evidence(self, y: Array, prior: NormalGamma) -> float:
        """ln p(y) under a normal–gamma prior [nat]."""
        posterior = self.normal_gamma_posterior(y, prior)
        return posterior.log_normalizer - prior.log_normalizer - self._log_constant

    def normal_posterior(self, y: Array, prior: Gaussian, *, shape: float, rate: float) -> ScaleMixture:
        """p(β, σ | y) under β ~ N(m, S) and, independent of it, 1/σ² ~ Gamma(shape, rate).

        Not conjugate. Along the singular vectors of V^-½ J S^½ the coefficients are independent given σ, so each σ costs O(p);
        σ is integrated by the trapezoidal rule in ln σ, which converges geometrically (Trefethen and Weideman, SIAM Review 56,
        2014).

        Parameters
        ----------
        y : ndarray, shape (n,)
        prior : Gaussian
            Of β.
        shape, rate : float
            Of the Gamma density of 1/σ²; σ is near (rate / shape)^½ [unit of y], to about 1 part in 2 shape^½.
            Known closer than to 1 part in 10⁴, it belongs in a LinearGaussian: rounding grows with shape.
        """
        for name, value in (("shape", shape), ("rate", rate)):
            check_between(name, value, np.inf, "A small one makes a vague prior.")
        n, p = self.jacobian.shape
        scaled, residual = self._about(y, prior.mean, prior.root)
        left, stretch, right = np.linalg.svd(scaled, full_matrices=n < p)
        along = left.T @ residual
        outside = float(np.sum((residual - left @ along) ** 2))
        integrand = _ScaleIntegrand(shape + 0.5 * n, rate + 0.5 * outside, stretch, along)
        log_sigma, log_values, step = integrand.nodes()
        top = log_values.max()
        weight, sigma = np.exp(log_values - top), np.exp(log_sigma)
        log_prior = _LOG_2 + shape * np.log(rate) - scipy.special.gammaln(shape)
        stretch, along = (np.pad(array, (0, p - len(array))) for array in (stretch, along))
        total = sigma[:, None] ** 2 + stretch**2
        return ScaleMixture(
            log_evidence=float(top + np.log(step * weight.sum()) + log_prior) - self._log_constant,
            sigma=sigma,
            weight=weight / weight.sum(),
            centre=prior.mean,
            basis=prior.root @ right.T,
            shift=stretch * along / total,
            spread=sigma[:, None] / np.sqrt(total),
        )

    @cached_property
    def _noise_root(self) -> Array:
        n = len(self.jacobian)
        return np.eye(n) if self.relative_noise is None else covariance_root(self.relative_noise, "relative_noise")

    @property
    def _log_constant(self) -> float:
        """ln of (2π)^(n/2) |V|^½."""
        log_root = 0.0 if self.relative_noise is None else np.log(np.diag(self._noise_root)).sum()
        return float(0.5 * len(self.jacobian) * _LOG_2PI + log_root)

    def _whiten(self, array: Array) -> Array:
        if self.relative_noise is None:
            return array
        return np.asarray(scipy.linalg.solve_triangular(self._noise_root, array, lower=True))

    def _about(self, y: Array, mean: Array, root: Array) -> tuple[Array, Array]:
        """V^-½ J S^½ and V^-½ (y − J m)."""
        if len(mean) != self.jacobian.shape[1]:
            raise InputError(f"prior must be of {self.jacobian.shape[1]} coefficients, got {len(mean)}. Check the sizes.")
        return self._whiten(self.jacobian @ root), self._whiten(self._checked(y) - self.jacobian @ mean)

    def _checked(self, y: Array) -> Array:
        if y.shape != self.jacobian.shape[:1] or not np.isfinite(y).all():
            raise InputError(
                f"y must be {len(self.jacobian)} finite values, got shape {y.shape}. Give one per row of the jacobian."
            )
        return y


@dataclass(frozen=True, eq=False)
class _ScaleIntegrand:
    """g(t) = rising(t) + falling(t), t = ln σ: ln of p(y, t) up to a constant.

    With singular values s and projections c: −2A t − B e^−2t − ½ Σ [ln(1 + s² e^−2t) + c² / (e^2t + s²)].
    """

    shape: float
    rate: float
    stretch: Array
    along: Array

    def rising(self, t: Array) -> Array:
        """The part that grows with σ: misfit and rate, shape (k,)."""
        variance = np.exp(2.0 * t)
        return -self.rate / variance - 0.5 * (self.along**2 / (variance[:, None] + self.stretch**2)).sum(axis=1)

    def falling(self, t: Array) -> Array:
        """The part that falls with σ: volumes, shape (k,)."""
        free = 2.0 * self.shape - len(self.stretch)
        return -free * t - 0.5 * np.log(np.exp(2.0 * t)[:, None] + self.stretch**2).sum(axis=1)

    def nodes(self) -> tuple[Array, Array, float]:
        """Equally spaced t wherever g is within `_NEGLIGIBLE` of its maximum, and g there, shapes (k,), and the spacing.

        Cells [u, u + w] are halved, and dropped when even falling(u) + rising(u + w), which bounds g there, is negligible: no
        mode is missed, however narrow. The spacing resolves the narrowest mode possible, (5 shape)^-½ wide, and the poles of
        e^g, π/2 away.
        """
        step = min(0.25, 0.4 / np.sqrt(2.0 * self.shape))
        low, high = self._limits()
        lower, width, top = np.array([low]), high - low, -np.inf
        while width > step:
            width *= 0.5
            lower = np.concatenate([lower, lower + width])
            falling = self.falling(lower)
            top = max(top, float((falling + self.rising(lower)).max()))
            lower = lower[falling + self.rising(lower + width) > top - _NEGLIGIBLE]
        t = np.sort(lower)
        value = self.falling(t) + self.rising(t)
        kept = value > value.max() - _NEGLIGIBLE
        return t[kept], value[kept], width

    def _limits(self) -> tuple[float, float]:
        """t outside of which g is negligible: below, e^−2t rules; above all s, the slope is at most −shape / 2."""
        square = 2.0 * self.rate + float(np.sum(self.along**2))
        low = 0.5 * np.log(self.rate / self.shape) - 3.0
        high = max(0.5 * np.log(4.0 * square / self.shape), float(np.log(max(self.stretch.max(), _TINY))))
        return float(low), float(high + 2.0 * _NEGLIGIBLE / self.shape)


def _powers_of_two(columns: Array) -> Array:
    """Scales that bring columns to a length near one without rounding, shape (p,)."""
    norms = np.linalg.norm(columns, axis=0)
    return np.ldexp(1.0, -np.round(np.log2(np.where(norms > 0.0, norms, 1.0))).astype(int))
