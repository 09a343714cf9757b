"""The campaign of the field files in forms that are refused at first, or that a refusal once met
with a step that did not help: columns of tests, other formats than tables, headers in two rows.
"""

from __future__ import annotations

from dataclasses import replace

import field_files as field
from field_files import TRUTH, FieldCase

__all__ = ["step_cases"]

FORCES = ("--forces-N", "100,300,600")
DIRECTIONS = ("CW", "CCW", "CW")
DIRECTED = tuple(
    replace(circle, direction=direction)
    for circle, direction in zip(TRUTH, DIRECTIONS, strict=True)
)


def step_cases() -> dict[str, FieldCase]:
    """Return the cases of refusals whose step reads the file."""
    return {**cases_of_tests()}


def cases_of_tests() -> dict[str, FieldCase]:
    """Return tables of which one column names the tests, or several hold readings, by odd names."""
    kind = "columns of tests by other names"
    series = []
    for circle, name, direction in zip(TRUTH, "abc", DIRECTIONS, strict=True):
        for k in range(len(circle.angle_deg)):
            series.append(",".join([name, direction, *map(str, field.plain(circle, k))]))
    return {
        "readings_by_letters": FieldCase(
            kind,
            "columns A, B, C, three forces given",
            field.wide("Angle [deg];A;B;C", lambda k: [f"{5 * k}", *field.readings_of(k)]),
            options=FORCES,
            refusal="give --reading-column 'A' --reading-column 'B' --reading-column 'C'",
            step=("--reading-column", "A", "--reading-column", "B", "--reading-column", "C"),
        ),
        "readings_by_other_names": FieldCase(
            kind,
            "columns dev, other, third, three forces given",
            field.wide(
                "Angle [deg];dev;other;third", lambda k: [f"{5 * k}", *field.readings_of(k)]
            ),
            options=FORCES,
            refusal="give --reading-column 'dev' --reading-column 'other'",
            step=("--reading-column", "2", "--reading-column", "3", "--reading-column", "4"),
        ),
        "tests_by_another_name": FieldCase(
            kind,
            "a column Block of the tests, three forces given",
            {"all.csv": "\n".join(["Block,direction,Angle [deg],dev", *series, ""]).encode()},
            options=FORCES,
            refusal="If 'Block' names the test of each row, give --test-column 'Block'",
            step=("--test-column", "Block"),
            circles=DIRECTED,
        ),
        "directions_of_tests": FieldCase(
            kind,
            "a column Block of the tests, directions that differ",
            {"all.csv": "\n".join(["Block,direction,Angle [deg],dev", *series, ""]).encode()},
            refusal="Say which column names the test of each row: --test-column 'Block'",
            step=("--test-column", "Block", *FORCES),
            circles=DIRECTED,
        ),
    }
