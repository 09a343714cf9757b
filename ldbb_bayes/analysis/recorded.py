"""comparison.json read back: what `compare` found, for a report of the same readings."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ldbb_bayes.analysis.assumptions import Assumed
from ldbb_bayes.analysis.belonging import Belonging, Dropping
from ldbb_bayes.analysis.compared import ComparedModel, ComparedTest, Comparison, ScaledSlopes
from ldbb_bayes.analysis.slopes import Curve, SlopeSubset, SlopeSubsets
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.evidence import Evidence

__all__ = ["read_comparison"]

_LARGEST_BYTES = 200_000_000


def read_comparison(path: Path) -> Comparison:
    """The comparison in a folder written by ``ldbb-bayes compare --out``, or its comparison.json.

    Raises
    ------
    InputError
        When the file is missing, damaged, or not one of ours.
    """
    source = path / "comparison.json" if path.is_dir() else path
    if not source.is_file():
        raise InputError(
            f"comparison must be a folder with comparison.json or such a file, got {path}. Give the --out folder of a compare."
        )
    try:
        if source.stat().st_size > _LARGEST_BYTES:
            raise ValueError("larger than 200 MB")
        return _comparison(json.loads(source.read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, StopIteration, RecursionError) as error:
        raise InputError(
            f"{source} must be a comparison written by this version of ldbb-bayes compare, got a damaged one "
            f"({type(error).__name__}: {error}). Compare again."
        ) from None


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
