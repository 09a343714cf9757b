"""Figures of the circular tests to which a model was fitted: polar traces, and residuals."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from ldbb_bayes.inference.coefficients import mean_shared_coefficients, new_circle_coefficients
from ldbb_bayes.inference.posterior import bound_of, draws_of
from ldbb_bayes.inference.prediction import band_um
from ldbb_bayes.inference.residuals import residuals_mm
from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.report.figures import style
from ldbb_bayes.report.figures.parameter_figures import WORDS
from ldbb_bayes.report.figures.style import DASHED, band, panels, styled
from ldbb_bayes.results import Array

__all__ = ["MOST_BANDS", "residuals", "traces"]

_DRAWS = 600
# Largest number of dots in a figure of polar traces. Each dot is a reading of one of the tests.
_MOST_DOTS = 2400
# A figure of polar traces has 95 % bands only if it has at most this many tests. More bands would
# overlap too much.
MOST_BANDS = 12
# Largest number of labels on the colour scale of forces in a figure of polar traces.
_MOST_NAMED_FORCES = 9
# Largest number of tests whose residuals (reading minus prediction) a figure shows.
_MOST_RESIDUALS = 10
# Sizes in a figure of polar traces [inch]. A figure of one plane is narrow, because a sheet of the
# test certificate has a list beside it. A figure of several planes is as wide as a sheet.
_DIAMETER_OF_ONE = 2.9
_SHEET_WIDTH = 7.2
_DIAMETER_OF_SEVERAL = {2: 1.85, 3: 1.6}
_LEFT_MARGIN = 0.38
_GAP_BETWEEN_PANELS = {2: 0.65, 3: 0.55}
_ROOM_BELOW = 0.22
_ROOM_ABOVE = 0.28
_MARGIN_ABOVE = 0.05
_LINE_HEIGHT = 0.12
# Distance from the right edge of the last panel to the colour scale of forces, and from there to
# the explanation of the marks in a figure of two planes [inch].
_SCALE_GAP = 0.42
_EXPLANATION_GAP = 0.6
# Largest number of characters in a line of the explanation: above one panel, to the right of two
# panels, and above three panels.
_CHARACTERS = {1: 72, 2: 26, 3: 112}
_FONT_SIZE = 7
_ANGLE = np.linspace(0.0, 2 * np.pi, 361)
_BOX = MappingProxyType({"facecolor": "white", "edgecolor": "none", "pad": 0.5, "alpha": 0.85})


@dataclass(frozen=True, eq=False)
class _TraceData:
    """Readings, predictions and radial scale for a figure of polar traces.

    ``bound`` is the model applied to the campaign. ``beta`` holds random draws from the posterior
    of the p parameters, shape (draws, p). ``phi`` holds random draws from the posterior of the h
    hyper-parameters, such as the standard deviation of the noise, shape (draws, h). ``words`` is a
    mapping from the names of the figure's texts to the texts.
    """

    bound: BoundModel
    beta: Array
    phi: Array
    words: Mapping[str, str]

    @cached_property
    def readings_um(self) -> list[Array]:
        """Readings of each test [µm], in the order of the tests."""
        return [test.readings_mm() * 1e3 for test in self.bound.campaign.tests]

    @cached_property
    def predicted_um(self) -> Array:
        """Readings that the model predicts for each test [µm], shape (tests, 361).

        There is one value for each of the angles 0° … 360°. Each value is the mean over the random
        draws from the posterior. The prediction includes the effects of machine, bar and balls.
        """
        coefficients = mean_shared_coefficients(self.bound, self.phi, self.beta)
        return coefficients @ basis(_ANGLE).T * 1e3

    @cached_property
    def low(self) -> float:
        """Lowest reading of all tests [µm]."""
        return float(min(readings.min() for readings in self.readings_um))

    @cached_property
    def high(self) -> float:
        """Highest reading of all tests [µm]."""
        return float(max(readings.max() for readings in self.readings_um))

    @property
    def span(self) -> float:
        """Range of the readings of all tests [µm], or 0.001 µm if the range is smaller."""
        return max(self.high - self.low, 1e-3)

    @property
    def zero_radius(self) -> float:
        """Distance from the centre of a polar panel at which a reading of zero is drawn [µm].

        The distance is negative if all readings are far above zero. A zero reading then cannot be
        drawn in the panel.
        """
        return 0.9 * self.span - self.low

    @property
    def outer_radius(self) -> float:
        """Radius of a polar panel, in the unit in which readings are drawn [µm]."""
        return self.zero_radius + self.high + 0.06 * self.span

    @property
    def has_nominal_circle(self) -> bool:
        """Whether the circle on which readings of zero are drawn lies in the figure's panel."""
        return 0.0 < self.zero_radius <= self.outer_radius

    @property
    def has_bands(self) -> bool:
        """Whether the polar plot has 95 % bands, which it has only if there are few tests."""
        return len(self.bound.campaign.tests) <= MOST_BANDS

    @property
    def line_width(self) -> float:
        """Line width of the traces in a polar plot [points].

        The lines are thinner if there are many tests.
        """
        return float(np.clip(MOST_BANDS / len(self.bound.campaign.tests), 0.35, 1.0))

    @property
    def stride(self) -> int:
        """Step between the readings drawn as dots, such as 5 if every fifth reading is drawn."""
        number_of_readings = sum(len(readings) for readings in self.readings_um)
        return math.ceil(number_of_readings / _MOST_DOTS)

    @cached_property
    def colours(self) -> list[Any]:
        """Colour of each test's trace in a polar plot, which depends on the test's force."""
        return style.force_colours(self.bound.setting.force_N.tolist())


