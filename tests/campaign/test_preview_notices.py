"""What a look at the readings notices before anything is fitted."""

from __future__ import annotations

import re

import numpy as np
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.campaign.preview import RemarkKind
from ldbb_bayes.report.wording import remark_words


def odd(**changes: object) -> lb.Campaign:
    angle = np.arange(0.0, 360.0, 1.0)
    fields = {"force_N": 300.0, "angle_deg": angle, "reading_um": 0.1 * np.sin(37 * np.deg2rad(angle)), "name": "a"} | changes
    return lb.Campaign((lb.CircularTest(**fields),))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "remark"),
    [
        ({"direction": "CW"}, "stated CW, but the angles run CCW"),
        ({"angle_deg": np.linspace(0, 220, 360)}, "arc of 220° only"),
        ({"angle_deg": np.linspace(0, 300, 360)}, "arc of 300° only"),
        ({"reading_um": np.linspace(0, 30, 360)}, "start and end differ by +30.0 µm"),
        ({"reading_um": np.zeros(360)}, "all readings equal"),
        ({"pressure_bar": 6.0}, "force 300 N, but the force law gives 742 N at 6 bar"),
    ],
)
def test_preview_notices(changes: dict, remark: str) -> None:
    seen = lb.preview(odd(**changes))
    assert any(remark in remark_words(found) for found in seen.tests[0].remarks)
    assert any("One force level" in remark_words(found) for found in seen.remarks)


def test_preview_notices_spikes_copies_and_units() -> None:
    campaign = simulated(plan((720,) * 4))
    reading = campaign.tests[1].reading_um.copy()
    reading[100] += 50.0
    tests = (campaign.tests[0], campaign.tests[1].with_reading_um(reading), campaign.tests[2], campaign.tests[3])
    copied = lb.Campaign((*tests[:3], tests[3].with_reading_um(tests[2].reading_um)))
    seen = lb.preview(copied)
    (remark,) = seen.tests[1].remarks
    found = re.fullmatch(r"reading 101 at 50° stands \+(\d+\.\d) µm off its neighbours", remark_words(remark))
    assert found
    assert float(found[1]) == pytest.approx(50.0, abs=3.0)
    assert "Tests f520 and f742 hold the same readings: a file read twice?" in map(remark_words, seen.remarks)
    kilo = lb.preview(plan(forces_N=(0.036, 0.3, 0.52, 0.742)))
    assert any("check the unit of force_N" in remark_words(remark) for remark in kilo.remarks)


@pytest.mark.parametrize("step", [1.0, 5.0, 10.0])
def test_a_step_of_the_path_is_no_drift_and_a_spike_is_one_reading(step: float, rng: np.random.Generator) -> None:
    """Last and first reading are a step apart: where the path is steep they differ without any drift."""
    angle = np.arange(20.0, 380.0, step)
    for drift, expected in ((0.0, []), (60.0, [RemarkKind.OPEN]), (0.0, [RemarkKind.SPIKES])):
        reading = 40.0 * np.cos(np.deg2rad(2.0 * angle + 30.0)) + 0.3 * rng.standard_normal(angle.size) + drift * angle / 360.0
        if RemarkKind.SPIKES in expected:
            reading[7] += 900.0
        (seen,) = lb.preview(lb.Campaign((lb.CircularTest(300.0, angle, reading),))).tests
        assert [remark.kind for remark in seen.remarks] == expected
        assert 0.1 < (seen.noise_um or 0.0) < 0.6 or drift
    assert (seen.spikes, seen.remarks[0].values["reading"]) == (1, 8)
    assert seen.remarks[0].values["off_um"] == pytest.approx(900.0, abs=3.0)


@pytest.mark.parametrize(("radius_mm", "asked"), [(0.15, [0.15]), (100_000.0, [100_000.0]), (50.0, []), (1350.0, [])])
def test_a_radius_that_no_bar_has_is_asked_about(radius_mm: float, asked: list[float]) -> None:
    seen = lb.preview(lb.Campaign((lb.CircularTest(300.0, np.arange(0.0, 360.0, 5.0)),), radius_mm=radius_mm))
    assert [own.values["radius_mm"] for own in seen.remarks if own.kind is RemarkKind.RADIUS] == asked
    assert all(f"A radius is {r:g} mm: check the unit of radius_mm." in map(remark_words, seen.remarks) for r in asked)


def test_preview_is_silent_on_a_good_campaign() -> None:
    seen = lb.preview(simulated(plan((720,) * 4)))
    assert all(test.remarks == () for test in seen.tests)
