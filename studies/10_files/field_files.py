"""One campaign of three circles as people of the field hand it over: units beside, above and in
cell formats, diameters, other angles, logs, masks, hidden sheets, other languages and programs.

Each case reads to the campaign, or is refused with a step; done that step, it reads.

python studies/10_files/field_files.py FOLDER    # writes all cases, one folder each
"""

from __future__ import annotations

import io
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from openpyxl import Workbook

import ldbb_bayes as lb

__all__ = ["CASES", "Circle", "FieldCase", "differences", "truth"]

Array = NDArray[np.float64]
FORCES_N = (100.0, 300.0, 600.0)
ANGLES_DEG = np.arange(0.0, 360.0, 5.0)
RADIUS_MM = 150.0
FEED_MM_PER_MIN = 2000.0
# Readings agree if they differ by less than this [µm]: they are written with three decimals.
LARGEST_DIFFERENCE_UM = 6e-3
# Angles agree if they differ by less than this [deg]: times are written with four decimals.
LARGEST_DIFFERENCE_DEG = 0.02


@dataclass(frozen=True)
class Circle:
    """One circle as it truly is: force, angles from +X counter-clockwise, readings, radius."""

    force_N: float
    angle_deg: Array
    reading_um: Array
    radius_mm: float = RADIUS_MM
    direction: str | None = None


def truth() -> tuple[Circle, ...]:
    """Return the three circles that all files hold; no exchange of axes or signs leaves them."""
    theta = np.deg2rad(ANGLES_DEG)
    cosine = np.cos(theta)
    sine = np.sin(theta)
    circles = []
    for force in FORCES_N:
        reading = force * (0.045 * cosine**2 + 0.021 * sine**2 + 0.006 * cosine * sine)
        reading += -8.0 + 3.1 * cosine - 4.7 * sine + 1.3 * np.sin(3.0 * theta + 0.4)
        circles.append(Circle(force, ANGLES_DEG, np.round(reading, 3)))
    return tuple(circles)


TRUTH = truth()
# The same circles with a reading every 10°.
COARSE = tuple(
    replace(circle, angle_deg=circle.angle_deg[::2], reading_um=circle.reading_um[::2])
    for circle in TRUTH
)


@dataclass(frozen=True)
class FieldCase:
    """Files of one kind, what is in them, and the step that the refusal of them names."""

    kind: str
    description: str
    files: Mapping[str, bytes]
    #: words of the refusal; empty if the files are read at once
    refusal: str = ""
    #: options of the step that the refusal names
    step: tuple[str, ...] = ()
    #: files after the step, where it changes them
    mended: Mapping[str, bytes] | None = None
    #: options of the import besides the step
    options: tuple[str, ...] = ()
    #: words of a note that the import must make
    note: str = ""
    circles: Sequence[Circle] = field(default=TRUTH)


def differences(campaign: lb.Campaign, circles: Sequence[Circle]) -> dict[str, float]:
    """Return the largest differences of angle, reading, force and radius from the truth."""
    if len(campaign.tests) != len(circles):
        return {"tests": float(abs(len(campaign.tests) - len(circles)))}
    largest = {"angle_deg": 0.0, "reading_um": 0.0, "force_N": 0.0, "radius_mm": 0.0}
    ordered = sorted(campaign.tests, key=_order_of_test)
    for test, circle in zip(ordered, sorted(circles, key=_order_of_circle), strict=True):
        if len(test.angle_deg) != len(circle.angle_deg):
            return {"readings": float(abs(len(test.angle_deg) - len(circle.angle_deg)))}
        if circle.direction is not None and test.direction != circle.direction:
            return {"direction": 1.0}
        by_angle = np.argsort(np.mod(np.round(test.angle_deg, 1), 360.0))
        true_by_angle = np.argsort(np.mod(circle.angle_deg, 360.0))
        angle = np.asarray(test.angle_deg)[by_angle] - circle.angle_deg[true_by_angle]
        angle = np.mod(angle + 180.0, 360.0) - 180.0
        reading = np.asarray(test.reading_um)[by_angle] - circle.reading_um[true_by_angle]
        off = {
            "angle_deg": float(np.abs(angle).max()),
            "reading_um": float(np.abs(reading).max()),
            "force_N": abs(float(test.force_N or 0.0) - circle.force_N),
            "radius_mm": abs(float(test.radius_mm or 0.0) - circle.radius_mm),
        }
        largest = {key: max(value, off[key]) for key, value in largest.items()}
    return largest


def _order_of_test(test: lb.CircularTest) -> tuple[float, str]:
    return (float(test.force_N or 0.0), test.direction or "")


def _order_of_circle(circle: Circle) -> tuple[float, str]:
    return (circle.force_N, circle.direction or "")


def agrees(off: Mapping[str, float]) -> bool:
    """Return whether differences are within the digits that the files hold."""
    limits = {
        "angle_deg": LARGEST_DIFFERENCE_DEG,
        "reading_um": LARGEST_DIFFERENCE_UM,
        "force_N": 1e-6,
        "radius_mm": 1e-3,
    }
    return all(value <= limits.get(key, 0.0) for key, value in off.items())


# ---- files of text, one for each test

Row = Callable[[Circle, int], Sequence[object]]


def plain(circle: Circle, k: int) -> list[object]:
    return [f"{circle.angle_deg[k]:g}", f"{circle.reading_um[k]:.3f}"]


def scaled(size: float, digits: int = 9) -> Row:
    """Return rows with readings in a unit of ``size`` µm."""

    def row(circle: Circle, k: int) -> list[object]:
        return [f"{circle.angle_deg[k]:g}", f"{circle.reading_um[k] / size:.{digits}f}"]

    return row


def beside(unit: str, size: float) -> Row:
    def row(circle: Circle, k: int) -> list[object]:
        return [*scaled(size)(circle, k), unit]

    return row


