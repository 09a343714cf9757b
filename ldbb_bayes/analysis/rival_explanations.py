"""Slopes against other explanations of a change with force, every combination weighed."""

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

__all__ = ["Explanations", "explanations", "subsets"]


_SLOPES = "slopes"


_ASKED = 1.0


@dataclass(frozen=True)
class Explained:
    """One combination of explanations of a change with force, its log evidence and error, and its
    posterior probability."""

    by: tuple[str, ...]
    log_evidence: float
    log_evidence_error: Finite
    probability: float


@dataclass(frozen=True)
class Explanations:
    """Every combination of what explains a change with force, each as probable as another
    beforehand, the likeliest first; the two models ``averaged`` over the explanations other than
    slopes, and ``alone``, with none of these: the paper's question."""

    inclusion_probability: dict[str, float]
    models: tuple[Explained, ...]
    averaged: Assumed
    alone: Assumed

    @property
    def instead(self) -> tuple[str, ...]:
        """What explains the readings as well as slopes, which they would ask for were there nothing
        else; else nothing."""
        asked = self.alone.log_bayes_factor > _ASKED > self.averaged.log_bayes_factor
        return next(own.by for own in self.models if _SLOPES not in own.by) if asked else ()


def subsets(names: Sequence[str]) -> list[tuple[str, ...]]:
    """Return every combination of names, all of them first."""
    return [
        tuple(itertools.compress(names, there))
        for there in itertools.product((True, False), repeat=len(names))
    ]


def explanations(pair: Mapping[str, HybridModel], evidences: Evidences) -> Explanations:
    """Weigh every combination of slopes, the difference of two models, and of the rivals of slopes
    that both have."""
    constant, linear = pair.values()
    names = (_SLOPES, *linear.rivals)
    combined = subsets(names)
    weighed = evidences.of(
        *((linear if _SLOPES in by else constant).with_rivals(*by) for by in combined)
    )
    value, error = (
        np.array([getattr(nodes.evidence, part) for nodes in weighed])
        for part in ("log_value", "error")
    )
    share = probabilities(value)
    found = map(Explained, combined, value.tolist(), error.tolist(), share.tolist())

    def assumed(label: str, log_evidence: Array, error: float) -> Assumed:
        slopes, none = log_evidence.tolist()
        return Assumed(label, slopes - none, error, dict(zip(pair, (none, slopes), strict=True)))

    by_slopes = value.reshape(2, -1)
    errors = error.reshape(2, -1)
    averaged = np.logaddexp.reduce(by_slopes, axis=1) - np.log(by_slopes.shape[1])
    return Explanations(
        {name: float(share[[name in by for by in combined]].sum()) for name in names},
        tuple(ranked(found, lambda own: own.probability)),
        assumed("averaged over other explanations", averaged, float(errors.max(axis=1).sum())),
        assumed("no other explanation", by_slopes[:, -1], float(errors[:, -1].sum())),
    )
