"""German words of messages: notes on files, and the reasons why files cannot be used."""

from __future__ import annotations

import re
import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Any

import field_files
import field_programs
import field_words
import messages
import pytest
from campaigns import Invoke

import ldbb_bayes as lb
from ldbb_bayes.reading.assumptions import AssumptionLog
from ldbb_bayes.report.message_translation import in_language, is_own_text
from ldbb_bayes.report.wording.fixed_texts import SENTENCES

CASES = {
    **field_files.CASES,
    **field_programs.program_cases(),
    **field_words.word_cases(),
}
# English words that no German message has.
ENGLISH = re.compile(r"\b(the|of|and|with|is|are|by|which|not|from|to|for|each|this|that|must)\b")
TEMPLATES = files("ldbb_bayes.report") / "templates"
SUBJECTS = tomllib.loads((TEMPLATES / "subjects_de.toml").read_text(encoding="utf-8"))["subjects"]


def catalogue() -> dict[str, str]:
    source = TEMPLATES / "messages_de.toml"
    entries: dict[str, str] = {}
    for table in tomllib.loads(source.read_text(encoding="utf-8")).values():
        assert not entries.keys() & table.keys()
        entries |= table
    return entries


def untranslated(texts: set[str], *names: str) -> list[str]:
    return sorted(text for text in texts if in_language(text, "de", names) is None)


# ---- the catalogue


def test_a_translation_has_the_places_of_its_message() -> None:
    for english, text in catalogue().items():
        places = set(re.findall(r"\{(\w+)\}", english))
        assert set(re.findall(r"\{(\w+)\}", text)) <= places, english


def test_no_translation_is_english() -> None:
    for text in catalogue().values():
        assert not ENGLISH.search(text), text


# ---- every message in the source


def test_every_note_on_files_has_german_words() -> None:
    texts = messages.notes("reading", "cli/sources.py")
    assert len(texts) > 100
    assert untranslated(texts - SUBJECTS.keys()) == []


@pytest.mark.parametrize(
    "room",
    [
        "reading",
        "campaign/cell_numbers.py",
        "campaign/text_decoding.py",
        "campaign/text_table.py",
        "campaign/readings_table.py",
        "campaign/ball_certificate.py",
        "campaign/force_certificate.py",
        "campaign/certified_quantity.py",
        "campaign/bar_certificate.py",
        "app/fields.py",
    ],
)
def test_every_refusal_of_files_has_german_words(room: str) -> None:
    """Messages that are put together from others, and those on masks, which no file has, aside."""
    texts = set()
    for text in messages.refusals(room):
        if not text.startswith(("W ", "arcs_deg", "half_width_deg")):
            texts.add(text)
    assert texts
    assert untranslated(texts, "a.csv") == []


@pytest.mark.parametrize("kind", [*SENTENCES["remarks"]])
def test_every_remark_on_a_campaign_has_german_words(kind: str) -> None:
    text = SENTENCES["remarks"][kind]
    sentence = re.sub(r"\{\w+:[^}]*\}", "1.5", text)
    sentence = re.sub(r"\{(first|second|setup|test)\}", "f036", sentence)
    sentence = re.sub(r"\{(stated|travel)\}", "CW", sentence)
    sentence = sentence.replace("{what}", "force").replace("{unit}", "N")
    sentence = sentence.replace("{radii}", "100 and 150").replace("{planes}", "XY and YZ")
    sentence = sentence.replace("{ball}", "work ball").replace("{file}", "model.toml")
    sentence = sentence.replace("{terms}", "ball form, set-up shift, drift")
    assert untranslated({sentence}, "f036") == []


# ---- single messages


@pytest.mark.parametrize(
    ("english", "german"),
    [
        ("100 N, line 3", "100 N, Zeile 3"),
        ("the header 'Angle and time [deg]'", "die Überschrift 'Angle and time [deg]'"),
        ("angle = 'Angle 1.5', reading = 'R'", "Winkel = 'Angle 1.5', Messwert = 'R'"),
        ("it spans 1.5", "die Zahlen umspannen 1,5"),
        (
            "my test.csv, line 7: the decimal mark must be the same in all rows, got '1.5'. Correct"
            " it; or give --decimal, if the other stands between thousands.",
            "my test.csv, Zeile 7: Das Dezimalzeichen muss in allen Zeilen gleich sein, hier steht"
            " '1.5'. Berichtigen; oder --decimal angeben, wenn das andere Zeichen Tausender"
            " trennt.",
        ),
        (
            "my test.csv: radius_mm must be said once, got 1.5 mm in line 1 and 100 mm in line 2."
            " Give --radius-mm.",
            "my test.csv: Der Radius muss eindeutig sein; angegeben ist 1,5 mm (Zeile 1) und 100 mm"
            " (Zeile 2). Bitte angeben: --radius-mm.",
        ),
        (
            "goal of C_XXX must be a number with its unit, got '5'. Write it in nm/N, like 0.5"
            " nm/N. Or write a percentage of the value, like 5 %.",
            "Das Ziel für C_XXX muss eine Zahl mit Einheit sein, angegeben ist '5'. In nm/N"
            " schreiben, etwa 0,5 nm/N. Oder in Prozent des Werts schreiben, etwa 5 %.",
        ),
        (
            "--forces-N must hold numbers, got '36,x'. Write them like 36,389,742.",
            "--forces-N muss Zahlen enthalten, angegeben ist '36,x'. So schreiben: 36,389,742.",
        ),
    ],
)
def test_a_message_in_german(english: str, german: str) -> None:
    assert in_language(english, "de", ["my test.csv"]) == german


def test_a_message_without_german_words_is_none() -> None:
    assert in_language("something quite new", "de") is None


def test_an_english_page_shows_messages_as_they_are() -> None:
    assert in_language("something quite new", "en") == "something quite new"


def test_what_an_operator_is_called_is_the_text_of_the_file() -> None:
    assert is_own_text("operator")


def test_a_unit_is_not_the_text_of_the_file() -> None:
    assert not is_own_text("unit of the reading")


# ---- files from the field


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_notes_and_refusals_of_a_field_file_have_german_words(
    name: str, tmp_path: Path, invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = CASES[name]
    texts: set[str] = set()

    def add(log: AssumptionLog, place: str, *note: Any) -> None:
        subject, value, reason, option = note
        texts.update({subject, str(reason), option} - SUBJECTS.keys())
        if not is_own_text(subject):
            texts.add(value)

    monkeypatch.setattr(AssumptionLog, "add", add)
    for file, content in (case.mended or case.files).items():
        (tmp_path / file).write_bytes(content)
    paths = sorted(tmp_path.iterdir())
    options = ("--out", tmp_path / "campaign", *case.options)
    code, _, stderr = invoke("import", *paths, *options)
    if code == 2:
        refusal = " ".join(stderr.split()).removeprefix("ldbb-bayes: ")
        texts = {refusal.replace(f"{tmp_path}/", "")}
        invoke("import", *paths, *options, *case.step)
    names = [path.name for path in paths]
    if (tmp_path / "campaign").exists():
        names += [test.name for test in lb.read_campaign(tmp_path / "campaign").tests]
    assert untranslated(texts, *names) == []
