"""TODO: say what this module is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ldbb_bayes.analysis.design.discrimination import Discrimination
from ldbb_bayes.analysis.design.states import States, carried
from ldbb_bayes.model.bound_information import information_of, informations_of
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.linear_algebra import singular_root
from ldbb_bayes.results import Array, Finite, Result

__all__ = ["Expected", "Forecast"]


_REPEATS = 4


_VERY_OFTEN = 1e6


_RANK = 1e-6


@dataclass(frozen=True)
class Expected(Result):
    """Prior sd of one parameter (infinite when flat), in inside units, and its expected posterior
    sd.

    ``sd`` is inside the truncation, ``untruncated_sd`` without it: their squares are averaged over
    the hyper-parameters; infinite where flat priors leave something undetermined. ``sd_error`` is
    the standard error of ``sd``, a mean over states of the machine, as if these were independent;
    they are spread more evenly. ``floor_sd`` is what nuisances shared by all tests leave if every
    test were run a million times, narrowed by the truncation as ``sd``.
    """

    unit: str
    prior_sd: Finite
    sd: Finite
    sd_error: Finite
    untruncated_sd: Finite
    floor_sd: Finite


@dataclass(frozen=True, eq=False)
class Forecast(Result):
    """What to expect of tests: sd of every parameter; the expected Kullback-Leibler divergence of
    the posterior from the prior [nat], infinite when that is flat; constant or linear, None without
    slopes or with flat priors."""

    expected: dict[str, Expected]  #: by parameter
    information_gain: Finite  #: expected [nat]
    discrimination: Discrimination | None  #: None where degree is 0

    @property
    def determined(self) -> bool:
        """Whether the tests determine every parameter; with proper priors they do."""
        return all(np.isfinite(entry.sd) for entry in self.expected.values())


def narrowed(
    bound: BoundModel, states: States, covariance: Array, seed: int
) -> tuple[Array, Array]:
    """Expected posterior variances inside the truncation and their standard errors, (p,) each, from
    the covariances without it (K, p, p). States that the new tests' forces rule out are left out.
    For every state the mean that the analysis would find is drawn, and the truncated Gaussian about
    it is taken. The errors are those of a mean over as many states."""
    each = np.einsum("kii->ki", covariance)
    plain = each.mean(axis=0)
    change = np.zeros_like(each)
    if bound.truncation.active:
        possible = bound.truncation.holds(states.beta)
        possible |= not possible.any()
        each = each[possible]
        change = _change_inside(bound, states, possible, covariance, seed)
    error = (each + change).std(axis=0) / np.sqrt(max(len(each) - 1, 1))
    return np.maximum(plain + change.mean(axis=0), 0.0), error


def _change_inside(
    bound: BoundModel, states: States, possible: Array, covariance: Array, seed: int
) -> Array:
    """What the truncation adds to the variances in possible states, shape (states, p). The mean m
    that an analysis will find is m | β ~ N(m₁ + W (β − m₁), W C), W = 1 − C P₁, with the precision
    P₁ before the tests and the covariance C after them."""
    scale = bound.scale
    start = states.before.mean[possible]
    both = np.outer(scale, scale)
    after = covariance[possible] / both
    weight = np.eye(len(scale)) - after @ (states.before.precision[possible] * both)
    root = singular_root(weight @ after)
    mean = start / scale + np.einsum("kij,kj->ki", weight, (states.beta[possible] - start) / scale)
    spread = singular_root(after) * scale[:, None]
    noise = np.random.default_rng(seed).standard_normal((_REPEATS, *mean.shape))
    drawn = scale * (mean + np.einsum("kij,rkj->rki", root, noise)).reshape(-1, len(scale))
    spread = np.tile(spread, (_REPEATS, 1, 1))
    shift, inside, axes = bound.truncation.orthants(drawn, spread).moments()
    along = spread @ np.swapaxes(axes, 1, 2)
    change = np.einsum("kpd,kpd->kp", along @ (inside - np.eye(shift.shape[1])), along)
    return np.asarray(change.reshape(_REPEATS, *mean.shape).mean(axis=0))


def posteriors(bound: BoundModel, phi: Array, run: int) -> tuple[Gaussian | None, Array]:
    """p(β | y, φ), ``run`` circles being the pilot's, about zero and floor sd (p,), both in units
    of the prior sd; none where flat priors leave something open."""
    phi = carried(bound, phi, run)
    one = information_of(bound, phi[0])
    own = one.interest
    flat = one.flat
    size = len(one.names)
    # All that the readings say of the coefficients, in as few rows as these are.
    rows = np.array(
        [np.linalg.qr(information.rows(), mode="r") for information in informations_of(bound, phi)]
    )
    if flat and np.linalg.matrix_rank(rows[..., own], tol=_RANK).min() < len(own):
        return None, np.zeros(0)
    repeated = np.array([1.0, np.sqrt(_VERY_OFTEN)])[:, None, None, None] * rows
    nothing = np.zeros(repeated.shape[:-1])
    prior = Gaussian.of(np.zeros(size), np.ones(size))
    both = (
        Gaussian.from_rows(repeated, nothing)
        if flat
        else prior.observe(repeated, nothing).marginal(own.tolist())
    )
    return Gaussian.factored(both.mean[0], both.root[0], both.scale[0]), np.sqrt(
        (both.sd[1] ** 2).mean(axis=0)
    )