def changing(circle: Circle, k: int) -> list[object]:
    """Readings in mm from 10 µm on, else in µm, with the unit beside."""
    if abs(circle.reading_um[k]) >= 10.0:
        return beside("mm", 1e3)(circle, k)
    return beside("um", 1.0)(circle, k)


def turned(zero_deg: float, sense: int) -> Row:
    """Return rows whose angle counts from another axis, and clockwise for −1."""

    def row(circle: Circle, k: int) -> list[object]:
        angle = np.mod(sense * (circle.angle_deg[k] - zero_deg), 360.0)
        return [f"{angle:g}", f"{circle.reading_um[k]:.3f}"]

    return row


def logged(stamp: Callable[[float], str]) -> Row:
    """Return rows over time; ``stamp`` writes the seconds since the start of the circle."""

    def row(circle: Circle, k: int) -> list[object]:
        seconds = np.deg2rad(circle.angle_deg[k]) * RADIUS_MM / (FEED_MM_PER_MIN / 60.0)
        return [stamp(float(seconds)), f"{circle.reading_um[k]:.3f}"]

    return row


def texts(
    header: str,
    row: Row = plain,
    above: str = "",
    separator: str = ",",
    encoding: str = "utf-8",
    suffix: str = ".csv",
    circles: Sequence[Circle] = TRUTH,
    below: str = "",
) -> dict[str, bytes]:
    """Return one file for each circle, named after its force; ``{F}`` in a line is the force.

    Lines ``above`` stand above the table, and lines ``below`` follow an empty line below it.
    """
    files = {}
    for circle in circles:
        lines = [*above.split("\n"), header]
        lines = [line.replace("{F}", f"{circle.force_N:g}") for line in lines if line]
        for k in range(len(circle.angle_deg)):
            lines.append(separator.join(str(cell) for cell in row(circle, k)))
        if below:
            lines += ["", *below.split("\n")]
        name = f"{circle.force_N:g}N{suffix}"
        files[name] = "\n".join([*lines, ""]).encode(encoding)
    return files


def tidy(header: str, row: Callable[[Circle, int], Sequence[object]]) -> dict[str, bytes]:
    """Return one file with a row for each reading of all circles."""
    lines = [header]
    for circle in TRUTH:
        for k in range(len(circle.angle_deg)):
            lines.append(",".join(str(cell) for cell in row(circle, k)))
    return {"all.csv": "\n".join([*lines, ""]).encode()}


def wide(header: str, row: Callable[[int], Sequence[object]], above: str = "") -> dict[str, bytes]:
    """Return one file with columns for each circle."""
    lines = [line for line in (*above.split("\n"), header) if line]
    for k in range(len(ANGLES_DEG)):
        lines.append(";".join(str(cell) for cell in row(k)))
    return {"wide.csv": "\n".join([*lines, ""]).encode()}


def readings_of(k: int) -> list[str]:
    return [f"{circle.reading_um[k]:.3f}" for circle in TRUTH]


def angle_and_readings(k: int) -> list[str]:
    """Angle in whole degrees, and the reading of each circle."""
    return [f"{5 * k}", *readings_of(k)]


def shifted_pairs(k: int) -> list[str]:
    """Angle and reading of each circle; each circle begins 90° after the one before."""
    cells = []
    for number, circle in enumerate(TRUTH):
        cells += plain(circle, (k + 18 * number) % len(ANGLES_DEG))
    return [str(cell) for cell in cells]


# ---- workbooks


def workbook(fill: Callable[[Workbook], None]) -> bytes:
    book = Workbook()
    fill(book)
    if "Sheet" in book.sheetnames:
        del book["Sheet"]
    stream = io.BytesIO()
    book.save(stream)
    return stream.getvalue()


def sheets(
    header: Sequence[str] = ("Angle [deg]", "Reading [um]"),
    size: float = 1.0,
    number_format: str = "",
    change: Callable[[Any, Circle], None] | None = None,
) -> dict[str, bytes]:
    """Return a workbook with a sheet for each circle; ``change`` alters each sheet."""

    def fill(book: Workbook) -> None:
        for circle in TRUTH:
            sheet = book.create_sheet(f"{circle.force_N:g} N")
            sheet.append(list(header))
            for k in range(len(circle.angle_deg)):
                sheet.append([float(circle.angle_deg[k]), float(circle.reading_um[k]) / size])
                if number_format:
                    sheet.cell(sheet.max_row, 2).number_format = number_format
            if change is not None:
                change(sheet, circle)

    return {"m.xlsx": workbook(fill)}


# ---- cases, kind by kind

NO_UNIT = "Angle,Reading"
UNITS_BESIDE = "unit beside or above"


