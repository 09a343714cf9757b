"""Field files whose lines state several things at once: units beside signs and senses, centres
beside radii, forces in titles; and displays and logs of programs.
"""

from __future__ import annotations

import field_files as field
import numpy as np
from field_files import Circle, FieldCase

__all__ = ["passage_cases"]

HEADER = "Angle [deg],Reading [um]"
ONE_CIRCLE = field.TRUTH[1:2]  # 300 N
TENTHS = 2.54  # one ten-thousandth of an inch [µm]


def passage_cases() -> dict[str, FieldCase]:
    """Return the cases of lines that state several things."""
    return {**unit_cases(), **centre_cases(), **load_cases()}


def in_gon_clockwise(circle: Circle, k: int) -> list[object]:
    angle = np.mod(-circle.angle_deg[k], 360.0) / 0.9
    return [f"{angle:.6f}", f"{circle.reading_um[k]:.3f}"]


def unit_cases() -> dict[str, FieldCase]:
    """Return units in lines that also state the sign of readings or the sense of angles."""
    kind = "units beside signs and senses"
    lines = (
        "Readings in 0.0001 in, plus = bar longer",
        "Readings in tenths (0.0001 in), plus = bar longer",
        "Readings in tenths (0.0001 in)",
        'Readings in tenths (0.0001"), plus = bar longer',
        "Readings (0.0001 in), plus = bar longer",
    )
    cases = {}
    for number, line in enumerate(lines):
        files = field.texts("Angle [deg];Reading", field.scaled(TENTHS), line, separator=";")
        cases[f"unit_beside_sign_{number}"] = FieldCase(
            kind, f"a line '{line}'", files, told="unit of the reading: 0.0001 inch"
        )
    cases["unit_beside_sign_unread"] = FieldCase(
        kind,
        "a line 'Readings: 0.0001 inch, plus = longer'",
        field.texts(
            "Angle [deg];Reading",
            field.scaled(TENTHS),
            "Readings: 0.0001 inch, plus = longer",
            separator=";",
        ),
        refusal="in line 1. Say which: --unit",
        step=("--unit", "0.0001 inch"),
    )
    lines = (
        "Angles in gon, positive clockwise from +X",
        "Winkel in gon, von +X aus im Uhrzeigersinn; Kraft {F} N",
        "Angles in gon from +X clockwise",
    )
    for number, line in enumerate(lines):
        files = field.texts("Angle,Reading [um]", in_gon_clockwise, line)
        cases[f"unit_beside_sense_{number}"] = FieldCase(
            kind, f"a line '{line}'", files, told="unit of the angle: gon (line 1"
        )
    return cases


def centre_cases() -> dict[str, FieldCase]:
    """Return centres of circles, alone in a line and beside the radius."""
    lines = (
        "; centre X300 Y-120 radius 150",
        "; centre X300 Y-120",
        "Kreismittelpunkt: X = 300; Y = -120; Radius: 150 mm",
        "Centre: 300, -120; radius 150 mm",
    )
    cases = {}
    for number, line in enumerate(lines):
        cases[f"centre_{number}"] = FieldCase(
            "centres of circles",
            f"a line '{line}'",
            field.texts(HEADER, above=line),
            told="centre: X 0, Y 0, Z 0 mm (line 1 says",
        )
    return cases


def unnamed(above: str) -> dict[str, bytes]:
    """Return one file of 300 N, whose name does not state its force."""
    files = field.texts(HEADER, above=above, circles=ONE_CIRCLE)
    return {"run.csv": next(iter(files.values()))}


def load_cases() -> dict[str, FieldCase]:
    """Return forces in the lines above a single table, in words other than Force and Kraft."""
    kind = "forces above one table"
    lines = {
        "Forza: 300 N": "force_N: 300 N (line 1",
        "荷重:300 N": "force_N: 300 N (line 1",
        "At a load of 0.3 kN, clockwise": "force_N: 300 N (line 1",
        "Table 3: Deviation at a load of 0.3 kN": "force_N: 300 N (line 1",
        "Run 1: 300 N": "force_N: 300 N (line 1 says 'Run 1: 300 N'",
        "Test at 300 N, clockwise": "force_N: 300 N (line 1 says 'Test at 300 N",
        "300 N": "force_N: 300 N (line 1 says '300 N'",
    }
    cases = {}
    for number, (line, told) in enumerate(lines.items()):
        cases[f"force_above_{number}"] = FieldCase(
            kind, f"a line '{line}'", unnamed(line), told=told, circles=ONE_CIRCLE
        )
    refused = ("Weight of the table 300 N", "300 N / 600 N")
    for number, line in enumerate(refused):
        cases[f"force_above_unclear_{number}"] = FieldCase(
            kind,
            f"a line '{line}'",
            unnamed(line),
            refusal=f"(is it the load that line 1 says: '{line}'?). Give --forces-N",
            step=("--forces-N", "300"),
            circles=ONE_CIRCLE,
        )
    return cases
