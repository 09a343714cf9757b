"""Readings from which the mean of their circle was subtracted."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb


def written(folder: Path, header: str, line: str = "Operator: A. Reader") -> Path:
    lines = [line, f"Angle [deg];{header}"]
    lines += [f"{5 * k};{k % 7}.25" for k in range(72)]
    path = folder / "100N.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "header",
    [
        "Deviation from mean [um]",
        "Reading minus mean [um]",
        "Reading - mean [um]",
        "Abweichung vom Mittelwert [um]",
        "Deviation from the least-squares circle [um]",
        "Reading (mean removed) [um]",
    ],
)
def test_a_header_of_readings_without_mean_is_refused(header: str, tmp_path: Path) -> None:
    path = written(tmp_path, header)
    with pytest.raises(lb.InputError, match="how it grows with force"):
        lb.import_campaign(path)
    stated = lb.import_campaign(path, layout=lb.reading.Layout(zero="deviation"))
    assert stated.campaign.tests[0].reading_um[:3].tolist() == [0.25, 1.25, 2.25]


@pytest.mark.parametrize("line", ["Mean removed: yes", "Mittelwert abgezogen", "Mean was removed"])
def test_a_line_about_a_removed_mean_is_refused(line: str, tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match=r"in line 1\. Without its mean"):
        lb.import_campaign(written(tmp_path, "Reading [um]", line))


@pytest.mark.parametrize(
    "header", ["Mean deviation [um]", "Deviation from nominal [um]", "Mittelwert [um]"]
)
def test_means_of_laps_are_readings(header: str, tmp_path: Path) -> None:
    campaign = lb.import_campaign(written(tmp_path, header, "Mean removed: no")).campaign
    assert campaign.tests[0].reading_um[:3].tolist() == [0.25, 1.25, 2.25]
