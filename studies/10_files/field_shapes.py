"""Field files with missing readings, angles in degrees, minutes and seconds, and other shapes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import field_files as field
import numpy as np
from field_files import TRUTH, Circle, FieldCase

__all__ = ["shape_cases"]

HEADER = "Angle [deg],Reading [um]"
# Rows of each circle whose reading is missing.
MISSING_ROWS = (7, 8, 40)
INCOMPLETE = tuple(
    replace(
        circle,
        angle_deg=np.delete(circle.angle_deg, MISSING_ROWS),
        reading_um=np.delete(circle.reading_um, MISSING_ROWS),
    )
    for circle in TRUTH
)


def shape_cases() -> dict[str, FieldCase]:
    """Return the cases of missing readings and of tables in other shapes."""
    return {**missing_cases(), **sexagesimal_cases(), **share_cases(), **wide_cases()}


def with_missing(words: Mapping[int, str]) -> field.Row:
    """Return rows in which words stand in place of some readings; the keys are the rows."""

    def row(circle: Circle, k: int) -> list[object]:
        cells = field.plain(circle, k)
        if k in words:
            cells[1] = words[k]
        return cells

    return row


def missing_cases() -> dict[str, FieldCase]:
    kind = "missing readings"
    cases = {}
    for name, word in {"nan": "NaN", "na": "NA", "empty": "", "dash": "---"}.items():
        cases[f"missing_{name}"] = FieldCase(
            kind,
            f"readings that are missing: {word!r}",
            field.texts(HEADER, with_missing(dict.fromkeys(MISSING_ROWS, word))),
            note="missing readings: 3 rows left out",
            circles=INCOMPLETE,
        )

    def wide_row(k: int) -> list[str]:
        readings = field.readings_of(k)
        if k in MISSING_ROWS:
            readings = ["NaN"] * len(readings)
        return [f"{5 * k}", *readings]

    cases["missing_in_wide_table"] = FieldCase(
        kind,
        "readings that are missing in a wide table",
        field.wide("Angle [deg];100 N [um];300 N [um];600 N [um]", wide_row),
        note="missing readings: 3 rows left out",
        circles=INCOMPLETE,
    )
    return cases


def in_seconds(form: str) -> field.Row:
    """Return rows whose angles are in degrees, minutes and seconds, as ``form`` writes them."""

    def row(circle: Circle, k: int) -> list[object]:
        seconds = round(3600.0 * float(circle.angle_deg[k]))
        angle = form.format(d=seconds // 3600, m=seconds // 60 % 60, s=seconds % 60)
        return [angle, field.plain(circle, k)[1]]

    return row


def sexagesimal_cases() -> dict[str, FieldCase]:
    kind = "angles in degrees, minutes and seconds"
    note = "unit of the angle: arcsec, degrees and minutes included"
    uneven = tuple(
        replace(circle, angle_deg=circle.angle_deg + np.round(1815.0 / 3600.0, 9))
        for circle in TRUTH
    )
    cases = {}
    written = (
        ("Angle;Reading [um]", "{d}°{m:02d}'{s:02d}\""),
        ("Angle (D-M-S);Reading [um]", "{d}° {m:02d}' {s:02d}\""),
        ("Angle [deg];Reading [um]", "{d}°{m:02d}′{s:02d}.0″"),
        ("Angle (DMS);Reading [um]", "{d}-{m:02d}-{s:02d}"),
        ("Angle (deg:min:sec);Reading [um]", "{d}:{m:02d}:{s:02d}"),
    )
    for number, (header, form) in enumerate(written):
        cases[f"sexagesimal_{number}"] = FieldCase(
            kind,
            f"angles such as {form.format(d=12, m=30, s=15)} below {header.split(';')[0]!r}",
            field.texts(header, in_seconds(form), separator=";", circles=uneven),
            note=note,
            circles=uneven,
        )
    form = "{d}:{m:02d}:{s:02d}"
    cases["sexagesimal_asked"] = FieldCase(
        kind,
        "angles such as 12:30:15, nothing says so",
        field.texts("Angle;Reading [um]", in_seconds(form), separator=";", circles=uneven),
        refusal="put (D-M-S) behind its name in the header",
        mended=field.texts(
            "Angle (D-M-S);Reading [um]", in_seconds(form), separator=";", circles=uneven
        ),
        circles=uneven,
    )
    cases["sexagesimal_packed"] = FieldCase(
        kind,
        "angles such as 12.3015 below 'Angle (DMS)'",
        field.texts("Angle (DMS);Reading [um]", in_seconds("{d}.{m:02d}{s:02d}"), separator=";"),
        refusal="or write them as in 12°30'15\"",
        mended=field.texts(
            "Angle (DMS);Reading [um]", in_seconds("{d}°{m:02d}'{s:02d}\""), separator=";"
        ),
    )
    return cases


def share_cases() -> dict[str, FieldCase]:
    """Return readings in tenths, which are 0.0001 inch in shops of the United States."""
    cases = {}
    for number, unit in enumerate(("tenths", "tenth")):
        cases[f"tenths_{number}"] = FieldCase(
            "units that are shares",
            f"readings in {unit}",
            field.texts(f"Angle [deg],Dev ({unit})", field.scaled(2.54)),
            refusal="--unit ('0.1 mil' for tenths of a thou, which are 0.0001 inch",
            step=("--unit", "0.1 mil"),
        )
    return cases


def _vectors_of_matlab() -> str:
    """Return a program of MATLAB that defines the angles and readings of three circles."""
    lines = ["% theta: deg;  dL: um, bar elongation positive"]
    for number, circle in enumerate(TRUTH, start=1):
        lines.append(f"run({number}).F = {circle.force_N:g}; % N")
        for name, numbers in {"theta": circle.angle_deg, "dL": circle.reading_um}.items():
            lines.append(f"run({number}).{name} = [ ...")
            for first in range(0, len(numbers), 12):
                lines.append(" ".join(f"{x:g}" for x in numbers[first : first + 12]) + " ...")
            lines.append("];")
    return "\n".join(lines)


def wide_cases() -> dict[str, FieldCase]:
    """Return tables with a row for each circle, and with several lines above their columns."""
    angles = ";".join(f"{angle:g}" for angle in TRUTH[0].angle_deg)
    named_angles = ";".join(f"a{angle:03.0f}" for angle in TRUTH[0].angle_deg)
    rows = []
    for circle in TRUTH:
        readings = ";".join(f"{reading:.3f}" for reading in circle.reading_um)
        rows.append(f"{circle.force_N:g};ok;{readings}")
    mended = field.wide(
        "Angle [deg];100 N [um];300 N [um];600 N [um]",
        field.angle_and_readings,
    )
    cases = {}
    for name, header in {"numbers": angles, "names": named_angles}.items():
        content = "\n".join([f"Force [N];Remark;{header}", *rows, ""]).encode()
        cases[f"transposed_{name}"] = FieldCase(
            "transposed tables",
            f"a row for each circle, angles in the header as {header.split(';')[1]!r}",
            {"all.csv": content},
            refusal="Transpose the table: the angles in a column 'Angle [deg]'",
            mended=mended,
        )
    for name, labels in {
        "loads": ("100 N", "300 N", "600 N"),
        "words": ("力 100 N", "力 300 N", "力 600 N"),
    }.items():
        rows = [f"角度 (°);{angles}"]
        for label, circle in zip(labels, TRUTH, strict=True):
            rows.append(";".join([label, *(f"{reading:.3f}" for reading in circle.reading_um)]))
        cases[f"on_its_side_{name}"] = FieldCase(
            "transposed tables",
            f"a row for each circle that begins with its load, as in {labels[0]!r}",
            {"all.csv": "\n".join(["单位: μm", *rows, ""]).encode()},
            note="table on its side: the table is turned: its rows are read as columns (line 2",
        )
    cases["vectors_of_matlab"] = FieldCase(
        "programs of MATLAB",
        "vectors in lines that go on after three dots",
        {"ldbb.m": _vectors_of_matlab().encode()},
        refusal="In MATLAB, for each circle: writematrix([run(1).theta(:) run(1).dL(:)]",
        mended={name: content.lstrip(b"\n") for name, content in field.texts("").items()},
    )
    lines = (
        ";K1;K2;K3\nKraft [daN];10;30;60\nEbene;XY;XY;XY\nBahn;G3;G3;G3",
        "Ebene;XY;XY;XY\nDirection;CCW;CCW;CCW\nForce;100 N;300 N;600 N",
    )
    for number, above in enumerate(lines):
        cases[f"lines_above_columns_{number}"] = FieldCase(
            "lines of forces, planes and directions above the columns",
            f"{above.count(chr(10)) + 1} lines above the header",
            field.wide("Winkel [°];µm;µm;µm", field.angle_and_readings, above=above),
            circles=tuple(replace(circle, direction="CCW") for circle in TRUTH),
        )
    return {**cases, **numbered_pair_cases(), **level_cases(), **conversion_cases()}


def level_cases() -> dict[str, FieldCase]:
    """Return pairs of columns below rows with their forces, names and units."""
    header = "Kraft [N];100;100;300;300;600;600"
    names = ";".join(["Größe", *["Winkel", "Messwert"] * 3])
    units = ";".join(["Einheit", *["°", "µm"] * 3])

    def row(k: int) -> list[str]:
        cells = [f"{k}"]
        for reading in field.readings_of(k):
            cells += [f"{5 * k}", reading]
        return cells

    case = FieldCase(
        "headers of several levels",
        "rows of forces, names and units above pairs of columns",
        field.wide("Punkt;;;;;;", row, above=f"{header}\n{names}\n{units}"),
        note="columns not used: Punkt",
    )
    return {"levels_of_pairs": case}


def conversion_cases() -> dict[str, FieldCase]:
    """Return a table whose first rows state a gain and an offset of its readings."""

    def row(circle: Circle, k: int) -> list[object]:
        angle, reading = field.plain(circle, k)
        return [k + 1, angle, reading]

    header = "Channel,Angle [deg],Reading [um]"
    return {
        "gain_rows": FieldCase(
            "rows that are no readings",
            "rows 'Gain' and 'Offset' above the readings",
            field.texts(f"{header}\nGain,1,1\nOffset,0,0", row),
            refusal="Apply to the readings what these rows state, and remove the rows: 2, 3",
            mended=field.texts(header, row),
        )
    }


def numbered_pair_cases() -> dict[str, FieldCase]:
    """Return tables beside each other, behind a column that numbers the rows."""
    of_readings = "No.;Angle [deg];100 N [um];Angle [deg];300 N [um];Angle [deg];600 N [um]"
    of_angles = (
        "No.;Angle 100 N [deg];Dev [um];Angle 300 N [deg];Dev [um];Angle 600 N [deg];Dev [um]"
    )
    plain = "No.;Angle [deg];Dev [um];Angle [deg];Dev [um];Angle [deg];Dev [um]"
    headers = {
        "loads of the readings": ("", of_readings),
        "loads of the angles": ("", of_angles),
        "loads in the row above": (";100 N;;300 N;;600 N;", plain),
    }

    def row(k: int) -> list[str]:
        cells = [f"{k + 1}"]
        for reading in field.readings_of(k):
            cells += [f"{5 * k}", reading]
        return cells

    cases = {}
    for number, (where, (above, header)) in enumerate(headers.items()):
        cases[f"numbered_pairs_{number}"] = FieldCase(
            "pairs of columns behind the number of the row",
            f"three pairs of columns, {where}",
            field.wide(header, row, above=above),
            note="columns not used: No.",
        )
    return cases
