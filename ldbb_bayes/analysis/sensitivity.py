"""Two models compared under other assumptions about how circles differ from one another."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ldbb_bayes.inference.evidence import log_bayes_factor
from ldbb_bayes.inference.nodes import Nodes
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.terms import CircleScale, Discrepancy, SetupShift, Term
from ldbb_bayes.results import Finite

__all__ = ["WHITE_NOISE", "Assumed", "Change", "changed", "discrepancy_assumptions", "under"]

# From a model to the same under another assumption.
Change = Callable[[HybridModel], HybridModel]
# The assumption that leaves nothing but white noise.
WHITE_NOISE = "white noise only, no truncation"
# The assumption that changes nothing.
_UNCHANGED = "as in the model"


class _Alternative(NamedTuple):
    """Another idea of how circles differ."""

    label: str
    kind: type[Term]  #: the term that it is about
    term: Term | None  #: what takes its place


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
    """The comparison under one assumption: log evidence of both models, second over first [nat]."""

    assumption: str
    log_bayes_factor: float
    log_bayes_factor_error: Finite
    log_evidence: dict[str, float]

    @property
    def best(self) -> float:
        """The larger of the log evidences."""
        return max(self.log_evidence.values())


def discrepancy_assumptions(models: Collection[HybridModel]) -> dict[str, Change]:
    """Return assumptions of how circles may differ from one another, by label.

    First what the models say, then one idea after the other changed, and last white noise alone.
    """
    changes: dict[str, Change] = {_UNCHANGED: _leave_unchanged}
    for alternative in _ALTERNATIVES:
        terms = [_term_of_kind(model, alternative.kind) for model in models]
        if any(term != alternative.term for term in terms):
            changes[alternative.label] = _change_to(alternative)
    changes[WHITE_NOISE] = _reduce_to_white_noise
    return changes


def _term_of_kind(model: HybridModel, kind: type[Term]) -> Term | None:
    """Return a model's term of a kind, or None."""
    for term in model.nuisances:
        if isinstance(term, kind):
            return term
    return None


def _leave_unchanged(model: HybridModel) -> HybridModel:
    return model


def _change_to(alternative: _Alternative) -> Change:
    """Return the change of a model to an alternative."""

    def change(model: HybridModel) -> HybridModel:
        if alternative.term is None:
            return model.without(alternative.kind.key())
        return model.with_term(alternative.term)

    return change


def _reduce_to_white_noise(model: HybridModel) -> HybridModel:
    return model.without("truncation", *(kind.key() for kind in Term.kinds.values()))


def changed(
    pair: Iterable[HybridModel], changes: Mapping[str, Change]
) -> dict[str, tuple[HybridModel, ...]]:
    """Return the two models under every assumption that leaves a difference between them."""
    pair = tuple(pair)
    pairs = {}
    for label, change in changes.items():
        models = tuple(change(model) for model in pair)
        if models[0] != models[1]:
            pairs[label] = models
    return pairs


def under(
    names: Iterable[str],
    assumptions: Mapping[str, Sequence[HybridModel]],
    weigh: Callable[..., Sequence[Nodes]],
) -> tuple[Assumed, ...]:
    """Return the two models compared under every assumption.

    Parameters
    ----------
    names : iterable of str
        Names of the two models.
    assumptions : mapping of str to sequence of HybridModel
        The two models by assumption, from `changed`.
    weigh : callable
        Returns the nodes of models.
    """
    names = tuple(names)
    comparisons = []
    for label, models in assumptions.items():
        first, second = (nodes.evidence for nodes in weigh(*models))
        log_evidence = dict(zip(names, (first.log_value, second.log_value), strict=True))
        log_factor, error = log_bayes_factor(second, first)
        comparisons.append(Assumed(label, log_factor, error, log_evidence))
    return tuple(comparisons)
