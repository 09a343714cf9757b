"""Words of G-code in columns and lines: ``G`` with the numbers 2 and 3, and ``R100 F1000``."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb

ROWS = "".join(f"{10 * k};{(7 * k) % 11}.25\n" for k in range(36))


def table(folder: Path, header: str, *words: str) -> Path:
    lines = [f"Run;{header};Force [N];Angle [deg];Dev [um]"]
    for run, word in enumerate(words, start=1):
        lines += [f"{run};{word};300;{10 * k};{(7 * k + run) % 11}.25" for k in range(36)]
    path = folder / "all.csv"
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize(
    ("header", "words"),
    [("G", ("2", "3")), ("G", ("02", "03")), ("G-Code", ("G02", "G03")), ("G", ("2.0", "3.0"))],
)
def test_a_column_of_arcs_states_the_direction(
    header: str, words: tuple[str, str], tmp_path: Path
) -> None:
    tests = lb.import_campaign(table(tmp_path, header, *words)).campaign.tests
    assert [test.direction for test in tests] == ["CW", "CCW"]


@pytest.mark.parametrize(("header", "words"), [("G", ("1", "2")), ("Group", ("2", "3"))])
def test_other_numbers_and_headers_state_no_direction(
    header: str, words: tuple[str, str], tmp_path: Path
) -> None:
    tests = lb.import_campaign(table(tmp_path, header, *words)).campaign.tests
    assert [test.direction for test in tests] == [None, None]


def test_a_column_of_planes_is_asked_for(tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match=r"got planes in column 'G'.*rename the header"):
        lb.import_campaign(table(tmp_path, "G", "17", "18"))


@pytest.mark.parametrize("line", ["R100 F1000", "F1000, R100", "r=100. f=1000."])
def test_a_line_of_radius_and_feed_states_both(line: str, tmp_path: Path) -> None:
    path = tmp_path / "300N.csv"
    path.write_text(f"{line}\nAngle [deg];Dev [um]\n{ROWS}")
    campaign = lb.import_campaign(path).campaign
    assert campaign.tests[0].radius_mm == 100.0


@pytest.mark.parametrize("line", ["R3 F1000", "R100 F238", "Run R100 F1000 of 5"])
def test_other_lines_with_the_letters_are_only_noted(line: str, tmp_path: Path) -> None:
    path = tmp_path / "300N.csv"
    path.write_text(f"{line}\nAngle [deg];Dev [um]\n{ROWS}")
    assert lb.import_campaign(path).campaign.tests[0].radius_mm in (None, 150.0)


def test_the_feed_of_such_a_line_gives_the_angles_of_a_log(tmp_path: Path) -> None:
    # A circle of radius 100 mm takes 37.7 s at 1000 mm/min, and a quarter of it 9.42 s.
    path = tmp_path / "300N.csv"
    rows = "".join(f"{0.37699 * k:.5f};{(7 * k) % 11}.25\n" for k in range(101))
    path.write_text(f"R100 F1000\nStart: 0 deg; Direction: CCW\nTime [s];Dev [um]\n{rows}")
    (test,) = lb.import_campaign(path).campaign.tests
    assert test.angle_deg[25] - test.angle_deg[0] == pytest.approx(90.0, abs=0.01)
