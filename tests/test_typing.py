"""Programs of users: public names have types that strict type checkers accept and know."""

from __future__ import annotations

from pathlib import Path

import pytest

SCRIPT = """\
import matplotlib.figure
import numpy as np
import xarray as xr

import ldbb_bayes as lb

circle = lb.CircularTest(
    force_N=36.0,
    angle_deg=[0.0, 90.0, 180.0, 270.0],
    reading_um=[0.0, 1.0, 0.0, 1.0],
)
ball = lb.Ball(harmonics_um=[(2, 0.2, 35.0), (3, 0.1, -10.0)], U_um=0.05)
campaign = lb.Campaign(
    [circle],
    centre_mm=[0.0, 0.0, 50.0],
    frames_mm={"X": [0.0, 0.0, 100.0]},
    instrument=lb.Instrument(work=ball),
)
machine = lb.Machine(planes=["XY", "YZ"], frames_mm={"X": [0.0, 0.0, 100.0]})
middle = lb.machine.Circle(centre_mm=[0.0, 0.0, 50.0])
masked = lb.reading.mask_angles(circle, [[85.0, 95.0]])
model = lb.HybridModel(nuisances=[lb.terms.Drift("time")], fixed=["C_XYX_1"])
estimate = lb.fit_least_squares(campaign, fixed=["C_XYX"])
density = lb.log_density(model, campaign)
points = density.initial(3)
log_prob = density.log_prob(np.zeros(len(density.names)))
log_prior = density.log_prior(points)
log_likelihood = density.log_likelihood(points)
rows = lb.fleet.read_batch("fitted", ["campaign"])


def draw(posterior: xr.DataTree) -> matplotlib.figure.Figure:
    lb.figures.save_figures(posterior, "figures", formats=["png"])
    return lb.figures.traces(posterior)


reveal_type(log_prob)
reveal_type(rows)
reveal_type(lb.figures.traces)
"""


@pytest.mark.slow
def test_a_users_script_passes_mypy_strictly(tmp_path: Path, root: Path) -> None:
    api = pytest.importorskip("mypy.api")
    script = tmp_path / "script.py"
    script.write_text(SCRIPT, encoding="utf-8")
    configuration = str(root / "pyproject.toml")
    cache = str(root / ".mypy_cache")  # the cache that `make lint` fills
    output, errors, status = api.run(
        ["--strict", "--config-file", configuration, "--cache-dir", cache, str(script)]
    )
    assert (errors, status) == ("", 0), output
    notes = [line.partition("Revealed type is ")[2] for line in output.splitlines()]
    assert "numpy.ndarray" in notes[0]
    assert "DataFrame" in notes[1]
    assert "Figure" in notes[2]
