"""Figures of a posterior: its parameters, its circles, and what these are made of; and the atlases
of a machine's patterns."""

from __future__ import annotations

import os
import re
import textwrap
import tomllib
from collections.abc import Callable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ldbb_bayes.analysis import circularity as of_path
from ldbb_bayes.analysis import path_contributions
from ldbb_bayes.analysis.circle_columns import first_circle
from ldbb_bayes.analysis.measured_paths import measured_circularity
from ldbb_bayes.campaign.campaign import distinct_forces
from ldbb_bayes.errors import check_known
from ldbb_bayes.inference.coefficients import new_circle_coefficients, shared_coefficients
from ldbb_bayes.inference.posterior import bound_of, curves_of, draws_of, record_of
from ldbb_bayes.inference.prediction import band_um
from ldbb_bayes.inference.residuals import residuals_mm
from ldbb_bayes.inference.summary import numbers_of, priors_of
from ldbb_bayes.machine.chain import PLANES, Circle, Machine
from ldbb_bayes.machine.linear import geometric_jacobian, kept_compliances, wrench_jacobian
from ldbb_bayes.machine.parameters import geometric_names, wrench_names
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.prior import compliance_unit
from ldbb_bayes.report.figures import style
from ldbb_bayes.report.figures.style import ACCENT, FAINT, GREY, PALETTE, band, panels, styled
from ldbb_bayes.results import Array
from ldbb_bayes.units import (
    display_name,
    display_unit,
    inside_name,
    plus_minus,
    round_like,
    round_uncertainty,
)

__all__ = [
    "FIGURES",
    "WORDS",
    "circularity",
    "compliance_against_force",
    "compliance_atlas",
    "contributions",
    "corner",
    "forest",
    "geometric_atlas",
    "parameter_contributions",
    "residuals",
    "save_figures",
    "traces",
]

# Direct compliances, rotations for moments, scale gains, squareness.
_CORNER = (r"C_([XYZ])\1.", r"C_([ABC])\1.", r"E_([XYZ])\1\d", r"E_[ABC]0..")
_MOST_IN_CORNER = 8
_DRAWS = 600
_DRAWS_OF_PATHS = 500
_DRAWS_OF_CURVES = 1500
_MOST_DOTS = 2400
_MOST_FORCES = 6
_MOST_BANDS = 12
_MOST_NAMED = 9
_GRID = np.linspace(0.0, 2 * np.pi, 361)
_RISE = 0.45
_DASHED = (0, (4, 3))
_BOXED = MappingProxyType({"facecolor": "white", "edgecolor": "none", "pad": 0.5, "alpha": 0.85})


_CATALOGUE = files("ldbb_bayes.report") / "templates" / "words_en.toml"
# What the figures of the sheets say, for another language to say otherwise.
WORDS: Mapping[str, str] = MappingProxyType(
    tomllib.loads(_CATALOGUE.read_text(encoding="utf-8"))["figures"]
)


# ---- parameters


