"""The page of ``ldbb-bayes app`` as its server answers: what was dropped is understood, and what
should not get in does not."""

from __future__ import annotations

import asyncio
import http.client
import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
import zipfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise, product
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import uvicorn
from campaigns import Invoke

import ldbb_bayes as lb
from ldbb_bayes.analysis.design.discrimination import DECISIVE
from ldbb_bayes.analysis.design.space import Space
from ldbb_bayes.app import (
    fields,
    page_words,
    planned_tests,
    planning,
    server,
    templates,
    understanding,
    worker,
)
from ldbb_bayes.app.answering_process import AnsweringProcess
from ldbb_bayes.app.computation import Computation
from ldbb_bayes.app.goal_fields import goal_texts, goals_typed, with_goals
from ldbb_bayes.app.session import Session
from ldbb_bayes.app.session_registry import SessionRegistry
from ldbb_bayes.app.worth import effects_of_certificates

TOKEN = "a-token-of-the-tests"
RECOVERED = Path(lb.embedded_campaign())


@dataclass
class Tab:
    """A session, as its page speaks to the server."""

    port: int
    base: str = f"/{TOKEN}/"

    def ask(self, method: str, path: str, body: Any = None, **headers: str) -> tuple[int, str]:
        """Status and text of an answer; headers of None are left out."""
        sent = {"Host": f"127.0.0.1:{self.port}"}
        if method != "GET":
            sent["Origin"] = f"http://127.0.0.1:{self.port}"
        for name, value in headers.items():
            sent[name.replace("_", "-")] = value
        sent = {name: value for name, value in sent.items() if value}
        if isinstance(body, dict):
            body = json.dumps(body)
        if not path.startswith("/"):
            path = self.base + path
        with closing(http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)) as link:
            link.request(method, path, body, sent)
            answer = link.getresponse()
            self.headers = {name.lower(): value for name, value in answer.getheaders()}
            return answer.status, answer.read().decode("utf-8", "replace")

    def opened(self) -> Tab:
        """A new session at this server."""
        status, _ = self.ask("GET", f"/{TOKEN}/")
        assert status == 303
        return Tab(self.port, self.headers["location"])

    def holding(self, *paths: Path) -> Tab:
        """The session, with files."""
        for path in paths:
            assert self.ask("PUT", f"files/{path.name}", path.read_bytes())[0] == 200
        return self

    def state(self) -> dict[str, Any]:
        return json.loads(self.ask("GET", "state?tab=1")[1])


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Tab, Path]]:
    """A server, and the folder that holds the files of its sessions."""
    folder = tmp_path_factory.mktemp("sessions")
    with pytest.MonkeyPatch.context() as patch, server.listening(0) as listener:
        patch.setattr(server.tempfile, "tempdir", str(folder))
        patch.setattr("ldbb_bayes.app.session.CLOSED_S", 0.4)
        patch.setattr("ldbb_bayes.app.session_registry.LOOK_S", 0.1)
        port = listener.getsockname()[1]
        settings = uvicorn.Config(
            server.application(TOKEN, port),
            http="h11",
            ws="none",
            log_level="critical",
            backlog=512,
        )
        running = uvicorn.Server(settings)
        thread = threading.Thread(target=running.run, kwargs={"sockets": [listener]})
        thread.start()
        yield Tab(port), until(lambda: [*folder.iterdir()])[0]
        running.should_exit = True
        thread.join(30)
    assert not [*folder.iterdir()]


@pytest.fixture
def tab(house: tuple[Tab, Path]) -> Iterator[Tab]:
    """A new session, which is left after the test: the number of sessions is limited."""
    opened = house[0].opened()
    yield opened
    opened.ask("POST", "leave?tab=1")


def until(holds: Callable[[], Any], seconds: float = 60.0) -> Any:
    end = time.monotonic() + seconds
    result = holds()
    while not result:
        assert time.monotonic() < end
        time.sleep(0.05)
        result = holds()
    return result


# ---- what the page shows


@pytest.mark.slow
def test_a_direction_that_no_test_states_stands_in_parentheses(tab: Tab) -> None:
    tab.holding(RECOVERED / "f036.csv")
    page = tab.ask("GET", "section/understood")[1]
    assert '<td data-head="direction">(CW)</td>' in page
    assert "Direction in parentheses" in page

    tab.ask("POST", "entries", {"direction": "CW"})
    page = tab.ask("GET", "section/understood")[1]
    assert '<td data-head="direction">CW</td>' in page
    assert "Direction in parentheses" not in page

    tab.ask("POST", "entries", {"language": "de"})
    page = tab.ask("GET", "section/understood")[1]
    assert '<td data-head="Richtung">im Uhrzeigersinn</td>' in page


def test_a_single_circle_is_not_called_circles(tab: Tab) -> None:
    tab.holding(RECOVERED / "f036.csv")
    assert ": 1 circle, " in tab.ask("GET", "section/understood")[1]
    tab.ask("POST", "entries", {"language": "de"})
    assert ": 1 Kreis, " in tab.ask("GET", "section/understood")[1]


@pytest.mark.slow
def test_order_and_drift_are_stated_on_the_page(tab: Tab) -> None:
    tab.holding(*sorted(RECOVERED.glob("f*.csv")))
    page = tab.ask("GET", "section/understood")[1]
    assert "the order in which the tests are listed" in page
    assert re.search('name="order".*>as listed', page)
    assert re.search('name="no_drift".*>possible', page)

    tab.ask("POST", "entries", {"order": "random"})
    assert "The tests were run in random order" in tab.ask("GET", "section/understood")[1]
    tab.ask("POST", "entries", {"order": "", "no_drift": "yes"})
    tab.ask("POST", "entries", {"language": "de"})
    page = tab.ask("GET", "section/understood")[1]
    assert "Von Messung zu Messung driftet nichts (angegeben)." in page
    assert "Drift von Messung zu Messung" in page
    assert re.search('value="yes" selected>keine', page)


