"""What XML from elsewhere says of instruments and tests; it is not trusted: document types, and
with them entities, are refused.

Digital calibration certificates (DCC, schema 2 and 3) of bar, force device and balls: what states a
field of `Instrument`.

Renishaw's ball-bar files (.b5r), as records beside a campaign. Renishaw publishes no description.
What is read is what two public readers of such files, and a generator of examples, agree on: under
TEST_DOCUMENT the attributes NAME of TEST_SPEC and MACHINE_TESTED, MANUFACTURER and MODEL of
INSTRUMENT, and TEST_PLANE of PLANE; the texts of NOMINAL_LENGTH [mm], PROGRAMMED_FEEDRATE [mm/min],
OPERATOR, SERIAL_NUMBER, LAST_CALIBRATED, DATE_STARTED and DATE_COMPLETED (20260401-080000); and
anywhere FEATURE elements, a number each with NAME and the unit DT, of a BALLBAR_RUN with its
RUN_DIRECTION or of an ANALYSIS with its NAME. The encoding of the trace is described nowhere, so it
is not read.
"""

from __future__ import annotations

import math
import os
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from ldbb_bayes.errors import InputError, placed, require
from ldbb_bayes.files import bytes_of, xml_of
from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.reading.headers import WORDS
from ldbb_bayes.results import Result, Shown

__all__ = [
    "SUFFIX",
    "BallbarFeature",
    "BallbarRecord",
    "CalibrationCertificate",
    "CertifiedQuantity",
    "read_b5r",
    "read_dcc",
]

_DCC = "{https://ptb.de/dcc}"
_SI = "{https://ptb.de/si}"
SUFFIX = ".b5r"
_LARGEST_BYTES = 32 * 2**20
_LARGEST_RECORD = 64 * 2**20
_LISTED = 12
_ASIDE = (
    "usedMethods",
    "usedSoftware",
    "measuringEquipments",
    "influenceConditions",
    "measurementMetaData",
)
# Element of an uncertainty and of the number in it, of D-SI 2 and 1.
_EXPANDED = {"expandedMU": "valueExpandedMU", "expandedUnc": "uncertainty"}
_STANDARD = {
    "standardMU": "valueStandardMU",
    "coverageIntervalMU": "valueStandardMU",
    "coverageInterval": "standardUnc",
}
# Prefixes; units with factor and dimension; what a quantity is, by words of its name or refType,
# the first that fits.
_PREFIXES = WORDS["dcc"]["prefixes"]
_UNITS = WORDS["dcc"]["units"]
_ROLES = WORDS["dcc"]["roles"]
# Units of a ball-bar file, each with its size and name here; others stay as the file names them.
_B5R_UNITS = WORDS["b5r"]["units"]


@dataclass(frozen=True)
class CertifiedQuantity:
    """One number of a certificate, as it stands there: value and expanded uncertainty U with its
    coverage factor k, in a D-SI unit; ``within`` are the names of what holds it, outermost
    first."""

    name: str
    ref_type: str
    within: tuple[str, ...]
    value: float
    unit: str
    U: float | None
    k: float | None
    coverage: float | None

    @property
    def title(self) -> str:
        """Its name, or that of what holds it."""
        return next(
            (text for text in (self.name, *reversed(self.within), self.ref_type) if text), "no name"
        )

    @property
    def role(self) -> str:
        """What it is by its own name, else by the names of what holds it; empty: nothing for a bar,
        a force device or a ball."""
        texts = (f"{self.name} {self.ref_type}".lower(), " ".join(self.within).lower())
        return next(
            (role for text in texts for role, words in _ROLES.items() if re.search(words, text)), ""
        )

    def numbers(self, factor: float = 1.0) -> tuple[float, float]:
        """Return value and U (k = 2; 0 where it states none) in a unit that is ``factor`` of the
        SI's; `InputError` for a unit that is not known and for a U without coverage factor."""
        scale = _scale(self.unit)
        units = r"\micro\metre, \milli\metre, \newton, \percent"
        if scale is None:
            raise InputError(
                f"the unit of {self.title!r} must be of D-SI (like {units}), got {self.unit!r}."
                " Correct it in a copy."
            )
        require(
            self.U is None or self.k,
            f"{self.title!r} must have a coverage factor k beside U, got none. State U by hand.",
        )
        U = 0.0 if self.U is None else 2.0 * self.U / float(self.k or 1.0)
        return _plain(self.value * scale[0] / factor), _plain(U * scale[0] / factor)


