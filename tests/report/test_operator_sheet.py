"""The operator's sheet for the next circle, in English and German."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from importlib.resources import files

import pandas as pd
import pytest
from campaigns import plan, simulated
from scipy.special import expit

import ldbb_bayes as lb
from ldbb_bayes.analysis.design import ModelSoFar, NextCircle
from ldbb_bayes.analysis.design.other_circles import CircleKind
from ldbb_bayes.inference.fit import Concern, ConcernKind
from ldbb_bayes.report import operator_sheet, wording
from ldbb_bayes.report.next_circle_text import aims_passages
from ldbb_bayes.report.passage_translation import untranslated_texts

MODEL = lb.HybridModel.first(1)
GERMAN = files("ldbb_bayes.report") / "templates" / "next_circle_de.toml"


@pytest.fixture(scope="module")
def step() -> NextCircle:
    """Two goals out of reach, one that is met, and a tolerance."""
    campaign = replace(simulated(plan()), name="Mill 7, spring")
    return lb.analysis.next_circle(
        MODEL,
        campaign,
        goals={"C_XXX": "0.1mm/N", "E_C0YX": "0.1urad", "C_YYY": "0.001 nm/N"},
        tolerances={"C_XXX": "55 nm/N"},
    )


def variants(step: NextCircle) -> Iterator[NextCircle]:
    """Every sentence that can stand on the sheet."""
    for circles in (1, 6):
        yield replace(step, circles=circles, finished=True, more_circles=0)
        yield replace(step, circles=circles, more_circles=circles)
    for direction, plane in (("CW", ""), ("", "YZ"), ("CCW", "ZX")):
        table = step.table.assign(direction=direction, plane=plane)
        yield replace(step, table=pd.DataFrame(table))
    for log_bayes_factor, probability in ((9.0, 0.9999), (-0.4, 0.4), (0.3, 0.57), (0.01, 0.502)):
        decided = abs(log_bayes_factor) > 3.0
        state = ModelSoFar(log_bayes_factor, 0.1, probability, decided, 0.2, decided)
        yield replace(step, model=state, model_is_aim=True)
    undecidable = replace(step.tolerances["C_XXX"], U_floor=2.0 * step.tolerances["C_XXX"].U_needed)
    yield replace(step, tolerances={"C_XXX": undecidable})
    zero = Concern(ConcernKind.ZERO, 0.12, 0.07, "bar_length_150")
    scale = Concern(ConcernKind.HYPER, 0.03, 0.01, "tau")
    prior = Concern(ConcernKind.PRIOR, 5.0, 3.0, "C_XXX")
    yield replace(step, concerns=(zero, scale, prior))
    yield replace(step, goals={}, model=None)
    yield replace(step, other_kinds=tuple(CircleKind), kinds_in_vain=())
    yield replace(step, other_kinds=(), kinds_in_vain=tuple(CircleKind))
    goal = step.goals["C_XXX"]
    hardly = replace(goal, probability=0.1, U_floor=0.9 * goal.limit, U_needed=0.8 * goal.limit)
    yield replace(step, goals={"C_XXX": hardly})


def test_every_text_of_the_sheet_has_german_words(step: NextCircle) -> None:
    for variant in (step, *variants(step)):
        passages = [
            *wording.next_circle_concerns(variant),
            *wording.next_circle_head(variant),
            *aims_passages(variant),
        ]
        assert untranslated_texts(passages, "de") == set()


def test_a_translation_has_the_places_of_its_text() -> None:
    for table in tomllib.loads(GERMAN.read_text(encoding="utf-8")).values():
        for english, german in table.items():
            assert set(re.findall(r"\{\w+\}", english)) == set(re.findall(r"\{\w+\}", german))


def words_of(page: str) -> str:
    return " ".join(re.sub(r"<[^>]+>", " ", page.partition("<body>")[2]).split())


def test_the_sheet_is_german(step: NextCircle) -> None:
    words = words_of(operator_sheet.page(step, step.plan(), "de"))
    assert words.startswith("Kreis 5 von Mill 7, spring Unerreichbar: U von E_C(0Y)X")
    assert "Am meisten hilft dieser Kreis: " in words
    assert "Fahrtrichtung wie bisher" in words
    assert "E_C(0Y)X ist unerreichbar, wie viele auch gefahren werden: Es bliebe ein U von" in words
    assert " µrad, gewünscht ist 0,10 µrad. C_YYY ist unerreichbar" in words
    assert words.endswith("Danach den Befehl mit den neuen Messwerten wieder aufrufen.")
    assert (
        "Wahrscheinlichkeit von 95 % oder mehr: U von C_XXX; U von E_C(0Y)X; U von C_YYY" in words
    )
    english = {"force", "the", "with", "and", "of", "next", "circle", "after", "reached", "again"}
    assert {word.lower() for word in re.findall(r"\w+", words)} & english == set()


def test_the_direction_is_german(step: NextCircle) -> None:
    plan = step.plan()
    clockwise = replace(plan, tests=(replace(plan.tests[0], direction="CW"),))
    both = replace(step, table=step.table.assign(direction="CCW"))
    words = words_of(operator_sheet.page(both, clockwise, "de"))
    assert "(Werkzeug), gegen den Uhrzeigersinn." in words
    assert "Fahrtrichtung im Uhrzeigersinn Startwinkel" in words
    assert "CW" not in words


def test_the_sheet_is_english_if_nothing_is_said(step: NextCircle) -> None:
    page = operator_sheet.page(step, step.plan())
    assert words_of(page).startswith("Circle 5 of Mill 7, spring Out of reach: U of E_C(0Y)X")
    within_reach = replace(step, more_circles=3)
    words = words_of(operator_sheet.page(within_reach, step.plan()))
    assert words.startswith("Circle 5 of Mill 7, spring Run next: ")
    assert '<html lang="en">' in page
    assert page == operator_sheet.page(step, step.plan(), "en")


@pytest.mark.parametrize(("language", "said"), [("en", "as time_s, in seconds"), ("de", "Skala")])
def test_the_sheet_asks_for_the_time_where_all_circles_state_theirs(
    language: str, said: str, step: NextCircle
) -> None:
    """Of a campaign in which one circle states no time, none counts."""
    next_plan = step.plan()
    assert next_plan.pilot is not None
    tests = [replace(test, time_s=360.0 * k) for k, test in enumerate(next_plan.pilot.tests)]
    timed = replace(next_plan, pilot=replace(next_plan.pilot, tests=tuple(tests)))
    assert said in words_of(operator_sheet.page(step, timed, language))
    assert said not in words_of(operator_sheet.page(step, next_plan, language))


def test_models_are_equally_probable_where_numbers_cannot_tell(step: NextCircle) -> None:
    def sentence(log_bayes_factor: float, error: float) -> str:
        probability = float(expit(log_bayes_factor))
        model = ModelSoFar(log_bayes_factor, error, probability, False, 0.2, True)
        return wording.next_circle_model(replace(step, model=model))[0]

    equal = "Constant and linear compliance are equally probable, within the numerical error (ln B"
    # The error of the probability is a quarter of that of ln B, but at least 0.01.
    for log_bayes_factor, error in ((0.01, 0.0), (-0.03, 0.001), (0.2, 0.3), (-0.2, 0.3)):
        assert sentence(log_bayes_factor, error).startswith(equal)
    assert sentence(0.2, 0.1).startswith("Linear compliance is the more probable: 0.550 (ln B")
    assert sentence(-0.2, 0.1).startswith("Constant compliance is the more probable: 0.550 (ln B")


def test_a_decision_is_said_to_be_on_the_average(step: NextCircle) -> None:
    model = ModelSoFar(-3.9, 0.1, 0.02, True, 1.0, True)
    sentences = wording.next_circle_model(replace(step, model=model))
    assert sentences[-1].endswith(
        "That is decided on this average; compare says whether other assumptions would change it."
    )


def planned() -> lb.Campaign:
    """A plan of four circles; the first ball is turned in one of them."""
    circles = plan().plan()
    first = replace(circles.tests[0], work_ball_deg=45.0)
    return replace(circles, name="Mill 7, autumn", tests=(first, *circles.tests[1:]))


def test_the_sheet_of_a_plan_lists_every_circle_in_order() -> None:
    page = operator_sheet.page_of_plan(planned())
    rows = re.findall(r"<tr>.*?</tr>", page, flags=re.DOTALL)[1:]
    assert len(rows) == len(planned().tests)
    for number, (row, test) in enumerate(zip(rows, planned().tests, strict=True), start=1):
        cells = re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row, flags=re.DOTALL)
        assert cells[0] == f"{number}"
        assert cells[1] == f"{test.force_N:.4g} N"
        assert f"{test.work_ball_deg:g}°" in cells
        assert f"{test.name}.csv" in cells
        assert cells[-2:] == ["", ""]
    common = re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", page)
    assert ("Radius", "150 mm") in common
    assert ("Tool ball turned", "0°") in common
    assert "Work ball turned" not in dict(common)


def test_the_sheet_names_the_machine_and_leaves_room_for_operator_and_date() -> None:
    plan = replace(planned(), machine_type="Force VMC", serial_number="4711")
    page = operator_sheet.page_of_plan(plan)
    assert "<dt>Machine</dt><dd>Force VMC, 4711</dd>" in page
    assert "<dt>Operator</dt><dd></dd>" in page
    assert "<dt>Date</dt><dd></dd>" in page
    # The machine's name is not translated, although the word is.
    assert "<dt>Maschine</dt><dd>Force VMC, 4711</dd>" in operator_sheet.page_of_plan(plan, "de")


def test_the_operator_is_told_how_to_turn_a_ball_where_one_is_turned() -> None:
    assert "about the normal of the circle&#39;s plane" in operator_sheet.page_of_plan(planned())
    unturned = plan().plan()
    assert "about the normal" not in operator_sheet.page_of_plan(unturned)
    for page in (operator_sheet.page_of_plan(planned()), operator_sheet.page_of_plan(unturned)):
        assert "Warm up the machine first" in page
        assert "Save the readings of each circle under its file name" in page


def test_the_sheet_of_a_plan_is_german() -> None:
    words = words_of(operator_sheet.page_of_plan(planned(), "de"))
    assert words.startswith("Kreise von Mill 7, autumn")
    assert "Werkstückkugel gedreht" in words
    english = {"force", "the", "with", "and", "of", "run", "circle", "circles", "save", "time"}
    assert {word.lower() for word in re.findall(r"\w+", words)} & english == set()


# ---- plans with several set-ups


def in_setups(circles: lb.Campaign, *setups: int) -> lb.Campaign:
    """The circles in these set-ups; those of set-up 2 are in another plane."""
    tests = []
    for test, setup in zip(circles.tests, setups, strict=True):
        plane = "YZ" if setup == 2 else "XY"
        tests.append(replace(test, setup=setup, plane=plane))
    return replace(circles, topology="wXFYZSt", tests=tuple(tests))


KEEP = "keep one set-up"
NUMBERS = "Enter the set-up numbers of this sheet as setup in campaign.toml: a bar that is mounted"


def test_the_sheet_says_when_to_mount_the_bar_anew() -> None:
    page = operator_sheet.page_of_plan(in_setups(planned(), 1, 1, 2, 2))
    words = words_of(page)
    assert "Circle Force Pressure Plane Set-up " in words
    assert re.search(r" 3 \S+ N \S+ bar YZ 2 ", words)
    assert "Mount the bar anew before circle 3 (set-up 2)." in words
    assert words.count("Mount the bar anew") == 1
    assert "Warm up the machine first, and write down the time" in words
    assert KEEP not in words
    assert NUMBERS not in words


def test_a_return_to_an_earlier_set_up_has_a_new_number() -> None:
    words = words_of(operator_sheet.page_of_plan(in_setups(planned(), 1, 2, 2, 1)))
    assert "Mount the bar anew before circle 2 (set-up 2)." in words
    assert "Mount the bar anew before circle 4 (set-up 3)." in words
    assert re.search(r" 4 \S+ N \S+ bar XY 3 ", words)
    assert NUMBERS in words


def test_one_set_up_is_kept() -> None:
    page = operator_sheet.page_of_plan(planned())
    assert KEEP in page
    assert "<dt>Set-up</dt><dd>1</dd>" in page
    assert "Mount the bar" not in page


def next_in_setup(step: NextCircle, setup: int) -> lb.Campaign:
    """The next circle in a set-up; the last of the circles so far was run in set-up 2."""
    so_far = in_setups(simulated(plan()), 1, 1, 2, 2)
    circle = in_setups(replace(step.plan(), pilot=None, adds_to_pilot=False), setup)
    return replace(circle, pilot=so_far, adds_to_pilot=True)


def test_the_next_circle_in_another_set_up_needs_the_bar_mounted_anew(step: NextCircle) -> None:
    words = words_of(operator_sheet.page(step, next_in_setup(step, 1)))
    assert "Mount the bar anew before circle 5 (set-up 3)." in words
    assert "Plane XY Set-up 3" in words
    assert NUMBERS in words
    assert KEEP not in words
    words = words_of(operator_sheet.page(step, next_in_setup(step, 2)))
    assert "Plane YZ Set-up 2" in words
    assert KEEP in words
    assert "Mount the bar" not in words


def test_the_sheet_is_german_with_several_set_ups(step: NextCircle) -> None:
    of_plan = words_of(operator_sheet.page_of_plan(in_setups(planned(), 1, 2, 2, 1), "de"))
    of_circle = words_of(operator_sheet.page(step, next_in_setup(step, 1), "de"))
    assert "Vor Kreis 4 das Messgerät neu einsetzen (Aufspannung 3)." in of_plan
    assert "Vor Kreis 5 das Messgerät neu einsetzen (Aufspannung 3)." in of_circle
    english = {"the", "with", "and", "of", "circle", "before", "mount", "up", "time"}
    for words in (of_plan, of_circle):
        assert "campaign.toml als setup eintragen: Ein neu eingesetztes Messgerät hat eine" in words
        assert {word.lower() for word in re.findall(r"\w+", words)} & english == set()


def test_circles_that_add_to_a_campaign_go_into_its_folder() -> None:
    added = replace(planned(), pilot=simulated(plan()), adds_to_pilot=True)
    page = operator_sheet.page_of_plan(added)
    assert "in the folder of the campaign so far" in page
    assert "in the folder of the plan" not in page
    assert "The bar stays as it was mounted for the circles before." in page
    german = operator_sheet.page_of_plan(added, "de")
    assert "Das Messgerät bleibt so eingesetzt wie bei den bisherigen Kreisen." in german


def test_circles_that_add_to_a_campaign_with_times_state_theirs() -> None:
    pilot = simulated(plan())
    timed = [replace(test, time_s=360.0 * k) for k, test in enumerate(pilot.tests)]
    added = replace(planned(), pilot=replace(pilot, tests=tuple(timed)), adds_to_pilot=True)
    assert "Enter the time of each circle there as time_s" in operator_sheet.page_of_plan(added)
    german = operator_sheet.page_of_plan(added, "de")
    assert "Dort auch die Zeit jedes Kreises als time_s eintragen" in german
    without_times = replace(added, pilot=pilot)
    assert "as time_s" not in operator_sheet.page_of_plan(without_times)


def test_certificates_that_are_not_bought_yet_are_named() -> None:
    pilot = simulated(plan())
    certified = lb.Instrument(work=lb.Ball(grade="G10"), mount_U_percent=2.0)
    counting = replace(planned(), pilot=pilot, instrument=certified)
    page = operator_sheet.page_of_plan(counting)
    assert "certificates that are still to be bought: [balls], [mount]." in page
    assert "[balls], [mount]. Was dort" in operator_sheet.page_of_plan(counting, "de")
    assert "to be bought" not in operator_sheet.page_of_plan(replace(planned(), pilot=pilot))