# Entries that cannot be used, and words of the message that says so.
UNUSABLE: list[tuple[dict[str, str], str]] = [
    ({"radius_mm": "wide"}, "--radius-mm must be a number"),
    ({"force_U_percent": "1000"}, "--force-U-percent must be at least 1e-06 and at most 100"),
    (
        {"mount_um_per_bar": "nan"},
        "--mount-um-per-bar must be at least 0 and at most 1000, got nan",
    ),
    ({"force_N": "9999"}, "Choose one within what was tested"),
    ({"balls": "G7"}, "must be one of G3, G5"),
    ({"date": "24.11.2026"}, "it should be a date as ISO 8601, for example 2026-11-20"),
    ({"ball_bar_calibrated": "May"}, "it should be a date as ISO 8601, for example 2026-11-20"),
    ({"tolerance": "C_XXX"}, "--tolerance must be"),
    ({"bar_U_um": "1e9", "forces_N": "36;364;742", "operator": "A"}, "bar_U_um"),
    ({"unit": "furlong"}, "furlong"),
    ({"angle_column": "Foo"}, "Foo"),
    ({"bar_dcc": "../../job.json"}, "--bar-dcc must be a file that was added"),
    ({"forces_N": "1,2"}, "must hold one number for each test"),
    ({"bar_U_um": "1e9"}, "bar_U_um must be less than or equal to 1000, got 1000000000"),
    ({"angle_U_deg": "400"}, "at most 10,"),
    ({"bar_U_um": "inf"}, "--bar-U-um must be at least 1e-06 and finite, got inf"),
    ({"bar_U_um": "1.5 µm"}, "Write the number alone, without its unit."),
    ({"mount_U_percent": "2 %"}, "Write the number alone, without its unit."),
    ({"bar_U_um": "1-2"}, "got &#39;1-2&#39;. Correct it."),
    ({"radius_mm": "1,000"}, "without marks between thousands"),
    ({"radius_mm": "1.000"}, "without marks between thousands"),
    ({"tolerance": "squareness=20 urad"}, "Errors of squareness are E_C0YX."),
    ({"tolerance": "straightness=1 um/m2"}, "Errors of straightness are E_YX2, E_XY2."),
    ({"tolerance": "gain=1 um/m"}, "Errors of gain are E_XX1, E_YY1."),
    ({"tolerance": "offset=1 um"}, "Errors of offset are E_Xt0, E_Yt0."),
    ({"tolerance": "C_XXX=1,000 nm/N"}, "a tolerance must be a number without marks between"),
]


def test_a_wrong_entry_is_not_said_to_be_missing(tab: Tab) -> None:
    tab.holding(*sorted(RECOVERED.glob("f*.csv")))
    tab.ask("POST", "entries", {"radius_mm": "wide"})
    page = tab.ask("GET", "section/understood")[1]
    assert "--radius-mm must be a number" in page
    assert "say below what is missing" not in page


def test_one_of_several_reasons_is_an_example(tab: Tab) -> None:
    readings = (RECOVERED / "f036.csv").read_bytes()
    for name in ("100 N.csv", "200 N.csv", "300 N.csv"):
        assert tab.ask("PUT", f"files/{name.replace(' ', '%20')}", readings)[0] == 200
    page = tab.ask("GET", "section/understood")[1]
    assert "<td>100 N, 200 N, 300 N</td><td>for example the name &#39;100 N&#39;" in page


def test_entries_of_one_assumption_are_listed_without_their_full_stops(tab: Tab) -> None:
    tab.holding(*sorted(RECOVERED.glob("f*.csv")))
    page = tab.ask("GET", "section/understood")[1]
    assert 'data-field="angle_column">Column of the angle</a>, ' in page


def test_the_mount_is_shown_in_the_unit_of_its_field(tab: Tab) -> None:
    tab.holding(*sorted(RECOVERED.glob("f*.csv")))
    page = tab.ask("GET", "section/understood")[1]
    assert 'name="mount_U_percent"' in page
    assert 'placeholder="± 0.47 µm/bar = 20 %, assumed"' in page
    tab.ask("POST", "entries", {"mount_U_percent": "2,5"})
    assert "± 0.058 µm/bar = 2.5 % (stated)" in tab.ask("GET", "section/understood")[1]


def test_a_sentence_of_the_report_bears_the_language_of_the_report() -> None:
    outcome = {"converged": True, "state": "USABLE", "alerts": ["Look."], "language": "en"}
    fit = SimpleNamespace(outcome=outcome, running=False)
    session = SimpleNamespace(fit=fit, file_sizes={"a.csv": 1}, edition_of_report=1)
    page = templates.Templates().show("fit.html.j2", "de", session=session)
    assert '<span lang="en">USABLE</span>' in page
    assert '<ul lang="en"><li>Look.</li>' in page


def test_a_computation_says_how_long_it_has_run(tmp_path: Path) -> None:
    computation = Computation("fit", tmp_path)
    assert computation.progress["seconds"] == 0
    computation.process = cast(Any, object())
    computation.started_s = time.monotonic() - 90.5
    assert computation.progress["seconds"] == 90


def test_a_german_page_shows_no_english_note(tab: Tab) -> None:
    tab.holding(*sorted(RECOVERED.glob("f*.csv")))
    tab.ask("POST", "entries", {"language": "de"})
    assert 'lang="en"' not in tab.ask("GET", "section/understood")[1]


@pytest.mark.parametrize("statements", [statements for statements, _ in UNUSABLE])
def test_a_german_page_shows_no_english_refusal(tab: Tab, statements: dict[str, str]) -> None:
    tab.holding(RECOVERED / "f036.csv", RECOVERED / "f742.csv", RECOVERED / "f364.csv")
    tab.ask("POST", "entries", {"language": "de"})
    tab.ask("POST", "entries", statements)
    page = tab.ask("GET", "section/understood")[1]
    assert 'role="alert"' in page
    assert 'lang="en"' not in page


def test_a_message_without_german_words_is_announced_and_marked_as_english() -> None:
    outcome = {"refused": "something quite new"}
    page = templates.Templates().show("forecast.html.j2", "de", forecast=outcome)
    assert 'nur auf Englisch: <span lang="en">something quite new</span>' in page


@pytest.mark.slow
def test_what_was_dropped_is_understood(tab: Tab) -> None:
    tab.holding(*sorted(RECOVERED.glob("f*.csv")))
    page = tab.ask("GET", "section/understood")[1]
    imported = lb.import_campaign([RECOVERED / "f*.csv"])
    assert all(test.name in page for test in imported.campaign.tests)
    for assumption in imported.assumptions:
        assert assumption.value in page.replace("&#39;", "'")
    assert page.count("<polyline") == 6
    assert (
        tab.ask("POST", "entries", {"bar_U_um": "1,5", "topology": "wXYFZSt", "nonsense": "1"})[0]
        == 200
    )
    page = tab.ask("GET", "section/understood")[1]
    assert "± 1.5 µm" in page
    tab.ask(
        "POST",
        "entries",
        {
            "bar_U_um": "1,5",
            "bar_length_error_um": "-0,8",
            "tolerance": "C_XXX=60,5 nm/N",
            "topology": "wXYFZSt",
        },
    )
    assert "−0.8 ± 1.5 µm" in tab.ask("GET", "section/understood")[1]
    assert "machine wXYFZSt" in page
    tab.ask("POST", "entries", {"language": "de"})
    page = tab.ask("GET", "section/understood")[1]
    for words in (
        "der Name &#39;f036&#39;",
        "0,24 µm",
        "Maschine wXYFZSt",
        "C-Gestell (wXYFZSt)",
    ):
        assert words in page


