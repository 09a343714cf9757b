"""Field files that state units, signs and angles at unusual places: in lists of units, in columns
of units with names, in rows of units with factors, and in names of columns.
"""

from __future__ import annotations

from dataclasses import replace

import field_files as field
from field_files import Circle, FieldCase, Row
from openpyxl import Workbook

__all__ = ["statement_cases"]

HEADER = "Angle [deg];Reading [um]"
NEGATED = "sign of the reading: −1: a longer bar is negative"
KEPT = "sign of the reading: 1: a longer bar is positive"
HALVED = "half of each, as it is of the diameter"
COUNTER_CLOCKWISE = tuple(replace(circle, direction="CCW") for circle in field.TRUTH)


def statement_cases() -> dict[str, FieldCase]:
    """Return the cases of statements at unusual places."""
    return {
        **list_cases(),
        **turn_cases(),
        **named_unit_cases(),
        **temperature_cases(),
        **unit_row_cases(),
        **angle_name_cases(),
        **reading_name_cases(),
        **numbered_column_cases(),
        **segment_cases(),
        **below_cases(),
    }


def list_cases() -> dict[str, FieldCase]:
    kind = "lists of units"
    sizes = {
        "deg/10 nm": 0.01,
        "° / 0.1 µm": 0.1,
        "[deg], [1/1000 mm]": 1.0,
        "Units: deg, 10 nm": 0.01,
        "Units: deg / 0.1 µm": 0.1,
        "Einheiten: Grad; 0,01 mm": 10.0,
        "deg/mm": 1e3,
        "Maßeinheit: 1/10 µm": 0.1,
        "Units deg/10 nm": 0.01,
        "Unit 0.1 µm / °": 0.1,
        "Angle: deg; Reading: 10 nm": 0.01,
    }
    cases = {}
    for number, (line, size) in enumerate(sizes.items()):
        files = field.texts("Angle;Reading", field.scaled(size), above=line, separator=";")
        note = "unit of the reading: "
        cases[f"unit_list_{number}"] = FieldCase(kind, f"a line '{line}'", files, note=note)
    cases["unit_list_factor_behind"] = FieldCase(
        kind,
        "a line 'units = °, µm/10'",
        field.texts("Angle;Reading", field.scaled(0.1), above="units = °, µm/10", separator=";"),
        refusal="in line 1. Correct the header, or give --unit",
        step=("--unit", "0.1 um"),
    )
    cases["unit_joined_to_factor"] = FieldCase(
        kind,
        "a header 'Reading 0.1um'",
        field.texts("Angle [deg];Reading 0.1um", field.scaled(0.1), separator=";"),
        refusal="Correct the header, or give --unit",
        step=("--unit", "0.1 um"),
    )
    cases["unit_list_unclear"] = FieldCase(
        kind,
        "a line '10 nm/micron/µm'",
        field.texts("Angle;Reading", above="10 nm/micron/µm", separator=";"),
        refusal="got '10 nm and um' in line 1. Correct the header, or give --unit",
        step=("--unit", "um"),
    )
    return cases


def in_turns(circle: Circle, k: int) -> list[object]:
    return [f"{circle.angle_deg[k] / 360.0:.9f}", f"{circle.reading_um[k]:.3f}"]


def in_turns_beside_units(circle: Circle, k: int) -> list[object]:
    angle, reading = in_turns(circle, k)
    return [angle, "rev", reading, "µm"]


def turn_cases() -> dict[str, FieldCase]:
    kind = "angles in turns"
    headers = {
        "Angle [turns];Reading [um]": "",
        "Winkel [U];Messwert [um]": "",
        "Winkel in Umdrehungen;Messwert [um]": "",
        "angle (rev);Reading [um]": "",
        "angle [tours];écart [um]": "",
        "Angle;Reading\nturns;um": "",
        "Angle;Reading [µm]": "Angles in revolutions",
        "Winkel;Messwert [µm]": "Winkel in Umdrehungen",
    }
    cases = {}
    for number, (header, above) in enumerate(headers.items()):
        description = f"a header '{header}'".replace("\n", " / ") + f" below '{above}'" * bool(
            above
        )
        files = field.texts(header, in_turns, above=above, separator=";")
        cases[f"turns_{number}"] = FieldCase(kind, description, files)
    header = "Angle;unit;Reading;unit"
    files = field.texts(header, in_turns_beside_units, separator=";")
    cases["turns_of_column"] = FieldCase(kind, "a column with the unit 'rev'", files)
    cases["turns_unstated"] = FieldCase(
        kind,
        "angles from 0 to 1 without a unit",
        field.texts("Angle;Reading [um]", in_turns, separator=";"),
        refusal="which may be rad or turn. Say which: --angle-unit",
        step=("--angle-unit", "turn"),
    )
    return cases


