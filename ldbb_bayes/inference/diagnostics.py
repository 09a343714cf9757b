"""Does the fitted model expect readings like these, and what would other priors have said?

Posterior predictive checks (Gelman, Meng and Stern 1996), test by test and Fourier order by order, residual autocorrelation
included; prior and likelihood sensitivity by power scaling (Kallioinen et al., Statistics and Computing 34:57, 2024).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ldbb_bayes.campaign.circular_test import CircularTest
from ldbb_bayes.inference.predictive import own_covariance, shared_draws
from ldbb_bayes.model.basis import MAX_ORDER, ORDERS, SIZE, basis
from ldbb_bayes.model.bound import BoundModel

__all__ = ["PredictiveChecks", "TestChecks", "autocorrelation", "predictive_checks", "sensitive", "verdict"]

Array = NDArray[Any]
_DRAWS = 500
_RANK = 1e-6
_STRETCH = 100_000
_MISFIT = 0.01
_SENSITIVE = 0.05
_CONFLICT = 3


@dataclass(frozen=True)
class TestChecks:
    """Posterior predictive p-values of one test; None where it has too few readings.

    Attributes
    ----------
    orders : tuple of float
        Of the residual at order n = 0 … 12 after machine and shared nuisances: the probability that a new circle lies further
        out, averaged over the posterior.
    noise_p : float or None
        Two-sided, of the readings' scatter outside orders 0 … 12 against σ.
    autocorrelation : float or None
        Lag-one autocorrelation of that scatter [1].
    autocorrelation_p : float or None
        Two-sided, against white noise.
    """

    __test__ = False

    orders: tuple[float, ...]
    noise_p: float | None
    autocorrelation: float | None
    autocorrelation_p: float | None


@dataclass(frozen=True)
class PredictiveChecks:
    """Of every test, keyed by name."""

    tests: dict[str, TestChecks]

    def worst(self) -> tuple[float, str, int]:
        """Smallest p-value, what it belongs to, and the number of checks."""
        every = list(self._all())
        value, what = min(every)
        return value, what, len(every)

    @property
    def misfits(self) -> tuple[str, ...]:
        """Checks that fail at 1 % after allowing for their number (Bonferroni), worst first."""
        every = sorted(self._all())
        return tuple(what for value, what in every if value * len(every) < _MISFIT)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            name: {
                "orders_p": {str(n): p for n, p in enumerate(checks.orders)},
                "noise_p": checks.noise_p,
                "autocorrelation": checks.autocorrelation,
                "autocorrelation_p": checks.autocorrelation_p,
            }
            for name, checks in self.tests.items()
        }

    def _all(self) -> Iterator[tuple[float, str]]:
        for name, checks in self.tests.items():
            for n, p in enumerate(checks.orders):
                yield p, f"order {n} of {name}"
            if checks.noise_p is not None:
                yield checks.noise_p, f"white noise of {name}"
            if checks.autocorrelation_p is not None:
                yield checks.autocorrelation_p, f"autocorrelation of {name}"


def predictive_checks(bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator) -> PredictiveChecks:
    """Compare what was read with new circles under the posterior.

    Parameters
    ----------
    phi : ndarray, shape (draws, h) [mm]
    beta : ndarray, shape (draws, p)
    """
    pick = np.linspace(0, len(phi) - 1, min(_DRAWS, len(phi))).astype(int)
    phi, beta = phi[pick], beta[pick]
    shared = shared_draws(bound, phi, beta, rng)
    by_name = {test.name: test for test in bound.campaign.tests}
    sigma = phi[:, bound.hyper_prior.names.index("sigma")]
    checks = {}
    for r, (name, reduced) in enumerate(zip(bound.test_names, bound.reduced, strict=True)):
        inverse = np.linalg.pinv(reduced.factor, rcond=_RANK)
        residual = (np.asarray(reduced.projection) - shared[:, r] @ reduced.factor.T) @ inverse.T
        seen = inverse @ reduced.factor
        covariance = seen @ own_covariance(bound, phi, r) @ seen.T + sigma[:, None, None] ** 2 * (inverse @ inverse.T)
        orders = [_tail(residual[:, n == ORDERS], covariance[:, n == ORDERS][:, :, n == ORDERS]) for n in range(MAX_ORDER + 1)]
        outside = reduced.readings - SIZE
        noise_p = correlation = correlation_p = None
        if outside > 0:
            tail = stats.chi2.sf(reduced.residual_ss / sigma**2, outside).mean()
            noise_p = float(2.0 * min(tail, 1.0 - tail))
            correlation, correlation_p = autocorrelation(by_name[name])
        checks[name] = TestChecks(tuple(orders), noise_p, correlation, correlation_p)
    return PredictiveChecks(checks)


def autocorrelation(test: CircularTest) -> tuple[float, float]:
    """Lag-one autocorrelation of the readings after orders 0 … 12 are taken out, and its two-sided p-value under white noise.

    Under white noise it has mean tr(M S) / tr(M) and nearly variance 1/n, M the projection off the basis, S the shift to the
    next reading. Of very many readings, a stretch is looked at.
    """
    order = np.argsort(test.angle_deg, kind="stable")[:_STRETCH]
    angle, reading = test.angles_rad()[order], test.readings_mm()[order]
    columns = np.linalg.qr(basis(angle))[0]
    rest = reading - columns @ (columns.T @ reading)
    square = float(rest @ rest)
    if square <= 1e-24 * float(reading @ reading):
        return 0.0, 1.0
    n = len(rest)
    expected = -float((columns[1:] * columns[:-1]).sum()) / (n - SIZE)
    value = float(rest[1:] @ rest[:-1]) / square
    return value, float(2.0 * stats.norm.sf(abs(value - expected) * np.sqrt(n)))


def _tail(residual: Array, covariance: Array) -> float:
    """Mean over the draws of P(χ² ≥ rᵀ V⁻¹ r), r (draws, k), V (draws, k, k)."""
    square = np.einsum("wi,wi->w", residual, np.linalg.solve(covariance, residual[..., None])[..., 0])
    return float(stats.chi2.sf(square, residual.shape[1]).mean())


def sensitive(sensitivity: Mapping[str, Mapping[str, float]]) -> tuple[str, ...]:
    """Parameters whose posterior moves with the prior (power-scaling sensitivity above 0.05), most first."""
    found = {name: values["prior"] for name, values in sensitivity.items() if values["prior"] > _SENSITIVE}
    return tuple(sorted(found, key=lambda name: -found[name]))


def verdict(
    *, converged: bool, checks: PredictiveChecks, contradicts: bool, sensitive_to_prior: Sequence[str], parameters: int
) -> str:
    """One line: whether the numbers can be used, and what to look at."""
    if not converged:
        return "NOT CONVERGED: do not use the numbers."
    worst, what, count = checks.worst()
    misfits = checks.misfits
    if contradicts:
        fits = "the readings speak against non-negative compliance"
    elif misfits:
        shown = ", ".join(misfits[:_CONFLICT]) + (f" and {len(misfits) - _CONFLICT} more" if len(misfits) > _CONFLICT else "")
        fits = f"the model does not expect readings like these ({shown})"
    else:
        fits = f"the model expects readings like these ({count} checks, smallest p = {worst:.2g}, {what})"
    moved = f"{len(sensitive_to_prior)} of {parameters} numbers are sensitive to their prior"
    shown = ", ".join(sensitive_to_prior[:_CONFLICT]) + (", …" if len(sensitive_to_prior) > _CONFLICT else "")
    return f"Converged; {fits}; {moved}{f' ({shown})' if sensitive_to_prior else ''}."