@pytest.mark.parametrize(("statements", "message"), UNUSABLE)
def test_what_cannot_be_is_refused_with_the_cure(
    tab: Tab, statements: dict[str, str], message: str
) -> None:
    tab.holding(RECOVERED / "f036.csv", RECOVERED / "f742.csv", RECOVERED / "f364.csv").ask(
        "POST", "entries", statements
    )
    page = tab.ask("GET", "section/understood")[1]
    assert message in page
    assert 'role="alert"' in page
    name, *_ = statements
    marked = [name]
    if name == "bar_dcc":  # no file to choose
        marked = []
    assert re.findall(r'id="entry-(\w+)"[^>]*aria-invalid', page) == marked
    assert str(RECOVERED.parent) not in page


@pytest.mark.slow
def test_certificates_are_worth_what_identify_says(house: tuple[Tab, Path], tab: Tab) -> None:
    tab.ask("POST", "example")
    folder = house[1] / tab.base.split("/")[-2]
    answer = worker.answer(effects_of_certificates, str(folder), {})
    model = lb.HybridModel.default(degree=1)
    asked = lb.identify(model, lb.read_campaign(RECOVERED)).certificates
    row = next(effect for effect in answer["effects"]["bar"]["rows"] if effect["name"] == "E_XX1")
    assert row["share"] == pytest.approx(
        asked["bar ± 1 µm"]["E_XX1"] / asked["none of these"]["E_XX1"], abs=1e-3
    )
    assert f"→ {row['after']} µm/m" in tab.ask("GET", "section/worth")[1]


def balls_shown(instrument: lb.Instrument) -> list[str]:
    """Return what the page says of the work ball."""
    campaign = replace(lb.read_campaign(RECOVERED), instrument=instrument)
    entries = understanding._uncertainties_by_part(campaign)["balls"]
    return [entry["size"] for entry in entries if entry["words"] == "work"]


def test_the_form_of_a_ball_is_shown_as_it_is_stated() -> None:
    """Once for all orders; a stated harmonic as such."""
    assert balls_shown(lb.Instrument()) == ["2.5 µm"]
    assert balls_shown(lb.Instrument(work=lb.Ball(sphericity_um=0.5))) == ["0.5 µm"]
    assert balls_shown(lb.Instrument(work=lb.Ball(grade="G10"))) == ["G10"]
    lobe = lb.Ball(harmonics_um=((2, 0.21, 30.0),), U_um=0.05)
    assert balls_shown(lb.Instrument(work=lobe)) == ["n = 2: 0.21 ± 0.05 µm", "2.5 µm"]
    both = replace(lobe, sphericity_um=0.6)
    assert balls_shown(lb.Instrument(work=both)) == ["n = 2: 0.21 ± 0.05 µm", "0.6 µm"]


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session's folder as a fit leaves it, as far as a plan needs it: the campaign, and
    uncertainties of its fit."""
    folder = tmp_path_factory.mktemp("fitted")
    (folder / fields.RESULT).mkdir()
    campaign = replace(lb.read_campaign(RECOVERED), date="2026-11-20", operator="A")
    lb.write_campaign(campaign, folder / fields.RESULT / "campaign")
    (folder / fields.RESULT / "summary.json").write_text(
        json.dumps({"parameters": {"C_XXX": {"mean": 5.4e-5, "sd": 3.4e-6}}})
    )
    return folder


# Ends of the sliders of the plan. Of two positions of a ball and more circles the search takes
# longer, and is no other.
ENDS = {
    "circles": (1, 6),
    "low": (36, 100),
    "high": (400, 742),
    "work": (1, 3),
    "tool": (1, 3),
    "turn": (5, 180),
    "radius": (0, 600),
    "directions": ("", "both"),
    "augment": (False, True),
}


def _information(tests: tuple[lb.CircularTest, ...], space: Space) -> float:
    """Return the criterion of a design: the expected information of its tests."""
    return space.objective(tests).value(np.ones(len(tests)))


def _best_and_equal_steps(report: Any, asked: dict[str, Any]) -> tuple[float, float]:
    """Return the information of the best tests that the page finds, and of equal steps."""
    sliders = planned_tests._sliders_of_tests(asked, planned_tests.pilot_of(report).campaign)
    space = planned_tests._space_of_sliders(report, asked, sliders)
    best = planned_tests._best_tests(space, sliders)
    steps = planned_tests._equally_spaced_tests(space, sliders)
    return _information(best, space), _information(steps, space)


@pytest.mark.slow
@pytest.mark.usefixtures("few_states")
def test_the_best_forces_are_never_worse_than_equal_steps(fitted: Path) -> None:
    """Combinations of the ends of the sliders, one in sixty-four."""
    report = planned_tests.report_of(fitted)
    worst = np.inf
    for k, ends in enumerate(product(*ENDS.values())):
        if k % 64 == 9 * (k // 64) % 64:
            best, steps = _best_and_equal_steps(report, dict(zip(ENDS, ends, strict=True)))
            worst = min(worst, best - steps)
    assert worst >= 0.0


@pytest.mark.slow
@pytest.mark.usefixtures("few_states")
def test_equal_steps_are_compared_with_the_model_of_the_tests_found(
    fitted: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Among candidates with turned balls, the model has effects that the test found does not."""
    asked = {"circles": 1, "high": 400, "work": 3, "turn": 5, "radius": 600, "augment": True}
    report = planned_tests.report_of(fitted)
    sliders = planned_tests._sliders_of_tests(asked, planned_tests.pilot_of(report).campaign)
    space = planned_tests._space_of_sliders(report, asked, sliders)
    best = planned_tests._best_tests(space, sliders)
    slightly_worse = (replace(best[0], force_N=390.0),)
    assert _information(slightly_worse, space) < _information(best, space)
    monkeypatch.setattr(
        planned_tests, "_equally_spaced_tests", lambda space, sliders: slightly_worse
    )
    assert planned_tests._best_tests(space, sliders)[0].force_N == best[0].force_N


@pytest.mark.usefixtures("few_states")
def test_the_best_forces_are_those_that_the_report_on_the_page_recommends(
    fitted: Path, tmp_path: Path
) -> None:
    """With the settings of a new page; with others they are searched."""
    shutil.copytree(fitted, tmp_path, dirs_exist_ok=True)
    model = lb.HybridModel.default(degree=1)
    pilot = lb.read_campaign(RECOVERED)
    recommended = lb.design(model, pilot=pilot, tests=6, forces_N=(36.0, 211.0, 433.0, 742.0))
    text = json.dumps(lb.report.with_words(recommended))
    (tmp_path / fields.RESULT / "design.json").write_text(text)
    best = worker.answer(planning.forecast, str(tmp_path), {"best": True})
    assert [float(test["force"]) for test in best["tests"]] == [
        test.force_N for test in recommended.plan().tests
    ]
    for row in best["rows"]:
        assert row["sd"] == recommended.expected[row["key"]].sd
    report = planned_tests.report_of(tmp_path)
    for change in ({"circles": 5}, {"low": 40.0}, {"augment": True}, {"directions": "both"}):
        sliders = planned_tests._sliders_of_tests(change, pilot)
        space = planned_tests._space_of_sliders(report, change, sliders)
        assert planned_tests._tests_of_report(report, space, sliders) == ()


