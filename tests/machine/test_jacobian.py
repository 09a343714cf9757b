"""The wrench and geometric Jacobians against the paper's numbers and against formulas typed in."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import ldbb_bayes as lb
from ldbb_bayes.machine.chain import Circle, Machine, joint_names, wrench_names
from ldbb_bayes.machine.forward import compliance_jacobian, wrench_jacobian
from ldbb_bayes.machine.identifiable import kept_compliances

ANGLE = np.linspace(-1.0, 8.0, 77)
C, S, R = np.cos(ANGLE), np.sin(ANGLE), 150.0


def test_table_2(root) -> None:
    table = pd.read_csv(root / "data" / "published_tables" / "table_2_confounded_compliances.csv")
    kept = kept_compliances(Machine())
    assert (kept.rank, kept.condition_number) == (6, pytest.approx(9742.79, abs=0.01))
    assert [name.label for name in kept.names] == table["kept"].tolist()
    assert [set(group) for group in kept.sets] == [set(text.split()) for text in table["set"]]
    assert set(kept.null) == {"C_XCX", "C_YCX", "C_CXX", "C_CYX", "C_CCX"}
    assert kept.dependent == ()


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
    machine, circle = Machine(topology, plane, frames), Circle(plane=plane)
    kept, full = kept_compliances(machine, circle), wrench_jacobian(machine, circle, ANGLE)
    labels = [name.label for name in wrench_names(machine)]
    chosen = full[:, [labels.index(name.label) for name in kept.names]]
    scaled = chosen / np.linalg.norm(chosen, axis=0)
    assert kept.rank == len(kept.names) == np.linalg.matrix_rank(scaled)
    rest = full - scaled @ np.linalg.lstsq(scaled, full, rcond=None)[0]
    assert np.abs(rest).max() <= 1e-9 * np.abs(full).max()
    assert kept.dependent or {*kept.null, *(name for group in kept.sets for name in group)} >= set(labels)


def test_height_above_a_guideway_by_hand() -> None:
    """The tool ball h above Y's frame.

    The moment about X of a force along Y at height h is −h s; a rotation A moves the ball along Y by −h. So C_AYY goes with
    −h s² and C_AAY with h² s²: one height cannot tell them from C_YYY, two heights tell C_AYY, three C_AAY too.
    """

    def kept(*heights: float) -> list[str]:
        circles = [Circle(R, (0.0, 0.0, h)) for h in heights]
        return [name.label for name in kept_compliances(Machine(), *circles).names]

    h = 80.0
    names = [name for name in joint_names(Machine()) if name.label in ("C_AYY", "C_AAY")]
    columns = compliance_jacobian(Machine(), Circle(R, (0.0, 0.0, h)), ANGLE, names)
    for name, own in zip(names, columns.T, strict=True):
        np.testing.assert_allclose(own, (-h if name.label == "C_AYY" else h**2) * S**2, atol=1e-9)
    assert kept(0.0) == kept(h)
    one = kept_compliances(Machine(), Circle(R, (0.0, 0.0, h)))
    direct = next(k for k, name in enumerate(one.names) if name.label == "C_YYY")
    weights = dict(zip(one.sets[direct], one.weights[direct], strict=True))
    assert (weights["C_AYY"], weights["C_AAY"]) == (pytest.approx(-h), pytest.approx(h**2))
    assert {"C_AYY", "C_AAY"} & {*kept(0.0, h)} == {"C_AYY"}
    assert "C_AAY" in kept(0.0, h, 2 * h)


@pytest.mark.parametrize(
    ("machine", "circles", "unbounded"),
    [
        (Machine("wCAFYXZSt", ("XY", "YZ", "ZX")), (), set()),
        (Machine("wYXFZt", "XY", {"X": (0.0, -200.0, 350.0)}), (Circle(150.0, (10.0, 20.0, 0.0)),), set()),
        (Machine(), (Circle(150.0, (0.0, 0.0, 0.0)), Circle(150.0, (0.0, 0.0, 300.0))), set()),
        (Machine(), (Circle(150.0, (0.0, 0.0, 100.0)), Circle(150.0, (0.0, 0.0, 300.0))), {"C_XXX", "C_YYY"}),
        (Machine("wXFYZt"), (Circle(150.0, (300.0, 200.0, 0.0)), Circle(150.0, (-300.0, 200.0, 0.0))), {"C_XXX"}),
    ],
)
def test_what_cannot_be_negative(machine: Machine, circles: tuple[Circle, ...], unbounded: set[str]) -> None:
    """Joints with random positive semi-definite compliance matrices: the kept parameters that readings then have are never
    negative where the machine says so, and sometimes are for the others, though they are a translation along its force.

    Two heights of 100 and 300 mm cannot tell h² of C_AAY from −30000 + 400 h: C_YYY is then known less 30000 mm² of it.
    """
    circles = circles or tuple(Circle(plane=plane) for plane in machine.planes)
    kept = kept_compliances(machine, *circles)
    names = joint_names(machine)
    every = np.concatenate([compliance_jacobian(machine, circle, ANGLE, names) for circle in circles])
    own = np.concatenate([compliance_jacobian(machine, circle, ANGLE, kept.names) for circle in circles])
    scale = np.abs(own).max(axis=0)
    rng = np.random.default_rng(5)
    lowest = np.full(len(kept.names), np.inf)
    for _ in range(300):
        value = np.zeros(len(names))
        for joint in machine.joints:
            rotary = 10.0 ** rng.uniform(-4.0, -1.0)
            root = rng.standard_normal((6, rng.integers(1, 7))) * np.repeat([1.0, rotary], 3)[:, None]
            matrix = root @ root.T
            for k, name in enumerate(names):
                if name.joint == joint.axis:
                    value[k] = matrix["XYZABC".index(name.twist), "XYZABC".index(name.wrench)]
        found = np.linalg.lstsq(own / scale, every @ value, rcond=None)[0]
        lowest = np.minimum(lowest, found / np.abs(found).max())
    by_name = dict(zip([name.label for name in kept.names], zip(lowest, kept.not_negative, strict=True), strict=True))
    for label, (low, bounded) in by_name.items():
        assert low > -1e-7 if bounded else low < -1e-6, label
    diagonal = {name.label for name in kept.names if name.twist == name.wrench}
    assert {label for label in diagonal if not by_name[label][1]} == unbounded


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


def test_patterns_hold_every_column() -> None:
    found = lb.patterns(lb.Machine(), lb.Circle(), ANGLE)
    assert found.shape == (len(ANGLE), 18 + 7)
    np.testing.assert_allclose(found["C_XXY"], found["C_XXX"], atol=1e-12)
    assert not found[["C_XCX", "C_YCX", "C_CXX", "C_CYX", "C_CCX"]].any(axis=None)
    kept = lb.hybrid_jacobian(lb.Machine(), lb.Circle(), ANGLE, 1.0)
    np.testing.assert_allclose(found[list(kept.columns)], kept, atol=1e-12)
