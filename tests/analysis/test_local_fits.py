"""Local fits: the paper's Tables 7 and 8, the posterior of a window by other means, windows of repeated forces."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.analysis.local_fits import windows
from ldbb_bayes.errors import InputError

COLUMNS = ["force_low_N", "force_high_N", "force_N", "tests", "parameter", "unit", "least_squares", "least_squares_u"]


@pytest.fixture(scope="module")
def local(recovered: lb.Campaign) -> pd.DataFrame:
    return lb.local_fits(lb.HybridModel.default(1), recovered)


def test_least_squares_are_tables_7_and_8(local: pd.DataFrame, root: Path) -> None:
    """Every printed number within 1.05 half-units of its last digit."""
    assert list(local.columns) == [*COLUMNS, "mean", "sd", "ci_low", "ci_high"]
    checked = 0
    for table in ("table_7_local_compliances", "table_8_local_geometric_errors"):
        printed = pd.read_csv(root / "data" / "published_tables" / f"{table}.csv", dtype=str)
        for _, row in printed.iterrows():
            own = local[
                (local["force_low_N"] == float(row["force_low_N"])) & (local["force_high_N"] == float(row["force_high_N"]))
            ]
            found = own.set_index("parameter")["least_squares"]
            for name, text in row.items():
                if str(name).startswith("force_"):
                    continue
                mantissa, _, exponent = text.upper().partition("E")
                half_unit = 0.5 * 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
                key = str(name).replace("(", "").replace(")", "")
                assert abs(found[key] - float(text)) <= 1.05 * half_unit, (name, row["force_low_N"])
                checked += 1
    assert checked == 65


def test_least_squares_uncertainty_is_the_textbook_one() -> None:
    """s² (JᵀJ)⁻¹ of plain matrices."""
    campaign = simulated(plan((60, 60), forces_N=(36.0, 742.0)), seed=3)
    found = lb.local_fits(lb.HybridModel.default(0), campaign).set_index("parameter")
    rows = []
    for test in campaign.tests:
        c, s, radius = np.cos(test.angles_rad()), np.sin(test.angles_rad()), 150.0
        force = float(test.force_N or 0.0)
        compliance = [c**2, c * s, s**2, radius * c**2 * s, radius * c * s**2, radius**2 * c**2 * s**2]
        geometry = [radius * c**2, radius**2 * c**2 * s, radius**2 * s**2 * c, radius * s**2, radius * c * s, c, s]
        rows.append(np.column_stack([force * np.column_stack(compliance), np.column_stack(geometry)]))
    jacobian = np.vstack(rows)
    scale = np.linalg.norm(jacobian, axis=0)
    readings = np.concatenate([test.readings_mm() for test in campaign.tests])
    estimate, (square,), *_ = np.linalg.lstsq(jacobian / scale, readings, rcond=None)
    covariance = np.linalg.inv((jacobian / scale).T @ (jacobian / scale)) * square / (120 - 13)
    np.testing.assert_allclose(found["least_squares"], estimate / scale, rtol=1e-8)
    np.testing.assert_allclose(found["least_squares_u"], np.sqrt(np.diag(covariance)) / scale, rtol=1e-8)


def test_posterior_of_a_window(recovered: lb.Campaign) -> None:
    """Without truncation and force error a window is a campaign of its own: `marginals` says the same."""
    model = lb.HybridModel.default(0).without("truncation", "force-error")
    local = lb.local_fits(model, recovered)
    own = local[local["force_low_N"] == 238.0].set_index("parameter")
    expected = lb.marginals(model, recovered.select(["f238", "f364"])).loc[own.index]
    np.testing.assert_allclose(own["mean"] / expected["sd"], expected["mean"] / expected["sd"], atol=0.02)
    np.testing.assert_allclose(own["sd"], expected["sd"], rtol=0.02)
    np.testing.assert_allclose((own["ci_high"] - own["ci_low"]) / (expected["ci_high"] - expected["ci_low"]), 1.0, atol=0.05)


def test_least_squares_fix_what_the_model_fixes(recovered: lb.Campaign) -> None:
    """Without C_CCY the others change, and plain matrices say how."""
    model = lb.HybridModel.default(0).fixing("C_CCY")
    found = lb.local_fits(model, recovered)
    assert "C_CCY" not in set(found["parameter"])
    own = found[found["force_low_N"] == 238.0].set_index("parameter")["least_squares"]
    bound = lb.HybridModel.paper(0).bind(recovered.select(["f238", "f364"]))
    keep = [j for j, name in enumerate(bound.names) if name != "C_CCY"]
    rows = np.concatenate([test.factor @ bound.interest[r][:, keep] for r, test in enumerate(bound.reduced)])
    values = np.concatenate([np.asarray(test.projection) for test in bound.reduced])
    scale = bound.scale[keep]
    expected = np.linalg.lstsq(rows * scale, values, rcond=None)[0] * scale
    np.testing.assert_allclose(own.to_numpy(), expected, rtol=1e-6)


def test_windows() -> None:
    planned = plan((30,) * 5, forces_N=(400.0, 36.0, 400.0, 742.0, 200.0))
    assert windows(planned, 2) == [("f036", "f200"), ("f200", "f400", "f400_2"), ("f400", "f400_2", "f742")]
    assert windows(planned, 4) == [("f036", "f200", "f400", "f400_2", "f742")]
    assert len(windows(planned, 3)) == 2


@pytest.mark.parametrize(
    ("model", "width", "message"),
    [
        (lb.HybridModel.default(1), 1, "width must be at least 2 force levels, got 1"),
        (lb.HybridModel.default(1), 9, "width must be at most the campaign's 4 force levels, got 9"),
        (lb.HybridModel.paper(0), 2, "must have a proper prior"),
    ],
)
def test_refused(model: lb.HybridModel, width: int, message: str) -> None:
    with pytest.raises(InputError, match=message):
        lb.local_fits(model, simulated(plan()), width=width)


def test_too_few_readings_leave_least_squares_open() -> None:
    campaign = simulated(plan((9, 9), forces_N=(36.0, 742.0), arc_deg=200.0), seed=1)
    found = lb.local_fits(lb.HybridModel.default(0), campaign)
    assert found["sd"].gt(0).all()
    assert found["least_squares"].isna().all() or found["least_squares"].notna().all()


def test_windows_that_lack_a_set_up_or_a_plane() -> None:
    """Low forces in one set-up, high ones in another; then in another plane: each window keeps the campaign's parameters."""
    for further in ({"setup": 2}, {"plane": "YZ", "setup": 2}):
        planned = plan((40,) * 4, forces_N=(50.0, 300.0, 500.0, 700.0))
        tests = (*planned.tests[:2], *(replace(test, **further) for test in planned.tests[2:]))
        campaign = lb.HybridModel.default(0).simulate(replace(planned, tests=tests), seed=3).campaign
        table = lb.local_fits(lb.HybridModel.default(0), campaign)
        assert set(table["parameter"]) == set(lb.HybridModel.default(0).bind(campaign).names)
        assert np.isfinite(table["mean"]).all()