@pytest.mark.usefixtures("few_states")
@pytest.mark.parametrize(
    ("language", "words"),
    [
        ("en", "Circles in the order in which to run them: "),
        ("de", "Kreise in der Reihenfolge, in der sie zu fahren sind: "),
    ],
)
def test_the_forces_of_a_plan_are_said_to_be_in_the_order_of_the_circles(
    fitted: Path, language: str, words: str
) -> None:
    expected = planning.forecast(fitted, {"circles": 2, "levels": 2})
    section = templates.Templates().show("forecast.html.j2", language, forecast=expected)
    first, second = (test["force"] for test in expected["tests"])
    assert {first, second} == {"36", "742"}
    assert f"{words}{first}, {second} N</p>" in section


@pytest.mark.slow
def test_the_best_forces_of_three_positions_of_each_ball_are_those_of_design(fitted: Path) -> None:
    asked = {"circles": 6, "work": 3, "tool": 3}
    report = planned_tests.report_of(fitted)
    best = _best_and_equal_steps(report, asked)[0]
    designed = lb.design(
        lb.HybridModel.default(degree=1),
        pilot=lb.read_campaign(RECOVERED),
        tests=6,
        forces_N=np.linspace(36.0, 742.0, 20).round(),
        clockings_deg=tuple(product((0.0, 45.0, 90.0), repeat=2)),
    )
    sliders = planned_tests._sliders_of_tests(asked, planned_tests.pilot_of(report).campaign)
    space = planned_tests._space_of_sliders(report, asked, sliders)
    assert best >= _information(designed.tests, space) - 1e-3


def test_goals_are_read_from_the_fields_of_the_page() -> None:
    settings = {"goal_C_XXX": " 5 % ", "goal_E_C0YX": "", "circles": 6}
    assert goal_texts(settings) == {"C_XXX": "5 %"}


def _row_with_goal(text: str) -> dict[str, Any]:
    """Return the page's row of C_XXX with a goal; its estimate is 50 nm/N."""
    bound = lb.HybridModel.default(1).bind(lb.read_campaign(RECOVERED))
    row = {"key": "C_XXX", "sd": 3e-6, "likely_sd": 4e-6}
    return with_goals([row], {"C_XXX": text}, bound, {"C_XXX": 5e-5})[0]


@pytest.mark.parametrize(
    ("text", "reached"), [("10 nm/N", "nine"), ("7 nm/N", "half"), ("5 nm/N", "no")]
)
def test_a_goal_is_reached_by_nine_in_ten_machines_by_half_or_by_fewer(
    text: str, reached: str
) -> None:
    assert _row_with_goal(text)["reached"] == reached


def test_a_goal_in_percent_is_of_the_estimate() -> None:
    assert _row_with_goal("20 %")["wanted"] == "10"


def test_a_goal_may_have_a_decimal_comma_but_no_thousands() -> None:
    assert _row_with_goal("2,5 nm/N")["wanted"] == "2.5"
    assert goals_typed({"C_XXX": "0,5 nm/N"}) == {"C_XXX": "0.5 nm/N"}
    refused = _row_with_goal("1,000 nm/N")["refused"]
    assert "goal of C_XXX must be a number without marks between thousands" in refused


def test_a_goal_that_cannot_be_read_says_why() -> None:
    refused = _row_with_goal("10 µrad")["refused"]
    assert "goal of C_XXX must be a number with its unit" in refused


@pytest.mark.slow
def test_a_plan_expects_what_a_design_expects_of_the_same_circles(fitted: Path) -> None:
    equal_steps = [36, 177, 318, 460, 601, 742]
    forecast = worker.answer(planning.forecast, str(fitted), {"circles": 6, "levels": 6})
    model = lb.HybridModel.default(degree=1)
    designed = lb.design(model, pilot=lb.read_campaign(RECOVERED), tests=6)
    assert sorted(float(test["force"]) for test in forecast["tests"]) == equal_steps
    row = next(effect for effect in forecast["rows"] if effect["name"] == "C_XXX")
    assert row["share"] == pytest.approx(designed.baseline["C_XXX"].sd / 3.4e-6, abs=1e-3)
    settled = designed.compared[0].discrimination
    assert settled is not None
    assert settled.threshold == DECISIVE
    assert forecast["settle"]["linear"] == pytest.approx(settled.decisive_with)
    quick = worker.answer(
        planning.forecast, str(fitted), {"circles": 6, "levels": 6, "fine": False}
    )
    assert quick["settle"]["linear"] == pytest.approx(forecast["settle"]["linear"], abs=0.05)
    best = worker.answer(planning.forecast, str(fitted), {"circles": 6, "best": True})
    assert sorted(float(test["force"]) for test in best["tests"]) != equal_steps


def settings(tests: list[dict[str, str]], *keys: str) -> list[tuple[str, ...]]:
    """Return what a plan says of its tests under some keys."""
    return [tuple(test[key] for key in keys) for test in tests]


def count_changes(values: list[tuple[str, ...]]) -> int:
    """Return how often a value is followed by another."""
    return sum(value != following for value, following in pairwise(values))


def test_no_table_of_what_to_expect_is_wider_than_a_screen() -> None:
    """Of three planes there are 30 parameters: 15 fit into 1088 pixels side by side."""
    row = {"before": "0.48", "unit": "µrad/(N m)"}
    today = [row | {"name": f"C_{k}"} for k in range(31)]
    outcome = {"effects": {}, "contradicted": [], "today": today}
    page = templates.Templates().show("worth.html.j2", "en", worth=outcome)
    columns = [table.count("<th ") for table in page.split("<table")[1:]]
    assert columns == [15, 15, 1]
    assert page.count("<td ") == 31
    assert page.count("<caption>") == 1


@pytest.mark.slow
def test_a_plan_counts_what_is_turned_and_can_be_read(fitted: Path) -> None:
    asked = {
        "circles": 8,
        "work": 2,
        "turn": 45,
        "radius": 100,
        "minutes_per_circle": 6,
        "minutes_per_clocking": 5,
        "minutes_per_setup": 20,
        "price_per_hour": 60,
    }
    planned = worker.answer(planning.plan, str(fitted), asked)
    kinds = {("0", "100"), ("0", "150"), ("45", "100"), ("45", "150")}
    assert set(settings(planned["tests"], "work", "radius")) == kinds
    many = worker.answer(planning.forecast, str(fitted), asked | {"circles": 24})["tests"]
    assert len(set(settings(many, "force", "work", "radius"))) == 24  # each force with each kind
    turns = count_changes(settings(planned["tests"], "work"))
    changes = count_changes(settings(planned["tests"], "radius"))
    setups = changes + 1
    # Where the radius is changed, the balls are turned in the same set-up.
    of_both = settings(planned["tests"], "work", "radius")
    turns_within = count_changes(of_both) - changes
    assert (planned["setups"], planned["turns"]) == (setups, turns_within)
    assert turns >= turns_within
    assert planned["minutes"] == planned["cost"] == 8 * 6 + turns_within * 5 + setups * 20
    plan = lb.read_campaign(fitted / "plan")
    assert plan.is_plan
    assert (plan.date, plan.operator) == (None, None)  # of the campaign before
    forces = [(f"{test.force_N:.4g}",) for test in plan.tests]
    assert forces == settings(planned["tests"], "force")


