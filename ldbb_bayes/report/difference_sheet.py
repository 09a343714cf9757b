"""The sheets of a report that compare its campaign with further campaigns, one sheet for each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import pandas as pd

from ldbb_bayes.analysis.common_effects import Shared
from ldbb_bayes.analysis.parameter_changes import changed_parameters, differences_can_be_used
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.inference.posterior import campaign_of
from ldbb_bayes.model.parameter_kinds import DEGREE_NAMES
from ldbb_bayes.report import wording
from ldbb_bayes.report.annex_translation import annex_translation
from ldbb_bayes.report.blocks import Banner, Block, Fields, Items, ReportSheet
from ldbb_bayes.report.findings import Findings, FurtherCampaign
from ldbb_bayes.report.sheet_fields import shorten
from ldbb_bayes.report.sheet_numbers import SheetNumbers
from ldbb_bayes.report.sheet_state import banner_of_fit
from ldbb_bayes.report.sheets import sheet_line, signatures
from ldbb_bayes.report.stated_quantity import StatedQuantity
from ldbb_bayes.report.translation import Words
from ldbb_bayes.results import Table
from ldbb_bayes.units import (
    display_unit,
    is_direct,
    is_slope,
    plus_minus,
    round_like,
    state,
    stated_decimals,
)

__all__ = ["difference_sheets"]


def difference_sheets(
    findings: Findings, others: Sequence[FurtherCampaign], shared: Shared, words: Words
) -> Iterator[ReportSheet]:
    """Yield a sheet on the differences between the campaign of a report and each further campaign.

    Parameters
    ----------
    findings
        All results of the fit that the report shows.
    others
        The further campaigns.
    shared
        What the further campaigns have in common with the campaign of the fit.
    words
        Texts of the test certificate, in its language.

    Yields
    ------
    ReportSheet
        Sheets of any length; see `fit_to_pages`.
    """
    first = campaign_of(findings.posterior)
    sheets = 2 + len(others)
    for number, other in enumerate(others, 3):
        yield ReportSheet(
            f"difference-sheet-{number}",
            words("sheet.difference"),
            sheet_line(words, number, sheets, f"{first.name}, {other.name}"),
            tuple(_blocks(findings, other, shared, words)),
        )


def _blocks(
    findings: Findings, other: FurtherCampaign, shared: Shared, words: Words
) -> Iterator[Block]:
    """Yield the content of the sheet that compares the report's campaign with another campaign.

    The content is: doubts about the two fits and their comparison, the two campaigns, the
    parameters that have changed, a table of all differences, what is taken to be common, and the
    fields for signatures. If there are doubts, no changes are named. If only the models of the two
    fits differ, or a fit can be used with a reservation, this is a reservation.
    """
    first = campaign_of(findings.posterior)
    name = str(first.name)
    common = wording.common_words(findings.result["model"]["reference_force_N"], shared)
    doubts = wording.difference_doubts(name, other.name, other.differences.attrs)
    reservations = wording.difference_reservations(other.differences.attrs)
    translation = annex_translation(words, frozenset([name, other.name]))
    if translation is not None:
        common = translation.text(common)
        doubts = tuple(translation.text(doubt) for doubt in doubts)
        reservations = tuple(translation.text(sentence) for sentence in reservations)
    first_fit, second_fit = other.differences.attrs["fits"]
    banners = [
        banner_of_fit(name, first_fit, first, words),
        banner_of_fit(other.name, second_fit, other.campaign, words),
    ]
    of_fits = [banner for banner in banners if banner is not None]
    is_unusable = not differences_can_be_used(other.differences.attrs)
    if of_fits or doubts or reservations:
        kind = "unusable" if is_unusable else "reserved"
        sentences = [banner.sentence for banner in of_fits]
        yield Banner(kind, " ".join((*sentences, *doubts, *reservations)))
    yield Fields(
        (
            (words("fields.first_campaign"), _campaign_text(name, first)),
            (words("fields.second_campaign"), _campaign_text(other.name, other.campaign)),
            (words("fields.first_readings"), f"SHA-256 {first.sha256[:16]}"),
            (words("fields.second_readings"), f"SHA-256 {other.campaign.sha256[:16]}"),
        )
    )
    is_of_slope = other.differences.index.map(is_slope).to_numpy(dtype=bool)
    differences = other.differences[~is_of_slope]
    quantities = _quantities(findings, other.differences_of_U[~is_of_slope], words)
    if not is_unusable:
        yield Items(
            words("sheet.plain"), tuple(_changes(differences, quantities, findings.prob, words))
        )
    yield _table(differences, quantities, findings.prob, words)
    yield common
    degree = words(f"degrees.{DEGREE_NAMES[findings.result['model']['degree']]}")
    yield words("notes.difference", degree=degree, name=name)
    yield signatures(words)


def _campaign_text(name: str, campaign: Campaign) -> str:
    """Return a string that names a campaign, its machine and its date, as far as they are known."""
    pieces = [name]
    for entry in (campaign.machine_type, campaign.machine_id, campaign.date):
        if entry is not None and str(entry) != name:
            pieces.append(str(entry))
    return shorten(", ".join(pieces))


def _quantities(
    findings: Findings, differences: pd.DataFrame, words: Words
) -> dict[str, StatedQuantity]:
    """Return the differences of the parameters as quantities that the sheet states.

    The keys are the names of the parameters. ``differences`` has one row for each of them, with
    intervals of 95 %, from which U (k = 2) is stated.
    """
    reference_force_N = float(findings.result["model"]["reference_force_N"])
    of_first = SheetNumbers(findings, words, reference_force_N).parameters
    quantities = {}
    for name, row in differences.iterrows():
        parameter = str(name)
        quantities[parameter] = StatedQuantity(
            words=of_first[parameter].words,
            symbol=of_first[parameter].symbol,
            estimate=float(row["difference"]),
            sd=float(row["sd"]),
            interval=(float(row["ci_low"]), float(row["ci_high"])),
            unit=str(row["unit"]),
        )
    return quantities


def _changes(
    differences: pd.DataFrame,
    quantities: Mapping[str, StatedQuantity],
    prob: float,
    words: Words,
) -> Iterator[str]:
    """Yield sentences on the parameters that have changed, and in which direction.

    ``prob`` is the probability of the credible intervals.
    """
    percent = words.number(f"{100 * prob:g}")
    changed = changed_parameters(differences, prob)
    for name in changed.alone:
        quantity = quantities[name]
        direction = "larger" if quantity.estimate > 0.0 else "smaller"
        if is_direct(name):
            direction = "softer" if quantity.estimate > 0.0 else "stiffer"
        # What is "smaller by" a size has the size without the sign of the difference.
        size = abs(quantity.estimate)
        interval = quantity.interval
        if quantity.estimate < 0.0:
            interval = (-quantity.interval[1], -quantity.interval[0])
        yield words(
            f"differences.{direction}",
            quantity=quantity.words,
            symbol=quantity.symbol,
            size=words.unit(words.number(plus_minus(size, quantity.sd, interval, quantity.unit))),
        )
    if not changed.alone:
        yield words("differences.none", percent=percent)
        return
    together = [quantities[name].symbol for name in changed.together]
    yield words(
        "differences.together",
        percent=percent,
        count=str(changed.compared),
        names=words.joined(together) or words("differences.no_parameter"),
    )


def _table(
    differences: pd.DataFrame,
    quantities: Mapping[str, StatedQuantity],
    prob: float,
    words: Words,
) -> Table:
    """Return a table of the parameters in both campaigns and of their differences, with U.

    Both values have the decimals of the difference, which are those of U. The intervals in brackets
    are those of ``differences``; their probability is ``prob``.
    """
    rows = []
    for name, row in differences.iterrows():
        quantity = quantities[str(name)]
        factor, unit = display_unit(quantity.unit)
        decimals = stated_decimals(quantity.estimate, quantity.sd, quantity.interval, quantity.unit)
        statement = quantity.value_and_U()
        in_brackets = (float(row["ci_low"]), float(row["ci_high"]))
        ends = state(quantity.estimate, quantity.sd, in_brackets, quantity.unit).ends
        rows.append(
            (
                quantity.words,
                quantity.symbol,
                words.number(round_like(row["first"] * factor, decimals).replace("-", "−")),
                words.number(round_like(row["second"] * factor, decimals).replace("-", "−")),
                words.number(statement.value),
                words.number(statement.expanded),
                words.number(words("interval", low=ends[0], high=ends[1])),
                words.unit(unit),
                words.number(wording.probability_words(row["probability_of_increase"])),
            )
        )
    percent = words.number(f"{100 * prob:g}")
    values = ("first", "second", "difference", "U", "interval", "unit", "larger")
    keys = ("quantity", "symbol", *values)
    heads = {key: words(f"heads.{key}", percent=percent) for key in keys}
    text_columns = [heads["symbol"], heads["unit"]]
    return Table.of(words("sheet.differences"), list(heads.values()), rows, text=text_columns)
