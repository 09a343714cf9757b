"""Slopes against other explanations of a change with force, every combination weighed.

Slopes, joint load, a curved mount and a curved force law may each explain a change with force:
every combination is a model, as probable as another beforehand, and the exact evidence says how
probable it is afterwards.
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

__all__ = ["Explained", "Explanations", "explanations", "subsets"]

# The name of the slopes among the explanations.
_SLOPES = "slopes"
# Above this log Bayes factor [nat] the readings ask for slopes.
_ASKING = 1.0


@dataclass(frozen=True)
class Explained:
    """One combination of explanations of a change with force."""

    by: tuple[str, ...]
    log_evidence: float  #: [nat]
    log_evidence_error: Finite  #: [nat]
    probability: float  #: posterior


@dataclass(frozen=True)
class Explanations:
    """Every combination of what explains a change with force, all as probable beforehand."""

    inclusion_probability: dict[str, float]  #: by explanation
    models: tuple[Explained, ...]  #: the likeliest first
    averaged: Assumed  #: with slopes and without, averaged over the other explanations
    alone: Assumed  #: with slopes and without, no other explanation: the paper's question

    @property
    def instead(self) -> tuple[str, ...]:
        """What explains the readings as well as slopes; else nothing.

        Not empty only where the readings would ask for slopes were there nothing else.
        """
        if self.alone.log_bayes_factor > _ASKING > self.averaged.log_bayes_factor:
            return next(model.by for model in self.models if _SLOPES not in model.by)
        return ()


def subsets(names: Sequence[str]) -> list[tuple[str, ...]]:
    """Return every combination of names, all of them first."""
    choices = itertools.product((True, False), repeat=len(names))
    return [tuple(itertools.compress(names, choice)) for choice in choices]


def explanations(pair: Mapping[str, HybridModel], evidences: Evidences) -> Explanations:
    """Weigh every combination of slopes and of the rivals of slopes.

    Parameters
    ----------
    pair : mapping of str to HybridModel
        Two models whose difference are the slopes, without them first, both with the same rivals.
    evidences : Evidences
        Nodes to use and to add to.
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
    evidence_of_models = [nodes.evidence for nodes in evidences.of(*models)]
    log_evidence = np.array([evidence.log_value for evidence in evidence_of_models])
    error = np.array([evidence.error for evidence in evidence_of_models])
    probability = probabilities(log_evidence)
    explained = []
    for combination, value, value_error, share in zip(
        combinations, log_evidence.tolist(), error.tolist(), probability.tolist(), strict=True
    ):
        explained.append(Explained(combination, value, value_error, share))
    inclusion_probability = {}
    for name in names:
        includes = [name in combination for combination in combinations]
        inclusion_probability[name] = float(probability[includes].sum())
    # First row: with slopes. Last column: no rival.
    by_slopes = log_evidence.reshape(2, -1)
    errors = error.reshape(2, -1)
    averaged = np.logaddexp.reduce(by_slopes, axis=1) - np.log(by_slopes.shape[1])
    return Explanations(
        inclusion_probability,
        tuple(ranked(explained, lambda model: model.probability)),
        _compare_slopes(
            "averaged over other explanations", pair, averaged, float(errors.max(axis=1).sum())
        ),
        _compare_slopes("no other explanation", pair, by_slopes[:, -1], float(errors[:, -1].sum())),
    )


def _compare_slopes(
    label: str, pair: Mapping[str, HybridModel], log_evidence: Array, error: float
) -> Assumed:
    """Compare the two models from their log evidences, with slopes first."""
    with_slopes, without_slopes = log_evidence.tolist()
    values = dict(zip(pair, (without_slopes, with_slopes), strict=True))
    return Assumed(label, with_slopes - without_slopes, error, values)
