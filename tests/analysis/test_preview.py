"""What `check` says of campaigns of several planes, radii, set-ups, directions and times."""

from __future__ import annotations

import numpy as np
from rich.console import Console

import ldbb_bayes as lb
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
