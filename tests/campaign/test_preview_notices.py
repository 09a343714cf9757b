"""What a look at the readings notices before anything is fitted."""

from __future__ import annotations

import re

import numpy as np
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
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


def test_preview_is_silent_on_a_good_campaign() -> None:
    seen = lb.preview(simulated(plan((720,) * 4)))
    assert all(test.remarks == () for test in seen.tests)
