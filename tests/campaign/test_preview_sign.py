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


def test_both_directions_of_travel_give_one_remark_on_the_larger_fall() -> None:
    falling_um = {"CW": [-4.0, -8.0, -12.0, -16.0], "CCW": [-4.0, -9.0, -14.0, -19.0]}
    tests = []
    for direction, means_um in falling_um.items():
        for test in straight(means_um).tests:
            tests.append(replace(test, direction=direction, name=f"{test.name} {direction}"))
    (values,) = signs_remarked(lb.Campaign(tuple(tests)))
    assert values["fall_um"] == pytest.approx(15.0)


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


def mirrored(campaign: lb.Campaign, index: int) -> lb.Campaign:
    tests = list(campaign.tests)
    tests[index] = times(campaign, -1.0).tests[index]
    return lb.Campaign(tuple(tests))


def straight(means_um: list[float]) -> lb.Campaign:
    """Return circles at 100, 200, … N, each with a constant reading but for a wave of two lobes."""
    angle_deg = np.arange(0.0, 360.0, 10.0)
    wave_um = np.cos(np.deg2rad(2.0 * angle_deg))
    tests = [
        lb.CircularTest(100.0 * (k + 1), angle_deg, reading_um=mean + wave_um, name=f"f{k + 1}00")
        for k, mean in enumerate(means_um)
    ]
    return lb.Campaign(tuple(tests))


def mirrored_remarked(campaign: lb.Campaign) -> list[dict[str, object]]:
    remarks = lb.check_campaign(campaign).remarks
    return [remark.values for remark in remarks if remark.kind == "sign of one test"]


def test_one_circle_with_the_other_sign_is_named() -> None:
    (values,) = mirrored_remarked(mirrored(straight([4.0, 8.0, 12.0, 16.0, 20.0]), 3))
    assert values["test"] == "f400"
    assert values["mean_um"] == pytest.approx(-16.0)
    assert values["expected_um"] == pytest.approx(16.0)


def test_the_sentence_on_it_says_which_reading_would_fit() -> None:
    sentences = lb.check_campaign(mirrored(straight([4.0, 8.0, 12.0, 16.0, 20.0]), 3)).details()
    assert (
        "The mean reading of f400 is −16.0 µm, but 16.0 µm would fit the other tests of its circle:"
        " check the sign of its readings."
    ) in " ".join(sentences.split())


@pytest.mark.parametrize(
    "means_um",
    [
        [4.0, 8.0, 12.0, 16.0, 20.0],
        [4.0, 8.0, 12.0, 30.0, 20.0],  # another zero, which is no sign
        [-2.0, -1.0, 0.0, 1.0, 2.0],  # too small to tell
        [4.0, -8.0, 12.0, -16.0, 20.0],  # the others lie on no line either
        [4.0, 8.0, -12.0],  # too few to expect anything
    ],
)
def test_nothing_else_is_taken_for_the_other_sign(means_um: list[float]) -> None:
    assert mirrored_remarked(straight(means_um)) == []


def test_no_circle_of_the_recovered_experiment_has_the_other_sign(recovered: lb.Campaign) -> None:
    assert mirrored_remarked(recovered) == []