def beside_units(circle: Circle, k: int) -> list[object]:
    return [f"{circle.angle_deg[k]:g}", "deg", f"{1e-3 * circle.reading_um[k]:.6f}", "mm"]


def behind_units(circle: Circle, k: int) -> list[object]:
    angle, angle_unit, reading, reading_unit = beside_units(circle, k)
    return [reading_unit, angle_unit, angle, reading]


def named_unit_cases() -> dict[str, FieldCase]:
    kind = "columns of units with names"
    headers = (
        "theta;theta_unit;reading;reading_unit",
        "angle;angle unit;dev;dev_unit",
        "Winkel;Winkeleinheit;Messwert;Einheit Messwert",
        "angle;unité angle;écart;unité écart",
        "Angle;Unit of angle;Deviation;Unit of deviation",
    )
    cases = {}
    for number, header in enumerate(headers):
        files = field.texts(header, beside_units, separator=";")
        cases[f"named_units_{number}"] = FieldCase(kind, f"a header '{header}'", files)
    header = "reading_unit;theta_unit;theta;reading"
    files = field.texts(header, behind_units, separator=";")
    cases["named_units_in_front"] = FieldCase(kind, f"a header '{header}'", files)
    return cases


def beside_temperature(circle: Circle, k: int) -> list[object]:
    time, reading = field.logged("{:.4f}".format)(circle, k)
    return [time, "20.1", reading]


def temperature_cases() -> dict[str, FieldCase]:
    kind = "temperatures beside times"
    options = ("--direction", "CCW", "--feed-mm-per-min", "2000")
    cases = {}
    for number, header in enumerate(("angle_C;Reading [um]", "theta (C);Reading [um]")):
        cases[f"angle_of_axis_{number}"] = FieldCase(
            "angles of the C axis",
            f"a header '{header}'",
            field.texts(header, separator=";"),
            options=("--angle-unit", "deg"),
        )
    for number, name in enumerate(("T [°C]", "T_amb (°C)", "T/°C", "T [K]", "T_C", "Temperatur")):
        files = field.texts(f"t [s];{name};Reading [um]", beside_temperature, separator=";")
        note = f"columns not used: {name}"
        cases[f"temperature_{number}"] = FieldCase(
            kind, f"a column '{name}' beside 't [s]'", files, options=options, note=note
        )
    return cases


def angle_in_cell(unit: str, size: float) -> Row:
    def row(circle: Circle, k: int) -> list[object]:
        angle, reading, unit_of_reading = field.beside(unit, size)(circle, k)
        return [f"{angle} °", reading, unit_of_reading]

    return row


def unit_row_cases() -> dict[str, FieldCase]:
    kind = "rows of units with factors"
    sizes = {
        "°;1/1000 mm": 1.0,
        "[deg];[1/1000 mm]": 1.0,
        "(°);(0.01 mm)": 10.0,
        "Grad;0,1 µm": 0.1,
        "deg;10 nm": 0.01,
    }
    cases = {}
    for number, (units, size) in enumerate(sizes.items()):
        files = field.texts(f"Winkel;Messwert\n{units}", field.scaled(size), separator=";")
        description = f"a row of units '{units}'"
        note = "unit of the reading: "
        cases[f"unit_row_{number}"] = FieldCase(kind, description, files, note=note)
    for number, units in enumerate(("° 1/1000 mm", "[deg] [1/1000 mm]")):
        files = field.texts(f"Angle Reading\n{units}", separator=" ")
        cases[f"unit_row_blanks_{number}"] = FieldCase(kind, f"a row of units '{units}'", files)
    for number, (unit, size) in enumerate({"1/1000 mm": 1.0, "um": 1.0, "in": 25400.0}.items()):
        cases[f"cell_and_column_{number}"] = FieldCase(
            "units in cells beside a column of units",
            f"angles as '10.00 °', and '{unit}' in a column of units",
            field.texts("theta;Deviation;", angle_in_cell(unit, size), separator=";"),
            note="unit of the reading: ",
        )
    cases["inch_alone"] = FieldCase(
        "units that are also words",
        "a line of nothing but 'in'",
        field.texts("Angle [deg];Reading", field.scaled(25400.0), above="in", separator=";"),
        refusal="readings must have a unit, got none",
        step=("--unit", "inch"),
    )
    cases["unit_row_against_header"] = FieldCase(
        kind,
        "a row of units 'deg;0.001 mm' below 'Reading [mm]'",
        field.texts("Angle;Reading [mm]\ndeg;0.001 mm", separator=";"),
        refusal="got 'mm and 0.001 mm",
        step=("--unit", "um"),
    )
    return cases


