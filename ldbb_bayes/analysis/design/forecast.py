"""The forecast of tests before they are run: expected sd of every parameter, information gained.

It is of the linear Gaussian model at given hyper-parameters, averaged over these. The sd are inside
the truncation. It takes the general route through `ldbb_bayes.model.information.Information` and
none of the search's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ldbb_bayes.analysis.design.discrimination import Discrimination
from ldbb_bayes.analysis.design.states import States, extend_hyper_parameters
from ldbb_bayes.model.bound_information import information_of, informations_of
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.linear_algebra import singular_root
from ldbb_bayes.results import Array, Finite, Result

__all__ = [
    "Expected",
    "Forecast",
    "expected_uncertainties",
    "posteriors",
    "truncated_variances",
    "undetermined_forecast",
]

# Means that the analysis may find, drawn for every state.
_MEANS_PER_STATE = 4
# How often every test is run for the floor of a parameter's sd.
_REPETITIONS_OF_FLOOR = 1e6
# Singular values of the readings' information below this are zero.
_RANK_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Expected(Result):
    """Prior sd of one parameter (infinite when flat), and its expected posterior sd; inside units.

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
    """What to expect of tests: uncertainties, information gain, constant or linear."""

    expected: dict[str, Expected]  #: by parameter
    #: expected Kullback-Leibler divergence of the posterior from the prior [nat], infinite when
    #: that is flat
    information_gain: Finite
    discrimination: Discrimination | None  #: None where degree is 0, or priors are flat

    @property
    def determined(self) -> bool:
        """Whether the tests determine every parameter; with proper priors they do."""
        return all(np.isfinite(entry.sd) for entry in self.expected.values())


def undetermined_forecast(bound: BoundModel) -> Forecast:
    """Return the forecast of tests that leave parameters undetermined: every sd is infinite."""
    expected = {}
    for parameter in bound.parameters:
        expected[parameter.name] = Expected(
            parameter.unit, parameter.prior_sd, np.inf, np.inf, np.inf, np.inf
        )
    return Forecast(expected, np.inf, None)


def expected_uncertainties(
    bound: BoundModel, states: States, covariance: Array, floor: Array, seed: int
) -> dict[str, Expected]:
    """Return the expected uncertainty of every parameter.

    Parameters
    ----------
    bound
        Model bound to the tests.
    states
        The machine before them.
    covariance
        Posterior covariances without truncation, shape (K, p, p), in units of the prior sd.
    floor
        Floor of the sd, shape (p,), in units of the prior sd.
    seed
        Of the means that an analysis may find.

    Returns
    -------
    dict of str to Expected
        By parameter.
    """
    scale = bound.scale
    untruncated_sd = scale * np.sqrt(np.einsum("kii->ki", covariance).mean(axis=0))
    variance, variance_error = truncated_variances(
        bound, states, covariance * np.outer(scale, scale), seed
    )
    sd = np.sqrt(variance)
    sd_error = 0.5 * variance_error / sd
    floor_sd = scale * floor * np.minimum(1.0, sd / untruncated_sd)
    expected = {}
    for k, parameter in enumerate(bound.parameters):
        expected[parameter.name] = Expected(
            unit=parameter.unit,
            prior_sd=parameter.prior_sd,
            sd=float(sd[k]),
            sd_error=float(sd_error[k]),
            untruncated_sd=float(untruncated_sd[k]),
            floor_sd=float(floor_sd[k]),
        )
    return expected


