"""What a reader sees: numbers rounded after the GUM, one set of units, and an order that does not
hang on rounding."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from campaigns import cases, refuses
from hypothesis import given
from hypothesis import strategies as st

from ldbb_bayes import units
from ldbb_bayes.errors import InputError

CASES = cases(__file__, "units.toml")

PREFIXES = {"µ": 1e-6, "n": 1e-9}


def test_units_for_reading_are_the_inside_units_in_other_words() -> None:
    """mm, N and rad in µm, nrad, kN and m: by the powers of ten that the labels state."""
    metres = {
        "mm/N": 1e-3,
        "rad/N": 1.0,
        "rad/(N mm)": 1e3,
        "1": 1.0,
        "1/mm": 1e3,
        "rad": 1.0,
        "mm": 1e-3,
    }
    for unit, in_si in metres.items():
        factor, label = units.display_unit(unit)
        assert factor == pytest.approx(in_si / PREFIXES[label[0]])
        for power, suffix, words in (
            ((1, "/N", " per kN"), (2, "/N^2", " per kN²")) if "N" in unit else ()
        ):
            changing = units.display_unit(unit + suffix)
            assert changing == (pytest.approx(factor * 1e3**power), label + words)


@given(
    st.sampled_from(sorted(filter(None, units.DISPLAY_UNITS))),
    st.floats(-1e3, 1e3, allow_subnormal=False),
)
def test_what_is_read_is_written_back(unit: str, value: float) -> None:
    """Every unit for reading, its number as it stands in a table, and the inside unit itself."""
    factor, label = units.display_unit(unit)
    for text, expected in (
        (f"{value!r}{label}", value / factor),
        (f"{value!r} {unit}".replace("-", "−"), value),
    ):
        assert units.to_inside(text, unit) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("text", "unit", "expected"), CASES["typed"])
def test_units_as_they_are_typed(text: str, unit: str, expected: float) -> None:
    assert units.to_inside(text, unit) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    "text",
    [
        "0.5",
        "18 N/µm",
        "0,5 nm/N",
        "nm/N",
        "5 nm",
        "5 nm/N per kN",
        "nan nm/N",
        "5 nm//N",
        "5 furlong",
    ],
)
def test_a_number_of_another_kind_is_refused(text: str) -> None:
    with pytest.raises(
        InputError,
        match=(
            r"^--target must be a number with its unit, got .* Write it in nm/N, like 0.5 nm/N\.$"
        ),
    ):
        units.to_inside(text, "mm/N", "--target")


NUMBERS = st.lists(st.integers(-1000, 1000), max_size=12)


@given(NUMBERS, st.integers(0, 2**32 - 1))
def test_ranked_is_a_sort_that_rounding_does_not_change(values: list[int], seed: int) -> None:
    keys = [
        value * (1.0 + 1e-12 * x)
        for value, x in zip(
            values, np.random.default_rng(seed).normal(size=len(values)), strict=True
        )
    ]
    assert [values[i] for i in units.ranked(range(len(values)), keys.__getitem__)] == sorted(
        values, reverse=True
    )
    assert units.ranked(range(len(values)), keys.__getitem__) == units.ranked(
        range(len(values)), values.__getitem__
    )


def test_ranked_keeps_the_order_of_ties_and_infinities_first() -> None:
    keys = {"a": 1.0, "b": 1.0 + 1e-9, "c": np.inf, "d": 2.0}
    assert units.ranked("abcd", keys.__getitem__) == ["c", "d", "a", "b"]


@pytest.mark.parametrize(("value", "uncertainty", "expected"), CASES["two_digits"])
def test_two_significant_digits(value: float, uncertainty: float, expected: list[str]) -> None:
    assert list(units.value_and_uncertainty(value, uncertainty)) == expected


@given(st.floats(1e-3, 1e3), st.floats(1.0001, 10.0))
def test_a_value_above_a_limit_reads_as_above_it(limit: float, ratio: float) -> None:
    texts = units.digits_apart(limit, [ratio * limit, limit])
    assert float(texts[0]) < float(texts[1])
    assert texts[2] == texts[0]


def test_units_and_names() -> None:
    refuses("unit must be one of", units.display_unit, "furlong")
    names = ("E_C0YX", "E_A0YZ", "E_Xt0", "C_XXX_1", "C_ZZA", "C_XYX")
    assert [units.display_name(name) for name in names] == ["E_C(0Y)X", "E_A(0Y)Z", *names[2:]]
    assert [units.inside_name(units.display_name(name)) for name in names] == list(names)
    assert [name for name in names if units.is_direct(name)] == ["C_ZZA"]


@pytest.mark.parametrize(("mean", "sd", "interval", "unit", "expected"), CASES["stated"])
def test_a_result_as_it_is_written(
    mean: float, sd: float, interval: list[float], unit: str, expected: list[Any]
) -> None:
    *numbers, ends, label = expected
    assert units.state(mean, sd, (interval[0], interval[1]), unit) == units.Statement(
        *numbers, tuple(ends), label
    )


@pytest.mark.parametrize(("mean", "sd", "interval", "unit", "expected"), CASES["in_a_sentence"])
def test_in_a_sentence(
    mean: float, sd: float, interval: tuple[float, float], unit: str, expected: str
) -> None:
    """GUM 7.2.6: the value to the place of the uncertainty given with it."""
    assert units.plus_minus(mean, sd, interval, unit) == expected


def test_stiffness() -> None:
    """1 / 54.8 nm/N = 18.2 N/µm; only a lower limit where C may be a fifth of its median or
    less."""
    assert units.stiffness(5.48e-5, (4.82e-5, 6.13e-5)) == "18.2 [16.3, 20.7]"
    assert units.stiffness(5.48e-5, (5.47e-5, 5.49e-5)) == "18.248 [18.215, 18.282]"
    assert units.stiffness(5.48e-5, (0.0, 6.13e-5)) == "at least 16.3"
    assert units.stiffness(1e-6, (-1e-6, 3e-6)) == "at least 333"
    assert units.stiffness(1e-5, (1e-8, 6e-5)) == "at least 16.7"
    assert units.stiffness(4.337e-5, (8.7e-6, 1.445e-4)) == "23 [7, 115]"


@pytest.mark.parametrize(("text", "expected"), CASES["typeset"])
def test_units_are_typeset(text: str, expected: str) -> None:
    assert units.typeset(text) == expected


def test_numbers_stay_with_their_units() -> None:
    text = units.keep_with_units("U = 3.1 nm/N at 100 N, 0.5 ± 1.3 µm of 12 Nights")
    assert text == "U = 3.1\u00a0nm/N at 100\u00a0N, 0.5\u00a0±\u00a01.3\u00a0µm of 12 Nights"
    text = units.keep_with_units("ΔC_CXY ± 9.2 nrad/N; ΔC_CCY ± 0.13 µrad/(N m) (assumed)")
    assert "ΔC_CXY\u00a0±\u00a09.2\u00a0nrad/N; ΔC_CCY\u00a0±\u00a0" in text
    assert "0.13\u00a0µrad/(N\u00a0m) (assumed)" in text
    assert units.keep_with_units("C_CXY ±\u00a09") == "C_CXY\u00a0±\u00a09"


@pytest.mark.parametrize(("value", "text"), [(999.4, "999"), (999.7, "1000"), (1234.5, "1234")])
def test_three_digits_need_no_power_of_ten(value: float, text: str) -> None:
    assert units.three_digits(value) == text


@pytest.mark.parametrize(("text", "unit"), [("1e999 mm", "mm"), ("1e308 m", "mm"), ("1e999", "")])
def test_a_quantity_is_finite(text: str, unit: str) -> None:
    refuses("must be a finite number", units.to_inside, text, unit)


def test_a_result_with_heavy_tails_is_stated_by_its_interval() -> None:
    """A few very large values dominate u; of a normal distribution ± U is stated."""
    assert not units.needs_interval(1.4, 0.066, (1.27, 1.53))
    assert units.needs_interval(1.4, 0.46, (1.27, 1.53))
    assert units.plus_minus(1.4e-6, 0.46e-6, (1.27e-6, 1.53e-6), "mm/N") == (
        "1.40 [1.27, 1.53] nm/N"
    )
    assert units.state(1.4e-6, 0.46e-6, (1.27e-6, 1.53e-6), "mm/N").expanded == "+0.13 / −0.13"


@given(st.floats(-50.0, 50.0).filter(lambda value: abs(value) >= 1e-3), st.integers(1, 3))
def test_a_signed_number_keeps_its_sign(value: float, decimals: int) -> None:
    text = units.with_sign(value, decimals)
    assert float(text) * value > 0.0
    assert abs(float(text) - value) <= 0.5001 * 10.0**-decimals


@pytest.mark.parametrize("value", [0.0, -0.0, -1e-9, 1e-9])
def test_zero_has_no_sign(value: float) -> None:
    assert units.with_sign(value, 1) == "0.0"
