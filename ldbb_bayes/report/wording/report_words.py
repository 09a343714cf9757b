"""Sentences of the HTML page, and on differences between campaigns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ldbb_bayes.analysis.parameter_changes import (
    LARGEST_P_OF_CONFLICT,
    changed_parameters,
    differences_can_be_used,
)
from ldbb_bayes.model.parameter_kinds import DEGREE_NAMES
from ldbb_bayes.model.terms import Term
from ldbb_bayes.report.wording.effect_names import joined, joined_parameters
from ldbb_bayes.report.wording.fixed_texts import PAGE
from ldbb_bayes.report.wording.sentence_file import SentenceFile
from ldbb_bayes.units import display_name, plus_minus

if TYPE_CHECKING:
    from collections.abc import Mapping

    import pandas as pd

    from ldbb_bayes.analysis.common_effects import Shared

__all__ = [
    "NO_ANNEX",
    "annex_words",
    "change_sentence",
    "common_words",
    "difference_doubts",
    "difference_reservations",
    "unusable_fit_sentences",
]

NO_ANNEX = "left out with the annex (--sheets-only)"


_TEMPLATES = SentenceFile("page", DEGREES=DEGREE_NAMES, PAGE=PAGE)


def annex_words(degree: int, averaged: bool) -> str:
    """Return a sentence that names the model whose numbers the annex shows.

    The annex consists of the sections of the report that follow the two sheets of the certificate.
    ``degree`` is the degree of compliance as a function of force in this model; ``averaged`` states
    whether the numbers of the sheets are averages over models.
    """
    return _TEMPLATES.sentence("annex_words", degree, averaged)


def common_words(force_N: float, shared: Shared) -> str:
    """Return sentences on what a comparison of two campaigns assumes.

    The sentences state the force ``force_N`` [N] at which compliances are compared, and whether
    both campaigns used the same instrument and the same machine.
    """
    return _TEMPLATES.sentence("common_words", force_N, shared)


def difference_doubts(first: str, other: str, attributes: Mapping[Any, Any]) -> tuple[str, ...]:
    """Return sentences on reasons not to use the differences between two campaigns.

    ``first`` and ``other`` are the names of the campaigns, and ``attributes`` are the attributes of
    the table of differences (`compare_posteriors`). The tuple is empty if there is no such reason.
    Reasons not to use one of the two fits at all are left out. There are two possible reasons:

    - The campaigns are said to have the instrument or the machine in common, but their fits
      disagree about an effect of it, which is a coefficient of the model. The attribute
      ``conflict`` holds the name of the coefficient with the largest disagreement, and the p-value
      of this disagreement, multiplied by the number of compared coefficients (Bonferroni). A
      sentence names the coefficient only if this p-value is below 1 %. ``conflict`` is None if no
      coefficient can be compared.
    - The readings of a campaign contradict a prior of its model (``contradicted_priors``).
    """
    sentences: list[str] = []
    conflict = attributes.get("conflict")
    if conflict is not None and conflict[1] < LARGEST_P_OF_CONFLICT:
        of_machine = Term.owner(conflict[0]).machine
        sentences += _TEMPLATES.sentences("difference_doubts", first, other, conflict, of_machine)
    contradicted = attributes.get("contradicted_priors", ())
    for name, parameters in zip((first, other), contradicted, strict=False):
        if parameters:
            priors = joined_parameters(parameters)
            sentences.append(PAGE["contradicted_prior"].format(campaign=name, parameters=priors))
    return tuple(sentences)


def unusable_fit_sentences(
    first: str, other: str, converged: bool, attributes: Mapping[Any, Any]
) -> tuple[str, ...]:
    """Return sentences on two compared fits whose numbers cannot be used.

    A sentence says that the fit of the second campaign has not converged (``converged`` is then
    false), that the unit of a campaign's readings is in doubt (``doubted_units``), or that a fit
    cannot be used for another reason (``fits``). The arguments are those of `difference_doubts`.
    """
    sentences = []
    if not converged:
        sentences.append(PAGE["not_converged"].format(campaign=other))
    for name, tests in zip((first, other), attributes.get("doubted_units", ()), strict=False):
        if tests:
            sentences.append(PAGE["doubted_unit"].format(campaign=name))
    for name, fit in zip((first, other), attributes.get("fits", ()), strict=False):
        if fit.contradicts_model:
            sentences.append(PAGE["unusable_fit"].format(campaign=name))
    return tuple(sentences)


def difference_reservations(attributes: Mapping[Any, Any]) -> tuple[str, ...]:
    """Return a sentence on the parts in which the models of two compared fits differ.

    ``attributes`` are the attributes of the table of differences (`compare_posteriors`). The tuple
    is empty if the models are alike.
    """
    parts = attributes.get("differing_parts", ())
    if not parts:
        return ()
    return (PAGE["other_model"].format(parts=joined(parts)),)


def change_sentence(
    first: str,
    other: str,
    table: pd.DataFrame,
    prob: float,
    *,
    of_U: pd.DataFrame | None = None,
) -> str:
    """Return sentences that name the parameters in which two campaigns differ.

    ``first`` and ``other`` are the names of the campaigns; ``table`` holds the differences of all
    parameters. A parameter is named if the credible interval of its difference excludes zero;
    ``prob`` is the probability of this interval. Slopes (coefficients of the change of compliance
    with force) are not named. If a parameter is named, a second sentence names those that have
    changed when the number of comparisons is allowed for (`changed_parameters`). If the differences
    cannot be used, no parameter is named.

    U (k = 2) is stated from ``of_U``, the same table with intervals of 95 %. Default: ``table``,
    whose intervals are then of 95 %.
    """
    if not differences_can_be_used(table.attrs):
        return PAGE["unnamed_changes"].format(first=first, other=other)
    changed = changed_parameters(table, prob)
    sizes = []
    of_U = table if of_U is None else of_U
    for name, row in of_U.loc[list(changed.alone)].iterrows():
        interval = (row["ci_low"], row["ci_high"])
        size = plus_minus(row["difference"], row["sd"], interval, row["unit"])
        sizes.append(f"{display_name(str(name))} {size}")
    together = [display_name(name) for name in changed.together]
    return _TEMPLATES.sentence(
        "change_sentence", first, other, sizes, together, changed.compared, f"{100 * prob:g}"
    )
