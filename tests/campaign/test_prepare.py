"""Mount compensation, masks and trimming."""

from __future__ import annotations

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.campaign.prepare import fill_force_and_pressure
from ldbb_bayes.errors import InputError


def recording(start: float = -30.0, stop: float = 390.0, step: float = 1.0) -> lb.CircularTest:
    angle = np.arange(start, stop, step)
    return lb.CircularTest(force_N=36.0, angle_deg=angle, reading_um=np.sin(np.deg2rad(angle)), name="a")


def test_compensation_is_equation_32() -> None:
    raw = lb.Campaign((recording(),), mount=lb.MountCompensation(compensated=False))
    done = lb.compensate_mount(raw)
    pressure = (36.0 + 14.2) / 126.04
    np.testing.assert_allclose(done.tests[0].reading_um, raw.tests[0].reading_um - 2.33 * pressure)
    assert done.mount.compensated
    with pytest.raises(InputError, match="applied once"):
        lb.compensate_mount(done)


def test_force_law_both_ways() -> None:
    law = lb.ForceLaw()
    for pressure, force in ((0.4, 36.0), (1.0, 112.0), (2.0, 238.0), (3.0, 364.0), (4.0, 490.0), (5.0, 616.0), (6.0, 742.0)):
        assert law.force_N(pressure) == pytest.approx(force, abs=0.3)
        assert law.pressure_bar(law.force_N(pressure)) == pytest.approx(pressure)
    filled = fill_force_and_pressure(lb.Campaign((recording(),)))
    assert filled.tests[0].pressure_bar == pytest.approx(law.pressure_bar(36.0))
    with pytest.raises(InputError, match="positive finite slope"):
        lb.ForceLaw(slope_N_per_bar=0.0)


def test_reversal_points_are_masked() -> None:
    test = lb.mask_reversals(recording(0.0, 360.0), 5.0)
    distance = np.abs((test.angle_deg + 45.0) % 90.0 - 45.0)
    assert distance.min() > 5.0
    assert len(test.angle_deg) == 360 - 4 * 11
    with pytest.raises(InputError, match="between 0 and 45"):
        lb.mask_reversals(recording(), 60.0)


def test_arcs_may_run_through_zero() -> None:
    test = lb.mask_angles(recording(0.0, 360.0), [(350.0, 370.0), (100.0, 110.0)])
    kept = set(test.angle_deg)
    assert 355.0 not in kept
    assert 5.0 not in kept
    assert 105.0 not in kept
    assert {11.0, 99.0, 111.0, 349.0} <= kept
    with pytest.raises(InputError, match="must leave readings"):
        lb.mask_angles(recording(), [(0.0, 360.0)])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_overshoot_is_trimmed_to_one_pass(sign: float) -> None:
    test = recording()
    test = lb.CircularTest(force_N=36.0, angle_deg=sign * test.angle_deg, reading_um=test.reading_um)
    trimmed = lb.trim_overshoot(test)
    assert len(trimmed.angle_deg) == 360
    assert len(np.unique(np.round(trimmed.angle_deg % 360.0, 6))) == 360
    started = lb.trim_overshoot(test, start_deg=0.0)
    assert started.angle_deg[0] == 0.0
    with pytest.raises(InputError, match="recording must span"):
        lb.trim_overshoot(test, arc_deg=800.0)


@pytest.mark.parametrize("start", [150.0, -100.0])
def test_a_pass_must_lie_in_the_recording(start: float) -> None:
    with pytest.raises(InputError, match="start_deg must leave 360° of recording"):
        lb.trim_overshoot(recording(), start_deg=start)


def test_a_plan_cannot_be_compensated() -> None:
    planned = lb.Campaign((recording(),), mount=lb.MountCompensation(compensated=False)).plan()
    with pytest.raises(InputError, match="got a plan"):
        lb.compensate_mount(planned)
