"""What a comparison is repeated under: other scales of the slopes, other ideas of how circles differ, nuisances on or off."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.analysis.evidences import Evidences
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.inference.evidence import log_bayes_factor
from ldbb_bayes.model.columns import Nuisance
from ldbb_bayes.model.hybrid import NUISANCES, HybridModel
from ldbb_bayes.model.terms import Covariate, Discrepancy, Drift, SetupShift

__all__ = [
    "SLOPE_SCALES",
    "WHITE_NOISE",
    "Assumed",
    "Assumption",
    "compare_under",
    "crossings",
    "discrepancy_assumptions",
    "nuisance_assumptions",
    "with_slope_scale",
]

Array = NDArray[Any]
Change = Callable[[HybridModel], HybridModel]
SLOPE_SCALES = (0.03, 0.05, 0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.0, 1.5, 2.0, 3.0)
WHITE_NOISE = "white noise only, no truncation"
_AS_GIVEN = "as in the model"
_WORDS = {"setup-shift": "set-up shift"}


@dataclass(frozen=True)
class Assumption:
    """A change of the models compared, and its name."""

    label: str
    change: Change


@dataclass(frozen=True)
class Assumed:
    """The comparison under one assumption.

    Attributes
    ----------
    label : str
    log_evidence : mapping of model to float
        ln Z [nat].
    log_bayes_factor, error : float
        Second model over first [nat].
    """

    label: str
    log_evidence: Mapping[str, float]
    log_bayes_factor: float
    error: float


def compare_under(
    pair: Mapping[str, HybridModel], assumptions: Iterable[Assumption], evidences: Evidences
) -> tuple[Assumed, ...]:
    """The two models compared under every assumption that leaves a difference between them."""
    found = []
    for assumption in assumptions:
        if assumption.change(next(iter(pair.values()))) in [assumption.change(model) for model in list(pair.values())[1:]]:
            continue
        weighed = {name: evidences.of(assumption.change(model)).evidence for name, model in pair.items()}
        first, second = weighed.values()
        values = {name: evidence.log_value for name, evidence in weighed.items()}
        found.append(Assumed(assumption.label, values, *log_bayes_factor(second, first)))
    return tuple(found)


def with_slope_scale(scale: float) -> Assumption:
    """The slopes' prior sd as this multiple of sd(C) over the range of force."""
    return Assumption(f"slope scale {scale:g}", lambda model: model.with_slope_scale(scale))


def discrepancy_assumptions(models: Mapping[str, HybridModel]) -> Iterator[Assumption]:
    """How circles may differ from one another: what the models say, then one idea after the other changed."""
    yield Assumption(_AS_GIVEN, lambda model: model)
    ideas: tuple[tuple[str, type[Nuisance], Nuisance | None], ...] = (
        ("discrepancy κ/n", Discrepancy, Discrepancy(1.0)),
        ("discrepancy κ/n²", Discrepancy, Discrepancy(2.0)),
        ("without discrepancy", Discrepancy, None),
        ("set-up shift: one scale for orders 0 and 1", SetupShift, SetupShift("together")),
        ("set-up shift: own scales for orders 0 and 1", SetupShift, SetupShift("apart")),
        ("set-up shift of order 0 (zero) only", SetupShift, SetupShift("zero")),
        ("set-up shift of order 1 (centre) only", SetupShift, SetupShift("centre")),
        ("without set-up shift", SetupShift, None),
    )
    for label, kind, term in ideas:
        if any(_term(model, kind) != term for model in models.values()):
            yield Assumption(label, partial(_with_term, kind=kind, term=term))


def nuisance_assumptions(models: Mapping[str, HybridModel], campaign: Campaign) -> Iterator[Assumption]:
    """Every nuisance that can act on the campaign switched over, the truncation switched over, and nothing but white noise."""
    yield Assumption(_AS_GIVEN, lambda model: model)
    for name, kind in NUISANCES.items():
        words = _WORDS.get(name, name.replace("-", " "))
        if name == "hysteresis" and not _both_ways(campaign):
            continue
        if any(_term(model, kind) is not None for model in models.values()):
            yield Assumption(f"without {words}", partial(_with_term, kind=kind, term=None))
            continue
        terms: list[Nuisance] = [kind()]
        if name == "drift":
            terms = [Drift(over) for over, values in _recorded(campaign) if None not in values and len(set(values)) > 1]
        for term in terms:
            over = f" over {term.over}" if isinstance(term, Drift) else ""
            yield Assumption(f"with {words}{over}", partial(_with_term, kind=kind, term=term))
    truncated = any(model.prior.truncated for model in models.values())
    label = "without truncation" if truncated else "with truncation"
    yield Assumption(label, lambda model: replace(model, prior=replace(model.prior, truncated=not truncated)))
    yield Assumption(WHITE_NOISE, lambda model: model.without(*NUISANCES, "truncation"))


def crossings(scale: Array, log_bayes_factor: Array) -> tuple[float, ...]:
    """Scales at which the log Bayes factor changes sign, interpolated in the logarithm of the scale."""
    x, found = np.log(scale), []
    for i in np.flatnonzero(np.sign(log_bayes_factor[1:]) * np.sign(log_bayes_factor[:-1]) < 0):
        share = log_bayes_factor[i] / (log_bayes_factor[i] - log_bayes_factor[i + 1])
        found.append(float(np.exp(x[i] + share * (x[i + 1] - x[i]))))
    return tuple(found)


def _both_ways(campaign: Campaign) -> bool:
    return any({"CW", "CCW"} <= {t.direction for t in campaign.tests if t.plane == plane} for plane in campaign.machine().planes)


def _recorded(campaign: Campaign) -> tuple[tuple[Covariate, list[float | None]], ...]:
    """What the tests record that could drive a drift."""
    return (
        ("time", [test.time_s for test in campaign.tests]),
        ("temperature", [test.temperature_C for test in campaign.tests]),
    )


def _term(model: HybridModel, kind: type[Nuisance]) -> Nuisance | None:
    return next((term for term in model.nuisances if isinstance(term, kind)), None)


def _with_term(model: HybridModel, kind: type[Nuisance], term: Nuisance | None) -> HybridModel:
    """The model with this term in the place of its own of that kind, in the order of all."""
    by_kind = {type(own): own for own in model.nuisances if not isinstance(own, kind)}
    if term is not None:
        by_kind[type(term)] = term
    return replace(model, nuisances=tuple(by_kind[kind] for kind in NUISANCES.values() if kind in by_kind))
