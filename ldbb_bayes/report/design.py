"""A design as tables for a terminal."""

from __future__ import annotations

import numpy as np
from rich.table import Table

from ldbb_bayes.analysis.designed import Design
from ldbb_bayes.report.rounding import round_uncertainty
from ldbb_bayes.units import display_name, display_unit

__all__ = ["expected_table", "robustness_table", "tests_table"]


_HEADS = {
    "force_N": "force (N)",
    "work_ball_deg": "work ball (°)",
    "tool_ball_deg": "tool ball (°)",
    "radius_mm": "radius (mm)",
    "setup": "set-up",
    "centre_x_mm": "centre X (mm)",
    "centre_y_mm": "centre Y (mm)",
    "centre_z_mm": "centre Z (mm)",
}


def tests_table(design: Design) -> Table:
    """Different tests and how often to run each."""
    table = Table(box=None, pad_edge=False)
    for name in ("force_N", *design.columns):
        table.add_column(_HEADS.get(name, name), justify="right")
    table.add_column("circles", justify="right")
    for row in design.table().to_dict(orient="records"):
        values = [row[name] for name in ("force_N", *design.columns)]
        table.add_row(*(value if isinstance(value, str) else f"{value:.4g}" for value in values), str(row["count"]))
    return table


def expected_table(design: Design) -> Table:
    """Expected standard uncertainty of every parameter beside prior, baseline, others and floor."""
    compared = [design.baseline, *design.others]
    table = Table(box=None, pad_edge=False)
    table.add_column("expected u", no_wrap=True)
    for name in ("recommended", *(judged.name for judged in compared), "no less than", "prior"):
        table.add_column(name, justify="right")
    table.add_column("unit")
    for name, entry in design.forecast.expected.items():
        factor, unit = display_unit(entry.unit)
        shown = [entry.sd, *(judged.forecast.expected[name].sd for judged in compared), entry.floor_sd, entry.prior_sd]
        mark = "" if name in design.parameters else " (nuisance)"
        cells = [round_uncertainty(value * factor)[0] if np.isfinite(value) else "–" for value in shown]
        table.add_row(f"{display_name(name)}{mark}", *cells, unit)
    return table


def robustness_table(design: Design) -> Table:
    """Worst efficiency of every design over the assumptions, and under which."""
    table = Table(box=None, pad_edge=False)
    table.add_column("design", no_wrap=True)
    table.add_column("forces (N)")
    table.add_column("worst efficiency", justify="right")
    table.add_column("where")
    for name, row in design.robustness.iterrows():
        under = row.drop(["tests", "worst"]).astype(float)
        table.add_row(str(name), str(row["tests"]), f"{row['worst']:.2f}", str(under.idxmin()))
    return table
