"""Identifiability as tables and sentences: which parameters the readings can separate."""

from __future__ import annotations

from typing import Any

import numpy as np

from ldbb_bayes.analysis.verdicts import Identifiability
from ldbb_bayes.report import wording
from ldbb_bayes.results import Passage, Table, parts_of
from ldbb_bayes.units import display_name, display_unit, round_uncertainty, three_digits

__all__ = ["parts_of"]


@parts_of.register
def _passages_of_identifiability(result: Identifiability) -> tuple[Passage, ...]:
    """Return a table of how far the readings determine each parameter, followed by sentences.

    Contraction, a column of the table, is the share of a parameter's prior variance that the
    readings remove. Two lists follow the sentences: combinations of parameters that no reading can
    resolve, and parameters whose effects on the readings look like those of friction, drift,
    curvature in force or lobes of the balls.
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
        u = round_uncertainty(entry.sd * factor)[0]
        verdict = wording.verdict_words(entry)
        rows.append((display_name(name), prior, u, unit, contraction, gain, verdict))
    heads = (
        "parameter",
        "prior sd",
        "u, sign free",
        "unit",
        "contraction",
        "gain (nat)",
        "verdict",
    )
    passages: list[Passage] = [
        Table.of("", heads, rows, text=("unit", "verdict")),
        *wording.identifiability_sentences(result),
    ]
    items = wording.degeneracy_items(result.degeneracies, result.cures)
    if items:
        passages += [wording.ALIKE, items]
    else:
        passages.append(wording.NONE_ALIKE)
    if result.standing:
        passages.append(tuple(map(wording.standing_words, result.standing)))
    return tuple(passages)


@wording.with_words.register
def _record_of_identifiability(result: Identifiability) -> dict[str, Any]:
    """Return the JSON record of identifiability, with notes and sentences on every degeneracy.

    A degeneracy is a combination of parameters that no reading can resolve. One sentence states the
    degeneracy, another the measures that would remove it.
    """
    record = result.as_dict()
    record.pop("cures")
    rows = zip(record["degeneracies"], result.degeneracies, result.cures, strict=True)
    for degeneracy_record, degeneracy, cures in rows:
        degeneracy_record["statement"] = wording.statement(degeneracy)
        degeneracy_record["cure"] = wording.cure_words(degeneracy, cures)
    record["notes"] = [wording.standing_words(standing) for standing in result.standing]
    return record
