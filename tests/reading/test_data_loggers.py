"""Files of data loggers in the format TOA5."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import ldbb_bayes as lb

ROWS = [(5.0 * k, 0.1 * k) for k in range(72)]


def test_a_data_logger_states_units_and_kinds_of_samples_below_its_names(tmp_path: Path) -> None:
    lines = [
        '"TOA5","Lab","CR6","11234","CR6.Std.12.02","CPU:ballbar.CR6","40121","Circle"',
        '"TIMESTAMP","RECORD","Theta","Force_Avg","BarElong_Avg","PTemp_Avg","BattV_Min"',
        '"TS","RN","deg","N","um","Deg C","Volts"',
        '"","","Smp","Avg","Avg","Avg","Min"',
    ]
    for k, (angle, reading) in enumerate(ROWS):
        lines.append(f'"2025-03-04 11:05:{k // 2:02d}",{k},{angle},36.0,{reading:.1f},22.1,12.6')
    path = tmp_path / "circle.dat"
    path.write_text("\n".join([*lines, ""]))
    (test,) = lb.import_campaign(path).campaign.tests
    assert test.force_N == 36.0
    np.testing.assert_allclose(test.reading_um, [reading for _, reading in ROWS])
