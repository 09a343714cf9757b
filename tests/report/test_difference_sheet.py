"""The sheet for signing that compares two campaigns, in both languages."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime
from pathlib import Path

import pytest
from campaigns import plan, simulated
from reports import NOT_COMPARED, fitted
from scipy.stats import norm

import ldbb_bayes as lb
from ldbb_bayes.analysis.common_effects import Shared
from ldbb_bayes.inference.fit import Concern, ConcernKind
from ldbb_bayes.inference.posterior import campaign_of
from ldbb_bayes.inference.summary import result_json
from ldbb_bayes.report import sections, wording
from ldbb_bayes.report.blocks import Banner, Fields, Items, ReportSheet
from ldbb_bayes.report.difference_sheet import difference_sheets
from ldbb_bayes.report.findings import Findings, FurtherCampaign, findings_of_fit
from ldbb_bayes.report.pdf import fit_to_pages, pdf_of
from ldbb_bayes.report.sheets import sheets
from ldbb_bayes.report.translation import words_of
from ldbb_bayes.results import Table

MODEL = lb.HybridModel.first(0)
SAME_INSTRUMENT = Shared(instrument=True)


pytestmark = pytest.mark.usefixtures("without_figures")


@pytest.fixture(scope="module")
def findings() -> Findings:
    campaign = replace(simulated(plan()), name="before", serial_number="4711", date="2026-10-01")
    return findings_of_fit(
        fitted(MODEL, campaign), comparison=NOT_COMPARED, recommended=NOT_COMPARED
    )


@pytest.fixture(scope="module")
def second_campaign(findings: Findings) -> FurtherCampaign:
    """The machine has become softer in X by 40 nm/N, and the work ball is another one."""
    softer = MODEL.simulate(plan(), seed=2, parameters={"C_XXX": 90e-6}).campaign
    posterior = fitted(MODEL, replace(softer, name="after"))
    table = lb.analysis.compare_posteriors(findings.posterior, posterior, same_instrument=True)
    return FurtherCampaign("after", campaign_of(posterior), result_json(posterior), table)


def sheet_of(
    findings: Findings, second_campaign: FurtherCampaign, language: str = "en"
) -> ReportSheet:
    (sheet,) = difference_sheets(findings, [second_campaign], SAME_INSTRUMENT, words_of(language))
    return sheet


def test_the_sheet_holds_what_is_signed(
    findings: Findings, second_campaign: FurtherCampaign
) -> None:
    sheet = sheet_of(findings, second_campaign)
    assert (sheet.title, sheet.line) == (
        "Difference between two campaigns",
        "Sheet 3 of 3: before, after",
    )
    campaigns, signatures = (block for block in sheet.blocks if isinstance(block, Fields))
    first = campaign_of(findings.posterior)
    assert campaigns.entries == (
        ("First campaign", "before, 4711, 2026-10-01"),
        ("Second campaign", "after"),
        ("Readings of the first", f"SHA-256 {first.sha256[:16]}"),
        ("Readings of the second", f"SHA-256 {second_campaign.campaign.sha256[:16]}"),
    )
    assert signatures.tall
    (table,) = (block for block in sheet.blocks if isinstance(block, Table))
    rows = {str(row[1]): [str(cell) for cell in row] for row in table.rows}
    row = second_campaign.differences.loc["C_XXX"]
    assert rows["C_XXX"][0] == "Compliance of axis X"
    assert float(rows["C_XXX"][4]) == pytest.approx(row["difference"] * 1e6, abs=0.06)
    assert float(rows["C_XXX"][5]) == pytest.approx(2.0 * row["sd"] * 1e6, rel=0.05)
    assert any("The instrument was the same" in str(block) for block in sheet.blocks)
    assert any("of the first campaign alone, before" in str(block) for block in sheet.blocks)


def test_both_values_and_the_difference_have_the_decimals_of_U(
    findings: Findings, second_campaign: FurtherCampaign
) -> None:
    """With U = 140 µm/m², of −6 and −11 and their difference whole tens are stated."""
    differences = second_campaign.differences.copy()
    columns = ["first", "second", "difference", "sd", "ci_low", "ci_high"]
    differences.loc["E_YX2", columns] = (-6e-9, -11e-9, -5.2e-9, 70e-9, -142e-9, 132e-9)
    other = replace(second_campaign, differences=differences)
    (on_sheet,) = (block for block in sheet_of(findings, other).blocks if isinstance(block, Table))
    passages = sections.beside(findings.result, [other], SAME_INSTRUMENT, prob=0.95)
    (on_screen, *_) = (passage for passage in passages if isinstance(passage, Table))
    sheet_row = next(row for row in on_sheet.rows if row[1] == "E_YX2")
    screen_row = next(row for row in on_screen.rows if row[0] == "E_YX2")
    assert sheet_row[2:6] == ("−10", "−10", "−10", "140")
    assert screen_row[1:4] == ("-10", "-10", "-10")


@pytest.mark.parametrize("prob", [0.68, 0.9])
def test_u_is_that_of_95_percent_whatever_the_intervals_in_brackets(
    findings: Findings, second_campaign: FurtherCampaign, prob: float
) -> None:
    """Of a difference of 40 ± 2 nm/N (one u, normal), U is 4 nm/N and brackets follow --ci."""
    of_95 = second_campaign.differences.copy()
    of_95.attrs["conflict"] = None
    of_95["probability_of_increase"] = 0.5
    normal = norm(40e-6, 2e-6)
    columns = ["difference", "sd", "ci_low", "ci_high", "probability_of_increase"]
    of_95.loc["C_XXX", columns] = (40e-6, 2e-6, *normal.interval(0.95), 1.0)
    with_brackets = of_95.copy()
    with_brackets.loc["C_XXX", ["ci_low", "ci_high"]] = normal.interval(prob)
    other = replace(second_campaign, differences=with_brackets, differences_with_95=of_95)
    blocks = sheet_of(replace(findings, prob=prob), other).blocks
    (table,) = (block for block in blocks if isinstance(block, Table))
    (changes,) = (block for block in blocks if isinstance(block, Items))
    row = next(row for row in table.rows if row[1] == "C_XXX")
    low, high = (1e6 * end for end in normal.interval(prob))
    assert row[4:7] == ("40.0", "4.0", f"[{low:.1f}, {high:.1f}]")
    assert "by 40.0 ± 4.0 nm/N" in changes.items[0].replace("\u00a0", " ")
    passages = list(sections.beside(findings.result, [other], SAME_INSTRUMENT, prob=prob))
    assert "C_XXX 40.0 ± 4.0 nm/N" in str(passages[1])
    on_screen = next(passage for passage in passages if isinstance(passage, Table))
    assert next(row for row in on_screen.rows if row[0] == "C_XXX")[3] == "40.0"


@pytest.mark.parametrize(
    ("difference", "words"),
    [(1e-5, "is larger in the second campaign, by"), (-1e-5, "is smaller in the second campaign")],
)
def test_a_change_is_stated_in_words(
    findings: Findings, second_campaign: FurtherCampaign, difference: float, words: str
) -> None:
    """Of a direct compliance also whether the machine is stiffer or softer; with Holm's method a
    change that is just shown by itself is not named."""
    table = second_campaign.differences.copy()
    table.attrs["conflict"] = None
    table["probability_of_increase"] = 0.5
    table.loc["C_XXX", ["difference", "sd"]] = (difference, 1e-6)
    table.loc["C_XXX", ["ci_low", "ci_high"]] = (difference - 2e-6, difference + 2e-6)
    table.loc["C_XXX", "probability_of_increase"] = 1.0 if difference > 0.0 else 0.0
    table.loc["E_YX2", "probability_of_increase"] = 0.98
    (changes,) = (
        block
        for block in sheet_of(findings, replace(second_campaign, differences=table)).blocks
        if isinstance(block, Items)
    )
    compliance, straightness, by_holm = changes.items
    state = "softer" if difference > 0.0 else "stiffer"
    assert compliance.startswith(f"Compliance of axis X (C_XXX) {words}")
    assert "in the second campaign, by 10.0 ± 2.0 nm/N: " in compliance.replace("\u00a0", " ")
    assert compliance.endswith(f"the machine is {state} there.")
    assert "(E_YX2) is" in straightness
    assert by_holm.endswith("these have changed: C_XXX.")


def test_no_change_is_said(findings: Findings, second_campaign: FurtherCampaign) -> None:
    table = second_campaign.differences.copy()
    table.attrs["conflict"] = None
    table["probability_of_increase"] = 0.5
    (changes,) = (
        block
        for block in sheet_of(findings, replace(second_campaign, differences=table)).blocks
        if isinstance(block, Items)
    )
    assert changes.items == (
        "No change is shown: the 95 % interval of every difference contains zero.",
    )


def test_doubts_stand_first(findings: Findings, second_campaign: FurtherCampaign) -> None:
    table = second_campaign.differences.copy()
    table.attrs["conflict"] = ("length 150 mm", 1e-6)
    blocks = sheet_of(findings, replace(second_campaign, differences=table)).blocks
    (banner,) = (block for block in blocks if isinstance(block, Banner))
    assert blocks[0] is banner
    assert not [block for block in blocks if isinstance(block, Items)]
    assert banner.kind == "unusable"
    assert banner.sentence.startswith("Not one instrument: before and after disagree")


def stated(prior: dict[str, tuple[float, float]]) -> lb.HybridModel:
    """A model with prior means and standard deviations that a user stated [mm/N]."""
    means = {name: mean for name, (mean, _) in prior.items()}
    overrides = {name: sd for name, (_, sd) in prior.items()}
    return replace(MODEL, prior=replace(MODEL.prior, means=means, overrides=overrides))


@pytest.mark.parametrize(
    ("language", "contradicted", "unlike", "differing_parts"),
    [
        (
            "en",
            "The readings of after contradict the prior of C_YYY. Do not use the differences",
            "The two fits have different models: their priors differ.",
            "their terms and degree differ.",
        ),
        (
            "de",
            "Die Messwerte von after widersprechen dem Vorwissen über C_YYY. Die Unterschiede",
            "Die zwei Auswertungen haben verschiedene Modelle; verschieden: Vorwissen.",
            "verschieden: Terme und Grad.",
        ),
    ],
)
def test_a_contradicted_prior_and_other_models_are_said(
    findings: Findings, language: str, contradicted: str, unlike: str, differing_parts: str
) -> None:
    """Of a prior that the readings contradict the differences are not named; of another model, or
    another prior that they do not contradict, they are, with a reservation."""
    campaign = replace(MODEL.simulate(plan(), seed=3).campaign, name="after")

    def banner_and_kinds(model: lb.HybridModel) -> tuple[Banner, set[type]]:
        posterior = fitted(model, campaign)
        table = lb.analysis.compare_posteriors(findings.posterior, posterior)
        second = FurtherCampaign("after", campaign, result_json(posterior), table)
        blocks = sheet_of(findings, second, language).blocks
        banner = blocks[0]
        assert isinstance(banner, Banner)
        return banner, {type(block) for block in blocks}

    banner, kinds = banner_and_kinds(stated({"C_YYY": (300e-6, 5e-6)}))
    assert (banner.kind, Items in kinds) == ("unusable", False)
    assert contradicted in banner.sentence
    assert unlike in banner.sentence
    banner, kinds = banner_and_kinds(stated({"C_YYY": (50e-6, 200e-6)}))
    assert (banner.kind, Items in kinds) == ("reserved", True)
    assert banner.sentence.startswith(unlike)
    banner, kinds = banner_and_kinds(lb.HybridModel.first(1).without("ball-form"))
    assert banner.kind == "reserved"
    assert differing_parts in banner.sentence


UNIT = Concern(ConcernKind.UNIT, 1.2e-5, 9e-5, "f036")
TRUNCATION = Concern(ConcernKind.TRUNCATION, -20.0, -6.9)
SCATTER = Concern(ConcernKind.HYPER, 0.01, 0.005, "kappa")


@pytest.mark.parametrize(
    ("language", "concern", "kind", "sentence"),
    [
        (
            "en",
            UNIT,
            "unusable",
            "DO NOT USE THE RESULTS. The readings of f036 span 0.012 µm, less than the 0.090 µm"
            " that every ball bar shows: state their unit and fit again.",
        ),
        (
            "en",
            TRUNCATION,
            "unusable",
            "DO NOT USE THE RESULTS. The readings speak against compliances that are not negative.",
        ),
        (
            "de",
            TRUNCATION,
            "unusable",
            "DIE ERGEBNISSE NICHT VERWENDEN. Die Messwerte widersprechen nicht negativen"
            " Nachgiebigkeiten.",
        ),
        (
            "en",
            SCATTER,
            "reserved",
            "THE RESULTS CAN BE USED WITH THIS RESERVATION. The circles scatter more than expected"
            " (kappa).",
        ),
    ],
)
@pytest.mark.parametrize("place", [0, 1])
def test_the_sheet_says_which_of_the_two_fits_has_a_concern(
    findings: Findings,
    second_campaign: FurtherCampaign,
    place: int,
    language: str,
    concern: Concern,
    kind: str,
    sentence: str,
) -> None:
    """In the words of that campaign's first sheet."""
    table = second_campaign.differences.copy()
    fits = list(table.attrs["fits"])
    fits[place] = replace(fits[place], concerns=(concern,))
    table.attrs |= {"conflict": None, "fits": tuple(fits)}
    blocks = sheet_of(findings, replace(second_campaign, differences=table), language).blocks
    banner = blocks[0]
    assert banner == Banner(kind, f"{('before', 'after')[place]}: {sentence}")
    assert (Items in {type(block) for block in blocks}) == (kind == "reserved")


