"""Sentences about results: functions that choose templates and fill in the values.

The templates of the sentences are in the files sentences.toml and sentences.j2. Most templates have
a key, which names the kind of result that the sentence is about. Decisions, such as a verdict, are
values in the results; the program never takes them from the text of a sentence.

Two terms occur in many descriptions below. A degeneracy is a combination of parameters and other
effects that the readings cannot separate. A nuisance coefficient describes an effect that is
modelled but not of interest.
"""

from __future__ import annotations

import re
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import cache, singledispatch
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jinja2

from ldbb_bayes.campaign.preview import CampaignPreview, Remark, TestPreview
from ldbb_bayes.model.hybrid import DEGREE_NAMES
from ldbb_bayes.model.terms import Hysteresis, Term
from ldbb_bayes.model.terms.base import Uncertainty
from ldbb_bayes.model.terms.columns import OWN
from ldbb_bayes.results import registered_function
from ldbb_bayes.units import (
    digits_apart,
    display_name,
    display_unit,
    is_slope,
    plus_minus,
    ranked,
    round_uncertainty,
    two_digits,
    typeset,
    value_and_uncertainty,
    without_slopes,
)

if TYPE_CHECKING:
    import pandas as pd

    from ldbb_bayes.analysis.aliases import Degeneracy
    from ldbb_bayes.analysis.budgets import Budget
    from ldbb_bayes.analysis.calibration import Validation
    from ldbb_bayes.analysis.comparison import Comparison
    from ldbb_bayes.analysis.cures import Cure
    from ldbb_bayes.analysis.design import Design, GoalDesign, NextCircle
    from ldbb_bayes.analysis.design.aims_so_far import GoalSoFar
    from ldbb_bayes.analysis.design.goal_design import StatedGoal
    from ldbb_bayes.analysis.machine_description import VisibleParameter
    from ldbb_bayes.analysis.remedies import Remedy
    from ldbb_bayes.analysis.verdicts import (
        ChangeIdentifiability,
        Identifiability,
        ParameterIdentifiability,
    )
    from ldbb_bayes.analysis.workflow import Workflow
    from ldbb_bayes.inference.checks import Check
    from ldbb_bayes.inference.fit import Concern, Fit

__all__ = [
    "ALIKE",
    "ALL_DETAILS",
    "IN_FORCE",
    "IN_PAIRS",
    "MORE",
    "NONE_ALIKE",
    "NO_ANNEX",
    "PAGE",
    "TO_NARROW",
    "TO_SEPARATE",
    "alert_sentences",
    "annex_words",
    "assumed_words",
    "assumption_words",
    "averaged_over",
    "caveat_words",
    "certificate_rows",
    "certificate_words",
    "change_sentence",
    "changes_by_words",
    "check_notes",
    "check_words",
    "comparison_screen",
    "comparison_sentences",
    "concern_sentences",
    "confounded_sentences",
    "cure_items",
    "cure_words",
    "degeneracy_items",
    "degeneracy_sentence",
    "design_notes",
    "design_screen",
    "design_sentences",
    "difference_doubts",
    "direction_words",
    "expectation",
    "fit_verdict",
    "goal_design_head",
    "goal_design_sentences",
    "held_by_words",
    "identifiability_screen",
    "identifiability_sentences",
    "instrument_words",
    "interval_of",
    "joined",
    "joined_sizes",
    "limit_words",
    "machine_sentences",
    "model_words",
    "next_circle_goals",
    "next_circle_head",
    "next_circle_model",
    "not_modelled_sentences",
    "nuisance_words",
    "origin_words",
    "origins_in_words",
    "paired_remedy_items",
    "peculiarity_sentences",
    "percent_of",
    "population_doubts",
    "population_sentences",
    "preview_sentences",
    "probability_words",
    "quality_words",
    "remark_words",
    "remedy_in_words",
    "remedy_words",
    "sampler_words",
    "sensitive_words",
    "short_verdict_words",
    "source_unit_words",
    "source_words",
    "strength_words",
    "sum_in_words",
    "term_words",
    "travel_words",
    "trend_sentences",
    "unit_words",
    "validation_verdict",
    "verdict_words",
    "with_words",
    "workflow_sentences",
]

_TEMPLATES = Path(__file__).parent / "templates"
_SENTENCES: Mapping[str, Any] = tomllib.loads(
    (_TEMPLATES / "sentences.toml").read_text(encoding="utf-8")
)
PAGE: Mapping[str, Any] = _SENTENCES["page"]
IN_FORCE = ("constant", "linear in force", "quadratic in force")
ALIKE = "The readings of this campaign cannot separate:"
IN_PAIRS = "One cure leaves these confounded; two, U then:"
TO_SEPARATE = "To separate what looks exactly alike:"
TO_NARROW = "What would narrow them:"
ALL_DETAILS = "Priors, origins and what no reading separates: --details."
NO_ANNEX = "left out with the annex (--sheets-only)"
MORE = "All of it: print(result.details()). For programs: lb.report.with_words(result)."
NONE_ALIKE = "The readings determine every combination of what the model contains."

# ---- limits at which the wording of sentences changes; no result depends on them

# Sentences on a design compare it with a design in equal steps of force. For each parameter they
# use a ratio: the uncertainty expected after the recommended design, divided by the uncertainty
# expected after the design in equal steps. The ratios of two parameters count as equal if they
# differ by less than this value.
_EQUAL_RATIOS = 2e-3
# Uncertainties that are averaged over constant and linear compliance are named if they differ by
# more than this fraction from those of linear compliance.
_NOTICEABLE = 0.1
# largest number of posterior predictive checks, or of parameters, that a sentence on a fit names
_MOST_CHECKS = 3
# Limit for ln p, where p is the posterior probability that no compliance is negative. If ln p is
# below this limit, sentences say that the readings contradict non-negative compliances. The limit
# is ln 1e-6.
_CONTRADICTED = -13.815510557964274
# Kinds of concerns about a fit that are listed with the quality of the fit, but not at the top of
# the report.
_MINOR_CONCERNS = ("forces", "centre", "near-zero")
# If a change has at least this probability, sentences state it as a fact. The change may be that a
# compliance increases or decreases with force, or that a slope (a coefficient of this change)
# differs from zero.
_SURE = 0.95
# A difference of probabilities that is at most this value counts as zero, because it may be a
# rounding error.
_ROUNDING = 1e-9
_MOST_NAMES = 5  # largest number of campaigns or tests that a sentence names
# If more campaigns than this lie outside the control limits, a sentence names only the first ones.
_MOST_JOINED = 3
_MOST_LISTED_TESTS = 12  # largest number of tests to run that a sentence lists
# Probabilities below this value, which would be rounded to 0.000, are stated as "< 0.001".
_UNLIKELY = 5e-4
# Two campaigns with the same instrument have two estimates of each error of this instrument. A
# sentence states that the campaigns disagree about an error if the p-value of the difference of its
# two estimates is below this value.
_CONFLICT = 0.01
# A row of the table of certificates names the parameters that the certificate would make less
# uncertain. A parameter is named only if its standard uncertainty would fall below this fraction of
# the present value.
_NARROWER = 0.9
_STRENGTHS = (
    # Words for the strength of evidence expressed by a Bayes factor B. Each entry has an upper
    # limit of |ln B|, and the words for smaller values of |ln B|. Source: Kass and Raftery, J. Am.
    # Stat. Assoc. 90 (1995) 773.
    (1.0, "not worth more than a bare mention"),
    (3.0, "positive evidence"),
    (5.0, "strong evidence"),
)