@styled
def forest(posterior: xr.DataTree) -> Figure:
    """Every parameter's 95 % and 50 % interval in its own unit, a panel for each; faint: 95 % of
    its prior; right: value ± U."""
    group, (prior_sd, _) = posterior["posterior"], priors_of(posterior)
    units = {name: group[name].attrs["unit"] for name in record_of(posterior)["model"]["groups"]}
    groups: dict[tuple[float, str], list[str]] = {}
    for name, unit in units.items():
        groups.setdefault(display_unit(unit), []).append(name)
    sizes = [len(names) + 0.2 for names in groups.values()]
    figure = style.new_figure(style.WIDTH, 0.35 + 0.19 * sum(sizes) + 0.4 * len(sizes))
    every = figure.subplots(len(sizes), 1, squeeze=False, height_ratios=sizes)[:, 0]
    for axes, ((factor, label), names) in zip(every, groups.items(), strict=True):
        rows = style.name_rows(axes, names)
        texts = []
        for row, name in zip(rows, names, strict=True):
            draws = np.asarray(group[name]).ravel()
            found = numbers_of(draws, 0.95)
            first, last = np.quantile(draws, [0.25, 0.75]) * factor
            axes.plot(
                [found["ci_low"] * factor, found["ci_high"] * factor],
                [row, row],
                color=ACCENT,
                linewidth=1.4,
            )
            axes.plot([first, last], [row, row], color=ACCENT, linewidth=4.0, solid_capstyle="butt")
            axes.plot(
                found["mean"] * factor,
                row,
                "o",
                color="white",
                markeredgecolor=ACCENT,
                markersize=3.6,
            )
            texts.append(
                plus_minus(
                    found["mean"], found["sd"], (found["ci_low"], found["ci_high"]), units[name]
                )
            )
        axes.axvline(0.0, color=GREY, linewidth=0.8)
        axes.set_xlim(
            axes.get_xlim()
        )  # as wide as the readings leave it: a prior may be much wider
        for row, name in zip(rows, names, strict=True):
            if prior_sd[name] is not None:
                before = np.quantile(np.asarray(posterior["prior"][name]), [0.025, 0.975]) * factor
                axes.plot(before, [row, row], color=FAINT, linewidth=0.8, zorder=1)
        axes.set_xlabel(f"value ({label})")
        style.right_labels(axes, rows, texts)
    flat = all(prior_sd[name] is None for name in units)
    title = "95 % and 50 % intervals; dot: mean; right: value ± U (k = 2) or 95 % interval"
    figure.suptitle(
        title if flat else f"{title}\nFaint line: 95 % of the prior, as far as the panel goes"
    )
    return figure


@styled
def compliance_against_force(posterior: xr.DataTree, words: Mapping[str, str] = WORDS) -> Figure:
    """C(F) of every compliance with its 95 % band over the tested forces; ``words``: labels, by
    default English."""
    bound = bound_of(posterior)
    forces = bound.setting.force_N
    force = (
        np.linspace(forces.min(), forces.max(), 31)
        if np.ptp(forces) > 0
        else forces[0] * np.array([0.95, 1.05])
    )
    curves = curves_of(posterior, force, _DRAWS_OF_CURVES)
    few = len(bound.compliances) <= 6
    columns = 3 if few else 5
    figure, every = panels(len(bound.compliances), columns, 1.7 if few else 1.2, 0.3, sharex=True)
    for j, (axes, kind) in enumerate(zip(every, bound.compliances, strict=True)):
        factor, text = style.axis_label(kind.label, compliance_unit(kind))
        value = curves[:, :, j] * factor
        band(
            axes,
            force,
            np.quantile(value, [0.025, 0.975], axis=0),
            ACCENT,
            0.3,
            label=words["interval"],
        )
        axes.plot(force, value.mean(axis=0), color=ACCENT, label=words["mean"])
        foot = axes.get_xaxis_transform()
        look: dict[str, Any] = {
            "color": "black",
            "markersize": 4,
            "clip_on": False,
            "transform": foot,
        }
        axes.plot(forces, np.zeros_like(forces), "^", label=words["tested"], **look)
        axes.axhline(0.0, color=GREY, linewidth=0.8)
        name = axes.set_ylabel if few else axes.set_title
        name(text, fontsize=9 if few else 6.5)
        axes.tick_params(labelsize=8 if few else 7)
        if j + columns >= len(every):
            axes.set_xlabel(words["force"])
            axes.tick_params(labelbottom=True)
    style.legend_below(figure, every[0])
    return figure


