"""Field files that turn, scale or size their numbers in words: senses of angles, signs, diameters,
G-code, extensions of bars, factors, units, names of files, and tables of positions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache

import field_files as field
import numpy as np
from field_directions import direction_cases
from field_files import TRUTH, Circle, FieldCase
from field_languages import language_cases
from field_layouts import layout_cases
from field_passages import passage_cases
from field_printouts import printout_cases
from field_remarks import remark_cases
from field_sentences import sentence_cases
from field_shapes import shape_cases
from field_statements import statement_cases
from field_steps import step_cases
from openpyxl import Workbook

__all__ = ["word_cases"]

HEADER = "Angle [deg],Reading [um]"
NO_UNIT = "Angle [deg],Reading"
WHICH_SENSE = "Say which: --angle-sense CW or CCW"
WHICH_ZERO = "Say at which: --angle-zero +X, +Y, -X or -Y"
WHICH_SIGN = "Say which: --sign 1 (positive is longer) or -1"
WHICH_LENGTH = "Say which: --measured"


@cache
def word_cases() -> dict[str, FieldCase]:
    """Return the cases of words that turn, scale or size numbers."""
    return {
        **sense_cases(),
        **zero_cases(),
        **short_zero_cases(),
        **turned_sign_cases(),
        **shared_sign_cases(),
        **open_diameter_cases(),
        **programmed_cases(),
        **extension_cases(),
        **written_radius_cases(),
        **factor_cases(),
        **unit_of_line_cases(),
        **name_cases(),
        **position_cases(),
        **header_cases(),
        **column_cases(),
        **log_start_cases(),
        **direction_cases(),
        **layout_cases(),
        **step_cases(),
        **shape_cases(),
        **statement_cases(),
        **passage_cases(),
        **printout_cases(),
        **remark_cases(),
        **sentence_cases(),
        **language_cases(),
        **harmless_cases(),
    }


def of_radius(radius_mm: float, direction: str | None = None) -> tuple[Circle, ...]:
    circles = []
    for circle in TRUTH:
        circles.append(
            Circle(circle.force_N, circle.angle_deg, circle.reading_um, radius_mm, direction)
        )
    return tuple(circles)


def negated(circle: Circle, k: int) -> list[object]:
    return [f"{circle.angle_deg[k]:g}", f"{-circle.reading_um[k]:.3f}"]


def sense_cases() -> dict[str, FieldCase]:
    kind = "angles turned in words"
    lines = (
        "Angles: negative",
        "Angles negative",
        "Winkel: negativ",
        "Angle sign: -1",
        "Angles reversed",
        "Angles: left-handed",
        "Angles decreasing",
        "Angle = 360 - theta",
        "Winkel rechtsdrehend",
        "Negative angles: counter-clockwise",
    )
    cases = {}
    for number, line in enumerate(lines):
        cases[f"sense_{number}"] = FieldCase(
            kind,
            f"a line '{line}'",
            field.texts(HEADER, field.turned(0.0, -1), above=line),
            refusal=WHICH_SENSE,
            step=("--angle-sense", "CW"),
        )
    for number, header in enumerate(("Angle (negative) [deg]", "Winkel negativ [°]")):
        cases[f"sense_of_header_{number}"] = FieldCase(
            kind,
            f"a header '{header}'",
            field.texts(f"{header},Reading [um]", field.turned(0.0, -1)),
            refusal=WHICH_SENSE,
            step=("--angle-sense", "CW"),
        )
    for number, line in enumerate(("Angle: math negative", "phi: CW", "Angular direction: CW")):
        cases[f"sense_read_{number}"] = FieldCase(
            kind,
            f"a line '{line}'",
            field.texts(HEADER, field.turned(0.0, -1), above=line),
            note="angle: from +X, CW",
        )
    cases["sense_unread"] = FieldCase(
        kind,
        "a line 'Angles as on the drawing'",
        field.texts(HEADER, above="Angles as on the drawing"),
        note="line 1 says 'Angles as on the drawing', not understood",
    )
    return cases


def zero_cases() -> dict[str, FieldCase]:
    kind = "zero of angles in words"
    cases = {}
    lines = ("0 deg: +Y", "Y+ = 0 deg", "Polar axis: +Y")
    for number, line in enumerate(lines):
        cases[f"zero_axis_{number}"] = FieldCase(
            kind,
            f"a line '{line}'",
            field.texts(HEADER, field.turned(90.0, -1), above=line),
            refusal=WHICH_SENSE,
            step=("--angle-sense", "CW"),
        )
    cases["zero_clock"] = FieldCase(
        kind,
        "a line '0° = 12 o'clock'",
        field.texts(HEADER, field.turned(90.0, -1), above="0° = 12 o'clock"),
        refusal=WHICH_ZERO,
        step=("--angle-zero", "+Y", "--angle-sense", "CW"),
    )
    cases["zero_start"] = FieldCase(
        kind,
        "a line 'Start point: +Y'",
        field.texts(HEADER, above="Start point: +Y"),
        note="line 1 says 'Start point: +Y', not understood",
    )
    return cases


def short_zero_cases() -> dict[str, FieldCase]:
    """Return headers of angles from Y, clockwise, in short."""
    cases = {}
    for number, header in enumerate(("Angle (0=Y; CW) [deg]", "[°] Winkel (0=Y; CW)")):
        cases[f"zero_in_short_{number}"] = FieldCase(
            "zero of angles in words",
            f"a header '{header}'",
            field.texts(f"{header}|Reading [um]", field.turned(90.0, -1), separator="|"),
            note="angle: from +Y, CW",
        )
    lines = (
        "角度の基準,+Y軸から時計回り",
        "角度从+Y轴起顺时针",
        "각도: +Y축부터 시계방향",
        "angulo_deg: desde +Y, sentido horario",
        "Referência angular;eixo +Y, sentido horário",
        "Vinkel fra +Y, med klokka",
        "Hoek vanaf +Y, met de klok mee",
        "Відлік кутів: від осі +Y за годинниковою стрілкою",
    )
    for number, line in enumerate(lines):
        cases[f"zero_in_language_{number}"] = FieldCase(
            "zero of angles in words",
            f"a line '{line}'",
            field.texts(HEADER, field.turned(90.0, -1), above=line),
            note="angle: from +Y, CW",
        )
    return cases


def turned_sign_cases() -> dict[str, FieldCase]:
    kind = "signs turned in words"
    asked = ("Readings inverted", "Vorzeichen: umgekehrt", "Sign: -1", "Polarity: reversed")
    read = ("Positive = inside", "Compression positive", "Negative: away from centre")
    cases = {}
    for number, line in enumerate(asked):
        cases[f"sign_turned_{number}"] = FieldCase(
            kind,
            f"a line '{line}'",
            field.texts(HEADER, negated, above=line),
            refusal=WHICH_SIGN,
            step=("--sign", "-1"),
        )
    for number, line in enumerate(read):
        cases[f"sign_side_{number}"] = FieldCase(
            kind,
            f"a line '{line}'",
            field.texts(HEADER, negated, above=line),
            note="sign of the reading: −1: a longer bar is negative",
        )
    cases["sign_unread"] = FieldCase(
        kind,
        "a line 'Plus: material'",
        field.texts(HEADER, above="Plus: material"),
        note="line 1 says 'Plus: material', not understood",
    )
    return cases


def shared_sign_cases() -> dict[str, FieldCase]:
    """Return signs of readings that share a line, or an overview, with other statements."""
    kind = "signs beside other statements"
    note = "sign of the reading: −1: a longer bar is negative"
    turned_lines = {
        "Angle zero: +Y; sense: CW; positive: bar shorter": (90.0, -1),
        "Winkel ab +Y im Uhrzeigersinn, positiv = kürzer": (90.0, -1),
        "Angles run clockwise from +X. Positive values: bar shortened.": (0.0, -1),
        "Angles ccw from the negative X axis. Positive values: bar shortened.": (180.0, 1),
        "Angles ccw and positive readings mean a shorter bar": (0.0, 1),
        "Angles cw from +X - positive readings mean a shorter bar": (0.0, -1),
        "Feed 2000 mm/min (positive readings: bar shorter)": (0.0, 1),
    }
    cases = {}
    for number, (line, convention) in enumerate(turned_lines.items()):
        cases[f"sign_shared_{number}"] = FieldCase(
            kind,
            f"a line '{line}'",
            field.texts(HEADER, turned_and_negated(*convention), above=line),
            note=note,
        )
    short_lines = ("+ = in", "neg = out", "+ = toward the centre; - = away", "dR > 0: bar shorter")
    for number, line in enumerate(short_lines):
        cases[f"sign_short_{number}"] = FieldCase(
            kind, f"a line '{line}'", field.texts(HEADER, negated, above=line), note=note
        )
    cases["sign_closer"] = FieldCase(
        kind,
        "a line 'A positive deviation means the balls are closer together'",
        field.texts(
            HEADER, negated, above="A positive deviation means the balls are closer together"
        ),
        note=note,
    )
    asked = (
        "Sign: as on the drawing",
        "Sign convention: ISO 230-4",
        "Positive readings: see drawing",
    )
    for number, line in enumerate(asked):
        cases[f"sign_asked_{number}"] = FieldCase(
            kind,
            f"a line '{line}'",
            field.texts(HEADER, negated, above=line),
            refusal=WHICH_SIGN,
            step=("--sign", "-1"),
        )
    for label in ("Sign", "Vorzeichen", "Convention"):
        cases[f"sign_in_overview_{label.lower()}"] = FieldCase(
            kind,
            f"an overview with a row '{label} | positive reading: bar shorter'",
            signed_workbook(label),
            note=note,
        )
    return cases


def turned_and_negated(zero_deg: float, sense: int) -> field.Row:
    turned_row = field.turned(zero_deg, sense)

    def row(circle: Circle, k: int) -> list[object]:
        angle, _ = turned_row(circle, k)
        return [angle, negated(circle, k)[1]]

    return row


def signed_workbook(label: str) -> dict[str, bytes]:
    """Return a workbook of negated readings whose first sheet states their sign."""

    def fill(book: Workbook) -> None:
        overview = book.create_sheet("Index")
        overview.append(["Serial number", "4711"])
        overview.append([label, "positive reading: bar shorter"])
        overview.append([])
        overview.append(["Sheet", "Setup", "F [N]", "Remark"])
        for circle in TRUTH:
            overview.append([f"{circle.force_N:g} N", 1, circle.force_N, "ok"])
        for circle in TRUTH:
            sheet = book.create_sheet(f"{circle.force_N:g} N")
            sheet.append(HEADER.split(","))
            for k in range(len(circle.angle_deg)):
                sheet.append([float(circle.angle_deg[k]), -float(circle.reading_um[k])])

    return {"m.xlsx": field.workbook(fill)}


def open_diameter_cases() -> dict[str, FieldCase]:
    lines = ("Mode: diameter", "Messgröße: Durchmesser", "Readings doubled", "Values: 2 x dR")
    cases = {}
    for number, line in enumerate(lines):
        cases[f"diameter_open_{number}"] = FieldCase(
            "diameters for radii",
            f"a line '{line}'",
            field.texts(HEADER, field.doubled, above=line),
            refusal=WHICH_LENGTH,
            step=("--measured", "diameter"),
        )
    cases["diameter_of_column"] = FieldCase(
        "diameters for radii",
        "a line 'Column 2: diameter deviation'",
        field.texts(HEADER, field.doubled, above="Column 2: diameter deviation"),
        note="half of each, as it is of the diameter",
    )
    return cases


def programmed_cases() -> dict[str, FieldCase]:
    kind = "radii in G-code"
    blocks = {
        "centre": ("G2 X100 Y0 I-100 J0 F2000", "CW"),
        "centre_alone": ("N20 G3 I-100.", "CCW"),
        "slanted": ("G03 X60 Y80 I-60 J-80", "CCW"),
        "radius": ("G2 X0 Y0 R100", "CW"),
        "siemens": ("G3 X0 Y0 CR=100", "CCW"),
        "inches": ("G20\nG2 I-3.937007874", "CW"),
    }
    cases = {}
    for name, (block, direction) in blocks.items():
        description = block.replace("\n", ", ")
        cases[f"program_{name}"] = FieldCase(
            kind,
            f"a line '{description}'",
            field.texts(HEADER, above=block),
            note=f"direction: {direction}",
            circles=of_radius(100.0, direction),
        )
    cases["program_with_ways"] = FieldCase(
        kind,
        "arcs to the circle and from it, the radius in a line",
        field.texts(HEADER, above="Radius: 100 mm\nG3 X2 I1 J0\nG3 I-100 J0\nG3 X4 I2 J0"),
        circles=of_radius(100.0, "CCW"),
    )
    cases["program_with_ways_alone"] = FieldCase(
        kind,
        "arcs to the circle and from it",
        field.texts(HEADER, above="G3 X2 I1 J0\nG3 I-100 J0"),
        refusal="got 1 mm in line 1 and 100 mm in line 2. Give --radius-mm",
        step=("--radius-mm", "100"),
        circles=of_radius(100.0, "CCW"),
    )
    block = "C X+100 Y+0 DR+"
    cases["program_without_pole"] = FieldCase(
        kind,
        f"a line '{block}'",
        field.texts(HEADER, above=block),
        note=f"line 1 says {block}, not taken",
    )
    cases["program_absolute"] = FieldCase(
        kind,
        "a line 'G90.1 G2 X100 Y0 I0 J0'",
        field.texts(HEADER, above="G90.1 G2 X100 Y0 I0 J0"),
        note="direction: CW",
        circles=of_radius(100.0, "CW"),
    )
    return cases


def extension_cases() -> dict[str, FieldCase]:
    kind = "bars with extensions"
    sums = ("Bar: 100 mm + extension 50 mm", "Bar: 100 + 50 mm", "Stange: 100 mm plus 50 mm")
    unclear = (
        "Bar: 100 mm with 50 mm extension",
        "Ballbar 100 mm, extension 50 mm",
        "Bar: 100 mm\nExtension: 50 mm",
        "Kugelstab: 100 mm (Verlängerung 50 mm)",
        "Extension bar: 50 mm",
    )
    cases = {}
    for number, line in enumerate(sums):
        cases[f"extension_sum_{number}"] = FieldCase(
            kind,
            f"a line '{line}'",
            field.texts(HEADER, above=line),
            note="radius_mm: 150 mm (line 1",
        )
    for number, line in enumerate(unclear):
        description = line.replace("\n", ", ")
        cases[f"extension_unclear_{number}"] = FieldCase(
            kind,
            f"a line '{description}'",
            field.texts(HEADER, above=line),
            refusal="must be one number, got a bar and an extension in line 1. Give --radius-mm",
            step=("--radius-mm", "150"),
        )
    cases["extension_beside_radius"] = FieldCase(
        kind,
        "bar and extension beside a radius",
        field.texts(HEADER, above="Bar: 100 mm\nExtension: 50 mm\nRadius: 150 mm"),
    )
    return cases


def written_radius_cases() -> dict[str, FieldCase]:
    kind = "the radius in other words"
    lines = (
        "Radius: 100 ± 0.01 mm",
        "Radius = 100.",
        "Radius, mm: 100",
        "Radius (in mm): 100",
        "radius_mm=100",
        "Half diameter: 100 mm",
    )
    cases = {}
    for number, line in enumerate(lines):
        cases[f"radius_written_{number}"] = FieldCase(
            kind,
            f"a line '{line}'",
            field.texts(HEADER, above=line),
            circles=of_radius(100.0),
        )
    unread = {
        "Ballbar 150": "'Ballbar 150'",
        "Radius: 150 000 µm": "Radius: 150 000 µm, not taken",
        "Radius: one hundred mm": "Radius: one hundred mm, not taken",
        '{"radius_mm": 150}': "'{\"radius_mm\": 150}'",
    }
    for number, (line, note) in enumerate(unread.items()):
        cases[f"radius_unread_{number}"] = FieldCase(
            kind,
            f"a line '{line}'",
            field.texts(HEADER, above=line),
            note=f"line 1 says {note}",
        )
    return cases


def factor_cases() -> dict[str, FieldCase]:
    kind = "factors"
    cases = {}
    for number, line in enumerate(("Values x 10", "Readings multiplied by 10")):
        cases[f"factor_{number}"] = FieldCase(
            kind,
            f"a line '{line}' under a header in µm",
            field.texts(HEADER, field.scaled(0.1), above=line),
            refusal="Say which unit the numbers in the file have: --unit",
            step=("--unit", "0.1 um"),
        )
    cases["gain_0"] = FieldCase(
        kind,
        "a line 'Gain: 10' under a header in µm",
        field.texts(HEADER, above="Gain: 10"),
        refusal="Say which unit the numbers in the file have: --unit",
        step=("--unit", "um"),
    )
    cases["gain_1"] = FieldCase(
        kind,
        "a line 'Sensitivity: 0.5 um/V' under a header in µm",
        field.texts(HEADER, above="Sensitivity: 0.5 um/V"),
        note="line 1 says 'Sensitivity: 0.5 um/V', not used",
    )
    return cases


def unit_of_line_cases() -> dict[str, FieldCase]:
    kind = "a unit beside or above"
    cases = {}
    tenths = ("0.1 um", "Measurement unit - 0.1 um")
    for number, line in enumerate(tenths):
        cases[f"unit_with_factor_{number}"] = FieldCase(
            kind,
            f"a line '{line}'",
            field.texts(NO_UNIT, field.scaled(0.1), above=line),
            note="unit of the reading: 0.1 um (line 1",
        )
    cases["unit_in_brackets_with_in"] = FieldCase(
        kind,
        "a header 'Reading (in mm)'",
        field.texts("Angle (in deg),Reading (in mm)", field.scaled(1e3)),
    )
    cases["unit_no_length"] = FieldCase(
        kind,
        "a line 'Deviation (V)'",
        field.texts(NO_UNIT, above="Deviation (V)"),
        refusal="got 'V' in line 1. Correct the header, or give --unit",
        step=("--unit", "um"),
    )
    for number, line in enumerate(("mm", "[mm]", "Readings [mm]", "Abweichung (mm)")):
        cases[f"unit_alone_{number}"] = FieldCase(
            kind,
            f"a line '{line}'",
            field.texts(NO_UNIT, field.scaled(1e3), above=line),
            note="unit of the reading: mm (line 1",
        )
    cases["unit_alone_against_header"] = FieldCase(
        kind,
        "a line 'Readings [mm]' above a header in µm",
        field.texts(HEADER, above="Readings [mm]"),
        refusal="said once, got um in line 2 and mm in line 1",
        step=("--unit", "um"),
    )
    cases["unit_unknown_in_brackets"] = FieldCase(
        kind,
        "a line 'Units (V)', numbers that fit µm",
        field.texts(NO_UNIT, above="Units (V)"),
        refusal="numbers that fit um, and 'Units (V)' in line 1. Say which: --unit",
        step=("--unit", "um"),
    )
    cases["unit_mentioned"] = FieldCase(
        kind,
        "a line 'Columns: deg; mm', numbers that fit µm",
        field.texts(NO_UNIT, above="Columns: deg; mm"),
        refusal="numbers that fit um, and 'Columns: deg; mm' in line 1. Say which: --unit",
        step=("--unit", "um"),
    )
    cases["unit_mentioned_beside_header"] = FieldCase(
        kind,
        "a line 'Deviations expressed in mm' above a header in µm",
        field.texts(HEADER, above="Y axis: mm"),
        note="line 1 says 'Y axis: mm', not used",
    )
    return cases


def renamed(files: Mapping[str, bytes], pattern: str) -> dict[str, bytes]:
    """Return files whose names are ``pattern`` with their force, as 100N, for ``{F}``."""
    return {
        pattern.replace("{F}", name.partition(".")[0]) + ".csv": content
        for name, content in files.items()
    }


def name_cases() -> dict[str, FieldCase]:
    kind = "names of files"
    cases = {}

    def add(
        pattern: str,
        row: Callable[[Circle, int], Sequence[object]] = field.plain,
        header: str = HEADER,
        **fields: object,
    ) -> None:
        files = renamed(field.texts(header, row), pattern)
        description = f"names as '{pattern.replace('{F}', '100N')}'"
        cases[f"name_{len(cases)}"] = FieldCase(kind, description, files, **fields)

    add("{F}_radius_100mm", circles=of_radius(100.0))
    add("{F}_R100.5", circles=of_radius(100.5))
    add("{F}_150mm", note="its name says 150mm, not taken")
    add("{F}_D300", note="its name says D300, not taken")
    add("{F}_bar150", note="its name says bar150, not taken")
    add("{F}_angle_cw", field.turned(0.0, -1), note="angle: from +X, CW")
    add("{F}_fromY_cw", field.turned(90.0, -1), note="angle: from +Y, CW")
    add(
        "{F}_compass",
        field.turned(90.0, -1),
        refusal=WHICH_ZERO,
        step=("--angle-zero", "+Y", "--angle-sense", "CW"),
    )
    add(
        "{F}_diameter",
        field.doubled,
        refusal=WHICH_LENGTH,
        step=("--measured", "diameter"),
    )
    add("{F}_inverted", note="its name says 'inverted', not understood")
    add("{F}_mm", header=NO_UNIT, refusal="Say which: --unit", step=("--unit", "um"))
    add(
        "{F}_0.1um",
        field.scaled(0.1),
        header=NO_UNIT,
        refusal="Say which: --unit",
        step=("--unit", "0.1 um"),
    )
    return cases


def position(circle: Circle, k: int) -> list[str]:
    """Return the positions along X and Y at a reading [mm]."""
    angle = np.deg2rad(circle.angle_deg[k])
    radius = circle.radius_mm + 1e-3 * circle.reading_um[k]
    return [f"{radius * np.cos(angle):.7f}", f"{radius * np.sin(angle):.7f}"]


def converted(circle: Circle, k: int) -> list[str]:
    """Return angle [deg] and reading [mm] as the refusal of positions says."""
    x, y = (float(cell) for cell in position(circle, k))
    angle = np.mod(np.rad2deg(np.arctan2(y, x)), 360.0)
    return [f"{angle:.6f}", f"{np.hypot(x, y) - circle.radius_mm:.6f}"]


def position_cases() -> dict[str, FieldCase]:
    kind = "positions"
    mended = field.texts("angle [deg],reading [mm]", converted)
    advice = "add a column 'angle [deg]', arctan2(Y, X) about the centre of the circle"
    return {
        "positions": FieldCase(
            kind,
            "columns X and Y alone",
            field.texts("X [mm],Y [mm]", position),
            refusal=f"{advice}, and a column 'reading [mm]', √(X² + Y²) less the radius",
            mended=mended,
        ),
        "positions_without_header": FieldCase(
            kind,
            "X and Y without a header",
            field.texts("", position),
            refusal="got two columns of positions on a circle",
            mended=mended,
        ),
        "positions_and_readings": FieldCase(
            kind,
            "columns X, Y and readings",
            field.texts(
                "X [mm],Y [mm],Reading [um]",
                lambda c, k: [*position(c, k), f"{c.reading_um[k]:.3f}"],
            ),
            refusal=f"{advice}. If one column",
            mended=field.texts(
                "X [mm],Y [mm],Reading [um],Angle [deg]",
                lambda c, k: [*position(c, k), f"{c.reading_um[k]:.3f}", converted(c, k)[0]],
            ),
        ),
    }


def header_cases() -> dict[str, FieldCase]:
    kind = "headers of readings"
    cases = {}

    def add(
        header: str, row: Callable[[Circle, int], Sequence[object]], refusal: str, *step: str
    ) -> None:
        files = field.texts(f"Angle [deg];{header}", row, separator=";")
        description = f"a header '{header}'"
        cases[f"header_{len(cases)}"] = FieldCase(
            kind, description, files, refusal=refusal, step=step
        )

    for header in ("Reading x10 [um]", "10*dR [um]", "Reading (x10) [um]", "dR_x10 [um]"):
        add(header, field.scaled(0.1), "Say which unit the numbers", "--unit", "0.1 um")
    for header in ("Reading inverted [um]", "Deviation (neg) [um]", "-1*dR [um]"):
        add(header, negated, WHICH_SIGN, "--sign", "-1")
    for header in ("2 x dR [um]", "D deviation [um]", "Double deviation [um]"):
        add(header, field.doubled, WHICH_LENGTH, "--measured", "diameter")
    for header in ("Reading mm [um]", "Reading_um [mm]", "Reading (mm) um"):
        add(header, field.plain, "Correct the header, or give --unit", "--unit", "um")
    read = {"Nominal minus actual [um]": negated, "dØ [um]": field.doubled}
    read |= {"Durchm.-Abw. [µm]": field.doubled, "[mm] -dR": scaled_and_negated}
    for header, row in read.items():
        files = field.texts(f"[deg] Winkel;{header}", row, separator=";")
        cases[f"header_{len(cases)}"] = FieldCase(kind, f"a header '{header}'", files)
    return cases


def scaled_and_negated(circle: Circle, k: int) -> list[object]:
    return [f"{circle.angle_deg[k]:g}", f"{-1e-3 * circle.reading_um[k]:.6f}"]


def column_cases() -> dict[str, FieldCase]:
    kind = "the radius in other words"
    read = {"Ballbar": "100 mm", "Radius [cm]": "10"}
    noted = {"Circle [mm]": "Circle 150 mm", "L [mm]": "L 150 mm"}
    cases = {}
    for number, (header, cell) in enumerate(read.items()):
        cases[f"radius_in_column_{number}"] = FieldCase(
            kind,
            f"a column '{header}' of {cell}",
            with_column(header, cell),
            circles=of_radius(100.0),
        )
    for number, (header, note) in enumerate(noted.items()):
        cases[f"length_in_column_{number}"] = FieldCase(
            kind,
            f"a column '{header}' of 150",
            with_column(header, "150"),
            note=f"says {note!r}",
        )
    cases["blanks_in_cells"] = FieldCase(
        "separators",
        "tabs between cells, a blank in each cell and in a header",
        field.texts(
            "Winkel\tDouble deviation [um]",
            lambda c, k: [f"{c.angle_deg[k]:g} Grad", f"{2.0 * c.reading_um[k]:.3f}"],
            separator="\t",
        ),
        refusal="units belong into the header, not into cells",
        mended=field.texts("Winkel [Grad]\tDiameter deviation [um]", field.doubled, separator="\t"),
    )
    cases["loads_in_names_of_tests"] = FieldCase(
        "names of tests",
        "a column of tests with cells as '100N'",
        field.tidy(
            "test,Angle [deg],Reading [um]",
            lambda c, k: [f"{c.force_N:g}N", *field.plain(c, k)],
        ),
        note="force_N: 100 N (the name '100 N'",
    )
    cases["unread_units_at_the_end"] = FieldCase(
        "units in cells",
        "cells of the last tests with a unit that is not read",
        field.tidy("test,Angle,Reading", in_other_units),
        refusal="must be a finite number, got",
        mended=field.tidy(
            "test,Angle,Reading",
            lambda c, k: [f"{c.force_N:g} N", f"{c.angle_deg[k]:g} deg", f"{c.reading_um[k]} um"],
        ),
    )
    cases["letter_R_before_load"] = FieldCase(
        "headers of readings",
        "headers 'R0 - R 100 N_um'",
        field.wide(
            "Angle_deg;" + ";".join(f"R0 - R {force:g} N_um" for force in field.FORCES_N),
            lambda k: [f"{field.ANGLES_DEG[k]:g}", *(f"{-c.reading_um[k]:.3f}" for c in TRUTH)],
        ),
    )
    return cases


def in_other_units(circle: Circle, k: int) -> list[str]:
    """Return a reading in µm below 300 N, and in steps of 10 µm from 300 N on."""
    cells = [f"{circle.force_N:g} N", f"{circle.angle_deg[k]:g} deg"]
    if circle.force_N < 300.0:
        return [*cells, f"{circle.reading_um[k]} um"]
    return [*cells, f"{circle.reading_um[k] / 10.0:.4f} x 10 um"]


def with_column(header: str, cell: str) -> dict[str, bytes]:
    """Return files with a column of one value."""
    return field.texts(
        f"Angle [deg];{header};Deviation [um]",
        lambda c, k: [f"{c.angle_deg[k]:g}", cell, f"{c.reading_um[k]:.3f}"],
        separator=";",
    )


def log_start_cases() -> dict[str, FieldCase]:
    kind = "starts of logs"
    starts = {
        "Start at +Y": 90.0,
        "Start point: Y-": 270.0,
        "Start: -X": 180.0,
        "Begin: 90 deg": 90,
    }
    cases = {}
    for number, (line, start) in enumerate(starts.items()):
        cases[f"log_start_{number}"] = FieldCase(
            kind, f"a line '{line}'", log_from(start, f"Feed: 2000 mm/min\n{line}")
        )
    for number, line in enumerate(("Angle from Y, counter-clockwise", "Start X0 Y150")):
        cases[f"log_start_asked_{number}"] = FieldCase(
            kind,
            f"a line '{line}'",
            log_from(90.0, f"Feed: 2000 mm/min\n{line}"),
            refusal="must say where its circle starts",
            step=("--start-deg", "90"),
        )
    for number, line in enumerate(("Feed override: 50 %", "Vorschub 100 mm/min x 50 %")):
        cases[f"log_feed_share_{number}"] = FieldCase(
            kind,
            f"a line '{line}'",
            log_from(0.0, line),
            refusal="the feed must be that of the machine",
            step=("--feed-mm-per-min", "2000"),
        )
    return cases


def log_from(start_deg: float, above: str) -> dict[str, bytes]:
    """Return logs over time of circles that start at an angle and run counter-clockwise."""
    shift = round(start_deg / 5.0)

    def row(circle: Circle, k: int) -> list[object]:
        seconds = np.deg2rad(circle.angle_deg[k]) * circle.radius_mm * 60.0 / 2000.0
        reading = circle.reading_um[(k + shift) % len(circle.reading_um)]
        return [f"{seconds:.6f}", f"{reading:.3f}"]

    return field.texts("Time [s];Reading [um]", row, above=above, separator=";")


def harmless_cases() -> dict[str, FieldCase]:
    """Return lines that look like statements about angles, signs or radii, and are none."""
    lines = (
        "Data inverted: no",
        "Direction reversed: no",
        "Max negative deviation: -12.3 um",
        "Readings: 72 / turn",
        "Values per turn: 72",
        "Ball-bar test according to ISO 230-4",
        "Zero point: G54",
        "Workpiece: aluminium 200 x 200 mm",
        "Bearing preload: 50 N max.",
        "Positional tolerance 0.02 mm",
        "Radius compensation: off",
        "Extension cable 5 m",
        "Umkehrspanne X: 3 µm",
        "Diameter of workpiece: 200 mm",
    )
    cases = {}
    for number, line in enumerate(lines):
        cases[f"harmless_{number}"] = FieldCase(
            "harmless lines", f"a line '{line}'", field.texts(HEADER, above=line)
        )
    return cases
