"""Files that must be refused: each with what the message has to name.

python studies/10_files/malformed.py FOLDER    # writes them all
"""

from __future__ import annotations

import io
import random
import struct
import sys
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from awkward import READINGS, Writing, campaign, workbook
from openpyxl import Workbook

__all__ = ["CASES", "Malformed"]

TEST = campaign().tests[0]
PLAIN = Writing().table(TEST).decode()
LINES = PLAIN.splitlines()
NAME = "36N.csv"


@dataclass(frozen=True)
class Malformed:
    """A file, and what the message must name.

    Attributes
    ----------
    names : sequence of str
        All of these stand in the message.
    options : sequence of str
        Of ``ldbb-bayes import``.
    """

    description: str
    content: bytes
    names: Sequence[str]
    file: str = NAME
    options: Sequence[str] = ()


def with_line(number: int, line: str) -> bytes:
    """The plain table with another line, counted from 1."""
    return "\n".join([*LINES[: number - 1], line, *LINES[number:], ""]).encode()


def without_readings() -> bytes:
    """The plain table with nan in place of each reading."""
    rows = [f"{line.split(',')[0]},nan" for line in LINES[1:]]
    return "\n".join([LINES[0], *rows, ""]).encode()


def without_lines(first: int, last: int) -> bytes:
    return "\n".join([*LINES[: first - 1], *LINES[last:], ""]).encode()


def sheet(change: Callable[[Workbook], None]) -> bytes:
    """A workbook of the plain table, changed."""

    def fill(book: Workbook) -> None:
        table = book.active
        table.title = "36 N"
        table.append(["angle_deg", "reading_um"])
        for angle, reading in zip(TEST.angle_deg, TEST.reading_um, strict=True):
            table.append([float(angle), float(reading)])
        change(book)

    return workbook(fill)


def put(cell: str, value: object) -> Callable[[Workbook], None]:
    def change(book: Workbook) -> None:
        book.active[cell] = value

    return change


def labelled(label: str) -> list[list[object]]:
    return [
        ["test", "force_N", "angle_deg", "reading_um"],
        *([label, 36, 5 * k, k % 7] for k in range(72)),
    ]


def repacked(
    raw: bytes, change: Callable[[str, bytes], bytes | None], extra: dict[str, bytes] | None = None
) -> bytes:
    """A workbook with its parts changed (None: left out) and others added."""
    stream = io.BytesIO()
    with (
        zipfile.ZipFile(io.BytesIO(raw)) as old,
        zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as new,
    ):
        for entry in old.infolist():
            content = change(entry.filename, old.read(entry))
            if content is not None:
                new.writestr(entry.filename, content)
        for name, content in (extra or {}).items():
            new.writestr(name, content)
    return stream.getvalue()


def unchanged(name: str, content: bytes) -> bytes:
    """A part as it is."""
    return content


def left_out(name: str, content: bytes) -> None:
    """No part."""


