"""Circles: traces and predictions, residuals, circular-test quantities, contributions, and the atlases of patterns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ldbb_bayes.analysis.circularity import COMPLIANCE, GEOMETRY, TOGETHER, contribution_paths, first_circle, measured_circularity
from ldbb_bayes.analysis.circularity import circularity as quantities
from ldbb_bayes.inference.posterior import bound_of, draws_of
from ldbb_bayes.inference.predictive import (
    band_um,
    new_circle_coefficients,
    prior_circle_coefficients,
    residual_coefficients,
    residuals_mm,
    shared_coefficients,
)
from ldbb_bayes.machine.chain import PLANES, Circle, Machine
from ldbb_bayes.machine.identifiable import kept_compliances
from ldbb_bayes.machine.jacobian import geometric_jacobian, wrench_jacobian
from ldbb_bayes.machine.names import geometric_names, wrench_names
from ldbb_bayes.model.fourier import MAX_ORDER, ORDERS, basis
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.report.figures.style import (
    ACCENT,
    GREY,
    PALETTE,
    angle_axis,
    band,
    force_colours,
    legend_below,
    new_figure,
    panels,
    styled,
)
from ldbb_bayes.units import display_name

__all__ = [
    "circularity",
    "compliance_atlas",
    "contributions",
    "geometric_atlas",
    "parameter_contributions",
    "predictive",
    "residuals",
    "traces",
]

Array = NDArray[Any]
_DRAWS, _DRAWS_OF_PATHS = 600, 500
_DOTS = 6000
_GRID = np.linspace(0.0, 2 * np.pi, 361)
_SWING = 0.45


@styled
def traces(posterior: xr.DataTree) -> Figure:
    """Polar traces of all tests, plane by plane: readings, prediction (machine and shared nuisances) and the 95 % band for a new
    circle."""
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound, _DRAWS)
    rng = np.random.default_rng(0)
    predicted = shared_coefficients(bound, phi, beta).mean(axis=0) @ basis(_GRID).T * 1e3
    new = new_circle_coefficients(bound, phi, beta, rng)
    tests = _tests(bound)
    readings = [test.readings_mm() * 1e3 for test in tests]
    low, high = min(r.min() for r in readings), max(r.max() for r in readings)
    span = max(high - low, 1e-3)
    zero, step = 1.1 * span - low, _round_step(span / 4.0)
    planes = bound.setting.planes
    figure = Figure(figsize=(1.8 + 6.4 * len(planes), 6.6))
    width = 5.74 / figure.get_figwidth()
    colours = force_colours(bound.setting.force_N.tolist())
    several = len(bound.setting.both_ways) > 0
    every = -(-sum(map(len, readings)) // _DOTS)
    lines: dict[str, Any] = {}
    for k, plane in enumerate(planes):
        axes: Any = figure.add_axes((0.57 / figure.get_figwidth() + k * 1.115 * width, 0.05, width, 0.82), projection="polar")
        here = [r for r, test in enumerate(tests) if test.plane == plane]
        for r in here:
            test, (lower, upper) = tests[r], band_um(new[:, r], phi[:, 0], _GRID, rng)
            style = "--" if test.direction == "CCW" and several else "-"
            label = f"{test.force_N:g} N" + (f" {test.direction}" if several and test.direction else "")
            band(axes, _GRID, zero + lower, zero + upper, colours[r], 0.22)
            axes.plot(test.angles_rad()[::every], zero + readings[r][::every], ".", color=colours[r], markersize=1.6)
            axes.plot(_GRID, zero + predicted[r], color=colours[r], linewidth=1.1, linestyle=style, label=label)
        axes.plot(_GRID, np.full_like(_GRID, zero), color="black", linewidth=0.8, linestyle=(0, (4, 3)), label="nominal circle")
        _polar_grid(
            axes, plane, zero + np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step, zero + high + 0.08 * span
        )
        dots = "Readings (dots" if every == 1 else f"Every {every}. reading (dots"
        radii = {tests[r].circle.radius_mm for r in here}
        scale = f"radial magnification {max(radii) * 1e3 / zero:.0f} : 1" if len(radii) == 1 else "circles of several radii"
        where = f"Plane {plane}: " if len(planes) > 1 else ""
        title = f"{where}{dots}), prediction (lines), 95 % band for a new circle\nrings every {step:g} µm, {scale}"
        axes.set_title(title, pad=22)
        lines |= dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    axes.legend(lines.values(), lines.keys(), loc="center left", bbox_to_anchor=(1.06, 0.5))
    return figure


def _polar_grid(axes: Any, plane: str, rings: Array, limit: float) -> None:
    names = [f"+{PLANES[plane].first}", "45°", f"+{PLANES[plane].second}", *(f"{angle}°" for angle in range(135, 360, 45))]
    axes.set_xticks(np.deg2rad(range(0, 360, 45)), names)
    axes.set_rlim(0.0, limit)
    axes.set_rgrids(rings.tolist(), [""] * len(rings))


@styled
def residuals(posterior: xr.DataTree) -> Figure:
    """Reading minus prediction (machine and shared nuisances) against angle, and its amplitude by Fourier order."""
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound, _DRAWS)
    predicted = shared_coefficients(bound, phi, beta).mean(axis=0)
    rest = [r * 1e3 for r in residuals_mm(bound, predicted)]
    member = ORDERS[:, None] == np.arange(MAX_ORDER + 1)
    amplitude = np.sqrt(residual_coefficients(bound, predicted) ** 2 @ member) * 1e3
    colours = force_colours(bound.setting.force_N.tolist())
    shown = np.unique(np.linspace(0, len(rest) - 1, 10).astype(int)).tolist()
    figure = new_figure(9.0, 1.2 + 0.72 * len(shown))
    grid = figure.add_gridspec(len(shown), 2, width_ratios=(3, 2))
    limit = 1.05 * max(np.abs(r).max() for r in rest)
    first = None
    for row, r in enumerate(shown):
        axes = figure.add_subplot(grid[row, 0], sharex=first, sharey=first)
        first = first or axes
        angle = np.mod(_tests(bound)[r].angle_deg, 360.0)
        order = np.argsort(angle)
        axes.plot(angle[order], rest[r][order], color=colours[r], linewidth=0.7)
        axes.set_ylim(-limit, limit)
        angle_axis(axes, 45)
        axes.set_ylabel(f"{bound.test_names[r]}\n(µm)", rotation=0, ha="right", va="center")
        axes.tick_params(labelbottom=row == len(shown) - 1)
        axes.set_xlabel("angle of the bar (°)" if row == len(shown) - 1 else "")
    figure.axes[0].set_title("Residual against angle (each circle's own shift and discrepancy left in)")
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
    figure, (left, right) = panels(2, 2, 9.0, 3.6, 0.0)
    if bound.model.prior.flat:
        left.text(0.5, 0.5, "flat prior: no prediction", ha="center", va="center", transform=left.transAxes)
    else:
        before = posterior["prior"]
        prior_beta, prior_phi = (
            np.stack([before[str(name)].to_numpy().ravel()[:_DRAWS] for name in names], axis=1)
            for names in (bound.names, bound.hyper_prior.names)
        )
        _bands(left, prior_circle_coefficients(bound, prior_phi, prior_beta, rng)[:, top], prior_phi[:, 0], rng, GREY, "prior")
    _bands(right, new_circle_coefficients(bound, phi, beta, rng)[:, top], phi[:, 0], rng, ACCENT, "posterior, new circle")
    for axes, title in ((left, "Prior predictive"), (right, "Posterior predictive")):
        axes.plot(np.mod(test.angle_deg, 360.0), test.reading_um, ".", color="black", markersize=1.5, label="readings")
        axes.set_title(f"{title}, {test.name} ({test.force_N:g} N)")
        angle_axis(axes)
        axes.set_ylabel("reading (µm)")
        axes.legend(loc="upper right")
        bottom, ceiling = axes.get_ylim()
        axes.set_ylim(bottom, ceiling + 0.3 * (ceiling - bottom))
    return figure


def _bands(axes: Axes, coefficients: Array, sigma: Array, rng: np.random.Generator, colour: str, label: str) -> None:
    for prob, alpha in ((0.95, 0.25), (0.5, 0.4)):
        lower, upper = band_um(coefficients, sigma, _GRID, rng, prob=prob)
        band(axes, np.rad2deg(_GRID), lower, upper, colour, alpha, f"{label}, {100 * prob:g} %")


def _tests(bound: BoundModel) -> list[Any]:
    by_name = {test.name: test for test in bound.campaign.tests}
    return [by_name[name] for name in bound.test_names]


def _round_step(size: float) -> float:
    power = 10.0 ** np.floor(np.log10(size))
    return float(power * min((1.0, 2.0, 5.0, 10.0), key=lambda m: abs(m * power - size)))


_PANELS: tuple[tuple[dict[str, str], str], ...] = (
    ({"G": "G, least-squares centre", "G_minimum_zone": "G, minimum zone"}, "Circular deviation (µm)"),
    ({"F_max": "F_max", "F_min": "F_min"}, "Radial deviation (µm)"),
    ({"squareness": "squareness"}, "Squareness (µm/m)"),
    ({"scale_mismatch": "scale mismatch"}, "Scale mismatch (µm/m)"),
)


@styled
def circularity(posterior: xr.DataTree) -> Figure:
    """G, F_max and F_min, squareness and scale mismatch of the machine's path against force with 95 % bands; crosses: of the
    readings themselves, balls and bar included."""
    bound = bound_of(posterior)
    top = float(bound.setting.force_N.max())
    table = quantities(posterior, np.linspace(0.0, top, 25).tolist(), draws=_DRAWS_OF_PATHS, both_ways=False)
    measured, _ = measured_circularity(posterior)
    planes = bound.setting.planes
    figure, every = panels(4 * len(planes), 2, 9.6, 2.6, 0.3)
    for k, (axes, (names, label)) in enumerate(zip(every, _PANELS * len(planes), strict=True)):
        plane = planes[k // 4]
        own = table[table["plane"] == plane]
        # Other radii have other paths: only readings of the circle that is drawn.
        read = measured[(measured["plane"] == plane) & (measured["radius_mm"] == own["radius_mm"].iloc[0])]
        for (name, words), colour in zip(names.items(), PALETTE, strict=False):
            rows = own[own["quantity"] == name]
            band(axes, rows["force_N"], rows["ci_low"], rows["ci_high"], colour)
            axes.plot(rows["force_N"], rows["median"], color=colour, label=words)
            axes.plot(read["force_N"], read[name].astype(float), "x", color=colour, markersize=5)
        axes.set_ylabel(label)
        axes.set_xlabel("force (N)")
        axes.set_xlim(-0.02 * top, 1.02 * top)
        axes.legend(loc="best")
        if len(planes) > 1:
            axes.set_title(f"Plane {plane}")
    figure.suptitle("The machine's path, 95 % band; crosses: the readings, balls and bar included")
    return figure


_DRAWS_OF_CONTRIBUTIONS, _MOST_FORCES = 400, 10


@styled
def contributions(posterior: xr.DataTree) -> Figure:
    """Compliance, geometry and both against angle at every force, with 95 % bands; offsets of the tool ball left out (Fig. 8)."""
    bound = bound_of(posterior)
    beta, _ = draws_of(posterior, bound, _DRAWS_OF_CONTRIBUTIONS)
    forces = np.unique(bound.setting.force_N)
    forces = forces[np.unique(np.linspace(0, len(forces) - 1, _MOST_FORCES).round().astype(int))]
    planes = bound.setting.planes
    figure, every = panels(3 * len(planes), 3, 9.6, 3.0, sharey="row")
    for k, plane in enumerate(planes):
        row, circle = every[3 * k : 3 * k + 3], first_circle(bound, plane)
        for force, colour in zip(forces, force_colours(forces.tolist()), strict=True):
            paths = contribution_paths(bound, circle, float(force), beta)
            for axes, source in zip(row, (TOGETHER, COMPLIANCE, GEOMETRY), strict=True):
                if source in paths and (source != GEOMETRY or force == forces[-1]):
                    _path(axes, paths[source], colour if source != GEOMETRY else "black", f"{force:g} N")
        where = f" in plane {plane}" if len(planes) > 1 else ""
        for axes, title in zip(row, (f"Both{where}", f"Compliance{where}", f"Geometry{where}, at any force"), strict=True):
            axes.set_title(title)
            angle_axis(axes)
        row[0].set_ylabel("contribution (µm)")
    legend_below(figure, every[1])
    return figure


@styled
def parameter_contributions(posterior: xr.DataTree) -> Figure:
    """Every compliance (with its slope) and every geometric error at the highest force, with 95 % bands (Figs. 9 and 10)."""
    bound = bound_of(posterior)
    beta, _ = draws_of(posterior, bound, _DRAWS_OF_CONTRIBUTIONS)
    force = float(bound.setting.force_N.max())
    planes = bound.setting.planes
    figure, every = panels(4 * len(planes), 2, 10.4, 3.1, 0.4)
    for k, plane in enumerate(planes):
        paths = contribution_paths(bound, first_circle(bound, plane), force, beta)
        where = f", plane {plane}" if len(planes) > 1 else ""
        for row, kind, words in ((0, "C_", f"Compliances at {force:g} N"), (2, "E_", "Geometric errors")):
            own = {name: path for name, path in paths.items() if name.startswith(kind)}
            size = {name: float(np.ptp(path.mean(axis=0))) for name, path in own.items()}
            # Those that reach a third of the largest, and the rest.
            limit = max(size.values(), default=0.0) / 3.0
            large, small = [n for n in size if size[n] >= limit], [n for n in size if size[n] < limit]
            _paths(every[4 * k + row], own, large, f"{words}{where}: the largest")
            _paths(every[4 * k + row + 1], own, small, f"{words}{where}: the others")
    return figure


def _paths(axes: Axes, paths: Mapping[str, Array], names: Sequence[str], title: str) -> None:
    axes.set_title(title)
    axes.set_ylabel("contribution (µm)")
    angle_axis(axes)
    colours = dict(zip(paths, (*PALETTE, GREY, "#F0E442") * 4, strict=False))
    for name in names:
        _path(axes, paths[name], colours[name], f"{display_name(name)}: {np.ptp(paths[name].mean(axis=0)):.2g} µm p-p")
    if names:
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)
    else:
        axes.text(0.5, 0.5, "none", ha="center", va="center", transform=axes.transAxes)


def _path(axes: Axes, path: Array, colour: Any, label: str) -> None:
    closed = np.concatenate([path, path[:, :1]], axis=1)
    low, high = np.quantile(closed, [0.025, 0.975], axis=0)
    band(axes, np.arange(361), low, high, colour)
    axes.plot(np.arange(361), closed.mean(axis=0), color=colour, label=label)


@styled
def compliance_atlas(machine: Machine, circle: Circle | None = None) -> Figure:
    """The patterns of all joint compliances, proportional sets in one colour, the kept representative in bold."""
    machine, where = _in_plane(machine, circle)
    names = [name.label for name in wrench_names(machine)]
    kept = kept_compliances(machine, where)
    colour = {name: PALETTE[k % len(PALETTE)] for k, members in enumerate(kept.sets) for name in members}
    columns = dict(zip(names, wrench_jacobian(machine, where, _GRID).T, strict=True))
    figure = _atlas(columns, colour, {name.label for name in kept.names}, set(kept.null), 6)
    figure.suptitle(
        f"{machine.topology}, plane {machine.plane}: patterns of the {len(names)} joint compliances. One colour: proportional, "
        "only their sum can be identified. Bold: kept"
    )
    return figure


@styled
def geometric_atlas(machine: Machine, circle: Circle | None = None) -> Figure:
    """The patterns of the geometric errors."""
    machine, where = _in_plane(machine, circle)
    names = [name.label for name in geometric_names(machine)]
    columns = dict(zip(names, geometric_jacobian(machine, where, _GRID).T, strict=True))
    figure = _atlas(columns, dict.fromkeys(names, ACCENT), set(names), set(), 4)
    figure.suptitle(f"{machine.topology}, plane {machine.plane}: patterns of the geometric errors")
    return figure


def _in_plane(machine: Machine, circle: Circle | None) -> tuple[Machine, Circle]:
    where = circle or Circle(plane=machine.planes[0])
    return Machine(machine.topology, where.plane, machine.frames_mm), where


def _atlas(columns: Mapping[str, Array], colour: Mapping[str, str], bold: set[str], null: set[str], width: int) -> Figure:
    figure, every = panels(len(columns), width, 1.65 * width, 1.9, 0.5, subplot_kw={"projection": "polar"})
    axes: Any
    for axes, (name, values) in zip(every, columns.items(), strict=True):
        peak = float(np.abs(values).max())
        swing = values / peak if name not in null and peak > 0.0 else np.zeros_like(values)
        axes.plot(_GRID, np.ones_like(_GRID), color=GREY, linewidth=0.8, linestyle=(0, (4, 3)))
        axes.plot(_GRID, 1.0 + _SWING * swing, color=colour.get(name, GREY), linewidth=2.0 if name in bold else 1.1)
        axes.set_rlim(0.0, 1.0 + 1.1 * _SWING)
        axes.set_rticks([])
        axes.spines["polar"].set_visible(False)
        axes.set_xticks(np.deg2rad([0, 90, 180, 270]), ["", "", "", ""])
        note = " (no effect)" if name in null else ""
        axes.set_title(display_name(name) + note, fontweight="bold" if name in bold else "normal", pad=4)
    return figure
