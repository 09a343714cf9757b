"""Topology strings, branches, lever arms, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from ldbb_bayes.errors import InputError
from ldbb_bayes.machine.chain import PLANES, Circle, Machine, geometric_names

ANGLE = np.array([0.3, 2.0, 4.5])


def test_the_papers_machine() -> None:
    machine = Machine()
    x, y = machine.joints
    assert (x.axis, x.branch, y.axis, y.branch) == ("X", "tool", "Y", "tool")
    assert machine.squared("XY") == (y, x)
    assert _labels(machine) == ["E_XX1", "E_YX2", "E_XY2", "E_YY1", "E_C0YX", "E_Xt0", "E_Yt0"]
    position = Circle().position_mm(ANGLE)
    np.testing.assert_array_equal(machine.lever_mm(x, Circle(), ANGLE), np.zeros((3, 3)))
    np.testing.assert_array_equal(machine.lever_mm(y, Circle(), ANGLE), position * [1.0, 0.0, 0.0])


def test_lever_arm_in_the_workpiece_branch() -> None:
    """wXYF…: the table X rides on Y. Seen from Y's frame the work ball stands where X has carried it: −x, plus its place."""
    machine, circle = Machine("wXYFZt"), Circle(100.0, (10.0, 20.0, 30.0))
    x, y = machine.joints
    position = circle.position_mm(ANGLE)
    assert (x.branch, y.branch, machine.squared("XY")[0]) == ("workpiece", "workpiece", y)
    expected = np.column_stack([10.0 - position[:, 0], np.full(3, 20.0), np.full(3, 30.0)])
    np.testing.assert_allclose(machine.lever_mm(y, circle, ANGLE), expected)
    np.testing.assert_allclose(machine.lever_mm(x, circle, ANGLE), [[10.0, 20.0, 30.0]] * 3)


def test_an_axis_that_stands_still_sets_levers_too() -> None:
    """wFXYZt at Z = 40: seen from X's and Y's frames the tool ball stands 40 mm up; without a Z axis the tool is as long."""
    high = Circle(100.0, (0.0, 0.0, 40.0))
    for topology in ("wFXYZt", "wFXYt"):
        machine = Machine(topology)
        for joint in machine.joints:
            np.testing.assert_allclose(machine.lever_mm(joint, high, ANGLE)[:, 2], 40.0)


def test_planes_are_right_handed_and_share_axes() -> None:
    assert _labels(Machine("wFXYZt", "ZX"))[:4] == ["E_ZZ1", "E_XZ2", "E_ZX2", "E_XX1"]
    for plane, axes in PLANES.items():
        first, second = np.eye(3)[["XYZ".index(axis) for axis in plane]]
        np.testing.assert_array_equal(np.cross(first, second), np.eye(3)["ABC".index(axes.rotation)])
        assert plane == axes.first + axes.second
    machine = Machine("wFXYZt", ("ZX", "XY", "YZ"))
    assert (machine.planes, [joint.axis for joint in machine.joints]) == (("XY", "YZ", "ZX"), ["X", "Y", "Z"])
    labels = _labels(machine)
    assert (len(labels), len(set(labels)), labels[-3:]) == (15, 15, ["E_Xt0", "E_Yt0", "E_Zt0"])
    assert {"E_C0XY", "E_A0YZ", "E_B0XZ"} < set(labels)


def _labels(machine: Machine) -> list[str]:
    return [name.label for name in geometric_names(machine)]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("wCAFYXZSt", "XZ"), "plane must be one of XY, YZ, ZX, got 'XZ'. Did you mean 'ZX'"),
        (("wYXZt", "XY"), "topology must read w…F…t"),
        (("wFYXYt", "XY"), "got 'Y' twice"),
        (("wFYXt", "YZ"), "got 'wFYXt' without Z"),
        (("wFXYt", "XY", {"X": (0.0, float("nan"), 0.0)}), "three finite numbers"),
    ],
)
def test_refused(arguments: tuple[str, str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Machine(*arguments)
