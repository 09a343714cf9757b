"""What each certificate would be worth: U of every parameter with it, before the fit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ldbb_bayes.analysis.value_of_certificates import CERTIFICATES, worth_of_certificates
from ldbb_bayes.analysis.verdicts import hyper_parameter_nodes
from ldbb_bayes.app.fields import linear_model, read_files
from ldbb_bayes.report.fit_tables import two_digits
from ldbb_bayes.units import display_name, display_unit

__all__ = ["uncertainty_change", "worth"]

_MOST_EFFECTS = 4  # of a certificate that are shown: its largest reductions of U
_SMALLEST_EFFECT = 0.05  # relative reduction of U that is worth showing
_PIECES = {
    "work": "balls",
    "bar_U_um": "bar",
    "mount_U_percent": "mount",
    "force_U_percent": "force",
    "angle_U_deg": "angle",
}


def worth(folder: Path, choices: Mapping[str, str]) -> dict[str, Any]:
    """Return U (k = 2) of every parameter, today and with each certificate.

    Parameters
    ----------
    folder
        Of the session.
    choices
        What was typed, by the name of the entry.

    Returns
    -------
    dict
        ``today``: U as things are stated, of the linear model, before the fit; ``effects``: the
        largest reductions by piece of the instrument.

    Raises
    ------
    InputError
        Files or entries do not do.
    """
    bound = linear_model().bind(read_files(folder, choices).campaign)
    sd_by_certificate = worth_of_certificates(bound, *hyper_parameter_nodes(bound))
    today = sd_by_certificate.pop("none of these")
    units = {
        parameter.name: parameter.unit
        for parameter in bound.parameters
        if parameter.group != "slope"
    }
    effects = {}
    for certificate, sd in sd_by_certificate.items():
        piece = "all"
        if certificate in CERTIFICATES:
            piece = _PIECES[next(iter(CERTIFICATES[certificate]))]
        reductions = sorted(((1.0 - sd[name] / today[name], name) for name in units), reverse=True)
        rows = []
        for reduction, name in reductions[:_MOST_EFFECTS]:
            if reduction > _SMALLEST_EFFECT:
                rows.append(uncertainty_change(name, today[name], sd[name], units[name]))
        effects[piece] = {"name": certificate, "rows": rows}
    rows_today = [
        uncertainty_change(name, today[name], today[name], unit) for name, unit in units.items()
    ]
    return {"effects": effects, "today": rows_today}


def uncertainty_change(name: str, sd_before: float, sd_after: float, unit: str) -> dict[str, Any]:
    """Return U (k = 2) of a parameter before and after, in the unit for reading.

    Parameters
    ----------
    name
        Of the parameter.
    sd_before, sd_after
        Standard uncertainties, in the unit inside.
    unit
        The unit inside.

    Returns
    -------
    dict
        Name, unit, U before and after to two digits, and their ratio.
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
