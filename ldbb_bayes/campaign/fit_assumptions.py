"""What a fit of a campaign will assume, such as its reference force, as remarks."""

from __future__ import annotations

from dataclasses import asdict

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.circular_test import setup_number
from ldbb_bayes.campaign.directions import runs_both_ways
from ldbb_bayes.campaign.placed_circles import radii_mm_of
from ldbb_bayes.campaign.remarks import Remark, RemarkKind, RemarkList
from ldbb_bayes.campaign.run_times import SECONDS_PER_TEST, time_source

__all__ = ["fit_assumptions"]


def fit_assumptions(campaign: Campaign) -> tuple[Remark, ...]:
    """Return remarks on what a fit of the campaign will assume, such as its reference force."""
    kinds = RemarkKind
    tests = campaign.tests
    machine = campaign.machine()
    law = campaign.force_law
    forces = campaign.forces_N
    setups = sorted({setup_number(test) for test in tests})
    both_ways = [plane for plane in machine.planes if runs_both_ways(campaign, plane)]
    clockings = {(test.work_ball_deg % 360.0, test.tool_ball_deg % 360.0) for test in tests}
    temperatures = {test.temperature_C for test in tests}
    remarks = RemarkList()
    remarks.add(
        kinds.MACHINE,
        topology=campaign.topology,
        plane=machine.plane,
        radii_mm=radii_mm_of(campaign),
    )
    remarks.add_if(campaign.frames_mm, kinds.FRAMES, frames_mm=dict(campaign.frames_mm))
    centres = {tuple(test.circle.centre_mm) for test in tests}
    remarks.add_if(len(centres) > 1, kinds.CENTRES, mean_mm=campaign.mean_centre_mm)
    remarks.add_if(len(setups) > 1, kinds.SETUPS, setups=setups)
    remarks.add_if(both_ways, kinds.BOTH_WAYS, planes=both_ways)
    _remark_on_drift(campaign, remarks)
    remarks.add_if(
        campaign.drift and None not in temperatures and len(temperatures) > 1, kinds.TEMPERATURES
    )
    remarks.add(kinds.READINGS, resolution_um=campaign.resolution_um)
    remarks.add(kinds.MOUNT, **asdict(campaign.mount))
    remarks.add(kinds.FORCES, slope_N_per_bar=law.slope_N_per_bar, offset_N=law.offset_N)
    remarks.add(kinds.REFERENCE, force_N=float(forces.min() + forces.max()) / 2)
    remarks.add(kinds.BALLS, clocked=len(clockings) > 1)
    return remarks.as_tuple()


def _remark_on_drift(campaign: Campaign, remarks: RemarkList) -> None:
    """Add a remark that says where the times of the tests come from.

    A fit uses these times to compute the drift of the bar's length and of the circle's centre.
    """
    number = len(campaign.tests)
    times_s = [test.time_s for test in campaign.tests if test.time_s is not None]
    span_min = None
    if len(times_s) == number:
        span_min = (max(times_s) - min(times_s)) / 60.0
    remarks.add_if(
        number > 1,
        RemarkKind.DRIFT,
        source=str(time_source(campaign)),
        tests=number,
        stated=len(times_s),
        span_min=span_min,
        pace_min=SECONDS_PER_TEST / 60.0,
    )