# ---- templates of sentences


@cache
def _environment() -> jinja2.Environment:
    """Return the Jinja environment for the templates of the sentences about results."""
    loader = jinja2.PackageLoader("ldbb_bayes.report")
    environment = jinja2.Environment(loader=loader, undefined=jinja2.StrictUndefined)
    for function in (
        joined,
        display_name,
        typeset,
        term_words,
        nuisance_words,
        check_words,
        remark_words,
        caveat_words,
        peculiarity_sentences,
        probability_words,
        strength_words,
        sensitive_words,
        repr,
    ):
        environment.filters[function.__name__] = function
    environment.filters["as_"] = format
    environment.filters["lines"] = _nonempty_lines
    environment.filters["point"] = _point_words
    environment.globals["IN_FORCE"] = IN_FORCE
    environment.globals["DEGREES"] = DEGREE_NAMES
    environment.globals["FEW"] = _MOST_CHECKS
    environment.globals["BARE"] = _STRENGTHS[0][0]
    environment.globals["SIGNS"] = _SENTENCES["signs"]
    environment.globals["PAGE"] = PAGE
    environment.globals["SURE"] = _SURE
    environment.globals["JOINED"] = _MOST_JOINED
    environment.globals["CONFLICT"] = _CONFLICT
    environment.globals["NOTICEABLE"] = f"{100.0 * _NOTICEABLE:g}"
    environment.globals["plus_minus"] = plus_minus
    return environment


def _nonempty_lines(text: str) -> list[str]:
    """Return the lines of a text without the spaces around them. Empty lines are left out."""
    lines = [line.strip() for line in text.split("\n")]
    return [line for line in lines if line]


def _point_words(point: Sequence[float]) -> str:
    """Return the coordinates of a point as a string, such as "(0, 0, 150)"."""
    return f"({', '.join(f'{coordinate:g}' for coordinate in point)})"


def _sentences(macro: str, *findings: Any) -> tuple[str, ...]:
    """Return the sentences that a macro in the template file sentences.j2 makes from results.

    ``macro`` is the name of the macro. ``findings`` are the results that the macro takes as its
    arguments.
    """
    module = _environment().get_template("sentences.j2").module
    return tuple(_nonempty_lines(getattr(module, macro)(*findings)))


def _sentence(macro: str, *findings: Any) -> str:
    """Return one line with all sentences that a macro of the template file sentences.j2 makes.

    ``macro`` is the name of the macro. ``findings`` are the results that the macro takes as its
    arguments.
    """
    return " ".join(_sentences(macro, *findings))


@singledispatch
def with_words(result: Any) -> dict[str, Any]:
    """Return the JSON record of a result, with sentences that describe the result.

    Parameters
    ----------
    result : Result
        Result of an analysis, such as `check_campaign` or `fit_population` returns.

    Returns
    -------
    dict
        The record that the method ``as_dict`` of the result returns. For some classes of results,
        the record also has sentences.

    Examples
    --------
    >>> record = lb.report.with_words(lb.check_campaign(campaign))
    >>> record["remarks"]
    ['One direction of travel (or none stated): the readings cannot separate friction in the bar
     from C_XYX.']
    """
    registered = registered_function(with_words, result)
    record: dict[str, Any]
    if registered is not None:
        record = registered(result)
    else:
        record = result.as_dict()
    return record


def joined(items: Sequence[str], word: str = "and") -> str:
    """Return items joined to one string, such as "a, b and c".

    ``word`` is the word before the last item.
    """
    if len(items) < 3:
        return f" {word} ".join(items)
    return f"{', '.join(items[:-1])} {word} {items[-1]}"


def _first_names(names: Sequence[str]) -> str:
    """Return a string with at most five names of tests or campaigns, and the number of others."""
    text = ", ".join(names[:_MOST_NAMES])
    if len(names) > _MOST_NAMES:
        text += f" and {len(names) - _MOST_NAMES} more"
    return text


def _joined_parameters(names: Sequence[str]) -> str:
    """Return a string with the names of parameters, such as "C_XXX and C_YYY"."""
    return joined([display_name(name) for name in names])


# ---- names of effects, and of the effects with which a parameter is confounded


def unit_words(name: str) -> tuple[float, str]:
    """Return the size and the label of the unit in which a nuisance coefficient is shown.

    The size is in internal units (mm, N, rad). For example, the size is 1e-3 (mm) for the label
    "µm". A nuisance coefficient describes an effect that is modelled but not of interest.
    """
    inside_unit, unit_size, label = Term.owner(name).unit_of(name)
    if inside_unit.endswith("/N"):
        factor, label = display_unit(inside_unit)
        return 1.0 / factor, label
    return unit_size, label


def source_unit_words(source: str, term: str, unit: str) -> tuple[float, str]:
    """Return the unit in which an uncertainty budget shows the standard uncertainty of a source.

    The unit is returned as two values: the factor that converts the internal unit (mm, N, rad) to
    the unit shown, and the label of the unit shown. ``source`` is the name of a nuisance
    coefficient, which describes an effect that is modelled but not of interest. ``term`` is the
    class name of its model term. For noise, both names are the same. ``unit`` is the internal unit;
    it is used only for noise.
    """
    if source == term:
        if unit == "N":
            return 1.0, "N"
        return 1e3, "µm"
    unit_size, label = unit_words(source)
    return 1.0 / unit_size, label


def nuisance_words(name: str) -> str:
    """Return the name of a nuisance coefficient in words.

    For example, the name ``form_cos2`` in words is "2-lobe form (cos 2θ)". A nuisance coefficient
    describes an effect that is modelled but not of interest.
    """
    return Term.owner(name).describe(name)


def term_words(term: str) -> str:
    """Return the name of an effect in words, such as "ball form" for the model term ``BallForm``.

    ``term`` is the class name of a model term. It may also be the name of a parameter, which is
    then returned as tables show it, such as C_XXX.
    """
    if term in Term.kinds:
        return Term.kinds[term].words
    if term in _SENTENCES["sources"]:
        return str(_SENTENCES["sources"][term])
    if "_" in term:
        return display_name(term)
    return re.sub(r"(?<!^)(?=[A-Z])", " ", term).lower()


def source_words(term: str) -> str:
    """Return the name, in words, of a source of uncertainty in an uncertainty budget.

    ``term`` is the class name of a model term, or "Parameters" for the parameters' own priors.
    """
    if term == OWN:
        return "prior of the parameters"
    return term_words(term)


def _amount_words(value: float, factor: float, label: str, name: str, plus: str = "+") -> str:
    """Return a value of a parameter or effect with unit and name, such as "+6.67 µm/m of E_XX1".

    ``value`` is multiplied by ``factor`` to convert it to the unit ``label``. ``name`` is the name
    of the parameter or effect. ``plus`` is the string before a positive value.
    """
    size = abs(value) * factor
    if size < 0.01 and label.startswith("µ"):
        size *= 1e3
        label = "n" + label[1:]
    sign = plus if value > 0 else "−"
    space = "" if label == "°" else " "
    return f"{sign}{round_uncertainty(size, 3)[0]}{space}{label} of {name}"


