"""The two sheets for signing: what they state, where, and in which words."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from campaigns import plan, refuses, simulated
from reports import NOT_COMPARED, awkward, fitted, plan_of_three_planes

import ldbb_bayes as lb
from ldbb_bayes.analysis.origins import Origin
from ldbb_bayes.analysis.stated_quantities import AxialDirection
from ldbb_bayes.analysis.usability import Judgement, Reason, ReasonKind, Use
from ldbb_bayes.analysis.variance_sources import VarianceSource
from ldbb_bayes.inference.fit import ConcernKind
from ldbb_bayes.inference.posterior import campaign_of, fit_of, record_of
from ldbb_bayes.report import plain_findings, sections, sheet_state, stiffness_numbers, wording
from ldbb_bayes.report import sheets as sheets_module
from ldbb_bayes.report.blocks import Banner, Fields, Items, Pair, PictureRow, ReportSheet
from ldbb_bayes.report.conformity_tables import conformity_table
from ldbb_bayes.report.figures import new_figure
from ldbb_bayes.report.findings import Findings, findings_of_fit
from ldbb_bayes.report.pictures import Picture
from ldbb_bayes.report.plain_findings import Finding, FindingKind, best_step
from ldbb_bayes.report.plain_findings import findings_of as findings_of_sheet
from ldbb_bayes.report.sheet_fields import _machine_text, assumption_fields
from ldbb_bayes.report.sheet_numbers import SheetNumbers
from ldbb_bayes.report.sheet_remarks import remark
from ldbb_bayes.report.sheet_state import banner, undetermined_texts
from ldbb_bayes.report.sheets import _gum_sentence, _table_with_intervals, sheets
from ldbb_bayes.report.stated_quantity import StatedQuantity
from ldbb_bayes.report.translation import words_of
from ldbb_bayes.results import Table
from ldbb_bayes.units import two_digits, value_and_uncertainty

# Sheet 1, the certificate, and sheet 2, its results.
Sheets = tuple[ReportSheet, ...]
LANGUAGES = ("en", "de")
EN = words_of("en")


pytestmark = pytest.mark.usefixtures("without_figures")


def test_a_ratio_is_independent_of_the_scale_of_the_force_alone() -> None:
    """An offset of the force, or its scatter, does not cancel."""
    assert "scale of the force" in words_of("en")("remarks.gain_cancels")
    assert "Skala der Kraftanzeige" in words_of("de")("remarks.gain_cancels")


def findings_of(campaign: lb.Campaign, tolerances: dict[str, Any] | None = None) -> Findings:
    posterior = fitted(lb.HybridModel.first(0), campaign)
    return findings_of_fit(
        posterior, comparison=NOT_COMPARED, recommended=NOT_COMPARED, tolerances=tolerances
    )


@pytest.fixture(scope="module")
def findings() -> Findings:
    return findings_of(simulated(plan()))


@pytest.fixture(scope="module")
def by_language(findings: Findings) -> dict[str, Sheets]:
    return {language: sheets(findings, language=language) for language in LANGUAGES}


@pytest.fixture(scope="module")
def english(by_language: dict[str, Sheets]) -> Sheets:
    return by_language["en"]


def tables_of(sheet: ReportSheet) -> list[Table]:
    return [block for block in sheet.blocks if isinstance(block, Table)]


def test_numbers_within_a_german_figure_have_decimal_commas(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Such as those at the rings of a polar figure, which are no labels of ticks."""
    figure = new_figure(1.0, 1.0)
    figure.text(0.5, 0.5, "2.5 µm")
    traces = Picture("traces", "", figure)
    monkeypatch.setattr(sheets_module, "picture", lambda *_, **__: traces)
    sheets_module._picture("traces", None, "", words_of("de"))
    assert [text.get_text() for text in figure.texts] == ["2,5 µm"]


def test_a_certificate_and_its_results(english: Sheets) -> None:
    assert [sheet.key for sheet in english] == ["certificate", "results-sheet"]


def test_the_certificate_begins_with_whether_it_can_be_used(english: Sheets) -> None:
    first, _ = english
    banner = first.blocks[0]
    assert isinstance(banner, Banner)
    assert banner.kind in ("usable", "reserved")


@pytest.mark.parametrize(
    ("language", "factor", "opening", "limit"),
    [
        (
            "en",
            1e-3,
            "DO NOT USE THE RESULTS. The readings of all circles span 0.0",
            " µm, less than the 0.090 µm that every ball bar shows: state their unit",
        ),
        (
            "en",
            1e3,
            "DO NOT USE THE RESULTS. The readings of all circles span ",
            " mm, more than the 3.0 mm that a ball bar can show: state their unit",
        ),
        (
            "de",
            1e-3,
            "DIE ERGEBNISSE NICHT VERWENDEN. Die Messwerte (alle Kreise) umfassen 0,0",
            " µm, weniger als die 0,090 µm, die jedes Messgerät zeigt: ihre Einheit",
        ),
    ],
)
def test_the_certificate_doubts_the_unit_of_readings(
    language: str, factor: float, opening: str, limit: str
) -> None:
    """A thousandth of the readings looks like a very stiff machine, a thousand times the readings
    like a very soft one. The box says which of the two holds."""
    campaign = simulated(plan())
    scaled = [test.with_reading_um(factor * np.asarray(test.reading_um)) for test in campaign.tests]
    first, _ = sheets(findings_of(replace(campaign, tests=tuple(scaled))), language=language)
    banner = first.blocks[0]
    assert isinstance(banner, Banner)
    assert banner.kind == "unusable"
    assert banner.sentence.startswith(opening)
    assert limit in banner.sentence


@pytest.mark.parametrize(
    ("language", "nothing", "in_plain_words"),
    [
        (
            "en",
            "All quantities, because the results cannot be used (box at the top).",
            "They do not describe the machine",
        ),
        (
            "de",
            "Alle Größen, weil die Ergebnisse nicht zu verwenden sind (Kasten oben).",
            "Sie beschreiben die Maschine nicht",
        ),
    ],
)
def test_of_results_that_cannot_be_used_nothing_is_called_determined(
    language: str, nothing: str, in_plain_words: str
) -> None:
    """Readings in mm taken for µm narrow every prior. No plain sentence states a stiffness."""
    campaign = simulated(plan())
    small = [test.with_reading_um(1e-3 * np.asarray(test.reading_um)) for test in campaign.tests]
    findings = findings_of(replace(campaign, tests=tuple(small)))
    numbers = SheetNumbers(findings, words_of(language), 389.0)
    assert not any(quantity.is_undetermined for quantity in numbers.parameters.values())
    first, _ = sheets(findings, language=language)
    (pair,) = [block for block in first.blocks if isinstance(block, Pair)]
    (plain,) = [block for block in first.blocks if isinstance(block, Items)]
    assert pair.beside == (nothing,)
    (sentence,) = plain.items
    assert in_plain_words in sentence
    assert not any(character.isdigit() for character in sentence)


@pytest.mark.parametrize(
    ("has_flat_priors", "beginning"), [(False, "None: the test narrowed"), (True, "Not examined")]
)
def test_least_squares_narrows_nothing_that_was_assumed(
    has_flat_priors: bool, beginning: str
) -> None:
    """Flat priors assume nothing beforehand."""
    numbers: Any = SimpleNamespace(
        words=words_of("en"),
        are_unusable=False,
        parameters={},
        changes={},
        path={},
        unloaded_path={},
        findings=SimpleNamespace(probability_of_change=0.0, has_flat_priors=has_flat_priors),
    )
    (text,) = undetermined_texts(numbers)
    assert text.startswith(beginning)


def test_the_certificate_names_the_circle_whose_unit_is_in_doubt() -> None:
    campaign = simulated(plan())
    tests = [
        test.with_reading_um(1e-3 * np.asarray(test.reading_um)) if test.name == "f300" else test
        for test in campaign.tests
    ]
    first, _ = sheets(findings_of(replace(campaign, tests=tuple(tests))))
    assert "The readings of f300 span 0.0" in first.blocks[0].sentence


def test_the_certificate_ends_with_lines_to_sign(english: Sheets) -> None:
    first, _ = english
    signatures = first.blocks[-1]
    assert isinstance(signatures, Fields)
    assert signatures.tall
    assert [text for _, text in signatures.entries] == ["", ""]


