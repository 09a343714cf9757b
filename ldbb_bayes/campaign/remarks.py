"""Remarks on a campaign or on one of its tests: their kinds, and what their sentences contain."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

__all__ = ["Remark", "RemarkKind", "RemarkList"]


class RemarkKind(StrEnum):
    """Kinds of remarks in the preview of a campaign.

    A remark concerns one test, the campaign as a whole, or an assumption of a fit.
    """

    TRAVEL = "travel"
    ARC = "arc"
    GAP = "gap"
    OPEN = "open trace"
    UNIT = "unit"
    FORCE_LAW = "force law"
    SPIKES = "spikes"
    STEP = "step"
    ONE_LEVEL = "one force level"
    TWO_LEVELS = "two force levels"
    COPY = "copy"
    NOT_RUN = "not run"
    MODEL_FILE = "model file"
    SIGN = "sign"
    MIRRORED = "sign of one test"
    ONE_WAY = "one way"
    PLACES = "places of one set-up"
    ONE_BAR = "one bar certificate"
    ONE_TRACE = "one trace of a ball"
    MACHINE = "machine"
    FRAMES = "frames"
    CENTRES = "centres"
    SETUPS = "set-ups"
    BOTH_WAYS = "both ways"
    DRIFT = "drift"
    TEMPERATURES = "temperatures"
    READINGS = "readings"
    MOUNT = "mount"
    FORCES = "forces"
    REFERENCE = "reference force"
    BALLS = "balls"
    NOT_MODELLED = "not modelled"


@dataclass(frozen=True)
class Remark:
    """Remark on a test or campaign in a preview.

    ``kind`` is the kind of the remark. ``values`` holds the numbers and names that are inserted
    into the sentence of the remark; the keys are the names of the placeholders in the sentence.
    """

    kind: RemarkKind
    values: dict[str, Any]


class RemarkList:
    """Remarks on what looks odd in a campaign, collected while the campaign is examined."""

    def __init__(self) -> None:
        """Create an empty list, to which remarks on a campaign can be added."""
        self._remarks: list[Remark] = []

    def add(self, kind: RemarkKind, **values: Any) -> None:
        """Add a remark on a campaign or test to the preview.

        ``kind`` is the kind of the remark, and ``values`` are the numbers and names that the
        sentence of the remark will contain.
        """
        self._remarks.append(Remark(kind, values))

    def add_if(self, condition: object, kind: RemarkKind, **values: Any) -> None:
        """Add a remark, as `add` does, if ``condition`` is true."""
        if condition:
            self.add(kind, **values)

    def as_tuple(self) -> tuple[Remark, ...]:
        """Return all remarks on the campaign and its tests that have been collected so far."""
        return tuple(self._remarks)