@dataclass(frozen=True)
class CalibrationCertificate(Shown):
    """The numbers of a digital calibration certificate and its identifier. What it says of an
    instrument comes with the keys that campaign.toml has for it; `InputError` where it says nothing
    of the kind."""

    path: Path
    identifier: str
    quantities: tuple[CertifiedQuantity, ...]

    def fields(self, kind: str) -> dict[str, Any]:
        """Return what it says of a bar, a force device (force) or a ball; the message names the
        file."""
        with placed(self.path):
            return {"bar": self.bar, "force": self.force, "ball": self.ball}[kind]()

    def bar(self) -> dict[str, Any]:
        """Return length_error_um and U_um: an error of indication as it is; a deviation from the
        nominal length, or a length beside its nominal one, with the other sign, as a longer bar
        reads too small."""
        of = self._having("m")
        nominal = 0.0
        role = next((role for role in ("indication", "deviation", "length") if role in of), "")
        if not role or (role == "length" and "nominal" not in of):
            raise self._nothing("the error of a bar's length", "length_error_um and U_um")
        one = self._only(of[role])
        value, U = one.numbers(1e-6)
        require(U, f"{one.title!r} must have an uncertainty, got none. Give U_um by hand.")
        if role == "length":
            nominal, _ = self._only(of["nominal"]).numbers(1e-6)
        error = value if role == "indication" else _plain(nominal - value)
        return {"length_error_um": error, "U_um": U, "certificate": self._label(one)}

    def force(self) -> dict[str, Any]:
        """Return those of U_percent, of the gain or else of the largest force, and
        linearity_percent that it states."""
        gains = self._having("N/bar").get("gain", [])
        forces = self._having("N").get("force", [])
        stated = dict[str, Any]()
        largest = [self._only(gains)] if gains else sorted(forces, key=_size)[-1:]
        used = [one for one in largest if one.U and one.value]
        for value, U in (one.numbers() for one in used):
            stated["U_percent"] = _plain(100.0 * U / abs(value))
        for one in sorted(
            [*self._having("").get("linearity", []), *self._having("N").get("linearity", [])],
            key=_size,
        )[-1:]:
            whole = 1.0 if _dimension(one) == "" else max(map(_size, forces), default=0.0)
            require(
                whole,
                f"{one.title!r} in newtons must come with forces, got none. Give linearity_percent"
                " by hand.",
            )
            stated["linearity_percent"] = _plain(100.0 * _size(one) / whole)
            used.append(one)
        if not stated:
            raise self._nothing(
                "the U of a force device, or its linearity", "U_percent and linearity_percent"
            )
        return stated | {"certificate": self._label(*used)}

    def ball(self) -> dict[str, Any]:
        """Return sphericity_um: the largest deviation of form, with its U on top."""
        bounds = {sum(one.numbers(1e-6)): one for one in self._having("m").get("form", [])}
        if not bounds:
            raise self._nothing("the form of a ball", "sphericity_um")
        return {
            "sphericity_um": _plain(max(bounds)),
            "certificate": self._label(bounds[max(bounds)]),
        }

    def _having(self, dimension: str) -> dict[str, list[CertifiedQuantity]]:
        """Quantities of a dimension, or of a unit that is not known, by what they are."""
        found: dict[str, list[CertifiedQuantity]] = {}
        for own in self.quantities:
            if own.role and _dimension(own) in (dimension, None):
                found.setdefault(own.role, []).append(own)
        return found

    def _only(self, found: Sequence[CertifiedQuantity]) -> CertifiedQuantity:
        require(
            len(found) == 1,
            f"{_listed(found[:1])} must stand there once, got {_listed(found)}. Give the right one"
            " by hand.",
        )
        return found[0]

    def _label(self, *used: CertifiedQuantity) -> str:
        holders = (
            next((f"{name}: " for name in reversed(one.within) if one.name and "_" not in name), "")
            for one in used
        )
        text = (
            f"{self.path.name}, DCC {self.identifier}:"
            f" {', '.join(h + one.title for h, one in zip(holders, used, strict=True))}"
        )
        return "".join(sign if sign.isprintable() else " " for sign in text)[:200]

    def _nothing(self, what: str, keys: str) -> InputError:
        got = _listed(self.quantities) or "no number at all"
        return InputError(
            f"the DCC must state {what} by a name or refType, got {got}. Give {keys} by hand."
        )


