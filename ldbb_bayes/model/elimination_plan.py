"""Order in which the columns of a design matrix are eliminated, and storage of what results.

The columns are divided into groups (`ordering`). Groups of the same shape that do not depend on
each other form a front, and are eliminated by the same function calls. The module `elimination`
explains the method, the workspace and the symbols.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.model.ordering import PRODUCT_COLUMNS, ColumnGroup, heights
from ldbb_bayes.model.triangular import eliminate, solve_columns
from ldbb_bayes.results import Array

__all__ = ["BorderUpdate", "EliminationPlan", "Front"]

# When columns are eliminated, sums of products of their entries are subtracted from the entries of
# later columns. Each sum has one term for every eliminated column. If a sum has at least this many
# terms, one function call computes the sums for one later column. If it has fewer terms, one
# function call computes the sums for several later columns. This needs fewer calls, but moves more
# data in memory.
_MANY_TERMS = 12


class BorderUpdate(NamedTuple):
    """Entries of a matrix P that change when groups of its columns are eliminated.

    The m columns of a group's border are numbered from 0. Let P_ij be the entry of P in row i and
    column j of the border; j = m is the right-hand side. The elimination of the group changes P_ij
    by −Σ_k s_k L_ik L_jk, where k are the columns of the group, L is the Cholesky factor, and s_k
    is the sign of the pivot of column k (+1 or −1). An `BorderUpdate` describes the entries P_ij
    for i from ``first`` to ``stop`` − 1 and j from ``first`` to m.
    """

    #: The eliminated groups, as a slice of the groups of a front. Groups with the same border are
    #: adjacent.
    groups: slice
    #: Number of different borders of these groups. They share no column.
    borders: int
    #: Smallest row i.
    first: int
    #: Largest row i, plus one.
    stop: int
    #: Rows of the workspace that hold the entries P_ij, shape (borders, stop − first, m + 1 −
    #: first): one for each border, i and j, where i and j are counted from ``first``. P is
    #: symmetric, and only entries with j ≥ i are stored. For j < i, the array holds the index of
    #: the last row of the workspace, which is never read.
    targets: NDArray[np.intp]


class Front(NamedTuple):
    """Groups of columns of the design matrix A that are eliminated at the same time.

    Each group has s columns, and m columns in its border.
    """

    #: Rows of the workspace that belong to the groups.
    entries: slice
    #: Shape of these rows as an array: the groups, the s columns of a group, and the s + m + 1
    #: entries of a column. Of these entries, s are in the rows of the group's columns, m in the
    #: rows of the border, and the last one is in the row of the right-hand side.
    shape: tuple[int, int, int]
    #: Signs (+1 or −1) of the Cholesky pivots of the columns, shape (groups, s); None if all are
    #: positive. A pivot is negative if the prior variance of the column's coefficient is negative
    #: (`Observations.signs` explains this).
    signs: Array | None
    #: Indices of the s columns of each group in the design matrix, shape (groups, s).
    columns: NDArray[np.intp]
    #: Indices of the m columns of each border in the design matrix, shape (groups, m).
    border: NDArray[np.intp]
    updates: list[BorderUpdate]

    def eliminate(self, workspace: Array) -> None:
        """Compute the columns of the Cholesky factor L for this front, and update the borders.

        ``workspace``, shape (entries, w), holds the entries of P for w values of the
        hyper-parameters. Those of this front are overwritten by the entries of L; then products of
        these are subtracted from the entries of P in the borders.
        """
        w = workspace.shape[1]
        columns = self.shape[1]
        border = self.shape[2] - columns
        matrix = workspace[self.entries].reshape(*self.shape, w)
        eliminate(matrix, signs=self.signs)
        for update in self.updates:
            links = matrix[update.groups, :, columns:]
            signed = links
            if self.signs is not None:
                signed = links * self.signs[update.groups, :, None, None]
            by_border = (update.borders, -1, border, w)
            left = signed.reshape(by_border)[:, :, update.first : update.stop]
            right = links.reshape(by_border)[:, :, update.first :]
            workspace[update.targets] -= np.einsum("akiw,akjw->aijw", left, right)

    def solve(self, workspace: Array, solution: Array) -> None:
        """Replace L⁻¹ Aᵀ D⁻¹ r by the coefficients P⁻¹ Aᵀ D⁻¹ r, for the columns of this front.

        ``workspace``, shape (entries, w), holds the entries of L for w values of the
        hyper-parameters. ``solution``, shape (columns of A, w), is changed in place. When the
        method is called, it must hold L⁻¹ Aᵀ D⁻¹ r in the rows of this front's columns, and the
        coefficients in the rows of all columns that are eliminated after this front.
        """
        columns = self.shape[1]
        matrix = workspace[self.entries].reshape(*self.shape, workspace.shape[1])
        right = solution[self.columns]
        links = matrix[:, :, columns:-1]
        right -= np.einsum("gsmw,gmw->gsw", links, solution[self.border])
        triangles = np.moveaxis(matrix[:, :, :columns], 0, 2)
        solved = solve_columns(triangles, np.moveaxis(right, 0, 1))
        solution[self.columns] = np.moveaxis(solved, 1, 0)


class _Family(NamedTuple):
    """Groups of columns that have the same border."""

    border: tuple[int, ...]
    groups: list[ColumnGroup]


class EliminationPlan:
    """Order in which columns of a design matrix A are eliminated, and storage of the results.

    The results are the entries of the Cholesky factor L of the precision matrix P = Aᵀ D⁻¹ A, where
    D is the noise covariance. They are stored in an array, the workspace, and the plan assigns a
    row of this array to each entry. A plan depends only on ``signs`` and on which elements of A are
    zero. Several models of one campaign can therefore share a plan.

    Parameters
    ----------
    groups
        Groups of columns in the order of their elimination. They contain every column once.
    signs
        One sign, +1 or −1, for each coefficient, shape (columns,). The sign is −1 if the prior
        variance of the coefficient is negative; `Observations.signs` explains this.
    """

    def __init__(self, groups: list[ColumnGroup], signs: Array) -> None:
        """Assign a row of the workspace to each stored entry, and sort the groups into fronts."""
        size = len(signs)
        families_of_fronts = _families_of_fronts(groups)
        #: Index of the row of the workspace that holds each entry P_ij, and later an entry of L,
        #: shape (columns, columns + 1); −1 for entries that are not stored. The last column is for
        #: the right-hand side.
        self.place = np.full((size, size + 1), -1, dtype=np.intp)
        start = 0
        for families in families_of_fronts:
            for family in families:
                for group in family.groups:
                    start = self._place_group(group, start)
        #: Number of rows of the workspace: one for each stored entry, and a last row for the
        #: changes of entries that are not stored.
        self.entries = start + 1
        self.fronts = [self._front(families, signs) for families in families_of_fronts]
        self.pivots = self.place[np.arange(size), np.arange(size)]
        self.right = self.place[:, size]
        self.half_signs = 0.5 * signs

    def _place_group(self, group: ColumnGroup, start: int) -> int:
        """Assign rows of the workspace, from the index ``start`` on, to a group of columns.

        Each stored entry in the columns of the group gets one row. Return the index of the first
        row that is still free.
        """
        members = np.concatenate([group.columns, group.border])
        width = len(members) + 1
        for k, column in enumerate(group.columns):
            first = start + k * width
            self.place[column, members[k:]] = first + np.arange(k, len(members))
            self.place[column, -1] = first + len(members)
        return start + len(group.columns) * width

    def _front(self, families: list[_Family], signs: Array) -> Front:
        """Return the front of all groups in ``families``, in the same order.

        The groups have equal numbers of columns, and borders of equal size. ``signs`` holds the
        sign, 1 or −1, of the prior variance of each coefficient.
        """
        groups = [group for family in families for group in family.groups]
        columns = np.array([group.columns for group in groups])
        first = self.place[columns[0, 0], columns[0, 0]]
        shape = (*columns.shape, columns.shape[1] + len(groups[0].border) + 1)
        front_signs = signs[columns]
        return Front(
            slice(int(first), int(first) + int(np.prod(shape))),
            shape,
            front_signs if (front_signs < 0.0).any() else None,
            columns,
            np.array([group.border for group in groups], dtype=np.intp),
            self._updates(families),
        )

    def _updates(self, families: list[_Family]) -> list[BorderUpdate]:
        """Return descriptions of the matrix entries that change when a front is eliminated.

        ``families`` are the families of the front. Each `BorderUpdate` states which entries of P
        change, not by how much. It describes one family, or several consecutive families if these
        have equal numbers of groups and their borders share no column.
        """
        updates = []
        start = 0
        for disjoint in _disjoint_families(families):
            members = len(disjoint[0].groups)
            stop = start + len(disjoint) * members
            borders = np.array([family.border for family in disjoint], dtype=np.intp)
            terms = members * len(disjoint[0].groups[0].columns)
            at_once = 1 if terms >= _MANY_TERMS else PRODUCT_COLUMNS
            for first in range(0, borders.shape[1], at_once):
                last = min(first + at_once, borders.shape[1])
                targets = np.array(
                    [self._changed_workspace_rows(border, first, last) for border in borders]
                )
                updates.append(
                    BorderUpdate(slice(start, stop), len(disjoint), first, last, targets)
                )
            start = stop
        return updates

    def _changed_workspace_rows(
        self, border: NDArray[np.intp], first: int, stop: int
    ) -> NDArray[np.intp]:
        """Return the rows of the workspace with the entries P_ij that a `BorderUpdate` changes.

        ``border`` holds the indices of the m columns of the border; i and j are positions in it,
        and j = m is the right-hand side. The `BorderUpdate` changes the entries with i from
        ``first`` to ``stop`` − 1 and j from ``first`` to m. The result has the shape (stop − first,
        m + 1 − first).
        """
        following = np.append(border[first:], self.place.shape[1] - 1)
        targets = self.place[np.ix_(border[first:stop], following)]
        not_needed = np.tril(np.ones(targets.shape, dtype=bool), k=-1)
        return np.where(not_needed, self.entries - 1, targets)


def _families_of_fronts(groups: list[ColumnGroup]) -> list[list[_Family]]:
    """Sort groups of columns into fronts, and the groups of each front into families.

    The groups of a front can be eliminated at the same time, because none of them changes the
    columns of another (function `heights`). They also have equal numbers of columns, and borders of
    equal size. A family consists of groups that have the same border. Fronts are in the order of
    elimination. Within a front, families with more groups come first.
    """
    fronts: dict[tuple[int, int, int], dict[tuple[int, ...], _Family]] = {}
    for group, height in zip(groups, heights(groups), strict=True):
        border = tuple(group.border.tolist())
        families = fronts.setdefault((height, len(group.columns), len(border)), {})
        families.setdefault(border, _Family(border, [])).groups.append(group)
    result = []
    for key in sorted(fronts):
        families_of_front = fronts[key].values()
        result.append(sorted(families_of_front, key=lambda family: -len(family.groups)))
    return result


def _disjoint_families(families: list[_Family]) -> list[list[_Family]]:
    """Divide families of column groups into lists of families that can be treated together.

    The families of a list are consecutive in ``families`` and have equal numbers of groups, and
    their borders share no column.
    """
    lists: list[list[_Family]] = []
    used_columns: set[int] = set()
    for family in families:
        size = len(family.groups)
        fits = used_columns.isdisjoint(family.border)
        if lists and fits and len(lists[-1][0].groups) == size:
            lists[-1].append(family)
            used_columns.update(family.border)
        else:
            lists.append([family])
            used_columns = set(family.border)
    return lists