def truncated_variances(
    bound: BoundModel, states: States, covariance: Array, seed: int
) -> tuple[Array, Array]:
    """Return expected posterior variances inside the truncation and their standard errors.

    States that the new tests' forces rule out are left out. For every other state a mean that the
    analysis would find is drawn, and the truncated Gaussian about it is taken.

    Parameters
    ----------
    bound
        Model bound to the tests.
    states
        The machine before them.
    covariance
        Posterior covariances without truncation, shape (K, p, p) [inside units].
    seed
        Of the means that an analysis may find.

    Returns
    -------
    variance : Array
        Shape (p,) [inside units].
    error : Array
        Of a mean over as many states, shape (p,).
    """
    variance_by_state = np.einsum("kii->ki", covariance)
    untruncated = variance_by_state.mean(axis=0)
    change = np.zeros_like(variance_by_state)
    if bound.truncation.active:
        possible = bound.truncation.holds(states.beta)
        possible |= not possible.any()
        variance_by_state = variance_by_state[possible]
        change = _change_by_truncation(bound, states, possible, covariance, seed)
    spread = (variance_by_state + change).std(axis=0)
    error = spread / np.sqrt(max(len(variance_by_state) - 1, 1))
    return np.maximum(untruncated + change.mean(axis=0), 0.0), error


def _change_by_truncation(
    bound: BoundModel, states: States, possible: Array, covariance: Array, seed: int
) -> Array:
    """Return what the truncation adds to the variances in possible states, shape (states, p).

    The mean m that an analysis will find is m | β ~ N(m₁ + W (β − m₁), W C), W = 1 − C P₁, with the
    precision P₁ before the tests and the covariance C after them.
    """
    scale = bound.scale
    p = len(scale)
    start = states.before.mean[possible]
    unit = np.outer(scale, scale)
    after = covariance[possible] / unit
    weight = np.eye(p) - after @ (states.before.precision[possible] * unit)
    root = singular_root(weight @ after)
    deviation = (states.beta[possible] - start) / scale
    mean = start / scale + np.einsum("kij,kj->ki", weight, deviation)
    spread = singular_root(after) * scale[:, None]
    noise = np.random.default_rng(seed).standard_normal((_MEANS_PER_STATE, *mean.shape))
    means = scale * (mean + np.einsum("kij,rkj->rki", root, noise)).reshape(-1, p)
    spread = np.tile(spread, (_MEANS_PER_STATE, 1, 1))
    shift, inside, axes = bound.truncation.orthants(means, spread).moments()
    along_axes = spread @ np.swapaxes(axes, 1, 2)
    change_along_axes = along_axes @ (inside - np.eye(shift.shape[1]))
    change = np.einsum("kpd,kpd->kp", change_along_axes, along_axes)
    return np.asarray(change.reshape(_MEANS_PER_STATE, *mean.shape).mean(axis=0))


def posteriors(bound: BoundModel, phi: Array, run: int) -> tuple[Gaussian | None, Array]:
    """Return p(β | y, φ) about zero, and the floor of the sd, both in units of the prior sd.

    Parameters
    ----------
    bound
        Model bound to the tests.
    phi
        Hyper-parameters of the pilot, shape (K, h) [mm].
    run
        Number of the pilot's circles in the binding.

    Returns
    -------
    posterior : Gaussian or None
        None where flat priors leave something undetermined.
    floor : Array
        Sd if every test were run a million times, shape (p,).
    """
    phi = extend_hyper_parameters(bound, phi, run)
    first = information_of(bound, phi[0])
    interest = first.interest
    size = len(first.names)
    # All that the readings say of the coefficients, in as few rows as these are.
    row_list = []
    for information in informations_of(bound, phi):
        row_list.append(np.linalg.qr(information.rows(), mode="r"))
    rows = np.array(row_list)
    if first.flat:
        rank = np.linalg.matrix_rank(rows[..., interest], tol=_RANK_TOLERANCE).min()
        if rank < len(interest):
            return None, np.zeros(0)
    once_and_often = np.array([1.0, np.sqrt(_REPETITIONS_OF_FLOOR)])[:, None, None, None] * rows
    no_reading = np.zeros(once_and_often.shape[:-1])
    if first.flat:
        both = Gaussian.from_rows(once_and_often, no_reading)
    else:
        prior = Gaussian.of(np.zeros(size), np.ones(size))
        both = prior.observe(once_and_often, no_reading).marginal(interest.tolist())
    posterior = Gaussian.factored(both.mean[0], both.root[0], both.scale[0])
    floor = np.sqrt((both.sd[1] ** 2).mean(axis=0))
    return posterior, floor
