"""Figure of a machine's compliance in space, drawn as an ellipsoid."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from ldbb_bayes.analysis.directional_stiffness import PrincipalStiffness, stiffness
from ldbb_bayes.errors import require
from ldbb_bayes.inference.posterior import bound_of
from ldbb_bayes.machine.chain import LINEAR
from ldbb_bayes.report.figures.style import GREY, PALETTE, WIDTH, new_figure, styled
from ldbb_bayes.results import Array
from ldbb_bayes.units import display_unit, plus_minus

__all__ = ["compliance_ellipsoid"]

_HEIGHT = 4.4  # height of the figure with the compliance ellipsoid [inch]
# number of steps in latitude in which the compliance ellipsoid is drawn; the number of steps in
# longitude is twice as large
_MERIDIANS = 24
_VIEW_DEG = (22.0, 35.0)  # elevation and azimuth from which the compliance ellipsoid is seen [°]
# zoom factor of the 3D panel with the compliance ellipsoid, chosen so that no axis name is cut off
_ZOOM = 0.88
# half the length of each axis of the 3D panel, as a multiple of the largest coordinate at the ends
# of the compliance ellipsoid's semi-axes
_FARTHEST = 1.15


@styled
def compliance_ellipsoid(posterior: xr.DataTree) -> Figure:
    """Draw the compliance in space as an ellipsoid, with the principal stiffnesses ± U.

    The distance from the centre to the surface along a principal axis is the compliance along this
    axis, so that the longest axis is the softest. The compliance is computed for the largest force
    tested, and for the centre of the first circle.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average` of a campaign in the planes XY, YZ and ZX.

    Returns
    -------
    Figure
        A Matplotlib figure with one three-dimensional panel.

    Raises
    ------
    InputError
        Fewer than three planes were tested.

    Examples
    --------
    >>> lb.figures.compliance_ellipsoid(posterior)
    Traceback (most recent call last):
    ldbb_bayes.errors.InputError: an ellipsoid of compliance must have tests in 3 planes, got XY.
     Run circles in XY, YZ and ZX.
    """
    planes = bound_of(posterior).setting.tested_planes
    require(
        len(planes) == len(LINEAR),
        f"an ellipsoid of compliance must have tests in 3 planes, got {', '.join(planes)}. Run"
        " circles in XY, YZ and ZX.",
    )
    largest_N = float(bound_of(posterior).setting.force_N.max())
    (principal,) = stiffness(posterior, [largest_N]).principal
    figure = new_figure(WIDTH, _HEIGHT)
    axes = figure.add_subplot(projection="3d")
    semi_axes = _semi_axes(principal)
    _draw_surface(axes, semi_axes)
    for k, axis in enumerate(principal.axes):
        value = axis.stiffness
        statement = f"= {plus_minus(value.mean, value.sd, value.interval, value.unit)}"
        if value.only_lower_limit:
            statement = f"≥ {value.ci_low * display_unit(value.unit)[0]:.3g} N/µm"
        end = np.stack([-semi_axes[k], semi_axes[k]])
        label = f"k_{k + 1} {statement}"
        axes.plot(*end.T, color=PALETTE[k], linewidth=2.5, label=label)
    limit = _FARTHEST * float(np.abs(semi_axes).max())
    for name in "xyz":
        axes.set(**{f"{name}lim": (-limit, limit)})
    _, unit = display_unit("mm/N")
    axes.set(xlabel=f"X ({unit})", ylabel=f"Y ({unit})", zlabel=f"Z ({unit})")
    axes.set_box_aspect((1, 1, 1), zoom=_ZOOM)
    axes.view_init(*_VIEW_DEG)
    axes.tick_params(labelsize=7)
    axes.locator_params(nbins=5)
    figure.legend(loc="outside upper center", ncols=3, title=f"{largest_N:.4g} N")
    return figure


def _semi_axes(principal: PrincipalStiffness) -> Array:
    """Return the semi-axes of the compliance ellipsoid as vectors [nm/N], shape (3, 3).

    Each row is one vector. The first row is the semi-axis in the softest direction.
    """
    factor, _ = display_unit("mm/N")
    rows = [np.array(axis.direction) * (factor / axis.stiffness.median) for axis in principal.axes]
    return np.array(rows)


def _draw_surface(axes: Any, semi_axes: Array) -> None:
    """Draw the surface of the compliance ellipsoid with a net of lines.

    ``semi_axes``, shape (3, 3), holds the semi-axes of the ellipsoid as rows [nm/N].
    """
    longitude = np.linspace(0.0, 2.0 * np.pi, 2 * _MERIDIANS + 1)[:, None]
    latitude = np.linspace(-0.5 * np.pi, 0.5 * np.pi, _MERIDIANS + 1)[None, :]
    unit_sphere = np.stack(
        [
            np.cos(longitude) * np.cos(latitude),
            np.sin(longitude) * np.cos(latitude),
            np.ones_like(longitude) * np.sin(latitude),
        ],
        axis=-1,
    )
    points = unit_sphere @ semi_axes
    x, y, z = np.moveaxis(points, -1, 0)
    axes.plot_surface(x, y, z, color=PALETTE[5], alpha=0.15, linewidth=0)
    axes.plot_wireframe(x, y, z, color=GREY, linewidth=0.3, rcount=13, ccount=13)
