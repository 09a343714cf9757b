"""Find a sparse basis of the combinations of coefficients that no reading can resolve."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.results import Array

__all__ = ["EXACT_SHARE", "NullSpace"]

# A combination counts as unresolved only if it changes no reading by more than this share of what
# its first coefficient changes alone.
EXACT_SHARE = 0.05
# Coefficients with an effect below a share of the largest are dropped; these shares are tried.
_SPARSITY_CUTS = (0.02, 1e-3, 1e-5, 1e-8)
# A sparse combination may change the readings by at most this share of the limit.
_SPARSE_LIMIT_SHARE = 0.5
# A preferred pivot must have a longer row of the null space than this, other pivots projected out.
_LEAST_PIVOT_LENGTH = 0.05
# Singular values of a least-squares problem below this share of the largest count as zero.
_RANK_TOLERANCE = 1e-12
# Decimals to which row lengths are compared, so that rounding does not choose the pivot.
_LENGTH_DECIMALS = 6


class NullSpace:
    """Combinations of scaled coefficients that change no reading by more than a limit.

    Parameters
    ----------
    scaled
        Change of the readings per prior sd of each coefficient, shape (n, m); parameters of
        interest come first.
    parameters
        Number of parameters of interest.
    limit
        Change of a reading that is too small to be seen, in the unit of ``scaled``.
    """

    def __init__(self, scaled: Array, parameters: int, limit: float) -> None:
        self.scaled = scaled
        self.parameters = parameters
        self.limit = limit
        self.largest = np.abs(scaled).max(axis=0)
        self._triangle = np.asarray(np.linalg.qr(scaled, mode="r"))

    def sparse_basis(self) -> list[tuple[int, Array]]:
        """Return pivots and vectors, nuisances first, each vector with a one at its pivot.

        First come combinations of parameters alone, then every nuisance that the other parameters
        imitate by themselves, then the remaining null space. No other vector has a vector's pivot.
        Nuisances that no reading sees by themselves are left out.
        """
        columns = np.arange(len(self.largest))
        is_parameter = columns < self.parameters
        candidates = columns[(self.largest > self.limit) | is_parameter]
        interest = np.arange(self.parameters)
        basis = self._independent_vectors(interest, preferred=np.full(self.parameters, True))
        imitators = np.setdiff1d(interest, list(basis))
        for nuisance in candidates[candidates >= self.parameters]:
            vector = self._imitation(int(nuisance), imitators)
            if vector is not None:
                basis[int(nuisance)] = vector
        remaining = np.setdiff1d(candidates, list(basis))
        basis |= self._independent_vectors(remaining, preferred=remaining >= self.parameters)
        nuisances = [pivot for pivot in sorted(basis) if pivot >= self.parameters]
        pivots = nuisances + [pivot for pivot in sorted(basis) if pivot < self.parameters]
        return [(pivot, basis[pivot]) for pivot in pivots]

    def _independent_vectors(
        self, columns: NDArray[np.intp], *, preferred: NDArray[np.bool_]
    ) -> dict[int, Array]:
        """Return a basis of the null space of these columns, by the index of the pivot column.

        Each vector has the value one for its pivot, and values of columns that are no pivots, so
        that the effects of all cancel in the readings. ``preferred`` states which columns should be
        pivots where possible.
        """
        pivots = columns[_choose_pivots(self._orthonormal_basis(columns), preferred)]
        imitators = np.setdiff1d(columns, pivots)
        basis = {}
        for pivot in pivots:
            vector = self._imitation(int(pivot), imitators)
            if vector is not None:
                basis[int(pivot)] = vector
        return basis

    def _orthonormal_basis(self, columns: NDArray[np.intp]) -> Array:
        """Return directions, shape (columns, k), that move no reading by more than the limit."""
        _, singular, right = np.linalg.svd(self._triangle[:, columns])
        singular = np.append(singular, np.zeros(len(columns) - len(singular)))
        basis = right[singular <= self.limit * np.sqrt(len(self.scaled))].T
        while basis.shape[1] and np.abs(self.scaled[:, columns] @ basis).max() > self.limit:
            basis = basis[:, 1:]
        return basis

    def _imitation(self, target: int, imitators: NDArray[np.intp]) -> Array | None:
        """Return a combination of coefficients that changes no reading: the target and imitators.

        The target has the value one. Imitators with the smallest effects are left out where the
        others suffice. Return None if the imitators cannot cancel the effect of the target.
        """
        solved = np.zeros(self.scaled.shape[1])
        solution = np.linalg.lstsq(
            self._triangle[:, imitators], self._triangle[:, target], rcond=_RANK_TOLERANCE
        )
        solved[imitators] = -solution[0]
        solved[target] = 1.0
        effect = self.largest * np.abs(solved)
        exact_limit = EXACT_SHARE * effect[target]
        change = np.abs(self.scaled @ solved).max()
        if change > self.limit * np.linalg.norm(solved) or change > exact_limit:
            return None
        sparse_limit = min(_SPARSE_LIMIT_SHARE * self.limit, exact_limit)
        for cut in _SPARSITY_CUTS:
            sparse = np.where(effect > cut * effect.max(), solved, 0.0)
            if np.abs(self.scaled @ sparse).max() <= sparse_limit:
                return sparse
        return solved


def _choose_pivots(basis: Array, preferred: NDArray[np.bool_]) -> list[int]:
    """Return as many rows of a basis as it has vectors, well conditioned, preferred rows first."""
    pivots: list[int] = []
    remainder = basis.copy()
    while len(pivots) < basis.shape[1]:
        length = np.linalg.norm(remainder, axis=1)
        preferred_length = np.round(np.where(preferred, length, 0.0), _LENGTH_DECIMALS)
        if preferred_length.max(initial=0.0) > _LEAST_PIVOT_LENGTH:
            pivot = int(np.argmax(preferred_length))
        else:
            pivot = int(np.argmax(length))
        pivots.append(pivot)
        unit = remainder[pivot] / length[pivot]
        remainder = remainder - np.outer(remainder @ unit, unit)
    return pivots
