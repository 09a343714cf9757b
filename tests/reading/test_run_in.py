"""The run-in of a log over time: a line states it, or a note names the line that may."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb

ABOVE = ["Force 36 N", "Feed 2000 mm/min", "Radius 150 mm", "Direction CCW"]


def note_on_run_in(folder: Path, line: str) -> tuple[str, str]:
    """Return value and reason of the run-in of a log with a line above it."""
    rows = [f"{0.1 * k:.1f};{k % 7}" for k in range(400)]
    path = folder / "log.txt"
    path.write_text("\n".join([line, *ABOVE, "time [s];Reading [um]", *rows, ""]))
    notes = lb.import_campaign(path).assumptions
    (note,) = [note for note in notes if note.what == "overshoot_deg"]
    return note.value, note.because


@pytest.mark.parametrize(
    "line",
    ["Einlauf 45 Grad", "run-in 45 deg", "Überlauf: 45 °", "Einlaufwinkel: 45°", "Overrun 45 deg"],
)
def test_a_stated_run_in_is_used(line: str, tmp_path: Path) -> None:
    assert note_on_run_in(tmp_path, line) == ("45 °", "line 1")


@pytest.mark.parametrize("line", ["Overlap 45 deg", "Nachlauf 45°", "Einlauf 30 min"])
def test_a_line_that_may_state_a_run_in_is_told(line: str, tmp_path: Path) -> None:
    assert note_on_run_in(tmp_path, line) == ("0°", f"line 1 says {line!r}, not understood")


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
