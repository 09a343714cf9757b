"""Stiffnesses, compliances and directions as they are stated: a value with its uncertainty.

They are computed from posterior draws. A stiffness is the inverse of a compliance; where the
readings hardly determine the compliance, only a lower limit of the stiffness is stated. A direction
in a plane and its opposite are equivalent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ldbb_bayes.inference.summary import interval_numbers
from ldbb_bayes.results import Array, Number, Result

__all__ = [
    "HARDLY_POSITIVE",
    "AxialDirection",
    "StatedValue",
    "above_zero",
    "axial_direction",
    "is_hardly_positive",
    "stated_stiffness",
    "stated_value",
    "stiffness_from",
]

# Only a lower limit of the stiffness is stated if the readings hardly determine the compliance.
# This is the case if the lower end of its credible interval is at most this share of its median.
HARDLY_POSITIVE = 0.2
# Lower limit for draws of a compliance, as a fraction of the median of their absolute values.
# Smaller draws are replaced by this limit before they are inverted to stiffnesses. Otherwise, the
# few draws near zero would dominate the standard deviation of the stiffness.
_SMALLEST_SHARE = 0.1
# A direction counts as not determined if its credible interval is at least this wide [°]. An
# interval of this width may contain both axes of the plane.
_WIDEST_DEG = 90.0


@dataclass(frozen=True)
class StatedValue(Result):
    """A stiffness, a compliance or a ratio of stiffnesses, with its uncertainty.

    The uncertainty is stated as standard uncertainty, expanded uncertainty and credible interval.
    """

    #: unit of a stiffness (N/mm) or of a compliance (mm/N); empty for a ratio of two stiffnesses
    unit: str
    mean: Number  #: posterior mean of a stiffness, compliance or ratio of stiffnesses
    #: standard uncertainty u of a stiffness, compliance or ratio of stiffnesses: its posterior sd
    sd: Number
    U_k2: Number  #: expanded uncertainty U = 2 u of a stiffness, compliance or ratio of stiffnesses
    median: Number  #: posterior median of a stiffness, compliance or ratio of stiffnesses
    #: lower end of the equal-tailed credible interval of a stiffness, compliance or ratio of
    #: stiffnesses
    ci_low: Number
    #: upper end of the equal-tailed credible interval of a stiffness, compliance or ratio of
    #: stiffnesses
    ci_high: Number
    #: share of the posterior draws that lie within mean ± U, where U is the expanded uncertainty
    within_U: float
    #: share of the posterior draws that lie within median ± U, where U is the expanded uncertainty
    within_U_of_median: float
    #: whether the readings determine only the lower end of the credible interval of a stiffness;
    #: this is the case if the compliance may be nearly zero
    only_lower_limit: bool = False

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper end of the credible interval of a stiffness, compliance or ratio."""
        return self.ci_low, self.ci_high


@dataclass(frozen=True)
class AxialDirection(Result):
    """A direction in a plane, as an angle from the plane's first axis, with its uncertainty.

    A direction and its opposite are equivalent. The mean direction is therefore computed from
    exp(2iθ): it is half the argument of the mean of this complex number over posterior draws of the
    direction θ. Each end of the credible interval is the equivalent angle that is nearest to the
    mean direction. An end can therefore lie below 0° or above 180°.
    """

    #: posterior mean of a direction in a plane: its angle from the plane's first axis, 0° to 180°
    angle_deg: float
    #: standard uncertainty u of a direction in a plane [°]: root mean square of the angles between
    #: the posterior draws of the direction and the mean direction
    sd_deg: float
    U_deg: float  #: expanded uncertainty U = 2 u of a direction in a plane [°]
    #: lower end of the equal-tailed credible interval of a direction in a plane [°]
    ci_low_deg: float
    #: upper end of the equal-tailed credible interval of a direction in a plane [°]
    ci_high_deg: float
    #: share of the posterior draws of a direction that lie within the mean direction ± U, where U
    #: is the expanded uncertainty
    within_U: float
    #: absolute value of the mean of exp(2iθ) over posterior draws of the direction θ: 1 if all
    #: draws agree, 0 if every direction is equally likely
    concentration: float
    #: whether the credible interval of a direction, such as the softest direction of a plane, is
    #: narrower than 90°. If not, the readings do not determine the direction, and the mean
    #: direction must not be used.
    is_determined: bool


