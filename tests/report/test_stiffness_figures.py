"""Figures of stiffness by direction: what they draw is what `lb.stiffness` states."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from campaigns import plan, refuses, simulated
from layout import check_texts
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from reports import fitted, plan_of_three_planes

import ldbb_bayes as lb
from ldbb_bayes.report.figures import ellipsoid_figure

MODEL = lb.HybridModel.first(1)


@pytest.fixture(scope="module")
def one_plane() -> xr.DataTree:
    return fitted(MODEL, simulated(plan()))


@pytest.fixture(scope="module")
def three_planes() -> xr.DataTree:
    return fitted(lb.HybridModel.first(0), simulated(plan_of_three_planes()))


def test_the_curves_are_the_compliance_along_the_bar(one_plane: xr.DataTree) -> None:
    _, curves = lb.figures.stiffness_rose(one_plane).axes
    (plane,) = lb.stiffness(one_plane, [742.0]).planes
    drawn_nm = np.asarray(curves.lines[1].get_ydata())
    np.testing.assert_allclose(drawn_nm[:-1], 1e6 * np.asarray(plane.compliance))


def test_the_rose_and_the_curves_are_the_same(one_plane: xr.DataTree) -> None:
    rose, curves = lb.figures.stiffness_rose(one_plane).axes
    for in_rose, in_curves in zip(rose.lines[:2], curves.lines[:2], strict=True):
        np.testing.assert_array_equal(in_rose.get_ydata(), in_curves.get_ydata())


def test_curves_that_coincide_are_both_seen() -> None:
    """Where the upper curve has gaps, the colour of the lower one is drawn."""
    constant = fitted(lb.HybridModel.first(0), simulated(plan()))
    figure = lb.figures.stiffness_rose(constant)
    curves = figure.axes[1]
    lower, upper = curves.lines[:2]
    np.testing.assert_allclose(np.asarray(lower.get_ydata()), np.asarray(upper.get_ydata()))
    figure.set_dpi(200)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())[::-1, :, :3].astype(float)
    left, bottom, right, top = (round(edge) for edge in curves.get_window_extent().extents)
    panel = pixels[bottom:top, left:right]
    for line in (lower, upper):
        colour = 255.0 * np.array(to_rgb(line.get_color()))
        assert (np.abs(panel - colour).max(axis=-1) < 8.0).sum() > 200


def test_labels_of_rings_stand_above_the_curves(one_plane: xr.DataTree) -> None:
    rose = lb.figures.stiffness_rose(one_plane).axes[0]
    highest_curve = max(line.get_zorder() for line in rose.lines)
    assert rose.texts
    assert min(text.get_zorder() for text in rose.texts) > highest_curve


def test_a_rose_for_each_of_three_planes(three_planes: xr.DataTree) -> None:
    figure = lb.figures.stiffness_rose(three_planes)
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert titles == ["plane XY", "plane YZ", "plane ZX"]


@pytest.mark.parametrize("compact", [False, True])
def test_texts_of_several_roses_do_not_overlap(three_planes: xr.DataTree, compact: bool) -> None:
    check_texts(lb.figures.stiffness_rose(three_planes, compact=compact))


def test_compact_roses_of_several_planes_leave_room_for_another_figure(
    three_planes: xr.DataTree,
) -> None:
    width, height = lb.figures.stiffness_rose(three_planes, compact=True).get_size_inches()
    assert width < 1.3 * height


@pytest.mark.slow
def test_the_legend_says_how_far_a_band_goes_beyond_the_rim() -> None:
    """At 100 N the band is wide; the rim lies not far beyond the curves."""
    posterior = fitted(MODEL, simulated(plan_of_three_planes()))
    figure = lb.figures.stiffness_rose(posterior)
    largest_nm = 0.0
    for plane in lb.stiffness(posterior, [100.0]).planes:
        largest_nm = max(largest_nm, 1e6 * max(plane.compliance_high))
    assert all(axes.get_ylim()[1] < largest_nm for axes in figure.axes)
    label = figure.legends[0].get_texts()[0].get_text().replace("\n", " ")
    assert label.endswith(f"cut off at the rim (goes on to {largest_nm:.0f} nm/N)")


def test_the_legend_of_a_band_inside_the_rim_says_nothing_of_it(one_plane: xr.DataTree) -> None:
    figure = lb.figures.stiffness_rose(one_plane)
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert not [text for text in texts if "rim" in text]


def test_the_ellipsoid_has_the_principal_compliances(three_planes: xr.DataTree) -> None:
    (principal,) = lb.stiffness(three_planes, [700.0]).principal
    semi_axes_nm = ellipsoid_figure._semi_axes(principal)
    expected_nm = [1e6 / axis.stiffness.median for axis in principal.axes]
    np.testing.assert_allclose(np.linalg.norm(semi_axes_nm, axis=1), expected_nm)


def test_the_ellipsoid_states_three_stiffnesses(three_planes: xr.DataTree) -> None:
    figure = lb.figures.compliance_ellipsoid(three_planes)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert [label[:4] for label in labels] == ["k_1 ", "k_2 ", "k_3 "]
    assert all(label.endswith("N/µm") for label in labels)


def test_an_ellipsoid_of_one_plane_is_refused(one_plane: xr.DataTree) -> None:
    refuses("must have tests in 3 planes, got XY", lb.figures.compliance_ellipsoid, one_plane)
