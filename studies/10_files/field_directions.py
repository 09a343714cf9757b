"""Field files whose lines or names state the direction of travel, or the plane, in other words."""

from __future__ import annotations

from dataclasses import replace

import field_files as field
from field_files import FEED_MM_PER_MIN, RADIUS_MM, TRUTH, Circle, FieldCase

__all__ = ["direction_cases"]

FEED = f"Feed: {FEED_MM_PER_MIN:g} mm/min"
LOG_HEADER = "Time [s],Reading [um]"
CLOCKWISE = tuple(replace(circle, direction="CW") for circle in TRUTH)
# The three circles, run in turn clockwise and counter-clockwise.
IN_TURN = tuple(
    replace(circle, direction=direction)
    for circle, direction in zip(TRUTH, ("CW", "CCW", "CW"), strict=True)
)
SWAPPED = "if from +X towards +Z, give --plane ZX --angle-zero +X --angle-sense CW"
WHICH_DIRECTION = "Say which: --direction CW or CCW"


def direction_cases() -> dict[str, FieldCase]:
    """Return the cases of directions of travel in words."""
    return {
        **column_cases(),
        **log_direction_cases(),
        **log_programme_cases(),
        **shared_line_cases(),
        **plane_cases(),
    }


def turned_in_turn(words: tuple[str, str]) -> dict[str, bytes]:
    """Return one table of all circles with these words for CW and CCW in a column Richtung."""
    lines = ["Versuch;Zeitstempel;Last_N;Richtung;Winkel_deg;Anzeige_um"]
    for number, circle in enumerate(IN_TURN):
        word = words[("CW", "CCW").index(str(circle.direction))]
        order = 1 if circle.direction == "CCW" else -1
        for k in range(len(circle.angle_deg))[::order]:
            cells = [f"V{number}", f"20.11.2026 08:{10 * number:02}:00", f"{circle.force_N:g}"]
            cells += [word, *(str(cell) for cell in field.plain(circle, k))]
            lines.append(";".join(cells))
    return {"export.csv": "\n".join([*lines, ""]).encode()}


def column_cases() -> dict[str, FieldCase]:
    """Return tables with a column of directions in letters, or in words that nobody knows."""
    kind = "columns of directions"
    cases = {}
    for clockwise_word, other_word in (("RL", "LL"), ("R", "L"), ("Rechtslauf", "Linkslauf")):
        cases[f"direction_column_{clockwise_word}"] = FieldCase(
            kind,
            f"{clockwise_word} and {other_word}",
            turned_in_turn((clockwise_word, other_word)),
            note="time_s: V0 at 0 min",
            circles=IN_TURN,
        )
    cases["direction_column_unknown"] = FieldCase(
        kind,
        "hin and her",
        turned_in_turn(("hin", "her")),
        refusal="Write CW or CCW into the column",
        mended=turned_in_turn(("CW", "CCW")),
        circles=IN_TURN,
    )
    return cases


def clockwise(circle: Circle, k: int) -> list[object]:
    """Return a row over time of a circle that was run clockwise from +X."""
    time, _ = field.logged(field.seconds_text)(circle, k)
    return [time, f"{circle.reading_um[-k]:.3f}"]


def clockwise_from_y(circle: Circle, k: int) -> list[object]:
    """Return a row over time of a circle that was run clockwise from +Y."""
    quarter = len(circle.angle_deg) // 4
    time, _ = clockwise(circle, k)
    return [time, f"{circle.reading_um[quarter - k]:.3f}"]


def log_programme_cases() -> dict[str, FieldCase]:
    """Return logs over time of circles that a programme starts at +Y, clockwise, with its feed."""
    kind = "directions of travel in words"
    radius = f"{RADIUS_MM:g}"
    feed = f"F{FEED_MM_PER_MIN:g}"
    programmes = {
        "centre": f"G2 X0 Y{radius} I0 J-{radius} {feed}",
        "centre_alone": f"N20 G1 X0 Y{radius} {feed}\nN30 G2 J-{radius}",
        "absolute": f"G90.1\nG1 X0 Y{radius} {feed}\nG2 X0 Y{radius} I0 J0",
        "pole": f"L X+0 Y+{radius} R0 {feed}\nCC X+0 Y+0\nC X+0 Y+{radius} DR-",
        "pole_alone": f"12 CC X+0 Y+0\n13 L X+0 Y+{radius} {feed}\n14 CP IPA-360 DR-",
        "with_ways": f"Radius {radius} mm\nG2 X2 I1 J0\nG2 J-{radius} {feed}\nG2 X4 I2 J0",
    }
    cases = {}
    for name, programme in programmes.items():
        cases[f"log_programme_{name}"] = FieldCase(
            kind,
            f"a log with lines '{programme.replace(chr(10), ', ')}'",
            field.texts(LOG_HEADER, clockwise_from_y, above=programme),
            note="start_deg: 90°",
            circles=CLOCKWISE,
        )
    for name, block in (("radius", f"G02 X=0 Y={radius} CR={radius}"), ("pole", "CP IPA-360 DR-")):
        cases[f"log_programme_asked_{name}"] = FieldCase(
            kind,
            f"a log with a line '{block} {feed}', which does not say where the circle starts",
            field.texts(LOG_HEADER, clockwise_from_y, above=f"{block} {feed}"),
            refusal="a log over time must say where its circle starts",
            step=("--start-deg", "90"),
            circles=CLOCKWISE,
        )
    return cases


