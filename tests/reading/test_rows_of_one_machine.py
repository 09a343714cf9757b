"""Tables whose rows are of several machines, or whose circles have one number on two days."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb


def table(folder: Path, header: str, *values: str) -> Path:
    """Write runs 1 and 2 once for each value of a further column."""
    lines = [f"{header};Run;Force [N];Angle [deg];Dev [um]"]
    for value in values:
        for run, force in ((1, 36), (2, 490)):
            lines += [f"{value};{run};{force};{5 * k};{0.1 * k:.2f}" for k in range(72)]
    path = folder / "all.csv"
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize(
    ("header", "values", "message"),
    [
        ("Machine", ("VMC 7", "VMC 8"), "line 146: machine_type must be .* 'VMC 8' after 'VMC 7'"),
        ("Maschine", ("VMC 7", "VMC 8"), "line 146: machine_type must be .* 'VMC 8' after 'VMC 7'"),
        ("Serial number", ("4711", "4712"), "line 146: serial_number must be .* give --serial-num"),
        ("Date", ("2025-03-01", "2026-03-01"), "line 146: date must be the same .* of test '1'"),
        ("Datum", ("01.03.2025", "13.03.2025"), "line 146: date must be the same .* of test '1'"),
    ],
)
def test_circles_of_two_are_not_joined(
    header: str, values: tuple[str, ...], message: str, tmp_path: Path
) -> None:
    with pytest.raises(lb.errors.InputError, match=message):
        lb.import_campaign(table(tmp_path, header, *values))


@pytest.mark.parametrize(("header", "value"), [("Machine", "VMC 7"), ("Date", "2025-03-01")])
def test_one_machine_and_one_day_are_fine(header: str, value: str, tmp_path: Path) -> None:
    tests = lb.import_campaign(table(tmp_path, header, value)).campaign.tests
    assert [len(test.angle_deg) for test in tests] == [72, 72]


def test_a_circle_may_be_run_over_midnight(tmp_path: Path) -> None:
    path = table(tmp_path, "Date", "2025-03-01")
    path.write_text(path.read_text().replace("01;2;490;3", "02;2;490;3"))
    assert len(lb.import_campaign(path).campaign.tests) == 2


def test_the_machine_may_be_said_by_an_option(tmp_path: Path) -> None:
    path = table(tmp_path, "Machine", "idle", "cutting")
    campaign = lb.import_campaign(path, machine_type="VMC 7").campaign
    assert [len(test.angle_deg) for test in campaign.tests] == [144, 144]
