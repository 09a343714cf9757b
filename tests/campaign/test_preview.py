"""What `check` says of campaigns of several planes, radii, set-ups, directions and times."""

from __future__ import annotations

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.campaign.preview import RemarkKind, resolution_of
from ldbb_bayes.report.text import preview_table
from ldbb_bayes.report.wording import preview_sentences, remark_words

ANGLE = np.arange(36) * 10.0


def several() -> lb.Campaign:
    tests = [
        lb.CircularTest(100.0, ANGLE, plane="XY", direction="CW", time_s=0.0),
        lb.CircularTest(400.0, ANGLE, plane="XY", direction="CCW", radius_mm=100.0, time_s=60.0),
        lb.CircularTest(400.0, ANGLE, plane="YZ", direction="CW", setup=2, centre_z_mm=-30.0, time_s=120.0),
    ]
    return lb.Campaign(tuple(tests), frames_mm={"Y": (0.0, -200.0, 350.0)})


def test_what_a_fit_will_assume() -> None:
    seen = lb.preview(several())
    said = " ".join(map(remark_words, seen.assumptions))
    for words in (
        "plane XY + YZ, R = 100, 150 mm, each with a length of its own.",
        "Joint frames stand at Y (0, -200, 350) mm.",
        "Set-ups 1, 2: tool offsets of each",
        "Both directions of travel in XY: hysteresis is a term of the model.",
        "Tests record times; a drift over them is modelled only when asked for (--drift time).",
    ):
        assert words in said
    assert [r.values for r in seen.remarks if r.kind is RemarkKind.ONE_WAY] == [{"compliance": "C_YZY", "plane": "YZ"}]
    assert seen.as_dict()["tests"][2]["centre_mm"] == [0.0, 0.0, -30.0]


def test_the_table_says_where_circles_differ() -> None:
    table = preview_table(lb.preview(several())).frame()
    rows = table[["plane", "set-up", "R (mm)", "centre (mm)"]].to_numpy().tolist()
    assert ["YZ", "2", "150", "(0, 0, -30)"] in rows
    assert ["XY", "1", "100", "(0, 0, 0)"] in rows
    plain = lb.Campaign((lb.CircularTest(100.0, ANGLE), lb.CircularTest(400.0, ANGLE)))
    assert not {"plane", "set-up", "R (mm)", "centre (mm)"} & set(preview_table(lb.preview(plain)).heads)


def test_planes_of_one_set_up_are_remarked() -> None:
    tests = tuple(lb.CircularTest(force, ANGLE, plane=plane) for force in (100.0, 400.0) for plane in ("XY", "ZX"))
    said = preview_sentences(lb.preview(lb.Campaign(tests)))
    assert any("Several planes in one set-up: the tool ball's offsets are shared" in line for line in said)
    assert any("in plane ZX: friction in the bar cannot be told from C_XZX" in line for line in said)


@pytest.mark.parametrize("step", [0.24, 0.1, 1.0])
def test_the_step_of_the_readout_is_found(step: float, rng: np.random.Generator) -> None:
    """Rounded readings give their step, with an offset too; those of a fine readout none."""
    reading = 8.0 * np.cos(np.deg2rad(2.0 * np.arange(720.0))) + 0.3 * rng.standard_normal(720)
    assert resolution_of(step * np.rint(reading / step) + 0.077) == pytest.approx(step, rel=1e-6)
    assert resolution_of(reading) is None


def test_steps_spikes_and_gaps_are_counted(rng: np.random.Generator) -> None:
    angle = np.concatenate([np.arange(0.0, 100.0, 0.5), np.arange(110.0, 200.0, 0.5), np.arange(215.0, 360.0, 0.5)])
    reading = np.round(5.0 * np.cos(np.deg2rad(2.0 * angle)) + 0.2 * rng.standard_normal(angle.size), 1)
    reading[[40, 300]] += (30.0, -25.0)
    (seen,) = lb.preview(lb.Campaign((lb.CircularTest(100.0, angle, reading),))).tests
    assert (seen.gaps, seen.spikes) == (2, 2)
    assert seen.resolution_um == pytest.approx(0.1)
    assert seen.largest_gap_deg == pytest.approx(15.5)
    said = " ".join(map(remark_words, seen.remarks))
    assert "reading 41 at 20° stands" in said
    assert "2 readings do so" in said
    assert "steps of 0.1 µm, the campaign states a resolution of 0.24 µm" in said


def test_steps_that_few_readings_repeat_are_found(rng: np.random.Generator) -> None:
    """A wide circle read to 0.01 µm; written to 0.0001 µm the digits are no steps."""
    reading = 40.0 * np.cos(np.deg2rad(2.0 * np.arange(360.0))) + 0.3 * rng.standard_normal(360)
    assert resolution_of(np.round(reading, 2)) == pytest.approx(0.01)
    assert resolution_of(np.round(reading, 4)) is None


def test_laps_at_the_same_angles_leave_no_gap() -> None:
    angle = np.arange(3 * 360.0)
    (seen,) = lb.preview(lb.Campaign((lb.CircularTest(100.0, angle, 5.0 * np.cos(np.deg2rad(2.0 * angle))),))).tests
    assert seen.gaps == 0
    assert seen.largest_gap_deg == pytest.approx(1.0)
    assert RemarkKind.GAP not in [remark.kind for remark in seen.remarks]
