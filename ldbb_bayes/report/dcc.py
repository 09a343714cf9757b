"""Results for programs that read calibration certificates: D-SI numbers in the format of a DCC (schema 3.3.0, D-SI 2.2.1)."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
import xarray as xr

import ldbb_bayes as lb
from ldbb_bayes.files import write_whole
from ldbb_bayes.inference.posterior import campaign_of, result_json
from ldbb_bayes.report.findings import fit_in_words
from ldbb_bayes.report.wording import verdict_words
from ldbb_bayes.result import Array
from ldbb_bayes.units import display_name

__all__ = ["dcc_xml", "dsi_unit", "write_dcc"]

_DSI = {"mm": r"\milli\metre", "um": r"\micro\metre", "N": r"\newton", "rad": r"\radian"}
_KINDS = {
    "C": ("compliance", "Nachgiebigkeit"),
    "C_": ("change of compliance with force", "Änderung der Nachgiebigkeit mit der Kraft"),
    "E": ("geometric error", "Geometrieabweichung"),
}


def dsi_unit(*units: str) -> str:
    r"""Return a product of inside units in D-SI notation: mm/N → \\milli\\metre\\newton\\tothe{-1}."""
    powers: Counter[str] = Counter()
    for unit in units:
        for k, part in enumerate(unit.split("/")):
            for name, power in re.findall(r"([a-zA-Z]+)(?:\^(\d))?", part):
                powers[name] += int(power or 1) * (-1 if k else 1)
    shown = (_DSI[name] + ("" if power == 1 else f"\\tothe{{{power}}}") for name, power in powers.items() if power)
    return "".join(shown) or r"\one"


def write_dcc(posterior: xr.DataTree, path: str | os.PathLike[str], *, ci_prob: float = 0.95) -> Path:
    """Write what a fit says of a machine as XML in the format of a digital calibration certificate, and return the path.

    Every compliance and geometric error in inside units (mm, N, rad), the numbers of `result_json`: mean, U (k = 2), interval of
    probability ``ci_prob``, covariance. The file says that it is unsigned and no calibration certificate.
    """
    path = Path(path)
    write_whole(path, dcc_xml(posterior, ci_prob=ci_prob).encode())
    return path


def dcc_xml(posterior: xr.DataTree, *, ci_prob: float = 0.95) -> str:
    """Return the text of that file."""
    result, campaign = result_json(posterior, ci_prob=ci_prob), campaign_of(posterior)
    draws = np.stack([np.ravel(posterior["posterior"].dataset[name]) for name in result["parameters"]])
    units = [entry["unit"] for entry in result["parameters"].values()]
    covariance = np.atleast_2d(np.cov(draws))
    columns = [[(covariance[i, j], dsi_unit(units[i], units[j])) for i in range(len(units))] for j in range(len(units))]
    loader = jinja2.PackageLoader("ldbb_bayes.report")
    environment = jinja2.Environment(loader=loader, autoescape=True, undefined=jinja2.StrictUndefined)
    environment.filters["number"] = lambda value: repr(float(value))
    return environment.get_template("dcc.xml.j2").render(
        campaign=campaign,
        model=result["model"],
        plane=campaign.machine().plane,
        version=result["provenance"]["versions"]["ldbb-bayes"],
        fitted=result["provenance"]["started"][:10],
        identifier=f"ldbb_bayes-{hashlib.sha256(json.dumps(result['parameters']).encode()).hexdigest()[:32]}",
        verdict=fit_in_words(posterior)["verdict"],
        parameters=[*_parameters(posterior, result["parameters"], draws, f"ci{100 * ci_prob:g}")],
        covariance=columns,
        factor=_coverage_factor(draws, covariance, ci_prob),
        models=len(result.get("averaged", {}).get("models", ())),
        ci_prob=ci_prob,
    )


def _coverage_factor(draws: Array, covariance: Array, probability: float) -> float:
    """Of the ellipsoid that holds this share of the draws; a parameter that is the same in all of them has no part in it."""
    sd = np.sqrt(np.diag(covariance))
    scaled, scale = draws - draws.mean(axis=1, keepdims=True), np.where(sd > 0.0, sd, 1.0)
    inverse = np.linalg.pinv(covariance / np.outer(scale, scale), hermitian=True)
    scaled /= scale[:, None]
    return float(np.sqrt(np.quantile(np.sum(scaled * (inverse @ scaled), axis=0), probability)))


def _parameters(
    posterior: xr.DataTree, entries: Mapping[str, Mapping[str, Any]], draws: Array, interval: str
) -> Iterator[dict[str, Any]]:
    """What the file says of every parameter; ``within``: the share of the draws in mean ± U."""
    verdicts = lb.verdicts(posterior)
    for (name, entry), own in zip(entries.items(), draws, strict=True):
        en, de = _KINDS["C_" if re.fullmatch(r"C_.*_\d", name) else name[0]]
        low, high = entry[interval]
        yield {key: entry[key] for key in ("mean", "sd")} | {
            "name": name, "shown": display_name(name), "en": en, "de": de, "low": low, "high": high,
            "unit": dsi_unit(entry["unit"]), "within": float(np.mean(np.abs(own - entry["mean"]) <= 2.0 * entry["sd"])),
            "verdict": verdict_words(verdicts[name]) if name in verdicts else "",
        }  # fmt: skip