def read_dcc(path: str | os.PathLike[str]) -> CalibrationCertificate:
    """Return the numbers among the results of a digital calibration certificate; `InputError` for
    what is none."""
    path = Path(path)
    raw = bytes_of(path, _LARGEST_BYTES, what="a digital calibration certificate (XML)")
    with placed(path):
        root = xml_of(raw, "the DCC itself, an .xml file")
        got = (
            f"got the root element {root.tag[:80]!r}. Give the DCC of the laboratory, not its PDF"
            " or another XML"
        )
        is_one = root.tag == f"{_DCC}digitalCalibrationCertificate"
        require(
            is_one,
            "the file must be a digital calibration certificate (namespace https://ptb.de/dcc),"
            f" {got}.",
        )
        identifier = (
            root.findtext(f"{_DCC}administrativeData/{_DCC}coreData/{_DCC}uniqueIdentifier")
            or "of no identifier"
        )
        results = root.find(f"{_DCC}measurementResults")
        return CalibrationCertificate(
            path,
            " ".join(identifier.split()),
            () if results is None else tuple(_quantities(results, ())),
        )


def _quantities(
    holder: ElementTree.Element, within: tuple[str, ...]
) -> Iterator[CertifiedQuantity]:
    for element in holder:
        texts = (content.text or "" for content in element.iterfind(f"{_DCC}name/{_DCC}content"))
        own = (
            " / ".join(dict.fromkeys(" ".join(text.split()) for text in texts if text.strip())),
            element.get("refType", ""),
        )
        if element.tag == f"{_DCC}quantity":
            for path in ("real", "realListXMLList", "hybrid/*"):
                for number in element.iterfind(_SI + path):
                    yield from (
                        CertifiedQuantity(*own, within, *numbers)
                        for numbers in _numbers(number, own[0])
                    )
        elif element.tag.removeprefix(_DCC) not in _ASIDE:
            yield from _quantities(element, within + tuple(filter(None, own)))


def _numbers(element: ElementTree.Element, name: str) -> Iterator[tuple[Any, ...]]:
    """Value, unit, U, k and probability of si:real or of each in si:realListXMLList; a list of one
    holds for all."""

    def words(owner: ElementTree.Element, tag: str) -> list[str]:
        return (owner.findtext(_SI + tag) or owner.findtext(f"{_SI}{tag}XMLList") or "").split()

    def numbers(owner: ElementTree.Element, tag: str) -> list[float]:
        try:
            return list(map(float, words(owner, tag)))
        except ValueError:
            raise InputError(
                f"{name}: {tag} must be numbers, got {words(owner, tag)[0]!r}. Use a decimal point."
            ) from None

    spread: tuple[list[float], ...] = ([], [], [])
    for own in element.iter():
        tag = own.tag.removeprefix(_SI).removesuffix("XMLList")
        if tag in _EXPANDED:
            spread = (
                numbers(own, _EXPANDED[tag]),
                numbers(own, "coverageFactor"),
                numbers(own, "coverageProbability"),
            )
        elif tag in _STANDARD:
            spread = (numbers(own, _STANDARD[tag]), [1.0], [])
    every: tuple[list[Any], ...] = (words(element, "unit"), *spread)
    columns = (own if len(own) > 1 else repeat(own[0] if own else None) for own in every)
    entries = zip(numbers(element, "value"), *columns, strict=False)
    return (entry for entry in entries if math.isfinite(entry[0]))


