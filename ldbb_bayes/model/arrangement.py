"""How the reduced readings are arranged: rows with diagonal noise, and blocks of basis functions that no column links.

For a uniform circle set-up shift and discrepancy are diagonal as they stand. For any other sampling the rows of a test are turned
so that discrepancy is diagonal, and set-up shift becomes columns of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ldbb_bayes.model.basis import SIZE
from ldbb_bayes.model.columns import BasisNoise, Columns, Hyper
from ldbb_bayes.model.reduction import Reduced

__all__ = ["Block", "Rows", "arrange", "split"]

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Block:
    """A stack of b independent groups of basis functions of the same shape, each coupled within itself.

    ``weights`` (b, tests, m, hypers): D = weights · φ²; ``present`` (b, tests, m) marks real rows; ``private``
    (b, tests, m, v); ``shared`` (b, tests, m, q) with ``shared_index`` (b, q) into the shared columns; ``interest``
    (b, tests, m, p); ``residual`` (b, tests, m).
    """

    weights: Array
    present: Array
    private: Array
    shared: Array
    shared_index: Array
    interest: Array
    residual: Array

    @cached_property
    def columns(self) -> Array:
        """Private and shared columns side by side, shape (b, tests, m, v + q)."""
        return np.concatenate([self.private, self.shared], axis=3)

    @cached_property
    def pairs(self) -> Array:
        """Products of all pairs of shared columns, shape (b, tests, m, q²)."""
        return _products(self.shared, self.shared)

    @cached_property
    def private_pairs(self) -> Array:
        """Products of private with private and shared columns, shape (b, tests, m, v (v + q))."""
        return _products(self.private, self.columns)

    @cached_property
    def kinds(self) -> tuple[Array, Array]:
        """Rows of the same noise taken together: their ``weights`` (b, kinds, hypers) and summed ``pairs`` (b, kinds, q²).

        Uniform circles of equal length have as many kinds as noise has levels, however many tests there are.
        """
        rows = list(self.weights.reshape(len(self.weights), -1, self.weights.shape[-1]))
        found = [np.unique(_to_ten_digits(own), axis=0, return_inverse=True) for own in rows]
        most = max((len(weights) for weights, _ in found), default=0)
        kind_weights = np.ones((len(rows), most, self.weights.shape[-1]))
        summed = np.zeros((len(rows), most, self.pairs.shape[-1]))
        for k, (weights, index) in enumerate(found):
            kind_weights[k, : len(weights)] = np.where(weights.any(axis=1, keepdims=True), weights, 1.0)
            np.add.at(summed[k], index.ravel(), self.pairs[k].reshape(len(rows[k]), self.pairs.shape[-1]))
        return kind_weights, summed


@dataclass(frozen=True, eq=False)
class Rows:
    """All reduced rows, padded to (tests, m): see `Block`. ``coupled`` says which rows any test links with one another."""

    weights: Array
    present: Array
    private: Array
    private_terms: tuple[Columns, ...]
    shared: Array
    interest: Array
    residual: Array
    diagonal: bool


def arrange(
    reduced: Sequence[Reduced],
    noise: Sequence[BasisNoise],
    private: Sequence[Columns],
    shared: Sequence[Columns],
    interest: Array,
    offset: Array,
    hypers: Sequence[Hyper],
) -> Rows:
    """Bring every test to rows with diagonal noise."""
    diagonal = all(test.is_orthogonal for test in reduced)
    absorbed = [term for term in noise if diagonal or term.hyper == "kappa"]
    moved = [term for term in noise if term not in absorbed]
    tests = len(reduced)
    private_terms = (*private, *(_as_columns(term, tests) for term in moved))
    stacked_private = _stack([term.values for term in private_terms], tests)
    stacked_shared = _stack([term.values for term in shared], tests)
    weights = np.zeros((tests, SIZE, len(hypers)))
    present = np.zeros((tests, SIZE), dtype=bool)
    out = [np.zeros((tests, SIZE, a.shape[2])) for a in (stacked_private, stacked_shared, interest)]
    residual = np.zeros((tests, SIZE))
    for r, test in enumerate(reduced):
        m = test.factor.shape[0]
        turn, spread = _turn(test, absorbed, diagonal)
        factor = turn @ test.factor
        if diagonal:
            factor = np.diag(np.diag(factor))
        present[r, :m] = True
        weights[r, :m, hypers.index("sigma")] = 1.0
        for term, value in zip(absorbed, spread, strict=True):
            weights[r, :m, hypers.index(term.hyper)] = value
        for target, source in zip(out, (stacked_private, stacked_shared, interest), strict=True):
            target[r, :m] = factor @ source[r]
        if test.projection is not None:
            residual[r, :m] = turn @ test.projection - factor @ offset[r]
    return Rows(weights, present, out[0], private_terms, out[1], out[2], residual, diagonal)


def _products(left: Array, right: Array) -> Array:
    """(b, tests, m, i) and (b, tests, m, j) → (b, tests, m, i j)."""
    return np.einsum("btmi,btmj->btmij", left, right).reshape(*left.shape[:3], left.shape[3] * right.shape[3])


def _to_ten_digits(values: Array) -> Array:
    """Values whose last digits, rounding of the projection, no longer tell equal rows apart."""
    size = 10.0 ** (9 - np.floor(np.log10(np.where(values > 0, values, 1.0))))
    return np.round(values * size) / size


def _turn(test: Reduced, absorbed: Sequence[BasisNoise], diagonal: bool) -> tuple[Array, list[Array]]:
    """An orthogonal matrix that makes the absorbed basis noise diagonal, and its variances in units of φ²."""
    m = test.factor.shape[0]
    if diagonal:
        signs = np.diag(np.sign(np.diag(test.factor)))
        return signs, [np.diag(test.factor) ** 2 * term.sd**2 for term in absorbed]
    if not absorbed:
        return np.eye(m), []
    (term,) = absorbed
    left, singular, _ = np.linalg.svd(test.factor * term.sd, full_matrices=True)
    spread = np.zeros(m)
    spread[: len(singular)] = singular**2
    return left.T, [spread]


def _as_columns(term: BasisNoise, tests: int) -> Columns:
    used = np.flatnonzero(term.sd)
    values = np.zeros((tests, SIZE, len(used)))
    values[:, used, np.arange(len(used))] = 1.0
    names = tuple(f"{term.hyper}_{i}" for i in used)
    return Columns(names, values, term.sd[used], term.hyper, private=True)


def _stack(columns: Sequence[Array], tests: int) -> Array:
    return np.concatenate([np.zeros((tests, SIZE, 0)), *columns], axis=2)


def split(rows: Rows) -> tuple[Block, ...]:
    """Separate the basis functions that no column links; without orthogonal sampling they are one group."""
    columns = np.arange(rows.shared.shape[2])
    if not rows.diagonal:
        return (_block(rows, [np.arange(SIZE)], [columns], main=True),)
    own = np.any(rows.private != 0, axis=(0, 2)) | np.any(rows.interest != 0, axis=(0, 2))
    touched = np.any(rows.shared != 0, axis=0)
    links = (own[:, None] & own[None, :]) | (touched.astype(int) @ touched.T.astype(int) > 0)
    count, label = connected_components(links, directed=False)
    main = int(label[np.flatnonzero(own)[0]]) if own.any() else -1
    groups: dict[tuple[int, int, bool], list[tuple[Array, Array]]] = {}
    for k in range(count):
        members = np.flatnonzero(label == k)
        index = np.flatnonzero(touched[members].any(axis=0))
        groups.setdefault((len(members), len(index), k == main), []).append((members, index))
    unseen = np.flatnonzero(~touched.any(axis=0))
    if unseen.size:
        groups[(0, len(unseen), False)] = [(np.zeros(0, dtype=int), unseen)]
    return tuple(_block(rows, [m for m, _ in pairs], [i for _, i in pairs], main=key[2]) for key, pairs in groups.items())


def _block(rows: Rows, members: Sequence[Array], shared_index: Sequence[Array], *, main: bool) -> Block:
    def pick(array: Array) -> Array:
        return np.stack([array[:, group] for group in members])

    private, interest = pick(rows.private), pick(rows.interest)
    shared = [rows.shared[:, group][:, :, index] for group, index in zip(members, shared_index, strict=True)]
    return Block(
        pick(rows.weights),
        pick(rows.present),
        private if main else private[..., :0],
        np.stack(shared),
        np.stack(shared_index),
        interest,
        pick(rows.residual),
    )
