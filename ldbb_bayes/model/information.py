"""Information that readings carry about parameters and nuisances, at given hyper-parameters.

Parameters are compliances, their slopes (changes with force) and geometric errors. Nuisances are
effects that are modelled but not of interest. Hyper-parameters are quantities such as the standard
deviation of the noise. The module computes the uncertainty of each coefficient, and what the
uncertainty would be if a nuisance were known. `identify`, uncertainty budgets and designs use this
module. The computation needs the forces and angles of the readings, but not the readings
themselves. The readings of a test are replaced by at most 25 numbers without loss of information
(module `reduction`); these numbers are called reduced readings.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError
from ldbb_bayes.model.terms.columns import NOISE, PARAMETERS
from ldbb_bayes.results import Array

__all__ = ["Information"]

# The effects of the parameters of interest on the readings form a matrix. When the rank of this
# matrix is determined, singular values below this fraction of its largest singular value count as
# zero.
_RANK_TOLERANCE = 1e-9
# The precision (1 / variance) that the readings alone give to a coefficient is divided by the prior
# precision of the coefficient. If the ratio is below this number, it counts as a rounding error,
# and the readings are treated as carrying no information about the coefficient.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Information:
    """Linear model z = A c + e of the readings, at given scales of the noise and of other effects.

    z are the reduced readings, scaled so that their noise e is white and has unit variance. c are
    all m coefficients, divided by their ``scale`` (prior sd), and A is the design matrix of c. The
    coefficients are the parameters of interest, and all coefficients of nuisances that have the
    same value in all tests. If no prior is flat, c has the posterior covariance (1 + AᵀA)⁻¹.
    Several methods have an argument ``fixed``, which names terms and coefficients that are treated
    as known. Coefficients treated as known are left out of c, and noise treated as known is left
    out of e.
    """

    #: Names of the m coefficients of the model: parameters of interest, then nuisance coefficients,
    #: which belong to effects that are modelled but not of interest.
    names: tuple[str, ...]
    #: Class name of the nuisance term to which each of the model's m coefficients belongs, or the
    #: word ``Parameters`` (the constant `PARAMETERS`) for a parameter of interest.
    owners: tuple[str, ...]
    #: Prior sd of each of the model's m coefficients in internal units (mm, N, rad), shape (m,). If
    #: the prior of a coefficient is flat, its typical magnitude is stored instead.
    scale: Array
    #: Whether the parameters of interest have flat priors.
    flat: bool
    #: Design matrix of each test, shape (k, m): the change of the test's k reduced readings per
    #: unit of each of the model's m coefficients. Reduced readings are numbers, 25 at most, that
    #: replace the readings of a test.
    design: tuple[Array, ...]
    #: One dict for each test. It holds, for every independent source of noise, the covariance of
    #: the test's k reduced readings, shape (k, k) [mm²]. The keys are the class names of the terms
    #: that cause the noise; the white noise of the readings has the key ``NOISE``.
    noise: tuple[dict[str, Array], ...]

    def __post_init__(self) -> None:
        """Raise an `InputError` if the prior sd of a coefficient is not positive and finite."""
        if not (np.isfinite(self.scale) & (self.scale > 0)).all():
            raise InputError(
                f"prior sd must be positive and finite, got {self.scale.min():g} …"
                f" {self.scale.max():g}."
            )

    @property
    def interest(self) -> NDArray[np.intp]:
        """Indices, in the list of all coefficients, of the p parameters of interest, shape (p,)."""
        return np.flatnonzero([owner == PARAMETERS for owner in self.owners])

    @property
    def terms(self) -> tuple[str, ...]:
        """Class names of all nuisance terms.

        Terms that act only as noise of single tests come last. The white noise of the readings is
        left out.
        """
        names = list(self.owners)
        for sources in self.noise:
            names += sources
        return tuple(name for name in dict.fromkeys(names) if name not in (PARAMETERS, NOISE))

    @property
    def shared_terms(self) -> tuple[str, ...]:
        """Class names of the nuisance terms whose coefficients are the same in all tests."""
        return tuple(dict.fromkeys(owner for owner in self.owners if owner != PARAMETERS))

    def rows(self, fixed: Collection[str] = ()) -> Array:
        """Return the design matrix of all m coefficients, scaled to noise of unit variance.

        The matrix has the shape (k, m), with one row for each of the k reduced readings of all
        tests (at most 25 for each test). It is multiplied from the left by the inverse Cholesky
        factor of the noise covariance of the reduced readings. The coefficients are divided by
        their prior sd. ``fixed`` holds the class names of terms that act as noise but whose effects
        are assumed to be known exactly; the noise covariance does not contain their covariance.
        """
        return np.concatenate(self.blocks(fixed))

    def blocks(self, fixed: Collection[str] = ()) -> list[Array]:
        """Return the design matrix of each test, scaled so that the noise has unit covariance.

        The design matrix is multiplied from the left by the inverse Cholesky factor of the noise
        covariance of the test's reduced readings. All m coefficients are divided by their prior sd.

        Parameters
        ----------
        fixed
            Class names of model terms that act as noise but whose effects are assumed to be known
            exactly. The noise covariance of the readings then does not contain the covariance of
            these terms.

        Returns
        -------
        list of array
            One matrix for every test, shape (reduced readings, m).

        Raises
        ------
        InputError
            If all noise of a test would be left out.
        """
        for sources in self.noise:
            if all(name in fixed for name in sources):
                raise InputError(
                    "reading noise must be left: readings without any would make everything known."
                )
        # Tests with the same noise covariance are treated together: one call multiplies the design
        # matrices of all these tests by the inverse Cholesky factor of the covariance.
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
        """Return a square root of a posterior precision matrix, and the coefficients it contains.

        The matrix contains all coefficients of the model except those that are taken as known. The
        coefficients are divided by their prior sd.

        Parameters
        ----------
        fixed
            Class names of terms, or names of single coefficients, that are taken as known.
        times
            Number of repetitions of all readings, each with independent noise.

        Returns
        -------
        root
            Upper triangular matrix R, with RᵀR = precision matrix of the prior + precision matrix
            of the readings, shape (free coefficients, free coefficients).
        free
            Indices of the free coefficients, which are those not taken as known.
        """
        is_free = [
            owner not in fixed and name not in fixed
            for owner, name in zip(self.owners, self.names, strict=True)
        ]
        free = np.flatnonzero(is_free)
        if times == 1.0 and self._noise_names.isdisjoint(fixed):
            if len(free) == len(self.names):
                return self._root, free
            # R is a square root of the posterior precision matrix of all coefficients, RᵀR =
            # precision. If only the columns of the free coefficients (those not taken as known) are
            # kept, RᵀR is the precision matrix of the free coefficients. R is used here instead of
            # the design matrix because it has fewer rows.
            return np.asarray(np.linalg.qr(self._root[:, free], mode="r")), free
        return self._root_of(np.sqrt(times) * self.rows(fixed), free), free

    @cached_property
    def _root(self) -> Array:
        """Square root of the posterior precision matrix of all m coefficients, shape (m, m).

        The coefficients are the parameters of interest and the nuisance coefficients of a model.
        """
        return self._root_of(self._all_rows, np.arange(len(self.names)))

    def _root_of(self, rows: Array, free: NDArray[np.intp]) -> Array:
        """Return the upper triangular square root of the posterior precision of some coefficients.

        The coefficients are divided by their prior sd, so that their prior precision is one. If the
        prior of the parameters of interest is flat, their prior precision is zero.

        ``rows`` is the design matrix of the model's m coefficients for k reduced readings with unit
        noise, shape (k, m). ``free`` holds the indices of the coefficients that are used; the
        others are taken as known. The result is a matrix R, with RᵀR = posterior precision.
        """
        prior = np.ones(len(free))
        if self.flat:
            prior[np.isin(free, self.interest)] = 0.0
        stacked = np.concatenate([rows[:, free], np.diag(prior)])
        return np.asarray(np.linalg.qr(stacked, mode="r"))

    @cached_property
    def _noise_names(self) -> frozenset[str]:
        """Names of all sources of noise.

        They are ``NOISE`` for white noise, and the class names of the nuisance terms that act as
        noise.
        """
        return frozenset(name for sources in self.noise for name in sources)

    def covariance(
        self,
        fixed: Collection[str] = (),
        *,
        times: float = 1.0,
    ) -> Array:
        """Return the posterior covariance of the model's m coefficients, shape (m, m).

        The coefficients are divided by their prior sds. The covariance is zero for coefficients
        that are taken as known.

        Parameters
        ----------
        fixed
            Class names of terms, or names of single coefficients, that are taken as known.
        times
            Number of repetitions of all readings, each with independent noise.
        """
        if times == 1.0 and not fixed:
            return self._covariance
        return self._covariance_without(fixed, times)

    @cached_property
    def _covariance(self) -> Array:
        """Posterior covariance of the m coefficients of the model.

        The array has the shape (m, m). It is read-only, because all callers share it.
        """
        covariance = self._covariance_without((), 1.0)
        covariance.flags.writeable = False
        return covariance

    def _covariance_without(self, fixed: Collection[str], times: float) -> Array:
        """Compute the posterior covariance of the model's m coefficients, shape (m, m).

        ``fixed`` names the terms and coefficients that are taken as known, and ``times`` is the
        number of repetitions of all readings. The result is computed anew in every call.
        """
        root, free = self.root(fixed, times=times)
        inverse = scipy.linalg.solve_triangular(root, np.eye(len(root)))
        covariance = np.zeros((len(self.names), len(self.names)))
        covariance[np.ix_(free, free)] = inverse @ inverse.T
        return covariance

    def variances(self, fixed: Collection[str] = ()) -> Array:
        """Return the posterior variances of the p parameters of interest, shape (p,).

        Each variance is divided by the square of the parameter's ``scale``, which is its prior sd
        unless the prior is flat.

        Parameters
        ----------
        fixed
            Class names of terms, or names of single coefficients, that are taken as known.
        """
        return np.diag(self.covariance(fixed))[self.interest]

    def shares(
        self,
        covariance: Array | None = None,
    ) -> dict[tuple[str, str], Array]:
        """Return the share of every independent source of uncertainty in the parameters' variances.

        Sources are the priors of the p parameters of interest, the nuisance coefficients and the
        noise. The estimate of the parameters is a linear function of all sources. Each source s
        therefore contributes an error with a covariance Cov_s, shape (p, p), and the total error
        has the covariance C = Σ Cov_s. The share of s in the variance of parameter i is [Γ_s V]_ii
        / V_ii with Γ_s = Cov_s C⁻¹, where V is the covariance matrix that is to be divided into
        shares. The shares of all sources sum to one.

        Parameters
        ----------
        covariance
            Covariance V of the parameters in units of their prior sds, shape (p, p); by default C.

        Returns
        -------
        Dict with the shares of every source, in arrays of shape (p,). The key of a source is a pair
        of names: the name of the coefficient or noise, and the name of the term to which it
        belongs. The priors of the parameters of interest are one source with the key
        ``(PARAMETERS, PARAMETERS)``. If these priors are flat, this source does not exist.
        """
        total = self.covariance()[np.ix_(self.interest, self.interest)]
        if covariance is None:
            variance = np.diag(total)
            weight = np.eye(len(total))
        else:
            variance = np.diag(covariance)
            weight = np.linalg.solve(total, covariance)
        weight = weight / np.where(variance > 0.0, variance, 1.0)
        covariances = self.error_covariances()
        return {key: np.einsum("ij,ji->i", cov, weight) for key, cov in covariances.items()}

    def error_covariances(self, weights: Array | None = None) -> dict[tuple[str, str], Array]:
        """Return the contribution of every source of uncertainty to the posterior covariance.

        The sources are independent, and the sum of their contributions is the posterior covariance
        of the p parameters of interest. The parameters are in units of their prior sds. The result
        is a dict of arrays of shape (p, p); it has the same keys as the result of `shares`.

        Parameters
        ----------
        weights
            Weights of the m coefficients in q weighted sums, shape (q, m); the coefficients are in
            units of their prior sds. If weights are given, the result holds contributions to the
            covariance of the q sums, shape (q, q), instead of the covariance of the parameters.
        """
        joint = self.covariance()
        interest = self.interest
        errors = joint[interest] if weights is None else weights @ joint
        covariances: dict[tuple[str, str], Array] = {}
        if not self.flat:
            covariances[PARAMETERS, PARAMETERS] = errors[:, interest] @ errors[:, interest].T
        for k, (name, owner) in enumerate(zip(self.names, self.owners, strict=True)):
            if owner != PARAMETERS:
                covariances[name, owner] = np.outer(errors[:, k], errors[:, k])
        for design, sources in zip(self.design, self.noise, strict=True):
            noise = sum(sources.values(), np.zeros((len(design), len(design))))
            root = np.linalg.cholesky(noise)
            solved = scipy.linalg.cho_solve((root, True), design * self.scale)
            gain = solved @ errors.T
            for name, source_noise in sources.items():
                previous = covariances.get((name, name), 0.0)
                covariances[name, name] = previous + gain.T @ source_noise @ gain
        return covariances

    def contributions(self) -> dict[str, Array]:
        """Return the share of every term in the variances of the p parameters of interest.

        The result is a dict of arrays of shape (p,); its keys are the class names of the terms. The
        noise of the readings (key ``NOISE``) and the priors of the parameters of interest (key
        ``PARAMETERS``) count as terms. The shares of all terms sum to one. A share is also the
        derivative d ln u / d ln s at constant scales of all other terms, where u is the standard
        uncertainty of the parameter and s is the scale (prior sd) of the term.
        """
        by_term: dict[str, Array] = {}
        for (_, term), share in self.shares().items():
            by_term[term] = by_term.get(term, 0.0) + share
        return by_term

    def sd_from_readings(self) -> Array:
        """Return the sd of each nuisance coefficient without its prior, in units of its prior sd.

        The result, shape (m,), has one element for each of the m coefficients of the model; the
        elements for parameters of interest are NaN. The sd follows from the readings and from the
        priors of all other nuisance coefficients. Flat priors are assumed for the coefficient
        itself and for the parameters of interest. The sd is infinite if the coefficient changes no
        reading, or if the parameters of interest can change the readings in the same way.

        The sd is computed from the posterior variance v_k of coefficient k, in units of its prior
        variance, for flat priors of the parameters of interest. Its reciprocal is 1 / v_k = 1 +
        r_k, where 1 is the precision of the prior and r_k that of the readings. The sd without the
        prior is r_k^(−1/2).
        """
        sd = np.full(len(self.names), np.nan)
        nuisances = np.setdiff1d(np.arange(len(self.names)), self.interest)
        if len(nuisances) == 0:
            return sd
        rows = self._all_rows[:, nuisances]
        basis = self._range_of_parameters()
        remaining = rows - basis @ (basis.T @ rows)
        stacked = np.concatenate([remaining, np.eye(len(nuisances))])
        root = np.linalg.qr(stacked, mode="r")
        inverse = scipy.linalg.solve_triangular(root, np.eye(len(root)))
        precision = 1.0 / np.sum(inverse**2, axis=1) - 1.0
        is_informed = precision > _ROUNDING
        finite_sd = np.where(is_informed, precision, 1.0) ** -0.5
        sd[nuisances] = np.where(is_informed, finite_sd, np.inf)
        return sd

    def _range_of_parameters(self) -> Array:
        """Return an orthonormal basis of the effects of the parameters of interest on readings.

        The basis has the shape (k, rank), where rank is the number of linearly independent effects.
        An effect is the change of the k reduced readings of all tests per unit of a parameter. The
        readings are scaled so that the noise has unit variance. A test has at most 25 reduced
        readings.
        """
        columns = self._all_rows[:, self.interest]
        length = np.linalg.norm(columns, axis=0)
        columns = columns / np.where(length > 0.0, length, 1.0)
        left, singular, _ = np.linalg.svd(columns, full_matrices=False)
        return np.asarray(left[:, singular > _RANK_TOLERANCE * singular.max(initial=0.0)])

    @cached_property
    def _all_rows(self) -> Array:
        """Design matrix of all m coefficients, scaled to noise of unit variance, shape (k, m).

        The matrix has one row for each of k reduced readings. The noise is the sum of all sources
        of noise in the model.
        """
        return self.rows()