def log_direction_cases() -> dict[str, FieldCase]:
    """Return logs over time whose angles follow from the direction that a line or name states."""
    kind = "directions of travel in words"
    cases = {}
    lines = ("Motion: G02", "Direction: G2", "Sens : horaire", "Rotation: CW", "G17 G2")
    for number, line in enumerate(lines):
        cases[f"direction_log_{number}"] = FieldCase(
            kind,
            f"a log with a line '{line}'",
            field.texts(LOG_HEADER, clockwise, above=f"{FEED}\n{line}"),
            note="direction: CW",
            circles=CLOCKWISE,
        )
    cases["direction_log_start"] = FieldCase(
        kind,
        "a log with a line 'G2, start at Y+'",
        field.texts(LOG_HEADER, clockwise_from_y, above=f"{FEED}\nG2, start at Y+"),
        note="direction: CW",
        circles=CLOCKWISE,
    )
    named = field.texts(LOG_HEADER, clockwise, above=FEED)
    cases["direction_log_name"] = FieldCase(
        kind,
        "logs whose names end in _G2",
        {name.replace(".csv", "_G2.csv"): content for name, content in named.items()},
        note="direction: CW",
        circles=CLOCKWISE,
    )
    asked = ("Direction: -1", "Sense of rotation: negative", "Sens: négatif", "Travel: reverse")
    for number, line in enumerate(asked):
        cases[f"direction_log_asked_{number}"] = FieldCase(
            kind,
            f"a log with a line '{line}'",
            field.texts(LOG_HEADER, clockwise, above=f"{FEED}\n{line}"),
            refusal=WHICH_DIRECTION,
            step=("--direction", "cw"),
            circles=CLOCKWISE,
        )
    blocks = f"G3 X0 Y0 R{RADIUS_MM:g}\nG2 I-{RADIUS_MM:g}"
    cases["direction_log_blocks"] = FieldCase(
        kind,
        "a log with blocks of G-code for circles in both directions",
        field.texts(LOG_HEADER, clockwise, above=f"{FEED}\n{blocks}"),
        refusal=WHICH_DIRECTION,
        step=("--direction", "clockwise"),
        circles=CLOCKWISE,
    )
    cases["direction_log_balls"] = FieldCase(
        kind,
        "a log with a line 'Balls: grade G3'",
        field.texts(LOG_HEADER, field.logged(field.seconds_text), above=f"{FEED}\nBalls: grade G3"),
        note="direction: CCW (none stated",
    )
    return cases


def shared_line_cases() -> dict[str, FieldCase]:
    """Return lines that state the sense of the angles beside a direction of travel or a feed."""
    kind = "angles beside other statements"
    lines = (
        "Angles clockwise from +Y; motion: CW",
        "Motion: CW; angles clockwise from +Y",
        "Vorschub 2000 mm/min; Winkel ab +Y im Uhrzeigersinn",
        "Feed 2000 mm/min, angles clockwise from +Y",
    )
    cases = {}
    for number, line in enumerate(lines):
        cases[f"angle_shared_{number}"] = FieldCase(
            kind,
            f"a line '{line}'",
            field.texts("Angle [deg],Reading [um]", field.turned(90.0, -1), above=line),
            note="angle: from +Y, CW",
        )
    return cases


def plane_cases() -> dict[str, FieldCase]:
    """Return planes by words of G-code, and planes whose letters are swapped."""
    kind = "planes in other words"
    header = "Angle [deg],Reading [um]"
    from_x_to_z = field.turned(90.0, -1)
    cases = {
        "plane_g18_in_name": FieldCase(
            kind,
            "files whose names begin with G18",
            {f"G18_{name}": content for name, content in field.texts(header).items()},
            note="plane: ZX (its name",
        ),
        "plane_swapped_in_name": FieldCase(
            kind,
            "files whose names begin with XZ",
            {f"XZ_{name}": content for name, content in field.texts(header).items()},
            refusal=SWAPPED,
            step=("--plane", "ZX"),
        ),
        "plane_swapped_column": FieldCase(
            kind,
            "a column of planes XZ",
            field.texts(f"{header},Plane", lambda c, k: [*from_x_to_z(c, k), "XZ"]),
            refusal=SWAPPED,
            step=("--plane", "ZX", "--angle-zero", "+X", "--angle-sense", "CW"),
        ),
        "plane_swapped_log": FieldCase(
            kind,
            "a log with a line 'Plane: XZ'",
            field.texts(LOG_HEADER, clockwise_from_y, above=f"{FEED}\nPlane: XZ"),
            refusal="Give --plane ZX, with --start-deg and --direction as they are in ZX",
            step=("--plane", "ZX", "--start-deg", "90", "--direction", "CW"),
            circles=CLOCKWISE,
        ),
        "plane_not_understood": FieldCase(
            kind,
            "a line 'Plane: horizontal'",
            field.texts(header, above="Plane: horizontal"),
            note="plane: XY (line 1 says 'Plane: horizontal', not understood",
        ),
    }
    for number, line in enumerate(("Plane G18", "Ebene: G18", "G18", "Plan : ZX")):
        cases[f"plane_line_{number}"] = FieldCase(
            kind, f"a line '{line}'", field.texts(header, above=line), note="plane: ZX (line 1"
        )
    for number, line in enumerate(("Plane: XZ", "XZ plane, programmed in G18")):
        cases[f"plane_swapped_{number}"] = FieldCase(
            kind,
            f"a line '{line}'",
            field.texts(header, from_x_to_z, above=line),
            refusal=SWAPPED,
            step=("--plane", "ZX", "--angle-zero", "+X", "--angle-sense", "CW"),
        )
    return cases
