"""Lines with a name beside each number are the rows of a table."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.layout import Layout

NUMBERS = [(5.0 * k, 0.1 * k) for k in range(72)]


def written(folder: Path, form: str, above: str = "Force = 36 N") -> Path:
    """Write a log with a line of the given form for each reading."""
    lines = [above, *[form.format(angle, reading) for angle, reading in NUMBERS]]
    path = folder / "run.log"
    path.write_text("\n".join([*lines, ""]))
    return path


@pytest.mark.parametrize(
    "form",
    [
        "angle={} reading={}",
        "ang={:.1f}, dev={:.3f}, F=36",
        "12:00 angle: {} deg, reading: {} um",
        "12:00:05 INFO θ={}° Δr={}µm",
        "pos[deg]={} dev[um]={} load[N]=36",
        "- {{angle: {}, reading: {}}}",
    ],
)
def test_each_line_is_a_row(form: str, tmp_path: Path) -> None:
    test = lb.import_campaign(written(tmp_path, form)).campaign.tests[0]
    assert test.force_N == 36.0
    assert (test.angle_deg[1], test.reading_um[1]) == (5.0, pytest.approx(0.1))


def test_units_behind_numbers_are_used(tmp_path: Path) -> None:
    path = written(tmp_path, "ang={}deg dev={}mm F=0.036kN")
    test = lb.import_campaign(path).campaign.tests[0]
    assert (test.force_N, test.reading_um[1]) == (36.0, pytest.approx(100.0))


def test_words_behind_names_are_used(tmp_path: Path) -> None:
    path = written(tmp_path, "ang={} dev={} dir=CW")
    assert lb.import_campaign(path).campaign.tests[0].direction == "CW"


def test_other_words_of_the_lines_are_told(tmp_path: Path) -> None:
    notes = lb.import_campaign(written(tmp_path, "INFO ang={} dev={}")).assumptions
    assert [note.value for note in notes if note.what == "columns not used"] == ["text"]


def test_lines_above_state_fields(tmp_path: Path) -> None:
    path = written(tmp_path, "ang={} dev={} F=36", "plane=ZX radius=100 mm")
    test = lb.import_campaign(path).campaign.tests[0]
    assert (test.plane, test.radius_mm) == ("ZX", 100.0)


def test_the_layout_reads_the_lines_again(tmp_path: Path) -> None:
    path = written(tmp_path, "ang={} dev={}", "")
    first = lb.import_campaign(path, layout=Layout(forces_N=[36.0]))
    again = lb.import_campaign(path, layout=first.layout.with_given({"forces_N": [36.0]}))
    assert list(again.campaign.tests[0].angle_deg) == list(first.campaign.tests[0].angle_deg)


def test_letters_with_numbers_of_a_controller_are_columns(tmp_path: Path) -> None:
    path = tmp_path / "36N.txt"
    lines = [
        f"N{10 * k:04d}C{angle:.3f}W{reading:.4f}" for k, (angle, reading) in enumerate(NUMBERS)
    ]
    path.write_text("\n".join(["(C=ANGLE DEG  W=DEVIATION)", *lines, ""]))
    layout = Layout(columns={"angle": "C", "reading": "W"}, reading_unit="um")
    (test,) = lb.import_campaign(path, layout=layout).campaign.tests
    assert (test.angle_deg[1], test.reading_um[1]) == (5.0, pytest.approx(0.1))
