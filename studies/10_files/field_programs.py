"""The campaign of the field files as other languages and programs write it: encodings, headers in
other languages, several tables in one file, R, LabVIEW, and marks between thousands.
"""

from __future__ import annotations

from functools import cache

import field_files as field
import numpy as np
from field_files import ANGLES_DEG, TRUTH, Circle, FieldCase

__all__ = ["program_cases"]

PAGE_LINES = 24


@cache
def program_cases() -> dict[str, FieldCase]:
    """Return the cases of other languages and programs."""
    return {
        **encoding_cases(),
        **language_cases(),
        **side_by_side_cases(),
        **stacked_cases(),
        **program_file_cases(),
        **number_cases(),
    }


def encoding_cases() -> dict[str, FieldCase]:
    kind = "encodings"
    headers = {
        "gb18030": ("gb18030", "角度(°),测量值(μm)"),
        "gbk_place": ("gbk", "角度（度）,偏差（μm）"),
        "big5": ("big5", "角度(度),位移(μm)"),
        "shift_jis": ("cp932", "角度[度],変位[μm]"),
        "euc_jp": ("euc_jp", "角度[度],測定値[μm]"),
        "euc_kr": ("euc_kr", "각도(도),편차(μm)"),
        "cyrillic_windows": ("cp1251", "Угол [°];Отклонение [мкм]"),
        "cyrillic_koi8": ("koi8_r", "Угол [град];Отклонение [мкм]"),
        "greek": ("cp1253", "Γωνία [°];Απόκλιση [µm]"),
        "central_europe": ("cp1250", "Úhel [°];Odchylka [µm]"),
        "macintosh": ("mac_roman", "Winkel [°];Abweichung [µm]"),
        "dos": ("cp850", "Winkel [°];Abweichung [µm]"),
        "western": ("cp1252", "Angle [°];Écart [µm]"),
        "utf_16": ("utf-16", "Winkel [°];Abweichung [µm]"),
    }
    cases = {}
    for name, (encoding, header) in headers.items():
        separator = ";" if ";" in header else ","
        files = field.texts(header, separator=separator, encoding=encoding)
        cases[f"encoding_{name}"] = FieldCase(kind, f"a text in {encoding}: {header}", files)
    return cases


def language_cases() -> dict[str, FieldCase]:
    kind = "other languages"
    headers = {
        "french": "Angle [°];Écart [µm]",
        "italian": "Angolo [°];Scostamento [µm]",
        "spanish": "Ángulo [°];Desviación [µm]",
        "portuguese": "Ângulo [°];Desvio [µm]",
        "dutch": "Hoek [°];Afwijking [µm]",
        "swedish": "Vinkel [°];Avvikelse [µm]",
        "polish": "Kąt [°];Odchyłka [µm]",
        "czech": "Úhel [°];Odchylka [µm]",
        "finnish": "Kulma [°];Poikkeama [µm]",
        "hungarian": "Szög [°];Eltérés [µm]",
        "turkish": "Açı [°];Sapma [µm]",
        "danish": "Vinkel [°];Afvigelse [µm]",
        "romanian": "Unghi [°];Abatere [µm]",
        "russian": "Угол [°];Отклонение [мкм]",
        "greek": "Γωνία [°];Απόκλιση [µm]",
        "japanese": "角度 [°];変位 [µm]",
        "chinese": "角度 [°];偏差 [µm]",
        "korean": "각도 [°];편차 [µm]",
        "unknown_words": "Nurk [°];Hälve [µm]",
    }
    return {
        f"language_{name}": FieldCase(
            kind, f"a header '{header}'", field.texts(header, separator=";")
        )
        for name, header in headers.items()
    }


def pair(circle: Circle, k: int) -> list[str]:
    return [f"{circle.angle_deg[k]:g}", f"{circle.reading_um[k]:.3f}"]


def pairs(k: int) -> list[str]:
    cells = []
    for circle in TRUTH:
        cells += pair(circle, k)
    return cells


def one_angle(k: int) -> list[str]:
    return [f"{ANGLES_DEG[k]:g}", *field.readings_of(k)]