def angle_name_cases() -> dict[str, FieldCase]:
    kind = "angles turned in words"
    names = (
        "angle_from_y_cw_deg",
        "theta_from_Y_clockwise",
        "Winkel_ab_Y_im_UZS",
        "angleFromY_cw",
        "theta_cw_from_pos_Y",
    )
    cases = {}
    for number, name in enumerate(names):
        files = field.texts(f"{name};Reading [um]", field.turned(90.0, -1), separator=";")
        description = f"a header '{name}'"
        cases[f"angle_name_{number}"] = FieldCase(
            kind, description, files, note="angle: from +Y, CW"
        )
    files = field.texts(HEADER, field.turned(90.0, -1), above="angle_from_y_cw", separator=";")
    cases["angle_name_in_line"] = FieldCase(
        kind, "a line 'angle_from_y_cw'", files, note="angle: from +Y, CW"
    )
    files = field.texts("angle_from_neg_y_ccw;dR [um]", field.turned(270.0, 1), separator=";")
    cases["angle_name_of_negative_axis"] = FieldCase(
        kind, "a header 'angle_from_neg_y_ccw'", files, note="angle: from -Y, CCW"
    )
    return cases


def negated(circle: Circle, k: int) -> list[object]:
    return [f"{circle.angle_deg[k]:g}", f"{-circle.reading_um[k]:.3f}"]


def reading_name_cases() -> dict[str, FieldCase]:
    kind = "signs in names of readings"
    turned = (
        "programmed radius - measured radius",
        "théorique - mesuré",
        "nominale - misurato",
        "dev = prog. - meas.",
        "Shrinkage",
        "retraction",
        "Verkürzung",
        "Stauchung",
        "raccourcissement de la barre",
        "Shortening of the bar",
    )
    positive_names = ("measured - nominal", "Ist - Soll", "elongation", "Stabverlängerung")
    cases = {}
    for number, name in enumerate(turned):
        files = field.texts(f"Angle [deg];{name} [um]", negated, separator=";")
        description = f"a header '{name} [um]'"
        cases[f"reading_name_{number}"] = FieldCase(kind, description, files, note=NEGATED)
        files = field.texts(HEADER, negated, above=f"Readings: {name}", separator=";")
        description = f"a line 'Readings: {name}'"
        cases[f"reading_line_{number}"] = FieldCase(kind, description, files, note=NEGATED)
    for number, name in enumerate(positive_names):
        files = field.texts(f"Angle [deg];{name} [um]", separator=";")
        description = f"a header '{name} [um]'"
        cases[f"reading_name_kept_{number}"] = FieldCase(kind, description, files, note=KEPT)
    files = field.texts(HEADER, above="Soll-Ist-Vergleich", separator=";")
    note = "texts not used: 'Soll-Ist-Vergleich'"
    cases["reading_line_title"] = FieldCase(kind, "a title 'Soll-Ist-Vergleich'", files, note=note)
    return cases


