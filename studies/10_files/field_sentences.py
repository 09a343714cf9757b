"""Field files that state conventions, units, directions and times in whole sentences."""

from __future__ import annotations

from dataclasses import replace

import field_files as field
from field_files import TRUTH, Circle, FieldCase, Row
from openpyxl import Workbook

__all__ = ["sentence_cases"]

HEADER = "Angle [deg];Reading [um]"
NO_UNIT = "Angle [deg];Reading"
MICROMETRES_PER_INCH = 25_400.0
CLOCKWISE = tuple(replace(circle, direction="CW") for circle in TRUTH)


def sentence_cases() -> dict[str, FieldCase]:
    """Return the cases of statements in sentences."""
    return {
        **travel_cases(),
        **zero_cases(),
        **share_cases(),
        **unit_cases(),
        **log_cases(),
        **sheet_cases(),
        **count_cases(),
        **language_cases(),
        **statistics_cases(),
    }


def travel_cases() -> dict[str, FieldCase]:
    """Return lines about the angle that also state the direction of travel."""
    lines = (
        "Radiale Abweichung über dem Winkel, Messung im Uhrzeigersinn",
        "Radiale Abweichung über dem Winkel; gefahren im Uhrzeigersinn",
        "Winkel in Grad, Kreis im Uhrzeigersinn gefahren",
        "Deviation versus angle; the circle was measured clockwise",
        "Angle en degrés, cercle parcouru dans le sens horaire",
        "Angolo in gradi, percorso in senso orario",
    )
    cases = {}
    for number, line in enumerate(lines):
        cases[f"travel_beside_angle_{number}"] = FieldCase(
            "directions of travel beside angles",
            f"a line '{line}'",
            field.texts(HEADER, above=line, separator=";"),
            note="direction: CW",
            circles=CLOCKWISE,
        )
    line = "Winkel im Uhrzeigersinn, gefahren im Uhrzeigersinn"
    cases["travel_and_sense"] = FieldCase(
        "directions of travel beside angles",
        f"a line '{line}'",
        field.texts(HEADER, field.turned(0.0, -1), above=line, separator=";"),
        circles=CLOCKWISE,
    )
    return cases


def zero_cases() -> dict[str, FieldCase]:
    """Return sentences on where angles begin."""
    from_minus_y = field.turned(270.0, -1)
    lines = {
        "Angles are zero where the bar points along -Y and run clockwise from above": from_minus_y,
        "Angle from -Y clockwise; all runs clockwise": from_minus_y,
    }
    cases = {}
    for number, (line, row) in enumerate(lines.items()):
        cases[f"zero_in_sentence_{number}"] = FieldCase(
            "zero of angles in words",
            f"a line '{line}'",
            field.texts(HEADER, row, above=line, separator=";"),
            note="angle: from -Y, CW",
        )
    line = "Angles from +Y with the travel clockwise"
    cases["zero_with_travel"] = FieldCase(
        "zero of angles in words",
        f"a line '{line}'",
        field.texts(HEADER, above=line, separator=";"),
        note=f"line 1 says '{line}', not understood",
    )
    return cases


def share_cases() -> dict[str, FieldCase]:
    """Return readings in tenths, hundredths and thousandths of a unit, in words."""
    thou = MICROMETRES_PER_INCH / 1000.0
    lines = {
        "Unit: thousandths of a mm": 1.0,
        "Readings: tenths of a micron": 0.1,
        "Readings are in hundredths of a millimetre.": 10.0,
        "Einheit: Hundertstel Millimeter": 10.0,
        "All values in ten-thousandths of an inch": thou / 10.0,
    }
    headers = {
        "Angle [deg];Reading [tenths of a micron]": 0.1,
        "Winkel [°];Anzeige in Hundertstel mm": 10.0,
        "Angle [deg];Dev (Tenths of a thou)": thou / 10.0,
        "angle.deg;deviation.thousandths.of.an.inch": thou,
    }
    cases = {}
    for number, (line, size) in enumerate(lines.items()):
        files = field.texts(NO_UNIT, field.scaled(size), above=line, separator=";")
        note = "unit of the reading: "
        cases[f"share_in_line_{number}"] = FieldCase(
            "units that are shares", f"a line '{line}'", files, note=note
        )
    for number, (header, size) in enumerate(headers.items()):
        files = field.texts(header, field.scaled(size), separator=";")
        cases[f"share_in_header_{number}"] = FieldCase(
            "units that are shares", f"a header '{header}'", files
        )
    return cases


