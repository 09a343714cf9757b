"""Angles in degrees and minutes in tables that also hold texts."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import ldbb_bayes as lb


def test_minutes_beside_a_text_are_read(tmp_path: Path) -> None:
    rows = [f"A;{k * 7 // 2}°{30 * (k % 2):02d}';{0.1 * k:.2f}" for k in range(100)]
    path = tmp_path / "100N.csv"
    path.write_text("\n".join(["test;Angle;Reading [um]", *rows, ""]), encoding="utf-8")
    test = lb.import_campaign(path).campaign.tests[0]
    np.testing.assert_allclose(test.angle_deg, 3.5 * np.arange(100))
