"""Tables with one row for each value of a signal, and pivot tables: the message says what to do."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb
from ldbb_bayes.report.message_translation import in_language

ANGLES = range(0, 360, 5)
LONG = {
    "NodeId,Timestamp,Value": ["ns=2;s=Angle,{k:.1f},{angle}", "ns=2;s=Deviation,{k:.1f},{um}"],
    "Channel,Time [s],Value": ["Angle,{k:.1f},{angle}", "Deviation,{k:.1f},{um}"],
    "Signal;Index;Value;Unit": ["Angle;{k};{angle};deg", "Deviation;{k};{um};um"],
    "Kanal;Zeit [s];Wert": ["Winkel;{k:.1f};{angle}", "Abweichung;{k:.1f};{um}"],
}
PIVOTS = {
    "Row Labels,Sum of Deviation [um]": "{angle},{um}",
    "Average of Deviation,Column Labels\nRow Labels,36,238": "{angle},{um},{um}",
    "Zeilenbeschriftungen;Summe von Abweichung": "{angle};{um}",
}


def written(folder: Path, header: str, lines: list[str]) -> Path:
    rows = []
    for k, angle in enumerate(ANGLES):
        rows += [line.format(k=k, angle=angle, um=k % 7) for line in lines]
    path = folder / "36N.csv"
    path.write_text("\n".join([header, *rows, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize("header", LONG)
def test_rows_of_single_values_are_refused_with_what_to_export(header: str, tmp_path: Path) -> None:
    path = written(tmp_path, header, LONG[header])
    with pytest.raises(
        lb.InputError, match=r"36N.csv, line 1: .* one for each value of .*Export one row for each"
    ) as refusal:
        lb.import_campaign(path)
    assert "Export" not in str(in_language(str(refusal.value), "de"))


@pytest.mark.parametrize("header", PIVOTS)
def test_pivot_tables_are_refused_with_what_to_export(header: str, tmp_path: Path) -> None:
    path = written(tmp_path, header, [PIVOTS[header]])
    with pytest.raises(lb.InputError, match=r"36N.csv, line \d: .*Export the rows that") as refusal:
        lb.import_campaign(path)
    assert "Export" not in str(in_language(str(refusal.value), "de"))


@pytest.mark.parametrize(
    ("header", "line"),
    [
        ("Channel,Angle [deg],Value", "A,{angle},{um}"),
        ("Channel,Angle [deg],Value [um]", "Bar,{angle},{um}"),
    ],
)
def test_a_column_of_channels_beside_angles_is_read(header: str, line: str, tmp_path: Path) -> None:
    (test,) = lb.import_campaign(written(tmp_path, header, [line])).campaign.tests
    assert list(test.angle_deg) == list(ANGLES)


def test_columns_that_the_user_names_are_read(tmp_path: Path) -> None:
    header = "Row Labels,Sum of Deviation [um]"
    layout = lb.reading.Layout(columns={"angle": 1, "reading": 2}, angle_unit="deg")
    path = written(tmp_path, header, ["{angle},{um}"])
    (test,) = lb.import_campaign(path, layout=layout).campaign.tests
    assert list(test.angle_deg) == list(ANGLES)
