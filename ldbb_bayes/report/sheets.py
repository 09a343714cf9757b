"""The certificate: two sheets to be signed, which report.html and report.pdf both show."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ldbb_bayes.analysis.assumed_sizes import AssumedSize, deciding_assumptions
from ldbb_bayes.analysis.conformity import Conformity
from ldbb_bayes.analysis.usability import Use, state_of
from ldbb_bayes.campaign.run_times import TimeSource, time_source
from ldbb_bayes.inference.posterior import bound_of, campaign_of, fit_of
from ldbb_bayes.model.hybrid import DEGREE_NAMES
from ldbb_bayes.model.terms import uncertainties
from ldbb_bayes.model.terms.base import Uncertainty
from ldbb_bayes.model.terms.columns import OWN
from ldbb_bayes.report.blocks import Banner, Block, Fields, Pair, ReportSheet
from ldbb_bayes.report.findings import Findings
from ldbb_bayes.report.pdf import fit_to_page
from ldbb_bayes.report.pictures import picture
from ldbb_bayes.report.sheet_numbers import SheetNumbers, remark
from ldbb_bayes.report.stated_quantity import StatedQuantity
from ldbb_bayes.report.translation import Words, words_of
from ldbb_bayes.report.wording import source_unit_words
from ldbb_bayes.results import Table
from ldbb_bayes.units import display_name, display_unit, state, two_digits

__all__ = ["sheets"]

_MOST_REASONS = 2  # largest number of reasons in the banner on whether the numbers can be used
_MOST_IN_WORDS = 2  # largest number of quantities that the banner names in words, not as symbols
_MOST_UNDETERMINED = 12  # largest number of undetermined quantities that sheet 1 lists
_LONGEST_ENTRY = 70  # largest number of characters of a text in a form field
_LONGEST_CERTIFICATE = 32  # largest number of characters of the name of a calibration certificate
_CAMPAIGN_ENTRIES = ("machine_type", "serial_number", "date", "operator", "place")
_DEVICE_ENTRIES = ("ball_bar", "ball_bar_calibrated", "force_device")
# Entry of the sheet that says in which order the tests were run, by what tells it.
_ORDER_ENTRIES = {
    TimeSource.TIMES: "entries.by_times",
    TimeSource.LISTED: "entries.as_listed",
    TimeSource.RANDOM: "entries.random_order",
    TimeSource.NO_DRIFT: "entries.no_drift",
}


def sheets(
    findings: Findings, *, language: str = "en", force_N: float | None = None
) -> tuple[ReportSheet, ...]:
    """Return sheet 1, the certificate, and sheet 2, its results.

    Parameters
    ----------
    findings
        All results of a fit that a report shows.
    language
        Code of the language, such as en; the package must have a catalogue of words for it.
    force_N
        Force at which stiffness and circular deviation are stated [N]. Default: the model's
        reference force.

    Returns
    -------
    tuple of ReportSheet
        Two sheets that fit their pages.

    Raises
    ------
    InputError
        The language has no catalogue.
    """
    words = words_of(language)
    if force_N is None:
        force_N = findings.result["model"]["reference_force_N"]
    numbers = SheetNumbers(findings, words, float(force_N))
    name = _shorten(str(findings.result["campaign"]["name"]))
    first = ReportSheet(
        "certificate",
        words("sheet.first"),
        words("sheet.of", number="1", name=name),
        tuple(_first_sheet(numbers)),
    )
    second = ReportSheet(
        "results-sheet",
        words("sheet.second"),
        words("sheet.of", number="2", name=name),
        tuple(_second_sheet(numbers)),
    )
    return fit_to_page(first), fit_to_page(second)


def _shorten(text: str) -> str:
    if len(text) <= _LONGEST_ENTRY:
        return text
    return f"{text[: _LONGEST_ENTRY - 1]}…"


# ---- sheet 1: the certificate


def _first_sheet(numbers: SheetNumbers) -> Iterator[Block]:
    words = numbers.words
    findings = numbers.findings
    yield _banner(numbers)
    yield Fields(tuple(_entries(findings, words)))
    yield _assumptions(numbers)
    force = words.number(f"{numbers.force_N:.4g}")
    middle = ""
    if numbers.force_N == findings.result["model"]["reference_force_N"]:
        middle = words("sheet.middle")
    quantities = [
        *numbers.stiffnesses.values(),
        *numbers.directions.values(),
        *numbers.further.values(),
        *numbers.path.values(),
        *numbers.unloaded_path.values(),
    ]
    yield _table_with_U(numbers, words("sheet.results", force=force, middle=middle), quantities)
    yield from _conformity(numbers)
    yield words("notes.U", percent=words.number(f"{100 * findings.prob:g}"))
    traces = picture(
        "traces", findings.posterior, words("sheet.traces"), words=words.table["figures"]
    )
    yield Pair(traces, words("sheet.undetermined"), tuple(_undetermined(numbers)))
    yield _averaged_models(findings, words)
    if findings.sheets_only:
        yield words("notes.sheets_only")
    yield Fields(((words("fields.signed"), ""), (words("fields.checked"), "")), tall=True)


def _undetermined(numbers: SheetNumbers) -> list[str]:
    """Return texts on what the readings do not determine, each with the reason.

    If the readings determine everything, the only text states this.
    """
    words = numbers.words
    items = []
    if 0.05 < numbers.findings.varying < 0.95:
        probability = words.percent(numbers.findings.varying)
        items.append(words("notes.varying", probability=probability))
    for quantity in numbers.parameters.values():
        if quantity.is_undetermined:
            items.append(f"{quantity.words} ({quantity.symbol}): {remark(quantity, words)}")
    unknown_signs = [
        symbol
        for symbol, quantity in numbers.changes.items()
        if quantity.direction == "no_change" and numbers.findings.varying > 0.5
    ]
    if unknown_signs:
        items.append(words("notes.unknown_signs", symbols=words.joined(unknown_signs)))
    confounded = [quantity for quantity in numbers.path.values() if quantity.hangs_on]
    if confounded:
        symbols = words.joined([quantity.symbol for quantity in confounded])
        without_note = replace(confounded[0], note="")
        items.append(f"{symbols}: {remark(without_note, words)}")

    if not items:
        return [words("sheet.all_determined")]
    excess = len(items) - _MOST_UNDETERMINED
    if excess > 0:
        continued = words("sheet.continued", count=str(excess))
        return [*items[:_MOST_UNDETERMINED], continued]
    return items


def _averaged_models(findings: Findings, words: Words) -> str:
    """Return a sentence on the model that the numbers of the sheets are from.

    If they are averages over models, it states the probabilities of the models.
    """
    probabilities = findings.probabilities
    if not probabilities:
        degree = DEGREE_NAMES[findings.result["model"]["degree"]]
        return words("notes.single", degree=words(f"degrees.{degree}"))
    models = []
    rivals = []
    for name, probability in probabilities.items():
        if name in DEGREE_NAMES:
            models.append(f"{words(f'degrees.{name}')} {words.percent(probability)}")
        else:
            rivals.append(f"{words(f'rivals.{name}')} {words.percent(probability)}")
    beside = ""
    if rivals:
        beside = words("notes.rivals", rivals=", ".join(rivals))
    annex = ""
    if not findings.sheets_only:
        annex = words("notes.annex")
    return words("notes.averaged", models=", ".join(models), beside=beside, annex=annex)


# ---- sheet 2: the results


def _second_sheet(numbers: SheetNumbers) -> Iterator[Block]:
    words = numbers.words
    findings = numbers.findings
    compliances = []
    others = []
    for name, quantity in numbers.parameters.items():
        if name.startswith("C"):
            compliances.append(quantity)
        else:
            others.append(quantity)
    quantities = [
        *compliances,
        *numbers.changes.values(),
        *others,
        *numbers.path.values(),
        *numbers.further_path.values(),
    ]
    yield _table_with_intervals(numbers, quantities)
    yield words(
        "notes.u",
        percent=words.number(f"{100 * findings.prob:g}"),
        force=words.number(f"{numbers.force_N:.4g}"),
    )
    yield words("notes.words", names="; ".join(_meanings_of_partners(numbers)))
    yield picture(
        "stiffness_rose",
        findings.numbers,
        words("sheet.rose"),
        words=words.table["figures"],
        compact=True,
    )
    yield picture(
        "compliance_against_force",
        findings.numbers,
        words("sheet.curve"),
        words=words.table["figures"],
    )
    provenance = findings.result["provenance"]
    yield words(
        "notes.provenance",
        sha=findings.result["campaign"]["sha256"][:16],
        version=provenance["versions"]["ldbb-bayes"],
        started=provenance["started"][:10],
    )


def _meanings_of_partners(numbers: SheetNumbers) -> list[str]:
    """Return explanations of the effects that are named with the verdicts on parameters.

    The effects are model terms, such as the mount, that a parameter is confounded with or that
    contribute to its variance. Each explanation is a text in the language of the sheets.
    """
    words = numbers.words
    partners: dict[str, None] = {}
    for quantity in [*numbers.parameters.values(), *numbers.changes.values()]:
        entry = quantity.entry or quantity.change_entry
        if entry is not None:
            partners |= dict.fromkeys((*entry.partner_shares, entry.held_by.name))
    meanings = words.table["means"]
    return [f"{words.term(name)}: {meanings[name]}" for name in partners if name in meanings]


# ---- tables of both sheets


def _table_with_U(
    numbers: SheetNumbers, caption: str, quantities: Sequence[StatedQuantity]
) -> Table:
    words = numbers.words
    rows = []
    for quantity in quantities:
        statement = quantity.value_and_U()
        rows.append(
            (
                quantity.words,
                quantity.symbol,
                words.number(statement.value),
                words.number(statement.expanded),
                words.unit(display_unit(quantity.unit)[1]),
                remark(quantity, words),
            )
        )
    return _table(numbers, caption, ("quantity", "symbol", "value", "U", "unit", "remark"), rows)


def _table_with_intervals(numbers: SheetNumbers, quantities: Sequence[StatedQuantity]) -> Table:
    words = numbers.words
    rows = []
    for quantity in quantities:
        statement = state(quantity.estimate, quantity.sd, quantity.interval, quantity.unit)
        interval = words("interval", low=statement.ends[0], high=statement.ends[1])
        rows.append(
            (
                quantity.words,
                quantity.symbol,
                words.number(statement.value),
                words.number(statement.u),
                words.number(interval),
                words.unit(display_unit(quantity.unit)[1]),
                remark(quantity, words),
            )
        )
    keys = ("quantity", "symbol", "value", "u", "interval", "unit", "remark")
    return _table(numbers, "", keys, rows)


def _table(
    numbers: SheetNumbers, caption: str, keys: Sequence[str], rows: Sequence[Sequence[str]]
) -> Table:
    """Return a table with column headings in the language of the sheet.

    ``keys`` name the headings in the catalogue of words, such as ``value``; ``rows`` are the texts
    of the cells.
    """
    words = numbers.words
    percent = words.number(f"{100 * numbers.findings.prob:g}")
    heads = {key: words(f"heads.{key}", percent=percent) for key in keys}
    text_columns = [heads["symbol"], heads["unit"], heads["remark"]]
    return Table.of(caption, list(heads.values()), rows, text=text_columns)


def _conformity(numbers: SheetNumbers) -> Iterator[Table | str]:
    """Yield a table of tolerances with the decision on each, and a note on the decisions.

    Yield nothing if there are no tolerances.
    """
    words = numbers.words
    quantities = numbers.parameters | numbers.slopes
    for label, quantity in numbers.stiffnesses.items():
        quantities[f"stiffness_{label[2]}"] = quantity
    quantities |= numbers.path | numbers.directions
    rows = []
    for name, conformity in numbers.findings.conformity(numbers.force_N).items():
        quantity_words = display_name(name)
        value = "–"
        if name in quantities:
            quantity_words = quantities[name].words
            value = quantities[name].value_and_U().value
        factor, label = display_unit(conformity.unit)
        rows.append(
            (
                quantity_words,
                words.number(value),
                words.number(_limits(conformity, factor)),
                words.number(two_digits(conformity.guard_band, factor)),
                words.unit(label),
                words.percent(conformity.probability),
                words(f"decisions.{str(conformity.decision).replace(' ', '_')}"),
            )
        )
    if rows:
        keys = ("quantity", "value", "tolerance", "guard", "unit", "probability", "decision")
        heads = {key: words(f"heads.{key}") for key in keys}
        text_columns = [heads["unit"], heads["decision"]]
        yield Table.of(words("sheet.conformity"), list(heads.values()), rows, text=text_columns)
        yield words("notes.conformity")


def _limits(conformity: Conformity, factor: float) -> str:
    low, high = (f"{limit * factor:.4g}".replace("-", "−") for limit in conformity.limits)
    if conformity.lower is None:
        return f"≤ {high}"
    if conformity.upper is None:
        return f"≥ {low}"
    return f"{low} … {high}"


# ---- whether the numbers can be used


def _banner(numbers: SheetNumbers) -> Banner:
    """Return the banner that states whether the numbers can be used, and the main reasons."""
    words = numbers.words
    findings = numbers.findings
    quantities = numbers.parameters
    comparison = None if isinstance(findings.comparison, str) else findings.comparison
    state_of_use = state_of(
        fit_of(findings.posterior), findings.verdicts, quantities, comparison=comparison
    )
    is_unusable = state_of_use.use == Use.DO_NOT_USE
    names_by_kind: dict[str, list[str]] = {}
    for reason in state_of_use.reasons:
        names = names_by_kind.setdefault(str(reason.kind).replace("-", "_"), [])
        names += reason.names
    reasons = [
        words(f"state.{kind}", names=words.joined(_labels(names, quantities)))
        for kind, names in names_by_kind.items()
    ]
    if findings.flat:
        reasons.append(words("state.least_squares"))
    forces_N = campaign_of(findings.numbers).forces_N
    if not forces_N.min() <= numbers.force_N <= forces_N.max():
        outside = words("state.outside", force=words.number(f"{numbers.force_N:.4g}"))
        # A force outside the tested range is the first reason for caution, or the second one if the
        # numbers cannot be used for another reason.
        reasons.insert(1 if is_unusable else 0, outside)

    kind = "usable"
    if is_unusable:
        kind = "unusable"
    elif reasons:
        kind = "reserved"
    because = "; ".join(reasons[:_MOST_REASONS]) or words("state.fits")
    if not is_unusable:
        because += _missing_certificates(findings, words)
    sentence = words(
        "state.sentence",
        state=words(f"state.{kind}"),
        reason=because[:1].upper() + because[1:],
    )
    return Banner(kind, sentence)


def _labels(names: Sequence[str], quantities: Mapping[str, StatedQuantity]) -> list[str]:
    """Return the names of one or two quantities in words, and of more quantities as symbols.

    The names of tests or hyper-parameters are returned as they are.
    """
    labels = []
    for name in names:
        if name not in quantities:
            labels.append(name)
        elif len(names) > _MOST_IN_WORDS:
            labels.append(quantities[name].symbol)
        else:
            labels.append(quantities[name].words)
    return labels


def _missing_certificates(findings: Findings, words: Words) -> str:
    """Return a note that some or all parts of the instrument have no certificate.

    The note is empty if all have one, or for a fit by least squares, which assumes nothing of the
    instrument.
    """
    if findings.flat:
        return ""
    is_stated = [piece.is_stated for piece in _instrument(findings)]
    if all(is_stated):
        return ""
    if any(is_stated):
        return words("state.partly_stated")
    return words("state.none_stated")


# ---- form fields: machine, operator, tests and instrument


def _entries(findings: Findings, words: Words) -> Iterator[tuple[str, str]]:
    """Yield the name and the text of each form field of sheet 1, such as operator and place.

    A text that the campaign does not state is empty.
    """
    campaign = bound_of(findings.posterior).campaign
    for key in _CAMPAIGN_ENTRIES:
        yield words(f"fields.{key}"), _shorten(str(getattr(campaign, key) or ""))
    planes = words.joined(list(dict.fromkeys(str(test.plane) for test in campaign.tests)))
    machine = words("entries.machine", topology=campaign.topology, planes=planes)
    yield words("fields.machine"), machine
    for key in _DEVICE_ENTRIES:
        yield words(f"fields.{key}"), _shorten(str(getattr(campaign, key) or ""))

    temperatures = [test.temperature_C for test in campaign.tests if test.temperature_C is not None]
    temperature = ""
    if temperatures:
        ends = [words.number(f"{end:.1f}") for end in (min(temperatures), max(temperatures))]
        temperature = words("entries.temperature", range=" … ".join(dict.fromkeys(ends)))
    yield words("fields.temperature"), temperature

    radii_mm = sorted({test.circle.radius_mm for test in campaign.tests})
    tests = words(
        "entries.tests",
        count=str(len(campaign.tests)),
        low=words.number(f"{min(campaign.forces_N):.4g}"),
        high=words.number(f"{max(campaign.forces_N):.4g}"),
        radius=words.number(", ".join(f"{radius:g}" for radius in radii_mm)),
    )
    yield words("fields.tests"), tests

    path = []
    if campaign.feed_mm_per_min:
        path.append(words("entries.feed", feed=f"{campaign.feed_mm_per_min:g}"))
    directions = dict.fromkeys(str(test.direction) for test in campaign.tests if test.direction)
    if directions:
        path.append("/".join(directions))
    if len(campaign.tests) > 1:
        path.append(words(_ORDER_ENTRIES[time_source(campaign)]))
    yield words("fields.path"), ", ".join(path)

    stated = []
    for piece in _instrument(findings):
        if piece.is_stated:
            text = f"{words(f'entries.{piece.key}')} {words.number(piece.size)}"
            stated.append(text + _certificate_name(findings, piece.key))
    yield words("fields.certificates"), ", ".join(stated) or words("entries.none")


def _assumptions(numbers: SheetNumbers) -> str:
    """Return sentences on every assumption that decides a number of the sheets, with its size.

    The assumptions are effects that nobody measured or stated, with the sizes of their budgets, and
    the priors of quantities that are limited by them.
    """
    words = numbers.words
    budgets = numbers.findings.budgets
    stated = {name: budgets[name] for name in (*numbers.parameters, *numbers.slopes)}
    effects = []
    for assumption in deciding_assumptions(stated):
        sizes = [_assumed_size(assumption.term, size, words) for size in assumption.sizes]
        text = f"{words.term(assumption.term)} {words.joined(sizes)}"
        effects.append(text.strip())
    sentence = words("notes.assumed", effects="; ".join(effects) or words("entries.none"))
    priors = []
    for quantity in (*numbers.parameters.values(), *numbers.changes.values()):
        entry = quantity.entry or quantity.change_entry
        if entry is not None and entry.held_by.name == OWN and np.isfinite(entry.prior_sd):
            factor, label = display_unit(entry.unit)
            size = words.number(two_digits(2.0 * entry.prior_sd, factor))
            priors.append(f"{quantity.symbol} ±\u00a0{size}\u00a0{words.unit(label)}")
    if priors:
        sentence += " " + words("notes.assumed_before", priors="; ".join(priors))
    return sentence


def _assumed_size(term: str, size: AssumedSize, words: Words) -> str:
    """Return the size of an assumed effect as text: twice its standard uncertainty."""
    factor, label = source_unit_words(size.source, term, size.unit)
    value = words.number(two_digits(2.0 * size.sd, factor))
    text = f"±\u00a0{value}\u00a0{words.unit(label)}"
    if size.differs:
        return words("entries.up_to", size=text)
    return text


def _certificate_name(findings: Findings, key: str) -> str:
    """Return the name of the certificate of a part of the instrument, in brackets.

    ``key`` names the part, such as ``bar``. The text is empty if the part has no certificate.
    """
    certificates = campaign_of(findings.posterior).instrument.certificates
    for name, certificate in certificates.items():
        if name.startswith(key):
            return f" ({certificate.split(': ')[0][:_LONGEST_CERTIFICATE]})"
    return ""


class _InstrumentPiece(NamedTuple):
    """A part of the instrument with its certified or assumed uncertainty.

    ``key`` names the part, such as ``bar``. ``is_stated`` is whether a certificate states its
    uncertainty.
    """

    key: str
    #: text of the part's certified value or grade, or of its assumed uncertainty U (k = 2)
    size: str
    is_stated: bool


# Names of the errors of the instrument whose uncertainties the sheets of the certificate state, by
# part of the instrument.
_UNCERTAINTY_OF_PIECE = {
    "bar": "bar_length",
    "work": "work_form_2",
    "tool": "tool_form_2",
    "mount": "mount",
    "force": "force_gain",
    "angle": "angle_reference",
}


def _instrument(findings: Findings) -> list[_InstrumentPiece]:
    """Return the parts of the instrument (bar, balls, …) whose errors the model includes."""
    bound = bound_of(findings.posterior)
    assumed = uncertainties(bound.campaign, bound.model.nuisances).assumed
    by_name = {uncertainty.name: uncertainty for uncertainty in assumed}
    pieces = []
    for key, name in _UNCERTAINTY_OF_PIECE.items():
        if name in by_name:
            uncertainty = by_name[name]
            size = _ball_size(findings, key) or _size(key, uncertainty)
            pieces.append(_InstrumentPiece(key, size, uncertainty.stated))
    return pieces


def _ball_size(findings: Findings, key: str) -> str:
    """Return the stated grade of a ball as text, such as G10, or else its sphericity, as 0.2 µm.

    ``key`` names a part of the instrument. The text is empty if neither grade nor sphericity is
    stated, or if the part is not a ball.
    """
    if key not in ("work", "tool"):
        return ""
    ball = getattr(bound_of(findings.posterior).campaign.instrument, key)
    if ball is None or ball.stated_sphericity_um is None:
        return ""
    return str(ball.grade or f"{ball.sphericity_um:g} µm")


def _size(key: str, uncertainty: Uncertainty) -> str:
    """Return the certified uncertainty U (k = 2) of a part of the instrument as text.

    ``key`` names the part. For the bar, the error of its length precedes the uncertainty if it is
    not zero.
    """
    if uncertainty.unit == "1" or key == "mount":
        size = f"{two_digits(2.0 * uncertainty.sd / (uncertainty.value or 1.0), 100.0)} %"
    elif uncertainty.unit == "rad":
        size = f"{two_digits(np.degrees(2.0 * uncertainty.sd))}°"
    else:
        factor, label = display_unit(uncertainty.unit)
        size = f"{two_digits(2.0 * uncertainty.sd, factor)} {label}"
    size = f"U = {size}"
    if key == "bar" and uncertainty.value:
        size = f"{uncertainty.value * 1e3:+.4g} µm, {size}".replace("-", "−")
    return size
