"""Circles: polar traces with prediction and band, residuals against angle and order, predictive checks."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes
from numpy.typing import NDArray

from ldbb_bayes.inference.origin import bound_of, draws_of
from ldbb_bayes.inference.predictive import (
    band_um,
    new_circle_coefficients,
    prior_circle_coefficients,
    residual_coefficients,
    residuals_mm,
    shared_coefficients,
)
from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.model.basis import MAX_ORDER, ORDERS, basis
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.report.figures.style import ACCENT, GREY, force_colours, new_figure, styled

__all__ = ["predictive", "residuals", "traces"]

Array = NDArray[Any]
_DRAWS = 600
_DOTS = 6000
_GRID = np.linspace(0.0, 2 * np.pi, 361)


@styled
def traces(posterior: xr.DataTree) -> Figure:
    """Polar traces of all tests, plane by plane: readings, prediction (machine and shared nuisances) and the 95 % band for a new
    circle."""
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound, _DRAWS)
    rng = np.random.default_rng(0)
    predicted = shared_coefficients(bound, phi, beta).mean(axis=0) @ basis(_GRID).T * 1e3
    new = new_circle_coefficients(bound, phi, beta, rng)
    readings = [test.readings_mm() * 1e3 for test in _tests(bound)]
    low, high = min(r.min() for r in readings), max(r.max() for r in readings)
    span = max(high - low, 1e-3)
    zero = 1.1 * span - low
    step = _round_step(span / 4.0)
    ticks = np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step
    planes = bound.setting.planes
    figure = Figure(figsize=(1.8 + 6.4 * len(planes), 6.6))
    width = 5.74 / figure.get_figwidth()
    colours = force_colours(bound.setting.force_N.tolist())
    several = len(bound.setting.both_ways) > 0
    every = -(-sum(map(len, readings)) // _DOTS)
    dots = "Readings (dots" if every == 1 else f"Every {every}. reading (dots"
    lines: dict[str, Any] = {}
    for k, plane in enumerate(planes):
        axes = figure.add_axes((0.57 / figure.get_figwidth() + k * 1.115 * width, 0.05, width, 0.82), projection="polar")
        if not isinstance(axes, PolarAxes):
            raise TypeError("polar axes must be PolarAxes")
        for r, (test, colour) in enumerate(zip(_tests(bound), colours, strict=True)):
            if test.plane != plane:
                continue
            lower, upper = band_um(new[:, r], phi[:, 0], _GRID, rng)
            style = "--" if test.direction == "CCW" and several else "-"
            label = f"{test.force_N:g} N" + (f" {test.direction}" if several and test.direction else "")
            axes.fill_between(_GRID, zero + lower, zero + upper, color=colour, alpha=0.22, linewidth=0)
            axes.plot(test.angles_rad()[::every], zero + readings[r][::every], ".", color=colour, markersize=1.6)
            axes.plot(_GRID, zero + predicted[r], color=colour, linewidth=1.1, linestyle=style, label=label)
        axes.plot(_GRID, np.full_like(_GRID, zero), color="black", linewidth=0.8, linestyle=(0, (4, 3)), label="nominal circle")
        ends = PLANES[plane]
        axes.set_xticks(
            np.deg2rad(range(0, 360, 45)), [f"+{ends.first}", "45°", f"+{ends.second}", "135°", "180°", "225°", "270°", "315°"]
        )
        axes.set_rlim(0.0, zero + high + 0.08 * span)
        axes.set_rgrids((zero + ticks).tolist(), [""] * len(ticks))
        radii = {test.circle.radius_mm for test in _tests(bound) if test.plane == plane}
        magnified = (
            f", radial magnification {max(radii) * 1e3 / zero:.0f} : 1" if len(radii) == 1 else ", circles of several radii"
        )
        where = f"Plane {plane}: " if len(planes) > 1 else ""
        axes.set_title(
            f"{where}{dots}), prediction (lines), 95 % band for a new circle\nrings every {step:g} µm{magnified}",
            pad=22,
        )
        lines |= dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    axes.legend(lines.values(), lines.keys(), loc="center left", bbox_to_anchor=(1.06, 0.5))
    return figure


@styled
def residuals(posterior: xr.DataTree) -> Figure:
    """Reading minus prediction (machine and shared nuisances) against angle, and its amplitude by Fourier order."""
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound, _DRAWS)
    predicted = shared_coefficients(bound, phi, beta).mean(axis=0)
    rest = [r * 1e3 for r in residuals_mm(bound, predicted)]
    amplitude = _amplitudes_um(residual_coefficients(bound, predicted))
    colours = force_colours(bound.setting.force_N.tolist())
    shown = _at_most(len(rest), 10)
    figure = new_figure(9.0, 1.2 + 0.72 * len(shown))
    grid = figure.add_gridspec(len(shown), 2, width_ratios=(3, 2))
    limit = 1.05 * max(np.abs(r).max() for r in rest)
    first = None
    for row, r in enumerate(shown):
        axes = figure.add_subplot(grid[row, 0], sharex=first, sharey=first)
        first = first or axes
        order = np.argsort(np.mod(_tests(bound)[r].angle_deg, 360.0))
        axes.plot(np.mod(_tests(bound)[r].angle_deg, 360.0)[order], rest[r][order], color=colours[r], linewidth=0.7)
        axes.set_ylim(-limit, limit)
        axes.set_xlim(0.0, 360.0)
        axes.set_xticks(range(0, 361, 45))
        axes.set_ylabel(f"{bound.test_names[r]}\n(µm)", rotation=0, ha="right", va="center")
        axes.tick_params(labelbottom=row == len(shown) - 1)
    if first is not None:
        first.set_title("Residual against angle (each circle's own shift and discrepancy left in)")
    figure.axes[-1].set_xlabel("angle of the bar (°)")
    by_order = figure.add_subplot(grid[:, 1])
    for r, colour in enumerate(colours):
        by_order.plot(range(MAX_ORDER + 1), amplitude[r], "o", color=colour, markersize=4, label=f"{bound.test_names[r]}")
    by_order.set_title("Amplitude by Fourier order")
    by_order.set_xlabel("order n (per revolution)")
    by_order.set_ylabel("amplitude (µm)")
    by_order.set_xticks(range(0, MAX_ORDER + 1, 2))
    by_order.set_ylim(bottom=0.0)
    if len(colours) <= 12:
        by_order.legend(loc="upper right", ncols=2)
    return figure


@styled
def predictive(posterior: xr.DataTree) -> Figure:
    """What the prior and what the posterior expect of a circle at the highest force, with the readings."""
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound, _DRAWS)
    rng = np.random.default_rng(0)
    top = int(np.argmax(bound.setting.force_N))
    test = _tests(bound)[top]
    figure = new_figure(9.0, 3.6)
    left, right = figure.subplots(1, 2)
    if bound.model.prior.flat:
        left.text(0.5, 0.5, "flat prior: no prediction", ha="center", va="center", transform=left.transAxes)
    else:
        prior = posterior["prior"]
        prior_beta = np.stack([prior[name].to_numpy().ravel()[:_DRAWS] for name in bound.names], axis=1)
        prior_phi = np.stack([prior[str(name)].to_numpy().ravel()[:_DRAWS] for name in bound.hyper_prior.names], axis=1)
        _band(left, prior_circle_coefficients(bound, prior_phi, prior_beta, rng)[:, top], prior_phi[:, 0], rng, GREY, "prior")
    _band(right, new_circle_coefficients(bound, phi, beta, rng)[:, top], phi[:, 0], rng, ACCENT, "posterior, new circle")
    for axes, title in ((left, "Prior predictive"), (right, "Posterior predictive")):
        axes.plot(np.mod(test.angle_deg, 360.0), test.reading_um, ".", color="black", markersize=1.5, label="readings")
        axes.set_title(f"{title}, {test.name} ({test.force_N:g} N)")
        axes.set_xlabel("angle of the bar (°)")
        axes.set_ylabel("reading (µm)")
        axes.set_xlim(0.0, 360.0)
        axes.set_xticks(range(0, 361, 90))
        axes.legend(loc="upper right")
        bottom, ceiling = axes.get_ylim()
        axes.set_ylim(bottom, ceiling + 0.3 * (ceiling - bottom))
    return figure


def _band(axes: Any, coefficients: Array, sigma: Array, rng: np.random.Generator, colour: str, label: str) -> None:
    degrees = np.rad2deg(_GRID)
    for prob, alpha in ((0.95, 0.25), (0.5, 0.4)):
        lower, upper = band_um(coefficients, sigma, _GRID, rng, prob=prob)
        axes.fill_between(degrees, lower, upper, color=colour, alpha=alpha, linewidth=0, label=f"{label}, {100 * prob:g} %")


def _tests(bound: BoundModel) -> list[Any]:
    by_name = {test.name: test for test in bound.campaign.tests}
    return [by_name[name] for name in bound.test_names]


def _amplitudes_um(coefficients: Array) -> Array:
    """Amplitude per order, shape (tests, 13) [µm]."""
    member = ORDERS[:, None] == np.arange(MAX_ORDER + 1)
    return np.sqrt(coefficients**2 @ member) * 1e3


def _at_most(count: int, limit: int) -> list[int]:
    return list(range(count)) if count <= limit else np.linspace(0, count - 1, limit).astype(int).tolist()


def _round_step(size: float) -> float:
    power = 10.0 ** np.floor(np.log10(size))
    return float(power * min((1.0, 2.0, 5.0, 10.0), key=lambda m: abs(m * power - size)))
