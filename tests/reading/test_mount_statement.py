"""Lines on the deflection of the work ball's mount: read, told, or asked."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.mount_statement import mount_state

RAW = [
    "Mount deflection not removed",
    "mount deflection has not been subtracted",
    "Deflection of the mount subtracted: no",
    "Readings include the deflection of the mount",
    "Readings not corrected for mount deflection",
    "Mount: uncorrected",
    "Readings without mount correction",
    "Nachgiebigkeit der Aufnahme nicht abgezogen",
    "Messwerte nicht um die Verformung der Kugelaufnahme korrigiert",
    "Das Nachgeben der Aufnahme ist in den Messwerten enthalten",
]
COMPENSATED = [
    "Mount deflection removed",
    "Deflection of the mount subtracted: yes",
    "Readings corrected for mount",
    "Mount deflection not included in the readings",
    "Durchbiegung der Halterung abgezogen",
]
OPEN = [
    "Mount deflection to be subtracted",
    "Subtract mount deflection",
    "Temperature not compensated but mount deflection is",
    "Mount stiffness not considered",
    "mount deflection 2.33 um/bar not removed",
    "Mount deflection partly removed",
    "Mount deflection is still in the readings",
]
OTHER = ["Ball mount: SK40", "Temperature compensation: off", "Aufnahme ohne Filter", "Mount"]


def written(folder: Path, line: str) -> Path:
    lines = [line, "angle_deg,reading_um"]
    lines += [f"{5 * k},{k % 7}.25" for k in range(72)]
    path = folder / "36N.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize("line", RAW)
def test_readings_with_the_deflection_are_raw(tmp_path: Path, line: str) -> None:
    assert not lb.import_campaign(written(tmp_path, line)).campaign.mount.compensated


@pytest.mark.parametrize("line", COMPENSATED)
def test_readings_without_the_deflection_are_compensated(tmp_path: Path, line: str) -> None:
    imported = lb.import_campaign(written(tmp_path, line))
    assert "mount" not in imported.unsaid
    assert imported.campaign.mount.compensated


@pytest.mark.parametrize("line", OPEN)
def test_a_line_that_is_not_clear_is_refused(tmp_path: Path, line: str) -> None:
    with pytest.raises(lb.InputError, match=r"Give --raw if they do, or --mount-um-per-bar"):
        lb.import_campaign(written(tmp_path, line))


@pytest.mark.parametrize("compensated", [True, False])
@pytest.mark.parametrize("line", OPEN)
def test_a_line_that_is_not_clear_gives_way_to_the_user(
    tmp_path: Path, line: str, compensated: bool
) -> None:
    stated = lb.campaign.MountCompensation(2.33, compensated=compensated)
    assert lb.import_campaign(written(tmp_path, line), mount=stated).campaign.mount == stated


@pytest.mark.parametrize("line", ["Mount deflection 2.33 µm/bar", "Raw data", "Rohdaten"])
def test_a_line_that_may_concern_the_mount_is_named(tmp_path: Path, line: str) -> None:
    assumptions = lb.import_campaign(written(tmp_path, line)).assumptions
    (note,) = [entry for entry in assumptions if entry.what == "mount"]
    assert note.because == f"line 1 says {line!r}, not understood"


@pytest.mark.parametrize("line", OTHER)
def test_other_lines_say_nothing_about_the_deflection(tmp_path: Path, line: str) -> None:
    assert "mount" in lb.import_campaign(written(tmp_path, line)).unsaid


def test_each_statement_of_a_line_is_read_alone(tmp_path: Path) -> None:
    path = written(tmp_path, "Not corrected: temperature; mount deflection removed")
    assert lb.import_campaign(path).campaign.mount.compensated


def test_two_negations_are_not_read() -> None:
    assert mount_state("Mount deflection not uncorrected") == ""
