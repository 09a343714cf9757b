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
   form a `Front` (`elimination_plan`): they are eliminated by the same function calls.

The priors of the coefficients x are also rows of the observation equations. In such a row, the
variance in D is the prior variance of a coefficient. It may be negative: the coefficient then
reduces the noise covariance of the readings instead of increasing it (`Observations.signs`). With
negative prior variances, P = L S Lᵀ, where the diagonal matrix S holds the signs ±1 of the Cholesky
pivots, and |L⁻¹ Aᵀ D⁻¹ r|² is a sum of squares with these signs.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.model.elimination_plan import EliminationPlan
from ldbb_bayes.model.gram_entries import EntryBlock, GramEntries
from ldbb_bayes.model.ordering import elimination_groups
from ldbb_bayes.results import Array

__all__ = ["BLAS_MULTIPLE", "DesignRows", "Elimination"]

# Largest number of values of the hyper-parameters whose precision matrices are factorised in one
# pass.
_MOST_PHI = 512
# Smallest number of values of the hyper-parameters whose precision matrices are factorised in one
# pass. One pass processes this number of values even if the Cholesky factors do not fit into the
# processor's cache.
_FEWEST_PHI = 256
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
        #: order of elimination of the columns
        self.plan = plan
        blocks = [EntryBlock(front.entries, front.shape) for front in plan.fronts]
        self._gram = GramEntries(blocks, plan.place, columns, values, kinds)

    @property
    def chunk_size(self) -> int:
        """Number of values of the hyper-parameters whose Cholesky factors are computed together.

        The number is the largest multiple of 8 for which the factors fit into the processor's
        cache, but at least 256 and at most 512.
        """
        fitting = _CACHE_SIZE // self.plan.entries // BLAS_MULTIPLE * BLAS_MULTIPLE
        return max(_FEWEST_PHI, min(_MOST_PHI, fitting))

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
            workspace[self.plan.right] += shift
        with np.errstate(divide="ignore", invalid="ignore"):
            for front in self.plan.fronts:
                front.eliminate(workspace)
        white_shift = workspace[self.plan.right]
        log_determinant = np.log(workspace[self.plan.pivots]).sum(axis=0)
        square = np.einsum("c,cw,cw->w", self.plan.half_signs, white_shift, white_shift)
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
        return bool((self.plan.half_signs > 0.0).all())

    def solve(self, workspace: Array, standard: Array | None = None) -> Array:
        """Return the coefficients P⁻¹ Aᵀ D⁻¹ r + L⁻ᵀ z, shape (columns of A, w).

        P = Aᵀ D⁻¹ A = L Lᵀ, with the design matrix A, the noise covariance D and the readings r.
        The array ``workspace`` (entries, w) holds L and L⁻¹ Aᵀ D⁻¹ r for w values of the
        hyper-parameters, as `factorize` returns them. ``standard`` is z, shape (columns of A, w);
        None stands for zero. If z is standard normal, the coefficients are a random draw from their
        density given the readings.
        """
        solution = workspace[self.plan.right]
        if standard is not None:
            solution += standard
        for front in reversed(self.plan.fronts):
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
        places = self.plan.place[np.ix_(wanted, wanted)]
        stored = np.nonzero(np.triu(places >= 0))
        lower[stored] = workspace[places[stored], :w]
        white_shift[...] = workspace[self.plan.right[wanted], :w]


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