def test_a_plan_has_the_model_of_its_analysis(fitted: Path) -> None:
    """Also where it replaces an earlier plan."""
    asked = {"circles": 4, "levels": 2, "low": 100, "high": 400, "fine": False}
    for _ in range(2):
        assert "refused" not in worker.answer(planning.plan, str(fitted), asked)
    model = lb.read_model(fitted / "plan" / "model.toml")
    plan = lb.read_campaign(fitted / "plan")
    pilot = lb.HybridModel.default(1).bind(lb.read_campaign(RECOVERED))
    bound = model.bind(plan)
    assert bound.setting.reference_force_N == pilot.setting.reference_force_N
    prior_sd = dict(zip(bound.names, bound.prior_sd.tolist(), strict=True))
    expected = dict(zip(pilot.names, pilot.prior_sd.tolist(), strict=True))
    assert prior_sd["C_XXX_1"] == pytest.approx(expected["C_XXX_1"])


def test_a_plan_of_one_force_turns_both_balls(fitted: Path) -> None:
    one = worker.answer(
        planning.forecast, str(fitted), {"circles": 3, "levels": 1, "work": 3, "tool": 3}
    )
    assert set(settings(one["tests"], "force")) == {("742",)}
    clockings = {("0", "0"), ("45", "45"), ("90", "90")}
    assert set(settings(one["tests"], "work", "tool")) == clockings
    assert one["turns"] == 2  # both balls at once, as in the search for the cheapest campaign


@pytest.mark.slow
@pytest.mark.usefixtures("few_states")
def test_the_order_of_a_plan_does_not_follow_the_forces(fitted: Path) -> None:
    """Also where a clocking has forces of its own."""
    for asked in ({"circles": 6, "levels": 2}, {"circles": 6, "work": 4, "directions": "both"}):
        planned = worker.answer(planning.forecast, str(fitted), asked | {"fine": False})
        forces_N = [float(test["force"]) for test in planned["tests"]]
        correlation = np.corrcoef(forces_N, np.arange(len(forces_N)))[0, 1]
        assert abs(correlation) < 0.6, forces_N


def test_a_short_plan_has_both_radii(fitted: Path) -> None:
    """Not one radius with every position first."""
    asked = {"circles": 6, "work": 6, "radius": 100}
    planned = worker.answer(planning.forecast, str(fitted), asked)
    assert set(settings(planned["tests"], "radius")) == {("100",), ("150",)}


@pytest.mark.parametrize("asked", [{"circles": 0}, {"low": 700, "high": 100}, {"turn": "x"}])
def test_a_plan_that_cannot_be_is_refused(fitted: Path, asked: dict[str, object]) -> None:
    refusal = worker.answer(planning.plan, str(fitted), asked)["refused"]
    assert "Move its slider" in refusal or "Lower it" in refusal


def pairs_of_words(english: Any, german: Any) -> list[tuple[str, str]]:
    """Return an entry of both catalogues as pairs of texts, one for each word if it has several."""
    if isinstance(english, str):
        return [(english, german)]
    return [(english[word], german[word]) for word in english | german]


def test_both_languages_say_the_same_things() -> None:
    english, german = (page_words.words_of_page(language) for language in page_words.LANGUAGES)
    free = {"labels", "what", "phrases", "instrument", "choices"}
    assert english.keys() == german.keys()
    for key in english.keys() - free - {"decimal"}:
        pairs = [(english[key], german[key])]
        if not isinstance(english[key], str):
            words = english[key] | german[key]
            pairs = []
            for word in words:
                pairs += pairs_of_words(english[key][word], german[key][word])
        for one, other in pairs:
            assert set(re.findall(r"\{\w+\}", one)) == set(re.findall(r"\{\w+\}", other))
    assert fields.FIELDS.keys() - {"language"} <= german["labels"].keys()
    assert {value for value, _ in fields.FIELDS["topology"].choices} < german["choices"].keys()


# ---- who may ask, and for what


@pytest.mark.parametrize(
    ("method", "path", "headers", "status"),
    [
        ("GET", "", {"Host": "evil.example"}, 421),
        ("GET", "", {"Host": "127.0.0.1:1"}, 421),
        ("GET", "state", {"Origin": "http://evil.example"}, 403),
        ("GET", "state", {"Origin": "null"}, 403),
        ("POST", "fit", {"Origin": "http://evil.example"}, 403),
        ("POST", "fit", {"Origin": ""}, 403),
        ("GET", "state", {"Sec_Fetch_Site": "cross-site"}, 403),
        ("GET", "/", {}, 403),
        ("GET", "/wrong-token/", {}, 403),
        ("GET", "/?x", {}, 403),
        ("GET", f"/{TOKEN}/s/another/state", {}, 410),
        ("GET", f"/{TOKEN}/static/worker.py", {}, 404),
        ("GET", "result/job.json", {}, 404),
        ("GET", "result/..%2fjob.json", {}, 404),
        ("GET", "result/%2e%2e/job.json", {}, 404),
        ("GET", "section/page", {}, 404),
        ("POST", "entries", {"Content_Length": str(2**30)}, 413),
        ("PUT", "files/large.csv", {"Content_Length": str(2**30)}, 413),
    ],
)
def test_only_the_page_may_ask(
    tab: Tab, method: str, path: str, headers: dict[str, str], status: int
) -> None:
    answered, text = tab.ask(method, path, **headers)
    assert answered == status
    assert text
    assert "Traceback" not in text
    assert tab.headers["x-content-type-options"] == "nosniff"
    assert tab.state()["running"] is False


@pytest.mark.parametrize("length", ["many", "-5", "1e3", "1_0", "9" * 5000])
def test_a_length_that_is_no_number_is_refused(length: str) -> None:
    """Whatever the server lets through."""
    answers = []

    async def send(message: dict[str, Any]) -> None:
        answers.append(message)

    headers = [(b"host", b"127.0.0.1:80"), (b"content-length", length.encode())]
    path = f"/{TOKEN}/s/key/files/a.csv"
    scope = {"type": "http", "method": "GET", "path": path, "headers": headers}
    asyncio.run(server.application(TOKEN, 80)(scope, None, send))  # type: ignore[arg-type]
    assert answers[0]["status"] == 400


