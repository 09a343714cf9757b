"""The campaign of the field files in forms that are refused at first, or that a refusal once met
with a step that did not help: columns of tests, other formats than tables, headers in two rows.
"""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import field_files as field
import numpy as np
from field_files import TRUTH, Circle, FieldCase
from openpyxl import Workbook

__all__ = ["step_cases"]

FORCES = ("--forces-N", "100,300,600")
DIRECTIONS = ("CW", "CCW", "CW")
DIRECTED = tuple(
    replace(circle, direction=direction)
    for circle, direction in zip(TRUTH, DIRECTIONS, strict=True)
)


def step_cases() -> dict[str, FieldCase]:
    """Return the cases of refusals whose step reads the file."""
    return {
        **cases_of_tests(),
        **json_cases(),
        **octave_cases(),
        **format_cases(),
        **header_cases(),
        **step_angle_cases(),
        **statistics_cases(),
        **export_cases(),
        **run_page_cases(),
        **volt_cases(),
    }


def cases_of_tests() -> dict[str, FieldCase]:
    """Return tables of which one column names the tests, or several hold readings, by odd names."""
    kind = "columns of tests by other names"
    series = []
    for circle, name, direction in zip(TRUTH, "abc", DIRECTIONS, strict=True):
        for k in range(len(circle.angle_deg)):
            series.append(",".join([name, direction, *map(str, field.plain(circle, k))]))
    return {
        "readings_by_letters": FieldCase(
            kind,
            "columns A, B, C, three forces given",
            field.wide("Angle [deg];A;B;C", field.angle_and_readings),
            options=FORCES,
            refusal="give --reading-column 'A' --reading-column 'B' --reading-column 'C'",
            step=("--reading-column", "A", "--reading-column", "B", "--reading-column", "C"),
        ),
        "readings_by_other_names": FieldCase(
            kind,
            "columns dev, other, third, three forces given",
            field.wide("Angle [deg];dev;other;third", field.angle_and_readings),
            options=FORCES,
            refusal="give --reading-column 'dev' --reading-column 'other'",
            step=("--reading-column", "2", "--reading-column", "3", "--reading-column", "4"),
        ),
        "tests_by_another_name": FieldCase(
            kind,
            "a column Block of the tests, three forces given",
            {"all.csv": "\n".join(["Block,direction,Angle [deg],dev", *series, ""]).encode()},
            options=FORCES,
            refusal="If 'Block' names the test of each row, give --test-column 'Block'",
            step=("--test-column", "Block"),
            circles=DIRECTED,
        ),
        "directions_of_tests": FieldCase(
            kind,
            "a column Block of the tests, directions that differ",
            {"all.csv": "\n".join(["Block,direction,Angle [deg],dev", *series, ""]).encode()},
            refusal="Say which column names the test of each row: --test-column 'Block'",
            step=("--test-column", "Block", *FORCES),
            circles=DIRECTED,
        ),
    }


def json_file(content: Any) -> dict[str, bytes]:
    return {"all.json": json.dumps(content, indent=1).encode()}