@styled
def corner(posterior: xr.DataTree, names: Sequence[str] | None = None) -> Figure:
    """Pairwise posterior of a few parameters.

    InputError for a parameter the posterior does not have.

    Parameters
    ----------
    names : default: the direct compliances, C_CCY, and the geometric errors that share their
        patterns, where the model has them.
    """
    from corner import corner as draw_corner  # brings pyplot

    group = posterior["posterior"]
    if names is None:
        every = list(record_of(posterior)["model"]["groups"])
        names = [name for kind in _CORNER for name in every if re.fullmatch(kind, name)][
            :_MOST_IN_CORNER
        ] or every[:6]
    names = [inside_name(name) for name in names]
    check_known("parameter", names, [str(name) for name in group.data_vars])
    columns = {}
    for name in names:
        factor, label = style.axis_label(name, group[name].attrs["unit"])
        draws = np.asarray(group[name]).ravel() * factor
        if np.ptp(draws) > 0:
            columns[label.replace(" (", "\n(")] = draws
    figure = Figure(figsize=(1.55 * len(columns) + 0.6,) * 2)
    look: dict[str, Any] = {
        "color": ACCENT,
        "plot_datapoints": False,
        "max_n_ticks": 3,
        "labelpad": 0.14,
    }
    values = np.column_stack(list(columns.values()))
    draw_corner(
        values, fig=figure, labels=list(columns), levels=(0.393, 0.865), smooth=1.0, bins=30, **look
    )
    for axes in figure.axes:
        axes.grid(visible=False)
        axes.tick_params(labelsize=7)
    figure.subplots_adjust(left=0.13, bottom=0.13, right=0.98, top=0.94, wspace=0.08, hspace=0.08)
    figure.suptitle("Joint posterior: contours hold 39 % and 86 % (1 and 2 sd)")
    return figure


# ---- circles


