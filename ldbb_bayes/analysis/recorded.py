"""comparison.json and design.json read back: what `compare` and `design` found, for a report of the same readings."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd

from ldbb_bayes.analysis.assumptions import Assumed
from ldbb_bayes.analysis.belonging import Belonging, Dropping
from ldbb_bayes.analysis.compared import ComparedModel, ComparedTest, Comparison, ScaledSlopes
from ldbb_bayes.analysis.designed import Design
from ldbb_bayes.analysis.forecast import Expected
from ldbb_bayes.analysis.slopes import Curve, SlopeSubset, SlopeSubsets
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.evidence import Evidence

__all__ = ["RecordedDesign", "read_comparison", "read_design", "recorded"]

T = TypeVar("T")
_LARGEST_BYTES = 200_000_000


def read_comparison(path: Path) -> Comparison:
    """The comparison in a folder written by ``ldbb-bayes compare --out``, or its comparison.json.

    Raises
    ------
    InputError
        When the file is missing, damaged, or not one of ours.
    """
    return _read(path, "comparison", _comparison)


def read_design(path: Path) -> RecordedDesign:
    """The design in a folder written by ``ldbb-bayes design --out``, or its design.json.

    Raises
    ------
    InputError
        When the file is missing, damaged, or not one of ours.
    """
    return _read(path, "design", _design)


def _read(path: Path, what: str, read: Callable[[Mapping[str, Any]], T]) -> T:
    verb = {"comparison": "compare", "design": "design"}[what]
    source = path / f"{what}.json" if path.is_dir() else path
    if not source.is_file():
        raise InputError(
            f"{what} must be a folder with {what}.json or such a file, got {path}. Give the --out folder of a {verb}."
        )
    try:
        if source.stat().st_size > _LARGEST_BYTES:
            raise ValueError("larger than 200 MB")
        return read(json.loads(source.read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, StopIteration, RecursionError) as error:
        raise InputError(
            f"{source} must be a {what} written by this version of ldbb-bayes {verb}, got a damaged one "
            f"({type(error).__name__}: {error}). Run {verb} again."
        ) from None


@dataclass(frozen=True)
class RecordedDesign:
    """What a report shows of a design.

    Attributes
    ----------
    campaign, sha256 : str
        Of the pilot.
    sentences : tuple of str
    degree : int
    parameters : tuple of str
    expected, baseline : mapping of parameter to Expected
    baseline_name : str
    augment : bool
    """

    campaign: str
    sha256: str
    sentences: tuple[str, ...]
    degree: int
    parameters: tuple[str, ...]
    expected: Mapping[str, Expected]
    baseline: Mapping[str, Expected]
    baseline_name: str
    augment: bool


def recorded(design: Design) -> RecordedDesign:
    """The same of a design at hand."""
    return RecordedDesign(
        design.pilot.name,
        design.pilot.sha256,
        tuple(design.sentences()),
        design.model.degree,
        design.parameters,
        design.forecast.expected,
        design.baseline.forecast.expected,
        design.baseline.name,
        design.augment,
    )


def _design(record: Mapping[str, Any]) -> RecordedDesign:
    return RecordedDesign(
        str(record["pilot"]["name"]),
        str(record["pilot"]["sha256"]),
        tuple(map(str, record["sentences"])),
        int(record["degree"]),
        tuple(map(str, record["parameters"])),
        _expected(record["expected"]),
        _expected(record["baseline"]),
        str(record["compared"][0]["name"]),
        bool(record["augment"]),
    )


def _expected(entries: Mapping[str, Mapping[str, Any]]) -> dict[str, Expected]:
    sizes = ("prior_sd", "sd", "untruncated_sd", "floor_sd")
    return {
        str(name): Expected(str(own["unit"]), *(np.inf if own[key] is None else float(own[key]) for key in sizes))
        for name, own in entries.items()
    }


def _comparison(record: Mapping[str, Any]) -> Comparison:
    sha256 = str(record["campaign"]["sha256"])
    second, first = str(record["sensitivity_of"]).rsplit("/", 1)
    slopes = {str(name): float(entry["inclusion_probability"]) for name, entry in record["slopes"].items()}
    subsets = tuple(
        SlopeSubset({str(n): int(p) for n, p in s["powers"].items()}, float(s["log_evidence"]), float(s["probability"]))
        for s in record["slope_subsets"]
    )
    quadratic = {
        str(name): float(entry["quadratic_probability"])
        for name, entry in record["slopes"].items()
        if "quadratic_probability" in entry
    }
    return Comparison(
        campaign=str(record["campaign"]["name"]),
        sha256=sha256,
        pair=(first, second),
        models={str(name): _model(str(name), entry, sha256) for name, entry in record["models"].items()},
        log_bayes_factor={
            str(r): (float(v), float(record["log_bayes_factor_error"][r])) for r, v in record["log_bayes_factor"].items()
        },
        savage_dickey={str(r): (float(e["log_bayes_factor"]), float(e["error"])) for r, e in record["savage_dickey"].items()},
        elpd_difference={str(r): (_number(e["value"]), _number(e["se"])) for r, e in record["elpd_difference"].items()},
        prior_sensitivity=tuple(
            ScaledSlopes(float(s["slope_scale"]), float(s["log_bayes_factor"]), float(s["error"]))
            for s in record["prior_sensitivity"]
        ),
        crossings=tuple(map(float, record["prior_sensitivity_crossings"])),
        discrepancy_sensitivity=tuple(map(_assumed, record["discrepancy_sensitivity"])),
        nuisances=tuple(map(_assumed, record["nuisances"])),
        slopes=SlopeSubsets(
            subsets,
            slopes,
            quadratic,
            _curves(record["compliance_against_force"]),
            float(record["largest_error"]),
            int(record["slope_subsets_possible"]),
        )
        if subsets
        else None,
        tests={str(name): _test(entry) for name, entry in record["tests"].items()},
        local_fits=pd.DataFrame(record["local_fits"]),
        verdict=tuple(map(str, record["sentences"])),
        tolerance=float(record["tolerance"]),
        largest_error=float(record["largest_error"]),
    )


def _model(name: str, entry: Mapping[str, Any], sha256: str) -> ComparedModel:
    return ComparedModel(
        name,
        int(entry["degree"]),
        tuple(map(str, entry["terms"])),
        Evidence(float(entry["log_evidence"]), float(entry["log_evidence_error"]), 0, sha256),
        float(entry["posterior_probability"]),
        _number(entry["elpd_lofo"]),
        _number(entry["elpd_lofo_se"]),
        float(entry["rmse_um"]),
        {str(test): _number(value) for test, value in entry["fitness_percent"].items()},
        _number(entry["least_squares"]["rmse_um"]),
        {str(test): _number(value) for test, value in entry["least_squares"]["fitness_percent"].items()},
        {str(p): (str(own["unit"]), float(own["mean"]), float(own["sd"])) for p, own in entry["parameters"].items()},
        _curves(entry["compliance_against_force"]),
    )


def _curves(curves: Mapping[str, Mapping[str, Any]]) -> dict[str, Curve]:
    found = {}
    for name, entry in curves.items():
        key = next(key for key in entry if key.startswith("ci"))
        force, mean, median, low, high = (
            np.array(values, dtype=float) for values in (entry["force_N"], entry["mean"], entry["median"], *entry[key])
        )
        found[str(name)] = Curve(str(entry["unit"]), float(key[2:]) / 100.0, force, mean, median, low, high)
    return found


def _assumed(entry: Mapping[str, Any]) -> Assumed:
    evidence = {str(name): float(value) for name, value in entry["log_evidence"].items()}
    return Assumed(str(entry["assumption"]), evidence, float(entry["log_bayes_factor"]), float(entry["log_bayes_factor_error"]))


def _test(entry: Mapping[str, Any]) -> ComparedTest:
    smoothed = entry["psis_loo"]
    return ComparedTest(
        float(entry["force_N"]),
        {str(name): float(value) for name, value in entry["lofo_log_density"].items()},
        {str(name): float(value) for name, value in entry["lofo_log_density_error"].items()},
        {str(name): float(own["log_density"]) for name, own in smoothed.items()},
        {str(name): float(own["pareto_k"]) for name, own in smoothed.items()},
        float(entry["psis_loo_good_k"]),
        Belonging(
            float(entry["lofo_p_value"]),
            float(entry["lofo_family_wise_p_value"]),
            tuple(float(p) for p in entry["lofo_p_value_by_order"].values()),
            int(entry["lofo_worst_order"]),
            bool(entry["flag"]),
        ),
        {
            str(model): {
                str(parameter): Dropping(float(own["mean"]), float(own["sd"]), float(own["shift"]))
                for parameter, own in changes.items()
            }
            for model, changes in entry["without_it"].items()
        },
    )


def _number(value: float | None) -> float:
    """Null stands for what is not a number."""
    return np.nan if value is None else float(value)