def _scale(unit: str | None) -> tuple[float, str] | None:
    r"""Factor to the SI and dimension (m, N, N/bar, nothing) of a D-SI unit such as
    \newton\bar\tothe{-1}; None: not known."""
    factor = 1.0
    prefix = 1.0
    sign = 1
    powers = Counter[str]()
    if re.fullmatch(r"(\\[a-zA-Z]+(\{[-+]?\d\})?)+", unit or "") is None:
        return None
    for name, power in re.findall(r"\\([a-zA-Z]+)(?:\\tothe\{([-+]?\d)\})?", unit or ""):
        if name in _UNITS:
            exponent = sign * int(power or 1)
            factor *= (prefix * _UNITS[name][0]) ** exponent
            powers[_UNITS[name][1]] += exponent
            prefix = 1.0
            sign = 1
        elif name in _PREFIXES:
            prefix = _PREFIXES[name]
        elif name == "per":
            sign = -1
        else:
            return None
    left = [
        ("" if power > 0 else "/") + name + str(abs(power)).strip("1")
        for name, power in powers.items()
        if name and power
    ]
    return factor, "".join(sorted(left, key=lambda part: part[0] == "/"))


def _dimension(one: CertifiedQuantity) -> str | None:
    scale = _scale(one.unit)
    return None if scale is None else scale[1]


def _size(one: CertifiedQuantity) -> float:
    return abs(one.numbers()[0])


def _listed(found: Sequence[CertifiedQuantity]) -> str:
    texts = list(dict.fromkeys(f"{one.title!r} ({one.unit})" for one in found))
    return ", ".join(texts[:_LISTED]) + (
        f" and {len(texts) - _LISTED} more" if len(texts) > _LISTED else ""
    )


def _plain(number: float) -> float:
    """Without the last digits that the conversion of units left."""
    return float(f"{number:.12g}")


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
    """What a .b5r file says of a circular test of an unloaded ball bar, empty or None where it says
    nothing."""

    file: str  #: its name
    test: str  #: name of the test
    machine: str  #: name of the machine
    operator: str  #: who measured
    ball_bar: str  #: maker and model
    serial_number: str  #: of the ball bar
    #: when the ball bar was; times are ISO 8601 where the file has 20260401-080000, else as they
    #: stand
    calibrated: str
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
    raw = bytes_of(path, _LARGEST_RECORD, what="a ball-bar file (XML)")
    with placed(path):
        root = xml_of(raw, "a .b5r file as the ball-bar software wrote it")
        features = tuple(_features(root, "", ""))
        got = f"got <{_tag(root)[:80]}> without. Analyse the test in its software, and save it"
        require(features, f"a ball-bar file must hold FEATURE elements, {got}.")
        first = {_tag(element): element for element in reversed(list(root.iter()))}

        def said(tag: str, *attributes: str) -> str:
            element = first.get(tag, root)
            texts = (
                [element.get(key) for key in attributes]
                if attributes
                else [element.text if tag in first else ""]
            )
            return " ".join(" ".join(text or "" for text in texts).split())[:200]

        plane = said("PLANE", "TEST_PLANE").upper()
        plane = next((own for own in PLANES if sorted(own) == sorted(plane)), plane)
        return BallbarRecord(
            path.name,
            said("TEST_SPEC", "NAME"),
            said("MACHINE_TESTED", "NAME"),
            said("OPERATOR"),
            said("INSTRUMENT", "MANUFACTURER", "MODEL"),
            said("SERIAL_NUMBER"),
            _time(said("LAST_CALIBRATED")),
            _time(said("DATE_STARTED")),
            _time(said("DATE_COMPLETED")),
            plane,
            _number(said("NOMINAL_LENGTH")),
            _number(said("PROGRAMMED_FEEDRATE")),
            features,
        )


def _features(holder: ElementTree.Element, run: str, analysis: str) -> Iterator[BallbarFeature]:
    """Those that are a finite number, with the run or analysis that holds them."""
    for element in holder:
        tag = _tag(element)
        value = _number(element.text or "")
        if tag == "FEATURE" and value is not None:
            named = element.get("DT", "")
            one, unit = _B5R_UNITS.get(named, (1.0, named))
            yield BallbarFeature(element.get("NAME", ""), value * one, unit, run, analysis)
        direction = next((own.text or "" for own in element if _tag(own) == "RUN_DIRECTION"), run)
        yield from _features(
            element,
            direction.strip().upper(),
            element.get("NAME", "") if tag == "ANALYSIS" else analysis,
        )


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
