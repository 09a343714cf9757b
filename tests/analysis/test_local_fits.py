"""Local fits: a window's posterior and least squares (the paper's Tables 7 and 8, in tests/studies), repeated forces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from campaigns import plan

import ldbb_bayes as lb
from ldbb_bayes.analysis.sensitivity import _pairs

COLUMNS = ["force_low_N", "force_high_N", "force_N", "tests", "parameter", "unit", "least_squares", "least_squares_u"]


def test_a_window_is_a_campaign_of_its_own(recovered: lb.Campaign) -> None:
    """Without truncation and force error: `marginals` and `least_squares` say the same, and fix what the model fixes."""
    model = lb.HybridModel.first(0).without("truncation", "force-error").fixing("C_CCY")
    some = recovered.select(["f036", "f238", "f364"])
    local = lb.local_fits(model, some)
    assert list(local.columns) == [*COLUMNS, "mean", "sd", "ci_low", "ci_high"]
    assert "C_CCY" not in set(local["parameter"])
    own = local[local["force_low_N"] == 238.0].set_index("parameter")
    window = recovered.select(["f238", "f364"])
    expected = lb.marginals(model, window).loc[own.index]
    np.testing.assert_allclose(own["mean"] / expected["sd"], expected["mean"] / expected["sd"], atol=0.02)
    np.testing.assert_allclose(own["sd"], expected["sd"], rtol=0.02)
    np.testing.assert_allclose((own["ci_high"] - own["ci_low"]) / (expected["ci_high"] - expected["ci_low"]), 1.0, atol=0.05)
    squares = lb.least_squares(window, fixed=("C_CCY",)).table
    np.testing.assert_allclose(own[["least_squares", "least_squares_u"]], squares[["estimate", "u"]], rtol=1e-9)


def test_pairs_of_force_levels() -> None:
    planned = plan((30,) * 5, forces_N=(400.0, 36.0, 400.0, 742.0, 200.0))
    assert _pairs(planned) == [("f036", "f200"), ("f200", "f400", "f400_2"), ("f400", "f400_2", "f742")]


def test_windows_that_lack_a_set_up_or_a_plane() -> None:
    """Low forces in one set-up, high ones in another; then in another plane: each window keeps the campaign's parameters."""
    model = lb.HybridModel.first(0).without("truncation", "ball-form", "discrepancy")
    for further in ({"setup": 2}, {"plane": "YZ", "setup": 2}):
        planned = plan((40,) * 4, forces_N=(50.0, 300.0, 500.0, 700.0))
        tests = (*planned.tests[:2], *(replace(test, **further) for test in planned.tests[2:]))
        campaign = model.simulate(replace(planned, tests=tests), seed=3).campaign
        table = lb.local_fits(model, campaign)
        assert set(table["parameter"]) == set(model.bind(campaign).names)
        assert np.isfinite(table["mean"]).all()
