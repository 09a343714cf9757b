"""Field files that are printouts: units below aligned names, and headers of pages."""

from __future__ import annotations

import field_files as field
from field_files import Circle, FieldCase

__all__ = ["printout_cases"]


def printout_cases() -> dict[str, FieldCase]:
    """Return the cases of printouts."""
    return {**unit_row_cases()}


def printed(circle: Circle, k: int) -> list[object]:
    """Return a row whose cells stand below the names of a printout; readings are in mm."""
    angle = f"{circle.angle_deg[k]:g}"
    return [f"{k + 1:3d}   {angle:>5}    {circle.reading_um[k] / 1e3:10.6f}    {24.1:6.1f}"]


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
            lambda circle, k: [circle.angle_deg[k], k + 1, *field.scaled(1e3)(circle, k)[1:], 0.1],
            above="Angle,Index,Deviation,Spread",
        ),
        refusal="Write '-' in place of each unit that is missing in line 2",
        mended=field.texts(
            "deg,-,mm,um",
            lambda circle, k: [circle.angle_deg[k], k + 1, *field.scaled(1e3)(circle, k)[1:], 0.1],
            above="Angle,Index,Deviation,Spread",
        ),
    )
    return cases
