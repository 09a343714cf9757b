"""The operator's sheet of the page: which circles to run, and when to mount the bar anew."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from campaigns import in_setups, plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.app.operator_rows import circle_rows, effort_row, pilot_row
from ldbb_bayes.app.result_requests import operator_sheet
from ldbb_bayes.app.templates import Templates

KEEP = {"en": "Keep one set-up", "de": "Aufspannung beibehalten"}
TURN = {
    "en": "counterclockwise as the angles of the circle count. Its position",
    "de": "gegen den Uhrzeigersinn, wie die Winkel des Kreises zählen. Ihre Stellung",
}
STAYS = {
    "en": "The bar stays as it was mounted for the circles before.",
    "de": "Das Messgerät bleibt so eingesetzt wie bei den bisherigen Kreisen.",
}
MOUNT = {
    "en": "Mount the bar anew before circle 3 (set-up 2).",
    "de": "Vor Kreis 3 das Messgerät neu einsetzen (Aufspannung 2).",
}


def sheet(planned: lb.Campaign, language: str) -> str:
    """The words of the sheet."""
    found = {
        **effort_row(planned),
        **circle_rows(planned),
        "pilot": pilot_row(planned),
        "minutes": 60.0,
    }
    registry: Any = SimpleNamespace(templates=Templates())
    session: Any = SimpleNamespace(language=language)
    page = operator_sheet(registry, session, found)
    return " ".join(re.sub(r"<[^>]+>", " ", page).split())


@pytest.mark.parametrize("language", ["en", "de"])
def test_the_sheet_says_when_to_mount_the_bar_anew(language: str) -> None:
    words = sheet(in_setups(plan(), 1, 1, 2, 2), language)
    assert MOUNT[language] in words
    assert {"en": " set-up direction ", "de": " Aufspannung Richtung "}[language] in words
    assert re.search(r" 3 \S+ \S+ YZ 2 ↻ ", words)
    assert re.search(r" 4 \S+ \S+ YZ 2 (?!↻)", words)
    assert KEEP[language] not in words


def test_planes_and_radii_to_set_up_are_not_called_set_ups() -> None:
    circles = plan()
    in_two_planes = replace(circles.tests[0], plane="YZ")
    words = sheet(replace(circles, tests=(*circles.tests[1:], in_two_planes)), "en")
    assert "planes and radii to set up: 2;" in words
    assert "set-ups: 2" not in words


@pytest.mark.parametrize("language", ["en", "de"])
def test_one_set_up_is_kept(language: str) -> None:
    words = sheet(plan(), language)
    assert KEEP[language] in words
    assert "↻" not in words
    assert not re.search("Mount the bar|neu einsetzen|set-up direction|Aufspannung Richtung", words)


def test_a_return_to_the_set_up_of_the_circles_so_far_has_a_new_number() -> None:
    so_far = in_setups(simulated(plan()), 1, 1, 2, 2)
    added = replace(in_setups(plan(), 1, 1, 1, 1), pilot=so_far, adds_to_pilot=True)
    rows = circle_rows(added)
    assert [row["setup"] for row in rows["tests"]] == ["3"] * 4
    assert not rows["keeps_setup"]
    words = sheet(added, "en")
    assert "Mount the bar anew before circle 1 (set-up 3)." in words
    assert "Enter the set-up numbers of this sheet as setup in campaign.toml" in words


@pytest.mark.parametrize("language", ["en", "de"])
def test_the_sheet_says_about_which_axis_and_in_which_sense_to_turn_a_ball(language: str) -> None:
    circles = plan()
    assert TURN[language] not in sheet(circles, language)
    turned = replace(circles.tests[0], tool_ball_deg=45.0)
    assert TURN[language] in sheet(replace(circles, tests=(*circles.tests[1:], turned)), language)


@pytest.mark.parametrize("language", ["en", "de"])
def test_the_sheet_of_circles_that_are_added_says_that_the_bar_stays(language: str) -> None:
    assert STAYS[language] not in sheet(plan(), language)
    added = replace(plan(), pilot=simulated(plan()), adds_to_pilot=True)
    assert STAYS[language] in sheet(added, language)
