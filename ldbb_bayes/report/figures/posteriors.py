"""Figures of a posterior: its parameters, its circles, and what these are made of; and the atlases of a machine's patterns."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ldbb_bayes.analysis.circularity import COMPLIANCE, GEOMETRY, TOGETHER, contribution_paths, first_circle, measured_circularity
from ldbb_bayes.analysis.circularity import circularity as quantities
from ldbb_bayes.campaign.campaign import distinct_forces
from ldbb_bayes.errors import check_known
from ldbb_bayes.inference.posterior import bound_of, curves_of, draws_of, priors_of, record_of
from ldbb_bayes.inference.predictive import band_um, new_circle_coefficients, residuals_mm, shared_coefficients
from ldbb_bayes.machine.chain import (
    PLANES,
    Circle,
    Machine,
    geometric_jacobian,
    geometric_names,
    kept_compliances,
    wrench_jacobian,
    wrench_names,
)
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.prior import compliance_unit
from ldbb_bayes.report.figures import style
from ldbb_bayes.report.figures.style import ACCENT, GREY, LIGHT, PALETTE, band, panels, styled
from ldbb_bayes.result import Array
from ldbb_bayes.units import display_name, display_unit, inside_name, value_and_uncertainty

__all__ = [
    "FIGURES", "circularity", "compliance_against_force", "compliance_atlas", "contributions", "corner", "forest",
    "geometric_atlas", "parameter_contributions", "residuals", "save_figures", "traces",
]  # fmt: skip

# Direct compliances, rotations for moments, scale gains, squareness.
_CORNER = (r"C_([XYZ])\1.", r"C_([ABC])\1.", r"E_([XYZ])\1\d", r"E_[ABC]0..")
_MOST_IN_CORNER = 8
_DRAWS, _DRAWS_OF_PATHS, _DRAWS_OF_CONTRIBUTIONS = 600, 500, 400
_MOST_DOTS, _MOST_FORCES = 6000, 10
_GRID = np.linspace(0.0, 2 * np.pi, 361)
_SWING = 0.45
_DASHED = (0, (4, 3))


# ---- parameters


@styled
def forest(posterior: xr.DataTree) -> Figure:
    """Every parameter's 50 % and 95 % interval, from its prior mean in units of its prior sd (posterior sd when flat), the prior
    beside."""
    group, (prior_sd, prior_mean) = posterior["posterior"], priors_of(posterior)
    names = list(record_of(posterior)["model"]["groups"])
    figure, axes, rows = style.named_rows(names, 8.4, 1.1)
    texts = []
    for row, name in zip(rows, names, strict=True):
        draws, prior, middle = np.asarray(group[name]).ravel(), prior_sd[name], prior_mean.get(name, 0.0)
        scale = float(draws.std()) if prior is None else prior
        low, first, last, high = (np.quantile(draws, [0.025, 0.25, 0.75, 0.975]) - middle) / scale
        if prior is not None:
            before = (np.quantile(np.asarray(posterior["prior"][name]), [0.025, 0.975]) - middle) / scale
            axes.plot(before, [row, row], color=LIGHT, linewidth=7, solid_capstyle="butt", zorder=1)
        axes.plot([low, high], [row, row], color=ACCENT, linewidth=1.4, zorder=2)
        axes.plot([first, last], [row, row], color=ACCENT, linewidth=3.6, solid_capstyle="butt", zorder=3)
        axes.plot((draws.mean() - middle) / scale, row, "o", color="white", markeredgecolor=ACCENT, markersize=3.6, zorder=4)
        factor, label = display_unit(group[name].attrs["unit"])
        value, u = value_and_uncertainty(float(draws.mean()) * factor, float(draws.std()) * factor)
        texts.append(f"{value.replace('-', '−')} ± {u} {label}")
    flat = all(prior_sd[name] is None for name in names)
    value = "(value − prior mean)" if any(prior_mean.values()) else "value"
    axes.set_xlabel(f"{value} / {'posterior' if flat else 'prior'} sd")
    style.right_labels(axes, rows, texts)
    grey = "" if flat else "; grey: 95 % of the prior"
    axes.set_title(f"95 % and 50 % credible intervals{grey}; dot and right: mean, ± 1 sd")
    return figure


@styled
def compliance_against_force(posterior: xr.DataTree) -> Figure:
    """C(F) of every kept compliance with 50 % and 95 % bands over the tested forces."""
    bound = bound_of(posterior)
    forces = bound.setting.force_N
    force = np.linspace(forces.min(), forces.max(), 80) if np.ptp(forces) > 0 else forces[0] * np.array([0.95, 1.05])
    curves = curves_of(posterior, force)
    figure, every = panels(len(bound.compliances), min(3, len(bound.compliances)), 9.0, 2.6, 0.3)
    for j, (axes, kind) in enumerate(zip(every, bound.compliances, strict=True)):
        factor, text = style.axis_label(kind.label, compliance_unit(kind))
        value = curves[:, :, j] * factor
        for prob, alpha in ((0.95, 0.22), (0.5, 0.4)):
            low, high = np.quantile(value, [(1 - prob) / 2, (1 + prob) / 2], axis=0)
            band(axes, force, low, high, ACCENT, alpha, label=f"{100 * prob:g} %")
        axes.plot(force, value.mean(axis=0), color=ACCENT, label="mean")
        foot = axes.get_xaxis_transform()
        axes.plot(forces, np.zeros_like(forces), "^", color=PALETTE[1], markersize=5, clip_on=False, transform=foot)
        axes.axhline(0.0, color=GREY, linewidth=0.8)
        axes.set(xlabel="force (N)", ylabel=text)
    every[0].legend(loc="best")
    figure.suptitle("Compliance against force (triangles: tested forces)")
    return figure


@styled
def corner(posterior: xr.DataTree, names: Sequence[str] | None = None) -> Figure:
    """Pairwise posterior of a few parameters.

    Parameters
    ----------
    names : sequence of str, optional
        Default: the direct compliances, C_CCY, and the geometric errors that share their patterns, where the model has them.

    Raises
    ------
    InputError
        For a parameter the posterior does not have.
    """
    from corner import corner as draw_corner  # brings pyplot

    group = posterior["posterior"]
    if names is None:
        every = list(record_of(posterior)["model"]["groups"])
        names = [name for kind in _CORNER for name in every if re.fullmatch(kind, name)][:_MOST_IN_CORNER] or every[:6]
    names = [inside_name(name) for name in names]
    check_known("parameter", names, [str(name) for name in group.data_vars])
    columns = {}
    for name in names:
        factor, label = style.axis_label(name, group[name].attrs["unit"])
        draws = np.asarray(group[name]).ravel() * factor
        if np.ptp(draws) > 0:
            columns[label.replace(" (", "\n(")] = draws
    figure = Figure(figsize=(1.55 * len(columns) + 0.6,) * 2)
    look: dict[str, Any] = {"color": ACCENT, "plot_datapoints": False, "max_n_ticks": 3, "labelpad": 0.14}
    values = np.column_stack(list(columns.values()))
    draw_corner(values, fig=figure, labels=list(columns), levels=(0.393, 0.865), smooth=1.0, bins=30, **look)
    for axes in figure.axes:
        axes.grid(visible=False)
        axes.tick_params(labelsize=7)
    figure.subplots_adjust(left=0.13, bottom=0.13, right=0.98, top=0.94, wspace=0.08, hspace=0.08)
    figure.suptitle("Joint posterior: contours hold 39 % and 86 % (1 and 2 sd)")
    return figure


# ---- circles


@styled
def traces(posterior: xr.DataTree) -> Figure:
    """Polar traces of all tests, plane by plane: readings, prediction (machine and shared nuisances) and the 95 % band for a new
    circle."""
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound, _DRAWS)
    rng = np.random.default_rng(0)
    predicted = shared_coefficients(bound, phi, beta).mean(axis=0) @ basis(_GRID).T * 1e3
    new = new_circle_coefficients(bound, phi, beta, rng)
    tests = bound.campaign.tests
    readings = [test.readings_mm() * 1e3 for test in tests]
    low, high = min(r.min() for r in readings), max(r.max() for r in readings)
    span = max(high - low, 1e-3)
    zero, step = 1.1 * span - low, _round_step(span / 4.0)
    rings = zero + np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step
    planes, several = bound.setting.planes, len(bound.setting.both_ways) > 0
    figure = Figure(figsize=(1.8 + 6.4 * len(planes), 6.6))
    width = 5.74 / figure.get_figwidth()
    colours = style.force_colours(bound.setting.force_N.tolist())
    every = -(-sum(map(len, readings)) // _MOST_DOTS)
    lines: dict[str, Any] = {}
    for k, plane in enumerate(planes):
        axes: Any = figure.add_axes((0.57 / figure.get_figwidth() + k * 1.115 * width, 0.05, width, 0.82), projection="polar")
        here = [r for r, test in enumerate(tests) if test.plane == plane]
        for r in here:
            test, (lower, upper) = tests[r], band_um(new[:, r], phi[:, 0], _GRID, rng)
            line = "--" if test.direction == "CCW" and several else "-"
            label = f"{test.force_N:g} N" + (f" {test.direction}" if several and test.direction else "")
            band(axes, _GRID, zero + lower, zero + upper, colours[r], 0.22)
            axes.plot(test.angles_rad()[::every], zero + readings[r][::every], ".", color=colours[r], markersize=1.6)
            axes.plot(_GRID, zero + predicted[r], color=colours[r], linewidth=1.1, linestyle=line, label=label)
        axes.plot(_GRID, np.full_like(_GRID, zero), color="black", linewidth=0.8, linestyle=_DASHED, label="nominal circle")
        ends = {0: f"+{PLANES[plane].first}", 90: f"+{PLANES[plane].second}"}
        axes.set_xticks(np.deg2rad(range(0, 360, 45)), [ends.get(angle, f"{angle}°") for angle in range(0, 360, 45)])
        axes.set_rlim(0.0, zero + high + 0.08 * span)
        axes.set_rgrids(rings.tolist(), [""] * len(rings))
        dots = "Readings (dots" if every == 1 else f"Every {every}. reading (dots"
        radii = {tests[r].circle.radius_mm for r in here}
        scale = f"radial magnification {max(radii) * 1e3 / zero:.0f} : 1" if len(radii) == 1 else "circles of several radii"
        where = f"Plane {plane}: " if len(planes) > 1 else ""
        title = f"{where}{dots}), prediction (lines), 95 % band for a new circle\nrings every {step:g} µm, {scale}"
        axes.set_title(title, pad=22)
        lines |= dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    axes.legend(lines.values(), lines.keys(), loc="center left", bbox_to_anchor=(1.06, 0.5))
    return figure


def _round_step(size: float) -> float:
    power = 10.0 ** np.floor(np.log10(size))
    return float(power * min((1.0, 2.0, 5.0, 10.0), key=lambda m: abs(m * power - size)))


@styled
def residuals(posterior: xr.DataTree) -> Figure:
    """Reading minus prediction (machine and shared nuisances) against angle."""
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound, _DRAWS)
    rest = [r * 1e3 for r in residuals_mm(bound, shared_coefficients(bound, phi, beta).mean(axis=0))]
    tests, colours = bound.campaign.tests, style.force_colours(bound.setting.force_N.tolist())
    shown = np.unique(np.linspace(0, len(rest) - 1, 10).astype(int)).tolist()
    figure, every = panels(len(shown), 1, 9.0, 0.72, 1.2, sharex=True, sharey=True)
    limit = 1.05 * max(np.abs(r).max() for r in rest)
    for axes, r in zip(every, shown, strict=True):
        angle = np.mod(tests[r].angle_deg, 360.0)
        order = np.argsort(angle)
        axes.plot(angle[order], rest[r][order], color=colours[r], linewidth=0.7)
        axes.set_ylabel(f"{tests[r].name}\n(µm)", rotation=0, ha="right", va="center")
    every[-1].set_ylim(-limit, limit)
    style.angle_axis(every[-1], 45)
    figure.suptitle("Residual against angle (each circle's own shift and discrepancy left in)")
    return figure


_PANELS: tuple[tuple[dict[str, str], str], ...] = (
    ({"G": "G"}, "Circular deviation (µm)"),
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
    table = quantities(posterior, np.linspace(0.0, top, 25).tolist(), draws=_DRAWS_OF_PATHS)
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
        axes.set(xlabel="force (N)", ylabel=label, xlim=(-0.02 * top, 1.02 * top))
        if len(names) > 1:
            axes.legend()
        if len(planes) > 1:
            axes.set_title(f"Plane {plane}")
    figure.suptitle("The machine's path, 95 % band; crosses: the readings, balls and bar included")
    return figure


@styled
def contributions(posterior: xr.DataTree) -> Figure:
    """Compliance, geometry and both against angle at every force, with 95 % bands; offsets of the tool ball left out (Fig. 8)."""
    bound = bound_of(posterior)
    beta, _ = draws_of(posterior, bound, _DRAWS_OF_CONTRIBUTIONS)
    forces = distinct_forces(bound.setting.force_N)
    forces = forces[np.unique(np.linspace(0, len(forces) - 1, _MOST_FORCES).round().astype(int))]
    planes = bound.setting.planes
    figure, every = panels(3 * len(planes), 3, 9.6, 3.0, sharey="row")
    for k, plane in enumerate(planes):
        row, circle = every[3 * k : 3 * k + 3], first_circle(bound, plane)
        for force, colour in zip(forces, style.force_colours(forces.tolist()), strict=True):
            paths = contribution_paths(bound, circle, float(force), beta)
            for axes, source in zip(row, (TOGETHER, COMPLIANCE, GEOMETRY), strict=True):
                if source in paths and (source != GEOMETRY or force == forces[-1]):
                    _path(axes, paths[source], colour if source != GEOMETRY else "black", f"{force:g} N")
        where = f" in plane {plane}" if len(planes) > 1 else ""
        for axes, title in zip(row, (f"Both{where}", f"Compliance{where}", f"Geometry{where}, at any force"), strict=True):
            axes.set_title(title)
            style.angle_axis(axes)
        row[0].set_ylabel("contribution (µm)")
    style.legend_below(figure, every[1])
    return figure


@styled
def parameter_contributions(posterior: xr.DataTree) -> Figure:
    """Every compliance (with its slope) and every geometric error at the highest force, with 95 % bands (Figs. 9 and 10)."""
    bound = bound_of(posterior)
    beta, _ = draws_of(posterior, bound, _DRAWS_OF_CONTRIBUTIONS)
    force, planes = float(bound.setting.force_N.max()), bound.setting.planes
    drawn = []
    for plane in planes:
        paths = contribution_paths(bound, first_circle(bound, plane), force, beta)
        where = f", {plane}" if len(planes) > 1 else ""
        drawn += [(f"{display_name(name)}{where}", own) for name, own in paths.items() if name.startswith(("C_", "E_"))]
    figure, every = panels(len(drawn), 5, 10.4, 1.6, sharex=True)
    for k, (axes, (name, own)) in enumerate(zip(every, drawn, strict=True)):
        _path(axes, own, ACCENT if name.startswith("C_") else PALETTE[2], name)
        axes.set(title=name, ylabel="" if k % 5 else "contribution (µm)")
        if k + 5 >= len(drawn):
            axes.tick_params(labelbottom=True)
    every[0].set(xlim=(0.0, 360.0), xticks=range(0, 361, 90))
    figure.supxlabel(f"angle of the bar (°), at {force:g} N", fontsize=9)
    return figure


def _path(axes: Axes, path: Array, colour: Any, label: str) -> None:
    closed = np.concatenate([path, path[:, :1]], axis=1)
    low, high = np.quantile(closed, [0.025, 0.975], axis=0)
    band(axes, np.arange(361), low, high, colour)
    axes.plot(np.arange(361), closed.mean(axis=0), color=colour, label=label)


# ---- atlases


@styled
def compliance_atlas(machine: Machine, circle: Circle | None = None) -> Figure:
    """The patterns of all joint compliances, proportional sets in one colour, the kept representative in bold."""
    where = circle or Circle(plane=machine.planes[0])
    machine = Machine(machine.topology, where.plane, machine.frames_mm)
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
    where = circle or Circle(plane=machine.planes[0])
    machine = Machine(machine.topology, where.plane, machine.frames_mm)
    names = [name.label for name in geometric_names(machine)]
    columns = dict(zip(names, geometric_jacobian(machine, where, _GRID).T, strict=True))
    figure = _atlas(columns, dict.fromkeys(names, ACCENT), set(names), set(), 4)
    figure.suptitle(f"{machine.topology}, plane {machine.plane}: patterns of the geometric errors")
    return figure


def _atlas(columns: Mapping[str, Array], colour: Mapping[str, str], bold: set[str], null: set[str], width: int) -> Figure:
    figure, every = panels(len(columns), width, 1.65 * width, 1.9, 0.5, subplot_kw={"projection": "polar"})
    axes: Any
    for axes, (name, values) in zip(every, columns.items(), strict=True):
        peak = float(np.abs(values).max())
        swing = values / peak if name not in null and peak > 0.0 else np.zeros_like(values)
        axes.plot(_GRID, np.ones_like(_GRID), color=GREY, linewidth=0.8, linestyle=_DASHED)
        axes.plot(_GRID, 1.0 + _SWING * swing, color=colour.get(name, GREY), linewidth=2.0 if name in bold else 1.1)
        axes.set_rlim(0.0, 1.0 + 1.1 * _SWING)
        axes.set_rticks([])
        axes.spines["polar"].set_visible(False)
        axes.set_xticks(np.deg2rad([0, 90, 180, 270]), ["", "", "", ""])
        note = " (no effect)" if name in null else ""
        axes.set_title(display_name(name) + note, fontweight="bold" if name in bold else "normal", pad=4)
    return figure


FIGURES: Mapping[str, Callable[[xr.DataTree], Figure]] = MappingProxyType(
    {
        draw.__name__: draw
        for draw in (
            *(traces, residuals, forest, compliance_against_force, corner),
            *(contributions, parameter_contributions, circularity),
        )
    }
)


def save_figures(
    posterior: xr.DataTree, folder: str | os.PathLike[str], *, formats: tuple[str, ...] = ("png", "svg")
) -> list[Path]:
    """Draw every figure of a posterior into a folder; returns the files written."""
    return [path for name, draw in FIGURES.items() for path in style.save_figure(draw(posterior), folder, name, formats=formats)]
