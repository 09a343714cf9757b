"""Comparison of two models under several assumptions about random differences between circles."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ldbb_bayes.inference.evidence import log_bayes_factor
from ldbb_bayes.inference.nodes import Nodes
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.terms import CircleScale, Discrepancy, SetupShift, Term
from ldbb_bayes.results import Finite

__all__ = [
    "WHITE_NOISE",
    "Assumed",
    "Change",
    "compare_under",
    "discrepancy_assumptions",
    "pairs_by_change",
]

# Type of a function that takes a model and returns a copy of the model with another assumption, for
# example about the random differences between circles.
Change = Callable[[HybridModel], HybridModel]
# Label of the comparison in which all nuisance terms of the models (effects not of interest) are
# left out. The readings then scatter by white noise only, and compliances may be negative.
WHITE_NOISE = "white noise only, no truncation"
# Label of the comparison in which the models keep their assumptions about the random differences
# between circles.
_UNCHANGED = "as in the model"


class _Alternative(NamedTuple):
    """Alternative assumption about random differences between circles."""

    label: str
    #: class of the model term that is replaced or left out; a term of this class describes random
    #: differences between circles
    kind: type[Term]
    #: model term that replaces the term of the class ``kind``; None if the term of this class is
    #: left out of the model
    term: Term | None


_ALTERNATIVES = (
    _Alternative("discrepancy κ/n", Discrepancy, Discrepancy(1.0)),
    _Alternative("discrepancy κ/n²", Discrepancy, Discrepancy(2.0)),
    _Alternative("without discrepancy", Discrepancy, None),
    _Alternative("set-up shift: one scale for orders 0 and 1", SetupShift, SetupShift("together")),
    _Alternative("set-up shift: own scales for orders 0 and 1", SetupShift, SetupShift("apart")),
    _Alternative("set-up shift of order 0 (zero) only", SetupShift, SetupShift("zero")),
    _Alternative("set-up shift of order 1 (centre) only", SetupShift, SetupShift("centre")),
    _Alternative("without set-up shift", SetupShift, None),
    _Alternative("circles of one scatter", CircleScale, None),
)


@dataclass(frozen=True)
class Assumed:
    """Log evidences of two models and their log Bayes factor under one assumption [nat].

    ``log_bayes_factor`` is the log Bayes factor of the second model over the first. ``assumption``
    is a label, such as "without set-up shift". The keys of ``log_evidence`` are the names of the
    two models.
    """

    assumption: str
    log_bayes_factor: float
    log_bayes_factor_error: Finite
    log_evidence: dict[str, float]

    @property
    def best(self) -> float:
        """Larger of the log evidences of the two compared models [nat]."""
        return max(self.log_evidence.values())


def discrepancy_assumptions(models: Collection[HybridModel]) -> dict[str, Change]:
    """Return functions that change a model's assumption about differences between circles.

    The keys are labels of the assumptions. Each function takes a model and returns a copy with
    another assumption about the random differences between circles. The first function leaves the
    assumption as it is. The last function leaves out all nuisance terms (effects not of interest),
    so that only white noise remains, and allows negative compliances. Every other function replaces
    or leaves out one model term; functions that change none of ``models`` are omitted.
    """
    changes: dict[str, Change] = {_UNCHANGED: _leave_unchanged}
    for alternative in _ALTERNATIVES:
        terms = [_term_of_kind(model, alternative.kind) for model in models]
        if any(term != alternative.term for term in terms):
            changes[alternative.label] = _change_to(alternative)
    changes[WHITE_NOISE] = _reduce_to_white_noise
    return changes


def _term_of_kind(model: HybridModel, kind: type[Term]) -> Term | None:
    """Return a model's nuisance term (effect not of interest) of the class ``kind``, or None."""
    for term in model.nuisances:
        if isinstance(term, kind):
            return term
    return None


def _leave_unchanged(model: HybridModel) -> HybridModel:
    """Return ``model`` as it is.

    Other functions of the same kind change a model's assumption about random differences between
    circles. This function stands for the case in which the assumption is kept.
    """
    return model


def _change_to(alternative: _Alternative) -> Change:
    """Return a function that changes the assumption of a model about differences between circles.

    The function takes a model and returns a copy. In the copy, the term that describes the random
    differences between circles is replaced or left out, as ``alternative`` states.
    """

    def change(model: HybridModel) -> HybridModel:
        """Return a copy of the model with another assumption about differences between circles.

        The model term that describes the random differences between circles is replaced or left
        out.
        """
        if alternative.term is None:
            return model.without(alternative.kind.key())
        return model.with_term(alternative.term)

    return change


def _reduce_to_white_noise(model: HybridModel) -> HybridModel:
    """Return a copy of ``model`` with white noise only, in which compliances may be negative.

    All nuisance terms of the model (effects not of interest) are left out.
    """
    return model.without("truncation", *(kind.key() for kind in Term.kinds.values()))


def pairs_by_change(
    pair: Iterable[HybridModel], changes: Mapping[str, Change]
) -> dict[str, tuple[HybridModel, ...]]:
    """Return changed copies of the two models ``pair``, one pair of copies for each change.

    ``changes`` holds functions that take a model and return a copy with another assumption or
    another prior, for example from `discrepancy_assumptions`. The keys of ``changes`` and of the
    result are labels of the changes. A change is left out if it makes the two models equal.
    """
    pair = tuple(pair)
    pairs = {}
    for label, change in changes.items():
        models = tuple(change(model) for model in pair)
        if models[0] != models[1]:
            pairs[label] = models
    return pairs


def compare_under(
    names: Iterable[str],
    assumptions: Mapping[str, Sequence[HybridModel]],
    weigh: Callable[..., Sequence[Nodes]],
) -> tuple[Assumed, ...]:
    """Return the log evidences and the log Bayes factor of two models under every assumption.

    The Bayes factor is the ratio of the second model's evidence to the first model's.

    Parameters
    ----------
    names : iterable of str
        Names of the two models.
    assumptions : mapping of str to sequence of HybridModel
        The two models under each assumption, from `pairs_by_change`; the keys are labels of
        assumptions.
    weigh : callable
        Function that takes models as arguments and returns, for each model, the quadrature nodes
        (weighted values of the hyper-parameters) of its posterior. The nodes hold the evidence of
        the model.
    """
    names = tuple(names)
    comparisons = []
    for label, models in assumptions.items():
        first, second = (nodes.evidence for nodes in weigh(*models))
        log_evidence = dict(zip(names, (first.log_value, second.log_value), strict=True))
        log_factor, error = log_bayes_factor(second, first)
        comparisons.append(Assumed(label, log_factor, error, log_evidence))
    return tuple(comparisons)
