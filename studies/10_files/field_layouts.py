"""Field files beside other files, and tables with forces between, above or beside them."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import replace
from datetime import time

import field_files as field
import numpy as np
from field_files import TRUTH, Circle, FieldCase
from openpyxl import Workbook

__all__ = ["layout_cases"]

HEADER = "Angle [deg],Reading [um]"
# The three circles, run in turn clockwise and counter-clockwise, on a larger radius.
LISTED = tuple(
    replace(circle, radius_mm=250.0, direction=direction)
    for circle, direction in zip(TRUTH, ("CW", "CCW", "CW"), strict=True)
)


def layout_cases() -> dict[str, FieldCase]:
    """Return the cases of companion files and of layouts of several tables."""
    return {
        **companion_cases(),
        **merged_cases(),
        **step_cases(),
        **page_cases(),
        **numbering_cases(),
        **list_cases(),
        **order_cases(),
        **single_column_cases(),
    }


def single_column_cases() -> dict[str, FieldCase]:
    """Return files with a single column of readings."""
    kind = "single columns of readings"
    steps = np.diff(TRUTH[0].angle_deg)
    above = f"Ángulo inicial: {TRUTH[0].angle_deg[0]:g}°\nIncremento angular: {steps[0]:g}°"
    header = "Desviación radial [µm]"

    def alone(circle: Circle, k: int) -> list[object]:
        return [f"{circle.reading_um[k]:.3f}".replace(".", ",")]

    read = field.texts(header, alone, above=above, suffix=".dat")
    return {
        "single_column": FieldCase(kind, "start and step of the angles above it", read),
        "single_column_without_step": FieldCase(
            kind,
            "no line states the angles",
            field.texts(header, alone, suffix=".dat"),
            refusal="must hold a table with a column of angles, got one column of numbers",
            mended=read,
        ),
    }


def order_cases() -> dict[str, FieldCase]:
    """Return tables whose points were measured in any order."""
    order = np.random.default_rng(7).permutation(len(TRUTH[0].angle_deg))

    def shuffled(circle: Circle, k: int) -> list[object]:
        angle, reading = field.scaled(-1e3)(circle, int(order[k]))
        return [k + 1, angle, reading]

    header = "Point;Angle [deg];Deviation (mm, nominal - measured)"
    case = FieldCase(
        "orders of points",
        "points of a coordinate measuring machine in any order, readings nominal minus measured",
        field.texts(header, shuffled, separator=";"),
        note="rows: sorted by angle",
    )
    return {"points_in_any_order": case}


def listed_workbook(header: Sequence[str], directions: Sequence[str]) -> dict[str, bytes]:
    """Return a workbook with a sheet for each circle, and a list of them on its first sheet.

    The list states a pressure, a direction, a start time and a radius for each circle.
    """
    book = Workbook()
    overview = book.active
    overview.title = "Liste"
    overview.append(["Campagne 7"])
    overview.append(list(header))
    for number, circle in enumerate(LISTED, start=1):
        pressure_MPa = (circle.force_N + 14.2) / 126.04 / 10.0
        row = [f"Essai {number}", pressure_MPa, directions[number % 2], time(14, 7 * number)]
        overview.append([*row, circle.radius_mm])
        sheet = book.create_sheet(f"Essai {number}")
        sheet.append(["Angle [deg]", "Reading [um]"])
        for k in range(len(circle.angle_deg)):
            sheet.append([float(cell) for cell in map(str, field.plain(circle, k))])
    stream = io.BytesIO()
    book.save(stream)
    return {"campaign.xlsx": stream.getvalue()}


def list_cases() -> dict[str, FieldCase]:
    """Return workbooks whose list of tests states a start time and a radius for each test."""
    english = ("Pressure (MPa)", "Direction", "Start time", "Radius (mm)")
    french = ("Essai", "Pression (MPa)", "Sens", "Heure de début", "Rayon (mm)")
    cases = {}
    for first in ("Sheet", "Test"):
        cases[f"list_{first.lower()}"] = FieldCase(
            "lists of tests",
            f"{first}, pressure, direction, time and radius",
            listed_workbook([first, *english], ("CCW", "CW")),
            note="time_s: Essai 1 at 0 min",
            circles=LISTED,
        )
    cases["list_french"] = FieldCase(
        "lists of tests",
        "in French: essai, pression, sens, heure and rayon",
        listed_workbook(french, ("antihoraire", "horaire")),
        note="time_s: Essai 1 at 0 min",
        circles=LISTED,
    )
    return cases


def companion_cases() -> dict[str, FieldCase]:
    """Return files of three circles beside a file that holds no circle."""
    kind = "companion files"
    circles = field.texts(HEADER)
    temperatures = "".join(f"{60 * k};{20 + k / 10}\n" for k in range(30))
    forces = "".join(f"{k},{100 * k}\n" for k in range(1, 12))
    texts = {
        "README.txt": "Ball bar measurements\nLoads 100, 300 and 600 N, see the names.\n",
        "Protokoll.md": "# Protokoll\n\n| Bediener | NN |\n|---|---|\n| Ebene | XY |\n",
    }
    refused = {
        "temperatures.csv": f"Time [s];Spindle [°C]\n{temperatures}",
        "Temperaturen.csv": f"Zeit [s];Messwert [°C]\n{temperatures}",
        "calibration.csv": f"Pressure [bar],Force [N]\n{forces}",
        "protocol.pdf": "%PDF-1.4\n",
    }
    cases = {}
    for name, content in texts.items():
        cases[f"companion_{name}"] = FieldCase(
            kind, f"{name} beside three circles", {**circles, name: content.encode()}, note=name
        )
    for name, content in refused.items():
        cases[f"companion_{name}"] = FieldCase(
            kind,
            f"{name} beside three circles",
            {**circles, name: content.encode()},
            refusal="eave it out" if name.endswith("pdf") else f"leave this file out: {name}",
            mended=circles,
        )
    return cases


def pairs_of(k: int) -> list[str]:
    """Return angle and reading of each circle at one angle."""
    cells: list[str] = []
    for circle in TRUTH:
        cells += [str(cell) for cell in field.plain(circle, k)]
    return cells


def merged_workbook(rows_above: Sequence[Sequence[object]]) -> dict[str, bytes]:
    """Return a workbook of pairs of columns below merged cells; the header is the last row."""
    book = Workbook()
    sheet = book.active
    for row in rows_above:
        sheet.append(list(row))
    for line in range(1, len(rows_above)):
        for first in "ACE":
            sheet.merge_cells(f"{first}{line}:{chr(ord(first) + 1)}{line}")
    for k in range(len(field.ANGLES_DEG)):
        sheet.append([float(cell) for cell in pairs_of(k)])
    stream = io.BytesIO()
    book.save(stream)
    return {"m.xlsx": stream.getvalue()}


def merged_cases() -> dict[str, FieldCase]:
    """Return tables in which one cell with the force stands above each pair of columns."""
    kind = "forces in merged cells"
    header = ";".join(["Angle [deg];Deviation [um]"] * 3)
    lines = (
        "100 N;;300 N;;600 N;",
        ";F = 100 N;;F = 300 N;;F = 600 N",
        "Kraft [N];100;;300;;600",
        "Maschine;M 1\n100 N;;300 N;;600 N",
    )
    cases = {}
    for number, above in enumerate(lines):
        cases[f"merged_{number}"] = FieldCase(
            kind,
            f"{above.splitlines()[-1]!r} above pairs of columns",
            field.wide(header, pairs_of, above=above),
        )
    forces = ["100 N", None, "300 N", None, "600 N", None]
    names = ["Test 1", None, "Test 2", None, "Test 3", None]
    columns = ["Winkel [°]", "Abweichung [µm]"] * 3
    cases["merged_sheet"] = FieldCase(
        kind, "merged cells in a workbook", merged_workbook([forces, columns])
    )
    cases["merged_sheet_names"] = FieldCase(
        kind, "merged cells with forces and names", merged_workbook([forces, names, columns])
    )
    return cases


def steps(line: str, header: str, is_repeated: bool) -> dict[str, bytes]:
    """Return one file with the tables of all circles below each other.

    ``line`` stands above each table; {F} in it is the force, and {i} the number of the table. The
    header stands above the first table, and also above the others if ``is_repeated``.
    """
    lines = []
    for number, circle in enumerate(TRUTH, start=1):
        lines.append(line.format(i=number, F=f"{circle.force_N:g}"))
        if number == 1 or is_repeated:
            lines.append(header)
        for k in range(len(circle.angle_deg)):
            lines.append(";".join(str(cell) for cell in field.plain(circle, k)))
    return {"steps.csv": "\n".join([*lines, ""]).encode()}


def step_cases() -> dict[str, FieldCase]:
    """Return tables below each other, with the force in a line between them."""
    lines = (
        "Load step {i} of 3: {F} N",
        "Laststufe {i}/3 ({F} N)",
        "Step {i} of 3 - F = {F} N",
        "Palier {i} sur 3 : {F} N",
        "--- {F} N ---",
    )
    cases = {}
    for number, line in enumerate(lines):
        for is_repeated in (True, False):
            times = "each" if is_repeated else "once"
            cases[f"steps_{number}_{times}"] = FieldCase(
                "forces between tables",
                f"{line.format(i=2, F=300)!r} between tables, header {times}",
                steps(line, "Angle [deg];Reading [um]", is_repeated),
            )
    return cases


def pages(title: str, above: str) -> dict[str, bytes]:
    """Return one file of three pages, each with a title, a line above the header, and the header.

    {p} in the title is the number of the page.
    """
    lines = []
    for page in range(3):
        lines += [title.format(p=page + 1), above, ";".join(["Angle [deg];Reading [um]"] * 3)]
        for k in range(24 * page, 24 * page + 24):
            lines.append(";".join(pairs_of(k)))
    return {"pages.csv": "\n".join([*lines, ""]).encode()}


def parts_beside() -> dict[str, bytes]:
    """Return one file for each circle, with three parts of the circle beside each other."""
    files = {}
    for circle in TRUTH:
        lines = [",".join([HEADER] * 3)]
        for k in range(24):
            cells: list[str] = []
            for third in range(3):
                cells += [str(cell) for cell in field.plain(circle, 24 * third + k)]
            lines.append(",".join(cells))
        files[f"{circle.force_N:g}N.csv"] = "\n".join([*lines, ""]).encode()
    return files


def ruled_parts(n_parts: int) -> dict[str, bytes]:
    """Return a printout for each circle: parts beside each other below names, units and a rule."""
    files = {}
    n_rows = len(field.ANGLES_DEG) // n_parts
    for circle in TRUTH:
        lines = ["  Winkel  Abw." * n_parts, "  Grad  um" * n_parts, "-" * 52]
        for k in range(n_rows):
            cells: list[str] = []
            for block in range(n_parts):
                cells += [str(cell) for cell in field.plain(circle, n_rows * block + k)]
            lines.append("  " + "  ".join(cells))
        files[f"{circle.force_N:g}N.txt"] = "\n".join([*lines, ""]).encode()
    return files


def page_cases() -> dict[str, FieldCase]:
    """Return printouts of several pages, and circles whose parts stand beside each other."""
    titles = (
        "Kreisformtest, Seite {p} von 3",
        "Report 7;;;;Page {p};",
        "Table 1, printed 10:1{p}:00",
    )
    cases = {}
    for number, title in enumerate(titles):
        cases[f"pages_{number}"] = FieldCase(
            "pages",
            f"{title!r} and the header on each page",
            pages(title, "100 N;;300 N;;600 N;"),
            note="the table goes on below them",
        )
    cases["parts_beside_above_a_rule"] = FieldCase(
        "pages",
        "parts of one circle beside each other, below a rule of dashes",
        ruled_parts(3),
        refusal="Put all pairs below each other in one pair of columns",
        mended=ruled_parts(1),
    )
    cases["parts_beside"] = FieldCase(
        "pages",
        "parts of one circle beside each other",
        parts_beside(),
        refusal="Put all pairs below each other in one pair of columns",
        mended=field.texts(HEADER),
    )
    return cases


def numbering_cases() -> dict[str, FieldCase]:
    """Return tables whose circles are numbered by two columns together."""
    cases = {}
    for first, second in (("run", "pass"), ("cycle", "test"), ("Lauf", "Wiederholung")):
        lines = [f"{first},{second},Angle [deg],Reading [um],Force [N]"]
        for circle, numbers in zip(TRUTH, ("1,1", "1,2", "2,1"), strict=True):
            for k in range(len(circle.angle_deg)):
                row = [numbers, *field.plain(circle, k), f"{circle.force_N:g}"]
                lines.append(",".join(str(cell) for cell in row))
        cases[f"numbered_{first}"] = FieldCase(
            "two columns that number the circles",
            f"{first} and {second}",
            {"all.csv": "\n".join([*lines, ""]).encode()},
            note="only both together name tests of one force",
        )
    return cases
