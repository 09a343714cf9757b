"""Logs whose column of times has an unknown name, and notes on what the user states."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.layout import Layout


def log_over_time(folder: Path, header: str, above: str = "Force: 36 N") -> Path:
    """Write readings over 30 s, in which a circle of 100 mm is run once at 1257 mm/min."""
    lines = [above, f"{header};Deviation [um]"]
    for milliseconds in range(0, 30_001, 250):
        reading_um = np.cos(2.0 * np.pi * milliseconds / 15_000.0)
        lines.append(f"{milliseconds};{reading_um:.3f}")
    path = folder / "36N.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize("header", ["Zaman [ms]", "Waktu [ms]", "tempo_ms", "X [ms]"])
def test_a_column_in_a_unit_of_time_holds_the_times(header: str, tmp_path: Path) -> None:
    path = log_over_time(tmp_path, header)
    options = {"feed_mm_per_min": 1256.637, "radius_mm": 100.0}
    imported = lb.import_campaign(path, layout=Layout(direction="CCW"), **options)
    assert imported.layout.columns["time"] == header


def test_a_table_without_angles_is_refused_with_both_columns(tmp_path: Path) -> None:
    path = log_over_time(tmp_path, "colour")
    with pytest.raises(lb.InputError, match="Say which: --angle-column, or --time-column"):
        lb.import_campaign(path)


def circle(folder: Path, above: str) -> Path:
    """Write a circle in steps of 5° with a line above its table."""
    lines = [above, "Angle [deg],Reading [um]"]
    lines += [f"{5 * k},{k % 7}.25" for k in range(72)]
    path = folder / "36N.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize(("direction", "n_notes"), [("CCW", 0), (None, 1)])
def test_an_unclear_direction_is_noted_unless_the_user_states_it(
    direction: str | None, n_notes: int, tmp_path: Path
) -> None:
    path = circle(tmp_path, "Direction: as drawn")
    notes = lb.import_campaign(path, layout=Layout(direction=direction)).assumptions
    unclear = [note for note in notes if note.what == "direction" and "drawn" in note.because]
    assert len(unclear) == n_notes


def test_a_title_that_names_a_load_is_no_unclear_force(tmp_path: Path) -> None:
    path = circle(tmp_path, "하중 볼바 시험")
    notes = lb.import_campaign(path).assumptions
    assert [note.value for note in notes if note.what == "force_N"] == ["36 N"]
