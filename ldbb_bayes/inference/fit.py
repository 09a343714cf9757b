"""How well a model fits the readings, and the warnings that a fit gives: the result.

The warnings should be considered before the results are used. A warning states, for example, that
the readings contradict the condition that no compliance is negative.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Any

import numpy as np

from ldbb_bayes.inference.checks import Check, CheckKind, TestChecks, all_checks, failing_checks
from ldbb_bayes.results import Finite, Result
from ldbb_bayes.units import ranked

__all__ = [
    "Concern",
    "ConcernKind",
    "Fit",
    "State",
]

# Power-scaling sensitivity above which the posterior of a parameter counts as sensitive to the
# prior. The sensitivity states how much the posterior moves if the prior density is raised to a
# power near one (Kallioinen et al. 2023).
_SENSITIVE = 0.05
# If a test fails the posterior predictive check of a Fourier order, this matters only if any
# parameter changes by more than this number of standard uncertainties when the test is left out.
_LARGEST_SHIFT = 0.5
# If a test fails the posterior predictive check of its noise, this matters only if the noise found
# in the readings would widen any parameter's credible interval by more than this fraction.
_LARGEST_WIDENING = 0.1


class State(StrEnum):
    """Whether the results of a fit can be used; `Fit.state` explains how this is decided."""

    USABLE = "usable"
    DOUBTFUL = "doubtful"
    UNUSABLE = "unusable"


class ConcernKind(StrEnum):
    """Kind of a warning that a fit gives in addition to its results.

    `Concern` states what each kind warns of.
    """

    NOT_CONVERGED = "not-converged"
    TRUNCATION = "truncation"
    FORCES = "forces"
    HYPER = "hyper"
    CENTRE = "centre"
    PRIOR = "prior"
    ZERO = "zero"
    UNIT = "unit"
    BALLS = "balls"
    NEAR_ZERO = "near-zero"


# Kinds of warnings by which the readings contradict the model.
_CONTRADICTING_KINDS = frozenset({ConcernKind.TRUNCATION, ConcernKind.BALLS})


@dataclass(frozen=True)
class Concern(Result):
    """Warning that a fit gives, with two numbers, ``value`` and ``limit``, that state the reason.

    The meaning of the two numbers depends on ``kind``:

    - NOT_CONVERGED: ``value`` is the number of steps after which the sampler gave up, ``limit`` the
      effective sample size that was asked for.
    - TRUNCATION: ``value`` is the log posterior probability that no compliance is negative,
      ``limit`` the smallest log probability expected.
    - FORCES: ``value`` is the number of different forces of the campaign, ``limit`` the number
      needed to check the degree of the compliances as polynomials in the force.
    - HYPER: ``value`` is the posterior median of the hyper-parameter ``name`` [mm], ``limit`` the
      quantile of its prior at 99.9 %.
    - CENTRE: ``value`` is the p-value of the hypothesis that the circles' centre does not shift
      along the machine axis ``name`` with force. There is one such p-value for each axis of each
      plane. The warning is given if ``value``, multiplied by the number of these p-values, is below
      ``limit``.
    - PRIOR: ``value`` is the distance of the posterior mean of the parameter ``name`` from the
      prior mean that the user stated, ``limit`` the largest distance expected. Both are in units of
      the standard deviation that this distance has if the prior is right.
    - ZERO: ``value`` is the constant by which the readings of all circles of one radius lie away
      from what is expected [mm]: the error of the bar's length if nothing were known of it
      beforehand, minus the error that is stated. ``limit`` is the largest size of this constant to
      be expected of the bar and of the machine [mm], and ``name`` the coefficient of the bar's
      length.
    - UNIT: ``value`` is the range of the readings of the test ``name`` [mm], ``limit`` the smallest
      or largest range that a ball bar shows [mm]. The readings probably are in another unit than
      stated.
    - BALLS: ``value`` is the log evidence with the stated form of the balls minus that without it,
      ``limit`` the smallest difference expected [nat]. The warning is given only if the readings
      are more probable with balls that are less round than stated.
    - NEAR_ZERO: ``value`` is the posterior mean of the compliance ``name``, which cannot be
      negative and is not larger than two standard deviations. ``limit`` is the value below which it
      lies with a probability of 95 %. Both are in the internal unit ``unit``, such as mm/N.
    """

    kind: ConcernKind
    value: float
    limit: float
    name: str = ""
    unit: str = ""


@dataclass(frozen=True)
class Fit(Result):
    """How well a model fits the readings, and the warnings that the fit gives."""

    #: root-mean-square residual over all readings [µm] (Eq. 34 of the article on the model)
    rmse_um: float
    #: fitness of each test [%] (Eq. 35 of the article on the model): 100 % minus the
    #: root-mean-square residual in per cent of the range of the readings, or NaN if all readings
    #: are equal. The keys are the names of the tests.
    fitness_percent: dict[str, float]
    #: logarithm of the probability that no compliance is negative, computed with the posterior of
    #: the same model without truncation
    log_prob_truncation: float
    #: error of ``log_prob_truncation``, the log probability that no compliance is negative [nat]
    log_prob_truncation_error: Finite
    #: logarithm of the constant that normalises the truncated prior: the probability, under the
    #: prior before truncation, that no compliance is negative. It is zero if the prior is not
    #: truncated.
    log_prob_truncation_prior: float
    #: largest difference between the readings that the linearised model predicts and the readings
    #: that the exact geometry predicts, both at the posterior mean of the parameters [µm]
    linearisation_error_um: float
    concerns: tuple[Concern, ...]  #: warnings of the fit, each with a value and a limit
    #: posterior predictive checks of each test; the keys are the names of the tests
    predictive_checks: dict[str, TestChecks]
    #: sensitivity of the posterior of each parameter and hyper-parameter: how much this posterior
    #: moves if a prior density or the likelihood is raised to a power near one (power-scaling). The
    #: first key is the name of the parameter or hyper-parameter; the second key is ``prior``,
    #: ``hyper_prior`` or ``likelihood``.
    sensitivity: dict[str, dict[str, float]]
    #: dict of the effects of tests that fail the posterior predictive check of a Fourier order. The
    #: keys are the names of these tests. The value is the largest change of any parameter when the
    #: test is left out, in units of the parameter's standard uncertainty. The dict is empty if no
    #: test fails this check, if the prior is flat, or if the campaign has one test only.
    shift: dict[str, float]
    #: largest relative increase in the width of a parameter's credible interval due to noise that
    #: is stronger than modelled. The noise of tests that fail a check of noise or autocorrelation
    #: is estimated from their readings at the Fourier orders 13 to 16. Zero if no test fails these
    #: checks.
    widening: float

    def __deepcopy__(self, memo: dict[int, Any]) -> Fit:
        """Return this fit itself, because a fit does not change.

        Pandas makes a deep copy of the attributes of a table, one of which is its fit, for every
        row and column that is taken from the table.
        """
        return self

    @cached_property
    def checks(self) -> list[Check]:
        """Return the posterior predictive checks of all tests, the smallest p-value first."""
        return all_checks(self.predictive_checks)

    @cached_property
    def unexpected(self) -> tuple[Check, ...]:
        """Return the posterior predictive checks that fail, the smallest p-value first.

        A check fails if its p-value, multiplied by the number of all checks (Bonferroni), is below
        1 %.
        """
        return failing_checks(self.checks)

    @cached_property
    def misfits(self) -> tuple[Check, ...]:
        """Return the failing posterior predictive checks that matter for the credible intervals.

        A failing check of a Fourier order matters if leaving out the test changes some parameter by
        more than half of the parameter's standard uncertainty. The check also matters if this
        change is not known, because the prior is flat or the campaign has only one test. A failing
        check of noise or of its autocorrelation matters if the noise that the readings show would
        make some credible interval more than 10 % wider.
        """
        return tuple(check for check in self.unexpected if self._moves_intervals(check))

    def _moves_intervals(self, check: Check) -> bool:
        """Return whether a failing check of a test's readings matters for the credible intervals.

        `misfits` explains which failing checks matter.
        """
        if check.kind == CheckKind.ORDER:
            return self.shift.get(check.test, np.inf) > _LARGEST_SHIFT
        return self.widening > _LARGEST_WIDENING

    @property
    def contradicts_model(self) -> bool:
        """Whether the readings contradict the model, so that its results cannot be used."""
        kinds = {concern.kind for concern in self.concerns}
        return bool(self.misfits) or bool(kinds & _CONTRADICTING_KINDS)

    @property
    def is_usable(self) -> bool:
        """Whether the results can be used: whether `state` is neither doubtful nor unusable."""
        return self.state == State.USABLE

    def names_of_concerns(self, kind: ConcernKind) -> tuple[str, ...]:
        """Return the names in all warnings of one kind that the fit gives.

        Parameters
        ----------
        kind : ConcernKind
            Kind of the warnings. `Concern` explains what their names are: of kind PRIOR those of
            parameters, of kind UNIT those of tests.

        Returns
        -------
        tuple of str
        """
        return tuple(concern.name for concern in self.concerns if concern.kind == kind)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Return the kinds of the fit's warnings and of its failing checks that matter (`misfits`).

        Each kind is listed once. A kind is the text of a ``ConcernKind`` or ``CheckKind``, such as
        "truncation" or "noise".
        """
        concerns = [str(concern.kind) for concern in self.concerns]
        misfits = [str(check.kind) for check in self.misfits]
        return tuple(dict.fromkeys(concerns + misfits))

    @property
    def state(self) -> State:
        """Return whether the results of the fit can be used.

        The results are unusable if the sampler did not converge. Otherwise, they are doubtful if
        the fitted model does not describe the readings well enough (see `misfits`), if the readings
        contradict the condition that no compliance is negative or the stated form of the balls, or
        if the unit of the readings of a test is in doubt. In all other cases the results are
        usable.
        """
        kinds = {concern.kind for concern in self.concerns}
        if ConcernKind.NOT_CONVERGED in kinds:
            return State.UNUSABLE
        if self.contradicts_model or ConcernKind.UNIT in kinds:
            return State.DOUBTFUL
        return State.USABLE

    @property
    def sensitive(self) -> tuple[str, ...]:
        """Return the names of the parameters whose posterior is sensitive to the prior.

        The most sensitive parameter is first. A parameter is listed if its power-scaling
        sensitivity (how much its posterior moves if the prior is raised to a power near one) is
        above 0.05.
        """
        names = [name for name in self.parameters if self._prior_sensitivity(name) > _SENSITIVE]
        return tuple(ranked(names, self._prior_sensitivity))

    def _prior_sensitivity(self, name: str) -> float:
        """Return the sensitivity of a parameter's posterior to the prior of the parameters.

        ``name`` is the name of the parameter. The sensitivity states how much its posterior moves
        if the prior density is raised to a power near one (power-scaling).
        """
        return self.sensitivity[name]["prior"]

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return the names of the parameters of the fitted model.

        The parameters are compliances, their changes with force, and geometric errors.
        Hyper-parameters (such as the standard deviation of the noise) are not among them.
        """
        return tuple(name for name in self.sensitivity if name.startswith(("C_", "E_")))
