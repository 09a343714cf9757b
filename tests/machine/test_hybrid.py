"""The hybrid Jacobian and the patterns against columns typed in and against the exact model."""

from __future__ import annotations

import numpy as np
import pytest

import ldbb_bayes as lb

ANGLE = np.deg2rad(np.arange(0.0, 360.0, 7.0))
C, S, R = np.cos(ANGLE), np.sin(ANGLE), 150.0


def test_columns_are_those_of_the_paper() -> None:
    found = lb.hybrid_jacobian(lb.Machine(), lb.Circle(), ANGLE, 400.0, degree=2, reference_force_N=389.0)
    elastic = {"C_XXX": C**2, "C_XYX": C * S, "C_YYY": S**2, "C_CXY": R * C**2 * S, "C_CYY": R * C * S**2}
    elastic["C_CCY"] = R**2 * C**2 * S**2
    geometric = {"E_XX1": R * C**2, "E_YX2": R**2 * C**2 * S, "E_XY2": R**2 * S**2 * C, "E_YY1": R * S**2}
    geometric |= {"E_C0YX": R * C * S, "E_Xt0": C, "E_Yt0": S}
    expected = {f"{name}{k}": 400.0 * 11.0**p * own for p, k in enumerate(("", "_1", "_2")) for name, own in elastic.items()}
    assert list(found.columns) == [*expected, *geometric]
    for name, own in (expected | geometric).items():
        np.testing.assert_allclose(found[name], own, atol=1e-9 * np.abs(own).max(), err_msg=name)


@pytest.mark.parametrize(("topology", "plane"), [("wCAFYXZSt", "XY"), ("wXFZYt", "YZ"), ("wYFZXt", "ZX")])
def test_columns_are_derivatives_of_the_exact_model(topology: str, plane: str) -> None:
    machine, circle, force = lb.Machine(topology, plane), lb.Circle(plane=plane), 500.0
    found = lb.hybrid_jacobian(machine, circle, ANGLE, force)
    rest = lb.exact_reading_mm(machine, circle, ANGLE)
    for name, column in found.items():
        step = 1e-9 if str(name).startswith("C_") else 1e-7 if "2" not in str(name) else 1e-11
        kind = "compliances" if str(name).startswith("C_") else "geometric_errors"
        moved = lb.exact_reading_mm(machine, circle, ANGLE, force_N=force, **{kind: {str(name): step}})
        np.testing.assert_allclose((moved - rest) / step, column, atol=2e-4 * np.abs(column).max(), err_msg=str(name))


def test_patterns_hold_every_column() -> None:
    found = lb.patterns(lb.Machine(), lb.Circle(), ANGLE)
    assert found.shape == (len(ANGLE), 18 + 7)
    np.testing.assert_allclose(found["C_XXY"], found["C_XXX"], atol=1e-12)
    assert not found[["C_XCX", "C_YCX", "C_CXX", "C_CYX", "C_CCX"]].any(axis=None)
    kept = lb.hybrid_jacobian(lb.Machine(), lb.Circle(), ANGLE, 1.0)
    np.testing.assert_allclose(found[list(kept.columns)], kept, atol=1e-12)


def test_refused() -> None:
    with pytest.raises(lb.InputError, match="degree must be 0, 1 or 2"):
        lb.hybrid_jacobian(lb.Machine(), lb.Circle(), ANGLE, 100.0, degree=3)