@styled
def traces(posterior: xr.DataTree, words: Mapping[str, str] = WORDS) -> Figure:
    """Draw polar traces of the readings of all tests, in one panel for each plane.

    Each panel shows the readings, the prediction of the model (effects of machine, bar and balls),
    and rings labelled in µm. Their explanation is above one panel or three, and beside two. If
    there are at most 12 tests, the panels also show the 95 % band for the readings of a new circle.
    A colour scale at the right shows the colour of each force. On this scale, forces increase
    upwards if the trace at the largest force lies outside the trace at the smallest force, and
    downwards if not.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample` or `load`.
    words : mapping of str to str
        Texts of the figure; the keys are the names of the texts. Default: English texts.

    Returns
    -------
    Figure
        A Matplotlib figure with a polar panel for each plane, and a panel for the scale of forces.

    Examples
    --------
    >>> figure = lb.figures.traces(posterior)
    >>> len(figure.axes)  # the plane XY, and the scale of forces
    2
    >>> figure.savefig("traces.png")
    """
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound, _DRAWS)
    trace_data = _TraceData(bound, beta, phi, words)
    rng = np.random.default_rng(0)
    layout = _layout(trace_data)
    figure = Figure(figsize=(layout.width, layout.height))
    panels_by_plane: dict[str, Any] = {}
    for plane, left in zip(bound.setting.tested_planes, layout.lefts, strict=True):
        panels_by_plane[plane] = figure.add_axes(layout.panel(left), projection="polar")
    if trace_data.has_bands:
        _draw_bands(panels_by_plane, trace_data, rng)
    for r, plane in enumerate(bound.setting.plane):
        _draw_trace(panels_by_plane[plane], trace_data, r)
    for plane, axes in panels_by_plane.items():
        _draw_rings(axes, trace_data, plane)
    _draw_force_scale(figure, trace_data, layout)
    _write_heads(figure, panels_by_plane, trace_data.words, layout)
    return figure


def _draw_bands(
    panels_by_plane: Mapping[str, Any], trace_data: _TraceData, rng: np.random.Generator
) -> None:
    """Draw the 95 % band of the readings of a new circle like each test, in its plane's panel."""
    phi = trace_data.phi
    sigma = phi[:, trace_data.bound.hyper_prior.names.index("sigma")]
    new_circles = new_circle_coefficients(trace_data.bound, phi, trace_data.beta, rng)
    for r, plane in enumerate(trace_data.bound.setting.plane):
        limits = band_um(new_circles[:, r], sigma, _ANGLE[::3], rng)
        radii = trace_data.zero_radius + limits
        band(panels_by_plane[plane], _ANGLE[::3], radii, trace_data.colours[r], 0.25)


