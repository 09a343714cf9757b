"""Headers that blanks align: a name may hold single blanks."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb


def imported(folder: Path, *header: str, columns: int = 2) -> lb.Campaign:
    lines = [*header]
    for k in range(72):
        readings = "".join(f"{0.1 * k * number:10.3f}" for number in range(1, columns))
        lines.append(f"{5.0 * k:8.1f}{readings}")
    path = folder / "100N.txt"
    path.write_text("\n".join([*lines, ""]))
    return lb.import_campaign(path).campaign


@pytest.mark.parametrize(
    "header",
    [
        "bar angle [deg]    radial deviation [mm]",
        "Angle in deg    radial deviation in mm",
        "Angle [deg]  Reading [mm]",
    ],
)
def test_a_name_may_hold_blanks(header: str, tmp_path: Path) -> None:
    assert imported(tmp_path, header).tests[0].reading_um[1] == pytest.approx(100.0)


def test_loads_are_names_of_aligned_columns(tmp_path: Path) -> None:
    campaign = imported(tmp_path, "angle (deg)    2 bar     4 bar", "-" * 28, columns=3)
    assert [test.pressure_bar for test in campaign.tests] == [2.0, 4.0]


def test_a_header_without_enough_gaps_is_refused(tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match="the header must name every column"):
        imported(tmp_path, "bar angle in deg and radial deviation in mm")
