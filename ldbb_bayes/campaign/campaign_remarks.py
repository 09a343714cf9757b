"""What looks odd in a campaign as a whole, such as equal forces or the sign of its readings."""

from __future__ import annotations

from collections import Counter
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.directions import runs_both_ways
from ldbb_bayes.campaign.placed_circles import radii_mm_of
from ldbb_bayes.campaign.remarks import Remark, RemarkKind, RemarkList

__all__ = ["campaign_remarks"]

# Usual range of a campaign's largest force [N]. If the force is outside this range, the unit of the
# forces is probably wrong.
_FORCES_N = (5.0, 10_000.0)
# Usual range of a circle's radius [mm]. If the radius is outside this range, its unit is probably
# wrong.
_RADII_MM = (10.0, 2000.0)
# The preview examines the sign of the readings if at least `_FEWEST_FOR_SIGN` tests were run on the
# same circle. Only tests that cover more than `_WHOLE_TURN_DEG` [deg] are counted. A remark is made
# if the mean reading falls by more than `_SMALLEST_FALL_UM` [µm] from the smallest to the largest
# force, and if its correlation with the force is below `_FALLING`.
_FEWEST_FOR_SIGN = 3
_WHOLE_TURN_DEG = 340.0
_SMALLEST_FALL_UM = 2.0
_FALLING = -0.95
# One test seems to have the other sign if its mean reading is the negative of the value expected
# from the other tests of its circle, within this fraction of that value. The expected value must be
# at least `_LEAST_MIRRORED_UM` [µm]: below it, a zero that was set anew could do the same.
_MIRRORED_WITHIN = 0.25
_LEAST_MIRRORED_UM = 5.0


def campaign_remarks(campaign: Campaign) -> tuple[Remark, ...]:
    """Return remarks on odd properties of the campaign as a whole, such as equal forces."""
    kinds = RemarkKind
    remarks = RemarkList()
    remarks.add_if(campaign.force_levels == 1, kinds.ONE_LEVEL)
    remarks.add_if(campaign.force_levels == 2, kinds.TWO_LEVELS)
    largest_force = float(campaign.forces_N.max())
    _remark_on_unit("the largest force", largest_force, "N", _FORCES_N, remarks)
    for radius in radii_mm_of(campaign):
        _remark_on_unit("a radius", radius, "mm", _RADII_MM, remarks)
    if not campaign.is_plan:
        remarks.add_if(
            campaign.foreseen,
            kinds.NOT_RUN,
            forces_N=[float(test.force_N or 0.0) for test in campaign.foreseen],
            run=len(campaign.tests),
        )
        for first, second in combinations(campaign.tests, 2):
            is_copy = np.array_equal(first.reading_um, second.reading_um)
            remarks.add_if(is_copy, kinds.COPY, first=first.name, second=second.name)
        _remark_on_sign(campaign, remarks)
        _remark_on_mirrored_tests(campaign, remarks)
    planes = campaign.machine().planes
    for plane in planes:
        first_axis, second_axis = sorted(plane)
        remarks.add_if(
            not runs_both_ways(campaign, plane),
            kinds.ONE_WAY,
            compliance=f"C_{first_axis}{second_axis}{first_axis}",
            plane=plane if len(planes) > 1 else "",
        )
    circles = {(test.setup, test.plane, test.circle.centre_mm) for test in campaign.tests}
    circles_by_setup = Counter(setup or 1 for setup, _, _ in circles)
    for setup, number in sorted(circles_by_setup.items()):
        remarks.add_if(number > 1, kinds.PLACES, setup=setup)
    _remark_on_certificates(campaign, remarks)
    return remarks.as_tuple()


def _remark_on_certificates(campaign: Campaign, remarks: RemarkList) -> None:
    """Add remarks on certificates that the model uses beyond what they usually certify.

    The bar has another length at each radius, but the campaign states one certificate. A ball
    touches along another great circle in each plane, but its harmonics are those of one trace.
    """
    instrument = campaign.instrument
    is_bar_stated = instrument.bar_U_um is not None
    radii = [f"{radius:g}" for radius in radii_mm_of(campaign)]
    remarks.add_if(is_bar_stated and len(radii) > 1, RemarkKind.ONE_BAR, radii=" and ".join(radii))
    planes = list(campaign.machine().planes)
    balls = {"work ball": instrument.work, "tool ball": instrument.tool}
    for name, ball in balls.items():
        is_trace_shared = bool(ball.harmonics_um) and len(planes) > 1
        remarks.add_if(
            is_trace_shared, RemarkKind.ONE_TRACE, ball=name, planes=" and ".join(planes)
        )


