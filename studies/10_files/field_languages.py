"""Field files in further languages, and files whose comments name more than one quantity."""

from __future__ import annotations

import json
from dataclasses import replace

import field_files as field
import numpy as np
from field_files import TRUTH, Circle, FieldCase

__all__ = ["language_cases"]

NEWTONS_PER_KGF = 9.80665


def language_cases() -> dict[str, FieldCase]:
    """Return the cases of files in further languages."""
    return {
        **portuguese_cases(),
        **pandas_cases(),
        **stamp_cases(),
        **log_cases(),
        **channel_cases(),
        **sample_cases(),
        **diameter_cases(),
        **matrix_cases(),
        **glued_cases(),
    }


def glued_cases() -> dict[str, FieldCase]:
    """Return files with units of other languages: without blanks, sexagesimal, and with kG."""
    kind = "units of other languages"
    log = ["注:角度单位0.01度;位移单位0.001微米,杆伸长为正;力单位0.1N", "试验号,角度,位移,力"]
    for number, circle in enumerate(TRUTH, start=1):
        for angle, reading in zip(circle.angle_deg, circle.reading_um, strict=True):
            force = 10.0 * circle.force_N
            log.append(f"{number},{100 * angle:.0f},{1e3 * reading:.0f},{force:.0f}")

    def sexagesimal(circle: Circle, k: int) -> list[object]:
        return [f"{circle.angle_deg[k]:.0f}°00'00''", f"{circle.reading_um[k]:.3f}"]

    polish = {}
    for circle in TRUTH:
        line = f"Siła: {circle.force_N / NEWTONS_PER_KGF:.7f} kG"
        header = "kąt [°];odchyłka [µm]"
        files = field.texts(header, above=line, separator=";", suffix=".txt", circles=[circle])
        polish[f"pomiar {circle.force_N:g}.txt"] = next(iter(files.values()))
    return {
        "units_without_blanks": FieldCase(
            kind,
            "a Chinese remark with the unit of each quantity and no blank",
            {"log.csv": "\n".join([*log, ""]).encode("gb18030")},
        ),
        "sexagesimal_in_japan": FieldCase(
            kind,
            "a header 角度(度分秒)",
            field.texts("角度(度分秒)\t変位(μm)", sexagesimal, separator="\t", suffix=".txt"),
        ),
        "kilogram_force_in_poland": FieldCase(kind, "forces in kG", polish),
    }


def portuguese_cases() -> dict[str, FieldCase]:
    """Return one long table as R writes it in Brazil, without accents."""
    comment = '# gerado por: write.csv2(df, "ensaio.csv", fileEncoding = "latin1")  R 4.3.1'

    def lines(name_of_tests: str) -> list[str]:
        rows = [comment, f'"{name_of_tests}";"forca_kgf";"angulo_gon";"leitura_mm"']
        for number, circle in enumerate(TRUTH, start=1):
            for angle_deg, reading_um in zip(circle.angle_deg, circle.reading_um, strict=True):
                cells = (
                    f"E{number}",
                    f"{circle.force_N / NEWTONS_PER_KGF:.9f}",
                    f"{angle_deg / 0.9:.9f}",
                    f"{reading_um / 1e3:.9f}",
                )
                rows.append(";".join(cells).replace(".", ","))
        return rows

    kind = "tables of another language"
    return {
        "r_in_brazil": FieldCase(
            kind,
            "forca_kgf, angulo_gon and leitura_mm, and the tests in a column ensaio",
            {"ensaio.csv": "\n".join([*lines("ensaio"), ""]).encode("latin1")},
        ),
        "r_in_brazil_without_tests": FieldCase(
            kind,
            "forca_kgf, angulo_gon and leitura_mm, and no column that names the tests",
            {"ensaio.csv": "\n".join([*lines("grupo"), ""]).encode("latin1")},
            refusal="If each value is a test, give --test-column 'forca_kgf'",
            step=("--test-column", "forca_kgf"),
        ),
    }


def pandas_cases() -> dict[str, FieldCase]:
    """Return files in JSON as pandas splits them, with attributes in sentences."""
    files = {}
    for circle in TRUTH:
        attributes = {
            "force_N": circle.force_N,
            "angle": "bar angle in rad, zero on the -X axis, counterclockwise",
            "deviation": "radial deviation in inches, positive when the bar is extended",
        }
        rows = []
        for angle_deg, reading_um in zip(circle.angle_deg, circle.reading_um, strict=True):
            angle_rad = float(np.deg2rad((angle_deg + 180.0) % 360.0))
            rows.append([round(angle_rad, 9), round(float(reading_um) / 25_400.0, 12)])
        content = {"attrs": attributes, "columns": ["theta", "dev"], "data": rows}
        files[f"run_{circle.force_N:g}.json"] = json.dumps(content).encode()
    return {
        "split_by_pandas": FieldCase(
            "JSON and Octave",
            "attributes, names of columns and rows; 'positive when the bar is extended'",
            files,
            note="sign of the reading: 1: a longer bar is positive (line 3",
        )
    }


