"""Shift of the circles' centre with force, tested along each axis of the machine."""

from __future__ import annotations

import numpy as np
from scipy.special import stdtr

from ldbb_bayes.inference.coefficients import machine_coefficients
from ldbb_bayes.inference.residuals import reduced_residuals
from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.model.fourier import harmonic_index
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = ["SHIFTED", "centre_shift"]

# Significance level for a shift of the circles' centre with force. A shift is reported if its
# p-value, multiplied by the number of p-values (Bonferroni), is below this level. There is one
# p-value for each of the two axes of every plane.
SHIFTED = 0.01
# A shift of the circles' centre with force is checked only in planes with at least this many tests.
_FEWEST_TESTS = 4
# A shift of the circles' centre with force is checked only in planes that were tested at this many
# different forces or more.
_FEWEST_FORCES = 3
# Number of Fourier functions that are fitted to find the centre: those of the orders 0 to 2. What
# the mount (order 0) and a gain of the force (order 2) add in proportion to the force would
# otherwise look like a shift of the centre on an arc.
_COLUMNS = 5
# A smaller standard error of the slope of the centre's position over force is replaced by this
# number, so that there is no division by zero.
_SMALLEST_SD = 1e-300


def centre_shift(bound: BoundModel, beta: Array) -> dict[str, float]:
    """Return the machine axes along which the centre of the circles shifts with force.

    The position of the centre along an axis is a Fourier coefficient of order 1, fitted by least
    squares together with the orders 0 and 2. The shift that the parameters ``beta``, shape (p,),
    explain is first subtracted. Then a p-value is computed for each plane and each of its two axes,
    by Student's t-test of the slope of the position over force. Only planes with at least four
    tests and at least three different forces are checked. An axis is reported if its smallest
    p-value in any plane, multiplied by the number of all p-values (Bonferroni), is below 1 %. The
    result is a dict; its keys are the reported axes, and its values are their smallest p-values.
    ``bound`` is the model of the campaign.
    """
    residuals = reduced_residuals(bound, machine_coefficients(bound, beta[None])[0])
    harmonics = []
    for reduced, residual in zip(bound.reduced, residuals, strict=True):
        harmonics.append(np.linalg.lstsq(reduced.factor[:, :_COLUMNS], residual)[0])
    # p-values, one for each machine axis of each plane, of the hypothesis that the centre of the
    # circles does not shift along this axis when the force changes. The keys are pairs (plane,
    # axis).
    p_values: dict[tuple[str, str], float] = {}
    for plane, _, in_plane in bound.setting.groups_by("plane"):
        force = bound.setting.force_N[in_plane]
        if len(force) < _FEWEST_TESTS or len(np.unique(force)) < _FEWEST_FORCES:
            continue
        for axis, k in zip(PLANES[plane], harmonic_index(1), strict=False):
            centre = np.array([harmonics[r][k] for r in np.flatnonzero(in_plane)])
            p_values[plane, axis] = _p_value_of_no_slope(force, centre)
    shifted: dict[str, float] = {}
    for (_, axis), p in p_values.items():
        if p * len(p_values) < SHIFTED:
            shifted[axis] = min(p, shifted.get(axis, 1.0))
    return shifted


def _p_value_of_no_slope(force: Array, values: Array) -> float:
    """Return the p-value of the hypothesis that a quantity does not change with force.

    The p-value is two-sided, from Student's t-test of the slope of a straight line fitted by least
    squares. ``values``, shape (n,), holds the quantity at the n forces ``force``.
    """
    lever = force - force.mean()
    freedom = max(len(force) - 2, 1)
    slope = lever @ values / (lever @ lever)
    residual = values - values.mean() - slope * lever
    slope_sd = np.sqrt(residual @ residual / freedom / (lever @ lever))
    return float(2.0 * stdtr(freedom, -abs(slope) / max(slope_sd, _SMALLEST_SD)))
