"""Information that readings carry about parameters and nuisances, at given hyper-parameters."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError
from ldbb_bayes.model.terms import NOISE, OWN
from ldbb_bayes.results import Array

__all__ = ["Information"]


@dataclass(frozen=True, eq=False)
class Information:
    """z = A c + e at given φ, c in units of its prior sd and e white: the posterior covariance of c
    is (1 + AᵀA)⁻¹.

    Of the m coefficients ``names`` and ``owners``, the term of each or ``OWN`` for a parameter of
    interest; ``scale`` (m,), the prior sd, or a typical size where parameters have ``flat`` priors;
    by block of readings ``design`` (k, m), columns per unit of the coefficients, and ``noise``, the
    covariance (k, k) of every independent source. What a question takes as known leaves the design
    or the noise. No readings are needed, only where they would be taken.
    """

    names: tuple[str, ...]
    owners: tuple[str, ...]
    scale: Array
    flat: bool
    design: tuple[Array, ...]
    noise: tuple[dict[str, Array], ...]

    def __post_init__(self) -> None:
        if not (np.isfinite(self.scale) & (self.scale > 0)).all():
            raise InputError(
                f"prior sd must be positive and finite, got {self.scale.min():g} …"
                f" {self.scale.max():g}."
            )

    @property
    def interest(self) -> NDArray[np.intp]:
        """Which coefficients are parameters of interest."""
        return np.flatnonzero([owner == OWN for owner in self.owners])

    @property
    def terms(self) -> tuple[str, ...]:
        """The nuisance terms, those of the noise last; reading noise is not one of them."""
        in_noise = (source for block in self.noise for source in block)
        return tuple(
            name for name in dict.fromkeys([*self.owners, *in_noise]) if name not in (OWN, NOISE)
        )

    @property
    def shared_terms(self) -> tuple[str, ...]:
        """The nuisance terms with coefficients of their own."""
        return tuple(dict.fromkeys(owner for owner in self.owners if owner != OWN))

    def rows(self, known: Collection[str] = ()) -> Array:
        """A, shape (k, m): the design whitened by the noise that is not known, columns in units of
        the prior sd."""
        return np.concatenate(self.blocks(known))

    def blocks(self, known: Collection[str] = ()) -> list[Array]:
        """The same block by block; those that share their noise are whitened together."""
        if any(all(source in known for source in noise) for noise in self.noise):
            raise InputError(
                "reading noise must be left: readings without any would make everything known."
            )
        white: dict[int, Array] = {}
        together: dict[int, list[int]] = {}
        for k, noise in enumerate(self.noise):
            together.setdefault(id(noise), []).append(k)
        for alike in together.values():
            left = np.sum(
                [part for source, part in self.noise[alike[0]].items() if source not in known],
                axis=0,
            )
            rows = np.stack([self.design[k] for k in alike], axis=1) * self.scale
            solved = scipy.linalg.solve_triangular(
                np.linalg.cholesky(left), rows.reshape(len(rows), -1), lower=True
            )
            white.update(zip(alike, np.moveaxis(solved.reshape(rows.shape), 1, 0), strict=True))
        return [white[k] for k in range(len(self.design))]

    def root(
        self, known: Collection[str] = (), *, times: float = 1.0
    ) -> tuple[Array, NDArray[np.intp]]:
        """Upper triangular R with RᵀR = prior + readings' precision of the coefficients left, and
        which these are."""
        pairs = zip(self.owners, self.names, strict=True)
        left = np.flatnonzero([owner not in known and name not in known for owner, name in pairs])
        rows = np.sqrt(times) * (self.rows(known) if known else self._rows)[:, left]
        prior = np.array([0.0 if self.flat and self.owners[k] == OWN else 1.0 for k in left])
        stacked: Any = np.concatenate([rows, np.diag(prior)])
        return np.asarray(np.linalg.qr(stacked, mode="r")), left

    def covariance(self, known: Collection[str] = (), *, times: float = 1.0) -> Array:
        """Posterior covariance in units of the prior sd, shape (m, m), zero for what is known:
        terms (noise too), or single coefficients; ``times``: how often all readings are taken, each
        time with noise of its own."""
        root, left = self.root(known, times=times)
        inverse = scipy.linalg.solve_triangular(root, np.eye(len(root)))
        covariance = np.zeros((len(self.names), len(self.names)))
        covariance[np.ix_(left, left)] = inverse @ inverse.T
        return covariance

    def variances(self, known: Collection[str] = (), *, times: float = 1.0) -> Array:
        """Posterior variances of the parameters of interest in units of their prior variance, shape
        (p,); see `covariance`."""
        return np.diag(self.covariance(known, times=times))[self.interest]

    def shares(self, covariance: Array | None = None) -> dict[tuple[str, str], Array]:
        """Share of every independent source, (coefficient or noise, term), in the variance of the
        parameters, each shape (p,).

        With the estimate written as a linear map of prior means and readings, every source s passes
        through it alone; with Cov_s what it leaves and C their sum, E[part_s | error] = Γ_s error
        with Γ_s = Cov_s C⁻¹, Σ Γ_s = 1. The share in the variance of parameter i is [Γ_s V]_ii /
        V_ii: shares sum to one. V is C, or the ``covariance`` (p, p) given.
        """
        joint = self.covariance()
        own = self.interest
        total = joint[np.ix_(own, own)]
        weight = np.eye(len(own)) if covariance is None else np.linalg.solve(total, covariance)
        variance = np.diag(total if covariance is None else covariance)
        weight = weight / np.where(variance > 0.0, variance, 1.0)
        parts: dict[tuple[str, str], Array] = {} if self.flat else {(OWN, OWN): total @ total.T}
        for k, (name, owner) in enumerate(zip(self.names, self.owners, strict=True)):
            if owner != OWN:
                parts[name, owner] = np.outer(joint[own, k], joint[own, k])
        for design, noise in zip(self.design, self.noise, strict=True):
            root = np.linalg.cholesky(sum(noise.values(), np.zeros((len(design), len(design)))))
            gain = scipy.linalg.cho_solve((root, True), design * self.scale) @ joint[:, own]
            for source, part in noise.items():
                parts[source, source] = parts.get((source, source), 0.0) + gain.T @ part @ gain
        return {key: np.einsum("ij,ji->i", part, weight) for key, part in parts.items()}

    def contributions(self) -> dict[str, Array]:
        """`shares` by term. That of a source is also d ln sd(β) / d ln (its scale), the other
        scales held."""
        found: dict[str, Array] = {}
        for (_, term), share in self.shares().items():
            found[term] = found.get(term, 0.0) + share
        return found

    @cached_property
    def _rows(self) -> Array:
        return self.rows()