def side_by_side_cases() -> dict[str, FieldCase]:
    kind = "tables beside each other"
    forces = ("--forces-N", "100,300,600")
    return {
        "pairs_named": FieldCase(
            kind,
            "an angle of its own for every force, each begins elsewhere",
            field.wide(
                "Angle A [deg];100 N [um];Angle B [deg];300 N [um];Angle C [deg];600 N [um]",
                field.shifted_pairs,
            ),
        ),
        "pairs_with_load_in_angle": FieldCase(
            kind,
            "the force in both headers of a pair",
            field.wide(
                "100 N Angle [°];100 N Reading [µm];300 N Angle [°];300 N Reading [µm];"
                "600 N Angle [°];600 N Reading [µm]",
                pairs,
            ),
        ),
        "pairs_repeated": FieldCase(
            kind,
            "repeated names, forces in the line above",
            field.wide(
                ";".join(["Angle [deg];Reading [um]"] * 3), pairs, above="100 N;;300 N;;600 N;"
            ),
        ),
        "pairs_repeated_without_forces": FieldCase(
            kind,
            "repeated names, no forces",
            field.wide(";".join(["Angle [deg];Reading [um]"] * 3), pairs),
            refusal="--forces-N",
            step=forces,
        ),
        "forces_as_headers": FieldCase(
            kind,
            "forces as headers",
            field.wide("Angle [deg];100 N;300 N;600 N", one_angle),
            options=("--unit", "um"),
        ),
        "forces_as_headers_with_unit": FieldCase(
            kind,
            "forces as headers, with a unit",
            field.wide("Angle [deg];100 N [um];300 N [um];600 N [um]", one_angle),
        ),
        "bare_forces_as_headers": FieldCase(
            kind,
            "forces without a unit as headers",
            field.wide("Angle [deg];100;300;600", one_angle),
            refusal="--forces-N",
            step=("--unit", "um", *forces),
        ),
        "runs_as_headers": FieldCase(
            kind,
            "headers Run 1, Run 2, Run 3",
            field.wide("Angle [deg];Run 1 [um];Run 2 [um];Run 3 [um]", one_angle),
            refusal="--forces-N",
            step=forces,
        ),
        "readings_repeated": FieldCase(
            kind,
            "one angle, a repeated name of readings",
            field.wide("Angle [deg];Reading [um];Reading [um];Reading [um]", one_angle),
            refusal="--reading-column",
            step=(
                "--reading-column",
                "2",
                "--reading-column",
                "3",
                "--reading-column",
                "4",
                *forces,
            ),
        ),
    }


