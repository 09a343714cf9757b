"""Joining of two half circles, which come from separate files, into one circular test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ldbb_bayes.campaign.campaign import CircularTest
from ldbb_bayes.errors import placed
from ldbb_bayes.reading.laps import TURN_DEG
from ldbb_bayes.reading.recording import Recording
from ldbb_bayes.results import Array

__all__ = ["MeasuredArc", "join_half_circles"]

# Shortest arc that counts as a half circle [deg].
_SHORTEST_HALF_DEG = 150.0
# Longest arc that counts as a half circle [deg].
_LONGEST_HALF_DEG = 240.0
# Fields in which the two halves of one test may differ, because each half comes from a separate
# file.
_FIELDS_OF_A_FILE = ("name", "time_s", "temperature_C")
# Largest gap between two half circles of one test, divided by the step from one angle to the next.
_LARGEST_GAP_STEPS = 3.0


@dataclass
class MeasuredArc:
    """Arc of a circular test, from one file: the whole circle or half of it."""

    #: rows of the test in the file, and everything that the file or the user states about the test
    recording: Recording
    #: values that are stated for the circular test, such as its force; the keys are the names of
    #: the fields of a test, such as force_N
    fields: dict[str, Any]
    angle_deg: Array  #: angles of the n readings of the arc [deg], shape (n,)
    reading_um: Array  #: the n readings of the arc [µm], shape (n,)

    def to_test(self) -> CircularTest:
        """Return the circular test that consists of the readings and fields of this arc."""
        with placed(self.recording.sheet.place):
            return CircularTest(angle_deg=self.angle_deg, reading_um=self.reading_um, **self.fields)

    @property
    def step_deg(self) -> float:
        """Median step from the angle of one reading to the angle of the next [deg]."""
        return float(np.median(np.abs(np.diff(self.angle_deg))))

    @property
    def is_half_circle(self) -> bool:
        """Whether the arc is about half a circle: at least 150° and at most 240°."""
        return _SHORTEST_HALF_DEG <= float(np.ptp(self.angle_deg)) <= _LONGEST_HALF_DEG

    @property
    def runs_counter_clockwise(self) -> bool:
        """Whether the bar runs counter-clockwise, that is, whether its angles increase."""
        return bool(self.angle_deg[-1] > self.angle_deg[0])

    def shared_fields(self) -> dict[str, Any]:
        """Return the fields, such as force and plane, in which two halves of one test must agree.

        These are all stated fields except name, time and temperature.
        """
        return {key: value for key, value in self.fields.items() if key not in _FIELDS_OF_A_FILE}


def join_half_circles(arcs: Sequence[MeasuredArc]) -> list[MeasuredArc]:
    """Return the arcs of a campaign, with the two half circles of a test joined into one arc.

    In the returned list, the joined arc takes the place of its first half. If the name of the
    joined arc is also the name of another arc, it is replaced by the name of the first half.
    """
    remaining = list(arcs)
    joined = []
    names_of_first_halves = []
    while remaining:
        arc = remaining.pop(0)
        names_of_first_halves.append(arc.fields["name"])
        for k, other in enumerate(remaining):
            if _are_halves_of_one_test(arc, other):
                del remaining[k]
                arc = _joined_arc(arc, other)
                break
        joined.append(arc)
    names = [arc.fields["name"] for arc in joined]
    for k, name in enumerate(names_of_first_halves):
        if names.count(names[k]) > 1:
            joined[k] = replace(joined[k], fields=joined[k].fields | {"name": name})
    return joined


def _are_halves_of_one_test(first: MeasuredArc, second: MeasuredArc) -> bool:
    """Return whether two arcs are the two halves of one test.

    Both arcs must be half circles with the same direction of travel and the same fields, such as
    force and plane. Together, the two arcs must cover the circle without a large gap.
    """
    if not (first.is_half_circle and second.is_half_circle):
        return False
    if first.shared_fields() != second.shared_fields():
        return False
    if first.runs_counter_clockwise != second.runs_counter_clockwise:
        return False
    angles = np.concatenate([first.angle_deg, second.angle_deg])
    around = np.sort(np.mod(angles, TURN_DEG))
    largest_gap = float(np.diff(np.append(around, around[0] + TURN_DEG)).max())
    return largest_gap <= _LARGEST_GAP_STEPS * max(first.step_deg, second.step_deg)


def _joined_arc(first: MeasuredArc, second: MeasuredArc) -> MeasuredArc:
    """Return the arc of one test that consists of two half circles.

    A multiple of 360° is added to the angles of the second half, so that these angles continue the
    angles of the first half. The name of the test is the common beginning of the names of both
    halves, or else the name of the first half. The start time of the test is the start time of the
    earlier half.
    """
    n_turns = round((first.angle_deg[-1] - second.angle_deg[0]) / TURN_DEG)
    first_name = str(first.fields["name"])
    second_name = str(second.fields["name"])
    name = _common_beginning(first_name, second_name).rstrip(" _-.,+(") or first_name
    first.recording.log.add(
        "",
        "half circles",
        f"{first_name!r} and {second_name!r} are one test",
        "of one force and direction, together they make a circle",
        "setup of a [[test]] in --layout",
    )
    fields = first.fields | {"name": name}
    times_s = [arc.fields["time_s"] for arc in (first, second) if "time_s" in arc.fields]
    if len(times_s) == 2:
        fields["time_s"] = min(times_s)
    return replace(
        first,
        fields=fields,
        angle_deg=np.concatenate([first.angle_deg, second.angle_deg + TURN_DEG * n_turns]),
        reading_um=np.concatenate([first.reading_um, second.reading_um]),
    )


def _common_beginning(first: str, second: str) -> str:
    """Return the longest common beginning of two texts."""
    for k, (letter, other) in enumerate(zip(first, second, strict=False)):
        if letter != other:
            return first[:k]
    return min(first, second, key=len)
