"""Sentences that state whether results can be used, and which quantities are undetermined."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from ldbb_bayes.analysis.usability import Judgement, Use, judge_fit
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.preview import CampaignPreview, check_campaign
from ldbb_bayes.campaign.remarks import RemarkKind
from ldbb_bayes.inference.fit import Fit
from ldbb_bayes.inference.posterior import campaign_of, fit_of
from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.report import wording
from ldbb_bayes.report.blocks import Banner
from ldbb_bayes.report.findings import Findings
from ldbb_bayes.report.sheet_instrument import instrument_pieces
from ldbb_bayes.report.sheet_numbers import SheetNumbers
from ldbb_bayes.report.sheet_remarks import remark
from ldbb_bayes.report.stated_quantity import StatedQuantity
from ldbb_bayes.report.translation import Words

__all__ = ["banner", "banner_of_fit", "undetermined_texts"]

# largest number of reasons for caution that the banner of the test certificate states
_MOST_REASONS = 2
# The banner of a report states whether the results can be used, and why. If a reason concerns at
# most this many quantities, their symbols are written behind their names; otherwise alone.
_MOST_IN_WORDS = 2
# largest number of undetermined quantities that the test certificate lists
_MOST_UNDETERMINED = 12
# The test certificate states the probability that compliance changes with force only if this
# probability lies between these two limits, so that the change is neither excluded nor certain.
_CHANGE_IS_EXCLUDED = 0.05
_CHANGE_IS_CERTAIN = 0.95
# Limit for the probability that compliance changes with force. The test certificate names the
# compliances whose changes have uncertain signs only if the probability is above this limit.
_CHANGE_IS_LIKELY = 0.5


class _Caution(NamedTuple):
    """A reason for caution in the words of the banner, and what to do about it."""

    text: str
    #: a sentence; empty if nothing can be done, or if ``text`` says it
    cure: str = ""


def banner(numbers: SheetNumbers) -> Banner:
    """Return the banner, which states whether the results of a fit can be used, and why."""
    words = numbers.words
    findings = numbers.findings
    is_unusable = numbers.are_unusable
    cautions = _cautions(
        numbers.judgement,
        fit_of(findings.posterior),
        campaign_of(findings.posterior),
        numbers.parameters,
        words,
    )
    if findings.has_flat_priors:
        cautions.append(_Caution(words("state.least_squares")))
    forces_N = campaign_of(findings.posterior_of_certificate).forces_N
    if not forces_N.min() <= numbers.force_N <= forces_N.max():
        outside = words("state.outside", force=words.number(f"{numbers.force_N:.4g}"))
        # If the certificate's force is outside the tested range, this is the first reason for
        # caution that the banner states. Only a reason why the numbers cannot be used at all comes
        # before it.
        cautions.insert(1 if is_unusable else 0, _Caution(outside))
    place = 1 if is_unusable else 0
    cautions[place:place] = _cautions_of_preview(findings.preview, words)

    kind = "usable"
    if is_unusable:
        kind = "unusable"
    elif cautions:
        kind = "reserved"
    stated = cautions[:_MOST_REASONS]
    because = _joined_texts(stated) or words("state.fits")
    if not is_unusable:
        because += _missing_certificates(findings, words)
    # A cure of a reason that the sentence does not state would speak of circles without a name.
    cures = [caution.cure for caution in stated if caution.cure]
    return Banner(kind, _state_sentence(kind, because, words), cures[0] if cures else "")


def _joined_texts(cautions: Sequence[_Caution]) -> str:
    """Return the texts of reasons for caution as one text."""
    return "; ".join(caution.text for caution in cautions)


def banner_of_fit(name: str, fit: Fit, campaign: Campaign, words: Words) -> Banner | None:
    """Return what the banner of a test certificate says of a fit, without its single quantities.

    The first words are the name of the campaign. Return None if there is nothing to be careful
    about.

    Parameters
    ----------
    name
        Name of the campaign.
    fit
        How well a model fits the readings of the campaign.
    campaign
        Campaign with its readings.
    words
        Texts of the test certificate, in its language.
    """
    judgement = judge_fit(fit)
    is_unusable = judgement.use == Use.DO_NOT_USE
    cautions = _cautions(judgement, fit, campaign, {}, words)
    place = 1 if is_unusable else 0
    cautions[place:place] = _cautions_of_preview(check_campaign(campaign), words)
    if not cautions:
        return None
    kind = "unusable" if is_unusable else "reserved"
    sentence = _state_sentence(kind, _joined_texts(cautions[:_MOST_REASONS]), words)
    return Banner(kind, f"{name}: {sentence}")


def _state_sentence(kind: str, because: str, words: Words) -> str:
    """Return the sentence of a banner: whether results can be used, and why.

    ``kind`` is usable, reserved or unusable. ``because`` is the text of the reasons.
    """
    return words(
        "state.sentence",
        state=words(f"state.{kind}"),
        reason=because[:1].upper() + because[1:],
    )


def _cautions(
    judgement: Judgement,
    fit: Fit,
    campaign: Campaign,
    quantities: Mapping[str, StatedQuantity],
    words: Words,
) -> list[_Caution]:
    """Return the reasons for caution in words, one for each kind of reason.

    ``judgement`` states the reasons, which come from the fit of a campaign. ``quantities`` are the
    parameters that the certificate states.
    """
    names_by_kind: dict[str, list[str]] = {}
    for reason in judgement.reasons:
        names = names_by_kind.setdefault(str(reason.kind).replace("-", "_"), [])
        names += reason.names
    cautions: list[_Caution] = []
    for kind, names in names_by_kind.items():
        if kind == "unit":
            cautions += [_Caution(text) for text in _unit_texts(fit, campaign, words)]
            continue
        labels = _labels(names, quantities)
        text = words(
            f"state.{kind}",
            names=words.joined(labels),
            count=str(len(names)),
            all=str(len(quantities)),
        )
        has_cure = kind in words.table["cures"]
        cautions.append(_Caution(text, words(f"cures.{kind}") if has_cure else ""))
    return cautions


def _unit_texts(fit: Fit, campaign: Campaign, words: Words) -> Iterator[str]:
    """Yield texts on the circles whose readings probably are in another unit than stated.

    There is one text for readings that span less than a ball bar shows, and one for those that span
    more.
    """
    for spans in wording.doubted_spans(fit.concerns):
        names = words.joined(spans.tests)
        if len(spans.tests) == len(campaign.tests):
            names = words("state.all_circles")
        kind = "unit_large" if spans.is_large else "unit_small"
        yield words(
            f"state.{kind}",
            names=names,
            span=words.number(spans.span),
            limit=words.number(spans.limit),
        )


def _cautions_of_preview(preview: CampaignPreview, words: Words) -> list[_Caution]:
    """Return reasons for caution that the readings show without a fit.

    A file that was read twice makes U too small, without any sign of it in the fit. The fit takes
    a circle whose readings have the other sign for one that scatters.
    """
    cautions = []
    copies = _copied_tests(preview)
    if copies:
        cautions.append(_Caution(words("state.copies", names=words.joined(copies))))
    mirrored = _mirrored_tests(preview)
    if mirrored:
        cautions.append(_Caution(words("state.mirrored", names=words.joined(mirrored))))
    return cautions


def _copied_tests(preview: CampaignPreview) -> list[str]:
    """Return the names of the tests of a campaign that have the readings of another test."""
    names: dict[str, None] = {}
    for odd in preview.remarks:
        if odd.kind is RemarkKind.COPY:
            names |= dict.fromkeys((odd.values["first"], odd.values["second"]))
    return list(names)


def _mirrored_tests(preview: CampaignPreview) -> list[str]:
    """Return the names of the tests whose readings seem to have another sign than the others."""
    names = []
    for odd in preview.remarks:
        if odd.kind is RemarkKind.MIRRORED:
            names.append(str(odd.values["test"]))
    return names


def _labels(names: Sequence[str], quantities: Mapping[str, StatedQuantity]) -> list[str]:
    """Return labels for quantities that a sentence in the report's banner mentions.

    ``names`` are the names of the quantities. If there are at most two, the labels are words, each
    with its symbol; if there are more, the labels are symbols. Names that are not in
    ``quantities``, such as names of tests and of hyper-parameters, are returned unchanged.
    """
    labels = []
    for name in names:
        if name not in quantities:
            labels.append(name)
        elif len(names) > _MOST_IN_WORDS:
            labels.append(quantities[name].symbol)
        else:
            labels.append(f"{quantities[name].words} ({quantities[name].symbol})")
    return labels


def _missing_certificates(findings: Findings, words: Words) -> str:
    """Return a note that some or all parts of the instrument have no certificate.

    The note is empty if all parts have a certificate. It is also empty for a fit by least squares,
    because that fit assumes nothing about the instrument.
    """
    if findings.has_flat_priors:
        return ""
    is_stated = [piece.is_stated for piece in instrument_pieces(findings, words)]
    if all(is_stated):
        return ""
    if any(is_stated):
        return words("state.partly_stated")
    return words("state.none_stated")


def undetermined_texts(numbers: SheetNumbers) -> list[str]:
    """Return texts that state what the readings do not determine, each with a reason.

    The texts name the undetermined parameters, the confounded geometric errors, the changes with
    force whose signs are uncertain, and the confounded circular deviations. If it is uncertain
    whether compliance changes with force, one text states the probability of a change. If the
    readings determine all quantities, a single text says so. If the results cannot be used, the
    only text says that they determine nothing. Of a fit by least squares, the only text says that
    this was not examined.
    """
    words = numbers.words
    if numbers.are_unusable:
        return [words("sheet.nothing_determined")]
    items = []
    for quantity in numbers.parameters.values():
        if quantity.is_undetermined:
            items.append(f"{quantity.words} ({quantity.symbol}): {remark(quantity, words)}")
    confounded_errors = _confounded_errors(numbers)
    if confounded_errors:
        items.append(words("notes.confounded_errors", symbols=words.joined(confounded_errors)))
    probability_of_change = numbers.findings.probability_of_change
    unknown_signs = _changes_of_unknown_sign(numbers)
    if unknown_signs and probability_of_change > _CHANGE_IS_LIKELY:
        items.append(words("notes.unknown_signs", symbols=words.joined(unknown_signs)))
    items += _confounded_deviations(numbers)
    if _CHANGE_IS_EXCLUDED < probability_of_change < _CHANGE_IS_CERTAIN:
        probability = words.percent(probability_of_change)
        items.append(words("notes.varying", probability=probability))
    if not items and numbers.findings.has_flat_priors:
        return [words("sheet.not_examined")]
    if not items:
        return [words("sheet.all_determined")]
    excess = len(items) - _MOST_UNDETERMINED
    if excess > 0:
        continued = words("sheet.continued", count=str(excess))
        return [*items[:_MOST_UNDETERMINED], continued]
    return items


def _confounded_deviations(numbers: SheetNumbers) -> list[str]:
    """Return a text on the confounded circular deviations, in a list; empty if there are none."""
    words = numbers.words
    confounded = {}
    for key, quantity in (numbers.path | numbers.unloaded_path).items():
        if quantity.confounding_effects:
            confounded[_with_plane(quantity.symbol, key)] = quantity
    if not confounded:
        return []
    symbols = words.joined(list(confounded))
    without_note = replace(next(iter(confounded.values())), note="")
    return [f"{symbols}: {remark(without_note, words)}"]


def _with_plane(symbol: str, key: str) -> str:
    """Return the symbol of a circular deviation, with its plane if ``key`` names one.

    ``key`` is the key of the deviation in `SheetNumbers.path`, such as ``G_no_load_YZ``.
    """
    plane = key.rpartition("_")[2]
    if plane in PLANES:
        return f"{symbol} ({plane})"
    return symbol


def _confounded_errors(numbers: SheetNumbers) -> list[str]:
    """Return the symbols of the geometric errors that are confounded but not undetermined.

    The readings narrow these errors, but most of the variance that is left is that of effects whose
    size is assumed.
    """
    symbols = []
    for name, quantity in numbers.parameters.items():
        is_confounded = quantity.entry is not None and bool(quantity.entry.partners)
        if name.startswith("E_") and is_confounded and not quantity.is_undetermined:
            symbols.append(quantity.symbol)
    return symbols


def _changes_of_unknown_sign(numbers: SheetNumbers) -> list[str]:
    """Return the names of the compliances whose changes with force have uncertain signs."""
    names = []
    for name, quantity in numbers.changes.items():
        if quantity.direction == "no_change":
            names.append(name)
    return names