def unit_cases() -> dict[str, FieldCase]:
    kind = UNITS_BESIDE
    cases = {
        "unit_column_mil": FieldCase(
            kind, "a column Unit, mil", texts("Angle_deg,Value,Unit", beside("mil", 25.4))
        ),
        "unit_column_changing": FieldCase(
            kind, "a column Unit that changes by row", texts("Angle_deg,Value,Unit", changing)
        ),
        "unit_column_german": FieldCase(
            kind,
            "a column Einheit, mm",
            texts("Winkel [°],Messwert,Einheit", beside("mm", 1e3)),
        ),
        "unit_column_without_name": FieldCase(
            kind, "a column of units without a name", texts("Angle_deg,Value,", beside("mm", 1e3))
        ),
        "unit_column_in_brackets": FieldCase(
            kind, "units in brackets", texts("Angle_deg,Value,Unit", beside("[nm]", 1e-3))
        ),
        "unit_column_unknown": FieldCase(
            kind,
            "a column Unit of counts",
            texts("Angle_deg,Value,Unit", beside("counts", 0.1)),
            refusal="--unit '0.1 um'",
            step=("--unit", "0.1 um"),
        ),
        "unit_column_against_header": FieldCase(
            kind,
            "a header in µm, a column of mm",
            texts("Angle_deg,Value [um],Unit", beside("mm", 1e3)),
            refusal="said once, got mm in a column of units and um in line 1. Correct the file, or"
            " give --unit",
            step=("--unit", "mm"),
        ),
        "unit_of_force_beside": FieldCase(
            kind,
            "a force of 0.6 with kN beside it",
            tidy(
                "test,Force,Unit,Angle_deg,Reading_um",
                lambda c, k: [f"c{c.force_N:g}", f"{c.force_N / 1e3:g}", "kN", *plain(c, k)],
            ),
        ),
        "unit_in_cells": FieldCase(
            kind,
            "the unit in each cell",
            texts(
                "Angle;Reading",
                lambda c, k: [f"{c.angle_deg[k]:g}°", f"{c.reading_um[k] / 1e3:.6f} mm"],
                separator=";",
            ),
        ),
    }
    lines = {
        "units_inch": ("Units: inch", 25400.0),
        "einheit_mil": ("Einheit: mil", 25.4),
        "unit_of_readings_nm": ("Unit of readings = nm", 1e-3),
        "units_mm_deg": ("Units: mm, deg", 1e3),
        "scale_per_count": ("Scale: 0.1 um per count", 0.1),
        "count_equals": ("1 count = 0.1 µm", 0.1),
        "resolution_per_digit": ("Resolution: 0.05 µm/digit", 0.05),
        "unidad": ("Unidad: mm", 1e3),
        "chinese_unit_line": ("单位：mm", 1e3),
        "readings_in": ("All readings are in mm", 1e3),
        "messwerte_in": ("Messwerte in mil", 25.4),
        "thousandth": ("Einheit: 1/1000 mm", 1.0),
        "ablesung": ("Ablesung in 1/100 mm", 10.0),
        "lsb": ("LSB 0.1 um", 0.1),
        "no_mark": ("Units - mil", 25.4),
    }
    for name, (line, size) in lines.items():
        cases[f"line_{name}"] = FieldCase(
            kind, f"a line '{line}'", texts(NO_UNIT, scaled(size), above=line)
        )
    cases["line_scale_of_counts"] = FieldCase(
        kind,
        "readings in counts, a line with their size",
        texts("Angle [deg],Reading [counts]", scaled(0.1), above="Scale: 0.1 um per count"),
    )
    cases["line_against_header"] = FieldCase(
        kind,
        "a line 'Units: mm' above a header in µm",
        texts("Angle [deg],Reading [um]", above="Units: mm"),
        refusal="said once, got um in line 2 and mm in line 1. Correct the file, or give --unit",
        step=("--unit", "um"),
    )
    cases["line_unknown_unit"] = FieldCase(
        kind,
        "a line 'Units: metric'",
        texts(NO_UNIT, above="Units: metric"),
        refusal="got 'metric' in line 1. Correct the header, or give --unit",
        step=("--unit", "um"),
    )
    cases["line_with_factor"] = FieldCase(
        kind,
        "a line 'Units: x 10 um'",
        texts(NO_UNIT, scaled(10.0), above="Units: x 10 um"),
        refusal="got 'x 10 um' in line 1. Correct the header, or give --unit",
        step=("--unit", "10 um"),
    )
    cases["row_of_units_for_readings"] = FieldCase(
        kind,
        "a row of units below the header, empty below the angle in gon",
        texts(
            "Angle [gon];Reading\n;mm",
            lambda c, k: [f"{c.angle_deg[k] / 0.9:.6f}", f"{c.reading_um[k] / 1e3:.6f}"],
            separator=";",
        ),
    )
    for name, unit, size in (("10_nm", "10 nm", 0.01), ("cm", "cm", 1e4)):
        cases[f"nameless_column_{name}"] = FieldCase(
            kind,
            f"a column of {unit} without a name",
            texts("Angle_deg,Value,", beside(unit, size)),
        )
    cases["nameless_column_counts"] = FieldCase(
        kind,
        "a column of counts without a name",
        texts("Angle_deg,Value,", beside("counts", 0.1)),
        refusal="--unit '0.1 um'",
        step=("--unit", "0.1 um"),
    )
    cases["format_counts"] = FieldCase(
        kind, "a number format with 0.1 um", sheets(("Angle [deg]", "Reading"), 0.1, '0.0" 0.1 um"')
    )
    cases["format_unknown"] = FieldCase(
        kind,
        "a number format with furlong",
        sheets(("Angle [deg]", "Reading"), 1.0, '0.0" furlong"'),
        refusal="got 'furlong' in line 2",
        step=("--unit", "um"),
    )
    cases["header_with_remark"] = FieldCase(
        kind,
        "a header 'Reading, µm (radial)'",
        texts("Angle, °;Reading, µm (radial)", separator=";"),
    )
    cases["header_of_comments"] = FieldCase(
        kind,
        "header and units behind number signs",
        texts("#angle\treading\n#deg\tum", separator="\t"),
    )
    cases["header_of_octave"] = FieldCase(
        kind,
        "a header behind a percent sign",
        texts("% Angle(deg)  Reading(um)", separator="  "),
    )
    cases["thousands_in_nm"] = FieldCase(
        kind,
        "whole nanometres with commas between thousands",
        texts(
            '"Angle [deg]","Reading [nm]"',
            lambda c, k: [f'"{c.angle_deg[k]:g}"', f'"{c.reading_um[k] * 1e3:,.0f}"'],
        ),
        refusal="Say which mark is decimal: --decimal ',', or '.' if these are thousands",
        step=("--decimal", "."),
    )
    cases["line_with_scale"] = FieldCase(
        kind,
        "a line 'Scale factor 10', no unit",
        texts(NO_UNIT, scaled(10.0), above="Scale factor 10"),
        refusal="got none, and 'Scale factor 10' in line 1. Say which: --unit",
        step=("--unit", "10 um"),
    )
    cases["counts_alone"] = FieldCase(
        kind,
        "readings in counts, nothing says of what",
        texts("Angle [deg],Reading [counts]", scaled(0.1)),
        refusal="--unit '0.1 um' for counts of 0.1 µm",
        step=("--unit", "0.1 um"),
    )
    cases["format_um"] = FieldCase(
        kind, "a number format with mm", sheets(("Angle [deg]", "Reading"), 1e3, '0.000000" mm"')
    )
    cases["format_mil"] = FieldCase(
        kind, "a number format with mil", sheets(("Angle", "Reading"), 25.4, '0.0000\\ "mil"')
    )
    cases["format_against_header"] = FieldCase(
        kind,
        "a number format with mm under a header in µm",
        sheets(("Angle [deg]", "Reading [um]"), 1e3, '0.000000" mm"'),
        refusal="said once, got mm in the number format of its cells and um in line 1",
        step=("--unit", "mm"),
    )
    return cases


