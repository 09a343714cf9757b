"""Sentences on identifiability: which parameters the readings can determine."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from ldbb_bayes.model.terms import Term
from ldbb_bayes.report.wording.effect_names import joined, joined_sizes, source_in_table
from ldbb_bayes.report.wording.fixed_texts import SENTENCES
from ldbb_bayes.report.wording.sentence_file import SentenceFile
from ldbb_bayes.units import display_name, display_unit, is_slope, ranked, two_digits

if TYPE_CHECKING:
    from ldbb_bayes.analysis.budgets import Budget
    from ldbb_bayes.analysis.identification import Identifiability
    from ldbb_bayes.analysis.remedies import Remedy
    from ldbb_bayes.analysis.verdicts import ChangeIdentifiability, ParameterIdentifiability

__all__ = [
    "ALIKE",
    "ALL_DETAILS",
    "IN_PAIRS",
    "MORE",
    "NONE_ALIKE",
    "TO_NARROW",
    "TO_SEPARATE",
    "certificate_rows",
    "certificate_words",
    "held_by_words",
    "identifiability_screen",
    "identifiability_sentences",
    "is_noticeable",
    "origin_words",
    "origins_in_words",
    "paired_remedy_items",
    "remedy_in_words",
    "remedy_words",
    "short_verdict_words",
    "verdict_words",
]

ALIKE = "The readings of this campaign cannot separate:"
IN_PAIRS = "One cure leaves these confounded; two, U then:"
TO_SEPARATE = "To separate what looks exactly alike:"
TO_NARROW = "What would narrow them:"
ALL_DETAILS = "Priors, origins and what no reading separates: --details."
MORE = "All of it: print(result.details()). For programs: lb.report.with_words(result)."
NONE_ALIKE = "The readings determine every combination of what the model contains."
# Uncertainties that are averaged over constant and linear compliance are named if they differ by
# more than this fraction from those of linear compliance.
_NOTICEABLE = 0.1
# A row of the table of certificates names the parameters that the certificate would make less
# uncertain. A parameter is named only if its standard uncertainty would fall below this fraction of
# the present value.
_NARROWER = 0.9

_TEMPLATES = SentenceFile("identifiability", NOTICEABLE=f"{100.0 * _NOTICEABLE:g}")


def identifiability_sentences(result: Identifiability) -> tuple[str, ...]:
    """Return sentences that state the assumptions of an identifiability analysis."""
    sizes = joined_sizes(result.hyper_um, " = ")
    return _TEMPLATES.sentences("identifiability_sentences", result, sizes)


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
        if is_noticeable(sd, entry.sd):
            factor, unit = display_unit(entry.unit)
            averaged.append(f"{display_name(name)} {two_digits(2.0 * sd, factor)} {unit}")
    return _TEMPLATES.sentences(
        "identifiability_screen", result, verdicts, len(parameters), averaged
    )


def is_noticeable(averaged_sd: float, sd: float) -> bool:
    """Return whether averaging over constant and linear compliance changes u noticeably.

    ``sd`` is the standard uncertainty u of linear compliance, and ``averaged_sd`` the average. The
    change is noticeable if it is larger than 10 %.
    """
    return abs(averaged_sd / sd - 1.0) > _NOTICEABLE


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
            part = source_in_table(partner)
            if shares:
                part += f" ({100.0 * share:.0f} %)"
            partners.append(part)
        return f"confounded with {joined(partners)}"
    if not shares or verdict == "prior-limited":
        return verdict
    return f"{verdict}, limited by {source_in_table(entry.held_by.name)} ({_held_share(entry)})"


def short_verdict_words(entry: ParameterIdentifiability | ChangeIdentifiability) -> str:
    """Return a short string with a verdict, such as "confounded: mount 39 %, …".

    A verdict states how well the readings determine a parameter. The string names one source of the
    parameter's variance with its share. The ellipsis stands for further effects with which the
    parameter is confounded.
    """
    sources = _sources_with_shares(entry)
    ending = ", …" if len(sources) > 1 else ""
    return f"{entry.verdict}: {sources[0]}{ending}"


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


def _sources_with_shares(entry: ParameterIdentifiability | ChangeIdentifiability) -> list[str]:
    """Return strings that name the largest sources of a variance, such as "mount 39 %".

    ``entry`` is the verdict on a parameter, or on the change of a compliance with force. If the
    verdict is "confounded", the effects with which the quantity is confounded are named. Otherwise
    only the largest source is named.
    """
    shares = {entry.held_by.name: entry.held_by.share}
    if str(entry.verdict) == "confounded":
        shares = entry.partner_shares
    return [f"{source_in_table(name)} {100.0 * share:.0f} %" for name, share in shares.items()]


def _held_share(entry: ParameterIdentifiability | ChangeIdentifiability) -> str:
    """Return a string with the share and the origin of the largest source of variance.

    An example is "39 %, assumed".
    """
    return f"{100.0 * entry.held_by.share:.0f} %, {origin_words(entry.held_by.origin)}"


def origin_words(origin: str) -> str:
    """Return a string that states where a source's standard uncertainty comes from.

    A source is a source of variance in an uncertainty budget. ``origin`` is "measured here" (in
    this campaign), "stated" or "assumed".
    """
    return str(SENTENCES["origins"][origin])


def origins_in_words(entry: ParameterIdentifiability) -> str:
    """Return a string with the shares of a parameter's variance by origin, such as "39 / 0 / 61".

    Each source of variance belongs to one of three groups: its standard uncertainty was measured in
    the campaign, was stated by a certificate or by the user, or was assumed by the model. The
    string states the shares of these groups [%], in this order.
    """
    return " / ".join(f"{100.0 * share:.0f}" for share in entry.origin_shares.values())


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
    return str(SENTENCES["plans"][kind])


def certificate_words(certificate: str) -> str:
    """Return the short name of a certificate of the instrument, such as "force ± 0.5 %"."""
    return str(SENTENCES["certificates"].get(certificate, certificate))


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


def remedy_words(budget: Budget) -> str:
    """Return a string that states what would reduce a parameter's uncertainty most.

    ``budget`` is the uncertainty budget of the parameter.
    """
    if budget.heaviest in SENTENCES["remedies"]:
        return str(SENTENCES["remedies"][budget.heaviest])
    return Term.kinds.get(budget.heaviest, Term).remedy
