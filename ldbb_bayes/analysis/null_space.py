"""Find a sparse basis of the directions of a design that no reading can resolve."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.results import Array

_CUTS = (0.02, 1e-3, 1e-5, 1e-8)


_OF_ITSELF = 0.05


_STRICT = 0.5


EXACTLY = 0.05


class NullSpace:
    """Columns in units of the prior sd, the first p of them parameters of interest, and what is too
    small to be seen."""

    def __init__(self, scaled: Array, p: int, limit: float) -> None:
        self.scaled = scaled
        self.p = p
        self.limit = limit
        self._triangle = np.asarray(np.linalg.qr(scaled, mode="r"))
        self.largest = np.abs(scaled).max(axis=0)

    def sparse(self) -> list[tuple[int, Array]]:
        """A basis of the null space: pivots and vectors, each with a one at its pivot. Nuisances
        that no reading sees by themselves are left aside. First what parameters do among
        themselves, then every nuisance that the other parameters imitate by themselves, then what
        is left of the null space. Each vector has a pivot that the others lack."""
        own = np.arange(self.p)
        seen = self.largest > self.limit
        every = np.flatnonzero(seen | (np.arange(len(seen)) < self.p))
        found = self._independent(own, own < self.p)
        own = np.setdiff1d(own, list(found))
        for j in every[every >= self.p]:
            vector = self._imitation(int(j), own)
            if vector is not None:
                found[int(j)] = vector
        left = np.setdiff1d(every, list(found))
        found |= self._independent(left, left >= self.p)
        return [(j, found[j]) for j in sorted(found, key=lambda j: (j < self.p, j))]

    def _independent(
        self, columns: NDArray[np.intp], preferred: NDArray[np.bool_]
    ) -> dict[int, Array]:
        """A basis of the null space of some columns, by pivot."""
        pivots = columns[_pivots(self._null_space(columns), preferred)]
        others = np.setdiff1d(columns, pivots)
        vectors = {int(pivot): self._imitation(int(pivot), others) for pivot in pivots}
        return {pivot: vector for pivot, vector in vectors.items() if vector is not None}

    def _null_space(self, columns: NDArray[np.intp]) -> Array:
        """Orthonormal directions, shape (columns, k), along which one prior sd moves no reading by
        more than the limit."""
        _, singular, right = np.linalg.svd(self._triangle[:, columns])
        singular = np.append(singular, np.zeros(len(columns) - len(singular)))
        vectors = right[singular <= self.limit * np.sqrt(len(self.scaled))].T
        while vectors.shape[1] and np.abs(self.scaled[:, columns] @ vectors).max() > self.limit:
            vectors = vectors[:, 1:]
        return vectors

    def _imitation(self, target: int, others: NDArray[np.intp]) -> Array | None:
        """One of the target and, by least squares, the least of the others that undo it, or None
        when they cannot."""
        solved = np.zeros(self.scaled.shape[1])
        solved[others] = -np.linalg.lstsq(
            self._triangle[:, others], self._triangle[:, target], rcond=1e-12
        )[0]
        solved[target] = 1.0
        change = np.abs(self.scaled @ solved).max()
        effect = self.largest * np.abs(solved)
        if change > self.limit * np.linalg.norm(solved) or change > EXACTLY * effect[target]:
            return None
        for cut in _CUTS:
            vector = np.where(effect > cut * effect.max(), solved, 0.0)
            if np.abs(self.scaled @ vector).max() <= min(
                _STRICT * self.limit, EXACTLY * effect[target]
            ):
                return vector
        return solved


def _pivots(null: Array, preferred: NDArray[np.bool_]) -> list[int]:
    """As many rows of the null space as it has dimensions, as independent as can be, preferred ones
    first."""
    pivots: list[int] = []
    rest = null.copy()
    while len(pivots) < null.shape[1]:
        length = np.linalg.norm(rest, axis=1)
        wanted = np.round(np.where(preferred, length, 0.0), 6)
        pivot = int(np.argmax(wanted if wanted.max(initial=0.0) > _OF_ITSELF else length))
        pivots.append(pivot)
        unit = rest[pivot] / length[pivot]
        rest = rest - np.outer(rest @ unit, unit)
    return pivots