def test_what_is_not_determined_stands_beside_the_traces(english: Sheets) -> None:
    first, _ = english
    (pair,) = [block for block in first.blocks if isinstance(block, Pair)]
    assert pair.picture.key == "traces"
    assert pair.beside


def test_what_a_campaign_does_not_state_is_a_line_to_write_on(english: Sheets) -> None:
    first, _ = english
    fields = next(block for block in first.blocks if isinstance(block, Fields))
    entries = dict(fields.entries)
    assert entries["Operator"] == ""


@pytest.mark.parametrize(
    ("language", "field", "entry"),
    [("en", "Feed, direction, order", "as listed"), ("de", "Vorschub, Richtung, Folge", "wie auf")],
)
def test_the_certificate_states_the_order_of_the_tests(
    language: str, field: str, entry: str, by_language: dict[str, Sheets]
) -> None:
    first, _ = by_language[language]
    fields = next(block for block in first.blocks if isinstance(block, Fields))
    assert entry in dict(fields.entries)[field]


def test_every_compliance_and_error_stands_on_sheet_2(english: Sheets) -> None:
    _, second = english
    (table,) = tables_of(second)
    symbols = {row[1] for row in table.rows}
    assert {"C_XXX", "C_YYY", "E_XX1", "E_YX2", "E_C(0Y)X"} <= symbols


@pytest.mark.parametrize("prob", [0.5, 0.68, 0.99])
def test_u_is_that_of_95_percent_whatever_the_intervals_in_brackets(
    findings: Findings, english: Sheets, prob: float
) -> None:
    """With half of the probability in brackets, U = 2 u is three times half their width."""
    first, second = sheets(replace(findings, prob=prob))
    (table,) = tables_of(second)
    assert f"{100 * prob:g} % interval" in table.heads
    of_95 = [tables_of(sheet)[0] for sheet in english]
    value, expanded = 2, 3
    for stated_table, table_of_95 in zip([tables_of(first)[0], table], of_95, strict=True):
        for row, other in zip(stated_table.rows, table_of_95.rows, strict=True):
            assert (row[value], row[expanded]) == (other[value], other[expanded])
    row = next(row for row in table.rows if row[1] == "E_XX1")
    draws = 1e6 * findings.posterior_of_certificate["posterior"]["E_XX1"].to_numpy()
    assert float(row[expanded]) == pytest.approx(2.0 * draws.std(), rel=0.05)
    ends = [float(end.replace("−", "-")) for end in row[4].strip("[]").split(", ")]
    expected_ends = np.quantile(draws, [0.5 - 0.5 * prob, 0.5 + 0.5 * prob])
    assert ends == pytest.approx(expected_ends, abs=0.1 * draws.std())


def test_the_force_at_which_stiffness_is_stated(findings: Findings) -> None:
    first, _ = sheets(findings, force_N=500.0)
    assert "500 N" in tables_of(first)[0].caption


def test_a_force_outside_the_tested_ones_is_a_reservation(findings: Findings) -> None:
    first, _ = sheets(findings, force_N=1000.0)
    banner = first.blocks[0]
    assert isinstance(banner, Banner)
    assert banner.kind == "reserved"
    assert "Stated at 1000 N, outside the tested forces" in banner.sentence


def test_a_tolerance_has_a_table_of_its_own() -> None:
    with_limit = findings_of(simulated(plan()), {"C_XXX": "60 nm/N"})
    first, _ = sheets(with_limit)
    _, conformity = tables_of(first)
    assert len(conformity.rows) == 1
    assert "≤ 60" in conformity.rows[0]


def test_terminal_and_certificate_state_the_same_value_of_a_tolerance() -> None:
    limits = {"C_XXX": "60 nm/N", "stiffness_X": "18 N/µm", "k_min": "9 N/µm", "k_ratio": "2"}
    findings = findings_of(simulated(plan()), tolerances=limits)
    first, _ = sheets(findings)
    _, on_certificate = tables_of(first)
    decisions = findings.conformity(389.0)
    printed = conformity_table({name: decision.as_dict() for name, decision in decisions.items()})
    for row, printed_row in zip(on_certificate.rows, printed.rows, strict=True):
        half_a_digit = 0.5 * 10.0 ** -len(row[1].partition(".")[2])
        assert float(row[1]) == pytest.approx(float(printed_row[1]), abs=half_a_digit)


def test_terminal_and_certificate_write_a_tolerance_alike() -> None:
    limits = {"C_XYX": "± 40 nm/N", "E_XX1": "-20..40 µm/m", "C_XXX": "60 nm/N"}
    findings = findings_of(simulated(plan()), tolerances=limits)
    first, _ = sheets(findings)
    _, on_certificate = tables_of(first)
    decisions = findings.conformity(389.0)
    printed = conformity_table({name: decision.as_dict() for name, decision in decisions.items()})
    written = sorted(row[2] for row in on_certificate.rows)
    assert written == sorted(["± 40", "−20 … 40", "≤ 60"])
    assert written == sorted(row[3] for row in printed.rows)


def test_without_a_tolerance_there_is_no_such_table(english: Sheets) -> None:
    first, _ = english
    assert len(tables_of(first)) == 1


@pytest.fixture(scope="module")
def varying() -> Findings:
    """Findings of a fit in which compliance changes with force, with a tolerance of a slope."""
    posterior = fitted(lb.HybridModel.first(1), simulated(plan()))
    tolerances = {"C_XXX_1": "10 nm/N per kN"}
    return findings_of_fit(
        posterior, comparison=NOT_COMPARED, recommended=NOT_COMPARED, tolerances=tolerances
    )


@pytest.fixture(scope="module")
def varying_by_language(varying: Findings) -> dict[str, Sheets]:
    return {language: sheets(varying, language=language) for language in LANGUAGES}


def texts_of(sheet: ReportSheet) -> str:
    texts = []
    for block in sheet.blocks:
        if isinstance(block, Table):
            texts.append(block.text(200))
        elif isinstance(block, Pair):
            texts += block.beside
    return "\n".join(texts)


@pytest.mark.parametrize("language", ["en", "de"])
def test_no_sheet_states_the_coefficient_of_a_change(
    varying_by_language: dict[str, Sheets], language: str
) -> None:
    first, second = varying_by_language[language]
    assert "C_XXX_1" not in texts_of(first)
    assert "C_XXX_1" not in texts_of(second)


@pytest.mark.parametrize(
    ("language", "words"),
    [
        ("en", "C_XXX: change from 36\u00a0N to 742\u00a0N"),
        ("de", "C_XXX: Änderung von 36\u00a0N bis 742\u00a0N"),
    ],
)
def test_sheet_2_states_the_change_over_the_tested_forces(
    varying: Findings, language: str, words: str, varying_by_language: dict[str, Sheets]
) -> None:
    _, second = varying_by_language[language]
    row = next(row for row in tables_of(second)[0].rows if row[1] == "ΔC_XXX")
    assert row[0] == words
    change = lb.analysis.change_with_force(varying.posterior)["C_XXX"].change
    assert float(row[2].replace(",", ".").replace("−", "-")) == pytest.approx(
        change.mean * 1e6, abs=change.sd * 1e6
    )


@pytest.mark.parametrize(
    ("language", "sentence"),
    [
        ("en", "Whether compliance changes linearly with force: probability that it does 60 %"),
        (
            "de",
            "Ob sich die Nachgiebigkeit linear mit der Kraft ändert: Wahrscheinlichkeit dafür 60 %",
        ),
    ],
)
def test_an_uncertain_change_with_force_is_stated_with_its_probability(
    language: str, sentence: str, varying: Findings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Findings, "probability_of_change", 0.6)
    numbers = SheetNumbers(varying, words_of(language), 36.0)
    assert sentence in [text.replace("\u00a0", " ") for text in undetermined_texts(numbers)]


