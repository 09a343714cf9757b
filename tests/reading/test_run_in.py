"""The run-in of a log over time: a line states it, or a note names the line that may."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb

ABOVE = ["Force 36 N", "Feed 2000 mm/min", "Radius 150 mm", "Direction CCW"]


# Readings in one turn at 2000 mm/min on 150 mm, ten in a second: 2π · 150 / 2000 · 60 · 10.
ONE_TURN = 283


def log(folder: Path, line: str, n_readings: int) -> Path:
    """Write a log with a line above it, ten readings a second."""
    rows = [f"{0.1 * k:.1f};{k % 7}" for k in range(n_readings)]
    path = folder / "log.txt"
    path.write_text("\n".join([line, *ABOVE, "time [s];Reading [um]", *rows, ""]))
    return path


def note_on_run_in(path: Path) -> tuple[str, str]:
    """Return value and reason of the run-in of a log."""
    notes = lb.import_campaign(path).assumptions
    (note,) = [note for note in notes if note.what == "overshoot_deg"]
    return note.value, note.because


@pytest.mark.parametrize(
    "line",
    ["Einlauf 45 Grad", "run-in 45 deg", "Überlauf: 45 °", "Einlaufwinkel: 45°", "Overrun 45 deg"],
)
def test_a_stated_run_in_is_used(line: str, tmp_path: Path) -> None:
    assert note_on_run_in(log(tmp_path, line, 400)) == ("45 °", "line 1")


@pytest.mark.parametrize("line", ["Overlap 45 deg", "Nachlauf 45°", "Einlauf 30 min"])
def test_a_line_that_may_state_a_run_in_is_told(line: str, tmp_path: Path) -> None:
    path = log(tmp_path, line, ONE_TURN)
    assert note_on_run_in(path) == ("0°", f"line 1 says {line!r}, not understood")


@pytest.mark.parametrize("n_turns", [1, 2, 3])
def test_a_log_of_whole_turns_begins_on_the_circle(n_turns: int, tmp_path: Path) -> None:
    path = log(tmp_path, "Log", n_turns * ONE_TURN)
    assert note_on_run_in(path)[0] == "0°"


def test_the_run_in_of_a_log_longer_than_a_turn_is_asked_for(tmp_path: Path) -> None:
    """The 400 readings cover 400 · 0.1 s · 2000/60 mm/s / 150 mm = 509°."""
    path = log(tmp_path, "Log", 400)
    with pytest.raises(lb.InputError, match=r"log.txt: .* got 509° of readings. Give --overshoot"):
        lb.import_campaign(path)


def test_a_line_that_may_state_the_run_in_is_quoted_in_the_question(tmp_path: Path) -> None:
    path = log(tmp_path, "Overlap 45 deg", 400)
    with pytest.raises(lb.InputError, match=r"and 'Overlap 45 deg' in line 1\. Give --overshoot"):
        lb.import_campaign(path)


@pytest.mark.parametrize("run_in_deg", [0.0, 45.0])
def test_the_answer_reads_the_log(run_in_deg: float, tmp_path: Path) -> None:
    path = log(tmp_path, "Log", 400)
    layout = lb.reading.Layout(overshoot_deg=run_in_deg)
    (test,) = lb.import_campaign(path, layout=layout).campaign.tests
    step_deg = 0.1 * 2000.0 / 60.0 / 150.0 * 180.0 / 3.141592653589793
    before_circle = round(run_in_deg / step_deg)
    assert test.angle_deg[0] == pytest.approx(before_circle * step_deg - run_in_deg)
    assert test.reading_um[0] == before_circle % 7


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("R=150", "line 1 says 'R=150'"),
        ("Circle R150", "line 1 says 'R150'"),
        ("D150", "line 1 says D150, not taken"),
        ("R=100", "line 1 says R=100, not taken"),
    ],
)
def test_a_length_that_agrees_with_the_usual_radius_is_not_called_unused(
    line: str, reason: str, tmp_path: Path
) -> None:
    path = tmp_path / "36N.csv"
    rows = [f"{5 * k};{k % 7}" for k in range(72)]
    path.write_text("\n".join([line, "Angle [deg];Reading [um]", *rows, ""]))
    notes = lb.import_campaign(path).assumptions
    assert [note.because for note in notes if note.what == "radius_mm"] == [reason]