def half_of_sheet(name: str, content: bytes) -> bytes:
    """The first half of the first sheet; other parts as they are."""
    if "sheet1" in name:
        return content[: len(content) // 2]
    return content


def with_far_cell(name: str, content: bytes) -> bytes:
    """One cell of the first sheet moved to its last corner; other parts as they are."""
    if name.endswith("sheet1.xml"):
        return content.replace(b'r="A40"', b'r="XFD1048576"', 1)
    return content


def bomb(raw: bytes) -> bytes:
    """A last part of a quarter of a megabyte, a thousand times as much unpacked by its entry in the
    list of parts."""
    content = bytearray(repacked(raw, unchanged, {"xl/big.xml": random.Random(1).randbytes(2**18)}))
    struct.pack_into("<I", content, content.rfind(b"PK\x01\x02") + 24, 2**28 + 2**20)
    return bytes(content)


def compound(name: str, content: bytes) -> bytes:
    """A compound file of one stream, as old workbooks and those with a password are."""
    size = len(content) // 512
    no = 0xFFFFFFFF
    end = 0xFFFFFFFE
    chain = struct.pack(f"<{size + 2}I", 0xFFFFFFFD, end, *range(3, size + 2), end).ljust(
        512, b"\xff"
    )

    def entry(name: str, kind: int, child: int, start: int, size: int) -> bytes:
        text = name.encode("utf-16-le") + bytes(2)
        return struct.pack(
            "<64sHBBIII16xIQQIQ", text, len(text), kind, 1, no, no, child, 0, 0, 0, start, size
        )

    directory = entry("Root Entry", 5, 1, end, 0) + entry(name, 2, no, 2, len(content)) + bytes(256)
    signs = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"
    head = struct.pack(
        "<8s16xHHHHH6x10I", signs, 62, 3, 0xFFFE, 9, 6, 0, 1, 1, 0, 4096, end, 0, end, 0, 0
    )
    return head.ljust(512, b"\xff") + chain + directory + content


# The beginning of a sheet, and that it is encrypted.
LOCKED = struct.pack("<HHHHHHII", 0x809, 16, 0x600, 5, 0, 1997, 0, 6) + struct.pack(
    "<HHHHH48x", 0x2F, 54, 1, 1, 1
)
BOOK = sheet(lambda book: None)
LOG = [
    "Pressure 1 bar",
    "t (s);reading (um)",
    *(f"{0.3 * k:.2f};{k % 7}.5" for k in range(100)),
    "",
]
TIDY = ["test,force_N,angle_deg,reading_um", *(f"a,36,{5 * k},{k % 5}.5" for k in range(72)), ""]


def log(*changes: tuple[int, str]) -> bytes:
    lines = list(LOG)
    for k, line in changes:
        lines[k] = line
    return "\n".join(lines).encode()


def tidy(k: int, line: str) -> bytes:
    return "\n".join([*TIDY[:k], line, *TIDY[k + 1 :]]).encode()


CASES: dict[str, Malformed] = {
    "01_empty": Malformed("no byte", b"", (NAME, "empty")),
    "02_blank": Malformed("blanks alone", b" \n\t\n \n", (NAME, "empty")),
    "03_header_alone": Malformed("a header and no row", LINES[0].encode(), (NAME, "table")),
    "04_words": Malformed("prose", b"This is a letter.\nIt has no table.\n" * 9, (NAME, "table")),
    "05_one_column": Malformed(
        "readings without angles",
        "\n".join(line.split(",")[1] for line in LINES).encode(),
        (NAME, "table"),
    ),
    "06_eight_rows": Malformed(
        "too few readings", "\n".join(LINES[:9]).encode(), (NAME, "at least 9")
    ),
    "07_arc": Malformed("a quarter of a circle", "\n".join(LINES[:20]).encode(), (NAME, "180°")),
    "08_word_in_row": Malformed(
        "a word for a reading", with_line(40, "195.0,blurred"), (NAME, "line 40", "'blurred'")
    ),
    "09_empty_cell": Malformed(
        "an empty cell in the column of angles", with_line(40, ",1.0"), (NAME, "line 40")
    ),
    "10_nan": Malformed("nan for every reading", without_readings(), (NAME, "table", "'nan'")),
    "11_infinite": Malformed("infinity", with_line(40, "195.0,inf"), (NAME, "line 40", "'inf'")),
    "12_overflow": Malformed(
        "a number beyond all doubles", with_line(40, "195.0,1e999"), (NAME, "line 40", "'1e999'")
    ),
    "13_short_row": Malformed(
        "a cell missing", with_line(40, "195.0"), (NAME, "line 40", "2 cells")
    ),
    "14_long_row": Malformed(
        "a cell too many", with_line(40, "195.0,1.0,2.0"), (NAME, "line 40", "2 cells")
    ),
    "15_comma_comma": Malformed(
        "decimal commas between commas",
        "\n".join([LINES[0], *(line.replace(".", ",") for line in LINES[1:])]).encode(),
        (NAME, "semicolons"),
    ),
    "16_mixed_decimal": Malformed(
        "points, then commas", with_line(40, '195.0,"1,5"'), (NAME, "line 40", "decimal mark")
    ),
    "17_two_marks": Malformed(
        "1.234.5",
        Writing(";").table(TEST).decode().replace("195.0000;", "195.0.00;").encode(),
        (NAME, "line 41", "angle"),
    ),
    "18_open_quote": Malformed(
        "a quote never closed", with_line(40, '195.0,"1.5'), (NAME, "line 40", "quotes")
    ),
    "19_underscore": Malformed("1_0", with_line(40, "195.0,1_0"), (NAME, "line 40", "'1_0'")),
    "20_hex": Malformed("0x1F", with_line(40, "195.0,0x1F"), (NAME, "line 40", "'0x1F'")),
    "21_hidden_word": Malformed(
        "a row of words in the middle", with_line(40, "pause,here"), (NAME, "line 40", "'pause'")
    ),
    "22_two_tables": Malformed(
        "two tables with unlike headers below each other",
        (PLAIN + PLAIN.replace("angle_deg", "phi")).encode(),
        (NAME, f"line {READINGS + 2}"),
    ),
    "23_no_load": Malformed(
        "no force, no pressure", PLAIN.encode(), ("table.csv", "force or pressure"), "table.csv"
    ),
    "24_force_changes": Malformed(
        "force changes in one test",
        tidy(40, "a,37,195,1.5"),
        ("all.csv", "'a'", "same in all rows"),
        "all.csv",
    ),
    "25_negative_force": Malformed(
        "a force below zero",
        "\n".join(line.replace(",36,", ",-36,") for line in TIDY).encode(),
        ("all.csv", "'a'", "force_N"),
        "all.csv",
    ),
    "26_direction": Malformed(
        "a direction nobody knows",
        "\n".join(
            ["angle_deg,reading_um,direction", *(f"{5 * k},{k % 5}.5,west" for k in range(72))]
        ).encode(),
        (NAME, "west"),
    ),
    "27_both_directions": Malformed(
        "two directions in one test",
        "\n".join(
            [
                "angle_deg,reading_um,direction",
                *(f"{5 * k},{k % 5}.5,{'CW' if k % 2 else 'CCW'}" for k in range(72)),
            ]
        ).encode(),
        (NAME, "CCW, CW"),
    ),
    "28_two_readings": Malformed(
        "two columns that may be the reading",
        "\n".join(
            ["angle_deg,reading_um,deviation_um", *(f"{5 * k},{k % 5}.5,1.5" for k in range(72))]
        ).encode(),
        (NAME, "line 1", "--reading-column"),
    ),
    "29_no_reading": Malformed(
        "no column that may be the reading",
        "\n".join(["angle_deg,blue", *(f"{5 * k},{k % 5}.5" for k in range(72))]).encode(),
        (NAME, "--reading-column"),
    ),
    "30_no_angle": Malformed(
        "neither angle nor time",
        "\n".join(["blue,reading_um", *(f"{5 * k},{k % 5}.5" for k in range(72))]).encode(),
        (NAME, "--angle-column"),
    ),
    "31_unit": Malformed(
        "readings in bar",
        "\n".join(["angle_deg,reading [bar]", *(f"{5 * k},{k % 5}.5" for k in range(72))]).encode(),
        (NAME, "line 1", "'bar'"),
    ),
    "32_angle_unit": Malformed(
        "angles in mm",
        "\n".join(["angle [mm],reading_um", *(f"{5 * k},{k % 5}.5" for k in range(72))]).encode(),
        (NAME, "line 1", "'mm'"),
    ),
    "33_metres": Malformed(
        "readings of metres",
        "\n".join(["angle_deg,reading (m)", *(f"{5 * k},{k % 5}.5" for k in range(72))]).encode(),
        (NAME, "unit"),
    ),
    "34_column_asked": Malformed(
        "a column asked for that is not there",
        PLAIN.encode(),
        (NAME, "'rho'"),
        NAME,
        ("--reading-column", "rho"),
    ),
    "35_column_number": Malformed(
        "column 9 of 2", PLAIN.encode(), (NAME, "1 to 2"), NAME, ("--reading-column", "9")
    ),
    "36_header_line": Malformed(
        "a header line that is blank",
        PLAIN.encode(),
        (NAME, "line 900"),
        NAME,
        ("--header-line", "900"),
    ),
    "37_binary": Malformed("noise", bytes(range(256)) * 40, (NAME, "line 1", "text")),
    "38_not_utf8": Malformed(
        "Latin letters, read as UTF-8",
        PLAIN.replace("reading_um", "reading µm").encode("latin-1"),
        (NAME, "line 1", "utf-8"),
        NAME,
        ("--encoding", "utf-8"),
    ),
    "39_unknown_encoding": Malformed(
        "an encoding nobody knows", PLAIN.encode(), ("'klingon'",), NAME, ("--encoding", "klingon")
    ),
    "40_odd_utf16": Malformed(
        "UTF-16 that ends in half a sign", PLAIN.encode("utf-16") + b"x", (NAME, "utf-16")
    ),
    "41_long_line": Malformed(
        "a line of 200 000 signs", with_line(40, "1," * 100_000), (NAME, "line 40", "signs")
    ),
    "42_old_workbook": Malformed(
        "half a binary XLS",
        b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(2000),
        ("book.xls", "cut"),
        "book.xls",
    ),
    "43_time_back": Malformed(
        "time runs back",
        log((50, "3.00;1.5")),
        ("log.csv", "time must increase"),
        "log.csv",
        ("--feed-mm-per-min", "2000", "--overshoot-deg", "0"),
    ),
    "44_no_feed": Malformed(
        "a log without its feed", log(), ("log.csv", "--feed-mm-per-min"), "log.csv"
    ),
    "45_short_log": Malformed(
        "a log that ends before half a turn",
        log(),
        ("log.csv", "half a turn"),
        "log.csv",
        ("--feed-mm-per-min", "100"),
    ),
    "46_averaged_arc": Malformed(
        "laps to be averaged that turn back",
        "\n".join(
            [
                "angle_deg,reading_um",
                *(f"{5 * k if k < 160 else 1600 - 5 * k},{k % 5}.5" for k in range(180)),
            ]
        ).encode(),
        (NAME, "one direction"),
        NAME,
        ("--laps", "average"),
    ),
    "47_formula": Malformed(
        "a formula that was never calculated",
        sheet(put("B40", "=B39+1")),
        ("book.xlsx", "'36 N'", "line 40"),
        "book.xlsx",
    ),
    "48_error_cell": Malformed(
        "an error value for an angle",
        sheet(put("A40", "#DIV/0!")),
        ("book.xlsx", "line 40"),
        "book.xlsx",
    ),
    "49_date": Malformed(
        "a number the spreadsheet took for a date",
        sheet(put("B40", date(2026, 3, 4))),
        ("book.xlsx", "line 40", "date"),
        "book.xlsx",
    ),
    "50_truth_value": Malformed(
        "TRUE for a reading",
        sheet(put("B40", True)),
        ("book.xlsx", "line 40", "'True'"),
        "book.xlsx",
    ),
    "51_password": Malformed(
        "a workbook with a password",
        compound("EncryptedPackage", bytes(4096)),
        ("book.xlsx", "password"),
        "book.xlsx",
    ),
    "51_old_password": Malformed(
        "an old one with a password",
        compound("Workbook", LOCKED.ljust(4096, b"\0")),
        ("book.xls", "password"),
        "book.xls",
    ),
    "52_cut_workbook": Malformed(
        "half a workbook", BOOK[: len(BOOK) // 2], ("book.xlsx", "damaged"), "book.xlsx"
    ),
    "52_cut_old_workbook": Malformed(
        "a cut binary XLS",
        compound("Workbook", LOCKED.ljust(4096, b"\0"))[:637],
        ("book.xls", "cut"),
        "book.xls",
    ),
    "53_not_a_workbook": Malformed(
        "a table called .xlsx", PLAIN.encode(), ("book.xlsx", "damaged"), "book.xlsx"
    ),
    "54_other_zip": Malformed(
        "a zip of something else",
        repacked(BOOK, left_out, {"letter.txt": b"x"}),
        ("book.xlsx", "damaged"),
        "book.xlsx",
    ),
    "55_broken_xml": Malformed(
        "a sheet that breaks off",
        repacked(BOOK, half_of_sheet),
        ("book.xlsx", "damaged"),
        "book.xlsx",
    ),
    "56_bomb": Malformed(
        "a part that unpacks to a thousand times its size",
        bomb(BOOK),
        ("book.xlsx", "unpack"),
        "book.xlsx",
    ),
    "59_far_cell": Malformed(
        "a cell in the last corner of a sheet",
        repacked(
            BOOK,
            with_far_cell,
        ),
        ("book.xlsx", "cell XFD1048576"),
        "book.xlsx",
    ),
    "60_sheet_asked": Malformed(
        "a sheet asked for that is not there",
        BOOK,
        ("book.xlsx", "'40 N'"),
        "book.xlsx",
        ("--sheets", "40 N"),
    ),
    "61_sheets_of_text": Malformed(
        "sheets asked of a text file", PLAIN.encode(), (NAME, "workbook"), NAME, ("--sheets", "a")
    ),
    "62_zero_radius": Malformed(
        "a radius of zero", PLAIN.encode(), ("radius_mm",), NAME, ("--radius-mm", "0")
    ),
    "63_header_again": Malformed(
        "half of the header once more below five rows",
        with_line(7, "angle_deg,"),
        (NAME, "line 7"),
    ),
    "64_label_formula": Malformed(
        "a formula for the name of the test, never calculated",
        workbook(lambda book: [book.active.append(row) for row in labelled('="T"&"0"')] and None),
        ("book.xlsx", "line 2", "name their test"),
        "book.xlsx",
    ),
    "65_thousands": Malformed(
        "a force of 1,000 N",
        b"Force: 1,000 N\n" + PLAIN.encode(),
        ("own.csv", "line 1", "--forces-N"),
        "own.csv",
    ),
    "66_not_distances": Malformed(
        "deviations said to be distances",
        PLAIN.encode(),
        (NAME, "--zero"),
        NAME,
        ("--zero", "distance"),
    ),
    "67_other_radius": Malformed(
        "distances 5 mm off the radius",
        "\n".join(
            [
                "angle_deg,reading_mm",
                *(f"{5 * k},{155 + 0.001 * (k % 7):.3f}" for k in range(72)),
                "",
            ]
        ).encode(),
        (NAME, "--radius-mm"),
    ),
    "68_two_senses": Malformed(
        "clockwise above, counter-clockwise in the name",
        b"Direction: CW\n" + PLAIN.encode(),
        ("36N anti-clockwise.csv", "--direction"),
        "36N anti-clockwise.csv",
    ),
}


def main() -> None:
    """Write the folder."""
    if len(sys.argv) != 2:
        sys.exit("give the folder to write")
    for name, case in CASES.items():
        folder = Path(sys.argv[1]) / name
        folder.mkdir(parents=True, exist_ok=True)
        (folder / case.file).write_bytes(case.content)


if __name__ == "__main__":
    main()
