"""Stiffness by direction in a batch's table and in a trend: the numbers of `lb.stiffness`."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pandas as pd
import pytest
from batches import LINEAR, write_campaigns

import ldbb_bayes as lb
from ldbb_bayes.fleet.batch import Batch
from ldbb_bayes.fleet.campaign_row import _determined_numbers
from ldbb_bayes.fleet.dataset import FLEET_COLUMNS, read_fleet
from ldbb_bayes.fleet.stiffness_series import stiffness_series, stiffness_table

pytest.importorskip("pyarrow")
ESS = 150.0


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    return write_campaigns(tmp_path_factory.mktemp("campaigns"), 2)


@pytest.fixture(scope="module")
def batch(folders: list[str], tmp_path_factory: pytest.TempPathFactory) -> Batch:
    out = tmp_path_factory.mktemp("batch") / "out"
    return lb.fleet.run_batch(folders, out, model=LINEAR, ess=ESS, seed=3, compare=False)


def test_a_row_states_the_stiffness_of_the_fit(folders: list[str], batch: Batch) -> None:
    rule = lb.inference.StoppingRule(ess=ESS)
    campaign = lb.read_campaign(folders[1])
    posterior = lb.sample(LINEAR, campaign, sampler="independent", seed=3, rule=rule)
    (plane,) = lb.stiffness(posterior, [389.0]).planes
    row = batch.rows().iloc[1]
    np.testing.assert_allclose(row["k_min.mean"], plane.least.mean)
    np.testing.assert_allclose(row["k_max.ci_high"], plane.greatest.ci_high)
    np.testing.assert_allclose(row["k_ratio.sd"], plane.ratio.sd)
    np.testing.assert_allclose(row["C_XXX_minus_C_YYY.mean"], plane.difference.mean)
    np.testing.assert_allclose(row["principal_axis.mean"], plane.principal_axis.angle_deg)


def test_units_of_the_stiffness_are_those_of_the_table(batch: Batch) -> None:
    units = batch.rows().attrs["units"]
    assert units["k_min"] == "N/mm"
    assert units["principal_axis"] == "deg"


def row_of(unit: str, *, is_determined: bool) -> dict[str, Any]:
    numbers = dict.fromkeys(("mean", "sd", "median", "ci_low", "ci_high"), 1.0)
    return {"unit": unit, "is_determined": is_determined, **numbers}


def test_a_stiffness_without_upper_limit_keeps_its_lower_one() -> None:
    numbers = _determined_numbers(row_of("N/mm", is_determined=False))
    assert [name for name, value in numbers.items() if value is not None] == ["ci_low"]


def test_a_direction_that_is_not_determined_is_missing() -> None:
    numbers = _determined_numbers(row_of("deg", is_determined=False))
    assert set(numbers.values()) == {None}


def test_a_trend_states_the_stiffness_of_every_campaign(batch: Batch) -> None:
    rows = read_fleet(batch.out)
    trend = lb.fleet.find_trend(rows, include_misfits=True)
    visits = trend.stiffness["k_min"]
    assert [visit.campaign for visit in visits] == [visit.campaign for visit in trend.campaigns]
    assert [visit.mean for visit in visits] == rows["k_min.mean"].to_list()
    assert {visit.force_N for visit in visits} == {389.0}
    assert "Stiffness by direction, each campaign alone" in str(trend)


def test_the_record_of_a_trend_holds_the_stiffness(batch: Batch) -> None:
    trend = lb.fleet.find_trend(read_fleet(batch.out), include_misfits=True)
    record = json.loads(json.dumps(trend.as_dict()))
    first = record["stiffness"]["k_min"][0]
    assert first["U_k2"] == 2.0 * first["sd"]
    assert len(first["ci95"]) == 2


def test_intervals_of_the_stiffness_are_called_those_of_the_batch(batch: Batch) -> None:
    """The probability that a trend is asked for is that of its own intervals alone."""
    trend = lb.fleet.find_trend(read_fleet(batch.out), include_misfits=True, prob=0.5)
    record = trend.as_dict()
    assert "ci95" in record["stiffness"]["k_min"][0]
    assert "ci50" in record["parameters"]["C_XXX"]["change"]
    assert "each campaign alone, 95 % intervals of its batch" in " ".join(str(trend).split())


def test_a_batch_that_does_not_state_its_probability_has_the_default() -> None:
    rows = table_of({"k_min": [2e4, 3e4]}, ["XY", "XY"])
    probabilities = [visit.prob for visit in stiffness_series(rows, ["first", "second"])["k_min"]]
    stated = stiffness_series(rows.assign(prob=0.8), ["first", "second"])["k_min"]
    assert probabilities == [0.95, 0.95]
    assert [visit.prob for visit in stated] == [0.8, 0.8]


def test_the_printed_stiffness_is_the_median_as_on_sheets() -> None:
    rows = table_of({"k_min": [2e4, 3e4]}, ["XY", "XY"])
    rows["k_min.mean"] = 2.2e4
    rows["k_min.sd"] = 1e3
    rows["k_min.ci_low"] = 1.8e4
    rows["k_min.ci_high"] = 2.2e4
    assert stiffness_series(rows, ["first", "second"])["k_min"][0].text == "20.0 ± 2.0 N/µm"


def test_a_batch_written_without_stiffness_has_a_trend(batch: Batch) -> None:
    rows = read_fleet(batch.out)[list(FLEET_COLUMNS)]
    assert lb.fleet.find_trend(rows, include_misfits=True).stiffness == {}


def test_what_is_not_determined_is_said() -> None:
    rows = pd.DataFrame({"reference_force_N": [300.0], "planes": ["XY"]})
    for number in ("mean", "sd", "median", "ci_low", "ci_high"):
        rows[f"k_max.{number}"] = [None]
        rows[f"softest_direction.{number}"] = [None]
    rows["k_max.ci_low"] = [25e3]
    series = stiffness_series(rows, ["first"])
    assert series["k_max"][0].text == "at least 25 N/µm"
    assert series["softest_direction"][0].text == "not determined"
    assert "at least 25 N/µm" in str(stiffness_table(series))


def table_of(values: dict[str, list[float | None]], planes: list[str]) -> pd.DataFrame:
    """A batch's table with one value for all numbers of a quantity; None if it is not known."""
    rows = pd.DataFrame({"reference_force_N": [300.0, 400.0], "planes": planes})
    for name, of_campaigns in values.items():
        for number in ("mean", "sd", "median", "ci_low", "ci_high"):
            rows[f"{name}.{number}"] = of_campaigns
    return rows


