"""The log likelihood ln p(z | β, φ), with the nuisance coefficients integrated out analytically.

β (p,) are the parameters: compliances, their changes with force, and geometric errors. Nuisance
coefficients belong to effects that are modelled but not of interest. φ are the hyper-parameters,
such as the standard deviation of the noise. The readings of test r are reduced to z_r by projection
on 25 Fourier basis functions. R_r is the triangular factor in the QR decomposition of these
functions at the test's angles (`reduction`):

    z_r = R_r (H_r β + U_r u + V_r v_r + e_r) + ε.

The columns of H_r, U_r and V_r are the readings per unit of each parameter or coefficient, as 25
Fourier coefficients. The coefficients u ~ N(m, s²) are the same in all tests; the coefficients v_r
~ N(0, s²) and the noise e_r ~ N(0, s²) of the Fourier coefficients belong to test r only; the
reading noise is ε ~ N(0, σ²). Each mean m is known, and each scale s is a known number times
hyper-parameters. The module `observations` writes this as z − H β = A x + N(0, D(φ)), where x holds
the coefficients and D is diagonal. Then

    P = Aᵀ D⁻¹ A = L Lᵀ,   r = z − H β,
    ln p(z | β, φ) = −½ Σ ln D − ½ rᵀ D⁻¹ r + ½ |L⁻¹ Aᵀ D⁻¹ r|² − Σ ln L_jj + constant.

Only D depends on φ. The last dimension of arrays, of length w, runs over the values of φ and is
contiguous.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ldbb_bayes.model.elimination import BLAS_MULTIPLE, DesignRows
from ldbb_bayes.model.fourier import SIZE
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.linear_algebra import sparse_or_dense
from ldbb_bayes.model.observations import observation_equations
from ldbb_bayes.model.reduction import Reduced
from ldbb_bayes.model.terms import BasisNoise, Columns
from ldbb_bayes.model.terms.columns import Hyper
from ldbb_bayes.model.triangular import solve_columns
from ldbb_bayes.results import Array

__all__ = ["StructuredGaussian"]

# Size [bytes] of an array that is allocated and freed once at the start. Afterwards, the memory
# allocator of the GNU C library (malloc) keeps freed memory of up to this size for reuse, which
# saves time.
_MALLOC_BYTES = 31 << 20
# Variances of noise [mm²] and of priors (without unit) are replaced by this number if their
# absolute value is smaller, because the likelihood divides by variances. The number is so small
# that a coefficient with this prior variance is practically zero.
_LEAST_VARIANCE = 1e-60


class _InterestRows(NamedTuple):
    """The k observation equations that contain the parameters of interest β.

    All observation equations together are z − H β = A x + noise. z are the readings, β the p
    parameters of interest, and x the coefficients of nuisances.
    """

    #: Transpose of the design matrix A of the nuisance coefficients in k observation equations,
    #: shape (coefficients, k), dense or sparse.
    transposed_columns: Array | csr_array
    #: Design matrix H of the p parameters of interest in k observation equations, shape (k, p).
    interest: Array
    values: Array  #: Readings z on the left-hand side of k observation equations, shape (k,).
    #: Index of the kind of each of k observation equations, shape (k,). Equations of one kind have
    #: the same variance.
    kinds: NDArray[np.intp]


class _Batch(NamedTuple):
    """Quantities computed for a batch of w values of the hyper-parameters φ.

    All values of a batch are processed together. w is a multiple of eight; if necessary, the last
    value of φ is repeated. The library for matrix products (BLAS) then rounds in the same way,
    whatever w is.
    """

    #: Indices of the w values of the hyper-parameters in the array that the caller gave, shape
    #: (w,).
    phi_index: NDArray[np.intp]
    #: Reciprocal noise variance of every kind of observation equations for w values of the
    #: hyper-parameters, shape (kinds, w). Equations of one kind have the same variance.
    weight: Array
    #: Part of Aᵀ D⁻¹ r from those observation equations that depend on the parameters of interest
    #: β, for w values of the hyper-parameters, shape (columns of A, w). A is the design matrix of
    #: the nuisance coefficients, D the diagonal noise covariance, and r the readings minus the
    #: effect of β. None if there are no parameters β.
    shift: Array | None
    #: One part of the log density of the readings, for w values of the hyper-parameters, shape
    #: (w,). The part is −½ Σ ln D − ½ rᵀ D⁻¹ r + constant. D is the diagonal noise covariance, and
    #: r is the vector of the readings minus the effect of the parameters of interest.
    log_density: Array

    @property
    def selection(self) -> slice:
        """Slice that selects this batch from all values of the hyper-parameters."""
        return slice(self.phi_index[0], self.phi_index[-1] + 1)


class StructuredGaussian:
    """Density p(z | β, φ) of readings z, with all nuisance coefficients integrated out.

    Coefficients are either shared by all tests or private, which means that each belongs to a
    single test. β are the parameters, and φ the hyper-parameters.

    Parameters
    ----------
    reduced
        Readings of every test, reduced by projection on the 25 Fourier functions.
    columns
        Columns and noise of the nuisance terms. `conditional` returns shared coefficients in the
        order of these columns.
    offset
        Known part of the readings, which is subtracted from the readings; 25 Fourier coefficients
        for every test, shape (tests, 25) [mm].
    hypers
        Names of the h hyper-parameters φ, in the order in which arrays hold their values.
    interest
        Reading per unit of each of the p parameters β, as 25 Fourier coefficients, shape
        (tests, 25, p). If it is given, the methods need values of β. By default the readings do not
        depend on parameters β.
    """

    def __init__(
        self,
        reduced: Sequence[Reduced],
        columns: Sequence[Columns | BasisNoise],
        *,
        offset: Array,
        hypers: Sequence[Hyper],
        interest: Array | None = None,
    ) -> None:
        """Set up the observation equations; compute what does not depend on φ."""
        _keep_freed_memory()
        if interest is None:
            interest = np.zeros((len(reduced), SIZE, 0))
        observed = observation_equations(
            reduced, columns, offset=offset, hypers=hypers, interest=interest
        )
        rows = observed.rows
        self._hypers = tuple(hypers)
        self._sources = observed.sources
        self._unit = observed.unit
        self._shared = observed.shared
        self._tests = len(reduced)
        self._columns = rows.columns
        first, self._kinds = _group_equal_rows(_round_to_ten_digits(rows.variance))
        # Each row of the array ``rows.variance`` belongs to one observation equation (a reading or
        # the prior of a coefficient), and holds the factors from which the variance of this
        # equation is computed. The nonzero factors of an equation have the same sign. They are
        # negative only in the prior of a coefficient with a negative prior variance. Such a
        # coefficient reduces the noise covariance of the readings, whereas all other coefficients
        # increase it (`Observations.signs`).
        self._kind_signs = np.where(rows.variance[first].sum(axis=1) < 0.0, -1.0, 1.0)
        self._kind_variance = sparse_or_dense(np.abs(rows.variance[first]))
        # Some observation equations depend on the parameters of interest and must be evaluated in
        # every call of a method. For all others, everything that does not depend on the
        # hyper-parameters is computed here, once.
        contains_interest = (rows.interest != 0.0).any(axis=1)
        known_values = np.where(contains_interest, 0.0, rows.values)
        self._design = DesignRows(
            rows.columns,
            known_values,
            self._kinds,
            signs=observed.signs,
            shared=observed.shared,
        )
        self._interest_rows = _InterestRows(
            transposed_columns=sparse_or_dense(rows.columns[contains_interest].T),
            interest=rows.interest[contains_interest],
            values=rows.values[contains_interest],
            kinds=self._kinds[contains_interest],
        )
        count = np.zeros((len(reduced) + 1, len(first)))
        squares = np.zeros((len(reduced) + 1, len(first)))
        np.add.at(count, (rows.test, self._kinds), rows.readings)
        np.add.at(squares, (rows.test, self._kinds), known_values**2)
        self._count = count.sum(axis=0)
        # These sums are products with ones, because NumPy's sum rounds the last digit differently.
        self._squares = np.ones(len(squares)) @ squares
        self._log_constant = float(observed.log_constants.sum())

    def log_density(self, phi: Array, beta: Array | None = None) -> Array:
        """Return the log density ln p(z | β, φ) of the readings z, shape (w,).

        β are the parameters of interest, and φ the hyper-parameters.

        Parameters
        ----------
        phi
            w values of the h hyper-parameters, shape (w, h); lengths in mm.
        beta
            Values of the p parameters of interest, shape (w, p), or (p,) if they are the same for
            all values of φ. None if the object was made without parameters.
        """
        elimination = self._design.elimination(0)
        total = np.empty(len(phi))
        for batch in self._batches(phi, beta, elimination.chunk_size):
            _, gain = elimination.factorize(batch.weight, batch.shift)
            total[batch.phi_index] = batch.log_density + gain
        return total

    def conditional(
        self, phi: Array, beta: Array | None = None, *, last: int | None = None
    ) -> tuple[Array, Gaussian]:
        """Return the log density ln p(z | β, φ), shape (w,), and the density of the coefficients.

        The coefficients are those that are the same in all tests. Their density is conditional on
        the readings z, the parameters β and the hyper-parameters φ. It is returned as one Gaussian
        density for each of w values of φ; the ``log_integral`` of each density is ln p(z | β, φ).

        Parameters
        ----------
        phi
            w values of the h hyper-parameters, shape (w, h); lengths in mm.
        beta
            Values of the p parameters of interest, shape (w, p), or (p,) if they are the same for
            all values of φ. None if the object was made without parameters.
        last
            Number of coefficients in the density. They are the last of the coefficients that are
            the same in all tests. By default, all of these coefficients are used.
        """
        size = self._shared if last is None else last
        return self.conditional_of(range(self._shared - size, self._shared), phi, beta)

    def conditional_of(
        self, wanted: Sequence[int], phi: Array, beta: Array | None = None
    ) -> tuple[Array, Gaussian]:
        """Return the log density ln p(z | β, φ), shape (w,), and the density of some coefficients.

        The result is that of `conditional`, but only for the coefficients with the indices
        ``wanted`` among those that are the same in all tests, and in their order. All others are
        integrated out.
        """
        size = len(wanted)
        indices = np.array(wanted, dtype=np.intp)
        elimination = self._design.elimination_ending_with(tuple(wanted))
        total = np.empty(len(phi))
        lower = np.zeros((size, size, len(phi)))
        white_shift = np.empty((size, len(phi)))
        for batch in self._batches(phi, beta, elimination.chunk_size):
            workspace, gain = elimination.factorize(batch.weight, batch.shift)
            total[batch.phi_index] = batch.log_density + gain
            elimination.copy_factor(
                workspace,
                indices,
                lower=lower[:, :, batch.selection],
                white_shift=white_shift[:, batch.selection],
            )
        unit = self._unit[indices]
        mean = solve_columns(lower, white_shift).T * unit
        scale = np.broadcast_to(unit, mean.shape)
        root = lower.transpose(2, 1, 0)
        return total, Gaussian.factored(mean, root, scale, total)

    def draw_shared(self, phi: Array, standard: Array, rng: np.random.Generator) -> Array:
        """Return random draws of the coefficients that are the same in all tests.

        The last p of these coefficients are not drawn here. The caller draws p standard normal
        numbers instead and passes them as ``standard``; the coefficients are a linear
        transformation of these numbers (method `from_standard` of the density that `conditional`
        returns). All other coefficients are drawn from their density given the readings and the
        last p coefficients.

        Parameters
        ----------
        phi
            w values of the h hyper-parameters, shape (w, h); lengths in mm.
        standard
            Standard normal numbers from which the last p coefficients are computed, for several
            draws at each value of φ, shape (w, draws, p).
        rng
            Generator of random numbers.

        Returns
        -------
        Coefficients, shape (w, draws, number of coefficients that are the same in all tests).
        """
        first = self._shared - standard.shape[2]
        elimination = self._design.elimination(standard.shape[2])
        if not elimination.is_positive:
            elimination = self._design.elimination(self._shared)
        draws = np.empty((len(phi), standard.shape[1], self._shared))
        for batch in self._batches(phi, None, elimination.chunk_size):
            workspace, _ = elimination.factorize(batch.weight, None)
            for k in range(standard.shape[1]):
                normal = rng.standard_normal((self._columns.shape[1], len(batch.phi_index)))
                normal[first : self._shared] = standard[batch.phi_index, k].T
                if not elimination.is_positive:
                    # Coefficients with a negative prior variance cannot be drawn at random. They
                    # belong to single tests, so the random numbers of all coefficients of single
                    # tests are set to zero. This does not change the draws of the coefficients
                    # common to all tests, because the coefficients of single tests are eliminated
                    # first.
                    normal[self._shared :] = 0.0
                draws[batch.phi_index, k] = elimination.solve(workspace, normal)[: self._shared].T
        return draws * self._unit[: self._shared]

    def means(self, phi: Array, beta: Array) -> tuple[Array, Array]:
        """Return conditional means of all nuisance coefficients, for w values of φ and β.

        The means are conditional on the readings, the parameters of interest β and the
        hyper-parameters φ. The first result, shape (w, q), holds the means of the q coefficients
        that are the same in all tests. The second result, shape (w, tests, v), holds the means of
        the v coefficients of every test that belong to this test only. If the covariance of a noise
        term could not be made diagonal, the last of the v coefficients describe this noise.

        Parameters
        ----------
        phi
            w values of the h hyper-parameters, shape (w, h); lengths in mm.
        beta
            Values of the p parameters of interest, shape (w, p), or (p,) if they are the same for
            all values of φ.
        """
        elimination = self._design.elimination(0)
        mean = np.empty((len(phi), self._columns.shape[1]))
        for batch in self._batches(phi, beta, elimination.chunk_size):
            workspace, _ = elimination.factorize(batch.weight, batch.shift)
            mean[batch.phi_index] = elimination.solve(workspace).T
        mean *= self._unit
        shared, private = np.split(mean, [self._shared], axis=1)
        of_one_test = private.shape[1] // self._tests
        return shared, private.reshape(len(phi), self._tests, of_one_test)

    def _batches(
        self,
        phi: Array,
        beta: Array | None,
        batch_size: int,
    ) -> Iterator[_Batch]:
        """Yield batches of values of the hyper-parameters φ, one `_Batch` after the other.

        A batch also holds quantities that depend on φ, such as the noise variances, from which the
        log density of the readings is computed.

        Parameters
        ----------
        phi
            Values of the h hyper-parameters, shape (values, h); lengths in mm.
        beta
            Values of the p parameters of interest β, shape (values, p), or (p,) if they are the
            same for all values of φ. If ``beta`` is None, only the parts of the log density that do
            not depend on β are computed, and the field ``shift`` of a batch is None.
        batch_size
            Largest number of values of φ in a batch.
        """
        for start in range(0, len(phi), batch_size):
            size = min(len(phi) - start, batch_size)
            rounded_size = -(-size // BLAS_MULTIPLE) * BLAS_MULTIPLE
            index = np.arange(start, start + rounded_size)
            index = np.minimum(index, len(phi) - 1)
            magnitude = self._variances(phi[index])
            weight = self._kind_signs[:, None] / magnitude
            log_determinant = np.einsum("k,kw->w", self._count, np.log(magnitude))
            log_density_loss = log_determinant + np.einsum("k,kw->w", self._squares, weight)
            shift = None
            if beta is not None:
                stacked = np.broadcast_to(beta, (len(phi), beta.shape[-1]))[index]
                rows = self._interest_rows
                residual = rows.values[:, None] - rows.interest @ stacked.T
                weighted = residual * weight[rows.kinds]
                log_density_loss += np.ones(len(residual)) @ (residual * weighted)
                shift = rows.transposed_columns @ weighted
            log_density = self._log_constant - 0.5 * log_density_loss
            yield _Batch(index, weight, shift, log_density)

    def _variances(self, phi: Array) -> Array:
        """Return the absolute values of the variances of the observation equations.

        The result has the shape (kinds, w); equations of one kind have the same variance. ``phi``,
        shape (w, h), holds w values of the h hyper-parameters, with lengths in mm. Some variances
        are negative (see `Observations.signs`). Absolute values below 1e-60 are replaced by 1e-60.
        """
        value = dict(zip(self._hypers, np.ascontiguousarray(phi.T), strict=True))
        squares = np.empty((len(self._sources), len(phi)))
        for k, source in enumerate(self._sources):
            squares[k] = source.at(value) ** 2
        variance = self._kind_variance @ squares
        return np.maximum(variance, _LEAST_VARIANCE, out=variance)


def _group_equal_rows(values: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the index of the first row of every group of equal rows, and the group of each row.

    ``values`` has the shape (rows, columns). The groups are in the order in which `numpy.unique`
    with ``axis=0`` returns its rows. For rows of many columns, `numpy.unique` takes twenty times as
    long.
    """
    order = np.lexsort(values.T[::-1])
    in_order = values[order]
    begins_group = np.ones(len(values), dtype=bool)
    begins_group[1:] = (in_order[1:] != in_order[:-1]).any(axis=1)
    group = np.empty(len(values), dtype=np.intp)
    group[order] = np.cumsum(begins_group) - 1
    return order[begins_group], group


def _round_to_ten_digits(values: Array) -> Array:
    """Return variances (``values``) rounded to ten significant digits.

    After rounding, variances that differ only by rounding errors are equal.
    """
    magnitude = np.floor(np.log10(np.where(values > 0, values, 1.0)))
    size = 10.0 ** (9 - magnitude)
    return np.round(values * size) / size


@cache
def _keep_freed_memory() -> None:
    """Allocate and free one large array, so that freed memory is later reused.

    Afterwards, the memory allocator of the GNU C library (malloc) keeps the memory of freed arrays
    for new arrays, if they are not larger than this array (M_MMAP_THRESHOLD in mallopt(3)).
    Operations on many small matrices are then two to three times faster.
    """
    np.empty(_MALLOC_BYTES, dtype=np.uint8)
