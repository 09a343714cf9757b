"""The two sheets of the test certificate, which report.html and report.pdf both show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from ldbb_bayes.analysis.machine_description import describe_machine
from ldbb_bayes.campaign.tested_forces import force_to_state
from ldbb_bayes.inference.posterior import bound_of, campaign_of
from ldbb_bayes.model.parameter_kinds import DEGREE_NAMES
from ldbb_bayes.report.blocks import Block, Fields, Pair, PictureRow, ReportSheet
from ldbb_bayes.report.figure_translation import translate_figure
from ldbb_bayes.report.figures.circle_figures import MOST_BANDS
from ldbb_bayes.report.findings import Findings
from ldbb_bayes.report.pictures import Picture, picture
from ldbb_bayes.report.plain_findings import plain_words
from ldbb_bayes.report.sheet_fields import (
    assumption_fields,
    campaign_fields,
    identity_fields,
    shorten,
)
from ldbb_bayes.report.sheet_numbers import SheetNumbers
from ldbb_bayes.report.sheet_remarks import remark
from ldbb_bayes.report.sheet_state import banner, undetermined_texts
from ldbb_bayes.report.stated_quantity import StatedQuantity
from ldbb_bayes.report.translation import Words, words_of
from ldbb_bayes.report.wording import limit_words, sum_in_words
from ldbb_bayes.results import Table
from ldbb_bayes.units import (
    U_PROBABILITY,
    display_name,
    display_unit,
    is_compliance_or_slope,
    state,
    two_digits,
)

__all__ = ["sheet_line", "sheets", "signatures"]


def sheets(
    findings: Findings, *, language: str = "en", force_N: float | None = None, further: int = 0
) -> tuple[ReportSheet, ...]:
    """Return the first two sheets of the test certificate. Sheet 2 has all results.

    Parameters
    ----------
    findings
        All results of a fit that a report shows.
    language
        Code of the language of the sheets, such as en. The package must have texts in this
        language.
    force_N
        Force at which stiffness and circular deviation are stated [N]. Default: the model's
        reference force.
    further
        Number of sheets that follow these two (`difference_sheets`).

    Returns
    -------
    tuple of ReportSheet
        Two sheets of any length; see `fit_to_pages`.

    Raises
    ------
    InputError
        The package has no texts in the language.
    """
    words = words_of(language)
    if force_N is None:
        bound = bound_of(findings.posterior_of_certificate)
        force_N = force_to_state(bound.campaign, bound.setting.reference_force_N)
    with_brackets = SheetNumbers(findings, words, float(force_N))
    numbers = with_brackets
    if findings.prob != U_PROBABILITY:
        numbers = SheetNumbers(replace(findings, prob=U_PROBABILITY), words, float(force_N))
    name = str(findings.result["campaign"]["name"])
    first = ReportSheet(
        "certificate",
        words("sheet.first"),
        sheet_line(words, 1, 2 + further, name),
        tuple(_first_sheet(numbers)),
    )
    second = ReportSheet(
        "results-sheet",
        words("sheet.second"),
        sheet_line(words, 2, 2 + further, name),
        tuple(_second_sheet(numbers, with_brackets)),
    )
    return first, second


def sheet_line(words: Words, number: int, sheets: int, name: str) -> str:
    """Return the line below the title of a sheet: its number, and the name of the campaign.

    ``sheets`` is the number of all sheets.
    """
    return words("sheet.of", number=str(number), count=str(sheets), name=shorten(name))


# ---- sheet 1 of the test certificate: fields, findings and main results


def _first_sheet(numbers: SheetNumbers) -> Iterator[Block]:
    """Yield the content of sheet 1 of the test certificate.

    The content is: the banner, the fields of the campaign, the findings in plain words, the table
    of results with uncertainties, the decisions on conformity, the figure of the readings beside
    the list of quantities that are undetermined, notes, and the fields for signatures.
    ``numbers`` holds the numbers and the words of the certificate.
    """
    words = numbers.words
    findings = numbers.findings
    yield banner(numbers)
    yield Fields(tuple(campaign_fields(findings, words)))
    yield plain_words(numbers)
    force = words.number(f"{numbers.force_N:.4g}")
    middle = ""
    if numbers.force_N == findings.result["model"]["reference_force_N"]:
        middle = words("sheet.middle")
    quantities = [
        *numbers.stiffnesses.values(),
        *numbers.directions.values(),
        *numbers.squareness_errors.values(),
        *numbers.path.values(),
        *numbers.unloaded_path.values(),
    ]
    yield _table_with_U(numbers, words("sheet.results", force=force, middle=middle), quantities)
    yield from _conformity(numbers)
    yield words("notes.U", percent=words.number(f"{100 * findings.prob:g}"))
    caption = "sheet.traces"
    if len(campaign_of(findings.posterior).tests) > MOST_BANDS:
        caption = "sheet.traces_without_bands"
    traces = _picture("traces", findings.posterior, words(caption), words)
    yield Pair(traces, words("sheet.undetermined"), tuple(undetermined_texts(numbers)))
    yield _averaged_models(findings, words)
    if findings.sheets_only:
        yield words("notes.sheets_only")
    yield signatures(words)


def _picture(key: str, subject: Any, caption: str, words: Words, **options: Any) -> Picture:
    """Return a figure with the texts and the decimal mark of one language.

    ``key`` is the name of the figure, ``subject`` the result that it shows, and ``caption`` its
    caption. ``words`` holds the texts in this language. ``options`` are passed to the function that
    draws the figure.
    """
    drawn = picture(key, subject, caption, words=words.table["figures"], **options)
    translate_figure(drawn.figure, words.number)
    return drawn


def signatures(words: Words) -> Fields:
    """Return the form fields for the signatures at the end of each sheet of the certificate."""
    return Fields(((words("fields.signed"), ""), (words("fields.checked"), "")), tall=True)


def _averaged_models(findings: Findings, words: Words) -> str:
    """Return a sentence that names the model from which the estimates on a certificate come.

    If the estimates are averages over models, the sentence states the probability of each model.
    """
    probabilities = findings.probabilities
    if not probabilities:
        degree = DEGREE_NAMES[findings.result["model"]["degree"]]
        return words("notes.single", degree=words(f"degrees.{degree}"))
    models = []
    rivals = []
    names = []
    for name, probability in probabilities.items():
        if name in DEGREE_NAMES:
            models.append(f"{words(f'degrees.{name}')} {words.percent(probability)}")
        else:
            names.append(words(f"rivals.{name}"))
            rivals.append(f"{names[-1]} {words.percent(probability)}")
    beside = ""
    over = ""
    if rivals:
        beside = words("notes.rivals", rivals=", ".join(rivals))
        over = words("notes.over_rivals", rivals=words.joined(names))
    annex = ""
    if not findings.sheets_only:
        annex = words("notes.annex")
    return words("notes.averaged", models=", ".join(models), beside=beside, over=over, annex=annex)


# ---- sheet 2 of the test certificate: the results


def _quantities_of_second_sheet(numbers: SheetNumbers) -> list[StatedQuantity]:
    """Return the quantities that sheet 2 of the test certificate states, in their order."""
    compliances = []
    others = []
    for name, quantity in numbers.parameters.items():
        if is_compliance_or_slope(name):
            compliances.append(quantity)
        else:
            others.append(quantity)
    return [
        *compliances,
        *numbers.changes.values(),
        *others,
        *numbers.path.values(),
        *numbers.path_on_second_sheet.values(),
    ]


def _second_sheet(numbers: SheetNumbers, with_brackets: SheetNumbers) -> Iterator[Block]:
    """Yield the content of sheet 2 of the test certificate, with all parameters and figures.

    The intervals in brackets are those of ``with_brackets``; U and all else is of ``numbers``.
    """
    words = numbers.words
    findings = numbers.findings
    yield Fields(identity_fields(findings, words))
    yield _table_with_intervals(
        with_brackets,
        _quantities_of_second_sheet(numbers),
        _quantities_of_second_sheet(with_brackets),
    )
    yield words(
        "notes.u",
        percent=words.number(f"{100 * with_brackets.findings.prob:g}"),
        force=words.number(f"{numbers.force_N:.4g}"),
    )
    yield words("notes.words", names="; ".join(_meanings_of_partners(numbers)))
    yield from _sums(findings, words)
    yield _gum_sentence(numbers)
    rests_on = tuple(assumption_fields(numbers))
    yield Fields(rests_on, heading=words("sheet.rests_on"))
    yield words("notes.rests_on")
    rose = _picture(
        "stiffness_rose",
        findings.posterior_of_certificate,
        words("sheet.rose"),
        words,
        compact=True,
    )
    curve = _picture(
        "compliance_against_force", findings.posterior_of_certificate, words("sheet.curve"), words
    )
    yield PictureRow((rose, curve))
    provenance = findings.result["provenance"]
    yield words(
        "notes.provenance",
        sha=findings.result["campaign"]["sha256"][:16],
        version=provenance["versions"]["ldbb-bayes"],
        started=provenance["started"][:10],
    )
    yield signatures(words)


def _sums(findings: Findings, words: Words) -> Iterator[str]:
    """Yield a sentence that lists which compliances of the model stand for sums, and which sums.

    If the readings cannot separate some compliances of the machine, the model has a single
    compliance, which stands for their sum. Nothing is yielded if there is no such compliance.
    """
    campaign = campaign_of(findings.posterior)
    machine = describe_machine(campaign.machine(), [test.circle for test in campaign.tests])
    sums = []
    for parameter in machine.compliances:
        if parameter.members:
            symbol = display_name(parameter.name)
            sums.append(words("notes.sum", symbol=symbol, sum=sum_in_words(parameter)))
    if sums:
        yield words("notes.sums", sums="; ".join(sums))


def _gum_sentence(numbers: SheetNumbers) -> str:
    """Return a sentence that compares credible intervals with intervals according to the GUM.

    The second kind of interval follows from the GUM's law of propagation of uncertainty. The
    sentence states for which parameters both kinds of interval agree. The comparison follows the
    validation procedure of JCGM 101. It is made at the reference force of the model; compliances
    that the sheets state at another force are therefore not among these parameters, and neither are
    parameters for which the numerical error leaves the comparison open.
    """
    words = numbers.words
    validation = numbers.findings.gum_validation
    reference_force_N = numbers.findings.result["model"]["reference_force_N"]
    is_at_reference = numbers.force_N == reference_force_N
    agreeing = []
    differing = []
    for name, entry in validation.parameters.items():
        if name not in numbers.parameters:
            continue
        is_compared = is_at_reference or not is_compliance_or_slope(name)
        if entry.validated and entry.decided and is_compared:
            agreeing.append(display_name(name))
        else:
            differing.append(display_name(name))
    digits = str(validation.digits)
    if not differing:
        return words("notes.gum_agrees", digits=digits)
    if not agreeing:
        return words("notes.gum_differs", digits=digits)
    return words("notes.gum_agrees_in_part", digits=digits, symbols=words.joined(agreeing))


def _meanings_of_partners(numbers: SheetNumbers) -> list[str]:
    """Return explanations of the effects that the verdicts on parameters name.

    Each effect is a model term, such as the mount. A verdict states how well the readings determine
    a parameter. The verdict names the effects with which the parameter is confounded, and the
    effect that contributes most to the parameter's variance. Each explanation is a text in the
    language of the test certificate.
    """
    words = numbers.words
    partners: dict[str, None] = {}
    for quantity in [*numbers.parameters.values(), *numbers.changes.values()]:
        entry = quantity.entry or quantity.change_entry
        if entry is not None:
            partners |= dict.fromkeys((*entry.partner_shares, entry.held_by.name))
    meanings = words.table["means"]
    return [f"{words.term(name)}: {meanings[name]}" for name in partners if name in meanings]


# ---- tables on the sheets of the test certificate


def _table_with_U(
    numbers: SheetNumbers, caption: str, quantities: Sequence[StatedQuantity]
) -> Table:
    """Return a table of quantities that the test certificate states, one row for each.

    The columns are value, U (k = 2), unit and remark. ``caption`` is the caption of the table.
    """
    rows = [_cells(quantity, numbers.words) for quantity in quantities]
    return _table(numbers, caption, ("quantity", "symbol", "value", "U", "unit", "remark"), rows)


def _table_with_intervals(
    numbers: SheetNumbers,
    quantities: Sequence[StatedQuantity],
    in_brackets: Sequence[StatedQuantity],
) -> Table:
    """Return a table of quantities with credible intervals for the test certificate.

    There is one row for each quantity. The columns are value, U (k = 2), credible interval, unit
    and remark. U is that of ``quantities``. The credible intervals are those of ``in_brackets``,
    the same quantities; their probability is the one in ``numbers``. A dash takes the place of an
    interval of a change that is almost certainly zero, as at the terminal and in the annex.
    """
    words = numbers.words
    rows = []
    for quantity, other in zip(quantities, in_brackets, strict=True):
        interval = "–"
        if not other.is_exactly_none:
            ends = state(quantity.estimate, quantity.sd, other.interval, quantity.unit).ends
            interval = words("interval", low=ends[0], high=ends[1])
        rows.append(_cells(quantity, words, words.number(interval)))
    keys = ("quantity", "symbol", "value", "U", "interval", "unit", "remark")
    return _table(numbers, "", keys, rows)


def _cells(quantity: StatedQuantity, words: Words, *interval: str) -> tuple[str, ...]:
    """Return the row of a quantity: name, symbol, value, U (k = 2), interval, unit and remark.

    ``interval`` is the text of the credible interval; there is no such cell if it is left out.
    """
    statement = quantity.value_and_U()
    return (
        quantity.words,
        quantity.symbol,
        words.number(statement.value),
        words.number(statement.expanded),
        *interval,
        words.unit(display_unit(quantity.unit)[1]),
        remark(quantity, words),
    )


def _table(
    numbers: SheetNumbers, caption: str, keys: Sequence[str], rows: Sequence[Sequence[str]]
) -> Table:
    """Return a table whose column headings are in the language of the test certificate.

    ``keys`` are the keys of the headings in the file of the certificate's texts, such as ``value``.
    ``rows`` holds the texts of the cells.
    """
    words = numbers.words
    percent = words.number(f"{100 * numbers.findings.prob:g}")
    heads = {key: words(f"heads.{key}", percent=percent) for key in keys}
    text_columns = [heads["symbol"], heads["unit"], heads["remark"]]
    return Table.of(caption, list(heads.values()), rows, text=text_columns)


def _conformity(numbers: SheetNumbers) -> Iterator[Table | str]:
    """Yield a table with the decision on each tolerance, and a note on the decisions.

    Nothing is yielded if there are no tolerances.
    """
    words = numbers.words
    quantities = numbers.parameters | numbers.slopes
    for label, quantity in numbers.stiffnesses.items():
        # In the results, the stiffness 1 / C_XXX of the axis X has the key C_XXX; among the
        # tolerances, the same stiffness has the key stiffness_X.
        axis = label[2]
        quantities[f"stiffness_{axis}"] = quantity
    quantities |= numbers.path | numbers.directions
    rows = []
    for name, conformity in numbers.findings.conformity(numbers.force_N).items():
        quantity_words = display_name(name)
        value = "–"
        if name in quantities:
            quantity_words = quantities[name].words
            value = quantities[name].value_and_U().value
        factor, label = display_unit(conformity.unit)
        guard_band = "–"
        if conformity.guard_band is not None:
            guard_band = two_digits(conformity.guard_band, factor)
        rows.append(
            (
                quantity_words,
                words.number(value),
                words.number(limit_words(conformity.lower, conformity.upper, factor)),
                words.number(guard_band),
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
