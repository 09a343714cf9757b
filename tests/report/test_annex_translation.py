"""The German annex: no English text is left on it, and its catalogue is complete."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from importlib.resources import files
from typing import Any

import pytest
from campaigns import plan, simulated
from reports import awkward, fitted, undrawn

import ldbb_bayes as lb
from ldbb_bayes.analysis.usability import ReasonKind
from ldbb_bayes.inference.fit import Concern, ConcernKind
from ldbb_bayes.report import page, wording
from ldbb_bayes.report.annex_translation import annex_translation, section_in_language
from ldbb_bayes.report.findings import findings_of_fit
from ldbb_bayes.report.page import compose, html_page
from ldbb_bayes.report.sections import Section
from ldbb_bayes.report.text_translation import TextTranslation, has_english
from ldbb_bayes.report.translation import words_of
from ldbb_bayes.results import Table

TEMPLATES = files("ldbb_bayes.report") / "templates"
# English words that no German text of the sheets or of the page has.
ENGLISH = re.compile(r"\b(the|of|and|with|is|are|by|which|not|from|to|for|each|this|that)\b")


GERMAN_TABLES = (
    "sheet",
    "fields",
    "entries",
    "heads",
    "quantities",
    "remarks",
    "state",
    "notes",
    "plain",
    "steps",
    "assumptions",
    "means",
    "terms",
    "page",
)


def catalogue() -> dict[str, str]:
    tables = tomllib.loads((TEMPLATES / "annex_de.toml").read_text(encoding="utf-8"))
    entries: dict[str, str] = {}
    for table in tables.values():
        entries |= table
    return entries


def german(*names: str) -> TextTranslation:
    translation = annex_translation(words_of("de"), frozenset(names))
    assert translation is not None
    return translation


def leaves(table: Any) -> Iterator[str]:
    if isinstance(table, str):
        yield table
    elif isinstance(table, dict):
        for value in table.values():
            yield from leaves(value)
    else:
        for value in table:
            yield from leaves(value)


# ---- the catalogue


def test_a_translation_has_the_places_of_its_text() -> None:
    for english, text in catalogue().items():
        places = set(re.findall(r"\{(\w+)\}", english))
        assert set(re.findall(r"\{(\w+)\}", text)) <= places, english


def test_no_translation_is_english() -> None:
    for text in catalogue().values():
        without_title = re.sub("„[^“]*“", "", text)
        assert not ENGLISH.search(without_title), text


@pytest.mark.parametrize("table", GERMAN_TABLES)
def test_no_word_of_the_german_sheets_is_english(table: str) -> None:
    for text in leaves(words_of("de").table[table]):
        assert not ENGLISH.search(text), text


def test_every_term_of_the_glossary_is_translated() -> None:
    meanings = tomllib.loads((TEMPLATES / "glossary.toml").read_text(encoding="utf-8"))
    translation = german()
    for term, meaning in meanings.items():
        translation.text(term)
        translation.text(meaning)
    assert not translation.missing


@pytest.mark.parametrize("table", ["sections", "pictures", "tests"])
def test_titles_and_captions_are_translated(table: str) -> None:
    translation = german()
    for text in leaves(wording.PAGE[table]):
        translation.text(text)
    assert not translation.missing


WARNINGS = [
    (ConcernKind.NOT_CONVERGED, 200.0, 400.0, "", ""),
    (ConcernKind.TRUNCATION, -20.0, -4.0, "", ""),
    (ConcernKind.TRUNCATION, -8.0, -4.0, "", ""),
    (ConcernKind.FORCES, 1.0, 3.0, "", ""),
    (ConcernKind.FORCES, 2.0, 3.0, "", ""),
    (ConcernKind.HYPER, 5e-3, 1e-3, "sigma", ""),
    (ConcernKind.CENTRE, 1e-5, 0.01, "X", ""),
    (ConcernKind.PRIOR, 7.2, 4.0, "C_XXX", ""),
    (ConcernKind.ZERO, 0.2, 0.1, "bar_length", ""),
    (ConcernKind.UNIT, 1e-5, 5e-4, "f036", "mm"),
    (ConcernKind.UNIT, 50.0, 2.0, "f036", "mm"),
    (ConcernKind.BALLS, -12.0, -3.0, "", ""),
    (ConcernKind.NEAR_ZERO, 1e-6, 3e-6, "C_XYX", "mm/N"),
]


def test_the_warnings_to_translate_are_of_all_kinds() -> None:
    assert {kind for kind, *_ in WARNINGS} == set(ConcernKind)


@pytest.mark.parametrize("warning", WARNINGS)
@pytest.mark.parametrize("sampler", ["independent", "joint"])
def test_every_warning_of_a_fit_has_a_german_sentence(
    warning: tuple[ConcernKind, float, float, str, str], sampler: str
) -> None:
    concern = Concern(*warning)
    (english,) = wording.concern_sentences((concern,), {"kind": sampler, "target_rhat": 1.01})
    translation = german("f036")
    text = translation.text(english)
    assert not translation.missing
    assert not ENGLISH.search(text), text


REASONS = [str(kind).replace("-", "_") for kind in ReasonKind if kind != ReasonKind.UNIT]


@pytest.mark.parametrize("key", [*REASONS, "unit_small", "unit_large"])
def test_every_reason_against_a_certificate_has_a_sentence_in_both_languages(key: str) -> None:
    """Grave ones, such as readings in a doubtful unit, and reservations."""
    english = words_of("en").table["state"][key]
    text = words_of("de").table["state"][key]
    assert text != english
    assert set(re.findall(r"\{(\w+)\}", text)) == set(re.findall(r"\{(\w+)\}", english))


@pytest.mark.parametrize(
    "key", ["not_converged", "doubted_unit", "contradicted_prior", "unusable_fit"]
)
def test_every_reason_against_differences_has_a_german_sentence(key: str) -> None:
    translation = german("before")
    text = translation.text(wording.PAGE[key].format(campaign="before", parameters="C_XXX"))
    assert not translation.missing
    assert not ENGLISH.search(text), text


@pytest.mark.parametrize("size", ["estimate", "prior sd"])
@pytest.mark.parametrize("explained", ["", "all of these in the model, and "])
@pytest.mark.parametrize(
    ("verdict", "zeros"),
    [("does not change", ""), ("changes", ", changing sign at 0.12 and 0.3")],
)
def test_the_size_expected_of_slopes_is_translated(
    size: str, explained: str, verdict: str, zeros: str
) -> None:
    translation = german()
    translation.text(
        f"The size expected of slopes {verdict} the sign: with {explained}slopes of 0.03 to 3 times"
        f" C/(F_max − F_min), C being the {size} of the compliance, ln B lies between −0.1 and"
        f" +12.6{zeros}."
    )
    translation.text("Slope scale: sd(slope) (largest − smallest force) / prior sd of C")
    assert not translation.missing


# ---- one text


@pytest.mark.parametrize(
    ("english", "text"),
    [
        ("ball form", "Kugelform"),
        ("Ball form", "Kugelform"),
        ("mount 39 % (assumed)", "Aufnahme 39 % (angenommen)"),
        ("mount 9 %, drift 5 %", "Aufnahme 9 %, Drift 5 %"),
        ("confounded with position and drift", "vermengt mit Achsposition und Drift"),
        ("+6.67 µm/m of E_XX1", "+6,67 µm/m E_XX1"),
        ("[-0.5, 1.5]", "[-0,5; 1,5]"),
        ("numpy 2.4.6, scipy 1.17.1", "numpy 2.4.6, scipy 1.17.1"),
        ("C_XXX", "C_XXX"),
        (
            "Not one instrument: M1 and M2 disagree about the bar length (p < 0.0001).",
            "Nicht ein Messgerät: M1 und M2 widersprechen sich: Gerätelänge (p < 0,0001).",
        ),
        (
            "The unit of the readings is in doubt: those of f036 span 12 … 14 mm, more than the 3.0"
            " mm that a ball bar can show.",
            "Die Einheit der Messwerte ist zweifelhaft: Die von f036 umfassen 12 … 14 mm, mehr als"
            " die 3,0 mm, die ein Messgerät zeigen kann.",
        ),
        (
            "Expected intervals against equal steps: as wide for E_XX1 to 1.14 times as wide for"
            " C_CCY.",
            "Zu erwartende Intervalle gegen gleiche Stufen: gleich breit für E_XX1 bis 1,14-mal so"
            " breit für C_CCY.",
        ),
        (
            "Expected intervals against equal steps: as wide for every parameter.",
            "Zu erwartende Intervalle gegen gleiche Stufen: gleich breit für alle Parameter.",
        ),
    ],
)
def test_a_text_is_translated(english: str, text: str) -> None:
    assert german().text(english) == text


def test_a_name_is_not_translated() -> None:
    assert german("position and drift").text("position and drift") == "position and drift"


def test_a_text_without_translation_is_noted() -> None:
    translation = german()
    assert translation.text("something quite new") == "something quite new"
    assert translation.missing == {"something quite new"}


def test_english_is_not_translated() -> None:
    assert annex_translation(words_of("en"), frozenset()) is None


@pytest.mark.parametrize("text", ["C_XXX", "12.5 µm/m", "nrad/N", "cos 2θ", "–"])
def test_symbols_are_no_english(text: str) -> None:
    assert not has_english(text)


def test_the_glossary_is_in_alphabetical_order_in_german() -> None:
    rows = [("stiffness", "1"), ("slope", "2"), ("share", "3"), ("reference force F0", "4")]
    table = Table.of("Glossary", ["term", "meaning"], rows)
    section = section_in_language(Section("glossary", "Glossary", (table,)), german())
    (translated,) = section.content
    assert isinstance(translated, Table)
    terms = [str(row[0]) for row in translated.rows]
    assert terms == ["Anteil", "Änderung mit der Kraft", "Bezugskraft F0", "Steifigkeit"]


# ---- a whole page


@pytest.fixture
def translations(monkeypatch: pytest.MonkeyPatch) -> list[TextTranslation]:
    """The translations that pages are made with, in the order of the pages."""
    undrawn(monkeypatch)
    made: list[TextTranslation] = []

    def translation_of(*arguments: Any) -> TextTranslation | None:
        translation = annex_translation(*arguments)
        if translation is not None:
            made.append(translation)
        return translation

    monkeypatch.setattr(page, "annex_translation", translation_of)
    return made


@pytest.mark.parametrize("degree", [pytest.param(0, marks=pytest.mark.slow), 1])
def test_a_german_page_has_no_english_text(
    degree: int, translations: list[TextTranslation]
) -> None:
    posterior = fitted(lb.HybridModel.first(degree), simulated(plan()))
    reason = wording.NO_ANNEX
    document = compose(
        findings_of_fit(posterior, comparison=reason, recommended=reason), language="de"
    )
    assert document.sections
    assert [translation.missing for translation in translations] == [set()]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["degree 2", "unconverged", "paper", "two tests"])
def test_awkward_german_pages_have_no_english_text(
    kind: str, translations: list[TextTranslation]
) -> None:
    reason = wording.NO_ANNEX
    compose(findings_of_fit(awkward(kind), comparison=reason, recommended=reason), language="de")
    assert [translation.missing for translation in translations] == [set()]


@pytest.mark.slow
def test_a_german_page_with_comparison_and_design_has_no_english_text(
    translations: list[TextTranslation],
) -> None:
    posterior = fitted(lb.HybridModel.first(1), simulated(plan()))
    html = html_page(compose(findings_of_fit(posterior), language="de"))
    assert [translation.missing for translation in translations] == [set()]
    assert '<html lang="de">' in html
