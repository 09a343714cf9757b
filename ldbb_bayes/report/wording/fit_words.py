"""Sentences on a fit: the model, how well it fits, and what to be careful about."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ldbb_bayes.report.wording.effect_names import (
    first_names,
    joined,
    joined_parameters,
    term_words,
)
from ldbb_bayes.report.wording.fixed_texts import IN_FORCE, PAGE, SENTENCES
from ldbb_bayes.report.wording.number_words import p_value_words
from ldbb_bayes.report.wording.sentence_file import SentenceFile
from ldbb_bayes.report.wording.span_words import doubted_spans
from ldbb_bayes.units import display_name, display_unit, is_slope, two_digits, typeset

if TYPE_CHECKING:
    from ldbb_bayes.inference.checks import Check
    from ldbb_bayes.inference.fit import Concern, Fit

__all__ = [
    "alert_sentences",
    "check_notes",
    "check_words",
    "concern_sentences",
    "confounded_sentences",
    "expectation",
    "fit_verdict",
    "model_words",
    "not_modelled_sentences",
    "quality_words",
    "sampler_words",
    "sensitive_words",
]

# largest number of posterior predictive checks, or of parameters, that a sentence on a fit names
_MOST_CHECKS = 3
# Limit for ln p, where p is the posterior probability that no compliance is negative. If ln p is
# below this limit, sentences say that the readings contradict non-negative compliances. The limit
# is ln 1e-6.
_CONTRADICTED = -13.815510557964274
# Kinds of concerns about a fit that are listed with the quality of the fit, but not at the top of
# the report.
_MINOR_CONCERNS = ("forces", "centre", "near-zero")

_TEMPLATES = SentenceFile("fit", IN_FORCE=IN_FORCE, FEW=_MOST_CHECKS)


def confounded_sentences(partners_of: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """Yield one sentence on all that is confounded in a fit, if there is anything.

    A parameter, or the change of a compliance with force, is confounded if most of its variance
    comes from effects whose standard uncertainties are assumed. The sentence names these effects.

    Parameters
    ----------
    partners_of
        Names of these effects for each confounded parameter and change. The keys are the names of
        the parameters, and names such as ``ΔC_XXX`` of the changes over the tested forces.

    Yields
    ------
    str
    """
    parameters_by_partners: dict[str, list[str]] = {}
    for name, effects in partners_of.items():
        partners = joined([term_words(effect) for effect in effects])
        parameters_by_partners.setdefault(partners, []).append(name)
    if parameters_by_partners:
        explained = ""
        if any(name.startswith("Δ") for name in partners_of):
            explained = " Δ: change over the tested forces."
        pairs = [
            f"{joined_parameters(names)} with {partners}"
            for partners, names in parameters_by_partners.items()
        ]
        yield (
            f"Confounded: {'; '.join(pairs)}.{explained} Nobody measured these effects: most of u"
            " is what was assumed of them (what would help: ldbb-bayes identify)."
        )


def not_modelled_sentences(terms: Sequence[str]) -> tuple[str, ...]:
    """Return a tuple with one sentence on the effects that the user has switched off in the model.

    The tuple is empty if the user has switched off no effect.

    ``terms`` are the class names of the model terms that describe these effects.
    """
    if not terms:
        return ()
    names = joined([term_words(term) for term in terms])
    return (f"Not modelled: {names}. No interval covers what was switched off.",)


def fit_verdict(fit: Fit) -> str:
    """Return a sentence on whether the numbers of a fit can be used."""
    return _TEMPLATES.sentence("fit_verdict", fit)


def expectation(fit: Fit) -> str:
    """Return a clause on whether the fitted model predicts readings like the measured readings."""
    return _TEMPLATES.sentence("expectation", fit)


def check_notes(fit: Fit) -> tuple[str, ...]:
    """Return a note on failed posterior predictive checks that hardly affect any credible interval.

    Failed checks that affect a credible interval are called misfits, and are not named in the note.
    The result is a tuple with the note; it is empty if there is nothing to note.
    """
    return _TEMPLATES.sentences("check_notes", fit)


def alert_sentences(fit: Fit, result: Mapping[str, Any]) -> tuple[str, ...]:
    """Return sentences that warn against the use of a fit's numbers or advise caution.

    ``result`` is the JSON record of the fit.
    """
    grave = tuple(concern for concern in fit.concerns if concern.kind not in _MINOR_CONCERNS)
    sentences = list(concern_sentences(grave, result["sampler"]))
    is_explained = not {"not-converged", "truncation", "unit", "balls"}.isdisjoint(fit.kinds)
    if fit.misfits and not is_explained:
        sentences.append(f"Misfit: {expectation(fit)}. Intervals assume that the model holds.")
    if result["model"]["preset"] == "paper":
        sentences.append(PAGE["paper"])
    return tuple(sentences)


def concern_sentences(concerns: tuple[Concern, ...], sampler: Mapping[str, Any]) -> Iterator[str]:
    """Yield a description of each concern about a fit.

    The concerns about the unit of several tests have one description, which names the tests. If the
    readings of some tests span too little and those of others too much, there are two.

    Parameters
    ----------
    concerns
        Concerns about the fit.
    sampler
        JSON record of the sampler.

    Yields
    ------
    str
        One or two sentences.
    """
    advice = "allow more steps (--max-steps)"
    if sampler.get("kind") == "independent":
        advice = "ask for more independent draws (a larger --ess)"
    yield from _unit_sentences(concerns)
    for concern in concerns:
        kind = str(concern.kind)
        name = display_name(concern.name)
        if kind == "unit":
            continue
        if kind == "forces" and concern.value == 1:
            kind = "one-force"
        verb = "contradict" if concern.value < _CONTRADICTED else "speak against"
        limit_shown = ""
        if concern.unit:
            factor, label = display_unit(concern.unit)
            limit_shown = f"{two_digits(concern.limit, factor)} {label}"
        # The value ``degree`` is inserted only into the sentence which says that the tests have too
        # few different forces. In this sentence, ``limit`` is the number of forces that the model
        # needs, which is two more than the degree of the polynomial C(F).
        sentence = SENTENCES["concerns"][kind].format(
            value=concern.value,
            p_value=p_value_words(concern.value, 1),
            limit=concern.limit,
            um=concern.value * 1e3,
            limit_um=concern.limit * 1e3,
            degree=concern.limit - 2,
            verb=verb,
            rhat=sampler.get("target_rhat", 0.0),
            advice=advice,
            name=name,
            limit_shown=limit_shown,
        )
        yield typeset(sentence)


def _unit_sentences(concerns: Sequence[Concern]) -> Iterator[str]:
    """Yield a description of the concerns about the unit of readings, if there are any.

    There is one for readings that span less than a ball bar shows, and one for those that span
    more.
    """
    for spans in doubted_spans(concerns):
        kind = "large-unit" if spans.is_large else "unit"
        sentence = SENTENCES["concerns"][kind].format(
            name=first_names(spans.tests), span=spans.span, limit_shown=spans.limit
        )
        yield typeset(sentence)


def model_words(model: Mapping[str, Any]) -> str:
    """Return a description of the fitted model. ``model`` is the JSON record of the model."""
    return _TEMPLATES.sentence("model_words", model)


def quality_words(quality: Mapping[str, Any]) -> str:
    """Return a string that states how well the model fits the readings.

    ``quality`` is the entry ``fit`` of the JSON record of the fit.
    """
    return _TEMPLATES.sentence("quality_words", quality)


def sampler_words(sampler: Mapping[str, Any]) -> str:
    """Return a sentence that states whether the sampler has converged, and the number of draws.

    The sampler has converged if its draws have reached the effective sample size that the user
    required. The sentence also states the effective sample size reached, and R-hat. ``sampler`` is
    the JSON record of the sampler.
    """
    return _TEMPLATES.sentence("sampler_words", sampler)


@_TEMPLATES.filter
def sensitive_words(names: Sequence[str]) -> str:
    """Return a string that names the parameters that are sensitive to their prior.

    ``names`` are the names of these parameters, the most sensitive first. The string names at most
    three parameters. Sensitive slopes (coefficients of the change of compliances with force) are
    not named; the string states only their number.
    """
    named = [display_name(name) for name in names if not is_slope(name)]
    count = len(names) - len(named)
    text = ", ".join(named[:_MOST_CHECKS])
    if len(named) > _MOST_CHECKS:
        text += ", …"
    if not count:
        return text
    plural = "" if count == 1 else "s"
    coefficients = f"{count} coefficient{plural} of the change with force"
    if not text:
        return coefficients
    return f"{text} and {coefficients}"


@_TEMPLATES.filter
def check_words(check: Check) -> str:
    """Return a string that states what a posterior predictive check is about.

    An example is "order 4 of f520". In this example, order 4 is the Fourier component of the
    readings at four times the angle, and f520 is the name of a test.
    """
    kinds = {"noise": "white noise", "autocorrelation": "autocorrelation"}
    kind = kinds.get(check.kind, f"order {check.order}")
    return f"{kind} of {check.test}"
