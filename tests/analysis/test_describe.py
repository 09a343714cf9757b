"""What circles show of a machine: the printed patterns are the columns."""

from __future__ import annotations

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.machine.forward import compliance_jacobian, geometric_jacobian
from ldbb_bayes.machine.identifiable import kept_compliances

ANGLE = np.linspace(0.1, 6.0, 37)


def test_the_papers_machine() -> None:
    machine = lb.describe(lb.Machine("wCAFYXZSt", "XY"))
    patterns = {entry.name: entry.pattern["XY"] for entry in (*machine.compliances, *machine.geometric_errors)}
    assert patterns == {
        "C_XXX": "c²",
        "C_XYX": "cs",
        "C_YYY": "s²",
        "C_CXY": "R c²s",
        "C_CYY": "R cs²",
        "C_CCY": "R² c²s²",
        "E_XX1": "R c²",
        "E_YX2": "R² c²s",
        "E_XY2": "R² cs²",
        "E_YY1": "R s²",
        "E_C0YX": "R cs",
        "E_Xt0": "c",
        "E_Yt0": "s",
    }


def value_of(pattern: str, radius: float, angle: np.ndarray) -> np.ndarray:
    """A printed pattern as numbers, by reading it back."""
    text = pattern.replace("−", "-").replace(" - ", " + -").removeprefix("+")
    total = np.zeros_like(angle)
    for term in text.split(" + "):
        sign, body = (-1.0, term[1:]) if term.startswith("-") else (1.0, term)
        value = np.full_like(angle, sign)
        for word in body.split():
            if word[0] in "0123456789.":
                value = value * float(word)
                continue
            for letter, power in zip(word, (*word[1:], ""), strict=True):
                base = {"R": radius, "c": np.cos(angle), "s": np.sin(angle)}.get(letter)
                if base is not None:
                    value = value * base ** {"²": 2, "³": 3, "⁴": 4}.get(power, 1)
        total = total + value
    return total


@pytest.mark.parametrize(
    ("topology", "planes", "frames", "centre"),
    [
        ("wYXFZt", ("XY",), {"X": (0.0, -200.0, 350.0)}, (10.0, 20.0, 0.0)),
        ("wXFYZt", ("XY", "YZ", "ZX"), {"Y": (30.0, 0.0, -120.0)}, (0.0, -15.0, 40.0)),
    ],
)
def test_patterns_say_what_the_columns_are(topology: str, planes: tuple[str, ...], frames: dict, centre: tuple) -> None:
    machine = lb.Machine(topology, planes, frames)
    circles = [lb.Circle(150.0, centre, plane) for plane in planes]
    found = lb.describe(machine, circles)
    kept = kept_compliances(machine, *circles)
    for plane in planes:
        small = lb.Circle(80.0, centre, plane)
        columns = {
            name.label: column
            for name, column in zip(kept.names, compliance_jacobian(machine, small, ANGLE, kept.names).T, strict=True)
        }
        columns |= {
            entry.name: column
            for entry, column in zip(found.geometric_errors, geometric_jacobian(machine, small, ANGLE).T, strict=True)
        }
        for entry in (*found.compliances, *found.geometric_errors):
            shown = entry.pattern.get(plane)
            expected = np.zeros_like(ANGLE) if shown is None else value_of(shown, 80.0, ANGLE)
            np.testing.assert_allclose(columns[entry.name], expected, rtol=1e-5, atol=1e-5 * max(1.0, np.abs(expected).max()))
