"""Readings that are exactly those of another test, as in a file and its copy."""

from __future__ import annotations

from pathlib import Path

import ldbb_bayes as lb


def circle(folder: Path, name: str, scale: float) -> Path:
    lines = ["Angle [deg];Reading [um]"]
    lines += [f"{5 * k};{1 + k % 3 + scale * (20 + k % 24):.2f}" for k in range(72)]
    path = folder / f"{name}.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


def notes_on_readings(*paths: Path) -> list[str]:
    imported = lb.import_campaign(paths)
    return [note.because for note in imported.assumptions if note.what == "readings"]


def test_readings_of_a_copy_are_noted(tmp_path: Path) -> None:
    paths = [circle(tmp_path, "36N", 1.0), circle(tmp_path, "490N", 1.5)]
    assert notes_on_readings(*paths) == []
    paths.append(circle(tmp_path, "490N (1)", 1.5))
    assert notes_on_readings(*paths) == ["exactly those of '490N'"]


def test_few_different_readings_are_not_noted(tmp_path: Path) -> None:
    paths = [circle(tmp_path, "36N", 0.0), circle(tmp_path, "490N", 0.0)]
    assert notes_on_readings(*paths) == []


def test_zeros_in_a_row_are_noted_with_their_line(tmp_path: Path) -> None:
    path = circle(tmp_path, "36N", 1.0)
    lines = path.read_text(encoding="utf-8").splitlines()
    for k in range(31, 36):
        lines[k] = f"{lines[k].partition(';')[0]};0.00"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    assert notes_on_readings(path) == ["taken as they stand from line 32"]


def test_zeros_of_a_coarse_step_are_not_noted(tmp_path: Path) -> None:
    path = tmp_path / "36N.csv"
    readings = [round(2.0 * k / 10.0) * 5.0 - 40.0 for k in range(72)]
    lines = [f"{5 * k};{reading:.1f}" for k, reading in enumerate(readings)]
    path.write_text("\n".join(["Angle [deg];Reading [um]", *lines, ""]), encoding="utf-8")
    assert readings.count(0.0) == 5
    assert notes_on_readings(path) == []
