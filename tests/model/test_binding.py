"""The models bound last are kept, so that analyses of one campaign share them."""

from __future__ import annotations

import numpy as np
from campaigns import plan

import ldbb_bayes as lb
from ldbb_bayes.campaign.campaign import Direction
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.terms import Columns

MODEL = lb.HybridModel.first(1)
CAMPAIGN = plan()


def test_a_model_is_bound_to_a_campaign_once() -> None:
    assert MODEL.bind(CAMPAIGN) is lb.HybridModel.first(1).bind(CAMPAIGN)


def test_another_model_is_bound_anew() -> None:
    assert MODEL.with_degree(0).bind(CAMPAIGN).names != MODEL.bind(CAMPAIGN).names


def test_another_campaign_is_bound_anew() -> None:
    assert MODEL.bind(plan()) is not MODEL.bind(CAMPAIGN)


def test_tests_left_out_change_no_columns() -> None:
    """The only circle of a plane or direction left out, its columns are zero: predictions of it
    multiply draws of the coefficients without it by its columns."""
    tests = []
    for k, force_N in enumerate((100.0, 250.0, 400.0, 550.0, 700.0)):
        angle_deg = np.arange(0.0, 360.0, 10.0)
        plane = "ZX" if k == 4 else "YZ"
        direction: Direction = "CCW" if k == 3 else "CW"
        tests.append(
            lb.CircularTest(force_N, angle_deg, plane=plane, direction=direction, name=f"t{k}")
        )
    balls = lb.Instrument(work=lb.Ball(grade="G10"), tool=lb.Ball(grade="G10"))
    bound = lb.HybridModel.default(1).bind(lb.Plan(tests, plane="YZ", instrument=balls))
    names = names_of_columns(bound)
    assert {"pattern_CCW_YZ_cos4", "joint_load_X_seat", "drift_time_X"} <= set(names)
    for left_out in bound.test_names:
        others = [name for name in bound.test_names if name != left_out]
        assert names_of_columns(bound.keeping(others)) == names


def names_of_columns(bound: BoundModel) -> list[str]:
    names: list[str] = []
    for columns in bound.nuisance_columns:
        if isinstance(columns, Columns):
            names += columns.names
    return names
