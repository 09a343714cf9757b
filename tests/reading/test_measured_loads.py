"""A force or pressure that was measured in every row of a test: its mean is taken, and told."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb

N_ROWS = 72


def written(folder: Path, load: Callable[[int], float], header: str = "F [N]") -> Path:
    """Write a circle in steps of 5° with a column of loads."""
    lines = [f"angle_deg,reading_um,{header}"]
    lines += [f"{5 * k},{k % 7}.25,{load(k):.5f}" for k in range(N_ROWS)]
    path = folder / "circle.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


def around(middle: float, share: float) -> Callable[[int], float]:
    """Return loads that vary by a share of their mean, once in a turn."""
    return lambda k: middle * (1.0 + share * np.sin(2.0 * np.pi * k / N_ROWS))


def notes_on(imported: lb.reading.Imported, subject: str) -> list[tuple[str, str]]:
    return [(entry.value, entry.because) for entry in imported.assumptions if entry.what == subject]


@pytest.mark.parametrize("share", [0.004, 0.0199])
def test_the_mean_of_a_measured_force_is_taken(tmp_path: Path, share: float) -> None:
    (test,) = lb.import_campaign(written(tmp_path, around(250.0, share))).campaign.tests
    assert test.force_N == pytest.approx(250.0, rel=1e-6)


def test_the_mean_and_the_extremes_of_a_measured_force_are_told(tmp_path: Path) -> None:
    imported = lb.import_campaign(written(tmp_path, around(250.0, 0.004)))
    assert notes_on(imported, "force_N") == [
        ("250 N, the mean", "its column varies from 249 to 251 N")
    ]


def test_the_mean_is_in_newtons_whatever_the_unit(tmp_path: Path) -> None:
    (test,) = lb.import_campaign(written(tmp_path, around(0.25, 0.004), "F [kN]")).campaign.tests
    assert test.force_N == pytest.approx(250.0, rel=1e-5)


def test_the_mean_of_a_measured_pressure_is_taken(tmp_path: Path) -> None:
    path = written(tmp_path, around(2.0, 0.004), "pressure [bar]")
    (test,) = lb.import_campaign(path).campaign.tests
    assert test.pressure_bar == pytest.approx(2.0, rel=1e-5)


def test_a_constant_force_is_told_by_its_column_alone(tmp_path: Path) -> None:
    imported = lb.import_campaign(written(tmp_path, lambda _: 250.0))
    assert notes_on(imported, "force_N") == []


def two_nominal_forces(k: int) -> float:
    return 250.0 if k < N_ROWS / 2 else 252.0


def rising_from_zero(k: int) -> float:
    return min(250.0, 50.0 * k)


@pytest.mark.parametrize("load", [around(250.0, 0.021), two_nominal_forces, rising_from_zero])
def test_a_force_that_varies_otherwise_is_refused(
    tmp_path: Path, load: Callable[[int], float]
) -> None:
    with pytest.raises(lb.InputError, match=r"vary by at most 2 % .*--test-column.*--forces-N"):
        lb.import_campaign(written(tmp_path, load))


def test_a_force_that_varies_otherwise_is_read_once_its_value_is_given(tmp_path: Path) -> None:
    layout = lb.reading.Layout(forces_N=[250.0])
    path = written(tmp_path, around(250.0, 0.1))
    (test,) = lb.import_campaign(path, layout=layout).campaign.tests
    assert test.force_N == 250.0
