"""Field files of several programs: printouts with units below aligned names, and headers of R."""

from __future__ import annotations

import field_files as field
from field_files import Circle, FieldCase

__all__ = ["printout_cases"]


def printout_cases() -> dict[str, FieldCase]:
    """Return the cases of printouts."""
    return {**unit_row_cases(), **dotted_cases()}


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


def dotted_cases() -> dict[str, FieldCase]:
    """Return tables whose headers have dots or words in front of their units."""
    kind = "words in front of units"
    cases = {}
    for number, (header, size) in enumerate(
        {
            "angle.deg,deviation.micro.metres": 1.0,
            "angle_deg,dev_milli_inch": 25.4,
            "angle deg,dev hundred thousandths of an inch": 0.254,
            "angle..deg.,deviation..um..1": 1.0,
        }.items()
    ):
        files = field.texts(header, field.scaled(size))
        cases[f"unit_words_{number}"] = FieldCase(kind, f"a header {header!r}", files)

    def tenths(circle: Circle, k: int) -> list[object]:
        return [f"{10.0 * circle.angle_deg[k]:g}", f"{circle.reading_um[k]:.3f}"]

    cases["unit_words_angle"] = FieldCase(
        kind,
        "angles in tenths of a degree",
        field.texts("angle.tenths.of.a.degree,deviation.um", tenths),
    )

    def row(circle: Circle, k: int) -> list[object]:
        return [f"c{circle.force_N:g}", f"{circle.force_N / 9.80665:.9f}", *field.plain(circle, k)]

    cases["unit_words_kilograms"] = FieldCase(
        kind,
        "a force in kilograms",
        field.tidy("test,load_kg,angle_deg,reading_um", row),
        refusal="got 'kg' in line 1. Correct the header, or give --force-unit",
        step=("--force-unit", "kgf"),
    )
    cases["unit_words_lost_sign"] = FieldCase(
        kind,
        "R's dots in place of a space, a bracket and µ",
        field.texts("angle..deg.,dev...m."),
        refusal="got '?m' in line 1. Correct the header, or give --unit",
        step=("--unit", "um"),
    )
    return cases
