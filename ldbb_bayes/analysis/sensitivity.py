"""What a comparison rests on: two models under other assumptions, what else explains a change with
force, subsets of slopes.

Slopes, joint load, a curved mount and a curved force law may each explain a change with force, and
every compliance may have a slope or none: every combination is a model, as probable as another
beforehand, and the exact evidence says how probable it is afterwards. C(F) is averaged over all
subsets of slopes; where there are too many (several planes), over those that a search from the best
to its neighbours visits first.

Local fits take compliance as constant over two neighbouring force levels: what varies from pair to
pair is what a slope would have to explain. For every pair both the paper's least squares (Tables 7
and 8) and the posterior with nuisances. Pairs overlap and share ball form, bar length and mount:
neighbouring estimates err together, so the scatter of the points says less than their bars seem to.
Geometry is free in every pair, which therefore estimates the tangent d(F C)/dF = C + F dC/dF, not
C(F) itself: the two are one only where compliance is constant.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import methodcaller

from ldbb_bayes.inference.evidence import log_bayes_factor
from ldbb_bayes.inference.nodes import Nodes
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.terms import CircleScale, Discrepancy, SetupShift, Term
from ldbb_bayes.results import Finite

__all__ = ["Assumed", "WHITE_NOISE", "changed", "discrepancy_assumptions", "under"]

Change = Callable[[HybridModel], HybridModel]
WHITE_NOISE = "white noise only, no truncation"
_DISCREPANCIES: tuple[tuple[str, type[Term], Term | None], ...] = (
    ("discrepancy κ/n", Discrepancy, Discrepancy(1.0)),
    ("discrepancy κ/n²", Discrepancy, Discrepancy(2.0)),
    ("without discrepancy", Discrepancy, None),
    ("set-up shift: one scale for orders 0 and 1", SetupShift, SetupShift("together")),
    ("set-up shift: own scales for orders 0 and 1", SetupShift, SetupShift("apart")),
    ("set-up shift of order 0 (zero) only", SetupShift, SetupShift("zero")),
    ("set-up shift of order 1 (centre) only", SetupShift, SetupShift("centre")),
    ("without set-up shift", SetupShift, None),
    ("circles of one scatter", CircleScale, None),
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
    """Return how circles may differ from one another: what the models say, one idea after the other
    changed, and not at all."""
    changes: dict[str, Change] = {"as in the model": replace}
    for label, kind, term in _DISCREPANCIES:
        if any(
            next((own for own in model.nuisances if isinstance(own, kind)), None) != term
            for model in models
        ):
            changes[label] = (
                methodcaller("without", kind.key())
                if term is None
                else methodcaller("with_term", term)
            )
    return changes | {
        WHITE_NOISE: methodcaller(
            "without", "truncation", *(kind.key() for kind in Term.kinds.values())
        )
    }


def changed(
    pair: Iterable[HybridModel], changes: Mapping[str, Change]
) -> dict[str, tuple[HybridModel, ...]]:
    """Return the two models under every assumption that leaves a difference between them."""
    both = {label: tuple(map(change, pair)) for label, change in changes.items()}
    return {label: models for label, models in both.items() if models[0] != models[1]}


def under(
    names: Iterable[str],
    assumptions: Mapping[str, Sequence[HybridModel]],
    weigh: Callable[..., Sequence[Nodes]],
) -> tuple[Assumed, ...]:
    """Return the two models compared under every assumption."""
    assumed = []
    for label, models in assumptions.items():
        one, two = (nodes.evidence for nodes in weigh(*models))
        values = dict(zip(names, (one.log_value, two.log_value), strict=True))
        assumed.append(Assumed(label, *log_bayes_factor(two, one), values))
    return tuple(assumed)
