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
    return {**unit_cases(), **centre_cases(), **load_cases(), **log_cases(), **display_cases()}


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
            kind, f"a line '{line}'", files, note="unit of the reading: 0.0001 inch"
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
            kind, f"a line '{line}'", files, note="unit of the angle: gon (line 1"
        )
    return cases


def centre_cases() -> dict[str, FieldCase]:
    """Return centres of circles, alone in a line and beside the radius."""
    not_used = "centre: X 0, Y 0, Z 0 mm (line 1 says"
    taken_over = "centre: X 300, Y −120, Z 0 mm (line 1 says"
    lines = {
        "; centre X300 Y-120 radius 150": not_used,
        "; centre X300 Y-120": not_used,
        "Kreismittelpunkt: X = 300; Y = -120; Radius: 150 mm": taken_over,
        "Centre: 300, -120; radius 150 mm": not_used,
        "centre X 300 Y -120 mm": taken_over,
        "Circle centre (G54): X 300 Y -120": not_used,
    }
    cases = {}
    for number, (line, note) in enumerate(lines.items()):
        cases[f"centre_{number}"] = FieldCase(
            "centres of circles",
            f"a line '{line}'",
            field.texts(HEADER, above=line),
            note=note,
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
        "300 N push CCW run 2": "direction: CCW (a line above the table",
        "Load 300 N CCW": "direction: CCW (a line above the table",
        "300 N, plane XY, CCW, R150": "plane: XY (line 1",
        "300 N XY": "plane: XY (line 1",
        "Belastung 300 N": "force_N: 300 N (line 1 says 'Belastung 300 N'",
        "300 N, positive = longer bar": "sign of the reading: 1: a longer bar is positive (line 1",
    }
    cases = {}
    for number, (line, note) in enumerate(lines.items()):
        cases[f"force_above_{number}"] = FieldCase(
            kind, f"a line '{line}'", unnamed(line), note=note, circles=ONE_CIRCLE
        )
    refused = ("Weight of the table 300 N", "300 N / 600 N")
    for number, line in enumerate(refused):
        cases[f"force_above_unclear_{number}"] = FieldCase(
            kind,
            f"a line '{line}'",
            unnamed(line),
            refusal=f"(is '{line}' in line 1 the load?). Give --forces-N",
            step=("--forces-N", "300"),
            circles=ONE_CIRCLE,
        )
    return cases


def beside_times(circle: Circle, k: int) -> list[object]:
    return [f"{0.1 * k:.1f}", *field.plain(circle, k)]


def log_cases() -> dict[str, FieldCase]:
    """Return logs over time that also hold angles or positions."""
    kind = "angles in logs over time"
    headers = ("Time [s],Encoder [deg],Reading [um]", "Time,C axis (°),LVDT [um]")
    cases = {}
    for number, header in enumerate(headers):
        files = field.texts(header, beside_times)
        cases[f"log_with_angle_{number}"] = FieldCase(kind, f"a header '{header}'", files)
    header = "Time [s],Tilt [deg],Reading [um]"
    cases["log_with_tilt"] = FieldCase(
        kind,
        f"a header '{header}'",
        field.texts(header, lambda circle, k: log_row(circle, k, ["0.1"])),
        refusal="a log over time must come with its feed, got none. Give --feed-mm-per-min",
        step=("--feed-mm-per-min", f"{field.FEED_MM_PER_MIN:g}"),
    )
    header = "Time [s],X [mm],Y [mm],Reading [um]"
    cases["log_with_positions"] = FieldCase(
        kind,
        f"a header '{header}'",
        field.texts(header, lambda circle, k: log_row(circle, k, positions(circle, k))),
        refusal="and positions 'X [mm]', 'Y [mm]'. Positions are not read: add a column",
        step=("--feed-mm-per-min", f"{field.FEED_MM_PER_MIN:g}"),
    )
    return cases


def log_row(circle: Circle, k: int, between: list[str]) -> list[object]:
    stamp, reading = field.logged("{:.4f}".format)(circle, k)
    return [stamp, *between, reading]


def positions(circle: Circle, k: int) -> list[str]:
    angle = np.deg2rad(circle.angle_deg[k])
    x = 300.0 + field.RADIUS_MM * np.cos(angle)
    y = -120.0 + field.RADIUS_MM * np.sin(angle)
    return [f"{x:.4f}", f"{y:.4f}"]


def shown(circle: Circle, unit_mm: float, command: str) -> list[str]:
    """Return a display of MATLAB: angles [rad] and distances of the balls, with a factor of 100."""
    lines = [command, "", "data =", "", "   1.0e+02 *", ""]
    for angle_deg, reading_um in zip(circle.angle_deg, circle.reading_um, strict=True):
        distance = (field.RADIUS_MM + 1e-3 * reading_um) / unit_mm
        lines.append(f"  {np.deg2rad(angle_deg) / 100.0:.15f}   {distance / 100.0:.15f}")
    return [*lines, ""]


def display_cases() -> dict[str, FieldCase]:
    """Return diaries of MATLAB with a factor above the numbers."""
    kind = "displays of MATLAB"
    command = ">> data    % theta [rad], distance of the balls [mm]"
    files = {}
    diary = [">> load run", ">> R0", "", "R0 =", "", "   150", ""]
    for circle in field.TRUTH:
        assigned = f">> F = {circle.force_N:g}; dir = 'CCW';   % N"
        lines = [assigned, *shown(circle, 1.0, command)]
        files[f"run_{circle.force_N:g}.txt"] = "\n".join(lines).encode()
        diary += lines
    note = "factor: 100 in all columns (line"
    return {
        "display_each": FieldCase(kind, "a diary for each matrix", files, note=note),
        "display_diary": FieldCase(
            kind,
            "a diary of three matrices",
            {"diary.txt": "\n".join([*diary, ">> diary off", ""]).encode()},
            note=note,
        ),
        "display_in_parts": FieldCase(
            kind,
            "a matrix in two parts",
            {
                name: content.replace(b"data =\n", b"data =\n\n  Columns 1 through 2\n")
                for name, content in files.items()
            },
            refusal="got 'Columns 1 through 2'. Write it to a file with writematrix",
            mended=files,
        ),
    }
