"""Field files with statements among remarks, and reports with a head on the page of each circle."""

from __future__ import annotations

from collections.abc import Sequence

import field_files as field
from field_files import Circle, FieldCase, Row
from openpyxl.worksheet.worksheet import Worksheet

__all__ = ["remark_cases"]

# Statements, each with the rows of numbers for which it is true.
STATEMENTS: tuple[tuple[str, Row, str], ...] = (
    ("Winkel ab +Y im Uhrzeigersinn", field.turned(90.0, -1), "from +Y, CW"),
    ("positiv = Stab kürzer", field.negated, "a longer bar is negative"),
    ("valeurs au diamètre", field.doubled, "of the diameter"),
)


def remark_cases() -> dict[str, FieldCase]:
    """Return the cases of remarks and of heads of pages."""
    return {**column_cases(), **header_cases(), **below_cases(), **report_cases(), **ragged_cases()}


def with_remark(row: Row, text: str, at_row: int) -> Row:
    """Return rows with a third cell, which holds a text in one row and is empty in the others."""

    def cells(circle: Circle, k: int) -> list[object]:
        return [*row(circle, k), text if k == at_row else ""]

    return cells


def column_cases() -> dict[str, FieldCase]:
    """Return statements in a column of remarks, with and without a name."""
    kind = "statements among remarks"
    cases = {}
    for column in ("Kommentar", "Remarque", ""):
        header = f"angle [deg];reading [um];{column}"
        for number, (text, row, note) in enumerate(STATEMENTS):
            files = field.texts(header, with_remark(row, text, 4), separator=";")
            name = f"remark_{column.lower() or 'unnamed'}_{number}"
            description = f"{text!r} in a column {column!r}"
            cases[name] = FieldCase(kind, description, files, note=note)
    row = with_remark(field.scaled(0.1), "Werte in 0,1 µm", 2)
    cases["remark_unit"] = FieldCase(
        kind,
        "'Werte in 0,1 µm' in a column 'Bemerkung'",
        field.texts("Winkel [°];Abweichung;Bemerkung", row, separator=";"),
        note="0.1 um",
    )
    return cases


def header_cases() -> dict[str, FieldCase]:
    """Return a workbook with a statement beside the header."""

    def add_statement(sheet: Worksheet, circle: Circle) -> None:
        sheet["E1"] = "angoli in senso orario; + = bar shorter"
        for k in range(len(circle.angle_deg)):
            sheet.cell(k + 2, 1).value = float(-circle.angle_deg[k] % 360.0)
            sheet.cell(k + 2, 2).value = float(-circle.reading_um[k])

    return {
        "statement_beside_header": FieldCase(
            "statements among remarks",
            "'angoli in senso orario; + = bar shorter' in cell E1",
            field.sheets(change=add_statement),
            note="a longer bar is negative",
        )
    }


def below_cases() -> dict[str, FieldCase]:
    """Return units in sentences below the table, and in other languages above it."""
    lines = (
        ("Alle Abweichungen in Zehntel-µm, + = Stab länger", 0.1),
        ("Abweichungen in 0,1 µm", 0.1),
        ("Scostamenti in centesimi di millimetro (+ = barra più lunga).", 10.0),
        ("Écarts en 1/100 mm", 10.0),
    )
    cases = {}
    for number, (line, size) in enumerate(lines):
        for place in ("above", "below"):
            text = {place: line}
            files = field.texts("angle [deg];reading", field.scaled(size), separator=";", **text)
            cases[f"unit_{place}_{number}"] = FieldCase(
                "units in sentences around the table", f"{line!r} {place} the table", files
            )
    return cases


def report(head: str, lines: Sequence[str], header: str, encoding: str) -> dict[str, bytes]:
    """Return a report with a page for each circle; readings are in hundredths of a millimetre."""
    content: list[str] = []
    for number, circle in enumerate(field.TRUTH, start=1):
        for line in (head, "", *lines, "", header):
            content.append(line.format(p=number, F=f"{circle.force_N:g}"))
        for angle, reading in zip(circle.angle_deg, circle.reading_um, strict=True):
            content.append(f"{angle:6.1f}   {reading / 10.0:9.4f}".replace(".", ","))
        content += ["", ""]
    return {"report.txt": "\n".join(content).encode(encoding)}


def report_cases() -> dict[str, FieldCase]:
    """Return reports in which each page has a head, and states the force of its circle."""
    english = (
        "Test report no. 112",
        "Run {p}: radial force {F} N, plane XY, radius 150 mm",
        "Deviations in hundredths of a millimetre (+ = bar longer).",
    )
    italian = (
        "RELAZIONE DI PROVA n. 112/26",
        "Macchina: Mandelli Thunder 1000, matr. 2217    Operatore: G. Conti",
        "Prova {p}: forza radiale {F} N, piano XY, raggio 150 mm",
        "Scostamenti in centesimi di millimetro (+ = barra più lunga).",
    )
    room = "OFFICINE BRAMBILLA S.p.A. - Sala metrologica               pag. {p}/3"
    kind = "reports with a page for each circle"
    pages = {
        "pag": (room, english, "Angle   Deviation", "utf-8"),
        "page": ("Page {p} of 3", english, "Angle   Deviation", "utf-8"),
        "italian": (room, italian, "Angolo   Scostamento", "cp1252"),
    }
    cases = {}
    for name, (head, lines, header, encoding) in pages.items():
        files = report(head, lines, header, encoding)
        cases[f"report_{name}"] = FieldCase(kind, f"{head!r} above {lines[-2]!r}", files)
    return cases


def ragged_cases() -> dict[str, FieldCase]:
    """Return printed tables whose rows have more cells than their header has names."""

    def with_unit(circle: Circle, k: int) -> list[object]:
        return [f"{circle.angle_deg[k]:g}   {circle.reading_um[k]:.3f} µm"]

    def with_bump(circle: Circle, k: int) -> list[object]:
        remark = "   small bump here" if k == 9 else ""
        return [f"{circle.angle_deg[k]:g}   {circle.reading_um[k]:.3f}{remark}"]

    lines = []
    for group, circle in enumerate(field.TRUTH):
        lines += [f"$`{circle.force_N:g}`", "      theta      dr"]
        n_rows = len(circle.angle_deg)
        for k in range(n_rows):
            cells = (group * n_rows + k + 1, f"{circle.angle_deg[k]:g}", circle.reading_um[k])
            lines.append("   ".join(str(cell) for cell in cells))
        lines.append("")
    forces = ",".join(f"{circle.force_N:g}" for circle in field.TRUTH)
    kind = "rows with more cells than names"
    return {
        "unit_in_each_row": FieldCase(
            kind,
            "'µm' behind each number, without a name in the header",
            field.texts("Angle   Deviation", with_unit, suffix=".txt"),
        ),
        "remark_in_one_row": FieldCase(
            kind,
            "a remark in one row below the name 'Remark'",
            field.texts("Angle   Deviation   Remark", with_bump, suffix=".txt"),
            note="small bump here",
        ),
        "groups_of_r": FieldCase(
            kind,
            "groups of R's split, with numbers of rows",
            {"sink.txt": "\n".join(lines).encode()},
            refusal="Give --forces-N",
            step=("--forces-N", forces),
        ),
    }
