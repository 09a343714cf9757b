"""German words of the tables and sentences about the cheapest campaign for goals."""

from __future__ import annotations

import re
import tomllib
from importlib.resources import files

import pytest

import ldbb_bayes as lb
from ldbb_bayes.analysis.value_of_certificates import CERTIFICATES
from ldbb_bayes.report.passage_translation import passages_in_language, untranslated_texts
from ldbb_bayes.report.wording.goal_words import holder_in_words
from ldbb_bayes.results import Table

TERMS = [type(term).__name__ for term in lb.HybridModel.default(1).nuisances]
SENTENCES = [
    "No campaign within 2 h reaches the goals on 90 % of the machines. Without this limit the"
    " cheapest takes 2.3 h: 18 circles, with balls of grade G10 certified, price 140.",
    "U is that of linear compliance. Averaged over constant and linear compliance and what else may"
    " explain a change with force, as the sheets of report state it, it is now C_XXX 7.4 nm/N,"
    " E_C(0Y)X 75 µrad.",
    "U is that of linear compliance. Averaged over constant and linear compliance and what else may"
    " explain a change with force, as the sheets of report state it, it is now C_XXX 7.4 nm/N;"
    " after the cheapest campaign C_XXX 5.1 nm/N"
    " (medians).",
    "Averaged over constant and linear compliance and what else may explain a change with force, as"
    " the sheets of report state it, it is after"
    " the cheapest campaign C_XXX 5.1 nm/N, C_YYY 4.9 nm/N, C_XYX 0.9 nm/N (medians).",
    "Met already by 'a pilot' (U now is not above what is wanted on 90 % or more of the machines"
    " that it leaves likely), so that nothing is needed: C_XXX and E_XX1.",
    "Run 9 circles in 47 min, with balls of grade G10 and bar ± 1 µm certified: price 347.",
    "Run 1 circle in 18 min: price 18.",
    "Run 1 circle in 18 min, with bar ± 1 µm certified: price 168.",
    "Without this limit the cheapest takes 0.3 h: 1 circle, price 18.",
    "Without this limit the cheapest takes 0.3 h: 1 circle, with bar ± 1 µm certified, price 168.",
    "The other goals are met on 98 % of the machines that the prior allows (90 % were asked for).",
    "Out of reach, for the reasons below: C_XXX and E_XX1.",
    "The circles run so far are not counted in: these circles reach the goals by themselves. With"
    " --augment circles are added to those run so far.",
    "No circle is needed.",
    "No campaign within 1.5 h reaches the goals on 90 % of the machines. Allow more time, or offer"
    " certificates.",
    "No campaign of up to 40 circles reaches a goal.",
    "No campaign of up to 40 circles reaches the goals on 90 % of the machines.",
    "C_XXX: 40 circles leave U of up to 7.5 nm/N on nine in ten machines; the goal of 5.4 nm/N is"
    " met on 33 % of them. Mount holds the largest share of what still more circles would leave"
    " (64 %). With mount ± 2 % it would be less.",
    "C_XXX: 40 circles, with mount ± 2 % certified, leave U of up to 7.5 nm/N on nine in ten"
    " machines; the goal of 5.4 nm/N is met on 33 % of them.",
    "No certificate that is known here would help by a tenth. Ask for 6.8 nm/N or more to see which"
    " circles reach it.",
    "40 circles alone leave no less than is known already. With --augment the circles run so far"
    " count too.",
    "1 circle alone leaves no less than is known already.",
    "Adding 1 circle hardly narrows U.",
    "Adding 40 circles hardly narrows U.",
    "No campaign within 0.1 h reaches the other goals on 90 % of the machines. The shortest"
    " campaign takes 21 min, set-up included.",
    "C_XXX: in this time 1 circle leaves U of up to 18 nm/N on nine in ten machines; 8.0 nm/N is"
    " wanted.",
    "C_XXX: in this time 1 circle, with mount ± 2 % certified, leaves U of up to 18 nm/N on nine in"
    " ten machines; 8.0 nm/N is wanted.",
    "C_XXX: in this time 3 circles leave U of up to 18 nm/N on nine in ten machines; 8.0 nm/N is"
    " wanted. Ask for 20 nm/N or more to see which circles reach it.",
    "C_XXX: in this time 3 circles, with mount ± 2 % certified, leave U of up to 18 nm/N on nine in"
    " ten machines; 8.0 nm/N is wanted.",
    "C_YYY: no number of circles brings U below 38 %; 5.0 % is wanted. Mount holds it (57 % of what"
    " remains).",
    "C_XXX: wanted is 10 % of 53.6 nm/N, the present estimate.",
    "C_XXX: wanted is 10 % of 53.6 nm/N, the present estimate; U now is enough on 55 % of the"
    " machines that the pilot leaves likely.",
    "C_XXX: wanted is 10 % of 67 nm/N, the median of its size under the prior.",
    "U now is that of fit of the circles run so far. If what only the possible circles can show"
    " counts too, such as hysteresis if both directions are run, it is: C_XXX 9.3 nm/N, E_C(0Y)X"
    " 75 µrad. The forecasts start from this.",
    "C_XXX: no number of circles brings U below 5.43 nm/N; 5.40 nm/N is wanted. Its prior holds it"
    " (64 % of what remains).",
    "With all certificates together it would be 4.0 nm/N, which is enough.",
    "Prior of E_C(0Y)X holds it (64 % of what remains).",
    "Circles run in both directions measure hysteresis: --directions both, with the direction"
    " stated of every test.",
]


@pytest.mark.parametrize("text", SENTENCES)
def test_every_sentence_on_the_cheapest_campaign_has_german_words(text: str) -> None:
    assert untranslated_texts([text], "de", ["a pilot"]) == set()


@pytest.mark.parametrize("certificate", CERTIFICATES)
def test_every_certificate_has_german_words(certificate: str) -> None:
    text = f"With {certificate} it would be 4.0 nm/N, which is not enough."
    assert untranslated_texts([text], "de") == set()


@pytest.mark.parametrize("certificate", CERTIFICATES)
def test_a_certificate_alone_is_translated(certificate: str) -> None:
    assert passages_in_language([certificate], "de") != (certificate,)


@pytest.mark.parametrize("term", TERMS)
def test_every_effect_that_holds_a_goal_has_german_words(term: str) -> None:
    text = f"{holder_in_words(term)} holds it (64 % of what remains)."
    assert untranslated_texts([text], "de") == set()


def test_a_translation_has_the_places_of_its_text() -> None:
    source = files("ldbb_bayes.report") / "templates" / "goal_design_de.toml"
    for table in tomllib.loads(source.read_text(encoding="utf-8")).values():
        for english, german in table.items():
            assert set(re.findall(r"\{\w+\}", english)) == set(re.findall(r"\{\w+\}", german))


def test_a_table_is_shown_with_the_decimal_mark_of_its_language() -> None:
    table = Table.of("Goals", ("of", "U expected"), [("C_XXX", "7.5")])
    expected = Table.of("Ziele", ("von", "U erwartet"), [("C_XXX", "7,5")])
    assert passages_in_language([table], "de") == (expected,)


def test_an_english_page_shows_the_passages_as_they_are() -> None:
    assert passages_in_language(SENTENCES, "en") == tuple(SENTENCES)