def in_units(deg: float, um: float) -> Row:
    """Return rows with angles in a unit of ``deg`` degrees and readings in a unit of ``um`` µm."""

    def row(circle: Circle, k: int) -> list[object]:
        return [f"{circle.angle_deg[k] / deg:.0f}", f"{circle.reading_um[k] / um:.2f}"]

    return row


def beside_force(circle: Circle, k: int) -> list[object]:
    pounds = circle.force_N / 4.4482216152605
    gradians = circle.angle_deg[k] / 0.9
    return [f"{pounds:.9f}", f"{gradians:.9f}", f"{circle.reading_um[k]:.3f}"]


def unit_cases() -> dict[str, FieldCase]:
    """Return angles in thousandths of a degree, and headers as the program R writes them."""
    kind = "units with factors"
    cases = {}
    for number, header in enumerate(("angle_mdeg;reading_um", "angle [millidegrees];dev [um]")):
        files = field.texts(header, in_units(0.001, 1.0), separator=";")
        cases[f"millidegrees_{number}"] = FieldCase(kind, f"a header '{header}'", files)
    line = "ANGLE: 0.001 DEG  READING: 0.1 MICRON"
    cases["pairs_by_blanks"] = FieldCase(
        kind,
        f"a line '{line}'",
        field.texts("ANGLE;READING", in_units(0.001, 0.1), above=line, separator=";"),
    )
    cases["counts_as_degrees"] = FieldCase(
        kind,
        "angles in counts of 0.001° below 'Angle [deg]'",
        field.texts(HEADER, in_units(0.001, 1.0), separator=";"),
        refusal="Say in which unit the angles are: --angle-unit, such as '0.001 deg'",
        step=("--angle-unit", "0.001 deg"),
    )
    cases["counts_of_an_encoder"] = FieldCase(
        kind,
        "angles in counts, and a line '36000 counts per revolution'",
        field.texts(
            "counts;Reading [um]",
            in_units(0.01, 1.0),
            above="encoder: 36000 counts per revolution, zero at +X, counts up counter-clockwise",
            separator=";",
        ),
        options=("--angle-column", "counts"),
        note="unit of the angle: 0.01 deg (line 1",
    )
    header = "force.pound.force;angle.gradians;reading.um"
    cases["dots_of_r"] = FieldCase(
        "headers of other programs",
        f"a header '{header}'",
        field.texts(header, beside_force, separator=";"),
    )
    return cases


def negated(circle: Circle, k: int) -> str:
    return f"{circle.angle_deg[k]:g};{-circle.reading_um[k]:.3f}"


def log_of_tables(head: str, above: str, header: str = HEADER) -> dict[str, bytes]:
    """Return one file with a table for each circle; readings are negated.

    ``head`` stands above the first table only. ``{F}`` and ``{T}`` in ``above`` are the force and
    the minute of the circle. Each further table begins at the angle at which the last one ended.
    """
    lines = head.split("\n")
    for number, circle in enumerate(TRUTH):
        text = above.replace("{F}", f"{circle.force_N:g}").replace("{T}", f"{7 * number:02d}")
        lines += [*text.split("\n"), header]
        order = -1 if number % 2 else 1
        lines += [negated(circle, k) for k in range(len(circle.angle_deg))[::order]]
        lines.append("")
    return {"log.csv": "\n".join(lines).encode()}


