"""c_m ~ N(μ, diag(s²)), μ ~ N(0, I), b ~ N(0, I), in units of the prior sd: c_m, μ and b integrated out for given spreads s.

With c_m = μ + diag(s) z_m a machine's campaigns add up to −½ vᵀΛv + ηᵀv in v = (c_m, b), and x = (μ, b) is common to all. Over
z_m the exponent is Gaussian, with K = I + diag(s) A diag(s) where A is Λ's block of c_m; what is left is Gaussian in x. One small
Cholesky factor for each machine and s, one of x for each s; readings do not come in.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.fleet.stacks import back, cholesky, forward, log_determinant
from ldbb_bayes.fleet.statistics import FleetStatistics

__all__ = ["Common", "OfMachines", "Pooling", "pooling"]

Array = NDArray[Any]
_TOGETHER = 8192


@dataclass(frozen=True, eq=False)
class Common:
    """What is common to all machines, x = (μ, b), for k spreads.

    Attributes
    ----------
    log_density : ndarray, shape (k,)
        ln p(y | s), up to a constant.
    mean : ndarray, shape (k, q)
        E[x | y, s].
    precision, root : ndarray, shape (k, q, q)
        P of x | y, s, and the R with P⁻¹ = R Rᵀ.
    weighted : ndarray, shape (k, q)
        P · mean.
    constant : ndarray, shape (k,)
        Of the exponent: ln p(y | s) = constant + ½ weightedᵀ mean − ½ ln |P|.
    """

    log_density: Array
    mean: Array
    precision: Array
    root: Array
    weighted: Array
    constant: Array


@dataclass(frozen=True, eq=False)
class OfMachines:
    """Machines for the k spreads of a chunk; L Lᵀ = K, G = K⁻¹ diag(s) F, F = Λ's rows of c_m.

    Attributes
    ----------
    rows : slice
        Of the spreads.
    lower : ndarray, shape (c, c, k, n)
    solved : ndarray, shape (c, q + 1, k, n)
        L⁻¹ diag(s) (F, a), a being η's part of c_m.
    """

    rows: slice
    lower: Array
    solved: Array


@dataclass(frozen=True, eq=False)
class Pooling:
    """Sums over campaigns, in units of the prior sd about the prior mean: n machines, c parameters, q − c instrument errors.

    Attributes
    ----------
    machines : tuple of str, length n
    campaigns : ndarray of int, shape (n,)
        Of each machine.
    information : ndarray, shape (q, q, n)
        Λ, parameters first.
    weighted : ndarray, shape (q, n)
        η.
    parameters : int
        c.
    """

    machines: tuple[str, ...]
    campaigns: Array
    information: Array
    weighted: Array
    parameters: int

    def __len__(self) -> int:
        return len(self.machines)

    def without(self, machine: int) -> Pooling:
        """The others."""
        kept = np.arange(len(self)) != machine
        names = tuple(name for name, keep in zip(self.machines, kept, strict=True) if keep)
        return Pooling(names, self.campaigns[kept], self.information[..., kept], self.weighted[:, kept], self.parameters)

    def each(self, spread: Array) -> Iterator[OfMachines]:
        """Chunks of spreads, shape (k, c), small enough to stay near the processor."""
        c, n = self.parameters, len(self)
        size = max(1, _TOGETHER // n)
        right = np.concatenate([self.information[:c], self.weighted[:c, None]], axis=1)
        for start in range(0, len(spread), size):
            s = spread[start : start + size].T[:, :, None]
            matrix = s[:, None] * s[None] * self.information[:c, :c, None]
            matrix[range(c), range(c)] += 1.0
            lower = cholesky(matrix)
            yield OfMachines(slice(start, start + s.shape[1]), lower, forward(lower, s[:, None] * right[:, :, None]))

    def common(self, spread: Array) -> Common:
        """Everything but s integrated out, for spreads of shape (k, c)."""
        return _common([self._sums(part) for part in self.each(spread)])

    def _sums(self, part: OfMachines) -> tuple[Array, Array, Array]:
        """Precision and weighted mean of x, and the constant, summed over machines; the prior of x with them."""
        q = len(self.weighted)
        solved = part.solved.transpose(2, 0, 1, 3)
        square = (solved @ solved.swapaxes(-1, -2)).sum(axis=1)
        precision = np.eye(q) + self.information.sum(axis=-1) - square[:, :q, :q]
        weighted = self.weighted.sum(axis=-1) - square[:, :q, q]
        return precision, weighted, 0.5 * (square[:, q, q] - log_determinant(part.lower).sum(axis=-1))

    def excess(self, spread: Array) -> Array:
        """∂ ln p(y | s) / ∂ ln s_j = Σ_m (E[z_mj² | y, s] − 1) (Fisher's identity), shape (k, c)."""
        found = np.empty((len(spread), self.parameters))
        for part in self.each(spread):
            z, variance = self.deviations(part, _common([self._sums(part)]))
            found[part.rows] = (z**2 + variance - 1.0).sum(axis=-1).T
        return found

    def deviations(self, part: OfMachines, common: Common) -> tuple[Array, Array]:
        """Mean and variance of z_m = (c_m − μ) / s given y and s, shape (c, k, n); ``common`` is that of the chunk."""
        q = len(self.weighted)
        gain, own = back(part.lower, part.solved[:, :q]), remaining(part.lower)
        left = part.solved[:, q] - np.einsum("ilkm,kl->ikm", part.solved[:, :q], common.mean)
        z = back(part.lower, left[:, None])[:, 0]
        return z, own + _squares(gain, common.root)

    def estimates(self, part: OfMachines, common: Common, spread: Array) -> tuple[Array, Array, Array]:
        """Mean and sd of c_m given y and s, and the share of the machines' variance that is left, each (c, k, n)."""
        c, q = self.parameters, len(self.weighted)
        s = spread[part.rows].T[:, :, None]
        z, _ = self.deviations(part, common)
        share = remaining(part.lower)
        gain = -s[:, None] * back(part.lower, part.solved[:, :q])
        gain[range(c), range(c)] += 1.0
        return common.mean.T[:c, :, None] + s * z, np.sqrt(s**2 * share + _squares(gain, common.root)), share


def remaining(lower: Array) -> Array:
    """Diagonal of K⁻¹, shape (c, k, n): Var(c_mj | y, μ, b, s) / s_j²."""
    identity = np.zeros_like(lower)
    identity[range(len(lower)), range(len(lower))] = 1.0
    inverse = forward(lower, identity)
    return np.einsum("ijkm,ijkm->jkm", inverse, inverse)


def _squares(gain: Array, root: Array) -> Array:
    """Diagonal of G P⁻¹ Gᵀ for G of shape (c, q, k, n), P⁻¹ = R Rᵀ of (k, q, q)."""
    spread = root.swapaxes(-1, -2)[:, None] @ gain.transpose(2, 0, 1, 3)
    return np.einsum("kjrm,kjrm->jkm", spread, spread)


def _common(sums: list[tuple[Array, Array, Array]]) -> Common:
    precision, weighted, constant = (np.concatenate(parts) for parts in zip(*sums, strict=True))
    lower = np.linalg.cholesky(precision)
    root = np.swapaxes(np.linalg.inv(lower), -1, -2)
    white = np.einsum("kji,kj->ki", root, weighted)
    log_density = constant + 0.5 * (white**2).sum(axis=-1) - np.log(np.diagonal(lower, axis1=1, axis2=2)).sum(axis=-1)
    return Common(log_density, np.einsum("kij,kj->ki", root, white), precision, root, weighted, constant)


def pooling(statistics: FleetStatistics) -> Pooling:
    """The sums of a fleet; machines in the order in which they first appear."""
    names = tuple(dict.fromkeys(statistics.machines))
    place = {name: k for k, name in enumerate(names)}
    of = np.array([place[name] for name in statistics.machines])
    c = len(statistics.parameters)
    scale = np.concatenate([statistics.prior_sd, statistics.instrument_sd])
    centre = np.concatenate([statistics.prior_mean, np.zeros(len(scale) - c)])
    information = np.zeros((len(names), len(scale), len(scale)))
    weighted = np.zeros((len(names), len(scale)))
    np.add.at(information, of, statistics.information * scale[:, None] * scale)
    np.add.at(weighted, of, (statistics.weighted - statistics.information @ centre) * scale)
    information = 0.5 * (information + np.swapaxes(information, 1, 2))
    return Pooling(
        names,
        np.bincount(of, minlength=len(names)),
        np.ascontiguousarray(information.transpose(1, 2, 0)),
        np.ascontiguousarray(weighted.T),
        c,
    )
