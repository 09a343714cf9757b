"""Combinations of a model's coefficients whose effects on the readings cancel.

The coefficients are the parameters of interest and the nuisance coefficients (of effects that are
modelled but not of interest). The combinations form a basis with few coefficients in each
combination. One coefficient of each combination has the value one; it is called the pivot. The
other coefficients cancel the effect of the pivot on the readings.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.results import Array

__all__ = ["EXACT_SHARE", "NullSpace"]

# In a combination of a model's coefficients, one coefficient has the value one; it is called the
# pivot. The effects of the coefficients count as cancelling only if the combination changes no
# reading by more than this share of the largest change that the pivot alone would cause.
EXACT_SHARE = 0.05
# Limits for leaving out coefficients from a combination of coefficients whose effects on the
# readings cancel. A coefficient is left out if its effect, divided by the largest effect of any
# coefficient in the combination, is at most the limit. The limits are tried in this order, until
# the remaining combination changes no reading noticeably.
_SPARSITY_CUTS = (0.02, 1e-3, 1e-5, 1e-8)
# Coefficients with small effects are dropped from a combination only if the remaining combination
# changes each reading by at most this share of ``NullSpace.limit``. A change of a reading up to
# that limit is too small to be seen.
_SPARSE_LIMIT_SHARE = 0.5
# Rows of a matrix are chosen as pivots, one after the other. In each step, only the part of a row
# that is orthogonal to the rows chosen before is considered. A preferred row is chosen before all
# other rows if the length of this part is above this number.
_LEAST_PIVOT_LENGTH = 0.05
# The effect of one coefficient of the model on the readings is fitted by the effects of others. In
# this fit, singular values below this share of the largest singular value count as zero.
_RANK_TOLERANCE = 1e-12
# Number of decimals to which the lengths of a matrix's rows are rounded before they are compared.
# Each row belongs to a coefficient; the coefficient with the longest row becomes the next pivot
# (see ``EXACT_SHARE``). Without rounding, numerical errors would decide between rows of equal
# length.
_LENGTH_DECIMALS = 6


class NullSpace:
    """Combinations of coefficients of a model that change no reading by more than a limit.

    The coefficients are the parameters of interest and the nuisance coefficients of a model. In a
    combination, each coefficient is in units of its prior standard deviation.

    Parameters
    ----------
    scaled
        Effects of the m coefficients on the n readings, shape (n, m). Each column holds the changes
        of the readings if only one coefficient changes, by its prior standard deviation. The
        parameters of interest come first.
    parameters
        Number of parameters of interest.
    limit
        Largest change of a reading that is too small to be seen, in the unit of ``scaled``.
    """

    def __init__(self, scaled: Array, parameters: int, limit: float) -> None:
        """Prepare the search for combinations of coefficients that change no reading.

        Each column of ``scaled``, shape (n, m), holds the changes of the n readings if only one of
        the m coefficients changes, by its prior standard deviation. The first ``parameters``
        coefficients are the parameters of interest. A change of a reading by at most ``limit``
        counts as no change.
        """
        self.scaled = scaled
        self.parameters = parameters
        self.limit = limit
        #: for each of the m coefficients, the largest change of any reading if only this
        #: coefficient changes, by its prior standard deviation; shape (m,)
        self.largest = np.abs(scaled).max(axis=0)
        # Triangular factor R of the decomposition Q R of the matrix ``scaled``, which holds the
        # effects of the model's coefficients on the readings. R has fewer rows than ``scaled``, but
        # the same null space and the same singular values.
        self._triangle = np.asarray(np.linalg.qr(scaled, mode="r"))

    def sparse_basis(self) -> list[tuple[int, Array]]:
        """Return a basis of the combinations of coefficients that change no reading.

        The result is a list of pairs (pivot, vector), one for each combination. The vector, shape
        (m,), holds the values of the m coefficients. The pivot is the index of one coefficient,
        whose value is one; the other coefficients cancel its effect on the readings. The search
        first finds combinations of parameters alone, then combinations of one nuisance coefficient
        with parameters that are not pivots yet, and finally all other combinations. Nuisance
        coefficients that alone change no reading noticeably are left out of the search. In the
        result, combinations with a nuisance coefficient as pivot come first.
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
        """Return a basis of those combinations of given coefficients that change no reading.

        ``columns`` are the indices of the coefficients. The basis has one vector for each pivot;
        the keys of the result are the indices of the pivots. Each vector has the value one at its
        pivot, and zero at all other pivots. The coefficients that are not pivots cancel the effect
        of the pivot on the readings. ``preferred`` has one entry for each index in ``columns``; it
        is true for coefficients that should be pivots if possible. A pivot is left out if its
        effect cannot be cancelled well enough.
        """
        pivots = columns[_choose_pivots(self._orthonormal_basis(columns), preferred)]
        return self._imitations(pivots, np.setdiff1d(columns, pivots))

    def _orthonormal_basis(self, columns: NDArray[np.intp]) -> Array:
        """Return orthonormal combinations of model coefficients that change no reading.

        The result has the shape (c, k), for k combinations of c coefficients. ``columns`` are the
        indices of the c coefficients. A change of a reading by at most ``NullSpace.limit`` counts
        as no change.
        """
        _, singular, right = np.linalg.svd(self._triangle[:, columns])
        # Each of the coefficients needs one singular value. If there are fewer readings than
        # coefficients, NumPy returns only as many singular values as there are readings; the others
        # are zero.
        singular = np.append(singular, np.zeros(len(columns) - len(singular)))
        # The right singular vectors are combinations of coefficients of the model. The singular
        # value of a combination is the root sum of squares of the changes that it causes in the n
        # readings. If it exceeds √n times the limit ``self.limit``, some reading changes by more
        # than the limit, and the combination is left out. Of the remaining combinations, those with
        # the largest singular values are left out until no reading changes by more than the limit.
        basis = right[singular <= self.limit * np.sqrt(len(self.scaled))].T
        while basis.shape[1] and np.abs(self.scaled[:, columns] @ basis).max() > self.limit:
            basis = basis[:, 1:]
        return basis

    def _imitations(
        self, targets: NDArray[np.intp], imitators: NDArray[np.intp]
    ) -> dict[int, Array]:
        """Return, for each target coefficient, values of other coefficients that cancel its effect.

        ``targets`` are the indices of the target coefficients. ``imitators`` are the indices of the
        coefficients that may cancel the effect of a target on the readings. The keys of the result
        are the indices of the targets. Each value is an array, shape (m,), with the values of all m
        coefficients in units of their prior sds: one for the target, and for the imitators the
        values that cancel its effect. The values of imitators with small effects are zero if the
        remaining imitators suffice. A target is left out if the imitators cannot cancel its effect.
        """
        # For each target coefficient of the model, a least-squares problem finds how other
        # coefficients, the imitators, can cancel its effect on the readings. The problems of all
        # targets are solved in one call, because the matrix with the effects of the imitators is
        # then factored only once.
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
        """Return a combination in which few coefficients cancel the effect of a target coefficient.

        A combination holds the values of the m coefficients, shape (m,). ``target`` is the index of
        the target coefficient. In the combination ``solved``, other coefficients (the imitators)
        cancel the effect of the target on the readings. In the result, the values of imitators with
        small effects are zero if the remaining imitators suffice. Return None if ``solved`` does
        not cancel the effect of the target well enough.
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
    Each step chooses the row with the longest part orthogonal to all rows chosen before.
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
