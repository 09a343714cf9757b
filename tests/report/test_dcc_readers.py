"""The DCC that a report writes, as other programs read it: PyDCC (Siemens) and dsiUnits (PTB)."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest.mock import MagicMock
from xml.etree import ElementTree

import dsi_unit
import pytest
import xarray as xr
from campaigns import plan, simulated
from reports import fitted

import ldbb_bayes as lb
from ldbb_bayes.campaign.dsi_units import parse_unit
from ldbb_bayes.inference.summary import result_json
from ldbb_bayes.units import is_slope

SI = "{https://ptb.de/si}"
# dsiUnits 3.1 says of every unit that it contains this token, also of those that do not.
FALSE_WARNING = r"ignore:The dsi string contains the token '\\per':DeprecationWarning"


@pytest.fixture(scope="module")
def posterior() -> xr.DataTree:
    return fitted(lb.HybridModel.first(1), simulated(plan()))


@pytest.fixture(scope="module")
def certificate(posterior: xr.DataTree, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lb.report.write_dcc(posterior, tmp_path_factory.mktemp("dcc") / "dcc.xml")


@pytest.fixture
def pydcc(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """PyDCC without its two parts that need more than the file.

    Its checks of signatures do not load beside newer versions of OpenSSL, and its check of the
    schema loads the schema from the net.
    """
    monkeypatch.setitem(sys.modules, "certvalidator", MagicMock())
    module = importlib.import_module("dcc.dcc")
    monkeypatch.setattr(module, "DCCXMLValidator", MagicMock())
    return module


def parameters_read(pydcc: ModuleType, certificate: Path) -> dict[str, dict[str, Any]]:
    """Return the numbers with unit and uncertainty that PyDCC reads, by their labels."""
    results = pydcc.DCC(str(certificate)).get_calibration_results("name", lang="en")
    numbers = [result["real"] for _, result in results if "real" in result]
    return {number["label"]: number for number in numbers}


def test_pydcc_reads_the_parameters(
    pydcc: ModuleType, certificate: Path, posterior: xr.DataTree
) -> None:
    read = parameters_read(pydcc, certificate)
    stated = result_json(posterior, prob=0.95)["parameters"]
    for name, parameter in stated.items():
        if is_slope(name):
            continue
        number = read[name]
        uncertainty = number["measurementUncertaintyUnivariate"]["expandedMU"]
        expanded_uncertainty = float(uncertainty["valueExpandedMU"])
        assert float(number["value"]) == pytest.approx(parameter["mean"], rel=1e-12)
        assert float(uncertainty["coverageFactor"]) == 2.0
        assert expanded_uncertainty == pytest.approx(2.0 * parameter["sd"], rel=1e-12)


def test_pydcc_reads_who_and_when(pydcc: ModuleType, certificate: Path) -> None:
    read = pydcc.DCC(str(certificate))
    assert read.version() == "3.3.0"
    assert read.mandatory_language() == "en"
    assert read.uid().startswith("ldbb_bayes-")
    assert read.uid() == lb.campaign.read_dcc(certificate).identifier
    assert not read.status_report.is_signed


@pytest.mark.filterwarnings(FALSE_WARNING)
def test_units_are_understood_by_ptb(certificate: Path) -> None:
    units = set()
    for element in ElementTree.parse(certificate).iter():
        if element.tag in (f"{SI}unit", f"{SI}unitXMLList"):
            units |= set((element.text or "").split())
    assert len(units) >= 5
    for unit in units:
        assert dsi_unit.DsiUnit(unit).valid, unit


@pytest.mark.filterwarnings(FALSE_WARNING)
@pytest.mark.parametrize(
    ("unit", "si_unit"),
    [
        (r"\micro\metre", r"\metre"),
        (r"\nano\metre", r"\metre"),
        (r"\kilo\newton", r"\newton"),
        (r"\milli\metre\newton\tothe{-1}", r"\metre\newton\tothe{-1}"),
        (r"\degree", r"\radian"),
    ],
)
def test_sizes_of_units_are_those_of_ptb(unit: str, si_unit: str) -> None:
    size = parse_unit(unit)
    assert size is not None
    of_ptb = dsi_unit.DsiUnit(si_unit).get_scale_factor(dsi_unit.DsiUnit(unit))
    assert size.factor == pytest.approx(of_ptb, rel=1e-9)