def stated_stiffness(compliance: Array, prob: float) -> StatedValue:
    """Return the stiffness, computed as the inverse of posterior draws of a compliance [mm/N].

    If the compliance may be nearly zero, only the lower end of the stiffness's credible interval is
    determined; the result states this. ``prob`` is the probability of the interval.
    """
    return stated_value(
        "N/mm", stiffness_from(compliance), prob, is_hardly_positive(compliance, prob)
    )


def stiffness_from(compliance: Array) -> Array:
    """Return draws of a stiffness from draws of a compliance, shape (draws,).

    Draws of the compliance near or below zero are first replaced by a small positive value.
    """
    return np.asarray(1.0 / above_zero(compliance))


def above_zero(compliance: Array) -> Array:
    """Return draws of a compliance, with all values near or below zero replaced.

    The smallest value allowed is ``_SMALLEST_SHARE`` times the median of the draws' absolute
    values. Smaller draws are replaced by this positive value. The inverse of the result, a
    stiffness, is therefore finite.
    """
    floor = _SMALLEST_SHARE * np.median(np.abs(compliance))
    return np.maximum(compliance, max(floor, np.finfo(float).tiny))


def is_hardly_positive(compliance: Array, prob: float) -> bool:
    """Return whether the readings leave it doubtful that a compliance is above zero.

    This is the case if the lower end of its credible interval is at most a small share of its
    median. ``compliance``, shape (draws,), are posterior draws, and ``prob`` is the probability of
    the equal-tailed interval.
    """
    low, median = np.quantile(compliance, [0.5 * (1.0 - prob), 0.5])
    return bool(low <= HARDLY_POSITIVE * median)


def stated_value(
    unit: str, draws: Array, prob: float, only_lower_limit: bool = False
) -> StatedValue:
    """Return a stiffness, compliance or ratio with its uncertainty, from posterior draws.

    ``draws``, shape (draws,), are in the unit ``unit``, and ``prob`` is the probability of the
    equal-tailed interval. ``only_lower_limit`` states whether the readings determine only the lower
    end of this interval.
    """
    numbers = interval_numbers(draws, prob)
    return StatedValue(
        unit=unit,
        mean=numbers["mean"],
        sd=numbers["sd"],
        U_k2=2.0 * numbers["sd"],
        median=numbers["median"],
        ci_low=numbers["ci_low"],
        ci_high=numbers["ci_high"],
        within_U=_share_within(draws - numbers["mean"], 2.0 * numbers["sd"]),
        within_U_of_median=_share_within(draws - numbers["median"], 2.0 * numbers["sd"]),
        only_lower_limit=only_lower_limit,
    )


def _share_within(deviation: Array, expanded: float) -> float:
    """Return the share of a quantity's posterior draws within value ± expanded uncertainty.

    ``deviation``, shape (draws,), holds the draws minus the value that is stated, such as their
    mean, and ``expanded`` is the expanded uncertainty.
    """
    return float(np.mean(np.abs(deviation) <= expanded))


def axial_direction(angle_rad: Array, prob: float) -> AxialDirection:
    """Return the mean direction and its uncertainty, from posterior draws of an angle.

    ``angle_rad``, shape (draws,), holds draws of the angle [rad]; opposite directions are
    equivalent. ``prob`` is the probability of the credible interval.
    """
    resultant = np.exp(2j * angle_rad).mean()
    mean_deg = float(np.degrees(0.5 * np.angle(resultant))) % 180.0
    deviation_deg = (np.degrees(angle_rad) - mean_deg + 90.0) % 180.0 - 90.0
    tail = 0.5 * (1.0 - prob)
    low, high = np.quantile(deviation_deg, [tail, 1.0 - tail]).tolist()
    sd_deg = float(np.sqrt(np.mean(deviation_deg**2)))
    return AxialDirection(
        angle_deg=mean_deg,
        sd_deg=sd_deg,
        U_deg=2.0 * sd_deg,
        ci_low_deg=mean_deg + low,
        ci_high_deg=mean_deg + high,
        within_U=_share_within(deviation_deg, 2.0 * sd_deg),
        concentration=float(abs(resultant)),
        is_determined=high - low < _WIDEST_DEG,
    )