def test_only_rough_weights_of_the_average_itself_are_a_reservation(varying: Findings) -> None:
    """Rough evidences of a comparison, which only the annex states, touch no number of a sheet."""
    comparison: Any = SimpleNamespace(within_tolerance=False, sign="the same")
    for converged in (True, False):
        averaged = varying.posterior.copy()
        record = record_of(averaged)
        record["sampler"]["converged"] = converged
        averaged["provenance"].attrs["json"] = json.dumps(record)
        findings = replace(varying, comparison=comparison, averaged=averaged)
        reasons = SheetNumbers(findings, words_of("en"), 36.0).judgement.reasons
        kinds = [reason.kind for reason in reasons]
        assert (ReasonKind.ROUGH_WEIGHTS in kinds) == (not converged)


@pytest.mark.parametrize(
    ("language", "cure"),
    [("en", "State the numbers of one model"), ("de", "Stattdessen die Zahlen eines Modells")],
)
def test_weights_that_are_not_exact_enough_come_with_a_cure(
    language: str, cure: str, varying: Findings, monkeypatch: pytest.MonkeyPatch
) -> None:
    rough = Judgement(Use.WITH_RESERVATION, (Reason(ReasonKind.ROUGH_WEIGHTS),))
    monkeypatch.setattr(SheetNumbers, "judgement", rough)
    assert banner(SheetNumbers(varying, words_of(language), 36.0)).cure.startswith(cure)