def guess_cases() -> dict[str, FieldCase]:
    kind = "one guess for all"

    def small(force: float) -> Circle:
        reading = np.round(force * (0.002 + 0.0005 * np.cos(np.deg2rad(2.0 * ANGLES_DEG))), 4)
        return Circle(force, ANGLES_DEG, reading * 1e3)

    soft = tuple(small(force) for force in (50.0, 150.0, 300.0))
    return {
        "guess_in_um": FieldCase(kind, "no unit, numbers in µm", texts(NO_UNIT)),
        "guess_in_mm": FieldCase(kind, "no unit, numbers in mm", texts(NO_UNIT, scaled(1e3))),
        "guess_open": FieldCase(
            kind,
            "no unit, the largest numbers 0.125, 0.375, 0.75 at 50, 150, 300 N",
            texts(NO_UNIT, scaled(1e3, 4), circles=soft),
            refusal="0.002 µm/N in um or 2 µm/N in mm. Say which: --unit",
            step=("--unit", "mm"),
            circles=soft,
        ),
        "guess_none": FieldCase(
            kind,
            "no unit, numbers in inch",
            texts(NO_UNIT, scaled(25400.0)),
            refusal="Say which: --unit",
            step=("--unit", "inch"),
        ),
        "guess_force_kN": FieldCase(
            kind,
            "no unit, forces in kN",
            tidy(
                "test,Force,Angle_deg,Reading_um",
                lambda c, k: [f"c{c.force_N:g}", f"{c.force_N / 1e3:g}", *plain(c, k)],
            ),
            refusal="numbers up to 0.6, which are few newtons. Say which: --force-unit",
            step=("--force-unit", "kN"),
        ),
        "guess_angle_gon": FieldCase(
            kind,
            "no unit, angles in gon",
            texts(
                "Angle,Reading [um]",
                lambda c, k: [f"{c.angle_deg[k] / 0.9:.6f}", f"{c.reading_um[k]:.3f}"],
            ),
            refusal="which may be deg or gon. Say which: --angle-unit",
            step=("--angle-unit", "gon"),
        ),
        "guess_angle_mrad": FieldCase(
            kind,
            "no unit, angles in milliradians, in steps of 10°",
            texts(
                "Angle,Reading [um]",
                lambda c, k: [f"{1e3 * np.deg2rad(c.angle_deg[k]):.4f}", f"{c.reading_um[k]:.3f}"],
                circles=COARSE,
            ),
            refusal="which may be deg or mrad. Say which: --angle-unit",
            step=("--angle-unit", "mrad"),
            circles=COARSE,
        ),
        "guess_distances_in_inch": FieldCase(
            kind,
            "no unit, distances of the balls in inch",
            texts(
                NO_UNIT,
                lambda c, k: [
                    f"{c.angle_deg[k]:g}",
                    f"{(c.radius_mm + c.reading_um[k] / 1e3) / 25.4:.8f}",
                ],
            ),
            refusal="that hardly differ, as distances of the balls. Say which: --unit",
            step=("--unit", "inch"),
        ),
        "guess_angle_rad": FieldCase(
            kind,
            "no unit, angles in radians",
            texts(
                "Angle,Reading [um]",
                lambda c, k: [f"{np.deg2rad(c.angle_deg[k]):.6f}", f"{c.reading_um[k]:.3f}"],
            ),
        ),
    }


def small_circles(radius_mm: float) -> tuple[Circle, ...]:
    return tuple(replace(circle, radius_mm=radius_mm) for circle in TRUTH)


def distances(circle: Circle, k: int) -> list[object]:
    """Distances of opposite points of the circle, in mm."""
    diameter = 2.0 * (circle.radius_mm + circle.reading_um[k] / 1e3)
    return [f"{circle.angle_deg[k]:g}", f"{diameter:.6f}"]


def doubled(circle: Circle, k: int) -> list[object]:
    return [f"{circle.angle_deg[k]:g}", f"{2.0 * circle.reading_um[k]:.3f}"]


