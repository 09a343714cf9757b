"""Tables and sentences on the identifiability of parameters, and on measures to improve it."""

from __future__ import annotations

from typing import Any

import numpy as np

from ldbb_bayes.analysis.identification import Identifiability
from ldbb_bayes.analysis.verdicts import ChangeIdentifiability, ParameterIdentifiability
from ldbb_bayes.report import wording
from ldbb_bayes.results import Passage, Table, parts_of
from ldbb_bayes.units import (
    display_name,
    display_unit,
    is_compliance_or_slope,
    is_slope,
    three_digits,
    two_digits,
)

__all__ = ["certificates_table", "judged_quantities", "parts_of", "verdicts_table"]

# Largest number of parameters that are listed in one row of the short table of certificates.
_MOST_NARROWED = 4


def judged_quantities(
    result: Identifiability,
) -> dict[str, ParameterIdentifiability | ChangeIdentifiability]:
    """Return a dict of the verdicts on parameters and on changes of compliances with force.

    A verdict states how well the readings determine a parameter or a change. The keys are the names
    that tables show: for example, C_XXX for a compliance, and ΔC_XXX for its change over the tested
    forces. Slopes, which are the coefficients of this change, are left out.
    """
    compliances: dict[str, ParameterIdentifiability | ChangeIdentifiability] = {}
    others: dict[str, ParameterIdentifiability | ChangeIdentifiability] = {}
    for name, entry in result.parameters.items():
        if is_slope(name):
            continue
        if is_compliance_or_slope(name):
            compliances[display_name(name)] = entry
        else:
            others[display_name(name)] = entry
    for name, change in result.changes.items():
        compliances[f"Δ{display_name(name)}"] = change
    return compliances | others


def verdicts_table(result: Identifiability) -> Table:
    """Return a table of the verdicts on how well the readings determine each parameter.

    The table has one row for each parameter. The columns are the expanded uncertainty U (k = 2), at
    present or, for a plan, as expected; the verdict; the cheapest remedy; and U with this remedy. A
    remedy is a certificate, or a change of the tests, that reduces U markedly. The verdict names
    the effect that causes the largest part of the parameter's variance. Slopes (coefficients of a
    compliance as a polynomial in force) have no rows. Instead, there is one row for each compliance
    that changes with force: its change from the smallest to the largest tested force.
    """
    rows = []
    for label, entry in judged_quantities(result).items():
        factor, unit = display_unit(entry.unit)
        expanded_then = ""
        if entry.remedy is not None:
            expanded_then = two_digits(2.0 * entry.remedy.sd, factor)
        rows.append(
            (
                label,
                f"{two_digits(2.0 * entry.sd, factor)} {unit.replace(' per ', '/')}",
                wording.short_verdict_words(entry),
                wording.remedy_in_words(entry.remedy),
                expanded_then,
            )
        )
    expanded = "U now" if result.measured else "U expected"
    heads = ("parameter", expanded, "verdict: held by", "cure", "then")
    return Table.of("", heads, rows, text=heads[1:4])


def certificates_table(result: Identifiability, *, is_short: bool = False) -> Table:
    """Return a table of certificates of the instrument, one row for each certificate.

    Each row names the parameters whose uncertainty U the certificate would reduce. If ``is_short``
    is true, each row has a short name of the certificate, and at most four parameters.
    """
    rows = wording.certificate_rows(result, _MOST_NARROWED if is_short else None)
    if is_short:
        rows = [(wording.certificate_words(name), narrowed) for name, narrowed in rows]
    return Table.of("", ("certificate", "brings U to"), rows, text=("brings U to",))


@parts_of.register
def _passages_of_identifiability(result: Identifiability) -> tuple[Passage, ...]:
    """Return all tables and sentences on how well the readings determine the parameters.

    The tables are about the verdicts on the parameters, the certificates of the instrument, and the
    priors of the parameters. Two lists follow. The first names the combinations of parameters and
    effects that the readings cannot separate. The second names the tests or calibrations that would
    make a separation possible.
    """
    passages: list[Passage] = [verdicts_table(result)]
    pairs = wording.paired_remedy_items(result)
    if pairs:
        passages += [wording.IN_PAIRS, pairs]
    if result.certificates:
        passages.append(certificates_table(result))
    passages += [_origins_table(result), *wording.identifiability_sentences(result)]
    items = wording.degeneracy_items(result.degeneracies, result.cures)
    if items:
        passages += [wording.ALIKE, items]
        passages += [wording.TO_SEPARATE, wording.cure_items(result.degeneracies, result.cures)]
    else:
        passages.append(wording.NONE_ALIKE)
    passages += wording.not_modelled_sentences(result.not_modelled)
    return tuple(passages)


def _origins_table(result: Identifiability) -> Table:
    """Return a table of the parameters, which compares prior and posterior variances.

    The columns include the contraction and the origins. The contraction is the share of the prior
    variance that the readings remove. The origins are three shares of the posterior variance. The
    first share is due to effects whose size was measured in the campaign, the second to effects
    whose size is stated by the user, and the third to effects whose size is assumed by the model.
    """
    rows = []
    for name, entry in result.parameters.items():
        factor, unit = display_unit(entry.unit)
        prior = "flat"
        contraction = ""
        gain = ""
        if np.isfinite(entry.prior_sd):
            prior = three_digits(entry.prior_sd * factor)
            contraction = f"{entry.contraction:.4f}"
            gain = f"{entry.information_gain:.1f}"
        u = two_digits(entry.sd, factor)
        origins = wording.origins_in_words(entry)
        held_by = wording.held_by_words(entry)
        rows.append((display_name(name), prior, u, unit, contraction, gain, origins, held_by))
    heads = (
        "parameter",
        "prior sd",
        "u",
        "unit",
        "contraction",
        "gain (nat)",
        "origins (%)",
        "held by",
    )
    return Table.of("", heads, rows, text=("unit", "held by"))


@wording.with_words.register
def _record_of_identifiability(result: Identifiability) -> dict[str, Any]:
    """Return the JSON record of an identifiability analysis, with sentences and notes.

    A degeneracy is a combination of parameters and other effects that the readings cannot separate.
    For each degeneracy, one sentence describes the combination, and another sentence names the
    tests or calibrations that would resolve the degeneracy. The notes name the effects that the
    user has switched off.
    """
    record = result.as_dict()
    record.pop("cures")
    rows = zip(record["degeneracies"], result.degeneracies, result.cures, strict=True)
    for degeneracy_record, degeneracy, cures in rows:
        degeneracy_record["statement"] = wording.degeneracy_sentence(degeneracy)
        degeneracy_record["cure"] = wording.cure_words(degeneracy, cures)
    record["notes"] = list(wording.not_modelled_sentences(result.not_modelled))
    return record
