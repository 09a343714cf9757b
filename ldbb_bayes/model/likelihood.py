"""Memory of arrays that come and go: kept by the process instead of being given back and fetched again page by page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ldbb_bayes.model.fourier import SIZE, Reduced
from ldbb_bayes.model.gaussian import factor_and_solve, solve_lower, solve_upper
from ldbb_bayes.model.terms import BasisNoise, Columns, Hyper
from ldbb_bayes.model.truncation import Orthant, Truncation

__all__ = ["Block", "Conditional", "ParameterConditional", "Rows", "StructuredGaussian", "arrange", "keep_freed_memory", "split"]

_BYTES = 31 << 20


@cache
def keep_freed_memory() -> None:
    """Let go of one large array that was never touched.

    GNU's malloc takes its size as a sign: arrays up to it, and twice as much freed memory in all, then stay with the process
    (mallopt(3), M_MMAP_THRESHOLD, dynamic up to 32 MiB). Stacks of small matrices are two to three times faster for it. Without
    effect elsewhere.
    """
    np.empty(_BYTES, dtype=np.uint8)


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


_LOG_2PI = float(np.log(2 * np.pi))


@dataclass(frozen=True, eq=False)
class Conditional:
    """The shared coefficients given φ and the readings: N(mean, P⁻¹), one per φ.

    Attributes
    ----------
    mean : ndarray, shape (w, q)
    precision_root : ndarray, shape (w, q, q)
        Cholesky factor L of the scaled precision; covariance = diag(scale) (L Lᵀ)⁻¹ diag(scale).
    scale : ndarray, shape (w, q)
    """

    mean: Array
    precision_root: Array
    scale: Array

    def draw(self, rng: np.random.Generator) -> Array:
        """One draw of all coefficients per φ, shape (w, q)."""
        return self.mean + solve_upper(self.precision_root, rng.standard_normal(self.mean.shape)) * self.scale


@dataclass(frozen=True, eq=False)
class _Condensed:
    """A block with its private columns integrated out.

    ``log_density`` (w, b, T) of the residual; ``projected`` (w, b, T, q) = Uᵀ Σ⁻¹ r; ``links`` (w, b, T, v, q) with Uᵀ Σ⁻¹ U =
    Uᵀ D⁻¹ U − linksᵀ links; ``weight`` (w, b, T, m) = 1 / D.
    """

    log_density: Array
    projected: Array
    links: Array
    weight: Array


class StructuredGaussian:
    """p(z | β, φ) with the shared and private columns integrated out.

    Parameters
    ----------
    reduced : sequence of Reduced
    noise : sequence of BasisNoise
    private, shared : sequence of Columns
    interest : ndarray, shape (tests, 25, p)
        Columns whose coefficients are given in every call.
    offset : ndarray, shape (tests, 25)
        Known part of the readings in the basis, subtracted beforehand.
    hypers : names of φ's components
    """

    def __init__(
        self,
        reduced: Sequence[Reduced],
        *,
        noise: Sequence[BasisNoise],
        private: Sequence[Columns],
        shared: Sequence[Columns],
        interest: Array,
        offset: Array,
        hypers: Sequence[Hyper],
    ) -> None:
        keep_freed_memory()
        self.hypers = tuple(hypers)
        self.shared_names = tuple(name for term in shared for name in term.names)
        self._residual_ss = np.array([test.residual_ss for test in reduced])
        self._free = np.array([max(test.readings - SIZE, 0) for test in reduced])
        self._readings = np.array([test.readings for test in reduced])
        self._shared_sd = _SpreadOf(shared, self.hypers)
        means = [np.zeros(len(term.names)) if term.mean is None else term.mean for term in shared]
        self._shared_mean = np.concatenate([np.zeros(0), *means])
        rows = arrange(reduced, noise, private, shared, interest, offset, self.hypers)
        self._private_sd = _SpreadOf(rows.private_terms, self.hypers)
        self._blocks = split(rows)

    def log_density(self, phi: Array, beta: Array) -> Array:
        """ln p(z | β, φ), shape (w,).

        Parameters
        ----------
        phi : ndarray, shape (w, hypers) [mm]
        beta : ndarray, shape (w, p), or (p,)
        """
        total = self._outside(phi).sum(axis=1)
        for block in self._blocks:
            part = self._condense(block, phi, beta)
            gained = self._integrate(self._gram(block, phi, part), part.projected.sum(axis=2), block, phi)[0]
            total = total + part.log_density.sum(axis=(1, 2)) + gained.sum(axis=1)
        return np.asarray(total)

    def log_density_without(self, phi: Array, beta: Array) -> Array:
        """ln p(z without test r | β, φ) for every r, shape (w, tests)."""
        outside = self._outside(phi)
        total = outside.sum(axis=1, keepdims=True) - outside
        for block in self._blocks:
            part = self._condense(block, phi, beta)
            gram, projected = self._gram_by_test(block, part), part.projected
            gram_all, projected_all = gram.sum(axis=2), projected.sum(axis=2)
            density = part.log_density.sum(axis=1)
            total = total + density.sum(axis=1, keepdims=True) - density
            for r in range(total.shape[1]):
                gained = self._integrate(gram_all - gram[:, :, r], projected_all - projected[:, :, r], block, phi)[0]
                total[:, r] += gained.sum(axis=1)
        return np.asarray(total)

    def conditional(self, phi: Array, beta: Array) -> tuple[Array, Conditional]:
        """ln p(z | β, φ), shape (w,), and the shared coefficients given z, β and φ."""
        w, q = len(phi), len(self.shared_names)
        total = self._outside(phi).sum(axis=1)
        mean, scale, root = np.zeros((w, q)), np.zeros((w, q)), np.zeros((w, q, q))
        for block in self._blocks:
            part = self._condense(block, phi, beta)
            gained, lower, white, block_scale = self._integrate(
                self._gram(block, phi, part), part.projected.sum(axis=2), block, phi
            )
            total = total + part.log_density.sum(axis=(1, 2)) + gained.sum(axis=1)
            if not block.shared_index.size:
                continue
            solved = solve_upper(lower, white) * block_scale
            for k, index in enumerate(block.shared_index):
                mean[:, index], scale[:, index] = solved[:, k], block_scale[:, k]
                root[:, index[:, None], index[None, :]] = lower[:, k]
        return np.asarray(total), Conditional(mean, root, scale)

    def private_mean(self, phi: Array, beta: Array, shared: Array) -> Array:
        """Conditional mean of every private coefficient given β, φ and the shared coefficients, shape (w, tests, v).

        Columns come in the order of ``private``, then set-up shift where it is not part of the diagonal noise.
        """
        sd = self._private_sd(phi)
        v = sd.shape[1]
        gram = np.zeros((len(phi), len(self._readings), v, v)) + np.eye(v)
        right = np.zeros((len(phi), len(self._readings), v))
        for block in self._blocks:
            if not block.private.shape[3]:
                continue
            residual = block.residual - _apply(block.interest, beta)
            residual = residual - np.einsum("btmq,wbq->wbtm", block.shared, shared[:, block.shared_index])
            columns = block.private * sd[:, None, None, None, :]
            weighted = columns / _variance(block, phi)[..., None]
            gram += np.einsum("wbtmi,wbtmj->wtij", weighted, columns)
            right += np.einsum("wbtmi,wbtm->wti", weighted, residual)
        return np.linalg.solve(gram, right[..., None])[..., 0] * sd[:, None, :]

    def _outside(self, phi: Array) -> Array:
        """Per test: constants, and the readings' part outside the basis, shape (w, tests)."""
        square = phi[:, :1] ** 2
        return np.asarray(-0.5 * (self._readings * _LOG_2PI + self._free * np.log(square) + self._residual_ss / square))

    def _condense(self, block: Block, phi: Array, beta: Array) -> _Condensed:
        """Integrate the private columns, group by group and test by test."""
        variance = _variance(block, phi)
        residual = block.residual - _apply(block.interest, beta)
        weight = 1.0 / variance
        weighted = residual * weight
        density = -0.5 * (np.where(block.present, np.log(variance), 0.0) + weighted * residual).sum(axis=3)
        v, q = block.private.shape[3], block.shared.shape[3]
        projected = _contract(weighted, block.columns)
        if not v:
            return _Condensed(density, projected, np.zeros((*density.shape, 0, q)), weight)
        sd = self._private_sd(phi)[:, None, None, :]
        gram = _contract(weight, block.private_pairs).reshape(*weight.shape[:3], v, v + q)
        inner = gram[..., :v] * (sd[..., :, None] * sd[..., None, :]) + np.eye(v)
        cross = np.concatenate([gram[..., v:], projected[..., :v, None]], axis=-1) * sd[..., :, None]
        root = np.linalg.cholesky(inner) if v > 1 else np.sqrt(inner)
        white = solve_lower(root, cross)
        density = density - np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1)
        density = density + 0.5 * (white[..., -1] ** 2).sum(axis=-1)
        links = white[..., :-1]
        return _Condensed(density, projected[..., v:] - np.einsum("...vq,...v->...q", links, white[..., -1]), links, weight)

    def _gram(self, block: Block, phi: Array, part: _Condensed) -> Array:
        """Uᵀ Σ⁻¹ U summed over tests, shape (w, b, q, q)."""
        weights, pairs = block.kinds
        weight = 1.0 / np.moveaxis(weights @ (phi**2).T, -1, 1)
        q = block.shared.shape[3]
        gram = np.swapaxes(weight @ pairs, 0, 1).reshape(len(phi), len(weights), q, q)
        if not part.links.size:
            return gram
        links = part.links.reshape(*part.links.shape[:2], -1, q)
        return gram - np.swapaxes(links, -1, -2) @ links

    @staticmethod
    def _gram_by_test(block: Block, part: _Condensed) -> Array:
        """Uᵀ Σ⁻¹ U of every test, shape (w, b, tests, q, q)."""
        q = block.shared.shape[3]
        gram = _contract(part.weight, block.pairs).reshape(*part.weight.shape[:3], q, q)
        return gram - np.swapaxes(part.links, -1, -2) @ part.links

    def _integrate(self, gram: Array, projected: Array, block: Block, phi: Array) -> tuple[Array, Array, Array, Array]:
        """Integrate the shared coefficients: log density gained (w, b), Cholesky factor, whitened projection, scale."""
        sd = self._shared_sd(phi)[:, block.shared_index]
        mean = self._shared_mean[block.shared_index]
        flat = np.isinf(sd)
        diagonal = np.diagonal(gram, axis1=-2, axis2=-1)
        scale = np.where(flat, 1.0 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0)), sd)
        precision = gram * (scale[..., :, None] * scale[..., None, :])
        span = np.arange(sd.shape[2])
        precision[..., span, span] += np.where(flat, 0.0, 1.0)
        standard = np.where(flat, 0.0, mean / np.where(sd > 0, scale, 1.0))
        lower, white = factor_and_solve(precision, projected * scale + standard)
        log_root = np.log(lower[..., span, span]).sum(axis=-1)
        flat_volume = (flat * (np.log(np.where(flat, scale, 1.0)) + 0.5 * _LOG_2PI)).sum(axis=-1)
        gained = flat_volume - log_root + 0.5 * ((white**2).sum(axis=-1) - (standard**2).sum(axis=-1))
        return gained, lower, white, scale