def diameter_cases() -> dict[str, FieldCase]:
    kind = "diameters for radii"
    headers = {
        "diameter_deviation": "Diameter deviation [um]",
        "delta_D": "ΔD [um]",
        "delta_D_word": "Delta D [um]",
        "durchmesserabweichung": "Durchmesserabweichung [µm]",
        "diametral_error": "Diametral error (um)",
        "ecart_diametre": "Écart de diamètre [µm]",
        "diameter_sign": "Ø-Abweichung [µm]",
        "dia": "Dia. error [um]",
    }
    cases = {}
    for name, header in headers.items():
        files = texts(f"Angle [deg],{header}", doubled)
        cases[f"header_{name}"] = FieldCase(
            kind, f"a header '{header}'", files, note="half of each, as it is of the diameter"
        )
    lines = {
        "values": "Values: diameter deviations",
        "messwerte": "Messwerte sind Durchmesserabweichungen",
        "readings_are": "Readings are diametral",
    }
    for name, line in lines.items():
        files = texts("Angle [deg],Reading [um]", doubled, above=line)
        cases[f"line_{name}"] = FieldCase(
            kind, f"a line '{line}'", files, note="half of each, as it is of the diameter"
        )
    cases["diameter_in_mm"] = FieldCase(
        kind, "diameters of the circle in mm", texts("Angle [deg],Diameter [mm]", distances)
    )
    cases["diameter_against_radial"] = FieldCase(
        kind,
        "a header of diameters under a line of radial deviations",
        texts("Angle [deg],Diameter deviation [um]", above="Values: radial deviation"),
        refusal="Say which: --measured",
        step=("--measured", "radius"),
    )
    return cases


def radius_cases() -> dict[str, FieldCase]:
    kind = "the radius in other words"
    lines = {
        "diameter": "Diameter: 200 mm",
        "bar_length": "Bar length: 100 mm",
        "letter": "R = 100 mm",
        "letter_D": "D = 200 mm",
        "kreisdurchmesser": "Kreisdurchmesser: 200 mm",
        "rayon": "Rayon : 100 mm",
        "rayon_du_cercle": "Rayon du cercle: 100 mm",
        "raggio": "Raggio: 100 mm",
        "radio": "Radio: 100 mm",
        "radius_in_inch": "Radius: 3.937007874 inch",
        "stablaenge": "Stablänge: 100 mm",
        "hankei": "半径：100 mm",
        "diameter_in_cells": "Durchmesser,200,mm",
        "diameter_sign": "Ø 200 mm",
        "stange": "Stange: 100 mm",
        "length_of_bar": "Length of the ball bar = 100 mm",
        "laenge_der_stange": "Länge der Stange: 100 mm",
        "kugelabstand": "Kugelabstand: 100 mm",
        "bar_behind": "100 mm bar",
        "diameter_behind": "Circle of 200 mm diameter",
        "dia": "Test circle dia. 200 mm",
        "rayon_nominal": "Rayon nominal : 100 mm",
        "unit_in_cell_before": "Radius,mm,100",
        "R0": "Nominal circle radius R0 = 100.000 mm",
        "raio": "Raio do círculo: 100 mm",
        "messkreis": "Messkreisdurchmesser 200 mm",
    }
    cases = {}
    for name, line in lines.items():
        cases[f"radius_{name}"] = FieldCase(
            kind,
            f"a line '{line}'",
            texts("Angle [deg],Reading [um]", above=line),
            circles=small_circles(100.0),
        )
    columns = {"letter": ("R [mm]", "100"), "word": ("Diameter [mm]", "200")}
    for name, (header, cell) in columns.items():
        cases[f"radius_column_{name}"] = FieldCase(
            kind,
            f"a column '{header}' of {cell}",
            texts(
                f"Angle [deg],{header},Deviation [um]",
                lambda c, k, cell=cell: [f"{c.angle_deg[k]:g}", cell, f"{c.reading_um[k]:.3f}"],
            ),
            circles=small_circles(100.0),
        )
    cases["radius_and_force_in_header"] = FieldCase(
        kind,
        "headers 'Radius 100 N', which are of forces",
        wide(
            "Angle [deg];" + ";".join(f"Radius {force:g} N [um]" for force in FORCES_N),
            lambda k: [f"{ANGLES_DEG[k]:g}", *readings_of(k)],
        ),
    )
    cases["radius_letter_without_unit"] = FieldCase(
        kind,
        "a line 'D200'",
        texts("Angle [deg],Reading [um]", above="D200"),
        note="line 1 says D200, not taken",
    )
    cases["radius_unknown_length"] = FieldCase(
        kind,
        "a line 'Nennmaß: 100 mm'",
        texts("Angle [deg],Reading [um]", above="Nennmaß: 100 mm"),
        note="says Nennmaß: 100 mm, not taken",
    )
    cases["radius_twice"] = FieldCase(
        kind,
        "a radius of 150 mm and a bar of 100 mm",
        texts("Angle [deg],Reading [um]", above="Radius: 150 mm\nBar length: 100 mm"),
        refusal="must be said once, got 150 mm in line 1 and 100 mm in line 2. Give --radius-mm",
        step=("--radius-mm", "150"),
    )
    cases["ball_diameter"] = FieldCase(
        kind,
        "diameters of ball and tool, which are no circle",
        texts(
            "Angle [deg],Reading [um]",
            above="Ball diameter: 25.4 mm\nKugeldurchmesser: 30 mm\nTool diameter: 20 mm",
        ),
    )
    return cases