def test_quantities_of_a_plane_that_was_not_tested_are_left_out() -> None:
    """A batch has a column for what any of its campaigns has."""
    rows = table_of(
        {
            "k_min": [2e4, 3e4],
            "C_XXX_minus_C_YYY": [1e-6, 1e-6],
            "softest_direction": [None, None],
            "k_min_YZ": [None, None],
            "C_YYY_minus_C_ZZZ": [None, None],
        },
        ["XY", "XY"],
    )
    series = stiffness_series(rows, ["first", "second"])
    assert set(series) == {"k_min", "C_XXX_minus_C_YYY", "softest_direction"}
    assert stiffness_table(series).heads == ("quantity", "first, at 300 N", "newest, at 400 N")


def test_other_planes_are_other_quantities() -> None:
    """Campaigns of one plane do not name it in the table; the stiffness in XY is not that in YZ."""
    rows = table_of(
        {
            "k_min": [2e4, 3e4],
            "C_XXX_minus_C_YYY": [1e-6, None],
            "C_YYY_minus_C_ZZZ": [None, 2e-6],
        },
        ["XY", "YZ"],
    )
    series = stiffness_series(rows, ["first", "second"])
    means = {name: [visit.mean for visit in visits] for name, visits in series.items()}
    assert means == {
        "k_min_XY": [2e4, None],
        "C_XXX_minus_C_YYY_XY": [1e-6, None],
        "k_min_YZ": [None, 3e4],
        "C_YYY_minus_C_ZZZ_YZ": [None, 2e-6],
    }
    assert series["k_min_XY"][1].text == "not determined"


def test_a_plane_is_one_quantity_whether_it_was_tested_alone_or_with_another() -> None:
    rows = table_of(
        {"k_min_YZ": [2e4, None], "k_min_ZX": [4e4, None], "k_min": [None, 3e4]}, ["YZ,ZX", "YZ"]
    )
    series = stiffness_series(rows, ["first", "second"])
    means = {name: [visit.mean for visit in visits] for name, visits in series.items()}
    assert means == {"k_min_YZ": [2e4, 3e4], "k_min_ZX": [4e4, None]}


def test_a_lower_limit_of_a_ratio_has_no_unit() -> None:
    rows = pd.DataFrame({"reference_force_N": [300.0], "planes": ["XY"]})
    for number in ("mean", "sd", "median", "ci_low", "ci_high"):
        rows[f"k_ratio.{number}"] = [None]
    rows["k_ratio.ci_low"] = [1.2]
    assert stiffness_series(rows, ["first"])["k_ratio"][0].text == "at least 1.2"


def test_a_trend_calls_quantities_as_the_sheets_do() -> None:
    names = ("k_min", "k_ratio", "softest_direction", "stiffest_direction", "principal_axis")
    planes = ["XY", "XY"]
    rows = table_of({name: [1.0, 2.0] for name in names}, planes)
    table = stiffness_table(stiffness_series(rows, ["first", "second"]))
    assert [row[0] for row in table.rows] == [
        "k_min",
        "k_max / k_min",
        "softest direction",
        "stiffest direction",
        "softer principal axis ψ",
    ]
    assert "from the plane's first axis" in table.caption


def test_a_trend_over_planes_names_the_plane_behind_the_quantity() -> None:
    values = {"k_ratio_XY": [1.0, 1.0], "k_min_YZ": [2.0, 2.0]}
    rows = table_of(values, ["XY,YZ", "XY,YZ"])
    table = stiffness_table(stiffness_series(rows, ["first", "second"]))
    assert [row[0] for row in table.rows] == ["k_max / k_min (XY)", "k_min (YZ)"]
