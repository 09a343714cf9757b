"""Lines that name the two axes of the circle instead of its plane."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError


def circle(folder: Path, *lines_above: str) -> Path:
    lines = [*lines_above, "Angle [deg],Reading [um]"]
    for k in range(72):
        lines.append(f"{5 * k},{0.1 * k:.1f}")
    path = folder / "300N.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("lines", "plane"),
    [
        (["Axes: Z, X"], "ZX"),
        (["Axes: Y/Z"], "YZ"),
        (["Axes,Z,X"], "ZX"),
        (["Test axes = YZ"], "YZ"),
        (["Interpolating axes: Y and Z"], "YZ"),
        (["Messachsen: Z-X"], "ZX"),
        (["Achsen: Z und X"], "ZX"),
        (["Assi: Y e Z"], "YZ"),
        (["Оси: Z, X"], "ZX"),
        (["Horizontal axis: Z", "Vertical axis: X"], "ZX"),
        (["First axis: Y", "Second axis: Z"], "YZ"),
        (["Erste Achse: Z", "Zweite Achse: X"], "ZX"),
        (["Axes: X, Y, Z"], "XY"),
        (["Axes: X Y Z A C"], "XY"),
        (["Rotary axes: Z, X"], "XY"),
    ],
)
def test_axes_name_the_plane(lines: list[str], plane: str, tmp_path: Path) -> None:
    assert lb.import_campaign(circle(tmp_path, *lines)).campaign.plane == plane


@pytest.mark.parametrize("lines", [["Axes: X, Z"], ["Horizontal axis: X", "Vertical axis: Z"]])
def test_swapped_axes_are_asked_about(lines: list[str], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"got XZ in line .* give --plane ZX"):
        lb.import_campaign(circle(tmp_path, *lines))


def test_axes_that_contradict_the_plane_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="plane must be said once"):
        lb.import_campaign(circle(tmp_path, "Plane: XY", "Axes: Y, Z"))
