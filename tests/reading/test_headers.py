"""What headers, lines above a table and names of files say: sign, unit and kind must be right, or
they are left alone."""

from __future__ import annotations

import math

import pytest
from campaigns import cases

from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.lines_above import directions_stated, statements_in
from ldbb_bayes.reading.names import load_in_name, load_is_ambiguous, plane_in_name, radius_in_name

CASES: dict[str, list[list[str]]] = cases(__file__, "headers.toml")


def said(line: str) -> dict[str, float]:
    return {key: statements[0].value for key, statements in statements_in([(1, line)]).items()}


@pytest.mark.parametrize(("header", "name", "unit"), CASES["units"])
def test_unit_of_a_header(header: str, name: str, unit: str) -> None:
    assert unit_of(header) == (name, "" if unit == "none" else unit)


@pytest.mark.parametrize(("line", "key", "value"), CASES["said"])
def test_a_line_states_a_value(line: str, key: str, value: str) -> None:
    assert said(line) == {key: pytest.approx(float(value), rel=1e-5)}


def test_two_values_in_one_line() -> None:
    assert said("Radius;100;Force;36") == {"radius_mm": 100.0, "force_N": 36.0}
    assert said("Feed 2000 mm/min, force 36 N") == {"feed_mm_per_min": 2000.0, "force_N": 36.0}


def test_a_state_of_the_mount_is_read_once() -> None:
    statements = statements_in([(1, "Readings are raw")])
    assert [statement.value for statement in statements["mount"]] == ["raw"]


@pytest.mark.parametrize(("one", "other"), CASES["left_alone"])
def test_left_alone(one: str, other: str) -> None:
    assert said(one) == said(other) == {}


@pytest.mark.parametrize("line", ["Force: 1,000 N", "Force: 1.000 N", "Feed: 2.000 mm/min"])
def test_a_mark_that_may_be_of_thousands_is_no_number(line: str) -> None:
    (value,) = said(line).values()
    assert math.isnan(value)


@pytest.mark.parametrize(("name", "bar", "newton"), CASES["loads"])
def test_a_load_in_a_name(name: str, bar: str, newton: str) -> None:
    expected = {"pressure_bar": bar, "force_N": newton}
    load = load_in_name([name])
    loads = {}
    if load is not None:
        loads[load.key] = load.value
    assert loads == {
        key: pytest.approx(float(value)) for key, value in expected.items() if value != "-"
    }
    assert load_in_name(["3.5bar 238N"], "force_N") == ("force_N", 238.0, "3.5bar 238N")
    assert load_in_name(["3.5bar 238N"], "pressure_bar") == ("pressure_bar", 3.5, "3.5bar 238N")


def test_a_load_is_of_the_kind_that_is_asked_for() -> None:
    names = ["F238", "2.5 bar"]
    assert load_in_name(names, "pressure_bar") == ("pressure_bar", 2.5, "2.5 bar")
    assert load_in_name(names, "force_N") == ("force_N", 238.0, "F238")
    assert load_in_name(["F238"], "pressure_bar") is None


def test_a_load_too_large_to_be_computed_with_is_none() -> None:
    assert load_in_name(["1e999 N", "238 N"]) == ("force_N", 238.0, "238 N")
    assert "force_N" not in statements_in([(1, "Force: 1e999 N")])


@pytest.mark.parametrize(("name", "radius", "plane", "number"), CASES["places"])
def test_radius_and_plane_in_a_name(name: str, radius: str, plane: str, number: str) -> None:
    radius_mm = radius_in_name(["36 N", name])
    assert ("-" if radius_mm is None else f"{radius_mm:g}") == radius
    assert (plane_in_name([name]) or "-", load_is_ambiguous([name])) == (plane, number == "cut")


@pytest.mark.parametrize(("line", "names", "directions"), CASES["directions"])
def test_direction(line: str, names: str, directions: str) -> None:
    assert (
        sorted(directions_stated([(1, line)], names.split(", ")))
        == directions.replace("none", "").split()
    )
