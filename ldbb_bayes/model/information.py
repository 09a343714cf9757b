"""What readings tell about all coefficients at once, parameters and nuisances, while the hyper-parameters φ are given.

z = A c + e with c in units of its prior sd and e white: the posterior covariance of c is (1 + AᵀA)⁻¹. Whatever a question
takes as known leaves the design: a column, or a part of the noise. No readings are needed, only where they would be taken.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError
from ldbb_bayes.model.gaussian import solve_lower
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.terms import BasisNoise, Hyper

__all__ = ["NOISE", "OWN", "Information", "information_of", "informations_of"]

Array = NDArray[Any]
OWN = "Parameters"
NOISE = "ReadingNoise"


@dataclass(frozen=True, eq=False)
class Information:
    """A linear Gaussian model of coefficients c, stacked in blocks of readings.

    Attributes
    ----------
    names : tuple of str
        Of the m coefficients.
    owners : tuple of str
        Of each coefficient: the term it belongs to, ``OWN`` for a parameter of interest.
    scale : ndarray, shape (m,)
        Prior sd, or a typical size where the prior is flat.
    flat : bool
        Whether the parameters of interest have flat priors.
    design : tuple of ndarray, each (k, m)
        Columns per unit of the coefficients, block by block.
    noise : tuple of mapping of source to ndarray, each (k, k)
        Covariance of every independent source of noise in each block.
    """

    names: tuple[str, ...]
    owners: tuple[str, ...]
    scale: Array
    flat: bool
    design: tuple[Array, ...]
    noise: tuple[dict[str, Array], ...]

    def __post_init__(self) -> None:
        if not (np.isfinite(self.scale) & (self.scale > 0)).all():
            raise InputError(f"prior sd must be positive and finite, got {self.scale.min():g} … {self.scale.max():g}.")

    @property
    def own(self) -> NDArray[np.intp]:
        """Which coefficients are parameters of interest."""
        return np.flatnonzero([owner == OWN for owner in self.owners])

    @property
    def terms(self) -> tuple[str, ...]:
        """The nuisance terms, those of the noise last; reading noise is not one of them."""
        in_noise = (source for block in self.noise for source in block)
        return tuple(name for name in dict.fromkeys([*self.owners, *in_noise]) if name not in (OWN, NOISE))

    @property
    def shared_terms(self) -> tuple[str, ...]:
        """The nuisance terms with coefficients of their own."""
        return tuple(dict.fromkeys(owner for owner in self.owners if owner != OWN))

    def rows(self, known: Collection[str] = ()) -> Array:
        """A, shape (k, m): the design whitened by the noise that is not known, columns in units of the prior sd."""
        return np.concatenate(self.blocks(known))

    def blocks(self, known: Collection[str] = ()) -> list[Array]:
        """The same block by block; blocks of one size are whitened together."""
        if any(all(source in known for source in noise) for noise in self.noise):
            raise InputError("reading noise must be left: readings without any would make everything known.")
        white: dict[int, Array] = {}
        sizes = np.array([len(values) for values in self.design])
        for size in np.unique(sizes):
            alike = np.flatnonzero(sizes == size)
            left = [np.sum([part for source, part in self.noise[k].items() if source not in known], axis=0) for k in alike]
            root = np.linalg.cholesky(np.array(left))
            white.update(zip(alike, solve_lower(root, np.array([self.design[k] for k in alike]) * self.scale), strict=True))
        return [white[k] for k in range(len(sizes))]

    def root(self, known: Collection[str] = (), *, times: float = 1.0) -> tuple[Array, NDArray[np.intp]]:
        """Upper triangular R with RᵀR = prior + readings' precision of the coefficients left, and which these are."""
        pairs = zip(self.owners, self.names, strict=True)
        left = np.flatnonzero([owner not in known and name not in known for owner, name in pairs])
        rows = np.sqrt(times) * (self.rows(known) if known else self._rows)[:, left]
        stacked: Any = np.concatenate([rows, np.diag(self._prior_precision[left])])
        return np.asarray(np.linalg.qr(stacked, mode="r")), left

    def covariance(self, known: Collection[str] = (), *, times: float = 1.0) -> Array:
        """Posterior covariance in units of the prior sd, shape (m, m), zero for what is known.

        Parameters
        ----------
        known : collection of str
            Terms, nuisance columns and noise alike, and single coefficients taken as known.
        times : float
            How often all readings are taken, each time with noise of its own.
        """
        root, left = self.root(known, times=times)
        inverse = _inverse_upper(root)
        covariance = np.zeros((len(self.names), len(self.names)))
        covariance[np.ix_(left, left)] = inverse @ inverse.T
        return covariance

    def variances(self, known: Collection[str] = (), *, times: float = 1.0) -> Array:
        """Posterior variances of the parameters of interest in units of their prior variance, shape (p,); see `covariance`."""
        return np.diag(self.covariance(known, times=times))[self.own]

    def contributions(self) -> dict[str, Array]:
        """Posterior variance of the parameters by its independent sources, in shares that sum to one, each shape (p,).

        With the estimate written as a linear map of prior means and readings, every source passes through it alone. The share
        of a source is also d ln sd(β) / d ln (its scale), the other scales held (half the logarithmic derivative of C).
        """
        covariance = self.covariance()
        own = self.own
        variance = np.diag(covariance)[own]
        found = {}
        if not self.flat:
            found[OWN] = (covariance[np.ix_(own, own)] ** 2).sum(axis=1) / variance
        for term in dict.fromkeys(owner for owner in self.owners if owner != OWN):
            members = np.flatnonzero([owner == term for owner in self.owners])
            found[term] = (covariance[np.ix_(own, members)] ** 2).sum(axis=1) / variance
        for design, noise in zip(self.design, self.noise, strict=True):
            total = np.linalg.cholesky(sum(noise.values(), np.zeros((len(design), len(design)))))
            weight = scipy.linalg.cho_solve((total, True), design * self.scale) @ covariance[:, own]
            for source, part in noise.items():
                gained = np.einsum("ki,kl,li->i", weight, part, weight) / variance
                found[source] = found.get(source, np.zeros(len(own))) + gained
        return found

    @property
    def _prior_precision(self) -> Array:
        return np.array([0.0 if self.flat and owner == OWN else 1.0 for owner in self.owners])

    @cached_property
    def _rows(self) -> Array:
        return self.rows()


