"""Units in sentences: one of several statements of a line, with remarks and words behind."""

from __future__ import annotations

import pytest

from ldbb_bayes.reading.unit_lines import units_stated
from ldbb_bayes.reading.unit_sentences import fraction_mentioned, units_in_sentences

READINGS = {
    "Readings in 0.0001 in, plus = bar longer": "0.0001 inch",
    "Readings in 0,001 mm; positiv = länger": "0.001 mm",
    "Readings in tenths (0.0001 in), plus = bar longer": "0.0001 inch",
    'Readings in tenths (0.0001"), plus = bar longer': "0.0001 inch",
    "Readings in tenths (0.0001 in)": "0.0001 inch",
    "Readings in microns (0.001 mm)": "um",
    "Readings in counts (0.1 µm)": "0.1 um",
    "Readings (0.0001 in), plus = bar longer": "0.0001 inch",
    "Messwerte in nm positiv = länger": "nm",
    "All readings are in mm (positive = longer)": "mm",
    "Readings in mm, radius 150 mm": "mm",
}
ANGLES = {
    "Angles in gon, positive clockwise from +X": "gon",
    "Winkel in gon, von +X aus im Uhrzeigersinn; Kraft 490 N": "gon",
    "Winkel in Grad, im Uhrzeigersinn": "deg",
    "Angles are in gon (positive counter-clockwise)": "gon",
    "Angles in gon from +X clockwise": "gon",
}
UNREAD = {
    "Readings in tenths, plus = bar longer": "tenths",
    "Readings in V, plus = bar longer": "V",
    "Readings in mm (0.0001 in)": "mm and 0.0001 inch",
}
NONE = [
    "Readings in the plane (XY), plus = longer",
    "Readings in order, clockwise",
    "Radius and all values in mm",
]


@pytest.mark.parametrize("line", READINGS)
def test_the_unit_of_readings_is_one_of_several_statements(line: str) -> None:
    assert units_in_sentences(line) == {"reading_unit": READINGS[line]}


@pytest.mark.parametrize("line", ANGLES)
def test_the_unit_of_angles_stands_beside_their_zero_and_sense(line: str) -> None:
    assert units_in_sentences(line) == {"angle_unit": ANGLES[line]}


@pytest.mark.parametrize("line", UNREAD)
def test_an_unknown_unit_is_kept_as_written(line: str) -> None:
    assert units_in_sentences(line) == {"reading_unit": UNREAD[line]}


@pytest.mark.parametrize("line", NONE)
def test_other_words_behind_in_are_no_units(line: str) -> None:
    assert units_in_sentences(line) == {}


def test_a_fraction_of_a_unit_in_a_line_about_readings_is_mentioned() -> None:
    assert fraction_mentioned("Readings: 1/10000 inch, plus = longer") == "0.0001 inch"


def test_a_fraction_of_a_unit_in_another_line_is_not_mentioned() -> None:
    assert fraction_mentioned("Roundness 0.0001 inch") == ""


@pytest.mark.parametrize(
    "units", ["deg; 1e-3 mm", "deg, 1E-3 mm", "deg; 10^-3 mm", "Grad; 10-3 mm", "deg / 10⁻³ mm"]
)
def test_a_power_of_ten_in_a_list_of_units_is_not_dropped(units: str) -> None:
    assert units_stated(f"Units: {units}") == {"reading_unit": units}


@pytest.mark.parametrize("units", ["deg; mm", "deg, 0.1 um"])
def test_a_list_of_units_without_a_power_of_ten_is_read(units: str) -> None:
    assert units_stated(f"Units: {units}")["angle_unit"] == "deg"
