"""Integrals in few dimensions by the trapezoidal rule on a lattice that grows from the modes.

For a smooth function that falls off in every direction, the error of the rule falls very fast as
the step shortens (Trefethen and Weideman, SIAM Review 56, 385-458, 2014). The lattice consists of
two grids, the second moved by half a step in every direction. Together they form a body-centred
lattice, and most of their errors cancel in the mean of the two grids. A step is the distance from a
point of a grid to the next one along a direction of the grid. The unit of a step is a standard
deviation of the Gaussian that is fitted to the density at its highest mode. The edge of a lattice
is its outermost points. f is the density to be integrated, h the number of dimensions, n the number
of nodes (points).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.inference.integrals import Integral, LogFunction, in_chunks
from ldbb_bayes.results import Array

__all__ = ["grow_lattice"]

# A coarse lattice of points is used if the error allowed in the logarithm of an integral [nat] is
# at least this value; if a smaller error is required, a fine lattice is used.
_LOOSE_TOLERANCE = 1e-2
# First step (spacing of the points) of a coarse lattice. The unit is the standard deviation of a
# Gaussian that is fitted to the density at its highest mode.
_LOOSE_STEP = 2.0
# First spacing of the points of a fine lattice, as a fraction of the spacing at which the error of
# the integral of a Gaussian density would reach the allowed error.
_STEP_MARGIN = 0.93
# Points are added to a coarse lattice until the log density at its outermost points is lower than
# the highest log density by this number [nat].
_LOOSE_DEPTH = 9.0
# Points are added to a fine lattice until the log density at its outermost points is lower than the
# highest log density by this number plus ln(1 / tolerance) [nat]. The tolerance is the error
# allowed in the log integral.
_DEPTH = 5.5
# A lattice extends to points at which the log density is a certain number below its maximum [nat].
# If too much of the integral may lie beyond these points, the number is increased by this value,
# and a larger lattice is computed.
_DEEPER = 3.0
# Factor by which the spacing of a lattice's points is multiplied if the lattice does not reach the
# tolerance. The lattice is then computed again.
_FINER = 0.85


def grow_lattice(
    log_density: LogFunction,
    modes: Sequence[tuple[Array, Array]],
    *,
    tolerance: float = 1e-3,
    step: float | None = None,
    max_nodes: int = 200_000,
) -> Integral:
    """Return the integral ∫ f of a density from a lattice, within a tolerance if possible.

    The nodes of the lattice are the points of two regular grids. A step is the distance from a
    point of a grid to the next one. The second grid is the first one, moved by half a step in every
    direction. Points are added around the modes until f is negligible at the outermost points, and
    the step is shortened as needed. The lattice is not refined beyond ``max_nodes`` nodes; the
    error of the result may then exceed the tolerance.

    Parameters
    ----------
    log_density : callable
        Function that returns ln f, shape (n,), at n points in h dimensions, shape (n, h).
    modes : sequence of pairs
        One pair for each mode (maximum) of f, the highest mode first: the mode, shape (h,), and a
        square root, shape (h, h), of the inverse of minus the Hessian of ln f at the mode. The
        columns of the square root at the highest mode are the directions of the lattice.
    tolerance : float
        Error allowed in ln ∫ f [nat].
    step : float, optional
        First step of both grids, in units of the standard deviation of the Gaussian fitted to f at
        the highest mode. Default: computed from the tolerance.
    max_nodes : int
        No points are added to a grid that has more nodes than this number. The step is not
        shortened if the lattice would then have more nodes than this number.
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
        lattice = _integrate_on_grids(
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
    """Return the first step (spacing of the points) of a lattice in h dimensions.

    The step is in units of the standard deviation of the Gaussian fitted to the density at its
    highest mode. The step is 2 if ``tolerance``, the error allowed in the log integral [nat], is
    0.01 or more. For a smaller tolerance, the step is a little shorter than the step with which the
    error of the log integral of a Gaussian density would equal the tolerance.
    """
    if tolerance >= _LOOSE_TOLERANCE:
        return _LOOSE_STEP
    return float(_STEP_MARGIN * np.pi * np.sqrt(2.0 / np.log(3.0 * h / tolerance)))


def _integrate_on_grids(
    log_density: LogFunction,
    centre: Array,
    cell: Array,
    starts: Sequence[Array],
    depth: float,
    max_nodes: int,
    coarser_difference: float,
) -> Integral:
    """Return the integral ∫ f of a density from the two grids of a lattice in h dimensions.

    The columns of ``cell``, shape (h, h), are the steps of a grid along its h directions.
    ``log_density`` is ln f. ``coarser_difference`` is the absolute difference between two values of
    ln ∫ f [nat], one from each of the two grids that had been computed before the step was last
    shortened; it is zero if the step was not shortened. ``centre``, ``starts``, ``depth`` and
    ``max_nodes`` are the same as in `_grow_grid`.
    """
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
        _grid_coordinates(centre, cell, places),
        values,
        np.full(len(values), log_half_cell),
        estimate,
        edge,
        proposal=None,
        coarser_difference=coarser_difference,
    )


