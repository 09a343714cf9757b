"""Command ``ldbb-bayes machine``: lists the parameters that circular tests can determine.

It also shows the pattern of each parameter, which is the change of the reading around the circle
per unit of the parameter.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

import ldbb_bayes as lb
from ldbb_bayes.cli import arguments
from ldbb_bayes.cli.options import Kind, command, group, options_of
from ldbb_bayes.cli.output import figure_files, write_files
from ldbb_bayes.cli.values import pairs_in, points_in

__all__ = ["ATLAS_FILES", "machine", "write_atlases"]

# Names of all files that `write_atlases` can write. The figures in them show how the reading around
# a circle changes with each parameter.
ATLAS_FILES = figure_files(
    [f"compliance_atlas{suffix}" for suffix in ("", "_XY", "_YZ", "_ZX")]
    + [f"geometric_atlas{suffix}" for suffix in ("", "_XY", "_YZ", "_ZX")]
)


def write_atlases(machine: lb.Machine, circles: Sequence[lb.machine.Circle], folder: Path) -> None:
    """Write figures of the patterns of compliances and geometric errors, for every plane.

    The pattern of a parameter is the change of the reading around a circle per unit of the
    parameter. In every plane, the patterns are computed for the first of ``circles`` in this plane.

    Parameters
    ----------
    machine
        The machine.
    circles
        Circles, at least one in every plane of the machine.
    folder
        Existing folder for the files.
    """
    first_circle: dict[str, lb.machine.Circle] = {}
    for circle in circles:
        first_circle.setdefault(circle.plane, circle)
    for plane in machine.planes:
        suffix = f"_{plane}" if len(machine.planes) > 1 else ""
        circle = first_circle[plane]
        figures = {
            f"compliance_atlas{suffix}": partial(lb.figures.compliance_atlas, machine, circle),
            f"geometric_atlas{suffix}": partial(lb.figures.geometric_atlas, machine, circle),
        }
        write_files(folder, {}, figures)


def _read_frames(entries: list[str], flag: str) -> dict[str, tuple[float, ...]]:
    """Return the positions of the joints' coordinate frames, typed as AXIS=X,Y,Z [mm].

    The result is a dictionary; its keys are the letters of the joints' axes. ``flag`` names the
    option in error messages.
    """
    pairs = pairs_in(entries, flag, "AXIS=X,Y,Z")
    points = points_in(pairs.values(), flag)
    return dict(zip(pairs, points, strict=True))


_FRAMES = Kind(list[str], _read_frames, "AXIS=X,Y,Z")


@command
def machine(
    topology: Annotated[
        str,
        typer.Argument(
            help="Joints from workpiece to tool, for example wCAFYXZSt.", metavar="TOPOLOGY"
        ),
    ],
    output: arguments.OutputOptions,
    settings: Annotated[dict[str, Any], group(**options_of("machine", frames=_FRAMES))],
) -> None:
    """Show which compliances and geometric errors circular tests detect, and the pattern of each.

    Names follow ISO 230-1 and the paper that defines the model. Parameters that no circle can tell
    apart are listed under the name of one of them. A pattern is the change of the reading per unit
    of the parameter. It is written with c = cos θ and s = sin θ, where θ is the angle of the bar
    from the first axis of the plane, and with lengths in mm.
    """
    # The module that writes the texts of this command takes a long time to load. It is therefore
    # imported here, and not at the top of the file.
    from ldbb_bayes.report import machine_text

    chain = lb.Machine(topology, settings["plane"], settings.get("frames_mm", {}))
    circles = []
    for plane in chain.planes:
        for centre in settings.get("centre", [(0.0, 0.0, 0.0)]):
            circles.append(lb.machine.Circle(centre_mm=centre, plane=plane))
    description = lb.describe_machine(chain, circles)
    record = {"schema": 1, **description.as_dict()}
    output.check("machine.json", *ATLAS_FILES)
    output.deliver(
        record,
        machine_text.parts_of(description),
        {"machine.json": record},
        write_more=partial(write_atlases, chain, circles),
    )