def stamp_cases() -> dict[str, FieldCase]:
    """Return files that state when they were measured in further languages."""
    lines = {
        "japanese": "測定日時,2026/11/20 14:0{k}:00",
        "chinese": "测量时间:2026年11月20日 下午2时0{k}分",
        "korean": "측정일시: 2026-11-20 오후 2:0{k}",
        "czech": "Datum měření: 20. 11. 2026 14:0{k}",
        "polish": "Data pomiaru: 20.11.2026 godz. 14:0{k}",
        "spanish": "Fecha: 20 de noviembre de 2026, 14:0{k}",
        "portuguese": "Data do ensaio: 20/11/2026 às 14:0{k}",
    }
    cases = {}
    for language, line in lines.items():
        files = {}
        for number, circle in enumerate(TRUTH):
            above = line.format(k=3 * number)
            files |= field.texts("Angle [deg],Reading [um]", above=above, circles=[circle])
        cases[f"stamp_{language}"] = FieldCase(
            "times of tests in other languages",
            f"a line '{line.format(k=0)}'",
            files,
            note="time_s: 100N at 0 min, 300N at 3 min, 600N at 6 min (line 1",
        )
    return cases


def log_cases() -> dict[str, FieldCase]:
    """Return logs over time, with a name of the times and a title that are not known."""
    above = "Gaya: {F} N\nArah: searah jarum jam\n하중 볼바 시험"
    files = field.texts(
        "Zaman [ms];Simpangan [µm]",
        field.logged(lambda seconds: f"{1e3 * seconds:.6f}"),
        above=above,
        separator=";",
    )
    feed = ("--feed-mm-per-min", f"{field.FEED_MM_PER_MIN:g}")
    return {
        "log_by_its_unit": FieldCase(
            "logs over time",
            "times in a column 'Zaman [ms]', forces in lines 'Gaya: 36 N'",
            files,
            refusal="Give --feed-mm-per-min",
            step=feed,
            options=("--direction", "CCW"),
            circles=tuple(replace(circle, direction="CCW") for circle in TRUTH),
        )
    }


def channel_cases() -> dict[str, FieldCase]:
    """Return files in which a line for each channel states its name, unit and convention."""
    above = "\n".join(
        (
            "[Header]",
            "Force_N={F}",
            "Ch1=Angle; Unit=0.001 deg; from +X; positive=CCW",
            "Ch2=dR; Unit=0.00001 mm; dR=R_nominal-R_actual",
            "[Data]",
        )
    )
    files = field.texts(
        "",
        lambda circle, k: [
            f"{1e3 * circle.angle_deg[k]:.0f}",
            f"{-100.0 * circle.reading_um[k]:.3f}",
        ],
        above=above,
        separator="; ",
        suffix=".ini",
    )
    return {
        "channels_with_units": FieldCase(
            "units with factors",
            "lines 'Ch1=Angle; Unit=0.001 deg; …' and 'Ch2=dR; Unit=0.00001 mm; …'",
            files,
            refusal="--header-line where it is another, 0 for none",
            step=("--header-line", "0"),
            note="unit of the angle: 0.001 deg (line 3",
        )
    }


def sample_cases() -> dict[str, FieldCase]:
    """Return a log in numbers of samples and counts, as a control writes it in Spain."""
    above = "\n".join(
        (
            "; Registro del control",
            "; Fuerza radial: {F} N",
            "; Avance: 3000 mm/min   Radio nominal: 150 mm   Sentido: G3",
            "; Período de muestreo: {P} ms; 1 cuenta = 0,001 µm",
        )
    )
    step_s = np.deg2rad(5.0) * field.RADIUS_MM / (field.FEED_MM_PER_MIN / 60.0)
    files = field.texts(
        "MUESTRA;CUENTA",
        lambda circle, k: [k, f"{1e3 * circle.reading_um[k]:.0f}"],
        above=above.replace("{P}", f"{1e3 * step_s:.6f}").replace(
            "3000", str(field.FEED_MM_PER_MIN)
        ),
        separator=";",
    )
    return {
        "samples_and_counts": FieldCase(
            "logs over time",
            "columns MUESTRA and CUENTA; sampling period and size of a count in one line",
            files,
            refusal="Say which: --angle-column, or --time-column",
            step=("--time-column", "MUESTRA", "--reading-column", "CUENTA"),
            note="unit of the time: ",
            circles=tuple(replace(circle, direction="CCW") for circle in TRUTH),
        )
    }


def diameter_cases() -> dict[str, FieldCase]:
    """Return tables whose readings are of the diameter, and not of the radius, in Portuguese."""
    return {
        "diameter_in_portugal": FieldCase(
            "readings of the diameter",
            "a line 'Grandeza;variação do diâmetro (não do raio)'",
            field.texts(
                "Ângulo [°];Leitura [µm]",
                field.scaled(0.5),
                above="Grandeza;variação do diâmetro (não do raio)",
                separator=";",
            ),
            note="reading: half of each, as it is of the diameter",
        )
    }


def matrix_cases() -> dict[str, FieldCase]:
    """Return a printout in which each angle is the sum of a row's and a column's number."""
    files = {}
    for circle in TRUTH:
        lines = [f"Síla: {circle.force_N:g} N", "Úhel [°] = řádek + sloupec", ";0;5;10;15;20;25"]
        for first in range(0, len(circle.angle_deg), 6):
            readings = [f"{reading:.3f}" for reading in circle.reading_um[first : first + 6]]
            lines.append(";".join([f"{circle.angle_deg[first]:g}", *readings]))
        files[f"{circle.force_N:g}N.txt"] = "\n".join([*lines, ""]).encode()
    return {
        "matrix_of_angles": FieldCase(
            "transposed tables",
            "a row for every 30°, a column for every 5°",
            files,
            refusal="Write the angle and the reading of each cell in a line below 'Angle [deg]",
            mended=field.texts("Angle [deg],Reading [um]"),
        )
    }
