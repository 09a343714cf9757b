"""How a circle is run, its force aside: plane, set-up, centre, radius, direction of travel, clocking of the balls."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import pandas as pd

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.circular_test import CircularTest, Direction
from ldbb_bayes.machine.chain import PLANES

__all__ = ["ALWAYS", "foreseen_by", "frame_of", "place_columns", "place_words", "templates"]

ALWAYS = ("work_ball_deg", "tool_ball_deg", "radius_mm")
_WHERE_DIFFERENT = ("plane", "direction", "setup", "centre_x_mm", "centre_y_mm", "centre_z_mm")


def place_columns(tests: Sequence[CircularTest]) -> tuple[str, ...]:
    """What to say of every test beside its force: clockings and radius, and the rest where it differs."""
    return (*ALWAYS, *(name for name in _WHERE_DIFFERENT if len({getattr(test, name) for test in tests}) > 1))


def frame_of(tests: Sequence[CircularTest], columns: Sequence[str]) -> pd.DataFrame:
    """One row per test: force_N and these columns."""
    rows = [[test.force_N, *("" if (v := getattr(test, name)) is None else v for name in columns)] for test in tests]
    return pd.DataFrame(rows, columns=["force_N", *columns])


def place_words(row: Mapping[str, Any]) -> str:
    """One row of `frame_of`, or a part of it, in words."""
    said = []
    if row.get("plane"):
        said.append(f"plane {row['plane']}")
    if row.get("direction"):
        said.append(str(row["direction"]))
    if row.get("setup"):
        said.append(f"set-up {row['setup']}")
    centre = [f"{name[7]} = {row[name]:g} mm" for name in _WHERE_DIFFERENT[3:] if name in row]
    if centre:
        said.append(f"centre {', '.join(centre)}")
    if "work_ball_deg" in row:
        said.append(f"work ball {row['work_ball_deg']:g}°, tool ball {row['tool_ball_deg']:g}°")
    if "radius_mm" in row:
        said.append(f"R {row['radius_mm']:g} mm")
    return ", ".join(said)


def templates(
    pilot: Campaign, planes: Sequence[str], directions: Sequence[Direction], centres_mm: Sequence[tuple[float, float, float]]
) -> tuple[CircularTest, ...]:
    """A test without readings for every plane, direction and centre; what is left open is as in the pilot.

    In a plane it is like the pilot's test there with the median number of readings. A plane or a centre the pilot lacks is
    another set-up: the work ball is mounted anew.
    """
    found = []
    new = max(test.setup or 1 for test in pilot.tests)
    for plane in planes or tuple(dict.fromkeys(str(test.plane) for test in pilot.tests)):
        own = [test for test in pilot.tests if test.plane == plane]
        ordered = sorted(own or pilot.tests, key=lambda test: len(test.angle_deg))
        plain = ordered[len(ordered) // 2].with_reading_um(None)
        plain = replace(plain, pressure_bar=None, name="", temperature_C=None, time_s=None, plane=plane)
        ways: Sequence[Direction | None] = directions or tuple(dict.fromkeys(test.direction for test in (own or pilot.tests)))
        for x, y, z in centres_mm or (plain.circle.centre_mm,):
            like = replace(plain, centre_x_mm=x, centre_y_mm=y, centre_z_mm=z)
            there = next((test for test in own if test.circle.centre_mm == like.circle.centre_mm), None)
            new += there is None
            like = replace(like, setup=new if there is None else there.setup)
            found += [replace(like, direction=way) for way in ways]
    return tuple(found)


def foreseen_by(pilot: Campaign, candidates: Sequence[CircularTest], judged: Sequence[CircularTest] = ()) -> Campaign:
    """The pilot, knowing of tests of a kind it has not run: what only they can show is in its model.

    Where candidates go both ways in a plane, so do those foreseen: hysteresis then counts for every design. Tests that are only
    judged bring their parameters, not their direction.
    """
    both = {plane for plane in PLANES if {"CW", "CCW"} <= {test.direction for test in candidates if test.plane == plane}}
    possible = [test if str(test.plane) in both else replace(test, direction=None) for test in candidates]
    possible += [replace(test, direction=None) for test in judged]
    centres = [test.circle.centre_mm for test in (*pilot.scope, *possible)]
    offset = any(any(place) for place in (*pilot.frames_mm.values(), *centres))

    def kind(test: CircularTest, *, way: bool) -> tuple[Any, ...]:
        own = (test.plane, test.setup, test.circle.centre_mm, test.radius_mm if offset else None)
        return (*own, test.direction) if way else own

    # A direction counts as foreseen only where it is: the pilot's own tests need not be part of what is analysed.
    known = {kind(test, way=False) for test in pilot.scope} | {kind(test, way=True) for test in pilot.foreseen}
    further = {kind(test, way=test.direction is not None): test for test in reversed(possible)}
    new = [test for key, test in further.items() if key not in known]
    return replace(pilot, foreseen=(*pilot.foreseen, *new)) if new else pilot
