"""Field files of several programs: printouts with units below aligned names, and headers of R."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import field_files as field
import numpy as np
from field_files import Circle, FieldCase
from openpyxl import Workbook

__all__ = ["printout_cases"]


def printout_cases() -> dict[str, FieldCase]:
    """Return the cases of printouts."""
    return {
        **unit_row_cases(),
        **dotted_cases(),
        **several_table_cases(),
        **statistics_cases(),
        **end_angle_cases(),
        **test_column_cases(),
        **index_cases(),
        **stored_number_cases(),
        **page_cases(),
        **half_cases(),
        **named_number_cases(),
        **letter_cases(),
        **address_cases(),
        **quoted_cases(),
        **run_in_cases(),
    }


def printed(circle: Circle, k: int) -> list[object]:
    """Return a row whose cells stand below the names of a printout; readings are in mm."""
    angle = f"{circle.angle_deg[k]:g}"
    return [f"{k + 1:3d}   {angle:>5}    {circle.reading_um[k] / 1e3:10.6f}    {24.1:6.1f}"]


def with_number_and_spread(circle: Circle, k: int) -> list[object]:
    """Return angle, number of the row, reading in mm and a spread."""
    _, reading_mm = field.scaled(1e3)(circle, k)
    return [circle.angle_deg[k], k + 1, reading_mm, 0.1]


def unit_row_cases() -> dict[str, FieldCase]:
    """Return printouts in which some columns have a unit below their names, and others none."""
    kind = "units below the names of aligned columns"
    names = " No   Angle     Deviation    Spread"
    cases = {}
    below = {
        "aligned": "        deg          mm",
        "bracketed": "       [deg]       [mm]          [um]",
        "comment": "#       deg          mm",
        "rule": "----  -----    ----------    ------\n        deg          mm",
    }
    for name, units in below.items():
        above = f"#{names[1:]}" if name == "comment" else names
        files = field.texts(units, printed, above=above, suffix=".txt")
        cases[f"unit_row_{name}"] = FieldCase(kind, f"{units.strip()!r} below {above!r}", files)
    cases["unit_row_not_aligned"] = FieldCase(
        kind,
        "three units at the left of four columns",
        field.texts("deg mm um", printed, above=names, suffix=".txt"),
        refusal="Write '-' in place of each unit that is missing in line 2",
        mended=field.texts("- deg mm um", printed, above=names, suffix=".txt"),
    )
    cases["unit_row_without_separators"] = FieldCase(
        kind,
        "three units between commas below four names",
        field.texts(
            "deg,mm,um",
            with_number_and_spread,
            above="Angle,Index,Deviation,Spread",
        ),
        refusal="Write '-' in place of each unit that is missing in line 2",
        mended=field.texts(
            "deg,-,mm,um",
            with_number_and_spread,
            above="Angle,Index,Deviation,Spread",
        ),
    )
    return cases


def several_table_cases() -> dict[str, FieldCase]:
    """Return logs of several tables whose first line states a radius beside the load."""
    kind = "a first line that holds for several tables"
    circles = tuple(replace(circle, radius_mm=250.0) for circle in field.TRUTH)
    cases = {}
    lines = ("Load {F:g} N, XY, radius 250 mm", "Load {F:g} N with radius 250 mm (XY)")
    for number, first in enumerate(lines):
        content = []
        for circle in circles:
            line = "Load {F:g} N" if content else first
            content += [line.format(F=circle.force_N), "Angle [deg];Reading [um]"]
            for k in range(len(circle.angle_deg)):
                content.append(";".join(str(cell) for cell in field.plain(circle, k)))
        files = {"log.txt": "\n".join([*content, ""]).encode()}
        cases[f"first_line_{number}"] = FieldCase(
            kind, f"a first line {first!r}", files, circles=circles
        )
    return cases


def statistics_cases() -> dict[str, FieldCase]:
    """Return tables with rows of statistics below each circle."""
    cases = {}
    rows = {"angles": "{F};mean;1.2|{F};std. dev.;0.3", "tests": "mean;;1.2|sd;;0.3"}
    for name, statistics in rows.items():
        lines = ["force_N;angle_deg;reading_um"]
        for circle in field.TRUTH:
            for k in range(len(circle.angle_deg)):
                cells = [f"{circle.force_N:g}", *field.plain(circle, k)]
                lines.append(";".join(str(cell) for cell in cells))
            lines += statistics.replace("{F}", f"{circle.force_N:g}").split("|")
        cases[f"statistics_below_each_{name}"] = FieldCase(
            "statistics below each circle",
            f"rows {statistics!r}",
            {"all.csv": "\n".join([*lines, ""]).encode()},
            options=("--test-column", "force_N", "--force-column", "force_N"),
            note="6 rows left out",
        )
    return cases


def end_angle_cases() -> dict[str, FieldCase]:
    """Return tables of points whose angles lines state by their end."""
    kind = "an end angle and numbers of points"

    def row(circle: Circle, k: int) -> list[object]:
        return [k + 1, f"{circle.reading_um[k]:.3f}"]

    header = "Punkt,Abweichung [um]"
    steps = "Startwinkel 0\nEndwinkel 360\nSchrittweite 5"
    mended = field.texts(header, row, above="Start angle: 0 deg; angle step: 5 deg\nEndwinkel 355")
    return {
        "end_angle_with_step": FieldCase(
            kind, "start, end and step without units", field.texts(header, row, above=steps)
        ),
        "end_angle_alone": FieldCase(
            kind,
            "an end angle alone",
            field.texts(header, row, above="Endwinkel 355"),
            refusal="Write a line 'Start angle: 0 deg; angle step: 5 deg' above the table",
            mended=mended,
        ),
    }


def test_column_cases() -> dict[str, FieldCase]:
    """Return tables in which the column of forces, or of pressures, tells the circles apart."""
    kind = "loads that name the circles"

    def row(circle: Circle, k: int) -> list[object]:
        return [f"{circle.force_N:g}", *field.plain(circle, k)]

    def pressure_row(circle: Circle, k: int) -> list[object]:
        return [f"{(circle.force_N + 14.2) / 126.04:.12f}", *field.plain(circle, k)]

    headers = {"Siła [N]": row, "Load": row, "Druck [bar]": pressure_row}
    cases = {}
    for number, (header, row_of_header) in enumerate(headers.items()):
        cases[f"loads_name_circles_{number}"] = FieldCase(
            kind,
            f"a column {header!r}",
            field.tidy(f"{header},Angle [deg],Reading [um]", row_of_header),
            refusal=f"If each value is a test, give --test-column '{header}'",
            step=("--test-column", header),
        )
    return cases


def index_cases() -> dict[str, FieldCase]:
    """Return tables whose headers have several levels, with the name of the index below them."""
    kind = "headers of several levels"
    circles = tuple(replace(circle, direction="CW") for circle in field.TRUTH)
    return {
        "levels_workbook": FieldCase(
            kind,
            "merged loads above readings and directions, the index below",
            {"frame.xlsx": field.workbook(fill_with_levels)},
            circles=circles,
        ),
        "levels_text": FieldCase(
            kind,
            "loads above readings and directions, the index below",
            {"frame.csv": joined_by_commas(table_with_levels(is_merged=False))},
            circles=circles,
        ),
        "names_once": FieldCase(
            kind,
            "the name of each circle in its first row only",
            {"frame.csv": joined_by_commas(table_with_names_once())},
            note="filled downwards",
        ),
    }


def table_with_levels(*, is_merged: bool) -> list[list[object]]:
    """Return loads above readings and directions; merged loads stand in the first of two cells."""
    loads = [""]
    names = [""]
    for circle in field.TRUTH:
        load = f"{circle.force_N:g} N"
        loads += [load, "" if is_merged else load]
        names += ["dev_um", "travel"]
    index: list[object] = ["angle_deg", *[""] * 6]
    rows: list[list[object]] = [[*loads], [*names], index]
    for k, angle in enumerate(field.ANGLES_DEG):
        row: list[object] = [float(angle)]
        for circle in field.TRUTH:
            row += [float(circle.reading_um[k]), "CW"]
        rows.append(row)
    return rows


def fill_with_levels(book: Workbook) -> None:
    """Write the table with merged loads into a sheet."""
    sheet = book.create_sheet("Sheet1")
    for row in table_with_levels(is_merged=True):
        sheet.append([None if cell == "" else cell for cell in row])


def table_with_names_once() -> list[list[object]]:
    """Return a row for each reading; the first of each circle names it."""
    rows: list[list[object]] = [["test", "point", "force_N", "angle_deg", "dev_um"]]
    for number, circle in enumerate(field.TRUTH):
        name = f"circle {number}"
        for k, angle in enumerate(field.ANGLES_DEG):
            rows.append([name, k, circle.force_N, float(angle), float(circle.reading_um[k])])
            name = ""
    return rows


def joined_by_commas(rows: Sequence[Sequence[object]]) -> bytes:
    """Return rows as lines of a text file."""
    lines = [",".join(map(str, row)) for row in rows]
    return "\n".join([*lines, ""]).encode()


def stored_number_cases() -> dict[str, FieldCase]:
    """Return a workbook whose numbers have no decimals, or three."""
    circles = tuple(
        replace(
            circle,
            reading_um=np.round(circle.reading_um) + np.where(circle.angle_deg < 90, 0.125, 0.0),
        )
        for circle in field.TRUTH
    )

    def fill(book: Workbook) -> None:
        for circle in circles:
            sheet = book.create_sheet(f"{circle.force_N:g} N")
            sheet.append(["Angle [deg]", "Reading [um]"])
            for angle, reading in zip(circle.angle_deg, circle.reading_um, strict=True):
                sheet.append([float(angle), float(reading)])

    case = FieldCase(
        "numbers stored in a workbook",
        "numbers without decimals beside numbers with three",
        {"book.xlsx": field.workbook(fill)},
        circles=circles,
    )
    return {"stored_numbers": case}


def page_cases() -> dict[str, FieldCase]:
    """Return printouts with a head on each page."""
    names = "   Angle     Deviation\n     deg            um"
    heads = (
        "Page {p} of 3   Angle [deg]   Deviation [um]",
        f"Lab 7    Page {{p}} of 3    Machine 12\n{names}",
        "Page {p} of 3 printed 2026-01-02 12:0{p} by Meier",
    )
    cases = {}
    for number, head in enumerate(heads):
        files = {}
        for circle in field.TRUTH:
            lines = [names] if number == 2 else []
            for k, (angle, reading) in enumerate(
                zip(circle.angle_deg, circle.reading_um, strict=True)
            ):
                if k % 24 == 0 and (k or number != 2):
                    lines.append(head.format(p=k // 24 + 1))
                lines.append(f"{angle:8g}    {reading:10.3f}")
            files[f"{circle.force_N:g}N.txt"] = "\n".join([*lines, ""]).encode()
        cases[f"head_of_page_{number}"] = FieldCase(
            "heads of pages", f"{head!r} on each page", files, note="the table is read whole"
        )
    return cases


def half_cases() -> dict[str, FieldCase]:
    """Return one file with all circles, each in two half tables."""
    circles = []
    lines = []
    for circle in field.TRUTH:
        first = np.append(np.arange(len(circle.angle_deg) // 2), len(circle.angle_deg) // 2)
        second = np.arange(len(circle.angle_deg) // 2, len(circle.angle_deg))
        for number, rows in enumerate((first, second), start=1):
            lines += [f"Force {circle.force_N:g} N, part {number}", "Angle [deg];Reading [um]"]
            for k in rows:
                lines.append(";".join(str(cell) for cell in field.plain(circle, int(k))))
        rows = np.concatenate([first, second])
        circles.append(
            replace(circle, angle_deg=circle.angle_deg[rows], reading_um=circle.reading_um[rows])
        )
    case = FieldCase(
        "half circles",
        "all circles in one file, each in two tables",
        {"all.csv": "\n".join([*lines, ""]).encode()},
        circles=tuple(circles),
        note="are one test",
    )
    return {"half_tables": case}


def named_number_cases() -> dict[str, FieldCase]:
    """Return logs with a name beside each number."""
    forms = (
        ("ang={a:g} dev={r} F={F:g}", ""),
        ("12:00:00 INFO acq: theta={a:g}deg dev={r}um", "12:00:00 INFO acq: start"),
        ("angle: {a:g}; reading: {r} um; force: {F:g} N; dir=CW", "plane=XY radius=150 mm"),
        ("  - {{angle: {a:g}, reading: {r}}}", "readings:"),
    )
    cases = {}
    for number, (line, above) in enumerate(forms):
        files = {}
        for circle in field.TRUTH:
            lines = [above]
            for angle, reading in zip(circle.angle_deg, circle.reading_um, strict=True):
                lines.append(line.format(a=angle, r=f"{reading:.3f}", F=circle.force_N))
            files[f"{circle.force_N:g}N.log"] = "\n".join([*lines, ""]).encode()
        example = line.format(a=5.0, r="-1.234", F=100.0)
        cases[f"named_numbers_{number}"] = FieldCase(
            "names beside numbers", f"lines such as {example}", files
        )
    return cases


def letter_cases() -> dict[str, FieldCase]:
    """Return letters with a table, and tables as psql prints them."""

    def row(circle: Circle, k: int) -> list[object]:
        return ["    ".join(str(cell) for cell in field.plain(circle, k))]

    letter = field.texts(
        "Angle [deg]   Deviation [um]",
        row,
        above="Dear Mr Smith,\nbelow are our readings.",
        below="Best regards\nJan\nMeetkamer\nTel. +31 40 123 4567\nKvK 12345678",
        suffix=".txt",
    )
    lines = []
    for circle in field.TRUTH:
        lines += [f"Force {circle.force_N:g} N", " angle_deg | reading_um ", "-----+-----"]
        for k in range(len(circle.angle_deg)):
            lines.append(" | ".join(str(cell) for cell in field.plain(circle, k)))
        lines += ["(72 rows)", "", "Time: 1.234 ms", ""]
    printed_tables = {"psql.txt": "\n".join(lines).encode()}
    query = "db=> select angle_deg, reading_um from circles where force_N = "
    queries = "\n".join(lines).replace("Force ", query).replace(" N\n", ";\n")
    kind = "texts below tables"
    return {
        "letter": FieldCase(kind, "a letter with a telephone number below the table", letter),
        "psql": FieldCase(kind, "tables as psql prints them", printed_tables),
        "psql_queries": FieldCase(
            kind, "queries of psql above their tables", {"psql.txt": queries.encode()}
        ),
    }


def address_cases() -> dict[str, FieldCase]:
    """Return lines of a controller, with a letter before each number."""

    def row(circle: Circle, k: int) -> list[object]:
        angle = circle.angle_deg[k]
        return [f"N{10 * k + 10:04d}C{angle:.3f}W{circle.reading_um[k] / 1e3:.6f}"]

    case = FieldCase(
        "letters before numbers",
        "lines such as N0010C0.000W0.003700",
        field.texts("%", row, above="(FORCE {F}N PLANE XY)", suffix=".NC"),
        refusal="a column must hold the angle, or the time, got 'N', 'C', 'W'",
        step=("--angle-column", "C", "--reading-column", "W", "--unit", "mm"),
    )
    return {"addresses": case}


def quoted_cases() -> dict[str, FieldCase]:
    """Return tables that a mail quotes, and a table in the dump of a database."""

    def quoted(circle: Circle, k: int) -> list[object]:
        angle, reading = field.plain(circle, k)
        return [f"> {angle} | {reading}"]

    rows = []
    for number, circle in enumerate(field.TRUTH, start=1):
        for k in range(len(circle.angle_deg)):
            angle, reading = field.plain(circle, k)
            rows.append(f"{len(rows)}\t{number}\t{angle}\t{reading}")
    tests = [f"{k}\t{circle.force_N:g}" for k, circle in enumerate(field.TRUTH, start=1)]
    dump = [
        "-- PostgreSQL database dump",
        "COPY public.test (id, force_n) FROM stdin;",
        *tests,
        "\\.",
        "COPY public.reading (id, test_id, angle_deg, reading_um) FROM stdin;",
        *rows,
        "\\.",
        "ALTER TABLE ONLY public.reading ADD CONSTRAINT reading_pkey PRIMARY KEY (id);",
        "",
    ]
    inserts = [
        "-- MySQL dump",
        "CREATE TABLE `test` (`id` int, `load` double COMMENT 'N', PRIMARY KEY (`id`));",
        f"INSERT INTO `test` VALUES {_rows_of_insert(tests)};",
        "CREATE TABLE `reading` (",
        "  `id` int NOT NULL,",
        "  `test_id` int NOT NULL,",
        "  `angle` double DEFAULT NULL COMMENT 'degrees',",
        "  `dev` double DEFAULT NULL COMMENT 'um, bar longer = positive'",
        ") ENGINE=InnoDB;",
        f"INSERT INTO `reading` VALUES {_rows_of_insert(rows)};",
        "",
    ]
    return {
        "quoted_mail": FieldCase(
            "quoted mails",
            "a table whose lines begin with >",
            field.texts("> Angle [deg] | Reading [um]", quoted, above="Hello,", suffix=".txt"),
        ),
        "dump_of_tables": FieldCase(
            "dumps of a database",
            "a dump of PostgreSQL with a table of tests and one of readings",
            {"dump.sql": "\n".join(dump).encode()},
            refusal="force or pressure must be known",
            step=("--test-column", "test_id", "--forces-N", "100,300,600"),
        ),
        "dump_of_inserts": FieldCase(
            "dumps of a database",
            "a dump of MySQL with many rows in each command INSERT",
            {"dump.sql": "\n".join(inserts).encode()},
        ),
    }


def _rows_of_insert(rows: Sequence[str]) -> str:
    """Return rows, whose cells are separated by tabs, as in a command INSERT of SQL."""
    return ",".join(f"({','.join(row.split())})" for row in rows)


def run_in_cases() -> dict[str, FieldCase]:
    """Return logs over time whose lines state a run-in."""
    kind = "run-in of logs over time"
    rows = np.arange(-9, len(field.ANGLES_DEG))

    def logged(circle: Circle) -> list[str]:
        lines = []
        for k in rows:
            seconds = np.deg2rad(5.0 * (k + 9)) * field.RADIUS_MM / (field.FEED_MM_PER_MIN / 60.0)
            lines.append(f"{seconds:.5f},{circle.reading_um[k]:.3f}")
        return lines

    cases = {}
    lines = ("Einlauf 45 Grad", "run-in: 45 deg", "Anlauf: 45°, Auslauf: 0°", "Overrun 45 deg")
    for number, line in enumerate(lines):
        files = {}
        for circle in field.TRUTH:
            above = [line, "Feed 2000 mm/min", "Radius 150 mm", "Direction CCW"]
            content = [*above, "time [s],Reading [um]", *logged(circle), ""]
            files[f"{circle.force_N:g}N.csv"] = "\n".join(content).encode()
        cases[f"run_in_{number}"] = FieldCase(kind, f"a line {line!r}", files)
    return cases


def logger_cases() -> dict[str, FieldCase]:
    """Return files of a data logger, with units and kinds of samples below the names."""

    def row(circle: Circle, k: int) -> list[object]:
        stamp = f'"2026-03-04 11:05:{k // 2:02d}"'
        return [stamp, k, *field.plain(circle, k), f"{circle.force_N:g}", 22.1]

    above = (
        '"TOA5","Lab","CR6","11234","CR6.Std.12.02","CPU:bar.CR6","40121","Circle"\n'
        '"TIMESTAMP","RECORD","Theta","BarElong_Avg","Force_Avg","PTemp_Avg"\n'
        '"TS","RN","deg","um","N","Deg C"'
    )
    files = field.texts('"","","Smp","Avg","Avg","Avg"', row, above=above, suffix=".dat")
    return {"logger": FieldCase("files of a data logger", "a file in the format TOA5", files)}


def dotted_cases() -> dict[str, FieldCase]:
    """Return tables whose headers have dots or words in front of their units."""
    kind = "words in front of units"
    cases = {}
    for number, (header, size) in enumerate(
        {
            "angle.deg,deviation.micro.metres": 1.0,
            "angle_deg,dev_milli_inch": 25.4,
            "angle deg,dev hundred thousandths of an inch": 0.254,
            "angle..deg.,deviation..um..1": 1.0,
        }.items()
    ):
        files = field.texts(header, field.scaled(size))
        cases[f"unit_words_{number}"] = FieldCase(kind, f"a header {header!r}", files)

    def tenths(circle: Circle, k: int) -> list[object]:
        return [f"{10.0 * circle.angle_deg[k]:g}", f"{circle.reading_um[k]:.3f}"]

    cases["unit_words_angle"] = FieldCase(
        kind,
        "angles in tenths of a degree",
        field.texts("angle.tenths.of.a.degree,deviation.um", tenths),
    )

    def row(circle: Circle, k: int) -> list[object]:
        return [f"c{circle.force_N:g}", f"{circle.force_N / 9.80665:.9f}", *field.plain(circle, k)]

    cases["unit_words_kilograms"] = FieldCase(
        kind,
        "a force in kilograms",
        field.tidy("test,load_kg,angle_deg,reading_um", row),
        refusal="got 'kg' in line 1. Correct the header, or give --force-unit",
        step=("--force-unit", "kgf"),
    )

    def in_gon(circle: Circle, k: int) -> list[object]:
        return [f"{circle.angle_deg[k] / 0.9:.6f}", f"{circle.reading_um[k]:.3f}"]

    cases["unit_words_gr"] = FieldCase(
        kind,
        "angles in gr, which are gon here",
        field.texts("Position (gr),Reading (um)", in_gon),
        refusal="--angle-unit gon (400 in a turn) or --angle-unit deg (360)",
        step=("--angle-unit", "gon"),
    )
    cases["unit_words_lost_sign"] = FieldCase(
        kind,
        "R's dots in place of a space, a bracket and µ",
        field.texts("angle..deg.,dev...m."),
        refusal="got '?m' in line 1. Correct the header, or give --unit",
        step=("--unit", "um"),
    )
    return cases