def angle_cases() -> dict[str, FieldCase]:
    kind = "angles in words"
    headers = {
        "from_Y_clockwise": ("Angle from Y clockwise [deg]", 90.0, -1),
        "ab_Y": ("Winkel ab +Y im Uhrzeigersinn [°]", 90.0, -1),
        "from_minus_X": ("Angle [deg] (from -X, counter-clockwise)", 180.0, 1),
        "cw": ("Angle cw [deg]", 0.0, -1),
        "from_X": ("Angle from X [deg]", 0.0, 1),
        "encoder": ("Angle from encoder [deg]", 0.0, 1),
        "range": ("Angle from 0 to 360 [deg]", 0.0, 1),
        "minus": ("-theta [deg]", 0.0, -1),
        "360_minus": ("360-Angle [deg]", 0.0, -1),
    }
    cases = {}
    for name, (header, zero, sense) in headers.items():
        files = texts(f"{header.replace(',', ';')},Reading [um]", turned(zero, sense))
        cases[f"header_{name}"] = FieldCase(kind, f"a header '{header}'", files)
    lines = {
        "counted": ("Angle counted clockwise from +X", 0.0, -1),
        "zaehlsinn": ("Winkel: Nullpunkt +Y; Zählsinn: gegen den Uhrzeigersinn", 90.0, 1),
        "two_lines": ("Zero of the angle: +Y\nAngle sense: clockwise", 90.0, -1),
        "zero_is": ("Angle: 0° = -Y, positive counter-clockwise", 270.0, 1),
        "of_axis": ("Angles from the positive Y axis, clockwise", 90.0, -1),
        "travel": ("Direction: clockwise", 0.0, 1),
        "increase": ("Angles increase clockwise", 0.0, -1),
        "clockwise_angles": ("Clockwise angles", 0.0, -1),
        "winkelzaehlung": ("Winkelzählung im Uhrzeigersinn", 0.0, -1),
        "reference": ("Bezug der Winkel: +Y, UZS", 90.0, -1),
        "sign_behind": ("Angle origin is the machine's Y- direction, cw", 270.0, -1),
        "axis": ("Angle axis: Y (cw)", 90.0, -1),
        "start_of_angle": ("Start of angle at Y+, ccw", 90.0, 1),
        "mathematical": ("Winkel: 0° bei +Y, mathematisch negativ", 90.0, -1),
        "offset_of_zero": ("Angle offset: 0.0 deg", 0.0, 1),
        "squareness": ("Squareness: angle of Y is 89.99 deg", 0.0, 1),
    }
    for name, (line, zero, sense) in lines.items():
        files = texts("Angle [deg],Reading [um]", turned(zero, sense), above=line)
        cases[f"line_{name}"] = FieldCase(kind, f"a line '{line}'", files)
    cases["zero_without_sense"] = FieldCase(
        kind,
        "a line 'Zero of the angle: +Y'",
        texts("Angle [deg],Reading [um]", turned(90.0, -1), above="Zero of the angle: +Y"),
        refusal="Say which: --angle-sense CW or CCW",
        step=("--angle-sense", "cw"),
    )
    cases["zero_unknown"] = FieldCase(
        kind,
        "a header 'Angle from north clockwise'",
        texts("Angle from north clockwise [deg],Reading [um]", turned(90.0, -1)),
        refusal="Say at which: --angle-zero +X, +Y, -X or -Y",
        step=("--angle-zero", "+Y"),
    )
    no_axes = {
        "compass": "Compass angles",
        "oclock": "Angle zero: 12 o'clock",
        "axis_alone": "Angles along Y, clockwise",
        "atan": "Angle = atan2(x, y)",
        "offset": "Angle offset: 90 deg",
    }
    for name, line in no_axes.items():
        cases[f"zero_{name}"] = FieldCase(
            kind,
            f"a line '{line}'",
            texts("Angle [deg],Reading [um]", turned(90.0, -1), above=line),
            refusal="Say at which: --angle-zero +X, +Y, -X or -Y",
            step=("--angle-zero", "+Y", "--angle-sense", "CW"),
        )
    for word in ("Azimuth", "Bearing", "Heading"):
        cases[f"zero_{word.lower()}"] = FieldCase(
            kind,
            f"a header '{word} [deg]'",
            texts(f"{word} [deg],Reading [um]", turned(90.0, -1)),
            refusal="Say at which: --angle-zero +X, +Y, -X or -Y",
            step=("--angle-zero", "+Y", "--angle-sense", "CW"),
        )
    cases["zero_twice"] = FieldCase(
        kind,
        "a header from Y, a line from X",
        texts(
            "Angle from Y cw [deg],Reading [um]",
            turned(90.0, -1),
            above="Zero of the angle: +X",
        ),
        refusal="must be said once, got +Y and +X. Give --angle-zero",
        step=("--angle-zero", "Y"),
    )
    cases["zero_of_another_plane"] = FieldCase(
        kind,
        "angles from +Z in a plane XY",
        texts("Angle from Z clockwise [deg],Reading [um]", turned(90.0, -1)),
        refusal="must begin at an axis of plane XY, got +Z. Give --angle-zero",
        step=("--angle-zero", "+Y"),
    )
    return cases


def on_clock(start: datetime, form: str = "%H:%M:%S.%f") -> Callable[[float], str]:
    """Return stamps of a clock that shows ``start`` at the beginning of each circle."""

    def stamp(seconds: float) -> str:
        return (start + timedelta(seconds=seconds)).strftime(form)

    return stamp


def across_clock_change(with_zone: bool) -> Callable[[float], str]:
    """Return ISO stamps across the change from summer time; 9 s after the start it is 2 o'clock."""
    start = datetime(2026, 10, 25, 2, 59, 51)

    def stamp(seconds: float) -> str:
        moment = start + timedelta(seconds=seconds)
        zone = "+02:00"
        if seconds >= 9.0:
            moment -= timedelta(hours=1)
            zone = "+01:00"
        text = moment.isoformat(timespec="microseconds")
        return text + zone if with_zone else text

    return stamp


def with_jump(after_s: float, jump_s: float) -> Callable[[float], str]:
    """Return seconds of a clock that jumps by ``jump_s`` after some time."""

    def stamp(seconds: float) -> str:
        return f"{seconds + (jump_s if seconds > after_s else 0.0):.4f}"

    return stamp


def uneven(stamp: Callable[[float], str]) -> Callable[[float], str]:
    """Return stamps of which every fifth is late by 70 % of a step, as if the log hesitated."""

    def late(seconds: float) -> str:
        step = np.deg2rad(5.0) * RADIUS_MM / (FEED_MM_PER_MIN / 60.0)
        return stamp(seconds + (0.7 * step if round(seconds / step) % 5 == 2 else 0.0))

    return late


def seconds_text(seconds: float) -> str:
    return f"{seconds:.4f}"


