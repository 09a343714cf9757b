"""Sparse Cholesky elimination for many values of the hyper-parameters φ at once.

The observation equations are r = A x + N(0, D(φ)). r are the readings, and x are the coefficients
of nuisances (effects modelled but not of interest). A (rows, columns) has one column for each
coefficient. D(φ) is the diagonal noise covariance, and the hyper-parameters φ are quantities such
as the standard deviation of the noise. The module computes the vector L⁻¹ Aᵀ D⁻¹ r, called the
right-hand side, and the lower triangular Cholesky factor L of the matrix

    P = Aᵀ D⁻¹ A = L Lᵀ.

How it works:

1. Order. `ordering` divides the columns of A into groups, once for each campaign. The columns of a
   group are eliminated together. Eliminating a group of s columns changes the entries of P in m
   later columns. These later columns are called the border of the group.
2. Storage. Each column of L in a group is stored as s + m + 1 entries: s for the columns of the
   group, m for the columns of the border, and one for the right-hand side. The entries of all
   groups are the rows of one array, the workspace. It holds the entries of P at first; they are
   overwritten by the entries of L. The second dimension of the workspace has one element for each
   of w values of φ and is contiguous in memory.
3. Assembly. Rows of A whose noise has the same variance are rows of one kind. Each entry of P and
   of Aᵀ D⁻¹ r is a sum over the kinds. A term of this sum is 1/D times a scalar product of columns,
   which does not depend on φ (`gram_entries`).
4. Elimination. The groups are eliminated one after the other. The function `eliminate` computes, in
   place, the s columns of L that belong to a group. The entries of these columns in the rows of the
   border are then multiplied by each other, and the products are subtracted from the entries of P
   in the rows and columns of the border. Groups of the same shape that do not depend on each other
   form a `Front`: they are eliminated by the same function calls.

The priors of the coefficients x are also rows of the observation equations. In such a row, the
variance in D is the prior variance of a coefficient. It may be negative: the coefficient then
reduces the noise covariance of the readings instead of increasing it (`Observations.signs`). With
negative prior variances, P = L S Lᵀ, where the diagonal matrix S holds the signs ±1 of the Cholesky
pivots, and |L⁻¹ Aᵀ D⁻¹ r|² is a sum of squares with these signs.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.model.gram_entries import EntryBlock, GramEntries
from ldbb_bayes.model.ordering import PRODUCT_COLUMNS, ColumnGroup, elimination_groups, heights
from ldbb_bayes.model.triangular import eliminate, solve_columns
from ldbb_bayes.results import Array

__all__ = ["BLAS_MULTIPLE", "FEWEST_PHI", "DesignRows", "Elimination", "EliminationPlan", "Front"]

# Largest number of values of the hyper-parameters whose precision matrices are factorised in one
# pass.
_MOST_PHI = 512
# Smallest number of values of the hyper-parameters whose precision matrices are factorised in one
# pass. One pass processes this number of values even if the Cholesky factors do not fit into the
# processor's cache.
FEWEST_PHI = 256
# Number of floating-point numbers that are assumed to fit into the processor's cache.
_CACHE_SIZE = 1 << 19
# Values of the hyper-parameters are processed in multiples of this number. The library for matrix
# products (BLAS) then always rounds in the same way, so that results do not depend on how many
# values are processed together.
BLAS_MULTIPLE = 8
# Largest number of elimination plans (orders in which columns are eliminated) that the cache holds.
# Design matrices with zeros in the same places share a plan. A comparison of a hundred models
# therefore needs fewer plans than this number.
_KEPT_PLANS = 64
# When columns are eliminated, sums of products of their entries are subtracted from the entries of
# later columns. Each sum has one term for every eliminated column. If a sum has at least this many
# terms, one function call computes the sums for one later column. If it has fewer terms, one
# function call computes the sums for several later columns. This needs fewer calls, but moves more
# data in memory.
_MANY_TERMS = 12


class Update(NamedTuple):
    """Entries of a matrix P that change when groups of its columns are eliminated.

    The m columns of a group's border are numbered from 0. Let P_ij be the entry of P in row i and
    column j of the border; j = m is the right-hand side. The elimination of the group changes P_ij
    by −Σ_k s_k L_ik L_jk, where k are the columns of the group, L is the Cholesky factor, and s_k
    is the sign of the pivot of column k (+1 or −1). An `Update` describes the entries P_ij for i
    from ``first`` to ``stop`` − 1 and j from ``first`` to m.
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
    updates: list[Update]

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

    def _updates(self, families: list[_Family]) -> list[Update]:
        """Return descriptions of the matrix entries that change when a front is eliminated.

        ``families`` are the families of the front. Each `Update` states which entries of P change,
        not by how much. It describes one family, or several consecutive families if these have
        equal numbers of groups and their borders share no column.
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
                updates.append(Update(slice(start, stop), len(disjoint), first, last, targets))
            start = stop
        return updates

    def _changed_workspace_rows(
        self, border: NDArray[np.intp], first: int, stop: int
    ) -> NDArray[np.intp]:
        """Return the rows of the workspace that hold the entries P_ij changed by one `Update`.

        ``border`` holds the indices of the m columns of the border; i and j are positions in it,
        and j = m is the right-hand side. The `Update` changes the entries with i from ``first`` to
        ``stop`` − 1 and j from ``first`` to m. The result has the shape (stop − first, m + 1 −
        first).
        """
        following = np.append(border[first:], self.place.shape[1] - 1)
        targets = self.place[np.ix_(border[first:stop], following)]
        not_needed = np.tril(np.ones(targets.shape, dtype=bool), k=-1)
        return np.where(not_needed, self.entries - 1, targets)


class Elimination:
    """Cholesky elimination of the columns of a design matrix, for many hyper-parameter values.

    Parameters
    ----------
    plan
        Order of elimination of the columns.
    columns
        Design matrix A, shape (rows, columns).
    values
        Readings r, shape (rows,).
    kinds
        Index of the kind of each row, shape (rows,). Rows of one kind have noise of the same
        variance.
    """

    def __init__(
        self, plan: EliminationPlan, columns: Array, values: Array, kinds: NDArray[np.intp]
    ) -> None:
        """Compute the scalar products of the columns, from which P is assembled."""
        self._plan = plan
        blocks = [EntryBlock(front.entries, front.shape) for front in plan.fronts]
        self._gram = GramEntries(blocks, plan.place, columns, values, kinds)

    @property
    def fronts(self) -> list[Front]:
        """Fronts, in the order of elimination."""
        return self._plan.fronts

    @property
    def entries(self) -> int:
        """Number of rows of the workspace."""
        return self._plan.entries

    @property
    def chunk_size(self) -> int:
        """Number of values of the hyper-parameters whose Cholesky factors are computed together.

        The number is the largest multiple of 8 for which the factors fit into the processor's
        cache, but at least 256 and at most 512.
        """
        fitting = _CACHE_SIZE // self.entries // BLAS_MULTIPLE * BLAS_MULTIPLE
        return max(FEWEST_PHI, min(_MOST_PHI, fitting))

    def factorize(self, weight: Array, shift: Array | None) -> tuple[Array, Array]:
        """Compute the Cholesky factor L of P = Aᵀ D⁻¹ A = L Lᵀ for w values of φ.

        A is the design matrix, D the diagonal noise covariance, r are the readings and φ the
        hyper-parameters, on which D depends.

        Parameters
        ----------
        weight
            Reciprocal variance 1/D of every kind of rows, shape (kinds, w). Rows of one kind have
            the same variance.
        shift
            Array to add to Aᵀ D⁻¹ r, shape (columns of A, w); None for zero.

        Returns
        -------
        workspace
            Entries of L and L⁻¹ Aᵀ D⁻¹ r, shape (entries, w); `copy_factor` reads them.
        gain
            Contribution ½ |L⁻¹ Aᵀ D⁻¹ r|² − Σ ln L_jj of all columns to the log density of the
            readings, ln p(r | φ), shape (w,).

        Raises
        ------
        LinAlgError
            If a coefficient is determined neither by the readings nor by its prior.
        """
        workspace = self._gram.assemble(weight)
        if shift is not None:
            workspace[self._plan.right] += shift
        with np.errstate(divide="ignore", invalid="ignore"):
            for front in self.fronts:
                front.eliminate(workspace)
        white_shift = workspace[self._plan.right]
        log_determinant = np.log(workspace[self._plan.pivots]).sum(axis=0)
        square = np.einsum("c,cw,cw->w", self._plan.half_signs, white_shift, white_shift)
        gain = square - log_determinant
        if not np.isfinite(gain).all():
            raise np.linalg.LinAlgError("readings and priors must determine every coefficient")
        return workspace, gain

    @property
    def is_positive(self) -> bool:
        """Whether all prior variances are positive, so that coefficients can be drawn at random.

        A coefficient with a negative prior variance reduces the noise covariance of the readings
        and cannot be drawn.
        """
        return bool((self._plan.half_signs > 0.0).all())

    def solve(self, workspace: Array, standard: Array | None = None) -> Array:
        """Return the coefficients P⁻¹ Aᵀ D⁻¹ r + L⁻ᵀ z, shape (columns of A, w).

        P = Aᵀ D⁻¹ A = L Lᵀ, with the design matrix A, the noise covariance D and the readings r.
        The array ``workspace`` (entries, w) holds L and L⁻¹ Aᵀ D⁻¹ r for w values of the
        hyper-parameters, as `factorize` returns them. ``standard`` is z, shape (columns of A, w);
        None stands for zero. If z is standard normal, the coefficients are a random draw from their
        density given the readings.
        """
        solution = workspace[self._plan.right]
        if standard is not None:
            solution += standard
        for front in reversed(self.fronts):
            front.solve(workspace, solution)
        return np.asarray(solution)

    def copy_factor(
        self, workspace: Array, wanted: NDArray[np.intp], *, lower: Array, white_shift: Array
    ) -> None:
        """Copy the wanted columns of the Cholesky factors L into arrays that the caller provides.

        The entries of L⁻¹ Aᵀ D⁻¹ r for these columns are copied too, where A is the design matrix,
        D the noise covariance, and r are the readings.

        Parameters
        ----------
        workspace
            Entries of L and L⁻¹ Aᵀ D⁻¹ r for at least w values of the hyper-parameters, as
            `factorize` returns them.
        wanted
            Indices of the q columns that were eliminated last, in the order of their elimination.
        lower
            Array of zeros that receives L, shape (q, q, w) for w values of the hyper-parameters;
            its first index is the column, its second the row.
        white_shift
            Array (q, w) that receives L⁻¹ Aᵀ D⁻¹ r.
        """
        w = white_shift.shape[1]
        places = self._plan.place[np.ix_(wanted, wanted)]
        stored = np.nonzero(np.triu(places >= 0))
        lower[stored] = workspace[places[stored], :w]
        white_shift[...] = workspace[self._plan.right[wanted], :w]


class DesignRows:
    """Observation equations r = A x + noise, and the elimination of their coefficients x.

    r are readings, and A is the design matrix with one column for each coefficient. Coefficients
    belong to nuisances.

    Parameters
    ----------
    columns
        Design matrix A, shape (rows, columns).
    values
        Readings r, shape (rows,). The array holds zero for rows that depend on the parameters of
        interest. The caller adds the contribution of these rows for given parameters (``shift`` of
        `Elimination.factorize`).
    kinds
        Index of the kind of each row, shape (rows,). Rows of one kind have noise of the same
        variance.
    signs
        Signs ±1 of the prior variances of the coefficients, shape (columns,). A coefficient with a
        negative variance reduces the noise covariance of the readings instead of increasing it
        (`Observations.signs`); the Cholesky pivot of its column is negative.
    shared
        Number of columns whose coefficients are the same in all tests; they are the first columns.
    """

    def __init__(
        self,
        columns: Array,
        values: Array,
        kinds: NDArray[np.intp],
        *,
        signs: Array,
        shared: int,
    ) -> None:
        """Store the observation equations; the methods eliminate their columns when called."""
        self._columns = columns
        self._values = values
        self._kinds = kinds
        self._signs = signs
        self._shared = shared
        self._eliminations: dict[tuple[int, ...], Elimination] = {}

    def elimination(self, last: int) -> Elimination:
        """Return the Cholesky elimination of all nuisance coefficients in an order that saves time.

        Shared coefficients are the same in all tests. The shared coefficients of the last columns
        are eliminated after all others, in the order of these columns; ``last`` is their number.
        """
        return self.elimination_ending_with(tuple(range(self._shared - last, self._shared)))

    def elimination_ending_with(self, last_columns: tuple[int, ...]) -> Elimination:
        """Return the Cholesky elimination of all nuisance coefficients that ends with some columns.

        ``last_columns`` holds the indices of columns of the design matrix, in the order in which
        they are eliminated after all others.
        """
        if last_columns not in self._eliminations:
            pattern = self._columns != 0.0
            plan = _elimination_plan(
                np.packbits(pattern).tobytes(),
                pattern.shape,
                np.array(last_columns, dtype=np.intp).tobytes(),
                self._signs.tobytes(),
            )
            elimination = Elimination(plan, self._columns, self._values, self._kinds)
            self._eliminations[last_columns] = elimination
        return self._eliminations[last_columns]


@lru_cache(maxsize=_KEPT_PLANS)
def _elimination_plan(
    pattern: bytes, shape: tuple[int, int], last: bytes, signs: bytes
) -> EliminationPlan:
    """Return the plan for the elimination of the columns of a design matrix.

    ``pattern`` holds one bit for each element of the design matrix; the bit is set if the element
    is not zero. ``shape`` is the shape of the matrix. ``last`` holds the indices of the columns
    that are eliminated last. ``signs`` holds the signs ±1 of the prior variances. A prior variance
    is negative if its coefficient reduces the noise covariance of the readings instead of
    increasing it. The arrays ``last`` and ``signs`` are given as bytes. Results are kept in a
    cache.
    """
    bits = np.unpackbits(np.frombuffer(pattern, dtype=np.uint8), count=shape[0] * shape[1])
    is_not_zero = bits.reshape(shape).astype(bool)
    groups = elimination_groups(is_not_zero, np.frombuffer(last, dtype=np.intp))
    return EliminationPlan(groups, np.frombuffer(signs))


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