def json_cases() -> dict[str, FieldCase]:
    """Return files in JSON: records, columns, and tests with what is said of them."""
    kind = "JSON and Octave"
    records = []
    by_name = {}
    tests = []
    for circle in TRUTH:
        angles = circle.angle_deg.tolist()
        readings = circle.reading_um.tolist()
        force = circle.force_N
        for angle, reading in zip(angles, readings, strict=True):
            records.append(
                {"test": f"T{force:g}", "force_N": force, "angle_deg": angle, "reading_um": reading}
            )
        by_name[f"{force:g} N"] = {"angle_deg": angles, "reading_um": readings}
        tests.append(
            {
                "id": f"T{force:g}",
                "force": {"value": force / 1e3, "unit": "kN"},
                "angle": {"unit": "turn", "values": [angle / 360.0 for angle in angles]},
                "distance": {"unit": "mm", "values": [150.0 + r / 1e3 for r in readings]},
            }
        )
    rows = []
    for k, angle in enumerate(field.ANGLES_DEG.tolist()):
        rows.append([angle, *(float(circle.reading_um[k]) for circle in TRUTH)])
    header = ["angle_deg", "100 N [um]", "300 N [um]", "600 N [um]"]
    lines = "\n".join(json.dumps(record) for record in records)
    return {
        "json_records": FieldCase(kind, "a list of records in JSON", json_file(records)),
        "json_lines": FieldCase(kind, "one record in JSON a line", {"all.jsonl": lines.encode()}),
        "json_by_name": FieldCase(kind, "columns in JSON for each force", json_file(by_name)),
        "json_tests": FieldCase(
            kind,
            "tests in JSON, with units beside their numbers",
            json_file({"plane": "XY", "nominal_radius_mm": 150, "tests": tests}),
            note="lines count the entries of the file",
        ),
        "json_rows": FieldCase(
            kind,
            "rows in JSON below the names of columns",
            json_file({"columns": header, "data": rows}),
        ),
    }


def octave_matrix(name: str, rows: Any) -> str:
    lines = [f"# name: {name}", "# type: matrix", f"# rows: {len(rows)}"]
    lines.append(f"# columns: {len(rows[0])}")
    for row in rows:
        lines.append(" " + " ".join(f"{number:.6f}" for number in row))
    return "\n".join([*lines, "", "", ""])


def octave_cases() -> dict[str, FieldCase]:
    """Return variables as Octave saves them as text."""
    kind = "JSON and Octave"
    begin = "# Created by Octave 8.4.0, Mon Mar 02 14:11:07 2026 CET <a@b>\n"
    radius = "# name: R_mm\n# type: scalar\n150\n\n\n"
    note = "theta: rad; rho: micrometre"
    info = f"# name: info\n# type: string\n# elements: 1\n# length: 27\n{note}\n\n\n"
    pairs = begin + radius
    for circle in TRUTH:
        rows = list(zip(circle.angle_deg, circle.reading_um, strict=True))
        pairs += octave_matrix(f"data_{circle.force_N:g}N", rows)
    theta = octave_matrix("theta", [[np.deg2rad(angle)] for angle in field.ANGLES_DEG])
    columns = zip(*(circle.reading_um for circle in TRUTH), strict=True)
    rho = octave_matrix("rho", [list(row) for row in columns])
    return {
        "octave_matrices": FieldCase(kind, "a matrix of each force", {"all.txt": pairs.encode()}),
        "octave_vectors": FieldCase(
            kind,
            "a vector of angles and a matrix of readings",
            {"all.txt": (begin + radius + theta + rho + info).encode()},
            options=FORCES,
            refusal="--reading-column 2 --reading-column 3 --reading-column 4",
            step=("--reading-column", "2", "--reading-column", "3", "--reading-column", "4"),
        ),
    }


def format_cases() -> dict[str, FieldCase]:
    """Return formats that hold no table; the refusal says what the file is."""
    mended = field.texts("Angle [deg],Reading [um]")
    forms = {
        "yaml": (".yaml", "  - [{a:g}, {r}]", "readings:", "got YAML"),
        "xml": (".xml", '<p angle="{a:g}" reading="{r}"/>', "<test>", "got XML"),
    }
    cases = {}
    for name, (suffix, line, above, refusal) in forms.items():
        files = {}
        for circle in TRUTH:
            lines = [above]
            for angle, reading in zip(circle.angle_deg, circle.reading_um, strict=True):
                lines.append(line.format(a=angle, r=f"{reading:.3f}"))
            files[f"{circle.force_N:g}N{suffix}"] = "\n".join([*lines, ""]).encode()
        cases[f"format_{name}"] = FieldCase(
            "formats that hold no table",
            f"lines such as {line.format(a=5.0, r='-1.234')}",
            files,
            refusal=refusal,
            mended=mended,
        )
    return cases