@dataclass(frozen=True)
class _TraceLayout:
    """Sizes of a figure of polar traces and positions of its panels [inch].

    ``lefts`` holds the left edge of the circle of each panel, and ``diameter`` is the diameter of
    these circles. ``explanation`` holds the lines that explain dots, lines, bands and rings.
    """

    width: float
    height: float
    diameter: float
    lefts: tuple[float, ...]
    explanation: tuple[str, ...]

    @property
    def scale_left(self) -> float:
        """Left edge of the colour scale of forces [inch]."""
        return self.lefts[-1] + self.diameter + _SCALE_GAP

    def panel(self, left: float) -> tuple[float, float, float, float]:
        """Return the place of the panel whose circle begins at ``left``.

        The place is left edge, lower edge, width and height, as fractions of the figure.
        """
        return (
            left / self.width,
            _ROOM_BELOW / self.height,
            self.diameter / self.width,
            self.diameter / self.height,
        )


def _layout(trace_data: _TraceData) -> _TraceLayout:
    """Return the sizes of a figure of polar traces, which depend on the number of planes."""
    planes = trace_data.bound.setting.tested_planes
    count = len(planes)
    explanation = _explanation(trace_data)
    if count == 1:
        width = _LEFT_MARGIN + _DIAMETER_OF_ONE + _SCALE_GAP + 0.65
        room_above = 0.38 + _LINE_HEIGHT * len(explanation)
        height = _ROOM_BELOW + _DIAMETER_OF_ONE + room_above
        return _TraceLayout(width, height, _DIAMETER_OF_ONE, (_LEFT_MARGIN,), explanation)
    diameter = _DIAMETER_OF_SEVERAL[count]
    step = diameter + _GAP_BETWEEN_PANELS[count]
    lefts = tuple(_LEFT_MARGIN + k * step for k in range(count))
    height = _ROOM_BELOW + diameter + _ROOM_ABOVE
    if count > 2:
        height += _LINE_HEIGHT * len(explanation) + _MARGIN_ABOVE
    return _TraceLayout(_SHEET_WIDTH, height, diameter, lefts, explanation)


def _write_heads(
    figure: Figure,
    panels_by_plane: Mapping[str, Any],
    words: Mapping[str, str],
    layout: _TraceLayout,
) -> None:
    """Write the titles of the panels, and what explains dots, lines, bands and rings.

    The explanation is the title of a single panel. It is to the right of two panels, and above
    three, whose titles are the names of the planes.
    """
    explanation = "\n".join(layout.explanation)
    if len(panels_by_plane) == 1:
        (axes,) = panels_by_plane.values()
        axes.set_title(explanation, fontsize=_FONT_SIZE, pad=8)
        return
    for plane, axes in panels_by_plane.items():
        axes.set_title(f"{words['plane']} {plane}", fontsize=8, loc="left", y=1.0)
    left = _LEFT_MARGIN
    top = layout.height - _MARGIN_ABOVE
    if len(panels_by_plane) == 2:
        left = layout.scale_left + _EXPLANATION_GAP
        top = _ROOM_BELOW + layout.diameter
    figure.text(
        left / layout.width, top / layout.height, explanation, fontsize=_FONT_SIZE, va="top"
    )


def _draw_trace(axes: Any, trace_data: _TraceData, r: int) -> None:
    """Draw the readings and the prediction of the test with index ``r`` in a polar panel.

    ``axes`` is the panel, and ``trace_data`` holds the readings and predictions of all tests.
    """
    test = trace_data.bound.campaign.tests[r]
    colour = trace_data.colours[r]
    dots = slice(None, None, trace_data.stride)
    radius = trace_data.zero_radius + trace_data.readings_um[r][dots]
    axes.plot(
        test.angles_rad()[dots], radius, ".", color=colour, markersize=1.4 * trace_data.line_width
    )
    is_counterclockwise = test.direction == "CCW"
    both_ways = test.plane in trace_data.bound.setting.both_ways
    axes.plot(
        _ANGLE[::2],
        trace_data.zero_radius + trace_data.predicted_um[r][::2],
        color=colour,
        linewidth=trace_data.line_width,
        linestyle=":" if both_ways and is_counterclockwise else "-",
    )


