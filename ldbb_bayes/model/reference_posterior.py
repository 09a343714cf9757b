"""Estimate of a machine's parameters, about which the model of a campaign is linearised.

The estimates Ĉ, Ê of the compliances C at the reference force and of the geometric errors E are
posterior means, and u(Ĉ) is the posterior sd of C. The posterior is computed with the
hyper-parameters φ (such as the standard deviation of the noise) fixed at their prior medians. Its
coefficients are the parameters of interest (compliances, their changes with force, and geometric
errors) and the coefficients of nuisances, which are effects modelled but not of interest. The
readings of a test are replaced by at most 25 numbers, the reduced readings (module `reduction`).
Negative compliances are not excluded, so that the posterior is Gaussian. The model itself depends
on the estimates: effects are linearised about Ĉ, Ê, and some prior sds are proportional to √(Ĉ² +
u(Ĉ)²). The estimate is therefore computed in three steps, starting from the least-squares estimate.
In each step, the model is linearised about the estimate of the previous step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ldbb_bayes.model.fourier import SIZE
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.interest import ParametersOfInterest, interest_columns
from ldbb_bayes.model.linearisation import (
    MachineEstimate,
    linearise,
    nominal_mount_offset,
    planned_compliances,
)
from ldbb_bayes.model.prior import Prior
from ldbb_bayes.model.reduction import Reduced
from ldbb_bayes.model.setting import Setting
from ldbb_bayes.model.terms import BasisNoise, Columns, Term
from ldbb_bayes.model.terms.columns import Hyper
from ldbb_bayes.results import Array

__all__ = ["ReferencePosterior", "fixed_point"]

# Number of steps in which a machine's parameters are estimated, starting from the least-squares
# estimate. In each step, the model is linearised about the estimate of the previous step.
_STEPS = 3
# A flat prior of a nuisance coefficient is replaced by a wide Gaussian prior. The prior sd is this
# number times the uncertainty that the coefficient would have, from the readings alone, if all
# other coefficients were known.
_FLAT_SDS = 1e6


class _SharedCoefficients(NamedTuple):
    """Columns and priors of the coefficients that have the same values in all tests.

    Coefficients of nuisances come first, then the parameters of interest.
    """

    #: reading per unit of each of the q coefficients, as 25 Fourier coefficients for each test,
    #: shape (tests, 25, q)
    values: Array
    #: prior means of the q coefficients that have the same values in all tests, shape (q,)
    mean: Array
    #: prior sds of the q coefficients that have the same values in all tests, shape (q,); infinite
    #: for a flat prior
    sd: Array


class _StackedReadings(NamedTuple):
    """Readings of all tests; the readings of each test are reduced to m ≤ 25 numbers."""

    #: Matrices that convert the 25 Fourier coefficients of a test into the m numbers to which its
    #: readings are reduced, shape (tests, m, 25).
    factors: Array
    #: readings of all tests, reduced to m numbers for each test [mm], shape (tests, m, 1)
    readings: Array


@dataclass(frozen=True, eq=False)
class ReferencePosterior:
    """Posterior of a machine's parameters for given values of the hyper-parameters."""

    #: parameters of interest of the model: compliances, linear slopes (changes of compliances with
    #: force) and geometric errors, without quadratic slopes
    interest: ParametersOfInterest
    prior: Prior
    nuisances: Sequence[Term]  #: nuisance terms (effects modelled but not of interest) of the model
    #: names of the compliances, slopes (changes of compliances with force) and geometric errors
    #: that are fixed at zero
    fixed: Sequence[str]
    #: dict of the values at which the hyper-parameters are fixed; its keys are their names. Lengths
    #: are in mm
    phi: Mapping[Hyper, float]
    reduced: Sequence[Reduced]  #: readings of every test, reduced to at most 25 numbers

    def estimate(self, setting: Setting) -> MachineEstimate:
        """Return posterior means of compliances and geometric errors, and sds of the compliances.

        ``setting`` describes the test conditions, including the estimate of the machine about which
        the model is linearised. Parameters that are fixed are zero. Compliances that change no
        reading have the values assumed for a plan, and their sds are zero.
        """
        free = np.array([name not in self.fixed for name in self.interest.names])
        posterior = self._posterior(setting, free)
        mean = np.zeros(len(free))
        sd = np.zeros(len(free))
        mean[free] = posterior.mean
        sd[free] = posterior.sd
        count = len(self.interest.compliances)
        visible = np.abs(setting.elastic).max(axis=(0, 1)) > 0.0
        planned = planned_compliances(self.interest.compliances, self.prior)
        first_geometric = len(free) - len(self.interest.geometric_errors)
        return MachineEstimate(
            np.where(visible, mean[:count], planned),
            np.where(visible, sd[:count], 0.0),
            mean[first_geometric:],
        )

    def _posterior(self, setting: Setting, free: Array) -> Gaussian:
        """Return the Gaussian posterior density of the free parameters of interest.

        The hyper-parameters have the values ``phi`` of this object, and nuisances are integrated
        out. ``setting`` describes the test conditions. ``free`` is true for the parameters of
        interest that are free, that is, not fixed at zero.
        """
        terms: list[Columns | BasisNoise] = []
        for term in self.nuisances:
            terms += term.columns(setting)
        coefficients = self._coefficients(setting, free, terms)
        offset = nominal_mount_offset(setting) + coefficients.values @ coefficients.mean
        residuals = self._stacked.readings - self._stacked.factors @ offset[..., None]
        equations = np.concatenate([self._stacked.factors @ coefficients.values, residuals], axis=2)
        roots = np.linalg.cholesky(self._noise_covariance(terms))
        whitened = np.concatenate([*np.linalg.solve(roots, equations)])
        norms = np.linalg.norm(whitened[:, :-1], axis=0)
        flat_sd = _FLAT_SDS / np.where(norms > 0.0, norms, 1.0)
        sd = np.where(np.isinf(coefficients.sd), flat_sd, coefficients.sd)
        scale = np.append(sd, 1.0)
        prior_rows = np.eye(len(sd), len(scale))
        stack = np.concatenate([whitened * scale, prior_rows])
        triangle = np.asarray(np.linalg.qr(stack, mode="r"))
        # The posterior is computed from the QR decomposition of a matrix whose last columns belong
        # to the parameters of interest; all other columns belong to nuisance coefficients. The last
        # rows of the triangular factor R (``triangle``) are therefore equations for the parameters
        # of interest alone.
        size = int(free.sum())
        of_interest = slice(len(sd) - size, len(sd))
        posterior = Gaussian.from_rows(
            triangle[of_interest, of_interest], triangle[of_interest, -1]
        )
        return Gaussian.factored(
            coefficients.mean[of_interest] + sd[of_interest] * posterior.mean,
            posterior.root,
            sd[of_interest] * posterior.scale,
        )

    def _coefficients(
        self, setting: Setting, free: Array, terms: Sequence[Columns | BasisNoise]
    ) -> _SharedCoefficients:
        """Return columns and priors of the coefficients that have the same values in all tests.

        ``setting`` describes the test conditions. ``terms`` describes the nuisances under these
        conditions: each item holds columns of the design matrix or the sds of a noise. ``free`` is
        true for the parameters of interest that are free, that is, not fixed at zero.
        """
        values = []
        means = []
        sds = []
        for term in terms:
            if isinstance(term, Columns) and not term.private:
                values.append(term.values)
                sds.append(term.sd_at(self.phi))
                means.append(term.prior_mean)
        values.append(interest_columns(setting, self.interest.degree)[:, :, free])
        sds.append(self.interest.prior_sd(self.prior, setting)[free])
        means.append(self.interest.prior_mean(self.prior)[free])
        return _SharedCoefficients(
            np.concatenate(values, axis=2), np.concatenate(means), np.concatenate(sds)
        )

    @cached_property
    def _stacked(self) -> _StackedReadings:
        """Reduced readings of all tests (at most 25 numbers per test), in arrays of equal size.

        If tests have different numbers of reduced readings, zeros are appended to the shorter ones.
        The matrix that converts Fourier coefficients into reduced readings gets a row of zeros for
        each appended zero. The appended zeros are therefore independent of all coefficients and
        have no effect on the estimate.
        """
        most = max(len(test.factor) for test in self.reduced)
        factors = np.zeros((len(self.reduced), most, SIZE))
        readings = np.zeros((len(self.reduced), most, 1))
        for r, test in enumerate(self.reduced):
            size = len(test.factor)
            factors[r, :size] = test.factor
            readings[r, :size, 0] = test.reading_mm
        return _StackedReadings(factors, readings)

    def _noise_covariance(self, terms: Sequence[Columns | BasisNoise]) -> Array:
        """Return the covariance of each test's m reduced readings [mm²], shape (tests, m, m).

        Reduced readings are at most 25 numbers that replace the readings of a test. Two kinds of
        noise are included: the white noise of the readings, and the effects in ``terms`` that
        differ from test to test.
        """
        factors = self._stacked.factors
        tests = range(len(factors))
        white: Array = self.phi["sigma"] * np.eye(factors.shape[1])
        roots = [np.broadcast_to(white, (len(factors), *white.shape))]
        for term in terms:
            if isinstance(term, BasisNoise):
                sd = np.stack([term.sd_at(self.phi, r) for r in tests])
                roots.append(factors * sd[:, None])
            elif term.private:
                sd = np.stack([term.sd_at(self.phi, r) for r in tests])
                roots.append(factors @ (term.values * sd[:, None]))
        root = np.concatenate(roots, axis=2)
        return np.asarray(root @ np.swapaxes(root, 1, 2))


def fixed_point(
    posterior: ReferencePosterior, setting: Setting, start: MachineEstimate
) -> MachineEstimate:
    """Return the estimate of a machine's parameters that is obtained by repeated linearisation.

    ``posterior`` computes the posterior of the machine's parameters for given values of the
    hyper-parameters (prior sds of the noise and of other effects). ``setting`` describes the test
    conditions. The estimate is computed in three steps. In the first step, the model is linearised
    about ``start``; in each further step, it is linearised about the estimate from the previous
    step.
    """
    estimate = start
    for _ in range(_STEPS):
        linearised = linearise(setting, posterior.interest.compliances, estimate)
        estimate = posterior.estimate(linearised)
    return estimate