@styled
def traces(posterior: xr.DataTree, words: Mapping[str, str] = WORDS) -> Figure:
    """Polar traces of all tests, plane by plane: readings, prediction (machine, bar and balls), of
    few tests the 95 % band for a new circle, rings in µm, forces along a scale in the order of the
    traces; ``words``: labels, by default English."""
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound, _DRAWS)
    rng = np.random.default_rng(0)
    predicted = shared_coefficients(bound, phi, beta).mean(axis=0) @ basis(_GRID).T * 1e3
    tests = bound.campaign.tests
    forces = bound.setting.force_N
    readings = [test.readings_mm() * 1e3 for test in tests]
    banded = len(tests) <= _MOST_BANDS
    thin = float(np.clip(_MOST_BANDS / len(tests), 0.35, 1.0))
    new = new_circle_coefficients(bound, phi, beta, rng) if banded else np.zeros(0)
    low = min(r.min() for r in readings)
    high = max(r.max() for r in readings)
    span = max(high - low, 1e-3)
    zero = 0.9 * span - low
    step = _round_step(span / 4.0)
    rings = np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step + 0.0
    planes = bound.setting.planes
    colours = style.force_colours(forces.tolist())
    every = -(-sum(map(len, readings)) // _MOST_DOTS)
    heads = [_head(bound, plane, every, zero, banded, words) for plane in planes]
    figure = Figure(
        figsize=(0.75 + 3.6 * len(planes), 3.5 + 0.12 * max(head.count("\n") + 1 for head in heads))
    )
    across = figure.get_figwidth()
    up = figure.get_figheight()
    for k, plane in enumerate(planes):
        axes: Any = figure.add_axes(
            ((0.4 + 3.6 * k) / across, 0.25 / up, 2.9 / across, 2.9 / up), projection="polar"
        )
        here = [r for r, test in enumerate(tests) if test.plane == plane]
        both = plane in bound.setting.both_ways
        for r in here:
            if banded:
                band(
                    axes,
                    _GRID[::3],
                    zero + band_um(new[:, r], phi[:, 0], _GRID[::3], rng),
                    colours[r],
                    0.25,
                )
            dots = slice(None, None, every)
            axes.plot(
                tests[r].angles_rad()[dots],
                zero + readings[r][dots],
                ".",
                color=colours[r],
                markersize=1.4 * thin,
            )
            dotted = ":" if both and tests[r].direction == "CCW" else "-"
            axes.plot(
                _GRID[::2],
                zero + predicted[r][::2],
                color=colours[r],
                linewidth=thin,
                linestyle=dotted,
            )
        axes.plot(
            _GRID[::2],
            np.full_like(_GRID[::2], zero),
            color="black",
            linewidth=0.8,
            linestyle=_DASHED,
        )
        ends = {0: f"+{PLANES[plane].first}", 90: f"+{PLANES[plane].second}"}
        axes.set_xticks(
            np.deg2rad(range(0, 360, 45)),
            [ends.get(angle, f"{angle}°") for angle in range(0, 360, 45)],
        )
        axes.tick_params(pad=0)
        axes.set_rlim(0.0, zero + high + 0.06 * span)
        axes.set_rgrids((zero + rings).tolist(), [""] * len(rings))
        for ring, unit in zip(rings, [""] * (len(rings) - 1) + [" µm"], strict=True):
            text = f"{ring:g}{unit}".replace("-", "−")
            axes.text(
                np.deg2rad(247.5),
                zero + ring,
                text,
                fontsize=7,
                ha="center",
                va="center",
                zorder=5,
                bbox=_BOXED,
            )
        axes.set_title(heads[k], fontsize=7, pad=8)
    levels = np.unique(forces)
    mean = [
        np.mean([r.mean() for r, own in zip(readings, forces, strict=True) if own == force])
        for force in levels[[0, -1]]
    ]
    _force_scale(figure, levels, bool(mean[-1] >= mean[0]), words["force"])
    return figure


def _head(
    bound: BoundModel, plane: str, every: int, zero: float, banded: bool, words: Mapping[str, str]
) -> str:
    """What the marks of one plane mean, in lines that its circle is wide enough for."""
    radii = {
        radius
        for radius, own in zip(bound.setting.radius_mm, bound.setting.plane, strict=True)
        if own == plane
    }
    said = [
        words["readings" if every == 1 else "some_readings"].format(every=every),
        words["prediction"],
    ]
    said += [
        words[key]
        for key, there in (("counterclockwise", plane in bound.setting.both_ways), ("band", banded))
        if there
    ]
    scale = words["rings" if len(radii) == 1 else "rings_of_several_radii"].format(
        scale=f"{max(radii) * 1e3 / zero:.0f}"
    )
    lines = [
        f"{words['plane']} {plane}",
        ", ".join(said),
        scale.replace(" : ", "\N{NO-BREAK SPACE}:\N{NO-BREAK SPACE}"),
    ]
    return "\n".join(textwrap.fill(line, 72) for line in lines[len(bound.setting.planes) == 1 :])


def _force_scale(figure: Figure, forces: Array, outward: bool, label: str) -> None:
    """Draw a colour for every force, from the innermost trace (below) to the outermost, with at
    most nine of them named."""
    across = figure.get_figwidth()
    count = len(forces)
    axes = figure.add_axes((1.0 - 0.55 / across, 0.14, 0.14 / across, 0.56))
    rows = np.arange(count) if outward else np.arange(count)[::-1]
    colours = style.force_colours(forces.tolist())
    gap = 0.5 * (count <= _MOST_BANDS)
    axes.barh(rows, np.ones(count), 1.0, color=colours, edgecolor="white", linewidth=gap)
    shown = np.unique(np.linspace(0, count - 1, _MOST_NAMED).round().astype(int))
    axes.yaxis.tick_right()
    axes.set(xlim=(0.0, 1.0), ylim=(-0.5, count - 0.5), xticks=[])
    axes.set_yticks(rows[shown], [f"{force:.4g}" for force in forces[shown]])
    axes.tick_params(length=0, pad=2, labelsize=7)
    axes.set_title(label, fontsize=7)
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)


