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
    return {**missing_cases()}


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
            told="missing readings: 3 rows left out",
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
        told="missing readings: 3 rows left out",
        circles=INCOMPLETE,
    )
    return cases