def _draw_rings(axes: Any, trace_data: _TraceData, plane: str) -> None:
    """Draw the scale of the polar panel of one plane.

    The scale has rings labelled in µm, angles, and the names of the machine axes. The circle of
    zero readings is drawn if it lies in the panel.
    """
    zero = trace_data.zero_radius
    if trace_data.has_nominal_circle:
        circle = np.full_like(_ANGLE[::2], zero)
        axes.plot(_ANGLE[::2], circle, color="black", linewidth=0.8, linestyle=DASHED)
    angles = range(0, 360, 45)
    names = {0: f"+{PLANES[plane].first}", 90: f"+{PLANES[plane].second}"}
    axes.set_xticks(np.deg2rad(angles), [names.get(angle, f"{angle}°") for angle in angles])
    axes.tick_params(pad=0)
    axes.set_rlim(0.0, trace_data.outer_radius)

    # Panels of several planes are small, and have fewer rings.
    rings = 4.0 if len(trace_data.bound.setting.tested_planes) == 1 else 3.0
    step = _round_step(trace_data.span / rings)
    innermost = np.ceil(trace_data.low / step)
    outermost = np.floor(trace_data.high / step)
    # A ring at −0.0 is written as 0.
    rings_um = np.arange(innermost, outermost + 1) * step + 0.0
    axes.set_rgrids((zero + rings_um).tolist(), [""] * len(rings_um))
    for ring in rings_um:
        text = f"{ring:g}".replace("-", "−")
        if ring == rings_um[-1]:
            text += " µm"
        axes.text(
            np.deg2rad(247.5),
            zero + ring,
            text,
            fontsize=7,
            ha="center",
            va="center",
            zorder=5,
            bbox=_BOX,
        )


def _explanation(trace_data: _TraceData) -> tuple[str, ...]:
    """Return the lines that explain dots, lines, bands and rings of a figure of polar traces.

    The lines are in the language of ``trace_data.words``. To the right of two panels, each mark has
    a line of its own. Planes whose marks differ are explained one after the other, by name.
    """
    planes_by_marks: dict[tuple[str, ...], list[str]] = {}
    for plane in trace_data.bound.setting.tested_planes:
        planes_by_marks.setdefault(_marks(trace_data, plane), []).append(plane)
    count = len(trace_data.bound.setting.tested_planes)
    lines: list[str] = []
    for marks, planes in planes_by_marks.items():
        is_named = len(planes_by_marks) > 1
        name = f"{trace_data.words['plane']} {', '.join(planes)}:"
        if count == 1:
            lines += _lines_of_marks(marks[:-1], _CHARACTERS[count])
            lines += _lines_of_marks(marks[-1:], _CHARACTERS[count])
        elif count == 2:
            for mark in (name, *marks) if is_named else marks:
                lines += textwrap.wrap(mark, _CHARACTERS[count])
        else:
            first = f"{name} {marks[0]}" if is_named else marks[0]
            lines += _lines_of_marks((first, *marks[1:]), _CHARACTERS[count])
    return tuple(lines)


def _lines_of_marks(marks: Sequence[str], longest: int) -> list[str]:
    """Return texts on marks, separated by commas, in lines of at most ``longest`` characters.

    A line ends between two texts. Only a text that is itself too long is broken between its words.
    """
    lines: list[str] = []
    for k, mark in enumerate(marks):
        is_last = k == len(marks) - 1
        text = mark if is_last else f"{mark},"
        if lines and len(lines[-1]) + 1 + len(text) <= longest:
            lines[-1] += f" {text}"
        else:
            lines += textwrap.wrap(text, longest)
    return lines


def _marks(trace_data: _TraceData, plane: str) -> tuple[str, ...]:
    """Return what each mark in the polar panel of one plane means. The rings come last."""
    words = trace_data.words
    setting = trace_data.bound.setting
    readings = words["readings"]
    if trace_data.stride > 1:
        readings = words["some_readings"].format(every=trace_data.stride)
    marks = [readings, words["prediction"]]
    if plane in setting.both_ways:
        marks.append(words["counterclockwise"])
    if trace_data.has_bands:
        marks.append(words["band"])
    radii_mm = set()
    for radius, plane_of_test in zip(setting.radius_mm, setting.plane, strict=True):
        if plane_of_test == plane:
            radii_mm.add(radius)
    rings = words["rings"]
    if not trace_data.has_nominal_circle:
        rings = words["rings_without_nominal_circle"]
    elif len(radii_mm) > 1:
        rings = words["rings_of_several_radii"]
    return (*marks, rings)


