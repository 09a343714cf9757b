"""The Gaussian of all reduced readings given the hyper-parameters φ, arranged so that it costs little.

z_r = ρ̄_r + H_r β + U_r b + V_r v_r + e_r,   b ~ N(0, S_U(φ)), v_r ~ N(0, S_V(φ)), e_r ~ N(0, D_r(φ)), D_r diagonal.

U holds the columns shared by tests, V those of one test alone. Set-up shift and discrepancy live on the basis itself: for a
uniform circle they are part of D; for any other sampling the reduced readings are turned so that discrepancy is diagonal, and
set-up shift joins V. V is eliminated test by test, U once (Woodbury); basis functions that no column links are separate
blocks, so that for uniform circles only orders 0 to 4 meet the parameters of interest. All arrays carry φ as first axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.model.arrangement import Block, arrange, split
from ldbb_bayes.model.basis import SIZE
from ldbb_bayes.model.columns import BasisNoise, Columns, Hyper
from ldbb_bayes.model.memory import keep_freed_memory
from ldbb_bayes.model.reduction import Reduced
from ldbb_bayes.model.triangular import factor_and_solve, solve_lower, solve_upper

__all__ = ["Conditional", "StructuredGaussian"]

Array = NDArray[Any]
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
