"""A mean reading that falls with force is noticed: the sign of the readings is wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb


def signs_remarked(campaign: lb.Campaign) -> list[dict[str, object]]:
    remarks = lb.check_campaign(campaign).remarks
    return [remark.values for remark in remarks if remark.kind == "sign"]


def times(campaign: lb.Campaign, factor: float) -> lb.Campaign:
    tests = []
    for test in campaign.tests:
        assert test.reading_um is not None
        tests.append(replace(test, reading_um=factor * np.asarray(test.reading_um)))
    return lb.Campaign(tuple(tests))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_readings_with_the_wrong_sign_are_noticed(seed: int) -> None:
    (values,) = signs_remarked(times(simulated(plan(), seed=seed), -1.0))
    assert float(str(values["fall_um"])) > 2.0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_readings_with_the_right_sign_are_not(seed: int) -> None:
    assert signs_remarked(simulated(plan(), seed=seed)) == []


def test_nor_are_those_of_the_recovered_experiment(recovered: lb.Campaign) -> None:
    assert signs_remarked(recovered) == []


def test_circles_without_their_mean_say_nothing() -> None:
    tests = []
    for test in simulated(plan()).tests:
        reading_um = np.asarray(test.reading_um)
        tests.append(replace(test, reading_um=np.mean(reading_um) - reading_um))
    assert signs_remarked(lb.Campaign(tuple(tests))) == []
