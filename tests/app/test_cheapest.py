"""The search for the cheapest campaign on the page of ``ldbb-bayes app``: its numbers are those of
the command, and what cannot be used is refused."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from campaigns import Invoke

import ldbb_bayes as lb
from ldbb_bayes.analysis.design import Costs, GoalDesign, certificate_offers
from ldbb_bayes.analysis.value_of_certificates import CERTIFICATES
from ldbb_bayes.app import cheapest, fields, worker
from ldbb_bayes.app.sliders import COST_SLIDERS
from ldbb_bayes.app.templates import Templates
from ldbb_bayes.cli.design_options import COST_OPTIONS
from ldbb_bayes.report.message_translation import in_language
from ldbb_bayes.report.passage_translation import untranslated_texts
from ldbb_bayes.results import parts_of

# A goal that four circles reach, with costs unlike those of the command.
ASKED = {
    "goal_E_C0YX": "25 urad",
    "minutes_per_circle": "4,5",
    "minutes_per_setup": "20",
    "certificates": "balls G10=300",
}
# A goal that no number of circles reaches.
UNREACHED = {"goal_E_XX1": "1e-6 ppm"}


def planning_defaults() -> dict[str, float]:
    """Return where the sliders stand at first."""
    costs = {name: slider.default for name, slider in COST_SLIDERS.items()}
    names = ("circles", "levels", "low", "high", "work", "tool", "turn", "radius")
    return {**dict.fromkeys(names, 1.0), **costs}


def searched(folder: Path, asked: dict[str, Any], steps: list[int] | None = None) -> dict[str, Any]:
    """Return what a search finds that starts from the recovered experiment."""
    campaign = lb.read_campaign(lb.embedded_campaign())
    lb.write_campaign(campaign, folder / fields.RESULT / "campaign")

    def count(done: int, total: int) -> None:
        if steps is not None:
            steps.append(done)

    return cheapest.find_cheapest_campaigns(folder, asked, count)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session's folder with the campaign of a fit."""
    folder = tmp_path_factory.mktemp("session")
    campaign = lb.read_campaign(lb.embedded_campaign())
    lb.write_campaign(campaign, folder / fields.RESULT / "campaign")
    return folder


@pytest.fixture(scope="module")
def search(
    tmp_path_factory: pytest.TempPathFactory, few_states_of_module: None
) -> tuple[Path, Any, Any]:
    """The folder of a search, what it found, and the steps that it reported."""
    folder = tmp_path_factory.mktemp("search")
    steps: list[int] = []
    outcome = searched(folder, ASKED, steps)
    return folder, outcome, steps


# ---- the same as the command