def log_cases() -> dict[str, FieldCase]:
    kind = "logs over time"
    feed = f"Feed: {FEED_MM_PER_MIN:g} mm/min"
    epoch = 1_790_000_000.0

    def case(
        description: str, header: str, stamp: Callable[[float], str], **fields: Any
    ) -> FieldCase:
        above = fields.pop("above", feed)
        return FieldCase(
            kind, description, texts(f"{header},Reading [um]", logged(stamp), above=above), **fields
        )

    return {
        "epoch_s": case("seconds since 1970", "timestamp", lambda s: f"{epoch + s:.4f}"),
        "epoch_ms": case(
            "milliseconds since 1970",
            "timestamp",
            lambda s: f"{1e3 * (epoch + s):.1f}",
            note="unit of the time: ms (stamps since 1970",
        ),
        "epoch_us": case(
            "microseconds since 1970", "timestamp", lambda s: f"{1e6 * (epoch + s):.0f}"
        ),
        "ms_without_unit": case(
            "milliseconds, nothing says so",
            "Time",
            lambda s: f"{1e3 * s:.1f}",
            refusal="Give --time-unit (ms?)",
            step=("--time-unit", "ms"),
        ),
        "clock_change_with_zones": case(
            "ISO stamps with offsets across a clock change", "Time", across_clock_change(True)
        ),
        "clock_change_without_zones": case(
            "ISO stamps without offsets across a clock change",
            "Time",
            across_clock_change(False),
            note="the clock was set back",
        ),
        "past_midnight_with_dates": case(
            "dates and times past midnight",
            "Time",
            on_clock(datetime(2026, 5, 11, 23, 59, 50), "%Y-%m-%d %H:%M:%S.%f"),
        ),
        "set_back_by_a_second": case(
            "a clock set back by a second",
            "Time [s]",
            with_jump(14.0, -1.0),
            note="the clock was set back",
        ),
        "set_back_and_uneven": case(
            "a clock set back in an uneven log",
            "Time [s]",
            uneven(with_jump(14.0, -3.0)),
            refusal="if the clock was set back, give --gaps still",
            mended=texts("Time [s],Reading [um]", logged(with_jump(14.0, -3.0)), above=feed),
        ),
        "pause": case(
            "a pause of 30 s in which the machine stood",
            "Time [s]",
            with_jump(14.0, 30.0),
            refusal="Say what the machine did in it: --gaps still, or --gaps moving",
            step=("--gaps", "still"),
        ),
        "feed_in_label": case(
            "a feed with its unit in the label",
            "Time [s]",
            seconds_text,
            above="Vorschub [mm/min]: 2000",
        ),
        "feed_in_cells": case(
            "a feed with its unit in the label, in cells",
            "Time [s]",
            seconds_text,
            above="Vorschub [mm/min],2000",
        ),
        "feed_in_brackets": case(
            "a feed F (mm/min)",
            "Time [s]",
            seconds_text,
            above="Feed rate F (m/min) = 2.0",
        ),
        "feed_missing": case(
            "a log without a feed",
            "Time [s]",
            seconds_text,
            above="",
            refusal="Give --feed-mm-per-min",
            step=("--feed-mm-per-min", "2000"),
        ),
    }


def negated(circle: Circle, k: int) -> list[object]:
    return [f"{circle.angle_deg[k]:g}", f"{-circle.reading_um[k]:.3f}"]


def sign_cases() -> dict[str, FieldCase]:
    kind = "signs in words"
    header = "Angle [deg],Reading [um]"
    lines = {
        "shorter": "Positive readings: bar shorter",
        "plus": "Sign: + = shorter, - = longer",
        "kuerzer": "Vorzeichen: positiv = Stab kürzer",
        "inwards": "Readings count positive inwards",
        "plus_court": "Valeur positive : barre plus courte",
    }
    cases = {}
    for name, line in lines.items():
        cases[f"sign_{name}"] = FieldCase(
            kind,
            f"a line '{line}'",
            texts(header, negated, above=line),
            note="sign of the reading: −1: a longer bar is negative",
        )
    cases["sign_longer"] = FieldCase(
        kind,
        "a line 'Positive = bar longer'",
        texts(header, above="Positive = bar longer"),
        note="sign of the reading: 1: a longer bar is positive",
    )
    headers = {
        "minus": "-dR [um]",
        "nominal_less_R": "Rnom-R [um]",
        "nominal_less_actual": "Nominal - actual [um]",
        "soll_ist": "Soll - Ist [µm]",
    }
    for name, words in headers.items():
        cases[f"sign_header_{name}"] = FieldCase(
            kind,
            f"a header '{words}'",
            texts(f"Angle [deg],{words}", negated),
            note="sign of the reading: −1: a longer bar is negative",
        )
    for words in ("R - Rnom [um]", "Ist-Soll [µm]"):
        cases[f"sign_header_{words[0]}"] = FieldCase(
            kind, f"a header '{words}'", texts(f"Angle [deg],{words}")
        )
    cases["sign_of_force"] = FieldCase(
        kind,
        "a line about the sign of the force",
        texts(header, above="Positive force: spring is shorter"),
    )
    cases["sign_unclear"] = FieldCase(
        kind,
        "a line that names both signs and one length",
        texts(header, negated, above="Sign positive/negative: shorter"),
        refusal="Say which: --sign 1 (positive is longer) or -1",
        step=("--sign", "-1"),
    )
    cases["sign_twice"] = FieldCase(
        kind,
        "two lines that contradict each other",
        texts(header, negated, above="Positive: longer\nPositive: shorter"),
        refusal="must be said once, got a positive one for a longer bar in line 1 and for a shorter"
        " one in line 2. Give --sign",
        step=("--sign", "-1"),
    )
    return cases


