"""``ldbb-bayes machine``: what circular tests show of a machine, before there is a campaign."""

from __future__ import annotations

from typing import Annotated

import typer

from ldbb_bayes.cli.options import ForceOption, JsonOption, OutOption, QuietOption, guarded, three_numbers
from ldbb_bayes.errors import InputError

__all__ = ["ATLAS_FILES", "MACHINE_FILES", "machine"]

ATLAS_FILES = tuple(
    f"{kind}_atlas{plane}.{ending}"
    for kind in ("compliance", "geometric")
    for plane in ("", "_XY", "_YZ", "_ZX")
    for ending in ("png", "svg")
)
MACHINE_FILES = ("machine.json", *ATLAS_FILES)


@guarded
def machine(
    topology: Annotated[str, typer.Argument(help="Joints from workpiece to tool, for example wCAFYXZSt.", metavar="TOPOLOGY")],
    plane: Annotated[str, typer.Option(help="XY, YZ or ZX, or several, comma-separated.")] = "XY",
    frame: Annotated[
        list[str] | None,
        typer.Option(help="Where a joint's frame stands (mm), axes at zero; can be repeated.", metavar="AXIS=X,Y,Z"),
    ] = None,
    centre: Annotated[
        list[str] | None,
        typer.Option(help="Centre of the circles (mm); can be repeated: all of them are measured.", metavar="X,Y,Z"),
    ] = None,
    out: OutOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Which compliances and geometric errors circular tests show, with the pattern of each and the set it stands for.

    Names follow ISO 230-1 and the paper. c = cos θ, s = sin θ; lengths in mm.
    """
    from ldbb_bayes.analysis.machine import describe
    from ldbb_bayes.cli.show import print_json, reading_console, write_atlases
    from ldbb_bayes.files import check_target, staged_folder
    from ldbb_bayes.machine.chain import Circle, Machine
    from ldbb_bayes.report.machine import machine_lines, machine_tables
    from ldbb_bayes.report.plain import json_text

    planes = tuple(part.strip() for part in plane.split(","))
    frames = [_frame(text) for text in frame or ()]
    repeated = next((axis for axis, _ in frames if [name for name, _ in frames].count(axis) > 1), None)
    if repeated:
        raise InputError(f"--frame must name each axis once, got {repeated!r} again. Remove one.")
    own = Machine(topology, planes, dict(frames))
    centres = [three_numbers(text, "--centre") for text in centre or ("0,0,0",)]
    circles = [Circle(centre_mm=at, plane=name) for name in own.planes for at in centres]
    found = describe(own, circles)
    if out is not None:
        check_target(out, force=force, ours=MACHINE_FILES)
        with staged_folder(out, force=force, ours=MACHINE_FILES) as staging:
            (staging / "machine.json").write_text(json_text(found.as_dict()), encoding="utf-8")
            write_atlases(own, circles, staging)
    if as_json:
        print_json(found.as_dict())
        return
    console = reading_console()
    lines = machine_lines(found)
    console.print(lines[0], markup=False)
    for table in machine_tables(found):
        console.print()
        console.print(table)
    console.print()
    for line in lines[1:]:
        console.print(line, markup=False)
    if out is not None and not quiet:
        console.print(f"Written: {out}/machine.json and atlases (PNG and SVG)", markup=False)


def _frame(text: str) -> tuple[str, tuple[float, float, float]]:
    axis, sign, place = text.partition("=")
    if not sign:
        raise InputError(f"--frame must be AXIS=X,Y,Z, got {text!r}. For example Y=0,-200,350.")
    return axis.strip(), three_numbers(place, "--frame")