def information_of(bound: BoundModel, phi: Array) -> Information:
    """Of a bound model at φ, shape (h,) [mm]. Set-up shift, discrepancy and random force errors are noise of their test."""
    return next(informations_of(bound, phi[None]))


def informations_of(bound: BoundModel, phi: Array) -> Iterator[Information]:
    """That of `information_of` at several φ in turn, shape (w, h) [mm]; what φ only scales is worked out once."""
    names, owners = list(bound.names), [OWN] * len(bound.names)
    columns = [bound.interest]
    scale: list[tuple[Hyper | None, Array]] = [(None, bound.scale)]
    noise: list[list[tuple[str, Hyper | None, Array]]] = [[(NOISE, "sigma", np.eye(len(test.factor)))] for test in bound.reduced]
    for term in bound.model.nuisances:
        label = type(term).__name__
        for part in term.columns(bound.setting):
            if not isinstance(part, BasisNoise) and not part.private:
                names += part.names
                owners += [label] * len(part.names)
                columns.append(part.values)
                scale.append((part.hyper, part.sd))
                continue
            for r, test in enumerate(bound.reduced):
                spread = test.factor * part.sd if isinstance(part, BasisNoise) else test.factor @ (part.values[r] * part.sd)
                noise[r].append((label, part.hyper, spread @ spread.T))
    every = np.concatenate(columns, axis=2)
    design = tuple(test.factor @ every[r] for r, test in enumerate(bound.reduced))
    for values in phi:
        value: dict[Hyper | None, float] = dict(zip(bound.hyper_prior.names, values, strict=True)) | {None: 1.0}
        scales = np.concatenate([sd * value[hyper] for hyper, sd in scale])
        here = []
        for parts in noise:
            own: dict[str, Array] = {}
            for label, hyper, covariance in parts:
                own[label] = own.get(label, 0.0) + covariance * value[hyper] ** 2
            here.append(own)
        yield Information(tuple(names), tuple(owners), scales, bound.model.prior.flat, design, tuple(here))


def _inverse_upper(root: Array) -> Array:
    return np.asarray(scipy.linalg.solve_triangular(root, np.eye(len(root))))
