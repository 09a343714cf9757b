"""Reading of digital calibration certificates (DCC, schema 2 and 3) from XML.

The file is not trusted. It is therefore refused if it declares a document type, because a document
type may define entities.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar
from xml.etree import ElementTree

from ldbb_bayes.campaign.certificates import CalibrationCertificate
from ldbb_bayes.campaign.certified_quantity import CertifiedQuantity
from ldbb_bayes.campaign.dsi_units import parse_unit
from ldbb_bayes.errors import InputError, placed, require
from ldbb_bayes.files import bytes_of, xml_of

__all__ = ["read_dcc"]

_DCC = "{https://ptb.de/dcc}"
_SI = "{https://ptb.de/si}"
_LARGEST_BYTES = 32 * 2**20
# Largest number of characters of an XML tag that an error message shows.
_TAG_SHOWN = 80
# Names of those XML elements of a digital calibration certificate that contain no results of the
# calibration; they are not searched for numbers.
_NO_RESULTS = (
    "usedMethods",
    "usedSoftware",
    "measuringEquipments",
    "influenceConditions",
    "measurementMetaData",
)
# Names of the XML elements of a digital calibration certificate that hold one number or a list of
# numbers, with unit and uncertainty.
_NUMBER_ELEMENTS = ("real", "realListXMLList")
# XML elements of the D-SI (Digital SI) that state an expanded uncertainty. Each key is the name of
# such an element; the value of the dict is the name of the inner element that holds the number. The
# element of version 2 of the D-SI comes first, then the element of version 1.
_EXPANDED_UNCERTAINTIES = {"expandedMU": "valueExpandedMU", "expandedUnc": "uncertainty"}
# XML elements of the D-SI (Digital SI) that state a standard uncertainty. Each key is the name of
# such an element; the value of the dict is the name of the inner element that holds the number.
_STANDARD_UNCERTAINTIES = {
    "standardMU": "valueStandardMU",
    "coverageIntervalMU": "valueStandardMU",
    "coverageInterval": "standardUnc",
}
_T = TypeVar("_T")


def read_dcc(path: str | os.PathLike[str]) -> CalibrationCertificate:
    """Read a digital calibration certificate (DCC) and the numerical results in it.

    Versions 2 and 3 of the DCC schema are supported. The file is not trusted. It is therefore
    refused if it declares a document type, because a document type may define entities.

    Parameters
    ----------
    path : str or os.PathLike
        Path of the XML file.

    Returns
    -------
    CalibrationCertificate
        The certificate with its ``identifier`` and its ``quantities``. The method ``fields`` of the
        certificate returns what the certificate states about a ``"bar"``, a ``"force"`` device or a
        ``"ball"``; the keys are named as in ``campaign.toml``.

    Raises
    ------
    InputError
        If a file cannot be read or is not a DCC; the message names the file.

    Examples
    --------
    In this example, the certificate states that the length of a bar deviates from its nominal
    length by 0.8 µm, with U = 0.9 µm at k = 3. The length error has the opposite sign, because the
    readings of a bar that is too long are too small:

    >>> lb.campaign.read_dcc("bar.xml").fields("bar")  # doctest: +SKIP
    {'length_error_um': -0.8, 'U_um': 0.6, 'certificate': 'bar.xml, DCC K-2026-0815: ...'}
    """
    path = Path(path)
    raw = bytes_of(path, _LARGEST_BYTES, what="a digital calibration certificate (XML)")
    with placed(path):
        root = xml_of(raw, "the DCC itself, an .xml file")
        require(
            root.tag == f"{_DCC}digitalCalibrationCertificate",
            "the file must be a digital calibration certificate (namespace https://ptb.de/dcc), got"
            f" the root element {root.tag[:_TAG_SHOWN]!r}. Give the DCC of the laboratory, not its"
            " PDF or another XML.",
        )
        identifier = root.findtext(
            f"{_DCC}administrativeData/{_DCC}coreData/{_DCC}uniqueIdentifier"
        )
        results = root.find(f"{_DCC}measurementResults")
        quantities: tuple[CertifiedQuantity, ...] = ()
        if results is not None:
            quantities = tuple(_quantities_in(results, ()))
        identifier = " ".join((identifier or "of no identifier").split())
        return CalibrationCertificate(path, identifier, quantities)


def _quantities_in(
    holder: ElementTree.Element, holders: tuple[str, ...]
) -> Iterator[CertifiedQuantity]:
    """Yield all certified quantities inside an XML element of a certificate.

    ``holder`` is the element. ``holders`` lists the names and refType attributes of ``holder`` and
    of all elements that contain it, outermost first. Each quantity stores the names and refType
    attributes of all elements that contain the quantity.
    """
    for element in holder:
        name = _name_of(element)
        ref_type = element.get("refType", "")
        if element.tag == f"{_DCC}quantity":
            for number_element in _number_elements(element):
                yield from _quantities_of(number_element, name, ref_type, holders)
        elif element.tag.removeprefix(_DCC) not in _NO_RESULTS:
            names = [text for text in (name, ref_type) if text]
            yield from _quantities_in(element, (*holders, *names))


def _number_elements(quantity: ElementTree.Element) -> Iterator[ElementTree.Element]:
    """Yield the XML elements that hold the numbers of a quantity of a certificate.

    An element ``hybrid`` states one quantity in several units. Only the first element with a known
    unit is yielded or, if no unit is known, the first element.
    """
    for tag in _NUMBER_ELEMENTS:
        yield from quantity.iterfind(_SI + tag)
    for hybrid in quantity.iterfind(f"{_SI}hybrid"):
        alternatives = [element for element in hybrid if _words(element, "value")]
        known = [element for element in alternatives if _has_known_unit(element)]
        yield from (known or alternatives)[:1]


def _has_known_unit(element: ElementTree.Element) -> bool:
    """Return whether an XML element states units for its numbers, and all units are known."""
    units = _words(element, "unit")
    return bool(units) and all(parse_unit(unit) is not None for unit in units)


def _name_of(element: ElementTree.Element) -> str:
    """Return the name that a certificate gives an XML element, in all its languages.

    The names in different languages are separated by slashes.
    """
    wordings = []
    for content in element.iterfind(f"{_DCC}name/{_DCC}content"):
        wording = " ".join((content.text or "").split())
        if wording and wording not in wordings:
            wordings.append(wording)
    return " / ".join(wordings)


@dataclass
class _Uncertainty:
    """Uncertainties that an XML element states for one or several certified numbers.

    ``U`` are expanded uncertainties, ``k`` their coverage factors and ``coverage`` their coverage
    probabilities. Each list has one entry for each number, a single entry for all numbers, or no
    entry.
    """

    U: list[float] = field(default_factory=list)
    k: list[float] = field(default_factory=list)
    coverage: list[float] = field(default_factory=list)


def _quantities_of(
    element: ElementTree.Element, name: str, ref_type: str, holders: tuple[str, ...]
) -> Iterator[CertifiedQuantity]:
    """Yield one certified quantity for each finite number in an XML element.

    The element holds one number or a list of numbers. A single unit or uncertainty applies to all
    numbers of the list. If a list of several units or uncertainties is shorter than the list of
    numbers, the numbers without a unit or uncertainty are left out.

    Parameters
    ----------
    element
        The XML element that holds the numbers.
    name, ref_type
        Name and attribute refType of the quantity.
    holders
        Names and refType attributes of the elements around the quantity, outermost first.
    """
    units = _words(element, "unit")
    uncertainty = _uncertainty_of(element, name)
    values = _numbers_in(element, "value", name)
    for k, value in enumerate(values[: _shortest_list(units, uncertainty)]):
        if math.isfinite(value):
            yield CertifiedQuantity(
                name=name,
                ref_type=ref_type,
                holders=holders,
                value=value,
                unit=_entry_for_quantity(units, k),
                U=_entry_for_quantity(uncertainty.U, k),
                k=_entry_for_quantity(uncertainty.k, k),
                coverage=_entry_for_quantity(uncertainty.coverage, k),
            )


def _uncertainty_of(element: ElementTree.Element, name: str) -> _Uncertainty:
    """Return the last uncertainty that a certificate's XML element states for its numbers.

    A standard uncertainty is returned as an expanded uncertainty with k = 1. An uncertainty without
    a number is ignored. If no uncertainty is stated, the lists in the result are empty. ``name`` is
    the name of the quantity for error messages.
    """
    uncertainty = _Uncertainty()
    for inner in element.iter():
        tag = inner.tag.removeprefix(_SI).removesuffix("XMLList")
        stated = _Uncertainty()
        if tag in _EXPANDED_UNCERTAINTIES:
            stated = _Uncertainty(
                _numbers_in(inner, _EXPANDED_UNCERTAINTIES[tag], name),
                _numbers_in(inner, "coverageFactor", name),
                _numbers_in(inner, "coverageProbability", name),
            )
        elif tag in _STANDARD_UNCERTAINTIES:
            stated = _Uncertainty(_numbers_in(inner, _STANDARD_UNCERTAINTIES[tag], name), [1.0])
        if stated.U:
            uncertainty = stated
    return uncertainty


def _shortest_list(units: Sequence[str], uncertainty: _Uncertainty) -> int | None:
    """Return the length of the shortest list of units or uncertainties that an XML element states.

    Numbers of the element beyond this length have no unit or uncertainty. Only lists with more than
    one entry are considered, because a single entry applies to all numbers. Return None if there is
    no such list. ``units`` is the list of units; ``uncertainty`` holds the lists of uncertainties,
    coverage factors and coverage probabilities.
    """
    lists = (units, uncertainty.U, uncertainty.k, uncertainty.coverage)
    lengths = [len(entries) for entries in lists if len(entries) > 1]
    return min(lengths, default=None)


def _entry_for_quantity(entries: Sequence[_T], k: int) -> _T | None:
    """Return the unit or uncertainty of the certified number with the index ``k``.

    ``entries`` are the units or uncertainties that an XML element states for its list of numbers,
    and ``k`` is counted from 0. A single entry applies to all numbers. Return None if there is no
    entry.
    """
    if not entries:
        return None
    if len(entries) == 1:
        return entries[0]
    return entries[k]


def _words(element: ElementTree.Element, tag: str) -> list[str]:
    """Return the words in the D-SI element ``tag`` inside ``element``; blanks separate the words.

    If there is no such element, return the words of the element with "XMLList" added to its name.
    Return an empty list if neither element exists.
    """
    text = element.findtext(_SI + tag) or element.findtext(f"{_SI}{tag}XMLList") or ""
    return text.split()


def _numbers_in(element: ElementTree.Element, tag: str, name: str) -> list[float]:
    """Return the numbers in the D-SI element ``tag`` inside ``element``; blanks separate them.

    ``name`` is the name of the quantity for error messages. Raise an `InputError` for a word that
    is not a number.
    """
    numbers = []
    for word in _words(element, tag):
        try:
            numbers.append(float(word))
        except ValueError:
            raise InputError(
                f"{name}: {tag} must be numbers, got {word!r}. Use a decimal point."
            ) from None
    return numbers
