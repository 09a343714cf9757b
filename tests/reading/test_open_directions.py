"""Lines that state a direction of travel by an arrow, a sign or a word such as "positive"."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb


def written(folder: Path, line: str) -> Path:
    lines = [line, "Angle [deg];Reading [um]"]
    lines += [f"{5 * k};{k % 7}.25" for k in range(72)]
    path = folder / "100N.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize(("arrow", "direction"), [("↺", "CCW"), ("⟲", "CCW"), ("↻", "CW")])
def test_an_arrow_is_a_direction(arrow: str, direction: str, tmp_path: Path) -> None:
    campaign = lb.import_campaign(written(tmp_path, f"Direction: {arrow}")).campaign
    assert campaign.tests[0].direction == direction


@pytest.mark.parametrize(
    "line", ["Direction: -1", "Direction: positive", "Drehrichtung: +", "Direction: forward"]
)
def test_a_sign_is_asked_about(line: str, tmp_path: Path) -> None:
    path = written(tmp_path, line)
    with pytest.raises(lb.InputError, match=r"direction must be CW or CCW, got .* in line 1"):
        lb.import_campaign(path)
    stated = lb.import_campaign(path, layout=lb.reading.Layout(direction="CW"))
    assert stated.campaign.tests[0].direction == "CW"


def test_a_missing_direction_is_not_asked_about(tmp_path: Path) -> None:
    assert lb.import_campaign(written(tmp_path, "Direction: -")).campaign.tests[0].direction is None


def test_columns_of_two_ways_need_a_direction(tmp_path: Path) -> None:
    lines = ["Angle [deg];Forward [um];Backward [um]"]
    lines += [f"{10 * k};{k % 7}.25;{k % 5}.75" for k in range(36)]
    path = tmp_path / "100N.csv"
    path.write_text("\n".join([*lines, ""]))
    layout = lb.reading.Layout(columns={"reading": ["Forward [um]", "Backward [um]"]})
    message = r"got column 'Forward \[um\]' beside 'Backward \[um\]'\. Write CW and CCW"
    with pytest.raises(lb.InputError, match=message):
        lb.import_campaign(path, layout=layout)