def _round_step(size: float) -> float:
    power = 10.0 ** np.floor(np.log10(size))
    return float(power * min((1.0, 2.0, 5.0, 10.0), key=lambda m: abs(m * power - size)))


@styled
def residuals(posterior: xr.DataTree) -> Figure:
    """Reading minus prediction (machine, bar and balls) against angle, of ten tests at most."""
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound, _DRAWS)
    rest = [
        r * 1e3 for r in residuals_mm(bound, shared_coefficients(bound, phi, beta).mean(axis=0))
    ]
    tests = bound.campaign.tests
    colours = style.force_colours(bound.setting.force_N.tolist())
    shown = np.unique(np.linspace(0, len(rest) - 1, 10).astype(int)).tolist()
    figure, every = panels(len(shown), 1, 0.6, 0.9, sharex=True, sharey=True)
    limit = 1.05 * max(np.abs(r).max() for r in rest)
    step = _round_step(0.7 * limit)
    for axes, r in zip(every, shown, strict=True):
        angle = np.mod(tests[r].angle_deg, 360.0)
        order = np.argsort(angle)
        axes.plot(angle[order], rest[r][order], color=colours[r], linewidth=0.6)
        axes.set_ylabel(f"{tests[r].name}\n(µm)", rotation=0, ha="right", va="center")
        axes.set(ylim=(-limit, limit), yticks=(-step, 0.0, step))
    every[-1].set(xlim=(0.0, 360.0), xticks=range(0, 361, 45), xlabel="angle of the bar (°)")
    few = "" if len(shown) == len(rest) else f", {len(shown)} of {len(rest)} tests"
    figure.suptitle(
        f"Reading minus prediction{few}; each circle's own shift and discrepancy are left in"
    )
    return figure


_PANELS: tuple[tuple[tuple[str, ...], str], ...] = (
    (("G",), "G (µm)"),
    (("F_max", "F_min"), "F_max, F_min (µm)"),
    (("squareness",), "squareness (µm/m)"),
    (("scale_mismatch",), "scale mismatch (µm/m)"),
)


