"""Integrals in few dimensions by the trapezoidal rule on a lattice that grows from the modes.

For a smooth function that dies away on every side the rule converges geometrically in its step
(Trefethen and Weideman, SIAM Review 56, 385-458, 2014). Two grids, the second moved by half a step
along every axis, make one body-centred lattice: errors along single axes cancel in their mean.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.inference.integrals import Integral, LogDensity, in_chunks
from ldbb_bayes.results import Array

__all__ = ["grow_lattice"]

# From this tolerance [nat] on a lattice may be coarse.
_LOOSE_TOLERANCE = 1e-2
# First step of a coarse lattice, in sd.
_LOOSE_STEP = 2.0
# The step of a Gaussian's lattice is taken a little shorter than its error asks for.
_STEP_MARGIN = 0.93
# How far below the highest log density a coarse lattice grows at first [nat], a fine one but for
# the logarithm of its tolerance, and by how much either is deepened.
_LOOSE_DEPTH = 9.0
_DEPTH = 5.5
_DEEPER = 3.0
# Each further lattice has a step this much shorter.
_FINER = 0.85


def grow_lattice(
    log_density: LogDensity,
    modes: Sequence[tuple[Array, Array]],
    *,
    tolerance: float = 1e-3,
    step: float | None = None,
    max_nodes: int = 200_000,
) -> Integral:
    """Return ∫ f from a lattice whose error of ln ∫ f is below the tolerance.

    The lattice grows from the modes until nothing that counts is left, and its step is shortened
    as needed. At ``max_nodes`` growing and shortening stop, and the error says what was left out.

    Parameters
    ----------
    log_density : callable
        ln f, (n, h) → (n,).
    modes : sequence of pairs
        Modes (h,), highest first, and a root (h, h) of the inverse curvature at each. The axes of
        the lattice are those of the highest.
    tolerance : float
        Error asked for [nat].
    step : float, optional
        The first step, in sd.
    max_nodes : int
        Largest number of nodes.
    """
    centre = modes[0][0]
    root = modes[0][1]
    h = len(centre)
    depth = _DEPTH - np.log(tolerance)
    if tolerance >= _LOOSE_TOLERANCE:
        depth = _LOOSE_DEPTH
    if step is None:
        step = _first_step(h, tolerance)
    coarser_difference = 0.0
    while True:
        starts = [np.linalg.solve(root, mode - centre) / step for mode, _ in modes]
        lattice = _lattice(
            log_density, centre, step * root, starts, depth, max_nodes, coarser_difference
        )
        nodes_of_finer = len(lattice.free) * _FINER**-h
        if lattice.error <= tolerance or nodes_of_finer > max_nodes:
            return lattice
        if lattice.edge_error > tolerance / 2.0:
            depth += _DEEPER
        else:
            step = step * _FINER
            coarser_difference = lattice.grid_difference


def _first_step(h: int, tolerance: float) -> float:
    """Return the step, in sd, at which the two grids of a Gaussian agree to the tolerance.

    They differ by 4 h exp(−2 π²/step²); a little less is allowed for.
    """
    if tolerance >= _LOOSE_TOLERANCE:
        return _LOOSE_STEP
    return float(_STEP_MARGIN * np.pi * np.sqrt(2.0 / np.log(3.0 * h / tolerance)))


def _lattice(
    log_density: LogDensity,
    centre: Array,
    cell: Array,
    starts: Sequence[Array],
    depth: float,
    max_nodes: int,
    coarser_difference: float,
) -> Integral:
    """Return ∫ f from the two grids of a lattice with this cell (h, h)."""
    grids = [
        _grow_grid(log_density, centre, cell, starts, offset, depth, max_nodes)
        for offset in (0.0, 0.5)
    ]
    places = np.concatenate([grid.places for grid in grids])
    values = np.concatenate([grid.log_density for grid in grids])
    edge = np.concatenate([grid.edge for grid in grids])
    log_half_cell = np.linalg.slogdet(cell)[1] - np.log(2.0)
    estimate = np.repeat([0, 1], [len(grid.places) for grid in grids])
    return Integral(
        _points(centre, cell, places),
        values,
        np.full(len(values), log_half_cell),
        estimate,
        edge,
        proposal=None,
        coarser_difference=coarser_difference,
    )


def _points(centre: Array, cell: Array, places: Array) -> Array:
    """Return the points (n, h) at places counted in cells."""
    return np.asarray(centre + places @ cell.T)


class _Grid(NamedTuple):
    """One grid of a lattice."""

    places: Array  #: counted in cells (n, h)
    log_density: Array  #: (n,)
    edge: NDArray[np.bool_]  #: which nodes the grid did not grow beyond (n,)


def _grow_grid(
    log_density: LogDensity,
    centre: Array,
    cell: Array,
    starts: Sequence[Array],
    offset: float,
    depth: float,
    max_nodes: int,
) -> _Grid:
    """Grow one grid from its starts by the neighbours of what counts."""
    h = len(starts[0])
    neighbours = np.vstack([np.eye(h), -np.eye(h)])
    front = _first_front(starts, offset)
    keys = np.zeros(0, dtype=np.int64)
    index = np.zeros((0, h))
    values = np.zeros(0)
    highest = -np.inf
    last = 0
    while len(front) and len(index) <= max_nodes:
        value = in_chunks(log_density, _points(centre, cell, front + offset))
        index = np.concatenate([index, front])
        values = np.concatenate([values, value])
        keys = np.union1d(keys, _keys(front))
        highest = max(highest, float(value.max()))
        last = len(front)
        candidates = (front[value > highest - depth][:, None] + neighbours).reshape(-1, h)
        candidate_keys, first = np.unique(_keys(candidates), return_index=True)
        front = candidates[first[~np.isin(candidate_keys, keys)]]
    edge = values <= highest - depth
    if len(index) > max_nodes:
        edge[-last:] = True
    return _Grid(index + offset, values, edge)


def _first_front(starts: Sequence[Array], offset: float) -> Array:
    """Return the grid points around the starts, from which a grid grows."""
    along_axis = [0.0]
    if offset:
        along_axis.append(-1.0)
    corners = np.array(list(itertools.product(along_axis, repeat=len(starts[0]))))
    return np.unique(np.concatenate([np.rint(start) + corners for start in starts]), axis=0)


def _keys(index: Array) -> NDArray[np.int64]:
    """Return one integer for each grid point (n, h)."""
    h = index.shape[1]
    reach = 1 << 62 // h - 1
    limited = np.clip(index, -reach, reach - 1).astype(np.int64)
    powers = (2 * reach) ** np.arange(h, dtype=np.int64)
    keys: NDArray[np.int64] = (limited + reach) @ powers
    return keys
