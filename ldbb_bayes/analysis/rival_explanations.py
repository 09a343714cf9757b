"""Comparison of explanations of why compliance seems to change with force.

Readings that do not grow in proportion to force can have several causes: compliances may really
change with force (they have slopes), the deflection of the joints may be nonlinear, or the mount or
the force device may be nonlinear. Every combination of these explanations is a model. All models
have the same prior probability, and the evidences of the models determine their posterior
probabilities.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ldbb_bayes.analysis.sensitivity import Assumed
from ldbb_bayes.inference.evidence import probabilities
from ldbb_bayes.inference.evidences import Evidences
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.results import Array, Finite
from ldbb_bayes.units import ranked

__all__ = ["Explained", "Explanations", "average_explanations", "compare_explanations", "subsets"]

# Label of the Bayes factor from evidences averaged over the alternative explanations.
_AVERAGED = "averaged over other explanations"
# Name of the slopes in the list of explanations.
_SLOPES = "slopes"
# The readings support slopes if the log Bayes factor of the model with slopes over the model
# without slopes is above this number [nat].
_SUPPORTING_LOG_BAYES_FACTOR = 1.0
# Posterior probability from which on an alternative explanation counts as supported by the
# readings. Before the readings it is 0.5.
_SUPPORTED_PROBABILITY = 0.75
# A model hardly counts in an average if its log evidence is below that of another model by at least
# this number [nat].
_NEGLIGIBLE = 10.0


@dataclass(frozen=True)
class Explained:
    """One combination of explanations of why compliance seems to change with force."""

    #: names of the explanations that one model combines, such as a nonlinear mount; the name
    #: "slopes" means that compliance really changes with force
    by: tuple[str, ...]
    #: log evidence [nat] of the model that combines the explanations ``by`` and no others
    log_evidence: float
    log_evidence_error: Finite  #: numerical error of the log evidence of a model [nat]
    #: posterior probability of the model that combines the explanations ``by`` and no others
    probability: float


@dataclass(frozen=True)
class Explanations:
    """All combinations of explanations of why compliance seems to change with force.

    Every combination has the same prior probability.
    """

    #: posterior probability of each explanation of why compliance seems to change with force: the
    #: sum of the probabilities of all models that contain it. The keys are names of explanations.
    inclusion_probability: dict[str, float]
    #: all combinations of explanations of why compliance seems to change with force, the most
    #: probable first
    models: tuple[Explained, ...]
    #: log Bayes factor of slopes over no slopes, from evidences averaged over all combinations of
    #: the alternative explanations
    averaged: Assumed
    #: log Bayes factor of a model in which compliances change with force over a model in which they
    #: are constant. Both models lack all other effects, such as a nonlinear mount, that could
    #: explain an apparent change.
    alone: Assumed

    @property
    def instead(self) -> tuple[str, ...]:
        """Names of the alternative explanations that make slopes unnecessary, or an empty tuple.

        Alternative explanations make them unnecessary if two conditions are met: in a comparison
        without alternative explanations, the readings support slopes; on average over all
        combinations of alternative explanations, they do not. The result names the alternative
        explanations in the most probable combination without slopes. Those that are hardly more
        probable than before the readings are left out, unless this is so for all of them.
        """
        is_supported_alone = self.alone.log_bayes_factor > _SUPPORTING_LOG_BAYES_FACTOR
        is_unsupported_on_average = self.averaged.log_bayes_factor < _SUPPORTING_LOG_BAYES_FACTOR
        if not (is_supported_alone and is_unsupported_on_average):
            return ()
        combination = next(model.by for model in self.models if _SLOPES not in model.by)
        probability = self.inclusion_probability
        supported = tuple(
            name for name in combination if probability[name] >= _SUPPORTED_PROBABILITY
        )
        return supported or combination


def subsets(names: Sequence[str]) -> list[tuple[str, ...]]:
    """Return every subset of ``names``, from the set of all names to the empty set."""
    choices = itertools.product((True, False), repeat=len(names))
    return [tuple(itertools.compress(names, choice)) for choice in choices]


def compare_explanations(pair: Mapping[str, HybridModel], evidences: Evidences) -> Explanations:
    """Compare slopes with alternative explanations, using the evidence of every combination.

    Alternative explanations are other effects, such as a nonlinear mount, that change the readings
    in a similar way. Each model has slopes or no slopes, and any combination of the alternative
    explanations, so that r alternative explanations give 2^(1 + r) models. All models have the same
    prior probability. The probability of an explanation is the sum of the probabilities of the
    models that include it. The Bayes factor of slopes over no slopes is computed twice: from the
    models without alternative explanations, and from the evidences averaged over the combinations
    of alternative explanations.

    Parameters
    ----------
    pair : mapping of str to HybridModel
        The model without slopes, then the same model with slopes. Both models name the same
        alternative explanations (``HybridModel.rivals``).
    evidences : Evidences
        Evidences that have been computed before; new evidences are added to this object.

    Returns
    -------
    Explanations
        Probabilities of the explanations and of their combinations, and the two Bayes factors.
    """
    constant, linear = pair.values()
    names = (_SLOPES, *linear.rivals)
    combinations = subsets(names)
    models = []
    for combination in combinations:
        base = constant
        if _SLOPES in combination:
            base = linear
        models.append(base.with_rivals(*combination))
    model_evidences = [nodes.evidence for nodes in evidences.nodes(*models)]
    log_evidence = np.array([evidence.log_value for evidence in model_evidences])
    error = np.array([evidence.error for evidence in model_evidences])
    probability = probabilities(log_evidence)
    explained = []
    for combination, evidence, model_probability in zip(
        combinations, model_evidences, probability.tolist(), strict=True
    ):
        explained.append(
            Explained(
                by=combination,
                log_evidence=float(evidence.log_value),
                log_evidence_error=float(evidence.error),
                probability=model_probability,
            )
        )
    inclusion_probability = {}
    for name in names:
        includes = [name in combination for combination in combinations]
        inclusion_probability[name] = float(probability[includes].sum())
    # Every model either has slopes or not, and has some, all or none of the alternative
    # explanations. `subsets` lists the models with slopes first. The following arrays therefore
    # have two rows: the first for the models with slopes, the second for those without. They have
    # one column for each combination of alternative explanations; the last column is for no
    # alternative explanation.
    log_evidence_by_slopes = log_evidence.reshape(2, -1)
    error_by_slopes = error.reshape(2, -1)
    rival_combinations = log_evidence_by_slopes.shape[1]
    averaged = np.logaddexp.reduce(log_evidence_by_slopes, axis=1) - np.log(rival_combinations)
    averaged_error = float(error_by_slopes.max(axis=1).sum())
    alone = log_evidence_by_slopes[:, -1]
    alone_error = float(error_by_slopes[:, -1].sum())
    return Explanations(
        inclusion_probability=inclusion_probability,
        models=tuple(ranked(explained, lambda model: model.probability)),
        averaged=_compare_slopes(_AVERAGED, pair, averaged, averaged_error),
        alone=_compare_slopes("no other explanation", pair, alone, alone_error),
    )


def average_explanations(pair: Mapping[str, HybridModel], evidences: Evidences) -> Assumed:
    """Return the log Bayes factor of slopes over no slopes, averaged over other explanations.

    The result is that of ``averaged`` in `compare_explanations`, which has the same arguments, but
    it may take less time. A combination of explanations is negligible if its log evidence is at
    least 10 nat below that of another combination that agrees with it on slopes. New values of the
    hyper-parameters are not computed for a combination if it is shown to be negligible without
    them, and its evidence is only bounded if it is negligible by far; its numerical error is then
    left out. The log Bayes factor differs from that of `compare_explanations` by less than 1e-4
    nat.
    """
    constant, linear = pair.values()
    combinations = subsets(linear.rivals)
    averages = []
    error = 0.0
    for model in (linear, constant):
        log_evidences: list[float] = []
        errors = [0.0]
        for combination in combinations:
            below = max(log_evidences, default=-np.inf) - _NEGLIGIBLE
            nodes, is_negligible = evidences.nodes_unless_negligible(
                below, model.with_rivals(*combination)
            )
            log_evidences.append(nodes.evidence.log_value)
            if not is_negligible:
                errors.append(nodes.evidence.error)
        averages.append(np.logaddexp.reduce(log_evidences) - np.log(len(combinations)))
        error += max(errors)
    return _compare_slopes(_AVERAGED, pair, np.array(averages), error)


def _compare_slopes(
    label: str, pair: Mapping[str, HybridModel], log_evidence_by_slopes: Array, error: float
) -> Assumed:
    """Return the log Bayes factor of slopes over no slopes, with the two log evidences.

    ``label`` states whether alternative explanations are left out or averaged over. ``pair`` holds
    the model without slopes, then the model with slopes; the keys are their names.
    ``log_evidence_by_slopes`` has the reverse order: it holds the log evidence with slopes, then
    the log evidence without slopes. ``error`` is the numerical error of the log Bayes factor [nat].
    """
    with_slopes, without_slopes = log_evidence_by_slopes.tolist()
    constant_name, linear_name = pair
    log_evidence = {constant_name: without_slopes, linear_name: with_slopes}
    return Assumed(label, with_slopes - without_slopes, error, log_evidence)