class _MeanReading(NamedTuple):
    """Mean reading of a test that covers the whole circle."""

    name: str
    force_N: float
    mean_um: float


def _means_of_circles(campaign: Campaign) -> list[list[_MeanReading]]:
    """Return the mean readings of tests, a list for each circle, set-up and direction of travel."""
    means_of_circle: dict[Any, list[_MeanReading]] = {}
    for test, test_force_N in zip(campaign.tests, campaign.forces_N, strict=True):
        circle = (test.circle, test.setup, test.direction)
        if test.reading_um is not None and test.arc_deg > _WHOLE_TURN_DEG:
            mean = _MeanReading(test.name, float(test_force_N), float(np.mean(test.reading_um)))
            means_of_circle.setdefault(circle, []).append(mean)
    return list(means_of_circle.values())


def _remark_on_mirrored_tests(campaign: Campaign, remarks: RemarkList) -> None:
    """Add a remark on each test whose mean reading has the other sign than its neighbours'.

    What to expect of a test is a straight line over force through the mean readings of the other
    tests of its circle, which must lie on that line themselves.
    """
    for means in _means_of_circles(campaign):
        for mean in means:
            others = [other for other in means if other is not mean]
            other_N = np.array([other.force_N for other in others])
            other_um = np.array([other.mean_um for other in others])
            if len(others) < _FEWEST_FOR_SIGN or np.ptp(other_N) == 0.0:
                continue
            line = np.polyfit(other_N, other_um, 1)
            expected_um = float(np.polyval(line, mean.force_N))
            tolerance_um = _MIRRORED_WITHIN * abs(expected_um)
            largest_residual_um = np.max(np.abs(other_um - np.polyval(line, other_N)))
            is_opposite = abs(mean.mean_um + expected_um) <= tolerance_um
            others_agree = largest_residual_um <= tolerance_um
            remarks.add_if(
                abs(expected_um) >= _LEAST_MIRRORED_UM and is_opposite and others_agree,
                RemarkKind.MIRRORED,
                test=mean.name,
                mean_um=mean.mean_um,
                expected_um=expected_um,
            )


def _remark_on_sign(campaign: Campaign, remarks: RemarkList) -> None:
    """Add one remark if the mean reading on a circle falls as the force rises.

    Tests are compared with each other if they have the same circle (plane, centre and radius),
    set-up and direction of travel. The bar pushes tool and table apart, so that the mean reading
    must rise with the force. If the mean reading falls, the sign of the readings is probably wrong.
    The remark states the largest fall, because the cure is the same for all circles.
    """
    falls = []
    for means in _means_of_circles(campaign):
        if len(means) < _FEWEST_FOR_SIGN:
            continue
        force_N = np.array([mean.force_N for mean in means])
        mean_um = np.array([mean.mean_um for mean in means])
        if np.ptp(force_N) == 0.0 or np.ptp(mean_um) == 0.0:
            continue
        fall_um = -float(np.polyfit(force_N, mean_um, 1)[0] * np.ptp(force_N))
        correlation = float(np.corrcoef(force_N, mean_um)[0, 1])
        if fall_um > _SMALLEST_FALL_UM and correlation < _FALLING:
            falls.append(
                {
                    "fall_um": fall_um,
                    "low_N": float(force_N.min()),
                    "high_N": float(force_N.max()),
                }
            )
    if falls:
        largest = max(falls, key=lambda fall: fall["fall_um"])
        remarks.add(RemarkKind.SIGN, **largest)


def _remark_on_unit(
    quantity: str, value: float, unit: str, usual: tuple[float, float], remarks: RemarkList
) -> None:
    """Add a remark if a value is outside its usual range, which suggests a wrong unit.

    ``quantity`` is the name of the quantity, ``value`` its value in ``unit``, and ``usual`` holds
    the two ends of its usual range. The remark is added to ``remarks``.
    """
    smallest, largest = usual
    is_usual = smallest <= value <= largest
    remarks.add_if(not is_usual, RemarkKind.UNIT, what=quantity, value=value, unit=unit)
