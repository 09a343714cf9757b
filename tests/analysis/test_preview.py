"""What `check` says of campaigns of several planes, radii, set-ups, directions and times."""

from __future__ import annotations

import numpy as np
import pytest
from rich.console import Console

import ldbb_bayes as lb
from ldbb_bayes.analysis.preview import resolution_of
from ldbb_bayes.report.text import preview_lines, preview_table

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
    said = " ".join(seen.assumptions)
    for words in (
        "plane XY + YZ, R = 100, 150 mm, each with a length of its own.",
        "Joint frames stand at Y (0, -200, 350) mm.",
        "Set-ups 1, 2: tool offsets of each",
        "Both directions of travel in XY: hysteresis is a term of the model.",
        "Tests record times; a drift over them is modelled only when asked for (--drift time).",
    ):
        assert words in said
    assert [remark for remark in seen.remarks if "in plane YZ" in remark and "C_YZY" in remark]
    assert not any("C_XYX" in remark for remark in seen.remarks)
    assert seen.as_dict()["tests"][2]["centre_mm"] == (0.0, 0.0, -30.0)


def test_the_table_says_where_circles_differ() -> None:
    console = Console(width=150, record=True, force_terminal=False)
    console.print(preview_table(lb.preview(several())))
    shown = console.export_text()
    assert "YZ set-up 2 R 150 (0, 0, -30)" in shown
    assert "XY set-up 1 R 100 (0, 0, 0)" in shown
    plain = lb.Campaign((lb.CircularTest(100.0, ANGLE), lb.CircularTest(400.0, ANGLE)))
    console.print(preview_table(lb.preview(plain)))
    assert "circle" not in console.export_text()


def test_planes_of_one_set_up_are_remarked() -> None:
    tests = tuple(lb.CircularTest(force, ANGLE, plane=plane) for force in (100.0, 400.0) for plane in ("XY", "ZX"))
    said = preview_lines(lb.preview(lb.Campaign(tests)))
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
    said = " ".join(seen.remarks)
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
    assert not any("gap" in remark for remark in seen.remarks)
