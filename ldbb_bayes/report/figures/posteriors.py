"""Figures of a posterior: its parameters, its circles, and what these are made of; and the atlases of a machine's patterns."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import corner as corner_library
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import rankdata

from ldbb_bayes.analysis.circularity import COMPLIANCE, GEOMETRY, TOGETHER, contribution_paths, first_circle, measured_circularity
from ldbb_bayes.analysis.circularity import circularity as quantities
from ldbb_bayes.campaign.campaign import distinct_forces
from ldbb_bayes.errors import check_known
from ldbb_bayes.inference.posterior import bound_of, diagnose, draws_of, priors_of, record_of
from ldbb_bayes.inference.predictive import (
    band_um,
    new_circle_coefficients,
    prior_circle_coefficients,
    residual_coefficients,
    residuals_mm,
    shared_coefficients,
)
from ldbb_bayes.machine.chain import PLANES, Circle, Machine, geometric_names, wrench_names
from ldbb_bayes.machine.forward import geometric_jacobian, wrench_jacobian
from ldbb_bayes.machine.identifiable import kept_compliances
from ldbb_bayes.model.fourier import MAX_ORDER, ORDERS, basis
from ldbb_bayes.model.prior import compliance_unit
from ldbb_bayes.report.figures.style import (
    ACCENT,
    GREY,
    LIGHT,
    PALETTE,
    angle_axis,
    axis_label,
    band,
    force_colours,
    legend_below,
    mean_and_sd,
    named_rows,
    new_figure,
    panels,
    right_labels,
    save_figure,
    styled,
)
from ldbb_bayes.units import display_name, ranked

__all__ = [
    "FIGURES",
    "chains",
    "circularity",
    "compliance_against_force",
    "compliance_atlas",
    "contributions",
    "corner",
    "forest",
    "geometric_atlas",
    "parameter_contributions",
    "predictive",
    "residuals",
    "save_figures",
    "traces",
]

Array = NDArray[Any]
# Direct compliances, rotations for moments, scale gains, squareness.
_CORNER = (r"C_([XYZ])\1.", r"C_([ABC])\1.", r"E_([XYZ])\1\d", r"E_[ABC]0..")
_MOST_IN_CORNER, _RANK_BINS = 8, 20
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
    figure, axes, rows = named_rows(names, 8.4, 1.1)
    texts = []
    for row, name in zip(rows, names, strict=True):
        draws, prior, middle = group[name].to_numpy().ravel(), prior_sd[name], prior_mean.get(name, 0.0)
        scale = float(draws.std()) if prior is None else prior
        low, first, last, high = (np.quantile(draws, [0.025, 0.25, 0.75, 0.975]) - middle) / scale
        if prior is not None:
            before = (np.quantile(posterior["prior"][name].to_numpy(), [0.025, 0.975]) - middle) / scale
            axes.plot(before, [row, row], color=LIGHT, linewidth=7, solid_capstyle="butt", zorder=1)
        axes.plot([low, high], [row, row], color=ACCENT, linewidth=1.4, zorder=2)
        axes.plot([first, last], [row, row], color=ACCENT, linewidth=3.6, solid_capstyle="butt", zorder=3)
        axes.plot((draws.mean() - middle) / scale, row, "o", color="white", markeredgecolor=ACCENT, markersize=3.6, zorder=4)
        texts.append(mean_and_sd(float(draws.mean()), float(draws.std()), group[name].attrs["unit"]))
    flat = all(prior_sd[name] is None for name in names)
    value = "(value − prior mean)" if any(prior_mean.values()) else "value"
    axes.set_xlabel(f"{value} / {'posterior' if flat else 'prior'} sd")
    right_labels(axes, rows, texts)
    grey = "" if flat else "; grey: 95 % of the prior"
    axes.set_title(f"95 % and 50 % credible intervals{grey}; dot and right: mean, ± 1 sd")
    return figure


@styled
def compliance_against_force(posterior: xr.DataTree) -> Figure:
    """C(F) of every kept compliance with 50 % and 95 % bands over the tested forces."""
    bound = bound_of(posterior)
    beta, _ = draws_of(posterior, bound)
    forces = bound.setting.force_N
    force = np.linspace(forces.min(), forces.max(), 80) if np.ptp(forces) > 0 else forces[0] * np.array([0.95, 1.05])
    figure, every = panels(len(bound.compliances), min(3, len(bound.compliances)), 9.0, 2.6, 0.3)
    for j, (axes, kind) in enumerate(zip(every, bound.compliances, strict=True)):
        factor, text = axis_label(kind.label, compliance_unit(kind))
        value = beta @ np.stack([bound.compliance_at(f)[j] for f in force], axis=1) * factor
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
    group = posterior["posterior"]
    if names is None:
        every = list(record_of(posterior)["model"]["groups"])
        names = [name for kind in _CORNER for name in every if re.fullmatch(kind, name)][:_MOST_IN_CORNER] or every[:6]
    check_known("parameter", names, [str(name) for name in group.data_vars])
    columns = {}
    for name in names:
        factor, label = axis_label(name, group[name].attrs["unit"])
        draws = group[name].to_numpy().ravel() * factor
        if np.ptp(draws) > 0:
            columns[label.replace(" (", "\n(")] = draws
    size = 1.55 * len(columns) + 0.6
    figure = Figure(figsize=(size, size))
    corner_library.corner(
        np.column_stack(list(columns.values())),
        fig=figure,
        labels=list(columns),
        color=ACCENT,
        levels=(0.393, 0.865),
        smooth=1.0,
        bins=30,
        plot_datapoints=False,
        max_n_ticks=3,
        labelpad=0.14,
        label_kwargs={"fontsize": 8.5},
        hist_kwargs={"linewidth": 1.2},
    )
    for axes in figure.axes:
        axes.grid(visible=False)
        axes.tick_params(labelsize=7)
    figure.subplots_adjust(left=0.13, bottom=0.13, right=0.98, top=0.94, wspace=0.08, hspace=0.08)
    figure.suptitle("Joint posterior: contours hold 39 % and 86 % (1 and 2 sd)")
    return figure


@styled
def chains(posterior: xr.DataTree, names: Sequence[str] | None = None) -> Figure:
    """Trace (median and 90 % of the walkers of each ensemble at every stored step) and ranks, worst parameters first.

    Parameters
    ----------
    names : sequence of str, optional
        Default: the five parameters with the smallest bulk ESS.
    """
    group = posterior["posterior"]
    every = [str(name) for name in group.data_vars]
    if names is None:
        names = ranked(every, lambda name: -diagnose(group[name].to_numpy())[0])[:5]
    check_known("parameter", names, every)
    walkers = int(record_of(posterior)["sampler"]["walkers"])
    figure = new_figure(9.0, 0.6 + 1.45 * len(names))
    rows = figure.subplots(len(names), 2, squeeze=False, width_ratios=(3, 2))
    for (left, right), name in zip(rows, names, strict=True):
        factor, label = axis_label(name, group[name].attrs["unit"])
        _trace_and_ranks(left, right, group[name].to_numpy() * factor, walkers)
        left.set_ylabel(label.replace(" (", "\n("))
        right.set_ylabel("relative\nfrequency (1)")
    rows[0, 0].set_title("Trace of the slowest parameters: median and 90 % of the walkers")
    rows[0, 1].set_title("Ranks: level when ensembles agree")
    rows[-1, 0].set_xlabel("stored step (1)")
    rows[-1, 1].set_xlabel("rank among all draws (1)")
    rows[0, 1].legend(loc="upper right", ncols=2)
    return figure


def _trace_and_ranks(left: Axes, right: Axes, draws: Array, walkers: int) -> None:
    by_walker = draws.reshape(len(draws), walkers, -1)
    ranks = rankdata(draws).reshape(draws.shape)
    edges = np.linspace(0.5, draws.size + 0.5, _RANK_BINS + 1)
    for k, colour in zip(range(len(draws)), PALETTE * 9, strict=False):
        low, median, high = np.quantile(by_walker[k], [0.05, 0.5, 0.95], axis=0)
        band(left, np.arange(len(median)), low, high, colour, 0.10)
        left.plot(median, color=colour, linewidth=1.0)
        counts = np.histogram(ranks[k], edges)[0]
        right.stairs(counts / counts.mean(), edges, baseline=None, color=colour, linewidth=1.0, label=f"ensemble {k + 1}")
    right.axhline(1.0, color="black", linewidth=0.6)
    right.set_ylim(0.0, 2.0)


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
    colours = force_colours(bound.setting.force_N.tolist())
    every = -(-sum(map(len, readings)) // _MOST_DOTS)
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
    """Reading minus prediction (machine and shared nuisances) against angle, and its amplitude by Fourier order."""
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound, _DRAWS)
    predicted = shared_coefficients(bound, phi, beta).mean(axis=0)
    rest = [r * 1e3 for r in residuals_mm(bound, predicted)]
    member = ORDERS[:, None] == np.arange(MAX_ORDER + 1)
    amplitude = np.sqrt(residual_coefficients(bound, predicted) ** 2 @ member) * 1e3
    tests, colours = bound.campaign.tests, force_colours(bound.setting.force_N.tolist())
    shown = np.unique(np.linspace(0, len(rest) - 1, 10).astype(int)).tolist()
    figure = new_figure(9.0, 1.2 + 0.72 * len(shown))
    grid = figure.add_gridspec(len(shown), 2, width_ratios=(3, 2))
    limit = 1.05 * max(np.abs(r).max() for r in rest)
    first = None
    for row, r in enumerate(shown):
        axes = figure.add_subplot(grid[row, 0], sharex=first, sharey=first)
        first, last = first or axes, row == len(shown) - 1
        angle = np.mod(tests[r].angle_deg, 360.0)
        order = np.argsort(angle)
        axes.plot(angle[order], rest[r][order], color=colours[r], linewidth=0.7)
        angle_axis(axes, 45)
        axes.set(ylim=(-limit, limit), xlabel="angle of the bar (°)" if last else "")
        axes.set_ylabel(f"{tests[r].name}\n(µm)", rotation=0, ha="right", va="center")
        axes.tick_params(labelbottom=last)
    figure.axes[0].set_title("Residual against angle (each circle's own shift and discrepancy left in)")
    right = figure.add_subplot(grid[:, 1])
    for test, own, colour in zip(tests, amplitude, colours, strict=True):
        right.plot(range(MAX_ORDER + 1), own, "o", color=colour, markersize=4, label=test.name)
    right.set(title="Amplitude by Fourier order", xlabel="order n (per revolution)", ylabel="amplitude (µm)")
    right.set_xticks(range(0, MAX_ORDER + 1, 2))
    right.set_ylim(bottom=0.0)
    if len(colours) <= 12:
        right.legend(loc="upper right", ncols=2)
    return figure


@styled
def predictive(posterior: xr.DataTree) -> Figure:
    """What the prior and what the posterior expect of a circle at the highest force, with the readings."""
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound, _DRAWS)
    rng = np.random.default_rng(0)
    top = int(np.argmax(bound.setting.force_N))
    test = bound.campaign.tests[top]
    figure, (left, right) = panels(2, 2, 9.0, 3.6, 0.0)

    def bands(axes: Axes, coefficients: Array, sigma: Array, colour: str, label: str) -> None:
        for prob, alpha in ((0.95, 0.25), (0.5, 0.4)):
            lower, upper = band_um(coefficients[:, top], sigma, _GRID, rng, prob=prob)
            band(axes, np.rad2deg(_GRID), lower, upper, colour, alpha, label=f"{label}, {100 * prob:g} %")

    if bound.model.prior.flat:
        left.text(0.5, 0.5, "flat prior: no prediction", ha="center", va="center", transform=left.transAxes)
    else:
        prior_beta, prior_phi = (
            np.stack([posterior["prior"][str(name)].to_numpy().ravel()[:_DRAWS] for name in names], axis=1)
            for names in (bound.names, bound.hyper_prior.names)
        )
        bands(left, prior_circle_coefficients(bound, prior_phi, prior_beta, rng), prior_phi[:, 0], GREY, "prior")
    bands(right, new_circle_coefficients(bound, phi, beta, rng), phi[:, 0], ACCENT, "posterior, new circle")
    for axes, title in ((left, "Prior predictive"), (right, "Posterior predictive")):
        axes.plot(np.mod(test.angle_deg, 360.0), test.reading_um, ".", color="black", markersize=1.5, label="readings")
        axes.set(title=f"{title}, {test.name} ({test.force_N:g} N)", ylabel="reading (µm)")
        angle_axis(axes)
        axes.legend(loc="upper right")
        bottom, ceiling = axes.get_ylim()
        axes.set_ylim(bottom, ceiling + 0.3 * (ceiling - bottom))
    return figure


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
        axes.set(xlabel="force (N)", ylabel=label, xlim=(-0.02 * top, 1.02 * top))
        axes.legend(loc="best")
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
    panel = iter(every)
    for plane in planes:
        paths = contribution_paths(bound, first_circle(bound, plane), force, beta)
        where = f", plane {plane}" if len(planes) > 1 else ""
        for kind, words in (("C_", f"Compliances at {force:g} N"), ("E_", "Geometric errors")):
            own = {name: path for name, path in paths.items() if name.startswith(kind)}
            size = {name: float(np.ptp(path.mean(axis=0))) for name, path in own.items()}
            # Those that reach a third of the largest, and the rest.
            limit = max(size.values(), default=0.0) / 3.0
            colours = dict(zip(own, (*PALETTE, GREY, "#F0E442") * 4, strict=False))
            for large, which in ((True, "the largest"), (False, "the others")):
                axes = next(panel)
                axes.set(title=f"{words}{where}: {which}", ylabel="contribution (µm)")
                angle_axis(axes)
                names = [name for name in own if (size[name] >= limit) is large]
                for name in names:
                    _path(axes, own[name], colours[name], f"{display_name(name)}: {size[name]:.2g} µm p-p")
                if names:
                    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)
                else:
                    axes.text(0.5, 0.5, "none", ha="center", va="center", transform=axes.transAxes)
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
            *(traces, residuals, forest, compliance_against_force, corner, chains),
            *(predictive, contributions, parameter_contributions, circularity),
        )
    }
)


def save_figures(
    posterior: xr.DataTree, folder: str | os.PathLike[str], *, formats: tuple[str, ...] = ("png", "svg")
) -> list[Path]:
    """Draw every figure of a posterior into a folder; returns the files written."""
    return [path for name, draw in FIGURES.items() for path in save_figure(draw(posterior), folder, name, formats=formats)]