@pytest.fixture(scope="module")
def unreached(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return searched(tmp_path_factory.mktemp("unreached"), UNREACHED)


@pytest.mark.slow
def test_the_files_are_those_of_the_command_to_the_digit(
    search: tuple[Path, Any, Any], tmp_path: Path, invoke: Invoke
) -> None:
    folder, _, _ = search
    out = tmp_path / "out"
    options = ("--minutes-per-circle", 4.5, "--minutes-per-setup", 20)
    source = folder / fields.RESULT / "campaign"
    goal = ("--goal", "E_C0YX=25urad", "--certificates", "balls G10=300")
    code, _, _ = invoke("design", source, *goal, *options, "--out", out)
    assert code == 0
    written = folder / cheapest.CHEAPEST / "1"
    names = sorted(path.relative_to(out) for path in out.rglob("*"))
    assert names == sorted(path.relative_to(written) for path in written.rglob("*"))
    for name in names:
        if (out / name).is_file():
            assert (written / name).read_bytes() == (out / name).read_bytes()


@pytest.mark.slow
def test_the_page_shows_what_the_command_prints(search: tuple[Path, Any, Any]) -> None:
    folder, outcome, _ = search
    record = json.loads((folder / cheapest.CHEAPEST / "1" / "goals.json").read_text())
    printed = []
    for passage in parts_of(GoalDesign.from_dict(record)):
        if isinstance(passage, str):
            passage = passage.replace("--augment", "“The tests already run count as well”")
        printed.append(passage)
    assert cheapest.passages_shown(outcome, "en") == tuple(printed)


@pytest.mark.slow
def test_each_campaign_has_its_circles_in_order_and_its_cost(search: tuple[Path, Any, Any]) -> None:
    folder, outcome, _ = search
    for number, campaign in enumerate(outcome["campaigns"], start=1):
        plan = lb.read_campaign(folder / cheapest.CHEAPEST / str(number))
        forces = [f"{float(test.force_N or 0.0):.4g}" for test in plan.tests]
        assert [test["force"] for test in campaign["tests"]] == forces
        assert campaign["minutes"] == 4.5 * len(forces) + 20 + 5 * (campaign["turns"] > 0)


@pytest.mark.slow
def test_every_step_of_the_search_is_reported(search: tuple[Path, Any, Any]) -> None:
    _, _, steps = search
    assert steps == sorted(steps)
    assert steps[0] == 0
    assert steps[-1] == 8


@pytest.mark.slow
def test_a_german_page_shows_no_english_of_a_search(search: tuple[Path, Any, Any]) -> None:
    folder, _, _ = search
    record = json.loads((folder / cheapest.CHEAPEST / "1" / "goals.json").read_text())
    result = GoalDesign.from_dict(record)
    assert untranslated_texts(parts_of(result), "de", [result.pilot]) == set()


@pytest.mark.parametrize(
    ("language", "sentence"),
    [
        ("en", "With “The tests already run count as well” circles are added to those run so far."),
        ("de", "Mit „Die schon gefahrenen Messungen zählen mit“ kommen Kreise zu den bisherigen"),
    ],
)
def test_the_page_names_its_own_box_and_no_option_of_the_command(
    language: str, sentence: str
) -> None:
    outcome = {
        "passages": [{"text": "With --augment circles are added to those run so far."}],
        "pilot": {"name": "a"},
    }
    (passage,) = cheapest.passages_shown(outcome, language)
    assert isinstance(passage, str)
    assert passage.startswith(sentence)


def test_a_goal_that_no_circles_reach_names_what_holds_it(unreached: dict[str, Any]) -> None:
    text = " ".join(str(passage) for passage in cheapest.passages_shown(unreached, "en"))
    assert unreached["campaigns"] == []
    assert "no number of circles brings U below" in text
    assert "Bar length holds it" in text


def test_a_german_page_names_what_holds_a_goal(unreached: dict[str, Any]) -> None:
    text = " ".join(str(passage) for passage in cheapest.passages_shown(unreached, "de"))
    assert "Keine Zahl von Kreisen bringt U unter" in text
    assert "Maßgebend: Gerätelänge" in text


@pytest.mark.slow
def test_the_campaign_of_a_search_has_no_files_if_no_goal_is_reached(tmp_path: Path) -> None:
    searched(tmp_path, UNREACHED)
    assert not (tmp_path / cheapest.CHEAPEST).exists()


def test_the_costs_on_the_page_begin_with_those_of_the_command() -> None:
    fields_with_default = [field for field in cheapest.SEARCH_FIELDS if field.default]
    defaults = {field.name: field.default for field in fields_with_default}
    assert float(defaults.pop("probability")) == 0.9
    costs = Costs()
    assert {name: float(text) for name, text in defaults.items()} == {
        name: getattr(costs, name) for name in defaults
    }
    assert len(defaults) == 4


def test_what_circles_cost_is_asked_once(fitted: Path) -> None:
    """By sliders, which begin with the costs of the command; the search has no fields for it."""
    outcome = {
        "asked": planning_defaults() | {"goals": {}, "directions": "", "augment": False},
        "pilot": {"low": 36.0, "high": 742.0},
        "rows": [],
        "tests": [],
        "settle": None,
        "best": False,
        "cost": 0,
        "minutes": 60,
        "circles": 6,
        "setups": 1,
        "turns": 0,
    }
    session: Any = SimpleNamespace(
        edition_of_report=1,
        edition=1,
        search_entries={},
        search=SimpleNamespace(outcome={}, running=False),
    )
    page = Templates().show("plan.html.j2", "en", session=session, forecast=outcome, passages=())
    names = re.findall(r'<(?:input|select)[^>]* name="(\w+)"', page)
    for name in COST_OPTIONS:
        assert names.count(name) == 1, name
    of_search = page[page.index('<form id="costs"') :]
    assert "minutes" not in re.findall(r'name="([a-z]+)', of_search)
    for name in ("minutes_per_circle", "minutes_per_setup", "minutes_per_clocking"):
        (value,) = re.findall(rf'name="{name}"[^>]* value="([\d.]+)" data-cost', page)
        assert float(value) == getattr(Costs(), name)


def test_the_search_takes_the_probability_that_is_typed(
    fitted: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings_of_search: dict[str, Any] = {}

    def without_search(model: Any, pilot: Any, settings: dict[str, Any], progress: Any) -> Any:
        settings_of_search.update(settings)
        raise lb.InputError("no search in this test")

    monkeypatch.setattr(cheapest, "find_for_goals", without_search)
    asked = {"goal_C_XXX": "5 %", "probability": "0,75"}
    with pytest.raises(lb.InputError, match="no search"):
        cheapest.find_cheapest_campaigns(fitted, asked, None)
    assert settings_of_search["probability"] == 0.75


# ---- entries that cannot be used

WRONG: list[tuple[dict[str, str], str, str]] = [
    ({"goal_C_XXX": "5"}, "goal_C_XXX", "must be a number with its unit"),
    ({"goal_C_XXX": "120 %"}, "goal_C_XXX", "must be below 100 %"),
    ({"goal_C_XXX": "-5 %"}, "goal_C_XXX", "must be an uncertainty above 0"),
    ({"goal_E_XX1": "5 %"}, "goal_E_XX1", "must be an uncertainty with its unit"),
    ({"goal_E_XX1": "5 nm/N"}, "goal_E_XX1", "Write it in µm/m"),
    ({"goal_C_XXX": "1e99 nm/N"}, "goal_C_XXX", "must be at most 1000 times U without"),
    ({"minutes_per_circle": "x"}, "minutes_per_circle", "must be a number"),
    ({"minutes_per_circle": "0"}, "minutes_per_circle", "must be above 0"),
    ({"minutes_per_setup": "-1"}, "minutes_per_setup", "must be a number of at least 0"),
    ({"price_per_hour": "0"}, "price_per_hour", "must be above 0"),
    ({"hours": "0"}, "hours", "must be above 0"),
    ({"certificates": "bar"}, "certificates", "must be NAME=PRICE"),
    ({"certificates": "bar=x"}, "certificates", "must hold the price of each certificate"),
    ({"certificates": "bar=-1"}, "certificates", "must be a number of at least 0"),
    ({"certificates": "balls=5"}, "certificates", "must state the grade"),
    ({"certificates": "balls G7=5"}, "certificates", "must be one of G3"),
    ({"certificates": "mounts=5"}, "certificates", "certificate must be one of"),
    ({"probability": "90"}, "probability", "probability must be"),
    ({"probability": "x"}, "probability", "must be a number"),
]


@pytest.mark.parametrize(("asked", "name", "message"), WRONG)
def test_an_entry_that_cannot_be_used_is_named(
    fitted: Path, asked: dict[str, str], name: str, message: str
) -> None:
    refused = cheapest.wrong_entry(fitted, asked)
    assert refused["wrong"] == name
    assert message in refused["refused"]


@pytest.mark.parametrize("asked", [asked for asked, _, _ in WRONG])
def test_a_refused_entry_has_german_words(fitted: Path, asked: dict[str, str]) -> None:
    message = cheapest.wrong_entry(fitted, asked)["refused"]
    assert in_language(message, "de") is not None, message


def test_certificates_may_be_named_in_german(fitted: Path) -> None:
    balls = "Kugeln G5=1, Werkstückkugel G5=1, Werkzeugkugel G5=1"
    without_balls = "Messgerät=1, Aufnahme=1, Kraft=1, Winkel=1"

    assert cheapest.wrong_entry(fitted, {"certificates": balls}) == {}
    assert cheapest.wrong_entry(fitted, {"certificates": without_balls}) == {}


def test_a_certificate_that_the_campaign_has_is_refused_before_the_search(
    fitted: Path, tmp_path: Path
) -> None:
    pilot = lb.read_campaign(fitted / "result" / "campaign")
    certified = replace(pilot, instrument=replace(pilot.instrument, bar_U_um=1.0))
    lb.write_campaign(certified, tmp_path / "result" / "campaign")

    refused = cheapest.wrong_entry(tmp_path, {"certificates": "bar=150"})
    assert refused["wrong"] == "certificates"
    assert "must state what the campaign does not state yet" in refused["refused"]
    assert "the campaign states the bar's length." in refused["refused"]
    german = in_language(refused["refused"], "de")
    assert german is not None
    assert "die Kampagne gibt bereits an: die Gerätelänge" in german
    assert cheapest.wrong_entry(tmp_path, {"certificates": "mount=150"}) == {}


def test_every_field_of_a_certificate_has_words_for_people() -> None:
    for certificate in CERTIFICATES.values():
        for key in certificate:
            assert in_language(certificate_offers._WORDS_OF_FIELDS[key], "de") is not None


def test_a_certificate_that_the_readings_contradict_is_refused_before_the_search(
    fitted: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "ldbb_bayes.analysis.design.possible_certificates._contradicted",
        lambda _model, _pilot, certificates: tuple(certificates),
    )
    refused = cheapest.wrong_entry(fitted, {"certificates": "balls G3=100"})
    assert refused["wrong"] == "certificates"
    assert "must agree with the readings" in refused["refused"]
    german = in_language(refused["refused"], "de")
    assert german is not None
    assert "Kugeln vom Grad G3" in german


def test_entries_that_can_be_used_are_not_refused(fitted: Path) -> None:
    assert cheapest.wrong_entry(fitted, ASKED) == {}


def test_a_search_follows_a_fit(tmp_path: Path) -> None:
    refused = worker.answer(cheapest.wrong_entry, str(tmp_path), ASKED)
    assert "a plan must follow a fit" in refused["refused"]