def numbered_column_cases() -> dict[str, FieldCase]:
    """Return a workbook with an overview whose columns are not those that the user states."""

    def fill(book: Workbook) -> None:
        overview = book.create_sheet("Index")
        overview.append(["Sheet", "F [N]", "Remark"])
        for circle in field.TRUTH:
            overview.append([f"{circle.force_N:g} N", circle.force_N, "ok"])
        for circle in field.TRUTH:
            sheet = book.create_sheet(f"{circle.force_N:g} N")
            sheet.append(["phi [deg]", "Auslenkung [um]"])
            for k in range(len(circle.angle_deg)):
                sheet.append([float(circle.angle_deg[k]), float(circle.reading_um[k])])

    return {
        "numbered_columns": FieldCase(
            "columns by number",
            "a workbook with an overview, and columns that the user states by number",
            {"m.xlsx": field.workbook(fill)},
            options=("--angle-column", "1", "--reading-column", "2"),
            note="list of tests: the sheet (its rows name tests",
        )
    }


def segment_cases() -> dict[str, FieldCase]:
    """Return lines that state a force, date or angle beside sign, diameter or direction."""
    kind = "several statements in a line"
    signs = (
        "# nominal minus measured; angles ccw from +X",
        "Force {F} N, nominal minus measured",
        "Winkel ab +X gegen den Uhrzeigersinn; Soll - Ist",
        "Machine DMU 50; nominal minus measured; Force {F} N",
    )
    diameters = (
        "Force {F} N, diameter deviation",
        "R = 150 mm, deviation of the diameter",
        "Date: 2026-11-20, deviation of the diameter",
    )
    directions = (
        "Force {F} N; travel counter-clockwise",
        "Force {F} N, plane XY, R 150 mm, travel counter-clockwise",
        "Kraft {F} N   Linkslauf: ja",
        "Kraft {F} N   Linkslauf: ja   Rechtslauf: nein",
        "Force {F} N; CW [ ] CCW [x]",
    )
    cases = {}
    for number, line in enumerate(signs):
        files = field.texts(HEADER, negated, above=line, separator=";")
        cases[f"segment_sign_{number}"] = FieldCase(kind, f"a line '{line}'", files, note=NEGATED)
    for number, line in enumerate(diameters):
        files = field.texts(HEADER, field.doubled, above=line, separator=";")
        description = f"a line '{line}'"
        cases[f"segment_diameter_{number}"] = FieldCase(kind, description, files, note=HALVED)
    for number, line in enumerate(directions):
        cases[f"segment_direction_{number}"] = FieldCase(
            kind,
            f"a line '{line}'",
            field.texts(HEADER, above=line, separator=";"),
            note="direction: CCW",
            circles=COUNTER_CLOCKWISE,
        )
    title = "Tabelle 3: Durchmesserabweichung ΔD in µm bei verschiedenen Prüflasten (in daN)"
    cases["segment_diameter_in_title"] = FieldCase(
        kind,
        "a long title with a number and a diameter",
        field.texts(HEADER, field.doubled, above=title, separator=";"),
        refusal="Say which: --measured",
        step=("--measured", "diameter"),
    )
    cases["segment_unused"] = FieldCase(
        kind,
        "a line 'Force {F} N; Soll-Ist-Vergleich'",
        field.texts(HEADER, above="Force {F} N; Soll-Ist-Vergleich", separator=";"),
        note="texts not used: 'Soll-Ist-Vergleich'",
    )
    return cases


def below_cases() -> dict[str, FieldCase]:
    """Return lines below a table on sign, diameter, direction and mount."""
    kind = "lines below the table"
    return {
        "below_sign": FieldCase(
            kind,
            "a line 'nominal minus measured'",
            field.texts(HEADER, negated, separator=";", below="nominal minus measured"),
            note=NEGATED,
        ),
        "below_diameter": FieldCase(
            kind,
            "a line 'Readings are of the diameter'",
            field.texts(HEADER, field.doubled, separator=";", below="Readings are of the diameter"),
            note=HALVED,
        ),
        "below_direction": FieldCase(
            kind,
            "a line 'Direction: counter-clockwise'",
            field.texts(HEADER, separator=";", below="Direction: counter-clockwise"),
            note="direction: CCW",
            circles=COUNTER_CLOCKWISE,
        ),
        "below_mount": FieldCase(
            kind,
            "a line 'Note: readings are not compensated for the mount.'",
            field.texts(
                HEADER, separator=";", below="Note: readings are not compensated for the mount."
            ),
            refusal="Give --raw if they do",
            step=("--mount-um-per-bar", "2.33"),
        ),
    }