def test_readings_that_the_model_does_not_expect_are_said(
    findings: Findings, second_campaign: FurtherCampaign
) -> None:
    table = second_campaign.differences.copy()
    first, second = table.attrs["fits"]
    checks = second.predictive_checks["f300"]
    surprising = {"f300": replace(checks, orders_p={**checks.orders_p, 4: 1e-12})}
    misfit = replace(second, predictive_checks=second.predictive_checks | surprising, shift={})
    table.attrs |= {"conflict": None, "fits": (first, misfit)}
    banner = sheet_of(findings, replace(second_campaign, differences=table)).blocks[0]
    assert banner == Banner(
        "unusable",
        "after: DO NOT USE THE RESULTS. The model does not expect readings like these (f300).",
    )


@pytest.mark.parametrize("place", [0, 1])
def test_terminal_and_annex_are_silent_where_the_sheet_is(
    findings: Findings, second_campaign: FurtherCampaign, place: int
) -> None:
    """Of a fit that cannot be used no changes are named, and a sentence says why."""
    table = second_campaign.differences.copy()
    fits = list(table.attrs["fits"])
    fits[place] = replace(fits[place], concerns=(TRUNCATION,))
    table.attrs |= {"conflict": None, "fits": tuple(fits)}
    name = ("before", "after")[place]
    assert wording.unusable_fit_sentences("before", "after", True, table.attrs) == (
        f"The results of {name} cannot be used: see its fit. Do not use the differences.",
    )
    assert "no changes are named" in wording.change_sentence("before", "after", table, 0.95)


