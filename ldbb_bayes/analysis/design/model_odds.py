"""Decision between constant compliance and compliance linear in force, now and after more circles.

The odds of the two models are averaged over alternative explanations of an apparent change of
compliance with force.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from ldbb_bayes.analysis.design.aims import SlopesAim
from ldbb_bayes.analysis.design.aims_so_far import Known
from ldbb_bayes.analysis.design.discrimination import discrimination_of
from ldbb_bayes.analysis.rival_explanations import average_explanations
from ldbb_bayes.inference.evidences import Evidences
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.results import Array, Result

__all__ = ["ModelOdds", "ModelSoFar"]

# Smallest error that is assumed for the probability of a model. Two models count as equally
# probable if their probabilities differ from 0.5 by less than this.
_SMALLEST_ERROR_OF_PROBABILITY = 0.01


@dataclass(frozen=True)
class ModelSoFar(Result):
    """State of the decision between constant compliance and compliance linear in force."""

    #: log Bayes factor of linear over constant compliance [nat], averaged over alternative
    #: explanations of an apparent change of compliance with force
    log_bayes_factor: float
    #: numerical error of the log Bayes factor of linear over constant compliance [nat]
    log_bayes_factor_error: float
    #: posterior probability that compliance is linear in force, not constant
    probability_linear: float
    #: whether one of the two models, constant or linear compliance, is probable enough for a
    #: decision
    decided: bool
    #: probability that a decision between constant and linear compliance is possible after the best
    #: next circle
    decided_next: float
    #: whether very many of the possible circles are expected to decide between the two models, or
    #: the decision is already made
    decidable: bool

    @property
    def probability(self) -> float:
        """Larger of the posterior probabilities of constant and of linear compliance."""
        return max(self.probability_linear, 1.0 - self.probability_linear)

    @property
    def equally_probable(self) -> bool:
        """Whether numerical errors leave open which of the two models is the more probable.

        The error of the probability p follows from that of the log Bayes factor, because the
        derivative of p with respect to the log Bayes factor is p (1 − p).
        """
        p = self.probability_linear
        error = p * (1.0 - p) * self.log_bayes_factor_error
        return abs(p - 0.5) < max(error, _SMALLEST_ERROR_OF_PROBABILITY)


@dataclass(frozen=True, eq=False)
class ModelOdds:
    """Comparison of linear with constant compliance, given the circles run so far."""

    known: Known
    # indices of the slopes in the list of the model's parameters
    columns: list[int]
    log_bayes_factor: float  # log Bayes factor of linear over constant compliance [nat]
    error: float  # numerical error of the log Bayes factor of linear over constant compliance [nat]
    # smallest absolute value of the log Bayes factor [nat] that decides between linear and constant
    # compliance
    threshold: float

    @classmethod
    def of(
        cls, model: HybridModel, known: Known, evidences: Evidences, confidence: float
    ) -> ModelOdds | None:
        """Return the odds of linear over constant compliance; None if the model has no slopes.

        The odds are averaged over alternative explanations of an apparent change of compliance with
        force. ``known`` is the posterior given the circles run so far. ``evidences`` computes the
        evidences of the two models, as a report does (`_evidences_of_sheets`). ``confidence`` is
        the minimum probability at which a decision is made.
        """
        parameters = known.bound.parameters
        columns = [k for k, parameter in enumerate(parameters) if parameter.group == "slope"]
        if not columns:
            return None
        pair = {"constant": model.with_degree(0), "linear": model}
        averaged = average_explanations(pair, evidences)
        threshold = float(np.log(confidence / (1.0 - confidence)))
        return cls(
            known,
            columns,
            averaged.log_bayes_factor,
            averaged.log_bayes_factor_error,
            threshold,
        )

    @property
    def is_decided(self) -> bool:
        """Whether the log Bayes factor decides between constant and linear compliance."""
        return abs(self.log_bayes_factor) >= self.threshold

    @property
    def aim(self) -> SlopesAim:
        """The aim to decide between constant and linear compliance."""
        return SlopesAim(self.columns, self.threshold, self.is_decided)

    def probability_decided(self, covariance: Array) -> float:
        """Return the probability that a decision is possible after one more circle.

        The log Bayes factor after this circle is the present one, which is averaged over
        alternative explanations, plus the change that the circle causes in the model with all of
        them. ``covariance``, shape (n K, p, p), are covariances of the p parameters after the
        circle, in units of their prior standard deviations: n times one for each of the K values of
        the hyper-parameters.
        """
        scale = self.known.bound.scale[self.columns]
        repeated = np.tile(self.known.phi, (len(covariance) // len(self.known.phi), 1))
        present = self.known.bound.given(repeated).parameters
        slopes = Gaussian.factored(present.mean, present.root, present.scale).marginal(self.columns)
        # ``slopes`` is the posterior of the slopes before the next circle. Its mean and standard
        # deviations are divided by ``scale``. They are then in units of the prior standard
        # deviations, as ``covariance`` is. ``size`` has no effect on the fields of ``expected``
        # that are used here.
        expected = discrimination_of(
            covariance[:, self.columns][:, :, self.columns],
            tuple(self.known.bound.names[k] for k in self.columns),
            size=1.0,
            before=Gaussian.factored(slopes.mean / scale, slopes.root, slopes.scale / scale),
            threshold=self.threshold,
            present=self.log_bayes_factor,
        )
        with_slopes = expected.decisive_with + expected.misleading_with
        without_slopes = expected.decisive_without + expected.misleading_without
        probability = float(expit(self.log_bayes_factor))
        return probability * with_slopes + (1.0 - probability) * without_slopes

    def so_far(self, scattering: Array, after_very_many: Array) -> ModelSoFar:
        """Return the present and the expected decision between constant and linear compliance.

        The result states the odds of linear over constant compliance, given the circles run so far,
        and the probability that a decision between the two is possible after the best next circle.
        ``scattering``, shape (n, p, p), are equally likely covariances of the p parameters after
        the best next circle, which may scatter more or less than other circles, in units of their
        prior standard deviations. ``after_very_many``, shape (K, p, p), in the same units, are the
        covariances after very many circles, at K values of the hyper-parameters.
        """
        return ModelSoFar(
            log_bayes_factor=self.log_bayes_factor,
            log_bayes_factor_error=self.error,
            probability_linear=float(expit(self.log_bayes_factor)),
            decided=self.is_decided,
            decided_next=self.probability_decided(scattering),
            decidable=self.is_decided or self.aim.is_expected(after_very_many),
        )