@styled
def circularity(posterior: xr.DataTree) -> Figure:
    """G, F_max and F_min, squareness and scale mismatch of the machine's path against force with 95
    % bands; crosses: of the readings themselves, balls and bar included."""
    bound = bound_of(posterior)
    top = float(bound.setting.force_N.max())
    table = of_path.circularity(
        posterior, np.linspace(0.0, top, 13).tolist(), draws=_DRAWS_OF_PATHS
    )
    measured, _ = measured_circularity(posterior)
    planes = bound.setting.planes
    figure, every = panels(4 * len(planes), 2, 1.8, 0.3)
    for k, (axes, (names, label)) in enumerate(zip(every, _PANELS * len(planes), strict=True)):
        plane = planes[k // 4]
        own = table[table["plane"] == plane]
        # Other radii have other paths: only readings of the circle that is drawn.
        read = measured[
            (measured["plane"] == plane) & (measured["radius_mm"] == own["radius_mm"].iloc[0])
        ]
        for name, colour in zip(names, PALETTE, strict=False):
            rows = own[own["quantity"] == name]
            band(axes, rows["force_N"], (rows["ci_low"], rows["ci_high"]), colour)
            axes.plot(rows["force_N"], rows["median"], color=colour)
            axes.plot(read["force_N"], read[name].astype(float), "x", color=colour, markersize=4)
        axes.set(xlabel="force (N)", ylabel=label, xlim=(-0.02 * top, 1.02 * top))
        if len(planes) > 1:
            axes.set_title(f"Plane {plane}")
    figure.suptitle(
        "The machine's path: median and 95 % band; crosses: the readings, balls and bar included"
    )
    return figure


_SOURCES = {
    path_contributions.TOGETHER: ("black", "-"),
    path_contributions.COMPLIANCE: (PALETTE[0], "--"),
    path_contributions.GEOMETRY: (PALETTE[1], ":"),
}


@styled
def contributions(posterior: xr.DataTree) -> Figure:
    """Compliance, geometry and both against angle, a panel for each of up to six forces, with 95 %
    bands and the peak to peak of both; offsets of the tool ball left out (Fig. 8)."""
    bound = bound_of(posterior)
    forces = distinct_forces(bound.setting.force_N)
    forces = forces[np.unique(np.linspace(0, len(forces) - 1, _MOST_FORCES).round().astype(int))]
    planes = bound.setting.planes
    cases = [(plane, float(force)) for plane in planes for force in forces]
    figure, every = panels(len(cases), 3, 1.5, 0.6, sharex=True, sharey=True)
    for axes, (plane, force) in zip(every, cases, strict=True):
        drawn = _paths(posterior, bound, plane, force, *_SOURCES)
        for source, (colour, line) in _SOURCES.items():
            if source in drawn:
                _path(axes, drawn[source], colour, linestyle=line, label=source)
        where = f"{plane}, " if len(planes) > 1 else ""
        axes.set_title(
            f"{where}{force:g} N: {_swing(drawn[path_contributions.TOGETHER])}", fontsize=8
        )
    _outer(every, 3)
    style.legend_below(figure, every[0])
    figure.suptitle(_HEAD.format("of both together"))
    return figure


@styled
def parameter_contributions(posterior: xr.DataTree) -> Figure:
    """Every compliance (with slope) and geometric error at the highest force, 95 % bands and peak
    to peak (Figs. 9 and 10)."""
    bound = bound_of(posterior)
    force = float(bound.setting.force_N.max())
    planes = bound.setting.planes
    cases = [
        (f"{display_name(name)}{f', {plane}' if len(planes) > 1 else ''}", name, path)
        for plane in planes
        for name, path in _paths(posterior, bound, plane, force, *bound.names).items()
    ]
    figure, every = panels(len(cases), 4, 1.25, 0.5, sharex=True)
    for axes, (shown, name, path) in zip(every, cases, strict=True):
        _path(axes, path, ACCENT if name.startswith("C_") else PALETTE[1])
        axes.set_title(f"{shown}\n{_swing(path)}", fontsize=8)
    _outer(every, 4)
    figure.suptitle(f"At {force:g} N. {_HEAD.format('of each alone')}")
    return figure


_HEAD = "Line: mean, band: 95 %\nAbove: peak to peak {}, median and 95 % interval"


def _outer(every: Sequence[Axes], columns: int) -> None:
    for k, axes in enumerate(every):
        axes.set(
            xlim=(0.0, 360.0), xticks=(0, 180, 360), ylabel="" if k % columns else "reading (µm)"
        )
        axes.tick_params(labelbottom=k + columns >= len(every))
        if k // columns == (len(every) - 1) // columns:
            axes.set_xlabel("angle (°)")


def _paths(
    posterior: xr.DataTree, bound: BoundModel, plane: str, force_N: float, *only: str
) -> Mapping[str, Array]:
    """Paths on the first circle of a plane, (draws, 360) [µm], all or only these: of the very draws
    of `analysis.path_contributions.contributions`."""
    r, (beta, _) = (
        first_circle(bound, plane),
        draws_of(posterior, bound, path_contributions.DRAWS),
    )
    return path_contributions.contribution_paths(bound, r, force_N, beta, only)


def _swing(path: Array) -> str:
    """Peak to peak of paths, median and 95 % interval, as `analysis.path_contributions.contributions` has
    it: 17.2 [11.5, 39.8] µm."""
    low, median, high = np.quantile(np.ptp(path, axis=1), [0.025, 0.5, 0.975])
    _, decimals = round_uncertainty((high - low) / 4.0)
    return (
        f"{round_like(median, decimals)} [{round_like(low, decimals)},"
        f" {round_like(high, decimals)}] µm"
    )


def _path(axes: Axes, path: Array, colour: Any, **look: Any) -> None:
    closed = np.append(path, path[:, :1], axis=1)
    band(axes, np.arange(0, 361, 3), np.quantile(closed[::5, ::3], [0.025, 0.975], axis=0), colour)
    axes.plot(np.arange(0, 361, 2), closed[:, ::2].mean(axis=0), color=colour, **look)


# ---- atlases


@styled
def compliance_atlas(machine: Machine, circle: Circle | None = None) -> Figure:
    """The patterns of all joint compliances, proportional sets in one colour, the kept
    representative in bold."""
    where = circle or Circle(plane=machine.planes[0])
    machine = Machine(machine.topology, where.plane, machine.frames_mm)
    names = [name.label for name in wrench_names(machine)]
    kept = kept_compliances(machine, where)
    colour = {
        name: PALETTE[k % len(PALETTE)] for k, members in enumerate(kept.sets) for name in members
    }
    columns = dict(zip(names, wrench_jacobian(machine, where, _GRID).T, strict=True))
    title = (
        f"{machine.topology}, plane {machine.plane}: patterns of the {len(names)} joint"
        " compliances\n"
    )
    title += "One colour: proportional, only their sum can be identified. Bold: kept"
    return _atlas(columns, colour, {name.label for name in kept.names}, set(kept.null), title)


@styled
def geometric_atlas(machine: Machine, circle: Circle | None = None) -> Figure:
    """The patterns of the geometric errors."""
    where = circle or Circle(plane=machine.planes[0])
    machine = Machine(machine.topology, where.plane, machine.frames_mm)
    names = [name.label for name in geometric_names(machine)]
    columns = dict(zip(names, geometric_jacobian(machine, where, _GRID).T, strict=True))
    title = f"{machine.topology}, plane {machine.plane}: patterns of the geometric errors"
    return _atlas(columns, dict.fromkeys(names, ACCENT), set(names), set(), title)


def _atlas(
    columns: Mapping[str, Array],
    colour: Mapping[str, str],
    bold: set[str],
    null: set[str],
    title: str,
) -> Figure:
    figure, every = panels(len(columns), 4, 1.7, 0.7, subplot_kw={"projection": "polar"})
    axes: Any
    for axes, (name, values) in zip(every, columns.items(), strict=True):
        peak = float(np.abs(values).max())
        swing = values / peak if name not in null and peak > 0.0 else np.zeros_like(values)
        axes.plot(_GRID, np.ones_like(_GRID), color=GREY, linewidth=0.8, linestyle=_DASHED)
        axes.plot(
            _GRID,
            1.0 + _RISE * swing,
            color=colour.get(name, GREY),
            linewidth=2.0 if name in bold else 1.1,
        )
        axes.set_rlim(0.0, 1.0 + 1.1 * _RISE)
        axes.set_rticks([])
        axes.spines["polar"].set_visible(False)
        axes.set_xticks(np.deg2rad([0, 90, 180, 270]), ["", "", "", ""])
        note = " (no effect)" if name in null else ""
        axes.set_title(
            display_name(name) + note, fontweight="bold" if name in bold else "normal", pad=4
        )
    figure.suptitle(title)
    return figure


_DRAWN = (
    traces,
    residuals,
    forest,
    compliance_against_force,
    corner,
    contributions,
    parameter_contributions,
    circularity,
)
FIGURES: Mapping[str, Callable[[xr.DataTree], Figure]] = MappingProxyType(
    {draw.__name__: draw for draw in _DRAWN}
)


def save_figures(
    posterior: xr.DataTree,
    folder: str | os.PathLike[str],
    *,
    formats: tuple[str, ...] = ("png", "svg"),
) -> list[Path]:
    """Draw every figure of a posterior into a ``folder``, in these ``formats`` (png, svg, pdf), and
    return the files written."""
    return [
        path
        for name, draw in FIGURES.items()
        for path in style.save_figure(draw(posterior), folder, name, formats=formats)
    ]
