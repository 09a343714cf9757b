"""Circles whose readings are in another unit than stated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.campaign.unlikely_spans import unlikely_spans

ANGLE_DEG = np.arange(0.0, 360.0)


def of_circle(reading_um: object, resolution_um: float = 0.24) -> lb.Campaign:
    test = lb.CircularTest(36.0, ANGLE_DEG, reading_um, name="a")
    return lb.Campaign((test,), resolution_um=resolution_um)


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_a_factor_of_1000_is_doubted_in_every_circle_that_has_it(factor: float) -> None:
    campaign = simulated(plan())
    scaled = [test.with_reading_um(factor * np.asarray(test.reading_um)) for test in campaign.tests]
    spans = unlikely_spans(replace(campaign, tests=tuple(scaled)))
    assert [span.test for span in spans] == [test.name for test in campaign.tests]
    (alone,) = unlikely_spans(replace(campaign, tests=(*campaign.tests[:-1], scaled[-1])))
    assert alone.test == campaign.tests[-1].name
    assert not unlikely_spans(campaign)
    assert not unlikely_spans(plan())


def test_a_perfect_circle_on_a_stiff_machine_is_not_doubted(rng: np.random.Generator) -> None:
    """Nothing but noise of 0.02 µm, or one step of a readout of 0.1 µm."""
    assert not unlikely_spans(of_circle(0.02 * rng.standard_normal(360)))
    for level in range(-50, 50):
        steps = (level + (ANGLE_DEG > 180.0)) * 0.1
        assert not unlikely_spans(of_circle(steps, 0.1))


def test_a_coarse_readout_may_stand_still() -> None:
    assert not unlikely_spans(of_circle(np.zeros(360), 1.0))
    assert unlikely_spans(of_circle(np.zeros(360), 0.1))


def test_a_spike_is_no_question_of_the_unit() -> None:
    reading_um = 10.0 * np.cos(np.deg2rad(2.0 * ANGLE_DEG))
    reading_um[7] = 9999.0
    assert not unlikely_spans(of_circle(reading_um))
