"""The wrench and geometric Jacobians against the paper's numbers and against formulas typed in."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from ldbb_bayes.machine.chain import Circle, Machine
from ldbb_bayes.machine.jacobian import (
    geometric_jacobian,
    geometric_names,
    kept_compliances,
    wrench_jacobian,
    wrench_names,
)

ANGLE = np.linspace(-1.0, 8.0, 77)
C, S, R = np.cos(ANGLE), np.sin(ANGLE), 150.0
TYPED_WRENCH = {
    "C_XXX": C**2,
    "C_XYX": C * S,
    "C_YYY": S**2,
    "C_CXY": R * C**2 * S,
    "C_CYY": R * C * S**2,
    "C_CCY": R**2 * C**2 * S**2,
}
TYPED_GEOMETRIC = {
    "E_XX1": R * C**2,
    "E_YX2": R**2 * C**2 * S,
    "E_XY2": R**2 * S**2 * C,
    "E_YY1": R * S**2,
    "E_C0YX": R * C * S,
    "E_Xt0": C,
    "E_Yt0": S,
}


def test_rank_and_condition_number() -> None:
    kept = kept_compliances(Machine())
    assert kept.rank == 6
    assert kept.condition_number == pytest.approx(9742.79, abs=0.01)
    assert len(wrench_names(Machine())) == 18


def test_table_2(root) -> None:
    table = pd.read_csv(root / "data" / "published_tables" / "table_2_confounded_compliances.csv")
    kept = kept_compliances(Machine())
    assert [name.label for name in kept.names] == table["kept"].tolist()
    assert [set(group) for group in kept.sets] == [set(text.split()) for text in table["set"]]
    assert set(kept.null) == {"C_XCX", "C_YCX", "C_CXX", "C_CYX", "C_CCX"}
    assert kept.dependent == ()


@pytest.mark.parametrize("name", TYPED_WRENCH)
def test_wrench_columns_as_typed(name: str) -> None:
    labels = [n.label for n in wrench_names(Machine())]
    column = wrench_jacobian(Machine(), Circle(R), ANGLE)[:, labels.index(name)]
    np.testing.assert_allclose(column, TYPED_WRENCH[name], atol=1e-9)


@pytest.mark.parametrize("name", TYPED_GEOMETRIC)
def test_geometric_columns_as_typed(name: str) -> None:
    column = geometric_jacobian(Machine(), Circle(R), ANGLE)[:, geometric_names(Machine()).index(name)]
    np.testing.assert_allclose(column, TYPED_GEOMETRIC[name], atol=1e-9)


def test_wrench_jacobian_by_equation_20() -> None:
    """B̂ᵀ J C_joint Jᵀ W with 3 × 3 joint matrices, one unit compliance at a time."""
    machine, circle = Machine("wXFYZt", "XY", {"Y": (7.0, -3.0, 0.0)}), Circle(120.0, (15.0, -8.0))
    position = circle.position_mm(ANGLE)
    for column, name in enumerate(wrench_names(machine)):
        joint = next(j for j in machine.joints if j.axis == name.joint)
        compliance = np.zeros((3, 3))
        compliance["XYC".index(name.twist), "XYC".index(name.wrench)] = 1.0
        expected = []
        for theta, here in zip(ANGLE, position, strict=True):
            bar = np.array([np.cos(theta), np.sin(theta)])
            lever = machine.lever_mm(joint, here[None], circle)[0]
            jacobian = np.array([[1.0, 0.0, -lever[1]], [0.0, 1.0, lever[0]]])
            expected.append(bar @ jacobian @ compliance @ jacobian.T @ bar)
        np.testing.assert_allclose(wrench_jacobian(machine, circle, ANGLE)[:, column], expected, atol=1e-8)


@pytest.mark.parametrize(
    ("topology", "plane", "frames"),
    [
        ("wCAFYXZSt", "YZ", {}),
        ("wFXYZt", "ZX", {}),
        ("wXFYZt", "XY", {}),
        ("wYXFZt", "XY", {"X": (3.0, 5.0, 7.0)}),
        ("wFYXZt", "XY", {"X": (7.0, 11.0, 0.0), "Y": (-5.0, 3.0, 0.0)}),
    ],
)
def test_kept_columns_span_the_whole_jacobian(topology: str, plane: str, frames: dict) -> None:
    machine, circle = Machine(topology, plane, frames), Circle()
    kept = kept_compliances(machine, circle)
    full = wrench_jacobian(machine, circle, ANGLE)
    labels = [name.label for name in wrench_names(machine)]
    chosen = full[:, [labels.index(name.label) for name in kept.names]]
    scaled = chosen / np.linalg.norm(chosen, axis=0)
    assert kept.rank == len(kept.names) == np.linalg.matrix_rank(scaled)
    rest = full - scaled @ np.linalg.lstsq(scaled, full, rcond=None)[0]
    assert np.abs(rest).max() <= 1e-9 * np.abs(full).max()
    listed = set(kept.null) | {n for group in kept.sets for n in group}
    if not kept.dependent:
        assert listed == set(labels)


def test_columns_of_a_rank_deficient_machine_are_dropped() -> None:
    """With both balls at the frames of both joints no rotation can show: only translations remain."""
    kept = kept_compliances(Machine("wXFYZt"))
    assert [name.label for name in kept.names] == ["C_XXX", "C_XYX", "C_YYY"]