def test_a_reason_that_the_sentence_leaves_out_has_no_cure(
    varying: Findings, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The sentence has room for two reasons; "these circles" would be circles without a name."""
    kinds = (ReasonKind.UNIT, ReasonKind.BALLS, ReasonKind.HYPER)
    monkeypatch.setattr("ldbb_bayes.report.sheet_state._unit_texts", lambda *_: ["wrong unit"])
    judged = Judgement(Use.DO_NOT_USE, tuple(Reason(kind) for kind in kinds))
    monkeypatch.setattr(SheetNumbers, "judgement", judged)
    stated = banner(SheetNumbers(varying, words_of("en"), 36.0))
    assert "scatter more than expected" not in stated.sentence
    assert stated.cure == ""


def test_the_cure_is_that_of_the_first_stated_reason_that_has_one(
    varying: Findings, monkeypatch: pytest.MonkeyPatch
) -> None:
    kinds = (ReasonKind.BALLS, ReasonKind.TRUNCATION, ReasonKind.HYPER)
    judged = Judgement(Use.DO_NOT_USE, tuple(Reason(kind) for kind in kinds))
    monkeypatch.setattr(SheetNumbers, "judgement", judged)
    stated = banner(SheetNumbers(varying, words_of("en"), 36.0))
    assert stated.cure.startswith("Check sign, unit and forces of the readings")


def test_results_without_reservation_need_no_cure(
    varying: Findings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(SheetNumbers, "judgement", Judgement(Use.CAN_BE_USED))
    assert banner(SheetNumbers(varying, words_of("en"), 36.0)).cure == ""


@pytest.mark.parametrize("language", ["en", "de"])
def test_cures_are_of_reasons_whose_sentences_name_none(language: str) -> None:
    cures = set(words_of(language).table["cures"])
    reasons = {kind.value.replace("-", "_") for kind in ReasonKind}
    assert cures == reasons - {"unit", "balls"}


@pytest.mark.slow
def test_deviations_of_several_planes_name_their_plane(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SheetNumbers, "_partners_of_geometry", lambda self: ("BallForm",))
    findings = findings_of_fit(awkward("three planes"), sheets_only=True)
    numbers = SheetNumbers(findings, words_of("en"), 400.0)
    (listed,) = [text for text in undetermined_texts(numbers) if text.startswith("G (XY)")]
    for plane in ("XY", "YZ", "ZX"):
        assert f"F_max ({plane})" in listed


def test_a_tolerance_of_a_slope_is_decided_on(varying_by_language: dict[str, Sheets]) -> None:
    first, _ = varying_by_language["en"]
    _, conformity = tables_of(first)
    (row,) = conformity.rows
    assert row[0] == "C_XXX: coefficient of the change with force"
    assert row[-1] in ("conforms", "does not conform", "not decided")


def test_numbers_are_those_of_the_language(by_language: dict[str, Sheets]) -> None:
    english, german = (tables_of(by_language[code][1])[0] for code in LANGUAGES)
    values = [row[2] for row in english.rows]
    assert any("." in value for value in values)
    assert [row[2] for row in german.rows] == [value.replace(".", ",") for value in values]


@pytest.mark.slow
def test_a_long_name_is_shortened() -> None:
    named = lb.Campaign(simulated(plan()).tests, name="M" * 300)
    first, _ = sheets(findings_of(named))
    assert f"{'M' * 69}…" in first.line
    assert "M" * 70 not in first.line


def test_a_language_without_words_is_refused(findings: Findings) -> None:
    refuses("language", sheets, findings, language="xx")


# ---- stiffness by direction, and the path beside what the circles showed


def row_of(sheet: ReportSheet, symbol: str) -> tuple[str, ...]:
    return next(row for row in tables_of(sheet)[0].rows if row[1] == symbol)


@pytest.mark.parametrize(
    ("language", "words", "where"),
    [
        ("en", "Least stiffness in the plane", "from X ("),
        ("de", "Kleinste Steifigkeit in der Ebene", "zu X ("),
    ],
)
def test_the_certificate_states_the_least_stiffness_and_its_direction(
    by_language: dict[str, Sheets], language: str, words: str, where: str
) -> None:
    first, _ = by_language[language]
    row = row_of(first, "k_min")
    assert row[0] == words
    assert where in row[-1]


def test_the_least_stiffness_is_that_of_the_analysis(findings: Findings, english: Sheets) -> None:
    first, _ = english
    stiffness = lb.stiffness(findings.posterior, [389.0]).planes[0].least
    value = float(row_of(first, "k_min")[2])
    assert value == pytest.approx(stiffness.median / 1e3, abs=stiffness.sd / 1e3 / 5.0)


@pytest.mark.parametrize("symbol", ["k_max", "k_max / k_min", "ψ", "C_XXX − C_YYY"])
def test_the_certificate_states_what_is_best_determined(english: Sheets, symbol: str) -> None:
    first, _ = english
    assert row_of(first, symbol)[3] not in ("", "–")


def test_a_direction_that_is_not_determined_is_not_stated() -> None:
    direction = AxialDirection(40.0, 52.0, 104.0, -45.0, 125.0, 0.95, 0.0, is_determined=False)
    words = words_of("en")
    assert stiffness_numbers._direction_words(direction, "X", words) == "direction not determined"


def test_a_direction_beyond_90_degrees_is_that_of_its_opposite() -> None:
    direction = AxialDirection(178.0, 2.0, 4.0, 174.0, 182.0, 0.95, 1.0, is_determined=True)
    words = words_of("en")
    text = stiffness_numbers._direction_words(direction, "X", words)
    assert text == "at −2.0° ± 4.0° from X (k = 2)"


def test_a_skewed_direction_has_the_distances_to_the_ends_of_its_interval() -> None:
    direction = AxialDirection(3.0, 32.0, 64.0, 1.0, 88.0, 0.85, 0.9, is_determined=True)
    turned = replace(direction, angle_deg=178.0, ci_low_deg=92.0, ci_high_deg=179.0)
    texts = []
    for language in ("en", "de"):
        for stated in (direction, turned):
            words = words_of(language)
            texts.append(stiffness_numbers._direction_words(stated, "X", words))
    assert texts == [
        "at 3° from X (+85 / −2)°",
        "at −2° from X (+1 / −86)°",
        "bei 3° zu X (+85 / −2)°",
        "bei −2° zu X (+1 / −86)°",
    ]


def test_beside_g_stands_what_the_circle_showed(findings: Findings, english: Sheets) -> None:
    first, _ = english
    measured, _ = lb.analysis.measure_circularity(findings.posterior)
    g_um = measured.set_index("force_N").loc[300.0, "G"]
    assert f"measured at 300\u00a0N, with the balls' form: {g_um:.1f}" in row_of(first, "G")[-1]


def numbers_of_circles(radii_mm: tuple[float, ...], centres_x_mm: tuple[float, ...]) -> Findings:
    """A fit of one plane with circles of several radii, or about several centres."""
    tests = []
    for test, radius_mm, x_mm in zip(plan().tests, radii_mm, centres_x_mm, strict=True):
        setup = 1 + int(x_mm != 0.0)
        tests.append(replace(test, radius_mm=radius_mm, centre_x_mm=x_mm, setup=setup))
    return findings_of(simulated(replace(plan(), tests=tuple(tests))))


@pytest.mark.parametrize(("language", "about"), [("en", "about"), ("de", "um")])
def test_numbers_of_one_of_several_circles_name_it(language: str, about: str) -> None:
    words = words_of(language)
    radii = SheetNumbers(numbers_of_circles((112.5, 150.0) * 2, (0.0,) * 4), words, 300.0)
    centres = SheetNumbers(numbers_of_circles((150.0,) * 4, (-80.0, 0.0) * 2), words, 300.0)
    radius = words.number("112.5")
    assert radii.path["G"].words.endswith(f", R\u00a0= {radius}\u00a0mm")
    assert radii.directions["k_min"].words.endswith(f", R\u00a0= {radius}\u00a0mm")
    sentences = plain_findings.plain_words(radii).items[:2]
    assert all(f"XY, R\u00a0= {radius}\u00a0mm" in sentence for sentence in sentences)
    at_centre = f", R\u00a0= 150\u00a0mm {about} (−80, 0, 0)\u00a0mm"
    assert centres.path["G"].words.endswith(at_centre)


def test_numbers_of_the_only_circle_do_not_name_it(findings: Findings) -> None:
    numbers = SheetNumbers(findings, EN, 300.0)
    assert numbers.path["G"].words == "Circular deviation G"
    assert numbers.directions["k_min"].words == "Least stiffness in the plane"


def test_beside_g_stands_what_a_circle_of_the_same_radius_showed() -> None:
    findings = numbers_of_circles((100.0, 150.0) * 2, (0.0,) * 4)
    measured, _ = lb.analysis.measure_circularity(findings.posterior)
    g_um = measured.set_index("force_N").loc[520.0, "G"]
    note = SheetNumbers(findings, EN, 300.0).path["G"].note
    assert note == f"measured at 520\u00a0N, with the balls' form: {g_um:.1f}"


def test_beside_g_stands_that_an_arc_showed_a_part_of_the_circle() -> None:
    """On 200° about the top, sin 2θ has a smaller width than on the whole circle."""
    findings = findings_of(simulated(plan(arc_deg=200.0)))
    measured, _ = lb.analysis.measure_circularity(findings.posterior)
    g_um = measured.set_index("force_N").loc[300.0, "G"]
    notes = []
    for language in ("en", "de"):
        note = SheetNumbers(findings, words_of(language), 300.0).path["G"].note
        notes.append(note.replace("\u00a0", " "))
    assert notes == [
        f"measured at 300 N on an arc of 200° alone, with the balls' form: {g_um:.1f}",
        f"gemessen bei 300 N nur auf einem Bogen von 200°, mit Kugelform: {g_um:.1f}".replace(
            f"{g_um:.1f}", f"{g_um:.1f}".replace(".", ",")
        ),
    ]


def test_sheet_2_states_the_form_that_is_assumed_of_a_ball() -> None:
    """U = 2 √mean(τ²/2 (n/6)^(−2p) + S²/24) of the posterior draws of τ and p, S = 2.5 µm."""
    findings = findings_of_fit(
        fitted(lb.HybridModel.default(0), simulated(plan())), sheets_only=True
    )
    draws = findings.posterior["posterior"].dataset
    texts = []
    for order in (2, 3):
        relative = (order / 6.0) ** -draws["decay"].values
        variance_um2 = (1e3 * draws["tau"].values * relative) ** 2 / 2.0 + 2.5**2 / 24.0
        texts.append(f"{order} waves ± {two_digits(2.0 * np.sqrt(np.mean(variance_um2)))} µm")
    fields = dict(assumption_fields(SheetNumbers(findings, words_of("en"), 389.0)))
    expected = f"{', '.join(texts)}: sphericity 2.5 µm and what higher orders suggest (assumed)"
    assert fields["Form of the work ball"] == expected


def test_g_without_load_stands_on_the_certificate(english: Sheets) -> None:
    first, _ = english
    titles = [row[0] for row in tables_of(first)[0].rows]
    assert "Circular deviation without load" in titles


def test_radial_deviations_from_the_nominal_circle_stand_on_sheet_2(english: Sheets) -> None:
    _, second = english
    titles = [row[0] for row in tables_of(second)[0].rows]
    assert "Largest radial deviation from the nominal circle" in titles


def test_the_rose_stands_on_sheet_2(english: Sheets) -> None:
    _, second = english
    (row,) = [block for block in second.blocks if isinstance(block, PictureRow)]
    assert [picture.key for picture in row.pictures] == [
        "stiffness_rose",
        "compliance_against_force",
    ]


def test_a_tolerance_of_the_least_stiffness_is_decided_on() -> None:
    with_limit = findings_of(simulated(plan()), {"k_min": "10 N/um"})
    first, _ = sheets(with_limit)
    (row,) = tables_of(first)[1].rows
    assert row[0] == "Least stiffness in the plane"
    assert row[2] == "≥ 10"
    assert row[-1] == "conforms"


def judged(verdict: str, *partners: str) -> Any:
    """A verdict on a parameter that the mount limits, or that is confounded with these effects."""
    held_by = VarianceSource("Mount", Origin.ASSUMED, 0.39)
    return SimpleNamespace(
        verdict=verdict,
        held_by=held_by,
        partners=partners,
        partner_shares=dict.fromkeys(partners, 0.3),
        contraction=0.5,
    )


@pytest.mark.parametrize(
    ("language", "entry", "text"),
    [
        ("en", judged("identified"), "identified, limited by mount (39 %, assumed)"),
        ("de", judged("identified"), "bestimmt, begrenzt durch Aufnahme (39 %, angenommen)"),
        (
            "en",
            judged("confounded", "Mount", "Drift"),
            "confounded with mount (30 %) and drift (30 %)",
        ),
        (
            "de",
            judged("confounded", "Mount", "Drift"),
            "vermengt mit Aufnahme (30 %) und Drift (30 %)",
        ),
        ("en", judged("prior-limited"), "prior-limited: mostly what was assumed before"),
        (
            "de",
            judged("prior-limited"),
            "durch Vorwissen begrenzt: U ist überwiegend das vorher Angenommene",
        ),
    ],
)
def test_verdicts_on_sheets(language: str, entry: Any, text: str) -> None:
    quantity = StatedQuantity("Compliance", "C_XXX", 1.0, 0.1, (0.8, 1.2), "mm/N", entry)
    assert remark(quantity, words_of(language)) == text


@pytest.mark.parametrize(
    ("language", "text"),
    [
        ("en", "may be zero: read it as 0 to 0.27 (95 %); confounded with mount (30 %)"),
        ("de", "kann null sein: als 0 bis 0,27 (95 %) lesen; vermengt mit Aufnahme (30 %)"),
    ],
)
def test_a_compliance_that_may_be_zero_has_its_upper_limit_in_its_row(
    language: str, text: str
) -> None:
    quantity = StatedQuantity(
        "Compliance",
        "C_CCY",
        1.1e-10,
        8e-11,
        (5e-12, 3.1e-10),
        "rad/(N mm)",
        judged("confounded", "Mount"),
        limit_near_zero=2.7e-10,
    )
    assert remark(quantity, words_of(language)).replace("\u00a0", " ") == text


def test_the_upper_limits_of_sheet_2_are_those_of_the_fit(recovered: lb.Campaign) -> None:
    findings = findings_of(recovered)
    numbers = SheetNumbers(findings, words_of("en"), findings.result["model"]["reference_force_N"])
    stated = {}
    for name, quantity in numbers.parameters.items():
        if quantity.limit_near_zero is not None:
            stated[name] = quantity.limit_near_zero
    noted = {}
    for concern in fit_of(findings.posterior).concerns:
        if concern.kind == ConcernKind.NEAR_ZERO:
            noted[concern.name] = concern.limit
    assert stated == noted
    assert stated


@pytest.mark.parametrize(
    ("language", "direction", "no_change", "text"),
    [
        ("en", "increases", 0.0, "increases with force; confounded with joint load (30 %)"),
        ("en", "no_change", 0.0, "no change shown"),
        (
            "en",
            "no_change",
            0.9,
            "no change shown (exactly none: 90 %)",
        ),
        (
            "de",
            "no_change",
            0.9,
            "keine Änderung nachgewiesen (genau keine: 90 %)",
        ),
    ],
)
def test_changes_on_sheets(language: str, direction: Any, no_change: float, text: str) -> None:
    """The sheet states the direction of a change, and beside it the verdict on its uncertainty;
    beside "no change shown" a verdict such as "identified" would seem to contradict it."""
    quantity = StatedQuantity(
        "Change",
        "ΔC_XXX",
        1.0,
        1.0,
        (-1.0, 3.0),
        "mm/N",
        direction=direction,
        change_entry=judged("confounded", "JointLoad"),
        no_change=no_change,
    )
    assert remark(quantity, words_of(language)) == text


@pytest.mark.parametrize(
    ("language", "if_any", "text"),
    [
        (
            "en",
            (-3.14e-6, 4.16e-6),
            "no change shown (exactly none: > 99 %; if any, −3.1 to 4.2 nm/N)",
        ),
        (
            "de",
            (-3.14e-6, 4.16e-6),
            "keine Änderung nachgewiesen (genau keine: > 99 %; falls doch, −3,1 bis 4,2 nm/N)",
        ),
        ("en", None, "no change shown (exactly none: > 99 %)"),
    ],
)
def test_a_change_whose_interval_is_zero_on_sheets(language: str, if_any: Any, text: str) -> None:
    """It has no U; the table referred to an interval that was [0.00, 0.00]."""
    quantity = StatedQuantity(
        "Change",
        "ΔC_XXX",
        1e-9,
        2e-7,
        (0.0, 0.0),
        "mm/N",
        direction="no_change",
        no_change=0.995,
        if_any=if_any,
    )
    words = words_of(language)
    assert remark(quantity, words).replace("\u00a0", " ") == text
    numbers: Any = SimpleNamespace(words=words, findings=SimpleNamespace(prob=0.95))
    (row,) = _table_with_intervals(numbers, [quantity], [quantity]).rows
    assert row[2:5] == ("0", "–", "–")
    of_80 = replace(quantity, no_change=0.94)
    of_95 = replace(of_80, interval=(-4e-7, 3e-7))
    (row,) = _table_with_intervals(numbers, [of_95], [of_80]).rows
    assert row[3] != "–"
    assert row[4] == "–"
    (row,) = _table_with_intervals(numbers, [of_80], [of_95]).rows
    assert row[2:4] == ("0", "–")
    assert row[4] == words.number(words("interval", low="−0.40", high="0.30"))


def test_a_change_that_is_almost_certainly_none_has_no_one_sided_interval_on_sheets() -> None:
    """The sheet stated [0.00, 0.91] nm/N with U +0.85 / −0.06, of 4 % of the draws."""
    quantity = StatedQuantity(
        "Change",
        "ΔC_XXX",
        0.06e-6,
        0.91e-6,
        (0.0, 0.91e-6),
        "mm/N",
        direction="no_change",
        no_change=0.958,
        if_any=(-6.3e-6, 7.6e-6),
    )
    words = words_of("en")
    numbers: Any = SimpleNamespace(words=words, findings=SimpleNamespace(prob=0.95))
    (row,) = _table_with_intervals(numbers, [quantity], [quantity]).rows
    assert row[2:5] == ("0", "–", "–")
    text = "no change shown (exactly none: 96 %; if any, −6.3 to 7.6 nm/N)"
    assert remark(quantity, words).replace("\u00a0", " ") == text


@pytest.mark.parametrize("language", ["en", "de"])
def test_a_value_outside_its_interval_has_no_english_words_in_place_of_U(language: str) -> None:
    """A few draws far below zero drag the mean out of an interval that ends at zero."""
    words = words_of(language)
    quantity = StatedQuantity("Change", "ΔC_CCY", -1e-12, 13e-12, (0.0, 9e-12), "rad/(N mm)")
    numbers: Any = SimpleNamespace(words=words, findings=SimpleNamespace(prob=0.95))
    (row,) = _table_with_intervals(numbers, [quantity], [quantity]).rows
    assert row[3] == "–"
    assert row[4] == words.number(words("interval", low="0.000", high="0.009"))


@pytest.mark.parametrize("language", ["en", "de"])
def test_every_origin_has_its_words(language: str) -> None:
    assert set(words_of(language).table["origins"]) == set(map(str, Origin))


@pytest.mark.parametrize("term", sorted(words_of("en").table["terms"]))
def test_sheets_and_terminal_name_an_effect_alike(term: str) -> None:
    expected = {"Parameters": "its prior"}.get(term, wording.term_words(term))
    assert words_of("en").term(term) == expected


@pytest.mark.parametrize("entry", [judged("identified"), judged("confounded", "Mount", "Drift")])
def test_sheets_and_terminal_state_a_verdict_alike(entry: Any) -> None:
    quantity = StatedQuantity("Compliance", "C_XXX", 1.0, 0.1, (0.8, 1.2), "mm/N", entry)
    stated = remark(quantity, words_of("en")).replace("\u00a0", " ")
    assert stated == wording.verdict_words(entry).replace("\u00a0", " ")


# ---- both sheets stand alone


def test_a_stiffness_away_from_the_machines_zero_says_where_it_is() -> None:
    """Tilts of Y act with the distance from zero; the X of this machine does not tilt."""
    planned = plan()
    tests = tuple(replace(test, centre_x_mm=500.0) for test in planned.tests)
    numbers = SheetNumbers(findings_of(simulated(replace(planned, tests=tests))), EN, 389.0)
    remarks = {name: remark(stated, EN) for name, stated in numbers.stiffnesses.items()}
    assert remarks["C_YYY"].startswith(
        "where no tilt of Y acts: at the machine's zero, up to 500 mm from the circles' centres; "
    )
    assert "zero" not in remarks["C_XXX"]


def test_a_stiffness_at_the_centre_of_all_circles_has_no_remark_on_its_place(
    findings: Findings,
) -> None:
    numbers = SheetNumbers(findings, EN, 389.0)
    assert not any(stated.note for stated in numbers.stiffnesses.values())


@pytest.mark.parametrize(
    ("model", "contains_balls"),
    [(lb.HybridModel.first(0), False), (lb.HybridModel.paper(0), True)],
)
def test_a_circle_contains_the_balls_where_the_model_has_no_form_of_them(
    model: lb.HybridModel, contains_balls: bool
) -> None:
    posterior = fitted(model, simulated(plan()))
    findings = findings_of_fit(posterior, comparison=NOT_COMPARED, recommended=NOT_COMPARED)
    sentences = list(plain_findings._sentences_under_load(SheetNumbers(findings, EN, 389.0)))
    _, of_path = sentences
    assert ("so that G contains it" in of_path) == contains_balls
    assert ("without the form of the balls" in of_path) != contains_balls
    section = str(next(sections.path(findings)))
    assert ("so that G contains it" in section) == contains_balls


@pytest.mark.parametrize("number", [0, 1])
def test_both_sheets_have_lines_to_sign(english: Sheets, number: int) -> None:
    last = english[number].blocks[-1]
    assert isinstance(last, Fields)
    assert last.tall


@pytest.mark.parametrize("number", [0, 1])
def test_both_sheets_name_machine_serial_number_and_date(english: Sheets, number: int) -> None:
    fields = next(block for block in english[number].blocks if isinstance(block, Fields))
    names = {name for name, _ in fields.entries}
    assert {"Machine (maker, type)", "Serial number", "Date of the tests", "Axes"} <= names


@pytest.mark.parametrize(
    ("language", "planes", "text"),
    [
        ("en", ["XY", "XY"], "wCAFYXZSt, plane XY"),
        ("en", ["XY", "ZX", "YZ", "ZX"], "wCAFYXZSt, planes XY, YZ and ZX"),
        ("de", ["ZX", "XY"], "wCAFYXZSt, Ebenen XY und ZX"),
    ],
)
def test_the_planes_of_a_campaign(language: str, planes: list[str], text: str) -> None:
    """Tests run in a random order; the sheet said "plane XY, ZX and YZ"."""
    tests = [SimpleNamespace(plane=plane) for plane in planes]
    campaign: Any = SimpleNamespace(topology="wCAFYXZSt", tests=tests)
    assert _machine_text(campaign, words_of(language)) == text


@pytest.fixture(scope="module")
def rests_on(findings: Findings) -> dict[str, str]:
    """What the numbers rest on, by name."""
    numbers = SheetNumbers(findings, words_of("en"), 389.0)
    return dict(assumption_fields(numbers))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("Axes", "wCAFYXZSt, plane XY (assumed)"),
        ("Readings, work ball's mount", "compensated for 2.33 µm/bar (assumed)"),
        ("Force of a pressure P", "126.04 N/bar · P − 14.2 N (assumed)"),
        ("Bar length", "U = 19 µm (assumed)"),
    ],
)
def test_what_decides_a_number_is_marked(rests_on: dict[str, str], name: str, text: str) -> None:
    assert rests_on[name] == text


@pytest.mark.parametrize(
    ("deflection_um_per_bar", "mount_u", "text"),
    [
        (2.33, None, "not compensated: 2.33 µm/bar subtracted (assumed)"),
        (2.33, 2.0, "not compensated: 2.33 µm/bar subtracted (stated)"),
        (2.52, None, "not compensated: 2.52 µm/bar subtracted (stated)"),
    ],
)
def test_a_deflection_that_is_subtracted_is_stated_or_assumed(
    deflection_um_per_bar: float, mount_u: float | None, text: str
) -> None:
    """That the readings are not compensated does not state how large the deflection is."""
    mount = lb.campaign.MountCompensation(
        compensated=False, deflection_um_per_bar=deflection_um_per_bar
    )
    instrument = lb.Instrument(mount_U_percent=mount_u)
    measured = simulated(plan(compensated=False))
    campaign = replace(measured, name=text, mount=mount, instrument=instrument)
    numbers = SheetNumbers(findings_of(campaign), words_of("en"), 389.0)
    assert dict(assumption_fields(numbers))["Readings, work ball's mount"] == text


def test_what_the_user_states_of_effects_and_priors_is_marked_as_in_verdicts() -> None:
    """Bar length and joint load by their terms, squareness by its prior: no certificate is stated,
    and none of them is the package's own."""
    model = lb.HybridModel.default(1).with_prior(E_C0YX=(0, "10 µrad"))
    model = model.with_term(lb.terms.BarLength(sd_um=3.0), lb.terms.JointLoad(relative_sd=0.3))
    findings = findings_of_fit(fitted(model, simulated(plan())), sheets_only=True)
    numbers = SheetNumbers(findings, words_of("en"), 389.0)
    fields = dict(assumption_fields(numbers))
    assert fields["Bar length"] == "U = 6.0 µm (stated)"
    assert fields["Deflection of the mount"] == "U = 20 % (assumed)"
    assert re.fullmatch(r"up to ±\s[\d.]+\snm/N \(stated\)", fields["Joint load"])
    stated, assumed = fields["Machine, before the test"].split(" (stated); ")
    assert stated == "E_C(0Y)X ±\u00a020\u00a0µrad"
    assert assumed.startswith("ΔC_")
    assert assumed.endswith(" (assumed)")


def test_a_force_law_that_no_test_needs_is_left_out() -> None:
    """Every test states its force, as a load cell measured it, and its pressure."""
    planned = plan()
    measured = tuple(replace(test, force_N=0.99 * float(test.force_N)) for test in planned.tests)
    campaign = simulated(replace(planned, tests=measured))
    fields = dict(assumption_fields(SheetNumbers(findings_of(campaign), EN, 389.0)))
    assert "Force of a pressure P" not in fields
    assert "Readings, work ball's mount" in fields


def test_a_force_law_that_one_test_needs_is_stated() -> None:
    """Three tests state force and pressure, the last one its force alone."""
    planned = plan()
    *first, last = planned.tests
    measured = [replace(test, force_N=0.99 * float(test.force_N)) for test in first]
    campaign = simulated(replace(planned, tests=(*measured, last)))
    fields = dict(assumption_fields(SheetNumbers(findings_of(campaign), EN, 389.0)))
    assert "Force of a pressure P" in fields


def test_what_a_compliance_contains_is_said(english: Sheets) -> None:
    _, second = english
    notes = [block for block in second.blocks if isinstance(block, str)]
    assert any("C_XXX for C_XXX + C_XXY" in note for note in notes)


def test_sheet_2_states_U_and_not_u(english: Sheets) -> None:
    _, second = english
    heads = tables_of(second)[0].heads
    assert "U (k = 2), +a/−b" in heads
    assert "u" not in heads


# ---- sheet 1 in plain words


def plain_of(sheet: ReportSheet) -> Items:
    return next(block for block in sheet.blocks if isinstance(block, Items))


def test_plain_words_follow_the_fields(english: Sheets) -> None:
    first, _ = english
    assert [type(block).__name__ for block in first.blocks[:3]] == ["Banner", "Fields", "Items"]


def test_plain_words_say_where_the_machine_yields_most(english: Sheets) -> None:
    first, _ = english
    stiffness = row_of(first, "k_min")
    sentence = plain_of(first).items[0]
    assert f"stiffness of {stiffness[2]} ± {stiffness[3]} N/µm" in sentence


@pytest.mark.parametrize(
    ("language", "text"),
    [
        ("en", "in a direction that the readings do not determine"),
        ("de", "in einer Richtung, die die Messwerte nicht bestimmen"),
    ],
)
def test_a_sentence_says_that_the_readings_do_not_determine_the_direction(
    language: str, text: str
) -> None:
    direction = AxialDirection(40.0, 52.0, 104.0, -45.0, 125.0, 0.95, 0.0, is_determined=False)
    words = words_of(language)
    assert stiffness_numbers._direction_in_sentence(direction, "X", words) == text


def test_plain_words_name_the_softer_axis_with_its_probability(findings: Findings) -> None:
    numbers = SheetNumbers(findings, words_of("en"), 389.0)
    (soft,) = [finding for finding in findings_of_sheet(numbers) if finding.kind == "soft-axis"]
    assert soft.values["softer"] == "X"  # the truth: 55 against 42 nm/N
    assert soft.probability > 0.95


def test_one_axis_is_named_to_begin_with_where_planes_share_an_axis() -> None:
    """Y is stiffer than X, and softer than Z: begin with X."""
    findings = []
    for softer, stiffer in (("X", "Y"), ("Y", "Z")):
        values = {"softer": softer, "stiffer": stiffer}
        findings.append(Finding(FindingKind.SOFT_AXIS, 0.99, values))
    findings.append(Finding(FindingKind.SQUARENESS, 0.99, {"name": "Squareness"}))
    softest = plain_findings._without_stiffer_axes(findings)
    assert softest == [findings[0], findings[2]]


@pytest.mark.parametrize(
    ("language", "text"),
    [
        ("en", "+a / −b: distances to the ends of the 50 % interval, where ± U does not"),
        ("de", "+a / −b: Abstände zu den Enden des 50-%-Intervalls, wo ± U es nicht"),
    ],
)
def test_what_is_stated_by_its_interval_is_not_called_skewed(language: str, text: str) -> None:
    """A normal distribution, too, is stated by its interval of 50 %: ± U is much wider."""
    half_width = 0.6745
    quantity = StatedQuantity("C", "C_XXX", 10.0, 1.0, (10.0 - half_width, 10.0 + half_width), "um")
    assert quantity.value_and_U().expanded == "+0.7 / −0.7"
    assert text in words_of(language)("notes.U", percent="50").replace("\u00a0", " ")


@pytest.mark.parametrize(
    ("probability", "text"), [(0.9496, "94.9 %"), (0.94, "94 %"), (0.9451, "94.5 %")]
)
def test_a_probability_below_a_limit_is_not_rounded_to_it(probability: float, text: str) -> None:
    percentage = words_of("en").percent(probability, below=0.95)
    assert percentage.replace("\u00a0", " ") == text


def test_confounded_errors_are_listed_although_the_readings_narrow_them(
    findings: Findings, monkeypatch: pytest.MonkeyPatch
) -> None:
    numbers = SheetNumbers(findings, words_of("en"), 389.0)
    narrowed = replace(undetermined("BarLength"), is_undetermined=False, symbol="E_XX1")
    compliance = replace(narrowed, symbol="C_CCY")
    parameters = {"E_XX1": narrowed, "C_CCY": compliance}
    monkeypatch.setattr(SheetNumbers, "parameters", parameters)
    listed = [text for text in undetermined_texts(numbers) if "confounded, sheet 2" in text]
    assert len(listed) == 1
    assert listed[0].startswith("E_XX1: ")


def test_no_more_than_three_findings(findings: Findings) -> None:
    numbers = SheetNumbers(findings, words_of("en"), 389.0)
    likely = findings_of_sheet(numbers)
    assert len(likely) <= 3
    assert all(finding.probability >= 0.95 for finding in likely)


@pytest.mark.parametrize(
    ("language", "sentence"),
    [
        ("en", "two waves around the circle and does not grow with force is {} ± {} µm"),
        (
            "de",
            "zwei Wellen um den Kreis hat und nicht mit der Kraft wächst, beträgt {} ± {} µm",
        ),
    ],
)
def test_what_both_directions_show_is_said_to_be_a_part_of_their_difference(
    language: str, sentence: str
) -> None:
    """A constant and other waves differ as well."""
    base = simulated(plan())
    tests = []
    for test in base.tests:
        half_um = 2.0 * np.sin(2.0 * test.angles_rad()) + 5.0
        for direction, sign in (("CW", 1.0), ("CCW", -1.0)):
            turned = test.with_reading_um(np.asarray(test.reading_um) + sign * half_um)
            tests.append(replace(turned, direction=direction, name=f"{test.name} {direction}"))
    # Not the same noise in both directions.
    tests[0] = tests[0].with_reading_um(np.asarray(tests[0].reading_um) + 0.1)
    campaign = replace(base, tests=tuple(tests))
    findings = findings_of_fit(fitted(lb.HybridModel.default(0), campaign), sheets_only=True)
    numbers = SheetNumbers(findings, words_of(language), 389.0)
    coefficient = numbers.reversal_coefficients["XY"]
    texts = value_and_uncertainty(2e3 * coefficient["mean"], 4e3 * coefficient["sd"])
    sentences = " ".join(plain_findings.plain_words(numbers).items)
    assert 2e3 * coefficient["mean"] == pytest.approx(4.0, abs=0.2)
    assert sentence.format(*map(numbers.words.number, texts)) in sentences


def test_one_direction_cannot_show_backlash(english: Sheets) -> None:
    first, _ = english
    assert any(
        "Backlash and servo mismatch were not tested" in item for item in plain_of(first).items
    )


@pytest.mark.parametrize(
    ("language", "sentence"),
    [
        ("en", "Of the tests f036, again, f300 and f300b, each holds the same readings as another"),
        ("de", "Von den Messungen f036, again, f300 und f300b hat jede dieselben Messwerte wie"),
    ],
)
def test_the_box_names_circles_that_were_read_twice(language: str, sentence: str) -> None:
    """Nothing in the fit shows it, and U is too small."""
    campaign = simulated(plan())
    again = replace(campaign.tests[0], name="again")
    other = replace(campaign.tests[1], name="f300b")
    findings = findings_of(replace(campaign, tests=(*campaign.tests, again, other)))
    banner = sheets(findings, language=language)[0].blocks[0]
    assert isinstance(banner, Banner)
    assert sentence in banner.sentence


@pytest.mark.parametrize(
    ("language", "sentence"),
    [
        ("en", "he readings of f400 seem to have the opposite sign"),
        ("de", "ie Messwerte (f400) haben anscheinend das falsche Vorzeichen"),
    ],
)
def test_the_box_names_a_circle_with_the_other_sign(language: str, sentence: str) -> None:
    angle_deg = np.arange(0.0, 360.0, 10.0)
    wave_um = np.cos(np.deg2rad(2.0 * angle_deg))
    tests = []
    for number, sign in enumerate((1.0, 1.0, 1.0, -1.0, 1.0), 1):
        reading_um = sign * (4.0 * number + 0.1 * wave_um)
        name = f"f{number}00"
        tests.append(lb.CircularTest(100.0 * number, angle_deg, reading_um=reading_um, name=name))
    findings = findings_of(lb.Campaign(tuple(tests)))
    banner = sheets(findings, language=language)[0].blocks[0]
    assert isinstance(banner, Banner)
    assert banner.kind != "usable"
    assert sentence in banner.sentence


def test_directions_that_are_not_stated_are_not_taken_for_one() -> None:
    base = simulated(plan())
    one_way = replace(base, tests=tuple(replace(test, direction="CCW") for test in base.tests))
    for campaign, sentence, field in (
        (base, "no circle states its direction", "direction not stated"),
        (one_way, "the circles were run in one direction", "counterclockwise"),
    ):
        first, _ = sheets(findings_of(campaign))
        assert any(sentence in item for item in plain_of(first).items)
        (fields, *_) = [block for block in first.blocks if isinstance(block, Fields)]
        assert field in dict(fields.entries)["Feed, direction, order"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("directions", "without", "sentence"),
    [
        ({"XY": ("CW",), "YZ": ("CCW",), "ZX": ("CW",)}, (), "of no plane are circles in both"),
        ({"XY": ("CW",), "YZ": ("CW",), "ZX": (None,)}, (), "of no plane are circles in both"),
        ({"XY": ("CW", "CCW")}, ("hysteresis",), "the model has no hysteresis"),
    ],
)
def test_circles_of_several_directions_are_not_said_to_have_one(
    directions: dict[str, tuple[str | None, ...]], without: tuple[str, ...], sentence: str
) -> None:
    planned = plan() if len(directions) == 1 else plan_of_three_planes()
    tests = []
    for k, test in enumerate(planned.tests):
        of_plane = directions[test.plane]
        tests.append(replace(test, direction=of_plane[k % len(of_plane)]))
    campaign = simulated(replace(planned, tests=tuple(tests)))
    model = lb.HybridModel.default(1).without(*without)
    findings = findings_of_fit(fitted(model, campaign), sheets_only=True)
    plain = plain_findings.plain_words(SheetNumbers(findings, words_of("en"), 389.0))
    assert any(sentence in item for item in plain.items)


@pytest.mark.parametrize(
    ("language", "sentence"),
    [("en", "Circle t2 scatters"), ("de", "Kreis t2 streut")],
)
def test_an_odd_circle_is_named_in_plain_words(language: str, sentence: str) -> None:
    """Two waves of 12 µm and three of 8 µm, of one circle alone; of like circles none is odd."""
    campaign = simulated(plan())
    odd = list(campaign.tests)
    theta = np.radians(odd[2].angle_deg)
    deviation_um = 12.0 * np.cos(2.0 * theta) + 8.0 * np.sin(3.0 * theta)
    odd[2] = replace(odd[2], name="t2", reading_um=odd[2].reading_um + deviation_um)
    model = lb.HybridModel.default(0)
    for tests, named in ((tuple(odd), True), (campaign.tests, False)):
        fit = fitted(model, replace(campaign, tests=tests))
        numbers = SheetNumbers(findings_of_fit(fit, sheets_only=True), words_of(language), 389.0)
        items = plain_findings.plain_words(numbers).items
        assert any(sentence in item for item in items) is named


def undetermined(*partners: str) -> StatedQuantity:
    """A quantity that the readings do not determine, confounded with these effects."""
    entry = judged("confounded", *partners)
    return StatedQuantity("Q", "Q", 1.0, 1.0, (-1.0, 3.0), "mm", entry, is_undetermined=True)


def with_squareness(error: StatedQuantity) -> Any:
    """Numbers of a sheet with one squareness error."""
    return SimpleNamespace(
        words=words_of("en"),
        squareness_errors={"E": error},
        angle_of_squareness="angle of {}".format,
    )


@pytest.mark.parametrize("estimate", [5e-5, -5e-5])
def test_the_angle_named_on_sheet_1_is_below_90_degrees_where_the_diagonal_is_long(
    findings: Findings, estimate: float
) -> None:
    """The diagonal between the positive axes, by the exact model."""
    reading_mm = lb.machine.exact_reading_mm(
        campaign_of(findings.posterior).machine(),
        lb.machine.Circle(radius_mm=150.0),
        np.radians([45.0, 135.0]),
        force_N=0.0,
        geometric_errors={"E_C0YX": estimate},
    )
    side = "below" if reading_mm[0] > reading_mm[1] else "above"
    numbers = SheetNumbers(findings, words_of("en"), 389.0)
    error = replace(numbers.squareness_errors["E_C0YX"], estimate=estimate)
    numbers.squareness_errors["E_C0YX"] = error
    text = numbers.angle_of_squareness("E_C0YX").replace("\u00a0", " ")
    assert text == f"the angle between +X and +Y is {side} 90°"


@pytest.mark.parametrize(("is_undetermined", "kinds"), [(True, []), (False, ["squareness"])])
def test_no_squareness_that_is_not_determined_is_to_be_corrected(
    is_undetermined: bool, kinds: list[str]
) -> None:
    """However probable its sign."""
    error = StatedQuantity(
        "Squareness", "E", 5e-5, 1e-5, (3e-5, 7e-5), "rad", is_undetermined=is_undetermined
    )
    numbers = with_squareness(error)
    findings = list(plain_findings._squareness_findings(numbers))
    assert [str(finding.kind) for finding in findings] == kinds


@pytest.mark.parametrize(
    ("partners", "advice"),
    [
        ((), "Check the alignment of the axes."),
        (("BallForm",), "More than half of U² is assumed, not measured (ball form): confirm it"),
    ],
)
def test_a_confounded_squareness_is_to_be_confirmed_first(
    partners: tuple[str, ...], advice: str
) -> None:
    """The same sheet says: do not correct the machine by it."""
    entry = judged("confounded" if partners else "identified", *partners)
    error = StatedQuantity("Squareness", "E", 5e-5, 1e-5, (3e-5, 7e-5), "rad", entry)
    numbers = with_squareness(error)
    (finding,) = plain_findings._squareness_findings(numbers)
    assert finding.values["advice"].startswith(advice)


@pytest.mark.parametrize(("language", "claim"), [("en", "differs from"), ("de", "nicht null")])
def test_a_squareness_whose_interval_contains_zero_is_not_said_to_differ_from_it(
    language: str, claim: str
) -> None:
    """Its sign alone is probable: that has the stated probability."""
    error = StatedQuantity("Squareness", "E", 19e-6, 10e-6, (-1e-6, 39e-6), "rad")
    (finding,) = plain_findings._squareness_findings(with_squareness(error))
    sentence = words_of(language)("plain.squareness", **finding.values, probability="97 %")
    assert "19 ± 20 µrad" in sentence
    assert "97 %" in sentence
    assert claim not in sentence


def gum_sentence(findings: Findings, force_N: float, entries: dict[str, Any]) -> str:
    """The sentence on intervals of the GUM, for results of the comparison that are made up."""
    validation = SimpleNamespace(parameters=entries, digits=2)
    made_up: Any = SimpleNamespace(
        words=words_of("en"),
        findings=SimpleNamespace(gum_validation=validation, result=findings.result),
        force_N=force_N,
        parameters=dict.fromkeys(entries),
    )
    return _gum_sentence(made_up)


def test_the_gum_agrees_only_where_that_is_decided_and_compared(findings: Findings) -> None:
    agrees = SimpleNamespace(validated=True, decided=True)
    is_open = SimpleNamespace(validated=True, decided=False)
    differs = SimpleNamespace(validated=False, decided=True)
    entries = {"C_XXX": agrees, "E_XX1": agrees, "E_YY1": is_open, "E_YX2": differs}
    at_reference = gum_sentence(findings, 389.0, entries)
    elsewhere = gum_sentence(findings, 100.0, entries)
    assert "of u for C_XXX and E_XX1; there either may be used" in at_reference
    assert "of u for E_XX1; there either may be used" in elsewhere
    assert "for every parameter" in gum_sentence(findings, 389.0, {"C_XXX": agrees})
    assert "for no parameter" in gum_sentence(findings, 389.0, {"C_XXX": is_open})


@pytest.mark.parametrize("language", LANGUAGES)
def test_where_all_is_determined_what_rests_on_assumptions_is_named(language: str) -> None:
    determined = replace(undetermined("BallForm"), is_undetermined=False, symbol="E_YX2")
    identified = StatedQuantity("C", "C_XXX", 1.0, 0.1, (0.8, 1.2), "mm", judged("identified"))
    numbers: Any = SimpleNamespace(
        words=words_of(language), parameters={"E_YX2": determined, "C_XXX": identified}
    )
    text = plain_findings._undetermined_sentence(numbers)
    assert "U of E_YX2 is mostly" in text or "U von E_YX2 ist" in text
    assert "C_XXX" not in text
    # Beside it stands a list of what is not determined, with E_YX2 on it.
    assert words_of(language)("plain.all_determined") not in text


def test_the_one_step_is_about_what_holds_most_of_what_is_not_determined() -> None:
    quantities = {"P0": undetermined("Mount", "Drift"), "P1": undetermined("Drift")}
    numbers: Any = SimpleNamespace(parameters=quantities)
    assert best_step(numbers) == "Drift"


def test_what_the_best_step_does_not_help_has_a_step_of_its_own() -> None:
    words = words_of("en")
    text = "".join(plain_findings._other_steps({"BarLength": ["E_XX1", "E_YY1"]}, words))
    assert text == " For E_XX1 and E_YY1: have the length of the bar calibrated, to ± 1 µm."


def test_the_deflection_has_the_relative_uncertainty_of_the_stiffness() -> None:
    stiffness = StatedQuantity("k", "k_min", 20e3, 1e3, (18e3, 22e3), "N/mm")
    text = plain_findings._deflection_with_U(stiffness, words_of("en"))
    assert text == "5.00 ± 0.50"  # 100 N / 20 N/µm, and 2 · 5 % of it


def test_of_a_stiffness_with_a_lower_limit_the_deflection_has_an_upper_limit() -> None:
    stiffness = StatedQuantity(
        "k", "k_min", 80e3, np.nan, (24e3, 9e5), "N/mm", limit="at least 24.0"
    )
    text = plain_findings._deflection_with_U(stiffness, words_of("en"))
    assert text == "at most 4.2"


def test_no_step_is_needed_where_all_is_determined() -> None:
    quantity = StatedQuantity("Q", "Q", 1.0, 0.1, (0.8, 1.2), "mm", judged("confounded", "Mount"))
    numbers: Any = SimpleNamespace(parameters={"P0": quantity})
    assert best_step(numbers) == ""


@pytest.mark.parametrize("language", ["en", "de"])
def test_every_effect_has_a_step(language: str) -> None:
    table = words_of(language).table
    assert table["steps"].keys() == table["terms"].keys() - {"CircleScale"}


@pytest.mark.parametrize("language", ["en", "de"])
def test_the_banner_counts_what_is_not_determined(language: str) -> None:
    sentence = words_of(language)("state.not_determined", count="5", all="11", names="…")
    assert "5" in sentence
    assert "11" in sentence


def test_german_sentences_on_a_quantity_have_their_articles() -> None:
    words = words_of("de")
    values = {"name": "Rechtwinkligkeit von X zu Y", "value": "8", "angle": "", "advice": ""}
    sentence = words("plain.squareness", **values, probability="97 %")
    assert sentence.startswith("Die Rechtwinkligkeit von X zu Y beträgt 8 µrad")
    for direction in ("softer", "stiffer", "larger", "smaller"):
        change = words(
            f"differences.{direction}", quantity="Versatz in X", symbol="E_Xt0", size="1 µm"
        )
        assert change.startswith("E_Xt0 (Versatz in X) ist in der zweiten Kampagne")


@pytest.mark.parametrize("language", ["en", "de"])
def test_the_box_states_the_symbol_beside_the_words(findings: Findings, language: str) -> None:
    numbers = SheetNumbers(findings, words_of(language), 389.0)
    quantity = numbers.parameters["E_C0YX"]
    assert sheet_state._labels(["E_C0YX"], numbers.parameters) == [f"{quantity.words} (E_C(0Y)X)"]
    three = ["E_C0YX", "E_XX1", "E_YY1"]
    assert sheet_state._labels(three, numbers.parameters) == ["E_C(0Y)X", "E_XX1", "E_YY1"]
