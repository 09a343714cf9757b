"""Reference sd of a parameter: its kind's default prior, whatever prior the campaigns were fitted with.

The campaigns' priors are divided out of their likelihoods and must not come back as the unit in which changes of a machine and
spreads of a fleet are expected: how well a population tells the next machine is not how far a loosened joint may go.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.machine.names import ComplianceName, GeometricKind, GeometricName
from ldbb_bayes.model.prior import Prior, geometric_unit

__all__ = ["reference_sd"]

Array = NDArray[Any]
_COMPLIANCE = re.compile(r"C_([XYZABC])([XYZABC])([XYZ])")


def reference_sd(names: Sequence[str], units: Sequence[str], prior_mean: Array, prior_sd: Array) -> Array:
    """Reference sd of every parameter, shape (c,), in inside units.

    The default prior's; where fits had a wider one about zero, its median over them: a compliance that stands for those of
    several joints is larger, and a user may know of machines that are. A prior about another mean says how well a parameter
    is known, not how large it is, and does not count.

    Parameters
    ----------
    prior_mean, prior_sd : ndarray, shape (n, c)
        Of the fits, each at its own reference force.
    """
    found = np.empty(len(names))
    for j, (name, unit) in enumerate(zip(names, units, strict=True)):
        own = prior_sd[prior_mean[:, j] == 0.0, j]
        usual = _default_sd(name, unit)
        wide = float(np.median(own if own.size else prior_sd[:, j])) if own.size or usual is None else 0.0
        found[j] = max(usual or 0.0, wide)
    return found


def _default_sd(name: str, unit: str) -> float | None:
    """Of a compliance by its name, of a geometric error by its unit; none of what is neither."""
    prior = Prior.default()
    match = _COMPLIANCE.fullmatch(name)
    if match is not None:
        return float(prior.compliance_sd([ComplianceName(*match.groups())], 0, 1.0)[0])
    kinds = {geometric_unit(kind): kind for kind in get_args(GeometricKind)}
    return float(prior.geometric_sd([GeometricName("X", "X", kinds[unit])])[0]) if unit in kinds else None