def log_cases() -> dict[str, FieldCase]:
    """Return logs whose first lines hold for all tables, each with its time."""
    stamp = "2026-03-02 14:{T}:12 INFO  acq: "
    head = "2026-03-02 14:00:11 INFO  acq: dev = nominal - actual"
    heads = {
        "a sign in the stamped head of a log": (head, f"{stamp}START force={{F}} N"),
        "a sign and a force in the first line of a log": (
            "Positive reading: bar shorter, plane XY, date 2026-03-02",
            "Time: 14:{T}:12\nForce: {F} N",
        ),
    }
    cases = {}
    for number, (description, (first, above)) in enumerate(heads.items()):
        cases[f"head_of_log_{number}"] = FieldCase(
            "several tables in one file",
            description,
            log_of_tables(first, above),
            note="at 14 min",
        )
    return cases


def with_overview(book: Workbook) -> None:
    """Fill a workbook with a sheet of statements and a sheet for each circle."""
    sheet = book.create_sheet("Info")
    sheet.append(["Sens de parcours", "horaire"])
    sheet.append(["Opérateur", "Dupont"])
    sheet.append(["Notes de la machine"])
    for circle in TRUTH:
        sheet = book.create_sheet(f"{circle.force_N:g} N")
        sheet.append(["Angle [deg]", "Reading [um]"])
        for angle, reading in zip(circle.angle_deg, circle.reading_um, strict=True):
            sheet.append([float(angle), float(reading)])


def sheet_cases() -> dict[str, FieldCase]:
    """Return workbooks whose first sheet states what holds for all tests."""
    kind = "sheets of statements"
    files = {"m.xlsx": field.workbook(with_overview)}
    named = ("--sheets", ",".join(f"{circle.force_N:g} N" for circle in TRUTH))
    return {
        "overview_in_french": FieldCase(
            kind,
            "a sheet with the row 'Sens de parcours | horaire'",
            files,
            note="direction: CW (a sheet without a table",
            circles=CLOCKWISE,
        ),
        "overview_not_named": FieldCase(
            kind,
            "such a sheet beside the sheets that --sheets names",
            files,
            options=named,
            note="left out: sheets: 'Info' (other sheets are named",
        ),
    }


def count_cases() -> dict[str, FieldCase]:
    """Return numbers of readings beside the number of a test."""
    cases = {}
    forces = ",".join(f"{circle.force_N:g}" for circle in TRUTH)
    for number, line in enumerate(("test=1 n=72", "run 1 N=72")):
        files = field.texts(HEADER, above=line, separator=";")
        renamed = {f"{k}.csv": files[f"{force:g}N.csv"] for k, force in enumerate(field.FORCES_N)}
        cases[f"count_beside_run_{number}"] = FieldCase(
            "numbers that are no loads",
            f"a line '{line}'",
            renamed,
            refusal="force or pressure must be known",
            step=("--forces-N", forces),
        )
    return cases


def language_cases() -> dict[str, FieldCase]:
    """Return senses of angles in further languages."""
    lines = (
        "Kąt: zgodnie z ruchem wskazówek zegara",
        "Úhel po směru hodinových ručiček",
        "Hoek: met de klok mee",
        "Vinkel medurs",
    )
    cases = {}
    for number, line in enumerate(lines):
        cases[f"sense_in_language_{number}"] = FieldCase(
            "angles turned in words",
            f"a line '{line}'",
            field.texts(HEADER, field.turned(0.0, -1), above=line, separator=";"),
            note="angle: from +X, CW",
        )
    return cases


def raw_and_statistics(kinds: tuple[str, ...]) -> dict[str, bytes]:
    """Return a file for each circle with a column that says what each row holds."""
    files = {}
    for circle in TRUTH:
        lines = ["stat;Angle [deg];Reading [um]"]
        for k in range(len(circle.angle_deg)):
            lines.append(";".join(["raw", *(str(cell) for cell in field.plain(circle, k))]))
        lines += [f"{kind};0;3.25" for kind in kinds]
        files[f"{circle.force_N:g}N.csv"] = "\n".join([*lines, ""]).encode()
    return files


def statistics_cases() -> dict[str, FieldCase]:
    """Return tables with rows of statistics that have an angle."""
    return {
        "statistics_with_angle": FieldCase(
            "rows of statistics",
            "a column 'stat' with the cells raw, mean and sd",
            raw_and_statistics(("mean", "sd")),
            refusal="Remove the rows of statistics: 74, 75",
            mended=raw_and_statistics(()),
        )
    }
