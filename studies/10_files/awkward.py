"""One campaign of three circles, written as awkwardly as instruments and spreadsheets write: every
case must import to the same.

python studies/10_files/awkward.py FOLDER    # writes all cases, one folder each, with a README of
what is awkward
"""

from __future__ import annotations

import io
import sys
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from openpyxl import Workbook

import ldbb_bayes as lb

__all__ = ["CASES", "Case", "campaign"]

Array = NDArray[np.float64]
PRESSURES_BAR = (1.0, 3.5, 6.0)
READINGS = 72
FEED_MM_PER_MIN = 2000.0
NAMES = ("light", "middle", "heavy")


def campaign() -> lb.Campaign:
    """Three circles, counter-clockwise from 0°, readings in whole hundredths of a micrometre."""
    law = lb.campaign.ForceLaw()
    angle = np.arange(READINGS) * 360.0 / READINGS
    theta = np.deg2rad(angle)
    tests = []
    for k, pressure in enumerate(PRESSURES_BAR):
        wave = (
            8.0 * np.cos(2.0 * theta)
            - (3.0 + k) * np.sin(theta)
            + 1.3 * np.cos(4.0 * theta + k)
            - 12.0
            + 9.0 * k
        )
        tests.append(
            lb.CircularTest(
                law.force_N(pressure),
                angle,
                np.round(wave, 2),
                pressure_bar=pressure,
                name=NAMES[k],
                direction="CCW",
            )
        )
    return lb.Campaign(tuple(tests))


@dataclass(frozen=True)
class Case:
    """Files by name, what is awkward in them, and what has to be said on the command line.

    Attributes
    ----------
    options : sequence of str
        Of ``ldbb-bayes import``.
    """

    description: str
    files: Mapping[str, bytes]
    options: Sequence[str] = ()


def as_it_is(content: Any) -> Any:
    """Nothing changed."""
    return content


@dataclass(frozen=True)
class Writing:
    """How one table is written."""

    separator: str = ","
    decimal: str = "."
    header: tuple[str, str] | None = ("angle_deg", "reading_um")
    above: Sequence[str] = ()
    below: Sequence[str] = ()
    end: str = "\n"
    encoding: str = "utf-8"
    angle: Callable[[Array], Array] = as_it_is
    reading: Callable[[Array], Array] = as_it_is
    digits: tuple[int, int] = (4, 2)
    cell: Callable[[str], str] = as_it_is
    row: Callable[[list[str]], list[str]] = as_it_is

    def table(self, test: lb.CircularTest) -> bytes:
        """The file of one test."""
        angle = self.angle(np.asarray(test.angle_deg))
        reading = self.reading(np.asarray(test.reading_um))
        rows = []
        for a, r in zip(angle, reading, strict=True):
            cells = [f"{a:.{self.digits[0]}f}", f"{r:.{self.digits[1]}f}"]
            rows.append(self.row([self.cell(cell.replace(".", self.decimal)) for cell in cells]))
        head = (
            []
            if self.header is None
            else [self.separator.join(self.row([self.cell(name) for name in self.header]))]
        )
        lines = [line.format(test=test) for line in self.above] + head
        lines += [self.separator.join(cells) for cells in rows] + [
            line.format(test=test) for line in self.below
        ]
        return self.end.join([*lines, ""]).encode(self.encoding)

    def with_units(self, *units: str) -> Writing:
        """A second line of the header."""
        assert self.header is not None
        first = self.separator.join(self.header)
        return replace(self, header=(units[0], units[1]), above=[*self.above, first])

    def files(self, suffix: str = ".csv") -> dict[str, bytes]:
        """One file a test, named by its force."""
        return {
            f"{test.name} {test.pressure_bar:g} bar{suffix}": self.table(test)
            for test in campaign().tests
        }


def tidy(
    columns: Sequence[str],
    row: Callable[[lb.CircularTest, float, float], Sequence[str]],
    separator: str = ",",
) -> bytes:
    """All tests in one table."""
    lines = [separator.join(columns)]
    for test in campaign().tests:
        lines += [
            separator.join(row(test, a, r))
            for a, r in zip(test.angle_deg, test.reading_um, strict=True)
        ]
    return "\n".join([*lines, ""]).encode()


