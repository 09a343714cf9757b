"""What the first line of a file states holds for each table, unless another line states it anew."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb

ROWS = [f"{5 * k};{0.1 * k:.2f}" for k in range(72)]


def imported(folder: Path, first: str, second: str) -> tuple[lb.CircularTest, ...]:
    header = "Angle [deg];Reading [um]"
    path = folder / "log.txt"
    path.write_text("\n".join([first, header, *ROWS, second, header, *ROWS, ""]))
    return lb.import_campaign(path).campaign.tests


@pytest.mark.parametrize(
    "first",
    [
        "Load 238 N, ZX",
        "Load 238 N, ZX, CW",
        "Load 238 N in plane ZX",
        "Load 238 N (ZX)",
        "Load 238 N / ZX / R 100 mm",
        "Kraft 238 N, ZX-Ebene",
        "238 N ZX CW",
    ],
)
def test_a_plane_beside_a_load_holds_for_each_table(first: str, tmp_path: Path) -> None:
    planes = [test.plane for test in imported(tmp_path, first, "Load 400 N")]
    assert planes == ["ZX", "ZX"]


def test_a_radius_beside_a_load_holds_for_each_table(tmp_path: Path) -> None:
    tests = imported(tmp_path, "Load 238 N with radius 100 mm", "Load 400 N")
    assert [test.radius_mm for test in tests] == [100.0, 100.0]


def test_a_plane_that_a_further_table_states_is_its_plane(tmp_path: Path) -> None:
    planes = [test.plane for test in imported(tmp_path, "Load 238 N, ZX", "Load 400 N, YZ")]
    assert planes == ["ZX", "YZ"]