def _draw_force_scale(figure: Figure, trace_data: _TraceData, layout: _TraceLayout) -> None:
    """Draw the colour scale of forces to the right of the panels.

    The scale has one coloured field for each force of the tests. At most ``_MOST_NAMED_FORCES`` of
    the fields are labelled with their force [N]. The figure shows the readings of each test as a
    trace around the circle. On the scale, forces increase upwards if the trace at the largest force
    lies outside the trace at the smallest force (larger mean reading), and downwards if not.
    """
    forces_N = trace_data.bound.setting.force_N
    levels = np.unique(forces_N)
    count = len(levels)
    rows = np.arange(count)
    if _mean_reading(trace_data, levels[-1]) < _mean_reading(trace_data, levels[0]):
        rows = rows[::-1]
    place = (
        layout.scale_left / layout.width,
        (_ROOM_BELOW + 0.1) / layout.height,
        0.14 / layout.width,
        0.7 * layout.diameter / layout.height,
    )
    axes = figure.add_axes(place)
    axes.barh(
        rows,
        np.ones(count),
        1.0,
        color=style.force_colours(levels.tolist()),
        edgecolor="white",
        linewidth=0.5 if count <= MOST_BANDS else 0.0,
    )
    named = np.unique(np.linspace(0, count - 1, _MOST_NAMED_FORCES).round().astype(int))
    axes.yaxis.tick_right()
    axes.set(xlim=(0.0, 1.0), ylim=(-0.5, count - 0.5), xticks=[])
    axes.set_yticks(rows[named], [f"{force:.4g}" for force in levels[named]])
    axes.tick_params(length=0, pad=2, labelsize=7)
    axes.set_title(trace_data.words["force"], fontsize=7)
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)


def _mean_reading(trace_data: _TraceData, force_N: float) -> float:
    """Return the mean reading [µm] of all tests at the force ``force_N`` [N].

    The mean of each test is computed first, and then the mean of these means, so that all tests
    have the same weight. ``trace_data`` holds the readings of all tests. If no test has this force,
    the result is NaN.
    """
    means = []
    for readings, force in zip(
        trace_data.readings_um, trace_data.bound.setting.force_N, strict=True
    ):
        if force == force_N:
            means.append(readings.mean())
    return float(np.mean(means))


def _round_step(size: float) -> float:
    """Return the round number that is nearest to ``size``.

    The result is the distance between two marks of a scale. Round numbers are 1, 2, 5 and 10 times
    a power of ten.
    """
    power = 10.0 ** np.floor(np.log10(size))
    steps = power * np.array([1.0, 2.0, 5.0, 10.0])
    return float(steps[np.argmin(np.abs(steps - size))])


@styled
def residuals(posterior: xr.DataTree) -> Figure:
    """Draw the residuals, reading minus prediction, against angle for up to ten tests.

    If there are more than ten tests, ten are chosen evenly, including the first and the last. The
    prediction includes the effects of machine, bar and balls. Two effects that differ from circle
    to circle are not predicted, so they remain in the residuals. They are the set-up shift and the
    discrepancy (a deviation that no other effect explains).

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample` or `load`.

    Returns
    -------
    Figure
        A Matplotlib figure with a panel for each test drawn, residuals in µm.

    Examples
    --------
    >>> figure = lb.figures.residuals(posterior)
    >>> len(figure.axes), figure.axes[-1].get_xlabel()
    (6, 'angle of the bar (°)')
    """
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound, _DRAWS)
    coefficients = mean_shared_coefficients(bound, phi, beta)
    residuals_um: Sequence[Array] = [
        residual * 1e3 for residual in residuals_mm(bound, coefficients)
    ]
    tests = bound.campaign.tests
    colours = style.force_colours(bound.setting.force_N.tolist())
    indices = np.unique(np.linspace(0, len(tests) - 1, _MOST_RESIDUALS).astype(int)).tolist()
    figure, all_axes = panels(len(indices), 1, 0.6, 0.9, sharex=True, sharey=True)
    limit = 1.05 * max(np.abs(residual).max() for residual in residuals_um)
    step = _round_step(0.7 * limit)
    for axes, r in zip(all_axes, indices, strict=True):
        angle = np.mod(tests[r].angle_deg, 360.0)
        order = np.argsort(angle)
        axes.plot(angle[order], residuals_um[r][order], color=colours[r], linewidth=0.6)
        axes.set_ylabel(f"{tests[r].name}\n(µm)", rotation=0, ha="right", va="center")
        axes.set(ylim=(-limit, limit), yticks=(-step, 0.0, step))
    all_axes[-1].set(xlim=(0.0, 360.0), xticks=range(0, 361, 45), xlabel="angle of the bar (°)")
    title = "Reading minus prediction"
    if len(indices) < len(tests):
        title += f", {len(indices)} of {len(tests)} tests"
    figure.suptitle(f"{title}; each circle's own shift and discrepancy are left in")
    return figure
