"""Information that readings carry about parameters and nuisances, at given hyper-parameters.

Nuisances are effects that are modelled but not of interest. The module computes the uncertainty of
each coefficient, and what the uncertainty would be if a nuisance were known. `identify`, budgets
and designs use it. It needs the forces and angles of the readings, but not their values.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError
from ldbb_bayes.model.terms.columns import NOISE, OWN
from ldbb_bayes.results import Array

__all__ = ["Information"]


@dataclass(frozen=True, eq=False)
class Information:
    """Linear model z = A c + e of the readings, at given scales of the noise and of other effects.

    z are reduced readings, c (m,) all coefficients in units of their prior sd, A their columns, and
    e is white noise of unit variance. The posterior covariance of c is (1 + AᵀA)⁻¹. Methods can fix
    terms and coefficients, that is take them as known; these then have no part in c or e.
    """

    #: Names of the m coefficients.
    names: tuple[str, ...]
    #: Name of the nuisance term to which each coefficient belongs, or `OWN` for a parameter of
    #: interest.
    owners: tuple[str, ...]
    #: Prior sd of each of the m coefficients, or a typical size if its prior is flat, shape (m,).
    scale: Array
    #: Whether the parameters of interest have flat priors.
    flat: bool
    #: Effect of one unit of each of the m coefficients on the k reduced readings of each test,
    #: shape (k, m).
    design: tuple[Array, ...]
    #: Covariance of every independent source of noise, by name, for the k reduced readings of each
    #: test, shape (k, k).
    noise: tuple[dict[str, Array], ...]

    def __post_init__(self) -> None:
        if not (np.isfinite(self.scale) & (self.scale > 0)).all():
            raise InputError(
                f"prior sd must be positive and finite, got {self.scale.min():g} …"
                f" {self.scale.max():g}."
            )

    @property
    def interest(self) -> NDArray[np.intp]:
        """Indices of the coefficients that are parameters of interest."""
        return np.flatnonzero([owner == OWN for owner in self.owners])

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of all nuisance terms; terms that act as noise of single tests are last.

        Nuisances are effects modelled but not of interest. The white noise of the readings is left
        out.
        """
        names = list(self.owners)
        for sources in self.noise:
            names += sources
        return tuple(name for name in dict.fromkeys(names) if name not in (OWN, NOISE))

    @property
    def shared_terms(self) -> tuple[str, ...]:
        """Names of the nuisance terms whose coefficients are common to all tests."""
        return tuple(dict.fromkeys(owner for owner in self.owners if owner != OWN))

    def rows(self, fixed: Collection[str] = ()) -> Array:
        """Return the columns of all m coefficients in units of the noise, shape (k, m).

        There are k reduced readings; coefficients are in units of their prior sd. Noise of the
        terms in ``fixed`` is left out, as if it were known.
        """
        return np.concatenate(self.blocks(fixed))

    def blocks(self, fixed: Collection[str] = ()) -> list[Array]:
        """Return the columns of all coefficients in units of the noise, test by test.

        The columns of a test are multiplied from the left by the inverse Cholesky factor of its
        noise covariance.

        Parameters
        ----------
        fixed
            Names of the terms whose noise is left out, as if it were known.

        Returns
        -------
        list of array
            For every test, shape (rows, m) for m coefficients in units of their prior sd.

        Raises
        ------
        InputError
            If all noise of a test is fixed.
        """
        for sources in self.noise:
            if all(name in fixed for name in sources):
                raise InputError(
                    "reading noise must be left: readings without any would make everything known."
                )
        # The columns of all tests with the same noise covariance are divided by its Cholesky factor
        # together.
        blocks_by_noise: dict[int, list[int]] = {}
        for k, sources in enumerate(self.noise):
            blocks_by_noise.setdefault(id(sources), []).append(k)
        whitened: dict[int, Array] = {}
        for numbers in blocks_by_noise.values():
            sources = self.noise[numbers[0]]
            free_noise = [noise for name, noise in sources.items() if name not in fixed]
            root = np.linalg.cholesky(np.sum(free_noise, axis=0))
            designs = [self.design[k] for k in numbers]
            rows = np.stack(designs, axis=1) * self.scale
            flat_rows = rows.reshape(len(rows), -1)
            solved = scipy.linalg.solve_triangular(root, flat_rows, lower=True)
            solved_blocks = np.moveaxis(solved.reshape(rows.shape), 1, 0)
            whitened.update(zip(numbers, solved_blocks, strict=True))
        return [whitened[k] for k in range(len(self.design))]

    def root(
        self, fixed: Collection[str] = (), *, times: float = 1.0
    ) -> tuple[Array, NDArray[np.intp]]:
        """Return a square root of the posterior precision matrix, and which coefficients it has.

        Parameters
        ----------
        fixed
            Names of terms or single coefficients that are taken as known.
        times
            Number of repetitions of all readings, each with independent noise.

        Returns
        -------
        root
            Upper triangular matrix R, with RᵀR = precision of the prior + precision of the
            readings.
        free
            Indices of the coefficients that are not fixed.
        """
        is_free = [
            owner not in fixed and name not in fixed
            for owner, name in zip(self.owners, self.names, strict=True)
        ]
        free = np.flatnonzero(is_free)
        rows = self.rows(fixed) if fixed else self._all_rows
        prior = np.ones(len(free))
        if self.flat:
            prior[np.isin(free, self.interest)] = 0.0
        free_rows = np.sqrt(times) * rows[:, free]
        stacked = np.concatenate([free_rows, np.diag(prior)])
        return np.asarray(np.linalg.qr(stacked, mode="r")), free

    def covariance(
        self,
        fixed: Collection[str] = (),
        *,
        times: float = 1.0,
    ) -> Array:
        """Return the posterior covariance of all m coefficients, shape (m, m).

        It is in units of the prior sds, and zero for fixed coefficients.

        Parameters
        ----------
        fixed, times
            Terms or coefficients that are taken as known, and the number of repetitions of all
            readings, as in `root`.
        """
        root, free = self.root(fixed, times=times)
        inverse = scipy.linalg.solve_triangular(root, np.eye(len(root)))
        covariance = np.zeros((len(self.names), len(self.names)))
        covariance[np.ix_(free, free)] = inverse @ inverse.T
        return covariance

    def variances(
        self,
        fixed: Collection[str] = (),
        *,
        times: float = 1.0,
    ) -> Array:
        """Return the posterior variances of the p parameters of interest, shape (p,).

        They are in units of the prior variances.

        Parameters
        ----------
        fixed, times
            Terms or coefficients that are taken as known, and the number of repetitions of all
            readings, as in `root`.
        """
        return np.diag(self.covariance(fixed, times=times))[self.interest]

    def shares(
        self,
        covariance: Array | None = None,
    ) -> dict[tuple[str, str], Array]:
        """Return the share of every independent source of uncertainty in the parameters' variances.

        Sources are the priors of the p parameters, the nuisance coefficients and the noise. The
        estimate is a linear function of all sources. Each source s alone therefore contributes an
        error of covariance Cov_s, shape (p, p), and the errors have the total covariance
        C = Σ Cov_s. The share of s in the variance of parameter i is [Γ_s V]_ii / V_ii with
        Γ_s = Cov_s C⁻¹; the shares of all sources sum to one.

        Parameters
        ----------
        covariance
            V, covariance of the parameters, shape (p, p); by default the total covariance C.

        Returns
        -------
        Shares (p,) of every source; its key is (name of the coefficient or noise, name of its
        term).
        """
        joint = self.covariance()
        interest = self.interest
        total = joint[np.ix_(interest, interest)]
        if covariance is None:
            variance = np.diag(total)
            weight = np.eye(len(interest))
        else:
            variance = np.diag(covariance)
            weight = np.linalg.solve(total, covariance)
        weight = weight / np.where(variance > 0.0, variance, 1.0)
        covariances: dict[tuple[str, str], Array] = {}
        if not self.flat:
            covariances[OWN, OWN] = total @ total.T
        for k, (name, owner) in enumerate(zip(self.names, self.owners, strict=True)):
            if owner != OWN:
                covariances[name, owner] = np.outer(joint[interest, k], joint[interest, k])
        for design, sources in zip(self.design, self.noise, strict=True):
            noise = sum(sources.values(), np.zeros((len(design), len(design))))
            root = np.linalg.cholesky(noise)
            solved = scipy.linalg.cho_solve((root, True), design * self.scale)
            gain = solved @ joint[:, interest]
            for name, source_noise in sources.items():
                previous = covariances.get((name, name), 0.0)
                covariances[name, name] = previous + gain.T @ source_noise @ gain
        return {key: np.einsum("ij,ji->i", cov, weight) for key, cov in covariances.items()}

    def contributions(self) -> dict[str, Array]:
        """Return the share of every term in the variances of the p parameters, each of shape (p,).

        A share is also the derivative d ln u / d ln s, where u is the parameter's standard
        uncertainty and s the scale of the term, with all other scales constant.
        """
        by_term: dict[str, Array] = {}
        for (_, term), share in self.shares().items():
            by_term[term] = by_term.get(term, 0.0) + share
        return by_term

    @cached_property
    def _all_rows(self) -> Array:
        return self.rows()
