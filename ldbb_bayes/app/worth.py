"""Effect of each possible calibration certificate of the instrument on the uncertainties U.

U is the expanded uncertainty (k = 2) of a parameter. The effects are forecast before the fit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ldbb_bayes.analysis.hyper_parameter_nodes import hyper_parameter_nodes
from ldbb_bayes.analysis.value_of_certificates import (
    CERTIFICATES,
    missing_certificates,
    worth_of_certificates,
)
from ldbb_bayes.app.fields import linear_model, read_files
from ldbb_bayes.inference.contradicted_certificates import contradicted_certificates
from ldbb_bayes.units import display_name, display_unit, two_digits

__all__ = ["effects_of_certificates", "uncertainty_change"]

# largest number of parameters whose uncertainties the browser page shows for a new certificate
_MOST_EFFECTS = 4
# A new certificate reduces the expanded uncertainties U of parameters. The browser page shows a
# parameter only if its U is reduced by at least this fraction.
_SMALLEST_EFFECT = 0.05
# Part of the instrument to which each attribute of the instrument belongs. The value of an
# attribute is known from the calibration certificate of the part.
_PARTS = {
    "work": "balls",
    "tool": "balls",
    "bar_U_um": "bar",
    "mount_U_percent": "mount",
    "force_U_percent": "force",
    "angle_U_deg": "angle",
}


def effects_of_certificates(folder: Path, entries: Mapping[str, str]) -> dict[str, Any]:
    """Return the uncertainties U of parameters, and their largest reductions by new certificates.

    The certificates are calibration certificates of the instrument. U is the expanded uncertainty
    (k = 2) that is expected from a fit with linear compliance. Slopes (changes of compliance with
    force) are left out.

    Parameters
    ----------
    folder
        Folder of the session (one browser tab).
    entries
        Texts typed on the page; the keys are the names of the entry fields.

    Returns
    -------
    dict
        ``today`` is a list with one row for every parameter, which states U with the certificates
        that the user has stated so far. ``contradicted`` are the names of certificates that the
        readings contradict. ``effects`` is a dict with one entry for each new
        certificate. The key is the part of the instrument that the certificate would cover, or
        ``all`` for all certificates together. The value holds the name of the certificate, and up
        to four rows: one for each of the largest reductions of U, if U is reduced by more than 5 %.
        Every row is a dict that `uncertainty_change` returns.

    Raises
    ------
    InputError
        If a file or an entry cannot be used.
    """
    campaign = read_files(folder, entries).campaign
    bound = linear_model().bind(campaign)
    nodes = hyper_parameter_nodes(bound)
    missing = missing_certificates(campaign.instrument)
    contradicted = contradicted_certificates(bound, missing, *nodes)
    sd_by_certificate = worth_of_certificates(bound, *nodes, contradicted=contradicted)
    today = sd_by_certificate.pop("none of these")
    units = {
        parameter.name: parameter.unit
        for parameter in bound.parameters
        if parameter.group != "slope"
    }
    effects = {}
    for certificate, sd in sd_by_certificate.items():
        part = _part_of_instrument(certificate)
        reductions = sorted(((1.0 - sd[name] / today[name], name) for name in units), reverse=True)
        rows = []
        for reduction, name in reductions[:_MOST_EFFECTS]:
            if reduction > _SMALLEST_EFFECT:
                rows.append(uncertainty_change(name, today[name], sd[name], units[name]))
        effects[part] = {"name": certificate, "rows": rows}
    rows_today = [
        uncertainty_change(name, today[name], today[name], unit) for name, unit in units.items()
    ]
    return {"effects": effects, "today": rows_today, "contradicted": contradicted}


def _part_of_instrument(certificate: str) -> str:
    """Return the part of the instrument that a certificate would cover, such as ``bar``.

    ``certificate`` is the name of the certificate. The result is ``all`` for the name that stands
    for all certificates together.
    """
    if certificate not in CERTIFICATES:
        return "all"
    first_attribute = next(iter(CERTIFICATES[certificate]))
    return _PARTS[first_attribute]


def uncertainty_change(name: str, sd_before: float, sd_after: float, unit: str) -> dict[str, Any]:
    """Return the expanded uncertainty U (k = 2) of a parameter before and after a change.

    The change is a new calibration certificate, or further tests.

    Parameters
    ----------
    name
        Name of the parameter.
    sd_before, sd_after
        Standard uncertainties before and after the change, in the internal unit (mm, N, rad).
    unit
        Internal unit of the parameter.

    Returns
    -------
    dict
        Name, display unit such as nm/N, U before and after the change with two digits, and a ratio.
        The ratio is U after the change divided by U before it, but at most 2. It is 1 if U before
        the change is zero or infinite.
    """
    factor, label = display_unit(unit)
    share = 1.0
    if 0.0 < sd_before < math.inf:
        share = sd_after / sd_before
    return {
        "before": two_digits(2.0 * sd_before, factor),
        "after": two_digits(2.0 * sd_after, factor),
        "name": display_name(name),
        "unit": label,
        "share": round(min(share, 2.0), 3),
    }
