"""Logs whose column of times has an unknown name, and notes on what the user states."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.lines_above import statements_in
from ldbb_bayes.reading.unit_lines import units_stated


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


@pytest.mark.parametrize(
    ("line", "seconds"),
    [
        ("Período de muestreo: 100 ms", "100 ms"),
        ("Sampling period = 0.1 s", "0.1 s"),
        ("Sampling rate: 10 Hz", "0.1 s"),
        ("Abtastfrequenz: 1 kHz", "0.001 s"),
        ("Sampling rate: high", None),
    ],
)
def test_the_time_between_samples_is_read(line: str, seconds: str | None) -> None:
    assert units_stated(line).get("time_scale") == seconds


def samples(folder: Path, step: int) -> Path:
    """Write a circle of 100 mm at 1257 mm/min with a row of a number for each 0.1 s."""
    lines = ["Force: 36 N", "Sampling period: 100 ms", "Time;Deviation [um]"]
    for number in range(0, 301 * step, step):
        reading_um = np.cos(2.0 * np.pi * number / (150.0 * step))
        lines.append(f"{number};{reading_um:.3f}")
    path = folder / "36N.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


def test_numbers_of_samples_are_times_by_the_sampling_period(tmp_path: Path) -> None:
    options = {"feed_mm_per_min": 1256.637, "radius_mm": 100.0}
    layout = Layout(direction="CCW")
    imported = lb.import_campaign(samples(tmp_path, 1), layout=layout, **options)
    (unit,) = [note.value for note in imported.assumptions if note.what == "unit of the time"]
    assert unit == "100 ms"
    assert np.ptp(imported.campaign.tests[0].angle_deg) == pytest.approx(358.8, abs=1.3)


def test_times_that_are_no_numbers_of_samples_keep_their_unit(tmp_path: Path) -> None:
    layout = Layout(direction="CCW", time_unit="ms", laps="keep")
    options = {"feed_mm_per_min": 1256.637, "radius_mm": 100.0}
    imported = lb.import_campaign(samples(tmp_path, 100), layout=layout, **options)
    assert np.ptp(imported.campaign.tests[0].angle_deg) == pytest.approx(358.8, abs=1.3)


@pytest.mark.parametrize(
    ("line", "field", "value"),
    [
        ("; Avance: 2000 mm/min   Radio nominal: 150 mm", "radius_mm", 150.0),
        ("公称半径,140 mm", "radius_mm", 140.0),
        ("Nominell radie;200 mm", "radius_mm", 200.0),
        ("Jari-jari: 150 mm", "radius_mm", 150.0),
        ("; Fuerza radial: 36 N", "force_N", 36.0),
        ("Forza radiale: 36 N", "force_N", 36.0),
    ],
)
def test_radius_and_force_in_further_words(line: str, field: str, value: float) -> None:
    (stated,) = statements_in([(1, line)])[field]
    assert stated.value == pytest.approx(value)


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
