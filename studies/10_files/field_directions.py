"""Field files whose lines or names state the direction of travel, or the plane, in other words."""

from __future__ import annotations

from dataclasses import replace

import field_files as field
from field_files import FEED_MM_PER_MIN, RADIUS_MM, TRUTH, Circle, FieldCase

__all__ = ["direction_cases"]

FEED = f"Feed: {FEED_MM_PER_MIN:g} mm/min"
LOG_HEADER = "Time [s],Reading [um]"
CLOCKWISE = tuple(replace(circle, direction="CW") for circle in TRUTH)
WHICH_DIRECTION = "Say which: --direction CW or CCW"


def direction_cases() -> dict[str, FieldCase]:
    """Return the cases of directions of travel in words."""
    return {**log_direction_cases(), **shared_line_cases()}


def clockwise(circle: Circle, k: int) -> list[object]:
    """Return a row over time of a circle that was run clockwise from +X."""
    time, _ = field.logged(lambda seconds: f"{seconds:.4f}")(circle, k)
    return [time, f"{circle.reading_um[-k]:.3f}"]


def clockwise_from_y(circle: Circle, k: int) -> list[object]:
    """Return a row over time of a circle that was run clockwise from +Y."""
    quarter = len(circle.angle_deg) // 4
    time, _ = clockwise(circle, k)
    return [time, f"{circle.reading_um[quarter - k]:.3f}"]


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
            told="direction: CW",
            circles=CLOCKWISE,
        )
    cases["direction_log_start"] = FieldCase(
        kind,
        "a log with a line 'G2, start at Y+'",
        field.texts(LOG_HEADER, clockwise_from_y, above=f"{FEED}\nG2, start at Y+"),
        told="direction: CW",
        circles=CLOCKWISE,
    )
    named = field.texts(LOG_HEADER, clockwise, above=FEED)
    cases["direction_log_name"] = FieldCase(
        kind,
        "logs whose names end in _G2",
        {name.replace(".csv", "_G2.csv"): content for name, content in named.items()},
        told="direction: CW",
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
        field.texts(
            LOG_HEADER, field.logged(lambda s: f"{s:.4f}"), above=f"{FEED}\nBalls: grade G3"
        ),
        told="direction: CCW (none stated",
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
            told="angle: from +Y, CW",
        )
    return cases