def direction_cases() -> dict[str, FieldCase]:
    kind = "directions in words"
    lines = {
        "run": ("Run: CCW", "CCW"),
        "measured": ("Measured counter-clockwise", "CCW"),
        "gemessen": ("Gemessen gegen den Uhrzeigersinn", "CCW"),
        "sens": ("Sens antihoraire", "CCW"),
        "senso": ("Senso antiorario", "CCW"),
        "alone": ("CCW", "CCW"),
        "links": ("Drehrichtung: links", "CCW"),
        "chinese": ("方向: 逆时针", "CCW"),
        "russian": ("Направление: против часовой стрелки", "CCW"),
    }
    cases = {}
    for name, (line, direction) in lines.items():
        cases[f"direction_{name}"] = FieldCase(
            kind,
            f"a line '{line}'",
            texts("Angle [deg],Reading [um]", above=line),
            note=f"direction: {direction}",
            circles=tuple(replace(circle, direction=direction) for circle in TRUTH),
        )
    cases["direction_unknown"] = FieldCase(
        kind,
        "a line 'Direction: widdershins'",
        texts("Angle [deg],Reading [um]", above="Direction: widdershins"),
        note="'Direction: widdershins', not understood",
    )
    cases["direction_unknown_subject"] = FieldCase(
        kind,
        "a line 'Spindle clockwise'",
        texts("Angle [deg],Reading [um]", above="Turntable clockwise"),
        note="'Turntable clockwise', not understood",
    )
    return cases


def line_cases() -> dict[str, FieldCase]:
    kind = "lines above"
    some = texts("Angle [deg],Reading [um]")
    some["100N.csv"] = b"Direction: CCW\n" + some["100N.csv"]
    forward = tuple(replace(circle, direction="CCW") for circle in TRUTH)
    return {
        "title_under_load": FieldCase(
            kind,
            "a title 'Kreisformtest unter Last 2'",
            texts("Angle [deg],Reading [um]", above="Kreisformtest unter Last 2"),
        ),
        "title_under_load_with_colon": FieldCase(
            kind,
            "a title 'Test under load: 2026'",
            texts("Angle [deg],Reading [um]", above="Test under load: 2026"),
        ),
        "direction_of_some": FieldCase(
            kind,
            "a direction in one file of three",
            some,
            refusal="Give --direction if all ran alike",
            step=("--direction", "CCW"),
            circles=forward,
        ),
    }


def with_stored_values(sheet: Any, circle: Circle) -> None:
    """Write the readings as formulas of a column in mm, without their values."""
    for k in range(len(circle.angle_deg)):
        sheet.cell(k + 2, 3).value = float(circle.reading_um[k]) / 1e3
        sheet.cell(k + 2, 2).value = f"=C{k + 2}*1000"
    sheet.cell(1, 3).value = "Raw [V]"


def hidden_workbook(state: str) -> dict[str, bytes]:
    """Return a workbook with one more sheet, which is hidden."""

    def fill(book: Workbook) -> None:
        for number, circle in enumerate((*TRUTH, TRUTH[0])):
            is_old = number == len(TRUTH)
            sheet = book.create_sheet("old 450 N" if is_old else f"{circle.force_N:g} N")
            sheet.append(["Angle [deg]", "Reading [um]"])
            for k in range(len(circle.angle_deg)):
                sheet.append([float(circle.angle_deg[k]), float(circle.reading_um[k]) + number])
            if is_old:
                sheet.sheet_state = state
            else:
                for k in range(len(circle.angle_deg)):
                    sheet.cell(k + 2, 2).value = float(circle.reading_um[k])

    return {"m.xlsx": workbook(fill)}


def hide_repeated_rows(sheet: Any, circle: Circle) -> None:
    """Add six readings that were taken again, and hide them."""
    for k in range(6):
        sheet.append([float(circle.angle_deg[k]), 99.0])
        sheet.row_dimensions[sheet.max_row].hidden = True


def numbers_as_text(sheet: Any, circle: Circle) -> None:
    """Write every third reading as a text with a decimal comma."""
    for k in range(0, len(circle.angle_deg), 3):
        sheet.cell(k + 2, 2).value = f"{circle.reading_um[k]:.2f}1".replace(".", ",")
        sheet.cell(k + 2, 2).value = f"{circle.reading_um[k]:.3f}".replace(".", ",")


def workbook_cases() -> dict[str, FieldCase]:
    return {
        "hidden_sheet": FieldCase(
            "hidden", "a hidden sheet", hidden_workbook("hidden"), note="hidden sheets: 'old 450 N'"
        ),
        "very_hidden_sheet": FieldCase(
            "hidden",
            "a sheet that only a macro shows",
            hidden_workbook("veryHidden"),
            note="hidden sheets: 'old 450 N'",
        ),
        "hidden_rows": FieldCase(
            "hidden",
            "hidden rows below the table",
            sheets(change=hide_repeated_rows),
            note="6 hidden rows",
        ),
        "formula_without_value": FieldCase(
            "formulas",
            "formulas without stored values",
            sheets(change=with_stored_values),
            refusal="Open the file in a spreadsheet program and save it once",
            mended=sheets(),
        ),
    }


def all_cases() -> dict[str, FieldCase]:
    return {
        **unit_cases(),
        **guess_cases(),
        **diameter_cases(),
        **radius_cases(),
        **angle_cases(),
        **log_cases(),
        **sign_cases(),
        **direction_cases(),
        **line_cases(),
        **workbook_cases(),
    }


CASES = all_cases()


def main() -> None:
    """Write all cases, one folder each."""
    if len(sys.argv) != 2:
        sys.exit("give the folder to write")
    for name, case in CASES.items():
        folder = Path(sys.argv[1]) / name
        folder.mkdir(parents=True, exist_ok=True)
        for file, content in case.files.items():
            (folder / file).write_bytes(content)


if __name__ == "__main__":
    main()
