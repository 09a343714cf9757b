"""Renishaw's ball-bar files (.b5r): what their XML says of a circular test, as a record beside a campaign.

Renishaw publishes no description. What is read is what two public readers of such files, and a generator of examples, agree on:
under TEST_DOCUMENT the attributes NAME of TEST_SPEC and MACHINE_TESTED, MANUFACTURER and MODEL of INSTRUMENT, and TEST_PLANE of
PLANE; the texts of NOMINAL_LENGTH [mm], PROGRAMMED_FEEDRATE [mm/min], OPERATOR, SERIAL_NUMBER, LAST_CALIBRATED, DATE_STARTED and
DATE_COMPLETED (20260401-080000); and anywhere FEATURE elements, a number each with NAME and the unit DT, of a BALLBAR_RUN with
its RUN_DIRECTION or of an ANALYSIS with its NAME. The encoding of the trace is described nowhere, so it is not read.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from ldbb_bayes.errors import placed, require
from ldbb_bayes.files import bytes_of, xml_of
from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.result import Result, Shown

__all__ = ["SUFFIX", "BallbarFeature", "BallbarRecord", "read_b5r"]

SUFFIX = ".b5r"
_LARGEST_BYTES = 64 * 2**20
# By the file's unit ours, and of one in ours; other units stay as the file names them.
_UNITS = {
    "UT_LENGTH_UM": ("µm", 1.0), "UT_LENGTH_MM": ("µm", 1e3), "UT_LENGTH_M": ("µm", 1e6), "UT_SQUARENESS": ("µm/m", 1.0),
    "UT_SCALE_ERROR": ("µm/m", 1.0), "UT_FEEDRATE": ("mm/min", 1.0), "UT_SPEED": ("mm/s", 1.0), "UT_ANGLE": ("°", 1.0),
    "UT_SERVO_MISMATCH": ("ms", 1.0), "UT_PERCENT": ("%", 1.0), "UT_RANKING": ("", 1.0),
}  # fmt: skip


@dataclass(frozen=True)
class BallbarFeature(Shown):
    """One number of Renishaw's own analysis."""

    name: str  #: AF_CIRCULARITY
    value: float  #: in ``unit``
    unit: str  #: µm, µm/m, mm/min, …; as the file names it where that is not known
    run: str = ""  #: CW or CCW; empty: not of one run
    analysis: str = ""  #: RENISHAW_DIAGNOSTICS; empty: of none


@dataclass(frozen=True)
class BallbarRecord(Result):
    """What a .b5r file says of a circular test of an unloaded ball bar, empty or None where it says nothing."""

    file: str  #: its name
    test: str  #: name of the test
    machine: str  #: name of the machine
    operator: str  #: who measured
    ball_bar: str  #: maker and model
    serial_number: str  #: of the ball bar
    calibrated: str  #: when the ball bar was; times are ISO 8601 where the file has 20260401-080000, else as they stand
    started: str  #: when the test began
    completed: str  #: when it ended
    plane: str  #: XY, YZ or ZX
    radius_mm: float | None  #: nominal length of the bar
    feed_mm_per_min: float | None  #: as programmed
    features: tuple[BallbarFeature, ...]  #: in the order of the file


def read_b5r(path: str | os.PathLike[str]) -> BallbarRecord:
    """Return header and features of a Renishaw ball-bar file.

    InputError for what is no XML, has a document type, or holds no feature.
    """
    path = Path(path)
    raw = bytes_of(path, _LARGEST_BYTES, what="a ball-bar file (XML)")
    with placed(path):
        root = xml_of(raw, "a .b5r file as the ball-bar software wrote it")
        features = tuple(_features(root, "", ""))
        got = f"got <{_tag(root)[:80]}> without. Analyse the test in its software, and save it"
        require(features, f"a ball-bar file must hold FEATURE elements, {got}.")
        first = {_tag(element): element for element in reversed(list(root.iter()))}

        def said(tag: str, *attributes: str) -> str:
            element = first.get(tag, root)
            texts = [element.get(key) for key in attributes] if attributes else [element.text if tag in first else ""]
            return " ".join(" ".join(text or "" for text in texts).split())[:200]

        plane = said("PLANE", "TEST_PLANE").upper()
        plane = next((own for own in PLANES if sorted(own) == sorted(plane)), plane)
        return BallbarRecord(
            path.name, said("TEST_SPEC", "NAME"), said("MACHINE_TESTED", "NAME"), said("OPERATOR"),
            said("INSTRUMENT", "MANUFACTURER", "MODEL"), said("SERIAL_NUMBER"), _time(said("LAST_CALIBRATED")),
            _time(said("DATE_STARTED")), _time(said("DATE_COMPLETED")), plane, _number(said("NOMINAL_LENGTH")),
            _number(said("PROGRAMMED_FEEDRATE")), features,
        )  # fmt: skip


def _features(holder: ElementTree.Element, run: str, analysis: str) -> Iterator[BallbarFeature]:
    """Those that are a finite number, with the run or analysis that holds them."""
    for element in holder:
        tag = _tag(element)
        value = _number(element.text or "")
        if tag == "FEATURE" and value is not None:
            named = element.get("DT", "")
            unit, one = _UNITS.get(named, (named, 1.0))
            yield BallbarFeature(element.get("NAME", ""), value * one, unit, run, analysis)
        direction = next((own.text or "" for own in element if _tag(own) == "RUN_DIRECTION"), run)
        yield from _features(element, direction.strip().upper(), element.get("NAME", "") if tag == "ANALYSIS" else analysis)


def _tag(element: ElementTree.Element) -> str:
    return element.tag.rpartition("}")[2].upper()


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _time(text: str) -> str:
    return re.sub(r"^(\d{4})(\d\d)(\d\d)-(\d\d)(\d\d)(\d\d)$", r"\1-\2-\3T\4:\5:\6", text)
