"""Sentences on a comparison of models."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from ldbb_bayes.model.parameter_kinds import DEGREE_NAMES
from ldbb_bayes.report.wording.effect_names import joined
from ldbb_bayes.report.wording.fixed_texts import SENTENCES
from ldbb_bayes.report.wording.number_words import SURE
from ldbb_bayes.report.wording.sentence_file import SentenceFile

if TYPE_CHECKING:
    from ldbb_bayes.analysis.comparison import Comparison

__all__ = [
    "averaged_over",
    "comparison_screen",
    "comparison_sentences",
    "odd_tests_sentences",
    "strength_words",
]

_STRENGTHS = (
    # Words for the strength of evidence expressed by a Bayes factor B. Each entry has an upper
    # limit of |ln B|, and the words for smaller values of |ln B|. Source: Kass and Raftery, J. Am.
    # Stat. Assoc. 90 (1995) 773.
    (1.0, "not worth more than a bare mention"),
    (3.0, "positive evidence"),
    (5.0, "strong evidence"),
)

_TEMPLATES = SentenceFile("comparison", BARE=_STRENGTHS[0][0], SIGNS=SENTENCES["signs"], SURE=SURE)


def comparison_sentences(comparison: Comparison) -> tuple[str, ...]:
    """Return sentences on a comparison of models.

    The sentences state the evidence for each model, and how much it changes with other assumptions.
    Sentences on all other results of the comparison follow.
    """
    return _TEMPLATES.sentences("comparison_sentences", comparison)


def comparison_screen(comparison: Comparison) -> tuple[str, ...]:
    """Return the most important sentences on a comparison of models."""
    return _TEMPLATES.sentences("comparison_screen", comparison)


def odd_tests_sentences(comparison: Comparison) -> tuple[str, ...]:
    """Return sentences on the tests that do not belong with the others; empty if all belong."""
    if not any(test.stands_out for test in comparison.tests.values()):
        return ()
    return _TEMPLATES.sentences("left_out", comparison.tests)


@_TEMPLATES.filter
def strength_words(log_bayes_factor: float) -> str:
    """Return words for the strength of the evidence that a log Bayes factor [nat] states.

    The words, such as "strong evidence", depend on the absolute value of the log Bayes factor. They
    are taken from Kass and Raftery, J. Am. Stat. Assoc. 90 (1995) 773-795.
    """
    for limit, words in _STRENGTHS:
        if abs(log_bayes_factor) < limit:
            return words
    return "very strong evidence"


def averaged_over(probabilities: Mapping[str, float]) -> str:
    """Return a heading that names the models and explanations over which results are averaged.

    An alternative explanation is an effect other than compliance, such as a nonlinear mount, that
    may explain why the readings change with force. ``probabilities`` is a mapping from the names of
    the models and alternative explanations to their probabilities.
    """
    degrees = [name for name in probabilities if name in DEGREE_NAMES]
    rivals = [name for name in probabilities if name not in DEGREE_NAMES]
    beside = ""
    if rivals:
        beside = f", each with and without {joined(rivals)}"
    return f"Averaged over {joined(degrees)} compliance{beside}:"