def header_cases() -> dict[str, FieldCase]:
    """Return headers that state the force of each column, or stand in several rows."""
    kind = "headers of readings"
    cases = {}
    headers = {
        "daN": "Angle [deg];F = 10 daN;F = 30 daN;F = 60 daN",
        "kN": "Angle [deg];Force 0.1 kN;Force 0.3 kN;Force 0.6 kN",
        "kN_in_um": "Winkel [Grad];Kraft = 0,1 kN [µm];Kraft = 0,3 kN [µm];Kraft = 0,6 kN [µm]",
    }
    for name, header in headers.items():
        cases[f"force_in_header_{name}"] = FieldCase(
            kind,
            f"headers such as {header.split(';')[1]!r}",
            field.wide(header, field.angle_and_readings),
        )
    aligned = {
        "loads": ("angle (deg)      100 N     300 N     600 N", TRUTH),
        "words": (
            "bar angle [deg]  load 100 N [um]  load 300 N [um]  load 600 N [um]",
            TRUTH,
        ),
    }
    for name, (header, circles) in aligned.items():
        lines = [header]
        for k, angle in enumerate(field.ANGLES_DEG):
            readings = "".join(f"{circle.reading_um[k]:10.3f}" for circle in circles)
            lines.append(f"{angle:8.1f}{readings}")
        cases[f"aligned_{name}"] = FieldCase(
            kind,
            f"names with blanks, aligned: {header[:40]!r}",
            {"all.txt": "\n".join([*lines, ""]).encode()},
        )
    cases |= two_row_cases()
    return cases


def pairs(k: int) -> list[object]:
    """Angle and reading of each circle, beside each other."""
    cells: list[object] = []
    for circle in TRUTH:
        cells += [float(circle.angle_deg[k]), float(circle.reading_um[k])]
    return cells


def shared(k: int) -> list[object]:
    """Angle, and the reading of each circle."""
    return [5.0 * k, *(float(circle.reading_um[k]) for circle in TRUTH)]


def two_row_cases() -> dict[str, FieldCase]:
    """Return workbooks whose header has two rows of names."""
    runs = ["Lauf 1", "Lauf 2", "Lauf 3"]
    twice = []
    merged: list[str | None] = []
    for run in runs:
        twice += [run, run]
        merged += [run, None]
    loaded = ["Lauf 1 (100 N)", None, "Lauf 2 (300 N)", None, "Lauf 3 (600 N)", None]
    names = ["Winkel [°]", "Abweichung [µm]"] * 3
    shapes = {
        "pairs": ([twice, names], pairs, FORCES),
        "merged_pairs": ([merged, names], pairs, FORCES),
        "loaded_pairs": ([loaded, names], pairs, ()),
        "shared_angle": (
            [["", *runs], ["Winkel", *["Abweichung"] * 3], ["deg", *["um"] * 3]],
            shared,
            FORCES,
        ),
        "angle_above": ([["Winkel", *runs], ["[°]", *["Abweichung [µm]"] * 3]], shared, FORCES),
        "loads_below": (
            [["Winkel [°]", "Abweichung [µm]", None, None], [None, "100 N", "300 N", "600 N"]],
            shared,
            (),
        ),
    }
    cases = {}
    for name, (header, row, options) in shapes.items():

        def fill(book: Workbook, header: Any = header, row: Any = row) -> None:
            sheet = book.create_sheet("Messung")
            for cells in [*header, *(row(k) for k in range(len(field.ANGLES_DEG)))]:
                sheet.append(cells)

        cases[f"two_rows_{name}"] = FieldCase(
            "headers in two rows",
            f"{header[0][:3]} above {header[1][:3]}",
            {"m.xlsx": field.workbook(fill)},
            options=options,
        )
    return cases


def counted(circle: Circle, k: int) -> list[object]:
    return [f"{k + 1}", f"{circle.reading_um[k]:.3f}"]


