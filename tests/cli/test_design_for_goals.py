"""The command ``design --goal``: from goals to the cheapest campaign."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from campaigns import Invoke

import ldbb_bayes as lb

GOAL = ("--goal", "E_C0YX=25urad", "--forces", "36,742")


@pytest.mark.slow
@pytest.mark.usefixtures("few_states")
def test_a_goal_gives_a_plan_with_its_numbers_and_costs(tmp_path: Path, invoke: Invoke) -> None:
    out = tmp_path / "cheapest"
    folder = lb.embedded_campaign()
    options = ("--minutes-per-circle", 4, "--minutes-per-setup", 20, "--price-per-hour", 120)
    code, stdout, _ = invoke("design", folder, *GOAL, *options, "--json", "--out", out)
    assert code == 0
    record = json.loads(stdout)
    assert record == json.loads((out / "goals.json").read_text())
    best = record["plans"][0]
    assert len(lb.read_campaign(out).tests) == best["circles"]
    assert best["minutes"] == 4 * best["circles"] + 20 + 5
    assert best["price"] == pytest.approx(2 * best["minutes"])
    sheet = (out / "sheet.html").read_text(encoding="utf-8")
    assert all(f"{test.name}.csv" in sheet for test in lb.read_campaign(out).tests)


def test_a_goal_that_is_not_reached_ends_with_code_1(
    folder: Path, tmp_path: Path, invoke: Invoke
) -> None:
    out = tmp_path / "plan"
    code, stdout, _ = invoke("design", folder, "--goal", "E_XX1=1e-6 ppm", "--out", out)
    assert code == 1
    words = " ".join(stdout.split())
    assert "no number of circles brings U below" in words
    assert f"Written: {out}/goals.json; there is no plan" in words
    assert [path.name for path in out.iterdir()] == ["goals.json"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--goal", "C_XXX"), "--goal must be NAME=U"),
        (("--goal", "C_XXX=5"), "goal of C_XXX must be a number with its unit"),
        (("--goal", "C_XXX=-5%"), "goal of C_XXX must be an uncertainty above 0"),
        (("--goal", "C_XXX=5%", "--tests", 6), "goals must go without tests"),
        (("--goal", "C_XXX=5%", "--certificates", "bar"), "--certificates must be NAME=PRICE"),
        (("--goal", "C_XXX=5%", "--certificates", "bar=x"), "Write it like 'bar=150'"),
        (("--goal", "C_XXX=5%", "--directions", "up"), "--directions must be one of CW, CCW, both"),
        (("--goal", "C_XXX=5%", "--language", "fr"), "language must be one of"),
        (("--hours", 2), "--hours must go with --goal"),
        (("--certificates", "bar=150"), "--certificates must go with --goal"),
    ],
)
def test_what_makes_no_sense_is_refused(
    folder: Path, invoke: Invoke, options: tuple[object, ...], message: str
) -> None:
    code, stdout, stderr = invoke("design", folder, *options)
    assert code == 2
    assert stdout == ""
    assert message in stderr
