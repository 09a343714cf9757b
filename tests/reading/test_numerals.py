"""Numbers and times of day as people write them, by hand-worked examples."""

from __future__ import annotations

import re

import numpy as np
import pytest
from campaigns import cases, refuses
from hypothesis import given
from hypothesis import strategies as st

from ldbb_bayes.reading.numerals import decimal_mark, number, numbers_in, seconds_of

CASES = cases(__file__, "numerals.toml")


@pytest.mark.parametrize(("cells", "decimal", "values"), CASES["numbers"])
def test_cells_are_read_with_their_decimal_mark(
    cells: list[str], decimal: str, values: list[float]
) -> None:
    assert (decimal_mark("here", enumerate(cells, start=1)) or "") == decimal
    np.testing.assert_allclose(
        numbers_in("here", "x", range(1, 9), cells, decimal or None), values, rtol=1e-15
    )


@pytest.mark.parametrize(("cell", "decimal"), [("0.310", ","), ("0,310", "."), ("007.310", ",")])
def test_no_thousands_begin_with_a_zero(cell: str, decimal: str) -> None:
    """With the wrong decimal mark, 0.310 would be read as 310."""
    with pytest.raises(ValueError):
        number(cell, decimal)


def test_what_is_no_number() -> None:
    for cell in (
        "1,23,4.5",
        "12,34.5",
        "1_0",
        "0_310",
        "0x10",
        "",
        "--1",
        "1e",
        "nan",
        "∞",
        "1.2.3",
        "12 30",
        "12'30",
        "0 36",
    ):
        refuses(
            "here, line 3: x must be a finite number", numbers_in, "here", "x", [3], [cell], "."
        )


@pytest.mark.parametrize(
    ("cell", "decimal"),
    [
        ("1,234.5,6", "."),
        ("1.234,5.6", ","),
        ("1 234.5 7", "."),
        ("1'234,5'7", ","),
        ("1.5,234,567", ","),
        ("nan", "."),
        ("inf", "."),
        ("NaN", ","),
        ("1e999", "."),
        ("1e999", ","),
    ],
)
def test_marks_after_the_decimal_mark_and_words_are_no_number(cell: str, decimal: str) -> None:
    with pytest.raises(ValueError, match=re.escape(cell)):
        number(cell, decimal)


@given(st.floats(-1e6, 1e6), st.sampled_from(".,"), st.integers(0, 6))
def test_a_number_written_any_way_comes_back(value: float, decimal: str, digits: int) -> None:
    marks = str.maketrans({",": "," if decimal == "." else ".", ".": decimal})
    written = f"{value:,.{digits}f}".translate(marks)
    assert numbers_in("here", "x", [1], [written], decimal)[0] == pytest.approx(
        round(value, digits), rel=1e-12, abs=1e-12
    )


@pytest.mark.parametrize(("cells", "since"), CASES["times_of_day"])
def test_times_of_day(cells: list[str], since: list[float]) -> None:
    """They go on over midnight, or over the hour; by clocks of twelve hours, and with zones."""
    np.testing.assert_allclose(seconds_of("here", range(len(cells)), cells), since)
    refuses("here, line 7: time must be as in", seconds_of, "here", [6, 7], [cells[0], "12.5"])
