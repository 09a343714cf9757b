"""Number rounding, golden."""

from __future__ import annotations

import pytest

from ldbb_bayes.errors import InputError
from ldbb_bayes.report.rounding import round_uncertainty, value_and_uncertainty
from ldbb_bayes.units import display_name, display_unit


@pytest.mark.parametrize(
    ("value", "uncertainty", "expected"),
    [
        (0.0548, 0.003378, ("0.0548", "0.0034")),
        (-130.4, 14.2, ("-130", "14")),
        (1234.5, 987.0, ("1230", "990")),
        (123456.0, 9960.0, ("123000", "10000")),
        (0.123456, 0.00996, ("0.123", "0.010")),
        (0.0123, 0.0995, ("0.01", "0.10")),
        (-0.0004, 0.011, ("0.000", "0.011")),
        (5.0, 1.0, ("5.0", "1.0")),
        (0.1197, 0.00135, ("0.1197", "0.0014")),
        (3.0, 0.0, ("3.00", "0")),
        (3.0, float("nan"), ("3.00", "?")),
        (float("nan"), 1.0, ("?", "1.0")),
    ],
)
def test_two_significant_digits(value: float, uncertainty: float, expected: tuple[str, str]) -> None:
    assert value_and_uncertainty(value, uncertainty) == expected


def test_decimals() -> None:
    assert round_uncertainty(0.00337) == ("0.0034", 4)
    assert round_uncertainty(3370.0) == ("3400", -2)


def test_units_and_names() -> None:
    assert display_unit("mm/N") == (1e3, "µm/N")
    assert display_unit("1") == (1e6, "µm/m")
    with pytest.raises(InputError, match="unit must be one of"):
        display_unit("furlong")
    assert display_name("E_C0YX") == "E_C(0Y)X"
    assert display_name("E_Xt0") == "E_Xt0"
    assert display_name("C_XXX_1") == "C_XXX_1"
