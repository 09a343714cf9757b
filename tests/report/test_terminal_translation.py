"""What ``report --language de`` prints is German: assumptions, tables and sentences."""

from __future__ import annotations

import re

import pytest

import ldbb_bayes as lb
from ldbb_bayes.cli.file_reports import _next_tests
from ldbb_bayes.reading.assumptions import Assumption
from ldbb_bayes.report import wording
from ldbb_bayes.report.conformity_tables import conformity_table
from ldbb_bayes.report.message_translation import subject_in_language
from ldbb_bayes.report.terminal_translation import assumption_in_language, printed_in_language
from ldbb_bayes.report.translation import words_of
from ldbb_bayes.results import Table

# English words that no German text has.
ENGLISH = re.compile(r"\b(the|of|and|with|is|are|by|which|not|from|to|for|each|this|that|at)\b")


def german(text: str, *names: str) -> str:
    (translated,) = printed_in_language([text], "de", names)
    assert isinstance(translated, str)
    return translated


@pytest.mark.parametrize(
    "text",
    [
        wording.averaged_over({"constant": 0.9, "linear": 0.1}),
        wording.averaged_over({"constant": 0.9, "linear": 0.1, "joint load": 0.0, "mount": 0.5}),
        "Linear compliance:",
        "runs: 6 tests, 4320 readings. Assumed (change it with the option named):",
        "one: 1 test, 720 readings. Assumed (change it with the option named):",
        wording.PAGE["unequal_U"],
        wording.NO_ANNEX,
    ],
)
def test_sentences_that_only_the_terminal_shows_are_german(text: str) -> None:
    assert not ENGLISH.search(german(text)), german(text)


def test_the_circles_to_run_next_are_named_in_german() -> None:
    angle_deg = [10.0 * k for k in range(36)]
    tests = [lb.CircularTest(force_N=force, angle_deg=angle_deg) for force in (36.0, 742.0)]
    assert german(_next_tests(lb.Plan(tests))).startswith(
        "Als Nächstes messen, in dieser Folge: 36 N, 742 N. Bei diesen Kräften"
    )


def test_decisions_on_conformity_are_german(recovered: lb.Campaign) -> None:
    from reports import fitted

    posterior = fitted(lb.HybridModel.first(1), recovered)
    limits = {"C_XXX": "60 nm/N", "k_min": "5 N/µm", "G": "1 µm"}
    decisions = lb.assess_conformity(posterior, limits)
    table = conformity_table({name: found.as_dict() for name, found in decisions.items()})
    (translated,) = printed_in_language([table], "de")
    assert isinstance(translated, Table)
    assert translated.caption.startswith("Konformität (ISO 14253-1, JCGM 106), bei 389 N")
    assert translated.heads == (
        "Größe",
        "Wert",
        "U",
        "Toleranz",
        "P(konform)",
        "Sicherheitsabstand",
        "Einheit",
        "Entscheidung",
    )
    decided = {row[-1] for row in translated.rows}
    assert decided <= {"konform", "nicht konform", "nicht entschieden"}


def test_an_assumption_keeps_the_texts_of_the_file() -> None:
    assumption = Assumption(
        "order of 5.xlsx, sheet 'Table of the day'",
        "operator",
        "the reader",
        "line 4 of order of 5.xlsx, sheet 'About the machine'",
        "--operator",
    )
    names = ["order of 5.xlsx"]
    assert wording.assumption_words(assumption_in_language(assumption, "de", names)) == (
        "Bediener: the reader (Zeile 4 von order of 5.xlsx, Blatt 'About the machine';"
        " order of 5.xlsx, Blatt 'Table of the day'): --operator"
    )


def test_places_are_counted_in_german() -> None:
    assumption = Assumption("6 places", "left out", "the sheet", "hidden", "--sheets")
    words = wording.assumption_words(assumption_in_language(assumption, "de"))
    assert words.startswith("weggelassen: das Blatt")
    assert "an 6 Stellen" in words


def test_a_subject_has_one_german_name() -> None:
    assert subject_in_language("force_N", "de") == "Kraft"
    assert subject_in_language("force_N", "en") == "force_N"


def test_english_is_left_as_it_is() -> None:
    assert german("Something quite new of the day.") == "Something quite new of the day."
    assert printed_in_language(["Linear compliance:"], "en") == ("Linear compliance:",)


def test_the_last_lines_have_words_in_both_languages() -> None:
    for language, note in (("en", "Note: x"), ("de", "Hinweis: x")):
        words = words_of(language)
        assert words("terminal.note", text="x") == note
        assert "out/report.pdf" in words("terminal.written", files="out/report.pdf")


def test_every_start_of_a_list_is_german() -> None:
    starts = "first CW at 0 min, the second at 6 min, 700N CCW at 42.5 min"
    assumption = Assumption("", "time_s", starts, "line 1", "--no-drift")
    translated = assumption_in_language(assumption, "de", ["first CW", "the second"])
    assert translated.value == "first CW nach 0 min, the second nach 6 min, 700N CCW nach 42,5 min"