def _grid_coordinates(centre: Array, cell: Array, places: Array) -> Array:
    """Return the coordinates of n grid points in h dimensions, shape (n, h).

    ``places``, shape (n, h), holds the positions of the n points relative to ``centre``, shape
    (h,), in multiples of the grid's steps. The steps are the columns of ``cell``, shape (h, h).
    """
    return np.asarray(centre + places @ cell.T)


class _Grid(NamedTuple):
    """One of the two grids of a lattice: its nodes (points), and the density at the nodes."""

    #: positions of the n nodes (points) of a grid in h dimensions, shape (n, h). They are relative
    #: to the centre of the lattice, in multiples of the grid's steps.
    places: Array
    #: logarithm of the density to be integrated, at the n nodes (points) of a grid, shape (n,)
    log_density: Array
    #: whether each of the n nodes (points) of a grid is one of its outermost nodes, beyond which
    #: the density was not evaluated, shape (n,)
    edge: NDArray[np.bool_]


def _grow_grid(
    log_density: LogFunction,
    centre: Array,
    cell: Array,
    starts: Sequence[Array],
    offset: float,
    depth: float,
    max_nodes: int,
) -> _Grid:
    """Return one of the two grids of a lattice, grown from the modes of a density.

    The grid begins with the nodes (grid points) nearest to the modes. Neighbours of existing nodes
    are added until all nodes added last are negligible, or until the grid has more than
    ``max_nodes`` nodes. A node is negligible if ``log_density`` at the node is lower than the
    highest log density by ``depth`` [nat] or more. The grid has h dimensions; its steps are the
    columns of ``cell``, shape (h, h). ``starts`` are the modes of the density relative to
    ``centre``, in multiples of the steps. ``offset`` is the fraction of a step, 0 or 0.5, by which
    the grid is moved from ``centre`` in every direction. ``edge`` of the result marks the
    negligible nodes. If the grid has more than ``max_nodes`` nodes, ``edge`` also marks the nodes
    added last.
    """
    h = len(starts[0])
    neighbours = np.vstack([np.eye(h), -np.eye(h)])
    front = _nearest_grid_points(starts, offset)
    known_ids = np.zeros(0, dtype=np.int64)
    places = np.zeros((0, h))
    values = np.zeros(0)
    highest = -np.inf
    last = 0
    while len(front) and len(places) <= max_nodes:
        value = in_chunks(log_density, _grid_coordinates(centre, cell, front + offset))
        places = np.concatenate([places, front])
        values = np.concatenate([values, value])
        known_ids = np.union1d(known_ids, _grid_point_ids(front))
        highest = max(highest, float(value.max()))
        last = len(front)
        candidates = (front[value > highest - depth][:, None] + neighbours).reshape(-1, h)
        candidate_ids, first = np.unique(_grid_point_ids(candidates), return_index=True)
        front = candidates[first[~np.isin(candidate_ids, known_ids)]]
    edge = values <= highest - depth
    if len(places) > max_nodes:
        edge[-last:] = True
    return _Grid(places + offset, values, edge)


def _nearest_grid_points(starts: Sequence[Array], offset: float) -> Array:
    """Return the n grid points nearest to given points in h dimensions, shape (n, h).

    The growth of a grid begins at these grid points. ``starts`` holds the given points. All points
    are stated in multiples of the grid's steps. The grid is moved by the fraction ``offset`` of a
    step, but the positions returned are those before the move. If ``offset`` is zero, the grid
    point nearest to each given point is returned. If ``offset`` is 0.5, the 2^h grid points around
    each given point are returned.
    """
    along_axis = [0.0]
    if offset:
        along_axis.append(-1.0)
    corners = np.array(list(itertools.product(along_axis, repeat=len(starts[0]))))
    return np.unique(np.concatenate([np.rint(start) + corners for start in starts]), axis=0)


def _grid_point_ids(index: Array) -> NDArray[np.int64]:
    """Return integers that identify n grid points in h dimensions, shape (n,).

    ``index``, shape (n, h), holds the positions of the points in whole steps of the grid.
    """
    h = index.shape[1]
    reach = 1 << 62 // h - 1
    limited = np.clip(index, -reach, reach - 1).astype(np.int64)
    powers = (2 * reach) ** np.arange(h, dtype=np.int64)
    ids: NDArray[np.int64] = (limited + reach) @ powers
    return ids