def workbook(fill: Callable[[Workbook], None]) -> bytes:
    """A workbook as bytes."""
    book = Workbook()
    stream = io.BytesIO()
    fill(book)
    book.save(stream)
    return stream.getvalue()


def one_sheet_a_test(book: Workbook) -> None:
    book.remove(book.active)
    for test in campaign().tests:
        sheet = book.create_sheet(f"{test.name} {test.pressure_bar:g} bar")
        sheet.append(["Angle [deg]", "Reading [µm]"])
        for a, r in zip(test.angle_deg, test.reading_um, strict=True):
            sheet.append([float(a), float(r)])
    book.create_sheet("notes")


def titled_sheet(book: Workbook) -> None:
    sheet = book.active
    sheet.append(["Loaded ball bar, machine 7"])
    sheet.append([])
    sheet.append([None, "test", "P (bar)", "theta (rad)", "rho (mm)", "remark"])
    for test in campaign().tests:
        for k, (a, r) in enumerate(zip(test.angles_rad(), test.reading_um, strict=True)):
            sheet.append(
                [None, test.name, test.pressure_bar, float(a), float(r) * 1e-3, "ok" if k else None]
            )


def numbered_sheets(book: Workbook) -> None:
    book.remove(book.active)
    for k, test in enumerate(campaign().tests, start=1):
        sheet = book.create_sheet(f"Versuch {k}")
        sheet.append(["Winkel [°]", "Messwert [µm]"])
        for a, r in zip(test.angle_deg, test.reading_um, strict=True):
            sheet.append([float(a), float(r)])


def open_document_cell(value: str | float) -> str:
    """One cell of a sheet of an OpenDocument workbook."""
    if isinstance(value, str):
        content = f'string"><text:p>{value}</text:p>'
    else:
        content = f'float" office:value="{float(value)!r}">'
    return f'<table:table-cell office:value-type="{content}</table:table-cell>'


def open_document_row(values: Sequence[str | float]) -> str:
    """One row of a sheet of an OpenDocument workbook."""
    cells = "".join(open_document_cell(value) for value in values)
    return f"<table:table-row>{cells}</table:table-row>"


def open_document_sheet(test: lb.CircularTest) -> str:
    """One test, with the empty rows to the end that spreadsheets leave below."""
    rows = [open_document_row(["Winkel [°]", "Messwert [µm]"])]
    for angle, reading in zip(test.angle_deg, test.reading_um, strict=True):
        rows.append(open_document_row([angle, reading]))
    below = (
        "<table:table-row"
        ' table:number-rows-repeated="1048503"><table:table-cell/></table:table-row>'
    )
    name = f"{test.name} {test.pressure_bar:g} bar"
    return f'<table:table table:name="{name}">{"".join(rows)}{below}</table:table>'


def open_document() -> bytes:
    """The tests as sheets of an OpenDocument workbook."""
    sheets = "".join(open_document_sheet(test) for test in campaign().tests)
    names = ""
    for prefix in ("office", "table", "text"):
        names += f' xmlns:{prefix}="urn:oasis:names:tc:opendocument:xmlns:{prefix}:1.0"'
    body = f"<office:body><office:spreadsheet>{sheets}</office:spreadsheet></office:body>"
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        archive.writestr(
            "META-INF/manifest.xml",
            '<m:manifest xmlns:m="urn:oasis:names:tc:opendocument:xmlns:manifest:1.0"/>',
        )
        archive.writestr(
            "content.xml", f"<office:document-content{names}>{body}</office:document-content>"
        )
    return stream.getvalue()


def wide(angle: str, names: Sequence[str], separator: str = ",", decimal: str = ".") -> bytes:
    """All tests side by side, readings in mm."""
    tests = campaign().tests
    lines = []
    for k, angle_deg in enumerate(tests[0].angle_deg):
        cells = [f"{angle_deg:g}"]
        for test in tests:
            cells.append(f"{test.reading_um[k] * 1e-3:.5f}")
        lines.append(separator.join(cells).replace(".", decimal))
    return "\n".join([separator.join([angle, *names]), *lines, ""]).encode()


