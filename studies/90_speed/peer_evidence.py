"""ln p(y) by nested sampling (dynesty), and by bridge sampling on draws of another sampler.

dynesty and JAX are imported where they are needed.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from reduced_density import LOG_2PI, Laplace, ReducedDensity
from scipy.special import gammaln, stdtrit

from ldbb_bayes.inference.diagnostics import diagnose
from ldbb_bayes.model.hybrid import BoundModel

__all__ = ["Estimate", "bridged_log_evidence", "nested_log_evidence"]

Array = NDArray[Any]
# Degrees of freedom of the Student t from which live points come.
FREEDOM = 4.0


class Estimate(NamedTuple):
    """ln p(y) and its standard error [nat]."""

    log_evidence: float
    error: float


class _DensityOverStudentT:
    """ln (L π / t) at mode + root z, where t is a density of independent Student t of z.

    With truncation it is −∞ outside, and ln P(T) is subtracted.
    """

    def __init__(self, density: ReducedDensity, approximation: Laplace) -> None:
        import jax

        bound = density.bound
        self.density = density
        self.evaluate = jax.jit(density)
        self.mode, self.root = approximation
        log_peak = gammaln((FREEDOM + 1) / 2) - gammaln(FREEDOM / 2) - 0.5 * np.log(FREEDOM * np.pi)
        log_volume = np.log(np.diag(self.root)).sum() + np.log(bound.prior_sd).sum()
        self.constant = log_volume - len(self.mode) * log_peak
        if bound.truncation.active:
            self.constant -= bound.parameter_prior.normalisation.log_value

    def __call__(self, z: Array) -> float:
        x = self.mode + self.root @ z
        if self._is_cut_off(x):
            return -np.inf
        log_tails = 0.5 * (FREEDOM + 1) * float(np.log1p(z**2 / FREEDOM).sum())
        return float(self.evaluate(x)) + self.constant + log_tails

    def _is_cut_off(self, x: Array) -> bool:
        """Whether the truncation excludes β at x."""
        truncation = self.density.bound.truncation
        if not truncation.active:
            return False
        beta, _ = self.density.split(x[None])
        return not truncation.holds(beta)[0]


def _student_t(level: Array) -> Array:
    """Quantiles of the Student t: live points from the unit cube."""
    return np.asarray(stdtrit(FREEDOM, level))


def nested_log_evidence(
    density: ReducedDensity, *, seed: int, live_points: int = 400, dlogz: float = 0.05
) -> Estimate:
    """ln p(y) by dynesty's nested sampling over β and φ (random walks within one ellipsoid).

    Live points come from independent Student t (4 degrees of freedom) about the mode of p(β, φ | y)
    in units of its Laplace approximation, with L π / t as likelihood: the same integral as from the
    prior, far less to compress. With truncation ln ∫ L π 1_T − ln P(T).
    """
    import dynesty

    approximation = density.laplace()
    sampler = dynesty.NestedSampler(
        _DensityOverStudentT(density, approximation),
        _student_t,
        len(approximation.centre),
        nlive=live_points,
        bound="single",
        sample="rwalk",
        rstate=np.random.default_rng(seed),
    )
    sampler.run_nested(dlogz=dlogz, print_progress=False)
    return Estimate(float(sampler.results["logz"][-1]), float(sampler.results["logzerr"][-1]))


def bridged_log_evidence(bound: BoundModel, chain: Array, *, seed: int) -> Estimate:
    """ln p(y) by bridge sampling (Meng and Wong 1996) on draws (chains, draws, p + h) without
    truncation.

    The bridge leads to a normal distribution fitted to the first half of every chain; the second
    half is used. Error: relative, draws counted by their effective number (Frühwirth-Schnatter
    2004).
    """
    p = len(bound.names)
    half = chain.shape[1] // 2
    x = np.concatenate([chain[..., :p], bound.hyper_prior.free(chain[..., p:])], axis=2)
    size = x.shape[2]
    first_half = x[:, :half].reshape(-1, size)
    second_half = x[:, half:].reshape(-1, size)
    normal = Laplace(first_half.mean(axis=0), np.linalg.cholesky(np.cov(first_half.T)))
    white_of_draws = np.linalg.solve(normal.root, (second_half - normal.centre).T).T
    log_ratio_of_draws = _log_ratio(bound, second_half, white_of_draws, normal)
    white = np.random.default_rng(seed).standard_normal(second_half.shape)
    points = normal.centre + white @ normal.root.T
    log_ratio_of_normal = _log_ratio(bound, points, white, normal)
    return _bridge(log_ratio_of_draws, log_ratio_of_normal, len(chain))


def _log_ratio(bound: BoundModel, points: Array, white: Array, normal: Laplace) -> Array:
    """ln of the posterior density, not normalized, over the normal density at points (n, p + h)."""
    p = len(bound.names)
    beta = points[:, :p]
    free = points[:, p:]
    log_target = bound.parameter_prior.log_density(beta) + bound.hyper_prior.log_density_of_free(
        free
    )
    log_target = log_target + bound.log_likelihood(bound.hyper_prior.phi(free), beta)
    minus_log_white = 0.5 * (LOG_2PI * points.shape[1] + (white**2).sum(axis=1))
    return np.asarray(log_target + minus_log_white + np.log(np.diag(normal.root)).sum())


def _bridge(log_ratio_of_draws: Array, log_ratio_of_normal: Array, chains: int) -> Estimate:
    """The fixed point of the optimal bridge, draws counted by their effective number."""
    shift = float(np.median(log_ratio_of_draws))
    of_draws = np.exp(log_ratio_of_draws - shift)
    of_normal = np.exp(log_ratio_of_normal - shift)
    effective = _effective_number(log_ratio_of_draws, chains)
    share = effective / (effective + len(of_normal))
    ratio = 1.0
    for _ in range(1000):
        previous = ratio
        numerator = of_normal / (share * of_normal + (1 - share) * ratio)
        denominator = 1.0 / (share * of_draws + (1 - share) * ratio)
        ratio = numerator.mean() / denominator.mean()
        if abs(np.log(ratio / previous)) < 1e-10:
            break
    effective = _effective_number(denominator, chains)
    relative_variance = (
        numerator.var() / numerator.mean() ** 2 / len(numerator)
        + denominator.var() / denominator.mean() ** 2 / effective
    )
    return Estimate(shift + float(np.log(ratio)), float(np.sqrt(relative_variance)))


def _effective_number(values: Array, chains: int) -> float:
    """Effective number of values of several chains, one after the other."""
    return float(diagnose(values.reshape(chains, -1, 1)).ess_bulk[0])
