"""Export of a fit for programs that read digital calibration certificates (DCC).

The file follows version 3.3.0 of the DCC schema. Values are written in the notation of D-SI
(Digital SI), version 2.2.1.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from ldbb_bayes.analysis.directional_stiffness import PlaneStiffness, PrincipalStiffness, stiffness
from ldbb_bayes.analysis.posterior_verdicts import judge_posterior
from ldbb_bayes.analysis.stated_quantities import AxialDirection, StatedValue
from ldbb_bayes.analysis.tolerances import name_in_plane
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.deprecation import renamed_keyword
from ldbb_bayes.files import write_whole
from ldbb_bayes.inference.force_curves import force_curves
from ldbb_bayes.inference.posterior import bound_of, campaign_of
from ldbb_bayes.inference.summary import result_json
from ldbb_bayes.report import wording
from ldbb_bayes.report.findings import Findings, findings_of_fit
from ldbb_bayes.report.fit_description import describe_fit
from ldbb_bayes.report.html_templates import template_of
from ldbb_bayes.report.message_translation import in_language
from ldbb_bayes.report.sheet_numbers import SheetNumbers
from ldbb_bayes.report.sheet_state import banner
from ldbb_bayes.report.stated_circle import circle_phrase
from ldbb_bayes.report.stiffness_numbers import principal_direction
from ldbb_bayes.report.translation import Words, words_of
from ldbb_bayes.report.wording.number_words import SURE
from ldbb_bayes.results import Array
from ldbb_bayes.units import (
    U_PROBABILITY,
    display_name,
    is_compliance_or_slope,
    is_slope,
    needs_interval,
)

__all__ = ["dsi_unit", "write_dcc", "write_dcc_of_findings"]

_DSI = {
    "mm": r"\milli\metre",
    "um": r"\micro\metre",
    "N": r"\newton",
    "rad": r"\radian",
    "deg": r"\degree",
}
# Number of hexadecimal digits of the digest in the identifier of a certificate file.
_DIGEST_LENGTH = 32


class _Remark(NamedTuple):
    """A text for the reader in the two languages of the file; it may be empty."""

    en: str
    de: str | None  # None if a part of the English text has no translation

    @classmethod
    def of(cls, english: str, campaign: Campaign) -> _Remark:
        """Return an English text with its translation, in which names of tests are kept."""
        names = [str(test.name) for test in campaign.tests]
        return cls(english, in_language(english, "de", names))

    @classmethod
    def by(cls, text_in: Callable[[Words], str]) -> _Remark:
        """Return a text of the sheets. The function ``text_in`` makes it in one language."""
        return cls(text_in(words_of("en")), text_in(words_of("de")))


_NO_REMARK = _Remark("", None)


def dsi_unit(*units: str) -> str:
    r"""Return the product of several internal units (mm, N, rad) in D-SI notation.

    Parameters
    ----------
    *units
        Units that are multiplied, for example ``mm/N``.

    Returns
    -------
    str
        Product in D-SI notation, for example ``\milli\metre\newton\tothe{-1}``.
    """
    powers: Counter[str] = Counter()
    for unit in units:
        for k, factor in enumerate(unit.split("/")):
            sign = -1 if k else 1
            for name, power in re.findall(r"([a-zA-Z]+)(?:\^(\d))?", factor):
                powers[name] += sign * int(power or 1)
    notation = ""
    for name, total in powers.items():
        if total != 0:
            notation += _DSI[name]
        if total not in (0, 1):
            notation += f"\\tothe{{{total}}}"
    return notation or r"\one"


@renamed_keyword("ci_prob", "prob")
def write_dcc(posterior: xr.DataTree, path: str | os.PathLike[str], *, prob: float = 0.95) -> Path:
    """Write the results of a fit to an XML file in the format of a digital calibration certificate.

    For every parameter of the machine, the file holds the mean, U (k = 2), the credible interval
    and the covariance. They are in internal units (mm, N, rad). It also holds the change of each
    compliance over the tested forces. Slopes, which are coefficients of this change, appear only in
    the covariance matrix. The stiffness by direction at the reference force is included if the
    readings determine it; where value ± U would not describe a stiffness or a change, its 95 %
    interval takes the place of U, as on the sheets. The file states whether the results can be
    used, as sheet 1 does, and that it is unsigned and is not a calibration certificate.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.
    path : path
        File to write.
    prob : float
        Probability of the credible intervals and of the ellipsoid of all parameters together.

    Returns
    -------
    Path
        Path of the file that was written.

    Raises
    ------
    InputError
        ``prob`` is not a probability, or the file cannot be written.

    Examples
    --------
    >>> file = lb.report.write_dcc(posterior, "dcc.xml")
    >>> text = file.read_text(encoding="utf-8")
    >>> text.count("<si:valueExpandedMU>")  # U of parameters, changes and stiffnesses
    25
    >>> 'id="k_min"' in text
    True
    """
    findings = findings_of_fit(
        posterior, prob=prob, comparison=wording.NO_ANNEX, recommended=wording.NO_ANNEX
    )
    return write_dcc_of_findings(findings, path)


def write_dcc_of_findings(findings: Findings, path: str | os.PathLike[str]) -> Path:
    """Write the results that a report shows to an XML file, as `write_dcc` does.

    Parameters
    ----------
    findings
        All results of the fit that the report shows.
    path
        File to write.

    Returns
    -------
    Path
        Path of the file that was written.
    """
    posterior = findings.posterior_of_certificate
    prob = findings.prob
    result = result_json(posterior, prob=prob)
    campaign = campaign_of(posterior)
    entries = result["parameters"]
    draws = np.stack([np.ravel(posterior["posterior"].dataset[name]) for name in entries])
    covariance = np.atleast_2d(np.cov(draws))
    digest = hashlib.sha256(json.dumps(entries).encode()).hexdigest()
    parameters = _parameter_entries(posterior, entries, draws, f"ci{100 * prob:g}")
    compliances = [entry for entry in parameters if entry["kind"] == "compliance"]
    geometric_errors = [entry for entry in parameters if entry["kind"] == "geometric"]
    text = template_of("dcc.xml.j2").render(
        campaign=campaign,
        model=result["model"],
        plane=campaign.machine().plane,
        version=result["provenance"]["versions"]["ldbb-bayes"],
        fitted=result["provenance"]["started"][:10],
        identifier=f"ldbb_bayes-{digest[:_DIGEST_LENGTH]}",
        use=_Remark.by(partial(_sentence_of_use, findings)),
        verdict=_Remark.of(describe_fit(posterior)["verdict"], campaign),
        parameters=parameters,
        quantities=[
            *compliances,
            *_change_entries(posterior),
            *_stiffness_entries(posterior),
            *geometric_errors,
        ],
        covariance=_covariance_columns(covariance, [entry["unit"] for entry in entries.values()]),
        factor=_coverage_factor(draws, covariance, prob),
        models=len(result.get("averaged", {}).get("models", ())),
        prob=prob,
        prob_in_place_of_U=U_PROBABILITY,
    )
    write_whole(Path(path), text.encode())
    return Path(path)


def _sentence_of_use(findings: Findings, words: Words) -> str:
    """Return what the box of sheet 1 says: whether the results can be used, and why."""
    reference_force_N = float(findings.result["model"]["reference_force_N"])
    return banner(SheetNumbers(findings, words, reference_force_N)).sentence


def _covariance_columns(covariance: Array, units: list[str]) -> list[list[tuple[float, str]]]:
    """Return a list of the columns of a covariance matrix; each column is a list of pairs.

    There is one pair for each element of the matrix: its value, and its unit in D-SI notation.
    ``units`` are the units of the parameters in the program, such as mm/N.
    """
    columns = []
    for j, column_unit in enumerate(units):
        column = []
        for i, row_unit in enumerate(units):
            column.append((covariance[i, j], dsi_unit(row_unit, column_unit)))
        columns.append(column)
    return columns


def _coverage_factor(draws: Array, covariance: Array, probability: float) -> float:
    """Return the coverage factor k of a coverage ellipsoid of the parameters.

    The ellipsoid is centred at the posterior mean, has the shape given by ``covariance``, and
    contains the fraction ``probability`` of the posterior draws. ``draws``, shape (p, draws), are
    random draws of p parameters from the posterior. ``covariance``, shape (p, p), is the covariance
    matrix of the parameters. Parameters that have the same value in all draws do not contribute.
    """
    sd = np.sqrt(np.diag(covariance))
    scale = np.where(sd > 0.0, sd, 1.0)
    inverse = np.linalg.pinv(covariance / np.outer(scale, scale), hermitian=True)
    scaled = (draws - draws.mean(axis=1, keepdims=True)) / scale[:, None]
    squared_distance = np.sum(scaled * (inverse @ scaled), axis=0)
    return float(np.sqrt(np.quantile(squared_distance, probability)))


def _parameter_entries(
    posterior: xr.DataTree, entries: Mapping[str, Mapping[str, Any]], draws: Array, interval: str
) -> list[dict[str, Any]]:
    """Return one dictionary for each parameter, with the results for the certificate file.

    ``entries`` is a mapping from the names of the parameters to dictionaries with the results of
    the fit. ``interval`` is the key of the credible interval in these dictionaries, such as
    ``ci95``. ``draws``, shape (parameters, draws), are random draws from the posterior. The entry
    ``within`` of each returned dictionary is the fraction of the draws that lie within mean ± U,
    where U is twice the standard deviation. The entry ``interval`` is None: the credible intervals
    of all parameters, from ``low`` to ``high``, are stated together.
    """
    campaign = campaign_of(posterior)
    verdict_by_name = judge_posterior(posterior)
    parameters = []
    for (name, entry), parameter_draws in zip(entries.items(), draws, strict=True):
        low, high = entry[interval]
        deviation = np.abs(parameter_draws - entry["mean"])
        remark = _NO_REMARK
        if name in verdict_by_name:
            remark = _Remark.of(wording.verdict_words(verdict_by_name[name]), campaign)
        parameters.append(
            {
                "value": entry["mean"],
                "sd": entry["sd"],
                "name": name,
                "shown": display_name(name),
                "kind": _kind_of(name),
                "low": low,
                "high": high,
                "unit": dsi_unit(entry["unit"]),
                "within": float(np.mean(deviation <= 2.0 * entry["sd"])),
                "interval": None,
                "remark": remark,
            }
        )
    return parameters


def _change_entries(posterior: xr.DataTree) -> list[dict[str, Any]]:
    """Return dictionaries for the certificate file, one for the change of each compliance.

    The change of a compliance C(F) is C at the largest force tested minus C at the smallest force
    tested. The dictionaries have the keys of those of `_parameter_entries`, but lack the keys
    ``low`` and ``high`` (the ends of the credible interval). The entry ``interval`` is the 95 %
    interval where value ± U would not describe the change, unless the compliance is constant with
    a probability of 95 % or more.
    """
    curves = force_curves(posterior)
    difference = f"C({curves.largest_force_N:.4g} N) − C({curves.smallest_force_N:.4g} N)"
    remark = _Remark.by(lambda words: words.number(difference))
    levels = (0.5 - 0.5 * U_PROBABILITY, 0.5 + 0.5 * U_PROBABILITY)
    entries = []
    for name, draws in curves.compliances.items():
        mean = float(draws.change.mean())
        sd = float(draws.change.std(ddof=1))
        low, high = np.quantile(draws.change, levels).tolist()
        interval = None
        # If the compliance is almost certainly constant, an interval with equal tails is a point,
        # or of the few draws on one side of zero alone (see `wording.is_exactly_none`).
        is_constant = low == high or float(np.mean(draws.change == 0.0)) >= SURE
        if not is_constant and needs_interval(mean, sd, (low, high)):
            interval = (low, high)
        entries.append(
            {
                "value": mean,
                "sd": sd,
                "name": f"{name}_change",
                "shown": f"Δ{display_name(name)}",
                "kind": "change",
                "unit": dsi_unit(draws.unit),
                "within": float(np.mean(np.abs(draws.change - mean) <= 2.0 * sd)),
                "interval": interval,
                "remark": remark,
            }
        )
    return entries


def _stiffness_entries(posterior: xr.DataTree) -> list[dict[str, Any]]:
    """Return a list of what the certificate file states about the stiffness by direction.

    The list has one dictionary for each quantity, such as the least stiffness in a plane. The
    dictionaries have the same keys as those of `_parameter_entries`, except ``low`` and ``high``,
    the ends of the credible interval. The quantities are computed at the model's reference force. A
    quantity is left out if it cannot be stated as a value ± U: a stiffness or ratio of which only a
    lower limit is known, or a direction that the readings do not determine. If circles of a plane
    differ in radius or centre, the entry ``remark`` names the one that the quantities are of.
    """
    reference_N = bound_of(posterior).setting.reference_force_N
    if not reference_N > 0.0:
        return []
    result = stiffness(posterior, [reference_N], prob=U_PROBABILITY)
    planes = [plane.plane for plane in result.planes]
    campaign = campaign_of(posterior)
    entries = []
    for plane in result.planes:
        of_circle = _remark_on_circle(campaign, plane.plane)
        for entry in _entries_of_plane(plane):
            entry["remark"] = _joined(entry["remark"], of_circle)
            entry["name"] = name_in_plane(entry["name"], plane.plane, planes)
            if entry["kind"] != "difference":
                entry["shown"] = name_in_plane(entry["shown"], plane.plane, planes)
            entries.append(entry)
    for principal in result.principal:
        entries += _principal_entries(principal)
    return entries


def _remark_on_circle(campaign: Campaign, plane: str) -> _Remark:
    """Return the remark of which circle the stiffnesses in a plane are, if its circles differ."""
    return _Remark.by(lambda words: circle_phrase(campaign, plane, words).removeprefix(", "))


def _joined(first: _Remark, second: _Remark) -> _Remark:
    """Return two remarks as one, in which a semicolon separates what is not empty."""
    pairs = zip(first, second, strict=True)
    english, german = ("; ".join(filter(None, texts)) for texts in pairs)
    return _Remark(english, german)


def _entries_of_plane(plane: PlaneStiffness) -> list[dict[str, Any]]:
    """Return a list of what the certificate file states about the stiffness in one plane.

    The list has one dictionary for each quantity. The names of the quantities, such as ``k_min``,
    do not state the plane. Quantities of which only a lower limit is known are left out. Directions
    that the readings do not determine are left out, too.
    """
    axis = plane.plane[0]
    difference_name = plane.difference_name.replace(" ", "")
    entries = [
        _value_entry("k_min", "k_min", "stiffness", plane.least),
        _value_entry("k_max", "k_max", "stiffness", plane.greatest),
        _value_entry("k_ratio", "k_ratio", "ratio", plane.ratio),
        _direction_entry("softest_direction", "θ(k_min)", axis, plane.softest),
        _direction_entry("stiffest_direction", "θ(k_max)", axis, plane.stiffest),
        _direction_entry("principal_axis", "ψ", axis, plane.principal_axis),
        _value_entry("difference", difference_name, "difference", plane.difference),
    ]
    return [entry for entry in entries if entry]


def _value_entry(name: str, shown: str, kind: str, value: StatedValue) -> dict[str, Any]:
    """Return a dictionary with what the certificate file states about one value.

    The value is a stiffness, a ratio or a difference. A ratio is one stiffness divided by another;
    a difference is one compliance minus another. ``name`` is the name that programs use, ``shown``
    the name that people read, and ``kind`` the kind of the quantity, such as "ratio". As on the
    sheets, a stiffness or a ratio is its median, and a difference its mean. The entry ``interval``
    is the credible interval, lower and upper end, where value ± U would not describe the quantity
    (`needs_interval`), and otherwise None. The dictionary is empty if only a lower limit of
    ``value`` is known.
    """
    if value.only_lower_limit:
        return {}
    stated = value.median
    within = value.within_U_of_median
    if kind == "difference":
        stated = value.mean
        within = value.within_U
    interval = None
    if needs_interval(stated, value.sd, value.interval):
        interval = value.interval
    return {
        "value": stated,
        "sd": value.sd,
        "name": name,
        "shown": shown,
        "kind": kind,
        "unit": dsi_unit(value.unit),
        "within": within,
        "interval": interval,
        "remark": _NO_REMARK,
    }


def _direction_entry(name: str, shown: str, axis: str, direction: AxialDirection) -> dict[str, Any]:
    """Return a dictionary with what the certificate file states about one direction in a plane.

    The direction is that of the least or the greatest stiffness, or the principal axis. It is
    stated as an angle from the machine axis ``axis`` [°]. ``name`` identifies the angle for
    programs, and ``shown`` is the symbol of the angle for people. The entry ``within`` is the share
    of the random draws from the posterior in which the direction differs from the mean direction by
    at most the expanded uncertainty U (k = 2). The entry ``remark`` is a text for the reader. The
    dictionary is empty if the readings do not determine the direction.
    """
    if not direction.is_determined:
        return {}
    return {
        "value": direction.angle_deg,
        "sd": direction.sd_deg,
        "name": name,
        "shown": shown,
        "kind": "direction",
        "unit": dsi_unit("deg"),
        "within": direction.within_U,
        "interval": None,
        "remark": _Remark.by(lambda words: words("remarks.axial", axis=axis)),
    }


def _principal_entries(principal: PrincipalStiffness) -> list[dict[str, Any]]:
    """Return a list of what the certificate file states about principal stiffnesses in space.

    The list has one dictionary for each principal stiffness. The entry ``remark`` of each
    dictionary states the principal axis in words, if the readings determine this axis. A stiffness
    is left out if only a lower limit of it is known.
    """
    entries = []
    for k, axis in enumerate(principal.axes, start=1):
        entry = _value_entry(f"k_{k}", f"k_{k}", "principal", axis.stiffness)
        if entry and axis.is_determined:
            entry["remark"] = _Remark.by(partial(principal_direction, axis))
        if entry:
            entries.append(entry)
    return entries


def _kind_of(name: str) -> str:
    """Return the kind of a parameter: slope, compliance or geometric (a geometric error).

    A slope is a coefficient of the change of a compliance with force. ``name`` is the name of the
    parameter.
    """
    if is_slope(name):
        return "slope"
    if is_compliance_or_slope(name):
        return "compliance"
    return "geometric"
