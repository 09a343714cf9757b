"""Sentences on the method of a fit, and on what the model leaves out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, TypeVar

from ldbb_bayes.campaign.run_times import TimeSource, time_source
from ldbb_bayes.model.terms import BallForm, Drift, Term
from ldbb_bayes.report.wording.effect_names import joined, term_words
from ldbb_bayes.report.wording.fixed_texts import PAGE

if TYPE_CHECKING:
    from ldbb_bayes.model.hybrid import BoundModel

__all__ = ["method_sentences"]

_Kind = TypeVar("_Kind", bound=Term)

_METHOD = PAGE["method"]
# Parts of every model that are no effects beside the parameters.
_PARAMETERS = ("Compliance", "GeometricErrors")
_DRIFT_BY_SOURCE = {
    TimeSource.TIMES: _METHOD["drift_by_times"],
    TimeSource.LISTED: _METHOD["drift_as_listed"],
}


def method_sentences(bound: BoundModel) -> tuple[str, ...]:
    """Return sentences on what a model assumes, each true of the model and of the campaign.

    ``bound`` is the model, applied to the campaign whose readings were fitted.
    """
    effects = [term_words(name) for name in bound.terms if name not in _PARAMETERS]
    of_readings = f"{_METHOD['readings_alone']} {_METHOD['article_alone']}"
    if effects:
        readings = _METHOD["readings"].format(effects=joined(effects))
        of_readings = f"{readings} {_METHOD['article']}"
    of_drift = _drift_sentence(bound)
    return (
        of_readings,
        _METHOD["intervals"],
        " ".join(_ball_form_sentences(bound)),
        f"{_METHOD['compliance']} {of_drift}".rstrip(),
        _METHOD["rigid"],
    )


def _ball_form_sentences(bound: BoundModel) -> Iterator[str]:
    """Yield sentences on how the model takes the form of the balls."""
    term = _term_of(bound, BallForm)
    if term is None:
        yield _METHOD["no_ball_form"]
        return
    if term.law == "1/n":
        yield _METHOD["ball_form_of_first_edition"]
        return
    instrument = bound.campaign.instrument
    balls = (instrument.work, instrument.tool)
    if any(ball.stated_sphericity_um is not None or ball.harmonics_um for ball in balls):
        yield _METHOD["stated_ball_form"]
    if any(ball.stated_sphericity_um is None for ball in balls):
        yield _METHOD["assumed_ball_form"].format(sphericity_um=term.sphericity_um)


def _drift_sentence(bound: BoundModel) -> str:
    """Return a sentence on drift, or an empty string if no drift could show in the readings."""
    source = time_source(bound.campaign)
    drift = _term_of(bound, Drift)
    if source == TimeSource.NO_DRIFT:
        return str(_METHOD["nothing_drifts"])
    if drift is None:
        return str(_METHOD["no_drift"])
    if Drift.__name__ in bound.terms:
        if drift.over == "temperature":
            return str(_METHOD["drift_with_temperature"])
        return str(_DRIFT_BY_SOURCE[source])
    if source == TimeSource.RANDOM:
        return str(_METHOD["drift_in_random_order"])
    return ""


def _term_of(bound: BoundModel, kind: type[_Kind]) -> _Kind | None:
    """Return the term of the model of one kind, or None if the model does not have it."""
    for term in bound.model.nuisances:
        if isinstance(term, kind):
            return term
    return None
