"""Sparse basis of the combinations of coefficients that no reading can resolve.

Coefficients are the parameters of interest and the nuisance coefficients (effects that are modelled
but not of interest). In each combination of the basis, one coefficient has the value one; it is
called the pivot. The other coefficients cancel the effect of the pivot on the readings.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.results import Array

__all__ = ["EXACT_SHARE", "NullSpace"]

# A combination of coefficients counts as unresolved only if it changes no reading by more than this
# share of the largest change that its pivot (the coefficient with the value one) causes alone.
EXACT_SHARE = 0.05
# Shares that decide which coefficients are dropped from an unresolved combination. A coefficient is
# dropped if its effect on the readings is at most a share of the largest effect of any coefficient
# in the combination. The shares are tried in turn, until one is found with which the remaining
# combination still changes no reading noticeably.
_SPARSITY_CUTS = (0.02, 1e-3, 1e-5, 1e-8)
# A combination from which coefficients of small effect are dropped may change a reading by at most
# this share of the limit below which a change cannot be seen.
_SPARSE_LIMIT_SHARE = 0.5
# Pivots are chosen one after the other by the lengths of the rows of a matrix. The columns of the
# matrix are an orthonormal basis of the null space, and each row belongs to one coefficient. Before
# each choice, the directions of the rows chosen earlier are projected out of all rows. A preferred
# coefficient becomes a pivot before other coefficients only if its row is then longer than this
# number.
_LEAST_PIVOT_LENGTH = 0.05
# When the effect of one coefficient on the readings is fitted by the effects of other coefficients,
# singular values below this share of the largest count as zero.
_RANK_TOLERANCE = 1e-12
# Number of decimals to which the lengths of the rows of the null space's basis are rounded before
# they are compared. Rounding errors then do not decide which coefficient becomes a pivot.
_LENGTH_DECIMALS = 6


class NullSpace:
    """Combinations of coefficients of a model that change no reading by more than a limit.

    Coefficients are parameters of interest and nuisance coefficients, in units of their prior
    standard deviations.

    Parameters
    ----------
    scaled
        Change of each of n readings when one of m coefficients changes by its prior standard
        deviation, shape (n, m). The parameters of interest come first.
    parameters
        Number of parameters of interest.
    limit
        Largest change of a reading that cannot be seen, in the unit of ``scaled``.
    """

    def __init__(self, scaled: Array, parameters: int, limit: float) -> None:
        self.scaled = scaled
        self.parameters = parameters
        self.limit = limit
        self.largest = np.abs(scaled).max(axis=0)
        self._triangle = np.asarray(np.linalg.qr(scaled, mode="r"))

    def sparse_basis(self) -> list[tuple[int, Array]]:
        """Return the basis as pairs of pivot and vector; pairs with a nuisance as pivot come first.

        A vector, shape (m,), is a combination of the m coefficients that no reading resolves. The
        pivot of the vector is the index of the coefficient that has the value one and whose effect
        the other coefficients cancel. Combinations of parameters alone are found first, then
        combinations of one nuisance with parameters that are not pivots, then all other
        combinations. A nuisance is left out if its effect alone changes no reading noticeably.
        """
        columns = np.arange(len(self.largest))
        is_parameter = columns < self.parameters
        candidates = columns[(self.largest > self.limit) | is_parameter]
        interest = np.arange(self.parameters)
        basis = self._independent_vectors(interest, preferred=np.full(self.parameters, True))
        imitators = np.setdiff1d(interest, list(basis))
        basis |= self._imitations(candidates[candidates >= self.parameters], imitators)
        remaining = np.setdiff1d(candidates, list(basis))
        basis |= self._independent_vectors(remaining, preferred=remaining >= self.parameters)
        nuisances = [pivot for pivot in sorted(basis) if pivot >= self.parameters]
        pivots = nuisances + [pivot for pivot in sorted(basis) if pivot < self.parameters]
        return [(pivot, basis[pivot]) for pivot in pivots]

    def _independent_vectors(
        self, columns: NDArray[np.intp], *, preferred: NDArray[np.bool_]
    ) -> dict[int, Array]:
        """Return a basis of the unresolved combinations of some coefficients, one vector per pivot.

        The keys are indices of pivots. ``columns`` are the indices of the coefficients. Each vector
        of the basis has the value one at its pivot, and zero at all other pivots. In a vector, the
        coefficients that are not pivots cancel the effect of the pivot on the readings.
        ``preferred`` has one entry for each index in ``columns``; it is true for coefficients that
        should be pivots where possible. A pivot whose effect cannot be cancelled well enough is
        left out.
        """
        pivots = columns[_choose_pivots(self._orthonormal_basis(columns), preferred)]
        return self._imitations(pivots, np.setdiff1d(columns, pivots))

    def _orthonormal_basis(self, columns: NDArray[np.intp]) -> Array:
        """Return k orthonormal combinations of c coefficients that change no reading, shape (c, k).

        The coefficients are those with the indices ``columns``. A change of the readings below the
        field ``limit`` counts as no change.
        """
        _, singular, right = np.linalg.svd(self._triangle[:, columns])
        singular = np.append(singular, np.zeros(len(columns) - len(singular)))
        basis = right[singular <= self.limit * np.sqrt(len(self.scaled))].T
        while basis.shape[1] and np.abs(self.scaled[:, columns] @ basis).max() > self.limit:
            basis = basis[:, 1:]
        return basis

    def _imitations(
        self, targets: NDArray[np.intp], imitators: NDArray[np.intp]
    ) -> dict[int, Array]:
        """Return combinations of target coefficients and imitators that change no reading.

        ``targets`` and ``imitators`` are indices of coefficients; imitators are the coefficients
        that may cancel the effect of a target. The result has one combination for each target. In
        this combination, the target has the value one, and the values of the imitators cancel the
        target's effect on the readings. Targets whose effect the imitators cannot cancel are left
        out.
        """
        # The imitators (coefficients that may cancel the effect of a target) are the same for all
        # targets. The matrix of their effects is therefore factored only once.
        solutions = np.linalg.lstsq(
            self._triangle[:, imitators], self._triangle[:, targets], rcond=_RANK_TOLERANCE
        )[0]
        imitations = {}
        for k, target in enumerate(targets.tolist()):
            solved = np.zeros(self.scaled.shape[1])
            solved[imitators] = -solutions[:, k]
            solved[target] = 1.0
            vector = self._checked_imitation(target, solved)
            if vector is not None:
                imitations[target] = vector
        return imitations

    def _checked_imitation(self, target: int, solved: Array) -> Array | None:
        """Return a combination in which imitators cancel a target's effect on the readings.

        The imitators are the coefficients of the combination other than the target. ``target`` is
        the index of the target coefficient. ``solved``, shape (m,), is the combination with all
        imitators. Imitators with the smallest effects are left out of the result if the remaining
        imitators suffice. Return None if ``solved`` does not cancel the effect of the target.
        """
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
    """Return the indices of k linearly independent rows of a matrix.

    The matrix ``basis``, shape (c, k), holds k vectors; it has one row for each of c coefficients.
    In each step, the row is chosen that has the longest part orthogonal to all rows chosen before.
    ``preferred``, shape (c,), is true for preferred rows. A preferred row is chosen before all
    other rows unless its orthogonal part is very short.
    """
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