def degeneracy_sentence(degeneracy: Degeneracy) -> str:
    """Return a sentence that describes a degeneracy.

    A degeneracy is a combination of parameters and other effects that the readings cannot separate.
    A change of one parameter or effect can be compensated by changes of the others. For a
    degeneracy of parameters, the sentence states amounts of the parameters that together change no
    reading. For a degeneracy of an effect with parameters, the sentence states amounts of the
    parameters that change the readings exactly as a stated amount of the effect does.
    """
    sign = -1.0 if degeneracy.term else 1.0
    changes = []
    for name in degeneracy.parameters:
        factor, label = display_unit(degeneracy.units[name])
        change = sign * degeneracy.combination[name]
        changes.append(_amount_words(change, factor, label, display_name(name)))
    ending = "."
    if not degeneracy.modelled:
        ending = "; the model leaves it out, and the intervals do not cover it."

    number = len(degeneracy.nuisances)
    if not degeneracy.term:
        if number:
            changes.append(f"{number} other effects")
        return f"{joined(changes)} together change no reading{ending}"
    return f"{_effect_words(degeneracy)} looks exactly like {joined(changes)}{ending}"


def _effect_words(degeneracy: Degeneracy) -> str:
    """Return a string that lists the sizes of the nuisance effects in a degeneracy.

    Nuisance effects are modelled but not of interest. A degeneracy is a combination of parameters
    and nuisance effects that the readings cannot separate, because the effects together change the
    readings in the same way as the parameters.
    """
    amounts = []
    for name in degeneracy.nuisances:
        unit_size, unit = unit_words(name)
        amount = degeneracy.combination[name]
        amounts.append(_amount_words(amount, 1.0 / unit_size, unit, nuisance_words(name), ""))
    if len(amounts) > 4:
        return f"{amounts[0]} together with {len(amounts) - 1} other effects"
    if len(amounts) > 1:
        return f"{amounts[0]} with {joined(amounts[1:])}"
    return "".join(amounts)


def cure_words(degeneracy: Degeneracy, cures: Sequence[Cure]) -> str:
    """Return a sentence on what would resolve a degeneracy.

    A degeneracy is a combination of parameters and other effects that the readings cannot separate.
    ``cures`` are ways to resolve it, such as tests at other forces or a calibration. If ``cures``
    is empty, the sentence recommends a narrower prior.
    """
    calibration = "a calibration of it"
    if degeneracy.term in Term.kinds:
        calibration = Term.kinds[degeneracy.term].calibration
    text = joined([_SENTENCES["cures"].get(cure, calibration) for cure in cures], "or")
    if not text:
        text = "a narrower prior on one of them"
    return text[0].upper() + text[1:] + "."


def degeneracy_items(
    degeneracies: Sequence[Degeneracy], cures: Sequence[Sequence[Cure]]
) -> tuple[str, ...]:
    """Return a description of each degeneracy, and of what would resolve it.

    A degeneracy is a combination of parameters and other effects that the readings cannot separate.
    ``cures`` has one entry for each of ``degeneracies``, in the same order: the tests or
    calibrations that would resolve the degeneracy.
    """
    items = []
    for degeneracy, cures_of_it in zip(degeneracies, cures, strict=True):
        items.append(
            f"{degeneracy_sentence(degeneracy)} Cure: {cure_words(degeneracy, cures_of_it)}"
        )
    return tuple(items)


