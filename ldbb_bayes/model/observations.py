"""Observation equations: readings and priors as rows with a diagonal covariance.

    z − H β = A x + N(0, D(φ))

z are the readings of all tests, reduced to at most 26 numbers for each test: 25 for the Fourier
functions to order 12, and the norm of the part of the readings that these functions cannot describe
(`reduction`). β are the p parameters of interest: compliances, their changes with force, and
geometric errors. Their design matrix is H, shape (rows, p). x are the coefficients of nuisances,
which are effects modelled but not of interest. Their design matrix is A, shape (rows,
coefficients). Each coefficient is rescaled as `Observations.unit` describes. Shared coefficients
are the same in all tests; a private coefficient belongs to a single test.

The rows of a test are rotated so that the covariance of all noise in the test is diagonal. The
prior of each coefficient adds one row, unless the prior is flat. Only the diagonal matrix D depends
on the hyper-parameters φ, which are the scales (standard deviations) of the noise and of nuisances.
Each entry of D is a weighted sum of squares. The quantities that are squared are called sources of
variance; they are hyper-parameters and products of hyper-parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from ldbb_bayes.model.fourier import SIZE
from ldbb_bayes.model.gaussian import LOG_2PI
from ldbb_bayes.model.reduction import NearUniform, Reduced
from ldbb_bayes.model.terms import BasisNoise, Columns
from ldbb_bayes.model.terms.columns import Hyper, Source
from ldbb_bayes.results import Array

__all__ = ["Observations", "Rows", "observation_equations"]


class Rows(NamedTuple):
    """The n rows of observation equations z − H β = A x + N(0, D).

    z are reduced readings or prior means, β are the p parameters of interest, x are the
    coefficients of nuisances, and D is a diagonal covariance matrix. Reduced readings are numbers,
    26 at most, that replace the readings of a test.
    """

    #: Design matrix A of the coefficients of nuisances, shape (n, coefficients), with n observation
    #: equations and one column for each coefficient.
    columns: Array
    #: Design matrix H of the p parameters of interest, shape (n, p) for n observation equations.
    interest: Array
    #: Left-hand side z of each of n observation equations, shape (n,): a reduced reading [mm] or
    #: the prior mean of a coefficient. One equation of each test holds the norm of that part of the
    #: readings which Fourier series to order 12 cannot describe [mm].
    values: Array
    #: Number of readings that each of n observation equations represents, shape (n,). It is 1 for
    #: an equation that represents the prior of a coefficient.
    readings: Array
    #: Index of the test to which each of n observation equations belongs, shape (n,). For an
    #: equation that is the prior of a coefficient common to all tests, the entry is equal to the
    #: number of tests.
    test: NDArray[np.intp]
    #: Factors v, shape (n, sources), from which the variance of each of n observation equations is
    #: computed as Σ v · source². A source of variance is a hyper-parameter (the standard deviation
    #: of an effect) or a product of hyper-parameters.
    variance: Array


class Observations(NamedTuple):
    """Observation equations of all tests, and other quantities that the likelihood needs.

    The equations are linear in the parameters of interest and in the coefficients of nuisances.
    """

    rows: Rows
    #: Sources of variance, one for each column of ``rows.variance``. A source is a hyper-parameter
    #: (such as the standard deviation of the white noise) or a product of hyper-parameters.
    sources: list[Source]
    #: Unit in which every nuisance coefficient is expressed, shape (coefficients,). The unit is the
    #: prior sd of the coefficient divided by the hyper-parameter that scales this sd. If no
    #: hyper-parameter scales it, the unit is the prior sd. If the prior is flat, the unit is the
    #: reciprocal norm of the coefficient's column in the design matrix.
    unit: Array
    #: One sign, +1 or −1, for each nuisance coefficient, shape (coefficients,). If the sign is −1,
    #: the prior variance of the coefficient is negative: the coefficient reduces the noise
    #: covariance of the readings instead of increasing it. `_columns_for_uneven_angles` explains
    #: why this is needed.
    signs: Array
    #: Number of nuisance coefficients that are the same in all tests. Their columns come first in
    #: the design matrix of the nuisance coefficients.
    shared: int
    #: Constants that are added to the log density of the readings, shape (tests + 1,): one for
    #: every test, and a last one for all flat priors of nuisance coefficients together.
    log_constants: Array


class _Nuisances(NamedTuple):
    """Nuisances, sorted by their role in the equations.

    The observation equations are z − H β = A x + N(0, D). z are the readings, H β is the effect of
    the parameters of interest β, x are the coefficients of nuisances, and the noise covariance D is
    diagonal. The coefficients of ``shared`` columns of A are the same in all tests; the
    coefficients of ``private`` columns have a separate value in every test.
    """

    #: Noise of the Fourier coefficients of each test, independent between tests. The readings of
    #: each test are rotated so that this noise has a diagonal covariance. The noise then needs no
    #: columns in the design matrix.
    diagonal: list[BasisNoise]
    shared: list[Columns]
    private: list[Columns]
    #: One sign, +1 or −1, for each nuisance coefficient that has a separate value in every test. A
    #: coefficient with the sign +1 adds noise to the model of the readings. If the sign is −1, the
    #: prior variance of the coefficient is negative, and the coefficient reduces the noise
    #: covariance.
    private_signs: list[float]

    @property
    def shared_size(self) -> int:
        """Number of nuisance coefficients that are the same in all tests."""
        return sum(len(term.names) for term in self.shared)

    @property
    def private_size(self) -> int:
        """Number of nuisance coefficients that have a separate value in every test."""
        return len(self.private_signs)


class _Rotated(NamedTuple):
    """Matrices of one test after a change of variables that makes its noise covariance diagonal.

    The reduced readings are m numbers, not more than 25, that replace the readings of the test. The
    change of variables multiplies them by a matrix Q. ``rotation`` is Q, shape (m, m). ``factor``
    is Q R, where R, shape (m, 25), turns the test's 25 Fourier coefficients into its reduced
    readings. ``noise_sd`` holds one array of shape (m,) for each noise term: the sds of this noise
    after the change of variables, divided by the hyper-parameter that scales the noise.
    """

    rotation: Array
    factor: Array
    noise_sd: list[Array]


class _CoefficientPriors(NamedTuple):
    """Gaussian priors of all nuisance coefficients, in the order of the coefficients' columns.

    The source of variance of a coefficient is the hyper-parameter, or the product of
    hyper-parameters, to which its prior sd is proportional. A fixed part of the prior sd,
    ``stated_sd``, may be added in quadrature.
    """

    #: Prior sd of every nuisance coefficient, divided by the hyper-parameter (or product of
    #: hyper-parameters) that scales this sd, shape (coefficients,); infinite for a flat prior.
    sd: Array
    #: Fixed part of the prior sd of every nuisance coefficient, shape (coefficients,). This part
    #: does not depend on hyper-parameters, and is added in quadrature to the part that does.
    stated_sd: Array
    mean: Array
    #: For each nuisance coefficient, the index of the source of variance that scales its prior sd,
    #: shape (coefficients,). A source is a hyper-parameter or a product of hyper-parameters.
    source: NDArray[np.intp]


class _Scaled(NamedTuple):
    """Observation equations with rescaled nuisance coefficients.

    ``unit``, shape (coefficients,), holds the unit in which each coefficient is expressed. It is
    the prior sd divided by the hyper-parameter that scales this sd or, for a flat prior, the
    reciprocal norm of the coefficient's column. ``log_volume`` is the constant that all flat priors
    together add to the log density.
    """

    rows: Rows
    unit: Array
    log_volume: float


def observation_equations(
    reduced: Sequence[Reduced],
    terms: Sequence[Columns | BasisNoise],
    *,
    offset: Array,
    hypers: Sequence[Hyper],
    interest: Array,
) -> Observations:
    """Return the observation equations of all tests: readings and priors as independent rows.

    Parameters
    ----------
    reduced
        Readings of every test, reduced by projection on the 25 Fourier functions.
    terms
        Columns and noise of the nuisance terms.
    offset
        Known part of the readings of every test, as 25 Fourier coefficients, shape (tests, 25)
        [mm]. This part is subtracted from the readings.
    hypers
        Names of the hyper-parameters φ.
    interest
        Effect of one unit of each of the p parameters of interest on every test, as 25 Fourier
        coefficients, shape (tests, 25, p).

    Returns
    -------
    Observations
        The rows of the readings, test by test, followed by the rows of the priors. The result also
        holds the sources of variance and the constants of the log density.
    """
    near_uniform = [test.near_uniform for test in reduced if test.near_uniform is not None]
    all_uniform = len(near_uniform) == len(reduced)
    nuisances = _sort_nuisances(terms, near_uniform if all_uniform else None, len(reduced))
    sources = _sort_sources(terms, hypers)
    reading_rows = _reading_rows(
        reduced, nuisances, interest, offset, sources, all_uniform=all_uniform
    )
    rows, unit, log_volume = _add_priors(reading_rows, nuisances, len(reduced), sources)
    signs = np.array([1.0] * nuisances.shared_size + nuisances.private_signs * len(reduced))
    private_signs = signs[nuisances.shared_size :]
    # The rows from the index ``first`` on are the priors of the coefficients that belong to single
    # tests. They are the last rows of the observation equations.
    first = len(rows.variance) - len(private_signs)
    rows.variance[first:] *= private_signs[:, None]
    log_constants = [-0.5 * LOG_2PI * test.readings for test in reduced]
    # The reduced readings of a test are at most 25 numbers that replace its readings. If all
    # circles have nearly uniform angles, the function ``_rotate`` has multiplied these numbers by a
    # matrix. The log determinant of the matrix, −½ Σ ln(1 + departure), is therefore added to the
    # log density as a constant; `NearUniform` explains ``departure``.
    if all_uniform:
        for r, test in enumerate(near_uniform):
            log_constants[r] -= 0.5 * np.log1p(test.departure).sum()
    return Observations(
        rows=rows,
        sources=sources,
        unit=unit,
        signs=signs,
        shared=nuisances.shared_size,
        log_constants=np.array([*log_constants, log_volume]),
    )


def _sort_nuisances(
    terms: Sequence[Columns | BasisNoise],
    near_uniform: list[NearUniform] | None,
    tests: int,
) -> _Nuisances:
    """Return the nuisances, sorted into diagonal noise, shared columns and private columns.

    Diagonal noise has a diagonal covariance matrix after a change of variables. Columns belong to
    the design matrix. The coefficient of a shared column is the same in all tests; the coefficient
    of a private column has a separate value in every test.

    Parameters
    ----------
    terms
        Columns and noise of the nuisance terms.
    near_uniform
        Departures of the angles of every test from uniform spacing. None if at least one test is
        not a full circle with nearly uniform angles. In this case, only the noise term that affects
        the most Fourier coefficients is made diagonal. All other noise terms become private
        columns.
    tests
        Number of tests.
    """
    noise = [term for term in terms if isinstance(term, BasisNoise)]
    columns = [term for term in terms if isinstance(term, Columns)]
    shared = [term for term in columns if not term.private]
    private = [term for term in columns if term.private]
    diagonal = noise
    if near_uniform is None:
        diagonal = sorted(noise, key=_count_orders, reverse=True)[:1]
        private += [_columns_of_noise(term, tests) for term in noise if term not in diagonal]
    private_signs = [1.0] * sum(len(term.names) for term in private)
    for sign in (1.0, -1.0):
        columns_of_sign = None
        if near_uniform is not None:
            columns_of_sign = _columns_for_uneven_angles(near_uniform, sign)
        if columns_of_sign is not None:
            private.append(columns_of_sign)
            private_signs += [sign] * len(columns_of_sign.names)
    return _Nuisances(diagonal, shared, private, private_signs)


def _count_orders(term: BasisNoise) -> int:
    """Return the number of Fourier coefficients on which a noise term acts."""
    return int(np.count_nonzero(term.sd))


def _sort_sources(
    terms: Sequence[Columns | BasisNoise],
    hypers: Sequence[Hyper],
) -> list[Source]:
    """Return a list of all sources of variance without repetition, sorted by hyper-parameter.

    A source of variance is a hyper-parameter (the sd of an effect) or a product of
    hyper-parameters. Besides the sources of all terms, the result contains two others: the sd σ of
    white noise, and the constant 1 for variances that do not depend on hyper-parameters. ``hypers``
    are the names of the hyper-parameters, in the order by which the sources are sorted.
    """
    sources = {Source(), Source("sigma")}
    for term in terms:
        sources.update(term.sources)
    rank: dict[Hyper | None, int] = {name: k for k, name in enumerate(hypers)}
    rank[None] = len(hypers)

    return sorted(
        sources, key=lambda source: (rank[source.hyper], rank[source.circle], source.order)
    )


def _reading_rows(
    reduced: Sequence[Reduced],
    nuisances: _Nuisances,
    interest: Array,
    offset: Array,
    sources: list[Source],
    *,
    all_uniform: bool,
) -> Rows:
    """Return the observation equations that describe readings, in the order of the tests.

    The last equation of each test describes the norm of the part of the test's readings that
    Fourier series to order 12 cannot describe. The other equations describe reduced readings.
    ``reduced`` holds the reduced readings of every test, ``nuisances`` the nuisances, and
    ``sources`` the sources of variance (hyper-parameters and their products). ``offset`` (tests,
    25) is the known part of the readings and ``interest`` (tests, 25, p) the effect of the p
    parameters of interest, both as Fourier coefficients [mm]. ``all_uniform`` states whether all
    tests are full circles with nearly uniform angles.
    """
    tests = len(reduced)
    shared_values = _stack_values(nuisances.shared, tests)
    private_values = _stack_values(nuisances.private, tests)
    shared_size = shared_values.shape[2]
    private_size = private_values.shape[2]
    reading_noise = np.eye(len(sources))[sources.index(Source("sigma"))]
    blocks = []
    for r, test in enumerate(reduced):
        rotation, factor, noise_sd = _rotate(test, nuisances.diagonal, uniform=all_uniform)
        m = len(factor)
        columns = np.zeros((m + 1, shared_size + tests * private_size))
        first = shared_size + r * private_size
        columns[:m, :shared_size] = factor @ shared_values[r]
        columns[:m, first : first + private_size] = factor @ private_values[r]
        test_interest = np.zeros((m + 1, interest.shape[2]))
        test_interest[:m] = factor @ interest[r]
        values = np.zeros(m + 1)
        if test.reading_mm is not None:
            values[:m] = rotation @ test.reading_mm - factor @ offset[r]
        values[m] = np.sqrt(test.residual_ss)
        readings = np.ones(m + 1)
        readings[m] = max(test.readings - SIZE, 0)
        variance = np.tile(reading_noise, (m + 1, 1))
        for term, sd in zip(nuisances.diagonal, noise_sd, strict=True):
            variance[:m, sources.index(term.source(r))] += sd**2
        number = np.full(m + 1, r)
        blocks.append(Rows(columns, test_interest, values, readings, number, variance))
    return _concatenate(blocks)


def _stack_values(terms: Sequence[Columns], tests: int) -> Array:
    """Return the columns of all nuisance terms side by side, shape (tests, 25, columns).

    A column is the effect of one unit of a nuisance coefficient on each test, as 25 Fourier
    coefficients.
    """
    no_columns = np.zeros((tests, SIZE, 0))
    return np.concatenate([no_columns, *(term.values for term in terms)], axis=2)


def _concatenate(blocks: Sequence[Rows]) -> Rows:
    """Return several sets of observation equations (``blocks``) as one set, in the same order."""
    return Rows(
        columns=np.concatenate([block.columns for block in blocks]),
        interest=np.concatenate([block.interest for block in blocks]),
        values=np.concatenate([block.values for block in blocks]),
        readings=np.concatenate([block.readings for block in blocks]),
        test=np.concatenate([block.test for block in blocks]),
        variance=np.concatenate([block.variance for block in blocks]),
    )


def _rotate(
    test: Reduced,
    noise: Sequence[BasisNoise],
    *,
    uniform: bool,
) -> _Rotated:
    """Return a matrix Q that makes the noise in the reduced readings of a test uncorrelated.

    Reduced readings are at most 25 numbers that replace the readings of a test. If these numbers
    are multiplied by Q, the covariance matrix of each noise term in ``noise`` becomes diagonal. The
    function also returns, for each noise term, the standard deviations on this diagonal, and the
    product Q R. R is ``test.factor``, the matrix that converts 25 Fourier coefficients into the
    reduced readings.

    If all tests are circles with nearly uniform angles (``uniform``), Q = S R⁻¹, where the diagonal
    matrix S holds the norms of the Fourier functions. This Q serves for any number of noise terms.
    The white noise of the readings is then slightly correlated; `_columns_for_uneven_angles`
    corrects for this. Otherwise ``noise`` has at most one term, which states the sd of the noise of
    each Fourier coefficient. The columns of R are multiplied by these sds, and Q is computed from
    the singular value decomposition of the product.
    """
    if uniform and test.near_uniform is not None:
        column_norms = test.near_uniform.column_norms
        rotation = column_norms[:, None] * solve_triangular(test.factor, np.eye(SIZE))
        noise_sd = [column_norms * term.sd for term in noise]
        return _Rotated(rotation, np.diag(column_norms), noise_sd)
    basis_sd = noise[0].sd if noise else 1.0
    left_vectors, singular, _ = np.linalg.svd(test.factor * basis_sd)
    rotation = left_vectors.T
    return _Rotated(rotation, rotation @ test.factor, [singular] if noise else [])


def _add_priors(
    reading_rows: Rows,
    nuisances: _Nuisances,
    tests: int,
    sources: list[Source],
) -> _Scaled:
    """Return the equations of the readings, followed by the priors written as equations.

    The nuisances are effects that are modelled but not of interest. The prior of each nuisance
    coefficient is written as a row, as if the coefficient had been measured. All coefficients are
    rescaled as `Observations.unit` states. ``reading_rows`` are the equations that describe
    readings. ``nuisances`` holds the nuisance terms, and ``tests`` is the number of tests.
    ``sources`` are the sources of variance: hyper-parameters and their products.
    """
    priors = _coefficient_priors(nuisances, tests, sources)
    norms = np.linalg.norm(reading_rows.columns, axis=0)
    flat = np.isinf(priors.sd)
    flat_unit = 1.0 / np.where(norms > 0.0, norms, 1.0)
    proper_unit = np.where(priors.sd > 0.0, priors.sd, priors.stated_sd)
    unit = np.where(flat, flat_unit, proper_unit)
    proper = np.flatnonzero(~flat)
    prior_mean = np.divide(priors.mean, unit, out=np.zeros(len(unit)), where=unit > 0.0)
    scaled = reading_rows._replace(columns=reading_rows.columns * unit)
    prior_rows = Rows(
        columns=np.eye(len(unit))[proper],
        interest=np.zeros((len(proper), reading_rows.interest.shape[1])),
        values=prior_mean[proper],
        readings=np.ones(len(proper)),
        test=_test_of_coefficients(nuisances, tests)[proper],
        variance=_prior_variance_factors(priors, unit, sources)[proper],
    )
    log_volume = float((np.log(unit[flat]) + 0.5 * LOG_2PI).sum())
    return _Scaled(_concatenate([scaled, prior_rows]), unit, log_volume)


def _coefficient_priors(
    nuisances: _Nuisances, tests: int, sources: list[Source]
) -> _CoefficientPriors:
    """Return the priors of all coefficients of nuisances.

    The coefficients that are the same in all tests come first, followed by the coefficients of each
    test. ``nuisances`` holds the nuisance terms, sorted by whether their coefficients are the same
    in all tests. ``tests`` is the number of tests. ``sources`` are the sources of variance
    (hyper-parameters and their products) to which the indices in the result refer.
    """
    sd = [np.zeros(0)]
    stated_sd = [np.zeros(0)]
    mean = [np.zeros(0)]
    for term in [*nuisances.shared, *nuisances.private * tests]:
        zeros = np.zeros(len(term.names))
        sd.append(term.sd)
        stated_sd.append(zeros if term.stated is None else term.stated)
        mean.append(term.prior_mean)
    coefficient_sources: list[Source] = []
    for term in nuisances.shared:
        coefficient_sources += term.sources
    for r in range(tests):
        for term in nuisances.private:
            coefficient_sources += term.sources_of(r)
    return _CoefficientPriors(
        sd=np.concatenate(sd),
        stated_sd=np.concatenate(stated_sd),
        mean=np.concatenate(mean),
        source=np.array([sources.index(source) for source in coefficient_sources], dtype=np.intp),
    )


def _prior_variance_factors(
    priors: _CoefficientPriors,
    unit: Array,
    sources: list[Source],
) -> Array:
    """Return factors v from which the prior variances of nuisance coefficients are computed.

    The result has the shape (coefficients, sources). Nuisances are effects that are modelled but
    not of interest, and ``priors`` are the Gaussian priors of their coefficients. The prior
    variance of each coefficient is Σ v · source², a sum over ``sources``. A source is a
    hyper-parameter, a product of hyper-parameters, or the number one. Each coefficient is first
    divided by its element of ``unit``, shape (coefficients,); the variance is that of the quotient.
    If this element is zero, the coefficient has no effect on the readings, and its variance does
    not matter; the factor of the source that scales its prior sd is then set to one. For a
    coefficient with a flat prior, all factors are zero, and the caller does not use them.
    """
    columns = np.arange(len(unit))
    flat = np.isinf(priors.sd)
    with np.errstate(invalid="ignore", divide="ignore"):
        scaled_share = np.where(unit > 0.0, (priors.sd / unit) ** 2, 1.0)
        stated_share = np.where(unit > 0.0, (priors.stated_sd / unit) ** 2, 0.0)
    factors = np.zeros((len(unit), len(sources)))
    factors[columns, priors.source] += np.where(flat, 0.0, scaled_share)
    factors[columns, sources.index(Source())] += np.where(flat, 0.0, stated_share)
    return factors


def _test_of_coefficients(
    nuisances: _Nuisances,
    tests: int,
) -> NDArray[np.intp]:
    """Return the index of the test to which each coefficient belongs, shape (coefficients,).

    The coefficients are those of ``nuisances``. For a coefficient that is the same in all tests,
    the result holds the number of tests (``tests``) instead of an index.
    """
    shared = np.full(nuisances.shared_size, tests)
    private = np.repeat(np.arange(tests), nuisances.private_size)
    return np.concatenate([shared, private])


def _columns_of_noise(term: BasisNoise, tests: int) -> Columns:
    """Return columns that represent independent noise of the Fourier coefficients of each test.

    ``term`` gives the sd of the noise of each Fourier coefficient. Every Fourier function (such as
    cos 2θ) that has noise becomes a column. Each of ``tests`` tests has a separate coefficient for
    this column, and the prior sd of the coefficient is the sd of the noise.
    """
    functions = np.flatnonzero(term.sd)
    values = np.zeros((tests, SIZE, len(functions)))
    values[:, functions, np.arange(len(functions))] = 1.0
    return Columns(
        tuple(f"{term.hyper}_{i}" for i in functions),
        values,
        term.sd[functions],
        term.hyper,
        private=True,
        circle=term.circle,
    )


def _columns_for_uneven_angles(circles: Sequence[NearUniform], sign: float) -> Columns | None:
    """Return columns that correct the reading noise for angles that are not spaced uniformly.

    If the angles of a test are not spaced uniformly, the noise of its 25 Fourier coefficients is
    correlated, and larger or smaller than for uniform angles. The columns make up for the
    difference: they increase or reduce the noise covariance. Suppose the 25 Fourier coefficients of
    a test are fitted to readings with the noise sd σ, and each coefficient is multiplied by the
    norm of its Fourier function (diagonal matrix S). The covariance of the 25 products is σ² (I + V
    Λ Vᵀ)⁻¹ = σ² (I − V Λ (I + Λ)⁻¹ Vᵀ), where I is the identity matrix, V is orthogonal and Λ
    diagonal; `NearUniform` describes V and Λ. Each column v of V belongs to one diagonal element λ
    of Λ. If this λ is too large to be neglected, the result has a column S⁻¹ v √(|λ|/(1 + λ)),
    whose coefficient has the sd σ.

    Parameters
    ----------
    circles
        Departure of the angles of every test from uniform spacing.
    sign
        +1 for the columns that increase the noise covariance (λ < 0), −1 for the columns that
        reduce it, by a negative variance (λ > 0).

    Returns
    -------
    Columns or None
        The columns of this sign. Their number is the largest number that any test needs; None if no
        test needs such columns.
    """
    indices_by_test = []
    for circle in circles:
        has_sign = sign * circle.departure < 0.0
        indices_by_test.append(np.flatnonzero(circle.significant & has_sign))
    size = max(len(indices) for indices in indices_by_test)
    if size == 0:
        return None
    values = np.zeros((len(circles), SIZE, size))
    for r, (circle, indices) in enumerate(zip(circles, indices_by_test, strict=True)):
        departure = circle.departure[indices]
        variance_ratio = np.abs(departure) / (1.0 + departure)
        columns = circle.directions[:, indices] * np.sqrt(variance_ratio)
        values[r, :, : len(indices)] = columns / circle.column_norms[:, None]
    names = tuple(f"uneven_{i}" for i in range(size))
    return Columns(names, values, np.ones(size), "sigma", private=True)