@pytest.mark.parametrize(
    ("sent", "stored"),
    [
        ("..%2F..%2Fescaped.csv", "escaped.csv"),
        ("%2Fetc%2Fpasswd", "passwd"),
        ("C%3A%5Cfolder%5Cx.csv", "x.csv"),
        ("..%5C..%5Cy.csv", "y.csv"),
        ("con.csv", "_con.csv"),
        ("a%00b.csv", "a_b.csv"),
        ("%3Cscript%3E.csv", "_script_.csv"),
        ("...", None),
        ("%E6%BC%A2" * 120, "漢" * 40),
    ],
)
def test_names_of_files_lead_nowhere(
    house: tuple[Tab, Path], tab: Tab, sent: str, stored: str | None
) -> None:
    status, _ = tab.ask("PUT", f"files/{sent}", b"1;2")
    folder = house[1] / tab.base.split("/")[-2]
    if stored is None:
        assert status == 422
        assert [path for path in folder.rglob("*") if path.is_file()] == []
    else:
        assert status == 200
        assert [path.name for path in folder.rglob("*") if path.is_file()] == [stored]
    assert not (house[1] / "escaped.csv").exists()


def test_what_is_too_large_is_refused_and_nothing_is_kept(tab: Tab) -> None:
    piece = b"0" * 2**20
    with suppress(ConnectionError):  # refused while it is still being sent
        assert (
            tab.ask(
                "PUT", "files/long.csv", (piece for _ in range(70)), Transfer_Encoding="chunked"
            )[0]
            == 413
        )
    assert tab.state()["files"] == 0
    assert tab.ask("POST", "entries", "x" * 2**18)[0] == 422
    assert tab.ask("POST", "entries", b"[1]")[0] == 422
    assert tab.ask("POST", "plan", b"{" * 100_000)[0] == 422


def test_what_is_on_its_way_is_not_read(tab: Tab) -> None:
    """And nothing else is let in beside it than what fits."""
    tab.holding(*sorted(RECOVERED.glob("f*.csv"))[:3])
    content = (RECOVERED / "f742.csv").read_bytes()
    with closing(http.client.HTTPConnection("127.0.0.1", tab.port, timeout=60)) as link:
        link.putrequest("PUT", f"{tab.base}files/f742.csv")
        link.putheader("Content-Length", str(len(content)))
        link.putheader("Origin", f"http://127.0.0.1:{tab.port}")
        link.endheaders(content[:5000])
        time.sleep(0.3)
        page = tab.ask("GET", "section/understood")[1]
        link.send(content[5000:])
        assert link.getresponse().status == 200
    assert "3 circles" in page
    assert "4 circles" in tab.ask("GET", "section/understood")[1]


def test_forces_are_given_in_the_order_that_is_shown(house: tuple[Tab, Path], tab: Tab) -> None:
    for name in ("10.csv", "2.csv", "1.txt", "bare"):
        tab.ask("PUT", f"files/{name}", (RECOVERED / "f036.csv").read_bytes())
    listed = re.findall(r'data-remove="([^*"]+)"', tab.ask("GET", "section/files")[1])
    understood = worker.answer(
        understanding.understand,
        str(house[1] / tab.base.split("/")[-2]),
        {"forces_N": "10;20,5;30;40"},
    )
    forces_by_name = [(test["name"], test["force"]) for test in understood["tests"]]
    names = [name.partition(".")[0] for name in listed]
    assert forces_by_name == list(zip(names, ("10", "20.5", "30", "40"), strict=True))


def test_what_holds_no_table_is_left_out(tab: Tab) -> None:
    """A scan or a picture among the readings stops nothing; alone it is refused."""
    for name, start in (("scan.pdf", b"%PDF-1.7\n\xe2\xe3"), ("photo.jpg", b"\xff\xd8\xff\xe0")):
        tab.ask("PUT", f"files/{name}", start + bytes(range(256)))
        page = tab.ask("GET", "section/understood")[1]
        assert "a document or a picture" in page, page
    page = tab.holding(*RECOVERED.glob("f*.csv")).ask("GET", "section/understood")[1]
    assert "6 circles" in page
    assert "it holds no table" in page


def test_two_names_do_not_become_one(tab: Tab) -> None:
    for _ in range(2):
        assert tab.ask("PUT", "files/run%231.csv", b"1;2")[0] == 200  # the same again, corrected
    status, message = tab.ask("PUT", "files/run%261.csv", b"3;4")
    assert status == 409
    assert "run#1.csv" in message
    assert tab.state()["files"] == 1


def test_what_no_longer_applies_is_forgotten(tab: Tab) -> None:
    tab.ask("PUT", "files/bar.xml", b"<a/>")
    tab.holding(RECOVERED / "f036.csv")
    assert "Certificates not used: bar.xml" in tab.ask("GET", "section/understood")[1]
    edition = tab.state()["edition"]
    for _ in range(2):
        tab.ask("POST", "entries", {"bar_dcc": "bar.xml", "radius_mm": "150", "operator": "A"})
    assert tab.state()["edition"] == edition + 1  # what was said again changes nothing
    tab.ask("DELETE", "files/bar.xml")
    assert 'role="alert"' not in tab.ask("GET", "section/understood")[1]
    tab.holding(RECOVERED / "campaign.toml", *RECOVERED.glob("f*.csv"))
    page = tab.ask("GET", "section/understood")[1]
    assert 'role="alert"' not in page
    assert 'value="A"' in page


