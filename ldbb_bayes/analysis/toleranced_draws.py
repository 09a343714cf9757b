"""Posterior draws of the quantities that may have a tolerance, each at the force that it is for."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import xarray as xr

from ldbb_bayes.analysis.circularity import path_draws
from ldbb_bayes.analysis.directional_stiffness import stiffness_draws
from ldbb_bayes.analysis.stated_quantities import stiffness_from
from ldbb_bayes.analysis.tolerances import PATH_QUANTITIES, STIFFNESS_QUANTITIES, name_in_plane
from ldbb_bayes.inference.force_curves import draws_at
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array
from ldbb_bayes.units import is_direct

__all__ = ["TolerancedDraws", "toleranced_draws"]

# Number of posterior draws for which the machine's circular path is computed.
_PATH_DRAWS = 2000


class TolerancedDraws(NamedTuple):
    """Posterior draws of a quantity that has a tolerance, and the bar force that they are for."""

    values: Array  #: posterior draws of the quantity that has the tolerance, shape (draws,)
    #: bar force for which the quantity that has the tolerance is computed [N]; None for geometric
    #: errors and changes of compliance with force
    force_N: float | None
    #: whether the quantity is a stiffness. Its reciprocal, a compliance, is more nearly normally
    #: distributed.
    is_stiffness: bool = False
    #: whether the quantity is a ratio of two stiffnesses
    is_ratio: bool = False
    #: name of the parameter that the quantity is, or whose reciprocal it is; empty for a quantity
    #: of a plane
    parameter: str = ""


def toleranced_draws(
    posterior: xr.DataTree, bound: BoundModel, names: Collection[str], force: float
) -> dict[str, TolerancedDraws]:
    """Return posterior draws of the quantities ``names`` at a given bar force.

    The result is a dict with ``names`` as keys. They are names of parameters, of stiffnesses such
    as ``stiffness_X`` or ``k_min``, and of quantities of the circular path such as ``G``. ``force``
    is the force of the bar [N].
    """
    parameters = dict(zip(bound.names, bound.parameters, strict=True))
    values = draws_at(posterior, force)
    compliances = {f"stiffness_{name[2]}": name for name in bound.names if is_direct(name)}
    of_planes: dict[str, Array] = {}
    if any(name.startswith(tuple(PATH_QUANTITIES)) for name in names):
        of_planes |= _path_draws(posterior, bound, force)
    if any(name.startswith(tuple(STIFFNESS_QUANTITIES)) for name in names):
        of_planes |= _directional_draws(posterior, bound, force)
    draws = {}
    for name in names:
        if name in compliances:
            stiffness = stiffness_from(values[compliances[name]])
            draws[name] = TolerancedDraws(
                stiffness, force, is_stiffness=True, parameter=compliances[name]
            )
        elif name in of_planes:
            draws[name] = TolerancedDraws(
                of_planes[name],
                force,
                is_stiffness=name.startswith(("k_min", "k_max")),
                is_ratio=name.startswith("k_ratio"),
            )
        elif parameters[name].group == "compliance":
            draws[name] = TolerancedDraws(values[name], force, parameter=name)
        else:
            draws[name] = TolerancedDraws(values[name], None, parameter=name)
    return draws


def _path_draws(posterior: xr.DataTree, bound: BoundModel, force: float) -> dict[str, Array]:
    """Return a dict of posterior draws of G, F_max and F_min of the machine's circular path [mm].

    As in ISO 230-4, G is the circular deviation, F_max the largest radial deviation and F_min the
    smallest radial deviation. The keys are these names; if there are several planes, each name ends
    with the plane, as in ``G_YZ``. ``force`` is the force of the bar [N].
    """
    planes = bound.setting.tested_planes
    draws = {}
    for path in path_draws(posterior, [force], _PATH_DRAWS):
        for quantity in PATH_QUANTITIES:
            name = name_in_plane(quantity, path.place["plane"], planes)
            draws[name] = path.quantities[quantity] * 1e-3
    return draws


def _directional_draws(posterior: xr.DataTree, bound: BoundModel, force: float) -> dict[str, Array]:
    """Return posterior draws of the least and greatest stiffness in each plane, and their ratio.

    The result is a dict with three keys: ``k_min`` and ``k_max`` for the least and the greatest
    stiffness along the bar [N/mm], and ``k_ratio`` for the greatest stiffness divided by the least.

    If there are several planes, there are three keys for each plane. Each key then ends with the
    plane, as in ``k_min_YZ``. ``force`` is the force of the bar [N].
    """
    planes = bound.setting.tested_planes
    draws = {}
    for plane, quantities in stiffness_draws(posterior, force).items():
        for quantity, values in quantities.items():
            draws[name_in_plane(quantity, plane, planes)] = values
    return draws