def log(
    unit_s: float, digits: int, *, clockwise: bool = False, run_in_deg: float = 0.0
) -> dict[str, bytes]:
    """Time and reading of circles run at constant feed, with run-in and run-out."""
    files = {}
    for test in campaign().tests:
        step = 360.0 / READINGS
        lead = round(run_in_deg / step)
        order = np.arange(-lead, READINGS + 1 + lead)
        reading = np.asarray(test.reading_um)[(-order if clockwise else order) % READINGS]
        seconds = np.deg2rad(step) * 150.0 / (FEED_MM_PER_MIN / 60.0) * (order + lead)
        lines = [f"{seconds[k] / unit_s:.{digits}f};{reading[k]:.2f}" for k in range(len(order))]
        head = [
            f"Pressure: {test.pressure_bar:g} bar",
            f"Feed {FEED_MM_PER_MIN:g} mm/min",
            f"Overshoot {run_in_deg:g} deg",
            "",
        ]
        unit = {1.0: "s", 1e-3: "ms"}[unit_s]
        files[f"{test.name}.txt"] = "\n".join(
            [*head, f"t ({unit});deviation (um)", *lines, ""]
        ).encode()
    return files


def by_the_clock(files: Mapping[str, bytes], *, twelve: bool = False) -> dict[str, bytes]:
    """Logs that begin ten seconds before midnight, by a clock of 24 or of twelve hours."""
    by_clock = {}
    for name, content in files.items():
        lines = content.decode().split("\n")
        rows = [line_by_the_clock(line, twelve=twelve) for line in lines]
        by_clock[name] = "\n".join(rows).encode()
    return by_clock


