"""Compute the standard uncertainties that further certificates of the instrument would leave."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ldbb_bayes.campaign.campaign import Ball, Instrument
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = ["CERTIFICATES", "uncertainty_with", "worth_of_certificates"]


# Certificates one could have, and what they would state.
CERTIFICATES: Mapping[str, Mapping[str, Any]] = {
    "balls of grade G10": {"work": Ball(grade="G10"), "tool": Ball(grade="G10")},
    "bar ± 1 µm": {"bar_U_um": 1.0},
    "mount ± 2 %": {"mount_U_percent": 2.0},
    "force ± 0.5 %, linearity 0.2 %, random 1 N": {
        "force_U_percent": 0.5,
        "force_linearity_percent": 0.2,
        "force_random_N": 1.0,
    },
    "angle ± 0.05°": {"angle_U_deg": 0.05},
}


def uncertainty_with(bound: BoundModel, instrument: Instrument, weight: Array, phi: Array) -> Array:
    """Standard uncertainty of every parameter that these certificates would leave, shape (p,) in
    inside units: the variance given φ (w, h) [mm], averaged by the weights (w,), as of
    `hyper_nodes`, that it has without them."""
    stated = BoundModel(
        bound.model, replace(bound.campaign, instrument=instrument), pilot=bound.pilot
    )
    return np.asarray(np.sqrt(weight @ stated.given(phi)[1].sd ** 2))


def worth_of_certificates(
    bound: BoundModel, weight: Array, phi: Array
) -> dict[str, dict[str, float]]:
    """Return standard uncertainties by what is certified and by parameter, inside units: with none
    of `CERTIFICATES`, with each there is none of yet, and with all of them; ``weight`` and ``phi``
    as of `hyper_nodes`."""
    own = bound.campaign.instrument
    none = Instrument()
    open_ = {
        name: stated
        for name, stated in CERTIFICATES.items()
        if all(getattr(own, k) == getattr(none, k) for k in stated)
    }
    if len(open_) > 1:
        open_ = {
            **open_,
            "all of these": {
                key: value for stated in open_.values() for key, value in stated.items()
            },
        }
    each = {"none of these": {}, **open_}
    left = {
        name: uncertainty_with(bound, replace(own, **stated), weight, phi)
        for name, stated in each.items()
    }
    return {name: dict(zip(bound.names, sd.tolist(), strict=True)) for name, sd in left.items()}