def test_no_banner_without_doubts(findings: Findings, second_campaign: FurtherCampaign) -> None:
    table = second_campaign.differences.copy()
    table.attrs["conflict"] = None
    blocks = sheet_of(findings, replace(second_campaign, differences=table)).blocks
    assert not [block for block in blocks if isinstance(block, Banner)]


def test_the_sheet_in_german(findings: Findings, second_campaign: FurtherCampaign) -> None:
    sheet = sheet_of(findings, second_campaign, "de")
    assert sheet.line == "Blatt 3 von 3: before, after"
    texts = " ".join(str(block) for block in sheet.blocks)
    assert "Nachgiebigkeit der Achse X" in texts
    assert "Das Messgerät war dasselbe" in texts
    for english in ("second", "allowing", "instrument was", "campaign", "compliance"):
        assert english not in texts


def test_each_sheet_is_a_page_of_the_pdf(
    findings: Findings, second_campaign: FurtherCampaign
) -> None:
    further = difference_sheets(
        findings, [second_campaign, second_campaign], SAME_INSTRUMENT, words_of("en")
    )
    fitted_sheets = fit_to_pages((*sheets(findings, further=2), *further))
    assert [sheet.line[:12] for sheet in fitted_sheets] == [
        f"Sheet {number} of 4" for number in (1, 2, 3, 4)
    ]
    started = findings.result["provenance"]["started"]
    pdf = pdf_of(fitted_sheets, "title", "en", datetime.fromisoformat(started))
    assert pdf.count(b"/Type /Page\n") == 4


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "serial_number", "expected"),
    [(5, "4712", "state different machines"), (6, None, "If it was one machine")],
)
def test_machines_are_two_where_the_campaigns_say_so(
    findings: Findings, tmp_path: Path, seed: int, serial_number: str | None, expected: str
) -> None:
    other = MODEL.simulate(plan(), seed=seed).campaign
    posterior = fitted(MODEL, replace(other, name="after", serial_number=serial_number))
    lb.write_report(findings.posterior, tmp_path, beside_it={"after": posterior})
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    sentences = ("state different machines", "If it was one machine")
    assert [sentence in page for sentence in sentences] == [expected == s for s in sentences]