def line_by_the_clock(line: str, *, twelve: bool) -> str:
    """A line of a log, its seconds as a time of the day."""
    seconds, _, reading = line.partition(";")
    if not seconds[:1].isdigit():
        return line.replace("t (s)", "time")
    seconds_of_day = (86_390.0 + float(seconds)) % 86_400.0
    hour = int(seconds_of_day // 3600)
    minutes = f"{int(seconds_of_day // 60) % 60:02d}:{seconds_of_day % 60.0:09.6f}"
    if not twelve:
        return f"{hour:02d}:{minutes};{reading}"
    half = "PM" if hour > 11 else "AM"
    return f"{(hour + 11) % 12 + 1}:{minutes} {half};{reading}"


def laps(count: int) -> dict[str, bytes]:
    """Several laps of each circle in one file; their scatter is symmetric about the circle."""
    files = {}
    for test in campaign().tests:
        lines = ["lap,angle_deg,reading_um"]
        for lap in range(count):
            off = 0.5 * (lap - (count - 1) / 2)
            lines += [
                f"{lap + 1},{a:.4f},{r + off:.2f}"
                for a, r in zip(test.angle_deg, test.reading_um, strict=True)
            ]
        files[f"{test.name} {test.pressure_bar:g} bar.csv"] = "\n".join([*lines, ""]).encode()
    return files


def turned(angle: Array) -> Array:
    """Counted clockwise from the second axis."""
    return np.mod(90.0 - angle, 360.0)


CASES: dict[str, Case] = {
    "01_plain": Case("one file a test, pressure in the file's name", Writing().files()),
    "02_semicolon": Case("semicolons and decimal commas", Writing(";", ",").files()),
    "03_tab": Case("tabs and decimal commas", Writing("\t", ",").files(".txt")),
    "04_bar": Case("vertical bars with blanks around them", Writing(" | ").files(".txt")),
    "05_blanks": Case(
        "columns aligned with blanks",
        Writing(" ", cell=lambda cell: f"{cell:>14}", header=("angle", "reading")).files(".dat"),
    ),
    "06_utf8_mark": Case("a byte-order mark", Writing(encoding="utf-8-sig").files()),
    "07_utf16": Case(
        "UTF-16 with a mark, as spreadsheets' 'Unicode text'",
        Writing("\t", encoding="utf-16").files(".txt"),
    ),
    "08_utf16_bare": Case(
        "UTF-16, big-endian, no mark", Writing("\t", encoding="utf-16-be").files(".txt")
    ),
    "09_windows": Case(
        "Windows-1252 with µ and °",
        Writing(";", ",", ("Winkel [°]", "Abweichung [µm]"), encoding="cp1252").files(),
    ),
    "10_cr": Case("lines that end as on an old Macintosh", Writing(end="\r").files()),
    "11_trailing": Case(
        "separators at the ends of lines, blank lines between",
        Writing(";", ",", row=lambda cells: [*cells, "", ""], end="\r\n\r\n").files(),
    ),
    "12_preamble": Case(
        "an instrument's lines above the table",
        Writing(
            above=[
                "LDBB log v2.1",
                "Operator: J. D.",
                "Pressure: {test.pressure_bar:g} bar",
                "Radius 150 mm",
                "",
                "--- data ---",
            ]
        ).files(),
    ),
    "13_units_below": Case(
        "units in a line of their own",
        Writing(";", ",", ("angle", "reading")).with_units("[°]", "[µm]").files(),
    ),
    "14_words": Case(
        "German headers, millimetres",
        Writing(
            ";",
            ",",
            ("Winkel in Grad", "Messwert in mm"),
            reading=lambda r: r * 1e-3,
            digits=(4, 5),
        ).files(),
    ),
    "15_brackets": Case(
        "units in brackets, readings in nanometres",
        Writing(
            header=("theta (deg)", "rho {nm}"), reading=lambda r: r * 1e3, digits=(3, 0)
        ).files(),
    ),
    "16_radians": Case(
        "radians",
        Writing(header=("angle_rad", "reading_um"), angle=np.deg2rad, digits=(10, 2)).files(),
    ),
    "17_gon": Case(
        "gon, and the header does not say so",
        Writing(header=("angle", "reading_um"), angle=lambda a: a / 0.9, digits=(6, 2)).files(),
        ("--angle-unit", "gon"),
    ),
    "18_inch": Case(
        "inches",
        Writing(
            header=("angle (deg)", "deviation (in)"), reading=lambda r: r / 25_400.0, digits=(4, 9)
        ).files(),
    ),
    "19_distances": Case(
        "distances of the balls instead of deviations",
        Writing(
            header=("angle (deg)", "radius (mm)"), reading=lambda r: 150.0 + r * 1e-3, digits=(4, 5)
        ).files(),
    ),
    "20_no_header": Case("no header at all", Writing(header=None).files(".txt")),
    "21_other_columns": Case(
        "other columns between, angle last",
        Writing(
            header=("angle_deg", "reading_um"),
            row=lambda c: ["A7", c[1], "21.4" if c[1][-1].isdigit() else "temperature", c[0]],
        ).files(),
    ),
    "22_tidy_psi": Case(
        "one table, pressure alone, in psi",
        {
            "all.csv": tidy(
                ["run", "P (psi)", "angle_deg", "reading_um"],
                lambda t, a, r: [
                    t.name,
                    f"{t.pressure_bar / 0.0689475729317831:.9f}",
                    f"{a:g}",
                    f"{r:.2f}",
                ],
            )
        },
    ),
    "23_tidy_kilonewton": Case(
        "one table, force in kN, direction as G-code",
        {
            "all.csv": tidy(
                ["test", "force (kN)", "dir", "theta (deg)", "error (um)"],
                lambda t, a, r: [t.name, f"{t.force_N * 1e-3:.9f}", "G03", f"{a:g}", f"{r:.2f}"],
            )
        },
    ),
    "24_log": Case("readings over time in s, with feed and run-in", log(1.0, 7, run_in_deg=45.0)),
    "25_log_ms": Case(
        "over time in ms, clockwise from 0°",
        log(1e-3, 4, clockwise=True),
        ("--start-deg", "0", "--direction", "CW"),
    ),
    "26_laps": Case("three laps of each circle, to be averaged", laps(3), ("--laps", "average")),
    "27_thousands": Case(
        "marks between thousands",
        Writing(
            ";",
            header=("angle_deg", "reading_nm"),
            reading=lambda r: r * 1e3,
            digits=(1, 1),
            cell=lambda c: c if not c[-1].isdigit() else f"{float(c):,.1f}",
        ).files(),
    ),
    "28_workbook": Case(
        "a workbook, one sheet a test, one of them empty", {"book.xlsx": workbook(one_sheet_a_test)}
    ),
    "29_titled_workbook": Case(
        "a workbook with a title, an empty column, remarks", {"book.xlsx": workbook(titled_sheet)}
    ),
    "30_quotes": Case("every cell in quotes", Writing(cell=lambda cell: f'"{cell}"').files()),
    "31_turned": Case(
        "angles counted clockwise from the second axis",
        Writing(angle=turned).files(),
        ("--angle-sign", "-1", "--angle-offset-deg", "90"),
    ),
    "32_sign": Case(
        "a longer bar counts as negative", Writing(reading=lambda r: -r).files(), ("--sign", "-1")
    ),
    "33_footer": Case(
        "lines below the table", Writing(below=["", "end of file", "checked: yes"]).files()
    ),
    "34_comments": Case(
        "comments above the table",
        Writing(above=["# exported from the bar", "# force = {test.force_N:.6f} N"]).files(),
    ),
    "35_exponents": Case(
        "Fortran exponents",
        Writing(
            cell=lambda c: c if not c[-1].isdigit() else f"{float(c):.8E}".replace("E", "D")
        ).files(),
    ),
    "36_minus": Case(
        "a typographic minus sign", Writing(cell=lambda c: c.replace("-", "−")).files()
    ),
    "37_clock": Case("over time of day, past midnight", by_the_clock(log(1.0, 6, run_in_deg=45.0))),
    "38_twelve_hours": Case(
        "over time of day with AM and PM, past midnight",
        by_the_clock(log(1.0, 6, run_in_deg=45.0), twelve=True),
    ),
    "39_wide": Case(
        "one table with a column for each test, decimal commas",
        {
            "all.csv": wide(
                "Winkel [°]",
                [
                    f"{t.name} {t.pressure_bar:g} bar [mm]".replace(".", ",")
                    for t in campaign().tests
                ],
                ";",
                ",",
            )
        },
    ),
    "40_named_columns": Case(
        "one table with a column for each test, named by letters",
        {"all.csv": wide("angle (deg)", ["A (mm)", "B (mm)", "C (mm)"])},
        (
            *("--reading-column", "A", "--reading-column", "B", "--reading-column", "C"),
            *("--pressures-bar", ",".join(f"{t.pressure_bar:g}" for t in campaign().tests)),
        ),
    ),
    "41_numbered_sheets": Case(
        "a workbook whose sheets are numbered",
        {"book.xlsx": workbook(numbered_sheets)},
        ("--pressures-bar", ",".join(f"{t.pressure_bar:g}" for t in campaign().tests)),
    ),
    "42_markdown": Case(
        "a table as it is written in notes",
        {
            name: (
                (
                    "| angle_deg | reading_um |\n|---|---|\n" + content.decode().split("\n", 1)[1]
                ).encode()
            )
            for name, content in Writing(" | ", row=lambda c: ["", *c, ""]).files(".md").items()
        },
    ),
    "43_open_document": Case(
        "an OpenDocument workbook, one sheet a test", {"book.ods": open_document()}
    ),
}


def main() -> None:
    """Write the folder."""
    if len(sys.argv) != 2:
        sys.exit("give the folder to write")
    root = Path(sys.argv[1])
    lines = [
        "# Awkward files",
        "",
        "All import to one campaign.",
        "",
        "| folder | awkward | options |",
        "|---|---|---|",
    ]
    for name, case in CASES.items():
        folder = root / name
        folder.mkdir(parents=True, exist_ok=True)
        for file, content in case.files.items():
            (folder / file).write_bytes(content)
        lines.append(f"| {name} | {case.description} | {' '.join(case.options)} |")
    (root / "README.md").write_text("\n".join([*lines, ""]), encoding="utf-8")


if __name__ == "__main__":
    main()