def with_lines(page_rows: int, lines: list[str], header: str) -> dict[str, bytes]:
    """Return files in which lines and the header stand again after some rows."""
    files = {}
    for name, content in field.texts(header).items():
        rows = content.decode().splitlines()
        pages = []
        for k, row in enumerate(rows):
            if k > 1 and (k - 1) % page_rows == 0:
                page = str(1 + (k - 1) // page_rows)
                pages += [line.replace("{p}", page) for line in lines]
            pages.append(row)
        files[name] = "\n".join([*pages, ""]).encode()
    return files


def both_ways() -> tuple[Circle, ...]:
    """Return each circle counter-clockwise and, half a micrometre larger, clockwise."""
    circles = []
    for circle in TRUTH:
        circles.append(Circle(circle.force_N, ANGLES_DEG, circle.reading_um, direction="CCW"))
        larger = np.round(circle.reading_um + 0.5, 3)
        circles.append(Circle(circle.force_N, ANGLES_DEG, larger, direction="CW"))
    return tuple(circles)


def two_ways(lines: dict[str, str], gap: str = "\n") -> dict[str, bytes]:
    """Return files with a table for each direction; ``lines`` stand above the tables."""
    files: dict[str, bytes] = {}
    for circle in both_ways():
        name = f"{circle.force_N:g}N.csv"
        rows = [lines[circle.direction or ""], "Angle [deg],Reading [um]"]
        order = range(len(ANGLES_DEG))
        if circle.direction == "CW":
            order = range(len(ANGLES_DEG) - 1, -1, -1)
        rows += [",".join(pair(circle, k)) for k in order]
        files[name] = files.get(name, b"") + "\n".join([*rows, gap]).encode()
    return files


def stacked_cases() -> dict[str, FieldCase]:
    kind = "tables below each other"
    header = "Angle [deg],Reading [um]"
    english = {"CCW": "Direction: CCW", "CW": "Direction: CW"}
    german = {"CCW": "Richtung: gegen den Uhrzeigersinn", "CW": "Richtung: im Uhrzeigersinn"}
    return {
        "header_every_page": FieldCase(
            kind,
            "the header again on every page",
            with_lines(PAGE_LINES, [header], header),
            note="repeated headers: 2",
        ),
        "header_and_page_number": FieldCase(
            kind,
            "page number and header on every page",
            with_lines(PAGE_LINES, ["", "Page {p} of 3", header], header),
            note="repeated headers: 2",
        ),
        "header_and_german_page": FieldCase(
            kind,
            "Seite and header on every page",
            with_lines(PAGE_LINES, ["Seite {p}", header], header),
            note="repeated headers: 2",
        ),
        "two_ways": FieldCase(
            kind, "two tables, CCW and CW", two_ways(english), circles=both_ways()
        ),
        "two_ways_german": FieldCase(
            kind, "two tables, in German", two_ways(german), circles=both_ways()
        ),
        "two_ways_without_gap": FieldCase(
            kind,
            "two tables without a line between",
            two_ways(english, gap=""),
            circles=both_ways(),
        ),
    }


def labview(with_times: bool) -> dict[str, bytes]:
    """Return files of LabVIEW over time, with or without a column of times."""
    step = float(np.deg2rad(5.0) * field.RADIUS_MM / (field.FEED_MM_PER_MIN / 60.0))
    files = {}
    for circle in TRUTH:
        lines = ["LabVIEW Measurement\t", "Writer_Version\t2", "Separator\tTab"]
        lines += ["Decimal_Separator\t,", f"X_Columns\t{'One' if with_times else 'No'}"]
        lines += ["Operator\tlab3", "***End_of_Header***\t", "\t", "Channels\t1\t"]
        lines += ["Samples\t72\t", "Y_Unit_Label\tMikrometer\t", "X_Dimension\tTime\t"]
        lines += ["X0\t0,0000E+0\t", f"Delta_X\t{step:.6f}\t".replace(".", ",")]
        lines += ["***End_of_Header***\t\t", "X_Value\tUntitled\tComment"]
        for k, reading in enumerate(circle.reading_um):
            time = f"{k * step:.6f}" if with_times else ""
            lines.append(f"{time}\t{reading:.6f}".replace(".", ","))
        files[f"{circle.force_N:g}N.lvm"] = "\n".join([*lines, ""]).encode()
    return files


def r_table(with_quotes: bool, separator: str) -> dict[str, bytes]:
    """Return tables as write.table of R writes them, with names of the rows."""
    mark = '"' if with_quotes else ""
    files = {}
    for circle in TRUTH:
        lines = [f"{mark}angle_deg{mark}{separator}{mark}reading_um{mark}"]
        for k in range(len(ANGLES_DEG)):
            lines.append(separator.join([f"{mark}{k + 1}{mark}", *pair(circle, k)]))
        files[f"{circle.force_N:g}N.txt"] = "\n".join([*lines, ""]).encode()
    return files


def program_file_cases() -> dict[str, FieldCase]:
    feed = "Give --feed-mm-per-min"
    feed_option = ("--feed-mm-per-min", "2000")
    counted = field.texts(",Angle [deg],Reading [um]", lambda circle, k: [str(k), *pair(circle, k)])
    return {
        "labview_times": FieldCase(
            "LabVIEW", "a column of times", labview(True), refusal=feed, step=feed_option
        ),
        "labview_steps": FieldCase(
            "LabVIEW",
            "a step of time in the header",
            labview(False),
            refusal=feed,
            step=feed_option,
        ),
        "r_quoted": FieldCase("R", "row names in quotes", r_table(True, " ")),
        "r_plain": FieldCase("R", "row names without quotes", r_table(False, " ")),
        "r_tabs": FieldCase("R", "row names, tabs", r_table(False, "\t")),
        "pandas_index": FieldCase("pandas", "an index without a name", counted),
    }


def grouped(mark: str) -> field.Row:
    """Return rows of readings in nm with a mark between thousands."""

    def row(circle: Circle, k: int) -> list[object]:
        nanometres = f"{1e3 * circle.reading_um[k]:,.0f}".replace(",", mark)
        return [f"{circle.angle_deg[k]:g}", nanometres]

    return row


def number_cases() -> dict[str, FieldCase]:
    kind = "marks between thousands"
    marks = {
        "apostrophe": "'",
        "swiss": "’",
        "underscore": "_",
        "blank": " ",
        "narrow_blank": "\u202f",
    }
    cases = {
        f"thousands_{name}": FieldCase(
            kind,
            f"{mark!r} between thousands, readings in nm",
            field.texts("Angle [deg];Reading [nm]", grouped(mark), separator=";"),
        )
        for name, mark in marks.items()
    }
    cases["numbers_and_texts"] = FieldCase(
        "workbooks",
        "every third number a text",
        field.sheets(change=field.numbers_as_text),
        refusal="turn them into numbers in the spreadsheet program",
        mended=field.sheets(),
    )
    return cases
