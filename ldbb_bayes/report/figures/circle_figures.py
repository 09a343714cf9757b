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
from ldbb_bayes.report.figures.style import band, panels, styled
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
_ANGLE = np.linspace(0.0, 2 * np.pi, 361)
_DASHED = (0, (4, 3))
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
    and rings labelled in µm. If there are at most 12 tests, the panels also show the 95 % band for
    the readings of a new circle. A colour scale at the right shows the colour of each force. On
    this scale, forces increase upwards if the trace at the largest force lies outside the trace at
    the smallest force, and downwards if not.

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
    sigma = phi[:, bound.hyper_prior.names.index("sigma")]
    new_circles = np.zeros(0)
    if trace_data.has_bands:
        new_circles = new_circle_coefficients(bound, phi, beta, rng)
    planes = bound.setting.tested_planes
    heads = [_panel_head(trace_data, plane) for plane in planes]
    lines = max(head.count("\n") + 1 for head in heads)
    figure = Figure(figsize=(0.75 + 3.6 * len(planes), 3.5 + 0.12 * lines))
    width = figure.get_figwidth()
    height = figure.get_figheight()
    for k, plane in enumerate(planes):
        left = 0.4 + 3.6 * k
        axes: Any = figure.add_axes(
            (left / width, 0.25 / height, 2.9 / width, 2.9 / height), projection="polar"
        )
        for r, test in enumerate(bound.campaign.tests):
            if test.plane != plane:
                continue
            if trace_data.has_bands:
                limits = band_um(new_circles[:, r], sigma, _ANGLE[::3], rng)
                band(
                    axes, _ANGLE[::3], trace_data.zero_radius + limits, trace_data.colours[r], 0.25
                )
            _draw_trace(axes, trace_data, r)
        _draw_rings(axes, trace_data, plane)
        axes.set_title(heads[k], fontsize=7, pad=8)
    _draw_force_scale(figure, trace_data)
    return figure


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
        axes.plot(_ANGLE[::2], circle, color="black", linewidth=0.8, linestyle=_DASHED)
    angles = range(0, 360, 45)
    names = {0: f"+{PLANES[plane].first}", 90: f"+{PLANES[plane].second}"}
    axes.set_xticks(np.deg2rad(angles), [names.get(angle, f"{angle}°") for angle in angles])
    axes.tick_params(pad=0)
    axes.set_rlim(0.0, trace_data.outer_radius)

    step = _round_step(trace_data.span / 4.0)
    multiples = np.arange(np.ceil(trace_data.low / step), np.floor(trace_data.high / step) + 1)
    rings_um = multiples * step + 0.0
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


def _panel_head(trace_data: _TraceData, plane: str) -> str:
    """Return the heading of the polar panel of one plane.

    The heading explains the panel's dots, lines, band and rings, in the language of
    ``trace_data.words``.
    """
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
    lines = [", ".join(marks), rings]
    if len(setting.tested_planes) > 1:
        lines.insert(0, f"{words['plane']} {plane}")
    return "\n".join(textwrap.fill(line, 72) for line in lines)


def _draw_force_scale(figure: Figure, trace_data: _TraceData) -> None:
    """Draw the colour scale of forces on the right-hand side of the figure.

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
    width = figure.get_figwidth()
    axes = figure.add_axes((1.0 - 0.55 / width, 0.14, 0.14 / width, 0.56))
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
