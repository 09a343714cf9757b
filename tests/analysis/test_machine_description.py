"""What circular tests show of a machine."""

from __future__ import annotations

import re

import numpy as np

import ldbb_bayes as lb
from ldbb_bayes.machine.linear import compliance_jacobian, geometric_jacobian, kept_compliances

ANGLES_RAD = np.linspace(0.1, 6.0, 37)
PLANES = ("XY", "YZ", "ZX")
CENTRE_MM = (0.0, -15.0, 40.0)
MACHINE = lb.Machine("wXFYZt", PLANES, {"Y": (30.0, 0.0, -120.0)})
CIRCLES = [lb.machine.Circle(150.0, CENTRE_MM, plane) for plane in PLANES]


def evaluate_pattern(pattern: str, radius: float, angle: np.ndarray) -> np.ndarray:
    """Return a printed pattern as numbers, by having Python read it."""
    expression = pattern.replace("−", "-")
    for power, exponent in enumerate("²³⁴", start=2):
        expression = expression.replace(exponent, f"**{power}")
    product = re.sub(r"(?<=\w) ?(?=[Rcs])", "*", expression)
    names = {"R": radius, "c": np.cos(angle), "s": np.sin(angle)}
    return eval(product, names) + np.zeros_like(angle)


def test_patterns_are_those_of_the_columns() -> None:
    description = lb.describe_machine(MACHINE, CIRCLES)
    compliances = kept_compliances(MACHINE, *CIRCLES).names
    for plane in PLANES:
        small = lb.machine.Circle(80.0, CENTRE_MM, plane)
        columns = np.hstack(
            [
                compliance_jacobian(MACHINE, small, ANGLES_RAD, compliances),
                geometric_jacobian(MACHINE, small, ANGLES_RAD),
            ]
        )
        entries = [*description.compliances, *description.geometric_errors]
        for entry, column in zip(entries, columns.T, strict=True):
            expected = np.zeros_like(ANGLES_RAD)
            if plane in entry.pattern:
                expected = evaluate_pattern(entry.pattern[plane], 80.0, ANGLES_RAD)
            tolerance = 1e-5 * max(1.0, np.abs(expected).max())
            np.testing.assert_allclose(column, expected, rtol=1e-5, atol=tolerance)


def test_entries_are_named_like_the_columns() -> None:
    description = lb.describe_machine(MACHINE, CIRCLES)
    labels = [name.label for name in kept_compliances(MACHINE, *CIRCLES).names]
    assert [entry.name for entry in description.compliances] == labels