@pytest.mark.slow
def test_a_question_that_hangs_takes_no_other_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The time of an answer counts from where it begins."""
    monkeypatch.setattr("ldbb_bayes.app.answering_process.ANSWER_S", 4.0)

    async def asked() -> list[dict[str, Any]]:
        desk = AnsweringProcess()
        session = Session("key", tmp_path, "en")
        try:
            works = [partial(pause, 60.0), *[partial(pause, 0.9)] * 5]
            return await asyncio.gather(*(desk.ask(work, session) for work in works))
        finally:
            desk.stop()

    first, *later_answers = asyncio.run(asked())
    assert "had to be started again" in first["refused"]
    assert later_answers == [{"slept": 0.9}] * 5


def pause(seconds: float, folder: Path) -> dict[str, Any]:
    time.sleep(seconds)
    return {"slept": seconds}


@pytest.mark.slow
def test_a_bomb_is_refused(tab: Tab) -> None:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xl/worksheets/sheet1.xml", b"0" * (300 * 2**20))
    assert len(packed.getvalue()) < 2**20
    assert tab.ask("PUT", "files/bomb.xlsx", packed.getvalue())[0] == 200
    page = tab.ask("GET", "section/understood")[1]
    assert "bomb.xlsx" in page
    assert 'role="alert"' in page
    tab.ask("DELETE", "files/bomb.xlsx")
    tab.ask("PUT", "files/campaign.zip", packed.getvalue())
    assert "campaign.zip must be unpacked" in tab.ask("GET", "section/understood")[1]


def test_no_text_becomes_code(tab: Tab) -> None:
    script = "<script>alert(1)</script>\"'{{ 7 * 7 }}"
    head = f"# Machine: {script}\n# Operator: {script}\nangle_deg;reading_um;test\n"
    rows = "".join(f"{k};{k % 7};{script.replace(';', '')}\n" for k in range(360))
    tab.ask("PUT", "files/x.csv", (head + rows).encode())
    tab.ask("POST", "entries", {"forces_N": "100"})
    pages = [tab.ask("GET", f"section/{name}")[1] for name in ("files", "understood")]
    for name, field in fields.FIELDS.items():
        if field.kind != "choice":
            tab.ask("POST", "entries", {name: script})
            pages += [tab.ask("GET", "section/understood")[1]]
    pages += [
        tab.ask("POST", "plan", {"circles": script, "directions": script})[1],
        tab.ask("GET", "")[1],
    ]
    for page in pages:
        assert "<script>alert" not in page
        assert "49" not in re.findall(r"&#39;(\d+)", page)
    assert any("&lt;script&gt;alert" in page for page in pages)
    assert "script-src 'self'" in tab.headers["content-security-policy"]


@pytest.mark.slow
def test_two_hundred_at_once_are_answered(tab: Tab) -> None:
    tab.ask("POST", "example")

    def ask(path: str) -> tuple[int, str]:
        return Tab(tab.port, tab.base).ask("GET", path)

    with ThreadPoolExecutor(200) as pool:
        answers = [*pool.map(ask, ["state", "", "section/files", "section/understood"] * 50)]
    assert {status for status, _ in answers} == {200}
    assert sum("f742" in text for _, text in answers) >= 50
    assert tab.state()["files"] == 7


@pytest.mark.slow
def test_sessions_do_not_meet_and_end_with_their_tabs(house: tuple[Tab, Path], tab: Tab) -> None:
    other = house[0].opened().holding(RECOVERED / "f036.csv")
    assert (tab.state()["files"], other.state()["files"]) == (0, 1)
    assert "f036" not in tab.ask("GET", "section/files")[1]
    folder = house[1] / other.base.split("/")[-2]
    other.ask("GET", "state?tab=2")
    other.ask("POST", "leave?tab=2")
    time.sleep(1.0)
    assert folder.exists()  # its other tab is open
    other.ask("POST", "leave?tab=1")
    other.ask("GET", "state?tab=3")  # loaded anew
    time.sleep(1.0)
    assert folder.exists()
    other.ask("POST", "leave?tab=3")
    until(lambda: not folder.exists(), 10)
    assert other.ask("GET", "")[0] == 410
    assert tab.ask("GET", "")[0] == 200


@pytest.mark.slow
def test_a_killed_worker_loses_nothing(house: tuple[Tab, Path], tab: Tab) -> None:
    tab.ask("POST", "example")
    assert "f742" in tab.ask("GET", "section/understood")[1]
    for process in processes("multiprocessing.spawn"):
        os.kill(process, signal.SIGKILL)
    assert "f742" in tab.ask("GET", "section/understood")[1]
    tab.ask("POST", "fit")
    (fit,) = until(lambda: processes("ldbb_bayes.app.worker"))
    os.kill(fit, signal.SIGKILL)
    until(lambda: not tab.state()["running"])
    assert "Nothing was lost" in tab.ask("GET", "section/fit")[1]
    tab.ask("POST", "fit")
    until(lambda: processes("ldbb_bayes.app.worker"))
    assert [
        path.name for path in (house[1] / tab.base.split("/")[-2] / "job").rglob("f*.csv")
    ]  # a copy of its own
    assert json.loads(tab.ask("POST", "cancel")[1])["outcome"] == {"cancelled": True}
    until(lambda: not processes("ldbb_bayes.app.worker"), 10)
    assert tab.state()["files"] == 7


def test_a_fit_of_a_silent_page_gives_way(
    house: tuple[Tab, Path], tab: Tab, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ldbb_bayes.app.session_registry.ABANDONED_S", 1.0)
    other = house[0].opened()
    for silent in (tab, other):
        silent.ask("POST", "example")
        silent.ask("POST", "fit")
    (first,) = until(lambda: processes("ldbb_bayes.app.worker"))
    until(lambda: other.state()["progress"]["step"] != "waiting")
    assert processes("ldbb_bayes.app.worker") != [first]
    assert "another fit was waiting" in tab.state()["outcome"]["refused"]
    assert other.ask("POST", "cancel")[0] == 200


def test_a_fit_gives_way_only_to_a_page_that_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ldbb_bayes.app.session_registry.ABANDONED_S", 1.0)
    pages = SessionRegistry(tmp_path, cast(AnsweringProcess, None))
    fitting = pages.begin("en")
    waiting = pages.begin("en")
    assert fitting is not None
    assert waiting is not None
    fitting.fit.process = cast(Any, SimpleNamespace(returncode=0))
    waiting.fit.task = cast(Any, SimpleNamespace(done=lambda: False))
    fitting.last_request_s -= 10.0
    waiting.last_request_s -= 10.0
    pages._stop_abandoned("fit")
    assert fitting.fit.outcome == {}
    waiting.last_request_s = time.monotonic()
    pages._stop_abandoned("fit")
    assert "another fit was waiting" in fitting.fit.outcome["refused"]


# ---- the search for the cheapest campaign

GOALS = {"goal_E_C0YX": "40 urad"}


def with_fit(house: tuple[Tab, Path], tab: Tab, fitted: Path) -> Tab:
    """A session with the results of a fit, as far as a search needs them."""
    folder = house[1] / tab.base.split("/")[-2]
    shutil.copytree(fitted / fields.RESULT, folder / fields.RESULT)
    return tab


def test_a_search_without_a_goal_says_what_to_type(
    house: tuple[Tab, Path], tab: Tab, fitted: Path
) -> None:
    with_fit(house, tab, fitted)
    status, answer = tab.ask("POST", "search", {"goal_C_XXX": " "})
    assert status == 200
    assert "No goal is stated yet" in json.loads(answer)["refused"]


def test_a_goal_that_cannot_be_read_is_refused_before_the_search(
    house: tuple[Tab, Path], tab: Tab, fitted: Path
) -> None:
    with_fit(house, tab, fitted)
    answer = json.loads(tab.ask("POST", "search", {"goal_C_XXX": "5"})[1])
    assert answer["wrong"] == "goal_C_XXX"
    assert "must be a number with its unit" in tab.ask("GET", "section/cheapest")[1]
    assert not tab.state()["searching"]


@pytest.mark.slow
def test_a_goal_that_no_circles_reach_is_explained_on_the_page(
    house: tuple[Tab, Path], tab: Tab, fitted: Path
) -> None:
    with_fit(house, tab, fitted)
    tab.ask("POST", "search", {"goal_E_XX1": "1e-6 ppm"})
    until(lambda: not tab.state()["searching"])
    assert "no number of circles brings U below" in tab.ask("GET", "section/cheapest")[1]
    assert tab.ask("GET", "result/cheapest-1.zip")[0] == 404


def test_a_second_search_of_a_page_is_refused(
    house: tuple[Tab, Path], tab: Tab, fitted: Path
) -> None:
    with_fit(house, tab, fitted)
    tab.ask("POST", "search", GOALS)
    status, answer = tab.ask("POST", "search", GOALS)
    assert status == 409
    assert "A search is running already" in answer
    tab.ask("POST", "stop")


def test_a_search_that_is_stopped_ends_its_process(
    house: tuple[Tab, Path], tab: Tab, fitted: Path
) -> None:
    with_fit(house, tab, fitted)
    tab.ask("POST", "search", GOALS)
    until(lambda: processes("ldbb_bayes.app.worker"))
    tab.ask("POST", "stop")
    until(lambda: not processes("ldbb_bayes.app.worker"), 10)
    assert "Stopped." in tab.ask("GET", "section/cheapest")[1]


def test_a_search_of_another_page_waits_for_its_turn(
    house: tuple[Tab, Path], tab: Tab, fitted: Path
) -> None:
    other = with_fit(house, house[0].opened(), fitted)
    with_fit(house, tab, fitted).ask("POST", "search", GOALS)
    (first,) = until(lambda: processes("ldbb_bayes.app.worker"))
    other.ask("POST", "search", GOALS)
    assert other.state()["search_progress"]["step"] == "waiting"
    assert processes("ldbb_bayes.app.worker") == [first]
    tab.ask("POST", "stop")
    until(lambda: processes("ldbb_bayes.app.worker") not in ([], [first]))
    other.ask("POST", "stop")
    other.ask("POST", "leave?tab=1")


def test_a_closed_tab_ends_its_search(house: tuple[Tab, Path], fitted: Path) -> None:
    closed = with_fit(house, house[0].opened(), fitted)
    closed.ask("POST", "search", GOALS)
    until(lambda: processes("ldbb_bayes.app.worker"))
    closed.ask("POST", "leave?tab=1")
    until(lambda: not processes("ldbb_bayes.app.worker"), 10)


def test_a_new_fit_forgets_what_a_search_found(tmp_path: Path) -> None:
    session = Session("key", tmp_path, "en")
    (session.search.folder / "cheapest").mkdir(parents=True)
    session.search.outcome = {"passages": []}
    session.forget_search()
    assert session.search.outcome == {}
    assert not session.search.folder.exists()


def test_a_search_of_a_silent_page_gives_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ldbb_bayes.app.session_registry.ABANDONED_S", 1.0)
    pages = SessionRegistry(tmp_path, cast(AnsweringProcess, None))
    searching = pages.begin("en")
    waiting = pages.begin("en")
    assert searching is not None
    assert waiting is not None
    searching.search.process = cast(Any, SimpleNamespace(returncode=0))
    waiting.search.task = cast(Any, SimpleNamespace(done=lambda: False))
    searching.last_request_s -= 10.0
    pages._stop_abandoned("search")
    assert "another search was waiting" in searching.search.outcome["refused"]


def processes(word: str) -> list[int]:
    """Children of this process whose command has a word."""
    numbers = []
    for task in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((task / "stat").read_text().rpartition(")")[2].split()[1])
            if parent == os.getpid() and word in (task / "cmdline").read_text().replace("\0", " "):
                numbers.append(int(task.name))
        except (OSError, ValueError, IndexError):
            continue
    return numbers


# ---- the command


@pytest.mark.slow
def test_the_command_prints_an_address_and_leaves_nothing(tmp_path: Path) -> None:
    """Even where an earlier one was ended by force."""
    started = [sys.executable, "-m", "ldbb_bayes", "app", "--no-browser"]
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    signals = {signal.SIGKILL: -9, signal.SIGHUP: 0, signal.SIGINT: 0}
    for stop_signal, code in signals.items():
        with subprocess.Popen(
            started, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
        ) as running:
            assert running.stdout is not None
            address = running.stdout.readline().strip()
            match = re.fullmatch(r"http://127\.0\.0\.1:(\d+)(/[\w-]{20,}/)", address)
            assert match is not None
            assert Tab(int(match[1]), match[2]).ask("GET", "")[0] == 303
            assert len([*tmp_path.glob("ldbb-bayes-*/*")]) == 1
            running.send_signal(stop_signal)
            _, stderr = running.communicate(timeout=20)
        assert running.returncode == code
        assert (
            "Traceback" not in stderr or stop_signal == signal.SIGKILL
        )  # of a process of Python's own that was just being started
    assert [*tmp_path.iterdir()] == []


def test_a_port_in_use_and_a_missing_library_are_said(
    invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    with server.listening(0) as listener:
        code, _, stderr = invoke("app", "--no-browser", "--port", listener.getsockname()[1])
    assert (code, "Choose another" in stderr) == (2, True)
    monkeypatch.setitem(sys.modules, "ldbb_bayes.app.server", None)
    code, _, stderr = invoke("app", "--no-browser")
    assert (code, "pip install 'ldbb-bayes[app]'" in stderr) == (2, True)


# ---- the same numbers


@pytest.mark.slow
def test_the_sheets_are_those_of_the_command(tab: Tab, invoke: Invoke, tmp_path: Path) -> None:
    folder = tmp_path / fields.FILES
    folder.mkdir()
    for path in RECOVERED.glob("f*.csv"):
        (folder / path.name).write_bytes(path.read_bytes())
    tab.holding(*sorted(folder.glob("*.csv")))
    tab.ask("POST", "entries", {"bar_U_um": "2", "balls": "G20", "tolerance": "G=40 µm"})
    tab.ask("POST", "fit")
    until(lambda: not tab.state()["running"], 180)
    options = (
        "--bar-U-um",
        2,
        "--balls",
        "G20",
        "--tolerance",
        "G=40 µm",
        "--yes",
        "--quiet",
        "--out",
        tmp_path / "out",
    )
    code, *_ = invoke("report", folder / "*.csv", *options)
    assert code == 0
    of_page = json.loads(tab.ask("GET", "result/report.json")[1])
    of_command = json.loads((tmp_path / "out/report.json").read_text())
    for report in (of_page, of_command):
        for key in ("started", "seconds"):
            report["provenance"].pop(key, None)
    assert of_page["tables"] == of_command["tables"]
    assert of_page["comparison"] == of_command["comparison"]
    assert of_page["design"] == of_command["design"]
    assert of_page["conformity"] == of_command["conformity"]
    assert of_page["state"] == of_command["state"]
    page = tab.ask("GET", "result/report.html")[1]
    page_of_command = (tmp_path / "out/report.html").read_text()
    drawing_or_time = re.compile(r"<svg.*?</svg>|T\d\d:\d\d:\d\d", re.S)
    assert drawing_or_time.sub("", page) == drawing_or_time.sub("", page_of_command)
    assert "script" not in tab.headers["content-security-policy"]
