"""A stated direction of travel that contradicts angles over several laps is asked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb

CCW_OF_TWO_LAPS = np.arange(0.0, 720.0, 5.0)


def written(folder: Path, direction: str, angles_deg: np.ndarray, above: str = "") -> Path:
    lines = [f"Direction: {direction}", above, "angle_deg,reading_um"]
    lines += [f"{angle:g},{k % 7}.25" for k, angle in enumerate(angles_deg)]
    path = folder / "300N.csv"
    path.write_text("\n".join([*filter(None, lines), ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("direction", "angles_deg", "above", "sense"),
    [
        ("CW", CCW_OF_TWO_LAPS, "", "CW"),
        ("CW", CCW_OF_TWO_LAPS % 360.0, "", "CW"),
        ("CCW", -CCW_OF_TWO_LAPS, "", "CW"),
        ("CCW", CCW_OF_TWO_LAPS, "Angles clockwise from +X", "CCW"),
    ],
)
def test_the_question_names_both_answers(
    tmp_path: Path, direction: str, angles_deg: np.ndarray, above: str, sense: str
) -> None:
    path = written(tmp_path, direction, angles_deg, above)
    run = {"CW": "CCW", "CCW": "CW"}[direction]
    with pytest.raises(
        lb.InputError,
        match=f"{direction} and angles that run {run} over 2.00 laps.*"
        f"--angle-sense {sense};.*--direction {run}",
    ):
        lb.import_campaign(path)


def test_angles_are_counted_the_other_way_once_their_sense_is_given(tmp_path: Path) -> None:
    path = written(tmp_path, "CW", CCW_OF_TWO_LAPS)
    layout = lb.reading.Layout(angle_sense="CW")
    (test,) = lb.import_campaign(path, layout=layout).campaign.tests
    np.testing.assert_allclose(test.angle_deg, -CCW_OF_TWO_LAPS)
    assert test.direction == "CW"


def test_angles_are_kept_once_the_direction_is_given(tmp_path: Path) -> None:
    path = written(tmp_path, "CW", CCW_OF_TWO_LAPS)
    layout = lb.reading.Layout(direction="CCW")
    (test,) = lb.import_campaign(path, layout=layout).campaign.tests
    np.testing.assert_allclose(test.angle_deg, CCW_OF_TWO_LAPS)
    assert test.direction == "CCW"


def test_the_angles_of_one_lap_may_have_been_sorted(tmp_path: Path) -> None:
    imported = lb.import_campaign(written(tmp_path, "CW", CCW_OF_TWO_LAPS[:72]))
    notes = [note.because for note in imported.assumptions if note.what == "direction"]
    assert "the angles run CCW: taken as sorted" in notes


def test_the_angles_of_a_closed_lap_may_have_been_sorted(tmp_path: Path) -> None:
    angles_deg = np.arange(0.0, 361.0, 10.0)
    imported = lb.import_campaign(written(tmp_path, "CW", angles_deg))
    notes = [note.because for note in imported.assumptions if note.what == "direction"]
    assert "the angles run CCW: taken as sorted" in notes


def test_falling_angles_headed_clockwise_are_asked_for_where_the_machine_ran_so(
    tmp_path: Path,
) -> None:
    path = tmp_path / "100N CW.csv"
    rows = [f"{360 - 10 * k};{(7 * k) % 11}.25" for k in range(36)]
    path.write_text("\n".join(["Angle CW [deg];Reading [um]", *rows, ""]))
    with pytest.raises(lb.InputError, match="give --angle-sense CCW; if the machine ran"):
        lb.import_campaign(path)
    layout = lb.reading.Layout(angle_sense="CCW")
    (test,) = lb.import_campaign(path, layout=layout).campaign.tests
    assert test.direction == "CW"
    assert test.angle_deg[1] - test.angle_deg[0] == pytest.approx(-10.0)


@pytest.mark.parametrize(
    ("header", "direction", "sign"),
    [
        ("Travelled angle [deg]", "CW", -1.0),
        ("Travelled angle [deg]", "CCW", 1.0),
        ("Zurückgelegter Winkel [°]", "CW", -1.0),
        ("Angle [deg]", "CW", 1.0),
    ],
)
def test_a_travelled_angle_is_counted_in_the_direction_of_travel(
    tmp_path: Path, header: str, direction: str, sign: float
) -> None:
    path = written(tmp_path, direction, CCW_OF_TWO_LAPS[:72])
    path.write_text(path.read_text().replace("angle_deg", header), encoding="utf-8")
    (test,) = lb.import_campaign(path).campaign.tests
    np.testing.assert_allclose(test.angle_deg, sign * CCW_OF_TWO_LAPS[:72])


def test_travelled_angles_of_both_directions_are_counted_each_its_own_way(tmp_path: Path) -> None:
    paths = []
    for direction in ("CW", "CCW"):
        folder = tmp_path / direction
        folder.mkdir()
        path = written(folder, direction, CCW_OF_TWO_LAPS[:72], above="Force: 300 N")
        path.write_text(path.read_text().replace("angle_deg", "Travelled angle [deg]"))
        paths.append(path.rename(folder / f"{direction}.csv"))
    imported = lb.import_campaign(paths)
    clockwise, counter_clockwise = imported.campaign.tests
    np.testing.assert_allclose(clockwise.angle_deg, -counter_clockwise.angle_deg)
    assert imported.layout.angle_sense is None
    again = lb.import_campaign(paths, layout=imported.layout).campaign
    np.testing.assert_allclose(again.tests[0].angle_deg, clockwise.angle_deg)


@pytest.mark.parametrize(("direction", "sign"), [("CW", -1.0), ("CCW", 1.0)])
def test_a_travelled_angle_begins_at_the_stated_start(
    tmp_path: Path, direction: str, sign: float
) -> None:
    path = written(tmp_path, direction, CCW_OF_TWO_LAPS[:72], above="Start angle: 90°")
    path.write_text(path.read_text().replace("angle_deg", "Travelled angle [deg]"))
    (test,) = lb.import_campaign(path).campaign.tests
    np.testing.assert_allclose(test.angle_deg, 90.0 + sign * CCW_OF_TWO_LAPS[:72])


def test_the_axis_at_which_a_travelled_angle_begins_is_asked_for(tmp_path: Path) -> None:
    path = written(tmp_path, "CW", CCW_OF_TWO_LAPS[:72], above="Start: +Y")
    path.write_text(path.read_text().replace("angle_deg", "Travelled angle [deg]"))
    with pytest.raises(lb.InputError, match=r"'Start: \+Y' in line 2 may name it.*--angle-zero"):
        lb.import_campaign(path)
    layout = lb.reading.Layout(angle_zero="+Y")
    (test,) = lb.import_campaign(path, layout=layout).campaign.tests
    np.testing.assert_allclose(test.angle_deg, 90.0 - CCW_OF_TWO_LAPS[:72])