def confounded_sentences(partners_of: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """Yield one sentence on all confounded parameters of a fit, if there are any.

    A parameter is confounded if most of its variance comes from effects whose standard
    uncertainties are assumed. The sentence names these effects for each parameter.

    Parameters
    ----------
    partners_of
        Names of these effects for each confounded parameter. The keys are the names of the
        parameters.

    Yields
    ------
    str
    """
    parameters_by_partners: dict[str, list[str]] = {}
    for name, effects in partners_of.items():
        if not is_slope(name):
            partners = joined([term_words(effect) for effect in effects])
            parameters_by_partners.setdefault(partners, []).append(name)
    if parameters_by_partners:
        pairs = [
            f"{_joined_parameters(names)} with {partners}"
            for partners, names in parameters_by_partners.items()
        ]
        yield (
            f"Confounded: {'; '.join(pairs)}. Nobody measured these effects: most of u is what was"
            " assumed of them (what would help: ldbb-bayes identify)."
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


# ---- sentences on a fit


def fit_verdict(fit: Fit) -> str:
    """Return a sentence on whether the numbers of a fit can be used."""
    return _sentence("fit_verdict", fit)


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


def expectation(fit: Fit) -> str:
    """Return a clause on whether the fitted model predicts readings like the measured readings."""
    return _sentence("expectation", fit)


def check_notes(fit: Fit) -> tuple[str, ...]:
    """Return a note on failed posterior predictive checks that hardly affect any credible interval.

    Failed checks that affect a credible interval are called misfits, and are not named in the note.
    The result is a tuple with the note; it is empty if there is nothing to note.
    """
    return _sentences("check_notes", fit)


def model_words(model: Mapping[str, Any]) -> str:
    """Return a description of the fitted model. ``model`` is the JSON record of the model."""
    return _sentence("model_words", model)


def quality_words(quality: Mapping[str, Any]) -> str:
    """Return a string that states how well the model fits the readings.

    ``quality`` is the entry ``fit`` of the JSON record of the fit.
    """
    return _sentence("quality_words", quality)


def sampler_words(sampler: Mapping[str, Any]) -> str:
    """Return a sentence that states whether the sampler has converged, and the number of draws.

    The sampler has converged if its draws have reached the effective sample size that the user
    required. The sentence also states the effective sample size reached, and R-hat. ``sampler`` is
    the JSON record of the sampler.
    """
    return _sentence("sampler_words", sampler)


def check_words(check: Check) -> str:
    """Return a string that states what a posterior predictive check is about.

    An example is "order 4 of f520". In this example, order 4 is the Fourier component of the
    readings at four times the angle, and f520 is the name of a test.
    """
    kinds = {"noise": "white noise", "autocorrelation": "autocorrelation"}
    kind = kinds.get(check.kind, f"order {check.order}")
    return f"{kind} of {check.test}"


def concern_sentences(concerns: tuple[Concern, ...], sampler: Mapping[str, Any]) -> Iterator[str]:
    """Yield a description of each concern about a fit.

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
    for concern in concerns:
        kind = str(concern.kind)
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
        sentence = _SENTENCES["concerns"][kind].format(
            value=concern.value,
            limit=concern.limit,
            um=concern.value * 1e3,
            limit_um=concern.limit * 1e3,
            degree=concern.limit - 2,
            verb=verb,
            rhat=sampler.get("target_rhat", 0.0),
            advice=advice,
            name=display_name(concern.name),
            limit_shown=limit_shown,
        )
        yield typeset(sentence)


# ---- sentences on a campaign


def preview_sentences(preview: CampaignPreview) -> tuple[str, ...]:
    """Return sentences that describe a campaign, with remarks on the campaign and on its tests."""
    return _sentences("preview_sentences", preview)


def travel_words(test: TestPreview) -> str:
    """Return the direction of travel of a test, or a dash if it is not known.

    A direction in parentheses is not given for the test; it follows from the order of the test's
    angles.
    """
    if test.direction:
        return test.direction
    if test.travel:
        return f"({test.travel})"
    return "–"


def assumption_words(assumption: Any) -> str:
    """Return a description of an assumption that the program made when readings were imported.

    The description states the assumption, its reason, and the command-line option that would change
    it.
    """
    reason = assumption.because
    if assumption.place:
        reason = f"{reason}; {assumption.place}"
    return f"{assumption.what}: {assumption.value} ({reason}): {assumption.option}"


def remark_words(remark: Remark) -> str:
    """Return the text of a remark on a campaign or on one of its tests."""
    if remark.kind in _SENTENCES["remarks"]:
        return str(_SENTENCES["remarks"][remark.kind].format(**remark.values))
    template = _environment().from_string(_SENTENCES["choices"][remark.kind])
    return template.render(remark.values)


def peculiarity_sentences(preview: CampaignPreview) -> list[str]:
    """Return one sentence on each peculiarity of a campaign's readings.

    Each sentence names the tests that have the peculiarity.
    """
    tests_by_words: dict[str, list[str]] = {}
    for test in preview.tests:
        for remark in test.remarks:
            tests_by_words.setdefault(remark_words(remark), []).append(test.name)
    return [f"Look at {_first_names(tests)}: {words}." for words, tests in tests_by_words.items()]


@with_words.register
def _record_of_campaign_preview(result: CampaignPreview) -> dict[str, Any]:
    """Return the JSON record of the preview of a campaign, with its remarks as sentences."""
    record = {"schema": 1, **result.as_dict()}
    _add_remarks(record, result.remarks)
    for test_record, test in zip(record["tests"], result.tests, strict=True):
        _add_remarks(test_record, test.remarks)
    record["assumptions"] = [remark_words(remark) for remark in result.assumptions]
    return record


def _add_remarks(record: dict[str, Any], remarks: Sequence[Remark]) -> None:
    """Add the kinds and the texts of remarks to the JSON record of a campaign or of a test."""
    record["kinds"] = [str(remark.kind) for remark in remarks]
    record["remarks"] = [remark_words(remark) for remark in remarks]


def assumed_words(uncertainty: Uncertainty) -> tuple[str, str]:
    """Return the name of an instrument error, and the place where the user can state its value.

    The place is the entry of campaign.toml in which the user can write the value from a
    certificate, such as "[mount] U_percent". If there is no such entry, the string begins with
    "none" and names the model term that describes the error.
    """
    table, _, key = uncertainty.certificate.partition("_")
    if key:
        place = f"[{table}] {key}"
    elif table:
        place = f"[balls.{table}]"
    else:
        place = f"none: [terms.{Term.owner(uncertainty.name).__name__}] of a model"
    words = nuisance_words(uncertainty.name.replace("form_", "form_cos"))
    return words.partition(" (")[0], place


# ---- sentences on a machine


def machine_sentences(machine: Any) -> tuple[str, ...]:
    """Return sentences on a machine's joints and on what circular tests can determine.

    The sentences also state how many compliances the readings can separate, and which parameters
    have no effect on the readings.
    """
    return _sentences("machine_sentences", machine)


def sum_in_words(parameter: VisibleParameter) -> str:
    """Return the sum of parameters that ``parameter`` stands for, such as "C_XXX + C_XXY".

    Circular tests determine only this weighted sum. A weight is stated only if it differs from 1;
    its unit is mm or mm².
    """
    text = ""
    for name, weight in parameter.members.items():
        sign = ""
        if text:
            sign = " − " if weight < 0 else " + "
        elif weight < 0:
            sign = "−"
        if abs(weight) != 1.0:
            sign += f"{abs(weight):g} "
        text += sign + display_name(name)
    return text


# ---- sentences on identifiability: which parameters the readings can determine


def joined_sizes(hyper_um: Mapping[str, float], equals: str) -> str:
    """Return a string with the values of hyper-parameters, such as "sigma = 0.2 µm, decay = 0.5".

    ``hyper_um`` is a mapping from the names of the hyper-parameters to their values. All values are
    in µm, except the hyper-parameter ``decay``, which is a pure number. Hyper-parameters whose
    names begin with ``lambda_`` are left out. Each of them is a factor for one circle: its random
    shift and unexplained deviations are larger by this factor than those of other circles.
    ``equals`` is the string between a name and its value.
    """
    sizes = []
    for name, value in hyper_um.items():
        if not name.startswith("lambda_"):
            unit = "" if name == "decay" else " µm"
            sizes.append(f"{name}{equals}{value:.2g}{unit}")
    return ", ".join(sizes)


def origin_words(origin: str) -> str:
    """Return a string that states where a source's standard uncertainty comes from.

    A source is a source of variance in an uncertainty budget. ``origin`` is "measured here" (in
    this campaign), "stated" or "assumed".
    """
    return str(_SENTENCES["origins"][origin])


def origins_in_words(entry: ParameterIdentifiability) -> str:
    """Return a string with the shares of a parameter's variance by origin, such as "39 / 0 / 61".

    Each source of variance belongs to one of three groups: its standard uncertainty was measured in
    the campaign, was stated by a certificate or by the user, or was assumed by the model. The
    string states the shares of these groups [%], in this order.
    """
    return " / ".join(f"{100.0 * share:.0f}" for share in entry.origin_shares.values())


def held_by_words(entry: ParameterIdentifiability) -> str:
    """Return a string that names the main source, or sources, of a parameter's variance.

    For example, "mount 39 %, assumed" says that the mount causes 39 % of the variance, and that the
    standard uncertainty of the mount's deflection is assumed. If the parameter is confounded, the
    string names the effects with which the parameter is confounded. Otherwise the string names only
    the source with the largest share of the variance.
    """
    origin = origin_words(entry.held_by.origin)
    if str(entry.verdict) == "confounded":
        origin = origin_words("assumed")
    return f"{', '.join(_sources_with_shares(entry))}, {origin}"


def short_verdict_words(entry: ParameterIdentifiability | ChangeIdentifiability) -> str:
    """Return a short string with a verdict, such as "confounded: mount 39 %, …".

    A verdict states how well the readings determine a parameter. The string names one source of the
    parameter's variance with its share. The ellipsis stands for further effects with which the
    parameter is confounded.
    """
    sources = _sources_with_shares(entry)
    ending = ", …" if len(sources) > 1 else ""
    return f"{entry.verdict}: {sources[0]}{ending}"


def _sources_with_shares(
    entry: ParameterIdentifiability | ChangeIdentifiability,
) -> list[str]:
    """Return strings that name the largest sources of a variance, such as "mount 39 %".

    ``entry`` is the verdict on a parameter, or on the change of a compliance with force. If the
    verdict is "confounded", the effects with which the quantity is confounded are named. Otherwise
    only the largest source is named.
    """
    shares = {entry.held_by.name: entry.held_by.share}
    if str(entry.verdict) == "confounded":
        shares = entry.partner_shares
    return [f"{_source_in_table(name)} {100.0 * share:.0f} %" for name, share in shares.items()]


def _source_in_table(name: str) -> str:
    """Return the name of a source of variance in words, as a table shows it.

    The parameter's own prior is shown as "its prior".
    """
    if name == OWN:
        return "its prior"
    if "_" in name:
        return f"prior of {display_name(name)}"
    return term_words(name)


def remedy_in_words(remedy: Remedy | None) -> str:
    """Return a short name of the cheapest remedy for a parameter, such as "turn balls".

    A remedy is a certificate of the instrument, or a change of the plan of tests, that reduces the
    uncertainty of the parameter markedly. If ``remedy`` is None, a dash is returned.
    """
    if remedy is None:
        return "–"
    return _step_words(remedy.kind, remedy.certificate)


def paired_remedy_items(result: Identifiability) -> tuple[str, ...]:
    """Return descriptions of pairs of remedies for parameters that need two remedies.

    A remedy is a certificate of the instrument or a change of the plan of tests. Each description
    names a pair of remedies and states U (k = 2) of the parameters with both remedies, such as
    "G10 balls and bar ± 1 µm together: U of E_XX1 25 µm/m". With one of the remedies alone, the
    readings could not separate these parameters from other effects. A parameter is marked if the
    readings could not separate it from other effects even with both remedies.
    """
    effects_by_pair: dict[str, list[str]] = {}
    for name, entry in result.parameters.items():
        pair = entry.paired_remedy
        if pair is None or is_slope(name):
            continue
        factor, unit = display_unit(entry.unit)
        effect = f"{display_name(name)} {two_digits(2.0 * pair.sd, factor)} {unit}"
        if pair.is_confounded:
            effect += " (confounded even so)"
        steps = [_step_words(step.kind, step.certificate) for step in (pair.first, pair.second)]
        effects_by_pair.setdefault(joined(steps), []).append(effect)
    items = []
    for pair_words, effects in effects_by_pair.items():
        items.append(f"{pair_words} together: U of {joined(effects)}")
    return tuple(items)


def _step_words(kind: str, certificate: str) -> str:
    """Return a short name of a remedy: a certificate, or a change of the plan of tests.

    ``certificate`` is the name of the certificate, or an empty string if the remedy is a change of
    the plan. ``kind`` is the kind of the remedy.
    """
    if certificate:
        return certificate_words(certificate)
    return str(_SENTENCES["plans"][kind])


def certificate_words(certificate: str) -> str:
    """Return the short name of a certificate of the instrument, such as "force ± 0.5 %"."""
    return str(_SENTENCES["certificates"].get(certificate, certificate))


def verdict_words(
    entry: ParameterIdentifiability | ChangeIdentifiability, *, shares: bool = True
) -> str:
    """Return a string with the verdict on how well the readings determine a parameter or a change.

    If the parameter or change is confounded, the string names the effects with which it is
    confounded.

    Parameters
    ----------
    entry
        Verdict on the parameter, or on the change of a compliance with force.
    shares
        Whether the string also states shares of the variance. If the parameter or change is
        confounded, the share of each named effect is stated. If it is identified, the effect with
        the largest share is named, and this share is stated.

    Returns
    -------
    str
    """
    verdict = str(entry.verdict)
    if verdict == "confounded":
        partners = []
        for partner, share in entry.partner_shares.items():
            part = _source_in_table(partner)
            if shares:
                part += f" ({100.0 * share:.0f} %)"
            partners.append(part)
        return f"confounded with {joined(partners)}"
    if not shares or verdict == "prior-limited":
        return verdict
    return f"{verdict}, limited by {_source_in_table(entry.held_by.name)} ({_held_share(entry)})"


def _held_share(entry: ParameterIdentifiability | ChangeIdentifiability) -> str:
    """Return a string with the share and the origin of the largest source of variance.

    An example is "39 %, assumed".
    """
    return f"{100.0 * entry.held_by.share:.0f} %, {origin_words(entry.held_by.origin)}"


def identifiability_sentences(result: Identifiability) -> tuple[str, ...]:
    """Return sentences that state the assumptions of an identifiability analysis."""
    sizes = joined_sizes(result.hyper_um, " = ")
    return _sentences("identifiability_sentences", result, sizes)


def identifiability_screen(result: Identifiability) -> tuple[str, ...]:
    """Return the most important sentences on the result of an identifiability analysis.

    A verdict states how well the readings determine a parameter or the change of a compliance with
    force. The first sentence states how many parameters and changes have each verdict. Slopes
    (coefficients of the change with force) are not counted.
    """
    parameters = [entry for name, entry in result.parameters.items() if not is_slope(name)]
    verdicts = Counter(str(entry.verdict) for entry in parameters)
    verdicts.update(str(change.verdict) for change in result.changes.values())
    averaged = []
    for name, sd in result.averaged_sd.items():
        entry = result.parameters[name]
        if abs(sd / entry.sd - 1.0) > _NOTICEABLE:
            factor, unit = display_unit(entry.unit)
            averaged.append(f"{display_name(name)} {two_digits(2.0 * sd, factor)} {unit}")
    return _sentences("identifiability_screen", result, verdicts, len(parameters), averaged)


def certificate_rows(result: Identifiability, most: int | None = None) -> list[tuple[str, str]]:
    """Return the rows of a table of calibration certificates of the instrument.

    Each row has two cells: the name of the certificate, and a list of the parameters whose standard
    uncertainty the certificate would reduce by more than a tenth. For example, "C_XXX 60 %" means a
    reduction to 60 % of the present value. The parameter with the largest reduction comes first.
    Slopes (coefficients of the change of compliance with force) are left out. ``most`` is the
    largest number of parameters that a row names; an ellipsis stands for the other parameters.
    """
    sd_by_certificate = dict(result.certificates)
    sd_without = sd_by_certificate.pop("none of these", {})
    rows = []
    for certificate, sd in sd_by_certificate.items():
        ratio = {name: sd[name] / sd_without[name] for name in sd}
        gain = {name: -share for name, share in ratio.items()}
        narrowed = []
        for name in ranked(ratio, gain.__getitem__):
            if ratio[name] < _NARROWER and not is_slope(name):
                narrowed.append(f"{display_name(name)} {100.0 * ratio[name]:.0f} %")
        if most is not None and len(narrowed) > most:
            narrowed = [*narrowed[:most], "…"]
        rows.append((certificate, ", ".join(narrowed) or "none by a tenth"))
    return rows


def cure_items(
    degeneracies: Sequence[Degeneracy], cures: Sequence[Sequence[Cure]]
) -> tuple[str, ...]:
    """Return descriptions of confounded effects, and of the tests that would separate them.

    Effects that the same tests or calibrations would separate are named together.

    Parameters
    ----------
    degeneracies
        Combinations of parameters and effects that no reading of a set of tests can separate.
    cures
        Tests or calibrations that would resolve each degeneracy, in the order of ``degeneracies``.

    Returns
    -------
    tuple of str
    """
    first_of_effect: dict[str, Degeneracy] = {}
    cures_of_effect: dict[str, list[Cure]] = {}
    for degeneracy, cures_of_it in zip(degeneracies, cures, strict=True):
        effect = _joined_parameters(degeneracy.parameters)
        if degeneracy.term:
            effect = term_words(degeneracy.term)
        first_of_effect.setdefault(effect, degeneracy)
        common = cures_of_effect.get(effect, cures_of_it)
        cures_of_effect[effect] = [cure for cure in common if cure in cures_of_it]
    effects_by_cure: dict[str, list[str]] = {}
    for effect, common in cures_of_effect.items():
        cure = cure_words(first_of_effect[effect], common)
        effects_by_cure.setdefault(cure, []).append(effect)
    items = []
    for cure, effects in effects_by_cure.items():
        items.append(f"{joined(effects)}: {cure[0].lower()}{cure[1:]}")
    return tuple(items)


# ---- sentences on the check of credible intervals by simulation


def validation_verdict(validation: Validation) -> str:
    """Return a sentence on the result of simulation-based calibration.

    The sentence states whether the ranks of true values are uniformly distributed. A rank is the
    number of posterior draws below the true value in a simulated campaign.
    """
    return _sentence("validation_verdict", validation)


def workflow_sentences(workflow: Workflow) -> tuple[str, ...]:
    """Return one sentence on each check of a Bayesian workflow, and one on the overall result."""
    return _sentences("workflow_sentences", workflow)


# ---- sentences on a comparison of models


def comparison_sentences(comparison: Comparison) -> tuple[str, ...]:
    """Return sentences on a comparison of models.

    The sentences state the evidence for each model, and how much it changes with other assumptions.
    Sentences on all other results of the comparison follow.
    """
    return _sentences("comparison_sentences", comparison)


def comparison_screen(comparison: Comparison) -> tuple[str, ...]:
    """Return the most important sentences on a comparison of models."""
    return _sentences("comparison_screen", comparison)


def strength_words(log_bayes_factor: float) -> str:
    """Return words for the strength of the evidence that a log Bayes factor [nat] states.

    The words, such as "strong evidence", depend on the absolute value of the log Bayes factor. They
    are taken from Kass and Raftery, J. Am. Stat. Assoc. 90 (1995) 773-795.
    """
    for limit, words in _STRENGTHS:
        if abs(log_bayes_factor) < limit:
            return words
    return "very strong evidence"


# ---- sentences on a design of tests


def design_sentences(design: Design) -> tuple[str, ...]:
    """Return sentences on the tests that a design recommends, followed by notes."""
    ratio = {}
    gain = {}
    for name in without_slopes(design.parameters):
        ratio[name] = design.expected[name].sd / design.baseline[name].sd
        gain[name] = -ratio[name]
    most_improved = ranked(ratio, gain.__getitem__, tolerance=_EQUAL_RATIOS)[0]
    least_improved = ranked(ratio, ratio.__getitem__, tolerance=_EQUAL_RATIOS)[0]
    return _sentences(
        "design_sentences",
        design,
        _tests_to_run(design),
        ratio,
        most_improved,
        least_improved,
        design_notes(design),
    )


def design_screen(design: Design) -> tuple[str, ...]:
    """Return the most important sentences on a design of tests. The first lists the tests."""
    return _sentences("design_screen", design, _tests_to_run(design, most=len(design.table)))


def design_notes(design: Design) -> tuple[str, ...]:
    """Return notes on a design of tests.

    The notes state what the tests cannot show, what would help, and what the design assumes.
    """
    relative_errors = [0.0]
    for expected in design.expected.values():
        if expected.sd > 0.0:
            relative_errors.append(expected.sd_error / expected.sd)
    alike = degeneracy_items(design.limits.degeneracies, design.limits.cures)
    sizes = joined_sizes(design.hyper_um, " ")
    return _sentences("design_notes", design, sizes, max(relative_errors), alike)


def _tests_to_run(design: Design, most: int = _MOST_LISTED_TESTS) -> str:
    """Return a string that lists the tests of a design.

    An example is "6 circles: 2 × 36 N and 4 × 742 N". If there are more than ``most`` different
    tests, the string refers to the table of tests.
    """
    table = design.table
    varied = _varied_settings(design)
    tests = []
    for row in table.to_dict(orient="records"):
        settings = []
        for name, template in _SENTENCES["places"].items():
            if name in varied and row[name] != "":
                settings.append(template.format(row[name]))
        test = f"{row['count']} × {row['force_N']:.4g} N"
        if varied:
            test += f" ({', '.join(settings)})"
        tests.append(test)
    listed = "see the table"
    if len(tests) <= most:
        listed = joined(tests)
    further = " more" if design.augment else ""
    return f"{table['count'].sum()}{further} circles: {listed}"


def _varied_settings(design: Design) -> list[str]:
    """Return the names of the settings, such as the radius, that differ between a design's tests.

    The angles of both balls are included if a ball is turned from its original position in any
    test.
    """
    table = design.table
    clockings = list(design.columns)[:2]
    others = list(design.columns)[2:]
    varied = [name for name in others if table[name].nunique() > 1]
    if bool((table[clockings] != 0.0).any(axis=None)):
        return clockings + varied
    return varied


# ---- sentences on the cheapest campaign for goals


def goal_design_head(result: GoalDesign) -> tuple[str, ...]:
    """Return the first sentences on a design for goals: what to run, or that nothing will do."""
    met = [name for name, stated in result.goals.items() if stated.met_by_pilot]
    return _sentences("goal_design_head", result, met)


def goal_design_sentences(result: GoalDesign) -> tuple[str, ...]:
    """Return further sentences on the cheapest campaign that reaches goals for uncertainties.

    If some goals cannot be reached, the sentences state the reasons.
    """
    shares = {name: stated.goal.share for name, stated in result.goals.items()}
    units = {name: stated.goal.unit for name, stated in result.goals.items()}
    then: dict[str, float | None] = {}
    if result.plans:
        then = {name: goal.averaged_U for name, goal in result.best.goals.items()}
    notes = _goal_notes(result.goals, shares, units, then, measured=result.measured)
    obstacles = []
    for name, obstacle in result.obstacles.items():
        stated = result.goals[name]
        factor, unit = display_unit(stated.goal.unit)
        remaining = [obstacle.U_floor, obstacle.U_with_certificate]
        limit, floor, with_certificate = digits_apart(stated.limit_U, remaining, factor)
        obstacles.append(
            {
                "name": display_name(name),
                "floor": f"{floor} {unit}",
                "limit": f"{limit} {unit}",
                "held_by": _holder_in_words(obstacle.held_by),
                "is_hysteresis": obstacle.held_by == Hysteresis.__name__,
                "share": f"{100.0 * obstacle.share:.0f} %",
                "certificate": obstacle.certificate,
                "with_certificate": f"{with_certificate} {unit}",
                "reached": obstacle.reached,
            }
        )
    near_misses = []
    for name, near_miss in result.near_misses.items():
        stated = result.goals[name]
        factor, unit = display_unit(stated.goal.unit)
        limit, likely_U = digits_apart(stated.limit_U, [near_miss.likely_U], factor)
        near_misses.append(
            {
                "name": display_name(name),
                "circles": near_miss.circles,
                "likely_U": f"{likely_U} {unit}",
                "limit": f"{limit} {unit}",
                "probability": f"{100.0 * near_miss.probability:.0f} %",
                "held_by": _holder_in_words(near_miss.held_by),
                "is_hysteresis": near_miss.held_by == Hysteresis.__name__,
                "share": f"{100.0 * near_miss.share:.0f} %",
                "certificate": near_miss.certificate,
            }
        )
    return _sentences("goal_design_reasons", result, obstacles, near_misses) + notes


def _goal_notes(
    goals: Mapping[str, StatedGoal | GoalSoFar],
    shares: Mapping[str, float | None],
    units: Mapping[str, str],
    averaged_then: Mapping[str, float | None],
    *,
    measured: bool,
) -> tuple[str, ...]:
    """Return sentences on the numbers of goals for uncertainties.

    They state of which value a goal in percent is, the U of a fit of the circles run so far where
    it differs from the U now, and U averaged over constant and linear compliance. ``shares`` are
    the goals as fractions of the parameters, or None, and ``units`` are the internal units of the
    parameters. ``averaged_then`` is the averaged U to expect after the cheapest campaign, if it is
    known. The keys are the names of the parameters. ``measured`` states whether there are readings.
    """
    percentages = []
    of_fit = []
    averaged_texts: dict[str, list[str]] = {"now": [], "then": []}
    for name, goal in goals.items():
        factor, unit = display_unit(units[name])
        share = shares[name]
        if share is not None:
            value, _ = value_and_uncertainty(goal.value * factor, goal.U * factor)
            percentages.append(
                {
                    "name": display_name(name),
                    "percent": f"{100.0 * share:g}",
                    "value": f"{value} {unit}",
                }
            )
        if goal.U_of_fit is not None:
            of_fit_text = two_digits(goal.U_of_fit, factor)
            if of_fit_text != two_digits(goal.U, factor):
                of_fit.append(f"{display_name(name)} {of_fit_text} {unit}")
        averaged = {"now": goal.averaged_U, "then": averaged_then.get(name)}
        for time, averaged_U in averaged.items():
            if averaged_U is not None:
                text = f"{display_name(name)} {two_digits(averaged_U, factor)} {unit}"
                averaged_texts[time].append(text)
    return _sentences("goal_notes", percentages, of_fit, measured, *averaged_texts.values())


def _holder_in_words(name: str) -> str:
    """Return the name, in words, of the source of variance that keeps a goal out of reach.

    The goal is an upper limit of a parameter's uncertainty. The name has a capital first letter,
    because it begins a sentence.
    """
    words = _source_in_table(name)
    return words[:1].upper() + words[1:]


# ---- sentences on the next circle


def next_circle_head(step: NextCircle) -> tuple[str, ...]:
    """Return the first sentences on the next circle.

    If every aim is reached, they say that the campaign may stop. Otherwise, they state the settings
    of the best next circle, and how many more circles are expected to be enough. They name the
    aims, and the goals that no number of circles reaches.
    """
    best_circle = step.table.to_dict(orient="records")[0]
    # A direction that is the same for all possible circles has no column in the table.
    best_circle.setdefault("direction", step.direction)
    aims = [f"U of {display_name(name)}" for name in step.goals]
    aims += [f"conformity of {display_name(name)}" for name in step.tolerances]
    if step.model_is_aim:
        aims.append("whether compliance is constant or linear in force")
    out_of_reach = []
    for name, goal in step.goals.items():
        if goal.probability < step.confidence and goal.U_floor > goal.limit:
            factor, unit = display_unit(goal.unit)
            limit, floor = digits_apart(goal.limit, [goal.U_floor], factor)
            out_of_reach.append(
                {
                    "name": display_name(name),
                    "floor": f"{floor} {unit}",
                    "limit": f"{limit} {unit}",
                }
            )
    return _sentences("next_circle_head", step, best_circle, aims, out_of_reach)


def next_circle_goals(step: NextCircle) -> tuple[str, ...]:
    """Return sentences on the numbers of the goals for uncertainties, which a table lists.

    They state of which value a goal in percent is, and the U of a fit of the circles run so far
    where it is not the U now. The tuple is empty if nothing is to be said.
    """
    shares = {name: goal.share for name, goal in step.goals.items()}
    units = {name: goal.unit for name, goal in step.goals.items()}
    return _goal_notes(step.goals, shares, units, {}, measured=True)


def next_circle_tolerances(step: NextCircle) -> tuple[str, ...]:
    """Return a tuple with a sentence on the model with which tolerances are decided.

    The tuple is empty if there are no tolerances, or if compliance is constant in the model.
    """
    if not step.tolerances or step.model is None:
        return ()
    return _sentences("next_circle_tolerances")


def next_circle_model(step: NextCircle) -> tuple[str, ...]:
    """Return a tuple with a sentence on the choice between constant and linear compliance.

    The tuple is empty if compliance cannot change with force in the model of the campaign.
    """
    if step.model is None:
        return ()
    return _sentences("next_circle_model", step)


# ---- sentences on an uncertainty budget


def remedy_words(budget: Budget) -> str:
    """Return a string that states what would reduce a parameter's uncertainty most.

    ``budget`` is the uncertainty budget of the parameter.
    """
    if budget.heaviest in _SENTENCES["remedies"]:
        return str(_SENTENCES["remedies"][budget.heaviest])
    return Term.kinds.get(budget.heaviest, Term).remedy


# ---- sentences on a population of machines, and on the trend of one machine


def caveat_words(caveat: Any) -> str:
    """Return one or two sentences on a limitation of the results of a trend or a population.

    A trend is the change of one machine's parameters over its campaigns; a population is a group of
    machines.
    """
    template = _SENTENCES["caveats"][caveat.kind]
    return str(
        template.format(
            *caveat.values,
            names=_first_names(caveat.names),
            parameters=", ".join(map(display_name, caveat.names)),
            text=caveat.text,
        )
    )


def probability_words(probability: float) -> str:
    """Return a probability as a string with three decimals.

    The string is "< 0.001" for a probability near 0, and "> 0.999" for a probability near 1.
    """
    if probability < _UNLIKELY:
        return "< 0.001"
    if probability > 1.0 - _UNLIKELY:
        return "> 0.999"
    return f"{probability:.3f}"


def changes_by_words(name: str, change: Mapping[str, Any]) -> str:
    """Return the heading of a row that states the change of a compliance with force.

    An example is "C_XXX changes from 36 N to 742 N by". ``name`` is the name of the compliance, and
    ``change`` the JSON record of its change.
    """
    smallest = change["smallest_force_N"]
    largest = change["largest_force_N"]
    return f"{display_name(name)} changes from {smallest:.4g} N to {largest:.4g} N by"


def direction_words(change: Mapping[str, Any]) -> str:
    """Return a string that states whether a compliance increases or decreases with force.

    ``change`` is the JSON record of the compliance's change over the tested forces. If neither an
    increase nor a decrease has a probability of at least 95 %, the string states the probabilities
    of both. For an average over models, the string then also states the probability that there is
    no change at all.
    """
    increase = change["probability_of_increase"]
    decrease = change["probability_of_decrease"]
    if increase >= _SURE:
        return f"increases with probability {probability_words(increase)}"
    if decrease >= _SURE:
        return f"decreases with probability {probability_words(decrease)}"
    probabilities = [
        f"increase {probability_words(increase)}",
        f"decrease {probability_words(decrease)}",
    ]
    none = 1.0 - increase - decrease
    if none > _ROUNDING:
        probabilities.append(f"exactly none {probability_words(none)}")
    return f"no change shown ({', '.join(probabilities)})"


def limit_words(lower: float | None, upper: float | None, factor: float = 1.0) -> str:
    """Return a string with tolerance limits, such as "≤ 60", "≥ 18", "± 20" or "−20 to 40".

    Parameters
    ----------
    lower, upper
        Lower limit and upper limit. None if the tolerance has no such limit.
    factor
        Factor that converts the unit of the limits to the unit shown.

    Returns
    -------
    str
        String with the limits, or an empty string if there are no limits.
    """
    if lower is None and upper is None:
        return ""
    low = "" if lower is None else _limit_digits(lower * factor)
    high = "" if upper is None else _limit_digits(upper * factor)
    if low == f"−{high}":
        return f"± {high}"
    if low and high:
        return f"{low} to {high}"
    if low:
        return f"≥ {low}"
    return f"≤ {high}"


def _limit_digits(limit: float) -> str:
    """Return the limit of a tolerance as a string.

    The limit is rounded to four significant digits or, if it is at least 1000, to a whole number.
    """
    digits = f"{limit:.0f}" if abs(limit) >= 1000.0 else f"{limit:.4g}"
    return digits.replace("-", "−")


def trend_sentences(trend: Any) -> tuple[str, ...]:
    """Return sentences on the trend of a machine, the most important sentence first.

    A trend is the change of one machine's parameters over its campaigns. ``trend`` is the result of
    `fit_trend`. Sentences on limitations of the trend are not included.
    """
    estimates = trend.estimates
    probability_of_time = 0.0
    if trend.changed:
        change = trend.parameters[trend.most_probable]
        rows = estimates[estimates["parameter"] == trend.most_probable]
        probability_of_time = rows["change_here"].iloc[change.place]
    outside = []
    outside_rows = estimates[estimates["outside"]]
    for name, parameters in outside_rows.groupby("campaign", sort=False)["parameter"]:
        outside.append(f"{name} ({', '.join(map(display_name, parameters))})")
    return _sentences("trend_sentences", trend, probability_of_time, outside)


def population_sentences(population: Any) -> tuple[str, ...]:
    """Return sentences on a population of machines, and on machines that do not belong to it.

    ``population`` is the result of `fit_population`. For each machine that does not belong to the
    population, a sentence names the parameter in which the machine deviates most, relative to the
    scatter of the population. Sentences on the limitations of the population are not included.
    """
    most_deviating = {}
    for name in population.not_belonging:
        z_scores = population.machine[name].z
        sizes = {parameter: abs(z) for parameter, z in z_scores.items()}
        most_deviating[name] = ranked(z_scores, sizes.__getitem__)[0]
    return _sentences("population_sentences", population, most_deviating)


def population_doubts(doubts: Any) -> tuple[str, ...]:
    """Return sentences on the limitations of the results for a population of machines.

    ``doubts`` is the result of `fit_population`; its attribute ``caveats`` lists limitations. They
    matter most if the population serves as a prior for another machine.
    """
    return _sentences("population_doubts", doubts)


# ---- sentences of the HTML page


def annex_words(degree: int, averaged: bool) -> str:
    """Return a sentence that names the model whose numbers the annex shows.

    The annex consists of the sections of the report that follow the two sheets of the certificate.
    ``degree`` is the degree of compliance as a function of force in this model; ``averaged`` states
    whether the numbers of the sheets are averages over models.
    """
    return _sentence("annex_words", degree, averaged)


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


def instrument_words(force_N: float, same_instrument: bool) -> str:
    """Return sentences on what a comparison of two campaigns assumes.

    The sentences state the force ``force_N`` [N] at which compliances are compared, and whether
    both campaigns used the same instrument.
    """
    return _sentence("instrument_words", force_N, same_instrument)


def difference_doubts(
    first: str, other: str, converged: bool, conflict: tuple[str, float] | None
) -> tuple[str, ...]:
    """Return sentences on reasons not to use the differences between two campaigns.

    ``first`` and ``other`` are the names of the campaigns. The tuple is empty if there is no such
    reason. There are two possible reasons:

    - The fit of the second campaign has not converged; ``converged`` is then false.
    - The campaigns used the same instrument, but their fits disagree about an error of the
      instrument, which is a coefficient of the model. ``conflict`` holds the name of the
      coefficient with the largest disagreement, and the p-value of this disagreement, multiplied by
      the number of compared coefficients (Bonferroni). A sentence names the coefficient only if
      this p-value is below 1 %. ``conflict`` is None if no coefficient can be compared.
    """
    return _sentences("difference_doubts", first, other, converged, conflict)


def interval_of(entry: Mapping[str, Any]) -> tuple[float, float]:
    """Return the two ends of the credible interval in the JSON record of a parameter."""
    low, high = entry[_interval_key(entry)]
    return low, high


def percent_of(result: Mapping[str, Any]) -> str:
    """Return the probability of a fit's credible intervals as text, such as "95 %".

    ``result`` is the JSON record of the fit.
    """
    entry = next(iter(result["parameters"].values()))
    return f"{_interval_key(entry).removeprefix('ci')} %"


def _interval_key(entry: Mapping[str, Any]) -> str:
    """Return the key of the credible interval in a parameter's JSON record, such as ``ci95``."""
    return next(key for key in entry if key.startswith("ci"))


def alert_sentences(fit: Fit, result: Mapping[str, Any]) -> tuple[str, ...]:
    """Return sentences that warn against the use of a fit's numbers or advise caution.

    ``result`` is the JSON record of the fit.
    """
    grave = tuple(concern for concern in fit.concerns if concern.kind not in _MINOR_CONCERNS)
    sentences = list(concern_sentences(grave, result["sampler"]))
    is_explained = "not-converged" in fit.kinds or "truncation" in fit.kinds
    if fit.misfits and not is_explained:
        sentences.append(f"Misfit: {expectation(fit)}. Intervals assume that the model holds.")
    if result["model"]["preset"] == "paper":
        sentences.append(PAGE["paper"])
    return tuple(sentences)


def change_sentence(first: str, other: str, table: pd.DataFrame, prob: float) -> str:
    """Return a sentence that names the parameters in which two campaigns differ.

    ``first`` and ``other`` are the names of the campaigns; ``table`` holds the differences of all
    parameters. A parameter is named if the credible interval of its difference excludes zero;
    ``prob`` is the probability of this interval. Slopes (coefficients of the change of compliance
    with force) are not named.
    """
    tail = 0.5 - 0.5 * prob
    sizes = []
    for name, row in table.iterrows():
        probability = row["probability_of_increase"]
        interval_excludes_zero = probability > 1.0 - tail or probability < tail
        if is_slope(str(name)) or not interval_excludes_zero:
            continue
        interval = (row["ci_low"], row["ci_high"])
        size = plus_minus(row["difference"], row["sd"], interval, row["unit"])
        sizes.append(f"{display_name(str(name))} {size}")
    return _sentence("change_sentence", first, other, sizes, f"{100 * prob:g}")
