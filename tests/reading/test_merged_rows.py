"""Columns of conditions whose cells are merged, so that a value stands only in the first row."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb

CIRCLES = [(36.0, "CW"), (36.0, "CCW"), (490.0, "CW"), (490.0, "CCW")]


def table(folder: Path, header: str, first: list[str], further: list[str]) -> Path:
    """Write four circles; the first row of each begins with ``first``, the others with ``further``.

    An entry of the two lists holds the cells in front of the angle for one circle.
    """
    lines = [header]
    for above, below in zip(first, further, strict=True):
        for k in range(36):
            lines.append(f"{below if k else above};{10 * k};{0.1 * k + len(lines) / 100:.2f}")
    path = folder / "all.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


def test_forces_and_directions_hold_for_the_empty_cells_below(tmp_path: Path) -> None:
    first = ["36;CW", ";CCW", "490;CW", ";CCW"]
    path = table(tmp_path, "force_N;direction;angle_deg;reading_um", first, [";"] * 4)
    tests = lb.import_campaign(path).campaign.tests
    assert [(test.force_N, test.direction) for test in tests] == CIRCLES


def test_what_is_filled_is_told(tmp_path: Path) -> None:
    first = ["36;CW", "36;CCW", "490;CW", "490;CCW"]
    path = table(tmp_path, "force_N;direction;angle_deg;reading_um", first, [";"] * 4)
    notes = lb.import_campaign(path).assumptions
    (note,) = [note for note in notes if note.what == "filled downwards"]
    assert note.value == "'force_N', 'direction'"


def test_planes_hold_for_the_empty_cells_below(tmp_path: Path) -> None:
    first = ["XY;36", ";490", "YZ;36", ";490"]
    path = table(tmp_path, "plane;force_N;angle_deg;reading_um", first, [";"] * 4)
    tests = lb.import_campaign(path).campaign.tests
    assert [test.plane for test in tests] == ["XY", "XY", "YZ", "YZ"]


def test_a_test_without_a_force_is_refused(tmp_path: Path) -> None:
    first = ["a;36", "b;36", "c;", "d;490"]
    further = ["a;", "b;", "c;", "d;"]
    path = table(tmp_path, "test;force_N;angle_deg;reading_um", first, further)
    with pytest.raises(lb.InputError, match="must be a finite number, got an empty cell"):
        lb.import_campaign(path)


def test_a_single_missing_force_is_refused(tmp_path: Path) -> None:
    path = table(tmp_path, "force_N;angle_deg;reading_um", ["36"] * 4, ["36"] * 4)
    lines = path.read_text(encoding="utf-8").split("\n")
    lines[5] = lines[5].removeprefix("36")
    path.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(lb.InputError, match="must be a finite number, got an empty cell"):
        lb.import_campaign(path)