def step_angle_cases() -> dict[str, FieldCase]:
    """Return tables with numbers of points, below lines with start and step of the angles."""
    kind = "numbers of points"
    german = "Startwinkel: 0°\nEndwinkel: 355°\nWinkelschritt: 5°"
    return {
        "points_german": FieldCase(
            kind,
            "a column Nr below Startwinkel, Endwinkel, Winkelschritt",
            field.texts("Nr;Abweichung [µm]", counted, above=german, separator=";"),
            note="angle: from 0° in steps of 5°",
        ),
        "points_named_angle": FieldCase(
            kind,
            "a column Angle with 1, 2, 3 below start and step",
            field.texts("Angle,Dev [um]", counted, above="Start angle 0, end angle 360, step 5"),
            note="angle: from 0° in steps of 5°",
        ),
        "points_without_step": FieldCase(
            kind,
            "a column Point below start and end of the angles",
            field.texts("Point,Dev [um]", counted, above="Start angle: 0 deg, end angle: 355 deg"),
            refusal="Write a line 'Angle step: 5 deg' above the table",
            mended=field.texts(
                "Point,Dev [um]",
                counted,
                above="Start angle: 0 deg, end angle: 355 deg\nAngle step: 5 deg",
            ),
        ),
    }


def statistics_cases() -> dict[str, FieldCase]:
    """Return tables with rows of statistics at their end."""
    cases = {}
    labels = {
        "english": ("mean", "sd", "max"),
        "german": ("Mittelwert", "Standardabweichung", "Spannweite"),
        "french": ("Moyenne", "Écart type", "Étendue"),
    }
    for name, words in labels.items():
        files = {}
        for file, content in field.texts("Angle [deg];Reading [um]", separator=";").items():
            rows = "".join(f"{word};1.25\n" for word in words)
            files[file] = content + rows.encode()
        cases[f"statistics_{name}"] = FieldCase(
            "rows of statistics",
            f"rows {', '.join(words)} below the readings",
            files,
            note="3 rows left out",
        )
    return cases


def export_cases() -> dict[str, FieldCase]:
    """Return an export of a database with texts beside angles such as 12°30'."""
    cases = {}
    for name, separator in {"semicolon": ";", "pipes": " | "}.items():
        lines = [separator.join(["test", "drehsinn", "kraft_n", "winkel", "reading_um"])]
        for number, circle in enumerate(TRUTH, start=1):
            for angle, reading in zip(circle.angle_deg, circle.reading_um, strict=True):
                cells = [f"T{number}", "UZS", f"{circle.force_N:g}", f"{angle:.0f}°00'"]
                lines.append(separator.join([*cells, f"{reading:.3f}"]))
        cases[f"export_{name}"] = FieldCase(
            "angles in minutes beside texts",
            f"rows such as {lines[1]!r}",
            {"all.txt": "\n".join([*lines, ""]).encode()},
            options=("--direction-column", "drehsinn"),
            note="degrees and minutes included",
        )
    return cases


def run_page_cases() -> dict[str, FieldCase]:
    """Return a page for each run, which begins at another angle than the run before."""
    pages = []
    for number, circle in enumerate(TRUTH, start=1):
        rows = [",".join(map(str, field.plain(circle, k))) for k in range(len(circle.angle_deg))]
        shift = 18 * (number - 1)
        above = [f"Run {number}", f"Start time: 14:0{number}:00", "Angle [deg],Reading [um]"]
        pages.append("\n".join([*above, *rows[shift:], *rows[:shift], ""]))
    return {
        "pages_of_runs": FieldCase(
            "runs on pages",
            "pages that begin with Run 1 and Start time, each from another angle on",
            {"all.txt": "\f\n".join(pages).encode()},
            options=FORCES,
        )
    }


def volt_cases() -> dict[str, FieldCase]:
    """Return readings in volts, below a line that states their size."""
    cases = {}
    for name, line in {"equals": "1 V = 10 µm", "per": "Sensitivity: 10 um/V"}.items():
        cases[f"volts_{name}"] = FieldCase(
            "readings in volts",
            f"readings in V below a line {line!r}",
            field.texts("Angle [deg],Reading [V]", field.scaled(10.0), above=line),
            refusal="If this is their size, give --unit '10 um'",
            step=("--unit", "10 um"),
        )
    return cases