class _SpreadOf:
    """Prior sd of stacked columns as a function of φ, shape (w, columns)."""

    def __init__(self, terms: Sequence[Columns], hypers: Sequence[Hyper]) -> None:
        self._sd = np.concatenate([term.sd for term in terms]) if terms else np.zeros(0)
        owner = [(-1 if term.hyper is None else hypers.index(term.hyper)) for term in terms for _ in term.names]
        self._hyper = np.array(owner, dtype=int)

    def __call__(self, phi: Array) -> Array:
        factors = np.column_stack([phi, np.ones(len(phi))])
        return self._sd * factors[:, self._hyper]


def _variance(block: Block, phi: Array) -> Array:
    variance = np.moveaxis(block.weights @ (phi**2).T, -1, 0)
    return variance if block.present.all() else np.where(block.present, variance, 1.0)


def _apply(columns: Array, values: Array) -> Array:
    return np.moveaxis(columns @ np.atleast_2d(values).T, -1, 0)


def _contract(weight: Array, columns: Array) -> Array:
    """Sum over the rows of each test: (w, b, T, m) with (b, T, m, c) → (w, b, T, c)."""
    return np.moveaxis(np.moveaxis(weight, 0, 2) @ columns, 2, 0)


@dataclass(frozen=True, eq=False)
class ParameterConditional:
    """p(β | y, φ) for w values of φ, truncation aside.

    Attributes
    ----------
    mean : ndarray, shape (w, p)
    root : ndarray, shape (w, p, p)
        Cholesky factor L of the scaled precision; covariance = diag(scale) (L Lᵀ)⁻¹ diag(scale).
    scale : ndarray, shape (w, p)
    physical : Truncation
        A β ≥ 0, whether or not the model imposes it.
    """

    mean: Array
    root: Array
    scale: Array
    physical: Truncation

    def spread(self) -> Array:
        """X with X Xᵀ = covariance, shape (w, p, p)."""
        return self._spread_of(np.eye(self.mean.shape[1]))

    @cached_property
    def orthant(self) -> Orthant:
        """The problem of P(A β ≥ 0 | y, φ)."""
        return Orthant(self.mean @ self.physical.rows.T, self._spread_of(self.physical.rows))

    def at(self, white: Array) -> Array:
        """β from standard normal coordinates, shape (w, p)."""
        return self.mean + solve_upper(self.root, white) * self.scale

    def white(self, beta: Array) -> Array:
        """The reverse of `at`."""
        return np.einsum("wij,wi->wj", self.root, (beta - self.mean) / self.scale)

    def log_density(self, beta: Array) -> Array:
        """ln N(β; mean, covariance), shape (w,)."""
        white = self.white(beta)
        log_root = np.log(np.diagonal(self.root, axis1=1, axis2=2)).sum(axis=1) - np.log(self.scale).sum(axis=1)
        return np.asarray(log_root - 0.5 * ((white**2).sum(axis=1) + white.shape[1] * _LOG_2PI))

    def draw(self, rng: np.random.Generator) -> Array:
        """One draw of β per φ, truncation aside, shape (w, p)."""
        return self.at(rng.standard_normal(self.mean.shape))

    def draw_inside(self, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
        """One exact draw per φ inside A β ≥ 0.

        Returns
        -------
        beta : ndarray, shape (w, p)
        exact : ndarray of bool, shape (w,)
            False where the rejection sampler gave up, or rounding left β outside.
        """
        white, exact = self.orthant.draw_spread(rng)
        beta = self.at(white)
        return beta, exact & self.physical.holds(beta)

    def _spread_of(self, combinations: Array) -> Array:
        """X with X Xᵀ = covariance of linear combinations of β: (m, p) → (w, m, p)."""
        scaled = np.swapaxes(combinations * self.scale[:, None, :], 1, 2)
        return np.swapaxes(solve_lower(self.root, scaled), 1, 2)
