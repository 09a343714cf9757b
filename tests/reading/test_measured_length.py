"""Lines which say that readings are of the radius or of the diameter."""

from __future__ import annotations

import pytest

from ldbb_bayes.reading.measured_length import leaves_length_open, measured_length_stated


@pytest.mark.parametrize(
    ("line", "measured"),
    [
        ("Grandeza;variação do diâmetro (não do raio)", "diameter"),
        ("Deviation of the diameter (not of the radius)", "diameter"),
        ("Values: radius, not diameter", "radius"),
        ("Messwerte nicht vom Durchmesser, sondern vom Radius", "radius"),
        ("Odchylka průměru", "diameter"),
        ("Écart de diamètre", "diameter"),
        ("偏差:直径", "diameter"),
        ("Desvio do raio", "radius"),
    ],
)
def test_radius_or_diameter_is_taken_from_words(line: str, measured: str) -> None:
    assert measured_length_stated(line) == {"measured": measured}


def test_a_denied_diameter_is_not_measured() -> None:
    line = "Readings not of the diameter"
    assert (measured_length_stated(line), leaves_length_open(line)) == ({}, False)


def test_both_lengths_state_none() -> None:
    assert measured_length_stated("variação do diâmetro e do raio") == {}
